"""What follows a fall: the last movements die away, and the body lies and breathes."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.easing import minimum_jerk
from t2d_rt.motion.generate.falls.anatomy import matrices
from t2d_rt.motion.generate.falls.humanoid import RATE_HZ
from t2d_rt.types.motion import CANONICAL_JOINTS

EASING_S = 0.4
"""Simulated time at the end that is stretched to twice its length, so that all speeds fall to nothing."""

BREATHS_HZ = (0.2, 0.33)
"""12 to 20 breaths a minute."""
BREATH_RAD = (0.012, 0.024)
"""Half the chest's rotation in a breath: the breastbone rises by 4 to 8 mm (De Groote et al. 1997, J. Appl. Physiol. 83)."""

CHEST = tuple(CANONICAL_JOINTS.index(name) for name in ("spine2", "spine3", "left_collar", "right_collar"))


def eased_out(qpos: np.ndarray) -> np.ndarray:
    """Frames (T + n, nq) of a run (T, nq) that comes to a full stop."""
    count = min(round(EASING_S * RATE_HZ), len(qpos) - 1)
    u = np.arange(1, 2 * count + 1) / (2 * count)
    # Speed falls linearly from 1 to 0 over twice the time.
    at = (len(qpos) - 1 - count) + count * u * (2.0 - u)
    low = np.minimum(at.astype(int), len(qpos) - 2)
    part = (at - low)[:, None]
    late = (1 - part) * qpos[low] + part * qpos[low + 1]
    late[:, 3:7] /= np.linalg.norm(late[:, 3:7], axis=1, keepdims=True)
    return np.concatenate([qpos[: len(qpos) - count], late])


def breathing(segments: np.ndarray, frames: int, rng: np.random.Generator, *, from_frame: int) -> np.ndarray:
    """Segments (T + frames, 22, 3, 3): those given, the last one held, and the chest rising and falling from a frame on."""
    held = np.concatenate([segments, np.repeat(segments[-1:], frames, axis=0)])
    times = np.maximum(np.arange(len(held)) - from_frame, 0) / RATE_HZ
    angle = rng.uniform(*BREATH_RAD) * minimum_jerk(times / 0.8) * np.sin(2 * np.pi * rng.uniform(*BREATHS_HZ) * times)
    turn = matrices(quaternions.about_axis(np.array([1.0, 0.0, 0.0]), angle))
    for joint in CHEST:
        held[:, joint] = held[:, joint] @ turn
    return held
