"""Data sets: recipes, their samples, the shards in which these are stored, and what can be done with them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from t2d_rt.core.calls import public
from t2d_rt.dataset.dataset import Dataset
from t2d_rt.dataset.export import export_dataset
from t2d_rt.dataset.making import Outcome, make_dataset
from t2d_rt.dataset.recipe import Condition, Recipe, recipe_names
from t2d_rt.dataset.sample import sample
from t2d_rt.dataset.shards import Shard, check_dataset, read_shards
from t2d_rt.dataset.splits import Split, check_split, folds, read_split, source_clips, split
from t2d_rt.dataset.summary import Summary, dataset_sheet, plot_summary, summarise
from t2d_rt.recording.truth import TRUTH_COLUMNS

if TYPE_CHECKING:
    from t2d_rt.dataset.torch_data import TorchDataset

__all__ = [
    "TRUTH_COLUMNS", "Condition", "Dataset", "Outcome", "Recipe", "Shard", "Split", "Summary", "TorchDataset",
    "check_dataset", "check_split", "dataset_sheet", "export_dataset", "folds", "make_dataset", "plot_summary",
    "read_shards", "read_split", "recipe_names", "sample", "source_clips", "split", "summarise",
]  # fmt: skip

globals().update({name: public(globals()[name]) for name in __all__ if name in globals()})


def __getattr__(name: str) -> Any:
    if name == "TorchDataset":  # loads PyTorch only when it is used
        from t2d_rt.dataset.torch_data import TorchDataset

        return TorchDataset
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
