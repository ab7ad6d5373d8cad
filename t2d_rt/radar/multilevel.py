"""Merges groups of echoes level by level; each level has twice the sample rate of the one before (docs/physics.md, eq. 21).

The sum of a group's members is a slowly varying complex factor, times the phasor of the group's own delay, which is the mean of the
members' delays. The factor is stored at a few nodes of the sweep and sampled at a rate far below that of the chirps; the factor of
a larger group varies faster and is sampled faster. How fast the phases of members diverge, and how far their delays lie apart,
limits what a group may hold.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, one_thread_at_a_time
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.radar.array_delays import ArrayDelays, extra_length
from t2d_rt.radar.coefficients import AmplitudeFrames, Lanes, phases
from t2d_rt.radar.delay_bins import BinMembers, Buckets
from t2d_rt.radar.groups import GroupLevel
from t2d_rt.radar.interpolants import hermite
from t2d_rt.radar.sweep import (
    Instants,
    Sweep,
    cubic_at,
    moved,
    nodes,
    read,
    rotated,
    sin_cos,
    spread_to,
    summed,
    times_phasor,
)
from t2d_rt.radar.windows import Window


@dataclass(frozen=True, slots=True)
class Factors:
    """Sampled complex factors of the groups of one level."""

    values: Any
    """Flat float32 (group, sample, node, 2) on the device; the last axis holds real and imaginary parts."""
    samples: int
    first: int
    """Time of the first sample in samples after the window's start; negative if before."""


@dataclass(frozen=True, slots=True)
class Leaves:
    """The echoes from which the groups of the first level are summed."""

    members: BinMembers
    fields: AmplitudeFrames
    """Amplitudes of the echoes at the frames."""
    phase: tuple[Any, Any]
    """The tables of `phases`, relative to the groups."""
    ends: tuple[ArrayDelays, ...] = ()
    """Transmitters and receivers for which groups are computed separately, for each pair of antennas; () for the arrays' centres
    alone."""


def leaves(window: Window, level: GroupLevel, sweep: Sweep, backend: Backend) -> Leaves:
    """The echoes of the groups of the first level, with their phases relative to these."""
    intervals, count = window.delay.shape[0] - 1, window.delay.shape[1]
    interval, echo = window.lit
    members = BinMembers.of(interval, level.group[echo], echo, shape=(intervals, len(level)), per=1, size=count)
    phase = phases(window.delay, window.delay_slope, sweep, level, 0.0, backend)
    return Leaves(members, AmplitudeFrames.of(window, sweep, backend), phase)


def at_antennas(
    tree: list[GroupLevel], leaves: Leaves, send: ArrayDelays, receive: ArrayDelays
) -> tuple[list[GroupLevel], Leaves]:
    """Levels and leaves for all pairs of antennas. Groups are ordered by pair: first transmitter with first receiver, first with
    second, and so on."""
    of_pairs, below = [], 0
    pairs = list(itertools.product(send.groups, receive.groups))
    for number, level in enumerate(tree):
        delay, slope = (
            np.concatenate([base + out[number][k] + back[number][k] for out, back in pairs], axis=1)
            for k, base in enumerate((level.delay, level.delay_slope))
        )
        # The echoes below the first level are the same for all pairs of antennas.
        group = level.group + (len(level) * np.arange(len(pairs)) if below else np.zeros(1, int))[:, None]
        of_pairs.append(replace(level, group=group.ravel(), delay=delay, delay_slope=slope))
        below = len(level)
    return of_pairs, replace(leaves, ends=(send, receive))


def factors(window: Window, tree: list[GroupLevel], leaves: Leaves, sweep: Sweep, backend: Backend) -> Factors:
    """Factors of the groups of the last level, computed from the first level upwards."""
    out = _smallest(window, tree[0], leaves, sweep, backend)
    for below, level in pairwise(tree):
        out = _merged(out, below, level, sweep, window.step_s, backend)
    return out


