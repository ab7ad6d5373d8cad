"""One-way paths between an antenna and a target in a room, and the field over each (docs/physics.md, eq. 24).

Rays from the antenna find the chains of mirrors that exist at all; from then on a path is exact for every point: an image of the
antenna, a product of slab coefficients in the two polarisations, intersections inside the mirrors' outlines, free segments. A
mirror reflects, or it transmits without refraction.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import cross
from t2d_rt.propagation.edges import Edges
from t2d_rt.propagation.materials import resolved
from t2d_rt.propagation.mirrors import Mirror, Mirrors
from t2d_rt.propagation.slabs import slab
from t2d_rt.types import Material, OneWayPath

Coefficients = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""TE and TM coefficients (F, ...) at angles of incidence given by their cosine (...), at frequencies [Hz] (F,)."""


@dataclass(frozen=True, slots=True)
class Met:
    """A mirror in a chain: it reflects or transmits."""

    number: int
    """Of the mirror, among all."""
    mirror: Mirror
    through: bool
    coefficients: Coefficients
    """Of reflection, or of transmission without the phase of `delay_s`."""
    delay_s: float
    """Of the transmitted wave, straight on from face to face; 0 for a reflection."""

    @property
    def name(self) -> str:
        """Of the mirror, with "(through)" for a transmission."""
        return f"{self.mirror.name} (through)" if self.through else self.mirror.name


def find_paths(
    mirrors: Mirrors,
    place_m: np.ndarray,
    polarization: np.ndarray,
    frequency_hz: float,
    *,
    order: int,
    transmissions: int = 0,
    probes_m: np.ndarray,
) -> list[OneWayPath]:
    """One-way paths of up to `order` reflections and `transmissions` slabs between an antenna at `place_m`, of that polarisation
    (3,), and any of points (P, 3)."""
    materials = [resolved(surface.material, frequency_hz) for surface in mirrors.scene.surfaces]
    loss_db = _losses_db(mirrors, materials, frequency_hz) if transmissions else None
    chains = mirrors.chains(place_m, order, transmissions=transmissions, loss_db=loss_db)
    mirrors, chains = mirrors.parted(chains)
    edges = Edges.of(mirrors, SPEED_OF_LIGHT / frequency_hz)
    found = []
    for chain in chains:
        met = [_met(mirrors, k, materials) for k in chain]
        path = _one_way_path(mirrors, edges, met, np.asarray(place_m, float), polarization)
        if path.exists(probes_m).any():
            found.append(path)
    return found


def _losses_db(mirrors: Mirrors, materials: Sequence[Material], frequency_hz: float) -> np.ndarray:
    """Transmission loss of each mirror (M,) at normal incidence."""
    slabs = zip(materials, mirrors.scene.surfaces, strict=True)
    transmitted = [slab(material, surface.thickness_m, np.array(1.0), frequency_hz)[2] for material, surface in slabs]
    return -20 * np.log10(np.maximum(np.abs(transmitted), 1e-30))[[mirror.surface for mirror in mirrors.each]]


