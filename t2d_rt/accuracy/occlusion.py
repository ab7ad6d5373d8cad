"""Estimates from the unrefined meshes how much power occlusion by the targets removes, to decide whether it must be traced."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from t2d_rt.accuracy.estimate import Chirps
from t2d_rt.core.backend import Backend
from t2d_rt.geometry.vectors import edge_cross, norms
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.propagation.images import apparent_m
from t2d_rt.propagation.occluders import Occluders
from t2d_rt.propagation.visibility import OccluderScene, viewpoints_at
from t2d_rt.types import Accuracy, MovingMesh, OneWayPath
from t2d_rt.types.paths import PathKey

INSTANTS, ROOM_INSTANTS = 12, 8
LEAST_DB, MOST_DB = -45.0, 20.0
"""Limits of the estimate [dB]: less cannot be resolved by the centroids of faces, and at the greatest next to nothing is
visible."""
LEVEL_DB = -20.0
"""Occlusion is estimated over path pairs down to that level [dB]: a person who walks towards the radar occludes nothing as seen
from there, but much as seen from the mirror image of the radar behind a wall."""
GLINT_RAD = math.radians(15)
"""Faces count where their normal is within about this angle of the bisector of the directions to the antennas: so far apart are the
normals of an unrefined mesh."""
LEAST_GLINT = 1e-3
"""Faces with less weight than that, relative to one that faces the bisector, are ignored."""


@dataclass(frozen=True, slots=True)
class _Faces:
    """The faces of some meshes at K instants."""

    middle: np.ndarray
    """Centroids [m], (K, F, 3)."""
    normal: np.ndarray
    """Unit normals, (K, F, 3)."""
    area_m2: np.ndarray
    """Areas, (K, F)."""

    @classmethod
    def of(cls, meshes: list[MovingMesh], times_s: np.ndarray) -> _Faces:
        vertices = np.concatenate([mesh.at(times_s) for mesh in meshes], axis=1)
        first = np.cumsum([0, *(len(mesh.rest) for mesh in meshes)])
        faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=False)])
        corners = vertices[:, faces]
        across = edge_cross(corners)
        twice = np.maximum(norms(across), 1e-30)
        return cls(corners.mean(axis=2), across / twice[..., None], twice / 2)

    def towards(self, place_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors (K, F, 3) from the faces to a place, (3,) or (K, 1, 3), and distances (K, F) [m]."""
        offset = place_m - self.middle
        distance = norms(offset)
        return offset / distance[..., None], distance

    def visible_through(
        self,
        meshes: list[MovingMesh],
        times_s: np.ndarray,
        seen_from: dict[PathKey, list[OneWayPath]],
        relevant: dict[PathKey, np.ndarray],
        backend: Backend,
    ) -> dict[PathKey, np.ndarray]:
        """Whether each face is visible from each viewpoint past the meshes, bool (K, F): traced for the `relevant` faces (F,),
        False for others; all are visible where there are no meshes."""
        if not meshes:
            return dict.fromkeys(seen_from, np.ones(self.area_m2.shape, bool))
        vertices = np.concatenate([mesh.at(times_s) for mesh in meshes], axis=1)
        together = [path for paths in seen_from.values() for path in paths]
        surroundings = OccluderScene(Occluders(meshes), vertices, together, backend)
        visible = {key: np.zeros(self.area_m2.shape, bool) for key in seen_from}
        for key, paths in seen_from.items():
            chosen = relevant[key]
            if chosen.any():
                visible[key][:, chosen] = surroundings.visible(paths, self.middle[:, chosen], self.normal[:, chosen])
        return visible


