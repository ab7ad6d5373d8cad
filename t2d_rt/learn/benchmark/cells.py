"""Cells of the benchmark: a model trained on a side of a set and tested on another. One JSON file for each that is done."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset
from t2d_rt.dataset.splits import KINDS, traits
from t2d_rt.learn.baselines import BASELINES, baseline_probabilities
from t2d_rt.learn.benchmark.scales import JUDGED, SETS, Scale
from t2d_rt.learn.maps import LabelledMaps, maps_of
from t2d_rt.learn.threads import torch_threads
from t2d_rt.learn.train import SPLITS, TrainOptions, scores_of, sides_of, train_model
from t2d_rt.learn.train.saved import SavedModel
from t2d_rt.learn.train.sides import check_sides

REPEATS = 15
"""Runs of one map, of which the median is the latency."""
TOGETHER = 32
"""Maps at once, for the throughput."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """What one file is about."""

    set: str
    by: str
    model: str
    seed: int

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.set}_{self.by}_{self.model}_{self.seed}"


def cells_of(scale: Scale) -> list[Cell]:
    """All cells: where claims are judged first, and there seed by seed, so that a run that is stopped has whole seeds."""
    columns = [(each, by) for each in SETS for by in SPLITS]
    return [
        Cell(set=each, by=by, model=model, seed=seed)
        for judged in (True, False)
        for seed in scale.seeds
        for each, by in columns
        if ((each, by) in JUDGED) == judged
        for model in scale.models
        if judged or model not in scale.once or (seed == scale.seeds[0] and by != "clip")
    ]


def run_cells(
    scale: Scale, datasets: dict[str, Dataset], folder: Path, *, minutes: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Runs the cells that have no file yet; what all that have one found.

    datasets: "simple" and "hard", or one of them, whose cells alone are run.
    minutes: after which no further cell is begun.
    """
    folder.mkdir(parents=True, exist_ok=True)
    maps = {name: maps_of(each, size=(scale.size, scale.size)) for name, each in datasets.items()}
    stamps = {name: _stamp(scale, each, maps[name]) for name, each in datasets.items()}
    until = float("inf") if minutes is None else time.monotonic() + 60.0 * minutes
    found, cells = [], [each for each in cells_of(scale) if each.set in datasets]
    for number, cell in enumerate(cells):
        path, stamp = folder / f"{cell.name}.json", stamps[cell.set]
        if path.exists():
            told = _read(path, cell, stamp)
        elif time.monotonic() < until:
            told = {**asdict(cell), "stamp": stamp, **_outcome(cell, scale, datasets[cell.set], maps[cell.set])}
            with replacing(path, lambda: None) as new:
                new.write_text(json.dumps(told) + "\n", "utf-8")
        else:
            continue
        found.append(told)
        if progress is not None:
            progress((number + 1) / len(cells))
    return found


def _stamp(scale: Scale, dataset: Dataset, maps: LabelledMaps) -> str:
    """What a set's cells follow from beside their names, splits included: files of other data or another scale are refused."""
    digest = hashlib.sha256(f"{scale.size} {scale.epochs} {scale.batch}".encode())
    digest.update(maps.levels.tobytes() + maps.labels.tobytes() + maps.velocity_mps.tobytes())
    shared = [sorted(traits(record, KINDS)) for record in dataset.records]
    digest.update(json.dumps([maps.classes, maps.duration_s, maps.names, shared]).encode())
    return digest.hexdigest()[:16]


def _read(path: Path, cell: Cell, stamp: str) -> dict[str, Any]:
    try:
        told = json.loads(path.read_text("utf-8"))
        found = told["stamp"]
        if {name: told[name] for name in asdict(cell)} != asdict(cell) or not ({"refused", "confusion"} & told.keys()):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{path} is not what a benchmark wrote there; remove it, and it is computed again") from None
    if found != stamp:
        raise InputError(f"{path} is of other data or of another scale; choose another folder")
    return dict(told)


def _outcome(cell: Cell, scale: Scale, dataset: Dataset, maps: LabelledMaps) -> dict[str, Any]:
    try:
        places = sides_of(dataset.records, cell.by, seed=cell.seed)
        check_sides(places)
    except InputError as error:  # of clips that join all samples, or of too few samples
        return {"refused": str(error)}
    train, val, test = (maps.take(places[name]) for name in ("train", "val", "test"))
    started = time.process_time()  # of the processor: others may work on the machine
    if cell.model in BASELINES:
        probabilities = baseline_probabilities(cell.model, train, test, seed=cell.seed)
        more: dict[str, Any] = {}
    else:
        options = TrainOptions(epochs=scale.epochs, batch=scale.batch, seed=cell.seed)
        model = train_model(cell.model, train, val, options)
        epochs = model.card.about["epochs"]
        seconds = round((time.process_time() - started) / epochs, 3)
        probabilities = model.probabilities(test.levels)
        more = {"epochs": epochs, "seconds_per_epoch": seconds, **speed_of(model)}
    scores = scores_of(probabilities, test.labels)
    return {
        "accuracy": scores.accuracy, "macro_f1": scores.macro_f1, "calibration_error": scores.calibration_error,
        "confusion": scores.confusion.tolist(), "classes": list(maps.classes),
        "samples": {"train": len(train), "val": len(val), "test": len(test)},
        "seconds": round(time.process_time() - started, 3), **more,
    }  # fmt: skip


def speed_of(model: SavedModel) -> dict[str, float]:
    """Latency of one map [ms], the median, and maps a second where several come together, by one thread."""
    with torch_threads(1):
        rng = np.random.default_rng(0)
        maps = rng.uniform(-model.card.dynamic_range_db, 0, (TOGETHER, *model.card.size)).astype(np.float32)
        model.probabilities(maps[:1])
        times = [_seconds(model, maps[:1]) for _ in range(REPEATS)]
        together = min(_seconds(model, maps) for _ in range(3))
    return {"latency_ms": round(1e3 * float(np.median(times)), 4), "maps_per_s": round(TOGETHER / together, 1)}


def _seconds(model: SavedModel, maps: np.ndarray) -> float:
    started = time.perf_counter()
    model.probabilities(maps)
    return time.perf_counter() - started
