"""Descriptions written by a weighted grammar, without network: sentences of many structures, with their slots.

What the grammar chooses from and in which words stands in grammar.yaml and lexicon.yaml. Choices are drawn as cards are dealt, so
that a few dozen sentences of a class hold all of its properties.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator

from t2d_rt.core.checks import choice, integer
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions import slots
from t2d_rt.motion.descriptions.diversity import NEAREST, Gathered
from t2d_rt.motion.descriptions.lexicon import (
    Phrases,
    Synonyms,
    inflected,
    lexicon,
    meaning,
    of_text,
    packaged,
    with_article,
)
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity, Description, Step
from t2d_rt.types.fields import Fields

MOST_DESCRIPTIONS = 10_000
MOST_REFUSED = 3_000
"""Sentences in a row that are too like earlier ones before the grammar gives up."""

NUMBER_WORDS = "no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"

# --- what the grammar chooses from ---


@cache
def weighted(choices: str, separator: str = "|") -> tuple[str, ...]:
    """Choices, each as often as its weight says: "a*2 | b" is a, a, b; "-" is nothing, an empty text.

    >>> weighted("up*2 down -", " ")
    ('up', 'up', 'down', '')
    """
    words = []
    for entry in choices.split(separator):
        word, _, weight = entry.partition("*")
        word = word.strip()
        words += ["" if word == "-" else word] * int(weight or 1)
    return tuple(words)


Choices = Annotated[tuple[str, ...], BeforeValidator(of_text(weighted, " "))]
"""Words with their weights, divided by spaces."""
WeightedPhrases = Annotated[tuple[str, ...], BeforeValidator(of_text(weighted, "|"))]
"""Phrases with their weights, divided by bars."""
NOTHING = ("",)


class Plan(Fields):
    """One way to do an activity, and how often it is chosen."""

    noun: ClassVar[str] = "plan of the grammar"

    action: slots.Action
    type: slots.FallType | slots.GaitType | None = None
    weight: int = 1
    manner: Choices = weighted("careful happy angry sad -*5", " ")
    speed: Choices = weighted("slow*2 fast*2 -*4", " ")
    direction: Choices = NOTHING
    object: Choices = NOTHING
    body_part: Choices = NOTHING
    side: Choices = weighted("left right -", " ")
    """Side of the part of the body, where a phrase tells it."""
    count: Choices = NOTHING
    duration_s: Choices = NOTHING
    angle_deg: Choices = NOTHING
    before: WeightedPhrases = NOTHING
    """Steps that may lead to it, such as "walk speed=slow"."""
    after: WeightedPhrases = NOTHING


class Grammar(Fields):
    """All that the grammar chooses from; grammar.yaml says what each section holds."""

    noun: ClassVar[str] = "grammar"

    subjects: Choices
    frames: dict[Literal[1, 2, 3], WeightedPhrases]
    walking_falls: WeightedPhrases
    plans: dict[Activity, tuple[Plan, ...]]
    not_together: dict[str, Choices]
    directions: dict[slots.Action, dict[slots.Direction, WeightedPhrases]]
    objects: dict[slots.Action, dict[slots.Object, WeightedPhrases]]
    objects_of_types: dict[slots.FallType, dict[slots.Object, WeightedPhrases]]
    objects_of_directions: dict[slots.Action, dict[str, WeightedPhrases]]
    body_parts: dict[slots.Action, dict[slots.BodyPart, Phrases]]
    body_parts_of_types: dict[slots.GaitType, dict[slots.BodyPart, Phrases]]
    stretched: dict[slots.BodyPart, Phrases]
    on_stairs: WeightedPhrases


@cache
def rules() -> Grammar:
    """The grammar that ships with the package."""
    return Grammar.model_validate(packaged("grammar"))


class WeightedSampler:
    """Deals from shuffled decks of choices, one deck for each set of them."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._decks: dict[tuple[str, tuple[Any, ...]], list[int]] = {}

    def pick(self, choices: str | tuple[Any, ...], name: str = "") -> Any:
        """The next of some choices; those of a text are divided by bars. Each `name` has a deck of its own."""
        cards = weighted(choices) if isinstance(choices, str) else choices
        if len(cards) == 1:
            return cards[0]
        deck = self._decks.setdefault((name, cards), [])
        if not deck:
            deck.extend(int(card) for card in self._rng.permutation(len(cards)))
        return cards[deck.pop()]

    def word(self, choices: str, name: str = "") -> str | None:
        """The next of some words with weights, divided by spaces; None for nothing."""
        return self.pick(weighted(choices, " "), name) or None


# --- what a description says ---


