"""Subjects of a recipe: persons who stay the same in many samples."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from t2d_rt.body import template
from t2d_rt.dataset.recipe import Recipe, Side, integer_seed
from t2d_rt.motion.descriptions import slots
from t2d_rt.motion.generate.library.individual import STATURE_M, drawn_person

KINDS = tuple(dict.fromkeys(kind for kinds in STATURE_M.values() for kind, *_ in kinds))
"""Kinds of bodies that subjects take in turn."""

ANYBODY = ("adult", "woman", "man")
"""Bodies that fit a description of "a person"."""

BMI_SPREAD = 0.14
"""Standard deviation of the logarithm of the body mass index about that of the shipped body: from 14.2 kg of 85.5 kg for soldiers
whose stature varies by 6.9 cm of 175.6 cm (Gordon et al. 2014, ANSUR II)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """One person of a recipe."""

    number: int
    body: str
    """Template and body mass index, as "man@29.31"."""
    stature_m: float
    seed: int
    """Seed of proportions, handedness, posture, tempo, swing of the arms and breathing."""
    gait_factor: float


@functools.lru_cache(maxsize=4096)
def subject(recipe: Recipe, number: int) -> Subject:
    """The subject of that number: the same person in all samples of the recipe."""
    rng = np.random.default_rng(recipe.seeds(number, "subject"))
    kind, stature_m = drawn_person("person", rng, body=KINDS[number % len(KINDS)])
    shipped = template(kind)
    bmi = shipped.bmi * np.exp(BMI_SPREAD * np.clip(rng.standard_normal(), -2, 2))
    # A body that is fitted to a stature grows in all directions, and its body mass index with it.
    bmi = np.clip(bmi * shipped.stature_m / stature_m, *shipped.bmi_limits)
    return Subject(
        number=number,
        body=f"{kind}@{bmi:.2f}",
        stature_m=round(stature_m, 4),
        seed=integer_seed(recipe.seeds(number, "subject's person")),
        gait_factor=round(float(rng.uniform(*recipe.gait_factors)), 4),
    )


def subject_of(recipe: Recipe, meant: slots.Subject, number: int, side: Side | None) -> Subject | None:
    """The subject for a motion's number: one of its side that fits its description; None for a recipe without subjects."""
    if recipe.subjects is None:
        return None
    bodies = ANYBODY if meant == "person" else tuple(kind for kind, *_ in STATURE_M[meant])
    candidates = [
        candidate
        for candidate in range(recipe.subjects)
        if KINDS[candidate % len(KINDS)] in bodies and recipe.side_at(candidate // len(KINDS)) == side
    ]
    rng = np.random.default_rng(recipe.seeds(number, "which subject"))
    return subject(recipe, candidates[int(rng.integers(len(candidates)))])
