"""`Leg`: one way between an antenna and a target, straight, over mirrors or through slabs; `StaticPath`: one between antennas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A chain of plane reflectors and of slabs passed, seen from the target as an antenna that stands at its image.

    From the antenna, targets seem to stand where the mirrors put them: at `turn @ x + shift_m`, as far from the antenna as x is
    from the image.
    """

    chain: tuple[str, ...]
    """Names of the reflectors, and of slabs "(through)", from the antenna on; () is the line of sight."""
    image_m: np.ndarray
    """(3,)."""
    turn: np.ndarray
    """(3, 3), orthogonal; its determinant is -1 for an odd number of mirrors."""
    shift_m: np.ndarray
    """(3,)."""
    field: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """The field that an antenna of gain 1 brings to points (..., 3) m at frequencies [Hz] (F,), without distance and phase of the
    way and of `delay_s`: complex (F, ..., 3), of length 1 in the line of sight."""
    way: Callable[[np.ndarray], np.ndarray]
    """Antenna, what the chain meets, and points of the ways to points (..., 3) m: (chain + 2, ..., 3)."""
    clear: Callable[[np.ndarray], np.ndarray]
    """Which points (..., 3) m the way exists to, inside outlines and past obstacles: float32 (...), 0 or 1."""
    share: Callable[[np.ndarray], np.ndarray]
    """What share of the field reaches points (..., 3) m, faded at the edges of both: float32 (...), 0..1."""
    transmissions: int = 0
    """Number of slabs passed."""
    delay_s: float = 0.0
    """What these add to the delay of the way."""

    @property
    def order(self) -> int:
        """Number of reflections."""
        return len(self.chain) - self.transmissions

    @property
    def name(self) -> str:
        """For people: "direct", "floor", "door (through) > floor", from the antenna on."""
        return " > ".join(self.chain) or "direct"

    def unfolded(self, points: np.ndarray) -> np.ndarray:
        """Where points (..., 3) seem to stand, seen from the antenna [m]."""
        return points @ self.turn.T + self.shift_m


@dataclass(frozen=True, slots=True, kw_only=True)
class LegPair:
    """The way out over one leg and back over another."""

    out: Leg
    back: Leg
    copies: int = 1
    """2 where back and out may be swapped and both are meant."""

    @property
    def order(self) -> int:
        """Number of reflections on both ways."""
        return self.out.order + self.back.order

    @property
    def transmissions(self) -> int:
        """Number of slabs passed on both ways."""
        return self.out.transmissions + self.back.transmissions

    @property
    def delay_s(self) -> float:
        """What these add to the delay."""
        return self.out.delay_s + self.back.delay_s

    @property
    def name(self) -> str:
        """For people: "direct", "floor" for the same way both times, "direct, floor"."""
        return self.out.name if self.out.chain == self.back.chain else f"{self.out.name}, {self.back.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticPath:
    """A way from the transmitters' centre over mirrors to the receivers'."""

    chain: tuple[str, ...]
    """Names of the mirrors from the transmitters on."""
    stops_m: np.ndarray
    """Transmitters, reflections, receivers, (order + 2, 3)."""
    departure_m: np.ndarray
    """Where the receivers seem to stand, seen from the transmitters, (3,)."""
    arrival_m: np.ndarray
    """Where the transmitters seem to stand, seen from the receivers, (3,)."""
    coefficients: Callable[[np.ndarray], np.ndarray]
    """What antennas of gain 1 and the radar's polarisations receive at frequencies [Hz] (F,), without distance and phase of the
    way: complex (F,)."""

    @property
    def name(self) -> str:
        """For people: "wall+y > floor"."""
        return " > ".join(self.chain)
