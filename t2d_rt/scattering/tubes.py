"""Ray tubes between targets at one instant: geometrical optics at all surfaces but the last, physical optics there
(physics.md, eq. 31)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.geometry.vectors import norms, vector_product
from t2d_rt.scattering.ray_fronts import GRAZING, Front, Instant, launched, outgoing, reflected, seen_area, two_edges
from t2d_rt.scattering.reflectors import Lattice, dot

LARGEST_BUBBLE_RAD = 3.0
"""Greatest bubble of a tube's edge [rad], four times the phase by which it leaves the straight line (eq. 30); tubes that are bent
more are taken as the four that they are made of, with a linear phase on each."""
EXTREME = 8.0
"""A tube's phase may have an extreme in it, or near it, where it differs by less than so many bubbles over the tube; elsewhere the
field of tubes comes from their edges, and cancels."""
LEVELS = 2
"""Number of lattices, each finer than the one before, on which tubes start."""
WORTH = 0.1
"""Tubes are made finer only where they return more power than this fraction of what a target's tubes return in the mean."""
SIX_NODES = (0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)
"""Part, and corner of that part, at each node of a tube that is cut in four."""


@dataclass(frozen=True, slots=True)
class Tubes:
    """Ray tubes of some number B of bounces: triangles whose nodes are paths over B points of the targets' surfaces."""

    faces: np.ndarray
    """Facets that the paths meet, (N, B)."""
    coordinates: np.ndarray
    """Where the paths meet these facets (`PosedReflectors.coordinates`), (N, B, 3)."""
    sense: np.ndarray
    """1, or -1 where a path goes back to a plane that it is continued to, (N, B - 1)."""
    nodes: np.ndarray
    """Paths at the corners of each tube and at the middles of its edges 01, 12 and 20, (M, 6); -1 for middles where its phase is
    taken as linear."""
    amplitude: np.ndarray
    """Amplitude at each tube's corners, (M, 3)."""
    factor: np.ndarray
    """Factor that is common to a tube's corners, complex (M,)."""

    @property
    def curved(self) -> np.ndarray:
        """Which tubes have six nodes, bool (M,)."""
        return self.nodes[:, 3] >= 0

    @property
    def level(self) -> np.ndarray:
        """Greatest amplitude at the corners of each tube, with its factor, (M,)."""
        return np.asarray(np.abs(self.factor) * np.abs(self.amplitude).max(axis=1))

    @property
    def bytes_held(self) -> int:
        """Memory that the arrays take [bytes]."""
        return sum(getattr(self, name).nbytes for name in type(self).__slots__)

    def only(self, tubes: np.ndarray) -> Tubes:
        """Some of the tubes, in this order, in half the memory."""
        nodes = self.nodes[tubes]
        used = np.zeros(len(self.faces) + 1, bool)  # the last one stands for none
        used[nodes] = True
        used[-1] = False
        number = np.where(used, np.cumsum(used) - 1, -1).astype(np.int32)
        used = used[:-1]
        return Tubes(
            self.faces[used].astype(np.int32),
            self.coordinates[used].astype(np.float32),
            self.sense[used].astype(np.int8),
            number[nodes],
            self.amplitude[tubes].astype(np.float32),
            self.factor[tubes].astype(np.complex64),
        )


def traced_tubes(instant: Instant, lattice: Lattice, bounces: int) -> Tubes:
    """Tubes of that number of bounces that start on a lattice, which is made finer where it has to be."""
    of_levels: list[Tubes] = []
    for level in range(LEVELS):
        front = launched(instant, lattice)
        for _ in range(bounces - 1):
            front = reflected(instant, front)
        target = instant.reflectors.target[lattice.face[lattice.nodes[:, 0]]]
        tubes, finer = _received(instant, front, target, level)
        of_levels.append(tubes)
        lattice = lattice.finer(finer)
    return _all_of(of_levels)


def reflecting(instant: Instant, lattice: Lattice) -> np.ndarray:
    """Facets (N,) with points of the lattice whose reflected rays meet a target."""
    front = launched(instant, lattice)
    paths, _, hits = outgoing(instant, front)
    return np.unique(front.faces[paths[hits.face >= 0], 0])


