"""When feet stand, and how to keep them standing: contacts of heel and ball, and legs that follow them by inverse kinematics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.kinematics import INDEX, Poses
from t2d_rt.motion.limbs import LIMBS, STRETCH, Limb, reach

SIDES = "left", "right"

CONTACT_HEIGHT = 0.035
"""Height of heel or ball over where it stands, over stature's proxy (twice the leg), up to which it may be in contact."""

CONTACT_SPEED_MPS = 0.3
"""Speed of heel or ball up to which it is in contact; a planted foot of a recorded walk moves at 0.05 to 0.3 m/s, a swinging one at
2 m/s and more."""

SHORTEST_CONTACT_S = 0.06
LONGEST_GAP_S = 0.04
"""Contacts shorter than this are none, and gaps shorter than this are filled: noise of the detection."""


def soles(poses: Poses) -> np.ndarray:
    """Positions [m] of the heels and balls of both feet, (T, 2 sides, 2 heel and ball, 3).

    The heel lies as far below the ankle as the ball does in the rest pose, and a third as far behind it as the ball is ahead.
    """
    joints, rotations = poses.world()
    found = np.empty((len(poses), 2, 2, 3))
    for number, side in enumerate(SIDES):
        ankle, ball = INDEX[f"{side}_ankle"], INDEX[f"{side}_foot"]
        ahead = poses.skeleton.offsets[ball]
        heel = np.array([-ahead[0] / 3, ahead[1], ahead[2]])
        found[:, number, 0] = joints[:, ankle] + quaternions.rotate(rotations[:, ankle], heel)
        found[:, number, 1] = joints[:, ball]
    return found


def contacts(poses: Poses, *, speed_mps: float = CONTACT_SPEED_MPS) -> np.ndarray:
    """Whether heel and ball of each foot stand, bool (T, 2 sides, 2 heel and ball): low and slow, for more than a few frames."""
    points = soles(poses)
    level = np.percentile(points[..., 2], 5, axis=0)
    speed = np.linalg.norm(np.gradient(points, 1.0 / poses.rate_hz, axis=0), axis=-1)
    low = points[..., 2] - level < CONTACT_HEIGHT * 2 * poses.skeleton.leg_m
    found = low & (speed < speed_mps)
    for side in range(2):
        for part in range(2):
            found[:, side, part] = _tidied(found[:, side, part], poses.rate_hz)
    return found


def plant(poses: Poses, planted: np.ndarray, *, floor_m: float | None = None) -> Poses:
    """Poses whose feet do not slide while they stand: `planted` as `contacts` gives it, (T, 2, 2).

    While a foot stands, its pivot (the heel, then the ball) stays where it is on average over the contact; between contacts the
    correction fades from one to the next. floor_m: height [m] that heels and balls are brought to; by default each stands at the
    height at which it stands in the median. Where a leg is too short the pelvis is lowered.
    """
    points = soles(poses)
    joints, _ = poses.world()
    targets = {}
    for number, side in enumerate(SIDES):
        shift = _corrections(points[:, number], planted[:, number], poses.rate_hz, floor_m)
        targets[side] = joints[:, INDEX[f"{side}_ankle"]] + shift
    return follow(poses, targets)


