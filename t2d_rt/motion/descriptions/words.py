"""A sentence as a row of words, numbers and signs."""

from __future__ import annotations

import re
import unicodedata

from t2d_rt.motion.descriptions.lexicon import lexicon

WORD = re.compile(r"\d+(?:\.\d+)?(?:e\d+(?!\w))?|[^\W\d_]+(?:'[^\W\d_]+)?|n't|[^\w\s]")
COMMA = re.compile(r"(?<![\d.,])(\d+),(\d+)(?![.,]?\d)")
"""A decimal comma within a number; commas between three numbers and more part a list."""
DASH = re.compile(r"(?<=\d)\s*[-\u2010-\u2015\u2212]\s*(?=\d)(?!\d+/\d)")
"""What stands between the ends of a range: 2-3; but 1-1/2 is one number."""
HYPHEN = re.compile(r"\b([^\W\d_]+)-(?=([^\W\d_]+)\b)")


def words_of(text: str) -> list[str]:
    """Words, numbers and signs in lower case; hyphens part words, dashes are commas, signs of degrees and pi are words.

    A dash between two numbers is "to".

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
    """A word and what stands for the hyphen behind it: two-three is two to three; twenty-one is twenty one."""
    first, second = (lexicon().numbers.get(word, 0) for word in hyphened.groups())
    return f"{hyphened[1]} {'to ' if min(first, second) > 0 and (first < 20 or second > 9) else ''}"


def _with_point(number: re.Match[str]) -> str:
    """A number with a comma: before three digits that parts thousands, as in English, else it is a decimal comma."""
    whole, rest = number.groups()
    thousands = len(rest) == 3 and len(whole) <= 3 and not whole.startswith("0")
    return f"{whole}{rest}" if thousands else f"{whole}.{rest}"
