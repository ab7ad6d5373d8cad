"""Echoes of a moving mesh: closed-form facets for the coherent part, frozen points for the diffuse part."""

from __future__ import annotations

import math
import os
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.echo.antennas import seen_by, side_by_side
from t2d_rt.echo.facets import Pair, diffuse_echoes, patch_echoes
from t2d_rt.echo.legs import Anchors, Arrivals, View, anchor_vertices, over_legs
from t2d_rt.echo.patches import TURNS_PER_STEP, Csr, Ends, Patches, centres, least_range_m, normals, patches, tilts
from t2d_rt.errors import InputError
from t2d_rt.geometry import Refinement, point_spacing, refinements, surface_points
from t2d_rt.types import EchoArrays, EchoStream, Material, MovingMesh, Radar

# Diffuse points lie on a refinement of their own fixed fineness, so that they do not depend on the facets' size: a point is off
# the curved surface by a tenth of this phase or so, always the same.
POINT_SAGITTA_RAD = 0.7
POINTS_PER_MESH = 4_000
"""At least about this many diffuse points; their number does not change the power."""
FACING_RATE_HZ, FACING_AT_ONCE = 10.0, 20
"""How often it is looked at which faces ever face an image of an antenna."""
PROBE_EVERY = 6
"""Frames between looks at which faces face the antennas."""
BEND_RAD = 0.2
"""By how much more than at rest facets may be tilted against the face they lie in, where a joint bends."""
KEPT_FACETS = 1_000_000
"""Refinements are kept, the last used ones, for as many facets."""
FRAMES_AT_ONCE = 20
"""The cage's positions at that many moments fit the cache."""
_kept: OrderedDict[tuple[object, ...], list[Refinement]] = OrderedDict()
Sagitta = float | np.ndarray
"""One phase sagitta [rad], or one for each vertex (V,)."""


def mesh_echoes(
    surface: MovingMesh,
    radar: Radar,
    *,
    times_s: np.ndarray,
    material: Material,
    sagitta_rad: Sagitta,
    seed: int,
    views: Sequence[View],
    backend: Backend,
    turns_per_step: float = TURNS_PER_STEP,
    points: int = POINTS_PER_MESH,
) -> EchoStream:
    """Echoes of `surface` at surface frames `times_s`: one of each patch and of each diffuse point, in each of `views`.

    `sagitta_rad` sets the facets' size (physics.md, eq. 5), `turns_per_step` that of patches, `points` how many diffuse ones.
    """
    pairs = [Pair.of(radar, view.legs) for view in views]
    ends = [(pair.places_m[0], pair.places_m[-1]) for pair in pairs]
    model = _Model.of(surface, radar, ends, times_s, material, sagitta_rad, seed, turns_per_step, points)
    models = [
        model if view.legs is None else model.facing(surface, times_s, pair)
        for pair, view in zip(pairs, views, strict=True)
    ]
    rest = surface.rest[None]
    in_room = any(view.legs is not None for view in views)
    chosen = anchor_vertices(surface.rest) if in_room else np.zeros(1, int)
    anchors = [
        None
        if view.legs is None
        else Anchors.of(chosen, surface.rest, each.places(rest, _carried(each.centre, rest))[0])
        for each, view in zip(models, views, strict=True)
    ]

    def frames(start: int, stop: int) -> EchoArrays:
        times = times_s[start:stop]
        cage = surface.at(times)
        arrivals = Arrivals(radar, cage[:, chosen])
        parts = []
        for pair, view, model, anchor in zip(pairs, views, models, anchors, strict=True):
            centre = _carried(model.centre, cage)
            places = model.places(cage, centre) if radar.is_array or radar.directional else None
            echoes = model.echoes(cage, centre, None if view.seen is None else view.seen(times), pair, backend)
            if view.legs is not None and anchor is not None:
                passed = None if view.passed is None else view.passed(times)
                echoes = over_legs(radar, echoes, view.legs, arrivals, anchor.shares, passed, places, places)
            elif places is not None:
                echoes = seen_by(radar, echoes, places, places)
            parts.append(echoes)
        return side_by_side(parts)

    return EchoStream(times_s=times_s, frames=frames)


def joined(streams: list[EchoStream]) -> EchoStream:
    """Several targets' echoes as one stream; all must have the same frame times."""
    if len(streams) == 1:
        return streams[0]
    return EchoStream(
        times_s=streams[0].times_s,
        frames=lambda start, stop: side_by_side([stream.frames(start, stop) for stream in streams]),
    )


