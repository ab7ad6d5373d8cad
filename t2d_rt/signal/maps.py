"""Results of the signal chain, with their axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeProfile:
    """Complex range profile of every chirp."""

    profile: np.ndarray
    """[sqrt(W)], complex (chirp, antenna, range) or (chirp, range)."""
    range_m: np.ndarray
    time_s: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class Spectrogram:
    """Micro-Doppler spectrogram."""

    power: np.ndarray
    """[W], (velocity, time)."""
    velocity_mps: np.ndarray
    """Ascending, positive = approaching, (velocity,)."""
    time_s: np.ndarray
    """Centres of the windows, (time,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeDoppler:
    """Range-Doppler map of one coherent interval."""

    power: np.ndarray
    """[W], (velocity, range)."""
    velocity_mps: np.ndarray
    """Ascending, positive = approaching, (velocity,)."""
    range_m: np.ndarray
