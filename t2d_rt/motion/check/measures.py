"""Measure a motion before it is judged: tracks of joints, support by the feet, joint angles, smoothness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from pathlib import Path

import numpy as np

from t2d_rt.geometry.vectors import unit, vector_product
from t2d_rt.motion import kinematics
from t2d_rt.motion.contacts import runs
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.skeletons import shipped
from t2d_rt.types.motion import Motion, checked_motion

# --- a motion as the checks see it: at one rate, in one band, with the body's own lengths to compare with ---


RATE_HZ = 60.0
"""Rate at which speeds and accelerations are taken, whatever the motion's own, so that figures of motions at 10 and at 240 Hz
can be compared."""

CUTOFF_HZ = 10.0
"""Cut-off below which human movement lies, except impacts (Winter, Biomechanics, 2.2), and above which slight noise lies."""

HEAD_STANDING, HIPS_STANDING = 0.89, 0.52
"""Heights of the head's joint and of the middle of the hips of a person who stands, over stature: medians of 100 recorded
walks."""

GRAVITY_MPS2 = 9.81

ANATOMY = shipped(Path(__file__).with_name("anatomy.yaml"))
"""Masses of segments, radii of joints and ranges of angles; the file says where they come from."""

RANGES_DEG: Mapping[str, tuple[float, str]] = ANATOMY["ranges_deg"]
"""Greatest angles of healthy adults [degrees] by the names of `joint_angles`, and a sentence that says so."""


@dataclass(frozen=True)
class Tracks:
    """Joints of one motion at `RATE_HZ`, below `CUTOFF_HZ`."""

    names: tuple[str, ...]
    joints: np.ndarray
    """Positions [m], (T, J, 3)."""
    stature_m: float

    def __getitem__(self, name: str) -> np.ndarray:
        """Track (T, 3) [m] of a joint, or of the middle of a pair: hips, shoulders, knees, ankles, feet."""
        if name in self.names:
            return self.joints[:, self.names.index(name)]
        pair = {"hips": "hip", "shoulders": "shoulder", "knees": "knee", "ankles": "ankle", "feet": "foot"}[name]
        return 0.5 * (self[f"left_{pair}"] + self[f"right_{pair}"])

    def columns(self, names: Sequence[str]) -> list[int]:
        """Indices of some joints among all."""
        return [self.names.index(name) for name in names]

    @property
    def times_s(self) -> np.ndarray:
        """Instants of the frames [s], (T,)."""
        return np.arange(len(self.joints)) / RATE_HZ

    @cached_property
    def velocity(self) -> np.ndarray:
        """Velocity of every joint [m/s], (T, J, 3)."""
        return rate_of(self.joints)

    @cached_property
    def centre_of_mass(self) -> np.ndarray:
        """Centre of mass of the body [m], (T, 3)."""
        return sum(mass * ((1 - along) * self[a] + along * self[b]) for a, b, mass, along in ANATOMY["segment_masses"])  # type: ignore[return-value]

    @cached_property
    def facing(self) -> np.ndarray:
        """Horizontal unit vectors that hips and shoulders face, (T, 3)."""
        return kinematics.facing(
            {name: self[name] for name in ("left_hip", "right_hip", "left_shoulder", "right_shoulder")}
        )

    @cached_property
    def trunk(self) -> np.ndarray:
        """Unit vectors from the hips to the shoulders, (T, 3)."""
        return unit(self["shoulders"] - self["hips"])

    @cached_property
    def leg_m(self) -> float:
        """Length of thigh and shank [m]."""
        return kinematics.leg_m({name: self.joints[:, place] for place, name in enumerate(self.names)})


def tracks(motion: Motion) -> Tracks:
    """The motion's joints at `RATE_HZ`, by a cubic spline; low-passed at `CUTOFF_HZ` if the motion's rate is over 3 times that."""
    joints = motion.joints
    if motion.rate_hz > 3 * CUTOFF_HZ and len(joints) > 3:
        joints = low_pass(joints, CUTOFF_HZ, motion.rate_hz)
    if motion.rate_hz != RATE_HZ:
        from scipy.interpolate import make_interp_spline

        count = max(2, int(motion.duration_s * RATE_HZ + 1e-9) + 1)
        instants = np.minimum(np.arange(count) / RATE_HZ, motion.duration_s)
        flat = joints.reshape(len(joints), -1)
        spline = make_interp_spline(motion.times_s, flat, k=min(3, len(flat) - 1))
        joints = spline(instants).reshape(count, *joints.shape[1:])
    points = {name: joints[:, index] for index, name in enumerate(motion.names)}
    return Tracks(names=motion.names, joints=joints, stature_m=max(kinematics.stature_m(points), 1e-3))


def rate_of(values: np.ndarray) -> np.ndarray:
    """Derivative in time along axis 0 of what is given at `RATE_HZ`, by central differences."""
    return np.gradient(values, 1 / RATE_HZ, axis=0)


def angle_deg(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angle between vectors (..., 3) [degrees]."""
    return np.degrees(np.arccos(np.clip(np.sum(unit(first) * unit(second), axis=-1), -1, 1)))


