"""Curved facets on Loop's surface: triangles of six nodes, the corners and a point near the middle of each edge.

The surface is Loop's (1987), evaluated exactly: C2 but for isolated points, where it is C1. Around a face whose corners have six
neighbours each it is a quartic box spline of twelve control points (Stam 1998), elsewhere it is after some subdivisions. All of it
is linear, so that one sparse matrix serves every pose.

Every node lies on one and the same surface, whatever the facets' size: one of given barycentric coordinates in a face of
the mesh. Nodes at any time are `operator @ control @ vertices`.

Edges are split while a facet's phase sagitta exceeds the limit, as in `refine`; here that is the greatest phase by which a facet
bulges, and it may bulge a good deal, since its integral knows of it (docs/physics.md, eq. 30). Both facets beside an edge split it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.geometry.levels import all_of_three, any_of_three
from t2d_rt.geometry.refine import Refinement
from t2d_rt.geometry.subdivide import (
    SPLITS,
    Csr,
    Topology,
    distinct,
    greatest_of_three,
    in_children,
    next_half,
    previous_half,
    split_edges_first,
    split_in_four,
    split_picks,
    too_many_faces,
    topology,
)
from t2d_rt.geometry.vectors import edge_cross, norms, unit

MOST_SUBDIVISIONS = 24
"""Greatest number of subdivisions of a face at an irregular vertex; a point that is still closer to the vertex gets the vertex's
position."""
KEPT_MESHES = 8
"""Number of meshes whose first subdivisions are cached, at some 2 kB per face."""
INTERPOLATION_TERMS = 2
"""Number of terms in `control_points`. With 2, 3, 4 or 8 terms, 25 000 facets of a walking body have errors of -27.6, -25.6, -25.3
and -25.6 dB, and the volume is 0.14, 0.02, 0.01 and 0 % too small."""


def control_points(faces: np.ndarray, vertex_count: int) -> Csr:
    """Matrix (V, V) from the vertices of a closed mesh to control points whose surface passes through the vertices, except for the
    finest detail of the mesh.

    With L the matrix of limit positions, 1/L = sum over k of (1 - L)^k, truncated to INTERPOLATION_TERMS. The remainder is (1 -
    L)^terms of the vertices: almost nothing of what varies slowly over the mesh, and much of its roughness, which facets would
    otherwise have to follow.
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
    """Matrix (N, V) from control points to points on the surface; each row sums to 1.

    The points lie in the faces `face` (N,) of the closed mesh of control points, at barycentric coordinates `weights` (N, 3).
    """
    from scipy import sparse

    levels = _levels(np.ascontiguousarray(faces, np.int64).tobytes(), vertex_count)
    blocks: list[tuple[np.ndarray, Csr]] = []
    number, level = np.arange(len(face)), levels[0]
    for depth in range(MOST_SUBDIVISIONS + 1):
        mesh, valence, operator = level.mesh, level.valence, level.operator
        corner, greatest = greatest_of_three(weights)
        at_corner = (greatest == 1) | (depth == MOST_SUBDIVISIONS)
        regular = level.regular[face] & ~at_corner
        if at_corner.any():
            vertex, which = np.unique(mesh.faces[face[at_corner], corner[at_corner]], return_inverse=True)
            blocks.append((number[at_corner], (_limit_rows(mesh, valence, vertex) @ operator)[which]))
        if regular.any():
            blocks.append((number[regular], _box_spline(mesh, face[regular], weights[regular]) @ operator))
        left = ~(at_corner | regular)
        if not left.any():
            break
        number, face, weights = number[left], face[left], weights[left]
        level = levels[depth + 1] if depth + 1 < len(levels) else level.next_about(face)
        face, weights = in_children(np.searchsorted(level.parents, face), weights)
    order = np.argsort(np.concatenate([numbers for numbers, _ in blocks]))
    return sparse.csr_matrix(sparse.vstack([rows for _, rows in blocks], format="csr")[order])


