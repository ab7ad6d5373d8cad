"""Change motions in one respect: exchange left and right, see them from elsewhere, hold their end, walk faster or slower."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from t2d_rt.core.checks import instance, integer, number
from t2d_rt.core.errors import InputError
from t2d_rt.motion.check.measures import seated, tracks
from t2d_rt.motion.edit import main_direction
from t2d_rt.motion.interpolate import low_pass, minimum_jerk, sample, wander
from t2d_rt.types import Radar
from t2d_rt.types.motion import Motion, checked_motion

# --- the same motion with left and right exchanged ---


def mirror(motion: Motion) -> Motion:
    """The motion seen in a mirror that stands in the plane y = 0: what the left hand did the right hand does."""
    checked_motion(motion)
    order = [motion.names.index(_other_side(name)) for name in motion.names]
    # A reflection at y = 0 turns rotations about x and z around and leaves those about y.
    joints = motion.joints[:, order] * np.array([1.0, -1.0, 1.0])
    rotations = motion.rotations[:, order] * np.array([-1.0, 1.0, -1.0, 1.0])
    carries = tuple(
        replace(
            carried,
            joint=_other_side(carried.joint),
            position_m=(carried.position_m[0], -carried.position_m[1], carried.position_m[2]),
            rotation=(-carried.rotation[0], carried.rotation[1], -carried.rotation[2], carried.rotation[3]),
        )
        for carried in motion.carries
    )
    return motion.edited("mirrored", joints=joints, rotations=rotations, carries=carries)


def _other_side(name: str) -> str:
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)


# --- the same motion seen from elsewhere: a radar on a circle around its start (Text2Doppler's change of view) ---


def vary_view(motion: Motion, radar: Radar, *, angle_deg: float, height_m: float | None = None) -> Radar:
    """The radar at another place around a motion that was placed before it; the motion and the distance of its start stay.

    angle_deg: angle between the motion's main direction (that of the pelvis's track by principal components; on the spot, the one
        that the body faces) and the line from its start to the radar, counterclockwise from above: at 0 the person comes towards
        the radar, at 90 passes across, at 180 goes away. The radial speed of the start follows the cosine.
    height_m: height of the new radar [m]; by default its own. The distance to the pelvis at the start is kept in three dimensions.

    The new radar looks at the pelvis where the motion starts. Raises an InputError for a moving radar, a motion in its own
    coordinates, or a height out of reach.
    """
    checked_motion(motion)
    instance("radar", radar, Radar, "a Radar")
    if radar.track is not None:
        raise InputError("vary_view needs a radar that stands still, got one with a track; vary its poses instead")
    number("angle_deg", angle_deg, -1e6, 1e6, unit="deg")
    if motion.placed is False:  # simulate would put it before the new radar as before any other
        raise InputError(
            "vary_view needs a motion in the radar's world, and this one lies in its own coordinates; put it there with place"
        )
    start, before = motion.joints[0, 0], np.array(radar.position_m)
    height = float(before[2]) if height_m is None else number("height_m", height_m, -1e3, 1e3, unit="m")
    distance = float(np.linalg.norm(before - start))
    level2 = distance**2 - (height - start[2]) ** 2
    if not level2 > 1e-6 * distance**2:
        raise InputError(
            f"a radar at a height of {height:.3g} m cannot be {distance:.3g} m from the start of the motion, whose pelvis is at "
            f"{start[2]:.3g} m; give a height between {start[2] - distance:.3g} and {start[2] + distance:.3g} m"
        )
    ahead = main_direction(motion)
    angle = math.atan2(ahead[1], ahead[0]) + math.radians(angle_deg)
    position = np.array([*(start[:2] + math.sqrt(level2) * np.array([math.cos(angle), math.sin(angle)])), height])
    return radar.model_copy(
        update={"position_m": tuple(position.tolist()), "boresight": tuple((start - position).tolist())}
    )


# --- motions that are too short: the person comes to rest and stays ---


STOPPING_S = 0.6
"""Time in which a movement comes to rest [s]: about one step."""

LONGEST_S = 600.0


SWAY_RAD, SWAY_HZ, SWAY_SLOPE = (0.0042, 0.0027), (0.08, 5.0), 1.5
"""Lean of a person who stands quietly: its standard deviations forward and sideways [rad], its band [Hz], and the exponent b of
its spectrum, whose power falls in that band as f^-2b. The centre of mass, some 0.95 m high, sways by 4 and 2.5 mm, mostly below
0.5 Hz (Winter 1995, Gait and Posture 3: 193). The band ends at 5 Hz because echoes of recorded people at rest do not agree with
less (docs/decisions.md, A device's points by the device's own chain)."""
OFF_FEET_M = 0.1
"""Level distance of the centre of mass from the middle of the feet [m] above which a seat carries a body with level thighs: it is
0.17 to 0.41 m in made sits and up to 0.03 m in squats, and feet reach some 0.13 m."""


def hold(motion: Motion, duration_s: float, *, sway_seed: int | None = None) -> Motion:
    """The motion, longer by a time [s] in which its last pose is held.

    sway_seed: seed of the small sway of a person at rest, which grows with the height over what bears the body: the feet stay, in
        sitting also the hips and legs, and a lying person hardly moves. None holds the pose quite still.

    The last 0.3 s are shown more and more slowly, within 0.6 s, so that a person who moves at the end comes to rest without a jump
    of speed or acceleration; of a shorter hold or a shorter motion, as much as there is.
    """
    checked_motion(motion)
    number("duration_s", duration_s, 0.0, LONGEST_S, unit="s")
    stopping_s = min(STOPPING_S, 2.0 * duration_s, 2.0 * motion.duration_s)
    count = math.floor((motion.duration_s + duration_s) * motion.rate_hz + 1e-6) + 1
    times = np.arange(count) / motion.rate_hz
    begin_s = motion.duration_s - 0.5 * stopping_s
    x = np.clip((times - begin_s) / max(stopping_s, 1e-12), 0.0, 1.0)
    # What is shown goes on at speed 1 - minimum_jerk(x): the integral of that from 0 to x.
    slowed_s = begin_s + stopping_s * (x - x**4 * (2.5 + x * (x - 3.0)))
    shown_s = np.where(times < begin_s, times, np.minimum(slowed_s, motion.duration_s))
    joints, rotations = sample(motion, shown_s)
    if sway_seed is not None:
        rests = minimum_jerk((times - begin_s) / max(stopping_s, 1e-12))
        joints = joints + rests[:, None, None] * _swaying(motion, joints[-1], times, sway_seed)
    return motion.edited(f"held for {duration_s:g} s", joints=joints, rotations=rotations)


def _swaying(motion: Motion, pose: np.ndarray, times_s: np.ndarray, seed: int) -> np.ndarray:
    """Sway (T, J, 3) [m] of the joints of a pose (J, 3) [m] at times (T,) [s]."""
    left = (pose[motion.index("left_hip")] - pose[motion.index("right_hip")])[:2]
    left = left / max(float(np.linalg.norm(left)), 1e-9)
    axes = np.array([[left[1], -left[0], 0.0], [*left, 0.0]])
    lean = np.array(SWAY_RAD) * wander(np.random.default_rng(seed), times_s, 2, SWAY_HZ, SWAY_SLOPE)
    body = tracks(motion)
    feet = np.mean([body[f"{side}_{part}"][-1] for side in ("left", "right") for part in ("ankle", "foot")], axis=0)
    sits = seated(body)[-1] and np.linalg.norm((body.centre_of_mass[-1] - feet)[:2]) > OFF_FEET_M
    borne_m = pose[motion.index("pelvis"), 2] if sits else pose[:, 2].min()
    return (lean @ axes)[:, None] * np.maximum(pose[:, 2] - borne_m, 0.0)[:, None]


# --- faster and slower gaits: times between foot peaks are stretched (Text2Doppler's change of gait) ---


FACTORS = 0.25, 4.0
"""Least and greatest factor of the tempo; people walk between half and twice their own pace."""

STEP_CUTOFF_HZ = 6.0
"""Cut-off frequency that smooths foot heights before their peaks are sought: steps come 1 to 3 times a second."""

LEAST_LIFT = 0.25
"""Height of a peak above the foot's lowest level, over the greatest such height in the motion, above which it is a step."""

