"""The CMU humanoid of dm_control, fitted to one person: bones as long as the motion's, girth by stature, mass as given.

Its tree, joint axes, ranges, muscles' greatest torques and the capsules of its limbs are the file's; changed are contacts (hard,
with friction everywhere), feet (their soles at the height that the motion's ankles have) and hands (one rigid piece at the wrist).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError, install
from t2d_rt.motion.generate.falls.anatomy import PARENTS, SIDES
from t2d_rt.types.motion import CANONICAL_JOINTS

FILE = Path(__file__).with_name("humanoid_CMU_V2020.xml")

BODIES: dict[str, str] = {
    "pelvis": "root", "spine1": "lowerback", "spine2": "upperback", "spine3": "thorax", "neck": "lowerneck", "head": "head",
} | {
    f"{side}_{joint}": side[0] + body
    for side in SIDES
    for joint, body in (
        ("collar", "clavicle"), ("shoulder", "humerus"), ("elbow", "radius"), ("wrist", "hand"), ("hip", "femur"),
        ("knee", "tibia"), ("ankle", "foot"), ("foot", "toes"),
    )
}  # fmt: skip
"""Canonical joint -> body of the humanoid that turns about it."""

STEP_S = 1 / 720
STEPS_PER_FRAME = 6
RATE_HZ = 1 / (STEP_S * STEPS_PER_FRAME)
"""120 Hz."""

CONTACT_S = 0.008
"""Time constant of contacts: soft tissue on a hard floor stops within 5 to 10 ms."""
FRICTION = 0.7
"""Clothes and shoes on a dry floor: 0.5 to 0.9 (Chang et al. 2001, Ergonomics 44)."""
ROLLING_M = 0.02
"""Lever of the trunk's resistance to rolling: its flesh flattens where it lies."""

KNEE_RAD = np.radians(155.0)
"""Greatest bend of a knee under the body's weight: heel to buttock."""

STATURE_M = 1.72
"""Stature of the humanoid as it comes."""

TRUNK: dict[str, tuple[tuple[float, float, float], float, float]] = {
    "lowerback": ((0.0, 0.03, 0.04), 0.094, 0.05), "upperback": ((0.0, 0.03, 0.028), 0.113, 0.035),
    "thorax": ((0.0, 0.04, -0.012), 0.092, 0.085), "root": ((0.0, 0.03, 0.032), 0.108, 0.04),
}  # fmt: skip
"""Capsules across the trunk, as deep and wide as an adult's: middle (of root's: from between the hips), radius, half length [m]."""

HAND = ((0.01, -0.095, -0.02), (0.036, 0.1, 0.042))
"""Ellipsoid of a relaxed hand: middle and half axes [m]."""

MASSES = {
    "root": 0.112, "lowerback": 0.082, "upperback": 0.082, "thorax": 0.119, "clavicle": 0.02, "lowerneck": 0.01,
    "upperneck": 0.01, "head": 0.06, "humerus": 0.027, "radius": 0.016, "hand": 0.006, "femur": 0.1416, "tibia": 0.0433,
    "foot": 0.011, "toes": 0.003,
}  # fmt: skip
"""Masses of segments over the body's (de Leva 1996, J. Biomech. 29, men), the trunk's divided by volume."""

TORQUES_NM = {
    "femurrx": 180.0, "femurry": 80.0, "femurrz": 80.0, "tibiarx": 170.0, "footrx": 110.0, "footrz": 30.0, "toesrx": 15.0,
    "lowerback": 130.0, "upperback": 110.0, "thorax": 90.0, "neck": 25.0, "head": 20.0, "clavicle": 50.0, "humerus": 60.0,
    "radius": 50.0, "wrist": 10.0, "hand": 10.0,
}  # fmt: skip
"""Greatest torques of an adult's joints by their names (Anderson et al. 2007, J. Biomech. 40; arms: Holzbaur et al. 2007)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Humanoid:
    """A compiled model of MuJoCo and where its parts are."""

    model: Any
    """`mujoco.MjModel`."""
    hinges: dict[str, tuple[int, ...]]
    """Positions in qpos of each canonical joint's hinges, in the order z, y, x that the model applies them in."""
    rest: dict[str, np.ndarray]
    """Rotation (3, 3) of each canonical joint's body in its parent's frame where its hinges stand at 0."""
    axes: dict[str, str]
    """Axes of the hinges: a substring of "ZYX"."""
    floor: int
    """The floor's geom."""

    @property
    def bodies(self) -> np.ndarray:
        """Numbers of the bodies of the 22 canonical joints."""
        return np.array([self.model.body(BODIES[name]).id for name in CANONICAL_JOINTS])

    def body_of(self, geom: int) -> str:
        """Name of the body that a geom belongs to."""
        return str(self.model.body(int(self.model.geom_bodyid[geom])).name)


