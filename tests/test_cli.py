"""The command line, end to end on a real file: what it writes, and one sentence for everything that cannot be used."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

import t2d_rt as t2d
from builders import WALK, walk
from measures import check_picture
from t2d_rt import backend, summation
from t2d_rt.cli import main
from t2d_rt.compare import compare
from t2d_rt.radar.synthesize import synthesize

QUICK = ("--method", "ellipsoid", "--radar", "ci4r", "--stop-s", "0.3")


class Run(NamedTuple):
    code: int
    out: str
    err: str


Command = Callable[..., Run]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """`run("simulate", ...)` in an empty folder; the walk is there as walk.bvh."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.bvh").symlink_to(WALK)

    def run_command(*arguments: str) -> Run:
        capsys.readouterr()
        try:
            code = main(arguments)
        except SystemExit as stop:  # --help and --print_config of the parser
            code = stop.code if isinstance(stop.code, int) else 0
        return Run(code, *capsys.readouterr())

    return run_command


@pytest.fixture
def refused(run: Command, tmp_path: Path) -> Callable[..., str]:
    """`refused(...)`: the one sentence of a run that must fail and leave everything as it was."""

    def check(*arguments: str) -> str:
        before = listing(tmp_path)
        code, _, err = run(*arguments)
        assert code == 2
        assert err.startswith("t2d-rt: ")
        assert err.count("\n") == 1
        assert "Traceback" not in err
        assert listing(tmp_path) == before
        return err.strip()

    return check


def listing(folder: Path) -> dict[str, int]:
    return {str(p.relative_to(folder)): p.lstat().st_mtime_ns for p in folder.rglob("*")}


def dump(path: str, values: Any) -> str:
    Path(path).write_text(yaml.safe_dump(values))
    return path


# --- what works -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("method", ["mesh", "ellipsoid"])
def test_simulate_writes_result_and_picture(run: Command, method: str) -> None:
    # 2000 Hz is fewer chirps than the foot needs: the warning names the fix and the run goes on.
    code, out, err = run(
        "simulate", "walk.bvh", "--radar", "ci4r", "--radar.prf-hz", "2000", "--method", method, "--stop-s=0.3",
        "--distance-m", "4", "--signal.mti", "mean", "--seed=5", "--accuracy.sagitta-rad=1",
    )  # fmt: skip
    assert code == 0, err
    assert "flavour cmu-a" in out
    assert "wrote walk.zarr and walk.png" in out
    assert err.startswith("t2d-rt: warning: top speed")
    assert "raise prf_hz to" in err
    assert Path("walk.png").read_bytes().startswith(b"\x89PNG")
    result = t2d.Recording.load("walk.zarr")
    assert result.radar == t2d.Radar.preset("ci4r", prf_hz=2000)
    assert result.settings["method"] == method
    assert result.settings["seed"] == 5
    assert result.settings["motion"]["distance_m"] == 4
    assert result.processing["mti"] == "mean"
    expected = result.radar.chirp_times_s(0.3)
    assert len(result.cube) == len(expected)
    assert not [*Path.cwd().glob(".*")]


@pytest.mark.slow
def test_config_round_trip(run: Command) -> None:
    given = run("simulate", "walk.bvh", *QUICK, "--radar.prf-hz", "4000", "--angle-deg", "-30", "--print_config")
    assert given.code == 0
    Path("walk.yaml").write_text(given.out)
    assert run("simulate", "--config", "walk.yaml", "--print-config").out == given.out
    changed = yaml.safe_load(run("simulate", "--seed", "9", "--config=walk.yaml", "--print_config").out)
    assert changed == {**yaml.safe_load(given.out), "seed": 9}
    assert run("simulate", "--config", "walk.yaml").code == 0
    assert t2d.Recording.load("walk.zarr").radar.prf_hz == 4000


