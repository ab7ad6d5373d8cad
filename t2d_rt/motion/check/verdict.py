"""Judge a motion by limits of recorded motion and by what its class must show, and say what is wrong."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import choice
from t2d_rt.motion.check.falls import FallFinding, fall_in
from t2d_rt.motion.check.gait import UPRIGHT, Gait, gait_of, rate_doubt, travels
from t2d_rt.motion.check.measures import (
    RANGES_DEG,
    RATE_HZ,
    Measures,
    Tracks,
    airborne,
    angle_deg,
    contacts,
    flights_s,
    jump_m,
    measures_of,
    rate_of,
    spans,
    tracks,
)
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity
from t2d_rt.motion.jumps import jumps, told, told_before
from t2d_rt.types.motion import Motion, checked_motion

# --- limits of the measures, which `python -m validation.motions.limits FOLDER --write` writes to `limits.json` ---
#
# Recordings with glitches are left out (`left_out` names them, by a rule of that module); a limit is 1.25 times the
# 99th percentile of all others.


FILE = Path(__file__).with_name("limits.json")

GAIT_SIGNS = tuple(field.name for field in fields(Gait) if field.name not in ("steps", "speed_mps", "net_mps"))
"""Figures of a gait that show an abnormal one if they lie outside the range of recorded normal walks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits that recorded motion keeps to, as `validation.motions.limits` writes them."""

    recordings: int
    """Number of recordings that the limits come from."""
    left_out: dict[str, str]
    """Recordings with glitches, and which."""
    at_most: dict[str, float]
    """1.25 times the 99th percentile of each measure over all recordings."""
    jumps: Sequence[tuple[float, float]]
    """Frame rate [Hz] and the limit of a step's deviation at it [m], found in the same way; rates ascend."""
    gait: dict[str, tuple[float, float]]
    """2.5th and 97.5th percentile of each figure over normal walks."""
    walks: int
    by_class: dict[str, dict[str, float]]
    """95th percentile of each measure over the recordings of a class, and their number `n`."""

    def jump_m(self, rate_hz: float) -> float:
        """Greatest deviation of a step at a frame rate [m], between the rates of the table by a power law."""
        rates, jumps = (np.log(values) for values in zip(*self.jumps, strict=True))
        return math.exp(float(np.interp(math.log(rate_hz), rates, jumps)))


@functools.cache
def shipped_limits() -> Limits:
    """The limits that the package ships."""
    return Limits(**json.loads(FILE.read_text(encoding="utf-8")))


# --- whether a motion is of the class that was asked for: heights of head and hips, contacts, steps, flight ---
#
# The rules know nothing of how a motion was made.


UP = np.array([0.0, 0.0, 1.0])

FARTHEST, MOST_AWAY = 4, 1.85
"""A gait's distance is the root mean square of this many departures, those of the figures farthest from the middle of normal walks,
in halves of their range; the second is its greatest value for a normal walk. Recorded ones reach 1.64. Both were chosen on walks of
the seeds from 1000 on: none of 96 normal ones is beyond it, 1 of 96 hardly abnormal ones, and 86 of 96 with gaits of patients."""

PACE = ("cadence_per_min", "step_length")
ONE_S_OWN, MOST_ALONE = (*PACE, "halted_s", "trunk_lean_deg"), 2.5
"""Figures of pace and carriage, and the greatest departure that counts for them: strollers take short steps at a low cadence,
anyone may pause, and a stooped person also stands so. One of them alone, however far off, makes no gait abnormal, but two may."""

LEAST_RANGE = 0.1
"""Least range that is assumed for halts [s], which are 0 in normal walks."""

TURN_DEG = 45.0
"""Change of heading from which a walk is not straight: its inner steps are shorter, and the trunk leans."""

STAIRS_M = 0.12
"""Range of the levels of planted feet from which a walk goes over stairs."""

SEATED, STANDING, LYING = 0.80, 0.85, 0.40
"""Heights of the hips over the length of the leg: the greatest in sitting (0.6 to 0.7 on a chair of 0.45 m), the least in standing
(1.05 when straight), and the greatest in lying or sitting on the floor."""


