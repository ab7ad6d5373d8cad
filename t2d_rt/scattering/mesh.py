"""Echoes of a moving mesh: closed-form facets for the coherent part, frozen points for the diffuse part."""

from __future__ import annotations

import math
import os
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from t2d_rt.backend import Backend, aligned_empty
from t2d_rt.errors import InputError
from t2d_rt.geometry import Refinement, SubdividedMesh, point_spacing, refinements, surface_points, winding
from t2d_rt.geometry.vectors import edge_cross
from t2d_rt.memory import blocks
from t2d_rt.scattering.antennas import seen_by, side_by_side
from t2d_rt.scattering.facets import Block, Pair, Weights, diffuse_echoes, patch_delays, patch_echoes
from t2d_rt.scattering.patches import (
    CYCLES_PER_STEP,
    SWEEP_CYCLES,
    Csr,
    Ends,
    Patches,
    centres,
    least_range_m,
    normals,
    patches,
    tilts,
)
from t2d_rt.scattering.paths import Anchors, Arrivals, View, anchor_vertices, unfolded
from t2d_rt.scattering.streams import in_parts, most_echoes
from t2d_rt.types import EchoArrays, EchoStream, Material, MovingMesh, Radar

# Diffuse points lie on a refinement of their own fixed fineness, so that they do not depend on the facets' size: a point is off
# the curved surface by a tenth of this phase or so, always the same.
POINT_SAGITTA_RAD = 0.7
POINTS_PER_MESH = 4_000
"""At least about this many diffuse points; their number does not change the power."""
FACING_RATE_HZ, FACING_AT_ONCE, FACING_MOST_HZ = 10.0, 20, 200.0
"""Rate at which faces are tested for whether they ever face an image of an antenna, and how many instants at once; a target whose
surface rate exceeds the last one rotates too fast for that."""
PROBE_EVERY = 6
"""Frames between tests of which faces face the antennas."""
BEND_RAD = 0.2
"""By how much more than at rest facets may be tilted against the face they lie in, where a joint bends."""
KEPT_FACETS = 800_000
"""Refinements are kept, the last used ones, for as many facets: some 300 bytes each."""
REFINING_BYTES = 1_700
"""What a facet takes while it is made (measured with 110 000 to 1 000 000 facets of a body)."""
MOST_FACETS = 1_000_000
"""Of one mesh, unless a run may take more memory."""
FRAMES_AT_ONCE = 20
"""The cage's positions at that many instants fit the cache."""
_kept: OrderedDict[tuple[object, ...], list[Refinement]] = OrderedDict()
VertexVisibility = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Visibility (K, Q) of vertices (K, Q, 3) of triangles (F, 3)."""
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
    cycles_per_step: float = CYCLES_PER_STEP,
    points: int = POINTS_PER_MESH,
    sweep_cycles: float = SWEEP_CYCLES,
    max_facets: int = MOST_FACETS,
) -> EchoStream:
    """Echoes of `surface` at surface frames `times_s`: one of each patch and of each diffuse point, in each of `views`.

    `sagitta_rad` sets the facets' size (physics.md, eq. 5), `cycles_per_step` and `sweep_cycles` that of patches, `points` how many
    diffuse ones there are at least; more than `max_facets` facets are refused.
    """
    pairs = [Pair.of(radar, view.paths) for view in views]
    ends = [(pair.places_m[0], pair.places_m[-1]) for pair in pairs]
    subdivisions = {view.subdivision for view in views}
    model = _Model.of(
        surface,
        radar,
        ends,
        times_s,
        material,
        sagitta_rad,
        seed,
        cycles_per_step,
        sweep_cycles,
        points,
        subdivisions,
        max_facets,
    )
    selections = list(model.selections(surface, times_s, pairs, views))
    anchors = None
    if any(view.paths is not None for view in views):
        rest = surface.rest[None]
        places = model.places(rest, _carried(model.centre, rest))[0]
        anchors = Anchors.of(anchor_vertices(surface.rest), surface.rest, places, backend)

    def frames(selections: Sequence[_Selection], start: int, stop: int) -> EchoArrays:
        times = times_s[start:stop]
        cage = surface.at(times)
        posed = _Posed.of(model, cage, backend)
        block = Block(len(times), _total(selections), backend)
        arrivals = None if anchors is None else Arrivals(radar, cage[:, anchors.vertices])
        for selection in selections:
            view, weights = selection.view, None
            if view.paths is not None and arrivals is not None and anchors is not None:
                unblocked = None if view.unblocked is None else view.unblocked(times)
                weights = anchors.weights(*arrivals.weight(view.paths), unblocked, backend)
            visibility = None if view.visibility is None else view.visibility(times)
            facet_visibility = None if view.facet_visibility is None else partial(view.facet_visibility, times)
            model.put(block, posed, selection, visibility, facet_visibility, weights, backend)
        found = block.arrays()
        if not (radar.is_array or radar.directional):
            return found
        places = model.places(cage, posed.centre)
        return side_by_side([selection.with_ends(radar, found, places) for selection in selections])

    return in_parts(
        [
            EchoStream(
                times_s=times_s, frames=partial(frames, part), vertices=model.operator.shape[0], echoes=_total(part)
            )
            for part in _parts(selections, most_echoes(radar))
        ]
    )


def facets(
    surface: MovingMesh,
    radar: Radar,
    sagitta_rad: Sagitta,
    *,
    span_s: tuple[float, float],
    max_facets: int = MOST_FACETS,
) -> MovingMesh:
    """The facets that `mesh_echoes` would sum in free space, as a mesh of their own."""
    places = radar.tx_position_m, radar.rx_position_m
    wavenumber = 2 * math.pi / radar.wavelength_m
    range_m = least_range_m(surface, [places], np.array(span_s))
    fine, _ = _refinements(surface, wavenumber, range_m, [sagitta_rad, POINT_SAGITTA_RAD], max_facets)
    return MovingMesh.from_track(
        lambda times_s: _carried(fine.operator, surface.at(times_s)).swapaxes(0, 1),
        fine.faces, surface.times_s, surface.material, rest=fine.operator @ surface.rest, name=surface.name,
    )  # fmt: skip


def _total(selections: Sequence[_Selection]) -> int:
    return sum(len(selection.echoes) for selection in selections)


def _parts(selections: Sequence[_Selection], most: int) -> Iterator[list[_Selection]]:
    """Selections in parts of at most that many echoes, each part's columns counted from 0; a larger one is cut."""
    part: list[_Selection] = []
    for selection in (piece for each in selections for piece in each.cut(most)):
        if part and _total(part) + len(selection.echoes) > most:
            yield part
            part = []
        part.append(replace(selection, first=_total(part)))
    yield part


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
    visibility_meshes: dict[int, _VisibilityMesh]
    """Meshes at whose vertices visibility is sampled, by subdivision level."""
    at_instants: bool
    """Whether frames are instants unrelated to one another."""

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
        cycles_per_step: float,
        sweep_cycles: float,
        point_count: int,
        subdivisions: set[int],
        max_facets: int,
    ) -> _Model:
        reflection = material.reflection(radar.mid_frequency_hz)
        rough = material.scattering_coefficient
        sagittas = [sagitta_rad, POINT_SAGITTA_RAD] if rough > 0 else [sagitta_rad]
        wavenumber = 2 * math.pi / radar.wavelength_m
        fine, *carriers = _refinements(
            surface, wavenumber, least_range_m(surface, seen_from, times_s), sagittas, max_facets
        )
        parts = patches(
            surface,
            fine,
            radar,
            times_s,
            seen_from=seen_from,
            cycles_per_step=cycles_per_step,
            sweep_cycles=sweep_cycles,
        )
        points = _Points.spread(surface, carriers[0], seed, rough * abs(reflection), point_count) if carriers else None
        visibility_meshes = {level: _VisibilityMesh.of(surface, fine, points, level) for level in subdivisions}
        return cls(
            cage_faces=surface.faces,
            tilt_rad=tilts(surface, fine),
            operator=fine.operator.astype(np.float32),
            patches=parts,
            centre=centres(parts, fine),
            reflection=reflection * math.sqrt(1 - rough**2),
            points=points,
            visibility_meshes=visibility_meshes,
            at_instants=math.isinf(cycles_per_step),
        )

    def selections(
        self, surface: MovingMesh, times_s: np.ndarray, pairs: Sequence[Pair], views: Sequence[View]
    ) -> Iterator[_Selection]:
        """Each view with the patches that ever face both of its antennas; in free space, where there is but one, all."""
        lit = np.zeros((len(pairs), len(self.cage_faces)), bool)
        if self.at_instants or (len(times_s) - 1) / (times_s[-1] - times_s[0]) > FACING_MOST_HZ:
            lit[:] = True
        probes = np.linspace(times_s[0], times_s[-1], max(2, math.ceil((times_s[-1] - times_s[0]) * FACING_RATE_HZ)))
        in_room = [view.paths is not None for view in views]
        for first in range(0, len(probes) - 1 if any(in_room) and not lit.all() else 0, FACING_AT_ONCE):
            facing = _Facing.of(surface.at(probes[first : first + FACING_AT_ONCE + 1]), self.cage_faces)
            for number, pair in enumerate(pairs):
                lit[number] |= self.lit(facing, pair)
        lit[~np.array(in_room)] = True
        points = len(self.patches) + np.arange(0 if self.points is None else len(self.points.area_m2))
        first = 0
        for pair, view, some in zip(pairs, views, lit, strict=True):
            patches = np.flatnonzero(self.patches.any_of(some))
            echoes = np.concatenate([patches, points])
            yield _Selection(view, pair, echoes, len(patches), first)
            first += len(echoes)

    def put(
        self,
        block: Block,
        posed: _Posed,
        selection: _Selection,
        visibility: np.ndarray | None,
        facet_visibility: VertexVisibility | None,
        weights: Weights | None,
        backend: Backend,
    ) -> None:
        """Writes the echoes of one view to its columns; `visibility` (K, V') is of the vertices of its visibility mesh,
        `facet_visibility` of finer ones."""
        pair, patches, visibility_mesh = (
            selection.pair,
            selection.echoes[: selection.patches],
            self.visibility_meshes[selection.view.subdivision],
        )
        columns = selection.first + np.arange(len(selection.echoes))
        if len(patches):
            patch_delays(posed.centres, patches, pair, block, columns[: len(patches)], backend)
        faces = np.ones(len(self.cage_faces), bool) if self.at_instants else self.lit(posed.facing, pair)
        if visibility is not None:
            faces &= self._with_neighbours(visibility_mesh, np.asarray(visibility.any(axis=0)))
        lit = self.patches.any_of(faces)[patches]
        if weights is not None:
            lit &= weights.reach[patches]
        lit = np.flatnonzero(lit)
        if len(lit):
            parts = self.patches.only(patches[lit])
            if visibility is None and facet_visibility is None:
                vertices = posed.vertices
            elif facet_visibility is not None:
                values = self._visible_vertices(posed, visibility, visibility_mesh, slice(None))
                values[..., 3] *= _sampled_visibility(
                    facet_visibility, values[..., :3] + posed.origin, self.patches.corners
                )
                vertices = _on_device(values, backend.Float32)
            else:
                used = np.zeros(self.operator.shape[0], bool)
                used[parts.corners] = True
                parts = replace(parts, corners=(np.cumsum(used) - 1)[parts.corners])
                vertices = _on_device(self._visible_vertices(posed, visibility, visibility_mesh, used), backend.Float32)
            patch_echoes(
                vertices, posed.centres, posed.origin, parts, patches[lit], pair, self.reflection, weights, block,
                columns[lit], backend,
            )  # fmt: skip
        if self.points is not None and len(selection.echoes) > selection.patches:
            fraction = self.points.fraction(visibility, visibility_mesh, facet_visibility, posed.cage)
            self.points.put(
                block, posed.carrier, fraction, pair, weights, len(self.patches), columns[len(patches) :], backend
            )

    def _visible_vertices(
        self, posed: _Posed, visibility: np.ndarray | None, visibility_mesh: _VisibilityMesh, used: np.ndarray | slice
    ) -> np.ndarray:
        """The `used` facets' vertices and their visibility, float32 (Vf, T, 4)."""
        if visibility_mesh.facets is None or visibility is None:
            return _carried(self.operator[used], posed.local(visibility))
        values = _carried(self.operator[used], posed.local(None))
        values[..., 3] = _carried(visibility_mesh.facets[used], visibility[..., None])[..., 0]
        return values

    def _with_neighbours(self, visibility_mesh: _VisibilityMesh, visibility: np.ndarray) -> np.ndarray:
        """Cage faces, bool (F,), whose facets' vertices depend on any visible vertex of the visibility mesh, bool (V',): its own
        faces and their neighbours."""
        wider = np.zeros(self.operator.shape[1], bool)
        wider[self.cage_faces[visibility[visibility_mesh.faces].reshape(len(self.cage_faces), -1).any(axis=1)]] = True
        return np.asarray(wider[self.cage_faces].any(axis=1))

    def places(self, cage: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Where the echoes stand (K, N, 3), as of `echoes`."""
        found = [centre]
        if self.points is not None:
            found.append(self.points.places(cage))
        return np.concatenate(found).transpose(1, 0, 2)

    def lit(self, facing: _Facing, pair: Pair) -> np.ndarray:
        """Cage faces that may hold facets lit by the transmitter and visible to the receiver at or between the instants."""
        angle = np.zeros(facing.normal.shape[:2])
        for antenna in pair.views_m:
            line_of_sight = antenna - facing.middle
            cosine = np.einsum("kfi,kfi->kf", facing.normal, line_of_sight) / np.sqrt(
                np.einsum("kfi,kfi->kf", line_of_sight, line_of_sight)
            )
            angle = np.maximum(angle, np.arccos(np.clip(cosine, -1, 1)))
        # What rotates from one instant to the next may rotate as much again in between.
        margin = self.tilt_rad + BEND_RAD + np.abs(np.diff(angle, axis=0)).max(axis=0, initial=0)
        return angle.min(axis=0) < math.pi / 2 + margin


@dataclass(frozen=True, slots=True)
class _VisibilityMesh:
    """The subdivided cage at whose vertices visibility is sampled."""

    faces: np.ndarray
    """Those of each cage face together."""
    facets: Csr | None
    """Sparse: from visibility there to that of the facets' vertices; None: visibility of the cage's own vertices is carried
    along."""
    points: Csr | None
    """Sparse: the same of vertices that hold the diffuse points."""

    @classmethod
    def of(cls, surface: MovingMesh, fine: Refinement, points: _Points | None, level: int) -> _VisibilityMesh:
        """At a subdivision level."""
        if not level:
            return cls(surface.faces, None, None if points is None else points.carrier.linear[points.used])
        subdivision = SubdividedMesh.of(surface.faces, len(surface.rest), level)
        held = None if points is None else subdivision.to(points.carrier, surface.faces)[points.used]
        return cls(subdivision.faces, subdivision.to(fine, surface.faces), held)


@dataclass(frozen=True, slots=True)
class _Selection:
    """One view's echoes, which are some of the model's."""

    view: View
    pair: Pair
    echoes: np.ndarray
    """Their numbers (N,): patches first, then diffuse points."""
    patches: int
    first: int
    """Column of the first one."""

    def cut(self, most: int) -> list[_Selection]:
        """The same in pieces of at most that many echoes; the diffuse points stay together."""
        if len(self.echoes) <= most:
            return [self]
        patches, points = np.split(self.echoes, [self.patches])
        pieces = [
            replace(self, echoes=some, patches=len(some)) for some in np.split(patches, range(most, len(patches), most))
        ]
        return [*pieces, replace(self, echoes=points, patches=0)] if len(points) else pieces

    def with_ends(self, radar: Radar, found: EchoArrays, places: np.ndarray) -> EchoArrays:
        """The view's own of all echoes found, as arrays and patterns see them from their `places` (T, all of the model's, 3)."""
        columns = slice(self.first, self.first + len(self.echoes))
        mine = found._replace(**{name: getattr(found, name)[:, columns] for name in ("delay_s", "amplitude", "slope")})
        places = places[:, self.echoes]
        paths = self.view.paths
        return seen_by(radar, mine, places, places) if paths is None else unfolded(radar, mine, paths, places, places)


@dataclass(frozen=True, slots=True)
class _Facing:
    """Normals and centroids of the cage's faces at a few instants."""

    normal: np.ndarray
    """(K, F, 3)."""
    middle: np.ndarray
    """(K, F, 3) m."""

    @classmethod
    def of(cls, cage: np.ndarray, faces: np.ndarray) -> _Facing:
        return cls(normals(cage, faces), cage[:, faces].mean(axis=2))


