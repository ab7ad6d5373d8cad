"""Arrays that take longer to make than to read, kept on disk from one process to the next.

An entry is named by the hash of all that it follows from: its inputs, the package's own code that made it, and the versions of
NumPy and SciPy; it holds the hash of its arrays. One that is missing, damaged, from elsewhere or of another user is made anew.
Nothing depends on the folder: it may be moved, emptied at any time, or turned off.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import re
import stat
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from t2d_rt.core.files import OPENING

VARIABLE = "T2D_RT_CACHE"
"""Environment variable that names another folder, or turns the cache off where it is "off" or empty."""
MOST_BYTES, LARGEST_BYTES = 1e9, 100e6
"""Of all entries, the longest unused of which go first, and of one."""
_HEADERS = 1_000_000
"""Bytes of a file of arrays beside these, at most."""
_CHECK = "sha256"
_ENTRY, _UNFINISHED = ".npz", ".t2d-rt-part"
_OWN = re.compile(rf"[0-9a-f]{{64}}{re.escape(_ENTRY)}|.*{re.escape(_UNFINISHED)}")
"""Names of files that are removed to make room: the folder may hold others."""

Arrays = Mapping[str, np.ndarray]


def folder() -> Path | None:
    """Where entries are kept; None where they are not."""
    setting = os.environ.get(VARIABLE)
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        if setting is not None:
            return None if setting.strip().lower() in ("", "off") else Path(setting).expanduser()
        return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "t2d-rt"
    except RuntimeError:  # there is no home
        return None


def key(made_by: str, parts: Iterable[object]) -> str:
    """Name of what the package's folder `made_by` makes of `parts`: arrays, bytes, numbers and texts."""
    digest = hashlib.sha256(_made_with(made_by))
    for part in parts:
        if isinstance(part, np.ndarray):
            part = repr((part.dtype.str, part.shape)).encode() + np.ascontiguousarray(part).tobytes()
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()


@functools.cache
def _made_with(made_by: str) -> bytes:
    """Hash of the source code and of the versions that an entry's numbers depend on."""
    digest = hashlib.sha256("/".join((np.__version__, _scipy_version(), platform.machine())).encode())
    for path in sorted((Path(__file__).parents[1] / made_by).glob("*.py")):
        digest.update(path.read_bytes())
    return digest.digest()


def _scipy_version() -> str:
    import scipy

    return str(scipy.__version__)


def read(name: str, array_names: Iterable[str]) -> dict[str, np.ndarray] | None:
    """The arrays of an entry by their names; None where there is none that can be read."""
    home = folder()
    if home is None:
        return None
    path = home / (name + _ENTRY)
    try:
        with own_file(path) as opened:
            file = np.load(opened, allow_pickle=False)
            if (
                sum(member.file_size for member in file.zip.infolist()) > LARGEST_BYTES + _HEADERS
                or str(file["name"]) != name
            ):
                return None
            arrays = {array_name: file[array_name] for array_name in array_names}
            if str(file[_CHECK]) != _content(arrays):
                return None
    except Exception:  # NumPy and zipfile raise what they like of a damaged file
        return None
    with contextlib.suppress(OSError):  # a folder that may only be read
        os.utime(path)
    return arrays


@contextlib.contextmanager
def own_file(path: Path) -> Iterator[BinaryIO]:
    """An entry, open for reading; OSError for one that somebody else has put there, a link, a pipe, or one of more bytes."""
    descriptor = os.open(path, OPENING | getattr(os, "O_NOFOLLOW", 0))
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        is_own = not hasattr(os, "getuid") or status.st_uid == os.getuid()
        if not is_own or not stat.S_ISREG(status.st_mode) or status.st_size > LARGEST_BYTES + _HEADERS:
            raise OSError(f"{path} is no entry of this user's")
        yield file


def _content(arrays: Arrays) -> str:
    """Hash of the arrays of an entry, their names, types and shapes."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(repr((name, array.dtype.str, array.shape)).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def write(name: str, arrays: Arrays) -> None:
    """Keeps an entry, if the disk allows it."""
    home = folder()
    if home is None or sum(array.nbytes for array in arrays.values()) > LARGEST_BYTES:
        return
    try:
        home.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor, unfinished = tempfile.mkstemp(suffix=_UNFINISHED, dir=home)
        try:
            with os.fdopen(descriptor, "wb") as file:
                np.savez(file, name=np.array(name), **{_CHECK: np.array(_content(arrays))}, **arrays)  # type: ignore[arg-type]
            Path(unfinished).replace(home / (name + _ENTRY))
        except BaseException:
            Path(unfinished).unlink(missing_ok=True)
            raise
        _make_room(home)
    except OSError:
        return


def cached_arrays(name: str, array_names: Iterable[str], make: Callable[[], Arrays]) -> Arrays:
    """The arrays of an entry, made and kept where they are missing."""
    arrays: Arrays | None = read(name, array_names)
    if arrays is None:
        arrays = make()
        write(name, arrays)
    return arrays


def _make_room(home: Path) -> None:
    """Removes what was not used for longest, entries and what killed processes left unfinished."""
    entries = []
    for path in home.iterdir():
        if _OWN.fullmatch(path.name):
            status = path.stat()
            entries.append((status.st_mtime, status.st_size, path))
    room = MOST_BYTES
    for _, size, path in sorted(entries, reverse=True):
        room -= size
        if room < 0:
            path.unlink(missing_ok=True)
