"""Results on disk: runs that are killed at random instants, and before every step that they take in the file system."""

from __future__ import annotations

import io
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt import cli
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import resource
from t2d_rt.recording.files import check_free
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar
from validation.report import Section, at_most

CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["xarray", "zarr", "scipy.signal", "validation.robustness.results"])
RADAR = Radar.preset("ci4r")
CHIRPS = 2000
"""4 MB of samples: writing them takes a good part of the run."""
KILLS, COMMANDS = 100, 12
KINDS = ("fresh", "overwriting", "paired")
STEPS = ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "tempfile.mkdtemp", "shutil.rmtree", "fcntl.flock")
"""Events of Python's audit hooks before which a run is killed."""
OLD, NEW, OTHER = 1, 2, 3
TIDY = "SIGTERM: no leftover even before it, no traceback"


def run() -> Section:
    draw = np.random.default_rng(17)
    faults: Counter[str] = Counter()
    took_s = _duration_s()
    for signal_ in (signal.SIGKILL, signal.SIGTERM):
        for number in range(KILLS):
            faults += _killed(KINDS[number % 3], signal_, float(draw.uniform(0, took_s)))
    steps = {kind: _every_step(kind, faults) for kind in KINDS[:2]}
    for found_ in _killed_commands(draw):
        faults += found_
    runs = 2 * KILLS + sum(steps.values()) + COMMANDS
    names = (
        "nothing lost",
        "nothing half written",
        "pictures with their results",
        "no leftover after the next command",
    )
    names += (TIDY,)
    return Section(
        title="Results on disk",
        checks=[at_most(f"{runs} killed runs, {name}: failures", faults[name], 0) for name in names],
        note=f"{KILLS} kill -9 and {KILLS} SIGTERM at random instants of the {took_s:.2f} s that saving 4 MB takes, in "
        "turn of fresh, overwriting and paired runs (two writers, one is killed); kill -9 before each of the "
        f"{steps['fresh']} steps of a fresh and {steps['overwriting']} of an overwriting run in the file system (Python's "
        f"audit events, so the renames too); {COMMANDS} at random instants of whole commands. The next command is "
        "`t2d-rt info`, or the check before a new run.",
    )


def _duration_s() -> float:
    """Of a writer's whole life, when what starts them is there."""
    taken = []
    for _ in range(4):
        with tempfile.TemporaryDirectory() as place:
            begin = time.perf_counter()
            start_writer(Path(place) / "r.zarr", NEW, overwrite=False).join()
            taken.append(time.perf_counter() - begin)
    return max(taken[1:])


def _killed(kind: str, signal_: int, after_s: float) -> Counter[str]:
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "r.zarr"
        if kind == "overwriting":
            save(path, OLD, overwrite=False)
        pair = [start_writer(path, OTHER, overwrite=True)] if kind == "paired" else []
        process = start_writer(path, NEW, overwrite=kind != "fresh")
        time.sleep(after_s)
        if process.pid is not None and process.is_alive():
            with suppress(ProcessLookupError):  # it ended just now
                os.kill(process.pid, signal_)
        process.join()
        for other in pair:
            other.join()
        faults = (
            _tidy(path, process.exitcode) if signal_ == signal.SIGTERM and process.exitcode != -signal_ else Counter()
        )
        return faults + _judged(path, kind)


def _tidy(path: Path, code: int | None) -> Counter[str]:
    """After SIGTERM, before any other command."""
    left = [entry.name for entry in path.parent.iterdir() if entry.name.startswith(".")]
    said = [file.read_text() for file in path.parent.glob("*.err")]
    good = not left and code in (0, 143) and all(text.count("\n") <= 1 and "Traceback" not in text for text in said)
    return Counter() if good else Counter({TIDY: 1})


def _judged(path: Path, kind: str) -> Counter[str]:
    """What is wrong after the next command."""
    if kind == "fresh":
        check_free(path, overwrite=True)
    else:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            cli.main(["info", str(path)])
    whole, drawn = found(path), picture(path)
    left = {entry.name for entry in path.parent.iterdir() if entry.suffix != ".err"} - {"r.zarr", "r.png"}
    return Counter(
        {
            "nothing lost": int(kind != "fresh" and whole is None),
            "nothing half written": int(isinstance(whole, str)),
            "pictures with their results": int(whole != drawn),
            "no leftover after the next command": int(bool(left)),
        }
    )


