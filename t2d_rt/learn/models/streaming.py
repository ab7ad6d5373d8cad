"""A small causal network for continuous operation of a radar: it processes one column of a spectrogram at a time and classifies
what it has seen so far.

Maps may have any duration.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from t2d_rt.learn.models import ModelCard, Network

WIDTH, TAPS, DILATIONS = 64, 3, (1, 2, 4)


@dataclass(frozen=True, slots=True)
class StreamState:
    """State of the network between two columns."""

    before: tuple[Tensor, ...]
    """Latest inputs of each convolution over time, (N, WIDTH, (TAPS - 1) x dilation)."""
    hidden: Tensor
    """State of the GRU, (1, N, WIDTH)."""
    total: Tensor
    """Sum of the GRU's outputs so far, (N, WIDTH)."""
    greatest: Tensor
    """Maximum of the GRU's outputs so far, (N, WIDTH)."""
    count: int
    """Number of columns so far."""


class Streaming(nn.Module):
    """A linear layer from the speeds of a column to 64 features, causal convolutions over time, and a GRU; scores from the mean and
    the maximum of its outputs."""

    def __init__(self, classes: int, size: tuple[int, int], channels: int) -> None:
        super().__init__()
        self.column = nn.Sequential(
            nn.Conv2d(channels, 8, (5, 1), stride=(2, 1), padding=(2, 0)),
            nn.BatchNorm2d(8),
            nn.ReLU(),
            nn.Conv2d(8, 16, (5, 1), stride=(2, 1), padding=(2, 0)),
            nn.BatchNorm2d(16),
            nn.ReLU(),
        )
        self.mixed = nn.Sequential(nn.Conv1d(16 * (-(-size[0] // 4)), WIDTH, 1), nn.BatchNorm1d(WIDTH), nn.ReLU())
        self.causal = nn.ModuleList(nn.Conv1d(WIDTH, WIDTH, TAPS, dilation=dilation) for dilation in DILATIONS)
        self.norms = nn.ModuleList(nn.BatchNorm1d(WIDTH) for _ in DILATIONS)
        self.recurrent = nn.GRU(WIDTH, WIDTH, batch_first=True)
        self.head = nn.Linear(2 * WIDTH, classes)

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) after the last column."""
        scores, _ = self.step(maps, self.begun(len(maps), maps))
        return scores

    def begun(self, count: int, like: Tensor | None = None) -> StreamState:
        """The state before the first column, for `count` maps."""
        base = self.head.weight if like is None else like
        return StreamState(
            before=tuple(base.new_zeros(count, WIDTH, (TAPS - 1) * dilation) for dilation in DILATIONS),
            hidden=base.new_zeros(1, count, WIDTH),
            total=base.new_zeros(count, WIDTH),
            greatest=base.new_full((count, WIDTH), -torch.inf),
            count=0,
        )

    def step(self, columns: Tensor, state: StreamState) -> tuple[Tensor, StreamState]:
        """Scores after one or more further columns (N, channels, speed, T), and the new state."""
        sequence = self.mixed(self.column(columns).flatten(1, 2))
        before = []
        for convolution, norm, earlier in zip(self.causal, self.norms, state.before, strict=True):
            inputs = torch.cat([earlier, sequence], dim=2)
            before.append(inputs[:, :, inputs.shape[2] - earlier.shape[2] :])
            sequence = sequence + torch.relu(norm(convolution(inputs)))
        outputs, hidden = self.recurrent(sequence.transpose(1, 2), state.hidden)
        total = state.total + outputs.sum(dim=1)
        greatest = torch.maximum(state.greatest, outputs.amax(dim=1))
        count = state.count + outputs.shape[1]
        scores = self.head(torch.cat([total / count, greatest], dim=1))
        return scores, StreamState(tuple(before), hidden, total, greatest, count)


STREAMING = Network(
    ModelCard(
        title="streaming",
        source="of this project: dilated causal convolutions (van den Oord et al. 2016) and a GRU (Cho et al. 2014)",
        counted_at=(1, 64, 64),
    ),
    Streaming,
)
