"""A mesh at some frames of a record, as all views of it have it in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.scattering.facing import Facing
from t2d_rt.scattering.patches import Csr, Patches
from t2d_rt.scattering.points import DiffusePoints, Seen, VisibilityMesh, sampled_visibility
from t2d_rt.scattering.refinement import carried

PROBE_EVERY = 6
"""Frames between tests of which faces face the antennas."""


@dataclass(frozen=True, slots=True)
class Posed:
    """A mesh at some frames: what all views have in common."""

    operator: Csr
    """Sparse: the facets' vertices from the control points."""
    patches: Patches
    points: DiffusePoints | None
    cage: np.ndarray
    """Control points (T, V, 3) m."""
    origin: np.ndarray
    """What `local` counts from (T, 3) m."""
    centre: np.ndarray
    """The patches' reference points, (G, T, 3) m."""
    centres: Any
    """The same on the device, flat Float64."""
    facing: Facing
    backend: Backend
    _kept: dict[Any, Any] = field(default_factory=dict)
    """What was carried along."""

    @classmethod
    def of(
        cls, cage: np.ndarray, faces: np.ndarray, operator: Csr, centre: Csr, patches: Patches, points: DiffusePoints | None,
        backend: Backend,
    ) -> Posed:  # fmt: skip
        """For control points (T, V, 3) m with `faces` (F, 3); `centre` is sparse, the patches' reference points from them."""
        centres = carried(centre, cage)
        instants = np.unique(np.linspace(0, len(cage) - 1, math.ceil((len(cage) - 1) / PROBE_EVERY) + 1).astype(int))
        facing = Facing.of(cage[instants], faces)
        origin = cage.mean(axis=1)
        return cls(operator, patches, points, cage, origin, centres, backend.Float64(centres.ravel()), facing, backend)

    def carry(self, faces: np.ndarray, *, with_places: bool) -> None:
        """Carries along the vertices of the patches of these cage faces, bool (F,); `with_places` keeps all of them at hand."""
        kept = self._kept
        used, corners = np.zeros((2, self.operator.shape[0]), bool)
        facets = np.repeat(self.patches.any_of(faces) | with_places, np.diff(self.patches.starts))
        used[self.patches.nodes[facets]] = corners[self.patches.corners[facets]] = True
        values = carried(self.operator[used], self._local())
        kept["corners"], kept["values"] = corners, values[corners[used]] if with_places else None
        kept["numbers"], kept["corner numbers"] = (np.cumsum(each) - 1 for each in (used, corners))
        kept["vertices"] = self.backend.Float32(values.ravel())

    @property
    def vertices(self) -> Any:
        """Those that were carried along, flat Float32 (V, T, 4) on the device: relative to the origin, and 1."""
        return self._kept["vertices"]

    @property
    def numbers(self) -> np.ndarray:
        """Of all facets' vertices among these, (Vf,)."""
        return self._kept["numbers"]

    @property
    def corner_numbers(self) -> np.ndarray:
        """Of all facets' vertices among those of these that are corners, (Vf,)."""
        return self._kept["corner numbers"]

    def visibility(self, seen: Seen, mesh: VisibilityMesh) -> Any:
        """Of the corners carried along, flat Float32 (Vc, T) on the device; None: all are visible."""
        found = self._carried_visibility("corners", lambda: mesh.facets[self._kept["corners"]], seen, mesh)
        if seen.facet_visibility is not None:
            places = self._kept["values"][..., :3] + self.origin
            sampled = sampled_visibility(seen.facet_visibility, places, self.corner_numbers[self.patches.corners])
            found.append(self.backend.lanes(sampled, self.backend.Float32))
        return _product(found)

    def visibility_of_points(self, seen: Seen, mesh: VisibilityMesh) -> Any:
        """Of the vertices that hold diffuse points, flat Float32 (Vp, T) on the device; None: all are visible."""
        found = self._carried_visibility("points", lambda: mesh.points, seen, mesh)
        if seen.facet_visibility is not None:
            assert self.points is not None
            sampled = self.points.facet_visibility(seen.facet_visibility, self.cage)
            found.append(self.backend.lanes(sampled, self.backend.Float32))
        return _product(found)

    def _carried_visibility(
        self, what: str, operator: Callable[[], Csr], seen: Seen, mesh: VisibilityMesh
    ) -> list[Any]:
        """That over each one-way path, carried along once for all pairs that have the path in common."""
        kept, found = self._kept, []
        for values in seen.visibility:
            key = what, id(mesh), id(values)
            if key not in kept:
                if (what, id(mesh)) not in kept:
                    kept[what, id(mesh)] = operator()
                out = carried(kept[what, id(mesh)], np.asarray(values, np.float32)[..., None])
                kept[key] = values, self.backend.Float32(out.ravel())  # the array lives on, and so its id is its own
            found.append(kept[key][1])
        return found

    @property
    def carrier(self) -> Any:
        """Vertices that hold the diffuse points, flat Float32 (Vp, T, 4) on the device: relative to the origin, and 1."""
        if "carrier" not in self._kept:
            assert self.points is not None
            self._kept["carrier"] = self.backend.Float32(carried(self.points.operator, self._local()).ravel())
        return self._kept["carrier"]

    def _local(self) -> np.ndarray:
        """Control points relative to the origin, and 1, float32 (T, V, 4)."""
        if "local" not in self._kept:
            # Positions within the body need no more than float32: 1e-7 of its size.
            values = self._kept["local"] = np.ones((*self.cage.shape[:2], 4), np.float32)
            np.subtract(self.cage, self.origin[:, None], out=values[..., :3], casting="same_kind")
        return self._kept["local"]


def _product(fields: Sequence[Any]) -> Any:
    """Of arrays on the device; None: there is none."""
    if not fields:
        return None
    return fields[0] if len(fields) == 1 else math.prod(fields[1:], start=fields[0])
