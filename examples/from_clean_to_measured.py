"""One walk as it is simulated, with the receiver's noise, with a learned background, and with occluded windows.

python examples/from_clean_to_measured.py
python examples/from_clean_to_measured.py --seed 3 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d
from t2d_rt.noise.masks import OcclusionMask, occlude
from t2d_rt.plots import VELOCITY_LABEL

MASK = OcclusionMask(windows=3.0, shortest_s=0.2, longest_s=0.6)
SPEEDS_MPS = -4.0, 4.0
BELOW_DB, TOP_DB = 8.0, 5.0
"""The colours reach from so far below the background's floor to so far below the greatest cell."""


def steps(output: Path, seed: int = 0, duration_s: float | None = None) -> Path:
    """Simulates the CMU walk and draws it four times, with the same axes and colours; returns where the picture is."""
    motion = t2d.place(t2d.example("walk"), distance_m=4.5)
    if duration_s is not None:
        motion = t2d.trim(motion, 0.0, duration_s)
    clean = t2d.simulate(motion, seed=seed)
    noisy = t2d.add_noise(clean)
    print(f"SNR {noisy.snr_db:.1f} dB before processing, over all noise of the receiver, {noisy.noise_dbm:.1f} dBm")
    added = clean.with_background("default", seed=seed)
    # Of silent samples the same background is left by itself.
    alone = t2d.Recording(np.zeros_like(clean.cube), clean.radar).with_background("default", seed=seed)
    image = added.spectrogram
    with_background, background = (10 ** (each.spectrogram.values / 10) for each in (added, alone))
    masked = occlude(with_background, image.time_s.values, MASK, seed=seed, background_power=background)
    print(f"occluded: {', '.join(f'{start:.2f} to {stop:.2f} s' for start, stop in masked.windows_s)}")
    levels = {
        "clean": clean.spectrogram.values,
        "with the receiver's noise": noisy.processed(mti="mean").spectrogram.values,
        "with a background": image.values,
        "with occluded windows": 10 * np.log10(masked.power),
    }
    low_db, high_db = np.median(10 * np.log10(background)) - BELOW_DB, clean.spectrogram.values.max() - TOP_DB
    figure, axes = plt.subplots(ncols=len(levels), sharey=True, figsize=(13, 3.4), layout="constrained")
    for ax, (title, level) in zip(axes, levels.items(), strict=True):
        drawn = ax.pcolormesh(
            image.time_s, image.velocity_mps, level, vmin=low_db, vmax=high_db, shading="nearest", rasterized=True
        )
        ax.set(title=title, xlabel="Time [s]", ylim=SPEEDS_MPS)
    axes[0].set_ylabel(VELOCITY_LABEL)
    figure.colorbar(drawn, ax=axes, label="Power [dB re 1 W]", extend="both")
    output.mkdir(parents=True, exist_ok=True)
    picture = output / "from_clean_to_measured.png"
    figure.savefig(picture, dpi=80, metadata={"Software": None})
    plt.close(figure)
    return picture


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of noise, background and occluded windows")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the picture")
    options = parser.parse_args()
    print("wrote", steps(options.output, options.seed))
