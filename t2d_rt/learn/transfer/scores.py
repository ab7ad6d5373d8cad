"""Macro-F1 with an interval over events."""

from __future__ import annotations

import numpy as np

from t2d_rt.learn.train.scores import macro_f1

RESAMPLINGS = 1000


def with_interval(
    truth: np.ndarray, predicted: np.ndarray, classes: int, *, seed: int = 0
) -> tuple[float, float, float]:
    """Mean over repetitions of macro-F1 of predictions (R, E), and its 95 % interval over events.

    Events are drawn anew with replacement, within each class, and all repetitions are scored on the same draw: the interval holds
    what another recording of as many events of the same persons would change, and what training's chance changes on average.
    """
    means = _redrawn(truth, predicted, classes, seed)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(np.mean(macro_f1(truth[None], predicted, classes))), float(low), float(high)


def gain(
    truth: np.ndarray, predicted: np.ndarray, others: np.ndarray, classes: int, *, seed: int = 0
) -> tuple[float, float, float]:
    """How much greater macro-F1 of predictions (R, E) is than that of others (Q, E), with its 95 % interval over events."""
    differences = _redrawn(truth, predicted, classes, seed) - _redrawn(truth, others, classes, seed)
    low, high = np.percentile(differences, [2.5, 97.5])
    means = [float(np.mean(macro_f1(truth[None], each, classes))) for each in (predicted, others)]
    return means[0] - means[1], float(low), float(high)


def _redrawn(truth: np.ndarray, predicted: np.ndarray, classes: int, seed: int) -> np.ndarray:
    """Macro-F1, mean over repetitions, of each draw of events, (RESAMPLINGS,)."""
    rng = np.random.default_rng(seed)
    members = [np.flatnonzero(truth == label) for label in np.unique(truth)]
    drawn = np.stack([np.concatenate([rng.choice(each, len(each)) for each in members]) for _ in range(RESAMPLINGS)])
    return np.asarray(np.mean([macro_f1(truth[drawn], each[drawn], classes) for each in predicted], axis=0))


def grouped_folds(labels: np.ndarray, folds: int, seed: int) -> np.ndarray:
    """Fold of each event, (E,): classes are spread evenly, in an order that the seed draws. An event's maps have one fold."""
    rng = np.random.default_rng(seed)
    found = np.zeros(len(labels), dtype=int)
    first = 0
    for label in np.unique(labels):
        members = rng.permutation(np.flatnonzero(labels == label))
        found[members] = (np.arange(len(members)) + first) % folds
        first += len(members)
    return found


def at_most(labels: np.ndarray, among: np.ndarray, per_class: int | None, seed: int) -> np.ndarray:
    """Of the events `among`, so many of each class, or all there are: sorted positions."""
    if per_class is None:
        return np.sort(among)
    rng = np.random.default_rng(seed)
    chosen = [rng.permutation(among[labels[among] == label])[:per_class] for label in np.unique(labels[among])]
    return np.sort(np.concatenate(chosen))