def spans(active: np.ndarray, *, gap: int = 0, least: int = 1) -> list[tuple[int, int]]:
    """Runs of True in (T,) as (start, stop), those closer than `gap` frames joined, then those shorter than `least` left out."""
    joined: list[tuple[int, int]] = []
    for start, stop in runs(active):
        if joined and start - joined[-1][1] < gap:
            joined[-1] = joined[-1][0], stop
        else:
            joined.append((start, stop))
    return [(start, stop) for start, stop in joined if stop - start >= least]


# --- what carries the body: planted feet and how far they slide, the floor and how deep the body sinks, flight ---


FOOT_POINTS = "ankle", "foot", "toe"

LIFTED, LIFTED_S = 0.012, 0.25
"""A foot is lifted if it is higher by this, over stature, than its lowest level within this time [s], as in a small, slow step."""

PLANTED_MPS = 0.45
"""A foot whose slowest point is slower is planted; in swing none of its points is."""

NEAR = 0.035
"""Height above the lowest foot, over stature, up to which a foot shares in carrying the body; heights of points count from their
own lowest levels."""

LEAST_CONTACT_S, EDGE = 0.12, 0.2
"""Shortest contact that counts, and the fraction left out at both its ends: a foot that lands or leaves moves."""

AIRBORNE = 0.035
"""Height of the lowest point over stature from which the body is off the floor."""

ON_FLOOR = 0.15
"""Height of the hips, over stature, below which a person sits or lies on the floor; in the deepest squat they are at 0.17."""

SEATED_THIGH, SEATED_SPEED_MPS = 0.6, 0.25
"""Greatest drop of the knees below the hips in sitting, over the thigh's length, and greatest speed of the hips."""


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact of one foot with the ground."""

    side: str
    start: int
    stop: int
    """Frames at `RATE_HZ`, the last not included."""
    place: np.ndarray
    """Median place (3,) [m]: x and y of the foot's ball, z of its lowest joint."""
    skate_m: float
    """Extent of the track of ankle, ball or toe, whichever moves least, over the middle 60 % of the contact."""


def foot_heights(body: Tracks) -> np.ndarray:
    """Heights of the points of `feet_names` above each one's own lowest level [m], (T, P)."""
    names = feet_names(body)
    heights = body.joints[:, body.columns(names), 2]
    level = np.percentile(heights, 5, axis=0)
    # A foot of the other side has the same build: a foot that never comes down has its level from there.
    parts = [name.split("_")[1] for name in names]
    lowest = [min(value for value, other in zip(level, parts, strict=True) if other == part) for part in parts]
    return heights - np.minimum(level, np.array(lowest) + 0.02 * body.stature_m)


