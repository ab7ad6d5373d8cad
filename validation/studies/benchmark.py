"""Table III of Text2Doppler, with splits that do not leak, seeds and intervals: all models on Simple and Hard."""

from __future__ import annotations

import hashlib
import json
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from joblib import Parallel, delayed

from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar
from t2d_rt.dataset import Dataset, Recipe, make_dataset
from t2d_rt.dataset.making import cores
from t2d_rt.dataset.splits import KINDS, SPLITS, TRAINING_FRACTIONS, check_sides, traits
from t2d_rt.learn import TrainOptions, scores_of, sides_of, train_model
from t2d_rt.learn.baselines import BASELINES, baseline_probabilities
from t2d_rt.learn.maps import LabelledMaps, maps_of
from t2d_rt.learn.models import build
from t2d_rt.learn.pytorch import torch_threads
from t2d_rt.learn.saved_models import SavedModel
from validation.studies.common import kept_cell, read_cell, table

NETWORKS = "vgg-7", "resnet18", "vit-tiny", "crnn", "conv1d-lstm", "conv1d-alstm-fcn", "streaming"
SETS = "simple", "hard"
SLOW = "vgg-7", "resnet18", "vit-tiny", "crnn"
"""Networks whose training takes a hundred times as long as that of the others."""
JUDGED = ("simple", "file"), ("hard", "file"), ("hard", "description")
"""Sets and splits that claims of the paper are judged by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Data, models, and how long they are trained."""

    name: str
    recipes: dict[str, Recipe | str]
    """Recipe of each set, or its name."""
    size: int
    epochs: int
    batch: int
    seeds: tuple[int, ...]
    """Each has a split, weights and an order of its own."""
    models: tuple[str, ...] = (*NETWORKS, *BASELINES)
    once: tuple[str, ...] = ()
    """Models that have, to save time, the first seed alone where no claim is judged, and are not split by clip."""
    samples: int | None = None
    """Of each set, the first so many; all by default."""
    splits: tuple[str, ...] = SPLITS
    precision: Literal["float32", "bfloat16"] = "float32"
    schedule: Literal["plateau", "cosine"] = "plateau"

    def recipe(self, name: str) -> Recipe:
        """The recipe of a set."""
        found = self.recipes[name]
        return Recipe.read(found) if isinstance(found, str) else found


def _tiny(descriptions: int, samples: int, name: str) -> Recipe:
    values: dict[str, Any] = {
        "name": name, "classes": ["walking", "bending"], "descriptions_per_class": descriptions,
        "samples_per_description": samples, "radar": "table2", "conditions": [{"name": "ellipsoids", "method": "ellipsoid"}],
        "duration_s": 1.5, "products": {"spectrogram": {"size": [48, 48]}}, "attempts": 1,
    }  # fmt: skip
    return Recipe(**values)


SCALES = {
    "tiny": Scale(
        name="tiny", recipes={"simple": _tiny(4, 1, "tiny-simple"), "hard": _tiny(4, 2, "tiny-hard")}, size=48, epochs=1, batch=4,
        seeds=(0,), models=("resnet18", "conv1d-lstm", "streaming", *BASELINES),
    ),
    "laptop": Scale(
        name="laptop", recipes={"simple": "small-simple", "hard": "small-hard"}, size=48, epochs=60, batch=16, seeds=(0, 1, 2),
        once=SLOW,
    ),
    "thousands": Scale(
        name="thousands", recipes={"simple": "simple", "hard": "hard"}, size=64, epochs=12, batch=32, seeds=(0, 1), samples=6400,
        splits=("file", "description"), precision="bfloat16", schedule="cosine",
    ),
    "paper": Scale(
        name="paper", recipes={"simple": "simple", "hard": "hard"}, size=224, epochs=100, batch=64, seeds=(0, 1, 2, 3, 4),
    ),
}  # fmt: skip


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
    columns = [(each, by) for each in SETS for by in scale.splits]
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
    scale: Scale, datasets: dict[str, Dataset], folder: Path, *, minutes: float | None = None, workers: int = 1,
    progress: Callable[[float], None] | None = None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Runs the cells that have no file yet; what all that have one found.

    datasets: "simple" and "hard", or one of them, whose cells alone are run; those of the other are taken from their files, which
        must be of one data set and of this protocol.
    minutes: after which no further cell is begun.
    workers: processes, each with a cell of its own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    data = {name: (dataset, maps_of(dataset, size=(scale.size, scale.size))) for name, dataset in datasets.items()}
    stamps = {name: _stamp(scale, *both) for name, both in data.items()}
    until = float("inf") if minutes is None else time.time() + 60.0 * minutes
    cells = cells_of(scale)
    tasks = (
        delayed(_run_cell)(cell, scale, data.get(cell.set), folder, stamps.get(cell.set, ""), until) for cell in cells
    )
    results = []
    for number, result in enumerate(Parallel(n_jobs=workers, return_as="generator")(tasks)):
        results.append(result)
        if progress is not None:
            progress((number + 1) / len(cells))
    found = [result for result in results if result is not None]
    for name in SETS:
        of_set = {str(result["stamp"]) for result in found if result["set"] == name}
        if len(of_set) > 1 or not all(stamp.startswith(_protocol(scale)) for stamp in of_set):
            raise InputError(
                f"the cells of {name} in {folder} are of several data sets or of another scale; choose another folder"
            )
    return found


