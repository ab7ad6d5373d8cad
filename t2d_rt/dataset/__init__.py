"""Data sets: a recipe, its samples, and the shards that they are written to."""

from __future__ import annotations

from t2d_rt.dataset.making import Outcome, make_dataset
from t2d_rt.dataset.read import Shard, check_dataset, read_shards
from t2d_rt.dataset.recipe import Condition, Recipe, recipe_names
from t2d_rt.dataset.sample import sample

__all__ = [
    "Condition", "Outcome", "Recipe", "Shard", "check_dataset", "make_dataset", "read_shards", "recipe_names", "sample",
]  # fmt: skip
