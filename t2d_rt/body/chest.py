"""Breath and heart: the front of the trunk comes forward, or its back where somebody lies on the front."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.body.fit import Fitted
from t2d_rt.body.pose import BONES
from t2d_rt.geometry.vectors import vertex_normals
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

CARRIERS = ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar")
"""Bones that carry chest and abdomen, up to the collarbones."""
EDGE_M = 0.06
"""Height over which the movement fades, above the hips and about the shoulders."""
PRONE, LOW_M = (0.3, 0.8), (0.3, 0.55)
"""Cosines of the chest's front against down, and heights of the chest over the floor, between which the floor comes to bear it."""


@dataclass(frozen=True, slots=True)
class ChestWall:
    """What of the skin moves as somebody breathes and the heart beats: outwards, so that whoever looks at it sees the depth."""

    motion: Motion
    front: np.ndarray
    """Movement of each vertex with each of `CARRIERS`, over the depth, (V, 6, 3), where somebody does not lie on the front."""
    back: np.ndarray
    """The same movement of the back, where somebody lies on the front, (V, 6, 3)."""

    @classmethod
    def of(cls, body: Fitted, motion: Motion) -> ChestWall:
        """The chest wall of a fitted body: chest and abdomen from the hips to the shoulders."""
        faces, heights = body.template.faces, body.vertices[:, 2]
        normals = vertex_normals(body.vertices, faces)
        lowest, highest = body.joints["left_hip"][2], body.joints["left_shoulder"][2]
        within = smooth_step(heights, lowest, lowest + EDGE_M) * smooth_step(highest - heights, -EDGE_M / 2, EDGE_M / 2)
        carried = body.template.weights[:, [CANONICAL_JOINTS.index(name) for name in CARRIERS]]
        # The skin takes part from 0 on, in full from where it looks less than 63 degrees aside.
        front, back = (smooth_step(sign * normals[:, 0], 0.0, 0.45) * within for sign in (1.0, -1.0))
        outwards = carried[:, :, None] * normals[:, None]
        return cls(motion, front[:, None, None] * outwards, back[:, None, None] * outwards)

    def move(self, vertices: np.ndarray, rotations: np.ndarray, origin: np.ndarray, times_s: np.ndarray) -> None:
        """Moves posed vertices (K, V, 3) of bones (K, B, 3, 3) at (K, B, 3), in place."""
        carriers = (
            rotations[:, [BONES.index(name) for name in CARRIERS]].transpose(0, 1, 3, 2).reshape(len(rotations), -1, 3)
        )
        out_m = self.motion.chest_m(times_s)
        borne = lies_on_front(rotations, origin)
        for outwards, moved in ((self.front, out_m * (1 - borne)), (self.back, out_m * borne)):
            if moved.any():
                rows = np.flatnonzero(outwards.any(axis=(1, 2)))
                vertices[:, rows] += outwards[rows].reshape(len(rows), -1) @ (carriers * moved[:, None, None])


def lies_on_front(rotations: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """How far the floor at z = 0 bears the chest of bones (K, B, 3, 3) at (K, B, 3), 0 to 1, (K,): it cannot come forward then."""
    chest = BONES.index("spine3")
    return smooth_step(-rotations[:, chest, 2, 0], *PRONE) * smooth_step(-origin[:, chest, 2], -LOW_M[1], -LOW_M[0])


def smooth_step(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Values that rise from 0 at `low` to 1 at `high` without a jump of slope or curvature."""
    x = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.asarray(x**3 * (10 + x * (6 * x - 15)))
