"""Groups of echoes merged level by level, each level at twice the rate of the one before (docs/physics.md, eq. 21).

A group returns its members' sum as a factor beside its own delay, the mean of theirs, at a few nodes of the sweep. The factor
turns slowly, so it is sampled at a rate far below the chirps'; a larger group turns faster and is sampled faster. What a group may
hold follows from how fast its members' phases part and how far their delays lie apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.radar.interpolants import hermite
from t2d_rt.radar.moments import Members, References, amplitudes, phases
from t2d_rt.radar.phasors import read, rotated, sin_cos, spread_to, turned
from t2d_rt.radar.sweep import Sweep, nodes, nodes_for
from t2d_rt.radar.windows import Window

FIRST_RATES = ((-50.0, 4), (-60.0, 8))
"""Samples of the smallest groups' factors per frame interval, by tolerance [dB]: the amplitudes' interpolants have kinks at the
frames, which leave -54 and -62 dB. Beyond these tolerances echoes are not merged."""
FIRST_BINS = 0.35
"""Range bins that the smallest groups' echoes span at most."""
MOST_BINS = 3.0
"""The same of the largest groups."""
BUCKET_BINS = 3.0
"""Width of a bucket of groups."""
WIDE = 0.25
"""Share of what the smallest groups may span from which the outermost antennas of an array count too."""
PROBE_EVERY = 4
"""Frames between looks at how echoes part."""


@dataclass(frozen=True, slots=True)
class Level:
    """Groups of one level, of echoes or of the groups of the level below."""

    rate: int
    """Samples per frame interval."""
    nodes: int
    """Nodes of the sweep."""
    bins: float
    """Range bins that a group's echoes span at most."""
    group: np.ndarray
    """Group of each echo, or of each group below."""
    mean: Any
    """Sparse: values of these times this are the means of the groups; of one pair of antennas, where there are several."""
    delay: np.ndarray
    """Mean of the members' [s], (n + 3, K)."""
    delay_slope: np.ndarray
    """[s per frame], likewise."""

    def __len__(self) -> int:
        return self.delay.shape[1]


def levels(
    window: Window, sweep: Sweep, rate: float, tolerance: float, extras: Sequence[tuple[np.ndarray, np.ndarray]] = ()
) -> list[Level]:
    """Levels worth having for moments that come `rate` times per frame interval, none where summing echo by echo is less work.

    `extras`: what is added to the delays [s] and their slopes, each (n + 3, L), at the outermost antennas of an array.
    """
    rates = [first for limit_db, first in FIRST_RATES if tolerance >= 10 ** (limit_db / 20) * (1 - 1e-9)]
    if not rates:
        return []
    allowed = _turns_per_step(tolerance)
    turns, bins = _features(window, sweep, extras, (WIDE * allowed * rates[0], WIDE * FIRST_BINS))
    found: list[Level] = []
    samples, width = rates[0], FIRST_BINS
    low = high = np.concatenate([turns, bins], axis=1)
    here, delay, slope = len(low), window.delay, window.delay_slope
    work, spent = [here * rate * WORK_ECHO], 0.0
    while samples <= rate:
        points = nodes_for(0.8 * math.pi * width, tolerance)
        spent += here * samples * (WORK_NODE * points if found else WORK_ECHO)
        if spent >= min(work):
            break
        limits = np.repeat(np.array([allowed * samples, width], np.float32), [turns.shape[1], bins.shape[1]])
        scaled = low / limits
        group = _grouped(scaled, scaled if low is high else high / limits)
        mean = _mean(group)
        delay, slope = delay @ mean, slope @ mean
        found.append(Level(samples, points, width, group, mean, delay, slope))
        low, high = _hulls(group, low, high)
        here = len(low)
        work.append(spent + here * rate * WORK_NODE * bucket_nodes(width, tolerance))
        samples, width = 2 * samples, min(2 * width, MOST_BINS)
    return found[: int(np.argmin(work))]


