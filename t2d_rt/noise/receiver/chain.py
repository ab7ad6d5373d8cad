"""Passes an ADC cube through a receiver model, block by block."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import fresnel

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.cube_storage import ScratchRows, block_rows
from t2d_rt.core.cubes import Cube, DiskCube, column_sums
from t2d_rt.core.errors import InputError, warn
from t2d_rt.noise.receiver.draws import Draws, group_rows
from t2d_rt.noise.receiver.flicker import Flicker
from t2d_rt.noise.receiver.phase_noise import SMALL_ANGLE_RAD, PhaseNoise, residual_rms_rad
from t2d_rt.noise.receiver.processes import TimeSlots
from t2d_rt.noise.receiver.samples import Received, Stages, through
from t2d_rt.types import Radar, Receiver
from t2d_rt.types.receiver import Interferer


def dc_offsets(radar: Radar, level_dbm: float, draws: Draws) -> np.ndarray:
    """DC offset of each antenna, complex64 (antenna,): a constant for each receive channel, with a random phase."""
    slots = TimeSlots(radar)
    phase = 2 * math.pi * draws.of("DC offset").random(slots.channels)
    constant = math.sqrt(10 ** ((level_dbm - 30) / 10)) * np.exp(1j * phase)
    return np.tile(constant, slots.per_row).astype(np.complex64)


Effect = Callable[[np.ndarray, int], np.ndarray]
"""Function from samples (row, antenna, sample) and the index of their first row, which must be the first of a group, to samples
with the effect; it returns the same array where they do not change."""


@lru_cache(maxsize=16)
def check_receiver(radar: Radar, receiver: Receiver) -> None:
    """Refuses a receiver that does not fit this radar, before anything is simulated."""
    Effects(radar, receiver, Draws(0))


def receive(cube: Cube, radar: Radar, receiver: Receiver, seed: int) -> tuple[Cube, dict[str, Any]]:
    """Passes a cube (chirp, antenna, sample) [sqrt(W)] through a receiver; returns the cube, and its levels for the recording's
    settings.

    A cube in memory is changed in place; for one on disk a new one is written. The bits of a row do not depend on the blocks.
    seed: seed of the random draws, where the receiver has none of its own.
    """
    effects = Effects(radar, receiver, Draws(seed if receiver.seed is None else receiver.seed))
    levels = ReceiverLevels(receiver, radar, effects.offsets)
    result: Cube = DiskCube(ScratchRows(cube.shape)) if isinstance(cube, DiskCube) else cube
    rows = group_rows(math.prod(cube.shape[1:]))
    blocks = -(-block_rows(cube.shape) // rows) * rows
    for start in range(0, len(cube), blocks):
        block = np.ascontiguousarray(cube[start : start + blocks], np.complex64)
        received = effects.received(block, start, levels.reference(block))
        levels.add(block, received)
        result[start : start + len(block)] = received.samples
    levels.warn()
    _warn_of_angles(radar, receiver)
    return result, levels.described()


class Effects:
    """The effects of a receiver that are switched on, in order from the antenna to the ADC."""

    def __init__(self, radar: Radar, receiver: Receiver, draws: Draws) -> None:
        power_w = receiver.thermal_power_w(radar)
        self.first = list(_first_effects(radar, receiver, draws, power_w))
        self.flicker = None
        if receiver.flicker_corner_hz is not None:
            self.flicker = Flicker(radar, receiver.flicker_density_w(radar), receiver.flicker_corner_hz, draws)
        self.offsets = np.zeros(radar.antennas, np.complex64)
        if receiver.dc_offset_dbm is not None:
            self.offsets = dc_offsets(radar, receiver.dc_offset_dbm, draws)
        self.stages = Stages(
            draws=draws,
            thermal_w=power_w,
            imbalance=receiver.iq_imbalance,
            adc=receiver.adc,
            flicker=self.flicker.filter if self.flicker else None,
            flicker_w=self.flicker.power_w if self.flicker else 0.0,
        )

    def received(self, block: np.ndarray, first_row: int, reference: np.ndarray) -> Received:
        """A block of rows, which begins with the first one of a group, after all effects."""
        changed = block
        for effect in self.first:
            changed = effect(changed, first_row)
        slow = np.zeros(block.shape[:2], np.complex64)
        if self.flicker:
            slow = self.flicker.slow(first_row, len(block))
        return through(self.stages, first_row, block, changed, slow, self.offsets, reference)


def _warn_of_angles(radar: Radar, receiver: Receiver) -> None:
    """Warns of phase noise that is so strong that its mask no longer describes small angles."""
    if receiver.phase_noise is None:
        return
    rms_rad = residual_rms_rad(radar, receiver.phase_noise)
    if rms_rad > SMALL_ANGLE_RAD:
        warn(
            f"phase noise leaves up to {rms_rad:.2g} rad rms within the range axis, and its levels L(f) hold for small angles, "
            f"up to {SMALL_ANGLE_RAD:g} rad; lower phase_noise, or take its side bands for estimates"
        )


def _first_effects(radar: Radar, receiver: Receiver, draws: Draws, thermal_w: float) -> Iterator[Effect]:
    """Effects before those that act on single samples: phase noise of the oscillator, then the interferers in their order."""
    if receiver.phase_noise is not None:
        yield PhaseNoise(radar, receiver.phase_noise, draws, thermal_w=thermal_w)
    for number, interferer in enumerate(receiver.interferers):
        yield Interference(radar, interferer, draws, number)


SILENT = 1e-13
"""Power relative to that of all samples below which a figure is only rounding."""

DB_PER_BIT = 20 * math.log10(2)
MOST_LOST = 0.9
"""Fraction of the samples with the value of the offset alone, from which the step of the converters counts as too coarse. It is
reached by Gaussian noise of a quarter step, with which weak echoes become 7 dB weaker; with half a step they keep their level."""


@dataclass(slots=True)
class Power:
    """Running sums for the mean power of samples (row, antenna, sample) [sqrt(W)], and for the power of their mean over the
    rows."""

    reference: np.ndarray | float = 0.0
    """Value, (antenna, sample) or broadcast to that, which is subtracted before powers are summed."""
    count: int = 0
    """Number of samples."""
    rows: int = 0
    sum_w: float = 0.0
    """Sum of |sample - reference|^2 [W]."""
    total: Any = 0.0
    """Sum over the rows, complex128 (antenna, sample)."""

    def add(self, shape: tuple[int, ...], sums_w: np.ndarray, total: np.ndarray) -> None:
        """Adds rows of samples (row, antenna, sample), given as sums of powers about the reference and as sums over the rows."""
        self.rows += shape[0]
        self.count += math.prod(shape)
        self.sum_w += float(sums_w.sum(dtype=np.float64))
        self.total = self.total + total

    @property
    def static_w(self) -> float:
        """Power of the mean over the rows, that is of what is static [W]."""
        return float(np.mean(np.abs(self.total / self.rows) ** 2))

    @property
    def moving_w(self) -> float:
        """Power of what changes from row to row [W]."""
        departure = self.total / self.rows - self.reference
        return self.sum_w / self.count - float(np.mean(np.abs(departure) ** 2)) if self.rows > 1 else 0.0

    @property
    def mean_w(self) -> float:
        """Mean power of all samples [W]."""
        return self.static_w + max(self.moving_w, 0.0)


@dataclass(slots=True)
class ReceiverLevels:
    """Power of the samples before a receiver, and of what it adds to them."""

    receiver: Receiver
    radar: Radar
    offsets: np.ndarray
    """DC offset that is added to each sample, (antenna,)."""
    clean: Power = field(init=False)
    added: Power = field(init=False)
    """Power of the difference between the samples after and before the receiver, without the offsets."""
    clipped: int = 0
    peak: float = 0.0
    """Greatest |I| or |Q| before the converters [sqrt(W)]."""
    input_w: float = 0.0
    """Sum of the powers of the samples before the converters, without the offsets [W]."""
    lost: int = 0
    """Number of samples that are rounded to what the offset alone would give."""

    def __post_init__(self) -> None:
        self.clean, self.added = Power(), Power(self.offsets[:, None])

    def reference(self, clean: np.ndarray) -> np.ndarray:
        """The first row of the record, which is subtracted from clean samples (row, antenna, sample) before their powers are
        summed.

        So small changes of strong samples are not lost to rounding.
        """
        if not self.clean.rows:
            self.clean.reference = clean[0].copy()
        return np.asarray(self.clean.reference)

    def add(self, clean: np.ndarray, received: Received) -> None:
        """Adds rows before and after the receiver to the sums."""
        before, after = column_sums(clean), column_sums(received.samples)
        self.clean.add(clean.shape, received.clean_w, before)
        self.added.add(clean.shape, received.added_w, after - before)
        self.note(received)

    def note(self, received: Received) -> None:
        """Adds what the converters did to the sums."""
        self.peak = max(self.peak, float(received.peak.max()))
        self.input_w += float(received.input_w.sum(dtype=np.float64))
        self.lost += int(received.lost.sum(dtype=np.float64))
        self.clipped += int(received.clipped.sum(dtype=np.float64))

    def described(self) -> dict[str, Any]:
        """The levels by their names in a recording's settings; those that are not known are left out."""
        settings: dict[str, Any] = {"noise": ", ".join(self.receiver.effects) or "none"}
        floor_w = self.receiver.noise_floor_w(self.radar)
        if floor_w > 0:
            settings["noise_floor_dbm"] = _db(floor_w) + 30
        if not self.clean.count:
            return settings
        clean_w, all_w = self.clean.mean_w, self.clean.mean_w + self.added.mean_w
        moving_w, static_w = _heard(self.clean.moving_w, clean_w), _heard(self.clean.static_w, clean_w)
        noise_w = _heard(self.added.moving_w, all_w)
        if noise_w > 0:
            settings["noise_dbm"] = _db(noise_w) + 30
            if moving_w > 0:
                settings["snr_db"] = _db(moving_w / noise_w)
            if static_w > 0:
                settings["clutter_to_noise_db"] = _db(static_w / noise_w)
        if self.receiver.adc:
            peak_w = self.peak**2 / self.receiver.adc.full_scale_w
            settings |= {
                "adc_peak_dbfs": _db(peak_w) if peak_w > 0 else None,
                "clipped": self.clipped / self.clean.count,
            }
        return settings

    def warn(self) -> None:
        """Warns of saturation, and of a step that is too coarse for the input."""
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
    """The power, or 0 where it is only rounding."""
    return power_w if power_w > SILENT * all_w else 0.0


