"""Phase noise of the oscillator that transmitter and receiver share: an echo of delay tau has the residual phase phi(t) - phi(t -
tau).

An ADC sample is a sum of echoes, each at the beat frequency S tau, so the range FFT of a chirp sorts them by delay. The factor
exp(j (phi(t) - phi(t - tau))) is computed at a few delays (nodes) and interpolated by polynomials in tau: a factor over time for
each node multiplies the chirp with its range bins weighted by the node's polynomial.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy import fft

from t2d_rt.core.backend import flat_on_device, one_thread_at_a_time, select
from t2d_rt.core.errors import InputError
from t2d_rt.noise.receiver.draws import Draws
from t2d_rt.noise.receiver.processes import Fast, Slow, TimeSlots
from t2d_rt.types import Radar
from t2d_rt.types.receiver import Leeson, Mask

Oscillator = Mask | Leeson

INTERPOLATION = 1e-3
"""Greatest error of the interpolation over delay, relative to the power of the residual phase noise at that delay."""
LEAST_SAMPLES = 16
"""Least number of samples in a chirp with which range bins can separate delays."""
MOST_NODES, MOST_WEIGHTS = 128, 20_000_000
"""Greatest number of nodes, and of nodes times samples of a chirp."""
RETURN = 1 / 8
"""Fraction of the range bins, the farthest ones, over which the delay returns to 0: they hold what leaks from the nearest ones."""
SMALL_ANGLE_RAD = 0.3
"""Greatest rms of the residual phase [rad] at which sidebands are still those of small angles; the carrier has then lost 0.4 dB to
them."""
TRIED = 200
"""Number of frequencies, and of delays, at which the interpolation and the level of phase noise are evaluated."""
NEGLIGIBLE = 1e-2
"""Rows are not changed where phase noise, at every frequency, is below thermal noise by this factor: 0.04 dB of the noise."""
BOUND_ORDER, BOUND_LEAST, ROUNDING = 2, 3e-3, 1e-5
"""For the sum of cosines that bounds the level: its highest order, the fraction of the greatest level below which it need not
follow the level, and the relative rounding error of float32 sums."""
SMALL_RAD = 0.05
"""Greatest phase [rad] for which exp(j phase) - 1 is evaluated as a series up to the fourth power, as exact as float32."""


@dataclass(frozen=True)
class _FrequencyNoise:
    """Density of the frequency noise 2 pi f phi [rad^2/s^2/Hz], over frequency [Hz], from the oscillator's L(f)."""

    oscillator: Oscillator

    def __call__(self, frequency_hz: np.ndarray) -> np.ndarray:
        return np.asarray((2 * np.pi * frequency_hz) ** 2 * self.oscillator.density(frequency_hz))


@dataclass(frozen=True, eq=False)
class _Design:
    """Everything about the phase noise of an oscillator in a radar that is the same for all random draws."""

    powers: np.ndarray
    """Power of the phase in each bin of an FFT with twice the samples of a chirp, from 0 to half the rate, (sample + 1,)."""
    nodes: Nodes
    delayed: np.ndarray
    """Phasors exp(-2 pi j f tau) for the nodes' delays and the bins' frequencies, (node, sample + 1)."""
    greatest: np.ndarray
    """For each range bin, the greatest density of the residual phase noise over beat or Doppler frequency, times the sample rate:
    the level of white noise that is nowhere below it, relative to the echo's power, (sample,)."""
    bound: np.ndarray
    """Coefficients of a sum of cosines that bounds `greatest` from above, as `bounding` returns them."""
    rate: Slow
    """Process of the frequency noise 2 pi f phi from chirp to chirp; a recording uses a copy with its own seed."""

    @classmethod
    def of(cls, radar: Radar, oscillator: Oscillator) -> _Design:
        """The design for a radar and its oscillator; raises InputError where chirps have too few samples to separate delays."""
        if radar.samples < LEAST_SAMPLES:
            raise InputError(
                f"phase noise is sorted by range, for which chirps need {LEAST_SAMPLES} samples or more, got {radar.samples}; take "
                "more, or leave phase_noise out"
            )
        fast = Fast(oscillator.density, radar.samples, radar.sample_rate_hz)
        powers = fast.amplitudes()[: radar.samples + 1] ** 2
        powers[-1] = 0.0  # phase of half the rate, for which a delay is not defined
        frequencies = np.arange(radar.samples + 1) * (radar.sample_rate_hz / fast.length)
        rate = Slow(_FrequencyNoise(oscillator), radar.prf_hz, fast.lowest_hz, Draws(0), "phase noise of slots")
        delays = bin_delays_s(radar)
        nodes = nodes_for(delays, frequencies, powers)
        delayed = np.exp(-2j * np.pi * np.outer(nodes.delays_s, frequencies))
        tried = _lower_ones(len(powers) - 1) + 1
        between = np.linspace(0, float(np.abs(delays).max()), TRIED)
        correlated = 4 * np.sin(np.pi * frequencies[tried] * between[:, None]) ** 2
        fastest = (correlated * (powers[tried] * (2 * radar.samples))).max(axis=1)
        slow = between**2 * rate.greatest() * radar.samples
        greatest = np.interp(np.abs(delays), between, np.maximum(fastest, slow))
        design = cls(powers, nodes, delayed, greatest, bounding(greatest), rate)
        for values in (powers, nodes.delays_s, nodes.weights, delayed, greatest, design.bound):
            values.setflags(write=False)  # cached for other recordings
        return design


