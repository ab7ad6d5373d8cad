"""The parts of a recording on its page: levels, sums, colours and peaks against those of the recording, and the legend."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from browser import CHROMIUM, Browser, numbers
from builders import slow_after
from command_line import Command
from t2d_rt.recording.recording import Recording
from t2d_rt.view import parts
from t2d_rt.view.parts import mean_chirp

DARK = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)")
STEP_DB = 2e-3
"""How far a level in 16 bits is from its own: 0.0006 dB, and what single precision leaves."""


@pytest.fixture(scope="module")
def limbs() -> Recording:
    """A step of a walk by ellipsoids, in its segments."""
    walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 1.3), distance_m=3.5)
    return t2d.simulate(walk, method="ellipsoid", split="segment")


@pytest.fixture(scope="module")
def ghosts() -> Recording:
    """The same in an empty room, by path pair."""
    walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 1.3), distance_m=3.5)
    return t2d.simulate(walk, scene="empty_room", method="ellipsoid", reflections=1, split="path")


def split_of(recording: Recording) -> dict[str, Any]:
    """What the page holds of the parts."""
    found = dict(numbers(recording.view().html)["recordings"][0]["split"])
    return {name: each.ravel() if name == "common" else each for name, each in found.items()}


def axes(split: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and times of its cells."""
    return tuple(np.linspace(split[k]["first"], split[k]["last"], split[k]["count"]) for k in ("y", "x"))  # type: ignore[return-value]


def levels(split: dict[str, Any], name: str = "levels") -> np.ndarray:
    """Levels [dB re 1 W] (..., speed, time)."""
    shape = split["y"]["count"], split["x"]["count"]
    return np.asarray(split["low_db"] + split[name].reshape(-1, *shape) / 65535 * (split["high_db"] - split["low_db"]))


def summed_db(split: dict[str, Any], names: list[str]) -> np.ndarray:
    """Levels of the sum of some parts by the page's formula."""
    powers = 10 ** (levels(split).reshape(len(split["names"]), -1) / 10)
    on = np.isin(split["names"], names)
    cell = np.repeat(np.arange(powers.shape[1]), split["counts"])
    total, both = powers[on].sum(axis=0), on[split["one"]] & on[split["other"]]
    one, other, cell = split["one"][both], split["other"][both], cell[both]
    common = (split["common"][both].astype(float) - 32768) / 32767
    np.add.at(total, cell, 2 * common * np.sqrt(powers[one, cell] * powers[other, cell]))
    return np.asarray(10 * np.log10(np.maximum(total, 1e-30)).reshape(split["y"]["count"], -1))


PROCESSING: list[dict[str, Any]] = [
    {},
    {"mti": "mean", "n_fft": 512},
    {"range_gate_m": [2.5, 5.0], "window": "hamming"},
    {"range_gate_m": [2.5, 5.0], "combine": "coherent"},
]


@pytest.mark.parametrize("processing", slow_after(2, PROCESSING))
def test_levels_are_those_of_parts_and_sums_of_their_samples(limbs: Recording, processing: dict[str, Any]) -> None:
    recording = limbs.processed(**processing)
    split = split_of(recording)
    assert split["names"] == list(recording.parts)
    speeds, times = axes(split)
    own = recording.parts.spectrogram.sel(velocity_mps=speeds, time_s=times, method="nearest").values
    whole = recording.spectrogram.sel(velocity_mps=speeds, time_s=times, method="nearest").values
    for found, true in ((levels(split), own), (levels(split, "whole")[0], whole)):
        inside = true > split["low_db"] + 20  # below, single precision shows
        assert inside.sum() > 100
        # Coherently added bins nearly cancel: single precision shows earlier.
        assert np.abs(found - true)[inside].max() < (0.1 if "combine" in processing else STEP_DB)
        assert found[~inside].max(initial=-np.inf) < split["low_db"] + 20.1
    some = ["left_foot", "left_shank", "left_thigh", "pelvis"]
    true = recording.parts.grouped({"some": some})["some"].spectrogram
    true = true.sel(velocity_mps=speeds, time_s=times, method="nearest").values
    alone = own[[split["names"].index(each) for each in some]].max(axis=0)
    inside = (true > true.max() - 40) & (true > alone - 10)  # elsewhere they cancel one another
    assert inside.sum() > 100
    assert np.abs(summed_db(split, some) - true)[inside].max() < 0.3
    assert np.abs(summed_db(split, some) - alone)[inside].max() > 2  # they are no sum of levels, nor the strongest one


