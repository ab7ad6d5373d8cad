"""Each input in a process of its own, forked from one that has imported everything and computed nothing; limits and outcomes."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import math
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import IO

from t2d_rt.core.errors import T2DError
from validation.robustness.fuzz.case import Wrong, check_sentence, random_source

SECONDS = 10.0
"""Of the processor, with which nothing depends on what else the machine does."""
WAITING = 6.0
"""Times as long by the clock, for what waits and needs no processor."""
MEGABYTES = 2048
ADDRESS_BYTES = 12 * 2**30
"""Of the address space: LLVM and Mitsuba map more than they use, and a bomb must not take the machine."""
FILE_BYTES = 2**30
POLL_S = 0.02
KINDS = (
    "bvh", "radar_yaml", "scene_xml", "recording_zarr", "command_line", "api_calls", "api_values", "shards", "result_files",
    "endpoint", "momask", "trained", "dead_parents",
)  # fmt: skip
KEPT_BYTES = 4 * 2**20
"""Larger files of a failed input are not kept: it can be made again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How one input ended."""

    name: str
    """kind:number."""
    told: str = ""
    """The call or command."""
    problem: str = ""
    """traceback, crash, hang, memory, wrong or generator; nothing where it is good."""
    what: str = ""
    """The exception and its sentence; of a good one, the sentence of its refusal."""
    where: str = ""
    """The innermost function of the package."""
    seconds: float = 0.0
    """Of the processor."""
    megabytes: float = 0.0

    @property
    def defect(self) -> tuple[str, str, str]:
        """What outcomes of the same defect share."""
        kind = self.what.partition(":")[0] if self.problem == "traceback" else ""
        sentence = re.sub(r"[^a-z ]+", "", self.what.partition(":")[2 if self.problem != "wrong" else 0])[:40]
        return self.problem, kind, self.where or sentence


@dataclass(slots=True)
class Child:
    """A process at work."""

    name: str
    pid: int
    folder: Path
    started: float
    killed: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How inputs are made and run."""

    seed: int = 0
    jobs: int = 2
    """Inputs at a time."""
    seconds: float = SECONDS
    """Most of the processor's time of one."""
    megabytes: float = MEGABYTES
    """Most memory of one."""
    keep: Path | None = None
    """Folder for the files of those that failed."""


def outcomes(names: Sequence[str], settings: Settings) -> Iterator[Outcome]:
    """The outcomes of inputs, in the order in which they end."""
    ready({name.partition(":")[0] for name in names})
    waiting, working = list(names)[::-1], list[Child]()
    with tempfile.TemporaryDirectory(prefix="t2d-fuzz-") as place:
        while waiting or working:
            while waiting and len(working) < settings.jobs:
                working.append(_started(waiting.pop(), settings, Path(place)))
            time.sleep(POLL_S)
            for child in list(working):
                outcome = _polled(child, settings)
                if outcome is not None:
                    working.remove(child)
                    _clean_up(child, outcome, settings.keep)
                    yield outcome


def ready(kinds: Collection[str]) -> None:
    """Imports what inputs need. Nothing is computed: threads of Dr.Jit or zarr would not be there in the forked processes."""
    if not set(kinds) & set(KINDS):
        return
    from t2d_rt.core.backend import select

    select("cpu")  # chooses the LLVM library before Dr.Jit is imported; loads, but starts nothing
    for name in (
        "matplotlib.backends.backend_agg", "scipy.signal", "scipy.interpolate", "scipy.spatial", "trimesh", "xarray", "zarr",
        "jsonargparse", "yaml", "mitsuba", "sionna.rt", "tqdm", "t2d_rt.cli", "t2d_rt.simulate", "t2d_rt.recording.compare",
        "t2d_rt.plots.figures", "t2d_rt.dataset", "t2d_rt.dataset.worker",
    ):  # fmt: skip
        import_module(name)
    if "trained" in kinds:
        import_module("torch")
    if "endpoint" in kinds:
        import_module("openai")
    for name in kinds:
        import_module(f"validation.robustness.fuzz.{name}")


def _started(name: str, settings: Settings, place: Path) -> Child:
    folder = Path(tempfile.mkdtemp(prefix=name.replace(":", "-") + "-", dir=place))
    sys.stdout.flush(), sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        try:
            _child(name, settings, folder)
        finally:
            os._exit(70)
    return Child(name, pid, folder, time.perf_counter())


def _polled(child: Child, limits: Settings) -> Outcome | None:
    """The outcome of a child that has ended; one beyond its limits is stopped."""
    pid, status, usage = os.wait4(child.pid, os.WNOHANG)
    if pid == 0:
        if not child.killed:
            if time.perf_counter() - child.started > WAITING * limits.seconds:
                child.killed = "hang"
            elif _resident_mb(child.pid) > limits.megabytes:
                child.killed = "memory"
                with contextlib.suppress(ProcessLookupError):
                    os.kill(child.pid, signal.SIGUSR1)  # writes where it is
                time.sleep(0.05)
            if child.killed:
                _kill(child.pid)
        return None
    _kill(child.pid)  # processes that it may have left
    seconds, megabytes = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
    if seconds > limits.seconds:
        child.killed = child.killed or "hang"
    told = _read(child.folder / "told.txt")
    end = {"seconds": seconds, "megabytes": megabytes, "name": child.name, "told": told}
    if child.killed or megabytes > limits.megabytes:
        problem = child.killed or "memory"
        what = f"{megabytes:.0f} MB"
        if problem == "hang":
            what = f"{seconds:.1f} s of the processor, {time.perf_counter() - child.started:.1f} s by the clock"
        return Outcome(problem=problem, what=what, where=_where(_read(child.folder / "stack.txt")), **end)
    try:
        found = json.loads(_read(child.folder / "outcome.json"))
    except ValueError:
        code = f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else f"exit code {os.WEXITSTATUS(status)}"
        return Outcome(problem="crash", what=code, where=_where(_read(child.folder / "stack.txt")), **end)
    return Outcome(**found, **end)


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def _resident_mb(pid: int) -> float:
    with contextlib.suppress(OSError, ValueError, IndexError):
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return pages * resource.getpagesize() / 2**20
    return 0.0


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="backslashreplace") if path.is_file() else ""


