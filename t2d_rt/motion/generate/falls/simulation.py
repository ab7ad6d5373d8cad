"""A fall, step by step in MuJoCo: contacts, muscles, the foot that slips or is caught, and the ledger of energy."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from t2d_rt.motion.generate.falls.humanoid import FRICTION, RATE_HZ, STEP_S, STEPS_PER_FRAME, Humanoid, mujoco
from t2d_rt.motion.generate.falls.muscles import DAMPING_PER_STIFFNESS, STIFFNESS_PER_TORQUE

PELVIS = frozenset({"root", "lowerback"})

CHEST = frozenset({"upperback", "thorax", "lclavicle", "rclavicle", "head"})

SEEN = 2
"""Frames after a contact until the speeds at it, which are central differences, no longer change."""

BRACED_S = 0.35
"""How long after the pelvis's impact muscles stay tense, if the chest is not down before."""

RESTING = 0.15
"""Speed of every hinge [rad/s] and of the root [m/s] below which the body is at rest."""
RESTED_S = 0.15
"""How long it must be."""
STILL_DAMPING_S = 0.25
"""Damping of a body that lies and holds still, over its joints' greatest torques [s]: muscles that are tense on both sides of a
joint dissipate, and do not push."""

VISCOUS_S = 0.01
"""Damping of muscles without tone over their greatest torques."""

GRIPPED_S = 0.08
"""Within which a caught foot is held: shoes and obstacles give."""

