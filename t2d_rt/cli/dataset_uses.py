"""`t2d-rt dataset summary`, `split` and `export`: what is done with a data set that is there."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.output import check_picture, say, write_picture
from t2d_rt.core.checks import choice
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

TAKES = {
    "summary": {"output", "overwrite"},
    "split": {"output", "overwrite", "fractions", "apart", "leave_out", "folds", "seed"},
    "export": {"output", "overwrite", "to", "split", "products", "dynamic_range_db"},
}
"""Options of each."""


def add_options(parser: ArgumentParser) -> None:
    """Options of summary, split and export beside --output."""
    parser.add_argument("--overwrite", action="store_true", default=None, help="Whether what is there is replaced.")
    parser.add_argument("--to", type=str | None, help="Of export: parquet, png or npz.")
    parser.add_argument("--split", type=str | None, help="Of export: file of a split, whose sides are kept apart.")
    parser.add_argument(
        "--products", type=str | None, help="Of export: which arrays, as spectrogram,points; all by default."
    )
    parser.add_argument(
        "--dynamic_range_db", type=float | None, help="Of export to png: from white to black [dB]; 60 by default."
    )
    parser.add_argument(
        "--fractions", type=str | None, help="Of split: of train, val and test; 0.7,0.15,0.15 by default."
    )
    parser.add_argument(
        "--apart",
        type=str | None,
        help="Of split: what is on one side only, of description, clip and seed; all of them by default.",
    )
    parser.add_argument(
        "--leave_out",
        action="store_true",
        default=None,
        help="Of split: whether samples are left out that would put one source clip on two sides; without it samples that share a "
        "clip stay together.",
    )
    parser.add_argument("--folds", type=int | None, help="Of split: so many folds, a file each, in place of one split.")
    parser.add_argument("--seed", type=int | None, help="Of split: its seed; 0 by default.")


def run_use(verb: str, words: list[str], options: Namespace) -> int:
    """Does what the verb says with one folder."""
    if len(words) != 1:
        raise InputError(f"dataset {verb} takes the folder of a data set, got {' '.join(words) or 'nothing'}")
    {"summary": _summary, "split": _split, "export": _export}[verb](words[0], options)
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
