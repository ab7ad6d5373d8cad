"""Merging echoes into groups, level by level: echoes of a group have similar phase rates and similar delays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from t2d_rt.radar.delay_bins import SLOT_BINS
from t2d_rt.radar.prolate import band_nodes
from t2d_rt.radar.sweep import Sweep, nodes_for
from t2d_rt.radar.windows import Delay, Window

FIRST_RATES = ((-50.0, 4), (-60.0, 8))
"""By tolerance [dB], the samples per frame interval of the factors of the smallest groups. The interpolants of the amplitudes have
kinks at the frames, which cause errors of -54 and -62 dB; for tolerances below the last one echoes are not merged."""
FIRST_BINS = 0.35
"""Greatest span of the echoes in one of the smallest groups [range bins]."""
MOST_BINS = 3.0
"""Greatest span of the echoes in one of the largest groups [range bins]."""
NARROW_BINS, WIDE_BINS = 3.0, 9.0
"""Widths of a bucket of groups [range bins]: wide ones need fewer nodes per bin, but each group is summed at more nodes."""
WIDE_GROUPS = 2.0
"""Number of groups per range bin up to which buckets are wide, for a sweep of `USUAL_SAMPLES` samples."""
USUAL_SAMPLES = 256
WIDE = 0.25
"""The outermost antennas of an array limit groups, too, where they change phase rates or delays by more than this fraction of the
smallest groups' limits."""
FEW_ECHOES, ROUNDING = 100, 1e-4
"""For so few echoes it is checked first whether groups can save work at all; limits are widened by the second figure, as features
are float32."""
PROBE_EVERY = 4
"""Frames between the samples of the echoes' phase rates and delays."""


