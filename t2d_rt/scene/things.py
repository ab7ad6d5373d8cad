"""Surfaces of what people carry, in the frame of each thing: x forward, y left, z up."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.scene.movers.solids import MATERIALS, ball, ring_of, skin_faces, together
from t2d_rt.types import Material
from t2d_rt.types.motion import HANDLE_M, Carried

STEP_M = 0.1
"""Between vertices: visibility is sampled there."""
PER_RING = 12
"""Points around a tube: edges of 30 degrees are smooth."""
CANE_HANDLE_M = 0.06
"""Half the length of a cane's handle."""

Solid = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) [m] and faces (F, 3)."""


def surface(carried: Carried) -> Solid:
    """The surface of a thing in its own frame."""
    size = carried.size_m
    if carried.thing == "bag":
        vertices, faces = block(size)
        return vertices - [0.0, 0.0, HANDLE_M + size[2] / 2], faces
    if carried.thing == "ball":
        vertices, faces = ball(16, 24)
        return size[0] * vertices, faces
    if carried.thing == "cane":
        radius_m, length_m = size[0] / 2, size[1]
        handle = tube([-CANE_HANDLE_M, 0, 0], [CANE_HANDLE_M, 0, 0], radius_m)
        return together([handle, tube([0, 0, -radius_m], [0, 0, -length_m], radius_m)])
    return block(size)


def substance(carried: Carried) -> str | Material:
    """What it is made of."""
    material = carried.material
    return MATERIALS.get(material, material) if isinstance(material, str) else material


def block(size_m: tuple[float, ...]) -> Solid:
    """A box about the origin with sides along the axes, its faces cut into rectangles of `STEP_M` at most."""
    counts = np.array([math.ceil(each / STEP_M) for each in size_m])
    cells, first = [], 0
    for axis in range(3):
        across, up = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            corner = np.zeros((counts[across], counts[up], 4, 3), int)
            i, j = np.meshgrid(np.arange(counts[across]), np.arange(counts[up]), indexing="ij")
            for k, (a, b) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))[:: 1 if side else -1]):
                corner[..., k, across], corner[..., k, up] = i + a, j + b
            corner[..., axis] = side * counts[axis]
            cells.append(corner.reshape(-1, 3))
            first += counts[across] * counts[up]
    points, index = np.unique(np.concatenate(cells), axis=0, return_inverse=True)
    quads = index.reshape(first, 4)
    return (points / counts - 0.5) * size_m, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def tube(start: list[float], end: list[float], radius_m: float) -> Solid:
    """A closed tube between two points."""
    begin, span = np.array(start, float), np.subtract(end, start)
    length_m = float(np.linalg.norm(span))
    axis = span / length_m
    aside = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    aside /= np.linalg.norm(aside)
    rings = math.ceil(length_m / STEP_M) + 1
    circle = radius_m * ring_of(PER_RING) @ np.array([axis, aside, np.cross(axis, aside)])
    points = begin + np.linspace(0, 1, rings)[:, None, None] * span + circle
    return points.reshape(-1, 3), skin_faces(rings, PER_RING)
