"""A converged float64 reference for a mesh's ADC samples: no patches, no surface rate, no buckets, no slopes, no anchors.

Every facet and diffuse point is summed anew at each sample's own moment and frequency, with its own physical-optics integral
(docs/physics.md, eq. 3, 4, 9); in a room over every pair of ways (eq. 24). What the target hides of itself is traced through the
fine mesh at the chirp's own moment, from each way's image; what still things let past (eq. 28) and what mirrors make of the
polarisation is worked out at each unrefined vertex, and linear in between. Which ways there are is taken from `simulate`'s search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from t2d_rt.accuracy import nmse_db
from t2d_rt.backend import Backend, select
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.echo.legs import ranked_pairs
from t2d_rt.echo.mesh import POINT_SAGITTA_RAD, POINTS_PER_MESH, least_range_m
from t2d_rt.echo.phase_integral import SERIES_TERMS, divided_differences
from t2d_rt.geometry import Refinement, point_spacing, refine, surface_points
from t2d_rt.trace.mitsuba import columns, mitsuba, mitsuba_mesh
from t2d_rt.trace.scenes import load_scene
from t2d_rt.trace.surroundings import polarization, probes, radar_legs
from t2d_rt.types import Leg, LegPair, Material, MovingMesh, Radar, Scene

__all__ = ["nmse_db", "reference_samples", "refined"]

WEAK_DB, WEAK_SAGITTA_RAD = -15.0, 0.12
"""Pairs of ways that much weaker than the strongest one, in the mean over the target, are summed over coarser facets."""
LIFT_M = 2e-3
"""Rays start that far off the surface, along its normal and ahead."""
HORIZON = 0.1
"""Cosine beyond which a vertex is too far round to belong to a lit facet."""


def reference_samples(
    surface: MovingMesh,
    radar: Radar,
    chirps: np.ndarray,
    samples: np.ndarray,
    *,
    material: Material,
    scene: str | Scene | None = None,
    reflections: int = 2,
    dynamic_range_db: float = 80.0,
    seed: int = 0,
    sagitta_rad: float | np.ndarray = 0.08,
    weak_sagitta_rad: float | np.ndarray = WEAK_SAGITTA_RAD,
    occlusion: bool = True,
) -> np.ndarray:
    """ADC samples [sqrt(W)] complex128 (len(chirps), len(samples)) of a co-located radar with isotropic antennas, in free space
    or in a scene, whose own echoes are left out."""
    strong, weak = _ways(surface, radar, scene, reflections, dynamic_range_db)
    points = _points(surface, radar, seed)
    parts = [
        _Part.of(pairs, refined(surface, radar, sagitta), points, material, radar, occlusion)
        for pairs, sagitta in ((strong, sagitta_rad), (weak, weak_sagitta_rad))
        if pairs
    ]
    times = samples / radar.sample_rate_hz
    frequencies = radar.carrier_hz + radar.slope_hz_per_s * times
    starts = surface.times_s[0] + radar.chirp_times_s(surface.duration_s)[chirps]
    out = np.zeros((len(chirps), len(samples)), np.complex128)
    for row, start in enumerate(starts):
        ends = surface.at(np.array([start, start + radar.sweep_time_s]))
        moment = _Moment(ends[0], (ends[1] - ends[0]) / radar.sweep_time_s, times, frequencies)
        for part in parts:
            out[row] += part.samples(moment)
    return out


def refined(surface: MovingMesh, radar: Radar, sagitta_rad: float | np.ndarray) -> Refinement:
    return refine(
        surface.rest,
        surface.faces,
        wavenumber=2 * math.pi / radar.wavelength_m,
        range_m=least_range_m(surface, [(radar.tx_position_m, radar.rx_position_m)], surface.times_s),
        sagitta_rad=sagitta_rad,
        crease_deg=surface.crease_deg,
    )


# --- ways ---


def _ways(
    surface: MovingMesh, radar: Radar, scene: str | Scene | None, reflections: int, range_db: float
) -> tuple[list[LegPair], list[LegPair]]:
    """Pairs of legs that lead to the target, strong ones and weak ones; in free space there is one."""
    scene = load_scene(scene) if isinstance(scene, str) and scene != "free_space" else scene
    if not isinstance(scene, Scene):
        alone = _line_of_sight(radar)
        return [LegPair(out=alone, back=alone)], []
    backend, most = select("cpu"), {"order": reflections}
    places = probes([surface], float(surface.times_s[0]), float(surface.times_s[-1]))
    ranked = ranked_pairs(radar, *radar_legs(scene, radar, places, **most, backend=backend), places, **most)
    kept = [each for each in ranked if each.best_db >= -range_db]
    return [e.pair for e in kept if e.mean_db >= WEAK_DB], [e.pair for e in kept if e.mean_db < WEAK_DB]


def _line_of_sight(radar: Radar) -> Leg:
    """The one way of free space."""
    place, upright = radar.tx_position_m, polarization(radar, radar.tx_polarization_deg)

    def field(points: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
        ahead = points - place
        ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
        wave = upright - (ahead @ upright)[..., None] * ahead
        return np.repeat(wave[None] / np.linalg.norm(wave, axis=-1, keepdims=True), len(frequencies_hz), axis=0)

    def everywhere(points: np.ndarray) -> np.ndarray:
        return np.ones(points.shape[:-1])

    return Leg(
        chain=(), image_m=place, turn=np.eye(3), shift_m=np.zeros(3), field=field, clear=everywhere, share=everywhere,
        way=lambda points: np.stack([np.broadcast_to(place, points.shape), points]),
    )  # fmt: skip


class _Moment:
    """A chirp: where the unrefined vertices are, and what each leg brings to them."""

    def __init__(self, cage: np.ndarray, velocity: np.ndarray, times_s: np.ndarray, frequencies_hz: np.ndarray) -> None:
        self.cage, self.velocity, self.times_s, self.frequencies_hz = cage, velocity, times_s, frequencies_hz
        self._known: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def weights(self, pair: LegPair) -> np.ndarray:
        """What a pair makes of the amplitude of a reflector at the vertices, complex (samples, V) (eq. 24)."""
        (towards_tx, out, passed_out), (towards_rx, back, passed_back) = self._of(pair.out), self._of(pair.back)
        normal = towards_tx + towards_rx
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        across = _dot(out, normal) * _dot(back, normal)
        return pair.copies * np.conj(_dot(out, back) - 2 * across) * passed_out * passed_back

    def _of(self, leg: Leg) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Directions to the image (V, 3), the field (samples, V, 3), and the share that still things let past (V,)."""
        if id(leg) not in self._known:
            sight = leg.image_m - self.cage
            towards = sight / np.linalg.norm(sight, axis=1, keepdims=True)
            share = leg.share(self.cage).astype(float)
            self._known[id(leg)] = towards, leg.field(self.cage, self.frequencies_hz), share
        return self._known[id(leg)]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)


