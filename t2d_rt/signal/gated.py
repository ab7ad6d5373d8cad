"""A range gate as a matrix over the samples of a chirp: its windowed range FFT at the gate's bins alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.signal.range import gate, taper
from t2d_rt.types.radar import Radar


@dataclass(frozen=True, slots=True, eq=False)
class RangeGate:
    """Which range cells of a radar are kept."""

    limits_m: tuple[float, float]
    """Nearest and farthest range [m]."""
    bins: slice
    """Numbers of the range bins."""
    window: str
    """Of the range FFT."""
    matrix: np.ndarray
    """What each sample adds to each cell, complex64 (sample, cell)."""

    @classmethod
    def of(cls, radar: Radar, limits_m: tuple[float, float], window: str = "hann") -> RangeGate:
        """The bins of a radar within limits, as `range_fft` makes them; raises InputError where there are none."""
        bins = gate(radar.range_axis_m(), limits_m)
        cycles = np.outer(np.arange(radar.samples), np.arange(bins.start, bins.stop)) % radar.samples / radar.samples
        matrix = taper(window, radar.samples)[:, None] * np.exp(-2j * np.pi * cycles)
        return cls(limits_m, bins, window, matrix.astype(np.complex64))

    @property
    def processing(self) -> dict[str, Any]:
        """Options of `spectrogram` that ask for these cells."""
        return {"range_gate_m": list(self.limits_m), "range_window": self.window}
