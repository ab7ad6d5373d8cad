"""Straight walks along +x: their stances, their phase, their path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import runs
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.kinematics import INDEX, Poses
from t2d_rt.motion.read.detect import FLOOR_PERCENTILE
from t2d_rt.motion.vary.gait_change import GaitChange

SIDES = "left", "right"

STRAIGHT_RAD = math.radians(25.0)
"""Greatest change of direction between the thirds of a walk that still counts as straight."""

LEAST_WALK_M = 1.5
"""Shortest path of a walk that is changed: two steps and a bit."""

LEAST_STEP_M = 0.2
"""Distance between two contacts of a foot from which they are two steps [m]."""

PHASE_CUTOFF_HZ = 3.0
"""Smoothing of the side that bears the weight and of swing: they change within a double support, 0.1 to 0.2 s."""


def along_x(poses: Poses) -> Poses:
    """The poses turned about the vertical so that the pelvis goes along +x from the origin."""
    track = poses.root[:, :2]
    net = track[-1] - track[0]
    thirds = np.diff(track[np.linspace(0, len(track) - 1, 4).astype(int)], axis=0)
    headings = np.arctan2(thirds[:, 1], thirds[:, 0])
    bend = np.abs(np.angle(np.exp(1j * np.diff(headings)))).max()
    if not (np.linalg.norm(net) >= LEAST_WALK_M and bend < STRAIGHT_RAD):
        raise InputError(
            f"a gait is changed on a straight walk of {LEAST_WALK_M:g} m or more, got {np.linalg.norm(net):.2f} m with a bend of "
            f"{math.degrees(bend):.0f} degrees; choose another clip"
        )
    turn = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), np.array(-math.atan2(net[1], net[0])))
    local = poses.local.copy()
    local[:, 0] = quaternions.multiply(turn, local[:, 0])
    root = quaternions.rotate(turn, poses.root - poses.root[0] * [1, 1, 0])
    return replace(poses, root=root, local=local)


def on_floor(poses: Poses) -> Poses:
    """The poses with the lowest joint of the feet at z = 0 where it is lowest: the reader's own rule for the floor."""
    joints, _ = poses.world()
    feet = [INDEX[f"{side}_{joint}"] for side in SIDES for joint in ("ankle", "foot", "toe")]
    level = float(np.percentile(joints[:, feet, 2].min(axis=1), FLOOR_PERCENTILE))
    return replace(poses, root=poses.root - [0.0, 0.0, level])


def stances(poses: Poses, planted: np.ndarray) -> np.ndarray:
    """Whether each foot stands, bool (T, 2): contacts without the gaps in which the foot went nowhere."""
    joints, _ = poses.world()
    stands = np.asarray(planted.any(axis=2))
    for number, side in enumerate(SIDES):
        ankle = joints[:, INDEX[f"{side}_ankle"], :2]
        for start, stop in runs(~stands[:, number]):
            inner = start > 0 and stop < len(stands)
            if inner and np.linalg.norm(ankle[stop] - ankle[start - 1]) < LEAST_STEP_M:
                stands[start:stop, number] = True
    return stands


def phase(stands: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Weight (T,), 1 where the left foot bears it alone and -1 the right, and swing (T, 2), 1 in mid-swing; both smooth."""
    values = np.column_stack([stands[:, 0].astype(float) - stands[:, 1], ~stands])
    smooth = low_pass(values, PHASE_CUTOFF_HZ, rate_hz)
    return np.clip(smooth[:, 0], -1, 1), np.clip(smooth[:, 1:], 0, 1)


def path_map(x: np.ndarray, change: GaitChange, length_m: float) -> np.ndarray:
    """Map of places along the path [m]: its slope is the factor of the step length there."""
    if change.hurry == 0.0:
        return change.stride * x
    rate = change.hurry / length_m
    return change.stride * (1 - np.exp(-rate * x)) / rate


def slow_noise(count: int, rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Noise (T,) of unit variance between 0.2 and 1.2 Hz: ten sines of random phase."""
    tones, phases = rng.uniform(0.2, 1.2, 10), rng.uniform(0, 2 * np.pi, 10)
    return np.sin(2 * np.pi * np.arange(count)[:, None] / rate_hz * tones + phases).sum(axis=1) / math.sqrt(5.0)


def about(axis: str, angle_rad: np.ndarray) -> np.ndarray:
    """Rotations (T, 4) about x, y or z by angles (T,)."""
    return quaternions.about_axis(np.eye(3)["xyz".index(axis)], angle_rad)
