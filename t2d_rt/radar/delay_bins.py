"""Buckets of fixed delay, and which echoes or groups fall into each of them at which time."""

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
"""Greatest number of time slots in a frame interval."""
SLOT_BINS = 1.0
"""Range bins by which an echo may move within a time slot; for narrower buckets their width is the limit."""
MANY_SLOTS = 16
"""Where a frame interval has more slots than this, slots without a chirp are left out."""


@dataclass(frozen=True, slots=True)
class BinMembers:
    """Which echoes fall into each bin during each time slot; the slots divide the frame intervals."""

    bins: int
    slots_per_interval: int
    starts: np.ndarray
    """Row r = slot * bins + bin has the echoes members[starts[r]:starts[r + 1]]; (slots * bins + 1,)."""
    members: np.ndarray
    """Indices of the echoes, row after row."""

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
        """The members for triples (slot, bin, member). `shape`: numbers of slots and bins; `per`: slots in an interval; `size`:
        number of echoes."""
        from scipy.sparse import coo_array

        # A counting sort, by SciPy: the rows of a CSR matrix are the members of the bins.
        row = slot * shape[1] + bin_number
        table = coo_array((np.ones(len(row), np.int8), (row, member)), shape=(shape[0] * shape[1], size)).tocsr()
        return cls(shape[1], per, table.indptr, table.indices)

    def slot(self, position: np.ndarray) -> np.ndarray:
        """Time slots in which ascending instants lie [frames after the window's start, which is preceded by one interval]."""
        last = (len(self.starts) - 1) // self.bins - 1
        return np.clip(np.floor((position + 1) * self.slots_per_interval).astype(np.int64), 0, last)


@dataclass(frozen=True, slots=True)
class Buckets:
    """Buckets of fixed delay, into which echoes are sorted to be summed."""

    origin_s: float
    """Delay [s] from which the delays of the buckets are counted."""
    centres: np.ndarray
    """theta of the middle of each bucket, relative to the origin, (bucket,)."""
    part: np.ndarray
    """Index of the part of the recording to which each bucket belongs, ascending, (bucket,)."""
    members: BinMembers
    """Members of each bucket during each slot; slots are so short that no echo moves by more than `SLOT_BINS`, or than a bucket's
    width."""

    def place(self, bucket: np.ndarray, batch: np.ndarray, batches: int) -> np.ndarray:
        """Indices of results in an array that holds the parts one after the other, and within each part the batches, and within
        these the buckets."""
        first, last = (np.searchsorted(self.part, self.part, side) for side in ("left", "right"))
        return (first * (batches - 1) + np.arange(len(first)))[bucket] + batch * (last - first)[bucket]

    def theta(self, sweep: Sweep) -> np.ndarray:
        """theta of the carriers of the buckets, their phase per unit of x, (bucket,)."""
        return self.origin_s * sweep.theta_per_s + self.centres


def buckets(
    delays: Delay,
    interval: np.ndarray,
    echo: np.ndarray,
    instants: Instants,
    width: float,
    apart: np.ndarray | None = None,
) -> Buckets:
    """Sorts pairs (interval, echo) into buckets of `width` range bins. `apart`: index of the part of each pair; pairs of different
    parts go to different buckets."""
    (delay, delay_slope), step_s = delays, instants.step_s
    # The delay that corresponds to the beat frequency, range-Doppler coupling included.
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
    # The bucket of an echo is constant within a slot: the one in which the echo is in the middle of the slot.
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

    Where there are many slots, most hold no chirp; pairs in those are left out.
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
    """The distinct numbers (all 0 or more), ascending, and the index of each given number among them."""
    present = np.flatnonzero(np.bincount(numbers))
    rank = np.zeros(present[-1] + 1, np.int64)
    rank[present] = np.arange(len(present))
    return present, rank[numbers]