def _run_cell(
    cell: Cell, scale: Scale, data: tuple[Dataset, LabelledMaps] | None, folder: Path, stamp: str, until: float
) -> dict[str, Any] | None:
    """What a cell found; None where it has no file, and no data or no time."""
    path, sound = folder / f"{cell.name}.json", partial(_sound, asdict(cell))
    if not path.exists() and (data is None or time.time() >= until):
        return None
    return (
        read_cell(path, sound) if data is None else kept_cell(path, partial(_outcome, cell, scale, *data), sound, stamp)
    )


def _protocol(scale: Scale) -> str:
    """How the networks of a scale are trained."""
    return f"{scale.size} {scale.epochs} {scale.batch} {scale.precision} {scale.schedule}"


def _stamp(scale: Scale, dataset: Dataset, maps: LabelledMaps) -> str:
    """What a set's cells follow from beside their names, splits included: files of other data or another scale are refused."""
    digest = hashlib.sha256()
    digest.update(maps.levels.tobytes() + maps.labels.tobytes() + maps.velocity_mps.tobytes())
    shared = [sorted(traits(record, KINDS)) for record in dataset.records]
    digest.update(json.dumps([maps.classes, maps.duration_s, maps.names, shared]).encode())
    return f"{_protocol(scale)} {digest.hexdigest()[:16]}"


def _sound(about: dict[str, Any], told: dict[str, Any]) -> bool:
    return about.items() <= told.items() and bool({"refused", "told"} & told.keys()) and "stamp" in told


def _outcome(cell: Cell, scale: Scale, dataset: Dataset, maps: LabelledMaps) -> dict[str, Any]:
    try:
        places = sides_of(dataset.records, cell.by, seed=cell.seed)
        check_sides(places)
    except InputError as error:  # of clips that join all samples, or of too few samples
        return {**asdict(cell), "refused": str(error)}
    train, val, test = (maps.take(places[name]) for name in ("train", "val", "test"))
    started = time.process_time()  # of the processor: others may work on the machine
    if cell.model in BASELINES:
        probabilities = baseline_probabilities(cell.model, train, test, seed=cell.seed)
        more: dict[str, Any] = {}
    else:
        options = TrainOptions(
            epochs=scale.epochs, batch=scale.batch, seed=cell.seed, precision=scale.precision, schedule=scale.schedule
        )
        model = train_model(cell.model, train, val, options)
        epochs = model.card.about["epochs"]
        seconds = round((time.process_time() - started) / epochs, 3)
        probabilities = model.probabilities(test.levels)
        more = {"epochs": epochs, "seconds_per_epoch": seconds, **speed_of(model)}
    scores = scores_of(probabilities, test.labels)
    return {
        **asdict(cell), "accuracy": scores.accuracy, "macro_f1": scores.macro_f1, "calibration_error": scores.calibration_error,
        "confusion": scores.confusion.tolist(), "classes": list(maps.classes), "truth": test.labels.tolist(),
        "told": probabilities.argmax(axis=1).tolist(), "groups": _groups(cell, dataset, places["test"]),
        "samples": {"train": len(train), "val": len(val), "test": len(test)},
        "seconds": round(time.process_time() - started, 3), **more,
    }  # fmt: skip


def _groups(cell: Cell, dataset: Dataset, places: np.ndarray) -> list[int]:
    """What is drawn anew for an interval, for each sample of the test: by file samples, for each description is on all sides."""
    if cell.by == "file":
        return [int(each) for each in places]
    names = [f"{each['class']}/{each['description']}" for each in dataset.records]
    _, numbers = np.unique(names, return_inverse=True)
    return [int(each) for each in numbers[places]]


def speed_of(model: SavedModel) -> dict[str, float]:
    """Median latency of one map [ms], and maps a second where several come together: one thread, time of the processor."""
    with torch_threads(1):
        rng = np.random.default_rng(0)
        maps = rng.uniform(-model.card.dynamic_range_db, 0, (TOGETHER, *model.card.size)).astype(np.float32)
        model.probabilities(maps[:1])
        times = [_seconds(model, maps[:1]) for _ in range(REPEATS)]
        together = min(_seconds(model, maps) for _ in range(3))
    return {"latency_ms": round(1e3 * float(np.median(times)), 4), "maps_per_s": round(TOGETHER / together, 1)}


