"""Two recordings of one motion side by side: what a radar engineer reads off their spectrograms, in figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.result import Simulation
from t2d_rt.signal import range_fft

ENVELOPE_LEVEL_DB = -35.0
"""The envelope is where a column of the spectrogram falls this far below the record's own ridge."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """What one recording shows."""

    mean_rcs_dbsm: float
    """Mean over chirps of the radar cross-section, all range bins added."""
    torso_speed_mps: float
    """Median speed of the spectrogram's ridge, positive = approaching."""
    limb_speed_mps: float
    """95th percentile of the envelope's speed in the direction of the ridge."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Figures of two recordings and how their spectrograms agree."""

    first: Figures
    second: Figures
    envelope_correlation: float
    """Pearson correlation of the two envelopes over time, both directions."""
    mean_difference_db: float
    """Mean of |second - first| over the cells within 40 dB of either's peak."""


def compare(first: Simulation, second: Simulation) -> Comparison:
    """Compare two recordings with one radar and one motion."""
    one, two = first.spectrogram, second.spectrogram
    if one.shape != two.shape or not np.allclose(one.velocity_mps, two.velocity_mps):
        raise InputError(
            f"spectrograms must have the same axes, got {one.shape} and {two.shape}; use one radar and one motion for both"
        )
    speeds = one.velocity_mps.values
    envelopes = [np.concatenate(envelope(image.values, speeds)) for image in (one, two)]
    near_peak = (one.values > one.values.max() - 40) | (two.values > two.values.max() - 40)
    floor = max(one.values.max(), two.values.max()) - 60  # silence is not infinitely different
    difference = np.abs(np.maximum(two.values, floor) - np.maximum(one.values, floor))
    return Comparison(
        first=figures(first),
        second=figures(second),
        envelope_correlation=float(np.corrcoef(*envelopes)[0, 1]),
        mean_difference_db=float(difference[near_peak].mean()),
    )


def figures(result: Simulation) -> Figures:
    """Figures of one recording."""
    image = result.spectrogram
    speeds = image.velocity_mps.values
    torso = float(np.median(ridge(image.values, speeds)))
    upper, lower = envelope(image.values, speeds)
    limb = float(np.percentile(upper, 95) if torso >= 0 else np.percentile(lower, 5))
    return Figures(mean_rcs_dbsm=10 * np.log10(mean_rcs_m2(result)), torso_speed_mps=torso, limb_speed_mps=limb)


def mean_rcs_m2(result: Simulation) -> float:
    """Mean radar cross-section over the record [m^2], read back from the ADC cube by the radar equation in every range bin."""
    radar = result.radar
    bins = np.arange(1, radar.samples)  # the first bin holds range 0, where the radar equation has no inverse
    profile = range_fft(result.cube, window="hann")[..., bins]
    power = np.mean(profile.real**2 + profile.imag**2, axis=(0, 1), dtype=np.float64)
    # A Hann window spreads a target's power over 1.5 bins' worth, to be divided out.
    return float(np.sum(power * radar.range_axis_m()[bins] ** 4)) / (1.5 * radar.link_amplitude**2)


def ridge(power_db: np.ndarray, speeds_mps: np.ndarray) -> np.ndarray:
    """Speed of the strongest cell at each time [m/s], (time,)."""
    return speeds_mps[np.argmax(power_db, axis=0)]


def envelope(power_db: np.ndarray, speeds_mps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Greatest and least speed at each time whose power lies within ENVELOPE_LEVEL_DB of the median ridge [m/s], (time,) each."""
    level = np.median(power_db.max(axis=0)) + ENVELOPE_LEVEL_DB
    above = power_db > level
    # A column without any cell above the level, a lull, has its envelope at its ridge.
    peak = np.argmax(power_db, axis=0)
    upper = np.where(above.any(axis=0), len(speeds_mps) - 1 - np.argmax(above[::-1], axis=0), peak)
    lower = np.where(above.any(axis=0), np.argmax(above, axis=0), peak)
    return speeds_mps[upper], speeds_mps[lower]
