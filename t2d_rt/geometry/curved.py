"""Curved facets on Loop's surface: triangles of six nodes, the corners and a point near the middle of each edge.

Every node lies on one and the same surface (`loop`), whatever the facets' size, and nodes at any time are
`operator @ control @ vertices`. Facets tile the surface as they tile the faces' planes, in barycentric coordinates: a corner may
lie on a neighbour's edge, where the two differ by as little as a facet differs from the surface.

A facet is split while its phase sagitta exceeds the limit, as in `refine`; here that is the greatest phase by which it bulges, and
a facet may bulge a good deal, since its integral knows of it (docs/physics.md, eq. 30).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from t2d_rt.geometry.loop import control_points, surface_rows
from t2d_rt.geometry.refine import Refinement
from t2d_rt.geometry.subdivide import Csr, topology, too_many_faces
from t2d_rt.geometry.vectors import edge_cross, lengths

PARTS = 1 << 16
"""Barycentric coordinates are whole numbers that add up to this."""
MOST_LEVELS = 12
"""An edge is halved at most so often."""
LEAST_SPLIT = 0.5
"""An edge of a facet that is split is split with it where its own sagitta exceeds this fraction of the limit."""
_FOUR = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))
_SPLITS: dict[int, tuple[tuple[int, int, int], ...]] = {
    1: ((0, 3, 2), (3, 1, 2)),
    2: ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    3: ((3, 1, 4), (3, 4, 2), (0, 3, 2)),
    4: _FOUR,
}
"""Triangles by code: corners 0, 1, 2, middles 3 of edge 01, 4 of 12, 5 of 20. Split are one edge, two by either diagonal, three."""


def curved_refinements(
    rest: np.ndarray,
    faces: np.ndarray,
    *,
    wavenumber: float,
    range_m: float,
    sagittas_rad: Sequence[float | np.ndarray],
    max_faces: int,
) -> list[Refinement]:
    """Curved facets of a closed mesh (V, 3), (F, 3) for each limit, one number or one per vertex (V,)."""
    surface = _Surface(np.asarray(rest, float), faces)
    return [surface.refined(wavenumber, range_m, np.asarray(limit, float), max_faces) for limit in sagittas_rad]


class _Surface:
    """Loop's surface through the vertices of a mesh at rest."""

    def __init__(self, rest: np.ndarray, faces: np.ndarray) -> None:
        self.mesh = topology(faces, len(rest))
        self.control = control_points(faces, len(rest))
        self.points = self.control @ rest

    def refined(self, wavenumber: float, range_m: float, limit_rad: np.ndarray, max_faces: int) -> Refinement:
        """Facets for one limit."""
        count = len(self.mesh.faces)
        limits = np.broadcast_to(limit_rad, (len(self.points),))[self.mesh.faces]
        face, corners = np.arange(count), np.tile(PARTS * np.eye(3, dtype=np.int64), (count, 1, 1))
        done = []
        for level in range(MOST_LEVELS + 1):
            rows, nodes, _ = self._nodes(face, corners)
            places = (rows @ self.points)[nodes]
            limit = (corners.mean(axis=1) / PARTS * limits[face]).sum(axis=1)
            split = _split(edge_sagittas(places, wavenumber, range_m) / limit[:, None])
            if level == MOST_LEVELS:
                split[:] = False
            stays = ~split.any(axis=1)
            done.append((face[stays], corners[stays]))
            face, corners = _children(face[~stays], corners[~stays], places[~stays], split[~stays])
            if not len(face):
                break
            if sum(len(each) for each, _ in done) + len(face) > max_faces:
                raise too_many_faces(len(face), max_faces)
        face, corners = (np.concatenate(each) for each in zip(*done, strict=True))
        rows, nodes, linear = self._nodes(face, corners)
        return Refinement(
            operator=rows, faces=nodes[:, :3].astype(np.int32), middles=nodes[:, 3:].astype(np.int32),
            base_face=face.astype(np.int32), linear=linear, control=self.control,
        )  # fmt: skip

    def _nodes(self, face: np.ndarray, corners: np.ndarray) -> tuple[Csr, np.ndarray, Csr]:
        """Nodes of facets with `corners` (N, 3, 3) in faces (N,): rows of each node, once, on the control points; numbers (N, 6),
        corners first; and rows that are linear within the faces."""
        from scipy import sparse

        six = np.concatenate([corners, (corners + np.roll(corners, -1, axis=1)) // 2], axis=1)
        face, place = np.repeat(face, 6), six.reshape(-1, 3)
        _, first, nodes = np.unique(self._keys(face, place), return_index=True, return_inverse=True)
        face, weights = face[first], place[first] / PARTS
        rows = surface_rows(self.mesh.faces, len(self.points), face, weights)
        entries = weights.ravel(), self.mesh.faces[face].ravel(), 3 * np.arange(len(face) + 1)
        linear = sparse.csr_matrix(entries, shape=(len(face), len(self.points)))
        linear.eliminate_zeros()
        return rows, nodes.reshape(-1, 6), linear

    def _keys(self, face: np.ndarray, place: np.ndarray) -> np.ndarray:
        """A number for each place, the same from all faces that it lies in: of the vertex, edge or face, and where in it."""
        mesh, zeros = self.mesh, place == 0
        vertices, rows = mesh.faces[face], np.arange(len(face))
        count = zeros.sum(axis=1)
        corner = place.argmax(axis=1)
        away = zeros.argmax(axis=1)
        one, two = (away + 1) % 3, (away + 2) % 3
        smaller = np.where(vertices[rows, one] < vertices[rows, two], one, two)
        owner = np.select(
            [count == 2, count == 1],
            [vertices[rows, corner], mesh.vertex_count + mesh.face_edges[face, one]],
            mesh.vertex_count + len(mesh.edges) + face,
        )
        along = np.select([count == 2, count == 1], [0, place[rows, smaller]], place[:, 0])
        across = np.where(count == 0, place[:, 1], 0)
        return (owner * (PARTS + 1) + along) * (PARTS + 1) + across


def edge_sagittas(places: np.ndarray, wavenumber: float, range_m: float) -> np.ndarray:
    """Phase sagittas q of edges 01, 12, 20 (N, 3) [rad] of facets' nodes (N, 6, 3), as in `refine`."""
    corners, middles = places[:, :3], places[:, 3:]
    ends = np.roll(corners, -1, axis=1)
    normal = edge_cross(corners)
    normal /= np.maximum(lengths(normal), 1e-300)[:, None]
    depth = np.abs(np.einsum("nij,nj->ni", middles - (corners + ends) / 2, normal))
    return 2 * wavenumber / 6 * (8 * depth + ((ends - corners) ** 2).sum(axis=2) / range_m)


def _split(sagitta: np.ndarray) -> np.ndarray:
    """Edges to be split (N, 3), of facets whose edges have sagittas (N, 3) in units of the limit."""
    return (sagitta.mean(axis=1, keepdims=True) > 1) & (sagitta > LEAST_SPLIT)


def _children(
    face: np.ndarray, corners: np.ndarray, places: np.ndarray, split: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Facets that others fall into by their split edges (N, 3), which are some, all nodes' `places` known (N, 6, 3)."""
    rows, count = np.arange(len(face))[:, None], split.sum(axis=1)
    # Corners are turned so that the split edges come first: one split edge at 0, two at 0 and 1.
    first = np.where(count == 1, split.argmax(axis=1), np.where(count == 2, (split.argmin(axis=1) + 1) % 3, 0))
    order = (first[:, None] + np.arange(3)) % 3
    corners, places = corners[rows, order], places[rows, np.concatenate([order, 3 + order], axis=1)]
    from_2 = lengths(places[:, 3] - places[:, 2]) < lengths(places[:, 4] - places[:, 0])
    case = np.select([count == 1, count == 3, from_2], [1, 4, 3], 2)
    six = np.concatenate([corners, (corners + np.roll(corners, -1, axis=1)) // 2], axis=1)
    made = [
        (pick, codes)
        for kind, all_of in _SPLITS.items()
        if len(pick := np.flatnonzero(case == kind))
        for codes in all_of
    ]
    if not made:
        return face[:0], corners[:0]
    return np.concatenate([face[pick] for pick, _ in made]), np.concatenate(
        [six[pick][:, codes] for pick, codes in made]
    )
