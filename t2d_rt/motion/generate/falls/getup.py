"""Getting up: the body that lies goes over into a recorded getup on its own skeleton, its lowest points on the floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.easing import minimum_jerk
from t2d_rt.motion.generate.falls.anatomy import anatomy, matrices
from t2d_rt.motion.generate.falls.humanoid import RATE_HZ, Humanoid, mujoco
from t2d_rt.motion.generate.falls.joining import Skeleton
from t2d_rt.motion.generate.falls.pose import coordinates
from t2d_rt.motion.interpolate import low_pass, resample
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, Motion, checked_motion

BLEND_S, ROLL_S = 1.0, 1.8
"""Time from the pose at rest into the recording; longer where the body has to roll over."""
TEMPO = 0.75
"""Speed at which a recording is played: who has fallen gets up more slowly than who shows how to."""
ROLLING_RAD = np.pi / 3
"""Difference of the chests' orientations from which it has."""

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
    # The recording begins slowly: it waits in its first pose while the body goes over into it.
    wait = round(0.6 * blend_s * RATE_HZ)
    root = np.concatenate([np.repeat(root[:1], wait, axis=0), root])
    segments = np.concatenate([np.repeat(segments[:1], wait, axis=0), segments])
    weight = minimum_jerk(np.arange(len(root)) / (blend_s * RATE_HZ))
    segments = _blended(lying, segments, weight)
    root = root_m + weight[:, None] * (root - root_m)
    return _on_the_floor(body, root, segments, root_m), segments


def _turned(clip: Motion, bones: Skeleton, root_m: np.ndarray, lying: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A getup on the person's scale, its first pose where the body lies and its trunk along the body's."""
    clip = resample(checked_motion(clip), RATE_HZ / TEMPO)
    segments = anatomy(clip).segments(clip.rotations)
    own = sum(float(np.linalg.norm(bones.offsets[joint])) for joint in LEG)
    theirs = sum(
        float(np.linalg.norm(clip.joints[0, joint] - clip.joints[0, CANONICAL_PARENTS[joint]])) for joint in LEG
    )
    wanted, found = (complex(*trunk[:2, 1]) for trunk in (lying[CHEST], segments[0, CHEST]))
    turn = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), np.array(np.angle(wanted * np.conj(found))))
    root = quaternions.rotate(turn, (clip.joints[:, 0] - clip.joints[0, 0]) * (own / theirs))
    height = clip.joints[0, 0, 2] * (own / theirs)
    return root + [*root_m[:2], height], matrices(turn) @ segments


def _angle(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(first.T @ second) - 1) / 2, -1, 1)))


def _blended(lying: np.ndarray, segments: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """From one pose (22, 3, 3) into a course (K, 22, 3, 3): the pelvis and each joint's rotation in its parent's frame."""
    above = list(CANONICAL_PARENTS[1:])

    def local(pose: np.ndarray) -> np.ndarray:
        found = pose.copy()
        found[..., 1:, :, :] = np.swapaxes(pose[..., above, :, :], -1, -2) @ pose[..., 1:, :, :]
        return quaternions.from_matrix(found)

    start, course = local(lying), quaternions.continuous(local(segments))
    mixed = matrices(_slerp(np.broadcast_to(start, course.shape), course, weight[:, None, None]))
    for joint, parent in enumerate(CANONICAL_PARENTS):
        if parent >= 0:
            mixed[:, joint] = mixed[:, parent] @ mixed[:, joint]
    return mixed


def _slerp(first: np.ndarray, second: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Rotations at a constant rate along the arc that is the shorter one at the start, and stays the same one."""
    cosine = np.sum(first * second, axis=-1, keepdims=True)
    sign = np.where(cosine[:1] < 0, -1.0, 1.0)
    angle = np.arccos(np.clip(cosine * sign, -1.0, 1.0))
    sine = np.maximum(np.sin(angle), 1e-9)
    near = angle < 1e-6
    low = np.where(near, 1.0 - weight, np.sin((1.0 - weight) * angle) / sine)
    high = np.where(near, weight, np.sin(weight * angle) / sine)
    return quaternions.normalise(low * first + high * sign * second)


def _on_the_floor(body: Humanoid, root: np.ndarray, segments: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The root (K, 3) raised or lowered so that the body's lowest point touches the floor as it did at the start."""
    lowest = lowest_points(body, coordinates(body, root, segments))
    drop = low_pass((lowest - lowest[0])[:, None], 8.0, RATE_HZ)[:, 0]
    drop -= drop[0]
    return root - drop[:, None] * np.array([0.0, 0.0, 1.0])


def lowest_points(body: Humanoid, qpos: np.ndarray) -> np.ndarray:
    """Height (T,) of the lowest point of all capsules, spheres and ellipsoids in each pose."""
    model, data = body.model, mujoco().MjData(body.model)
    parts = np.flatnonzero(np.arange(model.ngeom) != body.floor)
    size, kind = model.geom_size[parts], model.geom_type[parts]
    shapes = mujoco().mjtGeom
    found = np.empty(len(qpos))
    for frame, pose in enumerate(qpos):
        data.qpos[:] = pose
        mujoco().mj_kinematics(model, data)
        up = data.geom_xmat[parts].reshape(-1, 3, 3)[:, 2]
        reach = size[:, 0] + np.where(kind == shapes.mjGEOM_CAPSULE, np.abs(up[:, 2]) * size[:, 1], 0.0)
        reach = np.where(kind == shapes.mjGEOM_ELLIPSOID, np.linalg.norm(up * size, axis=1), reach)
        found[frame] = (data.geom_xpos[parts, 2] - reach).min()
    return found
