"""Noise of joint positions, measured, and the low-pass that leaves the least error of speed.

Depth cameras and pose estimators give 10 to 30 frames a second in which every joint errs by millimetres. A radar sees speed:
4 mm at 20 Hz, anew in each frame, are 0.25 m/s (`noise_speed_mps`). The noise is measured where no motion hides it, in the lengths
of bones, which a body keeps: their spectrum is the noise's, which is no white one where a tracker follows its last frames or
errs in bursts. Each joint is then filtered at the cut-off at which noise let through and motion lost add up to the least.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.errors import warn
from t2d_rt.geometry.vectors import norms
from t2d_rt.motion.contacts import runs
from t2d_rt.motion.interpolate import low_pass, low_pass_gain
from t2d_rt.motion.read.joint_sets import LIMBS
from t2d_rt.motion.read.tracks import Tracks

NOISE_LIMIT_MPS = 0.03
"""Speed that noise may add before joints are filtered; `t2d_rt.motion.interpolate.JITTER_LIMIT_MPS` for files with rotations."""

SPEED_ERROR_MPS = 0.1
"""Remaining error of speed from which the user is warned: a little more than what a window of 25 ms resolves at 77 GHz, 0.078 m/s
(lambda / 2 T)."""


CUTOFFS_HZ = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.3, 16.0, 22.6, 32.0)

HIGHEST_CUTOFF = 0.45
"""Of the frame rate, for a cut-off; a filter at half of it has no transition."""

ABOVE_NOISE = 1.6
"""Of the noise's spectral power, for a frequency to hold motion: means over 9 frequencies scatter by 27 % for 3 coordinates, by
17 % for 8 bones."""

SURELY = 3.0
"""Likewise, that a band of frequencies must reach somewhere: noise in bursts scatters by twice as much."""

RARE = 0.5
"""Percent of frames, of the shortest and of the longest of a bone, whose lengths are cut to the others': a jump is no noise."""

SMOOTHING = 0.2
"""Of a frequency, by which spectra are averaged to either side: fast movement has broad spectra."""

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


def without_noise(tracks: Tracks) -> tuple[Tracks, str | None]:
    """Tracks [m] freed of measured noise and a clause for the report; None where the usual smoothing is to decide."""
    found = denoised(tracks.points, tracks.rate_hz)
    if not found.cutoffs_hz:
        return tracks, None
    noise = f"noise of {1e3 * found.noise_m:.1f} mm"
    told = told_noise(
        "joints'", noise, "from bone lengths", found.cutoffs_hz, found.speed_error_mps, rate_hz=tracks.rate_hz
    )
    return replace(tracks, points=found.points), told


def told_noise(
    whose: str, noise: str, seen: str, cutoffs_hz: tuple[float, ...], error_mps: float, *, rate_hz: float
) -> str:
    """A clause for the report on noise that was smoothed away, and a warning where too much remains."""
    told = f"joint speeds err by about {error_mps:.2f} m/s"
    if error_mps > SPEED_ERROR_MPS:
        warn(
            f"the {whose} {noise} at {rate_hz:g} Hz leaves too much after smoothing: {told}; micro-Doppler finer "
            "than that is noise"
        )
    span = " to ".join(f"{cutoff:g}" for cutoff in dict.fromkeys(cutoffs_hz[:1] + cutoffs_hz[-1:])) or "no"
    return f"{noise} ({seen}) smoothed at {span} Hz{', joint by joint' if len(cutoffs_hz) > 1 else ''} ({told})"


def _lengths(points: dict[str, np.ndarray]) -> np.ndarray:
    """Lengths of the limbs' bones, (8, T)."""
    return np.array(
        [
            norms(points[f"{side}_{lower}"] - points[f"{side}_{upper}"])
            for side in ("left", "right")
            for upper, lower in LIMBS
        ]
    )


