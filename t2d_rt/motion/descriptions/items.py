"""A sentence as a row of items: the words and phrases of the lexicon in it, each with what it stands for."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache

from t2d_rt.motion.descriptions import lexicon, nouns
from t2d_rt.motion.descriptions.inflect import Forms, forms

TOKEN = re.compile(r"\d+(?:\.\d+)?|[^\W\d_]+(?:'[^\W\d_]+)?|n't|[^\w\s]")
GAP = "~"
MOST_BETWEEN = 4
"""Words that `~` stands for at most: "picks the red ball up"."""

HIS = ("his", "her", "their", "its", "the")
HIM = ("him", "her", "them", "it")
_NUMBERS = """
zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen
eighteen nineteen twenty
"""
NUMBERS = {word: number for number, word in enumerate(_NUMBERS.split())} | {
    "thirty": 30, "forty": 40, "fifty": 50, "sixty": 60, "ninety": 90, "a": 1, "an": 1,
}  # fmt: skip
SOME = {"couple": 2, "few": 3, "several": 4}
"""Words for some small number; all but a couple are vague, and how they were read is told."""
TIMES = {"once": 1, "twice": 2, "thrice": 3}
NOT_ONCE = frozenset(("he", "she", "they", "the", "a", "an", "his", "her", "again", "more", "upon"))
"""What follows a `once` that is no count: once he has sat down."""
SECONDS = {
    "second": 1.0, "seconds": 1.0, "sec": 1.0, "secs": 1.0, "s": 1.0, "minute": 60.0, "minutes": 60.0, "min": 60.0,
    "mins": 60.0, "moment": 1.0, "moments": 1.0,
}  # fmt: skip
ROUGHLY = frozenset(
    ("about", "around", "roughly", "exactly", "approximately", "some", "another", "only", "just", "the", "next", "full")
)
"""Words between "for" and a duration."""

SHORTEST_SLIP, SHORTEST_SWAP = 5, 6
"""Letters of a word in which a letter too many, too few or two exchanged ones are read as a slip; and a wrong letter."""
_NO_SLIPS = "filling filled felling willing waking ruining staring filed tipping shipping turning burning"
NO_SLIPS = frozenset(_NO_SLIPS.split())
"""Words of their own that are one letter from one of the lexicon."""


@dataclass(frozen=True, slots=True)
class Item:
    """A word or phrase and what it stands for."""

    kind: str
    words: str
    slots: Mapping[str, object] = field(default_factory=dict)
    gerund: bool = False
    note: str = ""
    """The known word as which a misspelt one was read."""
    partly: bool = False
    """Whether it says more than is made of it."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A phrase of the lexicon."""

    tokens: tuple[str, ...]
    kind: str
    slots: Mapping[str, object]
    gerund: bool = False
    partly: bool = False


def tokens_of(text: str) -> list[str]:
    """Words, numbers and signs in lower case; hyphens part words, dashes are commas.

    >>> tokens_of("High-stepping, it's 2.5 s!")
    ['high', 'stepping', ',', "it's", '2.5', 's', '!']
    """
    plain = unicodedata.normalize("NFKC", text).lower().translate({0x2019: "'", 0x2018: "'", 0x2014: ",", 0x2013: ","})
    return TOKEN.findall(re.sub(r"(?<=\w)-(?=\w)", " ", re.sub(r"\s-+\s", " , ", plain)))


def meanings(table: Mapping[str, str]) -> Iterator[tuple[str, dict[str, object], str]]:
    """Every phrase of a table with its head and slots: ("walk", {"speed": "slow"}, "stroll")."""
    for key, phrases in table.items():
        *head, rest = key.split() if "=" in key.split()[-1] else (*key.split(), "")
        slot, _, value = rest.partition("=")
        slots: dict[str, object] = {slot: value} if rest else {}
        for phrase in phrases.split("|"):
            yield " ".join(head), slots, phrase.strip()


def _spelled(phrase: str) -> Iterator[str]:
    """A phrase with each possessive in the place of {his}."""
    for his in HIS if "{his}" in phrase else ("",):
        for him in HIM if "{him}" in phrase else ("",):
            yield phrase.replace("{his}", his).replace("{him}", him)


