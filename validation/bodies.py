"""The recorded bodies that several sections look at."""

from __future__ import annotations

import numpy as np

import t2d_rt as t2d
from t2d_rt.resources import resource
from t2d_rt.types import Motion, MovingMesh, Radar

WALK, RUN = "12_01_walk.bvh", "iclone_002_03_run_jog.bvh.gz"


def recorded(name: str, angle_deg: float = 0.0) -> Motion:
    """A bundled motion, placed before the radar."""
    return t2d.place(t2d.load_motion(resource("motions", name)), angle_deg=angle_deg)


def walking(start_s: float, stop_s: float, name: str = WALK, angle_deg: float = 0.0) -> MovingMesh:
    """The skinned body over a part of a bundled motion."""
    return t2d.skin(t2d.trim(recorded(name, angle_deg), start_s, stop_s))


def random_chirps(surface: MovingMesh, radar: Radar, count: int, seed: int = 0) -> np.ndarray:
    """Chirps of a record, drawn anywhere in it, ascending."""
    total = len(radar.chirp_times_s(surface.duration_s))
    return np.sort(np.random.default_rng(seed).choice(total, count, replace=False))
