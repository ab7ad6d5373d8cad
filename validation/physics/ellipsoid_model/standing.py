"""The standing body: RCS over aspect of its ellipsoids, of the mesh and of the mesh's parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from t2d_rt.types import Radar
from validation.physics.turntable import (
    Body,
    aspects,
    db,
    ellipsoid_fields,
    mesh_fields,
    rcs,
)

BODY_RANGE_M, BODY_ASPECTS = 10.0, 720
SECTOR_DEG = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """RCS [m^2] over the aspect of the standing body, a conductor: 0 its front, 90 degrees its right side."""

    angle_deg: np.ndarray
    names: tuple[str, ...]
    parts: np.ndarray
    """Of each segment's part of the mesh (17, aspects)."""
    limbs: np.ndarray
    """Of each ellipsoid."""
    mesh: np.ndarray
    """Of the whole mesh with its shadows."""
    unhidden: np.ndarray
    ellipsoids: np.ndarray
    """Of the sum of their fields."""

    @property
    def rows(self) -> list[dict[str, object]]:
        """Each segment's, and the body's without occlusion and with its shadows."""
        pairs = [
            *zip(self.names, self.limbs, self.parts, strict=True),
            ("body, without occlusion", self.ellipsoids, self.unhidden),
        ]
        pairs.append(("body, mesh with its shadows", self.ellipsoids, self.mesh))
        return [_agreement(*pair) for pair in pairs]


def _agreement(name: str, ellipsoid: np.ndarray, mesh: np.ndarray) -> dict[str, object]:
    level = [float(db(each.mean())) for each in (ellipsoid, mesh)]
    smooth = [db(sector_means(each)) for each in (ellipsoid, mesh)]
    return {
        "what": name,
        "ellipsoid mean dBsm": level[0],
        "mesh mean dBsm": level[1],
        "difference dB": level[0] - level[1],
        "spread dB": f"{db(ellipsoid).std():.1f} / {db(mesh).std():.1f}",
        f"RMS difference over aspect, {SECTOR_DEG} degree sectors, dB": float(np.sqrt(np.mean((smooth[0] - smooth[1]) ** 2))),
    }  # fmt: skip


def sector_means(values: np.ndarray) -> np.ndarray:
    """Running means over SECTOR_DEG."""
    return np.asarray(uniform_filter1d(values, round(SECTOR_DEG * BODY_ASPECTS / 360), mode="wrap"))


def standing_body(radar: Radar, body: Body) -> Standing:
    step = 360 / BODY_ASPECTS
    angles = aspects(0, 360 - step, BODY_ASPECTS)
    surface = body.mesh(angles, BODY_RANGE_M, "pec")
    limbs = ellipsoid_fields(body.ellipsoids(angles, BODY_RANGE_M, "pec"), radar)
    alone = mesh_fields(surface, radar, occlusion=False, only=[body.part(number) for number in range(len(body.names))])
    return Standing(
        angle_deg=np.degrees(angles),
        names=body.names,
        parts=rcs(alone[1:], BODY_RANGE_M),
        limbs=rcs(limbs, BODY_RANGE_M),
        mesh=rcs(mesh_fields(surface, radar)[0], BODY_RANGE_M),
        unhidden=rcs(alone[0], BODY_RANGE_M),
        ellipsoids=rcs(limbs.sum(axis=0), BODY_RANGE_M),
    )
