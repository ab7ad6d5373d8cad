"""Vectors of three components: products, unit vectors, and what the edges of triangles span."""

from __future__ import annotations

from typing import Any

import numpy as np


def dot(a: Any, b: Any) -> Any:
    """Scalar product of vectors whose components lie along the first axis: NumPy arrays, or tuples of Dr.Jit arrays."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Any, b: Any) -> tuple[Any, Any, Any]:
    """Components of the cross product of vectors whose components lie along the first axis, as in `dot`.

    `np.cross` takes several times as long.
    """
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length one along the last axis; zero stays zero.

    `np.linalg.norm` takes several times as long, and adds the squares in the same order.
    """
    if not np.issubdtype(vectors.dtype, np.inexact):
        vectors = vectors.astype(np.float64)  # squares of integers would wrap around
    squares = vectors[..., 0] * vectors[..., 0]
    for k in range(1, vectors.shape[-1]):
        squares = squares + vectors[..., k] * vectors[..., k]
    return np.asarray(vectors / np.maximum(np.sqrt(squares), 1e-12)[..., None])


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths of vectors along the last axis.

    `np.linalg.norm` takes several times as long.
    """
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def edge_cross(corners: np.ndarray) -> np.ndarray:
    """Cross product (..., 3) of two edges of triangles (..., 3, 3): along the normal, twice as long as the area is large."""
    a = corners[..., 0, :]
    one, two = corners[..., 1, :] - a, corners[..., 2, :] - a
    return np.stack(cross(np.moveaxis(one, -1, 0), np.moveaxis(two, -1, 0)), axis=-1)
