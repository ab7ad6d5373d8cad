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
    if "or" in links and {*links} <= {"or", ","}:
        return Reading(min(values), True, after)
    if words[place] == "from" and links == ["to"] and (unit in (*lexicon().degrees, "pi") or (unit and low < high)):
        return Reading(abs(high - low), True, after)
    if links not in ([LINK_BEHIND.get(words[place], "to")], ["/"]) or low > high:
        return None
    middle = high if low == 0 else (low + high) / 2
    return Reading(middle if unit or (low % 1, high % 1) != (0, 0) else middle // 1, True, after)


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

    The unit may stand behind each of them: 0 degrees to 90 degrees.
    """
    behind = LINK_BEHIND.get(words[place], "") if place < len(words) else ""
    values: list[float] = []
    links: list[str] = []
    end, number = place, _end(words, place + bool(behind))
    while number is not None:
        values.append(number[0])
        end = number[1]
        unit = _singular_unit(words, end) if words[end + 1 : end + 2] == [behind or "to"] else ""
        after = start = end + bool(unit)
        while after < len(words) and words[after] in (*LINKS, *PERHAPS, behind):
            after += 1
        links.append(" ".join(word for word in words[start:after] if word not in PERHAPS))
        number = _end(words, after) if after > start else None
        if number is not None and unit not in ("", _singular_unit(words, number[1])):
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


def _singular_unit(words: list[str], place: int) -> str:
    """The unit of seconds, of angles or of turns at a place, without its s; empty where none stands there."""
    unit = "turn" if words[place : place + 1] in (["turn"], ["turns"]) else _unit(words, place)
    return unit.rstrip("s") or unit


def _end(words: list[str], place: int) -> tuple[float, int] | None:
    """A single finite number with its fraction, or once or twice; and where it ends: 2, one and a half, half a."""
    if place < len(words) and words[place] in lexicon().times:
        return float(lexicon().times[words[place]]), place + 1
    reading, fraction = _single(words, place), fraction_at(words, place)
    if fraction is not None and "/" not in words[place : fraction[1]] and words[place + 2 : place + 3] != ["dozen"]:
        after = fraction[1] + int(words[fraction[1] : fraction[1] + 1] == ["of"])
        return fraction[0], after + int(words[after : after + 1] in (["a"], ["an"]))
    unread = reading is None or words[place : reading.end] in (["a"], ["an"]) or not math.isfinite(reading.number)
    if reading is None or unread:
        return None
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
