"""Echoes of a target in a room over a path pair (docs/physics.md, eq. 24)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend, aligned_empty
from t2d_rt.scattering.lanes import Weights
from t2d_rt.types import EchoArrays, MovingMesh, OneWayPath, PathPair, PathSet, Radar
from t2d_rt.types.path_fields import SweepNodes, field_over
from t2d_rt.types.paths import PathKey
from t2d_rt.types.scatterer import Fraction, FrameBlock

ANCHORS, APART_M = 150, 0.04
"""Points of a target at which coefficients are worked out: at most so many, and no nearer to each other than needed."""
NODE_RATE_HZ = 20.0
"""Rate at which a path's field is worked out at the anchors, linear in between: reflection and pattern change by little while a
limb moves by some 10 cm. In a furnished room that errs by -37 dB over the worst pair, and by -58 dB over the median one."""
NEIGHBOURS = 3
"""Anchors that an echo takes its coefficient from."""
RANKING_NODES = 7
"""Frequencies of the sweep at which path pairs are ranked: enough to see what a line over frequency leaves out."""


FacetVisibility = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""0..1 (K, Q) at times [s] (K,), of vertices (K, Q, 3) of triangles (F, 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Visibility of a target over a path pair, or in free space."""

    paths: PathPair | None = None
    visibility: tuple[Fraction, ...] = ()
    """Of each vertex of a mesh, or of each ellipsoid, over the one-way paths: their product; without any, all that faces the
    antennas is visible."""
    subdivision: int = 0
    """Subdivision level of the mesh at whose vertices `visibility` is known (`geometry.SubdividedMesh`)."""
    points: int = 0
    """Number of points at which `visibility` is kept over each one-way path, those of other meshes among them."""
    unblocked: tuple[Fraction, ...] = ()
    """Fraction of the field at a mesh's anchors that the scene does not block, over the one-way paths: their product."""
    facet_visibility: FacetVisibility | None = None
    """Of the facets' own vertices, as a factor on `visibility`."""

    @property
    def name(self) -> str:
        """Of the path pair."""
        return "direct" if self.paths is None else self.paths.name

    @property
    def fractions(self) -> tuple[Fraction, ...]:
        """All fractions of the field that the view needs."""
        return self.visibility + self.unblocked


def product(fractions: Sequence[np.ndarray]) -> np.ndarray | None:
    """That of some arrays; None: there is none."""
    return np.asarray(np.prod(fractions, axis=0)) if fractions else None


def anchor_vertices(rest: np.ndarray) -> np.ndarray:
    """Numbers of a few vertices of (V, 3) m that represent their neighbours, each as far as possible from the others."""
    chosen = [0]
    nearest = np.linalg.norm(rest - rest[0], axis=1)
    while len(chosen) < min(ANCHORS, len(rest)) and nearest.max() > APART_M:
        # Rounded: of equally distant vertices the first one is taken, however the mesh is oriented.
        chosen.append(int(np.argmax(np.round(nearest, 6))))
        nearest = np.minimum(nearest, np.linalg.norm(rest - rest[chosen[-1]], axis=1))
    return np.array(chosen)


@dataclass(frozen=True, slots=True)
class Anchors:
    """A few vertices of a mesh that represent their neighbours."""

    vertices: np.ndarray
    """Their numbers, (A,)."""
    near: np.ndarray
    """Numbers of each echo's own, (N, n)."""
    tables: tuple[Any, Any]
    """These and the fraction of each, flat UInt32 and Float32 on the device."""

    @classmethod
    def of(cls, vertices: np.ndarray, rest: np.ndarray, echoes: np.ndarray, backend: Backend) -> Anchors:
        """Of `anchor_vertices` (A,) of a mesh's vertices (V, 3) and echoes' places (N, 3) in the same pose [m]."""
        from scipy.spatial import cKDTree

        distance, near = cKDTree(rest[vertices]).query(echoes, k=min(NEIGHBOURS, len(vertices)))
        distance, near = distance.reshape(len(echoes), -1), near.reshape(len(echoes), -1)
        fraction = 1 / np.maximum(distance, 1e-6)
        fraction /= fraction.sum(axis=1, keepdims=True)
        return cls(vertices, near, (backend.lanes(near), backend.lanes(fraction, backend.Float32)))

    def weights(self, weight: np.ndarray, slope: np.ndarray, unblocked: np.ndarray | None, backend: Backend) -> Weights:
        """Weights and their slopes at the anchors, complex (T, A), times the fraction `unblocked` (T, A) by the scene."""
        values = aligned_empty(4 * weight.size, np.float32).reshape(*weight.shape[::-1], 4)
        for k, part in enumerate((weight.real, weight.imag, slope.real, slope.imag)):
            values[..., k] = part.T if unblocked is None else (part * unblocked).T
        live = np.ones(len(self.vertices), bool) if unblocked is None else np.asarray(unblocked.any(axis=0))
        near, fraction = self.tables
        return Weights(
            near=near,
            fraction=fraction,
            count=self.near.shape[1],
            values=backend.Float32(values.ravel()),
            reach=live[self.near].any(axis=1),
        )


