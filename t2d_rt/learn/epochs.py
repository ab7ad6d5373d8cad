"""The training loop: batches and steps of each epoch, its log, and the state from which a stopped training continues."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from t2d_rt.core.errors import InputError
from t2d_rt.learn.augment import Augmenter
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.saved_models import as_input, not_a_state, read_state
from t2d_rt.learn.scores import macro_f1
from t2d_rt.learn.training import Progress, TrainOptions

BATCH_OF_VALIDATION = 256


def batches(
    maps: LabelledMaps,
    order: np.ndarray,
    batch: int,
    dynamic_range_db: float,
    *,
    augmenter: Augmenter | None = None,
    epoch: int = 0,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Batches of maps and labels in the given order. A last batch of a single sample, which has no variance, is merged with the one
    before."""
    cuts = list(range(batch, len(order), batch))
    if cuts and len(order) - cuts[-1] == 1:
        cuts.pop()
    for part in np.split(order, cuts):
        levels = maps.levels[part] if augmenter is None else augmenter.of_epoch(epoch, maps.levels, part)
        yield as_input(levels, dynamic_range_db), torch.from_numpy(maps.labels[part])


def fitted(
    network: nn.Module,
    maps: tuple[LabelledMaps, LabelledMaps],
    options: TrainOptions,
    dynamic_range_db: float,
    keep_at: Path | None,
    progress: Progress | None,
) -> tuple[list[dict[str, float]], float | None]:
    """Trains a network in place, and leaves it with the weights of the epoch with the least validation loss.

    keep_at: file of the state, which is written after each epoch; None keeps none.

    Returns the log of the epochs, and the mean duration of one [s], None where all were done before.
    """
    state = None if keep_at is None or not keep_at.exists() else read_state(keep_at, network)
    training = Training(network, maps, options, dynamic_range_db)
    first = 0 if state is None else len(state["history"])
    started = time.perf_counter()
    if state is not None and keep_at is not None:
        try:
            training.go_on(state)
        except InputError:
            raise
        except Exception as error:  # PyTorch may raise anything for a state that another program has written
            raise not_a_state(keep_at, error) from None
    while len(training.history) < options.epochs and not training.stopped:
        training.epoch()
        if keep_at is not None:
            temporary = keep_at.with_suffix(".new")
            torch.save(training.state, temporary)
            temporary.replace(keep_at)
        if progress is not None:
            progress(len(training.history) / options.epochs)
    epochs_done = len(training.history) - first
    seconds = round((time.perf_counter() - started) / epochs_done, 3) if epochs_done else None
    network.load_state_dict(training.best)
    network.to("cpu", memory_format=torch.contiguous_format)
    return training.history, seconds


class Training:
    """A network in training, epoch by epoch, on the device of the options."""

    def __init__(
        self,
        network: nn.Module,
        maps: tuple[LabelledMaps, LabelledMaps],
        options: TrainOptions,
        dynamic_range_db: float,
    ) -> None:
        self._network, self._options, self._range_db = network, options, dynamic_range_db
        self._train, self._val = maps
        self._half = options.precision == "bfloat16"
        self._device = "cpu" if options.device == "cpu" else "cuda" if torch.cuda.is_available() else "mps"
        # In bfloat16, convolutions are slower with channels first.
        network.to(self._device, memory_format=torch.channels_last if self._half else torch.preserve_format)
        self._optimizer = torch.optim.AdamW(network.parameters(), lr=options.rate, weight_decay=options.decay)
        self._plateau = torch.optim.lr_scheduler.ReduceLROnPlateau(
            self._optimizer, factor=options.factor, patience=options.plateau
        )
        self._augmenter = None
        if options.augment.some:
            self._augmenter = Augmenter(
                options.augment, self._train.size, self._train.duration_s, -dynamic_range_db, seed=options.seed
            )
        self.history: list[dict[str, float]] = []
        self.best: dict[str, Tensor] = {}

    @property
    def state(self) -> dict[str, Any]:
        """The state from which a stopped training can continue: plain numbers and tensors, which weights_only accepts."""
        return {
            "history": self.history,
            "best": self.best,
            "network": self._network.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "plateau": self._plateau.state_dict(),
        }

    def go_on(self, state: dict[str, Any]) -> None:
        """Continues from the state of a training that was stopped."""
        self.history, self.best = list(state["history"]), dict(state["best"])
        self._network.load_state_dict(state["network"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._plateau.load_state_dict(state["plateau"])
        if not all(math.isfinite(group["lr"]) for group in self._optimizer.param_groups):
            raise ValueError("its learning rate is not finite")

    @property
    def stopped(self) -> bool:
        """Whether the loss has not fallen for `patience` epochs, with the schedule "plateau"."""
        losses = [row["val_loss"] for row in self.history]
        plateau = self._options.schedule == "plateau"
        return plateau and bool(losses) and len(losses) - 1 - losses.index(min(losses)) >= self._options.patience

    def epoch(self) -> None:
        """Trains on all batches once, validates, logs the result, keeps the weights if they are the best so far, and updates the
        learning rate."""
        options, epoch, (group,) = self._options, len(self.history), self._optimizer.param_groups
        torch.manual_seed(options.seed * 100_003 + epoch)  # random draws in the network follow from seed and epoch
        if options.schedule == "cosine":
            group["lr"] = options.rate_of(epoch)
        order = np.random.default_rng([options.seed, epoch, 0]).permutation(len(self._train))
        self._network.train()
        parts = batches(self._train, order, options.batch, self._range_db, augmenter=self._augmenter, epoch=epoch)
        train = self._through(parts, options.smoothing, step=True)
        self._network.eval()
        with torch.no_grad():
            parts = batches(self._val, np.arange(len(self._val)), BATCH_OF_VALIDATION, self._range_db)
            val = self._through(parts)
        rate = float(group["lr"])
        if not (math.isfinite(train["loss"]) and math.isfinite(val["loss"])):
            raise InputError(
                f"the loss is no longer finite in epoch {epoch + 1}, at a rate of {rate:g}; lower the learning rate"
            )
        before = min((row["val_loss"] for row in self.history), default=math.inf)
        figures = {
            f"{side}_{name}": value for side, row in (("train", train), ("val", val)) for name, value in row.items()
        }
        del figures["train_f1"]
        self.history.append({"epoch": float(epoch), "rate": rate, **figures})
        if val["loss"] < before:
            self.best = {name: weight.detach().clone() for name, weight in self._network.state_dict().items()}
        if options.schedule == "plateau":
            self._plateau.step(val["loss"])

    def _through(
        self, parts: Iterator[tuple[Tensor, Tensor]], smoothing: float = 0.0, *, step: bool = False
    ) -> dict[str, float]:
        """Mean loss, accuracy and macro-F1 over batches; with `step` the weights are updated after each batch."""
        losses, outcomes = [], []
        for maps, labels in parts:
            maps, labels = maps.to(self._device), labels.to(self._device)
            with torch.autocast(self._device, dtype=torch.bfloat16, enabled=self._half):
                scores = self._network(maps)
                loss = nn.functional.cross_entropy(scores, labels, label_smoothing=smoothing)
            if step:
                self._optimizer.zero_grad()
                loss.backward()
                self._optimizer.step()
            losses.append(float(loss.detach()) * len(labels))
            outcomes.append(torch.stack([labels, scores.detach().argmax(dim=1)]).cpu().numpy())
        truth, predicted = np.concatenate(outcomes, axis=1)
        return {
            "loss": sum(losses) / len(truth),
            "accuracy": float(np.mean(truth == predicted)),
            "f1": float(macro_f1(truth, predicted, len(self._train.classes))),
        }