def noise_power(points: dict[str, np.ndarray]) -> np.ndarray:
    """Power of the noise of each coordinate [m^2], (T,), at frequencies from 0 to half the rate; its mean is the variance."""
    lengths = _lengths(points).T
    if len(lengths) < FEWEST_FRAMES:
        return np.zeros(len(lengths))
    lengths = np.clip(lengths, *np.percentile(lengths, [RARE, 100.0 - RARE], axis=0))
    lengths = lengths - lengths.mean(axis=0)
    return _power(np.concatenate([lengths, lengths[-2:0:-1]])) / (2.0 * lengths.shape[1])


def noise_speed_mps(noise: np.ndarray, rate_hz: float) -> float:
    """RMS speed that noise of a spectrum (T,) in each of three coordinates adds: sqrt(3 <omega^2 noise>)."""
    return math.sqrt(3.0 * float((_omega(len(noise), rate_hz) ** 2 * noise).mean()))


def _omega(count: int, rate_hz: float) -> np.ndarray:
    """Angular frequencies [rad/s], (T,), from 0 to half the rate."""
    return np.linspace(0.0, math.pi * rate_hz, count)


def denoised(points: dict[str, np.ndarray], rate_hz: float) -> Denoised:
    """Points (T, 3) [m] of joints, each low-passed as its own spectrum and the measured noise ask for."""
    noise = noise_power(points)
    sigma, speed = math.sqrt(float(noise.mean())), noise_speed_mps(noise, rate_hz)
    if speed <= NOISE_LIMIT_MPS:
        return Denoised(points=points, noise_m=sigma, cutoffs_hz=(), speed_error_mps=speed)
    smooth, used, errors = {}, set(), []
    for name, track in points.items():
        cutoff, error = best_cutoff(track, 3.0 * noise, rate_hz)
        smooth[name] = track if cutoff is None else low_pass(track, cutoff, rate_hz)
        used |= set() if cutoff is None else {cutoff}
        errors.append(error)
    remaining = math.sqrt(float(np.mean(errors)))
    return Denoised(points=smooth, noise_m=sigma, cutoffs_hz=tuple(sorted(used)), speed_error_mps=remaining)


def best_cutoff(track: np.ndarray, noise: np.ndarray, rate_hz: float) -> tuple[float | None, float]:
    """The cut-off of least expected error of speed, None for no filter, and that error squared.

    track: values (T, N). noise: power of the noise in all columns together, (T,), as `noise_power` gives it for one.
    """
    ramp = np.linspace(0.0, 1.0, len(track))[:, None]
    centred = track - (1 - ramp) * track[0] - ramp * track[-1]
    # Continued by point reflection, as the filter does, so that ends make no spectrum of their own.
    power = _power(np.concatenate([centred, -centred[-2:0:-1]]))
    omega = _omega(len(power), rate_hz)
    signal = np.zeros_like(power)
    for low, high in runs(power > ABOVE_NOISE * noise):
        if (power > SURELY * noise)[low:high].any():
            signal[low:high] = (power - noise)[low:high]
    errors: dict[float | None, float] = {None: float((omega**2 * noise).mean())}
    for cutoff in (cutoff for cutoff in CUTOFFS_HZ if cutoff < HIGHEST_CUTOFF * rate_hz):
        gain = low_pass_gain(len(power), cutoff, rate_hz)
        errors[cutoff] = float((omega**2 * ((1 - gain) ** 2 * signal + gain**2 * noise)).mean())
    best = min(errors, key=lambda cutoff: errors[cutoff])
    return best, errors[best]


def _power(periodic: np.ndarray) -> np.ndarray:
    """Spectral power (T,) of all columns of a period (2 T - 2, N) together, averaged over 9 neighbours."""
    return _averaged((np.abs(np.fft.rfft(periodic, axis=0)) ** 2).sum(axis=-1) / len(periodic))


def _averaged(power: np.ndarray) -> np.ndarray:
    """Spectral power averaged over 9 neighbours, and over `SMOOTHING` of the frequency above."""
    at, total = np.arange(len(power)), np.concatenate([[0.0], np.cumsum(power)])
    half = np.maximum(4, (SMOOTHING * at).astype(int))
    low, high = np.maximum(at - half, 0), np.minimum(at + half + 1, len(power))
    return np.asarray((total[high] - total[low]) / (high - low))
