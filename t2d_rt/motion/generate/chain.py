"""Join pieces of motion: each begins where the last one ends, and the difference there dies out smoothly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import TWIST_MPS, runs, soles
from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate import NOT_MADE
from t2d_rt.motion.interpolate import low_pass, minimum_jerk
from t2d_rt.motion.kinematics import INDEX, Poses

BLEND_S = 0.4
"""Time in which a difference at a seam dies out: about one step of a walk."""

FARTHEST, LEAST_FRAMES = 0.7, 6
"""Limit of a velocity at a seam times the time in which it dies out [m or rad], unless the gap is larger: a joint swings farther by
a fifth of it; and the fewest frames of that time."""

MOST_CARRIED = 0.3
"""Greatest distance, over the leg's length, by which a standing foot may be carried at a seam."""

THROWN_RADPS = 8.0
"""Angular velocity of an arm that is thrown up in a jump and cannot swing farther; in walks it reaches 2 to 3 rad/s, in runs 5."""

CROSSING_S = 0.3
"""Time in which a gait passes from one clip to the next at the same phase."""

SWING_HZ, SWING_S = 4.0, 0.4
"""Frequency below which a swing of arms lies, twice a stride's in a run with its first harmonic, and half the time of a swing."""

MOVES_MPS, MOVES_S = 0.1, 0.05
"""Speed [m/s], mean over the joints and smoothed over a time [s], from which a body does something: sway is a fifth of it, a step
some four times as much."""

SHORTEST_REST_S = 0.3
"""Shorter rests belong to what is done before or after them."""

Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """Poses with the contacts of their feet, and notes on where they come from."""

    poses: Poses
    planted: np.ndarray
    """Whether heel and ball of each foot stand, bool (T, 2 sides, 2 heel and ball)."""
    notes: tuple[str, ...] = ()
    """Names of clips, and what was done to them."""

    def __len__(self) -> int:
        return len(self.poses)

    def part(self, start: int, stop: int) -> Piece:
        """The frames of the piece from `start` to before `stop`."""
        return replace(self, poses=self.poses.part(start, stop), planted=self.planted[start:stop])

    def posed(self, *, root: np.ndarray | None = None, local: np.ndarray | None = None) -> Piece:
        """The piece with another track of the root or other rotations."""
        changes = {name: value for name, value in (("root", root), ("local", local)) if value is not None}
        return replace(self, poses=replace(self.poses, **changes))  # type: ignore[arg-type]

    def noted(self, *notes: str) -> Piece:
        """The same piece with further notes."""
        return replace(self, notes=(*self.notes, *notes))


MOST_LONGER = 1.1
"""Factor by which a step may last longer than was asked for before a note says so."""


def exceeded(step: Step, lasts_s: float) -> tuple[str, ...]:
    """A note on a step that lasts longer than was asked for, none if it does not; `lasts_s` is how long it lasts [s]."""
    if step.duration_s is None or lasts_s <= MOST_LONGER * step.duration_s:
        return ()
    return (f"{NOT_MADE}duration {step.duration_s:.3g} s of {step.action.replace('_', ' ')}, which takes longer",)


Begins = tuple[tuple[str, int], ...]
"""Actions by name, each with the frame from which on it is done."""


def doing(action: str, joints: np.ndarray, rate_hz: float, *, before: str = "stand", after: str = "stand") -> Begins:
    """An action from its first movement of the joints (T, J, 3) [m] to its last, and the rests before and after it by name."""
    from scipy.ndimage import gaussian_filter1d

    if len(joints) < 2:  # a posture that the motion begins in is done at once
        return ((action, 0),)
    speed = np.linalg.norm(np.gradient(joints, axis=0), axis=-1).mean(axis=1) * rate_hz
    moves = np.flatnonzero(gaussian_filter1d(speed, MOVES_S * rate_hz) > MOVES_MPS)
    if not len(moves):
        return ((action, 0),)
    first, stop = int(moves[0]), int(moves[-1]) + 1
    rest_frames = SHORTEST_REST_S * rate_hz
    begins = ((before, 0), (action, first)) if first > rest_frames else ((action, 0),)
    return (*begins, (after, stop)) if len(joints) - stop > rest_frames else begins


