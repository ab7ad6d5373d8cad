"""Measure and remove noise of joint positions and of a skeleton's rotations, and find joints that turn far and back at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from math import comb
from operator import itemgetter

import numpy as np

from t2d_rt.core.errors import warn
from t2d_rt.geometry.vectors import dot, inner
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import runs
from t2d_rt.motion.interpolate import JITTER_CUTOFF_HZ, compose, low_pass, low_pass_gain
from t2d_rt.motion.read.joint_sets import limb_lengths
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import Motion

# --- noise of joint positions, measured, and the low-pass that leaves the least error of speed ---
#
# Depth cameras and pose estimators give 10 to 30 frames a second in which every joint errs by millimetres. A radar
# sees speed: 4 mm at 20 Hz, anew in each frame, are 0.25 m/s (`noise_speed_mps`). The noise is measured where no
# motion hides it, in the lengths of bones, which a body keeps: their spectrum is the noise's, which is no white one
# where a tracker follows its last frames or errs in bursts. Each joint is then filtered at the cut-off at which noise
# let through and motion lost add up to the least error.


NOISE_LIMIT_MPS = 0.03
"""Speed that noise may add before joints are filtered; `t2d_rt.motion.interpolate.JITTER_LIMIT_MPS` for files with rotations."""

CUTOFFS_HZ = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.3, 16.0, 22.6, 32.0)

ABOVE_NOISE = 1.6
"""Spectral power over that of the noise above which a frequency holds motion: means over 9 frequencies scatter by 27 % for 3
coordinates, by 17 % for 8 bones."""

SURELY = 3.0
"""The same ratio that a band of such frequencies must reach somewhere: noise in bursts scatters by twice as much."""

RARE = 0.5
"""Percentage of the shortest and of the longest lengths of a bone that are clipped to the others, because a jump is no noise."""

SMOOTHING = 0.2
"""Part of a frequency over which spectra are averaged to either side: fast movement has broad spectra."""

TOP = 0.75
"""Part of half the rate above which a joint has next to no motion: the power there is its own noise, if it is more than that of the
limbs' bones, as at hands and feet."""


def without_noise(tracks: Tracks) -> tuple[Tracks, str | None]:
    """Tracks [m] freed of measured noise and a clause for the report; the clause is None if the usual smoothing is to decide."""
    noise, rate_hz = noise_power(tracks.points), tracks.rate_hz
    if noise_speed_mps(noise, rate_hz) <= NOISE_LIMIT_MPS:
        return tracks, None
    points, cutoffs_hz, error_mps = denoised(tracks.points, noise, rate_hz)
    if not cutoffs_hz:
        return tracks, None
    clause = f"noise of {1e3 * math.sqrt(float(noise.mean())):.1f} mm"
    clause = told_noise("joints'", clause, "from bone lengths", cutoffs_hz, error_mps, rate_hz=rate_hz)
    return replace(tracks, points=points), clause


def told_noise(
    whose: str, noise: str, source: str, cutoffs_hz: tuple[float, ...], error_mps: float, *, rate_hz: float
) -> str:
    """A clause for the report on noise that was smoothed away; warns if too much remains."""
    error = f"joint speeds err by about {error_mps:.2f} m/s"
    # A little more than what a window of 25 ms resolves at 77 GHz, 0.078 m/s (lambda / 2 T).
    if error_mps > 0.1:
        warn(
            f"the {whose} {noise} at {rate_hz:g} Hz leaves too much after smoothing: {error}; micro-Doppler finer "
            "than that is noise"
        )
    span = " to ".join(f"{cutoff:g}" for cutoff in dict.fromkeys(cutoffs_hz[:1] + cutoffs_hz[-1:])) or "no"
    return f"{noise} ({source}) smoothed at {span} Hz{', joint by joint' if len(cutoffs_hz) > 1 else ''} ({error})"


