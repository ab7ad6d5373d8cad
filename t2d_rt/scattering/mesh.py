"""Echoes of a moving mesh: closed-form facets for the coherent part, points fixed on the surface for the diffuse part."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from typing_extensions import override

from t2d_rt.core.backend import Backend
from t2d_rt.core.memory import SAMPLE_BYTES, VISIBILITY_BYTES
from t2d_rt.geometry import Refinement
from t2d_rt.geometry.vectors import cross, dot
from t2d_rt.scattering.antennas import concatenated, seen_by
from t2d_rt.scattering.facets import FacetVertices, PointVertices, patch_delays, patch_echoes
from t2d_rt.scattering.lanes import EchoBlock
from t2d_rt.scattering.patches import (
    CYCLES_PER_STEP,
    SWEEP_CYCLES,
    Csr,
    PairPlaces,
    Patches,
    centres,
    least_range_m,
    patches,
    tilts,
)
from t2d_rt.scattering.paths import (
    Anchors,
    ArrivingFields,
    PathVisibility,
    anchor_vertices,
    faded_weights,
    product,
    unfolded,
)
from t2d_rt.scattering.points import DiffusePoints, SampledVisibility, VisibilityMesh, sampled_visibility
from t2d_rt.scattering.refinement import MOST_FACETS, POINT_SAGITTA_RAD, Sagitta, apply_operator, refined
from t2d_rt.scattering.streams import joined, most_echoes
from t2d_rt.types import ByPart, EchoArrays, Ellipsoids, Material, MovingMesh, Radar
from t2d_rt.types.material import is_rough, values_of
from t2d_rt.types.scatterer import EchoLabels, Fraction, FrameBlock, Poses, Scatterer, Visibility

POINTS_PER_MESH = 4_000
"""Least number of diffuse points, approximately; their number does not change the power."""
FACING_RATE_HZ, FACING_AT_ONCE, FACING_MOST_HZ = 10.0, 20, 200.0
"""Rate [Hz] at which faces are tested for whether they ever face an image of an antenna, and how many instants at once; a target
whose surface rate exceeds the last number [Hz] rotates too fast for that."""
BEND_RAD = 0.2
"""Angle [rad] by which a joint that bends may tilt facets against the face they lie in, beyond their tilt at rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Detail:
    """How finely a mesh is modelled over the path pairs of one tier."""

    sagitta_rad: Sagitta
    """Phase sagitta of the facets, which sets their size (physics.md, eq. 5)."""
    cycles_per_step: float = CYCLES_PER_STEP
    """Greatest change of phase between two facets of a patch from frame to frame [cycles]; infinite at unrelated instants."""
    sweep_cycles: float = SWEEP_CYCLES
    """Greatest change of that phase over the sweep [cycles]."""
    points: int = POINTS_PER_MESH
    """Least number of diffuse points."""
    max_facets: int = MOST_FACETS
    """Greatest number of facets; a mesh that needs more is refused."""
    span_s: tuple[float, float] | None = None
    """First and last time [s] between which the nearest range sets how fine facets are; by default those of the surface frames."""


