"""Find a person among the joints of a skeleton by names and form, tell left from right, and map joints to canonical ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations
from operator import attrgetter, itemgetter

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import median_length, unit
from t2d_rt.motion.match.skeleton_tree import PARTS_OF_ARM, PARTS_OF_LEG, Limb, Pair, Tree, limb_pairs

# --- the person in a skeleton: which limbs are legs, which are arms, where the head is, which side is left ---


FARTHEST = 3.5
"""Standard deviations from usual proportions beyond which nobody is built."""

OFTEN = 0.2
"""Part of the poses that must be upright, because animals sit up too."""

HEADS = frozenset({"neck", "head", "head_top"})
STRANGE = frozenset({"face", "helper", "hip", "knee", "hand", "elbow"})
"""Parts of the body that are on the chain to the top of a head, and parts that are not."""

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
    """The likeliest person, and by how much its score exceeds that of any other reading; raises an InputError if there is none.

    rest: positions (N, 3) with all rotations zero, where the file has them.
    """
    pairs = limb_pairs(tree)
    if len(pairs) < 2:
        what = "no two limbs of like bones" if not pairs else "one pair of limbs only"
        raise InputError(
            f"the skeleton of {len(tree.names)} joints has {what} where a person has two arms and two legs; {HELP}"
        )
    persons = [person for legs, arms in permutations(pairs, 2) if (person := _person(tree, legs, arms)) is not None]
    readings = [_with_head(tree, body) for body in sorted(persons, key=attrgetter("score"), reverse=True)[:8]]
    if not readings:
        raise InputError(
            f"the skeleton's limbs and trunk have no person's proportions (its largest pairs of limbs hang from "
            f"{tree.names[pairs[0].branch]!r:.60} and {tree.names[pairs[1].branch]!r:.60}); {HELP}"
        )
    best = max(readings, key=attrgetter("score"))
    _check_upright(tree, best, rest)
    others = [
        body.score for body in readings if {_tops(body.legs), _tops(body.arms)} != {_tops(best.legs), _tops(best.arms)}
    ]
    others += [body.score for body in readings if _tops(body.legs) == _tops(best.arms)]
    return best, best.score - max(others, default=-np.inf)


def _tops(pair: Pair) -> tuple[int, ...]:
    return tuple(sorted(limb.upper for limb in pair.limbs))


def joints_of(pair: Pair, place: int) -> list[int]:
    """The two upper (0), middle (1) or lower (2) joints of a pair."""
    return [limb.joints[place] for limb in pair.limbs]


def _person(tree: Tree, legs: Pair, arms: Pair) -> Person | None:
    """A reading of the skeleton with its score, a sum of logarithms of likelihoods; None if it is impossible."""
    stems = {*legs.stems, *arms.stems}
    if len(stems) < 4 or any(
        set(tree.above(pair.branch)) & set(other.stems) for pair, other in ((legs, arms), (arms, legs))
    ):
        return None
    hips, shoulders = tree.middle(joints_of(legs, 0)), tree.middle(joints_of(arms, 0))
    trunk = median_length(shoulders - hips)
    if trunk < 0.05 * legs.length:
        return None
    # Adults' legs are 1.41 to 1.91 arms long in recorded skeletons, at two years about 1.2, and trunks 0.50 to 0.67
    # legs, at two years about 0.9: a mean and the standard deviation of the logarithm.
    build = (
        np.log(legs.length / arms.length / 1.5) / 0.22,
        np.log(trunk / legs.length / 0.58) / 0.25,
    )
    if max(abs(deviation) for deviation in build) > FARTHEST:
        return None
    up = unit(shoulders - hips)
    level = [_tilt(tree, pair, up) / 0.3 for pair in (legs, arms)]
    level.append((1.0 - _parallel(tree, legs, arms)) / 0.2)  # a leg and a tail are not abreast as shoulders are
    named = _named(tree, legs, PARTS_OF_LEG, PARTS_OF_ARM) + _named(tree, arms, PARTS_OF_ARM, PARTS_OF_LEG)
    unlikely = 0.5 * sum(deviation * deviation for deviation in (*build, *level))
    return Person(legs, arms, (), float(legs.score + arms.score - 2.0 * np.log(tree.size) + 3.0 * named - unlikely))


def _with_head(tree: Tree, person: Person) -> Person:
    head = _head_of(tree, person.legs, person.arms)
    return replace(person, head=head, score=person.score + (2.0 if head else -2.0))


def _tilt(tree: Tree, pair: Pair, up: np.ndarray) -> float:
    """Sine, 0 to 1, of the angle by which the line between the upper joints of a pair is not perpendicular to the trunk."""
    first, second = joints_of(pair, 0)
    across = unit(tree.positions[:, first] - tree.positions[:, second])
    return float(np.median(np.abs(np.sum(across * up, axis=-1))))


def _parallel(tree: Tree, legs: Pair, arms: Pair) -> float:
    """Cosine of the angle between the line of the hips and that of the shoulders."""
    (a, b), (c, d) = joints_of(legs, 0), joints_of(arms, 0)
    hips, shoulders = (unit(tree.positions[:, first] - tree.positions[:, second]) for first, second in ((a, b), (c, d)))
    return abs(float(np.median(np.sum(hips * shoulders, axis=-1))))


def _named(tree: Tree, pair: Pair, own_parts: frozenset[str], other_parts: frozenset[str]) -> float:
    """Part of a pair's joints that are named as parts of such limbs, minus the part that are named as parts of others."""
    parts = [tree.labels[joint].parts for limb in pair.limbs for joint in limb.joints]
    return sum(bool(part & own_parts) - bool(part & other_parts) for part in parts) / len(parts)


