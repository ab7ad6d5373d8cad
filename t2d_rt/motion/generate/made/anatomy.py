"""Lengths that key poses need, masses of the segments, and the neutral posture of a skeleton."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from t2d_rt.motion.kinematics import INDEX, LOWER_BACK, NAMES, Skeleton

SOLE = 0.0146
"""Height of the ball's joint over the floor, over stature; of the adult template, 27 mm of 1.84 m."""

LIMB_MASSES: tuple[tuple[str, str, float, float], ...] = (
    ("shoulder", "elbow", 0.0271, 0.577), ("elbow", "wrist", 0.0162, 0.457), ("wrist", "hand", 0.0061, 0.79),
    ("hip", "knee", 0.1416, 0.410), ("knee", "ankle", 0.0433, 0.446), ("ankle", "toe", 0.0137, 0.442),
)  # fmt: skip
"""Segments of one side, their fraction of the body's mass and where on them its centre lies (de Leva 1996, table 4, men)."""

TRUNK_MASSES = ((0.1117, 0.106), (0.1633, 0.497), (0.1596, 0.904))
"""Lower, middle and upper part of the trunk: mass, and place from the middle of the hips along the spine (de Leva 1996)."""

HEAD_MASS, HEAD_ALONG = 0.0694, 0.45
"""The head with the neck, between the head's joint and its top (de Leva 1996)."""


@dataclass(frozen=True)
class Anatomy:
    """A skeleton's proportions."""

    skeleton: Skeleton

    def offset(self, name: str) -> np.ndarray:
        """A joint in its parent's rest frame [m], (3,)."""
        return self.skeleton.offsets[INDEX[name]]

    @cached_property
    def leg_m(self) -> float:
        """Hip to ankle."""
        return self.skeleton.leg_m

    @cached_property
    def stature_m(self) -> float:
        """Estimated from the legs; leg over stature of the adult template."""
        return self.leg_m / 0.49

    @cached_property
    def sole_m(self) -> float:
        """Height of the ball's joint over the floor."""
        return SOLE * self.stature_m

    @cached_property
    def ankle_m(self) -> float:
        """Height of the ankle over the floor in standing."""
        return self.sole_m - 0.5 * float(self.offset("left_foot")[2] + self.offset("right_foot")[2])

    @cached_property
    def standing_m(self) -> float:
        """Height of the middle of the hips in quiet standing, knees not locked: 6 degrees bent."""
        return self.ankle_m + 0.9975 * self.leg_m

    @cached_property
    def arm_m(self) -> float:
        """Shoulder to wrist."""
        return 0.5 * sum(
            self.skeleton.bone_m(f"{side}_{joint}") for side in ("left", "right") for joint in ("elbow", "wrist")
        )

    @cached_property
    def hand_m(self) -> float:
        """Wrist to the hand's end."""
        return self.skeleton.bone_m("left_hand")

    @cached_property
    def foot_m(self) -> float:
        """Ankle to ball, level."""
        return float(self.offset("left_foot")[0])

    @cached_property
    def hips_m(self) -> float:
        """Half the distance between the hips."""
        return 0.5 * float(self.offset("left_hip")[1] - self.offset("right_hip")[1])

    @cached_property
    def shoulders_m(self) -> float:
        """Half the distance between the shoulders."""
        across = [self.offset(f"{side}_{joint}")[1] for side in ("left", "right") for joint in ("collar", "shoulder")]
        return 0.5 * float(across[0] + across[1] - across[2] - across[3])

    @cached_property
    def trunk_m(self) -> float:
        """Middle of the hips to the shoulders."""
        chain = sum(self.skeleton.bone_m(name) for name in ("spine1", "spine2", "spine3"))
        return chain + float(self.offset("left_collar")[2]) - float(self.middle[2])

    @cached_property
    def middle(self) -> np.ndarray:
        """Middle of the hips in the pelvis's frame [m], (3,)."""
        return 0.5 * (self.offset("left_hip") + self.offset("right_hip"))

    @cached_property
    def seat_m(self) -> float:
        """Hips' joints over the seat that one sits on."""
        return 0.052 * self.stature_m

    @cached_property
    def back_m(self) -> float:
        """Hips' joints over the floor of one who lies on the back."""
        return 0.054 * self.stature_m

    @cached_property
    def tilt_rad(self) -> float:
        """Forward pitch of the pelvis's frame in neutral standing: hips lie below its joint, wherever the file's axis points."""
        drop = float(np.hypot(self.middle[0], self.middle[2]))
        known = float(np.clip(drop / 0.05 - 0.4, 0.0, 1.0))
        return known * float(np.arctan2(self.middle[0], -self.middle[2]))

    @cached_property
    def mass_weights(self) -> np.ndarray:
        """Weights (28,) of the joints' positions whose sum is the centre of mass."""
        weights = np.zeros(len(NAMES))

        def put(first: str, second: str, mass: float, along: float) -> None:
            weights[INDEX[first]] += mass * (1 - along)
            weights[INDEX[second]] += mass * along

        for side in ("left", "right"):
            for upper, lower, mass, along in LIMB_MASSES:
                put(f"{side}_{upper}", f"{side}_{lower}", mass, along)
        put("head", "head_top", HEAD_MASS, HEAD_ALONG)
        chain = ("hips", LOWER_BACK, "spine1", "spine2", "spine3", "neck")
        steps = [float(np.linalg.norm(self.middle)), *(self.skeleton.bone_m(name) for name in chain[2:])]
        reached = np.cumsum([0.0, *steps]) / sum(steps)
        for mass, along in TRUNK_MASSES:
            below = min(int(np.searchsorted(reached, along, side="right")) - 1, len(chain) - 2)
            part = (along - reached[below]) / max(reached[below + 1] - reached[below], 1e-9)
            for name, fraction in ((chain[below], 1 - part), (chain[below + 1], part)):
                for joint in ("left_hip", "right_hip") if name == "hips" else (name,):
                    weights[INDEX[joint]] += mass * fraction * (0.5 if name == "hips" else 1.0)
        return weights / weights.sum()
