"""Labels and pictures belong together: on descriptions that it has not seen, a nearest-centroid classifier on features of the
Doppler envelope tells the eight classes apart.

`python -m validation.datasets.nearest_centroid DIR` evaluates a folder that is there.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

from t2d_rt.dataset import Dataset, dataset_sheet, folds
from t2d_rt.dataset.products import axis
from t2d_rt.learn.baselines import SHRINKAGE, Centroids
from t2d_rt.learn.features import features
from validation.datasets import of_a_set_made
from validation.report import Section, at_least, at_most, save_chart

RECIPE = "small-hard"
LIMIT = 0.6
BY_CHANCE = 0.2
"""Of 8 classes 1/8 are right by chance, in 320 samples with a standard deviation of 0.02."""
FOLDS, REPEATS = 10, 5


def features_of(dataset: Dataset, position: int) -> dict[str, float]:
    """Features of a sample's spectrogram by name, at the size that the data set keeps."""
    levels = dataset.values(position, "spectrogram")
    told = dataset.records[position]["products"]["spectrogram"]
    first, last = told["time_s"]
    return features(levels, axis(told["velocity_mps"], levels.shape[0]), last - first)


def confusion(dataset: Dataset, values: np.ndarray, labels: np.ndarray, *, shrinkage: float) -> np.ndarray:
    """How many samples of each class (row) are taken for each class, over all folds; descriptions are on one side."""
    found = np.zeros((len(dataset.classes),) * 2, dtype=np.int64)
    for train, test in _sides(dataset):
        model = Centroids.of(values[train], labels[train], shrinkage=shrinkage)
        np.add.at(found, (labels[test], model.labels(values[test])), 1)
    return found


def _sides(dataset: Dataset) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for seed in range(REPEATS):
        for fold in folds(dataset.records, FOLDS, apart=("description", "seed"), seed=seed):
            yield dataset.positions(fold.sides["train"]), dataset.positions(fold.sides["test"])


def evaluated(dataset: Dataset) -> Section:
    """The section for a data set."""
    told = [features_of(dataset, place) for place in range(len(dataset))]
    values = np.array([[*each.values()] for each in told])
    labels = dataset.labels
    found = confusion(dataset, values, labels, shrinkage=SHRINKAGE)
    plain = confusion(dataset, values, labels, shrinkage=1.0)
    mixed = confusion(dataset, values, np.random.default_rng(0).permutation(labels), shrinkage=SHRINKAGE)
    rows = [
        {
            "class": name,
            "right": f"{row[number] / row.sum():.0%}",
            "most often taken for": _second(row, number, dataset.classes),
        }
        for number, (name, row) in enumerate(zip(dataset.classes, found, strict=True))
    ]
    return Section(
        title="Classes of a data set",
        checks=[
            at_least(
                f"{RECIPE}: samples of unseen descriptions that the nearest centroid puts into their class",
                _right(found),
                LIMIT,
            ),
            at_most("the same with the labels permuted", _right(mixed), BY_CHANCE),
        ],
        note=f"{len(dataset)} samples of 8 classes, {len(told[0])} features of the Doppler envelope; {FOLDS} folds by description, "
        f"{REPEATS} times. The metric is the covariance within classes, shrunk by {SHRINKAGE:g}; with standardised features alone "
        f"{_right(plain):.0%} are right; by chance 12.5 % are.",
        table=rows,
        charts=[save_chart(dataset_sheet(dataset), "dataset_classes.png")],
    )


def _right(found: np.ndarray) -> float:
    return float(np.trace(found) / found.sum())


def _second(row: np.ndarray, number: int, names: tuple[str, ...]) -> str:
    others = np.where(np.arange(len(row)) == number, -1, row)
    best = int(np.argmax(others))
    return f"{names[best]} ({row[best] / row.sum():.0%})"


def run() -> Section:
    """The section, of a set that is made for it."""
    return of_a_set_made(RECIPE, evaluated)


if __name__ == "__main__":
    section = evaluated(Dataset(sys.argv[1]))
    print(*section.checks, section.note, *section.table, sep="\n")
