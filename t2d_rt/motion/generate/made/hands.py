"""Lengths, masses and posture that key poses need, and goals of hands: a point and an elbow's direction at every instant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.kinematics import INDEX, LOWER_BACK, NAMES, PARENT_NAMES, Skeleton

# --- lengths that key poses need, masses of the segments, and the neutral posture of a skeleton ---


SOLE = 0.0146
"""Height of the ball's joint over the floor, over stature; of the adult template, 27 mm of 1.84 m."""

LIMB_MASSES: tuple[tuple[str, str, float, float], ...] = (
    ("shoulder", "elbow", 0.0271, 0.577), ("elbow", "wrist", 0.0162, 0.457), ("wrist", "hand", 0.0061, 0.79),
    ("hip", "knee", 0.1416, 0.410), ("knee", "ankle", 0.0433, 0.446), ("ankle", "toe", 0.0137, 0.442),
)  # fmt: skip
"""Segments of one side, their fraction of the body's mass and where on them its centre lies (de Leva 1996, table 4, men)."""

TRUNK_MASSES = ((0.1117, 0.106), (0.1633, 0.497), (0.1596, 0.904))
"""Lower, middle and upper part of the trunk: fraction of the mass, and place along the spine from the hips (de Leva 1996)."""

HEAD_MASS, HEAD_ALONG = 0.0694, 0.45
"""Fraction of the mass of head and neck, and place of its centre between the head's joint and its top (de Leva 1996)."""


SIGN = {"left": 1.0, "right": -1.0}
"""Sign of the y axis, by the side of the body."""

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Anatomy:
    """Lengths that key poses need of a skeleton."""

    skeleton: Skeleton

    def offset(self, name: str) -> np.ndarray:
        """Offset (3,) [m] of a joint in its parent's rest frame."""
        return self.skeleton.offsets[INDEX[name]]

    def bones_m(self, side: str, first: str, second: str) -> tuple[float, float]:
        """Lengths [m] of the two bones of a limb that end at these joints of a side."""
        return self.skeleton.bone_m(f"{side}_{first}"), self.skeleton.bone_m(f"{side}_{second}")

    @cached_property
    def leg_m(self) -> float:
        """Length of a leg from hip to ankle [m]."""
        return self.skeleton.leg_m

    @cached_property
    def stature_m(self) -> float:
        """Stature estimated from the legs [m], by leg over stature of the adult template."""
        return self.leg_m / 0.49

    @cached_property
    def sole_m(self) -> float:
        """Height of the ball's joint over the floor [m]."""
        return SOLE * self.stature_m

    @cached_property
    def ankle_m(self) -> float:
        """Height of the ankle over the floor in standing [m]."""
        return self.sole_m - 0.5 * float(self.offset("left_foot")[2] + self.offset("right_foot")[2])

    @cached_property
    def standing_m(self) -> float:
        """Height of the middle of the hips in quiet standing [m], with knees not locked but bent by 6 degrees."""
        return self.ankle_m + 0.9975 * self.leg_m

    @cached_property
    def arm_m(self) -> float:
        """Length of an arm from shoulder to wrist [m]."""
        return 0.5 * sum(
            self.skeleton.bone_m(f"{side}_{joint}") for side in ("left", "right") for joint in ("elbow", "wrist")
        )

    @cached_property
    def hand_m(self) -> float:
        """Distance from the wrist to the hand's end [m]."""
        return self.skeleton.bone_m("left_hand")

    @cached_property
    def foot_m(self) -> float:
        """Level distance from the ankle to the ball [m]."""
        return float(self.offset("left_foot")[0])

    @cached_property
    def hips_m(self) -> float:
        """Half the distance between the hips [m]."""
        return 0.5 * float(self.offset("left_hip")[1] - self.offset("right_hip")[1])

    @cached_property
    def shoulders_m(self) -> float:
        """Half the distance between the shoulders [m]."""
        across = [self.offset(f"{side}_{joint}")[1] for side in ("left", "right") for joint in ("collar", "shoulder")]
        return 0.5 * float(across[0] + across[1] - across[2] - across[3])

    @cached_property
    def trunk_m(self) -> float:
        """Distance from the middle of the hips to the shoulders [m]."""
        chain = sum(self.skeleton.bone_m(name) for name in ("spine1", "spine2", "spine3"))
        return chain + float(self.offset("left_collar")[2]) - float(self.middle[2])

    @cached_property
    def middle(self) -> np.ndarray:
        """Middle of the hips in the pelvis's frame [m], (3,)."""
        return 0.5 * (self.offset("left_hip") + self.offset("right_hip"))

    @cached_property
    def seat_m(self) -> float:
        """Height of the hips' joints over the seat in sitting [m]."""
        return 0.052 * self.stature_m

    @cached_property
    def back_m(self) -> float:
        """Height of the hips' joints over the floor in lying on the back [m]."""
        return 0.054 * self.stature_m

    @cached_property
    def tilt_rad(self) -> float:
        """Forward pitch of the pelvis's frame in neutral standing: hips lie below its joint, whatever the file's axes are."""
        drop = float(np.hypot(self.middle[0], self.middle[2]))
        certainty = float(np.clip(drop / 0.05 - 0.4, 0.0, 1.0))
        return certainty * float(np.arctan2(self.middle[0], -self.middle[2]))

    @cached_property
    def mass_weights(self) -> np.ndarray:
        """Weights (28,) of the joints' positions whose weighted sum is the centre of mass."""
        weights = np.zeros(len(NAMES))
        bones = [
            (f"{side}_{upper}", f"{side}_{lower}", mass, along)
            for side in ("left", "right")
            for upper, lower, mass, along in LIMB_MASSES
        ]
        for first, second, mass, along in (*bones, ("head", "head_top", HEAD_MASS, HEAD_ALONG)):
            weights[INDEX[first]] += mass * (1 - along)
            weights[INDEX[second]] += mass * along
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


