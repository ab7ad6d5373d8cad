"""Shadows that targets cast on one another: beside the outline of one the field is a wave from there (docs/physics.md, eq. 27).

Meshes at a chunk of instants are worked on together: which points lie near the outline of another mesh, what of its edges is
outline and which mesh hides what is asked of one ray tracer's scene, in which each mesh stands alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend, one_thread_at_a_time
from t2d_rt.geometry.vectors import inner, norms, unit, vector_product
from t2d_rt.propagation.images import images, instants_of
from t2d_rt.propagation.occluders import PosedOccluders
from t2d_rt.propagation.rays import LIFT_M, mitsuba, mitsuba_mesh, rays, traceable
from t2d_rt.types import OneWayPath

FULL_V, NO_WAVE_V = 2.2, 3.4
"""Clearances of an outline, as Fresnel's parameter, up to which its wave counts in full and from which it does not count."""
PIECE_V, SHORTEST_PIECE_M = 0.7, 3e-3
"""Length of an outline's pieces, as Fresnel's parameter, and what they are not cut below."""
LONGEST_EDGE_RAD = 0.5
"""Edges are cut to about that before they are chosen, so that a place and a direction stand for the whole of each."""
BESIDE_M = 5e-4
"""An edge is outline where nothing of its mesh lies so far beside it."""
CELL_GROWTH = 1.5
"""Cells of a scene are so much larger than they need be, for the segments from other viewpoints."""
LEAST_DEPTH_M = 0.05
"""Boxes nearer to an antenna's plane are not told apart by their corners."""
END_ON_RAD = 1e-3
"""Edges that are seen so nearly from their end, as an angle, are a point of the outline."""
TILT_RAD = 1e-7 * np.array([0.51, 0.67, 0.54])
"""Rays are rotated so far: none meets an outline where two of its pieces do."""
NARROW_ZONE_M = 0.02
"""Radius of the first zone, projected to the points, up to which edges are hard; from twice of it their waves count in full. Close
behind an edge, as that of a thing carried, they ripple more finely than the points lie at which visibility is asked."""
LEAST_ANGLE_RAD = 1e-9
"""Pieces that turn less are seen as points."""
AT_EDGE_V = 0.15
"""Clearance below which the pieces of an outline tell on which side of it a point is, and no ray."""