def _verb_entries(phrase: str, kind: str, slots: Mapping[str, object]) -> Iterator[Entry]:
    verbs = [each.partition(" ") for each in phrase.split(" and ")]  # slip and fall
    for name in Forms._fields:
        inflected = " and ".join(f"{getattr(forms(verb), name)} {rest}" for verb, _, rest in verbs)
        for spelled in _spelled(inflected):
            yield Entry(tuple(tokens_of(spelled)), kind, slots, gerund=name == "gerund", partly=phrase in _partly())


@cache
def _partly() -> frozenset[str]:
    return frozenset(each.strip() for each in lexicon.PARTLY.split("|"))


def _entries() -> Iterator[Entry]:
    for table in (lexicon.VERBS, lexicon.MORE_VERBS):
        for head, slots, phrase in meanings(table):
            weak, _, action = head.rpartition(" ")
            yield from _verb_entries(phrase, "weak" if weak else "action", {"action": action, **slots})
    for kind, phrases in (("attend", lexicon.ATTENDING), ("other", lexicon.OTHER_ACTIONS)):
        for phrase in phrases.split("|"):
            yield from _verb_entries(phrase.strip(), kind, {})
    for phrase in lexicon.RECOVERING.split("|"):
        yield from _verb_entries(phrase.strip(), "recover", {})
    for _, slots, phrase in meanings(lexicon.ATTENDING_PARTS):
        yield from _verb_entries(phrase, "attend", slots)
    modifiers = (lexicon.ADVERBS, lexicon.PHRASES, lexicon.ADJECTIVES, lexicon.MORE_MODIFIERS)
    for table in modifiers:
        yield from (Entry(t, "slot", slots) for _, slots, phrase in meanings(table) for t in _all(phrase))
    for slot, kind, table in (
        ("subject", "subject", nouns.SUBJECTS), ("subject", "subject", nouns.MORE_SUBJECTS), ("object", "object", nouns.OBJECTS),
        ("direction", "direction", nouns.DIRECTIONS), ("type", "gait", nouns.GAITS), ("type", "gait", nouns.MORE_GAITS),
        ("type", "cause", nouns.FALLS), ("body_part", "part", nouns.PARTS),
    ):  # fmt: skip
        for value, phrases in table.items():
            for phrase in phrases.split("|"):
                yield from (Entry(t, kind, {slot: value}) for t in _all(phrase.strip()))
                if kind == "part" and value != "waist":
                    for side in ("left", "right"):
                        yield Entry((side, *tokens_of(phrase)), kind, {slot: value, "side": side})
    for kind, phrases in (
        ("fixed", nouns.FIXED),
        ("reported", nouns.REPORTED),
        ("spot", nouns.ON_THE_SPOT),
        ("not", lexicon.NOT),
    ):
        yield from (Entry(t, kind, {}) for phrase in phrases.split("|") for t in _all(phrase.strip()))
    for join, phrases in nouns.PHRASES_OF_TIME.items():
        yield from (Entry(tuple(tokens_of(phrase)), "join", {"join": join}) for phrase in phrases.split("|"))


def _all(phrase: str) -> Iterator[tuple[str, ...]]:
    return (tuple(tokens_of(spelled)) for spelled in _spelled(phrase))


@cache
def _index() -> dict[str, list[Entry]]:
    """Entries by their first word, the longest first; of equal ones the earlier."""
    found: dict[str, list[Entry]] = {}
    for entry in _entries():
        if entry.tokens:
            found.setdefault(entry.tokens[0], []).append(entry)
    return {
        word: sorted(entries, key=lambda entry: (-len(entry.tokens), GAP in entry.tokens, entry.kind == "other"))
        for word, entries in found.items()
    }


@cache
def _part_words() -> list[list[str]]:
    return [[phrase.strip()] for phrases in nouns.PARTS.values() for phrase in phrases.split("|")]


