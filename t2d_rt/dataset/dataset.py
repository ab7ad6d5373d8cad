"""`Dataset`: the samples in a data set's folder, as records and as arrays that are read when they are needed, without
unpickling."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

import numpy as np

from t2d_rt.core.checks import positive, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import LastUsed, array_bytes
from t2d_rt.dataset.parquet import DATA, ParquetReader
from t2d_rt.dataset.products import Products, RangeDopplerProduct, SpectrogramProduct
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.shards import (
    RAGGED,
    RECIPE,
    SHARDS,
    Shard,
    damaged,
    dataset_folder,
    file_sha256,
    numbers,
    read_manifest,
    recipe_of,
    shard_name,
)

if TYPE_CHECKING:
    import xarray as xr

Product = Literal["spectrogram", "parts", "range_doppler", "points", "adc", "truth"]

DIMENSIONS: dict[str, tuple[str, ...]] = {
    "spectrogram": ("velocity_mps", "time_s"),
    "parts": ("part", "velocity_mps", "time_s"),
    "range_doppler": ("frame", "velocity_mps", "range_m"),
    "points": ("point", "column"),
    "adc": ("chirp", "antenna", "sample"),
    "truth": ("time", "column"),
}
"""Names of the axes of each product's values."""
TIME_AXIS = {"spectrogram": 1, "parts": 2, "range_doppler": 0, "points": 0, "adc": 0, "truth": 0}
"""Index of the time axis of each product, or of the axis along which its values come in time."""

CACHED_MB = 256.0
"""Memory for cached arrays [MB]: 8000 spectrograms of 128 x 128 cells."""


class Reader(Protocol):
    """Interface to the files that hold a data set's records and arrays."""

    records: tuple[dict[str, Any], ...]
    failed: tuple[dict[str, Any], ...]

    def array(self, position: int, product: str) -> np.ndarray:
        """The array of a product for one sample, as it is stored."""


class ShardReader:
    """Reads shards that `make_dataset` wrote; the last ones are cached."""

    def __init__(self, folder: Path, recipe: Recipe, most_bytes: float) -> None:
        records: list[dict[str, Any]] = []
        failed: list[dict[str, Any]] = []
        shards: list[Shard] = []
        self._checksums = read_manifest(folder).get("files", {})
        self._sound: set[Path] = set()
        for number in numbers(folder):
            self._check(folder / SHARDS / f"{shard_name(number)}.jsonl")
            shard = Shard.of(folder, number, recipe)
            records += shard.good
            shards += [shard] * len(shard.good)
            failed += [record for record in shard.records if record["row"] is None]
        self.records, self.failed = tuple(records), tuple(failed)
        self._shards = tuple(shards)
        self._kept = LastUsed[np.ndarray](most_bytes, array_bytes)

    def array(self, position: int, product: str) -> np.ndarray:
        """The array of a product for one sample, as it is stored."""
        record, shard = self.records[position], self._shards[position]
        if product in RAGGED:
            self._check(shard.path)
            return shard.array(record, product)
        return np.array(self._kept.get((shard.path, product), partial(self._rows, shard, product))[record["row"]])

    def _rows(self, shard: Shard, product: str) -> np.ndarray:
        """The stacked array of a product in a shard, after checking its file."""
        self._check(shard.path)
        return shard.rows(product)

    def _check(self, path: Path) -> None:
        """Refuses a file that has changed since it was written; a file that the manifest does not list yet is not checked."""
        if path not in self._sound and path.name in self._checksums:
            if file_sha256(path) != self._checksums[path.name]:
                raise damaged(path, "its checksum is another")
            self._sound.add(path)