def noise_power(points: dict[str, np.ndarray]) -> np.ndarray:
    """Power (T,) [m^2] of the noise of a coordinate at frequencies from 0 to half the rate; its mean is the variance."""
    lengths = limb_lengths(points).reshape(8, -1).T
    if len(lengths) < 12:
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


def denoised(
    points: dict[str, np.ndarray], noise: np.ndarray, rate_hz: float
) -> tuple[dict[str, np.ndarray], tuple[float, ...], float]:
    """Points (T, 3) [m] of joints, each low-passed as its own spectrum and that of the noise (T,) require; the cut-offs used [Hz],
    ascending; and an estimate of the RMS error of the joints' speed that remains [m/s]."""
    smooth, used, errors = {}, set(), []
    for name, track in points.items():
        cutoff, error = best_cutoff(track, _track_noise(track, 3.0 * noise), rate_hz)
        smooth[name] = track if cutoff is None else low_pass(track, cutoff, rate_hz)
        used |= set() if cutoff is None else {cutoff}
        errors.append(error)
    return smooth, tuple(sorted(used)), math.sqrt(float(np.mean(errors)))


def best_cutoff(track: np.ndarray, noise: np.ndarray, rate_hz: float) -> tuple[float | None, float]:
    """The cut-off [Hz] of least expected error of speed, None for no filter, and that error squared.

    track: values (T, N). noise: power of the noise in all columns together, (T,), as `noise_power` gives it for one.
    """
    power = _track_power(track)
    omega = _omega(len(power), rate_hz)
    signal = np.zeros_like(power)
    for low, high in runs(power > ABOVE_NOISE * noise):
        if (power > SURELY * noise)[low:high].any():
            signal[low:high] = (power - noise)[low:high]
    errors: dict[float | None, float] = {None: float((omega**2 * noise).mean())}
    # A filter near half of the frame rate has no room for its transition.
    for cutoff in (cutoff for cutoff in CUTOFFS_HZ if cutoff < 0.45 * rate_hz):
        gain = low_pass_gain(len(power), cutoff, rate_hz)
        errors[cutoff] = float((omega**2 * ((1 - gain) ** 2 * signal + gain**2 * noise)).mean())
    best = min(errors, key=errors.__getitem__)
    return best, errors[best]


