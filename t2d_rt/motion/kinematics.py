"""Skeletons that share one rest pose, their poses over time, and what joints tell in any pose: stature, length of legs, facing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from t2d_rt.geometry.vectors import median_length, norms, unit, vector_product
from t2d_rt.motion import quaternions
from t2d_rt.motion.interpolate import compose, decompose
from t2d_rt.motion.skeletons import PARENT_OF
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, OPTIONAL_JOINTS, Motion

# --- what joints tell in any pose: stature, length of legs, and the direction that the body faces ---


STATURE_PER_CHAIN = 1.142
"""Stature over (hip - knee - ankle) + (hips - shoulders) + (shoulders - head), of the adult template; CMU, iClone and bvh-toolbox
skeletons keep to it within 3 %."""


def stature_m(points: dict[str, np.ndarray]) -> float:
    """Stature from bone lengths, whatever the pose (+- 5 %), in the unit of the points.

    Only joints that all skeletons have in one place count: the pelvis lies up to 9 cm above the hips (CMU), and how many joints a
    spine has, and how it winds through them, differs. A sum over them is too long by 4 to 9 % in files with full spines.
    """
    shoulders = middle(points, "shoulder")
    trunk = median_length(middle(points, "hip") - shoulders) + median_length(shoulders - points["head"])
    return STATURE_PER_CHAIN * (leg_m(points) + trunk)


def leg_m(points: Mapping[str, np.ndarray]) -> float:
    """Length of thigh and shank, median in time and mean of both sides, in the unit of the points."""
    bones = [
        median_length(points[f"{side}_{lower}"] - points[f"{side}_{upper}"])
        for side in ("left", "right")
        for lower, upper in (("hip", "knee"), ("knee", "ankle"))
    ]
    return 0.5 * sum(bones)


def middle(points: Mapping[str, np.ndarray], joint: str) -> np.ndarray:
    """Track (T, 3) midway between a joint of the left side and that of the right."""
    return np.asarray(0.5 * (points[f"left_{joint}"] + points[f"right_{joint}"]))


def facing(points: dict[str, np.ndarray]) -> np.ndarray:
    """Horizontal unit vectors (T, 3) that the hips and shoulders face (z up)."""
    across = points["left_hip"] - points["right_hip"] + points["left_shoulder"] - points["right_shoulder"]
    forward = vector_product(across, np.array([0.0, 0.0, 1.0]))
    return forward / np.maximum(norms(forward), 1e-9)[..., None]


# --- skeletons that share one rest pose, so that generators can edit, blend and retarget their poses ---
#
# In the rest pose of a `Skeleton` the person stands upright, faces +x, left is +y, z up, with the arms stretched out
# sideways (a T) and every joint's frame parallel to the axes. Hips and collars are placed in the frames of pelvis and
# upper spine; every other bone lies along an axis: spine, neck and head along z, thighs and shanks along -z, arms
# along +-y. Knees and elbows bend about their own y and z axes.


LOWER_BACK = "lower_back"
"""A joint at the pelvis's own place that carries the spine: many files bend the trunk there and not at the first vertebra."""

NAMES: tuple[str, ...] = (CANONICAL_JOINTS[0], LOWER_BACK, *CANONICAL_JOINTS[1:], *OPTIONAL_JOINTS)
"""The joints of a skeleton: the canonical ones, all optional ends, and the lower back."""

INDEX: Mapping[str, int] = {name: number for number, name in enumerate(NAMES)}

PARENT_NAMES: Mapping[str, str] = {
    **{name: parent for name, parent in PARENT_OF.items() if parent},
    LOWER_BACK: "pelvis",
    "spine1": LOWER_BACK,
}

PARENTS: tuple[int, ...] = (-1, *(INDEX[PARENT_NAMES[name]] for name in NAMES[1:]))

END_LENGTHS = {"head_top": 0.115, "left_hand": 0.09, "right_hand": 0.09, "left_toe": 0.035, "right_toe": 0.035}
"""Lengths of ends that a motion lacks, over its stature, as in the adult template."""

STRAIGHT = 0.05
"""Squared sine of a knee's or an elbow's bend at which its hinge counts as much as its parent's orientation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Skeleton:
    """Bones of one person in the rest pose."""

    offsets: np.ndarray
    """Offsets (28, 3) [m] of joints from their parents in the rest pose; the pelvis's is its height over the balls of the feet."""

    def bone_m(self, name: str) -> float:
        """Length of the bone that ends at a joint [m]."""
        return float(np.linalg.norm(self.offsets[INDEX[name]]))

    @property
    def leg_m(self) -> float:
        """Length of thigh and shank [m], mean of both legs."""
        return 0.5 * sum(self.bone_m(f"{side}_{joint}") for side in ("left", "right") for joint in ("knee", "ankle"))

    def scaled(self, factor: float) -> Skeleton:
        """The skeleton with all bones scaled by a factor."""
        return replace(self, offsets=self.offsets * factor)


