"""Features of spectrograms, of the kind used in radar work on human activities since Kim and Ling (2009).

- `features`: speeds of the torso, total bandwidth, its asymmetry, contribution of the limbs, and the modulation of all these in
  time.
- `activity_features`: when the movement happens, for how long and what follows, from a smoothed spectrogram. Means over 3 x 3 cells
  reduce the speckle of the noise, so that limbs become visible that are weaker than single cells of noise. Lines are the speeds
  below which certain fractions of the power lie; a single cell more or less hardly moves them.
- `band_features`: for how much of the time each band of speed has which level, how it fluctuates, and how far the body moves. They
  do not depend on when in a map this happens, so they change little for windows that slide over a recording.

No feature distinguishes approaching from receding.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from t2d_rt.core.constants import decibel
from t2d_rt.core.errors import InputError
from t2d_rt.signal.envelope import NOTCH_MPS, RANGE_DB, envelope

SPEEDS_MPS = (NOTCH_MPS, 0.3, 0.6, 1.0, 1.5, 2.2, 3.2, 4.5, 10.0)
"""Edges of the speed bands of the Doppler profile [m/s]."""
MODULATION_HZ = (0.0, 0.4, 0.9, 1.5, 2.4, 4.0, 8.0)
"""Edges of the bands of modulation [Hz]: a fall or a bend; slow swings; strides; steps of walking; of running; jerks."""
PERIODS_S = (0.25, 1.4)
"""Least and greatest period of steps that is searched [s]."""
SLOW_S = 1.2
"""Changes over a longer time than this are not steps [s]."""
SHORTEST_S, WIDEST_S = 1.2, 0.7
"""Shortest map and widest time cell [s]: a shorter map does not contain a period of the slowest steps, and wider cells hide
them."""


def check_steps(noun: str, columns: int, duration_s: float) -> None:
    """Refuses maps from whose features steps cannot be recognised; `noun` is what uses the features, in the plural."""
    cell_s = duration_s / columns
    if duration_s < SHORTEST_S or cell_s > WIDEST_S:
        raise InputError(
            f"{noun} take maps of {SHORTEST_S:g} s or more in cells of {WIDEST_S:g} s at most, in which steps are seen, got "
            f"{duration_s:.3g} s in cells of {cell_s:.2g} s; take maps of more cells, longer samples, or a network on pictures"
        )


def features(levels_db: np.ndarray, velocity_mps: np.ndarray, duration_s: float) -> dict[str, float]:
    """Features by name, for a spectrogram (speed, time) [dB, 0 at the greatest cell]."""
    levels, velocity = levels_db.astype(np.float64), velocity_mps
    envelope_lines = envelope(levels, velocity)
    fast = np.abs(velocity)[:, None] >= NOTCH_MPS
    power = np.where((levels > envelope_lines.threshold_db) & fast, 10.0 ** (levels / 10.0), 0.0)
    total = np.maximum(power.sum(axis=0), 1e-12)
    mean = (power * velocity[:, None]).sum(axis=0) / total
    spread = np.sqrt((power * (velocity[:, None] - mean) ** 2).sum(axis=0) / total)
    lines = {
        "torso": envelope_lines.torso_mps,
        "mean": mean,
        "spread": spread,
        "bandwidth": envelope_lines.upper_mps - envelope_lines.lower_mps,
        "asymmetry": envelope_lines.upper_mps + envelope_lines.lower_mps,
    }
    step_s = duration_s / levels.shape[1]
    return {
        **_speeds(envelope_lines.upper_mps, -envelope_lines.lower_mps, lines),
        **_profile(levels > envelope_lines.threshold_db, power, velocity),
        **_modulation(lines, step_s),
        **_periodicity(np.where(fast, np.clip(levels - envelope_lines.threshold_db, 0, 15), 0.0), step_s),
        **activity_features(levels, velocity, duration_s),
    }


def _log(value: float, least: float = 0.1) -> float:
    """Logarithm of a figure, of at least `least`: figures span decades, and classifiers compare their differences."""
    return float(np.log(max(value, 0.0) + least))


def _speeds(upper: np.ndarray, lower: np.ndarray, lines: dict[str, np.ndarray]) -> dict[str, float]:
    """Percentiles of the lines of the envelope, and their ratios."""
    bandwidth, torso = lines["bandwidth"], np.abs(lines["torso"])
    spans = {
        "outer": (np.maximum(upper, lower), (25, 50, 75, 95, 100)),
        "bandwidth": (bandwidth, (10, 50, 90)),
        "torso": (torso, (25, 50, 75, 95)),
        "mean": (np.abs(lines["mean"]), (50, 95)),
        "spread": (lines["spread"], (10, 50, 90)),
        "both sides": (np.minimum(upper, lower), (50, 95)),
    }
    percentiles = {
        f"{name} {level}": _log(np.percentile(line, level))
        for name, (line, levels) in spans.items()
        for level in levels
    }
    mean_signs = np.mean(lines["mean"] > 0.3), np.mean(lines["mean"] < -0.3)
    middle = bandwidth.mean() + 0.1
    last = len(bandwidth) // 5
    return percentiles | {
        "net": _log(abs(lines["torso"].mean())),
        "range of the torso": _log(np.ptp(lines["torso"])),
        "one way": float(max(mean_signs)),
        "other way": float(min(mean_signs)),
        "asymmetry": abs(lines["asymmetry"].mean()) / middle,
        "burst": bandwidth.std() / middle,
        "peak": _log(bandwidth.max() / middle),
        "active": float(np.mean(bandwidth > 0.6)),
        "busy": float(np.mean(bandwidth > 1.5)),
        "end": _log(bandwidth[-last:].mean() / middle),
        "limbs": _log((np.percentile(bandwidth, 75) + 0.1) / (np.percentile(torso, 75) + 0.1)),
    }


def _profile(above: np.ndarray, power: np.ndarray, velocity: np.ndarray) -> dict[str, float]:
    """Fraction of occupied cells, and power, in bands of speed."""
    profile = {}
    for low, high in pairwise(SPEEDS_MPS):
        rows = (np.abs(velocity) >= low) & (np.abs(velocity) < high)
        occupied = above[rows].mean() if rows.any() else 0.0  # the axis of the map may end below these speeds
        profile[f"cells from {low} m/s"] = _log(occupied, 0.01)
        profile[f"power from {low} m/s"] = _log(power[rows].sum() / max(power.sum(), 1e-12), 1e-4)
    return profile


def _modulation(lines: dict[str, np.ndarray], step_s: float) -> dict[str, float]:
    """Energy of each line in bands of modulation frequency."""
    energies = {}
    for name in ("mean", "spread", "bandwidth", "asymmetry"):
        line = lines[name]
        spectrum = np.abs(np.fft.rfft((line - line.mean()) * np.hanning(len(line)), 2 * len(line))) ** 2 / len(line)
        rate = np.fft.rfftfreq(2 * len(line), step_s)
        for low, high in pairwise(MODULATION_HZ):
            energies[f"{name} from {low} Hz"] = _log(spectrum[(rate >= low) & (rate < high)].sum(), 0.05)
    return energies


def _periodicity(above_db: np.ndarray, step_s: float) -> dict[str, float]:
    """Height and lag of the greatest peak of the autocorrelation in time of all rows together."""
    width = round(SLOW_S / step_s)
    rows = above_db - np.stack([np.convolve(row, np.ones(width) / width, "same") for row in above_db])
    count = rows.shape[1]
    spectrum = np.abs(np.fft.rfft(rows, 2 * count, axis=1)) ** 2
    correlation = np.fft.irfft(spectrum.sum(axis=0))[:count] / np.arange(count, 0, -1)
    correlation /= max(correlation[0], 1e-12)
    first, last = (round(period_s / step_s) for period_s in PERIODS_S)
    best = first + int(np.argmax(correlation[first:last]))
    return {"periodicity": float(correlation[best]), "period": best * step_s}


LINES_SMOOTHED = 3
"""Number of cells over which power is averaged, in both directions."""
LINES_FAR = 0.6
"""Fraction of the greatest speed beyond which most maps contain only noise."""
LINES_MARGIN_DB = 1.0
"""Distance of the threshold above the level that one in a hundred cells of noise exceeds [dB]."""
PARTS = 0.03, 0.5, 0.97
"""Fractions of the power above the threshold that lie below the lower line, the middle and the upper line."""
LINES_LEVELS = 10, 30, 50, 70, 90, 98
"""Percentiles over time of the lines that become features."""
BEYOND = 1.5, 2.2, 3.2
"""Multiples of the middle line's speed beyond which power counts as that of limbs."""
CADENCE_HZ = 0.6, 5.0
"""Least and greatest step rate [Hz]."""
DRIFT_S = 1.3
"""Changes over a longer time than this are drift [s]."""
PEAK_S = 0.5
"""Time from the fastest instant from which something counts as before or after it [s]."""


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of a smoothed spectrogram over time, (T,) each; 0 where nothing is above the threshold."""

    lower: np.ndarray
    middle: np.ndarray
    upper: np.ndarray
    mean: np.ndarray
    """Power-weighted mean speed [m/s], as the lines before, (T,)."""
    level: np.ndarray
    """Power above the noise floor, relative to it [dB], (T,)."""
    power: np.ndarray
    """Power above the noise floor in cells above the threshold, 0 elsewhere, (speed, T)."""
    occupied: float
    """Fraction of the cells that are above the threshold."""
    contrast_db: float
    """Level of the strong cells (99.5 % quantile) relative to the noise floor [dB]."""

    @classmethod
    def of(cls, levels_db: np.ndarray, velocity_mps: np.ndarray) -> Lines:
        """The lines of a spectrogram (speed, time) [dB]."""
        from scipy.ndimage import uniform_filter

        power = uniform_filter(10.0 ** (levels_db.astype(np.float64) / 10), LINES_SMOOTHED, mode="nearest")
        smooth_db = 10 * np.log10(power)
        speed = np.abs(velocity_mps)
        noise, moving = smooth_db[speed > LINES_FAR * speed.max()], speed >= NOTCH_MPS
        floor_db = float(np.median(noise))
        threshold_db = max(float(np.percentile(noise, 99)) + LINES_MARGIN_DB, float(smooth_db[moving].max()) - RANGE_DB)
        floor = 10 ** (floor_db / 10)
        above = (smooth_db > threshold_db) & moving[:, None]
        power_above = np.where(above, np.maximum(power - floor, 0.0), 0.0)
        total = power_above.sum(axis=0)
        present = total > 0
        below = np.cumsum(power_above, axis=0) / np.maximum(total, 1e-12)
        lower, middle, upper = (
            np.where(present, velocity_mps[np.argmax(below >= part, axis=0)], 0.0) for part in PARTS
        )
        mean = (power_above * velocity_mps[:, None]).sum(axis=0) / np.maximum(total, 1e-12)
        level = np.where(present, 10 * np.log10(np.maximum(total, 1e-12) / floor), 0.0)
        contrast_db = float(np.percentile(smooth_db[moving], 99.5)) - floor_db
        return cls(lower, middle, upper, mean, np.maximum(level, 0.0), power_above, float(above.mean()), contrast_db)


def activity_features(levels_db: np.ndarray, velocity_mps: np.ndarray, duration_s: float) -> dict[str, float]:
    """Features by name, for a spectrogram (speed, time) [dB, 0 at the greatest cell]."""
    lines = Lines.of(levels_db, velocity_mps)
    step_s = duration_s / levels_db.shape[1]
    level = _smooth(lines.level, 5)
    return {
        **_bursts(level, step_s),
        **_peak(lines, step_s),
        **_changes(lines, step_s),
        **_line_speeds(lines, np.abs(velocity_mps)),
        **_cadence({"width": lines.upper - lines.lower, "middle": lines.middle, "level": level}, step_s),
        "contrast": lines.contrast_db / 10,
        "occupied": _log(lines.occupied, 0.005),
    }


def _smooth(line: np.ndarray, width: int) -> np.ndarray:
    """Moving average over `width` columns."""
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(line, max(1, width)))


def _placed(weight: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Weights over time normalised to a sum of 1, their centre, and their spread about it, as fractions of the record."""
    fraction = weight / (weight.sum() + 1e-9)
    time_fraction = np.arange(len(weight)) / len(weight)
    centre = float((fraction * time_fraction).sum())
    return fraction, centre, float(np.sqrt((fraction * (time_fraction - centre) ** 2).sum()))


