"""How the field of a one-way path fades at the edges of its mirrors and of obstacles (docs/physics.md, eq. 28).

It fades with the free fraction of the rays that fill the first Fresnel zone along the path (eq. 27).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import methodcaller
from typing import NamedTuple

import numpy as np

from t2d_rt.core.backend import in_threads
from t2d_rt.core.memory import blocks
from t2d_rt.propagation.images import unfolded_vertices
from t2d_rt.propagation.mirrors import OUTLINE_M, SKIN_M, Mirrors
from t2d_rt.types import OneWayPath
from t2d_rt.types.paths import points_in_scene

STRAIGHT = 1e-8
"""Squared change of direction below which a path goes straight on, as through a slab: what is less is rounding."""


def disc(count: int) -> np.ndarray:
    """Points (count, 2) spread evenly over the unit disc: a Fibonacci lattice, rotated so that upright and level edges meet its
    points one by one."""
    index = np.arange(count)
    radius, angle = np.sqrt((index + 0.5) / count), np.pi * (3 - np.sqrt(5)) * index + 0.56
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def zone(path_m: np.ndarray, wavelength_m: float, pieces: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (part, piece + 1, ..., 3) [m] that cut each straight part of paths (stop, ..., 3) into pieces, the fraction of the
    path before each, and the zone's radius there [m]: sqrt(lambda d1 d2 / (d1 + d2)), both (part, piece + 1, ...).
    """
    parts = np.diff(path_m, axis=0)[:, None]
    cuts = np.sin(np.linspace(0, np.pi / 2, pieces + 1)) ** 2  # closer where the zone opens and closes
    cuts = cuts.astype(path_m.dtype).reshape(-1, *[1] * (path_m.ndim - 1))
    lengths = np.linalg.norm(parts, axis=-1)
    done = np.cumsum(lengths, axis=0)
    total = np.maximum(done[-1:], 1e-12)
    fraction = np.minimum((done - lengths + cuts[..., 0] * lengths) / total, 1)
    return path_m[:-1, None] + cuts * parts, fraction, np.sqrt(wavelength_m * total * fraction * (1 - fraction))


def bundle(path_m: np.ndarray, wavelength_m: float, places: np.ndarray, pieces: int) -> np.ndarray:
    """Positions [m] of rays that fill the first Fresnel zone along paths (stop, ..., 3) [m], (part, piece + 1, ..., rays, 3).

    A ray keeps its place on the zone's cross-section, one of (rays, 2) of the unit disc, at mirrors too.
    """
    parts = np.diff(path_m, axis=0)
    ahead = parts / np.maximum(np.linalg.norm(parts, axis=-1, keepdims=True), 1e-12)
    sides = [_across(ahead[0])]
    for before, after in pairwise(ahead):
        normal = (after - before)[..., None, :]
        size = np.sum(normal**2, axis=-1, keepdims=True)
        factor = np.where(size > STRAIGHT, 2 / np.maximum(size, STRAIGHT), 0)
        sides.append(sides[-1] - factor * np.sum(sides[-1] * normal, axis=-1, keepdims=True) * normal)
    middle, _, radius = zone(path_m, wavelength_m, pieces)
    return middle[..., None, :] + radius[..., None, None] * (places @ np.stack(sides))[:, None]


def _across(ahead: np.ndarray) -> np.ndarray:
    """Two unit vectors (..., 2, 3) across directions (..., 3), the first of them level."""
    steep = np.abs(ahead[..., 2:]) > 0.99
    level = np.cross(ahead, np.where(steep, *np.eye(3, dtype=ahead.dtype)[[0, 2]]))
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    return np.stack([level, np.cross(level, ahead)], axis=-2)


RIM = 0.9
"""Fraction of the zone's radius that the rays fill; with this one they meet the lit side of a knife edge best."""
FEW = RIM * np.array([(0.0, 0.0), (0.9, 0.37), (-0.37, 0.9), (-0.9, -0.37), (0.37, -0.9)], np.float32)
"""Rays that are traced first: upright and level edges, which most are, pass between no two of them that are far apart."""
MANY = (RIM * disc(20)).astype(np.float32)
"""Rays that are traced where the few disagree."""
PIECES = 4
"""Least number of chords that approximate a path's curved rays; all straight parts have equally many."""
CELL_M = 0.15
"""Size of cells [m] whose points are tested together for being free."""
POINTS_AT_ONCE = 4096
NO_LENGTH_M = 1e-6
"""Length [m] to which paths in float32 are right."""
STOPPED, LEFT_OUT = 1, 2
"""What may happen to a ray; 0 is nothing."""
DIRECTIONS = (
    np.array(sorted((d for d in np.ndindex(3, 3, 3) if d > (1, 1, 1)), key=methodcaller("count", 1), reverse=True))
    - 1.0
)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
"""What lies apart along one of these 13, the axes and the diagonals of a cube, does not touch (Klosowski et al. 1998)."""
AXES = 3
"""Number of axes, which are the first of these directions."""


