"""Applies a receiver to the range cells of a gate, without computing ADC samples where these are not needed.

Cells are linear in the samples, z = M v. For v = a x + b conj(x) + noise, with the coefficients a and b of I/Q imbalance (eq. 35),
thermal noise after the imbalance, 1/f noise and the rounding of the converters are Gaussian in the cells. Their covariance follows
from M; neighbouring cells are correlated by the window. Rows are processed sample by sample where the images b conj(x) of echoes
fall into the gate, where phase noise may matter, or where converters saturate; so are all rows if there are interferers, or if
converters are so coarse that their rounding is not white noise.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.linalg import matmul_toeplitz

from t2d_rt.core.backend import one_blas_thread
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.noise.receiver.chain import Effects, ReceiverLevels
from t2d_rt.noise.receiver.draws import Draws, group_rows
from t2d_rt.noise.receiver.phase_noise import PhaseNoise
from t2d_rt.types import Radar, Receiver
from t2d_rt.types.receiver import IqImbalance

BLOCK_ROWS = 2048
"""Rows that are processed at once; a receiver acts on the samples of all of them or of none."""
LEVEL_SAMPLES = 32
"""Number of samples of a chirp, spread evenly over the sweep, from which powers are computed."""
COARSEST = 2.5
"""Greatest step of the converters relative to the standard deviation of the noise in I. The correlation of rounding with the
samples, and its deviation from white noise of power step^2 / 12, are then 2 exp(-2 pi^2 / COARSEST^2) = 8 % of its power (Widrow
and Kollar 2008, 4.3)."""
IMAGE_BINS = 16
"""Distance in range bins at which an echo has fallen by 120 dB, so that an image, which is weaker, is negligible."""
MOST_CELLS = 256
"""Greatest number of cells whose noise is drawn by their covariance; with more it is faster to process samples."""
DEVIATIONS = 6.0
"""Number of standard deviations of the noise for which the converters must have room."""


@one_blas_thread
def receive_gated(
    rows: ProductRows, radar: Radar, receiver: Receiver | None, seed: int, matrix: np.ndarray, bins: slice
) -> tuple[np.ndarray, dict[str, Any]]:
    """Range cells, complex64 (chirp, antenna, cell), of a cube's rows after a receiver, and its levels for the recording's
    settings.

    matrix: weight of each sample in each cell, complex64 (sample, cell): the windowed FFT of a chirp at `bins`.
    seed: seed of the random draws, where the receiver has none of its own.
    Rows that are processed by samples are those of `receive`.
    """
    count, *_ = rows.shape
    cells = np.empty((*rows.shape[:2], matrix.shape[1]), np.complex64)
    if receiver is None:
        for first in range(0, count, BLOCK_ROWS):
            cells[first : first + BLOCK_ROWS] = rows.through(matrix, first, min(first + BLOCK_ROWS, count))
        return cells, {}
    work = _Gated(radar, receiver, Draws(seed if receiver.seed is None else receiver.seed), matrix, bins)
    group = group_rows(math.prod(rows.shape[1:]))
    block = -(-BLOCK_ROWS // group) * group
    for first in range(0, count, block):
        stop = min(first + block, count)
        cells[first:stop] = work.cells(rows, first, stop)
    work.levels.warn()
    settings = work.levels.described()
    settings.pop("adc_peak_dbfs", None)  # without samples there is no peak
    return cells, settings


class _Gated:
    """A receiver whose output is needed in a range gate only."""

    def __init__(self, radar: Radar, receiver: Receiver, draws: Draws, matrix: np.ndarray, bins: slice) -> None:
        self._radar, self._draws, self._matrix, self._bins = radar, draws, matrix, bins
        self._effects = Effects(radar, receiver, draws)
        self.levels = ReceiverLevels(receiver, radar, self._effects.offsets)
        stages, count = self._effects.stages, radar.samples
        imbalance = stages.imbalance or IqImbalance()
        self._direct, self._image = imbalance.coefficients
        covariance = np.zeros(count)
        covariance[0] = stages.thermal_w * (abs(self._direct) ** 2 + abs(self._image) ** 2)
        covariance[0] += stages.adc.noise_power_w if stages.adc else 0.0
        if stages.flicker is not None:
            covariance += stages.flicker_w * stages.flicker.correlation(count)
        self._noise_w = float(covariance[0])
        weights = matrix.astype(complex)
        self._factor = np.empty((0, 0), np.float32)
        if matrix.shape[1] <= MOST_CELLS:
            self._factor = _real_factor(
                weights.T @ matmul_toeplitz(covariance, weights.conj()),
                2 * self._direct * self._image * stages.thermal_w * weights.T @ weights,
            )
        stride = max(1, count // LEVEL_SAMPLES)
        self._stride, self._width = stride, matrix.shape[1]
        self._both = np.concatenate(
            [self._direct * weights, np.eye(count, dtype=np.complex64)[:, stride // 2 :: stride]], axis=1
        ).astype(np.complex64)

    def cells(self, rows: ProductRows, first: int, stop: int) -> np.ndarray:
        """Range cells of some rows, which begin with the first of a group, complex64 (row, antenna, cell)."""
        both = rows.through(self._both, first, stop)
        cells, strided = both[..., : self._width], both[..., self._width :]
        if self._acts_on_samples(strided, rows.phases(first, stop)):
            return self._by_samples(rows.read(first, stop), first)
        drawn = self._draws.normal("noise of cells", first, cells.shape).view(np.float32)
        noise = (drawn.reshape(-1, 2 * self._width) @ self._factor).view(np.complex64).reshape(cells.shape)
        constants = np.zeros(strided.shape[:2], np.complex64)
        if self._effects.flicker:
            constants = self._effects.flicker.slow(first, stop - first)
        noise += (constants + self._effects.offsets)[..., None] * self._matrix.sum(axis=0)
        departure = (
            np.complex64(self._direct - 1) * strided + np.complex64(self._image) * strided.conj() + constants[..., None]
        )
        self._count(strided, departure, self._noise_w)
        return cells + noise

    def _acts_on_samples(self, strided: np.ndarray, phases: tuple[float, float]) -> bool:
        """Whether an effect that is not linear may matter in rows with these samples, whose beat frequencies have phases over x
        between the two given."""
        stages, count = self._effects.stages, self._radar.samples
        if not len(self._factor):
            return True
        power_w = float((strided.real**2 + strided.imag**2).mean(axis=2).max())
        low, high = (0, count) if not np.isfinite(phases).all() else _bins(phases, count)
        if self._image and self._bins.start < count - low + IMAGE_BINS and count - high - IMAGE_BINS < self._bins.stop:
            return True
        for effect in self._effects.first:
            if not isinstance(effect, PhaseNoise) or effect.may_count(power_w, slice(low, high)):
                return True
        if stages.adc is None:
            return False
        deviation = math.sqrt((self._noise_w - stages.adc.noise_power_w) / 2)
        # The greatest possible peak of a chirp: all its energy in one sample.
        peak = math.sqrt(count * power_w) + float(np.abs(self._effects.offsets).max()) + DEVIATIONS * deviation
        return peak > math.sqrt(stages.adc.full_scale_w) or stages.adc.step > COARSEST * deviation

    def _by_samples(self, samples: np.ndarray, first: int) -> np.ndarray:
        received = self._effects.received(samples, first, samples[0])
        departure = received.samples - samples - self._effects.offsets[:, None]
        # A burst may lie between the samples from which powers are computed.
        added_w = (departure.real**2 + departure.imag**2).sum(axis=2)
        strided, departure = (values[..., self._stride // 2 :: self._stride] for values in (samples, departure))
        self._count(strided, departure, 0.0, added_w)
        self.levels.note(received)
        return received.samples @ self._matrix

    def _count(
        self, strided: np.ndarray, departure: np.ndarray, noise_w: float, added_w: np.ndarray | None = None
    ) -> None:
        """Adds rows to the levels, from some of their clean samples and what is added to these beside noise of power `noise_w`;
        `added_w` (row, antenna) is the energy of the addition in all samples, where that is known."""
        levels, shape = self.levels, (*strided.shape[:2], self._radar.samples)
        for power, values, about, more_w in (
            (levels.clean, strided, levels.reference(strided), 0.0),
            (levels.added, departure, 0.0, noise_w),
        ):
            power.reference = about
            apart = values - about
            sums_w = shape[2] * ((apart.real**2 + apart.imag**2).mean(axis=2) + more_w)
            if power is levels.added and added_w is not None:
                sums_w = added_w
            power.add(shape, sums_w, values.sum(axis=0, dtype=np.complex128))


def _bins(phases: tuple[float, float], count: int) -> tuple[int, int]:
    """First range bin, and the one after the last, in which beats with phases over x between two values lie."""
    low, high = (phase * count / (math.pi * (count - 1)) for phase in phases)
    return max(0, math.floor(low)), min(count, math.ceil(high) + 1)


def _real_factor(covariance: np.ndarray, relation: np.ndarray) -> np.ndarray:
    """Matrix (2 cell, 2 cell), float32, from independent numbers of variance 1/2 to noise z of the cells, both as alternating real
    and imaginary parts.

    covariance, relation: means of z z^H and of z z^T, (cell, cell).
    """
    cells = len(covariance)
    matrix = np.empty((2 * cells, 2 * cells))
    for part, block in enumerate((covariance + relation, relation - covariance)):
        sign = 1 - 2 * part
        matrix[part::2, part::2] = sign * block.real / 2
        matrix[1 - part :: 2, part::2] = block.imag / 2
    # By eigenvalues: with a window that is zero at its ends, the covariance of all cells is singular.
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(2 * np.maximum(values, 0.0))).T, np.float32)
