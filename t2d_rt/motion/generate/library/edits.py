"""Change pieces: their time, mirror image, path and stride; how they begin, go on in others of their kind and come to a halt."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import SIDES, runs
from t2d_rt.motion.generate.chain import (
    CROSSING_S,
    Piece,
    best_seam,
    crossed,
    from_rotation_vector,
    heading_rad,
    joined,
    moved,
    rotation_vector,
    swung,
)
from t2d_rt.motion.generate.library.store import RATE_HZ
from t2d_rt.motion.interpolate import JITTER_CUTOFF_HZ, low_pass, minimum_jerk
from t2d_rt.motion.kinematics import INDEX, NAMES, Poses, Skeleton, at_frames
from t2d_rt.motion.vary import arcs

# --- changes of a piece: its time, its mirror image, its path, its stride. Feet are planted afterwards, by the piece's contacts ---


OTHER = {"left": "right", "right": "left"}

SWAPPED = [NAMES.index("_".join(OTHER.get(part, part) for part in name.split("_"))) for name in NAMES]
"""Index of the joint on the other side, for each joint."""


LEAST_FLIGHT_S, DRIVE_S = 0.1, 0.4
"""Shortest flight of a jump, and the time before and after one that goes with it: in the clips that ship the pelvis rises for up to
0.22 s before a flight and sinks for up to 0.18 s after it (90th percentiles), beside what arms swing to it."""


def mirrored(piece: Piece) -> Piece:
    """The piece seen in a mirror along its x axis: left and right change places."""
    poses = piece.poses
    # Both sides' frames are mirror images in the rest pose: a rotation about x or z changes sign, one about y stays.
    local = poses.local[:, SWAPPED] * [-1.0, 1.0, -1.0, 1.0]
    offsets = poses.skeleton.offsets[SWAPPED] * [1.0, -1.0, 1.0]
    image = replace(poses, skeleton=Skeleton(offsets=offsets), root=poses.root * [1.0, -1.0, 1.0], local=local)
    return replace(piece, poses=image, planted=piece.planted[:, ::-1]).noted("mirrored")


def retimed(piece: Piece, frames: np.ndarray) -> Piece:
    """The piece as it is at `frames` (K,), which may lie between its own: C2 in time."""
    planted = piece.planted[np.clip(np.round(frames).astype(int), 0, len(piece) - 1)]
    return replace(piece, poses=at_frames(piece.poses, frames), planted=planted)


def tempo(piece: Piece, factor: float) -> Piece:
    """The piece faster by a factor. Frequencies that would come to lie above human movement are removed: noise and impacts, which
    no tempo shortens, and which would raise the jerk by the cube of the factor."""
    if abs(factor - 1) < 1e-6:
        return piece
    count = max(2, round((len(piece) - 1) / factor) + 1)
    faster = _without_noise(piece, JITTER_CUTOFF_HZ / factor) if factor > 1 else piece
    return retimed(faster, np.linspace(0, len(piece) - 1, count)).noted(f"{factor:.2f} times as fast")


def _without_noise(piece: Piece, cutoff_hz: float) -> Piece:
    """The piece with joints' rotations and root low-passed at a frequency."""
    poses = piece.poses
    local = quaternions.continuous(poses.local).reshape(len(poses), -1)
    values = low_pass(np.concatenate([poses.root, local], axis=1), min(cutoff_hz, 0.4 * poses.rate_hz), poses.rate_hz)
    rotations = quaternions.normalise(values[:, 3:].reshape(len(poses), -1, 4))
    return piece.posed(root=values[:, :3], local=rotations)


def paced(piece: Piece, factor: float) -> Piece:
    """A jump faster by a factor while it stands; flights, and the times of pushing off and landing, keep their pace.

    A body in flight falls with g at any pace: played faster it would fall faster, and push off with more than its own force.
    """
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    if abs(factor - 1) < 1e-6:
        return piece
    rate = piece.poses.rate_hz
    flies = np.zeros(len(piece))
    for start, stop in runs(np.asarray(~piece.planted.any(axis=(1, 2)))):
        flies[start:stop] = stop - start > LEAST_FLIGHT_S * rate
    near = maximum_filter1d(flies, 2 * round(DRIVE_S * rate) + 1, mode="nearest")
    free = 1 - gaussian_filter1d(near, 0.25 * DRIVE_S * rate, mode="nearest")
    slowness = factor ** (-0.5 * (free[1:] + free[:-1]))
    shown_at = np.concatenate([[0.0], np.cumsum(slowness)])
    frames = np.interp(np.arange(int(shown_at[-1] + 1e-9) + 1), shown_at, np.arange(len(piece)))
    return retimed(piece, frames).noted(f"{factor:.2f} times as fast between flights")


