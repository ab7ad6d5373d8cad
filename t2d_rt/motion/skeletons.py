"""Naming flavours: which joints of a file are the canonical ones.

A flavour is data: for each canonical joint either a source joint of the file, or `(a, b, fraction)`, a point that far
from source a to source b which turns with a. End sites are called `<parent>:end`. Canonical joints that a table leaves
out (spine2, spine3, collars) are put between their mapped neighbours on the canonical chain; the reader adds feet.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from t2d_rt.checks import instance, shown, text
from t2d_rt.errors import InputError
from t2d_rt.motion.read.bvh import RawSkeleton
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, OPTIONAL_JOINTS

Source = str | tuple[str, str, float]

FILLABLE = frozenset(
    {"spine1", "spine2", "spine3", "neck", "left_collar", "right_collar", "left_foot", "right_foot", *OPTIONAL_JOINTS}
)
"""Canonical joints that a table may leave out."""

FILL_CHAINS = (
    ("pelvis", "spine1", "spine2", "spine3", "neck", "head"),
    ("spine3", "left_collar", "left_shoulder"),
    ("spine3", "right_collar", "right_shoulder"),
)

PARENT_OF: Mapping[str, str | None] = MappingProxyType(
    {
        name: CANONICAL_JOINTS[parent] if parent >= 0 else None
        for name, parent in zip(CANONICAL_JOINTS, CANONICAL_PARENTS, strict=True)
    }
    | OPTIONAL_JOINTS
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Flavour:
    """A convention for naming joints."""

    name: str
    joints: Mapping[str, Source]
    """Canonical joint -> source."""
    lost_bones: Mapping[str, tuple[str, str, float]] = field(default_factory=dict)
    """Joint whose zero offset betrays a lost bone -> (joint to move, joint whose offset is the model, factor)."""

    def __post_init__(self) -> None:
        unknown = sorted(set(self.joints) - set(PARENT_OF))
        if unknown:
            raise InputError(
                f"flavour {self.name!r} maps unknown canonical joints {unknown}; use names of {list(PARENT_OF)}"
            )
        missing = [name for name in CANONICAL_JOINTS if name not in self.joints and name not in FILLABLE]
        if missing:
            raise InputError(
                f"flavour {self.name!r} must also map {missing}; only spine, neck, collars and feet may lack"
            )

    def required(self) -> dict[str, tuple[str, ...]]:
        """Source names that a file must have, by canonical joint (optional ends are not required)."""
        return {name: _names(source) for name, source in self.joints.items() if name not in OPTIONAL_JOINTS}


_flavours: dict[str, Flavour] = {}


def flavours() -> Mapping[str, Flavour]:
    """All known flavours by name; those registered last are preferred when several fit equally well."""
    return MappingProxyType(_flavours)


def register_flavour(
    name: str, joints: Mapping[str, Source], *, lost_bones: Mapping[str, tuple[str, str, float]] | None = None
) -> Flavour:
    """Add (or replace) a naming flavour; `load_motion` detects it from then on."""
    text("name", name)
    instance("joints", joints, Mapping, "a mapping of canonical joints to the file's names")
    if lost_bones is not None:
        instance("lost_bones", lost_bones, Mapping, "a mapping of joints to (parent, child, fraction)")
    flavour = Flavour(name=name, joints=dict(joints), lost_bones=dict(lost_bones or {}))
    _flavours.pop(name, None)
    _flavours[name] = flavour
    return flavour


def plain_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names without the namespace that they have in common (`mixamorig:Hips`, `mixamorig1_Hips`, `actor:rig:Hips` -> `Hips`)."""
    own = [name for name in names if not name.endswith(":end")]
    match = re.match(r"(.*:|mixamorig\d*_?)", own[0]) if own else None
    prefix = match.group(1) if match else ""
    if not prefix or not all(name.startswith(prefix) and len(name) > len(prefix) for name in own):
        return names
    return tuple(name.removeprefix(prefix) for name in names)


def detect_flavour(names: tuple[str, ...], parents: tuple[int, ...], wanted: str | None = None) -> Flavour:
    """The flavour whose joints are all there, hang in the canonical order, and cover most of the file's names."""
    if wanted is not None and (not isinstance(wanted, str) or wanted not in _flavours):
        raise InputError(
            f"flavour {shown(wanted)} is unknown; choose one of {', '.join(_flavours)} or register_flavour() it"
        )
    candidates = list(_flavours.values())[::-1] if wanted is None else [_flavours[wanted]]
    present = set(names)
    gaps = {c.name: _missing(c, present) for c in candidates}
    fitting = [c for c in candidates if not gaps[c.name] and _hangs_together(c, names, parents)]
    if fitting:
        return max(fitting, key=lambda c: len(present & _all_sources(c)))
    nearest = min(candidates, key=lambda c: (len(gaps[c.name]) / len(c.joints), -len(present & _all_sources(c))))
    absent = gaps[nearest.name]
    problem = (
        f"lacks {', '.join(absent[:8])}{' ...' if len(absent) > 8 else ''}" if absent else "hangs together differently"
    )
    raise InputError(
        f"the skeleton's joint names fit no known flavour: nearest is {nearest.name!r}, of which the file {problem}; "
        "describe its names with register_flavour()"
    )


