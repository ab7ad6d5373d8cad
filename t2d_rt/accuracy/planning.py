"""`plan`: what a simulation would model, leave out, take and cost, before it is run."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from t2d_rt.accuracy.budget import Plan, Wanted, planned
from t2d_rt.accuracy.cost import check_memory
from t2d_rt.accuracy.estimate import converged
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.experiment import Experiment
from t2d_rt.memory import LIMIT_GB, after_call
from t2d_rt.room import Clutter
from t2d_rt.signal import spectrogram
from t2d_rt.stage import set_up
from t2d_rt.summation import summed
from t2d_rt.targets import TargetLike

T = TypeVar("T")

PILOT_S = 0.5, 2.0
"""Lengths of the pieces that a plan tries."""


def plan(
    target: TargetLike | str | Path | Sequence[TargetLike | str | Path], *, tolerance_db: float = -20.0, **options: Any
) -> Plan:
    """What `simulate` would model with these `options` of its own to keep to a tolerance, what it would leave out and what that
    costs."""
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
    given = known | options
    wanted = Wanted.of(given["accuracy"], tolerance_db, given["measure_error"])
    device, physics = given["device"], {name: given[name] for name in physics if name != "scene"}
    stage, preparing = _timed(
        lambda: set_up(target, given["radar"], given["scene"], physics, device=device, memory_gb=given["memory_gb"])
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)
        planned(stage.model, tolerance_db, wanted.given)  # compiles kernels
    found, planning = _timed(lambda: planned(stage.model, tolerance_db, wanted.given))
    model, accuracy, clutter = found.model, found.accuracy, stage.experiment.clutter
    # Rates of the whole record, before pieces are tried.
    model.frame_times(accuracy), model.fast_rotating(accuracy)
    static, _ = model.clutter(clutter, accuracy)
    memory = check_memory(model, [*model.streams(accuracy), *static], measured=wanted.measured)
    del static
    whole_s = model.span_s[1] - model.span_s[0]
    lengths = sorted({min(length, whole_s) for length in PILOT_S})
    _, *taken = (_tried(found, length, clutter, device) for length in (lengths[-1], *lengths))  # the first one compiles
    per_second = max(0.0, taken[-1] - taken[0]) / (lengths[-1] - lengths[0]) if len(lengths) > 1 else 0.0
    running = taken[-1] + per_second * (whole_s - lengths[-1])
    for _ in range(2):  # the first one compiles
        _, measuring = _timed(lambda: converged(model, accuracy, found.error_db, hidden=found.hidden))
    seconds = {"preparing": preparing, "planning": planning, "running": running, "measuring": measuring}
    after_call()
    return replace(found, seconds=seconds, memory_bytes=memory)


def _tried(found: Plan, length_s: float, clutter: Clutter, device: Any) -> float:
    """What a piece of that length in the middle of the record takes with its spectrogram [s]."""
    start, stop = found.model.span_s
    middle = (start + stop - length_s) / 2
    model, accuracy = replace(found.model, span_s=(middle, middle + length_s)), found.accuracy

    def run() -> None:
        static, _ = model.clutter(clutter, accuracy)
        cube = summed(model.streams(accuracy), static, model.radar, accuracy, device=device, memory=model.memory)
        spectrogram(cube, model.radar, mti="mean" if static else "none")

    return _timed(run)[1]


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """What it gives, and how long it takes [s]."""
    begin = time.perf_counter()
    return work(), time.perf_counter() - begin
