"""What the kinds of input share: an attempt, its judges, and odd values."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import re
import sys
import time
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.errors import T2DError, T2DWarning

T = TypeVar("T")

MOTIONS = Path(__file__).parents[3] / "examples" / "motions"
QUICK_RADAR = {"samples": 32, "prf_hz": 2000}
"""Changes to the preset ci4r that make a run short."""
LONGEST_SENTENCE = 3000
"""More letters are no sentence."""
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Control characters but tab and line feed: a terminal obeys them."""
PROGRESS = re.compile(r"^\w+ +\d+% \|.*$")
"""A progress bar."""


class Wrong(Exception):
    """What a run did and should not have done."""


class Refused(T2DError):
    """The sentence with which the command line refused."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """One input, made, and what is to be done with it."""

    told: str
    """The call or the command, in a line."""
    act: Callable[[], object]
    """Does it: returns, or raises T2DError where the input is refused, Wrong where the outcome is known to be wrong."""


def random_source(seed: int, kind: str, number: int) -> np.random.Generator:
    """The random numbers of one input: they follow from the seed, its kind and its number alone."""
    return np.random.default_rng([seed, zlib.crc32(kind.encode()), number])


def pick(rng: np.random.Generator, values: Sequence[T]) -> T:
    """One of the values."""
    return values[int(rng.integers(len(values)))]


def chance(rng: np.random.Generator, probability: float) -> bool:
    """True with that probability."""
    return bool(rng.random() < probability)


# --- judges ---------------------------------------------------------------------------------------------------------


def check_text(text: str, *, what: str, lines: int | None = None) -> None:
    """No control characters, no traceback, no warning of NumPy in what a user reads."""
    found = CONTROL.search(text)
    if found:
        raise Wrong(
            f"{what} holds the control character {found[0]!r}: {text[max(0, found.start() - 60) : found.end() + 20]!r}"
        )
    if "Traceback (most recent call last)" in text:
        raise Wrong(f"{what} holds a traceback: {text[-600:]!r}")
    if re.search(r"encountered in|RuntimeWarning|DeprecationWarning|FutureWarning", text):
        raise Wrong(f"{what} holds a raw warning: {text[:300]!r}")
    if lines is not None and len(text.splitlines()) != lines:
        raise Wrong(f"{what} has {len(text.splitlines())} lines, expected {lines}: {text[:300]!r}")


def check_sentence(sentence: str) -> None:
    """An error is one sentence that is not empty."""
    if not sentence.strip():
        raise Wrong("the error has no sentence")
    if len(sentence) > LONGEST_SENTENCE:
        raise Wrong(f"the error has {len(sentence)} letters: {sentence[:200]!r}")
    check_text(sentence, what="the error", lines=1)


def check_finite(value: Any, what: str) -> None:
    """Numbers without NaN and infinity."""
    numbers = np.asarray(value)
    if numbers.dtype.kind in "fc" and not np.isfinite(numbers).all():
        raise Wrong(f"{what} holds NaN or infinite values")


def check_motion(motion: Any) -> None:
    """A motion that can be used: finite, and its report can be printed."""
    check_finite(motion.joints, "joints")
    check_finite(motion.rotations, "rotations")
    check_text(motion.report, what="the motion's report", lines=1 if motion.report else 0)


def check_recording(result: Any) -> None:
    """A recording with finite samples and spectrogram."""
    check_finite(result.adc.values, "the ADC cube")
    check_finite(result.spectrogram.values, "the spectrogram")


def check_picture(path: Path) -> None:
    """A whole PNG."""
    data = path.read_bytes()
    if not (data.startswith(b"\x89PNG\r\n\x1a\n") and data.rstrip(b"\0").endswith(b"IEND\xaeB`\x82")):
        raise Wrong(f"{path.name} is not a whole PNG")


@contextlib.contextmanager
def no_raw_warnings() -> Iterator[None]:
    """Warnings of this package pass; any other that a user would see is wrong."""
    seen: list[str] = []

    def note(message: Warning | str, category: type[Warning], file: str, line: int, *_: Any) -> None:
        if not issubclass(category, T2DWarning):
            seen.append(f"{category.__name__} at {Path(file).name}:{line}: {message}")
        else:
            check_sentence(str(message))

    with warnings.catch_warnings():
        warnings.simplefilter("always", T2DWarning)
        warnings.showwarning = note  # type: ignore[assignment]
        yield
    if seen:
        raise Wrong(f"a raw warning: {seen[0]}")


@contextlib.contextmanager
def untouched(*folders: Path) -> Iterator[None]:
    """Nothing in these folders may be opened meanwhile (inotify)."""
    libc = ctypes.CDLL(None, use_errno=True)
    watch = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
    for folder in folders:
        libc.inotify_add_watch(watch, os.fsencode(folder), 0x20 | 0x1)  # opened, read
    try:
        yield
    finally:
        opened = []
        with contextlib.suppress(BlockingIOError):
            events = os.read(watch, 65536)
            while events:
                length = int.from_bytes(events[12:16], sys.byteorder)
                mask = int.from_bytes(events[4:8], sys.byteorder)
                if not mask & 0x40000000:  # a folder may be listed
                    opened.append(events[16 : 16 + length].rstrip(b"\0").decode(errors="replace"))
                events = events[16 + length :]
        os.close(watch)
        if opened:
            raise Wrong(f"a file that is none of the input's was opened: {opened[0]}")


# --- the command line -----------------------------------------------------------------------------------------------


def command(arguments: Sequence[str], *, ascii_only: bool = False) -> Callable[[], str]:
    """Runs one command as the shell's `t2d-rt` would; gives what it printed."""

    def act() -> str:
        out, err = (
            io.TextIOWrapper(io.BytesIO(), encoding="ascii" if ascii_only else "utf-8", errors=errors)
            for errors in ("strict", "backslashreplace")  # as the interpreter opens stdout and stderr
        )
        code = _run(arguments, out, err)
        out.flush()
        err.flush()
        printed, told = (each.buffer.getvalue().decode() for each in (out, err))  # type: ignore[attr-defined]
        check_text(printed, what="what it printed")
        if not arguments and code == 2:
            check_text(told, what="the overview")
            raise Refused("no command: the overview")
        _check_told(told)
        if code == 2:
            last = [line for line in told.splitlines() if line and not line.startswith("t2d-rt: warning:")]
            if len(last) != 1:
                raise Wrong(f"exit code 2 with {len(last)} lines: {told[:400]!r}")
            check_sentence(last[0].removeprefix("t2d-rt:"))
            raise Refused(last[0])
        if code != 0:
            raise Wrong(f"exit code {code}: {told[-400:]!r}")
        return printed

    return act


