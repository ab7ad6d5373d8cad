"""Compares sampled backgrounds with recorded ones: Doppler profiles, levels, autocorrelation in time, and a two-sample
classifier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.core.constants import decibel
from t2d_rt.core.errors import InputError
from t2d_rt.noise.background.model import BackgroundModel, Codes
from t2d_rt.noise.background.records import BackgroundRecord, common_grid

PATCH_COLUMNS = 32
"""Number of columns in a patch, the unit that the classifier judges."""
BANDS = 32
"""Number of Doppler bands in a patch."""
FOLDS = 4
RIDGE = 1.0
"""Weight of the squared coefficients of the logistic regression."""
LONGEST_LAG = 64
QUANTILES = 2000
SAMPLES = 4
"""Number of samples for each record; with fewer the result would depend on which samples were drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Distances:
    """Distances between two sets of spectrograms."""

    profile_db: float
    """Root mean square, over Doppler bins, of the difference of mean levels [dB]. Mean powers would be dominated by the few records
    with a mover of just that speed."""
    profiles_db: float
    """Wasserstein-1 distance between the distributions of a bin's mean level in patches, averaged over the bins [dB]; it measures
    how much profiles vary."""
    levels_db: float
    """Wasserstein-1 distance between the distributions of the cells' levels, averaged over Doppler bands [dB]."""
    autocorrelation: float
    """Root mean square, over lags and bands, of the difference of the autocorrelations of the levels in time."""
    classifier: float
    """Accuracy of a logistic regression that tells patches of the two sets apart, on records that it was not fitted to; 0.5 is
    chance."""


