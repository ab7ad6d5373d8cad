"""Parameters and operations of a network, counted as it runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from t2d_rt.learn.pytorch import require_learning

if TYPE_CHECKING:
    from torch import nn


@dataclass(frozen=True, slots=True)
class Count:
    """Of one map."""

    parameters: int
    gflops: float
    """Multiplications with their additions [1e9], of convolutions, matrix products and recurrent layers; the tables of such
    networks print these as GFLOPs."""
    attention_gflops: float
    """Those of the products of attention among them; some counters add these twice."""


def count(network: nn.Module, size: tuple[int, int, int]) -> Count:
    """Counts of a network at an input of channels, speed and time."""
    require_learning()
    import warnings

    import torch
    from torch.utils.flop_counter import FlopCounterMode

    before = network.training
    network.eval()
    # Without oneDNN an LSTM runs as matrix products, which are counted; with it as one operation, which is not.
    with warnings.catch_warnings(), torch.no_grad(), FlopCounterMode(display=False) as counter:
        warnings.filterwarnings(
            "ignore", message="TF32 acceleration"
        )  # of switching oneDNN, on any machine without Intel's GPU
        with torch.backends.mkldnn.flags(
            enabled=not any(isinstance(each, torch.nn.LSTM) for each in network.modules())
        ):
            network(torch.zeros(1, *size))
    network.train(before)
    found = {str(kind): value for kind, value in counter.get_flop_counts()["Global"].items()}
    attention = sum(value for kind, value in found.items() if "bmm" in kind or "attention" in kind)
    parameters = sum(each.numel() for each in network.parameters())
    return Count(parameters, sum(found.values()) / 2e9, attention / 2e9)
