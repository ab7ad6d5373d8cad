"""`python -m validation.gpu` runs the cases on a GPU against a reference, which `python -m validation.gpu make` writes on a CPU."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import threading
import time
import warnings
from importlib import import_module
from typing import Any
from unittest.mock import patch

import numpy as np

from validation.gpu.cases import CASES, ERROR_LIMIT_DB, REFERENCE, error_db, kept

CASE_LIMIT_S = 60.0
WARM_RUNS = 2


def main(arguments: list[str]) -> int:
    """Exit status: 0 where every case ran and kept the limit of its error."""
    if arguments[:1] == ["make"]:
        np.savez_compressed(REFERENCE, allow_pickle=False, **{name: kept(case("cpu")) for name, case in CASES.items()})
        return 0
    if arguments[:1] == ["one"]:
        print(json.dumps(_one(*arguments[1:])))
        return 0
    device = arguments[0] if arguments else "gpu"
    return max([_apart(name, device) for name in arguments[1:] or CASES])


def _apart(name: str, device: str) -> int:
    """Prints what one case gives in a process of its own, since an error on a GPU spoils all that follows in the same process."""
    command = [sys.executable, "-m", "validation.gpu", "one", name, device]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    used: list[float] = []
    threading.Thread(target=_watch_memory, args=(process, used), daemon=True).start()
    try:
        out, errors = process.communicate(timeout=CASE_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        out, errors = process.communicate()
        errors += f"\nstopped after {CASE_LIMIT_S:g} s"
    if process.returncode:
        print(f"{name}: status {process.returncode}\n{errors[-2500:]}", flush=True)
        return 1
    found = json.loads(out.splitlines()[-1])
    print(json.dumps({"case": name, **found, "gpu_gb": max(used, default=0.0)}), flush=True)
    return int(found["error_db"] > ERROR_LIMIT_DB)


def _one(name: str, device: str) -> dict[str, Any]:
    """Seconds cold and warm, error against the reference [dB], and how long the kernels of a warm run took."""
    import drjit as dr

    warnings.simplefilter("ignore")
    wall, busy = [], []
    for _ in range(1 + WARM_RUNS):
        start, used = time.perf_counter(), time.process_time()
        recording = CASES[name](device)  # type: ignore[arg-type]
        cube = recording.adc
        wall.append(time.perf_counter() - start)
        busy.append(time.process_time() - used)
    # The history of kernels is that of one thread: echoes are made in it, too.
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    dr.kernel_history_clear()
    with patch.object(import_module("t2d_rt.simulate"), "prefetched", iter):
        CASES[name](device)  # type: ignore[arg-type]
    history = dr.kernel_history()
    return {
        "on": recording.settings["device"],
        "cold_s": round(wall[0], 3),
        "warm_s": round(min(wall[1:]), 3),
        "cpu_s": round(min(busy[1:]), 3),
        "error_db": round(error_db(recording, name), 1),
        "kernels": len(history),
        "kernel_s": round(sum(float(kernel["execution_time"]) for kernel in history) / 1e3, 4),
        "cube_mb": round(int(cube.size) * 8 / 1e6),
        "host_gb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, 2),
    }


def _watch_memory(process: subprocess.Popen[str], used: list[float]) -> None:
    """Adds the memory of the GPU in use [GB] every half second while the process runs."""
    command = ["nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    while process.poll() is None:
        try:
            used.append(float(subprocess.check_output(command, text=True).split()[0]) / 1e3)
        except (OSError, subprocess.CalledProcessError, ValueError, IndexError):
            return
        time.sleep(0.5)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
