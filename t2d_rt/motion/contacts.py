"""Find the contacts of heels and balls with the floor, and keep standing feet in place by inverse kinematics of the legs."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np

from t2d_rt.geometry.vectors import unit, vector_product
from t2d_rt.motion import quaternions
from t2d_rt.motion.kinematics import INDEX, PARENTS, Poses

# --- inverse kinematics of one arm or leg: two bones that bring a wrist or an ankle to a point, in closed form ---


Limb = Literal["left_leg", "right_leg", "left_arm", "right_arm"]

LIMBS: dict[Limb, tuple[str, str, str]] = {
    "left_leg": ("left_hip", "left_knee", "left_ankle"),
    "right_leg": ("right_hip", "right_knee", "right_ankle"),
    "left_arm": ("left_shoulder", "left_elbow", "left_wrist"),
    "right_arm": ("right_shoulder", "right_elbow", "right_wrist"),
}

STRETCH = 0.9995
"""Greatest distance between a limb's ends, over the length of its bones: at 1 its middle joint has no direction to bend in."""

FOLD = 0.25
"""Least distance between a limb's ends, over the length of its bones: the heel is at the buttock, the hand at the shoulder."""


def reach(poses: Poses, limb: Limb, targets: np.ndarray, *, pole: np.ndarray | None = None) -> tuple[Poses, np.ndarray]:
    """Poses whose ankle or wrist is at `targets` (T, 3) [m], and the distance (T,) [m] by which it misses them.

    pole: direction (T, 3) or (3,) in which the knee or elbow points; by default the present one. The ankle or wrist keeps its
        orientation in space. The law of cosines in the plane of target and pole gives the knee or elbow.
    """
    joints, rotations = poses.world()
    upper, middle, end = (INDEX[name] for name in LIMBS[limb])
    start = joints[:, upper]
    first = float(np.linalg.norm(poses.skeleton.offsets[middle]))
    second = float(np.linalg.norm(poses.skeleton.offsets[end]))
    span = targets - start
    distance = np.linalg.norm(span, axis=-1)
    length = np.clip(distance, FOLD * (first + second), STRETCH * (first + second))
    axis = span / np.maximum(distance, 1e-9)[:, None]
    # The side to bend to is found about the limb's present axis and turned with it: about the new axis, a nearly straight limb that
    # turns far would change sides. A given pole is projected along the new axis.
    now = axis if pole is not None else unit(joints[:, end] - start)
    aside = joints[:, middle] - start if pole is None else np.broadcast_to(pole, span.shape)
    square = aside - (aside * now).sum(-1, keepdims=True) * now
    size = np.linalg.norm(square, axis=-1, keepdims=True)
    # A straight limb shows no side to bend to: the forward axis of the thigh and the backward axis of the upper arm do. A recorded
    # knee that is bent the wrong way is a straight one with noise.
    spare = quaternions.rotate(rotations[:, upper], np.array([1.0 if limb.endswith("leg") else -1.0, 0.0, 0.0]))
    spare = unit(spare - (spare * now).sum(-1, keepdims=True) * now)
    aside_of = size / (first + second)
    weight = np.clip(20 * aside_of, 0.0, 1.0)
    if pole is None:
        agrees = np.clip(2 * (unit(square) * spare).sum(-1, keepdims=True), 0.0, 1.0)
        weight = np.maximum(agrees * weight, np.clip(10 * aside_of - 1, 0.0, 1.0))
    side = quaternions.rotate(quaternions.between(now, axis), unit(weight * unit(square) + (1 - weight) * spare))
    along = (length**2 + first**2 - second**2) / (2 * length)
    height = np.sqrt(np.maximum(first**2 - along**2, 0.0))
    knee = start + along[:, None] * axis + height[:, None] * side
    reached = start + length[:, None] * axis
    world = rotations.copy()
    world[:, upper] = _swing(joints[:, middle] - start, knee - start, rotations[:, upper])
    carried = quaternions.multiply(world[:, upper], quaternions.conjugate(rotations[:, upper]))
    shank = quaternions.rotate(carried, joints[:, end] - joints[:, middle])
    world[:, middle] = _swing(shank, reached - knee, quaternions.multiply(carried, rotations[:, middle]))
    local = poses.local.copy()
    for joint in (upper, middle, end):
        local[:, joint] = quaternions.multiply(quaternions.conjugate(world[:, PARENTS[joint]]), world[:, joint])
    return replace(poses, local=quaternions.continuous(local)), np.linalg.norm(targets - reached, axis=-1)


