"""Tracks of joints, as a format's reader finds them -> `Motion`: what all formats but BVH share."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.motion.posture import facing, stature_m
from t2d_rt.motion.read.bvh import MAX_FRAMES
from t2d_rt.motion.read.clock import Times, on_clock
from t2d_rt.motion.read.complete import add_level_feet, complete
from t2d_rt.motion.read.detect import (
    AUTO_STATURE_M,
    Up,
    add_feet,
    floor_level,
    stance_axis,
    to_z_up,
    tpose_frames,
    unit,
)
from t2d_rt.motion.read.ground import levelled
from t2d_rt.motion.read.joint_sets import LEAST_LIKELY, unlikeness
from t2d_rt.motion.read.noise import SPEED_ERROR_MPS, denoised
from t2d_rt.motion.read.orientations import SHORTEST_M, orientations_from_positions
from t2d_rt.motion.read.positions import assemble
from t2d_rt.motion.read.reading import Reading, smoothed
from t2d_rt.motion.read.root import rooted
from t2d_rt.motion.read.samples import Samples, whole, without_leaps
from t2d_rt.types.motion import CANONICAL_JOINTS, OPTIONAL_JOINTS, Motion, checked_rate

LOW_RATE_HZ = 15.0
"""Below, frames alone leave errors of 0.1 m/s and more in the speed of a walker's joints, of 0.2 m/s in a runner's."""

MISLABELLED = 2 * LEAST_LIKELY
"""Score of limbs above which joints are not what they are called; noise of 3 cm adds 0.2."""

WIDEST = 1.5
"""Lengths of a leg from which a trunk is too long, or hips or shoulders too wide, for one person; trunks have 0.6."""

BACKWARD = -0.3
"""Mean forward component of feet and knees (-1 to 1) from which left and right must be swapped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracks:
    """Joints of one person by canonical name, in the file's own unit and axes."""

    form: str
    """What the file was read as."""
    points: dict[str, np.ndarray]
    """Positions (T, 3); the limbs' joints at least."""
    rate_hz: float
    orientations: dict[str, np.ndarray] | None = None
    """Global orientations x, y, z, w (T, 4) of the same joints; None where the file holds positions alone."""
    times: Times | None = None
    """When the frames were taken, where the file says so."""
    rate_assumed: bool = False
    """Whether the rate is the format's usual one, which the file does not give."""
    told: tuple[str, ...] = ()
    """What was assumed, in clauses for the report."""
    unit_m: float | None = None
    """The format's own unit [m]; None is found from the body."""
    up: Up | None = None
    """The format's own upward axis."""
    up_certain: bool = True
    """Whether files of this format keep to it; else a body that stands along another axis decides."""


