"""Compose one motion of one person from the steps of a description, each made by what suits it; tell what nothing makes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion.check import check_motion, detect_fall
from t2d_rt.motion.contacts import contacts, plant
from t2d_rt.motion.descriptions.slots import GAIT_TYPES, Action, Description, GaitType, Side, Step
from t2d_rt.motion.generate import LONGEST_S, NOT_MADE
from t2d_rt.motion.generate.chain import SHORTEST_REST_S, Begins, Piece, best_seam, doing, exceeded, joined
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.edits import begun, halted
from t2d_rt.motion.generate.library.individual import Individual, Maker, individual, lively, sole_m
from t2d_rt.motion.generate.library.moves import ACTIONS, angle_deg, directed, made_of_clips, own_clips
from t2d_rt.motion.generate.library.store import RATE_HZ, Store, shipped
from t2d_rt.motion.generate.library.users import with_users
from t2d_rt.motion.generate.made import RESTS, Posture, make
from t2d_rt.motion.interpolate import resample
from t2d_rt.motion.kinematics import Poses, motion_of, poses_of
from t2d_rt.motion.read.passes import file_origin
from t2d_rt.types.motion import Motion

# --- what makers heed of a description's step, and what nothing makes ---


COUNTED = frozenset({"jump", "bend", "squat", "stretch", "climb", "sit", "stand_up", "turn"})
"""Actions that are done as many times as a description says."""

PARTS: Mapping[Action, str] = {
    "jump": "foot leg arm hand",
    "bend": "arm hand foot leg waist knee",
    "squat": "arm hand foot leg",
    "stretch": "arm hand foot leg waist knee",
    "balance": "foot leg",
    "sit": "foot leg",
    "stand_up": "foot leg",
}
"""Parts of the body that each action heeds if a description names one; abnormal gaits heed all."""

OBJECTS: Mapping[Action, str] = {
    "climb": "stair handrail",
    "sit": "chair stair handrail",
    "stand_up": "chair stair handrail",
    "lie_down": "chair",
    "bend": "ball handrail",
    "squat": "ball handrail",
    "stretch": "handrail",
}
"""Objects that each action heeds, beside the floor that everybody is on."""

IDLE_DIRECTIONS: Mapping[Action, str] = {"sit": "back forward", "stand_up": "forward back left right"}
"""Directions that change nothing in an action; those in which it goes anyway, as down in sitting, are left out."""


def not_made(step: Step, following: Sequence[Step] = ()) -> list[str]:
    """Phrases for what a step asks for and no maker does. following: later steps, which may use an object that is walked to."""
    requests = []
    falls = step.action == "fall"
    if step.count is not None and step.count > 1 and step.action not in COUNTED:
        requests.append(f"count {step.count}")
    if step.duration_s is not None and falls:
        requests.append(f"duration {step.duration_s:g} s")
    parts = PARTS.get(step.action, "").split()
    objects = ["floor", *OBJECTS.get(step.action, "").split()]
    if step.action == "jump" and step.direction is not None:  # jumping jacks go nowhere
        parts = ["foot", "leg"]
    if step.body_part is not None and step.body_part not in parts and step.type not in GAIT_TYPES:
        requests.append(f"{step.side + ' ' if step.side else ''}{step.body_part}")
    if step.object is not None and step.object not in objects and not _used(step, following):
        requests.append(step.object)
    if step.direction == "in_place" and step.type is not None:
        requests.append("staying on the spot")
    if step.direction is not None and step.direction in IDLE_DIRECTIONS.get(step.action, "").split():
        requests.append(f"direction {step.direction}")
    if step.manner is not None and falls:
        requests.append(f"manner {step.manner}")
    return [f"{request} of {step.action.replace('_', ' ')}" for request in requests]


def _used(step: Step, following: Sequence[Step]) -> bool:
    """Whether the object of a step is used: to trip over it, to walk up or down a stair, or to sit down on a chair later."""
    if step.action not in ("walk", "run"):
        return step.type == "trip"
    on_stair = step.object == "stair" and step.direction in ("up", "down")
    return on_stair or any(step.object in OBJECTS.get(later.action, "").split() for later in following)


# --- the steps of a description as one motion of one person ---


By = Literal["library", "gaits", "made", "physics"]

LEAD_S = 2.4, 3.6
"""Duration of the walk or stance before a fall where the description says nothing of it."""

FURTHER_S = 1.2
"""Time by which a lead is made longer if its last step has a given duration: a fall begins at the footstep nearest to its end."""

ATTEMPTS = 8
"""Leads and plans that are tried until the person falls."""

DIRECTED_ATTEMPTS = 4
"""Falls that are tried until the body topples where the description says, head away from the feet."""

LEAST_SEVERITY, MORE_SEVERE = 0.4, 0.2
"""Least severity of an abnormal gait that is drawn, and by how much it grows while the filter takes the gait for a normal walk: of
gaits with severities drawn from 0 on, three in five were taken for one."""

DANCES = 3
"""Most dances that are made until one passes the filter; the last is taken as it is."""

TOPPLES = {"forward": "forward", "straight": "forward", "back": "backward", "left": "left", "right": "right"}
"""The filter's names for the directions of a description."""

