"""Groups of echoes merged level by level, each level at twice the rate of the one before (docs/physics.md, eq. 21).

A group returns its members' sum as a factor beside its own delay, the mean of theirs, at a few nodes of the sweep. The factor
varies slowly, so it is sampled at a rate far below the chirps'; that of a larger group varies faster and is sampled faster. What
a group may hold follows from how fast its members' phases part and how far their delays lie apart.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, one_thread_at_a_time
from t2d_rt.radar.array_delays import ArrayDelays
from t2d_rt.radar.buckets import Buckets
from t2d_rt.radar.coefficients import Lanes
from t2d_rt.radar.groups import Level
from t2d_rt.radar.interpolants import hermite
from t2d_rt.radar.leaves import Factors, Leaves, smallest
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


def at_antennas(
    tree: list[Level], leaves: Leaves, send: ArrayDelays, receive: ArrayDelays
) -> tuple[list[Level], Leaves]:
    """Levels and leaves of all pairs of antennas: groups of the first transmitter with the first receiver, with the second, ..."""
    many, below = [], 0
    pairs = list(itertools.product(send.groups, receive.groups))
    for number, level in enumerate(tree):
        delay, slope = (
            np.concatenate([own + out[number][k] + back[number][k] for out, back in pairs], axis=1)
            for k, own in enumerate((level.delay, level.delay_slope))
        )
        # The echoes below the first level are the same for all pairs.
        group = level.group + (len(level) * np.arange(len(pairs)) if below else np.zeros(1, int))[:, None]
        many.append(replace(level, group=group.ravel(), delay=delay, delay_slope=slope))
        below = len(level)
    return many, replace(leaves, ends=(send, receive))


def factors(window: Window, tree: list[Level], leaves: Leaves, sweep: Sweep, backend: Backend) -> Factors:
    """Factors of the groups of the tree's last level."""
    out = smallest(window, tree[0], leaves, sweep, backend)
    for below, level in pairwise(tree):
        out = _merged(out, below, level, sweep, window.step_s, backend)
    return out


@one_thread_at_a_time
def _merged(inner: Factors, below: Level, level: Level, sweep: Sweep, step_s: float, backend: Backend) -> Factors:
    """The next level's factors, at twice the rate."""
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
        # The quintic through six samples; what it misses of a phasor of step w, 5/1024 w^6, is an image at the rate below.
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


def _places(inner: Factors, below: Level) -> tuple[np.ndarray, np.ndarray]:
    """Interval, of those whose delays are known, in which each of the samples' places lies that have two before and three after
    them, and where in it [frames]; those after the last interval go on with its cubics."""
    place = inner.first + 2 + np.arange(inner.samples - 5)
    interval = np.minimum(place // below.rate + 1, len(below.delay) - 2)
    return interval, place / below.rate - (interval - 1)


@one_thread_at_a_time
def at_instants(
    inner: Factors,
    first: int,
    level: Level,
    buckets: Buckets,
    phase: tuple[Any, Any],
    instants: Instants,
    places: np.ndarray,
    backend: Backend,
) -> np.ndarray:
    """Fields of buckets at `places` of the sweep, pairs +x, -x, from groups' factors; complex64, part by part, (instant,
    bucket, place) of each, flat.

    The factors of `level`'s groups are those of `inner` from `first` on, `phase` holds the tables of `phases` for the groups.
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
        own = (skipped + group) * samples + of_lane
        frames = [read(inner.values, own + k, level.nodes, Packet) for k in range(4)]
        values = [sum(w * v for w, v in zip(of_four, parts, strict=True)) for parts in zip(*frames, strict=True)]
        travelled, rate = moved(cubic, u)
        eps = rate * lanes.eps_per_rate
        sin, cos = sin_cos(cubic[0] + travelled + eps * (0.25 / math.pi))
        theta = theta + travelled * lanes.per_cycle + rate * lanes.per_rate
        return rotated(spread(times_phasor(values, sin, cos)), theta, x, bend=eps)

    sums = summed(backend.Float32, (lanes.begin, lanes.end), lanes.step, 2 * count, values_of)
    return lanes.scattered(sums, backend).ravel()


def _interpolation(inner: Factors, level: Level, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The second of the four samples of a factor between which each instant lies, (instant,), and the weights of the four, those of
    the cubic through samples at -1, 0, 1, 2, (instant, 4)."""
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


def _relative(below: Level, level: Level, sweep: Sweep) -> np.ndarray:
    """Phase of each group against its parent's [cycles], cubics in the frame step, float32 (n + 2, K, 4)."""
    above, above_slope = level.delay[:, level.group], level.delay_slope[:, level.group]
    cycles = (sweep.mid_hz - 0.5 * sweep.slope * (below.delay + above)) * (below.delay - above)
    own_rate = (sweep.mid_hz - sweep.slope * below.delay) * below.delay_slope
    rate = own_rate - (sweep.mid_hz - sweep.slope * above) * above_slope
    return np.stack(hermite(cycles[:-1], cycles[1:], rate[:-1], rate[1:]), axis=-1).astype(np.float32)
