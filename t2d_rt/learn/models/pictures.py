"""Networks that treat a map as a picture: VGG-7, and MONAI's ResNet-18 and ViT-Tiny (Table III of Text2Doppler)."""

from __future__ import annotations

from itertools import pairwise

from torch import Tensor, nn

from t2d_rt.core.errors import InputError
from t2d_rt.learn.models import ModelCard, Network, Printed

VGG_WIDTHS = 24, 48, 64, 64, 128, 128
"""Channels of the convolutions, in pairs as in VGG; of such widths these come closest to the printed parameters and operations."""


def vgg_7(classes: int, size: tuple[int, int], channels: int) -> nn.Module:
    """Six 3 x 3 convolutions in pairs, each pair followed by pooling; then the mean over the map and a linear layer."""
    layers: list[nn.Module] = []
    for number, (in_channels, width) in enumerate(pairwise((channels, *VGG_WIDTHS))):
        layers += [nn.Conv2d(in_channels, width, 3, padding=1, bias=False), nn.BatchNorm2d(width), nn.ReLU()]
        if number % 2 == 1:
            layers.append(nn.MaxPool2d(2))
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(VGG_WIDTHS[-1], classes))


VGG_7 = Network(
    ModelCard(
        title="VGG-7",
        source="Simonyan and Zisserman 2015, with batch normalisation; widths chosen to meet the printed figures",
        printed=Printed(simple=98.44, hard=87.87, gflops=2.095, mparams=0.298),
    ),
    vgg_7,
)


def resnet_18(classes: int, size: tuple[int, int], channels: int) -> nn.Module:
    """ResNet-18 with a 7 x 7 first convolution at stride 2."""
    from monai.networks.nets import resnet18  # loaded here, as it takes seconds and VGG-7 does not need it

    network: nn.Module = resnet18(
        spatial_dims=2,
        n_input_channels=channels,
        num_classes=classes,
        conv1_t_stride=2,
        shortcut_type="B",
        bias_downsample=False,
    )
    return network


RESNET_18 = Network(
    ModelCard(
        title="ResNet-18",
        source="He et al. 2016, by MONAI",
        printed=Printed(simple=98.96, hard=91.26, gflops=1.824, mparams=11.180),
    ),
    resnet_18,
)

COARSE = 128
"""Number of cells of a map from which on a token of ViT-Tiny covers 16 x 16 of them; below that 8 x 8, so that maps of 64 x 64
cells and more have at least 64 tokens."""
IDLE_PARAMETERS = 12 * (4 * 192 * 192 + 192)
"""Number of parameters of the cross-attention in the twelve layers of ViT-Tiny, which MONAI 1.4 had: queries, keys, values and
output."""


class VitTiny(nn.Module):
    """Twelve layers with three heads on tokens of 192 numbers; MONAI's network also returns the states of its layers.

    Raises InputError where whole tokens do not cover the map.
    """

    def __init__(self, classes: int, size: tuple[int, int], channels: int) -> None:
        from monai.networks.nets import ViT

        super().__init__()
        patch = 16 if min(size) >= COARSE else 8
        if size[0] % patch or size[1] % patch:
            raise InputError(f"vit-tiny needs multiples of {patch} cells, got {size[0]} x {size[1]}; resize the maps")
        self.network = ViT(
            channels,
            size,
            patch,
            hidden_size=192,
            mlp_dim=768,
            num_layers=12,
            num_heads=3,
            classification=True,
            num_classes=classes,
            spatial_dims=2,
            post_activation="",
        )

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) for maps (N, channels, speed, time)."""
        scores: Tensor = self.network(maps)[0]
        return scores


VIT_TINY = Network(
    ModelCard(
        title="ViT-Tiny",
        source="Dosovitskiy et al. 2021 at the width of DeiT-Ti (Touvron et al. 2021), by MONAI",
        printed=Printed(simple=99.48, hard=79.64, gflops=1.433, mparams=7.261),
        note="The printed parameters contain 1.77 M of cross-attention that MONAI 1.4 made in each layer and never uses, and the "
        "printed operations count the products of attention twice.",
    ),
    VitTiny,
)
