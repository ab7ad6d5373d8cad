"""A sentence as a row of words, numbers and signs."""

from __future__ import annotations

import re
import unicodedata

from t2d_rt.motion.descriptions.lexicon import lexicon

WORD = re.compile(r"\d+(?:\.\d+)?(?:e\d+(?!\w))?|[^\W\d_]+(?:'[^\W\d_]+)?|n't|[^\w\s]")
COMMA = re.compile(r"(?<![\d.,])(\d+),(\d+)(?![.,]?\d)")
"""A comma within a number. Commas between three or more numbers separate a list."""
DASH = re.compile(r"(?<=\d)\s*[-\u2010-\u2015\u2212]\s*(?=\d)(?!\d+/\d)")
"""The dash between the ends of a range, as in "2-3"; "1-1/2" is one number."""
HYPHEN = re.compile(r"\b([^\W\d_]+)-(?=([^\W\d_]+)\b)")


def words_of(text: str) -> list[str]:
    """Splits a sentence into its words, numbers and signs, in lower case.

    A hyphen separates two words; a dash is a comma, but "to" between two numbers; the signs of degrees and of pi become words.

    >>> words_of("High-stepping, it's 2.5 s!")
    ['high', 'stepping', ',', "it's", '2.5', 's', '!']
    >>> words_of("two-three squats, twenty-one jumps, 5-10 s")
    ['two', 'to', 'three', 'squats', ',', 'twenty', 'one', 'jumps', ',', '5', 'to', '10', 's']
    >>> words_of("1,5 turns, 1,000 steps, 1/2 or .5")
    ['1.5', 'turns', ',', '1000', 'steps', ',', '1', '/', '2', 'or', '0.5']
    """
    apart = re.sub(r"(?<=\d)(?=[¼-¾⅐-⅞])", " ", re.sub(r"(?<=\d)\s*[°º]", " degrees ", DASH.sub(" to ", text)))
    signs = {0x2019: "'", 0x2018: "'", 0x2014: ",", 0x2013: ",", 0x3C0: "pi"}
    lowered = COMMA.sub(_with_point, unicodedata.normalize("NFKC", apart).lower().translate(signs))
    lowered = re.sub(r"\b(he|she|they|i|we|you)'(?:s|ll|d|ve|re|m)\b", r"\1", lowered)
    lowered = HYPHEN.sub(_unhyphened, re.sub(r"(?<![\w.])\.(?=\d)", "0.", lowered))
    return WORD.findall(re.sub(r"(?<=\w)-(?=\w)", " ", re.sub(r"\s-+\s", " , ", lowered)))


def _unhyphened(hyphened: re.Match[str]) -> str:
    """The word before a hyphen, with "to" in the place of one between two numbers: "two-three", but not "twenty-one"."""
    first, second = (lexicon().numbers.get(word, 0) for word in hyphened.groups())
    return f"{hyphened[1]} {'to ' if min(first, second) > 0 and (first < 20 or second > 9) else ''}"


def _with_point(number: re.Match[str]) -> str:
    """A number with a comma, which separates thousands if three digits follow, as in English, and otherwise is a decimal one."""
    whole, rest = number.groups()
    thousands = len(rest) == 3 and len(whole) <= 3 and not whole.startswith("0")
    return f"{whole}{rest}" if thousands else f"{whole}.{rest}"
