"""Parts of a recording: they add up to the whole, move as their limbs do, are kept in the folder, and explain a cell."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import ball, slow_after, small_room, walk
from measures import check_picture, nmse_db
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError
from t2d_rt.pipeline.parts import PartNames
from t2d_rt.plots import plot_parts
from t2d_rt.plots.parts import LIMBS, part_hues, rgb
from t2d_rt.recording.parts import poses_of
from t2d_rt.types.scatterer import EchoLabels

RADAR = t2d.Radar.preset("table2", samples=64, prf_hz=6000.0)
PAIR: dict[str, Any] = {"tx_offsets_m": ((0.0, 0.0, 0.0), (0.0, 0.0078, 0.0))}
ARRAY = t2d.Radar.preset("ci4r", samples=64, prf_hz=3000.0, rx_offsets_m=[[0.0, 0.002, 0.0], [0.0, -0.002, 0.0]])


def piece(start_s: float = 1.0, stop_s: float = 1.2) -> t2d.Motion:
    return t2d.place(t2d.trim(walk(), start_s, stop_s), distance_m=3.0)


def still_ball() -> t2d.MovingMesh:
    shape = ball((3.0, 0.5, 1.0))
    return t2d.MovingMesh(shape.vertices[[0, 0]], shape.faces, np.array([0.0, 0.3]), material="pec", name="ball")


def total(recording: t2d.Recording) -> np.ndarray:
    return np.sum([np.asarray(each, np.complex128) for each in recording.parts.cubes.values()], axis=0)


CASES: dict[str, Any] = {
    "a body by segment": ("segment", piece, {}, 17),
    "two balls by target, an array": (
        "target", lambda: [ball((3.0, 0.0, 1.0)), ball((3.5, 0.8, 1.2), (1.0, 0.0, 0.0))], {"radar": ARRAY}, 2,
    ),
    "ellipsoids in a room by path": ("path", piece, {"method": "ellipsoid", "scene": small_room()}, 9),
    "a body in a room by segment": ("segment", piece, {"scene": small_room()}, 18),
    "a rotor by piece": ("segment", lambda: t2d.TableFan(position_m=(2.5, 0.0, 1.0), rpm=300).mesh(0, 1.0), {}, 4),
    "two bounces": ("bounce", lambda: [ball((3.0, 0.0, 1.0)), ball((3.1, 0.5, 1.0))], {"bounces": 2}, 2),
    "transmitters in turn": ("segment", piece, {"radar": RADAR.replace(prf_hz=12e3, multiplexing="tdm", **PAIR)}, 17),
    "transmitters by Doppler": ("segment", piece, {"radar": RADAR.replace(prf_hz=24e3, multiplexing="ddm", **PAIR)}, 17),
    "some of the paths": ("segment", piece, {"scene": small_room(), "only_paths": ["direct", "*left*"]}, 18),
    "what stands still": ("segment", lambda: [still_ball(), piece()], {}, 18),
}  # fmt: skip


@pytest.mark.usefixtures("coarse_bodies")
@pytest.mark.parametrize("case", slow_after(3, list(CASES)))
def test_parts_add_up_to_what_is_recorded_without_them(case: str) -> None:
    split, make, options, count = CASES[case]
    options = {"radar": RADAR, "collisions": "ignore", **options}
    plain, found = t2d.simulate(make(), **options), t2d.simulate(make(), split=split, **options)
    assert len(found.parts) >= count
    assert nmse_db(found.cube, plain.cube) < -120
    assert nmse_db(total(found), plain.cube) < -120
    assert not plain.parts


def test_noise_is_in_no_part() -> None:
    """The parts add up to what the targets return; the receiver's noise is in the recording alone."""
    options: dict[str, Any] = {"radar": RADAR, "method": "ellipsoid", "split": "segment"}
    noisy = t2d.simulate(piece(), noise="receiver", **options)
    plain = t2d.simulate(piece(), **options)
    assert nmse_db(noisy.cube, plain.cube) > -30
    np.testing.assert_array_equal(total(noisy), total(plain))


