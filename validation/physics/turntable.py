"""Targets on a turntable: the field that they return at mid-sweep, aspect by aspect, without an ADC cube between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import t2d_rt as t2d
from t2d_rt.body.fit import fit
from t2d_rt.body.materials import resolve_material
from t2d_rt.body.segments import segment_of_faces
from t2d_rt.body.template import template
from t2d_rt.core.backend import select
from t2d_rt.propagation.occluders import Occluders
from t2d_rt.propagation.visibility import Occlusion, viewpoints_at
from t2d_rt.scattering.ellipsoid import PhaseFrom, ellipsoid_echoes
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.types import EchoArrays, EchoStream, Ellipsoids, Motion, MovingMesh, Radar

STEP_S = 0.01
"""From one aspect to the next; only tells them apart."""
FRAMES_AT_ONCE = 64


def aspects(first_deg: float, last_deg: float, count: int) -> np.ndarray:
    """Angles [rad] (count,)."""
    return np.radians(np.linspace(first_deg, last_deg, count))


def on_turntable(
    vertices: np.ndarray,
    faces: np.ndarray,
    angles_rad: np.ndarray,
    centre_m: np.ndarray,
    material: str = "pec",
    *,
    sagitta_rad: float | np.ndarray = 0.07,
    crease_deg: float = 45.0,
    curved: bool = False,
) -> MovingMesh:
    """A mesh (V, 3), turned about the vertical through `centre_m` to each of equally spaced angles, STEP_S apart."""

    def track(times_s: np.ndarray) -> np.ndarray:
        return np.einsum("kij,vj->kvi", _rotations(_angle(angles_rad, times_s)), vertices) + centre_m

    times_s = STEP_S * np.arange(len(angles_rad))
    return MovingMesh.from_track(
        track, faces, times_s, material, rest=vertices, sagitta_rad=sagitta_rad, crease_deg=crease_deg, curved=curved
    )


def ellipsoids_on_turntable(
    semi_axes_m: np.ndarray,
    centres: np.ndarray,
    axes: np.ndarray,
    angles_rad: np.ndarray,
    centre_m: np.ndarray,
    material: str = "pec",
) -> Ellipsoids:
    """The same of ellipsoids: centres (N, 3) m from the axis, axes (N, 3, 3)."""

    def track(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rotations = _rotations(_angle(angles_rad, times_s))
        return np.einsum("kij,nj->kni", rotations, centres) + centre_m, np.einsum("kij,njl->knil", rotations, axes)

    return Ellipsoids.from_track(track, semi_axes_m, STEP_S * np.arange(len(angles_rad)), material)


def mesh_fields(
    mesh: MovingMesh,
    radar: Radar,
    *,
    occlusion: bool = True,
    seed: int = 0,
    only: Sequence[np.ndarray] = (),
    bands_hz: np.ndarray | None = None,
) -> np.ndarray:
    """sqrt(sigma)/R^2 [1/m] with the phase of IF, complex (1 + len(only), aspects): of all that is visible, and of each part
    0..1 of the vertices (V,) by itself, without occlusion. With `bands_hz`, frequencies beside mid-sweep, (..., bands)."""
    backend = select("auto")
    times_s = mesh.times_s
    views = [PathVisibility()]
    if occlusion:
        traced = Occlusion.alone(
            Occluders([mesh]),
            *viewpoints_at([radar.tx_position_m]),
            samples_s=times_s,
            backend=backend,
            wavelength_m=None,
        )
        views = [PathVisibility(visibility=(lambda at: traced.visibility(at)[0],))]
    views += [PathVisibility(visibility=(_constant(fraction),)) for fraction in only]
    stream = mesh_echoes(
        mesh, radar,
        times_s=times_s, material=resolve_material(mesh.material, radar.mid_frequency_hz),
        detail=Detail(sagitta_rad=mesh.sagitta_rad),
        seed=seed, views=views, backend=backend,
    )  # fmt: skip
    return _summed(stream, radar, len(views), bands_hz)


def ellipsoid_fields(shape: Ellipsoids, radar: Radar, *, phase_from: PhaseFrom = "specular") -> np.ndarray:
    """Of each ellipsoid, complex (N, aspects), as `mesh_fields`."""
    stream = ellipsoid_echoes(
        shape, radar,
        times_s=shape.times_s, material=resolve_material(shape.material, radar.mid_frequency_hz), phase_from=phase_from,
    )  # fmt: skip
    return _summed(stream, radar, len(shape.names), None)


def rcs(fields: np.ndarray, range_m: float) -> np.ndarray:
    """[m^2], of fields referred to a range."""
    return np.asarray(np.abs(fields) ** 2 * range_m**4)


def db(ratio: np.ndarray | float) -> np.ndarray:
    """Decibels of a power ratio."""
    return np.asarray(10 * np.log10(np.maximum(ratio, 1e-300)))


def _summed(stream: EchoStream, radar: Radar, groups: int, bands_hz: np.ndarray | None) -> np.ndarray:
    """Sums of `groups` equal runs of echoes."""
    found = [_group(block, radar, groups, bands_hz) for block in _blocks(stream)]
    return np.concatenate(found, axis=1) / radar.link_amplitude


def _group(echoes: EchoArrays, radar: Radar, groups: int, bands_hz: np.ndarray | None) -> np.ndarray:
    bands = np.zeros(1) if bands_hz is None else bands_hz
    parts = []
    for delay, amplitude, slope in zip(
        *(np.split(part, groups, axis=1) for part in (echoes.delay_s, echoes.amplitude, _slope(echoes))), strict=True
    ):
        row, column = np.nonzero(amplitude)
        starts = np.searchsorted(row, np.arange(len(delay)))
        sums = np.zeros((len(delay), len(bands)), complex)
        for number, band in enumerate(bands):
            cycles = (radar.mid_frequency_hz + band) * delay[row, column]
            terms = (amplitude[row, column] + band * slope[row, column]) * np.exp(2j * math.pi * (cycles % 1))
            filled = np.unique(row)
            sums[filled, number] = np.add.reduceat(terms, starts[filled]) if len(terms) else 0
        parts.append(sums if bands_hz is not None else sums[:, 0])
    return np.stack(parts)


def _slope(echoes: EchoArrays) -> np.ndarray:
    return np.zeros_like(echoes.amplitude) if echoes.slope is None else echoes.slope


def _blocks(stream: EchoStream) -> Iterator[EchoArrays]:
    count = len(stream.times_s)
    return (stream.frames(first, min(first + FRAMES_AT_ONCE, count)) for first in range(0, count, FRAMES_AT_ONCE))


def _constant(fraction: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda times_s: np.broadcast_to(np.asarray(fraction, np.float32), (len(times_s), len(fraction)))


def _angle(angles_rad: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    return np.asarray(angles_rad[0] + (angles_rad[1] - angles_rad[0]) * np.asarray(times_s) / STEP_S)


def _rotations(angles_rad: np.ndarray) -> np.ndarray:
    """Rotations about the vertical (K, 3, 3)."""
    cos, sin, zero, one = np.cos(angles_rad), np.sin(angles_rad), np.zeros(len(angles_rad)), np.ones(len(angles_rad))
    return np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]]).transpose(2, 0, 1)


@dataclass(frozen=True, slots=True)
class Body:
    """The adult of one frame of a recording, standing on z = 0, its pelvis over the origin, facing the radar (-x)."""

    vertices: np.ndarray
    faces: np.ndarray
    sagitta_rad: float | np.ndarray
    segment: np.ndarray
    """Which segment each face belongs to, (F,)."""
    names: tuple[str, ...]
    semi_axes_m: np.ndarray
    centres: np.ndarray
    axes: np.ndarray

    @classmethod
    def at(cls, motion: Motion, time_s: float) -> Body:
        """Of a motion's frame."""
        skin, limbs = t2d.skin(motion), t2d.segments(motion)
        frame = int(np.argmin(np.abs(motion.times_s - time_s)))
        hips = [motion.joints[frame, motion.index(f"{side}_hip")] for side in ("left", "right")]
        # Left of a person who faces -x is -y.
        rotation = _rotations(np.array([-math.pi / 2 - math.atan2(*(hips[0] - hips[1])[[1, 0]])]))[0]
        pelvis = motion.joints[frame, motion.index("pelvis")] * [1, 1, 0]
        instant_s = motion.times_s[frame : frame + 1]
        centres, axes = (values[0] for values in limbs.at(instant_s))
        return cls(
            vertices=(skin.at(instant_s)[0] - pelvis) @ rotation.T,
            faces=skin.faces,
            sagitta_rad=skin.sagitta_rad,
            segment=segment_of_faces(fit(template("adult"), motion)),
            names=limbs.names,
            semi_axes_m=limbs.semi_axes_m,
            centres=(centres - pelvis) @ rotation.T,
            axes=rotation @ axes,
        )

    def mesh(self, angles_rad: np.ndarray, range_m: float, material: str) -> MovingMesh:
        """On a turntable `range_m` before a radar at x = 0; at 0 it faces the radar, at 90 degrees it shows its right side."""
        return on_turntable(
            self.vertices, self.faces, angles_rad, np.array([range_m, 0, 0]), material,
            sagitta_rad=self.sagitta_rad, curved=True,
        )  # fmt: skip

    def ellipsoids(self, angles_rad: np.ndarray, range_m: float, material: str) -> Ellipsoids:
        """The same of ellipsoids."""
        place = np.array([range_m, 0, 0])
        return ellipsoids_on_turntable(self.semi_axes_m, self.centres, self.axes, angles_rad, place, material)

    def part(self, number: int) -> np.ndarray:
        """Fraction of each vertex in a segment, (V,): 1 inside and fading out over one row of faces."""
        fraction = np.zeros(len(self.vertices))
        np.maximum.at(fraction, self.faces[self.segment == number].ravel(), 1.0)
        return fraction
