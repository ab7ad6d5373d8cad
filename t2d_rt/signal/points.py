"""Point clouds, as a sensor with an antenna array reports them."""

from __future__ import annotations

from typing import Any

import numpy as np

from t2d_rt.core.checks import choice, flag, integer, number
from t2d_rt.core.errors import InputError
from t2d_rt.signal.angle import array_spectrum, beam_step, check_static, steering_vectors
from t2d_rt.signal.cfar import cfar, check_rate
from t2d_rt.signal.doppler import window_starts
from t2d_rt.signal.maps import ArraySpectrum, PointCloud
from t2d_rt.signal.multiplex import check_antennas, separated
from t2d_rt.types.radar import Radar

COARSEST = 0.1
"""Step of the search in direction cosine where the array is small."""
NEAREST_M = 0.3
"""Range within which a receiver's own leakage gives points."""
REFINEMENTS = 4
AT_ONCE = 256
"""Detections whose beams are formed together: bounds memory."""


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

    frame_chirps: rows of the cube in a frame (loops of the transmitters, also with "ddm"); by default a burst, or 128.
        Chirps after the last whole frame are not used.
    false_alarm_rate: per cell of the range-Doppler map, before neighbours are grouped.
    dynamic_range_db: the noise level is taken to be no lower than this below the frame's strongest cell, so that a
        noise-free cube gives its targets and not its rounding errors.
    nearest_m: points nearer than that are left out, and so are their cells, with as many at the end of the range axis, from the
        CFAR's training: a receiver's constants, 1/f noise and leakage lie at IFs about zero. 0 keeps all.
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
    # Those of IFs below zero stand at the end of the axis.
    tested = slice(first, radar.samples - max(first - 1, 0))
    if first and tested.stop - first < 2:
        raise InputError(
            f"nearest_m must leave some of this radar's {radar.max_range_m:.3g} m of range, got {nearest_m:g} m; lower it"
        )
    starts, chirps = _frames(len(adc), radar, frame_chirps)
    times_s = radar.chirp_starts_s(len(adc))[starts] + chirps / 2 * radar.loop_interval_s
    columns: list[np.ndarray] = []
    for start, time_s in zip(starts, times_s, strict=True):
        cells = array_spectrum(
            adc[start : start + chirps], radar, range_window=range_window, doppler_window=doppler_window, mti=mti,
            compensate_tdm=compensate_tdm,
        )  # fmt: skip
        power = np.asarray(np.mean(cells.spectrum.real**2 + cells.spectrum.imag**2, axis=1, dtype=np.float64))
        noise, _, factor = cfar(
            power[:, tested], false_alarm_rate, looks=radar.antennas, method=method, guard_cells=guard_cells,
            training_cells=training_cells, windows=(doppler_window, range_window),
        )  # fmt: skip
        noise = np.maximum(noise, power[:, tested].max() * 10 ** (-dynamic_range_db / 10))
        row, column = np.nonzero((power[:, tested] > factor * noise) & _is_peak(power)[:, tested])
        snr = power[:, tested][row, column] / noise[row, column]
        found = row, column + first
        columns.append(_report(cells, power, snr, found, radar, float(time_s)))
    time, distance, azimuth, elevation, speed, snr = np.concatenate(columns, axis=1)
    return PointCloud(
        time_s=time, range_m=distance, azimuth_rad=azimuth, elevation_rad=elevation, speed_mps=speed, snr_db=snr,
        nearest_m=nearest_m,
    )  # fmt: skip


