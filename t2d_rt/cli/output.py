"""What the commands print and write, whole files or none, and the signals that stop them."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from t2d_rt.core.atomic_write import LOCKS, abandon, check_file, writing
from t2d_rt.core.errors import InputError, printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = ".png", ".pdf", ".svg"


def say(text: object, *, file: TextIO | None = None) -> None:
    """Prints a text that may hold names and texts of a user's files, so that nothing in them acts as a command to the terminal."""
    print(printable(str(text)), file=file)


def stem_of(source: Path) -> str:
    """A file's name without the endings of motions, experiments and results."""
    endings = r"\.(bvh(\.gz)?|npz|npy|json|txt|amc|c3d|trc|ya?ml|zarr)$"
    return re.sub(endings, "", source.name, flags=re.IGNORECASE)


def check_picture(picture: Path, *, overwrite: bool) -> None:
    """Raises InputError if the name of a picture does not end as one, is taken, or cannot be written."""
    check_file(picture, "a picture", *PICTURES, overwrite=overwrite)


def write_picture(figure: Figure, picture: Path, *, overwrite: bool) -> None:
    """Writes a figure to a file, whole or not at all."""
    with writing(picture, overwrite=overwrite) as temporary:
        figure.savefig(temporary)


def write_text(text: str, place: str | Path, *, overwrite: bool) -> None:
    """Writes a text to a file, whole or not at all."""
    with writing(Path(place), overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8")


def made_folder(place: str | Path) -> Path:
    """The folder of that name, which is made if it is not there; raises InputError if the name is that of a file."""
    folder = Path(place)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is no folder; choose another name")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _refused(*_: Any, **__: Any) -> None:
    raise OSError("the process is ending")


@contextmanager
def stopped_by_sigterm() -> Iterator[None]:
    """Makes SIGTERM, as batch systems and containers send it, leave as little behind as Ctrl-C. It raises no exception, which would
    be lost where none can be raised, as in a finalizer."""

    def stop(*_: Any) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough: what follows is tidying up
        # Other threads still write: they must not warn of files that vanish, nor make folders anew that have just been removed.
        warnings.simplefilter("ignore")
        vars(os)["mkdir"] = _refused
        filled = [f"what is finished in {lock.parent} stays" for lock in LOCKS]
        written = ", ".join([*(f"{path} was written" for path in abandon()), *filled]) or "nothing was written"
        with suppress(RuntimeError, OSError):  # the signal may have come amidst a print
            sys.stdout.flush()
        with suppress(RuntimeError, OSError):
            print(printable(f"t2d-rt: stopped; {written}"), file=sys.stderr, flush=True)
        os._exit(143)

    in_main = threading.current_thread() is threading.main_thread()  # signals arrive only there
    if not in_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
