"""Trained under one condition, tested under another: scenes, carriers, models of the body, what moves beside the person."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from t2d_rt.dataset import Dataset
from t2d_rt.dataset.splits import KINDS, traits
from t2d_rt.errors import InputError
from t2d_rt.learn.benchmark.claims import interval
from t2d_rt.learn.maps import LabelledMaps, maps_of
from t2d_rt.learn.markdown import table
from t2d_rt.learn.train import TrainOptions, scores_of, sides_of, train_model
from t2d_rt.learn.train.sides import check_sides
from t2d_rt.store import replacing

SEEDS = 0, 1, 2
MODEL = "streaming"
OPTIONS = TrainOptions(epochs=60, batch=16)
ALL, ALL_BUT = "all", "all but "
ALARM = "falling"
"""Class whose false alarms are told."""
FILE = "conditions.md"

Cells = dict[tuple[str, int], dict[str, np.ndarray]]
"""Confusion (class, told) by what was trained on and seed, for each condition that was tested on."""


def trainings(conditions: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Conditions that are trained on, by name: each alone, all together, and all but one where that leaves two or more."""
    found = {name: (name,) for name in conditions} | {ALL: tuple(conditions)}
    if len(conditions) > 2:
        found |= {f"{ALL_BUT}{left}": tuple(name for name in conditions if name != left) for left in conditions}
    return found


def run_conditions(dataset: Dataset, folder: Path, *, progress: Callable[[float], None] | None = None) -> Path:
    """Trains under each condition of a data set and tests under each, by description; writes conditions.md, whose path it gives.

    Cells, one for each training and seed, are kept in `folder`; those that are there are not run again.
    """
    conditions = tuple(each.name for each in dataset.recipe.conditions)
    if len(conditions) < 2:
        raise InputError(
            f"{dataset.path} has one condition only, {conditions[0]}; give a data set of two or more, as the recipes fidelity, "
            "carriers and room-interference make them"
        )
    maps = maps_of(dataset)
    of = np.array([each["condition"] for each in dataset.records])
    shared = [sorted(traits(record, KINDS)) for record in dataset.records]
    plain = json.dumps([maps.classes, of.tolist(), shared, OPTIONS.model_dump(mode="json")])
    stamp = hashlib.sha256(maps.levels.tobytes() + maps.labels.tobytes() + plain.encode()).hexdigest()[:16]
    (folder / "cells").mkdir(parents=True, exist_ok=True)
    cells: Cells = {}
    every = [(name, seed) for seed in SEEDS for name in trainings(conditions)]
    for number, (name, seed) in enumerate(every, 1):
        path = folder / "cells" / f"{name.replace(' ', '-')}_{seed}.json"
        if not path.exists():
            told = _confusions(dataset, maps, of, trainings(conditions)[name], seed)
            with replacing(path, lambda: None) as new:
                new.write_text(json.dumps({"stamp": stamp, "confusion": told}) + "\n", "utf-8")
        cells[name, seed] = _read(path, stamp, conditions)
        if progress is not None:
            progress(number / len(every))
    path = folder / FILE
    path.write_text(_report(dataset, conditions, maps.classes, cells), "utf-8")
    return path


def _confusions(
    dataset: Dataset, maps: LabelledMaps, of: np.ndarray, trained_on: Sequence[str], seed: int
) -> dict[str, list[list[int]]]:
    """Confusion (class, told) under each condition, of a network that was trained under some; `of` are those of the samples."""
    sides = sides_of(dataset.records, "description", seed=seed)
    known = np.isin(of, trained_on)
    train, val = (sides[each][known[sides[each]]] for each in ("train", "val"))
    tests = {str(each): sides["test"][of[sides["test"]] == each] for each in dict.fromkeys(of.tolist())}
    check_sides({"train": train, "val": val, **tests})
    net = train_model(MODEL, maps.take(train), maps.take(val), OPTIONS.model_copy(update={"seed": seed}))
    return {
        each: scores_of(net.probabilities(maps.levels[places]), maps.labels[places]).confusion.tolist()
        for each, places in tests.items()
    }


def _read(path: Path, stamp: str, conditions: Sequence[str]) -> dict[str, np.ndarray]:
    try:
        told = json.loads(path.read_text("utf-8"))
        found, confusion = told["stamp"], {each: np.array(told["confusion"][each]) for each in conditions}
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{path} is not what a benchmark wrote there; remove it, and it is computed again") from None
    if found != stamp:
        raise InputError(f"{path} is of other data; choose another folder")
    return confusion


def _report(dataset: Dataset, conditions: Sequence[str], classes: Sequence[str], cells: Cells) -> str:
    names = [*trainings(conditions)]

    def matrix(value: Callable[[np.ndarray], float]) -> str:
        rows = [
            (name, *(_told([value(cells[name, seed][test]) for seed in SEEDS]) for test in conditions))
            for name in names
        ]
        return table(("trained on", *(f"tested on {each}" for each in conditions)), rows)

    parts = [
        f"# Conditions of {dataset.recipe.name}",
        f"{len(dataset)} samples, by description, seeds {', '.join(map(str, SEEDS))}, {MODEL}; 95 % intervals over seeds.",
        "## Accuracy [%]", matrix(lambda confusion: 100.0 * np.trace(confusion) / confusion.sum()),
    ]  # fmt: skip
    if ALARM in classes:
        at = list(classes).index(ALARM)

        def alarms(confusion: np.ndarray) -> float:
            others = np.delete(confusion, at, 0)
            return 100.0 * float(others[:, at].sum() / others.sum())

        def missed(confusion: np.ndarray) -> float:
            return 100.0 * float(1.0 - confusion[at, at] / confusion[at].sum())

        parts += [f"## Others that are taken for {ALARM} [%]", matrix(alarms)]
        parts += [f"## Samples of {ALARM} that are missed [%]", matrix(missed)]
    return "\n\n".join(parts) + "\n"


def _told(values: Sequence[float]) -> str:
    mean, half = interval(values)
    return f"{mean:.0f} +- {half:.0f}"