@dataclass(frozen=True, slots=True)
class _Model:
    """What stays the same from frame to frame."""

    cage_faces: np.ndarray
    tilt_rad: np.ndarray
    """Largest angle between a cage face and its facets, (cage faces,)."""
    operator: Csr
    """Sparse, float32: the facets' vertices from the cage's."""
    patches: Patches
    centre: Csr
    """Sparse: the patches' reference points from the cage's vertices."""
    reflection: complex
    points: _Points | None

    @classmethod
    def of(
        cls,
        surface: MovingMesh,
        radar: Radar,
        seen_from: Sequence[Ends],
        times_s: np.ndarray,
        material: Material,
        sagitta_rad: Sagitta,
        seed: int,
        turns_per_step: float,
        point_count: int,
    ) -> _Model:
        reflection = material.reflection(radar.mid_frequency_hz)
        rough = material.scattering_coefficient
        sagittas = [sagitta_rad, POINT_SAGITTA_RAD] if rough > 0 else [sagitta_rad]
        wavenumber = 2 * math.pi / radar.wavelength_m
        fine, *carriers = _refinements(surface, wavenumber, least_range_m(surface, seen_from, times_s), sagittas)
        parts = patches(surface, fine, radar, times_s, seen_from=seen_from, turns_per_step=turns_per_step)
        points = _Points.spread(surface, carriers[0], seed, rough * abs(reflection), point_count) if carriers else None
        return cls(
            cage_faces=surface.faces,
            tilt_rad=tilts(surface, fine),
            operator=fine.operator.astype(np.float32),
            patches=parts,
            centre=centres(parts, fine),
            reflection=reflection * math.sqrt(1 - rough**2),
            points=points,
        )

    def facing(self, surface: MovingMesh, times_s: np.ndarray, pair: Pair) -> _Model:
        """With the patches only that ever face both antennas."""
        lit = np.zeros(len(self.cage_faces), bool)
        probes = np.linspace(times_s[0], times_s[-1], max(2, math.ceil((times_s[-1] - times_s[0]) * FACING_RATE_HZ)))
        for first in range(0, len(probes) - 1, FACING_AT_ONCE):
            lit |= self._lit(surface.at(probes[first : first + FACING_AT_ONCE + 1]), pair, every=1)
        kept = np.flatnonzero(self.patches.any_of(lit))
        if not len(kept):
            return self
        return replace(self, patches=self.patches.only(kept), centre=self.centre[kept])

    def echoes(
        self, cage: np.ndarray, centre: np.ndarray, seen: np.ndarray | None, pair: Pair, backend: Backend
    ) -> EchoArrays:
        """Arrays of `Echoes` for cage vertices (K, V, 3) and the patches' centres (G, K, 3): patches first, then diffuse points."""
        count, more = len(self.patches), 0 if self.points is None else len(self.points.area_m2)
        delay = np.empty((len(cage), count + more))
        amplitude = np.zeros(delay.shape, np.complex64)
        slope = np.zeros(delay.shape, np.complex64)
        sights = (centre - place for place in pair.places_m)
        ranges = [np.sqrt(np.einsum("gti,gti->tg", sight, sight)) for sight in sights]
        delay[:, :count] = (ranges[0] + ranges[-1]) / SPEED_OF_LIGHT
        lit = np.flatnonzero(self.patches.any_of(self._lit(cage, pair)))
        if len(lit):
            parts = self.patches.only(lit)
            used = np.zeros(self.operator.shape[0], bool)
            used[parts.corners] = True
            parts = replace(parts, corners=(np.cumsum(used) - 1)[parts.corners])
            # Positions within the body need no more than float32: 1e-7 of its size.
            origin = cage.mean(axis=1)
            local = np.ones((*cage.shape[:2], 4), np.float32)
            local[..., :3] = cage - origin[:, None]
            if seen is not None:
                local[..., 3] = seen
            vertices = _carried(self.operator[used], local)
            coherent = patch_echoes(vertices, origin, parts, centre[lit], pair, self.reflection, backend)
            amplitude[:, lit], slope[:, lit] = (part.T for part in coherent)
        if self.points is not None:
            delay[:, count:], amplitude[:, count:] = (part.T for part in self.points.echoes(cage, seen, pair, backend))
        return EchoArrays(delay, amplitude, slope)

    def places(self, cage: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Where the echoes stand (K, N, 3), as of `echoes`."""
        found = [centre]
        if self.points is not None:
            found.append(self.points.places(cage))
        return np.concatenate(found).transpose(1, 0, 2)

    def _lit(self, cage: np.ndarray, pair: Pair, every: int = PROBE_EVERY) -> np.ndarray:
        """Cage faces that may hold facets lit by the transmitter and seen by the receiver at or between the frames."""
        probes = np.unique(np.linspace(0, len(cage) - 1, max(2, len(cage) // every)).astype(int))
        normal = normals(cage[probes], self.cage_faces)
        middle = cage[probes][:, self.cage_faces].mean(axis=2)
        angle = np.zeros(normal.shape[:2])
        for antenna in pair.views_m:
            sight = antenna - middle
            cosine = np.sum(normal * sight, axis=2) / np.linalg.norm(sight, axis=2)
            angle = np.maximum(angle, np.arccos(np.clip(cosine, -1, 1)))
        # What turns from probe to probe may turn as much again in between.
        margin = self.tilt_rad + BEND_RAD + np.abs(np.diff(angle, axis=0)).max(axis=0, initial=0)
        return angle.min(axis=0) < math.pi / 2 + margin


def _refinements(
    surface: MovingMesh, wavenumber: float, range_m: float, sagittas_rad: list[Sagitta]
) -> list[Refinement]:
    """`refinements` of a mesh, kept for the next recording of the same body."""
    shape = [surface.rest, surface.faces, *(np.asarray(sagitta, float) for sagitta in sagittas_rad)]
    key = (*(part.tobytes() for part in shape), wavenumber, range_m, surface.crease_deg)
    if key not in _kept:
        _kept[key] = refinements(
            surface.rest,
            surface.faces,
            wavenumber=wavenumber,
            range_m=range_m,
            sagittas_rad=sagittas_rad,
            crease_deg=surface.crease_deg,
        )
        while len(_kept) > 1 and sum(len(each.faces) for found in _kept.values() for each in found) > KEPT_FACETS:
            _kept.popitem(last=False)
    _kept.move_to_end(key)
    return _kept[key]


@dataclass(frozen=True, slots=True)
class _Points:
    """Diffuse points on the triangles that hold them."""

    carrier: Refinement
    """Only the vertices that hold points."""
    corners: np.ndarray
    barycentric: np.ndarray
    area_m2: np.ndarray
    phase_rad: np.ndarray
    scattered: float

    @classmethod
    def spread(cls, surface: MovingMesh, carrier: Refinement, seed: int, scattered: float, count: int) -> _Points:
        rest = carrier.operator @ surface.rest
        a, b, c = (rest[carrier.faces[:, i]] for i in range(3))
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        points = surface_points(rest, carrier.faces, seed=seed, spacing_m=point_spacing(area, count))
        used, corners = np.unique(carrier.faces[points.face], return_inverse=True)
        held = Refinement(
            operator=carrier.operator[used],
            faces=carrier.faces,
            base_face=carrier.base_face,
            linear=carrier.linear[used],
        )
        return cls(held, corners.reshape(-1, 3), points.barycentric, points.area_m2, points.phase_rad, scattered)

    def places(self, cage: np.ndarray) -> np.ndarray:
        """Where the points stand (Q, K, 3), for cage vertices (K, V, 3)."""
        vertices = _carried(self.carrier.operator, cage)
        return sum(vertices[self.corners[:, i]] * self.barycentric[:, i, None, None] for i in range(3))

    def echoes(
        self, cage: np.ndarray, seen: np.ndarray | None, pair: Pair, backend: Backend
    ) -> tuple[np.ndarray, np.ndarray]:
        vertices = _carried(self.carrier.operator, cage)
        fraction = None if seen is None else _carried(self.carrier.linear, seen[..., None])
        return diffuse_echoes(
            vertices,
            self.corners,
            self.barycentric,
            self.area_m2,
            self.phase_rad,
            fraction,
            pair,
            self.scattered,
            backend,
        )


def _carried(operator: Csr, values: np.ndarray) -> np.ndarray:
    """Applies a sparse (Vf, V) to values (K, V, C) of the cage: (Vf, K, C)."""
    out = np.empty((operator.shape[0], len(values), values.shape[2]), values.dtype)

    def carry(start: int) -> None:
        part = values[start : start + FRAMES_AT_ONCE].transpose(1, 0, 2)
        product = operator @ np.ascontiguousarray(part).reshape(len(part), -1)
        out[:, start : start + FRAMES_AT_ONCE] = product.reshape(len(out), *part.shape[1:])

    with ThreadPoolExecutor(os.cpu_count()) as pool:  # a sparse product leaves Python's lock alone
        list(pool.map(carry, range(0, len(values), FRAMES_AT_ONCE)))
    return out


def check_outside(surface: MovingMesh, radar: Radar, times_s: np.ndarray) -> None:
    """Refuses a radar inside a closed mesh, or touching a mesh, at any of a few moments of the record."""
    times = np.linspace(times_s[0], times_s[-1], 25)
    vertices = surface.at(times)
    for antenna in (radar.tx_position_m, radar.rx_position_m):
        inside = np.abs(_winding(vertices, surface.faces, antenna)) > 0.5
        touches = np.linalg.norm(vertices - antenna, axis=2).min(axis=1) < 1e-3
        if inside.any() or touches.any():
            where = ", ".join(f"{x:.3g}" for x in antenna)
            moment = times[np.argmax(inside if inside.any() else touches)]
            raise InputError(
                f"the radar at ({where}) m {'is inside' if inside.any() else 'touches'} {surface.name} at {moment:.3g} s; place "
                "the target farther away (distance_m) or move the radar"
            )


def _winding(vertices: np.ndarray, faces: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Winding number (K,) of meshes (K, V, 3) about a point: 1 inside, 0 outside (Van Oosterom & Strackee 1983)."""
    a, b, c = (vertices[:, faces[:, i]] - point for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    triple = np.sum(a * np.cross(b, c), axis=2)
    rest = la * lb * lc + np.sum(a * b, 2) * lc + np.sum(b * c, 2) * la + np.sum(c * a, 2) * lb
    return 2 * np.arctan2(triple, rest).sum(axis=1) / (4 * math.pi)