@one_thread_at_a_time
def _smallest(window: Window, level: GroupLevel, leaves: Leaves, sweep: Sweep, backend: Backend) -> Factors:
    """Factors of the groups of the first level, summed from the echoes; ordered by pair of antennas.

    One kernel with a lane for each group and frame interval loops over the group's echoes; it reads each echo once for all instants
    and pairs. Every level needs two samples before and three samples after those of the next: these are one interval before the
    window and a little more than one after it, where the last lanes extrapolate the cubics of the last interval.
    """
    import drjit as dr

    Float32, UInt32, Packet = backend.Float32, backend.UInt32, backend.arrays.Array4f
    members, groups, intervals = leaves.members, leaves.members.bins, len(window.delay) - 1
    lane = dr.arange(UInt32, groups * (intervals + 1))
    per_group = dr.opaque(UInt32, intervals + 1)
    group = lane // per_group
    place = lane - group * per_group
    interval = dr.minimum(place, dr.opaque(UInt32, intervals - 1))
    beyond = Float32(place - interval)
    row = interval * dr.opaque(UInt32, groups) + group
    starts = UInt32(members.starts.astype(np.uint32))
    echoes = UInt32(members.members.astype(np.uint32))
    width = dr.opaque(UInt32, intervals)
    per_cycle, per_rate, _ = (dr.opaque(Float32, value) for value in sweep.per_cycle(window.step_s))
    x = [float(v) for v in nodes(level.nodes)[::2]]
    pairs = math.prod(len(end) for end in leaves.ends)
    ends = [_ExtraPhases(end, group, interval, sweep, window, backend) for end in leaves.ends if end.table is not None]

    def values_of(i: Any) -> list[Any]:
        echo = dr.gather(UInt32, echoes, i)
        member = echo * width + interval
        parts = leaves.fields.cubics(echo, interval)
        cycles, theta = dr.gather(Packet, leaves.phase[0], member), dr.gather(Float32, leaves.phase[1], member)
        of_pairs = [(cycles, theta)] * pairs
        if ends:
            out, back = (end.cycles(echo) for end in ends)
            extras = [Packet([a + b for a, b in zip(*pair, strict=True)]) for pair in itertools.product(out, back)]
            of_pairs = [(cycles + extra, theta + extra[0] * per_cycle) for extra in extras]
        out = []
        for k in range(level.rate):
            u = beyond + k / level.rate
            at_nodes = _at_nodes(parts, u, level.nodes)
            for cubic, start in of_pairs:
                travelled, rate = moved(cubic, u)
                sin, cos = sin_cos(cubic[0] + travelled)
                theta = start + travelled * per_cycle + rate * per_rate
                out += rotated(times_phasor(at_nodes, sin, cos), theta, x, small=True)
        return out

    numbers = 2 * level.nodes
    ends_of_row = dr.gather(UInt32, starts, row), dr.gather(UInt32, starts, row + 1)
    sums = summed(Float32, ends_of_row, 1, level.rate * pairs * numbers, values_of)
    by_pair = np.reshape(np.arange(len(sums)), (level.rate, pairs, numbers)).swapaxes(0, 1).reshape(pairs, -1)
    values: Any = [dr.ravel(backend.arrays.ArrayXf([sums[k] for k in of_pair])) for of_pair in by_pair.tolist()]
    dr.eval(values)  # all at once, for evaluating the pairs one by one would run the loop again for each
    values = dr.concat(values) if pairs > 1 else values[0]
    dr.eval(values)
    return Factors(values, (intervals + 1) * level.rate, -level.rate)


def _at_nodes(parts: list[Any], u: Any, count: int) -> list[Any]:
    """Amplitude of an echo at u and at nodes of the sweep, from cubics in the frame step: real and imaginary parts in turn."""
    values = [cubic_at(part, u) for part in parts]
    slopes = values[2:] or [0.0, 0.0]
    return [
        value + node * slope for node in nodes(count).tolist() for value, slope in zip(values[:2], slopes, strict=True)
    ]