def heading_rad(poses: Poses) -> np.ndarray:
    """Direction (T,) that the pelvis faces, about the vertical, without jumps of a full turn."""
    ahead = quaternions.rotate(poses.local[:, 0], np.array([1.0, 0.0, 0.0]))
    # For a lying body the pelvis's upward axis shows the heading better than the forward one.
    up = quaternions.rotate(poses.local[:, 0], Z)
    level = ahead + np.where(ahead[:, 2:] < 0, 1.0, -1.0) * np.clip(2 * (np.abs(ahead[:, 2:]) - 0.5), 0, 1) * up
    return np.unwrap(np.arctan2(level[:, 1], level[:, 0]))


def moved(piece: Piece, angle_rad: float, about: np.ndarray, to: np.ndarray) -> Piece:
    """The piece turned about the vertical through the point `about` (2,) [m], which comes to lie at `to` (2,) [m]."""
    spin = quaternions.about_axis(Z, np.array(angle_rad))
    root = quaternions.rotate(spin, piece.poses.root - [*about, 0.0]) + [*to, 0.0]
    local = piece.poses.local.copy()
    local[:, 0] = quaternions.multiply(np.broadcast_to(spin, local[:, 0].shape), local[:, 0])
    return piece.posed(root=root, local=local)


def joined(pieces: Sequence[Piece], *, blend_s: float = BLEND_S, turn: bool = True) -> Piece:
    """All pieces as one: each begins where the one before it ends, at its last velocity, and with `turn` in the same heading.

    At a seam the difference of all joints' rotations and of the root, and that of their velocities, is added to what follows and
    dies out within `blend_s`, or the piece's own length where that is shorter: position and velocity go on without a jump.
    """
    whole = pieces[0]
    for piece in pieces[1:]:
        whole = _appended(whole, piece, blend_s, turn)
    return whole


def _appended(first: Piece, second: Piece, blend_s: float, turn: bool) -> Piece:
    a, b = first.poses, second.poses
    if a.rate_hz != b.rate_hz:
        raise ValueError("pieces have one rate")
    spin = heading_rad(a)[-1] - heading_rad(b)[0] if turn else 0.0
    step = (a.root[-1] - a.root[-2]) if len(a) > 1 else np.zeros(3)
    placed = moved(second, float(spin), b.root[0, :2], a.root[-1, :2] + step[:2]).poses
    within = max(2, min(round(blend_s * a.rate_hz), len(b) - 1))
    # What the first piece would show one frame on, against what the second begins with.
    root = placed.root + _offset(
        a.root[-1] + step - placed.root[0], step - (placed.root[1] - placed.root[0]), within, len(b)
    )
    local = placed.local.copy()
    ahead = quaternions.multiply(quaternions.multiply(a.local[-1], quaternions.conjugate(a.local[-2])), a.local[-1])
    gap = rotation_vector(quaternions.multiply(ahead, quaternions.conjugate(local[0])))
    slope = rotation_vector(quaternions.multiply(a.local[-1], quaternions.conjugate(a.local[-2])))
    slope -= rotation_vector(quaternions.multiply(local[1], quaternions.conjugate(local[0])))
    carried = np.stack([_offset(g, s, within, len(b)) for g, s in zip(gap, slope, strict=True)], axis=1)
    local = quaternions.multiply(from_rotation_vector(carried), local)
    after = second.posed(root=root, local=quaternions.normalise(local))
    roots, locals_ = [a.root, after.poses.root], [a.local, after.poses.local]
    return _piece(first, second, roots, locals_, [first.planted, second.planted & ~_swept(placed, after, within)])


