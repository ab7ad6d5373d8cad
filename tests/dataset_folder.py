"""A data set of made-up arrays, written as `make_dataset` writes one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.dataset import Recipe
from t2d_rt.dataset.products import POINT_COLUMNS, edges
from t2d_rt.dataset.sample import cell_of, description_of
from t2d_rt.dataset.shards import MadeSample, write_shard
from t2d_rt.types import Radar

RADAR = Radar.preset("table2")


def recipe(**changes: Any) -> Recipe:
    """Two classes of three descriptions, each by two persons."""
    values: dict[str, Any] = {
        "name": "tiny", "classes": ["walking", "bending"], "descriptions_per_class": 3, "samples_per_description": 2,
        "radar": RADAR, "conditions": [{"name": "ellipsoids", "method": "ellipsoid"}], "samples_per_shard": 5,
        "products": {
            "spectrogram": {"size": [16, 24]},
            "range_doppler": {"size": [8, 6], "frames": 4, "dtype": "uint8", "dynamic_range_db": 40},
            "points": {}, "adc": {"dtype": "float16"},
        },
    }  # fmt: skip
    return Recipe(**(values | changes))


def record_of(found: Recipe, index: int) -> dict[str, Any]:
    """A record with one clip of its own."""
    cell = cell_of(found, index)
    return {
        "index": index, "class": cell.activity, "description": cell.description, "repetition": cell.repetition,
        "motion": cell.number, "condition": cell.condition.name, "sentence": description_of(found, cell).sentence,
        "slots": {}, "provider": "auto", "body": "adult", "stature_m": 1.7, "seed": 1000 + index, "gait_factor": 1.0,
        "angle_deg": 10.0 * index, "distance_m": 3.0, "aside_m": 0.0, "height_m": 1.0, "overlap_m": 0.0,
        "passed": index % 4 != 3, "reasons": ["too fast"] if index % 4 == 3 else [], "attempts": 1, "made_s": 4.0 + index,
        "start_s": 0.0, "held_s": 0.0, "experiment": f"{index:032x}", "duration_s": 5.0, "error_db": None,
        "snr_db": 20.0 + index, "second_person": None, "warnings": [], "failure": None,
        "sources": [f"clip {cell.activity}_{index}.0 of {cell.activity}_{index}.bvh.gz, 0.00 to 1.00 s", "mirrored"],
    }  # fmt: skip


def made(found: Recipe, index: int, greatest_mps: float = 4.0) -> MadeSample:
    """A sample of made-up arrays: a line of power at a speed that grows with the index."""
    rng = np.random.default_rng(index)
    record = record_of(found, index)
    arrays: dict[str, np.ndarray] = {}
    told: dict[str, Any] = {}
    for name, each in found.products.kept.items():
        if name == "points":
            arrays[name] = rng.normal(size=(3 + index % 3, len(POINT_COLUMNS))).astype(np.float32)
            told[name] = {"count": len(arrays[name])}
        elif name == "adc":
            cube = rng.normal(size=(6, RADAR.antennas, RADAR.samples, 2)).astype(np.float32)
            arrays[name], told[name] = (cube / 8).astype(np.float16), {"greatest": 8.0}
        else:
            size = each.size if name == "spectrogram" else (each.frames, *each.size)
            power = 1e-4 * rng.exponential(size=size)
            power[..., (index + 8) % size[-2], :] = 1.0
            arrays[name], peak_db = each.encoded(power)
            told[name] = {"peak_db": peak_db, "velocity_mps": edges(np.linspace(-greatest_mps, greatest_mps, size[-2]))}
            if name == "spectrogram":
                told[name] |= {"time_s": [0.0, 5.0]}
            else:
                told[name] |= {"times_s": [0.5, 1.5, 2.5, 3.5], "range_m": [0.0, 8.0]}
    return MadeSample(record | {"products": told}, arrays)


def write_dataset(
    folder: Path, found: Recipe | None = None, *, failed: tuple[int, ...] = (), greatest_mps: float = 4.0
) -> Path:
    """A folder as `make_dataset` leaves it."""
    found = found or recipe()
    (folder / "shards").mkdir(parents=True)
    (folder / "log").mkdir()
    (folder / "recipe.yaml").write_text(found.to_yaml())
    files, size = {}, found.samples_per_shard
    for number in range(-(-found.samples // size)):
        indices = range(number * size, min((number + 1) * size, found.samples))
        samples = [made(found, index, greatest_mps) for index in indices]
        samples = [
            MadeSample({**each.record, "failure": "no room"}) if each.record["index"] in failed else each
            for each in samples
        ]
        files |= write_shard(folder, number, samples)
    (folder / "manifest.json").write_text(
        json.dumps({"recipe": found.name, "recipe_hash": found.hash, "samples": found.samples, "files": files})
    )
    return folder
