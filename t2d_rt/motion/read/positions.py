"""Joint positions alone -> `Motion`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion import quaternions
from t2d_rt.motion.read.orientations import orientations_from_positions
from t2d_rt.motion.skeletons import PARENT_OF, parents_of
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion, checked_rate


def motion_from_joints(
    joints: np.ndarray,
    *,
    rate_hz: float,
    names: Sequence[str] = CANONICAL_JOINTS,
    placed: bool | None = None,
    report: str = "",
) -> Motion:
    """A motion from positions alone: joints (T, J, 3) [m], z up, canonical `names` in any order.

    placed: True where the positions are those of the radar's world and stay as they are; False where `simulate` is to place the
        motion before the radar; left out, it does so with a warning.

    Orientations carry the bones; the twist about a bone, which positions do not show, comes from its neighbours: from the plane
    of a bent knee or elbow, from the foot, from the lines of hips and shoulders.
    """
    if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
        raise InputError(f"names must be a list of joint names, got {shown(names)}")
    missing = [name for name in CANONICAL_JOINTS if name not in names]
    unknown = [name for name in names if name not in PARENT_OF]
    if missing or unknown or len(set(names)) != len(names):
        raise InputError(f"names must be the canonical joints, each once; missing {missing}, unknown {unknown}")
    hint = "repair the tracks first"
    joints = array("joints", joints, ("time >= 2", len(names), 3), limit=LARGEST_M, unit="m", hint=hint)
    if len(joints) < 2:
        raise InputError(f"joints must have shape (time >= 2, {len(names)}, 3), got {joints.shape}")
    points = {name: joints[:, list(names).index(name)] for name in PARENT_OF if name in names}
    return replace(
        assemble(points, orientations_from_positions(points, checked_rate(rate_hz)), rate_hz, 0.0, report),
        placed=placed,
    )


def assemble(
    points: dict[str, np.ndarray], orientations: dict[str, np.ndarray], rate_hz: float, floor_m: float, report: str = ""
) -> Motion:
    """A motion of joints and orientations by canonical name, the floor put at z = 0."""
    names = tuple(name for name in PARENT_OF if name in points)
    joints = np.stack([points[name] for name in names], axis=1) - np.array([0.0, 0.0, floor_m])
    rotations = quaternions.continuous(np.stack([orientations[name] for name in names], axis=1))
    return Motion(
        joints=joints,
        rotations=rotations,
        rate_hz=rate_hz,
        names=names,
        parents=parents_of(names),
        placed=False,
        report=report,
    )
