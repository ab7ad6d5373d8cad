"""Work of a worker process: makes samples from their indices, from the motion to the arrays of a shard; and makes plans for
tolerances.

A plan is made for each class and condition with a tolerance, for the first sample of that group, and used for the whole group.
"""

from __future__ import annotations

import functools
import gc
import json
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.accuracy import plan
from t2d_rt.core.backend import limited_threads, one_blas_thread
from t2d_rt.core.errors import InputError, T2DError, T2DWarning
from t2d_rt.core.kernels import has_common_kernels, machine
from t2d_rt.core.memory import keep_freed, release_above
from t2d_rt.dataset.products import SpectrogramPower, parts_of, record_length_s
from t2d_rt.dataset.recipe import Recipe, integer_seed
from t2d_rt.dataset.sample import Cell, Sample, cell_of, description_of, provenance, range_gate, sample
from t2d_rt.dataset.shards import MadeSample, write_whole
from t2d_rt.experiment.sources import MotionText
from t2d_rt.noise.masks import occlude
from t2d_rt.recording.maps import background, background_settings
from t2d_rt.recording.recording import Recording
from t2d_rt.simulate import run, run_gated
from t2d_rt.types import Accuracy


def view(
    recording: Recording, recipe: Recipe, index: int, range_gate_m: tuple[float, float] | None = None
) -> SpectrogramPower | None:
    """The spectrogram of a sample by its index and its range gate, with its background and its occluded windows; None where the
    recipe keeps none.

    A background is added as power, in which echoes and noise add up in the mean (`add_background`).
    Raises InputError where occluded windows leave nothing of the record.
    """
    spectrogram = recipe.products.spectrogram
    if spectrogram is None:
        return None
    recording = recording.processed(mti=spectrogram.mti, range_gate_m=range_gate_m)
    image = recording.spectrogram
    velocity, time_s = image.velocity_mps.values, image.time_s.values
    power = _power(image.values)
    parts = {} if recipe.products.parts is None else parts_of(recording, recipe.products.parts.split)
    added: np.ndarray | None = None
    details: dict[str, Any] = {} if range_gate_m is None else {"range_gate_m": list(range_gate_m)}
    if recipe.background is not None:
        seed = integer_seed(recipe.seeds(index, "background"))
        settings = background_settings(
            recipe.background,
            seed=seed,
            level_db=recipe.background_level_db,
            noisy=recording.noise_dbm is not None,
            carrier_hz=recording.radar.carrier_hz,
        )
        added = background(velocity, time_s, settings).power_w(settings["level_db"]).astype(np.float64)
        power = power + added
        parts |= {"background": added}
        details["background"] = settings
    if recipe.masks is not None:
        occluded = occlude(
            power,
            time_s,
            recipe.masks,
            seed=integer_seed(recipe.seeds(index, "masks")),
            fill="zeros" if added is None else "background",
            background_power=added,
        )
        if added is None and occluded.columns.all():
            raise InputError(
                "occluded windows cover the whole record and there is no background to show; give the recipe a background, or "
                "fewer or shorter windows"
            )
        power = occluded.power
        parts = {
            name: part if name == "background" else np.where(occluded.columns, 0.0, part)
            for name, part in parts.items()
        }
        details["masks_s"] = np.round(occluded.windows_s, 6).tolist()
    return SpectrogramPower(power, velocity, time_s, parts, details)


def _power(level_db: np.ndarray) -> np.ndarray:
    """Powers [W] of levels [dB re 1 W], in double precision."""
    return np.asarray(10.0 ** (level_db.astype(np.float64) / 10.0))


HELD_BYTES = 0.8e9
"""Memory that a worker may hold between two samples before it returns unused memory [bytes]; a sample in a room takes another
gigabyte."""

MOST_GROWTH_BYTES = 0.8e9
"""Growth of a worker's memory after its first samples that counts as a leak [bytes]. By default loky takes 0.3 GB for a leak, but
samples of different size differ by as much, and replacing a worker means loading everything again."""

Plans = Mapping[str, Accuracy]
"""Accuracies of groups of samples, by the name of the group."""


def group_of(cell: Cell) -> str:
    """Name of the group of samples that share a plan."""
    return f"{cell.activity}/{cell.condition.name}"


def accuracy_of(cell: Cell, plans: Plans) -> Accuracy | None:
    """The accuracy with which a sample is modelled; None for the default."""
    return plans[group_of(cell)] if cell.condition.tolerance_db is not None else cell.condition.accuracy


def make_samples(
    recipe_json: str, plans_json: Mapping[str, str], indices: Sequence[int], threads: int
) -> list[MadeSample]:
    """Makes samples of a recipe: the work of a single call in a worker. Arguments are plain text, as they are sent between
    processes."""
    keep_freed()
    recipe = _recipe(recipe_json)
    plans = {name: Accuracy.model_validate_json(text) for name, text in plans_json.items()}
    machine_name, common = machine(), has_common_kernels()
    with limited_threads(threads):
        return [replace(make_sample(recipe, plans, index), machine=machine_name, common=common) for index in indices]


