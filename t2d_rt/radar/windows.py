"""What the sum is given: echoes behind the IF filter, in windows, the frames that one piece of it needs whatever a block's size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.memory import reused_empty
from t2d_rt.radar.interpolants import spline_slopes
from t2d_rt.types import EchoArrays, Radar

INTERVALS = 32
"""Frame intervals of a window: how echoes are grouped is decided anew for each, so it must not depend on what is read at once."""
HALO_FRAMES = 12
"""A spline's end conditions fade by 0.268 per frame: 1e-7 after 12 frames."""
READ_ECHO_FRAMES = 2_000_000
"""Echoes x frames of a block, 24 bytes each."""
READ_VERTEX_FRAMES = 8_000_000
"""Vertices x frames that these are made from, 16 bytes each."""
LEAST_FRAMES = 4
"""Blocks of very large meshes have at least so many frames."""

Delay = tuple[np.ndarray, np.ndarray]
"""[s] and its slope [s per frame], both (n + 3, N)."""


@dataclass(frozen=True, slots=True)
class ApparentPositions:
    """Apparent positions of echoes, float32 (3, n + 3, L)."""

    points_m: np.ndarray
    steps_m: np.ndarray
    """How that changes [m per frame]."""

    def mean(self, mean: Any) -> ApparentPositions:
        """Mean positions of groups; `mean` is sparse, (L, K)."""
        points, steps = (
            (values.reshape(-1, values.shape[-1]) @ mean).reshape(*values.shape[:2], -1)
            for values in (self.points_m, self.steps_m)
        )
        return ApparentPositions(points, steps)


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
    """Delays [s], (n + 3, L)."""
    delay_slope: np.ndarray
    """Slopes of the delays [s per frame], (n + 3, L)."""
    amplitude: np.ndarray
    """complex64 (n + 5, L): one frame more at either end."""
    sweep: np.ndarray | None
    """Slope over frequency, likewise."""
    lit: tuple[np.ndarray, np.ndarray]
    """(interval, echo) of all echoes that are not dark in an interval, whose frames are four of the amplitude's."""
    apparent: tuple[ApparentPositions, ApparentPositions] | None
    """Apparent positions for transmitters and for receivers."""
    part: np.ndarray | None = None
    """Number of the part of the recording that each echo belongs to, (L,); -1 is none, and its amplitude 0."""


class Windows:
    """Blocks of echoes in, windows out; a window needs some frames more on either side."""

    def __init__(self, times_s: np.ndarray, part: np.ndarray | None = None) -> None:
        """`times_s`: the record's surface frames [s] (T,); `part`: number of the part that each echo belongs to, -1 is none."""
        self._part, self._frames = part, len(times_s)
        self.step_s = float(times_s[-1] - times_s[0]) / (self._frames - 1)
        self._held: list[tuple[int, EchoArrays]] = []
        self._start = 0

    def add(self, first: int, echoes: EchoArrays) -> Iterator[Window]:
        """The windows that are complete with echoes from frame `first` on, which is the one after those given before."""
        if self._part is not None and len(self._part) != echoes.delay_s.shape[1]:
            raise ValueError(f"{len(self._part)} echoes have parts and {echoes.delay_s.shape[1]} came")
        self._held.append((first, echoes))
        come = first + len(echoes.delay_s)
        while self._start < self._frames - 1:
            start, stop = self._start, min(self._start + INTERVALS, self._frames - 1)
            low, high = max(0, start - 1 - HALO_FRAMES), min(self._frames, stop + 2 + HALO_FRAMES)
            if high > come:
                return
            self._held = [part for part in self._held if part[0] + len(part[1].delay_s) > low]
            self._start = stop
            yield _window(self._held, low, high, start, stop, self._frames, self.step_s, self._part)


def filtered(echoes: EchoArrays, radar: Radar) -> EchoArrays:
    """Echoes behind the IF filter, ideal from 0 to the sample rate: those whose beat frequency S tau lies beyond are silent.

    The filter falls over the last range bin, so that echoes that move out of range fade, as they leave bin after bin.
    """
    last_s = radar.sample_rate_hz / radar.slope_hz_per_s
    if not echoes.delay_s.size or echoes.delay_s.max() <= last_s - 1 / radar.bandwidth_hz:
        return echoes
    gain = np.clip((last_s - echoes.delay_s) * radar.bandwidth_hz, 0, 1).astype(np.float32)
    slope = None if echoes.slope is None else echoes.slope * gain
    return echoes._replace(amplitude=echoes.amplitude * gain, slope=slope)


