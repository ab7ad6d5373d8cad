"""Shadows that targets cast on one another: beside the outline of one the field is a wave from there (docs/physics.md, eq. 27).

Meshes at a chunk of instants are worked on together. Rays in one scene, in which each mesh stands alone, tell which edges are
outline and which mesh hides a point.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend, one_thread_at_a_time
from t2d_rt.geometry.vectors import cross, dot, inner, norms, unit, vector_product
from t2d_rt.propagation.images import images, instants_of
from t2d_rt.propagation.occluders import PosedOccluders
from t2d_rt.propagation.rays import LIFT_M, columns, mitsuba, mitsuba_mesh, traceable
from t2d_rt.types import OneWayPath

FULL_V, NO_WAVE_V = 2.2, 3.4
"""Clearances of an outline, as Fresnel's parameter, up to which its wave counts in full and from which it does not count."""
PIECE_V, SHORTEST_PIECE_M = 0.7, 3e-3
"""Length of an outline's pieces, as Fresnel's parameter, and length [m] below which they are not cut."""
LONGEST_EDGE_RAD = 0.5
"""Angle [rad] to about which edges are cut before they are chosen, so that a place and a direction stand for the whole of each."""
BESIDE_M = 5e-4
"""An edge is outline where nothing of its mesh lies at this distance [m] beside it."""
APART = 10.0
"""Shift of the directions of one instant from those of the instant before, where both are searched at once."""
BOX_MARGIN_M = 0.01
"""Distance [m] outside of the box around a mesh at which rays begin and end."""
LEAST_DEPTH_M = 0.05
"""Least distance [m] from the origin that counts where the length to which an edge is cut follows from its angle."""
END_ON_RAD = 1e-3
"""Edges that are seen from their end to within this angle [rad] are a point of the outline."""
TILT_RAD = 1e-6 * np.array([0.51, 0.67, 0.54])
"""Rays are rotated by this angle [rad], some ten steps of single precision, so that none meets an outline where two of its pieces
join (except along this direction, which stays)."""
TILTED_M = 100.0
"""Length [m] up to which rays are rotated by that angle. The ends of longer ones are shifted as far as at this length, because the
zone does not widen with the distance; directions relative to their mean are finer there."""
NARROW_ZONE_M = 0.02
"""Radius [m] of the first zone, projected to the points, up to which edges are hard; from twice of it their waves count in full.
Close behind an edge, as that of a thing carried, they ripple more finely than the points lie at which visibility is asked."""
LEAST_ANGLE_RAD = 1e-9
"""Angle [rad] below which a piece is a point, and change of phase over half of a piece [rad] below which the phase is constant."""
AT_EDGE_V = 0.15
"""Clearance, as Fresnel's parameter, below which the pieces of an outline, and no ray, tell on which side of it a point is."""


Segments = tuple[np.ndarray, np.ndarray]
"""Where straight lines begin and end [m], (N, 3) each."""


class Straight(NamedTuple):
    """A straight part of a path, unfolded: as if it went on from the image of the antenna to that of the target."""

    origin_m: np.ndarray
    """The antenna, or its image, that the part comes from [m], (3,)."""
    matrix: np.ndarray
    shift_m: np.ndarray
    """A target at x appears at `matrix @ x + shift_m`."""
    begin: tuple[np.ndarray, float] | None
    end: tuple[np.ndarray, float] | None
    """Planes (unit normal, offset [m]) between which it runs; None where the antenna or the target is."""

    def appear(self, points: np.ndarray) -> np.ndarray:
        """Apparent positions [m] of points (..., 3) [m]."""
        return points @ self.matrix.T + self.shift_m

    def between(self, points: np.ndarray) -> np.ndarray:
        """Fractions (2, N) of the way to apparent points (N, 3) [m] from which and to which the part runs."""
        span = np.zeros((2, len(points)))
        span[1] = 1
        for row, plane in zip(span, (self.begin, self.end), strict=True):
            if plane is not None:
                height, towards = plane[1] - plane[0] @ self.origin_m, (points - self.origin_m) @ plane[0]
                row[:] = np.clip(height / np.where(towards == 0, np.inf, towards), 0, 1)
        return span

    def segments(self, stops: np.ndarray) -> Segments:
        """Where the part begins and where it ends on the way to apparent points (N, 3) [m], (N, 3) each."""
        first, last = self.between(stops)[..., None]
        towards = stops - self.origin_m
        return self.origin_m + first * towards, self.origin_m + last * towards


