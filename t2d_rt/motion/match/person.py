"""The person in a skeleton: which limbs are legs, which are arms, where the head is, which side is left."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import unit
from t2d_rt.motion.match.limbs import Pair, limb_pairs
from t2d_rt.motion.match.tree import Tree
from t2d_rt.motion.match.words import PARTS_OF_ARM, PARTS_OF_LEG

LEG_PER_ARM, LEG_PER_ARM_SPREAD = 1.5, 0.22
"""Thigh and shank over upper arm and forearm, and the standard deviation of its logarithm: 1.41 to 1.91 in recorded skeletons of
adults, about 1.2 at two years."""

TRUNK_PER_LEG, TRUNK_PER_LEG_SPREAD = 0.58, 0.25
"""Hips to shoulders over thigh and shank: 0.50 to 0.67 in recorded skeletons of adults, about 0.9 at two years."""

FARTHEST = 3.5
"""Standard deviations beyond which nobody is built like that."""

UPRIGHT = 0.5
"""Cosine of the angle between trunk and legs above which somebody stands: no animal on four legs comes near."""

OFTEN = 0.2
"""Share of poses that are to be upright: animals sit, too."""

MOST_READINGS, MOST_TIPS = 8, 300
"""Readings of the limbs for which a head is sought, and joints that may be its tip."""

HEADS = frozenset({"neck", "head", "head_top"})
STRANGE = frozenset({"face", "helper", "hip", "knee", "hand", "elbow"})
"""Parts that are found on the chain to the top of a head, and that are not."""

HELP = "if it is one, name its joints in a flavour file (flavour=FILE.yaml, --motion.flavour FILE.yaml)"


@dataclass(frozen=True, slots=True)
class Person:
    """Legs, arms and head chain of a skeleton; the sides are not yet told apart."""

    legs: Pair
    arms: Pair
    head: tuple[int, ...]
    """Joints from the trunk (not included) to the tip; empty where nothing is above the shoulders."""
    score: float


def find_person(tree: Tree, rest: np.ndarray | None) -> tuple[Person, float]:
    """The likeliest person and by how much its score exceeds that of any other reading; an InputError if there is none.

    rest: positions (N, 3) with all rotations zero, where the file has them.
    """
    found = limb_pairs(tree)
    if len(found) < 2:
        what = "no two limbs of like bones" if not found else "one pair of limbs only"
        raise InputError(
            f"the skeleton of {len(tree.names)} joints has {what} where a person has two arms and two legs; {HELP}"
        )
    built = [reading for legs, arms in permutations(found, 2) if (reading := _person(tree, legs, arms)) is not None]
    readings = [_with_head(tree, each) for each in sorted(built, key=lambda each: -each.score)[:MOST_READINGS]]
    if not readings:
        raise InputError(
            f"the skeleton's limbs and trunk have no person's proportions (its largest pairs of limbs hang from "
            f"{tree.names[found[0].branch]!r:.60} and {tree.names[found[1].branch]!r:.60}); {HELP}"
        )
    best = max(readings, key=lambda each: each.score)
    _check_upright(tree, best, rest)
    others = [
        each.score for each in readings if {_tops(each.legs), _tops(each.arms)} != {_tops(best.legs), _tops(best.arms)}
    ]
    others += [each.score for each in readings if _tops(each.legs) == _tops(best.arms)]
    return best, best.score - max(others, default=-np.inf)


def _tops(pair: Pair) -> tuple[int, ...]:
    return tuple(sorted(limb.upper for limb in pair.limbs))


def joints_of(pair: Pair, place: int) -> list[int]:
    """The two upper (0), middle (1) or lower (2) joints of a pair."""
    return [limb.joints[place] for limb in pair.limbs]


def _person(tree: Tree, legs: Pair, arms: Pair) -> Person | None:
    """A reading with its score, a sum of logarithms of likelihoods; None where it cannot be."""
    stems = {*legs.stems, *arms.stems}
    if len(stems) < 4 or any(
        set(tree.above(pair.branch)) & set(other.stems) for pair, other in ((legs, arms), (arms, legs))
    ):
        return None
    hips, shoulders = tree.middle(joints_of(legs, 0)), tree.middle(joints_of(arms, 0))
    trunk = float(np.median(np.linalg.norm(shoulders - hips, axis=-1)))
    if trunk < 0.05 * legs.length:
        return None
    build = (
        np.log(legs.length / arms.length / LEG_PER_ARM) / LEG_PER_ARM_SPREAD,
        np.log(trunk / legs.length / TRUNK_PER_LEG) / TRUNK_PER_LEG_SPREAD,
    )
    if max(abs(each) for each in build) > FARTHEST:
        return None
    up = unit(shoulders - hips)
    level = [_tilt(tree, pair, up) / 0.3 for pair in (legs, arms)]
    level.append((1.0 - _parallel(tree, legs, arms)) / 0.2)  # a leg and a tail are not abreast as shoulders are
    named = _named(tree, legs, PARTS_OF_LEG, PARTS_OF_ARM) + _named(tree, arms, PARTS_OF_ARM, PARTS_OF_LEG)
    unlikely = 0.5 * sum(each * each for each in (*build, *level))
    return Person(legs, arms, (), float(legs.score + arms.score - 2.0 * np.log(tree.size) + 3.0 * named - unlikely))


def _with_head(tree: Tree, person: Person) -> Person:
    head = _head(tree, person.legs, person.arms)
    return replace(person, head=head, score=person.score + (2.0 if head else -2.0))


def _tilt(tree: Tree, pair: Pair, up: np.ndarray) -> float:
    """How far the line between the upper joints of a pair is from square to the trunk: sine of the angle, 0 to 1."""
    first, second = joints_of(pair, 0)
    across = unit(tree.positions[:, first] - tree.positions[:, second])
    return float(np.median(np.abs(np.sum(across * up, axis=-1))))


def _parallel(tree: Tree, legs: Pair, arms: Pair) -> float:
    """Cosine of the angle between the line of the hips and that of the shoulders."""
    (a, b), (c, d) = joints_of(legs, 0), joints_of(arms, 0)
    hips, shoulders = (unit(tree.positions[:, first] - tree.positions[:, second]) for first, second in ((a, b), (c, d)))
    return abs(float(np.median(np.sum(hips * shoulders, axis=-1))))


def _named(tree: Tree, pair: Pair, own: frozenset[str], other: frozenset[str]) -> float:
    """Share of a pair's joints that are named as parts of such limbs, minus that of those named as parts of others."""
    parts = [tree.labels[joint].parts for limb in pair.limbs for joint in limb.joints]
    return sum(bool(each & own) - bool(each & other) for each in parts) / len(parts)