def test_the_mean_of_products_is_that_of_samples(limbs: Recording) -> None:
    for cube in limbs.parts.cubes.values():
        samples = np.asarray(cube)
        np.testing.assert_allclose(
            mean_chirp(cube), samples.mean(axis=0, dtype=complex), atol=1e-6 * np.abs(samples).max()
        )


def test_of_many_parts_the_strongest_stand_alone(ghosts: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "MOST_PARTS", 3)
    split = split_of(ghosts)
    energy = {name: float((10 ** (each.spectrogram.values / 10)).sum()) for name, each in ghosts.parts.items()}
    strongest = sorted(energy, key=lambda name: -energy[name])[:3]
    assert set(split["names"][:3]) == set(strongest)
    assert split["names"][3] == f"{len(energy) - 3} others"
    whole = levels(split, "whole")[0]
    inside = whole > whole.max() - 40
    assert np.abs(summed_db(split, split["names"]) - whole)[inside].max() < 0.3
    rest = ghosts.parts.grouped({"rest": [name for name in energy if name not in strongest]})["rest"].spectrogram
    speeds, times = axes(split)
    rest_db = rest.sel(velocity_mps=speeds, time_s=times, method="nearest").values
    assert np.abs(levels(split)[3] - rest_db)[rest_db > rest_db.max() - 40].max() < 0.3


def test_peaks_of_paths_are_those_of_their_maps(ghosts: Recording) -> None:
    split = split_of(ghosts)
    times = axes(split)[1]
    found = {name: split[name].reshape(-1, len(times)) for name in ("ranges", "speeds", "peaks_db")}
    for number, name in enumerate(split["names"][:6]):
        for column in (3, len(times) // 2):
            image = ghosts.parts[name].range_doppler_at(float(times[column]))
            row, place = np.unravel_index(image.values.argmax(), image.shape)
            assert found["ranges"][number, column] == pytest.approx(float(image.range_m[place]), abs=1e-3)
            assert found["speeds"][number, column] == pytest.approx(float(image.velocity_mps[row]), abs=1e-3)
            assert found["peaks_db"][number, column] == pytest.approx(float(image.max()), abs=0.01)


def test_vertices_have_the_parts_of_their_segments_and_pieces() -> None:
    walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 1.1), distance_m=3.5)
    fan = t2d.TableFan(position_m=(3.0, -1.0, 1.0), rpm=300)
    found = numbers(t2d.simulate([walk, fan], method="ellipsoid", split="segment").view().html)["recordings"][0]
    names = found["split"]["names"]
    body, blades = (target["tint"] for target in found["targets"])
    segments = [part["name"].replace(" ", "_") for part in found["parts"][: found["targets"][0]["parts"]]]
    assert [names[each] for each in body[::162]] == [
        f"person: {segments[each]}" for each in found["targets"][0]["owner"][::162]
    ]
    assert {names[each] for each in set(blades.tolist())} == {name for name in names if name.startswith("fan: ")}
    colours = found["split"]["colours"].reshape(-1, 3)
    assert len({tuple(each) for each in colours.tolist()}) == len(names)


def test_pages_without_parts_and_with_parts_that_cannot_be_shown(limbs: Recording) -> None:
    (bare,) = numbers(limbs._with(parts={}).view().html)["recordings"]
    assert "split" not in bare
    assert all("tint" not in target for target in bare["targets"])
    split = split_of(limbs.processed(mti="canceller"))
    assert list(split) == ["why"]
    assert "mti=canceller" in split["why"]


