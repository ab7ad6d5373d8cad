"""Learning a background: the door to the training, which loads torch when it is called."""

from __future__ import annotations

from collections.abc import Callable

from t2d_rt.core.checks import integer
from t2d_rt.core.errors import InputError, install
from t2d_rt.noise.background.model import BackgroundModel
from t2d_rt.noise.background.network import HALO, Architecture
from t2d_rt.noise.background.records import BackgroundRecord, common_grid

STEP_S = 0.05
"""Duration of a step of the codes at most, but for records whose columns are farther apart: a fan's blades take as long."""
MOST_HALVINGS = 5
LEAST_STEPS = 14
"""Steps that each record has at least: a tile, and something to learn about what follows it."""


def learn_background(
    records: list[BackgroundRecord],
    *,
    codes: int = 32,
    heads: int = 4,
    codec_steps: int = 800,
    prior_steps: int = 400,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> BackgroundModel:
    """A background model of records that all have the same axes.

    codes: entries of each code book; more than the data fill are no use (`t2d-rt background evaluate` tells their perplexity).
    heads: code books, each for a part of what happens in a step.
    codec_steps, prior_steps: steps of Adam.
    seed: of the weights and of the order of the data.

    Raises InputError where records differ in their axes, where one is too short, and where PyTorch is not installed.
    """
    if not records:
        raise InputError("a background is learned from one recording or more, got none")
    grid = common_grid(records)
    halvings = 0
    while halvings < MOST_HALVINGS and grid.time_step_s * 2 ** (halvings + 1) <= STEP_S:
        halvings += 1
    architecture = Architecture(bins=len(grid.velocity_mps), codes=codes, heads=heads, time_halvings=max(1, halvings))
    least = (LEAST_STEPS + 2 * HALO) * architecture.columns
    for each in records:
        if each.power.shape[1] < least:
            raise InputError(
                f"{each.name} has {each.power.shape[1]} columns, and a background is learned from {least} or more "
                f"({least * grid.time_step_s:.3g} s) of each recording; leave it out, or give a longer one"
            )
    require_torch()
    from t2d_rt.noise.background.training import Training, train

    training = Training(
        codec_steps=integer("codec_steps", codec_steps, 1),
        prior_steps=integer("prior_steps", prior_steps, 1),
        seed=integer("seed", seed),
    )
    return train(records, architecture, training, progress)


def require_torch() -> None:
    """An InputError where what training needs is not installed."""
    try:
        import torch  # noqa: F401
        import vector_quantize_pytorch  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"training a background needs torch and vector-quantize-pytorch ({error}); {install('learn')}"
        ) from None