def _db(ratio: float) -> float:
    """A ratio of powers in decibels."""
    return 10 * math.log10(ratio)


PARALLEL_CYCLES = 1e-3
"""Chirps whose slopes differ by less than this many cycles over a chirp count as parallel: their difference is a tone."""
RINGING = 16
"""Number of samples beside a burst in which the ideal IF filter still rings."""
PHASES = 4096
"""Number of the other radar's chirps whose phases are drawn at once."""


class Interference:
    """Interference by the chirps of another radar, which all receivers hear over the line of sight (eq. 37)."""

    def __init__(self, radar: Radar, interferer: Interferer, draws: Draws, number: int) -> None:
        if radar.track is not None:
            raise InputError(
                "interferers are heard by radars that stand still; leave out interferers or the radar's track"
            )
        self._radar, self._interferer, self._draws = radar, interferer, draws
        self._slots, self._name = TimeSlots(radar), f"interferer {number}"
        apart = np.array(interferer.position_m) - radar.rx_positions_m
        ranges = np.linalg.norm(apart, axis=1)
        if ranges.min() < 1e-3:
            raise InputError(f"interferer at {interferer.position_m} m is at a receive antenna; move it away")
        direction = apart.mean(axis=0) / np.linalg.norm(apart.mean(axis=0)) @ radar.axes.T
        gain = 10 ** ((radar.rx_gain_dbi + radar.if_gain_db) / 10) * float(radar.rx_pattern.gain(direction))
        self.power_w = received_w(interferer.eirp_dbm, gain, radar.wavelength_m, float(ranges.mean()))
        phase = np.exp(2j * np.pi * radar.mid_frequency_hz / SPEED_OF_LIGHT * (ranges - ranges.mean()))
        channels = self._slots.channels
        self._channels = (math.sqrt(self.power_w) * np.resize(phase, channels)).astype(np.complex64)
        drawn_s = interferer.interval_s * draws.of(f"{self._name} start").random()
        self._first_s = drawn_s if interferer.first_s is None else interferer.first_s
        self._phases: dict[int, np.ndarray] = {}

    def __call__(self, samples: np.ndarray, first_row: int) -> np.ndarray:
        """Adds the bursts of interference to samples (row, antenna, sample) from a row on."""
        received = samples.astype(np.complex64)
        view = self._slots.by_slot(received)
        starts = self._slots.starts_s(first_row, len(samples))
        interferer, length = self._interferer, self._radar.sweep_time_s
        low = np.floor((starts - self._first_s - interferer.duration_s) / interferer.interval_s).astype(np.int64)
        if interferer.first_s is not None:
            low = np.maximum(low, 0)  # where the start is drawn, the other radar was already sending before the record
        high = np.floor((starts + length - self._first_s) / interferer.interval_s).astype(np.int64)
        for step in range(int((high - low).max(initial=-1)) + 1):
            chirp = low + step
            begins = self._first_s + chirp * interferer.interval_s - starts
            for row, slot in np.argwhere(chirp <= high).tolist():
                place, part = self.burst(float(begins[row, slot]))
                if len(part):
                    burst = part * self._phase(int(chirp[row, slot]))
                    view[row, slot, :, place] += self._channels[:, None] * burst.astype(np.complex64)
        return received

    def burst(self, begins_s: float) -> tuple[slice, np.ndarray]:
        """IF signal of a chirp that begins `begins_s` after the first ADC sample: which samples it reaches, and their values for a
        power of 1.

        Where the difference of both frequencies is f0 + slope t, the IF filter (ideal from 0 to the sample rate) passes a burst of
        duration rate / |slope|, given by Fresnel integrals between its edges.
        """
        radar, interferer, rate = self._radar, self._interferer, self._radar.sample_rate_hz
        slope = radar.slope_hz_per_s - interferer.slope_hz_per_s
        at_start_hz = radar.carrier_hz - interferer.carrier_hz + interferer.slope_hz_per_s * begins_s
        heard = [begins_s, begins_s + interferer.duration_s]
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
        """Random phase factor of a chirp of the other radar relative to this one's, as the phase of the other oscillator is not
        known."""
        part = chirp // PHASES
        if part not in self._phases:
            if len(self._phases) > 2:
                del self._phases[min(self._phases)]
            # Counters must not be negative, but where the start is drawn a chirp from before the record may be heard.
            self._phases[part] = self._draws.of(f"{self._name} phases", part + 1).random(PHASES)
        return complex(np.exp(2j * np.pi * self._phases[part][chirp % PHASES]))


