"""Lengths, masses and posture that key poses need, and where hands go: a point and an elbow's direction at every instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.kinematics import INDEX, LOWER_BACK, NAMES, Skeleton

# --- lengths that key poses need, masses of the segments, and the neutral posture of a skeleton ---


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
    """Lengths that key poses need of a skeleton."""

    skeleton: Skeleton

    def offset(self, name: str) -> np.ndarray:
        """A joint in its parent's rest frame [m], (3,)."""
        return self.skeleton.offsets[INDEX[name]]

    @cached_property
    def leg_m(self) -> float:
        """Length of a leg from hip to ankle [m]."""
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
        """Length of an arm from shoulder to wrist [m]."""
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


# --- where hands go: each goal is a point and an elbow's direction, found from the rest of the body at every instant ---


@dataclass(frozen=True, slots=True)
class Figure:
    """The body as far as it is posed before the arms are: positions (T, 3) [m] and orientations (T, 4) by joint.

    Two more orientations: "heading", the level one of the pelvis, and "hips", that of the pelvis without its file's own tilt.
    """

    anatomy: Anatomy
    points: Mapping[str, np.ndarray]
    turns: Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True)
class Place:
    """A wrist's position (T, 3) [m], directions (T, 3) of the elbow and, where they matter, of fingers and back of the hand."""

    wrist: np.ndarray
    elbow: np.ndarray
    fingers: np.ndarray | None = None
    back: np.ndarray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Somewhere for a hand; subclasses say where."""

    held: bool = False
    """Whether it rests on something and so does not shake."""

    def place(self, figure: Figure, side: str) -> Place:
        """The wrist of one side."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class Hang(Goal):
    """The arm hangs from its shoulder, mostly straight down."""

    forward_rad: float = 0.08
    out_rad: float = 0.13
    bend_rad: float = 0.30
    """Of the elbow."""
    follow: float = 0.3
    """Part of the trunk's lean that the arm takes along."""

    def place(self, figure: Figure, side: str) -> Place:
        """As far below the shoulder as the bent elbow allows."""
        sign = 1.0 if side == "left" else -1.0
        first, second = (figure.anatomy.skeleton.bone_m(f"{side}_{joint}") for joint in ("elbow", "wrist"))
        length = np.sqrt(first**2 + second**2 + 2 * first * second * np.cos(self.bend_rad))
        down = np.array([
            np.sin(self.forward_rad), sign * np.sin(self.out_rad), -np.cos(self.forward_rad) * np.cos(self.out_rad),
        ])  # fmt: skip
        frame = quaternions.blend(figure.turns["heading"], figure.turns["spine3"], np.array(self.follow))
        wrist = figure.points[f"{side}_shoulder"] + length * quaternions.rotate(frame, down / np.linalg.norm(down))
        return Place(wrist, quaternions.rotate(frame, np.array([-1.0, 0.25 * sign, 0.0])))


@dataclass(frozen=True, slots=True, kw_only=True)
class OnBone(Goal):
    """The hand lies on a thigh or a shank."""

    upper: str = "hip"
    lower: str = "knee"
    along: float = 0.7
    """Place on the bone, 0 at its upper end."""
    lift: float = 0.055
    """Wrist over the bone's axis, over stature: half the limb and half the hand."""
    out: float = 0.0
    """To the side, over stature."""
    across: bool = False
    """The other side's leg."""
    held: bool = True

    def place(self, figure: Figure, side: str) -> Place:
        """On the front of the bone."""
        leg = {"left": "right", "right": "left"}[side] if self.across else side
        sign = 1.0 if side == "left" else -1.0
        start, end = figure.points[f"{leg}_{self.upper}"], figure.points[f"{leg}_{self.lower}"]
        turn = figure.turns[f"{leg}_{self.upper}"]
        front, left, down = (quaternions.rotate(turn, axis) for axis in (np.eye(3)[0], np.eye(3)[1], -np.eye(3)[2]))
        tall = figure.anatomy.stature_m
        wrist = start + self.along * (end - start) + tall * (self.lift * front + self.out * sign * left)
        chest = figure.turns["spine3"]
        elbow = quaternions.rotate(chest, np.array([-0.6, 0.75 * sign, -0.25]))
        return Place(wrist, elbow, fingers=down - 0.25 * sign * left - 0.1 * front, back=front)