OFF_THE_FEET = 0.08
"""Least distance of the centre of mass behind the ankles, over the length of the leg, of a body that the feet do not carry."""

LEAST_WALK = 0.8
"""Least extent of a walk over the length of the leg, where it has fewer than four steps: people step about before they sit down."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the rules examine: the motion's tracks, its gait, and the limits of recorded motion."""

    body: Tracks
    gait: Gait
    limits: Limits

    def seated_s(self, *ankles: str) -> float:
        """Longest stay of a low body whose centre of mass is so far behind all these ankles that something else carries it [s]."""
        body = self.body
        ahead = np.max([((body.centre_of_mass - body[ankle]) * body.facing).sum(axis=1) for ankle in ankles], axis=0)
        carried = (self.hips < SEATED) & (ahead < -OFF_THE_FEET * body.leg_m)
        return max((stop - start for start, stop in spans(carried, gap=6, least=1)), default=0) / RATE_HZ

    def pieces(self, least_mps: float, *, gap_s: float) -> list[Evidence]:
        """Pieces in which the body goes at that speed or faster, the one that gets farthest first."""
        return [Evidence(travel, gait_of(travel), self.limits) for travel in travels(self.body, least_mps, gap_s=gap_s)]

    @property
    def turn_deg(self) -> float:
        """Range of the direction that the body faces [degrees], without its swing with each step."""
        angle = np.unwrap(np.arctan2(self.body.facing[:, 1], self.body.facing[:, 0]))
        width = min(round(RATE_HZ), len(angle))
        return float(np.degrees(np.ptp(np.convolve(angle, np.full(width, 1 / width), mode="valid"))))

    @property
    def hips(self) -> np.ndarray:
        """Heights (T,) of the hips over the length of the leg."""
        return self.body["hips"][:, 2] / self.body.leg_m


def class_faults(expected: Activity, body: Tracks, fall: FallFinding, limits: Limits) -> list[str]:
    """Sentences that say why a motion is not of a class; empty if it is."""
    if expected == "falling":
        return [] if fall.happened else [f"no fall is in it: {fall.reason}"]
    faults = [f"it should hold no fall, but {fall.reason}"] if fall.happened else []
    faults += _arms_are_busy(body) if expected not in ("dancing", "sitting") else []
    return faults + RULES[expected](Evidence(body, gait_of(body), limits))


def _walking(evidence: Evidence) -> list[str]:
    """Faults of walking, climbing stairs or turning; what comes before and after it does not count."""
    faults = []
    for piece in evidence.pieces(0.2, gap_s=0.5):
        cadence = (20, 160) if _on_stairs(piece) else (60, 160)
        faults = _steps(piece, cadence, (0.15, 2.5)) + _no_flight(piece) + _too_short(piece) + _arms_rise(piece)
        if not faults and piece.turn_deg < TURN_DEG and not _on_stairs(piece):
            return gait_faults(piece)  # the farthest piece tells; shorter ones have too few steps
        if not faults:
            return []
    if evidence.turn_deg > TURN_DEG and evidence.hips.min() > UPRIGHT:
        return _no_flight(evidence)
    return faults or ["nobody walks: the hips go nowhere at 0.2 m/s or more, and the body does not turn"]


def _abnormal_walking(evidence: Evidence) -> list[str]:
    pieces = evidence.pieces(0.05, gap_s=6.0)  # a gait that freezes goes on
    if not pieces:
        return ["nobody walks: the hips go nowhere at 0.05 m/s or more"]
    piece = pieces[0]
    faults = _steps(piece, (20, 260), (0.03, 2.5)) + _no_flight(piece) + _too_short(piece) + _arms_rise(piece)
    if not gait_faults(piece) and not _steps(piece, (60, 160), (0.15, 2.5)):
        faults.append(
            "the gait is a normal one: step length, timing, width, lift, posture and arm swing are those of recorded walks"
        )
    return faults