EASE_S = 0.08
"""Standard deviation of the change from one segment's tempo to the next: joint speeds stay continuous."""


def step_times_s(motion: Motion) -> np.ndarray:
    """Times [s] at which a foot is at the top of its swing, both feet, in order: one for each step."""
    checked_motion(motion)
    peaks = [_peaks(motion.joints[:, motion.index(f"{side}_ankle"), 2], motion.rate_hz) for side in ("left", "right")]
    return np.sort(np.concatenate(peaks)) / motion.rate_hz


def vary_gait(motion: Motion, factor: float = 1.0, *, spread: float = 0.0, seed: int = 0) -> Motion:
    """The motion walked faster (`factor` above 1) or slower, step by step; its path and its planted feet stay where they are.

    Cadence and speed change by `factor`, the steps' lengths do not. spread: standard deviation of the logarithm of each step's own
    factor, drawn from `seed`; a healthy walk varies by 0.02 to 0.03 from step to step (Hausdorff 2005). The tempo changes
    smoothly at foot peaks. Without steps the whole motion changes alike. Raises an InputError if fewer than 2 frames would remain.
    """
    checked_motion(motion)
    number("factor", factor, *FACTORS)
    number("spread", spread, 0.0, 0.5)
    integer("seed", seed)
    knots = np.concatenate([[0.0], step_times_s(motion), [motion.duration_s]])
    knots = knots[np.concatenate([[True], np.diff(knots) > 1e-6])]
    draws = np.random.default_rng(seed).standard_normal(len(knots) - 1)
    factors = np.exp(spread * draws)
    factors *= factor * np.sum(np.diff(knots) / factors) / knots[-1]  # the whole takes 1 / factor of its time
    times_s = _warped(knots, factors, motion.rate_hz)
    if len(times_s) < 2:
        raise InputError(
            f"a factor of {factor:g} leaves less than 2 frames of a motion of {motion.duration_s:.3g} s; give a smaller one"
        )
    joints, rotations = sample(motion, times_s)
    note = f"gait {factor:.4g} times as fast" + (f", steps vary by {spread:g} (seed {seed})" if spread else "")
    new_s = np.arange(len(times_s)) / motion.rate_hz
    begins = ((name, float(np.interp(begin_s, times_s, new_s))) for name, begin_s in motion.activities)
    activities = tuple((name, begin_s) for name, begin_s in begins if begin_s < new_s[-1] or begin_s == 0)
    return motion.edited(note, joints=joints, rotations=rotations, activities=activities)


