"""Place motions in front of the radar (`place`), extend them by their cycles (`repeat`) and summarise them (`describe`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, flag, number, positive
from t2d_rt.core.errors import InputError
from t2d_rt.motion import quaternions
from t2d_rt.motion.interpolate import MOST_NUMBERS, compose, decompose, minimum_jerk, trim
from t2d_rt.motion.kinematics import facing, stature_m
from t2d_rt.types.motion import Motion, checked_motion

FARTHEST_M = 10_000.0
"""Greatest distance of the start that `place` takes [m]."""

PLACED = "placed "
"""Beginning of the clause that `place` writes into a motion's report."""

CLOSEST_APPROACH_M = 1.5
"""Horizontal distance of the nearest joint to the radar that `place` keeps if no distance is given."""

TRAVEL_M = 0.5
"""Motions whose pelvis ends nearer than this to its start do not travel: they are placed by the direction that the body faces."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionInfo:
    """Duration, size and speeds of a motion."""

    duration_s: float
    frames: int
    rate_hz: float
    stature_m: float
    """Stature estimated from bone lengths [m], within 5 %."""
    travelled_m: float
    """Length of the pelvis's horizontal track."""
    mean_speed_mps: float
    """`travelled_m` over the duration [m/s]."""
    top_speed_mps: float
    top_speed_joint: str

    def __str__(self) -> str:
        return (
            f"{self.duration_s:.2f} s, {self.frames} frames at {self.rate_hz:g} Hz, "
            f"stature about {self.stature_m:.2f} m, {self.travelled_m:.2f} m at {self.mean_speed_mps:.2f} m/s, "
            f"top speed {self.top_speed_mps:.2f} m/s ({self.top_speed_joint})"
        )


def describe(motion: Motion) -> MotionInfo:
    """Duration, stature, distance travelled, mean and top speed of a motion."""
    checked_motion(motion)
    # The track is sampled at 10 Hz, so that jitter does not lengthen it.
    stride = max(1, round(motion.rate_hz / 10.0))
    coarse = np.concatenate([motion.joints[:-1:stride, 0, :2], motion.joints[-1:, 0, :2]])
    travelled_m = float(np.linalg.norm(np.diff(coarse, axis=0), axis=-1).sum())
    speeds = np.linalg.norm(np.gradient(motion.joints, 1.0 / motion.rate_hz, axis=0), axis=-1)
    return MotionInfo(
        duration_s=motion.duration_s,
        frames=len(motion.joints),
        rate_hz=motion.rate_hz,
        stature_m=stature_m(_points(motion)),
        travelled_m=travelled_m,
        mean_speed_mps=travelled_m / motion.duration_s,
        top_speed_mps=float(speeds.max()),
        top_speed_joint=motion.names[int(speeds.max(axis=0).argmax())],
    )


def place(
    motion: Motion,
    *,
    distance_m: float | None = None,
    angle_deg: float = 0.0,
    radar_position_m: tuple[float, float, float] = (0.0, 0.0, 1.0),
    boresight: tuple[float, float, float] = (1.0, 0.0, 0.0),
) -> Motion:
    """Start the motion in front of the radar, with the pelvis on the boresight, `distance_m` away horizontally.

    At `angle_deg` 0 the pelvis's main direction points to the radar, or the body faces it if the motion does not travel;
    the angle turns that about the vertical, counterclockwise from above. Without a distance, the nearest joint passes at
    1.5 m horizontally. Heights are kept. Raises an InputError for a vertical boresight or a distance out of range.
    """
    checked_motion(motion)
    aim = array("boresight", boresight, (3,), limit=LARGEST_M)[:2]
    position = array("radar_position_m", radar_position_m, (3,), limit=LARGEST_M, unit="m")[:2]
    if not np.linalg.norm(aim) > 1e-6:
        raise InputError(f"boresight must be finite and not vertical to place a motion before it, got {boresight}")
    if distance_m is not None:
        positive("distance_m", distance_m, FARTHEST_M, unit="m", hint="5 suits a room")
    number("angle_deg", angle_deg, -1e6, 1e6)
    aim = aim / np.linalg.norm(aim)
    heading = main_direction(motion)
    angle = math.atan2(-aim[1], -aim[0]) - math.atan2(heading[1], heading[0]) + math.radians(angle_deg)
    start = motion.joints[0, 0] * np.array([1.0, 1.0, 0.0])
    joints, rotations = _rotated(motion.joints - start, motion.rotations, np.array(angle))
    start_m = distance_m
    if distance_m is None:
        start_m = _closest_start(joints[..., :2] @ aim, joints[..., :2] @ np.array([-aim[1], aim[0]]))
    there = np.array([*(position + start_m * aim), 0.0])
    note = f"placed {start_m:.3g} m before the radar" + (
        f", {CLOSEST_APPROACH_M:g} m at closest approach" if distance_m is None else ""
    )
    note += f", turned by {angle_deg:g} degrees" if angle_deg else ""
    notes = [part for part in motion.report.split("; ") if part and not part.startswith(PLACED)]
    return motion.edited(
        note, joints=joints + there, rotations=rotations, placed=True, report="; ".join([*notes, note])
    )


