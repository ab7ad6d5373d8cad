"""Noise of joint positions, measured, and the low-pass that leaves the least error of speed.

Depth cameras and pose estimators give 10 to 30 frames a second in which every joint errs by millimetres, anew in each frame. A
radar sees speed: 4 mm at 20 Hz are 0.25 m/s (`noise_speed_mps`). The noise is measured where no motion hides it, in the lengths
of bones, which a body keeps; each joint is then filtered at the cut-off at which noise let through and motion lost add up to the
least.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.read.joint_sets import LIMBS

NOISE_LIMIT_MPS = 0.03
"""Speed that noise may add before joints are filtered; `t2d_rt.motion.interpolate.JITTER_LIMIT_MPS` for files with rotations."""

CUTOFFS_HZ = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.3, 16.0, 22.6, 32.0)

HIGHEST_CUTOFF = 0.45
"""Of the frame rate, for a cut-off; a filter at half of it has no transition."""

ABOVE_NOISE = 1.6
"""Of the noise's spectral power, for a frequency to hold motion: means over 9 frequencies and 3 coordinates scatter by 27 %."""

GAUSSIAN_MAD = 0.6745
"""Median of |x| over the standard deviation of a Gaussian."""

FEWEST_FRAMES = 12
"""Frames below which a noise is not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Denoised:
    """Joints after filtering, and what was measured."""

    points: dict[str, np.ndarray]
    noise_m: float
    """Standard deviation of each coordinate."""
    cutoffs_hz: tuple[float, ...]
    """Cut-offs used, ascending; empty where nothing was filtered."""
    speed_error_mps: float
    """RMS error of the joints' speed that remains, by estimate."""


def noise_m(points: dict[str, np.ndarray]) -> float:
    """Standard deviation [m] of the noise of each coordinate, from the second differences in time of the lengths of limbs.

    A length takes up twice the variance of a coordinate, its second difference six times that of the length.
    """
    lengths = [
        np.linalg.norm(points[f"{side}_{lower}"] - points[f"{side}_{upper}"], axis=-1)
        for side in ("left", "right")
        for upper, lower in LIMBS
    ]
    if len(lengths[0]) < FEWEST_FRAMES:
        return 0.0
    deviation = np.median(np.abs(np.diff(lengths, n=2, axis=-1)), axis=-1) / GAUSSIAN_MAD
    return float(np.sqrt((deviation**2).mean() / 12.0))


def noise_speed_mps(sigma_m: float, rate_hz: float) -> float:
    """RMS speed that independent noise of each frame adds between frames: sqrt(3) sigma (2 pi rate / sqrt(12))."""
    return math.sqrt(3.0) * sigma_m * 2.0 * math.pi * rate_hz / math.sqrt(12.0)


def denoised(points: dict[str, np.ndarray], rate_hz: float) -> Denoised:
    """Points (T, 3) [m] of joints, each low-passed as its own spectrum and the measured noise ask for."""
    sigma = noise_m(points)
    speed = noise_speed_mps(sigma, rate_hz)
    if speed <= NOISE_LIMIT_MPS:
        return Denoised(points=points, noise_m=sigma, cutoffs_hz=(), speed_error_mps=speed)
    choices = [cutoff for cutoff in CUTOFFS_HZ if cutoff < HIGHEST_CUTOFF * rate_hz]
    smooth, used, errors = {}, set(), []
    for name, track in points.items():
        cutoff, error = _best_cutoff(track, sigma, rate_hz, choices)
        smooth[name] = track if cutoff is None else low_pass(track, cutoff, rate_hz)
        used |= set() if cutoff is None else {cutoff}
        errors.append(error)
    remaining = math.sqrt(float(np.mean(errors)))
    return Denoised(points=smooth, noise_m=sigma, cutoffs_hz=tuple(sorted(used)), speed_error_mps=remaining)


def _best_cutoff(track: np.ndarray, sigma_m: float, rate_hz: float, choices: list[float]) -> tuple[float | None, float]:
    """The cut-off of least expected error of speed, None for no filter, and that error squared [(m/s)^2]."""
    frames = len(track)
    ramp = np.linspace(0.0, 1.0, frames)[:, None]
    centred = track - (1 - ramp) * track[0] - ramp * track[-1]
    # Continued by point reflection, as the filter does, so that ends make no spectrum of their own.
    power = (np.abs(np.fft.rfft(np.concatenate([centred, -centred[-2:0:-1]]), axis=0)) ** 2).sum(axis=-1) / (
        2 * frames - 2
    )
    frequency = np.fft.rfftfreq(2 * frames - 2, 1.0 / rate_hz)
    noise = 3.0 * sigma_m**2
    mean = _averaged(power)
    signal = np.where(mean > ABOVE_NOISE * noise, mean - noise, 0.0)
    omega2 = (2 * math.pi * frequency) ** 2
    errors: dict[float | None, float] = {None: float((omega2 * noise).mean())}
    tangent = np.tan(0.5 * math.pi * np.minimum(2 * frequency / rate_hz, 0.999999))
    for cutoff in choices:
        gain = 1 / (1 + (math.sqrt(2) - 1) * (tangent / math.tan(math.pi * cutoff / rate_hz)) ** 4)
        errors[cutoff] = float((omega2 * ((1 - gain) ** 2 * signal + gain**2 * noise)).mean())
    best = min(errors, key=lambda cutoff: errors[cutoff])
    return best, errors[best]


def _averaged(power: np.ndarray) -> np.ndarray:
    """Spectral power averaged over 9 neighbours."""
    kernel = np.ones(9)
    return np.convolve(power, kernel, "same") / np.convolve(np.ones_like(power), kernel, "same")
