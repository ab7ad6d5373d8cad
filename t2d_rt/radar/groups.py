"""Which echoes go into which groups, level by level: those whose phases part slowly and whose delays lie close."""

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
"""Samples of the smallest groups' factors per frame interval, by tolerance [dB]: the amplitudes' interpolants have kinks at the
frames, which leave -54 and -62 dB. Beyond these tolerances echoes are not merged."""
FIRST_BINS = 0.35
"""Range bins that the smallest groups' echoes span at most."""
MOST_BINS = 3.0
"""Range bins that the largest groups' echoes span at most."""
NARROW_BINS, WIDE_BINS = 3.0, 9.0
"""Width of a bucket of groups: wide ones have fewer nodes for each bin, but a group has to be summed at more of them."""
WIDE_GROUPS = 2.0
"""Groups for each range bin up to which buckets are wide, of a sweep of `USUAL_SAMPLES`."""
USUAL_SAMPLES = 256
WIDE = 0.25
"""Fraction of what the smallest groups may span from which the outermost antennas of an array count too."""
FEW_ECHOES, ROUNDING = 100, 1e-4
"""Of so few it is first asked whether groups can pay, with limits that much wider: features are float32."""
PROBE_EVERY = 4
"""Frames between samples of the echoes' phase rates and delays."""


@dataclass(frozen=True, slots=True)
class GroupLevel:
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
    """Slope of the mean delay [s per frame], (n + 3, K)."""

    def __len__(self) -> int:
        return self.delay.shape[1]

    def part(self, number: int, parts: int) -> GroupLevel:
        """One of `parts` equal parts of the groups."""
        block = slice(number * len(self) // parts, (number + 1) * len(self) // parts)
        return replace(self, delay=self.delay[:, block], delay_slope=self.delay_slope[:, block])


def levels(
    window: Window, sweep: Sweep, rate: float, tolerance: float, extras: Sequence[Delay] = ()
) -> list[GroupLevel]:
    """Levels that save work for instants that come `rate` times per frame interval, none where summing echo by echo is less work.

    `extras`: what is added to the delays [s] and their slopes, each (n + 3, L), at the outermost antennas of an array.
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
    # work[k]: that of k levels and of a sum over the groups of the last one at every chirp; the least decides how many there are.
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
    """The same groups, each once for each of so many parts that it holds echoes of; and the parts of the last level's groups.

    `part` is that of each echo, (L,). Group by group the sums of the parts add up to those of `tree`, for delays stay the same.
    """
    from scipy.sparse import csr_array

    split_levels, below = [], np.arange(len(part))  # of what is below: which group of `tree` it was, or echo
    for level in tree:
        key = level.group[below] * parts + part
        distinct, group = np.unique(key, return_inverse=True)
        original = distinct // parts
        # The mean over all members, of which the first copy of each counts.
        _, first = np.unique(below, return_index=True)
        copies = csr_array((np.ones(len(first)), (first, below[first])), shape=(len(below), len(first)))
        mean = copies @ level.mean[:, original]
        delay, slope = level.delay[:, original], level.delay_slope[:, original]
        split_levels.append(replace(level, group=group, mean=mean, delay=delay, delay_slope=slope))
        below, part = original, distinct % parts
    return split_levels, part


# Measured costs of one echo and one node in a sum, relative to one another.
WORK_ECHO, WORK_NODE = 1.0, 0.25


def _may_pay(cycles: np.ndarray, bins: np.ndarray, allowed: float, samples: int, rate: float, tolerance: float) -> bool:
    """Whether any level may take less work than the sum echo by echo, by the fewest groups that echoes (probes, L) can fall into:
    False only where `levels` would find none."""
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
    """Fewest groups none of which spans more than a limit in any feature (C, L): what one feature alone asks for."""
    most, limit = 0, limit * (1 + ROUNDING)
    for values in np.sort(features, axis=1).tolist():
        count, end = 0, -math.inf
        for value in values:
            if value > end:
                count, end = count + 1, value + limit
        most = max(most, count)
    return most


def bucket_bins(groups: GroupLevel, count: int, sweep: Sweep) -> float:
    """Width of buckets of a level's groups, `count` of them for each pair of antennas."""
    span = float(np.ptp(groups.delay)) / sweep.bin_s
    return WIDE_BINS if count < WIDE_GROUPS * span * len(sweep.x) / USUAL_SAMPLES else NARROW_BINS


def bucket_theta(bucket: float, width: float) -> float:
    """Greatest theta of a bucket, so many bins wide, that holds groups of `width` bins."""
    return math.pi * (bucket / 2 + 0.8 * width + SLOT_BINS / 2)


def _cycles_per_step(tolerance: float) -> float:
    """Greatest difference of the phase steps within a group [cycles per sample].

    A cubic at the midpoint of four samples misses a phasor of step w by (3/128) w^4, of w uniform in -pi p..pi p by (pi p)^4/3
    of that in the mean square. That is the last step, at the chirps; the levels' midpoints are those of quintics and leave less.
    """
    return (tolerance * (128 / 3) * 3) ** 0.25 / math.pi


def _features(
    window: Window, sweep: Sweep, extras: Sequence[Delay], wide: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """What distinguishes echoes, at a few instants of the window: phase rates [cycles per frame] and delays that the beat shows
    [bins], float32 (probes, L); the same at outermost antennas for which either differs by more than `wide` from echo to echo."""
    last = len(window.delay) - 1
    instants = np.unique(np.linspace(0, last, 2 + last // PROBE_EVERY).astype(int))
    rates = window.delay_slope[instants]
    # Delays at all of these instants too: limbs that pass each other at some are a metre apart at others.
    shown = window.delay[instants] + rates * (sweep.coupling_s / window.step_s)
    # Relative to the first echo: float32 would round absolute delays.
    cycles, bins = (rates - rates[:, :1]) * sweep.mid_hz, (shown - shown[:, :1]) / sweep.bin_s
    features = [(cycles, bins)]
    for delays, slope in extras:
        more_cycles, more_bins = slope[instants] * sweep.mid_hz, delays[instants] / sweep.bin_s
        if np.ptp(more_cycles, axis=1).max() > wide[0] or np.ptp(more_bins, axis=1).max() > wide[1]:
            features.append((cycles + more_cycles, bins + more_bins))
    cycles, bins = (np.concatenate(columns).astype(np.float32) for columns in zip(*features, strict=True))
    return cycles, bins


def _grouped(low: np.ndarray, high: np.ndarray, cells: Sequence[int]) -> np.ndarray:
    """Groups items, (N,) numbers 0, 1, ..., none of which spans more than 1: cells of a grid of that width in some features,
    `cells`, are halved along their widest feature for as long as they span more.

    low, high (C, N): what each item spans itself, at most 1; both may be one. The items of a part lie side by side in memory.
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
        # Echoes span nothing themselves, so that both are one.
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
    """Sparse (N, K): values of items times this are the means of their groups."""
    from scipy.sparse import csr_array

    weight = 1 / np.bincount(group)
    return csr_array((weight[group], group, np.arange(len(group) + 1)), shape=(len(group), len(weight)))


def _hulls(group: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Extent of each group in each feature, (C, K)."""
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    first = np.take(low, order, axis=1)
    last = first if low is high else np.take(high, order, axis=1)
    return np.minimum.reduceat(first, starts, axis=1), np.maximum.reduceat(last, starts, axis=1)
