"""Rays between the targets at one instant: what they meet first, and whether they are free."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend, aligned
from t2d_rt.propagation.mitsuba import columns, mitsuba, mitsuba_mesh, traceable


class Hits(NamedTuple):
    """What rays meet first."""

    face: np.ndarray
    """Triangle, int64 (N,); -1 where a ray meets none."""
    weights: np.ndarray
    """Barycentric coordinates of the place in it, float64 (N, 3)."""


class Rays:
    """Triangles in one pose, in a scene that rays are traced in."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, backend: Backend) -> None:
        """Of vertices (V, 3) m and triangles (F, 3)."""
        self._mitsuba = mitsuba(backend)
        self._middle = vertices.mean(axis=0)
        mesh = mitsuba_mesh(self._mitsuba, vertices - self._middle, faces)
        self._scene = traceable(self._mitsuba, mesh)

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """Of rays from (N, 3) m in unit directions (N, 3)."""
        if not len(origins):  # Dr.Jit has no arrays of nothing
            return Hits(np.zeros(0, np.int64), np.zeros((0, 3)))
        import drjit as dr

        found = self._scene.ray_intersect_preliminary(self._ray(origins, directions))
        met = found.is_valid()
        u, v = (dr.select(met, getattr(found.prim_uv, axis), 0) for axis in "xy")
        dr.eval(met, u, v, found.prim_index)  # at once; else each would trace the rays again
        u, v = u.numpy().astype(float), v.numpy().astype(float)
        face = np.where(met.numpy(), found.prim_index.numpy().astype(np.int64), -1)
        return Hits(face, np.stack([1 - u - v, u, v], axis=1))

    def free(self, origins: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Whether nothing lies between points (N, 3) and (N, 3) or one (3,) m, bool (N,)."""
        if not len(origins):
            return np.zeros(0, bool)
        path = ends - origins
        length = np.linalg.norm(path, axis=1)
        ray = self._ray(origins, path / length[:, None])
        ray.maxt = self._mitsuba.Float(aligned(length, np.float32))
        return np.asarray(~self._scene.ray_test(ray).numpy())

    def _ray(self, origins: np.ndarray, directions: np.ndarray) -> Any:
        mi = self._mitsuba
        return mi.Ray3f(mi.Point3f(*columns(mi, origins - self._middle)), mi.Vector3f(*columns(mi, directions)))
