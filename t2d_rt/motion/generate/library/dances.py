"""Make dances from clips: phrases of recorded dancers, each going on in the next where poses are alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter

import numpy as np

from t2d_rt.motion.check.measures import contacts, floating_s, jump_m, self_penetration_m, tracks
from t2d_rt.motion.contacts import plant
from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.chain import Piece, features, heading_rad, joined
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.individual import Maker
from t2d_rt.motion.generate.library.store import RATE_HZ, Segment
from t2d_rt.motion.interpolate import minimum_jerk
from t2d_rt.motion.kinematics import motion_of

CIRCLING_RADPS = 0.7
"""Rate [rad/s] at which a dance goes round in a circle on average; faster, standing feet would have to slide."""

STEP_S, ON_BOTH = 0.08, 0.2
"""Time in which a turn gains and loses its pace with a step (a standard deviation), and its pace while both feet stand over that in
a step, because legs that stay behind a turning body cross."""

PHRASE_S = 4.0
"""Longest stretch of one recording before another goes on: eight counts of music at two beats a second."""

TRIES = 6
"""Most phrases drawn until one goes on smoothly; otherwise another recording joins or, if none is left, the smoothest is taken."""

SMOOTH_M = 0.03
"""Deviation of a joint's step from its neighbours' at a seam, at 60 Hz, up to which a phrase goes on smoothly; of recorded
motions it is 0.042 at most (99th percentile)."""

DEEP_M, HOVERS_S, SLIDES_M = 0.07, 0.12, 0.07
"""Greatest depth of limbs in one another from a seam on, time off the floor beyond that of a flight, and slide of a planted foot:
in recorded motions these are 0.081 m, 0.18 s and 0.089 m at most."""

SEAM_S = 0.6
"""Time in which a difference between phrases dies out."""

BEFORE_S = 2.0
"""Time before a seam in which a foot may have come down that slides in it."""

STANDS_S = 0.3
"""Time after a seam in which a foot stands: half of that in which a difference dies out, when most of it has."""

REST_S = 0.8
"""Time at both ends of a dance in which it may begin and end."""

BACK, INTO = 0.25, 0.5
"""Fractions of a phrase: how much of the dance so far it may replace, and where it may be entered at the latest."""


def dance(maker: Maker, step: Step, duration_s: float) -> Piece:
    """A dance of phrases, each going on in the next where poses are alike. They are of one recording, or of more if its phrases do
    not go on smoothly; with all recordings at once, one clip was in two of three dances."""
    unused = maker.segments("dance")
    segments = _segments_of_one_recording(maker, unused)
    pace = {"slow": 0.86, "normal": 1.0, "fast": 1.05}[step.speed] * maker.person.tempo
    count = round(duration_s * RATE_HZ * pace)
    weights = chances(maker, segments)
    whole = _phrase(maker, maker.draw(segments, weights))
    rest_frames = round(REST_S * RATE_HZ)
    while len(whole) < count + 2 * rest_frames:
        continuations: list[tuple[Piece, float]] = []
        while len(continuations) < TRIES and not (continuations and continuations[-1][1] < 1.0):
            continuations.append(_continued(whole, _phrase(maker, maker.draw(segments, weights))))
        longer, rough = min(continuations, key=itemgetter(1))
        if rough >= 1.0 and unused:
            segments += _segments_of_one_recording(maker, unused)
            weights = chances(maker, segments)
            continue
        if not np.isfinite(rough):
            whole = whole.noted("the dance ends early: no phrase goes on smoothly from its last one")
            break
        whole = longer
    whole = edits.paced(_from_rest_to_rest(whole, count), pace)
    if step.direction in ("clockwise", "counterclockwise"):
        sign = 1.0 if step.direction == "counterclockwise" else -1.0
        heading = np.unwrap(heading_rad(whole.poses))
        if sign * (heading[-1] - heading[0]) < 0:
            whole = edits.mirrored(whole)  # the dancer's own spins go the same way
        turn_rad = min(2 * np.pi, CIRCLING_RADPS * len(whole) / RATE_HZ)
        whole = edits.bent(whole, sign * turn_rad * circling(whole))
        whole = whole.noted(f"turned {step.direction} by {np.degrees(turn_rad):.0f} degrees")
    return whole


def _segments_of_one_recording(maker: Maker, unused: list[Segment]) -> list[Segment]:
    """The segments of a recording that is drawn from the `unused` ones and removed from them."""
    sources = maker.store.sources
    recording_of = {segment.clip: (sources[segment.clip].subject, sources[segment.clip].file) for segment in unused}
    recordings = list(dict.fromkeys(recording_of.values()))
    recording = recordings[int(maker.rng.integers(len(recordings)))]
    segments = [segment for segment in unused if recording_of[segment.clip] == recording]
    unused[:] = [segment for segment in unused if recording_of[segment.clip] != recording]
    return segments


def circling(piece: Piece) -> np.ndarray:
    """How far a dance has gone round at each frame (T,), from 0 to 1: it goes in steps, and hardly while both feet stand."""
    from scipy.ndimage import gaussian_filter1d

    stands = np.asarray(piece.planted.any(axis=2))
    both_stand = gaussian_filter1d((stands[:, 0] & stands[:, 1]).astype(float), STEP_S * RATE_HZ, mode="nearest")
    rate = np.gradient(minimum_jerk(np.linspace(0, 1, len(piece)))) * (1 - (1 - ON_BOTH) * both_stand)
    progress = np.cumsum(rate) - rate[0]
    return progress / progress[-1]


def _continued(whole: Piece, phrase: Piece) -> tuple[Piece, float]:
    """A dance that goes on in a phrase where poses are most alike and the same foot stands, and how rough the seam is: up to 1 it
    is as smooth as recorded dances, infinite where no foot stands in both."""
    first = max(1, len(whole) - round(min(BACK * len(phrase), 40)) - 1)
    last = whole.part(first - 1, len(whole))
    begin = phrase.part(0, max(4, round(INTO * len(phrase))))
    last_features, begin_features = features(last.poses), features(begin.poses)
    squares = (last_features**2).sum(1)[:, None] + (begin_features**2).sum(1) - 2 * last_features @ begin_features.T
    # The difference must die out while a foot stands, because in a flight it would change the fall.
    stood = np.asarray(last.planted.any(axis=2))
    stands = np.asarray(begin.planted.any(axis=2) & goes_on_standing(begin)[:, None])
    squares[~(stood[:, None] & stands).any(axis=2)] = np.inf
    squares[0] = squares[:, 0] = np.inf
    cut, start = np.unravel_index(int(squares.argmin()), squares.shape)
    if not np.isfinite(squares[cut, start]):
        return whole, np.inf
    cut_frame = first + int(cut)
    after = joined([whole.part(0, cut_frame), phrase.part(int(start) + 1, len(phrase))], blend_s=SEAM_S)
    return after, roughness(after.part(max(0, cut_frame - round(BEFORE_S * RATE_HZ)), len(after)))


def roughness(seam: Piece) -> float:
    """The largest of what a seam and the phrase after it show, each over its limit: how far a joint deviates from its neighbours in
    time, how deep limbs go into one another, how long the body hovers and how far a planted foot slides; the latter three once feet
    are planted, where it is smooth."""
    rough = jump_m(seam.poses.world()[0]) / SMOOTH_M
    if rough >= 1.0:
        return 1.0 + rough  # a smooth seam is better, even if limbs touch
    body = tracks(motion_of(plant(seam.poses, seam.planted, level=False)))
    slide_m = max((contact.skate_m for contact in contacts(body)), default=0.0)
    return max(rough, float(self_penetration_m(body).max()) / DEEP_M, floating_s(body) / HOVERS_S, slide_m / SLIDES_M)


def goes_on_standing(piece: Piece) -> np.ndarray:
    """Whether a foot stands at a frame and for `STANDS_S` after it, (T,)."""
    from scipy.ndimage import minimum_filter1d

    width = round(STANDS_S * RATE_HZ)
    return minimum_filter1d(piece.planted.any(axis=(1, 2)), width, origin=-(width // 2), mode="nearest")


def _from_rest_to_rest(whole: Piece, count: int) -> Piece:
    """About `count` frames of a dance, from its calmest instant near the beginning, after which a foot goes on standing, to the
    calmest one near the end, because other steps join there."""
    rest_frames = min(round(REST_S * RATE_HZ), len(whole) // 4)
    joints, _ = whole.poses.world()
    calm = -np.linalg.norm(np.gradient(joints, 1 / RATE_HZ, axis=0), axis=-1).mean(axis=1)
    stands = whole.planted.any(axis=(1, 2))
    start = int((calm + 2.0 * stands + 2.0 * goes_on_standing(whole))[: rest_frames + 1].argmax())
    last = min(len(whole) - 1, start + count)
    first = max(start + 1, last - rest_frames)
    stop = first + int((calm + 2.0 * stands)[first : last + 1].argmax())
    return whole.part(start, stop + 1)


def chances(maker: Maker, segments: Sequence[Segment]) -> list[float]:
    """Chances of segments: the same for every recording, and within a recording in proportion to the segments' durations.

    By durations alone the longest recording, a calm one of 15 s, had 43 % of all phrases, and dances were 3 to 6 dB too calm.
    """
    source = maker.store.sources
    recording = [(source[segment.clip].subject, source[segment.clip].file) for segment in segments]
    whole: dict[tuple[str, str], float] = {}
    for segment, name in zip(segments, recording, strict=True):
        whole[name] = whole.get(name, 0.0) + segment.duration_s
    return [segment.duration_s / whole[name] for segment, name in zip(segments, recording, strict=True)]


def _phrase(maker: Maker, segment: Segment) -> Piece:
    """A segment, or a stretch of a long one, from the first to the last instant at which a foot stands."""
    most = round(PHRASE_S * RATE_HZ)
    start = segment.start + int(maker.rng.integers(0, max(segment.stop - segment.start - most, 0) + 1))
    piece = maker.piece(replace(segment, start=start, stop=min(segment.stop, start + most)))
    stands = np.flatnonzero(piece.planted.any(axis=(1, 2)))
    return piece.part(int(stands[0]), int(stands[-1]) + 1) if len(stands) and np.ptp(stands) > RATE_HZ / 2 else piece
