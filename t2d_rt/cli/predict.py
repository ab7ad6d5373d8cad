"""`t2d-rt predict`: what a person does in a recording, over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.learning import one_word
from t2d_rt.cli.options import add_capture_options, capture_options, command_parser
from t2d_rt.cli.output import check_picture, say, write_picture
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

EXAMPLES = """examples:
  t2d-rt predict walk.zarr --model resnet                    # a class and its probability for each window; draws walk_classes.png
  t2d-rt predict walk.zarr --model one,two,three              # probabilities are means over several networks
  t2d-rt predict capture.npy --radar my_radar.yaml --model resnet --step-s 0.5 -o capture.png"""


def parser() -> ArgumentParser:
    """Options of `t2d-rt predict`."""
    found = command_parser(
        "predict",
        "Tells the class of a recording over sliding windows, with its probability, and draws both under the spectrogram.",
        config=False,
        noun="RECORDING --model DIR",
        file="A result (.zarr), or ADC samples (.npy, or .bin of a DCA1000).",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument("--model", type=str | None, help="Folder that t2d-rt train wrote, or several by commas.")
    add_capture_options(found)
    found.add_argument(
        "--step_s", type=float | None, help="From one window to the next [s]; a tenth of a window by default."
    )
    found.add_argument(
        "--least_s",
        type=float | None,
        help="What an activity lasts at least [s]; 0.8 of a window by default, 0 takes each window for itself.",
    )
    found.add_argument(
        "-o", "--output", type=str | None, help="Picture; by default it has RECORDING's name and ends in _classes.png."
    )
    told = "Whether a picture of that name is replaced; without it an existing one is an error."
    found.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help=told)
    return found


def run(options: Namespace) -> None:
    """Prints a line for each window and for each activity of the likeliest course, and draws them."""
    from t2d_rt.learn.train import Ensemble, load_model
    from t2d_rt.recording.read import load_recording

    source = Path(one_word(options, "predict", "a recording"))
    if options.model is None:
        raise InputError("predict needs --model, the folder that t2d-rt train wrote")
    picture = Path(options.output) if options.output else source.with_name(f"{source.stem}_classes.png")
    check_picture(picture, overwrite=options.overwrite)
    model = Ensemble(tuple(load_model(each) for each in _folders(options.model)))
    from t2d_rt.learn.charts import prediction_figure
    from t2d_rt.learn.windows import predict

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


def _folders(given: str) -> list[str]:
    """Folders by commas; one that has a comma in its name is one."""
    return [given] if Path(given).is_dir() else [each.strip() for each in given.split(",")]
