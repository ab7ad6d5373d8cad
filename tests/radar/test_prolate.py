"""Nodes for functions of limited bandwidth: their error at places between, their number, nodes in pairs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from t2d_rt.radar.prolate import band_nodes, band_weights
from t2d_rt.radar.sweep import nodes_for


@pytest.mark.parametrize("tolerance", [3e-2, 3e-3, 1e-4, 3e-6])
@pytest.mark.parametrize("theta", [0.7, 2.2, 7.9, 13.8, 22.0, 47.0])
def test_phasors_within_the_band_are_carried(theta: float, tolerance: float) -> None:
    nodes, x = band_nodes(theta, tolerance), np.linspace(-1, 1, 333)
    matrix = band_weights(theta, tolerance, x).T
    t = np.random.default_rng(0).uniform(-theta, theta, 50)
    error = matrix @ np.exp(1j * np.outer(nodes, t)) - np.exp(1j * np.outer(x, t))
    assert np.abs(error).max() < 1.2 * tolerance  # they are checked on a grid
    # Noise at the nodes is hardly amplified, and least within the sweep: float32 numbers stay good.
    gain = np.linalg.norm(matrix, axis=1)
    assert gain.max() < 3
    assert np.sqrt(np.mean(gain**2)) < 1.2


def test_fewer_than_chebyshevs_and_no_fewer_than_the_band_holds() -> None:
    for theta in (13.8, 22.0, 47.0):
        count = len(band_nodes(theta, 3e-3))
        assert 2 * theta / math.pi < count < 0.8 * nodes_for(theta, 3e-3)


def test_nodes_come_in_pairs_within_the_sweep() -> None:
    nodes = band_nodes(13.8, 3e-3)
    np.testing.assert_array_equal(nodes[::2], -nodes[1::2])
    assert (np.diff(nodes[::2]) < 0).all()
    assert np.abs(nodes).max() < 1


def test_zeros_of_a_wave_function_without_bandwidth_are_legendres() -> None:
    # At theta = 0 the functions are Legendre polynomials (Xiao et al. 2001).
    np.testing.assert_allclose(np.sort(band_nodes(1e-6, 1e-9)), np.polynomial.legendre.leggauss(2)[0], atol=1e-4)
