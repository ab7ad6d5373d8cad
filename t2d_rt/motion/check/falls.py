"""Falls from the head's trajectory: how far, how fast and how low the head and the pelvis come down, and whether they stay there.

A fall is a descent from standing, walking or sitting to the floor that muscles do not hold back. It differs from a jump, a squat or
a bend by the rest on the floor, from lying, kneeling or sitting down on purpose by the speed of the descent, and from a roll or a
cartwheel by a trunk that does not turn over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from t2d_rt.geometry.vectors import unit
from t2d_rt.motion.check.measures import (
    GRAVITY_MPS2,
    HEAD_STANDING,
    HIPS_STANDING,
    RATE_HZ,
    Tracks,
    angle_deg,
    rate_of,
    spans,
    tracks,
)
from t2d_rt.types.motion import Motion, checked_motion

Direction = Literal["forward", "backward", "left", "right", "down"]
EndState = Literal[
    "lying on the back", "lying face down", "lying on the side", "sitting", "on hands and knees", "kneeling", "falling"
]

LOW_HEAD, LOW_HIPS = 0.62, 0.62
"""Heights of head and hips, over those of standing, below which a body is on the floor. The head of a person who sits there is at
0.55, the hips on hands and knees are at 0.55; in a squat the head is at 0.7, in a bend the hips at 0.9, on a chair both higher."""

KNEE_ON_FLOOR = 0.09
"""Height of the knee's joint over stature below which a knee rests on the floor."""

SEATED_HIPS, ARM_ON_FLOOR = 0.28, 0.08
"""Height of the hips, over that of standing, below which the seat is on the floor (joints 5 to 10 cm above it; 0.35 and more in the
deepest squat), and height of elbow or wrist, over stature, below which an arm is."""

LEAST_DROP = 0.25
"""Least drop of the head and of the hips, over their standing heights."""

LEAST_SPEED = 0.50
"""Least sum of head's and hips' greatest downward speeds, each over the speed of free fall from its standing height. Measured
falls have 0.54 + 0.51 (Choi, Wakeling and Robinovitch 2015: head 2.91 +- 0.86, pelvis 2.14 +- 0.63 m/s); lying down on purpose
in 2 s has at most 0.25 + 0.15."""

LEAST_LAST_SPEED, LAST = 0.40, 0.15
"""Least sum of these speeds within the last 15 % of the drop of each: a fall is fast until the floor stops it; a person who sits or
lies down, however fast, is slow by then (a minimum-jerk movement has two thirds of its greatest speed left)."""

STILL_FALLING = 0.15
"""Sum of these speeds at the record's last frame above which the body has not come to rest."""

LEAST_CUT_SPEED = 0.35
"""Least sum of these speeds at the end of a record that ends before the falling body reaches the floor."""

STAY_S = 0.6
"""Least time of rest on the floor; after landing from a jump the body leaves it sooner."""

OVER_DEG, AFTER_ROLL_S = 270.0, 1.5
"""Turn of the trunk in a vertical plane from which the descent is a roll, unless the body lies that long after it."""

BEFORE_S = 3.0
"""Time before the floor is reached; drops of head and hips count from their greatest heights in it."""

IMPACT_FRACTION = 0.25
"""Fraction of the hips' greatest downward speed below which the floor has stopped them."""

BASE = 0.06
"""Horizontal distance over stature of the centre of mass from the line between the feet, up to which they hold it."""

