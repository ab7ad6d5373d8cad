"""A line of the benchmark's table: how well a model classifies the samples that a data set's recipe reserves for the test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset
from t2d_rt.learn.maps import LabelledMaps, maps_of
from t2d_rt.learn.scores import Interval, interval_of


class Model(Protocol):
    """Interface of a classifier: any of scikit-learn, or a class of one's own."""

    def fit(self, levels: np.ndarray, labels: np.ndarray, /) -> Any:
        """Learns from maps as rows, (N, speed * time) [dB below the greatest cell of each], and indices of classes, (N,)."""

    def predict(self, levels: np.ndarray, /) -> np.ndarray:
        """Indices of the classes of maps as rows, (M,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Result of a model on the test side of a data set."""

    name: str
    samples: Mapping[str, int]
    """Number of samples on each side."""
    accuracy: Interval
    macro_f1: Interval
    by_condition: Mapping[str, tuple[float, int]]
    """Accuracy and number of samples for each condition of the test."""

    def __str__(self) -> str:
        sides = " / ".join(str(sample) for sample in self.samples.values())
        parts = ", ".join(f"{name} {right:.2f}" for name, (right, _) in self.by_condition.items())
        return f"| {self.name} | {sides} | {self.accuracy} | {self.macro_f1} | {parts} |"


def line(name: str, dataset: Dataset, told: np.ndarray) -> Line:
    """The line for a model that predicted the classes `told` (M,) for the test samples, in their order."""
    test = sides_of_recipe(dataset)["test"]
    labels, records = dataset.labels[test], [dataset.records[place] for place in test]
    told = np.asarray(told)
    if told.shape != labels.shape or not np.issubdtype(told.dtype, np.integer):
        raise InputError(
            f"a model must tell {len(labels)} numbers of classes, got {told.dtype} of shape {told.shape}; return whole numbers"
        )
    conditions = np.array([record["condition"] for record in records])
    groups = [[str(record["sentence"]) for record in records], [str(record["subject"]) for record in records]]
    accuracy, f1 = interval_of(labels, told, len(dataset.classes), groups)
    return Line(
        name=name,
        samples={side: len(places) for side, places in dataset.sides.items()},
        accuracy=accuracy,
        macro_f1=f1,
        by_condition={
            str(condition): (
                float(np.mean((told == labels)[conditions == condition])),
                int(np.sum(conditions == condition)),
            )
            for condition in np.unique(conditions)
        },
    )


def benchmark(folder: str | Path, model: Model, *, name: str | None = None, size: int = 64) -> Line:
    """Trains a model on the sides train and val of a data set whose recipe defines sides, and tests it on the side test.

    Raises InputError where the recipe has no sides, or the model does not predict a class for each map.

    folder: folder of the data set.
    model: a classifier of scikit-learn, or any object with `fit` and `predict`.
    name: name in the table; that of the model's Python class by default.
    size: number of cells of speed and of time of the maps.
    """
    dataset = Dataset(folder)
    sides, maps = sides_of_recipe(dataset), maps_of(dataset, size=(size, size))
    training_maps = maps.take(np.concatenate([places for side, places in sides.items() if side != "test"]))
    model.fit(in_rows(training_maps), training_maps.labels)
    return line(name or type(model).__name__, dataset, model.predict(in_rows(maps.take(sides["test"]))))


def in_rows(maps: LabelledMaps) -> np.ndarray:
    """Maps as rows, (N, speed * time); reshape(-1, *maps.size) restores them."""
    return maps.levels.reshape(len(maps), -1)


def sides_of_recipe(dataset: Dataset) -> dict[str, np.ndarray]:
    """Positions of the samples on each side; refuses a recipe without sides, and a side with missing samples."""
    sides = dataset.sides
    if not sides:
        raise InputError(
            f"recipe {dataset.recipe.name} has no sides, so nothing says what is the test; take the recipe benchmark-3"
        )
    empty = [name for name, places in sides.items() if not len(places)]
    if empty:
        raise InputError(f"{dataset.path} has no sample of side {empty[0]} yet; make more of its samples")
    return sides
