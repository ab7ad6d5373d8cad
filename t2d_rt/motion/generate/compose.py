"""A description's steps, each by what can make it, as one motion of one person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Literal, cast

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.motion.contacts import contacts, plant
from t2d_rt.motion.descriptions.slots import GAIT_TYPES, Description, Step
from t2d_rt.motion.generate.chain import Piece, best_seam, joined
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.individual import Individual, individual, lively, sole_m
from t2d_rt.motion.generate.library.moves import ACTIONS, Maker, begun, halted, made_of_clips, own_clips
from t2d_rt.motion.generate.library.store import RATE_HZ, Store, shipped
from t2d_rt.motion.interpolate import resample
from t2d_rt.motion.kinematics import motion_of, poses_of
from t2d_rt.types.motion import Motion

By = Literal["library", "gaits", "made", "physics"]

ALLOWED: dict[str | None, tuple[By, ...]] = {
    None: ("library", "gaits", "made", "physics"), "library": ("library", "gaits"),
    "physics": ("library", "gaits", "made", "physics"),
}  # fmt: skip
"""What each provider makes; one that simulates falls needs what comes before them."""

LEAD_S = 2.4, 3.6
"""Duration of the walk or stance before a fall where the description says nothing of it."""

ATTEMPTS = 4
"""Leads and plans that are tried until the person falls."""

SEARCH_S = 0.5
"""Last part of a step in which the next one may begin: a step of a walk."""

SEAM_S = 0.5
"""Time in which a difference between steps dies out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Composer:
    """Makes motions of descriptions: all of it by `only` one provider, or each step by what suits it."""

    only: str | None = None
    body: str | None = None
    stature_m: float | None = None
    library: str | Path | None = None

    def __call__(self, description: Description, *, seed: int) -> Motion:
        """The motion of a description."""
        rng = np.random.default_rng([seed, *description.sentence.encode()])
        store = self._store()
        refused = [step.action for step in description.steps if maker_of(step, store) not in ALLOWED[self.only]]
        if refused or (self.only == "physics" and description.action != "fall"):
            raise InputError(
                f"provider {self.only} does not make {(refused or [description.action])[0].replace('_', ' ')}; "
                "leave the provider out, so that each step is made by what suits it"
            )
        person = individual(description.subject, rng, body=self.body, stature_m=self.stature_m)
        motion = _composed(Maker(store, person, rng), description)
        made = f"made for {description.sentence!r}, class {description.activity}, by {self.only or 'auto'}, seed {seed}"
        who = f"{description.subject.replace('_', ' ')} of {person.stature_m:.2f} m, body {person.body}"
        return replace(
            motion, origin=(made, who, *motion.origin), report=f"generated; {who}; floor at 0 m", placed=False
        )

    def _store(self) -> Store:
        from t2d_rt.motion.generate.library.users import with_users

        return with_users(shipped(), self.library)


def maker_of(step: Step, store: Store) -> By:
    """What makes a step; a user's clips of an action go before key poses."""
    if step.action == "fall":
        return "physics"
    if step.type in GAIT_TYPES:
        return "gaits"
    if step.action in ("walk", "run") and step.direction in ("up", "down"):
        return "made"
    return "library" if step.action in ACTIONS or own_clips(store, step) else "made"


def _composed(maker: Maker, description: Description) -> Motion:
    steps = description.steps
    falls = next((number for number, step in enumerate(steps) if step.action == "fall"), None)
    if falls is None:
        return finished(_chained(maker, None, steps, alone=len(steps) == 1), maker.person)
    fallen = _fallen(maker, description, steps[:falls])
    rest = [step for step in steps[falls + 1 :] if step.action not in ("lie_down", "stand_up", "fall")]
    if not rest or not any(step.action == "stand_up" for step in steps[falls + 1 :]):
        return fallen
    poses = poses_of(resample(fallen, RATE_HZ))
    poses = replace(poses, root=poses.root - [0.0, 0.0, sole_m(maker.person)])
    maker = replace(maker, person=replace(maker.person, skeleton=poses.skeleton))
    whole = Piece(poses=poses, planted=np.zeros((len(poses), 2, 2), bool), notes=fallen.origin)
    return finished(_chained(maker, whole, rest, alone=False), maker.person)


