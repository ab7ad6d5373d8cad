"""`carry`: a person who carries things; the arms that hold them are posed, and each thing is rigid in the frame of one joint.

Where a thing goes is found first, its frame at every instant, x forward, y left and z up; then the arms reach for its grips.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np

from t2d_rt.core.checks import array, names_advice, shown, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import norms, unit
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import SIDES, Limb, contacts, reach, runs, soles
from t2d_rt.motion.generate.made.hands import Anatomy
from t2d_rt.motion.interpolate import low_pass, minimum_jerk
from t2d_rt.motion.kinematics import INDEX, LOWER_BACK, Poses, facing, motion_of, poses_of, stature_m
from t2d_rt.types.material import Material, checked_material
from t2d_rt.types.motion import HANDLE_M, RIM_M, WHEEL_M, Carried, Motion, checked_motion

X, Y, Z = np.eye(3)
SIGN = {"left": 1.0, "right": -1.0}
OTHER = {"left": "right", "right": "left"}

GRIP = 0.045
"""From the wrist to the middle of the grip, over stature: half of the hand's bone, which ends at 0.09."""
PALM_M = 0.02
"""From the hand's bone to what its palm lies against [m]."""
HEADING_HZ = 0.5
"""Cut-off of the direction that a person walks in: the pelvis turns to and fro once a stride."""
SHORT_M = 0.01
"""How far a hand may stay from its grip [m]."""
SUNK_M = 0.02
"""How far the bottom of a thing may be below the floor [m]."""
FLOOR_M = 0.1
"""Greatest height of the lowest sole of a person who stands on the floor at z = 0 [m]."""

STRAIGHT = 0.985, 0.998
"""Length of an arm over that of its bones up to which a cane's tip stays on the floor, and at most."""
OWN_SWING = 0.4
"""Part of the swing of a free arm that one keeps which holds a bag or a cane."""
BAG_BEND_RAD, CANE_BEND_RAD = 0.15, 0.6
"""Bend of the elbow that carries a bag, and of one that leans on an upright cane, to which the cane is fitted; the arm straightens
as the cane leans."""
CANE_AHEAD = 0.04
"""How far ahead of the middle of the other foot a cane stands, over stature."""
CANE_LIFT_M = 0.04
"""Height of a cane's tip over the floor in the middle of its swing [m]."""
SWING_S = 0.3
"""Shortest time between two places of a cane's tip [s]."""

SIZES_M: Mapping[str, tuple[str, tuple[float, ...]]] = {
    "bag": ("length, width and height, below a handle of 12 cm", (0.35, 0.12, 0.30)),
    "ball": ("radius", (0.11,)),
    "box": ("length, width and height", (0.30, 0.40, 0.30)),
    "backpack": ("length, width and height", (0.18, 0.30, 0.45)),
    "cane": ("diameter, and length if it is not fitted to the arm", (0.019,)),
    "crutch": ("diameter, and length below the grip if it is not fitted to the arm", (0.022,)),
    "walker": ("width, and height if it is not fitted to the arms", (0.56,)),
    "wheelchair": ("width and height of the seat", (0.62, 0.50)),
}
"""Dimensions of things: their meaning, and what they are by default [m]."""
MATERIALS = {"bag": "fabric", "ball": "plastic", "box": "wood", "backpack": "fabric"} | dict.fromkeys(
    ("cane", "crutch", "walker", "wheelchair"), "metal"
)
"""What things are made of by default."""
SAYING = re.compile(r"(?:an? )?(\w+)(?: in (?:the|a|his|her|their) (left|right) hand)?")


