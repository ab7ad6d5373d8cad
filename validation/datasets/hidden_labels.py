"""Hidden labels: what tells the class of a sample beside the motion, which is where, how far away and for how long it is shown.

`python -m validation.datasets.hidden_labels DIR` evaluates a folder that is there.

Mirrored maps are more than a test of balanced directions: the range of somebody who goes straight past a radar is convex over time,
so that people come first and go then, and the mirror image of that does not occur. What they cost is an upper limit. What direction
alone tells is measured on the same samples, made again with every person turned round: the angle that is drawn for each sample is
changed while they are made, since other angles in the recipe would be another recipe, with other motions.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset, Recipe, folds, make_dataset
from t2d_rt.dataset.sample import _angle_deg
from t2d_rt.dataset.worker import make_samples
from t2d_rt.learn import TrainOptions, maps_of, train_model
from t2d_rt.learn.maps import LabelledMaps
from validation.datasets import of_a_set_made
from validation.report import Section, at_most

ABOVE_CHANCE, MIRRORED = 0.05, 0.03
"""By how much a figure alone may tell the class, and what mirrored Doppler, or people who are turned round, may cost."""
TRAVEL = {"share of approaching time": 1.0, "change of range": 0.0}
"""Figures of how people travel, which is a part of what they do, and what each and its mirror image add up to: what their direction
adds to the class is a hidden label, how far and how steadily it is gone is none."""
FOLDS, REPEATS, TURNS, SEEDS, DRAWS = 5, 4, 4, (0, 1), 2000
OPTIONS = TrainOptions(epochs=40, batch=16)


def figures(dataset: Dataset) -> dict[str, np.ndarray]:
    """What each sample's record and map tell beside the motion, (sample, figure) by what they tell."""
    told = {
        "SNR": ("snr_db",), "mean range": ("range_m",), "angle": ("angle_deg",), "moving time": ("moving",),
        "time held": ("held_s",), "time made": ("made_s",), "share of approaching time": ("approaching",),
        "change of range": ("nearer_m",),
    }  # fmt: skip
    found = {
        name: np.array([[each[key] for key in keys] for each in dataset.records], float) for name, keys in told.items()
    }
    levels = [dataset.values(place, "spectrogram") for place in range(len(dataset))]
    peaks = [each["products"]["spectrogram"]["peak_db"] for each in dataset.records]
    floors = [float(np.percentile(each, 10)) + peak for each, peak in zip(levels, peaks, strict=True)]
    return {**found, "coming or going": np.sign(found["change of range"]), "noise level": np.array(floors)[:, None]}


def accuracy(values: np.ndarray, labels: np.ndarray) -> float:
    """Fraction of the samples that trees of a few leaves put into their class, in cross-validation."""
    from sklearn.model_selection import RepeatedStratifiedKFold, cross_val_score
    from sklearn.tree import DecisionTreeClassifier

    model = DecisionTreeClassifier(max_leaf_nodes=12, min_samples_leaf=10, random_state=0)
    sides = RepeatedStratifiedKFold(n_splits=FOLDS, n_repeats=REPEATS, random_state=0)
    return float(cross_val_score(model, values, labels, cv=sides).mean())


def mirrored(maps: LabelledMaps) -> LabelledMaps:
    """The maps with coming and going exchanged.

    Raises InputError where they reach farther on one side of zero: their mirror images would show other speeds.
    """
    speeds = maps.velocity_mps
    if not np.allclose(speeds, -speeds[::-1], atol=0.01 * (speeds[1] - speeds[0])):
        raise InputError(
            f"maps from {speeds[0]:.3f} to {speeds[-1]:.3f} m/s have no mirror images of the same speeds; make the data set again"
        )
    return replace(maps, levels=maps.levels[:, ::-1])


def turned_samples(*task: Any) -> Any:
    """What `make_samples` makes if 180 degrees are added to each angle that is drawn."""

    def opposite_deg(rng: np.random.Generator, spans: Sequence[tuple[float, float]]) -> float:
        return _angle_deg(rng, spans) + 180.0

    with patch("t2d_rt.dataset.sample._angle_deg", opposite_deg):
        return make_samples(*task)


def turned(recipe: Recipe, count: int, folder: Path) -> Dataset:
    """The first samples of a recipe, made in `folder` with every person turned round: at the same mean range, who came goes."""
    with patch("t2d_rt.dataset.making.make_samples", turned_samples):
        make_dataset(recipe, folder, limit=count)
    return Dataset(folder)


