"""Trained under one condition, tested under another: scenes, carriers, models of the body, what moves beside the person."""

from __future__ import annotations

import hashlib
import json
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar
from t2d_rt.dataset import Dataset
from t2d_rt.dataset.splits import KINDS, check_sides, traits
from t2d_rt.learn import TrainOptions, scores_of, sides_of, train_model
from t2d_rt.learn.maps import LabelledMaps, maps_of, shared_speeds
from t2d_rt.learn.models import card
from validation.studies.common import interval, kept_cell, table

SEEDS = 0, 1, 2, 3, 4, 5, 6, 7
"""Each with its own split, weights and order; more than elsewhere, as a side has few samples of each condition."""
MODEL = "envelope"
"""The network that learns most of few samples: a condition has a part of a data set only."""
OPTIONS = TrainOptions(epochs=42, batch=16, rate=2e-3, schedule="cosine", smoothing=0.1, decay=0.05)
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


@dataclass(frozen=True, slots=True)
class _Samples:
    """Samples of one data set or several, each with its condition."""

    name: str
    conditions: tuple[str, ...]
    records: tuple[Mapping[str, Any], ...]
    maps: LabelledMaps
    of: np.ndarray
    """(N,) of str, the condition of each sample."""

    def stamp(self) -> str:
        """Hash of everything that results follow from."""
        shared = [sorted(traits(record, KINDS)) for record in self.records]
        axes = [*self.maps.velocity_mps.tolist(), self.maps.duration_s]
        plain = json.dumps([MODEL, self.maps.classes, self.of.tolist(), shared, axes, OPTIONS.model_dump(mode="json")])
        return hashlib.sha256(self.maps.levels.tobytes() + self.maps.labels.tobytes() + plain.encode()).hexdigest()[:16]


def _joined(datasets: Sequence[Dataset]) -> _Samples:
    """Samples of data sets; where there are several, a condition has the name of its data set, too."""
    names = [each.path.resolve().name for each in datasets]
    double = [name for name, count in Counter(names).items() if count > 1]
    if double:
        raise InputError(f"two data sets are in folders that are called {double[0]}; give folders of different names")
    records: list[Mapping[str, Any]] = []
    conditions: list[str] = []
    of: list[str] = []
    for name, dataset in zip(names, datasets, strict=True):
        own = [each.name for each in dataset.recipe.conditions]
        called = {each: each if len(datasets) == 1 else name if len(own) == 1 else f"{name} {each}" for each in own}
        conditions += called.values()
        of += [called[record["condition"]] for record in dataset.records]
        records += [{**record, "index": len(records) + place} for place, record in enumerate(dataset.records)]
    for name in conditions:
        if name == ALL or name.startswith(ALL_BUT) or conditions.count(name) > 1:
            raise InputError(
                f"a condition is called {name}, as another one or as what is trained on several of them; rename it, or the folder"
            )
    if len(conditions) < 2:
        raise InputError(
            f"{datasets[0].path} has one condition only, {conditions[0]}; give a data set of two or more, as the recipes fidelity, "
            "carriers and room-interference make them, or several data sets"
        )
    cells, speeds_mps = card(MODEL).usual_size, shared_speeds(*datasets)
    first, *others = (maps_of(each, size=(cells, cells), speeds_mps=speeds_mps) for each in datasets)
    maps = first.joined(*others)
    return _Samples(", ".join(names), tuple(conditions), tuple(records), maps, np.array(of))


def run_conditions(
    datasets: Sequence[Dataset], folder: Path, *, progress: Callable[[float], None] | None = None
) -> Path:  # fmt: skip
    """Trains under each condition and tests under each, by description; writes conditions.md, whose path it gives.

    datasets: one of two conditions or more, or several of the same classes and axes, as with other noise or another background.
    Cells, one for each training and seed, are kept in `folder`; those that are there are not run again.
    """
    samples = _joined(datasets)
    stamp = samples.stamp()
    (folder / "cells").mkdir(parents=True, exist_ok=True)
    cells: Cells = {}
    every = [(name, seed) for seed in SEEDS for name in trainings(samples.conditions)]
    for number, (name, seed) in enumerate(every, 1):
        place = list(trainings(samples.conditions)).index(name)  # names of folders may be alike but for a space
        path = folder / "cells" / f"{place:02d}_{name.replace(' ', '-')}_{seed}.json"
        compute = partial(_confusions, samples, trainings(samples.conditions)[name], seed)
        told = kept_cell(path, compute, lambda told: set(samples.conditions) <= told["confusion"].keys(), stamp)
        cells[name, seed] = {each: np.array(told["confusion"][each]) for each in samples.conditions}
        if progress is not None:
            progress(number / len(every))
    path = folder / FILE
    path.write_text(_report(samples, cells), "utf-8")
    return path


def _confusions(samples: _Samples, trained_on: Sequence[str], seed: int) -> dict[str, dict[str, list[list[int]]]]:
    """Confusion (class, told) under each condition, of a network that was trained under some."""
    maps, of = samples.maps, samples.of
    sides = sides_of(samples.records, "description", seed=seed)
    known = np.isin(of, trained_on)
    train, val = (sides[each][known[sides[each]]] for each in ("train", "val"))
    tests = {str(each): sides["test"][of[sides["test"]] == each] for each in dict.fromkeys(of.tolist())}
    check_sides({"train": train, "val": val, **tests})
    net = train_model(MODEL, maps.take(train), maps.take(val), OPTIONS.model_copy(update={"seed": seed}))
    confusions = {
        each: scores_of(net.probabilities(maps.levels[places]), maps.labels[places]).confusion.tolist()
        for each, places in tests.items()
    }
    return {"confusion": confusions}


def _report(samples: _Samples, cells: Cells) -> str:
    conditions, classes = samples.conditions, samples.maps.classes
    names = [*trainings(conditions)]

    def matrix(value: Callable[[np.ndarray], float]) -> str:
        rows = [
            (name, *(_told([value(cells[name, seed][test]) for seed in SEEDS]) for test in conditions))
            for name in names
        ]
        return table(("trained on", *(f"tested on {each}" for each in conditions)), rows)

    parts = [
        f"# Conditions of {samples.name}",
        f"{len(samples.records)} samples, by description, seeds {', '.join(map(str, SEEDS))}, {MODEL}; 95 % intervals over seeds, "
        "whose splits share samples, so that they are somewhat too narrow.",
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


def add_options(parser: ArgumentParser) -> None:
    parser.add_argument("data", nargs="+", help="a data set of two conditions or more, or several data sets")
    parser.add_argument(
        "-o", "--output", required=True, help="folder of conditions.md and its cells; a stopped run goes on"
    )


def run(options: Namespace) -> str:
    with ProgressBar("conditions") as progress:
        path = run_conditions([Dataset(each) for each in options.data], Path(options.output), progress=progress)
    return f"wrote {path}"
