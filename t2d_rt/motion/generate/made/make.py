"""From steps of a description to poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made import ground, seat, standing
from t2d_rt.motion.generate.made.hands import Anatomy, InSpace
from t2d_rt.motion.generate.made.performer import AFTER_S, PROMPT, Performer, performer, shift, stance, tempo_of
from t2d_rt.motion.generate.made.render import render
from t2d_rt.motion.generate.made.score import INDEX, SIDES, SIGN, Grasp, Posture, Score
from t2d_rt.motion.kinematics import Poses, Skeleton

MADE: Mapping[str, Callable[[Score, Performer, Step], None]] = {
    "sit": ground.sit_down, "stand_up": ground.rise, "lie_down": ground.lie_down, "bend": standing.bend, "squat": standing.squat,
    "stretch": standing.stretch, "climb": seat.climb, "walk": seat.climb, "run": seat.climb,
}  # fmt: skip
"""What writes each action; walking and running are made where they go up or down a stair."""

CLIMBS = "climb", "walk", "run"
"""Those that go up or down a stair."""

STEPS_AWAY = 0.8
"""Chance of a step afterwards by who ends up standing."""

SLOWEST, FASTEST = 0.4, 2.0
"""Factors on the pace by which a wanted duration may be met; longer ones rest at the end."""

RAIL_M = 0.92
"""Height of a handrail for a stature of 1.72 m."""

STILL_MPS = 0.003
"""Speed of a foot that stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """A made motion: it begins at the origin, facing +x, with the ball's joint of a foot that stands at z = 0."""

    poses: Poses
    planted: np.ndarray
    """Whether heel and ball of each foot stand on floor or tread, bool (T, 2 sides, 2 heel and ball)."""
    begins: Posture
    ends: Posture
    floors_m: tuple[float, float]
    """Height of the floor at the start and at the end; not 0 at the upper end of a stair."""
    begins_s: tuple[float, ...]
    """When each step begins [s]."""
    notes: tuple[str, ...]
    """What stands where: heights of seats, beds and treads, and the person's way of using them."""


def make(
    steps: Sequence[Step], skeleton: Skeleton, *, rng: np.random.Generator, rate_hz: float = 60.0, handed: str = "right",
    tempo: float = 1.0, begins: Posture | None = None,
) -> Made:  # fmt: skip
    """Steps of which no clip ships, one after the other, by one person.

    skeleton: of the person, in the common rest pose. tempo: factor on the pace. begins: posture at the start; by default what the
        first step needs, which for standing up is sitting on a chair, or lying on the floor if its object is the floor.
    """
    for step in steps:
        if step.action not in MADE or (step.action in ("walk", "run") and step.direction not in ("up", "down")):
            raise InputError(
                f"action {step.action} is not one that is made; {', '.join(MADE)} are (walk and run up or down a stair)"
            )
    if not steps:
        raise InputError("there is no step to make; give at least one")
    anatomy = Anatomy(skeleton)
    who = performer(anatomy, rng, handed=handed, step=steps[0])
    score = _start(who, steps[0], begins)
    first = score.posture
    if begins is None and first == "standing" and steps[0].duration_s is None and steps[0].action not in CLIMBS:
        shift(score, who)
    begins_s = []
    for step in steps:
        begins_s.append(score.now_s)
        score.tempo = tempo_of(step, rng, tempo)
        before = len(score.moves), {side: len(score.grasps[side]) for side in SIDES}, score.now_s
        MADE[step.action](score, who, step)
        if step.object == "handrail" and step.action not in CLIMBS:
            _hold_rail(score, who, before)
        if step.duration_s is not None:
            _lasting(score, before, step.duration_s)
    if steps[-1].duration_s is None:
        if score.posture == "standing" and steps[-1].action not in CLIMBS and who.chance(STEPS_AWAY):
            shift(score, who)
        score.wait(who.u(*AFTER_S))
    poses, table = render(score, anatomy, rng=rng, rate_hz=rate_hz)
    # Root heights of skeletons count from the balls of the feet, those of a score from the floor.
    poses = replace(poses, root=poses.root - [0.0, 0.0, anatomy.sole_m])
    return Made(
        poses=poses, planted=_planted(table, rate_hz), begins=first, ends=score.posture,
        floors_m=(score.first["ground"], score.place.floor_m), begins_s=(0.0, *begins_s[1:]), notes=tuple(score.notes),
    )  # fmt: skip


