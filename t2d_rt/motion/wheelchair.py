"""Seat a person in a wheelchair that goes the way of a walk, with hands that push its rims."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import norms
from t2d_rt.motion import quaternions
from t2d_rt.motion.carriers import GRIP, RANGES_M, SHORT_M, SIGN, Person, Place, Wish, X, Y, Z, hanging_hand, path_of
from t2d_rt.motion.contacts import SIDES, Limb, reach, runs
from t2d_rt.motion.generate.made.hands import Anatomy
from t2d_rt.motion.interpolate import minimum_jerk
from t2d_rt.motion.kinematics import INDEX, LOWER_BACK, PARENT_NAMES, Poses, motion_of
from t2d_rt.types.carried import RIM_M, WHEEL_M
from t2d_rt.types.motion import Motion

SEATED_TRUNK = 0.15
"""Part of the trunk's movement in the gait that remains in a wheelchair."""
PUSH_RAD, CYCLE_RAD, PUSH_FROM_RAD = (0.6, 1.3), 2.9, -0.45
"""Least and greatest angle by which a wheel rolls in a push, angle from one push to the next, and angle forward of the rim's top at
which the hand grasps it if the arm reaches: at 1 m/s there are 1.1 pushes a second of up to 0.4 s."""
TOP_ELBOW_RAD, RIM_STRAIGHT = np.radians(105.0), 0.97
"""Angle between upper arm and forearm with the hand at the rim's top, to which the seat is fitted (100 to 120 degrees: Consortium
for Spinal Cord Medicine, Preservation of Upper Limb Function, 2005), and greatest length of the arm over that of its bones."""
RIM_HAND_RAD = np.pi / 6
"""Angle by which fingers on a rim point forward from straight down."""
SHIN_AHEAD_M, FOOTREST_M = 0.05, 0.05
"""Distance of the ankles ahead of knees that are level with the hips, and least height of a footrest [m]."""
PATH_HZ = 0.25
"""Cut-off frequency that smooths the pelvis's track to a wheelchair's: a pelvis sways once in a stride."""
ROLLS_MPS, RISE = (0.1, 0.3), 0.12
"""Speeds at which a wheelchair begins to point along its track, and fully does [m/s]; greatest range of the pelvis's height in the
walk, over stature."""


def wheelchair(person: Person, wish: Wish, _: str) -> Place:
    """The place of a wheelchair in which the person sits already (`seated`), with its footrest below the feet."""
    hips, feet = (0.5 * (person.points[f"left_{name}"] + person.points[f"right_{name}"]) for name in ("hip", "foot"))
    anatomy = Anatomy(person.poses.skeleton)
    ahead_m = float(np.mean(((feet - hips) * person.ahead(X)).sum(axis=1))) - 0.25 * anatomy.foot_m
    sizes = (
        wish.size_m[0],
        float(np.mean(hips[:, 2])) - anatomy.seat_m,
        ahead_m,
        float(np.mean(feet[:, 2])) - anatomy.sole_m,
    )
    return Place(hips * [1.0, 1.0, 0.0], person.heading, "pelvis", sizes, {}, 0 * hips[:, 2])


def _rolling(motion: Motion, person: Person) -> tuple[np.ndarray, np.ndarray]:
    """Track (T, 3) [m] of a wheelchair on the floor and its orientation (T, 4), along the track wherever it moves."""
    path, ahead = path_of(person, PATH_HZ), person.ahead(X)
    velocity = np.gradient(path, 1 / motion.rate_hz, axis=0)
    speed = norms(velocity)[:, None]
    along = minimum_jerk(np.clip((speed - ROLLS_MPS[0]) / (ROLLS_MPS[1] - ROLLS_MPS[0]), 0.0, 1.0))
    forward = (velocity * ahead).sum(axis=1) >= 0.5 * speed[:, 0]
    rise_m = float(np.ptp(person.points["pelvis"][:, 2]))
    others = {name for name, _ in motion.activities} - {"walk", "run", "stand"}
    if others or rise_m > RISE * person.stature_m or speed.mean() < ROLLS_MPS[0] or not forward[along[:, 0] > 0].all():
        description = ", ".join(sorted(others)) or (
            f"a pelvis that goes at {speed.mean():.2g} m/s on average, {'not all ' if not forward.all() else ''}forward, and "
            f"up and down by {rise_m:.2g} m"
        )
        raise InputError(
            f"a wheelchair goes the way of a forward walk or run, got {description}; give a walk, or trim the motion to it"
        )
    direction = ahead + along * (velocity / np.maximum(speed, 1e-9) - ahead)
    return path, quaternions.about_axis(Z, np.unwrap(np.arctan2(direction[:, 1], direction[:, 0])))


