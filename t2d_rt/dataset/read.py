"""Reading a data set: records and arrays of its shards, without unpickling anything; and whether they are sound."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.checks import file_path
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.shards import RAGGED, SHARDS, damaged, numbers, read_records, sha256, shard_name
from t2d_rt.errors import InputError

RECIPE, PLANS, MANIFEST = "recipe.yaml", "plans.json", "manifest.json"
UNITS = {"velocity_mps": "m/s", "time_s": "s", "range_m": "m"}
"""Of the axes of maps."""


@dataclass(frozen=True, slots=True)
class Shard:
    """One shard: its records, and its arrays by product."""

    path: Path
    """Of the arrays."""
    records: tuple[dict[str, Any], ...]
    """One for each sample, those that failed among them."""

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by name; `index` tells which sample a row belongs to."""
        try:
            with np.load(self.path, allow_pickle=False) as file:
                return {name: file[name] for name in file.files}
        except Exception as error:  # NumPy and zipfile raise what they like of a damaged file
            raise damaged(self.path, error) from None

    def samples(self) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
        """Record and arrays by product of each sample that did not fail."""
        arrays = self.arrays()
        for record in self.records:
            if record["row"] is not None:
                names = record["products"]
                yield (
                    record,
                    {
                        name: arrays[f"{name}_{record['index']}"] if name in RAGGED else arrays[name][record["row"]]
                        for name in names
                    },
                )


def read_shards(path: str | Path) -> Iterator[Shard]:
    """The shards of a data set's folder in order."""
    folder = dataset_folder(path)
    for number in numbers(folder):
        yield Shard(folder / SHARDS / f"{shard_name(number)}.npz", tuple(read_records(folder, number)))


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
        found = json.loads(path.read_bytes())
        assert isinstance(found["files"], dict)
    except (OSError, ValueError, KeyError, TypeError, AssertionError) as error:
        raise InputError(f"{path} cannot be read ({error!r}); remove it and run the recipe again") from None
    return dict(found)


def faults(folder: Path) -> Iterator[str]:
    """What is wrong with the shards of a folder, a sentence each."""
    files = read_manifest(folder).get("files", {})
    present = {f"{shard_name(number)}.{kind}" for number in numbers(folder) for kind in ("npz", "jsonl")}
    for name in sorted(present | files.keys()):
        path = folder / SHARDS / name
        try:
            data = path.read_bytes()
        except OSError as error:
            yield f"{path} cannot be read: {error.strerror}"
            continue
        if name not in files:
            yield f"{path} is not in the manifest"
        elif sha256(data) != files[name]:
            yield f"{path} does not match its checksum"
    for number in numbers(folder):
        yield from shard_faults(folder, number)


def shard_faults(folder: Path, number: int) -> Iterator[str]:
    """What is wrong with one shard beside its checksums."""
    path = folder / SHARDS / f"{shard_name(number)}.npz"
    try:
        records = read_records(folder, number)
        arrays = Shard(path, tuple(records)).arrays()
    except InputError as error:
        yield str(error)
        return
    rows = [each["index"] for each in records if each.get("row") is not None]
    if "index" not in arrays or rows != arrays["index"].tolist():
        yield f"{path} holds other samples than its records tell"


def check_dataset(path: str | Path) -> list[str]:
    """What is wrong with a data set's folder, a sentence each; nothing where all is sound."""
    folder = dataset_folder(path)
    recipe = Recipe.read(folder / RECIPE)
    manifest = read_manifest(folder)
    found = list(faults(folder))
    if manifest.get("recipe_hash") != recipe.hash:
        found.insert(0, f"{folder / MANIFEST} is of another recipe than {RECIPE}, or missing")
    return found
