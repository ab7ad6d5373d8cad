"""Which parts of moving meshes an antenna sees: rays through the meshes themselves, traced with Mitsuba at a key rate.

Building a ray tracer's scene costs more than tracing it, so a chunk of key frames stands in one scene side by side, too far
apart to shade one another, and of closed meshes only the faces that look towards the antenna: what leaves a body must pass one of
them. Between key frames visibility fades smoothly: a part that pops would click across the spectrogram.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from t2d_rt.backend import Backend, aligned
from t2d_rt.geometry import Halved, topology
from t2d_rt.geometry.vectors import cross
from t2d_rt.trace.mitsuba import columns, mitsuba, mitsuba_mesh, traceable
from t2d_rt.types import MovingMesh

FACES_PER_SCENE = 250_000
# Rays start this far off the surface, so that the triangles they start from do not stop them.
LIFT_M = 2e-3
MARK_M = 0.06
"""What stands still is looked past from vertices that far apart: its shadows have soft edges."""


Past = Callable[[np.ndarray], np.ndarray]


def key_times(start_s: float, stop_s: float, rate_hz: float) -> np.ndarray:
    """Moments [s] at which visibility is looked at."""
    return np.linspace(start_s, stop_s, max(2, int(np.ceil((stop_s - start_s) * rate_hz)) + 1))


def faded(times_s: np.ndarray, keys_s: np.ndarray, at_keys: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Values (K, N) at any times from those at keys, whose numbers `at_keys` takes: smooth steps from key to key."""
    position = np.interp(times_s, keys_s, np.arange(len(keys_s)))
    before = np.minimum(position.astype(int), len(keys_s) - 2)
    u = (position - before)[:, None].astype(np.float32)
    fade = u * u * (3 - 2 * u)  # no kink at the keys
    keys, inverse = np.unique(np.concatenate([before, before + 1]), return_inverse=True)
    values = at_keys(keys)
    first, second = inverse[: len(before)], inverse[len(before) :]
    return np.asarray(values[first] * (1 - fade) + values[second] * fade)


@dataclass(frozen=True, slots=True)
class Looked:
    """What one point sees of vertices at a few moments, (K, V) each."""

    front: np.ndarray | None
    """Which turn towards it; None where meshes hide nothing."""
    clear: np.ndarray | None
    """Which of these no mesh hides."""
    past: np.ndarray
    """What share of the field reaches them past what stands still, float32."""
    shares: dict[int, np.ndarray] = field(default_factory=dict)
    """What of all this comes of a field, by how often it passes what stands still."""


