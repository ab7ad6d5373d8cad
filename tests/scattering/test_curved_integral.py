"""The integral over a curved facet: against mpmath on the rounded inputs, against quadrature of what it expands, invariants."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import permutations, product
from math import factorial
from typing import Any, get_args

import mpmath
import numpy as np
import pytest

from builders import slow_after
from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import InputError
from t2d_rt.scattering import curved_integral as module
from t2d_rt.scattering.curved_integral import CENTRE, Order, curved_integral, curved_integrals
from t2d_rt.scattering.lanes import lane_ops
from t2d_rt.scattering.phase_integral import NUMPY_OPS, SERIES_TERMS, divided_difference, divided_differences

ORDERS = get_args(Order)
LIMIT = {np.float32: 1e-5, np.float64: 1e-11}
LARGEST_RAD = {np.float32: 1e2, np.float64: 1e4}

# Both sides of the switches of first and second order (2 and 3 rad), (nearly) equal phases, and the whole range.
DIFFERENCES = [0, 1e-12, 1e-6, 1e-2, 0.7, 1.999, 2.001, 2.999, 3.001, 2 * np.pi, 30, 1e3]

Polynomial = dict[tuple[int, int, int], Any]
"""Coefficients by the powers of l0, l1, l2."""


def cases(dtype: type, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Phases, amplitudes and bubbles (3, case): all pairs of differences of either sign, in every order of the corners."""
    rng = np.random.default_rng(seed)
    rows = [(0, x, sign * y) for x, y, sign in product(DIFFERENCES, DIFFERENCES, (1, -1))]
    near = [(0, x, x + y) for x, y in product(DIFFERENCES[1:4], DIFFERENCES)]
    phases = rng.permuted(np.array(rows + near), axis=1).T
    phases = phases + LARGEST_RAD[dtype] * rng.choice([0, 0, 1, -1], phases.shape[1])
    amplitudes = rng.uniform(0, 1, phases.shape) * rng.choice([0, 1, 1, 1], phases.shape)
    amplitudes[0] += ~amplitudes.any(axis=0)
    bubbles = rng.choice([-2, 2, 1, 0], phases.shape) * rng.choice([1, 1, 1e-3], phases.shape[1])
    return phases.astype(dtype), amplitudes.astype(dtype), bubbles.astype(dtype)


def multiplied(first: Polynomial, second: Polynomial) -> Polynomial:
    found: Polynomial = {}
    for (a, x), (b, y) in product(first.items(), second.items()):
        powers = a[0] + b[0], a[1] + b[1], a[2] + b[2]
        found[powers] = found.get(powers, 0) + x * y
    return found


def added(*terms: tuple[Any, Polynomial]) -> Polynomial:
    """Sum of factors times polynomials."""
    found: Polynomial = {}
    for factor, term in terms:
        for powers, x in term.items():
            found[powers] = found.get(powers, 0) + factor * x
    return found


def integrator(phases: list[Any]) -> Callable[[Polynomial], Any]:
    """Integral over the unit simplex of a polynomial times exp(j p), by Hermite and Genocchi:
    that of l^n exp(j p) is n0! n1! n2! exp[j p0 repeated n0 + 1 times, ...]."""
    known: dict[tuple[int, ...], Any] = {}

    def divided(counts: tuple[int, ...]) -> Any:
        if counts not in known:
            there = [i for i in range(3) if counts[i]]
            i, k = max(product(there, there), key=lambda pair: abs(phases[pair[0]] - phases[pair[1]]))
            if phases[i] == phases[k]:
                known[counts] = mpmath.expj(phases[i]) / factorial(sum(counts) - 1)
            else:
                less = [tuple(c - (corner == n) for corner, c in enumerate(counts)) for n in (i, k)]
                known[counts] = (divided(less[1]) - divided(less[0])) / (1j * (phases[i] - phases[k]))
        return known[counts]

    def integral(polynomial: Polynomial) -> Any:
        weights = ((x * mpmath.fprod(map(factorial, powers)), powers) for powers, x in polynomial.items())
        return mpmath.fsum(weight * divided(tuple(n + 1 for n in powers)) for weight, powers in weights)

    return integral


