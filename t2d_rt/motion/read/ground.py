"""Find from planted feet which way gravity points, and where a person travels whose hips never move in the file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Literal

import numpy as np

from t2d_rt.core.errors import warn
from t2d_rt.geometry.vectors import inner, norms, unit, vector_product
from t2d_rt.motion.contacts import runs
from t2d_rt.motion.kinematics import leg_m, middle
from t2d_rt.motion.quaternions import between, conjugate, multiply, rotate
from t2d_rt.motion.read.tracks import Tracks

# --- which way gravity points, where a file does not keep to an axis: a tilted camera turns floor and body alike ---
#
# Two signs need no axis: planted feet lie on the floor, and over time the centre of mass is above them (else the body
# would fall). Along a walk the floor is known to a fraction of a degree; across it, and where somebody stays at one
# place, balance tells it to 3 degrees. On a ramp or stairs the feet's places rise as well, but there the centre of
# mass stays above the feet along the file's own axis: such a floor is kept.


WEIGHTS = (
    ("hip", "knee", 0.41, 0.143),
    ("knee", "ankle", 0.44, 0.06),
    ("shoulder", "elbow", 0.5, 0.027),
    ("elbow", "wrist", 0.6, 0.022),
)
"""Limbs, where their centres of mass lie between the joints, and their shares of the body's mass, hands and feet with forearm and
shank (de Leva 1996)."""
HEAD_FRACTION, TRUNK_FRACTION = 0.08, 1.0 - 0.08 - 2 * sum(part for *_, part in WEIGHTS)

EXTENDED, NEAR = 0.85, 0.12
"""Least distance from hip to ankle of a leg that carries, and greatest height of its foot over the other, over the leg's length."""
UPRIGHT_LEG, UPRIGHT_TRUNK = 0.6, 0.5
"""Least cosines to the file's axis of the leg and the trunk of a standing body, even if the camera is tilted by 35 degrees."""

SLOW_MPS, SLOW_PART = 0.25, 0.35
"""Speed of an ankle up to which its foot is planted [m/s], or that fraction of the hips' own if it is more, as in a run."""
SMOOTH_S, SHORTEST_S = 0.1, 0.06
"""Time over which ankles are averaged for their speed, and the shortest contact."""

SPOT_M, BALANCE_RAD = 0.02, np.radians(2.5)
"""Standard deviations: of the height of a planted ankle above the floor, and of the direction from feet to centre of mass."""

FEWEST_SPOTS, LEAST_RISE_M, LEAST_SLOPE_RAD, MOST_RESIDUAL = 4, 0.1, np.radians(1.75), 0.15
"""Planted feet lie on an incline from this number, rise [m] and slope on, with a residual of at most the last part of the rise.
None of 144 sound recordings reaches these limits; their floors are uneven, or drift by 8 cm over a walk."""

LEAST_LEAN_RAD, LEAST_STANCE_S, LEAST_STANCE, LEVEL_M = np.radians(6.0), 1.5, 0.5, 0.03
"""Balance alone shows a tilt from this angle on, if the body stands for at least this time [s] and this part of the time in which
the trunk is upright, on feet that lie on a plane within this residual [m]."""
WALK_LEAN_RAD, WALK_M, WALK_STANCE, WALK_LEVEL_M = np.radians(3.0), 1.5, 0.6, 0.02
"""The same for a walk of at least this extent [m]: left and right stance balance one another to 1.3 degrees in 70 walks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """The vertical and the floor of a motion, z up, that planted feet and balance show."""

    vertical: np.ndarray
    """Unit vector (3,) that points upward."""
    tilted: bool
    """Whether the file's axes are tilted against gravity; else a floor that inclines is real."""
    rise_m: float
    """Greatest difference of the heights of planted feet [m]."""
    residual_m: float
    """RMS distance of the feet from their plane [m]."""

    @property
    def angle_deg(self) -> float:
        """Angle between the file's axis and the vertical [degrees]."""
        return float(np.degrees(np.arccos(np.clip(self.vertical[2], -1.0, 1.0))))


