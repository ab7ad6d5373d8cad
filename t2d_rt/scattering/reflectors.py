"""Targets' surfaces as rays meet them: facets of all targets together, with their true places and normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from t2d_rt.geometry import Refinement
from t2d_rt.geometry.vectors import norms, unit, vector_product
from t2d_rt.scattering.patches import Csr
from t2d_rt.scattering.refinement import apply_operator
from t2d_rt.types import MovingMesh

NEWTON_STEPS = 2
"""Number of Newton's steps along a ray from a flat facet to the curved one: the first leaves some 10 um of 0.4 mm."""
INWARD = 0.01
"""Points at a facet's rim are moved inside it by about this fraction of their spacing, because whether a ray meets what just ends
there would be a matter of rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reflector:
    """The surface of one target, which rays bounce off."""

    surface: MovingMesh
    facets: Refinement
    reflection: np.ndarray
    """Gamma of each facet's surface times the fraction of the field that stays coherent, complex (F,)."""


class Reflectors:
    """The facets of all targets, numbered through. A facet has vertices at corners 0, 1, 2 and, if it is curved, one near the
    middle of each edge."""

    def __init__(self, reflectors: Sequence[Reflector]) -> None:
        self._reflectors = reflectors
        counts = [target.facets.operator.shape[0] for target in reflectors]
        first = np.cumsum([0, *counts[:-1]])
        self.vertex_count = int(sum(counts))
        self.faces = np.concatenate(
            [target.facets.faces + start for target, start in zip(reflectors, first, strict=True)]
        )
        """Vertices at the corners of each facet, (F, 3)."""
        middles = [
            target.facets.faces if (numbers := target.facets.middles) is None else numbers for target in reflectors
        ]
        self._middles = np.concatenate([numbers + start for numbers, start in zip(middles, first, strict=True)])
        sizes = [len(target.facets.faces) for target in reflectors]
        self.curved = np.repeat([target.facets.middles is not None for target in reflectors], sizes)
        """Which facets are curved, bool (F,)."""
        self.reflection = np.concatenate([target.reflection.conjugate() for target in reflectors])
        """conj(`Reflector.reflection`) of each facet, as IF = tx conj(rx), complex (F,)."""
        self.rest = np.concatenate([target.facets.at(target.surface.rest) for target in reflectors])
        """Vertices at rest [m], (V, 3)."""
        self.target = np.repeat(np.arange(len(reflectors)), sizes)
        """The target that each facet belongs to, (F,)."""
        self._crease = np.repeat(
            [180.0 if target.facets.middles is not None else target.surface.crease_deg for target in reflectors], sizes
        )

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Vertices [m] (K, V, 3) at times (K,) [s]."""
        cages = (target.facets.controlled(target.surface.at(times_s)) for target in self._reflectors)
        posed = (
            apply_operator(target.facets.operator, cage) for target, cage in zip(self._reflectors, cages, strict=True)
        )
        return np.concatenate(list(posed)).swapaxes(0, 1)

    @cached_property
    def edge_m(self) -> np.ndarray:
        """Longest edge of each facet at rest [m], (F,)."""
        corners = self.rest[self.faces]
        return np.asarray(norms(corners - np.roll(corners, 1, axis=1)).max(axis=1))

    @cached_property
    def smooth(self) -> Csr:
        """Sparse matrix (3 F, 3 F) that sums the normals at facets' corners over those that meet there without a crease."""
        from scipy.sparse import csr_array

        slots, count = self.faces.ravel(), self.faces.size
        of_vertex = csr_array((np.ones(count), (np.arange(count), slots)), shape=(count, self.vertex_count))
        joined = (of_vertex @ of_vertex.T).tocoo()
        normal = np.repeat(unit(vector_product(*_edges(self.rest[self.faces]))), 3, axis=0)
        cosine = np.einsum("ni,ni->n", normal[joined.row], normal[joined.col])
        # A facet and those beside it are compared, so a mean over more than these is bent by no more than the crease.
        keep = (cosine > np.cos(np.radians(self._crease[joined.row // 3]))) | (joined.row == joined.col)
        return csr_array((np.ones(keep.sum()), (joined.row[keep], joined.col[keep])), shape=(count, count))

    @cached_property
    def neighbours(self) -> Csr:
        """Sparse matrix (F, F) that is not 0 where two facets share a corner."""
        from scipy.sparse import csr_array

        count = len(self.faces)
        of_vertex = csr_array(
            (np.ones(3 * count), (np.repeat(np.arange(count), 3), self.faces.ravel())),
            shape=(count, self.vertex_count),
        )
        return of_vertex @ of_vertex.T

    def posed(self, vertices: np.ndarray) -> PosedReflectors:
        """The facets in the pose with vertices (V, 3) [m]."""
        corners = vertices[self.faces]
        after = np.roll(corners, -1, axis=1)
        bulges = np.where(self.curved[:, None, None], 4 * vertices[self._middles] - 2 * (corners + after), 0)
        forward = after - corners + bulges
        backward = np.roll(corners, 1, axis=1) - corners + np.roll(bulges, 1, axis=1)
        across = vector_product(forward, backward).reshape(
            -1, 3
        )  # as long as the facet is large, which weights the mean
        return PosedReflectors(corners, bulges, unit(self.smooth @ across).reshape(-1, 3, 3))


@dataclass(frozen=True, slots=True)
class PosedReflectors:
    """Facets in one pose."""

    corners: np.ndarray
    """Corners [m], (F, 3, 3)."""
    bulges: np.ndarray
    """Four times the vector by which the middle of edges 01, 12, 20 lies off the chord [m], (F, 3, 3)."""
    normals: np.ndarray
    """Unit normals at the corners, (F, 3, 3)."""

    def places(self, face: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Places (N, 3) [m] in facets (N,) at barycentric coordinates (N, 3)."""
        pairs = weights * np.roll(weights, -1, axis=1)
        return _sum(weights, self.corners[face]) + _sum(pairs, self.bulges[face])

    def normals_at(self, face: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Unit normals (N, 3) of facets (N,) at barycentric coordinates (N, 3)."""
        return unit(_sum(weights, self.normals[face]))

    def on_surface(
        self, face: np.ndarray, weights: np.ndarray, origins: np.ndarray, directions: np.ndarray
    ) -> np.ndarray:
        """Barycentric coordinates (N, 3) where rays (N, 3) pierce the curved facets, from those where they pierce the flat ones.

        The facet is continued beyond its edges.
        """
        corners, bulges = self.corners[face], self.bulges[face]
        for _ in range(NEWTON_STEPS):
            following = np.roll(weights, -1, axis=1)
            place = _sum(weights, corners) + _sum(weights * following, bulges)
            # Derivatives by each coordinate; a bulge depends on two of them.
            slopes = corners + bulges * following[..., None] + np.roll(bulges * weights[..., None], 1, axis=1)
            u, v = slopes[:, 1] - slopes[:, 0], slopes[:, 2] - slopes[:, 0]
            offset = origins - place
            along_v, along_u = vector_product(v, directions), vector_product(directions, u)
            volume = dot(u, along_v)
            scale = 1 / np.where(np.abs(volume) > 1e-30, volume, np.inf)
            du, dv = dot(offset, along_v) * scale, dot(offset, along_u) * scale
            weights = weights + np.stack([-du - dv, du, dv], axis=1)
        return weights

    def coordinates(self, face: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Coordinates (N, 3) of places (N, 3) [m] in facets (N,): fractions of two edges, and the distance along the normal [m]."""
        first, u, v, normal = frames(self.corners[face])
        offset = places - first
        along_v, along_u = vector_product(v, normal), vector_product(normal, u)
        volume = dot(u, along_v)
        return np.stack([dot(offset, along_v) / volume, dot(offset, along_u) / volume, dot(offset, normal)], axis=-1)


def frames(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """First corners, two edges and unit normals, (..., 3) each, of triangles (..., 3, 3)."""
    u, v = _edges(corners)
    return corners[..., 0, :], u, v, unit(vector_product(u, v))


def carried_along(corners: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
    """Places (..., 3) [m] of `PosedReflectors.coordinates` (..., 3) in triangles (..., 3, 3) [m] as they are now."""
    first, u, v, normal = frames(corners)
    return first + coordinates[..., :1] * u + coordinates[..., 1:2] * v + coordinates[..., 2:] * normal


@dataclass(frozen=True, slots=True)
class Lattice:
    """Triangles on facets, fixed in them, with points at their corners and at the middles of their edges."""

    face: np.ndarray
    """Facet of each point, (N,)."""
    weights: np.ndarray
    """Barycentric coordinates of each point in its facet, (N, 3)."""
    nodes: np.ndarray
    """Points at the corners of each triangle, oriented like the facets, and at the middles of edges 01, 12 and 20, (M, 6)."""

    @property
    def parts(self) -> np.ndarray:
        """Each triangle cut in four by its middles, (4 M, 3)."""
        return self.nodes[:, PARTS].reshape(-1, 3)

    def finer(self, parts: np.ndarray) -> Lattice:
        """Some of the `parts`, by their numbers, as triangles of their own."""
        return _with_middles(self.face, self.weights, self.parts[parts])


PARTS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
"""Nodes at the corners of the parts of a triangle that is cut in four."""


def lattice_size(reflectors: Reflectors, faces: np.ndarray, spacing_m: float) -> int:
    """Number of triangles of a `lattice`."""
    return int(np.sum(_parts(reflectors, faces, spacing_m) ** 2))


def _parts(reflectors: Reflectors, faces: np.ndarray, spacing_m: float) -> np.ndarray:
    """Into how many parts the edges of facets (N,) are cut, (N,)."""
    return np.maximum(1, np.ceil(reflectors.edge_m[faces] / spacing_m)).astype(int)


def lattice(reflectors: Reflectors, faces: np.ndarray, spacing_m: float) -> Lattice:
    """Triangles with edges of up to `spacing_m` on some facets (N,)."""
    parts = _parts(reflectors, faces, spacing_m)
    columns, first = [(np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3), int))], 0
    for count in np.unique(parts):
        of_count = faces[parts == count]
        weights, triangles = _grid(int(count))
        weights = weights + (1 / 3 - weights) * INWARD / count
        start = first + len(weights) * np.arange(len(of_count))
        numbers = (start[:, None, None] + triangles).reshape(-1, 3)
        columns.append((np.repeat(of_count, len(weights)), np.tile(weights, (len(of_count), 1)), numbers))
        first += len(weights) * len(of_count)
    return _with_middles(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def _with_middles(face: np.ndarray, weights: np.ndarray, triangles: np.ndarray) -> Lattice:
    """A lattice of triangles (M, 3) between points in facets (N,) at barycentric coordinates (N, 3)."""
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)
    edges, inverse = np.unique(np.sort(ends, axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    nodes = np.concatenate([triangles, len(face) + inverse.reshape(-1, 3)], axis=1)
    used, nodes = np.unique(nodes, return_inverse=True)
    face = np.concatenate([face, face[edges[:, 0]]])
    weights = np.concatenate([weights, weights[edges].mean(axis=1)])
    return Lattice(face[used], weights[used], nodes.reshape(-1, 6))


def _grid(parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric coordinates (N, 3) of the points of a triangle cut into parts^2, and these triangles (parts^2, 3)."""
    rows = [(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    number = {place: k for k, place in enumerate(rows)}
    triangles = [[number[i, j], number[i + 1, j], number[i, j + 1]] for i in range(parts) for j in range(parts - i)]
    triangles += [
        [number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]] for i in range(parts) for j in range(parts - i - 1)
    ]
    u, v = np.array(rows).T / parts
    return np.stack([1 - u - v, u, v], axis=1), np.array(triangles)


def _edges(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar products (...) of vectors (..., 3)."""
    return np.einsum("...i,...i->...", a, b)


def _sum(weights: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.einsum("nc,nci->ni", weights, points)
