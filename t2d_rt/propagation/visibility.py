"""Visibility of moving meshes from an antenna: rays through the meshes themselves, traced with Mitsuba at sample times.

Building a ray tracer's scene costs more than tracing it, so the meshes at a chunk of sample times stand in one scene side by side,
too far apart to occlude one another, for the rays to all viewpoints. Between sample times visibility fades smoothly: an abrupt
change would be a click across the spectrogram.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import zip_longest
from typing import Any, NamedTuple
from weakref import ref

import numpy as np

from t2d_rt.core.backend import Backend, aligned, one_thread_at_a_time
from t2d_rt.core.memory import SAMPLE_BYTES, VISIBILITY_BYTES
from t2d_rt.propagation.edge_waves import MeshesAlone, Points, beside_others, smooth_step
from t2d_rt.propagation.images import apparent_m, images, instants_of
from t2d_rt.propagation.occluders import Occluders, PosedOccluders, incidence, posed_vertex_normals
from t2d_rt.propagation.rays import LIFT_M, columns, mitsuba, scene_of_instants
from t2d_rt.types import MovingMesh, OneWayPath

FEW_PLACES = 4
"""Number of viewpoints, such as images in a room's walls, beyond which about all faces of a body are seen from some of them."""

Unblocked = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function that gives the fraction of the field at points (K, V, 3) [m] and times (K,) [s] that the static scene does not block."""


def sample_times(start_s: float, stop_s: float, rate_hz: float) -> np.ndarray:
    """Times [s] at which visibility is sampled, uniform, (S,)."""
    return np.linspace(start_s, stop_s, max(2, int(np.ceil((stop_s - start_s) * rate_hz)) + 1))


def viewpoints_at(places_m: Sequence[np.ndarray]) -> list[OneWayPath]:
    """Lines of sight from places (3,) [m] as viewpoints, of which the polarisation does not count."""
    return [OneWayPath.line_of_sight(place, np.array([0.0, 0.0, 1.0])) for place in places_m]


def between_samples(
    times_s: np.ndarray, samples_s: np.ndarray, at_samples: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Values (K, N) at any times (K,) [s] from those at sample times (S,) [s], whose numbers `at_samples` takes: smooth steps from
    one to the next."""
    position = np.interp(times_s, samples_s, np.arange(len(samples_s)))
    before = np.minimum(position.astype(int), len(samples_s) - 2)
    u = (position - before)[:, None].astype(np.float32)
    fade = smooth_step(u)
    numbers, inverse = np.unique(np.concatenate([before, before + 1]), return_inverse=True)
    values = at_samples(numbers)
    first, second = inverse[: len(before)], inverse[len(before) :]
    return np.asarray(values[first] * (1 - fade) + values[second] * fade)


@dataclass(frozen=True, slots=True)
class VisibilitySamples:
    """Visibility of vertices from one point at a few instants, (K, V) each."""

    front: np.ndarray | None
    """Which vertices face the viewpoint; None where meshes occlude nothing."""
    visible: np.ndarray | None
    """Fraction of the field at these that no mesh occludes."""
    unblocked: np.ndarray
    """Fraction of the field that the static scene does not block, float32."""
    fractions: dict[int, np.ndarray] = field(default_factory=dict)
    """Visibility by the number of one-way paths that share it."""


class _Chunk(NamedTuple):
    """Meshes at some instants, and as rays meet them, together and alone."""

    at: PosedOccluders
    scene: OccluderScene | None
    alone: MeshesAlone
    seen: dict[Hashable, tuple[np.ndarray, np.ndarray]]
    """Which points face a viewpoint and how far meshes leave them visible from there, by the courses of the viewpoint's path."""