def canonical(
    raw: RawSkeleton, names: tuple[str, ...], flavour: Flavour, positions: np.ndarray, rotations: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Positions (T, 3) and orientations (T, 4) by canonical name, in canonical order; absent feet are left out."""
    index = {name: i for i, name in enumerate(names)}
    points: dict[str, np.ndarray] = {}
    orientations: dict[str, np.ndarray] = {}
    for name, source in flavour.joints.items():
        first, last, fraction = (source, source, 0.0) if isinstance(source, str) else source
        absent = first not in index or last not in index or not raw.offsets[index[first]].any()
        if not (absent and name in OPTIONAL_JOINTS):
            points[name] = (1.0 - fraction) * positions[:, index[first]] + fraction * positions[:, index[last]]
            orientations[name] = rotations[:, index[first]]
    for chain in FILL_CHAINS:
        _fill_between(chain, points, orientations)
    order = [name for name in PARENT_OF if name in points]
    return {name: points[name] for name in order}, {name: orientations[name] for name in order}


def source_joints(names: tuple[str, ...], flavour: Flavour) -> list[int]:
    """Indices of the file's joints that canonical ones are made of."""
    sources = {name for source in flavour.joints.values() for name in _names(source)}
    return [index for index, name in enumerate(names) if name in sources]


def _fill_between(chain: tuple[str, ...], points: dict[str, np.ndarray], orientations: dict[str, np.ndarray]) -> None:
    """Put absent joints of a chain evenly between their neighbours; they turn with the one above."""
    for above, name in pairwise(chain):
        if name not in points:
            later = chain[chain.index(name) :]
            steps, below = next((i, joint) for i, joint in enumerate(later, 1) if joint in points)
            points[name] = points[above] + (points[below] - points[above]) / steps
            orientations[name] = orientations[above]


def restored_offsets(raw: RawSkeleton, names: tuple[str, ...], flavour: Flavour) -> tuple[np.ndarray, list[str]]:
    """Offsets (N, 3) with lost bones put back where the file has exactly zero, and which joints were moved."""
    offsets = raw.offsets.copy()
    index = {name: i for i, name in enumerate(names)}
    restored = []
    for stump, (moved, model, factor) in flavour.lost_bones.items():
        if {stump, moved, model} <= set(index) and not raw.offsets[index[stump]].any():
            offsets[index[moved]] = factor * raw.offsets[index[model]]
            restored.append(moved)
    return offsets, restored


def _names(source: Source) -> tuple[str, ...]:
    return (source,) if isinstance(source, str) else source[:2]


def _all_sources(flavour: Flavour) -> set[str]:
    return {name for source in flavour.joints.values() for name in _names(source)} | set(flavour.lost_bones)


def _missing(flavour: Flavour, present: set[str]) -> list[str]:
    return [name for sources in flavour.required().values() for name in sources if name not in present]


def _hangs_together(flavour: Flavour, names: tuple[str, ...], parents: tuple[int, ...]) -> bool:
    """Do legs and arms hang in order? (LeftShoulder may be a collar or an upper arm.)"""
    above = {name: names[parent] if parent >= 0 else None for name, parent in zip(names, parents, strict=True)}
    for chain in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")):
        for side in ("left", "right"):
            sources = [_names(flavour.joints[f"{side}_{joint}"])[0] for joint in chain]
            for upper, lower in pairwise(sources):
                walk: str | None = lower
                while walk is not None and walk != upper:
                    walk = above[walk]
                if walk is None or upper == lower:
                    return False
    return True


def _sided(table: Mapping[str, str | tuple[str, str, float]]) -> dict[str, Source]:
    """Expand rows `*_hip: "{Side}Hip"` to left and right; {S} is the initial, {s} the small one."""
    both: dict[str, Source] = {}
    for name, source in table.items():
        for side in ("Left", "Right") if name.startswith("*") else ("",):
            words = {"Side": side, "S": side[:1], "s": side[:1].lower()}
            key = name.replace("*", side.lower())
            if isinstance(source, str):
                both[key] = source.format(**words)
            else:
                both[key] = (source[0].format(**words), source[1].format(**words), source[2])
    return both


register_flavour(
    "bvh-toolbox",
    _sided(
        {
            "pelvis": "Hips", "spine1": "Spine", "spine2": ("Spine", "Spine1", 0.5), "spine3": "Spine1", "neck": "Neck",
            "head": "Head", "head_top": "Head:end", "*_hip": "{Side}UpLeg", "*_knee": "{Side}Leg",
            "*_ankle": "{Side}Foot", "*_foot": "{Side}Foot:end",
            "*_collar": "{Side}Shoulder", "*_shoulder": "{Side}Arm",
            "*_elbow": "{Side}ForeArm", "*_wrist": "{Side}Hand", "*_hand": "{Side}Hand:end",
        }
    ),
)  # fmt: skip

_HUMANOID = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head",
    "*_hip": "{Side}UpLeg", "*_knee": "{Side}Leg", "*_ankle": "{Side}Foot", "*_collar": "{Side}Shoulder",
    "*_shoulder": "{Side}Arm", "*_elbow": "{Side}ForeArm", "*_wrist": "{Side}Hand",
}  # fmt: skip

