"""Spectra of the parts of a cube that may be added: complex, at some columns of their spectrograms."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.cubes import DiskCube, column_sums
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.signal.doppler import (
    PIECE,
    FastTime,
    checked_windows,
    sample_step,
    spectrogram,
    window_starts,
)
from t2d_rt.signal.range import taper
from t2d_rt.types.radar import Radar


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectraOfParts:
    """Short-time spectra of cubes that add up to one, at some columns of their spectrograms: complex, so that they may be added."""

    cubes: Sequence[Any]
    radar: Radar
    fast: FastTime
    starts: np.ndarray
    """First chirps of the columns' windows."""
    transform: np.ndarray
    """Window and Fourier transform to the speeds that are kept, complex64 (velocity, chirp)."""
    step: int
    """Of the samples that are read. Powers of single cubes are exact with it, products of two nearly so."""
    means: np.ndarray | None
    """Mean chirps, (cube, antenna, sample), where MTI takes them away."""
    velocity_mps: np.ndarray
    """Of the rows [m/s], (velocity,)."""

    @classmethod
    def of(
        cls, cubes: Sequence[Any], radar: Radar, rows: slice, most: int, processing: Mapping[str, Any]
    ) -> SpectraOfParts:
        """At `most` columns and some rows of the spectrogram that `processing` makes: mti none or mean, and no radar with "ddm"."""
        given = {name: each.default for name, each in inspect.signature(spectrogram).parameters.items()}
        given |= dict(processing)
        radar, chirps = radar.separated, len(cubes[0])
        fast = FastTime.of(radar, given["range_window"], given["range_gate_m"], given["combine"])
        n_window, overlap, n_fft = checked_windows(radar, chirps, given["n_window"], given["overlap"], given["n_fft"])
        starts = window_starts(chirps, radar.loops_per_frame or chirps, n_window, n_window - overlap)
        most_step = min(sample_step(each, given["range_window"], 0, chirps) for each in cubes) if fast.by_samples else 1
        step = max(each for each in range(1, most_step + 1) if radar.samples % each == 0)
        cycles = np.outer(np.fft.fftshift(np.fft.fftfreq(n_fft))[::-1][rows], np.arange(n_window))  # ascending speeds
        weights = taper(given["window"], n_window, periodic=True) / math.sqrt(fast.bandwidth_bins * cubes[0].shape[1])
        return cls(
            cubes=cubes,
            radar=radar,
            fast=fast,
            starts=starts[:: math.ceil(len(starts) / most)],
            transform=(weights * np.exp(-2j * np.pi * cycles)).astype(np.complex64),
            step=step,
            means=np.stack([mean_chirp(each) for each in cubes]) if given["mti"] == "mean" else None,
            velocity_mps=radar.speed_axis_mps(n_fft)[rows],
        )

    @property
    def time_s(self) -> np.ndarray:
        """Times of the columns [s], (column,)."""
        half_s = self.transform.shape[1] / 2 * self.radar.loop_interval_s
        return self.radar.chirp_starts_s(len(self.cubes[0]))[self.starts] + half_s

    def at(self, column: int) -> np.ndarray:
        """Spectra [sqrt(W)] (cube, velocity, antenna, cell) of one column; powers of cells add up to that of the spectrogram."""
        start, count, found = int(self.starts[column]), self.transform.shape[1], []
        steady = self.transform.sum(axis=1)[:, None, None]
        for place, cube in enumerate(self.cubes):
            if isinstance(cube, DiskCube):
                mixed = cube.mixed(self.transform, start, self.step)
            else:
                mixed = np.tensordot(self.transform, cube[start : start + count, :, :: self.step], 1)
            if self.means is not None:
                mixed -= steady * self.means[place, :, :: self.step]
            cells = self.fast.cells(mixed, self.step)
            found.append(cells.sum(axis=-1, keepdims=True) if self.fast.coherent else cells)
        return np.stack(found)

    def peaks(self, column: int, spectra: np.ndarray) -> np.ndarray:
        """Range [m], speed [m/s] and power [W] of each cube's strongest cell of the range-Doppler map at a column, (3, cube); NaN
        of cubes that are kept as samples. All bins must be used (`fast.by_samples`)."""
        from scipy import fft

        start, count = int(self.starts[column]), self.radar.samples // self.step
        maps = fft.fft(spectra, count, axis=-1)
        powers = (maps.real**2 + maps.imag**2).sum(axis=2) * (self.step * self.fast.bandwidth_bins / self.radar.samples)
        found = np.full((3, len(self.cubes)), np.nan, np.float32)
        for each, (cube, power) in enumerate(zip(self.cubes, powers, strict=True)):
            if isinstance(cube, DiskCube) and isinstance(cube.rows, ProductRows):
                row, place = np.unravel_index(power.argmax(), power.shape)
                if self.step > 1:  # bins repeat: that one is meant which is the first from the least beat on
                    low, _ = cube.rows.phases(start, start + self.transform.shape[1])
                    first = low / np.pi * self.radar.samples / (self.radar.samples - 1) - 1
                    place += math.ceil((first - place) / count) * count
                range_m = self.radar.range_axis_m()
                found[:, each] = range_m[place % len(range_m)], self.velocity_mps[row], power.max()
        return found


def mean_chirp(adc: Any) -> np.ndarray:
    """Mean of a cube (chirp, antenna, sample) over its chirps, complex64; of one that holds products by these."""
    if isinstance(adc, DiskCube) and isinstance(adc.rows, ProductRows):
        return (adc.rows.column_sums() / len(adc)).astype(np.complex64)
    blocks = (np.asarray(adc[start : start + PIECE]) for start in range(0, len(adc), PIECE))
    return np.asarray(sum(column_sums(each) for each in blocks) / len(adc)).astype(np.complex64)