def _head_of(tree: Tree, legs: Pair, arms: Pair) -> tuple[int, ...]:
    """The chain above the shoulders, from the trunk's joint (not included) to its tip."""
    shoulders = tree.middle(joints_of(arms, 0))
    up = unit(shoulders - tree.middle(joints_of(legs, 0)))
    trunk = tree.path(legs.branch, arms.branch)
    excluded = {*legs.stems, *arms.stems, *trunk}
    stems = [
        (stem, child)
        for base in trunk
        for stem in tree.children[base]
        if stem not in excluded
        for child in tree.below(stem, 12, 60)
    ]
    stems = stems[:300]
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
    """Raises an InputError for a body that is hardly ever upright and has equal limbs or a long trunk: an animal or a hand."""
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
    """Part of the poses (T, N, 3) in which the legs continue the line of the trunk."""
    hips, ankles, shoulders = (
        poses[:, joints_of(pair, place)].mean(axis=1)
        for pair, place in ((person.legs, 0), (person.legs, 2), (person.arms, 0))
    )
    along = -np.sum(unit(ankles - hips) * unit(shoulders - hips), axis=-1)
    # No animal on four legs comes near that cosine.
    return float(np.mean(along > 0.5))


# --- left or right: from where feet point, how knees and elbows bend, how the body moves, and from names ---


DECISIVE = 1.6
"""Sum of the signs of the body above which names do not count: more than feet or knees alone can give."""

NAMES = 1.2
"""Weight of the votes of names."""


