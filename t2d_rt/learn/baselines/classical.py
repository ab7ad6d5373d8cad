"""Gradient boosting and nearest centroid, trained on some maps and asked about others."""

from __future__ import annotations

import numpy as np

from t2d_rt.checks import unknown_name
from t2d_rt.errors import InputError
from t2d_rt.learn.baselines.features import features
from t2d_rt.learn.baselines.nearest_centroid import Centroids
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.require import require_learning

BASELINES = "gradient-boosting", "nearest-centroid"
SHORTEST_S, WIDEST_S = 1.2, 0.7
"""Of a map and of its cells: less does not hold a period of the slowest steps, wider ones do not tell them."""


def feature_table(maps: LabelledMaps) -> np.ndarray:
    """Features of each map, (N, F)."""
    cell_s = maps.duration_s / maps.size[1]
    if maps.duration_s < SHORTEST_S or cell_s > WIDEST_S:
        raise InputError(
            f"baselines take maps of {SHORTEST_S:g} s or more in cells of {WIDEST_S:g} s at most, in which steps are seen, got "
            f"{maps.duration_s:.3g} s in cells of {cell_s:.2g} s; take maps of more cells, longer samples, or a network"
        )
    rows = [[*features(each, maps.velocity_mps, maps.duration_s).values()] for each in maps.levels]
    return np.array(rows)


def baseline_probabilities(name: str, train: LabelledMaps, test: LabelledMaps, *, seed: int = 0) -> np.ndarray:
    """Probability of each class of the test's maps, (N, K), by a baseline that is trained on others of all classes."""
    if name not in BASELINES:
        raise unknown_name("baseline", name, BASELINES)
    known, asked = feature_table(train.checked_for_training()), feature_table(test)
    if name == "nearest-centroid":
        return Centroids.of(known, train.labels).probabilities(asked)
    require_learning()
    from sklearn.ensemble import HistGradientBoostingClassifier

    model = HistGradientBoostingClassifier(max_iter=100, min_samples_leaf=5, early_stopping=False, random_state=seed)
    return np.asarray(model.fit(known, train.labels).predict_proba(asked))