def _met(mirrors: Mirrors, number: int, materials: Sequence[Material]) -> Met:
    """One element of a chain."""
    through = number < 0
    number = ~number if through else number
    mirror = mirrors.each[number]
    material, thickness_m = materials[mirror.surface], mirrors.scene.surfaces[mirror.surface].thickness_m
    delay_s = thickness_m * math.sqrt(material.relative_permittivity) / SPEED_OF_LIGHT if through else 0.0
    # What a rough surface scatters is missing from what it reflects (docs/physics.md, eq. 9), not from what it transmits.
    smooth = math.sqrt(1 - material.scattering_coefficient**2)

    def coefficients(cosine: np.ndarray, frequencies_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = []
        for frequency in map(float, frequencies_hz):
            r_te, r_tm, t_te, t_tm = slab(material, thickness_m, cosine, frequency)
            phasor = cmath.exp(2j * math.pi * frequency * delay_s)
            found.append((phasor * t_te, phasor * t_tm) if through else (smooth * r_te, smooth * r_tm))
        te, tm = np.stack(found, axis=1)
        return te, tm

    return Met(number, mirror, through, coefficients, delay_s)


def _one_way_path(
    mirrors: Mirrors, edges: Edges, chain: Sequence[Met], place: np.ndarray, polarization: np.ndarray
) -> OneWayPath:
    used, numbers = [met.mirror for met in chain], [met.number for met in chain]
    images, mirror_matrix, shift = [place], np.eye(3), np.zeros(3)
    for met in chain:
        if met.through:
            images.append(images[-1])
            continue
        mirror = met.mirror
        images.append(mirror.reflected(images[-1]))
        shift = shift + mirror_matrix @ (2 * mirror.offset_m * mirror.normal)
        mirror_matrix = mirror_matrix @ (np.eye(3) - 2 * np.outer(mirror.normal, mirror.normal))

    def field(points: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
        # The straight path from the image, folded back mirror by mirror, begins at the antenna.
        ahead = points @ mirror_matrix.T + shift - place
        ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
        wave = (polarization - (ahead @ polarization)[..., None] * ahead).astype(complex)
        wave /= np.maximum(np.linalg.norm(wave, axis=-1, keepdims=True), 1e-12)
        wave = np.repeat(wave[None], len(frequencies_hz), axis=0)
        for met in chain:
            wave, ahead = _after(wave, ahead, met, frequencies_hz)
        return wave

    def exists(points: np.ndarray) -> np.ndarray:
        good, stops = _vertices(points, images, used)
        inside = good.copy()
        if good.any():
            stops = [stop[good] for stop in stops]
            whole = np.ones(len(stops[0]), bool)
            for mirror, stop in zip(used, stops[1:-1], strict=True):
                whole &= mirror.holds(stop)
            for start, stop in pairwise(stops):
                whole[whole] = mirrors.free(start[whole], stop[whole])
            inside[good] = whole
        return inside.astype(np.float32)

    return OneWayPath(
        chain=tuple(met.name for met in chain),
        image_m=images[-1],
        mirror_matrix=mirror_matrix,
        shift_m=shift,
        field=field,
        vertices=lambda points: np.stack(_vertices(points, images, used)[1]),
        exists=exists,
        fraction=lambda points: edges.fraction(points, lambda some: _vertices(some, images, used), numbers),
        transmissions=sum(met.through for met in chain),
        delay_s=sum(met.delay_s for met in chain),
    )


def _vertices(points: np.ndarray, images: list[np.ndarray], used: list[Mirror]) -> tuple[np.ndarray, list[np.ndarray]]:
    """For which points (..., 3) every mirror is met between its neighbours, and the path: antenna, intersections, points."""
    stops = [points]
    good = np.ones(points.shape[:-1], bool)
    for image, mirror in zip(images[:0:-1], used[::-1], strict=True):
        here = stops[-1]
        before, after = image @ mirror.normal - mirror.offset_m, here @ mirror.normal - mirror.offset_m
        # The image lies on one side of the mirror, the point on the other.
        good &= before * after < 0
        fraction = after / np.where(after == before, 1, after - before)
        stops.append(here + fraction[..., None] * (image - here))
    stops.append(np.broadcast_to(images[0], points.shape))
    return good, stops[::-1]


def _after(wave: np.ndarray, ahead: np.ndarray, met: Met, frequencies_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The field (F, ..., 3) and its direction (..., 3) after a plane mirror.

    TE is across the plane of incidence, TM = TE x direction before and after: at normal incidence R_TE = -R_TM is one and the same,
    and so is T_TE = T_TM.
    """
    normal = met.mirror.normal
    cosine = ahead @ normal
    onward = ahead if met.through else ahead - 2 * cosine[..., None] * normal
    across = _cross(ahead, normal)
    length = np.sqrt(np.einsum("...i,...i->...", across, across))[..., None]
    # At normal incidence any direction across will do.
    helper = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.6 else [0, 1.0, 0])
    across = np.where(length > 1e-9, across / np.maximum(length, 1e-12), helper / np.linalg.norm(helper))
    te, tm = met.coefficients(np.abs(cosine), frequencies_hz)
    before, after = _cross(across, ahead), _cross(across, onward)
    te *= np.einsum("f...i,...i->f...", wave, across)
    tm *= np.einsum("f...i,...i->f...", wave, before)
    return te[..., None] * across + tm[..., None] * after, onward


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Cross products of vectors (..., 3)."""
    return np.stack(cross(np.moveaxis(u, -1, 0), np.moveaxis(v, -1, 0)), axis=-1)
