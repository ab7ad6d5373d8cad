"""Where a motion starts before the radar: distance, angle and offset, drawn so that it has room in the scene."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from t2d_rt.dataset.recipe import Recipe
from t2d_rt.motion import place
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.types import Motion

TRIES = 60
"""Places that are drawn in a room."""
CLEARANCE_M = 0.15
"""Least distance of a joint to a wall or to furniture: about half the depth of a body."""
NEAREST_M = 0.8
"""Least horizontal distance of a joint to the radar."""
LOW_M = 0.12
"""Things that are lower can be stepped over."""
WIDTH_M = 1.5
"""Greatest offset from the boresight's line in a room."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a motion starts."""

    distance_m: float
    angle_deg: float
    aside_m: float
    height_m: float
    """Of the radar."""
    overlap_m: float
    """How far the motion goes into walls, furniture or the surroundings of the radar at most."""


def placing(recipe: Recipe, number: int, scene: str, motion: Motion) -> Place:
    """The place of a motion's number: of those drawn, the first at which the motion has room, or that at which it lacks least."""
    rng = np.random.default_rng(recipe.seeds(number, "view"))
    height_m = round(float(rng.uniform(*recipe.heights_m)), 4)
    # 10 poses a second tell where a body goes.
    stride = max(1, round(motion.rate_hz / 10.0))
    base = place(motion, distance_m=1.0, radar_position_m=(0.0, 0.0, 1.0))
    track = base.joints[::stride]
    low, high, boxes = surroundings(scene)
    best: Place | None = None
    for _ in range(TRIES):
        distance_m = round(float(rng.uniform(*recipe.distances_m)), 4)
        angle_deg = round(float(rng.uniform(*recipe.angles_deg)), 3)
        aside_m = 0.0 if scene == "free_space" else round(float(rng.uniform(-WIDTH_M, WIDTH_M)), 4)
        overlap_m = _overlap(_moved(track, distance_m, angle_deg, aside_m), low, high, boxes)
        found = Place(
            distance_m=distance_m,
            angle_deg=angle_deg,
            aside_m=aside_m,
            height_m=height_m,
            overlap_m=round(overlap_m, 3),
        )
        if found.overlap_m == 0:
            return found
        if best is None or found.overlap_m < best.overlap_m:
            best = found
    assert best is not None, "places were drawn"
    return best


def _moved(track: np.ndarray, distance_m: float, angle_deg: float, aside_m: float) -> np.ndarray:
    """A track (T, J, 3) that starts 1 m ahead at angle 0, as `place` and `aside` put it elsewhere."""
    angle = math.radians(angle_deg)
    cos, sin = math.cos(angle), math.sin(angle)
    local = track - np.array([1.0, 0.0, 0.0])
    x = cos * local[..., 0] - sin * local[..., 1] + distance_m
    y = sin * local[..., 0] + cos * local[..., 1] + aside_m
    return np.stack([x, y, local[..., 2]], axis=-1)


def _overlap(track: np.ndarray, low: np.ndarray, high: np.ndarray, boxes: np.ndarray) -> float:
    """How far (T, J, 3) goes at most beyond the walls, into boxes (B, 2, 3) or to within reach of the radar [m]."""
    outside = np.maximum(low + CLEARANCE_M - track, track - high + CLEARANCE_M)[..., :2].max()
    near = NEAREST_M - np.linalg.norm(track[..., :2], axis=-1).min()
    found = max(0.0, float(outside), float(near))
    for first, last in boxes:
        inside = np.minimum(
            track - first + [CLEARANCE_M, CLEARANCE_M, 0.0], last + [CLEARANCE_M, CLEARANCE_M, 0.0] - track
        )
        found = max(found, float(inside.min(axis=-1).max()))
    return found


@functools.lru_cache(maxsize=32)
def surroundings(scene: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least and greatest corner (3,) of a scene, and the boxes (B, 2, 3) of its furniture [m]; none in free space."""
    if scene == "free_space":
        return np.full(3, -np.inf), np.full(3, np.inf), np.zeros((0, 2, 3))
    surfaces = load_scene(scene).surfaces
    corners = np.array([(each.vertices.min(axis=0), each.vertices.max(axis=0)) for each in surfaces])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    # A wall, a door or a window is flat and lies in the shell of the room; all that stands within it is furniture.
    shell = np.any((corners[:, 1] <= low + 0.05) | (corners[:, 0] >= high - 0.05), axis=1)
    stands = ~shell & (corners[:, 1, 2] > LOW_M)
    return low, high, corners[stands]