def _report(
    cells: ArraySpectrum,
    power: np.ndarray,
    snr: np.ndarray,
    found: tuple[np.ndarray, ...],
    radar: Radar,
    time_s: float,
) -> np.ndarray:
    """The fields of the points of one frame, (6, point)."""
    row, column = found
    speed_step, range_step = cells.velocity_mps[1] - cells.velocity_mps[0], cells.range_m[1] - cells.range_m[0]
    speed = cells.velocity_mps[row] + speed_step * _between(power, row, column, axis=0)
    distance = cells.range_m[column] + range_step * _between(power, row, column, axis=1)
    distance = np.maximum(distance, 0)
    cosines = _directions(cells.spectrum[row, :, column], distance, radar)
    azimuth, elevation = np.arctan2(cosines[:, 1], cosines[:, 0]), np.arcsin(cosines[:, 2])
    return np.stack([np.full(len(row), time_s), distance, azimuth, elevation, speed, 10 * np.log10(snr)])


def _directions(snapshots: np.ndarray, range_m: np.ndarray, radar: Radar) -> np.ndarray:
    """Unit vectors (point, 3) in which the beams of `snapshots` (point, antenna) are strongest.

    A search over a grid of direction cosines, then parabolas along y and z around its peak, with smaller steps each
    time. Along an axis on which the array has no extent it cannot tell, and 0 is reported.
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

    def level(at: np.ndarray) -> np.ndarray:
        weights = steering_vectors(radar, _upright(at), range_m)
        return np.abs(np.sum(snapshots * weights.conj(), axis=1)) ** 2

    for shrink in range(REFINEMENTS):
        for axis in np.flatnonzero(extent):
            step = np.zeros(2)
            step[axis] = steps[axis] / 2**shrink
            shift = _vertex(level(place - step), level(place), level(place + step))
            place = place + shift[:, None] * step
    return _upright(place)


def _upright(place: np.ndarray) -> np.ndarray:
    """Unit vectors in front of the radar with the direction cosines (..., 2) along y and z."""
    beyond = np.maximum(np.linalg.norm(place, axis=-1, keepdims=True), 1.0)
    place = place / beyond
    forward = np.sqrt(np.maximum(1 - np.sum(place**2, axis=-1, keepdims=True), 0))
    return np.concatenate([forward, place], axis=-1)


def _between(power: np.ndarray, row: np.ndarray, column: np.ndarray, *, axis: int) -> np.ndarray:
    """Where a peak lies between cells along an axis, -1/2..1/2 of a cell: a parabola through the levels in dB."""
    step = (1, 0) if axis == 0 else (0, 1)
    rows, columns = power.shape
    neighbours = [power[(row + k * step[0]) % rows, (column + k * step[1]) % columns] for k in (-1, 0, 1)]
    return np.clip(_vertex(*np.log(np.maximum(neighbours, neighbours[1] * 1e-12))), -0.5, 0.5)


def _vertex(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Where the parabola through three values a step apart has its top, -1..1 steps from the middle."""
    bend = before - 2 * here + after
    top = np.divide(0.5 * (before - after), bend, out=np.zeros_like(here), where=bend < 0)
    # Where it bends upwards: to the higher side.
    return np.clip(np.where(bend < 0, top, np.sign(after - before)), -1, 1)


def _is_peak(power: np.ndarray) -> np.ndarray:
    """Cells that none of their eight neighbours exceeds; both axes are circular."""
    from scipy.ndimage import maximum_filter

    return power >= maximum_filter(power, size=3, mode="wrap")


def _frames(chirps: int, radar: Radar, frame_chirps: int | None) -> tuple[np.ndarray, int]:
    """First rows of the frames, which lie within bursts, and the rows of each."""
    burst = radar.loops_per_frame or chirps
    if frame_chirps is not None:
        frame_chirps = integer("frame_chirps", frame_chirps)
    if frame_chirps is None:
        frame_chirps = min(burst if radar.loops_per_frame else 128, chirps)
    if not 8 <= frame_chirps <= min(burst, chirps):
        raise InputError(
            f"frame_chirps must lie in 8..{min(burst, chirps)} (the rows of the cube, or of a burst), got {frame_chirps}"
        )
    return window_starts(chirps, burst, frame_chirps, frame_chirps), frame_chirps
