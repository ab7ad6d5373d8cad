"""Whether many motions of a class are like recorded ones of it together: how fast they move at each frequency, how they differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from t2d_rt.geometry.vectors import unit
from t2d_rt.motion.check.measures import RATE_HZ
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion, checked_motion

SEGMENT_S = 2.0
"""Length of the Hann windows of spectra: half a hertz of resolution."""

BANDS_HZ = np.array([0.5, 1.0, 1.6, 2.5, 4.0, 6.3, 9.0, 12.0])
"""Edges of the bands in which spectra are compared."""

INSTANTS = 64
"""At which two motions' postures are compared, from the begin to the end of each."""

HEADING_FROM = 0.25
"""Distance over stature that a motion must get for its heading to be that of its travel; else it is where the person faces."""


@dataclass(frozen=True, slots=True)
class Diversity:
    """Distances [m] between the motions of a set, each pair once: mean over joints and instants, after alignment."""

    median_m: float
    least_m: float
    nearest: float
    """Median over the motions of the distance to the nearest other one, over the stature."""
    nearest_posture: float
    """The same with the pelvis at one place at all instants."""


def speed_spectrum(motion: Motion) -> np.ndarray:
    """Power of the joints' velocities in `BANDS_HZ` [(m/s)^2], mean over the 22 joints, sum over axes: (bands,).

    By Welch's method: Hann windows of 2 s, half overlapping; what is shorter is one window, padded with zeros and weighted so that
    its mean power stays.
    """
    velocity = np.diff(joints_at_rate(motion)[:, : len(CANONICAL_JOINTS)], axis=0) * RATE_HZ
    width = round(SEGMENT_S * RATE_HZ)
    length = min(width, len(velocity))
    window = np.hanning(length + 2)[1:-1]
    starts = np.unique(
        np.linspace(0, len(velocity) - length, 1 + max(0, 2 * (len(velocity) - length) // length)).astype(int)
    )
    power = np.zeros(width // 2 + 1)
    for start in starts:
        piece = velocity[start : start + length]
        spectrum = np.fft.rfft((piece - piece.mean(axis=0)) * window[:, None, None], width, axis=0)
        # One-sided: the sum over all lines is the mean square of the piece.
        power += 2 * (np.abs(spectrum) ** 2).sum(axis=2).mean(axis=1) / (width * (window**2).sum())
    power /= len(starts)
    frequency = np.fft.rfftfreq(width, 1 / RATE_HZ)
    return np.array([power[(frequency >= low) & (frequency < high)].sum() for low, high in pairwise(BANDS_HZ)])


def spectrum_difference_db(made: Sequence[Motion], recorded: Sequence[Motion]) -> np.ndarray:
    """Mean spectrum of some motions over that of others [dB], (bands,): means of decibels, so that none drowns the others."""
    means = [
        np.mean([10 * np.log10(speed_spectrum(each) + 1e-12) for each in group], axis=0) for group in (made, recorded)
    ]
    return means[0] - means[1]


def distance_m(first: Motion, second: Motion) -> float:
    """Mean distance of the joints of two motions over time [m], each from its begin to its end, aligned at the begin.

    Both start at one place with one heading; that of their travel or, on the spot, that which the person faces.
    """
    return float(np.linalg.norm(aligned(first) - aligned(second), axis=-1).mean())


def aligned(motion: Motion) -> np.ndarray:
    """The 22 joints at `INSTANTS` instants (INSTANTS, 22, 3) [m], pelvis at x = y = 0 at first, heading along x."""
    joints = checked_motion(motion).joints[:, : len(CANONICAL_JOINTS)]
    places = np.linspace(0, len(joints) - 1, INSTANTS)
    before = np.minimum(places.astype(int), len(joints) - 2)
    part = (places - before)[:, None, None]
    found = (1 - part) * joints[before] + part * joints[before + 1]
    found = found - found[0, 0] * [1, 1, 0]
    gone = found[-1, 0] * [1, 1, 0]
    if np.linalg.norm(gone) < HEADING_FROM * np.ptp(found[..., 2]):
        left, right = (found[0, CANONICAL_JOINTS.index(f"{side}_hip")] for side in ("left", "right"))
        gone = np.cross(left - right, [0.0, 0.0, 1.0])
    ahead = unit(gone)
    return found @ np.stack([ahead, [-ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]], axis=1)


def diversity(motions: Sequence[Motion]) -> Diversity:
    """Median and least distance of the pairs of two or more motions."""
    tracks = np.stack([aligned(each) for each in motions])
    pairs = _distances(tracks)
    each_pair = pairs[np.tril_indices(len(pairs), -1)]
    over = tracks / np.array([each.joints[..., 2].max() for each in motions])[:, None, None, None]
    nearest = [float(np.median(_distances(each).min(axis=1))) for each in (over, over - over[:, :, :1])]
    return Diversity(float(np.median(each_pair)), float(each_pair.min()), *nearest)


def _distances(tracks: np.ndarray) -> np.ndarray:
    """Mean distances over joints and instants of tracks (N, T, J, 3) from one another, (N, N), infinite from themselves."""
    found = np.array([np.linalg.norm(tracks - each, axis=-1).mean(axis=(1, 2)) for each in tracks])
    np.fill_diagonal(found, np.inf)
    return found


def joints_at_rate(motion: Motion) -> np.ndarray:
    """Joints at `RATE_HZ`; faster motions are filtered first, so that nothing folds back."""
    checked_motion(motion)
    joints = motion.joints
    if motion.rate_hz == RATE_HZ:
        return joints
    from scipy.interpolate import make_interp_spline

    if motion.rate_hz > RATE_HZ:
        joints = low_pass(joints, 0.45 * RATE_HZ, motion.rate_hz)
    instants = np.arange(int(motion.duration_s * RATE_HZ + 1e-9) + 1) / RATE_HZ
    return make_interp_spline(motion.times_s, joints.reshape(len(joints), -1), k=min(3, len(joints) - 1))(
        np.minimum(instants, motion.duration_s)
    ).reshape(len(instants), *joints.shape[1:])
