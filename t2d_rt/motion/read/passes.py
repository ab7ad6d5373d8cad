"""Make a `Motion` of the tracks that readers return: the options of reading, and the passes that all formats go through."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, choice, flag, number, positive, text
from t2d_rt.core.errors import InputError, printable, warn
from t2d_rt.geometry.vectors import inner, median_length, norms
from t2d_rt.motion.interpolate import JITTER_CUTOFF_HZ, JITTER_LIMIT_MPS, jitter_mps, parts, smooth, smoothed
from t2d_rt.motion.kinematics import facing, leg_m, middle, stature_m
from t2d_rt.motion.read.bvh import MAX_FRAMES
from t2d_rt.motion.read.clock import on_clock
from t2d_rt.motion.read.complete import add_level_feet, complete
from t2d_rt.motion.read.detect import (
    AUTO_STATURE_M,
    UNITS_M,
    GivenUp,
    Up,
    add_feet,
    floor_level,
    stance_axis,
    stays_in_tpose,
    to_z_up,
    tpose_frames,
    unit,
)
from t2d_rt.motion.read.ground import Root, levelled, rooted
from t2d_rt.motion.read.joint_sets import LEAST_LIKELY, unlikeness
from t2d_rt.motion.read.noise import told_flips, without_noise, without_rotation_noise
from t2d_rt.motion.read.orientations import SHORTEST_M, assemble, orientations_from_positions
from t2d_rt.motion.read.samples import whole, without_leaps
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import CANONICAL_JOINTS, OPTIONAL_JOINTS, Motion, checked_rate

# --- how a file is to be read, and where a motion comes from ---


AXES = ("x", "y", "z", "-x", "-y", "-z", "file")

LOWEST_CUTOFF_HZ = 0.1
"""Cut-off below which a low-pass leaves nothing of human movement and the filter's coefficients lose their digits."""


@dataclass(frozen=True, slots=True)
class Reading:
    """The options of `load_motion`; what is None is detected. Raises an InputError if an option is wrong."""

    units: float | str | None = None
    up: GivenUp | None = None
    floor: float | None = None
    drop_tpose: bool | None = None
    smooth_hz: float | Literal["auto"] | None = "auto"
    flavour: str | None = None
    rate_hz: float | None = None
    subject: str | None = None
    root: Root | None = None

    def __post_init__(self) -> None:
        if self.units is not None and not isinstance(self.units, str):
            positive("units", self.units, hint=f"metres per unit or one of {', '.join(UNITS_M)}")
        if self.floor is not None:
            number("floor", self.floor, -LARGEST_M, LARGEST_M, unit="m")
        if self.drop_tpose is not None:
            flag("drop_tpose", self.drop_tpose)
        if self.smooth_hz is not None and not (isinstance(self.smooth_hz, str) and self.smooth_hz == "auto"):
            number("smooth_hz", self.smooth_hz, LOWEST_CUTOFF_HZ, unit="Hz", hint="a cut-off in Hz, None or 'auto'")
        if self.rate_hz is not None:
            checked_rate(self.rate_hz)
        if self.root is not None:
            choice("root", self.root, ("file", "feet"))
        if isinstance(self.up, str):
            choice("up", self.up, AXES, hint="or give a vector in the file's axes")
        elif self.up is not None and not np.linalg.norm(array("up", self.up, (3,), limit=LARGEST_M)) > 0:
            raise InputError(
                "up must be an axis such as 'z' or '-y', 'file', or a vector of some length, got one without"
            )
        for name, value in (("flavour", self.flavour), ("subject", self.subject)):
            if value is not None:
                text(name, value)

    @property
    def axis(self) -> Up | tuple[float, float, float] | None:
        """The upward direction in the file that was given, None where it is to be found."""
        if self.up is None or isinstance(self.up, str):
            return None if self.up == "file" else self.up
        x, y, z = (float(value) for value in self.up)
        return x, y, z


def file_origin(path: Path) -> str:
    """A file by its name, without the folders of this machine, and its content."""
    with path.open("rb") as file:
        return f"{printable(path.name)}, sha256 {hashlib.file_digest(file, 'sha256').hexdigest()}"


# --- the passes that files of all formats go through, in this order ---
#
# `sampled` brings samples onto their clock and bridges gaps, in the file's own unit and axes; `upright` turns them z
# up in metres; `placed` drops a calibration pose, mends leaps, takes measured noise away, levels what a tilted camera
# saw, adds feet, finds the root's track and the floor. Each adds a clause to the report, in this order.


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """How a file's coordinates become metres, z up."""

    up: Up | tuple[float, float, float]
    """The upward direction in the file."""
    unit_m: float
    tall_m: float
    """Stature that follows from the unit [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A motion as it was read, and what was given or found for it."""

    motion: Motion
    frame: Frame
    floor_m: float
    """Height of the floor along the file's upward direction [m]."""
    start_s: float
    """Time of the first frame on the file's clock [s]."""
    tilt_deg: float
    """Angle by which floor and body were left tilted against the upward direction, 0 if they are not tilted."""


