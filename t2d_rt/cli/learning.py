"""What the commands of learning have in common: a folder of data, its maps, its sides, its pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.output import write_picture
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.dataset import Dataset
    from t2d_rt.learn.train import Scores


PICTURES = "confusion.png", "reliability.png"


def mti_of(dataset: Dataset) -> str | None:
    """How static echoes were taken away from the spectrograms of a data set."""
    kept = dataset.recipe.products.spectrogram
    return None if kept is None else kept.mti


def one_word(options: Namespace, command: str, what: str) -> str:
    """The only bare word of a command."""
    words = options.file or []
    if len(words) != 1:
        raise InputError(
            f"{command} takes {what}, got {' '.join(words) or 'nothing'}; t2d-rt {command} --help shows examples"
        )
    return str(words[0])


def add_split(parser: ArgumentParser) -> None:
    """Options of the sides."""
    parser.add_argument(
        "--by",
        type=str,
        default="description",
        help="What is on one side only: description (and the motions of it), clip (too), or file, which lets descriptions leak.",
    )
    parser.add_argument(
        "--split", type=str | None, help="File of a split with sides train, val and test, in place of --by."
    )


def sides(dataset: Dataset, options: Namespace) -> dict[str, np.ndarray]:
    """Positions of the samples of train, val and test."""
    from t2d_rt.dataset import read_split
    from t2d_rt.learn.train import sides_of

    if options.split is None:
        return sides_of(dataset.records, options.by, seed=options.seed)
    found = read_split(options.split, dataset.records)
    lacking = [name for name in ("train", "val", "test") if name not in found.sides]
    if lacking:
        raise InputError(f"{options.split} has no side {lacking[0]}; make a split with train, val and test")
    return {name: dataset.positions(indices) for name, indices in found.sides.items()}


def write_scores(folder: Path, scores: Scores, classes: tuple[str, ...], title: str, *, overwrite: bool) -> None:
    """Confusion and reliability as pictures."""
    from t2d_rt.learn.charts import confusion_figure, reliability_figure

    title = f"{title}, accuracy {100 * scores.accuracy:.0f} %"
    write_picture(confusion_figure(scores, classes, title=title), folder / PICTURES[0], overwrite=overwrite)
    write_picture(reliability_figure(scores, title=title), folder / PICTURES[1], overwrite=overwrite)


def told(scores: Scores) -> str:
    """A line about scores."""
    return (
        f"accuracy {100 * scores.accuracy:.1f} %, macro-F1 {scores.macro_f1:.3f}, calibration error "
        f"{100 * scores.calibration_error:.1f} points, {int(scores.confusion.sum())} samples"
    )