SEARCH_S = 0.5
"""Last part of a step in which the next one may begin: a step of a walk."""

PROMPT_S = 0.15
"""The same for a step that has a duration of its own, and the rest before the next one."""

AT_REST_MPS = 0.05
"""Greatest speed of the hips in quiet standing."""

SEAM_S = 0.5
"""Time in which a difference between steps dies out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Composer:
    """Makes motions of descriptions, by `only` one provider or each step by what suits it."""

    only: str | None = None
    body: str | None = None
    stature_m: float | None = None
    person_seed: int | None = None
    """Seed of the person alone; by default that of the motion."""
    library: str | Path | None = None

    def __call__(self, description: Description, *, seed: int) -> Motion:
        """The motion of a description; raises an InputError if the provider does not make it, or if it would be too long."""
        rng = np.random.default_rng([seed, *description.sentence.encode()])
        store = shipped() if self.library is None else with_users(shipped(), self.library)
        # The physics needs all other makers for what comes before a fall; the library makes everything but falls.
        falls = [step.action for step in description.steps if maker_of(step, store) == "physics"]
        refused = falls[:1] if self.only == "library" else []
        if self.only == "physics" and description.action != "fall":
            refused = [description.action]
        if refused:
            raise InputError(
                f"provider {self.only} does not make {refused[0].replace('_', ' ')}; "
                "leave the provider out, so that each step is made by what suits it"
            )
        # One seed gives one person, whatever a sentence calls them.
        subject, person_rng = description.subject, rng
        if self.person_seed is not None:
            person_rng = np.random.default_rng(self.person_seed)
            subject = description.subject if self.body is None else "person"
        person = individual(subject, person_rng, body=self.body, stature_m=self.stature_m)
        motion = _composed(Maker(store, person, rng), description)
        if motion.duration_s > LONGEST_S:
            raise InputError(
                f"the motion would last {motion.duration_s:.0f} s, more than {LONGEST_S:g} s; ask for fewer repetitions or steps"
            )
        task = f"made for {description.sentence!r}, class {description.activity}, by {self.only or 'auto'}, seed {seed}"
        if self.library is not None:
            task += f", with clips of {file_origin(Path(self.library))}"
        person_note = f"{description.subject.replace('_', ' ')} of {person.stature_m:.2f} m, body {person.body}"
        steps = description.steps
        unmet = [request for number, step in enumerate(steps) for request in not_made(step, steps[number + 1 :])]
        origin = (task, person_note, *(f"{NOT_MADE}{request}" for request in unmet), *motion.origin)
        report = f"generated; {person_note}; floor at 0 m"
        return replace(motion, origin=origin, report=report, placed=False, breathing=person.breathing)


def maker_of(step: Step, store: Store) -> By:
    """The maker of a step; a user's clips of an action take precedence over key poses."""
    if step.action == "fall":
        return "physics"
    if step.type in GAIT_TYPES:
        return "gaits"
    if step.action in ("walk", "run") and step.direction in ("up", "down"):
        return "made"
    return "library" if step.action in ACTIONS or own_clips(store, step) else "made"


def _is_made(step: Step, store: Store) -> bool:
    """Whether a step is made of key poses."""
    return maker_of(step, store) == "made"


BETWEEN: Mapping[Action, Action | None] = {"sit": "stand_up", "stand_up": "sit", "turn": None}
"""Actions that are made once at a time, and what comes between two of them."""


