"""A stream of echoes cut into windows: the frames that one piece of the sum needs, whatever the size of what is read at once."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from t2d_rt.radar.interpolants import spline_slopes
from t2d_rt.types import EchoArrays, EchoStream

INTERVALS = 32
"""Frame intervals of a window: how echoes are grouped is decided anew for each, so it must not depend on what is read at once."""
# A spline's end conditions fade by 0.268 per frame: 1e-7 after 12 frames.
HALO_FRAMES = 12
# Echoes x frames read at once, 24 bytes each.
READ_ECHO_FRAMES = 1_000_000


@dataclass(frozen=True, slots=True)
class Window:
    """Intervals start..stop of the L echoes that are not silent there, and one interval more at either end.

    n = stop - start; beyond the record echoes go on in straight lines.
    """

    start: int
    stop: int
    step_s: float
    """Frame interval."""
    delay: np.ndarray
    """[s], (n + 3, L)."""
    delay_slope: np.ndarray
    """[s per frame], (n + 3, L)."""
    amplitude: np.ndarray
    """complex64 (n + 5, L): one frame more at either end."""
    sweep: np.ndarray | None
    """Slope over frequency, likewise."""

    @property
    def lit(self) -> tuple[np.ndarray, np.ndarray]:
        """(interval, echo) of all echoes that are not dark in an interval, whose frames are four of the amplitude's."""
        lit = self.amplitude != 0
        return np.nonzero(lit[:-3] | lit[1:-2] | lit[2:-1] | lit[3:])  # type: ignore[return-value]


def windows(source: EchoStream, read_frames: int | None = None) -> Iterator[Window]:
    """All windows of the record; every frame is asked for once, the next ones while a window is worked on.

    `read_frames` is about how many frames are asked for at once.
    """
    total = len(source.times_s)
    step_s = float(source.times_s[-1] - source.times_s[0]) / (total - 1)
    held: list[tuple[int, EchoArrays]] = []
    asked = min(total, INTERVALS + 3 + HALO_FRAMES)
    come = 0
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(source.frames, 0, asked)
        for start in range(0, total - 1, INTERVALS):
            stop = min(start + INTERVALS, total - 1)
            low, high = max(0, start - 1 - HALO_FRAMES), min(total, stop + 2 + HALO_FRAMES)
            while high > come:
                held.append((come, coming.result()))
                come = asked
                if asked < total:
                    frames = read_frames or READ_ECHO_FRAMES // max(1, held[0][1][0].shape[1])
                    asked = min(total, asked + max(1, frames // INTERVALS) * INTERVALS)
                    coming = pool.submit(source.frames, come, asked)
            held = [part for part in held if part[0] + len(part[1][0]) > low]
            yield _window(held, low, high, start, stop, total, step_s)


def _window(
    held: list[tuple[int, EchoArrays]], low: int, high: int, start: int, stop: int, total: int, step_s: float
) -> Window:
    near = max(0, start - 2), min(total, stop + 3)
    lit = [part[1] != 0 for part in _rows(held, *near)]
    live = np.flatnonzero(np.any(np.concatenate(lit), axis=0))

    def taken(field: int, first: int, last: int) -> np.ndarray:
        return np.concatenate([np.take(part[field], live, axis=1) for part in _rows(held, first, last)])  # type: ignore[arg-type]

    def with_ends(field: int) -> np.ndarray:
        # The line through the record's last two frames makes the central difference there the one-sided one.
        return _lengthened(taken(field, *near), near[0] - (start - 2), stop + 3 - near[1])

    delay = taken(0, low, high)
    slope = spline_slopes(len(delay)) @ delay
    keep = slice(max(0, start - 1) - low, min(total, stop + 2) - low)
    delay, slope = delay[keep], slope[keep]
    if start == 0:
        delay, slope = np.concatenate([delay[:1] - slope[:1], delay]), np.concatenate([slope[:1], slope])
    if stop == total - 1:
        delay, slope = np.concatenate([delay, delay[-1:] + slope[-1:]]), np.concatenate([slope, slope[-1:]])
    return Window(
        start=start,
        stop=stop,
        step_s=step_s,
        delay=delay,
        delay_slope=slope,
        amplitude=with_ends(1),
        sweep=None if held[0][1][2] is None else with_ends(2),
    )


def _lengthened(values: np.ndarray, before: int, after: int) -> np.ndarray:
    """`values` (T, N) with `before` and `after` frames more, on the lines through the first two and the last two."""
    steps = np.arange(before, 0, -1, dtype=np.float32)[:, None], np.arange(1, after + 1, dtype=np.float32)[:, None]
    head, tail = (
        values[:1] + steps[0] * (values[:1] - values[1:2]),
        values[-1:] + steps[1] * (values[-1:] - values[-2:-1]),
    )
    return np.ascontiguousarray(np.concatenate([head, values, tail]))


def _rows(held: list[tuple[int, EchoArrays]], first: int, last: int) -> list[EchoArrays]:
    """Frames first..last-1 of what is held, as views."""
    found = []
    for begin, (delay, amplitude, slope) in held:
        cut = slice(max(first - begin, 0), max(last - begin, 0))
        if begin < last and cut.start < len(delay):
            found.append((delay[cut], amplitude[cut], None if slope is None else slope[cut]))
    return found
