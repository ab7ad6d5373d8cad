"""Red-green refinement on the butterfly surface: facets as small as the phase asks for, as one sparse matrix.

Every fine vertex is a vertex of a uniform butterfly level (`subdivide`), so all refinements of a mesh sample one and
the same curved surface, and fine vertices at any time are `operator @ coarse vertices`.

A facet is refined while its phase sagitta, at its centroid, exceeds the limit s. It is the mean of its edges'

    q = 2 k L^2 (|kappa| + 1/R) / 6

L an edge's length, kappa the normal curvature along it, R the range (for an equilateral facet on a sphere q is the same
on all edges); the edges with q > s are the ones split, so facets grow long where the surface is bent in one direction only.
kappa = 8 d / L^2 comes from the distance d of the edge's next midpoint from its chord: curvature is measured on the
surface that is sampled, at the scale of the edge, and needs no estimate from the coarse mesh.

Split levels become one conforming mesh: neighbouring faces share whole edges, and facets lie on the surface in the mean. A mesh at
whose vertices visibility is sampled is split at the midpoints of its edges, and no vertex moves.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from t2d_rt.core.memory import LastUsed
from t2d_rt.geometry.levels import (
    ButterflyLevel,
    all_of_three,
    any_of_three,
    build_levels,
    chords,
    complete,
    edge_depths,
    renamed_columns,
)
from t2d_rt.geometry.subdivide import (
    SPLITS,
    Csr,
    crease_corners,
    in_children,
    midpoints,
    sharp_edges,
    split_edges_first,
    split_in_four,
    split_picks,
    topology,
)
from t2d_rt.geometry.vectors import edge_cross, norms, unit


def grade(levels: list[ButterflyLevel]) -> None:
    """Makes neighbouring faces differ by at most one level: faces that touch a split edge of level k get a red parent in level k -
    1."""
    # From the finest level down, so that what a level requires of the previous one is known when that one is processed.
    for k in range(len(levels) - 1, -1, -1):
        level = levels[k]
        level.split[level.topology.face_edges[level.red]] = True
        sides = level.split[level.topology.face_edges]
        level.red |= all_of_three(sides)
        if k:
            levels[k - 1].red[level.parent[any_of_three(sides)]] = True


def tree_masks(levels: list[ButterflyLevel]) -> Iterator[np.ndarray]:
    """For each level, which of its faces are in the refined mesh, split or not, bool (F,)."""
    yield np.ones(len(levels[0].topology.faces), bool)
    for coarse, fine in pairwise(levels):
        yield coarse.red[fine.parent]


@dataclass(frozen=True, slots=True)
class FinalFaces:
    """Faces of the refined mesh that come from one level."""

    faces: np.ndarray
    """Indices of the vertices, (N, 3)."""
    base: np.ndarray
    edges: np.ndarray
    """The three edges of the level's face in which each final face lies, (N, 3)."""
    weights: np.ndarray
    """Weights of the midpoint offsets of those edges in the mean depth of the final face below the surface, (N, 3)."""