def _chained(maker: Maker, whole: Piece | None, steps: Sequence[Step], *, alone: bool) -> Piece:
    """The steps after one another, after what there is."""
    floor_m, posture = 0.0, None
    for by, group in groupby(steps, key=lambda step: "made" if maker_of(step, maker.store) == "made" else "clips"):
        own = list(group)
        if by == "made":
            from t2d_rt.motion.generate.made import make

            found = make(
                own, maker.person.skeleton, rng=maker.rng, handed="left" if maker.person.left_handed else "right",
                tempo=maker.person.tempo, begins="standing" if whole is not None else None,
            )  # fmt: skip
            rise = floor_m - found.floors_m[0]
            pieces = [
                edits.shifted(
                    Piece(poses=found.poses, planted=found.planted, notes=found.notes), np.array([0.0, 0.0, rise])
                )
            ]
            floor_m, posture = rise + found.floors_m[1], found.ends
        else:
            if posture not in (None, "standing"):
                whole = _risen(maker, cast(Piece, whole), cast(str, posture), floor_m)
                posture = "standing"
            pieces = [edits.shifted(_of_clips(maker, step, alone), np.array([0.0, 0.0, floor_m])) for step in own]
        for piece in pieces:
            whole = piece if whole is None else _continued(whole, piece)
    assert whole is not None, "a description has a step"
    return whole


def _continued(whole: Piece, piece: Piece) -> Piece:
    """The next piece, from where what there is comes nearest to its begin: a walk halts before one that begins at rest, and begins
    with short slow steps after one that ends at rest."""
    before, after = halted(whole, piece), begun(whole, piece)
    last = range(max(2, len(before) - round(SEARCH_S * RATE_HZ)), len(before))
    first = range(1 if after is piece else max(1, min(round(SEARCH_S * RATE_HZ), len(after) - 30)))
    cut, start, _ = best_seam(before.poses, after.poses, last, first)
    return joined([before.part(0, cut + 1), after.part(start, len(after))], blend_s=SEAM_S)


def _risen(maker: Maker, whole: Piece, posture: str, floor_m: float) -> Piece:
    """Standing up from where the last step ended, before one that needs standing."""
    from t2d_rt.motion.generate.made import make

    found = make(
        [Step(action="stand_up")], maker.person.skeleton, rng=maker.rng, handed="left" if maker.person.left_handed else "right",
        tempo=maker.person.tempo, begins=posture,  # type: ignore[arg-type]
    )  # fmt: skip
    piece = edits.shifted(
        Piece(poses=found.poses, planted=found.planted, notes=found.notes), np.array([0.0, 0.0, floor_m])
    )
    return joined([whole, piece], blend_s=SEAM_S)


def _of_clips(maker: Maker, step: Step, alone: bool) -> Piece:
    """A step by clips, planted, a gait of a type changed."""
    if step.type not in GAIT_TYPES:
        piece = lively(made_of_clips(maker, step, alone=alone), maker.person, maker.rng)
        return replace(piece, poses=plant(piece.poses, piece.planted, floor_m=0.0))
    from t2d_rt.motion.vary.abnormal import abnormal_walk

    walk = made_of_clips(maker, step.model_copy(update={"type": None, "body_part": None, "side": None}), alone=alone)
    severity = float(maker.rng.uniform(0, 1))
    poses = abnormal_walk(plant(walk.poses, walk.planted, floor_m=0.0), step.type, severity=severity, rng=maker.rng)
    piece = Piece(
        poses=poses, planted=contacts(poses), notes=(*walk.notes, f"{step.type} gait, severity {severity:.2f}")
    )
    return lively(piece, maker.person, maker.rng, quiet=0.5)


def _fallen(maker: Maker, description: Description, before: Sequence[Step]) -> Motion:
    """What comes before a fall, the fall, and getting up where the description asks for it."""
    from t2d_rt.motion.generate.falls import fall, plan_of

    getups = [
        motion_of(maker.store.piece(each).poses) for each in maker.store.segments if each.kind in ("faceup", "facedown")
    ]
    for attempt in range(ATTEMPTS):
        plan = plan_of(description, int(maker.rng.integers(2**31)))
        lead = _lead(maker, description, before, plan.type)
        try:
            fallen = fall(lead, plan, getups)
        except InputError:  # some leads and plans do not come to a fall like a person's
            if attempt == ATTEMPTS - 1:
                raise
            continue
        break
    return replace(fallen, origin=(*lead.origin, *(note for note in fallen.origin if note not in lead.origin)))


def _lead(maker: Maker, description: Description, before: Sequence[Step], falls_by: str) -> Motion:
    if not before:
        stands = falls_by == "collapse" and maker.rng.random() < 0.5
        speed = description.speed if description.speed != "slow" else "normal"
        before = [Step(action="stand" if stands else "walk", speed=speed, duration_s=float(maker.rng.uniform(*LEAD_S)))]
    return finished(_chained(maker, None, before, alone=len(before) == 1), maker.person)


def finished(piece: Piece, person: Individual) -> Motion:
    """The piece as a motion on the floor whose feet do not slide at the seams either."""
    poses = plant(piece.poses, piece.planted, level=False)
    return motion_of(replace(poses, root=poses.root + [0.0, 0.0, sole_m(person)]), origin=piece.notes)