class Straight(NamedTuple):
    """A straight part of a path, unfolded: as if it went on from the image of the antenna to that of the target."""

    origin_m: np.ndarray
    """(3,)."""
    matrix: np.ndarray
    shift_m: np.ndarray
    """Takes x to where the target appears: `matrix @ x + shift_m`."""
    begin: tuple[np.ndarray, float] | None
    end: tuple[np.ndarray, float] | None
    """Planes between which it runs; None where the antenna or the target is."""

    def appear(self, points: np.ndarray) -> np.ndarray:
        """Where points (..., 3) m appear."""
        return points @ self.matrix.T + self.shift_m

    def between(self, points: np.ndarray) -> np.ndarray:
        """From and to which fraction of the way to apparent points (N, 3) m it runs, (2, N)."""
        span = np.zeros((2, len(points)))
        span[1] = 1
        for row, plane in zip(span, (self.begin, self.end), strict=True):
            if plane is not None:
                height, towards = plane[1] - plane[0] @ self.origin_m, (points - self.origin_m) @ plane[0]
                row[:] = np.clip(height / np.where(towards == 0, np.inf, towards), 0, 1)
        return span

    def segments(self, stops: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Its extent on the way to apparent points (N, 3): from where and to where, (N, 3) each."""
        first, last = self.between(stops)[..., None]
        towards = stops - self.origin_m
        return self.origin_m + first * towards, self.origin_m + last * towards


def straight_parts(path: OneWayPath) -> list[Straight]:
    """The parts of a path, from the target on."""
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


@dataclass(frozen=True, slots=True)
class _Beam:
    """Points of one mesh, and around them edges of another, on one straight part."""

    part: Straight
    mesh: int
    """Number of the other mesh."""
    apparent_m: np.ndarray
    """Where the points appear, (N, 3)."""
    near: np.ndarray
    """Which of them are near the edges, (N,)."""
    ends_m: np.ndarray
    """Ends of pieces of edges that may be outline, around the mesh as it is seen from the origin, (2, M, 3)."""

    def of(self, mask: np.ndarray) -> _Beam:
        """Some of the points, bool (N,)."""
        return replace(self, apparent_m=self.apparent_m[mask], near=self.near[mask])

    def beside_edges(self, far_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Segments just outside of each piece, to as `far_m` from the part's origin, (M, 3) each."""
        middle = self.ends_m.mean(axis=0) - self.part.origin_m
        aside = unit(vector_product(middle, self.ends_m[1] - self.ends_m[0]))
        return self.part.segments(self.part.origin_m + far_m * unit(middle + BESIDE_M * aside))

    def amplitude(self, hidden: np.ndarray, outline: np.ndarray, wavelength_m: float) -> np.ndarray:
        """That of the field at points `hidden` by the mesh or not (N,), where pieces (M,) are of its `outline` or not."""
        amplitudes = np.where(hidden, 0.0, 1.0)
        if self.near.any() and outline.any():
            ends_m, apparent_m = self.ends_m[:, outline], self.apparent_m[self.near]
            amplitudes[self.near] = _amplitude(self.part, ends_m, apparent_m, hidden[self.near], wavelength_m)
        return amplitudes


def _amplitude(
    part: Straight, ends_m: np.ndarray, apparent_m: np.ndarray, hidden: np.ndarray, wavelength_m: float
) -> np.ndarray:
    """Amplitude of the field at apparent points (N, 3), hidden or not (N,), beside an outline of pieces (2, M, 3)."""
    a, b = ends_m - part.origin_m
    ahead, distance = apparent_m - part.origin_m, norms((a + b) / 2)
    length = norms(ahead)
    ahead, a, b = unit(ahead / length[:, None] + TILT_RAD), unit(a), unit(b)
    middle, s = (a + b) / 2, b - a
    least_m = NO_WAVE_V**2 * wavelength_m / 4
    reach = (least_m + 2 * (length.max() - distance)) * least_m / (distance * length.max())
    columns = zip(ahead.T.astype(np.float32), middle.T.astype(np.float32), strict=True)
    point, piece = np.nonzero(sum((one[:, None] - other) ** 2 for one, other in columns) < reach.astype(np.float32))
    first, last = part.between(apparent_m) * length
    last = np.minimum(last, length)
    counts = (distance[piece] > first[point]) & (distance[piece] < last[point])
    point, piece = point[counts], piece[counts]
    # Directions lie so close that chords are angles: about the ray to a point, w is the place of a piece and s its extent.
    ahead, s, middle = ahead[point], s[piece], middle[piece]
    w = middle - ahead
    w_squared, across = inner(w, w), -inner(ahead, vector_product(w, s))
    angle = np.arctan2(across, w_squared - inner(s, s) / 4)
    # The mean of w squared over the angle that a piece turns about the ray, and the phase, which is about linear there.
    w_squared = np.divide(across, angle, out=w_squared, where=np.abs(angle) > LEAST_ANGLE_RAD)
    length, distance = length[point], distance[piece]
    left, scaled = length - distance, length * distance
    v_squared = 4 / wavelength_m * scaled * w_squared / (np.sqrt(left**2 + scaled * w_squared) + left)
    slope = inner(w, s) * scaled / (wavelength_m * np.maximum(left, SHORTEST_PIECE_M))
    v_squared, slope, angle = (term.astype(np.float32) for term in (v_squared, slope, angle))
    zone_m = np.sqrt(wavelength_m * np.maximum(left, 0) * length / distance)  # as it is wide where the points are
    clearance = np.clip((NO_WAVE_V - np.sqrt(v_squared)) / (NO_WAVE_V - FULL_V), 0, 1)
    fade = smooth_step(clearance) * smooth_step(np.clip((zone_m - NARROW_ZONE_M) / NARROW_ZONE_M, 0, 1))
    wave, phase = angle * fade * np.sinc(slope), np.float32(np.pi / 2) * v_squared

    def total(of: np.ndarray) -> np.ndarray:
        return np.bincount(point, of, len(apparent_m))

    # Where the outline runs through a point a ray may miss what the pieces turn about, or meet what they do not.
    hidden = np.where(total(v_squared < AT_EDGE_V**2) > 0, total(angle * (v_squared < 1)) > 0, hidden)
    in_phase, across = (total(wave * function(phase)) / (2 * np.pi) for function in (np.cos, np.sin))
    return np.asarray(np.hypot(1 - hidden + in_phase, across))


def smooth_step(u: np.ndarray) -> np.ndarray:
    """From 0 at 0 to 1 at 1, with no kink at either."""
    return np.asarray(u * u * (3 - 2 * u))


class Points(NamedTuple):
    """Points on meshes at some instants, seen along a path."""

    places_m: np.ndarray
    """(K, Q, 3)."""
    normals: np.ndarray
    """(K, Q, 3)."""
    owner: np.ndarray
    """Numbers of the meshes that they belong to, (Q,)."""
    front: np.ndarray
    """Which of them face the path, bool (K, Q)."""
    visible: np.ndarray
    """Which of these no mesh hides in straight lines, bool (K, Q)."""


def beside_others(
    at: PosedOccluders, seen_paths: Sequence[OneWayPath], of: Points, *, wavelength_m: float, backend: Backend
) -> np.ndarray:
    """Fraction of the field over the path at points that face it, float32 (K, Q): near the outline of a mesh that they do not
    belong to the amplitude beside that, elsewhere whether they are visible, in which case that is what comes back."""
    along = [
        (path, parts)
        for path, parts, at_them in zip(
            seen_paths, map(straight_parts, seen_paths), instants_of(seen_paths), strict=True
        )
        for _ in range(len(of.visible))[at_them]
    ]
    groups = []
    for instant, (path, parts) in enumerate(along):
        for mesh in np.unique(of.owner).tolist():
            near = [
                (part, other)
                for part in parts
                for other in range(len(at.meshes.meshes))
                if other != mesh and _near(at, instant, part, mesh, other, wavelength_m)
            ]
            numbers = np.flatnonzero(of.front[instant] & (of.owner == mesh))
            if near and len(numbers):
                here_m = of.places_m[instant, numbers]
                here_m = here_m + LIFT_M * (of.normals[instant, numbers] + unit(images(path)[-1] - here_m))
                beams = [_beam(at, instant, part, other, part.appear(here_m), wavelength_m) for part, other in near]
                beside = np.any([beam.near for beam in beams], axis=0)
                if beside.any():
                    beams = [beam.of(beside) for beam in beams]
                    groups.append(_Group(instant, mesh, numbers[beside], here_m[beside], parts, beams))
    return _summed(groups, at, of.visible, wavelength_m, backend) if groups else of.visible


def _near(at: PosedOccluders, instant: int, part: Straight, mesh: int, other: int, wavelength_m: float) -> bool:
    """Whether the box around another mesh comes near the lines from the part's origin to that around a mesh."""
    mine = part.appear(at.boxes[instant, mesh]) - part.origin_m
    others = at.boxes[instant, other] - part.origin_m
    ahead = unit(mine.mean(axis=0))
    mine_m, others_m = mine @ ahead, others @ ahead
    if others_m.min() > mine_m.max() or others_m.max() < 0:
        return False
    if min(mine_m.min(), others_m.min()) < LEAST_DEPTH_M:
        return True
    # Seen in perspective a box lies within its corners, and angles are larger by as much as the square of distance over depth.
    across = unit(others.mean(axis=0) - (others.mean(axis=0) @ ahead) * ahead)
    stretch = max((inner(corners, corners) / depth**2).max() for corners, depth in ((mine, mine_m), (others, others_m)))
    reach = stretch * NO_WAVE_V * np.sqrt(wavelength_m / (2 * others_m.min()))
    return bool((others @ across / others_m).min() - (mine @ across / mine_m).max() < reach)


def _beam(
    at: PosedOccluders, instant: int, part: Straight, other: int, apparent_m: np.ndarray, wavelength_m: float
) -> _Beam:
    """Which apparent points (N, 3) m are near edges of the other mesh that may be its outline, and these."""
    from scipy.spatial import cKDTree

    towards = apparent_m - part.origin_m
    length = norms(towards)
    towards, farthest = towards / length[:, None], length.max()
    low, high = towards.min(axis=0), towards.max(axis=0)

    def close(ends_m: np.ndarray) -> np.ndarray:
        """Angle from which each segment (2, M, 3) reaches a point, 0 where it reaches none."""
        distance = np.maximum(norms(ends_m.mean(axis=0) - part.origin_m), SHORTEST_PIECE_M)
        reach = NO_WAVE_V * np.sqrt(wavelength_m * np.maximum(farthest - distance, 0) / (2 * distance * farthest))
        directions = unit(ends_m - part.origin_m)
        # The directions of what lies between two ends bulge beyond their chord.
        bulge = 1 - np.sqrt(1 - np.minimum(inner(*2 * [directions[1] - directions[0]]) / 4, 1))
        margin = (reach + bulge)[:, None]
        beside = (directions.min(axis=0) - margin > high) | (directions.max(axis=0) + margin < low)
        return np.where(beside.any(axis=1), 0, reach)

    near, ends_m = np.zeros(len(apparent_m), bool), at.folds(instant, other, part.origin_m)
    ends_m = _cut(ends_m, LONGEST_EDGE_RAD * np.maximum(norms(ends_m.mean(axis=0) - part.origin_m), LEAST_DEPTH_M))
    across = norms(np.diff(unit(ends_m - part.origin_m), axis=0)[0]) * norms(ends_m[0] - part.origin_m)
    ends_m = ends_m[:, (close(ends_m) > 0) & (across > END_ON_RAD * norms(ends_m[1] - ends_m[0]))]
    distance = norms(ends_m.mean(axis=0) - part.origin_m)
    left = np.maximum(length.min() - distance, 0)
    ends_m = _cut(
        ends_m, np.maximum(PIECE_V * np.sqrt(wavelength_m * distance * left / (2 * length.min())), SHORTEST_PIECE_M)
    )
    reach = close(ends_m)
    ends_m, reach = ends_m[:, reach > 0], reach[reach > 0]
    if len(reach):
        piece_directions = unit(ends_m - part.origin_m)
        bound = reach.max() + norms(piece_directions[1] - piece_directions[0]).max() / 2
        away, _ = cKDTree(piece_directions.mean(axis=0)).query(towards, distance_upper_bound=bound)
        near = np.isfinite(away)
    return _Beam(part, other, apparent_m, near, ends_m)


def _cut(ends_m: np.ndarray, longest_m: np.ndarray) -> np.ndarray:
    """Segments (2, M, 3) in equal pieces that are no longer than (M,), one after another."""
    count = np.ceil(norms(ends_m[1] - ends_m[0]) / longest_m).astype(int)
    of = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    steps = np.stack([step, step + 1])[..., None] / count[of][:, None]
    return np.asarray(ends_m[0, of] + steps * (ends_m[1] - ends_m[0])[of])


@dataclass(frozen=True, slots=True)
class _Group:
    """Points of one mesh at one instant near edges of others."""

    instant: int
    mesh: int
    numbers: np.ndarray
    """(N,)."""
    here_m: np.ndarray
    """Where rays from them start, (N, 3)."""
    parts: list[Straight]
    beams: list[_Beam]


def _summed(
    groups: list[_Group], at: PosedOccluders, visible: np.ndarray, wavelength_m: float, backend: Backend
) -> np.ndarray:
    """`beside_others` of points near edges."""
    asked: list[tuple[tuple[np.ndarray, np.ndarray], tuple[int, int]]] = []
    for group in groups:
        dark = ~visible[group.instant, group.numbers]
        for part in group.parts:
            asked.append((part.segments(part.appear(group.here_m[dark])), (group.instant, group.mesh)))
        for beam in group.beams:
            where = group.instant, beam.mesh
            far_m = float(norms(at.boxes[where] - beam.part.origin_m).max())
            asked.append((beam.part.segments(beam.apparent_m[dark]), where))
            asked.append((beam.beside_edges(far_m), where))
    free = iter(_free(asked, at, backend))
    fractions = visible.astype(np.float32)
    for group in groups:
        dark = ~visible[group.instant, group.numbers]
        value = np.ones(len(dark))
        for _ in group.parts:
            value[dark] *= next(free)
        open_ = value > 0  # not hidden by their own mesh
        for beam in group.beams:
            hidden = np.zeros(len(dark), bool)
            hidden[dark] = ~next(free)
            value[open_] *= beam.of(open_).amplitude(hidden[open_], next(free), wavelength_m)
        fractions[group.instant, group.numbers] = value
    return fractions


@one_thread_at_a_time
def _free(
    asked: list[tuple[tuple[np.ndarray, np.ndarray], tuple[int, int]]], at: PosedOccluders, backend: Backend
) -> list[np.ndarray]:
    """Which segments from (N, 3) to (N, 3) m a mesh leaves free at an instant, given with their numbers: bool (N,) of each."""
    counts = np.array([len(starts) for (starts, _), _ in asked])
    starts, stops = (np.concatenate([segments[end] for segments, _ in asked]) for end in (0, 1))
    if not len(starts):
        return [np.zeros(0, bool)] * len(counts)
    alone = _alone(at, {where for _, where in asked}, np.concatenate([starts, stops]), backend)
    shift = np.repeat([alone.shift_m[where] for _, where in asked], counts, axis=0)
    ahead = stops - starts
    length = norms(ahead)
    towards = rays(mitsuba(backend), starts + shift, ahead / np.maximum(length, 1e-12)[:, None], length)
    return np.split(~alone.scene.ray_test(towards).numpy(), np.cumsum(counts)[:-1])


class _Alone(NamedTuple):
    """Meshes at instants, each alone in a cell of one scene."""

    scene: Any
    shift_m: dict[tuple[int, int], np.ndarray]
    """How far each mesh at an instant is shifted to its cell, (3,)."""
    extent_m: float
    """How far from the middle of the meshes a cell extends."""


def _alone(at: PosedOccluders, required: set[tuple[int, int]], ends_m: np.ndarray, backend: Backend) -> _Alone:
    """A scene of these meshes at these instants for segments with these ends: an earlier one, where it has them."""
    middle = at.boxes.mean(axis=(0, 1, 2))
    extent_m = max(float(np.abs(points - middle).max()) for points in (ends_m, at.boxes))
    if at.alone:
        if required <= at.alone[0].shift_m.keys() and extent_m <= at.alone[0].extent_m:
            return at.alone[0]
        required = required | at.alone[0].shift_m.keys()
    places, extent_m = sorted(required), CELL_GROWTH * extent_m
    across = int(np.ceil(len(places) ** (1 / 3)))
    cells = np.stack(np.unravel_index(np.arange(len(places)), (across, across, across)), axis=1) - (across - 1) / 2
    vertices, faces, shift_m, first = [], [], 2.1 * extent_m * cells - middle, 0
    for (instant, mesh), shift in zip(places, shift_m, strict=True):
        vertices.append(at.vertices[instant, slice(*at.meshes.starts[mesh : mesh + 2])] + shift)
        faces.append(at.meshes.meshes[mesh].faces + first)
        first += len(vertices[-1])
    mi = mitsuba(backend)
    scene = traceable(mi, mitsuba_mesh(mi, np.concatenate(vertices), np.concatenate(faces)))
    at.alone[:] = [_Alone(scene, dict(zip(places, shift_m, strict=True)), extent_m)]
    return at.alone[0]