class _ExtraPhases:
    """Phases that an array's antennas add to the echoes of the leaves, relative to those that they add to the echoes' groups."""

    def __init__(
        self, delays: ArrayDelays, group: Any, interval: Any, sweep: Sweep, window: Window, backend: Backend
    ) -> None:
        import drjit as dr

        Float32, self.packet = backend.Float32, backend.arrays.Array4f
        frames = len(window.delay)
        self.table: Any = delays.table
        self.interval = interval
        self.frames = dr.opaque(backend.UInt32, frames)
        self.centre, *self.offsets = (
            [dr.opaque(Float32, float(x)) for x in place] for place in (delays.end.centre_m, *delays.end.offsets_m)
        )
        # The residual video phase -S tau e of the additional delay e is taken at the window's mean delay tau: within a group it
        # hardly differs.
        mid_hz = sweep.mid_hz - sweep.slope * float(window.delay.mean())
        self.per_metre = dr.opaque(Float32, mid_hz / SPEED_OF_LIGHT)
        self.groups = []
        for delay, slope in (levels[0] for levels in delays.groups):
            of_groups = Float32(
                (np.stack([delay, slope], axis=-1).swapaxes(0, 1) * SPEED_OF_LIGHT).astype(np.float32).ravel()
            )
            place = (group * self.frames + interval) * 2
            self.groups.append([dr.gather(Float32, of_groups, place + k) for k in range(4)])

    def cycles(self, echo: Any) -> list[list[Any]]:
        """Cubics of the additional phase [cycles] of an echo, one for each antenna."""
        import drjit as dr

        place = echo * self.frames + self.interval
        points, steps = ([dr.gather(self.packet, values, place + k) for k in (0, 1)] for values in self.table)
        lines_of_sight = [[point[axis] - self.centre[axis] for axis in range(3)] for point in points]
        cubics = []
        for offset, of_group in zip(self.offsets, self.groups, strict=True):
            (extra, slope), (later, slope_later) = (
                extra_length(line_of_sight, step, offset, dr.sqrt)
                for line_of_sight, step in zip(lines_of_sight, steps, strict=True)
            )
            relative = extra - of_group[0], later - of_group[2], slope - of_group[1], slope_later - of_group[3]
            cubics.append(list(hermite(*(value * self.per_metre for value in relative))))
        return cubics


@one_thread_at_a_time
def _merged(
    inner: Factors, below: GroupLevel, level: GroupLevel, sweep: Sweep, step_s: float, backend: Backend
) -> Factors:
    """Factors of the groups of `level`, from the factors `inner` of the level `below`, with twice as many samples per frame
    interval.

    The factor of each child is multiplied by the phasor of its phase relative to the parent and added up, at the samples and, by a
    quintic, half way between them.
    """
    import drjit as dr

    Float32, UInt32, Packet = backend.Float32, backend.UInt32, backend.arrays.Array4f
    delta = Float32(_relative(below, level, sweep).ravel())
    children = UInt32(np.argsort(level.group, kind="stable").astype(np.uint32))
    bounds = UInt32(np.append(0, np.cumsum(np.bincount(level.group))).astype(np.uint32))
    steps = inner.samples - 5
    places = _places(inner, below)
    interval, instant = UInt32(places[0].astype(np.uint32)), Float32(places[1].astype(np.float32))
    lane = dr.arange(UInt32, len(level) * steps)
    width = dr.opaque(UInt32, steps)
    group = lane // width
    index = lane - group * width
    row = dr.gather(UInt32, interval, index) * dr.opaque(UInt32, len(below))
    start = dr.gather(Float32, instant, index)
    u = start, start + dr.opaque(Float32, 0.5 / below.rate)
    samples = dr.opaque(UInt32, inner.samples)
    per_cycle, per_rate, _ = (dr.opaque(Float32, value) for value in sweep.per_cycle(step_s))
    spread = spread_to(below.nodes, nodes(level.nodes))
    x = [float(v) for v in nodes(level.nodes)[::2]]

    def values_of(i: Any) -> list[Any]:
        child = dr.gather(UInt32, children, i)
        cubic = dr.gather(Packet, delta, row + child)
        frames = [read(inner.values, child * samples + index + k, below.nodes, Packet) for k in range(6)]
        # Quintic through six samples. Its error for a phasor of step w is 5/1024 w^6, an image at the lower rate.
        middle = [
            (150 * (c + d) - 25 * (b + e) + 3 * (a + f)) * (1 / 256) for a, b, c, d, e, f in zip(*frames, strict=True)
        ]
        out = []
        for time, values in zip(u, (frames[2], middle), strict=True):
            cycles, (_, rate) = cubic_at(cubic, time), moved(cubic, time)
            sin, cos = sin_cos(cycles)
            out += rotated(spread(times_phasor(values, sin, cos)), cycles * per_cycle + rate * per_rate, x)
        return out

    ends = dr.gather(UInt32, bounds, group), dr.gather(UInt32, bounds, group + 1)
    sums = summed(Float32, ends, 1, 4 * level.nodes, values_of)
    out = dr.ravel(backend.arrays.ArrayXf(sums))
    dr.eval(out)
    return Factors(out, 2 * steps, 2 * (inner.first + 2))


