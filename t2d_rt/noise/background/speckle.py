"""The random part of a spectrogram's cells: gamma distributed about their mean, correlated from column to column and bin to bin.

The power of a cell that adds up M independent complex Gaussian parts is gamma distributed with M looks: its standard deviation is
the mean over sqrt(M), and M = 1 is the exponential distribution of fully developed speckle (Goodman, Speckle Phenomena in Optics,
2007, ch. 3). Quantiles by Wilson and Hilferty (1931): the cube root of a gamma variate is nearly Gaussian.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

ORDER = 8
"""Order of the autoregressive filter over the columns; overlapping windows correlate over fewer columns than that."""
LAGS, BINS = 16, 4
"""Lags in time and in Doppler at which correlation is kept."""
WARM_UP = 64
"""Columns that the filter runs before the first one that is used."""
LEAST_RATIO = 1e-3
"""Least power of a cell relative to its mean."""
RIDGE = 1e-3
"""Added to the correlation at lag 0, so that the equations of the filter can be solved."""


def speckle(normal: np.ndarray, looks: np.ndarray) -> np.ndarray:
    """Factors on the mean power, gamma distributed with mean 1 and so many looks, from Gaussian numbers of the same shape."""
    root = 1 - 1 / (9 * looks) + normal / (3 * np.sqrt(looks))
    return np.asarray(np.maximum(root, LEAST_RATIO ** (1 / 3)) ** 3)


def normal_scores(ratio: np.ndarray, looks: np.ndarray) -> np.ndarray:
    """The Gaussian numbers that `speckle` makes these factors of."""
    return np.asarray((np.cbrt(ratio) - 1 + 1 / (9 * looks)) * 3 * np.sqrt(looks))


def correlations(scores: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Correlation of scores (velocity, time) over LAGS columns, of each bin (velocity, LAGS), and over BINS bins, 1 at lag 0.

    Mean over the records by their lengths: near zero speed the power changes more slowly than the floor's. Over the bins it is the
    median of all, about each bin's mean in its record: what the codes do not tell of the few bins of interferers is no speckle.
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
    """Unit Gaussian numbers (bins, columns), float32, of about these correlations over lags of a column (bins, LAGS) and of a bin.

    The first columns do not depend on how many there are.
    """
    from scipy.signal import lfilter

    # In blocks of one shape: BLAS picks its kernels by shape, and these round differently.
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
    """Coefficients of the values before, and of the white numbers, of the autoregressive filter for these correlations."""
    from scipy.linalg import eigvalsh, solve_toeplitz, toeplitz

    # Estimates that are no correlation of anything would make an unstable filter: as much as they lack is added at lag 0.
    lacking = -float(eigvalsh(toeplitz(lags[: ORDER + 1]))[0])
    column = np.r_[lags[0] + RIDGE + max(0.0, lacking), lags[1:ORDER]]
    next_lags = lags[1 : ORDER + 1]
    predictor = solve_toeplitz(column, next_lags)
    return predictor, float(np.sqrt(max(1e-6, 1 - predictor @ next_lags / column[0])))


@lru_cache(maxsize=16)
def _root(bins: int, doppler: tuple[float, ...]) -> np.ndarray:
    """A square root (bins, bins) of the correlation over bins; where that is not positive, of the nearest that is."""
    from scipy.linalg import eigh, toeplitz

    column = np.zeros(bins)
    column[: len(doppler)] = doppler[:bins]
    values, vectors = eigh(toeplitz(column))
    root = vectors * np.sqrt(np.maximum(values, 0))
    return np.asarray((root / np.linalg.norm(root, axis=1, keepdims=True)).astype(np.float32))
