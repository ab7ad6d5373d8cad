"""What the joints of a person say in any pose: stature, the length of legs and the direction that the body faces."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from t2d_rt.geometry.vectors import norms
from t2d_rt.motion.quaternions import cross

STATURE_PER_CHAIN = 1.142
"""Stature over (hip - knee - ankle) + (hips - shoulders) + (shoulders - head), of the adult template; CMU, iClone and bvh-toolbox
skeletons keep to it within 3 %."""


def stature_m(points: dict[str, np.ndarray]) -> float:
    """Stature from bone lengths, whatever the pose (+- 5 %), in the unit of the points.

    Only joints that all skeletons have in one place count: the pelvis lies up to 9 cm above the hips (CMU), and how many joints a
    spine has, and how it winds through them, differs. A sum over them is too long by 4 to 9 % in files with full spines.
    """
    shoulders = middle(points, "shoulder")
    trunk = _length(middle(points, "hip"), shoulders) + _length(shoulders, points["head"])
    return STATURE_PER_CHAIN * (leg_m(points) + trunk)


def leg_m(points: Mapping[str, np.ndarray]) -> float:
    """Length of thigh and shank, median in time and mean of both sides, in the unit of the points."""
    bones = [
        _length(points[f"{side}_{lower}"], points[f"{side}_{upper}"])
        for side in ("left", "right")
        for lower, upper in (("hip", "knee"), ("knee", "ankle"))
    ]
    return 0.5 * sum(bones)


def middle(points: Mapping[str, np.ndarray], joint: str) -> np.ndarray:
    """Track (T, 3) between the left and the right one of a joint."""
    return np.asarray(0.5 * (points[f"left_{joint}"] + points[f"right_{joint}"]))


def _length(lower: np.ndarray, upper: np.ndarray) -> float:
    return float(np.median(norms(lower - upper)))


def facing(points: dict[str, np.ndarray]) -> np.ndarray:
    """Horizontal unit vectors (T, 3) that the hips and shoulders face (z up)."""
    across = points["left_hip"] - points["right_hip"] + points["left_shoulder"] - points["right_shoulder"]
    forward = cross(across, np.array([0.0, 0.0, 1.0]))
    return forward / np.maximum(norms(forward), 1e-9)[..., None]
