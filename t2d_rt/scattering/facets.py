"""Physical optics on triangles in closed form (docs/physics.md, eq. 3 and 4)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import one_thread_at_a_time
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import cross, dot
from t2d_rt.scattering.curved_integral import facet_integral
from t2d_rt.scattering.lanes import (
    EchoBlock,
    LaneReader,
    Vector,
    Weights,
    combined,
    complex_times,
    lane_ops,
    minus,
    norm,
    plus,
    scaled,
    triangle_normal,
)
from t2d_rt.scattering.patches import PairPlaces, Patches

THIRDS = [1 / 3, 1 / 3, 1 / 3]


@dataclass(frozen=True, slots=True, kw_only=True)
class FacetVertices:
    """Facets at T frames, on the device."""

    vertices: Any
    """Vertices, flat Float32 (V, T, 4): position [m] relative to the origin, and 1."""
    visibility: Any
    """Visibility of the vertices at the facets' corners, flat Float32 (Vc, T); None: all are visible."""
    corners: np.ndarray
    """Rows of the visibility for the corners of each facet, (F, 3)."""
    centres: Any
    """Reference points [m] of all patches, whose delays are the patches', flat Float64 (G, T, 3)."""
    origin: np.ndarray
    """Origin of the positions at each frame [m], (T, 3)."""
    points: PointVertices | None
    """The patches' diffuse points; None if they have none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointVertices:
    """Diffuse points of some patches at T frames."""

    vertices: Any
    """Vertices of the triangles that hold the points, flat Float32 (Vp, T, 4) on the device: position [m] relative to the origin,
    and 1."""
    visibility: Any
    """Visibility of these vertices, flat Float32 (Vp, T) on the device; None: all are visible."""
    corners: np.ndarray
    """Numbers of the vertices of each point's triangle, (Q, 3)."""
    packets: np.ndarray
    """Place, size and phase of each point as in `DiffusePoints.packets`, (Q, 4)."""
    starts: np.ndarray
    """First point of each patch and the end, (P + 1,)."""
    scattered: np.ndarray
    """S |Gamma| of each patch (eq. 9), (P,)."""


@one_thread_at_a_time
def patch_delays(centres: Any, patches: np.ndarray, pair: PairPlaces, block: EchoBlock, columns: np.ndarray) -> None:
    """Writes delays [s] of `patches` (P,), by number, to `columns` (P,); `centres` [m] is flat Float64 (G, T, 3) on the device."""
    at = LaneReader(centres, block.shape[0], len(patches), block.backend)
    centre = at.points([at.per_lane(patches)])[0]
    ranges = [norm(minus(at.place(antenna), centre)) for antenna in pair.places_m]
    block.put(at, columns, delay=pair.delays(at, ranges))


@one_thread_at_a_time
def patch_echoes(
    posed: FacetVertices,
    patches: Patches,
    numbers: np.ndarray,
    pair: PairPlaces,
    reflection: np.ndarray,
    weights: Weights | None,
    block: EchoBlock,
    columns: np.ndarray,
) -> None:
    """Writes the amplitude [sqrt(W)] and slope [sqrt(W)/Hz] of patches, without the carrier of their delays.

    `patches` are those with `numbers` (P,) among all G patches; their echoes go to `columns` (P,). `reflection` (P,) is Gamma of
    each patch's surface times the fraction of the field that stays coherent; the diffuse points add the rest.
    """
    at = LaneReader(posed.vertices, block.shape[0], len(patches), block.backend)
    dr, Float32 = at.dr, block.backend.Float32
    number = at.per_lane(numbers)
    antennas = _Antennas.of(at, posed, number, pair)
    total = _phase_integrals(at, posed, patches, antennas)
    wavelength = SPEED_OF_LIGHT / pair.frequency_hz
    scale = Float32(at.constant(pair.link_amplitude * math.sqrt(4 * math.pi) / wavelength))
    # IF = tx conj(rx): this is the conjugate of the usual j/lambda Gamma ... e^{-jkR}.
    factor = -1j * reflection.conjugate()
    real, imag = (scale * at.value_per_lane(x) for x in (factor.real, factor.imag))
    per_hz = dr.opaque(Float32, 1 / pair.frequency_hz)
    amplitude = complex_times(real, imag, total[0], total[1])
    slope = complex_times(real * per_hz, imag * per_hz, total[2], total[3])
    if posed.points is not None:
        diffuse = _diffuse_sums(at, posed.points, antennas)
        scale = at.value_per_lane(2 * pair.link_amplitude * posed.points.scattered)
        amplitude = tuple(x + scale * y for x, y in zip(amplitude, diffuse[:2], strict=True))
        slope = tuple(x + scale * per_hz * y for x, y in zip(slope, diffuse[2:], strict=True))
    if weights is not None:
        amplitude, slope = at.weighted(weights, number, amplitude, slope)
    block.put(at, columns, amplitude=amplitude, slope=slope)