def _repeated(steps: Sequence[Step], rng: np.random.Generator) -> tuple[Step, ...]:
    """The steps, those of `BETWEEN` as often as they say; turns without a side all go to one side, which is drawn."""
    repeated: list[Step] = []
    for step in steps:
        count = step.count or 1
        if step.action not in BETWEEN or count == 1:
            repeated.append(step)
            continue
        if step.action == "turn":  # all to one side, each by the angle of one
            side = step.direction or ("left" if rng.random() < 0.5 else "right")
            step = step.model_copy(update={"direction": side, "angle_deg": angle_deg(step)})
        between = BETWEEN[step.action]
        once_s = None if step.duration_s is None else step.duration_s / (count if between is None else 2 * count - 1)
        once = step.model_copy(update={"count": None, "duration_s": once_s})
        back = [Step(action=between, object=step.object, speed=step.speed, duration_s=once_s)] if between else []
        repeated += [once, *(count - 1) * [*back, once]]
    return tuple(repeated)


def _composed(maker: Maker, description: Description) -> Motion:
    steps = _repeated(description.steps, maker.rng)
    falls = next((number for number, step in enumerate(steps) if step.action == "fall"), None)
    if falls is None:
        return finished(_chained(maker, None, steps), maker.person)
    fallen, floor_m = _fallen(maker, description, steps[:falls])
    later = [step for step in steps[falls + 1 :] if step.action not in ("lie_down", "stand_up", "fall")]
    if any(step.action == "fall" for step in steps[falls + 1 :]):
        raise InputError("a person falls once in a motion; describe the second fall in a sentence of its own")
    if not later or not any(step.action == "stand_up" for step in steps[falls + 1 :]):
        return fallen
    poses = poses_of(resample(fallen, RATE_HZ))
    poses = replace(poses, root=poses.root - [0.0, 0.0, sole_m(maker.person)])
    maker = replace(maker, person=replace(maker.person, skeleton=poses.skeleton))
    whole = Piece(poses=poses, planted=np.zeros((len(poses), 2, 2), bool), notes=fallen.origin)
    begins = tuple((name, round(begin_s * RATE_HZ)) for name, begin_s in fallen.activities)
    return finished(_chained(maker, Floored(whole, floor_m, highest_m=floor_m, begins=begins), later), maker.person)


@dataclass(frozen=True, slots=True)
class Floored:
    """The motion that is made so far, and the floor and the posture in which it ends."""

    piece: Piece
    floor_m: float = 0.0
    lowest_m: float = 0.0
    """Height of the lowest floor that was stood on [m]."""
    highest_m: float = 0.0
    posture: Posture = "standing"
    lasting: bool = False
    """Whether it is a single step that has the duration which was asked for."""
    begins: Begins = ()
    """Actions of its steps, and their first frames."""


def _chained(maker: Maker, whole: Floored | None, steps: Sequence[Step]) -> Floored:
    """The motion made so far, followed by the steps one after another."""
    alone = len(steps) == 1 and whole is None
    for of_key_poses, group in groupby(steps, key=partial(_is_made, store=maker.store)):
        group_steps = list(group)
        if of_key_poses:
            whole = _with_made(maker, whole, group_steps, begins="standing" if whole is not None else None)
            continue
        if whole is not None and whole.posture != "standing":
            whole = _with_made(maker, whole, [Step(action="stand_up")], begins=whole.posture)
        for step in group_steps:
            # The main step has a full duration, and other steps a part of it.
            piece = _of_clips(maker, step, alone or isinstance(step, Description))
            piece = piece.noted(*exceeded(step, (len(piece) - 1) / RATE_HZ))
            begins = doing(step.action, piece.poses.world()[0], RATE_HZ)
            if whole is None:
                whole = Floored(piece, lasting=step.duration_s is not None, begins=begins)
            else:
                piece = edits.shifted(piece, np.array([0.0, 0.0, whole.floor_m]))
                piece, begins = _continued(whole, piece, begins)
                whole = replace(whole, piece=piece, lasting=False, begins=begins)
    assert whole is not None, "a description has a step"
    return whole


def _with_made(maker: Maker, whole: Floored | None, steps: Sequence[Step], *, begins: Posture | None) -> Floored:
    """The motion made so far, followed by steps that are made of key poses."""
    person = maker.person
    handed = "left" if person.left_handed else "right"
    performance = make(steps, person.skeleton, rng=maker.rng, handed=handed, tempo=person.tempo, begins=begins)
    before = whole.floor_m if whole is not None else 0.0
    rise = before - performance.floors_m[0]
    piece = Piece(poses=performance.poses, planted=performance.planted, notes=performance.notes)
    piece = edits.shifted(piece, np.array([0.0, 0.0, rise]))
    all_begin = performance.does
    if whole is not None:
        piece, all_begin = _continued(whole, piece, all_begin)
    floor_m = rise + performance.floors_m[1]
    lowest, highest = (whole.lowest_m, whole.highest_m) if whole is not None else (0.0, 0.0)
    return Floored(piece, floor_m, min(lowest, floor_m), max(highest, floor_m), performance.ends, begins=all_begin)


