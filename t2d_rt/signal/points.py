"""Constant false alarm rate detection (CFAR; docs/physics.md, eq. 20), and point clouds of radars with an antenna array."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, choice, flag, integer, number, numeric, shown
from t2d_rt.core.errors import InputError, warn
from t2d_rt.signal.angle import array_spectrum, beam_step, check_static, steering_vectors
from t2d_rt.signal.doppler import window_starts
from t2d_rt.signal.maps import ArraySpectrum, PointCloud
from t2d_rt.signal.multiplex import check_antennas, separated
from t2d_rt.signal.range import taper
from t2d_rt.types.radar import Radar

RANK = 0.75
"""Rank of the training cell that OS-CFAR uses, as a fraction of their number."""
SCALE = 1e-12, 1e12
"""Limits of a frame's greatest sample within which float32 can hold its power and that of cells 40 dB weaker."""
MOST_LOOKS, MOST_CELLS = 100_000, 2_000
"""Greatest number of antennas, and of training cells, for which a threshold is computed."""


def cfar(
    power: np.ndarray,
    false_alarm_rate: float,
    *,
    looks: int = 1,
    method: str = "ca",
    guard_cells: tuple[int, int] = (0, 4),
    training_cells: tuple[int, int] = (0, 12),
    windows: tuple[str, str] = ("hann", "hann"),
) -> tuple[np.ndarray, np.ndarray, float]:
    """Noise level and threshold of every cell of a map (velocity, range).

    Returns the noise power, (velocity, range), the detections `power > factor * noise`, likewise, and the factor.

    power: mean (or sum) over `looks` antennas of |spectrum|^2, (velocity, range).
    false_alarm_rate: fraction of the cells with noise only that are detected.
    method: "ca", the mean of the training cells, or "os", their 75 % order statistic, which is less affected by other
        targets among them.
    guard_cells, training_cells: numbers of cells along velocity and range, on either side of the tested cell. Both axes are
        circular, like those of an FFT. By default along range only: a body fills many Doppler cells and would mask itself.
    windows: windows of both FFTs; they correlate neighbouring cells, which then count as fewer cells.
    """
    false_alarm_rate = check_rate(false_alarm_rate)
    choice("method of the CFAR", method, ("ca", "os"))
    power = array("power", power, ("velocity", "range"))
    if power.size and power.min() < 0:
        raise InputError(f"power must be 0 or more, got {power.min():.4g}; give |spectrum|^2, not dB")
    looks = integer("looks", looks, 1, MOST_LOOKS)
    offsets = _offsets(power.shape, guard_cells, training_cells)
    correlation = _correlation(offsets, power.shape, windows)
    factor = cfar_factor(false_alarm_rate, correlation, looks=looks, method=method)
    if method == "ca":
        noise = np.zeros(power.shape)
        for offset in offsets:
            noise += np.roll(power, offset, axis=(0, 1)) / len(offsets)
    else:
        from scipy.special import gammaincinv

        training = np.stack([np.roll(power, offset, axis=(0, 1)) for offset in offsets], axis=-1)
        rank = round(RANK * len(offsets))
        ordered = np.partition(training, rank - 1, axis=-1)[..., rank - 1]
        noise = ordered * (looks / gammaincinv(looks, RANK))  # from the quantile to the mean of the noise
    return noise, power > factor * noise, factor


def cfar_factor(false_alarm_rate: float, cells: int | np.ndarray, *, looks: int = 1, method: str = "ca") -> float:
    """Ratio of threshold to noise level, where the latter is estimated from training cells that are sums of `looks` exponential
    powers (eq. 20).

    `cells` is their number, or the correlation matrix of their amplitudes, complex (cell, cell). Exact with "ca", and with "os" for
    uncorrelated cells; otherwise "os" gives fewer false alarms than asked for, with Hann windows 0.6 to 0.9 of them.
    """
    from scipy.optimize import brentq

    false_alarm_rate = check_rate(false_alarm_rate)
    choice("method of the CFAR", method, ("ca", "os"))
    looks = integer("looks", looks, 1, MOST_LOOKS)
    correlation = _checked_correlation(cells)
    log_rate = _ca_log_rate(correlation, looks) if method == "ca" else _os_log_rate(correlation, looks)
    try:
        log_factor = brentq(lambda x: log_rate(math.exp(x)) - math.log(false_alarm_rate), -10, 15, xtol=1e-10)
    except ValueError:
        raise InputError(
            f"no threshold gives a false_alarm_rate of {false_alarm_rate:g} from {len(correlation)} training cells; take more "
            "cells or a higher rate"
        ) from None
    return math.exp(log_factor)


