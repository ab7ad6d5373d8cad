"""The sweep of a chirp as a coordinate x in -1..1: its quantities, polynomials over it, and products with phasors on the device.

Complex numbers are stored on the device as alternating real and imaginary parts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from typing import Any

import numpy as np

from t2d_rt.core.polynomials import horner, sine_and_cosine
from t2d_rt.types import Radar


@dataclass(frozen=True, slots=True)
class Sweep:
    """Quantities of a sweep for the sum of echoes; x = -1 at its first sample, 1 at its last."""

    mid_hz: float
    slope: float
    """Chirp slope [Hz/s]."""
    half_time_s: float
    x: np.ndarray
    """Position of each sample in the sweep, (sample,)."""

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
        """Range bin as a delay [s]: 1/B, B = 2 S T_half."""
        return 1 / (2 * self.slope * self.half_time_s)

    @property
    def coupling_s(self) -> float:
        """Range-Doppler coupling [s]: apparent delay per unit of the delay's rate of change, f_mid / S."""
        return self.mid_hz / self.slope

    def per_cycle(self, step_s: float) -> tuple[float, float, float]:
        """Factors that convert phase: theta per cycle at mid-sweep; theta and eps per cycle per frame, for frames `step_s`
        apart."""
        return (
            self.theta_per_s / self.mid_hz,
            self.theta_per_s / (self.slope * step_s),
            2 * math.pi * self.half_time_s**2 * self.slope / (self.mid_hz * step_s),
        )


@dataclass(frozen=True, slots=True)
class Instants:
    """Mid-sweep times of the chirps within a window of frames, and their sweep."""

    position: np.ndarray
    """Times at mid-sweep [frames after the window's start], ascending, (instant,)."""
    step_s: float
    """Frame interval [s]."""
    sweep: Sweep

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, chirps: slice) -> Instants:
        return replace(self, position=self.position[chirps])

    @property
    def per_cycle(self) -> tuple[float, float, float]:
        """Factors that convert phase, as in `Sweep.per_cycle`."""
        return self.sweep.per_cycle(self.step_s)


