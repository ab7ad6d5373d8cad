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
from t2d_rt.types import EchoArrays


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


def facet_echoes(
    vertices: np.ndarray,
    faces: np.ndarray,
    visibility: np.ndarray | None,
    leg: Leg,
    reflection: complex,
    backend: Backend,
) -> EchoArrays:
    """Coherent echoes of lit facets: delay of the centroid [s] (T, F), amplitude [sqrt(W)] and slope [sqrt(W)/Hz] (T, F).

    vertices (T, V, 3) m float64, faces (F, 3), visibility of the vertices (T, V) in 0..1 or None where nothing hides them;
    reflection is Gamma of the surface times the share that stays coherent. The amplitude is that of mid-sweep and excludes
    the carrier of the centroid's delay.
    """
    at = _Gather(vertices, backend)
    corners = at.triangles(faces)
    centroid = _scaled(_added(_added(corners[0], corners[1]), corners[2]), 1 / 3)
    doubled_area_normal = _cross(_minus(corners[1], corners[0]), _minus(corners[2], corners[0]))
    doubled_area = _norm(doubled_area_normal)
    to_tx = _Sight(centroid, at.place(leg.transmitter_m))
    to_rx = to_tx if _co_located(leg) else _Sight(centroid, at.place(leg.receiver_m))
    inverse_area = 1 / at.dr.maximum(doubled_area, 1e-30)
    cos_tx = _dot(doubled_area_normal, to_tx.towards) * inverse_area
    cos_rx = cos_tx if to_rx is to_tx else _dot(doubled_area_normal, to_rx.towards) * inverse_area

    wavenumber = at.constant(2 * math.pi * leg.frequency_hz / SPEED_OF_LIGHT)
    phases = []
    for corner in corners:
        extra = to_tx.extra_path(corner)
        extra += extra if to_rx is to_tx else to_rx.extra_path(corner)
        phases.append(backend.Float32(wavenumber * extra))
    (real, imag), (slope_real, slope_imag) = divided_differences(*phases, ops=_ops(at.dr), terms=SERIES_TERMS[4])

    lit = (cos_tx > 0) & (cos_rx > 0)
    wavelength = SPEED_OF_LIGHT / leg.frequency_hz
    scale = at.constant(leg.link_amplitude * math.sqrt(4 * math.pi) / wavelength)
    # 2 A F is the phase integral; the area is half the cross product's length.
    weight = scale * doubled_area * 0.5 * (cos_tx + cos_rx) / (to_tx.range * to_rx.range)
    weight = backend.Float32(at.dr.select(lit, weight, 0))
    if visibility is not None:
        weight *= at.corner_mean(visibility)
    factor = -1j * complex(reflection).conjugate()  # IF = tx conj(rx): the conjugate of the usual -j/lambda Gamma ... e^{-jkR}
    amplitude = _complex_times(factor, real * weight, imag * weight)
    slope = _complex_times(factor / leg.frequency_hz, slope_real * weight, slope_imag * weight)
    delay = (to_tx.range + to_rx.range) * (1 / SPEED_OF_LIGHT)
    return at.collect(delay, amplitude, slope)


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
) -> EchoArrays:
    """Echoes of Q Lambertian points of fixed random phase: sigma_q = 4 S^2 |Gamma|^2 A_q cos_i cos_s (T, Q), no slope.

    Point q lies at barycentric (Q, 3) of the triangle faces (Q, 3) of vertices (T, V, 3); `scattered` is S |Gamma|.
    """
    at = _Gather(vertices, backend)
    corners = at.triangles(faces)
    weights = [at.per_item(barycentric[:, i]) for i in range(3)]
    point = tuple(sum((w * c[axis] for w, c in zip(weights, corners, strict=True)), start=0.0) for axis in range(3))
    normal = _cross(_minus(corners[1], corners[0]), _minus(corners[2], corners[0]))
    inverse_area = 1 / at.dr.maximum(_norm(normal), 1e-30)
    to_tx = _Sight(point, at.place(leg.transmitter_m))
    to_rx = to_tx if _co_located(leg) else _Sight(point, at.place(leg.receiver_m))
    cos_tx = at.dr.maximum(_dot(normal, to_tx.towards) * inverse_area, 0)
    cos_rx = cos_tx if to_rx is to_tx else at.dr.maximum(_dot(normal, to_rx.towards) * inverse_area, 0)
    root = at.per_item(leg.link_amplitude * 2 * scattered * np.sqrt(area_m2))
    weight = backend.Float32(root * at.dr.sqrt(cos_tx * cos_rx) / (to_tx.range * to_rx.range))
    if visibility is not None:
        weight *= at.corner_mean(visibility)
    sin, cos = at.dr.sincos(backend.Float32(at.per_item(phase_rad)))
    delay = (to_tx.range + to_rx.range) * (1 / SPEED_OF_LIGHT)
    delay, amplitude, _ = at.collect(delay, (cos * weight, sin * weight), None)
    return delay, amplitude, None


