"""What a pair of legs does to the echoes of a target in a room (docs/physics.md, eq. 24)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.types import EchoArrays, Leg, LegPair, Radar

ANCHORS = 150
"""Points of a body at which coefficients are worked out: a hand's breadth apart."""
NEIGHBOURS = 3
"""Anchors that an echo takes its coefficient from."""


Share = Callable[[np.ndarray], np.ndarray]
"""0..1 (K, N) at times [s] (K,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A target seen over a pair of legs, or in free space."""

    legs: LegPair | None = None
    seen: Share | None = None
    """Of each vertex of a mesh, or of each ellipsoid; None: all that faces the antennas."""
    passed: Share | None = None
    """Of the field that reaches a mesh's anchors; None: all of it."""


def anchor_vertices(rest: np.ndarray) -> np.ndarray:
    """Numbers of a few vertices (V, 3) that stand for those around them, each as far as may be from the others."""
    chosen = [0]
    nearest = np.linalg.norm(rest - rest[0], axis=1)
    while len(chosen) < min(ANCHORS, len(rest)) and nearest.max() > 1e-6:
        # Rounded: of vertices as far the first one is taken, whichever way the mesh lies.
        chosen.append(int(np.argmax(np.round(nearest, 6))))
        nearest = np.minimum(nearest, np.linalg.norm(rest - rest[chosen[-1]], axis=1))
    return np.array(chosen)


@dataclass(frozen=True, slots=True)
class Anchors:
    """A few vertices of a mesh that stand for what lies around them."""

    vertices: np.ndarray
    """Their numbers, (A,)."""
    shares: Any
    """Sparse (A, N): values at the anchors times this are those of the echoes."""

    @classmethod
    def of(cls, vertices: np.ndarray, rest: np.ndarray, echoes: np.ndarray) -> Anchors:
        """Of `anchor_vertices` (A,) of a mesh's vertices (V, 3) and echoes' places (N, 3) in the same pose [m]."""
        from scipy.sparse import csr_array
        from scipy.spatial import cKDTree

        distance, near = cKDTree(rest[vertices]).query(echoes, k=min(NEIGHBOURS, len(vertices)))
        distance, near = distance.reshape(len(echoes), -1), near.reshape(len(echoes), -1)
        weight = 1 / np.maximum(distance, 1e-6)
        weight /= weight.sum(axis=1, keepdims=True)
        echo = np.repeat(np.arange(len(echoes)), near.shape[1])
        shares = csr_array((weight.ravel(), (near.ravel(), echo)), shape=(len(vertices), len(echoes)))
        return cls(vertices, shares)


class Arrivals:
    """What legs bring to points (..., 3) m, each leg worked out once."""

    def __init__(self, radar: Radar, points_m: np.ndarray) -> None:
        self._radar, self._points = radar, points_m
        self._band_hz = radar.bandwidth_hz / 2
        self._known: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, list[np.ndarray]]] = {}

    def weight(self, legs: LegPair) -> tuple[np.ndarray, np.ndarray]:
        """What a pair of legs makes of the amplitude of a reflector there, and its slope over frequency [1/Hz], complex (...).

        Patterns, both legs' coefficients and the reflector's own turn of the polarisation, that of a facet whose normal n bisects
        the legs: e_out . e_back - 2 (n . e_out)(n . e_back); conjugated, as IF = tx conj(rx).
        """
        (towards, gain_out, out), (from_there, gain_back, back) = self._of(legs.out, 0), self._of(legs.back, 1)
        normal = towards + from_there
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
        found = [
            np.conj(np.sum(o * b, axis=-1) - 2 * np.sum(normal * o, axis=-1) * np.sum(normal * b, axis=-1))
            for o, b in zip(out, back, strict=True)
        ]
        scale = legs.copies * np.sqrt(gain_out * gain_back)
        return scale * found[1], scale * (found[2] - found[0]) / self._band_hz

    def _of(self, leg: Leg, end: int) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        """Directions to the image, gain, and the field at three frequencies; end 0 is the transmitters', 1 the receivers'."""
        if (id(leg), end) not in self._known:
            radar = self._radar
            place = (radar.tx_position_m, radar.rx_position_m)[end]
            pattern = (radar.tx_pattern, radar.rx_pattern)[end]
            towards = leg.image_m - self._points
            length = np.linalg.norm(towards, axis=-1, keepdims=True)
            gain = pattern.gain((leg.unfolded(self._points) - place) / length @ radar.axes.T)
            frequencies = radar.mid_frequency_hz + self._band_hz * np.array([-0.5, 0, 0.5])
            fields = [leg.field(self._points, float(frequency)) for frequency in frequencies]
            self._known[id(leg), end] = towards / length, gain, fields
        return self._known[id(leg), end]


def over_legs(
    radar: Radar,
    echoes: EchoArrays,
    legs: LegPair,
    arrivals: Arrivals,
    shares: Any | None,
    passed: np.ndarray | None,
    departure_m: np.ndarray | None,
    arrival_m: np.ndarray | None,
) -> EchoArrays:
    """`echoes` (T, N) over a pair of legs, from coefficients at anchors (T, A), whose `shares` they are, None being one each;
    `passed` (T, A) is what of the field reaches these.

    For arrays: the points (T, N, 3) that echoes seem to stand in, seen from the images of transmitters and receivers.
    """
    weights = [(values if passed is None else values * passed).astype(np.complex64) for values in arrivals.weight(legs)]
    weight, weight_slope = weights if shares is None else (values @ shares for values in weights)
    amplitude = (echoes.amplitude * weight).astype(np.complex64)
    slope = echoes.amplitude * weight_slope
    if echoes.slope is not None:
        slope = slope + echoes.slope * weight
    echoes = echoes._replace(amplitude=amplitude, slope=slope.astype(np.complex64))
    if not radar.is_array or departure_m is None or arrival_m is None:
        return echoes
    departure = legs.out.unfolded(departure_m).astype(np.float32)
    if arrival_m is departure_m and legs.out.chain == legs.back.chain:
        return echoes._replace(departure_m=departure, arrival_m=departure)
    return echoes._replace(departure_m=departure, arrival_m=legs.back.unfolded(arrival_m).astype(np.float32))


def ranked_pairs(
    radar: Radar, out: Sequence[Leg], back: Sequence[Leg], probes_m: np.ndarray, *, order: int
) -> list[tuple[LegPair, float]]:
    """Pairs of legs of up to `order` reflections in all that see any of points (P, 3), strongest first, and the levels of a
    reflector at its best point beside the strongest pair's [dB].

    Out and back may be swapped where one antenna does both: then one pair stands for two.
    """
    joined = out is back and not radar.is_array and radar.tx_pattern == radar.rx_pattern
    levels: list[tuple[LegPair, float]] = []
    arrivals = Arrivals(radar, probes_m)
    amounts = [
        [leg.clear(probes_m) / np.linalg.norm(probes_m - leg.image_m, axis=-1) for leg in legs] for legs in (out, back)
    ]
    for i, first in enumerate(out):
        for j, second in enumerate(back):
            if first.order + second.order > order or (joined and j < i):
                continue
            pair = LegPair(out=first, back=second, copies=2 if joined and j > i else 1)
            both = amounts[0][i] * amounts[1][j]
            if both.any():
                weight, _ = arrivals.weight(pair)
                levels.append((pair, 20 * math.log10(max(float((np.abs(weight) * both).max()), 1e-30))))
    top = max((level for _, level in levels), default=0.0)
    return sorted(((pair, level - top) for pair, level in levels), key=lambda each: -each[1])
