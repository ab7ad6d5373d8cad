"""`Ellipsoids`: rigid ellipsoids in time, the form in which the ellipsoid echo model sees a body."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from t2d_rt.checks import LARGEST_M, array, call, shown
from t2d_rt.errors import InputError
from t2d_rt.types.material import Material, checked_material
from t2d_rt.types.mesh import Made
from t2d_rt.types.splines import spline
from t2d_rt.types.times import checked_times, within

PoseTrack = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Centres [m] (K, N, 3) and unit axes (K, N, 3, 3), in columns, at times [s] (K,)."""

LEAST_SEMI_AXIS_M, LARGEST_SEMI_AXIS_M = 1e-6, 1e3
"""What lies beyond was meant in another unit."""


class Ellipsoids:
    """N ellipsoids of semi-axes (N, 3) m, the third along the bone, between the first and last of times_s (T,) s.

    `centres` (T, N, 3) m follow a C2 cubic spline between the times; `axes` (T, N, 3, 3) hold the unit axes in columns;
    (N, 3, 3) if they never turn; none if they are those of space.
    """

    def __init__(
        self,
        semi_axes_m: np.ndarray,
        centres: np.ndarray,
        times_s: np.ndarray,
        axes: np.ndarray | None = None,
        material: str | Material = "skin",
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
        self._track = _interpolated(times_s, centres, axes)
        self.made: Made | None = Made("arrays", {"centres": centres, "axes": axes})
        """How they were made; None where a function of the user computes them."""

    @classmethod
    def from_track(
        cls,
        track: PoseTrack,
        semi_axes_m: np.ndarray,
        times_s: np.ndarray,
        material: str | Material = "skin",
        *,
        names: Sequence[str] | None = None,
    ) -> Ellipsoids:
        """Ellipsoids whose places are computed when asked for, between the first and last of `times_s`."""
        ellipsoids = cls.__new__(cls)
        ellipsoids.made = None
        ellipsoids._fill(semi_axes_m, times_s, material, names)
        ellipsoids._track = call(
            "track", track, "a function from times (K,) to centres (K, N, 3) and axes (K, N, 3, 3)"
        )
        ellipsoids.at(ellipsoids.times_s[:1])
        return ellipsoids

    name = "the body of ellipsoids"

    def _fill(
        self, semi_axes_m: np.ndarray, times_s: np.ndarray, material: str | Material, names: Sequence[str] | None
    ) -> None:
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
        if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
            raise InputError(f"names must be a list of one text for each ellipsoid, got {shown(names)}")
        if len(names) != len(semi_axes_m):
            raise InputError(f"{len(semi_axes_m)} ellipsoids need as many names, got {len(names)}")
        names = tuple(names)
        self.semi_axes_m = semi_axes_m
        self.times_s = times_s
        self.material = checked_material(material)
        self.names = names

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame [s]."""
        return float(self.times_s[-1] - self.times_s[0])

    def at(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centres [m] (K, N, 3) and unit axes in columns (K, N, 3, 3), float64, at any times within the own ones."""
        times_s = within(times_s, self.times_s, self.name)
        found = self._track(times_s)
        if not isinstance(found, tuple) or len(found) != 2:
            raise InputError(f"the track of {self.name} must give centres and axes, got {shown(found)}")
        shape = len(times_s), len(self.semi_axes_m), 3
        return array("centres of the track", found[0], shape), array("axes of the track", found[1], (*shape, 3))

    def __repr__(self) -> str:
        material = self.material if isinstance(self.material, str) else self.material.name
        return f"Ellipsoids({len(self.names)}: {', '.join(self.names[:3])} ..., {self.duration_s:.3g} s, {material})"


def _interpolated(times_s: np.ndarray, centres: np.ndarray, axes: np.ndarray) -> PoseTrack:
    """Splines of the centres and of the axes' quaternions (normalised); what stands still is left alone."""
    count = centres.shape[1]
    place = spline(times_s, centres)
    if axes.ndim == 3:
        return lambda t: (place(t), np.broadcast_to(axes, (len(t), count, 3, 3)).copy())
    from scipy.spatial.transform import Rotation

    quaternions = Rotation.from_matrix(axes.reshape(-1, 3, 3)).as_quat().reshape(*axes.shape[:2], 4)
    flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(-1) < 0, -1.0, 1.0), axis=0)
    quaternions[1:] *= flips[..., None]
    turn = spline(times_s, quaternions)
    return lambda t: (place(t), Rotation.from_quat(turn(t).reshape(-1, 4)).as_matrix().reshape(len(t), count, 3, 3))
