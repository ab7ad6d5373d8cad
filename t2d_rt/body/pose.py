"""Position and orientation of each bone of a fitted body, from the joints and orientations of a motion.

A file's zero pose says nothing about the body (iClone's has the legs up). So each bone gets a constant rotation from the template's
rest axes to its joint's own axes, which is found once from the whole motion: bones lie along the motion's bones; knees and elbows
bend about their hinges; pelvis and chest follow hip line, shoulder line and the torso's mean direction; feet are level while they
stand; the head looks on average where the chest faces; a hand is on average not twisted against its forearm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.body.fit import LIMBS, SIDES, Fitted, shoulder_centre, stance
from t2d_rt.body.rotations import between, frame, matrices, mean_rotation, quaternion, swing
from t2d_rt.geometry.vectors import unit
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

UP = np.array([0.0, 0.0, 1.0])
LEFT = np.array([0.0, 1.0, 0.0])
FORWARD = np.array([1.0, 0.0, 0.0])

BONES = CANONICAL_JOINTS + ("left_upper_arm", "right_upper_arm", "left_forearm", "right_forearm")
"""The 22 canonical bones, followed by bones that take half of a limb's twist, so that the skin does not wring."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Posing:
    """How the bones of a fitted body follow the joints of one motion."""

    body: Fitted
    names: tuple[str, ...]
    """The motion's joint names."""
    offsets: dict[str, np.ndarray]
    """Constant rotation (3, 3) of each bone: bone = joint's orientation @ offset."""
    shoulder_centre: np.ndarray
    """Midpoint of the shoulders in the frame of spine3 [m], (3,)."""

    def bones(self, joints: np.ndarray, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (K, 26, 3, 3) of `BONES` from the rest pose, and positions (K, 26, 3) m of their joints, from joints and
        orientations of the motion."""
        at = {name: joints[:, i] for i, name in enumerate(self.names)}
        source = matrices(rotations)
        bones = source[:, [self.names.index(name) for name in self.offsets]] @ np.stack(list(self.offsets.values()))
        rotation = {name: bones[:, i] for i, name in enumerate(self.offsets)}
        origin = {name: at[name] for name in CANONICAL_JOINTS}
        self._trunk(at, source[:, self.names.index("spine3")], rotation, origin)
        for side in SIDES:
            self._limbs(side, at, rotation, origin)
        return np.stack([rotation[b] for b in BONES], 1), np.stack([origin[b] for b in BONES], 1)

    def _trunk(
        self,
        at: dict[str, np.ndarray],
        chest: np.ndarray,
        rotation: dict[str, np.ndarray],
        origin: dict[str, np.ndarray],
    ) -> None:
        """Adds the spine between pelvis and chest, with the template's own joints, since files place theirs at different
        heights."""
        rest = self.body.joints
        hips, shoulders = (at["left_hip"] + at["right_hip"]) / 2, at["spine3"] + chest @ self.shoulder_centre
        rest_hips, rest_shoulders = ((rest[f"left_{j}"] + rest[f"right_{j}"]) / 2 for j in ("hip", "shoulder"))
        for name in ("pelvis", "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar"):
            fraction = np.clip((rest[name] - rest_hips)[2] / (rest_shoulders - rest_hips)[2], 0, 1)
            fraction = fraction * fraction * (3 - 2 * fraction)
            below = hips + rotation["pelvis"] @ (rest[name] - rest_hips)
            above = shoulders + rotation["spine3"] @ (rest[name] - rest_shoulders)
            origin[name] = (1 - fraction) * below + fraction * above
        rotation["spine1"] = between(rotation["pelvis"], rotation["spine3"], 1 / 3)
        rotation["spine2"] = between(rotation["pelvis"], rotation["spine3"], 2 / 3)
        rotation["neck"] = between(rotation["spine3"], rotation["head"], 0.5)

    def _limbs(
        self, side: str, at: dict[str, np.ndarray], rotation: dict[str, np.ndarray], origin: dict[str, np.ndarray]
    ) -> None:
        rest = self.body.joints
        collar, shoulder, elbow, wrist = (f"{side}_{j}" for j in ("collar", "shoulder", "elbow", "wrist"))
        carried = rotation["spine3"] @ (rest[shoulder] - rest[collar])
        rotation[collar] = swing(carried, at[shoulder] - origin[collar]) @ rotation["spine3"]
        for upper, lower in ((f"{side}_{a}", f"{side}_{b}") for a, b in LIMBS):
            # The orientation already rotates the bone; the swing corrects for bones of a file that change their direction in their
            # own frame.
            rotation[upper] = (
                swing(rotation[upper] @ (rest[lower] - rest[upper]), at[lower] - at[upper]) @ rotation[upper]
            )
        arm, forearm = unit(rest[elbow] - rest[shoulder]), unit(rest[wrist] - rest[elbow])
        rotation[f"{side}_upper_arm"] = rotation[shoulder] @ half_twist(rotation[shoulder], rotation[collar], arm)
        rotation[f"{side}_forearm"] = rotation[elbow] @ half_twist(rotation[elbow], rotation[wrist], forearm)
        origin[f"{side}_upper_arm"], origin[f"{side}_forearm"] = origin[shoulder], origin[elbow]
        # Files put the ball of the foot anywhere between sole and instep; the skin needs it where the template has it.
        ankle, foot = f"{side}_ankle", f"{side}_foot"
        origin[foot] = at[ankle] + rotation[ankle] @ (rest[foot] - rest[ankle])


def half_twist(bone: np.ndarray, other: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Rotation (K, 3, 3) about a rest axis by half the angle by which `other` is twisted relative to `bone`."""
    q = quaternion(np.swapaxes(bone, -1, -2) @ other)
    along = q[..., :3] @ axis
    # Where both bones point in opposite directions the twist is undefined: let it fade (along^2 + w^2 -> 0).
    angle = np.arctan2(along, q[..., 3]) * (along**2 + q[..., 3] ** 2)
    vector = np.sin(angle / 2)[..., None] * axis
    return matrices(np.concatenate([vector, np.cos(angle / 2)[..., None]], -1))


def posing(body: Fitted, motion: Motion) -> Posing:
    """Finds how the bones of a fitted body follow the joints of a motion."""
    at = {name: motion.joints[:, i] for i, name in enumerate(motion.names)}
    source = {name: matrices(motion.rotations[:, i]) for i, name in enumerate(motion.names)}
    centre = shoulder_centre(motion)
    offsets = _trunk_offsets(body, at, source, centre)
    for side in SIDES:
        _limb_offsets(side, body, at, source, offsets)
        _foot_offsets(side, body, motion, at, source, offsets)
    return Posing(body=body, names=motion.names, offsets=offsets, shoulder_centre=centre)


def _local(rotation: np.ndarray, vectors: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Mean of vectors (T, 3) in a bone's own frame, (3,)."""
    local = np.einsum("tji,tj->ti", rotation, vectors)
    return local.mean(0) if weights is None else weights @ local


def _trunk_offsets(
    body: Fitted, at: dict[str, np.ndarray], source: dict[str, np.ndarray], centre: np.ndarray
) -> dict[str, np.ndarray]:
    rest = body.joints
    hips = (at["left_hip"] + at["right_hip"]) / 2
    torso = unit(at["spine3"] + source["spine3"] @ centre - hips)
    # The pose of an unbent back is found from upright instants.
    upright = np.clip(torso[:, 2], 0.02, 1) ** 4
    lies = torso[:, 2].max() < 0.7  # or crawls throughout: then that pose is less certain
    if lies:  # without upright instants, those at which the torso is longest
        length = np.linalg.norm(at["spine3"] + source["spine3"] @ centre - hips, axis=1)
        # instants 2 % shorter than the longest have a third of the weight
        upright = (length / length.max()) ** 60
    upright /= upright.sum()
    rest_torso = sum(rest[f"{s}_shoulder"] - rest[f"{s}_hip"] for s in SIDES)
    offsets = {}
    for bone, pair in (("pelvis", "hip"), ("spine3", "shoulder")):
        across = unit(at[f"left_{pair}"] - at[f"right_{pair}"])
        axes = frame(_local(source[bone], across, upright), _local(source[bone], torso, upright))
        offsets[bone] = axes @ frame(LEFT, rest_torso).T
    chest = source["spine3"] @ offsets["spine3"]
    ahead = chest @ FORWARD
    gaze = frame(
        np.where(upright[:, None] * len(upright) > 0.1, ahead * [1, 1, 0], ahead), np.cross(ahead, chest @ LEFT)
    )
    facing = gaze @ frame(FORWARD, UP).T
    offsets["head"] = mean_rotation(np.swapaxes(source["head"], -1, -2) @ facing, upright)
    if lies and "head_top" in at:  # its bone is more reliable
        to_head_top = _local(source["head"], unit(at["head_top"] - at["head"]))
        offsets["head"] = swing(offsets["head"] @ (rest["head_top"] - rest["head"]), to_head_top) @ offsets["head"]
    return offsets


def _limb_offsets(
    side: str, body: Fitted, at: dict[str, np.ndarray], source: dict[str, np.ndarray], offsets: dict[str, np.ndarray]
) -> None:
    for trunk, joints in (("pelvis", ("hip", "knee", "ankle")), ("spine3", ("shoulder", "elbow", "wrist"))):
        a, b, c = (f"{side}_{joint}" for joint in joints)
        upper, lower = body.joints[b] - body.joints[a], body.joints[c] - body.joints[b]
        rest_hinge = np.cross(upper, lower)
        bend = np.cross(unit(at[b] - at[a]), unit(at[c] - at[b]))
        bend *= np.linalg.norm(bend, axis=1, keepdims=True)
        parent = source[trunk] @ offsets[trunk]
        for name, rest_bone, bone in ((a, upper, at[b] - at[a]), (b, lower, at[c] - at[b])):
            untwisted = swing(parent @ rest_bone, bone) @ parent @ unit(rest_hinge)
            # 0.02: (sine of the bend)^2 at which the hinge has the same weight as the absence of twist against the parent
            axes = frame(_local(source[name], unit(bone)), _local(source[name], bend + 0.02 * untwisted))
            offsets[name] = axes @ frame(rest_bone, rest_hinge).T
            parent = source[name] @ offsets[name]
        if trunk == "spine3":
            offsets[c] = _hand_offset(side, body, at, source, parent)


def _hand_offset(
    side: str, body: Fitted, at: dict[str, np.ndarray], source: dict[str, np.ndarray], forearm: np.ndarray
) -> np.ndarray:
    wrist, hand = f"{side}_wrist", f"{side}_hand"
    straight = mean_rotation(np.swapaxes(source[wrist], -1, -2) @ forearm, np.ones(len(forearm)))
    if hand not in at:
        return straight
    rest_bone = body.joints[hand] - body.joints[wrist]
    to_hand = _local(source[wrist], unit(at[hand] - at[wrist]))
    return swing(straight @ rest_bone, to_hand) @ straight


def _foot_offsets(
    side: str,
    body: Fitted,
    motion: Motion,
    at: dict[str, np.ndarray],
    source: dict[str, np.ndarray],
    offsets: dict[str, np.ndarray],
) -> None:
    ankle, foot = f"{side}_ankle", f"{side}_foot"
    bone, rest_bone = at[foot] - at[ankle], body.joints[foot] - body.joints[ankle]
    stand = stance(motion, side)
    if stand is not None:
        level = frame(bone * [1, 1, 0], np.broadcast_to(UP, bone.shape)) @ frame(rest_bone * [1, 1, 0], UP).T
        frames = stand.frames
    else:
        shank = source[f"{side}_knee"] @ offsets[f"{side}_knee"]
        level = frame(bone, shank @ LEFT) @ frame(rest_bone, LEFT).T
        frames = np.arange(len(bone))
    weights = np.full(len(frames), 1 / len(frames))
    offsets[ankle] = mean_rotation(np.swapaxes(source[ankle][frames], -1, -2) @ level[frames], weights)
    rotated = source[ankle][frames] @ offsets[ankle]
    offsets[foot] = mean_rotation(np.swapaxes(source[foot][frames], -1, -2) @ rotated, weights)
