"""A converged float64 reference for a mesh's ADC samples: no patches, no surface rate, no buckets, no slopes, no anchors.

Every facet and diffuse point is summed anew at each sample's own time and frequency, with its own physical-optics integral
(docs/physics.md, eq. 3, 4, 9); in a room over every path pair (eq. 24). Self-occlusion is traced through the
fine mesh at the chirp's own time, from each path's image; blockage (eq. 28) and what mirrors make of the
polarisation is worked out at each unrefined vertex, and linear in between. Which paths there are is taken from `simulate`'s search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from t2d_rt.accuracy import nmse_db
from t2d_rt.core.backend import Backend, select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.geometry import Refinement, point_spacing, surface_points
from t2d_rt.pipeline.path_pairs import probed
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.rays import columns, mitsuba, mitsuba_mesh
from t2d_rt.propagation.scene_paths import polarization, probes, radar_paths
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.scattering.curved_integral import curved_integrals
from t2d_rt.scattering.mesh import POINTS_PER_MESH
from t2d_rt.scattering.patches import PairPlaces, least_range_m
from t2d_rt.scattering.paths import ranked_pairs
from t2d_rt.scattering.phase_integral import SERIES_TERMS
from t2d_rt.scattering.refinement import MOST_FACETS, POINT_SAGITTA_RAD
from t2d_rt.scattering.refinement import refined as facets_of
from t2d_rt.types import Material, MovingMesh, OneWayPath, PathPair, Radar, Scene
from t2d_rt.types.path_fields import field_over

__all__ = ["Converged", "nmse_db", "reference_samples", "refined"]

MINOR_DB, MINOR_SAGITTA_RAD = -15.0, 0.12
"""Path pairs that much weaker than the strongest one, in the mean over the target, are summed over coarser facets."""
LIFT_M = 2e-3
"""Rays start that far off the surface, along its normal and ahead."""
CURVED_SCALE = 4.0
"""Curved facets need be no finer than of so many times the phase sagitta of flat ones."""
AHEAD = 0.3
"""Cosine by which a facet may look away and yet have a lit corner, if it is curved, or be lit within the chirp."""
HORIZON = 0.1
"""Cosine beyond which a vertex is too far round to belong to a lit facet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Converged:
    """How finely the reference models a target, and what of it."""

    material: Material
    scene: str | Scene | None = None
    """None: free space."""
    reflections: int = 2
    dynamic_range_db: float = 80.0
    seed: int = 0
    sagitta_rad: float | np.ndarray = 0.08
    minor_sagitta_rad: float | np.ndarray = MINOR_SAGITTA_RAD
    occlusion: bool = True


def reference_samples(
    surface: MovingMesh,
    radar: Radar,
    chirps: np.ndarray,
    samples: np.ndarray,
    how: Converged,
) -> np.ndarray:
    """ADC samples [sqrt(W)] complex128 (len(chirps), len(samples)) of a co-located radar with isotropic antennas, in free space
    or in a scene, whose own echoes are left out."""
    dominant, minor, blockage = _path_pairs(surface, radar, how.scene, how.reflections, how.dynamic_range_db)
    points = _points(surface, radar, how.seed)
    scale = CURVED_SCALE if surface.curved else 1.0
    parts = [
        _Part.of(
            pairs, refined(surface, radar, scale * np.asarray(sagitta)), points, how.material, radar, how.occlusion
        )
        for pairs, sagitta in ((dominant, how.sagitta_rad), (minor, how.minor_sagitta_rad))
        if pairs
    ]
    times = samples / radar.sample_rate_hz
    frequencies = radar.carrier_hz + radar.slope_hz_per_s * times
    starts = surface.times_s[0] + radar.chirp_times_s(surface.duration_s)[chirps]
    out = np.zeros((len(chirps), len(samples)), np.complex128)
    for row, start in enumerate(starts):
        ends = surface.at(np.array([start, start + radar.sweep_time_s]))
        instant = _Instant(ends[0], (ends[1] - ends[0]) / radar.sweep_time_s, times, frequencies, blockage)
        for part in parts:
            out[row] += part.samples(instant)
    return out


def refined(surface: MovingMesh, radar: Radar, sagitta_rad: float | np.ndarray) -> Refinement:
    """Facets of that phase sagitta."""
    wavenumber = 2 * math.pi / radar.wavelength_m
    range_m = least_range_m(surface, [PairPlaces.of(radar)], surface.times_s)
    return facets_of(surface, wavenumber, range_m, [sagitta_rad], MOST_FACETS)[0]


# --- paths ---