@pytest.fixture(scope="module")
def by_segment() -> t2d.Recording:
    return t2d.simulate(piece(0.8, 2.0), radar="table2", split="segment")


@pytest.fixture(scope="module")
def coarse() -> t2d.Recording:
    return t2d.simulate(piece(0.8, 2.0), radar="table2", split="segment", method="ellipsoid")


def test_the_part_that_makes_a_cell_moves_at_its_speed(by_segment: t2d.Recording) -> None:
    """40 strong cells, drawn at random: some joint of the segment said to dominate has the cell's speed then."""
    image = by_segment.spectrogram
    strong = np.argwhere((image.values > image.values.max() - 35) & (np.abs(image.velocity_mps.values) > 0.5)[:, None])
    cells = strong[np.random.default_rng(1).permutation(len(strong))[:40]]
    times_s = image.time_s.values[cells[:, 1]]
    ends = {
        "head": ("head", "head_top"), "neck": ("neck", "head"), "chest": ("spine2", "neck"), "abdomen": ("spine1", "spine2"),
        "pelvis": ("pelvis", "spine1"), "upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist"),
        "hand": ("wrist", "hand"),
        "thigh": ("hip", "knee"), "shank": ("knee", "ankle"), "foot": ("ankle", "toe"),
    }  # fmt: skip
    motion, agreed = piece(0.8, 2.0), 0
    frames_s = np.arange(len(motion.joints)) / motion.rate_hz
    range_m = np.linalg.norm(motion.joints - by_segment.radar.position_m, axis=-1)
    for velocity_mps, time_s in zip(image.velocity_mps.values[cells[:, 0]], times_s, strict=True):
        name = str(by_segment.strongest(velocity_mps, time_s).part.values[0])
        side = next((f"{each}_" for each in ("left", "right") if name.startswith(each)), "")
        joints = [side + end for end in ends[name.removeprefix(side)] if side + end in motion.names]
        near_s = np.clip(time_s + np.array([-0.02, -0.01, 0.01, 0.02]), 0, frames_s[-1])
        near_m = [np.interp(near_s, frames_s, range_m[:, motion.index(joint)]) for joint in joints]
        speeds = -np.diff(near_m) / np.diff(near_s)
        agreed += speeds.min() - 0.4 < velocity_mps < speeds.max() + 0.4
    assert agreed >= 38


def test_shares_of_a_cell(by_segment: t2d.Recording) -> None:
    found = by_segment.strongest(0.9, 0.6)
    assert found.level_db.values.tolist() == sorted(found.level_db.values, reverse=True)
    assert found.sizes["part"] == 17
    name = str(found.part.values[0])
    alone = by_segment.parts[name].spectrogram.sel(velocity_mps=0.9, time_s=0.6, method="nearest")
    assert float(alone) == pytest.approx(float(found.level_db[0]), abs=1e-4)
    whole = by_segment.spectrogram.sel(velocity_mps=0.9, time_s=0.6, method="nearest")
    assert found.attrs["level_db"] == pytest.approx(float(whole), abs=1e-4)
    assert float(found.relative_db[0]) == pytest.approx(float(alone - whole), abs=1e-4)


def test_limbs_are_sums_of_their_segments(by_segment: t2d.Recording) -> None:
    limbs = by_segment.parts.grouped()
    assert set(limbs) == {"head", "trunk", "arms", "thighs", "shanks", "feet"}
    feet = sum(np.asarray(by_segment.parts.cubes[f"{side}_foot"], np.complex128) for side in ("left", "right"))
    assert nmse_db(np.asarray(limbs.cubes["feet"]), feet) < -120
    assert limbs.spectrogram.dims == ("part", "velocity_mps", "time_s")
    for wrong, sentence in (
        ({"chest": ["head"]}, "groups has 'chest' for a name, which another part has"),
        ({"a": ["head"], "b": ["head", "neck"]}, "groups has the part head twice"),
        ({"a": ["nose"]}, "groups: unknown part 'nose'"),
        ({1: ["neck"]}, "groups must map names to lists of parts, got"),
        ({"a": "neck"}, "groups must map names to lists of parts, got"),
        (["head"], "groups must be a mapping of names to lists of parts, got"),
    ):
        with pytest.raises(InputError, match=sentence):
            by_segment.parts.grouped(wrong)  # type: ignore[arg-type]


