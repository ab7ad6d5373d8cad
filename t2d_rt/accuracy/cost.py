"""Memory that a run needs, estimated before it starts."""

from __future__ import annotations

import math
from collections.abc import Sequence

from t2d_rt.accuracy.estimate import FIELD_BYTES, FINER
from t2d_rt.cubes import is_large
from t2d_rt.memory import release
from t2d_rt.model import Model
from t2d_rt.scattering.refinement import REFINING_BYTES
from t2d_rt.scattering.streams import batches
from t2d_rt.types import EchoStream

SUMMED_BYTES, SUMMED_ARRAY_BYTES = 7_200, 12_000
"""Bytes that an echo takes while a window of frames is summed, for one antenna and for an array (measured: 133 000 echoes of a
walk in living_room add 0.96 GB)."""
POSED_BYTES = 40 * 64
"""Bytes that a facet's vertex takes in the frames of a window."""


def memory_bytes(model: Model, streams: Sequence[EchoStream], *, measured: bool) -> float:
    """Greatest memory to be expected of summing streams, and of measuring the error after it, beyond what the process held."""
    radar = model.radar
    of_echo = SUMMED_ARRAY_BYTES if radar.is_array else SUMMED_BYTES
    most: float = max(of_echo * part.echoes + POSED_BYTES * part.vertices for part in batches(streams, radar))
    if measured:
        # A surface has twice as many facets as vertices; their number goes with the inverse of the phase sagitta.
        facets = 2 * max(stream.vertices for stream in streams) / FINER
        most = max(most, REFINING_BYTES * facets, FIELD_BYTES)
    shape = (len(radar.chirp_times_s(model.span_s[1] - model.span_s[0])), radar.antennas, radar.samples)
    cube = 0.0 if is_large(shape, model.memory.limit_bytes) else 8.0 * math.prod(shape)
    return model.memory.taken_bytes + most + cube


def check_memory(model: Model, streams: Sequence[EchoStream], *, measured: bool) -> float:
    """The same, refused where it is more than the run may take."""
    needed = memory_bytes(model, streams, measured=measured)
    if needed > model.memory.limit_bytes:
        release()  # what is free counts for nothing
        needed = memory_bytes(model, streams, measured=measured)
    remedy = (
        "ask for a looser tolerance or a coarser sagitta_rad, cut the record, or measure no error (measure_error=False)"
    )
    model.memory.check(needed, "this simulation", remedy if measured else remedy.rpartition(", or ")[0])
    return needed
