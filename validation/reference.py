"""A converged float64 reference for a mesh's ADC samples: no patches, no surface rate, no buckets, no slopes.

Every facet and diffuse point is summed anew at each sample's own moment and frequency, with its own physical-optics integral
(docs/physics.md, eq. 3, 4, 9) in NumPy; what hides what is traced through the fine mesh at the chirp's own moment.
"""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.backend import select
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.echo.mesh import POINT_SAGITTA_RAD, POINTS_PER_MESH, least_range_m
from t2d_rt.echo.phase_integral import divided_difference
from t2d_rt.geometry import Refinement, point_spacing, refine, surface_points
from t2d_rt.trace.visibility import Occlusion
from t2d_rt.types import Material, MovingMesh, Radar


def reference_samples(
    surface: MovingMesh,
    radar: Radar,
    chirps: np.ndarray,
    samples: np.ndarray,
    *,
    material: Material,
    seed: int = 0,
    sagitta_rad: float | np.ndarray = 0.08,
    occlusion: bool = True,
) -> np.ndarray:
    """ADC samples [sqrt(W)] complex128 (len(chirps), len(samples)) of a co-located radar."""
    fine = refined(surface, radar, sagitta_rad)
    view = _FineView(surface, fine, radar) if occlusion else None
    points = _points(surface, radar, seed)
    rough = material.scattering_coefficient
    gamma = material.reflection(radar.mid_frequency_hz)
    starts = surface.times_s[0] + radar.chirp_times_s(surface.duration_s)[chirps]
    out = np.zeros((len(chirps), len(samples)), np.complex128)
    for row, start in enumerate(starts):
        ends = surface.at(np.array([start, start + radar.sweep_time_s]))
        cage, velocity = ends[0], (ends[1] - ends[0]) / radar.sweep_time_s  # over 40 us a straight line to 1 nm
        still, moving = fine.operator @ cage, fine.operator @ velocity
        facets = np.flatnonzero(_cosines(still, fine.faces, radar) > -0.02)
        vertex_seen = None if view is None else view.vertices(still)
        at, at_velocity, normal = points.place(cage), points.place(velocity), points.normals(cage)
        point_seen = 1.0 if view is None else view.points(at, normal)
        for column, sample in enumerate(samples):
            t = sample / radar.sample_rate_hz
            frequency = radar.carrier_hz + radar.slope_hz_per_s * t
            vertices = still + t * moving
            out[row, column] = math.sqrt(1 - rough**2) * _facets(
                vertices, fine.faces[facets], vertex_seen, gamma, frequency, radar
            )
            if rough > 0:
                here = at + t * at_velocity
                out[row, column] += rough * abs(gamma) * _diffuse(here, normal, points, point_seen, frequency, radar)
    return out


def nmse_db(measured: np.ndarray, reference: np.ndarray) -> float:
    """Energy of the difference over that of the reference [dB]."""
    return float(10 * np.log10(np.sum(np.abs(measured - reference) ** 2) / np.sum(np.abs(reference) ** 2)))


def _facets(
    vertices: np.ndarray, faces: np.ndarray, seen: np.ndarray | None, gamma: complex, frequency: float, radar: Radar
) -> complex:
    """-(j sqrt(4 pi)/lambda) sum conj(Gamma) (n.r) I_f / R^2, with the residual video phase of each facet's delay."""
    offset = vertices - radar.tx_position_m
    ranges = np.linalg.norm(offset, axis=1)
    a, b, c = (offset[faces[:, i]] for i in range(3))
    centroid = (a + b + c) / 3
    range_m = np.linalg.norm(centroid, axis=1)
    doubled = np.cross(b - a, c - a)
    # (n.r) 2 A, r towards the radar
    weight = np.maximum(-np.sum(doubled * centroid, axis=1) / range_m, 0) / range_m**2
    if seen is not None:
        weight = weight * seen[faces].mean(axis=1)
    wavenumber = 2 * math.pi * frequency / SPEED_OF_LIGHT
    phases = [2 * wavenumber * (ranges[faces[:, i]] - range_m) for i in range(3)]
    integral = divided_difference(*phases) * np.exp(1j * _phase(2 * range_m / SPEED_OF_LIGHT, frequency, radar))
    wavelength = SPEED_OF_LIGHT / frequency
    scale = -1j * math.sqrt(4 * math.pi) / wavelength * np.conj(gamma) * radar.link_amplitude
    return complex(scale * np.sum(weight * integral))