def mujoco() -> Any:
    """The module, or a sentence that says how to get it."""
    try:
        import mujoco as module
    except ImportError:
        raise InputError(f"falls by physics need MuJoCo, which is not installed; {install('falls')}") from None
    return module


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
    scale = stature_m / STATURE_M
    at = dict(zip(CANONICAL_JOINTS, offsets, strict=True))
    _simplify(spec)
    _contacts(spec)
    for first, second in apart:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    _stretch(spec, at, scale)
    for side, height in zip(SIDES, ankle_height_m, strict=True):
        _foot(spec, side[0], at[f"{side}_foot"], height, scale)
    floor = spec.worldbody.add_geom(name="floor", type=mujoco().mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    _contact(floor)
    floor.priority = 0
    _muscles(spec)
    spec.body("root").add_freejoint(name="root")
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco().mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.enableflags |= mujoco().mjtEnableBit.mjENBL_ENERGY
    model = spec.compile()
    _passive(model)
    _weigh(model, mass_kg)
    return _indexed(model)


def _simplify(spec: Any) -> None:
    """Hands of one piece, turning at the wrist; a neck of two joints; no sensors, and no motors but those that `_muscles` adds."""
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for side in "lr":
        for part in ("fingers", "thumb"):
            spec.delete(spec.body(side + part))
        spec.body(f"{side}hand").pos = np.zeros(3)
    for axis in "xyz":
        spec.delete(spec.joint(f"upperneckr{axis}"))


def _contact(geom: Any) -> None:
    geom.condim, geom.priority = 3, 1  # the floor's is 0: the friction of a contact is that of the body's part
    geom.friction = [FRICTION, 0.005, 0.0001]
    geom.solref, geom.solimp = [CONTACT_S, 1.0], [0.95, 0.99, 0.002, 0.5, 2.0]


def _contacts(spec: Any) -> None:
    for geom in spec.geoms:
        _contact(geom)
    for side, other in (("l", "r"), ("r", "l")):
        # Neighbours but one overlap by construction.
        pairs = [("humerus", "thorax"), ("femur", "lowerback"), ("clavicle", "upperback"), ("clavicle", "head")]
        for first, second in pairs:
            spec.add_exclude(bodyname1=side + first, bodyname2=second)
        spec.add_exclude(bodyname1=f"{side}humerus", bodyname2="lowerneck")
        spec.add_exclude(bodyname1=f"{side}tibia", bodyname2=f"{side}toes")
        spec.add_exclude(bodyname1=f"{side}radius", bodyname2=f"{side}hand")
        if side == "l":
            spec.add_exclude(bodyname1=f"{side}femur", bodyname2=f"{other}femur")
    spec.add_exclude(bodyname1="root", bodyname2="upperback")
    spec.add_exclude(bodyname1="thorax", bodyname2="head")
    spec.add_exclude(bodyname1="lowerback", bodyname2="thorax")


def _stretch(spec: Any, at: dict[str, np.ndarray], scale: float) -> None:
    """Bodies where the motion's joints are; geoms as long as the bones, as thick as the stature asks for."""
    lengths = {}
    for name, parent in PARENTS.items():
        if parent < 0:
            continue
        body = spec.body(BODIES[name])
        if name == "head":
            spec.body("upperneck").pos = np.zeros(3)
        above = CANONICAL_JOINTS[parent]
        if "hip" in name:
            body.parent.pos = np.zeros(3)
        if "wrist" in name:
            body = body.parent
        lengths[above] = float(np.linalg.norm(at[name])) / max(float(np.linalg.norm(body.pos)), 1e-6)
        body.pos = at[name]
    for name, body_name in BODIES.items():
        limb = name.split("_")[-1] in ("hip", "knee", "shoulder", "elbow")
        along = lengths[name] if limb else scale
        for geom in spec.body(body_name).geoms:
            geom.pos = np.asarray(geom.pos) * along
            geom.size = np.asarray(geom.size) * [scale, along, scale]
    hips = 0.5 * (at["left_hip"] + at["right_hip"])
    for body_name, (middle, radius, half) in TRUNK.items():
        (geom,) = spec.body(body_name).geoms
        geom.pos = np.array(middle) * scale + (hips if body_name == "root" else 0.0)
        geom.size = np.array([radius, half, 0.0]) * scale
        geom.condim, geom.friction = 6, [FRICTION, ROLLING_M, ROLLING_M]
    for side in "lr":
        spec.delete(spec.geom(f"{side}hipjoint"))
        wrist = spec.geom(f"{side}wrist")
        wrist.pos, wrist.size = np.zeros(3), np.array([0.02, 0.02, 0.0]) * scale
        hand = spec.geom(f"{side}hand")
        hand.pos, hand.size, hand.quat = np.array(HAND[0]) * scale, np.array(HAND[1]) * scale, [1, 0, 0, 0]
    for geom in spec.body("upperneck").geoms:
        geom.pos, geom.size = np.asarray(geom.pos) * 0.6 * scale, np.asarray(geom.size) * scale


def _foot(spec: Any, side: str, ball: np.ndarray, ankle_height_m: float, scale: float) -> None:
    """Two capsules from heel to ball and three spheres under the toes, their lowest points in the plane of the sole."""
    radius = 0.022 * scale
    middle = radius - ankle_height_m
    for name, aside in ((f"{side}foot", -0.02), (f"{side}foot_ch", 0.02)):
        spec.delete(spec.geom(name))
        ends = [aside * scale, 0.045 * scale, middle, 1.5 * aside * scale, ball[1], middle]
        capsule = mujoco().mjtGeom.mjGEOM_CAPSULE
        _contact(spec.body(f"{side}foot").add_geom(name=name, type=capsule, fromto=ends, size=[radius, 0, 0]))
    for number, aside in enumerate((0.0, 0.03, -0.03)):
        geom = spec.geom(f"{side}toes{number}")
        geom.pos, geom.size = [aside * scale, -0.055 * scale, middle - ball[2]], [radius, 0, 0]


def _muscles(spec: Any) -> None:
    """One muscle per hinge: force = gain * target - stiffness * q - damping * q', all 0 to begin with."""
    for joint in spec.joints:
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco().mjtTrn.mjTRN_JOINT)
        motor.gaintype, motor.biastype = mujoco().mjtGain.mjGAIN_FIXED, mujoco().mjtBias.mjBIAS_AFFINE
        torque = _torque_nm(joint.name)
        motor.forcelimited, motor.forcerange = True, [-torque, torque]
        motor.ctrllimited = False


