"""Fits a template to a person: bone lengths from the motion; girth, head and hands in proportion to stature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from t2d_rt.body.outfit import put_on
from t2d_rt.body.rotations import matrices
from t2d_rt.body.template import Template
from t2d_rt.body.template import template as body_template
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import median_length, unit
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

SIDES = ("left", "right")
LIMBS = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
TORSO, NECK = ("hips", "shoulders"), ("shoulders", "head")
"""Bones whose length is taken from the motion; `hips` and `shoulders` are the midpoints of the pairs."""

ANKLE_HEIGHT_RANGE = (0.75, 1.6)
"""Least and greatest ankle height, relative to that for the stature, to which a foot is fitted; beyond these limits the feet do not
stand on the file's floor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A template with a person's proportions, in its rest pose."""

    template: Template
    vertices: np.ndarray
    """Rest vertices [m], (V, 3)."""
    joints: Mapping[str, np.ndarray]
    """Rest positions [m] of all joints and ends, (3,) each."""
    scale: float
    """Stature of the person relative to the template's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stance:
    """When a foot rests on the ground."""

    frames: np.ndarray
    """Indices of the frames."""
    ankle_height_m: float


UPRIGHT_SHANK = CARRIED_HIP = 0.6
"""Least heights of the knee, and of the hip, above the ankle, relative to the shank's length, for a leg that may stand or whose
sole rests on the floor before a seat. The feet of a person who lies do neither, although they may rest on their heels below a bent
knee."""


def shoulder_centre(motion: Motion) -> np.ndarray:
    """Midpoint of the shoulders as a point fixed to the chest: its mean position (3,) m in the frame of spine3."""
    chest = motion.index("spine3")
    rotation = matrices(motion.rotations[:, chest])
    middle = (motion.joints[:, motion.index("left_shoulder")] + motion.joints[:, motion.index("right_shoulder")]) / 2
    return np.median(np.einsum("tji,tj->ti", rotation, middle - motion.joints[:, chest]), axis=0)


def stance(motion: Motion, side: str) -> Stance | None:
    """The frames in which a foot stands: the slowest 15 %, and all in which it hardly moves, of those with the sole about level
    near the ground, the shank upright and the hip above it. None where there are fewer than three of those."""
    hip, knee, ankle, foot = (
        motion.joints[:, motion.index(f"{side}_{joint}")] for joint in ("hip", "knee", "ankle", "foot")
    )
    speed = sum(np.linalg.norm(np.gradient(p, 1 / motion.rate_hz, axis=0), axis=1) for p in (ankle, foot))
    direction = unit(foot - ankle)
    shank = median_length(ankle - knee)
    level = (
        (np.abs(direction[:, 2]) < 0.75)
        & (ankle[:, 2] < 0.5 * shank)
        & (ankle[:, 2] < np.quantile(ankle[:, 2], 0.5) + 0.03)
        & (knee[:, 2] - ankle[:, 2] > UPRIGHT_SHANK * shank)
        & (hip[:, 2] - ankle[:, 2] > CARRIED_HIP * shank)
    )
    if np.count_nonzero(level) < 3:
        return None
    slow = level & (speed <= max(np.quantile(speed[level], 0.15), 0.05))
    return Stance(frames=np.flatnonzero(slow), ankle_height_m=float(np.median(ankle[slow, 2])))


def fit(template: Template, motion: Motion) -> Fitted:
    """The template with the median bone lengths of a motion; clothes and shoes are added afterwards, with their own thickness."""
    bare = template if template.outfit is None else body_template(template.name)
    rest = dict(bare.joints) | {m: _middle(bare.joints, m) for m in ("hips", "shoulders")}
    lengths = _lengths(motion)
    ratio = {bone: length / float(np.linalg.norm(rest[bone[1]] - rest[bone[0]])) for bone, length in lengths.items()}
    tall = [TORSO, *((f"{side}_{a}", f"{side}_{b}") for side in SIDES for a, b in LIMBS[:2])]
    weight = np.array([lengths[bone] / ratio[bone] for bone in tall])
    scale = float(weight @ [ratio[bone] for bone in tall] / weight.sum())
    ankle = {side: _ankle_ratio(motion, side, rest, scale) for side in SIDES}
    joints, stretches = _stretch(rest, ratio, scale, ankle)
    old, new = (np.array([points[name] for name in CANONICAL_JOINTS]) for points in (rest, joints))
    offset = bare.vertices[:, None] - old
    moved = np.einsum("vb,bij,vbj->vi", bare.weights, stretches, offset, optimize=True) + bare.weights @ new
    floor = np.array([0, 0, moved[:, 2].min()])
    fitted = {name: point - floor for name, point in joints.items() if name in bare.joints}
    vertices = moved - floor
    if template.outfit is not None:
        vertices = put_on(template.outfit, vertices, bare.faces, bare.weights, fitted)
    return Fitted(template=template, vertices=vertices, joints=fitted, scale=scale)


