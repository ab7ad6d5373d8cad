"""Read AMASS .npz files: axis-angle poses of SMPL's skeleton (SMPL-H, SMPL-X and kin), root translation, z up or y up.

The file holds no joints: they come from a body model that may not be shipped. Forward kinematics runs over the mean body's
skeleton in SMPL's rest pose (arms level to the sides, y up, facing z). All rotations are the file's; if the person walks, lengths
are scaled together to the stature at which planted feet slide least.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from t2d_rt.core.errors import InputError, warn
from t2d_rt.motion.quaternions import multiply, rotate
from t2d_rt.motion.read.arrays import Arrays
from t2d_rt.motion.read.clock import stated_rate, times_of
from t2d_rt.motion.read.detect import Up, stance_axis
from t2d_rt.motion.read.samples import filled
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.motion.skeletons import PARENT_OF, tables
from t2d_rt.types.motion import CANONICAL_JOINTS

STATURE_M = 1.70

MOVED = ("trans", "transl")
ROOT = ("root_orient", "global_orient")
BODY = ("pose_body", "body_pose")
"""Names in AMASS and in smplx of the root's track, of its rotation, and of the rotations of the other 21 joints."""

OF_SMPL = ("global_orient", *BODY, "betas", "mocap_framerate", "mocap_frame_rate")
"""Names that show that a file without the root's track holds rotations and not joints."""

BODY_ANGLES = 66
"""Numbers in the axis-angle vectors of the 22 canonical joints; hands, jaw and eyes follow."""
FORMS = {66: "AMASS", 72: "AMASS (SMPL)", 156: "AMASS (SMPL-H)", 165: "AMASS (SMPL-X)"}
"""The form of a file by how many numbers a frame has; other counts are those of matrices and the like."""

OFFSETS: dict[str, tuple[float, float, float]] = {
    name: (sign * x, y, z)
    for joint, (x, y, z) in tables()["smpl_offsets"].items()
    for name, sign in ((joint, 1.0), (joint.replace("left_", "right_"), -1.0 if joint.startswith("left_") else 1.0))
}
"""Offsets of joints from their parents in SMPL's rest pose, in statures."""

LOW_M = 0.04
"""Height above the 5th percentile of its own up to which a foot counts as planted [m]."""
SLOW_MPS = 0.5
"""Greatest speed of a planted foot [m/s]."""
SCALES = (0.8, 1.25)

CALIBRATION_FRAMES = 5
"""Frames at the start that may hold a calibration pose."""


def read_amass(arrays: Arrays) -> Tracks:
    """Tracks of the body's 22 joints and of the hands' ends; raises an InputError if an array is missing or has a wrong shape."""
    poses = _vectors(arrays, "poses", *FORMS) if "poses" in arrays else _joined(arrays)
    travel = arrays.first(*MOVED)
    if travel is None:
        raise InputError(
            f"{arrays.path} lacks {' or '.join(MOVED)}, the way of the root; store it, or zeros and root='feet' where it is unknown"
        )
    moved = arrays.samples(travel, (2,))
    if moved.shape != (len(poses), 3):
        raise InputError(
            f"{arrays.path}: {travel} must have shape ({len(poses)}, 3), a place for each frame of the poses, got {moved.shape}"
        )
    stated_hz = stated_rate(arrays, len(poses))
    if "poses" in arrays and stated_hz is None and times_of(arrays, len(poses)) is None:
        raise InputError(f"{arrays.path} has no mocap_framerate; store it, or give rate_hz")
    # Parameters of smplx that state no rate were fitted to a video.
    rate_hz = stated_hz or (60.0 if "poses" in arrays else 30.0)
    rows, lost = filled(np.concatenate([moved, poses[:, :BODY_ANGLES]], axis=1), f"{arrays.path}", slice(3))
    moved = rows[:, :3]
    turned = _orientations(rows[:, 3:].reshape(len(poses), -1, 3))
    _tell_of_zeros(poses[:, 3:BODY_ANGLES])
    about = _forward(turned)
    # A lying body rests on a floor along z as well: another axis must keep the level of the lowest joint clearly better.
    up = stance_axis({name: moved + STATURE_M * point for name, point in about.items()}, "z", margin=0.01)
    stature, stature_source = _stature(about, moved, rate_hz, up)
    points = {name: moved + stature * point for name, point in about.items()}
    form = "parameters of smplx" if arrays.first("global_orient") else FORMS[poses.shape[1]]
    turned = {name: turned[name] for name in points}
    tracks = Tracks(form=form, points=points, turned=turned, rate_hz=rate_hz, unit_m=1.0, up=up)
    clause = f"bone lengths of SMPL's mean body, {stature:.2f} m tall ({stature_source}), betas not used"
    return replace(tracks.without(lost), rate_assumed=stated_hz is None).saying(clause)


