"""Interpolation over the sweep (docs/physics.md, eq. 16) of functions of limited bandwidth: exp(j t x), |t| <= theta, x in -1..1.

A polynomial through Chebyshev nodes would need pi/2 times as many nodes. Here the nodes are the zeros of a prolate spheroidal wave
function, and the interpolating functions are those of lower order (Xiao, Rokhlin and Yarvin, Inverse Problems 17 (2001), 805-838).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import legvander

CHECKED = 128
"""Number of positions in the sweep, and of values of t, at which the error is checked."""
TRIES = 12
"""How many even numbers of nodes are tried, beginning with 2 theta/pi; fewer cannot represent the band."""


@lru_cache(maxsize=64)
def band_nodes(theta: float, tolerance: float) -> np.ndarray:
    """The fewest nodes that interpolate exp(j t x) for all |t| <= `theta` within `tolerance`; in pairs +x, -x, largest
    first."""
    t, x = np.linspace(0, theta, CHECKED), np.linspace(0, 1, CHECKED)
    least = 2 * max(1, math.ceil(theta / math.pi))
    series = _wave_functions(theta, least + 2 * TRIES)
    # Zeros are closer together near the ends, much as Chebyshev nodes; by symmetry only positive ones are searched.
    # A few grid points between neighbouring zeros suffice: zeros are interpolated linearly and need not be exact.
    grid = np.cos(np.linspace(0, math.pi / 2, 32 * series.shape[1]))
    on_grid, at_x = (legvander(places, series.shape[0] - 1) @ series for places in (grid, x))
    for count in range(least, least + 2 * TRIES, 2):
        nodes = _pairs(_zeros(grid, on_grid[:, count]))
        if len(nodes) != count:
            continue
        matrix = _through(nodes, series[:, :count], at_x[:, :count])
        if np.abs(matrix @ np.exp(1j * np.outer(nodes, t)) - np.exp(1j * np.outer(x, t))).max() <= tolerance:
            return nodes
    raise AssertionError(f"no {count} nodes carry {theta:g} rad within {tolerance:g}")


def band_weights(theta: float, tolerance: float, x: np.ndarray) -> np.ndarray:
    """Matrix (node, len(x)) from values at `band_nodes` to those of the interpolated function at `x`; cached, so not to be
    changed."""
    return _interpolation(theta, tolerance, x.tobytes())


@lru_cache(maxsize=16)
def _interpolation(theta: float, tolerance: float, places: bytes) -> np.ndarray:
    """The matrix of `band_weights`; `places` are the bytes of x, so that they can be a key of the cache."""
    x = np.frombuffer(places)
    nodes = band_nodes(theta, tolerance)
    series = _wave_functions(theta, len(nodes))[:, : len(nodes)]
    return np.ascontiguousarray(_through(nodes, series, legvander(x, len(series) - 1) @ series).T)


def _through(nodes: np.ndarray, series: np.ndarray, at_x: np.ndarray) -> np.ndarray:
    """Matrix from values at nodes to the combination of as many wave functions through them, at positions where these have the
    values `at_x` (x, node)."""
    return np.linalg.solve((legvander(nodes, len(series) - 1) @ series).T, at_x.T).T


def _zeros(grid: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Positions of the sign changes of values on a grid, by linear interpolation."""
    k = np.flatnonzero(values[1:] * values[:-1] < 0)
    return np.asarray(grid[k] + (grid[k + 1] - grid[k]) * values[k] / (values[k] - values[k + 1]))


def _pairs(positive: np.ndarray) -> np.ndarray:
    return np.stack([positive, -positive], axis=1).ravel()


@lru_cache(maxsize=64)
def _wave_functions(theta: float, order: int) -> np.ndarray:
    """Legendre series of the wave functions of orders 0 to `order`, (terms, order + 1), up to a scale: eigenvectors of the
    differential equation's matrix in Legendre polynomials."""
    k = np.arange(order + math.ceil(theta) + 40)
    diagonal = k * (k + 1) + (2 * k * (k + 1) - 1) / ((2 * k + 3) * (2 * k - 1)) * theta**2
    j = k[2:]
    beside = j * (j - 1) / ((2 * j - 1) * np.sqrt((2 * j - 3) * (2 * j + 1))) * theta**2
    _, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 2) + np.diag(beside, -2))
    return np.asarray(vectors[:, : order + 1] * np.sqrt(k + 0.5)[:, None])