class Dataset:
    """The samples in a folder, without those that failed, in the order of their indices. A copy in a worker process reads files for
    itself."""

    def __init__(self, path: str | Path, *, cached_mb: float = CACHED_MB) -> None:
        """A data set by its folder.

        path: folder that `make_dataset` wrote, finished or not, or that `export_dataset` wrote as parquet.
        cached_mb: memory for the shards read last [MB]; reading in random order is fast if all of them fit.

        Raises InputError where the folder is no data set or holds no finished sample, and where a file has been changed.
        Arrays are checked when they are read, not here.
        """
        self.path = dataset_folder(path)
        self.recipe = recipe_of(self.path)
        most_bytes = 1e6 * positive("cached_mb", cached_mb, 1e6, unit="MB")
        shards = (self.path / SHARDS).is_dir()
        recipe_hash = read_manifest(self.path).get("recipe_hash", self.recipe.hash) if shards else self.recipe.hash
        if recipe_hash != self.recipe.hash:
            raise InputError(
                f"{self.path / RECIPE} is not the recipe that the samples were made of, or an older version made "
                "them; put that recipe back, or read them with that version"
            )
        self._reader: Reader = (
            ShardReader(self.path, self.recipe, most_bytes)
            if shards
            else ParquetReader(self.path / DATA, self.recipe, most_bytes)
        )
        self.records: tuple[dict[str, Any], ...] = self._reader.records
        """Record of each sample: label, sentence, provenance, view, SNR, verdict of the filter."""
        self.failed: tuple[dict[str, Any], ...] = self._reader.failed
        """Records of the samples that failed."""
        if len(set(self.indices.tolist())) < len(self.records):
            raise InputError(f"{self.path} holds a sample twice; make or export it anew")
        if not self.records:
            raise InputError(f"{self.path} holds no finished sample yet; run its recipe, or wait for the first shard")

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        return f"Dataset({self.recipe.name}, {len(self)} samples of {len(self.classes)} classes, {', '.join(self.products)})"

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes; a label is an index into them."""
        return self.recipe.classes

    @property
    def labels(self) -> np.ndarray:
        """Label of each sample, that is the index of its class, (N,)."""
        return np.array([self.classes.index(record["class"]) for record in self.records], dtype=np.int64)

    @property
    def indices(self) -> np.ndarray:
        """Index of each sample in the recipe, (N,); samples that failed leave gaps."""
        return np.array([record["index"] for record in self.records], dtype=np.int64)

    @property
    def sides(self) -> dict[str, np.ndarray]:
        """Positions of the samples on each side of the split, (M,), if the recipe defines sides."""
        of_samples = [self.recipe.side_at(record["description"]) for record in self.records]
        return {
            side.name: np.flatnonzero([of_sample == side for of_sample in of_samples]) for side in self.recipe.sides
        }

    @property
    def products(self) -> tuple[str, ...]:
        """Names of the products that are stored for each sample."""
        return tuple(self.recipe.products.kept)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts whose powers are stored; none if the recipe has none."""
        return () if self.recipe.products.parts is None else self.recipe.products.parts.names

    def positions(self, indices: Sequence[int] | np.ndarray) -> np.ndarray:
        """Positions of the samples with these indices, (M,). An index counts in the recipe, a position counts the samples that did
        not fail.

        Raises InputError for an index without a finished sample.
        """
        places = {int(index): place for place, index in enumerate(self.indices)}
        lacking = [int(index) for index in indices if int(index) not in places]
        if lacking:
            raise InputError(
                f"{self.path} holds no sample {lacking[0]} ({len(lacking)} such indices); take indices of finished samples only"
            )
        return np.array([places[int(index)] for index in indices], dtype=np.int64)

    def array(self, position: int, product: Product) -> np.ndarray:
        """The array of a product for one sample as it is stored, in the type and shape that the recipe specifies; `values` decodes
        it.

        Raises InputError for a product that is not stored, and for a file that is damaged or belongs to another recipe.
        """
        return self._reader.array(position, self.checked(product))

    def values(self, position: int, product: Product) -> np.ndarray:
        """The values of a product for one sample: levels [dB, 0 at the greatest cell] of a map, float32; powers of parts relative
        to the spectrogram's greatest cell, (part, speed, time), in the order of `parts`; ADC samples, points or truth."""
        return decoded(self.array(position, product), product, self.recipe.products, self.records[position])

    def to_xarray(self, product: Product) -> xr.Dataset:
        """A lazy view of all samples of a map, or of its parts, with its axes; label, sentence, view and SNR of each sample are
        coordinates."""
        from t2d_rt.dataset.xarray_view import xarray_view

        return xarray_view(self, product)

    def checked(self, product: str) -> Product:
        """A checked name of a product that the data set holds."""
        if product not in self.products:
            raise unknown_name("product", product, self.products)
        return cast(Product, product)


def decoded(array: np.ndarray, product: str, products: Products, record: dict[str, Any]) -> np.ndarray:
    """The values that a stored array represents: levels [dB] of a map, float32, or complex ADC samples [sqrt(W)]; others
    unchanged."""
    definition = products.kept[product]
    if product == "adc":
        if definition.dtype == "complex64":
            return array
        parts = array.astype(np.float32) * np.float32(record["products"]["adc"]["greatest"])
        return np.ascontiguousarray(parts).view(np.complex64)[..., 0]
    return definition.levels(array) if isinstance(definition, SpectrogramProduct | RangeDopplerProduct) else array