def straight_parts(path: OneWayPath) -> list[Straight]:
    """The straight parts of a path, from the target on."""
    places, planes = images(path), path.planes
    matrix, shift = np.eye(3), np.zeros(3)
    parts = []
    for k in range(len(planes), -1, -1):
        if k < len(planes) and not path.elements.through[k]:
            normal, offset_m = planes[k]
            reflection = np.eye(3) - 2 * np.outer(normal, normal)
            matrix, shift = reflection @ matrix, reflection @ shift + 2 * offset_m * normal
        begin, end = (planes[at] if 0 <= at < len(planes) else None for at in (k - 1, k))
        parts.append(Straight(places[k], matrix, shift, begin, end))
    return parts


class _Beam(NamedTuple):
    """Points of one mesh, and edges of another around them, on one straight part."""

    part: Straight
    mesh: int
    """Number of the other mesh."""
    apparent_m: np.ndarray
    """Apparent positions of the points [m], (N, 3)."""
    when: np.ndarray
    """Instant of each piece of an edge that may be outline, (M,)."""
    ends_m: np.ndarray
    """Ends of these pieces [m], around the mesh as it is seen from the origin, (2, M, 3)."""

    def beside_edges(self, boxes: np.ndarray) -> Segments:
        """Segments just outside of each piece, past the boxes around the mesh, whose corners are (K, 8, 3) [m]."""
        middle = self.ends_m.mean(axis=0) - self.part.origin_m
        aside = unit(vector_product(middle, self.ends_m[1] - self.ends_m[0]))
        far_m = norms(boxes - self.part.origin_m).max(axis=1)[self.when, None]
        return self.part.segments(self.part.origin_m + far_m * unit(middle + BESIDE_M * aside))

    def facing(self, instant: np.ndarray, shown: np.ndarray, outline: np.ndarray, wavelength_m: float) -> _Facing:
        """The points that are `shown`, bool (N,), at their `instant` (N,), and the pieces that are `outline`, bool (M,)."""
        ends_m, ahead = self.ends_m[:, outline] - self.part.origin_m, self.apparent_m[shown] - self.part.origin_m
        distance_m, length_m = norms(ends_m.mean(axis=0)), norms(ahead)
        directions, tilt = unit(ends_m), TILT_RAD * np.minimum(TILTED_M / length_m, 1)[:, None]
        ahead, middle = unit(ahead / length_m[:, None] + tilt), directions.mean(axis=0)
        least_m, farthest_m = NO_WAVE_V**2 * wavelength_m / 4, length_m.max(initial=0.0)
        reach = (least_m + 2 * (farthest_m - distance_m)) * least_m / (distance_m * max(farthest_m, least_m))
        span_m = self.part.between(self.apparent_m[shown]) * length_m
        centre = ahead.sum(axis=0) / max(len(ahead), 1)
        points = np.column_stack([ahead - centre, ahead, length_m, span_m[0], np.minimum(span_m[1], length_m)])
        a, b = directions - centre
        pieces = np.column_stack([a, reach, b, distance_m])
        # Along the axis in which points extend most, those that count lie side by side.
        axis = ((ahead - centre) ** 2).sum(axis=0).argmax()
        place, piece_place = (
            APART * when + row[:, axis] for when, row in ((instant[shown], ahead), (self.when[outline], middle))
        )
        order, width = np.argsort(piece_place), np.sqrt(min(reach.max(initial=0.0), 4.0)) * (1 + 1e-6)
        ends = [np.searchsorted(piece_place[order], place + side) for side in (-width, width)]
        return _Facing(points, np.stack(ends, axis=1), pieces[order])