def airborne(body: Tracks) -> np.ndarray:
    """Mask (T,) of frames in which no part of the body is at the floor, no foot is planted at any height and nobody sits."""
    lowest = clearance(body).min(axis=1)
    slow = np.linalg.norm(body.velocity[:, body.columns(feet_names(body))], axis=-1) < PLANTED_MPS
    # Planted on a step: slow for a while. At the top of a jump the feet are slow for 0.1 s at most.
    planted = np.zeros(len(lowest), bool)
    for point in range(slow.shape[1]):
        for start, stop in spans(slow[:, point], least=round(0.15 * RATE_HZ)):
            planted[start:stop] = True
    return (lowest > AIRBORNE * body.stature_m) & ~planted & ~seated(body)


def seated(body: Tracks) -> np.ndarray:
    """Mask (T,) of frames in which hips are low over the knees, and slow: something else than the feet carries the body."""
    drop = (body["hips"] - body["knees"])[:, 2] / (0.5 * body.leg_m)
    speed = np.linalg.norm(rate_of(body["hips"]), axis=-1)
    return (drop < SEATED_THIGH) & (speed < SEATED_SPEED_MPS)


def clearance(body: Tracks) -> np.ndarray:
    """Heights (T, J) [m] of the skin at each joint over the floor."""
    radii = [ANATOMY["radii"][name.removeprefix("left_").removeprefix("right_")] for name in body.names]
    return body.joints[..., 2] - np.array(radii) * body.stature_m


def penetration_m(body: Tracks) -> float:
    """Greatest depth [m] at which the body is in the floor for two frames or more."""
    depth = -clearance(body).min(axis=1)
    return max(0.0, float(np.minimum(depth[1:], depth[:-1]).max()))


def floor_offset_m(contacts: list[Contact]) -> float:
    """Height of the lowest planted foot over the floor [m]; 0 where none is planted."""
    return min((float(contact.place[2]) for contact in contacts), default=0.0)


def floating_s(body: Tracks) -> float:
    """Longest excess of a flight over what its own rise and fall allow [s].

    A body that rises by u to the top of its flight and falls by d from there flies for sqrt(2 u / g) + sqrt(2 d / g).
    """
    return _excess_s(body, airborne(body))


def flights_s(body: Tracks) -> list[tuple[float, float, float]]:
    """Flights of 0.05 s or more: start [s], duration [s], rise of the centre of mass from take-off [m]."""
    height = body.centre_of_mass[:, 2]
    return [
        (start / RATE_HZ, (stop - start) / RATE_HZ, float(height[start:stop].max() - height[start]))
        for start, stop in spans(airborne(body), gap=2, least=3)
    ]


def contacts(body: Tracks) -> list[Contact]:
    """Contacts of both feet, in the order in which they begin."""
    from scipy.ndimage import minimum_filter1d

    names, heights = feet_names(body), foot_heights(body)
    lowest = heights.min(axis=1)
    # The feet of one who sits or lies carry little and may be drawn over the floor.
    free = ~airborne(body) & ~seated(body) & (body["hips"][:, 2] > ON_FLOOR * body.stature_m)
    planted = []
    for side in ("left", "right"):
        foot_names = [name for name in names if name.startswith(side)]
        speed = np.linalg.norm(body.velocity[:, body.columns(foot_names)], axis=-1)
        height = heights[:, [names.index(name) for name in foot_names]].min(axis=1)
        lifted = (
            height - minimum_filter1d(height, 2 * round(LIFTED_S * RATE_HZ) + 1, mode="nearest")
            > LIFTED * body.stature_m
        )
        carrying = (height - lowest < NEAR * body.stature_m) & ~lifted
        active = (speed.min(axis=1) < PLANTED_MPS) & carrying & free
        for start, stop in spans(active, gap=3, least=round(LEAST_CONTACT_S * RATE_HZ)):
            planted.append(_contact(body, side, start, stop))
    return sorted(planted, key=attrgetter("start"))


