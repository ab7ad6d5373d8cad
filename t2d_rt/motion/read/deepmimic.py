"""Read DeepMimic's motions (JSON with "Frames").

A frame is [duration, root position, root rotation, then the rotations of chest, neck, right hip, knee, ankle, shoulder, elbow,
left hip, knee, ankle, shoulder, elbow]: quaternions w, x, y, z in the parents' frames, one angle about z for knees and elbows
(Peng et al. 2018). Metres, y up, facing x. Joints lie as in its humanoid3d, whose offsets are in skeletons.yaml.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.quaternions import about_axis, multiply, normalise, rotate
from t2d_rt.motion.read.clock import tidy
from t2d_rt.motion.read.samples import LARGEST, filled
from t2d_rt.motion.read.tracks import Times, Tracks
from t2d_rt.motion.skeletons import tables

SHORTEST_S, LONGEST_S = 1e-4, 1.0
WIDTH = 44

Z = np.array([0.0, 0.0, 1.0])

JOINTS: Mapping[str, tuple[str, list[float], int]] = tables()["humanoid3d_joints"]
"""For each joint: its parent, its offset from there [m], and how many numbers its rotation has."""

_stops = 8 + np.cumsum([size for *_, size in JOINTS.values()])
COLUMNS = {
    name: slice(stop - size, stop) for (name, (*_, size)), stop in zip(JOINTS.items(), _stops.tolist(), strict=True)
}
"""Columns of a frame that hold the rotation of each joint."""

QUATERNIONS = (slice(4, 8), *(columns for columns in COLUMNS.values() if columns.stop - columns.start == 4))

ENDS: Mapping[str, tuple[str, list[float]]] = tables()["humanoid3d_ends"]
"""For each canonical joint that the humanoid lacks: the joint that carries it, and its offset from there [m]."""


def read_deepmimic(tree: dict[str, Any], path: Path) -> Tracks:
    """Tracks of the joints that a JSON tree describes; raises an InputError if it is no motion of DeepMimic."""
    frames, lost = _frames(tree["Frames"], path)
    steps = frames[:-1, 0] if len(frames) > 1 else frames[:, 0]
    if not (steps.min() >= SHORTEST_S and steps.max() <= LONGEST_S):
        raise InputError(
            f"{path}: frames must last {SHORTEST_S} to {LONGEST_S:g} s each, these last {steps.min():g} to {steps.max():g} s"
        )
    step_s = float(np.median(steps))
    uneven = len(frames) > 3 and bool(np.abs(steps - step_s).max() > 0.01 * step_s)
    times = Times(values=np.concatenate([[0.0], np.cumsum(steps)]), name="durations", unit_s=1.0) if uneven else None
    quaternion = normalise(frames[:, [5, 6, 7, 4]])
    turned, at = {"root": quaternion}, {"root": frames[:, 1:4]}
    for name, (parent, offset, _) in JOINTS.items():
        values = frames[:, COLUMNS[name]]
        local = about_axis(Z, values[:, 0]) if values.shape[1] == 1 else normalise(values[:, [1, 2, 3, 0]])
        at[name] = at[parent] + rotate(turned[parent], np.array(offset))
        turned[name] = multiply(turned[parent], local)
    points = {name: at[name] for name in JOINTS if name != "chest"}
    orientations = {name: turned[name] for name in points}
    for name, (carrier, offset) in ENDS.items():
        points[name] = at[carrier] + rotate(turned[carrier], np.array(offset))
        orientations[name] = turned[carrier]
    rate_hz = tidy(1.0 / step_s, 2e-4)
    clauses = ("humanoid3d's bone lengths", "feet, hands and head rigid on ankles, forearms and neck")
    return Tracks(
        form="DeepMimic", points=points, turned=orientations, rate_hz=rate_hz, rate_assumed=uneven, times=times, clauses=clauses,
        unit_m=1.0, up="y",
    ).without(lost)  # fmt: skip


def _frames(rows: Any, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """All frames (T, 44), and a mask (T,) of those that hold no pose."""
    if not isinstance(rows, list) or not rows:
        raise InputError(f'{path} has no list "Frames"; expected a DeepMimic motion of {WIDTH} numbers a frame')
    well_formed = all(
        isinstance(row, list)
        and len(row) == WIDTH
        and all(type(number) in (int, float) and not abs(number) >= LARGEST for number in row)
        for row in rows
    )
    if not well_formed:
        lengths = sorted({len(row) if isinstance(row, list) else 0 for row in rows})
        raise InputError(
            f"{path}: every frame must hold {WIDTH} finite numbers; these hold {shown(lengths)}, or other than numbers"
        )
    frames = np.array(rows, dtype=float)
    frames[:, 1:], lost = filled(frames[:, 1:], f"{path}", slice(3))
    # Quaternions of the published kick deviate by 0.42, because they were interpolated linearly.
    if not all((np.abs(np.linalg.norm(frames[:, columns], axis=-1) - 1) < 0.5).all() for columns in QUATERNIONS):
        raise InputError(
            f"{path}: rotations must be unit quaternions w, x, y, z; the file is of another character or damaged"
        )
    return frames, lost
