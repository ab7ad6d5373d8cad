"""A network under training, for Lightning, and the batches of its epochs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning import LightningModule
from torch import Tensor, nn
from torchmetrics.classification import MulticlassAccuracy, MulticlassF1Score

from t2d_rt.core.errors import InputError
from t2d_rt.learn.augment import Augmenter
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.training import TrainOptions


def as_input(levels: np.ndarray, dynamic_range_db: float) -> Tensor:
    """Maps (N, speed, time) [dB below the greatest cell] as (N, 1, speed, time), 1 at the greatest, 0 at the range's end."""
    return torch.from_numpy(np.clip(1.0 + levels / np.float32(dynamic_range_db), 0.0, 1.0).astype(np.float32))[:, None]


class Batches:
    """Shuffled batches of an epoch; a last one of a single sample, of which no variance can be taken, joins the one before."""

    def __init__(
        self,
        maps: LabelledMaps,
        batch: int,
        dynamic_range_db: float,
        *,
        seed: int,
        epoch: int,
        augmenter: Augmenter | None = None,
        shuffled: bool = True,
    ) -> None:
        self._maps, self._range_db, self._augmenter = maps, dynamic_range_db, augmenter
        self._seed, self._epoch = seed, epoch
        rng = np.random.default_rng([seed, epoch, 0])
        order = rng.permutation(len(maps)) if shuffled else np.arange(len(maps))
        cuts = list(range(batch, len(maps), batch))
        if cuts and len(maps) - cuts[-1] == 1:
            cuts.pop()
        self._parts = np.split(order, cuts)

    def __len__(self) -> int:
        return len(self._parts)

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        for part in self._parts:
            levels = self._maps.levels[part]
            if self._augmenter is not None:
                variant = self._augmenter.augment.variant(self._epoch)
                made = [
                    self._augmenter(
                        each, np.random.default_rng([self._seed, variant, 1, int(place)]), self._maps.levels
                    )
                    if variant is not None
                    else each
                    for each, place in zip(levels, part, strict=True)
                ]
                levels = np.stack(made)
            yield as_input(levels, self._range_db), torch.from_numpy(self._maps.labels[part])


BATCH_OF_VALIDATION = 256


