"""Loop's subdivision surface (Loop 1987) evaluated exactly: C2 but for isolated points, where it is C1.

Control points make the surface: around a face whose corners have six neighbours each it is a quartic box spline of twelve of them
(Stam 1998), elsewhere it is after some subdivisions. All of it is linear, so that one sparse matrix serves every pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.geometry.levels import all_of_three, any_of_three
from t2d_rt.geometry.subdivide import Csr, Topology, next_half, previous_half, split_in_four, topology

MOST_SUBDIVISIONS = 24
"""Of a face beside an irregular vertex; a point that close to it takes the vertex's own place."""
KEPT_MESHES = 8
"""Whose first subdivisions are kept, the last used ones: some 2 kB a face."""
INTERPOLATION_TERMS = 2
"""Of `control_points`. With 2, 3, 4, 8 terms, 25 000 facets of a walking body err by -27.6, -25.6, -25.3, -25.6 dB, and its volume
is 0.14, 0.02, 0.01 and 0 % too small."""


def control_points(faces: np.ndarray, vertex_count: int) -> Csr:
    """Control points = matrix (V, V) @ vertices of a closed mesh; their surface runs through the vertices, but for the mesh's
    finest detail.

    With L the matrix of limit positions, 1/L = sum over k of (1 - L)^k, taken to INTERPOLATION_TERMS. (1 - L)^terms of the vertices
    is left: next to nothing of what varies slowly over the mesh, and much of its roughness, which facets would have to follow.
    """
    from scipy import sparse

    mesh = _closed(faces, vertex_count)
    centre, ring = _limit_weights(mesh.valence)
    rest = sparse.diags_array(1 - centre) - sparse.diags_array(ring) @ _neighbours(mesh)
    one = sparse.eye_array(vertex_count, format="csr")
    total = one
    for _ in range(INTERPOLATION_TERMS - 1):
        total = one + rest @ total
    return sparse.csr_matrix(total)


def surface_rows(faces: np.ndarray, vertex_count: int, face: np.ndarray, weights: np.ndarray) -> Csr:
    """Places on the surface = matrix (N, V) @ control points; each row sums to 1.

    They lie in faces `face` (N,) of the mesh of control points, closed, at barycentric `weights` (N, 3).
    """
    from scipy import sparse

    kept = _levels(np.ascontiguousarray(faces, np.int64).tobytes(), vertex_count)
    found: list[tuple[np.ndarray, Csr]] = []
    number, level = np.arange(len(face)), kept[0]
    for depth in range(MOST_SUBDIVISIONS + 1):
        mesh, valence, operator = level.mesh, level.valence, level.operator
        corner, greatest = _greatest(weights)
        at_corner = (greatest == 1) | (depth == MOST_SUBDIVISIONS)
        regular = level.regular[face] & ~at_corner
        if at_corner.any():
            vertex, which = np.unique(mesh.faces[face[at_corner], corner[at_corner]], return_inverse=True)
            found.append((number[at_corner], (_limit_rows(mesh, valence, vertex) @ operator)[which]))
        if regular.any():
            found.append((number[regular], _box_spline(mesh, face[regular], weights[regular]) @ operator))
        left = ~(at_corner | regular)
        if not left.any():
            break
        number, face, weights = number[left], face[left], weights[left]
        level = kept[depth + 1] if depth + 1 < len(kept) else level.next_about(face)
        face, weights = _in_children(np.searchsorted(level.parents, face), weights)
    order = np.argsort(np.concatenate([numbers for numbers, _ in found]))
    return sparse.csr_matrix(sparse.vstack([rows for _, rows in found], format="csr")[order])


@dataclass(frozen=True, slots=True)
class _Level:
    """A mesh after some subdivisions, around some of its faces."""

    mesh: Topology
    valence: np.ndarray
    operator: Csr
    """Its control points from those of the mesh itself."""
    parents: np.ndarray
    """Faces of the level above that it has the children of, 4 f .. 4 f + 3 of the f-th one."""

    @property
    def regular(self) -> np.ndarray:
        """Which faces have corners of six neighbours each, bool (F,)."""
        return all_of_three((self.valence == 6)[self.mesh.faces])

    def next_about(self, face: np.ndarray) -> _Level:
        """The next level, around some faces (N,)."""
        mesh, parents, step, valence = _subdivided(self.mesh, self.valence, face)
        return _Level(mesh, valence, step @ self.operator, parents)