def grammar_descriptions(activity: Activity, count: int, *, seed: int = 0) -> list[Description]:
    """`count` different descriptions of a class; the same seed gives the same, and more of them begin with fewer.

    activity: one of the eight classes.
    count: how many descriptions, at most 10 000.
    seed: seed of all choices.
    """
    choice("activity", activity, ACTIVITIES)
    count = integer("count", count, 1, MOST_DESCRIPTIONS)
    sampler = sampler_of(activity, seed)
    gathered = Gathered()
    refused = 0
    while len(gathered) < count:
        if gathered.add(_described(activity, sampler)):
            refused = 0
            continue
        refused += 1
        if refused == MOST_REFUSED:
            raise InputError(
                f"the grammar found {len(gathered)} descriptions of {activity} that are less than {NEAREST:.0%} "
                f"alike, not {count}; ask for fewer"
            )
    return gathered.descriptions


def sampler_of(activity: Activity, seed: int) -> WeightedSampler:
    """A sampler of a class: other classes do not depend on what it deals."""
    return WeightedSampler(np.random.default_rng([integer("seed", seed), ACTIVITIES.index(activity)]))


class Drawn(NamedTuple):
    """What a description is to say, before it is put into words."""

    main: Step
    before: tuple[Step, ...]
    after: tuple[Step, ...]
    subject: slots.Subject


def draw_properties(activity: Activity, sampler: WeightedSampler) -> Drawn:
    """Properties of one description of a class."""
    plan: Plan = sampler.pick(tuple(option for option in rules().plans[activity] for _ in range(option.weight)), "plan")
    name = f"{plan.action} {plan.type}"
    main = _main(plan, sampler, name)
    before = _steps(plan.before, sampler, f"before {name}")
    after = _steps(plan.after, sampler, f"after {name}")
    if any(other.object == main.object for other in (*before, *after)):
        main = main.model_copy(update={"object": None})
    return Drawn(main, before, after, sampler.pick(rules().subjects, "subject"))


def _described(activity: Activity, sampler: WeightedSampler) -> Description:
    main, before, after, subject = draw_properties(activity, sampler)
    sentence = _sentence((*before, main, *after), len(before), subject, sampler)
    return Description(
        activity=activity, subject=subject, before=before, after=after, sentence=sentence, **main.model_dump()
    )


def _main(plan: Plan, sampler: WeightedSampler, name: str) -> Step:
    said: dict[str, object] = {"action": plan.action, "type": plan.type}
    for slot in ("direction", "object", "body_part", "manner", "speed", "count", "duration_s", "angle_deg"):
        value = sampler.pick(getattr(plan, slot), f"{name} {slot}")
        clashing = {word for pair in said.items() for word in rules().not_together.get("=".join(map(str, pair)), ())}
        if value and f"{slot}={value}" not in clashing:
            said[slot] = {"count": int, "duration_s": float, "angle_deg": float}.get(slot, str)(value)
    if {"count", "body_part", "object"} <= said.keys():
        del said["count"]
    phrases = " ".join(_limb_phrases(plan.action, plan.type, said.get("body_part")))
    if "{side}" in phrases or (plan.action == "stretch" and said.get("body_part") in ("arm", "leg", "foot")):
        side = sampler.pick(plan.side, f"{name} side")
        if side:
            said["side"] = side
    return Step(**said)


def _limb_phrases(action: slots.Action, kind: str | None, part: object) -> tuple[str, ...]:
    """What a part of the body does in an action, or in a disturbed gait."""
    of_type: Mapping[Any, tuple[str, ...]] = rules().body_parts_of_types.get(kind, {})  # type: ignore[call-overload]
    of_action: Mapping[Any, tuple[str, ...]] = rules().body_parts.get(action, {})
    return of_type.get(part) or of_action.get(part, ())


def _steps(choices: tuple[str, ...], sampler: WeightedSampler, name: str) -> tuple[Step, ...]:
    """The step that a text such as "walk speed=slow" tells; none, where it is empty."""
    drawn = sampler.pick(choices, name)
    if not drawn:
        return ()
    action, said = meaning(drawn)
    return (Step.model_validate({"action": action, **said}),)


# --- sentences ---


