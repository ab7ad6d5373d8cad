"""Sweeps: what varies, each recording as its single run makes it, going on after a stop, refusals, table, panels, the command."""

from __future__ import annotations

import csv
import itertools
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
import t2d_rt.cli.sweeps
import t2d_rt.core.plugins
from builders import WALK
from command_line import Command
from t2d_rt import sweeps
from t2d_rt.cli.sweeps import alternatives, entries
from t2d_rt.core.errors import InputError
from t2d_rt.recording.compare import field_difference_db

RADAR = t2d.Radar.preset("ci4r", carrier_hz=24e9, prf_hz=2000, samples=32)
FAN = {"kind": "fan", "position_m": (3, -1, 1), "rpm": 120}
WALKER = {"kind": "file", "file": str(WALK), "start_s": 1, "stop_s": 1.2}
FIELDS: dict[str, Any] = {"targets": [WALKER, FAN], "radar": RADAR, "method": "ellipsoid"}
NEAR = {**FAN, "position_m": (1, -0.3, 1), "heading_deg": 135, "material": "pec"}
VARY = {"targets.1.rpm": [120, 600], "seed": [0, 1]}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> sweeps.Sweep:
    return t2d.sweep(
        FIELDS, VARY, tmp_path_factory.mktemp("sweep") / "fans", processing={"mti": "mean", "n_window": 64}
    )


@pytest.fixture
def folder(made: sweeps.Sweep, tmp_path: Path) -> Path:
    """A copy of the folder of that sweep."""
    return Path(shutil.copytree(made.folder, tmp_path / "fans"))


def again(folder: Path, vary: Any = VARY, fields: Any = FIELDS, **options: Any) -> sweeps.Sweep:
    return t2d.sweep(fields, vary, folder, **{"processing": {"mti": "mean", "n_window": 64}, **options})


def test_every_recording_is_that_of_its_single_run(made: sweeps.Sweep) -> None:
    assert [point.label for point in made.points] == [
        "rpm 120, seed 0", "rpm 120, seed 1", "rpm 600, seed 0", "rpm 600, seed 1",
    ]  # fmt: skip
    for number, rpm, seed in ((1, 120, 1), (2, 600, 0)):
        single = t2d.run(t2d.Experiment(**{**FIELDS, "targets": [WALKER, {**FAN, "rpm": rpm}], "seed": seed}))
        recording = made.recording(number)
        np.testing.assert_array_equal(recording.cube, single.cube)
        image = single.processed(mti="mean", n_window=64).spectrogram
        np.testing.assert_array_equal(recording.spectrogram, image)
        np.testing.assert_array_equal(made.spectrograms[number], image)


def test_the_table_tells_differences_from_the_first(made: sweeps.Sweep) -> None:
    rows = list(csv.DictReader((made.folder / "table.csv").read_text().splitlines()))
    assert [row["targets.1.rpm"] for row in rows] == ["rpm 120", "rpm 120", "rpm 600", "rpm 600"]
    assert rows[0]["recording"] == "000_rpm_120_seed_0.zarr"
    first, other = made.recording(0), made.recording(2)
    apart, moving = (cube - cube.mean(axis=0) for cube in (other.cube - first.cube, first.cube))
    expected = 10 * math.log10(np.sum(np.abs(apart) ** 2) / np.sum(np.abs(moving) ** 2))
    assert float(rows[2]["field_difference_db"]) == pytest.approx(expected, abs=1e-3)
    assert (rows[0]["field_difference_db"], rows[0]["level_difference_db"]) == ("-inf", "0")
    assert float(rows[2]["mean_difference_db"]) == pytest.approx(t2d.compare(first, other).mean_difference_db, rel=1e-5)
    level = 10 * math.log10(np.mean(10 ** (other.spectrogram.values / 10)))
    assert float(rows[2]["level_db"]) == pytest.approx(level, abs=1e-3)
    lines = str(made).splitlines()
    assert len(lines) == 6
    assert len({len(line) for line in lines[1:]}) == 1
    assert lines[4].split()[:4] == ["rpm", "600,", "seed", "0"]


