"""Recorded motion to micro-Doppler spectrograms, by the ellipsoid model and by the ray-traced body: `make demo`.

python examples/demo.py                       # the CMU walk
python examples/demo.py --motion iclone_002_03_run_jog.bvh.gz --output out
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import t2d_rt as t2d
from t2d_rt.core.resources import resource
from t2d_rt.recording.compare import compare


def demo(motion_name: str, output: Path, duration_s: float | None = None) -> list[Path]:
    """Simulates one of the bundled motions with both models; writes their pictures and returns where they are."""
    motion = t2d.load_motion(resource("motions", motion_name))
    print(motion.report)
    motion = t2d.place(motion)
    if duration_s is not None:
        motion = t2d.trim(motion, 0.0, duration_s)
    results = {}
    for method in ("ellipsoid", "mesh"):
        start = time.perf_counter()
        results[method] = t2d.simulate(motion, radar=t2d.Radar.preset("table2"), method=method, seed=0)
        print(f"{method}: {motion.duration_s:.1f} s of radar data in {time.perf_counter() - start:.1f} s")

    compared = compare(results["ellipsoid"], results["mesh"])
    print(compared)
    stem = motion_name.split(".")[0]
    output.mkdir(parents=True, exist_ok=True)
    pictures = []
    for method, result in results.items():
        pictures.append(output / f"{stem}_{method}.png")
        result.plot(title=f"{stem}, {method}").savefig(pictures[-1])
    pictures.append(output / f"{stem}_compare.png")
    compared.plot(title=stem).savefig(pictures[-1])
    return pictures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motion", default="12_01_walk.bvh", help="one of the bundled motions (examples/motions)")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the pictures")
    options = parser.parse_args()
    print("wrote", ", ".join(str(path) for path in demo(options.motion, options.output)))
