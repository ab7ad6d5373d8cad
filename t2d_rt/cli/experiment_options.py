"""What the options of a simulation give: radar, accuracy, motion, targets, scene; experiments in YAML, and recordings again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.cli.output import say
from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.accuracy import Plan
    from t2d_rt.cli.add import Person
    from t2d_rt.recording.recording import Recording
    from t2d_rt.scene import Mover
    from t2d_rt.types import Motion, Radar, Scene


MODEL = (
    "method", "scene", "tolerance_db", "reflections", "transmissions", "bounces", "clutter", "collisions", "seed", "noise", "body",
    "material", "phase_from", "only_paths", "without_paths", "measure_error", "device", "memory_gb",
)  # fmt: skip
"""Options that go to the pipeline by their names."""


def model_of(options: Namespace, radar: Radar, left: Sequence[str] = ()) -> dict[str, Any]:
    """Options of the pipeline that there are, but those that are left out."""
    found = {name: options[name] for name in MODEL if name in options and name not in left}
    found["scene"] = scene_of(options, radar)
    found["without_paths"] = options.without_paths or ()
    return found


def targets_of(motion: Motion, added: Sequence[Mover | Person], radar: Radar) -> list[Motion | Mover]:
    """The motion, and what `--add` puts beside it."""
    from t2d_rt.cli.add import Person

    return [motion, *(each.motion(radar) if isinstance(each, Person) else each for each in added)]


def radar_of(options: Namespace) -> Radar:
    """The radar of the options."""
    from t2d_rt.types import Radar

    return Radar(**options.radar.as_dict())


def accuracy_of(options: Namespace) -> dict[str, Any]:
    """The fields that were given."""
    return options.accuracy.as_dict() if "accuracy" in options else {}


def motion_of(options: Namespace, source: Path, radar: Radar) -> Motion:
    """The piece of the motion file that is used, in its place before the radar."""
    from t2d_rt.cli.add import cut
    from t2d_rt.experiment.catalog import motion_path
    from t2d_rt.motion import load_motion, place

    motion = load_motion(motion_path(source), **options.motion.as_dict())
    say(motion.report)
    motion = cut(motion, options.start_s, options.stop_s)
    return place(
        motion,
        distance_m=options.distance_m,
        angle_deg=options.angle_deg,
        radar_position_m=radar.position_m,
        boresight=radar.boresight,
    )


def scene_of(options: Namespace, radar: Radar) -> Scene | str:
    """The scene with its materials' substitutes; its name where there are none."""
    from t2d_rt.propagation.scenes import load_scene

    substitutes = substitutes_of(options)
    if not substitutes:
        return str(options.scene)
    check_scene(options)
    return load_scene(options.scene, materials=substitutes, frequency_hz=radar.mid_frequency_hz)


def check_scene(options: Namespace) -> None:
    """Refuses substitutes for the materials of no scene."""
    if options.scene == "free_space":
        raise InputError("--scene-material is of a scene and there is none; give --scene, or leave it out")


def substitutes_of(options: Namespace) -> dict[str, str]:
    """Materials of the scene and what stands in for them."""
    found = {}
    given = ",".join(options.scene_material or ())
    for each in given.split(",") if given else ():
        name, _, other = (part.strip() for part in each.partition("="))
        if not name or not other:
            raise InputError(
                f"option scene-material must name a material and its substitute, as brick=concrete, got {shown(each)}"
            )
        found[name] = other
    return found


RUN = "tolerance_db", "measure_error", "device", "memory_gb"
"""Options beside an experiment that go to `run` by their names."""
BESIDE = (
    *RUN, "file", "output", "overwrite", "config", "accuracy", "signal", "background", "background_seed",
    "background_level_db",
)  # fmt: skip
"""All that may be given beside an experiment; the others are the experiment's own."""


def is_experiment(source: Path) -> bool:
    """Whether a file is an experiment or a recording, not a motion."""
    return source.suffix.lower() in (".yaml", ".yml", ".zarr")


def recorded(source: Path, options: Namespace, parser: ArgumentParser, accuracy: dict[str, Any]) -> Recording:
    """The recording of an experiment in YAML, or of a recording again."""
    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.recording.recording import Recording
    from t2d_rt.simulate import run

    check_beside(source, options, parser)
    given: dict[str, Any] = {name: options[name] for name in RUN}
    processing = options.signal.as_dict()
    if source.suffix == ".zarr":
        experiment: Experiment | Recording = (first := Recording.load(source))
        if all(processing[name] == parser.get_default(f"signal.{name}") for name in processing):
            processing = first.processing
    else:
        experiment, stored = read_experiment(source)
        given["tolerance_db"] = stored.get("tolerance_db") if given["tolerance_db"] is None else given["tolerance_db"]
        accuracy = {**(stored.get("accuracy") or {}), **accuracy}
    with ProgressBar(source.stem) as progress:
        return run(experiment, accuracy or None, progress=progress, **given).processed(**processing)


def planned(source: Path, options: Namespace, parser: ArgumentParser, accuracy: dict[str, Any]) -> Plan:
    """The plan of an experiment in YAML."""
    from t2d_rt.accuracy import plan

    if source.suffix == ".zarr":
        raise InputError(
            f"{source} is a result, which is simulated already; give plan a motion file or an experiment (.yaml)"
        )
    check_beside(source, options, parser)
    experiment, stored = read_experiment(source)
    tolerance_db = stored.get("tolerance_db") if options.tolerance_db is None else options.tolerance_db
    given = {} if tolerance_db is None else {"tolerance_db": tolerance_db}
    accuracy = {**(stored.get("accuracy") or {}), **accuracy}
    return plan(experiment, accuracy=accuracy, device=options.device, memory_gb=options.memory_gb, **given)


def check_beside(source: Path, options: Namespace, parser: ArgumentParser, also: Sequence[str] = ()) -> None:
    """Refuses options that are the experiment's own; a command has some `also` beside it."""
    for name, value in options.items():
        if name.partition(".")[0] not in (*BESIDE, *also) and value != parser.get_default(name):
            raise InputError(f"option {name} is part of the experiment {source.name}; change it there")


def read_experiment(path: Path) -> tuple[Any, dict[str, Any]]:
    """The experiment, and what the file says of its accuracy: `accuracy` and `tolerance_db`."""
    from t2d_rt.experiment.experiment import Experiment

    values = read_yaml(path, noun="experiment", example="targets, radar and scene")
    stored: dict[str, Any] = {name: values.pop(name) for name in ("accuracy", "tolerance_db") if name in values}
    return Experiment.read(values, path), stored
