"""ResNet-18 of MONAI."""

from __future__ import annotations

from monai.networks.nets import resnet18
from torch import nn

from t2d_rt.learn.models.registry import ModelCard, Printed

ABOUT = ModelCard(
    title="ResNet-18",
    source="He et al. 2016, by MONAI",
    printed=Printed(simple=98.96, hard=91.26, gflops=1.824, mparams=11.180),
)


def build(classes: int, size: tuple[int, int], channels: int) -> nn.Module:
    """The network, with the stem of 7 x 7 at a stride of 2."""
    network: nn.Module = resnet18(
        spatial_dims=2,
        n_input_channels=channels,
        num_classes=classes,
        conv1_t_stride=2,
        shortcut_type="B",
        bias_downsample=False,
    )
    return network