def right(dataset: Dataset, options: TrainOptions = OPTIONS, model: str = "vgg-7") -> np.ndarray:
    """Whether a network puts samples of descriptions that it has not seen into their class, their mirror images, and the same
    people turned round, (seed, N, 3)."""
    maps = maps_of(dataset)
    with tempfile.TemporaryDirectory() as folder:
        again = turned(dataset.recipe, max(dataset.indices) + 1, Path(folder))
        others = mirrored(maps), maps_of(again).take(again.positions(dataset.indices))
    found = np.zeros((len(SEEDS), len(maps), 3), bool)
    for seed in SEEDS:
        sides = folds(dataset.records, FOLDS, apart=("description", "seed"), seed=seed)
        tests = [dataset.positions(each.sides["test"]) for each in sides]
        for number, test in enumerate(tests):
            val = tests[number - 1]
            train = np.setdiff1d(np.arange(len(maps)), np.concatenate([test, val]))
            saved = train_model(model, maps.take(train), maps.take(val), options.model_copy(update={"seed": seed}))
            for kind, each in enumerate((maps, *others)):
                chosen = each.take(test)
                found[seed, test, kind] = saved.probabilities(chosen.levels).argmax(axis=1) == chosen.labels
    return found


def interval(lost: np.ndarray, groups: np.ndarray) -> tuple[float, float]:
    """95 % interval of the mean of what each sample lost (N,), were other groups drawn (bootstrap)."""
    _, number = np.unique(groups, return_inverse=True)
    sums, counts = np.bincount(number, lost), np.bincount(number)
    drawn = np.random.default_rng(0).integers(len(counts), size=(DRAWS, len(counts)))
    low, high = np.percentile(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), [2.5, 97.5])
    return float(low), float(high)


def told_as(low_high: tuple[float, float]) -> str:
    """An interval in points."""
    low, high = low_high
    return f"{100 * low:.1f} to {100 * high:.1f}"


def directionless(values: np.ndarray, whole: float, labels: np.ndarray) -> float:
    """`accuracy` by a figure whose samples are taken for their mirror images by chance, as often as not, mean of some draws."""
    rng = np.random.default_rng(0)
    drawn = [np.where(rng.random(values.shape) < 0.5, whole - values, values) for _ in range(TURNS)]
    return float(np.mean([accuracy(each, labels) for each in drawn]))


def evaluated(dataset: Dataset) -> Section:
    """The section for a data set."""
    chance, found, labels = 1.0 / len(dataset.classes), figures(dataset), dataset.labels
    told = {name: accuracy(values, labels) for name, values in found.items()}
    travel = {name: directionless(found[name], whole, labels) for name, whole in TRAVEL.items()}
    mixed = np.random.default_rng(0).permutation(labels)
    rows: list[dict[str, Any]] = [
        {
            "by": name,
            "right": f"{each:.1%}",
            "without direction": f"{travel[name]:.1%}" if name in travel else "",
            "labels permuted": f"{accuracy(found[name], mixed):.1%}",
        }
        for name, each in told.items()
    ]
    shown = right(dataset).mean(axis=0)
    groups = np.array([f"{each['class']} {each['description']}" for each in dataset.records])
    plain, *others = shown.mean(axis=0)
    lost = [interval(shown[:, 0] - shown[:, kind], groups) for kind in (1, 2)]
    checks = [at_most(f"class told by {name} alone", each, chance + ABOVE_CHANCE) for name, each in told.items()]
    checks += [
        at_most(f"what direction adds to the class told by {name}", told[name] - each, ABOVE_CHANCE)
        for name, each in travel.items()
    ]
    for name, each in zip(("mirrored Doppler costs", "people who are turned round cost"), others, strict=True):
        checks.append(at_most(f"what {name} VGG-7", plain - each, MIRRORED))
    return Section(
        title="Hidden labels of a data set", checks=checks, table=rows,
        note=f"{len(dataset)} samples of {len(dataset.classes)} classes; by chance {chance:.1%} are right. Trees of twelve leaves "
        f"of ten samples or more, {FOLDS} folds, {REPEATS} times. VGG-7, trained on other descriptions in {FOLDS} folds, "
        f"{len(SEEDS)} times, puts {plain:.1%} of all samples into their class, {others[0]:.1%} of their mirror images "
        f"({told_as(lost[0])} points lost in 95 % of sets of as many other descriptions), and {others[1]:.1%} where people are "
        f"turned round ({told_as(lost[1])}). Angle, range, SNR, noise, and which way people go can be balanced; how far "
        "somebody travels, how steadily, and how long an action takes are parts of what they do.",
    )  # fmt: skip


def run() -> Section:
    """The section, of a set that is made for it."""
    return of_a_set_made("small-hard", evaluated)


if __name__ == "__main__":
    section = evaluated(Dataset(sys.argv[1]))
    print(*section.checks, section.note, *section.table, sep="\n")
