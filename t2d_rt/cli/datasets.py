"""`t2d-rt dataset`: makes the samples of a recipe, prints one, checks, sums up, splits or exports a folder, lists the recipes."""

from __future__ import annotations

import sys
from pathlib import Path

from t2d_rt.cli.options import Given
from t2d_rt.cli.output import check_picture, say, write_picture, write_text
from t2d_rt.core.checks import choice
from t2d_rt.core.errors import InputError

TAKES = {
    "show": set[str](),
    "check": set[str](),
    "list": set[str](),
    "summary": {"output", "overwrite"},
    "split": {"output", "overwrite", "fractions", "apart", "leave_out", "folds", "seed"},
    "export": {"output", "overwrite", "to", "split", "products", "dynamic_range_db"},
}
"""What can be done with a recipe or a folder beside making a data set, and the options that each takes."""
MAKING = {"output", "limit", "workers", "scheduler", "threads"}
"""Options that the making of a data set takes."""
SOME_FAILED, UNSOUND = 3, 1
"""Exit codes where samples failed, and where a folder is not as it was written."""
SHOWN_FAILURES = 5


def dataset(
    files: list[str] | None = None, output: str | None = None, limit: int | None = None, workers: int | None = None,
    scheduler: str | None = None, threads: int | None = None, overwrite: bool = False, to: str | None = None,
    split: str | None = None, products: str | None = None, dynamic_range_db: float | None = None,
    fractions: str | None = None, apart: str | None = None, leave_out: bool = False, folds: int | None = None,
    seed: int | None = None,
) -> int:  # fmt: skip
    """Makes a data set: the samples of a recipe, written as shards of arrays and records. The exit code is 3 where samples failed,
    whose reasons stand in the records; more than 5 % of them stop the run.

    files: the recipe, by name or as a file (.yaml); or show RECIPE INDEX, list, or one of check, summary, split and export with a
        folder.
    output: folder of the data set; one of the same recipe is completed. Of summary, split and export what they write.
    limit: number of samples to make, from the first on; they are balanced over the classes.
    workers: processes of this machine; by default one for each core.
    scheduler: a cluster of dask.distributed: local:N processes, or an address as tcp://host:8786.
    threads: threads of each worker; by default they share the cores out.
    to: of export: parquet, png or npz.
    split: of export: file of a split, whose sides are kept apart.
    products: of export: which arrays, as spectrogram,points; all by default.
    dynamic_range_db: of export to png: from white to black [dB]; 60 by default.
    fractions: of split: of train, val and test; 0.7,0.15,0.15 by default.
    apart: of split: what is on one side only, of description, clip, seed and subject; by default the first three.
    leave_out: of split: whether samples are left out that would put one source clip on two sides; without it samples that share a
        clip stay together.
    folds: of split: number of folds, a file each, in place of one split.
    seed: of split: its seed; 0 by default.

    examples:
      t2d-rt dataset small-hard -o small                         # a recipe that ships; the same command goes on where it stopped
      t2d-rt dataset small-hard -o small --limit 16              # the first 16 samples
      t2d-rt dataset my_recipe.yaml -o out --workers 8           # processes of this machine
      t2d-rt dataset hard -o out --scheduler tcp://head:8786     # on a cluster of dask.distributed
      t2d-rt dataset show hard 417 > sample.yaml                 # one sample as an experiment
      t2d-rt simulate sample.yaml -o sample.zarr                 # the same samples of the ADC, but for last bits
      t2d-rt dataset check small                                 # checksums, records and arrays
      t2d-rt dataset summary small -o small.png                  # text, and pictures: balance, SNR, speeds, contact sheet
      t2d-rt dataset split small --apart description,seed -o split.json    # no description or motion on two sides; or --folds 5
      t2d-rt dataset split small --leave-out -o split.json       # nor a source clip, at the cost of samples
      t2d-rt dataset export small --to parquet --split split.json -o small_parquet
      t2d-rt dataset list                                        # the recipes that ship
    """
    making = {"limit": limit, "workers": workers, "scheduler": scheduler, "threads": threads}
    options: Given = making | {
        "output": output, "overwrite": overwrite, "to": to, "split": split, "products": products, "fractions": fractions,
        "dynamic_range_db": dynamic_range_db, "apart": apart, "leave_out": leave_out, "folds": folds, "seed": seed,
    }  # fmt: skip
    if not files:
        raise InputError(f"dataset needs a recipe, or one of {', '.join(TAKES)}; t2d-rt dataset --help shows examples")
    verb, words = (files[0], files[1:]) if files[0] in TAKES else ("", files)
    for name in sorted(name for name, value in options.items() if value not in (None, False)):
        if name not in (TAKES[verb] if verb else MAKING):
            raise InputError(f"dataset {verb or 'of a recipe'} takes no --{name.replace('_', '-')}; leave it out")
    if verb == "show":
        if len(words) != 2 or not words[1].isdecimal():
            raise InputError(
                f"dataset show takes a recipe and the index of a sample, got {' '.join(words) or 'nothing'}"
            )
        return _show(words[0], int(words[1]))
    if verb == "list":
        if words:
            raise InputError(f"dataset list takes nothing more, got {' '.join(words)}")
        return _list()
    if len(words) != 1 and not verb:
        raise InputError(f"dataset takes one recipe, got {len(words)} words; give its folder with -o")
    if len(words) != 1:
        raise InputError(f"dataset {verb} takes the folder of a data set, got {' '.join(words) or 'nothing'}")
    if not verb:
        return _make(words[0], output, making)
    if verb == "check":
        return _check(words[0])
    {"summary": _summary, "split": _split, "export": _export}[verb](words[0], options)
    return 0


