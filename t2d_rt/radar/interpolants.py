"""Interpolation of echoes between frames, as matrices, the same for all code that needs it (docs/physics.md, eq. 14).

Within the interval from frame i to i+1, with u in 0..1, both delay and amplitude are cubic Hermite polynomials of the values and
slopes at the two frames. The slopes differ: those of the delay are from a C2 spline, those of the amplitude are central
differences.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

END_FRAMES = 5
"""Number of frames, or all if there are fewer, from which the slope of the delay at either end is computed; more would have a
greater error (docs/decisions.md)."""


@lru_cache(maxsize=64)
def spline_slopes(frames: int) -> np.ndarray:
    """Matrix (T, T) from values at unit-spaced frames to the derivatives of a C2 cubic spline there. At either end the slope is
    that of the polynomial through the nearest five frames."""
    from scipy.interpolate import CubicSpline

    end_frames = min(frames, END_FRAMES)
    powers = np.vander(np.arange(end_frames), increasing=True)
    ends = np.zeros((2, frames))
    ends[0, :end_frames] = np.linalg.inv(powers)[1]
    ends[1] = -ends[0, ::-1]
    spline = CubicSpline(np.arange(frames), np.eye(frames), bc_type=((1, ends[0]), (1, ends[1])))
    matrix = np.asarray(spline(np.arange(frames), 1))
    matrix.setflags(write=False)
    return matrix


def central_slopes(values: np.ndarray) -> np.ndarray:
    """Central differences of values (T, ...) at unit spacing, one-sided at both ends."""
    slopes = np.empty_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) * 0.5
    slopes[0] = values[1] - values[0]
    slopes[-1] = values[-1] - values[-2]
    return slopes


def hermite(
    start: np.ndarray, end: np.ndarray, slope_start: np.ndarray, slope_end: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Coefficients c0..c3 of c0 + c1 u + c2 u^2 + c3 u^3 on the unit interval; NumPy or Dr.Jit arrays."""
    rise = end - start
    return start, slope_start, 3 * rise - 2 * slope_start - slope_end, slope_start + slope_end - 2 * rise
