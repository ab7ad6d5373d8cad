"""One-way paths between antennas and targets in a room, and their blockage by the room."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import blocks
from t2d_rt.geometry import winding
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.mean_visibility import poses
from t2d_rt.propagation.mirrors import Mirrors, has_room
from t2d_rt.propagation.paths import Along, FoundPaths, find_paths
from t2d_rt.propagation.visibility import between_samples, sample_times
from t2d_rt.types import Ellipsoids, MovingMesh, OneWayPath, Radar, Scene
from t2d_rt.types.paths import points_in_scene

MOST_INSIDE = 64
"""Approximate number of points of the targets that are tested for being in the room."""
PROBE_RATE_HZ, PROBES = 5.0, 40
"""Rate [Hz] and approximate number of the points of a target to which paths are searched."""


def probes(
    geometries: Sequence[MovingMesh | Ellipsoids], start_s: float, stop_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points of the targets over the record [m], (P, 3), and when they are there [s], (P,)."""
    times = sample_times(start_s, stop_s, PROBE_RATE_HZ)
    places, when_s = [], []
    for geometry in geometries:
        for block_s in blocks(times, geometry.point_count):
            points = geometry.points_at(block_s)
            points = points[:, :: max(1, points.shape[1] // PROBES)]
            places.append(points.reshape(-1, 3))
            when_s.append(np.repeat(block_s, points.shape[1]))
    return np.concatenate(places), np.concatenate(when_s)


@dataclass(frozen=True, slots=True)
class RadarPaths:
    """One-way paths of the transmitters' and of the receivers' centre."""

    out: FoundPaths
    back: FoundPaths
    one_antenna: bool
    """Whether both centres are one antenna, in one place and of one polarisation, with the same paths."""

    @property
    def blockage(self) -> SceneBlockage:
        """What of the scene blocks these paths."""
        return SceneBlockage({side.paths.antenna_m.tobytes(): side.edges for side in (self.out, self.back)})


def radar_paths(
    scene: Scene,
    radar: Radar,
    probes_m: np.ndarray,
    *,
    order: int,
    transmissions: int = 0,
    backend: Backend,
    along: Along | None = None,
) -> RadarPaths:
    """One-way paths of up to `order` reflections and `transmissions` slabs between the radar, which may move `along` a track, and
    any of points (Q, 3) [m]. Raises InputError for a radar that `_check_inside` refuses."""
    if radar.track is not None and along is None:
        raise ValueError("paths of a radar that moves are searched along its track, got none; give along")
    mirrors = Mirrors.of(scene, backend, radar.tx_position_m)
    _check_inside(scene, mirrors, radar, probes_m, through=transmissions > 0, along=along)
    search = partial(
        find_paths,
        mirrors,
        frequency_hz=radar.mid_frequency_hz,
        order=order,
        transmissions=transmissions,
        probes_m=probes_m,
        along=along,
    )
    tx = radar.tx_position_m, polarization(radar, radar.tx_polarization_deg)
    rx = radar.rx_position_m, polarization(radar, radar.rx_polarization_deg)
    out, one_antenna = search(*tx), np.array_equal(tx, rx)
    return RadarPaths(out, out if one_antenna else search(*rx), one_antenna)


def polarization(radar: Radar, angle_deg: float) -> np.ndarray:
    """Unit vector (3,) in the world of a linear polarisation at an angle from the radar's up axis towards its left axis."""
    angle = math.radians(angle_deg)
    return np.asarray(np.array([0.0, math.sin(angle), math.cos(angle)]) @ radar.axes)


def _check_inside(
    scene: Scene, mirrors: Mirrors, radar: Radar, probes_m: np.ndarray, *, through: bool, along: Along | None
) -> None:
    """Refuses a radar within a slab or a closed surface, unless that is the room: it holds the targets as well, or is as large as
    one and paths may lead `through` it."""
    if along is not None:
        probes_m = points_in_scene(along.passing, probes_m, along.probed_s)
    sample_m = probes_m[:: max(1, len(probes_m) // MOST_INSIDE)]
    centres = radar.tx_position_m, radar.rx_position_m
    for place in centres if along is None else np.concatenate([along.places_m(centre) for centre in centres]):
        slab = mirrors.slab_at(place)
        enclosures = [] if slab is None else [(slab, False)]
        for name, triangles in mirrors.shells_enclosing(place):
            if np.mean([abs(winding(triangles - probe_m)) > 0.5 for probe_m in sample_m]) <= 0.5:
                enclosures.append((name, has_room(np.ptp(triangles.reshape(-1, 3), axis=0))))
        for name, as_room in enclosures:
            if as_room and through:
                continue
            advice = "; move the radar (position_m) or the furniture"
            if as_room:
                advice = " and the target is not; move one of them, or allow transmissions for paths through walls"
            where = ", ".join(f"{x:.3g}" for x in place)
            raise InputError(f"the radar at ({where}) m is inside {name} of scene {scene.name}{advice}")


@dataclass(frozen=True, slots=True, eq=False)
class Unblocked:
    """The fraction of the field over a path that the static scene leaves, as a function of times."""

    samples_s: np.ndarray
    """Sample times [s], (S,)."""
    at_samples: np.ndarray
    """The fractions at these times, (S, N) or (S, 1)."""
    count: int
    """Number N of points."""

    def __call__(self, times_s: np.ndarray) -> np.ndarray:
        """The fractions (K, N) at times (K,) [s]."""
        fraction = between_samples(times_s, self.samples_s, self.at_samples.__getitem__)
        return np.broadcast_to(fraction, (len(times_s), self.count))


def unblocked(
    geometry: MovingMesh | Ellipsoids,
    vertices: np.ndarray,
    paths: Sequence[OneWayPath],
    scene: SceneBlockage,
    samples_s: np.ndarray,
    *,
    minor: bool = False,
    in_the_mean: bool = False,
) -> list[Unblocked]:
    """What the static scene leaves of the field at a few points of a target, over each path, sampled at `samples_s` [s] (S,).

    The points of a mesh are some of its `vertices`, in a few poses where it has a period. Those of ellipsoids are their centres and
    far ends, as the field fades over about their width, or over `minor` paths the centres alone. With `in_the_mean` all points
    have the mean over them.
    """
    posed_s, pose = samples_s, None
    if isinstance(geometry, MovingMesh):
        if geometry.period_s is not None:
            posed_s, pose = poses(geometry, samples_s)
        at_once = blocks(posed_s, len(geometry.rest))
        points = np.concatenate([geometry.at(block_s)[:, vertices, None] for block_s in at_once])
    else:
        centres, axes = geometry.at(samples_s)
        points = centres[:, :, None]
        if not minor:
            number, longest = np.arange(len(geometry.semi_axes_m)), geometry.semi_axes_m.argmax(axis=1)
            end = axes[:, number, :, longest].swapaxes(0, 1) * geometry.semi_axes_m.max(axis=1)[:, None]
            points = np.stack([centres, centres + end, centres - end], axis=2)
    # All at once: a kernel's start costs as much as some thousand rays.
    fractions = scene.fractions(paths, points, posed_s).mean(axis=3)
    if in_the_mean:
        fractions = fractions.mean(axis=2, keepdims=True)
    if pose is not None:
        fractions = fractions[:, pose]
    return [Unblocked(samples_s, fraction, points.shape[1]) for fraction in fractions]