@dataclass(frozen=True, slots=True)
class Wish:
    """A thing as it is asked for."""

    thing: str
    side: str | None
    """Of the hand that carries it; None where any does."""
    size_m: tuple[float, ...]
    material: str | Material

    @classmethod
    def of(cls, entry: Any) -> Wish:
        """From a text such as "bag in the left hand", or from a mapping {thing: bag, hand: left, size_m: [...], material: ...}."""
        fields: dict[str, Any] = dict(entry) if isinstance(entry, Mapping) else {}
        if isinstance(entry, str):
            found = SAYING.fullmatch(entry.strip())
            if found is None:
                raise InputError(f'a thing is written as "bag" or "bag in the left hand", got {shown(entry)}')
            fields = {"thing": found[1]} | ({"hand": found[2]} if found[2] else {})
        elif not isinstance(entry, Mapping) or "thing" not in fields:
            raise InputError(
                f'a thing is a text as "bag in the left hand" or a mapping as {{thing: bag}}, got {shown(entry)}'
            )
        for name in fields:
            if name not in (known := ("thing", "hand", "size_m", "material")):
                raise InputError(f"unknown field {shown(name)} of a thing; {names_advice(name, known)}")
        thing, side = fields["thing"], fields.get("hand")
        if not isinstance(thing, str) or thing not in SIZES_M:
            raise unknown_name("thing", thing, [*SIZES_M, *PAIRS])
        if side is not None and (side not in SIDES or thing not in ONE_HANDED):
            hands = "left or right" if thing in ONE_HANDED else "left out, as no single hand carries it"
            raise InputError(f"hand of a {thing} must be {hands}, got {shown(side)}")
        meaning, default = SIZES_M[thing]
        sizes = array("size_m", fields.get("size_m", default), hint=f"of a {thing} {meaning} [m]")
        most = len(default) + (thing in FITTED)
        if sizes.ndim != 1 or not len(default) <= len(sizes) <= most or not ((sizes >= 0.005) & (sizes <= 3)).all():
            raise InputError(f"size_m of a {thing} is {meaning}, 0.005 to 3 m each, got {shown(fields['size_m'])}")
        material = checked_material(fields.get("material", MATERIALS[thing]))
        return cls(thing, side, tuple(sizes.tolist()), material)


@dataclass(frozen=True, slots=True)
class Person:
    """Who carries: positions (T, 3) [m] by joint, and directions."""

    poses: Poses
    points: dict[str, np.ndarray]
    stature_m: float
    heading: np.ndarray
    """Level direction of walking, quaternions (T, 4)."""
    chest: np.ndarray
    """Orientation of the upper spine, (T, 4), rigid in the motion's own."""

    @classmethod
    def of(cls, motion: Motion) -> Person:
        """The person of a motion."""
        points, poses = {name: motion.joints[:, k] for k, name in enumerate(motion.names)}, poses_of(motion)
        ahead = facing(points)
        angle = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        slow = low_pass(angle[:, None], HEADING_HZ, motion.rate_hz)[:, 0]
        own, seen = motion.rotations[:, motion.index("spine3")], poses.world()[1][:, INDEX["spine3"]]
        chest = quaternions.calibrated(own, seen)
        return cls(poses, points, stature_m(points), quaternions.about_axis(Z, slow), chest)

    def ahead(self, vector: Sequence[float] | np.ndarray) -> np.ndarray:
        """A direction (3,) of the heading's frame at every instant, (T, 3)."""
        return quaternions.rotate(self.heading, np.asarray(vector, float))

    def arm_m(self, side: str) -> tuple[float, float]:
        """Lengths of upper arm and forearm [m]."""
        return self.poses.skeleton.bone_m(f"{side}_elbow"), self.poses.skeleton.bone_m(f"{side}_wrist")

    def hanging(self, side: str, bend_rad: float, out: float) -> np.ndarray:
        """Wrist (T, 3) [m] of an arm that hangs, its elbow bent, and swings by `OWN_SWING` of what it did."""
        first, second = self.arm_m(side)
        shoulder = self.points[f"{side}_shoulder"]
        swing = unit(self.points[f"{side}_wrist"] - shoulder)
        down = unit(self.ahead([0.05, SIGN[side] * out, -1.0]))
        length = np.sqrt(first**2 + second**2 + 2 * first * second * np.cos(bend_rad))
        return shoulder + length * unit((1 - OWN_SWING) * down + OWN_SWING * swing)


@dataclass(frozen=True, slots=True)
class Grip:
    """Where a hand holds a thing, in the thing's frame."""

    at: np.ndarray
    """Middle of the grip [m], (3,)."""
    axes: np.ndarray
    """The hand's orientation, (4,): fingers along y of a left and -y of a right one, back of the hand towards z."""
    elbow: tuple[float, float, float]
    """Where the elbow points: ahead, out to its own side and up, in the heading's frame."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a thing is."""

    origin: np.ndarray
    """Its origin [m], (T, 3)."""
    axes: np.ndarray
    """Its orientation, (T, 4)."""
    joint: str
    """Joint that it is rigid with, once the arms are posed."""
    size_m: tuple[float, ...]
    grips: Mapping[str, Grip]
    """By the side of the hand."""
    below_m: float
    """How far it reaches below its origin [m]."""


