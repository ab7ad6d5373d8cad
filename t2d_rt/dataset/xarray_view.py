"""The maps of a data set as an `xarray.Dataset` that reads a shard when its values are needed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from t2d_rt.core.errors import InputError
from t2d_rt.dataset.dataset import DIMENSIONS
from t2d_rt.dataset.products import axis
from t2d_rt.dataset.shards import RAGGED, UNITS

if TYPE_CHECKING:
    from t2d_rt.dataset.dataset import Dataset, Product

OF_RECORDS = "class", "condition", "sentence", "description", "seed", "snr_db", "distance_m", "angle_deg", "passed"
"""Fields of the records that become coordinates."""


class _Levels(BackendArray):
    """Levels [dB] or powers of parts, (sample, ...), which are read sample by sample."""

    def __init__(self, dataset: Dataset, product: Product) -> None:
        self._dataset, self._product = dataset, product
        self.shape = (len(dataset), *dataset.array(0, product).shape)
        self.dtype = np.dtype(np.float32)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER_1VECTOR, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        places = np.arange(len(self._dataset))[key[0]]
        if np.ndim(places) == 0:
            return np.asarray(self._dataset.values(int(places), self._product)[key[1:]])
        rows = [self._dataset.values(int(place), self._product) for place in places]
        stacked = np.stack(rows) if rows else np.zeros((0, *self.shape[1:]), self.dtype)
        return np.asarray(stacked[(slice(None), *key[1:])])


def xarray_view(dataset: Dataset, product: Product) -> xr.Dataset:
    """The view that `Dataset.to_xarray` returns."""
    dataset.checked(product)
    if product in RAGGED:
        raise InputError(
            f"{product} differ in size from sample to sample and make no one array; take Dataset.values(position, {product!r})"
        )
    levels = _Levels(dataset, product)
    dims = DIMENSIONS[product]
    entries = [record["products"][product] for record in dataset.records]
    coordinates: dict[str, Any] = {"index": ("sample", dataset.indices), "label": ("sample", dataset.labels)}
    for name in OF_RECORDS:
        coordinates[name] = "sample", np.array([_plain(record[name]) for record in dataset.records])
    coordinates["peak_db"] = (
        "sample",
        np.array([entry["peak_db"] for entry in entries]),
        {"units": "dB re 1 W", "long_name": "greatest cell"},
    )
    renamed = list(dims)
    for place, (name, count) in enumerate(zip(dims, levels.shape[1:], strict=True)):
        if name in UNITS:
            axes = np.stack([axis(entry[name], count) for entry in entries])
            about = {"units": UNITS[name]}
            if np.all(axes == axes[0]):
                coordinates[name] = name, axes[0], about
            else:  # several radars: each sample has an axis of its own
                renamed[place] = name.rpartition("_")[0]
                coordinates[name] = ("sample", renamed[place]), axes, about
    data = indexing.LazilyIndexedArray(levels)
    about = {"units": "dB", "long_name": "power relative to the greatest cell"}
    if product == "parts":
        coordinates["part"] = [*dataset.parts]
        about = {"units": "1", "long_name": "power added to that of the spectrogram, over its greatest cell"}
    return xr.Dataset(
        {product: (("sample", *renamed), data, about)},
        coords=coordinates,
        attrs={"recipe": dataset.recipe.name, "recipe_hash": dataset.recipe.hash, "classes": list(dataset.classes)},
    )


def _plain(value: Any) -> Any:
    return np.nan if value is None else value