def _bursts(level: np.ndarray, step_s: float) -> dict[str, float]:
    """Times of high power: their position, number and duration."""
    _, centre, spread = _placed(level)
    high = level > 0.5 * np.percentile(level, 98)
    change = np.diff(np.r_[0, high.astype(int), 0])
    lengths = np.flatnonzero(change == -1) - np.flatnonzero(change == 1)
    longest = lengths.max() if len(lengths) else 0
    return {
        "centre of the power": centre,
        "spread of the power": spread,
        "time of high power": float(high.mean()),
        "bursts": _log(len(lengths)),
        "longest burst": _log(longest * step_s),
    }


def _peak(lines: Lines, step_s: float) -> dict[str, float]:
    """Movement before and after the fastest instant: a fall ends in rest, while steps go on."""
    square = _smooth((lines.upper - lines.lower) ** 2 + 4 * lines.middle**2, 7)
    fraction, centre, spread = _placed(square)
    fastest, away = int(np.argmax(fraction)), max(1, int(PEAK_S / step_s))
    before, after = fraction[: max(fastest - away, 1)], fraction[fastest + away :]
    mean_fraction = fraction.mean() + 1e-12
    return {
        "centre of the speed": centre,
        "spread of the speed": _log(spread, 0.02),
        "evenness of the speed": float(-(fraction * np.log(fraction + 1e-12)).sum()),
        "before the fastest": _log(before.mean() / mean_fraction, 0.05),
        "after the fastest": _log(after.mean() / mean_fraction if len(after) else 0.0, 0.05),
    }


