"""Simulate a fall in the physics engine, with muscles that give way or brace."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np

from t2d_rt.core.checks import flag, integer, number, shown
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import vector_product
from t2d_rt.motion.descriptions.slots import FALL_TYPES, FallType
from t2d_rt.motion.generate.falls.humanoid import (
    PARENTS,
    RATE_HZ,
    SIDES,
    STEP_S,
    STEPS_PER_FRAME,
    Humanoid,
    hinge_angles,
    mujoco,
)
from t2d_rt.motion.interpolate import minimum_jerk

# --- what a fall is to be like: `FallPlan`; and when each of its phases begins: `FallEvents` ---


Heading = Literal["forward", "back", "left", "right"]
HEADINGS: tuple[Heading, ...] = get_args(Heading)

LONGEST_REST_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FallPlan:
    """A planned fall; what is None is drawn from the seed, as are all small differences. Raises an InputError for wrong values."""

    type: FallType
    direction: Heading | None = None
    """Direction in which the body falls; None: back or aside for a slip, not back for a trip, any for a collapse."""
    strength: float | None = None
    """0 (slow, half caught) to 1 (sudden, limp)."""
    time_s: float | None = None
    """Time at which it begins in the lead; the nearest heel strike (slip), mid-swing (trip) or frame (collapse) is taken."""
    protective_arms: bool = True
    """Whether the arms reach for the floor."""
    rest_s: float = 1.5
    """Time for which the body lies at rest before the motion ends or it gets up."""
    get_up: bool = False
    mass_kg: float | None = None
    """Mass of the body; None: that of a body mass index of 20 to 27."""
    seed: int = 0

    def __post_init__(self) -> None:
        if self.type not in FALL_TYPES:
            raise InputError(f"a fall's type must be one of {', '.join(FALL_TYPES)}, got {shown(self.type)}")
        if self.direction is not None and self.direction not in HEADINGS:
            raise InputError(f"a fall's direction must be one of {', '.join(HEADINGS)}, got {shown(self.direction)}")
        if (self.type, self.direction) == ("trip", "back"):
            raise InputError("a trip throws nobody backward, for the walk goes on; choose a slip, or another direction")
        if self.strength is not None:
            number("strength", self.strength, 0, 1)
        if self.time_s is not None:
            number("time_s", self.time_s, 0, unit="s")
        number("rest_s", self.rest_s, 0.3, LONGEST_REST_S, unit="s")
        if self.mass_kg is not None:
            number("mass_kg", self.mass_kg, 10, 250, unit="kg")
        flag("protective_arms", self.protective_arms)
        flag("get_up", self.get_up)
        integer("seed", self.seed)


@dataclass(frozen=True, slots=True, kw_only=True)
class FallEvents:
    """Instants of a fall [s], from the motion's first frame."""

    event_s: float
    """Balance is lost: the foot slips or is caught, or the muscles give way."""
    impact_s: float
    """Pelvis, thigh or trunk strikes the floor."""
    rest_s: float
    """The body has come to rest."""
    get_up_s: float | None = None
    """It begins to get up."""


# --- muscles of a falling person: they go on with the step, react after a while, and give way ---
#
# Each hinge is a spring and damper toward a target angle (proportional-derivative control), limited to the joint's
# greatest torque. `Course` says for every frame what the targets and the tone are, 1 being a walking person's.


STIFFNESS_PER_TORQUE = 2.2
"""Stiffness of a hinge at tone 1 over its greatest torque [1/rad]: an ankle of 240, a knee of 370 Nm/rad."""
DAMPING_PER_STIFFNESS = 0.07
"""Damping of a hinge over its stiffness [s]."""

JOINTS = tuple(name for name, parent in PARENTS.items() if parent >= 0)

