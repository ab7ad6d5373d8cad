"""Classifiers of micro-Doppler spectrograms: models, training, fine-tuning, evaluation, prediction, and readers of real recordings.

Most of it needs the extra [learn].
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from t2d_rt.core.calls import public

if TYPE_CHECKING:
    from t2d_rt.dataset.splits import sides_of
    from t2d_rt.learn.augment import Augment
    from t2d_rt.learn.benchmark_line import benchmark
    from t2d_rt.learn.fine_tuning import STRATEGIES, Events, fine_tune, labels_of, pretrain
    from t2d_rt.learn.maps import LabelledMaps, maps_of
    from t2d_rt.learn.models import build, count, model_names
    from t2d_rt.learn.prediction import Prediction, predict
    from t2d_rt.learn.saved_models import Ensemble, SavedModel, load_model
    from t2d_rt.learn.scores import Scores, scores_of
    from t2d_rt.learn.training import TrainOptions, train_model

# Everything loads at first use, as PyTorch takes seconds.
_HOMES = {
    "t2d_rt.learn.fine_tuning": ("STRATEGIES", "Events", "fine_tune", "labels_of", "pretrain"),
    "t2d_rt.dataset.splits": ("sides_of",),
    "t2d_rt.learn.augment": ("Augment",),
    "t2d_rt.learn.benchmark_line": ("benchmark",),
    "t2d_rt.learn.maps": ("LabelledMaps", "maps_of"),
    "t2d_rt.learn.models": ("build", "count", "model_names"),
    "t2d_rt.learn.prediction": ("Prediction", "predict"),
    "t2d_rt.learn.saved_models": ("Ensemble", "SavedModel", "load_model"),
    "t2d_rt.learn.scores": ("Scores", "scores_of"),
    "t2d_rt.learn.training": ("TrainOptions", "train_model"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "STRATEGIES", "Augment", "Ensemble", "Events", "LabelledMaps", "Prediction", "SavedModel", "Scores", "TrainOptions",
    "benchmark", "build", "count", "fine_tune", "labels_of", "load_model", "maps_of", "model_names", "predict", "pretrain",
    "scores_of", "sides_of", "train_model",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 't2d_rt.learn' has no attribute '{name}'")
    return public(getattr(import_module(_HOME[name]), name))