def _contact(body: Tracks, side: str, start: int, stop: int) -> Contact:
    edge = round(EDGE * (stop - start))
    middle = slice(start + edge, stop - edge)
    names = [name for name in feet_names(body) if name.startswith(side)]
    # A foot rolls: while its ankle passes over, its ball rests, or its toe does.
    skate = [_extent_m(body[name][middle, :2]) for name in names]
    place = np.median(body[f"{side}_foot"][middle], axis=0)
    level = float(np.median(np.min([body[name][middle, 2] for name in names], axis=0)))
    return Contact(side, start, stop, np.array([place[0], place[1], level]), min(skate))


def _extent_m(track: np.ndarray) -> float:
    """Twice the greatest distance of a track (T, 2) from the middle of its bounding box [m]."""
    middle = 0.5 * (track.min(axis=0) + track.max(axis=0))
    return 2 * float(np.linalg.norm(track - middle, axis=-1).max())


def feet_names(body: Tracks) -> list[str]:
    """Names of ankles, balls and, where known, toes of both feet."""
    names = [f"{side}_{point}" for side in ("left", "right") for point in FOOT_POINTS]
    return [name for name in names if name in body.names]


def sliding_s(body: Tracks) -> float:
    """Longest time in which nothing that could carry the body rests, beyond what its flight allows [s].

    It shows feet that slide over the floor, and bodies that nothing carries.
    """
    speed = np.linalg.norm(body.velocity, axis=-1)
    near = clearance(body) < NEAR * body.stature_m
    near[:, body.columns(feet_names(body))] = True
    resting = (near & (speed < PLANTED_MPS)).any(axis=1) | seated(body)
    return _excess_s(body, ~resting)


def _excess_s(body: Tracks, free: np.ndarray) -> float:
    """Longest excess of the spans in which the body is free over a flight with the same rise and fall [s]."""
    height = body.centre_of_mass[:, 2]
    excess = 0.0
    for start, stop in spans(free, gap=2, least=3):
        first, last = max(start - 1, 0), min(stop, len(height) - 1)
        top = height[first : last + 1].max()
        allowed = sum(np.sqrt(2 * (top - height[end]) / GRAVITY_MPS2) for end in (first, last))
        excess = max(excess, (last - first) / RATE_HZ - float(allowed))
    return excess


# --- whether a body could take its postures: ranges of joints, parts that intersect, sides that are swapped ---
#
# Angles come from positions alone, because rotations in a file count from a zero of its own. So neither the direction
# in which an elbow bends nor the turn of an arm or a leg about its own axis can be told.


SIDES = "left", "right"

INVERTED = 0.15
"""Height over stature by which the head is below and the ankles are above the hips of a body upside down."""


def joint_angles(body: Tracks) -> dict[str, np.ndarray]:
    """Angles (T,) [degrees] of the joints by the names of `RANGES_DEG`, the greater one of both sides."""
    trunk = body.trunk
    across = unit(body["left_hip"] - body["right_hip"])
    shoulders = unit(body["left_shoulder"] - body["right_shoulder"])
    sides = [_limb_angles(body, side, sign * across, shoulders) for side, sign in zip(SIDES, (1.0, -1.0), strict=True)]
    angles = {name: np.max([angles_of_side[name] for angles_of_side in sides], axis=0) for name in sides[0]}
    angles["neck_deg"] = angle_deg(body["head"] - body["neck"], trunk)
    flat = [axis - np.sum(axis * trunk, axis=-1, keepdims=True) * trunk for axis in (across, shoulders)]
    angles["trunk_twist_deg"] = angle_deg(*flat)
    angles["trunk_bend_deg"] = angle_deg(body["spine1"] - body["hips"], body["shoulders"] - body["spine2"])
    return angles