class _Facing(NamedTuple):
    """Points and the pieces of an outline that may count at each, as they are seen from the origin of a straight part: their
    directions relative to their mean, so that single precision tells them apart."""

    points: np.ndarray
    """Relative direction, direction, distance [m], and distances [m] from which and to which the part runs, (N, 9)."""
    ranges: np.ndarray
    """Index of the first of the pieces that may count at each point, and the one behind the last, (N, 2)."""
    pieces: np.ndarray
    """Relative direction of each piece's beginning, square of the chord up to which it may count, relative direction of its end,
    distance [m], (M, 8). Pieces that join have one direction there, to the last bit, so that what they turn about a ray adds up."""


@one_thread_at_a_time
def _amplitudes(facing: list[_Facing], hidden: np.ndarray, wavelength_m: float, backend: Backend) -> np.ndarray:
    """Amplitudes (N,) of the field at all of these points, `hidden` or not, bool (N,), beside their outlines (eq. 27)."""
    if not (len(hidden) and any(len(beam.pieces) for beam in facing)):
        return 1.0 - hidden
    import drjit as dr

    Float32, Packet = backend.Float32, backend.arrays.Array4f
    before = np.cumsum([0, *(len(beam.pieces) for beam in facing)])
    ranges = np.concatenate([beam.ranges + first for beam, first in zip(facing, before, strict=False)])
    points = np.concatenate([beam.points for beam in facing])
    columns = [backend.lanes(column, Float32) for column in points.T]
    relative, ahead, (length, first, last) = columns[:3], columns[3:6], columns[6:]
    pieces = backend.lanes(np.concatenate([beam.pieces for beam in facing]), Float32)
    begin, end = (backend.lanes(column) for column in ranges.T)
    wavelength = dr.opaque(Float32, wavelength_m)

    def fading(u: Any) -> Any:
        return smooth_step(dr.clip(u, 0, 1))

    def with_piece(a: list[Any], b: list[Any], w: list[Any], distance: Any, sums: list[Any]) -> list[Any]:
        counts = (distance > first) & (distance < last)
        # Directions lie so close that chords are angles: about the ray to a point a piece runs from a to b, its middle is w and s
        # its extent.
        s = [two - one for one, two in zip(a, b, strict=True)]
        w_squared, across = dot(w, w), dot(ahead, cross(b, a))
        angle = dr.atan2(across, dot(a, b))
        # The mean of w squared over the angle that a piece turns about the ray, and the phase, which is about linear there.
        w_squared = dr.select(dr.abs(angle) > LEAST_ANGLE_RAD, across / angle, w_squared)
        left, scaled = length - distance, length * distance
        v_squared = 4 / wavelength * scaled * w_squared / (dr.sqrt(left * left + scaled * w_squared) + left)
        slope = np.pi * dot(w, s) * scaled / (wavelength * dr.maximum(left, SHORTEST_PIECE_M))
        zone_m = dr.sqrt(wavelength * dr.maximum(left, 0) * length / distance)  # as it is wide where the points are
        fade = fading((NO_WAVE_V - dr.sqrt(v_squared)) / (NO_WAVE_V - FULL_V)) * fading(zone_m / NARROW_ZONE_M - 1)
        wave = angle * fade * dr.select(dr.abs(slope) > LEAST_ANGLE_RAD, dr.sin(slope) / slope, 1) / (2 * np.pi)
        sine, cosine = dr.sincos(np.pi / 2 * v_squared)
        at_edge = dr.select(v_squared < AT_EDGE_V**2, Float32(1), 0)
        terms = at_edge, dr.select(v_squared < 1, angle, 0), wave * cosine, wave * sine
        return [total + dr.select(counts, term, 0) for total, term in zip(sums, terms, strict=True)]

    def add(piece: Any, sums: list[Any]) -> tuple[Any, list[Any]]:
        *a, reach = dr.gather(Packet, pieces, 2 * piece)
        *b, distance = dr.gather(Packet, pieces, 2 * piece + 1)
        a, b = ([one - other for one, other in zip(ends, relative, strict=True)] for ends in (a, b))
        w = [(one + other) / 2 for one, other in zip(a, b, strict=True)]
        # This is a branch, which lanes skip together where the piece is near none of their points.
        near = dot(w, w) < reach
        return piece + 1, dr.if_stmt((a, b, w, distance, sums), near, with_piece, lambda *far: far[-1], mode="symbolic")

    _, sums = dr.while_loop(
        state=(begin, [dr.zeros(Float32, len(hidden)) for _ in range(4)]),
        cond=lambda piece, sums: piece < end,
        body=add,
        labels=("piece", "sums"),
        mode="symbolic",
    )
    dr.eval(sums)
    at_edge, side, in_phase, across = (np.asarray(total) for total in sums)
    # Where the outline runs through a point a ray may miss what the pieces turn about, or meet what they do not.
    hidden = np.where(at_edge > 0, side > 0, hidden)
    return np.asarray(np.hypot(1 - hidden + in_phase, across))


