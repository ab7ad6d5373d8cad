"""Which joints a skeleton has and how files name them: tables of known skeletons, and flavours, of which users may add more."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
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


Source = str | tuple[str, str, float]
"""A joint of the file, or (a, b, fraction): the point at that fraction from a to b, which turns with a."""

PARENT_OF: Mapping[str, str | None] = {
    name: CANONICAL_JOINTS[parent] if parent >= 0 else None
    for name, parent in zip(CANONICAL_JOINTS, CANONICAL_PARENTS, strict=True)
} | OPTIONAL_JOINTS


def parents_of(names: Sequence[str]) -> tuple[int, ...]:
    """Index of each joint's parent among the names, in which parents precede children; -1 for the root."""
    return tuple(list(names).index(str(PARENT_OF[name])) if PARENT_OF[name] else -1 for name in names)


@cache
def tables() -> Mapping[str, Any]:
    """The skeletons that the package knows; skeletons.yaml says what each section holds."""
    return shipped(Path(__file__).with_suffix(".yaml"))


def shipped(path: Path) -> Mapping[str, Any]:
    """The sections of a YAML file of the package, read in a tenth of the time that users' files take, which are checked."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return MappingProxyType(yaml.load(path.read_text(encoding="utf-8"), Loader=loader))


def sided(table: Mapping[str, Any]) -> dict[str, Any]:
    """Rows whose names begin with a star, expanded to both sides: the star is left and right before an underscore, else L and R; in
    their sources {Side} is Left or Right, {side} left or right, {S} L or R and {s} l or r."""
    both: dict[str, Any] = {}
    for name, source in table.items():
        for side in ("Left", "Right") if name.startswith("*") else ("",):
            word = side.lower() if name.startswith("*_") else side[:1]
            both[name.replace("*", word)] = _of_side(source, side) if side else source
    return both


def _of_side(source: Any, side: str) -> Any:
    if isinstance(source, str):
        for mark, word in (("{Side}", side), ("{side}", side.lower()), ("{S}", side[0]), ("{s}", side[0].lower())):
            source = source.replace(mark, word)
    return tuple(_of_side(part, side) for part in source) if isinstance(source, (list, tuple)) else source


# --- a flavour as a YAML file, for skeletons whose joints are to be named by hand ---
#
#     name: studio                       # left out, the file's name
#     joints:                            # canonical joint: joint of the BVH file
#       pelvis: Hips
#       head: Head
#       spine2: [Spine, Chest, 0.5]      # half-way from Spine to Chest, turning with Spine
#       "*_hip": "{Side}Thigh"           # left_hip: LeftThigh and right_hip: RightThigh
#       "*_foot": "{Side}Foot:end"       # the End Site below LeftFoot
#       ...
#     cmu_units: false                   # whether such files may be in units of 0.05644 m, as CMU's are
#
# Pelvis, head, hips, knees, ankles, shoulders, elbows and wrists are needed; spine1 to spine3, neck, collars, feet,
# toes, hands and head_top may be absent. `lost_bones` (joint whose zero offset betrays a lost bone: [joint to move, joint
# whose offset is the model, factor]) is there for conversions such as that of the CMU database.


FIELDS = ("name", "joints", "lost_bones", "cmu_units")

FRACTIONS = -2.0, 3.0
"""Least and greatest fraction: points lie between two joints or somewhat beyond them."""

MOST_ROWS = 100


def read_flavour(path: str | Path) -> Flavour:
    """The flavour that a YAML file describes; raises an InputError that names the file if it is wrong."""
    example = "a mapping with joints (pelvis: Hips, left_hip: LeftUpLeg, ...)"
    values = read_yaml(path, noun="flavour file", example=example)
    try:
        for key in values:
            if key not in FIELDS:
                raise unknown_name("key", key, FIELDS)
        return _flavour_of({"name": Path(path).stem} | values)
    except InputError as error:
        raise InputError(f"flavour file {path}: {error}") from None


def _flavour_of(values: Mapping[str, Any]) -> Flavour:
    """The flavour that a mapping of `FIELDS` describes."""
    rows = values.get("joints")
    if not isinstance(rows, Mapping) or not 0 < len(rows) <= MOST_ROWS:
        raise InputError(f"joints must be a mapping of canonical joints to the file's, got {shown(rows)}")
    joints = sided({_name("a canonical joint", key): _source(key, row) for key, row in rows.items()})
    return Flavour(
        name=text("name", values["name"]),
        joints=joints,
        lost_bones=_lost_bones(values.get("lost_bones", {})),
        cmu_units=flag("cmu_units", values.get("cmu_units", False)),
    )


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
    first, last = (_name(f"a joint for {shown(key)}", joint) for joint in value[:2])
    return first, last, number(f"the fraction for {shown(key)}", value[2], *FRACTIONS)


def _lost_bones(rows: Any) -> dict[str, tuple[str, str, float]]:
    if not isinstance(rows, Mapping) or len(rows) > MOST_ROWS:
        raise InputError(f"lost_bones must be a mapping of joints to [joint, joint, factor], got {shown(rows)}")
    lost_bones = {}
    for key, row in rows.items():
        source = _source(key, row)
        if isinstance(source, str):
            raise InputError(f"the lost bone of {shown(key)} must be [joint, joint, factor], got {shown(row)}")
        lost_bones[_name("a joint", key)] = source
    return lost_bones


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Flavour:
    """A convention for naming joints."""

    name: str
    joints: Mapping[str, Source]
    """The source of each canonical joint."""
    lost_bones: Mapping[str, tuple[str, str, float]] = field(default_factory=dict)
    """By the joint whose zero offset betrays a lost bone: the joint to move, the joint whose offset is the model, and a factor."""
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


@cache
def _registry() -> dict[str, Flavour]:
    """Flavours by name, those of the package first; `register_flavour` adds to them."""
    return {name: _flavour_of({"name": name} | values) for name, values in tables()["flavours"].items()}


def flavours() -> Mapping[str, Flavour]:
    """All known flavours by name; those registered last are preferred when several fit equally well."""
    return MappingProxyType(_registry())


def register_flavour(name: str, joints: Mapping[str, Source]) -> Flavour:
    """Add (or replace) a naming flavour for `load_motion` to detect; raises an InputError if joints are unknown or missing."""
    text("name", name)
    instance("joints", joints, Mapping, "a mapping of canonical joints to the file's names")
    flavour = Flavour(name=name, joints=dict(joints))
    _registry().pop(name, None)
    _registry()[name] = flavour
    return flavour


def plain_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names without the namespace that they have in common (`mixamorig:Hips`, `mixamorig1_Hips`, `actor:rig:Hips` -> `Hips`)."""
    joint_names = [name for name in names if not name.endswith(":end")]
    match = re.match(r"(.*:|mixamorig\d*_?)", joint_names[0]) if joint_names else None
    prefix = match.group(1) if match else ""
    if not prefix or not all(name.startswith(prefix) and len(name) > len(prefix) for name in joint_names):
        return names
    return tuple(name.removeprefix(prefix) for name in names)