def test_radar_by_name_by_file_and_in_a_config_file(run: Command) -> None:
    def radar(*arguments: str) -> dict[str, Any]:
        result = run("simulate", "walk.bvh", *arguments, "--print_config")
        assert result.code == 0, result.err
        return dict(yaml.safe_load(result.out)["radar"])

    ci4r = t2d.Radar.preset("ci4r").model_dump(mode="json")
    t2d.Radar.preset("ci4r", samples=128).to_yaml("mine.yaml")
    dump("run.yaml", {"radar": "ci4r"})
    dump("field.yaml", {"radar": {"prf_hz": 5000.0}})
    assert radar() == t2d.Radar.preset("table2").model_dump(mode="json")
    assert radar("--radar", "ci4r") == radar("--radar=CI4R") == radar("--config", "run.yaml") == ci4r
    assert radar("--radar", "mine.yaml") == {**ci4r, "samples": 128}
    # fields override the preset wherever they stand, and a preset the config file
    assert radar("--radar.prf_hz", "4000", "--radar", "ci4r") == {**ci4r, "prf_hz": 4000}
    pattern = {"kind": "cosine", "exponent": 2}
    assert radar("--radar", "ci4r", "--radar.tx_pattern", str(pattern)) == {**ci4r, "tx_pattern": pattern}
    assert radar("--radar", "ci4r", "--config", "field.yaml") == ci4r
    # a preset with bursts leaves nothing behind in one without
    dump("burst.yaml", {"radar": "table2-burst"})
    assert radar("--config", "burst.yaml", "--radar", "ci4r") == ci4r


def test_values_that_begin_with_a_dash(run: Command) -> None:
    options = ("--motion.up", "-z", "--angle-deg", "-45", "--signal.kernel", "[-1,2,-1]", "-o", "x.zarr")
    values = yaml.safe_load(run("simulate", *options, "walk.bvh", "--print_config").out)
    assert (values["file"], values["output"]) == ("walk.bvh", "x.zarr")
    assert (values["motion"]["up"], values["angle_deg"], values["signal"]["kernel"]) == ("-z", -45, [-1, 2, -1])


@pytest.mark.slow
def test_movers_and_persons_are_added(run: Command) -> None:
    fan = {"kind": "fan", "position_m": [2, 1, 1], "rpm": 60}
    other = "person:walk.bvh,distance_m=3,angle_deg=20,stop_s=0.2"
    dump("added.yaml", {"add": [fan, other]})
    by_file = run(
        "simulate", "walk.bvh", *QUICK, "--accuracy.occlusion", "false", "--config", "added.yaml", "-o", "file.zarr"
    )
    by_option = run(
        "simulate",
        "walk.bvh",
        *QUICK,
        "--accuracy.occlusion",
        "false",
        "--add",
        "fan:2,1,1,rpm=60",
        "--add",
        other,
        "-o",
        "option.zarr",
    )
    assert (by_file.code, by_option.code) == (0, 0), by_file.err + by_option.err
    file, option = t2d.Recording.load("file.zarr"), t2d.Recording.load("option.zarr")
    assert np.array_equal(np.asarray(file.cube), np.asarray(option.cube))
    assert len(file.cube) == len(file.radar.chirp_times_s(0.2))  # the other person's record is the shorter one
    other_walker = t2d.place(t2d.trim(walk(), 0, 0.2), distance_m=3, angle_deg=20)
    targets = [t2d.place(t2d.trim(walk(), 0, 0.3)), t2d.TableFan(position_m=(2, 1, 1), rpm=60), other_walker]
    made = t2d.simulate(targets, radar=file.radar, method="ellipsoid", accuracy={"occlusion": False})
    assert np.array_equal(np.asarray(file.cube), made.cube)
    added = file.settings["added"]
    assert [each["kind"] for each in added] == ["fan", "person"]
    assert (added[0]["rpm"], added[1]["distance_m"]) == (60, 3)


