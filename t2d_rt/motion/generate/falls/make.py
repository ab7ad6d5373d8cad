"""Make falls: put a motion, a plan and its simulation together, let the body come to rest, and plan falls for descriptions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from t2d_rt.core.checks import instance
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import FALL_TYPES, Description, FallType
from t2d_rt.motion.generate.chain import doing
from t2d_rt.motion.generate.falls.draw import Draw, course, draw, heading_of
from t2d_rt.motion.generate.falls.humanoid import (
    RATE_HZ,
    SIDES,
    Anatomy,
    Humanoid,
    anatomy,
    coordinates,
    humanoid,
    mujoco,
    on_grid,
    reached,
    skeleton,
    velocities,
)
from t2d_rt.motion.generate.falls.joining import Skeleton, got_up, joined, placed_joints, rotations_of, skeleton_at
from t2d_rt.motion.generate.falls.measures import Figures, figures, fits, least_missing, missing
from t2d_rt.motion.generate.falls.simulation import HEADINGS, FallEvents, FallPlan, Heading, Run, simulate
from t2d_rt.motion.interpolate import low_pass, resample
from t2d_rt.motion.kinematics import facing, stature_m
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion, checked_motion

# --- heel strikes and swings of a walk or run, from ankles relative to the pelvis (Zeni, Richards, Higginson 2008) ---


STEP_M = 0.15
"""Least distance of an ankle ahead of the pelvis at the heel strike of a step."""

LOADING_S = 0.08
"""Time from a heel strike until the foot slips: 0.05 to 0.1 s (Redfern et al. 2001, Ergonomics 44)."""

EARLY_S = 0.05
"""Time before a swinging foot passes the other one at which it is caught: obstacles are met in the first half of the swing."""


def instants(motion: Motion, kind: str) -> list[tuple[int, str]]:
    """Frames and sides at which a foot may slip ("slip": after heel strikes) or be caught ("trip": as it passes the other one)."""
    events = []
    ahead = facing({name: motion.joints[:, i] for i, name in enumerate(motion.names)})
    for side in SIDES:
        relative = motion.joints[:, motion.index(f"{side}_ankle")] - motion.joints[:, 0]
        forward = low_pass(np.sum(relative * ahead, axis=1, keepdims=True), 6.0, motion.rate_hz)[:, 0]
        rising = np.gradient(forward)
        peaks = [i for i in range(1, len(forward) - 1) if rising[i - 1] > 0 >= rising[i] and forward[i] > STEP_M]
        if kind == "slip":
            # A foot slips as it takes the weight, before the body is over it.
            events += [(i + round(LOADING_S * motion.rate_hz), side) for i in peaks]
            continue
        crossing = np.flatnonzero((forward[:-1] < 0) & (forward[1:] >= 0) & (rising[1:] > 0)) + 1
        # Only where a step follows: a foot that is lifted in standing has nothing to carry it over.
        early = round(EARLY_S * motion.rate_hz)
        events += [
            (int(i) - early, side) for i in crossing if any(0 < peak - i < 0.5 * motion.rate_hz for peak in peaks)
        ]
    return sorted(events)


# --- what follows a fall: the last movements die away, and the body lies ---


EASING_S = 0.4
"""Simulated time at the end that is stretched to twice its length, so that all speeds fall to 0."""


def eased_out(qpos: np.ndarray) -> np.ndarray:
    """Frames (T + n, nq) of a run (T, nq) that comes to a full stop."""
    count = min(round(EASING_S * RATE_HZ), len(qpos) - 1)
    u = np.arange(1, 2 * count + 1) / (2 * count)
    # Speed falls linearly from 1 to 0 over twice the time.
    at = (len(qpos) - 1 - count) + count * u * (2.0 - u)
    low = np.minimum(at.astype(int), len(qpos) - 2)
    part = (at - low)[:, None]
    late = (1 - part) * qpos[low] + part * qpos[low + 1]
    late[:, 3:7] /= np.linalg.norm(late[:, 3:7], axis=1, keepdims=True)
    return np.concatenate([qpos[: len(qpos) - count], late])


# --- `fall`: a recorded walk, run or stance goes over into a simulated fall ---


LONGEST_S = 3.2
"""Simulated time from the event to rest."""

CHOICES, ATTEMPTS = 3, 3
"""Events that are tried in one lead, and candidates that are drawn at each event."""

TOLERATED = 0.35
"""Greatest excess (`missing`) with which no third event is tried, such as 0.35 m/s beyond a range."""

NEIGHBOURS = 5
"""Frames on either side of the event that give the speeds there."""

RANGE_MARGIN_RAD = 0.03

STEP_ON_S = 0.15
"""Time for which the interrupted step goes on much as it was: legs that pass each other closely must not collide in it."""

SETTLING_S = 0.3
"""Least duration of the lead before the event."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fall:
    """A fall with its events and figures."""

    motion: Motion
    events: FallEvents
    heading: Heading
    strength: float
    figures: Figures
    """Times in them are from the event."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A person at the event."""

    lead: Motion
    """The whole lead, at 120 Hz."""
    segments: np.ndarray
    """Orientations (T, 22, 3, 3) of the segments in the lead."""
    frame: int
    foot: str
    """Side that slips or is caught."""
    facing: np.ndarray
    """Level direction (2,) in which the person faces."""
    skeleton: Skeleton
    body: Humanoid
    start: tuple[np.ndarray, np.ndarray]
    """Coordinates qpos (nq,) and velocities qvel (nv,) at the event."""
    reference: np.ndarray
    """Coordinates (T, nq) of the lead from the event on."""

    def figures(self, run: Run, until_s: float) -> Figures:
        """Figures of a run from here, in which forces from outside end at `until_s`."""
        segments = reached(self.body, run.qpos)
        joints = skeleton(run.qpos[:, :3], segments, self.skeleton.offsets[: len(CANONICAL_JOINTS)])
        return figures(run, joints, segments[:, CANONICAL_JOINTS.index("spine3")], self.facing, until_s)

    def hopeful(self, run: Run, plan: FallPlan, until_s: float, below: float) -> bool:
        """Whether a run, as far as it has gone, may still end with less than `below` amiss."""
        return least_missing(self.figures(run, until_s), run, plan) < below


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One simulated fall, before it is chosen."""

    scenario: Scenario
    run: Run
    drawn: Draw
    figures: Figures
    amiss: float
    """How far it is from real falls, as `missing` gives it."""


def fall(lead: Motion, plan: FallPlan, getups: Sequence[Motion] = ()) -> Motion:
    """The lead up to the event, then a fall as planned, a rest and, if the plan asks for it, one of the recorded `getups`.

    It has 120 frames a second; the same lead, plan and version of MuJoCo give the same bits. Raises as `simulate_fall` does.
    """
    return simulate_fall(lead, plan, getups).motion


class NoFall(InputError):
    """Raised if a lead and a plan come to no fall; others may."""


def simulate_fall(lead: Motion, plan: FallPlan, getups: Sequence[Motion] = ()) -> Fall:
    """The motion of `fall`, with its events and figures; raises `NoFall` if no attempt succeeds, an InputError for wrong input."""
    checked_motion(lead)
    instance("plan", plan, FallPlan, "a FallPlan")
    if plan.get_up and not getups:
        raise InputError("the plan asks to get up, but no recorded getup was given; pass getups or set get_up to False")
    mujoco()
    best = _candidate(prepared(lead, plan), plan, 0, math.inf)
    for choice in range(1, CHOICES):
        if best.amiss <= TOLERATED * (choice - 1):
            break
        # Another step of the same walk may do where one does not.
        other = _candidate(prepared(lead, plan, choice), plan, choice, best.amiss)
        best = min(best, other, key=lambda candidate: candidate.amiss)
    if math.isinf(best.amiss):
        toward = f" {plan.direction}" if plan.direction else ""
        raise NoFall(
            f"in several attempts the person did not fall{toward} by a {plan.type} as real falls go; "
            "give another seed, time or direction"
        )
    return _assembled(best, plan, getups)


def prepared(lead: Motion, plan: FallPlan, choice: int = 0) -> Scenario:
    """The person at the event that the plan chooses; each `choice` is another draw of the event."""
    rng = np.random.default_rng([plan.seed, 0, choice])
    if abs(lead.rate_hz - RATE_HZ) > 1e-9:
        lead = resample(lead, RATE_HZ)
    frame, foot = _event(lead, plan, rng)
    points = {name: lead.joints[:, i] for i, name in enumerate(lead.names)}
    lead_anatomy = anatomy(lead)
    segments = lead_anatomy.segments(lead.rotations)
    bones = skeleton_at(lead, lead_anatomy, segments, frame)
    stature = stature_m(points)
    mass_kg = rng.uniform(20, 27) * stature**2 if plan.mass_kg is None else plan.mass_kg
    body = _fitted(bones, lead_anatomy, stature, float(mass_kg), lead, segments, frame)
    reference = on_grid(coordinates(body, lead.joints[:, 0], segments))
    qvel = on_grid(velocities(reference[frame - NEIGHBOURS : frame + NEIGHBOURS + 1], RATE_HZ))
    qpos = reference[frame].copy()
    qpos[2] = on_grid(qpos[2] + _penetration(body, qpos))
    _allow(body, qpos)
    return Scenario(
        lead=lead,
        segments=segments,
        frame=frame,
        foot=foot,
        facing=on_grid(facing(points)[frame, :2]),
        skeleton=bones,
        body=body,
        start=(qpos, qvel),
        reference=reference[frame:],
    )


def _event(lead: Motion, plan: FallPlan, rng: np.random.Generator) -> tuple[int, str]:
    """Frame and foot of the event; raises `NoFall` if the lead has no suitable step, an InputError if it is too short."""
    first, last = max(NEIGHBOURS, round(SETTLING_S * RATE_HZ)), len(lead.joints) - 1 - NEIGHBOURS
    if last <= first:
        raise InputError(
            f"the lead of a fall must be longer than {SETTLING_S + 2 * NEIGHBOURS / RATE_HZ:.2g} s, got {lead.duration_s:.3g} s"
        )
    if plan.time_s is not None and not plan.time_s <= lead.duration_s:
        raise InputError(f"time_s of {plan.time_s:g} s lies after the lead's end at {lead.duration_s:.3g} s")
    if plan.type == "collapse":
        options = [(frame, "left" if rng.random() < 0.5 else "right") for frame in range(first, last + 1)]
        options = options[len(options) // 3 :] if plan.time_s is None else options
    else:
        options = [instant for instant in instants(lead, plan.type) if first <= instant[0] <= last]
    if not options:
        raise NoFall(
            f"the lead has no step in which a foot could {'slip' if plan.type == 'slip' else 'be caught'}; "
            f"give a walk or run of two steps or more, or a collapse"
        )
    if plan.time_s is not None:
        target_frame = plan.time_s * RATE_HZ
        return min(options, key=lambda option: abs(option[0] - target_frame))
    return options[int(rng.integers(len(options)))]


def _fitted(
    bones: Skeleton, lead_anatomy: Anatomy, stature: float, mass: float, lead: Motion, segments: np.ndarray, frame: int
) -> Humanoid:
    """The humanoid, in which parts that intersect in the lead's own poses, at the event and just after, do not collide."""
    offsets = bones.offsets[: len(CANONICAL_JOINTS)]
    fitted = partial(humanoid, offsets, lead_anatomy.ankle_height_m, stature_m=stature, mass_kg=mass)
    body = fitted()
    soon = slice(frame, frame + round(STEP_ON_S * RATE_HZ), 3)
    poses = coordinates(body, lead.joints[soon, 0], segments[soon])
    pairs = {
        (body.body_of(first), body.body_of(second))
        for qpos in poses
        for first, second, distance in _contacts_at(body, qpos)
        if body.floor not in (first, second) and distance < 0
    }
    return fitted(apart=tuple(sorted(pairs))) if pairs else body


