"""Gradient boosting and nearest centroid, trained on some maps and asked about others."""

from __future__ import annotations

import numpy as np

from t2d_rt.core.checks import unknown_name
from t2d_rt.learn.baselines.features import check_steps, features
from t2d_rt.learn.baselines.nearest_centroid import Centroids
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.pytorch import require_learning

BASELINES = "gradient-boosting", "nearest-centroid"


def feature_table(maps: LabelledMaps) -> np.ndarray:
    """Features of each map, (N, F)."""
    check_steps("baselines", maps.size[1], maps.duration_s)
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
