"""Point detection as on Texas Instruments' devices: range FFT, static removal, a map, CFAR, angles.

3D people tracking searches range and azimuth: Capon's beamformer makes a map; a CFAR along range takes the noise of the quieter
side; another runs along azimuth, which peaks need not pass; for each detection the elevation and a single speed follow, again from
Capon's weights (TIDUE71D, section 2.1.2, the tuning guide of the demo's detection layer; on peaks, recorded points). The SDK's
out-of-box demo on xWR14xx searches range and Doppler: the logarithms of the antennas' powers are averaged, a CFAR with the quieter
side runs along range, an azimuth FFT gives one or two azimuths, and the phase between the rows of the array gives the elevation
(mmWave SDK, the demo's data path and post-processing).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from t2d_rt.core.checks import instance
from t2d_rt.core.errors import InputError
from t2d_rt.signal.angle import array_spectrum, steering_vectors
from t2d_rt.signal.detection import Detection
from t2d_rt.signal.maps import PointCloud
from t2d_rt.signal.multiplex import check_antennas, separated
from t2d_rt.signal.points import cloud_of, intervals
from t2d_rt.signal.range import range_fft
from t2d_rt.types.radar import Radar


def device_points(adc: Any, radar: Radar, detection: Detection | None = None) -> PointCloud:
    """Points of a cube (chirp, antenna, sample), one frame for each burst of the radar, detected with the settings of `detection`.

    Speeds and ranges are whole FFT bins, with lengths along range that are the next powers of two, as on the device. `snr_db` is
    the power in the map relative to the noise beside it along range. In a cube without receiver noise, the noise is rounding errors
    only.
    """
    check_antennas(adc, radar)
    detection = Detection() if detection is None else detection
    instance("detection", detection, Detection, "a Detection", hint="Detection.from_ti_cfg(path) reads one")
    adc, radar = separated(adc, radar)
    if len(radar.tx_offsets_m) * len(radar.rx_offsets_m) < 2:
        raise InputError(
            "points have an azimuth, which takes two antennas or more, got a radar of one; take one with an array, such as "
            "people-tracking-60"
        )
    n_fft = 2 ** math.ceil(math.log2(radar.samples))
    search = _over_azimuth if detection.over == "azimuth" else _over_doppler
    frames = []
    for time_s, part in intervals(adc, radar):
        distance, azimuth, elevation, speed, snr = search(part, radar, detection, n_fft)
        frames.append(np.stack([np.full(len(snr), time_s), distance, azimuth, elevation, speed, 10 * np.log10(snr)]))
    return cloud_of(frames, nearest_m=detection.range_skip[0] * radar.max_range_m / n_fft)


def _over_azimuth(part: np.ndarray, radar: Radar, detection: Detection, n_fft: int) -> np.ndarray:
    """Points of one frame (chirp, antenna, sample) by the search over range and azimuth: rows range, azimuth, elevation, speed and
    power over noise, (5, point)."""
    cells = range_fft(part, window=detection.range_window, n_fft=n_fft)
    cells = (cells - cells.mean(axis=0)).transpose(2, 1, 0)
    sines = [
        np.linspace(-1, 1, 2 * math.floor(view / step) + 1) * math.sin(math.radians(view))
        for view, step in zip(detection.field_of_view_deg, detection.steps_deg, strict=True)
    ]
    row = _rows(radar)[0]
    across = steering_vectors(radar, _along(sines[0], 0.0))
    inverse = _inverses(cells[:, row], detection.loading[0])
    heat = 1 / np.einsum("as,rst,at->ra", across[:, row].conj(), inverse, across[:, row]).real
    range_bins, angles, snr = _detected(heat, detection)
    strongest = np.argsort(-heat[range_bins, angles], kind="stable")[: detection.most_points]
    bins = 2 ** math.ceil(math.log2(cells.shape[2]))
    range_m, speed_mps = radar.range_axis_m(n_fft), radar.speed_axis_mps(bins)
    points = []
    for place, angle, ratio in zip(range_bins[strongest], angles[strongest], snr[strongest], strict=True):
        inverse = _inverses(cells[place : place + 1], detection.loading[1])[0]
        steered = steering_vectors(radar, _along(sines[0][angle], sines[1]))
        power = 1 / np.einsum("es,st,et->e", steered.conj(), inverse, steered).real
        best = int(power.argmax())
        weights = inverse @ steered[best]
        doppler = np.abs(np.fft.fftshift(np.fft.fft(weights.conj() @ cells[place], bins)))[::-1]
        up = sines[1][best]
        azimuth = math.asin(np.clip(sines[0][angle] / math.sqrt(1 - up**2), -1, 1))
        points.append((range_m[place], azimuth, math.asin(up), speed_mps[int(doppler.argmax())], ratio))
    return np.array(points).reshape(-1, 5).T


def _over_doppler(part: np.ndarray, radar: Radar, detection: Detection, n_fft: int) -> np.ndarray:
    """Points of one frame by the search over range and Doppler, (5, point) with the rows of `_over_azimuth`."""
    spectra = array_spectrum(part, radar, range_window=detection.range_window, mti="mean", n_fft=n_fft)
    cells = spectra.spectrum.transpose(2, 0, 1)  # (range, velocity, antenna)
    power = cells.real**2 + cells.imag**2
    levels = np.log(np.maximum(power, np.finfo(power.dtype).tiny)).mean(axis=2)
    near, far = detection.range_skip
    noise = _quieter_side(_inner(levels, detection), detection, 0)
    loud = levels[near : len(levels) - far] > math.log(detection.thresholds[0]) + noise
    ended = np.pad(levels, [(1, 1), (0, 0)], constant_values=-np.inf)  # ranges end, Doppler is circular
    for axis, grouped in enumerate(detection.group):
        if grouped:
            beside = [np.roll(ended, step, axis)[1 + near : 1 + len(levels) - far] for step in (-1, 1)]
            loud &= levels[near : len(levels) - far] >= np.maximum(*beside)
    row, column = np.nonzero(loud)
    # In the order of an FFT: from zero speed over receding ones, which are negative, to approaching ones.
    order = np.lexsort((row, -spectra.velocity_mps[column] % (2 * radar.max_speed_mps)))
    row, column = row[order], column[order]
    snr = np.exp(levels[row + near, column] - noise[row, column])
    which, left, up = _two_angles(cells[row + near, column], radar, detection)
    ahead = 1 - left**2 - up**2
    inside = (ahead > 0) & (np.abs(up) <= math.sin(math.radians(detection.field_of_view_deg[1])))
    azimuth = np.arctan2(left, np.sqrt(np.maximum(ahead, 0)))
    inside &= np.abs(azimuth) <= math.radians(detection.field_of_view_deg[0])
    sent = np.flatnonzero(inside)[: detection.most_points]
    which = which[sent]
    distance, speed = spectra.range_m[row + near][which], spectra.velocity_mps[column][which]
    return np.stack([distance, azimuth[sent], np.arcsin(up[sent]), speed, snr[which]])


def _two_angles(snapshots: np.ndarray, radar: Radar, detection: Detection) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Azimuths found in snapshots (cell, antenna): the index of the snapshot, and direction cosines to the left and up. First the
    strongest azimuth of each, then second ones that are strong enough. The elevation follows from the phase between the beams of
    the longest row and of the next one at that azimuth."""
    rows = _rows(radar)
    lefts = np.arange(-detection.azimuths // 2, detection.azimuths // 2) * 2 / detection.azimuths
    steered = steering_vectors(radar, _along(lefts, 0.0)).conj()
    beams = [snapshots[:, row] @ steered[:, row].T for row in rows[:2]]
    power = np.abs(beams[0])
    peak = power.argmax(axis=1)
    least = (power <= np.roll(power, 1, axis=1)) & (power < np.roll(power, -1, axis=1))
    lobe = np.cumsum(least, axis=1) % np.maximum(least.sum(axis=1), 1)[:, None]  # the azimuth axis is circular
    cells = np.arange(len(power))
    others = np.where(lobe == lobe[cells, peak][:, None], 0.0, power)
    second = others.argmax(axis=1)
    twice = np.flatnonzero(others[cells, second] > detection.second_peak * power[cells, peak])
    which, place = np.concatenate([cells, twice]), np.concatenate([peak, second[twice]])
    if len(rows) == 1:
        return which, lefts[place], np.zeros(len(which))
    phase = np.angle(beams[1][which, place] * beams[0][which, place].conj())
    higher_m = radar.virtual_offsets_m[rows[1][0], 2] - radar.virtual_offsets_m[rows[0][0], 2]
    up = -phase * radar.wavelength_m / (4 * np.pi * higher_m)
    return which, lefts[place], np.clip(up, -1, 1)


def _rows(radar: Radar) -> list[np.ndarray]:
    """Indices of the antennas in each row of equal height, the longest row first."""
    heights = np.round(radar.virtual_offsets_m[:, 2] / radar.wavelength_m, 3)
    return sorted((np.flatnonzero(heights == height) for height in np.unique(heights)), key=len, reverse=True)


def _along(left: Any, up: Any) -> np.ndarray:
    """Direction cosines (..., 3) in the radar's frame; the one along boresight is 0, as it has no effect for a planar array."""
    return np.stack(np.broadcast_arrays(0.0, left, up), axis=-1)


def _inverses(cells: np.ndarray, loading: float) -> np.ndarray:
    """Inverses of the antennas' covariances over the chirps, with a fraction `loading` of their mean power added to the
    diagonal."""
    covariance = np.einsum("rsc,rtc->rst", cells, cells.conj()).astype(complex) / cells.shape[2]
    antennas = covariance.shape[1]
    mean = np.einsum("rss->r", covariance).real / antennas
    floor = max(float(mean.max()) * 1e-12, 1e-300)
    return np.linalg.inv(covariance + (loading * np.maximum(mean, floor))[:, None, None] * np.eye(antennas))


def _detected(heat: np.ndarray, detection: Detection) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Range bins, azimuth indices and power over the noise along range of the detections in a map (range, azimuth)."""
    inner = _inner(heat, detection)
    if heat.shape[1] < detection.training_cells[1] + detection.guard_cells[1] + 1:
        raise InputError(
            f"training and guard cells of a detection do not fit into {heat.shape[1]} azimuths; take fewer"
        )
    noise = _quieter_side(inner, detection, 0)
    beside = np.pad(
        inner, ((0, 0), (1, 1)), constant_values=-np.inf
    )  # the first and the last azimuth are not neighbours
    peak = (inner > beside[:, :-2]) & (inner >= beside[:, 2:])
    loud = peak | (inner > detection.thresholds[1] * _quieter_side(inner, detection, 1))
    loud &= inner > detection.thresholds[0] * noise
    loud &= inner >= detection.side_lobe * inner.max(axis=1, keepdims=True)
    loud[:, : detection.angle_skip[0]] = False
    loud[:, heat.shape[1] - detection.angle_skip[1] :] = False
    place, angle = np.nonzero(loud)
    return place + detection.range_skip[0], angle, inner[place, angle] / noise[place, angle]


def _inner(power: np.ndarray, detection: Detection) -> np.ndarray:
    """The ranges of a map (range, ...) that are searched; refuses fewer than the CFAR needs."""
    near, far = detection.range_skip
    inner = power[near : len(power) - far]
    if len(inner) < 2 * (detection.training_cells[0] + detection.guard_cells[0] + 1):
        raise InputError(f"training and guard cells of a detection do not fit into {len(inner)} ranges; take fewer")
    return inner


def _quieter_side(values: np.ndarray, detection: Detection, axis: int) -> np.ndarray:
    """Mean of the training cells before or after each cell, whichever is less; azimuth is circular, range is not."""
    training, guard = detection.training_cells[axis], detection.guard_cells[axis]
    width, length = training + guard, values.shape[axis]
    pads = [(width, width) if dimension == axis else (0, 0) for dimension in (0, 1)]
    padded = np.pad(values, pads, mode="wrap") if axis else np.pad(values, pads, constant_values=np.inf)
    means = np.lib.stride_tricks.sliding_window_view(padded, training, axis=axis).mean(axis=-1)
    before = np.take(means, range(length), axis=axis)
    return np.minimum(before, np.take(means, range(width + guard + 1, width + guard + 1 + length), axis=axis))
