"""`t2d-rt train`, `evaluate`, `predict`: a classifier from a data set, how well it does, what a person does in a recording."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.cli.options import add_capture_options, add_overwrite, capture_options, command_parser
from t2d_rt.cli.output import check_picture, say, write_picture
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.dataset import Dataset
    from t2d_rt.learn import Augment, LabelledMaps, Scores
    from t2d_rt.learn.saved_models import Card

TRAIN_EXAMPLES = """examples:
  t2d-rt train small --model resnet18 -o resnet              # by description; the same command goes on where it stopped
  t2d-rt train small --model streaming --augment -o mine     # background, masks, shifts, Doppler and gain on the fly
  t2d-rt train small --model streaming --sliding -o mine     # for predict, whose windows slide over changes of activities
  t2d-rt train hard --model envelope --sliding --schedule cosine --rate 2e-3 --smoothing 0.1 --decay 0.05 -o mine
  t2d-rt train small --model vgg-7 --size 128 --by file -o leaky   # as the paper splits: descriptions stand on two sides"""
EVALUATE_EXAMPLES = """examples:
  t2d-rt evaluate small --model resnet -o figures            # on the samples that were kept apart when it was trained
  t2d-rt evaluate other --model resnet                       # on all of another data set of the same classes and speeds"""
PREDICT_EXAMPLES = """examples:
  t2d-rt predict walk.zarr --model resnet                    # a class and its probability for each window; draws walk_classes.png
  t2d-rt predict walk.zarr --model one,two,three              # probabilities are means over several networks
  t2d-rt predict capture.npy --radar my_radar.yaml --model resnet --step-s 0.5 -o capture.png"""

PICTURES = "confusion.png", "reliability.png"
ROUNDED_MPS = 1e-6
"""Rounding of the speeds of a card [m/s]."""


def train_parser() -> ArgumentParser:
    """Options of `t2d-rt train`; those of the training are fields of `TrainOptions`."""
    from t2d_rt.cli.options import field_help
    from t2d_rt.learn import TrainOptions

    found = command_parser(
        "train",
        "Trains a classifier on the spectrograms of a data set; writes its weights, a card, curves, confusion and reliability. "
        "Needs the extra [learn].",
        config=False, noun="DATA --model NAME -o DIR", file="Folder of a data set.", examples=TRAIN_EXAMPLES, several=True,
    )  # fmt: skip
    found.add_argument(
        "-o", "--output", type=str | None, help="Folder to write; a training that was stopped there goes on."
    )
    found.add_argument(
        "--model",
        type=str,
        default="resnet18",
        help="One of vgg-7, resnet18, vit-tiny, crnn, conv1d-lstm, conv1d-alstm-fcn, streaming, which is small and causal, or "
        "envelope, which learns most of few samples.",
    )
    told = "What is on one side only: description (and the motions of it), clip (too), or file, which lets descriptions leak."
    found.add_argument("--by", type=str, default="description", help=told)
    told = "File of a split with sides train, val and test, in place of --by."
    found.add_argument("--split", type=str | None, help=told)
    told = "Cells of speed and of time, 128 for envelope and 64 for the others by default; 224 is usual, too."
    found.add_argument("--size", type=int | None, help=told)
    found.add_argument("--dynamic_range_db", type=float, default=60.0, help="Levels below that are clipped [dB].")
    for name, told in (
        ("augment", "Whether samples are changed on the fly."),
        (
            "sliding",
            "In place of --augment: changes that suit predict, whose windows slide over changes of activities.",
        ),
    ):
        found.add_argument(f"--{name}", type=bool, default=False, nargs="?", const=True, help=told)
    help_texts = field_help(TrainOptions) | {
        "seed": "Seed of the split, the weights, the order and the changes of samples."
    }
    for name, field in TrainOptions.model_fields.items():
        if name != "augment":
            found.add_argument(f"--{name}", type=type(field.default), default=field.default, help=help_texts[name])
    return found


