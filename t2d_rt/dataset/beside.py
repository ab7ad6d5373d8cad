"""What moves beside the person: fans, curtains, pets and second persons, placed by chance."""

from __future__ import annotations

import functools
from typing import Literal

import numpy as np

from t2d_rt.dataset.motions import descriptions
from t2d_rt.dataset.recipe import Beside, Recipe
from t2d_rt.dataset.seeds import integer_seed
from t2d_rt.experiment.sources import MotionText
from t2d_rt.motion.descriptions.slots import Description
from t2d_rt.motion.generate.library.individual import drawn_person
from t2d_rt.scene import Curtain, Mover, Pet, TableFan

WALKS = 20
"""Descriptions of walks that a second person may follow."""

RESERVED_SEED = 1 << 40
"""Added to a recipe's seed for the descriptions that no sample of a class has."""

CIRCLE_RADIUS_M = {"dog": 1.0, "cat": 0.6}
"""Of the circles that pets walk in."""


@functools.lru_cache(maxsize=4)
def reserved_walks(recipe: Recipe) -> tuple[Description, ...]:
    """Descriptions of walks for second persons, of sentences that no sample of the recipe is labelled with.

    They are on all sides of every split, and no class can be told by them.
    """
    used = {
        each.sentence
        for name in recipe.classes
        for each in descriptions(name, recipe.descriptions_per_class, recipe.seed)
    }
    count = WALKS
    while True:
        drawn = descriptions("walking", count, recipe.seed + RESERVED_SEED)
        found = [each for each in drawn if each.sentence not in used]
        if len(found) >= WALKS:
            return tuple(found[:WALKS])
        count *= 2


def moving_beside(beside: Beside, recipe: Recipe, number: int) -> Mover | MotionText | None:
    """What moves beside the person of a motion's number, in the world of a radar at (0, 0) m that looks along +x."""
    rng = np.random.default_rng(recipe.seeds(number, f"beside {beside}"))
    side = float(rng.choice([-1.0, 1.0]))

    def between(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 3)

    if beside == "fan":
        place = between(2.5, 4.5), side * between(1.0, 1.8), between(0.8, 1.3)
        return TableFan(position_m=place, heading_deg=180.0 + between(-40, 40), rpm=between(200, 400))
    if beside == "curtain":
        place = between(2.5, 4.5), side * between(1.6, 2.0), 2.3
        return Curtain(position_m=place, heading_deg=-90.0 * side, seed=integer_seed(recipe.seeds(number, "curtain")))
    if beside == "pet":
        place = between(2.5, 4.0), side * between(0.8, 1.4), 0.0
        animal: Literal["dog", "cat"] = "dog" if rng.random() < 0.5 else "cat"
        return Pet(
            animal=animal, position_m=place, heading_deg=between(0, 360), speed_mps=between(0.4, 0.9),
            turn_radius_m=CIRCLE_RADIUS_M[animal],
        )  # fmt: skip
    if beside == "person":
        walks = reserved_walks(recipe)
        walk = walks[int(rng.integers(len(walks)))]
        body, stature_m = drawn_person(walk.subject, rng)
        return MotionText(
            text=walk.sentence, seed=integer_seed(recipe.seeds(number, "second person")), body=body, stature_m=round(stature_m, 4),
            duration_s=recipe.duration_s, distance_m=between(2.5, 4.5), angle_deg=between(-180, 180),
            aside_m=side * between(1.2, 1.8), hold_s=recipe.duration_s, stop_s=recipe.duration_s,
        )  # fmt: skip
    return None
