"""Compares two recordings by their spectrograms and by figures that a radar engineer reads off these."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from t2d_rt.core.checks import array, flag, instance
from t2d_rt.core.constants import decibel
from t2d_rt.core.cubes import row_blocks
from t2d_rt.core.errors import InputError, warn
from t2d_rt.plots.canvas import checked_labels
from t2d_rt.recording.recording import Recording
from t2d_rt.signal import range_fft

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENVELOPE_LEVEL_DB = -35.0
"""Level of the Doppler envelope in a column of the spectrogram, relative to the ridge of the record [dB]."""
TORSO_LEVEL_DB = -10.0
"""The speed of the torso is the power-weighted mean of the cells of a column above this level, relative to the strongest [dB]:
limbs and background lie below it."""
TARGET_LEVEL_DB = -40.0
"""Range bins below this level, relative to the strongest, count as empty [dB]; the factor R^4 would turn what is in them into much
RCS."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Figures of one recording."""

    mean_rcs_dbsm: float
    """Radar cross-section [dBsm], the mean over chirps of the sum over range bins with a target."""
    torso_speed_mps: float
    """Median over time of the speed of the spectrogram's ridge [m/s], positive = approaching."""
    limb_speed_mps: float
    """95th percentile over time of the greatest speed of the envelope, approaching or receding [m/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Figures of two recordings, and how well their spectrograms agree; printing it shows a table."""

    labels: tuple[str, str]
    """Names of the two recordings."""
    first: Figures
    second: Figures
    shift_s: float
    """Time by which the second recording lagged and was shifted [s]; 0 unless they were aligned."""
    level_difference_db: float
    """Power of the second spectrogram relative to the first, over the cells that both have [dB]."""
    envelope_correlation: float
    """Pearson correlation over time of both envelopes, upper and lower, each relative to its mean; NaN if one is constant."""
    mean_difference_db: float
    """Mean of |second - first| over the cells within 40 dB of the peak of either [dB]; two speckle patterns of the same mean give 6
    dB."""
    parts_db: Mapping[str, float]
    """Power of each part of the second recording relative to the part of that name in the first [dB]."""
    velocity_mps: np.ndarray = field(repr=False)
    """Speeds that both spectrograms have [m/s], (velocity,)."""
    time_s: np.ndarray = field(repr=False)
    """Times that both have, on the clock of the first [s], (time,)."""
    first_db: np.ndarray = field(repr=False)
    """Spectrogram of the first at these speeds and times [dB re 1 W], (velocity, time)."""
    second_db: np.ndarray = field(repr=False)
    """Spectrogram of the second there, (velocity, time) [dB re 1 W], with its level shifted to that of the first if asked for."""

    def __str__(self) -> str:
        rows = (
            ("mean RCS [dBsm]", "mean_rcs_dbsm"),
            ("torso speed [m/s]", "torso_speed_mps"),
            ("limb speed [m/s]", "limb_speed_mps"),
        )
        width = max(12, *(len(label) + 2 for label in self.labels))
        lines = [f"{'':24}" + "".join(f"{label:>{width}}" for label in self.labels)]
        lines += [
            f"{label:24}{getattr(self.first, name):{width}.2f}{getattr(self.second, name):{width}.2f}"
            for label, name in rows
        ]
        lines.append(f"{'level [dB]':24}{0:{width}.2f}{self.level_difference_db:{width}.2f}")
        lines.append(f"{'envelope correlation':24}{self.envelope_correlation:{width}.3f}")
        lines.append(f"{'mean |difference| [dB]':24}{self.mean_difference_db:{width}.2f}")
        if self.shift_s:
            order = "lags" if self.shift_s > 0 else "leads"
            lines.append(f"{self.labels[1]} {order} by {abs(self.shift_s):.3f} s, which is taken out")
        if self.parts_db:
            lines += ["", f"{'level by part [dB]':24}" + "".join(f"{label:>{width}}" for label in self.labels)]
            changed = sorted(self.parts_db.items(), key=lambda part: -abs(part[1]))
            lines += [f"{name:24}{0:{width}.2f}{level_db:{width}.2f}" for name, level_db in changed]
        return "\n".join(lines)

    def plot(self, title: str | None = None) -> Figure:
        """Draws both spectrograms on one scale, and the difference second minus first."""
        from t2d_rt.plots import plot_comparison

        return plot_comparison(
            self.velocity_mps, self.time_s, self.first_db, self.second_db, labels=self.labels, title=title
        )


