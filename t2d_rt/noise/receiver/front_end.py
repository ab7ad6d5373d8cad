"""What the two channels of a receiver do to its samples: I/Q imbalance, a constant."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.noise.receiver.draws import Draws
from t2d_rt.noise.receiver.time_slots import TimeSlots
from t2d_rt.types import Radar
from t2d_rt.types.receiver import IqImbalance


def imbalanced(samples: np.ndarray, imbalance: IqImbalance) -> np.ndarray:
    """Samples with the image that I/Q imbalance adds: each a sum of the sample and of its conjugate (eq. 35)."""
    direct, image = imbalance.coefficients
    return np.complex64(direct) * samples + np.complex64(image) * np.conj(samples)


def dc_offsets(radar: Radar, level_dbm: float, draws: Draws) -> np.ndarray:
    """A constant for each antenna, complex64 (antenna, 1): one of each receive channel, whose phase is drawn."""
    slots = TimeSlots(radar)
    phase = 2 * math.pi * draws.of("DC offset").random(slots.channels)
    constant = math.sqrt(10 ** ((level_dbm - 30) / 10)) * np.exp(1j * phase)
    return np.tile(constant, slots.per_row)[:, None].astype(np.complex64)
