"""A skeleton as a tree of joints: what their names say, where limbs branch off, and which limbs make a pair."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from operator import attrgetter
from pathlib import Path

import numpy as np

from t2d_rt.geometry.vectors import median_length
from t2d_rt.motion.skeletons import shipped

# --- what a joint's name says: its side and the parts of the body that it may stand for ---
#
# Names are split at capitals, digits and signs, and runs of letters are cut into known words, so that `LeftUpLeg`,
# `lThighBend`, `Bip01 L Thigh`, `thigh_l`, `relbow` and `左ひざ` are all understood. One word can mean two joints (a
# `LeftShoulder` is a collar or the top of the upper arm), so a name has several parts; where the joint lies decides
# between them.


PARTS_OF_LEG = frozenset({"hip", "knee", "ankle", "foot", "toe"})
PARTS_OF_ARM = frozenset({"collar", "shoulder", "elbow", "wrist", "hand"})

RUN = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[^\W\d_a-zA-Z]+")


@dataclass(frozen=True, slots=True)
class Label:
    """What the name of a joint says."""

    side: str | None = None
    """The side, "left" or "right"; None if the name tells none."""
    parts: frozenset[str] = frozenset()
    """Canonical joints without side, and "spine", "face", "root", "twist", "helper"; empty where the name says nothing."""
    middle: bool = False
    """Whether the joint belongs to a middle finger."""


def label(name: str) -> Label:
    """Side and parts of a joint's name; end sites (`<parent>:end`) say nothing."""
    if name.endswith(":end"):
        return Label()
    plain_name = _plain(name[-80:].rpartition(":")[2])
    if re.fullmatch(r"[jJ]?[LTS]\d{1,2}([LTS]\d{1,2})?", plain_name):  # a vertebra
        return Label(parts=frozenset({"spine"}))
    if re.fullmatch(r"[jJ]?C[1-7]([CT]\d)?(Head)?", plain_name):
        return Label(parts=frozenset({"neck"}))
    kinds = [kind for run in RUN.findall(plain_name) for kind in _kinds(run.casefold())]
    sides = {kind for kind in kinds if kind in ("left", "right")}
    side = sides.pop() if len(sides) == 1 else None
    return Label(side=side, parts=_parts(set(kinds), side), middle="middle" in kinds)


def _parts(kinds: set[str], side: str | None) -> frozenset[str]:
    """Parts by the kinds of the words in a name; the rules go from the most telling kind to the least."""
    end = "end" in kinds
    if side is None and "spine" in kinds:  # Kinect's SpineShoulder
        return frozenset({"spine"})
    rules = (
        ("helper", {"helper"}),
        ("finger", {"hand"}),
        ("middle", {"hand"} if not kinds & {"spine", "neck"} else {"spine"}),
        ("face", {"face"}),
        ("toe", {"toe"} if end else {"foot", "toe"}),
        ("ankle", {"ankle"}),
        ("foot", {"foot", "toe"} if end else {"ankle", "foot"}),
        ("wrist", {"wrist"}),
        ("hand", {"hand"} if end else {"wrist", "hand"}),
        ("thigh", {"hip"}),
        ("knee", {"knee"}),
        ("leg", {"hip"} if "up" in kinds else {"knee"} if "low" in kinds else {"hip", "knee"}),
        ("elbow", {"elbow"}),
        ("upperarm", {"shoulder"}),
        ("arm", {"elbow"} if kinds & {"low", "fore"} else {"shoulder"}),
        ("clavicle", {"collar"}),
        ("shoulder", {"collar", "shoulder"}),
        ("head", {"head_top"} if kinds & {"end", "up"} else {"head"}),
        ("neck", {"neck"}),
        ("spine", {"spine"}),
        ("hip", {"hip"} if side else {"pelvis"}),
        ("pelvis", {"pelvis"} if not side else set()),
        ("root", {"root"}),
    )
    named_parts = next((parts for kind, parts in rules if kind in kinds), set[str]())
    if "twist" in kinds and named_parts <= {"hip", "knee", "shoulder", "elbow"}:
        return frozenset({"twist"}) | named_parts
    return frozenset(named_parts)


def _plain(text: str) -> str:
    """The text without accents and without the voicing marks of Japanese signs, in names and table alike."""
    spread = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    return "".join(sign for sign in spread if not unicodedata.combining(sign))


