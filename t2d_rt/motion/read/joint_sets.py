"""Joints by name or by order, as cameras, pose estimators and data sets give them -> joints by canonical name.

A name is split into its side and its part ("ShoulderLeft", "LShoulder", "left_shoulder", "right_upper_arm"), and each canonical
joint takes the first part of its list that is there. What lacks is filled in `t2d_rt.motion.read.complete`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import norms
from t2d_rt.motion.skeletons import PARENT_OF
from t2d_rt.types.motion import CANONICAL_JOINTS

SIDED_PARTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "hip": ("hip", "thigh", "upleg", "upperleg"),
        "knee": ("knee", "shin", "shank", "calf", "lowerleg"),
        "ankle": ("ankle", "foot"),
        "foot": ("bigtoe", "toebase", "footindex", "toe", "foot"),
        "collar": ("collar", "clavicle"),
        "shoulder": ("shoulder", "upperarm"),
        "elbow": ("elbow", "lowerarm", "forearm"),
        "wrist": ("wrist", "hand"),
        "hand": ("hand", "handtip", "index"),
    }
)
"""Parts that a joint of a side may be called; a part serves one joint only, so that a foot is the ankle where there is no ankle."""

CENTRAL_PARTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "pelvis": ("pelvis", "midhip", "chip", "hip", "hips", "hipcenter", "spinebase", "root"),
        "spine1": ("spine1", "spinenavel"),
        "spine2": ("spine2", "spinemid", "spine", "torso"),
        "spine3": ("spine3", "spinechest", "chest"),
        "neck": ("thorax", "neck", "spineshoulder", "shouldercenter"),
        "head": ("head",),
    }
)

SIDES: Mapping[str, str] = MappingProxyType({"left": "left", "l": "left", "right": "right", "r": "right"})

NEEDED = tuple(
    f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for side in ("left", "right")
)
"""Joints that nothing can stand in for."""

WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")

_ORDERS = {
    "Kinect v2": """SpineBase SpineMid Neck Head ShoulderLeft ElbowLeft WristLeft HandLeft ShoulderRight ElbowRight WristRight
        HandRight HipLeft KneeLeft AnkleLeft FootLeft HipRight KneeRight AnkleRight FootRight SpineShoulder HandTipLeft ThumbLeft
        HandTipRight ThumbRight""",
    "Azure Kinect": """PELVIS SPINE_NAVEL SPINE_CHEST NECK CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT HANDTIP_LEFT
        THUMB_LEFT CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT HANDTIP_RIGHT THUMB_RIGHT HIP_LEFT KNEE_LEFT
        ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT FOOT_RIGHT HEAD NOSE EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT""",
    "OpenPose BODY_25": """Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist MidHip RHip RKnee RAnkle LHip LKnee LAnkle REye
        LEye REar LEar LBigToe LSmallToe LHeel RBigToe RSmallToe RHeel""",
    "HALPE 26": """Nose LEye REye LEar REar LShoulder RShoulder LElbow RElbow LWrist RWrist LHip RHip LKnee RKnee LAnkle RAnkle Head
        Neck Hip LBigToe RBigToe LSmallToe RSmallToe LHeel RHeel""",
    "COCO 17": """nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_wrist
        right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle""",
    "Human3.6M 17": """Hip RHip RKnee RFoot LHip LKnee LFoot Spine Thorax NeckNose Head LShoulder LElbow LWrist RShoulder RElbow
        RWrist""",
    "humanoid 15": """pelvis torso head right_upper_arm right_lower_arm right_hand left_upper_arm left_lower_arm left_hand
        right_thigh right_shin right_foot left_thigh left_shin left_foot""",
    "MediaPipe 33": """nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear
        mouth_left mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky right_pinky
        left_index right_index left_thumb right_thumb left_hip right_hip left_knee right_knee left_ankle right_ankle left_heel
        right_heel left_foot_index right_foot_index""",
}

ORDERS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"HumanML3D": CANONICAL_JOINTS, "SMPL": (*CANONICAL_JOINTS, "left_hand", "right_hand")}
    | {order: tuple(names.split()) for order, names in _ORDERS.items()}
)
"""Orders of joints in arrays that come without names."""

LIMBS = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))

LEGS_PER_ARMS = 1.5
"""Thigh and shank over upper arm and forearm: 0.49 and 0.33 of the stature (Drillis and Contini 1966)."""

LEAST_LIKELY = 0.25
"""Score from which on an array in some order is no person; recordings stay under 0.1 in their own order."""


def canonical_sources(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Canonical joint -> the names whose mean stands for it, for the joints that have any."""
    if set(CANONICAL_JOINTS) <= set(names):
        return {joint: (joint,) for joint in PARENT_OF if joint in names}
    parts = {side_and_part(name): name for name in reversed(names)}
    found: dict[str, tuple[str, ...]] = {}
    for side in ("left", "right"):
        taken: set[str] = set()
        for joint, known in SIDED_PARTS.items():
            part = next((part for part in known if (side, part) in parts and part not in taken), None)
            if part is not None:
                found[f"{side}_{joint}"] = (parts[side, part],)
                taken.add(part)
    for joint, known in CENTRAL_PARTS.items():
        part = next((part for part in known if ("", part) in parts), None)
        if part is not None:
            found[joint] = (parts["", part],)
    ears = tuple(parts[side, "ear"] for side in ("left", "right") if (side, "ear") in parts)
    if "head" not in found and len(ears) == 2:
        found["head"] = ears
    return found


