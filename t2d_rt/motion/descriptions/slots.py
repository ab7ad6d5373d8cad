"""What a description of an activity says, slot by slot: the properties of the Text2Doppler paper's Table I.

One description is one sample's main step (a fall, a walk) with what comes before and after it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import ConfigDict, Field, StringConstraints, model_validator

from t2d_rt.core.atomic_write import check_taken, replacing
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.types.fields import Fields

Activity = Literal["walking", "abnormal_walking", "running", "falling", "sitting", "bending", "jumping", "dancing"]
"""The paper's eight classes."""

Action = Literal[
    "walk", "fall", "sit", "bend", "lie_down", "stand_up", "climb", "stretch", "squat", "dance", "run", "jump", "turn",
    "stand", "balance",
]  # fmt: skip
"""The actions of Table I; standing, which comes before and after many of them; and balancing, which is standing on one leg."""

Manner = Literal["careful", "happy", "angry", "sad"]
Speed = Literal["slow", "normal", "fast"]
Direction = Literal[
    "forward", "back", "left", "right", "straight", "clockwise", "counterclockwise", "up", "down", "in_place"
]  # fmt: skip
BodyPart = Literal["arm", "foot", "hand", "leg", "waist", "knee"]
Object = Literal["stair", "chair", "floor", "ball", "handrail"]

FallType = Literal["slip", "trip", "collapse"]
GaitType = Literal["parkinsonian", "festinating", "freezing", "waddling", "ataxic", "scissor", "steppage", "limping"]

Side = Literal["left", "right"]

Subject = Literal["person", "man", "woman", "child", "old_person", "heavy_person"]
"""Who moves; it chooses body and stature."""

ACTIVITIES: tuple[Activity, ...] = get_args(Activity)
FALL_TYPES: tuple[FallType, ...] = get_args(FallType)
GAIT_TYPES: tuple[GaitType, ...] = get_args(GaitType)

ACTIONS_OF: dict[Activity, tuple[Action, ...]] = {
    "walking": ("walk", "turn", "climb"),
    "abnormal_walking": ("walk",),
    "running": ("run",),
    "falling": ("fall",),
    "sitting": ("sit", "stand_up", "lie_down"),
    "bending": ("bend", "squat", "stretch", "balance"),
    "jumping": ("jump",),
    "dancing": ("dance",),
}
"""Main actions of each class."""

RESTS_OF: dict[Activity, tuple[str, ...]] = {"sitting": ("seated", "lying")}
"""Rests after such actions, or before them, that are of the class, too."""


_SIDES: tuple[Direction, ...] = ("forward", "back", "left", "right")
_LEVEL: tuple[Direction, ...] = (*_SIDES, "straight")
_CIRCLES: tuple[Direction, ...] = ("clockwise", "counterclockwise")
_MOVING: tuple[Direction, ...] = (*_LEVEL, *_CIRCLES, "up", "down")
_LOWERING: tuple[Action, ...] = ("sit", "lie_down", "bend")

DIRECTIONS_OF: dict[Action, tuple[Direction, ...]] = {
    **dict.fromkeys(("dance", "jump"), _MOVING),
    **dict.fromkeys(("walk", "run"), (*_MOVING, "in_place")),
    **dict.fromkeys(_LOWERING, (*_SIDES, "down")),
    "turn": ("left", "right", "back", *_CIRCLES),
    "climb": ("up", "down"),
    "fall": (*_LEVEL, "down"),
    "stand_up": (*_SIDES, "up"),
    "squat": ("down",),
    "stretch": (*_SIDES, "up", "down"),
    "stand": (*_LEVEL, "up"),
    "balance": (),
}
"""Directions that each action can have: nobody falls up, or squats clockwise. Of lying, on which side of the body."""

MOST_TIMES, LONGEST_S, TURNED_DEG = 100, 600.0, (10.0, 720.0)
"""Greatest `count` and `duration_s` [s], and the range of `angle_deg`."""
LONGEST_SENTENCE, MOST_STEPS = 2000, 30
"""Most characters of a sentence, and most steps of an activity."""