@dataclass(frozen=True, slots=True)
class Edges:
    """Edges of all mirrors of a scene."""

    mirrors: Mirrors
    wavelength_m: float
    normals: np.ndarray
    """Unit normals of the mirrors, (M, 3)."""
    offsets_m: np.ndarray
    """Offsets of their planes [m], (M,)."""
    spans_m: np.ndarray
    """Least and greatest coordinates [m] of each along `DIRECTIONS`, (2, M, D)."""
    outlines_m: list[np.ndarray]
    """Edges of each and of its covers that no two triangles share [m], (E, 2, 3)."""

    @classmethod
    def of(cls, mirrors: Mirrors, wavelength_m: float) -> Edges:
        """The edges of these mirrors."""
        along = [mirror.triangles.reshape(-1, 3) @ DIRECTIONS.T for mirror in mirrors.parts]
        return cls(
            mirrors,
            wavelength_m,
            np.array([mirror.normal for mirror in mirrors.parts]),
            np.array([mirror.offset_m for mirror in mirrors.parts]),
            np.array([[heights.min(axis=0) for heights in along], [heights.max(axis=0) for heights in along]]),
            [
                np.concatenate([_outline(part.triangles) for part in (mirror, *mirror.covers)])
                for mirror in mirrors.parts
            ],
        )

    def fraction(self, path: OneWayPath, points: np.ndarray, times_s: np.ndarray | None = None) -> np.ndarray:
        """Fraction of the path's field that reaches points (..., 3) [m], float32 (...)."""
        return self.fractions([path], points, times_s)[0]

    def fractions(
        self, paths: Sequence[OneWayPath], points: np.ndarray, times_s: np.ndarray | None = None
    ) -> np.ndarray:
        """Fraction of the fields of P paths that reaches points (..., 3) [m], float32 (P, ...); for a radar that moves, points
        (K, ..., 3) at times (K,) [s], of which those of one time are worked on together."""
        if paths and paths[0].passing is not None:
            points = points_in_scene(paths[0].passing, points, times_s)
            assert times_s is not None
            fractions = np.empty((len(paths), *points.shape[:-1]), np.float32)
            for instant in np.unique(times_s):
                now = times_s == instant
                fractions[:, now] = self.fractions([path.in_scene(instant[None]) for path in paths], points[now])
            return fractions
        flat = points.reshape(-1, 3)
        corner, cell = np.unique(_codes(flat), return_inverse=True)
        centres = (_places(corner) + 0.5) * CELL_M
        fractions = np.empty((len(paths), len(flat)), np.float32)
        lengths, groups = np.array([len(path.chain) for path in paths]), []
        for length in np.unique(lengths):
            rows = np.flatnonzero(lengths == length)
            groups += list(blocks(rows, 2 * len(centres) * (length + 1) * len(self.normals)))

        def find(number: int) -> None:
            group = groups[number]
            fractions[group] = self._together([paths[row] for row in group.tolist()], flat, centres, cell)

        in_threads(find, range(len(groups)))
        return fractions.reshape(-1, *points.shape[:-1])

    def _together(
        self, paths: Sequence[OneWayPath], points: np.ndarray, centres: np.ndarray, cell: np.ndarray
    ) -> np.ndarray:
        """Fractions (P, Q) of paths of equally many elements at points (Q, 3) in cells (Q,) with centres (C, 3) [m]."""
        of_cells = _Courses.of(paths, [centres] * len(paths))
        cell_fractions, near, rims = self._cells(of_cells)
        fraction = cell_fractions.reshape(len(paths), -1)[:, cell]
        path, point = np.nonzero(np.isnan(fraction))
        for first in range(0, len(path), POINTS_AT_ONCE):
            of, numbers = (indices[first : first + POINTS_AT_ONCE] for indices in (path, point))
            place = of * len(centres) + cell[numbers]
            courses = _Courses.of(paths, [points[numbers[of == number]] for number in range(len(paths))])
            fraction[of, numbers] = self._points(courses, near[:, place], rims[:, place])
        return fraction

    def _points(self, courses: _Courses, near: np.ndarray, rims: np.ndarray) -> np.ndarray:
        """Fractions (N,) of courses; `near` (S, N) are pieces near something, `rims` (m, N) mirrors that are met near their rim."""
        asked = courses.valid
        fraction = np.zeros(len(asked), np.float32)
        for places in (FEW, MANY):
            if asked.any():
                # In float32: a wavelength is 4 mm.
                stops = self.mirrors.local(courses.stops_m[:, asked]).astype(np.float32)
                fraction[asked] = self._free_rays(
                    stops, near[:, asked], rims[:, asked], places, courses.chain[:, asked]
                )
            asked = (fraction > 0) & (fraction < 1)
        return fraction

    def _free_rays(
        self, stops: np.ndarray, near: np.ndarray, rims: np.ndarray, places: np.ndarray, chain: np.ndarray
    ) -> np.ndarray:
        """The free fraction of the rays around courses (stop, N, 3), `local` to the mirrors, over a chain (m, N): (N,).

        A plane that both ends of a straight part stand before cuts no path from one to the other, and what it reflects has an image
        of its own: rays bent into it are left out.
        """
        pieces = _pieces(len(chain))
        offsets_m = self.offsets_m
        if self.mirrors.origin_m is not None:
            offsets_m = offsets_m - self.normals @ self.mirrors.origin_m
        rays = bundle(stops, self.wavelength_m, places, pieces)
        for k, number in enumerate(chain):  # from the cross-section on to the mirror's plane
            ahead, normal = stops[k + 1] - stops[k], self.normals[number].astype(np.float32)
            towards = np.einsum("ni,ni->n", ahead, normal)
            # Where two mirrors meet the path between them has no length, and so no direction: its rays stay where they are.
            towards = np.where(np.abs(towards) > NO_LENGTH_M, towards, np.float32(np.inf))
            height = np.einsum("nri,ni->nr", rays[k, -1] - stops[k + 1, :, None], normal) / towards[:, None]
            rays[k, -1] = rays[k + 1, 0] = rays[k, -1] - height[..., None] * ahead[:, None]
        fate = np.zeros((len(near), *rays.shape[2:4]), np.int8)
        piece, point = np.nonzero(near)
        if len(piece):
            starts, ends = (points.reshape(-1, *rays.shape[2:])[piece, point] for points in (rays[:, :-1], rays[:, 1:]))
            hit, met = self._first(starts, ends, piece % pieces == 0, piece % pieces == pieces - 1)
            row, ray = np.nonzero(hit)
            piece, point, met = piece[row], point[row], met[row, ray]
            before, after = (
                np.einsum("hi,hi->h", self.normals[met], stops[piece // pieces + k, point]) - offsets_m[met]
                for k in (0, 1)
            )
            parted = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > SKIN_M)
            fate[piece, point, ray] = np.where(parted, STOPPED, LEFT_OUT)
        for k, number in enumerate(chain):
            after_it = fate[pieces * (k + 1)]
            for mirror, columns in _by_mirror(number, rims[k]):
                held = self.mirrors.parts[mirror].holds(self.mirrors.world(rays[k, -1, columns]))
                after_it[columns] = np.where(held, after_it[columns], STOPPED)
        # What happens to a ray first counts.
        first = np.take_along_axis(fate, np.argmax(fate > 0, axis=0)[None], axis=0)[0]
        return np.asarray((first == 0).sum(axis=1) / np.maximum((first != LEFT_OUT).sum(axis=1), 1))

    def _first(
        self, starts: np.ndarray, ends: np.ndarray, begins: np.ndarray, stops: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Which pieces of rays (Q, rays, 3) meet something, and the number of the mirror that they meet first, (Q, rays).

        Pieces overlap, but touch nothing at the beginning and at the end of a straight part.
        """
        ahead = ends - starts
        length = np.sqrt(np.einsum("qri,qri->qr", ahead, ahead))
        ahead /= np.maximum(length, 1e-12)[..., None]
        skin, other = (np.where(at_end, SKIN_M, -SKIN_M).astype(np.float32)[:, None] for at_end in (begins, stops))
        distance, mirror = self.mirrors.first_of_local(starts + skin[..., None] * ahead, ahead, length - skin - other)
        return np.isfinite(distance), mirror

    def _cells(self, courses: _Courses) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of courses to cells' centres: the fraction in all of the cell where no ray is needed to know it, else NaN, float32 (N,);
        which pieces of paths to it may meet something, bool (S, N); which mirrors of the chain may be met outside, bool (m, N)."""
        valid, stops, chain = courses.valid, courses.stops_m, courses.chain
        middle, fraction, radius = zone(stops, self.wavelength_m, _pieces(len(chain)))
        # Points of the cell lie in a ball around its centre. Seen from the antenna's image, paths to them lie within a cone, whose
        # radius grows with the fraction of the path that is done; the rays of each fill the zone's radius beyond that.
        wide = fraction * (CELL_M * np.sqrt(3) / 2)
        dark, rims = np.zeros(len(valid), bool), np.zeros(chain.shape, bool)
        for k, number in enumerate(chain):
            ahead = stops[k + 1] - stops[k]
            # On a plane that is met at a slant, a cone's cross-section is as much longer.
            towards = np.abs(np.einsum("ni,ni->n", ahead, self.normals[number]))
            aslant = np.linalg.norm(ahead, axis=1) / np.maximum(towards, 1e-9)
            for at in ((k, -1), (k + 1, 0)):
                wide[at] *= aslant
                radius[at] *= aslant
            within = wide[k, -1] + radius[k, -1]
            for mirror, columns in _by_mirror(number):
                met_m = stops[k + 1, columns]
                rims[k, columns] = _distance(met_m, self.outlines_m[mirror]) < within[columns]
                dark[columns] |= ~self.mirrors.parts[mirror].holds(met_m) & ~rims[k, columns]
        live = np.flatnonzero(~dark)
        parting = self._parting(stops[:, live], wide[:, -1, live], chain[:, live])
        # Near a rim any plane may have rays left out, but for the mirror itself.
        asked = parting | np.asarray(rims[:, live].any(axis=0))[:, None]
        cells = np.arange(len(live))
        for k, number in enumerate(chain[:, live]):
            asked[k : k + 2, cells, number] &= parting[k : k + 2, cells, number]
        near = np.zeros((len(middle) * (middle.shape[1] - 1), len(valid)), bool)
        near[:, live] = self._touched(middle[:, :, live], (wide + radius)[:, :, live], asked).reshape(len(near), -1)
        near[:, ~valid], rims[:, ~valid] = True, True
        fractions = np.where(rims.any(axis=0) | near.any(axis=0), np.nan, 1)
        return np.where(dark & valid, 0, fractions).astype(np.float32), near, rims

    def _parting(self, stops: np.ndarray, wide: np.ndarray, chain: np.ndarray) -> np.ndarray:
        """Which mirrors' planes may stand between the ends of straight parts of courses to cells over a chain (m, N), bool
        (part, N, M).

        Stops (stop, N, 3) are off by up to `wide` (part, N) at their ends, though not off the mirrors, and by half a cell at last.
        """
        height = stops @ self.normals.T - self.offsets_m
        slack = np.zeros(height.shape)
        aslant = np.linalg.norm(np.cross(self.normals[:, None], self.normals), axis=2)
        for k, number in enumerate(chain):
            slack[k + 1] = wide[k, :, None] * aslant[number]
        slack[-1] = CELL_M / 2 * np.abs(self.normals).sum(axis=1)
        low, high = height - slack, height + slack
        least, most = np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])
        return np.asarray((least < -OUTLINE_M) & (most > OUTLINE_M))

    def _touched(self, places: np.ndarray, reach: np.ndarray, asked: np.ndarray) -> np.ndarray:
        """Which pieces between places (part, piece + 1, C, 3) [m], that `reach` as far (part, piece + 1, C) [m], may touch any of
        the mirrors `asked` for, bool (part, C, M): bool (part, piece, C)."""
        touching = np.repeat(asked[:, None], places.shape[1] - 1, axis=1)
        spans = zip(DIRECTIONS, *self.spans_m.transpose(0, 2, 1), strict=True)
        for number, (direction, least, most) in enumerate(spans):
            along = places @ direction
            low, high = along - reach, along + reach
            low, high = np.minimum(low[:, :-1], low[:, 1:]), np.maximum(high[:, :-1], high[:, 1:])
            if number < AXES:
                touching &= (most >= low[..., None]) & (least <= high[..., None])
                continue
            if number == AXES:  # the axes leave few for the diagonals
                *where, mirror = np.nonzero(touching)
            overlapping = (most[mirror] >= low[tuple(where)]) & (least[mirror] <= high[tuple(where)])
            where, mirror = [indices[overlapping] for indices in where], mirror[overlapping]
        touched = np.zeros(touching.shape[:3], bool)
        touched[tuple(where)] = True
        return touched