def test_the_command_simulates_with_parts(tmp_path: Path, run: Command) -> None:
    words = ("--method", "ellipsoid", "--start-s", "1", "--stop-s", "1.3", "--split", "segment")
    code, out, err = run("view", "walk", *words)
    assert (code, "walk.html" in out) == (0, True), err
    (found,) = numbers((tmp_path / "walk.html").read_text(encoding="utf-8"))["recordings"]
    assert "left_foot" in found["split"]["names"]
    code, _, err = run("view", "walk", "-o", "a.html", "--lanes", "2")
    assert (code, "option lanes is of measured samples, and walk is a motion" in err) == (2, True)
    np.save(tmp_path / "samples.npy", np.zeros((300, 1, 256), np.complex64))
    code, _, err = run("view", "samples.npy", "-o", "a.html", "--radar", "table2", "--split", "segment")
    assert (code, "option split is of a simulation, and samples.npy is a recording" in err) == (2, True)


# --- in a browser ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("browser")) as found:
        yield found


SPLIT = "state.panels[0].split"


@pytest.mark.slow
@DARK
def test_a_click_lists_what_strongest_tells_and_lights_it(limbs: Recording, browser: Browser, tmp_path: Path) -> None:
    limbs.load(_saved(limbs, tmp_path)).view().save(tmp_path / "limbs.html")  # as it comes from a folder
    browser.open(tmp_path / "limbs.html")
    split = split_of(limbs)
    speeds, times = axes(split)
    whole = levels(split, "whole")[0]
    strong = np.argwhere(whole > whole.max() - 30)
    for row, column in strong[np.random.default_rng(5).choice(len(strong), 12, replace=False)]:
        speed, time = float(speeds[row]), float(times[column])
        true = limbs.strongest(speed, time)
        found = browser.run(f"{SPLIT}.shares({speed}, {time})")
        assert (found["time"], found["speed"]) == pytest.approx((time, speed), abs=1e-6)
        assert found["whole"] == pytest.approx(true.attrs["level_db"], abs=STEP_DB)
        seen = true.where(true.level_db > split["low_db"] + 20, drop=True)
        by_name = {each["name"]: each for each in found["parts"]}
        for name in seen.part.values:
            own = true.sel(part=name)
            assert by_name[name]["level"] == pytest.approx(float(own.level_db), abs=STEP_DB)
            assert by_name[name]["relative"] == pytest.approx(float(own.relative_db), abs=2 * STEP_DB)
        order = [float(true.level_db.sel(part=each["name"])) for each in found["parts"]]
        assert np.diff(order).max(initial=0) < 2 * STEP_DB  # the strongest first
        browser.run(f"clicked('spectrogram', {time}, {speed})")
        told = browser.run("document.getElementById('told').textContent")
        assert f"Made by {found['parts'][0]['name'].replace('_', ' ')} " in told
        lit = browser.run(f"[...state.panels[0].lit].map(k => {SPLIT}.names[k])")
        close = [each["name"] for each in found["parts"] if each["level"] > found["parts"][0]["level"] - 10]
        assert sorted(lit) == sorted(close)
        body = browser.run("[...state.panels[0].parts].map(k => state.panels[0].recording.parts[k].name)")
        assert sorted(body) == sorted(name.replace("_", " ") for name in lit)
    browser.press("Escape")
    assert browser.run("state.panels[0].lit.size + state.panels[0].parts.size") == 0
    assert browser.told == []


def _saved(recording: Recording, folder: Path) -> Path:
    recording.save(folder / "limbs.zarr")
    return folder / "limbs.zarr"


