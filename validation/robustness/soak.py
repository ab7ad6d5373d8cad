"""Memory over 300 calls in one process: after the first hundred it has to stay where it is."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from validation.report import FOLDER, Section, at_most, new_figure, save_chart

CALLS = 300
SETTLED = 100
"""Calls after which kernels are compiled and caches are full."""
LEVEL = 20
"""Calls whose median is the level: single ones leave more or less behind until the next."""
MOTIONS = Path(__file__).parents[2] / "examples" / "motions"


def run() -> Section:
    """In a fresh process, whose memory is that of these calls alone."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "soak.json"
        subprocess.run([sys.executable, "-m", "validation.robustness.soak", str(file)], check=True)
        found = json.loads(file.read_text(encoding="utf-8"))
    return section(found["resident_mb"], found["calls"])


def section(resident_mb: Sequence[float], calls: list[str], folder: Path = FOLDER) -> Section:
    """Growth after the first hundred calls."""
    resident = np.array(resident_mb)
    after = resident[SETTLED:]
    start = float(np.median(resident[SETTLED - LEVEL // 2 : SETTLED + LEVEL // 2]))
    levels = [float(np.median(resident[at : at + LEVEL])) for at in range(SETTLED, len(resident) - LEVEL + 1)]
    end = levels[-1]
    slope = float(np.polyfit(np.arange(len(after)), after, 1)[0])
    return Section(
        title="Memory over many calls",
        checks=[
            at_most(f"resident memory at the end over that after {SETTLED} calls", 100 * (end / start - 1), 5, "%"),
            at_most(
                f"highest level (median of {LEVEL} calls) over that after {SETTLED} calls",
                100 * (float(np.max(levels)) / start - 1),
                5,
                "%",
            ),
            at_most(f"trend over the last {len(after)} calls", 100 * slope * len(after) / start, 5, "%"),
        ],
        note=f"{CALLS} calls in one process, drawn at random with a fixed seed: motions, pieces and lengths of them, both models, "
        "meshes of 80 to 5 000 facets and the body, rooms, tolerances, movers, arrays, plans, spectrograms, recordings saved and "
        f"loaded. Resident memory: {start:.0f} MB after {SETTLED} calls, {end:.0f} MB at the end, {slope:.3f} MB a "
        f"call, single calls up to {100 * (float(after.max()) / start - 1):.1f} % above the first.",
        charts=[_chart(resident, calls, start, folder)],
    )


def _chart(resident: np.ndarray, calls: list[str], start: float, folder: Path) -> str:
    figure, axis = new_figure()
    axis.plot(resident, color="0.7", lw=1)
    for number, kind in enumerate(sorted(set(calls))):
        at = [i for i, call in enumerate(calls) if call == kind]
        axis.plot(at, resident[at], ".", color=f"C{number % 10}", label=kind)
    axis.axhspan(0.95 * start, 1.05 * start, color="C2", alpha=0.15, label="within 5 %")
    axis.axvline(SETTLED, color="C3", linestyle=":")
    axis.set(xlabel="call", ylabel="resident memory [MB]", ylim=(0, None), title=f"{len(calls)} calls in one process")
    axis.legend(fontsize=7, ncols=2)
    axis.grid(alpha=0.3)
    return save_chart(figure, "soak.png", folder)


FRACTIONS = (0.12, 0.15, 0.1, 0.1, 0.06, 0.06, 0.08, 0.05, 0.08, 0.1, 0.1)
"""Of the kinds of calls: those in rooms take longest."""

# --- in the process -------------------------------------------------------------------------------------------------


def soaked(calls: int = CALLS) -> dict[str, Any]:
    """Resident memory [MB] after each call, and the calls."""
    from t2d_rt.core.errors import T2DWarning
    from t2d_rt.core.memory import resident_bytes

    warnings.simplefilter("ignore", T2DWarning)
    rng = np.random.default_rng(0)
    kinds = {
        "ellipsoids": _ellipsoids, "ball": _ball, "body": _body, "fan": _fan, "room": _room, "body in a room": _body_in_room,
        "tolerance": _tolerance, "plan": _plan, "array": _array, "saved": _saved, "picture": _picture,
    }  # fmt: skip
    resident, names = [], []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(calls):
            name = str(rng.choice(list(kinds), p=FRACTIONS))
            kinds[name](rng, Path(folder))
            gc.collect()
            resident.append(resident_bytes() / 2**20)
            names.append(name)
    return {"resident_mb": resident, "calls": names}


def _walk(rng: np.random.Generator, longest_s: float = 0.5) -> Any:
    import t2d_rt as t2d

    motion = t2d.load_motion(sorted(MOTIONS.glob("*.bvh*"))[int(rng.integers(6))])
    start = float(rng.uniform(0, motion.duration_s - longest_s))
    return t2d.trim(motion, start, start + float(rng.uniform(0.2, longest_s)))


def _radar(rng: np.random.Generator) -> Any:
    import t2d_rt as t2d

    return t2d.Radar.preset(str(rng.choice(["ci4r", "table2"])), samples=int(rng.choice([32, 64, 128])))


def _sphere(rng: np.random.Generator, x_m: float = 2.0) -> Any:
    import trimesh

    import t2d_rt as t2d

    segments = int(rng.integers(8, 50))
    shape = trimesh.creation.uv_sphere(radius=float(rng.uniform(0.05, 0.2)), count=(segments, segments))
    times = np.linspace(0, float(rng.uniform(0.1, 0.5)), int(rng.integers(3, 20)))
    centre = np.array([x_m, 0.0, 1.0]) - times[:, None, None] * [float(rng.uniform(-1, 1)), 0, 0]
    return t2d.MovingMesh(shape.vertices + centre, shape.faces, times, "pec", name="sphere")


def _simulated(target: Any, radar: Any, **options: Any) -> Any:
    import t2d_rt as t2d

    result = t2d.simulate(target, radar=radar, **options)
    if not np.isfinite(result.cube).all():
        raise AssertionError("the ADC cube holds NaN or infinite values")
    return result


def _ellipsoids(rng: np.random.Generator, _: Path) -> None:
    _simulated(_walk(rng, 1.0), _radar(rng), method="ellipsoid").spectrogram.values.sum()


def _ball(rng: np.random.Generator, _: Path) -> None:
    _simulated(_sphere(rng), _radar(rng))


def _body(rng: np.random.Generator, _: Path) -> None:
    _simulated(_walk(rng), _radar(rng), accuracy={"sagitta_rad": float(rng.uniform(0.6, 2))})


def _fan(rng: np.random.Generator, _: Path) -> None:
    import t2d_rt as t2d

    fan = t2d.TableFan(position_m=(3, float(rng.uniform(-1, 1)), 1), rpm=float(rng.uniform(60, 300)))
    _simulated([_sphere(rng), fan], _radar(rng), accuracy={"sagitta_rad": 1.0})


def _room(rng: np.random.Generator, _: Path) -> None:
    import t2d_rt as t2d

    room = t2d.Room(name="box", size_m=tuple(rng.uniform(3, 6, 3)))
    _simulated(_sphere(rng, 1.5), _radar(rng), scene=room, reflections=1)


def _body_in_room(rng: np.random.Generator, _: Path) -> None:
    scene = str(rng.choice(["empty_room", "bedroom", "corridor"]))
    _simulated(
        _walk(rng, 0.3), _radar(rng), scene=scene, reflections=1, accuracy={"sagitta_rad": 2.0}, collisions="ignore"
    )


def _tolerance(rng: np.random.Generator, _: Path) -> None:
    _simulated(_sphere(rng), _radar(rng), tolerance_db=float(rng.uniform(-30, -15)))


def _plan(rng: np.random.Generator, _: Path) -> None:
    import t2d_rt as t2d

    t2d.plan(_sphere(rng), radar=_radar(rng), tolerance_db=float(rng.uniform(-8, -3)))


def _array(rng: np.random.Generator, _: Path) -> None:
    import t2d_rt as t2d

    radar = t2d.Radar.preset("array-3x4", samples=32)
    result = _simulated(_sphere(rng), radar)
    t2d.signal.range_angle(result.cube[:128], radar)


def _saved(rng: np.random.Generator, folder: Path) -> None:
    import t2d_rt as t2d

    result = _simulated(_walk(rng), _radar(rng), method="ellipsoid")
    result.save(folder / "one.zarr", overwrite=True)
    if not np.array_equal(t2d.Recording.load(folder / "one.zarr").cube, result.cube):
        raise AssertionError("loaded with other samples than were saved")


def _picture(rng: np.random.Generator, folder: Path) -> None:
    result = _simulated(_walk(rng, 1.0), _radar(rng), method="ellipsoid")
    result.processed(n_window=int(rng.choice([64, 128, 256]))).plot(title="soak").savefig(folder / "one.png")


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(json.dumps(soaked()), encoding="utf-8")