def _contacts_at(body: Humanoid, qpos: np.ndarray) -> list[tuple[int, int, float]]:
    data = mujoco().MjData(body.model)
    data.qpos[:] = qpos
    mujoco().mj_forward(body.model, data)
    return [(int(c.geom1), int(c.geom2), float(c.dist)) for c in data.contact]


def _penetration(body: Humanoid, qpos: np.ndarray) -> float:
    """Depth to which the feet stand in the floor [m], because the lead's soles are not quite where the humanoid's are."""
    return max([0.0, *(-gap for a, b, gap in _contacts_at(body, qpos) if body.floor in (a, b))])


def _allow(body: Humanoid, qpos: np.ndarray) -> None:
    """Widen the ranges of hinges so that they hold the pose of the lead, in which the person demonstrably is."""
    model = body.model
    angles = qpos[model.jnt_qposadr[1:]]
    model.jnt_range[1:, 0] = np.minimum(model.jnt_range[1:, 0], angles - RANGE_MARGIN_RAD)
    model.jnt_range[1:, 1] = np.maximum(model.jnt_range[1:, 1], angles + RANGE_MARGIN_RAD)


def _candidate(scenario: Scenario, plan: FallPlan, choice: int, least: float) -> Candidate:
    """The first candidate in which nothing is amiss, or the one with the least amiss; a run is given up once it cannot come below
    `least` and below the best one so far."""
    best: Candidate | None = None
    heading = heading_of(plan, np.random.default_rng([plan.seed, 1]))
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([plan.seed, 2, choice, attempt])
        insistence = (choice + attempt / ATTEMPTS) / CHOICES
        drawn = draw(plan, heading, scenario.foot, scenario.facing, rng, insistence=insistence)
        frames = round(LONGEST_S * RATE_HZ)
        muscles = course(scenario.body, drawn, scenario.reference, frames)
        until_s, below = drawn.disturbance.until_s, least if best is None else min(least, best.amiss)
        wanted = partial(fits, plan=plan)
        hopeful = partial(scenario.hopeful, plan=plan, until_s=until_s, below=below)
        run = simulate(
            scenario.body, scenario.start, muscles, drawn.disturbance, frames, wanted=wanted, hopeful=hopeful
        )
        measured = scenario.figures(run, until_s)
        amiss = missing(measured, plan)
        if best is None or amiss < best.amiss:
            best = Candidate(scenario=scenario, run=run, drawn=drawn, figures=measured, amiss=amiss)
        if amiss == 0:
            break
    assert best is not None, "there is at least one attempt"
    return best


