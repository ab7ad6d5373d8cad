"""What a language model is asked for, and how its reply is read: the schema, the prompt, the descriptions in the reply."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, get_args

from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.grammar import Drawn
from t2d_rt.motion.descriptions.parse import parse_description
from t2d_rt.motion.descriptions.slots import (
    ACTIONS_OF,
    FALL_TYPES,
    GAIT_TYPES,
    LONGEST_S,
    MOST_TIMES,
    Action,
    Activity,
    BodyPart,
    Description,
    Direction,
    Manner,
    Object,
    Side,
    Speed,
    Subject,
)

LONGEST_REPLY = 200_000
"""Characters of a reply that are read."""

KINDS = {
    "walking": "normal walking, turning or climbing stairs",
    "abnormal_walking": "walking with a gait that is disturbed as the type says, in everyday or in clinical words",
    "running": "running",
    "falling": "falling, by the cause that the type says",
    "sitting": "sitting down, standing up or lying down",
    "bending": "bending, squatting or stretching",
    "jumping": "jumping",
    "dancing": "dancing",
}
"""The classes in words."""

SYSTEM = (
    "You write descriptions of human motion for a data set. Each is one natural, grammatical English sentence of 5 to "
    "30 words about what one "
    "person does with the body, as an observer would see it; no feelings without visible effect, no names, no place "
    "that matters. "
    "The sentence says all properties that are given for it, those of the steps before and after too, in this order "
    "of time, and nothing that "
    "contradicts them. Vary structure and vocabulary from sentence to sentence. Reply with JSON only: an object whose "
    "key descriptions holds a "
    "list of objects, one for each set of properties, each with the properties unchanged (null where none is given) "
    "and the key sentence."
)


def json_schema(activity: Activity) -> dict[str, Any]:
    """The schema of a reply, as strict as structured output wants it: every key required, no others."""
    types = {"falling": FALL_TYPES, "abnormal_walking": GAIT_TYPES}.get(activity, ())
    step = _step(get_args(Action), (*FALL_TYPES, *GAIT_TYPES))
    item = _step(ACTIONS_OF[activity], types)
    item["properties"] |= {
        "subject": {"type": "string", "enum": list(get_args(Subject))},
        "before": {"type": "array", "items": step},
        "after": {"type": "array", "items": step},
        "sentence": {"type": "string"},
    }
    item["required"] = list(item["properties"])
    return {
        "type": "object",
        "properties": {"descriptions": {"type": "array", "items": item}},
        "required": ["descriptions"],
        "additionalProperties": False,
    }


def _step(actions: Sequence[str], types: Sequence[str]) -> dict[str, Any]:
    properties: dict[str, Any] = {"action": {"type": "string", "enum": list(actions)}}
    for name, kind in (
        ("manner", Manner),
        ("direction", Direction),
        ("body_part", BodyPart),
        ("object", Object),
        ("side", Side),
    ):
        properties[name] = {"type": ["string", "null"], "enum": [*get_args(kind), None]}
    properties["speed"] = {"type": "string", "enum": list(get_args(Speed))}
    properties["type"] = {"type": ["string", "null"], "enum": [*types, None]}
    properties["count"] = {"type": ["integer", "null"], "description": f"times, 1 to {MOST_TIMES}"}
    properties["duration_s"] = {"type": ["number", "null"], "description": f"seconds, up to {LONGEST_S:g}"}
    return {"type": "object", "properties": properties, "required": list(properties), "additionalProperties": False}


def messages(activity: Activity, asked: Sequence[Drawn]) -> list[dict[str, str]]:
    """The prompt for a description of each set of properties."""
    rows = "\n".join(f"{number}. {json.dumps(_given(each))}" for number, each in enumerate(asked, 1))
    task = (
        f"Class: {activity} ({KINDS[activity]}). Write {len(asked)} descriptions, one for each of these sets of "
        f"properties:\n{rows}"
    )
    schema = json.dumps(json_schema(activity))
    return [
        {"role": "system", "content": SYSTEM},
        {"role": "user", "content": f"{task}\n\nJSON schema of the reply: {schema}"},
    ]


def _given(each: Drawn) -> dict[str, Any]:
    found: dict[str, Any] = {"subject": each.subject, **each.main.model_dump(exclude_none=True)}
    for name, steps in (("before", each.before), ("after", each.after)):
        if steps:
            found[name] = [step.model_dump(exclude_none=True) for step in steps]
    return found


def rows_of(reply: str) -> list[Any]:
    """The list of descriptions in a reply, whatever they are; a ValueError where it is no such JSON."""
    if len(reply) > LONGEST_REPLY:
        raise ValueError(f"it is longer than {LONGEST_REPLY} characters")
    text = reply.strip()
    if text.startswith("```"):  # models like to wrap JSON so
        text = text.strip("`").removeprefix("json").strip()
    try:
        found = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    rows = found.get("descriptions") if isinstance(found, dict) else found
    if not isinstance(rows, list):
        raise ValueError("it holds no list of descriptions")
    return rows


def description_of(row: Any, activity: Activity) -> Description:
    """One description of a reply; an InputError where it is not valid, of another class, or says other than its slots."""
    if not isinstance(row, dict):
        raise InputError("a description must be a mapping")
    if row.get("class", activity) != activity:
        raise InputError("it is of another class")
    empty = {"before": (), "after": (), "speed": "normal", "subject": "person"}
    fields = {name: empty.get(name) if value is None else value for name, value in row.items() if name != "class"}
    for name in ("before", "after"):
        fields[name] = [_step_of(each) for each in fields.get(name) or ()]
    return Description.model_validate({**fields, "class": activity})


def _step_of(row: Any) -> Any:
    if not isinstance(row, dict):
        return row
    return {name: value for name, value in row.items() if value is not None}


def agrees(description: Description) -> bool | None:
    """Whether the sentence says what the slots say, as far as the parser understands it; None where it does not."""
    try:
        found = parse_description(description.sentence).description
    except InputError:
        return None
    if found.activity != description.activity or found.action != description.action:
        return False
    told = ("type", "direction")
    return all(getattr(found, slot) in (None, getattr(description, slot)) for slot in told)