def _swing(bone: np.ndarray, new_bone: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    return quaternions.multiply(quaternions.between(bone, new_bone), rotation)


# --- contacts of heel and ball with the floor, and legs that keep standing feet in place by inverse kinematics ---


SIDES = "left", "right"

CONTACT_HEIGHT = 0.025
"""Height above its 5th percentile up to which a heel or ball may be in contact, over twice the leg (a proxy of the stature)."""

CONTACT_SPEED_MPS = 0.2
"""Horizontal speed of heel or ball up to which it is in contact; a planted foot of a recorded walk moves at 0.02 to 0.2 m/s, a
swinging one at 2 m/s and more."""

LEAVING_MPS = 0.45
"""Horizontal speed up to which the frames before and after a contact belong to it; a swinging foot reaches it within 0.05 s."""

TWIST_S, TWIST_MPS = 0.1, 0.7
"""Longest time for which a low foot in contact may be faster than that, and its greatest speed then: walkers twist it over its ball
in pushing off, at 0.45 to 0.6 m/s, and then rest on its toe. Dancers who swivel a foot to another place reach 2 m/s, and a swing
near the floor lasts 0.3 s and more."""

FADE_S = 0.15
"""Time within which the slope of a foot's correction dies out after the foot leaves the ground, and builds up before it lands."""

SUPPORT = 0.996
"""Greatest length of a leg that follows a track, over that of its bones: the knee of a straighter one would move 20 times as far as
its ankle."""

LEAP_S = 0.1
"""Shortest time between two contacts of a foot; hops take 0.2 s and more."""

RAISED_RAD = 0.35
"""Greatest angle by which a heel is raised for a leg that is too short for its step."""

GIVE = 0.004
"""Depth, over twice the leg, to which heel, ball and toe may sink below the floor, because shoe and flesh are soft."""

SHORTEST_CONTACT_S = 0.06
LONGEST_GAP_S = 0.04
"""Contacts shorter than the first are dropped, and gaps up to the second are filled, as noise of the detection."""


def soles(poses: Poses) -> np.ndarray:
    """Positions [m] of the heels and balls of both feet, (T, 2 sides, 2 heel and ball, 3).

    The heel lies as far below the ankle as the ball does in the rest pose, and a third as far behind it as the ball is ahead.
    """
    joints, rotations = poses.world()
    positions = np.empty((len(poses), 2, 2, 3))
    for number, side in enumerate(SIDES):
        ankle, ball = INDEX[f"{side}_ankle"], INDEX[f"{side}_foot"]
        ahead = poses.skeleton.offsets[ball]
        heel = np.array([-ahead[0] / 3, ahead[1], ahead[2]])
        positions[:, number, 0] = joints[:, ankle] + quaternions.rotate(rotations[:, ankle], heel)
        positions[:, number, 1] = joints[:, ball]
    return positions


def contacts(poses: Poses, *, speed_mps: float = CONTACT_SPEED_MPS) -> np.ndarray:
    """Whether heel and ball of each foot stand, bool (T, 2 sides, 2 heel and ball): low and slow for `SHORTEST_CONTACT_S`."""
    low, velocity = _low_and_velocity(poses)
    standing = low & (np.linalg.norm(velocity[..., :2], axis=-1) < speed_mps)
    for side in range(2):
        for part in range(2):
            standing[:, side, part] = _tidied(standing[:, side, part], poses.rate_hz)
    return standing


def grown(poses: Poses, planted: np.ndarray) -> np.ndarray:
    """Contacts (T, 2, 2) extended by the frames before and after in which the heel or ball is low and slower than `LEAVING_MPS`.

    Feet in recordings drift while they stand and settle slowly: frames left out of a contact slide when steps are made longer.
    """
    low, velocity = _low_and_velocity(poses)
    speed = np.linalg.norm(velocity[..., :2], axis=-1)
    # A foot that goes up or down faster is taking off for a jump or landing from one.
    slow = (speed < LEAVING_MPS) & (np.abs(velocity[..., 2]) < CONTACT_SPEED_MPS)
    near, twists = (low & slow) | planted, low & (speed < TWIST_MPS)
    extended = planted.copy()
    for side in range(2):
        for part in range(2):
            for start, stop in runs(_with_twists(near[:, side, part], twists[:, side, part], poses.rate_hz)):
                extended[start:stop, side, part] = planted[start:stop, side, part].any()
    return extended


def _with_twists(near: np.ndarray, twists: np.ndarray, rate_hz: float) -> np.ndarray:
    """Flags (T,) with those gaps of up to `TWIST_S` filled in which `twists` (T,) holds throughout."""
    filled = near.copy()
    for start, stop in runs(~near):
        if start > 0 and stop < len(near) and stop - start <= TWIST_S * rate_hz and twists[start:stop].all():
            filled[start:stop] = True
    return filled


def _low_and_velocity(poses: Poses) -> tuple[np.ndarray, np.ndarray]:
    """Whether heels and balls are low enough to stand, (T, 2, 2), and their velocities [m/s], (T, 2, 2, 3)."""
    points = soles(poses)
    level = np.percentile(points[..., 2], 5, axis=0)
    low = points[..., 2] - level < CONTACT_HEIGHT * 2 * poses.skeleton.leg_m
    return low, np.gradient(points, 1.0 / poses.rate_hz, axis=0)


def plant(poses: Poses, planted: np.ndarray, *, floor_m: float | None = None, level: bool = True) -> Poses:
    """Poses whose feet do not slide while they stand; `planted` is (T, 2, 2), as `contacts` gives it.

    While a foot stands, its pivot (the heel, then the ball) stays at its mean place in the middle half of the contact; between
    contacts the correction passes from one to the next. Heights change by one constant per contact, so that feet roll as before.
    floor_m: height [m] at which the lower of heel and ball stands, and below which no foot goes deeper than `GIVE`; by default
    each stands at its own median height. level: whether each contact is brought to that height. Where a leg is too short, its
    heel is raised and then the pelvis lowered.
    """
    points = soles(poses)
    joints, _ = poses.world()
    targets = {}
    for number, side in enumerate(SIDES):
        shift = _corrections(points[:, number], planted[:, number], poses.rate_hz, floor_m)
        if not level:
            shift[:, 2] = 0.0
        if floor_m is not None:
            shift[:, 2] += _lift(poses, side, points[:, number], shift[:, 2], floor_m)
        track = joints[:, INDEX[f"{side}_ankle"]] + shift
        heel_only = planted[:, number, 0] & ~planted[:, number, 1]
        poses, targets[side] = _tiptoe(poses, side, track, ~heel_only)
    return follow(poses, targets)


def steadying(values: np.ndarray, stands: np.ndarray, rate_hz: float) -> np.ndarray:
    """Corrections (T, N) that hold `values` (T, N), while a foot `stands` (T,), at what they are in the middle of the contact;
    between contacts they pass from one to the next."""
    # A foot that is off the floor only briefly, as at a seam, would have to turn round in that time.
    shift, stretches = np.zeros_like(values), runs(_tidied(stands, rate_hz, LEAP_S))
    for start, stop in stretches:
        shift[start:stop] = values[(start + stop) // 2] - values[start:stop]
    if stretches:
        _bridge(shift, stretches, rate_hz)
    return shift


def follow(poses: Poses, ankles: dict[str, np.ndarray]) -> Poses:
    """Poses whose ankles follow the given tracks (T, 3) [m] of "left" and "right"; the pelvis sinks where a leg is too short."""
    joints, _ = poses.world()
    drop = np.zeros(len(poses))
    for side, track in ankles.items():
        limb: Limb = "left_leg" if side == "left" else "right_leg"
        upper = INDEX[LIMBS[limb][0]]
        most = SUPPORT * _leg_m(poses, side)
        span = joints[:, upper] - track
        level2 = np.minimum((span[:, :2] ** 2).sum(-1), 0.98 * most**2)
        drop = np.maximum(drop, span[:, 2] - np.sqrt(most**2 - level2))
    root = poses.root.copy()
    root[:, 2] -= _smooth_bound(drop, poses.rate_hz, 0.08)
    poses = replace(poses, root=root)
    for side, track in ankles.items():
        poses, _ = reach(poses, "left_leg" if side == "left" else "right_leg", track)
    return poses


def _lift(poses: Poses, side: str, points: np.ndarray, shift: np.ndarray, floor_m: float) -> np.ndarray:
    """Further rise (T,) [m] of an ankle that keeps heel, ball and toe from sinking deeper than `GIVE` into the floor."""
    toe = poses.joint(f"{side}_toe")[:, 2]
    level = floor_m - GIVE * 2 * poses.skeleton.leg_m
    lowest = np.minimum(points[..., 2].min(axis=1), toe) + shift
    return _smooth_bound(level - lowest, poses.rate_hz, 0.03)


def _tiptoe(poses: Poses, side: str, track: np.ndarray, free: np.ndarray) -> tuple[Poses, np.ndarray]:
    """Poses in which the heel is raised about the ball, by up to `RAISED_RAD`, where the leg is too short for the ankle's track
    (T, 3) [m] and the foot is `free` (T,) to; and the ankle's track then."""
    joints, rotations = poses.world()
    ankle, hip = INDEX[f"{side}_ankle"], INDEX[f"{side}_hip"]
    foot = rotations[:, ankle]
    arm = -quaternions.rotate(foot, np.broadcast_to(poses.skeleton.offsets[INDEX[f"{side}_foot"]], track.shape))
    hinge = quaternions.rotate(foot, np.array([0.0, 1.0, 0.0]))
    span = joints[:, hip] - track
    distance = np.linalg.norm(span, axis=-1)
    gain = np.maximum((vector_product(hinge, arm) * span).sum(-1) / distance, 0.25 * np.linalg.norm(arm, axis=-1))
    excess = np.where(free, distance - SUPPORT * _leg_m(poses, side), 0.0)
    angle = np.minimum(_smooth_bound(np.maximum(excess, 0.0) / gain, poses.rate_hz, 0.04), RAISED_RAD)
    spin = quaternions.about_axis(hinge, angle)
    local = poses.local.copy()
    turned = quaternions.multiply(spin, foot)
    local[:, ankle] = quaternions.multiply(quaternions.conjugate(rotations[:, INDEX[f"{side}_knee"]]), turned)
    # The ball's own orientation stays: toes keep lying on the floor.
    ball = INDEX[f"{side}_foot"]
    local[:, ball] = quaternions.multiply(quaternions.conjugate(turned), rotations[:, ball])
    return replace(poses, local=local), track - arm + quaternions.rotate(spin, arm)


def _leg_m(poses: Poses, side: str) -> float:
    return poses.skeleton.bone_m(f"{side}_knee") + poses.skeleton.bone_m(f"{side}_ankle")


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """First frames and ends (one past the last) of the stretches where flags (T,) hold."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _tidied(flags: np.ndarray, rate_hz: float, gap_s: float = LONGEST_GAP_S) -> np.ndarray:
    """Flags (T,) in which gaps that are too short are filled, and then runs that are too short are removed."""
    tidied = flags.copy()
    for start, stop in runs(~tidied):
        if start > 0 and stop < len(tidied) and stop - start <= gap_s * rate_hz:
            tidied[start:stop] = True
    for start, stop in runs(tidied):
        if stop - start < SHORTEST_CONTACT_S * rate_hz:
            tidied[start:stop] = False
    return tidied


def _corrections(points: np.ndarray, planted: np.ndarray, rate_hz: float, floor_m: float | None) -> np.ndarray:
    """Shift (T, 3) [m] of a foot that holds its pivots in place, from points (T, 2, 3) of heel and ball and `planted` (T, 2)."""
    # A foot that is off the floor only briefly, as at a seam, would have to leap to its next place.
    stands = _tidied(np.asarray(planted.any(axis=1)), rate_hz, LEAP_S)
    if not stands.any():
        return np.zeros((len(points), 3))
    # The ball is the pivot where it stands, else the heel; at the change the shift goes on without a jump.
    heights_m = [np.median(points[on, part, 2]) if on.any() else 0.0 for part, on in enumerate(planted.T)]
    above = (points[..., 2] - np.array(heights_m if floor_m is None else [floor_m, floor_m])).min(axis=1)
    step = np.where(planted[1:, 1:] & planted[:-1, 1:], np.diff(points[:, 1], axis=0), np.diff(points[:, 0], axis=0))
    shift = np.zeros((len(points), 3))
    stretches = runs(stands)
    for start, stop in stretches:
        moved = np.concatenate([np.zeros((1, 3)), np.cumsum(-step[start : stop - 1], axis=0)])
        quarter = (stop - start) // 4
        shift[start:stop] = moved - moved[quarter : stop - start - quarter].mean(axis=0)
        shift[start:stop, 2] = -np.median(above[start:stop])
    _bridge(shift, stretches, rate_hz)
    return shift


def _bridge(shift: np.ndarray, stretches: list[tuple[int, int]], rate_hz: float) -> None:
    """Fill the gaps between stretches, and what is before the first and after the last.

    The shift eases from one end to the other; its slope at either end dies out within `FADE_S`: value and slope are continuous.
    """
    near = max(1, round(0.025 * rate_hz))
    ends = [
        (0, None, stretches[0]),
        *((low[1], low, high) for low, high in pairwise(stretches)),
        (stretches[-1][1], stretches[-1], None),
    ]
    for start, before, after in ends:
        stop = len(shift) if after is None else after[0]
        if stop == start:
            continue
        at = np.arange(start, stop)
        p = shift[before[1] - 1] if before else shift[after[0]]  # type: ignore[index]
        q = shift[after[0]] if after else p
        x = (at - (start - 1)) / (stop - (start - 1))
        bridged = p + (10 * x**3 - 15 * x**4 + 6 * x**5)[:, None] * (q - p)
        fade = max(2.0, min(FADE_S * rate_hz, (stop - start + 1) * (0.5 if before and after else 1.0)))
        if before:
            last = before[1] - 1
            slope = (shift[last] - shift[max(before[0], last - near)]) / max(min(near, last - before[0]), 1)
            bridged += _dying(at - last, fade)[:, None] * slope
        if after:
            first = after[0]
            slope = (shift[min(after[1] - 1, first + near)] - shift[first]) / max(min(near, after[1] - 1 - first), 1)
            bridged -= _dying(first - at, fade)[:, None] * slope
        shift[start:stop] = bridged


def _dying(frames: np.ndarray, within: float) -> np.ndarray:
    """Path (T,) of unit slope at 0 that comes back to 0, with slope 0, at `within` frames: t (1 - t / within)^2."""
    return frames * np.clip(1 - frames / within, 0.0, 1.0) ** 2


def _smooth_bound(needed: np.ndarray, rate_hz: float, reach_s: float) -> np.ndarray:
    """Smooth track (T,) that is nowhere below `needed` (T,) nor negative: the greatest value near by, averaged twice."""
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    if not (needed > 0).any():
        return np.zeros_like(needed)
    width = 2 * max(1, round(reach_s * rate_hz)) + 1
    highest = maximum_filter1d(np.maximum(needed, 0.0), 2 * width + 1, mode="nearest")
    return uniform_filter1d(uniform_filter1d(highest, width, mode="nearest"), width, mode="nearest")