def _continued(whole: Floored, piece: Piece, begins: Begins) -> tuple[Piece, Begins]:
    """The motion made so far and the next piece, joined where they come nearest to each other, and the first frames of all steps:
    a walk halts before a piece that begins at rest, and begins with short slow steps after one that ends at rest. A lasting step
    keeps its duration, and no rest follows it."""
    late = max(0, _at_rest(piece) - round(PROMPT_S * RATE_HZ)) if whole.lasting else 0
    piece = piece.part(late, len(piece))
    before, after = halted(whole.piece, piece), begun(whole.piece, piece)
    early = max(0, len(before) - len(whole.piece)) if whole.lasting else 0
    before = before.part(early, len(before))
    search = PROMPT_S if whole.lasting else SEARCH_S
    last = range(max(2, len(before) - round(search * RATE_HZ)), len(before))
    first = range(1 if after is piece else max(1, min(round(search * RATE_HZ), len(after) - 30)))
    cut, start, _ = best_seam(before.poses, after.poses, last, first)
    earlier = ((name, max(0, frame - early)) for name, frame in whole.begins if frame - early <= cut)
    later = ((name, cut + 1 + max(0, frame - late - start)) for name, frame in begins)
    return joined([before.part(0, cut + 1), after.part(start, len(after))], blend_s=SEAM_S), (*earlier, *later)


def _at_rest(piece: Piece) -> int:
    """Number of frames at the beginning of a piece in which the hips do not move."""
    moves = np.linalg.norm(np.diff(piece.poses.root, axis=0), axis=1) * RATE_HZ > AT_REST_MPS
    return int(moves.argmax()) if moves.any() else 0


def _of_clips(maker: Maker, step: Step, alone: bool) -> Piece:
    """A step made of clips, with planted feet; a gait of a type is a changed walk."""
    if step.type not in GAIT_TYPES:
        if step.action == "dance":
            return _danced(maker, step, alone)
        piece = lively(made_of_clips(maker, step, alone=alone), maker.person, maker.rng)
        return replace(piece, poses=plant(piece.poses, piece.planted, floor_m=0.0))
    straight = step.model_copy(update={"type": None, "body_part": None, "side": None, "direction": None})
    walk = made_of_clips(maker, straight, alone=alone)
    poses, note = _disturbed(maker, step.type, step.side, plant(walk.poses, walk.planted, floor_m=0.0))
    piece = Piece(poses=poses, planted=contacts(poses), notes=(*walk.notes, note))
    piece = directed(maker, lively(piece, maker.person, maker.rng, quiet=0.5), step)
    if step.duration_s is not None:
        piece = piece.part(0, round(step.duration_s * RATE_HZ) + 1)
    return replace(piece, poses=plant(piece.poses, piece.planted, level=False, floor_m=0.0))


def _disturbed(maker: Maker, type: GaitType, side: Side | None, walk: Poses) -> tuple[Poses, str]:
    """A patient's gait, as severe as the filter needs to tell it from a normal one, and a note on that."""
    from t2d_rt.motion.vary.abnormal import abnormal_walk

    severity, patient = float(maker.rng.uniform(LEAST_SEVERITY, 1)), int(maker.rng.integers(2**63))
    while True:
        rng = np.random.default_rng(patient)
        poses = abnormal_walk(walk, type, severity=severity, rng=rng, side=side)
        if severity >= 1 or not check_motion(motion_of(poses), expected="walking").passed:
            return poses, f"{type} gait, severity {severity:.2f}"
        severity = min(1.0, severity + MORE_SEVERE)


def _danced(maker: Maker, step: Step, alone: bool) -> Piece:
    """A dance with planted feet; it is drawn again if it does not pass the filter."""
    # A dancer's arms already reach as far as they can.
    dancer = replace(maker.person, vigour=min(maker.person.vigour, 1.0))
    for _ in range(DANCES):
        piece = lively(made_of_clips(maker, step, alone=alone), dancer, maker.rng)
        piece = replace(piece, poses=plant(piece.poses, piece.planted, floor_m=0.0))
        if check_motion(motion_of(piece.poses)).passed:
            break
    return piece


