"""Stationary Gaussian noise of any spectrum, sampled by chirps with gaps between them.

Components faster than a chirp are drawn for each chirp independently: their spectrum is smooth over the PRF, so that chirps are
uncorrelated. Slower components are one value per chirp, from a process on the grid of the PRF that is drawn in overlapping
segments, so that any part of it can be computed without what comes before.

Every row of the cube is one time slot; with "tdm" there is one for each transmitter (`TimeSlots`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from t2d_rt.noise.receiver.draws import Draws, group_rows
from t2d_rt.types import Radar


@dataclass(frozen=True, slots=True)
class TimeSlots:
    """The time slots of a radar. A receive channel is a receiver, or with "simultaneous" each virtual antenna by itself."""

    radar: Radar

    @property
    def per_row(self) -> int:
        """Number of time slots in a row."""
        return self.radar.loop_chirps

    @property
    def channels(self) -> int:
        """Number of receive channels, each of which has independent noise."""
        return self.radar.antennas // self.per_row

    @property
    def group_rows(self) -> int:
        """Number of rows of the cube in a group."""
        return group_rows(self.radar.antennas * self.radar.samples)

    def numbers(self, first: int, rows: int) -> np.ndarray:
        """Indices, on a grid of the PRF, of the slots of `rows` rows from `first` on, (row, slot)."""
        return np.rint(self.starts_s(first, rows) * self.radar.prf_hz).astype(np.int64)

    def starts_s(self, first: int, rows: int) -> np.ndarray:
        """Times of the first ADC samples of the slots [s], (row, slot)."""
        radar = self.radar
        row = np.arange(first, first + rows)
        if radar.loops_per_frame is None or radar.frame_interval_s is None:
            starts = row * radar.loop_interval_s
        else:
            frame, within = np.divmod(row, radar.loops_per_frame)
            starts = frame * radar.frame_interval_s + within * radar.loop_interval_s
        return np.asarray(starts[:, None] + np.arange(self.per_row) / radar.prf_hz)

    def by_slot(self, samples: np.ndarray) -> np.ndarray:
        """Samples (row, antenna, sample) as a view (row, slot, channel, sample)."""
        return samples.reshape(len(samples), self.per_row, self.channels, samples.shape[2])


Density = Callable[[np.ndarray], np.ndarray]
"""Two-sided power density [1/Hz] as a function of frequency [Hz]. It must be hashable, as it is the key of a cache: equal ones are
taken to be the same."""
SEGMENT = 4096
"""Number of chirps in a segment; slower noise than one cycle per segment is left out."""
FOLDED = 4
"""A spectrum is aliased bin by bin up to this multiple of the PRF; beyond that it is taken to be smooth over the PRF."""
OVERSAMPLED = 8
"""Number of frequencies over which a density is averaged within a bin."""


def bin_powers(density: Density, width_hz: float, numbers: np.ndarray) -> np.ndarray:
    """Power of a density in frequency bins centred at `numbers` times a width, by midpoint sums."""
    parts = (np.arange(OVERSAMPLED) + 0.5) / OVERSAMPLED - 0.5
    return np.asarray(density((numbers[:, None] + parts) * width_hz).mean(axis=1) * width_hz)


@dataclass(frozen=True)
class Slow:
    """Noise with one value per slot: a real or complex process with all frequencies below `limit_hz`; those above PRF / 2 are
    aliased."""

    density: Density
    prf_hz: float
    limit_hz: float
    draws: Draws
    name: str
    _spectra: dict[int, np.ndarray] = field(default_factory=dict)

    def greatest(self) -> float:
        """Greatest density over frequency, times the PRF: the power of white noise that is nowhere below it."""
        return float(self._powers.max() * SEGMENT)

    def at(self, numbers: np.ndarray) -> np.ndarray:
        """Complex values at slots, given by their indices; real and imaginary part are independent processes of half the power
        each."""
        half = SEGMENT // 2
        # Every slot lies in two segments, whose squared windows add up to 1.
        first = numbers // half
        values = np.zeros(numbers.shape, complex)
        for segment in np.unique(np.concatenate([first.ravel(), first.ravel() + 1])).tolist():
            place = numbers - (segment - 1) * half
            inside = (place >= 0) & (place < SEGMENT)
            window = np.sin(np.pi * (place[inside] + 0.5) / SEGMENT)
            values[inside] += window * self._segment(segment)[place[inside]]
        return values

    def _segment(self, number: int) -> np.ndarray:
        """The numbers of a segment, (SEGMENT,); three segments are cached, which is enough for blocks of rows in order."""
        if number not in self._spectra:
            if len(self._spectra) > 2:
                del self._spectra[min(self._spectra)]
            spectrum = np.sqrt(self._powers) * self.draws.normal(self.name, number, (SEGMENT,))
            self._spectra[number] = np.fft.fft(spectrum)
        return self._spectra[number]

    @property
    def _powers(self) -> np.ndarray:
        return _slot_powers(self.density, self.prf_hz, self.limit_hz)


@lru_cache(maxsize=16)
def _slot_powers(density: Density, prf_hz: float, limit_hz: float) -> np.ndarray:
    """Power in each bin of a segment's FFT; 0 at frequency 0."""
    width, near_hz = prf_hz / SEGMENT, min(limit_hz, FOLDED * prf_hz)
    count = max(1, round(near_hz / width))
    number = np.concatenate([np.arange(-count, 0), np.arange(1, count + 1)])
    folded = np.bincount(number % SEGMENT, bin_powers(density, width, number), minlength=SEGMENT)
    powers = np.asarray(folded, float)
    if limit_hz > near_hz:
        beyond = np.geomspace(near_hz, limit_hz, 1000)
        powers += 2 * np.trapezoid(density(beyond), beyond) / SEGMENT
    powers.setflags(write=False)
    return powers


@dataclass(frozen=True)
class Fast:
    """Noise within chirps, with frequencies above `lowest_hz`; by FFTs of twice the samples, so that it is not periodic in a
    chirp."""

    density: Density
    samples: int
    rate_hz: float

    @property
    def length(self) -> int:
        """Number of points of the FFT."""
        return 2 * self.samples

    @property
    def lowest_hz(self) -> float:
        """Frequency [Hz] below which noise is that of `Slow`."""
        return self.rate_hz / self.length / 2

    def amplitudes(self) -> np.ndarray:
        """Root of the power in each bin of the FFT, in the order of `numpy.fft.fftfreq`; 0 at frequency 0."""
        number = np.fft.fftfreq(self.length, 1 / self.length)
        powers = bin_powers(self.density, self.rate_hz / self.length, number)
        powers[0] = 0.0
        return np.sqrt(powers)
