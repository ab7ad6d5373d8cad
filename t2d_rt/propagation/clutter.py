"""Static clutter: paths from antenna to antenna over the static scene, and their occlusion by bodies (docs/physics.md, eq. 26)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from t2d_rt.propagation.paths import Along, find_paths
from t2d_rt.propagation.rays import mitsuba, rays, scene_of_instants
from t2d_rt.propagation.scene_paths import polarization
from t2d_rt.propagation.visibility import between_samples
from t2d_rt.types import Ellipsoids, MovingMesh, OneWayPath, Radar, Scene, StaticPath
from t2d_rt.types.material import absorbs
from t2d_rt.types.path_fields import reflection
from t2d_rt.types.paths import passed
from t2d_rt.types.scatterer import Fraction

ASIDE_M = 1e-4 * np.array([0.36, 0.48, 0.8])
"""Offset [m] from the receivers at which it is found which paths exist and how those straight up and down are polarised. With
transmitter and receiver in one place, paths over a corner meet its very edge; at the offset only one order of its walls remains."""
DIRECTIONS = 4_000
"""Number of rays from the transmitters that place the points of rough surfaces."""
RAYS, PIECES = 32, 4
"""Number of rays over the first Fresnel zone of a path, and of the chords in which they follow each of its straight parts."""
POINT_RAYS, POINT_PIECES = 4, 1
"""Number of rays and of chords for rough points, of which there are many."""

Courses = Sequence[np.ndarray] | Callable[[np.ndarray], Sequence[np.ndarray]]
"""Vertices (stop, 3) [m] of each path, or a function that gives them as (stop, K, 3) at times (K,) [s]."""
_last_paths = LastUsed[tuple[StaticPath, ...]](16)


def static_paths(
    scene: Scene, radar: Radar, *, order: int, backend: Backend, samples_s: np.ndarray | None = None
) -> tuple[StaticPath, ...]:
    """Specular paths over 1 to `order` mirrors; the line of sight between the antennas is leakage, not clutter. For a radar that
    moves these are all paths that exist at any of the sample times (S,) [s]; without sample times a ValueError is raised.

    The paths of the last scenes and radars are kept: the search takes a second in a furnished room.
    """
    tx, rx = radar.tx_position_m, radar.rx_position_m
    out, back = (polarization(radar, angle) for angle in (radar.tx_polarization_deg, radar.rx_polarization_deg))
    at = [np.asarray(vector, float).tobytes() for vector in (tx, rx, out, back)]
    if radar.track is None:
        samples_s = None
    elif samples_s is None:
        raise ValueError("static paths of a radar that moves are searched at sample times, got None; give samples_s")
    track_key = None if samples_s is None else (radar.track, samples_s.tobytes())
    key = scene.content, order, radar.mid_frequency_hz, backend.name, track_key, *at
    return _last_paths.get(key, partial(_searched, scene, radar, order, backend, out, back, samples_s))


def _searched(
    scene: Scene,
    radar: Radar,
    order: int,
    backend: Backend,
    out: np.ndarray,
    back: np.ndarray,
    samples_s: np.ndarray | None,
) -> tuple[StaticPath, ...]:
    """The paths of `static_paths`, for the polarisations (3,) of the transmitters and of the receivers."""
    tx, rx = radar.tx_position_m, radar.rx_position_m
    mirrors, beside, along = Mirrors.of(scene, backend, tx), (rx + ASIDE_M)[None], None
    if samples_s is not None:
        passing = radar.passing(samples_s)
        beside = passing.points(passing.back.points(np.repeat(rx[None], len(samples_s), axis=0)) + ASIDE_M)
        along = Along.of(radar, (samples_s[0], samples_s[-1]), samples_s)
    path_set = find_paths(mirrors, tx, out, radar.mid_frequency_hz, order=order, probes_m=beside, along=along)
    if samples_s is None:
        return tuple(_path(path, rx, back) for path in path_set.paths if path.order)
    return tuple(
        replace(_path(path, rx, back, samples_s[:1]), at=partial(_path, path, rx, back), fraction=fraction)
        for path, fraction in zip(path_set.paths, path_set.fraction, strict=True)
        if path.order
    )


def forget() -> None:
    """Drops the searches for static paths that are kept."""
    _last_paths.forget()


def _path(path: OneWayPath, receivers: np.ndarray, across: np.ndarray, times_s: np.ndarray | None = None) -> StaticPath:
    """The static path along a one-way path from the transmitters to the receivers (3,) [m], whose polarisation is `across` (3,); at
    times (T,) [s] for a radar that moves."""
    course, places = path.in_scene(times_s), receivers
    if path.passing is not None:
        back = passed(path.passing, times_s).back
        receivers, across = (np.broadcast_to(vector, back.shift_m.shape) for vector in (receivers, across))
        places, across = back.points(receivers), back.directions(across)
    stops = vertices(course, places + ASIDE_M)
    ahead = stops[-1] - stops[-2]
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    taken = across - np.einsum("...i,...i->...", ahead, across)[..., None] * ahead
    taken /= np.maximum(np.linalg.norm(taken, axis=-1, keepdims=True), 1e-12)
    departure = path.unfolded(receivers, times_s)
    return StaticPath(path=course, stops_m=stops, departure_m=departure, taken=taken, arrival_m=path.place_m(times_s))


def existing_over(paths: Sequence[StaticPath], samples_s: np.ndarray, unoccluded: Fraction | None) -> Fraction:
    """Which of a moving radar's paths exist, found at times (S,) [s] and faded in between, times the fractions `unoccluded`."""
    sampled = np.stack([path.fraction for path in paths if path.fraction is not None], axis=1)
    return partial(_existing, sampled, samples_s, unoccluded)


