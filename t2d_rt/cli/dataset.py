"""`t2d-rt dataset`: makes the samples of a recipe, prints one, checks, sums up, splits or exports a folder, lists the recipes."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import check_picture, say, write_picture
from t2d_rt.core.checks import choice
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

TAKES: dict[str | None, set[str]] = {
    None: {"output", "limit", "workers", "scheduler", "threads"},
    "show": set(),
    "check": set(),
    "list": set(),
    "summary": {"output", "overwrite"},
    "split": {"output", "overwrite", "fractions", "apart", "leave_out", "folds", "seed"},
    "export": {"output", "overwrite", "to", "split", "products", "dynamic_range_db"},
}
"""Options of making a data set (None), and of each verb."""
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
    told = "Folder of the data set; one of the same recipe is completed. Of summary, split and export what they write."
    found.add_argument("-o", "--output", type=str | None, help=told)
    for name, kind, told in (
        ("limit", int, "The first so many samples, which are balanced over the classes."),
        ("workers", int, "Processes of this machine; by default one for each core."),
        ("scheduler", str, "A cluster of dask.distributed: local:N processes, or an address as tcp://host:8786."),
        ("threads", int, "Threads of each worker; by default they share the cores out."),
        ("to", str, "Of export: parquet, png or npz."),
        ("split", str, "Of export: file of a split, whose sides are kept apart."),
        ("products", str, "Of export: which arrays, as spectrogram,points; all by default."),
        ("dynamic_range_db", float, "Of export to png: from white to black [dB]; 60 by default."),
        ("fractions", str, "Of split: of train, val and test; 0.7,0.15,0.15 by default."),
        ("apart", str, "Of split: what is on one side only, of description, clip and seed; all of them by default."),
        ("folds", int, "Of split: so many folds, a file each, in place of one split."),
        ("seed", int, "Of split: its seed; 0 by default."),
    ):
        found.add_argument(f"--{name}", type=kind | None, help=told)
    for name, told in (
        ("overwrite", "Whether what is there is replaced."),
        (
            "leave_out",
            "Of split: whether samples are left out that would put one source clip on two sides; without it samples that share a "
            "clip stay together.",
        ),
    ):
        found.add_argument(f"--{name}", action="store_true", default=None, help=told)
    return found


def run(options: Namespace) -> int:
    """Makes a data set, or does what the first word says."""
    words = options.file or []
    if not words:
        verbs = ", ".join(each for each in TAKES if each is not None)
        raise InputError(f"dataset needs a recipe, or one of {verbs}; t2d-rt dataset --help shows examples")
    verb = words[0] if words[0] in TAKES else None
    given = [name for name in set().union(*TAKES.values()) if options[name] is not None]
    for name in sorted(set(given) - TAKES[verb]):
        raise InputError(f"dataset {verb or 'of a recipe'} takes no --{name.replace('_', '-')}; leave it out")
    if verb is None:
        if len(words) > 1:
            raise InputError(f"dataset takes one recipe, got {len(words)} words; give its folder with -o")
        return _make(words[0], options)
    if verb == "list":
        return _list(words[1:])
    if verb == "show":
        return _show(words[1:])
    if len(words) != 2:
        raise InputError(f"dataset {verb} takes the folder of a data set, got {' '.join(words[1:]) or 'nothing'}")
    if verb == "check":
        return _check(words[1])
    {"summary": _summary, "split": _split, "export": _export}[verb](words[1], options)
    return 0


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


def _check(folder: str) -> int:
    from t2d_rt.dataset import check_dataset

    faults = check_dataset(folder)
    for each in faults:
        say(each)
    if not faults:
        say(f"{folder}: all shards are as they were written")
    return UNSOUND if faults else 0


def _list(words: list[str]) -> int:
    from t2d_rt.dataset import Recipe, recipe_names

    if words:
        raise InputError(f"dataset list takes nothing more, got {' '.join(words)}")
    for name in recipe_names():
        recipe = Recipe.read(name)
        say(f"{name}: {recipe.samples} samples. {recipe.about}")
    return 0


def _summary(folder: str, options: Namespace) -> None:
    from t2d_rt.dataset import Dataset, dataset_sheet, plot_summary, summarise

    picture = None if options.output is None else Path(options.output)
    sheet = None if picture is None else picture.with_name(f"{picture.stem}_classes{picture.suffix}")
    for each in (picture, sheet):
        if each is not None:
            check_picture(each, overwrite=bool(options.overwrite))
    dataset = Dataset(folder)
    summary = summarise(dataset)
    say(summary)
    if picture is None or sheet is None:
        return
    write_picture(plot_summary(summary), picture, overwrite=bool(options.overwrite))
    if "spectrogram" not in dataset.products:
        say(f"wrote {picture}")
        return
    write_picture(dataset_sheet(dataset), sheet, overwrite=bool(options.overwrite))
    say(f"wrote {picture} and {sheet}")


def _split(folder: str, options: Namespace) -> None:
    from t2d_rt.core.atomic_write import check_place, check_taken, replacing
    from t2d_rt.dataset import Dataset, folds, split
    from t2d_rt.dataset.splits import FRACTIONS, KINDS

    if options.folds is not None and options.fractions is not None:
        raise InputError("dataset split takes --folds or --fractions; leave one of them out")
    target = Path(options.output or "split.json")
    overwrite = bool(options.overwrite)
    records = Dataset(folder).records
    apart = KINDS if options.apart is None else tuple(_listed(options.apart) or ())
    leave_out, seed = bool(options.leave_out), options.seed or 0
    if options.folds is None:
        fractions = _fractions(options.fractions) or FRACTIONS
        found = {target: split(records, fractions, apart=apart, leave_out=leave_out, seed=seed)}
    else:
        made = folds(records, options.folds, apart=apart, leave_out=leave_out, seed=seed)
        found = {target.with_stem(f"{target.stem}_{number}"): each for number, each in enumerate(made, 1)}
    for path in found:
        check_place(path, overwrite=overwrite)
    for path, each in found.items():
        with replacing(path, partial(check_taken, path, overwrite=overwrite)) as new:
            new.write_text(each.to_json(), encoding="utf-8")
        say(f"{path}: {each}")


def _export(folder: str, options: Namespace) -> None:
    from t2d_rt.dataset import Dataset, export_dataset, read_split
    from t2d_rt.dataset.export import FORMATS

    if options.to is None or options.output is None:
        raise InputError("dataset export needs --to parquet, png or npz and -o, the folder to write")
    choice("--to", options.to, FORMATS)
    dataset = Dataset(folder)
    chosen = None if options.split is None else read_split(options.split, dataset.records)
    if options.dynamic_range_db is not None and options.to != "png":
        raise InputError(f"--dynamic-range-db is of pictures, and --to is {options.to}; leave it out")
    given = {} if options.dynamic_range_db is None else {"dynamic_range_db": options.dynamic_range_db}
    target = export_dataset(
        dataset, options.output, options.to, products=_listed(options.products), split=chosen,
        overwrite=bool(options.overwrite), **given,
    )  # fmt: skip
    count = len(dataset) if chosen is None else sum(len(each) for each in chosen.sides.values())
    say(f"wrote {count} samples to {target}")


def _listed(text: str | None) -> list[str] | None:
    return None if text is None else [each.strip() for each in text.split(",") if each.strip()]


def _fractions(text: str | None) -> list[float] | None:
    try:
        return None if text is None else [float(each) for each in text.split(",")]
    except ValueError:
        raise InputError(f"--fractions are two or three numbers, as 0.7,0.15,0.15, got {text}") from None
