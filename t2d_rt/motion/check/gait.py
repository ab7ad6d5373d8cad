"""Measure the steps of a gait, and tell from steps and flights whether a motion's frame rate is right."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from t2d_rt.geometry.vectors import inner, unit
from t2d_rt.motion.check.measures import GRAVITY_MPS2, RATE_HZ, Tracks, clearance, rate_of, spans
from t2d_rt.motion.kinematics import stature_m
from t2d_rt.types.motion import Motion

# --- steps of a walk or run, from the distance of the ankles along the direction that the body faces ---


HEADING_S = 1.0
"""Time over which the direction that the body faces is averaged: the pelvis turns with each step."""

LEAST_STEP = 0.02
"""Distance of the ankles along the heading, over stature, that the foot in front must gain on the other to be a step."""

UPRIGHT = 0.75
"""Least height of the hips in walking or running, over the length of the leg."""

HALTED_MPS = 0.10
"""Speed of the hips, averaged over half a second, below which a walker stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gait:
    """Figures of the steps; lengths are over stature, so that persons can be compared. NaN where there are too few steps."""

    steps: int
    cadence_per_min: float
    """Steps a minute by the median time of a step."""
    speed_mps: float
    """Mean speed of the hips over the ground."""
    net_mps: float
    """Distance between first and last place of the hips over the time."""
    step_length: float
    """Median distance of the ankles along the heading when a foot is farthest in front."""
    length_asymmetry: float
    """Difference of the median step lengths with left and right foot in front, over their mean."""
    time_asymmetry: float
    """Difference of the median step times of both sides, over their mean."""
    time_variation: float
    """Standard deviation of step times, without the sides' own means, over their mean."""
    hastening: float
    """Relative change of step times from the first to the last third; negative where steps quicken."""
    width: float
    """Median distance of the ankles across the heading at steps, negative where they cross."""
    width_variation: float
    """Standard deviation of that distance."""
    knee_lift_deg: float
    """Angle of the thigh forward from the vertical, 97.5th percentile over both sides."""
    foot_lift: float
    """Rise of the ball of the foot from the 5th to the 98th percentile of its height, of the side with less."""
    trunk_lean_deg: float
    """Median inclination of the trunk, forward positive."""
    trunk_sway_deg: float
    """Range (5th to 95th percentile) of the trunk's sideward inclination."""
    arm_swing: float
    """Range of the wrist along the heading against the shoulder, mean of both sides."""
    halted_s: float
    """Time at a halt between the first and the last step."""


def gait_of(body: Tracks) -> Gait:
    """Figures of the steps of a motion; those for which it has too few steps are NaN."""
    ahead = _heading(body)
    side = np.stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))], axis=-1)
    tall = body.stature_m
    ankles = body["left_ankle"] - body["right_ankle"]
    apart, across = inner(ankles, ahead) / tall, inner(ankles, side) / tall
    peaks = alternations(apart, LEAST_STEP)
    left = apart[peaks] > np.median(apart[peaks]) if len(peaks) else np.zeros(0, bool)
    times = np.diff(peaks) / RATE_HZ
    lengths = np.abs(apart[peaks])
    hips = body["hips"]
    speed = np.linalg.norm(rate_of(hips)[:, :2], axis=-1)
    slow = np.convolve(speed, np.full(30, 1 / 30), mode="same") < HALTED_MPS
    thigh = [body[f"{name}_knee"] - body[f"{name}_hip"] for name in ("left", "right")]
    wrists = [inner(body[f"{name}_wrist"] - body[f"{name}_shoulder"], ahead) / tall for name in ("left", "right")]
    feet = [body[f"{name}_foot"][:, 2] for name in ("left", "right")]
    lift = [np.percentile(foot, 98) - np.percentile(foot, 5) for foot in feet]
    sway = np.degrees(np.arcsin(np.clip(inner(body.trunk, side), -1, 1)))
    duration_s = len(hips) / RATE_HZ
    return Gait(
        steps=len(peaks),
        cadence_per_min=60 / float(np.median(times)) if len(times) else np.nan,
        speed_mps=float(speed.mean()),
        net_mps=float(np.linalg.norm((hips[-1] - hips[0])[:2])) / duration_s,
        step_length=float(np.median(lengths)) if len(peaks) else np.nan,
        length_asymmetry=_asymmetry(lengths, left),
        time_asymmetry=_asymmetry(times, left[1:]),
        time_variation=_variation(times, left[1:]),
        hastening=_trend(times),
        width=float(np.median(across[peaks])) if len(peaks) else np.nan,
        width_variation=float(np.std(across[peaks])) if len(peaks) > 2 else np.nan,
        knee_lift_deg=float(
            np.percentile([np.degrees(np.arctan2(inner(bone, ahead), -bone[:, 2])) for bone in thigh], 97.5)
        ),
        foot_lift=float(min(lift)) / tall,
        trunk_lean_deg=float(np.degrees(np.median(np.arctan2(inner(body.trunk, ahead), body.trunk[:, 2])))),
        trunk_sway_deg=float(np.percentile(sway, 95) - np.percentile(sway, 5)),
        arm_swing=float(np.mean([np.percentile(wrist, 95) - np.percentile(wrist, 5) for wrist in wrists])),
        halted_s=float(slow[peaks[0] : peaks[-1]].sum()) / RATE_HZ if len(peaks) > 1 else 0.0,
    )