def _middle(points: Mapping[str, np.ndarray], pair: str) -> np.ndarray:
    return (points[f"left_{pair[:-1]}"] + points[f"right_{pair[:-1]}"]) / 2


def _lengths(motion: Motion) -> dict[tuple[str, str], float]:
    """Median lengths [m] of the bones that the fit follows."""
    at = {name: motion.joints[:, motion.index(name)] for name in CANONICAL_JOINTS}
    rotation = matrices(motion.rotations[:, motion.index("spine3")])
    at |= {"hips": _middle(at, "hips"), "shoulders": at["spine3"] + rotation @ shoulder_centre(motion)}
    bones = [TORSO, NECK, *((f"{side}_{a}", f"{side}_{b}") for side in SIDES for a, b in LIMBS)]
    bones += [
        (pair, f"{side}_{joint}") for side in SIDES for pair, joint in (("hips", "hip"), ("shoulders", "shoulder"))
    ]
    lengths = {bone: median_length(at[bone[1]] - at[bone[0]]) for bone in bones}
    zero = [f"{a} to {b}" for (a, b), length in lengths.items() if not 1e-3 < length < 10]
    if zero:
        raise InputError(
            f"the motion's bones {', '.join(zero)} are not between 1 mm and 10 m long, so no body fits it; "
            "check the file's units and how its joints are mapped"
        )
    return lengths


def _ankle_ratio(motion: Motion, side: str, rest: Mapping[str, np.ndarray], scale: float) -> float:
    """Height of the ankle above the sole, relative to the template's."""
    stand = stance(motion, side)
    ratio = stand.ankle_height_m / rest[f"{side}_ankle"][2] if stand else scale
    return float(np.clip(ratio, ANKLE_HEIGHT_RANGE[0] * scale, ANKLE_HEIGHT_RANGE[1] * scale))


def _stretch(
    rest: Mapping[str, np.ndarray], ratio: Mapping[tuple[str, str], float], scale: float, ankle: Mapping[str, float]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Fitted joints, and for each canonical bone the linear map of the surface around its joint, (22, 3, 3)."""
    torso, neck = ratio[TORSO], ratio[NECK]
    wide = {pair: np.mean([ratio[pair, f"{side}_{pair[:-1]}"] for side in SIDES]) for pair in ("hips", "shoulders")}
    trunk = np.diag([scale, scale, torso])
    stretches = dict.fromkeys(CANONICAL_JOINTS, trunk)
    stretches["pelvis"] = np.diag([scale, wide["hips"], torso])
    stretches["spine3"] = np.diag([scale, (scale + wide["shoulders"]) / 2, torso])
    stretches["head"] = scale * np.eye(3)
    new = {"hips": torso * rest["hips"]}
    for name in ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar", "shoulders"):
        new[name] = new["hips"] + trunk @ (rest[name] - rest["hips"])
    for name in ("neck", "head"):
        new[name] = new["shoulders"] + neck * (rest[name] - rest["shoulders"])
    stretches["neck"] = _along(rest["head"] - rest["neck"], neck, scale)
    new["head_top"] = new["head"] + scale * (rest["head_top"] - rest["head"])
    for side in SIDES:
        for pair, joint in (("hips", f"{side}_hip"), ("shoulders", f"{side}_shoulder")):
            new[joint] = new[pair] + ratio[pair, joint] * (rest[joint] - rest[pair])
        stretches[f"{side}_collar"] = np.diag([scale, wide["shoulders"], torso])
        for a, b in ((f"{side}_{a}", f"{side}_{b}") for a, b in LIMBS):
            new[b] = new[a] + ratio[a, b] * (rest[b] - rest[a])
            stretches[a] = _along(rest[b] - rest[a], ratio[a, b], scale)
        stretches[f"{side}_wrist"] = scale * np.eye(3)
        new[f"{side}_hand"] = new[f"{side}_wrist"] + scale * (rest[f"{side}_hand"] - rest[f"{side}_wrist"])
        # only the instep adapts to the ankle's height; the thickness of the toes goes with stature
        stretches[f"{side}_ankle"], stretches[f"{side}_foot"] = np.diag([scale, scale, ankle[side]]), scale * np.eye(3)
        sole = new[f"{side}_ankle"] - ankle[side] * rest[f"{side}_ankle"] * [0, 0, 1]
        for b in ("foot", "toe"):
            new[f"{side}_{b}"] = sole + scale * (rest[f"{side}_{b}"] - rest[f"{side}_ankle"] * [1, 1, 0])
    return new, np.array([stretches[name] for name in CANONICAL_JOINTS])


def _along(bone: np.ndarray, length: float, girth: float) -> np.ndarray:
    """Linear map that scales by `length` along a bone and by `girth` across it, (3, 3)."""
    direction = unit(bone)
    return girth * np.eye(3) + (length - girth) * np.outer(direction, direction)
