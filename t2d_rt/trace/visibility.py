"""Which parts of moving meshes an antenna sees: rays through the meshes themselves, traced with Mitsuba at a key rate.

Rebuilding a ray tracer's scene costs more than tracing it, so a chunk of key frames stands in one scene side by side, too far
apart to shade one another. Between key frames visibility fades smoothly: a part that pops would click across the spectrogram.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.types import MovingMesh

FACES_PER_SCENE = 250_000
# Rays start this far off the surface, so that the triangles they start from do not stop them.
LIFT_M = 2e-3


class Occlusion:
    """Visibility of the vertices of `meshes` from one point, self-occlusion and one another's shadow included.

    The keys lie at `rate_hz` from the meshes' first common time; the shadow's edge moves a hand's breadth between the keys of a
    fast limb at 25 Hz.
    """

    def __init__(
        self, meshes: Sequence[MovingMesh], viewpoint_m: np.ndarray, *, rate_hz: float, backend: Backend
    ) -> None:
        self._meshes = tuple(meshes)
        self._viewpoint = np.asarray(viewpoint_m, np.float64)
        start = max(m.times_s[0] for m in meshes)
        stop = min(m.times_s[-1] for m in meshes)
        count = max(2, int(np.ceil((stop - start) * rate_hz)) + 1)
        self._keys = np.linspace(start, stop, count)
        self._sizes = [len(m.rest) for m in meshes]
        self._chunks: OrderedDict[int, np.ndarray] = OrderedDict()
        self._scene = _Scene(meshes, backend)
        self._copies = self._scene.copies
        self._neighbours = [_adjacency(m) for m in meshes]

    def visibility(self, times_s: np.ndarray) -> list[np.ndarray]:
        """Fractions in 0..1 at times [s] (K,), one float32 array (K, V) for each mesh."""
        position = np.interp(times_s, self._keys, np.arange(len(self._keys)))
        before = np.minimum(position.astype(int), len(self._keys) - 2)
        u = (position - before)[:, None].astype(np.float32)
        fade = u * u * (3 - 2 * u)  # no kink at the keys
        keys, inverse = np.unique(np.concatenate([before, before + 1]), return_inverse=True)
        values = self._at_keys(keys)
        first, second = inverse[: len(before)], inverse[len(before) :]
        mixed = values[first] * (1 - fade) + values[second] * fade
        return np.split(mixed, np.cumsum(self._sizes)[:-1], axis=1)

    def _at_keys(self, keys: np.ndarray) -> np.ndarray:
        return np.stack([self._chunk(int(key) // self._copies)[int(key) % self._copies] for key in keys])

    def _chunk(self, number: int) -> np.ndarray:
        """Visibility float32 (copies or fewer, all vertices) of a chunk of keys; the last two chunks are kept."""
        if number not in self._chunks:
            first = number * self._copies
            self._chunks[number] = self.traced(self._keys[first : first + self._copies])
            while len(self._chunks) > 2:
                self._chunks.popitem(last=False)
        self._chunks.move_to_end(number)
        return self._chunks[number]

    def traced(self, times_s: np.ndarray) -> np.ndarray:
        """Visibility at just these times, float32 (K, all vertices); at most as many as stand in one scene."""
        places = [mesh.at(times_s) for mesh in self._meshes]
        vertices = np.concatenate(places, axis=1)
        normal = np.concatenate(
            [_vertex_normals(v, m.faces) for v, m in zip(places, self._meshes, strict=True)], axis=1
        )
        front = np.sum(normal * (self._viewpoint - vertices), axis=2) > 0
        seen = (self.clear(vertices, vertices, normal) & front).astype(np.float32)
        parts = []
        for part, lit, neighbours in zip(self._split(seen), self._split(front), self._neighbours, strict=True):
            # A vertex just beyond the horizon takes over from its neighbours this side of it: the horizon itself is the
            # facets' own cosine, not a shadow.
            count = (neighbours @ lit.T.astype(np.float32)).T
            beyond = (neighbours @ part.T).T / np.maximum(count, 1)
            parts.append(np.where(lit, part, beyond))
        return np.concatenate(parts, axis=1).astype(np.float32)

    def clear(self, vertices: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Whether nothing at vertices (K, V, 3) stands between points (K, Q, 3) on it, of given normals, and here: (K, Q)."""
        offset = self._viewpoint - points
        towards = offset / np.linalg.norm(offset, axis=2, keepdims=True)
        origins = points + LIFT_M * (towards + normals) - self._viewpoint
        missing = self._copies - len(vertices)
        vertices, origins = (np.concatenate([a, np.repeat(a[-1:], missing, axis=0)]) for a in (vertices, origins))
        return self._scene.clear(vertices - self._viewpoint, origins)[: self._copies - missing]

    def _split(self, values: np.ndarray) -> list[np.ndarray]:
        return np.split(values, np.cumsum(self._sizes)[:-1], axis=1)