def travels(body: Tracks, least_mps: float, *, gap_s: float = 0.5, least_s: float = 0.8) -> list[Tracks]:
    """Pieces in which an upright body goes at a speed or faster, averaged over a second, the one that gets farthest first."""
    speed = np.linalg.norm(rate_of(body["hips"])[:, :2], axis=-1)
    width = min(round(RATE_HZ), len(speed))
    # At the ends the mean is over fewer frames.
    mean = np.convolve(speed, np.ones(width), mode="same") / np.convolve(
        np.ones(len(speed)), np.ones(width), mode="same"
    )
    upright = body["hips"][:, 2] > UPRIGHT * body.leg_m
    travelling = spans((mean > least_mps) & upright, gap=round(gap_s * RATE_HZ), least=round(least_s * RATE_HZ))
    distance = {(start, stop): float(speed[start:stop].sum()) for start, stop in travelling}
    farthest = sorted(travelling, key=distance.__getitem__, reverse=True)
    return [replace(body, joints=body.joints[start:stop]) for start, stop in farthest]


def _heading(body: Tracks) -> np.ndarray:
    """Unit vectors (T, 3) that the body faces, averaged over `HEADING_S`."""
    width = min(round(HEADING_S * RATE_HZ), len(body.facing))
    kernel = np.ones(width)
    return unit(np.stack([np.convolve(body.facing[:, axis], kernel, mode="same") for axis in range(3)], axis=-1))


def alternations(signal: np.ndarray, least: float) -> np.ndarray:
    """Frames of alternating maxima and minima that differ by `least` or more; the ends of the record are left out."""
    extremes: list[int] = []
    high = low = 0
    rising: bool | None = None
    for frame, value in enumerate(signal.tolist()):
        high = frame if value > signal[high] else high
        low = frame if value < signal[low] else low
        if rising is not False and value < signal[high] - least:
            extremes.append(high)
            rising, low = False, frame
        elif rising is not True and value > signal[low] + least:
            extremes.append(low)
            rising, high = True, frame
    return np.array([frame for frame in extremes if 0 < frame < len(signal) - 1], dtype=int)


def _asymmetry(values: np.ndarray, left: np.ndarray) -> float:
    if left.sum() < 2 or (~left).sum() < 2:
        return np.nan
    one, other = float(np.median(values[left])), float(np.median(values[~left]))
    return abs(one - other) / max(0.5 * (one + other), 1e-9)


def _variation(times: np.ndarray, left: np.ndarray) -> float:
    if left.sum() < 2 or (~left).sum() < 2:
        return np.nan
    rest = np.where(left, times - times[left].mean(), times - times[~left].mean())
    return float(np.std(rest) / times.mean())


