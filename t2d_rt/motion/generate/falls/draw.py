"""Draw from a seed how one fall differs from another of its type."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.motion.generate.falls.humanoid import RATE_HZ, SIDES, Humanoid, on_grid
from t2d_rt.motion.generate.falls.simulation import (
    DAMPING_PER_STIFFNESS,
    HEADINGS,
    JOINTS,
    REGION,
    Course,
    Disturbance,
    Fading,
    FallPlan,
    Heading,
    Reaction,
    hinge_tones,
    reaction_pose,
)
from t2d_rt.motion.interpolate import minimum_jerk

LIMP = {"leg": 0.01, "trunk": 0.06, "arm": 0.01, "neck": 0.06}
"""Tone of a lying body, by part."""

AHEAD_S = 0.2
"""Time for which an interrupted step goes on by itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """One candidate of a fall."""

    strength: float
    reaction: Reaction
    tones: dict[str, Fading]
    disturbance: Disturbance
    limp: float
    """Tone after the impact, over the usual one."""
    brace_s: float


def heading_of(plan: FallPlan, rng: np.random.Generator) -> Heading:
    """The direction asked for, or one of those that the type mostly has."""
    if plan.direction is not None:
        return plan.direction
    if plan.type == "collapse":
        return HEADINGS[int(rng.choice(len(HEADINGS), p=[0.35, 0.25, 0.2, 0.2]))]
    return "back" if plan.type == "slip" else "forward"


def draw(
    plan: FallPlan,
    heading: Heading,
    foot: str,
    facing: np.ndarray,
    rng: np.random.Generator,
    *,
    insistence: float = 0.0,
) -> Draw:
    """A candidate; `foot` is the side that slips or is caught, `facing` (2,) where the person faces.

    `insistence` 0 to 1 makes the sway in the wanted direction larger.
    """
    strength = float(rng.uniform(0.3, 0.8)) if plan.strength is None else plan.strength
    return Draw(
        strength=strength,
        reaction=_reaction(plan, heading, foot, rng),
        tones=_tones(plan, heading, strength, rng),
        disturbance=_disturbance(plan, heading, foot, facing, rng, strength, 1 + insistence),
        limp=float(rng.uniform(0.7, 1.3)),
        brace_s=float(rng.uniform(0.15, 0.35)),
    )


def _reaction(plan: FallPlan, heading: Heading, foot: str, rng: np.random.Generator) -> Reaction:
    away = 1.0 if heading == "left" else -1.0
    # Angles of neck and spine about an axis; of hips and knees, of the leg that slips or is caught and of the other one.
    if plan.type == "slip":
        # The knees bend and the body sits down behind the feet.
        axis, neck, spine, hips, knees = "x", 0.45, -0.05, (0.1, 1.2), (1.0, 1.9)
    elif plan.type == "collapse":
        # The knees buckle and the body sinks upon them.
        axis, neck, spine, hips, knees = "x", 0.3, 0.12, (0.8, 0.8), (1.8, 1.8)
    elif heading == "forward":
        axis, neck, spine, hips, knees = "x", -0.25, -0.04, (0.0, 0.5), (1.2, 1.2)
    else:
        axis, neck, spine, hips, knees = "z", 0.2 * away, 0.06 * away, (0.4, 0.3), (0.5, 0.8)
    pose = {f"{joint} {axis}": neck * float(rng.normal(1, 0.2)) for joint in ("neck", "head")}
    pose |= {f"spine{i} {axis}": float(rng.normal(spine, 0.04)) for i in (1, 2, 3)}
    for side, hip, knee in zip((foot, SIDES[1 - SIDES.index(foot)]), hips, knees, strict=True):
        pose[f"{side}_hip x"] = float(rng.normal(-hip, 0.12))
        pose[f"{side}_knee x"] = float(abs(rng.normal(knee, 0.15)))
    pose |= {f"{side}_{hinge}": 0.0 for side in SIDES for hinge in ("ankle x", "ankle z", "foot x")}
    return Reaction(
        heading=heading,
        delay_s=float(rng.uniform(0.1, 0.2)),
        within_s=float(rng.uniform(0.25, 0.4)),
        arms=plan.protective_arms and plan.type != "collapse",  # who faints does not reach for the floor
        pose=pose,
        reach=(float(rng.normal(0, 0.12)), float(rng.normal(0, 0.12))),
        elbow_rad=float(rng.uniform(0.35, 0.9)),
    )


