"""Meshes that occlude: what the rays of every viewpoint have in common."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.geometry import SubdividedMesh, topology
from t2d_rt.geometry.vectors import cross, dot, norms, vector_product
from t2d_rt.types import MovingMesh

FACES_PER_SCENE, MOST_COPIES = 250_000, 64
"""Greatest number of faces in a ray tracer's scene of several instants, and greatest number of these instants."""
MARK_M = 0.06
"""Distance [m] of the vertices at which blockage by the static scene is sampled: its shadows have soft edges."""


@dataclass(frozen=True)
class PosedOccluders:
    """Meshes at some instants."""

    meshes: Occluders
    times_s: np.ndarray
    """The instants [s], (K,)."""
    vertices: np.ndarray
    """Vertices of all meshes [m], (K, V, 3)."""
    points: np.ndarray
    """Where visibility is sampled [m], (K, V', 3): the vertices, and those that the subdivision adds, mesh by mesh."""

    @cached_property
    def _corner_and_area(self) -> tuple[np.ndarray, np.ndarray]:
        """A corner of each face of the meshes, and its normal with twice its area as length, (3, F, K) each."""
        a, b, c = corners(self.vertices, self.meshes.faces)
        return a, np.stack(cross(b - a, c - a))

    @cached_property
    def _heights(self) -> np.ndarray:
        """Product of each face's normal with a corner of the face, (F, K): the face looks towards a place whose product with the
        normal is greater."""
        return np.asarray(dot(*self._corner_and_area))

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals at these points, weighted with the areas of the faces they belong to, (K, V', 3)."""
        return point_normals(self._corner_and_area[1], self.meshes.faces_of_points)

    def facing(self, places_m: Sequence[np.ndarray]) -> np.ndarray:
        """Which faces occlude from these places outside of the meshes, bool (K, F). Of closed parts whose faces look outward they
        are only those that face one of the places, for a ray that leaves a body crosses one of these."""
        corner, area = self._corner_and_area
        # Six times the volume of each part, from the tetrahedra over its faces: negative where it is turned inside out.
        middle = corner.mean(axis=1, keepdims=True)
        volumes = self.meshes.parts @ dot(corner - middle, area)
        occluding = ~self.meshes.closed[:, None] | (self.meshes.parts.T @ volumes <= 0)
        for place in places_m:
            occluding |= dot(area, place[:, None, None] - corner) >= 0
        return occluding.T

    @cached_property
    def boxes(self) -> np.ndarray:
        """Corners of boxes around each of the meshes [m], (K, M, 8, 3)."""
        of_meshes = np.split(self.vertices, self.meshes.starts[1:-1], axis=1)
        ends = np.stack([[mesh.min(axis=1), mesh.max(axis=1)] for mesh in of_meshes], axis=2)
        return np.stack([ends[corner, ..., range(3)].transpose(1, 2, 0) for corner in np.ndindex(2, 2, 2)], axis=2)

    def folds(self, instants: np.ndarray, mesh: int, place_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Edges of a mesh between faces that face a place (3,) [m] and others, or none: the index into `instants` (k,) of each
        edge, (E,), ascending, and its two ends [m], (2, E, 3), counter-clockwise around the faces as seen from there."""
        half_edges = self.meshes.half_edges[mesh]
        first, last = self.meshes.face_starts[mesh : mesh + 2]
        facing = dot(self._corner_and_area[1][:, first:last], place_m) >= self._heights[first:last]
        facing = np.ascontiguousarray(facing[:, instants].T)
        near, far = (facing.take(face - first, axis=1) for face in (half_edges.face, half_edges.twin_face))
        row, edge = np.nonzero(half_edges.border | (near & ~far))
        inward = ~near[row, edge]
        tail, head = half_edges.tail[edge], half_edges.head[edge]
        ends = np.stack([np.where(inward, head, tail), np.where(inward, tail, head)])
        return row, self.vertices[instants[row], ends]


class Occluders:
    """Meshes, and the points on them at which visibility is sampled: their vertices (a body's are 25 mm apart) and those that
    `subdivision` adds, which follow the mesh's own (`geometry.SubdividedMesh`)."""

    def __init__(self, meshes: Sequence[MovingMesh], *, subdivision: int = 0) -> None:
        self.meshes = tuple(meshes)
        self._subdivided = [SubdividedMesh.of(m.faces, len(m.rest), subdivision) for m in meshes]
        self._subdivision = subdivision

    @cached_property
    def faces(self) -> np.ndarray:
        """Faces of all meshes, numbered as those of one, (F, 3)."""
        return _side_by_side([m.faces for m in self.meshes], [len(m.rest) for m in self.meshes])

    @cached_property
    def starts(self) -> np.ndarray:
        """Number of the first vertex of each mesh, and number of all vertices, (M + 1,)."""
        return np.cumsum([0, *(len(m.rest) for m in self.meshes)])

    @cached_property
    def face_starts(self) -> np.ndarray:
        """Number of the first face of each mesh, and number of all faces, (M + 1,)."""
        return np.cumsum([0, *(len(m.faces) for m in self.meshes)])

    @cached_property
    def half_edges(self) -> list[_HalfEdges]:
        """Half-edges of each mesh."""
        return [_HalfEdges.of(*row) for row in zip(self.meshes, self.starts, self.face_starts, strict=False)]

    @cached_property
    def owner(self) -> np.ndarray:
        """Number of the mesh that each of the points belongs to, (V',)."""
        return np.repeat(np.arange(len(self.meshes)), self._sizes)

    @cached_property
    def closed(self) -> np.ndarray:
        """Which faces belong to a closed mesh, bool (F,)."""
        return np.concatenate([np.full(len(m.faces), _is_closed(m)) for m in self.meshes])

    @cached_property
    def parts(self) -> Any:
        """Sparse matrix (P, F), 1 where a face belongs to a part: faces that hang together by their vertices."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        of_faces = incidence(self.faces, int(self.faces.max(initial=-1)) + 1)
        count, part = connected_components(of_faces.T @ of_faces, directed=False)
        return csr_array((np.ones(len(part)), (part, np.arange(len(part)))), shape=(count, len(part)))

    @cached_property
    def of_bodies(self) -> bool:
        """Whether all meshes are bodies, which share a template's facets: their limbs are thicker than their vertices lie apart."""
        return all(mesh.refined_as is not None for mesh in self.meshes)

    @cached_property
    def copies(self) -> int:
        """Number of instants at which they are traced in one scene."""
        if not self.meshes:
            return MOST_COPIES
        return int(np.clip(FACES_PER_SCENE // (len(self.faces) * 2**self._subdivision), 1, MOST_COPIES))

    @cached_property
    def neighbours(self) -> Any:
        """Sparse matrix (V', V'), 1 where two points share an edge."""
        return _adjacency(self._incidence)

    @cached_property
    def are_vertices(self) -> np.ndarray:
        """Which of the points are vertices of the meshes, not added by the subdivision, bool (V',)."""
        counts = [(len(m.rest), size - len(m.rest)) for m, size in zip(self.meshes, self._sizes, strict=True)]
        return np.repeat(np.tile([True, False], len(counts)), np.ravel(counts))

    def beside(self, marked: np.ndarray) -> np.ndarray:
        """Which points, bool (K, V'), lie in faces of the meshes that have a `marked` vertex, of (K, V'), or a neighbour of one."""
        vertices = self._about @ marked[:, self.are_vertices].T.astype(np.float32) > 0
        return np.asarray((self._within @ vertices.astype(np.float32) > 0).T)

    @cached_property
    def _about(self) -> Any:
        """Sparse matrix (V, V), above 0 where two vertices of the meshes share an edge or are one."""
        from scipy.sparse import eye_array

        vertices = self._within.shape[1]
        return _adjacency(incidence(self.faces, vertices)) + eye_array(vertices, dtype=np.float32, format="csr")

    @cached_property
    def _within(self) -> Any:
        """Sparse matrix (V', V), above 0 where a point lies in a face of a vertex, or on its edges."""
        from scipy.sparse import block_diag

        return block_diag([refinement.operator for refinement in self._subdivided], format="csr")

    @cached_property
    def marks(self) -> tuple[np.ndarray, Any]:
        """Numbers (M,) of points about `MARK_M` apart, and the interpolation from these to all points, a sparse matrix (V', M)."""
        return _marks([m.rest for m in self.meshes], [refinement.operator for refinement in self._subdivided])

    def at(self, times_s: np.ndarray) -> PosedOccluders:
        """The meshes at times (K,) [s]."""
        posed = [mesh.at(times_s) for mesh in self.meshes]
        vertices = points = np.concatenate(posed, axis=1)
        if self._subdivision:
            subdivided = (_of_each(s.operator, p) for s, p in zip(self._subdivided, posed, strict=True))
            points = np.concatenate(list(subdivided), axis=1)
        return PosedOccluders(self, times_s, vertices, points)

    def marked(self, times_s: np.ndarray) -> np.ndarray:
        """Places of the `marks` at sample times (K,) [s], (K, M, 3) [m]."""
        parts = (self.at(times_s[first : first + self.copies]).points for first in range(0, len(times_s), self.copies))
        return np.concatenate([part[:, self.marks[0]] for part in parts])

    @cached_property
    def mark_of_face(self) -> np.ndarray:
        """Number of the nearest mark of each face, (F,)."""
        from scipy.spatial import cKDTree

        numbers, nearest_marks, ends = self.marks[0], [], np.cumsum([0, *self._sizes])
        for mesh, first, last in zip(self.meshes, ends, ends[1:], strict=False):
            begin, end = np.searchsorted(numbers, (first, last))
            _, nearest = cKDTree(mesh.rest[numbers[begin:end] - first]).query(mesh.rest[mesh.faces[:, 0]])
            nearest_marks.append(nearest + begin)
        return np.concatenate(nearest_marks)

    @cached_property
    def mark_reach_m(self) -> float:
        """Greatest distance [m] of any point of the meshes from a mark: in faces, and where skin stretches to twice its length."""
        edges = (mesh.rest[mesh.faces] - mesh.rest[np.roll(mesh.faces, 1, axis=1)] for mesh in self.meshes)
        return 2 * (MARK_M + max(float(np.linalg.norm(edge, axis=2).max()) for edge in edges))

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Values at all points (K, V'), mesh by mesh."""
        return np.split(values, np.cumsum(self._sizes)[:-1], axis=1)

    @property
    def point_count(self) -> int:
        """Number of points at which visibility is sampled."""
        return sum(self._sizes)

    @cached_property
    def _sizes(self) -> list[int]:
        return [refinement.operator.shape[0] for refinement in self._subdivided]

    @cached_property
    def subdivided_faces(self) -> np.ndarray:
        """Faces between all points, (F', 3)."""
        return _side_by_side([refinement.faces for refinement in self._subdivided], self._sizes)

    @cached_property
    def _incidence(self) -> Any:
        """Sparse matrix (V', F'), 1 where a point belongs to a face."""
        return incidence(self.subdivided_faces, sum(self._sizes))

    @cached_property
    def faces_of_points(self) -> Any:
        """Sparse matrix (V', F): how many of the equal parts of a face of the meshes each point belongs to."""
        from scipy.sparse import csr_array

        parts = len(self.subdivided_faces)
        of_part = np.arange(parts) // 4**self._subdivision  # those of a face stand together
        return self._incidence @ csr_array(
            (np.ones(parts), (np.arange(parts), of_part)), shape=(parts, len(self.faces))
        )


class _HalfEdges(NamedTuple):
    """Edges of a mesh's faces, each as its face runs along it, (H,); vertices and faces are numbered as those of all meshes."""

    tail: np.ndarray
    head: np.ndarray
    face: np.ndarray
    twin_face: np.ndarray
    """Face on the other side, (H,)."""
    border: np.ndarray
    """Whether there is no such face, bool (H,)."""

    @classmethod
    def of(cls, mesh: MovingMesh, first_vertex: int, first_face: int) -> _HalfEdges:
        # Vertices that lie in one place are one, or faces that share none would each have borders of their own; a face that is
        # there twice counts once, and one without area not at all.
        place = np.unique(mesh.rest.round(6), axis=0, return_inverse=True)[1].ravel()
        faces = place[mesh.faces]
        least = faces.argmin(axis=1)[:, None] + np.arange(3)
        rolled = np.take_along_axis(faces, least % 3, axis=1)
        _, once = np.unique(rolled, axis=0, return_index=True)
        once = np.sort(once[(np.diff(np.sort(faces[once], axis=1), axis=1) > 0).all(axis=1)])
        twin = topology(faces[once], len(mesh.rest)).twin
        tail, head = (numbers[once].ravel() + first_vertex for numbers in (mesh.faces, mesh.faces[:, [1, 2, 0]]))
        face = _instead_of_slivers(mesh.rest[mesh.faces[once]], twin)
        face = once[face].repeat(3) + first_face
        return cls(tail, head, face, face[twin], twin < 0)


SLIVER_M = 1e-6
"""Height [m] up to which faces face nowhere: the sign of their area is rounding."""


def _instead_of_slivers(corners_m: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Numbers (F,) of the faces by which each of the faces with corners (F, 3, 3) is taken to face a place or not.

    For all but slivers that is the face itself. A sliver is a seam, and goes with a neighbour: one that is no sliver where there is
    such a face, the one over the longest of its edges.
    """
    edges_m = np.roll(corners_m, -1, axis=1) - corners_m
    length_m = norms(edges_m)
    sliver = norms(vector_product(edges_m[:, 0], edges_m[:, 1])) <= SLIVER_M * length_m.max(axis=1)
    beyond = np.where(twin < 0, np.arange(len(twin)), twin).reshape(-1, 3) // 3
    neighbour = np.argmax(length_m + 1e3 * length_m.max() * ~sliver[beyond], axis=1)
    instead = np.where(sliver, beyond[np.arange(len(sliver)), neighbour], np.arange(len(sliver)))
    for _ in range(int(sliver.sum()).bit_length()):  # of slivers beside slivers; each step looks twice as far
        instead = instead[instead]
    return instead


def posed_vertex_normals(vertices: np.ndarray, faces: np.ndarray, of_faces: Any) -> np.ndarray:
    """Area-weighted unit normals (K, V, 3) of vertices (K, V, 3) [m]."""
    a, b, c = corners(vertices, faces)
    return point_normals(np.stack(cross(b - a, c - a)), of_faces)


def point_normals(areas: np.ndarray, of_faces: Any) -> np.ndarray:
    """Unit normals (K, V, 3) of points in faces, sparse (V, F); the faces' normals (3, F, K) have their weights as lengths."""
    total = np.stack([of_faces @ area for area in areas])
    return (total / np.maximum(np.sqrt((total**2).sum(axis=0)), 1e-30)).T


def corners(vertices: np.ndarray, faces: np.ndarray) -> Iterator[np.ndarray]:
    """The three corners of faces, each (3, F, K): whole rows of instants are read and worked on at a time."""
    rows = np.ascontiguousarray(vertices.T)
    return (rows.take(faces[:, i], axis=1) for i in range(3))


def incidence(faces: np.ndarray, count: int) -> Any:
    """Sparse matrix (V, F), 1 where a vertex belongs to a face."""
    from scipy.sparse import csr_array

    rows = faces.ravel()
    columns = np.repeat(np.arange(len(faces)), 3)
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, len(faces)))


def _adjacency(incidence: Any) -> Any:
    """Sparse matrix (V, V), 1 where two vertices share an edge."""
    joined = (incidence @ incidence.T).tocsr()
    joined.setdiag(0)
    joined.eliminate_zeros()
    joined.data[:] = 1
    return joined.astype(np.float32)


def _is_closed(mesh: MovingMesh) -> bool:
    """Whether every edge joins two faces of the same orientation."""
    return bool((topology(mesh.faces, len(mesh.rest)).twin >= 0).all())


def _side_by_side(faces: Sequence[np.ndarray], sizes: Sequence[int]) -> np.ndarray:
    """Faces of meshes with these numbers of vertices, numbered as those of one mesh."""
    offsets = np.cumsum([0, *sizes[:-1]])
    return np.concatenate([face + offset for face, offset in zip(faces, offsets, strict=True)])


def _of_each(operator: Any, vertices: np.ndarray) -> np.ndarray:
    """Applies a sparse matrix (V', V) to vertices (K, V, 3) and returns (K, V', 3)."""
    flat = operator @ np.ascontiguousarray(vertices.swapaxes(0, 1)).reshape(vertices.shape[1], -1)
    return np.asarray(flat.reshape(-1, len(vertices), 3).swapaxes(0, 1))


def _marks(rest: Sequence[np.ndarray], operators: Sequence[Any]) -> tuple[np.ndarray, Any]:
    """Numbers (M,) of vertices at least `MARK_M` apart in each of some meshes (V, 3) [m], and the interpolation from these to all
    vertices of the subdivided meshes, whose `operators` are sparse (V', V): a sparse matrix (V', M)."""
    from scipy.sparse import block_diag, csr_array
    from scipy.spatial import cKDTree

    numbers, carried = [], []
    offset = 0
    for points, operator in zip(rest, operators, strict=True):
        # The first vertex that is free becomes a mark and takes all within reach; the next one is the first that is left.
        near = cKDTree(points).query_ball_point(points, MARK_M)
        free, mine = np.ones(len(points), bool), []
        for vertex, neighbours in enumerate(near):
            if free[vertex]:
                mine.append(vertex)
                free[neighbours] = False
        away, nearest = cKDTree(points[mine]).query(points, k=min(3, len(mine)))
        weight = 1 / np.maximum(away.reshape(len(points), -1), 1e-6)
        weight /= weight.sum(axis=1, keepdims=True)
        row = np.repeat(np.arange(len(weight)), weight.shape[1])
        carried.append(operator @ csr_array((weight.ravel(), (row, nearest.ravel())), shape=(len(weight), len(mine))))
        numbers.append(np.array(mine) + offset)
        offset += operator.shape[0]
    return np.concatenate(numbers), block_diag(carried, format="csr").astype(np.float32)