def gait_faults(walk: Evidence) -> list[str]:
    """A sentence that says why the gait of a straight walk is not normal; empty if it is."""
    away = departures(walk.gait, walk.limits)
    farthest = sorted(away, key=away.__getitem__, reverse=True)[:FARTHEST]
    distance = math.sqrt(sum(away[name] ** 2 for name in farthest) / FARTHEST)
    if distance <= MOST_AWAY:
        return []
    signs = [
        "{} {:.3g} (normal {:.3g} to {:.3g})".format(
            name.replace("_", " "), getattr(walk.gait, name), *walk.limits.gait[name]
        )
        for name in farthest
        if away[name] > 1
    ]
    return [f"the gait is not a normal one: {', '.join(signs)}"]


def _on_stairs(evidence: Evidence) -> bool:
    levels = [float(contact.place[2]) for contact in contacts(evidence.body)]
    return bool(levels and np.ptp(levels) > STAIRS_M)


def departures(gait: Gait, limits: Limits) -> dict[str, float]:
    """How far each figure of a gait is from the middle of recorded normal walks, over half their range; 0 for figures that are NaN.

    Asymmetries and variations count only where they are greater, as nobody walks too evenly. Of cadence and step length, which
    both show a slow pace, only the one that is farther off counts.
    """
    departure = {}
    for name, (low, high) in limits.gait.items():
        value, half = float(getattr(gait, name)), 0.5 * max(high - low, LEAST_RANGE if name == "halted_s" else 0.0)
        away = 0.0 if math.isnan(value) else (value - 0.5 * (low + high)) / half
        away = max(away, 0.0) if name.endswith(("asymmetry", "variation")) else abs(away)
        departure[name] = min(away, MOST_ALONE) if name in ONE_S_OWN else away
    departure[min(PACE, key=departure.__getitem__)] = 0.0
    return departure


def _steps(evidence: Evidence, cadence: tuple[float, float], speed: tuple[float, float]) -> list[str]:
    faults = []
    if evidence.gait.steps < 2:
        faults.append(f"{evidence.gait.steps} step(s) are too few for a walk or run")
    elif not cadence[0] <= evidence.gait.cadence_per_min <= cadence[1]:
        faults.append(
            f"{evidence.gait.cadence_per_min:.0f} steps a minute are outside {cadence[0]:.0f} to {cadence[1]:.0f}"
        )
    if not speed[0] <= evidence.gait.speed_mps <= speed[1]:
        faults.append(f"a speed of {evidence.gait.speed_mps:.2f} m/s is outside {speed[0]:g} to {speed[1]:g} m/s")
    return faults


def _too_short(evidence: Evidence) -> list[str]:
    extent_m = float(np.linalg.norm(np.ptp(evidence.body["hips"][:, :2], axis=0)))
    if evidence.gait.steps >= 4 or extent_m >= LEAST_WALK * evidence.body.leg_m:
        return []
    return [f"{evidence.gait.steps} steps over {extent_m:.2f} m are no walk"]


def _arms_rise(evidence: Evidence) -> list[str]:
    rise = wrists_rise(evidence.body)
    return [f"the wrists rise and fall by {rise:.2f} of the stature, as in a dance"] if rise > DANCES else []


DANCES = 0.065
"""Standard deviation of the wrists' heights, over stature, that dances exceed and walks do not."""


def wrists_rise(body: Tracks) -> float:
    """Standard deviation of the heights of the wrists over the hips, mean of both, over the stature."""
    heights = [np.std(body[f"{side}_wrist"][:, 2] - body["hips"][:, 2]) for side in ("left", "right")]
    return float(np.mean(heights)) / body.stature_m


RAISED, RAISED_FRACTION, BUSY_MPS = 0.10, 0.46, 0.5
"""Greatest depth of a raised elbow below the shoulders, over stature (a hanging one is 0.17 below); part of the time for which the
elbows of a dance are raised; and mean speed of its wrists against the shoulders. They are set so that none of 94 recordings and 112
motions of sentences that are no dances has both."""


DANCING_FEET_MPS = 0.12
"""Least mean speed of the ankles in a dance, because a person who stretches on the spot raises the arms too."""