# --- where hands go: each goal is a point and an elbow's direction, found from the rest of the body at every instant ---


@dataclass(frozen=True, slots=True)
class Figure:
    """The body as it is posed before the arms: positions (T, 3) [m] and orientations (T, 4) by joint.

    Two more orientations: "heading", the level one of the pelvis, and "hips", that of the pelvis without its file's own tilt.
    """

    anatomy: Anatomy
    points: dict[str, np.ndarray]
    turns: dict[str, np.ndarray]

    def hang(self, name: str) -> None:
        """Place a joint where its parent's orientation has it."""
        parent = PARENT_NAMES[name]
        turned = quaternions.rotate(self.turns[parent], self.anatomy.offset(name))
        self.points[name] = self.points[parent] + turned


@dataclass(frozen=True, slots=True)
class Hand:
    """A wrist's position (T, 3) [m], directions (T, 3) of the elbow and, where they matter, of fingers and back of the hand."""

    wrist: np.ndarray
    elbow: np.ndarray
    fingers: np.ndarray | None = None
    back: np.ndarray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """A goal of a hand; subclasses say where it is."""

    held: bool = False
    """Whether it rests on something and so does not shake."""

    def place(self, figure: Figure, side: str) -> Hand:
        """The hand of one side at its goal."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class Hang(Goal):
    """The arm hangs from its shoulder, mostly straight down."""

    forward_rad: float = 0.08
    out_rad: float = 0.13
    bend_rad: float = 0.30
    """Flexion of the elbow."""
    follow: float = 0.3
    """Part of the trunk's lean that the arm follows."""

    def place(self, figure: Figure, side: str) -> Hand:
        """The hand as far below the shoulder as the bent elbow allows."""
        sign = SIGN[side]
        first, second = figure.anatomy.bones_m(side, "elbow", "wrist")
        length = np.sqrt(first**2 + second**2 + 2 * first * second * np.cos(self.bend_rad))
        ahead_rad, out_rad = self.forward_rad, self.out_rad
        down = np.array([np.sin(ahead_rad), sign * np.sin(out_rad), -np.cos(ahead_rad) * np.cos(out_rad)])
        frame = quaternions.blend(figure.turns["heading"], figure.turns["spine3"], np.array(self.follow))
        wrist = figure.points[f"{side}_shoulder"] + length * quaternions.rotate(frame, down / np.linalg.norm(down))
        return Hand(wrist, quaternions.rotate(frame, np.array([-1.0, 0.25 * sign, 0.0])))


