"""Naming conventions of well-known skeletons, as data.

Rows of `sided` name both sides at once: `*_hip: "{Side}UpLeg"` stands for left_hip: LeftUpLeg and right_hip: RightUpLeg.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Source = str | tuple[str, str, float]
"""A joint of the file, or (a, b, fraction): the point that far from a to b, which turns with a."""


def sided(table: Mapping[str, Source]) -> dict[str, Source]:
    """Rows with a star expanded to left and right; in their sources {Side} is Left or Right, {side} left or right, {S} L or R and
    {s} l or r."""
    both: dict[str, Source] = {}
    for name, source in table.items():
        if not name.startswith("*"):
            both[name] = source
            continue
        for side in ("Left", "Right"):
            key = name.replace("*", side.lower())
            if isinstance(source, str):
                both[key] = _of_side(source, side)
            else:
                both[key] = _of_side(source[0], side), _of_side(source[1], side), source[2]
    return both


def _of_side(name: str, side: str) -> str:
    for mark, word in (("{Side}", side), ("{side}", side.lower()), ("{S}", side[0]), ("{s}", side[0].lower())):
        name = name.replace(mark, word)
    return name


_HUMANOID: dict[str, Source] = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head",
    "*_hip": "{Side}UpLeg", "*_knee": "{Side}Leg", "*_ankle": "{Side}Foot", "*_collar": "{Side}Shoulder",
    "*_shoulder": "{Side}Arm", "*_elbow": "{Side}ForeArm", "*_wrist": "{Side}Hand",
}  # fmt: skip

_BVH_TOOLBOX: dict[str, Source] = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": ("Spine", "Spine1", 0.5), "spine3": "Spine1", "neck": "Neck",
    "head": "Head", "head_top": "Head:end", "*_hip": "{Side}UpLeg", "*_knee": "{Side}Leg", "*_ankle": "{Side}Foot",
    "*_foot": "{Side}Foot:end", "*_collar": "{Side}Shoulder", "*_shoulder": "{Side}Arm", "*_elbow": "{Side}ForeArm",
    "*_wrist": "{Side}Hand", "*_hand": "{Side}Hand:end",
}  # fmt: skip

_MOMASK: dict[str, Source] = {"*_foot": "{Side}Toe", "*_toe": "{Side}Toe:end", "*_hand": "{Side}Hand:end"}

_MIXAMO: dict[str, Source] = {
    "head_top": "HeadTop_End", "*_foot": "{Side}ToeBase", "*_toe": "{Side}Toe_End", "*_hand": "{Side}HandMiddle4",
}  # fmt: skip

_ICLONE: dict[str, Source] = {
    "pelvis": "CC_Base_Pelvis", "spine1": "CC_Base_Waist", "spine2": "CC_Base_Spine01", "spine3": "CC_Base_Spine02",
    "neck": "CC_Base_NeckTwist01", "head": "CC_Base_Head", "*_hip": "CC_Base_{S}_Thigh", "*_knee": "CC_Base_{S}_Calf",
    "*_ankle": "CC_Base_{S}_Foot", "*_foot": "CC_Base_{S}_ToeBase", "*_collar": "CC_Base_{S}_Clavicle",
    "*_shoulder": "CC_Base_{S}_Upperarm", "*_elbow": "CC_Base_{S}_Forearm", "*_wrist": "CC_Base_{S}_Hand",
    "*_hand": "CC_Base_{S}_Mid3",
}  # fmt: skip

# The CMU files come from a conversion that lost the bone of every joint with several children: collars and neck start
# at the foot of the thorax, and the forearm ends at its twist joint (lwrist), two thirds down. In the ASF skeletons the
# thorax is as long as upperback and lwrist half as long as lradius (dm_control's humanoid_CMU: 0.114; 0.08 and 0.17 m).
_CMU_A: dict[str, Source] = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": ("Spine1", "Neck", 1.0), "neck": "Neck1",
    "head": "Head", "head_top": "Head:end", "*_hip": "{Side}UpLeg", "*_knee": "{Side}Leg", "*_ankle": "{Side}Foot",
    "*_foot": "{Side}ToeBase", "*_toe": "{Side}ToeBase:end", "*_collar": ("{Side}Shoulder", "{Side}Arm", 0.2),
    "*_shoulder": "{Side}Arm", "*_elbow": "{Side}ForeArm", "*_wrist": "{Side}FingerBase",
    "*_hand": "{Side}HandIndex1:end",
}  # fmt: skip

_CMU_B: dict[str, Source] = {
    "pelvis": "Hips", "spine1": "Chest", "spine2": "Chest2", "spine3": ("Chest2", "lowerneck", 1.0), "neck": "Neck",
    "head": "Head", "head_top": "Head:end", "*_hip": "{Side}Hip", "*_knee": "{Side}Knee", "*_ankle": "{Side}Ankle",
    "*_foot": "{Side}Toe", "*_toe": "{Side}Toe:end", "*_collar": ("{Side}Collar", "{Side}Shoulder", 0.2),
    "*_shoulder": "{Side}Shoulder", "*_elbow": "{Side}Elbow", "*_wrist": "{s}hand", "*_hand": "{S}Fingers:end",
}  # fmt: skip

CONVENTIONS: tuple[dict[str, Any], ...] = (
    {"name": "bvh-toolbox", "joints": sided(_BVH_TOOLBOX)},
    {"name": "momask", "joints": sided(_HUMANOID | _MOMASK)},
    {"name": "mixamo", "joints": sided(_HUMANOID | _MIXAMO)},
    {"name": "iclone", "joints": sided(_ICLONE)},
    {
        "name": "cmu-a", "joints": sided(_CMU_A), "cmu_units": True,
        "lost_bones": {
            "Neck": ("Neck", "Spine1", 1.0),
            "LeftShoulder": ("LeftShoulder", "Spine1", 1.0), "RightShoulder": ("RightShoulder", "Spine1", 1.0),
            "LeftFingerBase": ("LeftHand", "LeftHand", 1.5), "RightFingerBase": ("RightHand", "RightHand", 1.5),
        },
    },
    {
        "name": "cmu-b", "joints": sided(_CMU_B), "cmu_units": True,
        "lost_bones": {
            "lowerneck": ("lowerneck", "Chest2", 1.0),
            "LeftCollar": ("LeftCollar", "Chest2", 1.0), "RightCollar": ("RightCollar", "Chest2", 1.0),
            "lhand": ("LeftWrist", "LeftWrist", 1.5), "rhand": ("RightWrist", "RightWrist", 1.5),
        },
    },
)  # fmt: skip
"""Arguments of `register_flavour`; those that come later are preferred when several fit equally well."""