def _checked_correlation(cells: int | np.ndarray) -> np.ndarray:
    """Checked correlation matrix of the training cells; a number stands for that many independent cells."""
    if np.ndim(numeric("cells", cells)) == 0:
        return np.eye(
            integer("cells", cells, 1, MOST_CELLS, hint="a number of training cells, or their correlation matrix")
        )
    matrix = numeric("cells", cells)
    fits = matrix.ndim == 2 and len(matrix) == len(matrix.T) >= 2 and np.isfinite(matrix).all()
    if not (
        fits and np.allclose(matrix, matrix.conj().T, atol=1e-6) and np.allclose(np.diagonal(matrix), 1, atol=1e-6)
    ):
        raise InputError(
            f"cells must be a number of training cells, or their correlation matrix (cell, cell), Hermitian with ones on its "
            f"diagonal, got {shown(cells)}"
        )
    return matrix


def _ca_log_rate(correlation: np.ndarray, looks: int) -> Callable[[float], float]:
    """Logarithm of the false alarm rate as a function of the factor on the mean of the training cells."""
    eigenvalues = np.linalg.eigvalsh(correlation) / len(correlation)
    eigenvalues = eigenvalues[eigenvalues > 1e-12]

    def log_rate(factor: float) -> float:
        scaled = factor * eigenvalues
        sums = np.sum((scaled / (1 + scaled)) ** np.arange(1, looks + 1)[:, None], axis=1)
        terms, log_unit = np.ones(looks), -looks * float(np.log1p(scaled).sum())
        for j in range(1, looks):
            terms[j] = looks / j * float(sums[:j] @ terms[j - 1 :: -1])
            if terms[j] > 1e200:  # for many looks, stay within the range of floats
                log_unit += math.log(terms[j])
                terms /= terms[j]
        return math.log(float(terms.sum())) + log_unit

    return log_rate


def _os_log_rate(correlation: np.ndarray, looks: int) -> Callable[[float], float]:
    """Logarithm of the false alarm rate as a function of the factor on the noise level from an order statistic."""
    from scipy.special import gammaincc, gammaincinv, roots_legendre
    from scipy.stats import beta

    # An order statistic depends on how many cells exceed a level; Sheppard's formula gives the correlation of these events.
    alike = 2 / np.pi * np.arcsin(np.minimum(np.abs(correlation) ** 2, 1))
    cells = len(correlation) ** 2 / float(alike.sum())
    rank = RANK * cells
    nodes, weights = roots_legendre(400)
    quantile = (nodes + 1) / 2
    weights = weights / 2 * beta.pdf(quantile, rank, cells - rank + 1)
    estimate = gammaincinv(looks, quantile) / gammaincinv(looks, RANK) * looks
    return lambda factor: math.log(max(float(weights @ gammaincc(looks, factor * estimate)), 1e-300))


def check_rate(false_alarm_rate: float) -> float:
    """Checked false alarm rate; refuses rates for which no threshold can be computed."""
    return number("false_alarm_rate", false_alarm_rate, 1e-12, 0.5, hint="1e-4 is usual")


