"""Heel strikes and swings of a walk or run, from ankles relative to the pelvis (Zeni, Richards, Higginson 2008)."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion.generate.falls.anatomy import SIDES
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.posture import facing
from t2d_rt.types.motion import Motion

STEP_M = 0.15
"""How far ahead of the pelvis an ankle is at the heel strike of a step, at least."""

LOADING_S = 0.08
"""From a heel strike to where the foot slips, 0.05 to 0.1 s (Redfern et al. 2001, Ergonomics 44)."""

EARLY_S = 0.05
"""How long before it passes the other foot a swinging foot is caught: obstacles are met in the first half of the swing."""


def instants(motion: Motion, kind: str) -> list[tuple[int, str]]:
    """Frames and sides at which a foot may slip ("slip": after heel strikes) or be caught ("trip": as it passes the other one)."""
    found = []
    ahead = facing({name: motion.joints[:, i] for i, name in enumerate(motion.names)})
    for side in SIDES:
        relative = motion.joints[:, motion.index(f"{side}_ankle")] - motion.joints[:, 0]
        forward = low_pass(np.sum(relative * ahead, axis=1, keepdims=True), 6.0, motion.rate_hz)[:, 0]
        rising = np.gradient(forward)
        peaks = [i for i in range(1, len(forward) - 1) if rising[i - 1] > 0 >= rising[i] and forward[i] > STEP_M]
        if kind == "slip":
            # A foot slips as it takes the weight, before the body is over it.
            found += [(i + round(LOADING_S * motion.rate_hz), side) for i in peaks]
            continue
        crossing = np.flatnonzero((forward[:-1] < 0) & (forward[1:] >= 0) & (rising[1:] > 0)) + 1
        # Only where a step follows: a foot that is lifted in standing has nothing to carry it over.
        early = round(EARLY_S * motion.rate_hz)
        found += [
            (int(i) - early, side) for i in crossing if any(0 < peak - i < 0.5 * motion.rate_hz for peak in peaks)
        ]
    return sorted(found)
