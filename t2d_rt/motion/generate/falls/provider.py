"""The `physics` provider: a description of a fall, and a lead that fits what comes before it, become a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import FALL_TYPES, Description, FallType, Step
from t2d_rt.motion.generate.falls.plan import HEADINGS, FallPlan

STRENGTHS = {"slow": (0.2, 0.45), "normal": (0.3, 0.8), "fast": (0.65, 0.95)}
"""Ranges of strength by the speed that a description asks for."""

RESTS_S = (1.0, 2.5)
"""How long the body lies."""


def plan_of(description: Description, seed: int = 0) -> FallPlan:
    """The fall that a description asks for; what it leaves open is drawn from the seed."""
    steps = [step for step in description.steps if step.action == "fall"]
    if not steps:
        raise InputError(
            f"the physics provider makes falls, got a description of {description.action}; use the library provider"
        )
    step = steps[0]
    rng = np.random.default_rng([seed, 10])
    types = [step.type] if step.type in FALL_TYPES else _types_to(step)
    return FallPlan(
        type=types[int(rng.integers(len(types)))],
        direction=step.direction if step.direction in HEADINGS else None,
        strength=float(rng.uniform(*STRENGTHS[step.speed])), rest_s=float(rng.uniform(*RESTS_S)),
        get_up=any(each.action == "stand_up" for each in _after(description, step)), seed=seed,
    )  # fmt: skip


def _types_to(step: Step) -> list[FallType]:
    """Types that go in the direction of a step that names none."""
    if step.direction == "back":
        return ["slip"]
    return (
        ["trip"]
        if step.direction == "forward"
        else list(FALL_TYPES)
        if step.direction is None
        else ["slip", "collapse"]
    )


def _after(description: Description, step: Step) -> Sequence[Step]:
    steps = description.steps
    return steps[next(i for i, each in enumerate(steps) if each is step) + 1 :]