register_flavour(
    "momask", _sided(_HUMANOID | {"*_foot": "{Side}Toe", "*_toe": "{Side}Toe:end", "*_hand": "{Side}Hand:end"})
)

register_flavour(
    "mixamo",
    _sided(
        _HUMANOID
        | {
            "head_top": "HeadTop_End", "*_foot": "{Side}ToeBase", "*_toe": "{Side}Toe_End",
            "*_hand": "{Side}HandMiddle4",
        }
    ),
)  # fmt: skip

register_flavour(
    "iclone",
    _sided(
        {
            "pelvis": "CC_Base_Pelvis", "spine1": "CC_Base_Waist", "spine2": "CC_Base_Spine01",
            "spine3": "CC_Base_Spine02", "neck": "CC_Base_NeckTwist01", "head": "CC_Base_Head",
            "*_hip": "CC_Base_{S}_Thigh", "*_knee": "CC_Base_{S}_Calf", "*_ankle": "CC_Base_{S}_Foot",
            "*_foot": "CC_Base_{S}_ToeBase", "*_collar": "CC_Base_{S}_Clavicle", "*_shoulder": "CC_Base_{S}_Upperarm",
            "*_elbow": "CC_Base_{S}_Forearm", "*_wrist": "CC_Base_{S}_Hand", "*_hand": "CC_Base_{S}_Mid3",
        }
    ),
)  # fmt: skip

# The CMU files come from a conversion that lost the bone of every joint with several children: collars and neck start
# at the foot of the thorax, and the forearm ends at its twist joint (lwrist), two thirds down. In the ASF skeletons the
# thorax is as long as upperback and lwrist half as long as lradius (dm_control's humanoid_CMU: 0.114; 0.08 and 0.17 m).
register_flavour(
    "cmu-a",
    _sided(
        {
            "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": ("Spine1", "Neck", 1.0), "neck": "Neck1",
            "head": "Head", "head_top": "Head:end", "*_hip": "{Side}UpLeg", "*_knee": "{Side}Leg",
            "*_ankle": "{Side}Foot", "*_foot": "{Side}ToeBase", "*_toe": "{Side}ToeBase:end",
            "*_collar": ("{Side}Shoulder", "{Side}Arm", 0.2), "*_shoulder": "{Side}Arm", "*_elbow": "{Side}ForeArm",
            "*_wrist": "{Side}FingerBase", "*_hand": "{Side}HandIndex1:end",
        }
    ),
    lost_bones={
        "Neck": ("Neck", "Spine1", 1.0),
        "LeftShoulder": ("LeftShoulder", "Spine1", 1.0), "RightShoulder": ("RightShoulder", "Spine1", 1.0),
        "LeftFingerBase": ("LeftHand", "LeftHand", 1.5), "RightFingerBase": ("RightHand", "RightHand", 1.5),
    },
)  # fmt: skip

register_flavour(
    "cmu-b",
    _sided(
        {
            "pelvis": "Hips", "spine1": "Chest", "spine2": "Chest2", "spine3": ("Chest2", "lowerneck", 1.0),
            "neck": "Neck", "head": "Head", "head_top": "Head:end", "*_hip": "{Side}Hip", "*_knee": "{Side}Knee",
            "*_ankle": "{Side}Ankle", "*_foot": "{Side}Toe", "*_toe": "{Side}Toe:end",
            "*_collar": ("{Side}Collar", "{Side}Shoulder", 0.2), "*_shoulder": "{Side}Shoulder",
            "*_elbow": "{Side}Elbow", "*_wrist": "{s}hand", "*_hand": "{S}Fingers:end",
        }
    ),
    lost_bones={
        "lowerneck": ("lowerneck", "Chest2", 1.0),
        "LeftCollar": ("LeftCollar", "Chest2", 1.0), "RightCollar": ("RightCollar", "Chest2", 1.0),
        "lhand": ("LeftWrist", "LeftWrist", 1.5), "rhand": ("RightWrist", "RightWrist", 1.5),
    },
)  # fmt: skip
