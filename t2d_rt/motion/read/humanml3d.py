"""Read HumanML3D's joints (T, 22, 3) and vectors (T, 263).

A vector holds, for one frame of 20 per second, y up, lengths in metres (Guo et al. 2022, Generating Diverse and Natural 3D Human
Motions from Text): half the root's turn about y to the next frame, its step over the floor to the next frame in the next
frame's own axes, its height, the 21 other joints about the root in its own axes, their 6D rotations, all joints' steps to the
next frame in the root's axes, and four flags of foot contact. The root's own axes have z where the person faces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion.read.joint_sets import LEAST_LIKELY, unlikeness
from t2d_rt.motion.read.samples import filled, spline
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import CANONICAL_JOINTS

RATE_HZ = 20.0
WIDTH = 263

CHAINS = ((0, 2, 5, 8, 11), (0, 1, 4, 7, 10), (0, 3, 6, 9, 12, 15), (9, 14, 17, 19, 21), (9, 13, 16, 18, 20))
"""Bones along which the 6D rotations are multiplied; each chain begins with the root's."""

_REST = "oo +x -x +y -y -y +y -y -y +y +z +z +y +x -x +z -y -y -y -y -y -y"
_DIRECTIONS = {f"{sign}{axis}": float(f"{sign}1") * np.eye(3)["xyz".index(axis)] for sign in "+-" for axis in "xyz"}

REFERENCE = np.array([_DIRECTIONS.get(word, np.zeros(3)) for word in _REST.split(" ")])
"""Direction (22, 3) of the bone that ends at each joint, at zero rotation."""


def decode(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints (T, 22, 3) of vectors (T, 263), unit directions (T, 21, 3) of the bones that end at joints 1 to 21, by the 6D
    rotations, and the joints' steps to the next frame (T, 22, 3): in the first frame's axes, y up, metres."""
    turn, step, height = vectors[:, 0], vectors[:, 1:3], vectors[:, 3]
    heading = -2.0 * np.concatenate([[0.0], np.cumsum(turn[:-1])])  # the vectors turn the world into the root's axes
    # A step is written in the axes of the frame that it leads to.
    planar = np.stack([step[:-1, 0], np.zeros(len(step) - 1), step[:-1, 1]], axis=-1)
    root = np.concatenate([np.zeros((1, 3)), np.cumsum(_about_y(heading[1:], planar), axis=0)])
    root[:, 1] = height
    about = _about_y(heading[:, None], vectors[:, 4:67].reshape(-1, 21, 3))
    joints = np.concatenate([root[:, None], about + root[:, None] * [1.0, 0.0, 1.0]], axis=1)
    directions = _directions(vectors[:, 67:193].reshape(-1, 21, 6), heading)
    return joints, directions, _about_y(heading[:, None], vectors[:, 193:259].reshape(-1, 22, 3))


def read_vectors(vectors: np.ndarray) -> Tracks:
    """Vectors (T, 263) as tracks; raises an InputError for normalised ones.

    Orientations are found from positions: the 6D rotations are the least ones from one fixed direction per bone and hold no twist.
    """
    rows, lost = filled(vectors, "the HumanML3D vectors (T, 263)")
    # Steps and turns add up, so gaps of any length are bridged first, and long ones are cut away afterwards.
    vectors = spline(rows, lost)
    joints, directions, steps = decode(vectors)
    tracks = read_joints(joints)
    if not unlikeness(tracks.points) < LEAST_LIKELY:
        raise InputError(
            "the HumanML3D vectors (T, 263) make no person: they are probably normalised; multiply them by Std.npy and add Mean.npy"
        )
    moved = np.linalg.norm(np.diff(joints, axis=0) - steps[:-1], axis=-1).mean()
    parents = {joint: chain[i] for chain in CHAINS for i, joint in enumerate(chain[1:])}
    bones = np.stack([joints[:, j] - joints[:, parents[j]] for j in range(1, 22)], axis=1)
    # Rotations count from the direction faced, smoothed in time, positions from the first frame's: one angle about y lies between.
    sine = (bones[..., 0] * directions[..., 2] - bones[..., 2] * directions[..., 0]).sum()
    between = np.arctan2(sine, (bones[..., [0, 2]] * directions[..., [0, 2]]).sum())
    cosine = (bones * _about_y(np.full(bones.shape[:2], between), directions)).sum(axis=-1)
    cosine /= np.maximum(np.linalg.norm(bones, axis=-1), 1e-9)
    clauses = (
        f"its joint steps agree with the positions within {1e3 * moved:.1f} mm",
        f"its 6D rotations within {np.degrees(np.arccos(np.clip(cosine, -1, 1)).mean()):.1f} degrees",
    )
    return replace(tracks, form="HumanML3D vectors", clauses=clauses).without(lost)


def read_joints(joints: np.ndarray) -> Tracks:
    """Joints (T, 22, 3) as tracks."""
    points = {name: joints[:, place] for place, name in enumerate(CANONICAL_JOINTS)}
    return Tracks(form="HumanML3D joints", points=points, rate_hz=RATE_HZ, unit_m=1.0, up="y", up_certain=False)


def _about_y(angle_rad: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned about y by angles (...)."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([cosine * x + sine * z, y + 0 * cosine, cosine * z - sine * x], axis=-1)


def _directions(six: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Unit directions of bones (T, 21, 3) from 6D rotations (T, 21, 6): two columns of a matrix each (Zhou et al. 2019)."""
    first = six[..., :3] / np.maximum(np.linalg.norm(six[..., :3], axis=-1, keepdims=True), 1e-12)
    third = np.cross(first, six[..., 3:])
    third /= np.maximum(np.linalg.norm(third, axis=-1, keepdims=True), 1e-12)
    local = np.stack([first, np.cross(third, first), third], axis=-1)
    directions = np.zeros((len(six), 22, 3))
    # Chains begin with the rotation of the world into the root's axes, the inverse of the heading.
    axes = np.stack([_about_y(-heading, np.tile(axis, (len(heading), 1))) for axis in np.eye(3)], axis=-1)
    for chain in CHAINS:
        turned = axes
        for joint in chain[1:]:
            turned = turned @ local[:, joint - 1]
            directions[:, joint] = turned @ REFERENCE[joint]
    return directions[:, 1:]
