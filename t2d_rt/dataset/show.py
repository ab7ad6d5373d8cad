"""A sample as the YAML of an experiment, which runs alone to the same ADC samples."""

from __future__ import annotations

from t2d_rt.dataset.planning import groups, plan_of
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.sample import sample
from t2d_rt.dataset.work import accuracy_of, group_of


def shown_sample(recipe: Recipe, index: int) -> str:
    """Text that `t2d-rt simulate` takes: the experiment of a sample, and its accuracy where it is not the default."""
    import yaml

    found = sample(recipe, index)
    group = group_of(found.cell)
    plans = {}
    if found.cell.condition.tolerance_db is not None:
        plans[group] = plan_of(recipe, groups(recipe, recipe.samples, only=group)[group])
    accuracy = accuracy_of(found.cell, plans)
    text = (
        f"# sample {index} of {recipe.name} ({recipe.hash[:8]}): {found.cell.activity}, {found.cell.condition.name}\n"
    )
    text += found.experiment.to_yaml()
    if accuracy is not None:
        plain = {"accuracy": accuracy.model_dump(mode="json", exclude_unset=True)}
        text += str(yaml.safe_dump(plain, sort_keys=False))
    return text.rstrip()