def _trend(times: np.ndarray) -> float:
    third = len(times) // 3
    if third < 2:
        return np.nan
    first, last = float(np.mean(times[:third])), float(np.mean(times[-third:]))
    return (last - first) / first


# --- whether a motion's frame rate agrees with gravity: by the acceleration in flight, and by the speed of a walk ---
#
# Flights and steps are found by places and frames alone, so that a wrong rate does not change which are found and shows
# in their figures. On 144 recordings (dances, jumps and walks of many styles at 16 to 120 Hz) the acceleration in
# flight was 0.93 to 1.2 g (in single jumps of a dancer 1.5), and walks had 0.68 to 1.3 times the speed that goes with
# the length of their steps.


USUAL_HZ = (10, 12, 12.5, 15, 20, 24, 25, 30, 50, 60, 75, 90, 100, 120, 150, 200, 240, 250, 300, 480)

OFF_FLOOR = 0.03
"""Height of the lowest point over stature from which a body is in flight."""

FEWEST_FRAMES = 6
LEAST_RISE_M = 0.02
LARGEST_MISFIT = 0.12
"""Fewest frames of a flight, least rise of its parabola over them, and greatest standard deviation from it, over that rise."""

HIGH_G = 1.6
"""Acceleration in g above which a rate is too high; a quarter of the flights at most may have less."""

LOW_G, HIGH_RISE_M, SMALLEST_MISFIT = 0.45, 0.05, 0.03
"""Acceleration in g that all flights stay below if a rate is too low; only parabolas of at least this rise and at most this misfit
over it count, because partners lift and swings carry."""

LEAST_STEP_OF_LEG, FEWEST_STEPS = 0.5, 3
"""Least length of a walk's steps, over the length of the leg, and the fewest steps: shorter ones are taken at any pace."""

UNEVEN, SLIDES, STRIDES = 0.15, 0.1, (0.6, 1.5)
"""Limits of a steady walk: greatest standard deviation of the steps' times over their mean, greatest slide of the planted foot over
stature, and least and greatest distance that the hips go in a step, over its length."""

SWING = 0.35
"""Least part of a step that the centre of mass goes while the other foot is in the air. A person who really walks in slow motion
shifts the weight while both feet stand, because standing on one foot would mean a fall."""

SLOW, FAST = 0.55, 1.65
"""Speed of a walk over the one that goes with its steps, from which the rate is too low or too high."""


@dataclass(frozen=True, slots=True)
class Walk:
    """Medians over the steady steps of a walk."""

    length_m: float
    time_s: float
    pace: float
    """Speed over the one that goes with steps of that length."""


def rate_doubt(motion: Motion) -> str | None:
    """A sentence that says by how much a motion's rate is too high or too low, and which one fits; None without such signs."""
    points = {name: motion.joints[:, place] for place, name in enumerate(motion.names)}
    body = Tracks(names=motion.names, joints=motion.joints, stature_m=max(stature_m(points), 1e-3))
    rate_hz = motion.rate_hz
    fall_g = falls_g(body, rate_hz)
    if fall_g is not None:
        reason = f"in flight the body accelerates at {GRAVITY_MPS2 * fall_g:.1f} m/s^2, {fall_g:.1f} g"
        return _rate_sentence(reason, rate_hz, math.sqrt(fall_g))
    walk = walk_of(body, rate_hz)
    if walk is None or SLOW <= walk.pace <= FAST:
        return None
    speed = walk.length_m / walk.time_s
    reason = (
        f"it walks at {speed:.2f} m/s with steps of {walk.length_m:.2f} m, a step each {walk.time_s:.2f} s, which go with "
        f"{speed / walk.pace:.2f} m/s"
    )
    return _rate_sentence(reason, rate_hz, walk.pace)


def _rate_sentence(reason: str, rate_hz: float, factor: float) -> str:
    away = [abs(math.log(usual * factor / rate_hz)) for usual in USUAL_HZ]
    fits = USUAL_HZ[away.index(min(away))]
    wrong = f"high by {factor:.2f}" if factor > 1 else f"low by {1 / factor:.2f}"
    return f"{reason}: the rate of {rate_hz:g} Hz is too {wrong}, {fits:g} Hz would fit"