def motion_of(tracks: Tracks, reading: Reading) -> Found:
    """The motion of any file but BVH and GLB in metres, z up, floor at z = 0, with its report."""
    return placed(*_understood(sampled(tracks, reading), reading), reading)


def sampled(tracks: Tracks, reading: Reading) -> Tracks:
    """Tracks at their own rate, without gaps."""
    given_hz = reading.rate_hz
    tracks = on_clock(tracks) if given_hz is None else replace(tracks, rate_hz=float(given_hz), rate_assumed=False)
    checked_rate(tracks.rate_hz)
    return whole(tracks)


def _understood(tracks: Tracks, reading: Reading) -> tuple[Tracks, Frame]:
    """Canonical joints of one person, z up, and the file's frame; raises an InputError if they make no person."""
    if tracks.rate_assumed:
        assumed = f"{tracks.rate_hz:g} Hz assumed, the file does not say"
        tracks = replace(tracks, clauses=(assumed, *tracks.clauses))
    # Noise of 3 cm adds 0.2 to the score of limbs.
    if not tracks.turned and not unlikeness(tracks.points) <= 2 * LEAST_LIKELY:
        raise InputError(
            f"{tracks.form}: limbs change their length by half, or differ as much left and right; the joints' names or their order "
            "are wrong, or the tracks are damaged"
        )
    _check_together(tracks)
    tracks = _whole(_without_coincident(tracks))
    unit_m, tall_m = _unit(tracks.points, tracks.unit_m, reading.units)
    axis = reading.axis or (tracks.up if tracks.up and tracks.up_certain else stance_axis(tracks.points, tracks.up))
    frame = Frame(up=axis, unit_m=unit_m, tall_m=tall_m)
    tracks = upright(tracks, frame)
    _check_sides(tracks.points)
    return tracks, frame


def upright(tracks: Tracks, frame: Frame) -> Tracks:
    """Tracks in metres, z up."""
    points, turned = to_z_up(tracks.points, tracks.turned, frame.up, frame.unit_m)
    clauses = f"1 unit = {frame.unit_m:.4g} m (stature {frame.tall_m:.2f} m)", f"up {frame.up}"
    return replace(tracks, points=points, turned=turned).saying(*clauses)


def placed(tracks: Tracks, frame: Frame, reading: Reading) -> Found:
    """The motion of tracks in metres, z up; its floor is at z = 0."""
    has_rotations = bool(tracks.turned)
    tracks = _without_tpose(tracks, reading.drop_tpose)
    tracks = without_leaps(tracks)
    tracks, smoothing = (tracks, None) if has_rotations or reading.smooth_hz != "auto" else without_noise(tracks)
    tracks, ground = levelled(tracks, reading.up)
    tracks = _with_feet(tracks, frame.tall_m)
    tracks = rooted(tracks, reading.root)
    if reading.root == "feet" and ground is None:  # which planted feet show only now
        tracks, _ = levelled(tracks, reading.up)
    level = floor_level(tracks.points) if reading.floor is None else float(reading.floor)
    tracks = tracks.saying(f"floor at {level:.3f} m")
    if not has_rotations:
        turned = orientations_from_positions(tracks.points, tracks.rate_hz)
        tracks = replace(tracks, turned=turned).saying("rotations from positions")
    motion = assemble(tracks.points, tracks.turned, tracks.rate_hz, level)
    form, clauses, start_s = tracks.form, tracks.clauses, tracks.start_s
    if start_s:
        clauses = (*clauses, f"begins at {start_s:.6g} s of the file")
    del tracks  # half of the memory that a long motion takes
    local = parts(motion) if has_rotations else None
    if local is not None and (flipped := told_flips(local[1], motion.names, motion.rate_hz)):
        clauses = (*clauses, flipped)
        warn(f"{clauses[-1]}; mend them in the file, for a radar sees them as fast movement")
    if smoothing is None:
        motion, smoothing = _smoothed(motion, reading.smooth_hz, local)
    # At lower rates the speed of a walker's joints errs by 0.1 m/s and more, that of a runner's by 0.2 m/s.
    if motion.rate_hz < 15.0:
        warn(
            f"{motion.rate_hz:g} frames a second hold movements up to {0.5 * motion.rate_hz:g} Hz only, a walker's feet and hands "
            "move faster: joint speeds err by 0.1 m/s and more; record at 20 Hz or above"
        )
    frames = f"{form}, {len(motion.joints)} frames at {motion.rate_hz:g} Hz"
    motion = replace(motion, report="; ".join([frames, *clauses, smoothing]))
    tilt_deg = ground.angle_deg if ground is not None and ground.tilted and reading.up is not None else 0.0
    return Found(motion=motion, frame=frame, floor_m=level, start_s=start_s, tilt_deg=tilt_deg)


