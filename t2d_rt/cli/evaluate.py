"""`t2d-rt evaluate`: how well a trained model does on a data set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.learning import one_word, told, write_scores
from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say
from t2d_rt.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

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
    model = load_model(options.model)
    dataset = Dataset(source)
    maps = maps_of(dataset, size=model.card.size, dynamic_range_db=model.card.dynamic_range_db)
    if maps.classes != model.card.classes:
        raise InputError(
            f"{source} has the classes {', '.join(maps.classes)}, the model {', '.join(model.card.classes)}; take a like data set"
        )
    cell = model.card.axis_mps[1] - model.card.axis_mps[0]
    if abs(maps.velocity_mps - model.card.axis_mps).max() > cell:
        raise InputError(
            f"{source} shows {maps.velocity_mps[0]:.3g} to {maps.velocity_mps[-1]:.3g} m/s, the model was trained on "
            f"{model.card.axis_mps[0]:.3g} to {model.card.axis_mps[-1]:.3g} m/s; make it with the same speed_mps"
        )
    about = model.card.about
    if about.get("recipe_hash") == dataset.recipe.hash:
        maps = maps.take(dataset.positions(about["indices"]["test"]))
        what = f"the test of the split by {about['split']}"
    else:
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
