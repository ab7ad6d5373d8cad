"""Weighted choices that are dealt like cards: whatever is among them comes up once before anything comes up too often."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np


@cache
def weighted(choices: str, separator: str = "|") -> tuple[str, ...]:
    """Choices, each as often as its weight says: "a*2 | b" is a, a, b; "-" is nothing, an empty text.

    >>> weighted("up*2 down -", " ")
    ('up', 'up', 'down', '')
    """
    found = []
    for each in choices.split(separator):
        word, _, weight = each.partition("*")
        word = word.strip()
        found += ["" if word == "-" else word] * int(weight or 1)
    return tuple(found)


class Dealer:
    """Deals from shuffled decks of choices, one deck for each set of them."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._decks: dict[tuple[str, tuple[Any, ...]], list[int]] = {}

    def pick(self, choices: str | tuple[Any, ...], name: str = "") -> Any:
        """The next of some choices; those of a text are divided by bars. Each `name` has a deck of its own."""
        cards = weighted(choices) if isinstance(choices, str) else choices
        if len(cards) == 1:
            return cards[0]
        deck = self._decks.setdefault((name, cards), [])
        if not deck:
            deck.extend(int(each) for each in self._rng.permutation(len(cards)))
        return cards[deck.pop()]

    def word(self, choices: str, name: str = "") -> str | None:
        """The next of some words with weights, divided by spaces; None for nothing."""
        return self.pick(weighted(choices, " "), name) or None
