"""Scores of probabilities against labels (accuracy, macro-F1, confusion, calibration), and of predicted events over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from t2d_rt.core.errors import InputError

BINS = 10
"""Number of confidence bins in a reliability diagram."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """How well the probabilities of some samples agree with their labels."""

    accuracy: float
    macro_f1: float
    """Macro-F1: mean over the classes that occur or are predicted."""
    confusion: np.ndarray
    """Number of samples of each class (row) that are predicted as each class (column), (K, K)."""
    calibration_error: float
    """Expected difference between confidence and accuracy (Guo et al. 2017), ten bins."""
    reliability: np.ndarray
    """Mean confidence, accuracy and number of samples of each bin of confidence, (10, 3)."""


def macro_f1(truth: np.ndarray, predicted: np.ndarray, classes: int) -> np.ndarray:
    """Macro-F1 of predictions (..., E) for labels (..., E): the mean over the classes of F1; a class that occurs in neither is left
    out."""
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
    predicted = probabilities.argmax(axis=1)
    confusion = np.zeros((count, count), dtype=np.int64)
    np.add.at(confusion, (labels, predicted), 1)
    confidence = probabilities.max(axis=1)
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    rows = []
    for number in range(BINS):
        mask = bins == number
        occupied = mask.any()
        rows.append(
            [
                confidence[mask].mean() if occupied else 0.0,
                (predicted == labels)[mask].mean() if occupied else 0.0,
                mask.sum(),
            ]
        )
    reliability = np.array(rows)
    error = (np.abs(reliability[:, 0] - reliability[:, 1]) * reliability[:, 2]).sum() / len(labels)
    return Scores(
        accuracy=float(np.mean(predicted == labels)),
        macro_f1=float(macro_f1(labels, predicted, count)),
        confusion=confusion,
        calibration_error=float(error),
        reliability=reliability,
    )


class Interval(NamedTuple):
    """A score and its 95 % confidence interval."""

    score: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.score:.3f} [{self.low:.3f}, {self.high:.3f}]"


DRAWS = 1000


def interval_of(
    labels: np.ndarray, told: np.ndarray, classes: int, apart: Sequence[Sequence[str]]
) -> tuple[Interval, Interval]:
    """Accuracy and macro-F1 of predictions `told` for labels (N,), with 95 % intervals for other groups of the kinds in `apart`.

    apart: for each kind, such as descriptions and subjects, the group of each sample, (N,). Groups of each kind are resampled with
    replacement, independently, and a sample's weight is the product of how often its groups were drawn: the pigeonhole bootstrap,
    which is conservative for crossed groups (Owen 2007, Ann. Appl. Stat. 1, 386).
    """
    rng, weights = np.random.default_rng(0), np.ones((DRAWS, len(labels)))
    for groups in apart:
        _, number = np.unique(np.asarray(groups), return_inverse=True)
        count = int(number.max()) + 1
        weights *= rng.multinomial(count, np.full(count, 1.0 / count), size=DRAWS)[:, number]
    all_weights = np.vstack([np.ones(len(labels)), weights[weights.sum(axis=1) > 0]])
    right = all_weights @ (told == labels) / all_weights.sum(axis=1)
    parts = []
    for label in range(classes):
        hits = all_weights @ ((labels == label) & (told == label))
        either = all_weights @ (labels == label) + all_weights @ (told == label)
        parts.append(np.where(either > 0, 2.0 * hits / np.maximum(either, 1e-300), np.nan))
    f1 = np.nanmean(parts, axis=0)
    low, high = np.percentile(np.stack([right, f1])[:, 1:], [2.5, 97.5], axis=1)
    return Interval(float(right[0]), float(low[0]), float(high[0])), Interval(
        float(f1[0]), float(low[1]), float(high[1])
    )


class Event(NamedTuple):
    """A class during an interval of a recording."""

    begin_s: float
    end_s: float
    label: int
    """Index of the class."""

    def shared_s(self, other: Event) -> float:
        """Time for which both events last [s]; negative where they are apart."""
        return min(self.end_s, other.end_s) - max(self.begin_s, other.begin_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class EventScores:
    """How well predicted events agree with true ones."""

    f1: float
    """2 found / (predicted + true), over all classes and recordings."""
    found: np.ndarray
    """Number of events of each class that were found, (K,)."""
    told: np.ndarray
    true: np.ndarray
    delays_s: np.ndarray
    """Start of the prediction minus the true start, for each event that was found [s]."""
    false_alarms: np.ndarray
    """Number of predicted events of each class that do not overlap with a true one of that class, (K,)."""
    hours: float
    """Duration of the recordings [h]."""

    @property
    def false_alarms_per_hour(self) -> np.ndarray:
        """False alarms of each class per hour, (K,)."""
        return self.false_alarms / self.hours


def event_scores(
    pairs: Sequence[tuple[Sequence[Event], Sequence[Event]]], classes: int, duration_s: float, *, overlap: float = 0.5
) -> EventScores:
    """Scores of recordings with a total duration of `duration_s`, each given by its true and its predicted events.

    overlap: a predicted event finds a true one of its class if their intersection is at least this fraction of their union in
        time. Each finds one at most, those with the greatest overlap first (the F1@50 of Lea et al., CVPR 2017, for a half).
    """
    found, false, delays = np.zeros(classes, int), np.zeros(classes, int), []
    counts = np.zeros((2, classes), int)
    for sides in pairs:
        for count, side in zip(counts, sides, strict=True):
            np.add.at(count, [event.label for event in side], 1)
        true, predicted = sides
        alike = [(a, b, one.shared_s(other)) for a, one in enumerate(true) for b, other in enumerate(predicted)
                 if one.label == other.label and one.shared_s(other) > 0]  # fmt: skip
        for b in set(range(len(predicted))) - {b for _, b, _ in alike}:
            false[predicted[b].label] += 1
        parts = [
            (both_s / (max(true[a].end_s, predicted[b].end_s) - min(true[a].begin_s, predicted[b].begin_s)), a, b)
            for a, b, both_s in alike
        ]
        free, unused = set(range(len(true))), set(range(len(predicted)))
        for part, a, b in sorted(parts, reverse=True):
            if part >= overlap and a in free and b in unused:
                free.remove(a)
                unused.remove(b)
                found[true[a].label] += 1
                delays.append(predicted[b].begin_s - true[a].begin_s)
    return EventScores(
        f1=float(2 * found.sum() / max(counts.sum(), 1)), found=found, true=counts[0], told=counts[1], delays_s=np.array(delays),
        false_alarms=false, hours=duration_s / 3600.0,
    )  # fmt: skip