def follow(poses: Poses, ankles: dict[str, np.ndarray]) -> Poses:
    """Poses whose ankles are at the given tracks (T, 3) [m] of "left" and "right"; the pelvis sinks where a leg is too short."""
    joints, _ = poses.world()
    drop = np.zeros(len(poses))
    for side, track in ankles.items():
        limb: Limb = "left_leg" if side == "left" else "right_leg"
        upper, middle, end = (INDEX[name] for name in LIMBS[limb])
        offsets = poses.skeleton.offsets
        most = STRETCH * float(np.linalg.norm(offsets[middle]) + np.linalg.norm(offsets[end]))
        way = joints[:, upper] - track
        level2 = np.minimum((way[:, :2] ** 2).sum(-1), 0.98 * most**2)
        drop = np.maximum(drop, way[:, 2] - np.sqrt(most**2 - level2))
    root = poses.root.copy()
    root[:, 2] -= _smooth_bound(drop, poses.rate_hz)
    poses = replace(poses, root=root)
    for side, track in ankles.items():
        poses, _ = reach(poses, "left_leg" if side == "left" else "right_leg", track)
    return poses


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """First frames and ends (one past the last) of the stretches where flags (T,) hold."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _tidied(flags: np.ndarray, rate_hz: float) -> np.ndarray:
    found = flags.copy()
    for start, stop in runs(~found):
        if 0 < start and stop < len(found) and stop - start <= LONGEST_GAP_S * rate_hz:
            found[start:stop] = True
    for start, stop in runs(found):
        if stop - start < SHORTEST_CONTACT_S * rate_hz:
            found[start:stop] = False
    return found


def _corrections(points: np.ndarray, planted: np.ndarray, rate_hz: float, floor_m: float | None) -> np.ndarray:
    """Shift (T, 3) of one foot that holds its pivots still: points (T, 2, 3) of heel and ball, planted (T, 2)."""
    stands = planted.any(axis=1)
    if not stands.any():
        return np.zeros((len(points), 3))
    # The ball is the pivot where it stands, else the heel; at the change the shift goes on without a jump.
    level = np.array([
        (np.median(points[planted[:, part], part, 2]) if planted[:, part].any() else 0.0) if floor_m is None else floor_m
        for part in range(2)
    ])  # fmt: skip
    above = np.where(planted[:, 1], points[:, 1, 2] - level[1], points[:, 0, 2] - level[0])
    step = np.where(planted[1:, 1:] & planted[:-1, 1:], np.diff(points[:, 1], axis=0), np.diff(points[:, 0], axis=0))
    shift = np.zeros((len(points), 3))
    found = runs(stands)
    for start, stop in found:
        moved = np.concatenate([np.zeros((1, 3)), np.cumsum(-step[start : stop - 1], axis=0)])
        shift[start:stop] = moved - moved.mean(axis=0)
        shift[start:stop, 2] -= (above[start:stop] + shift[start:stop, 2]).mean()
    _bridge(shift, found, rate_hz)
    return shift


def _bridge(shift: np.ndarray, found: list[tuple[int, int]], rate_hz: float) -> None:
    """Fill the gaps between stretches (and before the first, after the last) with cubics that meet their ends in value and slope."""

    def slope(at: int, low: int, high: int) -> np.ndarray:
        near = max(2, round(0.03 * rate_hz))
        first, last = max(low, at - near), min(high - 1, at + near)
        return (shift[last] - shift[first]) / max(last - first, 1)

    start, stop = found[0][0], found[-1][1]
    shift[:start] = shift[start]
    shift[stop:] = shift[stop - 1]
    for (low, end), (begin, high) in zip(found[:-1], found[1:], strict=True):
        span = begin - (end - 1)
        x = (np.arange(1, span) / span)[:, None]
        p, q, u, v = shift[end - 1], shift[begin], slope(end - 1, low, end) * span, slope(begin, begin, high) * span
        shift[end:begin] = (
            (2 * x**3 - 3 * x**2 + 1) * p + (x**3 - 2 * x**2 + x) * u + (3 * x**2 - 2 * x**3) * q + (x**3 - x**2) * v
        )


def _smooth_bound(needed: np.ndarray, rate_hz: float) -> np.ndarray:
    """A smooth track (T,) that is nowhere below `needed` and never negative: the greatest value near by, then a mean of like width."""
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    if not (needed > 0).any():
        return np.zeros_like(needed)
    width = 2 * max(1, round(0.08 * rate_hz)) + 1
    highest = maximum_filter1d(np.maximum(needed, 0.0), 2 * width + 1, mode="nearest")
    return uniform_filter1d(uniform_filter1d(highest, width, mode="nearest"), width, mode="nearest")
