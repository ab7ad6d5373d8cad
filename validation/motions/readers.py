"""Readers against independent decodes on real data: `python -m validation.motions.readers FOLDER`, the folder of recorded motions.

It prints a table and exits with 1 where a bar is missed. Bars: joints within 1 mm of an independent decode (HumanML3D vectors
0.1 mm), rotations from positions reproduce positions within 20 mm on average, no twist jumps by more than 30 degrees between
frames of 20 Hz or more, but within two frames of where a bone of the recording flips (1500 degrees a second, which no limb does).
"""

from __future__ import annotations

import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

import t2d_rt as t2d
from t2d_rt.core.errors import T2DWarning
from t2d_rt.motion import load_motion, motion_from_joints
from t2d_rt.motion.read import humanml3d, joints_npz
from t2d_rt.motion.read.noise import denoised
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion
from validation.motions import independent
from validation.motions.measures import reproduction_errors_m, swing_steps_deg, twist_steps_deg

MM = 1e-3
FLIP_DPS = 1500.0
AMP_NAMES = {
    "right_upper_arm": "right_shoulder", "right_lower_arm": "right_elbow", "right_hand": "right_wrist", "right_thigh": "right_hip",
    "right_shin": "right_knee", "right_foot": "right_ankle",
}  # fmt: skip
AMP_NAMES |= {name.replace("right", "left"): joint.replace("right", "left") for name, joint in AMP_NAMES.items()}

NOISES = ((10.0, 3.0), (10.0, 5.0), (20.0, 3.0), (20.0, 5.0), (30.0, 5.0))
"""Frame rates [Hz] and jitters [mm] at which smoothing is measured."""


def error_mm(motion: Motion, expected: dict[str, np.ndarray]) -> float:
    """Greatest distance of joints from expected ones (T, 3), z up, but for where the floor is [mm]."""
    gaps = np.stack([motion.joints[:, motion.index(name)] - track for name, track in expected.items()], axis=1)
    gaps -= gaps.mean((0, 1)) * [0, 0, 1]
    return float(np.linalg.norm(gaps, axis=-1).max()) / MM


def decodes(folder: Path) -> Iterator[tuple[str, float, float, Motion | None]]:
    """Name, error [mm], bar [mm] and what was read of every file that an independent decode is at hand for."""
    for path in sorted(folder.glob("library/kimodo/*.npz")):
        motion = load_motion(path, smooth_hz=None)
        joints = np.load(path)["posed_joints"].astype(float) @ independent.Y_UP
        yield (
            path.name,
            error_mm(motion, {name: joints[:, place] for name, place in joints_npz.PLACES.items()}),
            1.0,
            motion,
        )
    for path in sorted([*folder.glob("library/deepmimic/*.txt"), *folder.glob("more/humanoid3d*.txt")]):
        motion = load_motion(path, smooth_hz=None)
        found = independent.deepmimic_joints(path)
        if len(found["root"]) == len(motion.joints) and "interpolated" not in motion.report:
            expected = {name: track @ independent.Y_UP for name, track in found.items() if name in motion.names}
            yield path.name, error_mm(motion, expected), 1.0, motion
    for path in sorted(folder.glob("amp15*.npz")):
        motion = load_motion(path, smooth_hz=None)
        arrays = np.load(path)
        kept = np.flatnonzero(np.r_[True, (np.diff(arrays["joints"], axis=0) != 0).any(axis=(1, 2))])
        columns = {joint: list(arrays["names"]).index(name) for name, joint in AMP_NAMES.items()}
        expected = {joint: arrays["joints"][kept, column].astype(float) for joint, column in columns.items()}
        yield path.name, error_mm(motion, expected), 1.0, motion


def vectors_error_mm(motion: Motion) -> float:
    """HumanML3D vectors of a motion's joints, written by the published recipe, read back [mm]."""
    joints = motion.joints[:, :22] @ independent.Y_UP.T
    decoded = humanml3d.decode(independent.humanml3d_vectors(joints).astype(np.float32).astype(float)).joints
    p, q = (each - each.mean((0, 1)) for each in (decoded, joints[:-1]))
    angle = np.arctan2((p[..., 2] * q[..., 0] - p[..., 0] * q[..., 2]).sum(), (p[..., [0, 2]] * q[..., [0, 2]]).sum())
    turned = humanml3d._about_y(np.full(p.shape[:2], angle), p)
    return float(np.linalg.norm(turned - q, axis=-1).max()) / MM