def signs(points: dict[str, np.ndarray]) -> dict[str, float]:
    """Votes of feet, knees, elbows and walk for the sides that canonical points (T, 3) are named by, positive if what is called
    left lies on the left; units are arbitrary, and so are axes as long as they are right-handed."""
    pairs = {
        joint: (points[f"left_{joint}"], points[f"right_{joint}"]) for joint in ("hip", "knee", "ankle", "shoulder")
    }
    hips, shoulders = (0.5 * (pairs[joint][0] + pairs[joint][1]) for joint in ("hip", "shoulder"))
    up = unit(shoulders - hips)
    across = sum(pairs[joint][0] - pairs[joint][1] for joint in ("hip", "shoulder"))
    forward = unit(np.cross(across, up))
    leg = median_length(pairs["hip"][0] - pairs["knee"][0]) * 2.0

    feet = [points[f"{side}_foot"] - points[f"{side}_ankle"] for side in ("left", "right") if f"{side}_foot" in points]
    knees = _bends(points, ("hip", "knee", "ankle"))
    elbows = _bends(points, ("shoulder", "elbow", "wrist"))
    moved = hips[1:] - hips[:-1]
    # Feet point and knees bend forward in nearly every frame; elbows bend backward, but not of arms that are held out;
    # people walk forward as a rule.
    return {
        "feet": 1.5 * _vote(feet, forward, 0.05 * leg),
        "knees": 1.5 * _vote(knees, forward, 0.02 * leg),
        "elbows": -0.5 * _vote(elbows, forward, 0.02 * leg),
        "walk": 0.6 * _vote([moved], forward[1:], 0.02 * leg),
    }


def _bends(points: dict[str, np.ndarray], joints: tuple[str, str, str]) -> list[np.ndarray]:
    """Vectors (T, 3) from the straight line of a limb to its middle joint, for the left and the right side."""
    offsets = []
    for side in ("left", "right"):
        upper, middle, lower = (points[f"{side}_{joint}"] for joint in joints)
        along = unit(lower - upper)
        offset = middle - upper
        offsets.append(offset - np.sum(offset * along, axis=-1, keepdims=True) * along)
    return offsets


def _vote(vectors: list[np.ndarray], forward: np.ndarray, least: float) -> float:
    """Mean forward part of vectors, -1 to 1; it is less in proportion if they are shorter than `least` on average."""
    if not vectors:
        return 0.0
    lengths = np.linalg.norm(vectors, axis=-1)
    ahead = float(np.sum(np.asarray(vectors) * forward))
    return ahead / max(float(lengths.sum()), least * lengths.size, 1e-300)


# --- from the person in a skeleton to the canonical joints: feet, hands, spine, neck and head ---


HEAD_HEIGHT = 0.16
"""Height of the head's joint above the shoulders over thigh and shank: 0.11 to 0.21 in recorded skeletons (neck 0.01 to 0.09,
vertex 0.3)."""

HEAD_TOP = 0.06, 0.4
"""Least and greatest height of the vertex above the head's joint, over thigh and shank."""

Source = int | tuple[int, int, float]
"""A joint of the file, or a point on the line from one to another that turns with the first."""

Height = Callable[[int], float]
"""Gives the height of a joint above the shoulders, along the trunk, over thigh and shank."""


def canonical_sources(tree: Tree, person: Person, sided: Sequence[tuple[Limb, Limb]]) -> dict[str, Source]:
    """Joint, or point between (or beyond) two joints, for every canonical joint that the skeleton has.

    sided: left and right leg, then left and right arm.
    """
    sources: dict[str, Source] = {}
    for side, leg, arm in zip(("left", "right"), *sided, strict=True):
        names = "hip", "knee", "ankle", "shoulder", "elbow", "wrist"
        limb_joints = dict(zip(names, (*leg.joints, *arm.joints), strict=True)) | _feet(tree, leg) | _hand(tree, arm)
        sources |= {f"{side}_{name}": joint for name, joint in limb_joints.items()}
        collar = _collar(tree, person, arm)
        if collar is not None:
            sources[f"{side}_collar"] = collar
    return sources | _trunk(tree, person)


def _carrier(tree: Tree, joint: int, tip: int) -> int:
    """The last of several joints in one place on the chain to a tip, which carries what follows."""
    for following in tree.path(joint, tip)[1:]:
        if not tree.together(joint, following) or following == tip:
            break
        joint = following
    return joint


