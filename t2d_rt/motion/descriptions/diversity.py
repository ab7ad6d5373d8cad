"""How different descriptions are from one another: near-duplicates, and measures of diversity.

The similarity of two sentences is that of their sets of words, |A and B| / |A or B| (Jaccard 1912); their distance is what it
lacks of one. distinct-1 and distinct-2 are the numbers of different words and pairs of neighbouring words over the numbers of
all of them (Li et al. 2016, "A diversity-promoting objective function for neural conversation models").
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from t2d_rt.core.checks import instance
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import Description

NEAREST = 0.8
"""Sentences whose similarity reaches this are near-duplicates: all but one are left out."""

WORD = re.compile(r"[^\W_]+(?:'[^\W_]+)?")


def words_of(sentence: str) -> list[str]:
    """The words of a sentence in lower case, without signs."""
    return WORD.findall(sentence.lower())


@dataclass(slots=True)
class Gathered:
    """Descriptions of which no two are near-duplicates."""

    descriptions: list[Description] = field(default_factory=list)
    refused: int = 0
    """Near-duplicates that were left out."""
    _bits: dict[str, int] = field(default_factory=dict)
    _sets: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.descriptions)

    def add(self, description: Description) -> bool:
        """Takes a description, unless it is too like one that is there."""
        new = 0
        for word in words_of(description.sentence):
            new |= 1 << self._bits.setdefault(word, len(self._bits))
        if any((new & old).bit_count() >= NEAREST * (new | old).bit_count() for old in self._sets):
            self.refused += 1
            return False
        self._sets.append(new)
        self.descriptions.append(description)
        return True


@dataclass(frozen=True, slots=True)
class Diversity:
    """Measures of how different the sentences of a set are."""

    count: int
    distinct_1: float
    distinct_2: float
    mean_distance: float
    """Mean over all pairs; 1 where no word is common. Not a number where there are fewer than two sentences."""
    least_distance: float

    def __str__(self) -> str:
        said = f"{self.count} sentence{'s' * (self.count > 1)}, distinct-1 {self.distinct_1:.3f}, distinct-2 {self.distinct_2:.3f}"
        if self.count < 2:
            return said
        return f"{said}, token distance of pairs {self.mean_distance:.3f} on average and {self.least_distance:.3f} at least"


def diversity(descriptions: Sequence[Description | str]) -> Diversity:
    """Diversity of the sentences of some descriptions, or of some sentences."""
    sentences = [
        entry.sentence if isinstance(entry, Description) else instance("a sentence", entry, str, "a text")
        for entry in descriptions
    ]
    rows = [words_of(sentence) for sentence in sentences]
    words = [word for row in rows for word in row]
    if not words:
        raise InputError(
            f"diversity needs sentences of at least one word, got {len(sentences)} without; give descriptions"
        )
    pairs = [pair for row in rows for pair in pairwise(row)]
    vocabulary = {word: number for number, word in enumerate(dict.fromkeys(words))}
    holds = np.zeros((len(rows), len(vocabulary)), dtype=np.float32)
    for number, row in enumerate(rows):
        holds[number, [vocabulary[word] for word in row]] = 1
    sizes = holds.sum(axis=1)
    least, total, number_of_pairs = np.inf, 0.0, len(rows) * (len(rows) - 1) // 2
    for number in range(1, len(rows)):  # row by row: the matrix of all pairs may be large
        common = holds[:number] @ holds[number]
        either = np.maximum(sizes[:number] + sizes[number] - common, 1)
        distances = 1 - common / either
        least, total = min(least, float(distances.min())), total + float(distances.sum())
    return Diversity(
        count=len(rows),
        distinct_1=len(vocabulary) / len(words),
        distinct_2=len(set(pairs)) / max(len(pairs), 1),
        mean_distance=total / number_of_pairs if number_of_pairs else float("nan"),
        least_distance=least if number_of_pairs else float("nan"),
    )