def _run(arguments: Sequence[str], out: Any, err: Any) -> int:
    from t2d_rt.cli import main

    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = out, err
    try:
        return main(list(arguments))
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    finally:
        sys.stdout, sys.stderr = before


def _check_told(text: str) -> None:
    """Every line on stderr is one of this program's, in plain characters."""
    lines = [line for part in text.split("\n") for line in part.split("\r")]
    lines = [line for line in lines if line.strip() and not PROGRESS.match(line)]
    for line in lines:
        check_text(line, what="stderr")
        if not line.startswith("t2d-rt:"):
            raise Wrong(f"a foreign line on stderr: {line[:300]!r}")


def listing(folder: Path) -> dict[str, tuple[int, int]]:
    """Names below a folder, with times and sizes."""
    return {
        str(p.relative_to(folder)): (p.lstat().st_mtime_ns, p.lstat().st_size)
        for p in folder.rglob("*")
        if not p.is_dir()
    }


def changed_since(before: dict[str, tuple[int, int]], folder: Path) -> list[str]:
    """Names of files that came, went or changed since a listing."""
    after = listing(folder)
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


def leaving_nothing(act: Callable[[], T], folder: Path) -> Callable[[], T]:
    """The same, wrong where a refusal leaves files behind or changes some."""

    def checked() -> T:
        before = listing(folder)
        try:
            return act()
        except T2DError as error:
            if changed := changed_since(before, folder):
                raise Wrong(f"refused ({str(error)[:200]}), but {changed[0]} was left or changed") from None
            raise

    return checked