def _feet(tree: Tree, leg: Limb) -> dict[str, Source]:
    """Ball and tip of the foot, and the ankle that carries them."""
    ankle = tree.positions[:, leg.lower]
    shank = unit(ankle - tree.positions[:, leg.middle])
    best: tuple[float, list[int]] = (0.0, [])
    for tip in tree.below(leg.lower, 5, 40)[1:]:
        reach = tree.positions[:, tip] - ankle
        length = median_length(reach) / leg.length
        bent = median_length(np.cross(unit(reach), shank))
        chain = [joint for joint in tree.path(leg.lower, tip)[1:] if not tree.together(leg.lower, joint)]
        named = any("foot" in tree.labels[joint].parts or "toe" in tree.labels[joint].parts for joint in chain)
        # The foot is perpendicular to the shank: a chain along the shank is a heel, or the end of a bone.
        if 0.05 < length < 0.45 and (bent > 0.5 or (named and bent > 0.2)):
            value = length + 0.2 * named - 0.001 * len(chain)
            best = max(best, (value, chain), key=itemgetter(0))
    chain = best[1]
    if not chain:
        return {}
    ball = next((j for j in chain if tree.labels[j].parts & {"foot", "toe"}), chain[0])
    sources: dict[str, Source] = {"ankle": _carrier(tree, leg.lower, ball), "foot": _carrier(tree, ball, chain[-1])}
    if not tree.together(ball, chain[-1]):
        sources["toe"] = chain[-1]
    return sources


def _hand(tree: Tree, arm: Limb) -> dict[str, Source]:
    """The tip of the middle finger, or of the hand, and the wrist that carries it."""
    wrist = tree.positions[:, arm.lower]
    forearm = unit(wrist - tree.positions[:, arm.middle])
    best: tuple[float, int] = (0.0, -1)
    for tip in tree.below(arm.lower, 7, 60)[1:]:
        reach = tree.positions[:, tip] - wrist
        length = median_length(reach) / arm.length
        along = float(np.median(np.sum(unit(reach) * forearm, axis=-1)))
        middle = any(tree.labels[joint].middle for joint in tree.path(arm.lower, tip))
        if 0.04 < length < 0.5 and along > 0.3 and "helper" not in tree.labels[tip].parts:
            best = max(best, (length * along + 0.5 * middle, tip))
    return {} if best[1] < 0 else {"wrist": _carrier(tree, arm.lower, best[1]), "hand": best[1]}


def _collar(tree: Tree, person: Person, arm: Limb) -> Source | None:
    chain = tree.path(person.arms.branch, arm.upper)[1:-1]
    between = [joint for joint in chain if not tree.together(joint, arm.upper)]
    if not between:
        return None
    collar = next((joint for joint in between if "collar" in tree.labels[joint].parts), between[-1])
    return (collar, arm.upper, 0.2) if tree.together(person.arms.branch, collar) else collar


# --- pelvis, spine, neck and head ---


def _trunk(tree: Tree, person: Person) -> dict[str, Source]:
    hips, shoulders = (tree.middle(joints_of(pair, 0)) for pair in (person.legs, person.arms))
    up, leg = unit(shoulders - hips), person.legs.length
    trunk = median_length(shoulders - hips)
    height = partial(_height, tree, shoulders, up, leg)
    pelvis = _pelvis(tree, person, hips)
    sources: dict[str, Source] = {"pelvis": pelvis}
    spine = [joint for joint in tree.path(pelvis, person.arms.branch) if not tree.together(pelvis, joint)]
    head, neck, above = _head(tree, person.head, person.arms.branch, height)
    if (
        neck is None
        and spine
        and (
            "neck" in tree.labels[spine[-1]].parts
            or (height(spine[-1]) > -0.02 and "spine" not in tree.labels[spine[-1]].parts)
        )
    ):
        neck = spine.pop()
    spine = _rising(tree, pelvis, [*spine, *above], height)
    sources |= _spine(spine, {joint: 1.0 + height(joint) * leg / trunk for joint in spine})
    if neck is not None:
        sources["neck"] = neck
    if head is None:
        return sources | {"head": _made_up_head(pelvis, neck if neck is not None else (spine or [pelvis])[-1], height)}
    sources["head"] = head
    top = person.head[-1]
    if top != head and HEAD_TOP[0] < height(top) - height(head) < HEAD_TOP[1]:
        sources["head_top"] = top
    return sources