class _Gather:
    """Lanes over (frame, item): reads vertices of every item's triangle, writes arrays (T, items)."""

    def __init__(self, vertices: np.ndarray, backend: Backend) -> None:
        import drjit

        self.dr = drjit
        self.backend = backend
        self.frames, self.vertex_count = vertices.shape[:2]
        self.columns = [backend.Float64(np.ascontiguousarray(vertices[..., axis]).ravel()) for axis in range(3)]

    def triangles(self, faces: np.ndarray) -> list[tuple[Any, ...]]:
        """Corners of every lane's triangle: three (x, y, z)."""
        UInt32 = self.backend.UInt32
        self.items = len(faces)
        lane = self.dr.arange(UInt32, self.frames * self.items)
        # Opaque: a number in the code would compile a kernel for every mesh.
        items, vertices = self.dr.opaque(UInt32, self.items), self.dr.opaque(UInt32, self.vertex_count)
        frame = lane // items
        self.item = lane - frame * items
        base = frame * vertices
        self.corner_ids = []
        for i in range(3):
            column = UInt32(np.ascontiguousarray(faces[:, i]).astype(np.uint32))
            self.corner_ids.append(base + self.dr.gather(UInt32, column, self.item))
        Float64 = self.backend.Float64
        return [tuple(self.dr.gather(Float64, c, index) for c in self.columns) for index in self.corner_ids]

    def constant(self, value: float) -> Any:
        """A number that is data to the kernel, not code."""
        return self.dr.opaque(self.backend.Float64, float(value))

    def place(self, position_m: np.ndarray) -> tuple[Any, ...]:
        """A fixed point (3,)."""
        return tuple(self.constant(x) for x in position_m)

    def per_item(self, values: np.ndarray) -> Any:
        """A constant of each item, on every lane."""
        Float64 = self.backend.Float64
        return self.dr.gather(Float64, Float64(np.ascontiguousarray(values, dtype=np.float64)), self.item)

    def corner_mean(self, values: np.ndarray) -> Any:
        """Mean over a triangle's corners of a vertex field (T, V)."""
        Float32 = self.backend.Float32
        field = Float32(np.ascontiguousarray(values, dtype=np.float32).ravel())
        parts = [self.dr.gather(Float32, field, index) for index in self.corner_ids]
        return (parts[0] + parts[1] + parts[2]) * (1 / 3)

    def collect(self, delay: Any, amplitude: tuple[Any, Any], slope: tuple[Any, Any] | None) -> EchoArrays:
        """Evaluates in one kernel and hands NumPy arrays back."""
        self.dr.eval(delay, *amplitude, *(slope or ()))
        shape = (self.frames, self.items)

        def joined(parts: tuple[Any, Any]) -> np.ndarray:
            out = np.empty(shape, np.complex64)
            out.real = parts[0].numpy().reshape(shape)
            out.imag = parts[1].numpy().reshape(shape)
            return out

        return delay.numpy().reshape(shape), joined(amplitude), None if slope is None else joined(slope)


class _Sight:
    """The straight line from points to an antenna."""

    def __init__(self, point: tuple[Any, ...], antenna: tuple[Any, ...]) -> None:
        self.point = point
        self.offset = _minus(antenna, point)
        self.range = _norm(self.offset)
        self.towards = _scaled(self.offset, 1 / self.range)

    def extra_path(self, other: tuple[Any, ...]) -> Any:
        """Range of `other` minus that of the point [m], without cancellation: d.(d - 2 o)/(R' + R), d from point to other."""
        d = _minus(other, self.point)
        to_antenna = _minus(self.offset, d)
        return _dot(d, _minus(d, _scaled(self.offset, 2))) / (_norm(to_antenna) + self.range)


def _co_located(leg: Leg) -> bool:
    return bool(np.array_equal(leg.transmitter_m, leg.receiver_m))


def _ops(dr: Any) -> Ops:
    return SimpleNamespace(minimum=dr.minimum, maximum=dr.maximum, where=dr.select, sincos=dr.sincos)  # type: ignore[return-value]


def _complex_times(factor: complex, real: Any, imag: Any) -> tuple[Any, Any]:
    return factor.real * real - factor.imag * imag, factor.real * imag + factor.imag * real


def _dot(a: tuple[Any, ...], b: tuple[Any, ...]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[Any, ...]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _minus(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _added(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _scaled(a: tuple[Any, ...], factor: Any) -> tuple[Any, ...]:
    return tuple(x * factor for x in a)


def _norm(a: tuple[Any, ...]) -> Any:
    return _dot(a, a) ** 0.5
