"""Find from the body what a file does not say: its unit, upward axis, calibration pose and floor."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal

import numpy as np

from t2d_rt.core.errors import InputError, warn
from t2d_rt.geometry import vectors
from t2d_rt.geometry.vectors import norms
from t2d_rt.motion import quaternions
from t2d_rt.motion.kinematics import STATURE_PER_CHAIN, facing, leg_m, middle, stature_m
from t2d_rt.motion.read.complete import FOOT_AHEAD, FOOT_DOWN

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "ft": 0.3048, "dm": 0.1, "cmu": 0.0254 / 0.45}
"""Metres per unit; one unit of the CMU database is 1/0.45 inch."""

USUAL = ("m", "cm", "mm", "inch", "ft")
"""Units that are tried; decimetres only where none of them makes a person."""

CMU_STATURE_M = (1.1, 2.5)
"""Statures of CMU's adults at which the unit is found without doubt: neighbouring units (cm, inch, CMU) differ by 2.2 or more."""

AUTO_STATURE_M = (0.6, 2.5)
"""Statures of persons [m], from a baby that walks; within them a unit that a format prescribes is accepted too."""

STATURE_M = (0.4, 3.0)
"""Statures accepted when the unit is given (a toddler ... a giant)."""

AGES = ((0.455, 0.75), (0.485, 0.87), (0.51, 0.95), (0.535, 1.10), (0.558, 1.38), (0.57, 1.6))
"""Thigh and shank over thigh, shank, trunk and neck, and the stature [m] at which it is usual: of adults as in six recorded
skeletons (0.54 to 0.61), of children by the ratio of sitting height to stature at 1, 2, 3, 5 and 10 years (0.63, 0.60, 0.58, 0.55,
0.53; adults 0.52)."""

PROPORTION_SPREAD = 0.03
"""Standard deviation of that fraction among persons, and by where skeletons have hips and shoulders."""

FLOOR_PERCENTILE = 2.0
"""Percentile of the lowest foot joint's height that is taken as the floor: robust to a bad frame, and right for jumps."""

STILL = 1e-4
"""Part of the stature within which all joints keep their places about the pelvis in a pose that stays the same."""

STRAIGHT = 0.94
"""Least cosine of the angle between a bone of an arm that is held out and the line across both shoulders, 20 degrees."""

Up = Literal["x", "y", "z", "-x", "-y", "-z"]
GivenUp = Up | Literal["file"] | tuple[float, float, float]
"""What a user may give: an axis or any vector, or "file" for the axis that is found."""


def unit(points: dict[str, np.ndarray], units: float | str | None, *, cmu_units: bool = False) -> tuple[float, float]:
    """Metres per unit and the stature [m] that follows; warns if it is not certain, raises an InputError if no unit makes a person.

    cmu_units: whether CMU's unit is possible, which would turn a child in inches into a giant.
    """
    tall = stature_m(points)
    if isinstance(units, str) and units not in UNITS_M:
        raise InputError(f"units {units!r} are unknown; give metres per unit or one of {', '.join(UNITS_M)}")
    if units is not None:
        unit_m = UNITS_M[units] if isinstance(units, str) else float(units)
        if not (unit_m > 0 and STATURE_M[0] <= tall * unit_m <= STATURE_M[1]):
            raise InputError(
                f"with units={units!r} the body would be {tall * unit_m:.3g} m tall; leave units out to detect them"
            )
        return unit_m, tall * unit_m
    name = _cmu_unit(tall) if cmu_units else _likely_unit(points, tall)
    if name is None:
        raise InputError(
            f"the body is {tall:.3g} units tall, which no usual unit makes a person; give units=metres per unit"
        )
    if tall * UNITS_M[name] > 2.1:
        warn(
            f"the body is {tall * UNITS_M[name]:.2f} m tall if the file's unit is {name}; "
            "give units (--motion.units) if it is another"
        )
    return UNITS_M[name], tall * UNITS_M[name]


def _cmu_unit(tall: float) -> str | None:
    """The unit that makes a body of `tall` units an adult of the most usual size, None if it makes none."""
    if not tall > 0:
        return None
    away = {name: abs(math.log(tall * unit_m / 1.7)) for name, unit_m in UNITS_M.items() if name != "dm"}
    best = min(away, key=away.__getitem__)
    return best if CMU_STATURE_M[0] <= tall * UNITS_M[best] <= CMU_STATURE_M[1] else None


