"""`t2d-rt dataset`: makes the samples of a recipe, prints one, checks, sums up, splits or exports a folder, lists the recipes."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from t2d_rt.cli.dataset_uses import TAKES, add_options, run_use
from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

EXAMPLES = """examples:
  t2d-rt dataset small-hard -o small                         # a recipe that ships; the same command goes on where it stopped
  t2d-rt dataset small-hard -o small --limit 16              # the first 16 samples
  t2d-rt dataset my_recipe.yaml -o out --workers 8           # processes of this machine
  t2d-rt dataset hard -o out --scheduler tcp://head:8786     # on a cluster of dask.distributed
  t2d-rt dataset show hard 417 > sample.yaml                 # one sample as an experiment
  t2d-rt simulate sample.yaml -o sample.zarr                 # the same samples of the ADC, bit for bit
  t2d-rt dataset check small                                 # checksums, records and arrays
  t2d-rt dataset summary small -o small.png                  # text, and pictures: balance, SNR, speeds, contact sheet
  t2d-rt dataset split small --apart description,seed -o split.json    # no description or motion on two sides; or --folds 5
  t2d-rt dataset split small --leave-out -o split.json       # nor a source clip, at the cost of samples
  t2d-rt dataset export small --to parquet --split split.json -o small_parquet
  t2d-rt dataset list                                        # the recipes that ship"""

MAKING = {"output", "limit", "workers", "scheduler", "threads"}
"""Options of a run."""
VERBS = {"show": set[str](), "check": set[str](), "list": set[str](), **TAKES}
"""What is done with a recipe or a folder beside making it, and the options of each."""
SOME_FAILED, UNSOUND = 3, 1
"""Exit codes where samples failed, and where a folder is not as it was written."""
SHOWN_FAILURES = 5


def parser() -> ArgumentParser:
    """Options of `t2d-rt dataset`."""
    found = command_parser(
        "dataset",
        "Makes a data set: the samples of a recipe, written as shards of arrays and records. The exit code is 3 where samples "
        "failed, whose reasons stand in the records; more than 5 % of them stop the run.",
        config=False,
        noun="RECIPE -o DIR | show RECIPE INDEX | check, summary, split or export DIR | list",
        file="The recipe, by name or as a file (.yaml); or one of show, check, summary, split, export and list, and what it needs.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument(
        "-o",
        "--output",
        type=str | None,
        help="Folder of the data set; one of the same recipe is completed. Of summary, split and export what they write.",
    )
    found.add_argument(
        "--limit", type=int | None, help="The first so many samples, which are balanced over the classes."
    )
    found.add_argument("--workers", type=int | None, help="Processes of this machine; by default one for each core.")
    found.add_argument(
        "--scheduler",
        type=str | None,
        help="A cluster of dask.distributed: local:N processes, or an address as tcp://host:8786.",
    )
    found.add_argument(
        "--threads", type=int | None, help="Threads of each worker; by default they share the cores out."
    )
    add_options(found)
    return found


def run(options: Namespace) -> int:
    """Makes, prints, checks or lists."""
    words = options.file or []
    if not words:
        raise InputError(f"dataset needs a recipe, or one of {', '.join(VERBS)}; t2d-rt dataset --help shows examples")
    verb = words[0] if words[0] in VERBS else None
    taken = MAKING if verb is None else VERBS[verb]
    given = [name for name in MAKING.union(*TAKES.values()) if options[name] is not None]
    for name in sorted(set(given) - taken):
        raise InputError(f"dataset {verb or 'of a recipe'} takes no --{name.replace('_', '-')}; leave it out")
    if verb in TAKES:
        return run_use(words[0], words[1:], options)
    if verb == "list":
        return _list(words[1:])
    if verb == "check":
        return _check(words[1:])
    if verb == "show":
        return _show(words[1:])
    if len(words) > 1:
        raise InputError(f"dataset takes one recipe, got {len(words)} words; give its folder with -o")
    return _make(words[0], options)


def _make(name: str, options: Namespace) -> int:
    from t2d_rt.core.progress import ProgressBar
    from t2d_rt.dataset import Recipe, make_dataset

    recipe = Recipe.read(name)
    target = options.output or recipe.name
    with ProgressBar(recipe.name) as progress:
        outcome = make_dataset(
            recipe, target, limit=options.limit, workers=options.workers, scheduler=options.scheduler, threads=options.threads,
            progress=progress,
        )  # fmt: skip
    rate = f", {outcome.made / outcome.seconds:.2f} a second" if outcome.made else ""
    say(f"{target}: {outcome.samples} samples, {outcome.made} of them made in {outcome.seconds:.1f} s{rate}")
    for index, reason in outcome.failures[:SHOWN_FAILURES]:
        say(f"t2d-rt: sample {index} failed: {reason}", file=sys.stderr)
    if len(outcome.failures) > SHOWN_FAILURES:
        more = len(outcome.failures) - SHOWN_FAILURES
        say(f"t2d-rt: {more} more samples failed; their records tell why", file=sys.stderr)
    return SOME_FAILED if outcome.failures else 0


def _show(words: list[str]) -> int:
    from t2d_rt.dataset import Recipe
    from t2d_rt.dataset.worker import shown_sample

    if len(words) != 2 or not words[1].isdecimal():
        raise InputError(f"dataset show takes a recipe and the index of a sample, got {' '.join(words) or 'nothing'}")
    say(shown_sample(Recipe.read(words[0]), int(words[1])))
    return 0


def _check(words: list[str]) -> int:
    from t2d_rt.dataset import check_dataset

    if len(words) != 1:
        raise InputError(f"dataset check takes the folder of a data set, got {' '.join(words) or 'nothing'}")
    faults = check_dataset(words[0])
    for each in faults:
        say(each)
    if not faults:
        say(f"{words[0]}: all shards are as they were written")
    return UNSOUND if faults else 0


def _list(words: list[str]) -> int:
    from t2d_rt.dataset import Recipe, recipe_names

    if words:
        raise InputError(f"dataset list takes nothing more, got {' '.join(words)}")
    for name in recipe_names():
        recipe = Recipe.read(name)
        say(f"{name}: {recipe.samples} samples. {recipe.about}")
    return 0
