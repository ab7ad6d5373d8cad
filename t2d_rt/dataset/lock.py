"""One run at a time in a folder.

The lock is the kernel's (flock), which ends with the process, however that ends. Some network file systems have none, and none
reaches to another machine: there the file's text, process and machine, tells who works in the folder.
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
    """Holds a folder's lock, a file that tells process and machine; that of a process which is gone is taken over."""
    path, host = folder / LOCK, socket.gethostname()
    file = _locked_file(folder)
    try:
        holder = _holder(file)
        if holder and holder.get("host") != host:  # its lock may not be seen here
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
    """The lock's file, opened and locked; opened anew where the run that held it took it away in between."""
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
            except OSError:  # a file system without locks: process and machine tell
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
    """Whether a run works in a folder; of one on another machine, whether it has not taken its lock away."""
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
    """What a lock's file tells of who holds it; nothing where it is empty or damaged."""
    try:
        holder = json.loads(os.pread(file, 1000, 0) or b"{}")
    except (ValueError, RecursionError):
        return {}
    return holder if isinstance(holder, dict) else {}


def _alive(pid: object) -> bool:
    """Whether a process of this machine runs; one of another user does, though it cannot be signalled."""
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
