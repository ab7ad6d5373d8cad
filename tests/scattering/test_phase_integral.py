"""The facet integral against mpmath on the rounded inputs, relative to its envelope (the integral has true zeros)."""

from __future__ import annotations

from itertools import permutations, product

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from t2d_rt.core.backend import Backend
from t2d_rt.scattering.lanes import lane_ops
from t2d_rt.scattering.phase_integral import NUMPY_OPS, SERIES_TERMS, divided_difference, divided_differences

# Both sides of the switch from series to quotient (1 rad), multiples of 2 pi (the true zeros), and the whole range.
DIFFERENCES = [0, 1e-12, 1e-9, 1e-6, 1e-4, 1e-2, 0.3, 0.999999, 1.000001, 2, np.pi, 2 * np.pi, 30, 100, 8 * np.pi, 1e3]
BASES = [0.0, -2.3, 700.0]
LIMIT = {np.float32: 1e-5, np.float64: 1e-12}


def cases(dtype: type) -> np.ndarray:
    """Phases (case, 3): all pairs of differences of either sign from every base, (nearly) equal ones among them."""
    rows = [(b, b + x, b + sign * y) for b, x, y, sign in product(BASES, DIFFERENCES, DIFFERENCES, (1, -1))]
    near = [(b, b + x, b + x + y) for b, x, y in product(BASES, DIFFERENCES, DIFFERENCES)]
    return np.array(rows + near).astype(dtype)


def exact(phases: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F and dF (case,) of phases (case, 3), taken as exact numbers, by the plain formulas with 180 digits.

    Equal phases are set 1e-50 apart: an error of 1e-50, while the formula loses 100 digits. With P_i the product of the
    two differences j (p_i - p_k):  F = sum e^{j p_i}/P_i,  and from s F(s p) = sum e^{j s p_i}/(s P_i)
    dF = sum (j p_i - 1) e^{j p_i}/P_i.
    """
    values = np.empty((2, len(phases)), complex)
    with mpmath.workdps(180):
        for row, case in enumerate(phases.tolist()):
            p = [mpmath.mpf(x) + k * mpmath.mpf("1e-50") for k, x in enumerate(case)]
            terms = [mpmath.expj(p[i]) / -((p[i] - p[i - 1]) * (p[i] - p[i - 2])) for i in range(3)]
            values[0, row] = complex(sum(terms))
            values[1, row] = complex(sum((1j * x - 1) * term for x, term in zip(p, terms, strict=True)))
    return values[0], values[1]


def envelopes(phases: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of |F| and |dF| without the zeros: |exp[x, y]| <= min(1, 2/|x - y|), |F| <= half that."""
    low, mid, high = np.sort(phases.astype(float), axis=1).T
    first, last, width = (1 / np.maximum(1, (b - a) / 2) for a, b in ((low, mid), (mid, high), (low, high)))
    value = np.minimum(0.5, (first + last) / np.maximum(high - low, 1e-300))
    return value, np.maximum(first, np.maximum(last, width)) + (1 + np.abs(phases).max(axis=1)) * value


def errors(got: tuple[np.ndarray, np.ndarray], phases: np.ndarray) -> tuple[float, float]:
    """Worst error of F and dF relative to the envelope."""
    pairs = zip(got, exact(phases), envelopes(phases), strict=True)
    value, slope = (float(np.max(np.abs(g - e) / bound)) for g, e, bound in pairs)
    return value, slope


def both(phases: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    parts = divided_differences(*phases.T, ops=NUMPY_OPS, terms=SERIES_TERMS[phases.itemsize])
    return tuple(real + 1j * imag for real, imag in parts)  # type: ignore[return-value]


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_value_and_frequency_derivative_against_mpmath(dtype: type) -> None:
    phases = cases(dtype)
    got = both(phases)
    assert got[0].dtype == np.result_type(dtype, np.complex64)
    assert np.array_equal(divided_difference(*phases.T), got[0])
    assert max(errors(got, phases)) < LIMIT[dtype]


def test_drjit_kernel_against_mpmath(backend: Backend) -> None:
    import drjit

    phases = cases(np.float32)
    lanes = [backend.Float32(np.ascontiguousarray(column)) for column in phases.T]
    parts = divided_differences(*lanes, ops=lane_ops(drjit), terms=SERIES_TERMS[4])
    got = tuple(real.numpy() + 1j * imag.numpy() for real, imag in parts)
    assert max(errors(got, phases)) < LIMIT[np.float32]  # type: ignore[arg-type]


def test_closed_forms() -> None:
    assert divided_difference(*np.zeros((3, 1)))[0] == 0.5
    p = np.float64(1.7)
    assert divided_difference(p, p, p) == pytest.approx(np.exp(1j * p) / 2, rel=1e-15)
    # Two phases 2 pi apart and the third anywhere: exp[0, 2 pi] = 0, so F = exp[x, 2 pi]/(j x) alone.
    x = 2.5
    expected = (np.exp(1j * x) - 1) / (1j * (x - 2 * np.pi)) / (1j * x)
    assert divided_difference(np.float64(0), np.float64(2 * np.pi), np.float64(x)) == pytest.approx(expected, rel=1e-14)


phase = st.floats(-1e3, 1e3, width=32) | st.sampled_from([0.0, 1.0, -1.0, 1e-6])


@given(st.tuples(phase, phase, phase), st.sampled_from([np.float32, np.float64]))
@settings(max_examples=200, deadline=None)
def test_symmetric_in_its_arguments_to_the_last_bit(phases: tuple[float, float, float], dtype: type) -> None:
    values = np.array(list(permutations(phases)), dtype)
    value, slope = both(values)
    assert (value == value[0]).all()
    assert (slope == slope[0]).all()
    assert abs(value[0]) <= 0.5 * (1 + 1e-6)


@given(st.tuples(phase, phase, phase), st.floats(-10, 10))
@settings(max_examples=100, deadline=None)
def test_a_common_phase_rotates_the_value(phases: tuple[float, float, float], shift: float) -> None:
    p = np.array(phases)
    # Adding the shift rounds the phases by up to 1e-13 rad, which moves F by as much.
    rotated = divided_difference(*(p + shift)) * np.exp(-1j * shift)
    assert abs(rotated - divided_difference(*p)) < 1e-12
