"""A fixed random point set on a surface that does not depend on how the surface is cut into triangles.

For each axis a, space has a grid of square cells of side h across a, and each cell one line along a at a place drawn
from (seed, axis, i, j). The points are where the lines meet the surface: |n_a| / h^2 of them per unit of area, so a
point stands for A = h^2 / (|nx| + |ny| + |nz|), and the sum of A is the surface's area in the mean. Another
tessellation of the same surface meets the same lines: it gives the same points, weights and phases as far as the two
surfaces agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.geometry.subdivide import face_normals

MAX_CANDIDATES = 50_000_000
"""Greatest number of line-triangle tests per axis; they take about 5 GB of work arrays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfacePoints:
    """Q points fixed to a surface, ordered by line (axis, i, j) and along each line."""

    face: np.ndarray
    """Face that each point lies in, int32 (Q,)."""
    barycentric: np.ndarray
    """Weights of that face's corners, float64 (Q, 3)."""
    area_m2: np.ndarray
    """Area that each point stands for [m^2], (Q,)."""
    phase_rad: np.ndarray
    """Phase [rad] of each point, a hash of (seed, axis, i, j, position along the line), uniform in 0..2 pi, (Q,)."""


def point_spacing(area_m2: float, count: int) -> float:
    """Cell side h [m] for about `count` points: the power of two nearest to sqrt(1.5 area/count).

    1.5 is the mean of |nx| + |ny| + |nz| over all directions. A power of two, so that tessellations of slightly
    different area agree on it; the number of points lies within a factor 2 of `count`.
    """
    if not (0 < area_m2 < np.inf and count > 0):
        raise InputError(f"area_m2 and count must be positive, got {area_m2} and {count}")
    return float(2.0 ** np.round(np.log2(1.5 * area_m2 / count) / 2))


def surface_points(rest: np.ndarray, faces: np.ndarray, *, seed: int, spacing_m: float) -> SurfacePoints:
    """Points on a mesh (V, 3), (F, 3) at rest, in cells of side `spacing_m`."""
    rest, faces = np.asarray(rest, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    hits = [_hits(rest, faces, axis, seed, spacing_m) for axis in range(3)]
    face, barycentric, phase = (np.concatenate(columns) for columns in zip(*hits, strict=True))
    normal = face_normals(rest, faces)[face]
    return SurfacePoints(
        face=face.astype(np.int32),
        barycentric=barycentric,
        area_m2=spacing_m**2 / np.abs(normal).sum(axis=1),
        phase_rad=phase,
    )


def hash_uniform(seed: int, *keys: np.ndarray | int) -> np.ndarray:
    """Numbers in [0, 1) that depend on seed and keys alone: splitmix64 (Steele, Lea, Flood 2014) chained over the keys."""
    state = _splitmix64(np.asarray(seed % 2**64, dtype=np.uint64))
    for key in keys:
        state = _splitmix64(state ^ np.asarray(key, dtype=np.int64).astype(np.uint64))
    return (state >> np.uint64(11)).astype(np.float64) * 2.0**-53


def _splitmix64(state: np.ndarray) -> np.ndarray:
    """One step of splitmix64; its output looks random however regular the states are."""
    with np.errstate(over="ignore"):  # overflow is intended: arithmetic modulo 2^64
        z = state + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))


def _hits(
    rest: np.ndarray, faces: np.ndarray, axis: int, seed: int, spacing_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces (Q,), barycentric weights (Q, 3) and phases (Q,) where the lines along one axis meet the mesh."""
    across = rest[:, [(axis + 1) % 3, (axis + 2) % 3]]
    corners = across[faces]
    face, i, j = _candidates(corners, spacing_m, axis)
    x = (i + hash_uniform(seed, axis, i, j, 0)) * spacing_m
    y = (j + hash_uniform(seed, axis, i, j, 1)) * spacing_m
    sides = np.stack([_side(corners[face, k], corners[face, (k + 1) % 3], x, y) for k in range(3)], axis=1)
    left = np.signbit(sides)
    solid = np.abs(sides).sum(axis=1) > 0
    hit = np.flatnonzero(solid & (left[:, 0] == left[:, 1]) & (left[:, 1] == left[:, 2]))
    face, i, j = face[hit], i[hit], j[hit]
    # the side opposite a corner measures that corner's barycentric weight
    barycentric = np.abs(sides[hit][:, [1, 2, 0]])
    barycentric /= barycentric.sum(axis=1, keepdims=True)
    along = (barycentric * rest[faces[face], axis]).sum(axis=1)
    order = np.lexsort((along, j, i))
    face, barycentric, i, j = face[order], barycentric[order], i[order], j[order]
    new = np.ones(len(face), bool)
    new[1:] = (np.diff(i) != 0) | (np.diff(j) != 0)
    start = np.flatnonzero(new)
    place = np.arange(len(face)) - np.repeat(start, np.diff(np.append(start, len(face))))
    return face, barycentric, 2 * np.pi * hash_uniform(seed, axis, i, j, 2 + place)


def _candidates(corners: np.ndarray, spacing_m: float, axis: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every cell (i, j) that the bounding box of a projected face (F, 3, 2) touches, and the index of that face, (C,) each."""
    low = np.floor(corners.min(axis=1) / spacing_m)
    size = np.floor(corners.max(axis=1) / spacing_m) - low + 1
    count = size[:, 0] * size[:, 1]
    if count.sum() > MAX_CANDIDATES:
        raise InputError(
            f"spacing_m {spacing_m:.3g} needs {count.sum():.3g} lines along axis {axis}, the limit is "
            f"{MAX_CANDIDATES:.0e}; raise spacing_m (fewer diffuse points)"
        )
    counts = count.astype(np.int64)
    face = np.repeat(np.arange(len(corners)), counts)
    step = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    width = size[face, 1].astype(np.int64)
    origin = low.astype(np.int64)[face]
    return face, origin[:, 0] + step // width, origin[:, 1] + step % width


def _side(p: np.ndarray, q: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Twice the signed area of (p, q, point), (C,); bit for bit the negative of that for (q, p), zeros included.

    So a line through an edge that two faces share meets exactly one of them, unless both lie on one side of it.
    """
    swap = (p[:, 0] > q[:, 0]) | ((p[:, 0] == q[:, 0]) & (p[:, 1] > q[:, 1]))
    first, second = np.where(swap[:, None], q, p), np.where(swap[:, None], p, q)
    side = (second[:, 0] - first[:, 0]) * (y - first[:, 1]) - (second[:, 1] - first[:, 1]) * (x - first[:, 0])
    return np.where(swap, -side, side)
