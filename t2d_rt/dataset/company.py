"""What moves beside the person: fans, curtains, pets and second persons, placed by chance."""

from __future__ import annotations

from typing import Literal

import numpy as np

from t2d_rt.dataset.recipe import Beside, Recipe
from t2d_rt.dataset.seeds import whole
from t2d_rt.dataset.takes import descriptions
from t2d_rt.motion.generate.library.individual import drawn_person
from t2d_rt.scene import Curtain, Mover, Pet, TableFan
from t2d_rt.sources import MotionText

WALKS = 20
"""Descriptions of walks that a second person may follow."""


CIRCLE_RADIUS_M = {"dog": 1.0, "cat": 0.6}
"""Of the circles that pets walk in."""


def company(beside: Beside, recipe: Recipe, number: int) -> Mover | MotionText | None:
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
        return Curtain(position_m=place, heading_deg=-90.0 * side, seed=whole(recipe.seeds(number, "curtain")))
    if beside == "pet":
        place = between(2.5, 4.0), side * between(0.8, 1.4), 0.0
        animal: Literal["dog", "cat"] = "dog" if rng.random() < 0.5 else "cat"
        return Pet(
            animal=animal, position_m=place, heading_deg=between(0, 360), speed_mps=between(0.4, 0.9),
            turn_radius_m=CIRCLE_RADIUS_M[animal],
        )  # fmt: skip
    if beside == "person":
        walks = descriptions("walking", WALKS, recipe.seed)
        walk = walks[int(rng.integers(len(walks)))]
        body, stature_m = drawn_person(walk.subject, rng)
        return MotionText(
            text=walk.sentence, seed=whole(recipe.seeds(number, "second person")), body=body, stature_m=round(stature_m, 4),
            duration_s=recipe.duration_s, distance_m=between(2.5, 4.5), angle_deg=between(-180, 180),
            aside_m=side * between(1.2, 1.8), hold_s=recipe.duration_s, stop_s=recipe.duration_s,
        )  # fmt: skip
    return None