def place_together(
    motions: Mapping[str, Motion],
    *,
    distance_m: float | None = None,
    angle_deg: float = 0.0,
    radar_position_m: tuple[float, float, float] = (0.0, 0.0, 1.0),
    boresight: tuple[float, float, float] = (1.0, 0.0, 0.0),
) -> dict[str, Motion]:
    """Put the first person of a capture before the radar, as `place` does, and move the others with it, so that they stay together.

    Without a distance nobody comes nearer than 1.5 m, measured along the boresight. Raises an InputError as `place` does.
    """
    if not isinstance(motions, Mapping) or not motions:
        raise InputError("motions must be a mapping of names to motions, as load_motions gives it")
    first = next(iter(motions.values()))
    there = place(
        first, distance_m=distance_m, angle_deg=angle_deg, radar_position_m=radar_position_m, boresight=boresight
    )
    turn = quaternions.multiply(there.rotations[0, 0], quaternions.conjugate(first.rotations[0, 0]))
    shift = there.joints[0, 0] - quaternions.rotate(turn, first.joints[0, 0])
    placed = {name: quaternions.rotate(turn, motion.joints) + shift for name, motion in motions.items()}
    aim = np.array([*np.asarray(boresight, float)[:2], 0.0])
    aim /= np.linalg.norm(aim)
    nearest = min(float(((joints - radar_position_m) @ aim).min()) for joints in placed.values())
    more = aim * max(0.0, CLOSEST_APPROACH_M - nearest) if distance_m is None else np.zeros(3)
    note = f"{PLACED}before the radar with {len(motions) - 1} more of its capture"
    return {
        name: motion.edited(
            note,
            joints=placed[name] + more,
            rotations=quaternions.multiply(turn, motion.rotations),
            placed=True,
            report="; ".join([*(part for part in motion.report.split("; ") if not part.startswith(PLACED)), note]),
        )
        for name, motion in motions.items()
    }


