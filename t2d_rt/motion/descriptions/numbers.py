"""Numbers in a row of words: ten, twenty five, a few, 2.5; and ranges of them, for which one number stands.

>>> number_at("a few times".split(), 0), number_at("two or three times".split(), 0)
(Reading(number=3, vague=True, end=2), Reading(number=2, vague=True, end=3))
"""

from __future__ import annotations

import math
from typing import NamedTuple

from t2d_rt.motion.descriptions.lexicon import lexicon

TIMES = "times", "reps", "repetitions"
PERHAPS = "maybe", "perhaps", "possibly", "even"
ABOUT = *PERHAPS, "about", "around", "roughly", "approximately"
"""What may stand before the second of linked numbers, and behind "between"."""
LINKS = "to", "or", ",", "/", "+", "-", "\u00b1"
"""What stands between numbers that belong together: 2 to 3; 1, 2 or 3; 5 / 10."""
LINK_BEHIND = {"between": "and", "from": "to"}
"""The link that a word before the first number asks for."""

PARTS = {"half": 0.5, "third": 1 / 3, "quarter": 0.25}
FRACTION_SLASH = chr(0x2044)
"""The slash of a fraction that is one character, which parts no two numbers."""
DENOMINATORS = 2, 3, 4, 8
OF_ONE = "of", "a", "an", "second", "minute", "degree", "radian", "revolution", "turn"
"""What follows a fraction: 2/3 minute, 2/3 of a minute; 2/3 minutes may be two or three."""


class Reading(NamedTuple):
    """A number in a row of words."""

    number: float
    vague: bool
    """Whether it is read for a vague number or a range."""
    end: int
    """The place behind its last word."""


