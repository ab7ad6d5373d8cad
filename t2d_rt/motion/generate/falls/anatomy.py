"""Anatomical frames of a motion's segments: x left, y up, z forward on trunk and head; -y along each limb's bone.

They are the frames of the CMU humanoid. A motion's own rotations have any zero, so a constant rotation per joint leads from one to
the other, found over the whole motion: bones lie along -y, knees and elbows flex about x, pelvis and chest follow hip and shoulder
line, the head looks on average where the chest faces, soles are level while they stand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, Motion

UP = np.array([0.0, 0.0, 1.0])
SIDES = ("left", "right")

STRAIGHT_LIMB = 0.02
"""Weight of "not twisted against its parent" beside the hinge: (sine of the bend)^2 at which both count alike."""

STANDING_MPS = 0.25
"""Speed of the ankle below which a foot stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Anatomy:
    """How the segments of one motion lie."""

    frames: np.ndarray
    """Frames of the 22 canonical joints in their rotations' own axes, (22, 3, 3): segment = rotation @ frame."""
    ankle_height_m: tuple[float, float]
    """Height of the left and right ankle over the sole."""

    def segments(self, rotations: np.ndarray) -> np.ndarray:
        """Orientations (T, 22, 3, 3) of the segments, from a motion's rotations (T, J, 4)."""
        return matrices(rotations[:, : len(CANONICAL_JOINTS)]) @ self.frames

    def rotations(self, segments: np.ndarray) -> np.ndarray:
        """The rotations (T, 22, 4) of segments (T, 22, 3, 3): inverse of `segments`."""
        return quaternions.from_matrix(segments @ np.swapaxes(self.frames, -1, -2))