def test_the_difference_of_fields_leaves_out_what_is_static() -> None:
    rng = np.random.default_rng(4)
    parts = rng.normal(size=(2, 500, 1, RADAR.samples)) + 1j * rng.normal(size=(2, 500, 1, RADAR.samples))
    first = t2d.Recording((100 + parts[0]).astype(np.complex64), RADAR)
    second = t2d.Recording((200 + parts[0] + 0.1 * parts[1]).astype(np.complex64), RADAR)
    assert field_difference_db(first, second) == pytest.approx(-20, abs=0.3)
    assert field_difference_db(first, first) == -math.inf
    assert math.isnan(field_difference_db(first, t2d.Recording(first.cube[:400], RADAR)))
    static = t2d.Recording(np.full_like(first.cube, 0.1 + 0.7j), RADAR)
    assert field_difference_db(static, first) == math.inf
    assert field_difference_db(static, t2d.Recording(3 * static.cube, RADAR)) == -math.inf


def test_panels_have_one_scale_and_one_colour_bar(made: sweeps.Sweep) -> None:
    figure = made.plot("fans", dynamic_range_db=40)
    *panels, bar = figure.axes
    assert [axes.get_title() for axes in panels] == [point.label for point in made.points]
    top = max(float(image.max()) for image in made.spectrograms)
    assert {axes.collections[0].get_clim() for axes in panels} == {(top - 40, top)}
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in panels}) == 1
    assert (figure.get_supxlabel(), bar.get_ylabel()) == ("Time [s]", "Power [dB re 1 W]")
    assert figure.get_size_inches()[0] == 7
    grid = panels[0].get_subplotspec().get_gridspec()
    assert (grid.nrows, grid.ncols) == (2, 2)  # a row for each speed of the fan


def test_a_sweep_that_was_stopped_goes_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = folder / "000_rpm_120_seed_0.zarr" / "zarr.json"
    before, lost = kept.stat().st_mtime_ns, folder / "003_rpm_600_seed_1.zarr"
    shutil.rmtree(lost)
    (folder / "table.csv").unlink()

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(sweeps, "_simulated", stop)
        with pytest.raises(KeyboardInterrupt) as stopped:
            again(folder)
    assert stopped.value.__notes__ == [f"{folder} holds 3 of 4 recordings; the same command goes on"]
    seen: list[float] = []
    found = again(folder, progress=seen.append)
    assert kept.stat().st_mtime_ns == before
    assert seen[-1] == 1
    assert min(seen) >= 0.75  # of all four
    assert len(found.measures) == 4
    assert (folder / "table.csv").read_text() == found.table()


def test_folders_of_others_are_refused(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        InputError, match=r"000_rpm_120_seed_0.zarr was made of another experiment, file or setting; choose"
    ):
        again(folder, fields={**FIELDS, "targets": [{**WALKER, "distance_m": 3}, FAN]})
    with pytest.raises(InputError, match="was made of another experiment, file or setting"):
        again(folder, processing={"mti": "mean"})
    with pytest.raises(InputError, match="was made of another experiment, file or setting"):
        again(folder, accuracy={"surface_rate_hz": 90})
    with pytest.raises(InputError, match="unknown spectrogram option 'foo'"):
        again(tmp_path / "none", processing={"foo": 1})
    assert not (tmp_path / "none").exists()
    with pytest.raises(InputError, match=r"holds 001_rpm_120_seed_1.zarr, which is not of this sweep"):
        again(folder, {"targets.1.rpm": [120, 600], "seed": [0, 2]})
    edited = tmp_path / "edited.bvh"
    edited.write_text(WALK.read_text().replace("\t0.", "\t1.", 1))
    with pytest.raises(InputError, match="was made of another experiment, file or setting"):
        again(folder, fields={**FIELDS, "targets": [{**WALKER, "file": str(edited)}, FAN]})
    with monkeypatch.context() as patch:
        patch.setattr(sweeps, "versions", lambda: {**t2d_rt.core.plugins.versions(), "t2d-rt": "9.9"})
        with pytest.raises(InputError, match=r"was made by other versions \(t2d-rt .*\); choose another folder"):
            again(folder)
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds notes.txt, which is not of this sweep; choose another folder"):
        again(folder)
    with pytest.raises(InputError, match="is a file and a sweep is a folder"):
        again(edited)
    with pytest.raises(InputError, match=r"folder .* does not exist; create it first"):
        again(tmp_path / "no" / "fans")


