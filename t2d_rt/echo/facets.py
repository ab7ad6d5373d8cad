"""Physical optics on triangles in closed form, and frozen diffuse points (docs/physics.md, eq. 3, 4 and 9)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.echo.patches import Patches
from t2d_rt.echo.phase_integral import SERIES_TERMS, Ops, divided_differences
from t2d_rt.types import LegPair, Radar
from t2d_rt.types.radar import one_view

Vector = tuple[Any, ...]
"""x, y, z on every lane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """The places that a target is seen from, over one pair of legs."""

    places_m: list[np.ndarray]
    """Transmitter and receiver or their images, (3,) each, or one place where both stand in it."""
    views_m: list[np.ndarray]
    """The same as far as shapes of echoes are concerned (`one_view`)."""
    frequency_hz: float
    """At mid-sweep."""
    link_amplitude: float
    """sqrt(W) m: the received amplitude is link_amplitude sqrt(rcs)/(R_tx R_rx)."""

    @classmethod
    def of(cls, radar: Radar, legs: LegPair | None = None) -> Pair:
        """That of the radar's array centres, or of their images over a pair of legs."""
        places = [radar.tx_position_m, radar.rx_position_m]
        if legs is not None:
            places = [legs.out.image_m, legs.back.image_m]
        return cls(
            places_m=places[:1] if np.array_equal(places[0], places[1]) else places,
            views_m=one_view(*places),
            frequency_hz=radar.mid_frequency_hz,
            link_amplitude=radar.link_amplitude,
        )


THIRDS = [1 / 3, 1 / 3, 1 / 3]


def patch_echoes(
    vertices: np.ndarray,
    origin: np.ndarray,
    patches: Patches,
    centres: np.ndarray,
    pair: Pair,
    reflection: complex,
    backend: Backend,
) -> tuple[np.ndarray, np.ndarray]:
    """Coherent amplitude [sqrt(W)] and slope [sqrt(W)/Hz] of patches, complex64 (G, T) each, their delay's carrier taken out.

    vertices (V, T, 4) float32: place [m] relative to origin (T, 3), and visibility in 0..1; centres (G, T, 3) m, whose delay
    is the patch's; reflection is Gamma of the surface times the share that stays coherent.
    """
    at = _Gather(vertices, len(centres), backend)
    dr, Float32, UInt32 = at.dr, backend.Float32, backend.UInt32
    wavenumber = Float32(at.constant(2 * math.pi * pair.frequency_hz / SPEED_OF_LIGHT))
    centre = at.lane_points(centres - origin)
    antennas = [_minus(at.frame_point(place - origin), centre) for place in pair.views_m]
    columns = at.columns(patches.corners)
    starts = UInt32(patches.starts.astype(np.uint32))

    def add(facet: Any, total: list[Any]) -> tuple[Any, list[Any]]:
        packets = at.packets(at.vertices(columns, facet))
        corners = [_minus(packet[:3], centre) for packet in packets]
        normal, doubled_area = _normal(corners, at)
        sights = [_minus(antenna, _combined(corners, THIRDS)) for antenna in antennas]
        ranges = [_norm(sight) for sight in sights]
        cosines = [
            _dot(normal, sight) / (doubled_area * distance) for sight, distance in zip(sights, ranges, strict=True)
        ]
        paths = [sum(_extra_path(corner, antenna) for antenna in antennas) for corner in corners]
        # Half the sum of the cosines is the obliquity, 2 A F the phase integral (eq. 3). One antenna stands for both.
        obliquity, both = (cosines[0] + cosines[-1]) / 2, 2 / len(antennas)
        lit = (cosines[0] > 0) & (cosines[-1] > 0)
        weight = dr.select(lit, doubled_area * obliquity / (ranges[0] * ranges[-1]), 0)
        weight *= sum(dr.clip(packet[3], 0, 1) for packet in packets) * (1 / 3)
        phases = [wavenumber * both * path for path in paths]
        parts = divided_differences(*phases, ops=_ops(dr), terms=SERIES_TERMS[4])
        return facet + 1, [t + value * weight for t, value in zip(total, (*parts[0], *parts[1]), strict=True)]

    lanes = dr.width(at.item)
    end = dr.gather(UInt32, starts, at.item + 1)
    _, total = dr.while_loop(
        state=(dr.gather(UInt32, starts, at.item), [dr.zeros(Float32, lanes) for _ in range(4)]),
        cond=lambda facet, total: facet < end,
        body=add,
        labels=("facet", "total"),
        mode="symbolic",
    )
    wavelength = SPEED_OF_LIGHT / pair.frequency_hz
    scale = Float32(at.constant(pair.link_amplitude * math.sqrt(4 * math.pi) / wavelength))
    # IF = tx conj(rx): the conjugate of the usual -j/lambda Gamma ... e^{-jkR}.
    turn = -1j * complex(reflection).conjugate()
    real, imag = (scale * dr.opaque(Float32, float(x)) for x in (turn.real, turn.imag))
    per_hz = dr.opaque(Float32, 1 / pair.frequency_hz)
    amplitude = _complex_times(real, imag, total[0], total[1])
    slope = _complex_times(real * per_hz, imag * per_hz, total[2], total[3])
    planes = at.collect(*amplitude, *slope)
    return _joined(*planes[:2]), _joined(*planes[2:])


