"""Features of the course of a movement: when it happens, for how long and what follows, from a spectrogram that is smoothed.

Means over 3 x 3 cells take the speckle from the noise, so that limbs show that single cells of noise exceed; the lines are those
speeds below which parts of the power lie, which one cell more or less does not move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.dataset.envelope import NOTCH_MPS, RANGE_DB

SMOOTHED = 3
"""Cells over which power is averaged, each way."""
FAR = 0.6
"""Speeds beyond this part of the greatest one hold noise alone in most maps."""
MARGIN_DB = 1.0
"""Of the threshold above the level that one in a hundred cells of noise exceeds."""
PARTS = 0.03, 0.5, 0.97
"""Of the power above the threshold, below the lower line, the middle and the upper line."""
LEVELS = 10, 30, 50, 70, 90, 98
"""Percentiles at which lines are told."""
BEYOND = 1.5, 2.2, 3.2
"""Multiples of the middle's speed beyond which the limbs' power is told."""
CADENCE_HZ = 0.6, 5.0
"""Least and greatest rate of steps."""
DRIFT_S = 1.3
"""What changes over a longer time is no step."""
PEAK_S = 0.5
"""What lies so far from the fastest instant is before or after it."""


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of a smoothed spectrogram over time, (T,); 0 where nothing is above the threshold."""

    lower: np.ndarray
    middle: np.ndarray
    upper: np.ndarray
    mean: np.ndarray
    """Speeds [m/s]."""
    level: np.ndarray
    """Power above the floor, relative to it [dB]."""
    power: np.ndarray
    """Of the cells above the threshold, the floor's taken off, (speed, T)."""
    occupied: float
    """Fraction of the cells above the threshold."""
    contrast_db: float
    """Between the strong cells and the floor."""

    @classmethod
    def of(cls, levels_db: np.ndarray, velocity_mps: np.ndarray) -> Lines:
        """Of a spectrogram (speed, time) [dB]."""
        from scipy.ndimage import uniform_filter

        power = uniform_filter(10.0 ** (levels_db.astype(np.float64) / 10), SMOOTHED, mode="nearest")
        smooth_db = 10 * np.log10(power)
        speed = np.abs(velocity_mps)
        noise, moving = smooth_db[speed > FAR * speed.max()], speed >= NOTCH_MPS
        floor_db = float(np.median(noise))
        threshold_db = max(float(np.percentile(noise, 99)) + MARGIN_DB, float(smooth_db[moving].max()) - RANGE_DB)
        floor = 10 ** (floor_db / 10)
        above = (smooth_db > threshold_db) & moving[:, None]
        kept = np.where(above, np.maximum(power - floor, 0.0), 0.0)
        total = kept.sum(axis=0)
        shown = total > 0
        below = np.cumsum(kept, axis=0) / np.maximum(total, 1e-12)
        lower, middle, upper = (np.where(shown, velocity_mps[np.argmax(below >= part, axis=0)], 0.0) for part in PARTS)
        mean = (kept * velocity_mps[:, None]).sum(axis=0) / np.maximum(total, 1e-12)
        level = np.where(shown, 10 * np.log10(np.maximum(total, 1e-12) / floor), 0.0)
        contrast_db = float(np.percentile(smooth_db[moving], 99.5)) - floor_db
        return cls(lower, middle, upper, mean, np.maximum(level, 0.0), kept, float(above.mean()), contrast_db)


def course(levels_db: np.ndarray, velocity_mps: np.ndarray, duration_s: float) -> dict[str, float]:
    """Features of a spectrogram (speed, time) [dB, 0 at the greatest cell] by name."""
    lines = Lines.of(levels_db, velocity_mps)
    step_s = duration_s / levels_db.shape[1]
    level = _smooth(lines.level, 5)
    return {
        **_bursts(level, step_s), **_peak(lines, step_s), **_changes(lines, step_s), **_speeds(lines, np.abs(velocity_mps)),
        **_cadence({"width": lines.upper - lines.lower, "middle": lines.middle, "level": level}, step_s),
        "contrast": lines.contrast_db / 10, "occupied": _log(lines.occupied, 0.005),
    }  # fmt: skip


def _log(value: float, least: float = 0.1) -> float:
    return float(np.log(max(float(value), 0.0) + least))


def _smooth(line: np.ndarray, width: int) -> np.ndarray:
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(line, max(1, width)))