def _assembled(candidate: Candidate, plan: FallPlan, getups: Sequence[Motion]) -> Fall:
    scenario, drawn, measured = candidate.scenario, candidate.drawn, candidate.figures
    lead, frame, bones = scenario.lead, scenario.frame, scenario.skeleton
    qpos = eased_out(candidate.run.qpos)
    joints, segments = joined(bones, lead, scenario.segments, frame, qpos[:, :3], reached(scenario.body, qpos))
    root = joints[:, 0]
    rested = len(qpos) - 1
    held = round(plan.rest_s * RATE_HZ)
    root, segments = (np.concatenate([track, np.repeat(track[-1:], held, axis=0)]) for track in (root, segments))
    get_up_s = None
    if plan.get_up:
        get_up_s = (frame + len(root) - 1) / RATE_HZ
        rise_m, rise = got_up(scenario.body, bones, root[-1], segments[-1], getups)
        root, segments = np.concatenate([root, rise_m[1:]]), np.concatenate([segments, rise[1:]])
    after = placed_joints(root, segments, bones.offsets, bones.parents)
    early = min(round(0.5 * RATE_HZ), len(joints))
    after[:early] = joints[:early]
    event_s = frame / RATE_HZ
    impact_s, rest_s = event_s + measured.impact_s, (frame + rested) / RATE_HZ
    events = FallEvents(event_s=event_s, impact_s=impact_s, rest_s=rest_s, get_up_s=get_up_s)
    joints = np.concatenate([lead.joints[:frame], after])
    note = (
        f"fall by {plan.type}, {measured.heading}, strength {drawn.strength:.2f}, seed {plan.seed}: event {event_s:.2f} s, "
        f"impact {impact_s:.2f} s, rest {rest_s:.2f} s"
    ) + (f", gets up {get_up_s:.2f} s" if get_up_s is not None else "")
    motion = lead.edited(
        note,
        joints=joints,
        rotations=np.concatenate([lead.rotations[:frame], rotations_of(bones, segments)]),
        activities=_activities(lead, events, joints),
    )
    return Fall(motion=motion, events=events, heading=measured.heading, strength=drawn.strength, figures=measured)


