"""Bend the path of a motion to an arc: a runner leaves a room within a second or two if the path is straight, but not on an arc."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.core.checks import number
from t2d_rt.core.constants import STANDARD_GRAVITY
from t2d_rt.core.errors import InputError
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import SIDES, contacts, follow, plant, steadying
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.kinematics import INDEX, Poses, motion_of, poses_of
from t2d_rt.types.motion import Motion, checked_motion

MOST_TWIST_RAD = 0.6
"""Angle by which a standing foot stays behind a turning body; hips turn by about 0.7."""
CURVE_CUTOFF_HZ = 0.8
"""Cut-off frequency that removes the sway of each step from the pelvis's path."""
UP = np.array([0.0, 0.0, 1.0])


def arc(motion: Motion, radius_m: float) -> Motion:
    """The motion along a path that is bent to an arc of that radius [m], to the left if it is positive, else to the right.

    At every frame body and velocity are turned by the distance gone over the radius; feet stay where they stand, and the body
    leans inward as its speed v requires, by atan(v^2 / (g r)). A path that turns already turns by so much more.
    Raises an InputError for a radius below 0.3 m, and for a person who carries things.
    """
    checked_motion(motion)
    number("radius_m", radius_m, -1e6, 1e6, unit="m")
    if abs(radius_m) < 0.3:
        raise InputError(
            f"radius_m of {radius_m:g} m is tighter than a person turns; give 0.3 or more, or -0.3 or less"
        )
    if motion.carries:
        raise InputError("the arms that carry things cannot be bent to an arc; bend the path first, and then carry")
    poses = poses_of(motion)
    smooth = low_pass(poses.root[:, :2], CURVE_CUTOFF_HZ, poses.rate_hz)
    velocity = np.gradient(smooth, 1.0 / poses.rate_hz, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) / (poses.rate_hz * radius_m)
    planted = contacts(poses)
    round_it = plant(bent(poses, planted, angle), planted, level=False)
    ahead = quaternions.rotate(
        quaternions.about_axis(UP, angle), np.pad(velocity / np.maximum(speed, 0.1)[:, None], ((0, 0), (0, 1)))
    )
    leaning = _leaning(round_it, ahead, np.arctan(speed**2 / (STANDARD_GRAVITY * radius_m)))
    note = f"bent to an arc of {abs(radius_m):.2f} m to the {'left' if radius_m > 0 else 'right'}"
    leaning_motion = motion_of(leaning)
    changes = {name: getattr(leaning_motion, name) for name in ("joints", "rotations", "names", "parents")}
    return motion.edited(note, **changes)


def bent(poses: Poses, planted: np.ndarray, angle_rad: np.ndarray) -> Poses:
    """Poses whose body and velocity are turned at each frame by an angle (T,) about the vertical, positive to the left.

    planted: contacts (T, 2, 2). A foot that stands keeps its direction: the leg turns over it.
    """
    spins = quaternions.about_axis(UP, angle_rad)
    middle = quaternions.about_axis(UP, 0.5 * (angle_rad[1:] + angle_rad[:-1]))
    steps = quaternions.rotate(middle, np.diff(poses.root, axis=0))
    root = poses.root.copy()
    root[1:, :2] = root[0, :2] + np.cumsum(steps[:, :2], axis=0)
    local = poses.local.copy()
    local[:, 0] = quaternions.multiply(spins, local[:, 0])
    rotations = replace(poses, local=local).world()[1]
    for number_, side in enumerate(SIDES):
        back = steadying(angle_rad[:, None], np.asarray(planted[:, number_].any(axis=1)), poses.rate_hz)[:, 0]
        ankle, knee = INDEX[f"{side}_ankle"], INDEX[f"{side}_knee"]
        # The leg gives way softly: a foot that began to turn at once would jerk.
        held = back / (1 + (np.abs(back) / MOST_TWIST_RAD) ** 6) ** (1 / 6)
        turned = quaternions.multiply(quaternions.about_axis(UP, held), rotations[:, ankle])
        local[:, ankle] = quaternions.multiply(quaternions.conjugate(rotations[:, knee]), turned)
    return replace(poses, root=root, local=local)


def _leaning(poses: Poses, ahead: np.ndarray, lean_rad: np.ndarray) -> Poses:
    """Poses that lean over their feet by an angle (T,) to the left of where they go, `ahead` (T, 3); feet stay where they are."""
    joints, _ = poses.world()
    ankles = {side: joints[:, INDEX[f"{side}_ankle"]] for side in SIDES}
    floor_m = min(float(ankle[:, 2].min()) for ankle in ankles.values())
    up = poses.root[:, 2:] - floor_m
    tilt = quaternions.about_axis(ahead, -lean_rad)
    root = poses.root + quaternions.rotate(tilt, up * UP) - up * UP
    local = poses.local.copy()
    local[:, 0] = quaternions.multiply(tilt, local[:, 0])
    return follow(replace(poses, root=root, local=local), ankles)
