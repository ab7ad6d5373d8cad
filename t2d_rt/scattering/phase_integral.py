"""The integral of a linear phase over a triangle, as a second divided difference of exp (docs/physics.md, eq. 4).

    F(p0, p1, p2) = exp[j p0, j p1, j p2],   integral of exp(j p) over the triangle = 2 A F

The plain formula divides by phase differences. Here the differences are taken between sorted phases, the quotient is used where
the widest one exceeds 1 rad, and a series in complete homogeneous symmetric polynomials where it does not; exponentials are
always of the phases as given, so that large phases lose nothing.

The functions are written once for NumPy (any float dtype) and Dr.Jit arrays; real and imaginary parts are kept apart.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np


class Ops(Protocol):
    """The few operations in which NumPy and Dr.Jit differ."""

    minimum: Any
    maximum: Any
    where: Any
    sincos: Any
    fma: Any


def product_sum(a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded twice."""
    return a * b + c


NUMPY_OPS: Ops = SimpleNamespace(
    minimum=np.minimum,
    maximum=np.maximum,
    where=np.where,
    sincos=lambda x: (np.sin(x), np.cos(x)),
    fma=product_sum,
)

# Terms after which the series' remainder is below the rounding of the dtype for differences up to 1 rad: the next
# term is (n+1)/(n+2)! of the leading 1/2.
SERIES_TERMS = {4: 10, 8: 18}

Parts = tuple[Any, Any]


def divided_difference(p0: np.ndarray, p1: np.ndarray, p2: np.ndarray) -> np.ndarray:
    """exp[j p0, j p1, j p2] for phases [rad] of equal shapes; the result is complex, of the phases' precision.

    float32 phases give a float32 computation. The function is symmetric in its arguments, and 1/2 where all phases are 0.
    """
    dtype = np.result_type(p0, p1, p2, np.float32)
    phases = (np.asarray(p, dtype) for p in (p0, p1, p2))
    (real, imag), _ = divided_differences(*phases, ops=NUMPY_OPS, terms=SERIES_TERMS[dtype.itemsize])
    return real + 1j * imag


def divided_differences(p0: Any, p1: Any, p2: Any, *, ops: Ops, terms: int) -> tuple[Parts, Parts]:
    """F and dF: (re, im) of exp[j p0, j p1, j p2] and of its derivative d/ds of s F(s p0, s p1, s p2) at s = 1.

    The derivative is what a facet's field changes with relative frequency s = f/f_mid, the factor s being the 1/lambda of
    physical optics: d(sF)/ds = z F + exp[the two others] - F with z = j times any one of the phases, because
    (z e^z)[z0, z1, z2] = z0 exp[z0, z1, z2] + exp[z1, z2] (Leibniz' rule for divided differences).
    """
    low = ops.minimum(ops.minimum(p0, p1), p2)
    high = ops.maximum(ops.maximum(p0, p1), p2)
    mid = ops.maximum(ops.minimum(p0, p1), ops.minimum(ops.maximum(p0, p1), p2))
    exp_low, exp_mid, exp_high = (exponential(p, ops) for p in (low, mid, high))
    below = low - mid
    above = high - mid
    width = high - low
    first = _slope(exp_mid, exp_low, below, ops, terms)  # exp[low, mid]
    last = _slope(exp_mid, exp_high, above, ops, terms)  # exp[mid, high]
    inverse = 1 / ops.where(width > 1, width, width * 0 + 1)
    quotient = (last[1] - first[1]) * inverse, (first[0] - last[0]) * inverse  # divided by j width
    series = times(exp_mid, _series(below, above, terms))
    real = ops.where(width > 1, quotient[0], series[0])
    imag = ops.where(width > 1, quotient[1], series[1])
    return (real, imag), (last[0] - real - low * imag, last[1] - imag + low * real)


def exponential(p: Any, ops: Ops) -> Parts:
    """exp(j p), real and imaginary part."""
    sin, cos = ops.sincos(p)
    return cos, sin


def times(a: Parts, b: Parts) -> Parts:
    """The complex product of a and b."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _slope(exp_mid: Parts, exp_end: Parts, d: Any, ops: Ops, terms: int) -> Parts:
    """First divided difference (exp_end - exp_mid)/(j d), d the phase of the end minus that of the middle."""
    small = abs(d) < 1
    inverse = 1 / ops.where(small, d * 0 + 1, d)
    quotient = (exp_end[1] - exp_mid[1]) * inverse, (exp_mid[0] - exp_end[0]) * inverse
    series = times(exp_mid, power_integral(d, 0, terms))
    return ops.where(small, series[0], quotient[0]), ops.where(small, series[1], quotient[1])


def power_integral(d: Any, power: int, terms: int, fma: Any = product_sum) -> Parts:
    """Integral of (1-u)^n exp(j d u) over u in 0..1, n the power, as n! sum_m (jd)^m/(m+n+1)!; (exp(jd) - 1)/(jd) for n = 0."""
    minus_square = -(d * d)
    real, imag = 0 * d, 0 * d
    for m in range(terms - terms % 2, -1, -2):  # even powers of jd are real, odd ones imaginary
        real = fma(real, minus_square, _factorial(power) / _factorial(m + power + 1))
        imag = fma(imag, minus_square, _factorial(power) / _factorial(m + power + 2))
    return real, d * imag


def _series(a: Any, b: Any, terms: int) -> Parts:
    """exp[ja, 0, jb] = sum j^n h_n(a, b)/(n+2)!, h_n the complete homogeneous symmetric polynomials:
    h_0 = 1, h_1 = a + b, h_n = (a + b) h_{n-1} - a b h_{n-2}."""
    total, product = a + b, a * b
    before, now = 0 * a, 0 * a + 1
    real, imag = 0 * a, 0 * a
    for n in range(terms):
        weight = (-1) ** (n // 2) / _factorial(n + 2)
        if n % 2 == 0:
            real = real + now * weight
        else:
            imag = imag + now * weight
        before, now = now, total * now - product * before
    return real, imag


@cache
def _factorial(n: int) -> float:
    return 1.0 if n < 2 else n * _factorial(n - 1)