def feet_mps(body: Tracks) -> float:
    """Mean speed of both ankles [m/s]."""
    return float(
        np.mean([np.linalg.norm(rate_of(body[f"{side}_ankle"]), axis=-1).mean() for side in ("left", "right")])
    )


def _arms_are_busy(body: Tracks) -> list[str]:
    """A fault if the arms are raised and busy throughout, which makes a motion a dance whatever its legs do in a piece of it."""
    up, busy = [], []
    for side in ("left", "right"):
        up.append((body[f"{side}_elbow"] - body["shoulders"])[:, 2] > -RAISED * body.stature_m)
        busy.append(np.linalg.norm(rate_of(body[f"{side}_wrist"] - body["shoulders"]), axis=-1))
    fraction, speed = float(np.mean(up)), float(np.mean(busy))
    if fraction < RAISED_FRACTION or speed < BUSY_MPS or feet_mps(body) < DANCING_FEET_MPS:
        return []
    return [
        f"the elbows are raised for {fraction:.0%} of the time and the wrists move at {speed:.1f} m/s, as in a dance"
    ]


def _no_flight(evidence: Evidence) -> list[str]:
    fraction = float(airborne(evidence.body).mean())
    return (
        [f"both feet are off the floor for {fraction:.0%} of the time, of a walk at most 10 %"]
        if fraction > 0.1
        else []
    )


def _running(evidence: Evidence) -> list[str]:
    faults = []
    for piece in evidence.pieces(0.9, gap_s=0.2):
        faults = _steps(piece, (120, 260), (0.9, 9.0))
        planted = np.zeros(len(piece.body.joints), bool)
        for contact in contacts(piece.body):
            planted[contact.start : contact.stop] = True
        if airborne(piece.body).mean() < 0.03 and planted.mean() > 0.8:
            faults.append(f"a foot is on the floor for {planted.mean():.0%} of the time: no flight between steps")
        if not faults:
            return []
    return faults or ["nobody runs: the hips go nowhere at 0.9 m/s or more"]


RUNS_MPS = 1.4
"""Speed from one place to another from which flights are those of a run."""


def _jumping(evidence: Evidence) -> list[str]:
    if evidence.gait.net_mps > RUNS_MPS and not _running(evidence):
        return [f"it runs at {evidence.gait.net_mps:.1f} m/s"]
    flights = flights_s(evidence.body)
    longest = max((duration for _, duration, _ in flights), default=0.0)
    rise = max((rise for *_, rise in flights), default=0.0) / evidence.body.stature_m
    if longest < 0.10 or rise < 0.008:
        return [
            f"the longest flight lasts {longest:.2f} s and rises by {rise * evidence.body.stature_m:.3f} m: no jump"
        ]
    return []


TOGETHER, STEPPING = 0.9, 0.8
"""Correlation of the heights of both ankles: above the first they go up and down together, as in jumps from both feet (recorded and
made ones 0.97 to 1.00; dances -0.5 to 0.7), below the second they step."""


def feet_together(body: Tracks) -> float:
    """Correlation of the heights of both ankles; 0 where one of them never moves."""
    heights = np.stack([body[f"{side}_ankle"][:, 2] for side in ("left", "right")])
    return float(np.corrcoef(heights)[0, 1]) if (np.ptp(heights, axis=1) > 1e-6).all() else 0.0


def _only_jumping(evidence: Evidence) -> list[str]:
    """Faults of a jump that is no dance with a jump in it: turning by 360 degrees or more on stepping feet is dancing."""
    if (faults := _jumping(evidence)) or evidence.turn_deg < 360 or feet_together(evidence.body) > STEPPING:
        return faults
    return [f"it turns by {evidence.turn_deg:.0f} degrees on stepping feet, as in a dance"]