def train_command(options: Namespace) -> None:
    """Trains, then tests on the side that was kept apart."""
    from t2d_rt.learn.pytorch import require_learning

    require_learning()
    from t2d_rt.dataset import Dataset
    from t2d_rt.dataset.splits import check_sides
    from t2d_rt.learn import TrainOptions, maps_of, scores_of, train_model
    from t2d_rt.learn.figures import curves_figure
    from t2d_rt.learn.models import card

    source = _one_word(options, "train", "the folder of a data set")
    if options.output is None:
        raise InputError("train needs -o, the folder to write")
    about_model = card(options.model)
    title = about_model.title
    size = about_model.usual_size if options.size is None else options.size
    given = {name: options[name] for name in TrainOptions.model_fields if name != "augment"}
    chosen = TrainOptions(augment=_augment(options), **given)
    dataset = Dataset(source)
    maps = maps_of(dataset, size=(size, size), dynamic_range_db=options.dynamic_range_db)
    parts = _sides(dataset, options)
    check_sides(parts)
    by = options.by if options.split is None else Path(options.split).name
    folder = Path(options.output)
    with ProgressBar(options.model) as progress:
        model = train_model(
            options.model, maps.take(parts["train"]), maps.take(parts["val"]), chosen, output=folder,
            dynamic_range_db=options.dynamic_range_db, about=_about(dataset, parts, by), progress=progress,
        )  # fmt: skip
    test = maps.take(parts["test"])
    scores = scores_of(model.probabilities(test.levels), test.labels)
    curves = curves_figure(model.card.about["history"], title=f"{title}, {dataset.recipe.name}")
    write_picture(curves, folder / "curves.png", overwrite=True)
    _write_scores(folder, scores, model.card.classes, f"{title} by {by}", overwrite=True)
    say(f"{title}, split by {by}, {model.card.about['epochs']} epochs: test {_told(scores)}")
    say(f"wrote {folder}")


def _augment(options: Namespace) -> Augment:
    from t2d_rt.learn import Augment

    if options.augment and options.sliding:
        raise InputError("--augment and --sliding are two ways to change samples; give one of them")
    return Augment.usual() if options.augment else Augment.sliding() if options.sliding else Augment()


def _sides(dataset: Dataset, options: Namespace) -> dict[str, np.ndarray]:
    """Positions of the samples of train, val and test."""
    from t2d_rt.dataset import read_split
    from t2d_rt.dataset.splits import NAMES, sides_of

    if options.split is None:
        return sides_of(dataset.records, options.by, seed=options.seed)
    found = read_split(options.split, dataset.records)
    lacking = [name for name in NAMES if name not in found.sides]
    if lacking:
        raise InputError(f"{options.split} has no side {lacking[0]}; make a split with train, val and test")
    return {name: dataset.positions(indices) for name, indices in found.sides.items()}


def _about(dataset: Dataset, parts: Mapping[str, np.ndarray], by: str) -> dict[str, Any]:
    """What the card tells of the data, for evaluation and prediction to compare with."""
    recipe, known = dataset.recipe, np.concatenate([parts["train"], parts["val"]])
    radars = [recipe.radar if each.radar is None else each.radar for each in recipe.conditions]
    return {
        "recipe": recipe.name, "recipe_hash": recipe.hash, "split": by, "mti": _mti_of(dataset),
        "carriers_hz": sorted({each.carrier_hz for each in radars}),
        "indices": {name: dataset.indices[places].tolist() for name, places in parts.items()},
        "descriptions": sorted({str(dataset.records[place]["sentence"]) for place in known}),
    }  # fmt: skip


def evaluate_parser() -> ArgumentParser:
    """Options of `t2d-rt evaluate`."""
    found = command_parser(
        "evaluate",
        "Tests a model that t2d-rt train wrote: on the side test of the data set that it was trained on, or on all of another one.",
        config=False, noun="DATA --model DIR", file="Folder of a data set.", examples=EVALUATE_EXAMPLES, several=True,
    )  # fmt: skip
    found.add_argument("--model", type=str | None, help="Folder that t2d-rt train wrote.")
    told = "Folder for confusion and reliability as pictures; none by default."
    found.add_argument("-o", "--output", type=str | None, help=told)
    add_overwrite(found)
    return found


def evaluate_command(options: Namespace) -> None:
    """Prints the scores, and those of each class."""
    from t2d_rt.dataset import Dataset
    from t2d_rt.learn import load_model, maps_of, scores_of

    source = _one_word(options, "evaluate", "the folder of a data set")
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
    say(f"{model.card.model} on {what}: {_told(scores)}")
    for number, name in enumerate(maps.classes):
        row = scores.confusion[number]
        if row.sum():
            say(f"  {name:18}{100 * row[number] / row.sum():4.0f} % of {row.sum()}")
    if options.output is not None:
        folder = Path(options.output)
        folder.mkdir(parents=True, exist_ok=True)
        title = f"{model.card.model} on {dataset.recipe.name}"
        _write_scores(folder, scores, maps.classes, title, overwrite=options.overwrite)
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
    mti, known = _mti_of(dataset), card.about.get("mti")
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


