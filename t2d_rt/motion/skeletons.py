"""Naming conventions of skeletons, as data and as flavour files, and how joints are named by them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.checks import flag, instance, number, shown, text, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, OPTIONAL_JOINTS

if TYPE_CHECKING:
    from t2d_rt.motion.read.bvh import RawSkeleton


# --- naming conventions of well-known skeletons, as data ---
#
# Rows of `sided` name both sides at once: `*_hip: "{Side}UpLeg"` stands for left_hip: LeftUpLeg and right_hip:
# RightUpLeg.


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


# --- a flavour as a YAML file, for skeletons whose joints are to be named by hand ---
#
# name: studio # left out, the file's name joints: # canonical joint: joint of the BVH file pelvis: Hips spine3: Chest
# head: Head "*_hip": "{Side}Thigh" # left_hip: LeftThigh and right_hip: RightThigh "*_knee": "{Side}Shin" # {Side}
# Left or Right, {side} left or right, {S} L or R, {s} l or r "*_ankle": "{Side}Foot" "*_foot": "{Side}Foot:end" # the
# End Site below LeftFoot "*_shoulder": "{Side}Arm" "*_elbow": "{Side}ForeArm" "*_wrist": "{Side}Hand" spine2: [Spine,
# Chest, 0.5] # half-way from Spine to Chest, turning with Spine cmu_units: false # whether such files may be in units
# of 0.05644 m, as CMU's are
#
# Pelvis, head, hips, knees, ankles, shoulders, elbows and wrists are needed; spine1 to spine3, neck, collars, feet,
# toes, hands and head_top may lack. `lost_bones` (joint whose zero offset betrays a lost bone: [joint to move, joint
# whose offset is the model, factor]) is there for conversions such as that of the CMU database.


FIELDS = ("name", "joints", "lost_bones", "cmu_units")

FRACTIONS = -2.0, 3.0
"""Points between and a little beyond two joints."""

MOST_ROWS = 100


def is_flavour_file(wanted: str) -> bool:
    """Is this the name of a YAML file?"""
    return wanted.lower().endswith((".yaml", ".yml"))


def read_flavour(path: str | Path) -> Flavour:
    """The flavour that a YAML file describes; an InputError of one sentence that names the file where it is wrong."""
    example = "a mapping with joints (pelvis: Hips, left_hip: LeftUpLeg, ...)"
    values = read_yaml(path, noun="flavour file", example=example)
    try:
        for key in values:
            if key not in FIELDS:
                raise unknown_name("key", key, FIELDS)
        rows = values.get("joints")
        if not isinstance(rows, Mapping) or not 0 < len(rows) <= MOST_ROWS:
            raise InputError(f"joints must be a mapping of canonical joints to the file's, got {shown(rows)}")
        joints = sided({_name("a canonical joint", key): _source(key, row) for key, row in rows.items()})
        return Flavour(
            name=text("name", values.get("name", Path(path).stem)), joints=joints,
            lost_bones=_lost_bones(values.get("lost_bones", {})), cmu_units=flag("cmu_units", values.get("cmu_units", False)),
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"flavour file {path}: {error}") from None


def _name(what: str, value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputError(
            f"{what} must be a name, got {shown(value)}; put it in quotation marks if it looks like a number"
        )
    return value


def _source(key: Any, value: Any) -> Source:
    if not isinstance(value, (list, tuple)):
        return _name(f"the joint for {shown(key)}", value)
    if len(value) != 3:
        raise InputError(f"the source of {shown(key)} must be a joint or [joint, joint, fraction], got {shown(value)}")
    first, last = (_name(f"a joint for {shown(key)}", each) for each in value[:2])
    return first, last, number(f"the fraction for {shown(key)}", value[2], *FRACTIONS)


def _lost_bones(rows: Any) -> dict[str, tuple[str, str, float]]:
    if not isinstance(rows, Mapping) or len(rows) > MOST_ROWS:
        raise InputError(f"lost_bones must be a mapping of joints to [joint, joint, factor], got {shown(rows)}")
    found = {}
    for key, row in rows.items():
        source = _source(key, row)
        if isinstance(source, str):
            raise InputError(f"the lost bone of {shown(key)} must be [joint, joint, factor], got {shown(row)}")
        found[_name("a joint", key)] = source
    return found


# --- naming flavours: which joints of a file are the canonical ones ---
#
# A flavour is data: for each canonical joint either a source joint of the file, or `(a, b, fraction)`, a point that
# far from source a to source b which turns with a. End sites are called `<parent>:end`. Canonical joints that a table
# leaves out (spine2, spine3, collars) are put between their mapped neighbours on the canonical chain; the reader adds
# feet.


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


def parents_of(names: Sequence[str]) -> tuple[int, ...]:
    """Places of the parents of joints, parents before children, among them; -1 for the root."""
    return tuple(list(names).index(str(PARENT_OF[name])) if PARENT_OF[name] else -1 for name in names)


@dataclass(frozen=True, slots=True, kw_only=True)
class Flavour:
    """A convention for naming joints."""

    name: str
    joints: Mapping[str, Source]
    """Canonical joint -> source."""
    lost_bones: Mapping[str, tuple[str, str, float]] = field(default_factory=dict)
    """Joint whose zero offset betrays a lost bone -> (joint to move, joint whose offset is the model, factor)."""
    cmu_units: bool = False
    """Whether such files may be in the units of the CMU database, 0.05644 m."""

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
    name: str,
    joints: Mapping[str, Source],
    *,
    lost_bones: Mapping[str, tuple[str, str, float]] | None = None,
    cmu_units: bool = False,
) -> Flavour:
    """Add (or replace) a naming flavour; `load_motion` detects it from then on."""
    text("name", name)
    instance("joints", joints, Mapping, "a mapping of canonical joints to the file's names")
    if lost_bones is not None:
        instance("lost_bones", lost_bones, Mapping, "a mapping of joints to (parent, child, fraction)")
    flavour = Flavour(
        name=name, joints=dict(joints), lost_bones=dict(lost_bones or {}), cmu_units=flag("cmu_units", cmu_units)
    )
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


def detect_flavour(names: tuple[str, ...], parents: tuple[int, ...]) -> Flavour | None:
    """The flavour whose joints are all there, hang in the canonical order, and cover most of the file's names, if any."""
    fitting = [flavour for flavour in reversed(_flavours.values()) if not misfit(flavour, names, parents)]
    return max(fitting, key=lambda flavour: len(set(names) & _all_sources(flavour)), default=None)


