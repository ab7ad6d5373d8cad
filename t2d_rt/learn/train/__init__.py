"""Training of the networks, their files, and how well they do."""

from t2d_rt.learn.train.augment import Augment
from t2d_rt.learn.train.options import TrainOptions
from t2d_rt.learn.train.saved import Ensemble, SavedModel, load_model
from t2d_rt.learn.train.scores import Scores, scores_of
from t2d_rt.learn.train.sides import SPLITS, sides_of
from t2d_rt.learn.train.train import train_model

__all__ = [
    "SPLITS",
    "Augment",
    "Ensemble",
    "SavedModel",
    "Scores",
    "TrainOptions",
    "load_model",
    "scores_of",
    "sides_of",
    "train_model",
]
