"""Physical optics on triangles in closed form, and frozen diffuse points (docs/physics.md, eq. 3, 4 and 9)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import cross, dot
from t2d_rt.scattering.patches import Patches
from t2d_rt.scattering.phase_integral import SERIES_TERMS, Ops, divided_differences
from t2d_rt.types import EchoArrays, PathPair, Radar
from t2d_rt.types.radar import one_view

Vector = tuple[Any, ...]
"""x, y, z on every lane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """The places that a target is seen from, over one path pair."""

    places_m: list[np.ndarray]
    """Transmitter and receiver or their images, (3,) each, or one place where both stand in it."""
    views_m: list[np.ndarray]
    """The same where only the form of the echoes matters (`one_view`)."""
    frequency_hz: float
    """At mid-sweep."""
    link_amplitude: float
    """sqrt(W) m: the received amplitude is link_amplitude sqrt(rcs)/(R_tx R_rx)."""
    delay_s: float = 0.0
    """Added to that of the distances: delay of slabs on the paths."""

    @classmethod
    def of(cls, radar: Radar, paths: PathPair | None = None) -> Pair:
        """That of the radar's array centres, or of their images over a path pair."""
        places = [radar.tx_position_m, radar.rx_position_m]
        if paths is not None:
            places = [paths.out.image_m, paths.back.image_m]
        return cls(
            places_m=places[:1] if np.array_equal(places[0], places[1]) else places,
            views_m=one_view(*places),
            frequency_hz=radar.mid_frequency_hz,
            link_amplitude=radar.link_amplitude,
            delay_s=0.0 if paths is None else paths.delay_s,
        )

    def delays(self, at: _Gather, ranges: list[Any]) -> Any:
        """[s], of distances from the places [m]."""
        return (ranges[0] + ranges[-1]) * (1 / SPEED_OF_LIGHT) + at.constant(self.delay_s)


THIRDS = [1 / 3, 1 / 3, 1 / 3]


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights:
    """Factors of a path pair on amplitudes, known at anchors; each echo takes the weighted mean of a few."""

    near: Any
    """Numbers of each echo's anchors, flat UInt32 (N, n) on the device."""
    fraction: Any
    """Weight of each of these, flat Float32 (N, n)."""
    count: int
    """n."""
    values: Any
    """Flat Float32 (anchor, T, 4): factor of the amplitude, and its slope over frequency [1/Hz]."""
    reach: np.ndarray
    """Which echoes the field reaches, bool (N,)."""


class Block:
    """Echoes at T frames in the making: kernels write columns of (T, N)."""

    def __init__(self, frames: int, echoes: int, backend: Backend) -> None:
        import drjit as dr

        self.shape = (frames, echoes)
        self._backend = backend
        self._delay = dr.zeros(backend.Float64, frames * echoes)
        self._amplitude, self._slope = (dr.zeros(backend.Float32, 2 * frames * echoes) for _ in range(2))

    def put(
        self, at: _Gather, columns: np.ndarray, *, delay: Any = None, amplitude: Any = None, slope: Any = None
    ) -> None:
        """Writes lanes' values, complex ones as pairs, to `columns`, one for each item."""
        dr, backend = at.dr, self._backend
        place = at.frame * dr.opaque(backend.UInt32, self.shape[1]) + dr.gather(
            backend.UInt32, backend.lanes(columns), at.item
        )
        for value, into, kind in (
            (delay, self._delay, None),
            (amplitude, self._amplitude, backend.arrays.Array2f),
            (slope, self._slope, backend.arrays.Array2f),
        ):
            if value is not None:
                dr.scatter(into, value if kind is None else kind(*value), place)

    def arrays(self) -> EchoArrays:
        """What was written; amplitudes are 0 elsewhere."""
        delay, amplitude, slope = (values.numpy() for values in (self._delay, self._amplitude, self._slope))
        return EchoArrays(
            delay.reshape(self.shape),
            amplitude.view(np.complex64).reshape(self.shape),
            slope.view(np.complex64).reshape(self.shape),
        )


def patch_delays(
    centres: Any, patches: np.ndarray, pair: Pair, block: Block, columns: np.ndarray, backend: Backend
) -> None:
    """Writes the delays [s] of `patches` (P,) to `columns` (P,); `centres`: flat Float64 (G, T, 3) m on the device."""
    at = _Gather(centres, block.shape[0], len(patches), backend)
    centre = at.points([at.per_lane(patches)])[0]
    ranges = [_norm(_minus(at.place(antenna), centre)) for antenna in pair.places_m]
    block.put(at, columns, delay=pair.delays(at, ranges))


