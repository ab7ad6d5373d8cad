"""What is written takes its place whole: made in a folder of its own beside the target and moved there when it is done.

Beside `target` a process makes `.NAME.partial-xxxxxxxx` with

    lock   held (flock) as long as the process works on it, so that what dead processes left can be told from the others
    new/   what is being made: NAME, and what goes beside it
    old/   what stood at the target before, until the move is done

Which of these exist shows how far a process came, so that the next one can restore the old or complete the move (`settle`).
Moves of one folder follow one another: its own flock is held during a move.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from t2d_rt.core.errors import InputError

WAIT_S = 60.0
"""Longest wait for the lock of a folder [s]; others hold it only briefly."""
REMOVAL_TRIES, PAUSE_S = 40, 0.05
"""Number of tries, and pause between them [s], to remove a folder into which threads may still be writing files."""


@dataclass(slots=True)
class _Work:
    """What this process is writing for one target."""

    folder: Path
    target: Path
    moved: bool = False


_WORKING: list[_Work] = []
"""Everything that this process is writing now, for `abandon`."""
LOCKS: set[Path] = set()
"""Lock files of the folders that this process fills with finished parts; also for `abandon`."""


@contextmanager
def replacing(target: Path, check: Callable[[], None]) -> Iterator[Path]:
    """Gives a path to make a file or folder at; it takes the place of `target` if the block ends well, or nothing changes.

    What is made beside it (`path.with_name`), once it is there itself, is moved beside the target. `check` is called when the place
    is about to be taken and raises if it may not be, as another process may have taken it meanwhile.
    """
    moved = False
    try:
        with _own_folder(target) as work:
            new = work.folder / "new" / target.name
            yield new
            with _locked(target.parent):
                _check_again(check)
                try:
                    if target.is_dir():
                        target.rename(work.folder / "old" / target.name)
                    new.rename(target)
                    moved = work.moved = True
                finally:
                    _restore(work.folder, target)
                _complete(work.folder, target)
    except OSError as error:
        what = f"what belongs beside {target}, which is written" if moved else f"{target}"
        raise InputError(
            f"cannot write {what}: {error.strerror or error}; free space or choose a writable place"
        ) from error
    except KeyboardInterrupt as stopped:
        if moved:
            stopped.add_note(f"{target} was written")
        raise


def abandon() -> list[Path]:
    """Cleans up in a process that is about to end; returns the targets that had been written completely by then."""
    for work in _WORKING:
        with suppress(OSError):
            _restore(work.folder, work.target)
            _complete(work.folder, work.target)
            _remove(work.folder)
            time.sleep(PAUSE_S)  # a thread that was still writing may have created it again
            _remove(work.folder)
    for lock in LOCKS:
        lock.unlink(missing_ok=True)
    return [work.target for work in _WORKING if work.moved]


def check_place(path: Path, *, overwrite: bool) -> None:
    """Refuses a path that exists, unless `overwrite`, or whose folder does not exist or cannot be written to."""
    folder = path.parent
    if not folder.is_dir():
        for place in (folder, *folder.parents):
            if place.is_file():
                raise InputError(f"{place} is a file, and {path.name} needs a folder; choose another place")
        raise InputError(f"folder {folder} does not exist; create it first")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
        settle(path)
    except OSError as error:
        raise InputError(f"folder {folder} is not writable ({error.strerror}); choose another place") from error
    check_taken(path, overwrite=overwrite)


def check_no_folder(path: Path) -> None:
    """Refuses a folder, which a file would take the place of with all that is in it."""
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder; choose the name of a file")


def check_file(path: Path, noun: str, *endings: str, overwrite: bool) -> None:
    """Refuses a file name that has another ending, exists, or cannot be written; `noun` is "a picture" or the like."""
    if path.suffix.lower() not in endings:
        *others, last = endings
        ends = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"{noun} ends in {ends}, got '{path}'; choose another name")
    if path.is_dir():
        raise InputError(f"{path} is a folder; choose another name for the {noun.partition(' ')[2]}")
    check_place(path, overwrite=overwrite)


@contextmanager
def writing(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """Gives the path of a temporary file to write, which replaces `path` when the block ends without an error."""
    with replacing(path, partial(check_taken, path, overwrite=overwrite)) as new:
        yield new


def check_taken(path: Path, *, overwrite: bool) -> None:
    """Refuses a path that exists, unless `overwrite`."""
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists already; choose another name or pass --overwrite (overwrite=True)")


def settle(target: Path) -> None:
    """Repairs what processes that died while they wrote `target` have left beside it."""
    if not _partials(target):
        return
    with _locked(target.parent):
        for folder in _partials(target):
            with _lock_of_the_dead(folder) as dead:
                if dead:
                    _restore(folder, target)
                    with suppress(OSError):  # the path beside may be a folder by now
                        _complete(folder, target)
                    _remove(folder)


def _check_again(check: Callable[[], None]) -> None:
    try:
        check()
    except InputError as error:
        raise InputError(
            f"nothing was written, for another process has changed the place meanwhile: {error}"
        ) from error


def _restore(folder: Path, target: Path) -> None:
    """Moves the old content back where the new content has not reached its place."""
    new, old = folder / "new" / target.name, folder / "old" / target.name
    if os.path.lexists(new) and os.path.lexists(old) and not os.path.lexists(target):
        old.rename(target)


def _complete(folder: Path, target: Path) -> None:
    """Moves the files that belong beside the new content to their places, once the content itself is in its place."""
    new = folder / "new"
    if os.path.lexists(target) and new.is_dir() and not os.path.lexists(new / target.name):
        for beside in new.iterdir():
            beside.replace(target.with_name(beside.name))


@contextmanager
def _own_folder(target: Path) -> Iterator[_Work]:
    import fcntl

    folder = target.with_name(f".{target.name}.partial-{secrets.token_hex(4)}")
    work = _Work(folder, target)
    with _locked(target.parent):  # without a held lock other processes would take the folder for that of a dead process
        _WORKING.append(work)  # first, as SIGTERM may come at any moment from here on
        try:
            folder.mkdir(0o700)
            try:
                lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
            except BaseException:
                folder.rmdir()
                raise
        except BaseException:
            _WORKING.remove(work)
            raise
        with suppress(OSError):  # the file system has no locks
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    try:
        (folder / "new").mkdir()
        (folder / "old").mkdir()
        yield work
    finally:
        try:
            _restore(folder, target)
            _remove(folder)
        finally:
            _WORKING.remove(work)
            os.close(lock)


def _partials(target: Path) -> list[Path]:
    """Folders of processes that write, or wrote, `target`; never a link, which could lead anywhere."""
    pattern = re.compile(rf"\.{re.escape(target.name)}\.partial-[a-z0-9_]{{8}}")
    with os.scandir(target.parent) as entries:
        return [Path(e.path) for e in entries if pattern.fullmatch(e.name) and e.is_dir(follow_symlinks=False)]


@contextmanager
def _lock_of_the_dead(folder: Path) -> Iterator[bool]:
    """Holds the folder's lock and tells whether no other process holds it. If there is no lock file, tells whether the folder holds
    only files of such processes."""
    import fcntl

    try:
        lock = os.open(folder / "lock", os.O_RDWR | os.O_NOFOLLOW)
    except FileNotFoundError:  # killed before it made the lock, or a thread wrote during the removal
        yield {entry.name for entry in folder.iterdir()} <= {"new", "old"}
        return
    except OSError:  # it belongs to another user
        yield False
        return
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield False
        else:
            yield True
    finally:
        os.close(lock)


def _remove(folder: Path) -> None:
    # The lock goes last: without it the folder would not be recognised as one of these.
    for part in (folder / "new", folder / "old", folder):
        for _ in range(REMOVAL_TRIES):
            shutil.rmtree(part, ignore_errors=True)
            if not part.exists():
                break
            time.sleep(PAUSE_S)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Holds the folder's own lock; other processes and threads wait for it."""
    import fcntl

    place = os.open(folder, os.O_RDONLY)
    try:
        _wait_for(place, folder)
        yield
    finally:
        with suppress(OSError):  # explicitly, since a process forked in the meantime holds it, too
            fcntl.flock(place, fcntl.LOCK_UN)
        os.close(place)


def _wait_for(place: int, folder: Path) -> None:
    import fcntl

    end = time.monotonic() + WAIT_S
    while time.monotonic() < end:
        try:
            return fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.01)
        except OSError:  # a file system without locks: unique names still keep writers apart
            return None
    raise InputError(
        f"another process has held the lock of {folder} for {WAIT_S:g} s; stop it, or choose another place"
    )
