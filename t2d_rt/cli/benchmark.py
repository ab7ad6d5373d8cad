"""`t2d-rt benchmark`: Table III of the paper by splits that do not leak, with intervals; and what fidelity is worth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say
from t2d_rt.core.checks import choice, positive
from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.benchmark import Scale

EXAMPLES = """examples:
  t2d-rt benchmark models --scale tiny -o report             # two classes, one epoch: whether everything runs
  t2d-rt benchmark models --scale laptop -o report           # an hour of training; the same command goes on where it stopped
  t2d-rt benchmark models --scale laptop --minutes 20 -o report   # begins no further training after 20 minutes
  t2d-rt benchmark models --scale paper -o plan              # what it would take; nothing is trained
  t2d-rt benchmark fidelity --real parrad_part1.npz -o fidelity   # ellipsoids, mesh, noise, room: what each is worth
  t2d-rt benchmark fidelity --per-class 20 -o fidelity       # more events than before, and no real ones
  t2d-rt benchmark conditions carriers -o conditions         # a folder of dataset carriers: trained at one, tested at another
  t2d-rt benchmark conditions clean noisy masked -o noise    # several data sets, each a condition"""

WORDS = "models", "fidelity", "conditions"
"""What is compared."""
TAKES = {
    "models": {"scale", "simple", "hard", "minutes", "workers"},
    "fidelity": {"real", "per_class", "seed"},
    "conditions": set(),
}
DEFAULTS = {"scale": "laptop", "per_class": 12, "seed": 0}
"""Of options that only some of the words take."""


def parser() -> ArgumentParser:
    """Options of `t2d-rt benchmark`."""
    found = command_parser(
        "benchmark",
        "Trains and tests all models on Simple and Hard, split by file, by description and by clip, and writes report.md with "
        "pictures: accuracy with intervals, size and speed, and the paper's claims one by one. Or trains on the same events by "
        "several fidelities, tests on the highest and on real events, and writes fidelity.md with its chart; or trains under each "
        "condition of a data set or several, tests under each, and writes conditions.md. Needs the extra [learn].",
        config=False,
        noun="models | fidelity | conditions DATA... -o DIR",
        file="What is compared: models, fidelity, or conditions, which takes folders of data sets.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument(
        "-o", "--output", type=str | None, help="Folder of the report, its data and its cells; a stopped run goes on."
    )
    found.add_argument(
        "--scale",
        type=str | None,
        help="Of models: how large it is, tiny, laptop (by default) or paper, which is planned and not run.",
    )
    found.add_argument(
        "--simple",
        type=str | None,
        help="Of models: folder of a data set to take as Simple, in place of one that is made.",
    )
    found.add_argument("--hard", type=str | None, help="The same for Hard.")
    found.add_argument("--minutes", type=float | None, help="Of models: after which no further training is begun.")
    found.add_argument(
        "--workers", type=int | None, help="Of models: processes that make the data; by default one for each core."
    )
    found.add_argument(
        "--real", type=str | None, help="Of fidelity: file of real events (PARrad) to test on, beside simulated ones."
    )
    found.add_argument(
        "--per_class", type=int | None, help="Of fidelity: simulated events of each of five activities; 12 by default."
    )
    found.add_argument("--seed", type=int | None, help="Of fidelity: seed of the events; 0 by default.")
    return found


def run(options: Namespace) -> None:
    """Does what the first word says."""
    from t2d_rt.learn.require import require_learning

    verb, *names = options.file or ["nothing"]
    if verb not in WORDS:
        raise InputError(f"benchmark compares {', '.join(WORDS)}, got {verb}; t2d-rt benchmark --help shows examples")
    if bool(names) != (verb == "conditions"):
        wanted = "no further name" if names else "the folder of a data set, or several"
        raise InputError(f"benchmark {verb} takes {wanted}, got {' '.join(names) or 'none'}")
    if options.output is None:
        raise InputError("benchmark needs -o, the folder to write")
    for name in sorted(set().union(*TAKES.values()) - TAKES[verb]):
        if options[name] is not None:
            raise InputError(f"benchmark {verb} takes no --{name.replace('_', '-')}; leave it out")
    require_learning()
    {"models": _models, "fidelity": _fidelity, "conditions": _conditions}[verb](options)


def chosen(options: Namespace, name: str) -> Any:
    """An option, or its default."""
    return DEFAULTS[name] if options[name] is None else options[name]


def _models(options: Namespace) -> None:
    """Makes the data, runs the cells, writes the report."""
    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.benchmark import SCALES, cells_of, paper_plan, run_cells, write_report
    from t2d_rt.learn.benchmark.scales import SETS

    scale = SCALES[choice("--scale", chosen(options, "scale"), tuple(SCALES))]
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


def _fidelity(options: Namespace) -> None:
    """Simulates the events by all rungs, trains and tests, writes the report."""
    from t2d_rt.learn.adapters import AdapterOptions, read_real
    from t2d_rt.learn.adapters.parrad import FOUR
    from t2d_rt.learn.fidelity import make_rungs, read_rungs, run_study, write_fidelity
    from t2d_rt.learn.twins import TwinRecipe

    real = None if options.real is None else read_real(options.real, "parrad", AdapterOptions(classes=FOUR))
    recipe = TwinRecipe(per_class=chosen(options, "per_class"), seed=chosen(options, "seed"))
    folder = Path(options.output)
    # More events than before, or none that are real: cells of their own, and those of before stay.
    cells = folder / f"cells-{recipe.count}{'' if real is None else '-real'}"
    with ProgressBar("events") as progress:
        events = make_rungs(recipe, folder / "events", progress=progress)
    with ProgressBar("training") as progress:
        found = run_study(
            read_rungs(events, recipe.count), None if real is None else real.maps, cells, progress=progress
        )
    told = "No real events were at hand." if real is None else f"Real: {real}"
    say(f"wrote {write_fidelity(found, folder, told)}")


def _conditions(options: Namespace) -> None:
    """Trains and tests under each condition of data sets."""
    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.benchmark import run_conditions

    with ProgressBar("conditions") as progress:
        path = run_conditions([Dataset(each) for each in options.file[1:]], Path(options.output), progress=progress)
    say(f"wrote {path}")


def _data(name: str, scale: Scale, options: Namespace) -> Dataset:
    """A data set that is made."""
    from t2d_rt.dataset import Dataset, make_dataset

    folder = Path(options.output) / "data" / name
    folder.parent.mkdir(parents=True, exist_ok=True)
    with ProgressBar(f"{name} set") as progress:
        make_dataset(scale.recipe(name), folder, workers=options.workers, progress=progress)
    return Dataset(folder)
