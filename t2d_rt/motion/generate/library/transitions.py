"""How walks and runs go on in others of their kind, come to a halt, and begin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.motion.easing import minimum_jerk
from t2d_rt.motion.generate.chain import CROSSING_S, Piece, best_seam, crossed, joined
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.store import RATE_HZ

HALT_S = 1.2
"""Time in which a walk comes to a halt: two steps (Bishop et al. 2002)."""


START_S = 1.0
"""Time in which a walk gets up its speed (Breniere, Do 1986: about a step)."""

AT_REST_MPS = 0.3
"""Speed of the pelvis of one who does not walk."""

CROSSES_AT, LEAST_GAIN_S = 1.3, 0.5
"""A seam away from the ends of clips is taken up to so many times the distance of poses of the best one, and where what follows it
is longer than what it replaces by so much: a clip that hardly holds a stride is nearest to itself a few frames on."""


@dataclass(frozen=True, slots=True)
class Seam:
    """Where a gait goes on in another piece: frame `cut` of the whole is like frame `start` of the piece."""

    whole: Piece
    found: Piece
    cut: int
    start: int
    apart_m: float
    crosses: bool
    """Whether both have frames enough about the seam to go over from one to the other."""

    def joined(self) -> Piece:
        """The whole and what follows."""
        if self.crosses:
            return crossed(self.whole, self.found, self.cut, self.start)
        rest = self.found.part(self.start + 1, len(self.found))
        return joined([self.whole.part(0, self.cut + 1), rest], turn=False)


def best_crossing(whole: Piece, found: Piece) -> Seam:
    """The best seam at which two gaits cross; where a clip hardly holds a stride, and only its ends match, one at those."""
    length, beyond = min(len(whole), len(found)), round(0.5 * CROSSING_S * RATE_HZ)
    earliest, latest = max(len(whole) - round(0.5 * length), 3), round(0.45 * len(found))

    def best(margin: int) -> tuple[int, int, float]:
        after, before = range(earliest, len(whole) - margin, 2), range(margin, max(latest, margin + 2), 2)
        return best_seam(whole.poses, found.poses, after, before)

    at_ends = best(2)
    within = best(beyond) if length > 4 * beyond else at_ends
    gained = within[0] - within[1] - (len(whole) - len(found))
    crosses = length > 4 * beyond and within[2] < CROSSES_AT * at_ends[2] and gained > LEAST_GAIN_S * RATE_HZ
    return Seam(whole, found, *(within if crosses else at_ends), crosses)


def halted(piece: Piece, following: Piece) -> Piece:
    """A walk brought to a halt before a piece that begins at rest: its last steps shorten and slow down; anything else as it is."""
    pace = pace_mps(piece, -1)
    if pace < AT_REST_MPS or pace_mps(following, 0) > 0.5 * pace:
        return piece
    last = min(len(piece) - 1, round(HALT_S * RATE_HZ))
    falling = minimum_jerk((np.arange(len(piece)) - (len(piece) - last)) / last)
    short = edits.strided(piece, 1 - 0.9 * falling)
    # Time runs at 0.55 of its pace at last, as it does at first when a walk begins.
    shown = np.concatenate([[0.0], np.cumsum(1 / (1 - 0.45 * falling[:-1]))])
    return edits.retimed(short, np.interp(np.arange(int(shown[-1]) + 1), shown, np.arange(len(piece))))


def begun(before: Piece, piece: Piece) -> Piece:
    """A walk or run that begins with short and slow steps after a piece that ends at rest; anything else as it is."""
    pace = pace_mps(piece, 0)
    if pace < AT_REST_MPS or pace_mps(before, -1) > 0.5 * pace:
        return piece
    rising = minimum_jerk(np.arange(len(piece)) / (START_S * RATE_HZ))
    slow = edits.strided(piece, 0.25 + 0.75 * rising)
    # Time runs at 0.55 of its pace at first.
    frames = np.concatenate([[0.0], np.cumsum(0.55 + 0.45 * rising)])
    return edits.retimed(slow, frames[frames <= len(piece) - 1])


def pace_mps(piece: Piece, end: int) -> float:
    """Horizontal speed of the pelvis over a third of a second at the begin (0) or at the end (-1)."""
    frames = min(20, len(piece))
    part = piece.poses.root[:frames, :2] if end == 0 else piece.poses.root[-frames:, :2]
    return float(np.linalg.norm(part[-1] - part[0]) * RATE_HZ / max(frames - 1, 1))
