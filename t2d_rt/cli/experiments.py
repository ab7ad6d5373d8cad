"""Simulations of experiments in YAML, and of recordings again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.accuracy import Plan
    from t2d_rt.recording.recording import Recording

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