def _every_step(kind: str, faults: Counter[str]) -> int:
    """Kills a run before its first, second, ... step, until it ends by itself; how many steps there were."""
    for step in range(10_000):
        with tempfile.TemporaryDirectory() as place:
            path = Path(place) / "r.zarr"
            if kind == "overwriting":
                save(path, OLD, overwrite=False)
            process = start_writer(path, NEW, overwrite=kind != "fresh", first=_die_at, arguments=(step, place))
            process.join()
            faults += _judged(path, kind)
            if process.exitcode == 0:
                return step
            if process.exitcode != -signal.SIGKILL:
                raise RuntimeError(f"a run ended by itself with {process.exitcode}: {sentence(path, NEW)}")
    raise RuntimeError("a run takes more steps than expected")


def _die_at(step: int, place: str) -> None:
    left = [step]

    def hook(event: str, arguments: tuple) -> None:
        if event in STEPS and (event != "open" or str(arguments[0]).startswith(place)):
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left[0] -= 1

    sys.addaudithook(hook)


def _killed_commands(draw: np.random.Generator) -> Iterator[Counter[str]]:
    """Whole commands that overwrite a result, at random instants of the time that they take."""
    walk = resource("motions", "12_01_walk.bvh")
    command = [sys.executable, "-m", "t2d_rt", "simulate", str(walk), "-o", "r.zarr", "--method", "ellipsoid"]
    with tempfile.TemporaryDirectory() as kept:
        begin = time.perf_counter()
        subprocess.run(command, cwd=kept, check=True, capture_output=True)
        took_s = time.perf_counter() - begin
        for number in range(COMMANDS):
            with tempfile.TemporaryDirectory() as place:
                shutil.copytree(kept, place, dirs_exist_ok=True)
                again = [*command, "--overwrite", "--seed", "1"]
                process = subprocess.Popen(again, cwd=place, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
                time.sleep(took_s * draw.uniform())
                process.send_signal((signal.SIGKILL, signal.SIGTERM)[number % 2])
                yield _judged_command(Path(place), process.communicate()[1])


def _judged_command(place: Path, error: str) -> Counter[str]:
    path = place / "r.zarr"
    check_free(path, overwrite=True)
    faults = Counter({TIDY: int("Traceback" in error)})
    faults["no leftover after the next command"] = int({entry.name for entry in place.iterdir()} != {"r.zarr", "r.png"})
    try:
        faults["nothing lost"] = int(Recording.load(path).settings["seed"] not in (0, 1))
    except InputError:
        faults["nothing half written"] = 1
    return faults


# --- what writers in processes of their own write, and what is found afterwards ---


class Drawing:
    """A picture that says whose it is."""

    def __init__(self, value: int) -> None:
        self.value = value

    def savefig(self, path: Path) -> None:
        path.write_text(str(self.value))


def recording(value: int) -> Recording:
    return Recording(np.full((CHIRPS, 1, RADAR.samples), value, np.complex64), RADAR)


def save(path: Path, value: int, *, overwrite: bool) -> None:
    recording(value).save(path, overwrite=overwrite, figure=Drawing(value))


def found(path: Path) -> int | str | None:
    """The value of the whole recording at `path`, why there is none, or None where there is nothing."""
    if not path.exists():
        return None
    try:
        cube = np.asarray(Recording.load(path).cube)
    except InputError as error:
        return str(error)
    return int(cube[0, 0, 0].real) if (cube == cube[0, 0, 0]).all() else "mixed samples"


def picture(path: Path) -> int | str | None:
    """Whose picture lies beside it."""
    file = path.with_suffix(".png")
    text = file.read_text() if file.exists() else None
    return int(text) if text is not None and text.isdigit() else text


def start_writer(
    path: Path,
    value: int,
    *,
    overwrite: bool,
    first: Callable[..., None] | None = None,
    arguments: tuple[Any, ...] = (),
) -> ForkServerProcess:
    """A process that saves as the command line does; it calls `first` before."""
    options = {"path": path, "value": value, "overwrite": overwrite, "first": first, "arguments": arguments}
    process = CONTEXT.Process(target=_write, kwargs=options)
    process.start()
    return process


def _write(
    path: Path, value: int, overwrite: bool, first: Callable[..., None] | None, arguments: tuple[Any, ...]
) -> None:
    def run(_: list[str]) -> int:
        if first is not None:
            first(*arguments)
        save(path, value, overwrite=overwrite)
        return 0

    cli._run = run
    sys.stderr = (path.parent / f"{value}.err").open("w", encoding="utf-8")
    sys.exit(cli.main(["simulate"]))


def sentence(path: Path, value: int) -> str:
    """What a writer said."""
    return (path.parent / f"{value}.err").read_text(encoding="utf-8")
