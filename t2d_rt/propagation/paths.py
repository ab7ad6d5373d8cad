"""The search for one-way paths between an antenna and points in a room (docs/physics.md, eq. 24).

Rays from the antenna find the chains of mirrors that exist at all; from then on a path is exact for every point: an image of the
antenna, a product of slab coefficients in the two polarisations, intersections inside the mirrors' outlines, free segments. A
mirror reflects, or it transmits without refraction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.propagation.edges import Edges
from t2d_rt.propagation.images import existing, reflected
from t2d_rt.propagation.materials import resolved
from t2d_rt.propagation.mirrors import Chain, Mirrors
from t2d_rt.types import Material, PathSet, Radar
from t2d_rt.types.path_fields import transmission
from t2d_rt.types.paths import Elements, Passing

SEARCHED_M = 0.25
"""Spacing [m] of the places on a radar's track where chains of mirrors are searched; which exist is tested more often."""
SEARCHED_HZ = 100.0
"""Rate [Hz] of the instants from which these places are taken."""


@dataclass(frozen=True, slots=True)
class Along:
    """The track of a radar that moves, as the search for its paths needs it."""

    passing: Passing
    searched_s: np.ndarray
    """Times [s] when it is at places that stand for all of its track, (K,)."""
    probed_s: np.ndarray
    """Times [s] when the points that paths are searched to are where they are, (Q,)."""

    @classmethod
    def of(cls, radar: Radar, span_s: tuple[float, float], probed_s: np.ndarray) -> Along | None:
        """The track between two times [s]; None for a radar that stands still."""
        if radar.track is None:
            return None
        times_s = np.linspace(*span_s, max(2, math.ceil((span_s[1] - span_s[0]) * SEARCHED_HZ)))
        places, numbers = radar.track.places_m(times_s), [0]
        for number, place in enumerate(places):
            if np.linalg.norm(place - places[numbers[-1]]) > SEARCHED_M:
                numbers.append(number)
        return cls(radar.passing, times_s[numbers], probed_s)

    def places_m(self, place_m: np.ndarray) -> np.ndarray:
        """Places (K, 3) [m] in the scene, at `searched_s`, of an antenna at (3,) [m] in the radar's own frame."""
        return self.passing(self.searched_s).back.points(np.broadcast_to(place_m, (len(self.searched_s), 3)))


@dataclass(frozen=True, slots=True)
class FoundPaths:
    """One-way paths of an antenna in a room, and what limits them."""

    paths: PathSet
    edges: Edges
    """Edges of the mirrors as these paths count them: where mirrors overlap, one of them has the place."""
    fraction: np.ndarray
    """Fraction of the field that reaches the points of the search, float32 (P, Q): 1 where a path exists and 0 where it does not,
    or, of a path that exists to no point, what fades into the shadow."""

    def __len__(self) -> int:
        return len(self.paths)


def find_paths(
    mirrors: Mirrors,
    place_m: np.ndarray,
    polarization: np.ndarray,
    frequency_hz: float,
    *,
    order: int,
    transmissions: int = 0,
    probes_m: np.ndarray,
    along: Along | None = None,
) -> FoundPaths:
    """One-way paths of up to `order` reflections and `transmissions` slabs between an antenna at `place_m` (3,) [m] of that
    polarisation (3,) and any of points (Q, 3) [m]; of an antenna that moves `along` a track as this sees them."""
    materials = [resolved(surface.material, frequency_hz) for surface in mirrors.scene.surfaces]
    loss_db = _losses_db(mirrors, materials, frequency_hz) if transmissions else None
    places = np.array([place_m]) if along is None else along.places_m(place_m)
    of_places = (mirrors.chains(place, order, transmissions=transmissions, loss_db=loss_db) for place in places)
    mirrors, chains = mirrors.parted(list(dict.fromkeys(chain for chains in of_places for chain in chains)))
    passing, times_s = (None, None) if along is None else (along.passing, along.probed_s)
    candidates = _path_set(mirrors, materials, chains, np.array(place_m, float), np.array(polarization, float), passing)
    fraction = existing(mirrors, candidates, probes_m, times_s).astype(np.float32)
    edges = Edges.of(mirrors, SPEED_OF_LIGHT / frequency_hz)
    # Just inside a shadow no straight ray comes, but some of the field. That matters of the direct path, the first one, and of
    # all others where no path is left.
    if not fraction[0].any():
        for row in range(1 if fraction.any() else len(candidates)):
            fraction[row] = edges.fraction(candidates[row], probes_m, times_s)
    rows = np.flatnonzero(fraction.any(axis=1))
    return FoundPaths(candidates.taken(rows), edges, fraction[rows])