@dataclass(frozen=True, slots=True)
class _Posed:
    """A model at some frames: what all views have in common."""

    model: _Model
    cage: np.ndarray
    """(T, V, 3) m."""
    origin: np.ndarray
    """What `local` counts from (T, 3) m."""
    centre: np.ndarray
    """The patches' reference points, (G, T, 3) m."""
    centres: Any
    """The same on the device, flat Float64."""
    carrier: Any
    """Vertices that hold the diffuse points, flat Float64 (Vp, T, 3) m on the device."""
    facing: _Facing
    backend: Backend
    _whole: list[Any] = field(default_factory=list)

    @classmethod
    def of(cls, model: _Model, cage: np.ndarray, backend: Backend) -> _Posed:
        centre = _carried(model.centre, cage)
        carrier = None if model.points is None else _on_device(_carried(model.points.operator, cage), backend.Float64)
        instants = np.unique(np.linspace(0, len(cage) - 1, math.ceil((len(cage) - 1) / PROBE_EVERY) + 1).astype(int))
        facing = _Facing.of(cage[instants], model.cage_faces)
        return cls(
            model, cage, cage.mean(axis=1), centre, _on_device(centre, backend.Float64), carrier, facing, backend
        )

    def local(self, visibility: np.ndarray | None) -> np.ndarray:
        """Cage vertices relative to the origin and their visibility, float32 (T, V, 4)."""
        # Positions within the body need no more than float32: 1e-7 of its size.
        values = np.ones((*self.cage.shape[:2], 4), np.float32)
        values[..., :3] = self.cage - self.origin[:, None]
        if visibility is not None:
            values[..., 3] = visibility
        return values

    @property
    def vertices(self) -> Any:
        """The facets' vertices where all are visible, flat Float32 (Vf, T, 4) on the device."""
        if not self._whole:
            self._whole.append(_on_device(_carried(self.model.operator, self.local(None)), self.backend.Float32))
        return self._whole[0]