DOWN = 0.2
"""Horizontal distance over stature of the head from the feet, up to which a fall goes straight down."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FallFinding:
    """Whether a motion holds a fall, and its course; figures are None where there is none."""

    happened: bool
    reason: str
    """One sentence: what was found, with its figures."""
    loss_of_balance_s: float | None = None
    """Time at which the centre of mass leaves the feet for good, or the descent begins, whichever is first."""
    descent_s: float | None = None
    """Time at which the head begins to come down."""
    impact_s: float | None = None
    """Time at which the hips are stopped, or the head if it is first."""
    head_impact_mps: float | None = None
    """Greatest downward speed of the head."""
    pelvis_impact_mps: float | None = None
    """Greatest downward speed of the middle of the hips."""
    direction: Direction | None = None
    """Direction of the head from the feet, as seen by the person before the fall."""
    end_state: EndState | None = None
    """Posture in which the fall ends, or "falling" if the record ends before."""
    got_up_s: float | None = None
    """Time at which the person stands again, if that is in the record."""

    @property
    def descent_time_s(self) -> float | None:
        """Time from the beginning of the descent to the impact [s]."""
        return None if self.impact_s is None or self.descent_s is None else self.impact_s - self.descent_s


@dataclass(frozen=True, slots=True)
class _Heights:
    """Heights (T,) of head and hips over their standing heights, and their upward speeds over those of free fall from there."""

    head: np.ndarray
    hips: np.ndarray
    head_speed: np.ndarray
    hips_speed: np.ndarray
    head_free_mps: float
    hips_free_mps: float


LOWEST_LANDING_M, SAME_FLOOR_M, UPRIGHT_HEAD = 0.3, 0.12, 0.7
"""Least height of another floor, two treads; greatest distance of feet from their floor; least height of an upright body's head
over its feet, over stature."""


@dataclass(frozen=True, slots=True)
class _Descent:
    """Frames of one descent."""

    start: int
    impact: int
    floor: int
    """First frame on the floor, or the record's last frame."""
    stop: int
    """One past the last frame on the floor."""
    speed: float
    """Sum of the greatest downward speeds of head and hips, over free fall."""
    last_speed: float
    """That sum within the last part of their drops."""


def detect_fall(motion: Motion) -> FallFinding:
    """The first fall in a motion, or why there is none. z is up and the floor at z = 0."""
    return fall_in(tracks(checked_motion(motion)))


def fall_in(body: Tracks) -> FallFinding:
    """The fall that `detect_fall` finds, from tracks in place of a motion."""
    body = replace(body, joints=body.joints - [0.0, 0.0, _landing_m(body)])
    heights = _heights(body)
    refused = "the head never comes down to the floor"
    for start, stop in spans(_on_floor(body, heights), gap=round(0.3 * RATE_HZ)):
        descent = _descent(heights, start, stop)
        refusal = _refusal(body, heights, descent)
        if refusal is None:
            return _finding(body, heights, descent)
        refused = refusal if start else refused
    cut = _cut_short(body, heights)
    return FallFinding(happened=False, reason=refused) if cut is None else _finding(body, heights, cut)


def _landing_m(body: Tracks) -> float:
    """Height of the floor at the end [m] if somebody climbed to another one and stood on it, else 0."""
    lowest = body.joints[..., 2].min(axis=1)
    level = float(np.median(lowest[-round(RATE_HZ) :]))
    upright = body["head"][:, 2] - lowest > UPRIGHT_HEAD * body.stature_m
    stood = upright & (np.abs(lowest - level) < SAME_FLOOR_M)
    return level if level > LOWEST_LANDING_M and np.count_nonzero(stood) > 0.3 * RATE_HZ else 0.0


def _heights(body: Tracks) -> _Heights:
    head_m, hips_m = HEAD_STANDING * body.stature_m, HIPS_STANDING * body.stature_m
    head_free, hips_free = (math.sqrt(2 * GRAVITY_MPS2 * height) for height in (head_m, hips_m))
    head, hips = body["head"][:, 2], body["hips"][:, 2]
    return _Heights(
        head / head_m, hips / hips_m, rate_of(head) / head_free, rate_of(hips) / hips_free, head_free, hips_free
    )


def _on_floor(body: Tracks, heights: _Heights) -> np.ndarray:
    """Mask (T,) of frames in which more than the feet rests on the floor: seat, both knees, or a knee, hand or elbow with the
    centre of mass off the feet.

    A deep squat, a lunge and a landing are as low, but the feet hold them.
    """
    knees = np.stack([body[f"{side}_knee"][:, 2] for side in ("left", "right")]) < KNEE_ON_FLOOR * body.stature_m
    arms = np.min([body[f"{side}_{joint}"][:, 2] for side in ("left", "right") for joint in ("elbow", "wrist")], axis=0)
    beyond = _beyond_feet(body) > BASE * body.stature_m
    limbs = (knees.any(axis=0) | (arms < ARM_ON_FLOOR * body.stature_m)) & beyond
    low = (heights.head < LOW_HEAD) & ((heights.hips < SEATED_HIPS) | limbs)
    return (heights.hips < LOW_HIPS) & (low | knees.all(axis=0))