def in_worker(work: Callable[..., Any], *task: Any) -> Any:
    """Calls `make_samples` or `make_plan` in a worker process."""
    result = work(*task)
    _settle()
    return result


@functools.cache
def _settle() -> None:
    """Called once, after a worker's first call. Excludes everything loaded by then from garbage collection, which saves 2 % of a
    sample's time, and lets loky, which replaces workers that grow, tolerate a growth of `MOST_GROWTH_BYTES`."""
    from joblib.externals.loky import process_executor

    gc.collect()
    gc.freeze()
    if hasattr(process_executor, "_MAX_MEMORY_LEAK_SIZE"):
        process_executor._MAX_MEMORY_LEAK_SIZE = int(MOST_GROWTH_BYTES)


@functools.lru_cache(maxsize=2)
def _recipe(text: str) -> Recipe:
    """A recipe from its text; cached, as a worker gets the same one with each call."""
    return Recipe.model_validate_json(text)


@one_blas_thread
def make_sample(recipe: Recipe, plans: Plans, index: int) -> MadeSample:
    """Makes one sample; an error becomes the reason in its record."""
    try:
        return _made(recipe, plans, index)
    finally:
        release_above(HELD_BYTES)


def _made(recipe: Recipe, plans: Plans, index: int) -> MadeSample:
    """The steps of `make_sample`: motion, simulation, products, and their record."""
    cell = cell_of(recipe, index)
    description = description_of(recipe, cell)
    record: dict[str, Any] = {
        "index": index,
        "class": cell.activity,
        "description": cell.description,
        "repetition": cell.repetition,
        "motion": cell.number,
        "condition": cell.condition.name,
        "sentence": description.sentence,
        "slots": description.model_dump(
            mode="json", by_alias=True, exclude={"sentence", "activity"}, exclude_none=True
        ),
    }
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", T2DWarning)
        try:
            begin, cpu = time.perf_counter(), time.process_time()
            drawn = sample(recipe, index)
            motion_end = time.perf_counter()
            record |= _described(drawn)
            arrays, entries, seconds = _recorded(recipe, drawn, accuracy_of(cell, plans))
        except (MemoryError, KeyboardInterrupt):
            raise
        except Exception as error:  # the failure of one sample must not cost the others
            reason = " ".join(str(error).split())
            if not isinstance(error, InputError):
                reason = f"{type(error).__name__}: {reason}"
            return MadeSample(record | {"failure": reason})
    record |= entries
    record["warnings"] = sorted(
        {str(warning.message) for warning in caught if issubclass(warning.category, T2DWarning)}
    )
    return MadeSample(
        record | {"failure": None}, arrays, {"motion": motion_end - begin, **seconds, "cpu": time.process_time() - cpu}
    )


def _described(drawn: Sample) -> dict[str, Any]:
    """Fields of a sample's record that are known before it is simulated."""
    source = drawn.cut.source
    return {
        "provider": source.provider,
        "subject": drawn.subject,
        "body": drawn.experiment.body,
        "stature_m": source.stature_m,
        "seed": source.seed,
        "gait_factor": source.gait_factor,
        **asdict(drawn.place),
        **provenance(drawn.cut),
        "second_person": _second_person(drawn),
        "activities": [[name, round(begin_s, 6)] for name, begin_s in drawn.cut.motion.activities],
        "breathing": None if (breathing := drawn.cut.motion.breathing) is None else asdict(breathing),
        "experiment": drawn.experiment.hash,
    }


def _second_person(drawn: Sample) -> dict[str, Any] | None:
    """Fields of the record about a second person: sentence, seed, and clips; None where there is none."""
    others = [target for target in drawn.experiment.targets[1:] if isinstance(target, MotionText)]
    if not others:
        return None
    return {"sentence": others[0].text, "seed": others[0].seed, "sources": list(others[0].made().origin)}


def _recorded(
    recipe: Recipe, drawn: Sample, accuracy: Accuracy | None
) -> tuple[dict[str, np.ndarray], dict[str, Any], dict[str, float]]:
    """Arrays of a sample, the fields of its record about them, and the time [s] of each stage."""
    begin = time.perf_counter()
    parts = recipe.products.parts
    split = None if parts is None else parts.split
    gate_m = range_gate(recipe, drawn)
    if gate_m is None or recipe.products.needs_samples or drawn.experiment.radar.multiplexing == "ddm":
        recording = run(drawn.experiment, accuracy, measure_error=drawn.measured, split=split, device="cpu")
    else:
        recording = run_gated(drawn.experiment, accuracy, gate_m, measure_error=drawn.measured, device="cpu")
    simulated = time.perf_counter()
    arrays, products = recipe.products.made(recording, view(recording, recipe, drawn.cell.index, gate_m))
    record = {
        "duration_s": round(record_length_s(recording), 9),
        "error_db": None if recording.error_db is None else round(recording.error_db, 3),
        "snr_db": None if recording.snr_db is None else round(recording.snr_db, 3),
        "products": products,
    }
    return arrays, record, {"simulation": simulated - begin, "products": time.perf_counter() - simulated}


