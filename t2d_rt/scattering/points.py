"""Diffuse points fixed on a mesh (docs/physics.md, eq. 9), and visibility carried to them and to the facets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from t2d_rt.core import disk_cache
from t2d_rt.core.memory import LastUsed
from t2d_rt.geometry import Refinement, SubdividedMesh, SurfacePoints, point_spacing, surface_points
from t2d_rt.geometry.vectors import edge_cross, unit
from t2d_rt.scattering.lanes import Weights
from t2d_rt.scattering.patches import Csr, members
from t2d_rt.scattering.refinement import apply_operator, flattened
from t2d_rt.types import MovingMesh
from t2d_rt.types.scatterer import Fraction

APART_M = 0.1
"""Facets of opposite directions are moved apart by twice this distance where the nearest facet of a point is sought."""
FAR_M = 1e6
"""Distance [m] of facets of different materials along the last coordinate of that search, which is not one of space: with it a
point finds a facet of its own material."""
VertexVisibility = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function that gives the visibility (K, Q) of vertices (K, Q, 3) [m] of triangles (F, 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledVisibility:
    """How a mesh is seen over a path pair at some frames."""

    visibility: Mapping[Fraction, np.ndarray] = field(default_factory=dict)
    """Visibility of the vertices of its visibility mesh over each one-way path, (T, V'); the product over the paths counts."""
    facet_visibility: VertexVisibility | None = None
    """Visibility of finer vertices, as a further factor."""
    weights: Weights | None = None
    """Weights of the path pair; None in free space."""


_last_points = LastUsed[SurfacePoints](8)  # some 300 kB each


def _spread(rest: np.ndarray, faces: np.ndarray, seed: int, spacing_m: float) -> SurfacePoints:
    """`surface_points`, kept for the next recording of the same body and for coarser facets of this one."""
    key = disk_cache.key("geometry", ("points", rest, faces, seed, spacing_m))
    names = [column.name for column in fields(SurfacePoints)]

    def spread() -> dict[str, np.ndarray]:
        points = surface_points(rest, faces, seed=seed, spacing_m=spacing_m)
        return {name: getattr(points, name) for name in names}

    return _last_points.get(key, lambda: SurfacePoints(**disk_cache.cached_arrays(key, names, spread)))


def forget() -> None:
    """Drops the points that are kept."""
    _last_points.forget()


@dataclass(frozen=True, slots=True)
class DiffusePoints:
    """Diffuse points and the triangles that hold them; the points of each patch stand together."""

    carrier: Refinement
    used: np.ndarray
    """Numbers of the carrier's vertices whose triangles hold points, (Vp,)."""
    operator: Csr
    """Sparse float32 matrix (Vp, V) that gives these vertices from the control points."""
    corners: np.ndarray
    """Vertices of each point's triangle, as numbers among those that hold points, (Q, 3)."""
    packets: np.ndarray
    """Each point's first two barycentric coordinates in its triangle, the root of the area that it stands for [m], and its
    phase [rad], float32 (Q, 4)."""
    starts: np.ndarray
    """First point of each patch and the end, integers (G + 1,)."""
    scattered: np.ndarray
    """S |Gamma| of each patch, (G,)."""

    @classmethod
    def spread(
        cls,
        surface: MovingMesh,
        carrier: Refinement,
        *,
        patch_facets: np.ndarray,
        starts: np.ndarray,
        parts: tuple[np.ndarray, np.ndarray],
        seed: int,
        scattered: np.ndarray,
        count: int,
    ) -> DiffusePoints:
        """Spreads about `count` points or more, with a seed, over the carrier, whose triangles are taken as flat.

        Each belongs to the patch of the nearest facet that faces the same way and is of the same part; patch g has the facets
        starts[g]..starts[g + 1] - 1 of `patch_facets` (F, 3, 3) [m] at rest. `parts` are those of the patches' facets (F,) and of
        the carrier's (Fc,).
        """
        from scipy.spatial import cKDTree

        carrier = flattened(carrier, surface.rest)
        rest = carrier.at(surface.rest)
        across = edge_cross(rest[carrier.faces])
        area = 0.5 * float(np.linalg.norm(across, axis=1).sum())
        points = _spread(rest, carrier.faces, seed, point_spacing(area, count))
        corners = carrier.faces[points.face]
        places = np.einsum("qi,qij->qj", points.barycentric, rest[corners])
        of_facets, of_points = (FAR_M * part[:, None] for part in (parts[0], parts[1][points.face]))
        near = cKDTree(np.hstack([patch_facets.mean(axis=1), APART_M * unit(edge_cross(patch_facets)), of_facets]))
        _, facet = near.query(np.hstack([places, APART_M * unit(across[points.face]), of_points]))
        patch = np.searchsorted(starts, facet, side="right") - 1
        order = np.argsort(patch, kind="stable")
        used, corners = np.unique(corners[order], return_inverse=True)
        columns = *points.barycentric[order, :2].T, np.sqrt(points.area_m2[order]), points.phase_rad[order]
        return cls(
            carrier,
            used,
            carrier.operator[used].astype(np.float32),
            corners.reshape(-1, 3),
            np.stack(columns, axis=1).astype(np.float32),
            np.searchsorted(patch[order], np.arange(len(starts))),
            scattered,
        )

    def only(self, patches: np.ndarray) -> DiffusePoints:
        """Points of some patches, by their indices."""
        chosen, starts = members(self.starts, patches)
        return replace(
            self,
            corners=self.corners[chosen],
            packets=self.packets[chosen],
            starts=starts,
            scattered=self.scattered[patches],
        )

    def facet_visibility(self, visibility: VertexVisibility, cage: np.ndarray) -> np.ndarray:
        """Visibility (Vp, T) of the vertices that hold points, for control points (T, V, 3) [m]."""
        return sampled_visibility(visibility, apply_operator(self.operator, cage), self.corners)


@dataclass(frozen=True, slots=True)
class VisibilityMesh:
    """The subdivided cage at whose vertices visibility is sampled."""

    faces: np.ndarray
    """Faces (F', 3) of the visibility mesh, those of each cage face together."""
    facets: Csr
    """Sparse float32 matrix that gives the facets' vertices their visibility from that of this mesh's vertices."""
    points: Csr | None
    """Sparse matrix that gives the vertices that hold diffuse points their visibility; None without such points."""

    @classmethod
    def of(cls, surface: MovingMesh, fine: Refinement, points: DiffusePoints | None, level: int) -> VisibilityMesh:
        """The mesh at a subdivision level."""
        if not level:
            held = None if points is None else points.carrier.linear[points.used].astype(np.float32)
            return cls(surface.faces, fine.linear.astype(np.float32), held)
        subdivision = SubdividedMesh.of(surface.faces, len(surface.rest), level)
        held = None if points is None else subdivision.to(points.carrier, surface.faces)[points.used]
        return cls(subdivision.faces, subdivision.to(fine, surface.faces), held)


def sampled_visibility(facet_visibility: VertexVisibility, vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Visibility (Vf, K) of vertices (Vf, K, 3) [m] of triangles `corners` (F, 3)."""
    return facet_visibility(np.ascontiguousarray(vertices.swapaxes(0, 1)), corners).T
