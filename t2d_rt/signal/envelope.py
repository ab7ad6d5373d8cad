"""Doppler envelope of a spectrogram: the greatest approaching and receding speeds and the speed of the torso over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MARGIN_DB = 6.0
"""Distance of the threshold above the median level of all cells [dB]."""
RANGE_DB = 35.0
"""Greatest distance of the threshold below the strongest cell, however low the noise is [dB]."""
NOTCH_MPS = 0.12
"""Cells of smaller speeds [m/s] are ignored: they hold residues of static echoes and of the receiver's offset."""


@dataclass(frozen=True, slots=True)
class Envelope:
    """Speeds over time [m/s], (T,) each; all are 0 at instants when nothing that moves is above the threshold."""

    upper_mps: np.ndarray
    """Greatest approaching speed above the threshold, or 0."""
    lower_mps: np.ndarray
    """Greatest receding speed above the threshold, as a negative number, or 0."""
    torso_mps: np.ndarray
    """Median speed of the power above the threshold."""
    power_db: np.ndarray
    """Total power of the cells above the threshold [dB] relative to the strongest cell."""
    threshold_db: float

    @property
    def extent_mps(self) -> tuple[float, float]:
        """Least and greatest speed over all times [m/s]."""
        return float(self.lower_mps.min()), float(self.upper_mps.max())


def envelope(levels_db: np.ndarray, velocity_mps: np.ndarray) -> Envelope:
    """The envelope of levels (speed, time) [dB], 0 at the strongest, over ascending speeds.

    The threshold is `MARGIN_DB` above the median level of all cells, which is noise as long as a body fills less than half of the
    spectrogram, or `RANGE_DB` below the strongest moving cell, whichever is higher. A cell counts only if a neighbour in speed or
    time is above the threshold, too, since single cells are peaks of noise.
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
