"""Batches of maps for one epoch: their order and their changes follow from the seed and the number of the epoch alone, so that
training that goes on after a stop sees what it would have seen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.train.augment import Augmenter


def as_input(levels: np.ndarray, dynamic_range_db: float) -> Tensor:
    """Maps (N, speed, time) [dB below the greatest cell] as (N, 1, speed, time), 1 at the greatest, 0 at the range's end."""
    return torch.from_numpy(np.clip(1.0 + levels / np.float32(dynamic_range_db), 0.0, 1.0).astype(np.float32))[:, None]


class Batches:
    """Shuffled batches of an epoch; a last one of a single sample, of which no variance can be taken, joins the one before."""

    def __init__(
        self, maps: LabelledMaps, batch: int, dynamic_range_db: float, *, seed: int, epoch: int,
        augmenter: Augmenter | None = None, shuffled: bool = True,
    ) -> None:  # fmt: skip
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
