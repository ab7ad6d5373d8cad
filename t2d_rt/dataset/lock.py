"""A lock that lets only one run work in a folder.

It is the kernel's flock, which ends with the process, however that ends. Some network file systems have none, and it does not reach
other machines; there the text in the lock file, with process and machine, says who works in the folder.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from t2d_rt.core.atomic_write import LOCKS
from t2d_rt.core.errors import InputError

LOCK = ".lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Holds a folder's lock, a file with the process and machine in it; takes over the lock of a process that no longer exists."""
    path, host = folder / LOCK, socket.gethostname()
    file = _locked_file(folder)
    try:
        holder = _holder(file)
        if holder and holder.get("host") != host:  # a lock held there may not be visible here
            raise _in_use(folder, holder)
        os.ftruncate(file, 0)
        os.pwrite(file, json.dumps({"pid": os.getpid(), "host": host}).encode(), 0)
        LOCKS.add(path)
        try:
            yield
        finally:
            LOCKS.discard(path)
            os.ftruncate(file, 0)
            with suppress(OSError):
                path.unlink()
    finally:
        os.close(file)


def _locked_file(folder: Path) -> int:
    """The open, locked lock file; it is opened again where the previous holder removed it in between."""
    import fcntl

    path = folder / LOCK
    while True:
        try:
            file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise InputError(f"cannot write to {folder}: {error.strerror or error}; choose a writable place") from None
        try:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise _in_use(folder, _holder(file)) from None
            except OSError:  # a file system without locks: rely on process and machine
                holder = _holder(file)
                if holder.get("host") == socket.gethostname() and _alive(holder.get("pid")):
                    raise _in_use(folder, holder) from None
            with suppress(OSError):
                if os.path.samestat(os.fstat(file), path.stat()):
                    return file
        except BaseException:
            os.close(file)
            raise
        os.close(file)


def in_use(folder: Path) -> bool:
    """Whether a run works in a folder; for a run on another machine, whether its lock file is still there."""
    try:
        file = os.open(folder / LOCK, os.O_RDONLY)
    except OSError:
        return False
    try:
        holder = _holder(file)
    finally:
        os.close(file)
    return bool(holder) and (holder.get("host") != socket.gethostname() or _alive(holder.get("pid")))


def _holder(file: int) -> dict[str, object]:
    """The content of a lock file, about its holder; empty where it is damaged."""
    try:
        holder = json.loads(os.pread(file, 1000, 0) or b"{}")
    except (ValueError, RecursionError):
        return {}
    return holder if isinstance(holder, dict) else {}


def _alive(pid: object) -> bool:
    """Whether a process exists on this machine, even that of another user, which cannot be signalled."""
    try:
        os.kill(int(str(pid)), 0)
    except (ValueError, ProcessLookupError):
        return False
    except PermissionError:
        return True
    return True


def _in_use(folder: Path, holder: dict[str, object]) -> InputError:
    process = f"process {holder.get('pid', 'unknown')} on {holder.get('host', 'this machine')}"
    return InputError(f"{folder} is being written by {process}; wait for it, or remove {folder / LOCK} if it is gone")
