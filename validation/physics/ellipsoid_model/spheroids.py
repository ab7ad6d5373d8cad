"""One ellipsoid against converged facets of the same spheroid, over aspect."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.scattering.ellipsoid import ellipsoid_echoes
from t2d_rt.types import PEC, Radar
from validation.physics.rcs import sphere
from validation.physics.turntable import (
    aspects,
    db,
    ellipsoid_fields,
    ellipsoids_on_turntable,
    mesh_fields,
    on_turntable,
)

SPHEROIDS_M = ((0.08, 0.22), (0.05, 0.15))
"""Short and long semi-axes, of a thigh and of a forearm."""
RANGES_M = (1.0, 3.0, 10.0)
ASPECTS = 181
CONVERGED_RAD, DEFAULT_RAD = 0.005, 0.07
"""At 0.01 rad one of the 1086 fields is still 0.15 dB off, where lobes of the facets' lattice add up."""
LIMIT_DB, LIMIT_DEG = 0.1, 3.0
SWING_RAD_PER_S = 5.0
"""Of a limb."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spheroid:
    """The models' errors against converged facets, each (aspects,)."""

    semi_axes_m: tuple[float, float]
    range_m: float
    level_db: np.ndarray
    phase_deg: np.ndarray
    default_db: float
    """Worst of facets at default fineness."""
    centre_db: np.ndarray
    """Of the centre-phase baseline."""
    centre_m: np.ndarray
    """By how much its range is too long."""

    @property
    def centre_mps(self) -> float:
        """Greatest error of the baseline's speed at SWING_RAD_PER_S."""
        return float(np.abs(np.gradient(self.centre_m, math.pi / (ASPECTS - 1))).max()) * SWING_RAD_PER_S

    @property
    def name(self) -> str:
        return f"{100 * self.semi_axes_m[0]:g} x {100 * self.semi_axes_m[1]:g} cm, {self.range_m:g} m"

    def row(self) -> dict[str, object]:
        return {
            "spheroid": self.name,
            "worst dB": float(np.abs(self.level_db).max()),
            "worst degrees": float(np.abs(self.phase_deg).max()),
            "facets of default fineness, worst dB": self.default_db,
            "from the centre: worst dB": float(np.abs(self.centre_db).max()),
            "range too long by mm": f"{1e3 * self.centre_m.min():.0f} to {1e3 * self.centre_m.max():.0f}",
            f"speed off at {SWING_RAD_PER_S:g} rad/s by m/s": self.centre_mps,
        }


def spheroid_errors(radar: Radar, semi_axes_m: tuple[float, float], range_m: float) -> Spheroid:
    """The long axis is horizontal and points at the radar at 0 and 180 degrees."""
    a, c = semi_axes_m
    angles, place = aspects(0, 180, ASPECTS), radar.tx_position_m + [range_m, 0, 0]
    unit, faces = sphere(1.0, np.zeros(3))
    # No axis of symmetry of the mesh along the spheroid's: its lattice would return lobes that add up (canonical).
    unit = Rotation.random(rng=np.random.default_rng(0)).apply(unit)
    found, coarse = (
        mesh_fields(on_turntable(unit * [c, a, a], faces, angles, place, sagitta_rad=s), radar, occlusion=False)[0]
        for s in (CONVERGED_RAD, DEFAULT_RAD)
    )
    axes = np.array([[[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], float)  # the third along x
    shape = ellipsoids_on_turntable(np.array([[a, a, c]]), np.zeros((1, 3)), axes, angles, place)
    specular, centre = (ellipsoid_fields(shape, radar, phase_from=each)[0] for each in ("specular", "centre"))
    ranges = [
        ellipsoid_echoes(shape, radar, times_s=shape.times_s, material=PEC, phase_from=each).gather().delay_s[:, 0]
        for each in ("specular", "centre")
    ]
    return Spheroid(
        semi_axes_m=semi_axes_m,
        range_m=range_m,
        level_db=2 * db(np.abs(specular / found)),
        phase_deg=np.degrees(np.angle(specular / found)),
        default_db=float(np.abs(2 * db(np.abs(coarse / found))).max()),
        centre_db=2 * db(np.abs(centre / found)),
        centre_m=(ranges[1] - ranges[0]) * SPEED_OF_LIGHT / 2,
    )
