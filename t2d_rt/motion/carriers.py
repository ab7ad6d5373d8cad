"""Values that `carry` and `wheelchair` share: the things that are asked for, the person who carries them, and their places."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, names_advice, shown, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import unit
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import SIDES
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.kinematics import INDEX, Poses, facing, poses_of, stature_m
from t2d_rt.types.material import Material, checked_material
from t2d_rt.types.motion import Motion

X, Y, Z = np.eye(3)
SIGN = {"left": 1.0, "right": -1.0}
OTHER = {"left": "right", "right": "left"}

GRIP = 0.045
"""Distance from the wrist to the middle of the grip, over stature: half of the hand's bone, which is 0.09."""
HEADING_HZ = 0.5
"""Cut-off frequency that smooths the direction of walking: the pelvis turns to and fro once in a stride."""
SHORT_M = 0.01
"""Greatest distance by which a hand may miss its grip, a foot its footrest and a thing its place [m]."""
HANGS_AHEAD = 0.05
"""How far ahead of the shoulder the wrist of a hanging arm is, over how far below the shoulder it is."""
OWN_SWING = 0.4
"""Part of its swing that an arm keeps while it holds a bag or a cane."""

SIZES_M: Mapping[str, tuple[str, tuple[float, ...]]] = {
    "bag": ("length, width and height, below a handle of 12 cm", (0.35, 0.12, 0.30)),
    "ball": ("radius", (0.11,)),
    "box": ("length, width and height", (0.30, 0.40, 0.30)),
    "backpack": ("length, width and height", (0.18, 0.30, 0.45)),
    "cane": ("diameter, and length if it is not fitted to the arm", (0.019,)),
    "crutch": ("diameter, and length below the grip if it is not fitted to the arm", (0.022,)),
    "walker": ("width, and height if it is not fitted to the arms", (0.56,)),
    "wheelchair": ("width, and height of the seat if it is not fitted to the arms", (0.62,)),
}
"""The meaning of the dimensions of things, and their defaults [m]."""
RANGES_M: Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "bag": ((0.05, 0.02, 0.05), (0.8, 0.4, 1.0)),
    "ball": ((0.02,), (0.3,)),
    "box": ((0.05, 0.05, 0.05), (1.0, 1.5, 1.0)),
    "backpack": ((0.05, 0.1, 0.1), (0.4, 0.6, 0.9)),
    "cane": ((0.01, 0.3), (0.05, 1.5)),
    "crutch": ((0.01, 0.3), (0.05, 1.5)),
    "walker": ((0.4, 0.4), (0.9, 1.2)),
    "wheelchair": ((0.5, 0.4), (0.8, 0.6)),
}
"""Least and greatest dimensions of things [m], including those that are fitted."""
MATERIALS = {"bag": "fabric", "ball": "plastic", "box": "wood", "backpack": "fabric"} | dict.fromkeys(
    ("cane", "crutch", "walker", "wheelchair"), "metal"
)
"""Default materials of things."""
SAYING = re.compile(r"(?:an? )?(\w+)(?: in (?:the|a|his|her|their) (left|right) hand)?")
ONE_HANDED = "bag", "ball", "cane", "crutch"
FITTED = "cane", "crutch", "walker", "wheelchair"
"""Things whose last dimension is fitted to the person unless it is given."""
PAIRS = {"crutches": "crutch"}
"""Things that come in pairs, one for each hand."""


def fields_of(entry: Any) -> dict[str, Any]:
    """The fields that a text such as "bag in the left hand" or a mapping {thing: bag, hand: left, size_m: [...]} gives."""
    if isinstance(entry, str):
        match = SAYING.fullmatch(entry.strip())
        if match is None:
            raise InputError(f'a thing is written as "bag" or "bag in the left hand", got {shown(entry)}')
        return {"thing": match[1]} | ({"hand": match[2]} if match[2] else {})
    if not isinstance(entry, Mapping) or "thing" not in entry:
        raise InputError(
            f'a thing is a text as "bag in the left hand" or a mapping as {{thing: bag}}, got {shown(entry)}'
        )
    return dict(entry)


@dataclass(frozen=True, slots=True)
class Wish:
    """A thing that a person is asked to carry."""

    thing: str
    side: str | None
    """Side of the hand that carries it; None if that is left open."""
    size_m: tuple[float, ...]
    material: str | Material
    paired: bool = False
    """Whether it is one of a pair, whose two things have the same size."""

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> Wish:
        """The wish that the fields thing, hand, size_m and material describe; raises an InputError if one is wrong."""
        for name in fields:
            if name not in (field_names := ("thing", "hand", "size_m", "material")):
                raise InputError(f"unknown field {shown(name)} of a thing; {names_advice(name, field_names)}")
        thing, side = fields["thing"], fields.get("hand")
        if not isinstance(thing, str) or thing not in SIZES_M:
            raise unknown_name("thing", thing, [*SIZES_M, *PAIRS])
        if side is not None and (side not in SIDES or thing not in ONE_HANDED):
            hands = "left or right" if thing in ONE_HANDED else "left out, as no single hand carries it"
            raise InputError(f"hand of a {thing} must be {hands}, got {shown(side)}")
        meaning, default = SIZES_M[thing]
        sizes = array("size_m", fields.get("size_m", default), hint=f"of a {thing} {meaning} [m]")
        most = len(default) + (thing in FITTED)
        least_m, greatest_m = (np.array(limits_m) for limits_m in RANGES_M[thing])
        count = sizes.size
        if (
            sizes.ndim != 1
            or not len(default) <= count <= most
            or not ((sizes >= least_m[:count]) & (sizes <= greatest_m[:count])).all()
        ):
            ranges = ", ".join(f"{low:g} to {high:g}" for low, high in zip(least_m, greatest_m, strict=True))
            raise InputError(f"size_m of a {thing} is {meaning}, {ranges} m, got {shown(fields['size_m'])}")
        material = checked_material(fields.get("material", MATERIALS[thing]))
        return cls(thing, side, tuple(sizes.tolist()), material)


