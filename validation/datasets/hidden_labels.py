"""Hidden labels: what tells the class of a sample beside the motion, which is where, how far away and for how long it is shown.

`python -m validation.datasets.hidden_labels DIR` evaluates a folder that is there.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np

from t2d_rt.dataset import Dataset, split
from t2d_rt.learn import TrainOptions, maps_of, train_model
from t2d_rt.learn.maps import LabelledMaps
from validation.datasets import of_a_set_made
from validation.report import Check, Section

ABOVE_CHANCE, MIRRORED = 0.05, 0.03
"""By how much a figure alone may tell the class, and what mirrored Doppler may cost."""
FOLDS, REPEATS, SEEDS = 5, 4, (0, 1, 2)
OPTIONS = TrainOptions(epochs=40, batch=16)


def figures(dataset: Dataset) -> dict[str, np.ndarray]:
    """What each sample's record and map tell beside the motion, (sample, figure) by what they tell."""
    told = {
        "SNR": ("snr_db",), "mean range": ("range_m",), "angle": ("angle_deg",), "moving time": ("moving",),
        "made and held": ("made_s", "held_s"), "share of approaching time": ("approaching",), "change of range": ("nearer_m",),
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
    """The maps with coming and going exchanged."""
    return replace(maps, levels=maps.levels[:, ::-1], velocity_mps=-maps.velocity_mps[::-1])


def right(dataset: Dataset, options: TrainOptions = OPTIONS, model: str = "vgg-7", size: int = 64) -> np.ndarray:
    """Fractions of unseen descriptions that a network puts into their class, as they are and mirrored, (seed, 2)."""
    maps, found = maps_of(dataset, size=(size, size)), []
    for seed in SEEDS:
        sides = split(dataset.records, (0.6, 0.15, 0.25), apart=("description", "seed"), seed=seed).sides
        train, val, test = (maps.take(dataset.positions(sides[name])) for name in ("train", "val", "test"))
        saved = train_model(model, train, val, options.model_copy(update={"seed": seed}))
        both = [saved.probabilities(each.levels).argmax(axis=1) for each in (test, mirrored(test))]
        found.append([float(np.mean(each == test.labels)) for each in both])
    return np.array(found)


def evaluated(dataset: Dataset) -> Section:
    """The section for a data set."""
    chance = 1.0 / len(dataset.classes)
    told = {name: accuracy(values, dataset.labels) for name, values in figures(dataset).items()}
    mixed = np.random.default_rng(0).permutation(dataset.labels)
    rows: list[dict[str, Any]] = [
        {"by": name, "right": f"{each:.1%}", "labels permuted": f"{accuracy(figures(dataset)[name], mixed):.1%}"}
        for name, each in told.items()
    ]
    plain, turned = right(dataset).mean(axis=0)
    checks = [
        Check(what=f"class told by {name} alone", measured=each, limit=chance + ABOVE_CHANCE, unit="")
        for name, each in told.items()
    ]
    lost = Check(what="what mirrored Doppler costs VGG-7", measured=plain - turned, limit=MIRRORED, unit="")
    return Section(
        title="Hidden labels of a data set", checks=[*checks, lost], table=rows,
        note=f"{len(dataset)} samples of {len(dataset.classes)} classes; by chance {chance:.1%} are right. Trees of twelve leaves "
        f"of ten samples or more, {FOLDS} folds, {REPEATS} times. VGG-7 of 64 x 64 cells puts {plain:.1%} of the unseen "
        f"descriptions into their class and {turned:.1%} of their mirror images, mean of {len(SEEDS)} splits. Angle, range, SNR, "
        "noise and the sign of coming or going are places and can be balanced; how far somebody travels, and so the change of "
        "range, is a part of what they do.",
    )  # fmt: skip


def run() -> Section:
    """The section, of a set that is made for it."""
    return of_a_set_made("small-hard", evaluated)


if __name__ == "__main__":
    section = evaluated(Dataset(sys.argv[1]))
    print(*section.checks, section.note, *section.table, sep="\n")