class _Antennas(NamedTuple):
    """The antennas as each patch sees them."""

    centre: Vector
    """Centre of the patch, relative to the origin [m]."""
    places: list[Vector]
    """Places of the antennas relative to that centre [m]."""
    radians: Any
    """Phase [rad] for a metre of path to each of these places: k, or 2 k if a single place stands for both antennas."""

    @classmethod
    def of(cls, at: LaneReader, posed: FacetVertices, number: Any, pair: PairPlaces) -> _Antennas:
        """The antennas for patches by their numbers."""
        Float32, Float64 = at.backend.Float32, at.backend.Float64
        origin = at.read(at.backend.lanes(posed.origin, Float64), 0)
        centre = tuple(Float32(x - o) for x, o in zip(at.read(posed.centres, number), origin, strict=True))
        places = [minus(at.frame_point(place - posed.origin), centre) for place in pair.views_m]
        wavenumber = Float32(at.constant(2 * math.pi * pair.frequency_hz / SPEED_OF_LIGHT))
        return cls(centre, places, wavenumber * (2 / len(places)))

    def phase(self, place: Vector) -> Any:
        """Phase of a place relative to the centre [rad]."""
        return self.radians * sum(_extra_path(place, antenna) for antenna in self.places)


def _phase_integrals(at: LaneReader, posed: FacetVertices, patches: Patches, antennas: _Antennas) -> list[Any]:
    """Sum I over each patch's facets of obliquity times phase integral over R^2 (eq. 3), and d(w I)/dw, w the relative frequency
    (eq. 4), as real and imaginary parts without unit."""
    nodes_of, corners_of = at.table(patches.nodes), at.table(posed.corners)

    def add(facet: Any, total: list[Any]) -> tuple[Any, list[Any]]:
        nodes = [minus(packet[:3], antennas.centre) for packet in at.packets(at.vertices(nodes_of, facet))]
        visibility = [1.0, 1.0, 1.0]
        if posed.visibility is not None:
            visibility = at.field(posed.visibility, at.vertices(corners_of, facet))
        amplitudes = (_flat_amplitude if len(nodes) == 3 else _curved_amplitudes)(
            at, nodes, visibility, antennas.places
        )
        # This is a branch, which lanes skip together where none of their facets is lit.
        arguments = nodes, amplitudes, total
        lit, integrate = sum(amplitudes) > 0, partial(_with_integral, at, antennas)
        return facet + 1, at.dr.if_stmt(arguments, lit, integrate, lambda *unlit: unlit[-1], mode="symbolic")

    return _sums(at, patches.starts, add)


def _with_integral(
    at: LaneReader, antennas: _Antennas, nodes: list[Vector], amplitudes: list[Any], total: list[Any]
) -> list[Any]:
    """The sums of `_phase_integrals` after one more facet."""
    value, change = facet_integral([antennas.phase(node) for node in nodes], amplitudes, lane_ops(at.dr))
    return [t + x for t, x in zip(total, (*value, *change), strict=True)]


