"""Interpolation in time between the frames of a moving target, checks of times, and setting fields of frozen values."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, numeric
from t2d_rt.core.errors import InputError


def spline(times_s: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """C2 cubic interpolation in time of values (T, ...); a straight line or a parabola where there are only 2 or 3 frames.

    The returned function can be pickled.
    """
    if (values == values[:1]).all():
        return partial(_constant, values[:1])
    from scipy.interpolate import CubicSpline, make_interp_spline

    few = len(times_s) < 4
    curve = make_interp_spline(times_s, values, k=len(times_s) - 1) if few else CubicSpline(times_s, values)
    return partial(_on_curve, curve)


def _constant(value: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    return np.repeat(value, len(times_s), axis=0)


def _on_curve(curve: Callable[[np.ndarray], np.ndarray], times_s: np.ndarray) -> np.ndarray:
    return np.asarray(curve(times_s))


LEAST_STEP_S = 1e-9


def checked_times(value: Any) -> np.ndarray:
    """A copy of at least two finite, increasing times, float64 (T,)."""
    times_s = numeric("times_s", value)
    if times_s.ndim != 1 or len(times_s) < 2:
        raise InputError(
            f"times_s must hold at least 2 times, got shape {times_s.shape}; a static target needs two equal frames"
        )
    if not np.isfinite(times_s).all():
        raise InputError("times_s must be finite and increasing, got NaN or infinite times")
    # Times may count from any origin, such as 1970, but not in nanoseconds.
    times_s = array("times_s", times_s, limit=1e10, unit="s").copy()
    if not (np.diff(times_s) >= LEAST_STEP_S).all():
        raise InputError(
            f"times_s must be finite and increasing, by {LEAST_STEP_S:g} s at least, got a step of {np.diff(times_s).min():.4g} s"
        )
    return times_s


def within(asked_s: np.ndarray, known_s: np.ndarray, name: str) -> np.ndarray:
    """Times that are asked for as an array (K,); refuses those outside of `known_s`, except for rounding. `name` is for the
    error."""
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


def set_fields(value: Any, **fields: Any) -> None:
    """Sets fields of a frozen value while it is being constructed."""
    for name, field in fields.items():
        object.__setattr__(value, name, field)
