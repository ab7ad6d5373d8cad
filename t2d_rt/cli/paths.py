"""`t2d-rt paths`: the paths from the radar to the targets as a table, without simulating anything."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.experiment_options import accuracy_of, is_experiment, model_of, motion_of, radar_of, targets_of
from t2d_rt.cli.options import add_additions, add_model, add_overwrite, add_piece, command_parser
from t2d_rt.cli.output import say
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.pipeline.echo_model import Model
    from t2d_rt.types import Accuracy

EXAMPLES = """examples:
  t2d-rt paths walk --scene living_room                      # the strongest in the middle of the record, on the screen
  t2d-rt paths walk --scene living_room -o paths.csv         # all of them over time
  t2d-rt paths walk --scene empty_room --time-s 0.5 --add fan:3,-1,1
  t2d-rt paths walk.zarr -o paths.csv                        # those of a recording, or of an experiment (.yaml)"""
NOT_ASKED = "noise", "measure_error"
"""Options of a simulation that paths do not depend on; a tolerance sets how weak a pair is modelled."""


def parser() -> ArgumentParser:
    """Options of `t2d-rt paths`."""
    found = command_parser(
        "paths",
        "Tells over which paths a motion file, an experiment (.yaml) or a recording (.zarr) is seen: delay, range, speed, level "
        "and directions of each; nothing is simulated.",
        examples=EXAMPLES,
    )
    found.add_argument("-o", "--output", type=str | None, help="Table to write (.csv); none by default.")
    add_overwrite(found)
    found.add_argument(
        "--rate_hz", type=float, default=25.0, help="Instants a second in the table that is written [Hz]."
    )
    found.add_argument(
        "--time_s",
        type=float | None,
        help="Instant of the table on the screen [s]; the middle of the record by default.",
    )
    add_additions(found)
    add_piece(found)
    add_model(found, skip=NOT_ASKED, signal=False)
    return found


def run(options: Namespace) -> None:
    """Prints the strongest paths at one instant, and writes those at all of them."""
    from t2d_rt.core.atomic_write import check_place, check_taken, replacing
    from t2d_rt.core.checks import positive
    from t2d_rt.recording.path_table import checked_times, csv_text, path_table, record_times, screen_text

    rate_hz = positive("rate_hz", options.rate_hz, 1e4, unit="Hz")
    target = None if options.output is None else Path(options.output)
    if target is not None:
        if target.suffix.lower() != ".csv":
            raise InputError(f"the table of paths ends in .csv, got '{target}'; choose another name")
        if target.is_dir():
            raise InputError(f"{target} is a folder; choose another name for the table")
        check_place(target, overwrite=options.overwrite)
    model, accuracy = _set_up(options)
    middle_s = 0.5 * (model.span_s[1] - model.span_s[0]) if options.time_s is None else options.time_s
    say(screen_text(path_table(model, accuracy, checked_times(model, middle_s))))
    if target is not None:
        text = csv_text(path_table(model, accuracy, record_times(model.span_s, rate_hz)))
        with replacing(target, lambda: check_taken(target, overwrite=options.overwrite)) as new:
            new.write_text(text, encoding="utf-8")
        say(f"wrote {target}")


def _set_up(options: Namespace) -> tuple[Model, Accuracy]:
    """The targets and the paths to them, of a motion file, an experiment or a recording; and the accuracy that `simulate` would
    choose, which says which paths are modelled."""
    from t2d_rt.accuracy.wanted import Wanted, chosen
    from t2d_rt.cli.add import additions
    from t2d_rt.cli.experiment_options import check_beside, read_experiment
    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.experiment.setup import set_up, set_up_again
    from t2d_rt.recording.recording import Recording

    source, given, tolerance_db = Path(options.file), accuracy_of(options), options.tolerance_db
    machine = {"device": options.device, "memory_gb": options.memory_gb}
    if is_experiment(source):
        check_beside(source, options, parser(), ("rate_hz", "time_s"))
    if source.suffix.lower() == ".zarr":
        recording = Recording.load(source)
        kept = recording.accuracy if tolerance_db is None else None
        wanted = Wanted.of(kept.replace(**given) if kept else given, tolerance_db)
        stage = set_up_again(recording.experiment, recording.inputs, **machine)
    elif is_experiment(source):
        experiment, stored = read_experiment(source)
        wanted = Wanted.of(
            {**(stored.get("accuracy") or {}), **given},
            stored.get("tolerance_db") if tolerance_db is None else tolerance_db,
        )
        targets, scene = experiment.targets_from({}), experiment.scene_from({})
        stage = set_up(targets, experiment.radar, scene, experiment.physics, **machine)
    else:
        wanted, radar, added = Wanted.of(given, tolerance_db), radar_of(options), additions(options.add)
        asked = model_of(options, radar, ("measure_error", "tolerance_db", *machine))
        physics = {
            name: field.default
            for name, field in Experiment.model_fields.items()
            if name not in ("targets", "radar", "scene")
        }
        targets, scene = targets_of(motion_of(options, source, radar), added, radar), asked.pop("scene")
        stage = set_up(targets, radar, scene, physics | asked, **machine)
    plan = chosen(stage.model, wanted)
    return replace(plan.model, ranked=stage.model.ranked), plan.accuracy