@cache
def _vocabulary() -> frozenset[str]:
    words = {token for entries in _index().values() for entry in entries for token in entry.tokens}
    return frozenset(
        words | nouns.NEUTRAL | nouns.OF_LIMBS | NUMBERS.keys() | TIMES.keys() | SECONDS.keys() | {"times"}
    ) - {GAP}


def items_of(sentence: str) -> list[Item]:
    """The items of a sentence, in its order."""
    tokens: list[str] = []
    notes: dict[int, str] = {}
    for token in tokens_of(sentence):
        meant = _meant(token)
        if meant is not None:
            notes[len(tokens)] = token
        tokens.append(meant or token)
    found: list[Item] = []
    place = 0
    while place < len(tokens):
        items, after = _next(tokens, place)
        misspelt = [notes[each] for each in range(place, after) if each in notes]
        if misspelt and items[0].kind == "unknown":
            items = [Item("unknown", misspelt[0])]
        elif misspelt:
            items = [Item(each.kind, each.words, each.slots, each.gerund, " ".join(misspelt)) for each in items]
        found += items
        place = after
    return found


def _next(tokens: list[str], place: int) -> tuple[list[Item], int]:
    """The item that begins at a token, with those within its gap; and where the next one begins."""
    measure = _measure(tokens, place)
    if measure is not None:
        return [measure[0]], measure[1]
    for entry in _index().get(tokens[place], ()):
        within = _match(entry.tokens, tokens, place)
        if within is None:
            continue
        gap, after = within
        if (
            entry.kind == "direction"
            and entry.tokens[-1] in ("left", "right")
            and tokens[after : after + 1] in _part_words()
        ):
            continue  # on his left foot
        item = Item(entry.kind, " ".join(tokens[place:after]), entry.slots, entry.gerund, partly=entry.partly)
        inner = items_of(" ".join(gap)) if gap else []
        counted = [NUMBERS[word] for word in gap if word in NUMBERS and word not in ("a", "an")]
        inner = [each for each in inner if not counted or each.words not in NUMBERS]
        if counted and entry.tokens[-1] in ("step", "steps"):
            inner.append(Item("reported", next(word for word in gap if NUMBERS.get(word) == counted[0])))
        elif counted:
            inner.append(Item("slot", str(counted[0]), {"count": counted[0]}))
        kept = ("slot", "direction", "object", "unknown", "gait", "reported")
        return [item, *(each for each in inner if each.kind in kept)], after
    word = tokens[place]
    if word.endswith("n't") or word == "cannot":
        return [Item("not", word)], place + 1
    known = word in nouns.NEUTRAL or word in ("zero", "one", "a", "an") or not any(char.isalnum() for char in word)
    kind = "of limb" if word in nouns.OF_LIMBS else "neutral" if known else "unknown"
    return [Item(kind, word)], place + 1


def _match(pattern: tuple[str, ...], tokens: list[str], place: int) -> tuple[list[str], int] | None:
    """The words that `~` stands for, and where the phrase ends; None where it does not stand here."""
    if GAP not in pattern:
        after = place + len(pattern)
        return ([], after) if tuple(tokens[place:after]) == pattern else None
    split = pattern.index(GAP)
    first, last = pattern[:split], pattern[split + 1 :]
    start = place + len(first)
    if tuple(tokens[place:start]) != first:
        return None
    for end in range(start, start + MOST_BETWEEN + 1):
        if tuple(tokens[end : end + len(last)]) == last:
            return tokens[start:end], end + len(last)
        if end >= len(tokens) or tokens[end] in ("and", "then", ",", ".", "before", "after", "while", "to"):
            return None
    return None


def _measure(tokens: list[str], place: int) -> tuple[Item, int] | None:
    """A number of times or of seconds that begins at a token."""
    word, rest = tokens[place], tokens[place + 1 : place + 5]
    if word in TIMES:
        conjunction = word == "once" and ({*rest[:1]} & NOT_ONCE or tokens[max(place - 1, 0)] == "at")
        return None if conjunction else (Item("slot", word, {"count": TIMES[word]}), place + 1)
    if word in ("for", "after") and rest:
        start = place + 1 + int(word == "for" and rest[0] in ROUGHLY)
        inner = _lasting(tokens, start, alone=False)
        if inner is None or (word == "after" and inner[0].note.endswith("moment")):
            return None
        return inner if word == "for" else (Item("reported", f"after {inner[0].words}"), inner[1])
    return _times(tokens, place) or _lasting(tokens, place, alone=True)