def received_w(eirp_dbm: float, gain: float, wavelength_m: float, range_m: float) -> float:
    """Received power over a one-way path [W] by Friis: EIRP G (lambda / 4 pi R)^2."""
    return float(10 ** ((eirp_dbm - 30) / 10) * gain * (wavelength_m / (4 * math.pi * range_m)) ** 2)


def filtered_chirp(times_s: np.ndarray, slope_hz_per_s: float, bandwidth_hz: float) -> np.ndarray:
    """exp(j pi slope t^2) after an ideal filter from 0 to a bandwidth, complex, at times from the instant at which the frequency is
    0.

    Inverse transform of its spectrum exp(-j pi f^2 / slope) / sqrt(|slope|) between the edges, by Fresnel integrals (Klauder 1960).
    """
    scale = math.sqrt(2 / abs(slope_hz_per_s))
    sine, cosine = np.zeros((2, len(times_s))), np.zeros((2, len(times_s)))
    for edge, edge_hz in enumerate((0.0, bandwidth_hz)):
        sine[edge], cosine[edge] = fresnel(scale * (edge_hz - slope_hz_per_s * times_s))
    sign = math.copysign(1.0, slope_hz_per_s)
    between = (cosine[1] - cosine[0]) - 1j * sign * (sine[1] - sine[0])
    return np.asarray(np.exp(1j * np.pi * (slope_hz_per_s * times_s**2 + sign / 4)) / math.sqrt(2) * between)
