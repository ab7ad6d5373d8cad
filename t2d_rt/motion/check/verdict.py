"""Whether a motion is fit to simulate, and why not."""

from __future__ import annotations

import math
from dataclasses import dataclass

from t2d_rt.core.checks import choice
from t2d_rt.motion.check.anatomy import RANGES_DEG
from t2d_rt.motion.check.classes import class_faults
from t2d_rt.motion.check.clock import rate_doubt
from t2d_rt.motion.check.falls import FallFinding, fall_in
from t2d_rt.motion.check.limits import Limits
from t2d_rt.motion.check.limits import limits as shipped_limits
from t2d_rt.motion.check.measures import Measures, jump_m, measures_of
from t2d_rt.motion.check.tracks import Tracks, tracks
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity
from t2d_rt.motion.jumps import jumps, told, told_before
from t2d_rt.types.motion import Motion, checked_motion

LEAST_DURATION_S = 0.7
"""Shorter motions hold no step, and less than one window of a spectrogram with its neighbours."""

LEAST_ACTIVITY_MPS = 0.02
"""Speed of the joints, mean over joints and time: twice the sway of quiet standing (about 0.01 m/s at the centre of mass;
Winter 1995)."""

MOST_UPSIDE_DOWN = 0.6
"""A cartwheel's or a handstand's fraction of the time is less."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What the filter says of one motion."""

    reasons: tuple[str, ...]
    """Why it does not pass, sentences with figure and limit."""
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
    """Judges a motion by limits of recorded motion (z up, floor at z = 0), and as one of a class where that is given.

    expected: "walking", "abnormal_walking", "running", "falling", "sitting", "bending", "jumping" or "dancing".
    """
    checked_motion(motion)
    if expected is not None:
        choice("expected", expected, ACTIVITIES)
    body = tracks(motion)
    return judged(motion, measures_of(motion, body), body=body, expected=expected)


def judged(
    motion: Motion,
    measures: Measures,
    *,
    body: Tracks | None = None,
    expected: Activity | None = None,
    limits: Limits | None = None,
) -> Verdict:
    """The verdict on what was measured, by the limits given or those that the package ships."""
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
    jump, found = limits.jump_m(motion.rate_hz), jumps(motion.joints, motion.names, motion.rate_hz)
    if found or told_before(motion.report):
        reasons.append(told(found) if found else told_before(motion.report))
    elif measures.jump_m > jump and not _at_impact(motion, measures, fall, jump):
        reasons.append(
            f"a joint jumps by {measures.jump_m:.3f} m from one frame to the next, recorded ones at {motion.rate_hz:g} Hz "
            f"by at most {jump:.3f} m"
        )
    return reasons


def _at_impact(motion: Motion, measures: Measures, fall: FallFinding, jump: float) -> bool:
    """Whether the jump is what stops a fall on the floor: no recording holds one, and twice as much is let through there."""
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
