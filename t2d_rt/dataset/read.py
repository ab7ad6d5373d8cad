"""Reading a data set: records and arrays of its shards, without unpickling anything; and whether they are sound."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import file_path
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.records import Sizes, array_of, check_array, read_array, read_record
from t2d_rt.dataset.shards import RAGGED, SHARDS, SPOOL, damaged, file_sha256, numbers, shard_name
from t2d_rt.dataset.work import Made

RECIPE, PLANS, MANIFEST = "recipe.yaml", "plans.json", "manifest.json"
UNITS = {"velocity_mps": "m/s", "time_s": "s", "range_m": "m"}
"""Of the axes of maps."""
FILE = re.compile(r"[0-9]{5,9}\.(npz|jsonl)")
"""Names of a shard's files."""
MOST_BYTES = 500_000_000
"""Of a manifest, or of a shard's records."""


@dataclass(frozen=True, slots=True)
class Shard:
    """One shard: its records, and its arrays by product, both as the recipe has them."""

    path: Path
    """Of the arrays."""
    records: tuple[dict[str, Any], ...]
    """One for each sample, those that failed among them."""
    recipe: Recipe

    @classmethod
    def of(cls, folder: Path, number: int, recipe: Recipe) -> Shard:
        """A shard of a folder by its number."""
        path = folder / SHARDS / f"{shard_name(number)}.jsonl"
        try:
            lines = read_bytes(path, limit=MOST_BYTES, noun="file of records").splitlines()
            records = tuple(read_record(recipe, line) for line in lines)
            rows = [each["row"] for each in records if each["row"] is not None]
            if rows != [*range(len(rows))] or len({each["index"] for each in records}) < len(records):
                raise InputError("a sample is there twice, or a row is missing")
        except (InputError, KeyError) as error:
            raise damaged(path, error) from None
        return cls(path.with_suffix(".npz"), records, recipe)

    def rows(self, name: str) -> np.ndarray:
        """The array of a product of one size, (samples that did not fail, ...), or of their indices by the name `index`."""
        good = [each for each in self.records if each["row"] is not None]
        if name == "index" or not good:
            dtype, shape = np.dtype(np.int64), tuple[int | None, ...]()
        else:
            dtype, shape = array_of(self.recipe, good[0], name)
        return self._read(name, name, dtype, (len(good), *shape))

    def array(self, record: Mapping[str, Any], name: str) -> np.ndarray:
        """The array of one sample of a product whose size differs."""
        return self._read(f"{name}_{record['index']}", name, *array_of(self.recipe, record, name))

    def _read(self, member: str, name: str, dtype: np.dtype[Any], shape: Sizes) -> np.ndarray:
        try:
            found = read_array(self.path, member, dtype, shape)
            check_array(found, dtype, shape, name)
        except Exception as error:  # NumPy and zipfile raise what they like of a damaged file
            raise damaged(self.path, error) from None
        return found

    def samples(self) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
        """Record and arrays by product of each sample that did not fail."""
        good = [each for each in self.records if each["row"] is not None]
        names = self.recipe.products.kept if good else ()
        whole = {name: self.rows(name) for name in names if name not in RAGGED}
        for record in good:
            yield (
                record,
                {name: whole[name][record["row"]] if name in whole else self.array(record, name) for name in names},
            )


def spooled(folder: Path, recipe: Recipe) -> Iterator[Made]:
    """Finished samples of shards that are not finished; one that is damaged, or of another recipe, is made anew."""
    for path in (folder / SPOOL).glob("*.jsonl"):
        with suppress(InputError):
            record = read_record(recipe, read_bytes(path, limit=MOST_BYTES, noun="record").strip())
            if path.stem == str(record["index"]):
                shard = Shard(path.with_suffix(".npz"), (record,), recipe)
                arrays = next((arrays for _, arrays in shard.samples()), {})
                yield Made({name: value for name, value in record.items() if name != "row"}, arrays)


def read_shards(path: str | Path) -> Iterator[Shard]:
    """The shards of a data set's folder in order."""
    folder = dataset_folder(path)
    recipe = Recipe.read(folder / RECIPE)
    for number in numbers(folder):
        yield Shard.of(folder, number, recipe)


def dataset_folder(path: str | Path) -> Path:
    """The folder of a data set."""
    folder = file_path("the folder of a data set", path)
    if not (folder / RECIPE).is_file():
        raise InputError(f"{folder} is no data set: it holds no {RECIPE}; give the folder that t2d-rt dataset wrote")
    return folder


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest; an empty one where there is none yet."""
    path = folder / MANIFEST
    if not path.exists():
        return {}
    try:
        found = json.loads(read_bytes(path, limit=MOST_BYTES, noun="manifest"))
        if not all(isinstance(found.get(name, {}), dict) for name in ("files", "inputs", "versions")):
            raise ValueError("files, inputs and versions must be objects")
        if not all(FILE.fullmatch(name) for name in found["files"]):
            raise ValueError("files must be those of shards")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} cannot be read ({error!r}); remove it and run the recipe again") from None
    return dict(found)


def faults(folder: Path, recipe: Recipe) -> Iterator[str]:
    """What is wrong with the shards of a folder, a sentence each."""
    files = read_manifest(folder).get("files", {})
    present = {f"{shard_name(number)}.{kind}" for number in numbers(folder) for kind in ("npz", "jsonl")}
    for name in sorted(present | files.keys()):
        path = folder / SHARDS / name
        try:
            found = file_sha256(path)
        except InputError as error:
            yield str(error)
            continue
        if name not in files:
            yield f"{path} is not in the manifest"
        elif found != files[name]:
            yield f"{path} does not match its checksum"
    for number in numbers(folder):
        yield from shard_faults(folder, number, recipe)


def shard_faults(folder: Path, number: int, recipe: Recipe) -> Iterator[str]:
    """What is wrong with one shard beside its checksums."""
    try:
        shard = Shard.of(folder, number, recipe)
        indices = shard.rows("index").tolist()
        for _ in shard.samples():
            pass
    except InputError as error:
        yield str(error)
        return
    if indices != [each["index"] for each in shard.records if each["row"] is not None]:
        yield f"{shard.path} holds other samples than its records tell"


def check_dataset(path: str | Path) -> list[str]:
    """What is wrong with a data set's folder, a sentence each; nothing where all is sound."""
    folder = dataset_folder(path)
    recipe = Recipe.read(folder / RECIPE)
    manifest = read_manifest(folder)
    found = list(faults(folder, recipe))
    if manifest.get("recipe_hash") != recipe.hash:
        found.insert(0, f"{folder / MANIFEST} is of another recipe than {RECIPE}, or missing")
    return found
