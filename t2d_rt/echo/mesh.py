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
from t2d_rt.echo.antennas import seen_by, side_by_side
from t2d_rt.echo.facets import Block, Pair, Weights, diffuse_echoes, patch_delays, patch_echoes
from t2d_rt.echo.legs import Anchors, Arrivals, View, anchor_vertices, unfolded
from t2d_rt.echo.patches import (
    SWEEP_TURNS,
    TURNS_PER_STEP,
    Csr,
    Ends,
    Patches,
    centres,
    least_range_m,
    normals,
    patches,
    tilts,
)
from t2d_rt.echo.streams import in_parts, most_echoes
from t2d_rt.errors import InputError
from t2d_rt.geometry import Halved, Refinement, point_spacing, refinements, surface_points, winding
from t2d_rt.geometry.vectors import edge_cross
from t2d_rt.memory import blocks
from t2d_rt.types import EchoArrays, EchoStream, Material, MovingMesh, Radar

# Diffuse points lie on a refinement of their own fixed fineness, so that they do not depend on the facets' size: a point is off
# the curved surface by a tenth of this phase or so, always the same.
POINT_SAGITTA_RAD = 0.7
POINTS_PER_MESH = 4_000
"""At least about this many diffuse points; their number does not change the power."""
FACING_RATE_HZ, FACING_AT_ONCE, FACING_MOST_HZ = 10.0, 20, 200.0
"""How often it is looked at which faces ever face an image of an antenna; what needs more surface frames than the last turns too
fast for that."""
PROBE_EVERY = 6
"""Frames between looks at which faces face the antennas."""
BEND_RAD = 0.2
"""By how much more than at rest facets may be tilted against the face they lie in, where a joint bends."""
KEPT_FACETS = 800_000
"""Refinements are kept, the last used ones, for as many facets: some 300 bytes each."""
REFINING_BYTES = 1_700
"""What a facet takes while it is made (measured with 110 000 to 1 000 000 facets of a body)."""
MOST_FACETS = 1_000_000
"""Of one mesh, unless a run may take more memory."""
FRAMES_AT_ONCE = 20
"""The cage's positions at that many moments fit the cache."""
_kept: OrderedDict[tuple[object, ...], list[Refinement]] = OrderedDict()
Looked = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Share (K, Q) that is seen of vertices (K, Q, 3) of triangles (F, 3)."""
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
    sweep_turns: float = SWEEP_TURNS,
    max_facets: int = MOST_FACETS,
) -> EchoStream:
    """Echoes of `surface` at surface frames `times_s`: one of each patch and of each diffuse point, in each of `views`.

    `sagitta_rad` sets the facets' size (physics.md, eq. 5), `turns_per_step` and `sweep_turns` that of patches, `points` how many
    diffuse ones there are at least; more than `max_facets` facets are refused.
    """
    pairs = [Pair.of(radar, view.legs) for view in views]
    ends = [(pair.places_m[0], pair.places_m[-1]) for pair in pairs]
    halved = {view.halved for view in views}
    model = _Model.of(
        surface,
        radar,
        ends,
        times_s,
        material,
        sagitta_rad,
        seed,
        turns_per_step,
        sweep_turns,
        points,
        halved,
        max_facets,
    )
    looks = list(model.looks(surface, times_s, pairs, views))
    anchors = None
    if any(view.legs is not None for view in views):
        rest = surface.rest[None]
        places = model.places(rest, _carried(model.centre, rest))[0]
        anchors = Anchors.of(anchor_vertices(surface.rest), surface.rest, places, backend)

    def frames(looks: Sequence[_Look], start: int, stop: int) -> EchoArrays:
        times = times_s[start:stop]
        cage = surface.at(times)
        posed = _Posed.of(model, cage, backend)
        block = Block(len(times), _total(looks), backend)
        arrivals = None if anchors is None else Arrivals(radar, cage[:, anchors.vertices])
        for look in looks:
            view, weights = look.view, None
            if view.legs is not None and arrivals is not None and anchors is not None:
                passed = None if view.passed is None else view.passed(times)
                weights = anchors.weights(*arrivals.weight(view.legs), passed, backend)
            seen = None if view.seen is None else view.seen(times)
            looked = None if view.looked is None else partial(view.looked, times)
            model.put(block, posed, look, seen, looked, weights, backend)
        found = block.arrays()
        if not (radar.is_array or radar.directional):
            return found
        places = model.places(cage, posed.centre)
        return side_by_side([look.with_ends(radar, found, places) for look in looks])

    return in_parts(
        [
            EchoStream(
                times_s=times_s, frames=partial(frames, part), vertices=model.operator.shape[0], echoes=_total(part)
            )
            for part in _parts(looks, most_echoes(radar))
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


def _total(looks: Sequence[_Look]) -> int:
    return sum(len(look.echoes) for look in looks)


def _parts(looks: Sequence[_Look], most: int) -> Iterator[list[_Look]]:
    """Looks in parts of at most that many echoes, each part's columns counted from 0; a larger look is cut."""
    part: list[_Look] = []
    for look in (piece for each in looks for piece in each.cut(most)):
        if part and _total(part) + len(look.echoes) > most:
            yield part
            part = []
        part.append(replace(look, first=_total(part)))
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
    lookouts: dict[int, _Lookout]
    """What visibility is known of, by how often the cage's edges are halved."""
    at_moments: bool
    """Whether frames are moments that have nothing to do with one another."""

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
        sweep_turns: float,
        point_count: int,
        halved: set[int],
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
            surface, fine, radar, times_s, seen_from=seen_from, turns_per_step=turns_per_step, sweep_turns=sweep_turns
        )
        points = _Points.spread(surface, carriers[0], seed, rough * abs(reflection), point_count) if carriers else None
        lookouts = {times: _Lookout.of(surface, fine, points, times) for times in halved}
        return cls(
            cage_faces=surface.faces,
            tilt_rad=tilts(surface, fine),
            operator=fine.operator.astype(np.float32),
            patches=parts,
            centre=centres(parts, fine),
            reflection=reflection * math.sqrt(1 - rough**2),
            points=points,
            lookouts=lookouts,
            at_moments=math.isinf(turns_per_step),
        )

    def looks(
        self, surface: MovingMesh, times_s: np.ndarray, pairs: Sequence[Pair], views: Sequence[View]
    ) -> Iterator[_Look]:
        """Each view with the patches that ever face both of its antennas; in free space, where there is but one, all."""
        lit = np.zeros((len(pairs), len(self.cage_faces)), bool)
        if self.at_moments or (len(times_s) - 1) / (times_s[-1] - times_s[0]) > FACING_MOST_HZ:
            lit[:] = True
        probes = np.linspace(times_s[0], times_s[-1], max(2, math.ceil((times_s[-1] - times_s[0]) * FACING_RATE_HZ)))
        in_room = [view.legs is not None for view in views]
        for first in range(0, len(probes) - 1 if any(in_room) and not lit.all() else 0, FACING_AT_ONCE):
            turned = _Turned.of(surface.at(probes[first : first + FACING_AT_ONCE + 1]), self.cage_faces)
            for number, pair in enumerate(pairs):
                lit[number] |= self.lit(turned, pair)
        lit[~np.array(in_room)] = True
        points = len(self.patches) + np.arange(0 if self.points is None else len(self.points.area_m2))
        first = 0
        for pair, view, some in zip(pairs, views, lit, strict=True):
            patches = np.flatnonzero(self.patches.any_of(some))
            echoes = np.concatenate([patches, points])
            yield _Look(view, pair, echoes, len(patches), first)
            first += len(echoes)

    def put(
        self,
        block: Block,
        posed: _Posed,
        look: _Look,
        seen: np.ndarray | None,
        looked: Looked | None,
        weights: Weights | None,
        backend: Backend,
    ) -> None:
        """Writes the echoes of one look to its columns; `seen` (K, V') is what share of its lookout's vertices it sees, `looked` of
        finer ones."""
        pair, patches, lookout = look.pair, look.echoes[: look.patches], self.lookouts[look.view.halved]
        columns = look.first + np.arange(len(look.echoes))
        if len(patches):
            patch_delays(posed.centres, patches, pair, block, columns[: len(patches)], backend)
        faces = np.ones(len(self.cage_faces), bool) if self.at_moments else self.lit(posed.turned, pair)
        if seen is not None:
            faces &= self._around(lookout, np.asarray(seen.any(axis=0)))
        lit = self.patches.any_of(faces)[patches]
        if weights is not None:
            lit &= weights.reach[patches]
        lit = np.flatnonzero(lit)
        if len(lit):
            parts = self.patches.only(patches[lit])
            if seen is None and looked is None:
                vertices = posed.vertices
            elif looked is not None:
                values = self._seen(posed, seen, lookout, slice(None))
                values[..., 3] *= _looked_at(looked, values[..., :3] + posed.origin, self.patches.corners)
                vertices = _on_device(values, backend.Float32)
            else:
                used = np.zeros(self.operator.shape[0], bool)
                used[parts.corners] = True
                parts = replace(parts, corners=(np.cumsum(used) - 1)[parts.corners])
                vertices = _on_device(self._seen(posed, seen, lookout, used), backend.Float32)
            patch_echoes(
                vertices, posed.centres, posed.origin, parts, patches[lit], pair, self.reflection, weights, block,
                columns[lit], backend,
            )  # fmt: skip
        if self.points is not None and len(look.echoes) > look.patches:
            fraction = self.points.fraction(seen, lookout, looked, posed.cage)
            self.points.put(
                block, posed.carrier, fraction, pair, weights, len(self.patches), columns[len(patches) :], backend
            )

    def _seen(self, posed: _Posed, seen: np.ndarray | None, lookout: _Lookout, used: np.ndarray | slice) -> np.ndarray:
        """The `used` facets' vertices and what share of them is seen, float32 (Vf, T, 4)."""
        if lookout.facets is None or seen is None:
            return _carried(self.operator[used], posed.local(seen))
        values = _carried(self.operator[used], posed.local(None))
        values[..., 3] = _carried(lookout.facets[used], seen[..., None])[..., 0]
        return values

    def _around(self, lookout: _Lookout, seen: np.ndarray) -> np.ndarray:
        """Cage faces, bool (F,), whose facets' vertices hang on any of those looked from, bool (V',), that are seen: theirs and
        their neighbours'."""
        wider = np.zeros(self.operator.shape[1], bool)
        wider[self.cage_faces[seen[lookout.faces].reshape(len(self.cage_faces), -1).any(axis=1)]] = True
        return np.asarray(wider[self.cage_faces].any(axis=1))

    def places(self, cage: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Where the echoes stand (K, N, 3), as of `echoes`."""
        found = [centre]
        if self.points is not None:
            found.append(self.points.places(cage))
        return np.concatenate(found).transpose(1, 0, 2)

    def lit(self, turned: _Turned, pair: Pair) -> np.ndarray:
        """Cage faces that may hold facets lit by the transmitter and seen by the receiver at or between the moments."""
        angle = np.zeros(turned.normal.shape[:2])
        for antenna in pair.views_m:
            sight = antenna - turned.middle
            cosine = np.einsum("kfi,kfi->kf", turned.normal, sight) / np.sqrt(np.einsum("kfi,kfi->kf", sight, sight))
            angle = np.maximum(angle, np.arccos(np.clip(cosine, -1, 1)))
        # What turns from moment to moment may turn as much again in between.
        margin = self.tilt_rad + BEND_RAD + np.abs(np.diff(angle, axis=0)).max(axis=0, initial=0)
        return angle.min(axis=0) < math.pi / 2 + margin


@dataclass(frozen=True, slots=True)
class _Lookout:
    """Vertices of the cage, its edges halved some times, from which it is looked what hides what."""

    faces: np.ndarray
    """Those of each cage face together."""
    facets: Csr | None
    """Sparse: what is known of the facets' vertices from these; None: the cage's own, carried as they are."""
    points: Csr | None
    """Sparse: the same of vertices that hold the diffuse points."""

    @classmethod
    def of(cls, surface: MovingMesh, fine: Refinement, points: _Points | None, times: int) -> _Lookout:
        """With edges halved so many times."""
        if not times:
            return cls(surface.faces, None, None if points is None else points.carrier.linear[points.used])
        halved = Halved.of(surface.faces, len(surface.rest), times)
        held = None if points is None else halved.to(points.carrier, surface.faces)[points.used]
        return cls(halved.faces, halved.to(fine, surface.faces), held)


@dataclass(frozen=True, slots=True)
class _Look:
    """One view's echoes, which are some of the model's."""

    view: View
    pair: Pair
    echoes: np.ndarray
    """Their numbers (N,): patches first, then diffuse points."""
    patches: int
    first: int
    """Column of the first one."""

    def cut(self, most: int) -> list[_Look]:
        """The same in pieces of at most that many echoes; the diffuse points stay together."""
        if len(self.echoes) <= most:
            return [self]
        patches, points = np.split(self.echoes, [self.patches])
        pieces = [
            replace(self, echoes=some, patches=len(some)) for some in np.split(patches, range(most, len(patches), most))
        ]
        return [*pieces, replace(self, echoes=points, patches=0)] if len(points) else pieces

    def with_ends(self, radar: Radar, found: EchoArrays, places: np.ndarray) -> EchoArrays:
        """The look's own of all echoes found, as arrays and patterns see them from their `places` (T, all of the model's, 3)."""
        columns = slice(self.first, self.first + len(self.echoes))
        mine = found._replace(**{name: getattr(found, name)[:, columns] for name in ("delay_s", "amplitude", "slope")})
        places = places[:, self.echoes]
        legs = self.view.legs
        return seen_by(radar, mine, places, places) if legs is None else unfolded(radar, mine, legs, places, places)


@dataclass(frozen=True, slots=True)
class _Turned:
    """Faces of the cage at a few moments."""

    normal: np.ndarray
    """(K, F, 3)."""
    middle: np.ndarray
    """(K, F, 3) m."""

    @classmethod
    def of(cls, cage: np.ndarray, faces: np.ndarray) -> _Turned:
        return cls(normals(cage, faces), cage[:, faces].mean(axis=2))


@dataclass(frozen=True, slots=True)
class _Posed:
    """A model at some frames, as far as all looks have it in common."""

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
    turned: _Turned
    backend: Backend
    _whole: list[Any] = field(default_factory=list)

    @classmethod
    def of(cls, model: _Model, cage: np.ndarray, backend: Backend) -> _Posed:
        centre = _carried(model.centre, cage)
        carrier = None if model.points is None else _on_device(_carried(model.points.operator, cage), backend.Float64)
        moments = np.unique(np.linspace(0, len(cage) - 1, math.ceil((len(cage) - 1) / PROBE_EVERY) + 1).astype(int))
        turned = _Turned.of(cage[moments], model.cage_faces)
        return cls(
            model, cage, cage.mean(axis=1), centre, _on_device(centre, backend.Float64), carrier, turned, backend
        )

    def local(self, seen: np.ndarray | None) -> np.ndarray:
        """Cage vertices relative to the origin and what share of them is seen, float32 (T, V, 4)."""
        # Positions within the body need no more than float32: 1e-7 of its size.
        values = np.ones((*self.cage.shape[:2], 4), np.float32)
        values[..., :3] = self.cage - self.origin[:, None]
        if seen is not None:
            values[..., 3] = seen
        return values

    @property
    def vertices(self) -> Any:
        """The facets' vertices where all is seen, flat Float32 (Vf, T, 4) on the device."""
        if not self._whole:
            self._whole.append(_on_device(_carried(self.model.operator, self.local(None)), self.backend.Float32))
        return self._whole[0]


