"""Motions that are shorter than is wanted: the person comes to rest and stays."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.core.checks import number
from t2d_rt.motion.interpolate import sample
from t2d_rt.types.motion import Motion, checked_motion

STOPPING_S = 0.6
"""Time in which a movement comes to rest [s]: about one step."""

LONGEST_S = 600.0


def hold(motion: Motion, duration_s: float) -> Motion:
    """The motion, longer by a time [s] in which its last pose is held.

    The last 0.3 s are shown more and more slowly, within 0.6 s, so that a person who moves at the end comes to rest without a jump
    of speed or acceleration; of a shorter hold or a shorter motion, as much as there is.
    """
    checked_motion(motion)
    number("duration_s", duration_s, 0.0, LONGEST_S, unit="s")
    stopping_s = min(STOPPING_S, 2.0 * duration_s, 2.0 * motion.duration_s)
    count = math.floor((motion.duration_s + duration_s) * motion.rate_hz + 1e-6) + 1
    times = np.arange(count) / motion.rate_hz
    begin_s = motion.duration_s - 0.5 * stopping_s
    x = np.clip((times - begin_s) / max(stopping_s, 1e-12), 0.0, 1.0)
    # What is shown goes on at speed 1 - minimum_jerk(x): the integral of that from 0 to x.
    slowed_s = begin_s + stopping_s * (x - x**4 * (2.5 + x * (x - 3.0)))
    shown = np.where(times < begin_s, times, np.minimum(slowed_s, motion.duration_s))
    joints, rotations = sample(motion, shown)
    return motion.edited(f"held for {duration_s:g} s", joints=joints, rotations=rotations)
