"""Entries of the cache: damaged, forged, links, other people's. What is read is what was kept, or nothing."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from t2d_rt.core import disk_cache
from t2d_rt.motion.descriptions.language_model import keep_reply, kept_reply
from validation.robustness.fuzz.case import Attempt, Wrong, corrupted, pick, writing_only

ARRAYS = {"a": np.arange(6.0).reshape(2, 3), "b": np.array([1, 2], np.int32)}
REPLY = '{"descriptions": []}'


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One entry and its reading."""
    home = folder / "cache"
    os.environ[disk_cache.VARIABLE] = str(home)
    name = disk_cache.key("geometry", ("a",))
    disk_cache.write(name, ARRAYS)
    reply = disk_cache.key("motion", ("reply",))
    keep_reply(reply, REPLY)
    path = pick(rng, (home / f"{name}.npz", home / f"{reply}.npz"))
    told = pick(rng, (_damaged, _damaged, _forged, _forged, _replaced))(rng, path, folder)
    return Attempt(f"{path.suffix} {told}: read", writing_only(lambda: _read(name, reply), folder, "cache"))


def _read(name: str, reply: str) -> None:
    found = disk_cache.read(name, ARRAYS)
    if found is not None:
        same = all(found[key].dtype == each.dtype and np.array_equal(found[key], each) for key, each in ARRAYS.items())
        if not same:
            raise Wrong("other arrays than were kept")
    if kept_reply(reply) not in (None, REPLY):
        raise Wrong("another reply than was kept")
    if not np.array_equal(disk_cache.kept(name, ARRAYS, lambda: ARRAYS)["a"], ARRAYS["a"]):
        raise Wrong("other arrays than were made")


def _damaged(rng: np.random.Generator, path: Path, _: Path) -> str:
    told, data = corrupted(rng, path.read_bytes())
    path.write_bytes(data)
    return told


def _forged(rng: np.random.Generator, path: Path, _: Path) -> str:
    with np.load(path) as file:
        held = dict(file)
    name = pick(rng, sorted(held))
    held[name] = pick(
        rng, (held[name].astype("U9"), np.zeros(3), np.zeros((0, 2)), np.full((2, 3), np.nan), np.array("x"))
    )
    np.savez(path, **held)
    return f"{name} is another"


def _replaced(rng: np.random.Generator, path: Path, folder: Path) -> str:
    how = pick(rng, ("link", "pipe", "folder", "sparse", "nothing"))
    data = path.read_bytes()
    path.unlink()
    if how == "link":
        (folder / "elsewhere").write_bytes(data)
        path.symlink_to(folder / "elsewhere")
    elif how == "pipe":
        os.mkfifo(path)
    elif how == "folder":
        path.mkdir()
    elif how == "sparse":
        with path.open("wb") as file:
            file.truncate(900_000_000)
    return how
