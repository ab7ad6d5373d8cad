"""How large the benchmark is: tiny for a test, laptop for a report, paper as printed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from t2d_rt.dataset import Recipe
from t2d_rt.learn.baselines import BASELINES

NETWORKS = "vgg-7", "resnet18", "vit-tiny", "crnn", "conv1d-lstm", "conv1d-alstm-fcn", "streaming"
SETS = "simple", "hard"
SLOW = "vgg-7", "resnet18", "vit-tiny", "crnn"
"""Networks whose training takes a hundred times as long as that of the others."""
JUDGED = ("simple", "file"), ("hard", "file"), ("hard", "description")
"""Sets and splits that claims of the paper are judged by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Data, models, and how long they are trained."""

    name: str
    recipes: dict[str, Recipe | str]
    """Recipe of each set, or its name."""
    size: int
    epochs: int
    batch: int
    seeds: tuple[int, ...]
    """Each has a split, weights and an order of its own."""
    models: tuple[str, ...] = (*NETWORKS, *BASELINES)
    once: tuple[str, ...] = ()
    """Models that have the first seed alone where no claim is judged, to save time."""

    def recipe(self, name: str) -> Recipe:
        """The recipe of a set."""
        found = self.recipes[name]
        return Recipe.read(found) if isinstance(found, str) else found


def _tiny(descriptions: int, samples: int, name: str) -> Recipe:
    values: dict[str, Any] = {
        "name": name, "classes": ["walking", "bending"], "descriptions_per_class": descriptions,
        "samples_per_description": samples, "radar": "table2", "conditions": [{"name": "ellipsoids", "method": "ellipsoid"}],
        "duration_s": 1.5, "products": {"spectrogram": {"size": [48, 48]}}, "attempts": 1,
    }  # fmt: skip
    return Recipe(**values)


SCALES = {
    "tiny": Scale(
        name="tiny", recipes={"simple": _tiny(4, 1, "tiny-simple"), "hard": _tiny(4, 2, "tiny-hard")}, size=48, epochs=1, batch=4,
        seeds=(0,), models=("resnet18", "conv1d-lstm", "streaming", *BASELINES),
    ),
    "laptop": Scale(
        name="laptop", recipes={"simple": "small-simple", "hard": "small-hard"}, size=48, epochs=60, batch=16, seeds=(0, 1, 2),
        once=SLOW,
    ),
    "paper": Scale(
        name="paper", recipes={"simple": "simple", "hard": "hard"}, size=224, epochs=100, batch=64, seeds=(0, 1, 2, 3, 4),
    ),
}  # fmt: skip
