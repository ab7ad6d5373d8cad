"""Saved recordings: bytes flipped, files cut, gone, exchanged, metadata edited. What loads must be what was saved."""

from __future__ import annotations

import base64
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import t2d_rt as t2d
from validation.robustness.fuzz.case import (
    MOTIONS,
    Attempt,
    Wrong,
    chance,
    check_recording,
    command,
    corrupted,
    pick,
    quick_radar,
)

CHIRPS = 300
VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1.5, 10**30, "", "x", "float64", "NaN", "Infinity", [], [1], [0, 1, 32], [300, 1, 32], [-300, 1, 32],
    [10**12, 1, 32], {},
    {"name": "x"}, {"a": {"b": [1]}}, "\x1b[31m", "../../outside", "{", '{"a": 1}', "[]", "null", "NaN", "a" * 5000, [[[]]],
    "complex128", "object",
)  # fmt: skip


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One damaged recording and what reads it."""
    place = folder / "walk.zarr"
    large = chance(rng, 0.3)
    if large:
        _small_limit()
    saved = recording()
    saved.save(place)
    shutil.copytree(place, folder / "outside")
    told = pick(rng, (_bytes, _bytes, _files, _metadata, _metadata, _metadata, _attributes, _attributes))(rng, place)
    use = pick(rng, ("load", "load", "load", "info", "overwrite", "command"))
    told = f"{told[:300]}{', as a large cube' if large else ''}"
    if use == "info":
        return Attempt(f"{told}: t2d-rt info walk.zarr", command(["info", "walk.zarr"]))
    if use == "overwrite":
        return Attempt(f"{told}: save('walk.zarr', overwrite=True)", lambda: _overwritten(place))
    if use == "command":
        words = [
            "simulate", str(MOTIONS / "momask_22j_120frames.bvh"), "--method=ellipsoid", "--stop-s=0.2", "--radar=ci4r",
            "--radar.samples=32",
            "--radar.prf-hz=2000", "-o", "walk.zarr", "--overwrite",
        ]  # fmt: skip
        return Attempt(f"{told}: t2d-rt {' '.join(words)}", lambda: _replaced(words, place))
    return Attempt(f"{told}: Recording.load('walk.zarr')", lambda: _loaded(place, saved))


def recording() -> t2d.Recording:
    """A small recording, the same each time."""
    radar = quick_radar()
    rng = np.random.default_rng(1)
    cube = rng.normal(size=(CHIRPS, 1, radar.samples)) + 1j * rng.normal(size=(CHIRPS, 1, radar.samples))
    settings = {"method": "mesh", "scene": "free_space", "seed": 3, "targets": ["a walk"], "error_db": -21.5}
    return t2d.Recording(
        (1e-6 * cube).astype(np.complex64),
        radar,
        settings=settings,
        versions={"t2d-rt": "0"},
        processing={"n_window": 128},
    )


def _small_limit() -> None:
    """Cubes of more than a few kilobytes go to disk."""
    from t2d_rt.core import cubes

    for name, value in (("LARGE_BYTES", 4096), ("BLOCK_BYTES", 16384)):
        if hasattr(cubes, name):
            setattr(cubes, name, value)


def _all_files(place: Path) -> list[Path]:
    return sorted(path for path in place.rglob("*") if path.is_file())


def _bytes(rng: np.random.Generator, place: Path) -> str:
    path = pick(rng, _all_files(place))
    told, data = corrupted(rng, path.read_bytes())
    path.write_bytes(data)
    return f"{path.relative_to(place)}: {told}"


def _files(rng: np.random.Generator, place: Path) -> str:
    """A file or folder gone, exchanged with another, a link, a pipe, a folder."""
    path = pick(rng, _all_files(place) if chance(rng, 0.7) else sorted(p for p in place.rglob("*") if p.is_dir()))
    other = pick(rng, _all_files(place))
    how = pick(
        rng,
        (
            "gone", "as another", "link", "link to zeros", "pipe", "folder", "unreadable", "link outside", "extra",
            "the whole a link",
        ),
    )  # fmt: skip
    name = path.relative_to(place)
    if how == "as another" and path.is_file():
        path.write_bytes(other.read_bytes())
        return f"{name} as {other.relative_to(place)}"
    if how == "the whole a link":
        place.rename(place.with_name("elsewhere"))
        place.symlink_to("elsewhere")
        return "the recording is a link"
    if how == "extra":
        (place / pick(rng, ("c", "adc/c/9", "x", ".zgroup", ".zattrs", "adc/.zarray", "spectrogram/c/9/9"))).mkdir(
            parents=True, exist_ok=True
        )
        return "one folder more"
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    if how == "link":
        path.symlink_to(path.name)
    elif how == "link to zeros":
        path.symlink_to("/dev/zero")
    elif how == "link outside":
        path.symlink_to(place.with_name("outside") / name)
    elif how == "pipe":
        os.mkfifo(path)
    elif how == "folder":
        path.mkdir()
    elif how == "unreadable":
        path.symlink_to("/proc/self/mem")
    return f"{name} is {how}"


def _metadata(rng: np.random.Generator, place: Path) -> str:
    """One or two values anywhere in a zarr.json get another one, go, or get a neighbour."""
    path = pick(rng, sorted(place.rglob("zarr.json")))
    values = json.loads(path.read_text())
    told = []
    for _ in range(int(rng.integers(1, 3))):
        spots = list(_spots(values))
        holder, key, where = pick(rng, spots)
        how = pick(rng, ("replaced", "replaced", "gone", "more"))
        if how == "gone" and isinstance(holder, dict):
            holder.pop(key, None)
        elif how == "more" and isinstance(holder, dict):
            holder[pick(rng, ("x", "fill_value", "compressor", "must_understand"))] = pick(rng, VALUES)
        else:
            holder[key] = _near(rng, holder[key]) if chance(rng, 0.5) else pick(rng, VALUES)
            how = f"{holder[key]!r:.40}"
        told.append(f"{where} {how}")
    path.write_text(json.dumps(values))
    return f"{path.relative_to(place)}: {'; '.join(told)}"


def _spots(values: Any, where: str = "") -> Any:
    """Every place in a tree of JSON: its holder, its key, its name."""
    items = values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else ()
    for key, value in items:
        yield values, key, f"{where}/{key}"
        yield from _spots(value, f"{where}/{key}")


def _near(rng: np.random.Generator, value: Any) -> Any:
    """A value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return pick(rng, (value + 1, -value, value * 2, value * 1000, 0, 10**9))
    if isinstance(value, str):
        return pick(
            rng, (value[:-1], value + "x", value.upper(), value.replace("little", "big"), value.replace("3", "4"))
        )
    return value


