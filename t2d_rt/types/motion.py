"""`Motion`: a skeleton in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.errors import InputError

CANONICAL_JOINTS: tuple[str, ...] = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
"""HumanML3D's 22 joints in HumanML3D's order; every `Motion` starts with them."""

CANONICAL_PARENTS: tuple[int, ...] = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)

OPTIONAL_JOINTS: dict[str, str] = {
    "head_top": "head", "left_hand": "left_wrist", "right_hand": "right_wrist", "left_toe": "left_foot",
    "right_toe": "right_foot",
}  # fmt: skip
"""Ends that a file may or may not have, with their parents; they follow the 22 in this order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Joints of one person in time: metres, right-handed, z up.

    `names` are `CANONICAL_JOINTS` followed by any of `OPTIONAL_JOINTS`.
    """

    joints: np.ndarray
    """Positions [m], float64 (T, J, 3)."""
    rotations: np.ndarray
    """Global orientations, unit quaternions x, y, z, w, float64 (T, J, 4); each carries its joint's bone rigidly, but its
    zero is the file's own and says nothing about the body's pose."""
    rate_hz: float
    names: tuple[str, ...] = CANONICAL_JOINTS
    parents: tuple[int, ...] = CANONICAL_PARENTS
    placed: bool = True
    """False while positions are still the file's own: a simulation then places the motion before the radar."""
    report: str = ""
    """One line: what the reader found in the file (units, up axis, flavour, floor, dropped frames, smoothing)."""

    def __post_init__(self) -> None:
        frames, count = self.joints.shape[:2] if self.joints.ndim == 3 else (0, 0)
        if self.joints.shape != (frames, len(self.names), 3) or len(self.parents) != count:
            raise InputError(f"joints must have shape (time, {len(self.names)}, 3), got {self.joints.shape}")
        if self.rotations.shape != (frames, count, 4):
            raise InputError(f"rotations must have shape {(frames, count, 4)}, got {self.rotations.shape}")
        if frames < 2:
            raise InputError(f"a motion needs at least 2 frames, got {frames}; a single pose has no Doppler")
        if self.names[:22] != CANONICAL_JOINTS:
            raise InputError("a motion's names must start with the 22 canonical joints; map the file's skeleton first")
        if not (np.isfinite(self.joints).all() and np.isfinite(self.rotations).all()):
            raise InputError("joints and rotations must be finite, got NaN or infinite values")
        if not 0 < self.rate_hz < 1e5:
            raise InputError(f"rate_hz must lie between 0 and 1e5 Hz, got {self.rate_hz}")

    @property
    def times_s(self) -> np.ndarray:
        """Times of the frames [s], (T,), from 0."""
        return np.arange(len(self.joints)) / self.rate_hz

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame [s]."""
        return (len(self.joints) - 1) / self.rate_hz

    def index(self, name: str) -> int:
        """Index of a joint by its canonical name."""
        return self.names.index(name)
