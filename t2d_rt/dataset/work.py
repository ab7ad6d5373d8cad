"""What a worker does: samples by their indices, from the motion to the arrays that a shard holds."""

from __future__ import annotations

import functools
import gc
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from t2d_rt.core.backend import limited_threads, one_blas_thread
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.core.memory import keep_freed, release_above
from t2d_rt.dataset.motions import provenance
from t2d_rt.dataset.products import record_length_s
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.sample import Cell, Sample, cell_of, description_of, sample
from t2d_rt.dataset.view import view
from t2d_rt.experiment.sources import MotionText
from t2d_rt.simulate import run
from t2d_rt.types import Accuracy

HELD_BYTES = 0.8e9
"""What a worker may hold between two samples before it gives back what nothing uses; a sample in a room takes another gigabyte."""

MOST_GROWTH_BYTES = 0.8e9
"""A worker that has grown by more since its first samples leaks memory. By itself loky takes 0.3 GB for a leak: samples of unlike
size differ by as much, and a worker in place of another begins with nothing loaded."""

Plans = Mapping[str, Accuracy]
"""Accuracies of groups of samples by their names."""


@dataclass(frozen=True, slots=True)
class Made:
    """A sample that was made, or failed."""

    record: dict[str, Any]
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Time of each stage, and in all that of the processor, `cpu`."""


def group_of(cell: Cell) -> str:
    """The samples that share a plan."""
    return f"{cell.activity}/{cell.condition.name}"


def accuracy_of(cell: Cell, plans: Plans) -> Accuracy | None:
    """How finely a sample is modelled; None by default."""
    return plans[group_of(cell)] if cell.condition.tolerance_db is not None else cell.condition.accuracy


def make_samples(recipe_json: str, plans_json: Mapping[str, str], indices: Sequence[int], threads: int) -> list[Made]:
    """Samples of a recipe; the work of one call in a worker, whose values travel as plain text."""
    keep_freed()
    recipe = _recipe(recipe_json)
    plans = {name: Accuracy.model_validate_json(text) for name, text in plans_json.items()}
    with limited_threads(threads):
        return [make_sample(recipe, plans, index) for index in indices]


def make_samples_in_worker(*task: Any) -> list[Made]:
    """`make_samples` in a process of its own."""
    made = make_samples(*task)
    _settle()
    return made


@functools.cache
def _settle() -> None:
    """Done once, after a worker's first samples. The garbage collector leaves out what is loaded by then, which saves 2 % of a
    sample's time, and loky, which replaces workers that grow, lets them grow by `MOST_GROWTH_BYTES` first."""
    from joblib.externals.loky import process_executor

    gc.collect()
    gc.freeze()
    if hasattr(process_executor, "_MAX_MEMORY_LEAK_SIZE"):
        process_executor._MAX_MEMORY_LEAK_SIZE = int(MOST_GROWTH_BYTES)


@functools.lru_cache(maxsize=2)
def _recipe(text: str) -> Recipe:
    return Recipe.model_validate_json(text)


@one_blas_thread
def make_sample(recipe: Recipe, plans: Plans, index: int) -> Made:
    """One sample; what goes wrong becomes the reason in its record."""
    try:
        return _made(recipe, plans, index)
    finally:
        release_above(HELD_BYTES)


def _made(recipe: Recipe, plans: Plans, index: int) -> Made:
    cell = cell_of(recipe, index)
    wanted = description_of(recipe, cell)
    record: dict[str, Any] = {
        "index": index, "class": cell.activity, "description": cell.description, "repetition": cell.repetition,
        "motion": cell.number, "condition": cell.condition.name, "sentence": wanted.sentence,
        "slots": wanted.model_dump(mode="json", by_alias=True, exclude={"sentence", "activity"}, exclude_none=True),
    }  # fmt: skip
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", T2DWarning)
        try:
            begin, cpu = time.perf_counter(), time.process_time()
            found = sample(recipe, index)
            moved = time.perf_counter()
            record |= _described(found)
            arrays, told_of, seconds = _recorded(recipe, found, accuracy_of(cell, plans))
        except (MemoryError, KeyboardInterrupt):
            raise
        except Exception as error:  # one sample's failure is no reason to lose the others
            reason = " ".join(str(error).split())
            if not isinstance(error, InputError):
                reason = f"{type(error).__name__}: {reason}"
            return Made(record | {"failure": reason})
    record |= told_of
    record["warnings"] = sorted({str(each.message) for each in told if issubclass(each.category, T2DWarning)})
    return Made(
        record | {"failure": None}, arrays, {"motion": moved - begin, **seconds, "cpu": time.process_time() - cpu}
    )


def _described(found: Sample) -> dict[str, Any]:
    """What a record tells of a sample before it is simulated."""
    source, place = found.cut.source, found.place
    return {
        "provider": source.provider, "body": found.experiment.body, "stature_m": source.stature_m, "seed": source.seed,
        "gait_factor": source.gait_factor, "angle_deg": place.angle_deg, "distance_m": place.distance_m,
        "aside_m": place.aside_m, "height_m": place.height_m, "overlap_m": place.overlap_m,
        **provenance(found.cut), "second_person": _second_person(found), "experiment": found.experiment.hash,
    }  # fmt: skip


def _second_person(found: Sample) -> dict[str, Any] | None:
    """What a record tells of a person beside the one who is labelled: sentence, seed, and clips."""
    others = [each for each in found.experiment.targets[1:] if isinstance(each, MotionText)]
    if not others:
        return None
    return {"sentence": others[0].text, "seed": others[0].seed, "sources": list(others[0].made().origin)}


def _recorded(
    recipe: Recipe, found: Sample, accuracy: Accuracy | None
) -> tuple[dict[str, np.ndarray], dict[str, Any], dict[str, float]]:
    """Arrays of a sample, what its record tells of them, and the time that it took."""
    begin = time.perf_counter()
    recording = run(found.experiment, accuracy, measure_error=found.measured, device="cpu")
    simulated = time.perf_counter()
    arrays, products = recipe.products.made(recording, view(recording, recipe, found.cell.index))
    record = {
        "duration_s": round(record_length_s(recording), 9),
        "error_db": None if recording.error_db is None else round(recording.error_db, 3),
        "snr_db": None if recording.snr_db is None else round(recording.snr_db, 3),
        "products": products,
    }
    return arrays, record, {"simulation": simulated - begin, "products": time.perf_counter() - simulated}
