"""What a pair of legs does to the echoes of a target in a room (docs/physics.md, eq. 24)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.backend import Backend, aligned_empty
from t2d_rt.echo.facets import Weights
from t2d_rt.types import EchoArrays, Leg, LegPair, Radar

ANCHORS, APART_M = 150, 0.04
"""Points of a target at which coefficients are worked out: at most so many, and no nearer to each other than needed."""
NEIGHBOURS = 3
"""Anchors that an echo takes its coefficient from."""


Share = Callable[[np.ndarray], np.ndarray]
"""0..1 (K, N) at times [s] (K,)."""
Look = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""0..1 (K, Q) at times [s] (K,), of vertices (K, Q, 3) of triangles (F, 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A target seen over a pair of legs, or in free space."""

    legs: LegPair | None = None
    seen: Share | None = None
    """Of each vertex of a mesh, or of each ellipsoid; None: all that faces the antennas."""
    halved: int = 0
    """`seen` is of the vertices of the mesh's edges halved so many times (`geometry.Halved`), too."""
    passed: Share | None = None
    """Of the field that reaches a mesh's anchors; None: all of it."""
    looked: Look | None = None
    """Of the facets' own vertices, beside `seen`."""


def anchor_vertices(rest: np.ndarray) -> np.ndarray:
    """Numbers of a few vertices of (V, 3) m that stand for those around them, each as far as may be from the others."""
    chosen = [0]
    nearest = np.linalg.norm(rest - rest[0], axis=1)
    while len(chosen) < min(ANCHORS, len(rest)) and nearest.max() > APART_M:
        # Rounded: of vertices as far the first one is taken, whichever way the mesh lies.
        chosen.append(int(np.argmax(np.round(nearest, 6))))
        nearest = np.minimum(nearest, np.linalg.norm(rest - rest[chosen[-1]], axis=1))
    return np.array(chosen)


@dataclass(frozen=True, slots=True)
class Anchors:
    """A few vertices of a mesh that stand for what lies around them."""

    vertices: np.ndarray
    """Their numbers, (A,)."""
    near: np.ndarray
    """Numbers of each echo's own, (N, n)."""
    tables: tuple[Any, Any]
    """These and how much of each, flat UInt32 and Float32 on the device."""

    @classmethod
    def of(cls, vertices: np.ndarray, rest: np.ndarray, echoes: np.ndarray, backend: Backend) -> Anchors:
        """Of `anchor_vertices` (A,) of a mesh's vertices (V, 3) and echoes' places (N, 3) in the same pose [m]."""
        from scipy.spatial import cKDTree

        distance, near = cKDTree(rest[vertices]).query(echoes, k=min(NEIGHBOURS, len(vertices)))
        distance, near = distance.reshape(len(echoes), -1), near.reshape(len(echoes), -1)
        share = 1 / np.maximum(distance, 1e-6)
        share /= share.sum(axis=1, keepdims=True)
        return cls(vertices, near, (backend.lanes(near), backend.lanes(share, backend.Float32)))

    def weights(self, weight: np.ndarray, slope: np.ndarray, passed: np.ndarray | None, backend: Backend) -> Weights:
        """Weights and their slopes at the anchors, complex (T, A), of which `passed` (T, A) is let through."""
        values = aligned_empty(4 * weight.size, np.float32).reshape(*weight.shape[::-1], 4)
        for k, part in enumerate((weight.real, weight.imag, slope.real, slope.imag)):
            values[..., k] = part.T if passed is None else (part * passed).T
        live = np.ones(len(self.vertices), bool) if passed is None else np.asarray(passed.any(axis=0))
        near, share = self.tables
        return Weights(
            near=near, share=share, count=self.near.shape[1], values=backend.Float32(values.ravel()),
            reach=live[self.near].any(axis=1),
        )  # fmt: skip


