"""Fill in canonical joints that a set of joints lacks, at the places where an average adult has them.

Proportions are those of the shipped adult body, relative to its trunk (middle of the hips to middle of the shoulders). They are
laid along the person's own trunk, so that filled joints move with hips and shoulders.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from t2d_rt.geometry.vectors import median_length, unit

HEAD = np.array([0.08, 0.0, 0.22])
"""Vector (ahead, left, up) from the neck to the head's joint at the base of the skull, over the trunk's length."""
SPINE = {"pelvis": 0.0, "spine1": 0.25, "spine2": 0.5, "spine3": 0.75, "neck": 1.0}
"""Heights of the spine's joints, as fractions of the way from pelvis to neck."""

FOOT_AHEAD, FOOT_DOWN = 0.07, 0.035
"""Distance of the ball of the foot ahead of and below the ankle, over stature."""


def complete(points: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[str]]:
    """Points (T, 3) of all canonical joints but the feet, in any unit and axes, and what was filled or moved to its place."""
    at = dict(points)
    hips, shoulders = (0.5 * (at[f"left_{joint}"] + at[f"right_{joint}"]) for joint in ("hip", "shoulder"))
    trunk = median_length(shoulders - hips)
    axes = trunk * _axes(at, shoulders - hips)
    clauses = []
    head = at.get("head")
    # A head so low above the shoulders is the joint of head and trunk.
    if head is not None and ((head - shoulders) * axes[..., 2]).sum(axis=-1).mean() < 0.1 * trunk**2:
        at["neck"] = at.pop("head")
        clauses.append("the head's joint taken as the neck")
    filled = [name for name in ("pelvis", "neck", "head", "spine1", "spine2", "spine3") if name not in at]
    # The pelvis lies 6 cm above the hips, between iClone's 2 and CMU's 10.
    at.setdefault("pelvis", hips + 0.12 * axes[..., 2])
    at.setdefault("neck", shoulders + axes @ np.array([-0.03, 0.0, 0.21]))
    if "head" in at:
        # Sources put it at the base, the middle or the top of the skull: its direction is kept, its distance is made canonical.
        up = at["head"] - at["neck"]
        at["head"] = at["neck"] + np.linalg.norm(HEAD) * trunk * unit(up)
        clauses.append("head at the base of the skull")
    at.setdefault("head", at["neck"] + axes @ HEAD)
    spine_joints = [name for name in SPINE if name in at]
    for low, high in pairwise(spine_joints):
        for name, height in SPINE.items():
            if SPINE[low] < height < SPINE[high]:
                fraction = (height - SPINE[low]) / (SPINE[high] - SPINE[low])
                at[name] = (1 - fraction) * at[low] + fraction * at[high]
    for side in ("left", "right"):
        if f"{side}_collar" not in at:
            filled.append(f"{side}_collar")
            at[f"{side}_collar"] = shoulders + 0.05 * axes[..., 2] + 0.13 * (at[f"{side}_shoulder"] - shoulders)
    return at, [*([f"filled {', '.join(filled)}"] if filled else []), *clauses]


def _axes(at: dict[str, np.ndarray], up: np.ndarray) -> np.ndarray:
    """Unit axes of the trunk (T, 3, 3), as columns: ahead, left, up."""
    across = at["left_hip"] - at["right_hip"] + at["left_shoulder"] - at["right_shoulder"]
    z = unit(up)
    y = unit(across - (across * z).sum(axis=-1, keepdims=True) * z)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def add_level_feet(points: dict[str, np.ndarray], tall_m: float) -> list[str]:
    """Adds missing balls of feet (z up, metres): level with a low ankle and an upright shank, else perpendicular to the shank."""
    filled = [f"{side}_foot" for side in ("left", "right") if f"{side}_foot" not in points]
    left = points["left_hip"] - points["right_hip"]
    for name in filled:
        ankle = points[name.replace("foot", "ankle")]
        shank = unit(points[name.replace("foot", "knee")] - ankle)
        lift = np.clip((ankle[:, 2:] - np.percentile(ankle[:, 2], 5)) / (0.1 * tall_m), 0, 1)
        flat = (1 - lift**2 * (3 - 2 * lift)) * np.clip(shank[:, 2:], 0, 1) ** 2
        up = unit(flat * np.array([0.0, 0.0, 1.0]) + (1 - flat) * shank)
        forward = unit(np.cross(left, up))
        points[name] = ankle + tall_m * (FOOT_AHEAD * forward - FOOT_DOWN * up)
    return filled