def compare(
    first: Recording,
    second: Recording,
    *,
    align: bool = False,
    relative: bool = False,
    labels: Sequence[str] | None = None,
) -> Comparison:
    """Compares the spectrograms of two recordings, simulated or measured, over the speeds and times that both have.

    align: whether the second is shifted in time to the greatest similarity with the first; they overlap by at least half of the
        shorter one.
    relative: whether the level of the second is shifted to that of the first before cells are compared, as the level of measured
        samples is seldom calibrated.
    labels: names of the two; by default their methods or scenes where these differ, or else numbers.

    If the axes of the radars differ, the coarser steps are used and powers are interpolated. Give both spectrograms windows of the
    same duration then (`processed(n_window=...)`): a longer window has narrower Doppler cells, each with less of the power that is
    spread over speeds.
    """
    _check("first", first)
    _check("second", second)
    flag("align", align)
    flag("relative", relative)
    names = _labels(first, second) if labels is None else checked_labels(labels)
    one, two = first.spectrogram, second.spectrogram
    speeds = _common(one.velocity_mps.values, two.velocity_mps.values, "speeds", "m/s")
    images = [_resampled(spectrogram.values, spectrogram.velocity_mps.values, speeds, 0) for spectrogram in (one, two)]
    clocks = [one.time_s.values, two.time_s.values]
    shift_s = _lag_s(images, clocks) if align else 0.0
    clocks[1] = clocks[1] - shift_s if shift_s else clocks[1]
    times = _common(clocks[0], clocks[1], "times", "s")
    one_db, two_db = (_resampled(image, clock, times, 1) for image, clock in zip(images, clocks, strict=True))
    level_db = 10 * math.log10(np.sum(10 ** (two_db / 10)) / np.sum(10 ** (one_db / 10)))
    if relative:
        two_db = two_db - level_db
    envelopes = [np.stack(envelope(image, speeds)) for image in (one_db, two_db)]
    near_peak = (one_db > one_db.max() - 40) | (two_db > two_db.max() - 40)
    floor = max(one_db.max(), two_db.max()) - 60  # two silent cells do not differ
    difference = np.abs(np.maximum(two_db, floor) - np.maximum(one_db, floor))
    return Comparison(
        labels=names,
        first=figures(first),
        second=figures(second),
        shift_s=shift_s,
        level_difference_db=float(level_db),
        envelope_correlation=_correlation(*envelopes),
        mean_difference_db=float(difference[near_peak].mean()),
        parts_db=_parts_db(first, second),
        velocity_mps=speeds,
        time_s=times,
        first_db=one_db,
        second_db=two_db,
    )


def _parts_db(first: Recording, second: Recording) -> dict[str, float]:
    """Power of each part of the second recording relative to the part of that name in the first [dB]. One person's segments are
    matched with those of a person among several targets."""
    first_names, second_names = (
        {name.removeprefix("person: "): name for name in recording.parts} for recording in (first, second)
    )
    common = [name for name in first_names if name in second_names]
    if first_names and second_names and not common:
        warn("the recordings have no part of one name; simulate both with the same split to have their parts compared")
    if not common:
        return {}
    before, after = (recording.parts.levels().level_db for recording in (first, second))
    return {name: float(after.sel(part=second_names[name]) - before.sel(part=first_names[name])) for name in common}


def _common(one: np.ndarray, two: np.ndarray, noun: str, unit: str) -> np.ndarray:
    """Values of the coarser of two axes within the range of both; `noun` and `unit` are for the error where they do not overlap."""
    if one.shape == two.shape and np.allclose(one, two):
        return one
    steps = [float(np.median(np.diff(axis))) if len(axis) > 1 else math.inf for axis in (one, two)]
    coarser = one if steps[0] >= steps[1] * (1 - 1e-6) else two
    slack = 1e-6 * min(steps) if math.isfinite(min(steps)) else 0.0
    low, high = max(one[0], two[0]) - slack, min(one[-1], two[-1]) + slack
    common = coarser[(coarser >= low) & (coarser <= high)]
    if len(common) < (2 if noun == "speeds" else 1):
        raise InputError(
            f"the recordings have no {noun} in common: {one[0]:.4g} to {one[-1]:.4g} and {two[0]:.4g} to {two[-1]:.4g} {unit}; "
            "compare longer records, or others"
        )
    return common


