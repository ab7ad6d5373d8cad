"""Draw a person from a seed (stature, proportions, handedness, tempo, habits), and make pieces of clips for this person."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from t2d_rt.core.checks import number
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import listing, resource
from t2d_rt.motion import quaternions
from t2d_rt.motion.descriptions.slots import Step, Subject
from t2d_rt.motion.generate.chain import Piece, from_rotation_vector, swung
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.store import RATE_HZ, Segment, Store
from t2d_rt.motion.interpolate import wander
from t2d_rt.motion.kinematics import INDEX, NAMES, Skeleton, retargeted, skeleton_of
from t2d_rt.types.motion import CANONICAL_JOINTS, OPTIONAL_JOINTS, Breathing

# --- stature, proportions, handedness, tempo and habits of one person, drawn from a seed ---


STATURE_M: dict[Subject, tuple[tuple[str, float, float], ...]] = {
    "person": (("adult", 1.757, 0.072), ("woman", 1.618, 0.069)),
    "man": (("man", 1.757, 0.072),),
    "woman": (("woman", 1.618, 0.069),),
    "child": (("child", 1.26, 0.09),),
    "old_person": (("old", 1.66, 0.085),),
    "heavy_person": (("heavy", 1.72, 0.085),),
}
"""Bodies by subject, with mean and standard deviation of their stature [m]: adults of the United States (Fryar, Gu, Ogden, Flegal
2016: men 175.7 cm, women 161.8 cm, old ones 2 to 4 cm less), children of 6 to 9 years."""

LEGS, ARMS, WIDTHS = 0.018, 0.03, 0.03
"""Standard deviations of the logarithms of lengths of legs against the trunk, of arms, and of breadths of hips and shoulders at one
stature (Gordon et al. 2014, ANSUR II: crotch height given stature 1.8 %, arm length 2.8 %, biacromial breadth 3.5 %)."""

SHOULDER_RAD, ELBOW_RAD, WRIST_RAD = (0.15, 0.12, 0.05), (0.1, 0.1, 0.1), (0.08, 0.08, 0.08)

POSTURE_RAD = {
    "spine1": (0.02, 0.02, 0.02), "spine2": (0.02, 0.02, 0.02), "spine3": (0.045, 0.06, 0.045), "neck": (0.07, 0.08, 0.07),
    "head": (0.05, 0.1, 0.05), "left_shoulder": SHOULDER_RAD, "right_shoulder": SHOULDER_RAD, "left_elbow": ELBOW_RAD,
    "right_elbow": ELBOW_RAD, "left_wrist": WRIST_RAD, "right_wrist": WRIST_RAD,
}  # fmt: skip
"""Standard deviations of a person's habitual posture about the joint's axes forward, left and up in the T-pose [rad]. Five
recorded walkers differ by 0.16, 0.13 and 0.04 (upper arms: out, twist, ahead), and by 0.04 and 0.11 (heads: sideward, nod)."""

MOST_INWARD_RAD = 0.08
"""Greatest angle by which a habit brings an arm nearer to the body."""

RESTING_HZ, RESTING_DEPTH_M = (0.2, 0.35), (0.004, 0.012)
"""Breaths per second of people at rest, and how far the front of the trunk comes forward in one: in five people who sat, the ribs
moved by 3 to 5 mm, the abdomen almost straight forward (De Groote et al. 1997, J. Appl. Physiol. 83: 1531); radars measure up to
12 mm (Shafiq and Veluvolu 2014, Sci. Rep. 4: 5093)."""

SPINE = "lower_back", "spine1", "spine2", "spine3", "neck", "head", "head_top"

SWAY = 0.35
"""Slow variation of the angles of `POSTURE_RAD` in time, over their spread between persons."""

SLOW_HZ = 0.15, 0.6
"""Band of the frequencies of that variation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Individual:
    """One person, as drawn from a seed."""

    body: str
    """Name of a shipped body that suits the person."""
    stature_m: float
    skeleton: Skeleton
    left_handed: bool
    tempo: float
    """Factor of the pace of movements, beside the effect of leg length."""
    vigour: float
    """Factor of the swing of the arms."""
    habit: np.ndarray
    """Rotation vectors (28, 3) [rad] of habitual posture."""
    breathing: Breathing


