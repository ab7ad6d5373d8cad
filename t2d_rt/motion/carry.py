"""`carry` makes a person carry things: the arms that hold them are posed, and each thing is rigid in the frame of one joint.

The frame of a thing (x forward, y left, z up) is found first at every instant; then the arms reach for its grips.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import norms, unit
from t2d_rt.motion import quaternions
from t2d_rt.motion.carriers import (
    GRIP,
    OTHER,
    RANGES_M,
    SHORT_M,
    SIGN,
    Grip,
    Person,
    Place,
    Wish,
    X,
    Y,
    Z,
    hanging_hand,
    path_of,
    wishes_of,
)
from t2d_rt.motion.contacts import SIDES, Limb, contacts, reach, runs, soles
from t2d_rt.motion.interpolate import minimum_jerk
from t2d_rt.motion.kinematics import INDEX, stature_m
from t2d_rt.motion.wheelchair import seated, wheelchair
from t2d_rt.types.carried import HANDLE_M, Carried
from t2d_rt.types.motion import Motion, checked_motion

PALM_M = 0.02
"""Distance from the hand's bone to what its palm lies against [m]."""
WALKING_MPS = 2.2
"""Speed above which nobody walks with a cane, crutches or a walking frame [m/s]; people change from walking to running near 2."""
SUNK_M = 0.02
"""How far the bottom of a thing may be below the floor, and the tip of a cane at its lowest above it [m]."""
FLOOR_M = 0.1
"""Greatest distance from z = 0 of the lowest sole of a person who stands on the floor [m]."""

STRAIGHT = 0.985, 0.998
"""Length of an arm, over that of its bones, up to which a cane's tip stays on the floor, and its greatest length."""
BAG_BEND_RAD, CANE_BEND_RAD = 0.15, 0.6
"""Bend of the elbow of an arm that carries a bag, and of one that leans on an upright cane, to which the cane is fitted; the arm
straightens as the cane leans."""
CANE_AHEAD = 0.04
"""Distance of a standing cane ahead of the middle of the other foot, over stature."""
CANE_LIFT_M = 0.04
"""Height of a cane's tip over the floor in the middle of its swing [m]."""
SWING_S = 0.3
"""Shortest time between two places of a cane's tip [s]."""


def _corner_m(origin: np.ndarray, axes: np.ndarray, size_m: tuple[float, ...]) -> np.ndarray:
    """Heights (T,) [m] of the lowest corner of a block that is centred at its origin (T, 3)."""
    return origin[:, 2] - 0.5 * np.abs(quaternions.rotate(axes[:, None], np.diag(size_m))[..., 2]).sum(axis=1)


def _bag(person: Person, wish: Wish, side: str) -> Place:
    """A bag that hangs upright from the hand of an arm that is nearly straight, clear of the leg."""
    wrist = person.hanging(side, BAG_BEND_RAD, BAG_OUT * person.stature_m + BAG_OUT_WIDTHS * wish.size_m[1])
    origin = wrist - GRIP * person.stature_m * Z
    grip = Grip(np.zeros(3), hanging_hand(side), (-1.0, 0.25, 0.0))
    lowest_m = origin[:, 2] - HANDLE_M - wish.size_m[2]
    return Place(origin, person.heading, f"{side}_wrist", wish.size_m, {side: grip}, lowest_m)


def _ball(person: Person, wish: Wish, side: str) -> Place:
    """A ball on the palm of an arm that moves as before."""
    joints, turned = person.poses.world()
    wrist = INDEX[f"{side}_wrist"]
    palm = np.array([0.0, SIGN[side] * GRIP * person.stature_m, -PALM_M - wish.size_m[0]])
    origin = joints[:, wrist] + quaternions.rotate(turned[:, wrist], palm)
    return Place(origin, turned[:, wrist], f"{side}_wrist", wish.size_m, {}, origin[:, 2] - wish.size_m[0])