def expansion(p: list[Any], a: list[Any], q: list[Any], order: int) -> Any:
    """I as it is defined, of mpmath numbers."""
    one, corners = {(0, 0, 0): mpmath.mpf(1)}, [{(1, 0, 0): 1}, {(0, 1, 0): 1}, {(0, 0, 1): 1}]
    centre = sum(q) * mpmath.mpf(CENTRE)
    edges = [multiplied(corners[i], corners[(i + 1) % 3]) for i in range(3)]
    x = added(*zip(q, edges, strict=True), (-centre, one))
    square = multiplied(x, x)
    if order == 1:
        square = added((2 * integrator([mpmath.mpf(0)] * 3)(square), one))
    taylor = added((1, one), (1j, x), (-mpmath.mpf(1) / 2, square))
    return mpmath.expj(centre) * integrator(p)(multiplied(added(*zip(a, corners, strict=True)), taylor))


def exact(phases: np.ndarray, amplitudes: np.ndarray, bubbles: np.ndarray, order: int) -> np.ndarray:
    with mpmath.workdps(120):
        numbers = [[list(map(mpmath.mpf, column)) for column in x.T.tolist()] for x in (phases, amplitudes, bubbles)]
        return np.array([complex(expansion(*one, order)) for one in zip(*numbers, strict=True)])


def both(given: tuple[np.ndarray, ...], order: Order) -> tuple[np.ndarray, np.ndarray]:
    parts = curved_integrals(*given, ops=NUMPY_OPS, terms=SERIES_TERMS[given[0].itemsize], order=order)
    return tuple(real + 1j * imag for real, imag in parts)  # type: ignore[return-value]


