"""1/f noise at IF, which falls by 10 dB per decade and equals thermal noise at its corner frequency.

Within a chirp it is white noise through a recursive filter of a few poles; components slower than a chirp are one value per chirp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.noise.receiver.draws import Draws
from t2d_rt.noise.receiver.processes import Slow, TimeSlots
from t2d_rt.types import Radar

FEWEST_POLES, MOST_SAMPLES = 3, 100_000
"""Least number of poles of the filter, and greatest number of samples in a chirp: with more samples the fit of the filter fails by
2 dB."""
FREQUENCIES = 160
"""Number of frequencies at which the filter is fitted."""
OVERLAP = 2
"""Up to this multiple of the filter's lowest frequency, the noise that the filter lacks is added as noise from chirp to chirp."""


@dataclass(frozen=True)
class Filter:
    """A sum of one-pole filters, y = sum s_i with s_i[n] = p_i s_i[n - 1] + c_i w[n], w white of power 1, and the distribution of
    their initial state."""

    poles: np.ndarray
    """Poles p_i, real, (pole,)."""
    gains: np.ndarray
    """Gains c_i, (pole,)."""
    begin: np.ndarray
    """Lower triangular matrix (pole, pole) from independent numbers of power 1 to the stationary state before the first sample."""

    def correlation(self, count: int) -> np.ndarray:
        """Autocorrelation of the filter's noise: mean of y[n + m] conj(y[n]) for m = 0, 1, ..., (count,)."""
        state = np.outer(self.gains, self.gains) / (1 - np.outer(self.poles, self.poles))
        return np.asarray(state.sum(axis=0) @ self.poles[:, None] ** np.arange(count))

    def density(self, frequency: np.ndarray) -> np.ndarray:
        """Power density of the filter's noise at frequencies [cycles per sample] (K,): |sum c_i / (1 - p_i e^(-2 pi j f))|^2."""
        delay = np.exp(-2j * np.pi * frequency)[:, None]
        return np.asarray(np.abs((self.gains / (1 - self.poles * delay)).sum(axis=1)) ** 2)


@lru_cache(maxsize=16)
def filter_of(samples: int) -> Filter:
    """The filter whose noise has the density 1 / |f| [1 / (cycles per sample)], within 0.15 dB, from a quarter of a cycle per chirp
    of `samples` samples up to half a cycle per sample; below that it levels off."""
    from scipy.optimize import least_squares

    lowest = 1 / (4 * samples)
    count = max(FEWEST_POLES, math.ceil(math.log2(samples) / 2))
    near_half = 0.5 - np.geomspace(1e-3, 0.2, FREQUENCIES // 8)
    frequency = np.unique(np.concatenate([np.geomspace(lowest, 0.5, FREQUENCIES), near_half]))
    first = np.geomspace(1.2 * lowest, 0.3, count)
    start = np.concatenate(
        [[0.0], np.log(2 * np.pi * first), np.log(2 * np.pi * np.sqrt(first[1:] * first[:-1])), [-0.3, -0.5]]
    )
    start[0] -= _error(start, frequency).mean()
    # Rounded, because the last bits of a fit differ from machine to machine.
    fit = np.round(least_squares(_error, start, method="lm", args=(frequency,)).x, 6)
    poles, zeros = _roots(fit)
    # Partial fractions: there is one zero less than there are poles.
    apart = poles[:, None] - poles + np.eye(len(poles))
    gains = math.exp(fit[0] / 2) * (poles[:, None] - zeros).prod(axis=1) / apart.prod(axis=1)
    covariance = np.outer(gains, gains) / (1 - np.outer(poles, poles))
    return Filter(poles, gains, np.linalg.cholesky(covariance))


def _roots(fitted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poles, and one zero less: progressively farther from 1, and one pair near -1 that keeps the slope up to half a cycle per
    sample."""
    falling, pair = np.exp(-np.exp(fitted[1:-2])), np.tanh(fitted[-2:])
    count = (len(falling) + 1) // 2
    return np.append(falling[:count], pair[0]), np.append(falling[count:], pair[1])


def _error(fitted: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Logarithm (ln) of the filter's density over 1 / f, at frequencies [cycles per sample]."""
    cosine = np.cos(2 * np.pi * frequency)[:, None]
    poles, zeros = (np.log(1 - 2 * root * cosine + root**2).sum(axis=1) for root in _roots(fitted))
    return np.asarray(fitted[0] + zeros - poles + np.log(frequency))


@dataclass(frozen=True, slots=True)
class _SlowFlicker:
    """Density [W/Hz], over frequency [Hz], of the 1/f noise that the filter lacks."""

    power_w: float
    rate_hz: float
    samples: int

    def __call__(self, frequency_hz: np.ndarray) -> np.ndarray:
        frequency = np.maximum(np.abs(frequency_hz), 1e-9) / self.rate_hz
        density = 1 / frequency - filter_of(self.samples).density(frequency.ravel()).reshape(frequency.shape)
        return np.asarray(self.power_w / self.rate_hz * np.maximum(density, 0.0))


class Flicker:
    """1/f noise with the density of thermal noise times corner / |f|, independent in each receive channel (eq. 36)."""

    def __init__(self, radar: Radar, density_w: float, corner_hz: float, draws: Draws) -> None:
        if radar.samples > MOST_SAMPLES:
            raise InputError(
                f"1/f noise is made for chirps of up to {MOST_SAMPLES} samples, got {radar.samples}; take fewer, or leave "
                "flicker_corner_hz out"
            )
        self.filter = filter_of(radar.samples)
        rate = radar.sample_rate_hz
        self.power_w = density_w * corner_hz
        """Factor on the power of the filter's noise [W]: its density 1 / |f'| over f' = f / rate is 1 / |f| over f [Hz]."""

        self._slots = TimeSlots(radar)
        limit_hz = OVERLAP * rate / (4 * radar.samples)
        self._slow = [
            Slow(
                _SlowFlicker(self.power_w, rate, radar.samples),
                radar.prf_hz,
                limit_hz,
                draws,
                f"flicker of slots {channel}",
            )
            for channel in range(self._slots.channels)
        ]

    def slow(self, first_row: int, rows: int) -> np.ndarray:
        """Noise that changes only from chirp to chirp, complex64 (row, antenna), for rows from `first_row` on."""
        places = self._slots.numbers(first_row, rows)
        values = np.stack([slow.at(places) for slow in self._slow], axis=2)  # (row, slot, channel)
        return values.reshape(rows, -1).astype(np.complex64)