def final_faces(level: ButterflyLevel, tree: np.ndarray) -> FinalFaces:
    """Faces that are not split further, with green closures towards finer neighbours: one split edge makes two faces, two make
    three."""
    chosen = np.flatnonzero(tree & ~level.red)
    sides = level.split[level.topology.face_edges[chosen]]
    case, order = split_edges_first(sides)
    faces = np.take_along_axis(level.topology.faces[chosen], order, axis=1)
    edges = np.take_along_axis(level.topology.face_edges[chosen], order, axis=1)
    a, b, c = (level.points[faces[:, j]] for j in range(3))
    from_2 = np.linalg.norm((a + b) / 2 - c, axis=1) < np.linalg.norm((b + c) / 2 - a, axis=1)
    case = np.where((case == 2) & from_2, 3, case)
    middles = level.middle_ids[edges] if len(level.middle_ids) else np.full_like(edges, -1)
    six = np.concatenate([level.ids[faces], middles], axis=1)
    picks = split_picks(case, SPLITS[:-1])  # faces all of whose edges are split are red
    which = np.concatenate([pick for pick, _ in picks])
    return FinalFaces(
        np.concatenate([six[pick][:, codes] for pick, codes in picks]),
        level.base[chosen][which],
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
    levels: list[ButterflyLevel],
    parts: list[FinalFaces],
    points: np.ndarray,
    used: np.ndarray,
    fine: np.ndarray,
    total: int,
) -> Csr:
    """Outward move of the used vertices from the vertices of all levels, (Vf, W); `points` (Vf, 3) at rest.

    A vertex moves by the area-weighted mean depth of the facets around it, so that sum_f A_f (mean move of f's
    vertices) = sum_f A_f depth_f: the volume behind the facets is right to O(h^4). Vertices on creases and boundaries
    stay.
    """
    from scipy import sparse

    crease = np.zeros(total, bool)
    for level in levels:
        crease[level.ids[level.topology.edges[level.crease]]] = True
        if len(level.middle_ids):
            middle_ids = level.middle_ids[level.crease]
            crease[middle_ids[middle_ids >= 0]] = True
    area = np.linalg.norm(edge_cross(points[fine]), axis=1)
    area_of_vertex = np.bincount(fine.ravel(), weights=np.repeat(area, 3), minlength=len(used))
    weight = np.where(crease[used], 0.0, 1 / np.maximum(area_of_vertex, 1e-300))
    # Offsets of midpoints (level.middle - chords) times weights are facets' depths; the area-weighted mean makes moves of these.
    move = sparse.csr_matrix((len(used), total))
    stops = np.cumsum([len(part.faces) for part in parts])
    for level, part, stop in zip(levels, parts, stops, strict=True):
        mine = slice(stop - len(part.faces), stop)
        count = len(part.faces)
        depth = sparse.csr_matrix(
            (part.weights.ravel(), part.edges.ravel(), np.arange(count + 1) * 3),
            shape=(count, len(level.topology.edges)),
        )
        corners = fine[mine].ravel()
        mean = sparse.csr_matrix(
            (weight[corners] * np.repeat(area[mine], 3), (corners, np.repeat(np.arange(count), 3))),
            shape=(len(used), count),
        )
        edges = np.zeros(len(level.topology.edges), bool)
        edges[part.edges] = True
        complete(level, edges)
        move = move + renamed_columns(mean @ depth @ (level.middle - chords(level.topology)), level.ids, total)
    # the order of storage determines the order of sums; so the result for one limit is the same whichever others there are
    move.sort_indices()
    return move


_curvatures = LastUsed[np.ndarray](8)


@dataclass(frozen=True, slots=True, kw_only=True)
class Refinement:
    """A finer mesh that is linear in the coarse one's vertices."""

    operator: Csr
    """Matrix from control points to fine vertices, (Vf, V); rows sum to 1."""
    faces: np.ndarray
    """Corners of the fine triangles, oriented like the coarse ones, int32 (Ff, 3)."""
    base_face: np.ndarray
    """Coarse face that each fine face lies in, int32 (Ff,)."""
    linear: Csr
    """Matrix that interpolates a field at the coarse vertices (such as visibility) linearly to the fine ones, (Vf, V); rows sum to
    1."""
    middles: np.ndarray | None = None
    """Vertices near the middles of edges 01, 12 and 20 of curved triangles, int32 (Ff, 3); None for flat triangles."""
    control: Csr | None = None
    """Matrix from coarse vertices to control points, (V, V); None where these are the same."""
    key: str | None = None
    """Hash of everything that determines the refinement, if it is in the disk cache; else None."""

    @property
    def nodes(self) -> np.ndarray:
        """Vertices of the fine triangles, corners first, (Ff, 3) for flat or (Ff, 6) for curved ones."""
        return self.faces if self.middles is None else np.concatenate([self.faces, self.middles], axis=1)

    def corner_normals(self, vertices: np.ndarray) -> np.ndarray:
        """Unit normals (Ff, C, 3) of fine triangles (C = 1), or at the corners of curved ones (C = 3), for coarse vertices (V,
        3)."""
        places = self.at(vertices)
        corners = places[self.faces]
        if self.middles is None:
            return unit(edge_cross(corners))[:, None]
        after, before = np.roll(corners, -1, axis=1), np.roll(corners, 1, axis=1)
        bulge = 4 * places[self.middles] - 2 * (corners + after)
        return unit(np.cross(after - corners + bulge, before - corners + np.roll(bulge, 1, axis=1)))

    def flattened(self, vertices: np.ndarray) -> Refinement:
        """A refinement with flat triangles in place of curved ones: the corners are moved outward as in `displacement`, so that
        facets lie on the surface in the mean for these coarse vertices (V, 3)."""
        if self.middles is None:
            return self
        from scipy import sparse

        used, faces = np.unique(self.faces, return_inverse=True)
        faces = faces.reshape(-1, 3)
        count, nodes = len(faces), self.operator.shape[0]
        # The middle of an edge is off its chord by o; a triangle lies below the surface by a third of the sum of its three o.
        thirds = np.repeat([1 / 3, -1 / 3], 3)
        offsets = np.concatenate([self.middles, self.faces], axis=1).ravel()
        depth = sparse.csr_matrix((np.tile(thirds, count), offsets, 6 * np.arange(count + 1)), shape=(count, nodes))
        area = np.repeat(norms(edge_cross(self.at(vertices)[self.faces])), 3)
        fraction = area / np.bincount(faces.ravel(), weights=area)[faces.ravel()]
        mean = sparse.csr_matrix((fraction, (faces.ravel(), np.repeat(np.arange(count), 3))), shape=(len(used), count))
        operator = self.operator[used] + mean @ (depth @ self.operator)
        flat = faces.astype(np.int32)
        return replace(self, operator=operator, linear=self.linear[used], faces=flat, middles=None, key=None)

    def controlled(self, vertices: np.ndarray) -> np.ndarray:
        """Control points (..., V, 3) for coarse vertices (..., V, 3)."""
        if self.control is None:
            return vertices
        columns = np.moveaxis(vertices, -2, 0)
        control_points = self.control @ np.ascontiguousarray(columns).reshape(len(columns), -1)
        return np.moveaxis(control_points.reshape(columns.shape), 0, -2)

    def at(self, vertices: np.ndarray) -> np.ndarray:
        """Fine vertices (Vf, 3) for coarse vertices (V, 3)."""
        return np.asarray(self.operator @ self.controlled(vertices))


