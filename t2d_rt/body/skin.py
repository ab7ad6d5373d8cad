"""Linear blend skinning: a motion moves a body's control cage, from whose surface facets are refined."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from t2d_rt.body.chest import ChestWall
from t2d_rt.body.fit import Fitted, fit
from t2d_rt.body.outfit import Outfit, materials_of, outfit_of
from t2d_rt.body.pose import BONES, Posing, posing
from t2d_rt.body.template import template
from t2d_rt.geometry import curvature
from t2d_rt.geometry.vectors import median_length
from t2d_rt.types.material import Material
from t2d_rt.types.mesh import MovingMesh, Provenance
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion, checked_motion

JointTrack = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Function that gives positions (K, J, 3) [m] and orientations x, y, z, w (K, J, 4) of a motion's joints at times [s] (K,)."""

SAGITTA_RAD, SAGITTA_RADIUS_M, SAGITTA_POWER = 1.5, 0.1, 1 / 3
"""Phase sagitta [rad] of a body's facets where its radius of curvature is `SAGITTA_RADIUS_M`, and the power of the curvature with
which it varies: of 1/4, 1/3, 1/2 and 0.6 this one gives the least error for a given number of facets. 25 000 facets give a field
NMSE of -30 dB over fourteen motions, before occlusion."""

SIZE_STEP = 1.1
"""Bodies share their facets if their scales relative to the template round to the same power of this."""
SOFT_M = 0.02
"""Greatest depth of a vertex below the floor [m]: flesh and soles give way. Vertices less than half as deep are not moved."""
LOW_M, INSTANTS = 0.025, 40
"""Depth [m] of the skin's lowest point, as the median over so many instants, from which a person counts as standing on a floor of
the file's own below z = 0 (that was put under the joints)."""

FRAMES_AT_ONCE = 16
"""Number of frames in one matrix product, chosen to fit the cache."""

Csr = Any
"""A scipy.sparse matrix."""


def skin(
    motion: Motion,
    body: str = "adult",
    *,
    material: str | Material | Outfit = "skin",
    track: JointTrack | None = None,
    made: Provenance | None = None,
) -> MovingMesh:
    """The body's control cage (about 3200 vertices, 6400 faces) moving with a skeleton.

    `track` interpolates the motion in time (C2, as a radar needs); without it frames are joined by straight lines. `material` is
    that of the whole skin, or an outfit. `made` says how to make the mesh again. Where the person is on the floor at z = 0, the
    skin lies flat on it instead of within it.
    """
    checked_motion(motion)
    fitted = fit(template(body, outfit_of(material)), motion)
    surface = materials_of(material, lambda outfit: outfit.of_faces(fitted.template.faces, fitted.template.weights))
    pose = posing(fitted, motion)
    basis = blend_basis(fitted)
    track = track or linear_track(motion)
    chest = ChestWall.of(fitted, motion) if motion.chest_moves else None
    # Facets are those of the template at a similar size, as a person's bone lengths hardly change where they must be fine.
    rest = fitted.template.vertices if fitted.template.like is None else fitted.template.like
    like = rest * SIZE_STEP ** round(math.log(fitted.scale, SIZE_STEP))
    bend = 1 + curvature(like, fitted.template.faces, 180.0)  # 1/m: the curvature of the wave at indoor range

    return MovingMesh.from_track(
        partial(_vertices, basis, pose, track, chest, _on_floor(motion, basis, pose)),
        fitted.template.faces,
        motion.times_s,
        surface,
        rest=fitted.vertices,
        crease_deg=180.0,
        sagitta_rad=SAGITTA_RAD * (SAGITTA_RADIUS_M * bend) ** SAGITTA_POWER,
        name=body,
        made=made,
        curved=True,
        refined_as=like,
    )


def _vertices(
    basis: Csr, pose: Posing, track: JointTrack, chest: ChestWall | None, floor: bool, times_s: np.ndarray
) -> np.ndarray:
    bones = pose.bones(*track(times_s))
    vertices = blend(basis, *bones)
    if chest is not None:
        chest.move(vertices, *bones, times_s)
    if floor:
        _flatten(vertices[..., 2])
    return vertices


def _on_floor(motion: Motion, basis: Csr, pose: Posing) -> bool:
    """Whether the person stands, walks, sits, crouches or lies on the floor at z = 0."""
    # otherwise the person stands on a floor of the file's own, somewhere below
    if motion.joints[..., 2].min() <= -0.05:
        return False
    hip, knee, ankle = (motion.joints[:, motion.index(f"left_{joint}")] for joint in ("hip", "knee", "ankle"))
    leg_m = sum(median_length(bone) for bone in (hip - knee, knee - ankle))
    if hip[:, 2].min() < 0.55 * leg_m:
        return True
    times_s = np.linspace(0.0, motion.duration_s, INSTANTS)
    lowest = blend(basis, *pose.bones(*linear_track(motion)(times_s)))[..., 2].min(axis=1)
    return bool(np.median(lowest) > -LOW_M)


