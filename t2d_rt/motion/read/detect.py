"""What a file does not say is found from the body: unit, up axis, calibration pose, floor."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.motion import quaternions
from t2d_rt.motion.posture import facing, stature_m

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "ft": 0.3048, "cmu": 0.0254 / 0.45}
"""Metres per unit; one unit of the CMU database is 1/0.45 inch."""

AUTO_STATURE_M = (1.1, 2.5)
"""Statures at which the unit is found without doubt: neighbouring units (cm, inch, CMU) differ by 2.2 or more."""

STATURE_M = (0.4, 3.0)
"""Statures accepted when the unit is given (a toddler ... a giant)."""

FLOOR_PERCENTILE = 2.0
"""The floor is where the lowest foot joint is in the lowest 2 % of frames: robust to a bad frame, right for jumps."""

Up = Literal["x", "y", "z", "-x", "-y", "-z"]


def unit(points: dict[str, np.ndarray], units: float | str | None) -> tuple[float, float]:
    """Metres per unit and the stature [m] that follows."""
    tall = stature_m(points)
    if isinstance(units, str) and units not in UNITS_M:
        raise InputError(f"units {units!r} are unknown; give metres per unit or one of {', '.join(UNITS_M)}")
    if units is not None:
        unit_m = UNITS_M[units] if isinstance(units, str) else float(units)
        if not (unit_m > 0 and STATURE_M[0] <= tall * unit_m <= STATURE_M[1]):
            raise InputError(
                f"with units={units!r} the body would be {tall * unit_m:.3g} m tall; leave units out to detect them"
            )
        return unit_m, tall * unit_m
    if tall > 0:
        best = min(UNITS_M.values(), key=lambda unit: abs(math.log(tall * unit / 1.7)))
        if AUTO_STATURE_M[0] <= tall * best <= AUTO_STATURE_M[1]:
            return best, tall * best
    raise InputError(
        f"the body is {tall:.3g} units tall, which no usual unit makes a person; give units=metres per unit"
    )


def up_axis(points: dict[str, np.ndarray]) -> Up:
    """The axis along which the head is above the ankles; y, BVH's usual one, unless another is clearly longer."""
    posture = points["head"] - 0.5 * (points["left_ankle"] + points["right_ankle"])
    mean = np.median(posture, axis=0)
    axis = int(np.argmax(np.abs(mean) * np.array([1.0, 1.5, 1.0])))
    return ("-" if mean[axis] < 0 else "") + "xyz"[axis]  # type: ignore[return-value]


def to_z_up(
    points: dict[str, np.ndarray], orientations: dict[str, np.ndarray], up: str, unit_m: float
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Cyclic change of axes (proper rotation): y up becomes (z, x, y); in metres."""
    if up not in ("x", "y", "z", "-x", "-y", "-z"):
        raise InputError(f"up={up!r} is no axis; give 'x', 'y', 'z', '-x', '-y' or '-z'")
    axis = "xyz".index(up[-1])
    z, x = (-1.0 if up[0] == "-" else 1.0) * np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
    rows = np.stack([x, np.cross(z, x), z])
    rotation = quaternions.from_matrix(rows)
    moved = {name: unit_m * (track @ rows.T) for name, track in points.items()}
    return moved, {name: quaternions.multiply(rotation, track) for name, track in orientations.items()}


def add_feet(points: dict[str, np.ndarray], orientations: dict[str, np.ndarray], tall_m: float) -> None:
    """Balls of the feet where the file ends at the ankle: 7 % of the stature ahead, 3.5 % down, rigid on the ankle."""
    ahead = tall_m * (0.07 * facing(points) - 0.035 * np.array([0.0, 0.0, 1.0]))
    for side in ("left", "right"):
        if f"{side}_foot" not in points:
            ankle = orientations[f"{side}_ankle"]
            local = np.median(quaternions.rotate(quaternions.conjugate(ankle), ahead), axis=0)
            points[f"{side}_foot"] = points[f"{side}_ankle"] + quaternions.rotate(ankle, local)
            orientations[f"{side}_foot"] = ankle


def tpose_frames(points: dict[str, np.ndarray]) -> int:
    """Frames before a jump of the pose within the first five steps: a calibration pose put in front of the motion."""
    pose = np.stack(list(points.values()), axis=1)
    pose = pose - pose[:, :1]
    steps = np.linalg.norm(np.diff(pose, axis=0), axis=-1).mean(axis=1)
    if len(steps) < 10:
        return 0
    # A jump moves the joints by several cm on average, many times more than any step of the motion itself.
    jumps = np.flatnonzero(steps[:5] > max(0.03, 5.0 * float(np.percentile(steps[5:], 99))))
    return int(jumps[-1]) + 1 if len(jumps) else 0


def floor_level(points: dict[str, np.ndarray]) -> float:
    """Height at which the lowest foot joint stands, in the unit of the points."""
    feet = [name for name in points if name.endswith(("_ankle", "_foot", "_toe"))]
    return float(np.percentile(np.min([points[name][:, 2] for name in feet], axis=0), FLOOR_PERCENTILE))
