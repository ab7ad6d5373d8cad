"""Cells of the study: a rung and a seed; trained on simulated events, tested on those of the highest rung and on real ones."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.errors import InputError
from t2d_rt.learn.fidelity.rungs import HIGHEST, RUNGS, RungEvents
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.threads import torch_threads
from t2d_rt.learn.transfer.classical import extra_trees
from t2d_rt.learn.transfer.events import Events
from t2d_rt.learn.transfer.scores import grouped_folds

SEEDS = 0, 1, 2
"""Of weights and order; each has a third of the simulated events to be tested on, so that all of them are tested once."""
NETWORK, TREES = "network", "extra trees"
LEARNERS = NETWORK, TREES
STEPS = 400
"""Of the network's training, whatever the number of events."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What one file is about."""

    rung: str
    learner: str
    seed: int

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.rung}_{self.learner}_{self.seed}".replace(" ", "-")


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Labels told by all seeds of one rung and learner."""

    simulated: np.ndarray
    """Of each simulated event by the highest rung, (1, E): each is told by the seed that was not trained on it."""
    real: np.ndarray | None
    """Of each real event, (seeds, R); None without real events."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What the cells told."""

    classes: tuple[str, ...]
    simulated: np.ndarray
    """Classes of the simulated events, (E,)."""
    real: np.ndarray | None
    """Classes of the real events, (R,)."""
    outcomes: dict[tuple[str, str], Outcome]
    """By rung and learner."""
    seconds: dict[str, float]
    """Of simulation [CPU s] of an event by one radar, the median."""


def cells() -> list[Cell]:
    """All cells."""
    return [Cell(rung.name, learner, seed) for learner in LEARNERS for rung in RUNGS for seed in SEEDS]


def run_study(
    found: RungEvents, real: LabelledMaps | None, folder: Path, *, progress: Callable[[float], None] | None = None
) -> Findings:
    """Runs the cells that have no file yet.

    found: simulated events of all rungs.
    real: maps of real events of the same classes, to test on; None where there are none at hand.
    folder: of the cells.
    """
    folder.mkdir(parents=True, exist_ok=True)
    events = {name: Events.of(maps) for name, maps in found.maps.items()}
    tested = None if real is None else Events.of(real)
    if tested is not None:
        tested.same_axes(events[HIGHEST])
    _check_counts(events[HIGHEST])
    stamp = _stamp(events, tested)
    every, told = cells(), {}
    for number, cell in enumerate(every, 1):
        path = folder / f"{cell.name}.json"
        if not path.exists():
            with torch_threads(1):
                said = _said(cell, events, tested)
            with replacing(path, lambda: None) as new:
                new.write_text(json.dumps({"stamp": stamp, "cell": cell.name, **said}) + "\n", "utf-8")
        told[cell] = _read(path, cell, stamp, tested is not None)
        if progress is not None:
            progress(number / len(every))
    truth = events[HIGHEST].labels
    return Findings(
        classes=events[HIGHEST].classes, simulated=truth, real=None if tested is None else tested.labels,
        outcomes={
            (rung.name, learner): _outcome([told[Cell(rung.name, learner, seed)] for seed in SEEDS], len(truth), tested)
            for rung in RUNGS
            for learner in LEARNERS
        },
        seconds={name: float(np.median(each)) / len(events[name].radars) for name, each in found.seconds.items()},
    )  # fmt: skip


def _check_counts(events: Events) -> None:
    least = int(np.bincount(events.labels).min())
    if least < len(SEEDS):
        raise InputError(
            f"the study needs {len(SEEDS)} simulated events of each class or more, one has {least}; raise --per-class"
        )


def _said(cell: Cell, events: dict[str, Events], real: Events | None) -> dict[str, Any]:
    """Labels that are told after training on a rung's events of two folds."""
    highest = events[HIGHEST]
    fold = grouped_folds(highest.labels, len(SEEDS), 0)
    test = np.flatnonzero(fold == cell.seed % len(SEEDS))
    train = events[cell.rung].take(np.flatnonzero(fold != cell.seed % len(SEEDS)))
    asked = [highest.take(test), *([] if real is None else [real])]
    labels = _labels(cell, train, asked)
    return {
        "test": test.tolist(), "simulated": labels[0].tolist(), "real": labels[1].tolist() if len(labels) > 1 else None,
    }  # fmt: skip


def _labels(cell: Cell, train: Events, asked: list[Events]) -> list[np.ndarray]:
    if cell.learner == TREES:
        return [extra_trees(train, each, cell.seed) for each in asked]
    import torch

    from t2d_rt.learn.transfer.methods import BATCH, PRETRAINING, fitted, network, predicted

    epochs = -(-STEPS // -(-len(train) // BATCH))
    schedule = replace(PRETRAINING, epochs=epochs)
    net = network(len(train.classes), cell.seed)
    fitted(net, torch.from_numpy(train.inputs), torch.from_numpy(train.labels), schedule, cell.seed, augment=True)
    return [predicted(net, torch.from_numpy(each.inputs)) for each in asked]


def _stamp(events: dict[str, Events], real: Events | None) -> str:
    """What every cell follows from beside its name: files of other data are refused."""
    digest = hashlib.sha256()
    for each in (*events.values(), *([] if real is None else [real])):
        digest.update(each.levels.tobytes() + each.labels.tobytes() + json.dumps(each.classes).encode())
    return digest.hexdigest()[:16]


def _read(path: Path, cell: Cell, stamp: str, with_real: bool) -> dict[str, Any]:
    try:
        told = json.loads(path.read_text("utf-8"))
        if told["cell"] != cell.name or len(told["test"]) != len(told["simulated"]):
            raise ValueError
        found, complete = told["stamp"], (told["real"] is not None) == with_real
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(f"{path} is not what a study wrote there; remove it, and it is computed again") from None
    if found != stamp or not complete:
        raise InputError(f"{path} is of other events; choose another folder")
    return dict(told)


def _outcome(told: list[dict[str, Any]], count: int, real: Events | None) -> Outcome:
    simulated = np.full((1, count), -1)
    for each in told:
        simulated[0, each["test"]] = each["simulated"]
    return Outcome(simulated=simulated, real=None if real is None else np.array([each["real"] for each in told]))