@dataclass(frozen=True, slots=True)
class GroupLevel:
    """Groups of one level: of echoes, or of groups of the level below."""

    rate: int
    """Samples of the groups' factors per frame interval."""
    nodes: int
    """Number of nodes over the sweep."""
    bins: float
    """Greatest span of the echoes of a group [range bins]."""
    group: np.ndarray
    """Index of the group to which each echo, or each group of the level below, belongs."""
    mean: Any
    """Sparse matrix by which values of the members (..., member) are multiplied to get the means of the groups. With several pairs
    of antennas, it is that of one pair."""
    delay: np.ndarray
    """Mean delay of each group's members [s], (n + 3, K)."""
    delay_slope: np.ndarray
    """Slope of the mean delay [s per frame], (n + 3, K)."""

    def __len__(self) -> int:
        return self.delay.shape[1]

    def part(self, number: int, parts: int) -> GroupLevel:
        """One of `parts` equal pieces of the groups, by its index."""
        block = slice(number * len(self) // parts, (number + 1) * len(self) // parts)
        return replace(self, delay=self.delay[:, block], delay_slope=self.delay_slope[:, block])


def levels(
    window: Window, sweep: Sweep, rate: float, tolerance: float, extras: Sequence[Delay] = ()
) -> list[GroupLevel]:
    """The levels of groups that save work for `rate` instants per frame interval; none where summing echo by echo is less work.

    `extras`: what is added to the delays [s] and their slopes, (n + 3, L) each, at the outermost antennas of an array.
    """
    rates = [first for limit_db, first in FIRST_RATES if tolerance >= 10 ** (limit_db / 20) * (1 - 1e-9)]
    if not rates:
        return []
    allowed = _cycles_per_step(tolerance)
    cycles, bins = _features(window, sweep, extras, (WIDE * allowed * rates[0], WIDE * FIRST_BINS))
    if cycles.shape[1] <= FEW_ECHOES and not _may_pay(cycles, bins, allowed, rates[0], rate, tolerance):
        return []
    tree: list[GroupLevel] = []
    samples, width = rates[0], FIRST_BINS
    low = high = np.concatenate([cycles, bins])
    middles = len(cycles) // 2, len(cycles) + len(bins) // 2
    count, delay, slope = low.shape[1], window.delay, window.delay_slope
    work, spent = [count * rate * WORK_ECHO], 0.0
    # work[k]: work of k levels and of the sum over the last level's groups at every chirp. The least of them decides on k.
    while samples <= rate:
        points = nodes_for(0.8 * math.pi * width, tolerance)
        spent += count * samples * (WORK_NODE * points if tree else WORK_ECHO)
        if spent >= min(work):
            break
        limits = np.repeat(np.array([allowed * samples, width], np.float32), [len(cycles), len(bins)])[:, None]
        scaled = low / limits
        group = _grouped(scaled, scaled if low is high else high / limits, middles)
        mean = _mean(group)
        delay, slope = delay @ mean, slope @ mean
        tree.append(GroupLevel(samples, points, width, group, mean, delay, slope))
        low, high = _hulls(group, low, high)
        count = low.shape[1]
        work.append(spent + count * rate * WORK_NODE * len(band_nodes(bucket_theta(NARROW_BINS, width), tolerance)))
        samples, width = 2 * samples, min(2 * width, MOST_BINS)
    return tree[: int(np.argmin(work))]


def by_part(tree: Sequence[GroupLevel], part: np.ndarray, parts: int) -> tuple[list[GroupLevel], np.ndarray]:
    """Divides groups by the part of the recording: each group becomes one group for each part of which it holds echoes. Also
    returns the part of each of the last level's groups.

    `part` is that of each echo, (L,). The groups keep their delays, so the sums of a group's parts add up to the group of `tree`.
    """
    from scipy.sparse import csr_array

    split_levels, below = [], np.arange(len(part))  # the item in `tree` that each item below was
    for level in tree:
        key = level.group[below] * parts + part
        distinct, group = np.unique(key, return_inverse=True)
        original = distinct // parts
        # The mean is over all members of the group in `tree`: one copy of each of them is counted.
        _, first = np.unique(below, return_index=True)
        copies = csr_array((np.ones(len(first)), (first, below[first])), shape=(len(below), len(first)))
        mean = copies @ level.mean[:, original]
        delay, slope = level.delay[:, original], level.delay_slope[:, original]
        split_levels.append(replace(level, group=group, mean=mean, delay=delay, delay_slope=slope))
        below, part = original, distinct % parts
    return split_levels, part


# Measured cost of an echo and of a node in a sum, relative to one another.
WORK_ECHO, WORK_NODE = 1.0, 0.25


def _may_pay(cycles: np.ndarray, bins: np.ndarray, allowed: float, samples: int, rate: float, tolerance: float) -> bool:
    """Whether any level of groups may save work over the sum echo by echo, judged by the least number of groups that the echoes can
    form (probes, L); False only where `levels` would find none."""
    count, spent, width, first = cycles.shape[1], 0.0, FIRST_BINS, True
    alone = count * rate * WORK_ECHO
    while samples <= rate:
        spent += count * samples * (WORK_ECHO if first else WORK_NODE * nodes_for(0.8 * math.pi * width, tolerance))
        if spent >= alone:
            return False
        count, first = max(_fewest(cycles, allowed * samples), _fewest(bins, width)), False
        nodes = len(band_nodes(bucket_theta(NARROW_BINS, width), tolerance))
        if spent + count * rate * WORK_NODE * nodes < alone:
            return True
        samples, width = 2 * samples, min(2 * width, MOST_BINS)
    return False


def _fewest(features: np.ndarray, limit: float) -> int:
    """A lower bound on the number of groups, none of which spans more than a limit in any feature (C, L): the number that the most
    demanding single feature needs."""
    most, limit = 0, limit * (1 + ROUNDING)
    for values in np.sort(features, axis=1).tolist():
        count, end = 0, -math.inf
        for value in values:
            if value > end:
                count, end = count + 1, value + limit
        most = max(most, count)
    return most


def bucket_bins(groups: GroupLevel, count: int, sweep: Sweep) -> float:
    """Width [range bins] of buckets for the groups of a level, of which each pair of antennas has `count`."""
    span = float(np.ptp(groups.delay)) / sweep.bin_s
    return WIDE_BINS if count < WIDE_GROUPS * span * len(sweep.x) / USUAL_SAMPLES else NARROW_BINS


def bucket_theta(bucket: float, width: float) -> float:
    """Greatest theta in a bucket of `bucket` range bins, relative to its middle, if it holds groups of `width` range bins."""
    return math.pi * (bucket / 2 + 0.8 * width + SLOT_BINS / 2)


def _cycles_per_step(tolerance: float) -> float:
    """Greatest difference of the phase steps within a group [cycles per sample] for a tolerance.

    At the midpoint of four samples a cubic differs from a phasor of step w by (3/128) w^4; for w uniform in -pi p..pi p the root
    mean square of that is (3/128) (pi p)^4/3. This is the last step, at the chirps; the levels below interpolate midpoints by
    quintics, which cause less error.
    """
    return (tolerance * (128 / 3) * 3) ** 0.25 / math.pi


def _features(
    window: Window, sweep: Sweep, extras: Sequence[Delay], wide: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Features by which echoes are grouped, at a few instants of the window: phase rates [cycles per frame] and delays as the beat
    frequency shows them [bins], float32 (probes, L) each. Outermost antennas are included where their features differ by more than
    `wide` from echo to echo."""
    last = len(window.delay) - 1
    instants = np.unique(np.linspace(0, last, 2 + last // PROBE_EVERY).astype(int))
    rates = window.delay_slope[instants]
    # Delays count at all of these instants: limbs that pass each other at one are a metre apart at another.
    shown = window.delay[instants] + rates * (sweep.coupling_s / window.step_s)
    # Relative to the first echo, for float32 would round absolute delays.
    cycles, bins = (rates - rates[:, :1]) * sweep.mid_hz, (shown - shown[:, :1]) / sweep.bin_s
    features = [(cycles, bins)]
    for delays, slope in extras:
        more_cycles, more_bins = slope[instants] * sweep.mid_hz, delays[instants] / sweep.bin_s
        if np.ptp(more_cycles, axis=1).max() > wide[0] or np.ptp(more_bins, axis=1).max() > wide[1]:
            features.append((cycles + more_cycles, bins + more_bins))
    cycles, bins = (np.concatenate(columns).astype(np.float32) for columns in zip(*features, strict=True))
    return cycles, bins


def _grouped(low: np.ndarray, high: np.ndarray, cells: Sequence[int]) -> np.ndarray:
    """Divides items into groups, none of which spans more than 1 in any feature; returns the group of each item, (N,).

    Items are first sorted into the cells of a grid of width 1 in the features `cells`; a cell that spans more than 1 is halved
    along its widest feature, again and again. low, high (C, N): least and greatest value of each feature of each item, at most 1
    apart; both may be the same array. Items of one group lie next to one another in memory.
    """
    rows = order = np.arange(low.shape[1])
    key = np.zeros(len(order), np.int64)
    for feature in cells:
        middle = 0.5 * (low[feature] + high[feature])
        cell = (middle - middle.min()).astype(np.int64)
        key = key * (cell.max() + 1) + cell
    group = np.empty(len(order), np.int64)
    count = 0
    while len(rows):
        by_key = np.argsort(key, kind="stable")
        rows, key = rows[by_key], key[by_key]
        # Echoes have no extent, so that low and high are one array.
        reordered = np.take(low, rows, axis=1)
        low, high, order = reordered, reordered if low is high else np.take(high, rows, axis=1), order[rows]
        starts = np.flatnonzero(np.diff(key, prepend=-1))
        bottom, top = np.minimum.reduceat(low, starts, axis=1), np.maximum.reduceat(high, starts, axis=1)
        sizes = np.diff(starts, append=len(order))
        widest, part = np.argmax(top - bottom, axis=0), np.arange(len(starts))
        small = ((top - bottom)[widest, part] <= 1) | (sizes == 1)
        middle = (top + bottom)[widest, part]
        number = np.cumsum(small) - 1 + count
        count += int(small.sum())
        part = np.repeat(part, sizes)
        done = small[part]
        group[order[done]] = number[part[done]]
        rows = np.flatnonzero(~done)
        part = part[rows]
        place = widest[part] * len(order) + rows
        upper = np.take(low, place) + np.take(high, place) > middle[part]
        key = 2 * part + upper
    return group


def _mean(group: np.ndarray) -> Any:
    """Sparse matrix (N, K): values of the items times it are the means of their groups."""
    from scipy.sparse import csr_array

    weight = 1 / np.bincount(group)
    return csr_array((weight[group], group, np.arange(len(group) + 1)), shape=(len(group), len(weight)))


def _hulls(group: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest value of each feature in each group, (C, K) each."""
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    first = np.take(low, order, axis=1)
    last = first if low is high else np.take(high, order, axis=1)
    return np.minimum.reduceat(first, starts, axis=1), np.maximum.reduceat(last, starts, axis=1)
