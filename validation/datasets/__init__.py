"""Data sets: whether labels and pictures belong together, and what else tells the labels."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from t2d_rt.dataset import Dataset, Recipe, make_dataset
from validation.report import Section


def of_a_set_made(recipe: str, evaluated: Callable[[Dataset], Section]) -> Section:
    """The section of a data set that is made for it, by a recipe that ships."""
    with tempfile.TemporaryDirectory() as folder:
        make_dataset(Recipe.read(recipe), Path(folder) / recipe)
        return evaluated(Dataset(Path(folder) / recipe))
