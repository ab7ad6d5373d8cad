"""Data sets of others: records, arrays, manifests and recipes changed, with checksums that fit. None writes outside its folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.dataset import Dataset, Recipe, check_dataset, export_dataset, read_shards, split
from t2d_rt.dataset.products import POINT_COLUMNS
from t2d_rt.dataset.sample import cell_of, description_of
from t2d_rt.dataset.shards import MadeSample, archive, sha256, write_shard
from t2d_rt.types import Radar
from validation.robustness.fuzz.case import (
    DEEP,
    Attempt,
    Wrong,
    chance,
    check_finite,
    corrupted,
    pick,
    replaced,
    writing_only,
)

SAMPLES = 4


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One data set and what reads it."""
    place = folder / "a" / "b" / "set"
    written(place)
    told = pick(rng, (_record, _record, _record, _array, _array, _bytes, _manifest, _recipe))(rng, place)
    out = folder / "out" / "c" / "d"
    out.parent.mkdir(parents=True)
    use = pick(rng, ("png", "npz", "values", "check", "split", "maps", "shards"))
    return Attempt(f"{told}: {use}", writing_only(lambda: _used(use, place, out), folder, "out/c/d"))


def _used(use: str, place: Path, out: Path) -> None:
    if use == "check":
        check_dataset(place)
    elif use == "shards":
        for shard in read_shards(place):
            for _, arrays in shard.samples():
                for name, each in arrays.items():
                    check_finite(each, name)
    elif use in ("png", "npz"):
        export_dataset(place, out, "png" if use == "png" else "npz")
    else:
        dataset = Dataset(place)
        if use == "split":
            split(dataset.records, (0.5, 0.5), apart=("seed",))
        elif use == "maps":
            dataset.to_xarray("spectrogram").load()
        for position in range(len(dataset)):
            for product in dataset.products:
                check_finite(dataset.values(position, product), product)
            if dataset.records[position]["class"] not in dataset.classes:
                raise Wrong("a class that the recipe does not have")


def written(place: Path) -> None:
    """A small data set as `make_dataset` leaves it."""
    recipe = Recipe(
        name="tiny", classes=["walking", "bending"], descriptions_per_class=1, samples_per_description=SAMPLES // 2,
        radar=Radar.preset("ci4r", samples=16), conditions=[{"name": "one", "method": "ellipsoid"}], samples_per_shard=SAMPLES,
        products={"spectrogram": {"size": [8, 8]}, "points": {}, "adc": {"dtype": "float16"}},
    )  # fmt: skip
    rng = np.random.default_rng(0)
    made = []
    for index in range(SAMPLES):
        cell = cell_of(recipe, index)
        record = {
            "index": index, "class": cell.activity, "description": 0, "repetition": cell.repetition, "motion": index,
            "condition": "one", "sentence": description_of(recipe, cell).sentence, "slots": {}, "provider": "auto", "body": "adult",
            "seed": index, "distance_m": 3.0, "angle_deg": 0.0, "passed": True, "reasons": [], "duration_s": 5.0, "snr_db": 20.0,
            "error_db": None, "second_person": None, "sources": [f"clip a of b{index}.bvh, 0.00 to 1.00 s"], "failure": None,
            "products": {
                "spectrogram": {"peak_db": -90.0, "velocity_mps": [-4.0, 4.0], "time_s": [0.0, 5.0]}, "points": {"count": 3},
                "adc": {"greatest": 1.0},
            },
        }  # fmt: skip
        arrays = {
            "spectrogram": (-60 * rng.random((8, 8))).astype(np.float16),
            "points": rng.random((3, len(POINT_COLUMNS))).astype(np.float32),
            "adc": rng.random((4, recipe.radar.antennas, 16, 2)).astype(np.float16),
        }
        made.append(MadeSample(record, arrays))
    (place / "shards").mkdir(parents=True)
    (place / "recipe.yaml").write_text(recipe.to_yaml())
    files = write_shard(place, 0, made)
    (place / "manifest.json").write_text(json.dumps({"recipe_hash": recipe.hash, "files": files}))


def _sealed(place: Path) -> None:
    """Checksums of what is there now."""
    path = place / "manifest.json"
    told = json.loads(path.read_text())
    told["files"] = {each.name: sha256(each.read_bytes()) for each in sorted((place / "shards").iterdir())}
    path.write_text(json.dumps(told))


def _record(rng: np.random.Generator, place: Path) -> str:
    path = place / "shards" / "00000.jsonl"
    records = [json.loads(line) for line in path.read_text().splitlines()]
    row = int(rng.integers(len(records)))
    told, records[row] = replaced(rng, records[row])
    lines = [json.dumps(each) for each in records]
    if chance(rng, 0.1):
        told, lines[row] = pick(rng, (("null", "null"), ("deep", DEEP), ("twice", lines[row - 1]), ("nothing", "")))
    path.write_text("".join(f"{line}\n" for line in lines))
    _sealed(place)
    return f"record {row}: {told}"


def _array(rng: np.random.Generator, place: Path) -> str:
    path = place / "shards" / "00000.npz"
    with np.load(path) as file:
        arrays: dict[str, Any] = dict(file)
    name = pick(rng, sorted(arrays))
    array = arrays[name]
    how, arrays[name] = pick(
        rng,
        [
            ("of another type", array.astype(pick(rng, ("f8", "i1", "c8", "U5", "bool")))), ("flat", array.ravel()),
            ("cut", array[..., :1]), ("of NaN", array * np.nan), ("great", (array + 1) * 1e4), ("empty", array[:0]),
            ("deeper", array[None]), ("another number", np.repeat(array, 2, axis=0)),
        ],
    )  # fmt: skip
    if chance(rng, 0.15):
        how = "gone"
        del arrays[name]
    path.write_bytes(archive(arrays))
    _sealed(place)
    return f"{name} {how}"


def _bytes(rng: np.random.Generator, place: Path) -> str:
    path = place / "shards" / pick(rng, ("00000.npz", "00000.jsonl"))
    told, data = corrupted(rng, path.read_bytes())
    path.write_bytes(data)
    _sealed(place)
    return f"{path.name} {told}"


def _manifest(rng: np.random.Generator, place: Path) -> str:
    path = place / "manifest.json"
    told, values = replaced(rng, json.loads(path.read_text()))
    path.write_text(DEEP if chance(rng, 0.1) else json.dumps(values))
    return f"manifest: {told}"


def _recipe(rng: np.random.Generator, place: Path) -> str:
    import yaml

    path = place / "recipe.yaml"
    told, values = replaced(rng, yaml.safe_load(path.read_text()))
    path.write_text(yaml.safe_dump(values))
    return f"recipe: {told}"
