"""Ways to use real events: what of the network is tuned, and from where it starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from t2d_rt.core.errors import InputError, install
from t2d_rt.learn.transfer.events import Events

try:
    import torch
    from torch import Tensor, nn

    from t2d_rt.learn.transfer.network import EventNet, SkipTuned
except ImportError:
    raise InputError(f"transfer needs PyTorch, which is not installed; {install('learn')}") from None

SHIFT_ROWS = 8
"""Greatest shift in time of an augmented event."""
GAIN = 0.3
"""Greatest change of scale of an augmented event's levels."""
BATCH = 16
DECAY = 1e-3


@dataclass(frozen=True, slots=True)
class Schedule:
    """How long and how fast a network learns; AdamW, cosine to zero."""

    epochs: int
    rate: float


PRETRAINING = Schedule(30, 2e-3)
TUNING = Schedule(40, 1e-3)
HEADS = Schedule(120, 5e-3)
"""Of layers over features that are computed once."""


def seeded(seed: int) -> None:
    """One thread and one seed: the same weights bit for bit on one machine."""
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    torch.manual_seed(seed)


def augmented(inputs: Tensor, generator: torch.Generator) -> Tensor:
    """Events (B, V, speed, time) shifted in time, scaled, half of them with the radars' speeds turned round, one by one."""
    found = []
    for event in inputs:
        shift = int(torch.randint(-SHIFT_ROWS, SHIFT_ROWS + 1, (1,), generator=generator))
        scale = 1.0 + GAIN * (2.0 * float(torch.rand(1, generator=generator)) - 1.0)
        views = torch.roll(event, shift, dims=2) * scale
        mirrored = torch.rand(len(event), generator=generator) < 0.5
        found.append(torch.where(mirrored[:, None, None], views.flip(1), views))
    return torch.stack(found)


def fitted(
    module: nn.Module, inputs: Tensor, labels: Tensor, schedule: Schedule, seed: int, *, augment: bool
) -> nn.Module:
    """The module after training all parameters that may change; classes weigh alike."""
    generator = torch.Generator().manual_seed(seed)
    tuned = [each for each in module.parameters() if each.requires_grad]
    optimizer = torch.optim.AdamW(tuned, lr=schedule.rate, weight_decay=DECAY)
    rates = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, schedule.epochs)
    counts = torch.bincount(labels, minlength=int(labels.max()) + 1).clamp(min=1)
    weight = (len(labels) / len(counts) / counts)[labels]
    module.train()
    for _ in range(schedule.epochs):
        for chosen in torch.randperm(len(labels), generator=generator).split(BATCH):
            batch = augmented(inputs[chosen], generator) if augment else inputs[chosen]
            loss = nn.functional.cross_entropy(module(batch), labels[chosen], reduction="none", label_smoothing=0.05)
            optimizer.zero_grad()
            (loss * weight[chosen]).mean().backward()
            optimizer.step()
        rates.step()
    return module.eval()


def network(classes: int, seed: int) -> EventNet:
    """A network of random weights."""
    seeded(seed)
    return EventNet(classes)


def pretrained(simulated: Events, seed: int) -> EventNet:
    """A network that learned from simulated events alone."""
    net = network(len(simulated.classes), seed)
    fitted(net, torch.from_numpy(simulated.inputs), torch.from_numpy(simulated.labels), PRETRAINING, seed, augment=True)
    return net


def predicted(module: Callable[[Tensor], Tensor], inputs: Tensor) -> np.ndarray:
    """The class of the greatest score of each event, (E,)."""
    with torch.no_grad():
        return np.asarray(module(inputs).argmax(dim=1).numpy(), dtype=np.int64)


def _frozen(parameters: Iterable[nn.Parameter]) -> None:
    for each in parameters:
        each.requires_grad_(False)


def _over_encoder(net: EventNet, layers: nn.Module, train: Events, test: Events, seed: int) -> np.ndarray:
    with torch.no_grad():
        known, asked = (net.encoded(torch.from_numpy(each.inputs)) for each in (train, test))
    fitted(layers, known, torch.from_numpy(train.labels), HEADS, seed, augment=False)
    return predicted(layers, asked)


class _Top(nn.Module):
    """Penultimate layer and head of a network."""

    def __init__(self, net: EventNet, *, new_head: bool, frozen: bool) -> None:
        super().__init__()
        self.penultimate = net.penultimate
        self.head = nn.Linear(net.head.in_features, net.head.out_features) if new_head else net.head
        if frozen:
            _frozen(self.penultimate.parameters())

    def forward(self, encoded: Tensor) -> Tensor:
        return self.head(torch.relu(self.penultimate(encoded)).mean(dim=1))


def linear_probe(net: EventNet, train: Events, test: Events, seed: int) -> np.ndarray:
    """A new head over frozen features."""
    return _over_encoder(net, _Top(net, new_head=True, frozen=True), train, test, seed)


def last_layer(net: EventNet, train: Events, test: Events, seed: int) -> np.ndarray:
    """Penultimate layer and head go on learning, the convolutions are frozen."""
    return _over_encoder(net, _Top(net, new_head=False, frozen=False), train, test, seed)


def skip_connection(net: EventNet, train: Events, test: Events, seed: int) -> np.ndarray:
    """Two new layers and the head learn; a skip connection passes the frozen penultimate features on beside them."""
    layers = SkipTuned(net)
    _frozen(layers.frozen.parameters())
    return _over_encoder(net, layers, train, test, seed)


def full(net: EventNet, train: Events, test: Events, seed: int) -> np.ndarray:
    """All weights go on learning."""
    fitted(net, torch.from_numpy(train.inputs), torch.from_numpy(train.labels), TUNING, seed, augment=True)
    return predicted(net, torch.from_numpy(test.inputs))


@dataclass(frozen=True, slots=True)
class Method:
    """What is tuned, and whether the network knows simulation."""

    tune: Callable[[EventNet, Events, Events, int], np.ndarray]
    knows_simulation: bool


METHODS: dict[str, Method] = {
    "linear probing": Method(linear_probe, True),
    "last layer": Method(last_layer, True),
    "skip connection": Method(skip_connection, True),
    "full fine-tuning": Method(full, True),
    "from scratch": Method(full, False),
    "frozen random encoder": Method(linear_probe, False),
}
"""Table IV, and the two that tell what simulation is worth."""


def tuned_labels(method: str, known: EventNet, train: Events, test: Events, seed: int) -> np.ndarray:
    """Labels of the test events after tuning on the others; `known` itself stays as it is."""
    seeded(seed)
    chosen = METHODS[method]
    net = deepcopy(known) if chosen.knows_simulation else network(len(train.classes), seed)
    return chosen.tune(net, train, test, seed)