@lru_cache(maxsize=KEPT_MESHES)
def _levels(faces: bytes, vertex_count: int) -> list[_Level]:
    """A closed mesh, and what it becomes around its irregular vertices after one and two subdivisions: the same for all bodies of
    one mesh, and for all of their facets. Few places need more."""
    from scipy import sparse

    mesh = _closed(np.frombuffer(faces, np.int64).reshape(-1, 3), vertex_count)
    levels = [_Level(mesh, mesh.valence, sparse.eye_array(vertex_count, format="csr"), np.zeros(0, np.int64))]
    inside = np.arange(len(mesh.faces))  # around these all is there
    for _ in range(2):
        face = inside[~levels[-1].regular[inside]]
        if not len(face):
            break
        levels.append(levels[-1].next_about(face))
        inside = (4 * np.searchsorted(levels[-1].parents, face)[:, None] + np.arange(4)).ravel()
    return levels


def _closed(faces: np.ndarray, vertex_count: int) -> Topology:
    mesh = topology(faces, vertex_count)
    if mesh.sharp.any():
        raise InputError(
            f"a smooth surface needs a closed mesh, got {np.count_nonzero(mesh.sharp)} edges that do not join two faces"
        )
    return mesh


def _neighbours(mesh: Topology) -> Csr:
    """Sparse (V, V), 1 where an edge joins two vertices."""
    from scipy import sparse

    a, b = mesh.edges.T
    where = np.concatenate([a, b]), np.concatenate([b, a])
    return sparse.csr_array((np.ones(2 * len(a)), where), shape=(mesh.vertex_count, mesh.vertex_count))


def _next_weight(valence: np.ndarray) -> np.ndarray:
    """Weight of each neighbour in a vertex's place after a subdivision."""
    return (5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2) / valence


