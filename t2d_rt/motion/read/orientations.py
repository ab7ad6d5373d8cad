"""Find the orientations of bones from joint positions alone, and make motions of such positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, check_shape, listed
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import inner, norms, unit, vector_product
from t2d_rt.motion import quaternions
from t2d_rt.motion.quaternions import about_axis, between, conjugate, from_matrix, multiply, rotate
from t2d_rt.motion.skeletons import PARENT_OF, parents_of
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion, checked_rate

# --- orientations of bones from joint positions alone ---
#
# Positions fix two of a bone's three angles. The third, the twist about the bone, is seen where a knee or an elbow is
# bent: the joint's hinge is perpendicular to the plane of the bones above and below. Near a straight limb that plane
# is lost in the errors of the joints, so that the twist follows from the nearest instants at which the limb is bent,
# or from the trunk if there are none. Pelvis and chest turn with the lines of hips and shoulders; feet and the head
# follow shank and neck except for the swing of their own bone.


SHORTEST_M = 1e-9
"""Bones that are shorter have no direction."""

LEG_REST = np.array([0.35, 0.0, -0.94])
ARM_REST = np.array([0.51, 0.61, -0.61])
"""Directions (ahead, left, up) of a thigh and of a left upper arm from which the twist is counted. At half a turn the least swing
is undefined, and no thigh or arm reaches the directions opposite to these two."""

STRAIGHT_WEIGHT = 0.03
"""(sine of the bend)^2 at which the hinge counts as much as the neutral twist: 10 degrees. Joint centres of recordings err by about
1 cm, which at 10 degrees and bones of 0.3 m turns the plane by 11 degrees."""

FOOT_WEIGHT = 0.05
"""Weight of the foot's direction as a sign of the leg's twist, beside that of the knee's bend, which is (sine of the bend)^2."""

TRUNK_WEIGHT = 0.02
"""Weight, per frame, that pulls a clip's neutral twist towards none against the trunk."""

TWIST_TIME_S = 0.15
"""Time over which the twist of a straight limb is smoothed [s]; for a limb bent by 90 degrees it is a sixth of that."""

SWING_STIFFNESS = 0.01
"""Weight of steady twist against least swing, for bones without a hinge: it counts from 90 degrees of swing on."""


def orientations_from_positions(points: dict[str, np.ndarray], rate_hz: float) -> dict[str, np.ndarray]:
    """Global orientations x, y, z, w (T, 4) by joint from positions (T, 3) [m], z up, of all canonical joints.

    In a bone's own frame the bone keeps its direction over the whole motion. Raises an InputError if joints coincide.
    """
    _check_lengths(points)
    turned = _trunk(points, rate_hz)
    for side in ("left", "right"):
        mirror = np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])
        hip, knee, ankle, foot, toe = (f"{side}_{name}" for name in ("hip", "knee", "ankle", "foot", "toe"))
        collar, shoulder, elbow, wrist, hand = (
            f"{side}_{name}" for name in ("collar", "shoulder", "elbow", "wrist", "hand")
        )
        ahead = points[foot] - points[ankle]
        thigh, shank = unit(points[knee] - points[hip]), unit(points[ankle] - points[knee])
        # A foot points to where its knee bends: the perpendicular to it, turned from the shank to the thigh, is another hinge.
        foot_hinge = rotate(between(shank, thigh), vector_product(unit(ahead), shank))
        turned[hip], turned[knee] = _limb(
            turned["pelvis"], LEG_REST * mirror, (thigh, shank), vector_product(thigh, shank), rate_hz, foot_hinge
        )
        turned[ankle] = _carried(turned[knee], ahead, rate_hz)
        turned[foot] = _carried(turned[ankle], points[toe] - points[foot], rate_hz) if toe in points else turned[ankle]
        turned[collar] = _carried(turned["spine3"], points[shoulder] - points[collar], rate_hz)
        arm, forearm = unit(points[elbow] - points[shoulder]), unit(points[wrist] - points[elbow])
        turned[shoulder], turned[elbow] = _limb(
            turned["spine3"], ARM_REST * mirror, (arm, forearm), vector_product(forearm, arm), rate_hz
        )
        turned[wrist] = (
            _carried(turned[elbow], points[hand] - points[wrist], rate_hz) if hand in points else turned[elbow]
        )
    for name in points:
        if name not in turned:
            turned[name] = turned[str(PARENT_OF[name])]
    return {name: turned[name] for name in points}