def _sentence(steps: tuple[Step, ...], main: int, subject: slots.Subject, sampler: WeightedSampler) -> str:
    noun = sampler.pick(lexicon().subjects[subject].said, f"noun of {subject}")
    of_person = steps[main].action == "fall" and steps[main].manner is not None  # a sad man falls; nobody falls sadly
    noun = "person" if of_person and noun == "someone" else noun
    his = next((his for his, nouns in lexicon().possessives.items() if noun.split()[-1] in nouns), "their")
    frames = rules().frames[len(steps)]  # type: ignore[index]
    if len(steps) == 2 and steps[1].action == "fall" and steps[0].action in ("walk", "run"):
        frames = (*frames, *rules().walking_falls)
    letters = "ABC"[: len(steps)]
    if of_person:
        frames = tuple(candidate for candidate in frames if _first(candidate, letters) == letters[main])
    frame = sampler.pick(frames, f"frame {len(steps)}")
    described = _first(frame, letters) if noun != "someone" else ""
    texts = {
        letter: clause(step, sampler, his, adjectives=letter == described)
        for letter, step in zip(letters, steps, strict=True)
    }
    return _written(frame, texts, noun, his, sampler)


def _first(frame: str, letters: str) -> str:
    """The step that follows the subject in a frame."""
    subject = frame.lower().index("{s}")
    return min(letters, key=lambda letter: (frame.index("{" + letter) < subject, frame.index("{" + letter)))


def _written(frame: str, texts: dict[str, Clause], noun: str, his: str, sampler: WeightedSampler) -> str:
    adjective = " ".join(step_clause.adjective for step_clause in texts.values() if step_clause.adjective)
    subject = "someone" if noun == "someone" else with_article(f"{adjective} {noun}".strip())
    finite = sampler.word("present*4 preterite", "tense")
    text = frame.replace(":finite}", f":{finite}}}").replace("{S}", subject).replace("{s}", subject)
    text = text.replace("{he}", {"his": "he", "her": "she"}.get(his, "the person"))
    for one, two in (("A", "B"), ("B", "C")):
        if two in texts and (texts[one].double or texts[two].double):  # trips and falls, then rises
            text = text.replace(f" and {{{two}:", f", then {{{two}:")
    for letter, step_clause in texts.items():
        for form in ("present", "preterite", "gerund", "participle", "base"):
            before, placeholder, after = text.partition(f"{{{letter}:{form}}}")
            if placeholder:
                text = before + step_clause.form(form, after[0]) + after
    return text[0].upper() + text[1:]


# --- a step in English: a verb in any of its forms, with adverbs, directions, objects and parts of the body ---


@dataclass(frozen=True, slots=True)
class Clause:
    """What somebody does, without who it is."""

    verb: str
    """Infinitives and what belongs to them: "slip and fall"."""
    before: str = ""
    after: str = ""
    limb: str = ""
    """What a part of the body does meanwhile."""
    adjective: str = ""
    """Adjective of who does it."""

    @property
    def double(self) -> bool:
        """Whether it holds an "and" itself."""
        return " and " in self.verb

    def form(self, name: str, following: str) -> str:
        """The clause with its verbs in a form (present, preterite, gerund, participle, base), and a comma before `following`."""
        verb = " and ".join(inflected(word, name) for word in self.verb.split(" and "))
        text = " ".join(part for part in (self.before, verb, self.after) if part)
        if any(word.endswith("ing") for word in self.limb.split(" ")[:2]):
            return f"{text}, {self.limb}{'' if following in ',.;' else ','}"
        return f"{text} {self.limb}".strip()


@cache
def _verbs(name: str) -> tuple[str, ...]:
    """Verbs that tell an action and a slot: "walk speed=slow"; the plainest one, which stands first, twice."""
    verbs = lexicon().verbs[name].said if name in lexicon().verbs else ()
    return (*verbs[:1], *verbs)


def clause(step: Step, sampler: WeightedSampler, his: str, *, adjectives: bool = False) -> Clause:
    """A step as a clause; its manner or speed may be said by an adjective of who does it."""
    telling = _telling(step)
    if telling is not None:
        step = step.model_copy(update={slot: None for slot in meaning(telling)[1]})
    left = {slot: getattr(step, slot) for slot in ("manner", "speed") if getattr(step, slot) not in (None, "normal")}
    verb, said_type = _verb(step, sampler, left) if telling is None else (sampler.pick(_verbs(telling)), "")
    object_first = step.action == "stretch" and step.body_part is not None
    if object_first and step.body_part is not None:
        verb = f"stretch {sampler.pick(_sided(rules().stretched[step.body_part], step.side))}"
    said = _modifiers(step, left, sampler, adjectives=adjectives)
    places = [*_direction(step, sampler), *_object(step, sampler)]
    if len(places) == 2 and places[0] == "back":
        places[0] = "backward"  # "back to a chair" is a return
    parts = [said["middle"], *places, said["end"], said["phrase"], said_type, *_measures(step)]
    limb = ""
    if step.body_part is not None and not object_first:
        limb = sampler.pick(_sided(_limb_phrases(step.action, step.type, step.body_part), step.side))
    verb, after, limb = (_filled(phrase, step, his) for phrase in (verb, " ".join(parts), limb))
    return Clause(verb, said["before"], after, limb, said["adjective"])


