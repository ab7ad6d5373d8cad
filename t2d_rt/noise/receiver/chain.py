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
from t2d_rt.noise.receiver.phase_noise import PhaseNoise
from t2d_rt.rows import ScratchRows, block_rows
from t2d_rt.types import Radar, Receiver

Effect = Callable[[np.ndarray, int], np.ndarray]
"""Samples (row, antenna, sample) of a group and its number -> samples."""
SILENT = 1e-13
"""Fraction of the static power below which what moves is rounding."""


@dataclass(slots=True)
class Levels:
    """Powers of the samples before and after a receiver."""

    receiver: Receiver
    radar: Radar
    samples: int = 0
    energy_w: float = 0.0
    clipped: int = 0
    peak: float = 0.0
    """Greatest |I| or |Q| before the converters [sqrt(W)]."""
    total: Any = field(default=0.0)
    """Sum over the rows, complex128 (antenna, sample)."""
    rows: int = 0

    def add(self, clean: np.ndarray) -> None:
        """Counts samples before the receiver."""
        self.rows += len(clean)
        self.samples += clean.size
        parts = np.ascontiguousarray(clean).view(np.float32).ravel().astype(np.float64)
        self.energy_w += float(np.einsum("i,i->", parts, parts))  # BLAS would round by the number of its threads
        self.total = self.total + clean.sum(axis=0, dtype=np.complex128)

    def described(self) -> dict[str, Any]:
        """For a recording's settings."""
        found: dict[str, Any] = {"noise": ", ".join(self.receiver.effects) or "none"}
        floor_w = self.receiver.noise_floor_w(self.radar)
        if floor_w > 0:
            found["noise_floor_dbm"] = _db(floor_w) + 30
        if self.samples and floor_w > 0:
            mean_w = self.energy_w / self.samples
            static_w = float(np.mean(np.abs(self.total / self.rows) ** 2))
            moving_w = mean_w - static_w
            if moving_w > SILENT * mean_w and self.rows > 1:
                found["snr_db"] = _db(moving_w / floor_w)
            if static_w > SILENT * mean_w:
                found["clutter_to_noise_db"] = _db(static_w / floor_w)
        if self.receiver.adc and self.samples:
            peak_w = self.peak**2 / self.receiver.adc.full_scale_w
            found |= {"adc_peak_dbfs": _db(peak_w) if peak_w > 0 else None, "clipped": self.clipped / self.samples}
        return found

    def warn(self) -> None:
        """Tells of saturation."""
        if self.clipped:
            over_db = 20 * math.log10(self.peak / math.sqrt(self.receiver.adc.full_scale_w))  # type: ignore[union-attr]
            warnings.warn(
                f"the ADC is saturated: {100 * self.clipped / self.samples:.3g} % of the samples are clipped, the highest by "
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
    levels = Levels(receiver, radar)
    effects = list(_effects(radar, receiver, draws))
    result: Cube = DiskCube(ScratchRows(cube.shape)) if isinstance(cube, DiskCube) else cube
    rows = group_rows(math.prod(cube.shape[1:]))
    blocks = -(-block_rows(cube.shape) // rows) * rows
    for start in range(0, len(cube), blocks):
        block = np.asarray(cube[start : start + blocks], np.complex64)
        levels.add(block)
        received = [
            _group(block[first : first + rows], (start + first) // rows, effects, levels)
            for first in range(0, len(block), rows)
        ]
        result[start : start + len(block)] = np.concatenate(received)
    levels.warn()
    return result, levels.described()


def _greatest(samples: np.ndarray) -> float:
    """Greatest |I| or |Q|."""
    parts = np.ascontiguousarray(samples).view(np.float32)
    return max(float(parts.max(initial=0.0)), -float(parts.min(initial=0.0)))


def _group(samples: np.ndarray, number: int, effects: list[Effect], levels: Levels) -> np.ndarray:
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