def _changes(lines: Lines, step_s: float) -> dict[str, float]:
    """How often the body reverses its direction, and how fast the speeds of body and limbs change."""
    mean, width = _smooth(lines.mean, 5), lines.upper - lines.lower
    sides = np.sign(mean[np.abs(mean) > 0.15])
    of_mean = np.abs(np.gradient(mean, step_s))
    of_width = np.abs(np.gradient(_smooth(width, 3), step_s))
    return {
        "turns": _log(int((np.diff(sides) != 0).sum()), 1.0),
        "acceleration 95": _log(np.percentile(of_mean, 95)),
        "acceleration 50": _log(np.percentile(of_mean, 50)),
        "acceleration of the limbs": _log(np.percentile(of_width, 90) / (np.percentile(width, 90) + 0.1)),
        "greatest mean": _log(np.percentile(np.abs(mean), 95)),
    }


def _line_speeds(lines: Lines, speed: np.ndarray) -> dict[str, float]:
    """Percentiles of the lines, and the power at speeds beyond that of the body."""
    body = np.percentile(np.abs(lines.middle), 90) + 0.2
    total = max(float(lines.power.sum()), 1e-12)
    line_features = {
        f"power beyond {multiple} bodies": _log(lines.power[speed > multiple * body].sum() / total, 1e-3)
        for multiple in BEYOND
    }
    for level in LINES_LEVELS:
        lower_log, upper_log = (_log(np.percentile(np.abs(line), level)) for line in (lines.lower, lines.upper))
        line_features |= {
            f"outer line {level}": max(lower_log, upper_log),
            f"inner line {level}": min(lower_log, upper_log),
        }
        line_features[f"middle {level}"] = _log(np.percentile(np.abs(lines.middle), level))
        line_features[f"width {level}"] = _log(np.percentile(lines.upper - lines.lower, level))
    return line_features


