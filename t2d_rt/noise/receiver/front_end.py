"""The constant that leakage leaves in a receiver's samples."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.noise.receiver.draws import Draws
from t2d_rt.noise.receiver.time_slots import TimeSlots
from t2d_rt.types import Radar


def dc_offsets(radar: Radar, level_dbm: float, draws: Draws) -> np.ndarray:
    """A constant for each antenna, complex64 (antenna,): one of each receive channel, whose phase is drawn."""
    slots = TimeSlots(radar)
    phase = 2 * math.pi * draws.of("DC offset").random(slots.channels)
    constant = math.sqrt(10 ** ((level_dbm - 30) / 10)) * np.exp(1j * phase)
    return np.tile(constant, slots.per_row).astype(np.complex64)