def test_whole_targets_vary_and_may_be_left_out(tmp_path: Path) -> None:
    others = [None, t2d.TableFan(position_m=(3, -1, 1), rpm=60), "fan:3,-1,1,rpm=90", "door:3,-1,0"]
    found = t2d.sweep(FIELDS, {"targets.1": others}, tmp_path / "beside")
    assert [point.label for point in found.points] == ["without", "fan rpm 60", "fan rpm 90", "door"]
    assert [len(point.experiment.targets) for point in found.points] == [1, 2, 2, 2]
    alone = t2d.run(t2d.Experiment(**{**FIELDS, "targets": [WALKER]}))
    np.testing.assert_array_equal(found.recording(0).cube, alone.cube)


def test_a_recordings_experiment_varies_and_other_axes_have_no_differences(made: sweeps.Sweep, tmp_path: Path) -> None:
    found = t2d.sweep(
        made.recording(0), {"radar.prf_hz": [2000, 3000], "accuracy.surface_rate_hz": [100]}, tmp_path / "rates",
    )  # fmt: skip
    assert [point.label for point in found.points] == [
        "prf_hz 2000, surface_rate_hz 100",
        "prf_hz 3000, surface_rate_hz 100",
    ]
    assert found.recording(1).radar.prf_hz == 3000
    assert found.recording(1).accuracy.surface_rate_hz == 100  # type: ignore[union-attr]
    assert math.isnan(found.measures[1]["field_difference_db"])
    assert found.table().splitlines()[2].endswith(",,,")
    assert found.measures[0]["level_db"] < -50
    found.plot().draw_without_rendering()


