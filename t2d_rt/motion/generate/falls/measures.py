"""Measure a simulated fall, and tell how far its figures are from those of real falls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.motion.generate.falls.humanoid import RATE_HZ
from t2d_rt.motion.generate.falls.simulation import CHEST, HEADINGS, RESTING, SEEN, FallPlan, Heading, Run, is_down

IMPACT_S = 0.1
"""Span before a contact in which the greatest speed is that of the impact: knees and hands may touch a little earlier."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Figures of one run; times count from the event."""

    lies_on: tuple[float, ...]
    """Direction of gravity in the chest's axes (left, up, forward) as the chest strikes the floor; (0, 0, -1) is on the back."""
    gain_j: float
    """Greatest rise, over any earlier value, of the mechanical energy less the work of muscles."""
    deepest_m: tuple[float, float]
    """Deepest interpenetration with the floor and within the body."""
    impact_s: float = math.inf
    """Time of the first contact of the pelvis or a hip with the floor; infinite if there is none."""
    descent_s: float = math.inf
    """Time from when the pelvis leaves its height at the event to the impact."""
    pelvis_mps: float = 0.0
    """Downward speed of the pelvis at the impact."""
    head_mps: float = 0.0
    """Downward speed of the head at its impact, or its greatest if it does not strike the floor."""
    travel: tuple[float, float] = (0.0, 0.0)
    """Travel of the pelvis (left, forward) from the event to the impact [m]."""
    slide_m: float = 0.0
    """Travel of the pelvis after the impact."""
    rest_s: float = math.inf
    """Time at which the body comes to rest; infinite if it does not."""

    @property
    def heading(self) -> Heading:
        """Direction in which the person fell, by the side of the trunk that is undermost."""
        return undermost(self.lies_on)


def undermost(lies_on: Sequence[float]) -> Heading:
    """Side of the chest that is undermost, from the direction of gravity in its axes (left, up, forward)."""
    aside, _, ahead = lies_on
    if abs(ahead) >= abs(aside):
        return "forward" if ahead > 0 else "back"
    return "left" if aside > 0 else "right"


def fits(chest: np.ndarray, plan: FallPlan) -> bool:
    """Whether a chest (3, 3) that strikes the floor in this orientation has fallen where the plan wants it."""
    return undermost(-chest[2]) in _headings(plan)


def _headings(plan: FallPlan) -> tuple[Heading, ...]:
    if plan.direction is not None:
        return (plan.direction,)
    never = {"slip": "forward", "trip": "back", "collapse": None}[plan.type]
    return tuple(heading for heading in HEADINGS if heading != never)


def figures(run: Run, joints: np.ndarray, chest: np.ndarray, facing: np.ndarray, external_s: float) -> Figures:
    """Figures of a run, from its joints (T, 22, 3) [m] and the chest's orientations (T, 3, 3).

    `facing` (2,) is that at the event; forces from outside end at `external_s`.
    """
    pelvis = joints[:, 0]
    down = [frame for frame, touching in enumerate(run.touches) if is_down(touching, pelvis[frame, 2])]
    ledger = run.energy_j - run.work_j
    after = ledger[round(external_s * RATE_HZ) :]
    gain_j = float((after - np.minimum.accumulate(after)).max(initial=0.0))
    aside = np.array([-facing[1], facing[0]])
    struck = next((frame for frame, touching in enumerate(run.touches) if touching & CHEST), len(run.touches) - 1)
    lies_on = tuple(float(component) for component in -chest[struck, 2])
    deepest_m = float(run.deepest_m[:, 0].max()), float(run.deepest_m[:, 1].max())
    if not down:
        return Figures(lies_on=lies_on, gain_j=gain_j, deepest_m=deepest_m)
    impact = down[0]
    high = np.flatnonzero(pelvis[: impact + 1, 2] > pelvis[0, 2] - 0.05)
    travel = (pelvis[impact] - pelvis[0])[:2]
    speed = -np.gradient(joints[..., 2], 1 / RATE_HZ, axis=0)
    window = math.ceil(IMPACT_S * RATE_HZ)
    strikes = [frame for frame, touching in enumerate(run.touches) if "head" in touching]
    head_mps = speed[:, 15].max() if not strikes else speed[max(strikes[0] - window, 0) : strikes[0] + 1, 15].max()
    lively = np.flatnonzero(run.speeds > RESTING)
    rest_s = math.inf if lively[-1] == len(run.speeds) - 1 else float(lively[-1] + 1) / RATE_HZ
    return Figures(
        impact_s=impact / RATE_HZ,
        descent_s=float(impact - (high[-1] if len(high) else 0)) / RATE_HZ,
        pelvis_mps=float(speed[max(impact - window, 0) : impact + 1, 0].max()),
        head_mps=float(head_mps),
        lies_on=lies_on,
        travel=(float(travel @ aside), float(travel @ facing)),
        slide_m=float(np.linalg.norm((pelvis[-1] - pelvis[impact])[:2])),
        rest_s=rest_s,
        gain_j=gain_j,
        deepest_m=deepest_m,
    )


IMPACT_RANGE_S, DESCENT_RANGE_S = (0.4, 2.5), (0.3, 1.2)
PELVIS_RANGE_MPS, HEAD_RANGE_MPS = (1.2, 3.0), (1.5, 4.5)
"""Speeds at the impact, from falls of persons on video: 2.14 +- 0.63 and 2.91 +- 0.86 m/s (Choi, Wakeling, Robinovitch 2015)."""
ASIDE = 0.3
"""Penalty of a slip to the side, beside excesses in m/s or s."""
SLIDE_LIMIT_M, DEPTH_LIMIT_M, GAIN_LIMIT_J = 0.5, 0.02, 8.0
"""8 J are about 1 % of the energy of a walking person."""


def missing(measured: Figures, plan: FallPlan) -> float:
    """How far a fall is from real ones: 0 within all ranges, else a sum of excesses; infinite if it is not the planned fall."""
    fatal = (
        not IMPACT_RANGE_S[0] <= measured.impact_s <= IMPACT_RANGE_S[1]
        or measured.heading not in _headings(plan)
        or measured.slide_m > SLIDE_LIMIT_M
        or max(measured.deepest_m) > DEPTH_LIMIT_M
        or measured.gain_j > GAIN_LIMIT_J
    )
    if fatal:
        return math.inf
    values = measured.descent_s, measured.pelvis_mps, measured.head_mps
    ranges = DESCENT_RANGE_S, PELVIS_RANGE_MPS, HEAD_RANGE_MPS
    # A slip ends on the back or the side, mostly on the back.
    aside = ASIDE if plan.type == "slip" and plan.direction is None and measured.heading != "back" else 0.0
    return aside + sum(
        max(low - value, 0.0) + max(value - high, 0.0) for value, (low, high) in zip(values, ranges, strict=True)
    )


def least_missing(measured: Figures, run: Run, plan: FallPlan) -> float:
    """A lower bound of what is `missing` if the run goes on, from its figures once pelvis and chest are down: a body may still
    slide back, and the head's speed is known `SEEN` frames after it has struck."""
    struck = any("head" in touching for touching in run.touches[:-SEEN])
    return missing(replace(measured, slide_m=0.0, head_mps=measured.head_mps if struck else HEAD_RANGE_MPS[0]), plan)