def _offsets(
    shape: tuple[int, ...], guard_cells: tuple[int, int], training_cells: tuple[int, int]
) -> list[tuple[int, int]]:
    """Offsets from a cell to its training cells, which form a cross."""
    offsets = []
    pairs = (("guard_cells", guard_cells), ("training_cells", training_cells))
    for name, pair in pairs:
        if not isinstance(pair, (list, tuple)) or len(pair) != 2:
            raise InputError(f"{name} must be two integers, along velocity and range, got {shown(pair)}")
    counts = [[integer(name, count, -MOST_CELLS, MOST_CELLS) for count in pair] for name, pair in pairs]
    for axis, (guard, training) in enumerate(zip(*counts, strict=True)):
        if guard < 0 or training < 0 or (training and 2 * (guard + training) + 1 > shape[axis]):
            raise InputError(
                f"{guard} guard and {training} training cells on either side do not fit into {shape[axis]} cells of "
                f"{('velocity', 'range')[axis]}; take fewer"
            )
        for step in range(guard + 1, guard + training + 1):
            for signed in (-step, step):
                offsets.append((signed, 0) if axis == 0 else (0, signed))
    if len(offsets) > MOST_CELLS:
        raise InputError(
            f"a CFAR takes up to {MOST_CELLS} training cells, got {len(offsets)}; take fewer training_cells"
        )
    if len(offsets) < 4:
        raise InputError(f"a CFAR needs training cells, got {training_cells} on either side; (0, 12) is usual")
    return offsets


def _correlation(offsets: list[tuple[int, int]], shape: tuple[int, ...], windows: tuple[str, str]) -> np.ndarray:
    """Correlation of the amplitudes of white noise in the training cells after windowed FFTs, complex (cell, cell)."""
    correlation = np.ones((len(offsets), len(offsets)), complex)
    steps = np.array(offsets)
    if not isinstance(windows, (list, tuple)) or len(windows) != 2:
        raise InputError(f"windows must be two names, along velocity and range, got {shown(windows)}")
    for axis, window in enumerate(windows):
        power = taper(window, shape[axis], periodic=axis == 0) ** 2
        between = np.fft.fft(power) / power.sum()
        correlation *= between[np.subtract.outer(steps[:, axis], steps[:, axis]) % shape[axis]]
    return correlation


COARSEST = 0.1
"""Greatest step of the search over direction cosines, used where the array is small."""
NEAREST_M = 0.3
"""Default range [m] below which points are left out, as the receiver's own leakage causes points there."""
REFINEMENTS = 4
AT_ONCE = 256
"""Number of detections whose beams are formed at once, to limit memory."""


def point_cloud(
    adc: Any,
    radar: Radar,
    *,
    frame_chirps: int | None = None,
    false_alarm_rate: float = 1e-4,
    method: str = "ca",
    guard_cells: tuple[int, int] = (0, 4),
    training_cells: tuple[int, int] = (0, 12),
    dynamic_range_db: float = 60.0,
    nearest_m: float = NEAREST_M,
    range_window: str = "hann",
    doppler_window: str = "hann",
    mti: str = "mean",
    compensate_tdm: bool = True,
) -> PointCloud:
    """Detections of a cube (chirp, antenna, sample), frame by frame: range, direction, speed, SNR.

    Each frame is one coherent interval: static echoes removed (`mti="mean"`, or "none"), range-Doppler spectra, their
    powers averaged over the antennas, CFAR (see `cfar`), local maxima, and for each of these the direction in which
    the array's beam, focused at its range, is strongest. One point for each cell of range and speed: two targets that
    differ in direction alone give one. Range and speed are those of a parabola through the peak; ranges are not
    corrected for range-Doppler coupling.

    frame_chirps: number of rows of the cube in a frame (loops of the transmitters, also with "ddm"); by default a burst, or
        128. Chirps after the last whole frame are not used.
    false_alarm_rate: rate per cell of the range-Doppler map, before neighbours are grouped.
    dynamic_range_db: the noise level is taken to be at most this far below the frame's strongest cell [dB], so that in a
        noise-free cube targets are detected and not rounding errors.
    nearest_m: range below which points are left out [m]. Their cells, and as many at the end of the range axis, are also excluded
        from the CFAR's training, since a receiver's constants, 1/f noise and leakage are at IFs near zero. 0 keeps all.
    """
    check_antennas(adc, radar)
    check_static(mti)
    false_alarm_rate = check_rate(false_alarm_rate)
    choice("method of the CFAR", method, ("ca", "os"))
    flag("compensate_tdm", compensate_tdm)
    dynamic_range_db = number("dynamic_range_db", dynamic_range_db, 1e-3, 300, unit="dB", hint="60 is usual")
    nearest_m = number("nearest_m", nearest_m, 0, unit="m", hint=f"{NEAREST_M} is usual, 0 keeps all")
    adc, radar = separated(adc, radar)
    first = int(np.searchsorted(radar.range_axis_m(), nearest_m))
    # IFs below zero are at the end of the axis
    tested = slice(first, radar.samples - max(first - 1, 0))
    if first and tested.stop - first < 2:
        raise InputError(
            f"nearest_m must leave some of this radar's {radar.max_range_m:.3g} m of range, got {nearest_m:g} m; lower it"
        )
    columns = []
    for time_s, part in intervals(adc, radar, frame_chirps):
        cells = array_spectrum(
            part,
            radar,
            range_window=range_window,
            doppler_window=doppler_window,
            mti=mti,
            compensate_tdm=compensate_tdm,
        )
        power = np.asarray(np.mean(cells.spectrum.real**2 + cells.spectrum.imag**2, axis=1, dtype=np.float64))
        noise, _, factor = cfar(
            power[:, tested],
            false_alarm_rate,
            looks=radar.antennas,
            method=method,
            guard_cells=guard_cells,
            training_cells=training_cells,
            windows=(doppler_window, range_window),
        )
        noise = np.maximum(noise, power[:, tested].max() * 10 ** (-dynamic_range_db / 10))
        row, column = np.nonzero((power[:, tested] > factor * noise) & _is_peak(power)[:, tested])
        snr = power[:, tested][row, column] / noise[row, column]
        peaks = row, column + first
        columns.append(_report(cells, power, snr, peaks, radar, time_s))
    return cloud_of(columns, nearest_m=nearest_m)


