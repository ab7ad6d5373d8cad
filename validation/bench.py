"""Speed on this machine, kernels warm: `make bench`. Ratios to a NumPy yardstick in the same run tell more than seconds.

The record is a 10 s walk (cycles of CMU 12_01, repeated without a jump) from the motion to ADC cube and spectrogram.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import resource
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from typing import Any
from unittest import mock

import numpy as np

import t2d_rt as t2d
from t2d_rt import result
from t2d_rt.echo import mesh
from t2d_rt.radar import synthesize
from t2d_rt.resources import resource as shipped
from t2d_rt.trace.visibility import Occlusion
from t2d_rt.types import MovingMesh

DURATION_S = 10.0
BARS_S = {
    ("ellipsoid", "table2-uniform"): 3.0,
    ("ellipsoid", "table2"): 3.0,
    ("mesh", "table2-uniform"): 10.0,
    ("mesh", "table2"): 30.0,
}
IMPORT_BAR_S, MEMORY_BAR_GB = 0.5, 2.0
STAGES = {
    "motion and body": (MovingMesh, "at"),
    "refinement, patches, points": (mesh._Model, "of"),
    "occlusion": (Occlusion, "visibility"),
    "facets and points": (mesh._Model, "echoes"),
    "synthesis": (synthesize, "_block"),
    "spectrogram": (result, "spectrogram"),
}
"""Where each stage is entered. Stages overlap: echoes are made while earlier ones are summed."""


def main() -> None:
    """Runs every case in a process of its own and prints the table."""
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(f"import t2d_rt: {_import_s():.2f} s (bar {IMPORT_BAR_S} s)")
    print(f"\n{'10 s walk':24}{'seconds':>9}{'bar':>6}{'yardsticks':>12}{'peak GB':>9}")
    shares = {}
    for (method, preset), bar in BARS_S.items():
        out = subprocess.run(
            [sys.executable, "-m", "validation.bench", method, preset], capture_output=True, text=True, check=True
        )
        found = json.loads(out.stdout.splitlines()[-1])
        shares[f"{method}, {preset}"] = found["shares"]
        ratio = found["seconds"] / found["yardstick_s"]
        print(
            f"{method + ', ' + preset:24}{found['seconds']:9.2f}{bar:6.0f}{ratio:12.2f}{found['peak_gb']:9.2f}",
            flush=True,
        )
    print(f"\na yardstick is 1e8 complex exponentials in NumPy, float64; peak memory has a bar of {MEMORY_BAR_GB} GB")
    for case, parts in shares.items():
        if parts:
            print(f"{case}: " + ", ".join(f"{name} {share:.0%}" for name, share in parts.items()))


def case(method: str, preset: str) -> dict[str, Any]:
    """Seconds of the best of three runs beside the yardstick's, peak memory, and the share of each stage."""
    motion = t2d.place(t2d.repeat(t2d.load_motion(shipped("motions", "12_01_walk.bvh")), DURATION_S))
    radar = t2d.Radar.preset(preset)

    def run() -> None:
        _ = t2d.simulate(motion, radar=radar, method=method, seed=0).spectrogram

    run()  # compiles the kernels
    yardstick = _timed(_yardstick)
    seconds = min(_timed(run) for _ in range(3))
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    return {
        "seconds": seconds,
        "yardstick_s": yardstick,
        "peak_gb": peak_gb,
        "shares": _shares(run) if method == "mesh" else {},
    }


def _yardstick() -> None:
    phases = np.linspace(0, 1000, 10_000_000)
    for _ in range(10):
        np.exp(1j * phases)


def _timed(action: Callable[[], None]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def _shares(run: Callable[[], None]) -> dict[str, float]:
    """Each stage's share of all stages' time, without that of stages called within it."""
    spent = dict.fromkeys(STAGES, 0.0)
    running = threading.local()

    def watched(stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            stack = running.__dict__.setdefault("stack", [])
            stack.append(0.0)
            start = time.perf_counter()
            try:
                return function(*args, **options)
            finally:
                taken = time.perf_counter() - start
                spent[stage] += taken - stack.pop()
                if stack:
                    stack[-1] += taken

        return call

    with contextlib.ExitStack() as patches:
        for stage, (home, name) in STAGES.items():
            patches.enter_context(mock.patch.object(home, name, watched(stage, getattr(home, name))))
        run()
    return {stage: seconds / sum(spent.values()) for stage, seconds in spent.items()}


def _import_s() -> float:
    code = "import time; t = time.perf_counter(); import t2d_rt; print(time.perf_counter() - t)"
    return min(float(subprocess.check_output([sys.executable, "-c", code])) for _ in range(3))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        warnings.simplefilter("ignore", t2d.T2DWarning)  # table2-uniform aliases: it is here for its timing only
        print(json.dumps(case(*sys.argv[1:])))
    else:
        main()
