"""What it takes to make a recording again, or to run an experiment for the first time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from t2d_rt.core.checks import instance
from t2d_rt.core.errors import warn
from t2d_rt.core.stored_arrays import Inputs
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import repeatable
from t2d_rt.pipeline.prepare import plugin_finders
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Accuracy

KNOWN = "error_db", "error_scatter_db", "error_chirps", "tolerance_db"
"""Settings of a recording that hold for the same one made again."""


def again(
    experiment: Experiment | Recording, accuracy: Accuracy | Mapping[str, Any] | None, tolerance_db: float | None
) -> tuple[Experiment, Inputs, Accuracy | Mapping[str, Any] | None, dict[str, Any]]:
    """What is to be run: the experiment, its arrays, its accuracy, and what is known of the recording beforehand."""
    instance("experiment", experiment, (Experiment, Recording), "an Experiment or a Recording")
    if isinstance(experiment, Experiment):
        return experiment, {}, accuracy, {}
    recording, made = experiment, repeatable(experiment.experiment)
    then, now = recording.settings.get("scatterers", []), sorted(plugin_finders())
    if then != now:
        had, have = (", ".join(names) or "none" for names in (then, now))
        warn(
            f"the recording was made with these scatterers of other packages: {had}; there are now: {have}, so its samples differ; "
            "install or uninstall these packages"
        )
    if accuracy is not None or tolerance_db is not None:
        return made, recording.inputs, accuracy, {}
    known: dict[str, Any] = {name: recording.settings[name] for name in KNOWN if name in recording.settings}
    return made, recording.inputs, recording.accuracy, known