def _received(instant: Instant, front: Front, target: np.ndarray, level: int) -> tuple[Tubes, np.ndarray]:
    """Tubes by physical optics on the last surface, where the receiver sees it, and which parts of the lattice's triangles are to
    be made finer; `target` (M,) is the number of the target on which each triangle lies."""
    towards = instant.receiver_m - front.place
    range_m = norms(towards)
    cosines = dot(towards, front.normal) / range_m - dot(front.incoming, front.normal)
    visible = instant.visible(instant.receiver_m, front, np.ones(len(front.place), bool))
    corners = (visible * cosines / (2 * range_m))[front.triangles]
    obliquity = np.where(
        front.lead < 0, corners.mean(axis=1), corners[np.arange(len(corners)), np.maximum(front.lead, 0)]
    )
    place = front.place[front.triangles]
    area = norms(vector_product(*two_edges(place)))
    section = np.abs(seen_area(place, front.incoming[front.triangles].mean(axis=1)))
    spread = area / np.sqrt(np.maximum(section, np.maximum(GRAZING * area, 1e-30)))
    amplitude = front.weight * obliquity * spread
    front = replace(front, length_m=front.length_m + range_m)
    return _sorted(front, amplitude, target, 2 * np.pi / instant.wavelength_m, level)


def _sorted(
    front: Front, amplitude: np.ndarray, target: np.ndarray, wavenumber: float, level: int
) -> tuple[Tubes, np.ndarray]:
    """Tubes, and parts to be made finer. The parts of a triangle go together where a quadratic describes their phase; elsewhere
    they are made finer, if the phase may have an extreme there or only some rays meet a surface, or each goes by itself."""
    count = len(target)
    table = np.full((count, 4), -1)
    alone = np.flatnonzero((front.lead < 0) & (amplitude != 0))
    table[front.number[alone] // 4, front.number[alone] % 4] = alone
    fours = table[(table >= 0).all(axis=1)]
    fours = fours[(front.reflection[fours] == front.reflection[fours[:, :1]]).all(axis=1)]
    phases = np.array([wavenumber * front.length_m[front.triangles[fours[:, part], at]] for part, at in SIX_NODES])
    bubble = np.abs([4 * phases[3 + i] - 2 * (phases[i] + phases[(i + 1) % 3]) for i in range(3)]).max(axis=0)
    smooth = bubble < LARGEST_BUBBLE_RAD
    extreme = np.ptp(phases, axis=0) < EXTREME * bubble
    done = np.zeros(count, bool)
    triangle = front.number[fours[:, 0]] // 4
    done[triangle[smooth | ~extreme]] = True
    fours = fours[smooth]
    single = amplitude != 0
    single[fours] = False
    finer = np.zeros(0, int)
    if level + 1 < LEVELS:
        # Of the rest, parts with any power are made finer where their triangle's power counts beside others' on the target.
        power = np.bincount(front.number // 4, amplitude**2, minlength=count)
        mean = np.bincount(target, power) / np.maximum(np.bincount(target, power > 0), 1)
        left = ~done & (power > WORTH * mean[target])
        finer = np.unique(front.number[single & left[front.number // 4]])
        single &= ~left[front.number // 4]
    # A part of the four has the mean of a linear amplitude at its centroid, over a quarter of the area.
    outer = 4 * amplitude[fours[:, :3]]
    nodes = [front.triangles[fours[:, part], corner] for part, corner in SIX_NODES]
    tubes = Tubes(
        front.faces,
        front.coordinates,
        front.sense,
        np.concatenate(
            [np.stack(nodes, axis=1), np.pad(front.triangles[single], ((0, 0), (0, 3)), constant_values=-1)]
        ),
        np.concatenate(
            [2 * outer - outer.sum(axis=1, keepdims=True) / 3, np.repeat(amplitude[single, None], 3, axis=1)]
        ),
        np.concatenate([front.reflection[fours[:, 3]], front.reflection[single]]),
    )
    return tubes, finer


def _all_of(lots: list[Tubes]) -> Tubes:
    """Several lots of tubes as one, with their paths numbered through."""
    first = np.cumsum([0, *(len(tubes.faces) for tubes in lots)])
    columns = {name: np.concatenate([getattr(tubes, name) for tubes in lots]) for name in Tubes.__slots__}
    columns["nodes"] = np.concatenate(
        [np.where(tubes.nodes < 0, -1, tubes.nodes + start) for tubes, start in zip(lots, first[:-1], strict=True)]
    )
    return Tubes(**columns)
