"""Complex numbers on the device, as alternating real and imaginary parts, and their products with phasors."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from t2d_rt.radar.sweep import interpolation, nodes


def sin_cos(cycles: Any, *, within_half: bool = False) -> tuple[Any, Any]:
    """Sine and cosine of 2 pi `cycles`, each to 6e-7; twice as fast as those of the library, which have to reduce any angle.

    `within_half`: |cycles| <= 1/2 is known.
    """
    import drjit as dr

    rest = cycles if within_half else cycles - dr.round(cycles)
    square = rest * rest
    sine, cosine = _polynomials()
    return rest * _horner(sine, square), _horner(cosine, square)


@cache
def _polynomials() -> tuple[list[float], list[float]]:
    """sin(2 pi t)/t and cos(2 pi t) in powers of t^2, |t| <= 1/2, lowest first: through Chebyshev points."""

    def powers(values: Callable[[np.ndarray], np.ndarray], degree: int) -> list[float]:
        fitted = np.polynomial.Chebyshev.interpolate(lambda z: values(np.sqrt(z)), degree, domain=[0, 0.25])
        return fitted.convert(kind=np.polynomial.Polynomial).coef.tolist()

    return powers(lambda t: 2 * math.pi * np.sinc(2 * t), 5), powers(lambda t: np.cos(2 * math.pi * t), 6)


def _horner(coefficients: list[float], z: Any) -> Any:
    import drjit as dr

    total = dr.fma(z, coefficients[-1], coefficients[-2])
    for coefficient in coefficients[-3::-1]:
        total = dr.fma(total, z, coefficient)
    return total


def read(values: Any, sample: Any, count: int, packet: Any) -> list[Any]:
    """Real and imaginary parts at `count` nodes of a sample of a factor."""
    import drjit as dr

    base = sample * (count // 2)
    return [part for k in range(count // 2) for part in dr.gather(packet, values, base + k)]


def times_phasor(values: list[Any], sin: Any, cos: Any) -> list[Any]:
    """Complex numbers, as alternating real and imaginary parts, times exp(j phase)."""
    out = []
    for real, imag in zip(values[::2], values[1::2], strict=True):
        out += [real * cos - imag * sin, real * sin + imag * cos]
    return out


def spread_to(inner: int, outer: np.ndarray) -> Callable[[list[Any]], list[Any]]:
    """From values at `inner` Chebyshev nodes of the sweep to the polynomial through them at `outer` nodes, pairs +x, -x."""
    if np.array_equal(nodes(inner), outer):
        return lambda values: values
    # Nodes come in pairs +-x: even and odd parts apart halve the work.
    matrix = interpolation(inner, outer)[::2]
    even, odd = ((matrix[:, ::2] + sign * matrix[:, 1::2]) / 2 for sign in (1, -1))

    def spread(values: list[Any]) -> list[Any]:
        out = []
        pairs = [values[k : k + 4] for k in range(0, len(values), 4)]
        for row_even, row_odd in zip(even, odd, strict=True):
            sums = [
                sum(float(w) * (pair[part] + sign * pair[part + 2]) for w, pair in zip(row, pairs, strict=True))
                for part in (0, 1)
                for row, sign in ((row_even, 1), (row_odd, -1))
            ]
            out += [sums[0] + sums[1], sums[2] + sums[3], sums[0] - sums[1], sums[2] - sums[3]]
        return out

    return spread


def rotated(values: list[Any], theta: Any, x: list[float], *, bend: Any = None, small: bool = False) -> list[Any]:
    """Values at pairs of nodes +-x, times exp(j (theta x + bend (x^2 - 1/2))), bend to second order.

    `small`: |theta| <= pi is known.
    """
    out = []
    for k, place in enumerate(x):
        a, b, c, d = values[4 * k : 4 * k + 4]
        if bend is not None:
            e = bend * (place * place - 0.5)
            f = 1 - 0.5 * e * e
            a, b, c, d = f * a - e * b, f * b + e * a, f * c - e * d, f * d + e * c
        sin, cos = sin_cos(theta * (place / (2 * math.pi)), within_half=small)
        out += [a * cos - b * sin, a * sin + b * cos, c * cos + d * sin, d * cos - c * sin]
    return out