def _losses_db(mirrors: Mirrors, materials: Sequence[Material], frequency_hz: float) -> np.ndarray:
    """Transmission loss [dB] of each mirror at normal incidence, (M,)."""
    slabs = zip(materials, mirrors.scene.surfaces, strict=True)
    transmitted = [
        transmission(material, surface.thickness_m, np.array(1.0), frequency_hz)[0] for material, surface in slabs
    ]
    return -20 * np.log10(np.maximum(np.abs(transmitted), 1e-30))[[mirror.surface for mirror in mirrors.parts]]


def _path_set(
    mirrors: Mirrors,
    materials: Sequence[Material],
    chains: Sequence[Chain],
    place: np.ndarray,
    polarization: np.ndarray,
    passing: Passing | None,
) -> PathSet:
    """A set with a path over each chain, whether any point has it or not."""
    lengths = np.array([len(chain) for chain in chains])
    mask = np.arange(lengths.max()) < lengths[:, None]
    met = np.zeros(mask.shape, np.int64)
    met[mask] = [k for chain in chains for k in chain]
    elements = _elements(mirrors, materials, met)
    unfoldings = [
        _unfolding(elements.taken((row, slice(length))), place) for row, length in enumerate(lengths.tolist())
    ]
    image_m, mirror_matrix, shift_m = (np.array(column) for column in zip(*unfoldings, strict=True))
    names = [f"{mirror.name}{mark}" for mark in ("", " (through)") for mirror in mirrors.parts]
    return PathSet(
        antenna_m=place,
        polarization=polarization,
        chains=tuple(tuple(names[k if k >= 0 else len(mirrors.parts) + ~k] for k in chain) for chain in chains),
        mask=mask,
        elements=elements,
        image_m=image_m,
        mirror_matrix=mirror_matrix,
        shift_m=shift_m,
        passing=passing,
    )


def _elements(mirrors: Mirrors, materials: Sequence[Material], met: np.ndarray) -> Elements:
    """Elements of chains (P, L): k is a reflection by mirror k, ~k a transmission through it."""
    surfaces, through = mirrors.scene.surfaces, met < 0
    mirror = np.where(through, ~met, met)
    of_surface = np.array([part.surface for part in mirrors.parts])[mirror]
    thickness_m = np.array([surface.thickness_m for surface in surfaces], float)
    permittivity = np.array([material.relative_permittivity for material in materials], float)
    specular = np.array([math.sqrt(1 - material.scattering_coefficient**2) for material in materials])
    return Elements(
        mirror=mirror,
        through=through,
        normal=np.array([part.normal for part in mirrors.parts])[mirror],
        offset_m=np.array([part.offset_m for part in mirrors.parts])[mirror],
        relative_permittivity=permittivity[of_surface],
        conductivity_s_per_m=np.array([material.conductivity_s_per_m for material in materials], float)[of_surface],
        thickness_m=thickness_m[of_surface],
        specular=specular[of_surface],
        delay_s=np.where(through, (thickness_m * np.sqrt(permittivity) / SPEED_OF_LIGHT)[of_surface], 0.0),
    )


def _unfolding(elements: Elements, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Image of the antenna in a chain [m], (3,), mirror matrix (3, 3) and shift [m], (3,)."""
    image, mirror_matrix, shift = place, np.eye(3), np.zeros(3)
    for through, normal, offset_m in zip(elements.through, elements.normal, elements.offset_m, strict=True):
        if not through:
            image = reflected(image, normal, offset_m)
            shift = shift + mirror_matrix @ (2 * offset_m * normal)
            mirror_matrix = mirror_matrix @ (np.eye(3) - 2 * np.outer(normal, normal))
    return image, mirror_matrix, shift
