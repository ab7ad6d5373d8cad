"""Surfaces of the things that people carry, in the frame of each thing: x forward, y left, z up."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.scene.movers.solids import MATERIALS, ball, ring_of, skin_faces, together
from t2d_rt.types import Material
from t2d_rt.types.carried import HANDLE_M, RIM_M, WHEEL_M, Carried

STEP_M = 0.1
"""Distance between vertices [m], the points at which visibility is sampled."""
PER_RING = 12
"""Number of points around a tube; its edges of 30 degrees count as smooth."""
CANE_HANDLE_M, CUFF_M = 0.06, 0.22
"""Half the length of a cane's handle, and height of a crutch's cuff above its grip [m]."""
TUBE_M, CASTOR_M = 0.0125, 0.0635
"""Radii of the tubes of frames (25 mm in diameter) and of a walking frame's wheels (5 inches in diameter) [m]."""
SPOKES, SPOKE_M = 12, 0.0025
"""Number of spokes of a rear wheel, and their radius [m]. Real wheels have some 24 to 36 of 2 mm. Fewer and thicker ones need fewer
facets, and physical optics holds for neither: 5 mm is 0.4 wavelengths at 24 GHz and 1.3 at 77 GHz."""

OUTWARD = np.stack(np.meshgrid(*3 * [np.arange(-2, 3)]), axis=0).reshape(3, -1)
"""Directions (3, 125) in which the outermost vertices of a surface are searched."""