def _likely_unit(points: dict[str, np.ndarray], tall: float) -> str | None:
    """The likeliest usual unit by stature and proportions (Bayes' rule), None if none makes a person."""
    possible = [name for name in (*USUAL, "dm") if AUTO_STATURE_M[0] <= tall * UNITS_M[name] <= AUTO_STATURE_M[1]]
    names = [name for name in possible if name != "dm"]
    if not names:
        if possible:
            warn(
                f"the body is {tall * UNITS_M['dm']:.2f} m tall only if the file's unit is an unusual 0.1 m; "
                "give units (--motion.units) if it is another"
            )
        return next(iter(possible), None)
    fraction = leg_m(points) * STATURE_PER_CHAIN / tall
    chances = {name: _chance(tall * UNITS_M[name], fraction) for name in names}
    best = max(chances, key=chances.__getitem__)
    stature = tall * UNITS_M[best]
    others = [name for name in names if name != best and chances[name] > 0.02 * sum(chances.values())]
    if others:
        other = others[0]
        warn(
            f"the file's unit may be {best} (stature {stature:.2f} m) or {other} ({tall * UNITS_M[other]:.2f} m), {best} is taken "
            f"by the body's proportions; give units={other!r} (--motion.units {other}) if it is the other"
        )
    elif stature < 1.2 and fraction - _expected_fraction(stature) > 3.0 * PROPORTION_SPREAD:
        warn(
            f"the body is {stature:.2f} m tall if the file's unit is {best}, but has an adult's proportions; give units "
            "(--motion.units) if it is another"
        )
    return best


def _expected_fraction(stature: float) -> float:
    fractions, statures = zip(*AGES, strict=True)
    return float(np.interp(stature, statures, fractions))


def _chance(stature: float, fraction: float) -> float:
    """Density of statures, nine adults of 1.68 m +- 8.5 % to one child of 0.7 to 1.5 m, times that of the proportions."""
    adult = 0.9 * math.exp(-0.5 * (math.log(stature / 1.68) / 0.085) ** 2) / (0.085 * math.sqrt(2.0 * math.pi))
    child = 0.1 / math.log(1.5 / 0.7) * (stature < 1.5)
    return (adult + child) * math.exp(-0.5 * ((fraction - _expected_fraction(stature)) / PROPORTION_SPREAD) ** 2)


def up_axis(points: dict[str, np.ndarray], rest: dict[str, np.ndarray] | None = None) -> Up:
    """The axis along which the head is above the ankles; y, BVH's usual one, unless another is clearly longer.

    rest: the pose without rotations, points of shape (1, 3). If it stands along another axis than the motion, somebody may lie
    for most of the time; the axis is then the one along which the lowest joint keeps its level, because bodies rest on a floor.
    """
    moving = ankles_to_head(points)
    axis = _longest(np.median(moving, axis=0))
    if rest is None or not _is_a_stance(rest):
        return axis
    still = ankles_to_head(rest)
    other = _longest(still[0])
    if other == axis or not _standing_fraction(still, other) > 0.0:
        return axis
    tall = stature_m(points)
    spread = {candidate: floor_spread(points, candidate) for candidate in (axis, other)}
    steady, loose = sorted(spread, key=spread.__getitem__)
    if spread[loose] > 0.1 * tall and spread[steady] < 0.5 * spread[loose]:
        return steady
    if axis[-1] == "x" or _standing_fraction(moving, other) > 0.1:
        return other
    warn(
        f"the body is upright along {axis} throughout, but along {other} in its rest pose: up is taken as {axis}; "
        f"give up={other!r} (--motion.up {other}) if the person lies"
    )
    return axis


def stance_axis(points: dict[str, np.ndarray], nominal: Up | None, *, margin: float = 0.0) -> Up:
    """The format's `nominal` upward axis, unless the body stands along another one, whose floor it keeps better.

    margin: by how much better, over stature. If a body keeps either floor and stands at 0 of the other axis, a warning says so.
    """
    axis = up_axis(points)
    if nominal is None or axis == nominal:
        return axis
    posture = ankles_to_head(points)
    along = abs(np.median(posture, axis=0)["xyz".index(axis[-1])])
    if not along > 0.8 * float(np.percentile(norms(posture), 90)):
        return nominal
    better = floor_spread(points, nominal) - floor_spread(points, axis)
    if better > margin * stature_m(points):
        return axis
    lowest = np.median(np.min([track @ _along(axis) for track in points.values()], axis=0))
    if better > 0 and abs(lowest) < 0.1 * stature_m(points):
        warn(
            f"the body is upright along {axis} throughout and rests on {axis} = 0, but files of this format have {nominal} up: "
            f"up is taken as {nominal}; give up={axis!r} (--motion.up {axis}) if the person stands"
        )
    return nominal


def ankles_to_head(points: dict[str, np.ndarray]) -> np.ndarray:
    """Vectors (T, 3) from the middle of the ankles to the head."""
    return points["head"] - middle(points, "ankle")


