"""Whether a point lies inside a mesh."""

from __future__ import annotations

import numpy as np


def winding(corners: np.ndarray) -> np.ndarray:
    """Winding numbers (...) of triangles (..., F, 3, 3) about the origin: 1 inside a closed mesh, 0 outside.

    Source: the triangles' solid angles, Van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125.
    """
    a, b, c = np.moveaxis(corners, -2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    triple = np.sum(a * np.cross(b, c), axis=-1)
    rest = la * lb * lc + np.sum(a * b, -1) * lc + np.sum(b * c, -1) * la + np.sum(c * a, -1) * lb
    return np.asarray(2 * np.arctan2(triple, rest).sum(axis=-1) / (4 * np.pi))