def levelled(tracks: Tracks, up: object) -> tuple[Tracks, Ground | None]:
    """Tracks in metres, z up, turned so that gravity points down, and the ground that was found, None if it agrees with the axis.

    up: what the user gave. An axis or a vector is kept, with a warning if the motion is tilted against it; "file" is kept silently.
    """
    floor = ground(tracks.points, tracks.rate_hz)
    if floor is None:
        return tracks, None
    rise = f"planted feet rise by {floor.rise_m:.2f} m against the axis, residual {1e3 * floor.residual_m:.0f} mm"
    if not floor.tilted:
        return tracks.saying(f"the floor inclines ({rise}) under an upright body and is kept"), floor
    if up is not None:
        if not (isinstance(up, str) and up == "file"):
            warn(
                f"floor and body are tilted together by {floor.angle_deg:.1f} degrees ({rise}), as a tilted camera "
                "sees them; leave up (--motion.up) out to have them levelled"
            )
        return tracks.saying(f"tilted by {floor.angle_deg:.1f} degrees ({rise})"), floor
    turn = between(floor.vertical, np.array([0.0, 0.0, 1.0]))
    level = replace(
        tracks,
        points={name: rotate(turn, track) for name, track in tracks.points.items()},
        turned={name: multiply(turn, track) for name, track in tracks.turned.items()},
    )
    clause = f"turned level by {floor.angle_deg:.1f} degrees, as planted feet and balance have it ({rise})"
    return level.saying(clause), floor


def ground(points: dict[str, np.ndarray], rate_hz: float) -> Ground | None:
    """Vertical and floor by planted feet and balance; None if they agree with z, or if too little is seen."""
    upright, leg = upright_trunk(points), leg_m(points)
    planted = planted_feet(points, rate_hz, upright, leg)
    balance, stance = _balance(points, planted, leg)
    if balance is None:
        return None
    sides = (points["left_ankle"], points["right_ankle"])
    spots = np.array(
        [track[a:b].mean(axis=0) for track, flags in zip(sides, planted, strict=True) for a, b in runs(flags)]
    )
    z = np.array([0.0, 0.0, 1.0])
    level = between(balance, z)
    normal, residual = _plane(rotate(level, spots))
    vertical = rotate(level * [-1, -1, -1, 1], normal)
    slope = float(np.arccos(np.clip(vertical[2], -1.0, 1.0)))
    rise = float(np.ptp(spots[:, 2]))
    inclined = (
        len(spots) >= FEWEST_SPOTS
        and rise >= LEAST_RISE_M
        and slope >= LEAST_SLOPE_RAD
        and residual <= MOST_RESIDUAL * rise
    )
    part = stance / max(int(upright.sum()), 1)
    walks = np.ptp(spots, axis=0).max() >= WALK_M and part >= WALK_STANCE and residual <= WALK_LEVEL_M
    steady = part >= LEAST_STANCE and residual <= LEVEL_M and stance >= LEAST_STANCE_S * rate_hz
    leans = steady and slope >= (WALK_LEAN_RAD if walks else LEAST_LEAN_RAD)
    if not inclined and not leans:
        return None
    # A tilted camera is twice as likely as a floor of the same incline.
    odds = np.log(2.0) + (np.sum((balance - z) ** 2) - np.sum((balance - vertical) ** 2)) / (2 * BALANCE_RAD**2)
    return Ground(vertical=vertical, tilted=bool(odds > 0), rise_m=rise, residual_m=residual)


