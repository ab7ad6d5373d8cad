"""Groups of ray tubes, which return one echo each: tubes between the same cells of the surfaces, whose phases relative to the
strongest one change slowly from frame to frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.geometry.vectors import cross
from t2d_rt.scattering.curved_integral import facet_integral
from t2d_rt.scattering.lanes import Vector, lane_ops, minus, norm
from t2d_rt.scattering.reflectors import Reflectors, carried_along
from t2d_rt.scattering.tubes import Tubes
from t2d_rt.types import Radar

LEFT_OUT = 1e-4
"""The weakest groups, which together hold this fraction of the power between two targets, are left out."""
MOST_LANES = 4_000_000
"""Greatest number of lanes of a kernel."""


@dataclass(frozen=True, slots=True)
class Cells:
    """A grid of cubes over the targets at rest."""

    reflectors: Reflectors
    origin: np.ndarray
    counts: np.ndarray
    size_m: float

    @classmethod
    def of(cls, reflectors: Reflectors, size_m: float) -> Cells:
        """Cells of that size [m] around the surfaces at rest."""
        low, high = reflectors.rest.min(axis=0) - size_m, reflectors.rest.max(axis=0) + size_m
        return cls(reflectors, low, np.ceil((high - low) / size_m).astype(np.int64) + 1, size_m)

    def numbers(self, faces: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Numbers (...) of the cells of points in facets (...) at `PosedReflectors.coordinates` (..., 3)."""
        rest = carried_along(self.reflectors.rest[self.reflectors.faces[faces]], coordinates)
        place = np.clip(((rest - self.origin) / self.size_m).astype(np.int64), 0, self.counts - 1)
        target = self.reflectors.target[faces]
        return ((target * self.counts[0] + place[..., 0]) * self.counts[1] + place[..., 1]) * self.counts[2] + place[
            ..., 2
        ]


@dataclass(frozen=True, slots=True)
class TubeSample:
    """Tubes of one number of bounces at a sample time, those of each group together."""

    tubes: Tubes
    codes: np.ndarray
    """Numbers of the cells that the paths of each group meet, in lexical order, (G, B)."""
    group: np.ndarray
    """Group of each tube, ascending; the strongest tube of a group comes first, (M,)."""

    @classmethod
    def of(cls, tubes: Tubes, cells: Cells) -> TubeSample:
        """A sample of tubes in any order."""
        corner = tubes.nodes[:, 0]
        codes = cells.numbers(tubes.faces[corner], tubes.coordinates[corner])
        order = np.lexsort([-tubes.level, *codes.T[::-1]])
        codes = codes[order]
        new = _differs(codes)
        return cls(tubes.only(order), codes[new], np.cumsum(new) - 1)

    @property
    def strongest(self) -> np.ndarray:
        """Number of the strongest tube of each group, (G,)."""
        return np.flatnonzero(np.diff(self.group, prepend=-1))

    def of_carriers(self) -> TubeSample:
        """Each group's strongest tube alone, which is all that its echo's delay needs."""
        return TubeSample(self.tubes.only(self.strongest), self.codes, np.arange(len(self.codes)))

    @property
    def carriers(self) -> np.ndarray:
        """Path that gives each group's echo its delay, (G,)."""
        return self.tubes.nodes[self.strongest, 0]


