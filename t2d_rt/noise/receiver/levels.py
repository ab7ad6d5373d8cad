"""Powers of samples before a receiver, and of what it adds to them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from t2d_rt.core.cubes import column_sums
from t2d_rt.core.errors import warn
from t2d_rt.noise.receiver.samples import Received
from t2d_rt.types import Radar, Receiver

SILENT = 1e-13
"""Fraction of the power of all samples below which a power is rounding."""

DB_PER_BIT = 20 * math.log10(2)
MOST_LOST = 0.9
"""Fraction of samples at the offset's value beyond which a step is too coarse: that of Gaussian noise of a quarter step, through
which weak echoes pass 7 dB weaker; through half a step they pass as they are."""


@dataclass(slots=True)
class Power:
    """Running sums for the mean power of samples (row, antenna, sample) [sqrt(W)], and for that of their mean over the rows."""

    reference: np.ndarray | float = 0.0
    """(antenna, sample), or what broadcasts to that; powers are summed about it."""
    count: int = 0
    """Samples."""
    rows: int = 0
    sum_w: float = 0.0
    """Sum of |sample - reference|^2 [W]."""
    total: Any = 0.0
    """Sum over the rows, complex128 (antenna, sample)."""

    def add(self, shape: tuple[int, ...], sums_w: np.ndarray, total: np.ndarray) -> None:
        """Counts rows of samples (row, antenna, sample) by their sums about the reference and by those over the rows."""
        self.rows += shape[0]
        self.count += math.prod(shape)
        self.sum_w += float(sums_w.sum(dtype=np.float64))
        self.total = self.total + total

    @property
    def static_w(self) -> float:
        """Power of the mean over the rows [W]."""
        return float(np.mean(np.abs(self.total / self.rows) ** 2))

    @property
    def moving_w(self) -> float:
        """Power of what changes from row to row [W]."""
        departure = self.total / self.rows - self.reference
        return self.sum_w / self.count - float(np.mean(np.abs(departure) ** 2)) if self.rows > 1 else 0.0

    @property
    def mean_w(self) -> float:
        """Power of all [W]."""
        return self.static_w + max(self.moving_w, 0.0)


@dataclass(slots=True)
class ReceiverLevels:
    """Powers of the samples before a receiver, and of what it adds to them."""

    receiver: Receiver
    radar: Radar
    offsets: np.ndarray
    """What is added to each sample, (antenna,)."""
    clean: Power = field(init=False)
    added: Power = field(init=False)
    """Power of the samples after the receiver less those before it and the offsets."""
    clipped: int = 0
    peak: float = 0.0
    """Greatest |I| or |Q| before the converters [sqrt(W)]."""
    input_w: float = 0.0
    """Sum over the samples before the converters, without the offsets [W]."""
    lost: int = 0
    """Samples that are rounded to what the offset alone would be."""

    def __post_init__(self) -> None:
        self.clean, self.added = Power(), Power(self.offsets[:, None])

    def reference(self, clean: np.ndarray) -> np.ndarray:
        """What powers of the clean samples (row, antenna, sample) are summed about: the record's first row.

        Small changes of strong samples are more than rounding then.
        """
        if not self.clean.rows:
            self.clean.reference = clean[0].copy()
        return np.asarray(self.clean.reference)

    def add(self, clean: np.ndarray, received: Received) -> None:
        """Counts rows before and after the receiver."""
        before, after = column_sums(clean), column_sums(received.samples)
        self.clean.add(clean.shape, received.clean_w, before)
        self.added.add(clean.shape, received.added_w, after - before)
        self.peak = max(self.peak, float(received.peak.max()))
        self.input_w += float(received.input_w.sum(dtype=np.float64))
        self.lost += int(received.lost.sum(dtype=np.float64))
        self.clipped += int(received.clipped.sum(dtype=np.float64))

    def described(self) -> dict[str, Any]:
        """Levels by the names that a recording's settings have for them; those that are not known are left out."""
        found: dict[str, Any] = {"noise": ", ".join(self.receiver.effects) or "none"}
        floor_w = self.receiver.noise_floor_w(self.radar)
        if floor_w > 0:
            found["noise_floor_dbm"] = _db(floor_w) + 30
        if not self.clean.count:
            return found
        clean_w, all_w = self.clean.mean_w, self.clean.mean_w + self.added.mean_w
        moving_w, static_w = _heard(self.clean.moving_w, clean_w), _heard(self.clean.static_w, clean_w)
        noise_w = _heard(self.added.moving_w, all_w)
        if noise_w > 0:
            found["noise_dbm"] = _db(noise_w) + 30
            if moving_w > 0:
                found["snr_db"] = _db(moving_w / noise_w)
            if static_w > 0:
                found["clutter_to_noise_db"] = _db(static_w / noise_w)
        if self.receiver.adc:
            peak_w = self.peak**2 / self.receiver.adc.full_scale_w
            found |= {
                "adc_peak_dbfs": _db(peak_w) if peak_w > 0 else None,
                "clipped": self.clipped / self.clean.count,
            }
        return found

    def warn(self) -> None:
        """Tells of saturation, and of a step that is too coarse for what comes in."""
        adc = self.receiver.adc
        if adc is None or not self.clean.count:
            return
        if self.clipped:
            over_db = 20 * math.log10(self.peak / math.sqrt(adc.full_scale_w))
            warn(
                f"the ADC is saturated: {100 * self.clipped / self.clean.count:.3g} % of the samples are clipped, the highest by "
                f"{max(over_db, 0.0):.1f} dB; lower adc.gain_db or raise adc.full_scale_dbm, or move what is strongest away"
            )
        lost = self.lost / self.clean.count
        if self.input_w > 0 and lost > MOST_LOST:
            rms = math.sqrt(self.input_w / self.clean.count / 2)
            lacking_db = max(math.ceil(20 * math.log10(adc.step / rms)), 1)
            warn(
                f"the ADC's step is {adc.step / rms:.3g} times the rms of what comes in, and {100 * lost:.3g} % of the samples are "
                f"rounded to one value; raise adc.gain_db from {adc.gain_db:g} to {adc.gain_db + lacking_db:g}, lower "
                f"adc.full_scale_dbm by {lacking_db} dB, or give adc.bits {math.ceil(lacking_db / DB_PER_BIT)} more"
            )


def _heard(power_w: float, all_w: float) -> float:
    """A power, or 0 where it is rounding."""
    return power_w if power_w > SILENT * all_w else 0.0


def _db(ratio: float) -> float:
    """A ratio of powers in decibels."""
    return 10 * math.log10(ratio)
