"""Faster and slower gaits: the segments between foot peaks are stretched in time (Text2Doppler's change of gait)."""

from __future__ import annotations

import numpy as np

from t2d_rt.core.checks import integer, number
from t2d_rt.core.errors import InputError
from t2d_rt.motion.interpolate import low_pass, sample
from t2d_rt.types.motion import Motion, checked_motion

FACTORS = 0.25, 4.0
"""Changes of tempo that are made; people walk between half and twice their own pace."""

STEP_CUTOFF_HZ = 6.0
"""Foot heights are smoothed before their peaks are sought: steps come 1 to 3 times a second."""

LEAST_LIFT = 0.25
"""Rise of a foot over the least height before it, over the greatest one of the motion, from which a peak is a step."""

EASE_S = 0.08
"""Standard deviation of the change from one segment's tempo to the next: joint speeds stay continuous."""


def step_times_s(motion: Motion) -> np.ndarray:
    """Times [s] at which a foot is at the top of its swing, both feet, in order: one for each step."""
    checked_motion(motion)
    found = [_peaks(motion.joints[:, motion.index(f"{side}_ankle"), 2], motion.rate_hz) for side in ("left", "right")]
    return np.sort(np.concatenate(found)) / motion.rate_hz


def vary_gait(motion: Motion, factor: float = 1.0, *, spread: float = 0.0, seed: int = 0) -> Motion:
    """The motion walked faster (`factor` above 1) or slower, step by step; its path and its planted feet stay where they are.

    Cadence and speed change by `factor`, the steps' lengths do not. spread: standard deviation of the logarithm of each step's own
    factor, drawn from `seed`; a healthy walk varies by 0.02 to 0.03 from step to step (Hausdorff 2005). The tempo changes
    smoothly at foot peaks. Without steps the whole motion changes alike.
    """
    checked_motion(motion)
    number("factor", factor, *FACTORS)
    number("spread", spread, 0.0, 0.5)
    integer("seed", seed)
    knots = np.concatenate([[0.0], step_times_s(motion), [motion.duration_s]])
    knots = knots[np.concatenate([[True], np.diff(knots) > 1e-6])]
    draws = np.random.default_rng(seed).standard_normal(len(knots) - 1)
    factors = np.exp(spread * draws)
    factors *= factor * np.sum(np.diff(knots) / factors) / knots[-1]  # the whole takes 1 / factor of its time
    times_s = _warped(knots, factors, motion.rate_hz)
    if len(times_s) < 2:
        raise InputError(
            f"a factor of {factor:g} leaves less than 2 frames of a motion of {motion.duration_s:.3g} s; give a smaller one"
        )
    joints, rotations = sample(motion, times_s)
    note = f"gait {factor:.4g} times as fast" + (f", steps vary by {spread:g} (seed {seed})" if spread else "")
    new_s = np.arange(len(times_s)) / motion.rate_hz
    begins = ((name, float(np.interp(begin_s, times_s, new_s))) for name, begin_s in motion.activities)
    activities = tuple((name, begin_s) for name, begin_s in begins if begin_s < new_s[-1] or begin_s == 0)
    return motion.edited(note, joints=joints, rotations=rotations, activities=activities)


def _warped(knots: np.ndarray, factors: np.ndarray, rate_hz: float) -> np.ndarray:
    """Times of the motion [s] that the new frames show, (T,)."""
    fine = np.arange(0.0, knots[-1], 1.0 / (4.0 * rate_hz))
    fine = np.append(fine, knots[-1])
    slowness = 1.0 / factors[np.clip(np.searchsorted(knots, fine, side="right") - 1, 0, len(factors) - 1)]
    width = EASE_S * 4.0 * rate_hz
    reach = int(np.ceil(4 * width))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    slowness = np.convolve(np.pad(slowness, reach, mode="edge"), kernel / kernel.sum(), mode="valid")
    steps = 0.5 * (slowness[1:] + slowness[:-1]) * np.diff(fine)
    shown = np.concatenate([[0.0], np.cumsum(steps)])
    frames = np.arange(int(np.floor(shown[-1] * rate_hz + 1e-6)) + 1) / rate_hz
    return np.interp(frames, shown, fine)


def _peaks(height: np.ndarray, rate_hz: float) -> np.ndarray:
    """Frames at which a foot is highest between two stances."""
    if rate_hz > 2.5 * STEP_CUTOFF_HZ and len(height) > 8:
        height = low_pass(height[:, None], STEP_CUTOFF_HZ, rate_hz)[:, 0]
    inner = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
    lift = height - height.min()
    kept: list[int] = []
    for peak in inner[lift[inner] > LEAST_LIFT * max(lift.max(), 0.02)]:
        # Between two steps the foot comes down; of two peaks without a stance between them the higher one is the step.
        if kept and height[kept[-1] : peak].min() > height.min() + LEAST_LIFT * lift.max():
            kept[-1] = int(peak) if height[peak] > height[kept[-1]] else kept[-1]
        else:
            kept.append(int(peak))
    return np.array(kept, dtype=int)