def _make(name: str, output: str | None, options: Given) -> int:
    from t2d_rt.core.progress import ProgressBar
    from t2d_rt.dataset import Recipe, make_dataset

    recipe = Recipe.read(name)
    target = output or recipe.name
    with ProgressBar(recipe.name) as progress:
        outcome = make_dataset(recipe, target, progress=progress, **options)
    rate = f", {outcome.made / outcome.seconds:.2f} a second" if outcome.made else ""
    say(f"{target}: {outcome.samples} samples, {outcome.made} of them made in {outcome.seconds:.1f} s{rate}")
    for index, reason in outcome.failures[:SHOWN_FAILURES]:
        say(f"t2d-rt: sample {index} failed: {reason}", file=sys.stderr)
    if len(outcome.failures) > SHOWN_FAILURES:
        unshown = len(outcome.failures) - SHOWN_FAILURES
        say(f"t2d-rt: {unshown} more samples failed; their records tell why", file=sys.stderr)
    return SOME_FAILED if outcome.failures else 0


def _show(name: str, index: int) -> int:
    from t2d_rt.dataset import Recipe
    from t2d_rt.dataset.making import scheduler_named
    from t2d_rt.dataset.worker import shown_sample

    say(shown_sample(Recipe.read(name), index, scheduler_named(None, 1)[0]))
    return 0


def _check(folder: str) -> int:
    from t2d_rt.dataset import check_dataset
    from t2d_rt.dataset.shards import content_hash, dataset_folder, frozen_differences, mixed_kernels, recipe_of

    faults = check_dataset(folder)
    for fault in faults:
        say(fault)
    if faults:
        return UNSOUND
    place = dataset_folder(folder)
    recipe = recipe_of(place)
    content, samples = content_hash(place, recipe, recipe.samples)
    say(f"{folder}: {samples} samples of {recipe.name}, content {content}")
    for line in (f"{folder}: all shards are as they were written", *frozen_differences(place, recipe)):
        say(line)
    if (mixed := mixed_kernels(place)) is not None:
        say(f"{folder}: {mixed}")
    return 0


def _list() -> int:
    from t2d_rt.dataset import Recipe, recipe_names

    for name in recipe_names():
        recipe = Recipe.read(name)
        say(f"{name}: {recipe.samples} samples. {recipe.about}")
    return 0


def _summary(folder: str, options: Given) -> None:
    from t2d_rt.dataset import Dataset, dataset_sheet, plot_summary, summarise

    overwrite, picture = options["overwrite"], Path(options["output"] or "")
    sheet = picture.with_name(f"{picture.stem}_classes{picture.suffix}") if options["output"] else picture
    for path in (picture, sheet) if options["output"] else ():
        check_picture(path, overwrite=overwrite)
    dataset = Dataset(folder)
    summary = summarise(dataset)
    say(summary)
    if not options["output"]:
        return
    write_picture(plot_summary(summary), picture, overwrite=overwrite)
    if "spectrogram" in dataset.products:
        write_picture(dataset_sheet(dataset), sheet, overwrite=overwrite)
    say(f"wrote {picture}" + (f" and {sheet}" if "spectrogram" in dataset.products else ""))


def _split(folder: str, options: Given) -> None:
    from t2d_rt.core.atomic_write import check_place
    from t2d_rt.dataset import Dataset, folds, split
    from t2d_rt.dataset.splits import APART, FRACTIONS

    if options["folds"] is not None and options["fractions"] is not None:
        raise InputError("dataset split takes --folds or --fractions; leave one of them out")
    target, records = Path(options["output"] or "split.json"), Dataset(folder).records
    apart = APART if options["apart"] is None else tuple(_listed(options["apart"]) or ())
    settings: Given = {"apart": apart, "leave_out": options["leave_out"], "seed": options["seed"] or 0}
    if options["folds"] is None:
        splits = {target: split(records, _fractions(options["fractions"]) or FRACTIONS, **settings)}
    else:
        of_folds = folds(records, options["folds"], **settings)
        splits = {target.with_stem(f"{target.stem}_{number}"): fold for number, fold in enumerate(of_folds, 1)}
    for path in splits:
        check_place(path, overwrite=options["overwrite"])
    for path, content in splits.items():
        write_text(content.to_json(), path, overwrite=options["overwrite"])
        say(f"{path}: {content}")


def _export(folder: str, options: Given) -> None:
    from t2d_rt.dataset import Dataset, export_dataset, read_split
    from t2d_rt.dataset.export import FORMATS

    to, output = options["to"], options["output"]
    if to is None or output is None:
        raise InputError("dataset export needs --to parquet, png or npz and -o, the folder to write")
    choice("--to", to, FORMATS)
    dataset = Dataset(folder)
    chosen = None if options["split"] is None else read_split(options["split"], dataset.records)
    span_db = options["dynamic_range_db"]
    if span_db is not None and to != "png":
        raise InputError(f"--dynamic-range-db is of pictures, and --to is {to}; leave it out")
    scale = {} if span_db is None else {"dynamic_range_db": span_db}
    products, overwrite = _listed(options["products"]), options["overwrite"]
    target = export_dataset(dataset, output, to, products=products, split=chosen, overwrite=overwrite, **scale)
    count = len(dataset) if chosen is None else sum(len(side) for side in chosen.sides.values())
    say(f"wrote {count} samples to {target}")


def _listed(text: str | None) -> list[str] | None:
    return None if text is None else [item.strip() for item in text.split(",") if item.strip()]


def _fractions(text: str | None) -> list[float] | None:
    try:
        return None if text is None else [float(fraction) for fraction in text.split(",")]
    except ValueError:
        raise InputError(f"--fractions are two or three numbers, as 0.7,0.15,0.15, got {text}") from None
