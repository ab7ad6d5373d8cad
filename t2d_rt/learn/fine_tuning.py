"""Fine-tuning: a network pre-trained on simulated events is trained further on a few real ones (Table IV of Text2Doppler).

An event is what all radars in a room record of one motion. The four strategies differ in which layers are trained further.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.checks import choice
from t2d_rt.core.errors import InputError, install
from t2d_rt.learn.maps import LabelledMaps, check_axes
from t2d_rt.learn.pytorch import torch_threads

try:
    import torch
    from torch import Tensor, nn
except ImportError:
    raise InputError(f"fine-tuning needs PyTorch, which is not installed; {install('learn')}") from None

SPEED_CELLS = 64
"""Number of speed cells of a network's input; Doppler bins are merged by averaging their levels."""
SCALE_DB = 10.0
GREATEST = 4.0
"""Input values are clipped at this level; they are levels above the median, divided by SCALE_DB."""
SHIFT_ROWS = 8
"""Greatest shift in time of an augmented event [rows]."""
GAIN = 0.3
"""Greatest relative change of scale of an augmented event's levels."""
BATCH = 16
DECAY = 1e-3
CHANNELS = 12, 24, 32
SPEEDS_KEPT = 4
FEATURES = 48
"""Number of features in the penultimate layer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Events:
    """Events, with the maps of V radars for each."""

    levels: np.ndarray
    """Levels (E, V, speed, time), float32 [dB below each map's greatest cell]."""
    labels: np.ndarray
    """Index of the class of each event, (E,) int64."""
    classes: tuple[str, ...]
    names: tuple[str, ...]
    radars: tuple[str, ...]
    velocity_mps: np.ndarray
    """Speeds [m/s], ascending, positive = approaching, (speed,)."""
    duration_s: float
    """Duration of a map [s]."""

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def of(cls, maps: LabelledMaps) -> Events:
        """Events from maps whose groups include `event` and `radar`; without a radar each event has one map."""
        if "event" not in maps.groups:
            raise InputError(
                f"maps need a group 'event', got {', '.join(maps.groups) or 'none'}; an event stands on one side only"
            )
        radar = maps.groups.get("radar", np.full(len(maps), "radar"))
        radars, events = tuple(dict.fromkeys(radar.tolist())), tuple(dict.fromkeys(maps.groups["event"].tolist()))
        places = {
            (event, radar_name): place
            for place, (event, radar_name) in enumerate(zip(maps.groups["event"], radar, strict=True))
        }
        if len(places) != len(maps) or len(places) != len(events) * len(radars):
            raise InputError(
                f"each of {len(events)} events needs one map by each of {len(radars)} radars, got {len(maps)} maps"
            )
        table = np.array([[places[event, radar_name] for radar_name in radars] for event in events])
        labels = maps.labels[table]
        if np.any(labels != labels[:, :1]):
            raise InputError("an event has maps of two classes; give each event one class")
        return cls(
            levels=maps.levels[table],
            labels=labels[:, 0],
            classes=maps.classes,
            names=events,
            radars=radars,
            velocity_mps=maps.velocity_mps,
            duration_s=maps.duration_s,
        )

    def seen_by(self, radar: str) -> Events:
        """The events with the maps of one radar only."""
        if radar not in self.radars:
            raise InputError(f"there is no radar '{radar}'; choose from {', '.join(self.radars)}")
        place = self.radars.index(radar)
        return replace(self, levels=self.levels[:, place : place + 1], radars=(radar,))

    def take(self, indices: np.ndarray | Sequence[int]) -> Events:
        """The events at these positions, in this order."""
        positions = np.asarray(indices)
        return replace(
            self,
            levels=self.levels[positions],
            labels=self.labels[positions],
            names=tuple(self.names[place] for place in positions),
        )

    @property
    def above_median_db(self) -> np.ndarray:
        """Levels relative to the median of each map, which is noise [dB], (E, V, speed, time)."""
        return np.asarray(self.levels - np.median(self.levels, axis=(2, 3), keepdims=True))

    @property
    def inputs(self) -> np.ndarray:
        """Inputs of a network, (E, V, SPEED_CELLS, time) float32, 0..GREATEST."""
        above = self.above_median_db
        events, views, speeds, times = above.shape
        if speeds % SPEED_CELLS:
            raise InputError(f"maps for transfer need a multiple of {SPEED_CELLS} speeds, got {speeds}; resize them")
        joined = above.reshape(events, views, SPEED_CELLS, speeds // SPEED_CELLS, times).mean(axis=3)
        return np.asarray(np.clip(joined / SCALE_DB, 0.0, GREATEST), dtype=np.float32)

    def same_axes(self, other: Events) -> None:
        """Refuses events with other classes, cells, speeds or duration."""
        if other.classes != self.classes or other.levels.shape[2:] != self.levels.shape[2:]:
            raise InputError(
                f"simulated events of {other.classes}, {other.levels.shape[2:]} cells, do not fit real ones of {self.classes}, "
                f"{self.levels.shape[2:]} cells; bring them to the same classes and size"
            )
        check_axes(self, other)


class EventNet(nn.Module):
    """Network of convolutions over speed and time, mean and maximum over time, one hidden layer, mean over radars, and a linear
    head."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = 1
        for after in CHANNELS:
            layers += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.GroupNorm(4, after), nn.ReLU()]
            before = after
        self.encoder = nn.Sequential(*layers)
        self.penultimate = nn.Linear(2 * before * SPEEDS_KEPT, FEATURES)
        self.head = nn.Linear(FEATURES, classes)

    def encoded(self, inputs: Tensor) -> Tensor:
        """Output of the convolutions for inputs (B, V, speed, time), (B, V, 2 * channels * SPEEDS_KEPT)."""
        batch, views = inputs.shape[:2]
        encoding = self.encoder(inputs.flatten(0, 1)[:, None])
        encoding = encoding.unflatten(2, (SPEEDS_KEPT, encoding.shape[2] // SPEEDS_KEPT)).mean(dim=3)
        pooled = torch.cat([encoding.mean(dim=3), encoding.amax(dim=3)], dim=1)
        return pooled.flatten(1).unflatten(0, (batch, views))

    def forward(self, inputs: Tensor) -> Tensor:
        """Scores (B, K) for inputs (B, V, speed, time)."""
        return self.head(torch.relu(self.penultimate(self.encoded(inputs))).mean(dim=1))


class Top(nn.Module):
    """Penultimate layer and head of a network, applied to the output of its convolutions; optionally with additional layers that
    are bypassed by a skip connection.

    The last additional layer starts with zero weights, so that they have no effect at first. (A layer added before the nonlinearity
    would be equivalent to tuning the penultimate layer itself.)
    """

    def __init__(self, penultimate: nn.Linear, head: nn.Linear, *, beside: bool = False) -> None:
        super().__init__()
        self.penultimate, self.beside = penultimate, None
        if beside:
            self.beside = nn.Sequential(nn.Linear(FEATURES, FEATURES), nn.ReLU(), nn.Linear(FEATURES, FEATURES))
            nn.init.zeros_(self.beside[2].weight)
            nn.init.zeros_(self.beside[2].bias)
        self.head = head

    def forward(self, encoded: Tensor) -> Tensor:
        """Scores (B, K) for outputs of the convolutions, (B, V, F)."""
        features = torch.relu(self.penultimate(encoded))
        if self.beside is not None:
            features = features + self.beside(features)
        return self.head(features.mean(dim=1))


@dataclass(frozen=True, slots=True)
class Schedule:
    """Number of epochs and learning rate of a training by AdamW; the rate falls to zero by a cosine."""

    epochs: int
    rate: float


PRETRAINING = Schedule(30, 2e-3)
TUNING = Schedule(40, 1e-3)
HEADS = Schedule(120, 5e-3)
"""Schedule for layers on top of features that are computed once; they are trained faster than whole networks."""


def seeded(seed: int) -> None:
    """Sets one thread and the seed, so that weights are the same bit for bit on one machine."""
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    torch.manual_seed(seed)


def augmented(inputs: Tensor, generator: torch.Generator) -> Tensor:
    """Events (B, V, speed, time), each with a random circular shift in time and a random scale; each radar's speeds have their sign
    reversed with a probability of one half."""
    augmented_events = []
    for event in inputs:
        shift = int(torch.randint(-SHIFT_ROWS, SHIFT_ROWS + 1, (1,), generator=generator))
        scale = 1.0 + GAIN * (2.0 * float(torch.rand(1, generator=generator)) - 1.0)
        views = torch.roll(event, shift, dims=2) * scale
        mirrored = torch.rand(len(event), generator=generator) < 0.5
        augmented_events.append(torch.where(mirrored[:, None, None], views.flip(1), views))
    return torch.stack(augmented_events)


def fitted(
    module: nn.Module, inputs: Tensor, labels: Tensor, schedule: Schedule, seed: int, *, augment: bool
) -> nn.Module:
    """The module after training all its parameters that are not frozen; classes have equal weight."""
    generator = torch.Generator().manual_seed(seed)
    tuned = [parameter for parameter in module.parameters() if parameter.requires_grad]
    optimizer = torch.optim.AdamW(tuned, lr=schedule.rate, weight_decay=DECAY)
    rates = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, schedule.epochs)
    counts = torch.bincount(labels, minlength=int(labels.max()) + 1).clamp(min=1)
    weight = (len(labels) / len(counts) / counts)[labels]
    module.train()
    for _ in range(schedule.epochs):
        for positions in torch.randperm(len(labels), generator=generator).split(BATCH):
            batch = augmented(inputs[positions], generator) if augment else inputs[positions]
            loss = nn.functional.cross_entropy(module(batch), labels[positions], reduction="none", label_smoothing=0.05)
            optimizer.zero_grad()
            (loss * weight[positions]).mean().backward()
            optimizer.step()
        rates.step()
    return module.eval()


def trained_on(net: EventNet, events: Events, schedule: Schedule, seed: int) -> nn.Module:
    """The network after training all its weights on augmented events."""
    inputs, labels = torch.from_numpy(events.inputs), torch.from_numpy(events.labels)
    return fitted(net, inputs, labels, schedule, seed, augment=True)


def random_network(classes: int, seed: int) -> EventNet:
    """A network with random weights."""
    seeded(seed)
    return EventNet(classes)


def pretrain(simulated: Events, *, seed: int = 0) -> EventNet:
    """A network trained on simulated events only; its weights are the same bit for bit for the same seed on one machine."""
    with torch_threads(1):
        net = random_network(len(simulated.classes), seed)
        trained_on(net, simulated, PRETRAINING, seed)
    return net


def fine_tune(strategy: str, known: EventNet | None, train: Events, *, seed: int = 0) -> nn.Module:
    """Tunes a network on events; it maps inputs (E, V, speed, time) of `Events` to scores (E, K). `known` is not changed.

    strategy: one of `STRATEGIES`: "linear probing", "last layer", "skip connection" or "full fine-tuning".
    known: a network for the same classes that was trained on simulated events (`pretrain`); None starts with random weights.

    Raises InputError for an unknown strategy, and for a network with another number of classes.
    """
    tune = STRATEGIES[choice("strategy", strategy, tuple(STRATEGIES))]
    classes = len(train.classes)
    if known is not None and known.head.out_features != classes:
        raise InputError(
            f"the network tells {known.head.out_features} classes apart, the events are of {classes}; pretrain it on those"
        )
    with torch_threads(1):
        seeded(seed)
        return tune(random_network(classes, seed) if known is None else deepcopy(known), train, seed)


def labels_of(network: nn.Module, events: Events) -> np.ndarray:
    """Index of the class with the greatest score for each event, (E,) int64."""
    network.eval()
    with torch.no_grad():
        return np.asarray(network(torch.from_numpy(events.inputs)).argmax(dim=1).numpy(), dtype=np.int64)


class OverEncoder(nn.Module):
    """Tuned layers on top of the frozen convolutions of a network."""

    def __init__(self, net: EventNet, layers: nn.Module) -> None:
        super().__init__()
        self.net, self.layers = net, layers

    def forward(self, inputs: Tensor) -> Tensor:
        """Scores (E, K) for inputs (E, V, speed, time)."""
        scores: Tensor = self.layers(self.net.encoded(inputs))
        return scores


def _over_encoder(net: EventNet, layers: Top, train: Events, seed: int) -> nn.Module:
    """Trains layers on features that are computed once, as the convolutions are frozen."""
    with torch.no_grad():
        encoded = net.encoded(torch.from_numpy(train.inputs))
    return OverEncoder(net, fitted(layers, encoded, torch.from_numpy(train.labels), HEADS, seed, augment=False))


def _linear_probing(net: EventNet, train: Events, seed: int) -> nn.Module:
    """Trains a new head on frozen features."""
    net.penultimate.requires_grad_(False)
    new_head = nn.Linear(net.head.in_features, net.head.out_features)
    return _over_encoder(net, Top(net.penultimate, new_head), train, seed)


def _last_layer(net: EventNet, train: Events, seed: int) -> nn.Module:
    """Trains penultimate layer and head; the convolutions are frozen."""
    return _over_encoder(net, Top(net.penultimate, net.head), train, seed)


def _skip_connection(net: EventNet, train: Events, seed: int) -> nn.Module:
    """Trains two new layers and the head; a skip connection passes the frozen penultimate features around the new layers."""
    net.penultimate.requires_grad_(False)
    return _over_encoder(net, Top(net.penultimate, net.head, beside=True), train, seed)


def _full(net: EventNet, train: Events, seed: int) -> nn.Module:
    """Trains all weights."""
    return trained_on(net, train, TUNING, seed)


STRATEGIES: dict[str, Callable[[EventNet, Events, int], nn.Module]] = {
    "linear probing": _linear_probing,
    "last layer": _last_layer,
    "skip connection": _skip_connection,
    "full fine-tuning": _full,
}
"""Strategies of fine-tuning by their names in Table IV of Text2Doppler."""