def _track_noise(track: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Power (T,) of the noise of a track (T, N): that of the bones (T,), scaled up if the track's highest frequencies have more."""
    top = slice(int(TOP * len(noise)), None)
    more = float(np.median(_track_power(track)[top])) / max(float(np.median(noise[top])), 1e-300)
    return np.asarray(noise * max(1.0, more))


def _track_power(track: np.ndarray) -> np.ndarray:
    """Spectral power (T,) of a track (T, N), continued by point reflection, as in the filter, so that its ends add none."""
    ramp = np.linspace(0.0, 1.0, len(track))[:, None]
    centred = track - (1 - ramp) * track[0] - ramp * track[-1]
    return _power(np.concatenate([centred, -centred[-2:0:-1]]))


def _power(periodic: np.ndarray) -> np.ndarray:
    """Spectral power (T,) of all columns of a period (2 T - 2, N) together, averaged over 9 neighbours."""
    return _averaged((np.abs(np.fft.rfft(periodic, axis=0)) ** 2).sum(axis=-1) / len(periodic))


def _averaged(power: np.ndarray) -> np.ndarray:
    """Spectral power averaged over 9 neighbours, or over `SMOOTHING` of the frequency to either side if that is more."""
    at, total = np.arange(len(power)), np.concatenate([[0.0], np.cumsum(power)])
    half = np.maximum(4, (SMOOTHING * at).astype(int))
    low, high = np.maximum(at - half, 0), np.minimum(at + half + 1, len(power))
    return np.asarray((total[high] - total[low]) / (high - low))


# --- noise of a skeleton's rotations and root, measured, and the low-pass of each with the least error of speed ---
#
# Body models fitted to video err anew in each frame. Their bones keep their lengths, and the noise of rotations adds
# up along the limbs: 1 degree in every joint and 3 mm of the root are 1.2 m/s at 30 Hz. The noise is measured where
# no motion hides it, in sixth differences in time, in the calmest tenth of a record and in the calmer joints: it is
# there all the time and everywhere, as impacts and fast limbs are not. Each rotation is then filtered like a position
# (`noise.best_cutoff`).


ORDER = 6
"""Order of the differences: at 30 Hz they keep 6 % of the amplitude of a movement at 3 Hz."""

WINDOW_S, FEWEST_AVERAGED = 0.4, 9
"""Time over which the squared differences are averaged [s], and the fewest frames."""

FOUND = 8.0
"""Speed of noise that the usual smoothing would leave, times the frame rate [m/s Hz], above which rotations are noisy: recordings
have up to 5.4 at their own rates (7.4 decimated to 20 to 30 Hz, a roll), noise of 1 degree and 3 mm has 23 at 30 Hz."""

SHORT_S, SHORTEST_S, LOWEST_RATE_HZ = 2.0, 1.0, 18.0
"""Records shorter than the first [s] hold few calm windows and have twice the limit. No noise is sought in those shorter than the
second [s], nor at lower rates [Hz], at which movement looks like noise."""


def without_rotation_noise(
    motion: Motion, parts: tuple[np.ndarray, np.ndarray], *, filtered: bool
) -> tuple[Motion, str] | None:
    """The motion without measured noise and a clause for its report; None if the noise is below the limit.

    parts: those of `t2d_rt.motion.interpolate.parts`. filtered: whether the usual low-pass at 12 Hz would follow.
    """
    if motion.rate_hz < LOWEST_RATE_HZ or motion.duration_s < SHORTEST_S:
        return None
    offsets, local = parts
    root, angles = motion.joints[:, :1], 2.0 * local  # twice a quaternion's step is the angle
    levels = np.concatenate([_levels(values, motion.rate_hz) for values in (root, angles)])
    usual = _usual(levels[1:])
    reach = _reach(motion)
    omega = _omega(len(local), motion.rate_hz)
    gain = low_pass_gain(len(omega), min(JITTER_CUTOFF_HZ, 0.49 * motion.rate_hz), motion.rate_hz) if filtered else 1.0
    calm = np.array([levels[0], *np.minimum(levels[1:], usual)])
    left = _speed_mps(calm * float((omega**2 * gain**2).mean()), reach)
    limit = FOUND / motion.rate_hz * (2.0 if motion.duration_s < SHORT_S else 1.0)
    # Recordings have up to 1.6 mm of noise in the root.
    if left <= limit and levels[0] <= 3.0 * 2e-3**2:
        return None
    levels = np.array([levels[0], *np.minimum(levels[1:], 4.0 * usual)])
    tracks = [root[:, 0], *np.moveaxis(angles, 1, 0)]
    fits = [
        best_cutoff(track, np.full(len(track), level), motion.rate_hz)
        for track, level in zip(tracks, levels, strict=True)
    ]
    smooth = [t if cut is None else low_pass(t, cut, motion.rate_hz) for t, (cut, _) in zip(tracks, fits, strict=True)]
    offsets = np.concatenate([smooth[0][:, None], offsets[:, 1:]], axis=1)
    joints, rotations = compose(offsets, quaternions.normalise(np.stack(smooth[1:], axis=1)), motion.parents)
    used = tuple(sorted({cut for cut, _ in fits if cut is not None}))
    noise = f"noise of {_degrees(usual):.1f} degrees and {1e3 * math.sqrt(levels[0] / 3):.1f} mm"
    error = _speed_mps(np.array([squared_error for _, squared_error in fits]), reach)
    clause = told_noise("rotations' and the root's", noise, "in calm frames", used, error, rate_hz=motion.rate_hz)
    return motion.edited("smoothed as its noise asks for", joints=joints, rotations=rotations), clause


def _levels(tracks: np.ndarray, rate_hz: float) -> np.ndarray:
    """Greatest variances (J,) that white noise can have in all columns together of each track (T, J, N), by its calmest frames."""
    differences = np.diff(tracks, n=ORDER, axis=0)
    square = inner(differences, differences) / comb(2 * ORDER, ORDER)
    frames = min(max(FEWEST_AVERAGED, round(WINDOW_S * rate_hz)), len(square))
    total = np.concatenate([np.zeros((1, square.shape[1])), np.cumsum(square, axis=0)])
    calm = np.percentile((total[frames:] - total[:-frames]) / frames, 10.0, axis=0)
    # Means of n white squares in the calmest tenth of windows are too small by 1.05 / sqrt(n) of the standard
    # deviation, within 5 % in records of 60 to 600 frames.
    return np.asarray((1.0 + 1.05 / math.sqrt(frames)) ** 2 * calm)


def _usual(levels: np.ndarray) -> float:
    """Noise of the calmer joints among those that turn: the 25th percentile of their variances."""
    turning = levels[levels > 1e-12]
    return float(np.percentile(turning, 25.0)) if len(turning) else 0.0


def _degrees(level: float) -> float:
    """Standard deviation about one axis [degrees] of a mean square over three [rad^2]."""
    return math.degrees(math.sqrt(level / 3.0))


def _reach(motion: Motion) -> np.ndarray:
    """Mean squared distances [m^2] (J, J) of joints (rows) from those above them in the skeleton (columns), else 0."""
    reach = np.zeros((len(motion.names), len(motion.names)))
    places = np.ascontiguousarray(motion.joints.transpose(2, 1, 0))
    chains: list[list[int]] = []
    for joint, parent in enumerate(motion.parents):
        chains.append([parent, *chains[parent]] if parent >= 0 else [])
        above = chains[joint]
        away = places[:, joint, None] - places[:, above]
        reach[joint, above] = dot(away, away).mean(axis=-1)
    return reach


def _speed_mps(squares: np.ndarray, reach: np.ndarray) -> float:
    """RMS speed of joints [m/s] whose root and rotations have these squared speeds (1 + J,): two of three axes are perpendicular to
    a lever arm."""
    return math.sqrt(float((squares[0] + 2.0 / 3.0 * reach @ squares[1:]).mean()))


# --- joints that turn far in one frame and back again: faults of tracking or export that disturb a spectrogram ---


LEAST_DEG = 90.0
"""Turn in one frame above which a joint flips: at 30 Hz 2700 degrees per second, faster than the elbow of a pitcher (2400; Fleisig
et al. 1999), and a flip turns back within `LONGEST` frames."""

LONGEST = 3
"""Frames that a flip lasts at most."""


def told_flips(local: np.ndarray, names: Sequence[str], rate_hz: float) -> str:
    """A clause for the report that names the three largest flips of joints, from their rotations (T, J, 4) against their parents;
    empty if there is none."""
    flips: list[tuple[float, str]] = []
    steps = _angle(local[:-1], local[1:])
    for joint, name in enumerate(names):
        step, rotations = steps[:, joint], local[:, joint]
        turned, after = np.flatnonzero(step > LEAST_DEG).tolist(), -1
        for start in turned:
            stops = [stop for stop in turned if start < stop <= start + LONGEST]
            back = next((stop for stop in stops if _angle(rotations[start], rotations[stop + 1]) < 45.0), None)
            if start > after and back is not None:
                lasts = "one frame" if back - start == 1 else f"{back - start} frames"
                when = f"for {lasts} at {(start + 1) / rate_hz:.3f} s"
                flips.append((float(step[start]), f"{name} turns by {step[start]:.0f} degrees {when}"))
                after = back
    if not flips:
        return ""
    largest = [flip for _, flip in sorted(flips, key=itemgetter(0), reverse=True)]
    more = f" and {len(flips) - 3} more" if len(flips) > 3 else ""
    return f"single-frame flips: {', '.join(largest[:3])}{more}"


def _angle(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Angles [deg] between rotations (..., 4)."""
    return np.asarray(np.degrees(2.0 * np.arccos(np.minimum(np.abs(inner(one, two)), 1.0))))
