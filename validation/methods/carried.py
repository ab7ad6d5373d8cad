"""What a simulation takes with each thing that a person carries, over that of the walk alone: the ratios of docs/motions.md.

python -m validation.methods.carried
"""

from __future__ import annotations

import time

import t2d_rt as t2d
from t2d_rt.motion.carriers import SIZES_M
from t2d_rt.types import Motion, Radar

RADAR = Radar.preset("table2", samples=64, prf_hz=4_000.0)
TURNS = 3
"""The least time of so many runs counts."""


def seconds(motion: Motion, method: str) -> float:
    """Processor time of one simulation [s]."""
    begin_s = time.process_time()
    t2d.simulate(motion, radar=RADAR, method=method, measure_error=False)
    return time.process_time() - begin_s


def main() -> None:
    """Prints a row for each method: seconds of the walk of 0.4 s alone, and by thing how many times as long it takes."""
    walk = t2d.trim(t2d.example("walk"), 1.0, 1.4)
    carried = {"nothing": walk} | {thing: t2d.carry(walk, thing) for thing in SIZES_M}
    for method in ("ellipsoid", "mesh"):
        seconds(walk, method)  # kernels are compiled
        turns = [{name: seconds(motion, method) for name, motion in carried.items()} for _ in range(TURNS)]
        least = {name: min(turn[name] for turn in turns) for name in carried}
        ratios = ", ".join(f"{name} {least[name] / least['nothing']:.1f}" for name in SIZES_M)
        print(f"{method}: {least['nothing']:.2f} s alone; {ratios}", flush=True)


if __name__ == "__main__":
    main()
