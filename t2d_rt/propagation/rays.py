"""Rays by Mitsuba, in the variant of a backend: its meshes, scenes and rays from NumPy's arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend, aligned

LIFT_M = 2e-3
"""Rays start this far off the surface, so that the triangles they start from do not stop them."""


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
    """A mesh of vertices (V, 3) [m]; by default every three are a triangle."""
    faces = np.arange(len(vertices)) if faces is None else faces
    mesh = mi.Mesh("mesh", len(vertices), faces.size // 3)
    values = mi.traverse(mesh)
    values["vertex_positions"] = mi.Float(vertices.ravel().astype(np.float32))
    values["faces"] = mi.UInt32(faces.ravel().astype(np.uint32))
    values.update()
    return mesh


def traceable(mi: Any, mesh: Any) -> Any:
    """A scene of one mesh that lets no ray through between triangles: Embree's usual test may, where a ray runs onto an edge."""
    return mi.load_dict({"type": "scene", "embree_use_robust_intersections": True, "mesh": mesh})


def columns(mi: Any, points: np.ndarray) -> list[Any]:
    """Coordinates x, y, z of points (..., 3), flat on the device."""
    return [mi.Float(aligned(points[..., axis], np.float32)) for axis in range(3)]


def rays(mi: Any, origins: np.ndarray, directions: np.ndarray, length: np.ndarray | None = None) -> Any:
    """Rays from (..., 3) [m] in unit directions (..., 3), as far as their length (...) [m] where one is given."""
    ray = mi.Ray3f(mi.Point3f(*columns(mi, origins)), mi.Vector3f(*columns(mi, directions)))
    if length is not None:
        ray.maxt = mi.Float(aligned(length, np.float32))
    return ray


def scene_of_instants(mi: Any, vertices: np.ndarray, faces: np.ndarray, reach_m: float) -> tuple[Any, np.ndarray]:
    """Meshes at up to 64 instants in one scene, none within the reach of another, and how far each is shifted [m], (K, 1, 3).

    Vertices are (K, V, 3) [m]; faces (..., 3) number those of all instants as one list.
    """
    cell = np.stack(np.unravel_index(np.arange(len(vertices)), (4, 4, 4)), axis=1)
    shift = cell[:, None, :] * reach_m
    return traceable(mi, mitsuba_mesh(mi, (vertices + shift).reshape(-1, 3), faces)), shift


class Hits(NamedTuple):
    """The surfaces that rays meet first."""

    face: np.ndarray
    """Triangle, int64 (N,); -1 where a ray meets none."""
    weights: np.ndarray
    """Barycentric coordinates of the place in it, float64 (N, 3)."""


class Rays:
    """Triangles in one pose, in a scene that rays are traced in."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, backend: Backend) -> None:
        """A scene of triangles (F, 3) of vertices (V, 3) [m]."""
        self._mitsuba = mitsuba(backend)
        self._middle = vertices.mean(axis=0)
        mesh = mitsuba_mesh(self._mitsuba, vertices - self._middle, faces)
        self._scene = traceable(self._mitsuba, mesh)

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """The surfaces that rays from (N, 3) [m] in unit directions (N, 3) meet first."""
        if not len(origins):  # Dr.Jit traces no empty arrays
            return Hits(np.zeros(0, np.int64), np.zeros((0, 3)))
        import drjit as dr

        hit = self._scene.ray_intersect_preliminary(rays(self._mitsuba, origins - self._middle, directions))
        met = hit.is_valid()
        u, v = (dr.select(met, getattr(hit.prim_uv, axis), 0) for axis in "xy")
        dr.eval(met, u, v, hit.prim_index)  # at once; else each would trace the rays again
        u, v = u.numpy().astype(float), v.numpy().astype(float)
        face = np.where(met.numpy(), hit.prim_index.numpy().astype(np.int64), -1)
        return Hits(face, np.stack([1 - u - v, u, v], axis=1))

    def free(self, origins: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Whether nothing lies between points (N, 3) and (N, 3) or one (3,) [m], bool (N,)."""
        if not len(origins):
            return np.zeros(0, bool)
        path = ends - origins
        length = np.linalg.norm(path, axis=1)
        towards = rays(self._mitsuba, origins - self._middle, path / length[:, None], length)
        return np.asarray(~self._scene.ray_test(towards).numpy())