def _torque_nm(hinge: str) -> float:
    """Greatest torque of a hinge, named as in the file ("ltibiarx", "lowerbackry")."""
    part = hinge[1:] if hinge[0] in "lr" and not hinge.startswith("lower") else hinge
    return next(torque for key, torque in TORQUES_NM.items() if part.startswith(key) or key in part)


def _passive(model: Any) -> None:
    """What joints do without muscles: damping, and limits that give a little."""
    for number in range(1, model.njnt):
        name, dof = str(model.joint(number).name), int(model.jnt_dofadr[number])
        model.jnt_stiffness[number] = 0.0
        model.dof_armature[dof] = 0.01
        model.dof_damping[dof] = 0.2 + 0.012 * _torque_nm(name)
        if name == "rhumerusrz":  # the file gives both arms the left one's range, which would hold the right arm up
            model.jnt_range[number] = [-1.5708, 1.1]
        slack = 0.0 if "tibia" in name or "radius" in name else np.radians(8.0)
        if name in ("ltibiarx", "rtibiarx"):  # the file lets a knee bend to 170 degrees; calf and thigh meet before
            model.jnt_range[number, 1] = KNEE_RAD
        model.jnt_range[number] += [-slack, slack]
        model.jnt_solref[number], model.jnt_solimp[number] = [0.02, 1.0], [0.9, 0.99, 0.05, 0.5, 2.0]


def _weigh(model: Any, mass_kg: float) -> None:
    """Masses of the segments by their fractions of the body's; inertia as the geoms' volumes have it."""
    fractions = np.array([MASSES.get(_plain(str(model.body(number).name)), 0.0) for number in range(model.nbody)])
    light = (fractions == 0.0) & (model.body_mass > 0)
    fractions[light] = 1e-4
    ratio = mass_kg * fractions / fractions.sum() / np.where(model.body_mass > 0, model.body_mass, 1.0)
    model.body_mass[:] *= ratio
    model.body_inertia[:] *= ratio[:, None]
    mujoco().mj_setConst(model, mujoco().MjData(model))


def _plain(body: str) -> str:
    """Name of a body without its side."""
    return body[1:] if body[0] in "lr" and body not in ("root", "lowerback", "lowerneck") else body


def _indexed(model: Any) -> Humanoid:
    hinges, rest, axes = {}, {}, {}
    for name, parent in PARENTS.items():
        if parent < 0:
            continue
        body, above = model.body(BODIES[name]).id, model.body(BODIES[CANONICAL_JOINTS[parent]]).id
        turned = np.eye(3)
        found: list[int] = []
        while body != above:
            # Bodies between two canonical joints (the wrist's) carry hinges of the same joint.
            first, count = model.body_jntadr[body], model.body_jntnum[body]
            found = [int(first + i) for i in range(count)] + found
            matrix = np.zeros(9)
            mujoco().mju_quat2Mat(matrix, model.body_quat[body])
            turned = matrix.reshape(3, 3) @ turned
            body = int(model.body_parentid[body])
        hinges[name] = tuple(int(model.jnt_qposadr[joint]) for joint in found)
        rest[name] = turned
        axes[name] = "".join("XYZ"[int(np.abs(model.jnt_axis[joint]).argmax())] for joint in found)
    return Humanoid(model=model, hinges=hinges, rest=rest, axes=axes, floor=model.geom("floor").id)