def positions(motion: Motion) -> tuple[float, float, float]:
    """Mean error of forward kinematics [mm], its mean at the worst joint, and the greatest jump of twist [deg]."""
    found = motion_from_joints(motion.joints, rate_hz=motion.rate_hz, names=motion.names)
    errors = reproduction_errors_m(found)
    twist, swing = twist_steps_deg(found), swing_steps_deg(found)
    flips = (np.array(list(swing.values())) * motion.rate_hz > FLIP_DPS).any(axis=0)
    flips = np.convolve(flips, np.ones(5), "same") > 0
    jump = max(float(steps[~flips].max(initial=0)) for steps in twist.values())
    return float(errors.mean()) / MM, float(errors.mean(axis=0).max()) / MM, jump


def smoothing(motion: Motion, rate_hz: float, jitter_mm: float) -> tuple[float, float, float, float]:
    """RMS error of joint speeds [m/s]: of clean frames, of noisy ones, smoothed, and as the reader estimates it."""
    low = t2d.resample(motion, rate_hz)
    clean = low.joints[:, :22]
    noisy = clean + np.random.default_rng(0).normal(0, jitter_mm * MM, clean.shape)
    found = denoised({name: noisy[:, i] for i, name in enumerate(CANONICAL_JOINTS)}, rate_hz)
    smooth = np.stack(list(found.points.values()), axis=1)
    times = np.arange(0.0, low.duration_s, 1 / 120)

    def speeds(joints: np.ndarray, rate: float) -> np.ndarray:
        curve = make_interp_spline(np.arange(len(joints)) / rate, joints.reshape(len(joints), -1), k=3)
        return np.asarray(curve.derivative()(times)).reshape(len(times), -1, 3)

    true = speeds(motion.joints[:, :22], motion.rate_hz)
    errors = [float(np.sqrt(((speeds(each, rate_hz) - true) ** 2).sum(-1).mean())) for each in (clean, noisy, smooth)]
    return errors[0], errors[1], errors[2], found.speed_error_mps


def main(folder: Path) -> int:
    """Exit code."""
    warnings.simplefilter("ignore", T2DWarning)
    missed = 0
    start = time.perf_counter()
    print("file: error against an independent decode")
    for name, error, bar, _ in decodes(folder):
        missed += error > bar
        print(f"  {name:34s} {error:8.4f} mm {'' if error <= bar else 'MISSED'}")
    clips = {path.name: load_motion(path) for path in sorted(folder.glob("library/cmu/*"))}
    worst = max(vectors_error_mm(t2d.resample(motion, 20.0)) for motion in clips.values())
    missed += worst > 0.1
    print(f"HumanML3D vectors of {len(clips)} CMU clips: at most {worst:.5f} mm")
    with tempfile.TemporaryDirectory() as scratch:
        np.save(Path(scratch) / "a.npy", next(iter(clips.values())).joints[:, :22] @ independent.Y_UP.T)
        print(f"  {load_motion(Path(scratch) / 'a.npy').report}")
    others = [
        *folder.glob("library/iclone/*"),
        *folder.glob("library/kimodo/*.npz"),
        *folder.glob("library/deepmimic/*.txt"),
    ]
    for path in sorted([*others, *folder.glob("*.bvh*"), *folder.glob("amp15*")]):
        clips[path.name] = load_motion(path)
    print("rotations from positions: mean and worst joint's error of forward kinematics, greatest jump of twist")
    for name, motion in clips.items():
        mean, joint, jump = positions(motion)
        missed += (mean > 20) + (jump > 30 and motion.rate_hz >= 20)
        if jump > 15 or mean > 9 or name.startswith(("amp", "0")):
            verdict = "MISSED" if mean > 20 or jump > 30 else ""
            slow = f"at {motion.rate_hz:g} Hz" if motion.rate_hz < 20 else ""
            print(f"  {name:34s} {mean:5.1f} {joint:5.1f} mm {jump:5.1f} degrees {verdict} {slow}")
    print("speed errors [m/s]: clean frames, noisy, smoothed, estimated")
    for name in (
        "12_01_walk.bvh",
        "iclone_002_01_walk.bvh",
        "iclone_002_03_run_jog.bvh",
        "jumping_jacks_14_14part.bvh",
    ):
        for rate_hz, jitter_mm in NOISES:
            errors = smoothing(clips[name], rate_hz, jitter_mm)
            print(f"  {name:30s} {rate_hz:g} Hz {jitter_mm:g} mm  {'  '.join(f'{error:.3f}' for error in errors)}")
    print(f"{'all bars are met' if not missed else f'{missed} bars are missed'} ({time.perf_counter() - start:.0f} s)")
    return int(missed > 0)


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit("usage: python -m validation.motions.readers FOLDER, the folder of recorded motions")
    sys.exit(main(Path(sys.argv[1])))