def _resampled(power_db: np.ndarray, axis: np.ndarray, new_axis: np.ndarray, number: int) -> np.ndarray:
    """Levels [dB] at other values of one axis; powers are interpolated linearly."""
    if axis.shape == new_axis.shape and np.allclose(axis, new_axis):
        return power_db
    power = np.moveaxis(10 ** (power_db / 10), number, -1)
    powers = np.stack([np.interp(new_axis, axis, row) for row in power])
    return np.moveaxis(decibel(powers), -1, number)


def _lag_s(images: Sequence[np.ndarray], clocks: Sequence[np.ndarray]) -> float:
    """Time [s] by which the second image (velocity, time) lags behind the first: the shift with the greatest Pearson correlation of
    their levels, where at least half of the shorter one overlaps."""
    if min(len(clock) for clock in clocks) < 2:
        raise InputError("records of one column cannot be aligned; compare longer ones, or leave align out")
    step = max(float(np.median(np.diff(clock))) for clock in clocks)
    levels = []
    for image, clock in zip(images, clocks, strict=True):
        even = _resampled(image, clock, np.arange(clock[0], clock[-1] + 0.01 * step, step), 1)
        levels.append(np.maximum(even, even.max() - 40))  # levels below the floor are noise or silence
    first, second = (level - level.mean() for level in levels)
    length = first.shape[1] + second.shape[1] - 1
    spectra = [np.fft.rfft(level, length) for level in (first, second)]
    lags = np.arange(1 - first.shape[1], second.shape[1])
    cross = np.fft.irfft(np.sum(spectra[1] * spectra[0].conj(), axis=0), length)[lags]
    start = np.maximum(0, -lags)
    stop = np.minimum(first.shape[1], second.shape[1] - lags)

    cells = (stop - start) * len(first)
    ours, theirs = (start, stop), (start + lags, stop + lags)
    means = _sums(first, *ours) / cells, _sums(second, *theirs) / cells
    spread = (_sums(first**2, *ours) / cells - means[0] ** 2) * (_sums(second**2, *theirs) / cells - means[1] ** 2)
    correlation = (cross / cells - means[0] * means[1]) / np.sqrt(np.maximum(spread, 1e-12))
    allowed = 2 * (stop - start) >= min(first.shape[1], second.shape[1])
    lag = int(lags[np.argmax(np.where(allowed, correlation, -np.inf))])
    return lag * step + float(clocks[1][0] - clocks[0][0])


