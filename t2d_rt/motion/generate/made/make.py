"""Make poses of those steps of a description of which no clip ships."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.chain import Begins, doing, exceeded
from t2d_rt.motion.generate.made import ground, seat, standing
from t2d_rt.motion.generate.made.act import (
    AFTER_S,
    DEG,
    INDEX,
    PROMPT,
    SIDES,
    SIGN,
    Act,
    Grasp,
    Move,
    Posture,
    resumed,
    shift,
    stance,
    tempo_of,
    turn_on_the_spot,
)
from t2d_rt.motion.generate.made.hands import Anatomy
from t2d_rt.motion.generate.made.render import render
from t2d_rt.motion.kinematics import Poses, Skeleton

MADE: Mapping[str, Callable[[Act, Step], None]] = {
    "sit": ground.sit_down,
    "stand_up": ground.rise,
    "lie_down": ground.lie_down,
    "bend": standing.bend,
    "squat": standing.squat,
    "stretch": standing.stretch,
    "balance": standing.balance,
    **dict.fromkeys(("climb", "walk", "run"), seat.climb),
}
"""The function that writes each action; walking and running are made if they go up or down a stair."""

RESTS: Mapping[Posture, str] = {
    "standing": "stand",
    "sitting": "seated",
    "sitting on the floor": "seated",
    "lying on the floor": "lying",
    "lying on a bed": "lying",
}
"""Activity of a person who rests in a posture."""

T = TypeVar("T", Move, Grasp)

CLIMBS = "climb", "walk", "run"
"""Actions that go up or down a stair."""

STEPS_BEFORE, STEPS_AWAY, TURNS_TO_SEAT, TURNS_AWAY = 0.65, 0.65, 0.25, 0.8
"""Chances of a step before the motion, of one after it if the person ends up standing, of turning the back to the seat before
sitting down, and of turning away after standing up."""

TURNED_AWAY_DEG = 20.0, 140.0
"""Range of the angle of the turn after standing up."""

SLOWEST, FASTEST = 0.4, 2.0
"""Least and greatest factor on the pace by which a wanted duration may be met; the rest of a longer one is spent at rest."""

RAIL_M = 0.92
"""Height of a handrail for a stature of 1.72 m."""

STILL_MPS = 0.003
"""Speed of a foot below which it stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MadeMotion:
    """A made motion: it begins at the origin, facing +x, with the ball's joint of a foot that stands at z = 0."""

    poses: Poses
    planted: np.ndarray
    """Whether heel and ball of each foot stand on floor or tread, bool (T, 2 sides, 2 heel and ball)."""
    begins: Posture
    ends: Posture
    floors_m: tuple[float, float]
    """Height of the floor at the start and at the end; not 0 at the upper end of a stair."""
    does: Begins
    """Each step from its first movement to its last, the rests between them, and their first frames."""
    notes: tuple[str, ...]
    """Heights of seats, beds and treads, and the person's way of using them."""


def make(
    steps: Sequence[Step],
    skeleton: Skeleton,
    *,
    rng: np.random.Generator,
    rate_hz: float = 60.0,
    handed: str = "right",
    tempo: float = 1.0,
    begins: Posture | None = None,
) -> MadeMotion:
    """A motion of steps of which no clip ships, one after the other, by one person. Raises an InputError for other steps.

    skeleton: the person's, in the common rest pose. tempo: factor on the pace. begins: posture at the start; by default the one
        that the first step needs, which for standing up is sitting on a chair, or lying on the floor if its object is the floor.
    """
    for step in steps:
        if step.action not in MADE or (step.action in ("walk", "run") and step.direction not in ("up", "down")):
            raise InputError(
                f"action {step.action} is not one that is made; {', '.join(MADE)} are (walk and run up or down a stair)"
            )
    if not steps:
        raise InputError("there is no step to make; give at least one")
    free = begins is None and steps[0].duration_s is None
    act = _begun(Anatomy(skeleton), rng, handed, steps[0], begins)
    first = act.posture
    if free and first == "standing" and steps[0].action not in CLIMBS:
        if steps[0].action == "sit" and steps[0].direction is None and act.chance(TURNS_TO_SEAT):
            turn_on_the_spot(act, SIGN[act.side(0.5)] * act.u(60, 180) * DEG)
        elif act.chance(STEPS_BEFORE):
            shift(act)
    spans = []
    for step in steps:
        rests, begin_s = act.posture, act.now_s
        act.tempo = tempo_of(step, rng, tempo)
        moves, grasps, start_s = len(act.moves), {side: len(act.grasps[side]) for side in SIDES}, act.now_s
        MADE[step.action](act, step)
        if step.object == "handrail" and step.action not in CLIMBS:
            _hold_rail(act, grasps, start_s)
        if step.duration_s is not None:
            stretched = Stretch.between(start_s, act.now_s, step.duration_s)
            act.moves[moves:] = stretched.moves(act.moves[moves:])
            for side in SIDES:
                act.grasps[side][grasps[side] :] = stretched.moves(act.grasps[side][grasps[side] :])
            act.now_s = max(stretched.later(act.now_s), start_s + step.duration_s)
            act.notes += exceeded(step, act.now_s - start_s)
        spans.append((step.action, begin_s, act.now_s, RESTS[rests], RESTS[act.posture]))
    if steps[-1].duration_s is None:
        if act.posture == "standing" and steps[-1].action == "stand_up" and act.chance(TURNS_AWAY):
            turn_on_the_spot(act, SIGN[act.side(0.5)] * act.u(*TURNED_AWAY_DEG) * DEG)
        elif act.posture == "standing" and steps[-1].action not in CLIMBS and act.chance(STEPS_AWAY):
            shift(act)
        act.wait(act.u(*AFTER_S))
    poses, table = render(act, rng=rng, rate_hz=rate_hz)
    # Root heights of skeletons count from the balls of the feet, those of an act from the floor.
    poses = replace(poses, root=poses.root - [0.0, 0.0, act.anatomy.sole_m])
    return MadeMotion(
        poses=poses,
        planted=_planted(table, rate_hz),
        begins=first,
        ends=act.posture,
        floors_m=(act.first["ground"], act.place.floor_m),
        does=_does(poses, spans),
        notes=tuple(act.notes),
    )