def _limb_angles(body: Tracks, side: str, out: np.ndarray, shoulders: np.ndarray) -> dict[str, np.ndarray]:
    """Angles (T,) [degrees] of knee, elbow, hip and shoulder of one side.

    out: unit vectors (T, 3) along the line of the hips away from the body. shoulders: those along their line, to the left.
    """
    hip, knee, ankle, foot = (body[f"{side}_{name}"] for name in ("hip", "knee", "ankle", "foot"))
    shoulder, elbow, wrist = (body[f"{side}_{name}"] for name in ("shoulder", "elbow", "wrist"))
    across = out if side == "left" else -out
    ahead, chest = unit(vector_product(across, body.trunk)), unit(vector_product(shoulders, body.trunk))
    thigh, shank, upper = knee - hip, ankle - knee, elbow - shoulder
    bend, hinge = angle_deg(thigh, shank), unit(vector_product(thigh, shank))
    # Knee and ankle turn about nearly parallel axes along the line of the hips; the axis of a knee that bends forward is opposite.
    # Both comparisons must agree, because a hip turns its leg, and in some files feet follow no ankle.
    sole_hinge = unit(vector_product(shank, foot - ankle))
    wrong = (np.sum(hinge * sole_hinge, axis=-1) > 0.5) & (np.sum(hinge * across, axis=-1) < -0.5)
    forward, sideward, downward = (np.sum(unit(thigh) * axis, axis=-1) for axis in (ahead, out, -body.trunk))
    sagittal = np.degrees(np.arctan2(forward, downward))
    # Near the hip line the sagittal angle means nothing.
    sagittal = np.where(np.hypot(forward, downward) > 0.3, sagittal, 0.0)
    # In a deep bend with the thigh at the chest the angle passes 180 degrees; a thigh is never that far behind the back.
    sagittal = np.where(sagittal < -130, sagittal + 360, sagittal)
    back, aside, down = (np.sum(unit(upper) * axis, axis=-1) for axis in (-chest, shoulders, -body.trunk))
    behind = (down > -0.5) & (back > 0.3) & (np.abs(aside) < 0.5)  # an arm that is raised sideward goes farther back
    return {
        "knee_flexion_deg": bend,
        "knee_hyperextension_deg": np.where(wrong, bend, 0.0),
        "elbow_flexion_deg": angle_deg(upper, wrist - elbow),
        "hip_flexion_deg": sagittal,
        "hip_extension_deg": -sagittal,
        "hip_abduction_deg": np.degrees(np.arcsin(np.clip(sideward, -1, 1))),
        "shoulder_extension_deg": np.where(behind, np.degrees(np.arctan2(back, down)), 0.0),
    }


def mirrored(body: Tracks) -> bool:
    """Whether left and right are swapped: the feet point to where the back is."""
    feet = sum(np.sum((body[f"{side}_foot"] - body[f"{side}_ankle"]) * body.facing, axis=-1) for side in SIDES)
    upright = body.trunk[:, 2] > 0.5
    return bool(upright.any() and np.median(np.asarray(feet)[upright]) < 0)


def upside_down_fraction(body: Tracks) -> float:
    """Fraction of the time with the head well below the hips and both ankles well above them; lying bodies are level."""
    head, hips = body["head"][:, 2], body["hips"][:, 2]
    ankles = np.minimum(body["left_ankle"][:, 2], body["right_ankle"][:, 2])
    apart = INVERTED * body.stature_m
    return float(((head < hips - apart) & (ankles > hips + apart)).mean())


def self_penetration_m(body: Tracks) -> np.ndarray:
    """Depths (T,) [m] to which limbs go into the trunk, the head or one another, as capsules along the bones."""
    parts, pairs = _capsules(body)
    depth = np.zeros(len(body.joints))
    for one, other in pairs:
        (a, b, r), (c, d, s) = parts[one], parts[other]
        depth = np.maximum(depth, (r + s) * body.stature_m - _distance(a, b, c, d))
    return depth


Capsule = tuple[np.ndarray, np.ndarray, float]


