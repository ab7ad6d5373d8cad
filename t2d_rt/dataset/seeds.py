"""Seeds: one for each purpose of each motion or sample of a recipe."""

from __future__ import annotations

import numpy as np


def seeds(recipe_seed: int, recipe_hash: str, number: int, purpose: str) -> np.random.SeedSequence:
    """The seeds of one purpose, as "view", of a motion or sample."""
    words = [int(recipe_hash[at : at + 8], 16) for at in range(0, len(recipe_hash), 8)]
    return np.random.SeedSequence([recipe_seed, *words, number, *purpose.encode()])


def integer_seed(sequence: np.random.SeedSequence) -> int:
    """A seed below 2^31, for what takes whole numbers."""
    return int(sequence.generate_state(1, np.uint32)[0] >> 1)