def backwards(piece: Piece) -> Piece:
    """The piece reversed in time: a walk becomes one backward.

    Angles of hips, knees and ankles of walking backward are those of walking forward in reverse within their spread (Winter, Pluck,
    Yang 1989; Thorstensson 1986); what differs is that the toes reach the floor first and that steps are shorter.
    """
    poses = piece.poses
    turned = replace(poses, root=poses.root[::-1].copy(), local=poses.local[::-1].copy())
    return replace(piece, poses=turned, planted=piece.planted[::-1].copy()).noted("reversed in time")


def strided(piece: Piece, factor: float | np.ndarray) -> Piece:
    """Steps longer by a factor, or by one for each frame (T,): the pelvis's velocity changes by it, feet follow in planting."""
    poses = piece.poses
    factors = np.broadcast_to(np.asarray(factor, dtype=float), (len(poses),))
    steps = np.diff(poses.root[:, :2], axis=0) * (0.5 * (factors[1:] + factors[:-1]))[:, None]
    root = poses.root.copy()
    root[1:, :2] = root[0, :2] + np.cumsum(steps, axis=0)
    return piece.posed(root=root)


def bent(piece: Piece, angle_rad: np.ndarray) -> Piece:
    """The piece whose body and velocity are turned at each frame by an angle (T,) about the vertical, left positive."""
    poses = arcs.bent(piece.poses, piece.planted, angle_rad)
    return piece.posed(root=poses.root, local=poses.local)


def straddled(piece: Piece, angle_rad: float) -> Piece:
    """The piece with each leg held outward by an angle, so that feet stand wider."""
    local = piece.poses.local.copy()
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        hip = INDEX[f"{side}_hip"]
        outward = quaternions.about_axis(np.array([1.0, 0.0, 0.0]), np.full(len(piece), sign * angle_rad))
        local[:, hip] = quaternions.multiply(outward, local[:, hip])
    return piece.posed(local=local)


def shifted(piece: Piece, offset_m: np.ndarray) -> Piece:
    """The piece with its root moved by an offset (T, 3) [m]."""
    return piece.posed(root=piece.poses.root + offset_m)


TRUNK = "lower_back", "spine1", "spine2", "spine3", "neck", "head", "head_top"
ARM_PARTS = {"collar": 1.0, "shoulder": 1.0, "elbow": 0.3, "wrist": 1.0, "hand": 1.0}
"""Parts of an arm, and how much of another's movement they take over: runners keep their elbows bent."""

IN_STEP_S = 0.1
"""Time over which the pace of a body that goes in step with other legs is smoothed."""

MOST_SWUNG = 2.0
"""Greatest factor on the arms' swing that makes up for what mixing two swings takes away."""