class Occlusion:
    """Visibility of the vertices of `meshes` from one point, self-occlusion and one another's shadow included.

    `past` says what share reaches points (..., 3) past what stands still; with `solid` False only that counts.
    It is looked at `keys_s` [s] (`key_times`) and fades in between; the shadow's edge moves a hand's breadth between the keys of
    a fast limb at 25 Hz. It is looked from the meshes' vertices (a body's are 25 mm apart) and, with edges `halved` so many times,
    from those that this adds, which follow the mesh's own (`geometry.Halved`).
    """

    def __init__(
        self,
        meshes: Sequence[MovingMesh],
        viewpoint_m: np.ndarray,
        *,
        keys_s: np.ndarray,
        backend: Backend,
        past: Past | None = None,
        solid: bool = True,
        halved: int = 0,
    ) -> None:
        self._meshes = tuple(meshes)
        self._past, self._solid = past, solid
        self._last: dict[int, tuple[np.ndarray, list[np.ndarray]]] = {}
        self._viewpoint = np.asarray(viewpoint_m, np.float64)
        self._keys = keys_s
        self._copies = 64
        if not meshes:
            return
        self._faces = _side_by_side([m.faces for m in meshes], [len(m.rest) for m in meshes])
        lookouts = [Halved.of(m.faces, len(m.rest), halved) for m in meshes]
        self._lookouts = lookouts if halved else None
        self._sizes = [each.operator.shape[0] for each in lookouts]
        self._chunks: OrderedDict[int, Looked] = OrderedDict()
        self._closed = np.concatenate([np.full(len(m.faces), _is_closed(m)) for m in meshes])
        self._copies = int(np.clip(FACES_PER_SCENE // (len(self._faces) * 2**halved), 1, 64))
        self._looking = _side_by_side([each.faces for each in lookouts], self._sizes)
        self._incidence = _incidence(self._looking, sum(self._sizes))
        self._neighbours = _adjacency(self._incidence)
        self._marks = None if past is None else _marks([m.rest for m in meshes], [each.operator for each in lookouts])
        self._mitsuba = mitsuba(backend)

    def visibility(self, times_s: np.ndarray, times_past: int = 1) -> list[np.ndarray]:
        """Fractions in 0..1 at times [s] (K,), one float32 array (K, V) for each mesh: its vertices, halved edges' too.

        The field comes `times_past` what stands still.
        """
        last = self._last.get(times_past)
        if last is None or not np.array_equal(last[0], times_s):  # meshes and pairs ask for the same
            values = faded(times_s, self._keys, lambda keys: self._at_keys(keys, times_past))
            last = self._last[times_past] = times_s, np.split(values, np.cumsum(self._sizes)[:-1], axis=1)
        return last[1]

    def _at_keys(self, keys: np.ndarray, times_past: int) -> np.ndarray:
        return np.stack(
            [self._shares(self._chunk(k // self._copies), times_past)[k % self._copies] for k in keys.tolist()]
        )

    def _chunk(self, number: int) -> Looked:
        """What is seen at a chunk of keys, `copies` or fewer; the last two chunks are kept."""
        if number not in self._chunks:
            first = number * self._copies
            self._chunks[number] = self.looked(self._keys[first : first + self._copies])
            while len(self._chunks) > 2:
                self._chunks.popitem(last=False)
        self._chunks.move_to_end(number)
        return self._chunks[number]

    def of_swift(self, mesh: MovingMesh, times_past: int = 1) -> Past:
        """What share of another mesh is seen at times [s] (K,), the same for all of its vertices (K, V): of one that turns too fast
        to be looked at vertex by vertex, and hides nothing itself."""
        keys = self._keys
        known: list[np.ndarray] = []

        def at_keys(numbers: np.ndarray) -> np.ndarray:
            if not known:
                parts = [keys[first : first + self._copies] for first in range(0, len(keys), self._copies)]
                known.append(np.concatenate([self._share(mesh.at(part), part, times_past) for part in parts]))
            return known[0][numbers]

        return lambda times_s: np.broadcast_to(faded(times_s, keys, at_keys), (len(times_s), len(mesh.rest)))

    def _share(self, points: np.ndarray, times_s: np.ndarray, times_past: int) -> np.ndarray:
        """Mean share (K, 1) of points (K, Q, 3) at these times that is seen."""
        seen = np.ones(points.shape[:2], np.float32)
        if self._solid and self._meshes:
            vertices = np.concatenate([mesh.at(times_s) for mesh in self._meshes], axis=1)
            seen *= self.clear(vertices, points, np.zeros_like(points))
        if self._past is not None:
            seen[seen > 0] *= self._past(points[seen > 0]) ** times_past
        return seen.mean(axis=1, keepdims=True)

    def traced(self, times_s: np.ndarray) -> np.ndarray:
        """Visibility at just these times, float32 (K, all vertices); at most as many as stand in one scene."""
        return self._shares(self.looked(times_s), 1)

    def looked(self, times_s: np.ndarray) -> Looked:
        """What is seen at just these times; at most as many as stand in one scene."""
        posed = [mesh.at(times_s) for mesh in self._meshes]
        vertices = points = np.concatenate(posed, axis=1)
        if self._lookouts is not None:
            points = np.concatenate(
                [_of_each(each.operator, p) for each, p in zip(self._lookouts, posed, strict=True)], axis=1
            )
        past = self._let_past(points)
        if not self._solid:
            return Looked(None, None, past)
        normal = _vertex_normals(points, self._looking, self._incidence)
        front = np.einsum("kvi,kvi->kv", normal, self._viewpoint - points) > 0
        return Looked(front, self.clear(vertices, points, normal) & front, past)

    def _shares(self, looked: Looked, times_past: int) -> np.ndarray:
        """Of a field that comes so many times past what stands still, float32 (K, all vertices)."""
        if times_past not in looked.shares:
            looked.shares[times_past] = self._beyond(looked, looked.past**times_past)
        return looked.shares[times_past]

    def _beyond(self, looked: Looked, past: np.ndarray) -> np.ndarray:
        if looked.front is None or looked.clear is None:
            return past
        front, seen = looked.front, looked.clear * past
        # A vertex just beyond the horizon takes over from its neighbours this side of it: the horizon itself is the
        # facets' own cosine, not a shadow. (To go on from there over as much as a whole edge was tried and changes nothing.)
        count = (self._neighbours @ front.T.astype(np.float32)).T
        beyond = (self._neighbours @ seen.T).T / np.maximum(count, 1)
        return np.where(front, seen, beyond).astype(np.float32)

    def _let_past(self, vertices: np.ndarray) -> np.ndarray:
        """What share reaches vertices (K, V, 3) past what stands still, float32 (K, V)."""
        if self._past is None or self._marks is None:
            return np.ones(vertices.shape[:2], np.float32)
        marks, carried = self._marks
        return np.asarray((carried @ self._past(vertices[:, marks]).T).T)

    def clear(self, vertices: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Whether nothing at vertices (K, V, 3) stands between points (K, Q, 3) on it, of given normals, and here: (K, Q)."""
        offset = self._viewpoint - points
        towards = offset / np.sqrt(np.einsum("kqi,kqi->kq", offset, offset))[..., None]
        origins = LIFT_M * (towards + normals) - offset
        vertices = vertices - self._viewpoint
        moment, face = np.nonzero(_looks_here(vertices, self._faces) | ~self._closed)
        return _clear(self._mitsuba, vertices, self._faces[face] + moment[:, None] * vertices.shape[1], origins)


class FacetLook:
    """Visibility of facets' own vertices at just the moments asked for, traced through `occluders`: no keys, no cage.

    Moments less than `SAME_S` apart share one look.
    """

    SAME_S = 1e-3

    def __init__(self, occluders: Sequence[MovingMesh], viewpoint_m: np.ndarray, *, backend: Backend) -> None:
        self._meshes = tuple(occluders)
        self._viewpoint = viewpoint_m
        self._solid = Occlusion(occluders, viewpoint_m, keys_s=np.zeros(0), backend=backend)

    def share(self, times_s: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """1 where vertices (K, V, 3) m of triangles (F, 3) are seen at times [s] (K,), else 0: float32 (K, V)."""
        fresh = np.zeros(len(times_s), bool)
        last = -np.inf
        for number, time_s in enumerate(times_s):
            if time_s - last > self.SAME_S:
                fresh[number], last = True, time_s
        incidence = _incidence(faces, vertices.shape[1])
        looks = []
        for moment in np.flatnonzero(fresh):
            here = vertices[moment : moment + 1]
            normal = _vertex_normals(here, faces, incidence)
            front = np.flatnonzero(np.einsum("vi,vi->v", normal[0], self._viewpoint - here[0]) > 0)
            seen = np.ones(vertices.shape[1], np.float32)  # beyond the horizon facets show their back
            occluders = np.concatenate([mesh.at(times_s[moment : moment + 1]) for mesh in self._meshes], axis=1)
            seen[front] = self._solid.clear(occluders, here[:, front], normal[:, front])[0]
            looks.append(seen)
        return np.stack(looks)[np.cumsum(fresh) - 1]


def _clear(mi: Any, vertices: np.ndarray, faces: np.ndarray, origins: np.ndarray) -> np.ndarray:
    """Whether the way from origins (K, Q, 3) to the coordinate origin is free, bool (K, Q).

    `faces` (F, 3) are those of all moments, and name the vertices (K, V, 3) as one list.
    """
    reach = 2.2 * float(np.abs(vertices).max())
    shift = side_by_side(len(vertices), reach)
    mesh = mitsuba_mesh(mi, (vertices + shift).reshape(-1, 3), faces)
    distance = np.sqrt(np.einsum("kqi,kqi->kq", origins, origins))

    ray = mi.Ray3f(mi.Point3f(*columns(mi, origins + shift)), mi.Vector3f(*columns(mi, -origins / distance[..., None])))
    ray.maxt = mi.Float(aligned(distance, np.float32))
    return ~traceable(mi, mesh).ray_test(ray).numpy().reshape(distance.shape)


def side_by_side(moments: int, reach_m: float) -> np.ndarray:
    """By how much to shift what belongs to each of up to 64 moments, so that none reaches another, (K, 1, 3) m."""
    return np.asarray(np.stack(np.unravel_index(np.arange(moments), (4, 4, 4)), axis=1)[:, None, :] * reach_m)


def _is_closed(mesh: MovingMesh) -> bool:
    """Whether every edge joins two faces that turn the same way."""
    return bool((topology(mesh.faces, len(mesh.rest)).twin >= 0).all())


def _looks_here(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces of vertices (K, V, 3) turn their front to the coordinate origin, bool (K, F)."""
    a, b, c = _corners(vertices, faces)
    return (a * np.stack(cross(b, c))).sum(axis=0).T <= 0


def _vertex_normals(vertices: np.ndarray, faces: np.ndarray, incidence: Any) -> np.ndarray:
    """Area-weighted unit normals (K, V, 3) of vertices (K, V, 3)."""
    a, b, c = _corners(vertices, faces)
    total = np.stack([incidence @ each for each in cross(b - a, c - a)])
    return (total / np.maximum(np.sqrt((total**2).sum(axis=0)), 1e-30)).T


def _corners(vertices: np.ndarray, faces: np.ndarray) -> Iterator[np.ndarray]:
    """The three corners of faces, each (3, F, K): whole rows of moments are read and worked on at a time."""
    rows = np.ascontiguousarray(vertices.T)
    return (rows.take(faces[:, i], axis=1) for i in range(3))


def _incidence(faces: np.ndarray, count: int) -> Any:
    """Sparse (V, F): 1 where a vertex belongs to a face."""
    from scipy.sparse import csr_array

    rows = faces.ravel()
    columns = np.repeat(np.arange(len(faces)), 3)
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, len(faces)))


def _side_by_side(faces: Sequence[np.ndarray], sizes: Sequence[int]) -> np.ndarray:
    """Faces of meshes of so many vertices as those of one."""
    offsets = np.cumsum([0, *sizes[:-1]])
    return np.concatenate([each + offset for each, offset in zip(faces, offsets, strict=True)])


def _of_each(operator: Any, vertices: np.ndarray) -> np.ndarray:
    """Applies a sparse (V', V) to vertices (K, V, 3)."""
    flat = operator @ np.ascontiguousarray(vertices.swapaxes(0, 1)).reshape(vertices.shape[1], -1)
    return np.asarray(flat.reshape(-1, len(vertices), 3).swapaxes(0, 1))


def _marks(rest: Sequence[np.ndarray], lookouts: Sequence[Any]) -> tuple[np.ndarray, Any]:
    """Numbers (M,) of vertices at least `MARK_M` apart in each of some meshes (V, 3), and how all lookouts, sparse (V', V) of each
    mesh, take after the nearest ones: sparse (V', M)."""
    from scipy.sparse import block_diag, csr_array
    from scipy.spatial import cKDTree

    numbers, carried = [], []
    offset = 0
    for points, lookout in zip(rest, lookouts, strict=True):
        near = cKDTree(points).query_ball_point(points, MARK_M)
        free, mine = np.ones(len(points), bool), []
        for vertex, around in enumerate(near):
            if free[vertex]:
                mine.append(vertex)
                free[around] = False
        away, nearest = cKDTree(points[mine]).query(points, k=min(3, len(mine)))
        weight = 1 / np.maximum(away.reshape(len(points), -1), 1e-6)
        weight /= weight.sum(axis=1, keepdims=True)
        row = np.repeat(np.arange(len(weight)), weight.shape[1])
        carried.append(lookout @ csr_array((weight.ravel(), (row, nearest.ravel())), shape=(len(weight), len(mine))))
        numbers.append(np.array(mine) + offset)
        offset += lookout.shape[0]
    return np.concatenate(numbers), block_diag(carried, format="csr").astype(np.float32)


def _adjacency(incidence: Any) -> Any:
    """Sparse (V, V): 1 where two vertices share an edge."""
    joined = (incidence @ incidence.T).tocsr()
    joined.setdiag(0)
    joined.eliminate_zeros()
    joined.data[:] = 1
    return joined.astype(np.float32)