@pytest.mark.slow
@DARK
def test_the_legend_switches_parts_and_colours(limbs: Recording, browser: Browser, tmp_path: Path) -> None:
    limbs.view().save(tmp_path / "limbs.html")
    browser.open(tmp_path / "limbs.html")
    split = split_of(limbs)
    chart = "state.panels[0].charts[0]"
    image = (
        f"(() => {{ const {{ image }} = {chart}; "
        "return [...penOf(image).getImageData(0, 0, image.width, image.height).data]; })()"
    )
    shape = browser.run(f"[{chart}.map.y.count, {chart}.map.x.count, 4]")
    tinted = np.array(browser.run(image)).reshape(shape)[::-1]
    strongest = levels(split).argmax(axis=0)
    first, last, count = (browser.run(f"{chart}.map.x.{name}") for name in ("first", "last", "count"))
    near = np.abs(np.linspace(first, last, count)[:, None] - axes(split)[1]).argmin(axis=1)
    hues = split["colours"].reshape(-1, 3)[strongest[:, near]]
    bright = tinted[..., :3].max(axis=-1) > 100
    assert bright.sum() > 100
    own, wanted = (each / np.linalg.norm(each, axis=-1, keepdims=True).clip(1) for each in (tinted[..., :3], hues))
    towards = (own * wanted).sum(axis=-1)
    assert towards[bright].min() > 0.995
    browser.press("c")
    plain = np.array(browser.run(image)).reshape(shape)[::-1]
    value = browser.run(f"[...{chart}.map.values]")
    own = np.array(browser.run(f"[...{chart}.colours]")).reshape(-1, 3)
    peak = int(np.argmax(value))
    np.testing.assert_array_equal(
        plain.reshape(-1, 4)[peak, :3], own[255]
    )  # the strongest cell in the map's last colour
    # One part alone, then two: levels are those of their coherent sum.
    names = [each.replace("_", " ") for each in split["names"]]
    place = names.index("left foot"), names.index("left shank")
    chips = "document.querySelectorAll('.chip')"
    browser.run(f"{chips}[{place[0]}].dispatchEvent(new MouseEvent('click', {{ shiftKey: true }}))")
    assert browser.run(f"[...{SPLIT}.on]") == [place[0]]
    browser.run(f"{chips}[{place[1]}].click()")
    shown = np.array(browser.run(f"[...{SPLIT}.made().sum_db]"), float).reshape(levels(split).shape[1:])
    expected = summed_db(split, [split["names"][each] for each in place])
    inside = expected > expected.max() - 40
    assert np.abs(shown - expected)[inside].max() < 0.05
    assert "sum of 2 of 17 parts" in browser.run("document.querySelector('.legend').textContent")
    browser.run("[...document.querySelectorAll('.legend button')].find(each => each.textContent == 'all').click()")
    assert browser.run(f"{SPLIT}.whole_on")
    assert browser.told == []


@pytest.mark.slow
@DARK
def test_ghosts_are_named_in_the_range_doppler_map(ghosts: Recording, browser: Browser, tmp_path: Path) -> None:
    ghosts.view().save(tmp_path / "ghosts.html")
    browser.open(tmp_path / "ghosts.html", "#t=0.25")
    names = browser.run(
        """(() => {
            const chart = state.panels[0].charts.find(each => each.kind == "range_doppler");
            const pen = penOf(chart.canvas), write = pen.fillText, found = [];
            pen.fillText = (text, x, y) => { found.push(text); write.call(pen, text, x, y); };
            chart.shown = null; draw(); delete pen.fillText;
            return found;
        })()"""
    )
    loudest = browser.run(f"{SPLIT}.ghosts(.25, -Infinity).slice(0, 3).map(each => each.name)")
    assert "direct" in loudest
    for name in loudest:
        assert any(text.startswith(f"{name}  ") and text.endswith(" dB") for text in names), names
    time = axes(split_of(ghosts))[1]
    speed = float(ghosts.parts["direct"].range_doppler_at(0.25).max("range_m").idxmax())
    browser.run(f"clicked('spectrogram', {time[len(time) // 2]}, {speed})")
    lit = browser.run("[...state.panels[0].paths].map(k => state.panels[0].recording.paths[k].name)")
    assert "direct" in lit
    assert browser.told == []
