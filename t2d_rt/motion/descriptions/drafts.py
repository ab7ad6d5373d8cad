"""The steps of a sentence while it is read: which words belong to which action, and in which order the actions happen."""

from __future__ import annotations

from dataclasses import dataclass, field

from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.inflect import forms
from t2d_rt.motion.descriptions.items import Item

YIELDING = {"forward": ("left", "right", "straight"), "straight": ("left", "right")}
"""Directions that a more exact one replaces: forward and to the left is to the left."""
OPPOSITE = {
    frozenset(pair)
    for pair in (("forward", "back"), ("left", "right"), ("up", "down"), ("clockwise", "counterclockwise"),
                 ("straight", "clockwise"), ("straight", "counterclockwise"), ("straight", "back"))
}  # fmt: skip
OBJECTS_FIRST = "handrail", "ball", "chair", "stair", "floor"


PRONOUNS = "he", "she", "they", "i", "you", "we"

TWO_PEOPLE = {"man", "woman"}, {"man", "child"}, {"woman", "child"}, {"old_person", "child"}
"""Subjects that cannot be one person; others may be: an old man is a man."""

STOPPING = frozenset(form for verb in ("stop", "halt", "pause") for form in forms(verb))
"""Verbs before what is no longer done: stops walking."""


AUXILIARY = frozenset(form for verb in ("have", "let", "keep", "use", "set") for form in forms(verb))
"""Verbs of limbs that are also auxiliary to others."""

STOREYS = "upstairs", "downstairs"
"""Directions that lead over a stair."""


class Opposite(Exception):
    """Two directions of one step that cannot both be."""


@dataclass(slots=True)
class Draft:
    """An action, what is said of it, and what its verb implies."""

    action: str
    implied: dict[str, object] = field(default_factory=dict)
    said: dict[str, object] = field(default_factory=dict)
    weak: bool = False
    gerund: bool = False
    joined: str = ""
    """The join before it; none where it follows its neighbour at once."""
    words: str = ""
    returns: bool = False
    """Whether it goes "back", which behind a turn is forward again."""
    cause: str = ""
    """Words that tell the type of a fall or of a gait."""

    def get(self, slot: str) -> object:
        """What the sentence says of a slot, or else what the verb implies."""
        return self.said.get(slot, self.implied.get(slot))

    def slots(self) -> dict[str, object]:
        """All of them."""
        return {**self.implied, **self.said}


@dataclass(slots=True)
class Clause:
    """A part of a sentence between two joins."""

    join: str
    steps: list[Draft] = field(default_factory=list)
    pending: list[Item] = field(default_factory=list)