@dataclass(frozen=True, slots=True)
class _Level:
    """A mesh after some subdivisions, restricted to the neighbourhood of some of its faces."""

    mesh: Topology
    valence: np.ndarray
    operator: Csr
    """Matrix from the control points of the original mesh to those of this level."""
    parents: np.ndarray
    """Faces of the level above whose children this level has: those of the f-th one are 4 f .. 4 f + 3."""

    @property
    def regular(self) -> np.ndarray:
        """Whether all corners of each face have six neighbours, bool (F,)."""
        return all_of_three((self.valence == 6)[self.mesh.faces])

    def next_about(self, face: np.ndarray) -> _Level:
        """The next level around some faces (N,).

        Only faces that touch these are subdivided. Vertices at the margin are wrong, but nothing that determines the surface within
        the children of these faces.
        """
        from scipy import sparse

        mesh = self.mesh
        touched = np.zeros(mesh.vertex_count, bool)
        touched[mesh.faces[face]] = True
        here = np.flatnonzero(any_of_three(touched[mesh.faces]))
        vertices = np.unique(mesh.faces[here])
        part, valence = topology(np.searchsorted(vertices, mesh.faces[here]), len(vertices)), self.valence[vertices]
        count, edges, half = len(vertices), len(part.edges), np.arange(part.faces.size)
        ring = _next_weight(valence)
        old = sparse.diags_array(1 - valence * ring) + sparse.diags_array(ring) @ _neighbours(part)
        weights = np.concatenate([np.full(2 * edges, 3 / 8), np.full(len(half), 1 / 8)])
        rows = np.concatenate([np.repeat(np.arange(edges), 2), part.face_edges.ravel()])
        columns = np.concatenate([part.edges.ravel(), part.faces.ravel()[previous_half(half)]])
        new = sparse.csr_array((weights, (rows, columns)), shape=(edges, count))
        chosen = sparse.csr_array((np.ones(count), (np.arange(count), vertices)), shape=(count, mesh.vertex_count))
        step = sparse.vstack([old, new], format="csr") @ chosen
        children = topology(split_in_four(part.faces, count + part.face_edges), count + edges)
        return _Level(children, np.concatenate([valence, np.full(edges, 6)]), step @ self.operator, here)


@lru_cache(maxsize=KEPT_MESHES)
def _levels(faces: bytes, vertex_count: int) -> list[_Level]:
    """A closed mesh, and its first and second subdivision around irregular vertices; shared by all bodies with the same mesh. Few
    points on a surface need more levels."""
    from scipy import sparse

    mesh = _closed(np.frombuffer(faces, np.int64).reshape(-1, 3), vertex_count)
    levels = [_Level(mesh, mesh.valence, sparse.eye_array(vertex_count, format="csr"), np.zeros(0, np.int64))]
    inside = np.arange(len(mesh.faces))  # the whole mesh, around these faces
    for _ in range(2):
        face = inside[~levels[-1].regular[inside]]
        if not len(face):
            break
        levels.append(levels[-1].next_about(face))
        inside = (4 * np.searchsorted(levels[-1].parents, face)[:, None] + np.arange(4)).ravel()
    return levels


def _closed(faces: np.ndarray, vertex_count: int) -> Topology:
    """Topology of a closed mesh, every edge of which joins two faces; raises an InputError for any other."""
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
    """Weight of each neighbour in the position of a vertex after one subdivision, for vertices of a valence (N,)."""
    return (5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2) / valence


