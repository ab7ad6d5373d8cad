"""The body that falls: its anatomy, its model in the physics engine, and poses of a motion as those of the model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError, install
from t2d_rt.geometry.vectors import unit, vector_product
from t2d_rt.motion import quaternions
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, Motion

# --- anatomical frames of a motion's segments: x left, y up, z forward on trunk and head; -y along each limb's bone ---
#
# They are the frames of the CMU humanoid. A motion's own rotations have any zero, so a constant rotation per joint
# leads from one to the other, found over the whole motion: bones lie along -y, knees and elbows flex about x, pelvis
# and chest follow hip and shoulder line, the head looks on average where the chest faces, soles are level while they
# stand.


UP = np.array([0.0, 0.0, 1.0])
SIDES = ("left", "right")

STRAIGHT_LIMB = 0.02
"""Weight of "not twisted against its parent" beside the hinge: (sine of the bend)^2 at which both count alike."""

STANDING_MPS = 0.25
"""Speed of the ankle below which a foot stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Anatomy:
    """Frames of the segments of one motion."""

    frames: np.ndarray
    """Frames (22, 3, 3) of the canonical joints in their rotations' own axes: segment = rotation @ frame."""
    ankle_height_m: tuple[float, float]
    """Heights of the left and of the right ankle over the sole."""

    def segments(self, rotations: np.ndarray) -> np.ndarray:
        """Orientations (T, 22, 3, 3) of the segments, from a motion's rotations (T, J, 4)."""
        return matrices(rotations[:, : len(CANONICAL_JOINTS)]) @ self.frames

    def rotations(self, segments: np.ndarray) -> np.ndarray:
        """The rotations (T, 22, 4) of segments (T, 22, 3, 3): inverse of `segments`."""
        return quaternions.from_matrix(segments @ np.swapaxes(self.frames, -1, -2))


