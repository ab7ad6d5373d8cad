"""How what is given at frames goes on between them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def spline(times_s: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """C2 cubic interpolation in time of values (T, ...); a straight line or parabola where there are only 2 or 3 frames."""
    if (values == values[:1]).all():
        return lambda t: np.repeat(values[:1], len(t), axis=0)
    from scipy.interpolate import CubicSpline, make_interp_spline

    few = len(times_s) < 4
    curve = make_interp_spline(times_s, values, k=len(times_s) - 1) if few else CubicSpline(times_s, values)
    return lambda t: np.asarray(curve(t))
