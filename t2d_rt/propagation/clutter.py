"""Static clutter: paths from antenna to antenna over the static scene, and their occlusion by bodies (docs/physics.md, eq. 26)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.core.memory import LastUsed
from t2d_rt.propagation.edges import bundle, disc
from t2d_rt.propagation.images import vertices
from t2d_rt.propagation.materials import resolved
from t2d_rt.propagation.mirrors import Mirrors, sphere
from t2d_rt.propagation.occluders import FACES_PER_SCENE
from t2d_rt.propagation.paths import find_paths
from t2d_rt.propagation.rays import mitsuba, rays, side_by_side
from t2d_rt.propagation.surroundings import polarization
from t2d_rt.propagation.visibility import faded
from t2d_rt.types import Ellipsoids, MovingMesh, OneWayPath, Radar, Scene, StaticPath
from t2d_rt.types.material import absorbs
from t2d_rt.types.path_fields import reflection

ASIDE_M = 1e-4 * np.array([0.36, 0.48, 0.8])
"""Where transmitter and receiver are one, paths over a corner meet its very edge. Which of them exist, and how they are polarised
straight up and down, is evaluated this far beside: of the orders in which a corner's walls are met just one is left there."""
DIRECTIONS = 4_000
"""Points of rough surfaces lie where as many rays from the transmitters meet them."""
RAYS, PIECES = 32, 4
"""Rays over the first Fresnel zone of a path, and chords of each of its straight parts that they are bent by."""
POINT_RAYS, POINT_PIECES = 4, 1
"""The same for rough points, of which there are many."""

_kept = LastUsed[tuple[StaticPath, ...]](16)


def static_paths(scene: Scene, radar: Radar, *, order: int, backend: Backend) -> tuple[StaticPath, ...]:
    """Specular paths over 1 to `order` mirrors; the line of sight between the antennas is leakage, not clutter.

    Those of the last scenes and radars are kept: the search takes a second in a furnished room.
    """
    tx, rx = radar.tx_position_m, radar.rx_position_m
    out, back = (polarization(radar, angle) for angle in (radar.tx_polarization_deg, radar.rx_polarization_deg))
    at = [np.asarray(each, float).tobytes() for each in (tx, rx, out, back)]
    key = scene.content, order, radar.mid_frequency_hz, backend.name, *at
    return _kept.get(key, partial(_searched, scene, radar, order, backend, out, back))


def _searched(
    scene: Scene, radar: Radar, order: int, backend: Backend, out: np.ndarray, back: np.ndarray
) -> tuple[StaticPath, ...]:
    """The paths of `static_paths`, for the polarisations (3,) of the transmitters and of the receivers."""
    tx, rx = radar.tx_position_m, radar.rx_position_m
    mirrors, beside = Mirrors.of(scene, backend, tx), (rx + ASIDE_M)[None]
    found = find_paths(mirrors, tx, out, radar.mid_frequency_hz, order=order, probes_m=beside)
    return tuple(_path(path, rx, back) for path in found.paths if path.order)


def forget() -> None:
    """Drops the searches for static paths that are kept."""
    _kept.forget()


def _path(path: OneWayPath, receivers: np.ndarray, across: np.ndarray) -> StaticPath:
    """A one-way path from the transmitters, ended at the receivers (3,), whose polarisation is `across` (3,)."""
    beside = receivers + ASIDE_M
    stops = vertices(path, beside)
    ahead = stops[-1] - stops[-2]
    ahead /= np.linalg.norm(ahead)
    taken = across - (ahead @ across) * ahead
    taken /= np.maximum(np.linalg.norm(taken), 1e-12)
    return StaticPath(path=path, stops_m=stops, departure_m=path.unfolded(receivers), taken=taken)


def roughened(scene: Scene, scattering_coefficient: float, frequency_hz: float) -> Scene:
    """The scene with surfaces that scatter, where their materials do not say how much."""
    surfaces = []
    for each in scene.surfaces:
        found = resolved(each.material, frequency_hz)
        own = found.scattering_coefficient or scattering_coefficient * (not absorbs(found))
        surfaces.append(replace(each, material=replace(found, scattering_coefficient=own)))
    return replace(scene, surfaces=tuple(surfaces))