def _diffuse_sums(at: LaneReader, points: PointVertices, antennas: _Antennas) -> list[Any]:
    """Sum over each patch's diffuse points of sqrt(sigma_q)/(2 S |Gamma| R^2) exp(j phase), with sigma_q and the fixed random phase
    of eq. 9, and its derivative by the logarithm of the frequency, as real and imaginary parts."""
    dr, Packet, Float32 = at.dr, at.backend.arrays.Array4f, at.backend.Float32
    held = LaneReader(points.vertices, at.frames, len(points.starts) - 1, at.backend)
    corners_of = held.table(points.corners)
    packets = at.backend.lanes(points.packets.ravel(), Float32)

    def add(point: Any, total: list[Any]) -> tuple[Any, list[Any]]:
        first, second, root, own_phase = dr.gather(Packet, packets, point)
        vertices = held.vertices(corners_of, point)
        corners = [minus(packet[:3], antennas.centre) for packet in held.packets(vertices)]
        place = combined(corners, [first, second, 1 - first - second])
        normal, doubled_area = triangle_normal(corners, at)
        lines_of_sight = [minus(antenna, place) for antenna in antennas.places]
        ranges = [norm(line_of_sight) for line_of_sight in lines_of_sight]
        cosines = [
            dr.maximum(dot(normal, s) / (doubled_area * d), 0) for s, d in zip(lines_of_sight, ranges, strict=True)
        ]
        weight = root * dr.sqrt(cosines[0] * cosines[-1]) / (ranges[0] * ranges[-1])
        if points.visibility is not None:
            weight *= sum(held.field(points.visibility, vertices)) * (1 / 3)
        phase = antennas.phase(place)
        sin, cos = dr.sincos(phase + own_phase)
        real, imag = weight * cos, weight * sin
        return point + 1, [t + value for t, value in zip(total, (real, imag, -phase * imag, phase * real), strict=True)]

    return _sums(at, points.starts, add)


def _sums(at: LaneReader, starts: np.ndarray, add: Callable[[Any, list[Any]], tuple[Any, list[Any]]]) -> list[Any]:
    """Four sums over the members starts[p]..starts[p + 1] - 1 of every lane's patch."""
    dr, UInt32 = at.dr, at.backend.UInt32
    device = at.backend.lanes(starts)
    end = dr.gather(UInt32, device, at.item + 1)
    _, total = dr.while_loop(
        state=(dr.gather(UInt32, device, at.item), [dr.zeros(at.backend.Float32, dr.width(at.item)) for _ in range(4)]),
        cond=lambda member, total: member < end,
        body=add,
        labels=("member", "total"),
        mode="symbolic",
    )
    return list(total)


def _flat_amplitude(at: LaneReader, corners: list[Vector], visibility: list[Any], antennas: list[Vector]) -> list[Any]:
    """Doubled area times obliquity of a flat facet over the product of both ranges, times its mean visibility."""
    normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]))
    return [_obliquity(at, normal, combined(corners, THIRDS), antennas) * sum(visibility) * (1 / 3)]


def _curved_amplitudes(at: LaneReader, nodes: list[Vector], visibility: list[Any], antennas: list[Vector]) -> list[Any]:
    """Doubled area (per unit of u v) times obliquity over the product of both ranges, times visibility, at the corners of a curved
    facet, between which it is linear: with the true normals there it fades towards the boundary of the lit side."""
    corners, middles = nodes[:3], nodes[3:]
    after = corners[1:] + corners[:1]
    bulges = [
        scaled(minus(m, combined([a, b], [0.5, 0.5])), 4) for a, b, m in zip(corners, after, middles, strict=True)
    ]
    amplitudes = []
    for i, corner in enumerate(corners):
        # Tangents there, along the edges, of the parabola through the six nodes.
        forward = plus(minus(after[i], corner), bulges[i])
        backward = plus(minus(corners[i - 1], corner), bulges[i - 1])
        amplitudes.append(_obliquity(at, cross(forward, backward), corner, antennas) * visibility[i])
    return amplitudes


def _obliquity(at: LaneReader, normal: Vector, place: Vector, antennas: list[Vector]) -> Any:
    """Half the sum of the normal's projections on the lines of sight (eq. 3) over both ranges; 0 if an antenna is behind it."""
    lines_of_sight = [minus(antenna, place) for antenna in antennas]
    ranges = [norm(line_of_sight) for line_of_sight in lines_of_sight]
    projected = [dot(normal, s) / d for s, d in zip(lines_of_sight, ranges, strict=True)]
    lit = (projected[0] > 0) & (projected[-1] > 0)
    return at.dr.select(lit, (projected[0] + projected[-1]) / (2 * ranges[0] * ranges[-1]), 0)


def _extra_path(d: Vector, antenna: Vector) -> Any:
    """Distance of `antenna` from d minus that from the origin [m], computed without cancellation as d.(d - 2 antenna)/(R' + R)."""
    return dot(d, minus(d, scaled(antenna, 2))) / (norm(minus(antenna, d)) + norm(antenna))
