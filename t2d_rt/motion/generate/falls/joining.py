"""Join a simulated fall to the motion before it, and let the person get up from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.generate.chain import rotation_vector
from t2d_rt.motion.generate.falls.humanoid import (
    RATE_HZ,
    SIDES,
    Anatomy,
    Humanoid,
    anatomy,
    coordinates,
    matrices,
    mujoco,
)
from t2d_rt.motion.interpolate import low_pass, minimum_jerk, resample
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, Motion, checked_motion

# --- from the lead to the simulated frames without a jump in position, orientation or speed ---


JOIN_S = 0.25
"""Time in which the difference between the lead and the humanoid, a few degrees and millimetres, fades away."""

BEFORE = 3
"""Frames before the event whose course tells the speeds there."""

TOES = tuple(tuple(CANONICAL_JOINTS.index(f"{side}_{joint}") for joint in ("ankle", "foot")) for side in SIDES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Skeleton:
    """A person's skeleton at the event: offsets in the parents' segments, and how fast they change in the lead."""

    anatomy: Anatomy
    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    """Offsets (J, 3) [m] of the joints."""
    drift: np.ndarray
    """Their rates (J, 3) [m/s], because files put some joints between others, and those are not quite fixed."""
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
        anatomy=anatomy,
        names=lead.names,
        parents=lead.parents,
        offsets=local[here],
        drift=_slope(local, here, lead.rate_hz),
        ends=quaternions.multiply(back, lead.rotations[frame, len(CANONICAL_JOINTS) :]),
    )


def _slope(values: np.ndarray, frame: int, rate_hz: float) -> np.ndarray:
    """Rate of change (...) of values (T, ...) at a frame."""
    first, last = max(frame - 1, 0), min(frame + 1, len(values) - 1)
    return np.asarray((values[last] - values[first]) * rate_hz / (last - first))


def joined(
    skeleton: Skeleton, lead: Motion, segments: np.ndarray, frame: int, root_m: np.ndarray, reached: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Joints (K, J, 3) [m] and segments (K, 22, 3, 3) from the event on.

    `root_m` (K, 3) and `reached` (K, 22, 3, 3) are the humanoid's, `segments` (T, 22, 3, 3) those of the lead.
    """
    rate = lead.rate_hz
    times_s = np.arange(len(root_m)) / rate
    root_rate = _slope(lead.joints[:, 0], frame, rate) - (root_m[1] - root_m[0]) * rate
    root = root_m + _fading(lead.joints[frame, 0] - root_m[0], root_rate, times_s)
    # In each segment's own axes: what leads from the humanoid's orientation to the lead's, as a rotation vector.
    difference = np.swapaxes(reached[0], -1, -2) @ segments[frame]
    turning = _vector(np.swapaxes(reached[0], -1, -2) @ reached[1]) * rate
    spin = _spin(segments, frame, rate) - np.einsum("jki,jk->ji", difference, turning)
    blended = reached @ matrices(_exponential(_fading(_vector(difference), spin, times_s)))
    remaining = 1.0 - minimum_jerk(times_s / JOIN_S)[:, None]
    for ankle, toes in TOES:
        # Toes weigh next to nothing and jump as they touch the floor, so they begin as the lead has them.
        local = quaternions.from_matrix(np.swapaxes(blended[:, ankle], -1, -2) @ blended[:, toes])
        held = np.broadcast_to(local[0], local.shape)
        blended[:, toes] = blended[:, ankle] @ matrices(quaternions.blend(held, local, 1.0 - remaining))
    offsets = skeleton.offsets + _fading(np.zeros_like(skeleton.drift), skeleton.drift, times_s)
    return placed_joints(root, blended, offsets, skeleton.parents), blended


