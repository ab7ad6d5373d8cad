"""Classical classifiers of spectrograms by features, as a baseline for networks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.core.checks import unknown_name
from t2d_rt.learn.features import check_steps, features
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.pytorch import require_learning

__all__ = ["baseline_probabilities", "feature_table"]

SHRINKAGE = 0.3
"""Weight of a multiple of the unit matrix in the covariance within classes, which is singular for fewer samples than features."""


@dataclass(frozen=True, slots=True)
class Centroids:
    """Nearest-centroid classifier: mean features of each class, in a metric in which samples scatter equally in all directions
    about their class."""

    mean: np.ndarray
    """Mean of each feature, (F,)."""
    scale: np.ndarray
    """Standard deviation of each feature, (F,)."""
    whitening: np.ndarray
    """Whitening matrix, a factor of the inverse covariance within classes, (F, F)."""
    centroids: np.ndarray
    """Mean of each class after whitening, (K, F)."""

    @classmethod
    def of(cls, values: np.ndarray, labels: np.ndarray, *, shrinkage: float = SHRINKAGE) -> Centroids:
        """Fits the classifier to samples (N, F); with a shrinkage of 1 the metric is that of standardised features."""
        mean, scale = values.mean(axis=0), values.std(axis=0) + 1e-9
        standardised = (values - mean) / scale
        centroids = np.stack([standardised[labels == label].mean(axis=0) for label in range(labels.max() + 1)])
        within = standardised - centroids[labels]
        covariance = within.T @ within / len(within)
        count = len(covariance)
        mean_variance = float(np.trace(covariance)) / count or 1.0  # single samples have no scatter
        shrunk = (1 - shrinkage) * covariance + shrinkage * mean_variance * np.eye(count)
        whitening = np.linalg.cholesky(np.linalg.inv(shrunk))
        return cls(mean, scale, whitening, centroids @ whitening)

    def labels(self, values: np.ndarray) -> np.ndarray:
        """Index of the class with the nearest centroid, (N,)."""
        return np.asarray(np.argmin(self.distances(values), axis=1))

    def distances(self, values: np.ndarray) -> np.ndarray:
        """Squared distance to each centroid, (N, K)."""
        placed = (values - self.mean) / self.scale @ self.whitening
        return np.asarray(((placed[:, None] - self.centroids) ** 2).sum(axis=-1))

    def probabilities(self, values: np.ndarray) -> np.ndarray:
        """Probability of each class, (N, K), if samples are normally distributed about their centroids with equal scatter."""
        logits = -0.5 * self.distances(values)
        likelihood = np.exp(logits - logits.max(axis=1, keepdims=True))
        return np.asarray(likelihood / likelihood.sum(axis=1, keepdims=True))


BASELINES = "gradient-boosting", "nearest-centroid"


def feature_table(maps: LabelledMaps) -> np.ndarray:
    """Features of each map as a table, (N, F)."""
    check_steps("baselines", maps.size[1], maps.duration_s)
    rows = [[*features(level, maps.velocity_mps, maps.duration_s).values()] for level in maps.levels]
    return np.array(rows)


def baseline_probabilities(name: str, train: LabelledMaps, test: LabelledMaps, *, seed: int = 0) -> np.ndarray:
    """Probability of each class for the test maps, (N, K), by a baseline that is trained on the maps `train` of all classes."""
    if name not in BASELINES:
        raise unknown_name("baseline", name, BASELINES)
    train_features, test_features = feature_table(train.checked_for_training()), feature_table(test)
    if name == "nearest-centroid":
        return Centroids.of(train_features, train.labels).probabilities(test_features)
    require_learning()
    from sklearn.ensemble import HistGradientBoostingClassifier

    model = HistGradientBoostingClassifier(max_iter=100, min_samples_leaf=5, early_stopping=False, random_state=seed)
    return np.asarray(model.fit(train_features, train.labels).predict_proba(test_features))
