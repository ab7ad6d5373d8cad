"""The command line: one sentence for every file, option and place that cannot be used."""

from __future__ import annotations

import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import WALK, slow_after
from command_line import Command, dump, listing
from t2d_rt.cli import COMMANDS

QUICK = ("--method", "ellipsoid", "--radar", "ci4r", "--stop-s", "0.3")


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
        "nan": with_rows(len(rows), [row.replace(row.split()[0], "nan", 1) for row in rows]),
        "inf": with_rows(len(rows), [row.replace(row.split()[0], "inf", 1) for row in rows]),
        "zero": with_rows(0, []),
        "one": with_rows(1, rows[:1]),
        "joints": b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n"
        b"MOTION\nFrames: 2\nFrame Time: 0.1\n0\n0\n",
    }[name]


@pytest.mark.parametrize(
    ("name", "sentence"),
    slow_after(
        4,
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
            ("joints", "no two limbs of like bones where a person has two arms and two legs"),
        ],
    ),
)
def test_motion_files_that_cannot_be_used(refused: Callable[..., str], name: str, sentence: str) -> None:
    Path("bad.bvh").write_bytes(spoiled(name))
    assert sentence in refused("simulate", "bad.bvh")


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
    sentence = "cannot read recording walks: there is none of that name; give the .zarr folder that simulate wrote"
    assert sentence in refused("plot", "walks")
    assert "no motion file 'walks' and no bundled motion of that name; did you mean walk?" in refused("view", "walks")
    np.save("frames.npy", np.zeros((64, 1, 32), np.complex64))
    assert "a radar's samples are no motion, load_recording reads them" in refused("paths", "frames.npy")


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
        ("--method foo", "option method must be mesh or ellipsoid, got 'foo'"),
        ("--accuracy.occlusion maybe", "option accuracy.occlusion must be true or false, got 'maybe'"),
        ("--scene foo", "unknown scene 'foo'"),
        ("--material brick", "has no values for brick at 77.8"),
        ("--device tpu", "option device must be auto or cpu or gpu"),
        ("--radar foo", "unknown radar preset 'foo'; choose one of array-3x4"),
        ("--radar gone.yaml", "cannot read radar file gone.yaml: No such file"),
        ("--radar.carrier-hz -1", "radar key carrier_hz: got -1.0, should be greater"),
        ("--radar.prf-hz nan", "option radar.prf_hz must be a number, got 'nan'"),
        ("--radar.samples 2.5", "option radar.samples must be a whole number, got '2.5'"),
        ("--radar.position-m [1,2]", "option radar.position_m must be a list of 3 numbers, got '[1, 2]'"),
        ("--distance-m 0.05", "the radar at (0, 0, 1) m is inside adult at 0 s; place the target farther away"),
        ("--start-s 3 --stop-s 2", "trim needs 0 <= start < stop"),
        ("--motion.units 1e9", "the body would be 2.83e+10 m tall; leave units out"),
        ("--motion.units furlong", "units 'furlong' are unknown"),
        ("--motion.flavour foo", "flavour 'foo' is unknown; choose one of"),
        ("--motion.smooth-hz soft", "option motion.smooth_hz must be a number or auto or null, got 'soft'"),
        (
            "--motion.up w",
            "option motion.up must be x or y or z or -x or -y or -z or file or a list of 3 numbers or null, got 'w'",
        ),
        (
            "--radar.tx-offsets-m [0,0.002,0]",
            "option radar.tx_offsets_m must be a list of positions such as [[0, 0, 0], [0, 0.002, 0]], got '0'",
        ),
        ("--signal.n-window 50000", "shorter than the STFT window of 50000"),
        ("--signal.range-gate-m [90,100]", "range gate 90..100 m holds no range bin"),
        ("--accuracy.sagitta-rad 19", "sagitta_rad: got 19.0, should be less than or equal to 10"),
        ("--stop-s 0.01 --signal.n_window 256", "record of 85 chirps is shorter than the STFT window of 256"),
        ("--config gone.yaml", "cannot read config file gone.yaml: No such file"),
        ("--add fan", "a mover is written as kind:x,y,z,key=value or as a mapping with a kind, got 'fan'"),
        ("--add person:distance_m=3", "motion key file is missing; write file: walk.bvh, or person:walk.bvh"),
    ],
)
def test_options_that_cannot_be_used(refused: Callable[..., str], options: str, sentence: str) -> None:
    assert sentence in refused("simulate", "walk.bvh", *options.split())


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("foo: 3", "unknown option foo"),
        ("targets: []", "run.yaml holds no options, it is an experiment: give it in the place of the motion file"),
        ("carrier_hz: 7e9", "run.yaml holds no options, it is a radar: give it as --radar run.yaml"),
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


def test_a_file_in_the_place_of_another(refused: Callable[..., str]) -> None:
    dump("options.yaml", {"file": "walk.bvh", "seed": 3})
    dump("mine.yaml", {"carrier_hz": 77e9})
    assert "options of the command line and is no experiment; give it as --config options.yaml" in refused(
        "plan", "options.yaml"
    )
    assert "holds the fields of a radar and is no experiment; give it as --radar mine.yaml" in refused(
        "simulate", "mine.yaml"
    )
    assert "t2d-rt simulate --config options.yaml takes them" in refused("info", "options.yaml")


def test_radar_file_that_cannot_be_used(refused: Callable[..., str]) -> None:
    dump("mine.yaml", {**t2d.Radar.preset("ci4r").model_dump(mode="json"), "prf": 3})
    assert "unknown radar key 'prf'; did you mean prf_hz?" in refused("simulate", "walk.bvh", "--radar", "mine.yaml")


def test_commands_that_are_none(refused: Callable[..., str]) -> None:
    assert f"unknown command 'foo'; choose one of {', '.join(COMMANDS)}" in refused("foo")
    assert "no file given" in refused("simulate")
    assert "unknown option --method" in refused("compare", "walk.bvh", "--method", "mesh")


# --- places that cannot be used -------------------------------------------------------------------------------------


def test_places_that_cannot_be_used(refused: Callable[..., str]) -> None:
    Path("folder.zarr").mkdir()
    Path("file.zarr").write_text("x")
    Path("folder.png").mkdir()
    for command, place, sentence in (
        ("simulate", "gone/x.zarr", "folder gone does not exist; create it first"),
        ("simulate", "file.zarr/x.zarr", "file.zarr is a file, and x.zarr needs a folder; choose another place"),
        ("simulate", "file.zarr/a/x.zarr", "file.zarr is a file, and x.zarr needs a folder; choose another place"),
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

    monkeypatch.setattr("t2d_rt.core.atomic_write.tempfile.TemporaryFile", no_file)  # permissions do not bind root
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
