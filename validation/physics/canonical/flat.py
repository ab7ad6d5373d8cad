"""Plates, corners of plates and corners of a room."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from t2d_rt.core.backend import select
from t2d_rt.propagation.clutter import static_paths
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.scattering.clutter import mirror_echoes
from t2d_rt.types import PEC, Radar, Scene, Surface
from validation.physics import exact
from validation.physics.canonical.curved import PLATE_M
from validation.physics.canonical.pattern import NEAR_M, NEAR_SHOWN_DB, Pattern, rcs_over_aspect, row_of
from validation.physics.turntable import aspects

CORNER_M = 0.10
CORNER_RANGE_M = 3.0


def plate_pattern(radar: Radar) -> Pattern:
    angles = aspects(-60, 60, 1201)
    found = rcs_over_aspect(radar, *_rectangle(), angles)
    return Pattern("plate 10 x 10 cm, far away", angles, found, exact.plate_rcs(*PLATE_M, angles, radar.wavelength_m))


def near_plate_pattern(radar: Radar) -> Pattern:
    """At NEAR_M, against Gauss's quadrature of the same integral."""
    angles = aspects(-30, 30, 301)
    node, weight = np.polynomial.legendre.leggauss(200)
    y, z = (node * side / 2 for side in PLATE_M)
    cells = np.stack(np.meshgrid([0.0], y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    areas = np.outer(np.outer(weight, weight).ravel() * math.prod(PLATE_M) / 4, [-1.0, 0, 0])
    place = radar.tx_position_m + [NEAR_M, 0, 0]
    expected = [
        exact.summed_optics(
            rotation.apply(cells) + place, rotation.apply(areas), radar.tx_position_m, radar.wavelength_m
        )
        for rotation in Rotation.from_rotvec(np.outer(angles, [0, 0, 1]))
    ]
    found = rcs_over_aspect(radar, *_rectangle(), angles, NEAR_M)
    return Pattern(
        f"plate 10 x 10 cm at {NEAR_M:g} m", angles, found, np.array(expected) * NEAR_M**4, shown_db=NEAR_SHOWN_DB
    )


def _rectangle() -> tuple[np.ndarray, np.ndarray]:
    """Looking along -x."""
    y, z = PLATE_M[0] / 2, PLATE_M[1] / 2
    return np.array([[0, -y, -z], [0, y, -z], [0, y, z], [0, -y, z]]), np.array([[0, 2, 1], [0, 3, 2]])


def dihedral_pattern(radar: Radar) -> Pattern:
    """Two square plates with a common vertical edge; at 0 the radar is on the bisector."""
    angles, a, lam = aspects(-45, 45, 1801), CORNER_M, radar.wavelength_m
    edge = np.array([[0, 0, -a / 2], [0, 0, a / 2]])
    left, right = (edge + [a / math.sqrt(2), sign * a / math.sqrt(2), 0] for sign in (1, -1))
    vertices = np.concatenate([edge, left, right])
    faces = np.array([[0, 2, 3], [0, 3, 1], [0, 5, 4], [0, 1, 5]])
    # Each plate's own pattern, with the phase of its middle, half an edge's length from the common edge.
    k = 2 * math.pi / lam
    field = np.zeros(len(angles), complex)
    for sign in (1, -1):
        off = angles + sign * math.pi / 4  # from the plate's normal
        lobes = np.cos(off) * np.sinc(k * a * np.sin(off) / math.pi)
        field += lobes * np.exp(-1j * sign * k * a * np.sin(off))
    optics = 4 * math.pi * (a * a / lam) ** 2 * np.abs(field) ** 2
    truth = 16 * math.pi * (a * a / lam) ** 2 * np.sin(math.pi / 4 - np.abs(angles)) ** 2
    found = rcs_over_aspect(radar, vertices @ _rotation_by_180_degrees().T, faces, angles)
    return Pattern("dihedral of 10 cm plates, far away", angles, found, optics, truth)


def _rotation_by_180_degrees() -> np.ndarray:
    """The targets' own +x looks at the radar, which stands at -x of them."""
    return np.diag([-1.0, -1.0, 1.0])


def trihedral_pattern(radar: Radar, *, triangular: bool) -> Pattern:
    """Three plates at right angles, seen over azimuth at the elevation of their axis (1, 1, 1)."""
    angles, a, lam = aspects(-45, 45, 1801), CORNER_M, radar.wavelength_m
    points, faces = [], []
    for i in range(3):
        u, v = np.eye(3)[(i + 1) % 3] * a, np.eye(3)[(i + 2) % 3] * a
        first = 4 * i
        points += [0 * u, u, v, u + v]
        faces += (
            [[first, first + 1, first + 2]]
            if triangular
            else [[first, first + 1, first + 3], [first, first + 3, first + 2]]
        )
    vertices = np.array(points)
    used, inverse = np.unique(np.array(faces), return_inverse=True)
    vertices, triangles = vertices[used], inverse.reshape(-1, 3)
    # The axis (1, 1, 1) becomes the line of sight, horizontal; the third edge stays in the vertical plane.
    axis = np.ones(3) / math.sqrt(3)
    left = np.array([-1, 1, 0]) / math.sqrt(2)
    frame = np.stack([axis, left, np.cross(axis, left)])
    found = rcs_over_aspect(radar, vertices @ frame.T @ _rotation_by_180_degrees().T, triangles, angles)
    peak = (4 / 3 if triangular else 12) * math.pi * a**4 / lam**2
    truth = np.where(np.abs(angles) < 1e-9, peak, 0)
    name = "triangular" if triangular else "square"
    return Pattern(f"{name} trihedral of 10 cm edges, far away", angles, found, truth=truth)


def room_corner(radar: Radar, walls: int) -> dict[str, object]:
    """The power that comes back from a corner of 2 or 3 endless metal walls, as an RCS: pi R^2, R the distance of the corner."""
    away = np.ones(3) if walls == 3 else np.array([1.0, 1.0, 0])
    away *= CORNER_RANGE_M / np.linalg.norm(away)
    surfaces = tuple(_wall(radar.tx_position_m + away, axis) for axis in range(walls))
    found = static_paths(Scene(name="corner", surfaces=surfaces), radar, order=walls, backend=select("auto"))
    paths = [path for path in found if len(path.path.chain) == walls]
    cube = synthesize(mirror_echoes(paths, radar, times_s=np.linspace(0, 0.02, 5)), radar)
    power = float(np.mean(np.abs(cube[:]) ** 2))
    return row_of(
        f"corner of {walls} endless walls of a room", CORNER_RANGE_M,
        power * CORNER_RANGE_M**4 / radar.link_amplitude**2, math.pi * CORNER_RANGE_M**2,
    )  # fmt: skip


def _wall(corner_m: np.ndarray, axis: int, half_m: float = 20.0) -> Surface:
    """A square of walls across an axis, through a point."""
    u, v = (half_m * np.eye(3)[(axis + i) % 3] for i in (1, 2))
    vertices = corner_m + np.array([-u - v, u - v, u + v, v - u])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Surface(name=f"wall {axis}", vertices=vertices, faces=faces, material=PEC, thickness_m=0.01)