@dataclass(frozen=True, kw_only=True)
class Poses:
    """A skeleton in time: the root's track and each joint's rotation in its parent's frame."""

    skeleton: Skeleton
    root: np.ndarray
    """Pelvis positions [m], (T, 3)."""
    local: np.ndarray
    """Unit quaternions x, y, z, w (T, 28, 4): rotations in the parents' frames; the pelvis's is its orientation."""
    rate_hz: float

    def __len__(self) -> int:
        return len(self.root)

    def world(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (T, 28, 3) [m] and orientations (T, 28, 4) of all joints, not to be changed: forward kinematics."""
        return self._world

    @cached_property
    def _world(self) -> tuple[np.ndarray, np.ndarray]:
        offsets = np.broadcast_to(self.skeleton.offsets, (len(self), *self.skeleton.offsets.shape)).copy()
        offsets[:, 0] = self.root
        world = compose(offsets, self.local, PARENTS)
        for array in world:
            array.flags.writeable = False  # the arrays are kept for later calls
        return world

    def joint(self, name: str) -> np.ndarray:
        """Positions of a joint [m], (T, 3)."""
        return self.world()[0][:, INDEX[name]]

    def part(self, start: int, stop: int) -> Poses:
        """The poses of the frames from `start` to before `stop`."""
        return replace(self, root=self.root[start:stop], local=self.local[start:stop])


def poses_of(motion: Motion) -> Poses:
    """A motion as poses of its own skeleton; bone lengths are medians over time.

    Orientations keep the motion's twist (of forearms, head and feet): each joint's axes are turned to the skeleton's by one
    constant rotation, the mean over time of what positions show, and then so that its bone lies along its axis.
    """
    points = _with_ends(motion)
    posed = frames(points)
    recorded = {name: motion.rotations[:, motion.index(name)] for name in motion.names}
    turned = {
        name: quaternions.calibrated(recorded[name], posed[name]) if name in recorded else posed[name] for name in NAMES
    }
    turned[LOWER_BACK] = turned["pelvis"]
    turned |= {name: _aligned(name, turned[name], points) for name in _CHILD}
    for name, parent in OPTIONAL_JOINTS.items():
        turned[name] = turned[parent]
    joints = np.stack([points[name] for name in NAMES], axis=1)
    rotations = np.stack([turned[name] for name in NAMES], axis=1)
    offsets, local = decompose(joints, rotations, PARENTS)
    return Poses(
        skeleton=Skeleton(offsets=_rest_offsets(np.median(offsets, axis=0), joints)),
        root=joints[:, 0],
        local=quaternions.continuous(local),
        rate_hz=motion.rate_hz,
    )


def motion_of(poses: Poses, *, origin: tuple[str, ...] = ()) -> Motion:
    """The motion of a skeleton's poses, with all optional ends."""
    joints, rotations = poses.world()
    names = (*CANONICAL_JOINTS, *OPTIONAL_JOINTS)
    columns = [INDEX[name] for name in names]
    return Motion(
        joints=joints[:, columns],
        rotations=quaternions.continuous(quaternions.normalise(rotations[:, columns])),
        rate_hz=poses.rate_hz,
        names=names,
        parents=(*CANONICAL_PARENTS, *(names.index(name) for name in OPTIONAL_JOINTS.values())),
        placed=False,
        origin=origin,
    )


def skeleton_of(rest: Mapping[str, np.ndarray]) -> Skeleton:
    """The skeleton of a body from the rest positions (3,) [m] of all its joints, in a pose that is upright and faces +x."""
    points = {name: np.asarray(point, dtype=float)[None] for name, point in rest.items()}
    points[LOWER_BACK] = points["pelvis"]
    turned = frames(points)
    joints, rotations = (np.stack([tracks[name] for name in NAMES], axis=1) for tracks in (points, turned))
    return Skeleton(offsets=_rest_offsets(decompose(joints, rotations, PARENTS)[0][0], joints))


def retargeted(poses: Poses, skeleton: Skeleton) -> Poses:
    """The same rotations on another skeleton; the root's track is scaled by the legs' length, so that feet stay near the floor.

    Feet then slide as far as proportions differ; `contacts.plant` puts them back.
    """
    factor = _standing_m(skeleton) / _standing_m(poses.skeleton)
    return replace(poses, skeleton=skeleton, root=poses.root * factor)


def at_frames(poses: Poses, numbers: np.ndarray) -> Poses:
    """Poses at frame numbers (K,) that may lie between frames: cubic splines of root and quaternion components, C2."""
    from scipy.interpolate import make_interp_spline

    values = np.concatenate([poses.root, quaternions.continuous(poses.local).reshape(len(poses), -1)], axis=1)
    spline = make_interp_spline(np.arange(len(poses)), values, k=min(3, len(poses) - 1))
    splined = spline(np.clip(numbers, 0, len(poses) - 1))
    local = quaternions.normalise(splined[:, 3:].reshape(len(numbers), -1, 4))
    return replace(poses, root=splined[:, :3], local=local)


def frames(points: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Orientations (T, 4) of all joints from positions (T, 3) alone: bones lie along their axes by the least rotation, hinges of
    knees and elbows follow from the plane of a bent limb, and all else turns with its parent.
    """
    across_hips = points["left_hip"] - points["right_hip"]
    across_shoulders = points["left_shoulder"] - points["right_shoulder"]
    spine = ("pelvis", "spine1", "spine2", "spine3")
    orientations: dict[str, np.ndarray] = {}
    for number, (name, above) in enumerate(zip(spine, (*spine[1:], "neck"), strict=True)):
        left = unit(across_hips) * (1 - number / 3) + unit(across_shoulders) * (number / 3)
        orientations[name] = axes_along("z", points[above] - points[name], "y", left)
    orientations[LOWER_BACK] = orientations["pelvis"]
    orientations["neck"] = _swung(orientations["spine3"], [0.0, 0.0, 1.0], points["head"] - points["neck"])
    orientations["head"] = _swung(orientations["neck"], [0.0, 0.0, 1.0], points["head_top"] - points["head"])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        _arm(orientations, points, side, sign)
        _leg(orientations, points, side)
    for name, parent in OPTIONAL_JOINTS.items():
        orientations[name] = orientations[parent]
    return orientations


_CHILD = {
    LOWER_BACK: ("spine1", "z", 1.0), "spine1": ("spine2", "z", 1.0), "spine2": ("spine3", "z", 1.0),
    "neck": ("head", "z", 1.0), "head": ("head_top", "z", 1.0),
    **{
        f"{side}_{joint}": (f"{side}_{child}", axis, sign * factor)
        for side, sign in (("left", 1.0), ("right", -1.0))
        for joint, child, axis, factor in (
            ("collar", "shoulder", "y", 1.0), ("shoulder", "elbow", "y", 1.0), ("elbow", "wrist", "y", 1.0),
            ("wrist", "hand", "y", 1.0), ("hip", "knee", "z", -sign), ("knee", "ankle", "z", -sign),
        )
    },
}  # fmt: skip
"""Joints whose bone lies along an axis: the joint at its end, the axis and the sign."""


def _arm(orientations: dict[str, np.ndarray], points: Mapping[str, np.ndarray], side: str, sign: float) -> None:
    along = [0.0, sign, 0.0]
    shoulder, elbow, wrist, hand = (points[f"{side}_{name}"] for name in ("shoulder", "elbow", "wrist", "hand"))
    orientations[f"{side}_collar"] = _swung(orientations["spine3"], along, shoulder - points[f"{side}_collar"])
    upper, fore = elbow - shoulder, wrist - elbow
    straight = _swung(orientations[f"{side}_collar"], along, upper)
    # A bent elbow brings the forearm towards +x of the rest pose: about -z on the left, +z on the right.
    hinge = _hinge(straight, [0.0, 0.0, 1.0], -sign * np.cross(unit(upper), unit(fore)))
    orientations[f"{side}_shoulder"] = axes_along("y", sign * upper, "z", hinge)
    orientations[f"{side}_elbow"] = axes_along("y", sign * fore, "z", hinge)
    orientations[f"{side}_wrist"] = _swung(orientations[f"{side}_elbow"], along, hand - wrist)


def _leg(orientations: dict[str, np.ndarray], points: Mapping[str, np.ndarray], side: str) -> None:
    hip, knee, ankle, foot, toe = (points[f"{side}_{name}"] for name in ("hip", "knee", "ankle", "foot", "toe"))
    thigh, shank, sole = knee - hip, ankle - knee, foot - ankle
    straight = _swung(orientations["pelvis"], [0.0, 0.0, -1.0], thigh)
    # The hinge of a straight leg is perpendicular to the plane of shank and foot, which is surer than the pelvis's axis.
    level = _hinge(straight, [0.0, 1.0, 0.0], np.cross(unit(sole), unit(shank)))
    hinge = _hinge(axes_along("z", -thigh, "y", level), [0.0, 1.0, 0.0], np.cross(unit(thigh), unit(shank)))
    orientations[f"{side}_hip"] = axes_along("z", -thigh, "y", hinge)
    orientations[f"{side}_knee"] = axes_along("z", -shank, "y", hinge)
    # The x axis of the sole is level while the foot stands; the bone itself falls by a constant angle.
    orientations[f"{side}_ankle"] = axes_along("x", _levelled(ankle, foot, hinge), "y", hinge)
    orientations[f"{side}_foot"] = axes_along("x", toe - foot, "y", hinge)


def _levelled(ankle: np.ndarray, ball: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """Direction (T, 3) from ankle to ball, turned about the hinge by the angle at which the bone falls while the foot stands."""
    sole = ball - ankle
    standing = ankle[:, 2] <= np.percentile(ankle[:, 2], 25)  # the heel is down, and with it the whole foot
    direction, axis = unit(sole), unit(hinge)
    half = 0.5 * np.arcsin(np.clip(np.median(direction[standing, 2]), -1.0, 1.0))
    lift = np.concatenate([np.sin(half) * axis, np.full((*axis.shape[:-1], 1), np.cos(half))], axis=-1)
    return quaternions.rotate(lift, direction)


def _hinge(guess: np.ndarray, axis: list[float], normal: np.ndarray) -> np.ndarray:
    """Axis (T, 3) of a hinge: the `normal` (T, 3) of a bent limb, and the axis of the guessed frame (T, 4) of a straight one."""
    expected = quaternions.rotate(guess, np.array(axis))
    sine2 = (normal**2).sum(-1, keepdims=True)
    # A knee bent the wrong way is a straight one with noise, at which the hinge must not turn over.
    agrees = np.clip((normal * expected).sum(-1, keepdims=True) / np.maximum(np.sqrt(sine2), 1e-9), 0.0, 1.0)
    weight = agrees * sine2 / (sine2 + STRAIGHT)
    return (1 - weight) * expected + weight * unit(normal)


def axes_along(first: str, along: np.ndarray, second: str, towards: np.ndarray) -> np.ndarray:
    """Orientations (T, 4) whose axis `first` lies along a direction and whose axis `second` lies towards another, both (T, 3)."""
    a = unit(along)
    b = unit(towards - (towards * a).sum(-1, keepdims=True) * a)
    columns = {first: a, second: b}
    (third,) = set("xyz") - set(columns)
    x, y = (("y", "z"), ("z", "x"), ("x", "y"))["xyz".index(third)]
    columns[third] = vector_product(columns[x], columns[y])
    return quaternions.from_matrix(np.stack([columns[axis] for axis in "xyz"], axis=-1))


def _swung(parent: np.ndarray, axis: list[float], bone: np.ndarray) -> np.ndarray:
    """The parent's orientation (T, 4), turned by the least rotation that lays `axis` along the bone (T, 3)."""
    return quaternions.multiply(quaternions.between(quaternions.rotate(parent, np.array(axis)), bone), parent)


def _aligned(name: str, rotation: np.ndarray, points: Mapping[str, np.ndarray]) -> np.ndarray:
    """Orientations (T, 4) turned by the least rotation that lays the joint's axis along its bone."""
    child, axis, sign = _CHILD[name]
    direction = sign * np.eye(3)["xyz".index(axis)]
    return _swung(rotation, direction.tolist(), points[child] - points[name])


def _rest_offsets(offsets: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Offsets (28, 3) [m] with each bone of `_CHILD` exactly along its axis and the pelvis at its height over the feet."""
    rest = offsets.copy()
    for name, (child, axis, sign) in _CHILD.items():
        length = np.median(np.linalg.norm(joints[:, INDEX[child]] - joints[:, INDEX[name]], axis=-1))
        rest[INDEX[child]] = sign * length * np.eye(3)["xyz".index(axis)]
    rest[0] = 0.0
    rest[0, 2] = _standing_m(Skeleton(offsets=rest))
    return rest


def _standing_m(skeleton: Skeleton) -> float:
    """Height of the pelvis over the balls of the feet in the rest pose [m]."""
    joints = "hip", "knee", "ankle", "foot"
    legs = [sum(skeleton.offsets[INDEX[f"{side}_{joint}"], 2] for joint in joints) for side in ("left", "right")]
    return -float(np.mean(legs))


def _with_ends(motion: Motion) -> dict[str, np.ndarray]:
    """Positions (T, 3) of all 28 joints by name; ends that the motion lacks continue the bone before them, toes the level sole."""

    points = {name: motion.joints[:, index] for index, name in enumerate(motion.names)}
    tall = stature_m(points)
    before = {"head_top": "neck", "left_hand": "left_elbow", "right_hand": "right_elbow"}
    for name, parent in OPTIONAL_JOINTS.items():
        if name in points:
            continue
        if name in before:
            along = points[parent] - points[before[name]]
        else:  # toes: ahead of the ball of the foot, in the foot's own frame level while it stands
            side = name.split("_")[0]
            ankle, ball = points[f"{side}_ankle"], points[parent]
            shank = ankle - points[f"{side}_knee"]
            along = _levelled(ankle, ball, np.cross(ball - ankle, shank))
        points[name] = points[parent] + END_LENGTHS[name] * tall * unit(along)
    points[LOWER_BACK] = points["pelvis"]
    return points