def _warped(knots: np.ndarray, factors: np.ndarray, rate_hz: float) -> np.ndarray:
    """Times (T,) of the motion [s] that the new frames show."""
    fine = np.arange(0.0, knots[-1], 1.0 / (4.0 * rate_hz))
    fine = np.append(fine, knots[-1])
    slowness = 1.0 / factors[np.clip(np.searchsorted(knots, fine, side="right") - 1, 0, len(factors) - 1)]
    width = EASE_S * 4.0 * rate_hz
    reach = int(np.ceil(4 * width))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    slowness = np.convolve(np.pad(slowness, reach, mode="edge"), kernel / kernel.sum(), mode="valid")
    steps = 0.5 * (slowness[1:] + slowness[:-1]) * np.diff(fine)
    shown_s = np.concatenate([[0.0], np.cumsum(steps)])
    frames = np.arange(int(np.floor(shown_s[-1] * rate_hz + 1e-6)) + 1) / rate_hz
    return np.interp(frames, shown_s, fine)


def _peaks(height: np.ndarray, rate_hz: float) -> np.ndarray:
    """Frames at which a foot is highest between two stances."""
    if rate_hz > 2.5 * STEP_CUTOFF_HZ and len(height) > 8:
        height = low_pass(height[:, None], STEP_CUTOFF_HZ, rate_hz)[:, 0]
    inner = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
    lift = height - height.min()
    peaks: list[int] = []
    for peak in inner[lift[inner] > LEAST_LIFT * max(lift.max(), 0.02)]:
        # Between two steps the foot comes down; of two peaks without a stance between them the higher one is the step.
        if peaks and height[peaks[-1] : peak].min() > height.min() + LEAST_LIFT * lift.max():
            peaks[-1] = int(peak) if height[peak] > height[peaks[-1]] else peaks[-1]
        else:
            peaks.append(int(peak))
    return np.array(peaks, dtype=int)
