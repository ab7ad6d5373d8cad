"""Echoes of a moving mesh: closed-form facets for the coherent part, frozen points for the diffuse part."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.echo.facets import Leg, Patches, diffuse_echoes, lit_patches, patch_delays, patch_echoes
from t2d_rt.errors import InputError
from t2d_rt.geometry import Refinement, point_spacing, refine, surface_points
from t2d_rt.types import EchoArrays, EchoStream, Material, MovingMesh, Radar

# Diffuse points lie on a refinement of their own fixed fineness, so that they do not depend on the facets' size: a point is off
# the curved surface by a tenth of this phase.
POINT_SAGITTA_RAD = 0.4
POINTS_PER_MESH = 8_000
"""At least about this many diffuse points; their number does not change the power."""
PROBE_EVERY = 4
"""Frames between looks at which patches face the antennas."""
VisibilityAt = Callable[[np.ndarray], np.ndarray]
"""Visibility in 0..1 of a mesh's vertices (K, V) at times [s] (K,)."""


def mesh_echoes(
    surface: MovingMesh,
    radar: Radar,
    *,
    times_s: np.ndarray,
    material: Material,
    sagitta_rad: float,
    seed: int,
    visibility: VisibilityAt | None,
    backend: Backend,
) -> EchoStream:
    """Echoes of `surface` at surface frames `times_s`, delay of each facet's centroid and of each diffuse point.

    `sagitta_rad` sets the facets' size (physics.md, eq. 5); `visibility` says what is hidden, None nothing but back faces.
    """
    model = _Model.of(surface, radar, material, sagitta_rad, seed, least_range_m(surface, radar))
    leg = Leg(
        transmitter_m=radar.tx_position_m,
        receiver_m=radar.rx_position_m,
        frequency_hz=radar.mid_frequency_hz,
        link_amplitude=radar.link_amplitude,
    )

    def frames(start: int, stop: int) -> EchoArrays:
        times = times_s[start:stop]
        seen = None if visibility is None else visibility(times)
        return model.echoes(surface.at(times), seen, leg, backend)

    return EchoStream(times_s=times_s, frames=frames)


def joined(streams: list[EchoStream]) -> EchoStream:
    """Several targets' echoes as one stream; all must have the same frame times."""
    if len(streams) == 1:
        return streams[0]

    def frames(start: int, stop: int) -> EchoArrays:
        parts = [stream.frames(start, stop) for stream in streams]
        slopes = [np.zeros_like(p[1]) if p[2] is None else p[2] for p in parts]
        return np.hstack([p[0] for p in parts]), np.hstack([p[1] for p in parts]), np.hstack(slopes)

    return EchoStream(times_s=streams[0].times_s, frames=frames)


def least_range_m(surface: MovingMesh, radar: Radar) -> float:
    """Least distance of the mesh's vertices from an antenna over the record [m]; the radar must stand outside the mesh."""
    span = surface.times_s[-1] - surface.times_s[0]
    times = np.linspace(surface.times_s[0], surface.times_s[-1], int(np.clip(20 * span, 2, 200)))
    vertices = surface.at(times)
    ranges = [np.linalg.norm(vertices - antenna, axis=2) for antenna in (radar.tx_position_m, radar.rx_position_m)]
    return float(np.min(ranges))


