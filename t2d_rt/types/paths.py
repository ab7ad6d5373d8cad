"""`OneWayPath` between an antenna and a target: line of sight, over mirrors or through slabs; `StaticPath` between antennas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

PathKey = tuple[tuple[str, ...], bytes]
"""A chain of mirrors, and the image of the antenna in them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OneWayPath:
    """The path over a chain of plane reflectors and through slabs, as if it came straight from the antenna's image.

    From the antenna, a target at x appears at `mirror_matrix @ x + shift_m`, as far from the antenna as x is from the image.
    """

    chain: tuple[str, ...]
    """Names of the reflectors, and of slabs "(through)", from the antenna on; () is the line of sight."""
    image_m: np.ndarray
    """(3,)."""
    mirror_matrix: np.ndarray
    """(3, 3), orthogonal; its determinant is -1 for an odd number of mirrors."""
    shift_m: np.ndarray
    """(3,)."""
    field: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """The field that an antenna of gain 1 radiates to points (..., 3) m at frequencies [Hz] (F,), without the attenuation and phase
    of distance and of `delay_s`: complex (F, ..., 3), of length 1 in the line of sight."""
    vertices: Callable[[np.ndarray], np.ndarray]
    """Antenna, intersections with the chain, and target point of the paths to points (..., 3) m: (chain + 2, ..., 3)."""
    exists: Callable[[np.ndarray], np.ndarray]
    """Whether the path to points (..., 3) m exists, inside outlines and not blocked: float32 (...), 0 or 1."""
    fraction: Callable[[np.ndarray], np.ndarray]
    """Fraction of the field that reaches points (..., 3) m, faded at edges of mirrors and obstacles: float32 (...), 0..1."""
    transmissions: int = 0
    """Number of slabs on the path."""
    delay_s: float = 0.0
    """Delay that these add [s]."""

    @property
    def key(self) -> PathKey:
        """The same for one-way paths over the same chain to the same antenna; antennas apart have paths of their own."""
        return self.chain, self.image_m.tobytes()

    @property
    def order(self) -> int:
        """Number of reflections."""
        return len(self.chain) - self.transmissions

    @property
    def name(self) -> str:
        """For people: "direct", "floor", "door (through) > floor", from the antenna on."""
        return " > ".join(self.chain) or "direct"

    def unfolded(self, points: np.ndarray) -> np.ndarray:
        """Apparent positions of points (..., 3) as seen from the antenna [m]."""
        return points @ self.mirror_matrix.T + self.shift_m


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPair:
    """The round trip: out over one one-way path and back over another."""

    out: OneWayPath
    back: OneWayPath
    copies: int = 1
    """2 where back and out may be swapped and both are meant."""

    @property
    def order(self) -> int:
        """Number of reflections on both one-way paths."""
        return self.out.order + self.back.order

    @property
    def transmissions(self) -> int:
        """Number of slabs on both one-way paths."""
        return self.out.transmissions + self.back.transmissions

    @property
    def delay_s(self) -> float:
        """Delay that these add [s]."""
        return self.out.delay_s + self.back.delay_s

    @property
    def name(self) -> str:
        """For people: "direct", "floor" for the same path out and back, "direct, floor"."""
        return self.out.name if self.out.chain == self.back.chain else f"{self.out.name}, {self.back.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticPath:
    """A path from the transmitters' centre over mirrors to the receivers'."""

    chain: tuple[str, ...]
    """Names of the mirrors from the transmitters on."""
    stops_m: np.ndarray
    """Transmitters, reflections, receivers, (order + 2, 3)."""
    departure_m: np.ndarray
    """Apparent position of the receivers as seen from the transmitters, (3,)."""
    arrival_m: np.ndarray
    """Apparent position of the transmitters as seen from the receivers, (3,)."""
    coefficients: Callable[[np.ndarray], np.ndarray]
    """What antennas of gain 1 and the radar's polarisations receive at frequencies [Hz] (F,), without the attenuation and phase
    of distance: complex (F,)."""

    @property
    def name(self) -> str:
        """For people: "wall+y > floor"."""
        return " > ".join(self.chain)
