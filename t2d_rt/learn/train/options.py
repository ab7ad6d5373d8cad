"""How a network is trained."""

from __future__ import annotations

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