def individual(
    subject: Subject, rng: np.random.Generator, *, body: str | None = None, stature_m: float | None = None
) -> Individual:
    """A person drawn for a subject; a body and a stature [m] that are given are kept. Raises an InputError if they are wrong."""
    name, height_m = drawn_person(subject, rng)
    if stature_m is not None:
        height_m = number("stature_m", stature_m, 0.6, 2.4, unit="m")
    bodies = [file.removesuffix(".npz") for file in listing("meshes", ".npz")]
    shape, at, bmi = (None, "", "") if body is None else body.partition("@")
    if shape is not None and shape not in bodies:
        raise InputError(
            f"no body {body!r}; choose one of {', '.join(bodies)}, or one with a body mass index as man@31.5"
        )
    if at and not re.fullmatch(r"[1-4]\d(\.\d+)?", bmi):
        raise InputError(f"behind the @ of body {body!r} must stand a body mass index, 10 to 50 kg/m^2, as in man@31.5")
    name = body or (name if name in bodies else "adult")
    breaths = rng.spawn(1)[0].random(3)
    normal = rng.standard_normal(6)
    habit = np.zeros((len(NAMES), 3))
    for joint, size in POSTURE_RAD.items():
        habit[INDEX[joint]] = np.array(size) * np.clip(rng.standard_normal(3), -2, 2)
    for joint, sign in (("left_shoulder", 1.0), ("right_shoulder", -1.0)):
        habit[INDEX[joint], 0] = sign * max(sign * habit[INDEX[joint], 0], -MOST_INWARD_RAD)
    return Individual(
        body=name,
        stature_m=height_m,
        skeleton=_proportioned(_rest(shape or name), height_m, normal[:3]),
        left_handed=bool(rng.random() < 0.1),
        tempo=float(np.exp(0.05 * normal[3])),
        vigour=float(np.exp(0.2 * np.clip(normal[4], -2, 2))),
        habit=habit,
        breathing=Breathing(
            rate_hz=float(np.interp(breaths[0], (0, 1), RESTING_HZ)),
            depth_m=float(np.interp(breaths[1], (0, 1), RESTING_DEPTH_M)),
            phase_rad=2 * np.pi * float(breaths[2]),
        ),
    )


def drawn_person(subject: Subject, rng: np.random.Generator, *, body: str | None = None) -> tuple[str, float]:
    """Body and stature [m], drawn for a subject or for a given body."""
    of_body = [kind for kinds in STATURE_M.values() for kind in kinds if kind[0] == body]
    kinds = STATURE_M[subject] if body is None or not of_body else of_body
    name, mean, spread = kinds[int(rng.integers(len(kinds)))]
    return name, mean + spread * float(np.clip(rng.standard_normal(), -2.5, 2.5))


def sole_m(person: Individual) -> float:
    """Height of the ball's joint over the floor of a foot that stands flat [m]."""
    return 0.0146 * person.stature_m  # of the adult template: 27 mm of 1.84 m


def lively(piece: Piece, person: Individual, rng: np.random.Generator, *, quiet: float = 1.0) -> Piece:
    """The piece with the person's posture, swing of the arms and slow variation; `quiet` scales what is added."""
    poses = piece.poses
    times = np.arange(len(poses)) / poses.rate_hz
    local = poses.local.copy()
    for name, spread in POSTURE_RAD.items():
        joint = INDEX[name]
        rotation = local[:, joint]
        if name.endswith(("shoulder", "elbow")):
            rotation = swung(rotation, 1 + quiet * (person.vigour - 1), poses.rate_hz)
        wave = wander(rng, times, 3, SLOW_HZ, 0.5)
        added = quiet * (person.habit[joint] + SWAY * np.array(spread) * wave)
        local[:, joint] = quaternions.multiply(rotation, from_rotation_vector(added))
    return piece.posed(local=quaternions.normalise(local))


@functools.cache
def _rest(body: str) -> Skeleton:
    with np.load(resource("meshes", f"{body}.npz"), allow_pickle=False) as data:
        names, joints = [str(name) for name in data["joint_names"]], data["joints"].astype(float)
    if names != [*CANONICAL_JOINTS, *OPTIONAL_JOINTS]:
        raise InputError(f"body {body!r} has other joints than were expected; install t2d-rt again")
    return skeleton_of(dict(zip(names, joints, strict=True)))


