"""Phases of ray tubes that ride on moving surfaces, and what they return: kernels over lanes (node, frame) and (tube, frame)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.geometry.vectors import cross
from t2d_rt.scattering.curved_integral import curved_integrals
from t2d_rt.scattering.facets import EXPANSION_ORDER
from t2d_rt.scattering.lanes import Vector, lane_ops, minus, norm
from t2d_rt.scattering.phase_integral import SERIES_TERMS, divided_differences


class Track:
    """Vertices at some frames, on the device."""

    def __init__(self, vertices: np.ndarray, backend: Backend) -> None:
        """(T, V, 3) m."""
        self.frames, self.vertices = vertices.shape[:2]
        self.backend = backend
        self.numbers = backend.lanes(vertices, backend.Float64)


def path_lengths(
    track: Track,
    frames: np.ndarray,
    corners: np.ndarray,
    coordinates: np.ndarray,
    sense: np.ndarray,
    ends_m: tuple[np.ndarray, np.ndarray],
) -> Any:
    """Lengths [m] of paths from a transmitter over B points to a receiver at some of a track's frames (K,): flat Float64 (N, K).

    The points lie in triangles with vertices `corners` (N, B, 3) at `coordinates` (N, B, 3); `sense` (N, B - 1) is that of the
    parts between them.
    """
    import drjit as dr

    backend = track.backend
    UInt32, Float64 = backend.UInt32, backend.Float64
    lane = dr.arange(UInt32, len(corners) * len(frames))
    per_path = dr.opaque(UInt32, len(frames))
    path = lane // per_path
    row = dr.gather(UInt32, backend.lanes(frames), lane - path * per_path) * dr.opaque(UInt32, track.vertices)

    def of_path(values: np.ndarray, kind: Any) -> Any:
        return dr.gather(kind, backend.lanes(values, kind), path)

    def fixed(place_m: np.ndarray) -> Vector:
        return tuple(dr.opaque(Float64, float(x)) for x in place_m)

    def vertex(numbers: np.ndarray) -> Vector:
        first = 3 * (row + of_path(numbers, UInt32))
        return tuple(dr.gather(Float64, track.numbers, first + axis) for axis in range(3))

    total, last = dr.zeros(Float64, len(corners) * len(frames)), fixed(ends_m[0])
    for bounce in range(corners.shape[1]):
        a, b, c = (vertex(corners[:, bounce, i]) for i in range(3))
        u, v = minus(b, a), minus(c, a)
        normal = cross(u, v)
        along_u, along_v, off = (of_path(coordinates[:, bounce, i], Float64) for i in range(3))
        off = off / norm(normal)
        place = tuple(x + along_u * p + along_v * q + off * n for x, p, q, n in zip(a, u, v, normal, strict=True))
        part = norm(minus(place, last))
        total = total + (part if bounce == 0 else part * of_path(sense[:, bounce - 1], Float64))
        last = place
    total = total + norm(minus(fixed(ends_m[1]), last))
    dr.eval(total)
    return total


class Lengths(NamedTuple):
    """Of paths at K frames, on the device."""

    nodes_m: Any
    """Flat Float64 (N, K)."""
    carriers_m: Any
    """Flat Float64 (G, K)."""
    frames: int
    """K."""


def tube_fields(
    lengths: Lengths,
    nodes: np.ndarray,
    carrier: np.ndarray,
    amplitude: np.ndarray,
    wavenumber: float,
    backend: Backend,
) -> tuple[np.ndarray, np.ndarray]:
    """Integral of amplitude times exp(j phase) over tubes at some frames, their carriers' phases taken out, and its derivative by
    the logarithm of the frequency (eq. 4, 30): complex64 (M, K).

    `nodes` (M, 6), or (M, 3) where the phase is linear, are paths, and `carrier` (M,) the tubes' carriers; `amplitude` (M, 3)
    is that at the corners.
    """
    import drjit as dr

    UInt32, Float32, Float64 = backend.UInt32, backend.Float32, backend.Float64
    lane = dr.arange(UInt32, len(nodes) * lengths.frames)
    per_tube = dr.opaque(UInt32, lengths.frames)
    tube = lane // per_tube
    frame = lane - tube * per_tube

    def read(values: Any, rows: np.ndarray) -> Any:
        return dr.gather(Float64, values, dr.gather(UInt32, backend.lanes(rows), tube) * per_tube + frame)

    own = read(lengths.carriers_m, carrier)
    k = dr.opaque(Float64, float(wavenumber))
    phases = [Float32(k * (read(lengths.nodes_m, column) - own)) for column in nodes.T]
    corners = [dr.gather(Float32, backend.lanes(column, Float32), tube) for column in amplitude.T]
    ops = lane_ops(dr)
    if len(phases) == 3:
        value, change = divided_differences(*phases, ops=ops, terms=SERIES_TERMS[4])
        mean = (corners[0] + corners[1] + corners[2]) * (1 / 3)
        value, change = ((x * mean, y * mean) for x, y in (value, change))
    else:
        bubbles = [4 * phases[3 + i] - 2 * (phases[i] + phases[(i + 1) % 3]) for i in range(3)]
        value, change = curved_integrals(
            phases[:3], corners, bubbles, ops=ops, terms=SERIES_TERMS[4], order=EXPANSION_ORDER
        )
    flat = [dr.ravel(backend.arrays.Array2f(*each)) for each in (value, change)]
    dr.eval(flat)
    found = [np.asarray(each).view(np.complex64).reshape(len(nodes), lengths.frames) for each in flat]
    return found[0], found[1]
