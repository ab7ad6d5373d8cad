"""Classical classifiers of spectrograms by features of their Doppler envelope: what a network has to beat."""

from t2d_rt.learn.baselines.classical import BASELINES, baseline_probabilities, feature_table
from t2d_rt.learn.baselines.features import features
from t2d_rt.learn.baselines.nearest_centroid import SHRINKAGE, Centroids

__all__ = ["BASELINES", "SHRINKAGE", "Centroids", "baseline_probabilities", "feature_table", "features"]