@dataclass(frozen=True, slots=True)
class SceneBlockage:
    """How a scene blocks one-way paths."""

    edges: Mapping[bytes, Edges]
    """Edges by the place of the antenna, as `OneWayPath.antenna_m.tobytes()`; none in free space."""

    def fraction(self, path: OneWayPath, points: np.ndarray, times_s: np.ndarray | None = None) -> np.ndarray:
        """Fraction of a path's field that reaches points (..., 3) [m], faded at edges of mirrors and obstacles, float32 (...); for
        a radar that moves, points (K, ..., 3) at times (K,) [s]."""
        return self.fractions([path], points, times_s)[0]

    def fractions(
        self, paths: Sequence[OneWayPath], points: np.ndarray, times_s: np.ndarray | None = None
    ) -> np.ndarray:
        """Fractions of the fields of P paths that reach points as in `fraction`, float32 (P, ...)."""
        fractions = np.empty((len(paths), *points.shape[:-1]), np.float32)
        antennas = [path.antenna_m.tobytes() for path in paths]
        for place in set(antennas):
            rows = [row for row, antenna in enumerate(antennas) if antenna == place]
            fractions[rows] = self.edges[place].fractions([paths[row] for row in rows], points, times_s)
        return fractions


class _Courses(NamedTuple):
    """Where N paths of m elements each run."""

    valid: np.ndarray
    """Whether every plane is met between its neighbours, bool (N,)."""
    stops_m: np.ndarray
    """Antenna, intersections with the planes, target [m], (m + 2, N, 3)."""
    chain: np.ndarray
    """Numbers of the mirrors, (m, N)."""

    @classmethod
    def of(cls, paths: Sequence[OneWayPath], points: Sequence[np.ndarray]) -> _Courses:
        """The courses of each path to its own points (n, 3) [m], path by path."""
        unfolded = [unfolded_vertices(path, of_path) for path, of_path in zip(paths, points, strict=True)]
        valid, stops = zip(*unfolded, strict=True)
        chain = [
            np.repeat(path.elements.mirror[:, None], len(of_path), axis=1)
            for path, of_path in zip(paths, points, strict=True)
        ]
        return cls(
            np.concatenate(valid),
            np.concatenate([np.stack(stop) for stop in stops], axis=1),
            np.concatenate(chain, axis=1),
        )


