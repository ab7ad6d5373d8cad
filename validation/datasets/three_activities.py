"""`predict` on recordings of three activities in a row, of descriptions that nothing was trained or chosen on.

Samples of the same recipe with another seed, whose sentences the data set does not have, are simulated, their ADC samples put one
after another, and told by sliding windows.
`python -m validation.datasets.three_activities DIR... --seed N --recordings M` trains on folders of the recipe hard or small-hard,
which may have other seeds and so other descriptions, draws M recordings of the recipe with seed N, and writes nothing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset, Recipe
from t2d_rt.dataset.sample import cell_of, description_of, sample
from t2d_rt.learn import Augment, Ensemble, TrainOptions, sides_of, train_model
from t2d_rt.learn.maps import LabelledMaps, maps_of
from t2d_rt.learn.prediction import LEAST, Prediction, predict
from t2d_rt.recording.recording import Recording
from t2d_rt.simulate import run as simulate
from validation.report import Section, at_least
from validation.studies.common import interval

TOGETHER, RECORDINGS = 3, 40
AWAY_S = 1.0
"""From a change of activities, from where on it counts."""
STEP_S = 0.5
LIMIT = 0.8
SIZE = 128, 128
MEMBERS = 4
"""Networks whose probabilities are averaged: every other one is trained on the samples as they are, the others on windows that
slide."""
FRACTIONS = 0.9, 0.1
OPTIONS = TrainOptions(epochs=42, batch=64, rate=2e-3, schedule="cosine", smoothing=0.1, decay=0.05)


def unseen(recipe: Recipe, sentences: set[str], count: int) -> Iterator[list[int]]:
    """Indices of samples of a recipe for so many recordings, three different classes each, whose sentences are not among those."""
    rng = np.random.default_rng(0)
    left = [int(each) for each in rng.permutation(len(recipe.classes) * recipe.descriptions_per_class)]
    for _ in range(count):
        chosen: list[int] = []
        for index in left:
            cell = cell_of(recipe, index)
            known = {cell_of(recipe, each).activity for each in chosen}
            if cell.activity not in known and description_of(recipe, cell).sentence not in sentences:
                chosen.append(index)
            if len(chosen) == TOGETHER:
                break
        if len(chosen) < TOGETHER:
            raise InputError(
                f"recipe {recipe.name} has too few sentences that nothing was trained on; give another seed"
            )
        left = [each for each in left if each not in chosen]
        yield chosen


def joined(recipe: Recipe, indices: Sequence[int]) -> Recording:
    """One recording of samples by their indices, one after another."""
    parts = [simulate(sample(recipe, index).experiment, device="cpu", progress=False) for index in indices]
    return Recording(np.concatenate([np.asarray(each.adc.values) for each in parts]), parts[0].radar)


def told_of(told: Prediction, labels: Sequence[int], duration_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Class and told class at times that are away from changes, every 0.1 s."""
    times_s = np.arange(0.05, TOGETHER * duration_s, 0.1)
    within = times_s % duration_s
    changes = np.minimum(
        np.where(times_s > duration_s, within, np.inf),
        np.where(times_s < (TOGETHER - 1) * duration_s, duration_s - within, np.inf),
    )
    away = changes >= AWAY_S
    truth = np.asarray(labels)[np.minimum((times_s / duration_s).astype(int), TOGETHER - 1)]
    return truth[away], told.at(times_s[away])


def trained(maps: LabelledMaps, sides: dict[str, np.ndarray]) -> Ensemble:
    """Networks of all kinds that `predict` averages."""
    ways = Augment(), Augment.sliding()
    return Ensemble(tuple(
        train_model(
            "envelope", maps.take(sides["train"]), maps.take(sides["val"]),
            OPTIONS.model_copy(update={"seed": number, "augment": ways[number % len(ways)]}),
        )
        for number in range(MEMBERS)
    ))  # fmt: skip


