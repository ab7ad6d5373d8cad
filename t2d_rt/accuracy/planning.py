"""From the accuracy or tolerance that a user asks for to the settings of a run; `plan` shows them, and what they cost, before a
run."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from t2d_rt.accuracy.budget import ErrorBudget
from t2d_rt.accuracy.cost import predicted_bytes, refuse
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.search import as_given, check_tolerance, planned, warn_out_of_reach
from t2d_rt.core.backend import recent_yardstick_s
from t2d_rt.core.checks import flag, shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import after_call
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up, set_up_stored
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.pipeline.targets import TargetLike
from t2d_rt.types import Accuracy

MACHINE = "device", "memory_gb"
"""Options of `simulate` that concern the machine, not the experiment; `set_up` takes them."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """The accuracy that a user asks for: settings, a tolerance, or both."""

    given: Accuracy
    """Its fields that are set are kept; with a tolerance all others are chosen."""
    tolerance_db: float | None
    """Greatest field error [dB]; None where the given accuracy is used as it is."""
    measured: bool
    """Whether the error is measured after the run."""
    factored: bool = False
    """Whether the cube stores factors (`ProductRows`), from which samples are computed only when they are read."""

    @classmethod
    def of(
        cls,
        accuracy: Accuracy | Mapping[str, Any] | None,
        tolerance_db: float | None,
        measure_error: bool | None = None,
    ) -> Wanted:
        """Checks the options of `simulate` of these names and returns them as one value."""
        if measure_error is not None:
            flag("measure_error", measure_error)
        if tolerance_db is not None:
            check_tolerance(tolerance_db)
        return cls(
            checked_accuracy(accuracy),
            tolerance_db,
            tolerance_db is not None if measure_error is None else measure_error,
        )


def checked_accuracy(accuracy: Accuracy | Mapping[str, Any] | None) -> Accuracy:
    """An `Accuracy` from one, from a mapping of its fields, or the default one for None."""
    if accuracy is None:
        return Accuracy()
    if isinstance(accuracy, Accuracy):
        return accuracy
    if not isinstance(accuracy, Mapping):
        raise InputError(
            f"accuracy must be an Accuracy or a mapping of its fields, got {shown(accuracy)}; {{'sagitta_rad': 0.2}} is one"
        )
    return Accuracy.model_validate(accuracy)


def chosen(model: Model, wanted: Wanted) -> Plan:
    """The plan that keeps to the tolerance, or that of the given accuracy where there is no tolerance. It is made for all path
    pairs, including those that `only_paths` and `without_paths` leave out."""
    if wanted.tolerance_db is None:
        return Plan(ErrorBudget(as_given(model, wanted.given), wanted.given), None, wanted.given)
    return planned(model, wanted.tolerance_db, wanted.given)


def plan(
    target: TargetLike | str | Path | Sequence[TargetLike | str | Path] | Experiment,
    *,
    tolerance_db: float = -20.0,
    **options: Any,
) -> Plan:
    """What `simulate` with these `options` would model and leave out to keep to a tolerance, and what that costs; predicted by
    fitted laws, without a trial run. An `Experiment` has its own physics, as for `run`.

    The plan's `accuracy` serves similar recordings, too: `simulate(other, accuracy=plan.accuracy)`.
    """
    physics = [name for name in Experiment.model_fields if name not in ("targets", "radar")]
    option_names = [*physics, "radar", "accuracy", "tolerance_db", "measure_error", *MACHINE, "progress"]
    unknown = [name for name in options if name not in option_names]
    if unknown:
        raise InputError(f"unknown option {unknown[0]!r} of plan; choose from {', '.join(option_names)}")
    machine = {name: options.pop(name) for name in MACHINE if name in options}
    wanted = Wanted.of(options.pop("accuracy", None), tolerance_db, options.pop("measure_error", None))
    options.pop("progress", None)
    begin = time.perf_counter()
    if isinstance(target, Experiment):
        if options:
            raise InputError(f"option {next(iter(options))} is part of the experiment; change it there")
        setup = set_up_stored(target, {}, **machine)
    else:
        scene = options.pop("scene", "free_space")
        setup = set_up(target, scene, Experiment.without_targets(**options), **machine)
    ready = time.perf_counter()
    chosen_plan = chosen(setup.model, wanted)
    warn_out_of_reach(chosen_plan)
    took = time.perf_counter()
    budget = chosen_plan.budget
    running = budget.seconds(chosen_plan.accuracy, clutter=setup.experiment.clutter) * recent_yardstick_s(
        setup.model.backend
    )
    seconds = {"preparing": ready - begin, "planning": took - ready, "running": running}
    memory = predicted_bytes(budget.model, chosen_plan.accuracy, budget.counts, measured=wanted.measured)
    refuse(budget.model, memory, measured=wanted.measured)
    after_call()
    return replace(chosen_plan, seconds=seconds, memory_bytes=memory)
