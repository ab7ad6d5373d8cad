"""Reflection and transmission of slabs, ITU-R P.2040 (docs/physics.md, eq. 23)."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.types import Material


def slab(
    material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Field coefficients R_TE, R_TM, T_TE, T_TM at angles of incidence given by their cosine, complex (...).

    Source: ITU-R P.2040-3, eq. (37), (43) and (44); e^{+j omega t}. A perfect conductor has -1, +1, 0, 0.
    """
    cosine = np.asarray(cosine, float)
    if math.isinf(material.relative_permittivity):
        one, none = np.ones(cosine.shape, complex), np.zeros(cosine.shape, complex)
        return -one, one, none, none
    eta = material.permittivity(frequency_hz)
    root = np.sqrt(eta - (1 - cosine**2))
    # e^{-jq}: an evanescent or lossy wave decays.
    once = np.exp(-2j * math.pi * frequency_hz / SPEED_OF_LIGHT * thickness_m * root)
    found = []
    for single in ((cosine - root) / (cosine + root), (eta * cosine - root) / (eta * cosine + root)):
        below = 1 - single**2 * once**2
        found.append((single * (1 - once**2) / below, (1 - single**2) * once / below))
    (r_te, t_te), (r_tm, t_tm) = found
    return r_te, r_tm, t_te, t_tm