def _is_a_stance(rest: dict[str, np.ndarray]) -> bool:
    """Whether legs and trunk point in opposite directions: without rotations, many files have all bones along one axis."""
    hips, shoulders, ankles = (middle(rest, joint)[0] for joint in ("hip", "shoulder", "ankle"))
    legs, trunk = ankles - hips, shoulders - hips
    return float(legs @ trunk) < -0.9 * float(np.linalg.norm(legs) * np.linalg.norm(trunk))


def _longest(posture: np.ndarray) -> Up:
    axis = int(np.argmax(np.abs(posture) * np.array([1.0, 1.5, 1.0])))
    return ("-" if posture[axis] < 0 else "") + "xyz"[axis]  # type: ignore[return-value]


def _along(up: Up) -> np.ndarray:
    return (-1.0 if up[0] == "-" else 1.0) * np.eye(3)["xyz".index(up[-1])]


def _standing_fraction(postures: np.ndarray, up: Up) -> float:
    """Part of the frames in which the body stands along an axis."""
    lengths = np.maximum(norms(postures), 1e-300)
    return float(np.mean(postures @ _along(up) / lengths > 0.8))


def floor_spread(points: dict[str, np.ndarray], up: Up) -> float:
    """Spread of the level of the lowest joint along an axis (10th to 90th percentile); it is small, as bodies rest on a floor."""
    lowest = np.min([track @ _along(up) for track in points.values()], axis=0)
    low, high = np.percentile(lowest, [10, 90])
    return float(high - low)


def to_z_up(
    points: dict[str, np.ndarray],
    orientations: dict[str, np.ndarray],
    up: Up | tuple[float, float, float],
    unit_m: float,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Positions in metres and orientations, z up, by a proper rotation: y up becomes (z, x, y), a vector as its nearest axis."""
    z = _along(up) if isinstance(up, str) else vectors.unit(np.asarray(up, dtype=float))
    x = np.eye(3)[(int(np.argmax(np.abs(z))) + 1) % 3]
    x = vectors.unit(x - (x @ z) * z)
    rows = np.stack([x, np.cross(z, x), z])
    rotation = quaternions.from_matrix(rows)
    moved = {name: unit_m * (track @ rows.T) for name, track in points.items()}
    return moved, {name: quaternions.multiply(rotation, track) for name, track in orientations.items()}


def add_feet(points: dict[str, np.ndarray], orientations: dict[str, np.ndarray], tall_m: float) -> None:
    """Adds the balls of the feet, rigid on the ankles, where the file has none."""
    ahead = tall_m * (FOOT_AHEAD * facing(points) - FOOT_DOWN * np.array([0.0, 0.0, 1.0]))
    for side in ("left", "right"):
        if f"{side}_foot" not in points:
            ankle = orientations[f"{side}_ankle"]
            local = np.median(quaternions.rotate(quaternions.conjugate(ankle), ahead), axis=0)
            points[f"{side}_foot"] = points[f"{side}_ankle"] + quaternions.rotate(ankle, local)
            orientations[f"{side}_foot"] = ankle


def tpose_frames(points: dict[str, np.ndarray]) -> int:
    """Number of frames before a jump of the pose within the first five steps: a calibration pose in front of the motion."""
    pose = np.stack(list(points.values()), axis=1)
    pose = pose - pose[:, :1]
    steps = norms(np.diff(pose, axis=0)).mean(axis=1)
    if len(steps) < 10:
        return 0
    # A jump moves the joints by several cm on average, many times more than any step of the motion itself.
    jumps = np.flatnonzero(steps[:5] > max(0.03, 5.0 * float(np.percentile(steps[5:], 99))))
    return int(jumps[-1]) + 1 if len(jumps) else 0


def stays_in_tpose(points: dict[str, np.ndarray]) -> bool:
    """Whether the pose is one and the same in all frames, with straight arms held out to the sides."""
    arms = [points[f"{side}_{joint}"] for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist")]
    pose = (
        np.stack([*arms, *(points[f"{side}_ankle"] for side in ("left", "right"))], axis=1) - points["pelvis"][:, None]
    )
    if norms(pose - pose[:1]).max() > STILL * stature_m(points):
        return False
    left, right = ([vectors.unit(b[0] - a[0]) for a, b in pairwise(arm)] for arm in (arms[:3], arms[3:]))
    across = vectors.unit(arms[0][0] - arms[3][0])
    return min([*(bone @ across for bone in left), *(-bone @ across for bone in right)]) > STRAIGHT


def floor_level(points: dict[str, np.ndarray]) -> float:
    """Height at which the lowest foot joint stands, in the unit of the points."""
    feet = [name for name in points if name.endswith(("_ankle", "_foot", "_toe"))]
    return float(np.percentile(np.min([points[name][:, 2] for name in feet], axis=0), FLOOR_PERCENTILE))