def carrying(legs: Piece, body: Piece, *, trunk: float, arms: float) -> Piece:
    """A gait with the posture of another one's trunk and head and the movement of its arms, by parts of 0 to 1, in step with it.

    Steps are found where the ankles pass each other, left for left, so that arms swing against the legs as before; they swing as
    far as the gait's own. If the body takes fewer steps than the legs, the gait stays as it is.
    """
    legs_at, body_at = passes(legs), passes(body)
    body_at = body_at[int(len(legs_at) > 0 and len(body_at) > 0 and legs_at[0, 1] != body_at[0, 1]) :]
    if len(legs_at) < 3 or len(body_at) < len(legs_at) + 2:
        return legs
    pace = np.diff(legs_at[:, 0]).mean()
    # Before the first pass and after the last one the pace stays the same.
    ends = [legs_at[0, 0] - pace, *legs_at[:, 0], legs_at[-1, 0] + pace]
    steps = np.interp(np.arange(len(legs)), ends, np.arange(len(ends)))
    frames = np.interp(steps, np.arange(len(body_at)), body_at[:, 0])
    frames = np.clip(low_pass(frames[:, None], 0.5 / IN_STEP_S, RATE_HZ)[:, 0], 0, len(body) - 1)
    carried = at_frames(body.poses, frames).local
    local = legs.poses.local.copy()
    for name in TRUNK:
        before, after = _mean(local[:, INDEX[name]]), _mean(carried[:, INDEX[name]])
        difference = rotation_vector(quaternions.multiply(after, quaternions.conjugate(before)))
        local[:, INDEX[name]] = quaternions.multiply(from_rotation_vector(trunk * difference), local[:, INDEX[name]])
    for joint, part in ((INDEX[f"{side}_{name}"], arms * mix) for side in SIDES for name, mix in ARM_PARTS.items()):
        mixed = quaternions.blend(local[:, joint], carried[:, joint], np.full((len(legs), 1), part))
        factor = float(np.clip(_swing(local[:, joint]) / max(_swing(mixed), 1e-6), 1.0, MOST_SWUNG))
        local[:, joint] = swung(quaternions.continuous(mixed), factor, RATE_HZ)
    piece = legs.posed(local=quaternions.continuous(local))
    return replace(piece, notes=(*legs.notes, f"trunk by {trunk:.2f} and arms by {arms:.2f} of", *body.notes))


def _mean(rotation: np.ndarray) -> np.ndarray:
    """The mean (1, 4) of rotations (T, 4)."""
    return np.asarray(np.linalg.eigh(rotation.T @ rotation)[1][None, :, -1])


def _swing(rotation: np.ndarray) -> float:
    """Root mean square of the angles of rotations (T, 4) from their mean [rad]."""
    away = rotation_vector(quaternions.multiply(rotation, quaternions.conjugate(_mean(rotation))))
    return float(np.sqrt((away**2).sum(axis=-1).mean()))


def passes(piece: Piece) -> np.ndarray:
    """Frames at which one ankle passes the other along the heading, and whether it is the left one, (steps, 2)."""
    joints, _ = piece.poses.world()
    ahead = np.stack([np.cos(heading_rad(piece.poses)), np.sin(heading_rad(piece.poses))], axis=-1)
    apart = ((joints[:, INDEX["left_ankle"], :2] - joints[:, INDEX["right_ankle"], :2]) * ahead).sum(-1)
    at = np.flatnonzero(np.diff(np.sign(apart)) != 0)
    return np.column_stack([at, apart[at + 1] > apart[at]]).astype(float)


def aligned(piece: Piece) -> Piece:
    """The piece moved to begin at the origin, with the line from start to end, or the heading if it hardly travels, along +x."""
    poses = piece.poses
    net = poses.root[-1, :2] - poses.root[0, :2]
    heading = float(np.angle(np.exp(1j * heading_rad(poses)).mean()))
    angle = float(np.arctan2(net[1], net[0])) if np.linalg.norm(net) > 0.8 else heading
    return moved(piece, -angle, poses.root[0, :2], np.zeros(2))


def swing_of(piece: Piece) -> float:
    """Range (5th to 95th percentile) of the wrists against the shoulders along x, over twice the leg's length, mean of both sides.

    `Gait.arm_swing` is over the stature in place of twice the leg, which is 0.94 to 0.96 of it, and so 4 to 6 % less.
    """
    joints, _ = piece.poses.world()
    arms = [joints[:, INDEX[f"{side}_wrist"], 0] - joints[:, INDEX[f"{side}_shoulder"], 0] for side in SIDES]
    return float(np.mean([np.ptp(np.percentile(arm, (5, 95))) for arm in arms])) / (2 * piece.poses.skeleton.leg_m)


def rate_of(poses: Poses) -> float:
    """Mean horizontal speed of the pelvis along the line from start to end [m/s]."""
    net = np.linalg.norm(poses.root[-1, :2] - poses.root[0, :2])
    return float(net * poses.rate_hz / max(len(poses) - 1, 1))


# --- how walks and runs go on in others of their kind, come to a halt, and begin ---


HALT_S = 1.2
"""Time in which a walk comes to a halt: two steps (Bishop et al. 2002)."""


