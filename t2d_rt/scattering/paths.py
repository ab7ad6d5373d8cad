"""Echoes of a target in a room over a path pair (docs/physics.md, eq. 24)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend, aligned_empty
from t2d_rt.core.memory import blocks
from t2d_rt.geometry.vectors import dot
from t2d_rt.scattering.lanes import Weights
from t2d_rt.types import EchoArrays, PathPair, PathSet, Radar
from t2d_rt.types.path_fields import SweepNodes, fields_over
from t2d_rt.types.scatterer import Fraction, FrameBlock

ANCHORS, APART_M = 150, 0.04
"""Greatest number of anchors, where coefficients are found; there are fewer if all vertices are within the second [m] of one."""
NODE_RATE_HZ = 20.0
"""Approximate rate [Hz] at which a path's field is worked out at the anchors, linear in between: reflection and pattern change by
little while a limb moves by some 10 cm. In a furnished room that errs by -37 dB over the worst pair, and by -58 dB over the median
one."""
NEIGHBOURS = 3
"""Number of anchors from which an echo takes its coefficient."""
RANKING_NODES = 7
"""Number of frequencies of the sweep at which path pairs are ranked: enough to see what a line over frequency leaves out."""


FacetVisibility = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Function that gives the visibility (K, Q), at times (K,) [s], of vertices (K, Q, 3) [m] of triangles (F, 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PathVisibility:
    """Visibility of a target over a path pair, or in free space."""

    paths: PathPair | None = None
    visibility: tuple[Fraction, ...] = ()
    """Visibility of each vertex of a mesh, or of each ellipsoid, over the one-way paths, whose product counts; without any, all
    that faces the antennas is visible."""
    subdivision: int = 0
    """Subdivision level of the mesh at whose vertices `visibility` is known (`geometry.SubdividedMesh`)."""
    points: int = 0
    """Number of points at which `visibility` is kept over each one-way path, those of other meshes among them."""
    unblocked: tuple[Fraction, ...] = ()
    """Fraction of the field at a mesh's anchors that the scene does not block over each one-way path; their product counts."""
    facet_visibility: FacetVisibility | None = None
    """Visibility of the facets' own vertices, as a factor on `visibility`."""

    @property
    def name(self) -> str:
        """Name of the path pair."""
        return "direct" if self.paths is None else self.paths.name

    @property
    def fractions(self) -> tuple[Fraction, ...]:
        """All fractions of the field that the view needs."""
        return self.visibility + self.unblocked


def product(fractions: Sequence[np.ndarray]) -> np.ndarray | None:
    """Product of some arrays; None if there are none."""
    return np.asarray(np.prod(fractions, axis=0)) if fractions else None


def anchor_vertices(rest: np.ndarray) -> np.ndarray:
    """Numbers of a few of the vertices (V, 3) [m] that represent their neighbours, each as far as possible from the others."""
    chosen = [0]
    nearest = np.linalg.norm(rest - rest[0], axis=1)
    while len(chosen) < min(ANCHORS, len(rest)) and nearest.max() > APART_M:
        # Rounding takes the first of equally distant vertices, however the mesh is oriented.
        chosen.append(int(np.argmax(np.round(nearest, 6))))
        nearest = np.minimum(nearest, np.linalg.norm(rest - rest[chosen[-1]], axis=1))
    return np.array(chosen)


@dataclass(frozen=True, slots=True)
class Anchors:
    """A few vertices of a mesh that represent their neighbours."""

    vertices: np.ndarray
    """Numbers of these vertices, (A,)."""
    near: np.ndarray
    """Numbers of each echo's n anchors, (N, n)."""
    tables: tuple[Any, Any]
    """`near` and the weight of each of these anchors, flat UInt32 and Float32 on the device."""

    @classmethod
    def of(cls, vertices: np.ndarray, rest: np.ndarray, echoes: np.ndarray, backend: Backend) -> Anchors:
        """Anchors from `anchor_vertices` (A,) of a mesh's vertices (V, 3), for echoes at places (N, 3) in the same pose [m]."""
        from scipy.spatial import cKDTree

        distance, near = cKDTree(rest[vertices]).query(echoes, k=min(NEIGHBOURS, len(vertices)))
        distance, near = distance.reshape(len(echoes), -1), near.reshape(len(echoes), -1)
        fraction = 1 / np.maximum(distance, 1e-6)
        fraction /= fraction.sum(axis=1, keepdims=True)
        return cls(vertices, near, (backend.lanes(near), backend.lanes(fraction, backend.Float32)))

    def weights(self, weight: np.ndarray, slope: np.ndarray, unblocked: np.ndarray | None, backend: Backend) -> Weights:
        """Weights and their slopes at the anchors, complex (T, A), times the fraction (T, A) that the scene leaves unblocked."""
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


