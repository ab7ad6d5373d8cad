"""The command line, end to end on a real file: what it writes, and one sentence for everything that cannot be used."""

from __future__ import annotations

import inspect
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module, metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import t2d_rt as t2d
import t2d_rt.cli
from builders import WALK, walk
from command_line import Command, dump, listing
from measures import check_picture
from t2d_rt.core import backend
from t2d_rt.core.errors import T2DWarning
from t2d_rt.radar.synthesize import Synthesis
from t2d_rt.recording.compare import compare

pytestmark = pytest.mark.usefixtures("coarse_bodies")

LOOP = import_module("t2d_rt.simulate")
"""The module, whose name in the package is that of its function."""
QUICK = ("--method", "ellipsoid", "--radar", "ci4r", "--stop-s", "0.3")


# --- what works -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("method", ["mesh", "ellipsoid"])
def test_simulate_writes_result_and_picture(run: Command, method: str) -> None:
    # 2000 Hz is fewer chirps than the foot needs: the warning names the fix and the run goes on.
    code, out, err = run(
        "simulate", "walk.bvh", "--radar", "ci4r", "--radar.prf-hz", "2000", "--method", method, "--stop-s=0.2",
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
    expected = result.radar.chirp_times_s(0.2)
    assert len(result.cube) == len(expected)
    assert not [*Path.cwd().glob(".*")]


def test_config_round_trip(run: Command) -> None:
    given = run("simulate", "walk.bvh", *QUICK, "--radar.prf-hz", "4000", "--angle-deg", "-30", "--print_config")
    assert given.code == 0
    Path("walk.yaml").write_text(given.out)
    assert run("simulate", "--config", "walk.yaml", "--print-config").out == given.out
    changed = yaml.safe_load(run("simulate", "--seed", "9", "--config=walk.yaml", "--print_config").out)
    assert changed == {**yaml.safe_load(given.out), "seed": 9}
    assert run("simulate", "--config", "walk.yaml").code == 0
    assert t2d.Recording.load("walk.zarr").radar.prf_hz == 4000


def test_a_null_stands_for_what_is_not_given(run: Command, refused: Callable[..., str]) -> None:
    dump(
        "nulls.yaml", {"without_paths": None, "only_paths": None, "material": None, "stop_s": None, "background": None}
    )
    assert (
        run("plan", "walk.bvh", *QUICK, "--add", "fan:2,1,1", "--config", "nulls.yaml").code == 2
    )  # background is no option
    dump("nulls.yaml", {"without_paths": None, "only_paths": None, "material": None, "stop_s": None})
    assert run("plan", "walk.bvh", *QUICK, "--add", "fan:2,1,1", "--config", "nulls.yaml").code == 0
    dump("seed.yaml", {"seed": None})
    assert "option seed" in refused("plan", "walk.bvh", "--config", "seed.yaml")


def test_radar_by_name_by_file_and_in_a_config_file(run: Command) -> None:
    def radar(*arguments: str) -> dict[str, Any]:
        result = run("simulate", "walk.bvh", *arguments, "--print_config")
        assert result.code == 0, result.err
        found = dict(yaml.safe_load(result.out)["radar"])
        assert found.pop("track") is None
        return found

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
        "simulate", "walk.bvh", *QUICK, "--accuracy.occlusion", "false", "--add", "fan:2,1,1,rpm=60", "--add", other,
        "-o", "option.zarr",
    )  # fmt: skip
    assert (by_file.code, by_option.code) == (0, 0), by_file.err + by_option.err
    file, option = t2d.Recording.load("file.zarr"), t2d.Recording.load("option.zarr")
    assert np.array_equal(np.asarray(file.cube), np.asarray(option.cube))
    assert len(file.cube) == len(file.radar.chirp_times_s(0.2))  # the other person's record is the shorter one
    other_walker = t2d.place(t2d.trim(walk(), 0, 0.2), distance_m=3, angle_deg=20)
    targets = [t2d.place(t2d.trim(walk(), 0, 0.3)), t2d.TableFan(position_m=(2, 1, 1), rpm=60), other_walker]
    told = r"the record ends with target 3 .* at 0.2 s, and of the 0.3 s of target 1 \(12_01_walk.bvh\) the last 0.1 s"
    with pytest.warns(T2DWarning, match=told):
        made = t2d.simulate(targets, radar=file.radar, method="ellipsoid", accuracy={"occlusion": False})
    assert np.array_equal(np.asarray(file.cube), made.cube)
    added = file.settings["added"]
    assert [each["kind"] for each in added] == ["fan", "file"]
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
    from t2d_rt.core import progress

    def slow(*arguments: Any, progress: Callable[[float], None], **options: Any) -> Synthesis:
        for fraction in (0.25, 0.5, 0.99):
            progress(fraction)
            time.sleep(0.12)  # tqdm draws ten times a second
        return Synthesis(*arguments, **options)

    assert run("simulate", "walk.bvh", *QUICK).err == ""
    monkeypatch.setattr(LOOP, "Synthesis", slow)
    clock = iter([0.0, 30.0])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))  # 30 s to the first block
    monkeypatch.setattr(progress, "_redraws", lambda stream: True)  # as on a terminal
    shown = run("simulate", "walk.bvh", *QUICK, "-o", "slow.zarr").err
    assert "ellipsoid" in shown
    assert "%" in shown


