"""Numbers in a row of words: ten, twenty five, a few, 2.5; and ranges of them, for which one number stands.

>>> number_at("a few times".split(), 0), with_ranges("jumps two or three times".split())
((3, True, 2), (['jumps', '2', 'times'], {1: 'two or three'}))
"""

from __future__ import annotations

import math

from t2d_rt.motion.descriptions.lexicon import lexicon

PERHAPS = "maybe", "perhaps", "possibly", "even"


def number_at(words: list[str], place: int) -> tuple[float, bool, int] | None:
    """A number that begins at a token, whether it is a vague one, and where it ends: ten, twenty five, a few, a couple of, 2.5."""
    ahead = words[place : place + 3]
    lexemes = lexicon()
    if ahead and ahead[0] == "a" and ahead[1:2] and ahead[1] in lexemes.some:
        ahead, place = ahead[1:], place + 1
    if not ahead:
        return None
    if ahead[0] in lexemes.some:
        return lexemes.some[ahead[0]], ahead[0] != "couple", place + 1 + int(ahead[1:2] == ["of"])
    if ahead[0][0].isdigit():
        return float(ahead[0]), False, place + 1
    number = lexemes.numbers.get(ahead[0])
    if number is None:
        return None
    if ahead[1:2] == ["hundred"]:
        rest = place + 2 + int(ahead[2:] == ["and"])
        more = number_at(words, rest) if words[rest : rest + 1] and words[rest] not in ("a", "an") else None
        if more is not None and 0 < more[0] < 100 and not more[1] and more[0] == int(more[0]):
            return 100 * number + more[0], False, more[2]
        return 100 * number, False, place + 2
    ones = lexemes.numbers.get(ahead[1]) if number >= 20 and ahead[1:] else None
    return (number + ones, False, place + 2) if ones is not None and 0 < ones < 10 else (number, False, place + 1)


def with_ranges(words: list[str]) -> tuple[list[str], dict[int, str]]:
    """Words with one number in the place of each range; and what was said, by the places of those numbers."""
    read: list[str] = []
    ranges: dict[int, str] = {}
    place = 0
    while place < len(words):
        number_read = _range(words, place)
        after = place + 1
        if number_read is not None:
            number, after = number_read
            ranges[len(read)] = " ".join(words[place:after])
            read.append(f"{number:g}")
            if words[after - 1] in lexicon().times:  # once or twice
                read.append("times")
        else:
            read.append(words[place])
        place = after
    return read, ranges


def _range(words: list[str], place: int) -> tuple[float, int] | None:
    """The number that is read for the range that begins at a word, and where it ends; None where none begins.

    It is the lesser of two that are parted by "or", and the middle of what lies between two, rounded down where times or things are
    counted. Ten or more are ten; up to ten times, seconds or degrees are ten, and so is what lies between 0 and ten. From 90 to 180
    degrees tells both ends of a turn, and is 90: the difference. Ends that are fractions (1/2 to 4) are not read as a range.
    """
    most = _end(words, place + 2) if words[place : place + 2] == ["up", "to"] else None
    if most is not None:
        return most if words[most[1] : most[1] + 1] == ["times"] or _unit(words, most[1]) else None
    demanded = {"between": ["and"], "from": ["to"]}.get(words[place])
    low = _end(words, place + int(demanded is not None))
    if low is None:
        return None
    # The unit may stand behind both ends: 0 degrees to 90 degrees.
    low_unit = _unit(words, low[1]) if words[low[1] + 1 : low[1] + 2] == (demanded or ["to"]) else ""
    after = low[1] + bool(low_unit) + 1
    link, rest = words[after - 1 : after], words[after : after + 1]
    if demanded is None and ((link == ["or"] and rest in (["more"], ["so"])) or (link == ["+"] and rest != [])):
        return low[0], after + int(link == ["or"])
    high = _end(words, after + int(link == ["or"] and rest != [] and rest[0] in PERHAPS))
    if high is None or "/" in (*words[max(place - 1, 0) : place], *words[high[1] : high[1] + 1]):
        return None
    follows, unit = words[high[1] : high[1] + 1], _unit(words, high[1])
    if low[0] == high[0] or low_unit not in ("", unit):
        return None
    if words[place] == "from" and link == ["to"] and unit in (*lexicon().degrees, "pi"):
        return abs(high[0] - low[0]), high[1]
    once = words[low[1] - 1] in lexicon().times and words[high[1] - 1] not in lexicon().times
    if high[0] < low[0] or (once and follows != ["times"]):
        return None  # twice or 10 seconds
    if demanded is None and link == ["or"]:
        return low[0], high[1]
    if link == (demanded or ["to"]) or (demanded is None and link == ["/"] and follows == ["times"]):
        middle = high[0] if low[0] == 0 else (low[0] + high[0]) / 2
        return (middle if unit or (low[0] % 1, high[0] % 1) != (0, 0) else middle // 1), high[1]
    return None


def _unit(words: list[str], place: int) -> str:
    """The unit of seconds or of angles that stands at a place; empty where none does."""
    unit = words[place] if place < len(words) else ""
    return unit if unit in (*lexicon().seconds, *lexicon().degrees, "pi") else ""


def _end(words: list[str], place: int) -> tuple[float, int] | None:
    """One end of a range: a finite number, or once or twice; and where it ends."""
    if place < len(words) and words[place] in lexicon().times:
        return float(lexicon().times[words[place]]), place + 1
    reading = number_at(words, place)
    unread = reading is None or words[place : reading[2]] in (["a"], ["an"]) or not math.isfinite(reading[0])
    return None if reading is None or unread else (reading[0], reading[2])
