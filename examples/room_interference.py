"""The same walk alone, in a furnished room, and there beside a table fan.

python examples/room_interference.py
python examples/room_interference.py --scene hospital_room --add pet:3,1,0 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.resources import resource

FAN = "fan:3,-1,1,rpm=300"


def recordings(scene: str, added: str, output: Path, duration_s: float = 1.5) -> list[Path]:
    """Simulates the end of the CMU walk three times and draws each; returns where the pictures are."""
    motion = t2d.place(t2d.load_motion(resource("motions", "12_01_walk.bvh")))
    motion = t2d.trim(motion, motion.duration_s - duration_s)
    cases = {"alone": ("free_space", []), scene: (scene, []), f"{scene}_others": (scene, [t2d.mover(added)])}
    output.mkdir(parents=True, exist_ok=True)
    pictures, alone = [], None
    for name, (where, others) in cases.items():
        result = t2d.simulate([motion, *others], scene=where, seed=0)
        level = np.maximum(result.spectrogram.values, result.spectrogram.values.max() - 50)
        alone = level if alone is None else alone
        print(f"{name}: {np.mean(np.abs(level - alone)):.2f} dB from the walk alone, in the mean over 50 dB")
        pictures.append(output / f"walk_{name}.png")
        result.plot(title=name.replace("_", " ")).savefig(pictures[-1])
    return pictures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="living_room", help="a room by name, or a Mitsuba XML file")
    parser.add_argument("--add", default=FAN, help="what else moves, as for t2d-rt simulate --add")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the pictures")
    options = parser.parse_args()
    print("wrote", ", ".join(str(path) for path in recordings(options.scene, options.add, options.output)))
