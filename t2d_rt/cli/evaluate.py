"""`t2d-rt evaluate`: how well a trained model does on a data set."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from t2d_rt.cli.learning import PICTURES, mti_of, one_word, told, write_scores
from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import check_picture, say
from t2d_rt.core.errors import InputError, T2DWarning

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.maps import LabelledMaps
    from t2d_rt.learn.train.saved import Card

ROUNDED_MPS = 1e-6
"""Rounding of the speeds of a card [m/s]."""
EXAMPLES = """examples:
  t2d-rt evaluate small --model resnet -o figures            # on the samples that were kept apart when it was trained
  t2d-rt evaluate other --model resnet                       # on all of another data set of the same classes and speeds"""


def parser() -> ArgumentParser:
    """Options of `t2d-rt evaluate`."""
    found = command_parser(
        "evaluate",
        "Tests a model that t2d-rt train wrote: on the side test of the data set that it was trained on, or on all of another one.",
        config=False,
        noun="DATA --model DIR",
        file="Folder of a data set.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument("--model", type=str | None, help="Folder that t2d-rt train wrote.")
    found.add_argument(
        "-o", "--output", type=str | None, help="Folder for confusion and reliability as pictures; none by default."
    )
    told_ = "Whether pictures there are replaced; without it existing ones are an error."
    found.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help=told_)
    return found


def run(options: Namespace) -> None:
    """Prints the scores, and those of each class."""
    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.maps import maps_of
    from t2d_rt.learn.train import load_model, scores_of

    source = one_word(options, "evaluate", "the folder of a data set")
    if options.model is None:
        raise InputError("evaluate needs --model, the folder that t2d-rt train wrote")
    if options.output is not None:
        _check_output(Path(options.output), overwrite=options.overwrite)
    model = load_model(options.model)
    dataset = Dataset(source)
    maps = maps_of(
        dataset, size=model.card.size, dynamic_range_db=model.card.dynamic_range_db, speeds_mps=_speeds_of(dataset, model.card)
    )  # fmt: skip
    _check_like(source, maps, dataset, model.card)
    if model.card.about.get("recipe_hash") == dataset.recipe.hash:
        maps = maps.take(dataset.positions(_kept_apart(model.card, options.model)))
        what = f"the test of the split by {model.card.about.get('split', 'unknown')}"
    else:
        _warn_of_seen(source, maps, model.card)
        what = "all samples, of another recipe than it was trained on"
    scores = scores_of(model.probabilities(maps.levels), maps.labels)
    say(f"{model.card.model} on {what}: {told(scores)}")
    for number, name in enumerate(maps.classes):
        row = scores.confusion[number]
        if row.sum():
            say(f"  {name:18}{100 * row[number] / row.sum():4.0f} % of {row.sum()}")
    if options.output is not None:
        folder = Path(options.output)
        folder.mkdir(parents=True, exist_ok=True)
        write_scores(
            folder, scores, maps.classes, f"{model.card.model} on {dataset.recipe.name}", overwrite=options.overwrite
        )
        say(f"wrote {folder}")


def _check_output(folder: Path, *, overwrite: bool) -> None:
    """Refuses a place that cannot be a folder, and pictures that are there."""
    if folder.is_dir():
        for name in PICTURES:
            check_picture(folder / name, overwrite=overwrite)
    elif folder.exists():
        raise InputError(f"{folder} is no folder; give one for the pictures")


def _kept_apart(card: Card, folder: str) -> list[int]:
    """Indices of the samples that were kept apart for the test."""
    try:
        found = [int(each) for each in card.about["indices"]["test"]]
    except (KeyError, TypeError, ValueError):
        found = []
    if not found:
        raise InputError(
            f"the card of {folder} does not tell which samples of this recipe it was trained on; train it with t2d-rt train, "
            "or evaluate it on a data set of another recipe"
        )
    return found


def _speeds_of(dataset: Dataset, card: Card) -> tuple[float, float]:
    """Lowest and highest speed [m/s]: those of the training where the data set covers them and hardly more, else its own, which may
    be refused."""
    from t2d_rt.dataset.products import edges
    from t2d_rt.learn.maps import LEAST_SHARED, shared_speeds

    own, (lowest, highest) = shared_speeds(dataset), edges(card.axis_mps)
    covered = own[0] <= lowest + ROUNDED_MPS and own[1] >= highest - ROUNDED_MPS
    if covered and highest - lowest >= LEAST_SHARED * (own[1] - own[0]):
        return max(lowest, own[0]), min(highest, own[1])
    return own


def _check_like(source: str, maps: LabelledMaps, dataset: Dataset, card: Card) -> None:
    """Refuses maps of other classes, speeds, duration or treatment of static echoes than those of the training."""
    if maps.classes != card.classes:
        raise InputError(
            f"{source} has the classes {', '.join(maps.classes)}, the model {', '.join(card.classes)}; take a like data set"
        )
    cell = card.axis_mps[1] - card.axis_mps[0]
    if abs(maps.velocity_mps - card.axis_mps).max() > cell:
        raise InputError(
            f"{source} shows {maps.velocity_mps[0]:.3g} to {maps.velocity_mps[-1]:.3g} m/s, the model was trained on "
            f"{card.axis_mps[0]:.3g} to {card.axis_mps[-1]:.3g} m/s; make it with the same speed_mps"
        )
    if abs(maps.duration_s - card.duration_s) > 0.05 * card.duration_s:
        raise InputError(
            f"the maps of {source} cover {maps.duration_s:.3g} s, those of the training {card.duration_s:.3g} s; "
            "make it with the same duration_s"
        )
    mti, known = mti_of(dataset), card.about.get("mti")
    if known is not None and mti != known:
        raise InputError(
            f"{source} was made with mti {mti}, the model was trained with {known}; make it with the same mti"
        )


def _warn_of_seen(source: str, maps: LabelledMaps, card: Card) -> None:
    """Warns where descriptions of a data set are among those of the training."""
    seen = np.isin(maps.groups["description"], card.about.get("descriptions", []))
    if seen.any():
        warnings.warn(
            f"{seen.sum()} of {len(maps)} samples of {source} are of descriptions that the model was trained on; "
            "its scores are better than for new ones",
            T2DWarning,
            stacklevel=2,
        )
