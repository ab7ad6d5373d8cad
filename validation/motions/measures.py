"""What rotations found from positions are measured by."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion.interpolate import compose, decompose
from t2d_rt.motion.quaternions import conjugate, multiply, rotate
from t2d_rt.types.motion import Motion

BONES = {
    "spine1": ("spine2", "pelvis"), "spine2": ("spine3", "spine1"), "spine3": ("neck", "spine2"), "neck": ("head", "spine3"),
    **{
        f"{side}_{joint}": tuple(name if name in ("pelvis", "spine3") else f"{side}_{name}" for name in ends)
        for side in ("left", "right")
        for joint, ends in {
            "hip": ("knee", "pelvis"), "knee": ("ankle", "hip"), "ankle": ("foot", "knee"), "shoulder": ("elbow", "spine3"),
            "elbow": ("wrist", "shoulder"),
        }.items()
    },
}  # fmt: skip
"""Bones by the joint that carries them: the joint that they end at, and the joint against which their twist counts."""


def reproduction_errors_m(motion: Motion) -> np.ndarray:
    """Distances (T, J) between joints and those of forward kinematics with constant (median) offsets."""
    offsets, local = decompose(motion.joints, motion.rotations, motion.parents)
    rigid = np.tile(np.median(offsets, axis=0), (len(offsets), 1, 1))
    rigid[:, 0] = offsets[:, 0]
    joints, _ = compose(rigid, local, motion.parents)
    return np.linalg.norm(joints - motion.joints, axis=-1)


def twist_steps_deg(motion: Motion) -> dict[str, np.ndarray]:
    """Angles (T - 1,) by which each bone turns about itself against its parent from frame to frame."""
    found = {}
    for name, (end, parent) in BONES.items():
        above = conjugate(motion.rotations[:, motion.index(parent)])
        along = rotate(above, motion.joints[:, motion.index(end)] - motion.joints[:, motion.index(name)])
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        turned = multiply(above, motion.rotations[:, motion.index(name)])
        step = multiply(turned[1:], conjugate(turned[:-1]))
        angle = 2 * np.arctan2((step[:, :3] * along[:-1]).sum(axis=-1), step[:, 3])
        found[name] = np.degrees(np.abs(np.angle(np.exp(1j * angle))))
    return found


def swing_steps_deg(motion: Motion) -> dict[str, np.ndarray]:
    """Angles (T - 1,) by which each bone's direction against its parent turns from frame to frame."""
    found = {}
    for name, (end, parent) in BONES.items():
        above = conjugate(motion.rotations[:, motion.index(parent)])
        along = rotate(above, motion.joints[:, motion.index(end)] - motion.joints[:, motion.index(name)])
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        found[name] = np.degrees(np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=-1), -1, 1)))
    return found
