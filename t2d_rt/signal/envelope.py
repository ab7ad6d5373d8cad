"""Doppler envelope of a spectrogram: how fast the fastest parts come and go, and where the torso is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MARGIN_DB = 6.0
"""Threshold above the median level of all cells [dB]."""
RANGE_DB = 35.0
"""The threshold lies no farther below the greatest cell, however little noise there is."""
NOTCH_MPS = 0.12
"""Cells of smaller speeds hold what is left of static echoes and of the receiver's offset; they are not looked at."""


@dataclass(frozen=True, slots=True)
class Envelope:
    """Speeds over time [m/s], (T,), all 0 at instants at which nothing that moves is above the threshold."""

    upper_mps: np.ndarray
    """Greatest approaching speed that is above the threshold, or 0."""
    lower_mps: np.ndarray
    """Greatest receding one, negative, or 0."""
    torso_mps: np.ndarray
    """Speed above which half of the power above the threshold lies."""
    power_db: np.ndarray
    """Power of the cells above the threshold [dB], 0 at the greatest cell."""
    threshold_db: float

    @property
    def extent_mps(self) -> tuple[float, float]:
        """Least and greatest speed at any time."""
        return float(self.lower_mps.min()), float(self.upper_mps.max())


def envelope(levels_db: np.ndarray, velocity_mps: np.ndarray) -> Envelope:
    """The envelope of levels (speed, time), 0 dB at the greatest, over ascending speeds.

    The threshold is `MARGIN_DB` above the level that half of all cells do not exceed, which is noise as long as a body takes up
    less than half of a spectrogram, or `RANGE_DB` below the greatest cell that moves. A cell counts if one of its neighbours in
    speed or time is above the threshold too: single ones are peaks of the noise.
    """
    moving = np.where(np.abs(velocity_mps)[:, None] >= NOTCH_MPS, levels_db.astype(np.float64), -np.inf)
    threshold_db = max(float(np.median(levels_db)) + MARGIN_DB, float(moving.max()) - RANGE_DB)
    above = moving > threshold_db
    padded = np.pad(above, 1)
    above &= padded[2:, 1:-1] | padded[:-2, 1:-1] | padded[1:-1, 2:] | padded[1:-1, :-2]
    speeds = np.where(above, velocity_mps[:, None], 0.0)
    power = np.where(above, 10.0 ** (moving / 10.0), 0.0)
    total = power.sum(axis=0)
    middle = (np.cumsum(power, axis=0) < 0.5 * total).sum(axis=0)
    torso = np.where(total > 0, velocity_mps[np.minimum(middle, len(velocity_mps) - 1)], 0.0)
    return Envelope(
        speeds.max(axis=0), speeds.min(axis=0), torso, 10.0 * np.log10(np.maximum(total, 1e-20)), threshold_db
    )
