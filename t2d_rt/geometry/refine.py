"""Red-green refinement on the butterfly surface: facets as small as the phase asks for, as one sparse matrix.

Every fine vertex is a vertex of a uniform butterfly level (`subdivide`), so all refinements of a mesh sample one and
the same curved surface, and fine vertices at any time are `operator @ coarse vertices`.

A facet is refined while its phase sagitta, at its centroid, exceeds the limit s. It is the mean of its edges'

    q = 2 k L^2 (|kappa| + 1/R) / 6

L an edge's length, kappa the normal curvature along it, R the range (for an equilateral facet on a sphere q is the same
on all edges); the edges with q > s are the ones split, so facets grow long where the surface is bent in one direction only.
kappa = 8 d / L^2 comes from the distance d of the edge's next midpoint from its chord: curvature is measured on the
surface that is sampled, at the scale of the edge, and needs no estimate from the coarse mesh.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import LastUsed
from t2d_rt.geometry.conforming import displacement, final_faces, grade, tree_masks
from t2d_rt.geometry.levels import Level, build_levels, edge_depths
from t2d_rt.geometry.subdivide import Csr, crease_corners, midpoints, sharp_edges, topology
from t2d_rt.geometry.vectors import edge_cross, lengths, unit

_curvatures = LastUsed[np.ndarray](8)


@dataclass(frozen=True, slots=True, kw_only=True)
class Refinement:
    """A finer mesh that is linear in the coarse one's vertices."""

    operator: Csr
    """Fine vertices = operator @ control points, (Vf, V); rows sum to 1."""
    faces: np.ndarray
    """Corners of fine triangles, oriented like the coarse ones, int32 (Ff, 3)."""
    base_face: np.ndarray
    """Coarse face that each fine face lies in, int32 (Ff,)."""
    linear: Csr
    """Carries a field of the coarse vertices (a visibility, say) linearly to the fine ones, (Vf, V); rows sum to 1."""
    middles: np.ndarray | None = None
    """Of curved triangles, vertices near the middles of edges 01, 12 and 20, int32 (Ff, 3); None: they are flat."""
    control: Csr | None = None
    """Control points = control @ coarse vertices, (V, V); None: these are their own."""
    key: str | None = None
    """Hash of all that it follows from, of one that is kept."""

    @property
    def nodes(self) -> np.ndarray:
        """Vertices of the fine triangles, corners first, (Ff, 3) or (Ff, 6)."""
        return self.faces if self.middles is None else np.concatenate([self.faces, self.middles], axis=1)

    def corner_normals(self, vertices: np.ndarray) -> np.ndarray:
        """Unit normals (Ff, C, 3) of fine triangles, at each corner of curved ones, for the coarse vertices (V, 3)."""
        places = self.at(vertices)
        corners = places[self.faces]
        if self.middles is None:
            return unit(edge_cross(corners))[:, None]
        after, before = np.roll(corners, -1, axis=1), np.roll(corners, 1, axis=1)
        bulge = 4 * places[self.middles] - 2 * (corners + after)
        return unit(np.cross(after - corners + bulge, before - corners + np.roll(bulge, 1, axis=1)))

    def flattened(self, vertices: np.ndarray) -> Refinement:
        """Flat triangles in place of curved ones: the corners, moved outward as in `displacement` so that facets lie on the surface
        in the mean where the coarse mesh has these vertices (V, 3)."""
        if self.middles is None:
            return self
        from scipy import sparse

        used, faces = np.unique(self.faces, return_inverse=True)
        faces = faces.reshape(-1, 3)
        count, nodes = len(faces), self.operator.shape[0]
        # The middles of the edges lie off the chords by o; a triangle lies below the surface by a third of the sum of its o.
        thirds = np.repeat([1 / 3, -1 / 3], 3)
        depth = sparse.csr_matrix(
            (
                np.tile(thirds, count),
                np.concatenate([self.middles, self.faces], axis=1).ravel(),
                6 * np.arange(count + 1),
            ),
            shape=(count, nodes),
        )
        area = np.repeat(lengths(edge_cross(self.at(vertices)[self.faces])), 3)
        fraction = area / np.bincount(faces.ravel(), weights=area)[faces.ravel()]
        mean = sparse.csr_matrix((fraction, (faces.ravel(), np.repeat(np.arange(count), 3))), shape=(len(used), count))
        return replace(
            self, operator=self.operator[used] + mean @ (depth @ self.operator), linear=self.linear[used],
            faces=faces.astype(np.int32), middles=None, key=None,
        )  # fmt: skip

    def controlled(self, vertices: np.ndarray) -> np.ndarray:
        """Control points (..., V, 3) of the coarse mesh's vertices (..., V, 3)."""
        if self.control is None:
            return vertices
        columns = np.moveaxis(vertices, -2, 0)
        found = self.control @ np.ascontiguousarray(columns).reshape(len(columns), -1)
        return np.moveaxis(found.reshape(columns.shape), 0, -2)

    def at(self, vertices: np.ndarray) -> np.ndarray:
        """Fine vertices (Vf, 3) of the coarse mesh's (V, 3)."""
        return np.asarray(self.operator @ self.controlled(vertices))


@dataclass(frozen=True, slots=True, kw_only=True)
class Tessellation:
    """How facets are laid on a surface, whatever their phase."""

    max_edge_m: float = math.inf
    """Greatest length of an edge [m], for surfaces over which something else than the phase varies."""
    displace: bool = True
    """Vertices are moved outward, so that facets lie on the surface in the mean."""


ON_THE_SURFACE = Tessellation()


