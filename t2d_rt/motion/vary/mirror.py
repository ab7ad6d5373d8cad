"""The same motion with left and right exchanged."""

from __future__ import annotations

import numpy as np

from t2d_rt.types.motion import Motion, checked_motion


def mirror(motion: Motion) -> Motion:
    """The motion seen in a mirror that stands in the plane y = 0: what the left hand did the right hand does."""
    checked_motion(motion)
    order = [motion.names.index(_other_side(name)) for name in motion.names]
    # A reflection at y = 0 turns rotations about x and z around and leaves those about y.
    joints = motion.joints[:, order] * np.array([1.0, -1.0, 1.0])
    rotations = motion.rotations[:, order] * np.array([-1.0, 1.0, -1.0, 1.0])
    return motion.edited("mirrored", joints=joints, rotations=rotations)


def _other_side(name: str) -> str:
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)
