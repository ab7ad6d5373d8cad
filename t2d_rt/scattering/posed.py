"""A mesh at some frames of a record, as all views of it have it in common."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.scattering.facing import Facing
from t2d_rt.scattering.patches import Csr, Patches
from t2d_rt.scattering.points import DiffusePoints, Seen, VisibilityMesh, sampled_visibility
from t2d_rt.scattering.refinement import carried

PROBE_EVERY = 6
"""Frames between tests of which faces face the antennas."""


@dataclass(frozen=True)
class Posed:
    """A mesh at some frames: what all views have in common."""

    patches: Patches
    points: DiffusePoints | None
    cage: np.ndarray
    """Control points (T, V, 3) m."""
    origin: np.ndarray
    """What vertices count from (T, 3) m."""
    centre: np.ndarray
    """The patches' reference points, (G, T, 3) m."""
    centres: Any
    """The same on the device, flat Float64."""
    facing: Facing
    backend: Backend

    @classmethod
    def of(
        cls,
        cage: np.ndarray,
        faces: np.ndarray,
        centre: Csr,
        patches: Patches,
        points: DiffusePoints | None,
        backend: Backend,
    ) -> Posed:
        """For control points (T, V, 3) m with `faces` (F, 3); `centre` is sparse, the patches' reference points from them."""
        centres = carried(centre, cage)
        instants = np.unique(np.linspace(0, len(cage) - 1, math.ceil((len(cage) - 1) / PROBE_EVERY) + 1).astype(int))
        facing = Facing.of(cage[instants], faces)
        return cls(patches, points, cage, cage.mean(axis=1), centres, backend.Float64(centres.ravel()), facing, backend)

    @cached_property
    def local(self) -> np.ndarray:
        """Control points relative to the origin, and 1, float32 (T, V, 4)."""
        # Positions within the body need no more than float32: 1e-7 of its size.
        values = np.ones((*self.cage.shape[:2], 4), np.float32)
        np.subtract(self.cage, self.origin[:, None], out=values[..., :3], casting="same_kind")
        return values

    @cached_property
    def carrier(self) -> Any:
        """Vertices that hold the diffuse points, flat Float32 (Vp, T, 4) on the device: relative to the origin, and 1."""
        assert self.points is not None
        return self.backend.Float32(carried(self.points.operator, self.local).ravel())


@dataclass(frozen=True)
class Facets:
    """The facets of the patches of some faces of a posed mesh, whose vertices are carried along."""

    posed: Posed
    meshes: Mapping[int, VisibilityMesh]
    """Those at whose vertices visibility is known, by subdivision level."""
    vertices: Any
    """Flat Float32 (V, T, 4) on the device: relative to the origin, and 1."""
    places: np.ndarray | None
    """Of the corners among them (Vc, T, 3) m, where visibility is traced from there."""
    corners: np.ndarray
    """Which of all facets' vertices are corners here, bool (Vf,)."""
    numbers: np.ndarray
    """Of all facets' vertices among these, (Vf,)."""
    corner_numbers: np.ndarray
    """Of all facets' vertices among those of these that are corners, (Vf,)."""
    _known: dict[Any, Any] = field(default_factory=dict)
    """What all pairs that have a one-way path in common share."""

    @classmethod
    def of(
        cls, posed: Posed, operator: Csr, meshes: Mapping[int, VisibilityMesh], faces: np.ndarray, *, with_places: bool
    ) -> Facets:
        """Of cage faces, bool (F,); `operator` is sparse, all facets' vertices from the control points."""
        used, corners = np.zeros((2, operator.shape[0]), bool)
        facets = np.repeat(posed.patches.any_of(faces) | with_places, np.diff(posed.patches.starts))
        used[posed.patches.nodes[facets]] = corners[posed.patches.corners[facets]] = True
        values = carried(operator[used], posed.local)
        return cls(
            posed=posed,
            meshes=meshes,
            vertices=posed.backend.Float32(values.ravel()),
            places=values[corners[used], :, :3] + posed.origin if with_places else None,
            corners=corners,
            numbers=np.cumsum(used) - 1,
            corner_numbers=np.cumsum(corners) - 1,
        )

    def visibility(self, seen: Seen, level: int) -> Any:
        """Of the corners, flat Float32 (Vc, T) on the device; None: all are visible."""
        found = self._over_paths("corners", seen, level)
        if seen.facet_visibility is not None and self.places is not None:
            triangles = self.corner_numbers[self.posed.patches.corners]
            sampled = sampled_visibility(seen.facet_visibility, self.places, triangles)
            found.append(self.posed.backend.lanes(sampled, self.posed.backend.Float32))
        return _product(found)

    def visibility_of_points(self, seen: Seen, level: int) -> Any:
        """Of the vertices that hold diffuse points, flat Float32 (Vp, T) on the device; None: all are visible."""
        found = self._over_paths("points", seen, level)
        if seen.facet_visibility is not None:
            assert self.posed.points is not None
            sampled = self.posed.points.facet_visibility(seen.facet_visibility, self.posed.cage)
            found.append(self.posed.backend.lanes(sampled, self.posed.backend.Float32))
        return _product(found)

    def _over_paths(self, what: Literal["corners", "points"], seen: Seen, level: int) -> list[Any]:
        """Visibility over each one-way path, carried along from the mesh of that level."""
        known, found = self._known, []
        for fraction, values in seen.visibility.items():
            if (what, level) not in known:
                mesh = self.meshes[level]
                known[what, level] = mesh.facets[self.corners] if what == "corners" else mesh.points
            if (what, level, fraction) not in known:
                out = carried(known[what, level], np.asarray(values, np.float32)[..., None])
                known[what, level, fraction] = self.posed.backend.Float32(out.ravel())
            found.append(known[what, level, fraction])
        return found


def _product(fields: Sequence[Any]) -> Any:
    """Of arrays on the device; None: there is none."""
    if not fields:
        return None
    return fields[0] if len(fields) == 1 else math.prod(fields[1:], start=fields[0])
