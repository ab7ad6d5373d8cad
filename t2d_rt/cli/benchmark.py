"""`t2d-rt benchmark models`: Table III of the paper, with splits that do not leak, seeds and intervals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.checks import choice, positive
from t2d_rt.cli.learning import one_word
from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say
from t2d_rt.errors import InputError
from t2d_rt.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.benchmark import Scale

EXAMPLES = """examples:
  t2d-rt benchmark models --scale tiny -o report             # two classes, one epoch: whether everything runs
  t2d-rt benchmark models --scale laptop -o report           # an hour of training; the same command goes on where it stopped
  t2d-rt benchmark models --scale laptop --minutes 20 -o report   # begins no further training after 20 minutes
  t2d-rt benchmark models --scale paper -o plan              # what it would take; nothing is trained"""


def parser() -> ArgumentParser:
    """Options of `t2d-rt benchmark`."""
    found = command_parser(
        "benchmark",
        "Trains and tests all models on Simple and Hard, split by file, by description and by clip, and writes report.md with "
        "pictures: accuracy with intervals, size and speed, and the paper's claims one by one. Needs the extra [learn].",
        config=False,
        noun="models -o DIR",
        file="What is compared: models.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument(
        "-o", "--output", type=str | None, help="Folder of the report, its data and its cells; a stopped run goes on."
    )
    found.add_argument(
        "--scale",
        type=str,
        default="laptop",
        help="How large it is: tiny, laptop or paper, which is planned and not run.",
    )
    found.add_argument(
        "--simple", type=str | None, help="Folder of a data set to take as Simple, in place of one that is made."
    )
    found.add_argument("--hard", type=str | None, help="The same for Hard.")
    found.add_argument("--minutes", type=float | None, help="After which no further training is begun.")
    found.add_argument("--workers", type=int | None, help="Processes that make the data; by default one for each core.")
    return found


def run(options: Namespace) -> None:
    """Makes the data, runs the cells, writes the report."""
    from t2d_rt.learn.require import require_learning

    if one_word(options, "benchmark", "the word models") != "models":
        raise InputError(f"benchmark compares models, got {options.file[0]}; t2d-rt benchmark --help shows examples")
    if options.output is None:
        raise InputError("benchmark needs -o, the folder to write")
    require_learning()
    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.benchmark import SCALES, cells_of, paper_plan, run_cells, write_report
    from t2d_rt.learn.benchmark.scales import SETS

    scale = SCALES[choice("--scale", options.scale, tuple(SCALES))]
    minutes = None if options.minutes is None else positive("--minutes", options.minutes, 1e5)
    folder = Path(options.output)
    if scale.name == "paper":
        folder.mkdir(parents=True, exist_ok=True)
        say(f"wrote {paper_plan(scale, folder)}")
        return
    given = {name: Dataset(options[name]) for name in SETS if options[name] is not None}
    datasets = {name: given[name] if name in given else _data(name, scale, options) for name in SETS}
    with ProgressBar(f"benchmark {scale.name}") as progress:
        results = run_cells(scale, datasets, folder / "cells", minutes=minutes, progress=progress)
    total = len(cells_of(scale))
    say(f"wrote {write_report(scale, results, total, folder)}: {len(results)} of {total} cells")
    if len(results) < total:
        say("the same command runs the others")


def _data(name: str, scale: Scale, options: Namespace) -> Dataset:
    """A data set that is made."""
    from t2d_rt.dataset import Dataset, make_dataset

    folder = Path(options.output) / "data" / name
    folder.parent.mkdir(parents=True, exist_ok=True)
    with ProgressBar(f"{name} set") as progress:
        make_dataset(scale.recipe(name), folder, workers=options.workers, progress=progress)
    return Dataset(folder)
