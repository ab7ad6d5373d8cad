"""Ways between an antenna and a target in a room: which there are, and what each does to the field (docs/physics.md, eq. 24).

Rays from the antenna find the chains of mirrors that exist at all; from then on a chain is exact for every point: an image of the
antenna, a product of slab coefficients in the two polarisations, reflection points inside the mirrors' outlines, free segments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.trace.edges import Edges
from t2d_rt.trace.materials import resolved
from t2d_rt.trace.mirrors import Mirror, Mirrors
from t2d_rt.trace.slabs import slab
from t2d_rt.types import Leg, Material

Reflection = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""TE and TM coefficients (F, ...) at angles of incidence given by their cosine (...), at frequencies [Hz] (F,)."""


def find_legs(
    mirrors: Mirrors,
    place_m: np.ndarray,
    polarization: np.ndarray,
    frequency_hz: float,
    *,
    order: int,
    probes_m: np.ndarray,
) -> list[Leg]:
    """Legs of up to `order` reflections between an antenna at `place_m`, of that polarisation (3,), and any of points (P, 3)."""
    each = reflections(mirrors, frequency_hz)
    edges = Edges.of(mirrors, SPEED_OF_LIGHT / frequency_hz)
    found = []
    for chain in mirrors.chains(place_m, order):
        leg = _leg(mirrors, edges, chain, np.asarray(place_m, float), polarization, [each[k] for k in chain])
        if leg.clear(probes_m).any():
            found.append(leg)
    return found


def reflections(mirrors: Mirrors, frequency_hz: float) -> list[Reflection]:
    """Of each mirror; what a rough one scatters is missing from what it reflects (docs/physics.md, eq. 9)."""

    def of(material: Material, thickness_m: float) -> Reflection:
        smooth = math.sqrt(1 - material.scattering_coefficient**2)

        def reflection(cosine: np.ndarray, frequencies_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            found = [slab(material, thickness_m, cosine, float(frequency))[:2] for frequency in frequencies_hz]
            te, tm = smooth * np.stack(found, axis=1)
            return te, tm

        return reflection

    surfaces = mirrors.scene.surfaces
    materials = [resolved(surface.material, frequency_hz) for surface in surfaces]
    each = [of(material, surface.thickness_m) for material, surface in zip(materials, surfaces, strict=True)]
    return [each[mirror.surface] for mirror in mirrors.each]


def _leg(
    mirrors: Mirrors,
    edges: Edges,
    chain: tuple[int, ...],
    place: np.ndarray,
    polarization: np.ndarray,
    reflections: Sequence[Reflection],
) -> Leg:
    used = [mirrors.each[k] for k in chain]
    images, turn, shift = [place], np.eye(3), np.zeros(3)
    for mirror in used:
        images.append(mirror.reflected(images[-1]))
        shift = shift + turn @ (2 * mirror.offset_m * mirror.normal)
        turn = turn @ (np.eye(3) - 2 * np.outer(mirror.normal, mirror.normal))

    def field(points: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
        # The way from the image, bent back mirror by mirror, begins at the antenna.
        ahead = points @ turn.T + shift - place
        ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
        wave = (polarization - (ahead @ polarization)[..., None] * ahead).astype(complex)
        wave /= np.maximum(np.linalg.norm(wave, axis=-1, keepdims=True), 1e-12)
        wave = np.repeat(wave[None], len(frequencies_hz), axis=0)
        for mirror, coefficients in zip(used, reflections, strict=True):
            wave, ahead = _reflected(wave, ahead, mirror.normal, coefficients, frequencies_hz)
        return wave

    def clear(points: np.ndarray) -> np.ndarray:
        good, stops = _way(points, images, used)
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

    return Leg(
        chain=tuple(mirror.name for mirror in used),
        image_m=images[-1],
        turn=turn,
        shift_m=shift,
        field=field,
        way=lambda points: np.stack(_way(points, images, used)[1]),
        clear=clear,
        share=lambda points: edges.share(points, lambda some: _way(some, images, used), chain),
    )


def _way(points: np.ndarray, images: list[np.ndarray], used: list[Mirror]) -> tuple[np.ndarray, list[np.ndarray]]:
    """For which points (..., 3) every reflection lies between its neighbours, and the way: antenna, reflections, points."""
    stops = [points]
    good = np.ones(points.shape[:-1], bool)
    for image, mirror in zip(images[:0:-1], used[::-1], strict=True):
        here = stops[-1]
        before, after = image @ mirror.normal - mirror.offset_m, here @ mirror.normal - mirror.offset_m
        # The image lies behind the mirror, the point before it.
        good &= before * after < 0
        share = after / np.where(after == before, 1, after - before)
        stops.append(here + share[..., None] * (image - here))
    stops.append(np.broadcast_to(images[0], points.shape))
    return good, stops[::-1]


def _reflected(
    wave: np.ndarray, ahead: np.ndarray, normal: np.ndarray, coefficients: Reflection, frequencies_hz: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The field (F, ..., 3) and its direction (..., 3) after a plane mirror.

    TE is across the plane of incidence, TM = TE x direction before and after: at normal incidence R_TE = -R_TM is one and the same.
    """
    cosine = ahead @ normal
    onward = ahead - 2 * cosine[..., None] * normal
    across = _cross(ahead, normal)
    length = np.sqrt(np.einsum("...i,...i->...", across, across))[..., None]
    # At normal incidence any direction across will do.
    helper = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.6 else [0, 1.0, 0])
    across = np.where(length > 1e-9, across / np.maximum(length, 1e-12), helper / np.linalg.norm(helper))
    te, tm = coefficients(np.abs(cosine), frequencies_hz)
    before, after = _cross(across, ahead), _cross(across, onward)
    te *= np.einsum("f...i,...i->f...", wave, across)
    tm *= np.einsum("f...i,...i->f...", wave, before)
    return te[..., None] * across + tm[..., None] * after, onward


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Cross products of vectors (..., 3); numpy's own takes several times as long."""
    a, b, c = (u[..., i] for i in range(3))
    x, y, z = (v[..., i] for i in range(3))
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)