class _End(NamedTuple):
    """What P one-way paths bring to points (...), components first."""

    towards: np.ndarray
    """Unit vectors to the antenna's images, (3, P, ...)."""
    field: np.ndarray
    """Fields at F frequencies, with the antenna's pattern, complex (3, F, P, ...)."""


@dataclass(frozen=True, slots=True)
class ArrivingFields:
    """Fields over N path pairs at points (...) and at some frequencies of the sweep; each one-way path's is computed once."""

    ends: tuple[_End, _End]
    """Fields of the transmitters' paths and of the receivers' paths."""
    numbers: np.ndarray
    """Number of each pair's path among those of either end, (2, N)."""
    copies: np.ndarray
    """Number of path pairs that each pair stands for, (N,)."""
    nodes: SweepNodes

    @classmethod
    def of(
        cls,
        radar: Radar,
        pairs: Sequence[PathPair],
        points_m: np.ndarray,
        times_s: np.ndarray | None,
        frequencies: int = 3,
    ) -> ArrivingFields:
        """Fields at points (..., 3) [m] and F frequencies; at points (K, ..., 3) at times (K,) [s] where the radar moves."""
        nodes = SweepNodes.of(radar, frequencies)
        one_end = (
            radar.tx_pattern == radar.rx_pattern
            and radar.tx_polarization_deg == radar.rx_polarization_deg
            and np.array_equal(radar.tx_position_m, radar.rx_position_m)
        )
        out, back = [pair.out for pair in pairs], [pair.back for pair in pairs]
        numbers: list[int] = []
        ends: list[_End] = []
        for paths, pattern in (
            [(out + back, radar.tx_pattern)] if one_end else [(out, radar.tx_pattern), (back, radar.rx_pattern)]
        ):
            by_key = {path.key: path for path in paths}
            place = {key: number for number, key in enumerate(by_key)}
            numbers += [place[path.key] for path in paths]
            fields = fields_over(list(by_key.values()), points_m, nodes.frequencies_hz, times_s)
            gain = pattern.gain(np.moveaxis(fields.departure, 0, -1) @ radar.axes.T)
            ends.append(_End(-fields.arrival, fields.field * np.sqrt(gain)))
        copies = np.array([pair.copies for pair in pairs])
        return cls((ends[0], ends[-1]), np.array(numbers).reshape(2, -1), copies, nodes)

    def spectra(self, selection: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Factor of the `selection` of the pairs on the amplitude of a reflector at the points, complex (F, N, ...).

        It holds patterns, both paths' coefficients and the change of polarisation at the reflector, that of a facet whose normal n
        bisects the paths: e_out . e_back - 2 (n . e_out)(n . e_back) (eq. 24); it is conjugated, as IF = tx conj(rx).
        """
        (towards, out), (from_there, back) = (
            (end.towards[:, of_pairs], end.field[:, :, of_pairs])
            for end, of_pairs in zip(self.ends, self.numbers[:, selection], strict=True)
        )
        # Fields are transverse: of twice the bisector, only the other path's part has a component along them.
        double = 2 + 2 * dot(towards, from_there)
        along = dot(from_there, out) * dot(towards, back)
        factor = np.conj(dot(out, back) - 2 / np.maximum(double, 1e-18) * along)
        return np.asarray(self.copies[selection].reshape(-1, *[1] * (double.ndim - 1)) * factor)

    def weights(self) -> tuple[np.ndarray, np.ndarray]:
        """Value at mid-sweep and slope [1/Hz] of the line over frequency nearest to that factor (eq. 24a), complex (N, ...)."""
        points = math.prod(self.ends[0].towards.shape[2:])
        parts = blocks(np.arange(len(self.copies)), len(self.nodes.frequencies_hz) * points)
        weight, slope = zip(*(self.nodes.line(self.spectra(part)) for part in parts), strict=True)
        return np.concatenate(weight), np.concatenate(slope)


def faded_weights(
    radar: Radar,
    pairs: Sequence[PathPair],
    block: FrameBlock,
    points_m: np.ndarray,
    points_at: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """`ArrivingFields.weights` at points that move, complex (N, T, A): known at some nodes in time and linear in between, or at
    each frame of a radar that rotates.

    The points are `points_m` (T, A, 3) at the frames of a block, `points_at` at other times [s]; all blocks have the same nodes.
    """
    times_s, start, stop = block.record_s, block.first, block.last
    last = len(times_s) - 1
    rotates = radar.track is not None and radar.track.orientations is not None
    step = 1 if rotates else max(1, round(last / (times_s[-1] - times_s[0]) / NODE_RATE_HZ))
    nodes = np.unique(np.minimum(np.arange(start // step, -(-(stop - 1) // step) + 1) * step, last))
    beyond = (nodes < start) | (nodes >= stop)
    at_nodes = points_m[np.clip(nodes, start, stop - 1) - start]
    if beyond.any():
        at_nodes[beyond] = points_at(times_s[nodes[beyond]])
    weight, slope = ArrivingFields.of(radar, pairs, at_nodes, times_s[nodes]).weights()
    frame, column = np.arange(start, stop), np.arange(len(nodes))
    place = np.interp(frame, nodes, column)[:, None]
    fractions = np.maximum(0, 1 - np.abs(place - column))
    return fractions @ weight, fractions @ slope


def unfolded(
    radar: Radar,
    echoes: EchoArrays,
    paths: PathPair,
    times_s: np.ndarray,
    departure_m: np.ndarray,
    arrival_m: np.ndarray | None = None,
) -> EchoArrays:
    """For an array, echoes with apparent positions (T, N, 3) [m] at times (T,) [s], from the positions that the antennas' images
    see; without `arrival_m` the receivers' images see what the transmitters' do. Otherwise the echoes as they are."""
    if not radar.is_array:
        return echoes
    departure = paths.out.unfolded(departure_m, times_s).astype(np.float32)
    if arrival_m is None and paths.out.chain == paths.back.chain:
        return echoes._replace(departure_m=departure)
    arrival = paths.back.unfolded(departure_m if arrival_m is None else arrival_m, times_s)
    return echoes._replace(departure_m=departure, arrival_m=arrival.astype(np.float32))


class Ranked(NamedTuple):
    """A path pair, and the level of a reflector at the probes relative to that of the strongest pair."""

    pair: PathPair
    best_db: float
    """Level at the pair's best probe."""
    mean_db: float
    """Level of the mean power over all probes."""
    bent_db: float
    """Level of the mean power that a line over frequency leaves out of the pair's spectrum over the sweep (eq. 24a)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Probed:
    """One-way paths of both ends to points of the targets."""

    probes_m: np.ndarray
    """Points [m], (Q, 3)."""
    probed_s: np.ndarray | None = None
    """Times [s] at which the points are there, (Q,); needed where the radar moves."""
    out: PathSet
    back: PathSet
    one_antenna: bool
    """Whether one antenna, of one polarisation, transmits and receives: then both sets are the same."""
    fraction: tuple[np.ndarray, np.ndarray]
    """Fraction of the field of the P paths of each end that reaches the points, (P, Q)."""

    def spreading(self) -> Iterator[np.ndarray]:
        """Yields for either end 1/distance [1/m] from the paths' images to the points, times the fraction that arrives there,
        (P, Q)."""
        for paths, fraction in zip((self.out, self.back), self.fraction, strict=True):
            places = paths.image_m[:, None]
            if paths.passing is not None:
                shape = self.probes_m.shape
                places = np.stack([np.broadcast_to(path.place_m(self.probed_s), shape) for path in paths])
            yield fraction / np.linalg.norm(self.probes_m - places, axis=-1)


def ranked_pairs(radar: Radar, probed: Probed, *, order: int, transmissions: int = 0) -> list[Ranked]:
    """Path pairs of up to `order` reflections and `transmissions` in all to any of the points, strongest in the mean first.

    Out and back may be swapped where one antenna does both: then one pair stands for two.
    """
    joined = probed.one_antenna and not radar.is_array and radar.tx_pattern == radar.rx_pattern
    out, back = list(probed.out), list(probed.back)
    allowed = np.ones((len(out), len(back)), bool)
    for name, most in (("order", order), ("transmissions", transmissions)):
        counts = [np.array([getattr(path, name) for path in side], int) for side in (out, back)]
        allowed &= np.add.outer(*counts) <= most
    if joined:
        allowed = np.triu(allowed)
    spread = list(probed.spreading())
    reached = (spread[0] > 0).astype(np.float32) @ (spread[1] > 0).T.astype(np.float32) > 0  # by both paths at once
    rows = np.argwhere(allowed & reached)
    if not len(rows):
        return []
    pairs = [PathPair(out=out[i], back=back[j], copies=2 if joined and j > i else 1) for i, j in rows.tolist()]
    arrivals = ArrivingFields.of(radar, pairs, probed.probes_m, probed.probed_s, RANKING_NODES)
    measures = []
    for part in blocks(np.arange(len(pairs)), RANKING_NODES * len(probed.probes_m)):
        amount = (spread[0][rows[part, 0]] * spread[1][rows[part, 1]]) ** 2
        power, bent = (values * amount for values in arrivals.nodes.powers(arrivals.spectra(part)))
        measures.append((power.max(axis=1), power.mean(axis=1), bent.mean(axis=1)))
    best, mean, bent = (np.concatenate(column) for column in zip(*measures, strict=True))
    levels = zip(pairs, _db(best / best.max()), _db(mean / mean.max()), _db(bent / mean.max()), strict=True)
    return sorted((Ranked(*level) for level in levels), key=lambda ranked: -ranked.mean_db)


def _db(ratio: np.ndarray) -> list[float]:
    return (10 * np.log10(np.maximum(ratio, 1e-30))).tolist()  # type: ignore[no-any-return]
