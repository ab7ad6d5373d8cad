"""Rotation matrices (..., 3, 3) for posing, computed for whole arrays at once."""

from __future__ import annotations

import numpy as np

from t2d_rt.geometry.vectors import unit, vector_product


def matrices(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices of unit quaternions x, y, z, w (..., 4)."""
    x, y, z, w = np.moveaxis(quaternions, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    rotation = np.empty((*x.shape, 3, 3), x.dtype)
    for i, row in enumerate(rows):
        for k, entry in enumerate(row):
            rotation[..., i, k] = entry
    return rotation


def frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Orthonormal frames (..., 3, 3), whose first column is along `first` and whose second is along the part of `second` that is
    perpendicular to it; both (..., 3)."""
    a = unit(first)
    b = unit(second - (second * a).sum(-1, keepdims=True) * a)
    return np.stack([a, b, vector_product(a, b)], -1)


def swing(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The smallest rotation that rotates direction `source` to `target`, both (..., 3)."""
    a, b = np.broadcast_arrays(unit(source), unit(target))
    axis, cosine = vector_product(a, b), (a * b).sum(-1)
    skew = np.zeros((*cosine.shape, 3, 3))
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = -axis[..., 2], axis[..., 1], -axis[..., 0]
    skew -= np.swapaxes(skew, -1, -2)
    # Between opposite directions it is not unique; a bone never rotates by 180 degrees from its calibrated direction.
    return np.eye(3) + skew + skew @ skew / np.maximum(1 + cosine, 1e-6)[..., None, None]


def between(first: np.ndarray, second: np.ndarray, fraction: float) -> np.ndarray:
    """Rotations at a fraction of the smallest rotation from `first` to `second`."""
    w = quaternion(np.swapaxes(first, -1, -2) @ second)
    sine = np.linalg.norm(w[..., :3], axis=-1)
    half = np.arctan2(sine, w[..., 3]) * fraction
    scale = np.where(sine > 1e-9, np.sin(half) / np.maximum(sine, 1e-9), fraction)
    return first @ matrices(np.concatenate([w[..., :3] * scale[..., None], np.cos(half)[..., None]], -1))


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions x, y, z, w >= 0 of rotation matrices, from the dominant column of 4 q q^T, exact at any angle."""
    m = rotation
    trace = np.trace(m, axis1=-2, axis2=-1)
    outer = np.empty((*m.shape[:-2], 4, 4))
    outer[..., :3, :3] = m + np.swapaxes(m, -1, -2)
    outer[..., [0, 1, 2], [0, 1, 2]] = 1 - trace[..., None] + 2 * np.diagonal(m, axis1=-2, axis2=-1)
    vector = np.stack([m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]], -1)
    outer[..., :3, 3] = outer[..., 3, :3] = vector
    outer[..., 3, 3] = 1 + trace
    best = np.diagonal(outer, axis1=-2, axis2=-1).argmax(-1)
    column = np.take_along_axis(outer, best[..., None, None], -1)[..., 0]
    return unit(column) * np.where(column[..., 3:] < 0, -1.0, 1.0)


def mean_rotation(rotations: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted mean (3, 3) of rotations (T, 3, 3): the nearest rotation to the mean matrix (Moakher 2002)."""
    u, _, vt = np.linalg.svd(np.einsum("t,tij->ij", weights, rotations))
    return u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
