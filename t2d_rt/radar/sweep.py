"""The sweep of a chirp as x in -1..1: its quantities, and polynomials over it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from t2d_rt.types import Radar


@dataclass(frozen=True, slots=True)
class Sweep:
    """Quantities of a sweep that the sum needs; x = -1 at its first sample, 1 at its last."""

    mid_hz: float
    slope: float
    """[Hz/s]."""
    half_time_s: float
    x: np.ndarray
    """(sample,)."""

    @classmethod
    def of(cls, radar: Radar) -> Sweep:
        """The sweep of a radar's chirps."""
        half = radar.mid_time_s
        return cls(radar.mid_frequency_hz, radar.slope_hz_per_s, half, radar.sample_times_s / half - 1)

    @property
    def theta_per_s(self) -> float:
        """theta [rad] per second of delay."""
        return 2 * math.pi * self.slope * self.half_time_s

    @property
    def bin_s(self) -> float:
        """A range bin in delay: 1/B, B = 2 S T_half."""
        return 1 / (2 * self.slope * self.half_time_s)

    @property
    def coupling_s(self) -> float:
        """Range-Doppler coupling [s]: apparent delay per rate of delay, f_mid / S."""
        return self.mid_hz / self.slope

    def per_cycle(self, step_s: float) -> tuple[float, float, float]:
        """Conversion of phase: theta per cycle at mid-sweep; theta and eps per cycle per frame, frames being `step_s` apart."""
        return (
            self.theta_per_s / self.mid_hz,
            self.theta_per_s / (self.slope * step_s),
            2 * math.pi * self.half_time_s**2 * self.slope / (self.mid_hz * step_s),
        )


@dataclass(frozen=True, slots=True)
class Instants:
    """Chirps of a window of frames: when they are sent, and their sweep."""

    position: np.ndarray
    """[frames after the window's start], ascending, (instant,)."""
    step_s: float
    """Frame interval."""
    sweep: Sweep

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, some: slice) -> Instants:
        return replace(self, position=self.position[some])

    @property
    def per_cycle(self) -> tuple[float, float, float]:
        """Conversion of phase, as `Sweep.per_cycle` gives it."""
        return self.sweep.per_cycle(self.step_s)


@lru_cache(maxsize=64)
def nodes(count: int) -> np.ndarray:
    """Chebyshev nodes in -1..1 in pairs +x, -x, largest first; `count` is even."""
    positive = np.cos(math.pi * (np.arange(count // 2) + 0.5) / count)
    return np.stack([positive, -positive], axis=1).ravel()


def chebyshev(orders: int, x: np.ndarray) -> np.ndarray:
    """T_0 ... of x, (orders, len(x))."""
    return np.cos(np.outer(np.arange(orders), np.arccos(np.clip(x, -1, 1))))


def interpolation(count: int, x: np.ndarray) -> np.ndarray:
    """Matrix (len(x), count) from values at `nodes(count)` to the polynomial through them at x."""
    weight = np.where(np.arange(count) == 0, 1, 2) / count
    return (chebyshev(count, x).T * weight) @ chebyshev(count, nodes(count))


@lru_cache(maxsize=256)
def nodes_for(theta: float, tolerance: float) -> int:
    """Nodes, an even number, that carry exp(j t x) for all |t| <= theta within `tolerance`: the first term left out is 2 J_n."""
    from scipy.special import jv

    count = 2
    while 2 * abs(jv(count, theta)) > tolerance or count < theta:
        count += 2
    return count
