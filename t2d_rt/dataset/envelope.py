"""Doppler envelope of a spectrogram: how fast the fastest parts come and go, and where the torso is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MARGIN_DB = 6.0
"""Above the noise's median level, that a cell must exceed: the mean of 20 cells of noise or more does so in less than 1 of 10^9."""
RANGE_DB = 40.0
"""Below the greatest cell, that weaker ones are not looked at."""


@dataclass(frozen=True, slots=True)
class Envelope:
    """Speeds over time [m/s], (T,); NaN at instants at which nothing is above the threshold."""

    upper_mps: np.ndarray
    """Greatest approaching speed that is above the threshold."""
    lower_mps: np.ndarray
    """Greatest receding one, negative."""
    torso_mps: np.ndarray
    """Where half of the power lies above, and half below."""
    threshold_db: float

    @property
    def extent_mps(self) -> tuple[float, float]:
        """Least and greatest speed at any time."""
        return float(np.nanmin(self.lower_mps)), float(np.nanmax(self.upper_mps))


def envelope(levels_db: np.ndarray, velocity_mps: np.ndarray) -> Envelope:
    """The envelope of levels (speed, time), 0 dB at the greatest.

    The threshold is `MARGIN_DB` above the level that half of all cells do not exceed, but no more than `RANGE_DB` below the
    greatest cell; noise is white, and a body takes up less than half of a spectrogram.
    """
    threshold_db = max(float(np.median(levels_db)) + MARGIN_DB, -RANGE_DB)
    above = levels_db > threshold_db
    held = above.any(axis=0)
    first, last = above.argmax(axis=0), len(above) - 1 - above[::-1].argmax(axis=0)
    power = np.where(above, 10.0 ** (levels_db.astype(np.float64) / 10.0), 0.0)
    share = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
    middle = (share < 0.5).sum(axis=0)
    found = [np.where(held, velocity_mps[np.minimum(each, len(above) - 1)], np.nan) for each in (last, first, middle)]
    return Envelope(*found, threshold_db)