class Viewpoints:
    """Places from which visibility of the same meshes is sampled at the same times, a chunk of these at once: to build a scene of
    the meshes costs more than to trace it."""

    def __init__(
        self, meshes: Occluders, samples_s: np.ndarray, backend: Backend, *, wavelength_m: float | None
    ) -> None:
        """`samples_s` (S,) are the sample times [s]. Without a wavelength [m], shadows that meshes cast on one another are hard."""
        self.meshes, self.samples_s, self.backend, self.wavelength_m = meshes, samples_s, backend, wavelength_m
        self._references: list[ref[Occlusion]] = []

    @property
    def occlusions(self) -> list[Occlusion]:
        """The occlusions that something still holds; nothing is traced for others."""
        return [occlusion for occlusion in (reference() for reference in self._references) if occlusion is not None]

    def add(self, viewpoint: Occlusion) -> None:
        """Traces visibility from this viewpoint as well from now on, for as long as something else holds it."""
        self._references.append(ref(viewpoint))

    def traced(self, occlusions: Sequence[Occlusion], times_s: np.ndarray) -> list[np.ndarray]:
        """Visibility from these at just these times (K,) [s], at most as many as one scene holds, float32 (K, all vertices)."""
        chunk = self._chunk(times_s)
        return [occlusion.fractions(occlusion.sampled(chunk), 1) for occlusion in occlusions]

    @cached_property
    def at_once(self) -> int:
        """Number of sample times of a chunk, known once all viewpoints are: fewer where there are many of these, so that what is
        held for all of them fits memory."""
        of_one = SAMPLE_BYTES * self.meshes.point_count * len(self.occlusions)
        return int(np.clip(VISIBILITY_BYTES // max(1, of_one), 1, self.meshes.copies))

    def drop_but(self, chunks: range) -> None:
        """Drops all chunks but these, for all viewpoints: echoes may be summed in several parts, each from some of the viewpoints
        alone over the whole record. A viewpoint that asked for nothing since chunks were last dropped is out of use."""
        if any(number not in chunks for occlusion in self.occlusions for number in occlusion.chunks):
            for occlusion in self.occlusions:
                occlusion.asked, occlusion.in_use = False, occlusion.asked
                occlusion.chunks = {number: samples for number, samples in occlusion.chunks.items() if number in chunks}

    def sample(self, number: int) -> None:
        """Finds visibility at a chunk of sample times from all viewpoints in use."""
        chunk = self._chunk(self.samples_s[number * self.at_once : (number + 1) * self.at_once])
        for occlusion in self.occlusions:
            if occlusion.in_use and number not in occlusion.chunks:
                occlusion.chunks[number] = occlusion.sampled(chunk)

    def _chunk(self, times_s: np.ndarray) -> _Chunk:
        at = self.meshes.at(times_s)
        return _Chunk(at, self.scene(at), MeshesAlone(at, self.backend), {})

    def scene(self, at: PosedOccluders) -> OccluderScene | None:
        """The meshes at some instants as rays to all viewpoints meet them; None where none of these is occluded."""
        seen_paths = [
            path for occlusion in self.occlusions if occlusion.solid for path in occlusion.viewpoint.seen_at(at.times_s)
        ]
        if not seen_paths:
            return None
        places = {place.tobytes(): place for path in seen_paths for place in images(path)}
        parts = at.facing(list(places.values())) if len(places) <= FEW_PLACES else None
        return OccluderScene(self.meshes, at.vertices, seen_paths, self.backend, parts=parts)


class Occlusion:
    """Visibility of the vertices of meshes from one of some viewpoints, self-occlusion and occlusion of one another included, on
    every straight part of a path.

    `unblocked` gives the fraction of the field that the static scene does not block; with `solid` False only that counts.
    Visibility is sampled at the viewpoints' sample times and fades in between; at 25 Hz the edge of a fast limb's shadow moves by
    some 10 cm from one sample time to the next.
    """

    def __init__(
        self, viewpoints: Viewpoints, viewpoint: OneWayPath, *, unblocked: Unblocked | None = None, solid: bool = True
    ) -> None:
        self.viewpoint, self.solid = viewpoint, solid
        self.viewpoints, self._meshes, self._unblocked = viewpoints, viewpoints.meshes, unblocked
        viewpoints.add(self)
        self._last: dict[int, tuple[np.ndarray, list[np.ndarray]]] = {}
        """What was asked for last, by `path_count`: meshes ask for the same times one after another."""
        self.chunks: dict[int, VisibilitySamples] = {}
        self.asked = False
        """Whether visibility was asked for since chunks were dropped last."""
        self.in_use = True
        """Whether it was asked for before that, or has been since."""

    @classmethod
    def alone(
        cls,
        meshes: Occluders,
        viewpoint: OneWayPath,
        *,
        samples_s: np.ndarray,
        backend: Backend,
        wavelength_m: float | None,
    ) -> Occlusion:
        """Visibility from the only viewpoint, sampled at these times (S,) [s]."""
        return cls(Viewpoints(meshes, samples_s, backend, wavelength_m=wavelength_m), viewpoint)

    def visibility(self, times_s: np.ndarray, path_count: int = 1) -> list[np.ndarray]:
        """Visibility at times (K,) [s], up to some 1.4 beside an edge: one float32 array (K, V) for each mesh, for its vertices and
        those of its subdivision.

        `path_count` one-way paths, 1 or 2, share what arrives: the fractions are those over all of them.
        """
        last = self._last.get(path_count)
        if last is None or not np.array_equal(last[0], times_s):
            values = between_samples(
                times_s, self.viewpoints.samples_s, lambda numbers: self._at_samples(numbers, path_count)
            )
            last = self._last[path_count] = times_s, self._meshes.split(values)
        return last[1]

    def _at_samples(self, numbers: np.ndarray, path_count: int) -> np.ndarray:
        """Visibility at sample times of these numbers, ascending, chunk by chunk; chunks that no longer count are dropped."""
        # Blocks of frames go on in time, and all chunks of one are asked for from each place in turn.
        chunk_size = self.viewpoints.at_once
        self.viewpoints.drop_but(range(int(numbers.min()) // chunk_size, int(numbers.max()) // chunk_size + 1))
        self.asked = self.in_use = True
        fractions = []
        for number in numbers.tolist():
            chunk, place = divmod(number, chunk_size)
            if chunk not in self.chunks:
                self.viewpoints.sample(chunk)
            fractions.append(self.fractions(self.chunks[chunk], path_count)[place])
        return np.stack(fractions)

    def sampled(self, chunk: _Chunk) -> VisibilitySamples:
        """Visibility at the instants of a chunk."""
        unblocked = self._unblocked_at(chunk.at)
        if not self.solid or chunk.scene is None:
            return VisibilitySamples(None, None, unblocked)
        seen_paths = self.viewpoint.seen_at(chunk.at.times_s)
        # A path over a wall and one over the window in it have the same course, and so the same occlusion.
        courses = tuple(path.course for path in seen_paths)
        if courses not in chunk.seen:
            chunk.seen[courses] = self._seen(chunk.at, chunk.scene, chunk.alone, seen_paths)
        return VisibilitySamples(*chunk.seen[courses], unblocked)

    def _seen(
        self, at: PosedOccluders, scene: OccluderScene, alone: MeshesAlone, seen_paths: list[OneWayPath]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Which points face the viewpoint, and how far meshes leave them visible."""
        front = np.einsum("kvi,kvi->kv", at.normals, apparent_m(seen_paths) - at.points) > 0
        visible = self.visible(at, front, scene)
        if self.viewpoints.wavelength_m is not None and len(self._meshes.meshes) > 1:
            points = Points(at.points, at.normals, self._meshes.owner, front, visible)
            visible = beside_others(alone, seen_paths, points, wavelength_m=self.viewpoints.wavelength_m)
        return front, visible

    def fractions(self, sampled: VisibilitySamples, path_count: int) -> np.ndarray:
        """Visibility where `path_count` one-way paths share it, float32 (K, all vertices)."""
        if path_count not in sampled.fractions:
            sampled.fractions[path_count] = self._beyond(sampled, path_count)
        return sampled.fractions[path_count]

    def _beyond(self, sampled: VisibilitySamples, path_count: int) -> np.ndarray:
        """What is visible times what is unblocked, over `path_count` paths, float32 (K, all vertices), with vertices beyond the
        horizon filled in."""
        if sampled.front is None or sampled.visible is None:
            return sampled.unblocked**path_count
        front, visibility = sampled.front, (sampled.visible * sampled.unblocked) ** path_count
        # A vertex just beyond the horizon takes the mean of its neighbours this side of it: the horizon itself is the
        # facets' own cosine, not a shadow. (To go on from there over as much as a whole edge was tried and changes nothing.)
        count = (self._meshes.neighbours @ front.T.astype(np.float32)).T
        beyond = (self._meshes.neighbours @ visibility.T).T / np.maximum(count, 1)
        return np.where(front, visibility, beyond).astype(np.float32)

    def _unblocked_at(self, at: PosedOccluders) -> np.ndarray:
        """Fraction of the field at the meshes' points that the static scene does not block, float32 (K, V)."""
        if self._unblocked is None:
            return np.ones(at.points.shape[:2], np.float32)
        marks, carried = self._meshes.marks
        return np.asarray((carried @ self._unblocked(at.points[:, marks], at.times_s).T).T)

    def visible(self, at: PosedOccluders, front: np.ndarray, scene: OccluderScene) -> np.ndarray:
        """Which of the points of the meshes that face the viewpoint are visible from it, bool (K, Q); none of the others is.

        Points that the subdivision adds to bodies are traced beside the edges of shadows alone: elsewhere they are as the vertices
        about them. A shadow narrower than the distance of these vertices would be missed.
        """
        always = front & self._meshes.are_vertices if self._meshes.of_bodies else front
        seen_paths = self.viewpoint.seen_at(at.times_s)
        visible = scene.visible(seen_paths, at.points, at.normals, always)
        others = front & ~always
        if others.any():
            lit, dark = self._meshes.beside(visible), self._meshes.beside(always & ~visible)
            visible |= others & lit & ~dark
            visible |= scene.visible(seen_paths, at.points, at.normals, others & (lit == dark))
        return visible


class ExactVisibility:
    """Visibility of facets' own vertices at just the instants asked for, traced through `occluders`: not sampled, no cage.

    Instants less than `SAME_S` [s] apart are traced once, and as many instants together as have `FACES_AT_ONCE` faces, which take
    about 1 GB.
    """

    SAME_S, FACES_AT_ONCE = 1e-3, 4_000_000

    def __init__(
        self,
        occluders: Sequence[MovingMesh],
        viewpoint: OneWayPath,
        *,
        backend: Backend,
        own: int = 0,
        wavelength_m: float | None,
    ) -> None:
        """The facets are those of the occluder of number `own`; without a wavelength [m] the others cast hard shadows on them."""
        self._occluders, self._own, self._wavelength_m = Occluders(occluders), own, wavelength_m
        self._viewpoint, self._backend = viewpoint, backend
        self._mitsuba = mitsuba(backend)
        self._last: tuple[bytes, tuple[MeshesAlone, list[_Obstacles]]] | None = None

    def fraction(self, times_s: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Visibility, float32 (K, V), of vertices (K, V, 3) [m] of triangles (F, 3) at times (K,) [s]: 1 where they are visible or
        face away, else 0, near the outlines of other meshes the amplitude of the field beside these."""
        fresh = np.zeros(len(times_s), bool)
        last = -np.inf
        for number, time_s in enumerate(times_s):
            if abs(time_s - last) > self.SAME_S:
                fresh[number], last = True, time_s
        rows, at_once = np.flatnonzero(fresh), max(1, self.FACES_AT_ONCE // len(self._occluders.faces))
        together = np.split(rows, range(at_once, len(rows), at_once))
        visibility = np.concatenate([self._traced(times_s[some], vertices[some], faces) for some in together])
        return np.asarray(visibility[np.cumsum(fresh) - 1])

    def _traced(self, times_s: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """`fraction` at instants that are all traced."""
        of_faces = incidence(faces, vertices.shape[1])
        alone, obstacles = self._obstacles(times_s)
        owner, results = np.full(vertices.shape[1], self._own), []
        for points, before in zip(vertices, obstacles, strict=True):
            normal = posed_vertex_normals(points[None], faces, of_faces)
            front = np.einsum("vi,vi->v", normal[0], images(before.viewpoint)[-1] - points) > 0
            results.append((normal[0], front, before.leave_visible(points[None], normal, front[None])[0]))
        normals, front, visible = (np.stack(column) for column in zip(*results, strict=True))
        if self._wavelength_m is not None and len(self._occluders.meshes) > 1:
            seen_points = Points(vertices, normals, owner, front, visible)
            seen_paths = self._viewpoint.seen_at(alone.at.times_s)
            visible = beside_others(alone, seen_paths, seen_points, wavelength_m=self._wavelength_m)
        return np.where(front, visible, np.float32(1))  # beyond the horizon facets show their back

    def _obstacles(self, times_s: np.ndarray) -> tuple[MeshesAlone, list[_Obstacles]]:
        """Occluders at each of these times, and as rays meet them: facets and diffuse points ask for the same ones."""
        if self._last is None or self._last[0] != times_s.tobytes():
            posed, obstacles, seen_paths = self._occluders.at(times_s), [], self._viewpoint.seen_at(times_s)
            all_places = [place for path in seen_paths for place in images(path)]
            for number, (vertices, facing) in enumerate(zip(posed.vertices, posed.facing(all_places), strict=True)):
                viewpoint = seen_paths[number % len(seen_paths)]
                places = np.array(images(viewpoint))
                from_here = (vertices - places[-1])[None]
                reach = 2.2 * max(float(np.abs(points).max()) for points in (from_here, places - places[-1]))
                scene = scene_of_instants(self._mitsuba, from_here, self._occluders.faces[facing], reach)
                obstacles.append(_Obstacles(self._mitsuba, *scene, viewpoint))
            self._last = times_s.tobytes(), (MeshesAlone(posed, self._backend), obstacles)
        return self._last[1]


@dataclass(frozen=True, slots=True)
class _Obstacles:
    """Meshes at some instants side by side, in a scene that rays towards a viewpoint are traced in, over its mirrors."""

    mitsuba: Any
    scene: Any
    shift_m: np.ndarray
    """Where the viewpoint, the last of its images, lies in the scene beside the meshes of each instant [m], (K, 1, 3)."""
    viewpoint: OneWayPath

    @one_thread_at_a_time
    def leave_visible(self, points: np.ndarray, normals: np.ndarray, candidates: np.ndarray) -> np.ndarray:
        """Whether segments from `candidates` among points (K, Q, 3) with these normals to the viewpoint are free, bool (K, Q)."""
        import drjit as dr

        visible = np.zeros(candidates.shape, bool)
        if not candidates.any():  # Mitsuba aborts without a ray
            return visible
        mi = self.mitsuba

        from_here = mi.Vector3f(*columns(mi, points[candidates] - images(self.viewpoint)[-1]))
        normal = mi.Vector3f(*columns(mi, normals[candidates]))
        shifts = mi.Vector3f(*columns(mi, self.shift_m[:, 0]))
        shift = dr.gather(mi.Vector3f, shifts, mi.UInt32(aligned(np.nonzero(candidates)[0], np.uint32)))
        visible[candidates] = self._free(from_here + LIFT_M * (normal - dr.normalize(from_here)), shift).numpy()
        return visible

    def _free(self, start: Any, shift: Any) -> Any:
        """Whether rays from points relative to the last image meet nothing, over one straight part after another to the antenna."""
        import drjit as dr

        mi, places, free = self.mitsuba, images(self.viewpoint), self.mitsuba.Bool(True)

        def vector(of: np.ndarray) -> Any:
            return mi.Vector3f(*columns(mi, of[None]))

        for place, plane in zip_longest(reversed(places), reversed(self.viewpoint.planes)):
            from_place = start - vector(place - places[-1])
            length = dr.norm(from_place)
            ahead = -from_place / length
            if plane is not None:
                # On to there; where the plane is not between image and point there is no path: a ray of length 0.
                normal, offset_m = plane
                foot = (offset_m - normal @ places[-1]) * normal
                reached = dr.dot(vector(foot) - start, vector(normal)) / dr.dot(ahead, vector(normal))
                length = dr.select(reached > 0, dr.minimum(reached, length), 0)
            ray = mi.Ray3f(mi.Point3f(start + shift), ahead)
            ray.maxt = length
            free &= ~self.scene.ray_test(ray, active=free)
            start = start + length * ahead
        return free


class OccluderScene:
    """The meshes at some instants in one scene, in which visibility is traced from many places."""

    def __init__(
        self,
        occluders: Occluders,
        vertices: np.ndarray,
        seen_from: Sequence[OneWayPath],
        backend: Backend,
        *,
        parts: np.ndarray | None = None,
    ) -> None:
        """`vertices` (K, V, 3) [m] at up to 64 instants; `parts` are the faces that count at each, bool (K, F), by default all."""
        faces = occluders.faces + vertices.shape[1] * np.arange(len(vertices))[:, None, None]
        faces = faces if parts is None else faces[parts]
        self._middle = vertices.reshape(-1, 3).mean(axis=0)
        places = [place for path in seen_from for place in images(path)]
        reach = 2.2 * max(float(np.abs(points - self._middle).max()) for points in (vertices, *places))
        self._mitsuba = mitsuba(backend)
        self._scene, self._shift = scene_of_instants(self._mitsuba, vertices - self._middle, faces, reach)

    def visible(
        self,
        seen_paths: Sequence[OneWayPath],
        points: np.ndarray,
        normals: np.ndarray,
        candidates: np.ndarray | None = None,
    ) -> np.ndarray:
        """Which points (K, Q, 3) [m] with normals (K, Q, 3) on the meshes are visible over the paths `seen_at` the instants, bool
        (K, Q): of the `candidates`, bool (K, Q), by default all; none of the others is."""
        candidates = np.ones(points.shape[:2], bool) if candidates is None else candidates
        visible = []
        for viewpoint, at in zip(seen_paths, instants_of(seen_paths), strict=True):
            shift = self._shift[at] + (images(viewpoint)[-1] - self._middle)
            obstacles = _Obstacles(self._mitsuba, self._scene, shift, viewpoint)
            visible.append(obstacles.leave_visible(points[at], normals[at], candidates[at]))
        return visible[0] if len(visible) == 1 else np.concatenate(visible)
