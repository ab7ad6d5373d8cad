"""`t2d-rt sweep`: one command line whose options hold ranges and alternatives, as many recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.cli.add import Person, additions
from t2d_rt.cli.arguments import alternatives
from t2d_rt.cli.experiment_options import BESIDE, check_scene, is_experiment, read_experiment, substitutes_of
from t2d_rt.cli.options import add_model, add_piece, command_parser
from t2d_rt.cli.output import say, write_picture
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import load_yaml
from t2d_rt.experiment.catalog import radar_named
from t2d_rt.experiment.experiment import Experiment

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.recording.recording import Recording

EXAMPLES = """examples:
  t2d-rt sweep walk --scene living_room --add fan:3,-1,1,rpm=0:900:300 -o fans      # four recordings, 300 rpm apart
  t2d-rt sweep walk --add "none|fan:3,-1,1,rpm=300|pet:3,-1,0" -o beside            # alternatives, quoted for the shell
  t2d-rt sweep walk --method "ellipsoid|mesh" --angle-deg 0:90:45 -o aspects        # a grid of six
  t2d-rt sweep room.yaml --vary targets.1.rpm=0:900:300 --vary seed=0:2:1 -o seeds  # fields of an experiment in YAML"""

OF_MOTION = "file", "start_s", "stop_s", "distance_m", "angle_deg"
"""Options that are fields of the first target."""
OF_EXPERIMENT = tuple(name for name in Experiment.model_fields if name not in ("targets", "radar"))
"""Options that are fields of the experiment by the same names."""


def parser() -> ArgumentParser:
    """Options of `t2d-rt sweep`."""
    found = command_parser(
        "sweep",
        "Simulates a motion file, an experiment (.yaml) or a result (.zarr) again and again with some options varied, and compares "
        "the recordings with the first. Any option of motion, model, radar, accuracy or spectrogram may be a range, "
        "first:last:step, or alternatives with | between them; several make a grid. Recordings are stored as they are made, and a "
        "sweep that was stopped goes on; then come panels.png and panels.pdf on one scale, and table.csv.",
        examples=EXAMPLES,
    )
    told = "Folder of the recordings, the table and the pictures; by default it has FILE's name and ends in _sweep."
    found.add_argument("-o", "--output", type=str | None, help=told)
    add_piece(found)
    told = "A further target, as of simulate; none leaves it out, as in none|fan:2,1,1,rpm=300|pet:3,0,0. Given once for each."
    found.add_argument("--add", type=list[str | dict[str, Any]], default=[], help=told)
    told = "A field of the experiment and its values, as seed=0:9:1 or targets.1.rpm=0:900:300; the first target is number 0."
    found.add_argument("--vary", action="append", type=str, help=told)
    add_model(found, skip={"measure_error", "memory_gb"})
    return found


def run(options: Namespace) -> None:
    """Makes what is not there yet, and writes table and pictures."""
    from t2d_rt.sweeps import PICTURES, TABLE, sweep

    source, default = Path(options.file), parser()
    folder = Path(options.output or f"{source.name.partition('.')[0]}_sweep")
    processing = {
        name: value
        for name, value in options.signal.as_dict().items()
        if value != default.get_default(f"signal.{name}")
    }
    given: dict[str, Any] = {"accuracy": options.accuracy.as_dict() if "accuracy" in options else {}}
    given["tolerance_db"] = options.tolerance_db
    base: Experiment | Recording | dict[str, Any]
    if is_experiment(source):
        base = _made(source, options, given, default)
        processing = {**getattr(base, "processing", {}), **processing}
    else:
        base = _fields(options, default)
    found = sweep(base, _varied(options), folder, **given, processing=processing, device=options.device, progress=True)
    figure = found.plot(source.name)
    for picture in PICTURES:
        write_picture(figure, folder / picture, overwrite=True)
    say(found)
    say(f"wrote {TABLE}, {' and '.join(PICTURES)} beside {len(found.points)} recordings in {folder}")


