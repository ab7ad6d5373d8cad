"""The radar stage: from echoes to ADC samples, and a check whether a waveform is suitable for the speeds of a motion."""

from __future__ import annotations

import math

from t2d_rt.core.errors import warn
from t2d_rt.types.radar import Radar

__all__ = ["check_speed"]


def check_speed(radar: Radar, top_speed_mps: float, *, what: str = "target") -> None:
    """Warns where the top speed of `what` exceeds the unambiguous speed, and names the prf_hz that would suffice."""
    if abs(top_speed_mps) <= radar.max_speed_mps:
        return
    needed = math.ceil(radar.prf_hz * abs(top_speed_mps) / radar.max_speed_mps / 10) * 10
    fits = needed * radar.sweep_time_s <= 1
    fix = f"raise prf_hz to {needed}" + (
        "" if fits else f" and shorten the sweep below {1e6 / needed:.3g} us (fewer samples)"
    )
    warn(
        f"top speed {abs(top_speed_mps):.3g} m/s of {what} exceeds the unambiguous {radar.max_speed_mps:.3g} m/s "
        f"and will alias; {fix}"
    )
