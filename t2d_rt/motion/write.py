"""Write a motion as a BVH file (`save_motion`), which this package, Blender and other programs read."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from t2d_rt.core.atomic_write import check_place, check_taken, replacing
from t2d_rt.core.checks import file_path, flag
from t2d_rt.core.errors import InputError, warn
from t2d_rt.motion import quaternions
from t2d_rt.motion.kinematics import LOWER_BACK, NAMES, PARENTS, poses_of
from t2d_rt.motion.skeletons import sided, tables
from t2d_rt.types.motion import OPTIONAL_JOINTS, Motion, checked_motion


def bvh_names() -> dict[str, str]:
    """Names of the joints in the file: Mixamo's, which animation programs know, and the lower back's in the CMU files."""
    return sided(tables()["flavours"]["mixamo"]["joints"]) | {LOWER_BACK: "LowerBack"}


def save_motion(motion: Motion, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a motion as a .bvh file: centimetres, y up, a T-pose at rest, Mixamo's joint names.

    Bones of a BVH file have constant lengths, so joints whose bones change length in the motion move by as much (about 1 mm in
    recordings). Read back, positions differ by no more than 0.1 mm beside that, and in height by where the reader finds the floor.
    Raises an InputError if the path does not end in .bvh, is a folder, or exists and `overwrite` is not set.
    """
    checked_motion(motion)
    target = check_target(path, overwrite=overwrite)
    if motion.carries:
        things = " and ".join(f"the {carried.thing}" for carried in motion.carries)
        verb, again = ("are", "them") if len(motion.carries) > 1 else ("is", "it")
        warn(f"a .bvh file holds joints alone, and {things} {verb} not among them; carry {again} again once it is read")
    text = bvh_text(motion)
    with replacing(target, partial(check_taken, target, overwrite=overwrite)) as new:
        new.write_text(text, encoding="ascii")


def check_target(path: str | Path, *, overwrite: bool) -> Path:
    """The path, if a motion can be written to it; raises an InputError otherwise."""
    flag("overwrite", overwrite)
    target = file_path("path", path)
    if target.suffix.lower() != ".bvh":
        raise InputError(f"a motion is written as .bvh, got '{target}'; change the file's ending")
    if target.is_dir():
        raise InputError(f"{target} is a folder; choose another name")
    check_place(target, overwrite=overwrite)
    return target


def bvh_text(motion: Motion) -> str:
    """The text of a BVH file: the axes x, y, z of the motion become z, x, y of the file, so that y is up."""
    poses = poses_of(motion)
    lines = ["HIERARCHY"]
    offsets = 100.0 * poses.skeleton.offsets[:, [1, 2, 0]]
    order: list[int] = []
    absent = OPTIONAL_JOINTS.keys() - set(motion.names)
    _joint(lines, order, 0, offsets, {name: word for name, word in bvh_names().items() if name not in absent})
    columns = [100.0 * poses.root[:, [1, 2, 0]]]
    columns += [_degrees(poses.local[:, joint][:, [1, 2, 0, 3]]) for joint in order]
    rows = np.round(np.concatenate(columns, axis=1), 5) + 0.0
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1.0 / poses.rate_hz:.10g}"]
    lines += [" ".join(f"{value:.5f}" for value in row) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def _joint(
    lines: list[str], order: list[int], joint: int, offsets: np.ndarray, called: Mapping[str, str], indent: str = ""
) -> None:
    """Appends the lines of a joint and of those below it; ends that the motion lacks are not in `called` and are left out."""
    name = NAMES[joint]
    order.append(joint)
    channels = "6 Xposition Yposition Zposition" if joint == 0 else "3"
    lines += [f"{indent}{'ROOT' if joint == 0 else 'JOINT'} {called[name]}", f"{indent}{{"]
    lines += [
        _offset(offsets[joint] if joint else np.zeros(3), indent),
        f"{indent}\tCHANNELS {channels} Zrotation Xrotation Yrotation",
    ]
    children = [child for child, parent in enumerate(PARENTS) if parent == joint]
    present = [child for child in children if NAMES[child] in called]
    for child in present:
        _joint(lines, order, child, offsets, called, indent + "\t")
    if not present:
        end = offsets[children[0]] if children else 0.2 * offsets[joint]
        lines += [f"{indent}\tEnd Site", f"{indent}\t{{", _offset(end, indent + "\t"), f"{indent}\t}}"]
    lines.append(f"{indent}}}")


def _offset(offset: np.ndarray, indent: str) -> str:
    return f"{indent}\tOFFSET {' '.join(f'{value:.6f}' for value in offset)}"


def _degrees(rotation: np.ndarray) -> np.ndarray:
    """Angles (T, 3) [deg] about z, x, y in that order of unit quaternions (T, 4): R = Rz Rx Ry."""
    x, y, z, w = np.moveaxis(quaternions.normalise(rotation), -1, 0)
    sine = np.clip(2 * (y * z + x * w), -1.0, 1.0)
    about_x = np.arcsin(sine)
    about_z = np.arctan2(-2 * (x * y - z * w), 1 - 2 * (x * x + z * z))
    about_y = np.arctan2(-2 * (x * z - y * w), 1 - 2 * (x * x + y * y))
    # At the pole, z and y turn about one axis: the whole angle is given to z.
    pole = np.abs(sine) > 1 - 1e-12
    about_z = np.where(pole, np.arctan2(2 * (x * y + z * w), 1 - 2 * (y * y + z * z)), about_z)
    about_y = np.where(pole, 0.0, about_y)
    return np.degrees(np.stack([about_z, about_x, about_y], axis=-1))
