"""Where hands go: each goal is a point and an elbow's direction, found from the rest of the body at every instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.generate.made.anatomy import Anatomy


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