def diffuse_echoes(
    vertices: np.ndarray,
    faces: np.ndarray,
    barycentric: np.ndarray,
    area_m2: np.ndarray,
    phase_rad: np.ndarray,
    visibility: np.ndarray | None,
    pair: Pair,
    scattered: float,
    backend: Backend,
) -> tuple[np.ndarray, np.ndarray]:
    """Echoes of Q Lambertian points of fixed random phase: sigma_q = 4 S^2 |Gamma|^2 A_q cos_i cos_s; delay and amplitude (Q, T).

    Point q lies at barycentric (Q, 3) of the triangle faces (Q, 3) of vertices (V, T, 3) m float64; visibility (V, T, 1) or
    None; `scattered` is S |Gamma|.
    """
    at = _Gather(vertices, len(faces), backend)
    index = at.vertices(at.columns(faces), at.item)
    corners = at.points(index)
    point = _combined(corners, [at.per_item(barycentric[:, i]) for i in range(3)])
    normal, doubled_area = _normal(corners, at)
    sights = [_minus(at.place(antenna), point) for antenna in pair.places_m]
    ranges = [_norm(sight) for sight in sights]
    cosines = [at.dr.maximum(_dot(normal, s) / (doubled_area * d), 0) for s, d in zip(sights, ranges, strict=True)]
    root = at.per_item(pair.link_amplitude * 2 * scattered * np.sqrt(area_m2))
    weight = backend.Float32(root * at.dr.sqrt(cosines[0] * cosines[-1]) / (ranges[0] * ranges[-1]))
    if visibility is not None:
        weight *= at.corner_mean(at.field(visibility), index)
    sin, cos = at.dr.sincos(backend.Float32(at.per_item(phase_rad)))
    delay, real, imag = at.collect((ranges[0] + ranges[-1]) * (1 / SPEED_OF_LIGHT), cos * weight, sin * weight)
    return delay, _joined(real, imag)


class _Gather:
    """Lanes over (item, frame): reads vertices of every item's triangles, writes arrays (items, T).

    Frames run fastest, as in the vertices (V, T, ...): neighbouring lanes read neighbouring numbers.
    """

    def __init__(self, vertices: np.ndarray, items: int, backend: Backend) -> None:
        import drjit

        self.dr = drjit
        self.backend = backend
        self.frames = vertices.shape[1]
        self.shape = (items, self.frames)
        self.real = backend.Float32 if vertices.dtype == np.float32 else backend.Float64
        self.numbers = self.real(np.ascontiguousarray(vertices).ravel())
        UInt32 = backend.UInt32
        lane = drjit.arange(UInt32, items * self.frames)
        # Opaque: a number in the code would compile a kernel for every mesh.
        self.stride = drjit.opaque(UInt32, self.frames)
        self.item = lane // self.stride
        self.frame = lane - self.item * self.stride

    def columns(self, corners: np.ndarray) -> list[Any]:
        """The three columns of vertex numbers (N, 3)."""
        return [self.backend.UInt32(np.ascontiguousarray(corners[:, i], dtype=np.uint32)) for i in range(3)]

    def vertices(self, columns: list[Any], triangle: Any) -> list[Any]:
        """Numbers of the corners of every lane's triangle."""
        return [self.dr.gather(self.backend.UInt32, column, triangle) for column in columns]

    def packets(self, vertices: list[Any]) -> list[Vector]:
        """Four numbers of each numbered vertex in the lane's frame, read together."""
        Packet = self.backend.arrays.Array4f
        return [tuple(self.dr.gather(Packet, self.numbers, vertex * self.stride + self.frame)) for vertex in vertices]

    def points(self, vertices: list[Any]) -> list[Vector]:
        """Positions of numbered vertices in the lane's frame."""
        return [self._read(self.numbers, vertex) for vertex in vertices]

    def lane_points(self, points: np.ndarray) -> Vector:
        """Points (items, T, 3), one on every lane."""
        return self._read(self.real(np.ascontiguousarray(points).ravel()), self.item)

    def frame_point(self, point: np.ndarray) -> Vector:
        """A moving point (T, 3)."""
        return self._read(self.real(np.ascontiguousarray(point).ravel()), 0)

    def _read(self, numbers: Any, row: Any) -> Vector:
        place = 3 * (row * self.stride + self.frame)
        return tuple(self.dr.gather(self.real, numbers, place + axis) for axis in range(3))

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

    def field(self, values: np.ndarray) -> Any:
        """A vertex field (V, T)."""
        return self.backend.Float32(np.ascontiguousarray(values, dtype=np.float32).ravel())

    def corner_mean(self, field: Any, vertices: list[Any]) -> Any:
        """Mean of a vertex field over a triangle's corners."""
        places = (vertex * self.stride + self.frame for vertex in vertices)
        return sum(self.dr.gather(self.backend.Float32, field, place) for place in places) * (1 / 3)

    def collect(self, *values: Any) -> list[np.ndarray]:
        """Evaluates in one kernel and hands NumPy arrays (items, T) back."""
        self.dr.eval(*values)
        return [value.numpy().reshape(self.shape) for value in values]


def _normal(corners: list[Vector], at: _Gather) -> tuple[Vector, Any]:
    """Normal of twice the triangle's area, and that length, kept from zero."""
    normal = _cross(_minus(corners[1], corners[0]), _minus(corners[2], corners[0]))
    return normal, at.dr.maximum(_norm(normal), 1e-30)


def _extra_path(d: Vector, antenna: Vector) -> Any:
    """Distance of `antenna` from d minus that from the origin [m], without cancellation: d.(d - 2 o)/(R' + R)."""
    return _dot(d, _minus(d, _scaled(antenna, 2))) / (_norm(_minus(antenna, d)) + _norm(antenna))


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
