"""VGG-7: six convolutions of 3 x 3 in pairs, each pair followed by pooling, and one linear layer."""

from __future__ import annotations

from itertools import pairwise

from torch import nn

from t2d_rt.learn.models.registry import ModelCard, Printed

ABOUT = ModelCard(
    title="VGG-7",
    source="Simonyan and Zisserman 2015, with batch normalisation; widths chosen to meet the printed figures",
    printed=Printed(simple=98.44, hard=87.87, gflops=2.095, mparams=0.298),
)
WIDTHS = 24, 48, 64, 64, 128, 128
"""Pairs as in VGG; of such widths these come nearest to the printed parameters and operations."""


def build(classes: int, size: tuple[int, int], channels: int) -> nn.Module:
    """The network; the mean over the map makes it fit any size."""
    layers: list[nn.Module] = []
    for number, (given, width) in enumerate(pairwise((channels, *WIDTHS))):
        layers += [nn.Conv2d(given, width, 3, padding=1, bias=False), nn.BatchNorm2d(width), nn.ReLU()]
        if number % 2 == 1:
            layers.append(nn.MaxPool2d(2))
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(WIDTHS[-1], classes))
