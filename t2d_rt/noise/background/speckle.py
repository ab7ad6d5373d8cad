"""The random part of a spectrogram's cells: gamma distributed about the mean, and correlated from column to column and bin to bin.

The power of a cell that adds up M independent complex Gaussian parts is gamma distributed with M looks: its standard deviation is
the mean over sqrt(M), and M = 1 is the exponential distribution of fully developed speckle (Goodman, Speckle Phenomena in Optics,
2007, ch. 3). Quantiles by Wilson and Hilferty (1931): the cube root of a gamma variate is nearly Gaussian.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

ORDER = 8
"""Order of the autoregressive filter over the columns; overlapping windows are correlated over fewer columns."""
LAGS, BINS = 16, 4
"""Number of lags in time, and in Doppler, for which the correlation is stored."""
WARM_UP = 64
"""Number of columns for which the filter runs before the first one that is used."""
LEAST_RATIO = 1e-3
"""Least power of a cell relative to its mean that is represented."""
RIDGE = 1e-3
"""Added to the correlation at lag 0, so that the filter's equations can be solved."""


def speckle(normal: np.ndarray, looks: np.ndarray) -> np.ndarray:
    """Factors on the mean power, gamma distributed with mean 1 and the given looks, from Gaussian numbers of the same shape."""
    root = 1 - 1 / (9 * looks) + normal / (3 * np.sqrt(looks))
    return np.asarray(np.maximum(root, LEAST_RATIO ** (1 / 3)) ** 3)


def normal_scores(ratio: np.ndarray, looks: np.ndarray) -> np.ndarray:
    """Inverse of `speckle`: the Gaussian numbers that belong to such factors."""
    return np.asarray((np.cbrt(ratio) - 1 + 1 / (9 * looks)) * 3 * np.sqrt(looks))


def correlations(scores: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Correlation of scores (velocity, time) over LAGS columns, for each bin (velocity, LAGS), and over BINS bins; 1 at lag 0.

    Records are weighted by their lengths. Correlation in time differs from bin to bin: near zero speed the power changes more
    slowly than that of the noise floor. Correlation over bins is the median over all bins, each relative to its mean in the record,
    because in the few bins of interferers the remainder that the codes do not describe is not speckle.
    """
    time, doppler, weight = np.zeros((len(scores[0]), LAGS)), np.zeros(BINS), 0
    for score in scores:
        values = np.clip(score, -4, 4).astype(np.float64)
        size = values.shape[1]
        total = np.sum(values**2, axis=1) + 1e-12
        for lag in range(min(LAGS, size - 1)):
            along = np.sum(values[:, : size - lag] * values[:, lag:], axis=1)
            time[:, lag] += size * along / total * size / (size - lag)
        values -= values.mean(axis=1, keepdims=True)
        total = np.sum(values**2, axis=1) + 1e-12
        for lag in range(BINS):
            first, second = slice(0, len(values) - lag), slice(lag, len(values))
            across = np.sum(values[first] * values[second], axis=1)
            doppler[lag] += size * np.median(across / np.sqrt(total[first] * total[second]))
        weight += size
    return time / weight, doppler / weight


def gaussian_field(
    bins: int, columns: int, time: np.ndarray, doppler: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Standard Gaussian numbers (bins, columns), float32, with approximately these correlations over lags of columns (bins, LAGS)
    and of bins.

    The first columns do not depend on their number.
    """
    from scipy.signal import lfilter

    # In blocks of one shape: BLAS picks its kernels by shape, and different kernels round differently.
    blocks = np.zeros((-(-columns // WARM_UP) + 1, WARM_UP, bins), np.float32)
    white = blocks.reshape(-1, bins)[: columns + WARM_UP]
    rng.standard_normal(out=white, dtype=np.float32)
    root = np.ascontiguousarray(_root(bins, tuple(doppler.tolist())).T)
    for block in blocks:
        block[:] = block @ root
    field = [
        lfilter([innovation], np.r_[1, -predictor], row)[WARM_UP:]
        for row, (predictor, innovation) in zip(white.T, map(_filter, time.astype(np.float64)), strict=True)
    ]
    return np.asarray(field, np.float32)


def _filter(lags: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients of the autoregressive filter for these correlations: of the previous values, and of the white noise."""
    from scipy.linalg import eigvalsh, solve_toeplitz, toeplitz

    # Estimates that are no valid correlation would give an unstable filter: the deficit is added at lag 0.
    lacking = -float(eigvalsh(toeplitz(lags[: ORDER + 1]))[0])
    column = np.r_[lags[0] + RIDGE + max(0.0, lacking), lags[1:ORDER]]
    next_lags = lags[1 : ORDER + 1]
    predictor = solve_toeplitz(column, next_lags)
    return predictor, float(np.sqrt(max(1e-6, 1 - predictor @ next_lags / column[0])))


@lru_cache(maxsize=16)
def _root(bins: int, doppler: tuple[float, ...]) -> np.ndarray:
    """A square root (bins, bins) of the correlation matrix over bins; of the nearest positive one, if it is not positive itself."""
    from scipy.linalg import eigh, toeplitz

    column = np.zeros(bins)
    column[: len(doppler)] = doppler[:bins]
    values, vectors = eigh(toeplitz(column))
    root = vectors * np.sqrt(np.maximum(values, 0))
    return np.asarray((root / np.linalg.norm(root, axis=1, keepdims=True)).astype(np.float32))