def number_at(words: list[str], place: int) -> Reading | None:
    """The number that begins at a word, or is read for linked ones.

    Of numbers that "or" parts it is the least, and of two that span a range the middle, rounded down where times or things are
    counted. Ten or more are ten; up to ten times, seconds or degrees are ten, and so is what lies between 0 and ten. From 90 to 180
    degrees and from 5 to 10 s tell both ends of a turn or of a time, and are the difference. Other linked numbers are not read.
    """
    values, links, after = linked_numbers(words, place)
    unit, counted = _unit(words, after), _of_times(words, after)
    if len(values) < 2:
        return _bounded(words, place, after) or _single(words, place)
    if links == ["/"] and not counted:
        return None
    low, high = values[0], values[-1]
    whole = (low % 1, high % 1) == (0, 0)
    turned = unit in (*lexicon().degrees, "pi") or (not whole and words[after : after + 1] in (["turn"], ["turns"]))
    if "or" in links and {*links} <= {"or", ","}:
        return Reading(min(values), True, after)
    if words[place] == "from" and links == ["to"] and (turned or (unit and low < high)):
        return Reading(abs(high - low), True, after)
    if links not in ([LINK_BEHIND.get(words[place], "to")], ["/"]) or low > high:
        return None
    middle = high if low == 0 else (low + high) / 2
    return Reading(middle if unit or not whole else middle // 1, True, after)


def _bounded(words: list[str], place: int, after: int) -> Reading | None:
    """The bound in up to ten times, ten or more and 10 +."""
    most = _end(words, place + 2) if words[place : place + 2] == ["up", "to"] else None
    if most is not None and (_of_times(words, most[1]) or _unit(words, most[1])):
        return Reading(most[0], True, most[1])
    least = _end(words, place)
    if least is not None and words[after : after + 2] in (["or", "more"], ["or", "so"]):
        return Reading(least[0], True, after + 2)
    return (
        Reading(least[0], True, after + 1)
        if least and words[after : after + 1] == ["+"] and words[after + 1 :]
        else None
    )


def linked_numbers(words: list[str], place: int) -> tuple[list[float], list[str], int]:
    """Numbers that belong together from a word on, the links between them, and where they end; of a list, only one with "or".

    A unit may stand behind each of them, which is the last one's for all: 0 degrees to 90 degrees, 30 seconds to a minute.
    """
    behind = LINK_BEHIND.get(words[place], "") if place < len(words) else ""
    values: list[float] = []
    links: list[str] = []
    end, start = place, place + bool(behind)
    while behind and words[start : start + 1] and words[start] in ABOUT:
        start += 1
    number = _end(words, start, article=bool(behind))
    while number is not None:
        values.append(number[0])
        end = number[1]
        unit = _scale(words, end) or (words[end], 1.0) if words[end + 1 : end + 2] == [behind or "to"] else None
        after = start = end + (unit is not None)
        while after < len(words) and words[after] in (*LINKS, behind, *(ABOUT if after > start else PERHAPS)):
            after += 1
        links.append(" ".join(word for word in words[start:after] if word not in ABOUT))
        number = _end(words, after, article=unit is not None) if after > start else None
        if number is not None and unit is not None:
            name, size = _scale(words, number[1]) or ("".join(words[number[1] : number[1] + 1]), 1.0)
            ordinal = words[number[1] - 1 : number[1] + 1] == ["a", "second"] and values[-1] * unit[1] > size
            if name == unit[0] and not ordinal:  # for 10 s to a second chair
                values[-1] *= unit[1] / size  # 30 seconds to a minute are 0.5 to 1 minute
            else:
                number = None
    lone = len(values) > 1 and words[place] in lexicon().times and not _of_times(words, end)  # twice or 10 seconds
    return ([], [], place) if lone or ("," in links[:-1] and "or" not in links) else (values, links[:-1], end)


def _of_times(words: list[str], place: int) -> bool:
    """Whether a number that ends at a place tells how often: two times, twice."""
    return words[place - 1] in lexicon().times or (place < len(words) and words[place] in TIMES)


def _unit(words: list[str], place: int) -> str:
    """The unit of seconds or of angles that stands at a place; empty where none does."""
    unit = words[place] if place < len(words) else ""
    return unit if unit in (*lexicon().seconds, *lexicon().degrees, "pi") else ""


def _scale(words: list[str], place: int) -> tuple[str, float] | None:
    """What the unit at a place measures, and how much of it one is: seconds, degrees, times; None where none stands there."""
    unit = words[place] if place < len(words) else ""
    if unit in ("time", *TIMES):
        return "times", 1.0
    for name, table in (
        ("seconds", lexicon().seconds),
        ("degrees", {**lexicon().degrees, "turn": 360.0, "turns": 360.0}),
    ):
        if unit in table:
            return name, table[unit]
    return ("degrees", math.degrees(math.pi)) if unit == "pi" else None


def _end(words: list[str], place: int, *, article: bool = False) -> tuple[float, int] | None:
    """A single finite number with its fraction, or once or twice, and where it ends: 2, one and a half, half a; an `article` before
    a unit is one, where it may be."""
    if place < len(words) and words[place] in lexicon().times:
        return float(lexicon().times[words[place]]), place + 1
    reading, fraction = _single(words, place), fraction_at(words, place)
    if fraction is not None and "/" not in words[place : fraction[1]] and words[place + 2 : place + 3] != ["dozen"]:
        after = fraction[1] + int(words[fraction[1] : fraction[1] + 1] == ["of"])
        return fraction[0], after + int(words[after : after + 1] in (["a"], ["an"]))
    if reading is None or not math.isfinite(reading.number):
        return None
    if words[place : reading.end] in (["a"], ["an"]):
        end = reading.end + int(words[reading.end : reading.end + 1] in (["full"], ["complete"], ["whole"]))
        return (1.0, end) if article and _scale(words, end) else None
    more = fraction_behind(words, reading.end)
    return (reading.number, reading.end) if more is None else (reading.number + more[0], more[1])


def fraction_at(words: list[str], place: int, *, mixed: bool = False) -> tuple[float, int] | None:
    """A fraction that begins at a word, and where it ends: a half, three quarters, 1 / 4.

    2 / 3 s and 1 / 2 seconds may be two numbers, and are no fractions; in mixed numbers and before pi they are: 1 2 / 3 s.
    """
    if words[place : place + 1] in (["a"], ["an"]):
        return fraction_at(words, place + 1, mixed=mixed)  # a three quarter turn
    start = place + int(words[place : place + 1] == ["one"])
    if words[start : start + 1] and words[start] in PARTS:
        return PARTS[words[start]], start + 1
    reading, after = _single(words, place), place + 3
    if reading is not None and words[reading.end : reading.end + 1]:
        value = reading.number * PARTS.get(words[reading.end].removesuffix("s"), math.inf)
        if value < 1 or (math.isfinite(value) and words[reading.end].endswith("s")):  # two half turns are counted
            return value, reading.end + 1
    over, divisor, follows = words[place + 1 : place + 2], words[place + 2 : place + 3], words[after : after + 1]
    if over not in (["/"], [FRACTION_SLASH]) or not (words[place] + divisor[0] if divisor else "").isdigit():
        return None
    top, bottom = int(words[place]), int(divisor[0])
    if follows == ["pi"] and bottom > 0:
        return top / bottom, after
    if bottom not in DENOMINATORS or not 0 < top < bottom or math.gcd(top, bottom) > 1 or follows == ["/"]:
        return None
    unit = follows[0] if follows else ""
    linked = unit not in OF_ONE and (top > 1 or (len(unit) > 1 and unit.endswith("s")))
    return (top / bottom, after) if mixed or over == [FRACTION_SLASH] or not linked else None


def fraction_behind(words: list[str], place: int) -> tuple[float, int] | None:
    """The fraction of a mixed number, and where it ends: and a half, 1 / 2."""
    ahead = words[place : place + 1]
    if ahead != ["and"] and not (ahead and ahead[0].isdigit()):
        return None
    fraction = fraction_at(words, place + int(ahead == ["and"]), mixed=True)
    return fraction if fraction is not None and fraction[0] < 1 else None


def is_vague(words: list[str], place: int) -> bool:
    """Whether a vague number or a range begins at a word."""
    reading = number_at(words, place)
    return reading is not None and reading.vague


def amount_at(words: list[str], place: int) -> tuple[float, int] | None:
    """How much, and where the unit stands: 1.5, half a, three quarters of a, one and a half, 1 1 / 4, pi / 2, two pi."""
    amount, after = 1.0, place
    if words[place : place + 1] != ["pi"]:
        reading = _part(words, place)
        if reading is None:
            return None
        amount, after = reading
        more = fraction_behind(words, after)
        if more is not None and amount >= 1 and float(amount).is_integer() and not is_vague(words, place):
            amount, after = amount + more[0], more[1]
    for between in (["more"], ["of"], ["a"], ["an"]):
        after += int(words[after : after + 1] == between)
    after += int(words[after : after + 2] in (["*", "pi"], ["times", "pi"]))
    if words[after : after + 1] == ["pi"]:
        divisor, after = _divisor(words, after + 1)
        amount *= math.pi / divisor
    return amount, after


def _part(words: list[str], place: int) -> tuple[float, int] | None:
    """A number or a fraction, whichever takes more words, and where it ends: 1.5, half, a quarter, three quarters, 1 / 4."""
    article = words[place : place + 1] in (["a"], ["an"])
    behind = _part(words, place + 1) if article else None  # a 360 degree turn
    reading, fraction = number_at(words, place), fraction_at(words, place)
    if behind is not None or (fraction is not None and (reading is None or reading.end < fraction[1])):
        return behind or fraction
    return None if reading is None else (reading.number, reading.end)


def _divisor(words: list[str], place: int) -> tuple[float, int]:
    """What is divided by, and where that ends: / 4, over two; 1 where nothing is."""
    reading = number_at(words, place + 1) if words[place : place + 1] and words[place] in ("/", "over") else None
    return (1.0, place) if reading is None or not reading.number > 0 else (reading.number, reading.end)


def _single(words: list[str], place: int) -> Reading | None:
    """A number that begins at a word: ten, twenty five, a few, a couple of, 2.5."""
    ahead = words[place : place + 3]
    lexemes = lexicon()
    if ahead and ahead[0] == "a" and ahead[1:2] and ahead[1] in lexemes.some:
        ahead, place = ahead[1:], place + 1
    if not ahead:
        return None
    if ahead[0] in lexemes.some:
        return Reading(lexemes.some[ahead[0]], ahead[0] != "couple", place + 1 + int(ahead[1:2] == ["of"]))
    if ahead == ["half", "a", "dozen"]:
        return Reading(6, False, place + 3)
    number = float(ahead[0]) if ahead[0][0].isdigit() else lexemes.numbers.get(ahead[0])
    if number is None:
        return None
    if ahead[1:2] == ["dozen"]:
        return Reading(12 * number, False, place + 2)
    if ahead[1:2] == ["hundred"]:
        rest = place + 2 + int(ahead[2:] == ["and"])
        more = _single(words, rest) if words[rest : rest + 1] and words[rest] not in ("a", "an") else None
        if more is not None and 0 < more.number < 100 and not more.vague and more.number == int(more.number):
            return Reading(100 * number + more.number, False, more.end)
        return Reading(100 * number, False, place + 2)
    ones = lexemes.numbers.get(ahead[1]) if number >= 20 and ahead[1:] and not ahead[0][0].isdigit() else None
    return Reading(number + ones, False, place + 2) if ones and ones < 10 else Reading(number, False, place + 1)
