"""Pairs of limbs: two joints of three, one on each side of the body, with bones of equal lengths."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from t2d_rt.motion.match.tree import COINCIDENT, Tree

DEPTH, MOST = 14, 90
"""Generations and joints below a branching that are looked at: an arm with all fingers has 8 and 30."""

MOST_STEMS = 12
"""Children of one joint that are paired with one another, those with the largest limbs."""

MOST_OF_BRANCH, MOST_PAIRS = 6, 24
"""Pairs that are kept, of one branching and in all."""

BEST = 40
"""Triples of each side that are compared with those of the other."""

STRAIGHT, NEARLY_ALWAYS = 0.96, 5.0
"""A bone may be made of several joints (twist bones) if they lie on a line, but for some per cent of the frames: at the median
of a walk a whole leg does."""

UPPER_PER_LOWER, RATIO_LIMIT = 1.03, 2.2
"""Thigh to shank is 0.74 to 1.05 and upper arm to forearm 0.87 to 1.23 in recorded skeletons."""

SKIPPED = 0.2
"""Loss of score for a joint inside a bone that is no twist bone by its name; twice that where others branch off."""

UNEVEN = 0.1
"""Loss of score where the two ends are not equally many joints from the root."""

SIDES_ALIKE = 0.25
"""Sum of the logarithms of the ratios of left to right lengths: converted skeletons differ by up to 25 % in one bone."""


@dataclass(frozen=True, slots=True)
class Limb:
    """Hip, knee, ankle or shoulder, elbow, wrist."""

    upper: int
    middle: int
    lower: int
    lengths: tuple[float, float]
    score: float

    @property
    def joints(self) -> tuple[int, int, int]:
        """From the trunk outward."""
        return self.upper, self.middle, self.lower

    @property
    def length(self) -> float:
        """Of both bones."""
        return sum(self.lengths)


@dataclass(frozen=True, slots=True)
class Pair:
    """Two limbs that branch off at one joint."""

    branch: int
    stems: tuple[int, int]
    """Children of the branching that the limbs hang from."""
    limbs: tuple[Limb, Limb]
    score: float

    @property
    def length(self) -> float:
        """Mean of the two sides."""
        return 0.5 * (self.limbs[0].length + self.limbs[1].length)


def limb_pairs(tree: Tree) -> list[Pair]:
    """The likeliest pair of limbs for each two siblings that have one, the best first: long, with bones alike, and named so."""
    pairs: list[Pair] = []
    for branch, children in enumerate(tree.children):
        stems = [child for child in children if "helper" not in tree.labels[child].parts]
        if len(stems) < 2:
            continue
        limbs = {stem: found for stem in stems if (found := _limbs(tree, stem, branch))}
        largest = sorted(limbs, key=lambda stem: -max(limb.length for limb in limbs[stem]))[:MOST_STEMS]
        for first, second in combinations(largest, 2):
            pairs += _best(tree, branch, (first, second), (limbs[first], limbs[second]))
    best: list[Pair] = []
    for pair in sorted(pairs, key=lambda pair: -pair.score):
        if sum(other.branch == pair.branch for other in best) < MOST_OF_BRANCH:
            best.append(pair)
    return best[:MOST_PAIRS]


def _limbs(tree: Tree, stem: int, branch: int) -> list[Limb]:
    """The BEST likely limbs below a child of a branching."""
    below = [joint for joint in tree.below(stem, DEPTH, MOST) if "helper" not in tree.labels[joint].parts]
    bones = _bones(tree, below, branch)
    from_joint: dict[int, list[tuple[int, float, int]]] = {}
    for upper, lower, length, skipped in bones:
        from_joint.setdefault(upper, []).append((lower, length, skipped))
    found = []
    for upper, middle, thigh, over in bones:
        for lower, shank, more in from_joint.get(middle, ()):
            unequal = abs(np.log(thigh / shank / UPPER_PER_LOWER))
            if unequal < np.log(RATIO_LIMIT):
                score = float(np.log(thigh + shank) - unequal - SKIPPED * (over + more))
                found.append(Limb(upper, middle, lower, (thigh, shank), score + _named(tree, (upper, middle, lower))))
    return sorted(found, key=lambda limb: -limb.score)[:BEST]


def _bones(tree: Tree, joints: list[int], branch: int) -> list[tuple[int, int, float, int]]:
    """(upper, lower, length, joints left out) of all straight stretches between joints of a limb."""
    away = np.median(np.linalg.norm(tree.positions[:, joints] - tree.positions[:, [branch]], axis=-1), axis=0)
    inside = {joint for joint, far in zip(joints, away, strict=True) if far <= COINCIDENT * tree.size}
    rows, root = [], inside | set(tree.above(branch))
    for lower in joints:
        length_along, left_out, direct = tree.bones[lower], 0, True
        apart = length_along > COINCIDENT * tree.size
        for upper in tree.above(tree.parents[lower]):
            if upper in root:
                break
            if apart:  # of several joints in one place the last carries the bone
                rows.append((upper, lower, length_along, left_out, direct))
            apart = bool(tree.bones[upper] > COINCIDENT * tree.size)
            direct = direct and not apart
            if apart and "twist" not in tree.labels[upper].parts:
                left_out += min(len(tree.children[upper]), 2)  # fingers branch off at a wrist, not inside a bone
            length_along += tree.bones[upper]
    if not rows:
        return []
    ends = [[row[end] for row in rows] for end in (0, 1)]
    distances = np.linalg.norm(tree.positions[:, ends[0]] - tree.positions[:, ends[1]], axis=-1)
    length, shortest = np.percentile(distances, [50.0, NEARLY_ALWAYS], axis=0)
    return [
        (upper, lower, float(length[i]), left_out)
        for i, (upper, lower, length_along, left_out, direct) in enumerate(rows)
        if length[i] > 10 * COINCIDENT * tree.size and (direct or shortest[i] > STRAIGHT * length_along)
    ]


def _named(tree: Tree, joints: tuple[int, int, int]) -> float:
    """How well names fit the places in a leg or, if better, in an arm: -1 to 1."""
    parts = [tree.labels[joint].parts for joint in joints]
    roles = (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))
    return max(sum(_fit(role, own) for role, own in zip(each, parts, strict=True)) for each in roles) / 3.0


def _fit(role: str, parts: frozenset[str]) -> float:
    return 0.0 if not parts else 1.0 if role in parts else -1.0


def _best(tree: Tree, branch: int, stems: tuple[int, int], limbs: tuple[list[Limb], list[Limb]]) -> list[Pair]:
    one, two = (np.log([limb.lengths for limb in side]) for side in limbs)
    unlike = np.abs(one[:, None] - two[None]).sum(axis=-1)
    score = 0.5 * (np.array([a.score for a in limbs[0]])[:, None] + np.array([b.score for b in limbs[1]])) - unlike
    score[unlike > SIDES_ALIKE] = -np.inf
    deep, deeper = (np.array([len(list(tree.above(limb.lower))) for limb in side]) for side in limbs)
    score -= UNEVEN * (deep[:, None] != deeper)
    first, second = np.unravel_index(int(np.argmax(score)), score.shape)
    if not np.isfinite(score[first, second]):
        return []
    return [Pair(branch, stems, (limbs[0][first], limbs[1][second]), float(score[first, second]))]