def test_parts_are_kept_with_the_recording(coarse: t2d.Recording, tmp_path: Path) -> None:
    coarse.save(tmp_path / "walk.zarr")
    again = t2d.Recording.load(tmp_path / "walk.zarr")
    assert list(again.parts) == list(coarse.parts)
    for name, cube in coarse.parts.cubes.items():
        assert np.array_equal(np.asarray(again.parts.cubes[name]), np.asarray(cube))
    repeated = again.again()
    assert list(repeated.parts) == list(coarse.parts)
    assert np.array_equal(repeated.cube, coarse.cube)
    (tmp_path / "walk.zarr" / "parts" / "._0.npz").write_bytes(b"left by a file system")
    assert len(t2d.Recording.load(tmp_path / "walk.zarr").parts) == 17
    noisy = t2d.add_noise(again)
    assert list(noisy.parts) == list(again.parts)
    assert list(noisy.processed(mti="mean").parts) == list(again.parts)


def test_the_picture_names_the_limbs(by_segment: t2d.Recording) -> None:
    figure = by_segment.plot_parts("walk")
    (axes,) = figure.axes
    assert {each.get_text() for each in axes.get_legend().get_texts()} == {
        "head", "trunk", "arms", "thighs", "shanks", "feet",
    }  # fmt: skip
    assert axes.get_ylabel().startswith("Radial velocity [m/s]")
    many = by_segment.plot_parts(groups={}).axes[0].get_legend().get_texts()
    assert many[-1].get_text() == "10 others"


def test_the_hue_is_that_of_the_strongest_part() -> None:
    speed, time = np.linspace(-1, 1, 3), np.linspace(0, 1, 4)
    parts = np.full((2, 3, 4), -90.0)
    parts[0, 0], parts[1, 2] = 0.0, -6.0
    picture = plot_parts(speed, time, parts.max(axis=0), parts_db=parts, names=["slow", "fast"]).axes[0].images[0]
    shown = np.asarray(picture.get_array())
    assert np.argmax(shown[0, 0]) == 2  # sky blue is that of the stronger part
    assert np.argmax(shown[2, 0]) == 0  # orange
    assert not shown[1].any()


def test_limbs_have_the_same_colours_in_all_pictures() -> None:
    levels = np.zeros((3, 2, 2)) - np.array([30, 0, 10])[:, None, None]
    hues = part_hues(["person: feet", "fan: piece 1", "person: head"], levels)
    assert list(hues) == ["person: head", "person: feet", "fan: piece 1"]
    assert [hues["person: head"], hues["person: feet"]] == [LIMBS["head"], LIMBS["feet"]]
    assert hues["fan: piece 1"] not in (LIMBS["head"], LIMBS["feet"])
    two = part_hues(["person 1: feet", "person 2: feet", "person 1: head"], levels)
    assert len({*two.values()}) == 3  # of two persons' feet neither has the colour of feet


def test_bodies_above_the_picture_have_its_limbs_colours(by_segment: t2d.Recording, coarse: t2d.Recording) -> None:
    figure = by_segment.plot_parts("walk", poses=3)
    strip, axes = figure.axes
    assert strip.get_title() == "walk"
    assert strip.get_xlim() == axes.get_xlim()
    assert [float(body.get_offsets()[0, 0]) for body in strip.collections] == pytest.approx([0.2, 0.6, 1.0])
    assert [float(line.get_xdata()[0]) for line in axes.lines] == pytest.approx([0.2, 0.6, 1.0])
    for body in strip.collections:
        colours, corners = body.get_facecolors()[:, :3], np.stack([each.vertices[:3] for each in body.get_paths()])
        hue = colours / colours.max(axis=1, keepdims=True)
        feet, head = (
            np.abs(hue - np.divide(rgb(LIMBS[each]), max(rgb(LIMBS[each])))).max(axis=1) < 1e-6
            for each in ("feet", "head")
        )
        heights_m = corners[..., 1].mean(axis=1)
        assert heights_m[feet].max() < 0.6 < 1.3 < heights_m[head].min()
        assert corners[..., 1].min() == pytest.approx(0, abs=0.15)  # on the ground
    model = by_segment._set_up(None)[0]
    poses = poses_of(model, "segment", by_segment.parts.members(), 2)
    heels_m, toes_m = np.percentile(poses.corners_m[0, np.array(poses.parts) == "feet", :, 0], [1, 99])
    assert toes_m - heels_m > 0.5  # the walk is seen from the side, one step long
    (few,) = coarse.plot_parts(poses=1).axes[0].collections
    colours = few.get_facecolors()[:, :3]
    assert len(np.unique(np.round(colours / colours.max(axis=1)[:, None], 3), axis=0)) == 6


