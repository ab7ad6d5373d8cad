"""The page that shows recordings: its numbers against those of the recording, and what it does in a browser."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import t2d_rt as t2d
from browser import CHROMIUM, Browser, numbers
from command_line import Command
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.recording.recording import Recording
from t2d_rt.signal import coherent_interval, range_doppler, range_doppler_over
from t2d_rt.types import MovingMesh, Radar
from t2d_rt.view import Viewer, gather

TABLE2 = Radar.preset("table2")
DARK = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)")


@pytest.fixture(scope="module")
def walker() -> Recording:
    """A step of a walk in an empty room, by ellipsoids, beside a fan."""
    walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 1.8), distance_m=3.5)
    fan = t2d.TableFan(position_m=(3.0, -1.0, 1.0), rpm=300)
    return t2d.simulate([walk, fan], radar=TABLE2, scene="empty_room", method="ellipsoid", reflections=1)


@pytest.fixture(scope="module")
def viewer(walker: Recording) -> Viewer:
    return walker.view()


@pytest.fixture(scope="module")
def both(walker: Recording) -> Viewer:
    """That recording beside its own samples, 20 dB weaker, as if they had been measured."""
    return walker.view(Recording(np.float32(0.1) * np.asarray(walker.cube), TABLE2, processing={"mti": "mean"}))


@pytest.fixture(scope="module")
def shown(viewer: Viewer) -> dict[str, Any]:
    return numbers(viewer.html)["recordings"][0]


@pytest.fixture(scope="module")
def page(viewer: Viewer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "walk & turn.html"
    viewer.save(path)
    return path


# --- its numbers ----------------------------------------------------------------------------------------------------


def test_the_page_needs_nothing_else(viewer: Viewer) -> None:
    text = re.sub(r'<script id="data".*?</script>', "", viewer.html, flags=re.DOTALL)
    assert not re.search(r"https?:|\bsrc=|@import|url\(|/\*[A-Z]+\*/", text)
    assert len(viewer.html) < 2e6


def test_bodies_are_where_they_are(walker: Recording, shown: dict[str, Any]) -> None:
    assert [each["name"] for each in shown["targets"]] == ["adult", "fan"]
    motion = walker.experiment.targets_from(walker.inputs)[0]
    body = shown["targets"][0]
    times = np.arange(body["frames"]) / shown["frames_hz"]
    solid = t2d.segments(motion).solid()
    places = np.array(body["low"]) + np.array(body["pitch"]) * body["vertices"].reshape(len(times), -1, 3)
    assert np.abs(places - solid.vertices_at(times)).max() < 1.1e-4
    np.testing.assert_array_equal(body["faces"], solid.faces.ravel())
    # A vertex belongs to the ellipsoid on whose surface it lies.
    names = [part["name"] for part in shown["parts"] if part["target"] == 0]
    assert names[body["owner"][0]] == "head"
    assert places[0][body["owner"] == names.index("left foot")][:, 2].max() < 0.3


def test_speeds_and_paths_are_those_of_the_tables(walker: Recording, shown: dict[str, Any]) -> None:
    truth, paths = walker.truth_at(np.arange(20) / 25), walker.paths
    foot = next(part for part in shown["parts"] if part["name"] == "right foot")
    own = truth.sel(segment="right_foot", person="adult")
    np.testing.assert_allclose(foot["speed"][:20], own.segment_speed_mps, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(foot["range"][:20], own.segment_range_m, rtol=1e-6)
    assert {part["side"] for part in shown["parts"] if "left" in part["name"]} == {"left"}
    down = truth.contact.sel(foot="right").any("part").values[0]
    np.testing.assert_array_equal(shown["standing"]["right"][:20], down)
    for path in shown["paths"]:
        own_path = paths.isel(target=path["target"]).sel(pair=path["name"])
        np.testing.assert_allclose(path["range"], own_path.delay_s * SPEED_OF_LIGHT / 2, rtol=1e-6)
        assert path["order"] == int(own_path.reflections)
        assert path["meets"][0] == path["meets"][-1] == "radar"
    direct = max(float(path["level"][3]) for path in shown["paths"] if path["target"] == 0)
    assert direct == pytest.approx(float(paths.level_dbm.sel(pair="direct", target="adult")[3]), abs=1e-3)
    fan = next(part for part in shown["parts"] if part["name"] == "fan")
    mesh = t2d.TableFan(position_m=(3.0, -1.0, 1.0), rpm=300).mesh(0.0, 0.8)
    ellipsoids = t2d.segments(walker.experiment.targets_from(walker.inputs)[0]).solid()
    owner = shown["targets"][0]["owner"]
    for part, places in (
        (fan, mesh.at),
        (foot, lambda at_s: ellipsoids.vertices_at(at_s)[:, owner == shown["parts"].index(foot)]),
    ):
        earlier, now, later = (
            np.linalg.norm(places(np.array([0.4 + each]))[0] - [0, 0, 1], axis=1) for each in (-1e-5, 0, 1e-5)
        )
        speeds = (earlier - later) / 2e-5
        for name, values in (("slow", speeds.min()), ("fast", speeds.max())):
            assert part[name][10] == pytest.approx(values, rel=0.01, abs=0.01)
        assert [part["near"][10], part["far"][10]] == pytest.approx([now.min(), now.max()], rel=1e-3)


def test_levels_and_axes_are_those_of_the_maps(walker: Recording, shown: dict[str, Any]) -> None:
    image, kept = walker.spectrogram, shown["maps"]["spectrogram"]
    part = image.sel(velocity_mps=slice(kept["y"]["first"] - 1e-6, kept["y"]["last"] + 1e-6)).values
    assert part.shape == (kept["y"]["count"], kept["x"]["count"])
    assert kept["high_db"] == pytest.approx(image.values.max(), abs=1e-6)
    levels = kept["low_db"] + kept["values"].reshape(part.shape) / 255 * (kept["high_db"] - kept["low_db"])
    inside = part > kept["low_db"]
    assert np.abs(levels - part)[inside].max() < 0.16
    assert levels[~inside].max(initial=kept["low_db"]) < kept["low_db"] + 0.16
    doppler = shown["maps"]["range_doppler"]
    frame = len(doppler["times"]) // 2
    own = walker.range_doppler_at(float(doppler["times"][frame])).sel(
        velocity_mps=slice(doppler["y"]["first"] - 1e-6, doppler["y"]["last"] + 1e-6),
        range_m=slice(doppler["x"]["first"] - 1e-6, doppler["x"]["last"] + 1e-6),
    )
    values = doppler["values"].reshape(len(doppler["times"]), doppler["y"]["count"], doppler["x"]["count"])[frame]
    strong = own.values > own.values.max() - 20
    levels = doppler["low_db"] + values / 255 * (doppler["high_db"] - doppler["low_db"])
    assert strong.sum() > 20
    assert np.abs(levels - own.values)[strong].max() < 0.5  # the interval may begin one chirp later


@pytest.mark.parametrize("preset", ["table2", "table2-burst", "array-3x4"])
@pytest.mark.parametrize("mti", ["none", "mean", "canceller"])
def test_maps_over_time_are_those_of_each_interval(preset: str, mti: str) -> None:
    radar = Radar.preset(preset)
    rng = np.random.default_rng(1)
    shape = (384, radar.antennas, radar.samples)
    cube = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    last_s = float(radar.chirp_starts_s(384)[-1])
    times_s = np.array([0.0, 1e-4, 0.3 * last_s, 0.7 * last_s, last_s])
    middles_s, found = range_doppler_over(cube, radar, times_s, mti=mti, n_window=64)
    intervals = {}
    for time_s in times_s:
        part, own, middle_s = coherent_interval(cube, radar, time_s=float(time_s), chirps=64, mti=mti)
        intervals[round(middle_s, 9)] = range_doppler(part, own)
    assert middles_s == pytest.approx(sorted(intervals), abs=1e-8)
    for one, power in zip(intervals.values(), found.power, strict=True):
        np.testing.assert_allclose(power, one.power, rtol=1e-3, atol=1e-4 * one.power.max())
        np.testing.assert_allclose(found.velocity_mps, one.velocity_mps)


def test_two_recordings_share_their_levels(both: Viewer) -> None:
    first, second = numbers(both.html)["recordings"]
    for kind in ("spectrogram", "range_time", "range_doppler"):
        assert first["maps"][kind]["high_db"] == second["maps"][kind]["high_db"]
        strongest, weaker = (int(each["maps"][kind]["values"].max()) for each in (first, second))
        assert strongest - weaker == pytest.approx(20 * 255 / 80, abs=1)
    assert second["why_no_room"].startswith("This recording was measured")
    assert second["targets"] == second["paths"] == []


@pytest.mark.slow
def test_a_ball_and_a_target_that_is_not_stored() -> None:
    from trimesh.creation import icosphere

    ball, times_s = icosphere(subdivisions=2, radius=0.3), np.linspace(0, 0.2, 11)
    place = np.stack([4 - times_s, 0 * times_s, 1 + 0 * times_s], -1)
    mesh = MovingMesh(ball.vertices[None] + place[:, None], ball.faces, times_s, "metal", name="ball")
    found = numbers(t2d.simulate(mesh, radar=TABLE2).view().html)["recordings"][0]
    (part,) = found["parts"]
    assert (part["name"], found["standing"], found["surfaces"]) == ("ball", None, [])
    assert part["speed"] == pytest.approx(1.0, abs=1e-3)
    assert (part["far"] - part["near"]).max() == pytest.approx(0.6, abs=0.02)
    lost = MovingMesh.from_track(lambda at: ball.vertices[None] + [4, 0, 1] - at[:, None, None], ball.faces, times_s)
    alone = numbers(t2d.simulate(lost, radar=TABLE2).view().html)["recordings"][0]
    assert "was computed by a function, which is not stored" in alone["why_no_room"]


def test_columns_of_bursts_stand_at_their_times() -> None:
    time_s, power_db = np.array([0.0, 0.1, 1.0, 1.1]), np.arange(4.0)[None]
    even_s, found = gather.evenly(time_s, power_db)
    np.testing.assert_allclose(even_s, np.arange(12) / 10)
    np.testing.assert_array_equal(found[0], [0, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 3])
    assert gather.evenly(np.arange(4.0), power_db)[1] is power_db


def test_long_recordings_have_fewer_frames(walker: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, most in (("MOST_FRAMES", 10), ("MOST_MAPS", 4), ("MOST_PLACES", 3 * 17 * 162)):
        monkeypatch.setattr(gather, name, most)
    found = gather.gathered(walker)
    assert found["frames_hz"] == pytest.approx(10 / 0.8, rel=0.01)
    assert {len(part["speed"]) for part in found["parts"]} == {11}
    body = found["targets"][0]
    assert (body["every"], body["frames"], len(body["vertices"])) == (4, 3, 3)
    solid = walker.experiment.targets_from(walker.inputs)[0] if walker.experiment else None
    places = t2d.segments(solid).solid().vertices_at(np.arange(3) * 4 / found["frames_hz"])
    np.testing.assert_allclose(body["low"] + body["pitch"] * body["vertices"], places, atol=1.1e-4)
    assert len(found["maps"]["range_doppler"]["times"]) <= 5


def test_silence_is_dark() -> None:
    found = numbers(Viewer(Recording(np.zeros((600, 1, TABLE2.samples), np.complex64), TABLE2)).html)["recordings"][0]
    assert not found["maps"]["spectrogram"]["values"].any()


# --- files and notebooks --------------------------------------------------------------------------------------------


def test_a_notebook_shows_it(viewer: Viewer) -> None:
    cell = viewer._repr_html_()
    assert cell.startswith("<iframe ")
    assert 'srcdoc="&lt;!doctype html&gt;' in cell
    assert repr(viewer).startswith("Viewer(")


def test_names_cannot_leave_the_text() -> None:
    html = Viewer(
        Recording(np.ones((300, 1, TABLE2.samples), np.complex64), TABLE2),
        ["</script><script>alert(1)//\x1b[1m /*DATA*/"],
    ).html
    assert "<script>alert" not in html
    title = numbers(html)["title"]
    assert title.startswith("</script>")
    assert title.endswith("/*DATA*/")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("walk.png", "a page ends in .html or .htm, got"),
        ("nowhere/walk.html", "does not exist; create it first"),
        ("there.html", "exists"),
    ],
)
def test_places_that_are_refused(viewer: Viewer, tmp_path: Path, name: str, sentence: str) -> None:
    (tmp_path / "there.html").write_text("mine")
    with pytest.raises(InputError, match=sentence):
        viewer.save(tmp_path / name)
    assert (tmp_path / "there.html").read_text() == "mine"
    viewer.save(tmp_path / "there.html", overwrite=True)


def test_what_is_no_recording_is_refused(walker: Recording) -> None:
    with pytest.raises(InputError, match="two side by side, got 3"):
        Viewer([walker, walker, walker])
    with pytest.raises(InputError, match="recordings must be a Recording or a list of two, got"):
        Viewer([walker, 3])  # type: ignore[list-item]
    with pytest.raises(InputError, match="titles must be a text for each of 1 recordings, got 2"):
        Viewer(walker, ["a", "b"])


def test_the_command(walker: Recording, tmp_path: Path, run: Command) -> None:
    walker.save(tmp_path / "room.zarr")
    np.save(tmp_path / "capture.npy", np.asarray(walker.cube)[:2000])
    code, out, _ = run("view", "room.zarr", "capture.npy", "--radar-file", "table2")
    assert (code, "room.html" in out) == (0, True)
    found = numbers((tmp_path / "room.html").read_text(encoding="utf-8"))["recordings"]
    assert [each["title"].partition(":")[0] for each in found] == ["room", "capture"]
    for words, sentence in (
        (("room.zarr",), "room.html exists already"),
        ((), "got 0 names"),
        (("room.zarr", "-o", "a.html", "--radar", "table2"), "room.zarr is a result, which holds its own radar; leave"),
        (
            ("room.zarr", "-o", "a.html", "--lanes", "2"),
            "option lanes is of measured samples, and room.zarr is a result",
        ),
        (("room.zarr", "-o", "a.html", "--conjugate", "false"), "option conjugate is of measured samples"),
        (("capture.npy", "-o", "a.html"), "holds samples only; give its radar"),
    ):
        code, _, err = run("view", *words)
        assert (code, sentence in err) == (2, True), err


# --- in a browser ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("browser")) as found:
        yield found


def colours(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def box(browser: Browser, name: str) -> list[float]:
    return list(
        browser.run(f"(b => [b.x, b.y, b.width, b.height])(document.querySelector('{name}').getBoundingClientRect())")
    )


def place(browser: Browser, kind: str, x: float, y: float) -> tuple[float, float]:
    """Where a cell of a map is in the window."""
    chart = f"state.panels[0].charts.find(each => each.kind == '{kind}')"
    left, top, _, _ = box(browser, f".{kind} canvas")
    across, down = browser.run(f"[{chart}.px({x}), {chart}.py({y})]")
    return left + across, top + down


def green(image: np.ndarray) -> int:
    """Number of pixels in the colour of what a click has found."""
    red, lime, blue = np.moveaxis(image, -1, 0)
    return int(((lime > 120) & (red < 0.85 * lime) & (red > 0.6 * lime) & (blue < 0.5 * lime)).sum())


@DARK
def test_it_opens_without_network_and_without_a_complaint(browser: Browser, page: Path) -> None:
    ready_s = browser.open(page)
    assert ready_s < 15  # 3 s where nothing else runs
    assert browser.told == []
    assert {each.partition(":")[0] for each in browser.requests} <= {"file", "about", "data"}
    assert browser.run("document.title") == "ellipsoid, empty_room, 77 GHz"
    for name in (".room canvas", ".spectrogram canvas", ".range_time canvas", ".range_doppler canvas"):
        x, y, width, height = box(browser, name)
        assert x >= 0
        assert y >= 0
        assert x + width <= 1280
        assert y + height <= 800
        assert len(np.unique(colours(browser.picture([x, y, width, height])).reshape(-1, 3), axis=0)) > 100


@pytest.mark.slow
@DARK
def test_pictures_change_with_time_and_the_keys_move_it(browser: Browser, page: Path) -> None:
    browser.open(page, "#t=0.2")
    assert browser.run("state.time") == pytest.approx(0.2)
    room, doppler = (box(browser, f".{name} canvas") for name in ("room", "range_doppler"))
    before = [colours(browser.picture(each)) for each in (room, doppler)]
    browser.press("ArrowRight")
    assert browser.run("state.time") == pytest.approx(0.24)
    for _ in range(5):
        browser.press("ArrowRight")
    assert browser.run("state.time") == pytest.approx(0.44)
    for image, each in zip(before, (room, doppler), strict=True):
        assert (np.abs(colours(browser.picture(each)) - image).max(axis=-1) > 30).mean() > 0.001
    browser.press("Home")
    assert browser.run("state.time") == 0
    browser.press(" ", " ")
    browser.run("new Promise(done => setTimeout(done, 1500))")
    assert browser.run("state.playing")
    assert browser.run("state.time") > 0.05
    browser.press(" ", " ")
    assert not browser.run("state.playing")
    assert browser.told == []


@DARK
@pytest.mark.parametrize("look", ["above", "room", "radar", "near"])
def test_names_in_the_room_stand_apart(browser: Browser, page: Path, look: str) -> None:
    browser.open(page, f"#t=0.4&look={look}")
    names = browser.run(
        """(() => {
            const room = state.panels[0].room, pen = room.over.getContext("2d"), write = pen.fillText, found = [];
            pen.fillText = (text, x, y) => {
                const box = pen.measureText(text), { actualBoundingBoxAscent: up, actualBoundingBoxDescent: down } = box;
                found.push([text, x - box.width / 2, x + box.width / 2, y - up, y + down]);
                write.call(pen, text, x, y);
            };
            draw(); delete pen.fillText;
            return found.map(each => [...each, room.over.width, room.over.height]);
        })()"""
    )
    assert any("wall" in text for text, *_ in names) or look != "above"
    assert len({text for text, *_ in names}) == len(names)
    for number, (_, left, right, top, bottom, width, height) in enumerate(names):
        assert 0 <= left < right <= width
        assert 0 <= top < bottom <= height
        for _, other_left, other_right, other_top, other_bottom, *_ in names[:number]:
            assert right < other_left or other_right < left or bottom < other_top or other_bottom < top, names


@DARK
def test_the_map_of_the_moment_shows_targets_or_all_of_it(browser: Browser, page: Path, shown: dict[str, Any]) -> None:
    browser.open(page)
    chart = "state.panels[0].charts.find(each => each.kind == 'range_doppler')"
    parts, at = shown["parts"], box(browser, ".range_doppler canvas")
    near, whole = browser.run(f"{chart}.span"), browser.run(f"{chart}.whole")
    assert whole["x"][0] <= near["x"][0] < min(each["near"].min() for each in parts)
    assert max(each["far"].max() for each in parts) < near["x"][1] <= whole["x"][1]
    assert near["x"][1] - near["x"][0] < 0.9 * (whole["x"][1] - whole["x"][0])
    before = browser.picture(at)
    # The pointer reads the same cell of the map, wherever that is drawn.
    part = next(each for each in parts if each["name"] == "chest")
    where = float(part["range"][8]), float(part["speed"][8])
    level = browser.run(f"{chart}.level({where[0]}, {where[1]}, 2)")
    for key in ("w", "w"):
        x, y = place(browser, "range_doppler", *where)
        read = browser.run(f"{chart}.at({{clientX: {x}, clientY: {y}}})")
        assert [read["x"], read["y"]] == pytest.approx(where, abs=0.05)
        browser.press(key, key)
        assert browser.run(f"{chart}.level({where[0]}, {where[1]}, 2)") == level
        if browser.run("state.whole"):
            assert browser.run(f"{chart}.span") == whole
            assert (np.abs(colours(browser.picture(at)) - colours(before)).max(axis=-1) > 30).mean() > 0.02
    assert browser.picture(at) == before
    x, y, width, height = box(browser, ".range_doppler button")
    browser.click(x + width / 2, y + height / 2)
    assert browser.run("state.whole")
    assert browser.told == []


@DARK
def test_a_click_on_the_arc_of_a_foot_lights_that_foot(browser: Browser, page: Path, shown: dict[str, Any]) -> None:
    browser.open(page)
    feet = {part["foot"]: part["speed"][2:-2] for part in shown["parts"] if part["foot"]}
    side = max(feet, key=lambda each: feet[each].max())
    other = "left" if side == "right" else "right"
    k = int(feet[side].argmax())
    browser.run("look('near')")
    browser.run(f"seek({(k + 2) / 25})")
    room = box(browser, ".room canvas")
    before = colours(browser.picture(room))
    browser.click(*place(browser, "spectrogram", (k + 2) / 25, float(feet[side][k])))
    lit = browser.run("[...state.panels[0].parts].map(number => state.panels[0].recording.parts[number].name)")
    assert f"{side} foot" in lit
    assert f"{other} foot" not in lit
    told = browser.run("document.getElementById('told').textContent")
    assert f"{side} foot" in told
    assert re.search(r"The strongest echoes at that speed come from \d\.\d\d m \(\d+\.\d ns\): path direct", told)
    assert green(colours(browser.picture(room))) > green(before) + 30
    # The same cell of the range-Doppler map, and the trunk at its range over time.
    part = next(each for each in shown["parts"] if each["name"] == f"{side} foot")
    browser.click(*place(browser, "range_doppler", float(part["range"][k + 2]), float(part["speed"][k + 2])))
    assert f"{side} foot" in browser.run("document.getElementById('told').textContent")
    assert "Delay " in browser.run("document.getElementById('told').textContent")
    trunk = next(each for each in shown["parts"] if each["name"] == "chest")
    browser.click(*place(browser, "range_time", (k + 2) / 25, float(trunk["range"][k + 2])))
    assert "chest" in browser.run(
        "[...state.panels[0].parts].map(number => state.panels[0].recording.parts[number].name).join()"
    )
    browser.press("Escape")
    assert browser.run("state.panels[0].parts.size") == 0
    assert browser.told == []


@pytest.mark.slow
@DARK
def test_a_click_above_a_foot_finds_its_fastest_point(browser: Browser, page: Path, shown: dict[str, Any]) -> None:
    browser.open(page)
    foot = max((part for part in shown["parts"] if part["foot"]), key=lambda part: part["fast"][2:-2].max())
    k = 2 + int(foot["fast"][2:-2].argmax())
    fastest = float(foot["fast"][k])
    assert fastest > foot["speed"][k] + 0.3
    heights = []
    for speed, words in (
        (fastest, f"At that speed moves: {foot['name']}"),
        (fastest + 0.5, f"Fastest then: {foot['name']}"),
    ):
        browser.run(f"clicked('spectrogram', {k / 25}, {speed})")
        assert words in browser.run("document.getElementById('told').textContent")
        heights.append(box(browser, ".room canvas"))
    assert heights[0] == heights[1]


@pytest.mark.slow
@DARK
def test_an_echo_is_matched_by_delay_and_speed(browser: Browser, page: Path, shown: dict[str, Any]) -> None:
    browser.open(page)
    paths = [path for path in shown["paths"] if path["target"] == 0 and np.isfinite(path["level"][10])]
    browser.run("seek(0.4)")
    # The images of the antennas give the range over each path.
    for path in paths:
        place = path["points"].reshape(-1, len(path["meets"]), 3)[10, path["meets"].index("target")].tolist()
        number = shown["paths"].index(path)
        over = (
            f"state.panels[0].over(state.panels[0].recording.paths[{number}], {{places: [{place}, {place}], step: 0}})"
        )
        assert browser.run(f"{over}.range[0]") == pytest.approx(float(path["range"][10]), abs=1e-4)
    # Straight out and back over the wall behind, the walker comes nearer by what the way back gets longer.
    behind = min(paths, key=lambda path: abs(float(path["speed"][10])))
    assert abs(behind["speed"][10]) < 0.1
    told = "document.getElementById('told').textContent"
    browser.run(f"clicked('range_doppler', {behind['range'][10]}, {behind['speed'][10]})")
    assert f"path {behind['name']} to adult (" in browser.run(told)
    browser.run(f"clicked('range_doppler', {behind['range'][10]}, 3.5)")
    assert f"path {behind['name']} to adult (" not in browser.run(told)
    browser.run("clicked('range_doppler', 0.3, 3)")
    assert "no path in use fits" in browser.run(told)


@DARK
def test_what_is_said_is_so(browser: Browser, page: Path, shown: dict[str, Any]) -> None:
    browser.open(page)
    paths = [path for path in shown["paths"] if path["target"] == 0]
    for k in (3, 10, 16):
        browser.run(f"seek({k / 25})")
        text = browser.run("document.querySelector('.said').textContent")
        for side in ("left", "right"):
            assert (f"{side} foot swings" in text) != bool(shown["standing"][side][k]), text
        ghost = max(
            (path for path in paths if path["order"]), key=lambda path: np.nan_to_num(path["level"][k], nan=-1e9)
        )
        met = next(name for name in ghost["meets"] if name not in ("radar", "target"))
        assert re.search(rf"Strongest ghost: over ({re.escape(met)}|wall [^.]*\({re.escape(met)}\))", text)
    rows = browser.run("[...document.querySelectorAll('.list tr')].map(row => row.textContent)")
    assert rows[1].startswith("direct")
    browser.run("document.querySelectorAll('.list tr')[2].click()")
    assert browser.run("state.panels[0].paths.size") == 1
    browser.run(
        "document.querySelector('.list select').selectedIndex = 1; document.querySelector('.list select').onchange()"
    )
    assert browser.run("state.panels[0].pathsAt(state.time).every(path => path.target == 1)")


@pytest.mark.slow
@DARK
def test_between_frames_speeds_are_those_of_the_truth(browser: Browser, page: Path, walker: Recording) -> None:
    browser.open(page)
    times_s = (np.arange(4, 16) + 0.5) / 25
    own = walker.truth_at(times_s).sel(person="adult")
    for side in ("left", "right"):
        foot = own.sel(segment=f"{side}_foot")
        find = f"state.panels[0].partsAt(time).find(part => part.foot == '{side}')"
        found = browser.run(f"{times_s.tolist()}.map(time => [{find}.speed, {find}.range])")
        speeds, ranges = np.array(found).T
        assert np.abs(speeds - foot.segment_speed_mps.values).max() < 0.1
        assert np.abs(ranges - foot.segment_range_m.values).max() < 5e-3


@pytest.mark.slow
@DARK
def test_speeds_beyond_the_radars_are_folded(browser: Browser, page: Path) -> None:
    browser.open(page)
    most = TABLE2.max_speed_mps
    for speed in (-most + 0.1, 0.0, most - 0.1, most + 0.5, -most - 0.5, 3.3 * most):
        folded = (speed + most) % (2 * most) - most
        assert browser.run(f"state.panels[0].folded({speed})") == pytest.approx(folded, abs=1e-9)


@pytest.mark.slow
@DARK
def test_two_side_by_side_and_a_measured_one_alone(
    browser: Browser, walker: Recording, both: Viewer, tmp_path: Path
) -> None:
    both.save(tmp_path / "two.html")
    browser.open(tmp_path / "two.html", "#t=0.4&speed=1")
    assert browser.run("state.panels.length") == 2
    assert browser.run("document.querySelectorAll('.map canvas').length") == 6
    assert browser.run("document.getElementById('told').textContent").count("measured") == 1
    Recording(np.asarray(walker.cube), TABLE2).view().save(tmp_path / "one.html")
    browser.open(tmp_path / "one.html", "#t=0.4&speed=1")
    assert "was measured" in browser.run("document.querySelector('.why').textContent")
    assert browser.run("document.getElementById('sides').hidden")
    assert browser.told == []
