"""Numbers in a row of words: ten, twenty five, a few, 2.5; and ranges of them, for which one number stands.

>>> number_at("a few times".split(), 0), number_at("two or three times".split(), 0)
((3, True, 2), (2, True, 3))
"""

from __future__ import annotations

import math

from t2d_rt.motion.descriptions.lexicon import lexicon

TIMES = "times", "reps", "repetitions"
PERHAPS = "maybe", "perhaps", "possibly", "even"
LINKS = "to", "or", ",", "/", "+", "-", "\u00b1"
"""What stands between numbers that belong together: 2 to 3; 1, 2 or 3; 5 / 10."""
LINK_BEHIND = {"between": "and", "from": "to"}
"""The link that a word before the first number asks for."""


def number_at(words: list[str], place: int) -> tuple[float, bool, int] | None:
    """The number that begins at a word, or is read for linked ones; whether it is vague or read for a range; and where it ends.

    Of numbers that "or" parts it is the least, and of two that span a range the middle, rounded down where times or things are
    counted. Ten or more are ten; up to ten times, seconds or degrees are ten, and so is what lies between 0 and ten. From 90 to 180
    degrees and from 5 to 10 s tell both ends of a turn or of a time, and are the difference. Other linked numbers are not read.
    """
    values, links, after = linked_numbers(words, place)
    unit, counted = _unit(words, after), _of_times(words, after)
    if len(values) < 2 or (links == ["/"] and not counted):  # a fraction is read by who knows its unit
        return (None if links else _bounded(words, place, after)) or _single(words, place)
    low, high = values[0], values[-1]
    if "or" in links and {*links} <= {"or", ","}:
        return min(values), True, after
    if words[place] == "from" and links == ["to"] and (unit in (*lexicon().degrees, "pi") or (unit and low < high)):
        return abs(high - low), True, after
    if links not in ([LINK_BEHIND.get(words[place], "to")], ["/"]) or low > high:
        return None
    middle = high if low == 0 else (low + high) / 2
    return (middle if unit or (low % 1, high % 1) != (0, 0) else middle // 1), True, after


def _bounded(words: list[str], place: int, after: int) -> tuple[float, bool, int] | None:
    """The bound in up to ten times, ten or more and 10 +."""
    most = _end(words, place + 2) if words[place : place + 2] == ["up", "to"] else None
    if most is not None and (_of_times(words, most[1]) or _unit(words, most[1])):
        return most[0], True, most[1]
    least = _end(words, place)
    if least is not None and words[after : after + 2] in (["or", "more"], ["or", "so"]):
        return least[0], True, after + 2
    return (least[0], True, after + 1) if least and words[after : after + 1] == ["+"] and words[after + 1 :] else None


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
        unit = _unit(words, end) if words[end + 1 : end + 2] == [behind or "to"] else ""
        after = start = end + bool(unit)
        while after < len(words) and words[after] in (*LINKS, *PERHAPS, behind):
            after += 1
        links.append(" ".join(word for word in words[start:after] if word not in PERHAPS))
        number = _end(words, after) if after > start else None
        if number is not None and unit not in ("", _unit(words, number[1])):
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


def _end(words: list[str], place: int) -> tuple[float, int] | None:
    """A single finite number, or once or twice; and where it ends."""
    if place < len(words) and words[place] in lexicon().times:
        return float(lexicon().times[words[place]]), place + 1
    reading = _single(words, place)
    unread = reading is None or words[place : reading[2]] in (["a"], ["an"]) or not math.isfinite(reading[0])
    return None if reading is None or unread else (reading[0], reading[2])


def _single(words: list[str], place: int) -> tuple[float, bool, int] | None:
    """A number that begins at a word, whether it is a vague one, and where it ends: ten, twenty five, a few, a couple of, 2.5."""
    ahead = words[place : place + 3]
    lexemes = lexicon()
    if ahead and ahead[0] == "a" and ahead[1:2] and ahead[1] in lexemes.some:
        ahead, place = ahead[1:], place + 1
    if not ahead:
        return None
    if ahead[0] in lexemes.some:
        return lexemes.some[ahead[0]], ahead[0] != "couple", place + 1 + int(ahead[1:2] == ["of"])
    if ahead == ["half", "a", "dozen"]:
        return 6, False, place + 3
    number = float(ahead[0]) if ahead[0][0].isdigit() else lexemes.numbers.get(ahead[0])
    if number is None:
        return None
    if ahead[1:2] == ["dozen"]:
        return 12 * number, False, place + 2
    if ahead[1:2] == ["hundred"]:
        rest = place + 2 + int(ahead[2:] == ["and"])
        more = _single(words, rest) if words[rest : rest + 1] and words[rest] not in ("a", "an") else None
        if more is not None and 0 < more[0] < 100 and not more[1] and more[0] == int(more[0]):
            return 100 * number + more[0], False, more[2]
        return 100 * number, False, place + 2
    ones = lexemes.numbers.get(ahead[1]) if number >= 20 and ahead[1:] and not ahead[0][0].isdigit() else None
    return (number + ones, False, place + 2) if ones is not None and 0 < ones < 10 else (number, False, place + 1)
