"""Cache on disk for arrays that take longer to compute than to read, shared by processes.

An entry is named by a hash of everything that determines it: its inputs, the package's own code that made it, and the versions of
NumPy and SciPy. The file also holds a hash of its arrays. An entry that is missing, damaged, or of another origin or user is
computed anew. The folder may be moved, emptied at any time, or switched off.
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
"""Environment variable for the path of another folder; "off" or an empty value switches the cache off."""
MOST_BYTES, LARGEST_BYTES = 1e9, 100e6
"""Greatest size of all entries together, of which the least recently used are removed first, and of a single entry [bytes]."""
_HEADERS = 1_000_000
"""Greatest size of what a file holds beside its arrays [bytes]."""
_CHECK = "sha256"
_ENTRY, _UNFINISHED = ".npz", ".t2d-rt-part"
_OWN = re.compile(rf"[0-9a-f]{{64}}{re.escape(_ENTRY)}|.*{re.escape(_UNFINISHED)}")
"""Pattern for the names of files that may be removed to make room, as the folder may hold other files."""

Arrays = Mapping[str, np.ndarray]


def folder() -> Path | None:
    """The folder of the cache; None where it is switched off."""
    setting = os.environ.get(VARIABLE)
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        if setting is not None:
            return None if setting.strip().lower() in ("", "off") else Path(setting).expanduser()
        return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "t2d-rt"
    except RuntimeError:  # there is no home directory
        return None


def key(made_by: str, parts: Iterable[object]) -> str:
    """Name of the entry for what the package's folder `made_by` computes from `parts`: arrays, bytes, numbers and texts."""
    digest = hashlib.sha256(_made_with(made_by))
    for part in parts:
        if isinstance(part, np.ndarray):
            part = repr((part.dtype.str, part.shape)).encode() + np.ascontiguousarray(part).tobytes()
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()


@functools.cache
def _made_with(made_by: str) -> bytes:
    """Hash of the source code and of the versions that determine an entry's numbers."""
    digest = hashlib.sha256("/".join((np.__version__, _scipy_version(), platform.machine())).encode())
    for path in sorted((Path(__file__).parents[1] / made_by).glob("*.py")):
        digest.update(path.read_bytes())
    return digest.digest()


def _scipy_version() -> str:
    import scipy

    return str(scipy.__version__)


def read(name: str, array_names: Iterable[str]) -> dict[str, np.ndarray] | None:
    """Arrays of an entry by name; None where there is no readable entry."""
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
    except Exception:  # NumPy and zipfile may raise anything for a damaged file
        return None
    with contextlib.suppress(OSError):  # the folder may be read-only
        os.utime(path)
    return arrays


@contextlib.contextmanager
def own_file(path: Path) -> Iterator[BinaryIO]:
    """An entry opened for reading; raises OSError for one of another owner, a link, a pipe, or a file that is too large."""
    descriptor = os.open(path, OPENING | getattr(os, "O_NOFOLLOW", 0))
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        is_own = not hasattr(os, "getuid") or status.st_uid == os.getuid()
        if not is_own or not stat.S_ISREG(status.st_mode) or status.st_size > LARGEST_BYTES + _HEADERS:
            raise OSError(f"{path} is no entry of this user's")
        yield file


def _content(arrays: Arrays) -> str:
    """Hash of the arrays of an entry, with their names, types and shapes."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(repr((name, array.dtype.str, array.shape)).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def write(name: str, arrays: Arrays) -> None:
    """Stores an entry, if the disk allows it."""
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
    """Arrays of an entry; computed by `make` and stored where there is none."""
    arrays: Arrays | None = read(name, array_names)
    if arrays is None:
        arrays = make()
        write(name, arrays)
    return arrays


def _make_room(home: Path) -> None:
    """Removes the least recently used entries, and what killed processes left unfinished."""
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