def _sitting(evidence: Evidence) -> list[str]:
    """Faults of sitting down, sitting, lying down or standing up: in all of them the hips stay for a while at a seat's height or
    on the floor."""
    slow = np.abs(rate_of(evidence.hips)) * evidence.body.leg_m < 0.25
    thigh = (evidence.body["hips"] - evidence.body["knees"])[:, 2] / (0.5 * evidence.body.leg_m)
    seat = (evidence.hips < SEATED) & slow & ((thigh < 0.75) | (evidence.hips < LYING))
    stays = spans(seat, gap=round(0.1 * RATE_HZ), least=round(0.4 * RATE_HZ))
    if not stays:
        return [f"the hips never rest at a seat's height: lowest at {evidence.hips.min():.2f} of the leg's length"]
    if evidence.seated_s("ankles") < LEAST_SEATED_S and evidence.hips.min() > LYING:
        return [f"the feet carry the body all the time: nothing else does for {LEAST_SEATED_S:g} s"]
    if evidence.hips.max() < STANDING and not (evidence.hips < SEATED).all():
        return [
            f"nobody sits down or stands up: hips between {evidence.hips.min():.2f} and {evidence.hips.max():.2f} of the "
            "leg's length"
        ]
    return []


LEAST_SEATED_S, LONGEST_FALL_BACK_S = 0.3, 0.6
"""Least time for which something else than the feet carries a person who sits, and the longest in bending or squatting."""


def _bending(evidence: Evidence) -> list[str]:
    """Faults of bending, squatting, stretching or standing on one leg, on the spot."""
    body = evidence.body
    tilt = angle_deg(body.trunk, UP) > 30
    squat = evidence.hips < 0.80 * np.percentile(evidence.hips, 95)
    wrists = np.max([body["left_wrist"][:, 2], body["right_wrist"][:, 2]], axis=0)
    stretch = wrists > body["head"][:, 2] + 0.05 * body.stature_m
    bends = spans(tilt | squat | stretch, gap=round(0.1 * RATE_HZ), least=round(0.2 * RATE_HZ)) or _on_one_leg(body)
    if not bends:
        greatest = float(angle_deg(body.trunk, UP).max())
        return [f"the trunk bends by {greatest:.0f} degrees at most, and nobody squats, stretches or stands on one leg"]
    feet = body["ankles"][:, :2]
    seated_s = evidence.seated_s("left_ankle", "right_ankle")
    if seated_s > LONGEST_FALL_BACK_S:
        return [f"a seat or the floor carries the body for {seated_s:.1f} s"]
    if not _jumping(evidence):
        return ["it is a jump"]
    moved_m = min(float(np.linalg.norm(feet[stop - 1] - feet[start])) for start, stop in bends)
    return [f"the feet go on by {moved_m:.2f} m during it"] if moved_m > 0.5 * body.leg_m else []


HELD_UP, LEAST_HELD_S = 0.07, 1.0
"""Height of one ankle over the other, over stature, from which a foot is held up, and the least time of standing on one leg [s]: a
step's swing takes 0.4 s."""


def _on_one_leg(body: Tracks) -> list[tuple[int, int]]:
    """First frame, and the one after the last, of each stay on one leg."""
    apart = np.abs(body["left_ankle"][:, 2] - body["right_ankle"][:, 2])
    return spans(apart > HELD_UP * body.stature_m, gap=round(0.1 * RATE_HZ), least=round(LEAST_HELD_S * RATE_HZ))


def _dancing(evidence: Evidence) -> list[str]:
    """Faults of a dance, in which arms and legs move without going straight anywhere."""
    body, faults = evidence.body, []
    sides = "left", "right"
    arms = np.mean(
        [np.linalg.norm(rate_of(body[f"{side}_wrist"] - body["shoulders"]), axis=-1).mean() for side in sides]
    )
    heights = wrists_rise(body)
    angle = np.unwrap(np.arctan2(body.facing[:, 1], body.facing[:, 0]))
    neither_jump_nor_walk = bool(_jumping(evidence) and _walking(evidence))
    if heights < (0.03 if arms > 0.3 and neither_jump_nor_walk else DANCES) and np.ptp(angle) < math.pi:
        faults.append(f"the wrists rise and fall by {heights:.3f} of the stature only and the body does not turn")
    if not _jumping(evidence) and feet_together(body) > TOGETHER:
        faults.append("both feet go up and down together: jumps")
    if feet_mps(body) < DANCING_FEET_MPS:
        faults.append(f"the feet move at {feet_mps(body):.2f} m/s only")
    if heights < 0.03 and evidence.gait.net_mps > 0.8 * evidence.gait.speed_mps > 0.3:
        faults.append(f"it goes straight on at {evidence.gait.net_mps:.2f} m/s with hanging arms: a walk")
    if evidence.gait.speed_mps > RUNS_MPS:
        faults.append(f"it travels at {evidence.gait.speed_mps:.2f} m/s")
    return faults