def _seconds(model: SavedModel, maps: np.ndarray) -> float:
    started = time.process_time()  # others may work on the machine
    model.probabilities(maps)
    return time.process_time() - started


PLANNED_EPOCHS = 40
"""That a training takes until nothing gets better, of 100 at most; an assumption, as is the speed of simulation."""
SAMPLES_PER_S = 1.06
"""By ellipsoids on two cores (docs/datasets.md)."""
TIMED_BATCH, TIMED_STEPS = 4, 2


def paper_plan(scale: Scale, folder: Path) -> Path:
    """Measures a few training steps of each network and writes plan.md; its path."""
    samples = {name: scale.recipe(name).samples for name in SETS}
    trained = {name: TRAINING_FRACTIONS[0] * number for name, number in samples.items()}
    cells = [each for each in cells_of(scale) if each.model not in BASELINES]
    rows, total = [], 0.0
    for model in (each for each in scale.models if each not in BASELINES):
        seconds = seconds_per_sample(model, scale.size)
        own = [each for each in cells if each.model == model]
        hours = sum(seconds * trained[each.set] * PLANNED_EPOCHS for each in own) / 3600.0
        total += hours
        rows.append((model, f"{1e3 * seconds:.1f}", str(len(own)), f"{hours:.0f}"))
    data_h = sum(samples.values()) / SAMPLES_PER_S / 3600.0
    sets = ", ".join(f"{name} ({number} samples)" for name, number in samples.items())
    text = (
        f"# Plan of the scale {scale.name}\n\n{len(cells)} trainings at {scale.size} x {scale.size} cells on {sets}, "
        f"{PLANNED_EPOCHS} epochs each assumed. Simulation: {data_h:.0f} hours on two cores at {SAMPLES_PER_S:g} samples a second. "
        f"Training: {total:.0f} hours on one core of this machine, measured by a few steps of each network; a GPU divides that by "
        "some tens.\n\n" + table(("model", "training [ms per sample]", "trainings", "hours"), rows) + "\n"
    )
    path = folder / "plan.md"
    path.write_text(text, "utf-8")
    return path


def seconds_per_sample(model: str, size: int) -> float:
    """Time that training takes for one sample, by one thread [s]."""
    import torch

    with torch_threads(1):
        network = build(model, 8, (size, size)).train()
        optimizer = torch.optim.Adam(network.parameters())
        maps, labels = torch.rand(TIMED_BATCH, 1, size, size), torch.arange(TIMED_BATCH) % 8
        times = []
        for _ in range(TIMED_STEPS):
            started = time.perf_counter()
            optimizer.zero_grad()
            torch.nn.functional.cross_entropy(network(maps), labels).backward()
            optimizer.step()
            times.append(time.perf_counter() - started)
    return float(np.min(times)) / TIMED_BATCH


def add_options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", required=True, help="folder of the report, its data and its cells; a stopped run goes on"
    )
    parser.add_argument(
        "--scale", choices=SCALES, default="laptop", help="how large it is; paper is planned and not run"
    )
    parser.add_argument("--simple", help="folder of a data set to take as Simple, in place of one that is made")
    parser.add_argument("--hard", help="the same for Hard")
    parser.add_argument(
        "--only", choices=SETS, help="set whose cells are run; those of the other are read where they have files"
    )
    parser.add_argument("--minutes", type=float, help="after which no further training is begun")
    parser.add_argument(
        "--workers", type=int, help="processes for the data and the trainings; by default one for each core"
    )


def run(options: Namespace) -> str:
    from validation.studies.benchmark_report import write_report

    scale, folder = SCALES[options.scale], Path(options.output)
    folder.mkdir(parents=True, exist_ok=True)
    if scale.name == "paper":
        return f"wrote {paper_plan(scale, folder)}"
    datasets = {}
    for name in SETS if options.only is None else (options.only,):
        given = vars(options)[name]
        if given is None:
            (folder / "data").mkdir(exist_ok=True)
            with ProgressBar(f"{name} set") as progress:
                made = folder / "data" / name
                make_dataset(scale.recipe(name), made, limit=scale.samples, workers=options.workers, progress=progress)
        datasets[name] = Dataset(given or folder / "data" / name)
    with ProgressBar(f"benchmark {scale.name}") as progress:
        results = run_cells(
            scale,
            datasets,
            folder / "cells",
            minutes=options.minutes,
            workers=options.workers or cores(),
            progress=progress,
        )
    total = len(cells_of(scale))
    more = "; the same command runs the others" if len(results) < total else ""
    return f"wrote {write_report(scale, results, total, folder)}: {len(results)} of {total} cells{more}"