@pytest.mark.slow
def test_compare_prints_figures_and_draws(run: Command) -> None:
    radar = ("--radar", "ci4r", "--radar.prf-hz=8000", "--accuracy.sagitta-rad=1")
    code, out, err = run("compare", "walk.bvh", *radar, "--start-s=2", "--stop-s=2.4")
    assert code == 0
    assert "wrong range" not in err
    assert "alias" not in err
    rows = {line[:24].strip(): line[24:].split() for line in out.splitlines()}
    assert rows[""] == ["ellipsoid", "mesh"]
    for speed in rows["torso speed [m/s]"]:
        assert float(speed) == pytest.approx(0.88, abs=0.15)  # part of a step
    assert len(rows["mean RCS [dBsm]"]) == len(rows["limb speed [m/s]"]) == 2
    options: dict[str, Any] = {"radar": t2d.Radar.preset("ci4r", prf_hz=8000), "accuracy": {"sagitta_rad": 1.0}}
    piece = t2d.trim(t2d.place(walk()), 2, 2.4)
    found = compare(*(t2d.simulate(piece, method=method, **options) for method in ("ellipsoid", "mesh")))
    assert float(rows["envelope correlation"][0]) == pytest.approx(found.envelope_correlation, abs=0.01)
    assert float(rows["mean |difference| [dB]"][0]) == pytest.approx(found.mean_difference_db, abs=0.1)
    check_picture(Path("walk_compare.png"))
    assert run("compare", "walk.bvh").code == 2  # there is one already


def test_info(run: Command) -> None:
    assert "flavour cmu-a" in run("info", "walk.bvh").out
    assert "4.35 s, 523 frames" in run("info", "walk.bvh").out
    t2d.Radar.preset("ci4r").to_yaml("mine.yaml")
    assert "19.47 cm" in run("info", "mine.yaml").out
    assert run("simulate", "walk.bvh", *QUICK).code == 0
    shown = run("info", "walk.zarr").out
    assert "3200 Hz" in shown
    assert "method                ellipsoid" in shown
    assert "drjit" in shown


def test_help(run: Command) -> None:
    assert run("--help").code == 0
    assert "simulate FILE" in run("--help").out
    assert run("--version").out.split()[-1] == metadata.version("t2d-rt")
    for command in ("simulate", "compare", "info"):
        shown = run(command, "--help")
        assert shown.code == 0
        assert f"t2d-rt {command} walk.bvh" in shown.out
        assert "<function" not in shown.out
        assert "Annotated" not in shown.out
    code, out, err = run()
    assert (code, out) == (2, "")
    assert "simulate FILE" in err


@pytest.mark.slow
def test_progress_only_over_two_seconds(run: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    from t2d_rt import progress

    def slow(*arguments: Any, progress: Callable[[float], None], **options: Any) -> np.ndarray:
        for share in (0.25, 0.5, 0.99):
            progress(share)
            time.sleep(0.12)  # tqdm draws ten times a second
        return synthesize(*arguments, **options)

    assert run("simulate", "walk.bvh", *QUICK).err == ""
    monkeypatch.setattr(summation, "synthesize", slow)
    clock = iter([0.0, 30.0])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))  # 30 s to the first block
    monkeypatch.setattr(progress, "_redraws", lambda stream: True)  # as on a terminal
    shown = run("simulate", "walk.bvh", *QUICK, "-o", "slow.zarr").err
    assert "ellipsoid" in shown
    assert "%" in shown


# --- files that cannot be used --------------------------------------------------------------------------------------


