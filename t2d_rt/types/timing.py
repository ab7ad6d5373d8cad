"""When a radar's chirps are sent: loops of its transmitters, bursts, and what fits into them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from t2d_rt.core.checks import integer, positive
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from t2d_rt.types.radar import Radar

MOST_CHIRPS = 10**8
"""Of a record (three hours of `table2`): their times must fit memory."""


def check_timing(radar: Radar) -> None:
    """Refuses sweeps longer than the chirp interval, and bursts longer than their interval or of unfinished loops."""
    interval = 1 / radar.prf_hz
    if radar.sweep_time_s > interval * (1 + 1e-9):
        raise InputError(
            f"sampling window of {radar.sweep_time_s * 1e6:.6g} us ({radar.samples} samples at "
            f"{radar.sample_rate_hz:.6g} Hz) is longer than the chirp interval of {interval * 1e6:.6g} us; "
            f"lower prf_hz to {math.floor(1 / radar.sweep_time_s * 1e3) / 1e3:.10g} or take fewer samples"
        )
    if (radar.chirps_per_frame is None) != (radar.frame_interval_s is None):
        raise InputError(
            f"bursts need both chirps_per_frame and frame_interval_s, got {radar.chirps_per_frame} and "
            f"{radar.frame_interval_s}; give both, or neither for continuous chirps"
        )
    if radar.chirps_per_frame is not None and radar.frame_interval_s is not None:
        burst = radar.chirps_per_frame * interval
        if burst > radar.frame_interval_s * (1 + 1e-9):
            raise InputError(
                f"burst of {radar.chirps_per_frame} chirps lasts {burst * 1e3:.6g} ms, longer than its frame of "
                f"{radar.frame_interval_s * 1e3:.6g} ms; raise frame_interval_s or prf_hz, or take fewer chirps"
            )
        shared = radar.sharing_transmitters
        if radar.chirps_per_frame % shared:
            raise InputError(
                f"bursts of {radar.chirps_per_frame} chirps do not give {shared} transmitters equally many each; set "
                f"chirps_per_frame to a multiple of {shared}"
            )


def chirp_starts(radar: Radar, chirps: int) -> np.ndarray:
    """First ADC samples of the first `chirps` rows of the cube [s], (chirps,)."""
    chirp = np.arange(integer("chirps", chirps, 0, MOST_CHIRPS, hint="cut the record"))
    if radar.loops_per_frame is None or radar.frame_interval_s is None:
        return chirp * radar.loop_chirps / radar.prf_hz
    frame, within = np.divmod(chirp, radar.loops_per_frame)
    return frame * radar.frame_interval_s + within * radar.loop_chirps / radar.prf_hz


def chirp_times(radar: Radar, duration_s: float) -> np.ndarray:
    """First ADC samples of all rows of the cube whose samples lie within `duration_s` [s], (chirps,)."""
    duration_s = positive("duration_s", duration_s, unit="s")
    window = (radar.samples - 1) / radar.sample_rate_hz
    if radar.chirps_per_frame is None or radar.frame_interval_s is None:
        name, group, period = (
            "chirp" if radar.sharing_transmitters == 1 else "loop",
            radar.sharing_transmitters,
            radar.sharing_transmitters / radar.prf_hz,
        )
    else:
        name, group, period = "burst", radar.chirps_per_frame, radar.frame_interval_s
    last = window + (group - 1) * radar.chirp_interval_s  # last sample of a group, from its start
    # The slack keeps a chirp that ends with the record on paper but not in the last digit.
    groups = math.floor((duration_s - last) / period + 1e-9) + 1
    if groups < 1:
        raise InputError(f"duration of {duration_s:.6g} s holds no whole {name}; it must be at least {last:.6g} s")
    return chirp_starts(radar, groups * group // radar.loop_chirps)
