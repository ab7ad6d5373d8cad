"""What of a description's step its makers heed, and what nothing makes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from t2d_rt.motion.descriptions.slots import GAIT_TYPES, Action, Step

COUNTED = frozenset({"jump", "bend", "squat", "stretch", "climb", "sit", "stand_up", "turn"})
"""Actions that are done as many times as a description says."""

PARTS: Mapping[Action, str] = {
    "jump": "foot leg arm hand", "bend": "arm hand foot leg waist knee", "squat": "arm hand foot leg",
    "stretch": "arm hand foot leg waist knee", "sit": "foot leg", "stand_up": "foot leg",
}  # fmt: skip
"""Parts of the body that each action heeds, where a description names one; every abnormal gait heeds them."""

OBJECTS: Mapping[Action, str] = {
    "climb": "stair handrail", "sit": "chair stair handrail", "stand_up": "chair stair handrail", "lie_down": "chair",
    "bend": "ball handrail", "squat": "ball handrail", "stretch": "handrail",
}  # fmt: skip
"""Objects that each action heeds, beside the floor that everybody is on."""

IDLE_DIRECTIONS: Mapping[Action, str] = {"sit": "back forward", "stand_up": "forward back left right"}
"""Directions that change nothing, beside those in which an action goes anyway."""


def not_made(step: Step, then: Sequence[Step] = ()) -> list[str]:
    """What a step asks for and no maker does, in words. then: steps that follow, which may use what is walked to."""
    action = step.action.replace("_", " ")
    said = []
    if step.count is not None and step.count > 1 and step.action not in COUNTED:
        said.append(f"count {step.count} of {action}")
    if step.duration_s is not None and step.action == "fall":
        said.append(f"duration {step.duration_s:g} s of {action}")
    parts = PARTS.get(step.action, "").split()
    if step.action == "jump" and step.direction is not None:  # jumping jacks go nowhere
        parts = ["foot", "leg"]
    if step.body_part is not None and step.body_part not in parts and step.type not in GAIT_TYPES:
        said.append(f"{step.side + ' ' if step.side else ''}{step.body_part} of {action}")
    used = step.type == "trip" or (
        step.action in ("walk", "run")
        and (
            (step.object == "stair" and step.direction in ("up", "down"))
            or any(step.object in OBJECTS.get(each.action, "").split() for each in then)
        )
    )
    if step.object not in (None, "floor", *OBJECTS.get(step.action, "").split()) and not used:
        said.append(f"{step.object} of {action}")
    if step.direction is not None and step.direction in IDLE_DIRECTIONS.get(step.action, "").split():
        said.append(f"direction {step.direction} of {action}")
    if step.manner is not None and step.action == "fall":
        said.append(f"manner {step.manner} of {action}")
    return said
