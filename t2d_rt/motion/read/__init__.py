"""Files and arrays -> `Motion`: units, axes, floor and T-pose are found from the body, reported, open to override."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from t2d_rt.checks import LARGEST_M, file_path, flag, number, positive, text
from t2d_rt.errors import InputError, printable
from t2d_rt.motion.interpolate import JITTER_CUTOFF_HZ, JITTER_LIMIT_MPS, jitter_mps, smooth
from t2d_rt.motion.read.bvh import forward_kinematics, read_bvh
from t2d_rt.motion.read.detect import UNITS_M, Up, add_feet, floor_level, to_z_up, tpose_frames, unit, up_axis
from t2d_rt.motion.read.positions import assemble, motion_from_joints
from t2d_rt.motion.skeletons import canonical, detect_flavour, plain_names, restored_offsets, source_joints
from t2d_rt.types.motion import Motion

__all__ = ["load_motion", "motion_from_joints"]

LOWEST_CUTOFF_HZ = 0.1
"""Below, a low-pass leaves nothing of human movement and the filter's coefficients lose their digits."""


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
        unit_m, stature_m = unit(points, units)
        axis = up or up_axis(points)
        points, orientations = to_z_up(points, orientations, axis, unit_m)
        add_feet(points, orientations, stature_m)
        dropped = tpose_frames(points) if drop_tpose is None else (max(tpose_frames(points), 1) if drop_tpose else 0)
        points, orientations = (
            {name: track[dropped:] for name, track in group.items()} for group in (points, orientations)
        )
        level = floor_level(points) if floor is None else float(floor)
        motion = assemble(points, orientations, raw.rate_hz, level)
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