def aside(motion: Motion, distance_m: float, boresight: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> Motion:
    """The motion moved to the left by a distance [m], seen along the boresight; a negative distance moves it to the right."""
    checked_motion(motion)
    number("distance_m", distance_m, -FARTHEST_M, FARTHEST_M, unit="m")
    aim = array("boresight", boresight, (3,), limit=LARGEST_M)[:2]
    left = np.array([-aim[1], aim[0], 0.0]) / max(float(np.linalg.norm(aim)), 1e-9)
    note = f"moved {abs(distance_m):.3g} m to the {'left' if distance_m > 0 else 'right'}"
    return motion.edited(note, joints=motion.joints + distance_m * left)


def placement(motion: Motion) -> str:
    """A clause that says where a motion's coordinates come from: what `place` did, or "own coordinates"."""
    notes = [part for part in motion.report.split("; ") if part.startswith(PLACED)]
    return notes[-1] if notes else "own coordinates"


def repeat(motion: Motion, duration_s: float, *, travel: bool = True, blend_s: float = 0.2) -> Motion:
    """Extend a motion to `duration_s` by repeating its best cycle, blended over `blend_s` at each seam.

    Each repetition starts where the last one ended, so that a walk goes on (straight on, unless a cycle turns by 20 degrees or
    more). travel=False removes the mean velocity of the cycle, as on a treadmill. Raises an InputError if there is no cycle.
    """
    checked_motion(motion)
    number("duration_s", duration_s, unit="s")
    number("blend_s", blend_s, 0, 10, unit="s", hint="0.2 suits walking")
    flag("travel", travel)
    if not duration_s >= 2.0 / motion.rate_hz:
        raise InputError(f"duration_s must be finite and hold at least 2 frames, got {duration_s}")
    if duration_s * motion.rate_hz * motion.joints[0].size > MOST_NUMBERS:
        raise InputError(
            f"duration_s of {duration_s:g} s makes {duration_s * motion.rate_hz:.3g} frames, more than "
            f"{MOST_NUMBERS // motion.joints[0].size}; ask for a shorter duration"
        )
    count = math.floor(duration_s * motion.rate_hz + 1e-9) + 1
    if count <= len(motion.joints) and travel:
        return trim(motion, 0.0, (count - 1) / motion.rate_hz)
    window = max(2, round(blend_s * motion.rate_hz))
    first, last = _best_cycle(motion, window)
    angle, step = _cycle_transform(motion, first, last)
    offsets, local = decompose(motion.joints, motion.rotations, motion.parents)
    # Copy k shows frames first ... last + window of the original; the last `window` of them fade into copy k + 1.
    frames = np.arange(count)
    period = last - first
    copy = np.maximum((frames - first) // period, 0)
    now = frames - copy * period
    fading = (copy > 0) & (now < first + window)
    weight = np.where(fading, minimum_jerk((now - first + 1) / (window + 1)), 1.0)[:, None]
    before = np.where(fading, now + period, now)
    new_root = _repeat_root(offsets[now, 0], local[now, 0], copy, angle, step)
    old_root = _repeat_root(offsets[before, 0], local[before, 0], copy - fading, angle, step)
    offsets = (1 - weight[..., None]) * offsets[before] + weight[..., None] * offsets[now]
    local = quaternions.blend(local[before], local[now], weight[..., None])
    offsets[:, 0] = (1 - weight) * old_root[0] + weight * new_root[0]
    local[:, 0] = quaternions.blend(old_root[1], new_root[1], weight)
    joints, rotations = compose(offsets, local, motion.parents)
    if not travel:
        joints[..., :2] -= (frames / period)[:, None, None] * step[:2]
    return motion.edited(
        f"repeated to {duration_s:g} s{'' if travel else ' on the spot'}",
        joints=joints,
        rotations=quaternions.continuous(rotations),
        activities=motion.activities if len(motion.activities) == 1 else (),  # of several, it is not known which recur
    )


def _points(motion: Motion) -> dict[str, np.ndarray]:
    return {name: motion.joints[:, i] for i, name in enumerate(motion.names)}


def main_direction(motion: Motion) -> np.ndarray:
    """Horizontal unit vector (2,): the principal axis of the pelvis's track, or, without travel, where the body faces at first."""
    track = motion.joints[:, 0, :2]
    net = track[-1] - track[0]
    if np.linalg.norm(net) < TRAVEL_M:
        ahead = facing(_points(motion))[: max(1, round(0.5 * motion.rate_hz)), :2].mean(axis=0)
        return ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    axis = np.linalg.svd(track - track.mean(axis=0), full_matrices=False)[2][0]
    return axis if axis @ net >= 0 else -axis


def _rotated(joints: np.ndarray, rotations: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rotation = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), angle_rad)
    return quaternions.rotate(rotation, joints), quaternions.multiply(rotation, rotations)


def _closest_start(along: np.ndarray, aside: np.ndarray) -> float:
    """Distance [m] of the start at which the nearest joint at any time is `CLOSEST_APPROACH_M` from the radar."""
    # (d + along)^2 + aside^2 >= r^2 for all joints, from the far side: d >= sqrt(r^2 - aside^2) - along.
    near = np.abs(aside) < CLOSEST_APPROACH_M
    return float((np.sqrt(CLOSEST_APPROACH_M**2 - aside[near] ** 2) - along[near]).max())


def _best_cycle(motion: Motion, window: int) -> tuple[int, int]:
    """Frames (first, last) of like pose and velocity, at least 0.5 s apart, with `window` frames left after the last.

    Poses are compared in the body's own frame (pelvis at x = y = 0, facing x); velocities count as their product with 0.1 s.
    """
    ahead = facing(_points(motion))
    heading = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    ground = motion.joints[:, :1] * np.array([1.0, 1.0, 0.0])
    velocity = np.gradient(motion.joints, 1.0 / motion.rate_hz, axis=0)
    back = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), -heading)[:, None]
    pose = quaternions.rotate(back, motion.joints - ground)
    feature = np.concatenate([pose, 0.1 * quaternions.rotate(back, velocity)], axis=-1).reshape(len(pose), -1)
    feature /= math.sqrt(len(motion.names))
    # 60 poses a second tell cycles apart; at most 2000 keep the table of all pairs at 32 MB.
    stride = max(1, round(motion.rate_hz / 60.0), math.ceil(len(feature) / 2000))
    picked = np.arange(0, len(feature) - window, stride)
    squares = (feature[picked] ** 2).sum(axis=1)
    distance = np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * feature[picked] @ feature[picked].T, 0.0))
    span = (picked[None, :] - picked[:, None]) / motion.rate_hz
    distance[span < max(0.5, 2.0 * window / motion.rate_hz)] = np.inf
    # Standing is easiest to repeat but not what is asked for: a cycle must have 0.8 of the whole motion's speed about the hips.
    effort = np.cumsum(np.linalg.norm(np.diff(pose, axis=0, prepend=pose[:1]), axis=-1).mean(axis=1))
    lively = (effort[picked][None, :] - effort[picked][:, None]) / np.maximum(span, 1e-9)
    distance[lively < 0.8 * effort[-1] / motion.duration_s] = np.inf
    best = distance.min() if distance.size else np.inf
    if not best < 0.25:
        why = "it is too short for a cycle" if math.isinf(best) else f"the nearest differ by {best:.2f} m RMS per joint"
        raise InputError(
            f"the motion has no two instants of like pose to repeat between ({why}); give a longer recording or a shorter duration"
        )
    # Of cycles that are about as good the longest is taken: it has more of the person's own variation.
    candidate_spans = np.where(distance <= 1.3 * best, span, -1.0)
    first, last = np.unravel_index(int(candidate_spans.argmax()), candidate_spans.shape)
    return int(picked[first]), int(picked[last])