SETTLING_S, SETTLED_S = 0.8, 0.8
"""From when the body lies to where that damping builds up, and how long that takes: limbs drop to the floor before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """What muscles do, frame by frame; the last frame goes on for ever."""

    targets: np.ndarray
    """Target angles by actuator (T, nu)."""
    tones: np.ndarray
    """Tone by actuator (T, nu)."""
    lying: np.ndarray
    """Target angles by actuator (nu,) of a body that lies."""
    limp: np.ndarray
    """Tone by actuator (nu,) after the impact."""
    brace_s: float
    """Within which it is reached."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """What makes the person fall, besides muscles."""

    feet: tuple[str, ...] = ()
    """Bodies whose friction is lost ("lfoot")."""
    friction: float = FRICTION
    slippery_s: float = 1.0
    """Until the feet have left the slippery spot."""
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
        """When forces from outside end, but for the floor's."""
        return max(self.push_s if any(self.push_n) else 0.0, self.caught_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """Frames of a simulated fall at 120 Hz, the first one at the event."""

    qpos: np.ndarray
    speeds: np.ndarray
    """Greatest speed of any joint's hinge or of the root (T,) [rad/s or m/s]."""
    energy_j: np.ndarray
    """Kinetic and potential energy (T,)."""
    work_j: np.ndarray
    """Work that muscles have done since the event (T,)."""
    touches: list[frozenset[str]]
    """Bodies that touch the floor in each frame."""
    deepest_m: np.ndarray
    """Deepest interpenetration with the floor and within the body (T, 2)."""


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
    """Run for so many frames from (qpos, qvel), or until the body is at rest.

    It ends early where the chest strikes the floor in an orientation (3, 3) that is not `wanted`, or where the run so far is not
    `hopeful`: asked `SEEN` frames after pelvis and chest are down, and after the head is as well.
    """
    # Muscles and friction change it, and no run may begin with those of another.
    body = replace(body, model=copy(body.model))
    module, model = mujoco(), body.model
    data = module.MjData(model)
    data.qpos[:], data.qvel[:] = start
    _rub(body, disturbance.feet, disturbance.friction)
    module.mj_forward(model, data)
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    chest = model.body("thorax").id
    kept: list[Any] = []
    work, impact, lying, lively, struck = 0.0, -1, -1, 0, False
    down = [frames] * 3
    for frame in range(frames):
        touching, depths = _contacts(body, data)
        speed = float(np.abs(data.qvel).max())
        kept.append((data.qpos.copy(), speed, float(data.energy.sum()), work, touching, depths))
        if touching & CHEST and not struck:
            struck = True
            if not wanted(data.xmat[chest].reshape(3, 3)):
                break
        if impact < 0 and touching & PELVIS:
            impact = frame
        now = is_down(touching, data.qpos[2]), touching & CHEST, "head" in touching
        down = [min(first, frame) if each else first for first, each in zip(down, now, strict=True)]
        if frame - SEEN in (max(down[:2]), max(down)) and not hopeful(_run(kept)):
            break
        if lying < 0 and impact >= 0 and (touching & CHEST or frame - impact > BRACED_S * RATE_HZ):
            lying = frame
        if impact >= 0 and speed > RESTING:
            lively = frame
        if impact >= 0 and frame - max(lively, impact) > RESTED_S * RATE_HZ:
            break
        if frame == round(disturbance.slippery_s * RATE_HZ):
            _rub(body, disturbance.feet, FRICTION)
        _act(model, data, course, frame, lying)
        phase = min(frame / RATE_HZ / disturbance.push_s, 1.0)
        data.xfrc_applied[chest, :3] = np.sin(np.pi * phase) * np.array(disturbance.push_n)
        for _ in range(STEPS_PER_FRAME):
            if disturbance.caught:
                _hold(model, data, disturbance, frame / RATE_HZ)
            before = data.qvel[dofs].copy()
            module.mj_step(model, data)
            work += float(data.actuator_force @ (before + data.qvel[dofs])) * 0.5 * STEP_S
    return _run(kept)


def is_down(touching: frozenset[str], pelvis_m: float) -> bool:
    """Whether the person has come down, on the pelvis or low on a thigh, from what touches the floor and the pelvis's height."""
    return bool(touching & PELVIS) or (bool(touching & {"lfemur", "rfemur"}) and pelvis_m < 0.25)


def _run(kept: list[Any]) -> Run:
    columns = list(zip(*kept, strict=True))
    return Run(
        qpos=np.stack(columns[0]), speeds=np.array(columns[1]), energy_j=np.array(columns[2]), work_j=np.array(columns[3]),
        touches=list(columns[4]), deepest_m=np.array(columns[5]),
    )  # fmt: skip


def _act(model: Any, data: Any, course: Course, frame: int, lying: int) -> None:
    """Targets, stiffness and damping of the muscles in a frame; `lying` is the one from which the body lies, -1 before."""
    torque = model.actuator_forcerange[:, 1]
    now = min(frame, len(course.targets) - 1)
    tone, target, braced = course.tones[now], course.targets[now], 0.0
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
    """The force on a caught foot: against its velocity, so that it takes energy only."""
    foot = model.body(disturbance.caught).id
    data.xfrc_applied[foot, :3] = 0.0
    if time_s < disturbance.caught_s:
        lever = data.xipos[foot] - data.subtree_com[model.body_rootid[foot]]
        velocity = data.cvel[foot, 3:] + np.cross(data.cvel[foot, :3], lever)
        grip = disturbance.grip_ns_per_m * min(time_s / GRIPPED_S, 1.0) ** 2
        data.xfrc_applied[foot, :3] = -grip * velocity


def _rub(body: Humanoid, feet: tuple[str, ...], friction: float) -> None:
    """Set the friction of feet on the floor."""
    for geom in range(body.model.ngeom):
        if body.body_of(geom) in feet:
            body.model.geom_friction[geom, 0] = friction


def _contacts(body: Humanoid, data: Any) -> tuple[frozenset[str], tuple[float, float]]:
    """Bodies on the floor; deepest interpenetration with the floor, and of the body with itself [m]."""
    geoms, depths = data.contact.geom, -data.contact.dist
    if len(depths) == 0:
        return frozenset(), (0.0, 0.0)
    on_floor = (geoms == body.floor).any(axis=1)
    touching = frozenset(body.body_of(int(g)) for g in geoms[on_floor].ravel() if g != body.floor)
    return touching, (float(depths[on_floor].max(initial=0.0)), float(depths[~on_floor].max(initial=0.0)))
