"""CRNN: three convolutions of 5 x 5 that merge the speeds, and two recurrent layers over time."""

from __future__ import annotations

from torch import Tensor, nn

from t2d_rt.learn.models.registry import ModelCard, Printed

ABOUT = ModelCard(
    title="CRNN",
    source="Shi, Bai and Yao 2017; sizes of layers as in the published code of Text2Doppler",
    least_size=48,
    counted_at=(3, 96, 101),
    printed=Printed(simple=99.65, hard=86.95, gflops=0.415, mparams=0.895),
    note="Its operations were counted at 96 x 101 cells, the size in the comments of the published code."
    " At 224 x 224 they are more.",
)
WIDTH, HIDDEN = 128, 32


class ConvolutionsThenTime(nn.Module):
    """Convolutions, then an LSTM in both directions over what is left of time."""

    def __init__(self, classes: int, speeds: int, channels: int) -> None:
        super().__init__()
        pools = (5, 4, 2) if speeds >= 96 else (3, 2, 2)
        layers: list[nn.Module] = []
        for number, pool in enumerate(pools):
            layers += [
                nn.Conv2d(WIDTH if number else channels, WIDTH, 5, padding=1),
                nn.MaxPool2d((pool, 2)),
                nn.ReLU(),
            ]
        self.encoder = nn.Sequential(*layers)
        self.recurrent = nn.LSTM(WIDTH, HIDDEN, num_layers=2, batch_first=True, bidirectional=True)
        self.head = nn.Linear(2 * HIDDEN, classes)

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) of maps (N, channels, speed, time)."""
        sequence = self.encoder(maps).mean(dim=2).transpose(1, 2)
        scores: Tensor = self.head(self.recurrent(sequence)[0][:, -1])
        return scores


def build(classes: int, size: tuple[int, int], channels: int) -> nn.Module:
    """The network; where pooling leaves several speeds, their mean is taken."""
    return ConvolutionsThenTime(classes, size[0], channels)
