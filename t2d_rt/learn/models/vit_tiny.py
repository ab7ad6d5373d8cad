"""ViT-Tiny of MONAI: twelve layers of three heads on tokens of 192 numbers."""

from __future__ import annotations

from monai.networks.nets import ViT
from torch import Tensor, nn

from t2d_rt.core.errors import InputError
from t2d_rt.learn.models.registry import ModelCard, Printed

ABOUT = ModelCard(
    title="ViT-Tiny",
    source="Dosovitskiy et al. 2021 at the width of DeiT-Ti (Touvron et al. 2021), by MONAI",
    printed=Printed(simple=99.48, hard=79.64, gflops=1.433, mparams=7.261),
    note="The printed parameters contain 1.77 M of cross-attention that MONAI 1.4 made in each layer and never uses, and the "
    "printed operations count the products of attention twice.",
)
IDLE_PARAMETERS = 12 * (4 * 192 * 192 + 192)
"""Of cross-attention in twelve layers: queries, keys, values and output."""
COARSE = 128
"""From this size on a token covers 16 x 16 cells, below 8 x 8, so that there are 64 or more of them."""


class TokensOfMaps(nn.Module):
    """MONAI's network without the states of its layers, which it gives beside the scores."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) of maps (N, channels, speed, time)."""
        scores: Tensor = self.network(maps)[0]
        return scores


def build(classes: int, size: tuple[int, int], channels: int) -> nn.Module:
    """The network for maps of this size, whose cells whole tokens must cover."""
    patch = 16 if min(size) >= COARSE else 8
    if size[0] % patch or size[1] % patch:
        raise InputError(f"vit-tiny needs multiples of {patch} cells, got {size[0]} x {size[1]}; resize the maps")
    network = ViT(
        channels, size, patch, hidden_size=192, mlp_dim=768, num_layers=12, num_heads=3, classification=True, num_classes=classes,
        spatial_dims=2, post_activation="",
    )  # fmt: skip
    return TokensOfMaps(network)
