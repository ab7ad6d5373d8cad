"""Between segments of a motion and the humanoid's coordinates."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.generate.falls.anatomy import PARENTS, matrices
from t2d_rt.motion.generate.falls.humanoid import Humanoid
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS


def coordinates(body: Humanoid, root_m: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """qpos (T, nq) of the poses with the pelvis at `root_m` (T, 3) whose segments (T, 22, 3, 3) come nearest to those given.

    Inverse kinematics in closed form: the relative rotation of each joint as Euler angles about its hinges, those that it lacks
    left out.
    """
    qpos = np.zeros((len(root_m), body.model.nq))
    qpos[:, :3] = root_m
    qpos[:, 3:7] = np.roll(quaternions.continuous(quaternions.from_matrix(segments[:, 0])), 1, axis=-1)
    for name, parent in PARENTS.items():
        if parent >= 0:
            relative = np.swapaxes(segments[:, parent], -1, -2) @ segments[:, CANONICAL_JOINTS.index(name)]
            qpos[:, body.hinges[name]] = hinge_angles(body, name, relative)
    return qpos


def hinge_angles(body: Humanoid, name: str, relative: np.ndarray) -> np.ndarray:
    """Angles (T, hinges) of a joint whose segment has the orientations `relative` (T, 3, 3) in its parent's frame."""
    axes = body.axes[name]
    order = axes + "".join(axis for axis in "ZYX" if axis not in axes)
    angles = euler(body.rest[name].T @ relative, order)[:, : len(axes)]
    if len(axes) == 2:
        # Axes that a joint lacks come last in the order they were split in; of two hinges the outer ones count alike.
        angles = euler(body.rest[name].T @ relative, _middle_missing(axes))[:, [0, 2]]
    elif len(axes) == 1:
        m = body.rest[name].T @ relative
        angles = np.arctan2(m[:, 2, 1] - m[:, 1, 2], m[:, 1, 1] + m[:, 2, 2])[:, None]
    return np.unwrap(angles, axis=0)


def _middle_missing(axes: str) -> str:
    (lacking,) = set("ZYX") - set(axes)
    return axes[0] + lacking + axes[1]


def euler(matrix: np.ndarray, axes: str) -> np.ndarray:
    """Angles (T, 3) of rotations (T, 3, 3) = R_a R_b R_c about three different axes, as "ZYX"; |b| <= 90 degrees."""
    i, j, k = ("XYZ".index(axis) for axis in axes)
    sign = 1.0 if (i, j, k) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1.0
    first = np.arctan2(-sign * matrix[:, j, k], matrix[:, k, k])
    second = np.arcsin(np.clip(sign * matrix[:, i, k], -1.0, 1.0))
    third = np.arctan2(-sign * matrix[:, i, j], matrix[:, i, i])
    return np.stack([first, second, third], axis=-1)


def reached(body: Humanoid, qpos: np.ndarray) -> np.ndarray:
    """Segments (T, 22, 3, 3) of coordinates (T, nq): the model's forward kinematics."""
    found = np.empty((len(qpos), len(CANONICAL_JOINTS), 3, 3))
    found[:, 0] = matrices(np.roll(qpos[:, 3:7], -1, axis=-1))
    for number, (name, parent) in enumerate(PARENTS.items()):
        if parent < 0:
            continue
        turned = np.broadcast_to(body.rest[name], (len(qpos), 3, 3))
        for axis, hinge in zip(body.axes[name], body.hinges[name], strict=True):
            turned = turned @ matrices(quaternions.about_axis(np.eye(3)["XYZ".index(axis)], qpos[:, hinge]))
        found[:, number] = found[:, parent] @ turned
    return found


def velocities(qpos: np.ndarray, rate_hz: float) -> np.ndarray:
    """qvel (nv,) at the middle of five or more poses (2 n + 1, nq), by a parabola through them."""
    n = len(qpos) // 2
    times = np.arange(-n, n + 1) / rate_hz
    slope = np.polynomial.polynomial.polyfit(times, qpos, 2)[1]
    w, x, y, z = qpos[n, 3:7]
    rate = np.polynomial.polynomial.polyfit(times, qpos[:, 3:7], 2)[1]
    # MuJoCo has a free body's angular velocity in its own axes: 2 q* q'.
    own = 2.0 * quaternions.multiply(np.array([-x, -y, -z, w]), np.roll(rate, -1))
    return np.concatenate([slope[:3], own[:3], slope[7:]])


def skeleton(root_m: np.ndarray, segments: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Joints (T, J, 3) of a skeleton with constant `offsets` (J, 3) in the parents' segments (T, J, 3, 3)."""
    joints = np.empty((len(root_m), len(offsets), 3))
    joints[:, 0] = root_m
    for joint, parent in enumerate(CANONICAL_PARENTS):
        if parent >= 0:
            joints[:, joint] = joints[:, parent] + segments[:, parent] @ offsets[joint]
    return joints
