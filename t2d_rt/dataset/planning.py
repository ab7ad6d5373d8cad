"""Plans: one for each class and condition that has a tolerance, made on the first sample of the group and used for all of it."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from pathlib import Path

from t2d_rt.accuracy import plan
from t2d_rt.core.errors import InputError, T2DError, T2DWarning
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.sample import cell_of, sample
from t2d_rt.dataset.shards import write_whole
from t2d_rt.dataset.work import group_of
from t2d_rt.types import Accuracy

PLANNED = 20
"""Samples of a group of which the first one that can be planned gives the plan."""


def groups(recipe: Recipe, count: int, *, only: str | None = None) -> dict[str, list[int]]:
    """Indices of the first few of so many samples whose condition has a tolerance, by their group; of one group if `only` that."""
    found: dict[str, list[int]] = {}
    for index in range(count):
        cell = cell_of(recipe, index)
        if cell.condition.tolerance_db is not None and only in (None, group_of(cell)):
            found.setdefault(group_of(cell), [])
            if len(found[group_of(cell)]) < PLANNED:
                found[group_of(cell)].append(index)
    return found


def make_plans(recipe: Recipe, path: Path, count: int) -> Mapping[str, Accuracy]:
    """Accuracies of the groups, those that a file holds already and the others, which are added to it."""
    known = read_plans(path)
    missing = {name: indices for name, indices in groups(recipe, count).items() if name not in known}
    made = {name: plan_of(recipe, indices) for name, indices in missing.items()}
    if made or not path.exists():
        known = dict(sorted({**known, **made}.items()))
        plain = {name: each.model_dump(mode="json") for name, each in known.items()}
        write_whole(path, (json.dumps(plain, indent=1) + "\n").encode())
    return known


def read_plans(path: Path) -> dict[str, Accuracy]:
    """The accuracies that a file holds; none where there is no file."""
    if not path.exists():
        return {}
    try:
        return {name: Accuracy.model_validate(each) for name, each in json.loads(path.read_bytes()).items()}
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} cannot be read ({error}); remove it and run the recipe again") from None


def plan_of(recipe: Recipe, indices: list[int]) -> Accuracy:
    """The accuracy that keeps to a group's tolerance: that of the first of its samples that can be planned."""
    failure: T2DError | None = None
    for index in indices:
        try:
            found = sample(recipe, index)
            condition = found.cell.condition
            assert condition.tolerance_db is not None, "groups have a tolerance"
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", T2DWarning)  # the sample's record tells them
                return plan(
                    found.experiment, tolerance_db=condition.tolerance_db, accuracy=condition.accuracy, device="cpu"
                ).accuracy
        except T2DError as error:
            failure = failure or error
    assert failure is not None, "a group has samples"
    raise failure