def side_and_part(name: str) -> tuple[str, str]:
    """Side, "left", "right" or none, and part of the body that a joint's name tells, in lower case."""
    words = [word.lower() for word in WORD.findall(name)]
    for side, rest in ((words[:1], words[1:]), (words[-1:], words[:-1])):
        if rest and side[0] in SIDES:
            return SIDES[side[0]], "".join(rest)
    return "", "".join(words)


def absent_joints(names: Sequence[str]) -> list[str]:
    """Canonical joints that nothing can stand in for and that names give none for."""
    sources = canonical_sources(names)
    return [joint for joint in NEEDED if joint not in sources]


def named_points(joints: np.ndarray, names: Sequence[str]) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
    """Points (T, 3) by canonical name of joints (T, K, 3), and which names stand for which; refuses a set without limbs."""
    if len(set(names)) != len(names):
        raise InputError(
            f"the joints' names must differ, got {shown(max(names, key=list(names).count))} more than once"
        )
    sources, absent = canonical_sources(names), absent_joints(names)
    if absent:
        raise InputError(
            f"the joints' names lack {', '.join(absent)}; name hips, knees, ankles, shoulders, elbows and wrists "
            "of both sides, such as left_hip, HipLeft or LHip"
        )
    column = {name: place for place, name in enumerate(names)}
    return {
        joint: joints[:, [column[name] for name in source]].mean(axis=1) for joint, source in sources.items()
    }, sources


def guessed_order(joints: np.ndarray) -> str | None:
    """The order in which joints (T, K, 3) make the likeliest person; None where they make none."""
    count = joints.shape[1]
    fitting = [order for order, names in ORDERS.items() if len(names) == count]
    # SMPL-H and SMPL-X go on with fingers and faces after the body's 22.
    fitting += ["HumanML3D"] if count >= 45 else []
    scores = {}
    for order in fitting:
        place = {name: column for column, name in enumerate(ORDERS[order])}
        sources = canonical_sources(ORDERS[order])
        scores[order] = unlikeness({joint: joints[:, place[sources[joint][0]]] for joint in NEEDED})
    best = min(scores, key=lambda order: scores[order], default=None)
    return best if best is not None and scores[best] <= LEAST_LIKELY else None


def unlikeness(points: Mapping[str, np.ndarray]) -> float:
    """How much limbs of points (T, 3) vary in length, differ left and right, and miss the ratio of legs to arms; 0 is best."""
    lengths = np.array(
        [
            [norms(points[f"{side}_{upper}"] - points[f"{side}_{lower}"]) for upper, lower in LIMBS]
            for side in ("left", "right")
        ]
    )  # (2, 4, T)
    lengths = lengths[..., np.isfinite(lengths).all(axis=(0, 1))]  # frames in which all are seen
    if not lengths.shape[-1]:
        return math.inf
    mean = lengths.mean(axis=-1)
    whole = max(float(mean.mean()), 1e-12)
    legs, arms = max(float(mean[:, :2].sum()), 1e-12), max(float(mean[:, 2:].sum()), 1e-12)
    odd = abs(math.log(legs / arms / LEGS_PER_ARMS)) / 4
    return float(lengths.std(axis=-1).mean() / whole + np.abs(mean[0] - mean[1]).mean() / whole + odd)
