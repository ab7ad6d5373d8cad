"""Find motions of a set that repeat one another: the same movement elsewhere, mirrored, a little faster, later, or with noise.

Each may be sound by itself; but a set that holds both has one performance twice, and a split of it may test what it trained on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.check.measures import RATE_HZ, Tracks, tracks
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

STEP, LATEST_S, LEAST_SHARED = 2, 1.0, 0.7
"""Frames from one compared posture to the next; how much later one may begin [s]; part of the shorter one that both must share."""

PACES = 1.0, 0.97, 1.03
"""Relative paces at which motions are compared; up to `NEAR` times the distance of copies, the best one and its lag are refined."""
SLOWEST, FASTEST = 0.965, 1.035
"""Limits of the finer pace."""

ALIKE, NEAR = 0.012, 4.0
"""Mean distance of joints, over stature, up to which two motions are copies; 14 walks of one sentence are 0.022 apart and more, 14
bends 0.031."""

OTHER = {"left": "right", "right": "left"}
MIRRORED = [
    CANONICAL_JOINTS.index("_".join(OTHER.get(part, part) for part in name.split("_"))) for name in CANONICAL_JOINTS
]
"""Index of the joint on the other side that mirrors each one."""


def copies(motions: Sequence[Motion]) -> list[tuple[int, int]]:
    """Pairs of indices of motions, the earlier one first, of which one repeats the other."""
    postures = [_postures(tracks(motion)) for motion in motions]
    images = [posture[:, MIRRORED] * [1.0, -1.0, 1.0] for posture in postures]
    return [
        (first, second)
        for second in range(len(motions))
        for first in range(second)
        if min(apart(postures[first], posture) for posture in (postures[second], images[second])) < ALIKE
    ]


def _postures(body: Tracks) -> np.ndarray:
    """Joints (T, 22, 3) over the stature, about the point of the floor under the hips, in the direction that the body faces."""
    joints = body.joints[::STEP][:, body.columns(CANONICAL_JOINTS)]
    ahead = body.facing[::STEP]
    turn = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), -np.arctan2(ahead[:, 1], ahead[:, 0]))
    level = body["hips"][::STEP, None] * [1.0, 1.0, 0.0]
    return np.asarray(quaternions.rotate(turn[:, None], joints - level) / body.stature_m)


def apart(first: np.ndarray, second: np.ndarray) -> float:
    """Distance of two courses of postures (T, 22, 3) and (U, 22, 3), root mean square over joints and mean over instants,
    one shifted and paced against the other so that it is least."""
    from scipy.optimize import minimize

    least, start, pace = min(
        (*_shifted_apart(first, _at(second, np.arange(0.0, len(second) - 1 + 1e-9, pace))), pace) for pace in PACES
    )
    if least > NEAR * ALIKE:
        return least

    def distance(lag_and_pace: np.ndarray) -> float:
        lag, pace = lag_and_pace
        instants = lag + pace * np.arange(len(first))
        inside = (instants > -1e-6) & (instants < len(second) - 1 + 1e-6)
        shared = LEAST_SHARED * min(len(first), (len(second) - 1) // pace + 1)
        if not SLOWEST <= pace <= FASTEST or inside.sum() < shared:
            return np.inf
        between = first[inside] - _at(second, instants[inside].clip(0, len(second) - 1))
        return float(np.sqrt((between**2).sum(axis=-1).mean(axis=-1)).mean())

    begin = np.array([start * pace, pace])
    simplex = begin + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.01 if pace <= 1 else -0.01]])
    finer = minimize(
        distance, begin, method="Nelder-Mead", options={"initial_simplex": simplex, "xatol": 1e-3, "maxfev": 80}
    )
    return min(least, float(finer.fun))


def _at(postures: np.ndarray, instants: np.ndarray) -> np.ndarray:
    """Postures (K, 22, 3) at fractional frames (K,) of postures (T, 22, 3), by linear interpolation."""
    before = np.minimum(instants.astype(int), len(postures) - 1)
    part = (instants - before)[:, None, None]
    return np.asarray((1 - part) * postures[before] + part * postures[np.minimum(before + 1, len(postures) - 1)])


def _shifted_apart(first: np.ndarray, second: np.ndarray) -> tuple[float, int]:
    """Least distance over all lags, and by how many frames the second one is ahead of the first."""
    a, b = (postures.reshape(len(postures), -1) for postures in (first, second))
    squares = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    distance = np.sqrt(np.maximum(squares, 0.0) / first.shape[1])
    latest, shared = round(LATEST_S * RATE_HZ / STEP), LEAST_SHARED * min(len(a), len(b))
    lags = range(max(-latest, 1 - len(a)), min(latest, len(b) - 1) + 1)
    diagonals = ((np.diagonal(distance, lag), lag) for lag in lags)
    return min((float(distances.mean()), lag) for distances, lag in diagonals if len(distances) >= shared)