class Step(Fields):
    """One action and how it is done."""

    noun: ClassVar[str] = "step"
    model_config = ConfigDict(populate_by_name=True)

    action: Action
    manner: Manner | None = None
    direction: Direction | None = None
    speed: Speed = "normal"
    body_part: BodyPart | None = None
    object: Object | None = None
    type: FallType | GaitType | None = None
    """Of a fall, how it comes about; of a walk, what is wrong with the gait."""
    side: Side | None = None
    """Which of the two body parts, as the leg that limps."""
    count: Annotated[int, Field(ge=1, le=MOST_TIMES)] | None = None
    """How many times the action is done."""
    duration_s: Annotated[float, Field(gt=0, le=LONGEST_S)] | None = None
    """How long the action lasts [s]."""
    angle_deg: Annotated[float, Field(ge=TURNED_DEG[0], le=TURNED_DEG[1])] | None = None
    """By which somebody turns [degrees], where that is said; the direction tells to which side."""

    @model_validator(mode="after")
    def _consistent(self) -> Step:
        if self.type is not None:
            action = "fall" if self.type in FALL_TYPES else "walk"
            if self.action != action:
                raise InputError(f"type {self.type} belongs to action {action}, not to {self.action}")
        if self.side is not None and self.body_part in (None, "waist"):
            raise InputError(f"side {self.side} belongs to an arm, foot, hand, leg or knee; give body_part, too")
        if self.angle_deg is not None and self.action != "turn":
            raise InputError(f"angle_deg belongs to action turn, not to {self.action}; leave it out")
        if self.direction is not None and self.direction not in DIRECTIONS_OF[self.action]:
            raise InputError(
                f"action {self.action} has no direction {self.direction}; choose one of "
                f"{', '.join(DIRECTIONS_OF[self.action])}, or leave it out"
            )
        return self


class Description(Step):
    """An activity in slots and in words: the main step, what comes before and after it, and the sentence."""

    noun: ClassVar[str] = "description"

    activity: Annotated[Activity, Field(alias="class")]
    subject: Subject = "person"
    before: Annotated[tuple[Step, ...], Field(max_length=MOST_STEPS)] = ()
    """Steps that lead to the main one, as the walk before a fall."""
    after: Annotated[tuple[Step, ...], Field(max_length=MOST_STEPS)] = ()
    """Steps that follow it."""
    sentence: Annotated[str, StringConstraints(min_length=1, max_length=LONGEST_SENTENCE)]

    @model_validator(mode="after")
    def _of_its_class(self) -> Description:
        if self.action not in ACTIONS_OF[self.activity]:
            raise InputError(
                f"class {self.activity} is made of {' or '.join(ACTIONS_OF[self.activity])}, not of {self.action}"
            )
        if (self.activity == "abnormal_walking") != (self.type in GAIT_TYPES):
            raise InputError("class abnormal_walking needs a type of gait, and no other class takes one")
        return self

    @property
    def steps(self) -> tuple[Step, ...]:
        """All steps in order, the main one among them."""
        return (*self.before, self, *self.after)


# --- files of JSON lines: one object a line, with all keys of the schema ---

LARGEST_FILE = 100_000_000
"""Bytes of a file of descriptions."""


def as_json(description: Description) -> dict[str, Any]:
    """A description as plain data, its class first; steps hold what they say only."""
    fields = description.model_dump(mode="json", by_alias=True)
    for name in ("before", "after"):
        fields[name] = [step.model_dump(mode="json", exclude_none=True) for step in getattr(description, name)]
    return {"class": fields.pop("class"), **fields}


def json_lines(descriptions: Iterable[Description]) -> str:
    """The text of a file of descriptions."""
    return "".join(json.dumps(as_json(description), ensure_ascii=False) + "\n" for description in descriptions)


def write_descriptions(path: str | Path, descriptions: Iterable[Description], *, overwrite: bool = False) -> None:
    """Writes descriptions as JSON lines, whole or not at all."""
    target = Path(path)
    with replacing(target, lambda: check_taken(target, overwrite=overwrite)) as new:
        new.write_text(json_lines(descriptions), encoding="utf-8")


def read_descriptions(path: str | Path) -> list[Description]:
    """The descriptions of a file of JSON lines; an InputError that names the line where one is wrong."""
    data = read_bytes(path, limit=LARGEST_FILE, noun="file of descriptions")
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"file of descriptions {path} is no text in UTF-8; write it with t2d-rt describe") from None
    descriptions = []
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                descriptions.append(Description.model_validate_json(line))
            except InputError as error:
                raise InputError(f"line {number} of {path}: {error}") from None
    if not descriptions:
        raise InputError(f"file of descriptions {path} holds none; write it with t2d-rt describe")
    return descriptions
