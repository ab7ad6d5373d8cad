"""Points as Texas Instruments' 3D people tracking reports them: an IWR6843's detection layer, by its configuration file.

Range FFT, static removal, a range-azimuth map by Capon's beamformer, a CFAR along range and along azimuth whose noise is that of
the quieter side, then for each detection its elevation and its one speed, again by Capon's weights (TIDUE71D, section 2.1.2, and
the tuning guide of the demo's detection layer). Neighbouring detections are not grouped: the device leaves that to its tracker.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from t2d_rt.core.checks import instance
from t2d_rt.core.errors import InputError
from t2d_rt.signal.angle import steering_vectors
from t2d_rt.signal.maps import PointCloud
from t2d_rt.signal.multiplex import check_antennas, separated
from t2d_rt.signal.points import frames
from t2d_rt.signal.range import range_fft
from t2d_rt.types.radar import Radar
from t2d_rt.types.ti_cfg import Detection


def people_tracking_points(adc: Any, radar: Radar, detection: Detection | None = None) -> PointCloud:
    """Points of a cube (chirp, antenna, sample), a frame from each burst of the radar, as `Detection` says.

    Speeds and ranges are whole bins of FFTs whose lengths are the next powers of two, as the device has them.
    `snr_db` is the Capon power over the noise beside it along range. Without receiver noise what is compared is rounding errors.
    """
    check_antennas(adc, radar)
    detection = Detection() if detection is None else detection
    instance("detection", detection, Detection, "a Detection", hint="Detection.from_ti_cfg(path) reads one")
    adc, radar = separated(adc, radar)
    starts, chirps = frames(len(adc), radar, None)
    times_s = radar.chirp_starts_s(len(adc))[starts] + chirps / 2 * radar.loop_interval_s
    sines = [
        np.linspace(-1, 1, 2 * math.floor(view / step) + 1) * math.sin(math.radians(view))
        for view, step in zip(detection.field_of_view_deg, detection.steps_deg, strict=True)
    ]
    n_fft = 2 ** math.ceil(math.log2(radar.samples))
    columns = [np.zeros((6, 0))]
    for start, time_s in zip(starts, times_s, strict=True):
        cells = range_fft(np.asarray(adc[start : start + chirps]), n_fft=n_fft)
        cells -= cells.mean(axis=0)
        columns.append(_points(cells.transpose(2, 1, 0), radar, detection, sines, float(time_s)))
    time, distance, azimuth, elevation, speed, snr = np.concatenate(columns, axis=1)
    return PointCloud(
        time_s=time, range_m=distance, azimuth_rad=azimuth, elevation_rad=elevation, speed_mps=speed, snr_db=snr,
        nearest_m=detection.range_skip[0] * radar.max_range_m / n_fft,
    )  # fmt: skip


def _points(
    cells: np.ndarray, radar: Radar, detection: Detection, sines: list[np.ndarray], time_s: float
) -> np.ndarray:
    """The fields of the points of one frame, (6, point), from cells (range, antenna, chirp)."""
    heights = np.round(radar.virtual_offsets_m[:, 2] / radar.wavelength_m, 3)
    row = np.flatnonzero(heights == max(set(heights), key=list(heights).count))
    across = steering_vectors(radar, _along(sines[0], 0.0))
    inverse = _inverses(cells[:, row], detection.loading[0])
    heat = 1 / np.einsum("as,rst,at->ra", across[:, row].conj(), inverse, across[:, row]).real
    found, angles, snr = _detected(heat, detection)
    strongest = np.argsort(-heat[found, angles], kind="stable")[: detection.most_points]
    bins = 2 ** math.ceil(math.log2(cells.shape[2]))
    range_m, speed_mps = radar.range_axis_m(cells.shape[0]), radar.speed_axis_mps(bins)
    points = []
    for place, angle, ratio in zip(found[strongest], angles[strongest], snr[strongest], strict=True):
        inverse = _inverses(cells[place : place + 1], detection.loading[1])[0]
        steered = steering_vectors(radar, _along(sines[0][angle], sines[1]))
        power = 1 / np.einsum("es,st,et->e", steered.conj(), inverse, steered).real
        best = int(power.argmax())
        weights = inverse @ steered[best]
        doppler = np.abs(np.fft.fftshift(np.fft.fft(weights.conj() @ cells[place], bins)))[::-1]
        up = sines[1][best]
        azimuth = math.asin(np.clip(sines[0][angle] / math.sqrt(1 - up**2), -1, 1))
        speed = speed_mps[int(doppler.argmax())]
        points.append((time_s, range_m[place], azimuth, math.asin(up), speed, 10 * math.log10(ratio)))
    return np.array(points).reshape(-1, 6).T


def _along(left: Any, up: Any) -> np.ndarray:
    """Direction cosines (..., 3); only those along left and up count in an array that is flat."""
    return np.stack(np.broadcast_arrays(0.0, left, up), axis=-1)


def _inverses(cells: np.ndarray, loading: float) -> np.ndarray:
    """Inverses of the antennas' covariances over the chirps, with a part of their mean power added to the diagonal."""
    covariance = np.einsum("rsc,rtc->rst", cells, cells.conj()).astype(complex) / cells.shape[2]
    antennas = covariance.shape[1]
    mean = np.einsum("rss->r", covariance).real / antennas
    floor = max(float(mean.max()) * 1e-12, 1e-300)
    return np.linalg.inv(covariance + (loading * np.maximum(mean, floor))[:, None, None] * np.eye(antennas))


def _detected(heat: np.ndarray, detection: Detection) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Range bins, azimuths and power over the noise along range of the detections in a map (range, azimuth)."""
    near, far = detection.range_skip
    inner = heat[near : len(heat) - far]
    least = detection.training_cells[0] + detection.guard_cells[0] + 1
    if len(inner) < 2 * least or heat.shape[1] < detection.training_cells[1] + detection.guard_cells[1] + 1:
        raise InputError(
            f"training and guard cells of a detection do not fit into {len(inner)} ranges and {heat.shape[1]} azimuths; take fewer"
        )
    noise = _quieter_side(inner, detection, 0)
    loud = inner > detection.thresholds[0] * noise
    loud &= inner > detection.thresholds[1] * _quieter_side(inner, detection, 1)
    loud &= inner >= detection.side_lobe * inner.max(axis=1, keepdims=True)
    loud[:, : detection.angle_skip[0]] = False
    loud[:, heat.shape[1] - detection.angle_skip[1] :] = False
    place, angle = np.nonzero(loud)
    return place + near, angle, inner[place, angle] / noise[place, angle]


def _quieter_side(power: np.ndarray, detection: Detection, axis: int) -> np.ndarray:
    """Mean of the training cells before or after each cell, whichever is less; azimuths go round, ranges end."""
    training, guard = detection.training_cells[axis], detection.guard_cells[axis]
    width, length = training + guard, power.shape[axis]
    pads = [(width, width) if each == axis else (0, 0) for each in (0, 1)]
    padded = np.pad(power, pads, mode="wrap") if axis else np.pad(power, pads, constant_values=np.inf)
    means = np.lib.stride_tricks.sliding_window_view(padded, training, axis=axis).mean(axis=-1)
    before = np.take(means, range(length), axis=axis)
    return np.minimum(before, np.take(means, range(width + guard + 1, width + guard + 1 + length), axis=axis))