def _hanging_hand(side: str, raised_rad: float = 0.0) -> np.ndarray:
    """Orientation (4,) of a hand whose back faces out and whose fingers point down, or forward by an angle."""
    down = quaternions.about_axis(X, np.array(-SIGN[side] * np.pi / 2))
    return quaternions.multiply(quaternions.about_axis(Y, np.array(-raised_rad)), down)


def _bag(person: Person, wish: Wish, side: str) -> Place:
    """A bag that hangs upright from the hand of an arm that is nearly straight, clear of the leg."""
    wrist = person.hanging(side, BAG_BEND_RAD, 0.08 + wish.size_m[1] / 2)
    origin = wrist - GRIP * person.stature_m * Z
    grip = Grip(np.zeros(3), _hanging_hand(side), (-1.0, 0.25, 0.0))
    return Place(origin, person.heading, f"{side}_wrist", wish.size_m, {side: grip}, HANDLE_M + wish.size_m[2])


def _ball(person: Person, wish: Wish, side: str) -> Place:
    """A ball on the palm of an arm that moves as it did."""
    joints, turned = person.poses.world()
    wrist = INDEX[f"{side}_wrist"]
    palm = np.array([0.0, SIGN[side] * GRIP * person.stature_m, -PALM_M - wish.size_m[0]])
    origin = joints[:, wrist] + quaternions.rotate(turned[:, wrist], palm)
    return Place(origin, turned[:, wrist], f"{side}_wrist", wish.size_m, {}, wish.size_m[0])


def _box(person: Person, wish: Wish, _: str) -> Place:
    """A box before the trunk, held at its sides by both hands, with bent elbows; it moves with the chest."""
    length, width, height = wish.size_m
    tall = person.stature_m
    local = np.array([BELLY * tall + length / 2, 0.0, -0.14 * tall])
    origin = person.points["spine3"] + quaternions.rotate(person.chest, local)
    grips = {}
    for side in SIDES:
        # Fingers forward, the thumb up, the back of the hand out.
        axes = _hanging_hand(side, np.pi / 2)
        at = np.array([min(0.0, BOX_GRIP * tall - local[0]), SIGN[side] * (width / 2 + PALM_M), -0.2 * height])
        grips[side] = Grip(at, axes, (-0.4, 0.5, -0.8))
    return Place(origin, person.chest, "spine3", wish.size_m, grips, height / 2)


def _backpack(person: Person, wish: Wish, _: str) -> Place:
    """A backpack that lies against the back."""
    tall = person.stature_m
    local = np.array([-BACK * tall - wish.size_m[0] / 2, 0.0, -0.06 * tall])
    origin = person.points["spine3"] + quaternions.rotate(person.chest, local)
    return Place(origin, person.chest, "spine3", wish.size_m, {}, wish.size_m[2] / 2)


BOX_GRIP, BELLY, BACK = 0.13, 0.105, 0.085
"""From the axis of the upper spine to the grips of a box, to the box and to what lies against the back, over stature: fronts of the
templates' trunks lie 0.06 to 0.10 of it ahead."""