def chosen_flavour(
    wanted: str, spellings: Sequence[tuple[str, ...]], parents: tuple[int, ...]
) -> tuple[Flavour, tuple[str, ...]]:
    """The flavour that the user wants, a registered name or a YAML file, and that of several spellings of the file's names which it
    fits; an InputError where it fits none."""

    if wanted not in _flavours and not is_flavour_file(wanted):
        raise InputError(
            f"flavour {shown(wanted)} is unknown; choose one of {', '.join(_flavours)}, give a flavour file (.yaml) or "
            "register_flavour() it"
        )
    flavour = _flavours[wanted] if wanted in _flavours else read_flavour(wanted)
    problems = {names: misfit(flavour, names, parents) for names in spellings}
    for names, problem in problems.items():
        if not problem:
            return flavour, names
    raise InputError(
        f"the skeleton is not of flavour {flavour.name!r:.60}: the file {problems[spellings[0]]}; leave the flavour out to have "
        "its joints matched by names and form"
    )


def misfit(flavour: Flavour, names: tuple[str, ...], parents: tuple[int, ...]) -> str:
    """What keeps a file from being of a flavour, in words; empty if it is."""
    if absent := _missing(flavour, set(names)):
        told = [f"{name:.60}" for name in absent[:8]]
        return f"lacks {', '.join(told)}{' ...' if len(absent) > 8 else ''}"
    return "" if _hangs_together(flavour, names, parents) else "hangs together differently"


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


for _convention in CONVENTIONS:
    register_flavour(**_convention)