@dataclass(slots=True)
class Reader:
    """What has been read of a sentence so far."""

    clauses: list[Clause] = field(default_factory=lambda: [Clause("")])
    ignored: list[str] = field(default_factory=list)
    denied_actions: list[str] = field(default_factory=list)
    """Verbs of actions that do not happen."""
    recovers: bool = False
    """Whether a fall does not happen, or balance is regained."""
    subject: str = ""
    named: bool = False
    """Whether a noun tells the subject, which no other replaces."""
    dead: bool = False
    """Within something that is not understood, or does not happen."""
    denied: bool = False
    """The next action does not happen."""
    of_part: bool = False
    """Just behind a part of the body: arms up."""
    attending: bool = False
    """Within what a limb does."""
    limb: bool = False
    """Whether a part of the body has been named since the last action or join."""
    loose: list[str] = field(default_factory=list)
    """What limbs do and how they are, of which none has been named yet."""
    partly: list[str] = field(default_factory=list)
    """Words that say more than is made of them."""

    def read(self, item: Item) -> None:
        """Takes one more item."""
        limb = item.kind == "part" and item.slots["body_part"] != "waist"  # bends at the waist to the left
        self.of_part, before = limb or item.words == "together", self.of_part
        if item.kind == "direction":
            self.of_part = before
        named = item.kind == "part" or "body_part" in item.slots
        self.limb = self.limb or named
        if named or item.kind == "object":
            self.loose.clear()
        if item.kind in ("join", "action", "weak", "other"):
            self.settle_loose()
        if item.kind == "join":
            self._join(str(item.slots["join"]))
        elif item.kind == "subject":
            self._subject(str(item.slots["subject"]), item.words)
        elif item.kind == "not":
            self.denied = True
            self.ignored.append(item.words)
        elif item.kind in ("action", "weak"):
            self._action(item)
        elif item.kind == "other":
            self.dead, self.denied, self.attending = True, False, False
            self.ignored.append(item.words)
        elif item.kind in ("unknown", "reported", "recover"):
            self.recovers = self.recovers or item.kind == "recover"
            self.ignored.append(item.words)
        elif item.kind == "attend":
            if item.slots or self.denied:
                self._modifier(item)
            elif not self.limb and item.words not in AUXILIARY:
                self.loose.append(item.words)
            self.attending = True
        elif item.kind == "of limb":
            if not self.limb:
                self.loose.append(item.words)
        elif item.kind == "spot":
            self._spot(item.words)
        elif item.kind not in ("fixed", "neutral"):
            self._modifier(item)

    def settle_loose(self) -> None:
        """Reports what is said of limbs where none is named, before what begins another clause."""
        self.ignored += self.loose
        self.loose.clear()
        self.limb = False

    def _spot(self, words: str) -> None:
        """Who jumps on the spot jumps up; walking and running on the spot are not made."""
        steps = self.clauses[-1].steps
        if not steps or steps[-1].action in ("walk", "run", "climb") or self.dead:
            self.ignored.append(words)
        elif steps[-1].action == "jump" and steps[-1].get("direction") is None:
            steps[-1].said["direction"] = "up"

    def _subject(self, subject: str, words: str) -> None:
        named = words not in PRONOUNS
        if named and self.named and {subject, self.subject} in TWO_PEOPLE:
            if self._last() is not None and not self.clauses[-1].steps:
                raise InputError(
                    f"the sentence tells what several people do ({self.subject.replace('_', ' ')}, {words}); describe one of them"
                )
            self.ignored.append(words)
        elif not self.subject or (named and not self.named):
            self.subject, self.named = subject, named

    def _action(self, item: Item) -> None:
        clause = self.clauses[-1]
        self.attending = False
        self.dead = self.denied
        self.denied = False
        if self.dead:
            self.ignored.append(item.words)
            self.denied_actions.append(item.words)
            self.recovers = self.recovers or item.slots["action"] == "fall"
            return
        implied = dict(item.slots)
        last = clause.steps[-1] if item.gerund and clause.steps else None
        draft = Draft(
            str(implied.pop("action")), implied, weak=item.kind == "weak", gerund=item.gerund, words=item.words
        )
        if item.partly:
            self.partly.append(f"{item.words} (made as any {draft.action.replace('_', ' ')})")
        draft.joined = "" if clause.steps else clause.join
        for each in clause.pending:
            attach(draft, each, self.ignored)
        clause.pending.clear()
        if last is not None and last.words in STOPPING:  # stops walking: walks, then stands
            draft.joined, last.joined = last.joined, "then"
            clause.steps.insert(-1, draft)
        else:
            clause.steps.append(draft)

    def _modifier(self, item: Item) -> None:
        clause = self.clauses[-1]
        if self.dead or self.denied:
            self.ignored.append(item.words)
        elif item.kind == "direction" and (self.attending or (self.of_part and not self._stretching())):
            if item.slots["direction"] not in ("up", "down"):
                self.ignored.append(item.words)
        elif clause.steps:
            attach(clause.steps[-1], item, self.ignored)
        else:
            clause.pending.append(item)

    def _join(self, join: str) -> None:
        clause = self.clauses[-1]
        self.attending = False
        if join == ",":
            if not clause.steps and (clause.join not in (",", "") or not self._last()):
                return  # slowly, a man ...; and then, slowly, ...
            self.dead = self.denied = False
        else:
            self.dead = self.dead and join == "and"
            self.denied = self.denied and join == "and"
        if clause.steps or (clause.pending and self._last()):
            self.settle()
            self.clauses.append(Clause(join))
            return
        if join != ",":
            joins = {clause.join, join}  # "and then", "before and after"
            clause.join = next(each for each in ("after", "before", "while", "then", "and", ",", "") if each in joins)

    def _stretching(self) -> bool:
        steps = self.clauses[-1].steps
        return bool(steps) and steps[-1].action == "stretch"

    def _last(self) -> Draft | None:
        return next((each.steps[-1] for each in reversed(self.clauses) if each.steps), None)

    def settle(self) -> None:
        """Gives what stands in the last clause without an action to the action before it, or makes a step of its own of it."""
        clause = self.clauses[-1]
        last = self._last()
        if clause.steps or not clause.pending:
            return
        if last is None and any(each.kind == "gait" for each in clause.pending):
            last = Draft("walk", words="gait")  # a waddling gait
            clause.steps.append(last)
        if last is None:
            self.ignored += [each.words for each in clause.pending]
            clause.pending.clear()
            return
        new = None
        for item in clause.pending:
            fresh = item.kind == "direction" and clause.join in ("then", "and") and new is None
            try:
                if fresh and clause.join == "then" and last.get("direction") is not None:
                    raise Opposite
                attach(new or last, item, self.ignored)
            except Opposite:
                if not fresh:
                    raise
                new = Draft(
                    last.action, dict(last.implied), {**last.said, "direction": item.slots["direction"]}, joined="then"
                )
                new.words = last.words
        clause.pending.clear()
        if new is not None:
            clause.steps.append(new)

    def ordered(self) -> list[Draft]:
        """The steps in the order in which they happen."""
        self.settle_loose()
        self.settle()
        found: list[list[Draft]] = []
        held: list[Draft] = []
        earlier: list[Draft] | None = None  # those of a subordinate clause, which further gerunds belong to
        for number, clause in enumerate(each for each in self.clauses if each.steps):
            gerund = clause.steps[0].gerund
            if clause.join in ("and", "then") and gerund and earlier is not None:
                earlier += clause.steps
                continue
            earlier = clause.steps if clause.join in ("before", "after", "while") else None
            if clause.join == "before" and number == 0:
                held = clause.steps
            elif clause.join in ("after", "while") and found:
                falls = any(each.action in ("fall", "stumble") for each in found[-1])
                found.insert(-1 if clause.join == "after" or falls else len(found), clause.steps)
            else:
                found.append(clause.steps)
                if held and clause.join == ",":
                    found.append(held)
                    held = []
        return [draft for steps in ([*found, held] if held else found) for draft in steps]