def _cadence(lines: dict[str, np.ndarray], step_s: float) -> dict[str, float]:
    """For each line without its drift: mean rate of the periodic part, strongest rate, its fraction of the energy, and standard
    deviation."""
    cadence: dict[str, float] = {}
    for name, line in lines.items():
        count = len(line)
        steps = (line - _smooth(line, int(DRIFT_S / step_s))) * np.hanning(count)
        rate = np.fft.rfftfreq(4 * count, step_s)
        in_band = (rate > CADENCE_HZ[0]) & (rate < CADENCE_HZ[1])
        spectrum, rates = np.abs(np.fft.rfft(steps, 4 * count))[in_band] ** 2, np.log(rate[in_band])
        fraction = spectrum / (spectrum.sum() + 1e-12)
        strongest = int(np.argmax(fraction))
        cadence |= {
            f"mean rate of the {name}": float((fraction * rates).sum()),
            f"rate of the {name}": float(rates[strongest]),
            f"rhythm of the {name}": float(np.log(fraction[strongest] + 1e-3)),
            f"steps of the {name}": _log(float(steps.std())),
        }
    return cadence


BANDS_SMOOTHED = 3
"""Number of columns over which power is averaged."""
BANDS_FAR = 0.7
"""Fraction of the greatest speed beyond which most maps contain only noise."""
BANDS_MARGIN_DB, BANDS_RANGE_DB = 2.0, 40.0
"""Level above the median of the noise from which levels count, and the span over which they count [dB]."""
EDGES_MPS = (0.08, 0.24, 0.4, 0.55, 0.7, 0.85, 1.0, 1.2, 1.4, 1.65, 1.9, 2.2, 2.6, 3.0, 3.5, 4.2, 5.0, 6.2)
"""Edges of the bands whose levels become features [m/s]; a walking man's torso has 1 to 1.5 m/s and his feet three times that."""
WIDE_MPS = (0.3, 0.6, 1.0, 1.5, 2.2, 3.2, 4.5, 6.5)
"""Edges of the bands whose modulation becomes features [m/s]."""
RATES_HZ = (0.1, 0.3, 0.5, 0.75, 1.0, 1.3, 1.6, 2.0, 2.5, 3.2, 4.2, 6.0, 9.0)
"""Edges of the bands of modulation frequency [Hz], from a single movement to jerks."""
BANDS_LEVELS = 15, 40, 65, 85, 97
"""Percentiles over time of the bands' levels."""
LAGS_S = 0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.4
"""Time lags at which a band is correlated with itself [s]."""
SLOW_BANDS = 6
"""Number of bands that count as torso; the others count as limbs."""
ACTIVE_DB = 6.0
BODY_DB = 15.0
"""Sum of the levels of a column [dB] above which its mean speed counts as that of a body."""