def _head(tree: Tree, legs: Pair, arms: Pair) -> tuple[int, ...]:
    """The chain above the shoulders, from the trunk's joint (not included) to its tip."""
    shoulders = tree.middle(joints_of(arms, 0))
    up = unit(shoulders - tree.middle(joints_of(legs, 0)))
    trunk = tree.path(legs.branch, arms.branch)
    taken = {*legs.stems, *arms.stems, *trunk}
    stems = [
        (stem, child)
        for base in trunk
        for stem in tree.children[base]
        if stem not in taken
        for child in tree.below(stem, 12, 60)
    ]
    stems = stems[:MOST_TIPS]
    offsets = tree.positions[:, [tip for _, tip in stems]] - shoulders[:, None]
    heights = np.median(np.sum(offsets * up[:, None], axis=-1), axis=0) / legs.length
    asides = np.median(np.linalg.norm(np.cross(offsets, up[:, None]), axis=-1), axis=0) / legs.length
    best: tuple[float, tuple[int, ...]] = (0.0, ())
    for (stem, tip), height, aside in zip(stems, heights, asides, strict=True):
        if not (-0.05 < height < 0.8 and aside < 0.35):
            continue
        chain = tree.path(stem, tip)
        named = sum(bool(tree.labels[joint].parts & HEADS) for joint in chain)
        strange = sum(bool(tree.labels[joint].parts & STRANGE) for joint in chain)
        value = min(height, 0.45) - 0.5 * max(aside - 0.1, 0.0) + 0.3 * named - 0.5 * strange - 0.005 * len(chain)
        if value > best[0]:
            best = float(value), tuple(chain)
    return best[1]


def _check_upright(tree: Tree, person: Person, rest: np.ndarray | None) -> None:
    """Refuses what holds all four limbs square to its trunk and has limbs of one length: an animal, or a hand."""
    still = rest is not None and _upright(person, rest[None]) > 0.0
    if still or _upright(person, tree.positions) > OFTEN:
        return
    ratio = person.legs.length / person.arms.length
    trunk_m = np.linalg.norm(tree.middle(joints_of(person.arms, 0)) - tree.middle(joints_of(person.legs, 0)), axis=-1)
    long_trunk = float(np.median(trunk_m)) / person.legs.length
    if ratio < 1.2 or long_trunk > 0.9:
        raise InputError(
            f"the skeleton's four limbs are alike ({ratio:.2f} : 1, trunk {long_trunk:.2f} of a limb long), hardly upright, so "
            f"it looks like an animal or a hand, not a person; {HELP}"
        )


def _upright(person: Person, poses: np.ndarray) -> float:
    """Share of poses (T, N, 3) in which the legs go on where the trunk ends."""
    hips, ankles, shoulders = (
        poses[:, joints_of(pair, place)].mean(axis=1)
        for pair, place in ((person.legs, 0), (person.legs, 2), (person.arms, 0))
    )
    along = -np.sum(unit(ankles - hips) * unit(shoulders - hips), axis=-1)
    return float(np.mean(along > UPRIGHT))