def _sums(values: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Sum of values (row, column) over the columns start..stop, one for each lag, (lag,)."""
    total = np.concatenate([[0.0], np.cumsum(values.sum(axis=0))])
    return np.asarray(total[stop] - total[start])


def _labels(first: Recording, second: Recording) -> tuple[str, str]:
    """Labels for two recordings: their methods or else their scenes, where these differ; else numbers."""
    kinds = [
        str(recording.settings.get("method") or ("measured" if recording.experiment is None else "simulated"))
        for recording in (first, second)
    ]
    scenes = [str(recording.settings.get("scene", kinds[0])) for recording in (first, second)]
    for one, two in (kinds, scenes):
        if one != two:
            return one, two
    return f"{kinds[0]} 1", f"{kinds[1]} 2"


def figures(result: Recording) -> Figures:
    """Computes the figures of one recording."""
    _check("result", result)
    image = result.spectrogram
    speeds = image.velocity_mps.values
    upper, lower = envelope(image.values, speeds)
    return Figures(
        mean_rcs_dbsm=10 * math.log10(mean_rcs_m2(result)),
        torso_speed_mps=float(np.median(ridge(image.values, speeds))),
        limb_speed_mps=float(np.percentile(np.maximum(np.abs(upper), np.abs(lower)), 95)),
    )


def field_difference_db(first: Recording, second: Recording) -> float:
    """Energy of the difference of the samples relative to that of the first recording [dB], both without their means over the
    chirps, that is without static echoes. NaN where the cubes differ in size, -inf where nothing but static echoes differs, inf
    where only the difference varies in time."""
    _check("first", first)
    _check("second", second)
    if second.cube.shape != first.cube.shape:
        return math.nan
    chirps, energies, means = len(first.cube), np.zeros(2), [0.0, 0.0]
    for rows, block in row_blocks(first.cube):
        for place, part in enumerate((np.asarray(second.cube[rows]) - block, np.asarray(block))):
            energies[place] += np.sum(part.real**2 + part.imag**2, dtype=np.float64)
            means[place] = means[place] + part.sum(axis=0, dtype=np.complex128) / chirps
    moving = [energy - chirps * np.sum(np.abs(mean) ** 2) for energy, mean in zip(energies, means, strict=True)]
    # Rounding in the float64 sums of a static record lies below that; echoes of anything that moves lie above.
    difference, signal = (part if part > 1e-14 * energies.max() else 0.0 for part in moving)
    if not (difference and signal):
        return math.inf if difference else -math.inf
    return 10 * math.log10(difference / signal)


def same_axes(first: Recording, second: Recording) -> bool:
    """Whether the axes of the spectrograms, and the number and ranges of the samples, are the same."""
    axes = [
        (image.velocity_mps.values, image.time_s.values, np.array(recording.cube.shape), recording.radar.range_axis_m())
        for recording in (first, second)
        for image in (recording.spectrogram,)
    ]
    return all(np.array_equal(one, two) for one, two in zip(*axes, strict=True))


def mean_rcs_m2(result: Recording) -> float:
    """Mean radar cross-section over the record [m^2], computed from the ADC cube by the radar equation in every range bin.

    For separated antennas the range is half the path length. Where the scene has clutter, the mean over the chirps is removed, so
    that walls do not count.
    """
    _check("result", result)
    radar = result.radar
    bins = np.arange(1, radar.samples)  # the first bin is at range 0, where the radar equation cannot be inverted
    profile = range_fft(result.cube, window="hann")[..., bins]
    if result.settings.get("clutter", "none") != "none":
        profile = profile - profile.mean(axis=0)
    power = np.mean(profile.real**2 + profile.imag**2, axis=(0, 1), dtype=np.float64)
    power = np.where(power > power.max() * 10 ** (TARGET_LEVEL_DB / 10), power, 0.0)
    if not power.any():
        raise InputError("the recording is silent, so it has no radar cross-section; check where target and radar are")
    # A Hann window spreads the power of a target over 1.5 bins, by which the sum is divided.
    return float(np.sum(power * radar.range_axis_m()[bins] ** 4)) / (1.5 * radar.link_amplitude**2)


def ridge(power_db: np.ndarray, speeds_mps: np.ndarray) -> np.ndarray:
    """Power-weighted mean speed [m/s] at each time, (time,), of the cells within TORSO_LEVEL_DB of the strongest.

    The strongest cell itself would jump from one speckle to another, in steps of a Doppler bin.
    """
    power_db, speeds_mps = _checked_spectrogram(power_db, speeds_mps)
    relative = power_db - power_db.max(axis=0)
    weight = np.where(relative > TORSO_LEVEL_DB, 10 ** (relative / 10), 0.0)
    return speeds_mps @ weight / weight.sum(axis=0)


def envelope(power_db: np.ndarray, speeds_mps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Greatest and least speed [m/s] at each time, (time,) each, at which the power is within ENVELOPE_LEVEL_DB of the median
    peak."""
    power_db, speeds_mps = _checked_spectrogram(power_db, speeds_mps)
    level = np.median(power_db.max(axis=0)) + ENVELOPE_LEVEL_DB
    # In a column without a cell above the level the envelope is at the strongest cell.
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
    """Pearson correlation of (row, time), each row relative to its own mean; otherwise different means alone would correlate."""
    if not (np.ptp(one, axis=1).any() and np.ptp(two, axis=1).any()):
        return math.nan
    one, two = (values - values.mean(axis=1, keepdims=True) for values in (one, two))
    return float(np.sum(one * two) / np.sqrt(np.sum(one**2) * np.sum(two**2)))
