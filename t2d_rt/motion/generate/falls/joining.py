"""From the lead to the simulated frames without a jump in position, orientation or speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.easing import minimum_jerk
from t2d_rt.motion.generate.falls.anatomy import Anatomy, matrices
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

JOIN_S = 0.25
"""Within which what differs between the lead and the humanoid fades away: a few degrees and millimetres."""

BEFORE = 3
"""Frames before the event whose course tells the speeds there."""

TOES = tuple(
    (CANONICAL_JOINTS.index(f"{side}_ankle"), CANONICAL_JOINTS.index(f"{side}_foot")) for side in ("left", "right")
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Skeleton:
    """A person's skeleton at the event: offsets in the parents' segments, and how fast they change in the lead's files."""

    anatomy: Anatomy
    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    """(J, 3) [m]."""
    drift: np.ndarray
    """Their rates (J, 3) [m/s]: files put some joints between others, and those are not quite fixed."""
    ends: np.ndarray
    """Rotations (J - 22, 4) of the optional joints in the segments of their parents."""


def skeleton_at(lead: Motion, anatomy: Anatomy, segments: np.ndarray, frame: int) -> Skeleton:
    """The skeleton of a lead with `segments` (T, 22, 3, 3) at a frame."""
    near = slice(max(frame - BEFORE, 0), frame + BEFORE + 1)
    parents = list(lead.parents[1:])
    local = np.zeros((len(lead.joints[near]), len(lead.names), 3))
    step = lead.joints[near, 1:] - lead.joints[near][:, parents]
    local[:, 1:] = np.einsum("tjki,tjk->tji", segments[near][:, parents], step)
    here = frame - near.start
    above = [lead.parents[joint] for joint in range(len(CANONICAL_JOINTS), len(lead.names))]
    back = quaternions.conjugate(quaternions.from_matrix(segments[frame, above]))
    return Skeleton(
        anatomy=anatomy, names=lead.names, parents=lead.parents, offsets=local[here],
        drift=_slope(local, here, lead.rate_hz), ends=quaternions.multiply(back, lead.rotations[frame, len(CANONICAL_JOINTS) :]),
    )  # fmt: skip


def _slope(values: np.ndarray, here: int, rate_hz: float) -> np.ndarray:
    """Rate of change (...) of values (T, ...) at a frame."""
    first, last = max(here - 1, 0), min(here + 1, len(values) - 1)
    return np.asarray((values[last] - values[first]) * rate_hz / (last - first))


def joined(
    skeleton: Skeleton, lead: Motion, segments: np.ndarray, frame: int, root_m: np.ndarray, reached: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Joints (K, J, 3) and segments (K, 22, 3, 3) from the event on.

    `root_m` (K, 3) and `reached` (K, 22, 3, 3) are the humanoid's, `segments` (T, 22, 3, 3) those of the lead.
    """
    rate = lead.rate_hz
    times = np.arange(len(root_m)) / rate
    fade = 1.0 - minimum_jerk(times / JOIN_S)

    def difference(value: np.ndarray, slope: np.ndarray) -> np.ndarray:
        shape = (len(times),) + (1,) * value.ndim
        return (value + slope * times.reshape(shape)) * fade.reshape(shape)

    root_rate = _slope(lead.joints[:, 0], frame, rate) - (root_m[1] - root_m[0]) * rate
    root = root_m + difference(lead.joints[frame, 0] - root_m[0], root_rate)
    # In each segment's own axes: what leads from the humanoid's orientation to the lead's, as a rotation vector.
    own = np.swapaxes(reached[0], -1, -2) @ segments[frame]
    spin = _spin(segments, frame, rate) - np.einsum(
        "jki,jk->ji", own, _vector(np.swapaxes(reached[0], -1, -2) @ reached[1]) * rate
    )
    turn = matrices(_exponential(difference(_vector(own), spin)))
    found = reached @ turn
    for ankle, toes in TOES:
        # Toes weigh next to nothing and jump as they touch the floor: they begin as the lead has them.
        local = quaternions.from_matrix(np.swapaxes(found[:, ankle], -1, -2) @ found[:, toes])
        held = np.broadcast_to(local[0], local.shape)
        found[:, toes] = found[:, ankle] @ matrices(quaternions.blend(held, local, (1.0 - fade)[:, None]))
    offsets = skeleton.offsets + difference(np.zeros_like(skeleton.drift), skeleton.drift)
    return placed_joints(root, found, offsets, skeleton.parents), found


def placed_joints(
    root_m: np.ndarray, segments: np.ndarray, offsets: np.ndarray, parents: tuple[int, ...]
) -> np.ndarray:
    """Joints (K, J, 3) of segments (K, 22, 3, 3) with offsets (K or 1, J, 3)."""
    offsets = np.broadcast_to(offsets, (len(root_m), *offsets.shape[-2:]))
    joints = np.empty_like(offsets)
    joints[:, 0] = root_m
    for joint, parent in enumerate(parents):
        if parent >= 0:
            joints[:, joint] = joints[:, parent] + np.einsum("tij,tj->ti", segments[:, parent], offsets[:, joint])
    return joints


def rotations_of(skeleton: Skeleton, segments: np.ndarray) -> np.ndarray:
    """The lead's kind of rotations (K, J, 4) of segments (K, 22, 3, 3)."""
    count = len(CANONICAL_JOINTS)
    own = quaternions.from_matrix(segments)
    above = [skeleton.parents[joint] for joint in range(count, len(skeleton.names))]
    ends = quaternions.multiply(own[:, above], skeleton.ends)
    return np.concatenate([skeleton.anatomy.rotations(segments), ends], axis=1)


def _spin(segments: np.ndarray, frame: int, rate_hz: float) -> np.ndarray:
    """Angular velocities (22, 3) in the segments' own axes."""
    first, last = max(frame - 1, 0), min(frame + 1, len(segments) - 1)
    return _vector(np.swapaxes(segments[first], -1, -2) @ segments[last]) * rate_hz / (last - first)


def _vector(rotation: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) of matrices (..., 3, 3)."""
    quaternion = quaternions.from_matrix(rotation)
    quaternion = quaternion * np.where(quaternion[..., 3:] < 0, -1.0, 1.0)
    sine = np.linalg.norm(quaternion[..., :3], axis=-1, keepdims=True)
    scale = np.where(sine > 1e-9, 2.0 * np.arctan2(sine, quaternion[..., 3:]) / np.maximum(sine, 1e-9), 2.0)
    return np.asarray(quaternion[..., :3] * scale)


def _exponential(vector: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of rotation vectors (..., 3)."""
    half = 0.5 * np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.concatenate([0.5 * vector * np.sinc(half / np.pi), np.cos(half)], axis=-1)
