"""Patches: neighbouring facets that return as one echo, as large as motion and sweep allow (docs/physics.md, eq. 15)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import warn
from t2d_rt.core.memory import blocks
from t2d_rt.geometry import Refinement
from t2d_rt.geometry.vectors import edge_cross, norms
from t2d_rt.types import MovingMesh, PathPair, Radar
from t2d_rt.types.radar import one_view

if TYPE_CHECKING:
    from t2d_rt.scattering.lanes import LaneReader

Csr = Any
"""A scipy.sparse matrix."""
Ends = tuple[np.ndarray, np.ndarray]
"""Places [m] of a transmitter and a receiver, or of their images: (3,) each, or (K, 3) of those that move."""
CYCLES_PER_STEP = 0.35
"""Greatest change, from one surface frame to the next, of the phase between two facets of a patch [cycles]: a walk's field errs by
0.8 dB less than with 0.5, and by 0.1 dB more than with 0.25."""
SWEEP_CYCLES = 0.25
"""Greatest change over the sweep of the phase between two facets of a patch [cycles], along each axis."""
APERTURE_CYCLES = 0.05
"""Greatest change of that phase from an array's centre to its outermost antennas [cycles]. The field errs by -38 dB with 3 x 4
antennas, and by -24 dB with 12 x 16, where single facets exceed this value (validation/report, arrays)."""
FAST_FRACTION = 0.02
"""Fraction of the surface that may rotate too fast for its facets before a warning."""
MOST_FACETS = 256
"""Greatest number of facets of a patch, a power of two: patches are blocks of that many facets, or halves, quarters and so on."""
RANGE_STEP = 1.25
"""Ratio of the least ranges that are distinguished; a body's facets differ by a percent from one to the next."""
PROBE_RATE_HZ, PROBES = 12.5, 40
"""Rate [Hz] at which motion is sampled, and the number of instants that are taken together, which is also the least number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairPlaces:
    """The places that a target is seen from, over one path pair."""

    places_m: list[np.ndarray]
    """Places [m] of transmitter and receiver or of their images, (3,), or (T, 3) if these move; a single one if both coincide."""
    views_m: list[np.ndarray]
    """Places [m] for the echoes' amplitudes, but not for their delays: a single one if both are close together (`one_view`)."""
    frequency_hz: float
    """Frequency at mid-sweep."""
    link_amplitude: float
    """Link amplitude [sqrt(W) m]: the received amplitude is link_amplitude sqrt(rcs)/(R_tx R_rx)."""
    delay_s: float = 0.0
    """Delay of the slabs on the paths [s], which is added to that of the distances."""
    moving: Callable[[np.ndarray], PairPlaces] | None = None
    """For a radar that moves in a scene, the pair as a function of times [s] (T,); the places above are where its track begins."""

    @classmethod
    def of(cls, radar: Radar, paths: PathPair | None = None, times_s: np.ndarray | None = None) -> PairPlaces:
        """Places of the radar's array centres, or of their images over a path pair, at times [s] (T,) where these move."""
        places, moving = [radar.tx_position_m, radar.rx_position_m], None
        if paths is not None:
            places = [paths.out.image_m, paths.back.image_m]
            if paths.out.passing is not None and times_s is None:
                moving = partial(cls.of, radar, paths)
            elif paths.out.passing is not None:
                places = [paths.out.place_m(times_s), paths.back.place_m(times_s)]
        return cls(
            places_m=places[:1] if np.array_equal(places[0], places[1]) else places,
            views_m=one_view(*places),
            frequency_hz=radar.mid_frequency_hz,
            link_amplitude=radar.link_amplitude,
            delay_s=0.0 if paths is None else paths.delay_s,
            moving=moving,
        )

    def at(self, times_s: np.ndarray) -> PairPlaces:
        """The pair as it is at times [s] (T,)."""
        return self if self.moving is None else self.moving(times_s)

    @property
    def ends_m(self) -> Ends:
        """Places of the transmitter and of the receiver."""
        return self.places_m[0], self.places_m[-1]

    def delays(self, at: LaneReader, ranges: list[Any]) -> Any:
        """Delays [s] on every lane, from the distances to the places [m]."""
        return (ranges[0] + ranges[-1]) * (1 / SPEED_OF_LIGHT) + at.constant(self.delay_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Patches:
    """Facets in patches: a facet's phase relative to its patch's own delay changes slowly, in time and over the sweep."""

    nodes: np.ndarray
    """Vertices of the facets, patch by patch, integers (F, 3), or (F, 6) of curved ones, corners first."""
    base_face: np.ndarray
    """Face of the unrefined mesh that each facet lies in, integers (F,)."""
    starts: np.ndarray
    """First facet of each patch and the end, integers (G + 1,)."""

    def __len__(self) -> int:
        return len(self.starts) - 1

    @property
    def corners(self) -> np.ndarray:
        """Vertices at the facets' corners, (F, 3)."""
        return self.nodes[:, :3]

    def only(self, chosen: np.ndarray) -> Patches:
        """Some of the patches, by their indices."""
        facet, starts = members(self.starts, chosen)
        return Patches(nodes=self.nodes[facet], base_face=self.base_face[facet], starts=starts)

    def any_of(self, base: np.ndarray) -> np.ndarray:
        """Whether any facet of each patch lies in a face for which `base` (unrefined faces,) is true, (G,)."""
        return np.logical_or.reduceat(base[self.base_face], self.starts[:-1])


def patches(
    surface: MovingMesh,
    fine: Refinement,
    radar: Radar,
    times_s: np.ndarray,
    *,
    pairs: Sequence[PairPlaces] | None = None,
    cycles_per_step: float = CYCLES_PER_STEP,
    sweep_cycles: float = SWEEP_CYCLES,
    part: np.ndarray | None = None,
) -> Patches:
    """Cuts the facets, along a space-filling curve of the rest pose, until each patch is small enough at all times.

    `pairs` are the path pairs over which the target is seen, by default that from the radar itself. `part` (F,) is the part of the
    surface that each unrefined face belongs to, and a patch has facets of one part alone. Warns if the target rotates too fast.
    """
    pairs = [PairPlaces.of(radar)] if pairs is None else pairs
    places = fine.at(surface.rest)
    rest = places[fine.faces].mean(axis=1)
    order = np.argsort(_morton(rest), kind="stable")
    corners = fine.faces[order]
    # The last facet fills up the last block.
    filled = np.append(order, np.full(-len(order) % MOST_FACETS, order[-1]))
    first = np.arange(len(filled)) % MOST_FACETS == 0
    # Columns are in units of what is allowed: none may spread by more than 1 over a patch.
    per_m = 2 * radar.bandwidth_hz / SPEED_OF_LIGHT / sweep_cycles
    if radar.is_array:
        reach = sum(
            np.linalg.norm(places - centre, axis=1).max()
            for places, centre in (
                (radar.tx_positions_m, radar.tx_position_m),
                (radar.rx_positions_m, radar.rx_position_m),
            )
        )
        range_m = least_range_m(surface, pairs, times_s)
        per_m = max(per_m, reach / range_m / radar.wavelength_m / APERTURE_CYCLES)
    _cut(first, rest[filled] * per_m)
    if part is not None:
        # Twice the number: parts then differ by more than the spread of 1 that a patch may have.
        _cut(first, 2.0 * part[fine.base_face[filled], None])
    rate_hz = (len(times_s) - 1) / (times_s[-1] - times_s[0])
    allowed_mps = radar.wavelength_m * rate_hz * cycles_per_step
    centroid = _mean_rows(fine.faces[filled], np.arange(len(filled) + 1), fine.linear).astype(np.float32)
    widest = np.zeros(len(corners))
    for speeds in _path_speeds(surface, pairs, times_s) if allowed_mps < math.inf else ():
        cycles = speeds / allowed_mps
        _cut(first, centroid @ cycles)
        starts = np.append(np.flatnonzero(first[: len(order)]), len(order))
        alone = starts[:-1][np.diff(starts) == 1]
        if len(alone):
            spread = np.ptp((fine.linear @ cycles)[corners[alone]], axis=1).max(axis=1)
            widest[alone] = np.maximum(widest[alone], spread)
    by_spread = np.argsort(widest)
    spans = places[corners[by_spread]]
    area = np.cumsum(np.linalg.norm(edge_cross(spans), axis=1))
    widest_of_most = float(widest[by_spread[np.searchsorted(area, (1 - FAST_FRACTION) * area[-1])]])
    if widest_of_most > 4:
        warn(
            f"{surface.name} rotates too fast for its facets: phases across {FAST_FRACTION:.0%} of them change by more than "
            f"{widest_of_most * cycles_per_step:.2g} cycles between frames; raise surface_rate_hz to "
            f"{rate_hz * widest_of_most:.0f}, or give a finer mesh"
        )
    starts = np.append(np.flatnonzero(first[: len(order)]), len(order))
    return Patches(nodes=fine.nodes[order], base_face=fine.base_face[order], starts=starts)


def members(starts: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the members starts[g]..starts[g + 1] - 1 of the chosen groups, one group after the other, and their new starts."""
    sizes = np.diff(starts)[chosen]
    new = np.concatenate([[0], np.cumsum(sizes)])
    return np.arange(new[-1]) + np.repeat(starts[chosen] - new[:-1], sizes), new


def centres(parts: Patches, fine: Refinement) -> Csr:
    """Sparse matrix (G, V) that gives the patches' reference points from the unrefined vertices.

    A reference point is the mean of the facets' centroids, carried linearly: a little below the curved surface, but moving with it.
    """
    return _mean_rows(parts.corners, parts.starts, fine.linear)


def _mean_rows(corners: np.ndarray, starts: np.ndarray, linear: Csr) -> Csr:
    """Sparse matrix (G, V): rows of `linear`, averaged over the corners (F, 3) of facets starts[g]..starts[g + 1] - 1."""
    from scipy.sparse import csr_array

    sizes = np.diff(starts)
    fraction = np.repeat(1 / (3.0 * sizes), 3 * sizes)
    return csr_array((fraction, corners.ravel(), 3 * starts), shape=(len(sizes), linear.shape[0])) @ linear


def least_range_m(surface: MovingMesh, pairs: Sequence[PairPlaces], times_s: np.ndarray) -> float:
    """Least distance of the mesh's vertices from an antenna over the record [m], rounded down to a power of `RANGE_STEP`.

    It sets how fine facets and, for arrays, patches must be; recordings of one body at about the same distance share its facets.
    """
    span = times_s[-1] - times_s[0]
    least = math.inf
    for times in blocks(np.linspace(times_s[0], times_s[-1], int(np.clip(20 * span, 2, 200))), len(surface.rest)):
        least = min(
            least, *(float(ranges.min()) for ranges in _ranges_of(surface.at(times), _ends_at(pairs, times)).values())
        )
    return rounded_range_m(least)


def rounded_range_m(range_m: float) -> float:
    """A range [m] rounded down to a power of `RANGE_STEP`."""
    return RANGE_STEP ** math.floor(math.log(range_m, RANGE_STEP)) if range_m > 0 else range_m


def tilts(surface: MovingMesh, fine: Refinement) -> np.ndarray:
    """Largest angle at rest between each unrefined face and a facet that lies in it [rad], (unrefined faces,)."""
    normal = normals(fine.controlled(surface.rest)[surface.faces])
    facet = fine.corner_normals(surface.rest)
    cosine = np.einsum("fci,fi->fc", facet, normal[fine.base_face]).min(axis=1)
    largest = np.zeros(len(normal))
    np.maximum.at(largest, fine.base_face, np.arccos(np.clip(cosine, -1, 1)))
    return largest


def normals(corners: np.ndarray) -> np.ndarray:
    """Unit normals (..., 3) of faces with corners (..., 3, 3)."""
    across = edge_cross(corners)
    return across / np.maximum(norms(across)[..., None], 1e-30)


def _path_speeds(surface: MovingMesh, pairs: Sequence[PairPlaces], times_s: np.ndarray) -> Iterator[np.ndarray]:
    """Yields for each pair the rates of change [m/s] of the paths over the unrefined vertices, float32 (V, up to PROBES)."""
    step = min(1e-3, (times_s[-1] - times_s[0]) / 10)
    count = max(PROBES, int(PROBE_RATE_HZ * (times_s[-1] - times_s[0])))
    instants = np.linspace(times_s[0], times_s[-1] - step, count)
    for first in range(0, count, PROBES):
        for times in blocks(instants[first : first + PROBES], 2 * len(surface.rest)):
            sides = np.concatenate([times, times + step])
            ends = _ends_at(pairs, sides)
            ranges = _ranges_of(surface.at(sides), ends)
            for tx, rx in ends:
                before, after = np.split(ranges[tx.tobytes()] + ranges[rx.tobytes()], 2)
                yield ((after - before) / step).T.astype(np.float32)


def _ends_at(pairs: Sequence[PairPlaces], times_s: np.ndarray) -> list[Ends]:
    """Places of transmitter and receiver of each pair at times [s] (K,)."""
    return [pair.at(times_s).ends_m for pair in pairs]


def _ranges_of(vertices: np.ndarray, all_ends: Sequence[Ends]) -> dict[bytes, np.ndarray]:
    """Distances [m] (K, V) of vertices from each place, which path pairs have in common, by the place's bytes."""
    places = {place.tobytes(): place for ends in all_ends for place in ends}
    return {key: ranges_m(vertices, place) for key, place in places.items()}


def ranges_m(vertices: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Distances [m] (K, V) of vertices (K, V, 3) [m] from one place (3,) or (K, 3) [m]."""
    line_of_sight = vertices - place[..., None, :]
    return np.sqrt(np.einsum("kvi,kvi->kv", line_of_sight, line_of_sight))


def _morton(points: np.ndarray) -> np.ndarray:
    """Position of points (N, 3) along a Z-shaped space-filling curve, int64 (N,)."""
    low = points.min(axis=0)
    cell = ((points - low) / max(float(np.ptp(points, axis=0).max()), 1e-9) * 4095).astype(np.int64)
    code = np.zeros(len(cell), np.int64)
    for bit in range(12):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << (3 * bit + axis)
    return code


def _cut(first: np.ndarray, columns: np.ndarray) -> None:
    """Marks the middle of every block of 2, 4 ... MOST_FACETS rows over which one of columns (N, C) spreads by over 1.

    Each row that is marked in `first`, bool (N,), begins a patch. A block spreads at least as far as each of its halves, so what
    lies between two marks is the largest block that does not.
    """
    low = high = columns
    half = 1
    while half < MOST_FACETS:
        low, high = np.minimum(low[::2], low[1::2]), np.maximum(high[::2], high[1::2])
        first[half :: 2 * half] |= (high - low > 1).any(axis=1)
        half *= 2