def motion_of(tracks: Tracks, reading: Reading) -> Motion:
    """The motion in metres, z up, floor at z = 0, with its report."""
    tracks = tracks if reading.rate_hz is not None else on_clock(tracks)
    rate_hz = checked_rate(tracks.rate_hz if reading.rate_hz is None else reading.rate_hz)
    given = Samples(points=tracks.points, turned=tracks.orientations or {}, rate_hz=rate_hz)
    samples = whole(tracks.form, given)
    rate_hz = samples.rate_hz
    tracks = replace(tracks, points=samples.points, orientations=samples.turned or None)
    if tracks.orientations is None and not unlikeness(tracks.points) <= MISLABELLED:
        raise InputError(
            f"{tracks.form}: limbs change their length by half, or differ as much left and right; the joints' names or their order "
            "are wrong, or the tracks are damaged"
        )
    _check_together(tracks)
    tracks, apart = _without_coincident(tracks)
    points, filled = _whole(tracks)
    told = [*samples.told, *tracks.told, *apart, *filled]
    if tracks.rate_assumed and reading.rate_hz is None:
        told.insert(0, f"{rate_hz:g} Hz assumed, the file does not say")
    unit_m, tall_m = _unit(points, tracks.unit_m, reading.units)
    axis = reading.axis or (tracks.up if tracks.up and tracks.up_certain else stance_axis(points, tracks.up))
    points, turned = to_z_up(points, tracks.orientations or {}, axis, unit_m)
    _check_sides(points)
    points, turned, dropped = _without_tpose(points, turned, reading.drop_tpose)
    steady = without_leaps(Samples(points=points, turned=turned, rate_hz=rate_hz))
    points, turned = steady.points, steady.turned
    told += steady.told
    points, smoothing = (points, None) if turned else _quiet(points, rate_hz, reading)
    points, turned, ground = levelled(points, turned, rate_hz, reading.up)
    told += _feet(points, turned, tall_m)
    points, walked = rooted(points, rate_hz, reading.root)
    if reading.root == "feet" and not ground:  # which planted feet show only now
        points, turned, ground = levelled(points, turned, rate_hz, reading.up)
    level = floor_level(points) if reading.floor is None else float(reading.floor)
    if tracks.orientations is None:
        turned = orientations_from_positions(points, rate_hz)
        told.append("rotations from positions")
    motion = assemble(points, turned, rate_hz, level)
    if smoothing is None:
        motion, smoothing = smoothed(motion, reading.smooth_hz, rotations=tracks.orientations is not None)
    warn_of_rate(rate_hz)
    told = [
        f"{tracks.form}, {len(motion.joints)} frames at {rate_hz:g} Hz", *told,
        f"1 unit = {unit_m:.4g} m (stature {tall_m:.2f} m)", f"up {axis}", *ground, *walked,
        f"first {dropped} frame(s) dropped (T-pose)" if dropped else "no T-pose", f"floor at {level:.3f} m", smoothing,
    ]  # fmt: skip
    return replace(motion, report="; ".join(told))