def alone(told: Prediction, labels: Sequence[int], duration_s: float) -> list[bool]:
    """Whether the window that is nearest to each activity, which hardly sees another, is told right."""
    middles = (np.arange(TOGETHER) + 0.5) * duration_s
    nearest = np.abs(middles[:, None] - told.middles_s).argmin(axis=1)
    return [bool(each) for each in told.probabilities[nearest].argmax(axis=1) == np.asarray(labels)]


def evaluated(*datasets: Dataset, seed: int | None = None, recordings: int = RECORDINGS) -> Section:
    """The section for data sets of one recipe, trained on together, and so many recordings of that recipe with another seed."""
    if len({each.recipe.model_copy(update={"seed": 0}).hash for each in datasets}) > 1:
        raise InputError("the data sets are of different recipes; give those of one, which may have different seeds")
    seeds = {each.recipe.seed for each in datasets}
    seed = max(seeds) + 1 if seed is None else seed
    if seed in seeds:
        raise InputError(f"seed {seed} is that of a data set that is trained on; give another one")
    first, *others = (maps_of(each, size=SIZE) for each in datasets)
    maps, recipe = first.joined(*others), datasets[0].recipe
    every = [record for each in datasets for record in each.records]
    records = [{**record, "index": place} for place, record in enumerate(every)]
    known = {str(each["sentence"]) for each in records}
    parts = sides_of(records, "description", fractions=(FRACTIONS[0], FRACTIONS[1] / 2, FRACTIONS[1] / 2))
    sides = {"train": parts["train"], "val": np.concatenate([parts["val"], parts["test"]])}
    model = trained(maps, sides)
    other = recipe.model_copy(update={"seed": seed})
    rows, single, confusion = [], [], np.zeros((len(maps.classes),) * 2, dtype=int)
    right: dict[str, list[float]] = {"course": [], "windows": []}
    for indices in unseen(other, known, recordings):
        names = [cell_of(other, index).activity for index in indices]
        labels = [maps.classes.index(each) for each in names]
        told = predict(model, joined(other, indices), step_s=STEP_S)
        for name, each in (("course", told), ("windows", replace(told, least_s=0.0))):
            truth, found = told_of(each, labels, recipe.duration_s)
            right[name].append(float(np.mean(truth == found)))
            if name == "course":
                np.add.at(confusion, (truth, found), 1)
        single += alone(told, labels, recipe.duration_s)
        rows.append({"activities": ", ".join(names), **{name: f"{each[-1]:.0%}" for name, each in right.items()}})
        print(rows[-1], flush=True)
    means = {name: interval([100 * each for each in values]) for name, values in right.items()}
    each = 100 * np.diag(confusion) / np.maximum(confusion.sum(axis=1), 1)
    return Section(
        title="Three activities in a row",
        checks=[
            at_least(
                "predict: time away from changes at which the class is right, of descriptions not trained on",
                means["course"][0] / 100,
                LIMIT,
            ),
        ],
        note=f"{recordings} recordings of {TOGETHER} x {recipe.duration_s:g} s; {MEMBERS} networks trained on "
        f"{len(sides['train'])} samples of {recipe.name}, changes left out by {AWAY_S:g} s. Right, mean and 95 % interval over "
        + f"recordings: likeliest course of activities of {LEAST * recipe.duration_s:g} s or more "
        + f"{means['course'][0]:.0f} +- {means['course'][1]:.0f} %, each window for itself {means['windows'][0]:.0f} +- "
        + f"{means['windows'][1]:.0f} %; windows that hold one activity {np.mean(single):.0%} of {len(single)}. By class: "
        + ", ".join(f"{name} {value:.0f} %" for name, value in zip(maps.classes, each, strict=True))
        + f". Confusion (class, told) in tenths of a second: {confusion.tolist()}.",
        table=rows,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", nargs="+")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--recordings", type=int, default=RECORDINGS)
    given = parser.parse_args()
    section = evaluated(*map(Dataset, given.folder), seed=given.seed, recordings=given.recordings)
    print(*section.checks, section.note, sep="\n")
