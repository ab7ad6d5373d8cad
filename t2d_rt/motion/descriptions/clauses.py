"""A step in English: a verb in any of its forms, with adverbs, directions, objects and parts of the body."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from t2d_rt.motion.descriptions import complements, lexicon, nouns
from t2d_rt.motion.descriptions.deal import Dealer
from t2d_rt.motion.descriptions.inflect import forms
from t2d_rt.motion.descriptions.items import meanings
from t2d_rt.motion.descriptions.slots import Step

NUMBER_WORDS = "no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"


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
    """Of who does it."""

    @property
    def double(self) -> bool:
        """Whether it holds an "and" itself."""
        return " and " in self.verb

    def form(self, name: str, following: str) -> str:
        """The clause with its verbs in a form (present, preterite, gerund, participle, base), and a comma before `following`."""
        first, *others = self.verb.split(" and ")
        verb = " and ".join(_inflected(each, name) for each in (first, *others))
        text = " ".join(each for each in (self.before, verb, self.after) if each)
        if any(word.endswith("ing") for word in self.limb.split(" ")[:2]):
            return f"{text}, {self.limb}{'' if following in ',.;' else ','}"
        return f"{text} {self.limb}".strip()


def _inflected(phrase: str, name: str) -> str:
    head, _, rest = phrase.partition(" ")
    return f"{getattr(forms(head), name)} {rest}".strip()


@cache
def _verbs(action: str, slots: tuple[tuple[str, str], ...]) -> tuple[str, ...]:
    found = tuple(
        phrase
        for head, implied, phrase in meanings(lexicon.VERBS)
        if head == action and tuple(implied.items()) == slots
    )
    return (*found[:1], *found)  # the plainest one comes first


@cache
def _words(section: str, slot: str, value: str) -> str:
    table: Mapping[str, str] = getattr(lexicon, section)
    return table[f"{slot}={value}"]


def clause(step: Step, dealer: Dealer, his: str, *, adjectives: bool = False) -> Clause:
    """A step as a clause; its manner or speed may be said by an adjective of who does it."""
    left = {slot: getattr(step, slot) for slot in ("manner", "speed") if getattr(step, slot) not in (None, "normal")}
    verb, said_type = _verb(step, dealer, left)
    object_first = step.action == "stretch" and step.body_part is not None
    if object_first:
        verb = f"stretch {dealer.pick(_sided(complements.STRETCHED[step.body_part or ''], step.side))}"
    said = _modifiers(step, left, dealer, adjectives=adjectives)
    places = [*_direction(step, dealer), *_object(step, dealer)]
    if len(places) == 2 and places[0] == "back":
        places[0] = "backward"  # "back to a chair" is a return
    parts = [said["middle"], *places, said["end"], said["phrase"], said_type, *_measures(step)]
    limb = ""
    if step.body_part is not None and not object_first:
        table = (
            complements.BODY_OF_TYPE if (step.type, step.body_part) in complements.BODY_OF_TYPE else complements.BODY
        )
        key = (step.type if table is complements.BODY_OF_TYPE else step.action, step.body_part)
        limb = dealer.pick(_sided(table[key], step.side))  # type: ignore[index]
    verb, after, limb = (_filled(each, step, his) for each in (verb, " ".join(parts), limb))
    return Clause(verb, said["before"], after, limb, said["adjective"])


def _modifiers(step: Step, left: Mapping[str, str], dealer: Dealer, *, adjectives: bool) -> dict[str, str]:
    """Manner and speed in words, by where they stand; no two adverbs follow one another."""
    said = dict.fromkeys(("before", "middle", "end", "phrase", "adjective"), "")
    for slot, value in left.items():
        positions = "before middle*2 end phrase" if not (said["middle"] or said["end"]) else "before phrase"
        if adjectives and not said["adjective"]:
            positions += " adjective*2"
        position = str(dealer.word(positions, f"way of {slot}"))
        if step.action == "fall":  # nobody falls happily, or in no hurry
            position = "adjective" if slot == "manner" else str(dealer.word("middle end", "way of fall"))
        if said[position]:
            position = "phrase" if not said["phrase"] else "before"
        section = {"phrase": "PHRASES", "adjective": "ADJECTIVES"}.get(position, "ADVERBS")
        words = _words(section, slot, value)
        if position == "before" or (step.action == "fall" and slot == "speed"):
            words = {"fast": "quickly | rapidly", "slow": "slowly"}.get(value, words)
        said[position] = dealer.pick(words)
    return said


def _verb(step: Step, dealer: Dealer, left: dict[str, str]) -> tuple[str, str]:
    """A verb, and what tells the type of fall or gait where the verb does not; what the verb tells leaves `left`."""
    if step.action == "climb":
        return dealer.pick(complements.ON_STAIRS), ""
    if step.type is not None:
        typed = _verbs(step.action, (("type", step.type),))
        table = nouns.FALLS if step.action == "fall" else nouns.GAITS
        phrases = tuple(each.strip() for each in table[step.type].split("|"))[: 5 if step.action == "fall" else None]
        if step.action == "fall" and step.object not in (None, "floor"):
            phrases = ()
        by_verb = bool(typed) and (not phrases or dealer.word("yes yes no", f"typed {step.type}") == "yes")
        if by_verb:
            return dealer.pick(typed), ""
        return dealer.pick(_verbs(step.action, ())), dealer.pick(phrases)
    for slot, value in left.items():
        implying = _verbs(step.action, ((slot, value),))
        if implying and dealer.word("yes no no", f"implied {slot}") == "yes":
            del left[slot]
            return dealer.pick(implying), ""
    return dealer.pick(_verbs(step.action, ())), ""


def _direction(step: Step, dealer: Dealer) -> list[str]:
    if step.direction is None or step.action == "climb":
        return []
    if step.action == "turn" and step.direction == "back":
        return ["around"]
    return [dealer.pick(complements.DIRECTION[step.action][step.direction])]


def _object(step: Step, dealer: Dealer) -> list[str]:
    if step.object is None or (step.action, step.object) == ("climb", "stair"):
        return []
    typed = complements.OBJECT_OF_TYPE.get((step.type or "", step.object))
    directed = complements.OBJECT_OF_DIRECTION.get((step.action, step.object, step.direction or ""))
    return [dealer.pick(typed or directed or complements.OBJECT[step.action, step.object])]


def _measures(step: Step) -> list[str]:
    found = []
    if step.count is not None:
        found.append("twice" if step.count == 2 else f"{NUMBER_WORDS[step.count]} times")
    if step.duration_s is not None:
        found.append(f"for {NUMBER_WORDS[int(step.duration_s)]} seconds")
    return found


def _sided(phrases: str, side: str | None) -> tuple[str, ...]:
    """The phrases that tell a side, where the step does; else those that need not."""
    found = tuple(each.strip() for each in phrases.split("|"))
    plain = tuple(each for each in found if "{side}" not in each)
    return tuple(each for each in found if "{side}" in each) if side is not None else plain or found


def _filled(text: str, step: Step, his: str) -> str:
    filled = text.replace("{his}", his).replace("{way}", step.direction or "up").replace("{side}", step.side or "")
    return re.sub(r"\s+", " ", filled).strip()
