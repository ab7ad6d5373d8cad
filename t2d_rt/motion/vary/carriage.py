"""How pelvis, trunk and arms are carried in a changed walk."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.kinematics import INDEX, Poses
from t2d_rt.motion.vary.gait_change import GaitChange
from t2d_rt.motion.vary.straight_walk import about, path_map, slow_noise

SPINE = "lower_back", "spine1", "spine2", "spine3"


def pelvis_track(poses: Poses, change: GaitChange, weight: np.ndarray) -> np.ndarray:
    """Track (T, 3) of the pelvis [m] along the shorter path, shifted over the standing foot and lowered."""
    root = poses.root.copy()
    root[:, 0] = path_map(root[:, 0], change, float(root[-1, 0]))
    root[:, 1] += change.pelvis_shift_m * weight
    # The rise and fall of an inverted pendulum goes with the square of its step.
    mean = root[:, 2].mean()
    root[:, 2] = mean + (root[:, 2] - mean) * min(change.stride, 1.2) ** 2 - change.crouch_m
    return root


def held_body(poses: Poses, change: GaitChange, weight: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Local rotations (T, J, 4) with pelvis, trunk and arms held otherwise."""
    local = poses.local.copy()
    left, right = np.maximum(weight, 0), np.maximum(-weight, 0)
    sway = change.unsteady_rad * np.column_stack([slow_noise(len(poses), poses.rate_hz, rng) for _ in range(2)])
    drop = change.pelvis_drop_rad[0] * left - change.pelvis_drop_rad[1] * right
    # Rotation about +x lowers the right side; the trunk leans over the left foot by one about -x.
    roll = -(change.trunk_roll_rad[0] * left - change.trunk_roll_rad[1] * right) - drop + sway[:, 1]
    lean = change.lean_rad + sway[:, 0]
    local[:, 0] = _damped_heading(local[:, 0], change.pelvis_turn)
    local[:, 0] = quaternions.multiply(about("x", drop), local[:, 0])
    for name in SPINE:
        local[:, INDEX[name]] = _product(about("x", roll / 4), about("y", lean / 4), local[:, INDEX[name]])
    for name in ("neck", "head"):  # the eyes stay on the path
        local[:, INDEX[name]] = _product(about("x", -roll / 3), about("y", -0.35 * lean), local[:, INDEX[name]])
    for number, (side, sign) in enumerate((("left", 1.0), ("right", -1.0))):
        shoulder, elbow = INDEX[f"{side}_shoulder"], INDEX[f"{side}_elbow"]
        for joint in (shoulder, elbow):
            local[:, joint] = _scaled(local[:, joint], change.arm_swing[number])
        apart = about("x", np.full(len(poses), sign * change.arms_apart_rad))
        local[:, shoulder] = quaternions.multiply(apart, local[:, shoulder])
        bend = about("z", np.full(len(poses), -sign * change.elbow_bend_rad))
        local[:, elbow] = quaternions.multiply(local[:, elbow], bend)
    return quaternions.continuous(local)


def _damped_heading(rotation: np.ndarray, factor: float) -> np.ndarray:
    """Orientations (T, 4) whose turning about the vertical is scaled."""
    ahead = quaternions.rotate(rotation, np.array([1.0, 0.0, 0.0]))
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    return quaternions.multiply(about("z", (factor - 1) * heading), rotation)


def _scaled(rotation: np.ndarray, factor: float) -> np.ndarray:
    """Rotations (T, 4) whose departures from their mean are scaled."""
    values, vectors = np.linalg.eigh(np.einsum("ti,tj->ij", rotation, rotation))
    mean = np.broadcast_to(vectors[:, int(values.argmax())], rotation.shape)
    return quaternions.blend(mean, rotation, np.full((len(rotation), 1), factor))


def _product(*rotations: np.ndarray) -> np.ndarray:
    first, *others = rotations
    for each in others:
        first = quaternions.multiply(first, each)
    return first