def block_end(
    first: int, frames: int, *, echoes: int, vertices: int = 0, at_once: int = 0, read_frames: int | None = None
) -> int:
    """The frame after the last of the block that begins with frame `first` of a record: as many as fit a fixed amount of memory.

    `vertices` make the `echoes` of a frame, `at_once` is the greatest number of frames that may be asked for, 0 for any, and
    `read_frames` about how many a block shall have.
    """
    most = max(LEAST_FRAMES, READ_VERTEX_FRAMES // max(1, vertices))
    most = min(most, at_once or most)
    head = INTERVALS + 3 + HALO_FRAMES  # as many as the first window needs
    if first >= head:
        fit = min(READ_ECHO_FRAMES // max(1, echoes), READ_VERTEX_FRAMES // max(1, vertices))
        head = first + max(1, (read_frames or fit) // INTERVALS) * INTERVALS
    return min(frames, head, first + most)


def _window(
    held: list[tuple[int, EchoArrays]],
    low: int,
    high: int,
    start: int,
    stop: int,
    total: int,
    step_s: float,
    part: np.ndarray | None,
) -> Window:
    """The window of intervals start..stop, from frames low..high of the blocks held; the record has `total` frames."""
    near = max(0, start - 2), min(total, stop + 3)
    live = np.flatnonzero(np.any([np.any(part.amplitude, axis=0) for part in _rows(held, *near)], axis=0))
    # The line through the record's last two frames makes the central difference there the one-sided one.
    before, after = near[0] - (start - 2), stop + 3 - near[1]
    amplitude, sweep = (
        None
        if held[0][1][field] is None
        else _lengthened(_taken(held, field, live, *near, before, after), before, after)
        for field in (1, 2)
    )
    assert amplitude is not None
    if part is not None:  # silent echoes are grouped with the others, so that groups do not depend on which are silent
        part = part[live]
        for column in (amplitude, sweep):
            if column is not None:
                column[:, part < 0] = 0
    lit = amplitude != 0
    frames = slice(max(0, start - 1) - low, min(total, stop + 2) - low), start == 0, stop == total - 1
    delay, delay_slope = _with_slopes(_taken(held, 0, live, low, high), *frames)
    places = []
    sample = held[0][1]
    for field in (3, 4) if sample.departure_m is not None else ():
        if sample[field] is not None:
            points = _taken(held, field, live, low, high)
            values, steps = zip(*(_with_slopes(points[..., axis], *frames) for axis in range(3)), strict=True)
            places.append(ApparentPositions(np.stack(values), np.stack(steps)))
    return Window(
        start=start,
        stop=stop,
        step_s=step_s,
        delay=delay,
        delay_slope=delay_slope,
        amplitude=amplitude,
        sweep=sweep,
        lit=np.nonzero(lit[:-3] | lit[1:-2] | lit[2:-1] | lit[3:]),  # type: ignore[arg-type]
        apparent=(places[0], places[-1]) if places else None,
        part=part,
    )


def _with_slopes(values: np.ndarray, keep: slice, begins: bool, ends: bool) -> tuple[np.ndarray, np.ndarray]:
    """Values at the frames `keep` and their slopes there, one frame more, on a straight line, where the record begins or ends."""
    matrix = spline_slopes(len(values))[keep].astype(values.dtype)
    slope = np.matmul(matrix, values, out=reused_empty((len(matrix), values.shape[1]), values.dtype))
    values = values[keep]
    if begins:
        values, slope = np.concatenate([values[:1] - slope[:1], values]), np.concatenate([slope[:1], slope])
    if ends:
        values, slope = np.concatenate([values, values[-1:] + slope[-1:]]), np.concatenate([slope, slope[-1:]])
    return values, slope


def _taken(
    held: list[tuple[int, EchoArrays]],
    field: int,
    live: np.ndarray,
    first: int,
    last: int,
    before: int = 0,
    after: int = 0,
) -> np.ndarray:
    """A field of live echoes at frames first..last-1, with room for more frames before and after."""
    parts: list[Any] = [part[field] for part in _rows(held, first, last)]
    out = reused_empty((before + last - first + after, len(live), *parts[0].shape[2:]), parts[0].dtype)
    row = before
    for part in parts:
        np.take(part, live, axis=1, out=out[row : row + len(part)], mode="clip")  # "raise" would copy once more
        row += len(part)
    return out


def _lengthened(values: np.ndarray, before: int, after: int) -> np.ndarray:
    """`values` (T, N), whose first `before` and last `after` frames are written: on the lines through the two next to them."""
    last = len(values) - 1 - after
    if before:
        steps = np.arange(before, 0, -1, dtype=np.float32)[:, None]
        values[:before] = values[before] + steps * (values[before] - values[before + 1])
    if after:
        steps = np.arange(1, after + 1, dtype=np.float32)[:, None]
        values[last + 1 :] = values[last] + steps * (values[last] - values[last - 1])
    return values


def _rows(held: list[tuple[int, EchoArrays]], first: int, last: int) -> list[EchoArrays]:
    """Frames first..last-1 of what is held, as views."""
    rows = []
    for begin, fields in held:
        cut = slice(max(first - begin, 0), max(last - begin, 0))
        if begin < last and cut.start < len(fields.delay_s):
            rows.append(EchoArrays(*(None if field is None else field[cut] for field in fields)))  # type: ignore[arg-type]
    return rows
