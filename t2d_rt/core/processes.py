"""Processes that end with the process that started them, even if that is killed (SIGKILL, lack of memory) and cannot clean up.

PR_SET_PDEATHSIG is not used: it reacts to the end of the thread that started a process, and only Linux has it.
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
"""Interval at which a worker checks whether its main process is alive [s]."""


@functools.cache
def end_with(parent: int) -> None:
    """Makes this process end as soon as `parent`, which started it, is no longer its parent; further calls have no effect."""
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
    """Runs a foreign program as `subprocess.run` does; raises its `TimeoutExpired` after `limit_s`.

    A guard process watches: if this process ends first, it stops the program with everything that the program has started, and
    removes the `temporary` folders.
    """
    guard = [sys.executable, "-I", "-S", __file__, str(len(temporary)), *map(str, temporary), *command]
    ours, theirs = os.pipe()  # the guard ends when nobody holds the other end of its pipe any more
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
"""Exit codes of a program that does not exist or may not be executed, as in a shell."""


def _guard(words: Sequence[str]) -> int:
    """Code of the guard process. It imports nothing of this package, so that it starts within a hundredth of a second."""
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
        if select.select([sys.stdin], [], [], 0.05)[0]:  # end of file: no process holds the writing end
            with contextlib.suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
            program.wait()
            for folder in temporary:
                shutil.rmtree(folder, ignore_errors=True)
            return 1
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(_guard(sys.argv[1:]))
