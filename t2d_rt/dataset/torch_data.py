"""A data set for PyTorch: a product of each sample as a tensor, and its label."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2d_rt.core.checks import call, choice, integer, positive
from t2d_rt.core.errors import InputError, install
from t2d_rt.dataset.dataset import TIME_AXIS, Dataset, Product
from t2d_rt.dataset.products import POINT_COLUMNS

try:
    import torch
    from torch.utils.data import Dataset as MapDataset
except ImportError:
    raise InputError(f"TorchDataset needs PyTorch, which is not installed; {install('learn')}") from None

MAPS = "spectrogram", "range_doppler"


class TorchDataset(MapDataset):  # type: ignore[misc, type-arg]
    """A map-style data set: `self[k]` is the tensor of a sample and its target. Each worker of a DataLoader reads files for
    itself."""

    def __init__(
        self,
        dataset: Dataset | str | Path,
        product: Product = "spectrogram",
        *,
        indices: Sequence[int] | None = None,
        dynamic_range_db: float | None = None,
        length: int | None = None,
        transform: Callable[[Any], Any] | None = None,
        target: Literal["class", "parts"] = "class",
    ) -> None:
        """Samples of a folder that `make_dataset` wrote, or `export_dataset` as parquet.

        product: "spectrogram" (speed, time) or "range_doppler" (frame, speed, range), levels [dB, 0 at the greatest cell]; "adc"
            (chirp, antenna, sample), complex [sqrt(W)]; "points" (point, 6); "truth" (time, column of `TRUTH_COLUMNS`); or "parts"
            (part, speed, time), powers over that of the spectrogram's greatest cell, in the order of `Dataset.parts`.
        indices: indices of samples in their recipe, as a side of a split has them; all by default.
        dynamic_range_db: scales levels to 0..1: 1 at the greatest cell, 0 at this level below it [dB] or lower.
        length: number of cells or frames along time, or of points, to which each sample is cut or padded: maps with the least
            level, others with zeros. Of points those with the greatest SNR are kept, of other products the beginning.
        transform: function that is applied to each tensor, but not to targets.
        target: index of the "class", or the tensor of the "parts", to learn which limb causes a cell.
        """
        self.dataset = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
        self.product = self.dataset.checked(product)
        self.positions = (
            np.arange(len(self.dataset))
            if indices is None
            else self.dataset.positions([int(index) for index in indices])
        )
        self.classes = self.dataset.classes
        self.labels = torch.from_numpy(self.dataset.labels[self.positions])
        if dynamic_range_db is not None:
            if product not in MAPS:
                raise InputError(f"dynamic_range_db is of {' and '.join(MAPS)}, got product {product!r}; leave it out")
            dynamic_range_db = self._within(positive("dynamic_range_db", dynamic_range_db, 200, unit="dB"))
        self.dynamic_range_db = dynamic_range_db
        self.target = choice("target", target, ("class", "parts"))
        if target == "parts":
            self.dataset.checked("parts")
            if length is not None:
                raise InputError("length would cut the map and not its parts; leave it out where the target is parts")
        self.length = None if length is None else integer("length", length, 1, 10_000_000)
        self.transform = None if transform is None else call("transform", transform, "a function of a tensor")

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, number: int) -> tuple[Any, Any]:
        place = int(self.positions[number])
        values = self.dataset.values(place, self.product)
        if self.dynamic_range_db is not None:
            values = np.clip(1 + values / np.float32(self.dynamic_range_db), 0, 1)
        if self.length is not None:
            values = fitted(values, self.product, self.length)
        tensor = torch.from_numpy(np.ascontiguousarray(values))
        target: Any = int(self.labels[number])
        if self.target == "parts":
            target = torch.from_numpy(self.dataset.values(place, "parts"))
        return tensor if self.transform is None else self.transform(tensor), target

    def record(self, number: int) -> dict[str, Any]:
        """The record of a sample."""
        return self.dataset.records[int(self.positions[number])]

    def _within(self, range_db: float) -> float:
        """A checked dynamic range [dB] that the stored levels cover; below that of "uint8" everything is lost."""
        definition = self.dataset.recipe.products.kept[self.product]
        if definition.dtype == "uint8" and range_db > definition.dynamic_range_db:
            raise InputError(
                f"the data set holds {definition.dynamic_range_db:g} dB and dynamic_range_db asks for {range_db:g} dB; ask for less"
            )
        return range_db


def fitted(values: np.ndarray, product: Product, length: int) -> np.ndarray:
    """Values cut or padded along time to a length; of points those of greatest SNR are kept."""
    axis = TIME_AXIS[product]
    lacking = length - values.shape[axis]
    if lacking <= 0:
        if product == "points":
            chosen = np.argsort(-values[:, POINT_COLUMNS.index("snr_db")], kind="stable")[:length]
            return np.asarray(values[np.sort(chosen)])
        return np.asarray(values[(slice(None),) * axis + (slice(length),)])
    padding = [(0, 0)] * values.ndim
    padding[axis] = 0, lacking
    return np.pad(values, padding, constant_values=values.min() if product in MAPS else 0)
