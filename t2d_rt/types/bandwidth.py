"""Conversion of a radar's bandwidth, where that is given, to its chirp slope."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from t2d_rt.core.checks import positive
from t2d_rt.core.errors import InputError

BANDWIDTHS = {"bandwidth_hz", "ramp_bandwidth_hz", "ramp_time_s"}
"""Fields that may be given in place of a radar's slope: the bandwidth swept while sampling, or that of a whole ramp and its
time."""


def with_changes(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Fields with some changed: a given bandwidth replaces the slope, and a track replaces position and boresight."""
    replaced = {"slope_hz_per_s"} if BANDWIDTHS & changes.keys() else set()
    replaced |= {"position_m", "boresight"} if changes.get("track") is not None else set()
    return {**{name: value for name, value in base.items() if name not in replaced}, **changes}


def with_slope(values: dict[str, Any]) -> dict[str, Any]:
    """Fields with the slope in place of bandwidths; refuses values that contradict one another."""
    sweeps = {name: positive(name, values.pop(name)) for name in sorted(BANDWIDTHS & values.keys())}
    slopes = {"slope_hz_per_s": values["slope_hz_per_s"]} if "slope_hz_per_s" in values else {}
    window_s = None
    if {"sample_rate_hz", "samples"} <= values.keys():
        rate_hz = positive("sample_rate_hz", values["sample_rate_hz"], unit="Hz")
        window_s = positive("samples", values["samples"]) / rate_hz
    if "bandwidth_hz" in sweeps:
        if window_s is None:
            raise InputError(
                "bandwidth_hz is swept while sampling, so that it needs sample_rate_hz and samples; give both"
            )
        slopes["bandwidth_hz"] = sweeps["bandwidth_hz"] / window_s
    if window_s is not None and window_s > sweeps.get("ramp_time_s", math.inf) * (1 + 1e-9):
        raise InputError(
            f"ramp_time_s of {1e6 * sweeps['ramp_time_s']:.6g} us is shorter than the sampling window of {1e6 * window_s:.6g} us; "
            "take fewer samples"
        )
    if "ramp_bandwidth_hz" in sweeps or "ramp_time_s" in sweeps:
        if not {"ramp_bandwidth_hz", "ramp_time_s"} <= sweeps.keys():
            raise InputError("ramp_bandwidth_hz and ramp_time_s tell the slope together; give both, or bandwidth_hz")
        slopes["ramp_bandwidth_hz"] = sweeps["ramp_bandwidth_hz"] / sweeps["ramp_time_s"]
    (first, slope), *others = slopes.items()
    slope = positive(first, slope)
    for name, other in others:
        if not math.isclose(other, slope, rel_tol=1e-6):
            raise InputError(
                f"{first} and {name} contradict each other: slopes of {slope:.6g} and {other:.6g} Hz/s; give one of them"
            )
    return {**values, "slope_hz_per_s": slope}