@dataclass(frozen=True, slots=True)
class Occluded:
    """Estimated power of the targets' echoes, and how much of it occlusion removes."""

    power: np.ndarray
    """Relative power of each ranked path pair without occlusion, (P,); in free space there is one pair."""
    removed: np.ndarray
    """Power that occlusion removes from each of the strongest N pairs, for which it was estimated, (N,)."""
    remaining: np.ndarray
    """Power that remains of each of these pairs, (N,)."""

    @classmethod
    def of(cls, model: Model, accuracy: Accuracy, *, by_fast: bool = False) -> Occluded:
        """Estimates occlusion by the targets that a run may trace or, `by_fast`, by fast-rotating ones, which no run traces."""
        power = (
            np.array([10 ** (pair.mean_db / 10) for pair in model.ranked]) if model.scene is not None else np.ones(1)
        )
        judged = _judged(model, accuracy, by_fast=by_fast)
        return cls(power, *(np.zeros((2, 0)) if judged is None else judged))

    def level_db(self, some: np.ndarray | None = None) -> float:
        """The power removed over the power that remains [dB]: of all pairs, or of those selected by `some`, bool (P,). Weaker pairs
        than those estimated are taken to lose the same fraction in the mean."""
        judged = len(self.removed)
        if not judged:
            return -math.inf
        removed = float(self.removed.sum())
        if some is not None:
            power, weights = self.power, np.asarray(some, float)
            inside, beyond = float(weights[:judged] @ power[:judged]), float(weights[judged:] @ power[judged:])
            of_these = float(weights[:judged] @ self.removed)
            mean = of_these / inside if inside else removed / float(power[:judged].sum())
            removed = of_these + beyond * mean
        if removed == 0:
            return LEAST_DB
        return float(np.clip(10 * math.log10(removed / max(float(self.remaining.sum()), 1e-30)), LEAST_DB, MOST_DB))


def _judged(model: Model, accuracy: Accuracy, *, by_fast: bool) -> tuple[np.ndarray, np.ndarray] | None:
    """Power removed and power that remains of the strongest N path pairs, (N,) each; None where nothing occludes.

    Counts occlusion that a run may trace or, `by_fast`, that which no run traces: by and of targets that rotate fast.

    In geometrical optics a surface returns power where its normal points along the bisector of the directions to the antennas, in
    proportion to its radii of curvature; the area of a mesh's faces with such normals is a measure of that power. Which of these
    faces are occluded is found by tracing rays from their centroids at a few random chirps (`Laws.occlusion` has the ratio of the
    field error to this estimate).
    """
    meshes = [
        (geometry, rotates)
        for geometry, rotates in zip(model.geometries, model.fast_rotating(accuracy), strict=True)
        if isinstance(geometry, MovingMesh)
    ]
    slow = [geometry for geometry, rotates in meshes if not rotates]
    meshes_here = [geometry for geometry, _ in meshes] if by_fast else slow
    if not meshes_here or (by_fast and len(slow) == len(meshes_here)):
        return None
    count = INSTANTS if model.scene is None else ROOM_INSTANTS
    times_s = Chirps.random(model.radar, model.span_s, seed=model.seed, count=count).starts_s
    faces = _Faces.of(meshes_here, times_s)
    ends = list(_ends(model, accuracy))
    seen_from = {end.key: end.seen_at(times_s) for _, *both in ends for end in both}
    towards = {key: faces.towards(apparent_m(paths)) for key, paths in seen_from.items()}
    relevant = {key: np.zeros(faces.area_m2.shape[1], bool) for key in seen_from}
    glints = []
    for _, *both in ends:
        keys = [end.key for end in both]
        (there, to), (here, back) = (towards[key] for key in keys)
        middle = there + here
        cosine = np.einsum("kfi,kfi->kf", faces.normal, middle) / np.maximum(norms(middle), 1e-30)
        direct = np.exp(-((np.arccos(np.clip(cosine, -1, 1)) / GLINT_RAD) ** 2))
        direct[direct < LEAST_GLINT] = 0
        for key in keys:
            relevant[key] |= direct.any(axis=0)
        glints.append(direct * faces.area_m2 / (to * back) ** 2)
    by_all, by_modelled = (
        faces.visible_through(occluding, times_s, seen_from, relevant, model.backend)
        for occluding in (meshes_here, slow if by_fast else [])
    )
    removed, remaining = [], []
    for (power, *both), glint in zip(ends, glints, strict=True):
        visible, modelled = (free[both[0].key] & free[both[1].key] for free in (by_all, by_modelled))
        total = max(float(glint.sum()), 1e-300)
        removed.append(power * float(glint[modelled & ~visible].sum()) / total)
        remaining.append(power * float(glint[visible].sum()) / total)
    return np.array(removed), np.array(remaining)


def _ends(model: Model, accuracy: Accuracy) -> Iterator[tuple[float, OneWayPath, OneWayPath]]:
    """Relative power of each path pair that is strong enough, and its two one-way paths; in free space the lines of sight of the
    antennas."""
    if model.scene is None:
        out, back = viewpoints_at([model.radar.tx_position_m, model.radar.rx_position_m])
        yield 1.0, out, back
    least_db = max(LEVEL_DB, accuracy.least_level_db)
    for ranked in model.ranked:
        if ranked.mean_db >= least_db:
            yield 10 ** (ranked.mean_db / 10), ranked.pair.out, ranked.pair.back
