"""Abnormal gaits: the changes that make each type, by severity, with their clinical sources."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from t2d_rt.core.checks import choice, number
from t2d_rt.motion.contacts import SIDES
from t2d_rt.motion.descriptions.slots import GAIT_TYPES, GaitType, Side
from t2d_rt.motion.kinematics import Poses
from t2d_rt.motion.vary.changed_walk import changed_walk
from t2d_rt.motion.vary.gait_change import GaitChange

Range = tuple[float, float]
"""Values at severity 0 (mild) and 1 (severe)."""

SPREAD = 0.12
"""Standard deviation of the logarithm of each drawn value about its range: no two patients are alike."""

TEMPO_SPREAD = 0.04
"""That of stride and cadence, whose ranges are those of groups of patients."""

DEGREE = math.pi / 180

_PARKINSON: dict[str, Range] = {
    "stride": (0.80, 0.45), "cadence": (1.0, 1.08), "lift_both": (0.80, 0.50), "lean_rad": (5 * DEGREE, 20 * DEGREE),
    "arms": (0.6, 0.1), "elbow_bend_rad": (15 * DEGREE, 55 * DEGREE), "crouch_m": (0.01, 0.035), "pelvis_turn": (0.7, 0.3),
    "step_time_spread": (0.03, 0.05), "hand_tremor_rad": (1 * DEGREE, 4 * DEGREE),
}  # fmt: skip

RANGES: dict[GaitType, dict[str, Range]] = {
    # Short steps at a normal cadence, stooped, arms bent and not swinging, shuffling feet (Morris et al. 1996, Brain 119: 551;
    # strides of 0.9 to 1.1 m for 1.4 m, which severities up to 0.45 give; shorter ones are chosen, not measured). Stride times vary
    # twice as much as in healthy persons (Hausdorff 2005).
    "parkinsonian": _PARKINSON,
    # Steps grow shorter and faster while the trunk runs ahead of the feet (Nutt et al. 2011, Lancet Neurol. 10: 734).
    "festinating": _PARKINSON | {"stride": (0.85, 0.60), "lean_rad": (10 * DEGREE, 25 * DEGREE), "hurry": (0.2, 0.4)},
    # Halts of seconds with the feet stuck and the knees trembling at 3 to 8 Hz (Moore et al. 2008, J. Neurosci. Methods 167: 340).
    "freezing": _PARKINSON | {"freeze_s": (1.2, 4.0), "hurry": (0.2, 0.4)},
    # The trunk leans over the standing foot and the pelvis drops on the other side, left and right alike: weak hip abductors
    # (Perry and Burnfield 2010, ch. 14; Trendelenburg 1895).
    "waddling": {
        "stride": (0.88, 0.70), "cadence": (0.97, 0.88), "step_width_m": (0.16, 0.26), "rolls": (6 * DEGREE, 16 * DEGREE),
        "drops": (3 * DEGREE, 8 * DEGREE), "pelvis_shift_m": (0.015, 0.05), "lean_rad": (-3 * DEGREE, -8 * DEGREE),
        "arms_apart_rad": (4 * DEGREE, 12 * DEGREE),
    },
    # A wide base, steps that vary in time and place, a swaying trunk, arms held off (Stolze et al. 2002, JNNP 73: 310;
    # stride times vary by 5 to 10 %, Schniepp et al. 2012).
    "ataxic": {
        "stride": (0.90, 0.70), "cadence": (0.92, 0.78), "step_width_m": (0.18, 0.30), "step_time_spread": (0.06, 0.14),
        "along_m": (0.02, 0.06), "across_m": (0.015, 0.04), "unsteady_rad": (1.5 * DEGREE, 4 * DEGREE),
        "arms_apart_rad": (8 * DEGREE, 22 * DEGREE), "lift_both": (1.05, 1.3),
    },
    # Knees bent and pressed together, feet that land before one another on their toes and swing around (spastic diplegia; Rodda
    # et al. 2004, J. Bone Joint Surg. 86-B: 251).
    "scissor": {
        "stride": (0.78, 0.55), "cadence": (0.92, 0.80), "step_width_m": (0.11, 0.07), "crouch_m": (0.03, 0.07),
        "knees_inward_rad": (6 * DEGREE, 12 * DEGREE), "equinus_rad": (6 * DEGREE, 14 * DEGREE), "circumduction_m": (0.05, 0.08),
        "rolls": (4 * DEGREE, 9 * DEGREE), "lean_rad": (4 * DEGREE, 10 * DEGREE), "arms_apart_rad": (8 * DEGREE, 15 * DEGREE),
        "elbow_bend_rad": (20 * DEGREE, 50 * DEGREE), "arms": (0.8, 0.5),
    },
    # A foot that hangs is lifted high so that the toes clear the floor, and lands on its ball (Perry and Burnfield 2010, ch. 11).
    "steppage": {
        "stride": (0.92, 0.78), "cadence": (0.95, 0.85), "lift_side": (1.8, 2.6), "drop_side": (15 * DEGREE, 28 * DEGREE),
    },
    # Weight is borne on the sore leg for a short time, with the trunk over it and a short step of the other (Perry and
    # Burnfield 2010, ch. 14).
    "limping": {
        "stride": (0.92, 0.72), "cadence": (0.95, 0.82), "hurry_side": (1.15, 1.6), "short_other_m": (0.03, 0.10),
        "roll_side": (3 * DEGREE, 9 * DEGREE), "drop_of_side": (1 * DEGREE, 4 * DEGREE), "lift_side": (0.9, 0.65),
        "crouch_m": (0.0, 0.01),
    },
}  # fmt: skip


def gait_change(type: GaitType, severity: float, rng: np.random.Generator, *, side: Side | None = None) -> GaitChange:
    """A patient's change of gait: each value lies at `severity`, 0 (mild) to 1 (severe), of its range, give or take.

    side: of the leg that is spared, of the foot that drops, or of the arm that swings least, in gaits of one side; None draws it.
    """
    choice("type", type, GAIT_TYPES)
    if side is not None:
        choice("side", side, SIDES)
    number("severity", severity, 0.0, 1.0)
    drawn = {
        name: (low + severity * (high - low))
        * float(
            np.exp((TEMPO_SPREAD if name in ("stride", "cadence") else SPREAD) * np.clip(rng.standard_normal(), -2, 2))
        )
        for name, (low, high) in RANGES[type].items()
    }
    any_side = int(rng.integers(2))
    both = bool(type == "steppage" and rng.random() < 0.4)  # a foot drops on one side more often than on both
    if side is None:
        return GaitChange(**_fields(drawn, any_side, both, rng))
    return GaitChange(**_fields(drawn, SIDES.index(side), False, rng))


def abnormal_walk(
    walk: Poses, type: GaitType, *, severity: float, rng: np.random.Generator, side: Side | None = None
) -> Poses:
    """A recorded straight walk as a patient with that gait would walk it, from the origin along +x; `side` as in `gait_change`."""
    return changed_walk(walk, gait_change(type, severity, rng, side=side), rng)


def _fields(drawn: dict[str, float], side: int, both: bool, rng: np.random.Generator) -> dict[str, Any]:
    """Fields of a `GaitChange` from the values that were drawn; those of one side go to `side`."""

    def pair(affected: float, other: float) -> tuple[float, float]:
        if both:
            return affected, affected
        return (affected, other) if side == 0 else (other, affected)

    fields: dict[str, Any] = {name: value for name, value in drawn.items() if name in GaitChange.__dataclass_fields__}
    if "lift_both" in drawn:
        fields["lift"] = drawn["lift_both"], drawn["lift_both"]
    if "lift_side" in drawn:
        fields["lift"] = pair(drawn["lift_side"], 1.0)
    if "drop_side" in drawn:
        fields["foot_drop_rad"] = pair(drawn["drop_side"], 0.0)
    if "arms" in drawn:  # Parkinson's disease begins on one side
        fields["arm_swing"] = pair(min(drawn["arms"], 1.0), min(1.5 * drawn["arms"], 1.0))
    if "rolls" in drawn:
        fields["trunk_roll_rad"] = drawn["rolls"], drawn["rolls"]
    if "drops" in drawn:
        fields["pelvis_drop_rad"] = drawn["drops"], drawn["drops"]
    if "along_m" in drawn:
        fields["placement_m"] = drawn["along_m"], drawn["across_m"]
    if "hurry_side" in drawn:
        fields["hurried_stance"] = pair(drawn["hurry_side"], 1.0)
        fields["shorter_step_m"] = pair(0.0, drawn["short_other_m"])
        fields["trunk_roll_rad"] = pair(drawn["roll_side"], 0.0)
        fields["pelvis_drop_rad"] = pair(drawn["drop_of_side"], 0.0)
    if "freeze_s" in drawn:
        count = int(rng.integers(1, 3))
        fields["freezes_s"] = tuple(drawn["freeze_s"] * rng.uniform(0.6, 1.2) for _ in range(count))
        fields["tremble_hz"] = float(rng.uniform(4.0, 7.0))
    return fields
