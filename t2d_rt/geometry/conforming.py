"""From split levels to one conforming mesh: neighbouring faces share whole edges, and facets lie on the surface in the mean."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from t2d_rt.geometry.levels import Level, all_of_three, any_of_three, chords, complete, renamed_columns
from t2d_rt.geometry.subdivide import Csr
from t2d_rt.geometry.vectors import edge_cross


def grade(levels: list[Level]) -> None:
    """Neighbours differ by at most one level: who touches a split edge of level k has a red parent in level k - 1."""
    for k in range(len(levels) - 1, -1, -1):
        level = levels[k]
        level.split[level.mesh.topology.face_edges[level.red]] = True
        sides = level.split[level.mesh.topology.face_edges]
        level.red |= all_of_three(sides)
        if k:
            levels[k - 1].red[level.mesh.parent[any_of_three(sides)]] = True


def tree_masks(levels: list[Level]) -> Iterator[np.ndarray]:
    """Faces of each level that exist in the refined mesh, red or leaf."""
    yield np.ones(len(levels[0].mesh.topology.faces), bool)
    for coarse, fine in pairwise(levels):
        yield coarse.red[fine.mesh.parent]


@dataclass(frozen=True, slots=True)
class FinalFaces:
    """Final faces from one level."""

    faces: np.ndarray
    """Vertex ids, (N, 3)."""
    base: np.ndarray
    edges: np.ndarray
    """Edges of the level's face that each lies in, (N, 3)."""
    weights: np.ndarray
    """Weights of those edges' offsets in the mean depth below the surface, (N, 3)."""


_GREEN: dict[int, tuple[tuple[int, int, int], ...]] = {
    0: ((0, 1, 2),),
    1: ((0, 3, 2), (3, 1, 2)),
    2: ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    3: ((3, 1, 4), (3, 4, 2), (0, 3, 2)),
}
"""Triangles by code: corners 0, 1, 2, midpoints 3 of edge 01, 4 of 12. Case 2: diagonal from 0; case 3: from 2."""


def final_faces(level: Level, tree: np.ndarray) -> FinalFaces:
    """Faces that stay, closed towards finer neighbours: one split edge makes two faces, two make three."""
    chosen = np.flatnonzero(tree & ~level.red)
    sides = level.split[level.mesh.topology.face_edges[chosen]]
    case = sides.sum(axis=1)
    # rotate each face's corners so that its split edges come first: one split edge at 0, two at 0 and 1
    first = np.where(case == 1, sides.argmax(axis=1), np.where(case == 2, (sides.argmin(axis=1) + 1) % 3, 0))
    order = (first[:, None] + np.arange(3)) % 3
    faces = np.take_along_axis(level.mesh.topology.faces[chosen], order, axis=1)
    edges = np.take_along_axis(level.mesh.topology.face_edges[chosen], order, axis=1)
    a, b, c = (level.mesh.points[faces[:, j]] for j in range(3))
    from_2 = np.linalg.norm((a + b) / 2 - c, axis=1) < np.linalg.norm((b + c) / 2 - a, axis=1)
    case = np.where((case == 2) & from_2, 3, case)
    middles = level.middle_ids[edges] if len(level.middle_ids) else np.full_like(edges, -1)
    six = np.concatenate([level.mesh.ids[faces], middles], axis=1)
    picks = [(np.flatnonzero(case == kind), np.array(codes)) for kind, triples in _GREEN.items() for codes in triples]
    which = np.concatenate([pick for pick, _ in picks])
    return FinalFaces(
        np.concatenate([six[pick][:, codes] for pick, codes in picks]),
        level.mesh.base[chosen][which],
        edges[which],
        np.concatenate([np.repeat(_depth_weights(codes)[None], len(pick), axis=0) for pick, codes in picks]),
    )


def _depth_weights(codes: np.ndarray) -> np.ndarray:
    """Mean depth of a triangle in a parent face, as fractions of the parent edges' midpoint offsets o01, o12, o20, (3,).

    On a quadratic surface the offset of a chord with barycentric difference d is -sum_{i<j} d_i d_j o_ij, and a
    triangle lies below the surface by a third of the sum of its own three offsets (the mean of l_i l_j is 1/12).
    """
    barycentric = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5]])[codes]
    d = np.roll(barycentric, -1, axis=0) - barycentric
    return -(d * np.roll(d, -1, axis=1)).sum(axis=0) / 3


def displacement(
    levels: list[Level], parts: list[FinalFaces], points: np.ndarray, used: np.ndarray, fine: np.ndarray, total: int
) -> Csr:
    """Outward move of the used vertices from the vertices of all levels, (Vf, W); `points` (Vf, 3) at rest.

    A vertex moves by the area-weighted mean depth of the facets around it, so that sum_f A_f (mean move of f's
    vertices) = sum_f A_f depth_f: the volume behind the facets is right to O(h^4). Vertices on creases and boundaries
    stay.
    """
    from scipy import sparse

    crease = np.zeros(total, bool)
    for level in levels:
        crease[level.mesh.ids[level.mesh.topology.edges[level.mesh.crease]]] = True
        if len(level.middle_ids):
            made = level.middle_ids[level.mesh.crease]
            crease[made[made >= 0]] = True
    area = np.linalg.norm(edge_cross(points[fine]), axis=1)
    area_of_vertex = np.bincount(fine.ravel(), weights=np.repeat(area, 3), minlength=len(used))
    weight = np.where(crease[used], 0.0, 1 / np.maximum(area_of_vertex, 1e-300))
    move = sparse.csr_matrix((len(used), total))
    stops = np.cumsum([len(part.faces) for part in parts])
    for level, part, stop in zip(levels, parts, stops, strict=True):
        mine = slice(stop - len(part.faces), stop)
        count = len(part.faces)
        depth = sparse.csr_matrix(
            (part.weights.ravel(), part.edges.ravel(), np.arange(count + 1) * 3),
            shape=(count, len(level.mesh.topology.edges)),
        )
        corners = fine[mine].ravel()
        mean = sparse.csr_matrix(
            (weight[corners] * np.repeat(area[mine], 3), (corners, np.repeat(np.arange(count), 3))),
            shape=(len(used), count),
        )
        edges = np.zeros(len(level.mesh.topology.edges), bool)
        edges[part.edges] = True
        complete(level, edges)
        move = move + renamed_columns(
            mean @ depth @ (level.middle - chords(level.mesh.topology)), level.mesh.ids, total
        )
    # sums follow the order of storage, and what one limit gives must not depend on others by as much as a bit
    move.sort_indices()
    return move
