"""A fall, step by step in MuJoCo: contacts, muscles, the foot that slips or is caught, and the ledger of energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.motion.generate.falls.humanoid import FRICTION, RATE_HZ, STEP_S, STEPS_PER_FRAME, Humanoid, mujoco
from t2d_rt.motion.generate.falls.muscles import DAMPING_PER_STIFFNESS, STIFFNESS_PER_TORQUE

PELVIS = frozenset({"root", "lowerback"})

CHEST = frozenset({"upperback", "thorax", "lclavicle", "rclavicle", "head"})

BRACED_S = 0.35
"""How long after the pelvis's impact muscles stay tense, if the chest is not down before."""

RESTING = 0.15
"""Speed of every hinge [rad/s] and of the root [m/s] below which the body is at rest."""
RESTED_S = 0.15
"""How long it must be."""
STILL_DAMPING_S = 0.25
"""Damping of a body that lies and holds still, over its joints' greatest torques [s]: muscles that are tense on both sides of a
joint dissipate, and do not push."""

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
    body: Humanoid, start: tuple[np.ndarray, np.ndarray], course: Course, disturbance: Disturbance, frames: int
) -> Run:
    """Run for so many frames from (qpos, qvel)."""
    module, model = mujoco(), body.model
    data = module.MjData(model)
    data.qpos[:], data.qvel[:] = start
    _rub(body, disturbance.feet, disturbance.friction)
    module.mj_forward(model, data)
    torque = model.actuator_forcerange[:, 1]
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    foot = model.body(disturbance.caught).id if disturbance.caught else -1
    chest = model.body("thorax").id
    kept: list[Any] = []
    work, impact, lying, lively, braced = 0.0, -1, -1, 0, 0.0
    for frame in range(frames):
        touching, depths = _contacts(body, data)
        speed = float(np.abs(data.qvel).max())
        kept.append((data.qpos.copy(), speed, float(data.energy.sum()), work, touching, depths))
        if impact < 0 and touching & PELVIS:
            impact = frame
        if lying < 0 and impact >= 0 and (touching & CHEST or frame - impact > BRACED_S * RATE_HZ):
            lying = frame
        if frame == round(disturbance.slippery_s * RATE_HZ):
            _rub(body, disturbance.feet, FRICTION)
        k = min(frame, len(course.targets) - 1)
        tone, target = course.tones[k], course.targets[k]
        if lying >= 0:
            fade = min((frame - lying) / RATE_HZ / course.brace_s, 1.0)
            tone = (1 - fade) * tone + fade * course.limp
            braced = STILL_DAMPING_S * min(max((frame - lying) / RATE_HZ - SETTLING_S, 0.0) / SETTLED_S, 1.0)
            target = (1 - fade) * target + fade * course.lying
        _set_muscles(model, data, target, tone * torque * STIFFNESS_PER_TORQUE, (0.01 + braced) * torque)
        if impact >= 0 and speed > RESTING:
            lively = frame
        if frame - max(lively, impact) > RESTED_S * RATE_HZ and impact >= 0:
            break
        phase = min(frame / RATE_HZ / disturbance.push_s, 1.0)
        data.xfrc_applied[chest, :3] = np.sin(np.pi * phase) * np.array(disturbance.push_n)
        for _ in range(STEPS_PER_FRAME):
            if foot >= 0:
                held = frame / RATE_HZ < disturbance.caught_s
                data.xfrc_applied[foot, :3] = 0.0
                if held:
                    velocity = data.cvel[foot, 3:] + np.cross(
                        data.cvel[foot, :3], data.xipos[foot] - data.subtree_com[model.body_rootid[foot]]
                    )
                    data.xfrc_applied[foot, :3] = (
                        -disturbance.grip_ns_per_m * min(frame / RATE_HZ / GRIPPED_S, 1.0) ** 2 * velocity
                    )
            before = data.qvel[dofs].copy()
            module.mj_step(model, data)
            work += float(data.actuator_force @ (before + data.qvel[dofs])) * 0.5 * STEP_S
        if not np.isfinite(data.qpos).all():
            break
    module.mj_forward(model, data)
    columns = list(zip(*kept, strict=True))
    return Run(
        qpos=np.stack(columns[0]), speeds=np.array(columns[1]), energy_j=np.array(columns[2]), work_j=np.array(columns[3]),
        touches=list(columns[4]), deepest_m=np.array(columns[5]),
    )  # fmt: skip


def _set_muscles(model: Any, data: Any, target: np.ndarray, stiffness: np.ndarray, viscous: np.ndarray) -> None:
    damping = DAMPING_PER_STIFFNESS * stiffness + viscous
    model.actuator_gainprm[:, 0] = stiffness
    model.actuator_biasprm[:, 1] = -stiffness
    model.actuator_biasprm[:, 2] = -damping
    data.ctrl[:] = target


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
