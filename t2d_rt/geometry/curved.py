"""Curved facets on Loop's surface: triangles of six nodes, the corners and a point near the middle of each edge.

Every node lies on one and the same surface (`loop`), whatever the facets' size: one of given barycentric coordinates in a face of
the mesh. Nodes at any time are `operator @ control @ vertices`.

Edges are split while a facet's phase sagitta exceeds the limit, as in `refine`; here that is the greatest phase by which a facet
bulges, and it may bulge a good deal, since its integral knows of it (docs/physics.md, eq. 30). Both facets beside an edge split it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from t2d_rt.geometry.loop import control_points, surface_rows
from t2d_rt.geometry.refine import Refinement
from t2d_rt.geometry.subdivide import Csr, too_many_faces, topology
from t2d_rt.geometry.vectors import edge_cross, lengths, unit

PARTS = 1 << 16
"""Barycentric coordinates are whole numbers that add up to this."""
MOST_LEVELS = 12
"""An edge is halved at most so often."""
LEAST_SPLIT = 0.5
"""An edge of a facet that is split is split with it where its own sagitta exceeds this fraction of the limit."""
MOST_WAVELENGTHS = 4.5
"""An edge is at most so long at a limit of 1 rad, and goes with the root of the limit: where a limb rotates, the phases of a long
facet part between surface frames."""
_SPLITS = (
    ((0, 1, 2),),
    ((0, 3, 2), (3, 1, 2)),
    ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    ((3, 1, 4), (3, 4, 2), (0, 3, 2)),
    ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
)
"""Triangles by code: corners 0, 1, 2, middles 3 of edge 01, 4 of 12, 5 of 20. Split is no edge, one, two (by either diagonal), or
three."""


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
    """Curved facets of a closed mesh (V, 3), (F, 3) for each limit, one number or one per vertex (V,); edges are no longer than
    `max_edge_m`, by default `MOST_WAVELENGTHS`."""
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
        """Facets for one limit."""
        count = len(self.mesh.faces)
        limits = np.broadcast_to(limit_rad, (len(self.points),))[self.mesh.faces]
        face, corners = np.arange(count), np.tile(PARTS * np.eye(3, dtype=np.int64), (count, 1, 1))
        known = _Nodes(self)
        nodes = known.numbers(face, corners)
        for _ in range(MOST_LEVELS):
            places = known.places[nodes]
            limit = (corners.mean(axis=1) / PARTS * limits[face]).sum(axis=1)
            wanted = _split(_edge_sagittas(nodes, known.places, wavenumber, range_m) / limit[:, None])
            longest = MOST_WAVELENGTHS * 2 * math.pi / wavenumber * np.sqrt(limit) if max_edge_m is None else max_edge_m
            edge = lengths(places[:, :3] - np.roll(places[:, :3], -1, axis=1))
            wanted |= edge > np.broadcast_to(longest, len(face))[:, None]
            flagged = np.zeros(len(known.places), bool)
            flagged[nodes[:, 3:][wanted]] = True
            split = flagged[nodes[:, 3:]]
            if not split.any():
                break
            same, parent, corners = _children(corners, places, split)
            face = face[parent]
            if len(face) > max_faces:
                raise too_many_faces(len(face), max_faces)
            # Facets that stay have numbers for all of their nodes.
            nodes = np.concatenate([nodes[parent[:same]], known.numbers(face[same:], corners[same:])])
        used, nodes = np.unique(nodes, return_inverse=True)
        nodes = nodes.reshape(-1, 6).astype(np.int32)
        operator, linear = known.rows(used)
        return Refinement(
            operator=operator, faces=nodes[:, :3], middles=nodes[:, 3:], base_face=face.astype(np.int32), linear=linear,
            control=self.control,
        )  # fmt: skip

    def ids(self, face: np.ndarray, place: np.ndarray) -> np.ndarray:
        """A number for each place, the same from all faces that it lies in: of the vertex, edge or face, and where in it."""
        mesh, zeros = self.mesh, place == 0
        count = zeros[:, 0].astype(np.int8) + zeros[:, 1] + zeros[:, 2]
        owner = mesh.vertex_count + len(mesh.edges) + face
        first, second = place[:, 0].copy(), np.where(count, 0, place[:, 1])
        on_vertex = np.flatnonzero(count == 2)
        # The corner is the one part that is not zero.
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
    """Nodes on a surface, each evaluated once."""

    def __init__(self, surface: _Surface) -> None:
        self._surface = surface
        self._ids = np.empty(0, np.int64)
        self._numbers = np.empty(0, np.int64)
        self._rows: list[tuple[Csr, Csr]] = []
        self.places = np.empty((0, 3))
        """At rest (N, 3)."""

    def numbers(self, face: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Numbers (N, 6) of the nodes of facets with `corners` (N, 3, 3) in faces (N,), corners first."""
        six = _with_middles(corners).reshape(-1, 3)
        face = np.repeat(face, 6)
        ids, first, inverse = _unique(self._surface.ids(face, six))
        at = np.minimum(np.searchsorted(self._ids, ids), max(len(self._ids) - 1, 0))
        new = np.ones(len(ids), bool) if not len(self._ids) else self._ids[at] != ids
        if new.any():
            self._add(ids[new], face[first[new]], six[first[new]])
        return np.asarray(self._numbers[np.searchsorted(self._ids, ids)][inverse.reshape(-1, 6)])

    def rows(self, numbers: np.ndarray) -> tuple[Csr, Csr]:
        """Rows of some nodes on the control points, and rows that are linear within the faces."""
        from scipy import sparse

        operator, linear = (sparse.vstack(each, format="csr")[numbers] for each in zip(*self._rows, strict=True))
        return operator, linear

    def _add(self, ids: np.ndarray, face: np.ndarray, place: np.ndarray) -> None:
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


