"""Building blocks of movers: closed skins over rings of points, rotations, smooth steps, materials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from t2d_rt.core.checks import number
from t2d_rt.core.errors import InputError
from t2d_rt.types import Material, MovingMesh
from t2d_rt.types.fields import Number
from t2d_rt.types.mesh import Provenance, Track

# Smaller values give meshes without area, and absurd speeds.
Length = Annotated[Number, Field(ge=0.01, le=20)]
Seconds = Annotated[Number, Field(ge=0.05, le=3600)]
Angle = Annotated[Number, Field(ge=-360, le=360)]

Substance = str | Material
"""A `Material`, "plastic", "fabric", or the name of a body's or an ITU material."""
MATERIALS = {
    # Polypropylene, n = 1.50 and almost lossless (Lamb, Int. J. Infrared Millim. Waves 17, 1996); moulded, so nearly smooth.
    "plastic": Material(name="plastic", relative_permittivity=2.25, scattering_coefficient=0.1),
    # A half-space that reflects like 0.5 mm of curtain cotton, eps' = 1.47 at 2.45 GHz (Sankaralingam and Gupta, IEEE Trans.
    # Instrum. Meas. 59, 2010): -16 dB by physics.md, eq. 23. Woven threads are taken to be as rough as clothing.
    "fabric": Material(name="fabric", relative_permittivity=1.9, scattering_coefficient=0.6),
}


MAX_VERTICES = 100_000
"""Greatest number of vertices of a mover; tracing the visibility of one of that size takes some 300 MB."""


def check_size(vertices: int, noun: str, remedy: str) -> None:
    """Refuses a mover with too many vertices before these are made."""
    if vertices > MAX_VERTICES:
        raise InputError(f"a {noun} of that size has {vertices} vertices, more than {MAX_VERTICES}; {remedy}")


def check_speed(speed_mps: float, noun: str, remedy: str) -> None:
    """Refuses a mover that would move faster than sound."""
    if speed_mps > 340.0:
        raise InputError(f"that {noun} would move at {speed_mps:.4g} m/s, faster than sound; {remedy}")


def moving(
    mover: Any, track: Track, faces: np.ndarray, span_s: tuple[float, float], *, name: str, sagitta_rad: float = 0.07
) -> MovingMesh:
    """The mesh of a mover from the first to the last time of `span_s` [s], of the mover's own `material`; fans also have a
    `rotation_period_s`."""
    start_s, stop_s = span_s
    material: Substance = mover.material
    number("start_s", start_s, unit="s"), number("stop_s", stop_s, unit="s")
    if not start_s < stop_s:
        raise InputError(f"a mover's mesh needs finite start_s < stop_s, got {start_s} and {stop_s}")
    substance = MATERIALS.get(material, material) if isinstance(material, str) else material
    start_s, stop_s = float(start_s), float(stop_s)
    return MovingMesh.from_track(
        track,
        faces,
        np.array([start_s, stop_s]),
        material=substance,
        sagitta_rad=sagitta_rad,
        name=name,
        made=Provenance("mover", {"mover": mover, "start_s": start_s, "stop_s": stop_s}),
        period_s=getattr(mover, "rotation_period_s", None),
    )


def skin_faces(rings: int, per_ring: int) -> np.ndarray:
    """Triangles (F, 3) of a closed skin over rings of points, ring by ring, `per_ring` (even) points in each.

    Rings run counter-clockwise seen from the last one. Strips between points i and per_ring - 1 - i close both ends.
    """
    here = np.arange(per_ring)
    there = np.roll(here, -1)
    start = per_ring * np.arange(rings - 1)[:, None]
    a, b = start + here, start + there
    # Each cell between two rings is cut along the diagonal from a point to the next point of the ring above.
    sides = np.stack([np.stack([a, b, b + per_ring], -1), np.stack([a, b + per_ring, a + per_ring], -1)]).reshape(-1, 3)
    left = np.arange(per_ring // 2 - 1)
    right = per_ring - 1 - left
    low = np.concatenate([np.stack([left, right, left + 1], -1), np.stack([left + 1, right, right - 1], -1)])
    high = low[:, ::-1] + per_ring * (rings - 1)
    return np.concatenate([sides, low, high])


def ball_profile(rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights -1..1 and radii (rings,) of the unit sphere's rings, with a small flat at both ends."""
    angle = np.linspace(-math.pi / 2, math.pi / 2, rings + 2)[1:-1]
    return np.sin(angle) / np.sin(angle[-1]), np.cos(angle)


def sheet(front: np.ndarray, back: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (..., V, 3) and faces of a closed sheet from grids (..., rows, columns, 3) of its two sides.

    Seen from the front, rows run upwards and columns from left to right.
    """
    rows, columns = front.shape[-3:-1]
    rings = np.concatenate([front, back[..., ::-1, :]], axis=-2)
    return rings.reshape(*rings.shape[:-3], -1, 3), skin_faces(rows, 2 * columns)


def together(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Merges several meshes into one: vertices (..., V, 3) and faces (F, 3)."""
    first = np.cumsum([0, *(vertices.shape[-2] for vertices, _ in parts)])
    faces = [faces + start for (_, faces), start in zip(parts, first, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts], axis=-2), np.concatenate(faces)


def ring_of(points: int) -> np.ndarray:
    """Points (P, 3) of the unit circle about x, counter-clockwise seen from +x."""
    angle = 2 * math.pi * np.arange(points) / points
    return np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=1)


def ball(rings: int, per_ring: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and faces (F, 3) of the unit sphere, in rings about x."""
    height, width = ball_profile(rings)
    points = width[:, None, None] * ring_of(per_ring) + height[:, None, None] * np.array([1.0, 0.0, 0.0])
    return points.reshape(-1, 3), skin_faces(rings, per_ring)


def about_z(angle_rad: np.ndarray | float) -> np.ndarray:
    """Rotations (..., 3, 3) about the vertical, counter-clockwise from above."""
    return _rotation(angle_rad, 0, 1)


def about_y(angle_rad: np.ndarray | float) -> np.ndarray:
    """Rotations (..., 3, 3) about y that rotate z towards x."""
    return _rotation(angle_rad, 2, 0)


def about_x(angle_rad: np.ndarray | float) -> np.ndarray:
    """Rotations (..., 3, 3) about x that rotate y towards z."""
    return _rotation(angle_rad, 1, 2)


def _rotation(angle_rad: np.ndarray | float, first: int, second: int) -> np.ndarray:
    """Rotations (..., 3, 3) that rotate the first axis towards the second."""
    angle = np.asarray(angle_rad, float)
    rotation = np.zeros((*angle.shape, 3, 3))
    rotation[..., 3 - first - second, 3 - first - second] = 1
    rotation[..., first, first] = rotation[..., second, second] = np.cos(angle)
    rotation[..., second, first] = np.sin(angle)
    rotation[..., first, second] = -rotation[..., second, first]
    return rotation


def ease(fraction: np.ndarray) -> np.ndarray:
    """Smooth step from 0 to 1 over 0..1, without speed and acceleration at its ends: 6 x^5 - 15 x^4 + 10 x^3; its greatest slope is
    15/8."""
    x = np.clip(fraction, 0.0, 1.0)
    return x**3 * (10 + x * (6 * x - 15))
