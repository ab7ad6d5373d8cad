"""Two recordings of one motion side by side: figures that a radar engineer reads off their spectrograms."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from t2d_rt.checks import array, instance
from t2d_rt.errors import InputError
from t2d_rt.result import Recording
from t2d_rt.signal import range_fft

ENVELOPE_LEVEL_DB = -35.0
"""The envelope is where a column of the spectrogram falls this far below the record's own ridge."""
TORSO_LEVEL_DB = -10.0
"""The torso's speed is the centre of the power above this level in a column: without the limbs, without any background."""
TARGET_LEVEL_DB = -40.0
"""Range bins this far below the strongest hold no target; R^4 would make much of what is in them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Figures of one recording."""

    mean_rcs_dbsm: float
    """Mean over chirps of the radar cross-section, all range bins with a target added."""
    torso_speed_mps: float
    """Median over time of the centre of the spectrogram's ridge, positive = approaching."""
    limb_speed_mps: float
    """95th percentile over time of the envelope's greatest speed, approaching or receding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Figures of two recordings and how their spectrograms agree."""

    labels: tuple[str, str]
    """What the two are: their methods, or "measured"."""
    first: Figures
    second: Figures
    envelope_correlation: float
    """Pearson correlation over time of the two envelopes, upper and lower each about its own mean; NaN if one is constant."""
    mean_difference_db: float
    """Mean of |second - first| over the cells within 40 dB of either's peak; 6 dB for two speckle patterns of one mean."""

    def __str__(self) -> str:
        rows = (
            ("mean RCS [dBsm]", "mean_rcs_dbsm"),
            ("torso speed [m/s]", "torso_speed_mps"),
            ("limb speed [m/s]", "limb_speed_mps"),
        )
        lines = [f"{'':24}" + "".join(f"{label:>12}" for label in self.labels)]
        lines += [
            f"{label:24}{getattr(self.first, name):12.2f}{getattr(self.second, name):12.2f}" for label, name in rows
        ]
        lines.append(f"{'envelope correlation':24}{self.envelope_correlation:12.3f}")
        lines.append(f"{'mean |difference| [dB]':24}{self.mean_difference_db:12.2f}")
        return "\n".join(lines)


def compare(first: Recording, second: Recording) -> Comparison:
    """Compare two recordings with one radar and one motion."""
    _check("first", first)
    _check("second", second)
    one, two = first.spectrogram, second.spectrogram
    if one.shape != two.shape or not np.allclose(one.velocity_mps, two.velocity_mps):
        raise InputError(
            f"spectrograms must have the same axes, got {one.shape} and {two.shape}; use one radar and one motion for both"
        )
    speeds = one.velocity_mps.values
    envelopes = [np.stack(envelope(image.values, speeds)) for image in (one, two)]
    near_peak = (one.values > one.values.max() - 40) | (two.values > two.values.max() - 40)
    floor = max(one.values.max(), two.values.max()) - 60  # silence is not infinitely different
    difference = np.abs(np.maximum(two.values, floor) - np.maximum(one.values, floor))
    return Comparison(
        labels=_labels(first, second),
        first=figures(first),
        second=figures(second),
        envelope_correlation=_correlation(*envelopes),
        mean_difference_db=float(difference[near_peak].mean()),
    )


def _labels(first: Recording, second: Recording) -> tuple[str, str]:
    """What heads their columns; numbered where both are the same."""
    one, two = (
        str(each.settings.get("method") or ("measured" if each.experiment is None else "simulated"))
        for each in (first, second)
    )
    return (one, two) if one != two else (f"{one} 1", f"{two} 2")


def figures(result: Recording) -> Figures:
    """Figures of one recording."""
    _check("result", result)
    image = result.spectrogram
    speeds = image.velocity_mps.values
    upper, lower = envelope(image.values, speeds)
    return Figures(
        mean_rcs_dbsm=10 * math.log10(mean_rcs_m2(result)),
        torso_speed_mps=float(np.median(ridge(image.values, speeds))),
        limb_speed_mps=float(np.percentile(np.maximum(np.abs(upper), np.abs(lower)), 95)),
    )


def mean_rcs_m2(result: Recording) -> float:
    """Mean radar cross-section over the record [m^2], read back from the ADC cube by the radar equation in every range bin.

    Of antennas apart, the range is half the path.
    """
    _check("result", result)
    radar = result.radar
    bins = np.arange(1, radar.samples)  # the first bin holds range 0, where the radar equation has no inverse
    profile = range_fft(result.cube, window="hann")[..., bins]
    power = np.mean(profile.real**2 + profile.imag**2, axis=(0, 1), dtype=np.float64)
    power = np.where(power > power.max() * 10 ** (TARGET_LEVEL_DB / 10), power, 0.0)
    if not power.any():
        raise InputError("the recording is silent, so it has no radar cross-section; check where target and radar are")
    # A Hann window spreads a target's power over 1.5 bins' worth, to be divided out.
    return float(np.sum(power * radar.range_axis_m()[bins] ** 4)) / (1.5 * radar.link_amplitude**2)


def ridge(power_db: np.ndarray, speeds_mps: np.ndarray) -> np.ndarray:
    """Mean speed at each time [m/s], (time,), weighted with power, of the cells within TORSO_LEVEL_DB of the strongest.

    The strongest cell itself jumps from speckle to speckle, in steps of a Doppler bin.
    """
    power_db, speeds_mps = _checked_spectrogram(power_db, speeds_mps)
    relative = power_db - power_db.max(axis=0)
    weight = np.where(relative > TORSO_LEVEL_DB, 10 ** (relative / 10), 0.0)
    return speeds_mps @ weight / weight.sum(axis=0)


def envelope(power_db: np.ndarray, speeds_mps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Greatest and least speed at each time whose power lies within ENVELOPE_LEVEL_DB of the median peak [m/s], (time,) each."""
    power_db, speeds_mps = _checked_spectrogram(power_db, speeds_mps)
    level = np.median(power_db.max(axis=0)) + ENVELOPE_LEVEL_DB
    # A lull, a column without any cell above the level, has its envelope at its strongest cell.
    above = (power_db > level) | (power_db == power_db.max(axis=0))
    return speeds_mps[len(speeds_mps) - 1 - np.argmax(above[::-1], axis=0)], speeds_mps[np.argmax(above, axis=0)]


def _check(name: str, result: Recording) -> None:
    instance(name, result, Recording, "a Recording", hint="simulate makes one, Recording.load reads one")


def _checked_spectrogram(power_db: np.ndarray, speeds_mps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    speeds_mps = array("speeds_mps", speeds_mps, ("velocity",))
    power_db = array("power_db", power_db, (len(speeds_mps), "time"))
    if not power_db.size:
        raise InputError(f"power_db must hold speeds and times, got shape {power_db.shape}")
    return power_db, speeds_mps


def _correlation(one: np.ndarray, two: np.ndarray) -> float:
    """Pearson correlation of (row, time) with each row about its own mean: different means alone would correlate rows."""
    if not (np.ptp(one, axis=1).any() and np.ptp(two, axis=1).any()):
        return math.nan
    one, two = (values - values.mean(axis=1, keepdims=True) for values in (one, two))
    return float(np.sum(one * two) / np.sqrt(np.sum(one**2) * np.sum(two**2)))
