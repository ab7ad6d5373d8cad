"""Mutual interference: the chirps of another FMCW radar cross those of this one and leave bursts of linear FM at IF."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import fresnel

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.noise.receiver.draws import Draws
from t2d_rt.noise.receiver.processes import TimeSlots
from t2d_rt.types import Radar
from t2d_rt.types.receiver import Interferer

PARALLEL_CYCLES = 1e-3
"""Chirps whose slopes differ by less than so many cycles over a chirp are parallel: they leave a tone."""
RINGING = 16
"""Samples beside a burst in which the ideal IF filter still rings."""
PHASES = 4096
"""Chirps of the other radar whose phases are drawn at once."""


class Interference:
    """The chirps of one other radar, heard by all receivers over the line of sight (eq. 37)."""

    def __init__(self, radar: Radar, other: Interferer, draws: Draws, number: int) -> None:
        self._radar, self._other, self._draws = radar, other, draws
        self._slots, self._name = TimeSlots(radar), f"interferer {number}"
        apart = np.array(other.position_m) - radar.rx_positions_m
        ranges = np.linalg.norm(apart, axis=1)
        if ranges.min() < 1e-3:
            raise InputError(f"interferer at {other.position_m} m is at a receive antenna; move it away")
        direction = apart.mean(axis=0) / np.linalg.norm(apart.mean(axis=0)) @ radar.axes.T
        gain = 10 ** ((radar.rx_gain_dbi + radar.if_gain_db) / 10) * float(radar.rx_pattern.gain(direction))
        self.power_w = received_w(other.eirp_dbm, gain, radar.wavelength_m, float(ranges.mean()))
        phase = np.exp(2j * np.pi * radar.mid_frequency_hz / SPEED_OF_LIGHT * (ranges - ranges.mean()))
        channels = self._slots.channels
        self._channels = (math.sqrt(self.power_w) * np.resize(phase, channels)).astype(np.complex64)
        self._first_s = other.interval_s * draws.of(f"{self._name} start").random()
        self._phases: dict[int, np.ndarray] = {}

    def __call__(self, samples: np.ndarray, first_row: int) -> np.ndarray:
        """Samples (row, antenna, sample), from a row on, and the bursts in them."""
        found = samples.astype(np.complex64)
        view = self._slots.by_slot(found)
        starts = self._slots.starts_s(first_row, len(samples))
        other, length = self._other, self._radar.sweep_time_s
        low = np.floor((starts - self._first_s - other.duration_s) / other.interval_s).astype(np.int64)
        high = np.floor((starts + length - self._first_s) / other.interval_s).astype(np.int64)
        for step in range(int((high - low).max(initial=-1)) + 1):
            chirp = low + step
            begins = self._first_s + chirp * other.interval_s - starts
            for row, slot in np.argwhere(chirp <= high).tolist():
                place, part = self.burst(float(begins[row, slot]))
                if len(part):
                    burst = part * self._phase(int(chirp[row, slot]))
                    view[row, slot, :, place] += self._channels[:, None] * burst.astype(np.complex64)
        return found

    def burst(self, begins_s: float) -> tuple[slice, np.ndarray]:
        """What a chirp that begins so long after the first ADC sample leaves at IF: which samples, and these, of power 1.

        Where the two frequencies are f0 + slope t apart, the IF filter, ideal from 0 to the sample rate, lets through a burst of
        the length rate / |slope|: Fresnel integrals between its edges.
        """
        radar, other, rate = self._radar, self._other, self._radar.sample_rate_hz
        slope = radar.slope_hz_per_s - other.slope_hz_per_s
        at_start_hz = radar.carrier_hz - other.carrier_hz + other.slope_hz_per_s * begins_s
        heard = [begins_s, begins_s + other.duration_s]
        parallel = abs(slope) * radar.sweep_time_s**2 < PARALLEL_CYCLES
        if parallel:
            if not 0 <= at_start_hz + slope * radar.mid_time_s < rate:
                return slice(0), np.zeros(0)
        else:
            within = sorted((edge - at_start_hz) / slope for edge in (0.0, rate))
            heard = [max(heard[0], within[0] - RINGING / rate), min(heard[1], within[1] + RINGING / rate)]
        first, last = math.ceil(max(heard[0] * rate, 0)), math.floor(min(heard[1] * rate, radar.samples - 1))
        if first > last:
            return slice(0), np.zeros(0)
        times = np.arange(first, last + 1) / rate
        if parallel:
            return slice(first, last + 1), np.exp(2j * np.pi * at_start_hz * times)
        return slice(first, last + 1), filtered_chirp(times + at_start_hz / slope, slope, rate)

    def _phase(self, chirp: int) -> complex:
        """Phase factor of the other radar's chirp against this one's; it is drawn, since the other oscillator is not known."""
        part = chirp // PHASES
        if part not in self._phases:
            if len(self._phases) > 2:
                del self._phases[min(self._phases)]
            # Counters are not negative: a chirp may have begun before the record.
            self._phases[part] = self._draws.of(f"{self._name} phases", part + 1).random(PHASES)
        return complex(np.exp(2j * np.pi * self._phases[part][chirp % PHASES]))


def received_w(eirp_dbm: float, gain: float, wavelength_m: float, range_m: float) -> float:
    """Power over a one-way path [W] by Friis: EIRP G (lambda / 4 pi R)^2."""
    return float(10 ** ((eirp_dbm - 30) / 10) * gain * (wavelength_m / (4 * math.pi * range_m)) ** 2)


def filtered_chirp(times_s: np.ndarray, slope_hz_per_s: float, bandwidth_hz: float) -> np.ndarray:
    """exp(j pi slope t^2) through an ideal filter from 0 to a bandwidth, complex as times (from the crossing of frequency 0).

    Its spectrum exp(-j pi f^2 / slope) / sqrt(|slope|) between the edges, transformed back: Fresnel integrals (Klauder 1960).
    """
    scale = math.sqrt(2 / abs(slope_hz_per_s))
    sine, cosine = np.zeros((2, len(times_s))), np.zeros((2, len(times_s)))
    for edge, edge_hz in enumerate((0.0, bandwidth_hz)):
        sine[edge], cosine[edge] = fresnel(scale * (edge_hz - slope_hz_per_s * times_s))
    sign = math.copysign(1.0, slope_hz_per_s)
    between = (cosine[1] - cosine[0]) - 1j * sign * (sine[1] - sine[0])
    return np.asarray(np.exp(1j * np.pi * (slope_hz_per_s * times_s**2 + sign / 4)) / math.sqrt(2) * between)