# --- sums ---


@dataclass(frozen=True, slots=True)
class _Part:
    """Pairs of legs that are summed over one refinement of the target."""

    pairs: list[LegPair]
    fine: Refinement
    around: Any
    """Sparse (vertices, faces) of the fine mesh, 1 where one belongs to the other."""
    points: _Points
    material: Material
    radar: Radar
    occlusion: bool
    backend: Backend

    @classmethod
    def of(
        cls, pairs: list[LegPair], fine: Refinement, points: _Points, material: Material, radar: Radar, occlusion: bool
    ) -> _Part:
        from scipy.sparse import csr_array

        faces = fine.faces
        where = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
        around = csr_array((np.ones(faces.size), where), shape=(fine.operator.shape[0], len(faces)))
        return cls(pairs, fine, around, points, material, radar, occlusion, select("cpu"))

    def samples(self, moment: _Moment) -> np.ndarray:
        """Of one chirp (samples,)."""
        still, moving = self.fine.operator @ moment.cage, self.fine.operator @ moment.velocity
        at, at_velocity, point_normal = (
            self.points.place(moment.cage), self.points.place(moment.velocity), self.points.normals(moment.cage),
        )  # fmt: skip
        now = [
            (still + t * moving, at + t * at_velocity, frequency)
            for t, frequency in zip(moment.times_s, moment.frequencies_hz, strict=True)
        ]
        view = _View(still, self.fine.faces, self.around, self.backend)
        looks = {}
        for pair in self.pairs:
            for leg in (pair.out, pair.back):
                if id(leg) not in looks:
                    looks[id(leg)] = self._look(view, leg, at, point_normal)
        vertices = [self._on_device(places) for places, _, _ in now]
        rough, gamma = self.material.scattering_coefficient, self.material.reflection(self.radar.mid_frequency_hz)
        out = np.zeros(len(now), np.complex128)
        for pair in self.pairs:
            (facing, seen, points_seen), (facing_back, seen_back, points_back) = (
                looks[id(pair.out)],
                looks[id(pair.back)],
            )
            faces = self.fine.faces[facing & facing_back]
            weights = moment.weights(pair)
            if not weights.any() or not len(faces):
                continue
            for k, (_, places, frequency) in enumerate(now):
                weight = (self.fine.linear @ weights[k]) * seen * seen_back
                out[k] += (
                    math.sqrt(1 - rough**2) * np.conj(gamma) * self._facets(vertices[k], faces, weight, pair, frequency)
                )
                if rough > 0:
                    weight = self.points.carried(weights[k]) * points_seen * points_back
                    out[k] += rough * abs(gamma) * self._diffuse(places, point_normal, weight, pair, frequency)
        return out

    def _look(
        self, view: _View, leg: Leg, at: np.ndarray, normal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Over a leg: which faces may be lit (F,), and what share of vertices (V,) and of diffuse points is seen."""
        facing = view.facing(leg.image_m)
        if not self.occlusion:
            return facing, np.ones(len(view.vertices)), np.ones(len(at))
        return facing, view.seen(view.vertices, view.normals, leg.image_m), view.seen(at, normal, leg.image_m)

    def _on_device(self, vertices: np.ndarray) -> list[Any]:
        return [self.backend.lanes(vertices[:, axis], self.backend.Float64) for axis in range(3)]

    def _facets(
        self, vertices: list[Any], faces: np.ndarray, weight: np.ndarray, pair: LegPair, frequency: float
    ) -> complex:
        """-(j sqrt(4 pi)/lambda) sum w (n.r) I_f/(R_out R_back), n.r half the sum of the cosines, with the residual video phase of
        each facet's delay; Gamma left out."""
        import drjit as dr

        Float64 = self.backend.Float64
        real, imag = (self.backend.lanes(part, Float64) for part in (weight.real, weight.imag))
        corners = [self.backend.lanes(faces[:, i]) for i in range(3)]
        images = [[dr.opaque(Float64, float(x)) for x in leg.image_m] for leg in (pair.out, pair.back)]
        a, b, c = ([dr.gather(Float64, axis, corner) for axis in vertices] for corner in corners)
        centroid = [(x + y + z) / 3 for x, y, z in zip(a, b, c, strict=True)]
        normal = _cross(_minus(b, a), _minus(c, a))  # 2 A long
        obliquity, spread, lit = 0.0, 1.0, True
        for image in images:
            sight = _minus(image, centroid)
            distance = dr.sqrt(_inner(sight, sight))
            projected = _inner(normal, sight) / distance
            obliquity, spread, lit = obliquity + projected / 2, spread * distance, lit & (projected > 0)
        scale = dr.select(lit, obliquity / spread, 0)
        delay_s = dr.opaque(Float64, pair.delay_s)
        path = _path(centroid, images)
        wavenumber = dr.opaque(Float64, 2 * math.pi * frequency / SPEED_OF_LIGHT)
        phases = [wavenumber * (_path(corner, images) - path) for corner in (a, b, c)]
        ops = SimpleNamespace(minimum=dr.minimum, maximum=dr.maximum, where=dr.select, sincos=dr.sincos)
        (x, y), _ = divided_differences(*phases, ops=ops, terms=SERIES_TERMS[8])
        delay = path / SPEED_OF_LIGHT + delay_s
        turns = (
            dr.opaque(Float64, frequency) * delay - dr.opaque(Float64, self.radar.slope_hz_per_s / 2) * delay * delay
        )
        sin, cos = dr.sincos(2 * math.pi * (turns - dr.floor(turns)))
        x, y = x * cos - y * sin, x * sin + y * cos
        u, v = (sum(dr.gather(Float64, part, corner) for corner in corners) / 3 for part in (real, imag))
        total = dr.sum(scale * (x * u - y * v)), dr.sum(scale * (x * v + y * u))
        dr.eval(total)
        factor = -1j * math.sqrt(4 * math.pi) / (SPEED_OF_LIGHT / frequency) * self.radar.link_amplitude
        return factor * complex(total[0][0], total[1][0])

    def _diffuse(
        self, at: np.ndarray, normal: np.ndarray, weight: np.ndarray, pair: LegPair, frequency: float
    ) -> complex:
        """Points of sigma = 4 A cos_out cos_back, S |Gamma| left out."""
        lit = np.flatnonzero(weight)
        at, normal, field = at[lit], normal[lit], weight[lit] * np.sqrt(self.points.area_m2[lit])
        path = np.zeros(len(at))
        for leg in (pair.out, pair.back):
            sight = leg.image_m - at
            distance = np.linalg.norm(sight, axis=1)
            field = field * np.sqrt(np.maximum(_dot(normal, sight) / distance, 0)) / distance
            path += distance
        delay = path / SPEED_OF_LIGHT + pair.delay_s
        turns = (frequency * delay - 0.5 * self.radar.slope_hz_per_s * delay**2) % 1.0
        turned = np.exp(1j * (2 * math.pi * turns + self.points.phase_rad[lit]))
        return complex(2 * self.radar.link_amplitude * np.sum(field * turned))


def _path(point: list[Any], images: list[list[Any]]) -> Any:
    """From one image to a point and on to the other [m]."""
    sights = (_minus(point, image) for image in images)
    return sum(_inner(sight, sight) ** 0.5 for sight in sights)


def _minus(a: list[Any], b: list[Any]) -> list[Any]:
    return [x - y for x, y in zip(a, b, strict=True)]


def _inner(a: list[Any], b: list[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: list[Any], b: list[Any]) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


# --- what the target hides of itself ---


class _View:
    """A fine mesh at one moment, to look at from anywhere."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, around: Any, backend: Backend) -> None:
        self.vertices = vertices
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        self._across, self._middle = np.cross(b - a, c - a), (a + b + c) / 3
        normals = around @ self._across
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        self._mi = mitsuba(backend)
        self._scene = self._mi.load_dict({"type": "scene", "body": mitsuba_mesh(self._mi, vertices, faces)})

    def facing(self, place: np.ndarray) -> np.ndarray:
        """Which faces look there, or just past, as may change within a chirp, bool (F,)."""
        sight = place - self._middle
        size = np.sqrt(_dot(self._across, self._across) * _dot(sight, sight))
        return _dot(self._across, sight) > -0.02 * size

    def seen(self, points: np.ndarray, normals: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Whether nothing of the mesh stands between points on it (Q, 3) and a place, 0 or 1 (Q,)."""
        mi, sight = self._mi, place - points
        ahead = sight / np.linalg.norm(sight, axis=1, keepdims=True)
        seen = _dot(ahead, normals) > -HORIZON
        origin = points[seen] + LIFT_M * (ahead[seen] + normals[seen])
        ray = mi.Ray3f(mi.Point3f(*columns(mi, origin)), mi.Vector3f(*columns(mi, ahead[seen])))
        ray.maxt = mi.Float(np.inf)
        seen[seen] = ~self._scene.ray_test(ray).numpy() if len(origin) else True
        return seen.astype(float)


class _Points:
    """The diffuse realisation that a seed stands for, on the carrier on which it is defined."""

    def __init__(self, rest: np.ndarray, carrier: Refinement, seed: int) -> None:
        vertices = carrier.operator @ rest
        a, b, c = (vertices[carrier.faces[:, i]] for i in range(3))
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        spread = surface_points(vertices, carrier.faces, seed=seed, spacing_m=point_spacing(area, POINTS_PER_MESH))
        self.faces, self.weights = carrier.faces[spread.face], spread.barycentric
        self.area_m2, self.phase_rad = spread.area_m2, spread.phase_rad
        self.carrier = carrier

    def place(self, cage: np.ndarray) -> np.ndarray:
        """Positions (Q, 3), linear in the cage's."""
        return np.einsum("qi,qij->qj", self.weights, (self.carrier.operator @ cage)[self.faces])

    def carried(self, field: np.ndarray) -> np.ndarray:
        """A field of the cage's vertices (V,), linear from these to the points (Q,)."""
        return np.einsum("qi,qi->q", self.weights, (self.carrier.linear @ field)[self.faces])

    def normals(self, cage: np.ndarray) -> np.ndarray:
        """Unit normals (Q, 3)."""
        corners = (self.carrier.operator @ cage)[self.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _points(surface: MovingMesh, radar: Radar, seed: int) -> _Points:
    return _Points(surface.rest, refined(surface, radar, POINT_SAGITTA_RAD), seed)