def detect_flavour(names: tuple[str, ...], parents: tuple[int, ...]) -> Flavour | None:
    """The flavour whose joints are all there, hang in the canonical order, and cover most of the file's names, if any."""
    fitting = [flavour for flavour in reversed(_registry().values()) if not misfit(flavour, names, parents)]
    covered = [len(set(names) & {*_sources(flavour), *flavour.lost_bones}) for flavour in fitting]
    return fitting[int(np.argmax(covered))] if fitting else None


def chosen_flavour(
    name_or_path: str, spellings: Sequence[tuple[str, ...]], parents: tuple[int, ...]
) -> tuple[Flavour, tuple[str, ...]]:
    """The flavour that the user wants, a registered name or a YAML file, and the first of several spellings of the file's names
    that it fits; raises an InputError if it fits none."""
    if name_or_path not in _registry() and not name_or_path.lower().endswith((".yaml", ".yml")):
        raise InputError(
            f"flavour {shown(name_or_path)} is unknown; choose one of {', '.join(_registry())}, give a flavour file (.yaml) or "
            "register_flavour() it"
        )
    flavour = _registry().get(name_or_path) or read_flavour(name_or_path)
    problems = {names: misfit(flavour, names, parents) for names in spellings}
    for names, problem in problems.items():
        if not problem:
            return flavour, names
    raise InputError(
        f"the skeleton is not of flavour {flavour.name!r:.60}: the file {problems[spellings[0]]}; leave the flavour out to have "
        "its joints matched by names and form"
    )