def falls_g(body: Tracks, rate_hz: float) -> float | None:
    """Downward acceleration in flight [g] if it cannot be that of a fall, else None; joints of `body` are at `rate_hz`."""
    height, high, low = body.centre_of_mass[:, 2], [], []
    for start, stop in spans(clearance(body).min(axis=1) > OFF_FLOOR * body.stature_m, least=FEWEST_FRAMES):
        flight = height[start + 1 : stop - 1]  # a foot may still push or already land in the outer frames
        time = np.arange(len(flight)) / rate_hz
        fit = np.polynomial.Polynomial.fit(time, flight, 2)
        falling = -float(fit.deriv(2)(0.0))
        rise_m, misfit_m = falling * time[-1] ** 2 / 8, float(np.std(flight - fit(time)))
        if rise_m > LEAST_RISE_M and misfit_m < LARGEST_MISFIT * rise_m:
            high.append(falling / GRAVITY_MPS2)
        if rise_m > HIGH_RISE_M and misfit_m < SMALLEST_MISFIT * rise_m:
            low.append(falling / GRAVITY_MPS2)
    if high and np.percentile(high, 25) > HIGH_G:
        return float(np.median(high))
    return float(np.median(low)) if low and max(low) < LOW_G else None


def walk_of(body: Tracks, rate_hz: float) -> Walk | None:
    """Medians of steady long steps on planted feet, None if there are too few; joints of `body` are at `rate_hz`.

    A step of length l by a leg h goes with the speed v at which 2 l / h = 2.3 (v^2 / g h)^0.3 (Alexander 1976); the recorded walks
    have 0.78 of it.
    """
    hips, leg_m = body["hips"][:, :2], body.leg_m
    apart = inner(body["left_ankle"] - body["right_ankle"], body.facing)
    peaks = alternations(apart / body.stature_m, 0.15).tolist()
    steps = []
    for start, stop in pairwise(peaks):
        length = 0.5 * float(abs(apart[start]) + abs(apart[stop]))
        gone = float(np.linalg.norm(hips[stop] - hips[start]))
        if apart[start] * apart[stop] < 0 and STRIDES[0] < gone / length < STRIDES[1]:
            stands, swings = ("right", "left") if apart[stop] > 0 else ("left", "right")
            slide, swung = _support(body, slice(start, stop + 1), stands, swings)
            steps.append((length, (stop - start) / rate_hz, slide / body.stature_m, swung / gone))
    if len(steps) < FEWEST_STEPS:
        return None
    length, time_s, slide, swung = np.median(steps, axis=0).tolist()
    times = np.array(steps)[:, 1]
    if length < LEAST_STEP_OF_LEG * leg_m or times.std() > UNEVEN * times.mean() or slide > SLIDES or swung < SWING:
        return None
    usual_mps = 0.78 * math.sqrt(GRAVITY_MPS2 * leg_m * (2 * length / leg_m / 2.3) ** (1 / 0.3))
    return Walk(length, time_s, length / time_s / usual_mps)


def _support(body: Tracks, step: slice, stands: str, swings: str) -> tuple[float, float]:
    """Distances [m] that the planted foot moves in the middle of a step, and the centre of mass while the other foot is up."""
    foot, other = (0.5 * (body[f"{side}_ankle"] + body[f"{side}_foot"])[step, :2] for side in (stands, swings))
    frames = len(foot)
    middle = foot[int(0.15 * frames) : frames - int(0.15 * frames)]
    moved = np.linalg.norm(other - other[0], axis=-1) / max(float(np.linalg.norm(other[-1] - other[0])), 1e-9)
    first, last = int((moved > 0.05).argmax()), frames - 1 - int((moved < 0.95)[::-1].argmax())
    centre = body.centre_of_mass[step, :2]
    return float(np.ptp(middle, axis=0).max()), float(np.linalg.norm(centre[last] - centre[first]))
