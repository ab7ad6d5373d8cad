"""Networks with convolutions followed by recurrent layers over the time of a map (Table III of Text2Doppler)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from t2d_rt.learn.models import ModelCard, Network, Printed

FEATURES = 64
"""Number of channels after the convolutions over time."""
HIDDEN, WIDTH = 32, 128
"""Size of the state in each direction of a bidirectional layer; number of channels of the CRNN's convolutions."""
NARROW = 8
"""Number of channels between the two convolutions over eight instants of Conv1D-ALSTM-FCN."""


def convolutions_over_time(speeds: int) -> nn.Sequential:
    """Two convolutions over time, (N, channels, speed, T) to (N, 64, T / 2); each speed of each channel is an input channel."""
    return nn.Sequential(
        nn.Flatten(1, 2),
        nn.Sequential(
            nn.Conv1d(speeds, 32, 5, padding=2),
            nn.BatchNorm1d(32),
            nn.ReLU(),
            nn.MaxPool1d(2),
            nn.Conv1d(32, FEATURES, 3, padding=1),
            nn.BatchNorm1d(FEATURES),
            nn.ReLU(),
        ),
    )


class Conv1dLstm(nn.Module):
    """Convolutions over time and an LSTM; scores from its last state and from the maximum over time of the convolved features."""

    def __init__(self, classes: int, size: tuple[int, int], channels: int) -> None:
        super().__init__()
        self.encoder = convolutions_over_time(size[0] * channels)
        self.recurrent = nn.LSTM(FEATURES, FEATURES, num_layers=2, batch_first=True)
        self.head = nn.Linear(2 * FEATURES, classes)

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) for maps (N, channels, speed, time)."""
        sequence = self.encoder(maps)
        states = self.recurrent(sequence.transpose(1, 2))[0]
        scores: Tensor = self.head(torch.cat([states[:, -1], sequence.amax(dim=2)], dim=1))
        return scores


CONV1D_LSTM = Network(
    ModelCard(
        title="Conv1D-LSTM",
        source="Donahue et al. 2015 in one dimension; encoder as in the published code of Text2Doppler",
        counted_at=(1, 224, 112),
        printed=Printed(simple=98.26, hard=80.80, gflops=0.008, mparams=0.111),
        note="It takes one channel, and the published code halves the time axis of a picture of 224 x 224 first.",
    ),
    Conv1dLstm,
)


class Attention(nn.Module):
    """Attention pooling: the sum over time of a sequence (N, T, C) with learned weights for each instant."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.weight = nn.Linear(width, 1)

    def forward(self, sequence: Tensor) -> Tensor:
        """The weighted sum over time, (N, C)."""
        weight = torch.softmax(self.weight(torch.tanh(sequence)), dim=1)
        return (weight * sequence).sum(dim=1)


class Conv1dAlstmFcn(nn.Module):
    """Two branches: three bidirectional recurrent layers with attention pooling, and two convolutions over eight instants."""

    def __init__(self, classes: int, size: tuple[int, int], channels: int) -> None:
        super().__init__()
        self.encoder = convolutions_over_time(size[0] * channels)
        self.recurrent = nn.LSTM(FEATURES, HIDDEN, num_layers=3, batch_first=True, bidirectional=True)
        self.attention = Attention(2 * HIDDEN)
        self.beside = nn.Sequential(
            nn.Conv1d(FEATURES, NARROW, 8),
            nn.BatchNorm1d(NARROW),
            nn.ReLU(),
            nn.Conv1d(NARROW, FEATURES, 8),
            nn.BatchNorm1d(FEATURES),
            nn.ReLU(),
        )
        self.head = nn.Linear(2 * HIDDEN + FEATURES, classes)

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) for maps (N, channels, speed, time)."""
        sequence = self.encoder(maps)
        attended = self.attention(self.recurrent(sequence.transpose(1, 2))[0])
        scores: Tensor = self.head(torch.cat([attended, self.beside(sequence).mean(dim=2)], dim=1))
        return scores


CONV1D_ALSTM_FCN = Network(
    ModelCard(
        title="Conv1D-ALSTM-FCN",
        source="Karim et al. 2018; sizes of layers as in the published code of Text2Doppler",
        least_size=32,
        counted_at=(1, 224, 112),
        printed=Printed(simple=99.48, hard=82.79, gflops=0.104, mparams=0.127),
        note="It takes one channel at half the time axis. The printed operations are eleven times what these layers take and "
        "thirteen times those of Conv1D-LSTM, whose layers are nearly the same; 0.0104 would fit.",
    ),
    Conv1dAlstmFcn,
)


class Crnn(nn.Module):
    """Three 5 x 5 convolutions that reduce the speeds, then two bidirectional recurrent layers over the remaining instants.

    If several speeds remain after pooling, their mean is used.
    """

    def __init__(self, classes: int, size: tuple[int, int], channels: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        in_channels = channels
        for pool in (5, 4, 2) if size[0] >= 96 else (3, 2, 2):
            layers += [nn.Conv2d(in_channels, WIDTH, 5, padding=1), nn.MaxPool2d((pool, 2)), nn.ReLU()]
            in_channels = WIDTH
        self.encoder = nn.Sequential(*layers)
        self.recurrent = nn.LSTM(WIDTH, HIDDEN, num_layers=2, batch_first=True, bidirectional=True)
        self.head = nn.Linear(2 * HIDDEN, classes)

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) for maps (N, channels, speed, time)."""
        sequence = self.encoder(maps).mean(dim=2).transpose(1, 2)
        scores: Tensor = self.head(self.recurrent(sequence)[0][:, -1])
        return scores


CRNN = Network(
    ModelCard(
        title="CRNN",
        source="Shi, Bai and Yao 2017; sizes of layers as in the published code of Text2Doppler",
        least_size=48,
        counted_at=(3, 96, 101),
        printed=Printed(simple=99.65, hard=86.95, gflops=0.415, mparams=0.895),
        note="Its operations were counted at 96 x 101 cells, the size in the comments of the published code. At 224 x 224 they are "
        "more.",
    ),
    Crnn,
)