def band_features(levels_db: np.ndarray, velocity_mps: np.ndarray, duration_s: float) -> dict[str, float]:
    """Features by name, for a spectrogram (speed, time) [dB]."""
    above = _above_noise(levels_db, velocity_mps)
    step_s = duration_s / above.shape[1]
    half = len(velocity_mps) // 2
    sides = above[-half:], above[:half][::-1]
    speed = velocity_mps[-half:]
    coming, going = (_bands(side, speed, EDGES_MPS) for side in sides)
    both_sides = decibel(10.0 ** (coming / 10.0) + 10.0 ** (going / 10.0))
    return {
        **_levels("both sides", both_sides),
        **_levels("weaker side", np.minimum(coming, going)),
        **_numbered("one-sided", np.abs((coming - going).mean(axis=1))),
        **_numbered("difference of sides", np.abs(coming - going).mean(axis=1)),
        **_likeness(both_sides, step_s),
        **_band_modulation(sides, speed, step_s),
        **_body(above, velocity_mps, step_s),
        **_activity(both_sides),
    }


def _above_noise(levels_db: np.ndarray, velocity_mps: np.ndarray) -> np.ndarray:
    """Levels above the noise and `BANDS_MARGIN_DB` [dB], from 0 to `BANDS_RANGE_DB`."""
    from scipy.ndimage import uniform_filter1d

    power = uniform_filter1d(10.0 ** (levels_db.astype(np.float64) / 10.0), BANDS_SMOOTHED, axis=1, mode="nearest")
    smooth = decibel(power)
    speed = np.abs(velocity_mps)
    floor_db = float(np.median(smooth[speed > BANDS_FAR * speed.max()]))
    return np.asarray(np.clip(smooth - floor_db - BANDS_MARGIN_DB, 0.0, BANDS_RANGE_DB))


