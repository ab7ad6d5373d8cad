"""`plan`: what a simulation would model, leave out, take and cost, before anything is refined or summed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from t2d_rt.accuracy.cost import predicted_bytes, refuse
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.wanted import Wanted, chosen
from t2d_rt.core.backend import recent_yardstick_s
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import LIMIT_GB, after_call
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up
from t2d_rt.pipeline.targets import TargetLike


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
    physics = {
        name: field.default for name, field in Experiment.model_fields.items() if name not in ("targets", "radar")
    }
    known = physics | {
        "radar": None, "accuracy": None, "tolerance_db": None, "measure_error": None, "device": "auto", "memory_gb": LIMIT_GB,
        "progress": None,
    }  # fmt: skip
    unknown = [name for name in options if name not in known]
    if unknown:
        raise InputError(f"unknown option {unknown[0]!r} of plan; choose from {', '.join(known)}")
    targets: Any = target
    if isinstance(target, Experiment):
        fixed = [name for name in options if name in physics or name == "radar"]
        if fixed:
            raise InputError(f"option {fixed[0]} is part of the experiment; change it there")
        targets = target.targets_from({})
        known |= {**target.physics, "radar": target.radar, "scene": target.scene_from({})}
    given = known | options
    wanted = Wanted.of(given["accuracy"], tolerance_db, given["measure_error"])
    physics = {name: given[name] for name in physics if name != "scene"}
    begin = time.perf_counter()
    setup = set_up(
        targets, given["radar"], given["scene"], physics, device=given["device"], memory_gb=given["memory_gb"]
    )
    ready = time.perf_counter()
    found = chosen(setup.model, wanted)
    took = time.perf_counter()
    budget = found.budget
    running = budget.seconds(found.accuracy, clutter=setup.experiment.clutter) * recent_yardstick_s(setup.model.backend)
    seconds = {"preparing": ready - begin, "planning": took - ready, "running": running}
    memory = predicted_bytes(budget.model, found.accuracy, budget.counts, measured=wanted.measured)
    refuse(budget.model, memory, measured=wanted.measured)
    after_call()
    return replace(found, seconds=seconds, memory_bytes=memory)