def _number(tokens: list[str], place: int) -> tuple[float, bool, int] | None:
    """A number that begins at a token, whether it is a vague one, and where it ends: ten, twenty five, a few, a couple of, 2.5."""
    words = tokens[place : place + 3]
    if words and words[0] == "a" and words[1:2] and words[1] in SOME:
        words, place = words[1:], place + 1
    if not words:
        return None
    if words[0] in SOME:
        return SOME[words[0]], words[0] != "couple", place + 1 + int(words[1:2] == ["of"])
    if words[0][0].isdigit():
        return float(words[0]), False, place + 1
    number = NUMBERS.get(words[0])
    if number is None:
        return None
    ones = NUMBERS.get(words[1]) if number >= 20 and words[1:] else None
    return (number + ones, False, place + 2) if ones is not None and 0 < ones < 10 else (number, False, place + 1)


def _times(tokens: list[str], place: int) -> tuple[Item, int] | None:
    """How many times: four times, a few times; and four hops."""
    found = _number(tokens, place)
    if found is None or found[2] >= len(tokens):
        return None
    number, vague, after = found
    whole = int(number) if number == int(number) else number
    follows = tokens[after]
    if follows == "times" or (follows == "time" and tokens[place] not in ("a", "an")):
        words = " ".join(tokens[place : after + 1])
        return Item(
            "slot", f"{whole} times" if vague else words, {"count": whole}, note=words if vague else ""
        ), after + 1
    deeds = any(entry.kind == "action" and entry.tokens == (follows,) for entry in _index().get(follows, ()))
    if deeds and follows.endswith("s") and follows != "steps" and number > 1:
        return Item("slot", tokens[place], {"count": whole}), after
    return None


def _lasting(tokens: list[str], place: int, *, alone: bool) -> tuple[Item, int] | None:
    """How long: ten seconds, half a minute, a few seconds; where it stands `alone`, behind no "for", not a moment or a second."""
    words = tokens[place : place + 3]
    half = words[:2] in (["half", "a"], ["half", "an"])
    found = (0.5, False, place + 2) if half else _number(tokens, place)
    if found is None or found[2] >= len(tokens) or tokens[found[2]] not in SECONDS:
        return None
    number, vague, after = found
    unit = tokens[after]
    if alone and (words[0] in ("a", "an") or unit.startswith("moment")):
        return None
    said = " ".join(tokens[place : after + 1])
    seconds = float(number) * SECONDS[unit]
    vague = vague or unit.startswith("moment")
    return Item(
        "slot", f"{seconds:g} seconds" if vague else said, {"duration_s": seconds}, note=said if vague else ""
    ), after + 1


def _meant(word: str) -> str | None:
    """The one word of the lexicon that differs from a misspelt one by one letter; None where there is none, or several."""
    known = _vocabulary()
    if word in known or len(word) < SHORTEST_SLIP or not word.isalpha() or word in NO_SLIPS:
        return None
    letters = "abcdefghijklmnopqrstuvwxyz"
    places = range(len(word) + 1)
    near = {word[:n] + word[n + 1 :] for n in places[1:-1]}
    exchanged = {word[:n] + word[n + 1] + word[n] + word[n + 2 :] for n in places[:-2]}
    near |= {word[:n] + letter + word[n:] for n in places for letter in letters}
    if len(word) >= SHORTEST_SWAP:
        near |= {word[:n] + letter + word[n + 1 :] for n in places[1:-1] for letter in letters}
    for guesses in (exchanged, exchanged | near):  # two exchanged letters are the likeliest
        found = {each for each in guesses & known if len(each) >= SHORTEST_SLIP}
        if len(found) == 1:
            return found.pop()
    return None