def matrices(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    columns = [quaternions.rotate(quaternion, np.broadcast_to(axis, quaternion[..., :3].shape)) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def frame(*, x: np.ndarray | None = None, y: np.ndarray, near_x: np.ndarray | None = None) -> np.ndarray:
    """Right-handed frames (..., 3, 3) with columns x, y, z: `x` exact and y near it, or y exact and x near `near_x`."""
    if x is not None:
        first = unit(x)
        second = unit(y - np.sum(y * first, axis=-1, keepdims=True) * first)
    else:
        assert near_x is not None, "one of x and near_x is given"
        second = unit(y)
        first = unit(near_x - np.sum(near_x * second, axis=-1, keepdims=True) * second)
    return np.stack([first, second, vector_product(first, second)], axis=-1)


def mean_rotation(rotations: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) nearest to the weighted means of rotations (T, ..., 3, 3)."""
    left, _, right = np.linalg.svd(np.tensordot(weights, rotations, axes=1))
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return np.asarray(left @ right)


def swing(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Smallest rotations (..., 3, 3) that turn one direction (..., 3) into another."""
    return matrices(quaternions.between(*np.broadcast_arrays(start, end)))


def anatomy(motion: Motion) -> Anatomy:
    """The frames of a motion's segments."""
    at = {name: motion.joints[:, i] for i, name in enumerate(motion.names)}
    axes = dict(zip(CANONICAL_JOINTS, np.moveaxis(matrices(motion.rotations[:, :22]), 1, 0), strict=True))
    frames = _trunk(at, axes)
    heights = []
    for side in SIDES:
        _limbs(side, at, axes, frames)
        heights.append(_foot(side, motion, at, axes, frames))
    return Anatomy(
        frames=np.stack([frames[name] for name in CANONICAL_JOINTS]), ankle_height_m=(heights[0], heights[1])
    )


def _local(rotation: np.ndarray, vectors: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Mean (3,) of vectors (T, 3) in a joint's own axes."""
    local = np.einsum("tji,tj->ti", rotation, vectors)
    return np.asarray(local.mean(0) if weights is None else weights @ local)


def _trunk(at: dict[str, np.ndarray], axes: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    middle = {joint: (at[f"left_{joint}"] + at[f"right_{joint}"]) / 2 for joint in ("hip", "shoulder")}
    torso = unit(middle["shoulder"] - middle["hip"])
    # Upright instants show what an unbent back is.
    upright = np.clip(torso[:, 2], 0.02, 1) ** 4
    upright /= upright.sum()
    frames = {}
    for joint, pair in (("pelvis", "hip"), ("spine3", "shoulder")):
        across = unit(at[f"left_{pair}"] - at[f"right_{pair}"])
        frames[joint] = frame(x=_local(axes[joint], across, upright), y=_local(axes[joint], torso, upright))
    pelvis, chest = axes["pelvis"] @ frames["pelvis"], axes["spine3"] @ frames["spine3"]
    between = mean_rotation(np.stack([pelvis, chest]), np.array([0.5, 0.5]))
    for joint in ("spine1", "spine2"):
        frames[joint] = mean_rotation(np.swapaxes(axes[joint], -1, -2) @ between, upright)
    ahead = np.where((upright * len(upright) > 0.1)[:, None], chest[..., 2] * [1, 1, 0], chest[..., 2])
    level = frame(x=chest[..., 0], y=np.cross(ahead, chest[..., 0]))
    for joint in ("neck", "head"):
        frames[joint] = mean_rotation(np.swapaxes(axes[joint], -1, -2) @ (chest if joint == "neck" else level), upright)
    for side in SIDES:
        frames[f"{side}_collar"] = mean_rotation(np.swapaxes(axes[f"{side}_collar"], -1, -2) @ chest, upright)
    return frames


def _limbs(side: str, at: dict[str, np.ndarray], axes: dict[str, np.ndarray], frames: dict[str, np.ndarray]) -> None:
    # Where the hinge cannot be seen in a straight limb, x is that of the trunk turned along with the limb from its rest direction.
    # The palm faces down where the arm is held out: its elbow flexes forward and up.
    out = 1.0 if side == "left" else -1.0
    for trunk, names, bone, hinge in (
        ("pelvis", ("hip", "knee", "ankle"), np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])),
        ("spine3", ("shoulder", "elbow", "wrist"), np.array([out, 0.0, 0.0]), out * np.array([0.0, -0.866, 0.5])),
    ):
        a, b, c = (f"{side}_{name}" for name in names)
        bend = np.cross(unit(at[b] - at[a]), unit(at[c] - at[b]))
        bend *= np.linalg.norm(bend, axis=1, keepdims=True)
        parent = axes[trunk] @ frames[trunk]
        for name, along in ((a, at[b] - at[a]), (b, at[c] - at[b])):
            untwisted = np.einsum("tij,j->ti", swing(parent @ bone, along) @ parent, hinge)
            frames[name] = frame(
                y=_local(axes[name], -unit(along)), near_x=_local(axes[name], bend + STRAIGHT_LIMB * untwisted)
            )
            parent = axes[name] @ frames[name]
            hinge, bone = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
        if trunk == "spine3":
            frames[c] = _hand(side, at, axes[c], parent)


def _hand(side: str, at: dict[str, np.ndarray], axes: np.ndarray, forearm: np.ndarray) -> np.ndarray:
    """Frame (3, 3) of a hand, on average not twisted against the forearm, and along its bone if the motion has it."""
    straight = mean_rotation(np.swapaxes(axes, -1, -2) @ forearm, np.ones(len(forearm)))
    if f"{side}_hand" not in at:
        return straight
    along = _local(axes, unit(at[f"{side}_hand"] - at[f"{side}_wrist"]))
    return np.asarray(swing(-straight[:, 1], along) @ straight)


def standing(motion: Motion, side: str) -> np.ndarray:
    """Whether a foot stands (T,): its ankle is slow, and ankle or ball is about as low as it gets."""
    ankle, foot = (motion.joints[:, motion.index(f"{side}_{joint}")] for joint in ("ankle", "foot"))
    speed = np.linalg.norm(np.gradient(ankle, 1 / motion.rate_hz, axis=0), axis=1)
    # The ankle of a foot that stands rises over its ball before the toes leave.
    low = np.minimum(ankle[:, 2] - np.quantile(ankle[:, 2], 0.05), foot[:, 2] - np.quantile(foot[:, 2], 0.05))
    return np.asarray((speed < max(STANDING_MPS, float(np.quantile(speed, 0.1)))) & (low < 0.04))


def _foot(
    side: str, motion: Motion, at: dict[str, np.ndarray], axes: dict[str, np.ndarray], frames: dict[str, np.ndarray]
) -> float:
    """Adds the frames of a foot, with a level sole, and returns the ankle's height over the sole [m]."""
    ankle, foot = f"{side}_ankle", f"{side}_foot"
    bone = at[foot] - at[ankle]
    stands = standing(motion, side) & (np.abs(unit(bone)[:, 2]) < 0.75)
    if stands.sum() < 3:
        stands = np.ones(len(bone), dtype=bool)
        shank = axes[f"{side}_knee"] @ frames[f"{side}_knee"]
        level = frame(y=-bone, near_x=shank[..., 0])
        height_m = 0.044 * float(np.median(np.linalg.norm(at[ankle] - at[f"{side}_knee"], axis=1))) / 0.246
    else:
        level = frame(y=-bone * [1, 1, 0], near_x=np.cross(UP, -bone) * -1.0)
        height_m = float(np.median(at[ankle][stands, 2]))
    weights = np.full(int(stands.sum()), 1 / stands.sum())
    for joint in (ankle, foot):
        frames[joint] = mean_rotation(np.swapaxes(axes[joint][stands], -1, -2) @ level[stands], weights)
    return float(np.clip(height_m, 0.035, 0.13))


PARENTS = dict(zip(CANONICAL_JOINTS, CANONICAL_PARENTS, strict=True))


# --- between segments of a motion and the humanoid's coordinates ---


def coordinates(body: Humanoid, root_m: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Coordinates qpos (T, nq) of the poses with the pelvis at `root_m` (T, 3) nearest to `segments` (T, 22, 3, 3).

    Inverse kinematics in closed form: the relative rotation of each joint is written as Euler angles about its hinges, of which
    those that it lacks are left out.
    """
    qpos = np.zeros((len(root_m), body.model.nq))
    qpos[:, :3] = root_m
    qpos[:, 3:7] = np.roll(quaternions.continuous(quaternions.from_matrix(segments[:, 0])), 1, axis=-1)
    for name, parent in PARENTS.items():
        if parent >= 0:
            relative = np.swapaxes(segments[:, parent], -1, -2) @ segments[:, CANONICAL_JOINTS.index(name)]
            qpos[:, body.hinges[name]] = hinge_angles(body, name, relative)
    return qpos


def hinge_angles(body: Humanoid, name: str, relative: np.ndarray) -> np.ndarray:
    """Angles (T, hinges) of a joint whose segment has the orientations `relative` (T, 3, 3) in its parent's frame."""
    axes, m = body.axes[name], body.rest[name].T @ relative
    if len(axes) == 3:
        angles = euler(m, axes)
    elif len(axes) == 2:  # the axis that the joint lacks goes between them, so that both hinges count alike
        (missing_axis,) = set("ZYX") - set(axes)
        angles = euler(m, axes[0] + missing_axis + axes[1])[:, [0, 2]]
    else:  # a knee, an elbow or the toes: about x
        angles = np.arctan2(m[:, 2, 1] - m[:, 1, 2], m[:, 1, 1] + m[:, 2, 2])[:, None]
    return np.unwrap(angles, axis=0)


def euler(matrix: np.ndarray, axes: str) -> np.ndarray:
    """Angles (T, 3) of rotations (T, 3, 3) = R_a R_b R_c about three different axes, as "ZYX"; |b| <= 90 degrees."""
    i, j, k = ("XYZ".index(axis) for axis in axes)
    sign = 1.0 if (i, j, k) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1.0
    first = np.arctan2(-sign * matrix[:, j, k], matrix[:, k, k])
    second = np.arcsin(np.clip(sign * matrix[:, i, k], -1.0, 1.0))
    third = np.arctan2(-sign * matrix[:, i, j], matrix[:, i, i])
    return np.stack([first, second, third], axis=-1)


def reached(body: Humanoid, qpos: np.ndarray) -> np.ndarray:
    """Segments (T, 22, 3, 3) of coordinates (T, nq): the model's forward kinematics."""
    segments = np.empty((len(qpos), len(CANONICAL_JOINTS), 3, 3))
    segments[:, 0] = matrices(np.roll(qpos[:, 3:7], -1, axis=-1))
    for number, (name, parent) in enumerate(PARENTS.items()):
        if parent < 0:
            continue
        turned = np.broadcast_to(body.rest[name], (len(qpos), 3, 3))
        for axis, hinge in zip(body.axes[name], body.hinges[name], strict=True):
            turned = turned @ matrices(quaternions.about_axis(np.eye(3)["XYZ".index(axis)], qpos[:, hinge]))
        segments[:, number] = segments[:, parent] @ turned
    return segments


def velocities(qpos: np.ndarray, rate_hz: float) -> np.ndarray:
    """Velocities qvel (nv,) at the middle of five or more poses (2 n + 1, nq), by a parabola through them."""
    n = len(qpos) // 2
    times = np.arange(-n, n + 1) / rate_hz
    slope = np.polynomial.polynomial.polyfit(times, qpos, 2)[1]
    w, x, y, z = qpos[n, 3:7]
    rate = np.polynomial.polynomial.polyfit(times, qpos[:, 3:7], 2)[1]
    # MuJoCo has a free body's angular velocity in its own axes: 2 q* q'.
    spin = 2.0 * quaternions.multiply(np.array([-x, -y, -z, w]), np.roll(rate, -1))
    return np.concatenate([slope[:3], spin[:3], slope[7:]])


def skeleton(root_m: np.ndarray, segments: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Joints (T, J, 3) of a skeleton with constant `offsets` (J, 3) in the parents' segments (T, J, 3, 3)."""
    joints = np.empty((len(root_m), len(offsets), 3))
    joints[:, 0] = root_m
    for joint, parent in enumerate(CANONICAL_PARENTS):
        if parent >= 0:
            joints[:, joint] = joints[:, parent] + segments[:, parent] @ offsets[joint]
    return joints


# --- the CMU humanoid of dm_control, fitted to one person: bones as long as the motion's, girth by stature, mass as given ---
#
# Its tree, joints, muscles, contacts and masses are in humanoid.xml, whose head says what differs from the original.


FILE = Path(__file__).with_name("humanoid.xml")

OF_TRUNK = "pelvis root, spine1 lowerback, spine2 upperback, spine3 thorax, neck lowerneck, head head"
OF_LIMBS = "collar clavicle, shoulder humerus, elbow radius, wrist hand, hip femur, knee tibia, ankle foot, foot toes"
BODIES: dict[str, str] = dict(pair.split() for pair in OF_TRUNK.split(", ")) | {
    f"{side}_{joint}": side[0] + body
    for side in SIDES
    for joint, body in (pair.split() for pair in OF_LIMBS.split(", "))
}
"""For each canonical joint: the body of the humanoid that turns about it."""

STEP_S = 1 / 720
STEPS_PER_FRAME = 6
RATE_HZ = 1 / (STEP_S * STEPS_PER_FRAME)
"""Frame rate of simulated falls: 120 Hz."""

STATURE_M = 1.72
"""Stature of the original humanoid."""

FOOT_M = 0.022
"""Radius of the capsules and spheres of its feet: their lowest points lie in the plane of the sole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Humanoid:
    """A compiled model of MuJoCo, and the places of its parts."""

    model: Any
    """The model, a `mujoco.MjModel`."""
    hinges: dict[str, tuple[int, ...]]
    """Positions in qpos of each canonical joint's hinges, in the order z, y, x that the model applies them in."""
    rest: dict[str, np.ndarray]
    """Rotation (3, 3) of each canonical joint's body in its parent's frame when its hinges are at 0."""
    axes: dict[str, str]
    """Axes of the hinges of each canonical joint, letters of "ZYX" in that order."""
    floor: int
    """Number of the floor's geom."""

    @property
    def bodies(self) -> np.ndarray:
        """Numbers of the bodies of the 22 canonical joints."""
        return np.array([self.model.body(BODIES[name]).id for name in CANONICAL_JOINTS])

    def body_of(self, geom: int) -> str:
        """Name of the body that a geom belongs to."""
        return str(self.model.body(int(self.model.geom_bodyid[geom])).name)


def mujoco() -> Any:
    """The module mujoco; raises an InputError that says how to install it."""
    try:
        import mujoco as module
    except ImportError:
        raise InputError(f"falls by physics need MuJoCo, which is not installed; {install('falls')}") from None
    return module


ON_GRID = 9
"""Decimals to which what a simulation begins with is rounded, in SI units: a fall multiplies the last bit of a sine or a product,
which is another on the next machine, into millimetres and more."""


def on_grid(values: Any) -> np.ndarray:
    """Numbers rounded to `ON_GRID` decimals, so that falls begin with the same bits on all machines, but at a rounding's edge."""
    return np.round(np.asarray(values, dtype=float), ON_GRID)


def humanoid(
    offsets: np.ndarray,
    ankle_height_m: tuple[float, float],
    *,
    stature_m: float,
    mass_kg: float,
    apart: tuple[tuple[str, str], ...] = (),
) -> Humanoid:
    """The humanoid with `offsets` (22, 3) from each canonical joint's parent, in the parent segment's frame [m].

    Pairs of bodies `apart` do not collide with each other.
    """
    spec = mujoco().MjSpec.from_file(str(FILE))
    spec.option.timestep = STEP_S
    for first, second in apart:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    at, scale = dict(zip(CANONICAL_JOINTS, on_grid(offsets), strict=True)), float(on_grid(stature_m / STATURE_M))
    _stretch(spec, at, on_grid(ankle_height_m), scale)
    model = spec.compile()
    # Masses of the segments by their fractions of the body's; inertia as the geoms' volumes have it.
    fractions = model.body_user[:, 0]
    ratio = on_grid(mass_kg * fractions / fractions.sum() / np.where(model.body_mass > 0, model.body_mass, 1.0))
    model.body_mass[:] *= ratio
    model.body_inertia[:] *= ratio[:, None]
    mujoco().mj_setConst(model, mujoco().MjData(model))
    return _indexed(model)


def _stretch(spec: Any, at: dict[str, np.ndarray], ankle_height_m: np.ndarray, scale: float) -> None:
    """Moves bodies to the motion's joints, makes geoms as long as the bones and as thick as the stature asks for, levels soles."""
    lengths = {}
    for name, parent in PARENTS.items():
        if parent >= 0:
            # The wrist's hinges belong to two bodies, of which the upper one lies at the end of the forearm.
            body = spec.body(BODIES[name]).parent if "wrist" in name else spec.body(BODIES[name])
            above = CANONICAL_JOINTS[parent]
            ratio = np.linalg.norm(at[name]) / max(float(np.linalg.norm(body.pos)), 1e-6)
            lengths[BODIES[above]] = float(on_grid(ratio))
            body.pos = at[name]
    limbs = {side + bone for side in "lr" for bone in ("femur", "tibia", "humerus", "radius")}
    for body in spec.bodies[1:]:  # the first is the world
        along = lengths[body.name] if body.name in limbs else scale
        for geom in body.geoms:
            geom.pos = np.asarray(geom.pos) * along
            geom.size = np.asarray(geom.size) * [scale, along, scale]
    # The trunk's lowest capsule is placed from between the hips.
    pelvis = spec.geom("root_geom")
    pelvis.pos = np.asarray(pelvis.pos) + 0.5 * (at["left_hip"] + at["right_hip"])
    for side, height_m in zip(SIDES, ankle_height_m, strict=True):
        ball = at[f"{side}_foot"]
        middle = FOOT_M * scale - height_m
        for name, aside in ((f"{side[0]}foot", -0.02), (f"{side[0]}foot_ch", 0.02)):
            heel = [aside * scale, 0.045 * scale, middle]
            spec.geom(name).fromto = [*heel, 1.5 * aside * scale, ball[1], middle]
        for geom in spec.body(f"{side[0]}toes").geoms:
            geom.pos = [*geom.pos[:2], middle - ball[2]]


def _indexed(model: Any) -> Humanoid:
    hinges, rest, axes = {}, {}, {}
    for name, parent in PARENTS.items():
        if parent < 0:
            continue
        body, above = model.body(BODIES[name]).id, model.body(BODIES[CANONICAL_JOINTS[parent]]).id
        turned = np.eye(3)
        joints: list[int] = []
        while body != above:
            # Bodies between two canonical joints (the wrist's) carry hinges of the same joint.
            first, count = model.body_jntadr[body], model.body_jntnum[body]
            joints = [int(first + i) for i in range(count)] + joints
            matrix = np.zeros(9)
            mujoco().mju_quat2Mat(matrix, model.body_quat[body])
            turned = matrix.reshape(3, 3) @ turned
            body = int(model.body_parentid[body])
        hinges[name] = tuple(int(model.jnt_qposadr[joint]) for joint in joints)
        rest[name] = turned
        axes[name] = "".join("XYZ"[int(np.abs(model.jnt_axis[joint]).argmax())] for joint in joints)
    return Humanoid(model=model, hinges=hinges, rest=rest, axes=axes, floor=model.geom("floor").id)
