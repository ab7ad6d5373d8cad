"""Polynomials that kernels evaluate in place of library sines and logarithms, which must handle any argument."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np


def in_powers(values: Callable[[np.ndarray], np.ndarray], degree: int, domain: tuple[float, float]) -> list[float]:
    """Coefficients, lowest power first, of the polynomial that interpolates a function at the Chebyshev points of a domain."""
    fitted = np.polynomial.Chebyshev.interpolate(values, degree, domain=list(domain))
    return fitted.convert(kind=np.polynomial.Polynomial).coef.tolist()


def sine_and_cosine(sine_degree: int, cosine_degree: int) -> tuple[list[float], list[float]]:
    """Coefficients of sin(2 pi t)/t and cos(2 pi t) in powers of t^2, lowest first, for |t| <= 1/2."""
    domain = (0.0, 0.25)
    return in_powers(_sine_over, sine_degree, domain), in_powers(_cosine_of_root, cosine_degree, domain)


def _sine_over(square: np.ndarray) -> np.ndarray:
    """sin(2 pi t)/t as a function of t^2."""
    return np.asarray(2 * math.pi * np.sinc(2 * np.sqrt(square)))


def _cosine_of_root(square: np.ndarray) -> np.ndarray:
    """cos(2 pi t) as a function of t^2."""
    return np.asarray(np.cos(2 * math.pi * np.sqrt(square)))


def horner(coefficients: list[float], z: Any) -> Any:
    """Value of a polynomial of at least two coefficients, lowest first, by fused multiply-adds."""
    import drjit as dr

    total = dr.fma(z, coefficients[-1], coefficients[-2])
    for coefficient in coefficients[-3::-1]:
        total = dr.fma(total, z, coefficient)
    return total