def _activities(lead: Motion, events: FallEvents, joints: np.ndarray) -> tuple[tuple[str, float], ...]:
    """Activities of the person: those of the lead until the fall, the fall, getting up as long as the joints move, and standing;
    empty if the lead has none."""
    if not lead.activities:
        return ()
    before = [activity for activity in lead.activities if activity[1] < events.event_s]
    fall = *before, ("fall", events.event_s)
    if events.get_up_s is None:
        return fall
    up = doing("stand_up", joints[round(events.get_up_s * RATE_HZ) :], RATE_HZ, before="fall")
    later = [(name, events.get_up_s + frame / RATE_HZ) for name, frame in up if name != "fall"]
    return (*fall, *later)


# --- the `physics` provider: falls that descriptions ask for ---


STRENGTHS = {"slow": (0.2, 0.45), "normal": (0.3, 0.8), "fast": (0.65, 0.95)}
"""Ranges of strength by the speed that a description asks for."""

RESTS_S = (1.0, 2.5)
"""Range of the time for which the body lies."""


def plan_of(description: Description, seed: int = 0) -> FallPlan:
    """The fall that a description asks for; what it leaves open is drawn from the seed. Raises an InputError without a fall."""
    steps = [step for step in description.steps if step.action == "fall"]
    if not steps:
        raise InputError(
            f"the physics provider makes falls, got a description of {description.action}; use the library provider"
        )
    step = steps[0]
    rng = np.random.default_rng([seed, 10])
    # A step that names no type falls by one that goes in its direction.
    going: dict[str | None, tuple[FallType, ...]] = {None: FALL_TYPES, "back": ("slip",), "forward": ("trip",)}
    types = (step.type,) if step.type in FALL_TYPES else going.get(step.direction, ("slip", "collapse"))
    after = description.steps[description.steps.index(step) + 1 :]
    return FallPlan(
        type=types[int(rng.integers(len(types)))],
        direction=step.direction if step.direction in HEADINGS else None,
        strength=float(rng.uniform(*STRENGTHS[step.speed])),
        rest_s=float(rng.uniform(*RESTS_S)),
        get_up=any(later.action == "stand_up" for later in after),
        seed=seed,
    )
