"""The model of a target, at which fields of any accuracy can be asked for."""

from __future__ import annotations

from typing import Any

from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up
from t2d_rt.pipeline.echo_model import Model


def modelled(target: Any, scene: str = "free_space", **physics: Any) -> Model:
    """The model of a target at hand, as `simulate` has it."""
    options = {"clutter": "none", "collisions": "ignore", **physics}
    return set_up(target, scene, Experiment.without_targets(**options)).model