Solid = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) [m] and faces (F, 3)."""


def surface(carried: Carried) -> Solid:
    """The surface of a thing in its own frame, without the wheels that roll."""
    size = carried.size_m
    if carried.thing == "crutch":
        radius_m = size[0] / 2
        cuff = tube([-0.09, -0.045, CUFF_M], [-0.09, 0.045, CUFF_M], 0.02)
        arm = tube([0, 0, radius_m], [-0.09, 0, CUFF_M - 0.02], radius_m)
        handle = tube([-0.02, 0, 0], [0.1, 0, 0], radius_m)
        return together([cuff, arm, handle, tube([0, 0, -radius_m], [0, 0, -size[1]], radius_m)])
    if carried.thing == "walker":
        return together(
            [part for y in (-1, 1) for part in _walker_side(y * (size[0] / 2 - TUBE_M), size[1])] + _across(size)
        )
    if carried.thing == "wheelchair":
        return together(_chair(size[0] / 2 - 0.09, *size[1:]))
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


def wheels(carried: Carried) -> list[tuple[np.ndarray, float, Solid]]:
    """Wheels that roll with a thing: axle (3,) in the frame of the thing, radius [m], and surface relative to the axle, which is
    along y."""
    if carried.thing != "wheelchair":
        return []
    tyre, hub = torus(WHEEL_M - TUBE_M, TUBE_M), tube([0, -0.04, 0], [0, 0.04, 0], 0.025)
    spokes = []
    for angle in 2 * math.pi * np.arange(SPOKES) / SPOKES:
        along = np.array([math.sin(angle), 0.0, math.cos(angle)])
        spokes.append(tube(list(0.026 * along), list((WHEEL_M - 2 * TUBE_M) * along), SPOKE_M))
    vertices, faces = together([tyre, hub, *spokes])
    wheels_of_thing = []
    for side in (1.0, -1.0):
        # The hand rim is on the outer side of the wheel.
        solid = together([(vertices - [0.0, 0.04 * side, 0.0], faces), torus(RIM_M, 0.009)])
        wheels_of_thing.append((np.array([0.0, side * carried.size_m[0] / 2, WHEEL_M]), WHEEL_M, solid))
    return wheels_of_thing


def _walker_side(y: float, height_m: float) -> list[Solid]:
    """Grip, two legs, a rail and the front wheel on one side of a walking frame; dimensions are estimates."""
    return [
        tube([-0.1, y, height_m], [0.1, y, height_m], TUBE_M),
        tube([-0.08, y, height_m - TUBE_M], [-0.14, y, 0.0], TUBE_M),
        tube([0.08, y, height_m - TUBE_M], [0.3, y, CASTOR_M], TUBE_M),
        tube([-0.1, y, 0.35 * height_m], [0.2, y, 0.35 * height_m], TUBE_M),
        tube([0.3, y - 0.014, CASTOR_M], [0.3, y + 0.014, CASTOR_M], CASTOR_M),
    ]


def _across(size_m: tuple[float, ...]) -> list[Solid]:
    """The two bars across the front of a walking frame."""
    y, height_m = size_m[0] / 2 - TUBE_M, size_m[1]
    return [tube([x, -y, z * height_m], [x, y, z * height_m], TUBE_M) for x, z in ((0.12, 0.8), (0.2, 0.45))]


def _chair(y: float, seat_m: float, rest_m: float, low_m: float) -> list[Solid]:
    """Seat, back, tubes, casters and footrests of a wheelchair of width 2 y [m]; the footrests are `rest_m` ahead and `low_m` high.

    Dimensions are estimates for a folding chair for adults.
    """
    seat, back = block((0.42, 2 * y, 0.03)), block((0.03, 2 * y, 0.42))
    solids = [
        (seat[0] + [0.12, 0.0, seat_m - 0.015], seat[1]),
        (back[0] + [-0.15, 0.0, seat_m + 0.25], back[1]),
        tube([0, -y, WHEEL_M], [0, y, WHEEL_M], TUBE_M),
    ]
    for side in (-y, y):
        solids += [
            tube([-0.18, side, 0.25], [-0.18, side, seat_m + 0.45], TUBE_M),
            tube([-0.18, side, seat_m - 0.05], [0.36, side, seat_m - 0.05], TUBE_M),
            tube([0.36, side, seat_m - 0.05], [rest_m - 0.02, side, low_m + 0.03], TUBE_M),
            tube([0.3, side, 0.2], [0.3, side, seat_m - 0.06], TUBE_M),
            tube([0.3, side - 0.015, 0.1], [0.3, side + 0.015, 0.1], 0.1),
        ]
        rest = block((0.16, 0.14, 0.02))
        solids.append((rest[0] + [rest_m, 0.6 * side, low_m - 0.01], rest[1]))
    return solids


def torus(radius_m: float, tube_m: float) -> Solid:
    """A torus about y; a rotation from one spoke to the next maps it onto itself."""
    count = SPOKES * max(2, round(2 * math.pi * radius_m / STEP_M * 2 / SPOKES))
    angle, ring = 2 * math.pi * np.arange(count) / count, 2 * math.pi * np.arange(PER_RING) / PER_RING
    far = radius_m + tube_m * np.cos(ring)
    points = np.stack(
        np.broadcast_arrays(np.sin(angle)[:, None] * far, tube_m * np.sin(ring), np.cos(angle)[:, None] * far),
        axis=-1,
    )
    here = np.arange(count * PER_RING).reshape(count, PER_RING)
    a, b, c, d = here, np.roll(here, -1, 0), np.roll(here, (-1, -1), (0, 1)), np.roll(here, -1, 1)
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return points.reshape(-1, 3), faces


def outline(vertices: np.ndarray) -> np.ndarray:
    """Indices of vertices (V, 3) that represent a surface: its extreme points, and one in each cube of `STEP_M`."""
    corners = (vertices @ OUTWARD).argmax(axis=0)
    _, spread = np.unique(np.floor(vertices / STEP_M), axis=0, return_index=True)
    return np.union1d(corners, spread)


def substance(carried: Carried) -> str | Material:
    """Material of a thing."""
    material = carried.material
    return MATERIALS.get(material, material) if isinstance(material, str) else material


def block(size_m: tuple[float, ...]) -> Solid:
    """A box centred at the origin with sides along the axes, its faces divided into rectangles of at most `STEP_M`."""
    counts = np.array([math.ceil(side_m / STEP_M) for side_m in size_m])
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