def spoiled(name: str) -> bytes:
    text = WALK.read_text()
    lines = text.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("Frames:"))
    head, rows = lines[:at], lines[at + 2 :]

    def with_rows(count: int, kept: list[str]) -> bytes:
        return "\n".join([*head, f"Frames: {count}", lines[at + 1], *kept]).encode()

    return {
        "empty": b"",
        "binary": bytes(range(256)) * 40,
        "text": b"hello\n",
        "truncated": text[: len(text) // 2].encode(),
        "no motion": text[:1500].encode(),
        "count": with_rows(9999, rows),
        "nan": with_rows(len(rows), [*rows[:5], rows[5].replace(rows[5].split()[0], "nan", 1), *rows[6:]]),
        "inf": with_rows(len(rows), [*rows[:5], rows[5].replace(rows[5].split()[0], "inf", 1), *rows[6:]]),
        "zero": with_rows(0, []),
        "one": with_rows(1, rows[:1]),
        "joints": text.replace("LeftUpLeg", "Foo").replace("RightUpLeg", "Bar").encode(),
    }[name]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("empty", "bad.bvh is empty; expected BVH text"),
        ("binary", "bad.bvh is not a BVH file"),
        ("text", "bad.bvh is not a BVH file"),
        ("truncated", "expected 524 frames of 96 channels = 50304 values, got"),
        ("no motion", "has no MOTION section"),
        ("count", "'Frames: 9999' but 524 rows"),
        ("nan", "NaN, infinite or absurd values"),
        ("inf", "NaN, infinite or absurd values"),
        ("zero", "at least 2 frames, got 'Frames: 0'"),
        ("one", "at least 2 frames, got 'Frames: 1'"),
        ("joints", "lacks LeftUpLeg, RightUpLeg"),
    ],
)
def test_motion_files_that_cannot_be_used(refused: Callable[..., str], name: str, sentence: str) -> None:
    Path("bad.bvh").write_bytes(spoiled(name))
    for command in ("simulate", "compare", "info"):
        assert sentence in refused(command, "bad.bvh")


def test_files_that_are_not_motions(refused: Callable[..., str]) -> None:
    Path("folder.bvh").mkdir()
    Path("empty.zarr").mkdir()
    Path("file.zarr").write_text("x")
    assert "cannot read BVH file gone.bvh: No such file" in refused("simulate", "gone.bvh")
    assert "folder.bvh is a directory" in refused("simulate", "folder.bvh")
    assert "empty.zarr does not hold a t2d-rt result" in refused("simulate", "empty.zarr", "-o", "x.zarr")
    assert "gone.bvh does not exist" in refused("info", "gone.bvh")
    assert "empty.zarr does not hold a t2d-rt result" in refused("info", "empty.zarr")
    assert "motions come as .bvh" in refused("info", "file.zarr")


