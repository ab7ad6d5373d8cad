"""Files whose hips never move: exports in place, treadmills, pose estimators that give joints about the hips.

Where the body goes is then told by its planted feet, which stay on the floor.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from t2d_rt.core.errors import warn
from t2d_rt.geometry.vectors import inner, norms, unit
from t2d_rt.motion.kinematics import middle
from t2d_rt.motion.quaternions import between, conjugate, rotate
from t2d_rt.motion.read.ground import averaged, upright_trunk
from t2d_rt.motion.read.tracks import Tracks

Root = Literal["file", "feet"]

TIPS = 0.0, 0.6
"""Where a foot may stand: on its ball, or on the tip of its toes, so far beyond the ball over the distance from ankle to ball."""

NEAR_M, FLIGHT_M = 0.005, 0.03
"""Height of a foot above the lower one up to which it may carry the body as well, and height of the lower one above its level from
which on both are in flight."""

LEAST_STANCE = 0.25
"""Part of the time that a foot must stand to tell the ground's speed in flight; a sprinter's feet do for half of it."""

SWAY_S, SMOOTH_S = 1.0, 0.1
"""Time of a stride, over which sway is averaged away, and the time over which the velocity of the ground is smoothed."""

LEAST_WALK_M, LEAST_MPS, STILL = 0.8, 0.3, 0.2
"""Path and speed of the ground below planted feet from which on it is a walk, and the path of the hips over it up to which they
stay; of 144 sound recordings one has hips that go less than 0.3 of it, a pirouette."""

FEET = ("pelvis", "left_ankle", "right_ankle", "left_foot", "right_foot")
STEADY = 0.985
"""Least mean cosine of a walker's axis to its own mean: 4 to 7 degrees; a kick, whose mean axis is no vertical, has 20."""
LEAN, UPRIGHT, LYING = np.tan(np.radians(5.0)), np.cos(np.radians(11.0)), np.cos(np.radians(40.0))
"""How far a walker's hips are ahead of the ankles in the mean, and the cosines of a body's axis to the vertical, but for that,
between which a camera may be tilted; runners lean by 10 degrees more than walkers."""

FIXED_M, LEAST_RISE_M = 0.002, 0.1
"""Extent of hips that are fixed, and by how much feet below them rise and fall that carry a body in fact."""


def rooted(tracks: Tracks, root: Root | None) -> Tracks:
    """Tracks in metres, z up, feet and all; a warning where hips never move.

    root: "feet" carries the body to where planted feet stay; "file" leaves it where the file has it, and says nothing.
    """
    if root == "file":
        return tracks
    points, rate_hz = tracks.points, tracks.rate_hz
    hips = middle(points, "hip")
    turn = _upward(points, hips) if len(hips) >= 2 * SWAY_S * rate_hz else None
    ground, lowest = _ground_mps(
        points if turn is None else {name: rotate(turn, points[name]) for name in FEET}, rate_hz
    )
    fixed = _fixed(points["pelvis"]) or _fixed(hips)
    if root == "feet":
        shift = np.zeros((len(hips), 3))
        shift[1:, :2] = np.cumsum(0.5 * (ground[1:] + ground[:-1]), axis=0) / rate_hz
        if fixed:
            shift[:, 2] = lowest[0] - averaged(lowest, SMOOTH_S * rate_hz)
        shift = shift if turn is None else rotate(conjugate(turn), shift)
        told = f"root motion from planted feet, {_path_m(ground, rate_hz) * rate_hz / len(hips):.2f} m/s"
        return replace(tracks, points={name: track + shift for name, track in points.items()}).saying(told)
    if not fixed and upright_trunk(points).mean() <= 0.5:
        return tracks
    gone_m = _path_m(np.gradient(hips, 1.0 / rate_hz, axis=0)[:, :2], rate_hz)
    ground_m, rise_m = _path_m(ground, rate_hz), float(np.ptp(np.percentile(lowest, [2, 98])))
    if ground_m > max(LEAST_WALK_M, LEAST_MPS * len(hips) / rate_hz) and gone_m < STILL * ground_m:
        why = f"planted feet slide at {ground_m * rate_hz / len(hips):.1f} m/s below them"
    elif fixed and rise_m > LEAST_RISE_M:
        why = f"the feet rise by {rise_m:.2f} m below them"
    else:
        return tracks
    warn(
        f"the hips never move, and {why}, as in exports in place, on treadmills and in joints about the hips: the torso has no "
        "speed; give root='feet' (--motion.root feet) to carry the body to where planted feet stay, or 'file' as it is"
    )
    return tracks.saying(f"the hips never move, {why}")


def _upward(points: dict[str, np.ndarray], hips: np.ndarray) -> np.ndarray | None:
    """The turn (4,) that raises a body above its feet; None where it is upright already, or bends."""
    axes = unit(hips - middle(points, "ankle"))
    axis = unit(axes.mean(axis=0))
    if (axes @ axis).mean() < STEADY:
        return None
    ahead = unit(np.cross(points["left_hip"] - points["right_hip"], axis).mean(axis=0))
    axis = unit(axis - LEAN * ahead)
    return between(axis, np.array([0.0, 0.0, 1.0])) if UPRIGHT > axis[2] > LYING else None


def _fixed(track: np.ndarray) -> bool:
    return bool(np.ptp(track, axis=0).max() < FIXED_M)


def _ground_mps(points: dict[str, np.ndarray], rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (T, 2) at which a planted foot goes backward in the file, and the height (T,) of the lower one.

    Feet stand on that point of theirs below which the ground goes most steadily.
    """
    found = []
    for tip in TIPS:
        feet = np.stack(
            [(1 + tip) * points[f"{side}_foot"] - tip * points[f"{side}_ankle"] for side in ("left", "right")], axis=1
        )
        height = averaged(feet[..., 2], 0.05 * rate_hz)
        lowest, frames = height.min(axis=1), np.arange(len(feet))
        backward = -np.gradient(feet, 1.0 / rate_hz, axis=0)[..., :2]
        # Where both feet are low, that one carries which goes backward along the heading.
        heading = averaged(backward[frames, height.argmin(axis=1)], SWAY_S * rate_hz)
        along = np.where(height - lowest[:, None] < NEAR_M, inner(backward, heading[:, None]), -np.inf)
        ground = backward[frames, along.argmax(axis=1)]
        if np.ptp(points["pelvis"][:, 2]) > FIXED_M:
            stands = np.flatnonzero(lowest < np.percentile(lowest, 5) + FLIGHT_M)
            if len(stands) > LEAST_STANCE * len(frames):
                ground = np.stack([np.interp(frames, stands, column[stands]) for column in ground.T], axis=-1)
        steady = _path_m(ground, rate_hz) / max(float(norms(ground).sum()) / rate_hz, 1e-9)
        found.append((steady, ground, lowest))
    _, ground, lowest = max(found, key=lambda each: each[0])
    return averaged(ground, SMOOTH_S * rate_hz), lowest


def _path_m(velocity: np.ndarray, rate_hz: float) -> float:
    """Length of the path without sway."""
    return float(norms(averaged(velocity, SWAY_S * rate_hz)).sum() / rate_hz)
