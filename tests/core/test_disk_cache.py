"""What is kept on disk is what was made, or is made anew."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from builders import WALK
from t2d_rt import load_motion, place, simulate, trim
from t2d_rt.core import disk_cache
from t2d_rt.scattering import points, refinement

ARRAYS = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "b": np.array([1, 2], np.int32)}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv(disk_cache.VARIABLE, str(tmp_path / "cache"))
    forget()
    yield tmp_path / "cache"
    forget()


def forget() -> None:
    for each in (refinement, points):
        each.forget()


def test_arrays_come_back_as_they_were(home: Path) -> None:
    name = disk_cache.key("geometry", (1.5, ARRAYS["a"]))
    assert disk_cache.read(name, ARRAYS) is None
    disk_cache.write(name, ARRAYS)
    found = disk_cache.read(name, ARRAYS)
    for each, array in ARRAYS.items():
        assert found[each].dtype == array.dtype
        np.testing.assert_array_equal(found[each], array)
    assert [path.suffix for path in home.iterdir()] == [".npz"]
    assert home.stat().st_mode & 0o077 == 0


def test_entries_of_others_are_not_believed(home: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Whatever a file tells of itself: another user's, a link, other arrays under the same name, more than an entry may have."""
    name = disk_cache.key("geometry", (1.5,))
    disk_cache.write(name, ARRAYS)
    (path,) = home.iterdir()
    with np.load(path) as file:
        held = dict(file)
    np.savez(path, **{**held, "a": held["a"] + 1})
    assert disk_cache.read(name, ARRAYS) is None
    disk_cache.write(name, ARRAYS)
    assert disk_cache.read(name, ARRAYS) is not None
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    assert disk_cache.read(name, ARRAYS) is None
    monkeypatch.undo()
    monkeypatch.setenv(disk_cache.VARIABLE, str(home))
    path.rename(tmp_path / "elsewhere.npz")
    path.symlink_to(tmp_path / "elsewhere.npz")
    assert disk_cache.read(name, ARRAYS) is None
    path.unlink()
    os.mkfifo(path)
    assert disk_cache.read(name, ARRAYS) is None
    path.unlink()
    bomb = {**held, "a": np.zeros(30_000_000, np.float32)}
    np.savez_compressed(path, **bomb)
    assert disk_cache.read(name, ARRAYS) is None


def test_keys_tell_inputs_and_code_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    a = ARRAYS["a"]
    keys = [
        disk_cache.key("geometry", parts)
        for parts in ((a,), (a.T,), (a.astype(float),), (a.ravel(),), (a, 1.0), (a, 2.0), (b"ab", b"c"), (b"a", b"bc"))
    ]
    keys.append(disk_cache.key("scattering", (a,)))
    monkeypatch.setattr(np, "__version__", "0.0")
    disk_cache._made_with.cache_clear()
    keys.append(disk_cache.key("geometry", (a,)))
    disk_cache._made_with.cache_clear()
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("harm", ["flipped", "cut", "empty", "text", "array", "elsewhere", "folder"])
def test_what_is_damaged_or_from_elsewhere_is_made_anew(home: Path, harm: str) -> None:
    name, other = (disk_cache.key("geometry", (number,)) for number in (1, 2))
    disk_cache.write(name, ARRAYS)
    path = home / f"{name}.npz"
    data = bytearray(path.read_bytes())
    at = data.index(ARRAYS["a"].tobytes()) + 5
    if harm == "flipped":
        data[at] ^= 1
    harmed = {"cut": bytes(data[: len(data) // 2]), "empty": b"", "text": b"not this"}
    path.write_bytes(harmed.get(harm, bytes(data)))
    if harm == "elsewhere":
        name, path = other, path.rename(home / f"{other}.npz")
    if harm == "array":
        with path.open("wb") as file:
            np.save(file, ARRAYS["a"])
    if harm == "folder":
        path.unlink()
        path.mkdir()
    assert disk_cache.read(name, ARRAYS) is None
    made = disk_cache.cached_arrays(name, ARRAYS, lambda: ARRAYS)
    assert made is ARRAYS


def test_an_entry_that_lacks_an_array_is_made_anew() -> None:
    name = disk_cache.key("geometry", (1,))
    disk_cache.write(name, {"a": ARRAYS["a"]})
    assert disk_cache.read(name, ARRAYS) is None


def test_the_longest_unused_go_first(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_cache, "MOST_BYTES", 3.5 * 8e4)
    names = [disk_cache.key("geometry", (number,)) for number in range(4)]
    for age, name in enumerate(names[:3]):
        disk_cache.write(name, {"a": np.zeros(10_000)})
        os.utime(home / f"{name}.npz", (age, age))
    assert disk_cache.read(names[0], ["a"]) is not None  # used just now
    disk_cache.write(names[3], {"a": np.zeros(10_000)})
    assert [disk_cache.read(name, ["a"]) is not None for name in names] == [True, False, True, True]


def test_files_of_others_in_the_folder_stay(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home.mkdir()
    others = [home / "walk.npz", home / "download.part", home / "notes.txt"]
    for each in others:
        each.write_bytes(bytes(10_000))
        os.utime(each, (1, 1))
    monkeypatch.setattr(disk_cache, "MOST_BYTES", 100.0)
    (home / f"x{disk_cache._UNFINISHED}").write_bytes(bytes(10_000))
    name = disk_cache.key("geometry", (1,))
    disk_cache.write(name, ARRAYS)
    assert sorted(home.iterdir()) == sorted(others)  # of what is its own, all of it is too much


def test_an_entry_that_cannot_be_marked_as_used_is_read(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = disk_cache.key("geometry", (1,))
    disk_cache.write(name, ARRAYS)

    def foreign(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "utime", foreign)
    assert disk_cache.read(name, ARRAYS) is not None


def test_what_is_too_large_is_not_kept(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_cache, "LARGEST_BYTES", 10)
    disk_cache.write(disk_cache.key("geometry", ()), ARRAYS)
    assert not home.exists()


@pytest.mark.parametrize("given", ["off", "", " OFF "])
def test_it_can_be_turned_off(given: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(disk_cache.VARIABLE, given)
    assert disk_cache.folder() is None
    disk_cache.write("a", ARRAYS)
    assert disk_cache.read("a", ARRAYS) is None


def test_the_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(disk_cache.VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert disk_cache.folder() == tmp_path / "t2d-rt"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert disk_cache.folder() == tmp_path / "home" / ".cache" / "t2d-rt"
    monkeypatch.setenv(disk_cache.VARIABLE, "~/kept")
    assert disk_cache.folder() == tmp_path / "home" / "kept"


def test_a_folder_that_cannot_be_written_does_no_harm(home: Path) -> None:
    home.parent.mkdir(exist_ok=True)
    home.write_text("a file")
    disk_cache.write("a", ARRAYS)
    assert disk_cache.read("a", ARRAYS) is None
    assert home.read_text() == "a file"


@pytest.mark.slow
def test_recordings_are_the_same_with_nothing_kept_in_memory_and_on_disk(home: Path) -> None:
    walk = trim(place(load_motion(WALK)), 0.5, 0.7)
    cubes = []
    for _ in range(2):
        forget()
        cubes.append(np.asarray(simulate(walk, radar="table2").cube[:]))
        assert len(list(home.glob("*.npz"))) == 3  # facets, what holds the diffuse points, and these
    np.testing.assert_array_equal(cubes[0], cubes[1])
