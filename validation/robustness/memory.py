"""What runs take: a tolerance in a furnished room, a very wide sweep, a large mesh, each in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import t2d_rt as t2d
from t2d_rt.core.resources import resource
from validation.report import Section, at_most

LIMIT_GB, AMPLE_GB = 2.0, 16.0
WALK_S = 2.0


def run() -> Section:
    rows = [_apart(case, limit) for case in CASES for limit in (LIMIT_GB, AMPLE_GB)]
    limited, ample = rows[::2], rows[1::2]
    most = max(each["GB"] for each in limited)
    differing = sum(a["sha256"] != b["sha256"] for a, b in zip(limited, ample, strict=True))
    off = max(abs(np.log(each["predicted GB"] / each["GB"])) for each in limited)
    return Section(
        title="Memory",
        checks=[
            at_most("greatest memory at the default limit", most, LIMIT_GB, "GB"),
            at_most("results that depend on the limit", differing, 0),
            at_most("warnings", sum(each["warnings"] for each in rows), 0),
            at_most("error of the walk, -20 dB asked", rows[0]["error dB"], -20.0, "dB"),
            at_most("memory predicted beside that taken", float(np.exp(off)), 1.5, "times"),
        ],
        note=f"{WALK_S:g} s of a walk (CMU 12_01) in living_room to -20 dB, the error measured after it; 12 chirps of 16 384 "
        f"samples over 111 GHz; a sphere of 327 680 triangles. Each at memory_gb={LIMIT_GB:g} and {AMPLE_GB:g}; memory is the "
        "greatest of a fresh process, its libraries included.",
        table=rows,
    )


def _walk(memory_gb: float) -> t2d.Recording:
    motion = t2d.load_motion(resource("motions", "12_01_walk.bvh"))
    motion = t2d.trim(t2d.place(motion), 1.0, 1.0 + WALK_S)
    return t2d.simulate(motion, scene="living_room", tolerance_db=-20, memory_gb=memory_gb)


def _wide_sweep(memory_gb: float) -> t2d.Recording:
    radar = t2d.Radar(carrier_hz=77e9, slope_hz_per_s=111e12, samples=16_384, sample_rate_hz=16.384e6, prf_hz=40.0)
    return t2d.simulate(_sphere(2, 0.01), radar=radar, memory_gb=memory_gb)


def _large_mesh(memory_gb: float) -> t2d.Recording:
    return t2d.simulate(_sphere(7, 1.0), memory_gb=memory_gb)


def _sphere(subdivisions: int, speed_mps: float) -> t2d.MovingMesh:
    solid = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.15)
    times = np.linspace(0, 0.3, 4)
    moved = [3.0, 0.2, 1.0] - speed_mps * times[:, None, None] * [1, 0, 0]
    return t2d.MovingMesh(solid.vertices + moved, solid.faces, times, material="pec", name="sphere")


CASES: dict[str, Callable[[float], t2d.Recording]] = {
    "walk, living_room, -20 dB": _walk, "wide sweep": _wide_sweep, "large mesh": _large_mesh,
}  # fmt: skip


def _apart(case: str, memory_gb: float) -> dict[str, Any]:
    """One run in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", f"from validation.robustness.memory import main; main({case!r}, {memory_gb})"],
        capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    print(done.stdout.splitlines()[-1], flush=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def main(case: str, memory_gb: float) -> None:
    """Prints what a run took and gave, as one line of JSON."""
    import hashlib
    from resource import RUSAGE_SELF, getrusage

    from t2d_rt.core.memory import resident_bytes

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", ResourceWarning)
        begin = resident_bytes() / 1e9
        result = CASES[case](memory_gb)
    error_db = "not measured" if result.error_db is None else result.error_db
    print(
        json.dumps(
            {
                "case": case, "memory_gb": memory_gb, "GB": getrusage(RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
                "predicted GB": result.settings["predicted_memory_gb"] + begin, "error dB": error_db, "warnings": len(caught),
                "sha256": hashlib.sha256(np.ascontiguousarray(result.cube[:])).hexdigest()[:16],
            }
        )
    )  # fmt: skip
