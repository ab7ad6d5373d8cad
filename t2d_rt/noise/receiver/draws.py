"""Random numbers for the rows of a cube: the same for a row whatever the blocks are, and independent for each effect.

Normal numbers within kernels are functions of their position and of a key, so that each can be computed by itself.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, normal_numbers
from t2d_rt.core.polynomials import horner, in_powers, sine_and_cosine

GROUP_SAMPLES = 65_536
"""Number of samples in a group of rows that share a generator."""


def group_rows(row_samples: int) -> int:
    """Number of rows in a group, for rows of `row_samples` samples."""
    return max(1, GROUP_SAMPLES // row_samples)


@dataclass(frozen=True, slots=True)
class Draws:
    """Streams of random numbers by the name of an effect; each is seeded by a hash of the name and one seed of any size."""

    seed: int

    def of(self, name: str, number: int = 0) -> np.random.Generator:
        """The generator for one group of an effect."""
        return np.random.Generator(np.random.SFC64(int.from_bytes(self._digest(name, number), "little")))

    def normal(self, name: str, number: int, shape: tuple[int, ...]) -> np.ndarray:
        """White complex Gaussian noise of power 1, complex64; its first rows do not depend on their number."""
        key = int.from_bytes(self._digest(name, number)[:8], "little")
        parts = normal_numbers(2 * math.prod(shape), key=key, scale=math.sqrt(0.5))
        return parts.view(np.complex64).reshape(shape)

    def words(self, name: str) -> tuple[int, int]:
        """The key of an effect, as two 32-bit words."""
        digest = self._digest(name, 0)
        return int.from_bytes(digest[:4], "little"), int.from_bytes(digest[4:8], "little")

    def _digest(self, name: str, number: int) -> bytes:
        """Hash of seed, effect and number, which seeds an independent stream."""
        return hashlib.sha256(f"{self.seed}/{name}/{number}".encode()).digest()


MULTIPLIER, INCREMENT = 1664525, 1013904223
"""Constants of the linear congruential generator of Press et al. (Numerical Recipes, 1992)."""


def hashed(words: list[Any]) -> list[Any]:
    """Four random 32-bit words from four words, by pcg4d of Jarzynski and Olano (JCGT 9(3), 2020)."""
    x, y, z, w = (word * MULTIPLIER + INCREMENT for word in words)
    for shuffled in (False, True):
        if shuffled:
            x, y, z, w = (word ^ (word >> 16) for word in (x, y, z, w))
        x = x + y * w
        y = y + z * x
        z = z + x * y
        w = w + y * z
    return [x, y, z, w]


def complex_normal(backend: Backend, radius: Any, angle: Any) -> tuple[Any, Any]:
    """Real and imaginary part of a complex normal number of power 1, from two words (Box and Muller 1958), exact to 1e-5.

    Since 24 bits of the first word are used, each part reaches at most 5.9 standard deviations.
    """
    import drjit as dr

    Float32, UInt32, Int32 = backend.Float32, backend.UInt32, backend.arrays.Int
    logarithm, sine, cosine = _polynomials()
    # -ln of a number in 0..1, (word / 2^8 + 1/2) / 2^24: from its exponent, and a polynomial of its mantissa in 3/4..3/2
    number = Float32(radius >> 8) + 0.5
    bits: Any = dr.reinterpret_array(UInt32, number)
    exponent = Int32(bits - 0x3F400000) >> 23
    mantissa: Any = dr.reinterpret_array(Float32, bits - UInt32(exponent << 23))
    z = mantissa - 1
    power = dr.fma(24.0 - Float32(exponent), math.log(2), -z * horner(logarithm, z))
    length = dr.sqrt(dr.maximum(power, 1e-9))
    cycles = Float32(Int32(angle)) * 2.0**-32  # an angle of -1/2..1/2 cycle
    square = cycles * cycles
    return length * horner(cosine, square), length * cycles * horner(sine, square)


@cache
def _polynomials() -> tuple[list[float], list[float], list[float]]:
    """Coefficients, lowest power first, of ln(1 + z)/z for -1/4 < z < 1/2, and of sin(2 pi t)/t and cos(2 pi t) in powers of t^2
    for |t| < 1/2."""
    return in_powers(_logarithm_over, 6, (-0.25, 0.5)), *sine_and_cosine(4, 5)


def _logarithm_over(z: np.ndarray) -> np.ndarray:
    """ln(1 + z) / z, 1 at z = 0."""
    return np.asarray(np.log1p(z) / np.where(z == 0, 1, z) + (z == 0))
