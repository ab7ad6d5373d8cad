"""Times at which a moving shape is known."""

from __future__ import annotations

import numpy as np

from t2d_rt.errors import InputError


def check_times(times_s: np.ndarray) -> None:
    """At least two finite, increasing times."""
    if times_s.ndim != 1 or len(times_s) < 2:
        raise InputError(f"times_s must hold at least 2 times, got shape {times_s.shape}; a still target stands twice")
    if not np.isfinite(times_s).all() or not (np.diff(times_s) > 0).all():
        raise InputError("times_s must be finite and increasing")


def within(asked_s: np.ndarray, known_s: np.ndarray, name: str) -> np.ndarray:
    """`asked_s` as an array of times between the first and last of `known_s`, to rounding."""
    asked_s = np.atleast_1d(np.asarray(asked_s, dtype=np.float64))
    slack = 1e-9 * max(1.0, abs(known_s[-1]))
    if asked_s.size and (asked_s.min() < known_s[0] - slack or asked_s.max() > known_s[-1] + slack):
        raise InputError(
            f"{name} is known from {known_s[0]:.6g} s to {known_s[-1]:.6g} s, asked for {asked_s.min():.6g} s to "
            f"{asked_s.max():.6g} s; give a longer motion or a shorter duration"
        )
    return np.clip(asked_s, known_s[0], known_s[-1])