class Arrivals:
    """What legs bring to points (..., 3) m, each leg worked out once."""

    def __init__(self, radar: Radar, points_m: np.ndarray) -> None:
        self._radar, self._points, self._axes = radar, points_m, radar.axes
        self._band_hz = radar.bandwidth_hz / 2
        self._one_end = radar.tx_pattern == radar.rx_pattern and np.array_equal(
            radar.tx_position_m, radar.rx_position_m
        )
        self._known: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def weight(self, legs: LegPair) -> tuple[np.ndarray, np.ndarray]:
        """What a pair of legs makes of the amplitude of a reflector there, and its slope over frequency [1/Hz], complex (...).

        Patterns, both legs' coefficients and the reflector's own turn of the polarisation, that of a facet whose normal n bisects
        the legs: e_out . e_back - 2 (n . e_out)(n . e_back); conjugated, as IF = tx conj(rx).
        """
        (towards, gain_out, out), (from_there, gain_back, back) = self._of(legs.out, 0), self._of(legs.back, 1)
        # Fields are across their ways: of twice the bisector, the other way's part alone is along them.
        double = 2 + 2 * _dot(towards, from_there)
        along = _dot(from_there, out) * _dot(towards, back)
        found = np.conj(_dot(out, back) - 2 / np.maximum(double, 1e-18) * along)
        scale = legs.copies * np.sqrt(gain_out * gain_back)
        return scale * found[1], scale * (found[2] - found[0]) / self._band_hz

    def _of(self, leg: Leg, end: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Directions to the image, gain, and the field at three frequencies; end 0 is the transmitters', 1 the receivers'."""
        end = 0 if self._one_end else end
        if (id(leg), end) not in self._known:
            radar = self._radar
            place = (radar.tx_position_m, radar.rx_position_m)[end]
            pattern = (radar.tx_pattern, radar.rx_pattern)[end]
            towards = leg.image_m - self._points
            length = np.linalg.norm(towards, axis=-1, keepdims=True)
            gain = pattern.gain((leg.unfolded(self._points) - place) / length @ self._axes.T)
            frequencies = radar.mid_frequency_hz + self._band_hz * np.array([-0.5, 0, 0.5])
            self._known[id(leg), end] = towards / length, gain, leg.field(self._points, frequencies)
        return self._known[id(leg), end]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)


def weighted(echoes: EchoArrays, weight: np.ndarray, slope: np.ndarray) -> EchoArrays:
    """`echoes` (T, N) of a flat spectrum times weights that have slopes over frequency, complex (T, N)."""
    values = (echoes.amplitude * factor for factor in (weight, slope))
    return echoes._replace(**{k: v.astype(np.complex64) for k, v in zip(("amplitude", "slope"), values, strict=True)})


def unfolded(
    radar: Radar, echoes: EchoArrays, legs: LegPair, departure_m: np.ndarray, arrival_m: np.ndarray
) -> EchoArrays:
    """For arrays: with the points (T, N, 3) that echoes seem to stand in, given those seen from the antennas' images."""
    if not radar.is_array:
        return echoes
    departure = legs.out.unfolded(departure_m).astype(np.float32)
    if arrival_m is departure_m and legs.out.chain == legs.back.chain:
        return echoes._replace(departure_m=departure, arrival_m=departure)
    return echoes._replace(departure_m=departure, arrival_m=legs.back.unfolded(arrival_m).astype(np.float32))


class Ranked(NamedTuple):
    """A pair of legs, and the level of a reflector at the probes beside that of the strongest pair."""

    pair: LegPair
    best_db: float
    """At the best probe of each."""
    mean_db: float
    """Of the mean power over all probes."""


def ranked_pairs(
    radar: Radar, out: Sequence[Leg], back: Sequence[Leg], probes_m: np.ndarray, *, order: int, transmissions: int = 0
) -> list[Ranked]:
    """Pairs of legs of up to `order` reflections and `transmissions` in all that see any of points (P, 3), strongest in the mean
    first.

    Out and back may be swapped where one antenna does both: then one pair stands for two.
    """
    joined = out is back and not radar.is_array and radar.tx_pattern == radar.rx_pattern
    found: list[tuple[LegPair, float, float]] = []
    arrivals = Arrivals(radar, probes_m)
    amounts = [
        [leg.clear(probes_m) / np.linalg.norm(probes_m - leg.image_m, axis=-1) for leg in legs] for legs in (out, back)
    ]
    for i, first in enumerate(out):
        for j, second in enumerate(back):
            pair = LegPair(out=first, back=second, copies=2 if joined and j > i else 1)
            if pair.order > order or pair.transmissions > transmissions or (joined and j < i):
                continue
            both = amounts[0][i] * amounts[1][j]
            if both.any():
                power = (np.abs(arrivals.weight(pair)[0]) * both) ** 2
                found.append((pair, float(power.max()), float(power.mean())))
    best_of_all = max((best for _, best, _ in found), default=0.0)
    most = max((mean for _, _, mean in found), default=0.0)
    levels = [Ranked(pair, _db(best / best_of_all), _db(mean / most)) for pair, best, mean in found]
    return sorted(levels, key=lambda each: -each.mean_db)


def _db(ratio: float) -> float:
    return 10 * math.log10(max(ratio, 1e-30))