def _flatten(heights_m: np.ndarray) -> None:
    """Raises points that are deep below the floor, in place; twice continuously differentiable, as tracks for a radar must be."""
    half = 0.5 * SOFT_M
    deep = heights_m < -half
    heights_m[deep] = -half * (1 + np.tanh(-heights_m[deep] / half - 1))


def depth_m(motion: Motion, body: str = "adult", *, rate_hz: float = 10.0) -> float:
    """How deep the skin would be below the floor at z = 0 if it did not give way [m], from `rate_hz` poses a second; 0 if it is not
    below."""
    checked_motion(motion)
    fitted = fit(template(body), motion)
    times_s = np.linspace(0.0, motion.duration_s, max(2, math.ceil(motion.duration_s * rate_hz) + 1))
    bones = posing(fitted, motion).bones(*linear_track(motion)(times_s))
    return max(0.0, -float(blend(blend_basis(fitted), *bones)[..., 2].min()))


def blend_basis(body: Fitted) -> Csr:
    """Weighted rest vertices relative to each bone's joint, in homogeneous coordinates, (V, 4 * bones), so that posing is a matrix
    product.

    Sparse, since a vertex is moved by about two bones.
    """
    from scipy.sparse import csr_array

    weights = bone_weights(body)
    joints = np.array([body.joints[name] for name in CANONICAL_JOINTS])
    joints = np.vstack([joints, [body.joints[_carrier(name)] for name in BONES[len(CANONICAL_JOINTS) :]]])
    offset = body.vertices[:, None] - joints
    homogeneous = np.concatenate([offset, np.ones((*offset.shape[:2], 1))], -1) * weights[..., None]
    return csr_array(homogeneous.reshape(len(homogeneous), -1))


def bone_weights(body: Fitted) -> np.ndarray:
    """Weights of `BONES`, (V, 26): bones that take half of a twist get theirs from upper arm and forearm."""
    weights = np.hstack([body.template.weights, np.zeros((len(body.vertices), len(BONES) - len(CANONICAL_JOINTS)))])
    for bone in BONES[len(CANONICAL_JOINTS) :]:
        start, end = _carrier(bone), _carrier(bone).replace("elbow", "wrist").replace("shoulder", "elbow")
        axis = body.joints[end] - body.joints[start]
        along = (body.vertices - body.joints[start]) @ axis / (axis @ axis)
        low, high = (0.1, 0.8) if "forearm" in bone else (0.0, 0.7)
        fraction = np.clip((along - low) / (high - low), 0, 1)
        fraction = fraction if "forearm" in bone else 1 - fraction
        carrier = BONES.index(start)
        weights[:, BONES.index(bone)] = fraction * weights[:, carrier]
        weights[:, carrier] *= 1 - fraction
    return weights


def _carrier(twist_bone: str) -> str:
    """Name of the joint that carries a twist bone."""
    return twist_bone.replace("upper_arm", "shoulder").replace("forearm", "elbow")


def blend(basis: Csr, rotations: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Posed vertices (K, V, 3) m from rotations (K, B, 3, 3) and origins (K, B, 3) of the bones."""
    bones = np.concatenate([rotations, origin[..., None]], -1).transpose(1, 3, 2, 0)
    # in an order in which all frames of a vertex are contiguous
    vertices = np.empty((basis.shape[0], len(rotations), 3))
    for start in range(0, len(rotations), FRAMES_AT_ONCE):
        block = slice(start, start + FRAMES_AT_ONCE)
        product = basis @ bones[..., block].reshape(basis.shape[1], -1)
        vertices[:, block] = product.reshape(basis.shape[0], 3, -1).swapaxes(1, 2)
    return vertices.swapaxes(0, 1)


def linear_track(motion: Motion) -> JointTrack:
    """A track of straight lines between frames; orientations are interpolated linearly and normalised."""
    return partial(_between_frames, motion)


def _between_frames(motion: Motion, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    times = motion.times_s
    frame = np.clip(np.searchsorted(times, times_s, side="right") - 1, 0, len(times) - 2)
    fraction = (times_s * motion.rate_hz - frame)[:, None, None]
    q, r = motion.rotations[frame], motion.rotations[frame + 1]
    r = np.where((q * r).sum(-1, keepdims=True) < 0, -r, r)
    rotations = (1 - fraction) * q + fraction * r
    joints = (1 - fraction) * motion.joints[frame] + fraction * motion.joints[frame + 1]
    return joints, rotations / np.linalg.norm(rotations, axis=-1, keepdims=True)