def _refinements(
    surface: MovingMesh, wavenumber: float, range_m: float, sagittas_rad: list[Sagitta], max_facets: int
) -> list[Refinement]:
    """`refinements` of a mesh, kept for the next recording of the same body."""
    arrays = [surface.rest, surface.faces, *(np.asarray(sagitta, float) for sagitta in sagittas_rad)]
    key = (*(part.tobytes() for part in arrays), wavenumber, range_m, surface.crease_deg)
    if key not in _kept:
        _kept[key] = refinements(
            surface.rest,
            surface.faces,
            wavenumber=wavenumber,
            range_m=range_m,
            sagittas_rad=sagittas_rad,
            crease_deg=surface.crease_deg,
            max_faces=max_facets,
        )
        while len(_kept) > 1 and sum(len(each.faces) for found in _kept.values() for each in found) > KEPT_FACETS:
            _kept.popitem(last=False)
    _kept.move_to_end(key)
    return _kept[key]


@dataclass(frozen=True, slots=True)
class _Points:
    """Diffuse points on the triangles that hold them."""

    carrier: Refinement
    used: np.ndarray
    """Numbers of its vertices that hold points, (Vp,)."""
    operator: Csr
    """Sparse: these from the cage's vertices, (Vp, V)."""
    corners: np.ndarray
    barycentric: np.ndarray
    area_m2: np.ndarray
    phase_rad: np.ndarray
    scattered: float

    @classmethod
    def spread(cls, surface: MovingMesh, carrier: Refinement, seed: int, scattered: float, count: int) -> _Points:
        rest = carrier.operator @ surface.rest
        area = 0.5 * float(np.linalg.norm(edge_cross(rest[carrier.faces]), axis=1).sum())
        points = surface_points(rest, carrier.faces, seed=seed, spacing_m=point_spacing(area, count))
        used, corners = np.unique(carrier.faces[points.face], return_inverse=True)
        return cls(
            carrier, used, carrier.operator[used], corners.reshape(-1, 3), points.barycentric, points.area_m2,
            points.phase_rad, scattered,
        )  # fmt: skip

    def places(self, cage: np.ndarray) -> np.ndarray:
        """Where the points stand (Q, K, 3), for cage vertices (K, V, 3)."""
        vertices = _carried(self.operator, cage)
        return sum(vertices[self.corners[:, i]] * self.barycentric[:, i, None, None] for i in range(3))

    def fraction(
        self,
        visibility: np.ndarray | None,
        visibility_mesh: _VisibilityMesh,
        facet_visibility: VertexVisibility | None,
        cage: np.ndarray,
    ) -> np.ndarray | None:
        """Visibility of the carrier's vertices (Vp, T, 1); None: all are visible."""
        sampled = None if visibility is None else _carried(visibility_mesh.points, visibility[..., None])
        if facet_visibility is None:
            return sampled
        found = _sampled_visibility(facet_visibility, _carried(self.operator, cage), self.corners)[..., None]
        return found if sampled is None else sampled * found

    def put(
        self,
        block: Block,
        vertices: Any,
        fraction: np.ndarray | None,
        pair: Pair,
        weights: Weights | None,
        first: int,
        columns: np.ndarray,
        backend: Backend,
    ) -> None:
        """Writes the points' echoes; `vertices` are the carrier's, flat Float64 (Vp, T, 3) m, of which a `fraction` is visible."""
        diffuse_echoes(
            vertices, self.corners, self.barycentric, self.area_m2, self.phase_rad, fraction, pair, self.scattered, weights,
            first, block, columns, backend,
        )  # fmt: skip


