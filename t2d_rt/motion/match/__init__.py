"""Find the joints of a skeleton of no known flavour by their names, by how they hang together and by where they lie.

Two pairs of limbs with equal bones on both sides are legs and arms; the chain between them is the spine, what goes on above the
shoulders is neck and head; feet, knees and the walk tell left from right. Names help where they say something.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from t2d_rt.core.checks import LONGEST_SHOWN
from t2d_rt.core.errors import printable
from t2d_rt.motion.match.mapping import (
    DECISIVE,
    NAMES,
    Person,
    Source,
    canonical_sources,
    find_person,
    joints_of,
    signs,
)
from t2d_rt.motion.match.skeleton_tree import Limb, Tree
from t2d_rt.types.motion import CANONICAL_JOINTS, OPTIONAL_JOINTS

__all__ = ["DECISIVE", "Match", "match", "signs"]

Sureness = Literal["sure", "fairly sure", "unsure"]

MARGINS = 0.7, 2.0
"""Lead in score over the next reading of the skeleton below which a match is unsure, and from which it may be sure."""


@dataclass(frozen=True, slots=True)
class Match:
    """The joints that were matched, and what is to be said of them."""

    joints: dict[str, str | tuple[str, str, float]]
    """For each canonical joint: the joint of the file, or a point between two, as in a `Flavour`."""
    summary: str
    """Clauses for the report."""
    doubts: tuple[str, ...]
    """Sentences that are to become warnings."""


def match(
    names: tuple[str, ...], parents: tuple[int, ...], positions: np.ndarray, rest: np.ndarray | None = None
) -> Match:
    """The canonical joints of a skeleton; raises an InputError if no person can be found in it.

    names, parents: joints and end sites (`<parent>:end`), parents before children, -1 for the root.
    positions: (T, N, 3), in any unit, with any axis upward, right-handed.
    rest: (N, 3), the pose in which all rotations are zero, where there is one.
    """
    tree = Tree(names, parents, np.asarray(positions, float))
    person, margin = find_person(tree, rest)
    legs, arms = person.legs.limbs, _alike(tree, person)
    votes, names_vote = _votes(tree, person, legs, arms)
    body = sum(votes.values())
    total = body if abs(body) >= DECISIVE else body + NAMES * names_vote
    if total < 0:
        legs, arms, body, names_vote = legs[::-1], arms[::-1], -body, -names_vote
        votes = {name: -vote for name, vote in votes.items()}
    sources = canonical_sources(tree, person, (legs, arms))
    made_up = [name for name in CANONICAL_JOINTS if name not in sources] + ["head"] * isinstance(sources["head"], tuple)
    agree = _agreement(tree, sources)
    sure = _sureness(margin, abs(total), agree, body, headless=isinstance(sources["head"], tuple))
    joints = {name: _by_name(names, sources[name]) for name in (*CANONICAL_JOINTS, *OPTIONAL_JOINTS) if name in sources}
    basis = "names and form" if agree >= 0.5 else "form" if agree < 0.1 else "form, few by names"
    signs_told = ", ".join(name for name, vote in votes.items() if vote * body > 0.15) or "nothing in the pose"
    signs_told += " and names" if names_vote > 0.5 else ""
    clauses = [
        f"joints matched by {basis} ({sure}; {round(agree * 100)} % are named as expected; sides from {signs_told}): "
        + ", ".join(f"{name} {_shown(source)}" for name, source in joints.items())
    ]
    if made_up:
        clauses.append(f"made up: {', '.join(made_up)}")
    return Match(joints, "; ".join(clauses), tuple(_doubts(sure, names_vote)))


def _alike(tree: Tree, person: Person) -> tuple[Limb, Limb]:
    """The arms in the order of the legs: the first arm is on the side of the first leg."""
    (leg, other), (arm, last) = joints_of(person.legs, 0), joints_of(person.arms, 0)
    across = (tree.positions[:, leg] - tree.positions[:, other]) * (tree.positions[:, arm] - tree.positions[:, last])
    first, second = person.arms.limbs
    return (first, second) if float(np.median(across.sum(axis=-1))) >= 0 else (second, first)


def _votes(
    tree: Tree, person: Person, legs: tuple[Limb, Limb], arms: tuple[Limb, Limb]
) -> tuple[dict[str, float], float]:
    """Votes of body and names (-1 to 1) for the first limbs being the left ones."""
    sources = canonical_sources(tree, person, (legs, arms))
    points = {name: tree.positions[:, source] for name, source in sources.items() if isinstance(source, int)}
    name_votes = [
        (1.0 if tree.labels[joint].side == side else 0.0 if tree.labels[joint].side is None else -1.0)
        for pair in (legs, arms)
        for side, limb in zip(("left", "right"), pair, strict=True)
        for joint in limb.joints
    ]
    return signs(points), float(np.mean(name_votes))


def _agreement(tree: Tree, sources: dict[str, Source]) -> float:
    """Part of pelvis, head and the joints of the limbs whose names fit what they were taken for."""
    counted = {"pelvis", "head", "hip", "knee", "ankle", "shoulder", "elbow", "wrist"}
    checked = [
        (name.rpartition("_")[2], joint) for name, joint in sources.items() if name.rpartition("_")[2] in counted
    ]
    fits = [isinstance(joint, int) and part in tree.labels[joint].parts for part, joint in checked]
    return float(np.mean(fits))


def _sureness(margin: float, sided: float, agree: float, body: float, *, headless: bool) -> Sureness:
    if margin < MARGINS[0] or sided < 0.5 or headless:
        return "unsure"
    well_named = agree >= 0.8 and sided >= NAMES
    return "sure" if well_named or (margin >= MARGINS[1] and body >= DECISIVE) else "fairly sure"


def _doubts(sure: Sureness, names_vote: float) -> list[str]:
    doubts = []
    if names_vote < -0.5:
        doubts.append(
            "joints named left lie on the person's right, so the file seems to be mirrored: left and right are taken as "
            "feet and knees have them"
        )
    if sure == "unsure":
        doubts.append(
            "the skeleton's joints were matched with little certainty: check the report, or name the joints in a flavour file "
            "(flavour=FILE.yaml, --motion.flavour FILE.yaml)"
        )
    return doubts


def _by_name(names: tuple[str, ...], source: Source) -> str | tuple[str, str, float]:
    return names[source] if isinstance(source, int) else (names[source[0]], names[source[1]], source[2])


def _shown(source: str | tuple[str, str, float]) -> str:
    if isinstance(source, str):
        return _cut(source)
    return f"{_cut(source[0])}-{_cut(source[1])} {source[2]:.2f}"


def _cut(name: str) -> str:
    return printable(name if len(name) <= LONGEST_SHOWN else name[: LONGEST_SHOWN - 3] + "...")
