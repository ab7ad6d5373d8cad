"""Echoes of a periodic target such as a fan: a few periods are summed, and every chirp of the record is interpolated from these.

What a chirp records of a rotor depends only on the angle of the rotor when the chirp begins; motion within the chirp is included.
Chirps of a few periods that begin at equal steps of the angle form a table. Between the steps the record is a band-limited periodic
function of the angle, which is interpolated with a Kaiser-Bessel window as in non-uniform Fourier transforms (Fessler and Sutton,
2003).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.cube_storage import ScratchFile
from t2d_rt.core.cubes import Cube, CubeAdder, new_cube
from t2d_rt.core.factored_cubes import PIECE_CHIRPS, ProductRows
from t2d_rt.core.memory import MemoryLimit
from t2d_rt.radar.synthesize import Progress, synthesize
from t2d_rt.types import Radar
from t2d_rt.types.echoes import Repetition
from t2d_rt.types.scatterer import EchoParts, Scatterer

TAPS, OVERSAMPLING = 6, 2
"""Taps of the interpolation, and its oversampling; its error is below -90 dB."""
BAND = 1.25
"""Number of steps of the table relative to what the fastest points need."""
END_FRAMES = 6
"""Surface frames beyond the table at both of its ends, which the splines there need."""
LEAST_GAIN = 3.0
"""A table is used where the record is longer by at least this factor than the table."""
ROWS_AT_ONCE = 4_096
"""Number of rows of the record that are interpolated at once."""
TABLE_BYTES = 256e6
"""Greatest size of a table, with oversampling [bytes]."""


def repetition(
    radar: Radar, period_s: float, speed_mps: float, frame_rate_hz: float, span_s: tuple[float, float]
) -> Repetition | None:
    """Chooses the table for points of that greatest speed; None where the record is too short for it to save work, where it would
    exceed `TABLE_BYTES`, and with "ddm".

    Chirps do not overlap, so a single period seldom has enough of them. Several periods have, since their chirps begin at different
    angles.
    """
    row_rate_hz = 1 / (radar.sweep_time_s * radar.loop_chirps)
    shortest_m = SPEED_OF_LIGHT / (radar.mid_frequency_hz + radar.bandwidth_hz / 2)
    least = math.ceil(BAND * 4 * speed_mps / shortest_m * period_s) + 4 * TAPS
    periods = math.ceil(least / (row_rate_hz * period_s))
    while (rows := _coprime(math.floor(periods * period_s * row_rate_hz), periods)) < least:
        periods += 1
    step_s = periods * period_s / rows
    first = math.ceil(END_FRAMES / frame_rate_hz / step_s)
    timed = radar.replace(prf_hz=radar.loop_chirps / step_s, chirps_per_frame=None, frame_interval_s=None)
    table = Repetition(period_s=period_s, span_s=span_s, radar=timed, first=first, rows=rows, periods=periods)
    # With "ddm", the phase of the transmitters changes from row to row of the record, so no table can serve.
    worth = span_s[1] - span_s[0] > LEAST_GAIN * duration_s(table, frame_rate_hz) and radar.multiplexing != "ddm"
    return table if worth and 8.0 * OVERSAMPLING * rows * radar.antennas * radar.samples < TABLE_BYTES else None


def duration_s(table: Repetition, frame_rate_hz: float) -> float:
    """Duration [s] of the echoes from which the table is summed."""
    return (table.first + table.rows + 1) * table.step_s + END_FRAMES / frame_rate_hz


def _coprime(rows: int, periods: int) -> int:
    """The greatest number, at most `rows`, without a common divisor with `periods`."""
    while rows > 0 and math.gcd(rows, periods) > 1:
        rows -= 1
    return rows


def add_repeated(
    source: Scatterer,
    radar: Radar,
    *,
    tolerance_db: float,
    device: str,
    memory: MemoryLimit,
    onto: Cube | None,
    progress: Progress | None = None,
    parts: EchoParts | None = None,
) -> Cube:
    """Adds a record whose echoes repeat to the cube `onto`, or to a new one, and returns it. The echoes of each of the `parts` are
    also added to the cube of that part, if it has one."""
    table = source.repeats
    assert table is not None
    starts_s = radar.chirp_times_s(table.span_s[1] - table.span_s[0])
    if onto is None:
        onto = new_cube((len(starts_s), radar.antennas, radar.samples), memory.limit_bytes)
        for first in range(0, len(starts_s), ROWS_AT_ONCE):
            rows = min(ROWS_AT_ONCE, len(starts_s) - first)
            onto[first : first + rows] = np.zeros((rows, radar.antennas, radar.samples), np.complex64)
    whole, of_parts = _summed(source, table, parts, tolerance_db=tolerance_db, device=device, memory=memory)
    record = _Record(table, radar, starts_s)
    steps = record.oversampled(whole[table.first : table.first + table.rows])
    with CubeAdder(onto) as adder:
        for block in record.blocks():
            record.read(steps, block, adder.room(block.stop - block.start))
    del whole, steps  # frees memory before the parts are computed one after the other
    for part_sum, rows_of_part in zip(of_parts, parts.rows if parts else (), strict=True):
        _add_part(part_sum, record, rows_of_part)
    if progress is not None:
        progress(1.0)
    return onto


def _add_part(part_sum: ProductRows, record: _Record, onto: ProductRows) -> None:
    """Adds the table of one part to its rows of the record, as coefficients of a few functions of the sample."""
    table = record.table
    coefficients, functions = part_sum.in_one_basis(table.first, table.first + table.rows)
    steps = record.oversampled(coefficients)
    onto.begin()
    for rows in record.blocks():
        out = np.empty((rows.stop - rows.start, *coefficients.shape[1:]), np.complex64)
        record.read(steps, rows, out)
        for first, antenna in itertools.product(range(0, len(out), PIECE_CHIRPS), range(out.shape[1])):
            piece = out[first : first + PIECE_CHIRPS, antenna]
            if piece.any():
                onto.add(rows.start + first, antenna, replace(functions, coefficients=piece))
    onto.end()


@dataclass(frozen=True, slots=True)
class _Record:
    """The chirps of a record, which are interpolated from a table of one period."""

    table: Repetition
    radar: Radar
    starts_s: np.ndarray
    """Start of each row of the record [s], (row,)."""

    def blocks(self) -> Iterator[slice]:
        """Slices of rows, which are interpolated one after the other."""
        for first in range(0, len(self.starts_s), ROWS_AT_ONCE):
            yield slice(first, min(first + ROWS_AT_ONCE, len(self.starts_s)))

    def oversampled(self, rows: np.ndarray) -> np.ndarray:
        """The oversampled table that `read` interpolates, from the rows of the table (row, antenna, value)."""
        table = self.table
        steps = np.empty_like(rows)
        steps[np.arange(table.rows) * table.periods % table.rows] = rows  # ordered by the rotor's angle
        return _oversampled(steps)

    def read(self, dense: np.ndarray, rows: slice, out: np.ndarray) -> None:
        """Interpolates some rows of the record into `out` (row, antenna, value), and applies the gain."""
        table, row_starts_s = self.table, self.starts_s[rows]
        gain = np.ones(len(row_starts_s)) if table.gain is None else table.gain(table.span_s[0] + row_starts_s)
        if not gain.any():
            out[:] = 0
            return
        # Antennas of the table and of the record start their chirps at different times after the starts of their rows.
        late_s = self.radar.antenna_delays_s - table.radar.antenna_delays_s - table.first * table.step_s
        for antenna, offset_s in enumerate(late_s.tolist()):
            position = (row_starts_s + offset_s) / table.period_s % 1 * dense.shape[1]
            out[:, antenna] = _at(dense[antenna], position, gain)


def _summed(
    source: Scatterer,
    table: Repetition,
    parts: EchoParts | None,
    *,
    tolerance_db: float,
    device: str,
    memory: MemoryLimit,
) -> tuple[Cube, list[ProductRows]]:
    """The cube of a table, and that of each part of it."""
    whole: Cube | None = None
    first, rows = 0, len(table.radar.chirp_times_s(source.times_s[-1] - source.times_s[0]))
    shape = rows, table.radar.antennas, table.radar.samples
    file = ScratchFile() if parts and parts.rows else None
    of_parts = [ProductRows(shape, file) for _ in (parts.rows if parts else ())]
    for part in source.parts:
        echo_parts = None if parts is None else EchoParts(parts.number[first : first + part.echoes], of_parts)
        first += part.echoes
        whole = synthesize(
            replace(part, repeats=None),
            table.radar,
            tolerance_db=tolerance_db,
            device=device,
            onto=whole,
            memory=memory,
            parts=echo_parts,
        )
    assert whole is not None
    return whole, of_parts


def _oversampled(steps: np.ndarray) -> np.ndarray:
    """Oversampled and deconvolved values, complex64 (antenna, step, value), between which `_at` interpolates; from those of (step,
    antenna, value)."""
    from scipy import fft

    count = len(steps)
    dense_count = OVERSAMPLING * count
    harmonic = fft.fftfreq(count, 1 / count)
    window = OVERSAMPLING / _window_spectrum(harmonic / dense_count)[:, None].astype(np.float32)
    dense = np.zeros((steps.shape[1], dense_count, steps.shape[2]), steps.dtype)
    for antenna, inside in enumerate(dense):  # one antenna after the other, to save memory
        inside[harmonic.astype(int)] = fft.fft(steps[:, antenna], axis=0) * window
        inside[:] = fft.ifft(inside, axis=0)
    return dense


def table_bytes(table: Repetition, radar: Radar) -> float:
    """Memory [bytes] that a table takes while it is computed and used."""
    return 1.5 * 8 * OVERSAMPLING * table.rows * radar.antennas * radar.samples


def _at(dense: np.ndarray, position: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Interpolated values (K, value) at positions (K,) of a periodic table (step, value), times a gain (K,)."""
    from scipy.sparse import csr_array

    first = np.floor(position).astype(int) - TAPS // 2 + 1
    taps = first[:, None] + np.arange(TAPS)
    weight = (_window(position[:, None] - taps) * gain[:, None]).astype(np.float32)
    operator = csr_array(
        (weight.ravel(), (taps % len(dense)).ravel(), np.arange(0, TAPS * len(position) + 1, TAPS)),
        shape=(len(position), len(dense)),
    )
    return np.asarray(operator @ dense.view(np.float32)).view(np.complex64)


_BETA = math.pi * math.sqrt((TAPS / OVERSAMPLING) ** 2 * (OVERSAMPLING - 0.5) ** 2 - 0.8)


def _window(x: np.ndarray) -> np.ndarray:
    """Kaiser-Bessel window, `TAPS` steps wide."""
    from scipy.special import i0

    return np.asarray(i0(_BETA * np.sqrt(np.maximum(0.0, 1 - (2 * x / TAPS) ** 2))))


def _window_spectrum(frequency: np.ndarray) -> np.ndarray:
    """Fourier transform of the window, at frequencies below its first zero [1 / step]."""
    root = np.sqrt(_BETA**2 - (math.pi * TAPS * frequency) ** 2)
    return np.asarray(TAPS * np.sinh(root) / root)
