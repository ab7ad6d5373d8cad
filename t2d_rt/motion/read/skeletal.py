"""BVH skeleton -> `Motion`: the file's joints are mapped to the canonical ones, what it does not say is found from the body."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from t2d_rt.motion.read.bvh import forward_kinematics, read_bvh
from t2d_rt.motion.read.detect import add_feet, floor_level, to_z_up, tpose_frames, unit, up_axis
from t2d_rt.motion.read.positions import assemble
from t2d_rt.motion.read.reading import Reading, smoothed
from t2d_rt.motion.skeletons import canonical, detect_flavour, plain_names, restored_offsets, source_joints
from t2d_rt.types.motion import Motion


def read_skeletal(path: Path, reading: Reading) -> Motion:
    """A .bvh or .bvh.gz file as a motion with its report."""
    raw = read_bvh(path)
    names = plain_names(raw.names)
    kind = detect_flavour(names, raw.parents, reading.flavour)
    offsets, restored = restored_offsets(raw, names, kind)
    points, orientations = canonical(raw, names, kind, *forward_kinematics(raw, offsets, source_joints(names, kind)))
    unit_m, stature_m = unit(points, reading.units)
    axis = reading.up or up_axis(points)
    points, orientations = to_z_up(points, orientations, axis, unit_m)
    add_feet(points, orientations, stature_m)
    drop = reading.drop_tpose
    dropped = tpose_frames(points) if drop is None else (max(tpose_frames(points), 1) if drop else 0)
    points, orientations = (
        {name: track[dropped:] for name, track in group.items()} for group in (points, orientations)
    )
    level = floor_level(points) if reading.floor is None else float(reading.floor)
    motion = assemble(points, orientations, raw.rate_hz, level)
    del points, orientations  # half of the memory that a long motion takes
    motion, smoothing = smoothed(motion, reading.smooth_hz)
    told = [
        f"BVH, {len(motion.joints)} frames at {motion.rate_hz:g} Hz", f"flavour {kind.name}",
        f"1 unit = {unit_m:.4g} m (stature {stature_m:.2f} m)", f"up {axis}",
        f"first {dropped} frame(s) dropped (T-pose)" if dropped else "no T-pose", f"floor at {level:.3f} m", smoothing,
    ]  # fmt: skip
    if restored:
        told.insert(2, f"lost bones restored at {', '.join(restored)}")
    return replace(motion, report="; ".join(told))
