"""Files and arrays -> `Motion`: units, axes, floor and T-pose are found from the body, reported, open to override."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2d_rt.checks import LARGEST_M, array, file_path, flag, number, positive, shown, text
from t2d_rt.errors import InputError, printable
from t2d_rt.motion import quaternions
from t2d_rt.motion.bvh import forward_kinematics, read_bvh
from t2d_rt.motion.interpolate import JITTER_CUTOFF_HZ, JITTER_LIMIT_MPS, jitter_mps, smooth
from t2d_rt.motion.skeletons import PARENT_OF, canonical, detect_flavour, plain_names, restored_offsets, source_joints
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "ft": 0.3048, "cmu": 0.0254 / 0.45}
"""Metres per unit; one unit of the CMU database is 1/0.45 inch."""

STATURE_PER_CHAIN = 1.142
"""Stature over (hip - knee - ankle) + (hips - shoulders) + (shoulders - head), of the adult template; CMU, iClone and bvh-toolbox
skeletons keep to it within 3 %."""

AUTO_STATURE_M = (1.1, 2.5)
"""Statures at which the unit is found without doubt: neighbouring units (cm, inch, CMU) differ by 2.2 or more."""

STATURE_M = (0.4, 3.0)
"""Statures accepted when the unit is given (a toddler ... a giant)."""

FLOOR_PERCENTILE = 2.0
"""The floor is where the lowest foot joint is in the lowest 2 % of frames: robust to a bad frame, right for jumps."""

LOWEST_CUTOFF_HZ = 0.1
"""Below, a low-pass leaves nothing of human movement and the filter's coefficients lose their digits."""

Up = Literal["x", "y", "z", "-x", "-y", "-z"]


def load_motion(
    path: str | Path,
    *,
    units: float | str | None = None,
    up: Up | None = None,
    floor: float | None = None,
    drop_tpose: bool | None = None,
    smooth_hz: float | Literal["auto"] | None = "auto",
    flavour: str | None = None,
) -> Motion:
    """Read a .bvh or .bvh.gz file: canonical joints, metres, right-handed, z up, floor at z = 0.

    Everything left None is detected and told in `Motion.report`.

    units: length of the file's unit in metres, or its name: m, cm, mm, inch, ft or cmu.
    up: the file's upward axis, such as "y" or "-z".
    floor: height of the floor in the file [m].
    drop_tpose: whether the calibration pose at the start is dropped.
    smooth_hz: cut-off of a low-pass filter [Hz]; null does not filter, "auto" filters at 12 Hz where the file jitters.
    flavour: how the file names its joints, one of `t2d_rt.motion.flavours()`.
    """
    path = file_path("path", path)
    _check_reading(units, up, floor, drop_tpose, smooth_hz, flavour)
    raw = read_bvh(path)
    names = plain_names(raw.names)
    try:
        kind = detect_flavour(names, raw.parents, flavour)
        offsets, restored = restored_offsets(raw, names, kind)
        points, orientations = canonical(
            raw, names, kind, *forward_kinematics(raw, offsets, source_joints(names, kind))
        )
        unit_m, stature_m = _unit(points, units)
        axis = up or _up_axis(points)
        points, orientations = _to_z_up(points, orientations, axis, unit_m)
        _add_feet(points, orientations, stature_m)
        dropped = _tpose_frames(points) if drop_tpose is None else (max(_tpose_frames(points), 1) if drop_tpose else 0)
        points, orientations = (
            {name: track[dropped:] for name, track in group.items()} for group in (points, orientations)
        )
        level = _floor_level(points) if floor is None else float(floor)
        motion = _assemble(points, orientations, raw.rate_hz, level)
        del points, orientations  # half of the memory that a long motion takes
        motion, smoothing = _smoothed(motion, smooth_hz)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    told = [
        f"BVH, {len(motion.joints)} frames at {motion.rate_hz:g} Hz", f"flavour {kind.name}",
        f"1 unit = {unit_m:.4g} m (stature {stature_m:.2f} m)", f"up {axis}",
        f"first {dropped} frame(s) dropped (T-pose)" if dropped else "no T-pose", f"floor at {level:.3f} m", smoothing,
    ]  # fmt: skip
    if restored:
        told.insert(2, f"lost bones restored at {', '.join(restored)}")
    return replace(motion, report="; ".join(told), origin=(_origin(Path(path)), *motion.origin))


