"""How what is given at frames goes on between them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np


def spline(times_s: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """C2 cubic interpolation in time of values (T, ...); a straight line or parabola where there are only 2 or 3 frames.

    It can be pickled."""
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
