"""DeepMimic's motions (JSON with "Frames") -> tracks.

A frame is [duration, root position, root rotation, then the rotations of chest, neck, right hip, knee, ankle, shoulder, elbow,
left hip, knee, ankle, shoulder, elbow]: quaternions w, x, y, z in the parents' frames, one angle about z for knees and elbows
(Peng et al. 2018). Metres, y up, facing x. Joints lie as in its humanoid3d, whose offsets are below.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.motion.quaternions import about_axis, continuous, multiply, normalise, rotate
from t2d_rt.motion.read.bvh import MAX_FRAMES
from t2d_rt.motion.read.complete import HEAD
from t2d_rt.motion.read.samples import filled
from t2d_rt.motion.read.tracks import Tracks

MAX_BYTES = 100_000_000
SHORTEST_S, LONGEST_S = 1e-4, 1.0
WIDTH = 44

LEAST_UNIT = 0.5
"""Deviation of a quaternion's length from 1 from which it is none; the published kick has 0.42, by linear interpolation."""

Z = np.array([0.0, 0.0, 1.0])

JOINTS: dict[str, tuple[str, tuple[float, float, float], slice]] = {
    "chest": ("root", (0.0, 0.236151, 0.0), slice(8, 12)),
    "neck": ("chest", (0.0, 0.223894, 0.0), slice(12, 16)),
    "right_hip": ("root", (0.0, 0.0, 0.084887), slice(16, 20)),
    "right_knee": ("right_hip", (0.0, -0.421546, 0.0), slice(20, 21)),
    "right_ankle": ("right_knee", (0.0, -0.409870, 0.0), slice(21, 25)),
    "right_shoulder": ("chest", (-0.02405, 0.24350, 0.18311), slice(25, 29)),
    "right_elbow": ("right_shoulder", (0.0, -0.274788, 0.0), slice(29, 30)),
    "left_hip": ("root", (0.0, 0.0, -0.084887), slice(30, 34)),
    "left_knee": ("left_hip", (0.0, -0.421546, 0.0), slice(34, 35)),
    "left_ankle": ("left_knee", (0.0, -0.409870, 0.0), slice(35, 39)),
    "left_shoulder": ("chest", (-0.02405, 0.24350, -0.18311), slice(39, 43)),
    "left_elbow": ("left_shoulder", (0.0, -0.274788, 0.0), slice(43, 44)),
}
"""Joint -> its parent, its offset from there [m], and the columns of its rotation."""

QUATERNIONS = (slice(4, 8), *(columns for _, _, columns in JOINTS.values() if columns.stop - columns.start == 4))

TRUNK_M = 0.236151 + 0.24350
WRIST = (0.0, -0.258947, 0.0)

ENDS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "pelvis": ("root", (0.0, 0.0, 0.0)),
    "spine1": ("root", (0.0, 0.118, 0.0)),
    "spine2": ("chest", (0.0, 0.0, 0.0)),
    "spine3": ("chest", (0.0, 0.112, 0.0)),
    "head": ("neck", (TRUNK_M * HEAD[0], TRUNK_M * HEAD[2], 0.0)),
    **{
        name: point
        for side, sign in (("right", 1.0), ("left", -1.0))
        for name, point in {
            f"{side}_collar": ("chest", (0.0, 0.22, 0.02 * sign)),
            f"{side}_wrist": (f"{side}_elbow", WRIST),
            f"{side}_foot": (f"{side}_ankle", (0.095, -0.035, 0.0)),
            f"{side}_toe": (f"{side}_ankle", (0.1335, -0.035, 0.0)),
        }.items()
    },
}
"""Canonical joint -> the joint that carries it and where, ahead and up of it [m]: the humanoid ends at wrists, ankles and neck.
The ball of its foot lies within the box of the ankle, which reaches 0.1335 m ahead."""


