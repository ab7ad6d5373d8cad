"""Random numbers of the rows of a cube: the same for a row whatever blocks it is worked on in, and independent for each effect."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import numpy as np

from t2d_rt.core.backend import normal_numbers

GROUP_SAMPLES = 65_536
"""Samples of a group of rows, whose numbers come from one generator."""


def group_rows(row_samples: int) -> int:
    """Rows of a group, each of so many samples."""
    return max(1, GROUP_SAMPLES // row_samples)


@dataclass(frozen=True, slots=True)
class Draws:
    """Streams of random numbers by the name of an effect, from one seed of any size: each is seeded by a hash of these."""

    seed: int

    def of(self, name: str, number: int = 0) -> np.random.Generator:
        """The generator of one group of an effect."""
        return np.random.Generator(np.random.SFC64(int.from_bytes(self._digest(name, number), "little")))

    def normal(self, name: str, number: int, shape: tuple[int, ...]) -> np.ndarray:
        """White complex Gaussian noise of power 1, complex64; its first rows do not depend on how many there are."""
        key = int.from_bytes(self._digest(name, number)[:8], "little")
        parts = normal_numbers(2 * math.prod(shape), key=key, scale=math.sqrt(0.5))
        return parts.view(np.complex64).reshape(shape)

    def words(self, name: str) -> tuple[int, int]:
        """A key of an effect, two words of 32 bits."""
        found = self._digest(name, 0)
        return int.from_bytes(found[:4], "little"), int.from_bytes(found[4:8], "little")

    def _digest(self, name: str, number: int) -> bytes:
        return hashlib.sha256(f"{self.seed}/{name}/{number}".encode()).digest()
