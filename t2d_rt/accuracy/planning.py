"""`plan`: what a simulation would model, leave out, take and cost, before anything is refined or summed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from t2d_rt.accuracy.cost import predicted_bytes, refuse
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.search import warn_out_of_reach
from t2d_rt.accuracy.wanted import Wanted, chosen
from t2d_rt.core.backend import recent_yardstick_s
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import after_call
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up, set_up_stored
from t2d_rt.pipeline.targets import TargetLike

MACHINE = "device", "memory_gb"
"""Options of the machine, which `set_up` takes."""


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
    known = [*physics, "radar", "accuracy", "tolerance_db", "measure_error", *MACHINE, "progress"]
    unknown = [name for name in options if name not in known]
    if unknown:
        raise InputError(f"unknown option {unknown[0]!r} of plan; choose from {', '.join(known)}")
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
    found = chosen(setup.model, wanted)
    warn_out_of_reach(found)
    took = time.perf_counter()
    budget = found.budget
    running = budget.seconds(found.accuracy, clutter=setup.experiment.clutter) * recent_yardstick_s(setup.model.backend)
    seconds = {"preparing": ready - begin, "planning": took - ready, "running": running}
    memory = predicted_bytes(budget.model, found.accuracy, budget.counts, measured=wanted.measured)
    refuse(budget.model, memory, measured=wanted.measured)
    after_call()
    return replace(found, seconds=seconds, memory_bytes=memory)
