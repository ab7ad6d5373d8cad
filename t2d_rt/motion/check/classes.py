"""Whether a motion is of the class that was asked for, by what it does: heights of head and hips, contacts, steps, flight.

The rules know nothing of how a motion was made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from t2d_rt.motion.check.falls import FallFinding
from t2d_rt.motion.check.gait import UPRIGHT, Gait, gait_of, travels
from t2d_rt.motion.check.limits import Limits
from t2d_rt.motion.check.support import airborne, contacts, flights_s
from t2d_rt.motion.check.tracks import RATE_HZ, Tracks, angle_deg, rate_of, spans
from t2d_rt.motion.descriptions.slots import Activity

UP = np.array([0.0, 0.0, 1.0])

SIGN_MARGIN = 0.35
"""A figure of a gait is a sign of an abnormal one where it lies outside the range of normal walks by that fraction of the range:
one of 70 recorded normal walks has a sign."""

MOST_SIGNS = 3
"""A normal walk has fewer: a slow one has short steps and a low cadence. As many figures outside the range itself are signs, too: 4
of the 70 have them."""

TURN_DEG = 45.0
"""Change of heading from which a walk is no straight one: its inner steps are shorter, and the trunk leans."""

STAIRS_M = 0.12
"""Range of the levels of planted feet from which a walk goes over stairs."""

SEATED, STANDING, LYING = 0.80, 0.85, 0.40
"""Heights of the hips over the length of the leg: at most of one who sits (a chair's seat of 0.45 m has them at 0.6 to 0.7),
at least of one who stands (1.05 when straight), and at most of one who lies or sits on the floor."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the rules look at."""

    body: Tracks
    gait: Gait
    limits: Limits

    def pieces(self, least_mps: float, *, gap_s: float) -> list[Evidence]:
        """Those in which the body goes at that speed, the one that gets farthest first."""
        return [Evidence(each, gait_of(each), self.limits) for each in travels(self.body, least_mps, gap_s=gap_s)]

    @property
    def turn_deg(self) -> float:
        """By how much the direction changes that the body faces; its swing with each step does not count."""
        angle = np.unwrap(np.arctan2(self.body.facing[:, 1], self.body.facing[:, 0]))
        width = min(round(RATE_HZ), len(angle))
        return float(np.degrees(np.ptp(np.convolve(angle, np.full(width, 1 / width), mode="valid"))))

    @property
    def hips(self) -> np.ndarray:
        """Height of the hips over the length of the leg, (T,)."""
        return self.body["hips"][:, 2] / self.body.leg_m


def class_faults(expected: Activity, body: Tracks, fall: FallFinding, limits: Limits) -> list[str]:
    """Why a motion is not of a class, a sentence each; empty where it is."""
    if expected == "falling":
        return [] if fall.happened else [f"no fall is in it: {fall.reason}"]
    faults = [f"it should hold no fall, but {fall.reason}"] if fall.happened else []
    return faults + RULES[expected](Evidence(body, gait_of(body), limits))


def _walking(seen: Evidence) -> list[str]:
    """Of walking, climbing stairs and turning; what comes before and after it is another matter."""
    faults = []
    for piece in seen.pieces(0.2, gap_s=0.5):
        faults = _steps(piece, (20, 160) if _on_stairs(piece) else (60, 160), (0.15, 2.5)) + _no_flight(piece)
        signs = gait_signs(piece.gait, seen.limits)
        if len(signs) >= MOST_SIGNS and piece.turn_deg < TURN_DEG and not _on_stairs(piece):
            faults.append(f"the gait is not a normal one: {', '.join(signs)}")
        if not faults:
            return []
    if seen.turn_deg > TURN_DEG and seen.hips.min() > UPRIGHT:
        return _no_flight(seen)
    return faults or ["nobody walks: the hips go nowhere at 0.2 m/s or more, and the body does not turn"]


def _abnormal_walking(seen: Evidence) -> list[str]:
    pieces = seen.pieces(0.05, gap_s=6.0)  # a gait that freezes goes on
    if not pieces:
        return ["nobody walks: the hips go nowhere at 0.05 m/s or more"]
    piece = pieces[0]
    faults = _steps(piece, (20, 260), (0.03, 2.5)) + _no_flight(piece)
    if not gait_signs(piece.gait, seen.limits) and len(gait_signs(piece.gait, seen.limits, margin=0.0)) < MOST_SIGNS:
        faults.append(
            "the gait is a normal one: step length, timing, width, lift, posture and arm swing are those of recorded walks"
        )
    return faults


def _on_stairs(seen: Evidence) -> bool:
    levels = [float(each.place[2]) for each in contacts(seen.body)]
    return bool(levels and np.ptp(levels) > STAIRS_M)


def gait_signs(gait: Gait, limits: Limits, *, margin: float = SIGN_MARGIN) -> list[str]:
    """What of a gait lies outside the range of recorded normal walks, as phrases with figure and range; `margin` over the range."""
    found = []
    for name, (low, high) in limits.gait.items():
        value, more = float(getattr(gait, name)), margin * (high - low)
        if not math.isnan(value) and not low - more <= value <= high + more:
            found.append(f"{name.replace('_', ' ')} {value:.3g} (normal {low:.3g} to {high:.3g})")
    return found


def _steps(seen: Evidence, cadence: tuple[float, float], speed: tuple[float, float]) -> list[str]:
    faults = []
    if seen.gait.steps < 2:
        faults.append(f"{seen.gait.steps} step(s) are too few for a walk or run")
    elif not cadence[0] <= seen.gait.cadence_per_min <= cadence[1]:
        faults.append(
            f"{seen.gait.cadence_per_min:.0f} steps a minute are outside {cadence[0]:.0f} to {cadence[1]:.0f}"
        )
    if not speed[0] <= seen.gait.speed_mps <= speed[1]:
        faults.append(f"a speed of {seen.gait.speed_mps:.2f} m/s is outside {speed[0]:g} to {speed[1]:g} m/s")
    return faults


def _no_flight(seen: Evidence) -> list[str]:
    fraction = float(airborne(seen.body).mean())
    return (
        [f"both feet are off the floor for {fraction:.0%} of the time, of a walk at most 10 %"]
        if fraction > 0.1
        else []
    )


def _running(seen: Evidence) -> list[str]:
    faults = []
    for piece in seen.pieces(0.9, gap_s=0.2):
        faults = _steps(piece, (120, 260), (0.9, 9.0))
        planted = np.zeros(len(piece.body.joints), bool)
        for each in contacts(piece.body):
            planted[each.start : each.stop] = True
        if airborne(piece.body).mean() < 0.03 and planted.mean() > 0.8:
            faults.append(f"a foot is on the floor for {planted.mean():.0%} of the time: no flight between steps")
        if not faults:
            return []
    return faults or ["nobody runs: the hips go nowhere at 0.9 m/s or more"]


def _jumping(seen: Evidence) -> list[str]:
    flights = flights_s(seen.body)
    longest = max((duration for _, duration, _ in flights), default=0.0)
    rise = max((rise for *_, rise in flights), default=0.0) / seen.body.stature_m
    if longest < 0.10 or rise < 0.008:
        return [f"the longest flight lasts {longest:.2f} s and rises by {rise * seen.body.stature_m:.3f} m: no jump"]
    return []


def _sitting(seen: Evidence) -> list[str]:
    """Sitting down, sitting, lying down and standing up alike: there is a stay with the hips at a seat's height or on the
    floor."""
    slow = np.abs(rate_of(seen.hips)) * seen.body.leg_m < 0.25
    thigh = (seen.body["hips"] - seen.body["knees"])[:, 2] / (0.5 * seen.body.leg_m)
    seat = (seen.hips < SEATED) & slow & ((thigh < 0.75) | (seen.hips < LYING))
    stays = spans(seat, gap=round(0.1 * RATE_HZ), least=round(0.4 * RATE_HZ))
    if not stays:
        return [f"the hips never rest at a seat's height: lowest at {seen.hips.min():.2f} of the leg's length"]
    if seen.hips.max() < STANDING and not (seen.hips < SEATED).all():
        return [
            f"nobody sits down or stands up: hips between {seen.hips.min():.2f} and {seen.hips.max():.2f} of the "
            "leg's length"
        ]
    return []


def _bending(seen: Evidence) -> list[str]:
    """Bending, squatting and stretching alike, on the spot."""
    body = seen.body
    tilt = angle_deg(body.trunk, UP) > 30
    squat = seen.hips < 0.80 * np.percentile(seen.hips, 95)
    wrists = np.max([body["left_wrist"][:, 2], body["right_wrist"][:, 2]], axis=0)
    stretch = wrists > body["head"][:, 2] + 0.05 * body.stature_m
    found = spans(tilt | squat | stretch, gap=round(0.1 * RATE_HZ), least=round(0.2 * RATE_HZ))
    if not found:
        greatest = float(angle_deg(body.trunk, UP).max())
        return [f"the trunk bends by {greatest:.0f} degrees at most, and nobody squats or stretches"]
    feet = body["ankles"][:, :2]
    gone = min(float(np.linalg.norm(feet[stop - 1] - feet[start])) for start, stop in found)
    return [f"the feet go on by {gone:.2f} m during it"] if gone > 0.5 * body.leg_m else []


def _dancing(seen: Evidence) -> list[str]:
    """Arms and legs at work without going anywhere straight."""
    body, faults = seen.body, []
    sides = "left", "right"
    arms = np.mean(
        [np.linalg.norm(rate_of(body[f"{side}_wrist"] - body["shoulders"]), axis=-1).mean() for side in sides]
    )
    heights = np.mean([np.std(body[f"{side}_wrist"][:, 2] - body["hips"][:, 2]) for side in sides]) / body.stature_m
    legs = np.mean([np.linalg.norm(rate_of(body[f"{side}_ankle"]), axis=-1).mean() for side in sides])
    angle = np.unwrap(np.arctan2(body.facing[:, 1], body.facing[:, 0]))
    if arms < 0.3 and heights < 0.03 and np.ptp(angle) < math.pi:
        faults.append(f"the arms move at {arms:.2f} m/s only and the body does not turn")
    if legs < 0.12:
        faults.append(f"the feet move at {legs:.2f} m/s only")
    if heights < 0.03 and seen.gait.net_mps > 0.8 * seen.gait.speed_mps > 0.3:
        faults.append(f"it goes straight on at {seen.gait.net_mps:.2f} m/s with hanging arms: a walk")
    if seen.gait.net_mps > 2.0:
        faults.append(f"it travels at {seen.gait.net_mps:.2f} m/s")
    return faults


RULES: Mapping[Activity, Callable[[Evidence], list[str]]] = MappingProxyType(
    {
        "walking": _walking, "abnormal_walking": _abnormal_walking, "running": _running, "sitting": _sitting, "bending": _bending,
        "jumping": _jumping, "dancing": _dancing,
    }
)  # fmt: skip
"""Rules of the classes other than falling."""
