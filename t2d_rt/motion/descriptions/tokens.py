"""A sentence as a row of tokens: the words and phrases of the lexicon in it, each with what it stands for."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import takewhile
from typing import Any

from t2d_rt.motion.descriptions.lexicon import Forms, Synonyms, inflected, lexicon, meaning
from t2d_rt.motion.descriptions.numbers import (
    PARTS,
    TIMES,
    Reading,
    amount_at,
    fraction_at,
    is_vague,
    linked_numbers,
    number_at,
)
from t2d_rt.motion.descriptions.words import words_of

GAP = "~"
MOST_BETWEEN = 4
"""Words that `~` stands for at most: "picks the red ball up"."""
NO_GAP = "and", "or", "then", ",", ".", "before", "after", "while", "to", "no", "not", "without"
"""Words that it does not stand for."""

BY, SETS = ("x", "\u00d7", "*"), ("sets", "rounds", "series")
"""What stands between how many times and what is done: 2 x 90 degrees, 3 sets of 5 squats."""

COMPARING = "<>\u2264\u2265\u00b1"
"""Signs that say of a number what is not read."""

CLOCK = "after", "every", "at", "until", "before", "from", "since", "by", "=", "@"
"""Words before a time at which something happens, which is no duration."""
MORE = "more", "again"
"""What follows a once that repeats what was done before."""
NO_DURATION = "each", "every", "between", "apart", "later", "rest", "break", "pauses", "into"
"""Words behind a time that is not the duration of one action: "10 s each", "5 s later"."""
TOTAL = " total ", " in all ", " all together ", " altogether ", " overall "
"""Words near the time of all repetitions together, which is not multiplied: "a total of 10 s, twice"."""
BETWEEN = "with a pause", "with a break", "with a pause of", "with a break of", "pauses of", "breaks of", "intervals of"
"""Words before the time of a pause between repetitions."""
IN_ALL = "in total", "in all", "altogether", "overall", "around", "round the"
"""What follows how often something is done within a time that is said before: for 60 s, 20 times in total."""

PERIODS = "hour", "day", "week", "month", "year", "morning", "afternoon", "evening", "night"
RATES = "hourly", "daily", "weekly", "nightly"
"""What makes a rate of how often and how long: three times a day, twice daily."""
AGED = "aged", "age", "of", "at"
"""What stands between somebody and how old he is."""

TREADS = "stairs", "treads", "steps"
"""What who climbs counts."""

AS_JOINS = "if", "though", "in", "it", "well", "before"
"""What follows an "as" that compares nothing."""

PRONOUN_ONE = "left", "right", "other", "same", "this", "that"
"""Words behind which "one" is a pronoun: the right one."""

MODIFYING = "slot", "direction"
"""Kinds of words that may stand between a number and what is done: three slow squats, two left turns."""
SIZES = "big", "small", "large", "little", "short", "long", "deep", "low", "full", "complete", "whole"
WITHIN = *MODIFYING, "again", "angle", "number", "part", "object", "unknown", "gait", "reported"
"""Kinds of tokens that are taken of the words that `~` stands for."""

HIS = ("his", "her", "their", "its", "the")
HIM = ("him", "her", "them", "it")
SELF = ("himself", "herself", "themself", "themselves", *(f"{his} body" for his in HIS))

SHORTEST_SLIP, SHORTEST_SWAP = 5, 6
"""Letters of a word in which a letter too many, too few or two exchanged ones are read as a slip; and a wrong letter."""


@dataclass(frozen=True, slots=True)
class Token:
    """A word or phrase and what it stands for."""

    kind: str
    words: str
    slots: Mapping[str, object] = field(default_factory=dict)
    gerund: bool = False
    note: str = ""
    """What was said where `words` are read for it: a misspelt word, a vague number, a range."""
    partly: bool = False
    """Whether it says more than is made of it."""

    @property
    def said(self) -> str:
        """The words of the sentence."""
        return self.note or self.words

    @property
    def given(self) -> str:
        """The words of the sentence, with what is read for them."""
        return f"{self.note} (read as {self.words})" if self.note else self.words


@dataclass(frozen=True, slots=True)
class Entry:
    """A phrase of the lexicon, word by word, with one of the forms of its verb and one of the possessives."""

    words: tuple[str, ...]
    kind: str
    slots: Mapping[str, object]
    gerund: bool = False
    partly: bool = False


def _spelled(phrase: str) -> Iterator[tuple[str, ...]]:
    """The words of a phrase, with each possessive in the place of {his}, and other words of the person likewise."""
    for his in HIS if "{his}" in phrase else ("",):
        for him in HIM if "{him}" in phrase else ("",):
            for himself in SELF if "{self}" in phrase else ("",):
                yield tuple(words_of(phrase.replace("{his}", his).replace("{him}", him).replace("{self}", himself)))


def _verbs(phrases: Iterable[str], kind: str, slots: Mapping[str, object]) -> Iterator[Entry]:
    """Entries of phrases that begin with an infinitive, in all its forms."""
    partly = lexicon().partly_made
    for phrase in phrases:
        for form in Forms._fields:
            text = " and ".join(inflected(verb, form) for verb in phrase.split(" and "))  # slips and falls
            for words in _spelled(text):
                yield Entry(words, kind, slots, gerund=form == "gerund", partly=phrase in partly)


def _phrases(phrases: Iterable[str], kind: str, slots: Mapping[str, object]) -> Iterator[Entry]:
    return (Entry(words, kind, slots) for phrase in phrases for words in _spelled(phrase))


def _entries() -> Iterator[Entry]:
    """All phrases of the lexicon; of equal ones, the first counts."""
    lexemes = lexicon()
    for join, phrases in lexemes.joins.items():
        yield from (Entry(tuple(words_of(phrase)), "join", {"join": join}) for phrase in phrases)  # having
    for source in ("said", "understood"):
        for name, synonyms in lexemes.verbs.items():
            action, slots = meaning(name)
            yield from _verbs(getattr(synonyms, source), "action", {"action": action, **slots})
    for action, phrases in lexemes.weak_verbs.items():
        yield from _verbs(phrases, "weak", {"action": action})
    yield from _verbs(lexemes.limb_verbs, "attend", {})
    yield from _verbs(lexemes.other_actions, "other", {})
    yield from _verbs(lexemes.recovering, "recover", {})
    for part, phrases in lexemes.body_part_verbs.items():
        yield from _verbs(phrases, "attend", {"body_part": part})
    for source in ("adverbs", "phrases", "adjectives", "understood"):
        for name, modifier in lexemes.modifiers.items():
            yield from _phrases(getattr(modifier, source), "slot", meaning(name)[1])
    yield from _of_synonyms(lexemes.subjects, "subject", "subject")
    for slot, table in (("object", lexemes.objects), ("direction", lexemes.directions)):
        for value, phrases in table.items():
            yield from _phrases(phrases, slot, {slot: value})
    yield from _of_synonyms(lexemes.gaits, "gait", "type")
    yield from _of_synonyms(lexemes.fall_causes, "cause", "type")
    for part, phrases in lexemes.body_parts.items():
        for phrase in phrases:
            yield from _phrases([phrase], "part", {"body_part": part})
            for side in ("left", "right") if part != "waist" and not phrase.startswith("on ") else ():
                yield Entry((side, *words_of(phrase)), "part", {"body_part": part, "side": side})
    for section, kind in (
        ("without_meaning", "fixed"),
        ("reported", "reported"),
        ("on_the_spot", "spot"),
        ("negations", "not"),
    ):
        yield from _phrases(getattr(lexemes, section), kind, {})


def _of_synonyms(table: Mapping[Any, Synonyms], kind: str, slot: str) -> Iterator[Entry]:
    for source in ("said", "understood"):
        for value, synonyms in table.items():
            yield from _phrases(getattr(synonyms, source), kind, {slot: value})


@cache
def _index() -> dict[str, list[Entry]]:
    """Entries by their first word, the longest first; of equal ones the earlier."""
    entries_by_word: dict[str, list[Entry]] = {}
    for entry in _entries():
        if entry.words:
            entries_by_word.setdefault(entry.words[0], []).append(entry)
    return {
        word: sorted(entries, key=lambda entry: (-len(entry.words), GAP in entry.words, entry.kind == "other"))
        for word, entries in entries_by_word.items()
    }


@cache
def _vocabulary() -> frozenset[str]:
    """All words that are understood, which a misspelt one may mean."""
    lexemes = lexicon()
    words = {word for entries in _index().values() for entry in entries for word in entry.words}
    more = {*lexemes.of_limbs, *lexemes.numbers, *lexemes.times, *lexemes.seconds, *lexemes.degrees, *lexemes.neutral}
    return frozenset(words | more | {*TIMES, *SETS}) - {GAP}


def tokens_of(sentence: str) -> list[Token]:
    """The tokens of a sentence, in its order."""
    words: list[str] = []
    notes: dict[int, str] = {}
    for word in words_of(sentence):
        meant = _meant(word)
        if meant is not None:
            notes[len(words)] = word
        words.append(meant or word)
    sentence_tokens: list[Token] = []
    place = 0
    while place < len(words):
        tokens, after = _next(words, place)
        spoken = [notes.get(number, words[number]) for number in range(place, after)]
        misspelt = [notes[number] for number in range(place, after) if number in notes]
        if misspelt and tokens[0].kind == "unknown":
            tokens = [Token("unknown", misspelt[0])]
        elif misspelt:
            tokens = [replace(tokens[0], note=" ".join(spoken)), *tokens[1:]]
        sentence_tokens += tokens
        place = after
    return sentence_tokens


def _next(words: list[str], place: int) -> tuple[list[Token], int]:
    """The token that begins at a word, with those within its gap; and where the next one begins."""
    measure = _measure(words, place)
    if measure is not None:
        return [measure[0]], measure[1]
    for entry in _index().get(words[place], ()):
        gap = _match(entry.words, words, place)
        if gap is None:
            continue
        inside, gap_end, after = gap
        of_part = after < len(words) and _is(words[after], "part")
        if entry.kind == "direction" and entry.words[-1] in ("left", "right") and of_part:
            continue  # on his left foot
        within: list[Token] = []
        while inside < gap_end:
            tokens, inside = _next(words, inside)
            within += [
                token for token in tokens if token.kind in WITHIN and (token.kind != "object" or inside <= gap_end)
            ]
        said = " ".join(words[place:after])
        return [Token(entry.kind, said, entry.slots, entry.gerund, partly=entry.partly), *within], max(inside, after)
    word = words[place]
    number = _number(words, place)
    if number is not None:
        return [number[0]], number[1]
    if word.endswith("n't") or word == "cannot":
        return [Token("not", word)], place + 1
    sign = not any(char.isalnum() for char in word) and word not in COMPARING
    neutral = sign or (word in lexicon().neutral and _is_neutral(words, place)) or word in ("one", "a", "an")
    kind = "of limb" if word in lexicon().of_limbs else "neutral" if neutral else "unknown"
    return [Token(kind, word)], place + 1


def _is_neutral(words: list[str], place: int) -> bool:
    """Whether a neutral word means nothing where it stands, as in "more slowly", "once more", "both arms" and "another two", but
    not in "over two"."""
    word, before, follows = words[place], words[max(place - 1, 0)], "".join(words[place + 1 : place + 2])
    measured = follows != "" and (_measure(words, place + 1) or _number(words, place + 1)) is not None
    if word in ("over", "under", "above"):
        return not measured or follows in lexicon().times or _is(before, "action", action="fall")  # falls over twice
    if word == "another":
        return measured or (_is(follows, "action") and not follows.endswith("s"))
    if word == "more":
        return _is(follows, "slot") or before in (*TIMES, "time", *lexicon().times, *lexicon().seconds)
    return word != "both" or _is(follows, "part")


def _number_end(words: list[str], place: int) -> int:
    """Where a number or linked ones end that begin at a place; the place itself where none does."""
    values, _, end = linked_numbers(words, place)
    reading = number_at(words, place)
    mixed = bool(values) and values[0] > 1 and values[0] % 1 > 0  # 1 1/2 times
    return end if len(values) > 1 or mixed else reading.end if reading else place


def _number(words: list[str], place: int) -> tuple[Token, int] | None:
    """Numbers that measure nothing; linked ones, and those of steps and people, with what follows them."""
    values, _, _ = linked_numbers(words, place)
    number, vague, _ = number_at(words, place) or Reading(0.0, False, place)
    after = _number_end(words, place)
    after += int(after > place and words[after : after + 1] == ["more"])
    if words[place:after] in ([], ["a"], ["an"]) or (words[place] == "one" and words[place - 1] in PRONOUN_ONE):
        return None
    follows = words[after] if after < len(words) else ""
    people = values != [1] and _is(follows, "subject") and follows not in lexicon().pronouns
    if people or follows in ("steps", *TIMES, *lexicon().seconds, *lexicon().degrees):
        return _told(words, place, after + 1, {}, kind="reported")
    if len(values) > 1:
        return _told(words, place, after, {}, kind="reported")
    behind = {entry.kind for entry in _index().get(follows, ()) if _match(entry.words, words, after)}
    if not follows or behind & {"direction", "join"}:  # it may repeat a measure
        return _told(words, place, after, {"number": _whole(number)}, f"{number:g}" if vague else "", "number")
    return (
        None if words[place:after] in (["one"], ["one", "more"]) else _told(words, place, after, {}, kind="unknown")
    )  # one hand


def _told(
    words: list[str], place: int, after: int, slots: Mapping[str, object], read: str = "", kind: str = "slot"
) -> tuple[Token, int]:
    """The token of the words from `place` to `after`, and what is read for them where that is to be told."""
    said = " ".join(words[place:after])
    return Token(kind, read or said, slots, note=said if read else ""), after


def _match(pattern: tuple[str, ...], words: list[str], place: int) -> tuple[int, int, int] | None:
    """Where the words that `~` stands for begin and end, and where the phrase ends; None where it does not stand here."""
    split = pattern.index(GAP) if GAP in pattern else len(pattern)
    first, last = pattern[:split], pattern[split + 1 :]
    start = place + len(first)
    if tuple(words[place:start]) != first:
        return None
    for end in range(start, start + MOST_BETWEEN + 1):
        if tuple(words[end : end + len(last)]) == last:
            return start, end, end + len(last)
        in_number = any(_number_end(words, number) > end for number in range(start, end))  # takes two or three steps
        if end >= len(words) or (words[end] in NO_GAP and not in_number):
            return None
    return None


def _is(word: str, kind: str, **slots: object) -> bool:
    """Whether a word is of a kind of tokens by itself, and tells these slots."""
    entries = (entry for entry in _index().get(word, ()) if entry.kind == kind and entry.words == (word,))
    return any(slots.items() <= entry.slots.items() for entry in entries)


def _measure(words: list[str], place: int) -> tuple[Token, int] | None:
    """The token of a number of times or of seconds that begins at a place, and where it ends.

    A number that compares, is a rate, tells of each repetition or of a pause is reported and fills no slot."""
    measure = _said_measure(words, place)
    if measure is None:
        return _unread_range(words, place)
    token, after = measure
    follows, then = (words[at] if at < len(words) else "" for at in (after, after + 1))
    if _is_rate(words, after):
        return _told(words, place, after + 1 + int(follows not in RATES), {}, kind="reported")
    pause = after + int(follows == "in")  # 5 s in between
    if "duration_s" in token.slots and words[pause : pause + 1] and words[pause] in NO_DURATION:
        return _told(words, place, pause + 1, {}, kind="reported")
    before = " ".join(words[max(place - 4, 0) : place])
    if follows == "pause" and before.endswith(("with", "with a")):
        return _told(words, place, after + 1, {}, kind="reported")
    if "duration_s" in token.slots and before.endswith(BETWEEN):
        return _told(words, place, after, {}, kind="reported")
    if words[max(place - 3, 0) : place] in (["and", "at", "most"], ["and", "at", "least"]):
        return _told(words, place, after, {}, kind="reported")
    begins = place == 0 or _is(words[place - 1], "join")  # 5 seconds before falling, he jumps
    relative = words[place] != "for" and (follows == "after" or (begins and follows == "before"))
    compares = follows in lexicon().compared and (
        follows != "as" or (then and then not in (*lexicon().not_once, *AS_JOINS))
    )
    if ("duration_s" in token.slots and relative) or ("count" in token.slots and compares):
        return _told(words, place, after + int(follows == "as"), {}, kind="reported")
    reading = number_at(words, place)
    more = "more" in (follows, *words[reading.end : reading.end + 1]) if reading is not None else follows in MORE
    more = more or words[max(place - 1, 0)] == "another"
    return (replace(token, kind="again"), after) if more and token.kind == "slot" else measure


def _unread_range(words: list[str], place: int) -> tuple[Token, int] | None:
    """Two measures that span no range, which are reported as a whole: between 5 s and 2 jumps, between 2 times and 4."""
    measure = _measure(words, place + 1) if words[place] == "between" and words[place + 1 :] else None
    if measure is None:
        return None
    after = measure[1]
    if words[after : after + 1] == ["and"] and words[after + 1 :]:
        measure = _measure(words, after + 1)
        after = measure[1] if measure is not None else max(_number_end(words, after + 1), after)
    return _told(words, place, after, {}, kind="reported")


def _is_rate(words: list[str], place: int) -> bool:
    """Whether what follows a number of times or of seconds tells of how long it is: a day, per second, daily."""
    follows, then = (words[at] if at < len(words) else "" for at in (place, place + 1))
    divides = follows in ("per", "/", "a", "an", "each", "every")
    return follows in RATES or (divides and then in (*lexicon().seconds, *PERIODS))


def _said_measure(words: list[str], place: int) -> tuple[Token, int] | None:
    word, follows = words[place], words[place + 1 : place + 2]
    ranged = number_at(words, place) is not None  # once or twice, from 5 to 10 s
    if word in lexicon().times and not ranged:
        conjunction = word == "once" and (
            (follows and follows[0] in lexicon().not_once) or words[max(place - 1, 0)] == "at"
        )
        conjunction = conjunction and not _is_rate(words, place + 1)
        return None if conjunction else (Token("slot", word, {"count": lexicon().times[word]}), place + 1)
    if word in ("for", *CLOCK) and follows and not ranged:
        of_verb = follows[0] == "the" and word in ("after", "before")  # after the 10 s walk
        start = place + 1 + int(follows[0] in lexicon().roughly and not of_verb)
        lasting = _lasting(words, start, alone=False)
        if lasting is None:
            return None
        token, after = lasting
        if word != "for" and (words[after - 1].startswith("moment") or words[after : after + 1] == ["of"]):
            return None  # after 5 s of walking
        if word != "for":
            return _told(words, place, after, {}, kind="reported")
        said: tuple[Token, int] | None = (replace(token, note=token.note and f"for {token.note}"), after)
    else:
        said = _turned(words, place) or _times(words, place) or _lasting(words, place, alone=True)
    factor = _factor(words, said[1]) if said is not None and "duration_s" in said[0].slots else None
    near = f" {' '.join(words[max(place - 3, 0) : place + 2])} "
    if said is None or factor is None or any(total in near for total in TOTAL):
        return said
    return _multiplied(words, place, factor.end, factor, (said[0], factor.end))


def _factor(words: list[str], place: int) -> Reading | None:
    """How many times what lasts is done, where that is said behind it: 10 s x 2, 5 s twice; 5 s, three times."""
    if words[place : place + 1] and words[place] in BY:
        return number_at(words, place + 1)
    start = place + int(words[place : place + 1] != [] and words[place] in ",;()")
    token, after = (words[start:] and _measure(words, start)) or (Token("", ""), start)
    if token.kind != "slot" or words[after - 1] not in (*TIMES, *lexicon().times):
        return None
    rest = [*takewhile(lambda word: not _is(word, "join"), words[after:])]
    next_deed = start > place and any(word == "for" or _is(word, "action") for word in rest)  # for 5 s, twice he jumps
    if next_deed or " ".join(rest).startswith(IN_ALL):
        return None
    return Reading(float(str(token.slots["count"])), token.note != "", after)


def _times(words: list[str], place: int) -> tuple[Token, int] | None:
    """The token of how many times something is done: "four times", "x 3", "two slow turns", "3 sets of 5 squats", "2 x 5 s"."""
    by = words[place : place + 1] != [] and words[place] in BY
    reading = number_at(words, place + int(by))
    if reading is None:
        return None
    number, vague, after = reading
    after += int(words[after : after + 1] == ["more"])
    follows, behind = (words[at] if at < len(words) else "" for at in (after, after + 1))
    if by or words[reading.end - 1] in lexicon().times:  # x 3; once or twice
        return _counted(words, place, after, reading, "" if by else "times")
    if follows == "time" and words[place] not in ("a", "an"):
        return _counted(words, place, after + 1, reading, "times")
    if follows in TIMES:
        said = _times(words, after + 1) if words[after + 1 : after + 2] != ["up"] else None
        return _multiplied(words, place, after + 1, reading, said)
    if follows in BY or (follows in SETS and behind in ("of", *BY)):
        start = after + 1 + int(follows in SETS)
        single = number_at(words, start) if _turned(words, start) is None else None
        said = _times(words, start) or _lasting(words, start, alone=True)
        return _multiplied(
            words, place, start, reading, said or (single and _counted(words, start, single.end, single))
        )
    climbed = next((word for word in reversed(words[:place]) if word not in lexicon().roughly), "")
    person = next((word for word in reversed(words[:place]) if word not in (*AGED, *lexicon().roughly)), "")
    opens = person.isalpha() and (place == 1 or not words[place - 2].isalnum())
    # Participant 2 jumps.
    labelled = opens and not person.endswith(("s", "ly", "ed", "ing")) and person not in _vocabulary()
    if follows in TREADS and (
        follows != "steps" or climbed in ("up", "down") or _is(climbed, "action", action="climb")
    ):
        read = f"{number:g} stairs" if vague else ""
        return _told(words, place, after + 1, {"object": "stair", "count": _whole(number)}, read, "object")
    # A couple who dances; patient 2 walks, a man aged 70 falls.
    if words[after - 1] == "couple" or _is(person, "subject") or labelled:
        return None
    angle = _turned(words, after)  # two 360 degree turns
    turns = angle is not None and words[angle[1] : angle[1] + 1] == ["turns"]
    many = number != 1 or vague or words[place] == "1"
    return _counted(words, place, after, reading) if turns or (many and _deed(words, after)) else None


def _counted(words: list[str], place: int, after: int, reading: Reading, unit: str = "") -> tuple[Token, int]:
    """A token of a count; of a vague number or a range, with what is read for it."""
    read = f"{reading.number:g} {unit}".strip() if reading.vague else ""
    return _told(words, place, after, {"count": _whole(reading.number)}, read)


def _multiplied(
    words: list[str], place: int, start: int, reading: Reading, said: tuple[Token, int] | None
) -> tuple[Token, int]:
    """So many times, or so many times what is done as often or as long as is said behind it: 3 sets of 5 squats."""
    if said is None:
        return _counted(words, place, start, reading, "times")
    token, after = said
    count, lasting_s = (float(str(token.slots.get(slot, least))) for slot, least in (("count", 1), ("duration_s", 0)))
    product = Reading(reading.number * count, reading.vague or token.note != "", after)
    whole, _ = _counted(words, place, after, product)
    if not lasting_s:
        return whole, after
    read = f"{product.number:g} x {lasting_s:g} s" if product.vague else ""
    return _told(words, place, after, {**whole.slots, "duration_s": reading.number * lasting_s}, read)


def _deed(words: list[str], place: int) -> bool:
    """Whether a noun of several deeds stands at a place, behind two modifiers at most: hops, quick jumps."""
    for after in range(place, min(place + 3, len(words))):
        for entry in _index().get(words[after], ()):
            plural = entry.words[-1].endswith("s") and entry.words != ("steps",)
            if entry.kind == "action" and plural and GAP not in entry.words and _match(entry.words, words, after):
                return True
        if words[after] not in SIZES and not any(_is(words[after], kind) for kind in MODIFYING):
            return False
    return False


def _whole(number: float) -> float:
    return int(number) if float(number).is_integer() else number


def _lasting(words: list[str], place: int, *, alone: bool) -> tuple[Token, int] | None:
    """How long: ten seconds, 1 1/2 minutes, a few seconds; where it stands `alone`, behind no "for", not a moment or a second."""
    reading = amount_at(words, place)
    if reading is None or reading[1] >= len(words) or words[reading[1]] not in lexicon().seconds:
        return None
    number, after = reading
    unit, follows = words[after], words[after + 1 : after + 2]
    if (alone and (words[place] in ("a", "an") or unit.startswith("moment"))) or follows == ["time"]:
        return None
    seconds, read = (
        float(number) * lexicon().seconds[unit],
        "" if unit.startswith("moment") or number < 1 else f"{number:g} {unit}",
    )
    start = after + 1 + int(follows == ["and"])
    more = _lasting(words, start, alone=True)
    more_s = float(str(more[0].slots.get("duration_s", math.inf))) if more is not None else math.inf
    part, vague = fraction_at(words, after + 2) if follows == ["and"] else None, is_vague(words, place)
    smaller = more_s < lexicon().seconds[unit]
    if more is not None and len(linked_numbers(words, place if smaller else start)[0]) > 1:
        return _told(words, place, more[1], {}, kind="reported")  # 45 s to 1 minute 30 s, 1 minute 30 s to 2 minutes
    if more is not None and smaller:  # a minute and ten seconds
        seconds, after, read, vague = seconds + more_s, more[1] - 1, "", vague or more[0].note != ""
    elif part is not None:  # a minute and a half
        seconds, after, read = seconds + part[0] * lexicon().seconds[unit], part[1] - 1, ""
    vague = vague or unit.startswith("moment")
    return _told(words, place, after + 1, {"duration_s": seconds}, (read or f"{seconds:g} seconds") if vague else "")


def _turned(words: list[str], place: int) -> tuple[Token, int] | None:
    """By which angle somebody turns: 90 degrees, 1.57 radians, half a turn, a right angle; a hundred and eighty is not read.

    Whole turns are counted as other actions are, and the word turn tells of the action, too.
    """
    reading = amount_at(words, place)
    if reading is None:
        return None
    amount, after = reading
    unit = words[after] if after < len(words) else ""
    unit_deg = lexicon().degrees.get(unit)
    turns = unit in ("turn", "turns") and not float(amount).is_integer()
    if turns:
        unit_deg = 360.0
    elif unit == "right" and words[after + 1 : after + 2] in (["angle"], ["angles"]):
        unit_deg, after = 90.0, after + 1
    elif unit_deg is None and "pi" in words[place:after]:
        unit_deg, after = math.degrees(1), after - 1
    if unit_deg is None:
        return None
    angle_deg = float(amount * unit_deg)
    read = f"{angle_deg:g} degrees" if is_vague(words, place) else ""
    token, after = _told(words, place, after + 1, {"angle_deg": angle_deg}, read, "angle")
    return token, after - int(turns)


def _meant(word: str) -> str | None:
    """The one word of the lexicon that differs from a misspelt one by one letter; None where there is none, or several."""
    vocabulary = _vocabulary()
    if (
        word in vocabulary
        or word.removesuffix("s") in PARTS
        or len(word) < SHORTEST_SLIP
        or not word.isalpha()
        or word in (*lexicon().not_misspelt, *lexicon().compared)
    ):
        return None
    letters = "abcdefghijklmnopqrstuvwxyz"
    places = range(len(word) + 1)
    near = {word[:n] + word[n + 1 :] for n in places[1:-1]}
    exchanged = {word[:n] + word[n + 1] + word[n] + word[n + 2 :] for n in places[:-2]}
    near |= {word[:n] + letter + word[n:] for n in places for letter in letters}
    if len(word) >= SHORTEST_SWAP:
        near |= {word[:n] + letter + word[n + 1 :] for n in places[1:-1] for letter in letters}
    for guesses in (exchanged, exchanged | near):  # two exchanged letters are the likeliest
        candidates = {guess for guess in guesses & vocabulary if len(guess) >= SHORTEST_SLIP}
        if len(candidates) == 1:
            return candidates.pop()
    return None