def _capsules(body: Tracks) -> tuple[dict[str, Capsule], list[tuple[str, str]]]:
    """Ends (T, 3) and radii over stature by name, and the pairs that are apart in any posture that a body can take."""
    radii = ANATOMY["capsule_radii"]
    parts: dict[str, Capsule] = {
        "trunk": (*_part(body["hips"], body["shoulders"], 0.1, 0.85), radii["trunk"]),
        "head": (body["head"], body["head"] + 0.3 * (body["head"] - body["neck"]), radii["head"]),
    }
    pairs: list[tuple[str, str]] = []
    for side in SIDES:
        hip, knee, ankle, foot = (body[f"{side}_{name}"] for name in ("hip", "knee", "ankle", "foot"))
        shoulder, elbow, wrist = (body[f"{side}_{name}"] for name in ("shoulder", "elbow", "wrist"))
        # Near the hip and the shoulder flesh is shared; there the capsules begin later.
        parts[f"{side}_thigh"] = (*_part(hip, knee, 0.45, 0.95), radii["thigh"])
        parts[f"{side}_shank"] = (*_part(knee, ankle, 0.1, 1.0), radii["shank"])
        parts[f"{side}_foot"] = (ankle, foot, radii["foot"])
        parts[f"{side}_arm"] = (*_part(shoulder, elbow, 0.6, 1.0), radii["arm"])
        parts[f"{side}_forearm"] = (*_part(elbow, wrist, 0.15, 1.15), radii["forearm"])
        pairs += [(f"{side}_{part}", "trunk") for part in ("arm", "forearm", "shank")]
        pairs += [(f"{side}_forearm", "head"), (f"{side}_shank", "head"), (f"{side}_thigh", "head")]
        pairs += [(f"{side}_forearm", f"{other}_{part}") for other in SIDES for part in ("thigh", "shank")]
    pairs += [(f"left_{part}", f"right_{other}") for part in ("thigh", "shank") for other in ("thigh", "shank")]
    pairs += [(f"{a}_foot", f"{b}_shank") for a, b in (SIDES, SIDES[::-1])]
    return parts, [*pairs, ("left_foot", "right_foot"), ("left_forearm", "right_forearm")]


def _part(a: np.ndarray, b: np.ndarray, start: float, stop: float) -> tuple[np.ndarray, np.ndarray]:
    """Ends (T, 3) of the part from one fraction to another of the segments a-b."""
    return a + start * (b - a), a + stop * (b - a)