def refinements(
    rest: np.ndarray,
    faces: np.ndarray,
    *,
    wavenumber: float,
    range_m: float | np.ndarray,
    sagittas_rad: Sequence[float | np.ndarray],
    crease_deg: float = 45.0,
    displace: bool = True,
    max_faces: int = 2_000_000,
) -> list[Refinement]:
    """Refines a mesh (V, 3), (F, 3) until the phase sagitta of its facets is at most a limit; one refinement for each of several
    limits.

    `wavenumber` k = 2 pi / lambda [rad/m]; `range_m`: least range R; each of `sagittas_rad` is a limit s, one number or one per
    vertex (V,). `crease_deg` as in `MovingMesh`. Without `displace` vertices stay on the butterfly surface; with it they are moved
    outward, so that facets lie on it in the mean. Each result is the one that its limit alone would give; most of the work is the
    surface itself, which is the same for all limits. Raises an InputError for values that are not positive, or if more than
    `max_faces` are needed.
    """
    rest, faces = np.asarray(rest, dtype=np.float64), np.asarray(faces)
    scale = _scale(rest, wavenumber, range_m, sagittas_rad)
    levels, steps, linear_steps = build_levels(rest, faces, scale, crease_deg, max_faces)
    operator, linear = _stack(steps, len(rest)), _stack(linear_steps, len(rest))
    alone = (
        [replace(level, split=level.split[i], red=level.red[i]) for level in levels] for i in range(len(sagittas_rad))
    )
    return [_refined(limit_levels, rest, operator, linear, displace) for limit_levels in alone]


def _refined(levels: list[ButterflyLevel], rest: np.ndarray, operator: Csr, linear: Csr, displace: bool) -> Refinement:
    """The refinement for one limit, from the marked edges and faces of the levels and the matrices for all their vertices."""
    grade(levels)
    parts = [final_faces(level, finer) for level, finer in zip(levels, tree_masks(levels), strict=True)]
    corners_ids = np.concatenate([part.faces for part in parts])
    here = np.bincount(corners_ids.ravel(), minlength=operator.shape[0]) > 0
    used, fine = np.flatnonzero(here), (np.cumsum(here) - 1)[corners_ids]
    rows = operator[used]
    if displace:
        rows = rows + displacement(levels, parts, rows @ rest, used, fine, operator.shape[0]) @ operator
    return Refinement(
        operator=rows,
        faces=fine.astype(np.int32),
        base_face=np.concatenate([part.base for part in parts]).astype(np.int32),
        linear=linear[used],
    )


