"""Kimodo's .npz -> tracks: posed_joints (T, 30, 3) [m], global_rot_mats (T, 30, 3, 3), 30 frames a second, y up, facing z.

The order is that of its SOMA skeleton: hips, spine, neck, head, jaw and eyes, left arm with the ends of thumb and middle finger,
right arm, left leg, right leg.
"""

from __future__ import annotations

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.quaternions import from_matrix
from t2d_rt.motion.read.arrays import Arrays
from t2d_rt.motion.read.clock import stated_rate
from t2d_rt.motion.read.samples import filled, seen
from t2d_rt.motion.read.tracks import Tracks

RATE_HZ = 30.0
JOINTS = 30

PLACES = {
    "pelvis": 0, "spine1": 1, "spine2": 2, "spine3": 3, "neck": 4, "head": 6,
    "left_collar": 10, "left_shoulder": 11, "left_elbow": 12, "left_wrist": 13, "left_hand": 15,
    "right_collar": 16, "right_shoulder": 17, "right_elbow": 18, "right_wrist": 19, "right_hand": 21,
    "left_hip": 22, "left_knee": 23, "left_ankle": 24, "left_foot": 25,
    "right_hip": 26, "right_knee": 27, "right_ankle": 28, "right_foot": 29,
}  # fmt: skip

LEAST_ORTHONORMAL = 1e-2
"""Deviation of R R^T from the unit matrix from which matrices are no rotations."""


def read_kimodo(arrays: Arrays) -> Tracks:
    """Positions and, where the file has them, rotations."""
    joints = arrays.samples("posed_joints", (3,))
    if joints.shape[1:] != (JOINTS, 3):
        raise InputError(f"{arrays.path}: posed_joints must have shape (time, {JOINTS}, 3), got {joints.shape}")
    given_hz = stated_rate(arrays, len(joints))
    rate_hz = RATE_HZ if given_hz is None else given_hz
    joints = seen(joints)
    points = {name: joints[:, place] for name, place in PLACES.items()}
    orientations, lost = {}, np.zeros(len(joints), dtype=bool)
    if "global_rot_mats" in arrays:
        matrices = arrays.samples("global_rot_mats", (4,))
        if matrices.shape != (*joints.shape, 3):
            raise InputError(
                f"{arrays.path}: global_rot_mats must have shape {(*joints.shape, 3)}, got {shown(matrices)}"
            )
        rows, lost = filled(matrices.reshape(len(matrices), -1), f"{arrays.path}: global_rot_mats")
        matrices = rows.reshape(matrices.shape)
        deviation = np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max()
        if not (deviation < LEAST_ORTHONORMAL and (np.linalg.det(matrices) > 0).all()):
            raise InputError(
                f"{arrays.path}: global_rot_mats are no rotation matrices; they deviate by {deviation:.2g}"
            )
        turned = from_matrix(matrices)
        orientations = {name: turned[:, place] for name, place in PLACES.items()}
    return Tracks(form="Kimodo", points=points, turned=orientations, rate_hz=rate_hz, unit_m=1.0, up="y").without(lost)
