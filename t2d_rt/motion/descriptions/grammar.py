"""Descriptions written by a weighted grammar, without network: sentences of many structures, with their slots.

What is written and how is dealt like cards, so that a few dozen sentences of a class hold all of its properties.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from t2d_rt.core.checks import choice, integer
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.clauses import Clause, clause
from t2d_rt.motion.descriptions.complements import BODY, BODY_OF_TYPE
from t2d_rt.motion.descriptions.deal import Dealer, weighted
from t2d_rt.motion.descriptions.diversity import NEAREST, Gathered
from t2d_rt.motion.descriptions.inflect import with_article
from t2d_rt.motion.descriptions.nouns import HIS, SUBJECTS
from t2d_rt.motion.descriptions.plans import NOT_TOGETHER, PLANS, Plan
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity, Description, Step

MOST_DESCRIPTIONS = 10_000
MOST_REFUSED = 3_000
"""Sentences in a row that are too like earlier ones before the grammar gives up."""

SUBJECT_DECK = "person*6 man*3 woman*3 child*2 old_person*2 heavy_person"

FRAMES = {
    1: "{S} {A:finite}.*5 | {S} is {A:gerund}.*2 | there is {s} who {A:present}. | {S} can be seen {A:gerund}. | "
    "{S} begins to {A:base}. | {S} starts {A:gerund}.",
    2: "{S} {A:finite} and {B:finite}.*3 | {S} {A:finite}, then {B:finite}.*2 | {S} {A:finite} and then {B:finite}.*2 | "
    "{S} {A:finite} before {B:gerund}. | after {A:gerund}, {s} {B:finite}.*2 | {S} {B:finite} after {A:gerund}. | "
    "{S} {A:present}; afterwards, {he} {B:present}. | before {B:gerund}, {s} {A:finite}. | "
    "having {A:participle}, {s} {B:finite}. | "
    "{S} is {A:gerund} and then {B:present}. | there is {s} who {A:present} and then {B:present}.",
    3: "{S} {A:finite}, {B:finite} and {C:finite}.*2 | {S} {A:finite}, then {B:finite} and finally {C:finite}.*2 | "
    "after {A:gerund}, {s} {B:finite} and then {C:finite}. | "
    "{S} {A:finite}, {B:finite} and, after a moment, {C:finite}. | "
    "{S} {A:finite} and {B:finite} before {C:gerund}. | having {A:participle}, {s} {B:finite}, then {C:finite}.",
}
"""Sentences of one, two and three steps: A, B and C in the form that stands behind the colon."""

WALKING_FALL = (
    "while {A:gerund}, {s} {B:finite}.*2 | {S} {B:finite} while {A:gerund}. | {S} is {A:gerund} when {he} {B:present}."
)
"""More of two steps, for falls out of a movement."""


def grammar_descriptions(activity: Activity, count: int, *, seed: int = 0) -> list[Description]:
    """`count` different descriptions of a class; the same seed gives the same, and more of them begin with fewer.

    activity: one of the eight classes.
    count: how many descriptions, at most 10 000.
    seed: seed of all choices.
    """
    choice("activity", activity, ACTIVITIES)
    count = integer("count", count, 1, MOST_DESCRIPTIONS)
    dealer = dealer_of(activity, seed)
    gathered = Gathered()
    refused = 0
    while len(gathered) < count:
        if gathered.add(_described(activity, dealer)):
            refused = 0
            continue
        refused += 1
        if refused == MOST_REFUSED:
            raise InputError(
                f"the grammar found {len(gathered)} descriptions of {activity} that are less than {NEAREST:.0%} "
                f"alike, not {count}; ask for fewer"
            )
    return gathered.descriptions


def dealer_of(activity: Activity, seed: int) -> Dealer:
    """A dealer of a class: other classes do not depend on what it deals."""
    return Dealer(np.random.default_rng([integer("seed", seed), ACTIVITIES.index(activity)]))


class Drawn(NamedTuple):
    """What a description is to say, before it is put into words."""

    main: Step
    before: tuple[Step, ...]
    after: tuple[Step, ...]
    subject: str


def drawn(activity: Activity, dealer: Dealer) -> Drawn:
    """Properties of one description of a class."""
    plan: Plan = dealer.pick(tuple(each for each in PLANS[activity] for _ in range(each.weight)), "plan")
    name = f"{plan.action} {plan.type}"
    main = _main(plan, dealer, name)
    before = _steps(plan.before, dealer, f"before {name}")
    after = _steps(plan.after, dealer, f"after {name}")
    if any(each.object == main.object for each in (*before, *after)):
        main = main.model_copy(update={"object": None})
    return Drawn(main, before, after, str(dealer.word(SUBJECT_DECK, "subject")))


def _described(activity: Activity, dealer: Dealer) -> Description:
    main, before, after, subject = drawn(activity, dealer)
    sentence = _sentence((*before, main, *after), len(before), subject, dealer)
    return Description(
        activity=activity, subject=subject, before=before, after=after, sentence=sentence, **main.model_dump()
    )


def _main(plan: Plan, dealer: Dealer, name: str) -> Step:
    slots: dict[str, object] = {"action": plan.action, "type": plan.type}
    for slot in ("direction", "object", "body_part", "manner", "speed", "count", "duration_s"):
        value = dealer.word(getattr(plan, slot), f"{name} {slot}")
        clash = any((slot, value) in NOT_TOGETHER.get((other, str(given)), ()) for other, given in slots.items())
        if value is not None and not clash:
            slots[slot] = int(value) if slot == "count" else float(value) if slot == "duration_s" else value
    if slots.get("count") is not None and slots.get("body_part") is not None and slots.get("object") is not None:
        del slots["count"]
    phrases = BODY_OF_TYPE.get((plan.type or "", str(slots.get("body_part")))) or BODY.get(
        (plan.action, str(slots.get("body_part"))), ""
    )
    if "{side}" in phrases or (plan.action == "stretch" and slots.get("body_part") in ("arm", "leg", "foot")):
        side = dealer.word("left right -", f"{name} side")
        if side is not None:
            slots["side"] = side
    return Step(**slots)


def _steps(choices: str, dealer: Dealer, name: str) -> tuple[Step, ...]:
    """The step that a text such as "walk speed=slow" tells; none, where it is empty."""
    drawn = dealer.pick(weighted(choices), name)
    if not drawn:
        return ()
    action, *slots = drawn.split()
    return (Step(action=action, **dict(each.split("=") for each in slots)),)


def _sentence(steps: tuple[Step, ...], main: int, subject: str, dealer: Dealer) -> str:
    noun = dealer.pick(SUBJECTS[subject], "noun of " + subject)
    of_person = steps[main].action == "fall" and steps[main].manner is not None  # a sad man falls; nobody falls sadly
    noun = "person" if of_person and noun == "someone" else noun
    his = HIS.get(noun, "their")
    frames = weighted(FRAMES[len(steps)])
    if len(steps) == 2 and steps[1].action == "fall" and steps[0].action in ("walk", "run"):
        frames = (*frames, *weighted(WALKING_FALL))
    letters = "ABC"[: len(steps)]
    if of_person:
        frames = tuple(each for each in frames if _first(each, letters) == letters[main])
    frame = dealer.pick(frames, f"frame {len(steps)}")
    first = _first(frame, letters)
    texts: dict[str, Clause] = {}
    for letter, step in zip("ABC", steps, strict=False):
        texts[letter] = clause(step, dealer, his, adjectives=noun != "someone" and letter == first)
    return _written(frame, texts, noun, his, dealer)


def _first(frame: str, letters: str) -> str:
    """The step that follows the subject in a frame."""
    subject = frame.lower().index("{s}")
    return min(letters, key=lambda each: (frame.index("{" + each) < subject, frame.index("{" + each)))


def _written(frame: str, texts: dict[str, Clause], noun: str, his: str, dealer: Dealer) -> str:
    adjective = " ".join(each.adjective for each in texts.values() if each.adjective)
    subject = "someone" if noun == "someone" else with_article(f"{adjective} {noun}".strip())
    finite = dealer.word("present*4 preterite", "tense")
    text = frame.replace(":finite}", f":{finite}}}").replace("{S}", subject).replace("{s}", subject)
    text = text.replace("{he}", {"his": "he", "her": "she"}.get(his, "the person"))
    for one, two in (("A", "B"), ("B", "C")):
        if two in texts and (texts[one].double or texts[two].double):  # trips and falls, then rises
            text = text.replace(f" and {{{two}:", f", then {{{two}:")
    for letter, each in texts.items():
        for form in ("present", "preterite", "gerund", "participle", "base"):
            before, placeholder, after = text.partition(f"{{{letter}:{form}}}")
            if placeholder:
                text = before + each.form(form, after[0]) + after
    return text[0].upper() + text[1:]