class _Scene:
    """Copies of all meshes at several moments in one Mitsuba scene."""

    def __init__(self, meshes: Sequence[MovingMesh], backend: Backend) -> None:
        import mitsuba as mi

        if mi.variant() != backend.mitsuba_variant:
            mi.set_variant(backend.mitsuba_variant)
        self._mi: Any = mi
        offsets = np.cumsum([0, *(len(m.rest) for m in meshes)])
        faces = np.concatenate([m.faces + offset for m, offset in zip(meshes, offsets[:-1], strict=True)])
        self.copies = int(np.clip(FACES_PER_SCENE // len(faces), 1, 64))
        shifts = np.arange(self.copies)[:, None, None] * offsets[-1]
        mesh = mi.Mesh("body", int(self.copies * offsets[-1]), self.copies * len(faces))
        values = mi.traverse(mesh)
        values["faces"] = mi.UInt32((faces[None] + shifts).ravel().astype(np.uint32))
        values.update()
        self._scene = mi.load_dict({"type": "scene", "body": mesh})
        self._params = mi.traverse(self._scene)
        self._key = next(k for k in self._params.keys() if k.endswith("vertex_positions"))  # noqa: SIM118

    def clear(self, vertices: np.ndarray, origins: np.ndarray) -> np.ndarray:
        """Whether the way from origins to the coordinate origin is free of the meshes at vertices, both (K, V, 3): bool (K, V)."""
        mi = self._mi
        reach = 2.2 * float(np.abs(vertices).max())
        corner = np.stack(np.unravel_index(np.arange(self.copies), (4, 4, 4)), axis=1)
        shift = (corner * reach)[:, None, :]
        self._params[self._key] = mi.Float((vertices + shift).ravel().astype(np.float32))
        self._params.update()
        distance = np.linalg.norm(origins, axis=2)
        placed = (origins + shift).reshape(-1, 3)
        heading = (-origins / distance[..., None]).reshape(-1, 3)

        def point(values: np.ndarray) -> list[Any]:
            return [mi.Float(np.ascontiguousarray(values[:, axis], dtype=np.float32)) for axis in range(3)]

        ray = mi.Ray3f(mi.Point3f(*point(placed)), mi.Vector3f(*point(heading)))
        ray.maxt = mi.Float(distance.ravel().astype(np.float32))
        return ~self._scene.ray_test(ray).numpy().reshape(distance.shape)


def _vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area-weighted unit normals (K, V, 3) of vertices (K, V, 3)."""
    a, b, c = (vertices[:, faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    total = _incidence(faces, vertices.shape[1]) @ normal.transpose(1, 0, 2).reshape(len(faces), -1)
    total = total.reshape(vertices.shape[1], len(vertices), 3).transpose(1, 0, 2)
    return total / np.maximum(np.linalg.norm(total, axis=2, keepdims=True), 1e-30)


def _incidence(faces: np.ndarray, count: int) -> Any:
    """Sparse (V, F): 1 where a vertex belongs to a face."""
    from scipy.sparse import csr_array

    rows = faces.ravel()
    columns = np.repeat(np.arange(len(faces)), 3)
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, len(faces)))


def _adjacency(mesh: MovingMesh) -> Any:
    """Sparse (V, V): 1 where two vertices share an edge."""
    incidence = _incidence(mesh.faces, len(mesh.rest))
    joined = (incidence @ incidence.T).tocsr()
    joined.setdiag(0)
    joined.eliminate_zeros()
    joined.data[:] = 1
    return joined.astype(np.float32)
