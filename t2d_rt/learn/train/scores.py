"""How well probabilities agree with labels: accuracy, macro-F1, confusion, calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BINS = 10
"""Of confidence, in a reliability diagram."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Of some samples."""

    accuracy: float
    macro_f1: float
    """Mean over the classes that occur or are told."""
    confusion: np.ndarray
    """Samples of each class (row) that are taken for each class, (K, K)."""
    calibration_error: float
    """Expected difference between confidence and accuracy (Guo et al. 2017), ten bins."""
    reliability: np.ndarray
    """Of each bin of confidence: mean confidence, accuracy, samples, (10, 3)."""


def scores_of(probabilities: np.ndarray, labels: np.ndarray) -> Scores:
    """Scores of probabilities (N, K) and labels (N,)."""
    count = probabilities.shape[1]
    told = probabilities.argmax(axis=1)
    confusion = np.zeros((count, count), dtype=np.int64)
    np.add.at(confusion, (labels, told), 1)
    right = np.diag(confusion)
    both = confusion.sum(axis=0) + confusion.sum(axis=1)
    f1 = (2 * right[both > 0] / both[both > 0]).mean()
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
        accuracy=float(right.sum() / len(labels)), macro_f1=float(f1), confusion=confusion, calibration_error=float(error),
        reliability=reliability,
    )  # fmt: skip
