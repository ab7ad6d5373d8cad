"""What a recipe tells of the records and arrays of its samples, against which each is checked that is read from a file.

A data set may come from anybody: a class becomes the name of a folder, an axis a scale, a shape memory.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import flag, integer, interval, number, positive, shown, text
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import npy_header, regular_file
from t2d_rt.dataset.products import POINT_COLUMNS
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.recording.truth import TRUTH_COLUMNS

Sizes = tuple[int | None, ...]
"""Of an array; None is any length."""

MAPS = {"spectrogram": ("velocity_mps", "time_s"), "range_doppler": ("velocity_mps", "range_m")}
"""Axes of maps, of which records tell the ends."""
LARGEST_BYTES = 4e9
"""Of an array, unpacked: a packed one may be a thousandth of that."""
LEAST_ABOVE_DB = 1e-3
"""Rounding of the greatest cell, which is at 0 dB."""


def read_record(recipe: Recipe, line: str | bytes) -> dict[str, Any]:
    """The record in a line of JSON; an InputError that names what is not as its recipe has it."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"it is no JSON ({'nested too deeply' if isinstance(error, RecursionError) else error})"
        ) from None
    if not isinstance(found, dict):
        raise InputError(f"a record must be an object of JSON, got {shown(found)}")
    index = integer("index", found.get("index"), 0, recipe.samples - 1)
    _check_text(found, "class", recipe.classes[index % len(recipe.classes)])
    _check_text(found, "condition", *(each.name for each in recipe.conditions))
    integer("description", found.get("description"), 0, recipe.descriptions_per_class - 1)
    _check_text(found, "sentence")
    if found.get("row") is None:
        if found.get("failure") is not None:
            _check_text(found, "failure")
        return found
    integer("row", found["row"])
    _check_numbers(found)
    told = found.get("products")
    for name in recipe.products.kept:
        if not isinstance(told, dict) or not isinstance(told.get(name), dict):
            raise InputError(f"products must tell of {name}, got {shown(told)}")
        _check_product(recipe, name, told[name])
    return found


def _check_numbers(record: Mapping[str, Any]) -> None:
    """What the record of a sample that did not fail tells beside its place and its products."""
    integer("seed", record.get("seed"))
    flag("passed", record.get("passed"))
    for name in ("provider", "body"):
        _check_text(record, name)
    for name in ("distance_m", "angle_deg", "duration_s"):
        number(name, record.get(name))
    for name in ("snr_db", "error_db"):
        if record.get(name, "nothing") is not None:
            number(name, record.get(name, "nothing"))
    for name in ("sources", "reasons"):
        _check_texts(name, record.get(name))
    second = record.get("second_person")
    if second is not None:
        if not isinstance(second, dict):
            raise InputError(f"second_person must be an object of JSON, got {shown(second)}")
        _check_texts("sources", second.get("sources"))
        integer("seed", second.get("seed"))


def _check_text(record: Mapping[str, Any], name: str, *due: str) -> None:
    value = text(name, record.get(name))
    if due and value not in due:
        raise InputError(f"{name} must be {' or '.join(due)}, got {shown(value)}")


def _check_texts(name: str, value: Any) -> None:
    if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
        raise InputError(f"{name} must be a list of texts, got {shown(value)}")


def _check_product(recipe: Recipe, name: str, told: Mapping[str, Any]) -> None:
    """Ends of axes and scales."""
    for each in MAPS.get(name, ()):
        first, last = interval(f"{each} of {name}", told.get(each))
        if not -1e6 < first < last < 1e6:
            raise InputError(f"{each} of {name} must rise, got {shown(told[each])}")
    if name in MAPS:
        number(f"peak_db of {name}", told.get("peak_db"))
    if name == "adc" and recipe.products.kept[name].dtype == "float16":
        positive("greatest of adc", told.get("greatest"))


def array_of(recipe: Recipe, record: Mapping[str, Any], name: str) -> tuple[np.dtype[Any], Sizes]:
    """Type and shape of a sample's array."""
    kept = recipe.products.kept[name]
    if name == "points":
        return np.dtype(np.float32), (None, len(POINT_COLUMNS))
    if name == "truth":
        return np.dtype(np.float32), (None, len(TRUTH_COLUMNS))
    if name == "adc":
        condition = next(each for each in recipe.conditions if each.name == record["condition"])
        radar = condition.radar or recipe.radar
        cube = (None, radar.antennas, radar.samples)
        return np.dtype(kept.dtype), cube if kept.dtype == "complex64" else (*cube, 2)
    return np.dtype(kept.dtype), (*((kept.frames,) if name == "range_doppler" else ()), *kept.size)


def check_array(array: np.ndarray, dtype: np.dtype[Any], shape: Sizes, name: str) -> None:
    """Refuses an array of another type or shape, and values that no sample has."""
    _check_kind(array.dtype, array.shape, dtype, shape, name)
    if not np.isfinite(array).all():
        raise InputError(f"{name} has NaN or infinite values")
    if name in MAPS and dtype.kind == "f" and array.max(initial=-np.inf) > LEAST_ABOVE_DB:
        raise InputError(f"{name} has levels above 0 dB, its greatest cell")


def _check_kind(given: np.dtype[Any], sizes: tuple[int, ...], dtype: np.dtype[Any], shape: Sizes, name: str) -> None:
    fits = len(sizes) == len(shape) and all(due in (None, size) for due, size in zip(shape, sizes, strict=True))
    if given != dtype or not fits:
        due = ", ".join("any" if each is None else str(each) for each in shape)
        raise InputError(f"{name} must be {dtype} of shape ({due}), got {given} of shape {sizes}")


def read_array(path: Path, member: str, dtype: np.dtype[Any], shape: Sizes) -> np.ndarray:
    """An array of an .npz file; type and shape are known, and compared before anything is made of it."""
    with (
        regular_file(path, noun="shard") as file,
        zipfile.ZipFile(file) as packed,
        packed.open(f"{member}.npy") as stream,
    ):
        sizes, _, given = npy_header(stream)
        _check_kind(given, sizes, dtype, shape, member)
        length = stream.tell() + dtype.itemsize * math.prod(sizes)
        if length > LARGEST_BYTES:
            raise InputError(f"{member} takes {length / 1e9:.3g} GB, more than {LARGEST_BYTES / 1e9:g} GB")
        if packed.getinfo(f"{member}.npy").file_size != length:
            raise InputError(f"{member} is not as long as it tells")
        stream.seek(0)
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))
