"""How a network is trained."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field

from t2d_rt.learn.train.augment import Augment
from t2d_rt.types.fields import Count, Fields, Number


class TrainOptions(Fields):
    """The protocol; by default that of the authors of Text2Doppler: Adam at 1e-3, a rate that falls on a plateau, an early stop."""

    noun: ClassVar[str] = "training"
    model_config = ConfigDict(use_attribute_docstrings=True)

    rate: Annotated[Number, Field(gt=0, le=10)] = 1e-3
    """Learning rate of Adam."""
    factor: Annotated[Number, Field(gt=0, lt=1)] = 0.1
    """By which the rate falls where the loss of the validation no longer does."""
    plateau: Annotated[Count, Field(ge=0, le=10_000)] = 5
    """Epochs without a lower loss after which it falls; with 10, as the early stop has, it would fall in the last epoch only."""
    patience: Annotated[Count, Field(ge=1, le=10_000)] = 10
    """Epochs without a lower loss after which training stops."""
    schedule: Literal["plateau", "cosine"] = "plateau"
    """"plateau" lets the rate fall where the loss of the validation no longer does, and stops; "cosine" lets it rise over a seventh
    of the epochs and fall to nothing along a cosine over the others, all of which are run (Loshchilov and Hutter 2017)."""
    smoothing: Annotated[Number, Field(ge=0, le=0.5)] = 0.0
    """Part of the probability that the classes share, so that no network becomes certain (Szegedy et al. 2016)."""
    decay: Annotated[Number, Field(ge=0, le=10)] = 0.0
    """By which weights shrink in each step, relative to the rate (Loshchilov and Hutter 2019)."""
    epochs: Annotated[Count, Field(ge=1, le=10_000)] = 100
    """At most."""
    batch: Annotated[Count, Field(ge=2, le=100_000)] = 64
    """Samples of a step."""
    seed: Annotated[Count, Field(ge=0, le=2**31)] = 0
    """Of the weights, the order of the samples and the augmentations."""
    threads: Annotated[Count, Field(ge=1, le=256)] = 1
    """Of torch; the same seed gives the same weights, bit for bit on one machine, with one."""
    device: Literal["cpu", "gpu"] = "cpu"
    """Where it runs."""
    augment: Augment = Augment()
    """How samples are changed on the fly; by default they are not."""

    def rate_of(self, epoch: int) -> float:
        """Learning rate of an epoch of the schedule "cosine"."""
        rising = max(1, round(self.epochs / 7))
        if epoch < rising:
            return self.rate * (epoch + 1) / (rising + 1)
        return self.rate * 0.5 * (1.0 + math.cos(math.pi * (epoch - rising) / (self.epochs - rising)))
