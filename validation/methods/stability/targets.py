"""Conductors at rest and in motion that several cases use."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.types import PEC, MovingMesh, Radar
from validation.physics.rcs import TIMES_S, read_rcs, sphere

SPHERE_M = 0.15
"""Radius."""


def decibel(ratio: Any) -> Any:
    """Of a power ratio, or of many."""
    return 10 * np.log10(ratio)


def static_mesh(vertices: np.ndarray, faces: np.ndarray, **options: object) -> MovingMesh:
    """A perfect conductor at rest."""
    return MovingMesh(np.stack([vertices, vertices]), faces, TIMES_S, PEC, **options)


def measured_rcs(mesh: MovingMesh, radar: Radar, range_m: float) -> float:
    """RCS [m^2] read back from the ADC samples of `simulate` at its default settings."""
    return read_rcs(t2d.simulate(mesh, radar=radar).cube[0, 0], radar, range_m)


def ball(radar: Radar, radius_m: float, range_m: float, subdivisions: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """A sphere on the x axis whose nearest point is `range_m` away."""
    return sphere(radius_m, radar.tx_position_m + [range_m + radius_m, 0, 0], subdivisions)


def ball_rcs(radius_m: float, range_m: float) -> float:
    """[m^2], physics.md, eq. 7."""
    return math.pi * radius_m**2 * (range_m / (range_m + radius_m)) ** 2
