"""Interpolate, resample, trim and smooth motions in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, number
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import dot
from t2d_rt.motion import quaternions
from t2d_rt.types.motion import Motion, checked_motion, checked_rate

# --- the smooth step that motions are eased and joined by, and the noise that bodies sway by ---


def minimum_jerk(fraction: np.ndarray) -> np.ndarray:
    """Smooth step from 0 to 1 over fractions (...), with zero speed and acceleration at 0 and 1: 10 x^3 - 15 x^4 + 6 x^5.

    The formula is equation 2 of Flash and Hogan 1985. Fractions below 0 give 0, and those above 1 give 1.
    """
    x = np.clip(fraction, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 + x * (6.0 * x - 15.0)))


def wander(
    rng: np.random.Generator, times_s: np.ndarray, count: int, band_hz: tuple[float, float], slope: float
) -> np.ndarray:
    """Smooth noise (T, count) of unit standard deviation: sines of random phase, whose amplitude density is f^-slope."""
    octaves = np.log2(band_hz[1] / band_hz[0])
    lines = max(8, round(6 * octaves))
    frequency = band_hz[0] * 2 ** (octaves * (np.arange(lines) + rng.random((count, lines))) / lines)
    amplitude = frequency ** (0.5 - slope)
    amplitude *= np.sqrt(2 / (amplitude**2).sum(axis=1, keepdims=True))
    phase = 2 * np.pi * (frequency[None] * times_s[:, None, None] + rng.random((count, lines)))
    return (amplitude * np.sin(phase)).sum(axis=-1)


# --- motion between its frames: C2 in time, because a radar sees the second derivative of every path ---
#
# Splines interpolate the rotation and the (nearly constant) offset of each joint in its parent's frame, and the root,
# instead of the joints' positions, so that bones keep their length.


JITTER_CUTOFF_HZ = 12.0
"""Frequency below which human movement lies, except impacts of a few milliseconds (Winter, Biomechanics, 2.2)."""

JITTER_LIMIT_MPS = 0.03
"""Jitter from which a file counts as noisy: at 20 Hz a displacement of 0.24 mm, 0.77 rad of round-trip phase at 77 GHz."""

MOST_NUMBERS = 100_000_000
"""Greatest number of joint coordinates that resampling or repeating may make: 0.8 GB, about three hours at 120 Hz."""

CHI_SQUARE_3_MEDIAN = 0.789
"""Median over mean of a squared speed with three Gaussian components."""


@dataclass(frozen=True, slots=True)
class Track:
    """A motion as a smooth function of time; call it with times [s]."""

    motion: Motion
    curves: Callable[[np.ndarray], np.ndarray]

    def __call__(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (K, J, 3) [m] and orientations (K, J, 4) at times (K,) [s]; raises an InputError outside the motion."""
        times = np.atleast_1d(array("times", times_s))
        end = self.motion.duration_s
        # Half a nanosecond of rounding is no error: last frames are often asked for as (T - 1) / rate.
        if times.ndim != 1 or not ((times >= -5e-10) & (times <= end + 5e-10)).all():
            raise InputError(
                f"times must be a list within 0 ... {end:.6g} s of the motion; shorten it or repeat() the motion"
            )
        values = self.curves(np.clip(times, 0.0, end)).reshape(len(times), len(self.motion.names), 7)
        return compose(values[..., 4:], quaternions.normalise(values[..., :4]), self.motion.parents)


def track(motion: Motion) -> Track:
    """The motion as a C2 function of time; build it once and evaluate it in blocks."""
    from scipy.interpolate import make_interp_spline

    checked_motion(motion)
    values = np.concatenate(parts(motion)[::-1], axis=-1).reshape(len(motion.joints), -1)
    # Components of sign-continuous quaternions are splined and normalised: this is C2, as accurate as RotationSpline
    # (within 2 % on a walk at 20 Hz), and takes all joints at once. A quintic is no better: the error at 20 Hz comes from
    # aliasing, not from the order. A B-spline stores one number per frame and component, cubic pieces store four.
    return Track(motion, make_interp_spline(motion.times_s, values, k=min(3, len(values) - 1)))