def _height(tree: Tree, shoulders: np.ndarray, up: np.ndarray, leg: float, joint: int) -> float:
    """Height of a joint above the shoulders, along the trunk, over the leg's length."""
    return float(np.median(np.sum((tree.positions[:, joint] - shoulders) * up, axis=-1))) / leg


def _pelvis(tree: Tree, person: Person, hips: np.ndarray) -> int:
    """The joint that the legs hang from, or one above it that is named so or much nearer to the hips (3ds Max hangs them from the
    spine)."""
    branch = person.legs.branch
    away = {joint: median_length(tree.positions[:, joint] - hips) for joint in tree.above(branch)}
    near = [joint for joint in away if away[joint] < 0.3 * person.legs.length]
    named = [joint for joint in near if "pelvis" in tree.labels[joint].parts]
    nearer = [joint for joint in near if away[joint] < 0.7 * away[branch]]
    return (named or nearer or [branch])[0]


def _head(tree: Tree, chain: tuple[int, ...], base: int, height: Height) -> tuple[int | None, int | None, list[int]]:
    """Head joint, neck joint, and joints of the chain below the neck."""
    if not chain:
        return None, None, []
    named = [i for i, joint in enumerate(chain) if "head" in tree.labels[joint].parts]
    heights = [height(joint) for joint in chain]
    unlike = []
    for i, joint in enumerate(chain):
        # Eyes, jaw and hair branch off at a head; an end of a bone is one only if nothing else can be.
        face = len(tree.children[joint]) > 1
        last = 0 < i == len(chain) - 2 and tree.names[chain[-1]].endswith(":end")
        end = tree.names[joint].endswith(":end")
        unlike.append(abs(heights[i] - HEAD_HEIGHT) - 0.06 * face - 0.04 * last + 0.03 * end)
    at = named[0] if named else unlike.index(min(unlike))
    head = _carrier(tree, chain[at], chain[-1])
    before = [i for i in range(at) if not any(tree.together(chain[i], other) for other in (chain[at], base))]
    if not before:
        return head, None, []
    necks = [i for i in before if "neck" in tree.labels[chain[i]].parts] or [i for i in before if heights[i] > -0.03]
    neck = necks[0] if necks else before[-1]
    return head, chain[neck], list(chain[:neck])


def _rising(tree: Tree, pelvis: int, joints: list[int], height: Height) -> list[int]:
    """Joints one above the other from the pelvis on, in different places."""
    rising = [pelvis]
    for joint in joints:
        if not tree.together(rising[-1], joint) and height(joint) > height(rising[-1]):
            rising.append(joint)
    return rising[1:]


def _spine(joints: list[int], along: dict[int, float]) -> dict[str, Source]:
    """Lowest, middle and highest joint of the spine; `along` is 0 at the hips and 1 at the shoulders."""
    if not joints:
        return {}
    if len(joints) == 1:
        return {"spine3" if along[joints[0]] > 0.35 else "spine1": joints[0]}
    if len(joints) == 2:
        return {"spine1": joints[0], "spine3": joints[1]}
    middle = 0.5 * (along[joints[0]] + along[joints[-1]])
    away = {joint: abs(along[joint] - middle) for joint in joints[1:-1]}
    return {"spine1": joints[0], "spine2": min(away, key=away.__getitem__), "spine3": joints[-1]}


def _made_up_head(pelvis: int, highest: int, height: Height) -> Source:
    """A point on the line of the trunk at the usual height of a head; raises an InputError if nothing could carry it."""
    low, high = height(pelvis), height(highest)
    if high - low < 0.1:
        raise InputError(f"the skeleton has nothing above its hips that could carry a head; {HELP}")
    return pelvis, highest, float((HEAD_HEIGHT - low) / (high - low))
