"""`predict` on recordings of three activities in a row, of descriptions that the network was not trained on.

Samples of the test side are simulated anew, their ADC samples put one after another, and told by sliding windows.
`python -m validation.datasets.three_activities DIR` evaluates a folder of the recipe small-hard.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

import numpy as np

from t2d_rt.dataset import Dataset, Recipe
from t2d_rt.dataset.sample import sample
from t2d_rt.learn.maps import LabelledMaps, maps_of
from t2d_rt.learn.train import Augment, SavedModel, TrainOptions, scores_of, sides_of, train_model
from t2d_rt.learn.windows import Prediction, windows_of
from t2d_rt.result import Recording
from t2d_rt.simulate import run as simulate
from validation.report import Check, Section

TOGETHER, RECORDINGS = 3, 12
AWAY_S = 1.0
"""From a change of activities, from where on it counts."""
STEP_S = 0.5
LIMIT = 0.8
SLIDING = "with what comes before and after"


def triples(labels: np.ndarray, test: np.ndarray, count: int, seed: int = 0) -> list[np.ndarray]:
    """Positions of samples of the test side, three different classes each, no sample twice as long as there are others."""
    rng = np.random.default_rng(seed)
    found: list[np.ndarray] = []
    left = rng.permutation(test)
    while len(found) < count:
        chosen: list[int] = []
        for place in left:
            if labels[place] not in labels[chosen]:
                chosen.append(int(place))
            if len(chosen) == TOGETHER:
                break
        if len(chosen) < TOGETHER:
            left = rng.permutation(test)
            continue
        found.append(np.array(chosen))
        left = left[~np.isin(left, chosen)]
    return found


def joined(recipe: Recipe, indices: Sequence[int]) -> Recording:
    """One recording of samples by their indices, one after another."""
    parts = [simulate(sample(recipe, index).experiment, device="cpu", progress=False) for index in indices]
    return Recording(np.concatenate([np.asarray(each.adc.values) for each in parts]), parts[0].radar)


def right_of(told: Prediction, labels: Sequence[int], duration_s: float) -> float:
    """Fraction of the time away from changes at which the class is right."""
    times_s = np.arange(0.05, TOGETHER * duration_s, 0.1)
    within = times_s % duration_s
    changes = np.minimum(
        np.where(times_s > duration_s, within, np.inf),
        np.where(times_s < (TOGETHER - 1) * duration_s, duration_s - within, np.inf),
    )
    away = changes >= AWAY_S
    truth = np.asarray(labels)[np.minimum((times_s / duration_s).astype(int), TOGETHER - 1)]
    return float(np.mean(told.at(times_s[away]) == truth[away]))


def told_by(nets: Mapping[str, SavedModel], recording: Recording) -> dict[str, Prediction]:
    """What `predict` tells by each of several networks of the same axes, whose windows are made once."""
    first = next(iter(nets.values()))
    starts_s, levels = windows_of(first, recording, STEP_S)
    return {
        name: Prediction(
            classes=net.card.classes, starts_s=starts_s, duration_s=net.card.duration_s, probabilities=net.probabilities(levels)
        )
        for name, net in nets.items()
    }  # fmt: skip


def trained(maps: LabelledMaps, sides: dict[str, np.ndarray], augment: Augment) -> SavedModel:
    """The streaming network."""
    options = TrainOptions(epochs=100, batch=16, augment=augment)
    return train_model("streaming", maps.take(sides["train"]), maps.take(sides["val"]), options)


def evaluated(dataset: Dataset) -> Section:
    """The section for a data set."""
    maps, recipe = maps_of(dataset), dataset.recipe
    sides = sides_of(dataset.records, "description")
    test = maps.take(sides["test"])
    models = {"as they are": Augment(), SLIDING: Augment.sliding()}
    nets = {name: trained(maps, sides, each) for name, each in models.items()}
    rows = []
    right: dict[str, list[float]] = {name: [] for name in nets}
    for places in triples(maps.labels, sides["test"], RECORDINGS):
        recording = joined(recipe, [int(dataset.indices[place]) for place in places])
        told = {
            name: right_of(each, maps.labels[places], recipe.duration_s)
            for name, each in told_by(nets, recording).items()
        }
        for name, value in told.items():
            right[name].append(value)
        names = ", ".join(maps.classes[label] for label in maps.labels[places])
        rows.append({"activities": names, **{name: f"{value:.0%}" for name, value in told.items()}})
    plain = {name: scores_of(net.probabilities(test.levels), test.labels).accuracy for name, net in nets.items()}
    means = {name: float(np.mean(values)) for name, values in right.items()}
    return Section(
        title="Three activities in a row",
        checks=[
            Check(
                what="predict: time away from changes at which the class is right, of descriptions not trained on",
                measured=means[SLIDING], limit=LIMIT, unit="", at_least=True,
            ),
        ],
        note=f"{RECORDINGS} recordings of {TOGETHER} x {recipe.duration_s:g} s, the streaming network trained on "
        f"{len(sides['train'])} samples of {recipe.name}, changes left out by {AWAY_S:g} s. Means: "
        + "; ".join(f"trained {name} {value:.0%}" for name, value in means.items())
        + ". Single samples of the same descriptions: "
        + "; ".join(f"trained {name} {value:.0%}" for name, value in plain.items()) + ".",
        table=rows,
    )  # fmt: skip


if __name__ == "__main__":
    section = evaluated(Dataset(sys.argv[1]))
    print(*section.checks, section.note, *section.table, sep="\n")