def smooth_step(u: Any) -> Any:
    """A step from 0 at u = 0 to 1 at u = 1, with no kink at either."""
    return u * u * (3 - 2 * u)


class Points(NamedTuple):
    """Points on meshes at some instants, seen along a path."""

    places_m: np.ndarray
    """Places of the points [m], (K, Q, 3)."""
    normals: np.ndarray
    """Unit normals of the surface there, (K, Q, 3)."""
    owner: np.ndarray
    """Numbers of the meshes that they belong to, (Q,)."""
    front: np.ndarray
    """Which of them face the path, bool (K, Q)."""
    visible: np.ndarray
    """Which of these no mesh hides in straight lines, bool (K, Q)."""


def beside_others(
    alone: MeshesAlone, seen_paths: Sequence[OneWayPath], of: Points, *, wavelength_m: float
) -> np.ndarray:
    """Fraction of the field over the path at points that face it, float32 (K, Q): the amplitude near the outline of a mesh that
    they do not belong to, and elsewhere whether they are visible. If none is near an outline, `of.visible` itself is returned."""
    instants = np.arange(len(of.visible))
    groups = [
        group
        for path, at_them in zip(seen_paths, instants_of(seen_paths), strict=True)
        for group in _groups(alone.at, path, instants[at_them], of, wavelength_m)
    ]
    return _summed(groups, alone, of.visible, wavelength_m) if groups else of.visible


def _groups(
    at: PosedOccluders, path: OneWayPath, instants: np.ndarray, of: Points, wavelength_m: float
) -> Iterator[_Group]:
    """Yields the points of each mesh that a path reaches at these instants (k,) near edges of other meshes."""
    parts = straight_parts(path)
    for mesh in np.unique(of.owner).tolist():
        near = [
            (part, other, close)
            for part in parts
            for other in range(len(at.meshes.meshes))
            if other != mesh
            and len(close := instants[_near(part, at.boxes[instants, mesh], at.boxes[instants, other], wavelength_m)])
        ]
        if not near:
            continue
        crowded, mine = np.unique(np.concatenate([close for *_, close in near])), np.flatnonzero(of.owner == mesh)
        row, column = np.nonzero(of.front[np.ix_(crowded, mine)])
        if not len(row):
            continue
        instant, numbers = crowded[row], mine[column]
        here_m = of.places_m[instant, numbers]
        here_m = here_m + LIFT_M * (of.normals[instant, numbers] + unit(images(path)[-1] - here_m))
        pieces = [
            _pieces(at, part, other, close, instant, part.appear(here_m), wavelength_m) for part, other, close in near
        ]
        beside = np.any([near_points for near_points, *_ in pieces], axis=0)
        if beside.any():
            here_m = here_m[beside]
            beams = [
                _Beam(part, other, part.appear(here_m), when, ends_m)
                for (part, other, _), (_, when, ends_m) in zip(near, pieces, strict=True)
            ]
            yield _Group(mesh, instant[beside], numbers[beside], here_m, parts, beams)


