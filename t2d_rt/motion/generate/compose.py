"""A description's steps, each by what can make it, as one motion of one person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Literal

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.motion.contacts import contacts, plant
from t2d_rt.motion.descriptions.slots import Description, Step
from t2d_rt.motion.generate.chain import Piece, joined
from t2d_rt.motion.generate.library.individual import Individual, individual, lively, sole_m
from t2d_rt.motion.generate.library.moves import ACTIONS, Maker, halted, made_of_clips
from t2d_rt.motion.generate.library.store import Store, shipped
from t2d_rt.motion.kinematics import motion_of
from t2d_rt.types.motion import Motion

By = Literal["library", "gaits", "made", "physics"]

TRAVELLING = "walk", "run"


@dataclass(frozen=True, slots=True, kw_only=True)
class Composer:
    """Makes motions of descriptions; `only` one of its ways, or each step by that which suits it."""

    only: str | None = None
    body: str | None = None
    stature_m: float | None = None
    library: str | Path | None = None

    def __call__(self, description: Description, *, seed: int) -> Motion:
        """The motion of a description."""
        rng = np.random.default_rng([seed, *description.sentence.encode()])
        ways = [way_of(step) for step in description.steps]
        allowed = {None: None, "library": {"library", "gaits"}, "physics": {"library", "gaits", "physics"}}[self.only]
        for step, way in zip(description.steps, ways, strict=True):
            if allowed is not None and way not in allowed:
                raise InputError(
                    f"provider {self.only} does not make {step.action}; leave the provider out, so that each step has its own"
                )
        person = individual(description.subject, rng, body=self.body, stature_m=self.stature_m)
        maker = Maker(self._store(), person, rng)
        motion = _chained(maker, description, ways)
        made = f"made for {description.sentence!r}, class {description.activity}, by {self.only or 'auto'}, seed {seed}"
        who = f"{description.subject.replace('_', ' ')} of {person.stature_m:.2f} m, body {person.body}"
        return replace(motion, origin=(made, who, *motion.origin), report=f"generated; {who}; floor at 0 m")

    def _store(self) -> Store:
        if self.library is None:
            return shipped()
        from t2d_rt.motion.generate.library.users import with_users

        return with_users(shipped(), self.library)


def way_of(step: Step) -> By:
    """What makes a step."""
    if step.action == "fall":
        return "physics"
    if step.type is not None:
        return "gaits"
    if step.action in TRAVELLING and step.direction in ("up", "down"):
        return "made"
    return "library" if step.action in ACTIONS else "made"


def _chained(maker: Maker, description: Description, ways: Sequence[By]) -> Motion:
    steps = description.steps
    whole: Piece | None = None
    alone = len(steps) == 1
    for way, group in groupby(zip(steps, ways, strict=True), key=lambda each: each[1]):
        own = [step for step, _ in group]
        if way == "physics":
            raise InputError("falls are not made yet")
        pieces = _made(maker, own) if way == "made" else [_clip_piece(maker, step, alone) for step in own]
        for piece in pieces:
            whole = piece if whole is None else _continued(maker, whole, piece)
    assert whole is not None
    return finished(whole, maker.person)


def _clip_piece(maker: Maker, step: Step, alone: bool) -> Piece:
    if step.type is None:
        return lively(made_of_clips(maker, step, alone=alone), maker.person, maker.rng)
    from t2d_rt.motion.vary.abnormal import abnormal_walk

    walk = made_of_clips(maker, step.model_copy(update={"type": None}), alone=alone)
    severity = float(maker.rng.uniform(0, 1))
    poses = abnormal_walk(plant(walk.poses, walk.planted), step.type, severity=severity, rng=maker.rng)  # type: ignore[arg-type]
    piece = Piece(
        poses=poses, planted=contacts(poses), notes=(*walk.notes, f"{step.type} gait, severity {severity:.2f}")
    )
    return lively(piece, maker.person, maker.rng, quiet=0.5)


def _made(maker: Maker, steps: Sequence[Step]) -> list[Piece]:
    from t2d_rt.motion.generate.made import make

    found = make(
        steps,
        maker.person.skeleton,
        rng=maker.rng,
        handed="left" if maker.person.left_handed else "right",
        tempo=maker.person.tempo,
    )
    return [Piece(poses=found.poses, planted=contacts(found.poses), notes=tuple(found.notes))]


def _continued(maker: Maker, whole: Piece, piece: Piece) -> Piece:
    """The next piece after what there is: a walk comes to a halt before anything that begins on the spot."""
    return joined([halted(maker, whole, piece), piece], blend_s=0.5)


def finished(piece: Piece, person: Individual) -> Motion:
    """The piece as a motion whose feet stand on the floor and do not slide."""
    root = piece.poses.root + [0.0, 0.0, sole_m(person)]
    poses = plant(replace(piece.poses, root=root), piece.planted, floor_m=sole_m(person))
    return motion_of(poses, origin=piece.notes)