class Training(LightningModule):  # type: ignore[misc]
    """One epoch after the other; after each the state is kept, so that a stopped run goes on where it was."""

    def __init__(
        self,
        network: nn.Module,
        maps: tuple[LabelledMaps, LabelledMaps],
        options: TrainOptions,
        dynamic_range_db: float,
        *,
        keep_at: Path | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        super().__init__()
        self.network, self.options, self.dynamic_range_db = network, options, dynamic_range_db
        self._train, self._val = maps
        self._keep_at, self._progress = keep_at, progress
        count = len(self._train.classes)
        self._accuracy = nn.ModuleDict(
            {f"of_{side}": MulticlassAccuracy(count, average="micro") for side in ("train", "val")}
        )
        self._f1 = MulticlassF1Score(count, average="macro")
        self._losses: dict[str, list[tuple[float, int]]] = {"train": [], "val": []}
        self.history: list[dict[str, float]] = []
        self.best: dict[str, Tensor] = {}
        self._augmenter = None
        if options.augment.some:
            self._augmenter = Augmenter(
                options.augment, self._train.size, self._train.duration_s, -dynamic_range_db, seed=options.seed
            )

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) of maps (N, 1, speed, time)."""
        scores: Tensor = self.network(maps)
        return scores

    def train_dataloader(self) -> Batches:
        """The batches of the epoch that begins."""
        return Batches(
            self._train,
            self.options.batch,
            self.dynamic_range_db,
            seed=self.options.seed,
            epoch=self.current_epoch,
            augmenter=self._augmenter,
        )

    def val_dataloader(self) -> Batches:
        """All of the validation, unchanged."""
        return Batches(self._val, BATCH_OF_VALIDATION, self.dynamic_range_db, seed=0, epoch=0, shuffled=False)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam; on a plateau the rate falls in `on_train_epoch_end`, before the state is kept."""
        options = self.options
        optimizer = torch.optim.AdamW(self.network.parameters(), lr=options.rate, weight_decay=options.decay)
        self._plateau = torch.optim.lr_scheduler.ReduceLROnPlateau(
            optimizer, factor=self.options.factor, patience=self.options.plateau
        )
        return optimizer

    def on_train_epoch_start(self) -> None:
        """Whatever a network draws follows from the epoch."""
        torch.manual_seed(self.options.seed * 100_003 + self.current_epoch)
        self._losses["train"].clear()
        if self.options.schedule == "cosine":
            for group in self._plateau.optimizer.param_groups:
                group["lr"] = self.options.rate_of(self.current_epoch)

    def on_validation_epoch_start(self) -> None:
        """Begins the sums anew."""
        self._losses["val"].clear()

    def training_step(self, batch: tuple[Tensor, Tensor], _: int) -> Tensor:
        """Cross entropy of a batch, with its smoothing."""
        return self._loss(batch, "train")

    def validation_step(self, batch: tuple[Tensor, Tensor], _: int) -> None:
        """Loss, accuracy and F1 of the validation."""
        self._loss(batch, "val")

    def _loss(self, batch: tuple[Tensor, Tensor], side: str) -> Tensor:
        """Loss of a batch; that, accuracy and F1 are summed up for the epoch."""
        maps, labels = batch
        scores = self.network(maps)
        smoothing = self.options.smoothing if side == "train" else 0.0
        loss = nn.functional.cross_entropy(scores, labels, label_smoothing=smoothing)
        self._losses[side].append((float(loss.detach()), len(labels)))
        self._accuracy[f"of_{side}"].update(scores.detach(), labels)
        if side == "val":
            self._f1.update(scores.detach(), labels)
        return loss

    def on_train_epoch_end(self) -> None:
        """Writes down the epoch, keeps the best weights and the state, and stops where nothing gets better."""
        row = {"epoch": float(self.current_epoch), "rate": float(self._plateau.optimizer.param_groups[0]["lr"])}
        for side, losses in self._losses.items():
            count = sum(number for _, number in losses)
            row[f"{side}_loss"] = sum(loss * number for loss, number in losses) / count
            row[f"{side}_accuracy"] = float(self._accuracy[f"of_{side}"].compute())
            self._accuracy[f"of_{side}"].reset()
        if not (math.isfinite(row["train_loss"]) and math.isfinite(row["val_loss"])):
            raise InputError(
                f"the loss is no longer finite in epoch {self.current_epoch + 1}, at a rate of {row['rate']:g}; "
                "lower the learning rate"
            )
        row["val_f1"] = float(self._f1.compute())
        self._f1.reset()
        before = min((each["val_loss"] for each in self.history), default=float("inf"))
        self.history.append(row)
        if row["val_loss"] < before or not self.best:
            self.best = {name: each.detach().clone() for name, each in self.network.state_dict().items()}
        if self.options.schedule == "plateau":
            self._plateau.step(row["val_loss"])
        if self.stopped:
            self.trainer.should_stop = True
        if self._keep_at is not None:
            new = self._keep_at.with_suffix(".new")
            self.trainer.save_checkpoint(new)
            new.replace(self._keep_at)
        if self._progress is not None:
            self._progress(len(self.history) / self.options.epochs)

    @property
    def stopped(self) -> bool:
        """Whether the loss on a plateau has not fallen for as many epochs as the patience is."""
        if self.options.schedule == "cosine":
            return False
        losses = [each["val_loss"] for each in self.history]
        return bool(losses) and len(losses) - 1 - losses.index(min(losses)) >= self.options.patience

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """What Lightning does not know of: plain numbers and tensors, which weights_only reads."""
        checkpoint["t2d_rt"] = {"history": self.history, "best": self.best, "plateau": self._plateau.state_dict()}

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """History, best weights and schedule of a checkpoint."""
        kept = checkpoint["t2d_rt"]
        self.history, self.best = list(kept["history"]), dict(kept["best"])
        self._kept_plateau = kept["plateau"]

    def on_train_start(self) -> None:
        """The schedule goes on, too."""
        kept = getattr(self, "_kept_plateau", None)
        if kept is not None:
            self._plateau.load_state_dict(kept)
