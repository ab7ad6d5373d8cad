"""Inverse kinematics of one arm or leg: two bones that bring a wrist or an ankle to a point, in closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.kinematics import INDEX, PARENTS, Poses

Limb = Literal["left_leg", "right_leg", "left_arm", "right_arm"]

LIMBS: dict[Limb, tuple[str, str, str]] = {
    "left_leg": ("left_hip", "left_knee", "left_ankle"),
    "right_leg": ("right_hip", "right_knee", "right_ankle"),
    "left_arm": ("left_shoulder", "left_elbow", "left_wrist"),
    "right_arm": ("right_shoulder", "right_elbow", "right_wrist"),
}

STRETCH = 0.9995
"""Greatest length of a limb over that of its bones: at 1 the joint in its middle would have no direction to bend in."""

FOLD = 0.25
"""Least length of a limb over that of its bones: heel to buttock, hand to shoulder."""


def reach(poses: Poses, limb: Limb, targets: np.ndarray, *, pole: np.ndarray | None = None) -> tuple[Poses, np.ndarray]:
    """Poses whose ankle or wrist is at `targets` (T, 3) [m], and the distance (T,) [m] by which it stays short of them.

    pole: direction (T, 3) or (3,) in which knee or elbow points; by default where it points now. Ankle and wrist keep their
        orientation in space. Law of cosines in the plane of target and pole.
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
    # The side to bend to is found about the limb as it is and carried with it: about its new axis a nearly straight limb that turns
    # far would change sides. A given pole is seen along the new axis.
    now = axis if pole is not None else _unit(joints[:, end] - start)
    aside = joints[:, middle] - start if pole is None else np.broadcast_to(pole, span.shape)
    square = aside - (aside * now).sum(-1, keepdims=True) * now
    size = np.linalg.norm(square, axis=-1, keepdims=True)
    # A straight limb shows no side to bend to: the knee's own forward axis does, the elbow's backward one. A recorded knee that is
    # bent the wrong way is noise of a straight one.
    spare = quaternions.rotate(rotations[:, upper], np.array([1.0 if limb.endswith("leg") else -1.0, 0.0, 0.0]))
    spare = _unit(spare - (spare * now).sum(-1, keepdims=True) * now)
    aside_of = size / (first + second)
    weight = np.clip(20 * aside_of, 0.0, 1.0)
    if pole is None:
        agrees = np.clip(2 * (_unit(square) * spare).sum(-1, keepdims=True), 0.0, 1.0)
        weight = np.maximum(agrees * weight, np.clip(10 * aside_of - 1, 0.0, 1.0))
    side = quaternions.rotate(quaternions.between(now, axis), _unit(weight * _unit(square) + (1 - weight) * spare))
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


def _swing(bone: np.ndarray, wanted: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    return quaternions.multiply(quaternions.between(bone, wanted), rotation)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)
