"""Frozen diffuse points on a mesh (docs/physics.md, eq. 9), and visibility carried to them and to the facets."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from t2d_rt import disk_cache
from t2d_rt.geometry import Refinement, SubdividedMesh, SurfacePoints, point_spacing, surface_points
from t2d_rt.geometry.vectors import dot, edge_cross
from t2d_rt.scattering.facets import Pair
from t2d_rt.scattering.lanes import Block, Gather, Weights, combined, minus, norm, triangle_normal
from t2d_rt.scattering.patches import Csr
from t2d_rt.scattering.refinement import carried
from t2d_rt.types import MovingMesh

VertexVisibility = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Visibility (K, Q) of vertices (K, Q, 3) of triangles (F, 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """How a mesh is seen over a path pair at some frames."""

    visibility: np.ndarray | None = None
    """Of the vertices of its visibility mesh, (T, V'); None: all are visible."""
    facet_visibility: VertexVisibility | None = None
    """Of finer vertices, as a factor."""
    weights: Weights | None = None
    """Of the path pair; None in free space."""


_kept: OrderedDict[str, SurfacePoints] = OrderedDict()
KEPT_POINTS = 8
"""Sets of points that are kept, the last used ones: some 300 kB each."""


def _spread(rest: np.ndarray, faces: np.ndarray, seed: int, spacing_m: float) -> SurfacePoints:
    """`surface_points`, kept for the next recording of the same body and for coarser facets of this one."""
    key = disk_cache.key("geometry", ("points", rest, faces, seed, spacing_m))
    if key not in _kept:

        def spread() -> dict[str, np.ndarray]:
            found = surface_points(rest, faces, seed=seed, spacing_m=spacing_m)
            return {each.name: getattr(found, each.name) for each in fields(SurfacePoints)}

        names = [each.name for each in fields(SurfacePoints)]
        _kept[key] = SurfacePoints(**disk_cache.kept(key, names, spread))
        if len(_kept) > KEPT_POINTS:
            _kept.popitem(last=False)
    _kept.move_to_end(key)
    return _kept[key]


def forget() -> None:
    """Drops the points that are kept."""
    _kept.clear()


@dataclass(frozen=True, slots=True)
class DiffusePoints:
    """Diffuse points on the triangles that hold them."""

    carrier: Refinement
    used: np.ndarray
    """Numbers of its vertices that hold points, (Vp,)."""
    operator: Csr
    """Sparse: these from the cage's vertices, (Vp, V)."""
    corners: np.ndarray
    """Of each point's triangle, as numbers among `used`, (Q, 3)."""
    barycentric: np.ndarray
    """Where in the triangle it lies, (Q, 3)."""
    area_m2: np.ndarray
    """Of the surface that it stands for, (Q,)."""
    phase_rad: np.ndarray
    """(Q,)."""
    scattered: float
    """S |Gamma|."""

    @classmethod
    def spread(cls, surface: MovingMesh, carrier: Refinement, seed: int, scattered: float, count: int) -> DiffusePoints:
        """At least about `count` points, spread with a seed over the carrier, whose triangles are taken as flat."""
        carrier = carrier.flattened(surface.rest)
        rest = carrier.at(surface.rest)
        area = 0.5 * float(np.linalg.norm(edge_cross(rest[carrier.faces]), axis=1).sum())
        points = _spread(rest, carrier.faces, seed, point_spacing(area, count))
        used, corners = np.unique(carrier.faces[points.face], return_inverse=True)
        return cls(
            carrier, used, carrier.operator[used], corners.reshape(-1, 3), points.barycentric, points.area_m2,
            points.phase_rad, scattered,
        )  # fmt: skip

    def places(self, cage: np.ndarray) -> np.ndarray:
        """Where the points stand (Q, K, 3), for control points (K, V, 3)."""
        vertices = carried(self.operator, cage)
        return sum(vertices[self.corners[:, i]] * self.barycentric[:, i, None, None] for i in range(3))

    def fraction(self, seen: Seen, mesh: VisibilityMesh, cage: np.ndarray) -> np.ndarray | None:
        """Visibility of the carrier's vertices (Vp, T, 1); None: all are visible."""
        sampled = None if seen.visibility is None else carried(mesh.points, seen.visibility[..., None])
        if seen.facet_visibility is None:
            return sampled
        found = sampled_visibility(seen.facet_visibility, carried(self.operator, cage), self.corners)[..., None]
        return found if sampled is None else sampled * found


@dataclass(frozen=True, slots=True)
class VisibilityMesh:
    """The subdivided cage at whose vertices visibility is sampled."""

    faces: np.ndarray
    """Those of each cage face together."""
    facets: Csr | None
    """Sparse: from visibility there to that of the facets' vertices; None: visibility of the cage's own vertices is carried
    along."""
    points: Csr | None
    """Sparse: the same of vertices that hold the diffuse points."""

    @classmethod
    def of(cls, surface: MovingMesh, fine: Refinement, points: DiffusePoints | None, level: int) -> VisibilityMesh:
        """At a subdivision level."""
        if not level:
            return cls(surface.faces, None, None if points is None else points.carrier.linear[points.used])
        subdivision = SubdividedMesh.of(surface.faces, len(surface.rest), level)
        held = None if points is None else subdivision.to(points.carrier, surface.faces)[points.used]
        return cls(subdivision.faces, subdivision.to(fine, surface.faces), held)


def diffuse_echoes(
    points: DiffusePoints,
    vertices: Any,
    visibility: np.ndarray | None,
    pair: Pair,
    weights: Weights | None,
    first: int,
    block: Block,
    columns: np.ndarray,
) -> None:
    """Writes echoes of Q Lambertian points of fixed random phase: sigma_q = 4 S^2 |Gamma|^2 A_q cos_i cos_s.

    `vertices` are the carrier's, flat Float64 (Vp, T, 3) m, of `visibility` (Vp, T, 1), where not all are visible. Among the
    weights theirs come from `first` on; they go to `columns` (Q,).
    """
    at = Gather(vertices, block.shape[0], len(points.area_m2), block.backend)
    index = at.vertices(at.columns(points.corners), at.item)
    corners = at.points(index)
    point = combined(corners, [at.per_item(points.barycentric[:, i]) for i in range(3)])
    normal, doubled_area = triangle_normal(corners, at)
    lines_of_sight = [minus(at.place(antenna), point) for antenna in pair.places_m]
    ranges = [norm(line_of_sight) for line_of_sight in lines_of_sight]
    cosines = [
        at.dr.maximum(dot(normal, s) / (doubled_area * d), 0) for s, d in zip(lines_of_sight, ranges, strict=True)
    ]
    root = at.per_item(pair.link_amplitude * 2 * points.scattered * np.sqrt(points.area_m2))
    weight = block.backend.Float32(root * at.dr.sqrt(cosines[0] * cosines[-1]) / (ranges[0] * ranges[-1]))
    if visibility is not None:
        weight *= at.corner_mean(at.field(visibility), index)
    sin, cos = at.dr.sincos(block.backend.Float32(at.per_item(points.phase_rad)))
    delay, amplitude, slope = pair.delays(at, ranges), (cos * weight, sin * weight), None
    if weights is not None:
        none = at.dr.zeros(block.backend.Float32, at.dr.width(at.item))
        number = at.item + at.dr.opaque(block.backend.UInt32, first)
        amplitude, slope = at.weighted(weights, number, amplitude, (none, none))
    at.dr.eval(delay, amplitude, slope)
    block.put(at, columns, delay=delay, amplitude=amplitude, slope=slope)


def sampled_visibility(facet_visibility: VertexVisibility, vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Visibility of vertices (Vf, K, 3) m of triangles `corners` (F, 3): (Vf, K) float32."""
    return facet_visibility(np.ascontiguousarray(vertices.swapaxes(0, 1)), corners).T