@cache
def _vocabulary() -> dict[str, str]:
    """The kind of each known word."""
    rows = shipped(Path(__file__).with_name("words.yaml"))
    return {_plain(word).casefold(): kind for kind, words in rows.items() for word in words.split()}


def _kinds(run: str) -> list[str]:
    """Kinds of the fewest known words that make up a run of letters; none where it is not made of them."""
    words = _vocabulary()
    best: list[list[str] | None] = [[], *[None] * len(run)]
    for stop in range(1, len(run) + 1):
        for start in range(max(0, stop - 20), stop):
            word, before = run[start:stop], best[start]
            # A letter is a side at either end only: every word has an l or an r somewhere.
            if (
                before is None
                or word not in words
                or (len(word) == 1 and word in "lr" and start > 0 and stop < len(run))
            ):
                continue
            now = best[stop]
            if now is None or len(before) + 1 < len(now):
                best[stop] = [*before, words[word]]
    return best[-1] or []


# --- a skeleton of unknown joints in time, with what follows from it: bone lengths, names, ancestors ---


COINCIDENT = 1e-3
"""Joints closer than this part of the skeleton's size are one point."""


@dataclass(frozen=True)
class Tree:
    """Joints with their parents (before their children) and positions in some frames."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: np.ndarray
    """Positions (T, N, 3) in any unit and axes."""

    @cached_property
    def children(self) -> list[list[int]]:
        """Children of each joint."""
        children: list[list[int]] = [[] for _ in self.names]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                children[parent].append(joint)
        return children

    @cached_property
    def labels(self) -> list[Label]:
        """What each name says."""
        return [label(name) for name in self.names]

    @cached_property
    def bones(self) -> np.ndarray:
        """Median distance of each joint from its parent, (N,)."""
        above = np.maximum(self.parents, 0)
        return np.asarray(np.median(np.linalg.norm(self.positions - self.positions[:, above], axis=-1), axis=0))

    @cached_property
    def size(self) -> float:
        """Median over the frames of the largest distance of a joint from the middle of all."""
        middle = self.positions.mean(axis=1, keepdims=True)
        return float(np.median(np.linalg.norm(self.positions - middle, axis=-1).max(axis=1)))

    def distance(self, first: int, second: int) -> float:
        """Median distance of two joints."""
        return median_length(self.positions[:, first] - self.positions[:, second])

    def together(self, first: int, second: int) -> bool:
        """Whether two joints are one point."""
        return self.distance(first, second) <= COINCIDENT * self.size

    def above(self, joint: int) -> Iterator[int]:
        """A joint and its ancestors, up to the root."""
        while joint >= 0:
            yield joint
            joint = self.parents[joint]

    def below(self, joint: int, depth: int, most: int) -> list[int]:
        """A joint and those below it, breadth first: `depth` generations and `most` joints at most."""
        joints, generation = [joint], [joint]
        for _ in range(depth):
            generation = [child for parent in generation for child in self.children[parent]]
            joints += generation
            if not generation or len(joints) >= most:
                break
        return joints[:most]

    def path(self, first: int, last: int) -> list[int]:
        """Joints from the first to the last along the bones, both included."""
        up, down = list(self.above(first)), list(self.above(last))
        shared = next(joint for joint in up if joint in set(down))
        return up[: up.index(shared) + 1] + down[: down.index(shared)][::-1]

    def middle(self, joints: Sequence[int]) -> np.ndarray:
        """Mean of some joints, (T, 3)."""
        return np.asarray(self.positions[:, list(joints)].mean(axis=1))


# --- pairs of limbs: two joints of three, one on each side of the body, with bones of equal lengths ---


BEST = 40
"""Number of limbs of each side, the likeliest ones, that are compared with those of the other."""

STRAIGHT, NEARLY_ALWAYS = 0.96, 5.0
"""Joints make one bone (with twist bones) if the distance of its ends is at least this part of the length along them, but for this
percentage of the frames: in half of the frames of a walk a whole leg is as straight."""


@dataclass(frozen=True, slots=True)
class Limb:
    """Joints of a limb: hip, knee and ankle, or shoulder, elbow and wrist."""

    upper: int
    middle: int
    lower: int
    lengths: tuple[float, float]
    score: float

    @property
    def joints(self) -> tuple[int, int, int]:
        """The three joints from the trunk outward."""
        return self.upper, self.middle, self.lower

    @property
    def length(self) -> float:
        """Length of both bones together."""
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
        """Mean length of the two limbs."""
        return 0.5 * (self.limbs[0].length + self.limbs[1].length)


def limb_pairs(tree: Tree) -> list[Pair]:
    """The likeliest pair of limbs below each two siblings, the best first: long limbs with equal bones and fitting names."""
    pairs: list[Pair] = []
    for branch, children in enumerate(tree.children):
        stems = [child for child in children if "helper" not in tree.labels[child].parts]
        if len(stems) < 2:
            continue
        limbs = {stem: stem_limbs for stem in stems if (stem_limbs := _limbs(tree, stem, branch))}
        lengths = {stem: max(limb.length for limb in candidates) for stem, candidates in limbs.items()}
        largest = sorted(limbs, key=lengths.__getitem__, reverse=True)[:12]
        for first, second in combinations(largest, 2):
            pairs += _best(tree, branch, (first, second), (limbs[first], limbs[second]))
    best: list[Pair] = []
    for pair in sorted(pairs, key=attrgetter("score"), reverse=True):
        if sum(other.branch == pair.branch for other in best) < 6:
            best.append(pair)
    return best[:24]


def _limbs(tree: Tree, stem: int, branch: int) -> list[Limb]:
    """The `BEST` likeliest limbs below a child of a branching."""
    # An arm with all fingers has 8 generations and 30 joints.
    below = [joint for joint in tree.below(stem, 14, 90) if "helper" not in tree.labels[joint].parts]
    bones = _bones(tree, below, branch)
    from_joint: dict[int, list[tuple[int, float, int]]] = {}
    for upper, lower, length, skipped in bones:
        from_joint.setdefault(upper, []).append((lower, length, skipped))
    limbs = []
    for upper, middle, thigh, over in bones:
        for lower, shank, more in from_joint.get(middle, ()):
            # Thigh to shank is 0.74 to 1.05 and upper arm to forearm 0.87 to 1.23 in recorded skeletons.
            unequal = abs(np.log(thigh / shank / 1.03))
            if unequal < np.log(2.2):
                score = float(np.log(thigh + shank) - unequal - 0.2 * (over + more))
                limbs.append(Limb(upper, middle, lower, (thigh, shank), score + _named(tree, (upper, middle, lower))))
    return sorted(limbs, key=attrgetter("score"), reverse=True)[:BEST]


def _bones(tree: Tree, joints: list[int], branch: int) -> list[tuple[int, int, float, int]]:
    """All straight stretches between joints of a limb, each as (upper, lower, length, number of joints left out)."""
    away = np.median(np.linalg.norm(tree.positions[:, joints] - tree.positions[:, [branch]], axis=-1), axis=0)
    inside = {joint for joint, far in zip(joints, away, strict=True) if far <= COINCIDENT * tree.size}
    rows, root = [], inside | set(tree.above(branch))
    for lower in joints:
        length_along, left_out, direct = tree.bones[lower], 0, True
        apart = length_along > COINCIDENT * tree.size
        for upper in tree.above(tree.parents[lower]):
            if upper in root:
                break
            if apart:  # the last of several joints in one place carries the bone
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
    return max(sum(map(_fit, limb_roles, parts)) for limb_roles in roles) / 3.0


def _fit(role: str, parts: frozenset[str]) -> float:
    return 0.0 if not parts else 1.0 if role in parts else -1.0


def _best(tree: Tree, branch: int, stems: tuple[int, int], limbs: tuple[list[Limb], list[Limb]]) -> list[Pair]:
    one, two = (np.log([limb.lengths for limb in side]) for side in limbs)
    unlike = np.abs(one[:, None] - two[None]).sum(axis=-1)
    score = 0.5 * (np.array([a.score for a in limbs[0]])[:, None] + np.array([b.score for b in limbs[1]])) - unlike
    # Converted skeletons differ by up to 25 % in one bone.
    score[unlike > 0.25] = -np.inf
    deep, deeper = (np.array([len(list(tree.above(limb.lower))) for limb in side]) for side in limbs)
    score -= 0.1 * (deep[:, None] != deeper)
    first, second = np.unravel_index(int(np.argmax(score)), score.shape)
    if not np.isfinite(score[first, second]):
        return []
    return [Pair(branch, stems, (limbs[0][first], limbs[1][second]), float(score[first, second]))]
