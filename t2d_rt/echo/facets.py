"""Physical optics on triangles in closed form, and frozen diffuse points (docs/physics.md, eq. 3, 4 and 9)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.echo.phase_integral import SERIES_TERMS, Ops, divided_differences
Vector = tuple[Any, ...]
"""x, y, z on every lane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """One way between an antenna and the target, free space."""

    transmitter_m: np.ndarray
    """(3,)"""
    receiver_m: np.ndarray
    """(3,)"""
    frequency_hz: float
    """At mid-sweep."""
    link_amplitude: float
    """sqrt(W) m: the received amplitude is link_amplitude sqrt(rcs)/(R_tx R_rx)."""


PATCH = 4
"""Facets of one patch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Patches:
    """Neighbouring facets that return as one echo: their phases relative to the patch's own delay change slowly."""

    corners: np.ndarray
    """Vertices of each patch's facets, uint32 (G, PATCH, 3); a place that is not filled repeats one vertex."""
    share: np.ndarray
    """Weight of each facet's centroid in the patch's reference point, float64 (G, PATCH); 0 where not filled, sum 1."""

    @classmethod
    def of(cls, faces: np.ndarray, group: np.ndarray) -> Patches:
        """Facets (F, 3) in an order in which neighbours are neighbours, cut into patches; a patch never spans two groups (F,)."""
        starts = np.flatnonzero(np.diff(group, prepend=group[0] - 1))
        sizes = np.diff(np.append(starts, len(group)))
        within = np.arange(len(group)) - np.repeat(starts, sizes)
        counts = -(-sizes // PATCH)
        patch = np.repeat(np.cumsum(counts) - counts, sizes) + within // PATCH
        corners = np.empty((int(counts.sum()), PATCH, 3), np.uint32)
        filled = np.zeros((len(corners), PATCH))
        first = np.flatnonzero(within % PATCH == 0)
        corners[:] = faces[first, 0][:, None, None]
        corners[patch, within % PATCH] = faces
        filled[patch, within % PATCH] = 1
        return cls(corners=corners, share=filled / filled.sum(axis=1, keepdims=True))

    def only(self, chosen: np.ndarray) -> Patches:
        """Some of the patches."""
        return Patches(corners=self.corners[chosen], share=self.share[chosen])


def patch_delays(vertices: np.ndarray, patches: Patches, leg: Leg, backend: Backend) -> np.ndarray:
    """Round-trip delay of every patch's reference point [s], float64 (G, T), for vertices (V, T, 3) m."""
    at = _Gather(vertices, len(patches.share), backend)
    centre = _reference([at.triangle(patches.corners[:, m]) for m in range(PATCH)], patches, at)
    to_tx, to_rx = _sights(centre, leg, at)
    (delay,) = at.collect((to_tx.range + to_rx.range) * (1 / SPEED_OF_LIGHT))
    return delay


def lit_patches(vertices: np.ndarray, patches: Patches, leg: Leg, backend: Backend) -> np.ndarray:
    """Indices of patches that may be lit by the transmitter and seen by the receiver at or between the frames of vertices."""
    at = _Gather(vertices, len(patches.share), backend)
    cosines = []
    for m in range(PATCH):
        corners = at.triangle(patches.corners[:, m])
        centroid, normal, area = _shape(corners, at)
        to_tx, to_rx = _sights(centroid, leg, at)
        cosines.append(at.dr.minimum(_dot(normal, to_tx.towards), _dot(normal, to_rx.towards)) / area)
    values = np.stack(at.collect(*cosines))  # (PATCH, G, T)
    # What it changes from frame to frame it may change in between as well.
    margin = np.abs(np.diff(values, axis=2)).max(axis=2, initial=0)
    return np.flatnonzero((values.max(axis=2) + margin > 0).any(axis=0))


def patch_echoes(
    vertices: np.ndarray,
    patches: Patches,
    visibility: np.ndarray | None,
    leg: Leg,
    reflection: complex,
    backend: Backend,
) -> tuple[np.ndarray, np.ndarray]:
    """Coherent amplitude [sqrt(W)] and slope [sqrt(W)/Hz] of patches, complex64 (G, T) each, their delay's carrier taken out.

    vertices (V, T, 3) m float64, visibility of the vertices (V, T) in 0..1 or None where nothing hides them; reflection is
    Gamma of the surface times the share that stays coherent.
    """
    at = _Gather(vertices, len(patches.share), backend)
    wavenumber = at.constant(2 * math.pi * leg.frequency_hz / SPEED_OF_LIGHT)
    triangles = [at.triangle(patches.corners[:, m]) for m in range(PATCH)]
    to_tx, to_rx = _sights(_reference(triangles, patches, at), leg, at)
    total = [0.0, 0.0, 0.0, 0.0]
    for m, corners in enumerate(triangles):
        centroid, normal, doubled_area = _shape(corners, at)
        from_tx, from_rx = _sights(centroid, leg, at)
        cos_tx = _dot(normal, from_tx.towards) / doubled_area
        cos_rx = cos_tx if from_rx is from_tx else _dot(normal, from_rx.towards) / doubled_area
        phases = []
        for corner in corners:
            extra = to_tx.extra_path(corner)
            extra = extra + (extra if to_rx is to_tx else to_rx.extra_path(corner))
            phases.append(backend.Float32(wavenumber * extra))
        parts = divided_differences(*phases, ops=_ops(at.dr), terms=SERIES_TERMS[4])
        # 2 A F is the phase integral; the obliquity is half the sum of the cosines (eq. 3).
        weight = doubled_area * 0.5 * (cos_tx + cos_rx) / (from_tx.range * from_rx.range)
        weight = backend.Float32(at.dr.select((cos_tx > 0) & (cos_rx > 0), weight, 0))
        if visibility is not None:
            weight *= at.corner_mean(visibility, patches.corners[:, m])
        for k, value in enumerate((*parts[0], *parts[1])):
            total[k] = total[k] + value * weight
    wavelength = SPEED_OF_LIGHT / leg.frequency_hz
    scale = backend.Float32(at.constant(leg.link_amplitude * math.sqrt(4 * math.pi) / wavelength))
    # IF = tx conj(rx): the conjugate of the usual -j/lambda Gamma ... e^{-jkR}.
    turn = -1j * complex(reflection).conjugate()
    real, imag = (at.dr.opaque(backend.Float32, float(x)) for x in (turn.real, turn.imag))
    amplitude = _complex_times(real * scale, imag * scale, total[0], total[1])
    per_hz = at.dr.opaque(backend.Float32, 1 / leg.frequency_hz)
    slope = _complex_times(real * scale * per_hz, imag * scale * per_hz, total[2], total[3])
    planes = at.collect(*amplitude, *slope)
    return _joined(*planes[:2]), _joined(*planes[2:])


def diffuse_echoes(
    vertices: np.ndarray,
    faces: np.ndarray,
    barycentric: np.ndarray,
    area_m2: np.ndarray,
    phase_rad: np.ndarray,
    visibility: np.ndarray | None,
    leg: Leg,
    scattered: float,
    backend: Backend,
) -> tuple[np.ndarray, np.ndarray]:
    """Echoes of Q Lambertian points of fixed random phase: sigma_q = 4 S^2 |Gamma|^2 A_q cos_i cos_s; delay and amplitude (Q, T).

    Point q lies at barycentric (Q, 3) of the triangle faces (Q, 3) of vertices (V, T, 3); `scattered` is S |Gamma|.
    """
    at = _Gather(vertices, len(faces), backend)
    corners = at.triangle(faces)
    weights = [at.per_item(barycentric[:, i]) for i in range(3)]
    point = _combined(corners, weights)
    _, normal, doubled_area = _shape(corners, at)
    to_tx, to_rx = _sights(point, leg, at)
    cos_tx = at.dr.maximum(_dot(normal, to_tx.towards) / doubled_area, 0)
    cos_rx = cos_tx if to_rx is to_tx else at.dr.maximum(_dot(normal, to_rx.towards) / doubled_area, 0)
    root = at.per_item(leg.link_amplitude * 2 * scattered * np.sqrt(area_m2))
    weight = backend.Float32(root * at.dr.sqrt(cos_tx * cos_rx) / (to_tx.range * to_rx.range))
    if visibility is not None:
        weight *= at.corner_mean(visibility, faces)
    sin, cos = at.dr.sincos(backend.Float32(at.per_item(phase_rad)))
    delay, real, imag = at.collect((to_tx.range + to_rx.range) * (1 / SPEED_OF_LIGHT), cos * weight, sin * weight)
    return delay, _joined(real, imag)


class _Gather:
    """Lanes over (item, frame): reads vertices of every item's triangles, writes arrays (items, T).

    Frames run fastest, as in the vertices (V, T, 3): neighbouring lanes read neighbouring numbers.
    """

    def __init__(self, vertices: np.ndarray, items: int, backend: Backend) -> None:
        import drjit

        self.dr = drjit
        self.backend = backend
        self.frames = vertices.shape[1]
        self.shape = (items, self.frames)
        self.numbers = backend.Float64(np.ascontiguousarray(vertices).ravel())
        UInt32 = backend.UInt32
        lane = drjit.arange(UInt32, items * self.frames)
        # Opaque: a number in the code would compile a kernel for every mesh.
        self.stride = drjit.opaque(UInt32, self.frames)
        self.item = lane // self.stride
        self.frame = lane - self.item * self.stride

    def _indices(self, corners: np.ndarray) -> list[Any]:
        UInt32 = self.backend.UInt32
        columns = (UInt32(np.ascontiguousarray(corners[:, i], dtype=np.uint32)) for i in range(3))
        return [self.dr.gather(UInt32, column, self.item) * self.stride + self.frame for column in columns]

    def triangle(self, corners: np.ndarray) -> list[Vector]:
        """The three corners of every lane's triangle; corners (items, 3)."""
        Float64 = self.backend.Float64
        return [
            tuple(self.dr.gather(Float64, self.numbers, 3 * index + axis) for axis in range(3)) for index in self._indices(corners)
        ]

    def constant(self, value: float) -> Any:
        """A number that is data to the kernel, not code."""
        return self.dr.opaque(self.backend.Float64, float(value))

    def place(self, position_m: np.ndarray) -> Vector:
        """A fixed point (3,)."""
        return tuple(self.constant(x) for x in position_m)

    def per_item(self, values: np.ndarray) -> Any:
        """A constant of each item, on every lane."""
        Float64 = self.backend.Float64
        return self.dr.gather(Float64, Float64(np.ascontiguousarray(values, dtype=np.float64)), self.item)

    def corner_mean(self, values: np.ndarray, corners: np.ndarray) -> Any:
        """Mean over a triangle's corners of a vertex field (V, T)."""
        Float32 = self.backend.Float32
        field = Float32(np.ascontiguousarray(values, dtype=np.float32).ravel())
        parts = [self.dr.gather(Float32, field, index) for index in self._indices(corners)]
        return (parts[0] + parts[1] + parts[2]) * (1 / 3)

    def collect(self, *values: Any) -> list[np.ndarray]:
        """Evaluates in one kernel and hands NumPy arrays (items, T) back."""
        self.dr.eval(*values)
        return [value.numpy().reshape(self.shape) for value in values]


def _reference(triangles: list[list[Vector]], patches: Patches, at: _Gather) -> Vector:
    """Reference point of every patch: the mean of its facets' centroids."""
    parts = [
        _scaled(_combined(corners, [1 / 3, 1 / 3, 1 / 3]), at.per_item(patches.share[:, m])) for m, corners in enumerate(triangles)
    ]
    return _combined(parts, [1.0] * len(parts))


def _shape(corners: list[Vector], at: _Gather) -> tuple[Vector, Vector, Any]:
    """Centroid, normal of twice the triangle's area, and that length, kept from zero."""
    normal = _cross(_minus(corners[1], corners[0]), _minus(corners[2], corners[0]))
    return _combined(corners, [1 / 3, 1 / 3, 1 / 3]), normal, at.dr.maximum(_norm(normal), 1e-30)


def _sights(point: Vector, leg: Leg, at: _Gather) -> tuple[_Sight, _Sight]:
    """Lines to transmitter and receiver; one and the same object where they stand in one place."""
    to_tx = _Sight(point, at.place(leg.transmitter_m))
    if np.array_equal(leg.transmitter_m, leg.receiver_m):
        return to_tx, to_tx
    return to_tx, _Sight(point, at.place(leg.receiver_m))


class _Sight:
    """The straight line from points to an antenna."""

    def __init__(self, point: Vector, antenna: Vector) -> None:
        self.point = point
        self.offset = _minus(antenna, point)
        self.range = _norm(self.offset)
        self.towards = _scaled(self.offset, 1 / self.range)

    def extra_path(self, other: Vector) -> Any:
        """Range of `other` minus that of the point [m], without cancellation: d.(d - 2 o)/(R' + R), d from point to other."""
        d = _minus(other, self.point)
        to_antenna = _minus(self.offset, d)
        return _dot(d, _minus(d, _scaled(self.offset, 2))) / (_norm(to_antenna) + self.range)


def _ops(dr: Any) -> Ops:
    return SimpleNamespace(minimum=dr.minimum, maximum=dr.maximum, where=dr.select, sincos=dr.sincos)  # type: ignore[return-value]


def _complex_times(real: Any, imag: Any, other_real: Any, other_imag: Any) -> tuple[Any, Any]:
    return real * other_real - imag * other_imag, real * other_imag + imag * other_real


def _joined(real: np.ndarray, imag: np.ndarray) -> np.ndarray:
    out = np.empty(real.shape, np.complex64)
    out.real, out.imag = real, imag
    return out


def _combined(points: list[Vector], weights: list[Any]) -> Vector:
    total = _scaled(points[0], weights[0])
    for point, weight in zip(points[1:], weights[1:], strict=True):
        total = tuple(t + x * weight for t, x in zip(total, point, strict=True))
    return total


def _dot(a: Vector, b: Vector) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _minus(a: Vector, b: Vector) -> Vector:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _scaled(a: Vector, factor: Any) -> Vector:
    return tuple(x * factor for x in a)


def _norm(a: Vector) -> Any:
    return _dot(a, a) ** 0.5