def _cane(person: Person, wish: Wish, side: str) -> Place:
    """A cane whose tip stands while the foot of the other side does, as long as the arm reaches it."""
    hand = _hanging_hand(side, np.pi / 4)
    grip_m = GRIP * person.stature_m
    along = quaternions.rotate(hand, SIGN[side] * grip_m * Y)
    wish_at = person.hanging(side, CANE_BEND_RAD, 0.12) + person.ahead(along)
    length = wish.size_m[1] if len(wish.size_m) > 1 else float(np.median(wish_at[:, 2]))
    shoulder, arm_m = person.points[f"{side}_shoulder"], sum(person.arm_m(side))

    def held(tip: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Grip (T, 3), axes (T, 4) and whether the arm reaches (T,), for places of the tip (T, 3), which else rises."""
        up = unit(wish_at - tip)
        axes = quaternions.multiply(quaternions.between(np.broadcast_to(Z, up.shape), up), person.heading)
        hand_at = quaternions.rotate(axes, along)
        span = tip + length * up - hand_at - shoulder
        far = norms(span) / arm_m - STRAIGHT[0]
        room = STRAIGHT[1] - STRAIGHT[0]
        kept = STRAIGHT[0] + np.where(far > 0, room * np.tanh(far / room), far)  # two derivatives go on
        return shoulder + arm_m * kept[:, None] * unit(span) + hand_at, axes, far <= 0

    origin, axes, _ = held(_stepping(person, side, wish_at, held))
    grip = Grip(np.zeros(3), hand, (-1.0, 0.3, 0.0))
    return Place(origin, axes, f"{side}_wrist", (wish.size_m[0], length), {side: grip}, 0.0)


def _stepping(
    person: Person,
    side: str,
    wish_at: np.ndarray,
    held: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> np.ndarray:
    """Track (T, 3) [m] of a cane's tip on the floor and between its places."""
    poses, foot = person.poses, SIDES.index(OTHER[side])
    middle, ahead = soles(poses)[:, foot].mean(axis=1), person.ahead(X)
    level = np.array([1.0, 1.0, 0.0])
    stands = []
    for start, stop in runs(np.asarray(contacts(poses)[:, foot].any(axis=1))):
        frame = (start + stop) // 2
        hand = wish_at[frame]
        place = (hand + ((middle[frame] - hand) @ ahead[frame] + CANE_AHEAD * person.stature_m) * ahead[frame]) * level
        fits = held(np.broadcast_to(place, wish_at.shape))[2][start:stop]
        longest = max(runs(fits), key=lambda each: each[1] - each[0], default=None)
        if longest is not None:
            stands.append((start + longest[0], start + longest[1] - 1, place))
    last = len(wish_at) - 1
    if not stands or stands[0][0] > 0:
        stands.insert(0, (0, 0, wish_at[0] * level))
    if stands[-1][1] < last:
        stands.append((last, last, wish_at[last] * level))
    track, frames = np.empty_like(wish_at), np.arange(len(wish_at))
    track[:] = stands[0][2]
    for (first, left, here), (comes, until, there) in pairwise(stands):
        missing = max(0, round(SWING_S * poses.rate_hz) - (comes - left))
        begin, end = max(first, left - missing // 2), min(until, comes + (missing + 1) // 2)
        x = np.clip((frames[begin:] - begin) / max(end - begin, 1), 0.0, 1.0)
        swings = here + minimum_jerk(x)[:, None] * (there - here)
        track[begin:] = swings + 64 * CANE_LIFT_M * (x * (1 - x))[:, None] ** 3 * Z
    return track


def _path(person: Person) -> np.ndarray:
    """Where what rolls on the floor is, below the pelvis, (T, 3) [m]: the pelvis's way without its sway."""
    return low_pass(person.points["pelvis"], HEADING_HZ, person.poses.rate_hz) * [1.0, 1.0, 0.0]


def _walker(person: Person, wish: Wish, _: str) -> Place:
    """A walking frame with wheels that is pushed at even speed, by both hands."""
    tall, path = person.stature_m, _path(person)
    shoulder = 0.5 * (person.points["left_shoulder"] + person.points["right_shoulder"])
    ahead_m = WALKER_AHEAD * tall + float(np.median(((shoulder - path) * person.ahead(X)).sum(axis=1)))
    origin = path + person.ahead([ahead_m, 0.0, 0.0])
    out_m, low_m, hands = wish.size_m[0] / 2 - WALKER_GRIP_M, [], {}
    for side in SIDES:
        hands[side] = _hanging_hand(side, np.pi / 3)
        wrist = -GRIP * tall * quaternions.rotate(hands[side], SIGN[side] * Y)  # from the grip
        span = person.points[f"{side}_shoulder"] - origin - person.ahead(wrist + [0.0, SIGN[side] * out_m, 0.0])
        level2 = (span[:, :2] ** 2).sum(axis=1)
        low_m.append(span[:, 2] - np.sqrt(np.maximum((STRAIGHT[0] * sum(person.arm_m(side))) ** 2 - level2, 0.0)))
    height_m = wish.size_m[1] if len(wish.size_m) > 1 else float(np.max(low_m))
    grips = {
        side: Grip(np.array([0.0, SIGN[side] * out_m, height_m]), hands[side], (-1.0, 0.4, -0.3)) for side in SIDES
    }
    return Place(origin, person.heading, "right_wrist", (wish.size_m[0], height_m), grips, 0.0)


WALKER_AHEAD, WALKER_GRIP_M = 0.09, 0.05
"""Grips before the shoulders, over stature, and within the frame's outer width [m]; they are as low as the arms always reach."""


def _wheelchair(person: Person, wish: Wish, _: str) -> Place:
    """A wheelchair on whose seat the person sits (`_seated`)."""
    hips = 0.5 * (person.points["left_hip"] + person.points["right_hip"])
    return Place(hips * [1.0, 1.0, 0.0], person.heading, "pelvis", wish.size_m, {}, 0.0)


def _seated(motion: Motion, person: Person, wish: Wish) -> Motion:
    """The person in a wheelchair that goes the way of the motion; feet on the footrest, hands that push the rims and come back."""
    poses, anatomy = person.poses, Anatomy(person.poses.skeleton)
    path, heading = _path(person), person.heading
    hips = path + (wish.size_m[1] + anatomy.seat_m) * Z
    tilt = quaternions.about_axis(Y, np.array(anatomy.tilt_rad))
    pelvis, still = quaternions.multiply(heading, tilt), np.broadcast_to([0.0, 0.0, 0.0, 1.0], poses.local.shape)
    local = quaternions.blend(still, poses.local, np.array(SEATED_TRUNK))
    local[:, 0], local[:, INDEX[LOWER_BACK]] = pelvis, quaternions.conjugate(tilt)  # the spine goes on upright
    poses = replace(poses, root=hips - quaternions.rotate(pelvis, anatomy.middle), local=local)
    rolled = np.concatenate([[0.0], np.cumsum((np.diff(path, axis=0) * person.ahead(X)[1:]).sum(axis=1))]) / WHEEL_M
    angle = pushing(rolled)
    for side in SIDES:
        sign = SIGN[side]
        thigh, shank = anatomy.bones_m(side, "knee", "ankle")
        ankle = np.array([thigh + 0.05, sign * anatomy.hips_m, -0.97 * shank])
        poses, _ = reach(
            poses, cast(Limb, f"{side}_leg"), hips + person.ahead(ankle), pole=person.ahead([1.0, 0.0, 1.0])
        )
        rim = np.stack(
            [RIM_M * np.sin(angle), 0 * angle + sign * wish.size_m[0] / 2, RIM_M * np.cos(angle) + WHEEL_M], axis=1
        )
        fingers = quaternions.rotate(heading, quaternions.rotate(_hanging_hand(side, np.pi / 6), sign * Y))
        wrist = path + quaternions.rotate(heading, rim) - GRIP * person.stature_m * fingers
        limb = cast(Limb, f"{side}_arm")
        poses, _ = reach(poses, limb, wrist, pole=person.ahead([-1.0, 0.5 * sign, 0.0]))
        axes = quaternions.multiply(heading, _hanging_hand(side, np.pi / 6))
        above = poses.world()[1][:, INDEX[f"{side}_elbow"]]
        local = poses.local.copy()
        local[:, INDEX[f"{side}_wrist"]] = quaternions.multiply(quaternions.conjugate(above), axes)
        poses = replace(poses, local=quaternions.continuous(local))
    found = motion_of(poses)
    same = {name: getattr(found, name) for name in ("joints", "rotations", "names", "parents")}
    return replace(motion, **same)


SEATED_TRUNK = 0.15
"""Part of the trunk's movement in the gait that is left of it in a wheelchair."""
PUSH_RAD, CYCLE_RAD, PUSH_FROM_RAD = 1.3, 2.9, -0.45
"""Angles by which a wheel rolls in a push and from one push to the next, and where the hand grasps the rim, from its top forward:
at 1 m/s pushes of 0.4 s, 1.1 a second."""


def pushing(rolled_rad: np.ndarray) -> np.ndarray:
    """Angle (T,) on the rim, from its top forward, of a hand that pushes a wheel which has rolled by (T,) [rad].

    In a push it moves with the rim; back it goes by the quintic that keeps speed and acceleration at both ends.
    """
    phase = np.mod(rolled_rad, CYCLE_RAD)
    back = CYCLE_RAD - PUSH_RAD
    x = np.clip((phase - PUSH_RAD) / back, 0.0, 1.0)
    # From PUSH_RAD, slope 1, to 0, slope 1: the straight line PUSH_RAD + back x, less what leads to 0.
    returning = PUSH_RAD + back * x - CYCLE_RAD * minimum_jerk(x)
    return PUSH_FROM_RAD + np.where(phase < PUSH_RAD, phase, returning)


ONE_HANDED: Mapping[str, Callable[[Person, Wish, str], Place]] = {
    "bag": _bag, "ball": _ball, "cane": _cane, "crutch": _cane,
}  # fmt: skip
PLACES = {**ONE_HANDED, "box": _box, "backpack": _backpack, "walker": _walker, "wheelchair": _wheelchair}
HANDS_OF = {"box": 2, "backpack": 0, "walker": 2, "wheelchair": 2}
FITTED = "cane", "crutch", "walker"
"""Things whose last dimension is fitted to the person unless it is given."""


def carry(motion: Motion, things: str | Mapping[str, Any] | Sequence[str | Mapping[str, Any]]) -> Motion:
    """The motion of a person who carries things; the arms that hold them are posed anew, and of who sits in a wheelchair all.

    things: what is carried, one or a list: "bag", "ball", "box", "backpack", "cane", "crutch", "crutches", "walker", "wheelchair".
        A bag, a ball, a cane and a crutch may be "in the left hand" or "in the right hand", by default in the right one if it is
        free; or mappings such as {thing: box, size_m: [0.3, 0.4, 0.3], material: metal}, with `hand`, `size_m` and `material` as
        far as they differ. `SIZES_M` tells what sizes mean.

    A bag hangs from an arm that is nearly straight and swings less, a box is held before the chest with both hands and moves with
    it, a ball lies in a hand that moves as it did, and the tip of a cane or a crutch stands on the floor while the foot of the
    other side does. A walker is pushed before the person at even speed. Who has a wheelchair sits in it, goes the way of the motion
    and pushes the rims of its wheels.
    Later edits take the things along. The floor is z = 0.
    """
    checked_motion(motion)
    listed = [things] if isinstance(things, (str, Mapping)) else things
    if not isinstance(listed, (list, tuple)):
        raise InputError(f'things must be a text such as "bag", a mapping or a list of them, got {shown(things)}')
    if motion.carries and listed:
        raise InputError(f"the person carries a {motion.carries[0].thing} already; give all things to carry at once")
    wishes = [wish for each in listed for wish in _wishes(each)]
    if not wishes:
        return motion
    person, sides = Person.of(motion), _sides(wishes)
    lowest_m = float(soles(person.poses)[..., 2].min())
    if abs(lowest_m) > FLOOR_M:
        raise InputError(
            f"things stand on a floor at z = 0, and the lowest sole is at {lowest_m:.3g} m; move the motion there"
        )
    for wish in wishes:
        if wish.thing == "wheelchair":
            motion = _seated(motion, person, wish)
            person = Person.of(motion)
    places = [PLACES[wish.thing](person, wish, side) for wish, side in zip(wishes, sides, strict=True)]
    for wish, place in zip(wishes, places, strict=True):
        lowest = place.origin[:, 2] - place.below_m
        if lowest.min() < -SUNK_M:
            raise InputError(
                f"the {wish.thing} would be {-lowest.min():.2g} m below the floor at {lowest.argmin() / motion.rate_hz:.3g} s; "
                "carry it in a motion that stays on its feet, or a smaller one"
            )
    grips = {side: (place, grip) for place in places for side, grip in place.grips.items()}
    posed = _holding(motion, person, grips)
    found = tuple(_attached(posed, wish, place) for wish, place in zip(wishes, places, strict=True))
    return replace(posed, carries=found).edited(f"carries {', '.join(wish.thing for wish in wishes)}")


PAIRS = {"crutches": "crutch"}
"""Things that come by two, one for each hand."""


def _wishes(entry: Any) -> list[Wish]:
    """The thing of an entry, or the two of a pair."""
    fields = entry if isinstance(entry, Mapping) else {"thing": entry}
    thing = fields.get("thing")
    if not isinstance(thing, str) or thing not in PAIRS:
        return [Wish.of(entry)]
    return [Wish.of({"hand": side, **fields, "thing": PAIRS[thing]}) for side in SIDES]


def _sides(wishes: Sequence[Wish]) -> list[str]:
    """The hand of each thing, "" of one that needs none or both."""
    free, found = ["right", "left"], []
    for wish in sorted(wishes, key=lambda each: each.side is None):  # those that are told first
        hands = HANDS_OF.get(wish.thing, 1)
        side = "" if hands != 1 else wish.side or next(iter(free), "")
        taken = free[:hands] if hands != 1 else [side]
        if len(taken) < hands or not set(taken) <= set(free):
            full = f"the {wish.side} hand is" if wish.side else "the hands are"
            raise InputError(
                f"{full} full, so that a {wish.thing} cannot be carried as well; leave a thing out, or name other hands"
            )
        free = [each for each in free if each not in taken]
        found.append((wish, side))
    return [next(side for other, side in found if other is wish) for wish in wishes]


def _holding(motion: Motion, person: Person, grips: Mapping[str, tuple[Place, Grip]]) -> Motion:
    """The motion with arms that hold grips."""
    joints, rotations, poses = motion.joints.copy(), motion.rotations.copy(), person.poses
    before, turned = poses.world()
    for side, (place, grip) in grips.items():
        shoulder, elbow, wrist = (INDEX[f"{side}_{name}"] for name in ("shoulder", "elbow", "wrist"))
        axes = quaternions.multiply(place.axes, grip.axes)
        fingers = quaternions.rotate(axes, SIGN[side] * Y)
        target = place.origin + quaternions.rotate(place.axes, grip.at) - GRIP * person.stature_m * fingers
        own = person.points[f"{side}_shoulder"]
        pole = person.ahead(np.array(grip.elbow) * [1.0, SIGN[side], 1.0])
        limb = cast(Limb, f"{side}_arm")
        poses, _ = reach(poses, limb, target - own + before[:, shoulder], pole=pole)
        there, now = poses.world()
        for name, joint in ((f"{side}_elbow", elbow), (f"{side}_wrist", wrist)):
            joints[:, motion.index(name)] = own + there[:, joint] - there[:, shoulder]
        for name, joint in ((f"{side}_shoulder", shoulder), (f"{side}_elbow", elbow)):
            carried = quaternions.multiply(now[:, joint], quaternions.conjugate(turned[:, joint]))
            rotations[:, motion.index(name)] = quaternions.multiply(carried, rotations[:, motion.index(name)])
        k = motion.index(f"{side}_wrist")
        rotations[:, k] = axes
        if f"{side}_hand" in motion.names:
            end = motion.index(f"{side}_hand")
            joints[:, end] = joints[:, k] + poses.skeleton.bone_m(f"{side}_hand") * fingers
            rotations[:, end] = rotations[:, k]
    return replace(motion, joints=joints, rotations=quaternions.continuous(quaternions.normalise(rotations)))


def _attached(motion: Motion, wish: Wish, place: Place) -> Carried:
    """The thing in the frame of its joint; refuses one that the hands do not keep hold of."""
    k = motion.index(place.joint)
    back = quaternions.conjugate(motion.rotations[0, k])
    local = quaternions.rotate(back, place.origin[0] - motion.joints[0, k])
    rotation = quaternions.normalise(quaternions.multiply(back, place.axes[0]))
    off_m = norms(motion.joints[:, k] + quaternions.rotate(motion.rotations[:, k], local) - place.origin)
    for side, grip in place.grips.items():
        fingers = SIGN[side] * GRIP * stature_m({n: motion.joints[:, i] for i, n in enumerate(motion.names)}) * Y
        at = place.origin + quaternions.rotate(place.axes, grip.at)
        hand = motion.joints[:, motion.index(f"{side}_wrist")]
        hand = hand + quaternions.rotate(quaternions.multiply(place.axes, grip.axes), fingers)
        off_m = np.maximum(off_m, norms(hand - at))
    if off_m.max() > SHORT_M:
        raise InputError(
            f"the arms do not reach the {wish.thing} at {off_m.argmax() / motion.rate_hz:.3g} s, by {off_m.max():.2g} m; give "
            "another size_m, or a calmer motion"
        )
    return Carried(
        thing=wish.thing, joint=place.joint, position_m=tuple(local.tolist()), rotation=tuple(rotation.tolist()),
        size_m=place.size_m, material=wish.material,
    )  # fmt: skip
