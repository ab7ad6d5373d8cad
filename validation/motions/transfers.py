"""Sitting down, bending and standing up: how long the hips take, at how many peaks of speed, and how fast they get.

`python -m validation.motions.transfers [RECORDED] [-n 40]`: RECORDED is a folder with iclone_002_06_bend_scoop_up.bvh.gz. Nothing
of how motions are made is used, but positions of the hips alone.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from t2d_rt.core.errors import T2DWarning
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.motion.read import load_motion
from t2d_rt.types.motion import Motion
from validation.motions.limits import true_size

SENTENCES = {
    "a person sits down": "fourteen recorded: 1.94 s (1.40 to 4.37), two peaks; others 0.38 to 0.61 m/s",
    "a person bends down": "see the recorded bends",
    "a person stands up from a chair": "fifty people took 1.91 s with the lean before the rise (Kerr 1997)",
}

REST = 0.03
"""Part of the way of the hips that counts as rest at each of its ends."""


def transfer(height_m: np.ndarray, rate_hz: float) -> tuple[float, int, float]:
    """Time [s] in which hips at heights (T,) get from 3 to 97 % of the way to the lowest, peaks of their speed, the greatest [m/s].

    A peak stands out from its surroundings by a tenth of the greatest speed.
    """
    height = gaussian_filter1d(height_m, 0.03 * rate_hz)
    high, low = np.percentile(height, [98, 2])
    stop = int(np.argmax(height < low + REST * (high - low)))
    start = stop - int(np.argmax(height[stop::-1] > high - REST * (high - low)))
    margin = round(0.4 * rate_hz)
    speed = -np.gradient(height)[max(0, start - margin) : stop + margin] * rate_hz
    most = float(speed.max())
    peaks, _ = find_peaks(np.pad(speed, 1), prominence=0.1 * most, height=0.15 * most)
    return (stop - start) / rate_hz, len(peaks), most


def hips_m(motion: Motion) -> np.ndarray:
    """Height of the middle of the hips (T,) [m]."""
    return motion.joints[:, [motion.index("left_hip"), motion.index("right_hip")], 2].mean(axis=1)


def recorded_bends(folder: Path) -> list[tuple[float, int, float]]:
    """Of each of the six bends in the recording."""
    path = folder / "iclone_002_06_bend_scoop_up.bvh.gz"
    motion = true_size(load_motion(path), path.name)
    height = hips_m(motion)
    lows, _ = find_peaks(-height, prominence=0.2)
    found = []
    for before, at in zip([0, *lows[:-1]], lows, strict=True):
        top = before + int(np.argmax(height[before:at]))
        found.append(transfer(height[top : at + round(0.7 * motion.rate_hz)], motion.rate_hz))
    return found


def told(what: str, found: list[tuple[float, int, float]], note: str = "") -> None:
    """Least, quartiles and greatest of each figure."""
    seconds, peaks, speeds = (np.percentile(each, [0, 25, 50, 75, 100]).round(2) for each in zip(*found, strict=True))
    print(f"{what} ({len(found)}): s {seconds}, peaks {peaks}, m/s {speeds}  {note}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recorded", type=Path, nargs="?")
    parser.add_argument("-n", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    options = parser.parse_args()
    warnings.simplefilter("ignore", T2DWarning)
    if options.recorded:
        told("recorded bends", recorded_bends(options.recorded))
    for sentence, note in SENTENCES.items():
        motions = [motion_from_text(sentence, seed=seed) for seed in range(options.seed, options.seed + options.n)]
        sign = -1.0 if "stands up" in sentence else 1.0
        told(sentence, [transfer(sign * hips_m(each), each.rate_hz) for each in motions], note)


if __name__ == "__main__":
    main()
