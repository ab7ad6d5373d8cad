"""`Ellipsoids`: rigid ellipsoids in time, the targets of the ellipsoid echo model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, Literal

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, call, listed, shown
from t2d_rt.core.errors import InputError
from t2d_rt.types.material import ByPart, Material, checked_materials
from t2d_rt.types.mesh import MovingMesh, Provenance, Solid, Track
from t2d_rt.types.splines import checked_times, set_fields, spline, within

PoseTrack = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Centres [m] (K, N, 3) and unit axes (K, N, 3, 3), in columns, at times [s] (K,)."""

Method = Literal["mesh", "ellipsoid"]
"""How bodies are modelled."""
LEAST_SEMI_AXIS_M, LARGEST_SEMI_AXIS_M = 1e-6, 1e3
"""Semi-axes outside of these limits are taken for a mistake of units [m]."""


@dataclass(frozen=True, slots=True, init=False, eq=False, repr=False)
class Ellipsoids:
    """N ellipsoids of semi-axes (N, 3) m, the third along the bone, that move during times_s (T,) s.

    `centres` (T, N, 3) m follow a C2 cubic spline between the times. `axes` hold the unit axes in columns: (T, N, 3, 3), or (N, 3,
    3) if they never rotate; by default they are the axes of the world.
    """

    semi_axes_m: np.ndarray
    """Semi-axes [m], float64 (N, 3)."""
    times_s: np.ndarray
    """Times of the frames [s], float64 (T,)."""
    material: str | Material | ByPart
    names: tuple[str, ...]
    track: PoseTrack = field(repr=False)
    """Function that gives centres and axes at any times."""
    made: Provenance | None
    """How they were made; None where a function of the user computes them."""
    name: ClassVar[str] = "the body of ellipsoids"

    def __init__(
        self,
        semi_axes_m: np.ndarray,
        centres: np.ndarray,
        times_s: np.ndarray,
        axes: np.ndarray | None = None,
        material: str | Material | ByPart = "skin",
        *,
        names: Sequence[str] | None = None,
    ) -> None:
        self._fill(semi_axes_m, times_s, material, names)
        times_s, frames, count = self.times_s, len(self.times_s), len(self.semi_axes_m)
        centres = array("centres", centres, (frames, count, 3), limit=LARGEST_M, unit="m").copy()
        axes = np.tile(np.eye(3), (count, 1, 1)) if axes is None else array("axes", axes, limit=2).copy()
        if axes.shape not in ((count, 3, 3), (frames, count, 3, 3)):
            raise InputError(f"axes must have shape ({frames}, {count}, 3, 3) or ({count}, 3, 3), got {axes.shape}")
        if not np.allclose(np.swapaxes(axes, -1, -2) @ axes, np.eye(3), atol=1e-6) or (np.linalg.det(axes) < 0).any():
            raise InputError(
                "axes must hold three right-handed orthogonal unit vectors in columns; normalise them first"
            )
        made = Provenance("arrays", {"centres": centres, "axes": axes})
        set_fields(self, track=_interpolated(times_s, centres, axes), made=made)

    @classmethod
    def from_track(
        cls,
        track: PoseTrack,
        semi_axes_m: np.ndarray,
        times_s: np.ndarray,
        material: str | Material | ByPart = "skin",
        *,
        names: Sequence[str] | None = None,
        made: Provenance | None = None,
    ) -> Ellipsoids:
        """Ellipsoids whose centres and axes are computed by `track` for the times that are asked for, within those of `times_s`.

        `made` says how `track` was made, so that it can be made again from stored data.
        """
        ellipsoids = cls.__new__(cls)
        ellipsoids._fill(semi_axes_m, times_s, material, names)
        call("track", track, "a function from times (K,) to centres (K, N, 3) and axes (K, N, 3, 3)")
        set_fields(ellipsoids, track=track, made=made)
        ellipsoids.at(ellipsoids.times_s[:1])
        return ellipsoids

    def _fill(
        self,
        semi_axes_m: np.ndarray,
        times_s: np.ndarray,
        material: str | Material | ByPart,
        names: Sequence[str] | None,
    ) -> None:
        """Checks and sets the fields that both constructors have in common."""
        times_s = checked_times(times_s)
        semi_axes_m = array("semi_axes_m", semi_axes_m, ("ellipsoid", 3), limit=LARGEST_SEMI_AXIS_M, unit="m").copy()
        if not len(semi_axes_m):
            raise InputError(f"semi_axes_m must have shape (ellipsoid, 3) with at least one, got {semi_axes_m.shape}")
        if not semi_axes_m.min() >= LEAST_SEMI_AXIS_M:
            raise InputError(
                f"semi_axes_m must be positive and finite, got {semi_axes_m.min():.4g} m as the least; give metres, "
                f"{LEAST_SEMI_AXIS_M:g} or more"
            )
        names = tuple(f"ellipsoid{i}" for i in range(len(semi_axes_m))) if names is None else names
        names = listed("names", names, str, "a list of one text for each ellipsoid")
        if len(names) != len(semi_axes_m):
            raise InputError(f"{len(semi_axes_m)} ellipsoids need as many names, got {len(names)}")
        material = checked_materials(material, len(semi_axes_m))
        set_fields(self, semi_axes_m=semi_axes_m, times_s=times_s, material=material, names=names)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame [s]."""
        return float(self.times_s[-1] - self.times_s[0])

    def at(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centres [m] (K, N, 3) and unit axes in columns (K, N, 3, 3), float64, at times [s] (K,) within `times_s`."""
        times_s = within(times_s, self.times_s, self.name)
        pose = self.track(times_s)
        if not isinstance(pose, tuple) or len(pose) != 2:
            raise InputError(f"the track of {self.name} must give centres and axes, got {shown(pose)}")
        shape = len(times_s), len(self.semi_axes_m), 3
        return array("centres of the track", pose[0], shape), array("axes of the track", pose[1], (*shape, 3))

    @property
    def faces(self) -> np.ndarray:
        """No triangles, (0, 3): ellipsoids have none."""
        return np.zeros((0, 3), np.int32)

    @property
    def point_count(self) -> int:
        """Number of points that stand for the moving target: the centres."""
        return len(self.semi_axes_m)

    def points_at(self, times_s: np.ndarray) -> np.ndarray:
        """Centres [m], float64 (K, N, 3), at times [s] (K,) within `times_s`."""
        return self.at(times_s)[0]

    def solid(self) -> Solid:
        """The occluder of these ellipsoids: a triangulated ball for each."""
        from trimesh.creation import icosphere

        ball, count = icosphere(subdivisions=2), len(self.semi_axes_m)
        faces = ball.faces + len(ball.vertices) * np.arange(count)[:, None, None]
        vertices_at = partial(_on_surfaces, self, self.semi_axes_m[:, None] * ball.vertices)
        return Solid(vertices_at, faces.reshape(-1, 3), count * len(ball.vertices))

    def __repr__(self) -> str:
        material = self.material if isinstance(self.material, str) else self.material.name
        return f"Ellipsoids({len(self.names)}: {', '.join(self.names[:3])} ..., {self.duration_s:.3g} s, {material})"