def _diffuse(
    at: np.ndarray, normal: np.ndarray, points: _Points, seen: np.ndarray | float, frequency: float, radar: Radar
) -> complex:
    """Points of sigma = 4 A cos^2(theta), S |Gamma| left out."""
    offset = at - radar.tx_position_m
    range_m = np.linalg.norm(offset, axis=1)
    cosine = np.maximum(-np.sum(normal * offset, axis=1) / range_m, 0)
    field = 2 * np.sqrt(points.area_m2) * cosine * seen * radar.link_amplitude / range_m**2
    return complex(
        np.sum(field * np.exp(1j * (points.phase_rad + _phase(2 * range_m / SPEED_OF_LIGHT, frequency, radar))))
    )


def _phase(delay_s: np.ndarray, frequency: float, radar: Radar) -> np.ndarray:
    """2 pi (f tau - S tau^2/2), f the frequency at the sample."""
    return 2 * math.pi * ((frequency * delay_s - 0.5 * radar.slope_hz_per_s * delay_s**2) % 1.0)


def refined(surface: MovingMesh, radar: Radar, sagitta_rad: float | np.ndarray) -> Refinement:
    return refine(
        surface.rest,
        surface.faces,
        wavenumber=2 * math.pi / radar.wavelength_m,
        range_m=least_range_m(surface, [(radar.tx_position_m, radar.rx_position_m)], surface.times_s),
        sagitta_rad=sagitta_rad,
        crease_deg=surface.crease_deg,
    )


def _cosines(vertices: np.ndarray, faces: np.ndarray, radar: Radar) -> np.ndarray:
    a, b, c = (vertices[faces[:, i]] - radar.tx_position_m for i in range(3))
    normal, centroid = np.cross(b - a, c - a), a + b + c
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(centroid, axis=1)
    return -np.sum(normal * centroid, axis=1) / np.maximum(size, 1e-30)


class _Points:
    """The diffuse realisation that a seed stands for, on the carrier on which it is defined."""

    def __init__(self, rest: np.ndarray, carrier: Refinement, seed: int) -> None:
        vertices = carrier.operator @ rest
        a, b, c = (vertices[carrier.faces[:, i]] for i in range(3))
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        spread = surface_points(vertices, carrier.faces, seed=seed, spacing_m=point_spacing(area, POINTS_PER_MESH))
        self.faces, self.weights = carrier.faces[spread.face], spread.barycentric
        self.area_m2, self.phase_rad = spread.area_m2, spread.phase_rad
        self.operator = carrier.operator

    def place(self, cage: np.ndarray) -> np.ndarray:
        """Positions (Q, 3), linear in the cage's."""
        return np.einsum("qi,qij->qj", self.weights, (self.operator @ cage)[self.faces])

    def normals(self, cage: np.ndarray) -> np.ndarray:
        """Unit normals (Q, 3)."""
        corners = (self.operator @ cage)[self.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _points(surface: MovingMesh, radar: Radar, seed: int) -> _Points:
    return _Points(surface.rest, refined(surface, radar, POINT_SAGITTA_RAD), seed)


class _FineView:
    """Visibility traced through the fine mesh, one moment at a time."""

    def __init__(self, surface: MovingMesh, fine: Refinement, radar: Radar) -> None:
        self.now = fine.operator @ surface.rest
        mesh = MovingMesh.from_track(
            lambda times_s: np.repeat(self.now[None], len(times_s), axis=0), fine.faces, surface.times_s, rest=self.now
        )
        self.radar = radar
        self.occlusion = Occlusion([mesh], radar.tx_position_m, rate_hz=1, backend=select("cpu"))

    def vertices(self, now: np.ndarray) -> np.ndarray:
        """Of the fine vertices (V,)."""
        self.now = now
        return self.occlusion.traced(np.zeros(1))[0]

    def points(self, at: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Of points on the surface (Q,), the mesh as last seen."""
        return self.occlusion.clear(self.now[None], at[None], normal[None])[0]
