"""Find canonical joints among the joints of cameras, pose estimators and data sets, by their names or by their order.

A name is split into its side and its part ("ShoulderLeft", "LShoulder", "left_shoulder", "right_upper_arm"), and each canonical
joint takes the first part of its list that is there. Missing joints are filled in by `t2d_rt.motion.read.complete`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import norms
from t2d_rt.motion.skeletons import PARENT_OF, tables
from t2d_rt.types.motion import CANONICAL_JOINTS

SIDES: Mapping[str, str] = {"left": "left", "l": "left", "right": "right", "r": "right"}

NEEDED = tuple(
    f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for side in ("left", "right")
)
"""Joints that nothing can stand in for."""

ORDERS: Mapping[str, tuple[str, ...]] = {
    "HumanML3D": CANONICAL_JOINTS,
    "SMPL": (*CANONICAL_JOINTS, "left_hand", "right_hand"),
    **{order: tuple(names.split()) for order, names in tables()["orders"].items()},
}
"""Orders of joints in arrays that come without names."""

LEAST_LIKELY = 0.25
"""`unlikeness` above which an array in some order is no person; recordings stay under 0.1 in their own order."""


def canonical_sources(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """For each canonical joint that has any: the names of the joints whose mean stands for it."""
    if set(CANONICAL_JOINTS) <= set(names):
        return {joint: (joint,) for joint in PARENT_OF if joint in names}
    parts = {side_and_part(name): name for name in reversed(names)}
    sources: dict[str, tuple[str, ...]] = {}
    for side, prefix, section in (
        ("left", "left_", "sided_parts"),
        ("right", "right_", "sided_parts"),
        ("", "", "central_parts"),
    ):
        used: set[str] = set()
        for joint, part_names in tables()[section].items():
            part = next((part for part in part_names.split() if (side, part) in parts and part not in used), None)
            if part is not None:
                sources[f"{prefix}{joint}"] = (parts[side, part],)
                used.add(part)
    ears = tuple(parts[side, "ear"] for side in ("left", "right") if (side, "ear") in parts)
    if "head" not in sources and len(ears) == 2:
        sources["head"] = ears
    return sources


def side_and_part(name: str) -> tuple[str, str]:
    """The side ("left", "right" or "") and the part of the body that a joint's name tells, in lower case."""
    words = [word.lower() for word in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", name)]
    for side, rest in ((words[:1], words[1:]), (words[-1:], words[:-1])):
        if rest and side[0] in SIDES:
            return SIDES[side[0]], "".join(rest)
    return "", "".join(words)


def absent_joints(names: Sequence[str]) -> list[str]:
    """Joints of `NEEDED` for which there is none among the names."""
    sources = canonical_sources(names)
    return [joint for joint in NEEDED if joint not in sources]


def named_points(joints: np.ndarray, names: Sequence[str]) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
    """Points (T, 3) by canonical name of joints (T, K, 3), and which names stand for each; raises an InputError without limbs."""
    if len(set(names)) != len(names):
        raise InputError(
            f"the joints' names must differ, got {shown(max(names, key=list(names).count))} more than once"
        )
    sources, absent = canonical_sources(names), absent_joints(names)
    if absent:
        raise InputError(
            f"the joints' names lack {', '.join(absent)}; name hips, knees, ankles, shoulders, elbows and wrists "
            "of both sides, such as left_hip, HipLeft or LHip"
        )
    column = {name: place for place, name in enumerate(names)}
    return {
        joint: joints[:, [column[name] for name in source]].mean(axis=1) for joint, source in sources.items()
    }, sources


def likeliest_order(joints: np.ndarray) -> tuple[str | None, float]:
    """The order in which joints (T, K, 3) make the likeliest person, None if they make none, and their `unlikeness` in it."""
    count = joints.shape[1]
    fitting = [order for order, names in ORDERS.items() if len(names) == count]
    # In SMPL-H and SMPL-X, fingers and faces follow the body's 22 joints.
    fitting += ["HumanML3D"] if count >= 45 else []
    scores = {}
    for order in fitting:
        place = {name: column for column, name in enumerate(ORDERS[order])}
        sources = canonical_sources(ORDERS[order])
        scores[order] = unlikeness({joint: joints[:, place[sources[joint][0]]] for joint in NEEDED})
    best = min(scores, key=scores.__getitem__, default=None)
    if best is None or scores[best] > LEAST_LIKELY:
        return None, math.inf
    return best, scores[best]


def limb_lengths(points: Mapping[str, np.ndarray]) -> np.ndarray:
    """Lengths of thighs, shanks, upper arms and forearms, (2, 4, T): left and right."""
    bones = ("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")
    sides = ("left", "right")
    return np.array([[norms(points[f"{s}_{a}"] - points[f"{s}_{b}"]) for a, b in bones] for s in sides])


def unlikeness(points: Mapping[str, np.ndarray]) -> float:
    """Score of how limbs of points (T, 3) vary in length, differ left and right, and miss the ratio of legs to arms; 0 is best."""
    lengths = limb_lengths(points)
    lengths = lengths[..., np.isfinite(lengths).all(axis=(0, 1))]  # frames in which all are seen
    if not lengths.shape[-1]:
        return math.inf
    mean = lengths.mean(axis=-1)
    whole = max(float(mean.mean()), 1e-12)
    legs, arms = max(float(mean[:, :2].sum()), 1e-12), max(float(mean[:, 2:].sum()), 1e-12)
    # Legs and arms have 0.49 and 0.33 of the stature (Drillis and Contini 1966).
    odd = abs(math.log(legs / arms / 1.5)) / 4
    return float(lengths.std(axis=-1).mean() / whole + np.abs(mean[0] - mean[1]).mean() / whole + odd)