@dataclass(frozen=True, slots=True)
class _Model:
    """What stays the same from frame to frame."""

    patches: Patches
    reflection: complex
    points: _Points | None
    fine: Refinement

    @classmethod
    def of(
        cls, surface: MovingMesh, radar: Radar, material: Material, sagitta_rad: float, seed: int, range_m: float
    ) -> _Model:
        def refined(sagitta: float) -> Refinement:
            return refine(
                surface.rest,
                surface.faces,
                wavenumber=2 * math.pi / radar.wavelength_m,
                range_m=range_m,
                sagitta_rad=sagitta,
                crease_deg=surface.crease_deg,
            )

        reflection = material.reflection(radar.mid_frequency_hz)
        rough = material.scattering_coefficient
        fine = refined(sagitta_rad)
        points = None
        if rough > 0:
            carrier = fine if sagitta_rad == POINT_SAGITTA_RAD else refined(POINT_SAGITTA_RAD)
            points = _Points.spread(surface, carrier, seed, rough * abs(reflection))
        return cls(_patches(fine, surface), reflection * math.sqrt(1 - rough**2), points, fine)

    def echoes(self, cage: np.ndarray, seen: np.ndarray | None, leg: Leg, backend: Backend) -> EchoArrays:
        """Arrays of `Echoes` for cage vertices (K, V, 3): patches first, then diffuse points."""
        vertices = _carried(self.fine.operator, cage)
        count, more = len(self.patches.share), 0 if self.points is None else len(self.points.area_m2)
        delay = np.empty((len(cage), count + more))
        amplitude = np.zeros(delay.shape, np.complex64)
        slope = np.zeros(delay.shape, np.complex64)
        delay[:, :count] = patch_delays(vertices, self.patches, leg, backend).T
        probes = np.unique(np.linspace(0, len(cage) - 1, max(2, len(cage) // PROBE_EVERY)).astype(int))
        lit = lit_patches(vertices[:, probes], self.patches, leg, backend)
        fraction = None if seen is None else _carried(self.fine.linear, seen)
        coherent = patch_echoes(vertices, self.patches.only(lit), fraction, leg, self.reflection, backend)
        amplitude[:, lit], slope[:, lit] = (part.T for part in coherent)
        if self.points is not None:
            delay[:, count:], amplitude[:, count:] = (part.T for part in self.points.echoes(cage, seen, leg, backend))
        return delay, amplitude, slope


def _patches(fine: Refinement, surface: MovingMesh) -> Patches:
    """Facets of one cage face, in Morton order of their centroids at rest, four by four."""
    centroids = (fine.operator @ surface.rest)[fine.faces].mean(axis=1)
    low = centroids.min(axis=0)
    cell = ((centroids - low) / max(float(np.ptp(centroids, axis=0).max()), 1e-9) * 4095).astype(np.int64)
    code = np.zeros(len(cell), np.int64)
    for bit in range(12):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << (3 * bit + axis)
    order = np.lexsort((code, fine.base_face))
    return Patches.of(fine.faces[order], fine.base_face[order])


@dataclass(frozen=True, slots=True)
class _Points:
    """Diffuse points on the triangles that hold them."""

    carrier: Refinement
    """Only the vertices that hold points."""
    corners: np.ndarray
    barycentric: np.ndarray
    area_m2: np.ndarray
    phase_rad: np.ndarray
    scattered: float

    @classmethod
    def spread(cls, surface: MovingMesh, carrier: Refinement, seed: int, scattered: float) -> _Points:
        rest = carrier.operator @ surface.rest
        a, b, c = (rest[carrier.faces[:, i]] for i in range(3))
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        points = surface_points(rest, carrier.faces, seed=seed, spacing_m=point_spacing(area, POINTS_PER_MESH))
        used, corners = np.unique(carrier.faces[points.face], return_inverse=True)
        held = Refinement(
            operator=carrier.operator[used], faces=carrier.faces, base_face=carrier.base_face, linear=carrier.linear[used]
        )
        return cls(held, corners.reshape(-1, 3), points.barycentric, points.area_m2, points.phase_rad, scattered)

    def echoes(
        self, cage: np.ndarray, seen: np.ndarray | None, leg: Leg, backend: Backend
    ) -> tuple[np.ndarray, np.ndarray]:
        vertices = _carried(self.carrier.operator, cage)
        fraction = None if seen is None else _carried(self.carrier.linear, seen)
        return diffuse_echoes(
            vertices, self.corners, self.barycentric, self.area_m2, self.phase_rad, fraction, leg, self.scattered, backend
        )


def _carried(operator: object, values: np.ndarray) -> np.ndarray:
    """Applies a sparse (Vf, V) to values (K, V, ...) of the cage: (Vf, K, ...)."""
    frames = len(values)
    columns = np.ascontiguousarray(np.moveaxis(values, 0, 1)).reshape(values.shape[1], -1)
    out = operator @ columns  # type: ignore[operator]
    return out.reshape(-1, frames, *values.shape[2:])


def check_outside(surface: MovingMesh, radar: Radar) -> None:
    """Refuses a radar inside a closed mesh at any of a few moments of the record."""
    for antenna in (radar.tx_position_m, radar.rx_position_m):
        times = np.linspace(surface.times_s[0], surface.times_s[-1], 25)
        vertices = surface.at(times)
        inside = np.abs(_winding(vertices, surface.faces, antenna)) > 0.5
        if inside.any():
            where = ", ".join(f"{x:.3g}" for x in antenna)
            raise InputError(
                f"the radar at ({where}) m is inside {surface.name} at {times[np.argmax(inside)]:.3g} s; place the target "
                "farther away (distance_m) or move the radar"
            )


def _winding(vertices: np.ndarray, faces: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Winding number (K,) of meshes (K, V, 3) about a point: 1 inside, 0 outside (Van Oosterom & Strackee 1983)."""
    a, b, c = (vertices[:, faces[:, i]] - point for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    triple = np.sum(a * np.cross(b, c), axis=2)
    rest = la * lb * lc + np.sum(a * b, 2) * lc + np.sum(b * c, 2) * la + np.sum(c * a, 2) * lb
    return 2 * np.arctan2(triple, rest).sum(axis=1) / (4 * math.pi)
