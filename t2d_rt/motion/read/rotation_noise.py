"""Noise of a skeleton's rotations and of its root, measured, and the low-pass of each that leaves the least error of speed.

Body models fitted to video err anew in each frame. Their bones keep their lengths, and the noise of rotations adds up along the
limbs: 1 degree in every joint and 3 mm of the root are 1.2 m/s at 30 Hz. The noise is measured where no motion hides it, in sixth
differences in time, in the calmest tenth of a record and in the calmer joints: it is there all the time and everywhere, as impacts
and fast limbs are not. Each rotation is then filtered like a position (`noise.best_cutoff`).
"""

from __future__ import annotations

import math
from math import comb

import numpy as np

from t2d_rt.geometry.vectors import dot, inner
from t2d_rt.motion import quaternions
from t2d_rt.motion.interpolate import JITTER_CUTOFF_HZ, compose, low_pass, low_pass_gain
from t2d_rt.motion.read.noise import best_cutoff, told_noise
from t2d_rt.types.motion import Motion

ORDER = 6
"""Of the differences: at 30 Hz a movement at 3 Hz keeps 6 % of its amplitude beside noise."""

WINDOW_S, FEWEST_FRAMES = 0.4, 9
"""Time over which they are averaged."""

CALM = 10.0
"""Percent of these windows, and"""
CALM_JOINTS = 25.0
"""percent of the joints that turn at all, in which noise is what is there."""

BIAS = 1.05
"""Standard deviation of white noise over what the calmest tenth of windows of n frames says of it, less one, times sqrt(n): within
5 % in records of 60 to 600 frames."""

FOUND = 8.0
"""Speed that the usual smoothing would leave, times the frame rate [m/s Hz], from which rotations are noisy: recordings have up to
5.4 at their own rates (7.4 decimated to 20 to 30 Hz, a roll), 1 degree and 3 mm have 23 at 30 Hz."""

ROOT_M = 2e-3
"""Noise of the root's coordinates from which it is noisy; recordings have up to 1.6 mm."""

SHORT_S, SHORTEST_S, LOWEST_RATE_HZ = 2.0, 1.0, 18.0
"""Records shorter than the first hold few calm windows: twice the limit; none below the second, nor at lower rates, at which
movement looks like noise."""

MOST = 4.0
"""Noise power of a joint over that of the calmer ones."""


def without_rotation_noise(
    motion: Motion, parts: tuple[np.ndarray, np.ndarray], *, filtered: bool
) -> tuple[Motion, str] | None:
    """The motion without measured noise and a clause for its report; None where the noise is less than what the limit tells.

    parts: those of `t2d_rt.motion.interpolate.parts`. filtered: whether the usual low-pass at 12 Hz would follow.
    """
    if motion.rate_hz < LOWEST_RATE_HZ or motion.duration_s < SHORTEST_S:
        return None
    offsets, local = parts
    root, angles = motion.joints[:, :1], 2.0 * local  # twice a quaternion's step is the angle
    levels = np.concatenate([_levels(each, motion.rate_hz) for each in (root, angles)])
    usual = _usual(levels[1:])
    reach = _reach(motion)
    omega = np.linspace(0.0, math.pi * motion.rate_hz, len(local))
    kept = low_pass_gain(len(omega), min(JITTER_CUTOFF_HZ, 0.49 * motion.rate_hz), motion.rate_hz) if filtered else 1.0
    calm = np.array([levels[0], *np.minimum(levels[1:], usual)])
    left = _speed_mps(calm * float((omega**2 * kept**2).mean()), reach)
    limit = FOUND / motion.rate_hz * (2.0 if motion.duration_s < SHORT_S else 1.0)
    if left <= limit and levels[0] <= 3.0 * ROOT_M**2:
        return None
    levels = np.array([levels[0], *np.minimum(levels[1:], MOST * usual)])
    tracks = [root[:, 0], *np.moveaxis(angles, 1, 0)]
    found = [
        best_cutoff(track, np.full(len(track), level), motion.rate_hz)
        for track, level in zip(tracks, levels, strict=True)
    ]
    smooth = [t if cut is None else low_pass(t, cut, motion.rate_hz) for t, (cut, _) in zip(tracks, found, strict=True)]
    offsets = np.concatenate([smooth[0][:, None], offsets[:, 1:]], axis=1)
    joints, rotations = compose(offsets, quaternions.normalise(np.stack(smooth[1:], axis=1)), motion.parents)
    used = tuple(sorted({cut for cut, _ in found if cut is not None}))
    noise = f"noise of {_degrees(usual):.1f} degrees and {1e3 * math.sqrt(levels[0] / 3):.1f} mm"
    error = _speed_mps(np.array([each for _, each in found]), reach)
    told = told_noise("rotations' and the root's", noise, "in calm frames", used, error, rate_hz=motion.rate_hz)
    return motion.edited("smoothed as its noise asks for", joints=joints, rotations=rotations), told


def _levels(tracks: np.ndarray, rate_hz: float) -> np.ndarray:
    """Variances (J,) of white noise in all columns of each of the tracks (T, J, N) together, at most, by its calmest frames."""
    differences = np.diff(tracks, n=ORDER, axis=0)
    square = inner(differences, differences) / comb(2 * ORDER, ORDER)
    frames = min(max(FEWEST_FRAMES, round(WINDOW_S * rate_hz)), len(square))
    total = np.concatenate([np.zeros((1, square.shape[1])), np.cumsum(square, axis=0)])
    calm = np.percentile((total[frames:] - total[:-frames]) / frames, CALM, axis=0)
    return np.asarray((1.0 + BIAS / math.sqrt(frames)) ** 2 * calm)


def _usual(levels: np.ndarray) -> float:
    """Noise of the calmer joints among those that turn."""
    turning = levels[levels > 1e-12]
    return float(np.percentile(turning, CALM_JOINTS)) if len(turning) else 0.0


def _degrees(level: float) -> float:
    """About one axis."""
    return math.degrees(math.sqrt(level / 3.0))


def _reach(motion: Motion) -> np.ndarray:
    """Mean squared distances [m^2] (J, J) of joints (rows) from those above them in the skeleton (columns), else 0."""
    found = np.zeros((len(motion.names), len(motion.names)))
    places = np.ascontiguousarray(motion.joints.transpose(2, 1, 0))
    chains: list[list[int]] = []
    for joint, parent in enumerate(motion.parents):
        chains.append([parent, *chains[parent]] if parent >= 0 else [])
        above = chains[joint]
        away = places[:, joint, None] - places[:, above]
        found[joint, above] = dot(away, away).mean(axis=-1)
    return found


def _speed_mps(squares: np.ndarray, reach: np.ndarray) -> float:
    """RMS speed of joints whose root and rotations move by these squares of speed, (1 + J,): of three
    axes two lie across an arm."""
    return math.sqrt(float((squares[0] + 2.0 / 3.0 * reach @ squares[1:]).mean()))