def patch_echoes(
    vertices: Any,
    centres: Any,
    origin: np.ndarray,
    patches: Patches,
    numbers: np.ndarray,
    pair: Pair,
    reflection: complex,
    weights: Weights | None,
    block: Block,
    columns: np.ndarray,
    backend: Backend,
) -> None:
    """Writes the coherent amplitude [sqrt(W)] and slope [sqrt(W)/Hz] of patches, their delay's carrier taken out.

    vertices: flat Float32 (V, T, 4), place [m] relative to origin (T, 3) and visibility in 0..1; centres: flat Float64 (G, T, 3) m,
    whose delay is the patch's. `patches` are some of the G, by their `numbers` (P,), and go to `columns` (P,). Reflection is
    Gamma of the surface times the fraction that stays coherent.
    """
    at = _Gather(vertices, len(origin), len(patches), backend)
    dr, Float32, UInt32 = at.dr, backend.Float32, backend.UInt32
    wavenumber = Float32(at.constant(2 * math.pi * pair.frequency_hz / SPEED_OF_LIGHT))
    number = at.per_lane(numbers)
    middle = at.read(centres, number)
    centre = tuple(
        Float32(x - o) for x, o in zip(middle, at.read(backend.lanes(origin, backend.Float64), 0), strict=True)
    )
    antennas = [_minus(at.frame_point(place - origin), centre) for place in pair.views_m]
    columns_of = at.columns(patches.corners)
    starts = backend.lanes(patches.starts)

    def add(facet: Any, total: list[Any]) -> tuple[Any, list[Any]]:
        packets = at.packets(at.vertices(columns_of, facet))
        corners = [_minus(packet[:3], centre) for packet in packets]
        normal, doubled_area = _normal(corners, at)
        lines_of_sight = [_minus(antenna, _combined(corners, THIRDS)) for antenna in antennas]
        ranges = [_norm(line_of_sight) for line_of_sight in lines_of_sight]
        cosines = [
            dot(normal, line_of_sight) / (doubled_area * distance)
            for line_of_sight, distance in zip(lines_of_sight, ranges, strict=True)
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
    factor = -1j * complex(reflection).conjugate()
    real, imag = (scale * dr.opaque(Float32, float(x)) for x in (factor.real, factor.imag))
    per_hz = dr.opaque(Float32, 1 / pair.frequency_hz)
    amplitude = _complex_times(real, imag, total[0], total[1])
    slope = _complex_times(real * per_hz, imag * per_hz, total[2], total[3])
    if weights is not None:
        amplitude, slope = at.weighted(weights, number, amplitude, slope)
    dr.eval(amplitude, slope)  # all at once; else each would run the loop again
    block.put(at, columns, amplitude=amplitude, slope=slope)


def diffuse_echoes(
    vertices: Any,
    faces: np.ndarray,
    barycentric: np.ndarray,
    area_m2: np.ndarray,
    phase_rad: np.ndarray,
    visibility: np.ndarray | None,
    pair: Pair,
    scattered: float,
    weights: Weights | None,
    first: int,
    block: Block,
    columns: np.ndarray,
    backend: Backend,
) -> None:
    """Writes echoes of Q Lambertian points of fixed random phase: sigma_q = 4 S^2 |Gamma|^2 A_q cos_i cos_s.

    Point q lies at barycentric (Q, 3) of the triangle faces (Q, 3) of vertices, flat Float64 (V, T, 3) m; visibility (V, T, 1)
    or None; `scattered` is S |Gamma|. Among the weights theirs come from `first` on; they go to `columns` (Q,).
    """
    at = _Gather(vertices, block.shape[0], len(faces), backend)
    index = at.vertices(at.columns(faces), at.item)
    corners = at.points(index)
    point = _combined(corners, [at.per_item(barycentric[:, i]) for i in range(3)])
    normal, doubled_area = _normal(corners, at)
    lines_of_sight = [_minus(at.place(antenna), point) for antenna in pair.places_m]
    ranges = [_norm(line_of_sight) for line_of_sight in lines_of_sight]
    cosines = [
        at.dr.maximum(dot(normal, s) / (doubled_area * d), 0) for s, d in zip(lines_of_sight, ranges, strict=True)
    ]
    root = at.per_item(pair.link_amplitude * 2 * scattered * np.sqrt(area_m2))
    weight = backend.Float32(root * at.dr.sqrt(cosines[0] * cosines[-1]) / (ranges[0] * ranges[-1]))
    if visibility is not None:
        weight *= at.corner_mean(at.field(visibility), index)
    sin, cos = at.dr.sincos(backend.Float32(at.per_item(phase_rad)))
    delay, amplitude, slope = pair.delays(at, ranges), (cos * weight, sin * weight), None
    if weights is not None:
        none = at.dr.zeros(backend.Float32, at.dr.width(at.item))
        number = at.item + at.dr.opaque(backend.UInt32, first)
        amplitude, slope = at.weighted(weights, number, amplitude, (none, none))
    at.dr.eval(delay, amplitude, slope)
    block.put(at, columns, delay=delay, amplitude=amplitude, slope=slope)


class _Gather:
    """Lanes over (item, frame), that read vertices of every item's triangles.

    Frames run fastest, as in the vertices, flat (V, T, ...) on the device: neighbouring lanes read neighbouring numbers.
    """

    def __init__(self, numbers: Any, frames: int, items: int, backend: Backend) -> None:
        import drjit

        self.dr = drjit
        self.backend = backend
        self.numbers = numbers
        self.real = type(numbers)
        UInt32 = backend.UInt32
        lane = drjit.arange(UInt32, items * frames)
        # Opaque: a number in the code would compile a kernel for every mesh.
        self.stride = drjit.opaque(UInt32, frames)
        self.item = lane // self.stride
        self.frame = lane - self.item * self.stride

    def columns(self, corners: np.ndarray) -> list[Any]:
        """The three columns of vertex numbers (N, 3)."""
        return [self.backend.lanes(corners[:, i]) for i in range(3)]

    def vertices(self, columns: list[Any], triangle: Any) -> list[Any]:
        """Numbers of the corners of every lane's triangle."""
        return [self.dr.gather(self.backend.UInt32, column, triangle) for column in columns]

    def packets(self, vertices: list[Any]) -> list[Vector]:
        """Four numbers of each numbered vertex in the lane's frame, read together."""
        Packet = self.backend.arrays.Array4f
        return [tuple(self.dr.gather(Packet, self.numbers, vertex * self.stride + self.frame)) for vertex in vertices]

    def points(self, vertices: list[Any]) -> list[Vector]:
        """Positions of numbered vertices in the lane's frame."""
        return [self.read(self.numbers, vertex) for vertex in vertices]

    def frame_point(self, point: np.ndarray) -> Vector:
        """A moving point (T, 3)."""
        return self.read(self.backend.lanes(point, self.real), 0)

    def read(self, numbers: Any, row: Any) -> Vector:
        """Rows of flat (R, T, 3)."""
        place = 3 * (row * self.stride + self.frame)
        return tuple(self.dr.gather(type(numbers), numbers, place + axis) for axis in range(3))

    def per_lane(self, numbers: np.ndarray) -> Any:
        """A whole number of each item, on every lane."""
        return self.dr.gather(self.backend.UInt32, self.backend.lanes(numbers), self.item)

    def weighted(
        self, weights: Weights, number: Any, amplitude: tuple[Any, Any], slope: tuple[Any, Any]
    ) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """Amplitude and slope of the numbered echoes, weighted."""
        Packet = self.backend.arrays.Array4f
        total = Packet(0)
        for k in range(weights.count):
            place = number * weights.count + k
            anchor = self.dr.gather(self.backend.UInt32, weights.near, place)
            fraction = self.dr.gather(self.backend.Float32, weights.fraction, place)
            total += fraction * self.dr.gather(Packet, weights.values, anchor * self.stride + self.frame)
        changed = _complex_times(*slope, total[0], total[1])
        rotated = _complex_times(*amplitude, total[2], total[3])
        return _complex_times(*amplitude, total[0], total[1]), (changed[0] + rotated[0], changed[1] + rotated[1])

    def constant(self, value: float) -> Any:
        """A number that is data to the kernel, not code."""
        return self.dr.opaque(self.backend.Float64, float(value))

    def place(self, position_m: np.ndarray) -> Vector:
        """A fixed point (3,)."""
        return tuple(self.constant(x) for x in position_m)

    def per_item(self, values: np.ndarray) -> Any:
        """A constant of each item, on every lane."""
        Float64 = self.backend.Float64
        return self.dr.gather(Float64, self.backend.lanes(values, Float64), self.item)

    def field(self, values: np.ndarray) -> Any:
        """A vertex field (V, T)."""
        return self.backend.lanes(values, self.backend.Float32)

    def corner_mean(self, field: Any, vertices: list[Any]) -> Any:
        """Mean of a vertex field over a triangle's corners."""
        places = (vertex * self.stride + self.frame for vertex in vertices)
        return sum(self.dr.gather(self.backend.Float32, field, place) for place in places) * (1 / 3)


def _normal(corners: list[Vector], at: _Gather) -> tuple[Vector, Any]:
    """Normal of twice the triangle's area, and that length, kept from zero."""
    normal = cross(_minus(corners[1], corners[0]), _minus(corners[2], corners[0]))
    return normal, at.dr.maximum(_norm(normal), 1e-30)


def _extra_path(d: Vector, antenna: Vector) -> Any:
    """Distance of `antenna` from d minus that from the origin [m], without cancellation: d.(d - 2 o)/(R' + R)."""
    return dot(d, _minus(d, _scaled(antenna, 2))) / (_norm(_minus(antenna, d)) + _norm(antenna))


def _ops(dr: Any) -> Ops:
    return SimpleNamespace(minimum=dr.minimum, maximum=dr.maximum, where=dr.select, sincos=dr.sincos)  # type: ignore[return-value]


def _complex_times(real: Any, imag: Any, other_real: Any, other_imag: Any) -> tuple[Any, Any]:
    return real * other_real - imag * other_imag, real * other_imag + imag * other_real


def _combined(points: list[Vector], weights: list[Any]) -> Vector:
    total = _scaled(points[0], weights[0])
    for point, weight in zip(points[1:], weights[1:], strict=True):
        total = tuple(t + x * weight for t, x in zip(total, point, strict=True))
    return total


def _minus(a: Vector, b: Vector) -> Vector:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _scaled(a: Vector, factor: Any) -> Vector:
    return tuple(x * factor for x in a)


def _norm(a: Vector) -> Any:
    return dot(a, a) ** 0.5