def _absent(flavour: Flavour, names: Sequence[str]) -> list[str]:
    """Joints that a flavour needs and that are not among the names; optional ends are not needed."""
    needed = [source for name, source in flavour.joints.items() if name not in OPTIONAL_JOINTS]
    return [name for source in needed for name in _names(source) if name not in names]


def nearest_flavour(names: Sequence[str]) -> tuple[Flavour, list[str]]:
    """The flavour of which the names lack fewest joints, for files that tell no parents, and the joints that they lack."""
    best = min(
        reversed(_registry().values()), key=lambda kind: (len(_absent(kind, names)), -len(_sources(kind) & set(names)))
    )
    return best, _absent(best, names)


def misfit(flavour: Flavour, names: tuple[str, ...], parents: tuple[int, ...]) -> str:
    """A clause that says why a file is not of a flavour; empty if it is. Optional ends may be absent."""
    absent = _absent(flavour, names)
    if absent:
        first_absent = [f"{name:.60}" for name in absent[:8]]
        return f"lacks {', '.join(first_absent)}{' ...' if len(absent) > 8 else ''}"
    return "" if _hangs_together(flavour, names, parents) else "hangs together differently"


def canonical(
    names: Sequence[str],
    flavour: Flavour,
    positions: np.ndarray,
    rotations: np.ndarray,
    offsets: np.ndarray | None = None,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Positions (T, 3) and orientations (T, 4) by canonical name, in canonical order, from those of the file, (T, N, 3) and
    (T, N, 4). Feet that the flavour lacks are left out, and optional ends that are absent or whose offset (N, 3) is 0."""
    index = {name: i for i, name in enumerate(names)}
    points: dict[str, np.ndarray] = {}
    orientations: dict[str, np.ndarray] = {}
    for name, source in flavour.joints.items():
        first, last, fraction = (source, source, 0.0) if isinstance(source, str) else source
        absent = first not in index or last not in index or (offsets is not None and not offsets[index[first]].any())
        if not (absent and name in OPTIONAL_JOINTS):
            points[name] = (1.0 - fraction) * positions[:, index[first]] + fraction * positions[:, index[last]]
            orientations[name] = rotations[:, index[first]]
    for chain in FILL_CHAINS:
        _fill_between(chain, points, orientations)
    order = [name for name in PARENT_OF if name in points]
    return {name: points[name] for name in order}, {name: orientations[name] for name in order}


def source_joints(names: tuple[str, ...], flavour: Flavour) -> list[int]:
    """Indices of the file's joints that canonical ones are made of."""
    sources = _sources(flavour)
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


def _sources(flavour: Flavour) -> set[str]:
    """The file's joints that canonical ones are made of."""
    return {name for source in flavour.joints.values() for name in _names(source)}


def _names(source: Source) -> tuple[str, ...]:
    return (source,) if isinstance(source, str) else source[:2]


def _hangs_together(flavour: Flavour, names: tuple[str, ...], parents: tuple[int, ...]) -> bool:
    """Whether the joints of legs and arms hang below one another: LeftShoulder may be a collar or an upper arm."""
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