def _swept(placed: Poses, after: Piece, within: int) -> np.ndarray:
    """Mask (T, 2, 2) of contacts that the difference which dies out at a seam, in `within` frames, carries too far and too fast.

    After a run the body is faster than a walk that follows: a foot that stands in the walk would hold it back by more than a leg.
    """
    swept = np.zeros((len(after), 2, 2), bool)
    count = min(within + 2, len(after))
    carried = soles(after.poses.part(0, count)) - soles(placed.part(0, count))
    fast = np.linalg.norm(np.gradient(carried, 1 / placed.rate_hz, axis=0), axis=-1) > TWIST_MPS
    for side in range(2):
        for start, stop in runs(np.asarray(after.planted[:count, side].any(axis=1))):
            far = np.linalg.norm(carried[stop - 1, side] - carried[start, side], axis=-1).max()
            if far > MOST_CARRIED * placed.skeleton.leg_m:
                swept[start:stop, side] = fast[start:stop, side]
    return swept


def _piece(
    first: Piece, second: Piece, roots: list[np.ndarray], locals_: list[np.ndarray], planted: list[np.ndarray]
) -> Piece:
    """A piece of stretches of root, rotations and contacts one after another, with the notes of both pieces."""
    local = quaternions.continuous(np.concatenate(locals_))
    poses = replace(first.poses, root=np.concatenate(roots), local=local)
    return Piece(poses=poses, planted=np.concatenate(planted), notes=(*first.notes, *second.notes))


def crossed(first: Piece, second: Piece, cut: int, start: int) -> Piece:
    """One piece that passes from the first to the second while both go on, within `CROSSING_S` or as far as they have frames; frame
    `cut` of the first is like frame `start` of the second.

    It is for cycles in step with one another. No measured velocity is carried on, which would be noise where a foot lands: the seam
    is as smooth as the clips.
    """
    a, b = first.poses, second.poses
    half = min(round(0.5 * CROSSING_S * a.rate_hz), cut, start, len(a) - 1 - cut, len(b) - 1 - start)
    placed = moved(second, 0.0, b.root[start, :2], a.root[cut, :2]).poses
    count = 2 * half + 1
    weight = minimum_jerk(np.arange(1, count + 1) / (count + 1))[:, None]
    old, new = a.part(cut - half, cut + half + 1), placed.part(start - half, start + half + 1)
    root = (1 - weight) * old.root + weight * new.root
    local = quaternions.blend(old.local, new.local, weight[..., None])
    before, after = slice(cut - half), slice(start + half + 1, None)
    roots, locals_ = [a.root[before], root, placed.root[after]], [a.local[before], local, placed.local[after]]
    return _piece(first, second, roots, locals_, [first.planted[: cut + 1], second.planted[start + 1 :]])


def _offset(gap: np.ndarray, slope: np.ndarray, within: int, count: int) -> np.ndarray:
    """A difference (3,) and its change per frame (3,) that die out smoothly at frame `within`: (count, 3)."""
    at = np.arange(count)[:, None]
    x = np.minimum(at / within, 1.0)
    # Quintic Hermite: value and slope at 0, none of either nor of curvature at 1, curvature 0 at both. A velocity that would carry
    # farther than the gap, or `FARTHEST`, dies out sooner.
    size = float(np.linalg.norm(slope)) * within
    sooner = max(LEAST_FRAMES, within * min(1.0, max(float(np.linalg.norm(gap)), FARTHEST) / max(size, 1e-12)))
    y = np.minimum(at / min(sooner, within), 1.0)
    value = 1 - 10 * x**3 + 15 * x**4 - 6 * x**5
    slant = y - 6 * y**3 + 8 * y**4 - 3 * y**5
    return value * gap + min(sooner, within) * slant * slope


def rotation_vector(quaternion: np.ndarray) -> np.ndarray:
    """Axis times angle [rad] (..., 3) of unit quaternions, the shorter way round."""
    short = np.where(quaternion[..., 3:] < 0, -quaternion, quaternion)
    sine = np.linalg.norm(short[..., :3], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, short[..., 3:])
    return np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 2.0) * short[..., :3]