@dataclass(frozen=True, slots=True, kw_only=True)
class OnBone(Goal):
    """The hand lies on a thigh or a shank."""

    upper: str = "hip"
    lower: str = "knee"
    along: float = 0.7
    """Place on the bone, 0 at its upper end."""
    lift: float = 0.055
    """Height of the wrist over the bone's axis, over stature: half the limb and half the hand."""
    out: float = 0.0
    """Distance of the wrist to the side, over stature."""
    held: bool = True

    def place(self, figure: Figure, side: str) -> Hand:
        """The hand on the front of the bone."""
        sign = SIGN[side]
        start, end = figure.points[f"{side}_{self.upper}"], figure.points[f"{side}_{self.lower}"]
        turn = figure.turns[f"{side}_{self.upper}"]
        front, left, down = (quaternions.rotate(turn, axis) for axis in (np.eye(3)[0], np.eye(3)[1], -np.eye(3)[2]))
        tall = figure.anatomy.stature_m
        wrist = start + self.along * (end - start) + tall * (self.lift * front + self.out * sign * left)
        chest = figure.turns["spine3"]
        elbow = quaternions.rotate(chest, np.array([-0.6, 0.75 * sign, -0.25]))
        return Hand(wrist, elbow, fingers=down - 0.25 * sign * left - 0.1 * front, back=front)


@dataclass(frozen=True, slots=True, kw_only=True)
class AtPoint(Goal):
    """A point and directions in some frame: ahead, out to the hand's own side, and up."""

    at: Triple
    elbow: Triple
    """Direction of the elbow."""
    fingers: Triple | None = None
    """Direction of the fingers; None if they are to continue the forearm."""
    back: Triple = (0.0, 0.0, 1.0)
    """Direction that the back of the hand faces if fingers are given."""

    def wrist(self, figure: Figure, side: str) -> tuple[np.ndarray, np.ndarray]:
        """Orientations (T, 4) of the frame, and positions (T, 3) [m] of the wrist."""
        raise NotImplementedError

    def place(self, figure: Figure, side: str) -> Hand:
        """The hand with its wrist at the point, elbow and fingers turned with the frame."""
        frame, wrist = self.wrist(figure, side)
        mirror = np.array([1.0, SIGN[side], 1.0])
        directions = [self.elbow] if self.fingers is None else [self.elbow, self.fingers, self.back]
        return Hand(wrist, *(quaternions.rotate(frame, np.array(direction) * mirror) for direction in directions))


@dataclass(frozen=True, slots=True, kw_only=True)
class OnChest(AtPoint):
    """A point that moves with the chest, counted from the shoulder's own rest place in lengths of the arm."""

    elbow: Triple = (-0.5, 0.7, -0.5)
    back: Triple = (0.0, 1.0, 0.0)

    def wrist(self, figure: Figure, side: str) -> tuple[np.ndarray, np.ndarray]:
        """The wrist in the frame of the upper spine."""
        chest, body = figure.turns["spine3"], figure.anatomy
        shoulder = body.offset(f"{side}_collar") + body.offset(f"{side}_shoulder")
        ahead, aside, up = self.at
        local = shoulder + body.arm_m * np.array([ahead, aside * SIGN[side], up])
        return chest, figure.points["spine3"] + quaternions.rotate(chest, local)


@dataclass(frozen=True, slots=True, kw_only=True)
class OnPelvis(AtPoint):
    """A point that moves with the pelvis, counted from the hip of its side, over stature; by default the hand is on the hip."""

    at: Triple = (0.02, 0.075, 0.06)
    elbow: Triple = (-0.7, 0.8, 0.0)
    fingers: Triple | None = (0.6, -0.5, -0.5)
    back: Triple = (0.3, 0.9, 0.3)
    held: bool = True

    def wrist(self, figure: Figure, side: str) -> tuple[np.ndarray, np.ndarray]:
        """The wrist in the neutral frame of the pelvis."""
        frame = figure.turns["hips"]
        local = figure.anatomy.stature_m * np.array(self.at) * np.array([1.0, SIGN[side], 1.0])
        return frame, figure.points[f"{side}_hip"] + quaternions.rotate(frame, local)


@dataclass(frozen=True, slots=True, kw_only=True)
class InSpace(AtPoint):
    """The point `at` of the room [m]: floor, seat, armrest, handrail, a thing on the floor."""

    yaw_rad: float = 0.0
    """Heading of the frame in which elbow and fingers are given."""
    held: bool = True

    def wrist(self, figure: Figure, side: str) -> tuple[np.ndarray, np.ndarray]:
        """The wrist at the same place at all times."""
        count = len(figure.points["pelvis"])
        turn = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), np.array(self.yaw_rad))
        return np.broadcast_to(turn, (count, 4)), np.tile(np.array(self.at, dtype=float), (count, 1))