def _cuts(axis: np.ndarray, edges: tuple[float, ...]) -> list[slice]:
    """Slice of an ascending axis for each band; a band without a cell of its own gets the nearest one."""
    places = np.minimum(np.searchsorted(axis, edges), len(axis) - 1)
    return [slice(int(low), int(max(high, low + 1))) for low, high in pairwise(places)]


def _bands(side: np.ndarray, speed: np.ndarray, edges: tuple[float, ...]) -> np.ndarray:
    """Mean level of each band over time, (B, T)."""
    return np.stack([side[cut].mean(axis=0) for cut in _cuts(speed, edges)])


def _numbered(name: str, values: np.ndarray) -> dict[str, float]:
    """Features whose names are a common name and a number."""
    return {f"{name} {number}": float(value) for number, value in enumerate(np.ravel(values))}


def _levels(name: str, bands: np.ndarray) -> dict[str, float]:
    """Percentiles over time of the level of each band."""
    return _numbered(f"levels of {name}", np.percentile(bands, BANDS_LEVELS, axis=1))


def _likeness(bands: np.ndarray, step_s: float) -> dict[str, float]:
    """Autocorrelation of torso and limbs at some time lags."""
    correlations = {}
    change = bands - bands.mean(axis=1, keepdims=True)
    for name, rows in (("torso", change[:SLOW_BANDS]), ("limbs", change[SLOW_BANDS:])):
        total_power = float((rows**2).mean(axis=1).sum()) + len(rows)
        for lag_s in LAGS_S:
            lag = min(max(1, round(lag_s / step_s)), rows.shape[1] - 1)
            correlations[f"{name} after {lag_s} s"] = (
                float((rows[:, lag:] * rows[:, :-lag]).mean(axis=1).sum()) / total_power
            )
    return correlations


def _spectrum(lines: np.ndarray, step_s: float) -> np.ndarray:
    """Root mean square of the modulation of lines (..., T) in each band of frequencies."""
    count = lines.shape[-1]
    change = lines - lines.mean(axis=-1, keepdims=True)
    power = np.abs(np.fft.rfft(change * np.hanning(count)) / count) ** 2
    cuts = _cuts(np.fft.rfftfreq(count, step_s), RATES_HZ)
    return np.sqrt(np.stack([power[..., cut].mean(axis=-1) for cut in cuts], axis=-1))


def _band_modulation(sides: tuple[np.ndarray, np.ndarray], speed: np.ndarray, step_s: float) -> dict[str, float]:
    """Modulation of the mean over both signs of speed, in wide bands, so that the direction has no effect."""
    bands = np.mean([_bands(side, speed, WIDE_MPS) for side in sides], axis=0)
    return _numbered("modulation", np.log(_spectrum(bands, step_s) + 0.05))


def _body(above: np.ndarray, velocity_mps: np.ndarray, step_s: float) -> dict[str, float]:
    """Modulation of the mean speed, and end and span of its integral over time, the radial displacement [m]."""
    power = np.where((above > 3.0) & (np.abs(velocity_mps)[:, None] > NOTCH_MPS), 10.0 ** (above / 10.0), 0.0)
    total = power.sum(axis=0) + 1.0
    mean = (power * velocity_mps[:, None]).sum(axis=0) / total
    track = np.cumsum(np.where(decibel(total) > BODY_DB, mean, 0.0)) * step_s
    last = float(track[-1])
    ahead = track if last >= 0 else -track
    return {
        **_numbered("modulation of the mean speed", np.log(_spectrum(mean, step_s) + 0.002)),
        "track": abs(last),
        "span of the track": float(np.ptp(track)),
        "beyond the end": float(ahead.max() - ahead[-1]),
        "behind the start": float(-min(ahead.min(), 0.0)),
        "length of the track": float(np.abs(np.diff(track)).sum()),
    }


def _activity(bands: np.ndarray) -> dict[str, float]:
    """How long and how often a band of the limbs is well above the noise."""
    active = bands[3:].max(axis=0) > ACTIVE_DB
    return {
        "time of activity": float(active.mean()),
        "starts of activity": float(np.abs(np.diff(active.astype(int))).sum()),
    }