# Measured costs of one echo and one node in a sum, relative to one another.
WORK_ECHO, WORK_NODE = 1.0, 0.25


def bucket_nodes(width: float, tolerance: float) -> int:
    """Nodes of a bucket that holds groups of `width` bins."""
    return nodes_for(math.pi * (BUCKET_BINS / 2 + 0.8 * width), tolerance)


def _turns_per_step(tolerance: float) -> float:
    """Greatest difference of the phase steps within a group [turns per sample].

    A cubic at the midpoint of four samples misses a phasor of step w by (3/128) w^4, of w uniform in -pi p..pi p by (pi p)^4/3
    of that in the mean square. That is the last step, at the chirps; the levels' midpoints are those of quintics and leave less.
    """
    return (tolerance * (128 / 3) * 3) ** 0.25 / math.pi


def _features(
    window: Window, sweep: Sweep, extras: Sequence[tuple[np.ndarray, np.ndarray]], wide: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """What tells echoes apart, at a few moments of the window: phase rates [turns per frame] and delays that the beat shows [bins],
    float32 (L, probes); the same at outermost antennas for which either differs by more than `wide` from echo to echo."""
    last = len(window.delay) - 1
    moments = np.unique(np.linspace(0, last, 2 + last // PROBE_EVERY).astype(int))
    rates = window.delay_slope[moments].T
    # Delays at all of these moments too: limbs that pass each other at some are a metre apart at others.
    shown = window.delay[moments].T + rates * (sweep.coupling_s / window.step_s)
    # Relative to the first echo: float32 would round absolute delays.
    turns, bins = (rates - rates[:1]) * sweep.mid_hz, (shown - shown[:1]) / sweep.bin_s
    found = [(turns, bins)]
    for more, slope in extras:
        more_turns, more_bins = slope[moments].T * sweep.mid_hz, more[moments].T / sweep.bin_s
        if np.ptp(more_turns, axis=0).max() > wide[0] or np.ptp(more_bins, axis=0).max() > wide[1]:
            found.append((turns + more_turns, bins + more_bins))
    turns, bins = (np.concatenate(each, axis=1).astype(np.float32) for each in zip(*found, strict=True))
    return turns, bins


def _grouped(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Groups items, (N,) numbers 0, 1, ..., by halving along the widest feature until none spans more than 1 in a group.

    low, high (N, C): what each item spans itself.
    """
    order = np.arange(len(low))
    starts = np.array([0])
    group = np.empty(len(low), np.int64)
    count = 0
    while len(order):
        bottom, top = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
        sizes = np.diff(np.append(starts, len(order)))
        widest = np.argmax(top - bottom, axis=1)
        part = np.arange(len(starts))
        small = ((top - bottom)[part, widest] <= 1) | (sizes == 1)
        part = np.repeat(part, sizes)
        number = np.cumsum(small) - 1 + count
        done = small[part]
        group[order[done]] = number[part[done]]
        count += int(small.sum())
        low, high, order, part = *_taken(~done, low, high), order[~done], part[~done]
        middle = (top + bottom)[np.arange(len(starts)), widest]
        row = np.arange(len(order))
        upper = low[row, widest[part]] + high[row, widest[part]] > middle[part]
        key = 2 * part + upper
        by_key = np.argsort(key, kind="stable")
        low, high, order, key = *_taken(by_key, low, high), order[by_key], key[by_key]
        starts = np.flatnonzero(np.diff(key, prepend=-1))
    return group


def _taken(rows: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of both; echoes span nothing themselves, so that both are one."""
    taken = low[rows]
    return taken, taken if low is high else high[rows]


def _mean(group: np.ndarray) -> Any:
    """Sparse (N, K): values of items times this are the means of their groups."""
    from scipy.sparse import csr_array

    share = 1 / np.bincount(group)
    return csr_array((share[group], group, np.arange(len(group) + 1)), shape=(len(group), len(share)))


def _hulls(group: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What each group spans."""
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    return np.minimum.reduceat(low[order], starts), np.maximum.reduceat(high[order], starts)


@dataclass(frozen=True, slots=True)
class Factors:
    """Factors of a level's groups, sampled."""

    values: Any
    """Flat float32 (group, sample, node, 2) on the device."""
    samples: int
    first: int
    """Place of the first sample, counted from the window's start."""


@dataclass(frozen=True, slots=True)
class Leaves:
    """What the first level's groups gather."""

    members: Members
    fields: list[Any]
    """Tables of `amplitudes`."""
    phase: tuple[Any, Any]
    """Tables of `phases`, relative to the groups."""
    send: Any = None
    """By how much longer the way from a transmitter is than from its array's centre: phase as in `phases`, relative to the groups."""
    receive: Sequence[Any] = ()
    """The same of receivers, each a pair with the transmitter."""


def leaves(window: Window, level: Level, sweep: Sweep, backend: Backend) -> Leaves:
    """The echoes of the first level's groups."""
    intervals, count = window.delay.shape[0] - 1, window.delay.shape[1]
    interval, echo = window.lit
    members = Members.of(
        interval,
        level.group[echo],
        echo,
        shape=(intervals, len(level)),
        per=1,
        size=count,
    )
    references = References(level.group, level.delay, level.delay_slope)
    phase = phases(window.delay, window.delay_slope, sweep, references, 0.0, backend)
    return Leaves(members, amplitudes(window, sweep, backend), phase)


@dataclass(frozen=True, slots=True)
class Extra:
    """By how much longer an antenna's delays are than its array's: the groups' means, and their echoes' phases beside these."""

    means: list[tuple[np.ndarray, np.ndarray]]
    """Delay [s] and its slope [s per frame] of each level's groups, (n + 3, K)."""
    phase: Any
    """Flat cubics of `phases`."""

    @classmethod
    def of(
        cls, window: Window, tree: list[Level], delay: np.ndarray, slope: np.ndarray, sweep: Sweep, backend: Backend
    ) -> Extra:
        """From the echoes' delays [s] and slopes [s per frame], float32 (n + 3, L)."""
        means = [(delay, slope)]
        for level in tree:
            means.append((means[-1][0] @ level.mean, means[-1][1] @ level.mean))
        means = means[1:]

        def effective(
            more: np.ndarray, rate: np.ndarray, own: np.ndarray, own_rate: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            # psi(tau + e) - psi(tau) = 2 pi (f_m - S tau) e but for e^2, which `phases` has.
            share = sweep.slope / sweep.mid_hz
            turned = more - share * own * more, rate - share * (own * rate + own_rate * more)
            return turned[0].astype(np.float32), turned[1].astype(np.float32)

        references = References(tree[0].group, *effective(*means[0], tree[0].delay, tree[0].delay_slope))
        here = effective(delay, slope, window.delay, window.delay_slope)
        return cls(means, phases(*here, sweep, references, 0.0, backend)[0])


def at_antennas(
    tree: list[Level], leaves: Leaves, send: Extra, receive: Sequence[Extra]
) -> tuple[list[Level], Leaves]:
    """Levels and leaves of a transmitter with several receivers from those of their arrays: the groups of the first pair, those of
    the next, ..."""
    many, below = [], 0
    for number, level in enumerate(tree):
        delay, slope = (
            np.concatenate([own + send.means[number][k] + back.means[number][k] for back in receive], axis=1)
            for k, own in enumerate((level.delay, level.delay_slope))
        )
        # The echoes below the first level are the same for all pairs.
        group = level.group + (len(level) * np.arange(len(receive)) if below else np.zeros(1, int))[:, None]
        many.append(replace(level, group=group.ravel(), delay=delay, delay_slope=slope))
        below = len(level)
    # The product of the two extra delays in the residual video phase, 3e-6 of a turn across 0.5 m, is left out.
    return many, replace(leaves, send=send.phase, receive=[each.phase for each in receive])


def factors(window: Window, tree: list[Level], leaves: Leaves, sweep: Sweep, backend: Backend) -> Factors:
    """Factors of the groups of the tree's last level."""
    out = _smallest(window, tree[0], leaves, sweep, backend)
    for below, level in pairwise(tree):
        out = _merged(out, below, level, sweep, window.step_s, backend)
    return out


def _smallest(window: Window, level: Level, leaves: Leaves, sweep: Sweep, backend: Backend) -> Factors:
    """Factors of the first level's groups, those of one pair of antennas after those of another, straight from the echoes.

    One kernel: its lanes are (group, frame interval), its loop runs over the group's echoes, of which a lane reads each once for
    all moments and all pairs. Every level takes two samples before and three after: an interval before the window, and a little
    more than one after it, where the last lanes go on with the last interval's cubics.
    """
    import drjit as dr

    Float32, UInt32, Packet = backend.Float32, backend.UInt32, backend.arrays.Array4f
    members, groups, intervals = leaves.members, leaves.members.collectors, len(window.delay) - 1
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
    per_turn, per_rate, _ = (dr.opaque(Float32, value) for value in sweep.per_turn(window.step_s))
    x = [float(v) for v in nodes(level.nodes)[::2]]
    pairs = max(1, len(leaves.receive))

    def add(i: Any, sums: list[Any]) -> tuple[Any, list[Any]]:
        member = dr.gather(UInt32, echoes, i) * width + interval
        parts = [dr.gather(Packet, values, member) for values in leaves.fields]
        turns, theta = dr.gather(Packet, leaves.phase[0], member), dr.gather(Float32, leaves.phase[1], member)
        of_pairs = [(turns, theta)]
        if leaves.send is not None:
            sent = dr.gather(Packet, leaves.send, member)
            more = [sent + dr.gather(Packet, back, member) for back in leaves.receive]
            of_pairs = [(turns + each, theta + each[0] * per_turn) for each in more]
        out = []
        for k in range(level.rate):
            u = beyond + k / level.rate
            values = [c[0] + u * (c[1] + u * (c[2] + u * c[3])) for c in parts]
            ends = []
            for node in x:
                for sign in (node, -node):
                    ends += [a + sign * b for a, b in zip(values[:2], values[2:], strict=True)] if values[2:] else values
            for cubic, start in of_pairs:
                travelled = u * (cubic[1] + u * (cubic[2] + u * cubic[3]))
                rate = cubic[1] + u * (2 * cubic[2] + u * (3 * cubic[3]))
                phase = cubic[0] + travelled
                sin, cos = sin_cos(phase)
                out += rotated(turned(ends, sin, cos), start + travelled * per_turn + rate * per_rate, x, small=True)
        return i + 1, [total + value for total, value in zip(sums, out, strict=True)]

    numbers = 2 * level.nodes
    zeros = [dr.zeros(Float32, dr.width(lane)) for _ in range(level.rate * pairs * numbers)]
    _, sums = dr.while_loop(
        state=(dr.gather(UInt32, starts, row), zeros),
        cond=lambda i, sums: i < dr.gather(UInt32, starts, row + 1),
        body=add,
        labels=("i", "sums"),
        mode="symbolic",
    )
    dr.eval(sums)  # all at once; else each pair's would run the loop again
    by_pair = np.reshape(np.arange(len(sums)), (level.rate, pairs, numbers)).swapaxes(0, 1).reshape(pairs, -1)
    of_pairs = [dr.ravel(backend.arrays.ArrayXf([sums[k] for k in each])) for each in by_pair.tolist()]
    values = dr.concat(of_pairs) if pairs > 1 else of_pairs[0]
    dr.eval(values)
    return Factors(values, (intervals + 1) * level.rate, -level.rate)


def _merged(inner: Factors, below: Level, level: Level, sweep: Sweep, step_s: float, backend: Backend) -> Factors:
    """The next level's factors, at twice the rate."""
    import drjit as dr

    Float32, UInt32, Packet = backend.Float32, backend.UInt32, backend.arrays.Array4f
    delta = Float32(_relative(below, level, sweep).ravel())
    children = UInt32(np.argsort(level.group, kind="stable").astype(np.uint32))
    bounds = UInt32(np.append(0, np.cumsum(np.bincount(level.group))).astype(np.uint32))
    steps = inner.samples - 5
    place = inner.first + 2 + np.arange(steps)
    interval = UInt32((place // below.rate + 1).astype(np.uint32))
    moment = Float32((place % below.rate / below.rate).astype(np.float32))
    lane = dr.arange(UInt32, len(level) * steps)
    width = dr.opaque(UInt32, steps)
    group = lane // width
    index = lane - group * width
    row = dr.gather(UInt32, interval, index) * dr.opaque(UInt32, len(below))
    start = dr.gather(Float32, moment, index)
    u = start, start + dr.opaque(Float32, 0.5 / below.rate)
    samples = dr.opaque(UInt32, inner.samples)
    per_turn, per_rate, _ = (dr.opaque(Float32, value) for value in sweep.per_turn(step_s))
    spread = spread_to(below.nodes, level.nodes)
    x = [float(v) for v in nodes(level.nodes)[::2]]

    def add(i: Any, sums: list[Any]) -> tuple[Any, list[Any]]:
        child = dr.gather(UInt32, children, i)
        cubic = dr.gather(Packet, delta, row + child)
        frames = [read(inner.values, child * samples + index + k, below.nodes, Packet) for k in range(6)]
        # The quintic through six samples; what it misses of a phasor of step w, 5/1024 w^6, is an image at the rate below.
        middle = [
            (150 * (c + d) - 25 * (b + e) + 3 * (a + f)) * (1 / 256) for a, b, c, d, e, f in zip(*frames, strict=True)
        ]
        out = []
        for time, values in zip(u, (frames[2], middle), strict=True):
            turns = cubic[0] + time * (cubic[1] + time * (cubic[2] + time * cubic[3]))
            rate = cubic[1] + time * (2 * cubic[2] + time * (3 * cubic[3]))
            sin, cos = sin_cos(turns)
            out += rotated(spread(turned(values, sin, cos)), turns * per_turn + rate * per_rate, x)
        return i + 1, [total + value for total, value in zip(sums, out, strict=True)]

    zeros = [dr.zeros(Float32, dr.width(lane)) for _ in range(4 * level.nodes)]
    end = dr.gather(UInt32, bounds, group + 1)
    _, sums = dr.while_loop(
        state=(dr.gather(UInt32, bounds, group), zeros),
        cond=lambda i, sums: i < end,
        body=add,
        labels=("i", "sums"),
        mode="symbolic",
    )
    out = dr.ravel(backend.arrays.ArrayXf(sums))
    dr.eval(out)
    return Factors(out, 2 * steps, 2 * (inner.first + 2))


def at_moments(
    inner: Factors,
    level: Level,
    members: Members,
    phase: tuple[Any, Any],
    centres: np.ndarray,
    position: np.ndarray,
    step_s: float,
    count: int,
    sweep: Sweep,
    backend: Backend,
) -> np.ndarray:
    """Fields of buckets at `count` nodes of the sweep, complex64 (moment, bucket, node), from groups' factors.

    `members` says which groups stand in which bucket when, `phase` holds the tables of `phases` for the groups, `centres` the
    buckets' theta, `position` the moments [frames after the window's start], ascending.
    """
    import drjit as dr

    Float32, UInt32, Packet = backend.Float32, backend.UInt32, backend.arrays.Array4f
    buckets = members.collectors
    slot = members.slot(position)
    row = slot * buckets + np.arange(buckets)[:, None]
    bucket, moment = np.nonzero(members.starts[row + 1] > members.starts[row])
    row = row[bucket, moment]
    place = position * level.rate - inner.first
    sample = np.clip(np.floor(place).astype(np.int64), 1, inner.samples - 3)
    p = place - sample
    # The cubic through the samples at -1, 0, 1, 2.
    weights = np.stack(
        [-p * (p - 1) * (p - 2) / 6, (p + 1) * (p - 1) * (p - 2) / 2, -(p + 1) * p * (p - 2) / 2, (p + 1) * p * (p - 1) / 6], axis=1
    )  # fmt: skip

    def per_moment(values: np.ndarray, kind: Any) -> Any:
        return dr.gather(kind, backend.lanes(values, kind), lane_moment)

    lane_moment = backend.lanes(moment)
    begin, end = backend.lanes(members.starts[row]), backend.lanes(members.starts[row + 1])
    interval = slot // members.slots_per_interval
    intervals = dr.opaque(UInt32, len(level.delay) - 1)
    interval_of_lane = per_moment(interval, UInt32)
    u = per_moment(position + 1 - interval, Float32)
    index = per_moment(sample - 1, UInt32)
    weight = dr.gather(Packet, Float32(weights.astype(np.float32).ravel()), lane_moment)
    centre = backend.lanes(centres[bucket], Float32)
    table = backend.lanes(members.members)
    samples = dr.opaque(UInt32, inner.samples)
    per_turn, per_rate, eps_per_rate = (dr.opaque(Float32, value) for value in sweep.per_turn(step_s))
    spread = spread_to(level.nodes, count)
    x = [float(v) for v in nodes(count)[::2]]

    def add(i: Any, sums: list[Any]) -> tuple[Any, list[Any]]:
        group = dr.gather(UInt32, table, i)
        member = group * intervals + interval_of_lane
        cubic = dr.gather(Packet, phase[0], member)
        theta = dr.gather(Float32, phase[1], member) - centre
        frames = [read(inner.values, group * samples + index + k, level.nodes, Packet) for k in range(4)]
        values = [sum(w * v for w, v in zip(weight, parts, strict=True)) for parts in zip(*frames, strict=True)]
        travelled = u * (cubic[1] + u * (cubic[2] + u * cubic[3]))
        rate = cubic[1] + u * (2 * cubic[2] + u * (3 * cubic[3]))
        turns = cubic[0] + travelled
        sin, cos = sin_cos(turns)
        theta = theta + travelled * per_turn + rate * per_rate
        out = rotated(spread(turned(values, sin, cos)), theta, x, bend=rate * eps_per_rate)
        return i + 1, [total + value for total, value in zip(sums, out, strict=True)]

    zeros = [dr.zeros(Float32, dr.width(begin)) for _ in range(2 * count)]
    _, sums = dr.while_loop(
        state=(begin, zeros), cond=lambda i, sums: i < end, body=add, labels=("i", "sums"), mode="symbolic"
    )
    out = dr.zeros(Float32, len(position) * buckets * 2 * count)
    dr.scatter(out, backend.arrays.ArrayXf(sums), backend.lanes(moment * buckets + bucket))
    return np.asarray(out.numpy()).view(np.complex64).reshape(len(position), buckets, count)


def _relative(below: Level, level: Level, sweep: Sweep) -> np.ndarray:
    """Phase of each group against its parent's [turns], cubics in the frame step, float32 (n + 2, K, 4)."""
    above, above_slope = level.delay[:, level.group], level.delay_slope[:, level.group]
    turns = (sweep.mid_hz - 0.5 * sweep.slope * (below.delay + above)) * (below.delay - above)
    rate = (sweep.mid_hz - sweep.slope * below.delay) * below.delay_slope - (
        sweep.mid_hz - sweep.slope * above
    ) * above_slope
    return np.stack(hermite(turns[:-1], turns[1:], rate[:-1], rate[1:]), axis=-1).astype(np.float32)