RULES: Mapping[Activity, Callable[[Evidence], list[str]]] = {
    "walking": _walking,
    "abnormal_walking": _abnormal_walking,
    "running": _running,
    "sitting": _sitting,
    "bending": _bending,
    "jumping": _only_jumping,
    "dancing": _dancing,
}
"""Rules of the classes other than falling."""


# --- whether a motion is fit to simulate, and why not ---


LEAST_DURATION_S = 0.7
"""Shorter motions hold no step, and less than one window of a spectrogram with its neighbours."""

LEAST_ACTIVITY_MPS = 0.02
"""Speed of the joints, mean over joints and time: twice the sway of quiet standing (about 0.01 m/s at the centre of mass;
Winter 1995)."""

MOST_UPSIDE_DOWN = 0.6
"""Greatest part of the time for which a body is upside down; in a cartwheel or a handstand it is less."""

IMPACT_S, IMPACT_JUMP = 0.3, 2.0
"""Time [s] around the impact of a fall in which head, hands, hips and feet strike the floor, and how much more than in recordings a
joint may jump from frame to frame there: a hand at 7 m/s that stops within two frames of 120 Hz jumps by 0.03 m."""

SENTENCES: dict[str, str] = {
    "top_speed_mps": "a joint reaches {value:.1f} m/s, recorded ones at most {limit:.1f} m/s",
    "acceleration_mps2": "a joint accelerates by {value:.0f} m/s^2, recorded ones by at most {limit:.0f} m/s^2",
    "jerk_mps3": "the joints' jerk is {value:.0f} m/s^3, of recorded motion at most {limit:.0f} m/s^3",
    "bone_change": "a bone's length changes by {value:.1%}, of recorded bodies by at most {limit:.1%}",
    "foot_skate_m": "a planted foot slides by {value:.3f} m, recorded ones by at most {limit:.3f} m",
    "sliding_s": "no foot rests for {value:.2f} s beyond a flight's time, in recordings for at most {limit:.2f} s: "
    "the feet slide",
    "floating_s": "the body is off the floor for {value:.2f} s longer than it could fly, in recordings for at most "
    "{limit:.2f} s",
    "floor_penetration_m": "the body is {value:.3f} m deep in the floor, recorded ones at most {limit:.3f} m",
    "floor_offset_m": "the planted feet stay {value:.3f} m above the floor, recorded ones at most {limit:.3f} m",
    "self_penetration_m": "limbs go {value:.3f} m into one another, recorded ones at most {limit:.3f} m",
}
"""Measures that recorded motion bounds from above, and the sentence about a motion that exceeds the bound."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What the filter says of one motion."""

    reasons: tuple[str, ...]
    """Sentences, with figure and limit, that say why it does not pass."""
    measures: Measures
    fall: FallFinding
    expected: Activity | None = None

    @property
    def passed(self) -> bool:
        """Whether nothing speaks against the motion."""
        return not self.reasons

    def __str__(self) -> str:
        return "passed" if self.passed else "; ".join(self.reasons)


def check_motion(motion: Motion, *, expected: Activity | None = None) -> Verdict:
    """Judges a motion (z up, floor at z = 0) by limits of recorded motion, and by a class if one is given.

    expected: "walking", "abnormal_walking", "running", "falling", "sitting", "bending", "jumping" or "dancing"; another raises an
        InputError.
    """
    checked_motion(motion)
    if expected is not None:
        choice("expected", expected, ACTIVITIES)
    body = tracks(motion)
    return judged(motion, measures_of(motion, body), body=body, expected=expected)