def mesh_echoes(
    surface: MovingMesh,
    radar: Radar,
    *,
    times_s: np.ndarray,
    material: Material | ByPart,
    detail: Detail,
    seed: int,
    views: Sequence[PathVisibility],
    backend: Backend,
    target: int = 0,
) -> Scatterer:
    """Echoes of `surface` at surface frames `times_s` (T,) [s], one for each patch in each of `views` whose antennas it may face;
    `target` is its number among the targets. Raises InputError if it needs more than `detail.max_facets` facets."""
    pairs = [PairPlaces.of(radar, view.paths) for view in views]
    model = _Model.of(surface, radar, pairs, times_s, material, detail, seed, {view.subdivision for view in views})
    selections = list(model.selections(surface, times_s, pairs, views))
    anchors = None
    if any(view.paths is not None for view in views):
        rest = model.fine.controlled(surface.rest[None])
        places = apply_operator(model.centre, rest)[:, 0]
        anchors = Anchors.of(anchor_vertices(surface.rest), surface.rest, places, backend)
    return joined(
        [
            MeshScatterer(
                times_s=times_s,
                target=target,
                surface=surface,
                radar=radar,
                model=model,
                selections=tuple(part),
                anchors=anchors,
                backend=backend,
                vertices=model.operator.shape[0],
                echoes=_total(part),
                at_once=_frames_at_once(views),
            )
            for part in _parts(selections, most_echoes(radar))
        ]
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshScatterer(Scatterer):
    """Patches of a mesh, which return one echo each over each of some path pairs."""

    target: int
    surface: MovingMesh
    radar: Radar
    model: _Model
    selections: tuple[_Selection, ...]
    anchors: Anchors | None
    """Where the fields of the path pairs are worked out; None in free space."""
    backend: Backend

    @property
    @override
    def targets(self) -> Mapping[int, MovingMesh | Ellipsoids]:
        return {self.target: self.surface}

    @property
    @override
    def fractions(self) -> Iterable[Fraction]:
        return (fraction for selection in self.selections for fraction in selection.view.fractions)

    @property
    @override
    def labels(self) -> EchoLabels:
        patches = self.model.patches
        face = patches.base_face[patches.starts[:-1]]
        return EchoLabels.joined(
            EchoLabels.of(len(part.patches), target=self.target, face=face[part.patches], path=part.view.name)
            for part in self.selections
        )

    @override
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        model, anchors, radar, times_s = self.model, self.anchors, self.radar, block.times_s
        cage = poses[self.target]
        posed = model.posed(cage, self.backend)
        echo_block = EchoBlock(len(times_s), self.echoes, self.backend)
        weights: Iterable[tuple[np.ndarray, np.ndarray] | None] = [None] * len(self.selections)
        if anchors is not None:
            weights = zip(*self._weights(anchors, block, cage[:, anchors.vertices]), strict=True)
        lit = [model.lit_faces(posed, selection.pair.at(times_s[posed.instants])) for selection in self.selections]
        traced = any(selection.view.facet_visibility is not None for selection in self.selections)
        facets = Facets.of(posed, model.operator, model.visibility_meshes, np.any(lit, axis=0), with_places=traced)
        for selection, faces, weight in zip(self.selections, lit, weights, strict=True):
            of_view = _seen(selection.view, times_s, seen, anchors, weight, self.backend)
            model.put(echo_block, facets, replace(selection, pair=selection.pair.at(times_s)), of_view, faces)
        echoes = echo_block.arrays()
        if not (radar.is_array or radar.directional):
            return echoes
        places = posed.centre.swapaxes(0, 1)
        return concatenated([selection.with_ends(radar, echoes, times_s, places) for selection in self.selections])

    def _weights(self, anchors: Anchors, block: FrameBlock, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights of all selections' path pairs at the anchors (T, A, 3) [m]: `faded_weights`, or exact ones at instants."""
        pairs = [selection.view.paths for selection in self.selections if selection.view.paths is not None]
        if self.model.at_instants:
            return ArrivingFields.of(self.radar, pairs, points_m, block.times_s).weights()
        return faded_weights(
            self.radar, pairs, block, points_m, lambda times_s: self.surface.at(times_s)[:, anchors.vertices]
        )


def coherent_reflection(material: Material, frequency_hz: float) -> complex:
    """Reflection coefficient Gamma times the fraction sqrt(1 - S^2) of the field that stays coherent (eq. 9)."""
    return material.reflection(frequency_hz) * math.sqrt(1 - material.scattering_coefficient**2)


def diffuse_reflection(material: Material, frequency_hz: float) -> float:
    """S |Gamma|, S the scattering coefficient (eq. 9)."""
    return material.scattering_coefficient * abs(material.reflection(frequency_hz))


def _frames_at_once(views: Sequence[PathVisibility]) -> int:
    """Number of frames whose visibility, over the one-way paths of all views, fits memory."""
    points = {
        path.key: view.points for view in views if view.paths is not None for path in (view.paths.out, view.paths.back)
    }
    return max(1, int(VISIBILITY_BYTES // max(1, SAMPLE_BYTES * sum(points.values()))))


def _seen(
    view: PathVisibility,
    times_s: np.ndarray,
    fractions: Visibility,
    anchors: Anchors | None,
    weight: tuple[np.ndarray, np.ndarray] | None,
    backend: Backend,
) -> SampledVisibility:
    """How a mesh is seen in a view at times (T,) [s]."""
    weights = None
    if weight is not None and anchors is not None:
        unblocked = product([fractions[fraction] for fraction in view.unblocked])
        weights = anchors.weights(*weight, unblocked, backend)
    return SampledVisibility(
        visibility={fraction: fractions[fraction] for fraction in view.visibility},
        facet_visibility=None if view.facet_visibility is None else partial(view.facet_visibility, times_s),
        weights=weights,
    )


def _total(selections: Sequence[_Selection]) -> int:
    return sum(len(selection.patches) for selection in selections)


def _parts(selections: Sequence[_Selection], most: int) -> Iterator[list[_Selection]]:
    """Selections in parts of at most `most` echoes, each part's columns counted from 0; a selection that is larger is cut."""
    part: list[_Selection] = []
    for selection in (piece for whole in selections for piece in whole.cut(most)):
        if part and _total(part) + len(selection.patches) > most:
            yield part
            part = []
        part.append(replace(selection, first=_total(part)))
    yield part


@dataclass(frozen=True, slots=True)
class _Model:
    """What stays the same from frame to frame: facets, patches, diffuse points and their reflection."""

    cage_faces: np.ndarray
    tilt_rad: np.ndarray
    """Largest angle at rest between a cage face and its facets [rad], (cage faces,)."""
    operator: Csr
    """Sparse float32 matrix (Vf, V) that gives the facets' vertices from the control points."""
    fine: Refinement
    patches: Patches
    centre: Csr
    """Sparse matrix (G, V) that gives the patches' reference points from the control points."""
    reflection: np.ndarray
    """Gamma of each patch times the fraction that stays coherent, complex (G,)."""
    points: DiffusePoints | None
    visibility_meshes: dict[int, VisibilityMesh]
    """Meshes at whose vertices visibility is sampled, by subdivision level."""
    at_instants: bool
    """Whether frames are instants unrelated to one another."""

    @classmethod
    def of(
        cls,
        surface: MovingMesh,
        radar: Radar,
        pairs: Sequence[PairPlaces],
        times_s: np.ndarray,
        material: Material | ByPart,
        detail: Detail,
        seed: int,
        subdivisions: set[int],
    ) -> _Model:
        sagittas = [detail.sagitta_rad, POINT_SAGITTA_RAD] if is_rough(material) else [detail.sagitta_rad]
        part = material.part if isinstance(material, ByPart) else np.zeros(len(surface.faces), np.int32)
        span_s = times_s if detail.span_s is None else np.array(detail.span_s)
        wavenumber, range_m = 2 * math.pi / radar.wavelength_m, least_range_m(surface, pairs, span_s)
        fine, *carriers = refined(surface, wavenumber, range_m, sagittas, detail.max_facets)
        parts = patches(
            surface,
            fine,
            radar,
            times_s,
            pairs=pairs,
            cycles_per_step=detail.cycles_per_step,
            sweep_cycles=detail.sweep_cycles,
            part=part if isinstance(material, ByPart) else None,
        )
        first, faces = parts.base_face[parts.starts[:-1]], len(surface.faces)
        coherent, scattered = (
            values_of(material, faces, partial(of, frequency_hz=radar.mid_frequency_hz))[first]
            for of in (coherent_reflection, diffuse_reflection)
        )
        points = None
        if carriers and detail.points:
            points = DiffusePoints.spread(
                surface,
                carriers[0],
                patch_facets=fine.at(surface.rest)[parts.corners],
                starts=parts.starts,
                parts=(part[parts.base_face], part[carriers[0].base_face]),
                seed=seed,
                scattered=scattered,
                count=detail.points,
            )
        visibility_meshes = {level: VisibilityMesh.of(surface, fine, points, level) for level in subdivisions}
        return cls(
            cage_faces=surface.faces,
            tilt_rad=tilts(surface, fine),
            operator=fine.operator.astype(np.float32),
            fine=fine,
            patches=parts,
            centre=centres(parts, fine),
            reflection=coherent,
            points=points,
            visibility_meshes=visibility_meshes,
            at_instants=math.isinf(detail.cycles_per_step),
        )

    def selections(
        self, surface: MovingMesh, times_s: np.ndarray, pairs: Sequence[PairPlaces], views: Sequence[PathVisibility]
    ) -> Iterator[_Selection]:
        """Each view with the patches that may ever face both of its antennas; in free space there is one view, with all."""
        lit = np.zeros((len(pairs), len(self.cage_faces)), bool)
        if self.at_instants or (len(times_s) - 1) / (times_s[-1] - times_s[0]) > FACING_MOST_HZ:
            lit[:] = True
        probes = np.linspace(times_s[0], times_s[-1], max(2, math.ceil((times_s[-1] - times_s[0]) * FACING_RATE_HZ)))
        in_room = [view.paths is not None for view in views]
        for first in range(0, len(probes) - 1 if any(in_room) and not lit.all() else 0, FACING_AT_ONCE):
            instants_s = probes[first : first + FACING_AT_ONCE + 1]
            facing = Facing.of(surface.at(instants_s), self.cage_faces)
            for number, pair in enumerate(pairs):
                lit[number] |= facing.lit(pair.at(instants_s), self.tilt_rad)
        lit[~np.array(in_room)] = True
        first = 0
        for pair, view, facing_faces in zip(pairs, views, lit, strict=True):
            chosen = np.flatnonzero(self.patches.any_of(facing_faces))
            yield _Selection(view, pair, chosen, first)
            first += len(chosen)

    def posed(self, cage: np.ndarray, backend: Backend) -> PosedMesh:
        """The mesh at frames at which its cage has the vertices (T, V, 3) [m]."""
        control = self.fine.controlled(cage)
        return PosedMesh.of(control, self.cage_faces, self.centre, self.patches, self.points, backend)

    def put(
        self, block: EchoBlock, facets: Facets, selection: _Selection, seen: SampledVisibility, faces: np.ndarray
    ) -> None:
        """Writes the echoes of one view to its columns; `faces` are those of `lit_faces`."""
        pair, chosen, posed, level = selection.pair, selection.patches, facets.posed, selection.view.subdivision
        columns = selection.first + np.arange(len(chosen))
        if len(chosen):
            patch_delays(posed.centres, chosen, pair, block, columns)
        lit = self._lit(faces, seen, self.visibility_meshes[level])[chosen]
        if lit.any():
            chosen = chosen[lit]
            parts = self.patches.only(chosen)
            vertices = FacetVertices(
                vertices=facets.vertices,
                visibility=facets.visibility(seen, level),
                corners=facets.corner_numbers[parts.corners],
                centres=posed.centres,
                origin=posed.origin,
                points=self._points(chosen, facets, seen, level),
            )
            parts = replace(parts, nodes=facets.numbers[parts.nodes])
            gamma = self.reflection[chosen]
            patch_echoes(vertices, parts, chosen, pair, gamma, seen.weights, block, columns[lit])

    def lit_faces(self, posed: PosedMesh, pair: PairPlaces) -> np.ndarray:
        """Which cage faces may hold facets that face both antennas at any of the frames, bool (F,)."""
        return np.ones(len(self.cage_faces), bool) if self.at_instants else posed.facing.lit(pair, self.tilt_rad)

    def _lit(self, faces: np.ndarray, seen: SampledVisibility, mesh: VisibilityMesh) -> np.ndarray:
        """Which patches, bool (G,), hold visible facets of the cage faces `faces`, bool (F,)."""
        if seen.visibility:
            somewhere = np.logical_and.reduce([visibility > 0 for visibility in seen.visibility.values()]).any(axis=0)
            faces = faces & self._with_neighbours(mesh, np.asarray(somewhere))
        lit = self.patches.any_of(faces)
        return lit if seen.weights is None else lit & seen.weights.reach

    def _points(self, patches: np.ndarray, facets: Facets, seen: SampledVisibility, level: int) -> PointVertices | None:
        """The diffuse points of some patches, on the device; None where these patches have none, as small ones may."""
        points = None if self.points is None else self.points.only(patches)
        if points is None or not len(points.packets):
            return None
        return PointVertices(
            vertices=facets.posed.carrier,
            visibility=facets.visibility_of_points(seen, level),
            corners=points.corners,
            packets=points.packets,
            starts=points.starts,
            scattered=points.scattered,
        )

    def _with_neighbours(self, visibility_mesh: VisibilityMesh, visibility: np.ndarray) -> np.ndarray:
        """Cage faces, bool (F,), whose facets' vertices depend on any visible vertex of the visibility mesh, bool (V',): its own
        faces and their neighbours."""
        wider = np.zeros(self.operator.shape[1], bool)
        wider[self.cage_faces[visibility[visibility_mesh.faces].reshape(len(self.cage_faces), -1).any(axis=1)]] = True
        return np.asarray(wider[self.cage_faces].any(axis=1))


@dataclass(frozen=True, slots=True)
class _Selection:
    """The echoes of one view, those of some of the model's patches."""

    view: PathVisibility
    pair: PairPlaces
    patches: np.ndarray
    """Numbers of these patches, (N,)."""
    first: int
    """Column of the first of these echoes."""

    def cut(self, most: int) -> list[_Selection]:
        """The selection in pieces of at most `most` echoes."""
        return [replace(self, patches=piece) for piece in np.split(self.patches, range(most, len(self.patches), most))]

    def with_ends(self, radar: Radar, echoes: EchoArrays, times_s: np.ndarray, places: np.ndarray) -> EchoArrays:
        """The view's own among all echoes at times (T,) [s], as antennas see them, with the places (T, G, 3) [m] of all patches."""
        columns = slice(self.first, self.first + len(self.patches))
        own = echoes._replace(**{name: getattr(echoes, name)[:, columns] for name in ("delay_s", "amplitude", "slope")})
        places = places[:, self.patches]
        paths = self.view.paths
        return seen_by(radar, own, places) if paths is None else unfolded(radar, own, paths, times_s, places)


PROBE_EVERY = 6
"""Number of frames from one test of which faces face the antennas to the next."""


@dataclass(frozen=True, slots=True)
class Facing:
    """Which faces of a mesh face both antennas of a path pair: normals and centroids of the cage's faces at a few instants."""

    normal: np.ndarray
    """Unit normals, components first, (3, F, K)."""
    middle: np.ndarray
    """Centroids [m], components first, (3, F, K)."""
    _angles: dict[bytes, np.ndarray] = field(default_factory=dict)
    """Angles found so far, by the place they are to: path pairs have images of the antennas in common."""

    @classmethod
    def of(cls, cage: np.ndarray, faces: np.ndarray) -> Facing:
        """Facing of a cage with vertices (K, V, 3) [m] and faces (F, 3)."""
        rows = np.ascontiguousarray(cage.T)  # reading whole rows of instants takes a third of the time
        a, b, c = (rows.take(faces[:, i], axis=1) for i in range(3))
        across = np.stack(cross(b - a, c - a))
        return cls(across / np.maximum(np.sqrt(dot(across, across)), 1e-30), (a + b + c) / 3)

    def lit(self, pair: PairPlaces, tilt_rad: np.ndarray) -> np.ndarray:
        """Faces, bool (F,), that may hold facets lit by the transmitter and visible to the receiver at or between the instants;
        their facets are tilted against them by up to `tilt_rad` (F,)."""
        angle = np.maximum(self._angle(pair.views_m[0]), self._angle(pair.views_m[-1]))
        # What rotates from one instant to the next may rotate as much again in between.
        margin = tilt_rad + BEND_RAD + np.abs(np.diff(angle, axis=1)).max(axis=1, initial=0)
        return angle.min(axis=1) < math.pi / 2 + margin

    def _angle(self, place_m: np.ndarray) -> np.ndarray:
        """Angles [rad] (F, K) between the normals and the lines of sight to a place (3,) or (K, 3) [m]."""
        key = place_m.tobytes()
        if key not in self._angles:
            line_of_sight = place_m.reshape(-1, 3).T[:, None] - self.middle
            cosine = dot(self.normal, line_of_sight) / np.sqrt(dot(line_of_sight, line_of_sight))
            self._angles[key] = np.arccos(np.clip(cosine, -1, 1))
        return self._angles[key]


@dataclass(frozen=True)
class PosedMesh:
    """A mesh at some frames: what all views have in common."""

    patches: Patches
    points: DiffusePoints | None
    cage: np.ndarray
    """Control points [m], (T, V, 3)."""
    origin: np.ndarray
    """Origin of the vertices' positions [m], (T, 3)."""
    centre: np.ndarray
    """The patches' reference points [m], (G, T, 3)."""
    centres: Any
    """These reference points on the device, flat Float64."""
    facing: Facing
    instants: np.ndarray
    """Numbers of the frames at which `facing` is known."""
    backend: Backend

    @classmethod
    def of(
        cls,
        cage: np.ndarray,
        faces: np.ndarray,
        centre: Csr,
        patches: Patches,
        points: DiffusePoints | None,
        backend: Backend,
    ) -> PosedMesh:
        """The mesh with control points (T, V, 3) [m] and faces (F, 3); the sparse `centre` (G, V) gives its reference points."""
        centres = apply_operator(centre, cage)
        instants = np.unique(np.linspace(0, len(cage) - 1, math.ceil((len(cage) - 1) / PROBE_EVERY) + 1).astype(int))
        facing = Facing.of(cage[instants], faces)
        flat = backend.Float64(centres.ravel())
        return cls(patches, points, cage, cage.mean(axis=1), centres, flat, facing, instants, backend)

    @cached_property
    def local(self) -> np.ndarray:
        """Control points [m] relative to the origin, and 1, float32 (T, V, 4)."""
        # Positions within the body need no more than float32: 1e-7 of its size.
        frames, count, _ = self.cage.shape
        values = np.ones((count, frames, 4), np.float32).swapaxes(0, 1)  # in memory as `apply_operator` reads them
        np.subtract(self.cage, self.origin[:, None], out=values[..., :3], casting="same_kind")
        return values

    @cached_property
    def carrier(self) -> Any:
        """Vertices that hold diffuse points, flat Float32 (Vp, T, 4) on the device: position [m] relative to the origin, and 1."""
        assert self.points is not None
        return self.backend.Float32(apply_operator(self.points.operator, self.local).ravel())


@dataclass(frozen=True)
class Facets:
    """The facets of those patches of a posed mesh that have facets in some cage faces, with their vertices."""

    posed: PosedMesh
    meshes: Mapping[int, VisibilityMesh]
    """The meshes at whose vertices visibility is known, by subdivision level."""
    vertices: Any
    """Vertices of these facets, flat Float32 (V, T, 4) on the device: position [m] relative to the origin, and 1."""
    places: np.ndarray | None
    """Positions [m] of those that are corners, (Vc, T, 3), where visibility is traced from there; else None."""
    corners: np.ndarray
    """Which vertices of the whole mesh's facets are corners of these facets, bool (Vf,)."""
    numbers: np.ndarray
    """Number among `vertices` of each vertex of the whole mesh's facets, (Vf,)."""
    corner_numbers: np.ndarray
    """Number among the corners of these facets of each vertex of the whole mesh's facets, (Vf,)."""
    _known: dict[Any, Any] = field(default_factory=dict)
    """Operators and visibilities that path pairs with a one-way path in common share."""

    @classmethod
    def of(
        cls,
        posed: PosedMesh,
        operator: Csr,
        meshes: Mapping[int, VisibilityMesh],
        faces: np.ndarray,
        *,
        with_places: bool,
    ) -> Facets:
        """Facets of cage faces, bool (F,); the sparse `operator` (Vf, V) gives all facets' vertices from the control points."""
        used, corners = np.zeros((2, operator.shape[0]), bool)
        facets = np.repeat(posed.patches.any_of(faces) | with_places, np.diff(posed.patches.starts))
        used[posed.patches.nodes[facets]] = corners[posed.patches.corners[facets]] = True
        values = apply_operator(operator[used], posed.local)
        return cls(
            posed=posed,
            meshes=meshes,
            vertices=posed.backend.Float32(values.ravel()),
            places=values[corners[used], :, :3] + posed.origin if with_places else None,
            corners=corners,
            numbers=np.cumsum(used) - 1,
            corner_numbers=np.cumsum(corners) - 1,
        )

    def visibility(self, seen: SampledVisibility, level: int) -> Any:
        """Visibility of the corners, flat Float32 (Vc, T) on the device; None: all are visible."""
        visibilities = self._over_paths("corners", seen, level)
        if seen.facet_visibility is not None and self.places is not None:
            triangles = self.corner_numbers[self.posed.patches.corners]
            sampled = sampled_visibility(seen.facet_visibility, self.places, triangles)
            visibilities.append(self.posed.backend.lanes(sampled, self.posed.backend.Float32))
        return _product(visibilities)

    def visibility_of_points(self, seen: SampledVisibility, level: int) -> Any:
        """Visibility of the vertices that hold diffuse points, flat Float32 (Vp, T) on the device; None: all are visible."""
        visibilities = self._over_paths("points", seen, level)
        if seen.facet_visibility is not None:
            assert self.posed.points is not None
            sampled = self.posed.points.facet_visibility(seen.facet_visibility, self.posed.cage)
            visibilities.append(self.posed.backend.lanes(sampled, self.posed.backend.Float32))
        return _product(visibilities)

    def _over_paths(self, what: Literal["corners", "points"], seen: SampledVisibility, level: int) -> list[Any]:
        """Visibility over each one-way path, interpolated from the vertices of the visibility mesh of that level."""
        known, visibilities = self._known, []
        for fraction, values in seen.visibility.items():
            if (what, level) not in known:
                mesh = self.meshes[level]
                known[what, level] = mesh.facets[self.corners] if what == "corners" else mesh.points
            if (what, level, fraction) not in known:
                out = apply_operator(known[what, level], np.asarray(values, np.float32)[..., None])
                known[what, level, fraction] = self.posed.backend.Float32(out.ravel())
            visibilities.append(known[what, level, fraction])
        return visibilities


def _product(fields: Sequence[Any]) -> Any:
    """Product of arrays on the device; None if there are none."""
    if not fields:
        return None
    return fields[0] if len(fields) == 1 else math.prod(fields[1:], start=fields[0])