def envelope(phases: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """What I may reach: the integral of a, over the widest phase difference where that exceeds 1 rad."""
    return amplitudes.sum(axis=0) / 6 / np.maximum(1, np.ptp(phases.astype(float), axis=0))


@pytest.mark.parametrize("order", slow_after(1, ORDERS[::-1]))
@pytest.mark.parametrize("dtype", slow_after(1, [np.float32, np.float64]))
def test_value_against_mpmath(dtype: type, order: Order, backend: Backend) -> None:
    import drjit

    given = cases(dtype)
    expected, bound = exact(*given, order), envelope(*given[:2])
    got = curved_integral(*given, order=order)
    assert got.dtype == np.result_type(dtype, np.complex64)
    assert np.max(abs(got - expected) / bound) < LIMIT[dtype]
    if dtype is np.float32:
        lanes = [[backend.Float32(np.ascontiguousarray(row)) for row in x] for x in given]
        parts = curved_integrals(*lanes, ops=lane_ops(drjit), terms=SERIES_TERMS[4], order=order)
        (value, slope) = (real.numpy() + 1j * imag.numpy() for real, imag in parts)
        assert np.max(abs(value - expected) / bound) < LIMIT[dtype]
        assert np.max(abs(slope - both(given, order)[1]) / slope_envelope(*given[:2])) < LIMIT[dtype]


def slope_envelope(phases: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    return (1 + abs(phases).max(axis=0)) * envelope(phases, amplitudes) + amplitudes.sum(axis=0) / 6


@pytest.mark.slow
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_slope_against_a_finite_difference(dtype: type, order: Order) -> None:
    given = tuple(x[:, ::3] for x in cases(dtype, seed=1))
    step = mpmath.mpf("1e-25")
    slopes = []
    with mpmath.workdps(140):
        for columns in zip(*(x.T.tolist() for x in given), strict=True):
            p, a, q = (list(map(mpmath.mpf, column)) for column in columns)
            up, down = (s * expansion([s * x for x in p], a, [s * x for x in q], order) for s in (1 + step, 1 - step))
            slopes.append(complex((up - down) / (2 * step)))
    error = abs(both(given, order)[1] - np.array(slopes))
    assert np.max(error / slope_envelope(*given[:2])) < LIMIT[dtype]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_without_bubbles_it_is_the_flat_facet(dtype: type, order: Order) -> None:
    phases = cases(dtype)[0]
    value, slope = both((phases, np.ones_like(phases), np.zeros_like(phases)), order)
    flat = divided_differences(*phases, ops=NUMPY_OPS, terms=SERIES_TERMS[phases.itemsize])
    ones = np.ones_like(phases)
    assert np.max(abs(value - divided_difference(*phases)) / envelope(phases, ones)) < LIMIT[dtype]
    assert np.max(abs(slope - (flat[1][0] + 1j * flat[1][1])) / slope_envelope(phases, ones)) < LIMIT[dtype]


@pytest.mark.parametrize("order", ORDERS)
def test_symmetric_in_its_corners(order: Order) -> None:
    given = cases(np.float64)
    expected = both(given, order)
    bounds = envelope(*given[:2]), slope_envelope(*given[:2])
    edges = {frozenset((i, (i + 1) % 3)): given[2][i] for i in range(3)}
    for corners in permutations(range(3)):
        bubbles = np.array([edges[frozenset((corners[i], corners[(i + 1) % 3]))] for i in range(3)])
        got = both((given[0][list(corners)], given[1][list(corners)], bubbles), order)
        for value, same, bound in zip(got, expected, bounds, strict=True):
            assert np.max(abs(value - same) / bound) < 1e-12  # rounding of float64, some tens of operations


def test_equal_phases() -> None:
    # Integrals of l_i and of l_i l_j over the unit simplex: 1/6 and 1/24; a common phase p is a factor exp(jp).
    p, a, q = np.full(3, 1.3), np.array([0.2, 0.5, 0.8]), np.array([1e-5, 3e-5, -2e-5])
    expected = np.exp(1.3j) * (0.25 + 1j * sum(q[i] * (a.sum() + a[i] + a[(i + 1) % 3]) for i in range(3)) / 120)
    for order in ORDERS:
        assert abs(curved_integral(p, a, q, order) - expected) < 1e-9  # squares of the bubbles
    assert curved_integral(np.zeros(3), np.ones(3), np.zeros(3)) == pytest.approx(0.5, rel=1e-15)
    assert curved_integral(np.zeros(3), np.zeros(3), np.ones(3)) == 0


def true_integral(p: np.ndarray, a: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Integral of a exp(j (p + b)) (case,), arguments (3, case), by 40 x 40 Gauss-Legendre points."""
    x, w = np.polynomial.legendre.leggauss(40)
    u, v = np.meshgrid((1 + x) / 2, (1 + x) / 2, indexing="ij")
    weights = (np.outer(w, w) * u / 4).ravel()
    return (a.T @ corners_at(u, v) * np.exp(1j * (p.T @ corners_at(u, v) + bubble(q, u, v)))) @ weights


def corners_at(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (3, points)."""
    return np.stack([1 - u, u * (1 - v), u * v]).reshape(3, -1)


def bubble(q: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """b (case, points)."""
    corners = corners_at(u, v)
    return q.T @ (corners * np.roll(corners, -1, axis=0))


def errors_by_bubble(greatest: float, count: int = 2000) -> list[float]:
    """Root mean square of the error over the envelope, of no, first and second order."""
    rng = np.random.default_rng(0)
    p, a, q = rng.normal(0, 3, (3, count)), rng.uniform(0, 1, (3, count)), rng.uniform(0, 1, (3, count))
    q *= greatest / abs(bubble(q, *np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41)))).max(axis=1)
    true = true_integral(p, a, q)
    found = [curved_integral(p, a, np.zeros_like(q)) * np.exp(1j * CENTRE * q.sum(axis=0))]
    found += [curved_integral(p, a, q, order) for order in ORDERS]
    return [float(np.sqrt(np.mean((abs(x - true) / envelope(p, a)) ** 2))) for x in found]


@pytest.mark.slow
def test_error_grows_with_the_bubble_as_documented() -> None:
    rows = re.findall(
        r"^    (?:constant only|first order|second order) +([\d. e-]+)$", module.__doc__ or "", re.MULTILINE
    )
    documented = np.array([list(map(float, row.split())) for row in rows])
    measured = np.array([errors_by_bubble(greatest) for greatest in (0.25, 0.5, 1, 2)]).T
    assert documented.shape == (3, 4)
    assert np.allclose(measured, documented, rtol=0.03)  # two digits are given


def test_arguments_are_checked() -> None:
    three = np.zeros((3, 2))
    with pytest.raises(InputError, match=r"order must be an integer in 1..2, got 3"):
        curved_integral(three, three, three, 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"phases must have shape \(3,\), got \(2,\)"):
        curved_integral(np.zeros(2), three, three)
    with pytest.raises(InputError, match=r"bubbles must have shape \(3, 2\), got \(3, 1\)"):
        curved_integral(three, three, three[:, :1])