PLANNED = 20
"""Greatest number of samples of a group that are tried for its plan; the first that can be planned gives it."""


def groups(recipe: Recipe, count: int, *, only: str | None = None) -> dict[str, list[int]]:
    """Indices of the first few samples of each group whose condition has a tolerance, among the first `count`; of one group only if
    `only` names it."""
    indices_by_group: dict[str, list[int]] = {}
    for index in range(count):
        cell = cell_of(recipe, index)
        if cell.condition.tolerance_db is not None and only in (None, group_of(cell)):
            indices_by_group.setdefault(group_of(cell), [])
            if len(indices_by_group[group_of(cell)]) < PLANNED:
                indices_by_group[group_of(cell)].append(index)
    return indices_by_group


def make_plans(
    recipe: Recipe, path: Path, count: int, threads: int, take_up: Callable[..., Iterable[tuple[str, str]]]
) -> dict[str, str]:
    """Accuracies of the groups as JSON: those that the file at `path` already holds, and the others, which the scheduler `take_up`
    makes, as it makes samples, and which are added to the file."""
    accuracies, text = read_plans(path), recipe.model_dump_json()
    tasks = [
        (text, name, indices, threads) for name, indices in groups(recipe, count).items() if name not in accuracies
    ]
    if tasks or not path.exists():
        new_plans = take_up(make_plan, tasks) if tasks else ()
        accuracies = dict(
            sorted(
                {
                    **accuracies,
                    **{name: Accuracy.model_validate_json(accuracy_json) for name, accuracy_json in new_plans},
                }.items()
            )
        )
        values = {name: accuracy.model_dump(mode="json") for name, accuracy in accuracies.items()}
        write_whole(path, (json.dumps(values, indent=1) + "\n").encode())
    return {name: accuracy.model_dump_json() for name, accuracy in accuracies.items()}


def make_plan(recipe_json: str, name: str, indices: list[int], threads: int) -> tuple[str, str]:
    """Name and accuracy of a group, as text: the work of a single call in a worker."""
    with limited_threads(threads):
        return name, plan_of(_recipe(recipe_json), indices).model_dump_json()


def read_plans(path: Path) -> dict[str, Accuracy]:
    """The accuracies in a file; none if it does not exist."""
    if not path.exists():
        return {}
    try:
        return {name: Accuracy.model_validate(values) for name, values in json.loads(path.read_bytes()).items()}
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} cannot be read ({error}); remove it and run the recipe again") from None


@one_blas_thread
def plan_of(recipe: Recipe, indices: list[int]) -> Accuracy:
    """The accuracy that keeps a group's tolerance: that of the first of its samples that can be planned."""
    failure: T2DError | None = None
    for index in indices:
        try:
            drawn = sample(recipe, index)
            condition = drawn.cell.condition
            assert condition.tolerance_db is not None, "groups have a tolerance"
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", T2DWarning)  # the sample's record will have them
                return plan(
                    drawn.experiment, tolerance_db=condition.tolerance_db, accuracy=condition.accuracy, device="cpu"
                ).accuracy
        except T2DError as error:
            failure = failure or error
    assert failure is not None, "a group has samples"
    raise failure


def shown_sample(recipe: Recipe, index: int, take_up: Callable[..., Iterable[tuple[str, str]]]) -> str:
    """Text that `t2d-rt simulate` takes: the experiment of a sample, and its accuracy where it is not the default.

    take_up: makes the plan of its group, where the plans of a data set are made.
    """
    import yaml

    drawn = sample(recipe, index)
    group = group_of(drawn.cell)
    plans: dict[str, Accuracy] = {}
    if drawn.cell.condition.tolerance_db is not None:
        task = recipe.model_dump_json(), group, groups(recipe, recipe.samples, only=group)[group], 1
        plans |= {
            name: Accuracy.model_validate_json(accuracy_json) for name, accuracy_json in take_up(make_plan, [task])
        }
    accuracy = accuracy_of(drawn.cell, plans)
    text = (
        f"# sample {index} of {recipe.name} ({recipe.hash[:8]}): {drawn.cell.activity}, {drawn.cell.condition.name}\n"
    )
    text += drawn.experiment.to_yaml()
    if accuracy is not None:
        values = {"accuracy": accuracy.model_dump(mode="json", exclude_unset=True)}
        text += str(yaml.safe_dump(values, sort_keys=False))
    return text.rstrip()