@lru_cache(maxsize=64)
def nodes(count: int) -> np.ndarray:
    """Chebyshev nodes in -1..1, in pairs +x, -x, largest first; `count` is even."""
    positive = np.cos(math.pi * (np.arange(count // 2) + 0.5) / count)
    return np.stack([positive, -positive], axis=1).ravel()


def chebyshev(orders: int, x: np.ndarray) -> np.ndarray:
    """Chebyshev polynomials T_0, T_1, ... at x, (orders, len(x))."""
    return np.cos(np.outer(np.arange(orders), np.arccos(np.clip(x, -1, 1))))


def interpolation(count: int, x: np.ndarray) -> np.ndarray:
    """Matrix (len(x), count) from values at `nodes(count)` to values at x of the polynomial through them."""
    weight = np.where(np.arange(count) == 0, 1, 2) / count
    return (chebyshev(count, x).T * weight) @ chebyshev(count, nodes(count))


@lru_cache(maxsize=256)
def nodes_for(theta: float, tolerance: float) -> int:
    """Number of Chebyshev nodes, even, that interpolate exp(j t x) for all |t| <= theta within `tolerance`: the first omitted term
    is 2 J_n."""
    from scipy.special import jv

    count = 2
    while 2 * abs(jv(count, theta)) > tolerance or count < theta:
        count += 2
    return count


def sin_cos(cycles: Any, *, within_half: bool = False) -> tuple[Any, Any]:
    """Sine and cosine of 2 pi `cycles`, with an error of 6e-7; twice as fast as those of the library, which reduce any angle.

    `within_half`: |cycles| <= 1/2 is known.
    """
    import drjit as dr

    rest = cycles if within_half else cycles - dr.round(cycles)
    square = rest * rest
    sine, cosine = _polynomials()
    return rest * horner(sine, square), horner(cosine, square)


@cache
def _polynomials() -> tuple[list[float], list[float]]:
    """Coefficients of the polynomials in `sin_cos`."""
    return sine_and_cosine(5, 6)


def cubic_at(cubic: Any, u: Any) -> Any:
    """Value c0 + c1 u + c2 u^2 + c3 u^3 of a cubic."""
    return cubic[0] + u * (cubic[1] + u * (cubic[2] + u * cubic[3]))


def moved(cubic: Any, u: Any) -> tuple[Any, Any]:
    """Change of a cubic from 0 to u, and its derivative at u."""
    return u * (cubic[1] + u * (cubic[2] + u * cubic[3])), cubic[1] + u * (2 * cubic[2] + u * (3 * cubic[3]))


def summed(kind: Any, ends: tuple[Any, Any], step: Any, count: int, values: Callable[[Any], list[Any]]) -> list[Any]:
    """Sums, in each lane of a kernel, of `count` numbers of a Dr.Jit type `kind`: of `values(i)` for i = begin, begin + step, ... <
    end, where `ends` = begin, end."""
    import drjit as dr

    def body(i: Any, sums: list[Any]) -> tuple[Any, list[Any]]:
        return i + step, [total + value for total, value in zip(sums, values(i), strict=True)]

    begin, end = ends
    zeros = [dr.zeros(kind, dr.width(begin)) for _ in range(count)]
    _, totals = dr.while_loop(
        state=(begin, zeros), cond=lambda i, sums: i < end, body=body, labels=("i", "sums"), mode="symbolic"
    )
    return totals


def read(values: Any, sample: Any, count: int, packet: Any) -> list[Any]:
    """Reads a sample of a group's factor: real and imaginary parts at `count` nodes."""
    import drjit as dr

    base = sample * (count // 2)
    return [part for k in range(count // 2) for part in dr.gather(packet, values, base + k)]


def times_phasor(values: list[Any], sin: Any, cos: Any) -> list[Any]:
    """Multiplies complex numbers, stored as alternating real and imaginary parts, by exp(j phase)."""
    out = []
    for real, imag in zip(values[::2], values[1::2], strict=True):
        out += [real * cos - imag * sin, real * sin + imag * cos]
    return out


def spread_to(inner: int, outer: np.ndarray) -> Callable[[list[Any]], list[Any]]:
    """Function that takes values at `inner` Chebyshev nodes of the sweep to those of the polynomial through them at the `outer`
    nodes, pairs +x, -x."""
    if np.array_equal(nodes(inner), outer):
        return list
    # Nodes come in pairs +-x: to treat even and odd parts separately halves the work.
    matrix = interpolation(inner, outer)[::2]
    even, odd = ((matrix[:, ::2] + sign * matrix[:, 1::2]) / 2 for sign in (1, -1))
    return partial(_spread, even, odd)


def _spread(even: np.ndarray, odd: np.ndarray, values: list[Any]) -> list[Any]:
    """Values at pairs of outer nodes from those at pairs of inner nodes, by one matrix (outer pair, inner pair) for even and one
    for odd parts."""
    out = []
    pairs = [values[k : k + 4] for k in range(0, len(values), 4)]
    for row_even, row_odd in zip(even, odd, strict=True):
        sums = [
            sum(float(w) * (pair[part] + sign * pair[part + 2]) for w, pair in zip(row, pairs, strict=True))
            for part in (0, 1)
            for row, sign in ((row_even, 1), (row_odd, -1))
        ]
        out += [sums[0] + sums[1], sums[2] + sums[3], sums[0] - sums[1], sums[2] - sums[3]]
    return out


def rotated(values: list[Any], theta: Any, x: list[float], *, bend: Any = None, small: bool = False) -> list[Any]:
    """Values at pairs of nodes +-x times exp(j (theta x + bend (x^2 - 1/2))), the bend expanded to second order.

    `small`: |theta| <= pi is known.
    """
    out = []
    for k, place in enumerate(x):
        a, b, c, d = values[4 * k : 4 * k + 4]
        if bend is not None:
            e = bend * (place * place - 0.5)
            f = 1 - 0.5 * e * e
            a, b, c, d = f * a - e * b, f * b + e * a, f * c - e * d, f * d + e * c
        sin, cos = sin_cos(theta * (place / (2 * math.pi)), within_half=small)
        out += [a * cos - b * sin, a * sin + b * cos, c * cos + d * sin, d * cos - c * sin]
    return out