def seated(motion: Motion, person: Person, wish: Wish) -> tuple[Motion, Person]:
    """The motion and the person in a wheelchair that goes the same way, with feet on the footrest and hands that push the rims.

    Raises an InputError if the motion is not a forward walk or run, or if hands or feet do not reach.
    """
    poses, anatomy = person.poses, Anatomy(person.poses.skeleton)
    path, heading = _rolling(motion, person)
    person = replace(person, heading=heading)
    tilt = quaternions.about_axis(Y, np.array(anatomy.tilt_rad))
    pelvis, still = quaternions.multiply(heading, tilt), np.broadcast_to([0.0, 0.0, 0.0, 1.0], poses.local.shape)
    local = quaternions.blend(still, poses.local, np.array(SEATED_TRUNK))
    local[:, 0], local[:, INDEX[LOWER_BACK]] = pelvis, quaternions.conjugate(tilt)  # the spine goes on upright
    poses = replace(poses, root=path - quaternions.rotate(pelvis, anatomy.middle), local=local)
    rims = _Rims.of(poses, person, path, wish.size_m[0])
    seat_m = wish.size_m[1] if len(wish.size_m) > 1 else rims.fitting_seat_m()
    poses = replace(poses, root=poses.root + (seat_m + anatomy.seat_m) * Z)
    rolled = np.concatenate([[0.0], np.cumsum((np.diff(path, axis=0) * person.ahead(X)[1:]).sum(axis=1))]) / WHEEL_M
    angle = pushing(rolled, *rims.arc(seat_m))
    shank_m = 0.5 * sum(anatomy.bones_m(side, "knee", "ankle")[1] for side in SIDES)
    rest_m = max(FOOTREST_M, seat_m + anatomy.seat_m - 0.97 * shank_m - anatomy.ankle_m)
    for side in SIDES:
        sign = SIGN[side]
        thigh, _ = anatomy.bones_m(side, "knee", "ankle")
        ankle_m = rest_m + anatomy.sole_m - float(anatomy.offset(f"{side}_foot")[2])
        ankle = path + person.ahead([thigh + SHIN_AHEAD_M, sign * anatomy.hips_m, ankle_m])
        arm, leg = cast(Limb, f"{side}_arm"), cast(Limb, f"{side}_leg")
        poses, far_m = reach(poses, leg, ankle, pole=person.ahead([1.0, 0.0, 1.0]))
        poses = _turned(poses, f"{side}_ankle", heading)
        poses, short_m = reach(poses, arm, rims.wrist(side, angle), pole=person.ahead([-1.0, 0.5 * sign, 0.0]))
        poses = _turned(poses, f"{side}_wrist", quaternions.multiply(heading, hanging_hand(side, RIM_HAND_RAD)))
        if max(far_m.max(), short_m.max()) > SHORT_M:
            raise InputError(
                f"hands or feet stay {max(far_m.max(), short_m.max()):.2g} m short of the wheelchair; give another size_m"
            )
    seated_motion = motion_of(replace(poses, local=quaternions.continuous(poses.local)))
    changes = {name: getattr(seated_motion, name) for name in ("joints", "rotations", "names", "parents")}
    motion = replace(motion, **changes, activities=())
    return motion, replace(Person.of(motion), heading=heading, stature_m=person.stature_m)


def _turned(poses: Poses, joint: str, axes: np.ndarray) -> Poses:
    """Poses in which a hand or foot has the given orientation (T, 4) in space."""
    local = poses.local.copy()
    above = poses.world()[1][:, INDEX[PARENT_NAMES[joint]]]
    local[:, INDEX[joint]] = quaternions.multiply(quaternions.conjugate(above), axes)
    return replace(poses, local=local)