def _descent(heights: _Heights, floor: int, stop: int) -> _Descent:
    first = max(0, floor - round(BEFORE_S * RATE_HZ))
    after = min(len(heights.head), floor + round(0.8 * RATE_HZ))
    fastest = first + int(np.argmin((heights.head_speed + heights.hips_speed)[first:after]))
    rising = np.flatnonzero(heights.head_speed[first : fastest + 1] > -0.02)
    start = first + int(rising[-1]) if len(rising) else first
    last = sum(
        _last_speed(height, speed, start, after)
        for height, speed in ((heights.head, heights.head_speed), (heights.hips, heights.hips_speed))
    )
    return _Descent(start, _impact(heights, fastest, after), floor, stop, _speed(heights, start, after), last)


def _last_speed(height: np.ndarray, speed: np.ndarray, start: int, after: int) -> float:
    """Greatest downward speed of a joint within the last part of its drop."""
    lowest = start + int(np.argmin(height[start:after]))
    level = height[lowest] + LAST * (height[start : lowest + 1].max() - height[lowest])
    above = np.flatnonzero(height[start : lowest + 1] >= level)
    return -float(speed[start + int(above[-1]) : lowest + 1].min())


def _speed(heights: _Heights, start: int, after: int) -> float:
    return -float(heights.head_speed[start:after].min() + heights.hips_speed[start:after].min())


def _impact(heights: _Heights, fastest: int, after: int) -> int:
    """First frame at which hips or head are stopped, each after its own greatest downward speed."""
    stops = []
    for speed in (heights.hips_speed, heights.head_speed):
        begin = max(0, fastest - round(0.3 * RATE_HZ))
        peak = begin + int(np.argmin(speed[begin:after]))
        stopped = np.flatnonzero(speed[peak:] > IMPACT_FRACTION * speed[peak])
        stops.append(peak + int(stopped[0]) if len(stopped) else len(speed) - 1)
    return max(fastest, min(stops))


def _refusal(body: Tracks, heights: _Heights, descent: _Descent) -> str | None:
    """A clause that says why a stay on the floor is no fall; None if it is one."""
    before = slice(max(0, descent.floor - round(BEFORE_S * RATE_HZ)), descent.floor + 1)
    on_floor = slice(descent.floor, descent.stop)
    drops = (height[before].max() - height[on_floor].min() for height in (heights.head, heights.hips))
    if min(drops) < LEAST_DROP:
        return "the body is low from the beginning on and does not come down"
    if descent.speed < LEAST_SPEED or descent.last_speed < LEAST_LAST_SPEED:
        head, hips = _downward_mps(heights, descent)
        return f"the descent is controlled: head {head:.2f} m/s, hips {hips:.2f} m/s downward"
    stay_s = (descent.stop - descent.floor) / RATE_HZ
    if descent.stop < len(heights.head) and stay_s < STAY_S:
        return f"the body leaves the floor again after {stay_s:.2f} s"
    turned_deg = _turn_deg(body, descent)
    if turned_deg > OVER_DEG and stay_s < AFTER_ROLL_S:
        return f"the trunk goes over by {turned_deg:.0f} degrees and the body gets up: a roll"
    return None


def _turn_deg(body: Tracks, descent: _Descent) -> float:
    """Greatest turn of the trunk in one vertical plane during a descent and the stay after it [degrees].

    The plane is the one in which the trunk moves most, so that forward rolls and cartwheels count alike.
    """
    trunk = body.trunk[descent.start : min(len(body.trunk), descent.stop + round(0.5 * RATE_HZ))]
    spread = trunk[:, :2] - trunk[:, :2].mean(axis=0)
    axis = np.linalg.svd(spread, full_matrices=False)[2][0]
    angle = np.unwrap(np.arctan2(trunk[:, :2] @ axis, trunk[:, 2]))
    return float(np.degrees(np.abs(angle - angle[0]).max()))


def _cut_short(body: Tracks, heights: _Heights) -> _Descent | None:
    """A fall that is under way when the record ends: fast, tilted, the centre of mass beyond the feet."""
    last = len(heights.head) - 1
    first = max(0, last - round(1.5 * RATE_HZ))
    falling = -(heights.head_speed[last] + heights.hips_speed[last])
    dropped = heights.head[first:].max() - heights.head[last]
    tilted = angle_deg(body.trunk[last], np.array([0.0, 0.0, 1.0])) > 30
    beyond = _beyond_feet(body)[last] > 2 * BASE * body.stature_m
    if not (falling > LEAST_CUT_SPEED and dropped > LEAST_DROP and heights.hips[last] < 0.85 and tilted and beyond):
        return None
    rising = np.flatnonzero(heights.head_speed[first:] > -0.02)
    start = first + int(rising[-1]) if len(rising) else first
    speed = _speed(heights, start, last + 1)
    return _Descent(start, last, last, last + 1, speed, speed)