def _limit_weights(valence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of a vertex, and of each of its neighbours, in its position on the limit surface."""
    ring = 1 / (valence + 3 / (8 * _next_weight(valence)))
    return 1 - valence * ring, ring


def _limit_rows(mesh: Topology, valence: np.ndarray, vertex: np.ndarray) -> Csr:
    """Matrix (N, V) for the positions of some vertices on the limit surface."""
    from scipy import sparse

    centre, ring = _limit_weights(valence[vertex])
    at_centre = sparse.csr_array((centre, (np.arange(len(vertex)), vertex)), shape=(len(vertex), mesh.vertex_count))
    return at_centre + sparse.diags_array(ring) @ _neighbours(mesh)[vertex]


def _ring(mesh: Topology, face: np.ndarray) -> np.ndarray:
    """The twelve control points around each of some faces (N,), (N, 12), in four groups with one for each corner: the corner; the
    vertex beyond the edge to the next corner; the corner's other neighbours on the side of the previous corner, and of the next."""
    tail, twin = mesh.faces.ravel(), mesh.twin
    half = 3 * face[:, None] + np.arange(3)
    out, into = twin[half], twin[previous_half(half)]
    across = tail[previous_half(out)]
    before = tail[previous_half(twin[previous_half(into)])]
    after = tail[previous_half(twin[next_half(out)])]
    return np.concatenate([mesh.faces[face], across, before, after], axis=1)


def _box_spline(mesh: Topology, face: np.ndarray, weights: np.ndarray) -> Csr:
    """Matrix (N, V) for points in faces all of whose corners have six neighbours."""
    from scipy import sparse

    u, v, w = (
        np.take(weights, [(k + i) % 3 for i in range(3)], axis=1) for k in range(3)
    )  # for each corner: its own coordinate, that of the next corner and that of the previous one
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
    values = np.concatenate([corner, across, before, after], axis=1) / 12
    rows = values.ravel(), _ring(mesh, face).ravel(), 12 * np.arange(len(face) + 1)
    return sparse.csr_array(rows, shape=(len(face), mesh.vertex_count))


PARTS = 1 << 16
"""Sum of the integer barycentric coordinates that nodes have."""
MOST_LEVELS = 12
"""Greatest number of times that an edge is halved."""
LEAST_SPLIT = 0.5
"""Other edges of a facet that is split are split as well where their own sagitta exceeds this fraction of the limit."""
MOST_WAVELENGTHS = 4.5
"""Greatest length of an edge, in wavelengths, at a limit of 1 rad; it is proportional to the root of the limit. Where a limb
rotates, the phases within a longer facet would diverge between surface frames."""


def curved_refinements(
    rest: np.ndarray,
    faces: np.ndarray,
    *,
    wavenumber: float,
    range_m: float,
    sagittas_rad: Sequence[float | np.ndarray],
    max_faces: int,
    max_edge_m: float | None = None,
) -> list[Refinement]:
    """Curved facets of a closed mesh (V, 3), (F, 3) for each of some limits of the phase sagitta [rad], one number or one per
    vertex (V,). Edges are no longer than `max_edge_m`, by default `MOST_WAVELENGTHS`. Raises an InputError where a limit needs more
    than `max_faces`."""
    surface = _Surface(np.asarray(rest, float), faces)
    return [
        surface.refined(wavenumber, range_m, np.asarray(limit, float), max_faces, max_edge_m) for limit in sagittas_rad
    ]


class _Surface:
    """Loop's surface through the vertices of a mesh at rest."""

    def __init__(self, rest: np.ndarray, faces: np.ndarray) -> None:
        self.mesh = topology(faces, len(rest))
        self.control = control_points(faces, len(rest))
        self.points = self.control @ rest

    def refined(
        self, wavenumber: float, range_m: float, limit_rad: np.ndarray, max_faces: int, max_edge_m: float | None
    ) -> Refinement:
        """The facets for one limit."""
        count = len(self.mesh.faces)
        limits = np.broadcast_to(limit_rad, (len(self.points),))[self.mesh.faces]
        face, corners = np.arange(count), np.tile(PARTS * np.eye(3, dtype=np.int64), (count, 1, 1))
        node_table = _Nodes(self)
        nodes = node_table.numbers(face, corners)
        for _ in range(MOST_LEVELS):
            places = node_table.places[nodes]
            limit = (corners.mean(axis=1) / PARTS * limits[face]).sum(axis=1)
            too_curved = _split(_edge_sagittas(nodes, node_table.places, wavenumber, range_m) / limit[:, None])
            longest = MOST_WAVELENGTHS * 2 * math.pi / wavenumber * np.sqrt(limit) if max_edge_m is None else max_edge_m
            edge = norms(places[:, :3] - np.roll(places[:, :3], -1, axis=1))
            too_curved |= edge > np.broadcast_to(longest, len(face))[:, None]
            flagged = np.zeros(len(node_table.places), bool)
            flagged[nodes[:, 3:][too_curved]] = True
            split = flagged[nodes[:, 3:]]
            if not split.any():
                break
            same, parent, corners = _children(corners, places, split)
            face = face[parent]
            if len(face) > max_faces:
                raise too_many_faces(len(face), max_faces)
            # facets that stay have the indices of all their nodes
            nodes = np.concatenate([nodes[parent[:same]], node_table.numbers(face[same:], corners[same:])])
        used, nodes = np.unique(nodes, return_inverse=True)
        nodes = nodes.reshape(-1, 6).astype(np.int32)
        operator, linear = node_table.rows(used)
        return Refinement(
            operator=operator,
            faces=nodes[:, :3],
            middles=nodes[:, 3:],
            base_face=face.astype(np.int32),
            linear=linear,
            control=self.control,
        )

    def ids(self, face: np.ndarray, place: np.ndarray) -> np.ndarray:
        """An integer for each position on the surface, the same for all faces that share it: it encodes the vertex, edge or face
        and the position within."""
        mesh, zeros = self.mesh, place == 0
        count = zeros[:, 0].astype(np.int8) + zeros[:, 1] + zeros[:, 2]
        owner = mesh.vertex_count + len(mesh.edges) + face
        first, second = place[:, 0].copy(), np.where(count, 0, place[:, 1])
        on_vertex = np.flatnonzero(count == 2)
        # at a corner exactly one coordinate is not zero
        # A position with one zero coordinate is on an edge, with two it is on a vertex: both belong to several faces.
        owner[on_vertex] = mesh.faces[face[on_vertex], 2 - 2 * ~zeros[on_vertex, 0] - ~zeros[on_vertex, 1]]
        first[on_vertex] = 0
        on_edge = np.flatnonzero(count == 1)
        beyond = 2 - 2 * zeros[on_edge, 0] - zeros[on_edge, 1]
        one, two = (beyond + 1) % 3, (beyond + 2) % 3
        here = face[on_edge]
        smaller = np.where(mesh.faces[here, one] < mesh.faces[here, two], one, two)
        owner[on_edge] = mesh.vertex_count + mesh.face_edges[here, one]
        first[on_edge] = place[on_edge, smaller]
        return (owner * (PARTS + 1) + first) * (PARTS + 1) + second


class _Nodes:
    """Nodes on the surface, each evaluated only once."""

    def __init__(self, surface: _Surface) -> None:
        self._surface = surface
        self._ids = np.empty(0, np.int64)
        self._numbers = np.empty(0, np.int64)
        self._rows: list[tuple[Csr, Csr]] = []
        self.places = np.empty((0, 3))
        """Positions of the nodes at rest [m], (N, 3)."""

    def numbers(self, face: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Indices (N, 6) of the nodes of facets with `corners` (N, 3, 3) in faces (N,), corners first."""
        six = _with_middles(corners).reshape(-1, 3)
        face = np.repeat(face, 6)
        ids, order, starts, inverse = distinct(self._surface.ids(face, six))
        first = np.minimum.reduceat(order, starts)
        at = np.minimum(np.searchsorted(self._ids, ids), max(len(self._ids) - 1, 0))
        new = np.ones(len(ids), bool) if not len(self._ids) else self._ids[at] != ids
        if new.any():
            self._add(ids[new], face[first[new]], six[first[new]])
        return np.asarray(self._numbers[np.searchsorted(self._ids, ids)][inverse.reshape(-1, 6)])

    def rows(self, numbers: np.ndarray) -> tuple[Csr, Csr]:
        """For some nodes: rows of the matrix from control points, and rows that interpolate linearly within the faces."""
        from scipy import sparse

        operator, linear = (sparse.vstack(rows, format="csr")[numbers] for rows in zip(*self._rows, strict=True))
        return operator, linear

    def _add(self, ids: np.ndarray, face: np.ndarray, place: np.ndarray) -> None:
        """Evaluates new nodes with ids (N,) at barycentric positions (N, 3) in faces (N,); keeps the ids sorted for `numbers`."""
        from scipy import sparse

        surface, weights = self._surface, place / PARTS
        faces, shape = surface.mesh.faces, (len(face), len(surface.points))
        operator = surface_rows(faces, shape[1], face, weights)
        linear = sparse.csr_matrix(
            (weights.ravel(), faces[face].ravel(), 3 * np.arange(len(face) + 1)), shape, copy=True
        )
        linear.eliminate_zeros()
        self._rows.append((operator, linear))
        numbers = len(self.places) + np.arange(len(ids))
        self.places = np.concatenate([self.places, operator @ surface.points])
        ids, numbers = np.concatenate([self._ids, ids]), np.concatenate([self._numbers, numbers])
        order = np.argsort(ids)
        self._ids, self._numbers = ids[order], numbers[order]


def _with_middles(corners: np.ndarray) -> np.ndarray:
    """Corners (N, 3, 3) followed by the middles of the edges, (N, 6, 3)."""
    return np.concatenate([corners, (corners + np.roll(corners, -1, axis=1)) // 2], axis=1)


def _edge_sagittas(nodes: np.ndarray, places: np.ndarray, wavenumber: float, range_m: float) -> np.ndarray:
    """Phase sagittas of edges 01, 12, 20 of facets [rad], (N, 3), as in `refine`; nodes have indices (N, 6) into `places`.

    Depth is measured along the surface's normal: the normal of a narrow facet would make the drift of its nodes within the surface
    look like curvature.
    """
    corners, middles = places[nodes[:, :3]], places[nodes[:, 3:]]
    ends = np.roll(corners, -1, axis=1)
    across = np.repeat(edge_cross(corners), 3, axis=0)
    sums = np.stack([np.bincount(nodes[:, :3].ravel(), component, len(places)) for component in across.T], axis=1)
    at_corners = unit(sums)[nodes[:, :3]]
    normal = unit(at_corners + np.roll(at_corners, -1, axis=1))
    depth = np.abs(np.einsum("nij,nij->ni", middles - (corners + ends) / 2, normal))
    return 2 * wavenumber / 6 * (8 * depth + ((ends - corners) ** 2).sum(axis=2) / range_m)


def _split(sagitta: np.ndarray) -> np.ndarray:
    """Which edges are split, (N, 3), for facets whose edges have sagittas (N, 3) in units of the limit."""
    return (sagitta.mean(axis=1, keepdims=True) > 1) & (sagitta > LEAST_SPLIT)


def _children(corners: np.ndarray, places: np.ndarray, split: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
    """Divides facets with `corners` (N, 3, 3) by their split edges (N, 3); nodes are at `places` (N, 6, 3).

    Returns how many are not split, which come first; the facet that contains each new one (M,); their corners (M, 3, 3).
    """
    any_split = any_of_three(split)
    same, parents = np.flatnonzero(~any_split), np.flatnonzero(any_split)
    count, order = split_edges_first(split[parents])
    nodes = _with_middles(corners[parents[:, None], order])
    places = places[parents[:, None], np.concatenate([order, 3 + order], axis=1)]
    from_2 = norms(places[:, 3] - places[:, 2]) < norms(places[:, 4] - places[:, 0])
    case = np.select([count < 2, count == 3, from_2], [count, 4, 3], 2)
    picks = split_picks(case, SPLITS)
    return (
        len(same),
        np.concatenate([same, *(parents[pick] for pick, _ in picks)]),
        np.concatenate([corners[same], *(nodes[pick][:, codes] for pick, codes in picks)]),
    )
