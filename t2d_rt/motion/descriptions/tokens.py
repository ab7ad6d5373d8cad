"""A sentence as a row of tokens: the words and phrases of the lexicon in it, each with what it stands for."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

from t2d_rt.motion.descriptions.lexicon import Forms, Synonyms, inflected, lexicon, meaning
from t2d_rt.motion.descriptions.numbers import number_at, with_ranges

WORD = re.compile(r"\d+(?:\.\d+)?(?:e\d+(?!\w))?|[^\W\d_]+(?:'[^\W\d_]+)?|n't|[^\w\s]")
COMMA = re.compile(r"(?<![\d.,])(\d+),(\d+)(?![.,]?\d)")
"""A decimal comma within a number; commas between three numbers and more part a list."""
GAP = "~"
MOST_BETWEEN = 4
"""Words that `~` stands for at most: "picks the red ball up"."""

BY, SETS = ("x", "\u00d7", "*"), (["sets", "of"], ["rounds", "of"], ["series", "of"])
"""What stands between how many times and what is done: 2 x 90 degrees, 3 sets of 5 squats."""

DASH = re.compile(r"(?<=\d)\s*[-\u2010-\u2015\u2212]\s*(?=\d)")
"""What stands between the ends of a range: 2-3."""

AS_JOINS = "if", "though", "in", "it", "well", "before"
"""What follows an "as" that compares nothing."""

PARTS = {"half": 0.5, "third": 1 / 3, "quarter": 0.25}
"""Parts of a turn or of a unit of angles."""

HIS = ("his", "her", "their", "its", "the")
HIM = ("him", "her", "them", "it")
SELF = ("himself", "herself", "themself", "themselves")

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


def words_of(text: str) -> list[str]:
    """Words, numbers and signs in lower case; hyphens part words, dashes are commas, signs of degrees and pi are words.

    A dash between numbers is "to".

    >>> words_of("High-stepping, it's 2.5 s!")
    ['high', 'stepping', ',', "it's", '2.5', 's', '!']
    >>> words_of("1,5 turns, 1,000 steps, 1½ or .5")
    ['1.5', 'turns', ',', '1000', 'steps', ',', '1', '1', '/', '2', 'or', '0.5']
    """
    apart = re.sub(r"(?<=\d)(?=[¼-¾⅐-⅞])", " ", re.sub(r"(?<=\d)\s*[°º]", " degrees ", DASH.sub(" to ", text)))
    signs = {0x2019: "'", 0x2018: "'", 0x2014: ",", 0x2013: ",", 0x2044: "/", 0x3C0: "pi"}
    lowered = COMMA.sub(_with_point, unicodedata.normalize("NFKC", apart).lower().translate(signs))
    lowered = re.sub(r"(?<![\w.])\.(?=\d)", "0.", lowered)
    return WORD.findall(re.sub(r"(?<=\w)-(?=\w)", " ", re.sub(r"\s-+\s", " , ", lowered)))


def _with_point(number: re.Match[str]) -> str:
    """A number with a comma: before three digits that parts thousands, as in English, else it is a decimal comma."""
    whole, rest = number.groups()
    thousands = len(rest) == 3 and len(whole) <= 3 and not whole.startswith("0")
    return f"{whole}{rest}" if thousands else f"{whole}.{rest}"


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
    for join, phrases in lexemes.joins.items():
        yield from (Entry(tuple(words_of(phrase)), "join", {"join": join}) for phrase in phrases)


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
def _body_parts() -> frozenset[str]:
    return frozenset(phrase for phrases in lexicon().body_parts.values() for phrase in phrases)


@cache
def _vocabulary() -> frozenset[str]:
    """All words that are understood, which a misspelt one may mean."""
    lexemes = lexicon()
    words = {word for entries in _index().values() for entry in entries for word in entry.words}
    more = {*lexemes.of_limbs, *lexemes.numbers, *lexemes.times, *lexemes.seconds, *lexemes.degrees, "times"}
    return frozenset(words | more | {*lexemes.neutral}) - {GAP}


def tokens_of(sentence: str) -> list[Token]:
    """The tokens of a sentence, in its order."""
    words: list[str] = []
    notes: dict[int, str] = {}
    read, ranges = with_ranges(words_of(sentence))
    for word in read:
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
        for number in (number for number in range(place, after) if number in ranges):
            rest = number + 1 + int(ranges[number].split()[-1] in lexicon().times)
            said = [*spoken[: number - place], ranges[number], *spoken[rest - place :]]
            tokens = _with_range(tokens, words[number], ranges[number], " ".join(said))
        sentence_tokens += tokens
        place = after
    return sentence_tokens


def _with_range(tokens: list[Token], number: str, said: str, phrase: str) -> list[Token]:
    """Tokens of a phrase in which a number was read for a range, with what was said; a range that measures nothing is reported."""
    measures = [token for token in tokens if token.slots.keys() & {"count", "duration_s", "angle_deg"}]
    if not measures:
        other = [token for token in tokens if token.slots or number not in token.words.split()]
        return [*other, Token("reported", said if other else phrase)]
    note = phrase if measures[0] is tokens[0] else said
    return [replace(token, note=note) if token is measures[0] else token for token in tokens]


def _next(words: list[str], place: int) -> tuple[list[Token], int]:
    """The token that begins at a word, with those within its gap; and where the next one begins."""
    measure = _measure(words, place)
    if measure is not None:
        return [measure[0]], measure[1]
    for entry in _index().get(words[place], ()):
        within = _match(entry.words, words, place)
        if within is None:
            continue
        gap, after = within
        of_part = after < len(words) and words[after] in _body_parts()
        if entry.kind == "direction" and entry.words[-1] in ("left", "right") and of_part:
            continue  # on his left foot
        token = Token(entry.kind, " ".join(words[place:after]), entry.slots, entry.gerund, partly=entry.partly)
        inner = tokens_of(" ".join(gap)) if gap else []
        digits = {word: int(word) for word in gap if word.isdecimal()}
        numbers = {**lexicon().numbers, **lexicon().some, **digits} if gap else {}
        counted = [numbers[word] for word in gap if word in numbers and word not in ("a", "an")]
        counted = [] if any("count" in inner_token.slots for inner_token in inner) else counted
        inner = [inner_token for inner_token in inner if not counted or inner_token.words not in numbers]
        if counted and entry.words[-1] in ("step", "steps"):
            inner.append(Token("reported", next(word for word in gap if numbers.get(word) == counted[0])))
        elif counted:
            vague = next((word for word in gap if word in lexicon().some and word != "couple"), "")
            inner.append(Token("slot", str(counted[0]), {"count": counted[0]}, note=vague))
        kinds = ("slot", "direction", "object", "unknown", "gait", "reported")
        return [token, *(inner_token for inner_token in inner if inner_token.kind in kinds)], after
    word = words[place]
    if word.endswith("n't") or word == "cannot":
        return [Token("not", word)], place + 1
    neutral = (
        word in lexicon().neutral or word in ("zero", "one", "a", "an") or not any(char.isalnum() for char in word)
    )
    kind = "of limb" if word in lexicon().of_limbs else "neutral" if neutral else "unknown"
    return [Token(kind, word)], place + 1


def _match(pattern: tuple[str, ...], words: list[str], place: int) -> tuple[list[str], int] | None:
    """The words that `~` stands for, and where the phrase ends; None where it does not stand here."""
    if GAP not in pattern:
        after = place + len(pattern)
        return ([], after) if tuple(words[place:after]) == pattern else None
    split = pattern.index(GAP)
    first, last = pattern[:split], pattern[split + 1 :]
    start = place + len(first)
    if tuple(words[place:start]) != first:
        return None
    for end in range(start, start + MOST_BETWEEN + 1):
        if tuple(words[end : end + len(last)]) == last:
            return words[start:end], end + len(last)
        if end >= len(words) or words[end] in ("and", "or", "then", ",", ".", "before", "after", "while", "to"):
            return None
    return None


def _measure(words: list[str], place: int) -> tuple[Token, int] | None:
    """A number of times or of seconds that begins at a token; one that compares, or is of each time, is reported."""
    measure = _said_measure(words, place)
    if measure is None:
        return None
    token, after = measure
    follows, said = words[after : after + 2], " ".join(words[place:after])
    if "duration_s" in token.slots and (follows[:1] == ["each"] or follows[:1] == ["every"]):
        return Token("reported", f"{said} {follows[0]}"), after + 1
    compares = follows[:1] and follows[0] in lexicon().compared and "count" in token.slots
    if compares and not (follows[0] == "as" and (len(follows) == 1 or follows[1] in (*lexicon().not_once, *AS_JOINS))):
        return Token("reported", f"{said} as" if follows[0] == "as" else said), after + int(follows[0] == "as")
    return measure


def _said_measure(words: list[str], place: int) -> tuple[Token, int] | None:
    word, rest = words[place], words[place + 1 : place + 5]
    if word in lexicon().times:
        conjunction = word == "once" and ((rest and rest[0] in lexicon().not_once) or words[max(place - 1, 0)] == "at")
        return None if conjunction else (Token("slot", word, {"count": lexicon().times[word]}), place + 1)
    if word in ("for", "after", "every") and rest:
        start = place + 1 + int(word == "for" and rest[0] in lexicon().roughly)
        inner = _lasting(words, start, alone=False)
        if inner is None or (word == "after" and inner[0].note.endswith("moment")):
            return None
        return inner if word == "for" else (Token("reported", f"{word} {inner[0].words}"), inner[1])
    return _turned(words, place) or _times(words, place) or _lasting(words, place, alone=True)


def _times(words: list[str], place: int) -> tuple[Token, int] | None:
    """How many times: four times, a few times; and four hops."""
    reading = number_at(words, place)
    if reading is None and words[place] in BY:
        reading = number_at(words, place + 1)
        return reading and (
            Token("slot", " ".join(words[place : reading[2]]), {"count": _whole(reading[0])}),
            reading[2],
        )
    if reading is None or reading[2] >= len(words):
        return None
    number, vague, after = reading
    whole = _whole(number)
    follows = words[after]
    start = after + 1 if follows in BY else after + 2 if words[after : after + 2] in SETS else 0
    if start:
        more, lasting = number_at(words, start), _lasting(words, start, alone=True)
        if lasting is not None:  # 2 x 5 s, 10 s in all
            seconds = whole * float(str(lasting[0].slots["duration_s"]))
            said = " ".join(words[place : lasting[1]])
            return Token("slot", said, {"count": whole, "duration_s": seconds}), lasting[1]
        if more is not None and _turned(words, start) is None:
            whole, start = _whole(whole * more[0]), more[2] + int(words[more[2] : more[2] + 1] == ["times"])
        return Token("slot", " ".join(words[place:start]), {"count": whole}), start
    if follows == "times" or (follows == "time" and words[place] not in ("a", "an")):
        said = " ".join(words[place : after + 1])
        note = said if vague else ""
        return Token("slot", f"{whole} times" if vague else said, {"count": whole}, note=note), after + 1
    climbed = next((word for word in reversed(words[:place]) if word not in lexicon().roughly), "")
    if follows == "steps" and (climbed in ("up", "down") or _is_verb(climbed, "climb")):
        return Token("object", f"{number:g} stairs", {"object": "stair", "count": whole}), after + 1
    side = words[after + 2 : after + 3] if words[after : after + 2] == ["to", "the"] else [follows]
    sided = side in (["left"], ["right"]) and words[after + len(side) :][:1] not in ([part] for part in _body_parts())
    if sided and words[place] not in ("a", "an"):  # two left and one right
        return Token("slot", words[place], {"count": whole}), after
    if words[after - 1] == "couple":  # who dances, not how often
        return None
    angle = _turned(words, after)  # two 360 degree turns
    if follows in ("stairs", "treads") or (angle is not None and words[angle[1] : angle[1] + 1] == ["turns"]):
        return Token("slot", f"{number:g} {follows}", {"count": whole}), after
    deeds = any(entry.kind == "action" and entry.words == (follows,) for entry in _index().get(follows, ()))
    if deeds and follows.endswith("s") and follows != "steps" and (number > 1 or words[place] == "1"):
        said = " ".join(words[place:after])
        return Token("slot", str(whole) if vague else said, {"count": whole}, note=said if vague else ""), after
    return None


def _whole(number: float) -> float:
    return int(number) if float(number).is_integer() else number


def _is_verb(word: str, action: str) -> bool:
    return any(entry.slots.get("action") == action and entry.words == (word,) for entry in _index().get(word, ()))


def _lasting(words: list[str], place: int, *, alone: bool) -> tuple[Token, int] | None:
    """How long: ten seconds, 1 1/2 minutes, a few seconds; where it stands `alone`, behind no "for", not a moment or a second."""
    reading = _amount(words, place) if place < len(words) else None
    if reading is None or reading[1] >= len(words) or words[reading[1]] not in lexicon().seconds:
        return None
    number, after = reading
    unit = words[after]
    if alone and (words[place] in ("a", "an") or unit.startswith("moment")):
        return None
    seconds = float(number) * lexicon().seconds[unit]
    more = _lasting(words, after + 1 + int(words[after + 1 : after + 2] == ["and"]), alone=True)
    if (
        more is not None and float(str(more[0].slots["duration_s"])) < lexicon().seconds[unit]
    ):  # a minute and ten seconds
        seconds, after = seconds + float(str(more[0].slots["duration_s"])), more[1] - 1
    said = " ".join(words[place : after + 1])
    vague = (number_at(words, place) or (0, False))[1] or unit.startswith("moment")
    note = said if vague else ""
    return Token("slot", f"{seconds:g} seconds" if vague else said, {"duration_s": seconds}, note=note), after + 1


def _amount(words: list[str], place: int) -> tuple[float, int] | None:
    """How much, and where the unit stands: 1.5, half a, three quarters of a, one and a half, 1 1 / 4, pi / 2, two pi."""
    amount, after = 1.0, place
    if words[place] != "pi":
        reading = _part(words, place)
        if reading is None:
            return None
        amount, after = reading
        more = _part(words, after + int(words[after : after + 1] == ["and"]))
        if more is not None and 0 < more[0] < 1 and amount.is_integer():
            amount, after = amount + more[0], more[1]
    for between in (["of"], ["a"], ["an"]):
        after += int(words[after : after + 1] == between)
    after += int(words[after : after + 2] in (["*", "pi"], ["times", "pi"]))
    if words[after : after + 1] == ["pi"]:
        divisor, after = _divisor(words, after + 1)
        amount *= math.pi / divisor
    return amount, after


def _part(words: list[str], place: int) -> tuple[float, int] | None:
    """A number or a part of one, and where it ends: 1.5, half, a quarter, three quarters, 1 / 4."""
    ahead = words[place : place + 2]
    start = place + int(len(ahead) == 2 and ahead[0] in ("a", "one") and ahead[1] in PARTS)
    if ahead and words[start] in PARTS:
        return PARTS[words[start]], start + 1
    reading = number_at(words, place)
    if reading is None:
        return None
    amount, _, after = reading
    if words[after : after + 1] and words[after].removesuffix("s") in PARTS:
        return amount * PARTS[words[after].removesuffix("s")], after + 1
    divisor, after = _divisor(words, after)
    return amount / divisor, after


def _divisor(words: list[str], place: int) -> tuple[float, int]:
    """What is divided by, and where that ends: / 4, over two; 1 where nothing is."""
    reading = number_at(words, place + 1) if words[place : place + 1] and words[place] in ("/", "over") else None
    return (1.0, place) if reading is None or not reading[0] > 0 else (reading[0], reading[2])


def _turned(words: list[str], place: int) -> tuple[Token, int] | None:
    """By which angle somebody turns: 90 degrees, 1.57 radians, half a turn, a right angle; a hundred and eighty is not read.

    Whole turns are counted as other actions are, and the word turn tells of the action, too.
    """
    reading = _amount(words, place)
    if reading is None:
        return None
    amount, after = reading
    unit = words[after] if after < len(words) else ""
    unit_deg = lexicon().degrees.get(unit)
    if unit in ("turn", "turns") and not float(amount).is_integer():
        return Token("angle", " ".join(words[place : after + 1]), {"angle_deg": 360 * amount}), after
    if unit == "right" and words[after + 1 : after + 2] in (["angle"], ["angles"]):
        unit_deg, after = 90.0, after + 1
    elif unit_deg is None and "pi" in words[place:after]:
        unit_deg, after = math.degrees(1), after - 1
    if unit_deg is None:
        return None
    return Token("angle", " ".join(words[place : after + 1]), {"angle_deg": float(amount * unit_deg)}), after + 1


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
