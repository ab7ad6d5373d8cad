"""Mitsuba in the variant of a backend, and its arrays and meshes from NumPy's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, aligned


def imported() -> Any:
    """Mitsuba, looking for plugins and data in its own folder before all others.

    By itself it looks in the working directory first, and a plugin is a program that runs when it is loaded.
    """
    import mitsuba as mi

    home = str(Path(mi.__file__).parent)
    resolver = mi.file_resolver()  # type: ignore[operator]
    if str(next(iter(resolver), None)) != home:
        resolver.prepend(home)
    return mi


def mitsuba(backend: Backend) -> Any:
    """Mitsuba in the variant of a backend."""
    mi = imported()
    if mi.variant() != backend.mitsuba_variant:
        mi.set_variant(backend.mitsuba_variant)
    return mi


def mitsuba_mesh(mi: Any, vertices: np.ndarray, faces: np.ndarray | None = None) -> Any:
    """A mesh of vertices (V, 3) m; by default every three are a triangle."""
    faces = np.arange(len(vertices)) if faces is None else faces
    mesh = mi.Mesh("mesh", len(vertices), faces.size // 3)
    values = mi.traverse(mesh)
    values["vertex_positions"] = mi.Float(vertices.ravel().astype(np.float32))
    values["faces"] = mi.UInt32(faces.ravel().astype(np.uint32))
    values.update()
    return mesh


def traceable(mi: Any, mesh: Any) -> Any:
    """A scene of one mesh that lets no ray through between its triangles: Embree's usual test may, where one runs on to an edge."""
    return mi.load_dict({"type": "scene", "embree_use_robust_intersections": True, "mesh": mesh})


def columns(mi: Any, points: np.ndarray) -> list[Any]:
    """x, y, z of points (..., 3)."""
    return [mi.Float(aligned(points[..., axis], np.float32)) for axis in range(3)]