def _made(source: Path, options: Namespace, given: dict[str, Any], default: ArgumentParser) -> Experiment | Recording:
    """The experiment of a YAML file or a recording; what the file says of accuracy holds where nothing is given."""
    from t2d_rt.recording.recording import Recording

    for name, value in options.items():
        if name.partition(".")[0] not in (*BESIDE, "vary", "varied") and value != default.get_default(name):
            raise InputError(f"option {name} is part of the experiment {source.name}; change it there, or give --vary")
    if source.suffix == ".zarr":
        return Recording.load(source)
    experiment, stored = read_experiment(source)
    given["accuracy"] = {**(stored.get("accuracy") or {}), **given["accuracy"]}
    given["tolerance_db"] = stored.get("tolerance_db") if given["tolerance_db"] is None else given["tolerance_db"]
    return experiment


def _fields(options: Namespace, default: ArgumentParser) -> dict[str, Any]:
    """Fields of the experiment that `simulate` makes of these options."""
    reading = {name: value for name, value in options.motion.as_dict().items() if name != "subject"}
    for name, value in reading.items():
        if value != default.get_default(f"motion.{name}"):
            raise InputError(
                f"option motion.{name} tells how a file is read, and a sweep reads files as they are; write the motion once, "
                f"t2d.save_motion(t2d.load_motion('{options.file}', {name}=...), 'read.bvh'), and sweep that"
            )
    first = {"kind": "file", **{name: options[name] for name in OF_MOTION}, "subject": options.motion.subject}
    fields = {name: options[name] for name in OF_EXPERIMENT if options[name] is not None}
    substitutes = substitutes_of(options)
    if substitutes:
        check_scene(options)
        fields["scene"] = {"file": options.scene, "materials": substitutes}
    return {**fields, "targets": [first, *map(_source, options.add)], "radar": options.radar.as_dict()}


def _source(entry: Any) -> dict[str, Any] | None:
    """An entry of --add as a target of an experiment; None for "none"."""
    if entry == "none":
        return None
    (found,) = additions([entry])
    values = found.model_dump(mode="json")
    return {**values, "kind": "file"} if isinstance(found, Person) else values


def _varied(options: Namespace) -> dict[str, list[Any]]:
    """Values by the names of the experiment's fields, in the order in which they were given."""
    found: dict[str, list[Any]] = {}
    for option, texts in options.varied.items():
        name = option.removeprefix("--")
        if name.startswith("add "):
            found[f"targets.{int(name[4:]) + 1}"] = [_source(each) for each in texts]
        elif name in OF_MOTION or name == "motion.subject":
            values = texts if name in ("file", "motion.subject") else [load_yaml(each) for each in texts]
            found[f"targets.0.{name.rpartition('.')[2]}"] = values
        elif name == "scene" and options.scene_material:
            found["scene.file"] = texts
        elif name in ("only_paths", "without_paths"):
            found[name] = [[each] for each in texts]
        elif name in (*OF_EXPERIMENT, "radar", "tolerance_db") or name.startswith(("radar.", "accuracy.", "signal.")):
            found[name] = [load_yaml(each) for each in texts]
        else:
            raise InputError(
                f"option {name} cannot be varied; those of motion, model, radar, accuracy and spectrogram can, and fields by --vary"
            )
    for entry in options.vary or ():
        name, equals, text = entry.partition("=")
        if not equals:
            raise InputError(f"option vary takes a field and its values, as seed=0:9:1, got {entry!r:.60}")
        found[name.strip()] = [load_yaml(each) for each in alternatives(text)]
    if not found:
        raise InputError(
            "nothing is varied; give a range or alternatives, as --seed 0:9:1, --method 'ellipsoid|mesh' or --vary seed=0:9:1"
        )
    if "radar" in found and options.radar.as_dict() != radar_named(str(found["radar"][0])).model_dump(mode="python"):
        raise InputError(
            "a sweep takes several radars or changes fields of one; leave --radar.FIELD out, or give one radar"
        )
    return found