def _places(inner: Factors, below: GroupLevel) -> tuple[np.ndarray, np.ndarray]:
    """For each sample that has two samples before and three after it: the index of the frame interval, among those with known
    delays, whose cubics give its phase, and its position in that interval [frames]. Samples after the last interval extrapolate its
    cubics."""
    place = inner.first + 2 + np.arange(inner.samples - 5)
    interval = np.minimum(place // below.rate + 1, len(below.delay) - 2)
    return interval, place / below.rate - (interval - 1)


@one_thread_at_a_time
def at_instants(
    inner: Factors,
    first: int,
    level: GroupLevel,
    buckets: Buckets,
    phase: tuple[Any, Any],
    instants: Instants,
    places: np.ndarray,
    backend: Backend,
) -> np.ndarray:
    """Sums of the groups in every bucket at `places` of the sweep, pairs +x, -x; flat complex64, part after part, each (instant,
    bucket, place).

    The factors of the groups of `level` are those of `inner` from index `first` on; `phase` holds the tables of `phases` for the
    groups.
    """
    import drjit as dr

    Packet, count, x = backend.arrays.Array4f, len(places), places[::2].tolist()
    lanes = Lanes.of(buckets, phase, instants, backend, most_parts=1)
    sample, weights = _interpolation(inner, level, instants.position)
    of_lane = dr.gather(backend.UInt32, backend.lanes(sample - 1), lanes.instant)
    of_four = dr.gather(Packet, backend.lanes(weights, backend.Float32), lanes.instant)
    samples, skipped = dr.opaque(backend.UInt32, inner.samples), dr.opaque(backend.UInt32, first)
    u, spread = lanes.u, spread_to(level.nodes, places)

    def values_of(i: Any) -> list[Any]:
        group, cubic, theta = lanes.read(i)
        row = (skipped + group) * samples + of_lane
        frames = [read(inner.values, row + k, level.nodes, Packet) for k in range(4)]
        values = [sum(w * v for w, v in zip(of_four, parts, strict=True)) for parts in zip(*frames, strict=True)]
        travelled, rate = moved(cubic, u)
        eps = rate * lanes.eps_per_rate
        sin, cos = sin_cos(cubic[0] + travelled + eps * (0.25 / math.pi))
        theta = theta + travelled * lanes.per_cycle + rate * lanes.per_rate
        return rotated(spread(times_phasor(values, sin, cos)), theta, x, bend=eps)

    sums = summed(backend.Float32, (lanes.begin, lanes.end), lanes.step, 2 * count, values_of)
    return lanes.scattered(sums, backend).ravel()


def _interpolation(inner: Factors, level: GroupLevel, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each instant, the index of the second of the four samples of a factor between which it lies, (instant,), and the weights
    of the four samples, (instant, 4): those of the cubic through samples at -1, 0, 1, 2."""
    place = position * level.rate - inner.first
    sample = np.clip(np.floor(place).astype(np.int64), 1, inner.samples - 3)
    p = place - sample
    weights = [
        -p * (p - 1) * (p - 2) / 6,
        (p + 1) * (p - 1) * (p - 2) / 2,
        -(p + 1) * p * (p - 2) / 2,
        (p + 1) * p * (p - 1) / 6,
    ]
    return sample, np.stack(weights, axis=1)


def _relative(below: GroupLevel, level: GroupLevel, sweep: Sweep) -> np.ndarray:
    """Phase of each group relative to that of its parent [cycles], as cubics in the frame step, float32 (n + 2, K, 4)."""
    above, above_slope = level.delay[:, level.group], level.delay_slope[:, level.group]
    cycles = (sweep.mid_hz - 0.5 * sweep.slope * (below.delay + above)) * (below.delay - above)
    own_rate = (sweep.mid_hz - sweep.slope * below.delay) * below.delay_slope
    rate = own_rate - (sweep.mid_hz - sweep.slope * above) * above_slope
    return np.stack(hermite(cycles[:-1], cycles[1:], rate[:-1], rate[1:]), axis=-1).astype(np.float32)