def _cycle_transform(motion: Motion, first: int, last: int) -> tuple[float, np.ndarray]:
    """Rotation angle [rad] about the vertical and step (3,) that carry frame `first` to frame `last`: p -> R p + step."""
    ahead = facing(_points(motion))[[first, last], :2]
    angle = math.atan2(ahead[0, 0] * ahead[1, 1] - ahead[0, 1] * ahead[1, 0], float(ahead[0] @ ahead[1]))
    if abs(angle) < math.radians(20.0):
        angle = 0.0  # a walk's pelvis wobbles by a few degrees; it should go straight on, not in a circle
    start, end = motion.joints[[first, last], 0] * np.array([1.0, 1.0, 0.0])
    spin = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), np.array(angle))
    return angle, end - quaternions.rotate(spin, start)


def _repeat_root(
    position: np.ndarray, rotation: np.ndarray, copies: np.ndarray, angle: float, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (K, 3) and orientations (K, 4) of the root after the cycle's transform was applied `copies` (K,) times."""
    spins = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), angle * np.arange(int(copies.max()) + 1))
    shifts = np.concatenate([np.zeros((1, 3)), np.cumsum(quaternions.rotate(spins[:-1], step), axis=0)])
    spin = spins[copies]
    return quaternions.rotate(spin, position) + shifts[copies], quaternions.multiply(spin, rotation)
