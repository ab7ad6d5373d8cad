"""Left or right: from the way feet point, knees bend, elbows bend and the body moves, and from names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.geometry.vectors import unit

DECISIVE = 1.6
"""Sum of the signs of the body above which names do not count: more than feet or knees alone can give."""

FOOT, KNEE, ELBOW, WALK, NAMES = 1.5, 1.5, 0.5, 0.6, 1.2
"""Weights. Feet point and knees bend forward in nearly every frame; elbows bend backward, but not of arms that are held out; people
walk forward as a rule."""


@dataclass(frozen=True, slots=True)
class Signs:
    """Votes, positive where what is called left lies on the left."""

    feet: float
    knees: float
    elbows: float
    walk: float

    @property
    def body(self) -> float:
        """Sum of all."""
        return self.feet + self.knees + self.elbows + self.walk

    def swapped(self) -> Signs:
        """The votes if left is called right."""
        return Signs(-self.feet, -self.knees, -self.elbows, -self.walk)

    def told(self) -> str:
        """The signs that say something, in words."""
        votes = (("feet", self.feet), ("knees", self.knees), ("elbows", self.elbows), ("walk", self.walk))
        return ", ".join(name for name, vote in votes if vote * self.body > 0.15) or "nothing in the pose"


def signs(points: dict[str, np.ndarray]) -> Signs:
    """Votes of the body for the sides that canonical points (T, 3) are named by; in any unit and axes, handed as BVH is."""
    pairs = {
        joint: (points[f"left_{joint}"], points[f"right_{joint}"]) for joint in ("hip", "knee", "ankle", "shoulder")
    }
    hips, shoulders = (0.5 * (pairs[joint][0] + pairs[joint][1]) for joint in ("hip", "shoulder"))
    up = unit(shoulders - hips)
    across = sum(pairs[joint][0] - pairs[joint][1] for joint in ("hip", "shoulder"))
    forward = unit(np.cross(across, up))
    leg = float(np.median(np.linalg.norm(pairs["hip"][0] - pairs["knee"][0], axis=-1))) * 2.0

    feet = [points[f"{side}_foot"] - points[f"{side}_ankle"] for side in ("left", "right") if f"{side}_foot" in points]
    knees = _bends(points, ("hip", "knee", "ankle"))
    elbows = _bends(points, ("shoulder", "elbow", "wrist"))
    moved = hips[1:] - hips[:-1]
    return Signs(
        feet=FOOT * _vote(feet, forward, 0.05 * leg), knees=KNEE * _vote(knees, forward, 0.02 * leg),
        elbows=-ELBOW * _vote(elbows, forward, 0.02 * leg), walk=WALK * _vote([moved], forward[1:], 0.02 * leg),
    )  # fmt: skip


def _bends(points: dict[str, np.ndarray], joints: tuple[str, str, str]) -> list[np.ndarray]:
    """From the straight line of a limb to its middle joint, (T, 3) for each side that the points have."""
    found = []
    for side in ("left", "right"):
        upper, middle, lower = (points[f"{side}_{joint}"] for joint in joints)
        along = unit(lower - upper)
        offset = middle - upper
        found.append(offset - np.sum(offset * along, axis=-1, keepdims=True) * along)
    return found


def _vote(vectors: list[np.ndarray], forward: np.ndarray, least: float) -> float:
    """Mean share of vectors that lies forward, -1 to 1; those shorter than `least` count in proportion."""
    if not vectors:
        return 0.0
    lengths = np.linalg.norm(vectors, axis=-1)
    ahead = float(np.sum(np.asarray(vectors) * forward))
    return ahead / max(float(lengths.sum()), least * lengths.size, 1e-300)