def _path_pairs(
    surface: MovingMesh, radar: Radar, scene: str | Scene | None, reflections: int, range_db: float
) -> tuple[list[PathPair], list[PathPair], SceneBlockage | None]:
    """Path pairs to the target, dominant ones and minor ones, and what blocks them; in free space there is one pair."""
    scene = load_scene(scene) if isinstance(scene, str) and scene != "free_space" else scene
    if not isinstance(scene, Scene):
        alone = OneWayPath.line_of_sight(radar.tx_position_m, polarization(radar, radar.tx_polarization_deg))
        return [PathPair(out=alone, back=alone)], [], None
    places, _ = probes([surface], float(surface.times_s[0]), float(surface.times_s[-1]))
    found = radar_paths(scene, radar, places, order=reflections, backend=select("cpu"))
    ranked = ranked_pairs(radar, probed(found, places), order=reflections)
    kept = [each for each in ranked if each.best_db >= -range_db]
    dominant, minor = ([e.pair for e in kept if (e.mean_db >= MINOR_DB) == high] for high in (True, False))
    return dominant, minor, found.blockage


class _Instant:
    """A chirp: where the unrefined vertices are, and the field of each one-way path there."""

    def __init__(
        self,
        cage: np.ndarray,
        velocity: np.ndarray,
        times_s: np.ndarray,
        frequencies_hz: np.ndarray,
        blockage: SceneBlockage | None,
    ) -> None:
        self.cage, self.velocity, self.times_s, self.frequencies_hz = cage, velocity, times_s, frequencies_hz
        self._blockage = blockage
        self._known: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def weights(self, pair: PathPair) -> np.ndarray:
        """Factor of a pair on the amplitude of a reflector at the vertices, complex (samples, V) (eq. 24)."""
        (towards_tx, out, unblocked_out), (towards_rx, back, unblocked_back) = self._of(pair.out), self._of(pair.back)
        normal = towards_tx + towards_rx
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        across = _dot(out, normal) * _dot(back, normal)
        return pair.copies * np.conj(_dot(out, back) - 2 * across) * unblocked_out * unblocked_back

    def _of(self, path: OneWayPath) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Directions to the image (V, 3), the field (samples, V, 3), and the fraction that the scene does not block (V,)."""
        if id(path) not in self._known:
            line_of_sight = path.image_m - self.cage
            towards = line_of_sight / np.linalg.norm(line_of_sight, axis=1, keepdims=True)
            fraction = np.ones(len(self.cage))
            if self._blockage is not None:
                fraction = self._blockage.fraction(path, self.cage).astype(float)
            self._known[id(path)] = towards, field_over(path, self.cage, self.frequencies_hz), fraction
        return self._known[id(path)]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)


# --- sums ---


@dataclass(frozen=True, slots=True)
class _Part:
    """Path pairs that are summed over one refinement of the target."""

    pairs: list[PathPair]
    fine: Refinement
    incidence: Any
    """Sparse (vertices, faces) of the fine mesh, 1 where one belongs to the other."""
    points: _Points
    material: Material
    radar: Radar
    occlusion: bool
    backend: Backend

    @classmethod
    def of(
        cls, pairs: list[PathPair], fine: Refinement, points: _Points, material: Material, radar: Radar, occlusion: bool
    ) -> _Part:
        from scipy.sparse import csr_array

        faces = fine.faces
        where = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
        incidence = csr_array((np.ones(faces.size), where), shape=(fine.operator.shape[0], len(faces)))
        return cls(pairs, fine, incidence, points, material, radar, occlusion, select("cpu"))

    def samples(self, instant: _Instant) -> np.ndarray:
        """Of one chirp (samples,)."""
        start, moving = self.fine.at(instant.cage), self.fine.at(instant.velocity)
        at, at_velocity, point_normal = (
            self.points.place(instant.cage), self.points.place(instant.velocity), self.points.normals(instant.cage),
        )  # fmt: skip
        now = [
            (start + t * moving, at + t * at_velocity, frequency)
            for t, frequency in zip(instant.times_s, instant.frequencies_hz, strict=True)
        ]
        view = _View(start, self.fine.faces, self.incidence, self.backend)
        visibilities = {}
        for pair in self.pairs:
            for path in (pair.out, pair.back):
                if id(path) not in visibilities:
                    visibilities[id(path)] = self._visibility(view, path, at, point_normal)
        vertices = [self._on_device(places) for places, _, _ in now]
        rough, gamma = self.material.scattering_coefficient, self.material.reflection(self.radar.mid_frequency_hz)
        out = np.zeros(len(now), np.complex128)
        for pair in self.pairs:
            (facing, visible, points_visibility), (facing_back, visibility_back, points_back) = (
                visibilities[id(pair.out)],
                visibilities[id(pair.back)],
            )
            nodes = self.fine.nodes[facing & facing_back]
            weights = instant.weights(pair)
            if not weights.any() or not len(nodes):
                continue
            for k, (_, places, frequency) in enumerate(now):
                weight = (self.fine.linear @ weights[k]) * visible * visibility_back
                out[k] += (
                    math.sqrt(1 - rough**2) * np.conj(gamma) * self._facets(vertices[k], nodes, weight, pair, frequency)
                )
                if rough > 0:
                    weight = self.points.carried(weights[k]) * points_visibility * points_back
                    out[k] += rough * abs(gamma) * self._diffuse(places, point_normal, weight, pair, frequency)
        return out

    def _visibility(
        self, view: _View, path: OneWayPath, at: np.ndarray, normal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Over a one-way path: which faces may be lit (F,), and the visibility of vertices (V,) and of diffuse points."""
        facing = view.facing(path.image_m)
        if not self.occlusion:
            return facing, np.ones(len(view.vertices)), np.ones(len(at))
        return facing, view.visible(view.vertices, view.normals, path.image_m), view.visible(at, normal, path.image_m)

    def _on_device(self, vertices: np.ndarray) -> list[Any]:
        return [self.backend.lanes(vertices[:, axis], self.backend.Float64) for axis in range(3)]

    def _facets(
        self, vertices: list[Any], nodes: np.ndarray, weight: np.ndarray, pair: PathPair, frequency: float
    ) -> complex:
        """-(j sqrt(4 pi)/lambda) sum w integral of (n.r) exp(..)/(R_out R_back), n.r half the sum of the cosines, with the residual
        video phase of each facet's delay; Gamma left out. Flat facets are curved ones that do not bulge."""
        import drjit as dr

        Float64 = self.backend.Float64
        images = [[dr.opaque(Float64, float(x)) for x in path.image_m] for path in (pair.out, pair.back)]
        columns = [self.backend.lanes(column) for column in nodes.T]
        places = [[dr.gather(Float64, axis, column) for axis in vertices] for column in columns]
        corners, centroid = places[:3], [sum(each) / 3 for each in zip(*places[:3], strict=True)]
        path = _path(centroid, images)
        wavenumber = dr.opaque(Float64, 2 * math.pi * frequency / SPEED_OF_LIGHT)
        phases = [wavenumber * (_path(place, images) - path) for place in places]
        bulges, bubbles = [[0.0] * 3] * 3, [dr.zeros(Float64, len(nodes))] * 3
        if len(places) == 6:
            sides = [(places[3 + i], corners[i], corners[(i + 1) % 3]) for i in range(3)]
            bulges = [[4 * m - 2 * (a + b) for m, a, b in zip(*side, strict=True)] for side in sides]
            bubbles = [4 * phases[3 + i] - 2 * (phases[i] + phases[(i + 1) % 3]) for i in range(3)]
        amplitudes = []
        for i, corner in enumerate(corners):
            ahead = [x + y for x, y in zip(_minus(corners[(i + 1) % 3], corner), bulges[i], strict=True)]
            back = [x + y for x, y in zip(_minus(corners[i - 1], corner), bulges[i - 1], strict=True)]
            normal, obliquity, spread, lit = _cross(ahead, back), 0.0, 1.0, True
            for image in images:
                line_of_sight = _minus(image, corner)
                distance = dr.sqrt(_inner(line_of_sight, line_of_sight))
                projected = _inner(normal, line_of_sight) / distance
                obliquity, spread, lit = obliquity + projected / 2, spread * distance, lit & (projected > 0)
            amplitudes.append(dr.select(lit, obliquity / spread, 0))
        ops = SimpleNamespace(minimum=dr.minimum, maximum=dr.maximum, where=dr.select, sincos=dr.sincos, fma=dr.fma)
        (x, y), _ = curved_integrals(phases[:3], amplitudes, bubbles, ops=ops, terms=SERIES_TERMS[8], order=2)
        delay = path / SPEED_OF_LIGHT + dr.opaque(Float64, pair.delay_s)
        cycles = (
            dr.opaque(Float64, frequency) * delay - dr.opaque(Float64, self.radar.slope_hz_per_s / 2) * delay * delay
        )
        sin, cos = dr.sincos(2 * math.pi * (cycles - dr.floor(cycles)))
        x, y = x * cos - y * sin, x * sin + y * cos
        real, imag = (self.backend.lanes(part, Float64) for part in (weight.real, weight.imag))
        u, v = (sum(dr.gather(Float64, part, corner) for corner in columns[:3]) / 3 for part in (real, imag))
        total = dr.sum(x * u - y * v), dr.sum(x * v + y * u)
        dr.eval(total)
        factor = -1j * math.sqrt(4 * math.pi) / (SPEED_OF_LIGHT / frequency) * self.radar.link_amplitude
        return factor * complex(total[0][0], total[1][0])

    def _diffuse(
        self, at: np.ndarray, normal: np.ndarray, weight: np.ndarray, pair: PathPair, frequency: float
    ) -> complex:
        """Points of sigma = 4 A cos_out cos_back, S |Gamma| left out."""
        lit = np.flatnonzero(weight)
        at, normal, field = at[lit], normal[lit], weight[lit] * np.sqrt(self.points.area_m2[lit])
        path = np.zeros(len(at))
        for one_way in (pair.out, pair.back):
            line_of_sight = one_way.image_m - at
            distance = np.linalg.norm(line_of_sight, axis=1)
            field = field * np.sqrt(np.maximum(_dot(normal, line_of_sight) / distance, 0)) / distance
            path += distance
        delay = path / SPEED_OF_LIGHT + pair.delay_s
        cycles = (frequency * delay - 0.5 * self.radar.slope_hz_per_s * delay**2) % 1.0
        phasor = np.exp(1j * (2 * math.pi * cycles + self.points.phase_rad[lit]))
        return complex(2 * self.radar.link_amplitude * np.sum(field * phasor))


