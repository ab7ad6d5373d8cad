"""Options that describe an experiment: its own fields, those of its first motion, of its radar and of its accuracy."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

from t2d_rt.cli.options import Command, Given, defaults_of, parameter_help, reading, yaml_kind
from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml

if TYPE_CHECKING:
    from pydantic import BaseModel

    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.experiment.sources import MotionFile
    from t2d_rt.recording.recording import Recording
    from t2d_rt.scene import Mover
    from t2d_rt.types import Radar

RUN = "tolerance_db", "measure_error", "split", "device", "memory_gb"
"""Options that are not part of an experiment and go to `run` by their names."""
SIMPLER = {
    "scene": str,
    "material": str | None,
    "noise": str | dict[str, Any],
    "only_paths": list[str] | None,
    "without_paths": list[str] | None,
}
"""Types that an option takes for fields that may also hold structured values in an experiment."""
OF_SCENE = "scene_material", "scene_units", "scene_up"
FIELD = re.compile(r"\s*[A-Za-z_]+\s*=")
"""A word of an entry of --add that gives a field; anything else belongs to the name of the file."""


def experiment(command: Command, *, skip: tuple[str, ...] = ()) -> None:
    """Adds an option for each field of `Experiment`, of a `MotionFile`, of `Radar` and of `Accuracy`, and for those of a run."""
    from argparse import SUPPRESS

    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.experiment.sources import MotionFile
    from t2d_rt.propagation.scenes import scene_names
    from t2d_rt.simulate import run, simulate
    from t2d_rt.types import Accuracy

    entries_type = list[str | dict[str, Any]]
    _fields(
        command,
        MotionFile,
        skip=("kind", "file", "subject", "reading"),
        hints={"carries": entries_type},
        defaults={"carries": []},
    )
    help_text = (
        "A further target, such as fan:X,Y,Z,rpm=900, pet:X,Y,Z,animal=cat or person:FILE,distance_m=3; there are also "
        "ceiling_fan, curtain and door (t2d-rt list movers). The option is given once for each; in a config file it is a list."
    )
    command.add("add", entries_type, [], help_text)
    group = command.parser.add_argument_group("model")
    help_texts = parameter_help(simulate) | {
        "scene": f"Scene: free_space, {', '.join(scene_names())}, a Mitsuba/Sionna XML file, or a room's mesh (.obj, .ply, .glb).",
        "material": "Material of the body (skin, clothed, pec or an ITU name), or what it wears (dressed, coat); skin by default.",
    }
    help_texts |= {
        name: f"{help_texts[name]} The option is given once for each." for name in ("only_paths", "without_paths")
    }
    of_experiment: Given = {
        "help_texts": help_texts,
        "hints": SIMPLER,
        "defaults": {"without_paths": None},
        "group": group,
    }
    _fields(command, Experiment, skip=("targets", "radar", *skip), **of_experiment)
    of_scene(command, group)
    command.add_fields(
        help_texts, get_type_hints(run), defaults_of(run, skip={"accuracy", "progress", *skip}), group=group
    )
    title = "accuracy (a tolerance chooses the fields that are not given)"
    group = command.parser.add_argument_group(title)
    # Tiers check themselves. A field that is not given has no value at all, because a tolerance chooses it.
    defaults = {name: field.default for name, field in Accuracy.model_fields.items()}
    help_texts = {
        name: f"{Accuracy.model_fields[name].description} By default it is {json.dumps(value)}."
        for name, value in defaults.items()
        if isinstance(value, (bool, int, float, str))
    }
    kinds = {"tiers": list[dict[str, Any]]}
    absent = dict.fromkeys(defaults, SUPPRESS)
    _fields(command, Accuracy, help_texts=help_texts, hints=kinds, defaults=absent, prefix="accuracy.", group=group)
    radar(command)
    reading(command)


def radar(command: Command) -> None:
    """Adds an option for each field of a radar; --radar itself is one of the words that come before the parser's."""
    from t2d_rt.types import Radar
    from t2d_rt.types.radar import preset_names

    description = (
        f"--radar NAME takes a preset ({', '.join(preset_names())}), --radar FILE.yaml takes your own, --radar FILE.cfg "
        "that of a TI device. These options override its fields."
    )
    group, default = command.parser.add_argument_group("radar", description), Radar.preset("table2").model_dump()
    # A pattern has several fields, which the radar itself checks.
    patterns: Given = {name: dict[str, Any] for name, value in default.items() if isinstance(value, dict)}
    patterns["track"] = str | dict[str, Any] | None
    _fields(command, Radar, hints=patterns, defaults=default, prefix="radar.", group=group)
    command.add_config()