def _near(part: Straight, mine: np.ndarray, others: np.ndarray, wavelength_m: float) -> np.ndarray:
    """Whether boxes around another mesh come near the lines from the part's origin to those around a mesh, with corners
    (K, 8, 3) [m] each: bool (K,)."""
    corners_m = part.appear(mine) - part.origin_m, others - part.origin_m
    directions = [unit(corners) for corners in corners_m]
    centres = [unit(corners.mean(axis=1))[:, None] for corners in directions]
    cosines = [inner(*row).min(axis=1) for row in zip(directions, centres, strict=True)]
    nearest_m, farthest_m = inner(corners_m[1], centres[1]).min(axis=1), norms(corners_m[0]).max(axis=1)
    between = np.maximum(1 / np.maximum(nearest_m, SHORTEST_PIECE_M) - 1 / farthest_m, 0)
    reach = NO_WAVE_V * np.sqrt(wavelength_m / 2 * between)
    # Along the line between both centres. Directions inside of a box lie farther out than those of its corners, at most by the
    # cosine of the cone around these.
    axis = unit(centres[1] - centres[0])
    ends = [inner(directions[0], axis).max(axis=1), -inner(directions[1], axis).min(axis=1)]
    gap = -sum(np.maximum(end, end / np.maximum(cosine, 1e-9)) for end, cosine in zip(ends, cosines, strict=True))
    return np.asarray((reach > 0) & (gap < reach))