def from_rotation_vector(vector: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) of axis times angle [rad]."""
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    half = 0.5 * angle
    scale = np.where(angle > 1e-9, np.sin(half) / np.maximum(angle, 1e-9), 0.5)
    return np.concatenate([scale * vector, np.cos(half)], axis=-1)


def swung(rotation: np.ndarray, factor: float, rate_hz: float) -> np.ndarray:
    """Rotations (T, 4) farther from their mean over time by a factor; those more than about a radian away stay.

    Only the swing below `SWING_HZ` is scaled, and its weight depends on how far it goes within `SWING_S`, not on the angle at each
    instant, which would add harmonics: both faster parts and harmonics would raise the jerk far more than the swing.
    """
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    vectors = np.linalg.eigh(rotation.T @ rotation)[1]
    middle = np.broadcast_to(vectors[:, -1], rotation.shape)
    swing = rotation_vector(quaternions.multiply(rotation, quaternions.conjugate(middle)))
    angle = np.linalg.norm(swing, axis=-1)
    width = SWING_S * rate_hz
    # At half a turn the axis jumps, so the change must have died out there.
    slow = low_pass(np.where(angle[:, None] < 0.8 * np.pi, swing, 0.0), min(SWING_HZ, 0.4 * rate_hz), rate_hz)
    speed = np.linalg.norm(np.gradient(slow, 1 / rate_hz, axis=0), axis=-1)
    widest, fastest = (maximum_filter1d(series, 2 * round(width) + 1, mode="nearest") for series in (angle, speed))
    weight = np.exp(-((widest / 1.2) ** 2) - (fastest / THROWN_RADPS) ** 4)
    weight = gaussian_filter1d(weight, 0.5 * width, mode="nearest")
    return quaternions.multiply(from_rotation_vector((factor - 1) * weight[:, None] * slow), rotation)


def features(poses: Poses, *, within_s: float = 0.1) -> np.ndarray:
    """Features (T, F) [m] that tell poses apart: joints about the pelvis in its heading, and their velocities times `within_s`."""
    joints, _ = poses.world()
    indices = [INDEX[name] for name in FEATURE_JOINTS]
    back = quaternions.about_axis(Z, -heading_rad(poses))[:, None]
    points = quaternions.rotate(back, joints[:, indices] - poses.root[:, None] * [1.0, 1.0, 0.0])
    velocity = quaternions.rotate(back, np.gradient(joints[:, indices], 1 / poses.rate_hz, axis=0))
    return np.concatenate([points, within_s * velocity], axis=-1).reshape(len(poses), -1) / np.sqrt(len(indices))


OF_LEG, OF_ARM = ("hip", "knee", "ankle", "foot"), ("elbow", "wrist")
LEGS, ARMS = ([f"{side}_{joint}" for joint in joints for side in ("left", "right")] for joints in (OF_LEG, OF_ARM))
FEATURE_JOINTS = "pelvis", *LEGS, "spine3", "head", *ARMS
"""Joints whose places and velocities are compared between poses."""


def best_seam(first: Poses, second: Poses, after: range, before: range) -> tuple[int, int, float]:
    """Frames, one in `after` of the first and one in `before` of the second, where pose and velocity differ least; and by how
    much [m]."""
    a, b = _features_in(first, after), _features_in(second, before)
    squares = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    i, j = np.unravel_index(int(squares.argmin()), squares.shape)
    return after[int(i)], before[int(j)], float(np.sqrt(max(squares[i, j], 0.0)))


def _features_in(poses: Poses, frames: range) -> np.ndarray:
    """Features (K, F) of some frames, from them and their neighbours alone."""
    low, high = max(0, frames.start - 1), min(len(poses), frames.stop + 1)
    return features(poses.part(low, max(high, low + 2)))[frames.start - low : frames.stop - low : frames.step]
