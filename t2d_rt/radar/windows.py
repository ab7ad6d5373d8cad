"""Input of the synthesis: echoes after the IF filter, in windows of frames that do not depend on the size of the blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.memory import reused_empty
from t2d_rt.radar.interpolants import spline_slopes
from t2d_rt.types import EchoArrays, Radar

INTERVALS = 32
"""Frame intervals of a window. Echoes are grouped anew in each window, so its length must not depend on how many frames are read at
once."""
HALO_FRAMES = 12
"""Additional frames at either end of a window: the influence of a spline's end conditions falls by 0.268 per frame, to 1e-7 after
12 frames."""
READ_ECHO_FRAMES = 2_000_000
"""Greatest number of echoes times frames in a block, at 24 bytes each."""
READ_VERTEX_FRAMES = 8_000_000
"""Greatest number of vertices times frames in a block, at 16 bytes each."""
LEAST_FRAMES = 4
"""Least number of frames in a block, whatever the size of a mesh."""

Delay = tuple[np.ndarray, np.ndarray]
"""Delays [s] and their slopes [s per frame], (n + 3, N) each."""


@dataclass(frozen=True, slots=True)
class ApparentPositions:
    """Apparent positions of echoes [m], float32 (3, n + 3, L)."""

    points_m: np.ndarray
    steps_m: np.ndarray
    """Change of the positions per frame [m], (3, n + 3, L)."""

    def mean(self, mean: Any) -> ApparentPositions:
        """Mean apparent positions of groups; `mean` is the sparse matrix (L, K) of the averages."""
        points, steps = (
            (values.reshape(-1, values.shape[-1]) @ mean).reshape(*values.shape[:2], -1)
            for values in (self.points_m, self.steps_m)
        )
        return ApparentPositions(points, steps)


@dataclass(frozen=True, slots=True)
class Window:
    """Echoes in the frame intervals start..stop, and in one more interval at either end; L echoes, without those that are silent in
    all of them.

    n = stop - start; beyond the record echoes continue on straight lines.
    """

    start: int
    stop: int
    step_s: float
    """Frame interval [s]."""
    delay: np.ndarray
    """Delays [s], (n + 3, L)."""
    delay_slope: np.ndarray
    """Slopes of the delays [s per frame], (n + 3, L)."""
    amplitude: np.ndarray
    """Amplitudes [sqrt(W)], complex64 (n + 5, L): one more frame at either end than the delays."""
    sweep: np.ndarray | None
    """Slopes of the amplitudes over frequency, in the same shape; None where there are none."""
    lit: tuple[np.ndarray, np.ndarray]
    """Indices of interval and echo, for all pairs of them in which any of the four frames that determine the amplitude is not 0."""
    apparent: tuple[ApparentPositions, ApparentPositions] | None
    """Apparent positions for transmitters and for receivers; None where they are not known."""
    part: np.ndarray | None = None
    """Index of the part of the recording to which each echo belongs, (L,); -1 for an echo that is left out, whose amplitude is set
    to 0."""


class Windows:
    """Turns blocks of echoes into windows, which also need some frames before and after them."""

    def __init__(self, times_s: np.ndarray, part: np.ndarray | None = None) -> None:
        """`times_s`: surface frames of the record [s] (T,). `part`: index of the part to which each echo belongs, -1 for none."""
        self._part, self._frames = part, len(times_s)
        self.step_s = float(times_s[-1] - times_s[0]) / (self._frames - 1)
        self._held: list[tuple[int, EchoArrays]] = []
        self._start = 0

    def add(self, first: int, echoes: EchoArrays) -> Iterator[Window]:
        """Takes the echoes at frames from `first` on, which must follow those before, and gives the windows that are then
        complete."""
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
    """Echoes after an ideal IF filter from 0 to the sample rate: those whose beat frequency S tau lies outside are silent.

    The filter falls to 0 over the last range bin, so that echoes that move out of range fade instead of stopping abruptly.
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
    """Index after the last frame of the block that begins with frame `first` of a record; a block has as many frames as fit a fixed
    amount of memory.

    echoes, vertices: number in each frame.
    at_once: greatest number of frames that may be computed at once, 0 for any.
    read_frames: about how many frames a block shall have.
    """
    most = max(LEAST_FRAMES, READ_VERTEX_FRAMES // max(1, vertices))
    most = min(most, at_once or most)
    head = INTERVALS + 3 + HALO_FRAMES  # the first block has all frames that the first window needs
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
    """The window of intervals start..stop, from frames low..high of the blocks `held`; the record has `total` frames."""
    near = max(0, start - 2), min(total, stop + 3)
    live = np.flatnonzero(np.any([np.any(part.amplitude, axis=0) for part in _rows(held, *near)], axis=0))
    # Beyond the record's ends, frames on straight lines make the central differences there one-sided.
    before, after = near[0] - (start - 2), stop + 3 - near[1]
    amplitude, sweep = (
        None
        if held[0][1][field] is None
        else _lengthened(_taken(held, field, live, *near, before, after), before, after)
        for field in (1, 2)
    )
    assert amplitude is not None
    if part is not None:  # echoes that are left out are grouped with the others, so that groups do not depend on them
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
    """Values at the frames `keep` and their slopes there. Where the record begins or ends, one more frame is added on a straight
    line."""
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
    """One field of the echoes `live` at frames first..last-1, with uninitialised room for frames before and after."""
    parts: list[Any] = [part[field] for part in _rows(held, first, last)]
    out = reused_empty((before + last - first + after, len(live), *parts[0].shape[2:]), parts[0].dtype)
    row = before
    for part in parts:
        np.take(part, live, axis=1, out=out[row : row + len(part)], mode="clip")  # mode "raise" would copy once more
        row += len(part)
    return out


def _lengthened(values: np.ndarray, before: int, after: int) -> np.ndarray:
    """`values` (T, N) with its first `before` and last `after` frames filled in: on straight lines through the two frames next to
    them."""
    last = len(values) - 1 - after
    if before:
        steps = np.arange(before, 0, -1, dtype=np.float32)[:, None]
        values[:before] = values[before] + steps * (values[before] - values[before + 1])
    if after:
        steps = np.arange(1, after + 1, dtype=np.float32)[:, None]
        values[last + 1 :] = values[last] + steps * (values[last] - values[last - 1])
    return values


def _rows(held: list[tuple[int, EchoArrays]], first: int, last: int) -> list[EchoArrays]:
    """Views of the arrays that are held, for frames first..last-1."""
    rows = []
    for begin, fields in held:
        cut = slice(max(first - begin, 0), max(last - begin, 0))
        if begin < last and cut.start < len(fields.delay_s):
            rows.append(EchoArrays(*(None if field is None else field[cut] for field in fields)))  # type: ignore[arg-type]
    return rows