def _box(person: Person, wish: Wish, _: str) -> Place:
    """A box before the trunk, held at its sides by both hands, with bent elbows; it moves with the chest."""
    length, width, height = wish.size_m
    tall = person.stature_m
    local = np.array([BELLY * tall + length / 2, 0.0, -BOX_LOW * tall])
    origin = person.points["spine3"] + quaternions.rotate(person.chest, local)
    grips = {}
    for side in SIDES:
        # Fingers forward, the thumb up, the back of the hand out.
        axes = hanging_hand(side, np.pi / 2)
        out_m = SIGN[side] * (width / 2 + PALM_M)
        at = np.array([min(0.0, BOX_GRIP * tall - local[0]), out_m, -BOX_GRIP_LOW * height])
        grips[side] = Grip(at, axes, (-0.4, 0.5, -0.8))
    return Place(origin, person.chest, "spine3", wish.size_m, grips, _corner_m(origin, person.chest, wish.size_m))


def _backpack(person: Person, wish: Wish, _: str) -> Place:
    """A backpack that lies against the back."""
    tall = person.stature_m
    local = np.array([-BACK * tall - wish.size_m[0] / 2, 0.0, -BACKPACK_LOW * tall])
    origin = person.points["spine3"] + quaternions.rotate(person.chest, local)
    return Place(origin, person.chest, "spine3", wish.size_m, {}, _corner_m(origin, person.chest, wish.size_m))


BOX_GRIP, BELLY, BACK = 0.13, 0.105, 0.085
"""Distances from the axis of the upper spine to the grips of a box, to the box and to what lies against the back, over stature; the
fronts of the templates' trunks are at 0.06 to 0.10."""
BOX_LOW, BACKPACK_LOW, BOX_GRIP_LOW = 0.14, 0.06, 0.2
"""Depths of the middles of a box and of a backpack below the upper spine's joint, over stature, and of grips below the middle of a
box, over its height; chosen by eye."""


def _to_grip(person: Person, side: str) -> np.ndarray:
    """Vector (3,) [m] from the wrist to the grip, in the frame of an upright cane."""
    return quaternions.rotate(hanging_hand(side, STICK_HAND_RAD), SIGN[side] * GRIP * person.stature_m * Y)


