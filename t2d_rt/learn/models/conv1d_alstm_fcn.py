"""Conv1D-ALSTM-FCN: beside the recurrent layers, whose instants attention weights, convolutions of their own."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from t2d_rt.learn.models.layers import Attention, SpeedsAsChannels, convolutions_over_time
from t2d_rt.learn.models.registry import ModelCard, Printed

ABOUT = ModelCard(
    title="Conv1D-ALSTM-FCN",
    source="Karim et al. 2018; sizes of layers as in the published code of Text2Doppler",
    least_size=32,
    counted_at=(1, 224, 112),
    printed=Printed(simple=99.48, hard=82.79, gflops=0.104, mparams=0.127),
    note="It takes one channel at half the time axis. The printed operations are eleven times what these layers take and thirteen "
    "times those of Conv1D-LSTM, whose layers are nearly the same; 0.0104 would fit.",
)
HIDDEN, NARROW = 32, 8


class AttentionBesideConvolutions(nn.Module):
    """Three recurrent layers in both directions with attention; two convolutions of eight instants."""

    def __init__(self, classes: int, speeds: int) -> None:
        super().__init__()
        self.encoder = nn.Sequential(SpeedsAsChannels(), convolutions_over_time(speeds))
        self.recurrent = nn.LSTM(64, HIDDEN, num_layers=3, batch_first=True, bidirectional=True)
        self.attention = Attention(2 * HIDDEN)
        self.beside = nn.Sequential(
            nn.Conv1d(64, NARROW, 8),
            nn.BatchNorm1d(NARROW),
            nn.ReLU(),
            nn.Conv1d(NARROW, 64, 8),
            nn.BatchNorm1d(64),
            nn.ReLU(),
        )
        self.head = nn.Linear(2 * HIDDEN + 64, classes)

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) of maps (N, channels, speed, time)."""
        sequence = self.encoder(maps)
        attended = self.attention(self.recurrent(sequence.transpose(1, 2))[0])
        scores: Tensor = self.head(torch.cat([attended, self.beside(sequence).mean(dim=2)], dim=1))
        return scores


def build(classes: int, size: tuple[int, int], channels: int) -> nn.Module:
    """The untrained network for maps of this size."""
    return AttentionBesideConvolutions(classes, size[0] * channels)
