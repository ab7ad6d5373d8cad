"""Nearest centroid of features of the Doppler envelope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SHRINKAGE = 0.3
"""Of the covariance within classes towards a multiple of the unit matrix: there are more features than samples of a class."""


@dataclass(frozen=True, slots=True)
class Centroids:
    """Mean features of each class, in a metric in which samples of one class scatter alike in all directions."""

    mean: np.ndarray
    """Of each feature, (F,)."""
    scale: np.ndarray
    """Standard deviation of each feature, (F,)."""
    whitening: np.ndarray
    """Factor of the inverse covariance within classes, (F, F)."""
    centroids: np.ndarray
    """In that metric, (K, F)."""

    @classmethod
    def of(cls, values: np.ndarray, labels: np.ndarray, *, shrinkage: float = SHRINKAGE) -> Centroids:
        """From samples (N, F); with a shrinkage of 1 the metric is that of standardised features."""
        mean, scale = values.mean(axis=0), values.std(axis=0) + 1e-9
        plain = (values - mean) / scale
        centroids = np.stack([plain[labels == label].mean(axis=0) for label in range(labels.max() + 1)])
        within = plain - centroids[labels]
        covariance = within.T @ within / len(within)
        count = len(covariance)
        mean_variance = float(np.trace(covariance)) / count or 1.0  # of classes of one sample each nothing is known
        shrunk = (1 - shrinkage) * covariance + shrinkage * mean_variance * np.eye(count)
        whitening = np.linalg.cholesky(np.linalg.inv(shrunk))
        return cls(mean, scale, whitening, centroids @ whitening)

    def labels(self, values: np.ndarray) -> np.ndarray:
        """Class of the nearest centroid, (N,)."""
        return np.asarray(np.argmin(self.distances(values), axis=1))

    def distances(self, values: np.ndarray) -> np.ndarray:
        """Squared distance to each centroid, (N, K)."""
        placed = (values - self.mean) / self.scale @ self.whitening
        return np.asarray(((placed[:, None] - self.centroids) ** 2).sum(axis=-1))

    def probabilities(self, values: np.ndarray) -> np.ndarray:
        """Of each class, (N, K), where classes scatter about their centroids alike and normally."""
        logits = -0.5 * self.distances(values)
        likelihood = np.exp(logits - logits.max(axis=1, keepdims=True))
        return np.asarray(likelihood / likelihood.sum(axis=1, keepdims=True))