PARTS = {
    "leg": "hip knee ankle foot",
    "trunk": "spine1 spine2 spine3",
    "arm": "collar shoulder elbow wrist",
    "neck": "neck head",
}
REGION = {joint: part for joint in JOINTS for part, names in PARTS.items() if joint.split("_")[-1] in names.split()}
"""Part of the body that each joint belongs to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fading:
    """A tone that falls from 1 to `floor`, `delay_s` after the event, within about `within_s`."""

    delay_s: float
    within_s: float
    floor: float

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """The tone at times since the event (T,)."""
        return self.floor + (1 - self.floor) * (1 - minimum_jerk((time_s - self.delay_s) / self.within_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class Reaction:
    """The pose that a falling person strives for."""

    heading: Heading
    delay_s: float
    """Time from the event; 0.1 to 0.25 s for balance reactions (Maki and McIlroy 1997)."""
    within_s: float
    arms: bool
    pose: dict[str, float] = field(default_factory=dict)
    """Angle [rad] by canonical joint and axis, as "spine1 x"."""
    reach: tuple[float, float] = (0.0, 0.0)
    """Differences (side, up) of the arms' directions from the usual ones."""
    elbow_rad: float = 0.6


def arm_directions(heading: Heading, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Directions in which an arm reaches and in which its elbow flexes, in the chest's axes (left, up, forward).

    Forward falls are met with both hands, backward falls with hands behind the hips, sideways falls with the arm of that side while
    the other one comes across (Hsiao and Robinovitch 1998, J. Biomech. 31).
    """
    out = 1.0 if side == "left" else -1.0
    if heading == "forward":
        return np.array([0.3 * out, 0.0, 0.95]), np.array([-0.5 * out, 0.85, 0.0])
    if heading == "back":
        return np.array([0.55 * out, -0.75, -0.3]), np.array([0.2 * out, 0.0, 1.0])
    if heading == side:
        return np.array([0.85 * out, -0.4, 0.35]), np.array([0.0, 0.5, 0.85])
    return np.array([-0.05 * out, -0.5, 0.85]), np.array([-0.5 * out, 0.8, 0.3])


def reaction_pose(body: Humanoid, reaction: Reaction, reference: np.ndarray) -> np.ndarray:
    """Target coordinates (T, nq) of the reaction, while the lead's are `reference` (T, nq)."""
    target = reference.copy()
    for key, angle in reaction.pose.items():
        name, axis = key.split()
        hinge = body.hinges[name][body.axes[name].index(axis.upper())]
        target[:, hinge] = angle
    if reaction.arms:
        for side in SIDES:
            along, flexion = arm_directions(reaction.heading, side)
            out = 1.0 if side == "left" else -1.0
            along = along + np.array([reaction.reach[0] * out, reaction.reach[1], 0.0])
            along = along / np.linalg.norm(along)
            x = np.cross(along, flexion)
            x /= np.linalg.norm(x)
            y = -along
            segment = np.stack([x, y, np.cross(x, y)], axis=-1)
            name = f"{side}_shoulder"
            angles = hinge_angles(body, name, segment[None])[0]
            target[:, body.hinges[name]] = within_range(body, name, angles)
            target[:, body.hinges[f"{side}_elbow"]] = reaction.elbow_rad
            target[:, body.hinges[f"{side}_collar"]] = 0.0
    return target


def within_range(body: Humanoid, name: str, angles: np.ndarray) -> np.ndarray:
    """Angles of a joint's hinges, clipped to their ranges."""
    model = body.model
    numbers = [int(np.flatnonzero(model.jnt_qposadr == hinge)[0]) for hinge in body.hinges[name]]
    ranges = model.jnt_range[numbers]
    return np.clip(angles, ranges[:, 0], ranges[:, 1])


def hinge_tones(body: Humanoid, tones: dict[str, np.ndarray]) -> np.ndarray:
    """Tone of each actuator (T, nu) from that of each canonical joint (T,)."""
    of_hinge = {hinge: name for name, hinges in body.hinges.items() for hinge in hinges}
    hinges = body.model.jnt_qposadr[body.model.actuator_trnid[:, 0]]
    return np.stack([tones[of_hinge[int(hinge)]] for hinge in hinges], axis=1)


# --- a fall, step by step in MuJoCo: contacts, muscles, the foot that slips or is caught, and the ledger of energy ---


PELVIS = frozenset({"root", "lowerback"})

CHEST = frozenset({"upperback", "thorax", "lclavicle", "rclavicle", "head"})

SEEN = 2
"""Frames after a contact until the speeds at it, which are central differences, no longer change."""

BRACED_S = 0.35
"""Time for which muscles stay tense after the pelvis's impact, if the chest is not down before."""

RESTING = 0.15
"""Speed of every hinge [rad/s] and of the root [m/s] below which the body is at rest."""
RESTED_S = 0.15
"""Time for which all speeds must stay below that."""
STILL_DAMPING_S = 0.25
"""Damping of a body that lies and holds still, over its joints' greatest torques [s]: muscles that are tense on both sides of a
joint dissipate, and do not push."""

VISCOUS_S = 0.01
"""Damping of muscles without tone over their greatest torques."""

GRIPPED_S = 0.08
"""Time within which the grip on a caught foot builds up: shoes and obstacles give."""

SETTLING_S, SETTLED_S = 0.8, 0.8
"""Time for which the body lies before `STILL_DAMPING_S` builds up, and the time that this takes: limbs drop to the floor first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """What muscles do, frame by frame; the last frame goes on for ever."""

    targets: np.ndarray
    """Target angles (T, nu) [rad] of the actuators."""
    tones: np.ndarray
    """Tones (T, nu) of the actuators."""
    lying: np.ndarray
    """Target angles (nu,) [rad] of the actuators of a lying body."""
    limp: np.ndarray
    """Tones (nu,) of the actuators after the impact."""
    brace_s: float
    """Time within which that tone is reached."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """What makes the person fall, besides muscles."""

    feet: tuple[str, ...] = ()
    """Bodies whose friction is lost ("lfoot")."""
    friction: float = 0.0
    """Coefficient of friction that is left."""
    slippery_s: float = 1.0
    """Time until the feet have left the slippery spot."""
    caught: str = ""
    """Body that is caught."""
    caught_s: float = 0.0
    grip_ns_per_m: float = 300.0
    """Damping of a caught foot."""
    push_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Greatest force on the chest, in the world's axes: the sway with which balance was lost."""
    push_s: float = 0.3
    """Duration of the push, a half sine."""

    @property
    def until_s(self) -> float:
        """Time at which the last force from outside, except the floor's, ends."""
        return max(self.push_s if any(self.push_n) else 0.0, self.caught_s)


@dataclass(frozen=True, slots=True)
class Run:
    """Frames of a simulated fall at 120 Hz, the first one at the event."""

    qpos: np.ndarray
    speeds: np.ndarray
    """Greatest speed (T,) of any joint's hinge or of the root [rad/s or m/s]."""
    energy_j: np.ndarray
    """Kinetic and potential energy (T,)."""
    work_j: np.ndarray
    """Work (T,) that muscles have done since the event."""
    touches: list[frozenset[str]]
    """Bodies that touch the floor in each frame."""
    deepest_m: np.ndarray
    """Deepest interpenetration (T, 2) with the floor and within the body."""


def simulate(
    body: Humanoid,
    start: tuple[np.ndarray, np.ndarray],
    course: Course,
    disturbance: Disturbance,
    frames: int,
    *,
    wanted: Callable[[np.ndarray], bool] = lambda chest: True,
    hopeful: Callable[[Run], bool] = lambda run: True,
) -> Run:
    """Run a number of frames from (qpos, qvel), or until the body is at rest.

    It ends early if the chest strikes the floor in an orientation (3, 3) that is not `wanted`, or if the run so far is not
    `hopeful`, which is asked `SEEN` frames after pelvis and chest are down, and again after the head is down as well.
    """
    # Muscles and friction change the model, and no run may begin with those of another.
    body = replace(body, model=copy(body.model))
    module, model = mujoco(), body.model
    data = module.MjData(model)
    data.qpos[:], data.qvel[:] = start
    _rub(body, disturbance.feet, disturbance.friction)
    module.mj_forward(model, data)
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    chest = model.body("thorax").id
    records: list[Any] = []
    moving, force = data.qvel, data.actuator_force  # views of what MuJoCo changes
    work, impact, lying, lively, struck = 0.0, -1, -1, 0, False
    down = [frames] * 3
    for frame in range(frames):
        touching, depths = _contacts(body, data)
        speed = float(np.abs(data.qvel).max())
        records.append((data.qpos.copy(), speed, float(data.energy.sum()), work, touching, depths))
        if touching & CHEST and not struck:
            struck = True
            if not wanted(data.xmat[chest].reshape(3, 3)):
                break
        if impact < 0 and touching & PELVIS:
            impact = frame
        conditions = is_down(touching, data.qpos[2]), touching & CHEST, "head" in touching
        down = [min(first, frame) if met else first for first, met in zip(down, conditions, strict=True)]
        if frame - SEEN in (max(down[:2]), max(down)) and not hopeful(_run(records)):
            break
        if lying < 0 and impact >= 0 and (touching & CHEST or frame - impact > BRACED_S * RATE_HZ):
            lying = frame
        if impact >= 0 and speed > RESTING:
            lively = frame
        if impact >= 0 and frame - max(lively, impact) > RESTED_S * RATE_HZ:
            break
        if frame == round(disturbance.slippery_s * RATE_HZ):
            _rub(body, disturbance.feet, float(model.geom_friction[body.floor, 0]))
        _act(model, data, course, frame, lying)
        phase = min(frame / RATE_HZ / disturbance.push_s, 1.0)
        data.xfrc_applied[chest, :3] = math.sin(math.pi * phase) * np.array(disturbance.push_n)
        after = moving[dofs]
        for _ in range(STEPS_PER_FRAME):
            if disturbance.caught:
                _hold(model, data, disturbance, frame / RATE_HZ)
            before = after
            module.mj_step(model, data)
            after = moving[dofs]
            work += float(force @ (before + after)) * 0.5 * STEP_S
    return _run(records)


def is_down(touching: frozenset[str], pelvis_m: float) -> bool:
    """Whether the person has come down on the pelvis or low on a thigh, by what touches the floor and the pelvis's height."""
    return bool(touching & PELVIS) or (bool(touching & {"lfemur", "rfemur"}) and pelvis_m < 0.25)


def _run(records: list[Any]) -> Run:
    qpos, speeds, energy, work, touches, depths = zip(*records, strict=True)
    return Run(np.stack(qpos), np.array(speeds), np.array(energy), np.array(work), list(touches), np.array(depths))


def _act(model: Any, data: Any, course: Course, frame: int, lying: int) -> None:
    """Sets targets, stiffness and damping of the muscles in a frame; `lying` is the one from which the body lies, -1 before."""
    torque = model.actuator_forcerange[:, 1]
    index = min(frame, len(course.targets) - 1)
    tone, target, braced = course.tones[index], course.targets[index], 0.0
    if lying >= 0:
        since = (frame - lying) / RATE_HZ
        fade = min(since / course.brace_s, 1.0)
        tone = (1 - fade) * tone + fade * course.limp
        target = (1 - fade) * target + fade * course.lying
        braced = STILL_DAMPING_S * min(max(since - SETTLING_S, 0.0) / SETTLED_S, 1.0)
    stiffness = tone * torque * STIFFNESS_PER_TORQUE
    model.actuator_gainprm[:, 0] = stiffness
    model.actuator_biasprm[:, 1] = -stiffness
    model.actuator_biasprm[:, 2] = -(DAMPING_PER_STIFFNESS * stiffness + (VISCOUS_S + braced) * torque)
    data.ctrl[:] = target


def _hold(model: Any, data: Any, disturbance: Disturbance, time_s: float) -> None:
    """Sets the force on a caught foot, which is against its velocity, so that it only takes energy."""
    foot = model.body(disturbance.caught).id
    data.xfrc_applied[foot, :3] = 0.0
    if time_s < disturbance.caught_s:
        lever = data.xipos[foot] - data.subtree_com[model.body_rootid[foot]]
        velocity = data.cvel[foot, 3:] + vector_product(data.cvel[foot, :3], lever)
        grip = disturbance.grip_ns_per_m * min(time_s / GRIPPED_S, 1.0) ** 2
        data.xfrc_applied[foot, :3] = -grip * velocity


def _rub(body: Humanoid, feet: tuple[str, ...], friction: float) -> None:
    """Set the friction of feet on the floor."""
    for geom in range(body.model.ngeom):
        if body.body_of(geom) in feet:
            body.model.geom_friction[geom, 0] = friction


def _contacts(body: Humanoid, data: Any) -> tuple[frozenset[str], tuple[float, float]]:
    """Bodies that touch the floor, and the deepest interpenetration with the floor and of the body with itself [m]."""
    geoms, depths = data.contact.geom, -data.contact.dist
    if len(depths) == 0:
        return frozenset(), (0.0, 0.0)
    on_floor = (geoms == body.floor).any(axis=1)
    touching = frozenset(body.body_of(int(geom)) for geom in geoms[on_floor].ravel() if geom != body.floor)
    return touching, (float(depths[on_floor].max(initial=0.0)), float(depths[~on_floor].max(initial=0.0)))