def _limit_weights(valence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of a vertex and of each neighbour in its place on the surface."""
    ring = 1 / (valence + 3 / (8 * _next_weight(valence)))
    return 1 - valence * ring, ring


def _limit_rows(mesh: Topology, valence: np.ndarray, vertex: np.ndarray) -> Csr:
    """Places on the surface of some vertices, (N, V)."""
    from scipy import sparse

    centre, ring = _limit_weights(valence[vertex])
    own = sparse.csr_array((centre, (np.arange(len(vertex)), vertex)), shape=(len(vertex), mesh.vertex_count))
    return own + sparse.diags_array(ring) @ _neighbours(mesh)[vertex]


def _subdivided(mesh: Topology, valence: np.ndarray, face: np.ndarray) -> tuple[Topology, np.ndarray, Csr, np.ndarray]:
    """What is around some faces (N,), subdivided: its topology, the faces that it has the children of, the matrix (V1, V) of its
    control points, and their valences.

    Only the faces that touch these are kept; of what that makes, all that their children's surface depends on is right.
    """
    from scipy import sparse

    touched = np.zeros(mesh.vertex_count, bool)
    touched[mesh.faces[face]] = True
    here = np.flatnonzero(any_of_three(touched[mesh.faces]))
    kept = np.unique(mesh.faces[here])
    part = topology(np.searchsorted(kept, mesh.faces[here]), len(kept))
    count, edges = len(kept), len(part.edges)
    ring = _next_weight(valence[kept])
    old = sparse.diags_array(1 - valence[kept] * ring) + sparse.diags_array(ring) @ _neighbours(part)
    edge, half = part.face_edges.ravel(), np.arange(part.faces.size)
    entries = (
        np.concatenate([np.full(2 * edges, 3 / 8), np.full(len(half), 1 / 8)]),
        (np.concatenate([np.repeat(np.arange(edges), 2), edge]),
         np.concatenate([part.edges.ravel(), part.faces.ravel()[previous_half(half)]])),
    )  # fmt: skip
    new = sparse.csr_array(entries, shape=(edges, count))
    chosen = sparse.csr_array((np.ones(count), (np.arange(count), kept)), shape=(count, mesh.vertex_count))
    children = topology(split_in_four(part.faces, count + part.face_edges), count + edges)
    step = sparse.vstack([old, new], format="csr") @ chosen
    return children, here, step, np.concatenate([valence[kept], np.full(edges, 6)])


def _in_children(face: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces and weights of the same places among the children, 4 f .. 4 f + 3 of face f."""
    rows, (corner, greatest) = np.arange(len(face)), _greatest(weights)
    inner = greatest < 0.5
    outer = 2 * weights
    outer[rows, corner] -= 1
    # The middle child's corners are the middles of edges 01, 12 and 20.
    return 4 * face + np.where(inner, 3, corner), np.where(inner[:, None], 1 - 2 * weights[:, [2, 0, 1]], outer)


def _greatest(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of three weights (N, 3) is the greatest, the first of equal ones, and its value, (N,) each; `argmax` takes ten times
    as long on so short an axis."""
    one = np.where(weights[:, 1] > weights[:, 0], 1, 0)
    value = np.maximum(weights[:, 0], weights[:, 1])
    return np.where(weights[:, 2] > value, 2, one), np.maximum(value, weights[:, 2])


@dataclass(frozen=True, slots=True)
class _Ring:
    """Twelve control points around faces (N,), in three kinds of one for each corner."""

    corner: np.ndarray
    """The corner i, (N, 3)."""
    across: np.ndarray
    """Beyond the edge from i to the next corner, (N, 3)."""
    before: np.ndarray
    """Neighbour of corner i alone, on the side of the corner before it, (N, 3)."""
    after: np.ndarray
    """The same on the side of the next corner, (N, 3)."""


def _ring(mesh: Topology, face: np.ndarray) -> _Ring:
    tail, twin = mesh.faces.ravel(), mesh.twin
    half = 3 * face[:, None] + np.arange(3)
    out, into = twin[half], twin[previous_half(half)]
    return _Ring(
        corner=mesh.faces[face],
        across=tail[previous_half(out)],
        before=tail[previous_half(twin[previous_half(into)])],
        after=tail[previous_half(twin[next_half(out)])],
    )


def _box_spline(mesh: Topology, face: np.ndarray, weights: np.ndarray) -> Csr:
    """Places in faces whose corners all have six neighbours, (N, V)."""
    from scipy import sparse

    u, v, w = (
        np.take(weights, [(k + i) % 3 for i in range(3)], axis=1) for k in range(3)
    )  # of each corner, of the next one and of the one before
    u2, v2, w2 = u * u, v * v, w * w
    corner = (
        6 * u2 * u2 + 24 * u2 * u * (v + w) + u2 * (24 * v2 + 60 * v * w + 24 * w2)
        + u * (8 * v2 * v + 36 * v2 * w + 36 * v * w2 + 8 * w2 * w)
        + v2 * v2 + 6 * v2 * v * w + 12 * v2 * w2 + 6 * v * w2 * w + w2 * w2
    )  # fmt: skip
    across = (
        u2 * u2 + 2 * u2 * u * w + 6 * u2 * u * v + 6 * u2 * v * w + 12 * u2 * v2
        + 6 * u * v2 * w + 6 * u * v2 * v + 2 * v2 * v * w + v2 * v2
    )  # fmt: skip
    before, after = u2 * u * (u + 2 * w), u2 * u * (u + 2 * v)
    ring = _ring(mesh, face)
    columns = np.concatenate([ring.corner, ring.across, ring.before, ring.after], axis=1)
    values = np.concatenate([corner, across, before, after], axis=1) / 12
    starts = 12 * np.arange(len(face) + 1)
    return sparse.csr_array((values.ravel(), columns.ravel(), starts), shape=(len(face), mesh.vertex_count))
