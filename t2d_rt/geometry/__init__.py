"""Surfaces as arrays: refinement of meshes on a smooth surface, points distributed over a surface, and tests for inside."""

from t2d_rt.geometry.curved import curved_refinements
from t2d_rt.geometry.refine import Refinement, SubdividedMesh, curvature, refinements
from t2d_rt.geometry.subdivide import crease_corners, sharp_edges, topology
from t2d_rt.geometry.surface_points import SurfacePoints, hash_uniform, point_spacing, surface_points
from t2d_rt.geometry.vectors import winding

__all__ = [
    "Refinement", "SubdividedMesh", "SurfacePoints", "crease_corners", "curvature", "curved_refinements", "hash_uniform",
    "point_spacing", "refinements", "sharp_edges", "surface_points", "topology", "winding",
]  # fmt: skip
