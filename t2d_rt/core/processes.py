"""Processes that end with the one that started them, however that one ends: SIGKILL and a lack of memory let nobody tidy up.

PR_SET_PDEATHSIG would not do: it tells of the end of the thread that started a process, and Linux alone has it.
"""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

INTERVAL_S = 0.25
"""How often a worker looks whether its main process lives [s]."""


@functools.cache
def end_with(parent: int) -> None:
    """From now on this process ends as soon as `parent`, which started it, is no more its parent; one watch is enough for it."""
    if os.getppid() != parent:
        os._exit(1)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(INTERVAL_S)
        os._exit(1)

    threading.Thread(target=watch, name="watch of the main process", daemon=True).start()


def run_guarded(
    command: Sequence[str], *, folder: Path, env: Mapping[str, str], limit_s: float, temporary: Sequence[Path] = ()
) -> subprocess.CompletedProcess[bytes]:
    """What a foreign program gives back, as `subprocess.run` has it, and raises at the limit.

    A process beside watches over it: where this one ends first, it stops the program with all that the program has started, and
    removes the `temporary` folders.
    """
    guard = [sys.executable, "-I", "-S", __file__, str(len(temporary)), *map(str, temporary), *command]
    ours, theirs = os.pipe()  # ours is at its end when nobody holds theirs any more
    with os.fdopen(ours, "rb") as end, os.fdopen(theirs, "wb") as held:
        with subprocess.Popen(
            guard,
            cwd=folder,
            env=dict(env),
            stdin=end,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        ) as process:
            try:
                out, err = process.communicate(timeout=limit_s)
            except BaseException:
                held.close()
                process.wait()
                raise
        return subprocess.CompletedProcess([*command], process.returncode, out, err)


NOT_FOUND, NOT_ALLOWED = 127, 126
"""Exit codes for a program that is not there or may not be run, as a shell has them."""


def _guard(words: Sequence[str]) -> int:
    """The process beside; it imports nothing of this package, and so starts within a hundredth of a second."""
    import select

    count = int(words[0])
    temporary, command = words[1 : 1 + count], words[1 + count :]
    try:
        program = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
    except PermissionError:
        return NOT_ALLOWED
    except OSError:
        return NOT_FOUND
    while (code := program.poll()) is None:
        if select.select([sys.stdin], [], [], 0.05)[0]:  # nobody writes: the end
            with contextlib.suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
            program.wait()
            for folder in temporary:
                shutil.rmtree(folder, ignore_errors=True)
            return 1
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(_guard(sys.argv[1:]))