def _placed(weight: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Weights over time of sum 1, where their centre is, and how far they spread about it, in parts of the record."""
    fraction = weight / (weight.sum() + 1e-9)
    at = np.arange(len(weight)) / len(weight)
    centre = float((fraction * at).sum())
    return fraction, centre, float(np.sqrt((fraction * (at - centre) ** 2).sum()))


def _bursts(level: np.ndarray, step_s: float) -> dict[str, float]:
    """Times of high power: where they lie, how many and how long."""
    _, centre, spread = _placed(level)
    high = level > 0.5 * np.percentile(level, 98)
    change = np.diff(np.r_[0, high.astype(int), 0])
    lengths = np.flatnonzero(change == -1) - np.flatnonzero(change == 1)
    longest = lengths.max() if len(lengths) else 0
    return {
        "centre of the power": centre, "spread of the power": spread, "time of high power": float(high.mean()),
        "bursts": _log(len(lengths)), "longest burst": _log(longest * step_s),
    }  # fmt: skip


def _peak(lines: Lines, step_s: float) -> dict[str, float]:
    """The fastest instant: whether anything moves before and after it. A fall ends in rest, steps go on."""
    square = _smooth((lines.upper - lines.lower) ** 2 + 4 * lines.middle**2, 7)
    fraction, centre, spread = _placed(square)
    fastest, away = int(np.argmax(fraction)), max(1, int(PEAK_S / step_s))
    before, after = fraction[: max(fastest - away, 1)], fraction[fastest + away :]
    whole = fraction.mean() + 1e-12
    return {
        "centre of the speed": centre, "spread of the speed": _log(spread, 0.02),
        "evenness of the speed": float(-(fraction * np.log(fraction + 1e-12)).sum()),
        "before the fastest": _log(before.mean() / whole, 0.05),
        "after the fastest": _log(after.mean() / whole if len(after) else 0.0, 0.05),
    }  # fmt: skip


def _changes(lines: Lines, step_s: float) -> dict[str, float]:
    """How often the body turns back, and how fast it and its limbs change speed."""
    mean, width = _smooth(lines.mean, 5), lines.upper - lines.lower
    sides = np.sign(mean[np.abs(mean) > 0.15])
    of_mean = np.abs(np.gradient(mean, step_s))
    of_width = np.abs(np.gradient(_smooth(width, 3), step_s))
    return {
        "turns": _log(int((np.diff(sides) != 0).sum()), 1.0),
        "acceleration 95": _log(np.percentile(of_mean, 95)), "acceleration 50": _log(np.percentile(of_mean, 50)),
        "acceleration of the limbs": _log(np.percentile(of_width, 90) / (np.percentile(width, 90) + 0.1)),
        "greatest mean": _log(np.percentile(np.abs(mean), 95)),
    }  # fmt: skip


def _speeds(lines: Lines, speed: np.ndarray) -> dict[str, float]:
    """Percentiles of the lines, and the power of what is faster than the body."""
    body = np.percentile(np.abs(lines.middle), 90) + 0.2
    total = max(float(lines.power.sum()), 1e-12)
    found = {
        f"power beyond {each} bodies": _log(lines.power[speed > each * body].sum() / total, 1e-3) for each in BEYOND
    }
    for level in LEVELS:
        one, other = (_log(np.percentile(np.abs(line), level)) for line in (lines.lower, lines.upper))
        found |= {f"outer line {level}": max(one, other), f"inner line {level}": min(one, other)}
        found[f"middle {level}"] = _log(np.percentile(np.abs(lines.middle), level))
        found[f"width {level}"] = _log(np.percentile(lines.upper - lines.lower, level))
    return found


def _cadence(lines: dict[str, np.ndarray], step_s: float) -> dict[str, float]:
    """Of each line, less its drift: the mean rate of what is periodic, the strongest rate and its fraction, and the deviation."""
    found: dict[str, float] = {}
    for name, line in lines.items():
        count = len(line)
        steps = (line - _smooth(line, int(DRIFT_S / step_s))) * np.hanning(count)
        rate = np.fft.rfftfreq(4 * count, step_s)
        shown = (rate > CADENCE_HZ[0]) & (rate < CADENCE_HZ[1])
        spectrum, rates = np.abs(np.fft.rfft(steps, 4 * count))[shown] ** 2, np.log(rate[shown])
        fraction = spectrum / (spectrum.sum() + 1e-12)
        strongest = int(np.argmax(fraction))
        found |= {
            f"mean rate of the {name}": float((fraction * rates).sum()), f"rate of the {name}": float(rates[strongest]),
            f"rhythm of the {name}": float(np.log(fraction[strongest] + 1e-3)), f"steps of the {name}": _log(float(steps.std())),
        }  # fmt: skip
    return found