def test_stacked_parts_have_one_scale_and_common_axes(by_segment: t2d.Recording) -> None:
    figure = by_segment.plot_parts("walk", stacked=True, dynamic_range_db=40)
    *limbs, bar = figure.axes
    assert [axes.get_title() for axes in limbs] == list(by_segment.parts.grouped())
    top_db = float(by_segment.parts.grouped().spectrogram.max())
    assert {axes.collections[0].get_clim() for axes in limbs} == {(top_db - 40, top_db)}
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in limbs}) == 1
    assert bar.get_ylabel() == "Power [dB re 1 W]"
    assert figure.get_suptitle() == "walk"


def test_levels_of_parts_and_how_much_of_them_is_strongest(by_segment: t2d.Recording) -> None:
    found = by_segment.parts.levels()
    power = 10 ** (by_segment.parts.spectrogram.values / 10)
    totals = power.sum(axis=1).mean(axis=1)
    assert found.part.values.tolist() == list(by_segment.parts)
    assert found.level_db.values == pytest.approx(10 * np.log10(totals))
    highest = power.argmax(axis=0) == np.arange(len(power))[:, None, None]
    assert found.strongest_fraction.values == pytest.approx((power * highest).sum(axis=(1, 2)) / power.sum(axis=(1, 2)))
    assert found.level_db.attrs == {"units": "dB re 1 W"}
    late = by_segment.processed().parts.levels(0.5, 0.8)
    inside = (by_segment.spectrogram.time_s.values >= 0.5) & (by_segment.spectrogram.time_s.values <= 0.8)
    assert late.level_db.values == pytest.approx(10 * np.log10(power[..., inside].sum(axis=1).mean(axis=1)))
    with pytest.raises(InputError, match=r"the spectrogram has no column in 5\.\.6 s, but in 0\.01"):
        by_segment.parts.levels(5, 6)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"stacked": True, "poses": 2}, "a stacked picture has no bodies; leave out stacked, or poses"),
        ({"poses": 25}, r"poses must (be an integer in|lie in) 0\.\.24"),
        ({"ax": True, "poses": 2}, "ax holds the coloured spectrogram alone; leave it out, or stacked and poses"),
    ],
)
def test_pictures_of_parts_that_are_refused(by_segment: t2d.Recording, options: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        by_segment.plot_parts(**options)


def test_bodies_have_no_colours_of_paths() -> None:
    by_path = t2d.simulate(piece(), radar=RADAR, method="ellipsoid", split="path")
    with pytest.raises(
        InputError,
        match="bodies have the colours of their parts; simulate with split='segment' or 'target', not 'path'",
    ):
        by_path.plot_parts(poses=2)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda found: found.strongest(99.0, 0.5), r"velocity_mps must lie on the spectrogram, -?\d"),
        (lambda found: found.strongest(0.5, -1.0), "time_s must lie on the spectrogram"),
        (lambda found: found.processed().parts.grouped({}).strongest("fast", 0.5), "velocity_mps must be a number"),
        (lambda _: t2d.simulate(ball((3.0, 0.0, 1.0)), split="limb"), "split must be one of segment, path, target, bounce, got"),
        (lambda found: found.parts["head"].strongest(0.0, 0.0), "the recording has no parts; simulate with split="),
    ],
)  # fmt: skip
def test_what_cannot_be_explained_is_told(by_segment: t2d.Recording, wrong: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        wrong(by_segment)


def test_the_command_line_splits(tmp_path: Path) -> None:
    out = tmp_path / "walk.zarr"
    options = ["--start-s", "1", "--stop-s", "1.2", "--method", "ellipsoid", "--split", "segment"]
    main(["simulate", "walk", *options, "-o", str(out)])
    assert len(t2d.Recording.load(out).parts) == 17
    picture = tmp_path / "by_limb.png"
    assert not main(["plot", str(out), "--map", "parts", "--stacked", "--cmap", "magma", "-o", str(picture)])
    check_picture(picture)
    for more in (["--poses", "2"], ["--map", "parts", "--cmap", "magma"], ["--map", "parts", "--time-s", "1"]):
        assert main(["plot", str(out), *more, "-o", str(tmp_path / "c.png")])


def test_what_an_ellipsoid_gets_wrong_is_told_limb_by_limb(by_segment: t2d.Recording, coarse: t2d.Recording) -> None:
    found = t2d.compare(by_segment, coarse)
    assert set(found.parts_db) == set(by_segment.parts)
    powers = [
        np.mean(np.sum(10 ** (each.parts["head"].spectrogram.values / 10), axis=0)) for each in (by_segment, coarse)
    ]
    assert found.parts_db["head"] == pytest.approx(10 * np.log10(powers[1] / powers[0]))
    table = str(found).partition("level by part")[2].splitlines()[1:]
    assert len(table) == 17
    differences = [abs(float(line.split()[-1])) for line in table]
    assert differences == sorted(differences, reverse=True)  # the one that changed most comes first
    assert not t2d.compare(by_segment, by_segment.parts["head"]).parts_db


def test_a_part_is_no_recording_of_its_own(by_segment: t2d.Recording) -> None:
    head = by_segment.parts["head"]
    for ask in (lambda: head.paths, lambda: head.truth, head.again, lambda: t2d.add_noise(head)):
        with pytest.raises(InputError, match="this is the part head of a recording; take the whole recording"):
            ask()
    assert "none: a part of a recording" in head._repr_html_()


def test_limbs_of_two_persons_and_pieces_of_loose_triangles() -> None:
    two = [piece(), t2d.place(piece(), distance_m=4.0, angle_deg=10)]
    found = t2d.simulate(two, radar=RADAR, method="ellipsoid", split="segment").parts.grouped()
    assert len(found) == 12
    assert {"person 1: feet", "person 2: trunk"} <= set(found)
    corners = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 1, 1], [0, 0, 1]], float)
    vertices = np.concatenate([corners, corners + [0, 3, 0]]) + [4.0, -2.0, 0.5]
    faces, times_s = np.arange(12).reshape(4, 3), np.linspace(0, 0.2, 5)
    with pytest.warns(t2d.T2DWarning):  # not watertight
        loose = t2d.MovingMesh(np.tile(vertices, (5, 1, 1)), faces, times_s, material="pec")
    parts = t2d.simulate(loose, radar=RADAR, split="segment").parts
    assert [name.rpartition(" ")[2] for name in parts] == ["1", "2"]