def _attributes(rng: np.random.Generator, place: Path) -> str:
    """One of the recording's own attributes, in both places where metadata stand."""
    path = place / "zarr.json"
    values = json.loads(path.read_text())
    attributes = values["attributes"]
    name = pick(rng, sorted(attributes))
    text = attributes[name]
    how = pick(rng, ("changed", "changed", "gone", "value", "encoded"))
    if how == "gone":
        del attributes[name]
    elif how == "value":
        attributes[name] = pick(rng, VALUES)
    elif how == "encoded":
        attributes[name] = base64.b64encode(str(text).encode()).decode()
    else:
        try:
            inner = json.loads(text)
        except (TypeError, ValueError):
            inner = None
        spots = list(_spots(inner))
        if spots:
            holder, key, where = pick(rng, spots)
            holder[key] = _near(rng, holder[key]) if chance(rng, 0.6) else pick(rng, VALUES)
            attributes[name], how = json.dumps(inner), f"{where} {holder[key]!r:.40}"
        else:
            attributes[name] = _near(rng, text)
    path.write_text(json.dumps(values))
    return f"attribute {name}: {how}"


# --- what is done with it -------------------------------------------------------------------------------------------


def _loaded(place: Path, saved: t2d.Recording) -> None:
    loaded = t2d.Recording.load(place)
    check_recording(loaded)
    if loaded.radar != saved.radar:
        raise Wrong("loaded with another radar than was saved")
    for name in ("settings", "processing", "versions"):
        if json.dumps(getattr(loaded, name), sort_keys=True) != json.dumps(getattr(saved, name), sort_keys=True):
            raise Wrong(f"loaded with other {name} than were saved")
    if not np.array_equal(loaded.adc.values, saved.cube):
        raise Wrong("loaded with other samples than were saved")
    _check_stored(place, saved)


def _check_stored(place: Path, saved: t2d.Recording) -> None:
    """What other programs read in the folder is what was saved, too: `load` has checked it."""
    import xarray as xr

    wanted = {"spectrogram": saved.spectrogram, "adc": saved.adc}
    try:
        with xr.open_zarr(place) as data:
            for name, array in wanted.items():
                for axis, coordinate in array.coords.items():
                    if not np.array_equal(data[axis].values, coordinate.values):
                        raise Wrong(f"loaded although {axis} is damaged")
                if not np.array_equal(data[name].values, array.values, equal_nan=True):
                    raise Wrong(f"loaded although {name} is damaged for xarray")
    except Wrong:
        raise
    except Exception as error:
        raise Wrong(f"loaded although xarray cannot read it: {type(error).__name__} {error}") from None


def _overwritten(place: Path) -> None:
    """After a save without complaint the new recording is there."""
    fresh = recording().processed(n_window=64)
    fresh.save(place, overwrite=True)
    _loaded(place, fresh)


def _replaced(words: list[str], place: Path) -> None:
    act: Callable[[], str] = command(words)
    act()
    check_recording(t2d.Recording.load(place))