def _tones(plan: FallPlan, heading: Heading, strength: float, rng: np.random.Generator) -> dict[str, Fading]:
    tones = {}
    for joint in JOINTS:
        part = REGION[joint]
        if plan.type == "collapse":
            # Knees and hips give way first, and not together.
            floor = {"leg": 0.4, "trunk": 0.5, "arm": 0.06, "neck": 0.7}[part] * (1.6 - strength)
            late_s = 0.12 if heading in SIDES and joint.startswith("right" if heading == "left" else "left") else 0.0
            delay_s = {"leg": 0.0, "trunk": 0.15, "arm": 0.1, "neck": 0.2}[part] + late_s + float(rng.uniform(0, 0.15))
            within_s = float(rng.uniform(0.5, 0.9)) * (1.4 - 0.7 * strength)
        else:
            # In a slip, legs are pulled up and brake the fall as far as they reach the floor.
            braking = plan.type == "slip" and part == "leg"
            floor = {"leg": 1.2, "trunk": 0.9, "arm": 0.35, "neck": 1.0}[part] * (1.5 - strength)
            floor = 1.5 - 0.7 * strength if braking else floor
            delay_s = float(rng.uniform(0.1, 0.25))
            within_s = float(rng.uniform(0.25, 0.4) if braking else rng.uniform(0.3, 0.6))
        tones[joint] = Fading(delay_s=delay_s, within_s=within_s, floor=floor)
    return tones


def _disturbance(
    plan: FallPlan,
    heading: Heading,
    foot: str,
    facing: np.ndarray,
    rng: np.random.Generator,
    strength: float,
    gain: float,
) -> Disturbance:
    left = np.array([-facing[1], facing[0]])
    ahead = {"forward": facing, "back": -facing, "left": left, "right": -left}[heading]
    if plan.type == "slip":
        # The braking force of the foot's first contact, and the jerk with which the trunk is thrown back: 0.4 m/s or so.
        push = float(rng.uniform(95, 130)) + 30.0 * strength
        return Disturbance(
            feet=("lfoot", "ltoes", "rfoot", "rtoes"),
            friction=float(rng.uniform(0.04, 0.1)),
            slippery_s=float(rng.uniform(0.3, 0.5)),
            push_n=(*(push * gain * ahead), 0.0),
            push_s=float(rng.uniform(0.25, 0.4)),
        )
    if plan.type == "trip":
        push = 80.0 if heading in SIDES else 0.0
        push_n = (*(push * gain * ahead), 0.0)
        return Disturbance(caught=f"{foot[0]}foot", caught_s=0.12 + 0.16 * strength, push_n=push_n)
    # The last step brakes the walk as it gives way.
    sway = 0.0 if heading == "forward" else float(rng.uniform(30, 60)) * gain
    brake = 0.0 if plan.direction == "forward" else float(rng.uniform(40, 80))
    return Disturbance(push_n=(*(sway * ahead - brake * facing), 0.0), push_s=float(rng.uniform(0.3, 0.5)))


def course(body: Humanoid, drawn: Draw, reference: np.ndarray, frames: int) -> Course:
    """Targets and tones for a number of frames; `reference` (T, nq) are the lead's coordinates from the event on."""
    times = np.arange(frames) / RATE_HZ
    lead = reference[np.minimum(np.arange(frames), len(reference) - 1)]
    pose = on_grid(reaction_pose(body, drawn.reaction, lead))
    weight = minimum_jerk((times - drawn.reaction.delay_s) / drawn.reaction.within_s)[:, None]
    hinges = body.model.jnt_qposadr[body.model.actuator_trnid[:, 0]]
    targets = ((1 - weight) * lead + weight * pose)[:, hinges]
    # At first ahead by the lag of a damped spring: its damping is then against the step's own speeds, and nothing jolts.
    ahead_s = DAMPING_PER_STIFFNESS * (1 - minimum_jerk(times / AHEAD_S))[:, None]
    targets = targets + ahead_s * RATE_HZ * np.gradient(targets, axis=0)
    tones = hinge_tones(body, {joint: fading.at(times) for joint, fading in drawn.tones.items()})
    limp = {joint: np.array([drawn.limp * LIMP[part]]) for joint, part in REGION.items()}
    relaxed = lead[:1].copy()
    relaxed[:, 7:] = 0.0
    for side in SIDES:
        relaxed[:, body.hinges[f"{side}_shoulder"]] = pose[-1, body.hinges[f"{side}_shoulder"]]
        relaxed[:, body.hinges[f"{side}_wrist"]] = lead[0, body.hinges[f"{side}_wrist"]]
        relaxed[:, body.hinges[f"{side}_elbow"]] = relaxed[:, body.hinges[f"{side}_knee"]] = 0.3
    return Course(
        targets=targets, tones=tones, lying=relaxed[0, hinges], limp=hinge_tones(body, limp)[0], brace_s=drawn.brace_s
    )