_design = lru_cache(maxsize=16)(_Design.of)


class PhaseNoise:
    """Range-correlated phase noise of an oscillator with the density L(f) on both sides of the carrier (eq. 33, 34)."""

    def __init__(self, radar: Radar, oscillator: Oscillator, draws: Draws, *, thermal_w: float) -> None:
        self._slots, self._draws, self._thermal_w = TimeSlots(radar), draws, thermal_w
        self._design = _design(radar, oscillator)
        self._slow = replace(self._design.rate, draws=draws, _spectra={})

    def __call__(self, samples: np.ndarray, first_row: int) -> np.ndarray:
        """Adds phase noise to samples (row, antenna, sample) of echoes; the first row must be the first of a group. Returns the
        same array where phase noise is negligible."""
        noisy_samples, rows = samples, self._slots.group_rows
        may_count = self._may_count(samples)
        for start in range(0, len(samples), rows):
            group = slice(start, start + rows)
            some_rows = np.flatnonzero(may_count[group])
            spectrum = fft.fft(samples[group][some_rows], axis=2)
            counts = self._rows(spectrum)
            if counts.any():
                noisy_samples = samples.astype(np.complex64) if noisy_samples is samples else noisy_samples
                chosen = np.zeros(len(samples[group]), bool)
                chosen[some_rows[counts]] = True
                noisy = noisy_samples[group][chosen]
                self._add(noisy, spectrum[counts], self._phases((first_row + start) // rows, chosen))
                noisy_samples[group][chosen] = noisy
        return noisy_samples

    def _add(self, samples: np.ndarray, spectrum: np.ndarray, phases: np.ndarray) -> None:
        """Adds the phase noise to samples with the range spectrum `spectrum` (row, antenna, sample); `phases` (node, row, slot,
        sample) are the residual phases at the nodes."""
        view = self._slots.by_slot(samples)
        for weights, phase in zip(self._design.nodes.weights, phases, strict=True):
            part = fft.ifft(spectrum * weights.astype(np.float32), axis=2, overwrite_x=True)
            view += _factors(phase)[:, :, None] * self._slots.by_slot(part)

    def _phases(self, number: int, rows: np.ndarray) -> np.ndarray:
        """Residual phases phi(t) - phi(t - tau) [rad] at the nodes' delays, float32 (node, row, slot, sample), for some rows of a
        group."""
        count, design = self._slots.radar.samples, self._design
        drawn = self._draws.normal("phase noise", number, (len(rows), self._slots.per_row, len(design.powers)))[rows]
        drawn *= (2 * count * np.sqrt(design.powers)).astype(np.float32)
        # The real part of a complex process with a symmetric spectrum has half its power.
        places = self._slots.numbers(number * self._slots.group_rows, len(rows))[rows]
        rate = math.sqrt(2) * self._slow.at(places).real
        phases = np.empty((len(design.nodes.delays_s), *drawn.shape[:2], count), np.float32)
        for node, delayed, delay_s in zip(phases, design.delayed, design.nodes.delays_s, strict=True):
            node[:] = fft.irfft(drawn * (1 - delayed).astype(np.complex64), axis=2, overwrite_x=True)[:, :, :count]
            node += (delay_s * rate)[:, :, None].astype(np.float32)
        return phases

    def _may_count(self, samples: np.ndarray) -> np.ndarray:
        """Rows (row, antenna, sample) that `_rows` may select, from an upper bound of their levels that needs no spectra."""
        if self._thermal_w <= 0:
            return np.ones(len(samples), bool)
        levels = lags(samples, BOUND_ORDER) @ self._design.bound / samples.shape[2]
        return np.asarray(levels.max(axis=1) > NEGLIGIBLE * self._thermal_w)

    def may_count(self, power_w: float, bins: slice) -> bool:
        """Whether phase noise may matter in a row of that power whose beats lie within some range bins."""
        return power_w * float(self._design.greatest[bins].max(initial=0.0)) > NEGLIGIBLE * self._thermal_w

    def _rows(self, spectrum: np.ndarray) -> np.ndarray:
        """Selects the rows of a spectrum (row, antenna, sample) in which phase noise matters."""
        if self._thermal_w <= 0:
            return np.ones(len(spectrum), bool)
        # Summed instead of a matrix product, so that the bits do not depend on which rows there are.
        levels = (np.abs(spectrum) ** 2 * (self._design.greatest / spectrum.shape[2] ** 2)).sum(axis=2)
        return np.asarray(levels.max(axis=1) > NEGLIGIBLE * self._thermal_w)


def bounding(values: np.ndarray) -> np.ndarray:
    """Coefficients a_0, a_1, b_1, ... of a sum of a_m cos(2 pi m k / K) + b_m sin(2 pi m k / K) that bounds values (K,) from above.

    The bound exceeds the values by as small a fraction as possible.
    """
    from scipy.optimize import linprog

    angle = 2 * np.pi * np.arange(len(values)) / len(values)
    columns = [np.ones(len(values))]
    for order in range(1, BOUND_ORDER + 1):
        columns += [np.cos(order * angle), np.sin(order * angle)]
    matrix, greatest = np.stack(columns, axis=1), float(values.max())
    weights = greatest / (values + BOUND_LEAST * greatest)
    coefficients = linprog(weights @ matrix, A_ub=-matrix, b_ub=-values / greatest, bounds=(None, None)).x * greatest
    coefficients[0] += max(0.0, float((values - matrix @ coefficients).max())) + ROUNDING * greatest
    return np.asarray(coefficients, np.float32)


@lru_cache(maxsize=16)
def residual_rms_rad(radar: Radar, oscillator: Oscillator) -> float:
    """Greatest rms of the residual phase phi(t) - phi(t - tau) over the delays tau of the range axis [rad], from 2 L(f) 4 sin^2(pi
    f tau) (eq. 34)."""
    offset = np.geomspace(radar.prf_hz / 8192, radar.sample_rate_hz / 2, 4000)
    delays = np.linspace(0, float(np.abs(bin_delays_s(radar)).max()), 50)[:, None]
    values = 8 * oscillator.density(offset) * np.sin(np.pi * offset * delays) ** 2
    return math.sqrt(float(np.trapezoid(values * offset, np.log(offset), axis=1).max()))


def _factors(phase: np.ndarray) -> np.ndarray:
    """exp(j phase) - 1 for phases (row, ...) [rad], complex64, without loss of digits; the bits of a row do not depend on the
    others."""
    factors = np.empty(phase.shape, np.complex64)
    square = phase * phase
    factors.real = square * (square * np.float32(1 / 24) - np.float32(0.5))
    factors.imag = phase * (1 - square * np.float32(1 / 6))
    large = np.flatnonzero(square.reshape(len(phase), -1).max(axis=1, initial=0.0) > SMALL_RAD**2)
    if len(large):
        half = phase[large] / 2
        sine = np.sin(half)
        factors.real[large], factors.imag[large] = -2 * sine * sine, 2 * sine * np.cos(half)
    return factors


@dataclass(frozen=True, slots=True)
class Nodes:
    """Delays at which phase noise is computed, in addition to 0 where there is none, and the weight of each in a range bin."""

    delays_s: np.ndarray
    weights: np.ndarray
    """Lagrange polynomials of the nodes at the bins' delays, (node, sample)."""


def bin_delays_s(radar: Radar) -> np.ndarray:
    """Delay of each range bin [s], (sample,): its beat frequency over the slope, except in the last eighth of the bins.

    There it returns to 0 by a cubic, so that the delay is smooth on the circle of FFT bins. What leaks from an echo between two
    bins then gets nearly its delay, except for a few samples at the ends of the chirp.
    """
    bins = np.arange(radar.samples)
    delays = bins * (radar.sample_rate_hz / radar.samples / radar.slope_hz_per_s)
    last = math.floor(radar.samples * (1 - RETURN))
    x = (bins[last:] - last) / (radar.samples - last)
    step = delays[1] * (radar.samples - last)
    cubic = (2 * x**3 - 3 * x**2 + 1) * delays[last] + (2 * x**3 - 3 * x**2 + x) * step
    return np.concatenate([delays[:last], cubic])


def nodes_for(delays_s: np.ndarray, frequencies_hz: np.ndarray, powers: np.ndarray) -> Nodes:
    """The fewest nodes, of the numbers tried, that keep the interpolation's error below `INTERPOLATION` for noise with these powers
    at these frequencies, which begin at 0."""
    chosen = _lower_ones(len(powers) - 2) + 1  # neither frequency 0 nor half the sample rate
    frequencies, power = frequencies_hz[chosen][:, None], powers[chosen] * np.gradient(chosen.astype(float))
    straight = np.unique(np.linspace(1, math.floor(len(delays_s) * (1 - RETURN)) - 1, TRIED).astype(int))
    exact = 1 - np.exp(-2j * np.pi * frequencies * delays_s[straight])
    greatest, count = float(delays_s.max()), 0
    while True:
        count = count + 1 if count < 8 else count + count // 4
        if count > MOST_NODES or count * len(delays_s) > MOST_WEIGHTS:
            raise InputError(
                f"phase noise cannot be sorted by range where echoes are up to {greatest * 1e6:.4g} us late and noise is sampled "
                f"at {2 * frequencies_hz[-1] / 1e6:.4g} MHz; raise slope_hz_per_s, lower sample_rate_hz, or leave phase_noise out"
            )
        nodes = _nodes(delays_s[straight], greatest, count)
        at_nodes = 1 - np.exp(-2j * np.pi * frequencies * nodes.delays_s)
        error = np.abs(exact - at_nodes @ nodes.weights) ** 2
        if (power @ error <= INTERPOLATION * (power @ np.abs(exact) ** 2)).all():
            return _nodes(delays_s, greatest, count)


def _lower_ones(count: int) -> np.ndarray:
    """Up to `TRIED` of the numbers 0..count - 1: all of the lowest, and progressively fewer of the others."""
    return np.unique(np.geomspace(1, max(1, count), TRIED).astype(int)) - 1


def _nodes(delays_s: np.ndarray, greatest_s: float, count: int) -> Nodes:
    """Chebyshev points of the second kind from 0 to the greatest delay, without 0, and their polynomials at the delays."""
    points = greatest_s * (1 - np.cos(np.pi * np.arange(count + 1) / count)) / 2
    scale = (-1.0) ** np.arange(count + 1)
    scale[[0, -1]] /= 2
    # Barycentric formula (Berrut and Trefethen 2004, eq. 4.2 and 5.4).
    apart = delays_s - points[:, None]
    met = np.abs(apart) < 1e-12 * points[-1]
    terms = scale[:, None] / np.where(met, 1.0, apart)
    weights = np.where(met.any(axis=0), met, terms / terms.sum(axis=0))
    return Nodes(points[1:], weights[1:])


Pair = tuple[Any, Any]


@one_thread_at_a_time
def lags(samples: np.ndarray, greatest: int) -> np.ndarray:
    """Circular autocorrelation of samples (row, antenna, sample) along each row, the sum of s[n + m] conj(s[n]) over n.

    float32 (row, antenna, part): the real part at lag 0, then real and imaginary part at lags 1 to `greatest`.
    """
    import drjit as dr

    backend = select("cpu")
    Float32, UInt32 = backend.Float32, backend.UInt32
    rows, antennas, count = samples.shape
    size = 1 if count % 2 else 2  # number of samples read at once
    Packet = (backend.arrays.Array2f, backend.arrays.Array4f)[size - 1]
    flat = flat_on_device(samples, Float32)
    lanes, packets = dr.arange(UInt32, rows * antennas), dr.opaque(UInt32, count // size)

    def read(packet: Any) -> list[Pair]:
        values = dr.gather(Packet, flat, lanes * packets + packet)
        return [(values[2 * k], values[2 * k + 1]) for k in range(size)]

    def step(n: Any, before: list[Pair], sums: list[Any]) -> tuple[Any, list[Pair], list[Any]]:
        for real, imag in read(n):
            new = [sums[0] + (real * real + imag * imag)]
            for lag, (a, b) in enumerate(before, start=1):
                new += [sums[2 * lag - 1] + (real * a + imag * b), sums[2 * lag] + (imag * a - real * b)]
            before, sums = [(real, imag), *before[:-1]], new
        return n + 1, before, sums

    width = rows * antennas
    before = [read((packets * size - lag) // size)[(count - lag) % size] for lag in range(1, greatest + 1)]
    zeros = [dr.zeros(Float32, width) for _ in range(2 * greatest + 1)]
    _, _, sums = dr.while_loop(
        state=(dr.zeros(UInt32, width), before, zeros),
        cond=lambda n, before, sums: n < packets,
        body=step,
        labels=("n", "before", "sums"),
        mode="symbolic",
    )
    dr.eval(sums)
    return np.stack([lag_sum.numpy() for lag_sum in sums], axis=1).reshape(rows, antennas, -1)
