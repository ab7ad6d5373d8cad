"""1/f noise at IF, which falls by 10 dB per decade and meets thermal noise at its corner."""

from __future__ import annotations

import numpy as np
from scipy import fft

from t2d_rt.noise.receiver.draws import Draws
from t2d_rt.noise.receiver.processes import Fast, Slow
from t2d_rt.noise.receiver.time_slots import TimeSlots
from t2d_rt.types import Radar


class Flicker:
    """Density of thermal noise times corner / |f|, in each receive channel by itself (eq. 36)."""

    def __init__(self, radar: Radar, density_w: float, corner_hz: float, draws: Draws) -> None:
        def density(frequency_hz: np.ndarray) -> np.ndarray:
            return np.asarray(density_w * corner_hz / np.maximum(np.abs(frequency_hz), 1e-9))

        self._slots, self._draws = TimeSlots(radar), draws
        fast = Fast(density, radar.samples, radar.sample_rate_hz)
        self._amplitudes = fast.amplitudes().astype(np.float32)
        self._slow = [
            Slow(density, radar.prf_hz, fast.lowest_hz, draws, f"flicker of slots {channel}")
            for channel in range(self._slots.channels)
        ]

    def __call__(self, samples: np.ndarray, number: int) -> np.ndarray:
        """Samples (row, antenna, sample) of a group and its 1/f noise."""
        rows, antennas, count = samples.shape
        spectrum = self._draws.normal("flicker", number, (rows, antennas, 2 * count)) * self._amplitudes
        found = samples + fft.fft(spectrum, axis=2, overwrite_x=True)[:, :, :count]
        places, view = self._slots.numbers(number, rows), self._slots.by_slot(found)
        for channel, slow in enumerate(self._slow):
            view[:, :, channel] += slow.at(places)[:, :, None].astype(np.complex64)
        return found
