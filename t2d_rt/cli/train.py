"""`t2d-rt train`: a classifier from the shards of a data set."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.cli.learning import add_split, mti_of, one_word, sides, told, write_scores
from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say, write_picture
from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.train import Augment

EXAMPLES = """examples:
  t2d-rt train small --model resnet18 -o resnet              # by description; the same command goes on where it stopped
  t2d-rt train small --model streaming --augment -o mine     # background, masks, shifts, Doppler and gain on the fly
  t2d-rt train small --model streaming --sliding -o mine     # for predict, whose windows slide over changes of activities
  t2d-rt train hard --model envelope --sliding --schedule cosine --rate 2e-3 --smoothing 0.1 --decay 0.05 -o mine
  t2d-rt train small --model vgg-7 --size 128 --by file -o leaky   # as the paper splits: descriptions stand on two sides"""


def parser() -> ArgumentParser:
    """Options of `t2d-rt train`."""
    found = command_parser(
        "train",
        "Trains a classifier on the spectrograms of a data set; writes its weights, a card, curves, confusion and reliability. "
        "Needs the extra [learn].",
        config=False,
        noun="DATA --model NAME -o DIR",
        file="Folder of a data set.",
        examples=EXAMPLES,
        several=True,
    )
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
    add_split(found)
    found.add_argument(
        "--size",
        type=int | None,
        help="Cells of speed and of time, 128 for envelope and 64 for the others by default; 224 is usual, too.",
    )
    found.add_argument("--dynamic_range_db", type=float, default=60.0, help="Levels below that are clipped [dB].")
    found.add_argument(
        "--augment", type=bool, default=False, nargs="?", const=True, help="Whether samples are changed on the fly."
    )
    found.add_argument(
        "--sliding",
        type=bool,
        default=False,
        nargs="?",
        const=True,
        help="In place of --augment: changes that suit predict, whose windows slide over changes of activities.",
    )
    found.add_argument(
        "--epochs", type=int, default=100, help="At most; training stops after ten without a lower loss."
    )
    found.add_argument("--batch", type=int, default=64, help="Samples of a step.")
    found.add_argument("--rate", type=float, default=1e-3, help="Learning rate of Adam.")
    found.add_argument(
        "--schedule",
        type=str,
        default="plateau",
        help="How the rate falls: plateau, which stops early, or cosine, which runs all epochs.",
    )
    found.add_argument("--smoothing", type=float, default=0.0, help="Part of the probability that the classes share.")
    found.add_argument("--decay", type=float, default=0.0, help="By which weights shrink, relative to the rate.")
    found.add_argument("--seed", type=int, default=0, help="Seed of the split, the weights and the order.")
    found.add_argument("--threads", type=int, default=1, help="Of torch; the same weights, bit for bit, with one.")
    found.add_argument("--device", type=str, default="cpu", help="Where it runs: cpu or gpu.")
    return found


def run(options: Namespace) -> None:
    """Trains, then tests on the side that was kept apart."""
    from t2d_rt.learn.pytorch import require_learning

    require_learning()
    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.charts import curves_figure
    from t2d_rt.learn.maps import maps_of
    from t2d_rt.learn.models import card
    from t2d_rt.learn.train import TrainOptions, scores_of, train_model
    from t2d_rt.learn.train.sides import check_sides

    source = one_word(options, "train", "the folder of a data set")
    if options.output is None:
        raise InputError("train needs -o, the folder to write")
    about_model = card(options.model)
    title = about_model.title
    size = about_model.usual_size if options.size is None else options.size
    chosen = TrainOptions(
        rate=options.rate, epochs=options.epochs, batch=options.batch, seed=options.seed, threads=options.threads,
        device=options.device, augment=_augment(options), schedule=options.schedule, smoothing=options.smoothing,
        decay=options.decay,
    )  # fmt: skip
    dataset = Dataset(source)
    maps = maps_of(dataset, size=(size, size), dynamic_range_db=options.dynamic_range_db)
    parts = sides(dataset, options)
    check_sides(parts)
    by = options.by if options.split is None else Path(options.split).name
    about = _about(dataset, parts, by)
    folder = Path(options.output)
    with ProgressBar(options.model) as progress:
        model = train_model(
            options.model, maps.take(parts["train"]), maps.take(parts["val"]), chosen, output=folder,
            dynamic_range_db=options.dynamic_range_db, about=about, progress=progress,
        )  # fmt: skip
    test = maps.take(parts["test"])
    scores = scores_of(model.probabilities(test.levels), test.labels)
    write_picture(
        curves_figure(model.card.about["history"], title=f"{title}, {dataset.recipe.name}"),
        folder / "curves.png",
        overwrite=True,
    )
    write_scores(folder, scores, model.card.classes, f"{title} by {by}", overwrite=True)
    say(f"{title}, split by {by}, {model.card.about['epochs']} epochs: test {told(scores)}")
    say(f"wrote {folder}")


def _augment(options: Namespace) -> Augment:
    from t2d_rt.learn.train import Augment

    if options.augment and options.sliding:
        raise InputError("--augment and --sliding are two ways to change samples; give one of them")
    return Augment.usual() if options.augment else Augment.sliding() if options.sliding else Augment()


def _about(dataset: Dataset, parts: Mapping[str, np.ndarray], by: str) -> dict[str, Any]:
    """What the card tells of the data, for evaluation and prediction to compare with."""
    recipe, known = dataset.recipe, np.concatenate([parts["train"], parts["val"]])
    radars = [recipe.radar if each.radar is None else each.radar for each in recipe.conditions]
    return {
        "recipe": recipe.name, "recipe_hash": recipe.hash, "split": by, "mti": mti_of(dataset),
        "carriers_hz": sorted({each.carrier_hz for each in radars}),
        "indices": {name: dataset.indices[places].tolist() for name, places in parts.items()},
        "descriptions": sorted({str(dataset.records[place]["sentence"]) for place in known}),
    }  # fmt: skip
