"""What makes pieces from clips: the store, the person and the random numbers, and quiet standing, of which every move makes use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.chain import Piece
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.individual import Individual
from t2d_rt.motion.generate.library.store import RATE_HZ, Segment, Store
from t2d_rt.motion.kinematics import retargeted


@dataclass(frozen=True, slots=True)
class Maker:
    """What makes pieces: the clips, the person and the random numbers."""

    store: Store
    person: Individual
    rng: np.random.Generator

    def segments(self, action: str, *kinds: str) -> list[Segment]:
        """Those of an action."""
        found = [each for each in self.store.segments if each.action == action and (not kinds or each.kind in kinds)]
        if not found:
            raise InputError(
                f"the library has no clip of {action}{' ' + '/'.join(kinds) if kinds else ''}; add some with t2d-rt library add"
            )
        return found

    def piece(self, segment: Segment, *, mirror: bool | None = None) -> Piece:
        """A segment on the person's own skeleton, at the tempo of their legs, along +x; mirrored or not as drawn."""
        piece = self.store.piece(segment)
        leg_m = piece.poses.skeleton.leg_m
        if mirror if mirror is not None else bool(self.rng.random() < 0.5):
            piece = edits.mirrored(piece)
        piece = replace(piece, poses=retargeted(piece.poses, self.person.skeleton))
        piece = edits.tempo(piece, float(np.sqrt(leg_m / self.person.skeleton.leg_m)))
        return edits.aligned(piece)

    def draw(self, segments: Sequence[Segment], weights: Sequence[float] | None = None) -> Segment:
        """One of them."""
        chances = None if weights is None else np.asarray(weights) / np.sum(weights)
        return segments[int(self.rng.choice(len(segments), p=chances))]


def stand(maker: Maker, step: Step, duration_s: float) -> Piece:
    """Quiet standing: a clip of it to and fro."""
    piece = maker.piece(maker.draw(maker.segments("stand")))
    count = round(duration_s * RATE_HZ) + 1
    phase = np.arange(count) * 0.9 + maker.rng.uniform(0, len(piece))
    period = 2 * (len(piece) - 1)
    # To and fro without a corner: a sine of the same swing and mean pace.
    frames = (len(piece) - 1) * (0.5 - 0.5 * np.cos(2 * np.pi * phase / (1.6 * period)))
    whole = edits.retimed(piece, frames)
    return replace(whole, planted=np.ones_like(whole.planted))
