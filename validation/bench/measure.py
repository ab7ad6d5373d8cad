"""One case, timed: seconds, peak memory, and what each stage takes when the stages do not overlap."""

from __future__ import annotations

import contextlib
import json
import resource
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from typing import Any
from unittest import mock

import numpy as np

import t2d_rt as t2d
from t2d_rt import cubes, model, result, stage, summation, targets
from t2d_rt.backend import select
from t2d_rt.propagation.surroundings import Blockage
from t2d_rt.propagation.visibility import Occlusion
from t2d_rt.radar import synthesize, windows
from t2d_rt.radar.windows import Window
from t2d_rt.resources import resource as shipped
from t2d_rt.scattering import mesh
from t2d_rt.scattering.paths import Arrivals
from t2d_rt.types import Ellipsoids, Motion, MovingMesh, Radar

ENOUGH_S = 15.0
"""A case is not run again once its runs have taken that long."""
SPHERE_RADIUS_M, SPHERE_SPEED_MPS = 0.15, 1.0
SINCOS_LANES, SINCOS_EACH = 1 << 22, 64
MOTION, WAYS, SETUP, OCCLUSION, FACETS, SYNTHESIS, SPECTROGRAM, REST = (
    "motion and body", "ways in a room", "refinement, patches, points", "occlusion", "facets and points", "synthesis",
    "spectrogram", "rest",
)  # fmt: skip
STAGES = (MOTION, WAYS, SETUP, OCCLUSION, FACETS, SYNTHESIS, SPECTROGRAM, REST)
ENTRIES: tuple[tuple[str, Any, str], ...] = (
    (MOTION, targets, "_lasting"),
    (MOTION, MovingMesh, "at"),
    (MOTION, Ellipsoids, "at"),
    (WAYS, stage, "find_path_pairs"),
    (WAYS, model, "clutter_streams"),
    (WAYS, Arrivals, "weight"),
    (SETUP, mesh._Model, "of"),
    (OCCLUSION, Occlusion, "__init__"),
    (OCCLUSION, Occlusion, "visibility"),
    (OCCLUSION, Blockage, "over"),
    (FACETS, mesh, "carried"),
    (FACETS, mesh._Model, "put"),
    (FACETS, mesh.Block, "arrays"),
    (FACETS, mesh._Model, "places"),
    (SYNTHESIS, summation, "synthesize"),
    (SYNTHESIS, synthesize, "_sums"),
    (SPECTROGRAM, result, "spectrogram"),
)
"""Where each stage is entered. The rest is checks, the choice of the surface rate, and the ellipsoid model."""


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
    """Cycles of CMU 12_01, repeated without a jump, or a "sphere" that comes nearer."""
    runs: int = 2
    """The best of so many counts."""
    on_disk: bool = False
    """Whether the cube goes to disk however small it is."""
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
    runs it once, `yardstick_s` ten times 1e7 complex exponentials in NumPy. A last run, whose stages wait for one another, gives
    the `stages` [s] and what they had to do: `facets`, `echoes` that are not silent in a window, `facet_terms` (facets x surface
    frames) and `echo_terms` (echoes x moments, a moment being one chirp at one pair of antennas).
    """
    radar = Radar.preset(case.preset, **case.changes)
    if case.on_disk:
        cubes.LARGE_BYTES = 0
    if case.target == "sphere":
        target: Motion | MovingMesh = _sphere(case.duration_s)
    else:
        target = _walk(case.duration_s, on_the_spot=case.scene != "free_space")

    def run() -> int:
        found = t2d.simulate(
            target,
            radar=radar,
            method=case.method,
            accuracy=case.accuracy,
            scene=case.scene,  # type: ignore[arg-type]
        )
        _ = found.spectrogram
        return len(found.settings.get("pairs", [None]))

    pairs = run()  # compiles the kernels
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    taken: list[float] = []
    while len(taken) < case.runs and sum(taken) < ENOUGH_S:
        taken.append(timed(run))
    stages, done = stage_seconds(run)
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
        "facets": round(done["facet_terms"] / max(1, done["frames"])),
        "echoes": round(done["echo_terms"] / done["moments"]),
        "facet_terms": done["facet_terms"],
        "echo_terms": done["echo_terms"],
    }


def stage_seconds(run: Callable[[], Any]) -> tuple[dict[str, float], Counter[str]]:
    """Each stage's seconds in one run, without those of stages called within it, and what the stages had to do.

    Echoes are otherwise made while earlier ones are summed; here each stage has all cores to itself.
    """
    spent = dict.fromkeys(STAGES, 0.0)
    done: Counter[str] = Counter()
    running = threading.local()

    def watched(stage: str, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
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
                if name in COUNTERS:
                    done.update(COUNTERS[name](*args))

        return call

    with contextlib.ExitStack() as patches:
        for stage, home, name in ENTRIES:
            patches.enter_context(mock.patch.object(home, name, watched(stage, name, getattr(home, name))))
        for home in (windows, synthesize, cubes):
            patches.enter_context(mock.patch.object(home, "ThreadPoolExecutor", _AtOnce))
        total = timed(run)
    spent[REST] = total - sum(spent.values())
    return spent, done


class _AtOnce(ThreadPoolExecutor):
    """A pool whose work is done by who hands it in."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **options: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(function(*args, **options))
        return future


def _facet_terms(model: Any, block: Any, *_: Any) -> dict[str, int]:
    return {"facet_terms": len(model.patches.corners) * block.shape[0], "frames": block.shape[0]}


def _echo_terms(window: Window, radar: Radar, position: np.ndarray, *_: Any) -> dict[str, int]:
    moments = len(position) * len(radar.tx_offsets_m) * len(radar.rx_offsets_m)
    return {"echo_terms": window.delay.shape[1] * moments, "moments": moments}


COUNTERS: dict[str, Callable[..., dict[str, int]]] = {"put": _facet_terms, "_sums": _echo_terms}


def _walk(duration_s: float, *, on_the_spot: bool) -> Motion:
    walk = t2d.load_motion(shipped("motions", "12_01_walk.bvh"))
    if on_the_spot:
        return t2d.place(t2d.repeat(walk, duration_s, travel=False), distance_m=3.0)
    return t2d.place(t2d.repeat(walk, duration_s))


def _sphere(duration_s: float) -> MovingMesh:
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=2, radius=SPHERE_RADIUS_M)
    times = np.linspace(0, duration_s, 9)
    way = np.array([-SPHERE_SPEED_MPS, 0, 0]) * (times - duration_s)[:, None] + [2, 0, 1]
    return MovingMesh(ball.vertices + way[:, None], ball.faces, times, name="sphere")


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