def _report(
    cells: ArraySpectrum,
    power: np.ndarray,
    snr: np.ndarray,
    peaks: tuple[np.ndarray, ...],
    radar: Radar,
    time_s: float,
) -> np.ndarray:
    """Fields of the points of one frame, (6, point): time, range, azimuth, elevation, speed, SNR."""
    row, column = peaks
    speed_step, range_step = cells.velocity_mps[1] - cells.velocity_mps[0], cells.range_m[1] - cells.range_m[0]
    speed = cells.velocity_mps[row] + speed_step * _between(power, row, column, axis=0)
    distance = cells.range_m[column] + range_step * _between(power, row, column, axis=1)
    distance = np.maximum(distance, 0)
    cosines = _directions(cells.spectrum[row, :, column], distance, radar)
    azimuth, elevation = np.arctan2(cosines[:, 1], cosines[:, 0]), np.arcsin(cosines[:, 2])
    return np.stack([np.full(len(row), time_s), distance, azimuth, elevation, speed, 10 * np.log10(snr)])


def _directions(snapshots: np.ndarray, range_m: np.ndarray, radar: Radar) -> np.ndarray:
    """Unit vectors (point, 3) of the directions in which the beams of `snapshots` (point, antenna) are strongest.

    First a grid of direction cosines is searched, then parabolas along y and z are fitted around its peak, with ever smaller steps.
    Along an axis on which the array has no extent the direction cannot be found, and 0 is reported.
    """
    steps = np.array([beam_step(radar, axis, COARSEST) for axis in (1, 2)])
    extent = np.ptp(radar.virtual_offsets_m[:, 1:], axis=0) > radar.wavelength_m * 1e-3
    lines = [
        np.arange(-np.floor(1 / step), np.floor(1 / step) + 1) * step if wide else np.zeros(1)
        for step, wide in zip(steps, extent, strict=True)
    ]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = grid[np.sum(grid**2, axis=1) < 1]
    beams = steering_vectors(radar, _upright(grid)).conj().T.astype(snapshots.dtype)
    place = np.zeros((len(snapshots), 2))
    for start in range(0, len(snapshots), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        place[part] = grid[np.abs(snapshots[part] @ beams).argmax(axis=1)]

    for shrink in range(REFINEMENTS):
        for axis in np.flatnonzero(extent):
            step = np.zeros(2)
            step[axis] = steps[axis] / 2**shrink
            nearby = (steering_vectors(radar, _upright(at), range_m) for at in (place - step, place, place + step))
            shift = _vertex(*(np.abs(np.sum(snapshots * weights.conj(), axis=1)) ** 2 for weights in nearby))
            place = place + shift[:, None] * step
    return _upright(place)


def _upright(place: np.ndarray) -> np.ndarray:
    """Unit vectors in front of the radar with the given direction cosines (..., 2) along y and z."""
    beyond = np.maximum(np.linalg.norm(place, axis=-1, keepdims=True), 1.0)
    place = place / beyond
    forward = np.sqrt(np.maximum(1 - np.sum(place**2, axis=-1, keepdims=True), 0))
    return np.concatenate([forward, place], axis=-1)


def _between(power: np.ndarray, row: np.ndarray, column: np.ndarray, *, axis: int) -> np.ndarray:
    """Position of a peak between cells along an axis, -1/2..1/2 of a cell, by a parabola through the levels in dB."""
    step = (1, 0) if axis == 0 else (0, 1)
    rows, columns = power.shape
    neighbours = [power[(row + k * step[0]) % rows, (column + k * step[1]) % columns] for k in (-1, 0, 1)]
    return np.clip(_vertex(*np.log(np.maximum(neighbours, neighbours[1] * 1e-12))), -0.5, 0.5)


def _vertex(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Position of the vertex of a parabola through three values one step apart, -1..1 steps from the middle."""
    bend = before - 2 * here + after
    top = np.divide(0.5 * (before - after), bend, out=np.zeros_like(here), where=bend < 0)
    # Where the parabola opens upwards: at the greater of both sides.
    return np.clip(np.where(bend < 0, top, np.sign(after - before)), -1, 1)


def _is_peak(power: np.ndarray) -> np.ndarray:
    """Whether each cell is exceeded by none of its eight neighbours; both axes are circular."""
    from scipy.ndimage import maximum_filter

    return power >= maximum_filter(power, size=3, mode="wrap")


def intervals(adc: Any, radar: Radar, frame_chirps: int | None = None) -> Iterator[tuple[float, np.ndarray]]:
    """Centre [s] and chirps (chirp, antenna, sample) of each frame of a cube; no frame extends over two bursts."""
    chirps = len(adc)
    burst = radar.loops_per_frame or chirps
    if frame_chirps is not None:
        frame_chirps = integer("frame_chirps", frame_chirps)
    if frame_chirps is None:
        if chirps < 8:
            raise InputError(f"points take a cube of 8 chirps or more, got {chirps} rows; give whole bursts")
        frame_chirps = min(burst if radar.loops_per_frame else 128, chirps)
    if not 8 <= frame_chirps <= min(burst, chirps):
        raise InputError(
            f"frame_chirps must lie in 8..{min(burst, chirps)} (the rows of the cube, or of a burst), got {frame_chirps}"
        )
    left = chirps % burst
    if left and left < frame_chirps:
        warn(
            f"the last {left} of {chirps} rows are a part of a burst, which has {burst}, and give no points; record whole bursts"
        )
    starts = window_starts(chirps, burst, frame_chirps, frame_chirps)
    times_s = radar.chirp_starts_s(chirps)[starts] + frame_chirps / 2 * radar.loop_interval_s
    for start, time_s in zip(starts, times_s, strict=True):
        yield float(time_s), _scaled(np.asarray(adc[start : start + frame_chirps]))


def _scaled(part: np.ndarray) -> np.ndarray:
    """Samples of a frame; very weak and very strong ones are scaled by a power of two, so that powers stay within the range of
    floats."""
    greatest = float(max(np.abs(part.real).max(), np.abs(part.imag).max()))
    if greatest == 0 or SCALE[0] <= greatest <= SCALE[1]:
        return part
    wide = np.ldexp(1.0, -math.frexp(greatest)[1])
    return (part.astype(complex) * wide).astype(np.result_type(part, np.complex64))


def cloud_of(fields: Iterable[np.ndarray], *, nearest_m: float) -> PointCloud:
    """The point cloud of all frames, each given as (6, point): time, range, azimuth, elevation, speed, SNR."""
    columns = np.concatenate([np.zeros((6, 0)), *fields], axis=1)
    names = "time_s", "range_m", "azimuth_rad", "elevation_rad", "speed_mps", "snr_db"
    return PointCloud(**dict(zip(names, columns, strict=True)), nearest_m=nearest_m)
