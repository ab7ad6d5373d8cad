"""Buckets of fixed delay: which echoes, or groups of them, fall into which bucket when."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.radar.sweep import Instants, Sweep
from t2d_rt.radar.windows import Delay

MOST_SLOTS = 1000
"""Time slots that a frame interval may have."""
SLOT_BINS = 1.0
"""Range bins that an echo may move within a time slot; narrower buckets allow only their own width."""
MANY_SLOTS = 16
"""Where a frame interval has more slots than this, those that hold no chirp are left out."""


@dataclass(frozen=True, slots=True)
class BinMembers:
    """Which echoes fall into each bin during each time slot, a part of a frame interval."""

    bins: int
    slots_per_interval: int
    starts: np.ndarray
    """(slot * bins + 1,): row r's echoes are members[starts[r]:starts[r + 1]], r = slot * bins + bin."""
    members: np.ndarray
    """Echo of each."""

    @classmethod
    def of(
        cls,
        slot: np.ndarray,
        bin_number: np.ndarray,
        member: np.ndarray,
        *,
        shape: tuple[int, int],
        per: int,
        size: int,
    ) -> BinMembers:
        """Members of triples (slot, bin, member); `shape` is (slots, bins), `per` slots of an interval, `size` echoes."""
        from scipy.sparse import coo_array

        # A counting sort: the rows of a CSR matrix are the members of the bins.
        row = slot * shape[1] + bin_number
        table = coo_array((np.ones(len(row), np.int8), (row, member)), shape=(shape[0] * shape[1], size)).tocsr()
        return cls(shape[1], per, table.indptr, table.indices)

    def slot(self, position: np.ndarray) -> np.ndarray:
        """Time slots of instants [frames after the window's start, of which one interval lies before], ascending."""
        last = (len(self.starts) - 1) // self.bins - 1
        return np.clip(np.floor((position + 1) * self.slots_per_interval).astype(np.int64), 0, last)


@dataclass(frozen=True, slots=True)
class Buckets:
    """Buckets of fixed delay."""

    origin_s: float
    """Delay that buckets are counted from."""
    centres: np.ndarray
    """theta of each bucket's middle, counted from there."""
    part: np.ndarray
    """Number of the part that each bucket belongs to, ascending."""
    members: BinMembers
    """Which echoes fall into each during which slot, so short that no echo moves by more than `SLOT_BINS`, or a bucket."""

    def place(self, bucket: np.ndarray, batch: np.ndarray, batches: int) -> np.ndarray:
        """Numbers of results that lie part by part, of each batch by batch and bucket by bucket."""
        first, last = (np.searchsorted(self.part, self.part, side) for side in ("left", "right"))
        return (first * (batches - 1) + np.arange(len(first)))[bucket] + batch * (last - first)[bucket]

    def theta(self, sweep: Sweep) -> np.ndarray:
        """theta of the buckets' carriers, their phase over x, (bucket,)."""
        return self.origin_s * sweep.theta_per_s + self.centres


def buckets(
    delays: Delay,
    interval: np.ndarray,
    echo: np.ndarray,
    instants: Instants,
    width: float,
    apart: np.ndarray | None = None,
) -> Buckets:
    """Buckets of `width` range bins for pairs (interval, echo); those of different parts `apart` go to different buckets."""
    (delay, delay_slope), step_s = delays, instants.step_s
    # The delay that the beat frequency shows.
    effective = delay + delay_slope * (instants.sweep.coupling_s / step_s)
    width_s = width * instants.sweep.bin_s
    before, after = effective[interval, echo], effective[interval + 1, echo]
    slot_s = min(width, SLOT_BINS) * instants.sweep.bin_s
    travel = float(np.abs(after - before).max()) / slot_s
    if travel > MOST_SLOTS:
        raise InputError(
            f"an echo's range changes by {travel * slot_s * SPEED_OF_LIGHT / 2:.3g} m from one surface frame to the next, "
            f"{step_s * 1e3:.3g} ms later, and at most {MOST_SLOTS * slot_s * SPEED_OF_LIGHT / 2:.3g} m can be followed; remove "
            "the jump from the target, raise surface_rate_hz, or give echoes of your own in seconds of delay"
        )
    # An echo changes its bucket from slot to slot at most, by where it is in the middle of the slot.
    slots = max(1, math.ceil(travel))
    origin_s = float(min(before.min(), after.min())) - width_s
    parts = []
    for slot, (intervals, pairs) in enumerate(_occupied(interval, instants.position, slots, len(delay) - 1)):
        place = before[pairs] + (slot + 0.5) / slots * (after[pairs] - before[pairs])
        parts.append((((place - origin_s) / width_s).astype(np.int64), intervals * slots + slot, pairs))
    bucket = np.concatenate([number for number, _, _ in parts])
    pair = np.concatenate([np.broadcast_to(np.arange(len(echo))[pairs], len(number)) for number, _, pairs in parts])
    span = int(bucket.max()) + 1
    if apart is not None:
        bucket += span * apart[pair]
    occupied, rank = _ranked(bucket)
    slot_number = np.concatenate([number for _, number, _ in parts])
    shape = (len(delay) - 1) * slots, len(occupied)
    members = BinMembers.of(slot_number, rank, echo[pair], shape=shape, per=slots, size=delay.shape[1])
    return Buckets(origin_s, (occupied % span + 0.5) * width * math.pi, occupied // span, members)


def _occupied(
    interval: np.ndarray, position: np.ndarray, slots: int, intervals: int
) -> Iterator[tuple[np.ndarray, np.ndarray | slice]]:
    """For each slot of an interval, the pairs (interval, echo) that need a bucket in it: their intervals, and their indices.

    Where there are many slots most hold no chirp, and the pairs in those are left out.
    """
    used = np.zeros(intervals * slots, bool)
    used[np.clip(np.floor((position + 1) * slots).astype(np.int64), 0, intervals * slots - 1)] = True
    if slots <= MANY_SLOTS or not used.reshape(-1, slots)[interval].any():
        yield from ((interval, slice(None)) for _ in range(slots))
        return
    for slot in range(slots):
        pairs = np.flatnonzero(used[interval * slots + slot])
        yield interval[pairs], pairs


def _ranked(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct numbers, all 0 or more, ascending, and the index of each given number among them."""
    present = np.flatnonzero(np.bincount(numbers))
    rank = np.zeros(present[-1] + 1, np.int64)
    rank[present] = np.arange(len(present))
    return present, rank[numbers]