# --- options that cannot be used ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--foo 3", "unknown option --foo"),
        (f"--accuracy.sagitta-scale {'1' * 400}", "a number of more than 300 digits"),
        ("--dist 4", "unknown option --dist;"),
        ("-x 3", "unknown option -x"),
        ("--radar.foo 3", "unknown option --radar.foo"),
        ("--seed", "option --seed needs a value"),
        ("--radar --seed 3", "option --radar needs a value"),
        ("other.bvh", "expected one file, got 2 (walk.bvh, other.bvh)"),
        ("--seed x", "option seed must be a whole number, got 'x'"),
        ("--seed -1", "seed must be an integer of 0 or more, got -1"),
        ("--method foo", "option method must be mesh or ellipsoid, got 'foo'"),
        ("--accuracy.occlusion maybe", "option accuracy.occlusion must be true or false, got 'maybe'"),
        ("--scene foo", "unknown scene 'foo'"),
        ("--material foo", "unknown material 'foo'; ITU names are"),
        ("--material brick", "has no values for brick at 77.8"),
        ("--body foo", "unknown body 'foo'; choose one of adult"),
        ("--device tpu", "option device must be auto or cpu or gpu"),
        ("--radar foo", "unknown radar preset 'foo'; choose one of array-3x4"),
        ("--radar gone.yaml", "cannot read radar file gone.yaml: No such file"),
        ("--radar.carrier-hz -1", "radar key carrier_hz: got -1.0, should be greater"),
        ("--radar.slope-hz-per-s 0", "radar key slope_hz_per_s: got 0.0, should be greater"),
        ("--radar.sample-rate-hz -6e6", "radar key sample_rate_hz: got -6000000.0, should be greater"),
        ("--radar.prf-hz 0", "radar key prf_hz: got 0.0, should be greater"),
        ("--radar.prf-hz nan", "option radar.prf_hz must be a number, got 'nan'"),
        ("--radar.samples 2.5", "option radar.samples must be a whole number, got '2.5'"),
        (
            "--radar.prf-hz 40000",
            "sampling window of 37.3886 us (256 samples at 6.847e+06 Hz) is longer than the chirp",
        ),
        ("--radar.position-m [1,2]", "option radar.position_m must be a list of 3 numbers, got '[1, 2]'"),
        ("--radar.boresight [0,0,0]", "boresight must be a direction"),
        ("--distance-m 0.05", "the radar at (0, 0, 1) m is inside adult at 0 s; place the target farther away"),
        ("--distance-m 0.05 --method ellipsoid", "the radar at (0, 0, 1) m is inside abdomen at 0 s; place the target"),
        ("--distance-m -1", "distance_m must be positive, got -1.0"),
        ("--start-s 3 --stop-s 2", "stop_s must lie after start_s of 3 s, got 2"),
        ("--motion.units 1e9", "the body would be 2.83e+10 m tall; leave units out"),
        ("--motion.units furlong", "units 'furlong' are unknown"),
        ("--motion.flavour foo", "flavour 'foo' is unknown; choose one of"),
        ("--motion.smooth-hz soft", "option motion.smooth_hz must be a number or auto or null, got 'soft'"),
        ("--motion.up w", "option motion.up must be x or y or z or -x or -y or -z or null, got 'w'"),
        ("--signal.mti foo", "MTI method must be 'none', 'mean', 'highpass' or 'canceller', got 'foo'"),
        ("--signal.window foo", "unknown window 'foo'"),
        ("--signal.n-window 999999", "shorter than the STFT window of 999999"),
        ("--signal.range-gate-m [90,100]", "range gate 90..100 m holds no range bin"),
        ("--accuracy.surface-rate-hz 0", "surface_rate_hz: got 0.0, should be greater than or equal to 10"),
        ("--accuracy.visibility-rate-hz 0", "visibility_rate_hz: got 0.0, should be greater than or equal to 1"),
        ("--accuracy.sagitta-rad 9", "sagitta_rad: got 9.0, should be less than or equal to 2"),
        ("--stop-s 0.01 --signal.n_window 256", "record of 85 chirps is shorter than the STFT window of 256"),
        ("--config gone.yaml", "cannot read config file gone.yaml: No such file"),
        ("--add fan", "a mover is written as kind:x,y,z,key=value or as a mapping with a kind, got 'fan'"),
        ("--add fam:1,2,3", "unknown mover 'fam'; did you mean fan?"),
        ("--add fan:1,2,3,rpms=4", "unknown fan key 'rpms'; did you mean rpm?"),
        ("--add person:gone.bvh", "cannot read BVH file gone.bvh: No such file"),
        ("--add person:distance_m=3", "person key file is missing; write person:FILE.bvh"),
    ],
)
def test_options_that_cannot_be_used(refused: Callable[..., str], options: str, sentence: str) -> None:
    assert sentence in refused("simulate", "walk.bvh", *options.split())


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("foo: 3", "unknown option foo"),
        ("radar: {foo: 3}", "unknown option radar.foo"),
        ("radar: nope", "unknown radar preset 'nope'"),
        ("signal: 4", "'signal' in config file run.yaml must hold options and values, got 4"),
        ("seed: x", "option seed must be a whole number, got 'x'"),
        ("add: 3", "option add must be a list such as [fan:2,1,1, pet:3,0,0], got '3'"),
        ("add: [{kind: fan}]", "fan key position_m is missing"),
        ("overwrite: 7", "option overwrite must be true or false, got '7'"),
        ("- a", "must hold options and values such as 'seed: 3'"),
        ("", "must hold options and values such as 'seed: 3'"),
        ("seed: [1", "config file run.yaml is not valid YAML"),
        (b"\xff\xfe", "config file run.yaml is not valid YAML"),
    ],
)
def test_config_files_that_cannot_be_used(refused: Callable[..., str], text: str | bytes, sentence: str) -> None:
    Path("run.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    assert sentence in refused("simulate", "walk.bvh", "--config", "run.yaml")


def test_radar_file_that_cannot_be_used(refused: Callable[..., str]) -> None:
    dump("mine.yaml", {**t2d.Radar.preset("ci4r").model_dump(mode="json"), "prf": 3})
    assert "unknown radar key 'prf'; did you mean prf_hz?" in refused("simulate", "walk.bvh", "--radar", "mine.yaml")


def test_commands_that_are_none(refused: Callable[..., str]) -> None:
    assert "unknown command 'foo'; choose one of simulate, plan, compare, scene, info, export, list" in refused("foo")
    assert "no file given" in refused("simulate")
    assert "unknown option --method" in refused("compare", "walk.bvh", "--method", "mesh")


# --- places that cannot be used -------------------------------------------------------------------------------------


def test_places_that_cannot_be_used(refused: Callable[..., str]) -> None:
    Path("folder.zarr").mkdir()
    Path("file.zarr").write_text("x")
    Path("folder.png").mkdir()
    for command, place, sentence in (
        ("simulate", "gone/x.zarr", "folder gone does not exist; create it first"),
        ("simulate", "x", "a result is a folder that ends in .zarr, got 'x'"),
        ("simulate", ".", "a result is a folder that ends in .zarr"),
        ("simulate", "folder.zarr", "folder.zarr is a folder but not a result"),
        ("simulate", "file.zarr", "file.zarr is a file and a result is a folder"),
        ("simulate", "x" * 300 + ".zarr", "File name too long"),
        ("compare", "gone/x.png", "folder gone does not exist"),
        ("compare", "x.bmp", "a picture ends in .png, .pdf or .svg"),
        ("compare", "folder.png", "folder.png is a folder"),
    ):
        assert sentence in refused(command, "walk.bvh", "-o", place, "--overwrite")


def test_folder_that_cannot_be_written(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    def no_file(*_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("t2d_rt.store.tempfile.TemporaryFile", no_file)  # permissions do not bind root
    assert "is not writable (Permission denied)" in refused("simulate", "walk.bvh", *QUICK)
    assert "is not writable (Permission denied)" in refused("compare", "walk.bvh")


def test_existing_result_is_kept_unless_overwritten(run: Command, refused: Callable[..., str]) -> None:
    assert run("simulate", "walk.bvh", *QUICK, "--seed", "1").code == 0
    assert "walk.zarr exists already; choose another name or pass --overwrite" in refused(
        "simulate", "walk.bvh", *QUICK
    )
    Path("walk.zarr").rename("other.zarr")
    assert "walk.png exists already" in refused("simulate", "walk.bvh", *QUICK)
    Path("other.zarr").rename("walk.zarr")
    assert run("simulate", "walk.bvh", *QUICK, "--seed", "2", "--overwrite").code == 0
    assert t2d.Recording.load("walk.zarr").settings["seed"] == 2


@pytest.mark.slow
def test_full_disk_leaves_the_old_result(run: Command, refused: Callable[..., str], tmp_path: Path) -> None:
    assert run("simulate", "walk.bvh", *QUICK, "--seed", "1").code == 0
    before = listing(tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    for size in (1000, 200_000):  # no room for the picture; for the picture, but not for the samples
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            code, _, err = run("simulate", "walk.bvh", *QUICK, "--overwrite")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert code == 2
        assert err.count("\n") == 1
        assert "cannot write" in err
        assert "File too large" in err
        assert listing(tmp_path) == before
    assert t2d.Recording.load("walk.zarr").settings["seed"] == 1


# --- things that stop a run -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "where", ["t2d_rt.summation.synthesize", "t2d_rt.result.Recording.plot", "xarray.Dataset.to_zarr"]
)
def test_ctrl_c_leaves_nothing(run: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    def interrupted(*arguments: Any, **_: Any) -> None:
        if where.endswith("to_zarr"):
            assert Path(arguments[1]).is_dir()  # half written by now
        raise KeyboardInterrupt

    before = listing(tmp_path)
    monkeypatch.setattr(where, interrupted)
    code, _, err = run("simulate", "walk.bvh", *QUICK)
    assert (code, err) == (130, "t2d-rt: stopped; nothing was written\n")
    assert listing(tmp_path) == before


@pytest.mark.slow
def test_a_real_ctrl_c(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "t2d_rt.cli", "simulate", str(WALK)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONPATH": str(WALK.parents[2])},
        # What a shell starts in the background ignores SIGINT, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stdout is not None
    assert "flavour" in process.stdout.readline()  # it has read the file and goes on to the body
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err == "t2d-rt: stopped; nothing was written\n"
    assert [*tmp_path.iterdir()] == []


def test_missing_llvm(refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "libLLVM.so"))
    monkeypatch.setattr(backend, "_has_cuda", lambda: False)
    backend.require_llvm.cache_clear()
    try:
        assert "install LLVM (Debian, Ubuntu: apt-get install libllvm19)" in refused("simulate", "walk.bvh", *QUICK)
    finally:
        backend.require_llvm.cache_clear()


def test_not_enough_memory(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    def too_much(*_: Any, **__: Any) -> None:
        raise MemoryError("Unable to allocate 75. GiB")

    monkeypatch.setattr(summation, "synthesize", too_much)
    assert "not enough memory (Unable to allocate 75. GiB); a shorter motion" in refused("simulate", "walk.bvh", *QUICK)


@pytest.mark.slow
def test_attributes_tell_how_it_was_made(run: Command) -> None:
    assert run("simulate", "walk.bvh", *QUICK).code == 0
    import xarray as xr

    with xr.open_zarr("walk.zarr") as data:
        settings = json.loads(data.attrs["settings"])
    assert settings["motion"]["file"] == "walk.bvh"
    assert settings["motion"]["stop_s"] == 0.3
    assert "flavour cmu-a" in settings["targets"][0]


# --- scene ---


@pytest.mark.slow
def test_scene_draws_a_room(run: Command, tmp_path: Path) -> None:
    code, out, _ = run("scene", "corridor", "--walk", "walk.bvh", "--reflections", "1")
    assert code == 0
    assert "paths to (" in out
    assert "direct, floor, ceiling, wall" in out
    check_picture(tmp_path / "corridor.png", colours=100)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("scene", "ballroom"), "unknown scene 'ballroom'; did you mean bedroom?"),
        (("scene", "corridor", "--reflections", "9"), "option reflections must lie in 0..4, got 9"),
        (("scene", "corridor", "--walk", "gone.bvh"), "gone.bvh"),
        (("scene", "living_room", "--radar.position-m", "[0.45, 2.3, 1.0]"), "is inside cupboard of scene living_room"),
        (("simulate", "walk.bvh", "--scene", "ballroom"), "unknown scene 'ballroom'"),
        (
            ("simulate", "walk.bvh", "--scene", "corridor", "--reflections", "7"),
            "reflections must be an integer in 0..4",
        ),
        (
            ("simulate", "walk.bvh", "--scene", "corridor", "--accuracy.dynamic-range-db", "-3"),
            "should be greater than or equal to 0",
        ),
    ],
)
def test_rooms_that_are_refused(refused: Callable[..., str], arguments: tuple[str, ...], message: str) -> None:
    assert message in refused(*arguments)


@pytest.mark.slow
def test_plan_prints_what_would_be_modelled(run: Command, tmp_path: Path) -> None:
    done = run("plan", "walk.bvh", "--tolerance-db", "-12", "--stop-s", "0.4")
    assert done.code == 0
    assert "tolerance -12 dB" in done.out
    assert "predicted" in done.out
    assert [path.name for path in tmp_path.iterdir()] == ["walk.bvh"]


@pytest.mark.slow
def test_simulate_to_a_tolerance_tells_the_measured_error(run: Command) -> None:
    done = run("simulate", "walk.bvh", "--tolerance-db", "-12", "--stop-s", "0.4")
    assert done.code == 0
    assert re.search(r"measured error -\d\d\.\d dB", done.out)
    assert t2d.Recording.load("walk.zarr").error_db < -11


def test_plan_refuses_a_tolerance_that_makes_no_sense(refused: Callable[..., str]) -> None:
    assert "tolerance_db must lie in -40..6 dB" in refused("plan", "walk.bvh", "--tolerance-db", "-90")


@pytest.mark.slow
def test_a_closed_standard_output_is_no_traceback() -> None:
    done = subprocess.run(
        ["/bin/sh", "-c", f"'{sys.executable}' -m t2d_rt.cli info '{WALK}' >&-"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