def _pieces(
    at: PosedOccluders,
    part: Straight,
    other: int,
    near_instants: np.ndarray,
    point_instant: np.ndarray,
    apparent_m: np.ndarray,
    wavelength_m: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which apparent points (N, 3) [m], each at its `point_instant` (N,), ascending, are near edges of the other mesh that may be
    its outline at `near_instants` (k,), bool (N,); and pieces of these: the instant of each (M,), and its ends (2, M, 3) [m]."""
    towards = apparent_m - part.origin_m
    length_m = norms(towards)
    towards /= length_m[:, None]
    sides, lengths_m = (_extents(values, point_instant, len(at.times_s)) for values in (towards, length_m))

    def distance(ends_m: np.ndarray) -> np.ndarray:
        return norms(ends_m.mean(axis=0) - part.origin_m)

    def close(ends_m: np.ndarray, when: np.ndarray) -> np.ndarray:
        """Angle from which each segment (2, M, 3) reaches a point, 0 where it reaches none."""
        distance_m, farthest_m = np.maximum(distance(ends_m), SHORTEST_PIECE_M), lengths_m[1, when]
        left_m = np.maximum(farthest_m - distance_m, 0)
        reach = NO_WAVE_V * np.sqrt(wavelength_m * left_m / (2 * distance_m * farthest_m))
        directions = unit(ends_m - part.origin_m)
        # The directions of what lies between two ends bulge beyond their chord.
        bulge = 1 - np.sqrt(1 - np.minimum(inner(*2 * [directions[1] - directions[0]]) / 4, 1))
        margin, (low, high) = (reach + bulge)[:, None], sides[:, when]
        beside = (np.minimum(*directions) - margin > high) | (np.maximum(*directions) + margin < low)
        return np.where(beside.any(axis=1), 0, reach)

    row, ends_m = at.folds(near_instants, other, part.origin_m)
    of, ends_m = _cut(ends_m, LONGEST_EDGE_RAD * np.maximum(distance(ends_m), LEAST_DEPTH_M))
    when = near_instants[row[of]]
    across = norms(np.diff(unit(ends_m - part.origin_m), axis=0)[0]) * norms(ends_m[0] - part.origin_m)
    chosen = (close(ends_m, when) > 0) & (across > END_ON_RAD * norms(ends_m[1] - ends_m[0]))
    ends_m, when = ends_m[:, chosen], when[chosen]
    distance_m, nearest_m = distance(ends_m), lengths_m[0, when]
    zone_m = np.sqrt(wavelength_m * distance_m * np.maximum(nearest_m - distance_m, 0) / (2 * nearest_m))
    of, ends_m = _cut(ends_m, np.maximum(PIECE_V * zone_m, SHORTEST_PIECE_M))
    when = when[of]
    reach = close(ends_m, when)
    ends_m, when, reach = ends_m[:, reach > 0], when[reach > 0], reach[reach > 0]
    directions = unit(ends_m - part.origin_m)
    margin = reach.max(initial=0.0) + norms(directions[1] - directions[0]).max(initial=0.0) / 2
    low, high = _extents(directions.mean(axis=0), when, len(at.times_s))[:, point_instant]
    return ((towards > low - margin) & (towards < high + margin)).all(axis=1), when, ends_m


def _extents(values: np.ndarray, instant: np.ndarray, count: int) -> np.ndarray:
    """Least and greatest of values (N, ...) at each of `count` instants, (2, count, ...), inf and -inf where there are none;
    `instant` (N,), ascending, is the index of the instant of each value."""
    extents = np.full((2, count, *values.shape[1:]), np.inf)
    extents[1] = -np.inf
    if len(values):
        starts = np.flatnonzero(np.diff(instant, prepend=-1))
        for extent, bound in zip(extents, (np.minimum, np.maximum), strict=True):
            extent[instant[starts]] = bound.reduceat(values, starts)
    return extents


def _cut(ends_m: np.ndarray, longest_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cuts segments (2, M, 3) into equal pieces no longer than (M,) [m]: the number of each piece's segment, and its ends."""
    count = np.ceil(norms(ends_m[1] - ends_m[0]) / longest_m).astype(int)
    if (count == 1).all():
        return np.arange(len(count)), ends_m
    of = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    steps = np.stack([step, step + 1])[..., None] / count[of][:, None]
    return of, ends_m[0, of] + steps * (ends_m[1] - ends_m[0])[of]


class _Group(NamedTuple):
    """Points of one mesh near edges of others, on one path."""

    mesh: int
    instant: np.ndarray
    """Instant of each point, (N,)."""
    numbers: np.ndarray
    """Number of each point among those of all meshes, (N,)."""
    here_m: np.ndarray
    """Where rays from the points start [m], (N, 3)."""
    parts: list[Straight]
    beams: list[_Beam]


def _summed(groups: list[_Group], alone: MeshesAlone, visible: np.ndarray, wavelength_m: float) -> np.ndarray:
    """The fractions of `beside_others`, float32 (K, Q), given the points near edges."""
    asked: list[tuple[Segments, np.ndarray, int]] = []
    for group in groups:
        dark = ~visible[group.instant, group.numbers]
        instant = group.instant[dark]
        asked += [(part.segments(part.appear(group.here_m[dark])), instant, group.mesh) for part in group.parts]
        for beam in group.beams:
            asked.append((beam.part.segments(beam.apparent_m[dark]), instant, beam.mesh))
            asked.append((beam.beside_edges(alone.at.boxes[:, beam.mesh]), beam.when, beam.mesh))
    free = iter(alone.leave_free(asked))
    fractions = visible.astype(np.float32)
    facing: list[_Facing] = []
    hidden: list[np.ndarray] = []
    for group in groups:
        dark = ~visible[group.instant, group.numbers]
        shown = ~dark  # not hidden by their own mesh
        shown[dark] = np.all([next(free) for _ in group.parts], axis=0)
        fractions[group.instant, group.numbers] = shown
        for beam in group.beams:
            behind = dark.copy()
            behind[dark] = ~next(free)
            hidden.append(behind[shown])
            facing.append(beam.facing(group.instant, shown, next(free), wavelength_m))
    amplitudes = _amplitudes(facing, np.concatenate(hidden), wavelength_m, alone.backend)
    of_beam = iter(np.split(amplitudes, np.cumsum([len(points) for points in hidden])[:-1]))
    for group in groups:
        shown = fractions[group.instant, group.numbers] > 0
        lit = group.instant[shown], group.numbers[shown]
        fractions[lit] = np.prod([next(of_beam) for _ in group.beams], axis=0)
    return fractions


@dataclass(frozen=True)
class MeshesAlone:
    """Meshes at some instants as rays meet them, each alone in a cell of one scene, which is made when it is first asked for."""

    at: PosedOccluders
    backend: Backend

    @cached_property
    def _scene_and_shift(self) -> tuple[Any, np.ndarray]:
        """The scene, and how far each mesh at each instant is shifted to its cell [m], (K, M, 3)."""
        at, boxes = self.at, self.at.boxes
        instants, meshes = boxes.shape[:2]
        across = int(np.ceil((instants * meshes) ** (1 / 3)))
        cells = np.stack(np.unravel_index(np.arange(instants * meshes), 3 * (across,)), axis=1) - (across - 1) / 2
        cell_m = float(np.ptp(boxes, axis=2).max()) + 4 * BOX_MARGIN_M
        shift_m = cell_m * cells.reshape(instants, meshes, 3) - boxes.mean(axis=2)
        vertices = at.vertices + np.repeat(shift_m, np.diff(at.meshes.starts), axis=1)
        faces = at.meshes.faces + vertices.shape[1] * np.arange(instants)[:, None, None]
        mi = mitsuba(self.backend)
        return traceable(mi, mitsuba_mesh(mi, vertices.reshape(-1, 3), faces)), shift_m

    @one_thread_at_a_time
    def leave_free(self, asked: list[tuple[Segments, np.ndarray, int]]) -> list[np.ndarray]:
        """Which segments, given with their instants (N,), the mesh of that number leaves free: bool (N,) for each of `asked`."""
        counts = [len(instant) for _, instant, _ in asked]
        if not sum(counts):  # Mitsuba aborts without a ray
            return [np.zeros(0, bool) for _ in asked]
        import drjit as dr

        mi, boxes = mitsuba(self.backend), self.at.boxes
        start, stop = (
            mi.Point3f(*columns(mi, np.concatenate([segments[end] for segments, *_ in asked]))) for end in (0, 1)
        )
        cells = np.concatenate([instant * boxes.shape[1] + mesh for _, instant, mesh in asked])
        scene, shift_m = self._scene_and_shift
        cell = self.backend.lanes(cells)
        shift, least, most = (
            dr.gather(mi.Point3f, mi.Point3f(*columns(mi, table)), cell)
            for table in (shift_m, boxes[:, :, 0] - BOX_MARGIN_M, boxes[:, :, -1] + BOX_MARGIN_M)
        )
        # Rays run within the box around the mesh only, or they would meet those in other cells.
        ahead = stop - start
        slanted = dr.select(dr.abs(ahead) > 1e-12, ahead, 1e-12)
        planes = (least - start) / slanted, (most - start) / slanted
        enter, leave = dr.maximum(dr.max(dr.minimum(*planes)), 0), dr.minimum(dr.min(dr.maximum(*planes)), 1)
        length = dr.norm(ahead)
        ray = mi.Ray3f(start + shift + enter * ahead, ahead / length)
        ray.maxt = (leave - enter) * length
        within = (enter < leave) & (length > 0)
        free = ~(scene.ray_test(ray, active=within) & within)
        return np.split(free.numpy(), np.cumsum(counts)[:-1])
