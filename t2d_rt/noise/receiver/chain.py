"""An ADC cube through a receiver, block by block."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from t2d_rt.cubes import Cube, DiskCube
from t2d_rt.errors import T2DWarning
from t2d_rt.noise.receiver.adc import quantised
from t2d_rt.noise.receiver.draws import Draws, group_rows
from t2d_rt.noise.receiver.flicker import Flicker
from t2d_rt.noise.receiver.front_end import dc_offsets, imbalanced
from t2d_rt.noise.receiver.interference import Interference
from t2d_rt.noise.receiver.phase_noise import SMALL_ANGLE_RAD, PhaseNoise, residual_rms_rad
from t2d_rt.rows import ScratchRows, block_rows
from t2d_rt.types import Radar, Receiver

Effect = Callable[[np.ndarray, int], np.ndarray]
"""Samples (row, antenna, sample) of a group and its number -> samples."""
SILENT = 1e-13
"""Fraction of the static power below which what moves is rounding."""


@dataclass(slots=True)
class Power:
    """Running sums for the mean power of samples (row, antenna, sample) [sqrt(W)], and for that of their mean over the rows."""

    count: int = 0
    """Samples."""
    rows: int = 0
    sum_w: float = 0.0
    """Sum of |sample|^2 [W]."""
    total: Any = 0.0
    """Sum over the rows, complex128 (antenna, sample)."""

    def add(self, samples: np.ndarray) -> None:
        """Counts samples (row, antenna, sample), complex64."""
        self.rows += len(samples)
        self.count += samples.size
        parts = np.ascontiguousarray(samples).view(np.float32).ravel().astype(np.float64)
        self.sum_w += float(np.einsum("i,i->", parts, parts))  # BLAS would round by the number of its threads
        self.total = self.total + samples.sum(axis=0, dtype=np.complex128)

    @property
    def static_w(self) -> float:
        """Power of the mean over the rows [W]; 0 where it is rounding."""
        found = float(np.mean(np.abs(self.total / self.rows) ** 2))
        return found if found > SILENT * self.sum_w / self.count else 0.0

    @property
    def moving_w(self) -> float:
        """Power of what changes from row to row [W]; 0 where it is rounding, or nothing can."""
        mean_w = self.sum_w / self.count
        found = mean_w - float(np.mean(np.abs(self.total / self.rows) ** 2))
        return found if found > SILENT * mean_w and self.rows > 1 else 0.0


@dataclass(slots=True)
class ReceiverLevels:
    """Powers of the samples before a receiver, and of what it adds to them."""

    receiver: Receiver
    radar: Radar
    clean: Power = field(default_factory=Power)
    added: Power = field(default_factory=Power)
    """Of the samples after the receiver less those before it."""
    clipped: int = 0
    peak: float = 0.0
    """Greatest |I| or |Q| before the converters [sqrt(W)]."""

    def described(self) -> dict[str, Any]:
        """For a recording's settings."""
        found: dict[str, Any] = {"noise": ", ".join(self.receiver.effects) or "none"}
        floor_w = self.receiver.noise_floor_w(self.radar)
        if floor_w > 0:
            found["noise_floor_dbm"] = _db(floor_w) + 30
        if not self.clean.count:
            return found
        noise_w, moving_w, static_w = self.added.moving_w, self.clean.moving_w, self.clean.static_w
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
        """Tells of saturation."""
        if self.clipped:
            over_db = 20 * math.log10(self.peak / math.sqrt(self.receiver.adc.full_scale_w))  # type: ignore[union-attr]
            warnings.warn(
                f"the ADC is saturated: {100 * self.clipped / self.clean.count:.3g} % of the samples are clipped, the highest by "
                f"{max(over_db, 0.0):.1f} dB; lower adc.gain_db or raise adc.full_scale_dbm, or move what is strongest away",
                T2DWarning,
                stacklevel=4,
            )


