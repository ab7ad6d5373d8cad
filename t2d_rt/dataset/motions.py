"""The motion of a sample: made, varied, cut or held to the length of the records, judged by the filter."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from t2d_rt.core.errors import T2DError
from t2d_rt.dataset.recipe import OWN_BODY, Recipe
from t2d_rt.dataset.seeds import integer_seed
from t2d_rt.experiment.sources import MotionText
from t2d_rt.motion import trim
from t2d_rt.motion.check import check_motion
from t2d_rt.motion.descriptions.grammar import grammar_descriptions
from t2d_rt.motion.descriptions.slots import Activity, Description
from t2d_rt.motion.generate import COMPOSED
from t2d_rt.motion.generate.library.individual import drawn_person
from t2d_rt.motion.vary import hold
from t2d_rt.types import Motion

LASTING: frozenset[Activity] = frozenset({"walking", "abnormal_walking", "running", "dancing"})
"""Classes that go on as long as they are asked to: their main action is made as long as a record."""
STEP_S = 0.25
"""Pieces of a motion that begin so far apart are compared."""


@dataclass(frozen=True, slots=True)
class SampleMotion:
    """A motion and how it came about."""

    source: MotionText
    motion: Motion
    """Cut or held, not placed."""
    passed: bool
    """Whether the filter takes it for one of its class."""
    reasons: tuple[str, ...]
    attempts: int
    made_s: float
    """Length of what was made, before it was cut or held [s]."""
    origin: tuple[str, ...] = field(default=())
    """Sentence, person, clips and edits."""


@functools.lru_cache(maxsize=64)
def descriptions(activity: Activity, count: int, seed: int) -> tuple[Description, ...]:
    """The descriptions of a class, in order."""
    return tuple(grammar_descriptions(activity, count, seed=seed))


@functools.lru_cache(maxsize=16)
def sample_motion(recipe: Recipe, activity: Activity, description: int, number: int) -> SampleMotion:
    """The motion of a number: the first one that passes the filter within the recipe's attempts, or the first that can be made."""
    wanted = descriptions(activity, recipe.descriptions_per_class, recipe.seed)[description]
    first: SampleMotion | None = None
    failure: T2DError | None = None
    for attempt in range(recipe.attempts):
        source = _drawn(recipe, activity, wanted, number, attempt)
        try:
            found = _fitted(source, recipe, activity, attempt + 1)
        except T2DError as error:  # of falls, some do not come to one
            failure = failure or error
            continue
        if found.passed:
            return found
        first = first or found
    if first is None:
        assert failure is not None, "there is at least one attempt"
        raise failure
    return first


def _drawn(recipe: Recipe, activity: Activity, wanted: Description, number: int, attempt: int) -> MotionText:
    """Person, gait and provider of one attempt."""
    motion, person, gait, provider = (
        recipe.seeds(number, f"{purpose} {attempt}") for purpose in ("motion", "person", "gait", "provider")
    )
    provider_name = recipe.providers[int(np.random.default_rng(provider).integers(len(recipe.providers)))]
    values: dict[str, object] = {"gait_spread": recipe.gait_spread}
    factor = float(np.random.default_rng(gait).uniform(*recipe.gait_factors))
    if factor != 1.0:
        values["gait_factor"] = round(factor, 4)
    if provider_name in COMPOSED:  # others choose the person themselves
        rng = np.random.default_rng(person)
        body = recipe.bodies[int(rng.integers(len(recipe.bodies)))]
        body, stature_m = drawn_person(wanted.subject, rng, body=None if body == OWN_BODY else body)
        values |= {"body": body, "stature_m": round(stature_m, 4)}
        if activity in LASTING:
            values["duration_s"] = round(recipe.duration_s * max(1.0, factor), 4)
    return MotionText(text=wanted.sentence, seed=integer_seed(motion), provider=provider_name, **values)


def _fitted(source: MotionText, recipe: Recipe, activity: Activity, attempts: int) -> SampleMotion:
    """Cut or held to the length of a record, and judged.

    A motion that is too long is cut to its liveliest piece that the filter takes for one of the class: the greatest mean square of
    the joints' speeds. Where it takes none, to the liveliest.
    """
    made, length_s = source.made(), recipe.duration_s
    lacking_s = length_s - made.duration_s
    if lacking_s > 0:
        # A frame more than is needed: lengths are whole numbers of frames.
        source = source.model_copy(update={"hold_s": round(lacking_s + 1.0 / made.rate_hz, 6), "stop_s": length_s})
        motion = trim(hold(made, source.hold_s), 0.0, length_s)
        verdict = check_motion(motion, expected=activity)
        return _cut(source, motion, verdict.reasons, attempts, made)
    liveliest: SampleMotion | None = None
    for start_s in _starts(made, length_s):
        cut = source.model_copy(update={"start_s": start_s, "stop_s": start_s + length_s})
        motion = trim(made, start_s, start_s + length_s)
        found = _cut(cut, motion, check_motion(motion, expected=activity).reasons, attempts, made)
        if found.passed:
            return found
        liveliest = liveliest or found
    assert liveliest is not None, "there is at least one piece"
    return liveliest


def _cut(source: MotionText, motion: Motion, reasons: tuple[str, ...], attempts: int, made: Motion) -> SampleMotion:
    return SampleMotion(source, motion, not reasons, reasons, attempts, made.duration_s, made.origin)


def _starts(motion: Motion, length_s: float) -> list[float]:
    """First instants of the pieces of a motion [s], the liveliest first."""
    squares = np.sum(np.diff(motion.joints, axis=0) ** 2, axis=(1, 2))
    total = np.concatenate([[0.0], np.cumsum(squares)])
    starts = np.arange(0.0, motion.duration_s - length_s + 1e-9, STEP_S)
    frames = np.rint(starts * motion.rate_hz).astype(int)
    energy = total[np.minimum(frames + round(length_s * motion.rate_hz), len(squares))] - total[frames]
    return [float(starts[at]) for at in np.argsort(-energy, kind="stable")]


def provenance(found: SampleMotion) -> Mapping[str, object]:
    """What a record tells of it."""
    return {
        "passed": found.passed, "reasons": list(found.reasons), "attempts": found.attempts, "made_s": round(found.made_s, 6),
        "start_s": found.source.start_s, "held_s": found.source.hold_s, "sources": list(found.origin),
    }  # fmt: skip