def matrices(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    columns = [quaternions.rotate(quaternion, np.broadcast_to(axis, quaternion[..., :3].shape)) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors over their lengths."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def frame(*, x: np.ndarray | None = None, y: np.ndarray, near_x: np.ndarray | None = None) -> np.ndarray:
    """Right-handed frames (..., 3, 3) with columns x, y, z: `x` exact and y near it, or y exact and x near `near_x`."""
    if x is not None:
        first = unit(x)
        second = unit(y - np.sum(y * first, axis=-1, keepdims=True) * first)
    else:
        assert near_x is not None, "one of x and near_x is given"
        second = unit(y)
        first = unit(near_x - np.sum(near_x * second, axis=-1, keepdims=True) * second)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def mean_rotation(rotations: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) nearest to the weighted means of rotations (T, ..., 3, 3)."""
    left, _, right = np.linalg.svd(np.tensordot(weights, rotations, axes=1))
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return np.asarray(left @ right)


def swing(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Smallest rotations (..., 3, 3) that turn one direction into another."""
    return matrices(quaternions.between(*np.broadcast_arrays(start, end)))


def anatomy(motion: Motion) -> Anatomy:
    """The frames of a motion's segments."""
    at = {name: motion.joints[:, i] for i, name in enumerate(motion.names)}
    own = dict(zip(CANONICAL_JOINTS, np.moveaxis(matrices(motion.rotations[:, :22]), 1, 0), strict=True))
    found = _trunk(at, own)
    heights = []
    for side in SIDES:
        _limbs(side, at, own, found)
        heights.append(_foot(side, motion, at, own, found))
    return Anatomy(frames=np.stack([found[name] for name in CANONICAL_JOINTS]), ankle_height_m=(heights[0], heights[1]))


def _local(rotation: np.ndarray, vectors: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Mean (3,) of vectors (T, 3) in a joint's own axes."""
    each = np.einsum("tji,tj->ti", rotation, vectors)
    return np.asarray(each.mean(0) if weights is None else weights @ each)


def _trunk(at: dict[str, np.ndarray], own: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    middle = {joint: (at[f"left_{joint}"] + at[f"right_{joint}"]) / 2 for joint in ("hip", "shoulder")}
    torso = unit(middle["shoulder"] - middle["hip"])
    # Upright instants tell what an unbent back is.
    upright = np.clip(torso[:, 2], 0.02, 1) ** 4
    upright /= upright.sum()
    found = {}
    for joint, pair in (("pelvis", "hip"), ("spine3", "shoulder")):
        across = unit(at[f"left_{pair}"] - at[f"right_{pair}"])
        found[joint] = frame(x=_local(own[joint], across, upright), y=_local(own[joint], torso, upright))
    pelvis, chest = own["pelvis"] @ found["pelvis"], own["spine3"] @ found["spine3"]
    between = mean_rotation(np.stack([pelvis, chest]), np.array([0.5, 0.5]))
    for joint in ("spine1", "spine2"):
        found[joint] = mean_rotation(np.swapaxes(own[joint], -1, -2) @ between, upright)
    ahead = np.where((upright * len(upright) > 0.1)[:, None], chest[..., 2] * [1, 1, 0], chest[..., 2])
    level = frame(x=chest[..., 0], y=np.cross(ahead, chest[..., 0]))
    for joint in ("neck", "head"):
        found[joint] = mean_rotation(np.swapaxes(own[joint], -1, -2) @ (chest if joint == "neck" else level), upright)
    for side in SIDES:
        found[f"{side}_collar"] = mean_rotation(np.swapaxes(own[f"{side}_collar"], -1, -2) @ chest, upright)
    return found


def _limbs(side: str, at: dict[str, np.ndarray], own: dict[str, np.ndarray], found: dict[str, np.ndarray]) -> None:
    # Where the hinge cannot be seen in a straight limb, x is that of the trunk turned along with the limb from its rest direction.
    rest = {"pelvis": np.array([0.0, -1.0, 0.0]), "spine3": np.array([1.0 if side == "left" else -1.0, 0.0, 0.0])}
    for trunk, names in (("pelvis", ("hip", "knee", "ankle")), ("spine3", ("shoulder", "elbow", "wrist"))):
        a, b, c = (f"{side}_{name}" for name in names)
        bend = np.cross(unit(at[b] - at[a]), unit(at[c] - at[b]))
        bend *= np.linalg.norm(bend, axis=1, keepdims=True)
        parent = own[trunk] @ found[trunk]
        hinge, bone = np.array([1.0, 0.0, 0.0]), rest[trunk]
        if trunk == "spine3":  # the palm faces down where the arm is held out: its elbow flexes forward and up
            hinge = np.array([0.0, -0.866, 0.5]) if side == "left" else np.array([0.0, 0.866, -0.5])
        for name, along in ((a, at[b] - at[a]), (b, at[c] - at[b])):
            untwisted = np.einsum("tij,j->ti", swing(parent @ bone, along) @ parent, hinge)
            found[name] = frame(
                y=_local(own[name], -unit(along)), near_x=_local(own[name], bend + STRAIGHT_LIMB * untwisted)
            )
            parent = own[name] @ found[name]
            hinge, bone = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
        if trunk == "spine3":
            found[c] = _hand(side, at, own[c], parent)


def _hand(side: str, at: dict[str, np.ndarray], own: np.ndarray, forearm: np.ndarray) -> np.ndarray:
    """On average not twisted against the forearm; along its bone where the motion has it."""
    straight = mean_rotation(np.swapaxes(own, -1, -2) @ forearm, np.ones(len(forearm)))
    if f"{side}_hand" not in at:
        return straight
    along = _local(own, unit(at[f"{side}_hand"] - at[f"{side}_wrist"]))
    return np.asarray(swing(-straight[:, 1], along) @ straight)


def standing(motion: Motion, side: str) -> np.ndarray:
    """Whether a foot stands (T,): its ankle is slow and about as low as it gets."""
    ankle, foot = (motion.joints[:, motion.index(f"{side}_{joint}")] for joint in ("ankle", "foot"))
    speed = np.linalg.norm(np.gradient(ankle, 1 / motion.rate_hz, axis=0), axis=1)
    # The ankle of a foot that stands rises over its ball before the toes leave.
    low = np.minimum(ankle[:, 2] - np.quantile(ankle[:, 2], 0.05), foot[:, 2] - np.quantile(foot[:, 2], 0.05))
    return np.asarray((speed < max(STANDING_MPS, float(np.quantile(speed, 0.1)))) & (low < 0.04))


def _foot(
    side: str, motion: Motion, at: dict[str, np.ndarray], own: dict[str, np.ndarray], found: dict[str, np.ndarray]
) -> float:
    """Level soles; returns the ankle's height over the sole."""
    ankle, foot = f"{side}_ankle", f"{side}_foot"
    bone = at[foot] - at[ankle]
    stands = standing(motion, side) & (np.abs(unit(bone)[:, 2]) < 0.75)
    if stands.sum() < 3:
        stands = np.ones(len(bone), dtype=bool)
        shank = own[f"{side}_knee"] @ found[f"{side}_knee"]
        level = frame(y=-bone, near_x=shank[..., 0])
        height = 0.044 * float(np.median(np.linalg.norm(at[ankle] - at[f"{side}_knee"], axis=1))) / 0.246
    else:
        level = frame(y=-bone * [1, 1, 0], near_x=np.cross(UP, -bone) * -1.0)
        height = float(np.median(at[ankle][stands, 2]))
    weights = np.full(int(stands.sum()), 1 / stands.sum())
    for joint in (ankle, foot):
        found[joint] = mean_rotation(np.swapaxes(own[joint][stands], -1, -2) @ level[stands], weights)
    return float(np.clip(height, 0.035, 0.13))


PARENTS = dict(zip(CANONICAL_JOINTS, CANONICAL_PARENTS, strict=True))
