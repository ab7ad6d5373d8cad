"""Main processes that end at any moment in any way: no worker and no program is left, and the lock of the folder can be taken."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from t2d_rt.dataset.lock import locked
from validation.robustness.fuzz.case import Attempt, Wrong, check_gone, pick

PROGRAM = """
import subprocess, sys
from pathlib import Path
from t2d_rt.core.processes import run_guarded
folder = Path("temporary"); folder.mkdir()
code = ("import os, subprocess, time; child = subprocess.Popen(['sleep', '60']);"
        "open('pids', 'w').write('%d %d' % (os.getpid(), child.pid)); time.sleep(60)")
run_guarded([sys.executable, "-c", code], folder=Path.cwd(), env={}, limit_s=60, temporary=[folder.resolve()])
"""
WORKERS = """
import os, time
from pathlib import Path
from joblib import Parallel, delayed, parallel_config
from t2d_rt.dataset.lock import locked
from t2d_rt.core.processes import end_with
def work(number):
    with open("pids", "a") as file: file.write("%d " % os.getpid())
    time.sleep(30)
with locked(Path.cwd()), parallel_config(backend="loky", initializer=end_with, initargs=(os.getpid(),)):
    Parallel(n_jobs=2)(delayed(work)(number) for number in range(4))
"""
SIGNALS = signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One program, when it ends, and by which signal."""
    what, program = pick(rng, (("a program", PROGRAM), ("a program", PROGRAM), ("workers", WORKERS)))
    how, delay_s = pick(rng, SIGNALS), float(rng.exponential(0.1))
    return Attempt(f"{what}, {how.name} {delay_s:.2f} s after its start", lambda: _ended(program, how, delay_s, folder))


def _ended(program: str, how: signal.Signals, delay_s: float, folder: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", program], cwd=folder, stderr=subprocess.DEVNULL) as main:
        end = time.monotonic() + 6
        while not (folder / "pids").exists() and main.poll() is None and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(delay_s)
        main.send_signal(how)
    if main.returncode != -how:
        raise Wrong(f"it ended by itself, with {main.returncode}")
    time.sleep(0.3)
    noted = (folder / "pids").read_text().split() if (folder / "pids").exists() else []
    check_gone([int(each) for each in noted])
    with locked(folder):
        pass
    if (folder / "temporary").exists():
        raise Wrong("its temporary folder was left")
