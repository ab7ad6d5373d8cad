"""What several models are made of."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class SpeedsAsChannels(nn.Module):
    """A map (N, channels, speed, time) as a sequence (N, channels x speed, time): each speed is a channel of its own."""

    def forward(self, maps: Tensor) -> Tensor:
        """(N, channels x speed, time) of maps (N, channels, speed, time)."""
        return maps.flatten(1, 2)


def convolutions_over_time(speeds: int) -> nn.Sequential:
    """Two convolutions over time, (N, speeds, T) to (N, 64, T/2)."""
    return nn.Sequential(
        nn.Conv1d(speeds, 32, 5, padding=2), nn.BatchNorm1d(32), nn.ReLU(), nn.MaxPool1d(2),
        nn.Conv1d(32, 64, 3, padding=1), nn.BatchNorm1d(64), nn.ReLU(),
    )  # fmt: skip


class Attention(nn.Module):
    """The sum over time of a sequence (N, T, C), weighted by how much each instant tells."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.weight = nn.Linear(width, 1)

    def forward(self, sequence: Tensor) -> Tensor:
        """The weighted sum over time, (N, C)."""
        weight = torch.softmax(self.weight(torch.tanh(sequence)), dim=1)
        return (weight * sequence).sum(dim=1)