def test_filters_that_leave_all_paths_on_are_none() -> None:
    assert (
        t2d.simulate(ball((3.0, 0.0, 1.0)), radar=RADAR, only_paths=["direct"], tolerance_db=-10).error_db is not None
    )


def test_parts_of_a_person_beside_a_mover_and_of_other_splits_are_compared_or_told() -> None:
    alone = t2d.simulate(piece(), radar=RADAR, method="ellipsoid", split="segment")
    fan = t2d.TableFan(position_m=(3.0, 1.0, 1.0), rpm=300)
    beside = t2d.simulate([piece(), fan], radar=RADAR, method="ellipsoid", split="segment")
    found = t2d.compare(alone, beside).parts_db
    assert set(found) == set(alone.parts)
    assert max(map(abs, found.values())) < 0.1  # ellipsoids do not hide one another
    by_target = t2d.simulate(piece(), radar=RADAR, method="ellipsoid", split="target")
    with pytest.warns(t2d.T2DWarning, match="the recordings have no part of one name"):
        assert not t2d.compare(alone, by_target).parts_db


def test_a_path_that_is_off_is_no_part() -> None:
    options: dict[str, Any] = {
        "radar": RADAR, "scene": small_room(), "clutter": "none", "method": "ellipsoid", "split": "path",
    }  # fmt: skip
    assert list(t2d.simulate(piece(), only_paths=["direct"], **options).parts) == ["direct"]