def _beyond_feet(body: Tracks) -> np.ndarray:
    """Horizontal distances (T,) [m] of the centre of mass from the segment between the feet."""
    left, right = (0.5 * (body[f"{side}_ankle"] + body[f"{side}_foot"])[:, :2] for side in ("left", "right"))
    across = right - left
    along = np.sum((body.centre_of_mass[:, :2] - left) * across, axis=-1) / np.maximum(np.sum(across**2, axis=-1), 1e-9)
    nearest = left + np.clip(along, 0, 1)[:, None] * across
    return np.linalg.norm(body.centre_of_mass[:, :2] - nearest, axis=-1)


def _downward_mps(heights: _Heights, descent: _Descent) -> tuple[float, float]:
    """Greatest downward speeds of head and hips [m/s] from the beginning of the descent to 0.8 s after both floor and impact."""
    span = slice(descent.start, max(descent.floor, descent.impact) + round(0.8 * RATE_HZ))
    return (
        -float(heights.head_speed[span].min()) * heights.head_free_mps,
        -float(heights.hips_speed[span].min()) * heights.hips_free_mps,
    )


def _finding(body: Tracks, heights: _Heights, descent: _Descent) -> FallFinding:
    head, hips = _downward_mps(heights, descent)
    held = np.flatnonzero(_beyond_feet(body)[: descent.impact + 1] < BASE * body.stature_m)
    balance = min(int(held[-1]) if len(held) else 0, descent.start)
    cut = descent.stop == len(heights.head) and -(heights.head_speed[-1] + heights.hips_speed[-1]) > STILL_FALLING
    state: EndState = "falling" if cut else _end_state(body, heights, descent)
    upright = np.flatnonzero(heights.head[descent.stop :] > 0.85)
    direction = _direction(body, descent)
    where = (
        "straight down"
        if direction == "down"
        else {"left": "to the left", "right": "to the right"}.get(direction, direction)
    )
    return FallFinding(
        happened=True,
        reason=f"falls {where} at {descent.start / RATE_HZ:.2f} s, head {head:.2f} m/s, hips {hips:.2f} m/s downward, "
        + ("and the record ends before the floor" if cut else f"and ends {state}"),
        loss_of_balance_s=balance / RATE_HZ,
        descent_s=descent.start / RATE_HZ,
        impact_s=descent.impact / RATE_HZ,
        head_impact_mps=head,
        pelvis_impact_mps=hips,
        direction=direction,
        end_state=state,
        got_up_s=(descent.stop + int(upright[0])) / RATE_HZ if len(upright) else None,
    )


def _direction(body: Tracks, descent: _Descent) -> Direction:
    """Direction of the head from the feet after the impact, relative to where the person faced before the descent."""
    after = min(len(body.joints) - 1, descent.impact + round(0.1 * RATE_HZ))
    ahead = unit(body.facing[max(0, descent.start - round(0.3 * RATE_HZ)) : descent.start + 1].mean(axis=0))
    offset = (body["head"] - body["ankles"])[after] * [1, 1, 0]
    if np.linalg.norm(offset) < DOWN * body.stature_m:
        return "down"
    forward, left = float(offset @ ahead), float(offset @ np.array([-ahead[1], ahead[0], 0.0]))
    if abs(forward) >= abs(left):
        return "forward" if forward > 0 else "backward"
    return "left" if left > 0 else "right"


def _end_state(body: Tracks, heights: _Heights, descent: _Descent) -> EndState:
    """Posture in the last half second on the floor, or in that which ends 1.5 s after the impact if it is earlier."""
    stop = min(descent.stop, descent.impact + round(1.5 * RATE_HZ))
    rest = slice(max(descent.floor, stop - round(0.5 * RATE_HZ)), stop)
    head, hips = float(np.median(heights.head[rest])), float(np.median(heights.hips[rest]))
    trunk = unit(np.median(body.trunk[rest], axis=0))
    across = np.median((body["left_shoulder"] - body["right_shoulder"])[rest], axis=0)
    chest = unit(np.cross(across, trunk))
    if trunk[2] < 0.5 and hips < 0.4:
        if abs(chest[2]) < 0.5:
            return "lying on the side"
        return "lying on the back" if chest[2] > 0 else "lying face down"
    if hips < 0.4:
        return "sitting"
    return "on hands and knees" if head < LOW_HEAD else "kneeling"