def _modifiers(step: Step, left: Mapping[str, str], sampler: WeightedSampler, *, adjectives: bool) -> dict[str, str]:
    """Manner and speed in words, by where they stand; no two adverbs follow one another."""
    said = dict.fromkeys(("before", "middle", "end", "phrase", "adjective"), "")
    for slot, value in left.items():
        positions = "before middle*2 end phrase" if not (said["middle"] or said["end"]) else "before phrase"
        if adjectives and not said["adjective"]:
            positions += " adjective*2"
        position = str(sampler.word(positions, f"way of {slot}"))
        if step.action == "fall":  # nobody falls happily, or in no hurry
            position = "adjective" if slot == "manner" else str(sampler.word("middle end", "way of fall"))
        if said[position]:
            position = "phrase" if not said["phrase"] else "before"
        modifier = lexicon().modifiers[f"{slot}={value}"]
        words = {"phrase": modifier.phrases, "adjective": modifier.adjectives}.get(position, modifier.adverbs)
        if position == "before" or (step.action == "fall" and slot == "speed"):
            words = modifier.before_verb or modifier.adverbs
        said[position] = sampler.pick(words)
    return said


def _verb(step: Step, sampler: WeightedSampler, left: dict[str, str]) -> tuple[str, str]:
    """A verb, and what tells the type of fall or gait where the verb does not; what the verb tells leaves `left`."""
    if step.action == "climb":
        return sampler.pick(rules().on_stairs), ""
    if step.type is not None:
        typed = _verbs(f"{step.action} type={step.type}")
        synonyms: Mapping[Any, Synonyms] = lexicon().fall_causes if step.action == "fall" else lexicon().gaits
        phrases = synonyms[step.type].said
        if step.action == "fall" and step.object not in (None, "floor"):
            phrases = ()
        by_verb = bool(typed) and (not phrases or sampler.word("yes yes no", f"typed {step.type}") == "yes")
        if by_verb:
            return sampler.pick(typed), ""
        return sampler.pick(_verbs(step.action)), sampler.pick(phrases)
    for slot, value in left.items():
        implying = _verbs(f"{step.action} {slot}={value}")
        if implying and sampler.word("yes no no", f"implied {slot}") == "yes":
            del left[slot]
            return sampler.pick(implying), ""
    return sampler.pick(_verbs(step.action)), ""


def _telling(step: Step) -> str | None:
    """The entry of the lexicon whose verbs tell several slots of a step at once: who lowers himself to the floor, or stands on the
    left leg."""
    entries = ((name, *meaning(name)) for name, words in lexicon().verbs.items() if words.said)
    several = ((name, said) for name, action, said in entries if action == step.action and len(said) > 1)
    return next((name for name, said in several if all(getattr(step, key) == said[key] for key in said)), None)


def _direction(step: Step, sampler: WeightedSampler) -> list[str]:
    if step.direction is None or step.action == "climb":
        return []
    if step.action == "turn" and step.direction == "back":
        return ["around"]
    angle = "" if step.angle_deg is None else f" by {step.angle_deg:g} degrees"
    return [sampler.pick(rules().directions[step.action][step.direction]) + angle]


def _object(step: Step, sampler: WeightedSampler) -> list[str]:
    if step.object is None or (step.action, step.object) == ("climb", "stair"):
        return []
    of_type: Mapping[Any, tuple[str, ...]] = rules().objects_of_types.get(step.type, {})  # type: ignore[arg-type]
    directed = rules().objects_of_directions.get(step.action, {}).get(f"{step.object} {step.direction}")
    return [sampler.pick(of_type.get(step.object) or directed or rules().objects[step.action][step.object])]


def _measures(step: Step) -> list[str]:
    measures = []
    if step.count is not None:
        measures.append("twice" if step.count == 2 else f"{NUMBER_WORDS[step.count]} times")
    if step.duration_s is not None:
        measures.append(f"for {NUMBER_WORDS[int(step.duration_s)]} seconds")
    return measures


def _sided(phrases: tuple[str, ...], side: str | None) -> tuple[str, ...]:
    """The phrases that tell a side, where the step does; else those that need not."""
    unsided = tuple(phrase for phrase in phrases if "{side}" not in phrase)
    return tuple(phrase for phrase in phrases if "{side}" in phrase) if side is not None else unsided or phrases


def _filled(text: str, step: Step, his: str) -> str:
    filled = text.replace("{his}", his).replace("{way}", step.direction or "up").replace("{side}", step.side or "")
    filled = filled.replace("{self}", {"his": "himself", "her": "herself"}.get(his, "themself"))
    return re.sub(r"\s+", " ", filled).strip()