def test_echoes_of_no_target_are_told_from_those_of_several_bounces() -> None:
    """Labels of other packages may name no target; two and three bounces are one part of the segments."""
    labels = EchoLabels.of(4, bounces=np.arange(4))
    nobody: Any = SimpleNamespace(modelled=[])
    names = ["static scene", "no target", "several bounces", "several bounces"]
    assert PartNames("segment", nobody).of(labels).tolist() == names
    assert PartNames("bounce", nobody).of(labels).tolist() == ["static scene", "1 bounce", "2 bounces", "3 bounces"]


@pytest.mark.slow
def test_parts_of_one_name_are_told_apart() -> None:
    """A target may be called like the static scene, a segment or another target."""
    shape = ball((0.0, 0.0, 1.0))
    balls = [
        t2d.MovingMesh(shape.vertices + [3.0 + number, 0.0, 0.0], shape.faces, shape.times_s, material="pec", name=name)
        for number, name in enumerate(("static scene", "a", "a", "a 1"))
    ]
    first = pytest.warns(t2d.T2DWarning, match="static scene is called static scene 2, as another part has that name")
    with first, pytest.warns(t2d.T2DWarning, match="a 1 is called a 1 2"):
        found = t2d.simulate(balls, radar=RADAR, scene=small_room(), collisions="ignore", split="target")
    assert set(found.parts) == {"static scene", "static scene 2", "a 1", "a 2", "a 1 2"}
    fans = [t2d.TableFan(position_m=(2.5, y, 1.0), rpm=300) for y in (-0.5, 0.5)]
    parts = t2d.simulate([piece(1.0, 1.1), *fans], radar=RADAR, method="ellipsoid", split="segment").parts
    assert [name for name in parts if "piece 1" in name] == [
        f"{fans[0].mesh(0, 1).name} {number}: piece 1" for number in (1, 2)
    ]


def test_all_parts_lie_in_one_file(tmp_path: Path) -> None:
    """The system hands out few files at a time, 256 on some; a part that is sent to another process goes without the others."""

    def opened() -> int:
        return len(list(Path("/proc/self/fd").iterdir()))

    if not Path("/proc/self/fd").exists():
        pytest.skip("only Linux tells which files are open")
    before = opened()
    options: dict[str, Any] = {"radar": RADAR, "scene": small_room(), "method": "ellipsoid", "split": "path"}
    found = t2d.simulate(piece(), **options)
    assert len(found.parts) > 8
    assert opened() - before <= 2
    found.save(tmp_path / "room.zarr")
    t2d.Recording.load(tmp_path / "room.zarr")  # what zarr itself keeps open is open now
    before = opened()
    loaded = t2d.Recording.load(tmp_path / "room.zarr")
    assert opened() - before <= 2
    one = next(iter(loaded.parts.cubes.values()))
    content = pickle.dumps(one)
    assert len(content) < 0.5 * len(pickle.dumps(list(loaded.parts.cubes.values())))
    np.testing.assert_array_equal(np.asarray(pickle.loads(content)), np.asarray(one))


def test_memory_of_parts_is_refused_beforehand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.accuracy.cost.PART_BYTES", 1e9)
    target = [ball((3.0, 0.0, 1.0)), ball((4.0, 0.0, 1.0)), ball((5.0, 0.0, 1.0))]
    t2d.simulate(target, radar=RADAR)
    monkeypatch.setattr(sys.modules["t2d_rt.simulate"], "Synthesis", lambda *_, **__: pytest.fail("it began"))
    with pytest.raises(InputError, match=r"takes about [\d.]+ GB of memory, more than the limit of 2 GB"):
        t2d.simulate(target, radar=RADAR, split="target")
