"""From words to micro-Doppler: the eight activities of the Text2Doppler paper, by both scattering models, on one page.

python examples/activities.py                          # writes out/activities.png; the falls need the extra [falls]
python examples/activities.py --seed 7 --output pictures
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import t2d_rt as t2d
from t2d_rt.core.errors import T2DWarning

SENTENCES = {
    "Normal walking": "a person walks forward",
    "Abnormal walking": "a person limps forward",
    "Running": "a person runs forward fast",
    "Falling": "a person walks forward, trips and falls forward",
    "Sitting": "a person walks to a chair and sits down",
    "Bending": "a person bends down to pick up a ball",
    "Jumping": "a person jumps up three times",
    "Dancing": "a person dances happily",
}

RANGE_DB = 50.0
"""Below each picture's peak."""


def activities(output: Path, *, seed: int = 0, longest_s: float = 6.0, sentences: dict[str, str] = SENTENCES) -> Path:
    """Makes a motion of each sentence and draws its spectrograms; returns the picture's path."""
    figure = Figure(figsize=(15.0, 2.6 * ((len(sentences) + 1) // 2)), layout="constrained")
    axes = np.atleast_2d(figure.subplots((len(sentences) + 1) // 2, 4, sharey=True))
    for number, (name, sentence) in enumerate(sentences.items()):
        motion = t2d.motion_from_text(sentence, seed=seed)
        # The last seconds: a fall comes at the end of its walk.
        motion = t2d.place(t2d.trim(motion, max(0.0, motion.duration_s - longest_s)))
        for offset, method in enumerate(("ellipsoid", "mesh")):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", T2DWarning)
                image = t2d.simulate(motion, radar="table2", method=method, seed=seed).spectrogram
            place = axes[number // 2, 2 * (number % 2) + offset]
            drawn = place.pcolormesh(
                image.time_s, image.velocity_mps, image.values - image.values.max(), cmap="viridis", vmin=-RANGE_DB, vmax=0,
                shading="nearest", rasterized=True,
            )  # fmt: skip
            place.set_title(f"{name}, {method}", fontsize=9)
            place.set_ylim(-6.0, 9.0)
            place.tick_params(labelsize=7)
        print(f"{name}: {sentence!r}, {motion.duration_s:.1f} s")
    for place in axes[-1]:
        place.set_xlabel("Time [s]", fontsize=8)
    for place in axes[:, 0]:
        place.set_ylabel("Radial velocity [m/s]", fontsize=8)
    figure.colorbar(drawn, ax=axes, label="Power (dB re peak)", pad=0.01, shrink=0.6)
    output.mkdir(parents=True, exist_ok=True)
    picture = output / "activities.png"
    figure.savefig(picture, dpi=80)
    return picture


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="seed of the motions and of the simulation")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the picture")
    options = parser.parse_args()
    print("wrote", activities(options.output, seed=options.seed))
