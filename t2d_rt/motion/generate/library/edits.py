"""Changes of a piece: its time, its mirror image, its path, its stride. Feet are planted afterwards, by the piece's contacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import SIDES, steadying
from t2d_rt.motion.generate.chain import Piece, Z, heading_rad, moved
from t2d_rt.motion.kinematics import INDEX, NAMES, Poses, Skeleton, at_frames

OTHER = {"left": "right", "right": "left"}

SWAPPED = [
    NAMES.index(f"{OTHER[name.split('_')[0]]}_{name.split('_')[1]}" if name.split("_")[0] in OTHER else name)
    for name in NAMES
]
"""Of each joint, that of the other side."""


MOST_TWIST_RAD = 0.5
"""Angle by which a standing foot stays behind a turning body; hips turn by about 0.7."""


def mirrored(piece: Piece) -> Piece:
    """The piece seen in a mirror along its x axis: left and right change places."""
    poses = piece.poses
    # Both sides' frames are mirror images in the rest pose: a rotation about x or z turns round, one about y stays.
    local = poses.local[:, SWAPPED] * [-1.0, 1.0, -1.0, 1.0]
    offsets = poses.skeleton.offsets[SWAPPED] * [1.0, -1.0, 1.0]
    image = replace(poses, skeleton=Skeleton(offsets=offsets), root=poses.root * [1.0, -1.0, 1.0], local=local)
    return replace(piece, poses=image, planted=piece.planted[:, ::-1]).noted("mirrored")


def retimed(piece: Piece, frames: np.ndarray) -> Piece:
    """The piece as it is at `frames` (K,), which may lie between its own: C2 in time."""
    planted = piece.planted[np.clip(np.round(frames).astype(int), 0, len(piece) - 1)]
    return replace(piece, poses=at_frames(piece.poses, frames), planted=planted)


def tempo(piece: Piece, factor: float) -> Piece:
    """Faster by a factor."""
    if abs(factor - 1) < 1e-6:
        return piece
    count = max(2, round((len(piece) - 1) / factor) + 1)
    return retimed(piece, np.linspace(0, len(piece) - 1, count)).noted(f"{factor:.2f} times as fast")


def backwards(piece: Piece) -> Piece:
    """The piece reversed in time: a walk becomes one backward.

    Angles of hips, knees and ankles of walking backward are those of walking forward in reverse within their spread (Winter, Pluck,
    Yang 1989; Thorstensson 1986); what differs is that the toes reach the floor first and that steps are shorter.
    """
    poses = piece.poses
    turned = replace(poses, root=poses.root[::-1].copy(), local=poses.local[::-1].copy())
    return replace(piece, poses=turned, planted=piece.planted[::-1].copy()).noted("reversed in time")


def strided(piece: Piece, factor: float | np.ndarray) -> Piece:
    """Steps longer by a factor, or by one for each frame (T,): the pelvis's velocity changes by it, feet follow in planting."""
    poses = piece.poses
    factors = np.broadcast_to(np.asarray(factor, dtype=float), (len(poses),))
    steps = np.diff(poses.root[:, :2], axis=0) * (0.5 * (factors[1:] + factors[:-1]))[:, None]
    root = poses.root.copy()
    root[1:, :2] = root[0, :2] + np.cumsum(steps, axis=0)
    return replace(piece, poses=replace(poses, root=root))


def bent(piece: Piece, angle_rad: np.ndarray) -> Piece:
    """The path bent: at each frame the body and its velocity are turned by an angle (T,) about the vertical, left positive.

    A foot that stands keeps its direction: the leg turns over it.
    """
    poses = piece.poses
    spins = quaternions.about_axis(Z, angle_rad)
    middle = quaternions.about_axis(Z, 0.5 * (angle_rad[1:] + angle_rad[:-1]))
    steps = quaternions.rotate(middle, np.diff(poses.root, axis=0))
    root = poses.root.copy()
    root[1:, :2] = root[0, :2] + np.cumsum(steps[:, :2], axis=0)
    local = poses.local.copy()
    local[:, 0] = quaternions.multiply(spins, local[:, 0])
    rotations = replace(poses, local=local).world()[1]
    for number, side in enumerate(SIDES):
        back = steadying(angle_rad[:, None], np.asarray(piece.planted[:, number].any(axis=1)), poses.rate_hz)[:, 0]
        ankle, knee = INDEX[f"{side}_ankle"], INDEX[f"{side}_knee"]
        turned = quaternions.multiply(
            quaternions.about_axis(Z, np.clip(back, -MOST_TWIST_RAD, MOST_TWIST_RAD)), rotations[:, ankle]
        )
        local[:, ankle] = quaternions.multiply(quaternions.conjugate(rotations[:, knee]), turned)
    return replace(piece, poses=replace(poses, root=root, local=local))


def shifted(piece: Piece, offset_m: np.ndarray) -> Piece:
    """The root moved by an offset (T, 3) [m]."""
    return replace(piece, poses=replace(piece.poses, root=piece.poses.root + offset_m))


def aligned(piece: Piece) -> Piece:
    """Begins at the origin; the straight line from start to end, or the heading where it hardly travels, lies along +x."""
    poses = piece.poses
    net = poses.root[-1, :2] - poses.root[0, :2]
    heading = float(np.angle(np.exp(1j * heading_rad(poses)).mean()))
    angle = float(np.arctan2(net[1], net[0])) if np.linalg.norm(net) > 0.8 else heading
    return moved(piece, -angle, poses.root[0, :2], np.zeros(2))


def rate_of(poses: Poses) -> float:
    """Mean horizontal speed of the pelvis along the line from start to end [m/s]."""
    net = np.linalg.norm(poses.root[-1, :2] - poses.root[0, :2])
    return float(net * poses.rate_hz / max(len(poses) - 1, 1))