def read_deepmimic(path: Path) -> Tracks:
    """Joints with the file's rotations."""
    frames, lost = _frames(path)
    frames, lost, step_s, told = _even(frames, lost, path)
    quaternion = normalise(frames[:, [5, 6, 7, 4]])
    turned, at = {"root": quaternion}, {"root": frames[:, 1:4]}
    for name, (parent, offset, columns) in JOINTS.items():
        values = frames[:, columns]
        local = about_axis(Z, values[:, 0]) if values.shape[1] == 1 else normalise(values[:, [1, 2, 3, 0]])
        at[name] = at[parent] + rotate(turned[parent], np.array(offset))
        turned[name] = multiply(turned[parent], local)
    points = {name: at[name] for name in JOINTS if name != "chest"}
    orientations = {name: turned[name] for name in points}
    for name, (carrier, offset) in ENDS.items():
        points[name] = at[carrier] + rotate(turned[carrier], np.array(offset))
        orientations[name] = turned[carrier]
    rate_hz = 1.0 / step_s
    rate_hz = float(round(rate_hz)) if abs(rate_hz - round(rate_hz)) < 2e-4 * rate_hz else rate_hz
    told = ("humanoid3d's bone lengths", "feet, hands and head rigid on ankles, forearms and neck", *told)
    return Tracks(
        form="DeepMimic", points=points, turned=orientations, rate_hz=rate_hz, told=told, unit_m=1.0, up="y"
    ).without(lost)


def _even(frames: np.ndarray, lost: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray, float, tuple[str, ...]]:
    """Frames that follow each other evenly, which are lost, their step [s], and a clause where they had to be interpolated."""
    steps = frames[:-1, 0] if len(frames) > 1 else frames[:, 0]
    step_s = float(np.median(steps))
    if not (steps.min() >= SHORTEST_S and steps.max() <= LONGEST_S):
        raise InputError(
            f"{path}: frames must last {SHORTEST_S} to {LONGEST_S:g} s each, these last {steps.min():g} to {steps.max():g} s"
        )
    if np.abs(steps - step_s).max() <= 0.01 * step_s or len(frames) < 4:
        return frames, lost, step_s, ()
    from scipy.interpolate import make_interp_spline

    for columns in QUATERNIONS:
        frames[:, columns] = continuous(normalise(frames[:, columns]))
    times = np.concatenate([[0.0], np.cumsum(steps)])
    even = np.arange(int(times[-1] / step_s + 1e-3) + 1) * step_s
    if len(even) > MAX_FRAMES:
        raise InputError(f"{path}: {len(even)} frames are too many, {MAX_FRAMES} are read at most; cut the motion")
    told = f"frames of {steps.min():.4f} to {steps.max():.4f} s interpolated"
    here = np.minimum(even, times[-1])
    found = make_interp_spline(times[~lost], frames[~lost], k=min(3, np.count_nonzero(~lost) - 1))(here)
    near = np.interp(here, times, lost.astype(float)) > 0.5
    return np.asarray(found), near, step_s, (told,)


def _frames(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """All frames (T, 44), and which hold no pose, (T,)."""
    data = read_bytes(path, limit=MAX_BYTES, noun="DeepMimic file")
    try:
        found: Any = json.loads(data)
    except (ValueError, RecursionError):
        raise InputError(f'{path} is not valid JSON; a DeepMimic motion is an object with "Frames"') from None
    rows = found.get("Frames") if isinstance(found, dict) else None
    if not isinstance(rows, list) or not rows:
        raise InputError(f'{path} has no list "Frames"; expected a DeepMimic motion of {WIDTH} numbers a frame')
    if len(rows) > MAX_FRAMES:
        raise InputError(f"{path}: {len(rows)} frames are too many, {MAX_FRAMES} are read at most; cut the motion")
    plain = all(
        isinstance(row, list)
        and len(row) == WIDTH
        and all(type(each) in (int, float) and not abs(each) >= 1e9 for each in row)
        for row in rows
    )
    if not plain:
        lengths = sorted({len(row) if isinstance(row, list) else 0 for row in rows})
        raise InputError(
            f"{path}: every frame must hold {WIDTH} finite numbers; these hold {shown(lengths)}, or other than numbers"
        )
    frames = np.array(rows, dtype=float)
    frames[:, 1:], lost = filled(frames[:, 1:], f"{path}", slice(3))
    if not all((np.abs(np.linalg.norm(frames[:, each], axis=-1) - 1) < LEAST_UNIT).all() for each in QUATERNIONS):
        raise InputError(
            f"{path}: rotations must be unit quaternions w, x, y, z; the file is of another character or damaged"
        )
    return frames, lost
