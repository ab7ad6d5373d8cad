"""Models by name: the files of this folder that have an ABOUT; and parameters and operations of a network, counted as it runs."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.core.checks import integer, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.plugins import loaded, plugins
from t2d_rt.learn.maps import checked_size
from t2d_rt.learn.pytorch import require_learning

if TYPE_CHECKING:
    from torch import nn


OTHERS = "__init__", "registry", "layers"
"""Files of the folder that are no models."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Printed:
    """What Table III of Text2Doppler prints of a model; the headers of its last two columns are exchanged there."""

    simple: float
    """Accuracy on Simple [%]."""
    hard: float
    """Accuracy on Hard [%]."""
    gflops: float
    """Multiplications with their additions [1e9]."""
    mparams: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCard:
    """What a model is."""

    title: str
    source: str
    """Where its structure is from."""
    least_size: int = 16
    """Cells of speed and of time at least."""
    usual_size: int = 64
    """Cells of speed and of time that `t2d-rt train` takes."""
    counted_at: tuple[int, int, int] = (3, 224, 224)
    """Channels, speed and time at which it is counted beside the table."""
    printed: Printed | None = None
    note: str = ""
    """Why its figures differ from the printed ones, where they do."""


def model_names() -> list[str]:
    """Names of the models, those of other packages included."""
    own = _own()
    return sorted([*own, *plugins("models", own)])


def _own() -> list[str]:
    folder = Path(__file__).parent
    return [each.stem.replace("_", "-") for each in folder.glob("*.py") if each.stem not in OTHERS]


def card(name: str) -> ModelCard:
    """What a model is, by its name."""
    found: ModelCard = _module(name).ABOUT
    return found


def build(name: str, classes: int, size: tuple[int, int] = (64, 64), channels: int = 1) -> nn.Module:
    """An untrained model of so many classes, for maps of so many cells of speed and time."""
    module, wanted = _module(name), checked_size(size)
    integer("classes", classes, 2, 10_000)
    if min(wanted) < module.ABOUT.least_size:
        least = module.ABOUT.least_size
        raise InputError(
            f"{name} needs maps of {least} x {least} cells or more, got {wanted[0]} x {wanted[1]}; resize them"
        )
    network: nn.Module = module.build(classes, wanted, integer("channels", channels, 1, 16))
    return network


def _module(name: str) -> Any:
    if str(name).lower().replace("_", "-") not in model_names():
        raise unknown_name("model", name, model_names())
    require_learning()
    wanted, own = name.lower().replace("_", "-"), _own()
    if wanted in own:
        return import_module(f"t2d_rt.learn.models.{wanted.replace('-', '_')}")
    found = loaded(plugins("models", own)[wanted])
    if not isinstance(getattr(found, "ABOUT", None), ModelCard) or not callable(getattr(found, "build", None)):
        raise InputError(
            f"the model {wanted} of another package must have ABOUT, a ModelCard, and build; see docs/extend.md"
        )
    return found


@dataclass(frozen=True, slots=True)
class Count:
    """What a network has and does for one map."""

    parameters: int
    gflops: float
    """Multiplications with their additions [1e9], of convolutions, matrix products and recurrent layers; the tables of such
    networks print these as GFLOPs."""
    attention_gflops: float
    """Those of the products of attention among them; some counters add these twice."""


def count(network: nn.Module, size: tuple[int, int, int]) -> Count:
    """Counts of a network at an input of channels, speed and time."""
    require_learning()
    import warnings

    import torch
    from torch.utils.flop_counter import FlopCounterMode

    before = network.training
    network.eval()
    # Without oneDNN an LSTM runs as matrix products, which are counted; with it as one operation, which is not.
    with warnings.catch_warnings(), torch.no_grad(), FlopCounterMode(display=False) as counter:
        warnings.filterwarnings(
            "ignore", message="TF32 acceleration"
        )  # of switching oneDNN, on any machine without Intel's GPU
        with torch.backends.mkldnn.flags(
            enabled=not any(isinstance(each, torch.nn.LSTM) for each in network.modules())
        ):
            network(torch.zeros(1, *size))
    network.train(before)
    found = {str(kind): value for kind, value in counter.get_flop_counts()["Global"].items()}
    attention = sum(value for kind, value in found.items() if "bmm" in kind or "attention" in kind)
    parameters = sum(each.numel() for each in network.parameters())
    return Count(parameters, sum(found.values()) / 2e9, attention / 2e9)
