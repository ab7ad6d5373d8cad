"""Joints that turn far in one frame and back again: faults of tracking or of export that a radar would see as clutter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.geometry.vectors import inner

LEAST_DEG = 90.0
"""Turns in one frame above which a joint flips: at 30 Hz 2700 degrees per second, faster than the elbow of a pitcher (2400; Fleisig
et al. 1999), and here the joint is back in the next frame."""

RETURN_DEG = 45.0
"""How near a joint comes back to where it was."""

LONGEST = 3
"""Frames that a flip lasts at most."""

SHOWN = 3


@dataclass(frozen=True, slots=True)
class Flip:
    """One joint's turn and return."""

    joint: str
    time_s: float
    frames: int
    angle_deg: float

    def __str__(self) -> str:
        lasts = "one frame" if self.frames == 1 else f"{self.frames} frames"
        return f"{self.joint} turns by {self.angle_deg:.0f} degrees for {lasts} at {self.time_s:.3f} s"


def flips(local: np.ndarray, names: Sequence[str], rate_hz: float) -> list[Flip]:
    """Flips of joints, the largest first, from their rotations (T, J, 4) against their parents."""
    found: list[Flip] = []
    steps = _angle(local[:-1], local[1:])
    for joint, name in enumerate(names):
        step, own = steps[:, joint], local[:, joint]
        turned, after = np.flatnonzero(step > LEAST_DEG).tolist(), -1
        for start in turned:
            stops = [stop for stop in turned if start < stop <= start + LONGEST]
            back = next((stop for stop in stops if _angle(own[start], own[stop + 1]) < RETURN_DEG), None)
            if start > after and back is not None:
                found.append(Flip(name, (start + 1) / rate_hz, back - start, float(step[start])))
                after = back
    return sorted(found, key=lambda flip: -flip.angle_deg)


def told_flips(found: list[Flip]) -> str:
    """A clause for the report; the largest flips by name."""
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return f"single-frame flips: {', '.join(map(str, found[:SHOWN]))}{more}"


def _angle(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Angles [deg] between rotations (..., 4)."""
    return np.asarray(np.degrees(2.0 * np.arccos(np.minimum(np.abs(inner(one, two)), 1.0))))