def _unique(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values (N,) once each and in order, where each occurs first, and the place of each value among them (N,).

    `np.unique` sorts stably, which takes several times as long.
    """
    order = np.argsort(values)
    ordered = values[order]
    new = np.diff(ordered, prepend=ordered[:1] - 1) > 0
    starts, inverse = np.flatnonzero(new), np.empty_like(order)
    inverse[order] = np.cumsum(new) - 1
    return ordered[starts], np.minimum.reduceat(order, starts), inverse


def _with_middles(corners: np.ndarray) -> np.ndarray:
    """Corners (N, 3, 3) and the middles of their edges, (N, 6, 3)."""
    return np.concatenate([corners, (corners + np.roll(corners, -1, axis=1)) // 2], axis=1)


def _edge_sagittas(nodes: np.ndarray, places: np.ndarray, wavenumber: float, range_m: float) -> np.ndarray:
    """Phase sagittas q of edges 01, 12, 20 (N, 3) [rad] of all facets, their nodes numbered (N, 6) and at `places`, as in `refine`.

    Depth is along the surface's normal; that of a narrow facet would take its nodes' drift within the surface for curvature.
    """
    corners, middles = places[nodes[:, :3]], places[nodes[:, 3:]]
    ends = np.roll(corners, -1, axis=1)
    across = np.repeat(edge_cross(corners), 3, axis=0)
    sums = np.stack([np.bincount(nodes[:, :3].ravel(), each, len(places)) for each in across.T], axis=1)
    at_corners = unit(sums)[nodes[:, :3]]
    normal = unit(at_corners + np.roll(at_corners, -1, axis=1))
    depth = np.abs(np.einsum("nij,nij->ni", middles - (corners + ends) / 2, normal))
    return 2 * wavenumber / 6 * (8 * depth + ((ends - corners) ** 2).sum(axis=2) / range_m)


def _split(sagitta: np.ndarray) -> np.ndarray:
    """Edges to be split (N, 3), of facets whose edges have sagittas (N, 3) in units of the limit."""
    return (sagitta.mean(axis=1, keepdims=True) > 1) & (sagitta > LEAST_SPLIT)


def _children(corners: np.ndarray, places: np.ndarray, split: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
    """Facets that others with `corners` (N, 3, 3) fall into by their split edges (N, 3); nodes are at `places` (N, 6, 3).

    How many are not split, which come first; the facet that each lies in (M,); their corners (M, 3, 3).
    """
    count = split[:, 0].astype(np.int8) + split[:, 1] + split[:, 2]
    same, parents = np.flatnonzero(count == 0), np.flatnonzero(count)
    count, split, places = count[parents], split[parents], places[parents]
    # Corners are turned so that the split edges come first: one split edge at 0, two at 0 and 1.
    first = np.where(count == 1, split.argmax(axis=1), np.where(count == 2, (split.argmin(axis=1) + 1) % 3, 0))
    order, rows = (first[:, None] + np.arange(3)) % 3, np.arange(len(parents))[:, None]
    nodes, places = (
        _with_middles(corners[parents[:, None], order]),
        places[rows, np.concatenate([order, 3 + order], axis=1)],
    )
    from_2 = lengths(places[:, 3] - places[:, 2]) < lengths(places[:, 4] - places[:, 0])
    case = np.select([count < 2, count == 3, from_2], [count, 4, 3], 2)
    made = [(np.flatnonzero(case == kind), codes) for kind, all_of in enumerate(_SPLITS) for codes in all_of]
    return (
        len(same),
        np.concatenate([same, *(parents[pick] for pick, _ in made)]),
        np.concatenate([corners[same], *(nodes[pick][:, codes] for pick, codes in made)]),
    )
