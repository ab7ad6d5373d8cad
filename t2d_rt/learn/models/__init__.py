"""Networks that classify spectrograms, by name; and counts of a network's parameters and operations, made while it runs.

A network is described by a card and a function that builds it untrained. It maps inputs (N, channels, speed, time), 1 at the
greatest cell and 0 at the end of the dynamic range, to scores (N, classes). Networks of other packages are modules with ABOUT, a
`ModelCard`, and `build(classes, size, channels)` (docs/extend.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from t2d_rt.core.checks import integer, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.plugins import loaded, plugins
from t2d_rt.learn.maps import checked_size
from t2d_rt.learn.pytorch import require_learning

if TYPE_CHECKING:
    from torch import nn

OWN = {
    "conv1d-alstm-fcn": "recurrent.CONV1D_ALSTM_FCN",
    "conv1d-lstm": "recurrent.CONV1D_LSTM",
    "crnn": "recurrent.CRNN",
    "envelope": "envelope.ENVELOPE",
    "resnet18": "pictures.RESNET_18",
    "streaming": "streaming.STREAMING",
    "vgg-7": "pictures.VGG_7",
    "vit-tiny": "pictures.VIT_TINY",
}
"""Module and value that define each network; loading one loads PyTorch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Printed:
    """Figures that Table III of Text2Doppler prints for a model; the headers of its last two columns are exchanged there."""

    simple: float
    """Accuracy on Simple [%]."""
    hard: float
    """Accuracy on Hard [%]."""
    gflops: float
    """Multiply-accumulate operations [1e9]."""
    mparams: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCard:
    """Description of a model."""

    title: str
    source: str
    """Publication or code on which its structure is based."""
    least_size: int = 16
    """Least number of cells of speed and of time."""
    usual_size: int = 64
    """Number of cells of speed and of time that `t2d-rt train` uses."""
    counted_at: tuple[int, int, int] = (3, 224, 224)
    """Channels, cells of speed and of time for which its operations are counted for the comparison with the table."""
    printed: Printed | None = None
    note: str = ""
    """Why its figures differ from the printed ones, if they do."""


@dataclass(frozen=True, slots=True)
class Network:
    """A model's card, and the function that builds it."""

    about: ModelCard
    build: Callable[[int, tuple[int, int], int], nn.Module]
    """Builds the network for a number of classes, cells (speed, time) and channels."""


def model_names() -> list[str]:
    """Names of the models, those of other packages included."""
    return sorted([*OWN, *plugins("models", OWN)])


def card(name: str) -> ModelCard:
    """The card of a model, by the model's name."""
    return _network(name).about


def build(name: str, classes: int, size: tuple[int, int] = (64, 64), channels: int = 1) -> nn.Module:
    """An untrained model of so many classes, for maps of so many cells of speed and time.

    Raises InputError for an unknown name, for maps that are too small, and where PyTorch is not installed.
    """
    network, cells = _network(name), checked_size(size)
    integer("classes", classes, 2, 10_000)
    least = network.about.least_size
    if min(cells) < least:
        raise InputError(
            f"{name} needs maps of {least} x {least} cells or more, got {cells[0]} x {cells[1]}; resize them"
        )
    return network.build(classes, cells, integer("channels", channels, 1, 16))


def _network(name: str) -> Network:
    """A network by its name, from t2d-rt or another package."""
    others = plugins("models", OWN)
    key = str(name).lower().replace("_", "-")
    if key not in OWN and key not in others:
        raise unknown_name("model", name, model_names())
    require_learning()
    if key in OWN:
        module, value = OWN[key].split(".")
        own: Network = getattr(import_module(f"t2d_rt.learn.models.{module}"), value)
        return own
    network = loaded(others[key])
    if not isinstance(getattr(network, "ABOUT", None), ModelCard) or not callable(getattr(network, "build", None)):
        raise InputError(
            f"the model {key} of another package must have ABOUT, a ModelCard, and build; see docs/extend.md"
        )
    return Network(network.ABOUT, network.build)


@dataclass(frozen=True, slots=True)
class Count:
    """Size of a network, and operations for one map."""

    parameters: int
    gflops: float
    """Multiply-accumulate operations [1e9] of convolutions, matrix products and recurrent layers; tables of such networks print
    these as GFLOPs."""
    attention_gflops: float
    """Those of them in the matrix products of attention; some counters count these twice."""


def count(network: nn.Module, size: tuple[int, int, int]) -> Count:
    """Counts parameters and operations of a network for an input of (channels, speed, time)."""
    require_learning()
    import warnings

    import torch
    from torch.utils.flop_counter import FlopCounterMode

    was_training = network.training
    network.eval()
    # Without oneDNN an LSTM runs as matrix products, which are counted; with it as a single operation, which is not.
    with_onednn = not any(isinstance(module, torch.nn.LSTM) for module in network.modules())
    with warnings.catch_warnings(), torch.no_grad(), FlopCounterMode(display=False) as counter:
        # PyTorch warns when oneDNN is switched, on every machine without a GPU by Intel.
        warnings.filterwarnings("ignore", message="TF32 acceleration")
        with torch.backends.mkldnn.flags(enabled=with_onednn):
            network(torch.zeros(1, *size))
    network.train(was_training)
    operations = {str(kind): value for kind, value in counter.get_flop_counts()["Global"].items()}
    attention = sum(value for kind, value in operations.items() if "bmm" in kind or "attention" in kind)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    return Count(parameters, sum(operations.values()) / 2e9, attention / 2e9)