def _refinements(
    surface: MovingMesh, wavenumber: float, range_m: float, sagittas_rad: list[Sagitta], max_facets: int
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
        self, seen: np.ndarray | None, lookout: _Lookout, looked: Looked | None, cage: np.ndarray
    ) -> np.ndarray | None:
        """What share of the carrier's vertices is seen (Vp, T, 1); None: all."""
        share = None if seen is None else _carried(lookout.points, seen[..., None])
        if looked is None:
            return share
        found = _looked_at(looked, _carried(self.operator, cage), self.corners)[..., None]
        return found if share is None else share * found

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
        """Writes the points' echoes; `vertices` are the carrier's, flat Float64 (Vp, T, 3) m, of which a `fraction` is seen."""
        diffuse_echoes(
            vertices, self.corners, self.barycentric, self.area_m2, self.phase_rad, fraction, pair, self.scattered, weights,
            first, block, columns, backend,
        )  # fmt: skip


def _looked_at(looked: Looked, vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """What share is seen of vertices (Vf, K, 3) m of triangles `corners` (F, 3): (Vf, K) float32."""
    return looked(np.ascontiguousarray(vertices.swapaxes(0, 1)), corners).T


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
    """Refuses a radar inside a closed mesh, or touching a mesh, at any of a few moments of the record."""
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
            moment = times[np.argmax(inside if inside.any() else touches)]
            raise InputError(
                f"the radar at ({where}) m {'is inside' if inside.any() else 'touches'} {surface.name} at {moment:.3g} s; place "
                "the target farther away (distance_m) or move the radar"
            )