def _check_lengths(points: dict[str, np.ndarray]) -> None:
    bones = [(str(PARENT_OF[child]), child) for child in points if PARENT_OF[child] not in (None, "pelvis")]
    bones = [pair for pair in bones if "collar" not in pair[1]]  # the chest has its direction from the neck
    for upper, lower in [("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"), *bones]:
        if not (norms(points[lower] - points[upper]) > SHORTEST_M).all():
            raise InputError(f"joints {upper!r} and {lower!r} coincide; a bone needs a length to have a direction")


def _trunk(points: dict[str, np.ndarray], rate_hz: float) -> dict[str, np.ndarray]:
    hips, shoulders = (unit(points[f"left_{joint}"] - points[f"right_{joint}"]) for joint in ("hip", "shoulder"))
    middle = 0.5 * (points["left_hip"] + points["right_hip"])
    first, upward = _orthonormal(hips, points["spine1"] - middle)
    turned = {"pelvis": from_matrix(np.stack([vector_product(first, upward), first, upward], axis=-1))}
    for step, (name, above) in enumerate((("spine1", "spine2"), ("spine2", "spine3"), ("spine3", "neck")), 1):
        upward, left = _orthonormal(points[above] - points[name], (3 - step) * hips + step * shoulders)
        turned[name] = from_matrix(np.stack([vector_product(left, upward), left, upward], axis=-1))
    turned["neck"] = _carried(turned["spine3"], points["head"] - points["neck"], rate_hz)
    top = points.get("head_top")
    turned["head"] = turned["neck"] if top is None else _carried(turned["neck"], top - points["head"], rate_hz)
    return turned