def _by_mirror(numbers: np.ndarray, counts: np.ndarray | None = None) -> Iterator[tuple[int, np.ndarray]]:
    """Yields the mirrors among numbers (N,), and where each of them stands; only where it `counts`, bool (N,), if given."""
    places = np.arange(len(numbers)) if counts is None else np.flatnonzero(counts)
    for number in np.unique(numbers[places]).tolist():
        yield number, places[numbers[places] == number]


def _codes(points: np.ndarray) -> np.ndarray:
    """The cells of points (P, 3) [m] as one number each, (P,)."""
    x, y, z = np.floor(points / CELL_M).astype(np.int64).T + (1 << 20)
    return np.asarray((x << 42) | (y << 21) | z)


def _places(codes: np.ndarray) -> np.ndarray:
    """Positions (C, 3) of cells with these codes (C,), in units of `CELL_M`."""
    return np.stack([codes >> 42, (codes >> 21) & ((1 << 21) - 1), codes & ((1 << 21) - 1)], axis=1) - (1 << 20)


def _pieces(length: int) -> int:
    return -(-PIECES // (length + 1))


def _outline(triangles: np.ndarray) -> np.ndarray:
    """Edges (E, 2, 3) of triangles (F, 3, 3) that belong to one of them alone."""
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    same = np.round(np.concatenate([edges.sum(axis=1), np.abs(edges[:, 1] - edges[:, 0])], axis=1), 6)
    _, first, count = np.unique(same, axis=0, return_index=True, return_counts=True)
    return np.asarray(edges[first[count == 1]])


def _distance(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Distances [m] of points (P, 3) to the nearest of edges (E, 2, 3), (P,)."""
    start, path = edges[:, 0], edges[:, 1] - edges[:, 0]
    offset = points[:, None] - start
    along = np.clip(np.einsum("pei,ei->pe", offset, path) / np.maximum(np.einsum("ei,ei->e", path, path), 1e-30), 0, 1)
    return np.asarray(np.linalg.norm(offset - along[..., None] * path, axis=2).min(axis=1, initial=np.inf))