def test_a_varied_tolerance_chooses_anew(made: sweeps.Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fields of the recording's accuracy hold for other fields, and would leave a tolerance nothing to choose."""
    seen: list[sweeps.Point] = []

    def stop(point: sweeps.Point, *_: Any) -> None:
        seen.append(point)
        raise KeyboardInterrupt

    monkeypatch.setattr(sweeps, "_simulated", stop)
    for number, options in enumerate(
        ({"vary": {"tolerance_db": [-10, -30]}}, {"vary": {"tolerance_db": [-10]}, "accuracy": {"surface_rate_hz": 90}},
         {"vary": {"seed": [0]}, "tolerance_db": -10}, {"vary": {"seed": [0]}})
    ):  # fmt: skip
        with pytest.raises(KeyboardInterrupt):
            t2d.sweep(made.recording(0), folder=tmp_path / str(number), **options)  # type: ignore[arg-type]
    recorded = made.recording(0).accuracy
    expected = [{}, {"surface_rate_hz": 90}, {}, recorded.model_dump(mode="json")]
    assert [point.accuracy for point in seen] == expected
    assert [point.tolerance_db for point in seen] == [-10, -10, -10, None]


def test_values_that_are_close_have_names_of_their_own(made: sweeps.Sweep, tmp_path: Path) -> None:
    found = t2d.sweep(FIELDS, {"targets.1.rpm": [120, 120.000004]}, tmp_path / "close")
    assert [point.label for point in found.points] == ["rpm 120", "rpm 120.000004"]
    with pytest.raises(
        InputError, match=r"the values of targets.1.rpm must differ, got rpm 120, rpm 120; give each once"
    ):
        t2d.sweep(FIELDS, {"targets.1.rpm": [120, 120.0]}, tmp_path / "same")


def test_differences_are_told_where_the_axes_are_the_same(tmp_path: Path) -> None:
    """A radar of more power has the same axes; one of half the slope has other ranges."""
    slope = RADAR.slope_hz_per_s
    vary = {"radar.tx_power_dbm": [10.0, 13.0], "radar.slope_hz_per_s": [slope, slope / 2]}
    found = t2d.sweep({**FIELDS, "targets": [WALKER]}, vary, tmp_path / "axes")
    assert found.measures[2]["level_difference_db"] == pytest.approx(3, abs=0.01)
    assert found.measures[2]["field_difference_db"] == pytest.approx(20 * math.log10(10 ** (3 / 20) - 1), abs=0.01)
    assert [math.isnan(each["field_difference_db"]) for each in found.measures] == [False, True, False, True]


def test_other_spectrograms_are_simulated_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []
    simulated = sweeps._simulated
    monkeypatch.setattr(
        sweeps, "_simulated", lambda *given: seeds.append(given[0].experiment.seed) or simulated(*given)
    )
    vary = {"seed": [0, 1], "signal.n_window": [64, 128], "signal.overlap": [32, 48]}
    found = again(tmp_path / "windows", vary, {**FIELDS, "targets": [WALKER]}, processing={"mti": "mean"})
    assert seeds == [0, 1]
    singles = [t2d.run(t2d.Experiment(**{**FIELDS, "targets": [WALKER], "seed": seed})) for seed in seeds]
    for number, (seed, n_window, overlap) in enumerate(itertools.product(*vary.values())):
        image = singles[seed].processed(mti="mean", n_window=n_window, overlap=overlap).spectrogram
        np.testing.assert_array_equal(found.recording(number).spectrogram, image)
        np.testing.assert_array_equal(found.spectrograms[number], image)
    assert found.points[3].label == "seed 0, n_window 128, overlap 48"
    whole = {"signal": [{"n_window": 64}, {"overlap": 32}]}
    found = again(tmp_path / "whole", whole, {**FIELDS, "targets": [WALKER]}, processing={})
    assert found.recording(1).processing == {"overlap": 32}


@pytest.fixture(scope="module")
def by_segment(tmp_path_factory: pytest.TempPathFactory) -> sweeps.Sweep:
    place = tmp_path_factory.mktemp("sweep") / "limbs"
    return t2d.sweep(FIELDS, {"targets.1": [None, NEAR]}, place, split="segment")


def test_a_sweep_tells_which_limb_is_hidden(by_segment: sweeps.Sweep) -> None:
    """The fan's parts are new, the person's are compared with those of the person alone; one recording is that of a single run."""
    parts = by_segment.parts
    single = t2d.run(t2d.Experiment(**{**FIELDS, "targets": [WALKER, NEAR]}), split="segment").parts.levels()
    beside = parts.isel(recording=1)
    for name, whole in (("left_foot", "person: left_foot"), ("fan: piece 1", "fan: piece 1")):
        for figure in ("level_db", "strongest_fraction"):
            assert float(beside[figure].sel(part=name)) == pytest.approx(
                float(single[figure].sel(part=whole)), abs=1e-4
            )
    limbs = [name for name in parts.part.values if not name.startswith("fan")]
    assert len(limbs) == 17
    assert np.isnan(parts.level_db[0]).sum() == parts.sizes["part"] - 17  # no fan
    levels = parts.level_db.sel(part=limbs).values
    assert parts.level_difference_db.sel(part=limbs).values == pytest.approx(levels - levels[0])
    assert np.isnan(beside.level_difference_db.sel(part="fan: piece 1"))
    hidden = parts.strongest_fraction.sel(part=limbs).values
    assert (hidden[1] <= hidden[0] + 1e-6).all()  # what the fan adds is stronger in some cells
    assert (hidden[1] < hidden[0] - 0.1).any()


def test_the_table_and_the_picture_of_parts(by_segment: sweeps.Sweep) -> None:
    parts = by_segment.parts
    rows = list(csv.DictReader((by_segment.folder / "parts.csv").read_text().splitlines()))
    assert len(rows) == 17 + parts.sizes["part"]
    row = next(row for row in rows if row["part"] == "head" and row["targets.1"] == "fan")
    own = parts.isel(recording=1).sel(part="head")
    assert float(row["level_db"]) == pytest.approx(float(own.level_db), abs=1e-3)
    assert float(row["strongest_fraction"]) == pytest.approx(float(own.strongest_fraction), abs=1e-4)
    assert [row["level_difference_db"] for row in rows if row["part"] == "fan: piece 1"] == [""]
    told = str(by_segment).splitlines()
    assert told[-1] == "and 1 more, weaker, in parts.csv"
    head = next(line.split() for line in told if line.startswith("head "))
    assert head[1] == f"{float(parts.level_db.sel(part='head')[0]):.1f}"
    assert head[3] == f"{float(own.level_difference_db):+.1f}"
    left, right = by_segment.plot_parts("hidden").axes
    names = [each.get_text() for each in left.get_yticklabels()]
    assert len(names) == sweeps.MOST_PARTS
    assert [each.get_text() for each in right.get_xticklabels()] == ["without", "fan"]
    fractions = np.asarray(right.images[0].get_array())
    assert fractions[names.index("head"), 1] == pytest.approx(float(own.strongest_fraction))
    assert left.texts[2 * names.index("head")].get_text() == head[1]


def test_a_sweep_by_part_goes_on_and_is_another_one(by_segment: sweeps.Sweep, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(by_segment.folder, tmp_path / "limbs"))
    shutil.rmtree(folder / by_segment.points[1].file)
    (folder / "parts.csv").unlink()
    (folder / "parts.png").write_bytes(b"")
    found = t2d.sweep(FIELDS, {"targets.1": [None, NEAR]}, folder, split="segment")
    assert by_segment.parts is not None
    assert found.parts.equals(by_segment.parts)
    assert list(found.recording(0).parts) == list(by_segment.recording(0).parts)
    for split in (None, "target"):
        with pytest.raises(InputError, match="was made of another experiment, file or setting"):
            t2d.sweep(FIELDS, {"targets.1": [None, NEAR]}, folder, split=split)  # type: ignore[arg-type]


def test_parts_of_other_axes_and_none(made: sweeps.Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    simulated = sweeps._simulated
    monkeypatch.setattr(sweeps, "_simulated", lambda *given: calls.append(1) or simulated(*given))
    found = again(tmp_path / "windows", {"signal.n_window": [64, 128]}, {**FIELDS, "targets": [WALKER]}, split="target")
    assert len(calls) == 1
    assert found.parts.part.values.tolist() == ["person"]
    assert np.isfinite(found.parts.level_db).all()
    assert np.isnan(found.parts.level_difference_db[1]).all()
    assert found.parts.strongest_fraction.values == pytest.approx(np.ones((2, 1)))
    found.plot_parts().draw_without_rendering()
    for ask in (made.plot_parts, made.parts_table):
        with pytest.raises(InputError, match="the recordings have no parts; sweep with split='segment', 'path'"):
            ask()
    with pytest.raises(InputError, match="split must be one of segment, path, target, bounce"):
        t2d.sweep(FIELDS, {"seed": [0]}, tmp_path / "none", split="limb")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("vary", "sentence"),
    [
        ({}, "vary must be values by the names of fields"),
        ({"seed": 3}, "the values of seed must be a list of at least one, got 3"),
        ({"seed": []}, "the values of seed must be a list of at least one"),
        ({"seed": [1, 1]}, "the values of seed must differ, got seed 1, seed 1; give each once"),
        ({"sed": [1]}, "there is no field sed to vary; choose from targets, radar, scene"),
        ({"targets.7.rpm": [1]}, "there is no number 7 to vary among 2; they are counted from 0"),
        ({"targets.1.rpn": [1, 2]}, "rpn"),
        ({"radar.prf.hz": [1, 2]}, "there is no field prf to vary; choose from carrier_hz"),
        ({"scene.file.x": ["a"]}, "there is no field scene.file.x to vary, as scene is 'free_space'"),
        ({"seed": range(50), "targets.1.rpm": range(50)}, "a sweep takes at most 1000 recordings, got 2500"),
        ({"accuracy.sagitta": [1, 2]}, "unknown accuracy key 'sagitta'"),
        ({"method": ["mash"]}, "method"),
        ({"signal.n_windw": [64]}, "unknown spectrogram option 'n_windw'"),
        ({"signal.mti": ["mean", "median"]}, "MTI method must be"),
        ({"signal.n_window": [64, -1]}, "n_window must be an integer"),
    ],
)
def test_what_cannot_vary(vary: Any, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=sentence):
        t2d.sweep(FIELDS, vary, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_measured_recordings_are_refused(tmp_path: Path) -> None:
    measured = t2d.Recording(np.ones((64, 1, RADAR.samples), np.complex64), RADAR)
    with pytest.raises(InputError, match="the recording was measured and has no experiment"):
        t2d.sweep(measured, {"seed": [0]}, tmp_path / "none")


# --- the command ----------------------------------------------------------------------------------------------------


def test_ranges_and_alternatives() -> None:
    assert alternatives("0.1:0.5:0.2") == ["0.1", "0.3", "0.5"]
    assert alternatives("3:0:-1.5") == ["3", "1.5", "0"]
    assert alternatives("a:b:c|1:2:1") == ["a:b:c", "1", "2"]
    assert entries("none|fan:2:4:2,-1,1,rpm=60|90|pet:3,0,0,animal=cat|dog") == [
        "none",
        "fan:2,-1,1,rpm=60", "fan:2,-1,1,rpm=90", "fan:4,-1,1,rpm=60", "fan:4,-1,1,rpm=90",
        "pet:3,0,0,animal=cat", "pet:3,0,0,animal=dog",
    ]  # fmt: skip
    for text, sentence in (
        ("0:9:0", "never arrives"),
        ("0:9:-1", "never arrives"),
        ("0:9:1e-6", "more than 1000"),
        ("300:1000:300", "write 300:900:300"),
    ):
        with pytest.raises(InputError, match=sentence):
            alternatives(text)


QUICK = (
    "--method", "ellipsoid", "--radar", "ci4r", "--radar.prf-hz", "2000", "--radar.samples", "32", "--start-s", "1",
    "--stop-s", "1.2",
)  # fmt: skip


@pytest.mark.slow
def test_the_command_makes_what_simulate_makes(run: Command) -> None:
    added = "none|fan:3,-1,1,rpm=120|door:3,-1,0"
    options = ("--add", added, "--signal.n-window", "64", "--split", "target")
    code, out, err = run("sweep", "walk.bvh", *QUICK, *options, "-o", "beside")
    assert code == 0, err
    files = "table.csv, parts.csv, panels.png, panels.pdf, parts.png and parts.pdf"
    assert out.splitlines()[-1] == f"wrote {files} beside 3 recordings in beside"
    assert [line.split()[0] for line in out.splitlines()[2:5]] == ["without", "fan", "door"]
    names = sorted(path.name for path in Path("beside").iterdir())
    files = ["panels.pdf", "panels.png", "parts.csv", "parts.pdf", "parts.png", "table.csv"]
    assert names == ["000_without.zarr", "001_fan.zarr", "002_door.zarr", *files]
    alone = ("--add", "fan:3,-1,1,rpm=120", "--signal.n-window", "64", "-o", "one.zarr")
    assert run("simulate", "walk.bvh", *QUICK, *alone).code == 0
    one, other = t2d.Recording.load("one.zarr"), t2d.Recording.load("beside/001_fan.zarr")
    np.testing.assert_array_equal(one.cube, other.cube)
    np.testing.assert_array_equal(one.spectrogram, other.spectrogram)
    assert one.experiment == other.experiment


def test_an_experiment_in_yaml_and_a_recording_vary_by_field(run: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    # Pictures take seconds, and are drawn by the test before.
    monkeypatch.setattr(t2d_rt.cli.sweeps, "write_picture", lambda *_, **__: None)
    Path("room.yaml").write_text(
        "targets: [{kind: file, file: walk.bvh, start_s: 1, stop_s: 1.2}]\nradar: ci4r\nmethod: ellipsoid\n"
        "accuracy: {surface_rate_hz: 100}\n"
    )
    assert run("sweep", "room.yaml", "--vary", "seed=0:2:2", "-o", "seeds").code == 0
    found = t2d.Recording.load("seeds/001_seed_2.zarr")
    assert found.settings["seed"] == 2
    assert found.accuracy.surface_rate_hz == 100
    assert run("sweep", "seeds/000_seed_0.zarr", "--vary", "phase_from=centre|specular", "-o", "phases").code == 0
    np.testing.assert_array_equal(
        t2d.Recording.load("phases/001_specular.zarr").cube, t2d.Recording.load("seeds/000_seed_0.zarr").cube
    )


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("sweep", "walk.bvh"), "nothing is varied; give a range or alternatives, as --seed 0:9:1"),
        (("sweep", "walk.bvh", "--device", "cpu|auto"), "option device cannot be varied"),
        (
            ("sweep", "walk.bvh", "--vary", "seed"),
            "option vary takes a field and its values, as seed=0:9:1, got 'seed'",
        ),
        (("sweep", "walk.bvh", "--seed", "1:0:1"), "the range 1:0:1 never arrives"),
        (("sweep", "walk.bvh", "--motion.up", "y|z"), "option motion.up cannot be varied"),
        (
            ("sweep", "walk.bvh", "--radar", "ci4r|table2", "--radar.prf-hz", "2e3"),
            "a sweep takes several radars or changes fields of one",
        ),
        (("sweep", "walk.bvh", "--add", "fan:3,-1,1,rpm=x|3"), "rpm"),
        (
            ("sweep", "walk.bvh", "--seed", "0:1:1", "--scene", "living_room", "--scene-material", "brick"),
            "option scene-material must name a material and its substitute, as brick=concrete, got 'brick'",
        ),
        (
            ("sweep", "walk.bvh", "--seed", "0:1:1", "--scene-material", "brick=concrete"),
            "--scene-material is of a scene and there is none; give --scene, or leave it out",
        ),
    ],
)
def test_refusals_of_the_command(refused: Callable[..., str], options: tuple[str, ...], sentence: str) -> None:
    assert sentence in refused(*options)