def _limb(
    trunk: np.ndarray,
    rest: np.ndarray,
    bones: tuple[np.ndarray, np.ndarray],
    hinge: np.ndarray,
    rate_hz: float,
    second: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Orientations (T, 4) of a limb's upper and of its lower bone.

    bones: unit directions (T, 3) of both.
    hinge: axis (T, 3) of the bend, to the body's left where the limb hangs; its length is the sine of the bend.
    second: another estimate of that axis; its length is the sine of the angle that it is found from.
    """
    rest, (upper, lower) = unit(rest), bones
    swung = multiply(between(rotate(trunk, rest), upper), trunk)
    neutral = rotate(swung, rotate(between(np.array([0.0, 0.0, -1.0]), rest), np.array([0.0, 1.0, 0.0])))
    angle, weight = _angle_about(upper, neutral, hinge), inner(hinge, hinge)
    if second is not None:
        angle, weight = _joined(
            angle, weight, _angle_about(upper, neutral, second), FOOT_WEIGHT * inner(second, second)
        )
    above = multiply(about_axis(upper, _smooth_angle(angle, weight, rate_hz)), swung)
    return above, multiply(between(upper, lower), above)


def _joined(
    angle: np.ndarray, weight: np.ndarray, other: np.ndarray, other_weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean of two angles (T,), the second freed of its constant difference from the first where both are known."""
    both = weight * other_weight
    difference = np.angle((both * np.exp(1j * (other - angle))).sum() + TRUNK_WEIGHT * FOOT_WEIGHT * len(angle))
    total = weight * np.exp(1j * angle) + other_weight * np.exp(1j * (other - difference))
    return np.angle(total), weight + other_weight


def _smooth_angle(angle: np.ndarray, weight: np.ndarray, rate_hz: float) -> np.ndarray:
    """Angles (T,) that follow the given ones by their weights, and one neutral angle where there is no weight.

    They minimise sum w (a - angle)^2 + w0 (a - neutral)^2 + w0 tau^2 a'^2, w0 = STRAIGHT_WEIGHT, tau = TWIST_TIME_S.
    """
    # A hinge that points to the other side is the error of a straight limb: elbows and knees do not bend backwards. The
    # angle has no weight where it jumps from half a turn to minus half a turn.
    weight = weight * np.cos(angle / 2) ** 2
    neutral = np.angle((weight * np.exp(1j * angle)).sum() + TRUNK_WEIGHT * len(angle))
    stiffness = STRAIGHT_WEIGHT * (TWIST_TIME_S * rate_hz) ** 2
    return _steadied(weight + STRAIGHT_WEIGHT, weight * angle + STRAIGHT_WEIGHT * neutral, stiffness)


def _steadied(weight: np.ndarray, pull: np.ndarray, stiffness: float) -> np.ndarray:
    """The track a (T,) that minimises the sum of weight a^2 - 2 pull a + stiffness (steps of a)^2: a tridiagonal system."""
    from scipy.linalg import solveh_banded

    diagonal = weight + stiffness * np.r_[1.0, np.full(len(weight) - 2, 2.0), 1.0]
    return np.asarray(solveh_banded(np.stack([np.full(len(weight), -stiffness), diagonal]), pull))


def _angle_about(axis: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Angle (T,) about unit axes by which `start` turns to `end` (T, 3), as seen along the axis."""
    along = inner(start, axis) * inner(end, axis)
    return np.arctan2(inner(vector_product(start, end), axis), inner(start, end) - along)


def _carried(above: np.ndarray, bone: np.ndarray, rate_hz: float) -> np.ndarray:
    """Orientations (T, 4) that follow those of the bone above, except for the least swing that carries `bone` (T, 3).

    The swing counts from the bone's usual direction. Near half a turn from there, where the least swing turns over (as at a joint
    that a recording flips), the bone goes on without twist instead.
    """
    local = unit(rotate(conjugate(above), bone))
    mean = local.mean(axis=0)
    usual = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 1e-3 else local[0]
    swung = between(np.broadcast_to(usual, local.shape), local)
    step = multiply(swung[1:], conjugate(swung[:-1]))
    twist = np.angle(np.exp(2j * np.arctan2(inner(step[:, :3], local[:-1]), step[:, 3])))
    return multiply(above, multiply(about_axis(local, _counter(twist, local @ usual, rate_hz)), swung))


def _counter(twist: np.ndarray, cosine: np.ndarray, rate_hz: float) -> np.ndarray:
    """Angles (T,) that undo steps of twist (T - 1,) where the swing, whose `cosine` (T,) is given, is large.

    They minimise sum w a^2 + SWING_STIFFNESS tau^2 (a' + twist')^2, w = cos(swing / 2)^8, tau = TWIST_TIME_S.
    """
    weight = (0.5 + 0.5 * cosine) ** 4
    stiffness = SWING_STIFFNESS * (TWIST_TIME_S * rate_hz) ** 2
    return _steadied(weight, stiffness * (np.r_[twist, 0.0] - np.r_[0.0, twist]), stiffness)


def _orthonormal(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Perpendicular unit vectors (T, 3), one along `first` and one towards `second`."""
    a = unit(first)
    return a, unit(second - inner(second, a)[..., None] * a)


# --- joint positions alone -> `Motion` ---


def motion_from_joints(
    joints: np.ndarray,
    *,
    rate_hz: float,
    names: Sequence[str] = CANONICAL_JOINTS,
    placed: bool | None = None,
    report: str = "",
) -> Motion:
    """A motion from positions alone: joints (T, J, 3) [m], z up, canonical `names` in any order.

    placed: True where the positions are those of the radar's world and stay as they are; False where `simulate` is to place the
        motion before the radar; left out, it does so with a warning.

    Orientations follow the bones; the twist about a bone, which positions do not show, comes from its neighbours: from the plane
    of a bent knee or elbow, from the foot, from the lines of hips and shoulders. Raises an InputError for wrong names or shapes.
    """
    names = listed("names", names, str, "a list of joint names")
    missing = [name for name in CANONICAL_JOINTS if name not in names]
    unknown = [name for name in names if name not in PARENT_OF]
    if missing or unknown or len(set(names)) != len(names):
        raise InputError(f"names must be the canonical joints, each once; missing {missing}, unknown {unknown}")
    joints = array("joints", joints, limit=LARGEST_M, unit="m", hint="repair the tracks first")
    check_shape("joints", joints, ("time >= 2", len(names), 3), hint="give one place for each of the names")
    if len(joints) < 2:
        raise InputError(f"joints must have shape (time >= 2, {len(names)}, 3), got {joints.shape}")
    points = {name: joints[:, names.index(name)] for name in PARENT_OF if name in names}
    return replace(
        assemble(points, orientations_from_positions(points, checked_rate(rate_hz)), rate_hz, 0.0, report),
        placed=placed,
    )


def assemble(
    points: dict[str, np.ndarray], orientations: dict[str, np.ndarray], rate_hz: float, floor_m: float, report: str = ""
) -> Motion:
    """A motion of positions (T, 3) [m] and orientations (T, 4) by canonical name, moved so that the floor is at z = 0."""
    names = tuple(name for name in PARENT_OF if name in points)
    joints = np.stack([points[name] for name in names], axis=1) - np.array([0.0, 0.0, floor_m])
    rotations = quaternions.continuous(np.stack([orientations[name] for name in names], axis=1))
    return Motion(
        joints=joints,
        rotations=rotations,
        rate_hz=rate_hz,
        names=names,
        parents=parents_of(names),
        placed=False,
        report=report,
    )
