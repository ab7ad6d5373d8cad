"""Unit quaternions (x, y, z, w) on the last axis; leading axes broadcast. They need NumPy alone, so that reading needs no scipy."""

from __future__ import annotations

import numpy as np

from t2d_rt.geometry.vectors import inner, norms, vector_product


def multiply(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Product (..., 4) of two quaternions: the rotation `second`, then `first` (as with matrices)."""
    u, a = first[..., :3], first[..., 3:]
    v, b = second[..., :3], second[..., 3:]
    out = np.empty(np.broadcast_shapes(first.shape, second.shape))
    vector = out[..., :3]
    np.multiply(a, v, out=vector)
    vector += b * u
    vector += vector_product(u, v)
    out[..., 3] = a[..., 0] * b[..., 0] - inner(u, v)
    return out


def conjugate(quaternion: np.ndarray) -> np.ndarray:
    """Inverse of a unit quaternion."""
    return quaternion * np.array([-1.0, -1.0, -1.0, 1.0])


def rotate(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    u, w = quaternion[..., :3], quaternion[..., 3:]
    twice = 2.0 * vector_product(u, vector)
    return vector + w * twice + vector_product(u, twice)


def about_axis(axis: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of rotations by angles (...) about a unit axis (3,)."""
    half = 0.5 * np.asarray(angle_rad, dtype=float)[..., None]
    return np.concatenate([np.sin(half) * axis, np.cos(half)], axis=-1)


def normalise(quaternion: np.ndarray) -> np.ndarray:
    """Quaternions or vectors scaled to unit length along the last axis."""
    return quaternion / norms(quaternion)[..., None]


def continuous(quaternion: np.ndarray) -> np.ndarray:
    """The same rotations with signs chosen so that neighbours in time (axis 0) are less than half a turn apart."""
    steps = np.where(inner(quaternion[1:], quaternion[:-1]) < 0, -1.0, 1.0)[..., None]
    signs = np.concatenate([np.ones_like(quaternion[:1, ..., :1]), np.cumprod(steps, axis=0)])
    return quaternion * signs


def blend(first: np.ndarray, second: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Normalised mean of two rotations along the shorter arc; `weight` (..., 1) is that of the second."""
    near = np.where(np.sum(first * second, axis=-1, keepdims=True) < 0, -second, second)
    return normalise((1.0 - weight) * first + weight * near)


def between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Smallest rotation that turns the direction `start` (..., 3) into `end` (..., 3)."""
    start, end = normalise(start), normalise(end)
    cosine, axis = inner(start, end)[..., None], vector_product(start, end)
    opposite = ~(cosine > -1.0 + 1e-12)
    if opposite.any():  # opposite directions leave the axis open: any one perpendicular to them will do
        aside = vector_product(start, np.where(np.abs(start[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        axis = np.where(opposite, aside, axis)
    return normalise(np.concatenate([axis, np.maximum(1.0 + cosine, 0.0)], axis=-1))


def from_matrix(matrix: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of rotation matrices (..., 3, 3): the row of largest norm of the symmetric 4 x 4 form (Shepperd)."""
    m = matrix
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    forms = np.empty((*m.shape[:-2], 4, 4))
    forms[..., 0, 0], forms[..., 1, 1] = 1 + xx - yy - zz, 1 - xx + yy - zz
    forms[..., 2, 2], forms[..., 3, 3] = 1 - xx - yy + zz, 1 + xx + yy + zz
    for row, column, value in ((0, 1, xy), (0, 2, xz), (0, 3, wx), (1, 2, yz), (1, 3, wy), (2, 3, wz)):
        forms[..., row, column] = forms[..., column, row] = value
    best = np.argmax(norms(forms), axis=-1)
    return normalise(np.take_along_axis(forms, best[..., None, None], axis=-2)[..., 0, :])


def calibrated(recorded: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Recorded orientations (T, 4) of a joint, turned by the constant rotation that brings them nearest to the expected ones."""
    offset = multiply(conjugate(recorded), expected)
    values, vectors = np.linalg.eigh(np.einsum("ti,tj->ij", offset, offset))
    return multiply(recorded, vectors[:, int(values.argmax())])
