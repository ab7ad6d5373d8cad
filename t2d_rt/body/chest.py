"""Breathing: the front of the trunk comes forward, or its back where somebody lies on the front."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.body.fit import Fitted
from t2d_rt.body.pose import BONES
from t2d_rt.geometry.vectors import edge_cross, unit
from t2d_rt.types.motion import CANONICAL_JOINTS, Breathing

CARRIERS = ("pelvis", "spine1", "spine2", "spine3")
"""Bones that carry chest and abdomen."""
EDGE_M = 0.06
"""Height over which the movement fades, above the hips and below the shoulders."""
FACING = 0.45
"""Cosine against the trunk's own front from which the skin takes part in full; from 0 on a part of it."""
PRONE, LOW_M = (0.3, 0.8), (0.3, 0.55)
"""Cosines of the chest's front against down, and heights of the chest over the floor, between which the floor comes to bear it."""


@dataclass(frozen=True, slots=True)
class ChestWall:
    """What of the skin moves as somebody breathes."""

    breathing: Breathing
    front: np.ndarray
    """Part of the movement that each vertex takes with each of `CARRIERS`, (V, 4), where somebody does not lie on the front."""
    back: np.ndarray
    """The same, away from the front, of somebody who does, (V, 4)."""

    @classmethod
    def of(cls, body: Fitted, breathing: Breathing) -> ChestWall:
        """Of a fitted body: chest and abdomen from the hips to the shoulders."""
        faces, heights = body.template.faces, body.vertices[:, 2]
        normals = np.zeros_like(body.vertices)
        for corner in range(3):
            np.add.at(normals, faces[:, corner], edge_cross(body.vertices[faces]))
        ahead = unit(normals)[:, 0]
        lowest, highest = body.joints["left_hip"][2], body.joints["left_shoulder"][2]
        within = smooth_step(heights, lowest, lowest + EDGE_M) * smooth_step(-heights, -highest, EDGE_M - highest)
        carried = body.template.weights[:, [CANONICAL_JOINTS.index(name) for name in CARRIERS]]
        front, back = (smooth_step(sign * ahead, 0.0, FACING) * within for sign in (1.0, -1.0))
        return cls(breathing, carried * front[:, None], carried * back[:, None])

    def move(self, vertices: np.ndarray, rotations: np.ndarray, origin: np.ndarray, times_s: np.ndarray) -> None:
        """Moves posed vertices (K, V, 3) of bones (K, B, 3, 3) at (K, B, 3), in place."""
        ahead = rotations[..., 0][:, [BONES.index(name) for name in CARRIERS]]
        out_m = self.breathing.displacement_m(times_s)
        borne = lies_on_front(rotations, origin)
        for weights, moved in ((self.front, out_m * (1 - borne)), (self.back, -out_m * borne)):
            if moved.any():
                rows = np.flatnonzero(weights.any(axis=1))
                vertices[:, rows] += weights[rows] @ (ahead * moved[:, None, None])


def lies_on_front(rotations: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """How far the floor at z = 0 bears the chest of bones (K, B, 3, 3) at (K, B, 3), 0 to 1, (K,): it cannot come forward then."""
    chest = BONES.index("spine3")
    return smooth_step(-rotations[:, chest, 2, 0], *PRONE) * smooth_step(-origin[:, chest, 2], -LOW_M[1], -LOW_M[0])


def smooth_step(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """From 0 at `low` to 1 at `high` without a jump of slope or curvature."""
    x = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.asarray(x**3 * (10 + x * (6 * x - 15)))