def _proportioned(rest: Skeleton, stature_m: float, normal: np.ndarray) -> Skeleton:
    """The rest skeleton scaled to a stature, with lengths of legs, arms and breadths varied by normal draws (3,)."""
    factors = np.ones((len(NAMES), 3))
    legs, arms, widths = np.exp(np.array([LEGS, ARMS, WIDTHS]) * np.clip(normal, -2.5, 2.5))
    for side in ("left", "right"):
        for joint in ("knee", "ankle"):
            factors[INDEX[f"{side}_{joint}"]] = legs
        for joint in ("elbow", "wrist", "hand"):
            factors[INDEX[f"{side}_{joint}"]] = arms
        for joint in ("hip", "collar", "shoulder"):
            factors[INDEX[f"{side}_{joint}"], 1] = widths
    offsets = rest.offsets * factors
    # Stature of a skeleton whose spine is upright in the rest pose; of the adult template within 1 mm.
    trunk = sum(offsets[INDEX[name], 2] for name in SPINE)
    tall = float((_legs_m(offsets) + trunk) * 1.004)
    offsets = offsets * (stature_m / tall)
    offsets[0] = 0.0
    offsets[0, 2] = float(_legs_m(offsets))
    return Skeleton(offsets=offsets)


def _legs_m(offsets: np.ndarray) -> np.floating[Any]:
    """Height of the pelvis over the balls of the feet in the rest pose [m], mean of both sides."""
    chains = [[f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "foot")] for side in ("left", "right")]
    return -np.mean([sum(offsets[INDEX[name], 2] for name in chain) for chain in chains])


# --- the maker of pieces from clips, and quiet standing, which other moves use ---


@dataclass(frozen=True, slots=True)
class Maker:
    """Makes pieces from clips, for a person, with random numbers."""

    store: Store
    person: Individual
    rng: np.random.Generator

    def segments(self, action: str, *kinds: str) -> list[Segment]:
        """Segments of an action, of the `kinds` if some are named; raises an InputError if there are none."""
        clips = [clip for clip in self.store.segments if clip.action == action and (not kinds or clip.kind in kinds)]
        if not clips:
            raise InputError(
                f"the library has no clip of {action}{' ' + '/'.join(kinds) if kinds else ''}; add some with t2d-rt library add"
            )
        return clips

    def piece(self, segment: Segment, *, mirror: bool | None = None) -> Piece:
        """A segment on the person's own skeleton, at the tempo of their legs, along +x; without `mirror`, mirroring is drawn."""
        piece = self.store.piece(segment)
        leg_m = piece.poses.skeleton.leg_m
        if mirror if mirror is not None else bool(self.rng.random() < 0.5):
            piece = edits.mirrored(piece)
        piece = replace(piece, poses=retargeted(piece.poses, self.person.skeleton))
        piece = edits.tempo(piece, float(np.sqrt(leg_m / self.person.skeleton.leg_m)))
        return edits.aligned(piece)

    def draw(self, segments: Sequence[Segment], weights: Sequence[float] | None = None) -> Segment:
        """One of the segments, drawn with weights if some are given."""
        chances = None if weights is None else np.asarray(weights) / np.sum(weights)
        return segments[int(self.rng.choice(len(segments), p=chances))]


def stand(maker: Maker, step: Step, duration_s: float, *, clip: str = "") -> Piece:
    """Quiet standing: a clip played to and fro; if `clip` is given, of that recording or else of one that lacks its action."""
    segments = maker.segments("stand")
    if clip:
        action = next(part.action for part in maker.store.segments if part.clip == clip and part.action != "stand")
        busy = {part.clip for part in maker.store.segments if part.action == action}
        near = [part for part in segments if part.clip == clip] or [part for part in segments if part.clip not in busy]
        segments = near or segments
    piece = maker.piece(maker.draw(segments))
    count = round(duration_s * RATE_HZ) + 1
    phase = np.arange(count) * 0.9 + maker.rng.uniform(0, len(piece))
    period = 2 * (len(piece) - 1)
    # To and fro without a corner: a sine of the same swing and mean pace.
    frames = (len(piece) - 1) * (0.5 - 0.5 * np.cos(2 * np.pi * phase / (1.6 * period)))
    whole = edits.retimed(piece, frames)
    return replace(whole, planted=np.ones_like(whole.planted))