def _smoothed(
    motion: Motion, smooth_hz: float | str | None, local: tuple[np.ndarray, np.ndarray] | None
) -> tuple[Motion, str]:
    """The motion low-passed as asked for, and a clause for its report.

    local: the motion's `parts` if its rotations are the file's own, so that their noise is to be measured.
    """
    if smooth_hz is None:
        return motion, "not smoothed"
    if smooth_hz != "auto":
        return smooth(motion, float(smooth_hz)), f"smoothed at {float(smooth_hz):g} Hz"
    jitter = jitter_mps(motion)
    denoised = without_rotation_noise(motion, local, filtered=jitter > JITTER_LIMIT_MPS) if local else None
    if denoised is not None:
        return denoised
    if jitter <= JITTER_LIMIT_MPS:
        return motion, f"not smoothed (jitter {jitter:.3f} m/s above {JITTER_CUTOFF_HZ:g} Hz)"
    clause = f"smoothed at {JITTER_CUTOFF_HZ:g} Hz (jitter {jitter:.2f} m/s above it)"
    return smoothed(motion, local or parts(motion), JITTER_CUTOFF_HZ), clause


def _check_together(tracks: Tracks) -> None:
    """Raises an InputError if hips and shoulders are those of several bodies."""
    at = tracks.points
    between = [at[f"left_{joint}"] - at[f"right_{joint}"] for joint in ("hip", "shoulder")]
    apart = [middle(at, "hip") - middle(at, "shoulder"), *between]
    width = max(median_length(vectors) for vectors in apart)
    legs = width / max(leg_m(at), 1e-12)
    # A trunk is 0.6 legs long.
    if legs > 1.5:
        raise InputError(
            f"{tracks.form}: hips and shoulders lie {legs:.1f} lengths of a leg apart, as of several persons; give each person's "
            "points names of their own"
        )


def _without_coincident(tracks: Tracks) -> Tracks:
    """Tracks without optional joints that lie on their parents in any frame, as SMPL's hands do where they are only filled."""
    points = tracks.points
    left_out = [
        name
        for name, parent in OPTIONAL_JOINTS.items()
        if name in points
        and parent in points
        and (np.abs(points[name] - points[parent]).max(axis=-1) <= SHORTEST_M).any()
    ]
    if not left_out:
        return tracks
    points, turned = (
        {name: track for name, track in by_name.items() if name not in left_out} for by_name in (points, tracks.turned)
    )
    return replace(tracks, points=points, turned=turned).saying(f"left out {', '.join(left_out)} (on the joint before)")


def _whole(tracks: Tracks) -> Tracks:
    """Tracks with every canonical joint but feet; raises an InputError for too few or too many frames."""
    frames = len(tracks)
    if frames < 2:
        raise InputError(f"{tracks.form}: a motion needs at least 2 frames, got {frames}")
    if frames > MAX_FRAMES:
        raise InputError(f"{tracks.form}: {frames} frames are too many, {MAX_FRAMES} are read at most; cut the motion")
    if all(name in tracks.points or name.endswith("_foot") for name in CANONICAL_JOINTS):
        return tracks
    assert not tracks.turned, "formats with rotations give every joint"
    points, clauses = complete(tracks.points)
    return replace(tracks, points=points).saying(*clauses)


def _unit(points: dict[str, np.ndarray], nominal_m: float | None, units: float | str | None) -> tuple[float, float]:
    if units is None and nominal_m is not None:
        tall_m = nominal_m * stature_m(points)
        if AUTO_STATURE_M[0] <= tall_m <= AUTO_STATURE_M[1]:
            return nominal_m, tall_m
    return unit(points, units)


def _check_sides(points: dict[str, np.ndarray]) -> None:
    """Raises an InputError if knees and feet point backward: sides are swapped, or axes are left-handed."""
    ahead = facing(points)
    signs = []
    for side in ("left", "right"):
        hip, knee, ankle = (points[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle"))
        middle = 0.5 * (hip + ankle)
        bend = inner(knee - middle, ahead).mean() / max(float(norms(knee - middle).mean()), 1e-9)
        signs.append(bend)
        if f"{side}_foot" in points:
            foot = points[f"{side}_foot"] - ankle
            signs.append(inner(foot, ahead).mean() / max(float(norms(foot).mean()), 1e-9))
    if np.mean(signs) < -0.3:
        raise InputError(
            "knees and feet point backward: left and right are swapped, or the axes are left-handed; swap the names or "
            "reverse one axis"
        )


def _with_feet(tracks: Tracks, tall_m: float) -> Tracks:
    """Tracks to which missing balls of the feet are added."""
    points, turned = dict(tracks.points), dict(tracks.turned)
    if turned:
        add_feet(points, turned, tall_m)
        return replace(tracks, points=points, turned=turned)
    filled = add_level_feet(points, tall_m)
    return replace(tracks, points=points).saying(*([f"filled {', '.join(filled)}"] if filled else []))


def _without_tpose(tracks: Tracks, drop: bool | None) -> Tracks:
    """Tracks without a calibration pose at the start, as it is found; `drop` True drops one frame at least, False none."""
    frames = 0 if drop is False else max(tpose_frames(tracks.points), int(drop is True))
    clause = f"first {frames} frame(s) dropped (T-pose)" if frames else "no T-pose"
    if stays_in_tpose(tracks.points):
        clause = "a T-pose in all frames"
        warn(
            "the body stays in one pose with its arms held out to the sides, a T-pose, in all frames, as where all rotations are "
            "zero; store the rotations of its joints"
        )
    return tracks.piece(frames).saying(clause)