def planted_feet(
    points: dict[str, np.ndarray], rate_hz: float, upright: np.ndarray, length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Whether the left and the right foot (T,) carry a standing body that has an upright trunk (T,) and legs of the given length
    [m]; the axes may be tilted by up to 35 degrees from z up."""
    width, hips = SMOOTH_S * rate_hz, middle(points, "hip")
    ankles = [averaged(points[f"{side}_ankle"], width) for side in ("left", "right")]
    legs = [points[f"{side}_hip"] - points[f"{side}_ankle"] for side in ("left", "right")]
    carries = [upright & (norms(leg) > EXTENDED * length) & (unit(leg)[:, 2] > UPRIGHT_LEG) for leg in legs]
    standing = carries[0] | carries[1]
    if not standing.any():
        return carries[0], carries[1]
    axis = unit(np.median((hips - 0.5 * (ankles[0] + ankles[1]))[standing], axis=0))
    most = max(SLOW_MPS, SLOW_PART * float(np.median(_speed(averaged(hips, width), rate_hz))))
    planted = []
    for side, other in ((0, 1), (1, 0)):
        low = (ankles[side] - ankles[other]) @ axis < NEAR * length
        flags = carries[side] & low & (_speed(ankles[side], rate_hz) < most)
        for start, stop in runs(flags):
            if stop - start < max(2, SHORTEST_S * rate_hz):
                flags[start:stop] = False
        planted.append(flags)
    return planted[0], planted[1]


def upright_trunk(points: dict[str, np.ndarray]) -> np.ndarray:
    """Whether the trunk is upright (T,)."""
    return np.asarray(unit(middle(points, "shoulder") - middle(points, "hip"))[:, 2] > UPRIGHT_TRUNK)


def averaged(track: np.ndarray, frames: float) -> np.ndarray:
    """Moving average of a track (T, N) over about the given number of frames, made odd."""
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(track, 2 * round(0.5 * min(frames, len(track))) + 1, axis=0, mode="nearest"))


def _speed(track: np.ndarray, rate_hz: float) -> np.ndarray:
    return np.asarray(norms(np.gradient(track, 1.0 / rate_hz, axis=0)))


def _balance(
    points: dict[str, np.ndarray], planted: tuple[np.ndarray, np.ndarray], leg: float
) -> tuple[np.ndarray | None, int]:
    """Mean direction (3,) from the feet that carry to the centre of mass, with left and right stance counted the same, and the
    number of frames that it is a mean of."""
    mass = HEAD_FRACTION * points["head"]
    for side in ("left", "right"):
        for upper, lower, at, part in WEIGHTS:
            a, b = points[f"{side}_{upper}"], points[f"{side}_{lower}"]
            mass = mass + part * (a + at * (b - a))
        mass = mass + 0.25 * TRUNK_FRACTION * (points[f"{side}_hip"] + points[f"{side}_shoulder"])
    up = mass - middle(points, "ankle")
    ahead = unit(vector_product(points["left_hip"] - points["right_hip"], up))
    # On average a foot's load lies this far ahead of its ankle: balance is then upright within 3 degrees in 70 walks.
    left, right = (mass - points[f"{side}_ankle"] - 0.06 * leg * ahead for side in ("left", "right"))
    both = planted[0] & planted[1]
    one = [vectors[flags & ~both] for vectors, flags in zip((left, right), planted, strict=True)]
    total, frames = (0.5 * (left + right))[both].sum(axis=0), int(both.sum())
    if min(len(stance) for stance in one) > 2:
        total = total + 0.5 * (len(one[0]) + len(one[1])) * (one[0].mean(axis=0) + one[1].mean(axis=0))
        frames += len(one[0]) + len(one[1])
    return (unit(total) if frames else None), frames


def _plane(spots: np.ndarray) -> tuple[np.ndarray, float]:
    """Normal (3,) of planted feet's places (N, 3), already levelled by balance, and their residual [m].

    Outlying places count less in the least squares; the remaining incline has a prior of 0 with deviation `BALANCE_RAD`.
    """
    centred = spots - spots.mean(axis=0)
    terms = np.c_[centred[:, :2], np.ones(len(spots))]
    weight = np.ones(len(spots))
    prior = np.diag([1.0, 1.0, 0.0]) / BALANCE_RAD**2
    rest = centred[:, 2]
    for _ in range(20):
        weighted = terms.T * (weight / SPOT_M**2)
        incline = np.linalg.solve(weighted @ terms + prior, weighted @ centred[:, 2])
        rest = centred[:, 2] - terms @ incline
        weight = 1.0 / np.sqrt(1.0 + (rest / (2 * SPOT_M)) ** 2)
    return unit(np.array([-incline[0], -incline[1], 1.0])), float(np.sqrt((rest**2).mean()))


# --- files whose hips never move: exports in place, treadmills, pose estimators that give joints about the hips ---
#
# The track of the body then follows from its planted feet, which stay on the floor.


Root = Literal["file", "feet"]

TIPS = 0.0, 0.6
"""Points on which a foot may stand, its ball and the tip of its toes: distance beyond the ball, over that from ankle to ball."""

NEAR_M, FLIGHT_M = 0.005, 0.03
"""Height of a foot above the lower one up to which it may carry the body as well, and height of the lower one above its level from
which on both are in flight."""

SWAY_S, GROUND_SMOOTH_S = 1.0, 0.1
"""Time of a stride, over which sway is averaged away, and the time over which the velocity of the ground is smoothed."""

LEAST_WALK_M, LEAST_MPS, STILL = 0.8, 0.3, 0.2
"""Least path [m] and speed [m/s] of the ground below planted feet in a walk, and the part of that path up to which hips count as
staying in place; in one of 144 sound recordings, a pirouette, hips go less than 0.3 of it."""

FIXED_M, LEAST_FEET_RISE_M = 0.002, 0.1
"""Extent below which hips are fixed [m], and rise and fall of the feet below them above which the body in fact moves [m]."""


def rooted(tracks: Tracks, root: Root | None) -> Tracks:
    """Tracks in metres, z up, with feet; a warning says if the hips never move.

    root: "feet" carries the body to where planted feet stay; "file" leaves it where the file has it, and says nothing.
    """
    if root == "file":
        return tracks
    points, rate_hz = tracks.points, tracks.rate_hz
    hips = middle(points, "hip")
    turn = _upward(points, hips) if len(hips) >= 2 * SWAY_S * rate_hz else None
    ground, lowest = _ground_mps(
        points if turn is None else {name: rotate(turn, track) for name, track in points.items()}, rate_hz
    )
    fixed = _fixed(points["pelvis"]) or _fixed(hips)
    if root == "feet":
        shift = np.zeros((len(hips), 3))
        shift[1:, :2] = np.cumsum(0.5 * (ground[1:] + ground[:-1]), axis=0) / rate_hz
        if fixed:
            shift[:, 2] = lowest[0] - averaged(lowest, GROUND_SMOOTH_S * rate_hz)
        shift = shift if turn is None else rotate(conjugate(turn), shift)
        clause = f"root motion from planted feet, {_path_m(ground, rate_hz) * rate_hz / len(hips):.2f} m/s"
        return replace(tracks, points={name: track + shift for name, track in points.items()}).saying(clause)
    if not fixed and upright_trunk(points).mean() <= 0.5:
        return tracks
    gone_m = _path_m(np.gradient(hips, 1.0 / rate_hz, axis=0)[:, :2], rate_hz)
    ground_m, rise_m = _path_m(ground, rate_hz), float(np.ptp(np.percentile(lowest, [2, 98])))
    if ground_m > max(LEAST_WALK_M, LEAST_MPS * len(hips) / rate_hz) and gone_m < STILL * ground_m:
        why = f"planted feet slide at {ground_m * rate_hz / len(hips):.1f} m/s below them"
    elif fixed and rise_m > LEAST_FEET_RISE_M:
        why = f"the feet rise by {rise_m:.2f} m below them"
    else:
        return tracks
    warn(
        f"the hips never move, and {why}, as in exports in place, on treadmills and in joints about the hips: the torso has no "
        "speed; give root='feet' (--motion.root feet) to carry the body to where planted feet stay, or 'file' as it is"
    )
    return tracks.saying(f"the hips never move, {why}")


def _upward(points: dict[str, np.ndarray], hips: np.ndarray) -> np.ndarray | None:
    """Rotation (4,) that raises a body above its feet; None if it is upright already, lies, or bends."""
    axes = unit(hips - middle(points, "ankle"))
    axis = unit(axes.mean(axis=0))
    # A walker's axis keeps within 4 to 7 degrees; a kick, whose mean axis is no vertical, has 20.
    if (axes @ axis).mean() < 0.985:
        return None
    ahead = unit(np.cross(points["left_hip"] - points["right_hip"], axis).mean(axis=0))
    # Hips are 5 degrees ahead of a walker's ankles, 15 of a runner's; cameras are tilted by 11 to 40 degrees.
    axis = unit(axis - np.tan(np.radians(5.0)) * ahead)
    tilted = np.cos(np.radians(11.0)) > axis[2] > np.cos(np.radians(40.0))
    return between(axis, np.array([0.0, 0.0, 1.0])) if tilted else None


def _fixed(track: np.ndarray) -> bool:
    return bool(np.ptp(track, axis=0).max() < FIXED_M)


def _ground_mps(points: dict[str, np.ndarray], rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (T, 2) [m/s] at which a planted foot goes backward in the file, and the height (T,) [m] of the lower foot.

    Feet stand on that one of the points `TIPS` below which the ground goes most steadily.
    """
    candidates = []
    for tip in TIPS:
        feet = np.stack(
            [(1 + tip) * points[f"{side}_foot"] - tip * points[f"{side}_ankle"] for side in ("left", "right")], axis=1
        )
        height = averaged(feet[..., 2], 0.05 * rate_hz)
        lowest, frames = height.min(axis=1), np.arange(len(feet))
        backward = -np.gradient(feet, 1.0 / rate_hz, axis=0)[..., :2]
        # Where both feet are low, the one that goes backward along the heading carries the body.
        heading = averaged(backward[frames, height.argmin(axis=1)], SWAY_S * rate_hz)
        along = np.where(height - lowest[:, None] < NEAR_M, inner(backward, heading[:, None]), -np.inf)
        ground = backward[frames, along.argmax(axis=1)]
        if np.ptp(points["pelvis"][:, 2]) > FIXED_M:
            stands = np.flatnonzero(lowest < np.percentile(lowest, 5) + FLIGHT_M)
            # A sprinter's feet stand for half of the time.
            if len(stands) > 0.25 * len(frames):
                ground = np.stack([np.interp(frames, stands, column[stands]) for column in ground.T], axis=-1)
        steady = _path_m(ground, rate_hz) / max(float(norms(ground).sum()) / rate_hz, 1e-9)
        candidates.append((steady, ground, lowest))
    _, ground, lowest = max(candidates, key=itemgetter(0))
    return averaged(ground, GROUND_SMOOTH_S * rate_hz), lowest


def _path_m(velocity: np.ndarray, rate_hz: float) -> float:
    """Length [m] of the path of a velocity (T, 2) [m/s] without sway."""
    return float(norms(averaged(velocity, SWAY_S * rate_hz)).sum() / rate_hz)
