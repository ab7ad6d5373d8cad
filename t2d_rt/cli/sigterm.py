"""SIGTERM, as batch systems and containers send it."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from t2d_rt.core.atomic_write import LOCKS, abandon
from t2d_rt.core.errors import printable


def _refused(*_: Any, **__: Any) -> None:
    raise OSError("the process is ending")


@contextmanager
def stopped_by_sigterm() -> Iterator[None]:
    """SIGTERM leaves as little behind as Ctrl-C. An exception would be lost where one cannot be raised, as in a finalizer."""

    def stop(*_: Any) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough: what follows is tidying up
        # Other threads still write: they must not warn of files that vanish, nor make folders anew that have just been removed.
        warnings.simplefilter("ignore")
        vars(os)["mkdir"] = _refused
        filled = [f"what is finished in {lock.parent} stays" for lock in LOCKS]
        written = ", ".join([*(f"{path} was written" for path in abandon()), *filled]) or "nothing was written"
        with suppress(RuntimeError, OSError):  # it may have come amidst a print
            sys.stdout.flush()
            print(printable(f"t2d-rt: stopped; {written}"), file=sys.stderr, flush=True)
        os._exit(143)

    in_main = threading.current_thread() is threading.main_thread()  # only there signals arrive
    if not in_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