def attach(draft: Draft, item: Item, ignored: list[str]) -> None:
    """Says of a step what an item says; raises where it says the contrary of what was said before."""
    if item.kind in ("cause", "gait"):
        draft.cause = item.words
    part = draft.get("body_part")
    if (
        item.kind == "part"
        and part is not None
        and (part, draft.get("side")) != (item.slots["body_part"], item.slots.get("side"))
    ):
        ignored.append(item.words)
        return
    storey = item.words in STOREYS and draft.action in ("walk", "run", "climb")
    if storey:
        draft.said["object"] = "stair"
    if (draft.action, item.words) == ("stand_up", "bed") or item.words == "ladder":
        ignored.append(item.words)  # made as a seat, and as a stair
    if item.words in ("on one leg", "on one foot") and draft.action not in ("jump", "turn", "walk", "run", "dance"):
        ignored.append(item.words)
    stairs = storey or (item.slots.get("object") == "stair" and draft.get("direction") in ("up", "down"))
    if stairs and draft.action == "walk" and draft.get("type") is None:
        draft.action, draft.weak = "climb", False
    for slot, value in item.slots.items():
        before = draft.get(slot) if slot == "type" else draft.said.get(slot)
        if slot == "direction":
            draft.returns = item.words == "back"
            _direct(draft, str(value), item.words, ignored)
        elif before is None or before == value:
            draft.said[slot] = value
        elif slot in ("speed", "manner"):
            raise InputError(
                f"the sentence is contradictory: it says {before} and {value} of one action ({draft.words}); leave "
                "one of them out"
            )
        elif slot == "object":
            draft.said[slot] = min(before, value, key=lambda each: OBJECTS_FIRST.index(str(each)))
        elif slot == "type" and value in ("festinating", "freezing") and before == "parkinsonian":
            draft.said[slot] = value
        elif not (slot == "type" and before in ("festinating", "freezing") and value == "parkinsonian"):
            ignored.append(item.words)


def _direct(draft: Draft, value: str, words: str, ignored: list[str]) -> None:
    before = draft.get("direction")
    if value == "circle":
        value = {"left": "counterclockwise", "right": "clockwise"}.get(str(before), str(before or "circle"))
        if value not in ("clockwise", "counterclockwise", "circle"):
            value = "circle"
        draft.said["direction"] = value
    elif before == "circle" and value in ("clockwise", "counterclockwise", "left", "right"):
        draft.said["direction"] = {"left": "counterclockwise", "right": "clockwise"}.get(value, value)
    elif before is None or before == value or (before in ("up", "down") and value not in ("up", "down")):
        draft.said["direction"] = value
    elif frozenset((str(before), value)) in OPPOSITE:
        raise Opposite(f"{before} and {value}", draft.words)
    elif value in YIELDING.get(str(before), ()):
        draft.said["direction"] = value
    elif before not in YIELDING.get(value, ()) and (value not in ("up", "down") or draft.action in ("walk", "run")):
        ignored.append(words)


def merged(first: Draft, second: Draft) -> Draft | None:
    """Two steps as one; None where they say different things."""
    one, two = first.slots(), second.slots()
    firm = ("manner", "speed") if first.action == "fall" else ("manner", "speed", "type")
    if any(slot in one and slot in two and one[slot] != two[slot] for slot in firm):
        return None
    result = Draft(first.action, dict(first.implied), dict(first.said), weak=first.weak, gerund=first.gerund)
    result.joined, result.words = first.joined, f"{first.words} {second.words}"
    ignored: list[str] = []
    try:
        for slot, value in two.items():
            if slot not in ("direction", "object") and result.get(slot) is not None:
                continue
            attach(result, Item("slot", str(value), {slot: value}), ignored)
    except (Opposite, InputError):
        return None
    return result