def distances(recorded: Sequence[np.ndarray], sampled: Sequence[np.ndarray]) -> Distances:
    """Distances between two sets of spectrograms, each (velocity, time) [dB] relative to the noise floor.

    Raises InputError where a set has fewer than two spectrograms, or one is shorter than a patch.
    """
    for name, spectrograms in (("recorded", recorded), ("sampled", sampled)):
        if len(spectrograms) < 2 or min(spectrogram.shape[1] for spectrogram in spectrograms) < PATCH_COLUMNS:
            raise InputError(
                f"an evaluation needs two {name} spectrograms or more of {PATCH_COLUMNS} columns or more; give longer ones"
            )
    lags = min(LONGEST_LAG, *(spectrogram.shape[1] // 2 for spectrogram in (*recorded, *sampled)))
    correlation = _autocorrelation(recorded, lags) - _autocorrelation(sampled, lags)
    return Distances(
        profile_db=float(np.sqrt(np.mean((_profile(recorded) - _profile(sampled)) ** 2))),
        profiles_db=_profiles_distance(recorded, sampled),
        levels_db=_levels_distance(recorded, sampled),
        autocorrelation=float(np.sqrt(np.mean(correlation**2))),
        classifier=two_sample_accuracy(recorded, sampled),
    )


def evaluation(
    model: BackgroundModel, recorded: Sequence[BackgroundRecord], *, seed: int = 0
) -> dict[str, tuple[Distances, float | None]]:
    """Distances from held-out records, and perplexity of the codes: for samples of the learned prior, of uniformly drawn codes, and
    of white Gaussian noise of equal power. There are SAMPLES of each kind for every record, of the same length."""
    if not common_grid(list(recorded)).same_as(model.grid):
        raise InputError(
            f"the recordings have {recorded[0].grid}, the model {model.grid}; process them as those it was trained on"
        )
    levels = [record.relative_db for record in recorded]
    results: dict[str, tuple[Distances, float | None]] = {}
    drawn: dict[str, Codes] = {"prior": "prior", "uniform codes": "uniform"}
    for name, codes in drawn.items():
        samples = [
            model.columns(level.shape[1], seed=seed + number, codes=codes)
            for number, level in enumerate(levels * SAMPLES)
        ]
        used = perplexity(np.concatenate([sample.codes for sample in samples]), model.architecture.codes)
        results[name] = distances(levels, [decibel(sample.power.astype(np.float64)) for sample in samples]), used
    noise = gaussian_noise(levels * SAMPLES, np.random.default_rng(seed))
    return {**results, "Gaussian noise": (distances(levels, noise), None)}


def perplexity(codes: np.ndarray, size: int) -> float:
    """Perplexity exp(entropy) of the codes (step, head), as the geometric mean over the heads: the number of codes that are
    effectively in use."""
    entropies = []
    for head in codes.T:
        frequency = np.bincount(head, minlength=size) / len(head)
        used = frequency[frequency > 0]
        entropies.append(-np.sum(used * np.log(used)))
    return float(np.exp(np.mean(entropies)))


def gaussian_noise(like: Sequence[np.ndarray], rng: np.random.Generator) -> list[np.ndarray]:
    """Levels [dB] of white complex Gaussian noise with one look in each cell and the mean power of `like`."""
    power_db = 10 * np.log10(np.mean([np.mean(10 ** (level_db / 10)) for level_db in like]))
    return [power_db + 10 * np.log10(rng.exponential(size=level_db.shape) + 1e-12) for level_db in like]


def _profile(records: Sequence[np.ndarray]) -> np.ndarray:
    """Mean level of each bin [dB]; all records have the same weight."""
    return np.asarray(np.mean([record.mean(axis=1) for record in records], axis=0))


def _profiles_distance(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> float:
    """Distance between the distributions of a bin's mean level in patches [dB]."""
    first_levels, second_levels = (
        np.concatenate([_patches(level).mean(axis=2) for level in levels], axis=1) for levels in (first, second)
    )
    return _mean_wasserstein(list(first_levels), list(second_levels))


def _levels_distance(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> float:
    """Distance between the distributions of the cells' levels in each Doppler band [dB]."""
    return _mean_wasserstein(_banded(first), _banded(second))


def _mean_wasserstein(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> float:
    """Wasserstein-1 distance between the sets of numbers in each pair, which is the mean difference of their quantiles; averaged
    over the pairs."""
    at = (np.arange(QUANTILES) + 0.5) / QUANTILES
    pairs = zip(first, second, strict=True)
    return float(np.mean([np.mean(np.abs(np.quantile(row, at) - np.quantile(other, at))) for row, other in pairs]))


def _patches(record: np.ndarray) -> np.ndarray:
    """A record divided into patches of `PATCH_COLUMNS` columns, (velocity, patch, column); a shorter remainder is dropped."""
    count = record.shape[1] // PATCH_COLUMNS
    return record[:, : count * PATCH_COLUMNS].reshape(len(record), count, PATCH_COLUMNS)


def _banded(records: Sequence[np.ndarray]) -> list[np.ndarray]:
    """All cells of each Doppler band, over all records."""
    cells = np.concatenate(records, axis=1)
    return [band.ravel() for band in np.array_split(cells, min(BANDS, len(cells)))]


def _autocorrelation(records: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """Autocorrelation in time of the levels about their mean over all records, averaged over the bins of a band, (band, lag)."""
    mean = np.mean([record.mean(axis=1) for record in records], axis=0)[:, None]
    correlation = np.zeros((len(mean), lags))
    for record in records:
        values = record - mean
        size = values.shape[1]
        correlation += [[np.mean(row[: size - k] * row[k:]) for k in range(lags)] for row in values]
    correlation /= np.maximum(correlation[:, :1], 1e-9)
    return np.stack([band.mean(axis=0) for band in np.array_split(correlation, min(BANDS, len(mean)))])


def two_sample_accuracy(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> float:
    """Accuracy, with equal weight of both sets, of a logistic regression on features of patches; patches of a record are either all
    fitted to or all tested on."""
    features = [_features(levels) for levels in (*first, *second)]
    labels = [np.full(len(feature), float(k >= len(first))) for k, feature in enumerate(features)]
    fold = np.r_[np.arange(len(first)) % FOLDS, np.arange(len(second)) % FOLDS]
    right = []
    for left_out in range(min(FOLDS, len(first), len(second))):
        training = [k for k in range(len(features)) if fold[k] != left_out]
        tried = [k for k in range(len(features)) if fold[k] == left_out]
        x, y = np.concatenate([features[k] for k in training]), np.concatenate([labels[k] for k in training])
        mean, scale = x.mean(axis=0), x.std(axis=0) + 1e-6
        weights = _regression((x - mean) / scale, y)
        score = (np.concatenate([features[k] for k in tried]) - mean) / scale @ weights[:-1] + weights[-1]
        truth = np.concatenate([labels[k] for k in tried])
        right.append(np.mean([np.mean((score > 0)[truth == side] == side) for side in (0, 1)]))
    return float(np.mean(right))


def _features(record: np.ndarray) -> np.ndarray:
    """Features of each patch, (patch, feature): mean, standard deviation and correlation between columns of the levels in each
    Doppler band."""
    rows = []
    for band in np.array_split(_patches(record), min(BANDS, len(record))):
        mean = band.mean(axis=(0, 2))
        about = band - band.mean(axis=2, keepdims=True)
        variance = np.mean(about**2, axis=(0, 2)) + 1e-9
        next_one = np.mean(about[..., 1:] * about[..., :-1], axis=(0, 2)) / variance
        rows += [mean, 0.5 * np.log(variance), next_one]
    return np.stack(rows, axis=1)


def _regression(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Coefficients and constant of a logistic regression with ridge penalty."""
    from scipy.optimize import minimize

    design = np.c_[x, np.ones(len(x))]
    sign = 2 * y - 1
    balance = np.where(y > 0, 0.5 / np.mean(y), 0.5 / np.mean(1 - y))
    start = np.zeros(design.shape[1])
    minimum = minimize(_loss, start, (design, sign, balance), jac=True, method="L-BFGS-B", options={"maxiter": 300})
    return np.asarray(minimum.x)


def _loss(weights: np.ndarray, design: np.ndarray, sign: np.ndarray, balance: np.ndarray) -> tuple[float, np.ndarray]:
    """Loss of the logistic regression, and its gradient."""
    margin = sign * (design @ weights)
    value = np.sum(balance * np.logaddexp(0, -margin)) + RIDGE / 2 * np.sum(weights[:-1] ** 2)
    slope = -design.T @ (balance * sign * np.exp(-np.logaddexp(0, margin))) + RIDGE * np.r_[weights[:-1], 0]
    return float(value), slope