def sample(motion: Motion, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (K, J, 3) [m] and orientations (K, J, 4) at the times (K,) [s]; raises an InputError outside the motion."""
    return track(motion)(times_s)


def resample(motion: Motion, rate_hz: float) -> Motion:
    """The same motion at another frame rate; a remainder shorter than one frame is cut off.

    Raises an InputError if fewer than two frames or too many would result.
    """
    checked_motion(motion)
    checked_rate(rate_hz)
    count = math.floor(motion.duration_s * rate_hz + 1e-9) + 1
    if count < 2:
        raise InputError(
            f"rate_hz of {rate_hz:g} Hz leaves one frame of a motion of {motion.duration_s:.4g} s; raise it above "
            f"{1 / motion.duration_s:.4g} Hz"
        )
    if count * motion.joints[0].size > MOST_NUMBERS:
        raise InputError(
            f"rate_hz of {rate_hz:g} Hz makes {count} frames of this motion, more than "
            f"{MOST_NUMBERS // motion.joints[0].size}; lower it or trim the motion"
        )
    joints, rotations = sample(motion, np.minimum(np.arange(count) / rate_hz, motion.duration_s))
    return motion.edited(f"resampled at {rate_hz:g} Hz", joints=joints, rotations=rotations, rate_hz=float(rate_hz))


def trim(motion: Motion, start_s: float = 0.0, stop_s: float | None = None) -> Motion:
    """The frames from `start_s` to `stop_s` (both included, to the nearest frame); time starts at 0 again.

    Raises an InputError if this interval is not within the motion or holds a single frame.
    """
    checked_motion(motion)
    number("start_s", start_s, unit="s")
    stop_s = motion.duration_s if stop_s is None else number("stop_s", stop_s, unit="s")
    if not (0 <= start_s < stop_s <= motion.duration_s + 1e-9):
        raise InputError(f"trim needs 0 <= start < stop <= {motion.duration_s:.6g} s, got {start_s} and {stop_s}")
    span = slice(round(start_s * motion.rate_hz), round(stop_s * motion.rate_hz) + 1)
    if len(motion.joints[span]) < 2:
        raise InputError(
            f"from {start_s:.6g} to {stop_s:.6g} s there is one frame at {motion.rate_hz:g} Hz, and a motion needs 2; "
            "take a longer piece, or resample the motion first"
        )
    note = f"cut to {start_s:.6g} to {stop_s:.6g} s"
    first_s, last_s = span.start / motion.rate_hz, (span.stop - 1) / motion.rate_hz
    inside = [(name, begin_s - first_s) for name, begin_s in motion.activities if first_s < begin_s <= last_s]
    before = [(name, 0.0) for name, begin_s in motion.activities if begin_s <= first_s][-1:]
    changes: dict[str, Any] = {"joints": motion.joints[span], "rotations": motion.rotations[span]}
    changes |= {
        name: cycle.from_time(first_s)
        for name, cycle in (("breathing", motion.breathing), ("heartbeat", motion.heartbeat))
        if cycle is not None
    }
    return motion.edited(note, **changes, activities=(*before, *inside))


def smooth(motion: Motion, cutoff_hz: float = JITTER_CUTOFF_HZ) -> Motion:
    """Low-pass local rotations, offsets and root by a zero-phase Butterworth filter (4th order, -3 dB at the cut-off).

    Raises an InputError if the cut-off does not lie between 0 and half the frame rate.
    """
    checked_motion(motion)
    number("cutoff_hz", cutoff_hz)
    if not 1e-6 * motion.rate_hz < cutoff_hz < 0.5 * motion.rate_hz:
        raise InputError(
            f"the cut-off must lie between 0 and half the frame rate, {0.5 * motion.rate_hz:g} Hz, got {cutoff_hz:g} Hz"
        )
    return smoothed(motion, parts(motion), cutoff_hz)


def smoothed(motion: Motion, skeleton_parts: tuple[np.ndarray, np.ndarray], cutoff_hz: float) -> Motion:
    """The motion low-passed as by `smooth`, given its `parts`."""
    low = low_pass(np.concatenate(skeleton_parts[::-1], axis=-1), cutoff_hz, motion.rate_hz)
    joints, rotations = compose(low[..., 4:], quaternions.normalise(low[..., :4]), motion.parents)
    return motion.edited(f"smoothed at {cutoff_hz:g} Hz", joints=joints, rotations=rotations)


def low_pass(values: np.ndarray, cutoff_hz: float, rate_hz: float) -> np.ndarray:
    """Forward and backward Butterworth low-pass along axis 0, -3 dB at the cut-off; the ends are padded by point reflection."""
    # Two passes of 2nd order: each is -1.5 dB at the cut-off if its own corner lies 1/0.802 higher (Winter, 2.2.4.4),
    # warped exactly through the tangent of the bilinear transform.
    warped = math.tan(math.pi * cutoff_hz / rate_hz) / (math.sqrt(2.0) - 1.0) ** 0.25
    pad = min(len(values) - 1, math.ceil(2.0 * rate_hz / cutoff_hz))
    before, after = 2 * values[:1] - values[pad:0:-1], 2 * values[-1:] - values[-2 : -pad - 2 : -1]
    padded = np.concatenate([before, values, after])
    twice = _butterworth(_butterworth(padded, warped)[::-1], warped)[::-1]
    return twice[pad : pad + len(values)]


def low_pass_gain(count: int, cutoff_hz: float, rate_hz: float) -> np.ndarray:
    """Gain (count,) of `low_pass` at even frequencies from 0 to half the rate."""
    tangent = np.tan(np.linspace(0.0, 0.49999 * math.pi, count))
    return np.asarray(1 / (1 + (math.sqrt(2) - 1) * (tangent / math.tan(math.pi * cutoff_hz / rate_hz)) ** 4))


def _butterworth(values: np.ndarray, warped: float) -> np.ndarray:
    """Low-pass of 2nd order along axis 0 that is at rest at the first value; `warped` is tan(pi f / rate) of its corner f.

    The recursion is solved as a banded system of equations, because importing scipy.signal takes longer than planning a run.
    """
    from scipy.linalg import solve_banded

    assert warped > 0, "the cut-off lies below half the rate"
    damped = 1 + math.sqrt(2.0) * warped + warped**2
    recursive = 1.0, 2 * (warped**2 - 1) / damped, (1 - math.sqrt(2.0) * warped + warped**2) / damped
    start = values[:1]
    x = (values - start).reshape(len(values), -1)
    right = np.array(x, order="F")
    right[1:] += 2 * x[:-1]
    right[2:] += x[:-2]
    right *= warped**2 / damped
    filtered = solve_banded((2, 0), np.outer(recursive, np.ones(len(x))), right, overwrite_b=True, check_finite=False)
    return filtered.reshape(values.shape) + start


def jitter_mps(motion: Motion) -> float:
    """RMS joint speed of the noise above `JITTER_CUTOFF_HZ` [m/s], from the *median* over joints and frames.

    Noise is always present, foot strikes only at times: they raise the mean of a clean run but not the median, and must
    not be filtered away. It is 0 for frame rates too low to hold such noise, and for fewer than four frames.
    """
    if motion.rate_hz < 2.5 * JITTER_CUTOFF_HZ or len(motion.joints) < 4:
        return 0.0
    velocity = np.diff(motion.joints, axis=0) * motion.rate_hz
    rest = velocity - low_pass(velocity, JITTER_CUTOFF_HZ, motion.rate_hz)
    return float(np.sqrt(np.median((rest**2).sum(axis=-1)) / CHI_SQUARE_3_MEDIAN))


def parts(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (T, J, 3) [m] and sign-continuous rotations (T, J, 4) of all joints in their parents' frames."""
    offsets, local = decompose(motion.joints, motion.rotations, motion.parents)
    return offsets, quaternions.continuous(local)


def decompose(joints: np.ndarray, rotations: np.ndarray, parents: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (T, J, 3) and rotations (T, J, 4) in the parents' frames; the root keeps its position and orientation."""
    above = list(parents[1:])
    back = quaternions.conjugate(rotations[:, above])
    offsets, local = joints.copy(), rotations.copy()
    offsets[:, 1:] = quaternions.rotate(back, joints[:, 1:] - joints[:, above])
    local[:, 1:] = quaternions.multiply(back, rotations[:, 1:])
    return offsets, local


def compose(offsets: np.ndarray, local: np.ndarray, parents: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, J, 3) and orientations (T, J, 4) by forward kinematics: the inverse of `decompose`."""
    # With components first, each of them is contiguous in memory, which takes a third of the time.
    bones, turns = (np.ascontiguousarray(np.moveaxis(part, 0, -1).swapaxes(0, 1)) for part in (offsets, local))
    place, turned = composed(bones, turns, parents)
    return np.ascontiguousarray(place.transpose(2, 1, 0)), np.ascontiguousarray(turned.transpose(2, 1, 0))


def composed(
    bones: np.ndarray, rotations: np.ndarray, parents: Sequence[int], *, normalised: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (3, J, T) and orientations (4, J, T) by forward kinematics of offsets and rotations of the same shapes in the
    parents' frames; all joints of one depth are computed at a time.

    normalised: whether each orientation below the root is scaled to unit length before those of its children are found.
    """
    place, turned = bones.copy(), rotations.copy()
    for here, above in _levels(tuple(parents)):
        x, y, z, w = turned[:, above]
        bone, inner = bones[:, here], rotations[:, here]
        u = x, y, z
        twice = [2.0 * component for component in _cross(u, bone)]
        aside = _cross(u, twice)
        for k in range(3):
            place[k, here] = place[k, above] + (bone[k] + w * twice[k] + aside[k])
        aside, scalar = _cross(u, inner[:3]), inner[3]
        product = [w * inner[k] + scalar * u[k] + aside[k] for k in range(3)]
        product.append(w * scalar - dot(u, inner))
        size = np.sqrt(dot(product, product) + product[3] * product[3]) if normalised else 1.0
        for k in range(4):
            turned[k, here] = product[k] / size if normalised else product[k]
    return place, turned


@lru_cache(maxsize=16)
def _levels(parents: tuple[int, ...]) -> list[tuple[list[int], list[int]]]:
    """Joints of each depth below the roots, and their parents."""
    depth: list[int] = []
    for parent in parents:
        depth.append(depth[parent] + 1 if parent >= 0 else 0)
    levels = []
    for level in range(1, max(depth) + 1):
        here = [joint for joint, joint_depth in enumerate(depth) if joint_depth == level]
        levels.append((here, [parents[joint] for joint in here]))
    return levels


def _cross(first: Iterable[np.ndarray], second: Iterable[np.ndarray]) -> list[np.ndarray]:
    """Vector product of two vectors that are given as three components each."""
    (a, b, c), (d, e, f) = first, second
    return [b * f - c * e, c * d - a * f, a * e - b * d]
