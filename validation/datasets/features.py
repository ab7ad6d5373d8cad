"""Features of the spectrograms of a data set, at the size that it keeps."""

from __future__ import annotations

from t2d_rt.dataset import Dataset
from t2d_rt.dataset.products import axis
from t2d_rt.learn.features import features as features_of_map


def features(dataset: Dataset, position: int) -> dict[str, float]:
    """Features of a sample's spectrogram by name."""
    levels = dataset.values(position, "spectrogram")
    told = dataset.records[position]["products"]["spectrogram"]
    first, last = told["time_s"]
    return features_of_map(levels, axis(told["velocity_mps"], levels.shape[0]), last - first)
