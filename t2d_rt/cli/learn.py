"""`t2d-rt train`, `evaluate`, `predict`: trains a classifier, tests it, and tells what a person does in a recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import numpy as np

from t2d_rt.cli.options import Capture, Command, Given
from t2d_rt.cli.output import check_picture, made_folder, say, write_picture
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from t2d_rt.dataset import Dataset
    from t2d_rt.learn import Ensemble, LabelledMaps, Scores
    from t2d_rt.learn.saved_models import Card

PICTURES = "confusion.png", "reliability.png"
ROUNDED_MPS = 1e-6
"""Difference [m/s] by which the speeds of a card may be rounded."""


def training(command: Command) -> None:
    """Adds an option for each field of `TrainOptions` but the changes of samples, which have options of their own."""
    from t2d_rt.learn import TrainOptions

    help_texts = {name: field.description or "" for name, field in TrainOptions.model_fields.items()}
    help_texts["seed"] = "Seed of the split, the weights, the order and the changes of samples."
    defaults = {name: field.default for name, field in TrainOptions.model_fields.items() if name != "augment"}
    command.add_fields(help_texts, get_type_hints(TrainOptions), defaults)


Training = Annotated[Given, training]


def train(
    files: list[str] | None = None,
    output: str | None = None,
    model: str = "resnet18",
    by: str | None = None,
    split: str | None = None,
    size: int | None = None,
    dynamic_range_db: float = 60.0,
    augment: bool = False,
    sliding: bool = False,
    *,
    options: Training,
) -> None:
    """Trains a classifier on the spectrograms of a data set; writes its weights, a card, curves, confusion and reliability. Needs
    the extra [learn].

    files: folder of a data set.
    output: folder to write; a training that was stopped there goes on.
    model: one of vgg-7, resnet18, vit-tiny, crnn, conv1d-lstm, conv1d-alstm-fcn, streaming, which is small and causal, or
        envelope, which learns most of few samples.
    by: what is on one side only: description (and the motions of it), clip (too), or file, which lets descriptions leak. By
        default the sides that the recipe makes, as benchmark-3 does, or by description where it makes none.
    split: file of a split with sides train, val and test, in place of --by.
    size: cells of speed and of time, 128 for envelope and 64 for the others by default; 224 is usual, too.
    dynamic_range_db: levels below that are clipped [dB].
    augment: whether samples are changed on the fly.
    sliding: in place of --augment: changes that suit predict, whose windows slide over changes of activities.

    examples:
      t2d-rt train small --model resnet18 -o resnet              # by description; the same command goes on where it stopped
      t2d-rt train small --model streaming --augment -o mine     # background, masks, shifts, Doppler and gain on the fly
      t2d-rt train small --model streaming --sliding -o mine     # for predict, whose windows slide over changes of activities
      t2d-rt train hard --model envelope --sliding --schedule cosine --rate 2e-3 --smoothing 0.1 --decay 0.05 -o mine
      t2d-rt train small --model vgg-7 --size 128 --by file -o leaky   # as the paper splits: descriptions stand on two sides
    """
    from t2d_rt.learn.pytorch import require_learning

    require_learning()
    from t2d_rt.dataset import Dataset
    from t2d_rt.dataset.splits import check_sides
    from t2d_rt.learn import Augment, TrainOptions, maps_of, scores_of, train_model
    from t2d_rt.learn.benchmark_line import line
    from t2d_rt.learn.figures import curves_figure
    from t2d_rt.learn.models import card

    source = _one(files, "train", "the folder of a data set")
    if output is None:
        raise InputError("train needs -o, the folder to write")
    title, usual = card(model).title, card(model).usual_size
    if augment and sliding:
        raise InputError("--augment and --sliding are two ways to change samples; give one of them")
    changes = Augment.usual() if augment else Augment.sliding() if sliding else Augment()
    train_options, size = TrainOptions(augment=changes, **options), usual if size is None else size
    data = Dataset(source)
    maps = maps_of(data, size=(size, size), dynamic_range_db=dynamic_range_db)
    parts = _sides(data, by, split, train_options.seed)
    check_sides(parts)
    by = Path(split).name if split else by or ("recipe" if data.sides else "description")
    folder = Path(output)
    with ProgressBar(model) as progress:
        trained = train_model(
            model,
            maps.take(parts["train"]),
            maps.take(parts["val"]),
            train_options,
            output=folder,
            dynamic_range_db=dynamic_range_db,
            about=_about(data, parts, by),
            progress=progress,
        )
    test, about = maps.take(parts["test"]), trained.card.about
    scores = scores_of(trained.probabilities(test.levels), test.labels)
    curves = curves_figure(about["history"], title=f"{title}, {data.recipe.name}")
    write_picture(curves, folder / "curves.png", overwrite=True)
    _write_scores(folder, scores, trained.card.classes, f"{title} by {by}", overwrite=True)
    say(f"{title}, split by {by}, {about['epochs']} epochs: test {_told(scores)}")
    if by == "recipe":
        say(f"line of the table: {line(title, data, trained.probabilities(test.levels).argmax(axis=1))}")
    say(f"wrote {folder}")


def _sides(dataset: Dataset, by: str | None, split: str | None, seed: int) -> dict[str, np.ndarray]:
    """Positions of the samples of train, val and test in the data set, an array each."""
    from t2d_rt.dataset import read_split
    from t2d_rt.dataset.splits import NAMES, sides_of

    if split is None and by is None and dataset.sides:
        return dataset.sides
    if split is None:
        return sides_of(dataset.records, by or "description", seed=seed)
    stored = read_split(split, dataset.records)
    lacking = [name for name in NAMES if name not in stored.sides]
    if lacking:
        raise InputError(f"{split} has no side {lacking[0]}; make a split with train, val and test")
    return {name: dataset.positions(indices) for name, indices in stored.sides.items()}


def _about(dataset: Dataset, parts: Mapping[str, np.ndarray], by: str) -> dict[str, Any]:
    """What the card says about the training data, for evaluation and prediction to compare with."""
    from t2d_rt.signal.doppler import checked_windows

    recipe, training_places = dataset.recipe, np.concatenate([parts["train"], parts["val"]])
    radars = [recipe.radar if condition.radar is None else condition.radar for condition in recipe.conditions]
    cells = {
        float(
            np.diff(
                radar.speed_axis_mps(
                    checked_windows(radar, round(recipe.duration_s * radar.prf_hz), None, None, None)[2]
                )[:2]
            )[0]
        )
        for radar in (condition_radar.separated for condition_radar in radars)
    }
    return {
        "recipe": recipe.name,
        "recipe_hash": recipe.hash,
        "split": by,
        "mti": _mti_of(dataset),
        "cells_mps": sorted(cells),
        "carriers_hz": sorted({radar.carrier_hz for radar in radars}),
        "indices": {name: dataset.indices[places].tolist() for name, places in parts.items()},
        "descriptions": sorted({str(dataset.records[place]["sentence"]) for place in training_places}),
    }


def evaluate(
    files: list[str] | None = None, model: str | None = None, output: str | None = None, overwrite: bool = False
) -> None:
    """Tests a model that t2d-rt train wrote on any labelled maps, or on a recording whose motions tell what is done when. Of the
    data set that it was trained on, only the side test is taken.

    files: a data set, an .npz or HDF5 file, a folder of pictures or point clouds by class, or a simulated recording (.zarr). A
        card beside it, card.yaml or FILE.card.yaml, tells what the files do not (docs/transfer.md).
    model: folder that t2d-rt train wrote, or several by commas.
    output: folder for confusion and reliability as pictures; none by default.

    examples:
      t2d-rt evaluate small --model resnet -o figures            # on the samples that were kept apart when it was trained
      t2d-rt evaluate other --model resnet                       # on all of another data set of the same classes and speeds
      t2d-rt evaluate real.npz --model resnet                    # on recordings of a radar
      t2d-rt evaluate minute.zarr --model resnet                 # windows and events of a recording of one thing after another
    """
    from t2d_rt.learn import scores_of
    from t2d_rt.learn.scores import interval_of

    source = _one(files, "evaluate", "labelled data or a recording")
    if model is None:
        raise InputError("evaluate needs --model, the folder that t2d-rt train wrote")
    pictures = None if output is None else Path(output)
    if pictures is not None and pictures.exists() and not pictures.is_dir():
        raise InputError(f"{pictures} is no folder; give one for the pictures")
    if pictures is not None and pictures.is_dir():
        for name in PICTURES:
            check_picture(pictures / name, overwrite=overwrite)
    networks = _networks(model)
    if Path(source).suffix.lower() == ".zarr":
        data_name, probabilities, labels = _windows_and_events(source, networks)
        groups: dict[str, np.ndarray] = {}
    else:
        maps, data_name = _labelled(source, networks, model)
        probabilities, labels = networks.probabilities(maps.levels), maps.labels
        groups = {kind: maps.groups[kind] for kind in ("description", "subject", "event") if kind in maps.groups}
    scores, title = scores_of(probabilities, labels), ", ".join(member.card.model for member in networks.members)
    say(f"{title} on {data_name}: {_told(scores)}")
    if groups:
        predicted = probabilities.argmax(axis=1)
        accuracy, f1 = interval_of(
            labels, predicted, probabilities.shape[1], [group.tolist() for group in groups.values()]
        )
        say(
            f"  with 95 % intervals over other {' and '.join(f'{kind}s' for kind in groups)}: accuracy {accuracy}, macro-F1 {f1}"
        )
    for number, name in enumerate(networks.card.classes):
        row = scores.confusion[number]
        if row.sum():
            say(f"  {name:18}{100 * row[number] / row.sum():4.0f} % of {row.sum()}")
    if pictures is not None:
        title = f"{title} on {Path(source).name}"
        _write_scores(made_folder(pictures), scores, networks.card.classes, title, overwrite=overwrite)
        say(f"wrote {pictures}")


def _networks(model: str) -> Ensemble:
    """The networks in the named folders; a folder that has a comma in its name is one."""
    from t2d_rt.learn import Ensemble, load_model

    folders = [model] if Path(model).is_dir() else [folder.strip() for folder in model.split(",")]
    return Ensemble(tuple(load_model(folder) for folder in folders))


def _windows_and_events(source: str, networks: Ensemble) -> tuple[str, np.ndarray, np.ndarray]:
    """Name of what is tested, and probabilities and labels of the windows of a recording; prints the scores of its events."""
    from t2d_rt.learn.prediction import events_of, labels_of_windows
    from t2d_rt.learn.prediction import predict as predicted
    from t2d_rt.learn.scores import event_scores
    from t2d_rt.recording.read import load_recording

    recording, classes = load_recording(source), networks.card.classes
    events = events_of(recording, classes)
    if not events:
        raise InputError(
            f"nothing tells when a person of {source} does one of {', '.join(classes)}; simulate motions of sentences"
        )
    prediction = predicted(networks, recording)
    duration_s = float(prediction.starts_s[-1]) + prediction.duration_s
    scores = event_scores([(events, prediction.pieces())], len(classes), duration_s)
    say(
        f"events: F1 {scores.f1:.2f} (overlap of a half), "
        f"{scores.found.sum()} of {scores.true.sum()} found, {scores.told.sum()} told"
    )
    if len(scores.delays_s):
        say(f"  told to begin {np.median(scores.delays_s):.2f} s later than they do, in the median")
    for name, alarms_per_hour in zip(classes, scores.false_alarms_per_hour, strict=True):
        if alarms_per_hour:
            say(f"  {name:18}{alarms_per_hour:6.0f} times an hour where there is none")
    labels = labels_of_windows(events, prediction.starts_s, prediction.duration_s, len(classes))
    return "windows", prediction.probabilities[labels >= 0], labels[labels >= 0]


def _labelled(source: str, networks: Ensemble, model: str) -> tuple[LabelledMaps, str]:
    """Maps on the axes of networks with labels of their classes, and a text about them; of a data set that the networks were
    trained on, the samples that all of them kept apart."""
    from t2d_rt.dataset import Dataset
    from t2d_rt.dataset.shards import RECIPE
    from t2d_rt.learn import maps_of
    from t2d_rt.learn.adapters import AdapterOptions, of_recipe, read_real
    from t2d_rt.learn.adapters.interface import class_names

    card = networks.card
    if not (Path(source) / RECIPE).is_file():
        low, high = card.speeds_mps
        axes = AdapterOptions(
            size=card.size, speed_mps=max(-low, high), cut_mps=(low, high), duration_s=card.duration_s,
            dynamic_range_db=card.dynamic_range_db,
        )  # fmt: skip
        real = read_real(source, options=axes)
        maps = real.maps.resized(card.size, (low, high))  # some maps have axes of their own
        _check_like(source, maps, real.mti, card)
        if real.assumed:
            warn(
                f"nothing tells the {' and the '.join(real.assumed)} of {source}, so those of the model are taken, {low:.3g} to "
                f"{high:.3g} m/s over {card.duration_s:.3g} s; say yours on a card beside it (speed_mps or cell_mps, duration_s or "
                "rate_hz)"
            )
        for warning in card.unfamiliar(source, carrier_hz=real.carrier_hz, levels=maps.levels):
            warn(warning)
        return maps.relabelled(card.classes), f"{len(maps)} maps by the adapter {real.adapter}"
    data = Dataset(source)
    options = of_recipe(data, AdapterOptions().with_card(data.path))
    maps = maps_of(data, size=card.size, dynamic_range_db=card.dynamic_range_db, speeds_mps=_speeds_of(data, card))
    if options.classes is not None:
        maps = maps.relabelled(class_names(list(maps.classes), options, data.path), options.classes)
    _check_like(source, maps, options.mti, card)
    cards = [member.card for member in networks.members]
    trained_on = [member.about.get("recipe_hash") == data.recipe.hash for member in cards]
    for member, same in zip(cards, trained_on, strict=True):
        if not same:
            _warn_of_seen(source, maps, member)
    if any(trained_on):
        kept_apart = [set(_kept_apart(member, model)) for member, same in zip(cards, trained_on, strict=True) if same]
        common = sorted(set.intersection(*kept_apart))
        if not common:
            raise InputError(
                f"no sample of {source} was kept apart by all of {model}; train them with one seed of the split, or evaluate them "
                "one by one"
            )
        test_maps = maps.take([place for place, name in enumerate(maps.names) if int(name) in common])
        return test_maps.relabelled(card.classes), f"the test of the split by {card.about.get('split', 'unknown')}"
    for warning in card.unfamiliar(source, carrier_hz=options.carrier_hz, levels=maps.levels):
        warn(warning)
    return maps.relabelled(card.classes), "all samples, of another recipe than it was trained on"


def _kept_apart(card: Card, folder: str) -> list[int]:
    """Indices of the samples that were kept apart for the test; raises InputError where the card does not tell them."""
    try:
        indices = [int(index) for index in card.about["indices"]["test"]]
    except (KeyError, TypeError, ValueError):
        indices = []
    if not indices:
        raise InputError(
            f"the card of {folder} does not tell which samples of this recipe it was trained on; train it with t2d-rt train, "
            "or evaluate it on a data set of another recipe"
        )
    return indices


def _speeds_of(dataset: Dataset, card: Card) -> tuple[float, float]:
    """Lowest and highest speed [m/s]: those of the training where the data set covers them and hardly more, else the data set's
    own, which may be refused."""
    from t2d_rt.dataset.products import edges
    from t2d_rt.learn.maps import LEAST_SHARED, shared_speeds

    own_speeds, (lowest, highest) = shared_speeds(dataset), edges(card.axis_mps)
    covered = own_speeds[0] <= lowest + ROUNDED_MPS and own_speeds[1] >= highest - ROUNDED_MPS
    if covered and highest - lowest >= LEAST_SHARED * (own_speeds[1] - own_speeds[0]):
        return max(lowest, own_speeds[0]), min(highest, own_speeds[1])
    return own_speeds


def _check_like(source: str, maps: LabelledMaps, mti: str | None, card: Card) -> None:
    """Refuses maps whose classes, speeds, duration or treatment of static echoes are not those of the training."""
    unknown = [name for name in maps.classes if name not in card.classes]
    if unknown:
        raise InputError(
            f"{source} has the classes {', '.join(maps.classes)}, the model {', '.join(card.classes)}; take a like data set, or "
            "say on its card which label is which class"
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
    trained_mti = card.about.get("mti")
    if trained_mti is not None and mti is not None and mti != trained_mti:
        raise InputError(
            f"{source} was made with mti {mti}, the model was trained with {trained_mti}; make it with the same mti"
        )


def _warn_of_seen(source: str, maps: LabelledMaps, card: Card) -> None:
    """Warns where descriptions of a data set are among those of the training."""
    repeated = np.isin(maps.groups["description"], card.about.get("descriptions", []))
    if repeated.any():
        warn(
            f"{repeated.sum()} of {len(maps)} samples of {source} are of descriptions that the model was trained on; "
            "its scores are better than for new ones"
        )


def predict(
    files: list[str] | None = None,
    model: str | None = None,
    step_s: float | None = None,
    least_s: float | None = None,
    output: str | None = None,
    overwrite: bool = False,
    *,
    capture: Capture,
) -> None:
    """Tells the class of a recording over sliding windows, with its probability, and draws both under the spectrogram.

    files: a result (.zarr), or ADC samples (.npy, or .bin of a DCA1000).
    model: folder that t2d-rt train wrote, or several by commas.
    step_s: from one window to the next [s]; a tenth of a window by default.
    least_s: what an activity lasts at least [s]; 0.8 of a window by default, 0 takes each window for itself.
    output: picture; by default it has RECORDING's name and ends in _classes.png.

    examples:
      t2d-rt predict walk.zarr --model resnet                    # a class and its probability for each window; walk_classes.png
      t2d-rt predict walk.zarr --model one,two,three              # probabilities are means over several networks
      t2d-rt predict capture.npy --radar my_radar.yaml --model resnet --step-s 0.5 -o capture.png
    """
    from t2d_rt.learn import predict as predicted
    from t2d_rt.recording.read import load_recording

    source = Path(_one(files, "predict", "a recording"))
    if model is None:
        raise InputError("predict needs --model, the folder that t2d-rt train wrote")
    picture = Path(output) if output else source.with_name(f"{source.stem}_classes.png")
    check_picture(picture, overwrite=overwrite)
    networks = _networks(model)
    from t2d_rt.learn.figures import prediction_figure

    recording = load_recording(source, **capture)
    prediction = predicted(networks, recording, step_s=step_s, least_s=least_s)
    for start, row in zip(prediction.starts_s, prediction.probabilities, strict=True):
        best = int(row.argmax())
        say(
            f"{start:7.2f} to {start + prediction.duration_s:6.2f} s  {prediction.classes[best]:18}{100 * row[best]:4.0f} %"
        )
    lasting = (
        f"where each activity lasts {prediction.least_s:.3g} s or more"
        if prediction.least_s
        else "each window for itself"
    )
    say(f"likeliest course, {lasting}:")
    for begin, end, number in prediction.pieces():
        say(f"{begin:7.2f} to {end:6.2f} s  {prediction.classes[number]}")
    title = f"{source.name}, {', '.join(member.card.model for member in networks.members)}"
    write_picture(prediction_figure(recording, prediction, title=title), picture, overwrite=overwrite)
    say(f"wrote {picture}")


def _one(words: list[str] | None, command: str, what: str) -> str:
    """The only bare word of a command; raises InputError if there is none, or more than one."""
    if not words or len(words) != 1:
        given = " ".join(words or ()) or "nothing"
        raise InputError(f"{command} takes {what}, got {given}; t2d-rt {command} --help shows examples")
    return words[0]


def _mti_of(dataset: Dataset) -> str | None:
    """The MTI filter of a data set's spectrograms; None if it has no spectrograms."""
    spectrogram = dataset.recipe.products.spectrogram
    return None if spectrogram is None else spectrogram.mti


def _write_scores(folder: Path, scores: Scores, classes: tuple[str, ...], title: str, *, overwrite: bool) -> None:
    """Writes confusion and reliability as pictures."""
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