def _existing(
    sampled: np.ndarray, samples_s: np.ndarray, unoccluded: Fraction | None, times_s: np.ndarray
) -> np.ndarray:
    """The fractions (K, N) of `existing_over` at times (K,) [s], from those at its sample times, (S, N)."""
    fractions = between_samples(times_s, samples_s, sampled.__getitem__)
    return fractions if unoccluded is None else fractions * unoccluded(times_s)


def static_courses(radar: Radar, paths: Sequence[StaticPath], times_s: np.ndarray) -> list[np.ndarray]:
    """Vertices (stop, K, 3) [m] of each path at times (K,) [s], in the frame in which the moving radar stands still."""
    passing = radar.passing(times_s)
    stops = (path.at(times_s).stops_m for path in paths if path.at is not None)
    return [passing.points(stop.swapaxes(0, 1)).swapaxes(0, 1) for stop in stops]


def roughened(scene: Scene, scattering_coefficient: float, frequency_hz: float) -> Scene:
    """The scene with this scattering coefficient for surfaces whose materials have none and do not absorb."""
    surfaces = []
    for surface in scene.surfaces:
        material = resolved(surface.material, frequency_hz)
        coefficient = material.scattering_coefficient or scattering_coefficient * (not absorbs(material))
        surfaces.append(replace(surface, material=replace(material, scattering_coefficient=coefficient)))
    return replace(scene, surfaces=tuple(surfaces))