@dataclass(frozen=True, slots=True)
class _Rims:
    """The rims of a wheelchair, and the shoulders from which arms reach for them."""

    person: Person
    path: np.ndarray
    """Track (T, 3) [m] of the chair on the floor."""
    out_m: float
    """Half the distance between the rims."""
    shoulders: dict[str, np.ndarray]
    """Positions (T, 3) [m] of the shoulders by side, in the frame of a chair whose seat is at the height of the floor."""

    @classmethod
    def of(cls, poses: Poses, person: Person, path: np.ndarray, width_m: float) -> _Rims:
        """The rims for poses whose hips' middle lies on the floor."""
        joints, back = poses.world()[0], quaternions.conjugate(person.heading)
        raised = Anatomy(poses.skeleton).seat_m * Z
        at = {side: quaternions.rotate(back, joints[:, INDEX[f"{side}_shoulder"]] - path) + raised for side in SIDES}
        return cls(person, path, width_m / 2, at)

    def local(self, side: str, angle: np.ndarray) -> np.ndarray:
        """Positions (T, 3) [m] of the wrist in the chair's frame, for angles (T,) of the hand on the rim, forward of its top."""
        fingers = quaternions.rotate(hanging_hand(side, RIM_HAND_RAD), SIGN[side] * Y)
        rim = [RIM_M * np.sin(angle), 0 * angle + SIGN[side] * self.out_m, RIM_M * np.cos(angle) + WHEEL_M]
        return np.stack(rim, axis=-1) - GRIP * self.person.stature_m * fingers

    def wrist(self, side: str, angle: np.ndarray) -> np.ndarray:
        """The same positions (T, 3) [m] in space."""
        return self.path + quaternions.rotate(self.person.heading, self.local(side, angle))

    def fitting_seat_m(self) -> float:
        """Height [m] of the seat, within its range, at which elbows have `TOP_ELBOW_RAD` with hands at the top of the rims."""
        heights_m = []
        for side, shoulder in self.shoulders.items():
            first, second = self.person.arm_m(side)
            span2 = first**2 + second**2 - 2 * first * second * np.cos(TOP_ELBOW_RAD)
            off = self.local(side, np.zeros(1)) - shoulder.mean(axis=0)
            heights_m.append(off[0, 2] + np.sqrt(max(span2 - off[0, 0] ** 2 - off[0, 1] ** 2, 0.0)))
        (_, least_m), (_, greatest_m) = RANGES_M["wheelchair"]
        return float(np.clip(np.mean(heights_m), least_m, greatest_m))

    def arc(self, seat_m: float) -> tuple[float, float]:
        """Angle at which hands grasp the rims and angle of the longest push within `PUSH_RAD` that bent arms reach [rad]; raises an
        InputError if there is none."""
        angles, reached = np.linspace(-1.5, 1.5, 301), np.ones(301, bool)
        for side, shoulder in self.shoulders.items():
            off = norms(self.local(side, angles)[:, None] - shoulder - seat_m * Z)
            reached &= off.max(axis=1) < RIM_STRAIGHT * sum(self.person.arm_m(side))
        first, stop = max(runs(reached), key=lambda run: run[1] - run[0], default=(0, 1))
        low, high = angles[first], angles[stop - 1]
        for push in np.linspace(PUSH_RAD[1], PUSH_RAD[0], 60):
            over = float(pushing(np.linspace(push, CYCLE_RAD, 200), 0.0, push).max() - push)
            if push + 2 * over <= high - low:
                return float(np.clip(PUSH_FROM_RAD, low + over, high - over - push)), float(push)
        raise InputError(
            f"the arms do not reach the rims of a wheelchair whose seat is {seat_m:.2g} m high for a push of {PUSH_RAD[0]:g} rad; "
            "give another size_m, or leave out the height"
        )


def pushing(rolled_rad: np.ndarray, first_rad: float, push_rad: float) -> np.ndarray:
    """Angle (T,) on the rim, from its top forward, of a hand that pushes a wheel which has rolled by (T,) [rad].

    In a push from `first_rad` on it moves with the rim; it returns by the quintic that keeps speed and acceleration at both ends.
    """
    phase = np.mod(rolled_rad, CYCLE_RAD)
    back = CYCLE_RAD - push_rad
    x = np.clip((phase - push_rad) / back, 0.0, 1.0)
    # From push_rad, slope 1, to 0, slope 1: the straight line push_rad + back x, less what leads to 0.
    returning = push_rad + back * x - CYCLE_RAD * minimum_jerk(x)
    return first_rad + np.where(phase < push_rad, phase, returning)