def _distance(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Distance of the segments a-b and c-d, ends (T, 3): (T,) (Ericson, Real-Time Collision Detection, 5.1.9)."""
    one, other, between = b - a, d - c, a - c
    dot = np.einsum
    aa, ee, bb = (dot("ti,ti->t", x, y) for x, y in ((one, one), (other, other), (one, other)))
    cc, ff = (dot("ti,ti->t", x, between) for x in (one, other))
    aa, ee = np.maximum(aa, 1e-12), np.maximum(ee, 1e-12)
    parallel = aa * ee - bb * bb
    s = np.where(parallel > 1e-12, np.clip((bb * ff - cc * ee) / np.maximum(parallel, 1e-12), 0, 1), 0.0)
    t = np.clip((bb * s + ff) / ee, 0, 1)
    s = np.clip((bb * t - cc) / aa, 0, 1)
    return np.linalg.norm(between + s[:, None] * one - t[:, None] * other, axis=-1)


# --- what can be measured of a motion that tells a sound one from a broken one ---


ANGLE_PERCENTILE = 99.0
"""Percentile of a joint's angle in time that is compared with its range, because single frames may be discontinuities."""

LEAST_BONE = 0.1
"""Length, over stature, to which changes of shorter bones are relative: some joints are points between others, as in a neck."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measures:
    """Figures of one motion, of its joints below 10 Hz at 60 frames per second unless stated otherwise."""

    duration_s: float
    stature_m: float
    activity_mps: float
    """Speed of the joints, mean over joints and time."""
    top_speed_mps: float
    """Greatest speed of any joint."""
    acceleration_mps2: float
    """Greatest acceleration of any joint, 99th percentile over time."""
    jerk_mps3: float
    """Root mean square of the jerk over joints and time."""
    jump_m: float
    """Greatest difference of a joint's step from one frame to the next from the mean of the steps before and after it, in the
    motion's own frames."""
    bone_change: float
    """Greatest relative change of a bone's length in the motion's own frames; of short bones over a tenth of the stature."""
    foot_skate_m: float
    """Farthest that a planted foot slides in one contact."""
    sliding_s: float
    """Longest time in which nothing that carries the body rests, beyond what a flight allows."""
    floating_s: float
    """Longest time off the floor, beyond what a flight with the same rise and fall lasts."""
    floor_penetration_m: float
    floor_offset_m: float
    """Height of the lowest planted foot over the floor."""
    self_penetration_m: float
    upside_down_fraction: float
    """Fraction of the time with the head below the hips and the ankles above."""
    mirrored: bool
    """Whether the feet point to the back, as where left and right are swapped."""
    angles_deg: dict[str, float]
    """Greatest angles of the joints, 99th percentile over time."""


def measure(motion: Motion) -> Measures:
    """All figures of a motion: z up, the floor at z = 0."""
    return measures_of(checked_motion(motion), tracks(motion))


def measures_of(motion: Motion, body: Tracks) -> Measures:
    """The figures that `measure` gives, from a motion and its tracks."""
    speed = np.linalg.norm(body.velocity, axis=-1)
    acceleration = rate_of(body.velocity)
    size = np.linalg.norm(acceleration, axis=-1)
    # Differences at the ends are one-sided, and a filter's effects at a record's ends are no motion.
    inner = slice(3, -3) if len(size) > 12 else slice(None)
    jerk = np.linalg.norm(rate_of(acceleration)[inner], axis=-1)
    planted = contacts(body)
    return Measures(
        duration_s=motion.duration_s,
        stature_m=body.stature_m,
        activity_mps=float(speed.mean()),
        top_speed_mps=float(speed.max()),
        acceleration_mps2=float(np.percentile(size[inner].max(axis=1), 99)),
        jerk_mps3=float(np.sqrt(np.mean(jerk**2))),
        jump_m=jump_m(motion.joints),
        bone_change=bone_change(motion, body.stature_m),
        foot_skate_m=max((contact.skate_m for contact in planted), default=0.0),
        sliding_s=sliding_s(body),
        floating_s=floating_s(body),
        floor_penetration_m=penetration_m(body),
        floor_offset_m=floor_offset_m(planted),
        self_penetration_m=float(np.percentile(self_penetration_m(body), ANGLE_PERCENTILE)),
        upside_down_fraction=upside_down_fraction(body),
        mirrored=mirrored(body),
        angles_deg={name: float(np.percentile(angle, ANGLE_PERCENTILE)) for name, angle in joint_angles(body).items()},
    )


def jump_m(joints: np.ndarray) -> float:
    """Greatest deviation of a step from the mean of its neighbours [m], of joints (T, J, 3); 0 for less than four frames."""
    if len(joints) < 4:
        return 0.0
    step = np.diff(joints, axis=0)
    return float(np.linalg.norm(step[1:-1] - 0.5 * (step[:-2] + step[2:]), axis=-1).max())


def bone_change(motion: Motion, stature_m: float) -> float:
    """Greatest deviation of a bone's length from its median, over the median or, if it is more, `LEAST_BONE` of the stature."""
    length = np.linalg.norm(motion.joints[:, 1:] - motion.joints[:, list(motion.parents[1:])], axis=-1)
    usual = np.median(length, axis=0)
    return float((np.abs(length - usual) / np.maximum(usual, LEAST_BONE * stature_m)).max())