def _fallen(maker: Maker, description: Description, before: Sequence[Step]) -> tuple[Motion, float]:
    """What comes before a fall, the fall, and getting up if the description asks for it; and the height of its floor [m]."""
    from t2d_rt.motion.generate.falls import NoFall, fall, plan_of

    store = maker.store
    getups = [motion_of(store.piece(clip).poses) for clip in store.segments if clip.kind in ("faceup", "facedown")]
    direction = next(step.direction for step in description.steps if step.action == "fall")
    outcome: tuple[Motion, Motion, float] | None = None
    toppled: str | None = None
    lasting_s = before[-1].duration_s if before else None
    for attempt in range(ATTEMPTS):
        plan = plan_of(description, int(maker.rng.integers(2**31)))
        if attempt == 1 and before and before[-1].action == "run":
            # Nobody in full run falls back or aside: the person slows down to a walk first.
            before, lasting_s = [*before, Step(action="walk", duration_s=LEAD_S[0])], None
        if lasting_s is None:
            lead, floor_m = _lead(maker, description, before, plan.type)
        else:  # it begins to fall when the last step has lasted as long as the sentence says
            further = before[-1].model_copy(update={"duration_s": lasting_s + FURTHER_S})
            lead, floor_m = _lead(maker, description, [*before[:-1], further], plan.type)
            plan = replace(plan, time_s=max(lead.duration_s - FURTHER_S, 0.0))
        try:
            fallen = fall(lead, plan, getups)
        except NoFall:  # some leads and plans do not come to a fall like a person's
            if attempt == ATTEMPTS - 1 and outcome is None:
                raise
            continue
        toppled = detect_fall(fallen).direction
        outcome = fallen, lead, floor_m
        # The physics lands the body on the side that is asked for; only in some of the attempts it also topples that way.
        # A trip keeps the walk's momentum and never topples aside.
        hopeless = plan.type == "trip" and direction in ("left", "right")
        if toppled == TOPPLES.get(direction or "", toppled) or hopeless or attempt >= DIRECTED_ATTEMPTS - 1:
            break
    assert outcome is not None, "the last attempt raises"
    fallen, lead, floor_m = outcome
    origin = (*lead.origin, *(note for note in fallen.origin if note not in lead.origin))
    if toppled != TOPPLES.get(direction or "", toppled):
        unmet = f"a fall {direction}; the body topples {toppled} and lands on the side that was asked for"
        origin = (*origin, f"{NOT_MADE}{unmet}")
    return replace(fallen, joints=fallen.joints + [0.0, 0.0, floor_m], origin=origin), floor_m


def _lead(maker: Maker, description: Description, before: Sequence[Step], falls_by: str) -> tuple[Motion, float]:
    """What comes before a fall, with a walk if the foot is to slip or to be caught in one, and how far it climbed [m].

    The floor of the fall is at 0, and lower floors lie below it.
    """
    if not before and falls_by == "collapse" and maker.rng.random() < 0.5:
        before = [Step(action="stand", duration_s=float(maker.rng.uniform(*LEAD_S)))]
    elif not before or (falls_by != "collapse" and before[-1].action not in ("walk", "run")):
        speed = description.speed if description.speed != "slow" else "normal"
        before = [*before, Step(action="walk", speed=speed, duration_s=float(maker.rng.uniform(*LEAD_S)))]
    whole = _chained(maker, None, before)
    return finished(whole, maker.person, base_m=whole.floor_m), whole.floor_m - whole.lowest_m


def finished(whole: Floored, person: Individual, *, base_m: float | None = None) -> Motion:
    """A motion whose feet do not slide at the seams either, with the floor at 0: the lowest one, or that at the height `base_m`."""
    piece = whole.piece
    level = whole.highest_m == whole.lowest_m
    poses = plant(piece.poses, piece.planted, level=False, floor_m=whole.lowest_m if level else None)
    rise = sole_m(person) - (whole.lowest_m if base_m is None else base_m)
    motion = motion_of(replace(poses, root=poses.root + [0.0, 0.0, rise]), origin=piece.notes)
    return replace(motion, activities=_activities(whole.begins, len(poses)))


def _activities(begins: Begins, count: int) -> tuple[tuple[str, float], ...]:
    """Actions in `count` frames and the times from which they are done [s]; too short a rest belongs to the action before it."""
    activities: list[tuple[str, int]] = []
    for (name, frame), (_, stop) in pairwise((*begins, ("", count))):
        short = stop - frame <= (SHORTEST_REST_S * RATE_HZ if name in RESTS.values() and activities else 0)
        if not short and (not activities or activities[-1][0] != name):
            activities.append((name, frame))
    return tuple((name, frame / RATE_HZ) for name, frame in activities)
