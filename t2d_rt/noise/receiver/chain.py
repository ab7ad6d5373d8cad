"""An ADC cube through a receiver, block by block."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from t2d_rt.core.cube_storage import ScratchRows, block_rows
from t2d_rt.core.cubes import Cube, DiskCube
from t2d_rt.core.errors import warn
from t2d_rt.noise.receiver.draws import Draws, group_rows
from t2d_rt.noise.receiver.flicker import Flicker
from t2d_rt.noise.receiver.interference import Interference
from t2d_rt.noise.receiver.levels import ReceiverLevels
from t2d_rt.noise.receiver.phase_noise import SMALL_ANGLE_RAD, PhaseNoise, residual_rms_rad
from t2d_rt.noise.receiver.processes import TimeSlots
from t2d_rt.noise.receiver.samples import Received, Stages, through
from t2d_rt.types import Radar, Receiver


def dc_offsets(radar: Radar, level_dbm: float, draws: Draws) -> np.ndarray:
    """A constant for each antenna, complex64 (antenna,): one of each receive channel, whose phase is drawn."""
    slots = TimeSlots(radar)
    phase = 2 * math.pi * draws.of("DC offset").random(slots.channels)
    constant = math.sqrt(10 ** ((level_dbm - 30) / 10)) * np.exp(1j * phase)
    return np.tile(constant, slots.per_row).astype(np.complex64)


Effect = Callable[[np.ndarray, int], np.ndarray]
"""Samples (row, antenna, sample) and the number of the first row, the first of a group -> samples, the same array where they stay
as they are."""


@lru_cache(maxsize=16)
def check_receiver(radar: Radar, receiver: Receiver) -> None:
    """Refuses a receiver that this radar cannot have, before anything is simulated."""
    _Receiver(radar, receiver, Draws(0))


def receive(cube: Cube, radar: Radar, receiver: Receiver, seed: int) -> tuple[Cube, dict[str, Any]]:
    """The cube (chirp, antenna, sample) [sqrt(W)] as a receiver gives it, and settings that tell its levels.

    A cube in memory is changed in place; of one on disk a new one is written. A row is the same bits whatever the blocks.
    seed: of what is drawn, where the receiver has none of its own.
    """
    effects = _Receiver(radar, receiver, Draws(seed if receiver.seed is None else receiver.seed))
    levels = ReceiverLevels(receiver, radar, effects.offsets)
    result: Cube = DiskCube(ScratchRows(cube.shape)) if isinstance(cube, DiskCube) else cube
    rows = group_rows(math.prod(cube.shape[1:]))
    blocks = -(-block_rows(cube.shape) // rows) * rows
    for start in range(0, len(cube), blocks):
        block = np.ascontiguousarray(cube[start : start + blocks], np.complex64)
        found = effects.received(block, start, levels.reference(block))
        levels.add(block, found)
        result[start : start + len(block)] = found.samples
    levels.warn()
    _warn_of_angles(radar, receiver)
    return result, levels.described()


class _Receiver:
    """The effects that are on, from the antenna to the ADC."""

    def __init__(self, radar: Radar, receiver: Receiver, draws: Draws) -> None:
        power_w = receiver.thermal_power_w(radar)
        self._first = list(_first_effects(radar, receiver, draws, power_w))
        self._flicker = None
        if receiver.flicker_corner_hz is not None:
            self._flicker = Flicker(radar, receiver.flicker_density_w(radar), receiver.flicker_corner_hz, draws)
        self.offsets = np.zeros(radar.antennas, np.complex64)
        if receiver.dc_offset_dbm is not None:
            self.offsets = dc_offsets(radar, receiver.dc_offset_dbm, draws)
        self._stages = Stages(
            draws=draws,
            thermal_w=power_w,
            imbalance=receiver.iq_imbalance,
            adc=receiver.adc,
            flicker=self._flicker.filter if self._flicker else None,
            flicker_w=self._flicker.power_w if self._flicker else 0.0,
        )

    def received(self, block: np.ndarray, first_row: int, reference: np.ndarray) -> Received:
        """A block of rows, from the first one of a group on, after all effects."""
        changed = block
        for effect in self._first:
            changed = effect(changed, first_row)
        slow = np.zeros(block.shape[:2], np.complex64)
        if self._flicker:
            slow = self._flicker.slow(first_row, len(block))
        return through(self._stages, first_row, block, changed, slow, self.offsets, reference)


def _warn_of_angles(radar: Radar, receiver: Receiver) -> None:
    """Tells of phase noise that is too much for its mask to be one of small angles."""
    if receiver.phase_noise is None:
        return
    rms_rad = residual_rms_rad(radar, receiver.phase_noise)
    if rms_rad > SMALL_ANGLE_RAD:
        warn(
            f"phase noise leaves up to {rms_rad:.2g} rad rms within the range axis, and its levels L(f) hold for small angles, "
            f"up to {SMALL_ANGLE_RAD:g} rad; lower phase_noise, or take its side bands for estimates"
        )


def _first_effects(radar: Radar, receiver: Receiver, draws: Draws, thermal_w: float) -> Iterator[Effect]:
    """What comes before the stages of each sample: phase noise of the oscillator, then the interferers in their order."""
    if receiver.phase_noise is not None:
        yield PhaseNoise(radar, receiver.phase_noise, draws, thermal_w=thermal_w)
    for number, other in enumerate(receiver.interferers):
        yield Interference(radar, other, draws, number)