def of_scene(command: Command, group: Any = None) -> None:
    """Adds the options for substitutes of the scene's materials, and for unit and upward axis of a mesh."""
    help_text = (
        "Substitutes for materials of the scene that have no values at the radar's frequency or are not known, as brick=concrete, "
        "or materials of a mesh's objects, as 'door=wood 0.04'; several with commas between them."
    )
    command.add("scene_material", list[str] | None, None, help_text, group)
    command.add(
        "scene_units", float | str | None, None, "Unit of a scene's mesh: m, cm, mm, inch or ft, or in metres.", group
    )
    command.add("scene_up", str | None, None, "Upward axis of a scene's mesh: y or z.", group)


def _fields(
    command: Command,
    model: type[BaseModel],
    *,
    skip: tuple[str, ...] = (),
    help_texts: Mapping[str, str] | None = None,
    hints: Mapping[str, Any] | None = None,
    defaults: Mapping[str, Any] | None = None,
    prefix: str = "",
    group: Any = None,
) -> None:
    """Adds an option for each field of a model; its help is the field's docstring, unless `help_texts` has one."""
    kinds = {name: _listed(kind) for name, kind in get_type_hints(model).items()} | dict(hints or {})
    for name, field in model.model_fields.items():
        if name in skip:
            continue
        value = (defaults or {}).get(name, field.get_default(call_default_factory=True))
        help_text = (help_texts or {}).get(name) or field.description or f"The field {name} of {model.__name__}."
        command.add(f"{prefix}{name}", kinds[name], value, help_text, group)


def _listed(kind: Any) -> Any:
    """The type itself, or a list of texts in place of a tuple of texts."""
    return list[str] if kind == tuple[str, ...] else kind


Asked = Annotated[Given, experiment]
OfPaths = Annotated[Given, partial(experiment, skip=("noise", "measure_error", "split"))]
OfPlan = Annotated[Given, partial(experiment, skip=("measure_error", "split"))]
OfCompare = Annotated[Given, partial(experiment, skip=("method", "tolerance_db", "measure_error"))]
OfSweep = Annotated[Given, partial(experiment, skip=("measure_error", "memory_gb"))]
OfScene = Annotated[Given, radar]
OfSceneFile = Annotated[Given, of_scene]


@dataclass(frozen=True, slots=True)
class Job:
    """What is to be simulated or planned."""

    experiment: Experiment | Recording
    accuracy: Given
    """Fields of `Accuracy` that were given."""
    run: Given
    """Options of `RUN` that were given."""

    @classmethod
    def of(cls, source: str, given: Given) -> Job:
        """A job from a motion file and the options that describe an experiment, or from an experiment (.yaml) or a recording
        (.zarr)."""
        from t2d_rt.experiment.experiment import Experiment
        from t2d_rt.recording.recording import Recording

        path = Path(source)
        accuracy, run = given.get("accuracy", {}), {name: given[name] for name in RUN if name in given}
        if not is_experiment(path):
            return cls(Experiment(**fields_of(source, _beside_run(given))), accuracy, run)
        if path.suffix.lower() == ".zarr":
            _check_no_more(path, given)
            return cls(Recording.load(path), accuracy, run)
        return cls.of_values(experiment_values(path), path, given)

    @classmethod
    def of_values(cls, values: Given, path: Path, given: Given) -> Job:
        """A job from what an experiment's file holds, and from options of the accuracy and the run."""
        from t2d_rt.experiment.experiment import Experiment

        _check_no_more(path, given)
        values = dict(values)
        accuracy, run = given.get("accuracy", {}), {name: given[name] for name in RUN if name in given}
        stored = {name: values.pop(name) for name in ("accuracy", "tolerance_db") if values.get(name) is not None}
        accuracy = {**stored.pop("accuracy", {}), **accuracy}
        values.pop("accuracy", None), values.pop("tolerance_db", None)
        return cls(Experiment.read(values, path), accuracy, {**stored, **run})