class Arrivals:
    """Fields of one-way paths at points (..., 3) m, each path computed once, at so many frequencies of the sweep."""

    def __init__(self, radar: Radar, points_m: np.ndarray, frequencies: int = 3) -> None:
        self._radar, self._points, self._axes = radar, points_m, radar.axes
        self.nodes = SweepNodes.of(radar, frequencies)
        self._one_end = (
            radar.tx_pattern == radar.rx_pattern
            and radar.tx_polarization_deg == radar.rx_polarization_deg
            and np.array_equal(radar.tx_position_m, radar.rx_position_m)
        )
        self._known: dict[tuple[PathKey, int], tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def weight(self, paths: PathPair) -> tuple[np.ndarray, np.ndarray]:
        """Factor of a path pair on the amplitude of a reflector there, and its slope over frequency [1/Hz], complex (...)."""
        return self.nodes.line(self.spectrum(paths))

    def spectrum(self, paths: PathPair) -> np.ndarray:
        """That factor at the nodes' frequencies, complex (F, ...).

        Patterns, both paths' coefficients and the change of polarisation at the reflector, that of a facet whose normal n bisects
        the paths: e_out . e_back - 2 (n . e_out)(n . e_back); conjugated, as IF = tx conj(rx).
        """
        (towards, gain_out, out), (from_there, gain_back, back) = self._of(paths.out, 0), self._of(paths.back, 1)
        # Fields are transverse: of twice the bisector, only the other path's part has a component along them.
        double = 2 + 2 * _dot(towards, from_there)
        along = _dot(from_there, out) * _dot(towards, back)
        found = np.conj(_dot(out, back) - 2 / np.maximum(double, 1e-18) * along)
        return np.asarray(paths.copies * np.sqrt(gain_out * gain_back) * found)

    def _of(self, path: OneWayPath, end: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Directions to the image, gain, and the field at the nodes; end 0 is the transmitters', 1 the receivers'."""
        end = 0 if self._one_end else end
        if (path.key, end) not in self._known:
            radar = self._radar
            pattern = (radar.tx_pattern, radar.rx_pattern)[end]
            towards = path.image_m - self._points
            length = np.linalg.norm(towards, axis=-1, keepdims=True)
            gain = pattern.gain((path.unfolded(self._points) - path.antenna_m) / length @ self._axes.T)
            field = field_over(path, self._points, self.nodes.frequencies_hz)
            self._known[path.key, end] = towards / length, gain, field
        return self._known[path.key, end]


@dataclass(frozen=True, slots=True)
class FadedArrivals:
    """Fields of one-way paths at points that move, known at some nodes in time and linear in between."""

    at_nodes: Arrivals
    """At points (K, A, 3) m."""
    fractions: np.ndarray
    """Of the nodes at each frame, (T, K)."""

    @classmethod
    def of(cls, radar: Radar, surface: MovingMesh, vertices: np.ndarray, block: FrameBlock) -> FadedArrivals:
        """At some vertices (A,) of a mesh and the frames of a block: nodes are the same wherever a block begins and ends."""
        times_s, start, stop = block.record_s, block.first, block.last
        last = len(times_s) - 1
        every = max(1, int(last / (times_s[-1] - times_s[0]) / NODE_RATE_HZ))
        nodes = np.unique(np.minimum(np.arange(start // every, -(-(stop - 1) // every) + 1) * every, last))
        frame = np.arange(start, stop)
        above = (
            np.clip(np.searchsorted(nodes, frame), 1, len(nodes) - 1) if len(nodes) > 1 else np.zeros(len(frame), int)
        )
        fractions = np.zeros((len(frame), len(nodes)), np.float32)
        if len(nodes) == 1:
            fractions[:] = 1
        else:
            u = (frame - nodes[above - 1]) / (nodes[above] - nodes[above - 1])
            fractions[frame - start, above - 1], fractions[frame - start, above] = 1 - u, u
        return cls(Arrivals(radar, surface.at(times_s[nodes])[:, vertices]), fractions)

    def weight(self, paths: PathPair) -> tuple[np.ndarray, np.ndarray]:
        """As that of `Arrivals`, (T, A)."""
        weight, slope = self.at_nodes.weight(paths)
        return self.fractions @ weight, self.fractions @ slope


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)


def weighted(echoes: EchoArrays, weight: np.ndarray, slope: np.ndarray) -> EchoArrays:
    """`echoes` (T, N) of a flat spectrum times weights that have slopes over frequency, complex (T, N)."""
    values = (echoes.amplitude * factor for factor in (weight, slope))
    return echoes._replace(**{k: v.astype(np.complex64) for k, v in zip(("amplitude", "slope"), values, strict=True)})


def unfolded(
    radar: Radar, echoes: EchoArrays, paths: PathPair, departure_m: np.ndarray, arrival_m: np.ndarray | None = None
) -> EchoArrays:
    """For arrays: with apparent positions (T, N, 3) of the echoes, given those seen from the antennas' images;
    those of the receivers are the transmitters' where they are not given."""
    if not radar.is_array:
        return echoes
    departure = paths.out.unfolded(departure_m).astype(np.float32)
    if arrival_m is None and paths.out.chain == paths.back.chain:
        return echoes._replace(departure_m=departure)
    arrival = paths.back.unfolded(departure_m if arrival_m is None else arrival_m)
    return echoes._replace(departure_m=departure, arrival_m=arrival.astype(np.float32))


class Ranked(NamedTuple):
    """A path pair, and the level of a reflector at the probes relative to that of the strongest pair."""

    pair: PathPair
    best_db: float
    """At the best probe of each."""
    mean_db: float
    """Of the mean power over all probes."""
    bent_db: float
    """Likewise, of what a line over frequency leaves out of its spectrum over the sweep."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Probed:
    """One-way paths of both ends to points of the targets."""

    probes_m: np.ndarray
    """(Q, 3)."""
    out: PathSet
    back: PathSet
    one_antenna: bool
    """Whether one antenna, of one polarisation, transmits and receives: then both sets are the same."""
    fraction: tuple[np.ndarray, np.ndarray]
    """Of the field of the P paths of each end that reaches the points, (P, Q)."""

    def spreading(self) -> Iterator[np.ndarray]:
        """1 / distance from the paths' images to the points, times what reaches these: (P, Q) of each end."""
        for paths, fraction in zip((self.out, self.back), self.fraction, strict=True):
            yield fraction / np.linalg.norm(self.probes_m - paths.image_m[:, None], axis=-1)


def ranked_pairs(radar: Radar, probed: Probed, *, order: int, transmissions: int = 0) -> list[Ranked]:
    """Path pairs of up to `order` reflections and `transmissions` in all to any of the points, strongest in the mean first.

    Out and back may be swapped where one antenna does both: then one pair stands for two.
    """
    joined = probed.one_antenna and not radar.is_array and radar.tx_pattern == radar.rx_pattern
    found: list[tuple[PathPair, float, float, float]] = []
    arrivals = Arrivals(radar, probed.probes_m, RANKING_NODES)
    amounts = list(probed.spreading())
    out, back = list(probed.out), list(probed.back)
    for i, first in enumerate(out):
        for j, second in enumerate(back):
            pair = PathPair(out=first, back=second, copies=2 if joined and j > i else 1)
            if pair.order > order or pair.transmissions > transmissions or (joined and j < i):
                continue
            both = amounts[0][i] * amounts[1][j]
            if both.any():
                power, bent = (each * both**2 for each in arrivals.nodes.powers(arrivals.spectrum(pair)))
                found.append((pair, float(power.max()), float(power.mean()), float(bent.mean())))
    best_of_all = max((best for _, best, _, _ in found), default=0.0)
    most = max((mean for _, _, mean, _ in found), default=0.0)
    levels = [
        Ranked(pair, _db(best / best_of_all), _db(mean / most), _db(bent / most)) for pair, best, mean, bent in found
    ]
    return sorted(levels, key=lambda each: -each.mean_db)


def _db(ratio: float) -> float:
    return 10 * math.log10(max(ratio, 1e-30))
