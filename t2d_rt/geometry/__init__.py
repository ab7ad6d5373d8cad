"""Surfaces as arrays: refinement on one fixed curved surface, points spread over it, what lies inside."""

from t2d_rt.geometry.curved import curved_refinements
from t2d_rt.geometry.refine import Refinement, SubdividedMesh, Tessellation, curvature, refine, refinements
from t2d_rt.geometry.subdivide import Subdivision, crease_corners, sharp_edges, subdivide, topology
from t2d_rt.geometry.surface_points import SurfacePoints, hash_uniform, point_spacing, surface_points
from t2d_rt.geometry.winding import winding

__all__ = [
    "Refinement",
    "SubdividedMesh",
    "Subdivision",
    "SurfacePoints",
    "Tessellation",
    "crease_corners",
    "curvature",
    "curved_refinements",
    "hash_uniform",
    "point_spacing",
    "refine",
    "refinements",
    "sharp_edges",
    "subdivide",
    "surface_points",
    "topology",
    "winding",
]
