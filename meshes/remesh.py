"""Graded isotropic remeshing of a closed surface (Botsch and Kobbelt 2004), used when a body template is baked.

Edges are split, collapsed and flipped towards a size given at every place, vertices slide in the tangent plane and are
put back on the dense reference surface, so that the result is an even, well-shaped sample of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree


class Surface:
    """A dense closed triangle mesh that answers nearest-point queries."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self.vertices, self.faces = vertices, faces
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        self.normals = unit(np.cross(b - a, c - a))
        self._tree = cKDTree((a + b + c) / 3)

    def nearest(self, points: np.ndarray, normals: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Face index (N,) and barycentric coordinates (N, 3) of the nearest point that faces the same way."""
        candidates = self._tree.query(points, k=16)[1]
        corners = self.vertices[self.faces[candidates]]
        weights = nearest_barycentric(points[:, None], corners)
        distance = np.linalg.norm(np.einsum("nkc,nkcd->nkd", weights, corners) - points[:, None], axis=2)
        if normals is not None:
            distance += np.where(np.einsum("nkd,nd->nk", self.normals[candidates], normals) < 0.2, 1.0, 0.0)
        best = distance.argmin(1)
        rows = np.arange(len(points))
        return candidates[rows, best], weights[rows, best]

    def at(self, face: np.ndarray, weights: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
        """Values given at the vertices (positions by default), interpolated in the faces."""
        return np.einsum("nc,ncd->nd", weights, (self.vertices if values is None else values)[self.faces[face]])


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length one along the last axis."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area-weighted vertex normals (V, 3)."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(total, faces[:, i], face)
    return unit(total)


def nearest_barycentric(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (..., 3) of the point of a triangle (..., 3, 3) nearest to p (..., 3)."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    ab, ac, ap = b - a, c - a, p - a
    d00, d01, d11 = (ab * ab).sum(-1), (ab * ac).sum(-1), (ac * ac).sum(-1)
    d20, d21 = (ap * ab).sum(-1), (ap * ac).sum(-1)
    det = np.maximum(d00 * d11 - d01 * d01, 1e-30)
    v, w = (d11 * d20 - d01 * d21) / det, (d00 * d21 - d01 * d20) / det
    inside = np.stack([1 - v - w, v, w], -1)
    options, gaps = [inside], [np.where((inside >= 0).all(-1), 0.0, np.inf)]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, edge = corners[..., i, :], corners[..., j, :] - corners[..., i, :]
        s = np.clip(((p - start) * edge).sum(-1) / np.maximum((edge * edge).sum(-1), 1e-30), 0, 1)
        weights = np.zeros_like(inside)
        weights[..., i], weights[..., j] = 1 - s, s
        options.append(weights)
        gaps.append(np.linalg.norm(start + s[..., None] * edge - p, axis=-1) + 1e-15)
    best = np.stack(gaps).argmin(0)
    return np.take_along_axis(np.stack(options), best[None, ..., None], 0)[0]


class _Triangles:
    """Editable closed triangle mesh."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self.p: list[np.ndarray] = list(np.asarray(vertices, float))
        self.f: list[tuple[int, int, int] | None] = [tuple(map(int, t)) for t in faces]
        self.around: list[set[int]] = [set() for _ in self.p]
        for i, t in enumerate(self.f):
            for v in t:
                self.around[v].add(i)

    def edges(self) -> np.ndarray:
        f = self.arrays_faces()
        return np.unique(np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)

    def arrays_faces(self) -> np.ndarray:
        return np.array([t for t in self.f if t is not None])

    def ring(self, v: int) -> set[int]:
        return {u for i in self.around[v] for u in self.f[i]} - {v}

    def set_face(self, i: int, t: tuple[int, int, int] | None) -> None:
        for v in self.f[i] or ():
            self.around[v].discard(i)
        self.f[i] = t
        for v in t or ():
            self.around[v].add(i)

    def add_face(self, t: tuple[int, int, int]) -> None:
        self.f.append(None)
        self.set_face(len(self.f) - 1, t)

    def opposite(self, i: int, a: int, b: int) -> int:
        return next(v for v in self.f[i] if v != a and v != b)

    def split(self, a: int, b: int) -> None:
        m = len(self.p)
        self.p.append((self.p[a] + self.p[b]) / 2)
        self.around.append(set())
        for i in list(self.around[a] & self.around[b]):
            t = self.f[i]
            self.set_face(i, tuple(m if v == b else v for v in t))
            self.add_face(tuple(m if v == a else v for v in t))

    def collapse(self, a: int, b: int, longest: Callable[[np.ndarray, np.ndarray], bool]) -> bool:
        """Merge b into a at their midpoint where that keeps the topology and turns no face over."""
        if len(self.ring(a) & self.ring(b)) != 2 or min(len(self.around[a]), len(self.around[b])) < 4:
            return False
        if any(len(self.around[v]) < 5 for v in self.ring(a) & self.ring(b)):
            return False
        middle = (self.p[a] + self.p[b]) / 2
        shared = self.around[a] & self.around[b]
        if any(longest(middle, self.p[v]) for v in (self.ring(a) | self.ring(b)) - {a, b}):
            return False
        for i in (self.around[a] | self.around[b]) - shared:
            q = [self.p[v] for v in self.f[i]]
            r = [middle if v in (a, b) else self.p[v] for v in self.f[i]]
            old, new = np.cross(q[1] - q[0], q[2] - q[0]), np.cross(r[1] - r[0], r[2] - r[0])
            if old @ new < 0.5 * np.linalg.norm(old) * np.linalg.norm(new):
                return False
        for i in list(shared):
            self.set_face(i, None)
        for i in list(self.around[b]):
            self.set_face(i, tuple(a if v == b else v for v in self.f[i]))
        self.p[a] = middle
        return True

    def flip(self, a: int, b: int) -> None:
        """Turn edge a-b where the valences come nearer to six and the surface stays as it bends."""
        i, j = tuple(self.around[a] & self.around[b])
        t = self.f[i]
        if (t.index(b) - t.index(a)) % 3 != 1:
            i, j = j, i
        c, d = self.opposite(i, a, b), self.opposite(j, a, b)
        if d in self.ring(c):
            return
        valence = np.array([len(self.around[v]) for v in (a, b, c, d)])
        change = np.abs(valence + np.array([-1, -1, 1, 1]) - 6).sum() - np.abs(valence - 6).sum()
        if change >= 0 or min(valence[:2]) < 5:
            return
        pa, pb, pc, pd = (self.p[v] for v in (a, b, c, d))
        new = [np.cross(pd - pc, pb - pc), np.cross(pa - pc, pd - pc)]
        old = np.cross(pb - pa, pc - pa) + np.cross(pd - pa, pb - pa)
        if min(n @ old / (np.linalg.norm(n) * np.linalg.norm(old) + 1e-300) for n in new) < 0.6:
            return
        self.set_face(i, (c, d, b))
        self.set_face(j, (c, a, d))

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        f = self.arrays_faces()
        used, inverse = np.unique(f, return_inverse=True)
        return np.array(self.p)[used], inverse.reshape(f.shape)


def relax(
    vertices: np.ndarray, faces: np.ndarray, surface: Surface, size: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """One tangential smoothing step towards the size-weighted centre of the neighbours, then back onto the surface."""
    normals = vertex_normals(vertices, faces)
    corners = vertices[faces]
    centre = corners.mean(1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    weight = area / size(centre) ** 2
    total, sums = np.zeros(len(vertices)), np.zeros_like(vertices)
    for i in range(3):
        np.add.at(total, faces[:, i], weight)
        np.add.at(sums, faces[:, i], weight[:, None] * centre)
    step = sums / total[:, None] - vertices
    step -= (step * normals).sum(1, keepdims=True) * normals
    moved = vertices + 0.8 * step
    return surface.at(*surface.nearest(moved, normals))


def remesh(
    vertices: np.ndarray,
    faces: np.ndarray,
    surface: Surface,
    size: Callable[[np.ndarray], np.ndarray],
    rounds: int = 10,
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces whose edges have the length `size(points)` [m], (N, 3) -> (N,)."""
    for _ in range(rounds):
        mesh = _Triangles(vertices, faces)
        for a, b in mesh.edges()[_order(mesh, size, longest_first=True)]:
            if b in mesh.ring(a) and _relative(mesh, a, b, size) > 4 / 3:
                mesh.split(a, b)
        for a, b in mesh.edges()[_order(mesh, size, longest_first=False)]:
            if mesh.around[a] and mesh.around[b] and b in mesh.ring(a) and _relative(mesh, a, b, size) < 4 / 5:
                mesh.collapse(a, b, lambda p, q: np.linalg.norm(p - q) > 4 / 3 * float(size((p + q)[None] / 2)[0]))
        for a, b in mesh.edges():
            if b in mesh.ring(a):
                mesh.flip(a, b)
        vertices, faces = mesh.arrays()
        for _ in range(4):
            vertices = relax(vertices, faces, surface, size)
    return vertices, faces


def _order(mesh: _Triangles, size: Callable[[np.ndarray], np.ndarray], *, longest_first: bool) -> np.ndarray:
    edges, p = mesh.edges(), np.array(mesh.p)
    ratio = np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1) / size(p[edges].mean(1))
    return np.argsort(-ratio if longest_first else ratio)


def _relative(mesh: _Triangles, a: int, b: int, size: Callable[[np.ndarray], np.ndarray]) -> float:
    p, q = mesh.p[a], mesh.p[b]
    return float(np.linalg.norm(p - q) / size((p + q)[None] / 2)[0])
