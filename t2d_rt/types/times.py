"""Times at which a moving target is known."""

from __future__ import annotations

from typing import Any

import numpy as np

from t2d_rt.core.checks import array, numeric
from t2d_rt.core.errors import InputError

LATEST_S = 1e10
"""Times count from anywhere, such as 1970, but not in nanoseconds."""
LEAST_STEP_S = 1e-9


def checked_times(value: Any) -> np.ndarray:
    """At least two finite, increasing times as a float64 array of one's own (T,)."""
    times_s = numeric("times_s", value)
    if times_s.ndim != 1 or len(times_s) < 2:
        raise InputError(
            f"times_s must hold at least 2 times, got shape {times_s.shape}; a static target needs two equal frames"
        )
    if not np.isfinite(times_s).all():
        raise InputError("times_s must be finite and increasing, got NaN or infinite times")
    times_s = array("times_s", times_s, limit=LATEST_S, unit="s").copy()
    if not (np.diff(times_s) >= LEAST_STEP_S).all():
        raise InputError(
            f"times_s must be finite and increasing, by {LEAST_STEP_S:g} s at least, got a step of {np.diff(times_s).min():.4g} s"
        )
    return times_s


def within(asked_s: np.ndarray, known_s: np.ndarray, name: str) -> np.ndarray:
    """`asked_s` as an array of times (K,) between the first and last of `known_s`, to rounding."""
    asked_s = np.atleast_1d(array("times_s", asked_s))
    if asked_s.ndim != 1:
        raise InputError(f"times_s must be one time or a list of times, got shape {asked_s.shape}")
    slack = 1e-9 * max(1.0, abs(known_s[-1]))
    if asked_s.size and (asked_s.min() < known_s[0] - slack or asked_s.max() > known_s[-1] + slack):
        raise InputError(
            f"{name} is known from {known_s[0]:.6g} s to {known_s[-1]:.6g} s, asked for {asked_s.min():.6g} s to "
            f"{asked_s.max():.6g} s; give a longer motion or a shorter duration"
        )
    return np.clip(asked_s, known_s[0], known_s[-1])
