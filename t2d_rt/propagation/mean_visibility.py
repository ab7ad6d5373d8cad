"""Mean visibility of a target that rotates too fast for it to be sampled point by point: a fan behind walkers."""

from __future__ import annotations

from collections.abc import Hashable
from functools import partial

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.propagation.images import images, instants_of, reflected
from t2d_rt.propagation.occluders import MOST_COPIES, Occluders
from t2d_rt.propagation.visibility import OccluderScene, Unblocked, between_samples
from t2d_rt.types import MovingMesh, OneWayPath
from t2d_rt.types.scatterer import Fraction

POSES = 24
"""Number of poses of a rotation in which a rotor's blockage by the static scene is found."""
POINTS = 300
"""Approximate number of a rotor's points whose mean visibility is that of all."""


class MeanVisibility:
    """Mean visibility of one mesh, the same for all of its vertices, from several viewpoints at the sample times; the mesh itself
    occludes nothing.

    Viewpoints are worked on together, because what stands in the way is posed and traced once for all of them.
    """

    def __init__(
        self, mesh: MovingMesh, occluders: Occluders, samples_s: np.ndarray, *, solid: bool, backend: Backend
    ) -> None:
        """`samples_s` (S,) are the sample times [s]; `solid` tells whether the `occluders` occlude."""
        self._mesh, self._occluders, self._samples_s = mesh, occluders, samples_s
        self._solid = solid and bool(occluders.meshes)
        self._backend = backend
        self._stride = max(1, len(mesh.rest) // POINTS)
        self._views: dict[Hashable, tuple[OneWayPath, Unblocked | None]] = {}
        self._functions: dict[tuple[Hashable, int], Fraction] = {}
        """What `over` has returned: scatterers that need the same fraction hold the same object."""
        self._known: dict[Hashable, tuple[np.ndarray, np.ndarray]] = {}
        """Mean over one path, and over two that share the blockage by the scene, (S,) each."""

    def over(self, key: Hashable, viewpoint: OneWayPath, unblocked: Unblocked | None, path_count: int) -> Fraction:
        """Function that gives the visibility (K, V) at times (K,) [s] from the viewpoint of that name; the fraction `unblocked` by
        the scene counts for `path_count` one-way paths, 1 or 2."""
        self._views.setdefault(key, (viewpoint, unblocked))
        return self._functions.setdefault((key, path_count), partial(self.at, key, path_count))

    def at(self, key: Hashable, path_count: int, times_s: np.ndarray) -> np.ndarray:
        """Visibility (K, V) from a viewpoint at times (K,) [s]."""
        if key not in self._known:
            self._find()
        values = self._known[key][path_count - 1][:, None]
        visibility = between_samples(times_s, self._samples_s, values.__getitem__)
        return np.broadcast_to(visibility, (len(times_s), len(self._mesh.rest)))

    def _find(self) -> None:
        """Finds the visibility from all viewpoints from which it is not known yet."""
        poses_s, pose = poses(self._mesh, self._samples_s)
        posed = self._mesh.at(poses_s)[:, :: self._stride]
        views = {key: view for key, view in self._views.items() if key not in self._known}
        reached = {
            key: np.ones(posed.shape[:2], np.float32) if unblocked is None else unblocked(posed, poses_s)
            for key, (_, unblocked) in views.items()
        }
        for key, fraction in reached.items():
            self._known[key] = fraction.mean(axis=1)[pose], (fraction**2).mean(axis=1)[pose]
        if not self._solid:
            return
        middle = posed.mean(axis=1, keepdims=True)
        radius = np.linalg.norm(posed - middle, axis=2).max(axis=1, keepdims=True)
        marked = self._occluders.marked(self._samples_s)
        middle, radius, near = middle[pose], radius[pose], {}
        for key, (viewpoint, _) in views.items():
            seen_paths = viewpoint.seen_at(self._samples_s)
            pieces = zip(seen_paths, instants_of(seen_paths), strict=True)
            near[key] = np.concatenate([self._near(path, marked[at], middle[at], radius[at]) for path, at in pieces])
        hidden = np.flatnonzero(np.any([marks.any(axis=1) for marks in near.values()], axis=0))
        for first in range(0, len(hidden), MOST_COPIES):
            rows = hidden[first : first + MOST_COPIES]
            times_s = self._samples_s[rows]
            points = self._mesh.at(times_s)[:, :: self._stride]
            parts = np.any([marks[rows] for marks in near.values()], axis=0)[:, self._occluders.mark_of_face]
            seen_from = {key: viewpoint.seen_at(times_s) for key, (viewpoint, _) in views.items()}
            all_paths = [path for of_viewpoint in seen_from.values() for path in of_viewpoint]
            scene = OccluderScene(
                self._occluders, self._occluders.at(times_s).vertices, all_paths, self._backend, parts=parts
            )
            for key, seen_paths in seen_from.items():
                if near[key][rows].any():
                    visible = scene.visible(seen_paths, points, np.zeros_like(points))
                    for number, mean in enumerate(self._known[key]):
                        mean[rows] = (visible * reached[key][pose[rows]] ** (number + 1)).mean(axis=1)

    def _near(self, viewpoint: OneWayPath, marked: np.ndarray, middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """Which marks on the occluders (K, M, 3) [m] may be in the way to a ball around (K, 1, 3) [m] of radius (K, 1) [m], or
        stand for what is, at the sample times, bool (K, M)."""
        *before, place_m = images(viewpoint)
        obstructing = self._between(place_m, marked, middle, radius)
        # Unfolded, each straight part runs from an image of the antenna to the ball's image in the mirrors after it.
        elements = zip(viewpoint.planes, viewpoint.elements.through, strict=True)
        for place_m, (plane, through) in reversed(list(zip(before, elements, strict=True))):
            middle = middle if through else reflected(middle, *plane)
            obstructing |= self._between(place_m, marked, middle, radius)
        return obstructing

    def _between(
        self, viewpoint_m: np.ndarray, marked: np.ndarray, middle: np.ndarray, radius: np.ndarray
    ) -> np.ndarray:
        """Which marks, bool (K, M), may be in the way of a straight line from a place (3,) [m] to the ball."""
        towards = middle - viewpoint_m
        length = np.linalg.norm(towards, axis=2)
        reach = self._occluders.mark_reach_m
        from_here = marked - viewpoint_m
        along = np.einsum("kvi,kji->kv", from_here, towards / length[..., None])
        beside = np.sqrt(np.maximum(np.einsum("kvi,kvi->kv", from_here, from_here) - along**2, 0))
        wide = radius * np.clip(along / np.maximum(length - radius, 1e-9), 0, 1) + reach
        return np.asarray((beside < wide) & (along > -reach) & (along < length + radius + reach))


def poses(mesh: MovingMesh, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (P,) [s] of poses that stand for those of a mesh at times (K,) [s], and the number of the pose for each of these (K,).
    A mesh that has a period has the same few for all rotations."""
    if mesh.period_s is None or len(times_s) <= POSES:
        return times_s, np.arange(len(times_s))
    cycles = (times_s - mesh.times_s[0]) / mesh.period_s % 1
    first = mesh.times_s[0] + mesh.period_s * np.arange(POSES) / POSES
    return first, np.asarray(np.round(cycles * POSES).astype(int) % POSES)
