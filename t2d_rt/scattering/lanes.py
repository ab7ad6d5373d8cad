"""Dr.Jit lanes over (item, frame): reading vertices, vectors on every lane, and writing echoes' columns."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend, one_thread_at_a_time
from t2d_rt.geometry.vectors import cross, dot
from t2d_rt.types import EchoArrays

Vector = tuple[Any, ...]
"""Components x, y, z of a vector on every lane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights:
    """Factors of a path pair on amplitudes, known at anchors; each echo takes the weighted mean over a few of these."""

    near: Any
    """Numbers of each echo's anchors, flat UInt32 (N, n) on the device."""
    fraction: Any
    """Weight of each of these anchors, flat Float32 (N, n)."""
    count: int
    """Number n of anchors of each echo."""
    values: Any
    """Complex factor on the amplitude at each anchor, and its slope over frequency [1/Hz], flat Float32 (A, T, 4)."""
    reach: np.ndarray
    """Which echoes the field reaches, bool (N,)."""


class Table(NamedTuple):
    """Vertex numbers of triangles, read four at a time because a read costs lanes as much as some ten operations."""

    numbers: Any
    """Vertex numbers, flat UInt32 on the device; each triangle's are filled up to whole packets of four."""
    width: int
    """Number of vertices of each triangle."""
    packets: int


NOTHING = 1e-35
"""Amplitudes below this [sqrt(W)] are set to 0: some of the threads that compute flush numbers below 1.2e-38 to 0 and others do
not, and whether an echo is 0 decides how echoes are summed."""


def _flushed(dr: Any, value: Any) -> Any:
    """A number, or 0 where its magnitude is below `NOTHING`."""
    return dr.select(dr.abs(value) >= NOTHING, value, 0)


class EchoBlock:
    """Echoes (T, N) on the device while they are computed: kernels write some of the columns."""

    def __init__(self, frames: int, echoes: int, backend: Backend) -> None:
        import drjit as dr

        self.shape = (frames, echoes)
        self.backend = backend
        self._delay = dr.zeros(backend.Float64, frames * echoes)
        self._amplitude, self._slope = (dr.zeros(backend.Float32, 2 * frames * echoes) for _ in range(2))

    @one_thread_at_a_time
    def put(
        self, at: LaneReader, columns: np.ndarray, *, delay: Any = None, amplitude: Any = None, slope: Any = None
    ) -> None:
        """Writes the lanes' values, complex ones as pairs, to `columns` (items,), one for each item."""
        dr, backend = at.dr, self.backend
        place = at.frame * dr.opaque(backend.UInt32, self.shape[1]) + dr.gather(
            backend.UInt32, backend.lanes(columns), at.item
        )
        for value, into, kind in (
            (delay, self._delay, None),
            (amplitude, self._amplitude, backend.arrays.Array2f),
            (slope, self._slope, backend.arrays.Array2f),
        ):
            if value is not None:
                dr.scatter(into, value if kind is None else kind(*(_flushed(dr, part) for part in value)), place)
        dr.eval(self._delay, self._amplitude, self._slope)  # before another thread goes on

    @one_thread_at_a_time
    def arrays(self) -> EchoArrays:
        """The echoes (T, N) as NumPy arrays; what was not written is 0."""
        delay, amplitude, slope = (values.numpy() for values in (self._delay, self._amplitude, self._slope))
        return EchoArrays(
            delay.reshape(self.shape),
            amplitude.view(np.complex64).reshape(self.shape),
            slope.view(np.complex64).reshape(self.shape),
        )


