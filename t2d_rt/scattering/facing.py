"""Which faces of a mesh face both antennas of a path pair."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from t2d_rt.scattering.facets import Pair
from t2d_rt.scattering.patches import normals

BEND_RAD = 0.2
"""By how much more than at rest facets may be tilted against the face they lie in, where a joint bends."""


@dataclass(frozen=True, slots=True)
class Facing:
    """Normals and centroids of the cage's faces at a few instants."""

    normal: np.ndarray
    """(K, F, 3)."""
    middle: np.ndarray
    """(K, F, 3) m."""
    _angles: dict[bytes, np.ndarray] = field(default_factory=dict)
    """Those to each place so far: path pairs have images of the antennas in common."""

    @classmethod
    def of(cls, cage: np.ndarray, faces: np.ndarray) -> Facing:
        """Of the cage's vertices (K, V, 3) m."""
        return cls(normals(cage, faces), cage[:, faces].mean(axis=2))

    def lit(self, pair: Pair, tilt_rad: np.ndarray) -> np.ndarray:
        """Faces, bool (F,), that may hold facets lit by the transmitter and visible to the receiver at or between the instants;
        their facets are tilted against them by up to `tilt_rad` (F,)."""
        angle = np.maximum(self._angle(pair.views_m[0]), self._angle(pair.views_m[-1]))
        # What rotates from one instant to the next may rotate as much again in between.
        margin = tilt_rad + BEND_RAD + np.abs(np.diff(angle, axis=0)).max(axis=0, initial=0)
        return angle.min(axis=0) < math.pi / 2 + margin

    def _angle(self, place_m: np.ndarray) -> np.ndarray:
        """Of the lines of sight to a place with the normals [rad], (K, F)."""
        key = place_m.tobytes()
        if key not in self._angles:
            line_of_sight = place_m - self.middle
            cosine = np.einsum("kfi,kfi->kf", self.normal, line_of_sight) / np.sqrt(
                np.einsum("kfi,kfi->kf", line_of_sight, line_of_sight)
            )
            self._angles[key] = np.arccos(np.clip(cosine, -1, 1))
        return self._angles[key]