def passes(motion: Motion, expected: Activity) -> bool:
    """Whether `check_motion` finds nothing against a motion as one of a class; the quickest tests come first."""
    checked_motion(motion)
    body = tracks(motion)
    if class_faults(expected, body, fall_in(body), shipped_limits()):
        return False
    return not judged(motion, measures_of(motion, body), body=body).reasons


def judged(
    motion: Motion,
    measures: Measures,
    *,
    body: Tracks | None = None,
    expected: Activity | None = None,
    limits: Limits | None = None,
) -> Verdict:
    """The verdict on measures, by the given limits or by those that the package ships."""
    limits = shipped_limits() if limits is None else limits
    body = tracks(motion) if body is None else body
    fall = fall_in(body)
    reasons = _of_record(motion, measures, limits, fall) + _of_limits(measures, limits) + _of_anatomy(measures)
    if expected is not None:
        reasons += class_faults(expected, body, fall, limits)
    return Verdict(reasons=tuple(reasons), measures=measures, fall=fall, expected=expected)


def _of_record(motion: Motion, measures: Measures, limits: Limits, fall: FallFinding) -> list[str]:
    reasons = []
    if measures.duration_s < LEAST_DURATION_S:
        reasons.append(f"it lasts {measures.duration_s:.2f} s, at least {LEAST_DURATION_S:g} s are needed")
    if measures.activity_mps < LEAST_ACTIVITY_MPS:
        reasons.append(
            f"nothing moves: the joints' mean speed is {measures.activity_mps:.3f} m/s, at least "
            f"{LEAST_ACTIVITY_MPS:g} m/s are needed"
        )
    doubt = rate_doubt(motion)
    if doubt is not None:
        reasons.append(doubt)
    jump, jumps_of_record = limits.jump_m(motion.rate_hz), jumps(motion.joints, motion.names, motion.rate_hz)
    if jumps_of_record or told_before(motion.report):
        reasons.append(told(jumps_of_record) if jumps_of_record else told_before(motion.report))
    elif measures.jump_m > jump and not _at_impact(motion, measures, fall, jump):
        reasons.append(
            f"a joint jumps by {measures.jump_m:.3f} m from one frame to the next, recorded ones at {motion.rate_hz:g} Hz "
            f"by at most {jump:.3f} m"
        )
    return reasons


def _at_impact(motion: Motion, measures: Measures, fall: FallFinding, jump: float) -> bool:
    """Whether a jump comes from the impact of a fall, where twice the limit is allowed because no recording holds an impact."""
    if not fall.happened or fall.impact_s is None or measures.jump_m > IMPACT_JUMP * jump:
        return False
    first, last = (round((fall.impact_s + sign * IMPACT_S) * motion.rate_hz) for sign in (-1, 1))
    return max(jump_m(motion.joints[: max(first, 0)]), jump_m(motion.joints[max(last, 0) :])) <= jump


def _of_limits(measures: Measures, limits: Limits) -> list[str]:
    values = {name: float(getattr(measures, name)) for name in SENTENCES}
    return [
        sentence.format(value=values[name], limit=limits.at_most[name])
        for name, sentence in SENTENCES.items()
        if math.isnan(values[name]) or values[name] > limits.at_most[name]
    ]


def _of_anatomy(measures: Measures) -> list[str]:
    reasons = [
        f"{name.removesuffix('_deg').replace('_', ' ')} reaches {measures.angles_deg[name]:.0f} degrees, at most {limit:.0f} "
        f"are possible: {source}"
        for name, (limit, source) in RANGES_DEG.items()
        if measures.angles_deg[name] > limit
    ]
    if measures.mirrored:
        reasons.append("the feet point to where the back is: left and right are swapped, or the hips face backward")
    if measures.upside_down_fraction > MOST_UPSIDE_DOWN:
        reasons.append(
            f"the body is upside down for {measures.upside_down_fraction:.0%} of the time: the up axis may be wrong"
        )
    return reasons