def _path(point: list[Any], images: list[list[Any]]) -> Any:
    """From one image to a point and on to the other [m]."""
    lines_of_sight = (_minus(point, image) for image in images)
    return sum(_inner(line_of_sight, line_of_sight) ** 0.5 for line_of_sight in lines_of_sight)


def _minus(a: list[Any], b: list[Any]) -> list[Any]:
    return [x - y for x, y in zip(a, b, strict=True)]


def _inner(a: list[Any], b: list[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: list[Any], b: list[Any]) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


# --- self-occlusion ---


class _View:
    """A fine mesh at one instant, seen from anywhere."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, incidence: Any, backend: Backend) -> None:
        self.vertices = vertices
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        self._across, self._middle = np.cross(b - a, c - a), (a + b + c) / 3
        normals = incidence @ self._across
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        self._mi = mitsuba(backend)
        self._scene = self._mi.load_dict({"type": "scene", "body": mitsuba_mesh(self._mi, vertices, faces)})

    def facing(self, place: np.ndarray) -> np.ndarray:
        """Which faces look there, or just past, bool (F,)."""
        line_of_sight = place - self._middle
        size = np.sqrt(_dot(self._across, self._across) * _dot(line_of_sight, line_of_sight))
        return _dot(self._across, line_of_sight) > -AHEAD * size

    def visible(self, points: np.ndarray, normals: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Whether nothing of the mesh stands between points on it (Q, 3) and a place, 0 or 1 (Q,)."""
        mi, line_of_sight = self._mi, place - points
        ahead = line_of_sight / np.linalg.norm(line_of_sight, axis=1, keepdims=True)
        # Only corners of facets have a normal.
        visible = (_dot(ahead, normals) > -HORIZON) & normals.any(axis=1)
        origin = points[visible] + LIFT_M * (ahead[visible] + normals[visible])
        ray = mi.Ray3f(mi.Point3f(*columns(mi, origin)), mi.Vector3f(*columns(mi, ahead[visible])))
        ray.maxt = mi.Float(np.inf)
        visible[visible] = ~self._scene.ray_test(ray).numpy() if len(origin) else True
        return visible.astype(float)


class _Points:
    """The diffuse realisation that a seed stands for, on the carrier on which it is defined."""

    def __init__(self, rest: np.ndarray, carrier: Refinement, seed: int) -> None:
        carrier = carrier.flattened(rest)
        vertices = carrier.at(rest)
        a, b, c = (vertices[carrier.faces[:, i]] for i in range(3))
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        spread = surface_points(vertices, carrier.faces, seed=seed, spacing_m=point_spacing(area, POINTS_PER_MESH))
        self.faces, self.weights = carrier.faces[spread.face], spread.barycentric
        self.area_m2, self.phase_rad = spread.area_m2, spread.phase_rad
        self.carrier = carrier

    def place(self, cage: np.ndarray) -> np.ndarray:
        """Positions (Q, 3), linear in the cage's."""
        return np.einsum("qi,qij->qj", self.weights, self.carrier.at(cage)[self.faces])

    def carried(self, field: np.ndarray) -> np.ndarray:
        """A field of the cage's vertices (V,), linear from these to the points (Q,)."""
        return np.einsum("qi,qi->q", self.weights, (self.carrier.linear @ field)[self.faces])

    def normals(self, cage: np.ndarray) -> np.ndarray:
        """Unit normals (Q, 3)."""
        corners = self.carrier.at(cage)[self.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _points(surface: MovingMesh, radar: Radar, seed: int) -> _Points:
    return _Points(surface.rest, refined(surface, radar, POINT_SAGITTA_RAD), seed)