def _start(who: Performer, step: Step, begins: Posture | None) -> Score:
    """A score in the posture that the first step begins with."""
    if begins is None:
        rises = step.action == "stand_up"
        begins = ("lying on the floor" if step.object == "floor" else "sitting") if rises else "standing"
    if begins == "standing":
        score = stance(who, waits=1.0 if step.duration_s is None else PROMPT)
        if step.action == "stand_up":
            ground.sit_down(score, who, Step(action="sit", object=step.object, manner=step.manner))
        return score
    if begins == "sitting":
        return seat.seated(who, step)
    if begins == "sitting on the floor":
        return ground.floor_seated(who, step)
    return ground.lying(who, step, bed=begins == "lying on a bed")


def _hold_rail(score: Score, who: Performer, before: tuple[int, dict[str, int], float]) -> None:
    """One hand takes a rail beside the person at the begin of a step and keeps it until the end."""
    side = who.side(0.6)
    start_s = before[2]
    tall = who.tall / 1.72
    point = score.place.world(who.u(-0.02, 0.12), SIGN[side] * who.u(0.34, 0.40) * tall, RAIL_M * tall)
    # Standing, seated or bowed, the arm never lies along this way of the elbow, where it would whip round.
    goal = InSpace(point=point, elbow=(-0.7, 0.1, -0.7), fingers=(0.9, 0.0, 0.1), yaw_rad=score.place.yaw_rad)
    end_s = max(score.now_s - 0.7, start_s + 0.8)
    score.grasps[side][before[1][side] :] = [
        Grasp(goal=goal, start_s=max(0.0, start_s - 0.3), duration_s=0.75, aside_m=0.03)
    ]
    if score.posture == "standing":
        score.grasps[side].append(Grasp(goal=who.hang(), start_s=end_s, duration_s=0.8, aside_m=0.0))
    score.notes.append(f"a handrail {RAIL_M * tall:.2f} m high on the {side}")


def _lasting(score: Score, before: tuple[int, dict[str, int], float], duration_s: float) -> None:
    """Stretch what was written since `before` to a duration; beyond what pace can do, the end is held."""
    moves, grasps, start_s = before
    factor = float(np.clip(duration_s / max(score.now_s - start_s, 0.1), 1 / FASTEST, 1 / SLOWEST))

    def later(time_s: float) -> float:
        return start_s + (time_s - start_s) * factor if time_s > start_s else time_s

    score.moves[moves:] = [
        replace(each, start_s=later(each.start_s), duration_s=each.duration_s * factor) for each in score.moves[moves:]
    ]
    for side in SIDES:
        score.grasps[side][grasps[side] :] = [
            replace(each, start_s=later(each.start_s), duration_s=each.duration_s * factor)
            for each in score.grasps[side][grasps[side] :]
        ]
    score.now_s = max(later(score.now_s), start_s + duration_s)


def _planted(table: np.ndarray, rate_hz: float) -> np.ndarray:
    """Contacts (T, 2, 2) from the channels (T, C) of the feet: still, heel or ball or both down."""
    found = np.zeros((len(table), 2, 2), dtype=bool)
    for number, side in enumerate(SIDES):
        x, y, z, tip, pivot, loose = (
            table[:, INDEX[f"{side}_{part}"]] for part in ("x", "y", "z", "tip", "pivot", "loose")
        )
        speed = np.linalg.norm(np.gradient(np.stack([x, y, z]), axis=1), axis=0) * rate_hz
        stands = (speed < STILL_MPS) & (loose < 0.01)
        found[:, number, 0] = stands & (np.abs(tip) < 0.02) | (stands & (pivot < 0.01))
        found[:, number, 1] = stands & (pivot > 0.99) & (tip > -0.02)
    return found
