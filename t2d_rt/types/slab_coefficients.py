"""Reflection and transmission of slabs, ITU-R P.2040 (docs/physics.md, eq. 23).

Coefficients of the field for TE and TM waves at angles of incidence given by their cosine (...), complex (...).
Source: ITU-R P.2040-3, eq. (37), (43) and (44); e^{+j omega t}. A perfect conductor has R_TE = -1, R_TM = +1 and transmits nothing.
"""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.types import Material

Polarized = tuple[np.ndarray, np.ndarray]
"""A coefficient of TE and of TM waves."""


def reflection(material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float) -> Polarized:
    """R_TE and R_TM."""
    if math.isinf(material.relative_permittivity):
        one = np.ones(np.shape(cosine), complex)
        return -one, one
    (te, tm), once = _waves(material, thickness_m, cosine, frequency_hz)
    twice = once**2
    rest = 1 - twice
    return te * rest / (1 - te**2 * twice), tm * rest / (1 - tm**2 * twice)


def transmission(material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float) -> Polarized:
    """T_TE and T_TM, from face to face."""
    if math.isinf(material.relative_permittivity):
        return np.zeros(np.shape(cosine), complex), np.zeros(np.shape(cosine), complex)
    singles, once = _waves(material, thickness_m, cosine, frequency_hz)
    squares, twice = [single**2 for single in singles], once**2
    te, tm = ((1 - square) * once / (1 - square * twice) for square in squares)
    return te, tm


def _waves(
    material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float
) -> tuple[Polarized, np.ndarray]:
    """Reflection at one face alone, TE and TM, and the factor of the field from face to face."""
    cosine = np.asarray(cosine, float)
    eta = material.permittivity(frequency_hz)
    root = np.sqrt(eta - (1 - cosine**2))
    # e^{-jq}: an evanescent or lossy wave decays.
    once = np.exp(-2j * math.pi * frequency_hz / SPEED_OF_LIGHT * thickness_m * root)
    return ((cosine - root) / (cosine + root), (eta * cosine - root) / (eta * cosine + root)), once