def wishes_of(entry: Any) -> list[Wish]:
    """The thing that an entry describes, or the two things of a pair; raises an InputError if the entry is wrong."""
    fields = fields_of(entry)
    thing = fields["thing"]
    if not isinstance(thing, str) or thing not in PAIRS:
        return [Wish.of(fields)]
    if "hand" in fields:
        raise InputError(f"hand of {thing} must be left out, as each hand has one, got {shown(fields['hand'])}")
    return [replace(Wish.of({**fields, "hand": side, "thing": PAIRS[thing]}), paired=True) for side in SIDES]


@dataclass(frozen=True, slots=True)
class Person:
    """The person who carries: poses, positions (T, 3) [m] by joint, and directions."""

    poses: Poses
    points: dict[str, np.ndarray]
    stature_m: float
    heading: np.ndarray
    """Level direction that the person faces, smoothed, as quaternions (T, 4); in a wheelchair it is that of the chair."""
    chest: np.ndarray
    """Orientation (T, 4) of the upper spine: that of the motion, turned by one constant rotation to the skeleton's axes."""

    @classmethod
    def of(cls, motion: Motion) -> Person:
        """The person of a motion."""
        points, poses = {name: motion.joints[:, k] for k, name in enumerate(motion.names)}, poses_of(motion)
        ahead = facing(points)
        angle = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        slow = low_pass(angle[:, None], HEADING_HZ, motion.rate_hz)[:, 0]
        rotations, pose_rotations = motion.rotations[:, motion.index("spine3")], poses.world()[1][:, INDEX["spine3"]]
        chest = quaternions.calibrated(rotations, pose_rotations)
        return cls(poses, points, stature_m(points), quaternions.about_axis(Z, slow), chest)

    def ahead(self, vector: Sequence[float] | np.ndarray) -> np.ndarray:
        """A vector (3,) of the heading's frame, turned into the world at every instant: (T, 3)."""
        return quaternions.rotate(self.heading, np.asarray(vector, float))

    def arm_m(self, side: str) -> tuple[float, float]:
        """Lengths of the upper arm and of the forearm [m]."""
        return self.poses.skeleton.bone_m(f"{side}_elbow"), self.poses.skeleton.bone_m(f"{side}_wrist")

    def hanging(self, side: str, bend_rad: float, out_m: float) -> np.ndarray:
        """Positions (T, 3) [m] of the wrist of an arm that hangs with a bent elbow, `out_m` outside the shoulder, and keeps the
        part `OWN_SWING` of its own swing."""
        first, second = self.arm_m(side)
        shoulder = self.points[f"{side}_shoulder"]
        swing = unit(self.points[f"{side}_wrist"] - shoulder)
        length = np.sqrt(first**2 + second**2 + 2 * first * second * np.cos(bend_rad))
        down = unit(self.ahead([HANGS_AHEAD, SIGN[side] * out_m / length, -1.0]))
        return shoulder + length * unit((1 - OWN_SWING) * down + OWN_SWING * swing)


@dataclass(frozen=True, slots=True)
class Grip:
    """The place where a hand holds a thing, in the thing's frame."""

    at: np.ndarray
    """Position (3,) [m] of the middle of the grip."""
    axes: np.ndarray
    """Orientation (4,) of the hand: fingers point along y of a left hand and along -y of a right one, its back faces z."""
    elbow: tuple[float, float, float]
    """Direction in which the elbow points, in the heading's frame: ahead, out to its own side, and up."""


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a thing at every instant."""

    origin: np.ndarray
    """Positions (T, 3) [m] of its origin."""
    axes: np.ndarray
    """Orientations (T, 4) of the thing."""
    joint: str
    """The joint that it moves rigidly with once the arms are posed."""
    size_m: tuple[float, ...]
    grips: Mapping[str, Grip]
    """The grip of each hand that holds it, by side."""
    lowest_m: np.ndarray
    """Heights (T,) [m] of its lowest point over the floor."""


def hanging_hand(side: str, raised_rad: float = 0.0) -> np.ndarray:
    """Orientation (4,) of a hand whose back faces out and whose fingers point down, raised forward from there by an angle."""
    down = quaternions.about_axis(X, np.array(-SIGN[side] * np.pi / 2))
    return quaternions.multiply(quaternions.about_axis(Y, np.array(-raised_rad)), down)


def path_of(person: Person, cutoff_hz: float = HEADING_HZ) -> np.ndarray:
    """Track (T, 3) [m] on the floor of something that rolls: the pelvis's horizontal track, low-passed to remove its sway."""
    return low_pass(person.points["pelvis"], cutoff_hz, person.poses.rate_hz) * [1.0, 1.0, 0.0]
