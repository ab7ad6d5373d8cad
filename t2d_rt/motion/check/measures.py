"""What can be measured of a motion that tells a sound one from a broken one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.motion.check.anatomy import joint_angles, mirrored, self_penetration_m, upside_down_fraction
from t2d_rt.motion.check.support import contacts, floating_s, floor_offset_m, penetration_m, sliding_s
from t2d_rt.motion.check.tracks import Tracks, rate_of, tracks
from t2d_rt.types.motion import Motion, checked_motion

ANGLE_PERCENTILE = 99.0
"""Of a joint's angle in time that is held against its range: single frames are a matter of discontinuities."""

LEAST_BONE_M = 0.05
"""Shorter bones, which are points put between joints in some files, change in proportion to this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measures:
    """Figures of one motion; all but the first are of its joints below 10 Hz, at 60 frames per second, unless told otherwise."""

    duration_s: float
    stature_m: float
    activity_mps: float
    """Speed of the joints, mean over joints and time."""
    top_speed_mps: float
    """Of any joint."""
    acceleration_mps2: float
    """Greatest of any joint, 99th percentile over time."""
    jerk_mps3: float
    """Root mean square over joints and time."""
    jump_m: float
    """Greatest difference of a joint's step from one frame to the next from the mean of the steps before and after it, in the
    motion's own frames."""
    bone_change: float
    """Greatest relative change of a bone's length, own frames."""
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
    """Of the time, with the head below the hips and the ankles above."""
    mirrored: bool
    """Whether the feet point to the back, as where left and right are swapped."""
    angles_deg: dict[str, float]
    """Greatest angles of the joints, 99th percentile over time."""


def measure(motion: Motion) -> Measures:
    """All figures of a motion: z up, the floor at z = 0."""
    return measures_of(checked_motion(motion), tracks(motion))


def measures_of(motion: Motion, body: Tracks) -> Measures:
    """`measure` with the motion's tracks."""
    speed = np.linalg.norm(body.velocity, axis=-1)
    acceleration = rate_of(body.velocity)
    size = np.linalg.norm(acceleration, axis=-1)
    # Differences at the ends are one-sided, and what a filter makes of a record's ends is not motion.
    inner = slice(3, -3) if len(size) > 12 else slice(None)
    jerk = np.linalg.norm(rate_of(acceleration)[inner], axis=-1)
    planted = contacts(body)
    return Measures(
        duration_s=motion.duration_s, stature_m=body.stature_m, activity_mps=float(speed.mean()),
        top_speed_mps=float(speed.max()), acceleration_mps2=float(np.percentile(size[inner].max(axis=1), 99)),
        jerk_mps3=float(np.sqrt(np.mean(jerk**2))), jump_m=jump_m(motion.joints), bone_change=bone_change(motion),
        foot_skate_m=max((each.skate_m for each in planted), default=0.0), sliding_s=sliding_s(body),
        floating_s=floating_s(body), floor_penetration_m=penetration_m(body), floor_offset_m=floor_offset_m(planted),
        self_penetration_m=float(np.percentile(self_penetration_m(body), ANGLE_PERCENTILE)),
        upside_down_fraction=upside_down_fraction(body), mirrored=mirrored(body),
        angles_deg={name: float(np.percentile(each, ANGLE_PERCENTILE)) for name, each in joint_angles(body).items()},
    )  # fmt: skip


def jump_m(joints: np.ndarray) -> float:
    """Greatest deviation of a step from the mean of its neighbours [m], of joints (T, J, 3); 0 for less than four frames."""
    if len(joints) < 4:
        return 0.0
    step = np.diff(joints, axis=0)
    return float(np.linalg.norm(step[1:-1] - 0.5 * (step[:-2] + step[2:]), axis=-1).max())


def bone_change(motion: Motion) -> float:
    """Greatest deviation of a bone's length from its median, over that."""
    length = np.linalg.norm(motion.joints[:, 1:] - motion.joints[:, list(motion.parents[1:])], axis=-1)
    usual = np.median(length, axis=0)
    return float((np.abs(length - usual) / np.maximum(usual, LEAST_BONE_M)).max())