START_S = 1.0
"""Time in which a walk reaches its speed (Breniere, Do 1986: about a step)."""

AT_REST_MPS = 0.3
"""Speed of the pelvis below which nobody walks."""

CROSSES_AT, LEAST_GAIN_S = 1.3, 0.5
"""A seam away from the ends of clips is taken if its distance of poses is below this multiple of that of the best seam at the ends,
and if it lengthens the whole by this time: a clip that hardly holds a stride is nearest to itself a few frames on."""


@dataclass(frozen=True, slots=True)
class Seam:
    """A seam at which a gait goes on in another piece: frame `cut` of the whole is like frame `start` of the piece."""

    whole: Piece
    following: Piece
    cut: int
    start: int
    apart_m: float
    crosses: bool
    """Whether both have enough frames about the seam to pass from one to the other."""

    def joined(self) -> Piece:
        """The whole and the following piece, joined at the seam."""
        if self.crosses:
            return crossed(self.whole, self.following, self.cut, self.start)
        remainder = self.following.part(self.start + 1, len(self.following))
        return joined([self.whole.part(0, self.cut + 1), remainder], turn=False)


def best_crossing(whole: Piece, following: Piece) -> Seam:
    """The best seam at which two gaits cross; if a clip hardly holds a stride, and only its ends match, one at these."""
    length, beyond = min(len(whole), len(following)), round(0.5 * CROSSING_S * RATE_HZ)
    at_ends = _best_within(whole, following, 2)
    within = _best_within(whole, following, beyond) if length > 4 * beyond else at_ends
    gained = within[0] - within[1] - (len(whole) - len(following))
    crosses = length > 4 * beyond and within[2] < CROSSES_AT * at_ends[2] and gained > LEAST_GAIN_S * RATE_HZ
    return Seam(whole, following, *(within if crosses else at_ends), crosses)


def _best_within(whole: Piece, following: Piece, margin: int) -> tuple[int, int, float]:
    """The best seam in the last half of the one and the first half of the other that keeps a margin [frames] from their ends."""
    length = min(len(whole), len(following))
    after = range(max(len(whole) - round(0.5 * length), 3), len(whole) - margin, 2)
    before = range(margin, max(round(0.45 * len(following)), margin + 2), 2)
    return best_seam(whole.poses, following.poses, after, before)


def halted(piece: Piece, following: Piece) -> Piece:
    """A walk brought to a halt before a piece that begins at rest: its last steps shorten and slow down; anything else as it is."""
    pace = pace_mps(piece, -1)
    if pace < AT_REST_MPS or pace_mps(following, 0) > 0.5 * pace:
        return piece
    last = min(len(piece) - 1, round(HALT_S * RATE_HZ))
    falling = minimum_jerk((np.arange(len(piece)) - (len(piece) - last)) / last)
    short = strided(piece, 1 - 0.9 * falling)
    # Time runs at 0.55 of its pace at the end, as it does at the beginning of a walk.
    shown_at = np.concatenate([[0.0], np.cumsum(1 / (1 - 0.45 * falling[:-1]))])
    return retimed(short, np.interp(np.arange(int(shown_at[-1]) + 1), shown_at, np.arange(len(piece))))


def begun(before: Piece, piece: Piece) -> Piece:
    """A walk or run that begins with short and slow steps after a piece that ends at rest; anything else as it is."""
    pace = pace_mps(piece, 0)
    if pace < AT_REST_MPS or pace_mps(before, -1) > 0.5 * pace:
        return piece
    rising = minimum_jerk(np.arange(len(piece)) / (START_S * RATE_HZ))
    slow = strided(piece, 0.25 + 0.75 * rising)
    # Time runs at 0.55 of its pace at the beginning.
    frames = np.concatenate([[0.0], np.cumsum(0.55 + 0.45 * rising)])
    return retimed(slow, frames[frames <= len(piece) - 1])


def pace_mps(piece: Piece, end: int) -> float:
    """Horizontal speed of the pelvis over a third of a second at the beginning (0) or at the end (-1)."""
    frames = min(20, len(piece))
    part = piece.poses.root[:frames, :2] if end == 0 else piece.poses.root[-frames:, :2]
    return float(np.linalg.norm(part[-1] - part[0]) * RATE_HZ / max(frames - 1, 1))
