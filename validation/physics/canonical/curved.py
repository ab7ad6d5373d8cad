"""Spheres, spheroids and cylinders, by facets and read from the ADC cube."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.types import PEC, MovingMesh, Radar
from validation.physics import exact
from validation.physics.canonical.pattern import FAR_M, ORIENTATIONS, RANGE_M, Pattern, rcs_over_aspect, row_of
from validation.physics.rcs import TIMES_S, read_rcs, sphere
from validation.physics.turntable import aspects, db, mesh_fields, on_turntable, rcs

PLATE_M, CYLINDER_M = (0.10, 0.10), (0.04, 0.25)
"""Width and height; radius and length, of a forearm."""
SPHEROID_M = (0.08, 0.22)


def sphere_ratio(radar: Radar, ka: float, *, along_axis: bool = False) -> np.ndarray:
    """sigma / (pi a^2) of a sphere of facets from ORIENTATIONS sides, or first along an axis of symmetry; default accuracy."""
    radius = ka * radar.wavelength_m / (2 * math.pi)
    vertices, faces = sphere(radius, np.zeros(3), subdivisions=4)
    if not along_axis:
        vertices = Rotation.random(rng=np.random.default_rng(round(1e3 * ka))).apply(vertices)
    ball = on_turntable(vertices, faces, aspects(0, 60, ORIENTATIONS), radar.tx_position_m + [RANGE_M + radius, 0, 0])
    near = (RANGE_M / (RANGE_M + radius)) ** 2
    return rcs(mesh_fields(ball, radar, occlusion=False)[0], RANGE_M) / (math.pi * radius**2 * near)


def axial_sphere(radar: Radar, ka: float) -> dict[str, object]:
    area = math.pi * (ka * radar.wavelength_m / (2 * math.pi)) ** 2
    measured = float(sphere_ratio(radar, ka, along_axis=True)[0])
    name = f"sphere ka = {ka:g} along its mesh's axis of symmetry, physical optics"
    return row_of(name, RANGE_M, measured * area, float(exact.sphere_optics(ka)) * area)


def _static(vertices: np.ndarray, faces: np.ndarray, radar: Radar) -> np.ndarray:
    mesh = MovingMesh(np.stack([vertices, vertices]), faces, TIMES_S, PEC)
    return np.asarray(t2d.simulate(mesh, radar=radar).cube[0, 0])


def read_sphere(ka: float) -> dict[str, object]:
    """At mid-sweep, from the two middle samples: over a sweep ka changes."""
    radar = Radar.preset("table2-long")
    radius = ka * radar.wavelength_m / (2 * math.pi)
    vertices, faces = sphere(radius, radar.tx_position_m + [RANGE_M + radius, 0, 0])
    middle = _static(vertices, faces, radar)[radar.samples // 2 - 1 : radar.samples // 2 + 1]
    measured = float(np.mean(np.abs(middle) ** 2)) * RANGE_M**4 / radar.link_amplitude**2
    near = (RANGE_M / (RANGE_M + radius)) ** 2
    return row_of(f"sphere ka = {ka:g}, Mie", RANGE_M, measured, exact.mie(ka) * math.pi * radius**2 * near)


def spheroid_tip(radar: Radar) -> float:
    a, c = SPHEROID_M
    unit, faces = sphere(1.0, np.zeros(3))
    shape = on_turntable(unit * [c, a, a], faces, aspects(0, 1, 2), radar.tx_position_m + [FAR_M, 0, 0])
    found = rcs(mesh_fields(shape, radar, occlusion=False)[0, 0], FAR_M)
    return abs(float(db(found / exact.spheroid_tip_rcs(a, c, radar.wavelength_m))))


def cylinder_pattern(radar: Radar) -> Pattern:
    angles = aspects(0, 90, 1801)
    vertices, faces = _closed_cylinder()
    found = rcs_over_aspect(radar, vertices[:, [2, 1, 0]] * [1, 1, -1], faces, angles - math.pi / 2)
    expected = exact.cylinder_rcs(*CYLINDER_M, angles, radar.wavelength_m)
    return Pattern("cylinder 4 x 25 cm, far away", angles, found, expected)


def _closed_cylinder() -> tuple[np.ndarray, np.ndarray]:
    """Along z."""
    import trimesh

    shape = trimesh.creation.cylinder(radius=CYLINDER_M[0], height=CYLINDER_M[1], sections=64)
    return np.asarray(shape.vertices), np.asarray(shape.faces)


def read_cylinder(range_m: float) -> dict[str, object]:
    """Broadside, against cells of 0.2 mm along a ring of 0.2 degrees."""
    radar = Radar.preset("table2-long")
    radius, length = CYLINDER_M
    vertices, faces = _closed_cylinder()
    place = radar.tx_position_m + [range_m + radius, 0, 0]
    z, angle = np.meshgrid(
        (np.arange(1250) + 0.5) / 1250 * length - length / 2, np.radians(90.1 + 0.2 * np.arange(900)), indexing="ij"
    )
    normal = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1).reshape(-1, 3)
    cells = radius * normal + z.reshape(-1, 1) * [0, 0, 1] + place
    areas = normal * (length / 1250 * math.radians(0.2) * radius)
    expected = exact.summed_optics(cells, areas, radar.tx_position_m, radar.wavelength_m) * range_m**4
    return row_of(
        "cylinder, broadside", range_m, read_rcs(_static(vertices + place, faces, radar), radar, range_m), expected
    )