def _tell_of_zeros(body: np.ndarray) -> None:
    """Warns where some frames of the body's rotations (T, 63), behind those that may be a calibration pose, are all zeros."""
    zeros = np.all(body == 0, axis=1)
    if not zeros.all() and (count := np.count_nonzero(zeros[CALIBRATION_FRAMES:])):
        first = CALIBRATION_FRAMES + int(zeros[CALIBRATION_FRAMES:].argmax())
        warn(
            f"in {count} of {len(body)} frames, first in frame {first}, all rotations of the body are zero, a T-pose, as where a "
            "person was lost; cut these frames, or store NaN in them"
        )


def _joined(arrays: Arrays) -> np.ndarray:
    """Poses (T, 66) of files that keep the root apart."""
    root, body = (arrays.first(*names) for names in (ROOT, BODY))
    if root is None or body is None:
        raise InputError(f"{arrays.path} lacks {' or '.join(BODY)}; store the body's 21 rotations beside the root's")
    # SMPL has two joints more.
    turn, rest = _vectors(arrays, root, 3), _vectors(arrays, body, BODY_ANGLES - 3, BODY_ANGLES + 3)
    if len(turn) != len(rest):
        raise InputError(f"{arrays.path}: {root} has {len(turn)} frames and {body} {len(rest)}; store as many of both")
    return np.concatenate([turn, rest[:, : BODY_ANGLES - 3]], axis=1)


def _vectors(arrays: Arrays, name: str, *widths: int) -> np.ndarray:
    """Axis-angle vectors (T, N) from (T, N) or (T, N / 3, 3), with N one of `widths`; raises an InputError for others."""
    vectors = arrays.samples(name, (2, 3, 4))
    flat = vectors.reshape(len(vectors), -1)
    if flat.shape[1] not in widths or vectors.ndim == 4 or (vectors.ndim == 3 and vectors.shape[2] != 3):
        raise InputError(
            f"{arrays.path}: {name} must be axis-angle vectors, {' or '.join(map(str, widths))} numbers a frame, got shape "
            f"{vectors.shape}; convert rotation matrices and the like"
        )
    return flat


def _orientations(vectors: np.ndarray) -> dict[str, np.ndarray]:
    """Global orientations (T, 4) from axis-angle vectors (T, 22, 3) in the parents' frames; hands' ends follow the wrists."""
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    # sin(a/2) / a, by np.sinc so that it holds at 0 too
    local = np.concatenate([0.5 * np.sinc(angle / (2 * math.pi)) * vectors, np.cos(0.5 * angle)], axis=-1)
    turned: dict[str, np.ndarray] = {}
    for joint, name in enumerate(CANONICAL_JOINTS):
        parent = PARENT_OF[name]
        turned[name] = local[:, joint] if parent is None else multiply(turned[parent], local[:, joint])
    return turned | {f"{side}_hand": turned[f"{side}_wrist"] for side in ("left", "right")}


def _forward(turned: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Positions (T, 3) of the joints relative to the pelvis, over stature."""
    about = {"pelvis": np.zeros((len(turned["pelvis"]), 3))}
    for name, parent in PARENT_OF.items():
        if parent is not None and name in OFFSETS:
            about[name] = about[parent] + rotate(turned[parent], np.array(OFFSETS[name]))
    return about


def _stature(about: dict[str, np.ndarray], moved: np.ndarray, rate_hz: float, axis: Up = "z") -> tuple[float, str]:
    """Stature [m] at which planted feet slide least, and how it was found.

    The velocity of a foot is v_root + stature v_about, which is 0 while it is planted: the result is the median of the statures
    that follow from the components of the velocity of each low and slow foot.
    """
    up, sign = "xyz".index(axis[-1]), -1.0 if axis[0] == "-" else 1.0
    level = [k for k in range(3) if k != up]
    if np.linalg.norm(np.ptp(moved[:, level], axis=0)) < 0.8 or len(moved) < 3:
        return STATURE_M, "assumed"
    root = np.diff(moved, axis=0)[:, level] * rate_hz
    rows, root_velocities = [], []
    for name in ("left_foot", "right_foot"):
        foot = moved + STATURE_M * about[name]
        velocity = np.diff(foot, axis=0) * rate_hz
        height = sign * foot[:, up]
        low = height[1:] < np.percentile(height, 5) + LOW_M
        planted = low & (np.linalg.norm(velocity, axis=-1) < SLOW_MPS)
        rows.append((np.diff(about[name], axis=0)[:, level] * rate_hz)[planted])
        root_velocities.append(-root[planted])
    slope, target = np.concatenate(rows).ravel(), np.concatenate(root_velocities).ravel()
    # The median resists outliers of feet that roll or slip; slow components are left out, as they give noise over noise.
    strong = np.abs(slope) > 0.25
    if np.count_nonzero(strong) < 20:
        return STATURE_M, "assumed"
    stature = float(np.median(target[strong] / slope[strong]))
    if not SCALES[0] <= stature / STATURE_M <= SCALES[1]:
        return STATURE_M, "assumed"
    return stature, "at which planted feet slide least"
