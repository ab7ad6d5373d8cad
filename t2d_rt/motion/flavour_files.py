"""A flavour as a YAML file, for skeletons whose joints are to be named by hand.

    name: studio                       # left out, the file's name
    joints:                            # canonical joint: joint of the BVH file
      pelvis: Hips
      spine3: Chest
      head: Head
      "*_hip": "{Side}Thigh"           # left_hip: LeftThigh and right_hip: RightThigh
      "*_knee": "{Side}Shin"           # {Side} Left or Right, {side} left or right, {S} L or R, {s} l or r
      "*_ankle": "{Side}Foot"
      "*_foot": "{Side}Foot:end"       # the End Site below LeftFoot
      "*_shoulder": "{Side}Arm"
      "*_elbow": "{Side}ForeArm"
      "*_wrist": "{Side}Hand"
      spine2: [Spine, Chest, 0.5]      # half-way from Spine to Chest, turning with Spine
    cmu_units: false                   # whether such files may be in units of 0.05644 m, as CMU's are

Pelvis, head, hips, knees, ankles, shoulders, elbows and wrists are needed; spine1 to spine3, neck, collars, feet, toes, hands and
head_top may lack. `lost_bones` (joint whose zero offset betrays a lost bone: [joint to move, joint whose offset is the model,
factor]) is there for conversions such as that of the CMU database.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from t2d_rt.core.checks import flag, number, shown, text, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.motion.conventions import Source, sided
from t2d_rt.motion.skeletons import Flavour

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