def rough_points(mirrors: Mirrors, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
    """Points of rough surfaces visible to transmitters and receivers, (Q, 3) m, and their RCS (Q,) m^2 (docs/physics.md, eq. 9).

    Each stands for as much of the surface as the transmitters see in an equal fraction of all directions.
    """
    tx, rx = radar.tx_position_m, radar.rx_position_m
    # A ray in each direction stands for a solid angle Omega = 4 pi / DIRECTIONS, and so for Omega R^2 / cos_i of the surface.
    direction = sphere(DIRECTIONS)
    distance, mirror = mirrors.first(np.broadcast_to(tx, direction.shape), direction)
    met = np.isfinite(distance)
    direction, distance, mirror = direction[met], distance[met], mirror[met]
    points = tx + distance[:, None] * direction
    normal = np.array([each.normal for each in mirrors.each])[mirror]
    cosine = np.einsum("qi,qi->q", direction, normal)
    back = rx - points
    cosine_back = -np.sign(cosine) * np.einsum("qi,qi->q", back, normal) / np.linalg.norm(back, axis=1)
    # The projected area of Omega R^2 / cos_i is Omega R^2.
    rcs = 4 * (4 * np.pi / DIRECTIONS) * distance**2 * np.maximum(cosine_back, 0)
    of = np.array([each.surface for each in mirrors.each])[mirror]
    for number, surface in enumerate(mirrors.scene.surfaces):
        mine = of == number
        material = resolved(surface.material, radar.mid_frequency_hz)
        both = reflection(material, surface.thickness_m, np.abs(cosine[mine]), radar.mid_frequency_hz)
        rcs[mine] *= material.scattering_coefficient**2 * np.mean(np.abs(both) ** 2, axis=0)
    visible = rcs > 0
    visible[visible] = mirrors.free(rx, points[visible])
    return points[visible], rcs[visible]


class Shadows:
    """Occlusion of static paths by bodies: the free fraction of the first Fresnel zone at sample times (docs/physics.md, eq.
    27)."""

    def __init__(
        self,
        geometries: Sequence[MovingMesh | Ellipsoids],
        paths_m: Sequence[np.ndarray],
        wavelength_m: float,
        *,
        rays: int = RAYS,
        pieces: int = PIECES,
        samples_s: np.ndarray,
        backend: Backend,
    ) -> None:
        """`paths_m`: vertices (stop, 3) [m] of each of the P paths, from one antenna to the other; traced at `samples_s`."""
        self._samples_s = samples_s
        self._known = np.full((len(self._samples_s), len(paths_m)), np.nan, np.float32)
        solids = [geometry.solid() for geometry in geometries]
        self._vertices_at = [vertices_at for vertices_at, _, _ in solids]
        before = np.cumsum([0, *(count for *_, count in solids)])
        self._faces = np.concatenate([faces + first for (_, faces, _), first in zip(solids, before[:-1], strict=True)])
        self._at_once = int(np.clip(FACES_PER_SCENE // len(self._faces), 1, 64))
        bundles = [bundle(np.asarray(path, float), wavelength_m, disc(rays), pieces) for path in paths_m]
        self._path_of_bundle = np.repeat(np.arange(len(bundles)), [len(each) * pieces for each in bundles])
        self._starts = np.concatenate([each[:, :-1].reshape(-1, rays, 3) for each in bundles])
        self._stops = np.concatenate([each[:, 1:].reshape(-1, rays, 3) for each in bundles])
        self._mitsuba = mitsuba(backend)

    def fractions(self, times_s: np.ndarray) -> np.ndarray:
        """Fractions in 0..1 of the paths' field at times [s] (K,), float32 (K, P)."""
        return faded(times_s, self._samples_s, self._at_samples)

    def _at_samples(self, numbers: np.ndarray) -> np.ndarray:
        new = numbers[np.isnan(self._known[numbers, 0])]
        for first in range(0, len(new), self._at_once):
            some = new[first : first + self._at_once]
            self._known[some] = self.traced(self._samples_s[some])
        return self._known[numbers]

    def traced(self, times_s: np.ndarray) -> np.ndarray:
        """Fractions at just these times, float32 (K, P); at most as many as stand in one scene."""
        vertices = np.concatenate([vertices_at(times_s) for vertices_at in self._vertices_at], axis=1)
        if (vertices == vertices[:1]).all():  # a static target has one and the same shadow, to the last bit
            vertices = vertices[:1]
        blocked = np.zeros((len(vertices), len(self._known[0]), self._starts.shape[1]), bool)
        # Few parts of the paths come near a body at any instant.
        ends = np.stack([self._starts, self._stops])
        low, high = ends.min(axis=(0, 2)), ends.max(axis=(0, 2))
        near = (low <= vertices.max(axis=1)[:, None]) & (high >= vertices.min(axis=1)[:, None])
        instant, piece = np.nonzero(near.all(axis=2))
        if len(piece):
            np.logical_or.at(blocked, (instant, self._path_of_bundle[piece]), self._stopped(vertices, instant, piece))
        return np.broadcast_to(1 - blocked.mean(axis=2, dtype=np.float32), (len(times_s), blocked.shape[1]))

    def _stopped(self, vertices: np.ndarray, instant: np.ndarray, piece: np.ndarray) -> np.ndarray:
        """Which rays of pieces (R,) of bundles meet the bodies (K, V, 3) at their instant (R,), bool (R, rays)."""
        reach = 2.2 * max(float(np.abs(each).max()) for each in (vertices, self._starts, self._stops))
        faces = self._faces + np.arange(len(vertices))[:, None, None] * vertices.shape[1]
        bodies, shift = side_by_side(self._mitsuba, vertices, faces, reach)
        path = self._stops[piece] - self._starts[piece]
        length = np.linalg.norm(path, axis=2)
        direction = path / np.maximum(length, 1e-12)[..., None]
        found = bodies.ray_test(rays(self._mitsuba, self._starts[piece] + shift[instant], direction, length))
        return np.asarray(found.numpy().reshape(length.shape))