def _check_together(tracks: Tracks) -> None:
    """Refuses hips and shoulders that are those of several bodies."""
    at = {
        f"{s}_{joint}": tracks.points[f"{s}_{joint}"]
        for s in ("left", "right")
        for joint in ("hip", "knee", "ankle", "shoulder")
    }
    middle = {joint: 0.5 * (at[f"left_{joint}"] + at[f"right_{joint}"]) for joint in ("hip", "shoulder")}
    apart = [middle["hip"] - middle["shoulder"], *(at[f"left_{joint}"] - at[f"right_{joint}"] for joint in middle)]
    bones = [
        at[f"{s}_{a}"] - at[f"{s}_{b}"] for s in ("left", "right") for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    width, leg = (np.median(np.linalg.norm(each, axis=-1), axis=-1) for each in (apart, bones))
    legs = float(width.max() / max(0.5 * leg.sum(), 1e-12))
    if legs > WIDEST:
        raise InputError(
            f"{tracks.form}: hips and shoulders lie {legs:.1f} lengths of a leg apart, as of several persons; give each person's "
            "points names of their own"
        )


def _without_coincident(tracks: Tracks) -> tuple[Tracks, list[str]]:
    """Tracks without optional joints that lie on their parents in any frame, as SMPL's hands where they are only filled."""
    points = tracks.points
    left_out = [
        name
        for name, parent in OPTIONAL_JOINTS.items()
        if name in points
        and parent in points
        and (np.abs(points[name] - points[parent]).max(axis=-1) <= SHORTEST_M).any()
    ]
    if not left_out:
        return tracks, []
    kept = {name: track for name, track in points.items() if name not in left_out}
    turned = tracks.orientations and {name: tracks.orientations[name] for name in kept}
    return replace(tracks, points=kept, orientations=turned), [f"left out {', '.join(left_out)} (on the joint before)"]


def _whole(tracks: Tracks) -> tuple[dict[str, np.ndarray], list[str]]:
    """Points of every canonical joint but feet; refuses too few or too many frames."""
    frames = len(next(iter(tracks.points.values())))
    if frames < 2:
        raise InputError(f"{tracks.form}: a motion needs at least 2 frames, got {frames}")
    if frames > MAX_FRAMES:
        raise InputError(f"{tracks.form}: {frames} frames are too many, {MAX_FRAMES} are read at most; cut the motion")
    lacking = [name for name in CANONICAL_JOINTS if name not in tracks.points and not name.endswith("_foot")]
    if not lacking:
        return dict(tracks.points), []
    assert tracks.orientations is None, "formats with rotations give every joint"
    return complete(tracks.points)


def _unit(points: dict[str, np.ndarray], nominal_m: float | None, units: float | str | None) -> tuple[float, float]:
    if units is None and nominal_m is not None:
        tall_m = nominal_m * stature_m(points)
        if AUTO_STATURE_M[0] <= tall_m <= AUTO_STATURE_M[1]:
            return nominal_m, tall_m
    return unit(points, units)


def _check_sides(points: dict[str, np.ndarray]) -> None:
    """Refuses a body whose knees and feet point backward: its sides are swapped, or its axes left-handed."""
    ahead = facing(points)
    signs = []
    for side in ("left", "right"):
        hip, knee, ankle = (points[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle"))
        middle = 0.5 * (hip + ankle)
        bend = ((knee - middle) * ahead).sum(axis=-1).mean() / max(
            float(np.linalg.norm(knee - middle, axis=-1).mean()), 1e-9
        )
        signs.append(bend)
        if f"{side}_foot" in points:
            foot = points[f"{side}_foot"] - ankle
            signs.append((foot * ahead).sum(axis=-1).mean() / max(float(np.linalg.norm(foot, axis=-1).mean()), 1e-9))
    if np.mean(signs) < BACKWARD:
        raise InputError(
            "knees and feet point backward: left and right are swapped, or the axes are left-handed; swap the names or "
            "reverse one axis"
        )


def _feet(points: dict[str, np.ndarray], turned: dict[str, np.ndarray], tall_m: float) -> list[str]:
    if turned:
        add_feet(points, turned, tall_m)
        return []
    filled = add_level_feet(points, tall_m)
    return [f"filled {', '.join(filled)}"] if filled else []


def _without_tpose(
    points: dict[str, np.ndarray], turned: dict[str, np.ndarray], drop: bool | None
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], int]:
    frames = tpose_frames(points) if drop is not False else 0
    frames = max(frames, 1) if drop else frames
    return (
        {name: track[frames:] for name, track in points.items()},
        {name: track[frames:] for name, track in turned.items()},
        frames,
    )


def _quiet(points: dict[str, np.ndarray], rate_hz: float, reading: Reading) -> tuple[dict[str, np.ndarray], str | None]:
    """Points freed of measured noise and a clause for the report; None where the usual smoothing is to decide."""
    if reading.smooth_hz != "auto":
        return points, None
    found = denoised(points, rate_hz)
    if not found.cutoffs_hz:
        return points, None
    low, high = found.cutoffs_hz[0], found.cutoffs_hz[-1]
    span = f"{low:g} Hz" if math.isclose(low, high) else f"{low:g} to {high:g} Hz, joint by joint"
    error = f"joint speeds err by about {found.speed_error_mps:.2f} m/s"
    if found.speed_error_mps > SPEED_ERROR_MPS:
        warnings.warn(
            f"the joints' noise of {1e3 * found.noise_m:.1f} mm at {rate_hz:g} Hz leaves too much after smoothing: {error}; "
            "micro-Doppler finer than that is noise",
            T2DWarning,
            stacklevel=2,
        )
    return found.points, f"noise of {1e3 * found.noise_m:.1f} mm (from bone lengths) smoothed at {span} ({error})"


def warn_of_rate(rate_hz: float) -> None:
    """Warns where frames come too seldom for a walk."""
    if rate_hz < LOW_RATE_HZ:
        warnings.warn(
            f"{rate_hz:g} frames a second hold movements up to {0.5 * rate_hz:g} Hz only, a walker's feet and hands move faster: "
            "joint speeds err by 0.1 m/s and more; record at 20 Hz or above",
            T2DWarning,
            stacklevel=2,
        )
