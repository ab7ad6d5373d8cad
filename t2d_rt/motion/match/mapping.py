"""From the person in a skeleton to the canonical joints: feet, hands, spine, neck and head."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import unit
from t2d_rt.motion.match.limbs import Limb
from t2d_rt.motion.match.person import HELP, Person, joints_of
from t2d_rt.motion.match.tree import Tree

HEAD_HEIGHT = 0.16
"""Head joint above the shoulders over thigh and shank: 0.11 to 0.21 in recorded skeletons, necks 0.01 to 0.09, vertices 0.3."""

HEAD_TOP = 0.06, 0.4
"""Vertex above the head joint, over thigh and shank."""

COLLAR = 0.2
"""Collar joint on the line from the thorax to the shoulder where the file puts it into the thorax."""

Source = int | tuple[int, int, float]
"""A joint of the file, or a point on the line from one to another that turns with the first."""

Height = Callable[[int], float]
"""Of a joint above the shoulders, along the trunk, over thigh and shank."""


def canonical_sources(tree: Tree, person: Person, sided: Sequence[tuple[Limb, Limb]]) -> dict[str, Source]:
    """Joint, or point between (or beyond) two joints, for every canonical joint that the skeleton has.

    sided: left and right leg, then left and right arm.
    """
    found: dict[str, Source] = {}
    for side, leg, arm in zip(("left", "right"), *sided, strict=True):
        beyond = _feet(tree, leg) | _hand(tree, arm)
        for name, joint in zip(
            ("hip", "knee", "ankle", "shoulder", "elbow", "wrist"), (*leg.joints, *arm.joints), strict=True
        ):
            found[f"{side}_{name}"] = joint
        for name, joint in beyond.items():
            found[f"{side}_{name}"] = joint
        collar = _collar(tree, person, arm)
        if collar is not None:
            found[f"{side}_collar"] = collar
    return found | _trunk(tree, person)


def _carrier(tree: Tree, joint: int, tip: int) -> int:
    """Of several joints in one place on the chain to a tip, the last, which carries what follows."""
    for each in tree.path(joint, tip)[1:]:
        if not tree.together(joint, each) or each == tip:
            break
        joint = each
    return joint


def _feet(tree: Tree, leg: Limb) -> dict[str, Source]:
    """Ball and tip of the foot, and the ankle that carries them."""
    ankle = tree.positions[:, leg.lower]
    shank = unit(ankle - tree.positions[:, leg.middle])
    best: tuple[float, list[int]] = (0.0, [])
    for tip in tree.below(leg.lower, 5, 40)[1:]:
        reach = tree.positions[:, tip] - ankle
        length = float(np.median(np.linalg.norm(reach, axis=-1))) / leg.length
        bent = float(np.median(np.linalg.norm(np.cross(unit(reach), shank), axis=-1)))
        chain = [joint for joint in tree.path(leg.lower, tip)[1:] if not tree.together(leg.lower, joint)]
        named = any("foot" in tree.labels[joint].parts or "toe" in tree.labels[joint].parts for joint in chain)
        # The foot stands square to the shank: what goes on along it is a heel, or the end of a bone.
        if 0.05 < length < 0.45 and (bent > 0.5 or (named and bent > 0.2)):
            value = length + 0.2 * named - 0.001 * len(chain)
            best = max(best, (value, chain), key=lambda each: each[0])
    chain = best[1]
    if not chain:
        return {}
    ball = next((j for j in chain if tree.labels[j].parts & {"foot", "toe"}), chain[0])
    found: dict[str, Source] = {"ankle": _carrier(tree, leg.lower, ball), "foot": _carrier(tree, ball, chain[-1])}
    if not tree.together(ball, chain[-1]):
        found["toe"] = chain[-1]
    return found


def _hand(tree: Tree, arm: Limb) -> dict[str, Source]:
    """The tip of the middle finger, or of the hand, and the wrist that carries it."""
    wrist = tree.positions[:, arm.lower]
    forearm = unit(wrist - tree.positions[:, arm.middle])
    best: tuple[float, int] = (0.0, -1)
    for tip in tree.below(arm.lower, 7, 60)[1:]:
        reach = tree.positions[:, tip] - wrist
        length = float(np.median(np.linalg.norm(reach, axis=-1))) / arm.length
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
    return (collar, arm.upper, COLLAR) if tree.together(person.arms.branch, collar) else collar


# --- pelvis, spine, neck and head ---


def _trunk(tree: Tree, person: Person) -> dict[str, Source]:
    hips, shoulders = (tree.middle(joints_of(pair, 0)) for pair in (person.legs, person.arms))
    up, leg = unit(shoulders - hips), person.legs.length
    trunk = float(np.median(np.linalg.norm(shoulders - hips, axis=-1)))

    def height(joint: int) -> float:
        """Above the shoulders, along the trunk, over the leg's length."""
        return float(np.median(np.sum((tree.positions[:, joint] - shoulders) * up, axis=-1))) / leg

    pelvis = _pelvis(tree, person, hips)
    found: dict[str, Source] = {"pelvis": pelvis}
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
    found |= _spine(tree, spine, {joint: 1.0 + height(joint) * leg / trunk for joint in spine})
    if neck is not None:
        found["neck"] = neck
    if head is None:
        return found | {
            "head": _made_up_head(tree, pelvis, neck if neck is not None else (spine or [pelvis])[-1], height)
        }
    found["head"] = head
    top = person.head[-1]
    if top != head and HEAD_TOP[0] < height(top) - height(head) < HEAD_TOP[1]:
        found["head_top"] = top
    return found