class LaneReader:
    """Lanes over (item, frame) that read vertices of every item's triangles.

    Frames run fastest, as in the vertices, flat (V, T, ...) on the device: neighbouring lanes read neighbouring numbers.
    """

    def __init__(self, numbers: Any, frames: int, items: int, backend: Backend) -> None:
        import drjit

        self.dr = drjit
        self.backend = backend
        self.frames = frames
        self.numbers = numbers
        self.real = type(numbers)
        UInt32 = backend.UInt32
        lane = drjit.arange(UInt32, items * frames)
        # Opaque: a number in the code would compile a kernel for every mesh.
        self.stride = drjit.opaque(UInt32, frames)
        self.item = lane // self.stride
        self.frame = lane - self.item * self.stride

    def table(self, vertices: np.ndarray) -> Table:
        """Vertex numbers (N, C) on the device, as `vertices` reads them."""
        count, packets = vertices.shape[1], -(-vertices.shape[1] // 4)
        filled = np.zeros((len(vertices), 4 * packets), np.uint32)
        filled[:, :count] = vertices
        return Table(self.backend.lanes(filled), count, packets)

    def vertices(self, table: Table, triangle: Any) -> list[Any]:
        """Numbers of the vertices of every lane's triangle."""
        Packet = self.backend.arrays.Array4u
        packets = [self.dr.gather(Packet, table.numbers, triangle * table.packets + k) for k in range(table.packets)]
        return [number for packet in packets for number in packet][: table.width]

    def packets(self, vertices: list[Any]) -> list[Vector]:
        """Four numbers of each numbered vertex in the lane's frame, read together."""
        Packet = self.backend.arrays.Array4f
        return [tuple(self.dr.gather(Packet, self.numbers, vertex * self.stride + self.frame)) for vertex in vertices]

    def points(self, vertices: list[Any]) -> list[Vector]:
        """Positions of numbered vertices in the lane's frame."""
        return [self.read(self.numbers, vertex) for vertex in vertices]

    def frame_point(self, point: np.ndarray) -> Vector:
        """Position of a moving point (T, 3) in the lane's frame."""
        return self.read(self.backend.lanes(point, self.real), 0)

    def read(self, numbers: Any, row: Any) -> Vector:
        """Three numbers of a row in the lane's frame, from flat (R, T, 3) on the device."""
        place = 3 * (row * self.stride + self.frame)
        return tuple(self.dr.gather(type(numbers), numbers, place + axis) for axis in range(3))

    def per_lane(self, numbers: np.ndarray) -> Any:
        """On every lane, the whole number of its item out of (items,)."""
        return self.dr.gather(self.backend.UInt32, self.backend.lanes(numbers), self.item)

    def value_per_lane(self, values: np.ndarray) -> Any:
        """On every lane, the Float32 number of its item out of (items,)."""
        return self.dr.gather(self.backend.Float32, self.backend.lanes(values, self.backend.Float32), self.item)

    def weighted(
        self, weights: Weights, number: Any, amplitude: tuple[Any, Any], slope: tuple[Any, Any]
    ) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """Amplitude and slope of the numbered echoes, times the weighted mean of their anchors' factors."""
        Packet = self.backend.arrays.Array4f
        total = Packet(0)
        for k in range(weights.count):
            place = number * weights.count + k
            anchor = self.dr.gather(self.backend.UInt32, weights.near, place)
            fraction = self.dr.gather(self.backend.Float32, weights.fraction, place)
            total += fraction * self.dr.gather(Packet, weights.values, anchor * self.stride + self.frame)
        changed = complex_times(*slope, total[0], total[1])
        rotated = complex_times(*amplitude, total[2], total[3])
        return complex_times(*amplitude, total[0], total[1]), (changed[0] + rotated[0], changed[1] + rotated[1])

    def constant(self, value: float) -> Any:
        """A Float64 number that is data to the kernel, not code."""
        return self.dr.opaque(self.backend.Float64, float(value))

    def place(self, position_m: np.ndarray) -> Vector:
        """Position of a fixed point (3,), or of a moving one (T, 3) in the lane's frame."""
        if position_m.ndim == 2:
            return self.frame_point(position_m)
        return tuple(self.constant(x) for x in position_m)

    def field(self, values: Any, vertices: list[Any]) -> list[Any]:
        """Values of a field at numbered vertices in the lane's frame, from flat (V, T) on the device."""
        places = (vertex * self.stride + self.frame for vertex in vertices)
        return [self.dr.gather(self.backend.Float32, values, place) for place in places]


def lane_ops(dr: Any) -> Any:
    """The operations that `phase_integral` asks for (`Ops`), on lanes."""
    return SimpleNamespace(minimum=dr.minimum, maximum=dr.maximum, where=dr.select, sincos=dr.sincos, fma=dr.fma)


def triangle_normal(corners: list[Vector], at: LaneReader) -> tuple[Vector, Any]:
    """Normal of a triangle, as long as twice its area, and that length, which is kept above zero."""
    normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]))
    return normal, at.dr.maximum(norm(normal), 1e-30)


def complex_times(real: Any, imag: Any, other_real: Any, other_imag: Any) -> tuple[Any, Any]:
    """Product of two complex numbers, as real and imaginary part."""
    return real * other_real - imag * other_imag, real * other_imag + imag * other_real


def combined(points: list[Vector], weights: list[Any]) -> Vector:
    """Weighted sum of points."""
    total = scaled(points[0], weights[0])
    for point, weight in zip(points[1:], weights[1:], strict=True):
        total = tuple(t + x * weight for t, x in zip(total, point, strict=True))
    return total


def minus(a: Vector, b: Vector) -> Vector:
    """The difference a - b of two vectors."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def plus(a: Vector, b: Vector) -> Vector:
    """The sum a + b of two vectors."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def scaled(a: Vector, factor: Any) -> Vector:
    """The vector a times a factor."""
    return tuple(x * factor for x in a)


def norm(a: Vector) -> Any:
    """The length of a vector."""
    import drjit

    return drjit.sqrt(dot(a, a))  # ** 0.5 takes sixteen times as long
