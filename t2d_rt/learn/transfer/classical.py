"""The classical baseline: extra trees on mean and greatest level of each Doppler bin, of all radars one after another."""

from __future__ import annotations

import numpy as np

from t2d_rt.learn.transfer.events import Events

TREES = 200


def bin_features(events: Events) -> np.ndarray:
    """Mean and greatest level above the noise of each bin of each radar [dB], (E, V * 2 * speed)."""
    above = events.above_median_db
    return np.concatenate([above.mean(axis=3), above.max(axis=3)], axis=2).reshape(len(events), -1)


def extra_trees(train: Events, test: Events, seed: int) -> np.ndarray:
    """Labels of the test events, (E,), by trees that were grown on the others."""
    from sklearn.ensemble import ExtraTreesClassifier

    trees = ExtraTreesClassifier(TREES, random_state=seed, n_jobs=1)
    return np.asarray(trees.fit(bin_features(train), train.labels).predict(bin_features(test)), dtype=np.int64)