def writing_only(act: Callable[[], T], folder: Path, allowed: str) -> Callable[[], T]:
    """The same, wrong where it writes elsewhere below the folder than below `allowed`."""

    def checked() -> T:
        before = listing(folder)
        try:
            return act()
        finally:
            outside = [name for name in changed_since(before, folder) if not name.startswith(f"{allowed}/")]
            if outside:
                raise Wrong(f"{outside[0]} was written, outside {allowed}")

    return checked


def running(pid: int) -> bool:
    """Whether a process runs; one that nobody has waited for does not."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


def check_gone(pids: Sequence[int], seconds: float = 5.0) -> None:
    """No process of these is left after so much time."""
    end = time.monotonic() + seconds
    while left := [pid for pid in pids if running(pid)]:
        if time.monotonic() > end:
            raise Wrong(f"{len(left)} of {len(pids)} processes were left behind")
        time.sleep(0.02)


ODD: tuple[Any, ...] = (
    None, True, 0, -1, 1.5, 10**30, float("nan"), float("inf"), "", "x", "../../x", "/tmp/x", "a\0b", "\x1b[31m", "a" * 5000, [],
    {}, [[]], [1, 2, 3], {"a": 1},
)  # fmt: skip
"""Values in the place of others."""


def replaced(rng: np.random.Generator, values: Any) -> tuple[str, Any]:
    """Plain values of which one, at any depth, is another or is gone."""
    if isinstance(values, dict) and values:
        name = pick(rng, sorted(values))
        if chance(rng, 0.1):
            return f"{name} gone", {key: each for key, each in values.items() if key != name}
        told, value = replaced(rng, values[name])
        return f"{name} {told}", {**values, name: value}
    if isinstance(values, list) and values and chance(rng, 0.6):
        place = int(rng.integers(len(values)))
        told, value = replaced(rng, values[place])
        return f"[{place}] {told}", [*values[:place], value, *values[place + 1 :]]
    value = pick(rng, ODD)
    return f"= {value!r}"[:60], value


DEEP = "[" * 100_000 + "]" * 100_000
"""JSON that no recursive reader reaches the bottom of."""


# --- small inputs ---------------------------------------------------------------------------------------------------


def quick_radar(**changes: Any) -> Any:
    """A radar with few samples."""
    return t2d.Radar.preset("ci4r", **{**QUICK_RADAR, **changes})


def quick_walk() -> Any:
    """0.2 s of a step."""
    return t2d.trim(t2d.load_motion(MOTIONS / "momask_22j_120frames.bvh"), 1.0, 1.2)


def quick_ball(subdivisions: int = 1, x_m: float = 2.0) -> Any:
    """A metal sphere that comes nearer, 0.2 s."""
    import trimesh

    shape = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.1)
    times = np.array([0.0, 0.1, 0.2])
    centre = np.array([x_m, 0.0, 1.0]) - times[:, None, None] * [1.0, 0, 0]
    return t2d.MovingMesh(shape.vertices + centre, shape.faces, times, "pec", name="ball")


def corrupted(rng: np.random.Generator, data: bytes) -> tuple[str, bytes]:
    """Bytes damaged in one of the ways of disks, networks and editors."""
    place = int(rng.integers(len(data))) if data else 0
    length = int(rng.integers(1, 65))
    return pick(
        rng,
        [
            (f"byte {place} flipped",
            data[:place] + bytes([data[place] ^ (1 << int(rng.integers(8)))]) + data[place + 1 :] if data else b"x"),
            (f"cut at {place}", data[:place]),
            (f"{length} bytes gone at {place}", data[:place] + data[place + length :]),
            (f"{length} random bytes at {place}", data[:place] + rng.bytes(length) + data[place:]),
            (f"{length} bytes zero at {place}", data[:place] + bytes(length) + data[place + length :]),
            (f"{length} bytes twice at {place}", data[: place + length] + data[place:]),
            ("empty", b""),
            ("junk at the end", data + rng.bytes(length)),
        ],
    )  # fmt: skip
