"""The network that is pre-trained on simulation and tuned on real events: one encoder for all radars, features averaged."""

from __future__ import annotations

import torch
from torch import Tensor, nn

CHANNELS = 12, 24, 32
SPEEDS_KEPT = 4
FEATURES = 48
"""Of the penultimate layer."""


class EventNet(nn.Module):
    """Convolutions over speed and time, mean and maximum over time, one hidden layer, mean over radars, one linear head."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = 1
        for after in CHANNELS:
            layers += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.GroupNorm(4, after), nn.ReLU()]
            before = after
        self.encoder = nn.Sequential(*layers)
        self.penultimate = nn.Linear(2 * before * SPEEDS_KEPT, FEATURES)
        self.head = nn.Linear(FEATURES, classes)

    def encoded(self, inputs: Tensor) -> Tensor:
        """What the convolutions tell of inputs (B, V, speed, time): (B, V, 2 * channels * SPEEDS_KEPT)."""
        batch, views = inputs.shape[:2]
        found = self.encoder(inputs.flatten(0, 1)[:, None])
        found = found.unflatten(2, (SPEEDS_KEPT, found.shape[2] // SPEEDS_KEPT)).mean(dim=3)
        both = torch.cat([found.mean(dim=3), found.amax(dim=3)], dim=1)
        return both.flatten(1).unflatten(0, (batch, views))

    def forward(self, inputs: Tensor) -> Tensor:
        """Scores (B, K) of inputs (B, V, speed, time)."""
        return self.head(torch.relu(self.penultimate(self.encoded(inputs))).mean(dim=1))


class SkipTuned(nn.Module):
    """Tuned layers on top of the frozen penultimate one, which a skip connection passes on beside them, and a tuned head.

    It begins as the pre-trained network: the last of the tuned layers has weights of zero. (A tuned layer that is added before the
    nonlinearity would be the same as to tune the penultimate layer itself.)
    """

    def __init__(self, net: EventNet) -> None:
        super().__init__()
        self.frozen = net.penultimate
        self.tuned = nn.Sequential(nn.Linear(FEATURES, FEATURES), nn.ReLU(), nn.Linear(FEATURES, FEATURES))
        nn.init.zeros_(self.tuned[2].weight)
        nn.init.zeros_(self.tuned[2].bias)
        self.head = net.head

    def forward(self, encoded: Tensor) -> Tensor:
        """Scores (B, K) of what the encoder told, (B, V, F)."""
        features = torch.relu(self.frozen(encoded))
        return self.head((features + self.tuned(features)).mean(dim=1))