def rough_points(mirrors: Mirrors, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
    """Points (Q, 3) [m] of rough surfaces visible to transmitters and receivers, and their RCS (Q,) [m^2] (eq. 9 and 26).

    Each stands for as much of the surface as the transmitters see in an equal fraction of all directions.
    """
    tx, rx = radar.tx_position_m, radar.rx_position_m
    # A ray in each direction stands for a solid angle Omega = 4 pi / DIRECTIONS, and so for Omega R^2 / cos_i of the surface.
    direction = sphere(DIRECTIONS)
    distance, mirror = mirrors.first(np.broadcast_to(tx, direction.shape), direction)
    met = np.isfinite(distance)
    direction, distance, mirror = direction[met], distance[met], mirror[met]
    points = tx + distance[:, None] * direction
    normal = np.array([part.normal for part in mirrors.parts])[mirror]
    cosine = np.einsum("qi,qi->q", direction, normal)
    back = rx - points
    cosine_back = -np.sign(cosine) * np.einsum("qi,qi->q", back, normal) / np.linalg.norm(back, axis=1)
    # The projected area of Omega R^2 / cos_i is Omega R^2.
    rcs = 4 * (4 * np.pi / DIRECTIONS) * distance**2 * np.maximum(cosine_back, 0)
    of = np.array([part.surface for part in mirrors.parts])[mirror]
    for number, surface in enumerate(mirrors.scene.surfaces):
        on_surface = of == number
        material = resolved(surface.material, radar.mid_frequency_hz)
        coefficients = reflection(material, surface.thickness_m, np.abs(cosine[on_surface]), radar.mid_frequency_hz)
        rcs[on_surface] *= material.scattering_coefficient**2 * np.mean(np.abs(coefficients) ** 2, axis=0)
    visible = rcs > 0
    visible[visible] = mirrors.free(rx, points[visible])
    return points[visible], rcs[visible]


def _rays_along(wavelength_m: float, rays: int, pieces: int, paths_m: Sequence[np.ndarray]) -> np.ndarray:
    """Starts and ends [m] of all pieces of the rays around paths (stop, 3) or (stop, K, 3), (2, 1 or K, piece, ray, 3)."""
    bundles = [bundle(np.asarray(path, float), wavelength_m, disc(rays), pieces) for path in paths_m]
    shape = -1, *bundles[0].shape[2:-2], rays, 3
    ends = np.stack(
        [np.concatenate([points[:, part].reshape(shape) for points in bundles]) for part in (slice(-1), slice(1, None))]
    )
    return ends[:, None] if ends.ndim == 4 else ends.swapaxes(1, 2)


class Shadows:
    """Occlusion of static paths by bodies: the free fraction of the first Fresnel zone at sample times (docs/physics.md, eq.
    27)."""

    def __init__(
        self,
        geometries: Sequence[MovingMesh | Ellipsoids],
        paths_m: Courses,
        wavelength_m: float,
        *,
        rays: int = RAYS,
        pieces: int = PIECES,
        samples_s: np.ndarray,
        backend: Backend,
    ) -> None:
        """`paths_m` gives the vertices of the P paths, from one antenna to the other; rays are traced at `samples_s` (S,) [s]."""
        self._samples_s = samples_s
        solids = [geometry.solid() for geometry in geometries]
        self._vertices_at = [vertices_at for vertices_at, _, _ in solids]
        before = np.cumsum([0, *(count for *_, count in solids)])
        self._faces = np.concatenate([faces + first for (_, faces, _), first in zip(solids, before[:-1], strict=True)])
        self._at_once = int(np.clip(FACES_PER_SCENE // len(self._faces), 1, 64))
        self._bundle, self._paths_m, self._standing = partial(_rays_along, wavelength_m, rays, pieces), paths_m, None
        first = paths_m(samples_s[:1]) if callable(paths_m) else paths_m
        if not callable(paths_m):
            self._standing = self._bundle(paths_m)
        self._path_of_bundle = np.repeat(np.arange(len(first)), [(len(stops) - 1) * pieces for stops in first])
        self._known = np.full((len(self._samples_s), len(first)), np.nan, np.float32)
        self._mitsuba = mitsuba(backend)

    def fractions(self, times_s: np.ndarray) -> np.ndarray:
        """Fractions in 0..1 of the paths' field at times [s] (K,), float32 (K, P)."""
        return between_samples(times_s, self._samples_s, self._at_samples)

    def _at_samples(self, numbers: np.ndarray) -> np.ndarray:
        new = numbers[np.isnan(self._known[numbers, 0])]
        for first in range(0, len(new), self._at_once):
            batch = new[first : first + self._at_once]
            self._known[batch] = self.traced(self._samples_s[batch])
        return self._known[numbers]

    def traced(self, times_s: np.ndarray) -> np.ndarray:
        """Fractions at just these times (K,) [s], at most as many as one scene holds, float32 (K, P)."""
        vertices = np.concatenate([vertices_at(times_s) for vertices_at in self._vertices_at], axis=1)
        ends = self._standing
        if callable(self._paths_m):
            ends = self._bundle(self._paths_m(times_s))
        elif (vertices == vertices[:1]).all():  # a static target has one and the same shadow, to the last bit
            vertices = vertices[:1]
        assert ends is not None
        blocked = np.zeros((len(vertices), len(self._known[0]), ends.shape[3]), bool)
        # Few parts of the paths come near a body at any instant.
        low, high = ends.min(axis=(0, 3)), ends.max(axis=(0, 3))
        near = (low <= vertices.max(axis=1)[:, None]) & (high >= vertices.min(axis=1)[:, None])
        instant, piece = np.nonzero(near.all(axis=2))
        if len(piece):
            np.logical_or.at(
                blocked, (instant, self._path_of_bundle[piece]), self._stopped(vertices, instant, piece, ends)
            )
        return np.broadcast_to(1 - blocked.mean(axis=2, dtype=np.float32), (len(times_s), blocked.shape[1]))

    def _stopped(self, vertices: np.ndarray, instant: np.ndarray, piece: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Which rays of pieces (R,) of bundles, given by their `ends`, meet the bodies (K, V, 3) at their instant (R,), bool
        (R, rays)."""
        reach = 2.2 * max(float(np.abs(points).max()) for points in (vertices, ends))
        faces = self._faces + np.arange(len(vertices))[:, None, None] * vertices.shape[1]
        bodies, shift = scene_of_instants(self._mitsuba, vertices, faces, reach)
        starts, stops = np.broadcast_to(ends, (2, len(vertices), *ends.shape[2:]))[:, instant, piece]
        path = stops - starts
        length = np.linalg.norm(path, axis=2)
        direction = path / np.maximum(length, 1e-12)[..., None]
        hits = bodies.ray_test(rays(self._mitsuba, starts + shift[instant], direction, length))
        return np.asarray(hits.numpy().reshape(length.shape))