def _origin(path: Path) -> str:
    """A file by its name, without the folders of this machine, and its content."""
    with path.open("rb") as file:
        return f"{printable(path.name)}, sha256 {hashlib.file_digest(file, 'sha256').hexdigest()}"


def _check_reading(units: Any, up: Any, floor: Any, drop_tpose: Any, smooth_hz: Any, flavour: Any) -> None:
    if units is not None and not isinstance(units, str):
        positive("units", units, hint=f"metres per unit or one of {', '.join(UNITS_M)}")
    if floor is not None:
        number("floor", floor, -LARGEST_M, LARGEST_M, unit="m")
    if drop_tpose is not None:
        flag("drop_tpose", drop_tpose)
    if smooth_hz is not None and not (isinstance(smooth_hz, str) and smooth_hz == "auto"):
        number("smooth_hz", smooth_hz, LOWEST_CUTOFF_HZ, unit="Hz", hint="a cut-off in Hz, None or 'auto'")
    for name, value in (("up", up), ("flavour", flavour)):
        if value is not None:
            text(name, value)


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

    Orientations turn the bones by the smallest rotation from the first frame on (positions do not show a bone's twist);
    the pelvis turns with hips and spine.
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
    return replace(_assemble(points, _orientations_from_bones(points), rate_hz, 0.0, report), placed=placed)


def stature_m(points: dict[str, np.ndarray]) -> float:
    """Stature from bone lengths, whatever the pose (+- 5 %), in the unit of the points.

    Only joints that all skeletons have in one place count: the pelvis lies up to 9 cm above the hips (CMU), and how many joints a
    spine has, and how it winds through them, differs. A sum over them is too long by 4 to 9 % in files with full spines.
    """

    def length(lower: np.ndarray, upper: np.ndarray) -> float:
        return float(np.median(np.linalg.norm(lower - upper, axis=-1)))

    def middle(joint: str) -> np.ndarray:
        return 0.5 * (points[f"left_{joint}"] + points[f"right_{joint}"])

    legs = [
        length(points[f"{side}_{lower}"], points[f"{side}_{upper}"])
        for side in ("left", "right")
        for lower, upper in (("hip", "knee"), ("knee", "ankle"))
    ]
    trunk = length(middle("hip"), middle("shoulder")) + length(middle("shoulder"), points["head"])
    return STATURE_PER_CHAIN * (0.5 * sum(legs) + trunk)


def facing(points: dict[str, np.ndarray]) -> np.ndarray:
    """Horizontal unit vectors (T, 3) that the hips and shoulders face (z up)."""
    across = points["left_hip"] - points["right_hip"] + points["left_shoulder"] - points["right_shoulder"]
    forward = np.cross(across, [0.0, 0.0, 1.0])
    return forward / np.maximum(np.linalg.norm(forward, axis=-1, keepdims=True), 1e-9)


def _unit(points: dict[str, np.ndarray], units: float | str | None) -> tuple[float, float]:
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


def _up_axis(points: dict[str, np.ndarray]) -> Up:
    """The axis along which the head is above the ankles; y, BVH's usual one, unless another is clearly longer."""
    posture = points["head"] - 0.5 * (points["left_ankle"] + points["right_ankle"])
    mean = np.median(posture, axis=0)
    axis = int(np.argmax(np.abs(mean) * np.array([1.0, 1.5, 1.0])))
    return ("-" if mean[axis] < 0 else "") + "xyz"[axis]  # type: ignore[return-value]


def _to_z_up(
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


def _add_feet(points: dict[str, np.ndarray], orientations: dict[str, np.ndarray], tall_m: float) -> None:
    """Balls of the feet where the file ends at the ankle: 7 % of the stature ahead, 3.5 % down, rigid on the ankle."""
    ahead = tall_m * (0.07 * facing(points) - 0.035 * np.array([0.0, 0.0, 1.0]))
    for side in ("left", "right"):
        if f"{side}_foot" not in points:
            ankle = orientations[f"{side}_ankle"]
            local = np.median(quaternions.rotate(quaternions.conjugate(ankle), ahead), axis=0)
            points[f"{side}_foot"] = points[f"{side}_ankle"] + quaternions.rotate(ankle, local)
            orientations[f"{side}_foot"] = ankle


def _tpose_frames(points: dict[str, np.ndarray]) -> int:
    """Frames before a jump of the pose within the first five steps: a calibration pose put in front of the motion."""
    pose = np.stack(list(points.values()), axis=1)
    pose = pose - pose[:, :1]
    steps = np.linalg.norm(np.diff(pose, axis=0), axis=-1).mean(axis=1)
    if len(steps) < 10:
        return 0
    # A jump moves the joints by several cm on average, many times more than any step of the motion itself.
    jumps = np.flatnonzero(steps[:5] > max(0.03, 5.0 * float(np.percentile(steps[5:], 99))))
    return int(jumps[-1]) + 1 if len(jumps) else 0


def _floor_level(points: dict[str, np.ndarray]) -> float:
    feet = [name for name in points if name.endswith(("_ankle", "_foot", "_toe"))]
    return float(np.percentile(np.min([points[name][:, 2] for name in feet], axis=0), FLOOR_PERCENTILE))


def _assemble(
    points: dict[str, np.ndarray], orientations: dict[str, np.ndarray], rate_hz: float, floor_m: float, report: str = ""
) -> Motion:
    names = tuple(name for name in PARENT_OF if name in points)
    parents = tuple(names.index(str(PARENT_OF[name])) if PARENT_OF[name] else -1 for name in names)
    joints = np.stack([points[name] for name in names], axis=1) - np.array([0.0, 0.0, floor_m])
    rotations = quaternions.continuous(np.stack([orientations[name] for name in names], axis=1))
    return Motion(
        joints=joints, rotations=rotations, rate_hz=rate_hz, names=names, parents=parents, placed=False, report=report
    )


def _smoothed(motion: Motion, smooth_hz: float | str | None) -> tuple[Motion, str]:
    if smooth_hz is None:
        return motion, "not smoothed"
    if smooth_hz != "auto":
        return smooth(motion, float(smooth_hz)), f"smoothed at {float(smooth_hz):g} Hz"
    jitter = jitter_mps(motion)
    if jitter <= JITTER_LIMIT_MPS:
        return motion, f"not smoothed (jitter {jitter:.3f} m/s above {JITTER_CUTOFF_HZ:g} Hz)"
    told = f"smoothed at {JITTER_CUTOFF_HZ:g} Hz (jitter {jitter:.2f} m/s above it)"
    return smooth(motion, JITTER_CUTOFF_HZ), told


def _orientations_from_bones(points: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    main_child = {parent: child for child, parent in PARENT_OF.items() if child in points} | {"spine3": "neck"}
    across = points["left_hip"] - points["right_hip"]
    upward = np.cross(np.cross(across, points["spine1"] - points["pelvis"]), across)
    x, z = (v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12) for v in (across, upward))
    frames = np.stack([x, np.cross(z, x), z], axis=-1)
    orientations = {"pelvis": quaternions.from_matrix(frames @ frames[0].T)}
    for name in list(points)[1:]:
        above = orientations[str(PARENT_OF[name])]
        child = main_child.get(name)
        if child is None:
            orientations[name] = above
            continue
        bone = points[child] - points[name]
        if not (np.linalg.norm(bone, axis=-1) > 1e-9).all():
            raise InputError(f"joints {name!r} and {child!r} coincide; a bone needs a length to have a direction")
        carried = quaternions.rotate(above, quaternions.rotate(quaternions.conjugate(above[0]), bone[0]))
        orientations[name] = quaternions.multiply(quaternions.between(carried, bone), above)
    return orientations