def _does(poses: Poses, spans: Sequence[tuple[str, float, float, str, str]]) -> Begins:
    """Actions and their first frames, from steps with beginning and end [s] and the rests before and after them."""
    joints, _ = poses.world()
    begins: list[tuple[str, int]] = [(spans[0][3], 0)]
    for action, begin_s, end_s, before, after in spans:
        first, stop = round(begin_s * poses.rate_hz), min(round(end_s * poses.rate_hz), len(joints))
        action_begins = doing(action, joints[first:stop], poses.rate_hz, before=before, after=after)
        begins += [*((name, first + frame) for name, frame in action_begins), (after, stop)]
    return tuple(begins)


def _begun(anatomy: Anatomy, rng: np.random.Generator, handed: str, step: Step, begins: Posture | None) -> Act:
    """An act in the posture that the first step begins with: what leads to it is written down, and left out."""
    if begins is None and step.action == "stand_up":
        begins = "lying on the floor" if step.object == "floor" else "sitting"
    prompt = begins in (None, "standing") and step.duration_s is not None
    act = stance(anatomy, rng, handed=handed, step=step, waits=PROMPT if prompt else 1.0)
    if begins in (None, "standing"):
        if step.action == "stand_up":
            ground.sit_down(act, Step(action="sit", object=step.object, manner=step.manner))
        return act
    if begins == "sitting":
        seat.sit(act, Step(action="sit", object=step.object, manner=step.manner))
    elif begins == "sitting on the floor":
        ground.floor_seat(act)
    else:
        if begins == "lying on a bed":  # from whose edge one lies down
            seat.sit(act, Step(action="sit", manner=step.manner), backrest=False)
        ground.lie_down(act, Step(action="lie_down", object="floor", manner=step.manner))
    return resumed(act, step)


def _hold_rail(act: Act, grasps: Mapping[str, int], start_s: float) -> None:
    """One hand takes a rail beside the person at the beginning of a step and keeps it until the end: what else it was to do in the
    step, after the first `grasps` of its side, is dropped."""
    side = act.side(0.6)
    tall = act.tall / 1.72
    point = act.u(-0.02, 0.12), SIGN[side] * act.u(0.34, 0.40) * tall, RAIL_M * tall
    # Standing, seated or bowed, the arm never lies along this way of the elbow, where it would whip round.
    goal = act.place.hold(*point, elbow=(-0.7, 0.1, -0.7), fingers=(0.9, 0.0, 0.1))
    end_s = max(act.now_s - 0.7, start_s + 0.8)
    takes = Grasp(goal=goal, start_s=max(0.0, start_s - 0.3), duration_s=0.75, aside_m=0.03)
    act.grasps[side][grasps[side] :] = [takes]
    if act.posture == "standing":
        act.grasps[side].append(Grasp(goal=act.hang(), start_s=end_s, duration_s=0.8, aside_m=0.0))
    act.notes.append(f"a handrail {RAIL_M * tall:.2f} m high on the {side}")


@dataclass(frozen=True, slots=True)
class Stretch:
    """Time that runs slower by a factor from an instant on."""

    start_s: float
    factor: float

    @classmethod
    def between(cls, start_s: float, end_s: float, duration_s: float) -> Stretch:
        """The stretch that brings a span to a duration, as far as the pace may change; beyond that, the end is to be held."""
        return cls(start_s, float(np.clip(duration_s / max(end_s - start_s, 0.1), 1 / FASTEST, 1 / SLOWEST)))

    def later(self, time_s: float) -> float:
        """The new time [s] of what was at `time_s`."""
        return self.start_s + (time_s - self.start_s) * self.factor if time_s > self.start_s else time_s

    def moves(self, moves: list[T]) -> list[T]:
        """Moves or grasps at their new times."""
        return [
            replace(move, start_s=self.later(move.start_s), duration_s=move.duration_s * self.factor) for move in moves
        ]


def _planted(table: np.ndarray, rate_hz: float) -> np.ndarray:
    """Contacts (T, 2, 2) from the channels (T, C) of the feet: still, heel or ball or both down."""
    planted = np.zeros((len(table), 2, 2), dtype=bool)
    for number, side in enumerate(SIDES):
        x, y, z, tip, pivot, loose = (
            table[:, INDEX[f"{side}_{part}"]] for part in ("x", "y", "z", "tip", "pivot", "loose")
        )
        speed = np.linalg.norm(np.gradient(np.stack([x, y, z]), axis=1), axis=0) * rate_hz
        stands = (speed < STILL_MPS) & (loose < 0.01)
        planted[:, number, 0] = stands & (np.abs(tip) < 0.02) | (stands & (pivot < 0.01))
        planted[:, number, 1] = stands & (pivot > 0.99) & (tip > -0.02)
    return planted