def _where(stack: str) -> str:
    """The innermost function of the package in a stack of faulthandler, which begins with the innermost."""
    found = re.search(r'File "[^"]*/(t2d_rt/[^"]+)", line \d+ in (\w+)', stack)
    return f"{found[1]} {found[2]}" if found else ""


def _clean_up(child: Child, outcome: Outcome, keep: Path | None) -> None:
    """Removes a child's files; those of a failed one go to `keep`."""
    if outcome.problem and keep is not None:
        place = keep / child.name.replace(":", "-")
        shutil.rmtree(place, ignore_errors=True)
        with contextlib.suppress(OSError, shutil.Error):
            shutil.copytree(child.folder, place, symlinks=True, ignore=_left_out)
        place.mkdir(parents=True, exist_ok=True)
        (place / "outcome.json").write_text(json.dumps(asdict(outcome), indent=1), encoding="utf-8")
    shutil.rmtree(child.folder, ignore_errors=True)


def _left_out(folder: str, names: list[str]) -> list[str]:
    paths = [Path(folder) / name for name in names]
    return [
        p.name for p in paths
        if not p.is_symlink() and not p.is_dir() and not (p.is_file() and p.stat().st_size < KEPT_BYTES)
    ]  # fmt: skip


# --- in the child ---------------------------------------------------------------------------------------------------


def _child(name: str, settings: Settings, folder: Path) -> None:
    kind, _, number = name.partition(":")
    here = folder / "here"
    here.mkdir()
    stack = _limited(folder, settings.seconds)
    found: dict[str, str]
    try:
        attempt = import_module(f"validation.robustness.fuzz.{kind}").attempt(
            random_source(settings.seed, kind, int(number)), here
        )
        (folder / "told.txt").write_text(attempt.told, encoding="utf-8", errors="backslashreplace")
    except BaseException as error:
        traceback.print_exc()
        found = {"problem": "generator", "what": f"{type(error).__name__}: {error}", "where": ""}
    else:
        found = _judged(attempt.act)
    faulthandler.cancel_dump_traceback_later()
    stack.flush()
    sys.stdout.flush(), sys.stderr.flush()
    (folder / "outcome.json").write_text(json.dumps(found), encoding="utf-8")
    os._exit(0)


def _limited(folder: Path, seconds: float) -> IO[str]:
    """A process group and limits of its own, files for what it prints; stdin is closed."""
    os.setsid()
    os.chdir(folder / "here")
    (folder / "tmp").mkdir()
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder / "tmp")
    for limit, value in (
        (resource.RLIMIT_AS, ADDRESS_BYTES), (resource.RLIMIT_FSIZE, FILE_BYTES), (resource.RLIMIT_CORE, 0),
    ):  # fmt: skip
        resource.setrlimit(limit, (value, value))
    end_s = math.ceil(seconds) + 1
    resource.setrlimit(
        resource.RLIMIT_CPU, (end_s, end_s + 2)
    )  # SIGXCPU, and SIGKILL if it writes its stack for too long
    os.close(0)
    printed = os.open(folder / "printed.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    os.dup2(printed, 1), os.dup2(printed, 2)
    stack = (folder / "stack.txt").open("w")
    faulthandler.enable(stack)
    faulthandler.register(signal.SIGUSR1, stack)
    faulthandler.register(signal.SIGXCPU, stack, chain=True)  # writes where it is, and ends
    faulthandler.dump_traceback_later(0.95 * WAITING * seconds, file=stack)
    return stack


def _judged(act: Callable[[], object]) -> dict[str, str]:
    """What came of it."""
    try:
        act()
    except T2DError as error:
        try:
            check_sentence(str(error))
        except Wrong as wrong:
            return {"problem": "wrong", "what": str(wrong), "where": _frame(error)}
        if "not enough memory" in str(error):
            return {"problem": "memory", "what": str(error), "where": _frame(error)}
        return {"problem": "", "what": str(error), "where": ""}
    except Wrong as wrong:
        return {"problem": "wrong", "what": str(wrong), "where": _frame(wrong)}
    except MemoryError as error:
        traceback.print_exc()
        return {"problem": "memory", "what": f"MemoryError: {error}", "where": _frame(error)}
    except BaseException as error:
        traceback.print_exc()
        return {
            "problem": "traceback",
            "what": f"{type(error).__name__}: {' '.join(str(error).split())[:400]}",
            "where": _frame(error),
        }
    return {"problem": "", "what": "", "where": ""}


def _frame(error: BaseException) -> str:
    """The innermost function of the package that the error came through."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/t2d_rt/" in frame.filename]
    return f"t2d_rt/{frames[-1].filename.rpartition('/t2d_rt/')[2]} {frames[-1].name}" if frames else ""
