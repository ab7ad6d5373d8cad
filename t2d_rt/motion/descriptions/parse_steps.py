"""The steps of a sentence while it is read: which words belong to which action, and in which order the actions happen."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.lexicon import forms_of, lexicon
from t2d_rt.motion.descriptions.slots import TURNED_DEG
from t2d_rt.motion.descriptions.tokens import HIS, TREADS, Token

YIELDING = {"forward": ("left", "right", "straight"), "straight": ("left", "right")}
"""Directions that a more exact one replaces: forward and to the left is to the left."""
PAIRS = "forward back, left right, up down, clockwise counterclockwise"
STRAIGHT_PAIRS = "straight clockwise, straight counterclockwise, straight back"
HALF_TURN_DEG = 180.0
OPPOSITE = {frozenset(pair.split()) for pair in f"{PAIRS}, {STRAIGHT_PAIRS}".split(", ")}
"""Directions that one step cannot both have."""
ON_ONE_LEG = "jump", "turn", "walk", "run", "dance", "balance"
"""Actions of which "on one leg" is no mistake."""
IN_PLACE = {"jump": "up", "walk": "in_place", "run": "in_place"}
"""Direction of those that go on the spot."""
LEADING = "forward", "straight", "back", "left", "right"
"""Directions of a jump that does not stay on the spot."""
REPEATED = "walk", "run", "jump", "turn", "dance", "bend", "squat", "stretch", "balance"
"""Actions that can be done again at once: who has sat down is to stand up first."""
OBJECTS_FIRST = "handrail", "ball", "chair", "stair", "floor"

MEASURES = "count", "duration_s", "angle_deg"
REPEATING = "and", "then", ","
"""Joins behind which an action may be done again."""
INDEFINITE = "a", "an", "one", "another", "other", "second"
"""Words before a noun of somebody who was not named before."""

TWO_PEOPLE = {"man", "woman"}, {"man", "child"}, {"woman", "child"}, {"old_person", "child"}
"""Subjects that cannot be one person; others may be: an old man is a man."""


class Opposite(Exception):
    """Two directions of one step that cannot both be."""


@dataclass(slots=True)
class ParseStep:
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
    spot: str = ""
    """Words that tell that a jump stays on the spot."""
    given: dict[str, str] = field(default_factory=dict)
    """Words that tell count and duration, by slot."""
    repeats: bool = False
    """Whether it is done again, and is no part of the same action before it."""

    def get(self, slot: str) -> object:
        """What the sentence says of a slot, or else what the verb implies."""
        return self.said.get(slot, self.implied.get(slot))

    def slots(self) -> dict[str, object]:
        """All slots, what is said before what is implied."""
        return {**self.implied, **self.said}

    def again(self, tells: set[str], clause: Clause) -> ParseStep:
        """The same action once more in a clause without a verb, which tells other slots and may hold a number that is not read."""
        other = tells | ({*MEASURES} if clause.unread else set())
        said = {slot: value for slot, value in self.said.items() if slot not in other}
        given = {slot: words for slot, words in self.given.items() if slot not in other}
        implied = {slot: value for slot, value in self.implied.items() if slot not in tells}
        return ParseStep(self.action, implied, said, weak=self.weak, joined="then", words=self.words, given=given)


@dataclass(slots=True)
class Clause:
    """A part of a sentence between two joins."""

    join: str
    steps: list[ParseStep] = field(default_factory=list)
    pending: list[Token] = field(default_factory=list)
    opens: bool = False
    """Whether it begins a sentence."""
    unread: bool = False
    """Whether it holds a number that was not understood, and no action."""


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
    """Whether a noun has told the subject; later nouns do not replace it."""
    his: str = ""
    """The possessive of the subject, "his" or "her", or "" while it is not known."""
    dead: bool = False
    """Whether the words belong to something that is not understood, or does not happen."""
    denied: bool = False
    """Whether the next action does not happen."""
    other_choice: bool = False
    """Whether the words tell what may happen instead of what was said: left or right."""
    of_part: bool = False
    """Whether the last words are a part of the body: arms up."""
    attending: bool = False
    """Whether the words tell what a limb does."""
    limb: bool = False
    """Whether a part of the body has been named since the last action or join."""
    loose: list[str] = field(default_factory=list)
    """What limbs do and how they are, of which none has been named yet."""
    partly: list[str] = field(default_factory=list)
    """Words that say more than is made of them."""
    article: str = ""
    """The last of the articles, until a noun or a verb follows."""
    last_words: str = ""

    def read(self, token: Token) -> None:
        """Takes one more token."""
        if token.kind == "action" and token.words == self.last_words:  # jump jump
            self._join(",")
        opens, self.last_words = self.last_words in ("", ".", "!", ";", "then"), token.words
        token = self._elliptic(token)
        limb = token.kind == "part" and token.slots["body_part"] != "waist"  # bends at the waist to the left
        self.of_part, before = limb or token.words == "together", self.of_part
        if token.kind == "direction":
            self.of_part = before
        named = token.kind == "part" or "body_part" in token.slots
        self.limb = self.limb or named
        if named or token.kind == "object":
            self.loose.clear()
        if token.kind in ("join", "action", "weak", "other"):
            self.settle_loose()
        if token.words == ":" and self.clauses[-1].pending and not self.clauses[-1].steps:
            return  # 5 s: he walks
        if token.kind == "join":
            follows = opens and token.slots["join"] == "after" and not token.words.startswith("b")  # before that
            # He walks. After sitting, he jumps.
            self._join("," if follows and self._last() else str(token.slots["join"]))
            self.clauses[-1].opens = opens
        elif token.kind == "subject":
            self._subject(str(token.slots["subject"]), token.words)
        elif token.kind == "not":
            self.denied = True
            self.ignored.append(token.said)
        elif token.kind in ("action", "weak"):
            self._action(token)
        elif token.kind == "other":
            self.dead, self.denied, self.attending = True, False, False
            self.ignored.append(token.said)
        elif token.kind in ("unknown", "reported", "recover", "number"):
            self.recovers = self.recovers or token.kind == "recover"
            self.clauses[-1].unread = self.clauses[-1].unread or "number" in token.slots
            self.ignored.append(token.said)
        elif token.kind == "attend":
            if token.slots or self.denied:
                self._modifier(token)
            elif not self.limb and token.words not in forms_of(lexicon().auxiliary):
                self.loose.append(token.said)
            self.attending = True
        elif token.kind == "of limb":
            if not self.limb:
                self.loose.append(token.said)
        elif token.kind == "spot":
            self._spot(token.said)
        elif token.words == "again" and self.clauses[-1].join in REPEATING and not self._returning():
            self._modifier(replace(token, kind="again"))
        elif token.kind not in ("fixed", "neutral"):
            self._modifier(token)
        if token.words in (*INDEFINITE, *HIS):
            self.article = token.words
        elif token.kind not in ("slot", "neutral", "unknown"):
            self.article = ""

    def _elliptic(self, token: Token) -> Token:
        """A token with what the step before tells of it: twice on the left foot and once on the right; by 90 degrees, then 45."""
        last, side = self._last(), token.slots.get("direction")
        if last is None:
            return token
        alone = token.words == side and self.article in HIS
        if last.get("side") and side in ("left", "right") and (alone or token.words.startswith("on ")):
            return Token("part", token.words, {"body_part": last.get("body_part"), "side": side})
        measures = [slot for slot in MEASURES if slot in last.said]
        if token.kind == "number" and len(measures) == 1 and not self.clauses[-1].steps:
            (slot,), words = measures, f"{token.words} {last.given[measures[0]].split()[-1]}"
            return Token("angle" if slot == "angle_deg" else "slot", words, {slot: token.slots["number"]})
        return token

    def settle_loose(self) -> None:
        """Reports what is said of limbs where none is named, before what begins another clause."""
        self.ignored += self.loose
        self.loose.clear()
        self.limb = False

    def _spot(self, words: str) -> None:
        """Who jumps on the spot jumps up, who walks or runs there gets nowhere; who climbs or dances does not stay, nor who jumps
        somewhere else."""
        steps = self.clauses[-1].steps
        action, direction = (steps[-1].action, steps[-1].get("direction")) if steps else ("", None)
        if action in IN_PLACE and direction in (None, IN_PLACE[action]) and not self.dead:
            steps[-1].said["direction"] = IN_PLACE[action]
            steps[-1].spot = words
        elif (
            self.dead or action in ("", "walk", "run", "climb", "dance") or (action == "jump" and direction in LEADING)
        ):
            self.ignored.append(words)

    def _subject(self, subject: str, words: str) -> None:
        named, clause = words not in lexicon().pronouns, self.clauses[-1]
        his = {"man": "his", "woman": "her"}.get(subject, "")
        his = next((his for his, nouns in lexicon().possessives.items() if words.split()[-1] in nouns), his)
        if clause.join == "before" and clause.steps and clause.opens:  # before he sits down he walks
            self.clauses.append(Clause(","))
        if named and self.named and {subject, self.subject} in TWO_PEOPLE:
            if self._last() is not None and not self.clauses[-1].steps:
                raise InputError(
                    f"the sentence tells what several people do ({self.subject.replace('_', ' ')}, {words}); describe one of them"
                )
            self.ignored.append(words)
        elif named and self.article in INDEFINITE and (self.named or (self.subject and clause.steps)):
            self.ignored.append(words)  # past a man who sits
        elif {his, self.his} == {"his", "her"}:
            self.ignored.append(words)  # he sits, she walks
        else:
            self.ignored += [words] * (words in lexicon().several)
            if not self.subject or (named and not self.named):
                self.subject, self.named = subject, named
        self.his = self.his or his

    def _action(self, token: Token) -> None:
        clause = self.clauses[-1]
        self.attending = False
        if self.other_choice:
            self.dead = True
            self.ignored.append(token.said)
            return
        self.dead = self.denied
        self.denied = False
        if clause.steps and not self.dead and _as_noun(clause.steps[-1], token, self.ignored):
            return
        if self.dead:
            self.ignored.append(token.said)
            self.denied_actions.append(token.said)
            self.recovers = self.recovers or token.slots["action"] == "fall"
            return
        implied = dict(token.slots)
        last = clause.steps[-1] if token.gerund and clause.steps else None
        action = str(implied.pop("action"))
        step = ParseStep(action, implied, weak=token.kind == "weak", gerund=token.gerund, words=token.words)
        if token.partly:
            self.partly.append(f"{token.words} (made as any {step.action.replace('_', ' ')})")
        step.joined = "" if clause.steps else clause.join
        for pending in clause.pending:
            step.repeats = step.repeats or pending.kind == "again"
            attach(step, pending, self.ignored)
        clause.pending.clear()
        if last is not None and last.words in forms_of(lexicon().stopping):  # stops walking: walks, then stands
            step.joined, last.joined = last.joined, "then"
            clause.steps.insert(-1, step)
        else:
            clause.steps.append(step)

    def _modifier(self, token: Token) -> None:
        clause = self.clauses[-1]
        of_limb = "count" in token.slots and clause.pending and clause.pending[-1].kind == "attend"  # claps three times
        if self.dead or self.denied or self.other_choice or of_limb:
            self.ignored.append(token.said)
        elif token.kind == "direction" and (self.attending or (self.of_part and not self._stretching())):
            if token.slots["direction"] not in ("up", "down"):
                self.ignored.append(token.said)
        elif clause.steps:
            clause.steps[-1].repeats = clause.steps[-1].repeats or token.kind == "again"
            attach(clause.steps[-1], token, self.ignored)
        else:
            clause.pending.append(token)

    def _join(self, join: str) -> None:
        clause = self.clauses[-1]
        self.attending = False
        self.other_choice = join == "or" and bool(self._last() or self.denied_actions) and not self.denied
        if self.other_choice:
            self.ignored.append(join)
            return
        join = "and" if join == "or" else join
        if join == ",":
            again = any(pending.kind == "again" for pending in clause.pending)
            if not clause.steps and (clause.join not in (REPEATING if again else (",", "")) or not self._last()):
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
            joins = {clause.join, join}  # "and then"
            clause.join = next(word for word in ("after", "before", "while", "then", "and", ",", "") if word in joins)
            self.ignored += joins - {clause.join, "then", "and", ",", ""}  # before and after

    def _stretching(self) -> bool:
        steps = self.clauses[-1].steps
        return bool(steps) and steps[-1].action == "stretch"

    def _returning(self) -> bool:
        """Whether another direction stands last, so that "again" tells of no repetition: down and up again, twice."""
        pending, last = self.clauses[-1].pending, self._last()
        directed = bool(pending) and pending[-1].kind == "direction"
        return directed and (last is None or last.get("direction") != pending[-1].slots["direction"])

    def _last(self) -> ParseStep | None:
        return next((clause.steps[-1] for clause in reversed(self.clauses) if clause.steps), None)

    def settle(self) -> None:
        """Gives the words of a last clause without an action to the action before it, or makes a step of their own of them."""
        clause = self.clauses[-1]
        last = self._last()
        if clause.steps or not clause.pending:
            return
        if last is None and any(pending.kind == "gait" for pending in clause.pending):
            last = ParseStep("walk", words="gait")  # a waddling gait
            clause.steps.append(last)
        tells = {slot for pending in clause.pending for slot in pending.slots}
        more = [pending for pending in clause.pending if pending.kind == "again"]
        again = bool(more) and bool(tells & {*MEASURES} or not tells) and clause.join in REPEATING
        holder = next((other for other in reversed(self.clauses) if other.steps), clause)
        aside = holder.join in ("while", "after") and holder is not self.clauses[0]
        if more and last is not None and (not again or aside or last.returns or last.action not in REPEATED):
            told = not tells or clause.join != "then" or last.action not in REPEATED  # quickly, then slowly again
            self.ignored += [pending.said for pending in more if told or pending.slots]
            clause.pending = [pending for pending in clause.pending if pending.kind != "again"]
            self.settle()
            return
        if last is None:
            self.ignored += [pending.said for pending in clause.pending]
            clause.pending.clear()
            return
        measures = tells & {*MEASURES}
        measured = measures & last.said.keys()  # 3 times on the left leg and 5 times on the right one
        returns = any(pending.words == "back" for pending in clause.pending)  # to the door and back
        tells |= {"object", "count", "duration_s"} if returns else set()
        if measures and not measured and not again:  # for 5 s, then three times
            tells |= {"count", "duration_s"}
        listed = "direction" in tells and last.joined == "then" != holder.join  # left, right and forward
        repeats = (
            again or (tells and clause.join == "then") or ((measured or returns) and clause.join == "and") or listed
        )
        several = sum(len(other.steps) for other in self.clauses) > 1
        # Sits down, stands up, three times.
        if (returns and "count" not in last.said) or (clause.join == "," and several):
            counts = [other.said for other in clause.pending if other.kind == "slot" and "count" in other.slots]
            self.partly += [f"{count} (made of the last action alone)" for count in counts]
        new = last.again(tells, clause) if repeats else None
        for token in sorted(clause.pending, key=lambda pending: pending.kind != "direction"):
            try:
                attach(new or last, token, self.ignored)
            except Opposite:
                if new is not None or token.kind != "direction" or clause.join not in ("then", "and", ","):
                    raise
                new = last.again(tells, clause)
                attach(new, token, self.ignored)
        clause.pending.clear()
        if new is not None:
            new.repeats = again
            if again and "count" in tells and not {"count", "duration_s"} & last.said.keys():
                last.said["count"], last.given["count"] = 1, "once"  # jumps, then two more times
            counted = again or "count" in last.said
            if counted and new.said.keys() >= {"count", "duration_s"} and "duration_s" not in tells:
                before, times = (float(str(said.get("count", 1))) for said in (last.said, new.said))
                # Of 0 times, which are refused later, nothing follows.
                new.said["duration_s"] = float(str(new.said["duration_s"])) * times / (before or 1)
            (holder if again else clause).steps.append(new)

    def ordered(self) -> list[ParseStep]:
        """The steps in the order in which they happen."""
        self.settle_loose()
        self.settle()
        step_groups: list[list[ParseStep]] = []
        held: list[ParseStep] = []
        earlier: list[ParseStep] | None = None  # those of a subordinate clause, which further gerunds belong to
        for number, clause in enumerate(candidate for candidate in self.clauses if candidate.steps):
            gerund = clause.steps[0].gerund
            if clause.join in ("and", "then") and gerund and earlier is not None:
                earlier += clause.steps
                continue
            earlier = clause.steps if clause.join in ("before", "after", "while") else None
            if clause.join == "before" and (number == 0 or clause.opens):
                told = step_groups[-1:] if not held else [held]
                same = [step.action for steps in told for step in steps] == [step.action for step in clause.steps]
                step_groups += [held] if held else []
                held = step_groups.pop() if same else clause.steps  # He sits. Before sitting, he jumps.
            elif clause.join in ("after", "while") and step_groups:
                falls = any(step.action in ("fall", "stumble") for step in step_groups[-1])
                step_groups.insert(-1 if clause.join == "after" or falls else len(step_groups), clause.steps)
            else:
                step_groups.append(clause.steps)
                if held and clause.join == ",":
                    step_groups.append(held)
                    held = []
        return [step for steps in ([*step_groups, held] if held else step_groups) for step in steps]


def _as_noun(step: ParseStep, token: Token, ignored: list[str]) -> bool:
    """Whether a verb is in fact a noun that belongs to the step before it, as in "spins two turns" or "walks two circles". What it
    says is then added to that step."""
    if token.words == "steps" and step.action == "climb":
        attach(step, Token("object", token.words, {"object": "stair"}), ignored)
    elif token.words == "turns" and step.action == "turn" and "count" in step.said:
        step.implied.setdefault("angle_deg", 2 * HALF_TURN_DEG)
    elif token.words in ("turn", "turns") and step.action == "turn" and "angle_deg" in step.said:
        pass  # turns a quarter turn
    elif token.words in ("circle", "circles") and step.action in ("walk", "run", "dance", "jump"):
        attach(step, Token("direction", token.words, {"direction": "circle"}), ignored)
    else:
        return False
    return True


def attach(step: ParseStep, token: Token, ignored: list[str]) -> None:
    """Says of a step what a token says; raises where it says the contrary of what was said before."""
    if token.kind in ("cause", "gait"):
        step.cause = token.said
    treads = token.words.endswith(TREADS)
    if (token.kind == "angle" and step.action != "turn") or (
        "count" in token.slots and step.action == "climb" and not treads
    ):
        ignored.append(token.said)
        return
    low, high = TURNED_DEG
    if token.kind == "angle" and not low <= float(str(token.slots["angle_deg"])) <= high:
        raise InputError(
            f"a person turns by {low:g} to {high:g} degrees, got {token.given}; write an angle between them"
        )
    if step.action == "stand" and token.words in ("on one leg", "on one foot"):
        step.action = "balance"
    part = step.get("body_part"), step.get("side")
    if token.kind == "part" and part[0] is not None and part != (token.slots["body_part"], token.slots.get("side")):
        ignored.append(token.said)
        return
    storey = token.words in lexicon().storeys and step.action in ("walk", "run", "climb")
    if storey:
        step.said["object"] = "stair"
    if (step.action, token.words) == ("stand_up", "bed") or token.words == "ladder":
        ignored.append(token.said)  # made as a seat, and as a stair
    if token.words in ("on one leg", "on one foot") and step.action not in ON_ONE_LEG:
        ignored.append(token.said)
    stairs = storey or (token.slots.get("object") == "stair" and step.get("direction") in ("up", "down"))
    if stairs and step.action == "walk" and step.get("type") is None:
        step.action, step.weak = "climb", False
    for slot, value in token.slots.items():
        before = step.get(slot) if slot == "type" else step.said.get(slot)
        if slot == "direction":
            step.given[slot] = token.words
            step.returns = token.words == "back"
            _direct(step, str(value), token.said, ignored)
        elif before is None or (before == value and slot not in MEASURES):
            step.said[slot] = value
            step.given[slot] = token.given
        elif slot in ("speed", "manner"):
            raise InputError(
                f"the sentence is contradictory: it says {before} and {value} of one action ({step.words}); leave "
                "one of them out"
            )
        elif slot == "object":
            step.said[slot] = min(before, value, key=lambda name: OBJECTS_FIRST.index(str(name)))
        elif slot == "type" and value in ("festinating", "freezing") and before == "parkinsonian":
            step.said[slot] = value
        elif not (slot == "type" and before in ("festinating", "freezing") and value == "parkinsonian"):
            ignored.append(token.said)


def _direct(step: ParseStep, value: str, words: str, ignored: list[str]) -> None:
    before = step.get("direction")
    if before == "in_place":
        ignored.append(words)
    elif value == "circle":
        value = {"left": "counterclockwise", "right": "clockwise"}.get(str(before), str(before or "circle"))
        if value not in ("clockwise", "counterclockwise", "circle"):
            value = "circle"
        step.said["direction"] = value
    elif before == "circle" and value in ("clockwise", "counterclockwise", "left", "right"):
        step.said["direction"] = {"left": "counterclockwise", "right": "clockwise"}.get(value, value)
    elif before is None or before == value or (before in ("up", "down") and value not in ("up", "down")):
        if step.spot and value in LEADING:
            ignored.append(step.spot)
        step.said["direction"] = value
    elif step.action == "turn" and before == "back" and value != "forward":  # turns around to the left
        step.said["direction"] = value
        step.implied.setdefault("angle_deg", HALF_TURN_DEG)  # which an angle that is said replaces
    elif frozenset((str(before), value)) in OPPOSITE:
        raise Opposite(f"{before} and {value}", step.words)
    elif value in YIELDING.get(str(before), ()):
        step.said["direction"] = value
    elif before not in YIELDING.get(value, ()) and (value not in ("up", "down") or step.action in ("walk", "run")):
        ignored.append(words)


def merged(first: ParseStep, second: ParseStep, ignored: list[str]) -> ParseStep | None:
    """Two steps as one, what it cannot tell of both is reported; None where they say different things."""
    one, two = first.slots(), second.slots()
    firm = ("manner", "speed") if first.action == "fall" else ("manner", "speed", "type", "side", "count")
    if any(slot in one and slot in two and one[slot] != two[slot] for slot in firm):
        return None
    result = ParseStep(first.action, dict(first.implied), dict(first.said), weak=first.weak, gerund=first.gerund)
    result.joined, result.words = first.joined, f"{first.words} {second.words}"
    lost: list[str] = []
    try:
        for slot, value in two.items():
            before, given = result.get(slot), second.given.get(slot, str(value))
            if slot == "duration_s" and before is not None:  # sits down for 3 s, stays seated for 5
                result.said[slot] = float(str(before)) + float(str(value))
            elif (
                slot in ("count", "body_part", "side") or (slot == "object" and second.joined == "then")
            ) and before not in (None, value):
                lost += [given] * (given not in lost)
            elif slot in ("direction", "object") or before is None:
                attach(result, Token("slot", given, {slot: value}), lost)
    except (Opposite, InputError):
        return None
    ignored += lost
    return result
