"""One sample of a recipe: a pure function of the recipe and its index."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.core.checks import integer
from t2d_rt.dataset.beside import moving_beside
from t2d_rt.dataset.motions import SampleMotion, descriptions, sample_motion
from t2d_rt.dataset.placing import Place, placing
from t2d_rt.dataset.recipe import Condition, Recipe
from t2d_rt.dataset.seeds import integer_seed
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.motion.descriptions.slots import Activity, Description
from t2d_rt.types import Radar


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """Where a sample stands in the recipe."""

    index: int
    activity: Activity
    description: int
    """Of the class's descriptions."""
    repetition: int
    """Of the description's motions."""
    number: int
    """Of the motion."""
    condition: Condition


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """A sample before it is simulated."""

    cell: Cell
    description: Description
    cut: SampleMotion
    place: Place
    experiment: Experiment
    measured: bool
    """Whether its field error is measured."""


def cell_of(recipe: Recipe, index: int) -> Cell:
    """The cell of an index.

    Classes change fastest, then conditions where each motion is recorded under all of them, then descriptions, then repetitions:
    the first so many samples are balanced over the classes, and hold as many descriptions as they can.
    """
    index = integer("the index of a sample", index, 0, recipe.samples - 1)
    rest, class_number = divmod(index, len(recipe.classes))
    chosen = 0
    if recipe.each_condition:
        rest, chosen = divmod(rest, len(recipe.conditions))
    repetition, description = divmod(rest, recipe.descriptions_per_class)
    number = rest * len(recipe.classes) + class_number
    if not recipe.each_condition:
        weights = np.array([each.weight for each in recipe.conditions])
        rng = np.random.default_rng(recipe.seeds(number, "condition"))
        chosen = int(rng.choice(len(weights), p=weights / weights.sum()))
    return Cell(
        index=index, activity=recipe.classes[class_number], description=description, repetition=repetition, number=number,
        condition=recipe.conditions[chosen],
    )  # fmt: skip


def description_of(recipe: Recipe, cell: Cell) -> Description:
    """What the person of a cell does."""
    return descriptions(cell.activity, recipe.descriptions_per_class, recipe.seed)[cell.description]


def sample(recipe: Recipe, index: int) -> Sample:
    """A sample by its index; its motion is made on the way, to know how long it is and where it has room."""
    cell = cell_of(recipe, index)
    found = sample_motion(recipe, cell.activity, cell.description, cell.number)
    condition = cell.condition
    place = placing(recipe, cell.number, condition.scene, found.motion)
    radar = _raised(recipe.radar if condition.radar is None else condition.radar, place.height_m)
    source = found.source.model_copy(
        update={"distance_m": place.distance_m, "angle_deg": place.angle_deg, "aside_m": place.aside_m}
    )
    beside = moving_beside(condition.beside, recipe, cell.number)
    experiment = Experiment(
        targets=(source,) if beside is None else (source, beside), radar=radar, scene=condition.scene,
        reflections=condition.reflections, clutter=condition.clutter, method=condition.method,
        body=source.body or "adult", seed=integer_seed(recipe.seeds(index, "diffuse points and noise")),
        noise=recipe.noise,
    )  # fmt: skip
    chance = float(np.random.default_rng(recipe.seeds(index, "error")).random())
    return Sample(
        cell=cell, description=description_of(recipe, cell), cut=found, place=place, experiment=experiment,
        measured=chance < recipe.error_fraction,
    )  # fmt: skip


def _raised(radar: Radar, height_m: float) -> Radar:
    """The radar at (0, 0) m and a height, looking along +x."""
    return radar.model_copy(update={"position_m": (0.0, 0.0, height_m), "boresight": (1.0, 0.0, 0.0)})
