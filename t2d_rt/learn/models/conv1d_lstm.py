"""Conv1D-LSTM: convolutions over time with a channel for each speed, then recurrent layers."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from t2d_rt.learn.models.layers import SpeedsAsChannels, convolutions_over_time
from t2d_rt.learn.models.registry import ModelCard, Printed

ABOUT = ModelCard(
    title="Conv1D-LSTM",
    source="Donahue et al. 2015 in one dimension; encoder as in the published code of Text2Doppler",
    counted_at=(1, 224, 112),
    printed=Printed(simple=98.26, hard=80.80, gflops=0.008, mparams=0.111),
    note="It takes one channel, and the published code halves the time axis of a picture of 224 x 224 first.",
)
HIDDEN = 64


class ConvolutionsThenMemory(nn.Module):
    """Last state of an LSTM and the greatest features at any time."""

    def __init__(self, classes: int, speeds: int) -> None:
        super().__init__()
        self.encoder = nn.Sequential(SpeedsAsChannels(), convolutions_over_time(speeds))
        self.recurrent = nn.LSTM(64, HIDDEN, num_layers=2, batch_first=True)
        self.head = nn.Linear(HIDDEN + 64, classes)

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) of maps (N, channels, speed, time)."""
        sequence = self.encoder(maps)
        states = self.recurrent(sequence.transpose(1, 2))[0]
        scores: Tensor = self.head(torch.cat([states[:, -1], sequence.amax(dim=2)], dim=1))
        return scores


def build(classes: int, size: tuple[int, int], channels: int) -> nn.Module:
    """The untrained network for maps of this size."""
    return ConvolutionsThenMemory(classes, size[0] * channels)