@dataclass(frozen=True, slots=True, kw_only=True)
class OnChest(Goal):
    """A point that goes with the chest: ahead, out and up from the shoulder's own rest place, in lengths of the arm."""

    ahead: float
    out: float
    up: float
    elbow: tuple[float, float, float] = (-0.5, 0.7, -0.5)
    fingers: tuple[float, float, float] | None = None
    """Ahead, out, up."""
    back: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def place(self, figure: Figure, side: str) -> Place:
        """In the frame of the upper spine."""
        sign = 1.0 if side == "left" else -1.0
        chest, body = figure.turns["spine3"], figure.anatomy
        out = np.array([1.0, sign, 1.0])
        rest = body.offset(f"{side}_collar") + body.offset(f"{side}_shoulder")
        local = rest + body.arm_m * np.array([self.ahead, self.out * sign, self.up])
        wrist = figure.points["spine3"] + quaternions.rotate(chest, local)
        elbow = quaternions.rotate(chest, np.array(self.elbow) * out)
        if self.fingers is None:
            return Place(wrist, elbow)
        return Place(
            wrist, elbow, *(quaternions.rotate(chest, np.array(each) * out) for each in (self.fingers, self.back))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class OnPelvis(Goal):
    """A point that goes with the pelvis: ahead, out and up from its own hip, over stature."""

    ahead: float = 0.02
    out: float = 0.075
    up: float = 0.06
    elbow: tuple[float, float, float] = (-0.7, 0.8, 0.0)
    fingers: tuple[float, float, float] | None = (0.6, -0.5, -0.5)
    back: tuple[float, float, float] = (0.3, 0.9, 0.3)
    held: bool = True

    def place(self, figure: Figure, side: str) -> Place:
        """In the neutral frame of the pelvis."""
        sign = 1.0 if side == "left" else -1.0
        out = np.array([1.0, sign, 1.0])
        frame = figure.turns["hips"]
        local = figure.anatomy.stature_m * np.array([self.ahead, self.out, self.up]) * out
        wrist = figure.points[f"{side}_hip"] + quaternions.rotate(frame, local)
        elbow = quaternions.rotate(frame, np.array(self.elbow) * out)
        if self.fingers is None:
            return Place(wrist, elbow)
        return Place(
            wrist, elbow, *(quaternions.rotate(frame, np.array(each) * out) for each in (self.fingers, self.back))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class InSpace(Goal):
    """A point of the room [m]: floor, seat, armrest, handrail, a thing on the floor."""

    point: tuple[float, float, float]
    elbow: tuple[float, float, float] = (-0.7, 0.6, 0.2)
    """Behind, out and up as the person stands at the start."""
    fingers: tuple[float, float, float] | None = None
    back: tuple[float, float, float] = (0.0, 0.0, 1.0)
    yaw_rad: float = 0.0
    """Heading that elbow and fingers are given in."""
    held: bool = True

    def place(self, figure: Figure, side: str) -> Place:
        """The same at all times."""
        sign = 1.0 if side == "left" else -1.0
        turn = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), np.array(self.yaw_rad))
        count = len(figure.points["pelvis"])

        def constant(vector: tuple[float, float, float]) -> np.ndarray:
            return np.tile(quaternions.rotate(turn, np.array(vector) * [1.0, sign, 1.0]), (count, 1))

        wrist = np.tile(np.array(self.point, dtype=float), (count, 1))
        if self.fingers is None:
            return Place(wrist, constant(self.elbow))
        return Place(wrist, constant(self.elbow), constant(self.fingers), constant(self.back))