def predict_parser() -> ArgumentParser:
    """Options of `t2d-rt predict`."""
    found = command_parser(
        "predict",
        "Tells the class of a recording over sliding windows, with its probability, and draws both under the spectrogram.",
        config=False, noun="RECORDING --model DIR", file="A result (.zarr), or ADC samples (.npy, or .bin of a DCA1000).",
        examples=PREDICT_EXAMPLES, several=True,
    )  # fmt: skip
    found.add_argument("--model", type=str | None, help="Folder that t2d-rt train wrote, or several by commas.")
    add_capture_options(found)
    told = "From one window to the next [s]; a tenth of a window by default."
    found.add_argument("--step_s", type=float | None, help=told)
    told = "What an activity lasts at least [s]; 0.8 of a window by default, 0 takes each window for itself."
    found.add_argument("--least_s", type=float | None, help=told)
    told = "Picture; by default it has RECORDING's name and ends in _classes.png."
    found.add_argument("-o", "--output", type=str | None, help=told)
    add_overwrite(found)
    return found


def predict_command(options: Namespace) -> None:
    """Prints a line for each window and for each activity of the likeliest course, and draws them."""
    from t2d_rt.learn import Ensemble, load_model, predict
    from t2d_rt.recording.read import load_recording

    source = Path(_one_word(options, "predict", "a recording"))
    if options.model is None:
        raise InputError("predict needs --model, the folder that t2d-rt train wrote")
    picture = Path(options.output) if options.output else source.with_name(f"{source.stem}_classes.png")
    check_picture(picture, overwrite=options.overwrite)
    # A folder that has a comma in its name is one.
    folders = [options.model] if Path(options.model).is_dir() else [each.strip() for each in options.model.split(",")]
    model = Ensemble(tuple(load_model(each) for each in folders))
    from t2d_rt.learn.figures import prediction_figure

    recording = load_recording(source, options.radar, **capture_options(options))
    found = predict(model, recording, step_s=options.step_s, least_s=options.least_s)
    for start, row in zip(found.starts_s, found.probabilities, strict=True):
        best = int(row.argmax())
        say(f"{start:7.2f} to {start + found.duration_s:6.2f} s  {found.classes[best]:18}{100 * row[best]:4.0f} %")
    lasting = f"where each activity lasts {found.least_s:.3g} s or more" if found.least_s else "each window for itself"
    say(f"likeliest course, {lasting}:")
    for begin, end, number in found.pieces():
        say(f"{begin:7.2f} to {end:6.2f} s  {found.classes[number]}")
    title = f"{source.name}, {', '.join(each.card.model for each in model.members)}"
    write_picture(prediction_figure(recording, found, title=title), picture, overwrite=options.overwrite)
    say(f"wrote {picture}")


def _one_word(options: Namespace, command: str, what: str) -> str:
    """The only bare word of a command."""
    words = options.file or []
    if len(words) != 1:
        raise InputError(
            f"{command} takes {what}, got {' '.join(words) or 'nothing'}; t2d-rt {command} --help shows examples"
        )
    return str(words[0])


def _mti_of(dataset: Dataset) -> str | None:
    """How static echoes were taken away from the spectrograms of a data set."""
    kept = dataset.recipe.products.spectrogram
    return None if kept is None else kept.mti


def _write_scores(folder: Path, scores: Scores, classes: tuple[str, ...], title: str, *, overwrite: bool) -> None:
    """Confusion and reliability as pictures."""
    from t2d_rt.learn.figures import confusion_figure, reliability_figure

    title = f"{title}, accuracy {100 * scores.accuracy:.0f} %"
    write_picture(confusion_figure(scores, classes, title=title), folder / PICTURES[0], overwrite=overwrite)
    write_picture(reliability_figure(scores, title=title), folder / PICTURES[1], overwrite=overwrite)


def _told(scores: Scores) -> str:
    """A line about scores."""
    return (
        f"accuracy {100 * scores.accuracy:.1f} %, macro-F1 {scores.macro_f1:.3f}, calibration error "
        f"{100 * scores.calibration_error:.1f} points, {int(scores.confusion.sum())} samples"
    )
