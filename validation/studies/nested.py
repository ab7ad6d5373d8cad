"""Real events alone, nothing chosen outside the training: repeated grouped folds, with settings tuned in folds within each.

An event is on one side of every fold, inner and outer, with the maps of all radars. Each repetition draws its folds, inner ones and
weights by a seed of its own. Settings of least error in the inner folds are trained anew on all of the training and tell the test.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2d_rt.core.checks import integer
from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar
from t2d_rt.learn.fine_tuning import (
    EventNet,
    Events,
    Schedule,
    fine_tune,
    labels_of,
    pretrain,
    random_network,
    trained_on,
)
from t2d_rt.learn.pytorch import torch_threads
from t2d_rt.learn.scores import macro_f1
from validation.studies.common import add_real_options, kept_cell, real_and_twins, table, write_whole
from validation.studies.transfer import at_most, extra_trees, gain, grouped_folds, with_interval

FOLDS, INNER = 5, 3
Told = Callable[[Events, Events, int, EventNet], np.ndarray]
"""Labels of test events (E,) by training ones, a seed, and a network that knows simulation."""


def _trees(
    share: float | Literal["sqrt"], leaf: int, train: Events, test: Events, seed: int, _: EventNet
) -> np.ndarray:
    return extra_trees(train, test, seed, share=share, leaf=leaf)


def _tuned(schedule: Schedule, scratch: bool, train: Events, test: Events, seed: int, known: EventNet) -> np.ndarray:
    """All weights learn, from random ones or from those that know simulation."""
    net = random_network(len(train.classes), seed) if scratch else deepcopy(known)
    return labels_of(trained_on(net, train, schedule, seed), test)


def _strategy(name: str, train: Events, test: Events, seed: int, known: EventNet) -> np.ndarray:
    return labels_of(fine_tune(name, known, train, seed=seed), test)


SCHEDULES = [Schedule(20, 1e-3), Schedule(40, 1e-3), Schedule(80, 1e-3), Schedule(40, 3e-3)]
METHODS: dict[str, Mapping[str, Told]] = {
    "extra trees": {
        f"{share} of features, {leaf} in a leaf": partial(_trees, share, leaf)
        for share in ("sqrt", 0.1, 0.3)
        for leaf in (1, 2)
    },
    "from scratch": {f"{each.epochs} epochs at {each.rate:g}": partial(_tuned, each, True) for each in SCHEDULES},
    "pre-trained": {
        "last layer": partial(_strategy, "last layer"),
        "linear probing": partial(_strategy, "linear probing"),
        "skip connection": partial(_strategy, "skip connection"),
        **{f"all weights, {each.epochs} epochs at {each.rate:g}": partial(_tuned, each, False) for each in SCHEDULES},
    },
}
"""By name, the settings that inner folds choose from."""


def told(ways: Mapping[str, Told], train: Events, test: Events, seed: int, known: EventNet) -> tuple[np.ndarray, str]:
    """Labels of the test events, (E,), and the settings that inner folds of the training chose; of equal ones the first."""
    if int(np.bincount(train.labels, minlength=len(train.classes)).min()) < INNER:
        raise InputError(f"inner folds need {INNER} training events of each class; give more events or fewer folds")
    fold, scores = grouped_folds(train.labels, INNER, seed), {}
    for name, way in ways.items():
        found = np.zeros(len(train), dtype=np.int64)
        for number in range(INNER):
            inner, held = np.flatnonzero(fold != number), np.flatnonzero(fold == number)
            found[held] = way(train.take(inner), train.take(held), 10 * seed + number, known)
        scores[name] = float(macro_f1(train.labels, found, len(train.classes)))
    best = max(scores, key=scores.__getitem__)
    return ways[best](train, test, seed, known), best


def repetition(method: str, real: Events, twins: Events, seed: int, per_class: int | None) -> dict[str, Any]:
    """Labels that a method gives every event, each in the test of one fold, and what was chosen in the folds.

    per_class: at most so many training events of each class, the same for all methods; all by default.
    """
    fold, known = grouped_folds(real.labels, FOLDS, seed), pretrain(twins, seed=seed)
    found, chosen = np.zeros(len(real), dtype=np.int64), []
    for number in range(FOLDS):
        some = at_most(real.labels, np.flatnonzero(fold != number), per_class, 1000 * seed + number)
        train, test = real.take(some), np.flatnonzero(fold == number)
        found[test], name = told(METHODS[method], train, real.take(test), 1000 * seed + number, known)
        chosen.append(name)
    return {"method": method, "seed": seed, "predicted": found.tolist(), "chosen": chosen}


def report(real: Events, cells: list[dict[str, Any]], sources: Mapping[str, str]) -> str:
    """The report in Markdown: score, interval over events, score of each seed, what was chosen, gains of one over another."""
    count, labels = len(real.classes), {}
    rows = []
    for method in dict.fromkeys(each["method"] for each in cells):
        mine = [each for each in cells if each["method"] == method]
        labels[method] = np.array([each["predicted"] for each in mine])
        score, low, high = with_interval(real.labels, labels[method], count)
        seeds = macro_f1(real.labels[None], labels[method], count)
        often = Counter(name for each in mine for name in each["chosen"]).most_common()
        rows.append([
            method, f"{score:.2f} [{low:.2f}, {high:.2f}]", ", ".join(f"{each:.2f}" for each in seeds),
            "; ".join(f"{name} {times}" for name, times in often),
        ])  # fmt: skip
    names = list(labels)
    gains = [
        f"- {one} over {other}: {found:+.2f} [{low:+.2f}, {high:+.2f}]"
        for place, one in enumerate(names)
        for other in names[:place]
        for found, low, high in [gain(real.labels, labels[one], labels[other], count)]
    ]
    return "\n".join([
        "# Real events alone, tuned within the training", "",
        f"{len(real)} events of {', '.join(real.classes)}; guessing gives about {1 / count:.2f}.",
        *[f"- {name}: {text}" for name, text in sources.items()], "",
        table(["method", "macro-F1, 95 % over events", "of each seed", "chosen in inner folds, times"], rows), "",
        *gains, "",
    ])  # fmt: skip


def add_options(parser: ArgumentParser) -> None:
    add_real_options(parser)
    parser.add_argument(
        "-o", "--output", required=True, help="folder of report.md and the cells; a stopped run goes on"
    )
    parser.add_argument(
        "--per-class", type=int, default=None, help=f"at most so many training events of a class, {INNER} or more"
    )
    parser.add_argument("--repeats", type=int, default=4, help="repetitions, each of a seed of its own (default 4)")


def run(options: Namespace) -> str:
    maps, simulated, recipe = real_and_twins(options)
    real, twins, folder = Events.of(maps.maps), Events.of(simulated), Path(options.output)
    real.same_axes(twins)
    most = "all" if options.per_class is None else f"{options.per_class} at most"
    about = json.dumps({"real": str(maps), "simulated": recipe, "training events of a class": most}, indent=1)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / "study.json").exists() and (folder / "study.json").read_text("utf-8") != about:
        raise InputError(f"{folder} holds another study; give another folder")
    write_whole(folder / "study.json", about)
    wanted = [(seed, name) for seed in range(integer("repeats", options.repeats, 1, 1000)) for name in METHODS]
    cells = []
    with ProgressBar("nested") as progress, torch_threads(1):
        for number, (seed, name) in enumerate(wanted, 1):
            path = folder / f"{name.replace(' ', '-')}_{seed}.json"
            compute = partial(repetition, name, real, twins, seed, options.per_class)
            cells.append(kept_cell(path, compute, lambda told: len(told["predicted"]) == len(real)))
            progress(number / len(wanted))
    write_whole(folder / "report.md", report(real, cells, json.loads(about)))
    return f"wrote {folder / 'report.md'}"