def _differs(rows: np.ndarray) -> np.ndarray:
    """Which rows (N, C) differ from the one before, bool (N,); the first one does."""
    differs = np.ones(len(rows), bool)
    differs[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    return differs


def _counting(power: np.ndarray) -> np.ndarray:
    """Numbers, ascending, of the groups that hold all but `LEFT_OUT` of the power (N,)."""
    order = np.argsort(power, kind="stable")
    return np.sort(order[np.cumsum(power[order]) > LEFT_OUT * power.sum()])


@dataclass(frozen=True, slots=True)
class Groups:
    """Groups of tubes over the whole record, which return one echo each."""

    bounces: np.ndarray
    """Number of bounces of each group, (G,)."""
    codes: np.ndarray
    """Cells that their paths meet, in lexical order among groups of as many bounces, -1 beyond the last bounce, (G, B)."""
    faces: np.ndarray
    """Facets that the strongest tube meets; its path is the carrier, (G, B)."""
    coordinates: np.ndarray
    """Where the carrier meets these facets (`PosedReflectors.coordinates`), (G, B, 3)."""

    def __len__(self) -> int:
        return len(self.bounces)

    @classmethod
    def of(cls, samples: Sequence[TubeSample], powers: Sequence[np.ndarray], most: int, target: np.ndarray) -> Groups:
        """All groups of up to `most` bounces in any sample, without the weakest between the same two targets (`LEFT_OUT`); `powers`
        are those of each sample's groups (G,), `target` (F,) is that of each facet."""
        of_samples: list[Groups] = []
        for sample in samples:
            tubes, path = sample.tubes, sample.carriers
            bounces = tubes.faces.shape[1]
            wider = ((0, 0), (0, most - bounces))
            of_samples.append(
                cls(
                    np.full(len(path), bounces),
                    np.pad(sample.codes, wider, constant_values=-1),
                    np.pad(tubes.faces[path], wider),
                    np.pad(tubes.coordinates[path], (*wider, (0, 0))),
                )
            )
        all_groups = cls(*(np.concatenate([getattr(groups, name) for groups in of_samples]) for name in cls.__slots__))
        level = np.concatenate([sample.tubes.level[sample.strongest] for sample in samples])
        keys = np.column_stack([all_groups.bounces, all_groups.codes])
        order = np.lexsort([-level, *keys.T[::-1]])
        keys, power = keys[order], np.concatenate(powers)[order]
        new = np.flatnonzero(_differs(keys))
        if not len(new):
            return all_groups.only(new)
        chosen, power = order[new], np.add.reduceat(power, new)
        last = all_groups.faces[chosen, all_groups.bounces[chosen] - 1]
        between = target[all_groups.faces[chosen, 0]] * (target.max() + 1) + target[last]
        counting = [
            rows[_counting(power[rows])]
            for rows in (np.flatnonzero(between == targets) for targets in np.unique(between))
        ]
        return all_groups.only(chosen[np.sort(np.concatenate(counting))])

    def only(self, chosen: np.ndarray | slice) -> Groups:
        """The groups that are chosen."""
        return Groups(self.bounces[chosen], self.codes[chosen], self.faces[chosen], self.coordinates[chosen])

    def of_bounces(self, bounces: int) -> tuple[Groups, int]:
        """The groups of that number of bounces, and the number of the first."""
        first, last = np.searchsorted(self.bounces, [bounces, bounces + 1])
        rows = slice(first, last)
        narrow = (column[rows, :bounces] for column in (self.codes, self.faces, self.coordinates))
        return Groups(self.bounces[rows], *narrow), int(first)

    def columns(self, codes: np.ndarray) -> np.ndarray:
        """Numbers (N,), among these groups, of groups of as many bounces with codes (N, B); -1 for those that are not there."""
        if not len(self):
            return np.full(len(codes), -1)
        joined = np.concatenate([self.codes, codes])
        _, number = np.unique(joined, axis=0, return_inverse=True)
        place_of = np.full(number.max() + 1, -1)
        place_of[number.ravel()[: len(self)]] = np.arange(len(self))
        return np.asarray(place_of[number.ravel()[len(self) :]])


@dataclass(frozen=True, slots=True)
class Frames:
    """Targets at some frames."""

    vertices: np.ndarray
    """Vertices [m], (T, V, 3)."""
    track: VertexTrack
    """The vertices on the device."""
    facets: np.ndarray
    """Vertices at the corners of each facet, (F, 3)."""
    radar: Radar

    @classmethod
    def of(cls, reflectors: Reflectors, times_s: np.ndarray, radar: Radar, backend: Backend) -> Frames:
        """The surfaces at these times [s]."""
        vertices = reflectors.at(times_s)
        return cls(vertices, VertexTrack(vertices, backend), reflectors.faces, radar)

    def powers(self, sample: TubeSample) -> np.ndarray:
        """Power that the groups of a sample return at the first frame, but for a common factor, (G,)."""
        tubes, path, first = sample.tubes, sample.carriers, np.arange(1)
        if not len(path):
            return np.zeros(0)
        carriers = self.lengths(tubes.faces[path], tubes.coordinates[path], tubes.sense[path], first)
        sums, _ = self.sums(sample, np.arange(len(path)), carriers.numpy().reshape(-1, 1), first)
        return np.asarray(np.abs(sums[:, 0]) ** 2)

    def lengths(self, faces: np.ndarray, coordinates: np.ndarray, sense: np.ndarray, frames: np.ndarray) -> Any:
        """Lengths [m] of paths over facets (N, B) at some of the frames (K,), as `path_lengths` gives them."""
        ends = self.radar.tx_position_m, self.radar.rx_position_m
        return path_lengths(self.track, frames, self.facets[faces], coordinates, sense, ends)

    def places(self, groups: Groups, end: np.ndarray) -> np.ndarray:
        """Places [m] where the carriers of groups meet a surface at bounce `end` (G,), counted from 0, at all frames, (T, G, 3)."""
        numbers = np.arange(len(groups))
        corners = self.facets[groups.faces[numbers, end]]
        return np.stack([carried_along(vertex[corners], groups.coordinates[numbers, end]) for vertex in self.vertices])

    def sums(
        self, sample: TubeSample, column: np.ndarray, carriers_m: np.ndarray, frames: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Fields of those of a sample's groups whose column (G,) among the carriers (G', T) [m] is not -1, and their derivatives as
        in `tube_fields`, at some frames: complex (G'', K)."""
        backend, tubes, row = self.track.backend, sample.tubes, np.cumsum(column >= 0) - 1
        used = (column >= 0)[sample.group]
        totals = np.zeros((2, np.count_nonzero(column >= 0), len(frames)), complex)
        step = max(1, MOST_LANES // max(1, len(tubes.faces), len(tubes.factor)))
        for first in range(0, len(frames) if used.any() else 0, step):
            block = slice(first, first + step)
            lengths = self.lengths(tubes.faces, tubes.coordinates, tubes.sense, frames[block])
            carriers = backend.lanes(carriers_m[:, frames[block]], backend.Float64)
            for chosen, nodes in ((used & tubes.curved, 6), (used & ~tubes.curved, 3)):
                numbers = np.flatnonzero(chosen)
                if not len(numbers):
                    continue
                group = sample.group[numbers]
                values = tube_fields(
                    Lengths(lengths, carriers, len(frames[block])),
                    tubes.nodes[numbers, :nodes],
                    column[group],
                    tubes.amplitude[numbers],
                    2 * math.pi / self.radar.wavelength_m,
                    backend,
                )
                starts = np.flatnonzero(np.append(True, group[1:] != group[:-1]))
                for total, value in zip(totals, values, strict=True):
                    total[row[group[starts]], block] += np.add.reduceat(value * tubes.factor[numbers, None], starts)
        return totals[0], totals[1]


class VertexTrack:
    """Vertices at some frames, on the device."""

    def __init__(self, vertices: np.ndarray, backend: Backend) -> None:
        """Puts vertices (T, V, 3) [m] on the device."""
        self.frames, self.vertices = vertices.shape[:2]
        self.backend = backend
        self.numbers = backend.lanes(vertices, backend.Float64)


def path_lengths(
    track: VertexTrack,
    frames: np.ndarray,
    corners: np.ndarray,
    coordinates: np.ndarray,
    sense: np.ndarray,
    ends_m: tuple[np.ndarray, np.ndarray],
) -> Any:
    """Lengths [m] of paths from a transmitter over B points to a receiver at some of a track's frames (K,): flat Float64 (N, K).

    The points lie in triangles with vertices `corners` (N, B, 3) at `coordinates` (N, B, 3); `sense` (N, B - 1) is the sign of each
    part between them.
    """
    import drjit as dr

    backend = track.backend
    UInt32, Float64 = backend.UInt32, backend.Float64
    lane = dr.arange(UInt32, len(corners) * len(frames))
    per_path = dr.opaque(UInt32, len(frames))
    path = lane // per_path
    row = dr.gather(UInt32, backend.lanes(frames), lane - path * per_path) * dr.opaque(UInt32, track.vertices)

    def of_path(values: np.ndarray, kind: Any) -> Any:
        return dr.gather(kind, backend.lanes(values, kind), path)

    def fixed(place_m: np.ndarray) -> Vector:
        return tuple(dr.opaque(Float64, float(x)) for x in place_m)

    def vertex(numbers: np.ndarray) -> Vector:
        first = 3 * (row + of_path(numbers, UInt32))
        return tuple(dr.gather(Float64, track.numbers, first + axis) for axis in range(3))

    total, last = dr.zeros(Float64, len(corners) * len(frames)), fixed(ends_m[0])
    for bounce in range(corners.shape[1]):
        a, b, c = (vertex(corners[:, bounce, i]) for i in range(3))
        u, v = minus(b, a), minus(c, a)
        normal = cross(u, v)
        along_u, along_v, off = (of_path(coordinates[:, bounce, i], Float64) for i in range(3))
        off = off / norm(normal)
        place = tuple(x + along_u * p + along_v * q + off * n for x, p, q, n in zip(a, u, v, normal, strict=True))
        part = norm(minus(place, last))
        total = total + (part if bounce == 0 else part * of_path(sense[:, bounce - 1], Float64))
        last = place
    total = total + norm(minus(fixed(ends_m[1]), last))
    dr.eval(total)
    return total


class Lengths(NamedTuple):
    """Lengths of paths at K frames, on the device."""

    nodes_m: Any
    """Lengths [m] of the N paths, flat Float64 (N, K)."""
    carriers_m: Any
    """Lengths [m] of the G carriers, flat Float64 (G, K)."""
    frames: int
    """Number K of the frames."""


def tube_fields(
    lengths: Lengths,
    nodes: np.ndarray,
    carrier: np.ndarray,
    amplitude: np.ndarray,
    wavenumber: float,
    backend: Backend,
) -> tuple[np.ndarray, np.ndarray]:
    """Integral I of amplitude times exp(j phase) over tubes at some frames, without their carriers' phases, and d(w I)/dw, w the
    relative frequency (eq. 4, 30): complex64 (M, K).

    `nodes` (M, 6), or (M, 3) where the phase is linear, are paths, and `carrier` (M,) the tubes' carriers; `amplitude` (M, 3) is
    that at the corners, and `wavenumber` is in rad/m.
    """
    import drjit as dr

    UInt32, Float32, Float64 = backend.UInt32, backend.Float32, backend.Float64
    lane = dr.arange(UInt32, len(nodes) * lengths.frames)
    per_tube = dr.opaque(UInt32, lengths.frames)
    tube = lane // per_tube
    frame = lane - tube * per_tube

    def read(values: Any, rows: np.ndarray) -> Any:
        return dr.gather(Float64, values, dr.gather(UInt32, backend.lanes(rows), tube) * per_tube + frame)

    carrier_m = read(lengths.carriers_m, carrier)
    k = dr.opaque(Float64, float(wavenumber))
    phases = [Float32(k * (read(lengths.nodes_m, column) - carrier_m)) for column in nodes.T]
    corners = [dr.gather(Float32, backend.lanes(column, Float32), tube) for column in amplitude.T]
    amplitudes = [(corners[0] + corners[1] + corners[2]) * (1 / 3)] if len(phases) == 3 else corners
    integral = facet_integral(phases, amplitudes, lane_ops(dr))
    flat = [dr.ravel(backend.arrays.Array2f(*parts)) for parts in integral]
    dr.eval(flat)
    fields = [np.asarray(parts).view(np.complex64).reshape(len(nodes), lengths.frames) for parts in flat]
    return fields[0], fields[1]
