"""Steps of a walk or run from the distance of the ankles along the direction that the body faces, and what they are like."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.geometry.vectors import unit
from t2d_rt.motion.check.tracks import RATE_HZ, Tracks, rate_of, spans

HEADING_S = 1.0
"""Time over which the direction that the body faces is averaged: the pelvis turns with each step."""

LEAST_STEP = 0.02
"""Distance of the ankles along the heading, over stature, that the foot in front must gain on the other to be a step."""

UPRIGHT = 0.75
"""Least height of the hips of one who walks or runs, over the length of the leg."""

HALTED_MPS = 0.10
"""A walker whose hips are slower, on average over half a second, stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gait:
    """Figures of the steps; lengths over stature, so that persons compare. NaN where there are too few steps."""

    steps: int
    cadence_per_min: float
    """Steps a minute, of the median step."""
    speed_mps: float
    """Mean speed of the hips over the ground."""
    net_mps: float
    """Distance between first and last place of the hips over the time."""
    step_length: float
    """Median distance of the ankles along the heading when a foot is farthest in front."""
    length_asymmetry: float
    """Difference of the median step lengths with left and right foot in front, over their mean."""
    time_asymmetry: float
    """The same of step times."""
    time_variation: float
    """Standard deviation of step times over their mean, after sides' own means are taken out."""
    hastening: float
    """Relative change of step times from the first to the last third; negative where steps quicken."""
    width: float
    """Median distance of the ankles across the heading at steps, negative where they cross."""
    width_variation: float
    """Standard deviation of that distance."""
    knee_lift_deg: float
    """Of the thigh forward from the vertical, 95th percentile."""
    foot_lift: float
    """Height of the ball of the foot, 98th percentile, of the side with less."""
    trunk_lean_deg: float
    """Median, forward positive."""
    trunk_sway_deg: float
    """Range (5th to 95th percentile) of the trunk's sideward inclination."""
    arm_swing: float
    """Range of the wrist along the heading against the shoulder, mean of both sides."""
    halted_s: float
    """Time at a halt between the first and the last step."""


def gait_of(body: Tracks) -> Gait:
    """What the steps of a motion are like; a motion without steps has NaN for what they would tell."""
    ahead = _heading(body)
    side = np.stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))], axis=-1)
    tall = body.stature_m

    def along(track: np.ndarray, axis: np.ndarray) -> np.ndarray:
        return np.sum(track * axis, axis=-1)

    ankles = body["left_ankle"] - body["right_ankle"]
    apart, across = along(ankles, ahead) / tall, along(ankles, side) / tall
    peaks = alternations(apart, LEAST_STEP)
    left = apart[peaks] > np.median(apart[peaks]) if len(peaks) else np.zeros(0, bool)
    times = np.diff(peaks) / RATE_HZ
    lengths = np.abs(apart[peaks])
    hips = body["hips"]
    speed = np.linalg.norm(rate_of(hips)[:, :2], axis=-1)
    slow = np.convolve(speed, np.full(30, 1 / 30), mode="same") < HALTED_MPS
    thigh = [body[f"{each}_knee"] - body[f"{each}_hip"] for each in ("left", "right")]
    wrists = [along(body[f"{each}_wrist"] - body[f"{each}_shoulder"], ahead) / tall for each in ("left", "right")]
    feet = [body[f"{each}_foot"][:, 2] for each in ("left", "right")]
    lift = [np.percentile(each, 98) - np.percentile(each, 5) for each in feet]
    sway = np.degrees(np.arcsin(np.clip(along(body.trunk, side), -1, 1)))
    duration_s = len(hips) / RATE_HZ
    return Gait(
        steps=len(peaks), cadence_per_min=60 / float(np.median(times)) if len(times) else np.nan,
        speed_mps=float(speed.mean()), net_mps=float(np.linalg.norm((hips[-1] - hips[0])[:2])) / duration_s,
        step_length=float(np.median(lengths)) if len(peaks) else np.nan, length_asymmetry=_asymmetry(lengths, left),
        time_asymmetry=_asymmetry(times, left[1:]), time_variation=_variation(times, left[1:]),
        hastening=_trend(times), width=float(np.median(across[peaks])) if len(peaks) else np.nan,
        width_variation=float(np.std(across[peaks])) if len(peaks) > 2 else np.nan,
        knee_lift_deg=float(np.percentile([np.degrees(np.arctan2(along(each, ahead), -each[:, 2])) for each in thigh], 97.5)),
        foot_lift=float(min(lift)) / tall,
        trunk_lean_deg=float(np.degrees(np.median(np.arctan2(along(body.trunk, ahead), body.trunk[:, 2])))),
        trunk_sway_deg=float(np.percentile(sway, 95) - np.percentile(sway, 5)),
        arm_swing=float(np.mean([np.percentile(each, 95) - np.percentile(each, 5) for each in wrists])),
        halted_s=float(slow[peaks[0] : peaks[-1]].sum()) / RATE_HZ if len(peaks) > 1 else 0.0,
    )  # fmt: skip


def travels(body: Tracks, least_mps: float, *, gap_s: float = 0.5, least_s: float = 0.8) -> list[Tracks]:
    """Pieces in which an upright body goes at a speed or faster, averaged over a second, the one that gets farthest first."""
    speed = np.linalg.norm(rate_of(body["hips"])[:, :2], axis=-1)
    width = min(round(RATE_HZ), len(speed))
    # At the ends the mean is over what there is.
    mean = np.convolve(speed, np.ones(width), mode="same") / np.convolve(
        np.ones(len(speed)), np.ones(width), mode="same"
    )
    upright = body["hips"][:, 2] > UPRIGHT * body.leg_m
    found = spans((mean > least_mps) & upright, gap=round(gap_s * RATE_HZ), least=round(least_s * RATE_HZ))
    found.sort(key=lambda each: -float(speed[each[0] : each[1]].sum()))
    return [replace(body, joints=body.joints[start:stop]) for start, stop in found]


def _heading(body: Tracks) -> np.ndarray:
    """Direction that the body faces, averaged over `HEADING_S`, (T, 3)."""
    width = min(round(HEADING_S * RATE_HZ), len(body.facing))
    kernel = np.ones(width)
    return unit(np.stack([np.convolve(body.facing[:, axis], kernel, mode="same") for axis in range(3)], axis=-1))


def alternations(signal: np.ndarray, least: float) -> np.ndarray:
    """Frames of alternating maxima and minima that differ by `least` or more; the ends of the record are none."""
    found: list[int] = []
    high = low = 0
    rising: bool | None = None
    for frame, value in enumerate(signal.tolist()):
        high = frame if value > signal[high] else high
        low = frame if value < signal[low] else low
        if rising is not False and value < signal[high] - least:
            found.append(high)
            rising, low = False, frame
        elif rising is not True and value > signal[low] + least:
            found.append(low)
            rising, high = True, frame
    return np.array([frame for frame in found if 0 < frame < len(signal) - 1], dtype=int)


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