def curvature(rest: np.ndarray, faces: np.ndarray, crease_deg: float = 45.0) -> np.ndarray:
    """Mean magnitude of the normal curvature over the edges of each vertex [1/m], (V,); measured as `refine` does.

    The last results are cached, read-only: the curvature of a body is needed both when it is skinned and when its facets are
    counted.
    """
    key = hashlib.sha256(rest.tobytes()).digest(), hashlib.sha256(faces.tobytes()).digest(), rest.shape, crease_deg
    return _curvatures.get(key, partial(_curvature, rest, faces, crease_deg))


def _curvature(rest: np.ndarray, faces: np.ndarray, crease_deg: float) -> np.ndarray:
    """Computes `curvature`: kappa = 8 d / L^2 of each edge, d the depth of its chord's middle below the butterfly surface."""
    sharp = sharp_edges(rest, faces, crease_deg)
    mesh = topology(faces, len(rest), sharp)
    ends = rest[mesh.edges]
    offset = midpoints(mesh, crease_corners(rest, sharp, crease_deg), rest) @ rest - ends.mean(axis=1)
    depth = edge_depths(mesh, offset, rest, np.ones(len(mesh.faces), bool))
    bend = 8 * depth / ((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1)
    vertex_curvature = np.bincount(mesh.edges.ravel(), weights=np.repeat(bend, 2), minlength=len(rest)) / mesh.valence
    vertex_curvature.setflags(write=False)
    return np.asarray(vertex_curvature)


def _scale(rest: np.ndarray, wavenumber: float, range_m: object, sagittas_rad: Sequence[object]) -> np.ndarray:
    """For each vertex 1/R and, for each limit, 2 k / (6 s), (V, 1 + B)."""
    finenesses = [2 * wavenumber / (6 * np.asarray(limit, float)) for limit in sagittas_rad]
    columns = [1 / np.asarray(range_m, float), *finenesses]
    return np.stack([np.broadcast_to(column, (len(rest),)) for column in columns], axis=1)


def _stack(steps: list[Csr], vertex_count: int) -> Csr:
    """Matrix from the coarse vertices to all vertices of all levels; the rows of each step apply to the vertices made before it."""
    from scipy import sparse

    operator = sparse.identity(vertex_count, format="csr")
    for step in steps:
        operator = sparse.vstack([operator, step @ operator], format="csr")
    return operator


@dataclass(frozen=True, slots=True)
class SubdividedMesh:
    """A mesh subdivided `level` times; its first vertices are those of the original mesh."""

    faces: np.ndarray
    """Corners of the triangles, (4^n F, 3); those within one original face are contiguous."""
    operator: Csr
    """Sparse (V', V) from the original vertices to the new ones; also interpolates any field at the vertices."""
    level: int

    @classmethod
    def of(cls, faces: np.ndarray, vertex_count: int, level: int) -> SubdividedMesh:
        """Subdivides triangles (F, 3) of `vertex_count` vertices."""
        from scipy import sparse

        operator = sparse.eye_array(vertex_count, format="csr", dtype=np.float32)
        for _ in range(level):
            mesh = topology(faces, operator.shape[0])
            count = len(mesh.edges)
            ends = np.repeat(np.arange(count), 2), mesh.edges.ravel()
            half = sparse.csr_array((np.full(2 * count, 0.5, np.float32), ends), shape=(count, operator.shape[0]))
            faces = split_in_four(mesh.faces, operator.shape[0] + mesh.face_edges)
            operator = sparse.vstack([operator, half @ operator], format="csr")
        return cls(np.asarray(faces), operator, level)

    def to(self, fine: Refinement, faces: np.ndarray) -> Csr:
        """Sparse float32 (Vf, V') that interpolates a field at these vertices linearly to those of a refinement of the mesh
        `faces`."""
        from scipy import sparse

        rows = np.arange(fine.linear.shape[0])
        face = np.zeros(len(rows), np.int64)
        face[fine.nodes.ravel()] = np.repeat(fine.base_face, fine.nodes.shape[1])
        corners = faces[face]
        weights = np.asarray(fine.linear[np.repeat(rows, 3), corners.ravel()]).reshape(-1, 3)
        for _ in range(self.level):
            face, weights = in_children(face, weights)
        entries = weights.astype(np.float32).ravel(), (np.repeat(rows, 3), self.faces[face].ravel())
        return sparse.csr_array(entries, shape=(len(rows), self.operator.shape[0]))
