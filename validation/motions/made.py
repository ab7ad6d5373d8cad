"""Figures and pictures of made motions: `python -m validation.motions.made OUT [--recorded FOLDER]`.

For each action, samples of as many persons: duration, speed of the hips, lean of the trunk, skate, floor, balance (centre of
mass and zero moment point over the feet while they alone carry), verdict of the filter, spectra of joint speeds, distance between
samples; and a contact sheet for each. FOLDER holds recorded motions (iclone_002_06_bend_scoop_up.bvh.gz), against which bends are
held.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.interpolate import interp1d
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks, welch
from scipy.spatial import ConvexHull

from t2d_rt.motion.check import check_motion
from t2d_rt.motion.contacts import runs, soles
from t2d_rt.motion.descriptions.slots import Activity, Step
from t2d_rt.motion.generate.library.individual import individual
from t2d_rt.motion.generate.made import Made, make
from t2d_rt.motion.generate.made.hands import Anatomy
from t2d_rt.motion.kinematics import INDEX, motion_of, poses_of
from t2d_rt.motion.read import load_motion
from t2d_rt.types.motion import Motion
from t2d_rt.view.contact_sheet import contact_sheet
from validation.motions.limits import true_size

CASES: dict[str, tuple[tuple[Step, ...], Activity | None]] = {
    "sit": ((Step(action="sit"),), "sitting"),
    "sit, turning": ((Step(action="sit", direction="left"),), "sitting"),
    "sit, careful": ((Step(action="sit", manner="careful"),), "sitting"),
    "sit, angry": ((Step(action="sit", manner="angry"),), "sitting"),
    "sit on the floor": ((Step(action="sit", object="floor"),), "sitting"),
    "stand up": ((Step(action="stand_up"),), "sitting"),
    "get up": ((Step(action="stand_up", object="floor"),), "sitting"),
    "lie down": ((Step(action="lie_down"),), "sitting"),
    "lie on the left": ((Step(action="lie_down", direction="left"),), "sitting"),
    "lie face down": ((Step(action="lie_down", direction="forward"),), "sitting"),
    "lie, stand up": ((Step(action="lie_down"), Step(action="stand_up")), "sitting"),
    "bend": ((Step(action="bend"),), "bending"),
    "pick up": ((Step(action="bend", object="ball"),), "bending"),
    "bend left": ((Step(action="bend", direction="left"),), "bending"),
    "bend back": ((Step(action="bend", direction="back"),), "bending"),
    "squat": ((Step(action="squat"),), "bending"),
    "stretch": ((Step(action="stretch"),), "bending"),
    "stretch a leg": ((Step(action="stretch", body_part="leg"),), "bending"),
    "climb": ((Step(action="climb"),), None),
    "climb down": ((Step(action="climb", direction="down"),), None),
}  # fmt: skip

BANDS_HZ = np.array([0.5, 1, 2, 3, 4, 6, 8, 12])


def sample(steps: tuple[Step, ...], seed: int) -> tuple[Made, float]:
    """A made motion of a person drawn from a seed, and the time that making it took [s]."""
    rng = np.random.default_rng(seed)
    person = individual("person", rng)
    begin = time.perf_counter()
    found = make(steps, person.skeleton, rng=rng, tempo=person.tempo, handed="left" if person.left_handed else "right")
    return found, time.perf_counter() - begin


def on_floor(found: Made) -> Motion:
    """The motion with the floor, not the balls of the feet, at 0."""
    return motion_of(replace(found.poses, root=found.poses.root + [0, 0, Anatomy(found.poses.skeleton).sole_m]))


def figures(found: Made) -> dict[str, float]:
    """What is measured of one motion."""
    body, rate = Anatomy(found.poses.skeleton), found.poses.rate_hz
    joints, _ = found.poses.world()
    hips, shoulders = (
        0.5 * (joints[:, INDEX[f"left_{each}"]] + joints[:, INDEX[f"right_{each}"]]) for each in ("hip", "shoulder")
    )
    trunk, points = shoulders - hips, soles(found.poses)
    speed = np.gradient(hips[:, 2]) * rate
    skate = [
        float(np.ptp(points[start:stop, side, part], axis=0).max())
        for side in range(2) for part in range(2) for start, stop in runs(found.planted[:, side, part])
    ]  # fmt: skip
    centre = np.einsum("tjk,j->tk", joints, body.mass_weights)
    smooth = gaussian_filter1d(centre, 0.04 * rate, axis=0, mode="nearest")
    pull = np.gradient(np.gradient(smooth, axis=0), axis=0) * rate**2
    zero_moment = smooth[:, :2] - pull[:, :2] * (smooth[:, 2:] + body.sole_m) / (9.81 + pull[:, 2:])
    high = hips[:, 2] - np.interp(np.arange(len(hips)), [0, len(hips) - 1], found.floors_m) > 0.65 * body.standing_m
    margins = [np.where(high, margin_m(found, joints, points, each), np.nan) for each in (centre[:, :2], zero_moment)]
    return {
        "seconds": len(joints) / rate, "down m/s": -float(speed.min()), "up m/s": float(speed.max()),
        "lean deg": float(np.degrees(np.arccos(trunk[:, 2] / np.linalg.norm(trunk, axis=1))).max()),
        "skate mm": 1e3 * max(skate, default=0.0), "lowest mm": 1e3 * float((joints[..., 2] + body.sole_m).min()),
        "CoM mm": 1e3 * float(np.nanmin(margins[0])), "ZMP 2% mm": 1e3 * float(np.nanpercentile(margins[1], 2)),
        "m/s^2": float(np.linalg.norm(np.diff(joints, 2, axis=0), axis=-1).max() * rate**2),
    }  # fmt: skip


def margin_m(found: Made, joints: np.ndarray, points: np.ndarray, track: np.ndarray) -> np.ndarray:
    """Distance (T,) [m] of a track (T, 2) inside the hull of the feet that stand, negative outside, nan where none does."""
    half = 0.022 * Anatomy(found.poses.skeleton).stature_m
    margins = np.full(len(track), np.nan)
    for frame, planted in enumerate(found.planted):
        corners = []
        for number, side in enumerate(("left", "right")):
            heel, ball = points[frame, number, :, :2]
            ahead = (ball - heel) / np.linalg.norm(ball - heel)
            ends = [heel] if planted[number, 0] else []
            if planted[number, 1]:
                ends += [joints[frame, INDEX[f"{side}_toe"], :2] + 0.02 * ahead] + ([] if ends else [ball])
            across = half * np.array([-ahead[1], ahead[0]])
            corners += [end + shift for end in ends for shift in (across, -across)]
        if len(corners) >= 4:
            hull = ConvexHull(np.array(corners)).equations
            margins[frame] = -(hull[:, :2] @ track[frame] + hull[:, 2]).max()
    return margins


def spectrum_db(joints: np.ndarray, rate_hz: float) -> np.ndarray:
    """Power of joint speeds in `BANDS_HZ`, mean over joints [dB of m^2/s^2/Hz]."""
    speed = np.diff(joints[:, :22], axis=0) * rate_hz
    window = int(4 * rate_hz)
    frequency, power = welch(speed, fs=rate_hz, nperseg=min(window, len(speed)), nfft=window, axis=0, detrend=False)
    mean = power.sum(-1).mean(-1)
    inside = [(frequency >= low) & (frequency <= high) for low, high in pairwise(BANDS_HZ)]
    return np.array(
        [10 * np.log10(np.trapezoid(mean[each], frequency[each]) / np.ptp(frequency[each])) for each in inside]
    )


def aligned(motion: Motion, leg_m: float) -> np.ndarray:
    """Joints (60, 22, 3) over 60 instants, from where the pelvis begins, facing +x, in lengths of the leg."""
    joints = motion.joints[:, :22]
    joints = interp1d(np.linspace(0, 1, len(joints)), joints, axis=0)(np.linspace(0, 1, 60)) / leg_m
    joints = joints - joints[0, 0] * [1, 1, 0]
    across = joints[0, 1] - joints[0, 2]
    c, s = np.array([across[1], -across[0]]) / np.hypot(across[0], across[1])
    return joints @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]).T


def distances(samples: list[np.ndarray]) -> np.ndarray:
    """Mean distance of joints between each two of the samples [legs]."""
    return np.array([np.linalg.norm(a - b, axis=-1).mean() for i, a in enumerate(samples) for b in samples[:i]])


def recorded_bends(folder: Path) -> None:
    """Spectrum of the recorded bends and distances between them."""
    path = folder / "iclone_002_06_bend_scoop_up.bvh.gz"
    motion = true_size(load_motion(path), path.name)
    low, _ = find_peaks(-motion.joints[:, 0, 2], prominence=0.2)
    cuts = [slice(at - 110, at + 110) for at in low if 110 <= at < len(motion.joints) - 110]
    bends = [
        aligned(
            replace(motion, joints=motion.joints[cut], rotations=motion.rotations[cut]), poses_of(motion).skeleton.leg_m
        )
        for cut in cuts
    ]
    apart = distances(bends)
    power = np.round(spectrum_db(motion.joints, motion.rate_hz), 1)
    print(f"recorded bends: dB {power}, distances {np.round(np.sort(apart), 3)} legs")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--recorded", type=Path)
    parser.add_argument("-n", type=int, default=12)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.recorded:
        recorded_bends(options.recorded)
    for name, (steps, expected) in CASES.items():
        made = [sample(steps, seed) for seed in range(options.n)]
        motions = [on_floor(found) for found, _ in made]
        verdicts = [check_motion(motion, expected=expected) for motion in motions]
        rows = [figures(found) for found, _ in made]
        apart = distances(
            [aligned(motion, found.poses.skeleton.leg_m) for motion, (found, _) in zip(motions, made, strict=True)]
        )
        power = 10 * np.log10(
            np.mean([10 ** (spectrum_db(each.joints, each.rate_hz) / 10) for each in motions], axis=0)
        )
        spans = ", ".join(
            f"{key} {np.median(v):.3g} ({min(v):.3g} to {max(v):.3g})"
            for key in rows[0]
            for v in [[row[key] for row in rows]]
        )
        print(
            f"{name}: {sum(each.passed for each in verdicts)} of {len(verdicts)} pass, "
            f"made in {np.median([seconds for _, seconds in made]):.2f} s"
        )
        print(
            f"    {spans}\n    dB {np.round(power, 1)}; distance median {np.median(apart):.3f}, least {apart.min():.3f} legs"
        )
        for each in verdicts:
            if not each.passed:
                print("   ", each)
        figure = contact_sheet(motions[:8], title=name, labels=[f"seed {seed}" for seed in range(min(8, len(motions)))])
        figure.savefig(options.out / f"{name.replace(' ', '_').replace(',', '')}.png")


if __name__ == "__main__":
    main()
