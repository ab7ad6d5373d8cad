"""When each step of a changed walk comes: tempo, halts and trembling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import follow, runs
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.kinematics import INDEX, Poses
from t2d_rt.motion.vary.gait_change import GaitChange
from t2d_rt.motion.vary.straight_walk import SIDES, about, slow_noise


def new_times(
    poses: Poses, change: GaitChange, stands: np.ndarray, weight: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Fractional frames (K,) of the walk that the new frames show."""
    rate = poses.rate_hz
    x = np.clip(poses.root[:, 0] / max(float(poses.root[-1, 0]), 1e-9), 0, 1)
    steps = np.sort(np.concatenate([[start for start, _ in runs(stands[:, side])] for side in range(2)])).astype(int)
    number = np.searchsorted(steps, np.arange(len(poses)), side="right")
    tempo = np.exp(change.step_time_spread * rng.standard_normal(len(steps) + 1))[number]
    tempo = (
        tempo
        * np.where(weight > 0.3, change.hurried_stance[0], 1.0)
        * np.where(weight < -0.3, change.hurried_stance[1], 1.0)
    )
    tempo = change.cadence * tempo / _mean_tempo(tempo)
    slowness = 1.0 / (tempo * np.exp(change.hurry * x))
    slowness = low_pass(slowness[:, None], min(4.0, 0.4 * rate), rate)[:, 0]
    for centre, duration_s in zip(_halts(poses, weight, rng, len(change.freezes_s)), change.freezes_s, strict=True):
        bell = np.exp(-0.5 * ((np.arange(len(poses)) - centre) / (0.06 * rate)) ** 2)
        slowness += duration_s * rate * bell / bell.sum()
    shown = np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))])
    return np.interp(np.arange(int(shown[-1]) + 1), shown, np.arange(len(poses)))


def _halts(poses: Poses, weight: np.ndarray, rng: np.random.Generator, count: int) -> np.ndarray:
    """Frames (count,) at which both feet bear the weight and rest as nearly as they ever do, not at the ends of the walk."""
    joints, _ = poses.world()
    feet = joints[:, [INDEX[f"{side}_{joint}"] for side in SIDES for joint in ("ankle", "toe")]]
    fastest = np.linalg.norm(np.gradient(feet, axis=0), axis=-1).max(axis=1) * poses.rate_hz + np.abs(weight)
    inner = np.arange(len(poses))[len(poses) // 7 : -(len(poses) // 10)]
    slowest = [at for at in inner[1:-1] if fastest[at] <= fastest[max(0, at - 10) : at + 11].min()]
    calm = sorted(slowest, key=lambda at: fastest[at])[: max(count, len(slowest) // 2)]
    return rng.choice(np.array(calm), size=count, replace=len(calm) < count) if count else np.zeros(0, dtype=int)


def _mean_tempo(tempo: np.ndarray) -> float:
    """Tempo of the whole: the harmonic mean, for time adds up."""
    return float(len(tempo) / np.sum(1.0 / tempo))


def trembling(poses: Poses, change: GaitChange, frames: np.ndarray, rng: np.random.Generator) -> Poses:
    """Knees that tremble where the walk halts, hands that shake at rest."""
    if not change.freezes_s and change.hand_tremor_rad == 0.0:
        return poses
    times = np.arange(len(poses)) / poses.rate_hz
    local = poses.local.copy()
    if change.hand_tremor_rad:
        for side in SIDES:
            own = (
                change.hand_tremor_rad * rng.uniform(0.3, 1.0) * (1 + 0.3 * slow_noise(len(poses), poses.rate_hz, rng))
            )
            shake = about("x", own * np.sin(2 * np.pi * rng.uniform(4.0, 6.0) * times + rng.uniform(0, 2 * np.pi)))
            joint = INDEX[f"{side}_elbow"]
            local[:, joint] = quaternions.multiply(local[:, joint], shake)
    poses = replace(poses, local=local)
    if not change.freezes_s:
        return poses
    halted = low_pass((np.gradient(frames) < 0.25).astype(float)[:, None], 2.0, poses.rate_hz)[:, 0]
    joints, _ = poses.world()
    ankles = {side: joints[:, INDEX[f"{side}_ankle"]] for side in SIDES}
    wave = 2 * np.pi * change.tremble_hz * times + 0.6 * slow_noise(len(poses), poses.rate_hz, rng)
    root = poses.root + np.clip(halted, 0, 1)[:, None] * np.column_stack([
        0.006 * np.sin(wave), 0.004 * np.sin(0.5 * wave), -0.008 * (1 + np.sin(wave + 0.7)) / 2
    ])  # fmt: skip
    return follow(replace(poses, root=root), ankles)