def _beside_run(given: Given) -> Given:
    """Those of the given options that belong to an experiment."""
    return {name: value for name, value in given.items() if name not in (*RUN, "accuracy")}


def _check_no_more(path: Path, given: Given) -> None:
    """Refuses options of an experiment that are given beside an experiment's file or a recording."""
    for name, value in _beside_run(given).items():
        option = f"{name}.{next(iter(value))}" if isinstance(value, dict) else name
        if path.suffix.lower() == ".zarr":
            reason = f"is part of the recording {path.name}, which is simulated again as it was"
            raise InputError(f"option {option} {reason}; simulate its motion file with it, or see t2d-rt sweep --vary")
        raise InputError(f"option {option} is part of the experiment {path.name}; change it there")


def experiment_values(path: Path) -> Given:
    """What the file of an experiment holds; raises InputError for the file of a radar or of options."""
    values = read_yaml(path, noun="experiment", example="targets, radar and scene")
    if (kind := yaml_kind(values)) in ("radar", "options"):
        content = "the fields of a radar" if kind == "radar" else "options of the command line"
        option = "radar" if kind == "radar" else "config"
        raise InputError(f"{path} holds {content} and is no experiment; give it as --{option} {path}")
    return values


def is_experiment(source: Path) -> bool:
    """Whether a file is an experiment or a recording, not a motion."""
    return source.suffix.lower() in (".yaml", ".yml", ".zarr")


def fields_of(source: str, given: Given) -> Given:
    """Fields of the experiment that simulates a motion file with these options."""
    from t2d_rt.experiment.sources import MotionFile

    given = dict(given)
    reading_options = given.pop("motion", {})
    first_target = {
        "kind": "file",
        "file": source,
        "subject": reading_options.pop("subject", None),
        "reading": reading_options,
    }
    first_target |= {name: given.pop(name) for name in MotionFile.model_fields if name in given}
    for option in [name for name in OF_SCENE if name in given]:
        if "scene" not in given:
            raise InputError(
                f"--{option.replace('_', '-')} is of a scene and there is none; give --scene, or leave it out"
            )
    options = scene_options(given)
    given = {name: value for name, value in given.items() if name not in OF_SCENE}
    if options:
        given["scene"] = {"file": given["scene"], **options}
    targets = [first_target, *map(target_of, given.pop("add", ()))]
    return {**given, "targets": targets, "radar": radar_of(given)}


def radar_of(given: Given) -> Radar:
    """The radar that the options describe; table2 where none is given."""
    from t2d_rt.types import Radar

    return Radar.preset("table2", **given.get("radar", {}))


def target_of(entry: str | Mapping[str, Any]) -> Mover | MotionFile | None:
    """The target that an entry of --add names, a mover or a further person; None where the entry is "none"."""
    from t2d_rt.experiment.sources import MotionFile
    from t2d_rt.scene.movers import mover, parsed, with_words

    if entry == "none":
        return None
    if not isinstance(entry, str):
        if entry.get("kind") != "person":
            return mover(entry)
        return MotionFile(**{str(key): value for key, value in entry.items() if key != "kind"})
    kind, _, rest = entry.partition(":")
    if kind.strip() != "person":
        return mover(entry)
    words = rest.split(",")
    _, _, fields = parsed(f"person:{','.join(word for word in words if FIELD.match(word))}")
    # All words that give no field are the file's name: names may hold commas and spaces.
    file = ",".join(word for word in words if not FIELD.match(word)).strip()
    return MotionFile(**with_words(entry, "file", file, fields))


def scene_options(given: Given) -> Given:
    """The given options of a scene beside its file, by the names that `load_scene` has for them."""
    materials: dict[str, str] = {}
    for substitution in (word for text in given.get("scene_material") or () for word in text.split(",")):
        name, _, substitute = (part.strip() for part in substitution.partition("="))
        if not name or not substitute:
            advice = f"must name a material and its substitute, as brick=concrete, got {shown(substitution)}"
            raise InputError(f"option scene-material {advice}")
        materials[name] = substitute
    mesh = {name: given[f"scene_{name}"] for name in ("units", "up") if given.get(f"scene_{name}") is not None}
    return ({"materials": materials} if materials else {}) | mesh
