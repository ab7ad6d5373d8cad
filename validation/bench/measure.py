"""One case, timed: seconds, peak memory, and what each stage takes by itself."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.core.memory import LIMIT_GB
from t2d_rt.core.resources import resource as shipped
from t2d_rt.types import Motion, MovingMesh, Radar
from validation.bench.stages import stage_seconds

ENOUGH_S = 15.0
"""A case is not run again once its runs have taken that long."""
WALK = "12_01_walk.bvh"
SPHERE_RADIUS_M, SPHERE_SPEED_MPS = 0.15, 1.0
DISTANCES_M, ANGLES_DEG = (2.5, 3.0, 3.5), (0.0, 20.0, -20.0)
"""Of the persons."""
FAN = t2d.mover("fan:2,1,1.2,rpm=900")
SINCOS_LANES, SINCOS_EACH = 1 << 22, 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One simulation to time."""

    name: str
    method: str = "mesh"
    preset: str = "table2"
    changes: dict[str, Any] = field(default_factory=dict)
    """Fields of the preset to change."""
    duration_s: float = 4.0
    accuracy: dict[str, Any] = field(default_factory=dict)
    """Fields of `Accuracy` to change."""
    target: str = "walk"
    """Cycles of CMU 12_01, repeated without a jump, or a "sphere" that comes nearer; or "nobody", beside a fan."""
    persons: int = 1
    """Who walk on the spot, side by side, where there are several."""
    fan: bool = False
    """Whether a table fan turns at 900 rpm beside them."""
    runs: int = 2
    """The best of so many counts."""
    memory_gb: float = LIMIT_GB
    """What the run may take; a cube of more than an eighth of it is kept as products."""
    scene: str = "free_space"
    """In a room the walk is on the spot, 3 m before the radar."""


def apart(case: Case) -> dict[str, Any]:
    """What `measure` finds in a process of its own."""
    command = [sys.executable, "-m", "validation.bench", "--case", json.dumps(asdict(case))]
    out = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return dict(json.loads(out.stdout.splitlines()[-1]))


def measure(case: Case) -> dict[str, Any]:
    """Times one case.

    `seconds` is the best run from the target to the ADC cube and its spectrogram, `peak_gb` the largest memory of a process that
    runs it once, `yardstick_s` ten times 1e7 complex exponentials in NumPy, `stages` and the figures after them what
    `stage_seconds` finds.
    """
    radar = Radar.preset(case.preset, **case.changes)
    targets = targets_of_case(case)

    def run() -> int:
        found = t2d.simulate(
            targets,
            radar=radar,
            method=case.method,  # type: ignore[arg-type]
            accuracy=case.accuracy,
            scene=case.scene,
            memory_gb=case.memory_gb,
        )
        _ = found.spectrogram
        return len(found.settings.get("pairs", [None]))

    pairs = run()  # compiles the kernels
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    taken: list[float] = []
    while len(taken) < case.runs and sum(taken) < ENOUGH_S:
        taken.append(timed(run))
    stages: dict[str, float] = {}
    done = Counter(instants=1)
    if len(targets) == 1 and case.target != "nobody":  # stages do not follow what is read from a table
        stages, done = stage_seconds(targets[0], radar, scene=case.scene, method=case.method, accuracy=case.accuracy)
    return {
        "name": case.name,
        "method": case.method,
        "duration_s": case.duration_s,
        "prf_hz": radar.prf_hz,
        "antennas": radar.antennas,
        "pairs": pairs,
        "seconds": min(taken),
        "peak_gb": peak_gb,
        "yardstick_s": _yardstick_s(),
        "stages": stages,
        "facets": done["facets"],
        "echoes": round(done["echo_terms"] / done["instants"]),
        "facet_terms": done["facet_terms"],
        "echo_terms": done["echo_terms"],
    }


def targets_of_case(case: Case) -> list[Any]:
    """What is simulated."""
    if case.target == "sphere":
        return [_sphere(case.duration_s)]
    if case.target == "nobody":
        return [FAN.mesh(0, case.duration_s)]
    found: list[Any] = [FAN] if case.fan else []
    if case.persons == 1:
        return [_walk(case.duration_s, on_the_spot=case.scene != "free_space"), *found]
    walk = t2d.repeat(t2d.load_motion(shipped("motions", WALK)), case.duration_s, travel=False)
    places = zip(DISTANCES_M, ANGLES_DEG, strict=True)
    persons = [t2d.place(walk, distance_m=distance, angle_deg=angle) for distance, angle in places]
    return [*persons[: case.persons], *found]


def _walk(duration_s: float, *, on_the_spot: bool) -> Motion:
    walk = t2d.load_motion(shipped("motions", WALK))
    if on_the_spot:
        return t2d.place(t2d.repeat(walk, duration_s, travel=False), distance_m=3.0)
    return t2d.place(t2d.repeat(walk, duration_s))


def _sphere(duration_s: float) -> MovingMesh:
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=2, radius=SPHERE_RADIUS_M)
    times = np.linspace(0, duration_s, 9)
    centre = np.array([-SPHERE_SPEED_MPS, 0, 0]) * (times - duration_s)[:, None] + [2, 0, 1]
    return MovingMesh(ball.vertices + centre[:, None], ball.faces, times, name="sphere")


def sincos_rate() -> float:
    """Pairs of sine and cosine of float32 phases per second by Dr.Jit on all cores."""
    import drjit as dr

    Float32 = select("auto").Float32
    phase = dr.linspace(Float32, -np.pi, np.pi, SINCOS_LANES)
    dr.eval(phase)

    def run() -> None:
        total = dr.zeros(Float32, SINCOS_LANES)
        for step in range(SINCOS_EACH):
            sin, cos = dr.sincos(phase + float(step))
            total += sin + cos
        dr.eval(total)
        dr.sync_thread()

    run()  # compiles the kernel
    return SINCOS_LANES * SINCOS_EACH / min(timed(run) for _ in range(3))


def import_seconds() -> float:
    """Seconds that `import t2d_rt` takes in a process of its own, best of three."""
    code = "import time; t = time.perf_counter(); import t2d_rt; print(time.perf_counter() - t)"
    return min(float(subprocess.check_output([sys.executable, "-c", code])) for _ in range(3))


def timed(action: Callable[[], Any]) -> float:
    """Seconds of one call."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def _yardstick_s() -> float:
    phases = np.linspace(0, 1000, 10_000_000)
    return 10 * min(timed(lambda: np.exp(1j * phases)) for _ in range(3))