def refine(
    rest: np.ndarray,
    faces: np.ndarray,
    *,
    wavenumber: float,
    range_m: float | np.ndarray,
    sagitta_rad: float | np.ndarray,
    crease_deg: float = 45.0,
    tessellation: Tessellation = ON_THE_SURFACE,
    max_faces: int = 2_000_000,
) -> Refinement:
    """Refine a mesh (V, 3), (F, 3) until facets have a phase sagitta of at most `sagitta_rad`.

    `wavenumber` k = 2 pi / lambda [rad/m]; `range_m` the least range R and `sagitta_rad` the limit s, each one number or
    one per vertex (V,). `crease_deg` as in `MovingMesh`.
    """
    (refinement,) = refinements(
        rest, faces, wavenumber=wavenumber, range_m=range_m, sagittas_rad=[sagitta_rad], crease_deg=crease_deg,
        tessellation=tessellation, max_faces=max_faces,
    )  # fmt: skip
    return refinement


def refinements(
    rest: np.ndarray,
    faces: np.ndarray,
    *,
    wavenumber: float,
    range_m: float | np.ndarray,
    sagittas_rad: Sequence[float | np.ndarray],
    crease_deg: float = 45.0,
    tessellation: Tessellation = ON_THE_SURFACE,
    max_faces: int = 2_000_000,
) -> list[Refinement]:
    """What `refine` gives for each limit alone; most of the work is the surface itself, which is the same for all of them."""
    rest, faces = np.asarray(rest, dtype=np.float64), np.asarray(faces)
    longest_m = tessellation.max_edge_m
    scale = _scale(rest, wavenumber, range_m, sagittas_rad, longest_m)
    levels, steps, linear_steps = build_levels(rest, faces, scale, crease_deg, longest_m, max_faces)
    operator, linear = _stack(steps, len(rest)), _stack(linear_steps, len(rest))
    alone = ([replace(each, split=each.split[i], red=each.red[i]) for each in levels] for i in range(len(sagittas_rad)))
    return [_refined(own, rest, operator, linear, tessellation.displace) for own in alone]


def _refined(levels: list[Level], rest: np.ndarray, operator: Csr, linear: Csr, displace: bool) -> Refinement:
    """The refinement for one limit, from what it marked in the levels and the matrices of all their vertices."""
    grade(levels)
    parts = [final_faces(level, finer) for level, finer in zip(levels, tree_masks(levels), strict=True)]
    corners_ids = np.concatenate([part.faces for part in parts])
    here = np.bincount(corners_ids.ravel(), minlength=operator.shape[0]) > 0
    used, fine = np.flatnonzero(here), (np.cumsum(here) - 1)[corners_ids]
    rows = operator[used]
    if displace:
        rows = rows + displacement(levels, parts, rows @ rest, used, fine, operator.shape[0]) @ operator
    return Refinement(
        operator=rows, faces=fine.astype(np.int32), linear=linear[used],
        base_face=np.concatenate([part.base for part in parts]).astype(np.int32),
    )  # fmt: skip


def curvature(rest: np.ndarray, faces: np.ndarray, crease_deg: float = 45.0) -> np.ndarray:
    """Mean over its edges of each vertex's normal curvature, without sign [1/m], (V,); measured as `refine` does.

    The last ones are kept, read-only: a body's is asked for when it is skinned and when its facets are counted.
    """
    key = hashlib.sha256(rest.tobytes()).digest(), hashlib.sha256(faces.tobytes()).digest(), rest.shape, crease_deg
    return _curvatures.get(key, lambda: _curvature(rest, faces, crease_deg))


def _curvature(rest: np.ndarray, faces: np.ndarray, crease_deg: float) -> np.ndarray:
    sharp = sharp_edges(rest, faces, crease_deg)
    mesh = topology(faces, len(rest), sharp)
    ends = rest[mesh.edges]
    offset = midpoints(mesh, crease_corners(rest, sharp, crease_deg), rest) @ rest - ends.mean(axis=1)
    bend = (
        8
        * edge_depths(mesh, offset, rest, np.ones(len(mesh.faces), bool))
        / ((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1)
    )
    found = np.bincount(mesh.edges.ravel(), weights=np.repeat(bend, 2), minlength=len(rest)) / mesh.valence
    found.setflags(write=False)
    return np.asarray(found)


def _scale(
    rest: np.ndarray, wavenumber: float, range_m: object, sagittas_rad: Sequence[object], max_edge_m: float
) -> np.ndarray:
    """Columns 1/R and, for each limit, 2 k / (6 s) per vertex, (V, 1 + B)."""
    if rest.ndim != 2 or rest.shape[1] != 3 or not np.isfinite(rest).all():
        raise InputError(f"rest must hold finite positions of shape (vertex, 3), got shape {rest.shape}")
    for name, value in (
        ("wavenumber", wavenumber), ("range_m", range_m), *(("sagitta_rad", limit) for limit in sagittas_rad),
        ("max_edge_m", max_edge_m),
    ):  # fmt: skip
        array = np.asarray(value, dtype=np.float64)
        if array.shape not in ((), (len(rest),)) or not (array > 0).all():
            raise InputError(f"{name} must be positive, one number or one per vertex ({len(rest)},), got {value}")
    columns = (
        1 / np.asarray(range_m, float),
        *(2 * wavenumber / (6 * np.asarray(limit, float)) for limit in sagittas_rad),
    )
    return np.stack([np.broadcast_to(column, (len(rest),)) for column in columns], axis=1)


def _stack(steps: list[Csr], vertex_count: int) -> Csr:
    """All vertices of all levels from the coarse ones: each step's rows act on the vertices made before it."""
    from scipy import sparse

    operator = sparse.identity(vertex_count, format="csr")
    for step in steps:
        operator = sparse.vstack([operator, step @ operator], format="csr")
    return operator