def _pelvis(tree: Tree, person: Person, hips: np.ndarray) -> int:
    """The joint that the legs hang from, or one above it that is named so or much nearer to the hips (3ds Max hangs them from the
    spine)."""
    branch = person.legs.branch
    away = {
        joint: float(np.median(np.linalg.norm(tree.positions[:, joint] - hips, axis=-1)))
        for joint in tree.above(branch)
    }
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
    order = range(len(chain))

    def unlike(i: int) -> float:
        """Eyes, jaw and hair branch off at a head; an end of a bone is one only if nothing else can be."""
        face = len(tree.children[chain[i]]) > 1
        last = 0 < i == len(chain) - 2 and tree.names[chain[-1]].endswith(":end")
        end = tree.names[chain[i]].endswith(":end")
        return abs(heights[i] - HEAD_HEIGHT) - 0.06 * face - 0.04 * last + 0.03 * end

    likely = min(order, key=unlike)
    at = named[0] if named else likely
    head = _carrier(tree, chain[at], chain[-1])
    before = [
        i for i in order if i < at and not tree.together(chain[i], chain[at]) and not tree.together(chain[i], base)
    ]
    if not before:
        return head, None, []
    necks = [i for i in before if "neck" in tree.labels[chain[i]].parts] or [i for i in before if heights[i] > -0.03]
    neck = necks[0] if necks else before[-1]
    return head, chain[neck], list(chain[:neck])


def _rising(tree: Tree, pelvis: int, joints: list[int], height: Height) -> list[int]:
    """Joints one above the other from the pelvis on, in different places."""
    found = [pelvis]
    for joint in joints:
        if not tree.together(found[-1], joint) and height(joint) > height(found[-1]):
            found.append(joint)
    return found[1:]


def _spine(tree: Tree, joints: list[int], along: dict[int, float]) -> dict[str, Source]:
    """Lowest, middle and highest joint of the spine; `along` is 0 at the hips and 1 at the shoulders."""
    if not joints:
        return {}
    if len(joints) == 1:
        return {"spine3" if along[joints[0]] > 0.35 else "spine1": joints[0]}
    if len(joints) == 2:
        return {"spine1": joints[0], "spine3": joints[1]}
    middle = 0.5 * (along[joints[0]] + along[joints[-1]])
    second = min(joints[1:-1], key=lambda joint: abs(along[joint] - middle))
    return {"spine1": joints[0], "spine2": second, "spine3": joints[-1]}


def _made_up_head(tree: Tree, pelvis: int, highest: int, height: Height) -> Source:
    """A point on the line of the trunk, as high as heads are."""
    low, high = height(pelvis), height(highest)
    if high - low < 0.1:
        raise InputError(f"the skeleton has nothing above its hips that could carry a head; {HELP}")
    return pelvis, highest, float((HEAD_HEIGHT - low) / (high - low))
