"""Breathing and heartbeat: the front of the trunk moves forward, or the back moves where the person lies on the front."""

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
"""Height over which the movement fades out, above the hips and at the shoulders [m]."""
PRONE, LOW_M = (0.3, 0.8), (0.3, 0.55)
"""Limits between which the floor gradually comes to bear the chest: the cosine of the chest's front against down, and the height of
the chest over the floor [m]."""


@dataclass(frozen=True, slots=True)
class ChestWall:
    """How the skin moves with breathing and heartbeat: outwards, so that the depth is seen from any side that faces it."""

    motion: Motion
    front: np.ndarray
    """Displacement of each vertex relative to the depth, in the frames of `CARRIERS`, (V, 6, 3), where the person does not lie on
    the front."""
    back: np.ndarray
    """The same for the back, where the person lies on the front, (V, 6, 3)."""

    @classmethod
    def of(cls, body: Fitted, motion: Motion) -> ChestWall:
        """The chest wall of a fitted body: chest and abdomen, from the hips to the shoulders."""
        faces, heights = body.template.faces, body.vertices[:, 2]
        normals = vertex_normals(body.vertices, faces)
        lowest, highest = body.joints["left_hip"][2], body.joints["left_shoulder"][2]
        within = smooth_step(heights, lowest, lowest + EDGE_M) * smooth_step(highest - heights, -EDGE_M / 2, EDGE_M / 2)
        carried = body.template.weights[:, [CANONICAL_JOINTS.index(name) for name in CARRIERS]]
        # The skin moves in part where its normal has a forward component, and in full where it is within 63 degrees of forward.
        front, back = (smooth_step(sign * normals[:, 0], 0.0, 0.45) * within for sign in (1.0, -1.0))
        outwards = carried[:, :, None] * normals[:, None]
        return cls(motion, front[:, None, None] * outwards, back[:, None, None] * outwards)

    def move(self, vertices: np.ndarray, rotations: np.ndarray, origin: np.ndarray, times_s: np.ndarray) -> None:
        """Moves posed vertices (K, V, 3) m in place, for bones with rotations (K, B, 3, 3) and origins (K, B, 3)."""
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
    """How far the floor at z = 0 bears the chest, 0 to 1, (K,), for bones with rotations (K, B, 3, 3) and origins (K, B, 3); at 1
    its front cannot move forward."""
    chest = BONES.index("spine3")
    return smooth_step(-rotations[:, chest, 2, 0], *PRONE) * smooth_step(-origin[:, chest, 2], -LOW_M[1], -LOW_M[0])


def smooth_step(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Smooth step from 0 at `low` to 1 at `high`, with continuous slope and curvature."""
    x = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.asarray(x**3 * (10 + x * (6 * x - 15)))
