"""Limits of the measures, from recorded motion: `python -m validation.motions.limits FOLDER --write` makes `limits.json`.

Recordings with glitches are left out (`left_out` names them, by a rule of that module); a limit is 1.25 times the 99th
percentile of all others.
"""

from __future__ import annotations

import functools
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

FILE = Path(__file__).with_name("limits.json")

AT_MOST = (
    "top_speed_mps", "acceleration_mps2", "jerk_mps3", "bone_change", "foot_skate_m", "sliding_s", "floating_s",
    "floor_penetration_m", "floor_offset_m", "self_penetration_m",
)  # fmt: skip
"""Measures that recorded motion bounds from above."""

GAIT_SIGNS = (
    "cadence_per_min", "step_length", "length_asymmetry", "time_asymmetry", "time_variation", "hastening", "width",
    "width_variation", "knee_lift_deg", "foot_lift", "trunk_lean_deg", "trunk_sway_deg", "arm_swing", "halted_s",
)  # fmt: skip
"""Figures of a gait whose range in recorded normal walks tells abnormal ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What recorded motion keeps to."""

    recordings: int
    """Number of recordings that the limits come from."""
    left_out: dict[str, str]
    """Recordings with glitches, and which."""
    at_most: dict[str, float]
    """1.25 times the 99th percentile of each measure over all recordings."""
    jumps: tuple[tuple[float, float], ...]
    """Frame rate [Hz] and the greatest deviation of a step [m] at it, likewise; rates ascend."""
    gait: dict[str, tuple[float, float]]
    """2.5th and 97.5th percentile of normal walks."""
    walks: int
    by_class: dict[str, dict[str, float]]
    """95th percentile of each measure over the recordings of a class, and their number `n`."""

    def jump_m(self, rate_hz: float) -> float:
        """Greatest deviation of a step at a frame rate [m], between the rates of the table by a power law."""
        rates, jumps = (np.log(values) for values in zip(*self.jumps, strict=True))
        return math.exp(float(np.interp(math.log(rate_hz), rates, jumps)))


@functools.cache
def limits() -> Limits:
    """Those that the package ships."""
    return limits_from(json.loads(FILE.read_text(encoding="utf-8")))


def limits_from(values: dict[str, Any]) -> Limits:
    """Limits as `validation.motions.limits` writes them."""
    return Limits(
        recordings=values["recordings"], left_out=values["left_out"], at_most=values["at_most"],
        jumps=tuple((float(rate), float(jump)) for rate, jump in values["jumps"]), walks=values["walks"],
        gait={name: (low, high) for name, (low, high) in values["gait"].items()}, by_class=values["by_class"],
    )  # fmt: skip