def check_receiver(radar: Radar, receiver: Receiver) -> None:
    """Refuses a receiver that this radar cannot have, before anything is simulated."""
    list(_effects(radar, receiver, Draws(0)))


def receive(cube: Cube, radar: Radar, receiver: Receiver, seed: int) -> tuple[Cube, dict[str, Any]]:
    """The cube (chirp, antenna, sample) [sqrt(W)] as a receiver gives it, and settings that tell its levels.

    A cube in memory is changed in place; of one on disk a new one is written. A row is the same bits whatever the blocks.
    seed: of what is drawn, where the receiver has none of its own.
    """
    draws = Draws(seed if receiver.seed is None else receiver.seed)
    levels = ReceiverLevels(receiver, radar)
    effects = list(_effects(radar, receiver, draws))
    result: Cube = DiskCube(ScratchRows(cube.shape)) if isinstance(cube, DiskCube) else cube
    rows = group_rows(math.prod(cube.shape[1:]))
    blocks = -(-block_rows(cube.shape) // rows) * rows
    for start in range(0, len(cube), blocks):
        block = np.asarray(cube[start : start + blocks], np.complex64)
        levels.clean.add(block)
        received = [
            _group(block[first : first + rows], (start + first) // rows, effects, levels)
            for first in range(0, len(block), rows)
        ]
        noisy = np.concatenate(received)
        levels.added.add(noisy - block)
        result[start : start + len(block)] = noisy
    levels.warn()
    _warn_of_angles(radar, receiver)
    return result, levels.described()


def _warn_of_angles(radar: Radar, receiver: Receiver) -> None:
    """Tells of phase noise that is too much for its mask to be one of small angles."""
    if receiver.phase_noise is None:
        return
    rms_rad = residual_rms_rad(radar, receiver.phase_noise.density)
    if rms_rad > SMALL_ANGLE_RAD:
        warnings.warn(
            f"phase noise leaves up to {rms_rad:.2g} rad rms within the range axis, and its levels L(f) hold for small angles, "
            f"up to {SMALL_ANGLE_RAD:g} rad; lower phase_noise, or take its side bands for estimates",
            T2DWarning,
            stacklevel=3,
        )


def _greatest(samples: np.ndarray) -> float:
    """Greatest |I| or |Q|."""
    parts = np.ascontiguousarray(samples).view(np.float32)
    return max(float(parts.max(initial=0.0)), -float(parts.min(initial=0.0)))


def _group(samples: np.ndarray, number: int, effects: list[Effect], levels: ReceiverLevels) -> np.ndarray:
    for effect in effects:
        samples = effect(samples, number)
    adc = levels.receiver.adc
    if adc:
        levels.peak = max(levels.peak, _greatest(samples))
        samples, clipped = quantised(samples, adc)
        levels.clipped += clipped
    return samples


def _effects(radar: Radar, receiver: Receiver, draws: Draws) -> Iterator[Effect]:
    """The effects that are on, from the antenna to the ADC."""
    power_w = receiver.thermal_power_w(radar)
    if receiver.phase_noise is not None:
        yield PhaseNoise(radar, receiver.phase_noise.density, draws, thermal_w=power_w)
    for number, other in enumerate(receiver.interferers):
        yield Interference(radar, other, draws, number)
    if power_w > 0:
        scale = np.float32(math.sqrt(power_w))
        yield lambda samples, number: samples + scale * draws.normal("thermal", number, samples.shape)
    imbalance = receiver.iq_imbalance
    if imbalance is not None:
        yield lambda samples, number: imbalanced(samples, imbalance)
    if receiver.flicker_corner_hz is not None:
        yield Flicker(radar, receiver.flicker_density_w(radar), receiver.flicker_corner_hz, draws)
    if receiver.dc_offset_dbm is not None:
        constant = dc_offsets(radar, receiver.dc_offset_dbm, draws)
        yield lambda samples, number: samples + constant


def _db(ratio: float) -> float:
    return 10 * math.log10(ratio)
