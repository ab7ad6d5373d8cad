"""RCS over aspect, and rows and levels that the canonical targets have in common."""

from __future__ import annotations

import numpy as np

from t2d_rt.types import Radar
from validation.physics.turntable import db, mesh_fields, on_turntable, rcs

LIMIT_DB = 0.3
KA = np.geomspace(0.1, 500, 4000)
FACET_KA = np.geomspace(0.1, 500, 38)
ORIENTATIONS = 6
"""Sides from which a sphere of facets is seen: where its facets happen to lie changes the RCS a little."""
NEAR_M, RANGE_M, FAR_M = 1.0, 10.0, 1e4
SHOWN_DB, NEAR_SHOWN_DB = 30.0, 25.0
"""Patterns are compared down to so far below their peak, nulls having no level; near by, lobes of the facets' lattice lie below."""
NEAR_AXIS_DEG = 10.0
"""The single plates' lobes have nulls: a level on the very axis says little."""
BODY_KA = (27, 260)
"""Of a wrist of 17 mm radius and of a chest of 16 cm at 77 GHz."""


class Pattern:
    """RCS over aspect: of facets, of physical optics in closed form, and the truth where that is another."""

    def __init__(
        self, name: str, angle_rad: np.ndarray, facets: np.ndarray, optics: np.ndarray | None = None,
        truth: np.ndarray | None = None, *, shown_db: float = SHOWN_DB,
    ) -> None:  # fmt: skip
        self.name, self.angle_deg = name, np.degrees(angle_rad)
        self.facets, self.shown_db = facets, shown_db
        self.optics = facets if optics is None else optics
        self.truth = facets if truth is None else truth

    @property
    def title(self) -> str:
        """The target alone."""
        return self.name.split(",")[0]

    @property
    def span(self) -> str:
        return f"{self.angle_deg[0]:g} to {self.angle_deg[-1]:g} degrees"

    @property
    def worst_db(self) -> float:
        """Of the facets against the closed form, where it is not in a null."""
        return self.worst_to(self.shown_db)

    def worst_to(self, shown_db: float) -> float:
        """The same down to `shown_db` below the peak."""
        seen = self.optics > self.optics.max() * 10 ** (-shown_db / 10)
        return float(np.abs(db(self.facets[seen] / self.optics[seen])).max())

    @property
    def missing_db(self) -> float:
        """How much less than the truth on the axis the facets return at most within NEAR_AXIS_DEG of it."""
        return float(db(self.truth.max()) - db(self._near_axis.max()))

    @property
    def _near_axis(self) -> np.ndarray:
        return self.facets[np.abs(self.angle_deg) <= NEAR_AXIS_DEG]

    def row(self) -> dict[str, object]:
        name = f"{self.name}, at most within {NEAR_AXIS_DEG:g} degrees of its axis, all bounces"
        return row_of(name, "-", float(self._near_axis.max()), float(self.truth.max()))


def row_of(target: str, range_m: float | str, measured: float, expected: float) -> dict[str, object]:
    measured, expected = float(db(measured)), float(db(expected))
    return {
        "target": target, "range m": range_m, "measured dBsm": round(measured, 3), "exact dBsm": round(expected, 3),
        "error dB": round(measured - expected, 4),
    }  # fmt: skip


def worst_db(rows: list[dict[str, object]]) -> float:
    return max(abs(float(str(row["error dB"]))) for row in rows)


def rcs_over_aspect(
    radar: Radar, vertices: np.ndarray, faces: np.ndarray, angles: np.ndarray, range_m: float = FAR_M
) -> np.ndarray:
    """RCS [m^2] over the turntable's angles, no occlusion but of back faces."""
    shape = on_turntable(vertices, faces, angles, radar.tx_position_m + [range_m, 0, 0])
    return rcs(mesh_fields(shape, radar, occlusion=False)[0], range_m)
