"""How well probabilities agree with labels: accuracy, macro-F1, confusion, calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.core.errors import InputError

BINS = 10
"""Bins of confidence in a reliability diagram."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """How well the probabilities of some samples agree with their labels."""

    accuracy: float
    macro_f1: float
    """Mean over the classes that occur or are told."""
    confusion: np.ndarray
    """Samples of each class (row) that are taken for each class, (K, K)."""
    calibration_error: float
    """Expected difference between confidence and accuracy (Guo et al. 2017), ten bins."""
    reliability: np.ndarray
    """Mean confidence, accuracy and number of samples of each bin of confidence, (10, 3)."""


def macro_f1(truth: np.ndarray, predicted: np.ndarray, classes: int) -> np.ndarray:
    """Mean over the classes of F1, for predictions (..., E) of labels (..., E); a class that neither has is left out."""
    scores, present = [], []
    for label in range(classes):
        hits = np.sum((truth == label) & (predicted == label), axis=-1)
        either = np.sum(truth == label, axis=-1) + np.sum(predicted == label, axis=-1)
        scores.append(np.where(either > 0, 2.0 * hits / np.maximum(either, 1), 0.0))
        present.append(either > 0)
    return np.asarray(np.sum(scores, axis=0) / np.maximum(np.sum(present, axis=0), 1))


def scores_of(probabilities: np.ndarray, labels: np.ndarray) -> Scores:
    """Scores of probabilities (N, K) and labels (N,).

    The calibration error is the mean over the samples of |confidence - accuracy| in their bin of confidence.
    Raises InputError for NaN.
    """
    if not np.isfinite(probabilities).all():
        raise InputError("probabilities must be finite, got NaN or infinite ones; look at the model's weights")
    count = probabilities.shape[1]
    told = probabilities.argmax(axis=1)
    confusion = np.zeros((count, count), dtype=np.int64)
    np.add.at(confusion, (labels, told), 1)
    confidence = probabilities.max(axis=1)
    which = np.minimum((confidence * BINS).astype(int), BINS - 1)
    rows = []
    for number in range(BINS):
        mask = which == number
        some = mask.any()
        rows.append(
            [confidence[mask].mean() if some else 0.0, (told == labels)[mask].mean() if some else 0.0, mask.sum()]
        )
    reliability = np.array(rows)
    error = (np.abs(reliability[:, 0] - reliability[:, 1]) * reliability[:, 2]).sum() / len(labels)
    return Scores(
        accuracy=float(np.mean(told == labels)),
        macro_f1=float(macro_f1(labels, told, count)),
        confusion=confusion,
        calibration_error=float(error),
        reliability=reliability,
    )
