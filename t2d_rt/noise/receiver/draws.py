"""Random numbers of the rows of a cube: the same for a row whatever blocks it is worked on in, and independent for each effect."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

GROUP_ROWS = 16
"""Rows of a cube whose numbers come from one generator."""


@dataclass(frozen=True, slots=True)
class Draws:
    """Streams of random numbers by the name of an effect, from one seed of any size.

    The key of Philox is a hash of seed and name, its counter the number of the group: no stream meets another one.
    """

    seed: int

    def of(self, name: str, number: int = 0) -> np.random.Generator:
        """The generator of one group of an effect."""
        digest = hashlib.sha256(f"{self.seed}/{name}".encode()).digest()
        key, counter = np.frombuffer(digest[:16], "<u8"), np.array([0, 0, 0, number], np.uint64)
        return np.random.Generator(np.random.Philox(key=key, counter=counter))

    def normal(self, name: str, number: int, shape: tuple[int, ...]) -> np.ndarray:
        """White complex Gaussian noise of power 1, complex64; its first rows do not depend on how many there are."""
        parts = self.of(name, number).standard_normal((*shape, 2), np.float32)
        parts *= np.float32(np.sqrt(0.5))
        return parts.view(np.complex64)[..., 0]
