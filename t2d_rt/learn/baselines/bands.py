"""Features of bands of speed: how strong each is for how much of the time, how it comes and goes, and how far the body gets.

Only the course of the movement may tell when in a map it happens; these do not, so that windows that slide over a recording change
them little. None tells approaching from receding.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from t2d_rt.core.decibels import decibel
from t2d_rt.dataset.envelope import NOTCH_MPS

SMOOTHED = 3
"""Columns over which power is averaged."""
FAR = 0.7
"""Speeds beyond this part of the greatest one hold noise alone in most maps."""
MARGIN_DB, RANGE_DB = 2.0, 40.0
"""Levels count from so far above the median of the noise, over so many decibels."""
EDGES_MPS = (0.08, 0.24, 0.4, 0.55, 0.7, 0.85, 1.0, 1.2, 1.4, 1.65, 1.9, 2.2, 2.6, 3.0, 3.5, 4.2, 5.0, 6.2)
"""Of the bands whose levels are told; a man walks with a torso of 1 to 1.5 m/s and feet of three times that."""
WIDE_MPS = (0.3, 0.6, 1.0, 1.5, 2.2, 3.2, 4.5, 6.5)
"""Of the bands whose modulation is told."""
RATES_HZ = (0.1, 0.3, 0.5, 0.75, 1.0, 1.3, 1.6, 2.0, 2.5, 3.2, 4.2, 6.0, 9.0)
"""Edges of bands of modulation, from a single movement to jerks."""
LEVELS = 15, 40, 65, 85, 97
"""Percentiles over time."""
LAGS_S = 0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.4
"""At which a band is compared with itself."""
SLOW = 6
"""Bands of the torso; the others are of limbs."""
ACTIVE_DB = 6.0
BODY_DB = 15.0
"""Sum of the cells of a column, above which its mean speed is that of a body."""


def band_features(levels_db: np.ndarray, velocity_mps: np.ndarray, duration_s: float) -> dict[str, float]:
    """Features of a spectrogram (speed, time) [dB] by name."""
    above = _above_noise(levels_db, velocity_mps)
    step_s = duration_s / above.shape[1]
    half = len(velocity_mps) // 2
    sides = above[-half:], above[:half][::-1]
    speed = velocity_mps[-half:]
    coming, going = (_bands(each, speed, EDGES_MPS) for each in sides)
    both = decibel(10.0 ** (coming / 10.0) + 10.0 ** (going / 10.0))
    return {
        **_levels("both sides", both), **_levels("weaker side", np.minimum(coming, going)),
        **_numbered("one-sided", np.abs((coming - going).mean(axis=1))),
        **_numbered("difference of sides", np.abs(coming - going).mean(axis=1)),
        **_likeness(both, step_s), **_modulation(sides, speed, step_s), **_body(above, velocity_mps, step_s), **_activity(both),
    }  # fmt: skip


def _above_noise(levels_db: np.ndarray, velocity_mps: np.ndarray) -> np.ndarray:
    """Levels above that of the noise [dB], 0 and more."""
    from scipy.ndimage import uniform_filter1d

    power = uniform_filter1d(10.0 ** (levels_db.astype(np.float64) / 10.0), SMOOTHED, axis=1, mode="nearest")
    smooth = decibel(power)
    speed = np.abs(velocity_mps)
    floor_db = float(np.median(smooth[speed > FAR * speed.max()]))
    return np.asarray(np.clip(smooth - floor_db - MARGIN_DB, 0.0, RANGE_DB))


def _cuts(axis: np.ndarray, edges: tuple[float, ...]) -> list[slice]:
    """Places of each band on an ascending axis; a band that has no cell of its own takes the nearest one."""
    at = np.minimum(np.searchsorted(axis, edges), len(axis) - 1)
    return [slice(int(low), int(max(high, low + 1))) for low, high in pairwise(at)]


def _bands(side: np.ndarray, speed: np.ndarray, edges: tuple[float, ...]) -> np.ndarray:
    """Mean level of each band over time, (B, T)."""
    return np.stack([side[cut].mean(axis=0) for cut in _cuts(speed, edges)])


def _numbered(name: str, values: np.ndarray) -> dict[str, float]:
    return {f"{name} {number}": float(value) for number, value in enumerate(np.ravel(values))}


def _levels(name: str, bands: np.ndarray) -> dict[str, float]:
    return _numbered(f"levels of {name}", np.percentile(bands, LEVELS, axis=1))


def _likeness(bands: np.ndarray, step_s: float) -> dict[str, float]:
    """Correlation of torso and limbs with themselves a while later."""
    found = {}
    change = bands - bands.mean(axis=1, keepdims=True)
    for name, rows in (("torso", change[:SLOW]), ("limbs", change[SLOW:])):
        whole = float((rows**2).mean(axis=1).sum()) + len(rows)
        for lag_s in LAGS_S:
            lag = min(max(1, round(lag_s / step_s)), rows.shape[1] - 1)
            found[f"{name} after {lag_s} s"] = float((rows[:, lag:] * rows[:, :-lag]).mean(axis=1).sum()) / whole
    return found


def _spectrum(lines: np.ndarray, step_s: float) -> np.ndarray:
    """Root mean square of the modulation of lines (..., T) in each band of rates."""
    count = lines.shape[-1]
    change = lines - lines.mean(axis=-1, keepdims=True)
    power = np.abs(np.fft.rfft(change * np.hanning(count)) / count) ** 2
    cuts = _cuts(np.fft.rfftfreq(count, step_s), RATES_HZ)
    return np.sqrt(np.stack([power[..., cut].mean(axis=-1) for cut in cuts], axis=-1))


def _modulation(sides: tuple[np.ndarray, np.ndarray], speed: np.ndarray, step_s: float) -> dict[str, float]:
    bands = np.mean([_bands(each, speed, WIDE_MPS) for each in sides], axis=0)
    return _numbered("modulation", np.log(_spectrum(bands, step_s) + 0.05))


def _body(above: np.ndarray, velocity_mps: np.ndarray, step_s: float) -> dict[str, float]:
    """Modulation of the mean speed, and the track of its integral [m]."""
    power = np.where((above > 3.0) & (np.abs(velocity_mps)[:, None] > NOTCH_MPS), 10.0 ** (above / 10.0), 0.0)
    total = power.sum(axis=0) + 1.0
    mean = (power * velocity_mps[:, None]).sum(axis=0) / total
    track = np.cumsum(np.where(decibel(total) > BODY_DB, mean, 0.0)) * step_s
    last = float(track[-1])
    ahead = track if last >= 0 else -track
    return {
        **_numbered("modulation of the mean speed", np.log(_spectrum(mean, step_s) + 0.002)),
        "track": abs(last), "span of the track": float(np.ptp(track)), "beyond the end": float(ahead.max() - ahead[-1]),
        "behind the start": float(-min(ahead.min(), 0.0)), "length of the track": float(np.abs(np.diff(track)).sum()),
    }  # fmt: skip


def _activity(bands: np.ndarray) -> dict[str, float]:
    active = bands[3:].max(axis=0) > ACTIVE_DB
    return {
        "time of activity": float(active.mean()),
        "starts of activity": float(np.abs(np.diff(active.astype(int))).sum()),
    }