# --- things that stop a run -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "where",
    ["t2d_rt.radar.windows.Windows.add", "t2d_rt.recording.recording.Recording.plot", "xarray.Dataset.to_zarr"],
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
        [sys.executable, "-m", "t2d_rt", "simulate", str(WALK)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONPATH": str(WALK.parents[2])},
        # What a shell starts in the background ignores SIGINT, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
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
        assert (
            "install LLVM (Debian, Ubuntu: apt-get install libllvm19; anywhere on x86-64: pip install 't2d-rt[llvm]')"
            in refused("simulate", "walk.bvh", *QUICK)
        )
    finally:
        backend.require_llvm.cache_clear()


def test_not_enough_memory(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    def too_much(*_: Any, **__: Any) -> None:
        raise MemoryError("Unable to allocate 75. GiB")

    monkeypatch.setattr(LOOP, "Synthesis", too_much)
    assert "not enough memory (Unable to allocate 75. GiB); a shorter motion" in refused("simulate", "walk.bvh", *QUICK)


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
            "experiment key reflections: got 7",
        ),
        (
            ("simulate", "walk.bvh", "--scene", "corridor", "--accuracy.dynamic-range-db", "-3"),
            "should be greater than or equal to 0",
        ),
    ],
)
def test_rooms_that_are_refused(refused: Callable[..., str], arguments: tuple[str, ...], message: str) -> None:
    assert message in refused(*arguments)


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
        ["/bin/sh", "-c", f"'{sys.executable}' -m t2d_rt info '{WALK}' >&-"], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("module", ["numpy", "t2d_rt.cli.options", "jsonargparse"])
def test_ctrl_c_while_the_program_loads(module: str, tmp_path: Path) -> None:
    code = (
        "import runpy, sys\n"
        "class Stop:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == module: raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Stop())\n"
        "module, sys.argv = sys.argv[1], ['t2d-rt', 'list', 'motions']\n"
        "runpy.run_module('t2d_rt', run_name='__main__')"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, module], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stderr) == (130, "t2d-rt: stopped; nothing was written\n")


@pytest.mark.slow
def test_help_without_docstrings(run: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """`python -OO` drops them; what the options tell is the same."""
    monkeypatch.setenv("COLUMNS", "100")
    code = (
        "import contextlib\nfrom t2d_rt.cli import main\n"
        "for command in ('simulate', 'motion'):\n    with contextlib.suppress(SystemExit): main((command, '--help'))"
    )
    bare = subprocess.run([sys.executable, "-OO", "-c", code], capture_output=True, text=True, check=False)
    assert (bare.returncode, bare.stderr) == (0, "")
    assert bare.stdout == "".join(run(command, "--help").out for command in ("simulate", "motion"))


# --- new fields -----------------------------------------------------------------------------------------------------


class Windy(t2d.Experiment):
    wind_mps: float = 0.0
    """Speed of the wind [m/s]."""


class Grainy(t2d.Accuracy):
    grain_m: float | None = None
    """Size of the grains [m]."""


def test_a_new_field_is_an_option_stands_in_yaml_and_is_saved(run: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """With no edit anywhere: options are the fields of `Experiment` and `Accuracy`."""
    import_module("t2d_rt.simulate")
    for module in [each for name, each in sys.modules.items() if name.startswith("t2d_rt.")]:
        for before, after in ((t2d.Experiment, Windy), (t2d.Accuracy, Grainy)):
            if vars(module).get(before.__name__) is before:
                monkeypatch.setattr(module, before.__name__, after)
    monkeypatch.setattr(t2d_rt.cli, "_command", inspect.unwrap(t2d_rt.cli._command))
    told = " ".join(run("simulate", "--help").out.split())
    assert "--carries [" in told
    assert "+ [" not in told
    assert "Speed of the wind [m/s]. (type: float, default: 0.0)" in told
    assert "Size of the grains [m]." in told
    given = ("--wind-mps", "3", "--accuracy.grain-m", "0.5")
    config = yaml.safe_load(run("simulate", "walk.bvh", *given, "--print_config").out)
    assert (config["wind_mps"], config["accuracy"]) == (3, {"grain_m": 0.5})
    dump("run.yaml", {"wind_mps": 3, "accuracy": {"grain_m": 0.5}})
    dump("room.yaml", {"targets": [{"kind": "file", "file": "walk.bvh", "stop_s": 0.3}], "radar": "ci4r", "wind_mps": 3,
                       "method": "ellipsoid", "accuracy": {"grain_m": 0.5}})  # fmt: skip
    for words in (("walk.bvh", *QUICK, *given), ("walk.bvh", *QUICK, "--config", "run.yaml"), ("room.yaml",)):
        done = run("simulate", *words, "-o", "windy.zarr", "--overwrite")
        assert done.code == 0, done.err
        saved = t2d.Recording.load("windy.zarr")
        assert saved.experiment.model_dump()["wind_mps"] == 3
        assert saved.accuracy.model_dump()["grain_m"] == 0.5
    assert run("simulate", "walk.bvh", "--wind-mps", "strong").err.startswith(
        "t2d-rt: option wind_mps must be a number"
    )
    assert run("simulate", "walk.bvh", "--wind-mp", "3").err == (
        "t2d-rt: unknown option --wind_mp; did you mean --wind_mps? t2d-rt simulate --help lists all\n"
    )