def _sampled_visibility(facet_visibility: VertexVisibility, vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Visibility of vertices (Vf, K, 3) m of triangles `corners` (F, 3): (Vf, K) float32."""
    return facet_visibility(np.ascontiguousarray(vertices.swapaxes(0, 1)), corners).T


def _carried(operator: Csr, values: np.ndarray) -> np.ndarray:
    """Applies a sparse (Vf, V) to values (K, V, C) of the cage: (Vf, K, C), in memory as `aligned` has it."""
    shape = operator.shape[0], len(values), values.shape[2]
    out = aligned_empty(math.prod(shape), values.dtype).reshape(shape)

    def carry(start: int) -> None:
        part = values[start : start + FRAMES_AT_ONCE].transpose(1, 0, 2)
        product = operator @ np.ascontiguousarray(part).reshape(len(part), -1)
        out[:, start : start + FRAMES_AT_ONCE] = product.reshape(len(out), *part.shape[1:])

    with ThreadPoolExecutor(os.cpu_count()) as pool:  # a sparse product leaves Python's lock alone
        list(pool.map(carry, range(0, len(values), FRAMES_AT_ONCE)))
    return out


def _on_device(values: np.ndarray, kind: Any) -> Any:
    return kind(values.ravel())


def check_outside(surface: MovingMesh, radar: Radar, times_s: np.ndarray) -> None:
    """Refuses a radar inside a closed mesh, or touching a mesh, at any of a few instants of the record."""
    for times in blocks(np.linspace(times_s[0], times_s[-1], 25), len(surface.rest)):
        _check_outside(surface, radar, times)


def _check_outside(surface: MovingMesh, radar: Radar, times: np.ndarray) -> None:
    vertices = surface.at(times)
    for antenna in (radar.tx_position_m, radar.rx_position_m):
        within = np.all((vertices.min(axis=1) < antenna) & (antenna < vertices.max(axis=1)), axis=1)
        inside = np.zeros(len(times), bool)
        inside[within] = np.abs(winding(vertices[within][:, surface.faces] - antenna)) > 0.5
        touches = np.linalg.norm(vertices - antenna, axis=2).min(axis=1) < 1e-3
        if inside.any() or touches.any():
            where = ", ".join(f"{x:.3g}" for x in antenna)
            instant = times[np.argmax(inside if inside.any() else touches)]
            raise InputError(
                f"the radar at ({where}) m {'is inside' if inside.any() else 'touches'} {surface.name} at {instant:.3g} s; place "
                "the target farther away (distance_m) or move the radar"
            )