@dataclass(frozen=True, slots=True)
class _Stick:
    """A cane or crutch of a given length in one hand of a person."""

    person: Person
    side: str
    grip_at: np.ndarray
    """Positions (T, 3) [m] that its grip would have in a hanging arm."""
    length_m: float

    def held(self, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (T, 3) [m] of the grip, axes (T, 4) and whether the arm reaches (T,), for places (T, 3) of the tip, which rises
        where it does not."""
        shoulder, arm_m = self.person.points[f"{self.side}_shoulder"], sum(self.person.arm_m(self.side))
        up = unit(self.grip_at - tip)
        axes = quaternions.multiply(quaternions.between(np.broadcast_to(Z, up.shape), up), self.person.heading)
        hand_at = quaternions.rotate(axes, _to_grip(self.person, self.side))
        span = tip + self.length_m * up - hand_at - shoulder
        far = norms(span) / arm_m - STRAIGHT[0]
        room = STRAIGHT[1] - STRAIGHT[0]
        stretch = STRAIGHT[0] + np.where(far > 0, room * np.tanh(far / room), far)  # C2 at far = 0
        return shoulder + arm_m * stretch[:, None] * unit(span) + hand_at, axes, far <= 0


def _cane(person: Person, wish: Wish, side: str) -> Place:
    """A cane whose tip stands while the foot of the other side does, as long as the arm reaches it."""
    hands = {}
    for stick_side in SIDES if wish.paired else (side,):
        wrist = person.hanging(stick_side, CANE_BEND_RAD, CANE_OUT * person.stature_m)
        hands[stick_side] = wrist + person.ahead(_to_grip(person, stick_side))
    fitted_m = float(np.mean([np.median(hand[:, 2]) for hand in hands.values()]))
    stick = _Stick(person, side, hands[side], wish.size_m[1] if len(wish.size_m) > 1 else fitted_m)
    origin, axes, _ = stick.held(_stepping(stick))
    grip = Grip(np.zeros(3), hanging_hand(side, STICK_HAND_RAD), (-1.0, 0.3, 0.0))
    lowest_m = origin[:, 2] - stick.length_m * quaternions.rotate(axes, Z)[:, 2]
    return Place(origin, axes, f"{side}_wrist", (wish.size_m[0], stick.length_m), {side: grip}, lowest_m)


BAG_OUT, BAG_OUT_WIDTHS, CANE_OUT, STICK_HAND_RAD = 0.025, 0.15, 0.04, np.pi / 4
"""Distance of the wrist outside the shoulder with a bag, the sum of a part of the stature and a part of the bag's width, and with a
cane, over stature; angle by which fingers on a cane point forward from straight down. Chosen by eye to clear the leg."""


def _stepping(stick: _Stick) -> np.ndarray:
    """Track (T, 3) [m] of a cane's tip on the floor and between its places."""
    person, wish_at = stick.person, stick.grip_at
    poses, foot = person.poses, SIDES.index(OTHER[stick.side])
    middle, ahead = soles(poses)[:, foot].mean(axis=1), person.ahead(X)
    level = np.array([1.0, 1.0, 0.0])
    stands = []
    for start, stop in runs(np.asarray(contacts(poses)[:, foot].any(axis=1))):
        frame = (start + stop) // 2
        hand = wish_at[frame]
        place = (hand + ((middle[frame] - hand) @ ahead[frame] + CANE_AHEAD * person.stature_m) * ahead[frame]) * level
        fits = stick.held(np.broadcast_to(place, wish_at.shape))[2][start:stop]
        longest = max(runs(fits), key=lambda run: run[1] - run[0], default=None)
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


def _walker(person: Person, wish: Wish, _: str) -> Place:
    """A walking frame with wheels that is pushed at even speed, by both hands."""
    tall, path = person.stature_m, path_of(person)
    shoulder = 0.5 * (person.points["left_shoulder"] + person.points["right_shoulder"])
    ahead_m = WALKER_AHEAD * tall + float(np.median(((shoulder - path) * person.ahead(X)).sum(axis=1)))
    origin = path + person.ahead([ahead_m, 0.0, 0.0])
    out_m, low_m, hands = wish.size_m[0] / 2 - WALKER_GRIP_M, [], {}
    for side in SIDES:
        hands[side] = hanging_hand(side, np.pi / 3)
        wrist = -GRIP * tall * quaternions.rotate(hands[side], SIGN[side] * Y)  # vector from the grip to the wrist
        span = person.points[f"{side}_shoulder"] - origin - person.ahead(wrist + [0.0, SIGN[side] * out_m, 0.0])
        level2 = (span[:, :2] ** 2).sum(axis=1)
        low_m.append(span[:, 2] - np.sqrt(np.maximum((STRAIGHT[0] * sum(person.arm_m(side))) ** 2 - level2, 0.0)))
    height_m = wish.size_m[1] if len(wish.size_m) > 1 else float(np.max(low_m))
    grips = {
        side: Grip(np.array([0.0, SIGN[side] * out_m, height_m]), hands[side], (-1.0, 0.4, -0.3)) for side in SIDES
    }
    return Place(origin, person.heading, "right_wrist", (wish.size_m[0], height_m), grips, 0 * origin[:, 2])


WALKER_AHEAD, WALKER_GRIP_M = 0.09, 0.05
"""Distance of grips before the shoulders, over stature, and inside the frame's width [m]; they are as low as arms always reach."""


PLACES: Mapping[str, Callable[[Person, Wish, str], Place]] = {
    "bag": _bag, "ball": _ball, "cane": _cane, "crutch": _cane, "box": _box, "backpack": _backpack, "walker": _walker,
    "wheelchair": wheelchair,
}  # fmt: skip
HANDS_OF = {"box": 2, "backpack": 0, "walker": 2, "wheelchair": 2}


def carry(motion: Motion, things: str | Mapping[str, Any] | Sequence[str | Mapping[str, Any]]) -> Motion:
    """The motion of a person who carries things; the arms that hold them are posed anew, and in a wheelchair the whole body.

    things: what is carried, one or a list: "bag", "ball", "box", "backpack", "cane", "crutch", "crutches", "walker", "wheelchair".
        A bag, a ball, a cane and a crutch may be "in the left hand" or "in the right hand", by default in the right one if it is
        free; or mappings such as {thing: box, size_m: [0.3, 0.4, 0.3], material: metal}, with `hand`, `size_m` and `material` as
        far as they differ. `SIZES_M` tells what sizes mean.

    A bag hangs from an arm that is nearly straight and swings less, a box is held before the chest with both hands and moves with
    it, a ball lies in a hand that moves as it did, and the tip of a cane or a crutch stands on the floor while the foot of the
    other side does. A walker is pushed before the person at even speed. In a wheelchair the person sits, goes the way of the
    motion, which must be a forward walk or run, and pushes the rims of the wheels; `activities` are then not known.
    Later edits take the things along. The floor is z = 0. Raises an InputError that says why something cannot be carried.
    """
    checked_motion(motion)
    entries = [things] if isinstance(things, (str, Mapping)) else things
    if not isinstance(entries, (list, tuple)):
        raise InputError(f'things must be a text such as "bag", a mapping or a list of them, got {shown(things)}')
    if motion.carries and entries:
        raise InputError(f"the person carries a {motion.carries[0].thing} already; give all things to carry at once")
    wishes = [wish for entry in entries for wish in wishes_of(entry)]
    if not wishes:
        return motion
    names = [wish.thing for wish in wishes]
    if names.count("backpack") > 1:
        raise InputError("a back has room for one backpack, got several; leave one out, or give a bag")
    person, sides = Person.of(motion), _sides(wishes)
    lowest_m = float(soles(person.poses)[..., 2].min())
    if abs(lowest_m) > FLOOR_M:
        raise InputError(
            f"things stand on a floor at z = 0, and the lowest sole is at {lowest_m:.3g} m; move the motion there"
        )
    speed_mps = float(norms(np.diff(path_of(person), axis=0)).mean() * motion.rate_hz)
    for wish in wishes:
        if wish.thing in ("cane", "crutch", "walker") and speed_mps > WALKING_MPS:
            raise InputError(
                f"a {wish.thing} is for a walk, and the motion goes at {speed_mps:.2g} m/s; give a slower one"
            )
        if wish.thing == "wheelchair":
            motion, person = seated(motion, person, wish)
    places = [PLACES[wish.thing](person, wish, side) for wish, side in zip(wishes, sides, strict=True)]
    for wish, place in zip(wishes, places, strict=True):
        size_m, (least_m, greatest_m) = place.size_m, RANGES_M[wish.thing]
        if not all(low <= size <= high for low, size, high in zip(least_m, size_m, greatest_m, strict=False)):
            raise InputError(
                f"a {wish.thing} that fits would have the dimensions {', '.join(f'{size:.2g}' for size in size_m)} m; "
                "carry it in a walk"
            )
        if wish.thing == "box":
            _refuse_legs_in(place, motion)
        lowest = place.lowest_m
        if lowest.min() < -SUNK_M:
            raise InputError(
                f"the {wish.thing} would be {-lowest.min():.2g} m below the floor at {lowest.argmin() / motion.rate_hz:.3g} s; "
                "carry it in a motion that stays on its feet, or a smaller one"
            )
        if wish.thing in ("cane", "crutch") and lowest.min() > SUNK_M:
            raise InputError(
                f"a {wish.thing} of {place.size_m[1]:.3g} m stays {lowest.min():.2g} m over the floor; give a longer one, or "
                "leave its length out"
            )
    grips = {side: (place, grip) for place in places for side, grip in place.grips.items()}
    posed = _holding(motion, person, grips)
    carried = tuple(_attached(posed, wish, place) for wish, place in zip(wishes, places, strict=True))
    return replace(posed, carries=carried).edited(f"carries {', '.join(names)}")


def _sides(wishes: Sequence[Wish]) -> list[str]:
    """The side of the hand for each thing, "" for one that needs both hands or none; raises an InputError if hands are full."""
    free, assigned = ["right", "left"], []
    for wish in sorted(wishes, key=lambda thing: thing.side is None):  # those whose hand is given come first
        hands = HANDS_OF.get(wish.thing, 1)
        side = "" if hands != 1 else wish.side or next(iter(free), "")
        needed = free[:hands] if hands != 1 else [side]
        if len(needed) < hands or not set(needed) <= set(free):
            full = f"the {wish.side} hand is" if wish.side else "the hands are"
            raise InputError(
                f"{full} full, so that a {wish.thing} cannot be carried as well; leave a thing out, or name other hands"
            )
        free = [hand for hand in free if hand not in needed]
        assigned.append((wish, side))
    return [next(side for other, side in assigned if other is wish) for wish in wishes]


def _refuse_legs_in(place: Place, motion: Motion) -> None:
    """Raises an InputError for a box that a thigh goes through, as when the person sits or bends down."""
    half_m, back = 0.5 * np.array(place.size_m), quaternions.conjugate(place.axes)
    for side in SIDES:
        hip, knee = (motion.joints[:, motion.index(f"{side}_{name}")] for name in ("hip", "knee"))
        for along in np.linspace(0.0, 1.0, 9):
            local = quaternions.rotate(back, hip + along * (knee - hip) - place.origin)
            inside = (np.abs(local) < half_m + THIGH_M).all(axis=1)
            if inside.any():
                raise InputError(
                    f"the {side} thigh would go through the box at {inside.argmax() / motion.rate_hz:.3g} s; carry it in a walk, "
                    "or a smaller one"
                )


THIGH_M = 0.05
"""Least distance from the axis of a thigh to its front [m]."""


def _holding(motion: Motion, person: Person, grips: Mapping[str, tuple[Place, Grip]]) -> Motion:
    """The motion with arms posed so that the hands hold their grips."""
    joints, rotations, poses = motion.joints.copy(), motion.rotations.copy(), person.poses
    before, turned = poses.world()
    for side, (place, grip) in grips.items():
        shoulder, elbow, wrist = (INDEX[f"{side}_{name}"] for name in ("shoulder", "elbow", "wrist"))
        axes = quaternions.multiply(place.axes, grip.axes)
        fingers = quaternions.rotate(axes, SIGN[side] * Y)
        target = place.origin + quaternions.rotate(place.axes, grip.at) - GRIP * person.stature_m * fingers
        shoulder_m = person.points[f"{side}_shoulder"]
        pole = person.ahead(np.array(grip.elbow) * [1.0, SIGN[side], 1.0])
        limb = cast(Limb, f"{side}_arm")
        poses, _ = reach(poses, limb, target - shoulder_m + before[:, shoulder], pole=pole)
        there, now = poses.world()
        for name, joint in ((f"{side}_elbow", elbow), (f"{side}_wrist", wrist)):
            joints[:, motion.index(name)] = shoulder_m + there[:, joint] - there[:, shoulder]
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
    """The thing in the frame of its joint; raises an InputError if the hands or the joint do not keep hold of it."""
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
        what = "the arms do not reach" if place.grips else f"the {place.joint} does not keep its hold of"
        raise InputError(
            f"{what} the {wish.thing} at {off_m.argmax() / motion.rate_hz:.3g} s, by {off_m.max():.2g} m; give "
            "another size_m, or a calmer motion"
        )
    return Carried(
        thing=wish.thing, joint=place.joint, position_m=tuple(local.tolist()), rotation=tuple(rotation.tolist()),
        size_m=place.size_m, material=wish.material,
    )  # fmt: skip