Geometry = MovingMesh | Ellipsoids


def _interpolated(times_s: np.ndarray, centres: np.ndarray, axes: np.ndarray) -> PoseTrack:
    """Splines of the centres and of the axes' quaternions (normalised); what does not move is kept constant."""
    place = spline(times_s, centres)
    if axes.ndim == 3:
        return partial(_without_rotation, place, axes)
    from scipy.spatial.transform import Rotation

    quaternions = Rotation.from_matrix(axes.reshape(-1, 3, 3)).as_quat().reshape(*axes.shape[:2], 4)
    # q and -q are the same rotation; the sign closer to the frame before keeps the spline short.
    flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(-1) < 0, -1.0, 1.0), axis=0)
    quaternions[1:] *= flips[..., None]
    return partial(_rotating, place, spline(times_s, quaternions))


def _without_rotation(place: Track, axes: np.ndarray, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return place(times_s), np.broadcast_to(axes, (len(times_s), *axes.shape)).copy()


def _rotating(place: Track, quaternions: Track, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres and axes from splines of centres (K, N, 3) and of quaternions, which SciPy normalises."""
    from scipy.spatial.transform import Rotation

    centres = place(times_s)
    return centres, Rotation.from_quat(quaternions(times_s).reshape(-1, 4)).as_matrix().reshape(*centres.shape, 3)


def _on_surfaces(ellipsoids: Ellipsoids, surface: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """Points (N, P, 3) given along each ellipsoid's own axes, in the world at times [s] (K,): (K, N P, 3)."""
    centres, axes = ellipsoids.at(times_s)
    return (centres[:, :, None] + np.einsum("knij,nvj->knvi", axes, surface)).reshape(len(centres), -1, 3)