def _fading(value: np.ndarray, slope: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """A difference (...) that changes by `slope` a second and fades away within `JOIN_S`: (T, ...)."""
    column = (slice(None), *[None] * value.ndim)
    return (value + slope * times_s[column]) * (1.0 - minimum_jerk(times_s / JOIN_S))[column]


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
    """Rotations (K, J, 4) of segments (K, 22, 3, 3), counted from the same axes as the lead's."""
    count = len(CANONICAL_JOINTS)
    orientations = quaternions.from_matrix(segments)
    above = [skeleton.parents[joint] for joint in range(count, len(skeleton.names))]
    ends = quaternions.multiply(orientations[:, above], skeleton.ends)
    return np.concatenate([skeleton.anatomy.rotations(segments), ends], axis=1)


def _spin(segments: np.ndarray, frame: int, rate_hz: float) -> np.ndarray:
    """Angular velocities (22, 3) [rad/s] in the segments' own axes."""
    first, last = max(frame - 1, 0), min(frame + 1, len(segments) - 1)
    return _vector(np.swapaxes(segments[first], -1, -2) @ segments[last]) * rate_hz / (last - first)


def _vector(rotation: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) of matrices (..., 3, 3)."""
    return rotation_vector(quaternions.from_matrix(rotation))


def _exponential(vector: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of rotation vectors (..., 3)."""
    half = 0.5 * np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.concatenate([0.5 * vector * np.sinc(half / np.pi), np.cos(half)], axis=-1)


# --- getting up: the lying body passes into a recorded getup on its own skeleton, with its lowest points on the floor ---


BLEND_S, ROLL_S = 1.0, 1.8
"""Time from the pose at rest into the recording; longer where the body has to roll over."""
TEMPO = 0.75
"""Relative speed at which a recording is played, because a fallen person gets up more slowly than one who demonstrates it."""
ROLLING_RAD = np.pi / 3
"""Angle between the chests of the body and the recording from which the body has to roll over."""

PELVIS, CHEST = 0, CANONICAL_JOINTS.index("spine3")
LEG = tuple(CANONICAL_JOINTS.index(name) for name in ("left_knee", "left_ankle", "right_knee", "right_ankle"))


def got_up(
    body: Humanoid, bones: Skeleton, root_m: np.ndarray, lying: np.ndarray, getups: Sequence[Motion]
) -> tuple[np.ndarray, np.ndarray]:
    """Root (K, 3) and segments (K, 22, 3, 3) from the pose `lying` (22, 3, 3) with the pelvis at `root_m` on, by the getup whose
    first pose lies most alike (face down or up)."""
    clips = [_turned(clip, bones, root_m, lying) for clip in getups]
    root, segments = min(clips, key=lambda clip: _angle(lying[CHEST], clip[1][0, CHEST]))
    blend_s = ROLL_S if _angle(lying[CHEST], segments[0, CHEST]) > ROLLING_RAD else BLEND_S
    # The recording begins slowly: it waits in its first pose while the body passes into it.
    wait = round(0.6 * blend_s * RATE_HZ)
    root = np.concatenate([np.repeat(root[:1], wait, axis=0), root])
    segments = np.concatenate([np.repeat(segments[:1], wait, axis=0), segments])
    weight = minimum_jerk(np.arange(len(root)) / (blend_s * RATE_HZ))
    segments = _blended(lying, segments, weight)
    root = root_m + weight[:, None] * (root - root_m)
    return _on_the_floor(body, root, segments), segments


def _turned(clip: Motion, bones: Skeleton, root_m: np.ndarray, lying: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root (K, 3) [m] and segments of a getup on the person's scale, which begins where the body lies, with its trunk along it."""
    clip = resample(checked_motion(clip), RATE_HZ / TEMPO)
    segments = anatomy(clip).segments(clip.rotations)
    leg_m = sum(float(np.linalg.norm(bones.offsets[joint])) for joint in LEG)
    clip_leg_m = sum(
        float(np.linalg.norm(clip.joints[0, joint] - clip.joints[0, CANONICAL_PARENTS[joint]])) for joint in LEG
    )
    body_axis, clip_axis = (complex(*trunk[:2, 1]) for trunk in (lying[CHEST], segments[0, CHEST]))
    turn = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), np.array(np.angle(body_axis * np.conj(clip_axis))))
    root = quaternions.rotate(turn, (clip.joints[:, 0] - clip.joints[0, 0]) * (leg_m / clip_leg_m))
    height = clip.joints[0, 0, 2] * (leg_m / clip_leg_m)
    return root + [*root_m[:2], height], matrices(turn) @ segments


def _angle(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(first.T @ second) - 1) / 2, -1, 1)))


def _blended(lying: np.ndarray, segments: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Segments (K, 22, 3, 3) from one pose (22, 3, 3) into a course, blended in the pelvis and each joint's local rotation."""
    start, course = _local(lying), quaternions.continuous(_local(segments))
    mixed = matrices(_slerp(np.broadcast_to(start, course.shape), course, weight[:, None, None]))
    for joint, parent in enumerate(CANONICAL_PARENTS):
        if parent >= 0:
            mixed[:, joint] = mixed[:, parent] @ mixed[:, joint]
    return mixed


def _local(pose: np.ndarray) -> np.ndarray:
    """Rotations (..., 22, 4) in the parents' segments of segments (..., 22, 3, 3)."""
    relative = pose.copy()
    above = pose[..., list(CANONICAL_PARENTS[1:]), :, :]
    relative[..., 1:, :, :] = np.swapaxes(above, -1, -2) @ pose[..., 1:, :, :]
    return quaternions.from_matrix(relative)


def _slerp(first: np.ndarray, second: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Rotations at a constant rate along the arc that is shorter at the start, which is kept throughout."""
    cosine = np.sum(first * second, axis=-1, keepdims=True)
    sign = np.where(cosine[:1] < 0, -1.0, 1.0)
    angle = np.arccos(np.clip(cosine * sign, -1.0, 1.0))
    sine = np.maximum(np.sin(angle), 1e-9)
    near = angle < 1e-6
    low = np.where(near, 1.0 - weight, np.sin((1.0 - weight) * angle) / sine)
    high = np.where(near, weight, np.sin(weight * angle) / sine)
    return quaternions.normalise(low * first + high * sign * second)


def _on_the_floor(body: Humanoid, root: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """The root (K, 3) raised or lowered so that the body's lowest point touches the floor as it did at the start."""
    lowest = lowest_points(body, coordinates(body, root, segments))
    drop = low_pass((lowest - lowest[0])[:, None], 8.0, RATE_HZ)[:, 0]
    drop -= drop[0]
    return root - drop[:, None] * np.array([0.0, 0.0, 1.0])


def lowest_points(body: Humanoid, qpos: np.ndarray) -> np.ndarray:
    """Heights (T,) [m] of the lowest point of all capsules, spheres and ellipsoids in each pose (T, nq)."""
    model, data = body.model, mujoco().MjData(body.model)
    parts = np.flatnonzero(np.arange(model.ngeom) != body.floor)
    size, kind = model.geom_size[parts], model.geom_type[parts]
    shapes = mujoco().mjtGeom
    heights_m = np.empty(len(qpos))
    for frame, pose in enumerate(qpos):
        data.qpos[:] = pose
        mujoco().mj_kinematics(model, data)
        up = data.geom_xmat[parts].reshape(-1, 3, 3)[:, 2]
        reach = size[:, 0] + np.where(kind == shapes.mjGEOM_CAPSULE, np.abs(up[:, 2]) * size[:, 1], 0.0)
        reach = np.where(kind == shapes.mjGEOM_ELLIPSOID, np.linalg.norm(up * size, axis=1), reach)
        heights_m[frame] = (data.geom_xpos[parts, 2] - reach).min()
    return heights_m
