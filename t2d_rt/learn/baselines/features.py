"""Features of a Doppler envelope, as radar work on human activities has them since Kim and Ling (2009): speeds of the torso, total
bandwidth, its asymmetry, what the limbs add, and how all of them are modulated in time. None tells approaching from receding.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.dataset.envelope import NOTCH_MPS, envelope
from t2d_rt.learn.baselines.course import course

SPEEDS_MPS = (NOTCH_MPS, 0.3, 0.6, 1.0, 1.5, 2.2, 3.2, 4.5, 10.0)
"""Edges of the bands in which a Doppler profile is told."""
MODULATION_HZ = (0.0, 0.4, 0.9, 1.5, 2.4, 4.0, 8.0)
"""Edges of the bands of modulation: a fall or a bend; slow swings; strides; steps of walking; of running; what jerks."""
PERIODS_S = (0.25, 1.4)
"""Least and greatest period of steps that is looked for."""
SLOW_S = 1.2
"""What changes over a longer time is no step."""
SHORTEST_S, WIDEST_S = 1.2, 0.7
"""Of a map and of its cells: less does not hold a period of the slowest steps, wider ones do not tell them."""


def check_steps(noun: str, columns: int, duration_s: float) -> None:
    """Refuses maps whose features cannot tell steps; noun: what takes features, in the plural."""
    cell_s = duration_s / columns
    if duration_s < SHORTEST_S or cell_s > WIDEST_S:
        raise InputError(
            f"{noun} take maps of {SHORTEST_S:g} s or more in cells of {WIDEST_S:g} s at most, in which steps are seen, got "
            f"{duration_s:.3g} s in cells of {cell_s:.2g} s; take maps of more cells, longer samples, or a network on pictures"
        )


def features(levels_db: np.ndarray, velocity_mps: np.ndarray, duration_s: float) -> dict[str, float]:
    """Features of a spectrogram (speed, time) [dB, 0 at the greatest cell] by name."""
    levels, velocity = levels_db.astype(np.float64), velocity_mps
    found = envelope(levels, velocity)
    fast = np.abs(velocity)[:, None] >= NOTCH_MPS
    power = np.where((levels > found.threshold_db) & fast, 10.0 ** (levels / 10.0), 0.0)
    total = np.maximum(power.sum(axis=0), 1e-12)
    mean = (power * velocity[:, None]).sum(axis=0) / total
    spread = np.sqrt((power * (velocity[:, None] - mean) ** 2).sum(axis=0) / total)
    lines = {
        "torso": found.torso_mps, "mean": mean, "spread": spread, "bandwidth": found.upper_mps - found.lower_mps,
        "asymmetry": found.upper_mps + found.lower_mps,
    }  # fmt: skip
    step_s = duration_s / levels.shape[1]
    return {
        **_speeds(found.upper_mps, -found.lower_mps, lines),
        **_profile(levels > found.threshold_db, power, velocity),
        **_modulation(lines, step_s),
        **_periodicity(np.where(fast, np.clip(levels - found.threshold_db, 0, 15), 0.0), step_s),
        **course(levels, velocity, duration_s),
    }


def _log(value: float, least: float = 0.1) -> float:
    return float(np.log(max(value, 0.0) + least))


def _speeds(upper: np.ndarray, lower: np.ndarray, lines: dict[str, np.ndarray]) -> dict[str, float]:
    """Percentiles of the envelope's lines, and how they compare."""
    bandwidth, torso = lines["bandwidth"], np.abs(lines["torso"])
    spans = {
        "outer": (np.maximum(upper, lower), (25, 50, 75, 95, 100)), "bandwidth": (bandwidth, (10, 50, 90)),
        "torso": (torso, (25, 50, 75, 95)), "mean": (np.abs(lines["mean"]), (50, 95)), "spread": (lines["spread"], (10, 50, 90)),
        "both sides": (np.minimum(upper, lower), (50, 95)),
    }  # fmt: skip
    found = {
        f"{name} {level}": _log(np.percentile(line, level))
        for name, (line, levels) in spans.items()
        for level in levels
    }
    mean_signs = np.mean(lines["mean"] > 0.3), np.mean(lines["mean"] < -0.3)
    middle = bandwidth.mean() + 0.1
    last = len(bandwidth) // 5
    return found | {
        "net": _log(abs(lines["torso"].mean())), "range of the torso": _log(np.ptp(lines["torso"])),
        "one way": float(max(mean_signs)), "other way": float(min(mean_signs)),
        "asymmetry": abs(lines["asymmetry"].mean()) / middle, "burst": bandwidth.std() / middle,
        "peak": _log(bandwidth.max() / middle), "active": float(np.mean(bandwidth > 0.6)), "busy": float(np.mean(bandwidth > 1.5)),
        "end": _log(bandwidth[-last:].mean() / middle),
        "limbs": _log((np.percentile(bandwidth, 75) + 0.1) / (np.percentile(torso, 75) + 0.1)),
    }  # fmt: skip


def _profile(above: np.ndarray, power: np.ndarray, velocity: np.ndarray) -> dict[str, float]:
    """Occupied cells and power by speed."""
    found = {}
    for low, high in pairwise(SPEEDS_MPS):
        rows = (np.abs(velocity) >= low) & (np.abs(velocity) < high)
        occupied = above[rows].mean() if rows.any() else 0.0  # the map may end before these speeds
        found[f"cells from {low} m/s"] = _log(occupied, 0.01)
        found[f"power from {low} m/s"] = _log(power[rows].sum() / max(power.sum(), 1e-12), 1e-4)
    return found


def _modulation(lines: dict[str, np.ndarray], step_s: float) -> dict[str, float]:
    """Energy of each line in bands of modulation."""
    found = {}
    for name in ("mean", "spread", "bandwidth", "asymmetry"):
        line = lines[name]
        spectrum = np.abs(np.fft.rfft((line - line.mean()) * np.hanning(len(line)), 2 * len(line))) ** 2 / len(line)
        rate = np.fft.rfftfreq(2 * len(line), step_s)
        for low, high in pairwise(MODULATION_HZ):
            found[f"{name} from {low} Hz"] = _log(spectrum[(rate >= low) & (rate < high)].sum(), 0.05)
    return found


def _periodicity(shown: np.ndarray, step_s: float) -> dict[str, float]:
    """The highest peak of the autocorrelation in time of all rows together, and where it is."""
    width = round(SLOW_S / step_s)
    rows = shown - np.stack([np.convolve(each, np.ones(width) / width, "same") for each in shown])
    count = rows.shape[1]
    spectrum = np.abs(np.fft.rfft(rows, 2 * count, axis=1)) ** 2
    correlation = np.fft.irfft(spectrum.sum(axis=0))[:count] / np.arange(count, 0, -1)
    correlation /= max(correlation[0], 1e-12)
    first, last = (round(each / step_s) for each in PERIODS_S)
    best = first + int(np.argmax(correlation[first:last]))
    return {"periodicity": float(correlation[best]), "period": best * step_s}
