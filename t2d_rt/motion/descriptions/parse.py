"""A free sentence read into the slots of a description.

>>> parsed = parse_description("A person walks slowly forward, slips and falls backward.")
>>> parsed.description.activity, parsed.description.type, parsed.description.direction
('falling', 'slip', 'back')
>>> parsed.description.before[0].speed, parsed.ignored
('slow', ())
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field

from t2d_rt.core.checks import shown, text
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions import slots
from t2d_rt.motion.descriptions.lexicon import forms_of, lexicon
from t2d_rt.motion.descriptions.parse_steps import REPEATED, Opposite, ParseStep, Reader, merged
from t2d_rt.motion.descriptions.slots import Activity, Description, Step
from t2d_rt.motion.descriptions.tokens import tokens_of

DISTURBED = "disturbed walk"
LOWEST_FIRST = (
    *("turn", "walk", "climb", "run", "stand_up", "bend, squat, stretch, balance", "sit, lie_down", "jump", "dance"),
    *(DISTURBED, "fall"),
)
RANK = {action: rank for rank, actions in enumerate(LOWEST_FIRST) for action in actions.split(", ")}
"""The action of highest rank is the main one, the first where there are several; a disturbed walk comes after a fall."""
MOVING = "walk", "run", "climb"
DOWN_S = 3.0
"""Time in which somebody sits or lies down who then waits [s]."""

UNDERSTOOD = (
    "walking, abnormal gaits, running, falling, sitting, lying down, standing up, bending, squatting, "
    "stretching, standing on one leg, jumping, dancing, turning and climbing stairs"
)


@dataclass(frozen=True, slots=True)
class Parsed:
    """A sentence in slots."""

    description: Description
    ignored: tuple[str, ...] = ()
    """Words that were not understood, and fill no slot."""
    read_as: tuple[tuple[str, str], ...] = ()
    """Words that were read as others: misspelt ones, and a circle without its sense."""
    partly: tuple[str, ...] = field(default=(), compare=False)
    """Words that say more than is made of them, each with what is made."""

    def __str__(self) -> str:
        """What should be said to whoever wrote the sentence; nothing where all was understood."""
        said = [f"read {written!r} as {meant!r}" for written, meant in self.read_as]
        if self.ignored:
            said.append(f"not understood and left out: {', '.join(self.ignored)}")
        if self.partly:
            said.append(f"not made as said: {', '.join(self.partly)}")
        return "; ".join(said)


def parse_description(sentence: str) -> Parsed:
    """Reads a free sentence in English into slots.

    Raises InputError where no activity is understood, or the sentence contradicts itself.

    sentence: what one person does, in one or several steps: "a man walks to a chair, sits down and stands up again".
    """
    sentence = _checked(sentence)
    tokens = tokens_of(sentence)
    reader = Reader()
    try:
        for token in tokens:
            reader.read(token)
        steps = _settled(_happening(reader), reader.ignored)
    except Opposite as error:
        directions, verb = error.args
        raise InputError(
            f"the sentence is contradictory: it says {directions} of one action ({verb}); leave one of them out, or "
            "write two steps"
        ) from None
    for place, step in enumerate(steps):
        falls = any(each.action == "fall" for each in steps[place : place + 2])  # slips while walking
        if step.joined == "while" and len(steps) > 1 and not falls:
            reader.partly.append(f"{step.words} (made in turn, not at the same time)")
    description, read_as = _description(steps, reader, sentence)
    left_out = Counter(reader.ignored)
    slips = []
    for token in tokens:
        if token.note and left_out[token.note] > 0:
            left_out[token.note] -= 1
        elif token.note:
            slips.append((token.note, token.words))
    return Parsed(description, tuple(reader.ignored), (*slips, *read_as), tuple(reader.partly))


def _checked(sentence: str) -> str:
    sentence = " ".join(text("a description", sentence, hint="write it as 'a person walks slowly forward'").split())
    if not any(char.isalpha() for char in sentence):
        raise InputError(
            f"a description needs words, got {shown(sentence)}; write what a person does, as 'a man sits down'"
        )
    if len(sentence) > slots.LONGEST_SENTENCE:
        raise InputError(
            f"a description has at most {slots.LONGEST_SENTENCE} characters, got {len(sentence)}; describe one person's "
            "activity in a sentence"
        )
    numbers = "|".join(number for number in lexicon().numbers if number not in ("a", "an"))
    below = rf"(?<![^\s(=:x\u00d7*])(?:[-\u2212](?=[\d.])|(?:minus|negative)\s+(?=[\d.]|(?:a|{numbers}|half|pi|\u03c0)\b))\S+"
    measures = "|".join(re.escape(measure) for measure in ("times", "turns", *lexicon().seconds, *lexicon().degrees))
    wrong = re.search(rf"{below}|\b(?:nan|inf|infinite|infinity)\s*(?:{measures})\b", sentence, re.IGNORECASE)
    if wrong is not None:
        raise InputError(
            f"numbers of a description are above 0, got {wrong[0]}; write how many times, how long, or to which side"
        )
    letters = [char for char in sentence if char.isalpha()]
    if sum(char.isascii() for char in letters) < len(letters) / 2:
        raise InputError(f"a description is an English sentence, got {shown(sentence)}; translate it")
    return sentence


def _happening(reader: Reader) -> list[ParseStep]:
    """The steps, without slips and stumbles from which the sentence says that nobody falls."""
    steps = reader.ordered()
    near_falls = forms_of(lexicon().near_falls)
    happening = [step for step in steps if not (reader.recovers and step.words.split()[0] in near_falls)]
    lost = [step.words for step in steps if step not in happening]
    reader.ignored += lost
    reader.denied_actions += lost
    return happening


def _settled(steps: list[ParseStep], ignored: list[str]) -> list[ParseStep]:
    """Steps that mean something together are one; what is implied by another step is left out."""
    _resolve_stumbles(steps)
    steps = _without_weak(steps, ignored)
    for number, step in enumerate(steps):
        if step.get("type") in slots.FALL_TYPES and step.action != "fall":
            fall = next((later for later in steps[number:] if later.action == "fall"), None)
            if fall is not None and fall.get("type") is None:
                fall.said["type"] = step.get("type")
            elif fall is None and step.action != "jump":  # over an obstacle
                ignored.append(step.cause)
            step.said.pop("type", None)
    settled: list[ParseStep] = []
    for step in steps:
        together = _together(settled[-1], step, ignored) if settled else None
        settled = [*settled[:-1], together] if together is not None else [*settled, step]
    for step in settled:
        level = step.action in ("walk", "run") and step.get("object") != "stair"
        if step.action == "climb" and step.given.get("direction") == "up and down":
            ignored.append("down")
        if level and step.get("direction") in ("up", "down"):  # up to the door, down the street
            ignored.append(str(step.get("direction")))
            step.said.pop("direction")
    return settled


def _resolve_stumbles(steps: list[ParseStep]) -> None:
    """Stumbling is a fall where something falls; about a place or to both sides, it is an unsteady walk; else a fall."""
    falls = any(other.action == "fall" for other in steps)
    sides = {other.get("direction") for other in steps if other.action == "stumble"}
    moving = any(other.action == "walk" and other.joined == "while" for other in steps)
    for step in steps:
        if step.action == "stumble":
            walks = not falls and (moving or sides >= {"left", "right"})
            step.action = "walk" if walks else "fall"
            step.implied["type"] = "ataxic" if walks else "trip"
            if walks and step.get("direction") in ("left", "right"):
                step.said.pop("direction")


def _without_weak(steps: list[ParseStep], ignored: list[str]) -> list[ParseStep]:
    telling = any(not step.weak for step in steps)
    telling_steps = []
    for step in steps:
        of_limb = step.get("body_part") is not None  # moves an arm forward
        directed = step.get("direction") is not None and step.action == "walk" and not of_limb
        if step.weak and telling and not directed:
            ignored.append(step.words)
        else:
            telling_steps.append(step)
    return telling_steps


def _together(first: ParseStep, second: ParseStep, ignored: list[str]) -> ParseStep | None:
    """Returns one step for two neighbours that mean one action, or None if they are two actions."""
    loose = second.joined in ("", ",", "while")
    actions = first.action, second.action
    if first.action == second.action:
        measured = {"count", "angle_deg"} & first.said.keys() & second.said.keys()
        if (second.repeats or measured) and first.action in REPEATED:
            return None
        if first.words == second.words and second.joined == "then" and first.get("type") != second.get("type"):
            return None  # walks, then with a limp
    if actions in (("fall", "lie_down"), ("fall", "sit")):
        lying = ParseStep("fall", {}, {**second.slots(), "type": first.get("type")}, given=second.given)
        together = merged(first, lying, ignored)
        ignored += [second.words] * (together is None or second.action == "sit")
        ignored += second.given.values() if together is None else []
        return together or first
    resting = first.words in ("lying", "sitting", "seated") and first.said.keys() <= {"object"}
    if resting and first.joined != "before" and actions in (("lie_down", "stand_up"), ("sit", "stand_up")):
        return merged(second, ParseStep("stand_up", {}, dict(first.said)), ignored)
    if first.action in ("sit", "lie_down") and second.action == "stand" and second.words in forms_of(lexicon().waiting):
        lasting_s = float(str(second.get("duration_s") or 0)) + (0 if first.get("duration_s") else DOWN_S)
        return merged(first, ParseStep(first.action, {}, {**second.slots(), "duration_s": lasting_s}), ignored)
    same_direction = second.get("direction") in (None, first.get("direction"))
    if second.action == "bend" and first.action in ("bend", "squat") and (same_direction or second.joined != "then"):
        return merged(first, second, ignored)
    turning = second.action == "turn" and second.gerund and loose and first.action in ("dance", "jump", "walk", "run")
    if turning and not {"count", "angle_deg"} & second.said.keys() and second.get("direction") != "back":
        circling = {slot: value for slot, value in second.slots().items() if slot != "angle_deg"}
        return merged(first, ParseStep(first.action, {}, {"direction": "circle", **circling}), ignored)
    if first.action != second.action:
        return None
    typed = first.get("type") is not None or second.get("type") is not None
    again = second.joined == "," and first.words == second.words  # jumps, jumps
    once = first.action in ("fall", "sit")  # who has fallen or sat down is to stand up first
    one = (loose and not again) or (typed and same_direction) or once or first.action == "stand"
    lost = [second.words] * (once and (second.repeats or second.words in first.words))
    together = merged(first, second, lost) if one else None
    ignored += lost if together is not None else []
    return together


def _description(steps: list[ParseStep], reader: Reader, sentence: str) -> tuple[Description, list[tuple[str, str]]]:
    read_as: list[tuple[str, str]] = []
    _check_any(steps, reader)
    for step in steps:
        count = step.get("count")
        if "jumping jack" in step.words and isinstance(count, int):  # out and in again
            step.said["count"] = 2 * count
            step.given.pop("count", None)
            read_as.append((f"{count} jumping jacks", f"{2 * count} jumps out and in"))
    if len(steps) > slots.MOST_STEPS:
        raise InputError(f"a description has at most {slots.MOST_STEPS} steps, got {len(steps)}; leave some out")
    turned = False
    for step in steps:
        if turned and step.action in MOVING and step.returns and step.get("direction") == "back":
            step.said["direction"] = "forward"  # turns around and walks back
        turned = turned or (step.action == "turn" and step.get("direction") == "back")
        if step.get("direction") == "circle":
            step.said["direction"] = "counterclockwise"
            read_as.append(("in a circle", "in a counterclockwise circle"))
    ranks = [_rank(step) for step in steps]
    place = ranks.index(max(ranks))
    fields = [_step_fields(step, reader.ignored) for step in steps]
    main = fields[place]
    description = Description(
        activity=_activity(main),
        subject=reader.subject or "person",
        before=tuple(Step(**values) for values in fields[:place]),
        after=tuple(Step(**values) for values in fields[place + 1 :]),
        sentence=sentence,
        **main,
    )
    return description, read_as


def _rank(step: ParseStep) -> int:
    disturbed = step.action == "walk" and step.get("type") in slots.GAIT_TYPES
    return RANK.get(DISTURBED if disturbed else step.action, -1)


def _check_any(steps: list[ParseStep], reader: Reader) -> None:
    denied, ignored = (", ".join(words[:6]) for words in (reader.denied_actions, reader.ignored))
    if not steps and denied:
        raise InputError(
            f"the sentence tells only what does not happen, or nearly ({denied}); describe what does: {UNDERSTOOD}"
        )
    if not steps:
        wrong = f"no activity was understood in the sentence (not understood: {ignored})"
        raise InputError(f"{wrong if ignored else 'the sentence tells no activity'}; describe {UNDERSTOOD}")
    if all(step.action == "stand" for step in steps):
        raise InputError(f"the sentence tells of standing only, which is none of the classes; describe {UNDERSTOOD}")


def _step_fields(step: ParseStep, ignored: list[str]) -> dict[str, object]:
    """Fields of a step; what the action cannot have is reported, and a fall that goes up is refused."""
    fields: dict[str, object] = {"action": step.action, **step.slots()}
    allowed = slots.DIRECTIONS_OF[step.action]  # type: ignore[index]
    direction = fields.get("direction")
    if direction is not None and direction not in allowed:
        if step.action == "fall":
            raise InputError(f"the sentence is contradictory: nobody falls {direction}; falls go {', '.join(allowed)}")
        ignored.append(str(fields.pop("direction")))
    if fields.get("type") in slots.GAIT_TYPES and step.action != "walk":
        fields.pop("type")
        ignored.append(step.cause or step.words)
    count, duration = fields.get("count"), fields.get("duration_s")
    if count is not None and not (isinstance(count, int) and 1 <= count <= slots.MOST_TIMES):
        given = step.given.get("count", count)
        raise InputError(f"an action is done 1 to {slots.MOST_TIMES} times, got {given}; write a whole number of times")
    if isinstance(duration, float) and not 0 < duration <= slots.LONGEST_S:
        mend = "a shorter" if duration > 0 else "a longer"
        given = step.given.get("duration_s", f"{duration:g} s")
        raise InputError(f"an action lasts more than 0 and up to {slots.LONGEST_S:g} s, got {given}; write {mend} time")
    return fields


def _activity(main: dict[str, object]) -> Activity:
    if main.get("type") in slots.GAIT_TYPES:
        return "abnormal_walking"
    return next(activity for activity, actions in slots.ACTIONS_OF.items() if main["action"] in actions)
