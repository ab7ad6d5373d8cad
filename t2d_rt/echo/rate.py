"""How often a moving shape must be looked at for its delays' splines and facets' amplitudes to hold (docs/physics.md, eq. 22)."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.types import Ellipsoids, MovingMesh, Radar

TOLERANCE_DB = -38.0
"""What the splines may add to the field's error unless something else is asked for."""
TURN_RAD = 0.1
"""By how much a mesh's edges may turn between frames, root mean square, for the cubics of facets' amplitudes: a fan's moving
field errs by -23.6 dB at 0.1 rad, by -18 dB at 0.2 (validation/report, movers). A walker's delays ask for more than that."""
DB_PER_OCTAVE = 6.0
"""What half of that turn gains, by the same figures."""
LEAST_HZ, MOST_HZ, STEP_HZ = 40.0, 10_000.0, 5.0
PROBE_RATE_HZ, FINER = 240.0, 4.0
"""How often motion is looked at, unless the record is shorter than a look; by how much more often what needs a higher rate."""
PROBE_FRAMES = 12
"""Frames of one look, five of which make a fourth difference."""
LOOKS_PER_S, LEAST_LOOKS, MOST_LOOKS = 3, 4, 40


def needed_rate_hz(
    shape: MovingMesh | Ellipsoids, radar: Radar, start_s: float, stop_s: float, tolerance_db: float = TOLERANCE_DB
) -> float:
    """Rate of surface frames [Hz] between two times, from the fourth derivative of the shape's paths.

    A cubic spline of frames h apart misses x(t) by 16 u^2 (1 - u)^2 h^4 x''''/384 within an interval; the square of that has the
    mean 0.406.
    """
    probe_hz = max(PROBE_RATE_HZ, (PROBE_FRAMES - 1) / (stop_s - start_s))
    needed = _needed(shape, radar, start_s, stop_s, probe_hz, tolerance_db)
    while probe_hz < needed < MOST_HZ:
        probe_hz *= FINER
        needed = _needed(shape, radar, start_s, stop_s, probe_hz, tolerance_db)
    return float(np.clip(math.ceil(needed / STEP_HZ) * STEP_HZ, LEAST_HZ, MOST_HZ))


def _needed(
    shape: MovingMesh | Ellipsoids,
    radar: Radar,
    start_s: float,
    stop_s: float,
    probe_hz: float,
    tolerance_db: float,
) -> float:
    step = 1 / probe_hz
    length = (PROBE_FRAMES - 1) * step
    looks = int(np.clip(LOOKS_PER_S * (stop_s - start_s), LEAST_LOOKS, MOST_LOOKS))
    begin = np.linspace(start_s, stop_s - length, looks)
    times = (begin[:, None] + step * np.arange(PROBE_FRAMES)).ravel()
    points = shape.at(times) if isinstance(shape, MovingMesh) else shape.at(times)[0]
    paths = sum(np.linalg.norm(points - place, axis=2) for place in (radar.tx_position_m, radar.rx_position_m))
    fourth = np.diff(np.reshape(paths, (looks, PROBE_FRAMES, -1)), n=4, axis=1) / step**4
    rad_per_m = 2 * math.pi * radar.mid_frequency_hz / SPEED_OF_LIGHT
    error = 0.406 * np.mean((rad_per_m * fourth / 384) ** 2)
    for_delays = float((error / 10 ** (tolerance_db / 10)) ** 0.125)
    if not isinstance(shape, MovingMesh):
        return for_delays
    edges = points[:, shape.faces[:, 1]] - points[:, shape.faces[:, 0]]
    turned = np.diff(edges.reshape(looks, PROBE_FRAMES, -1, 3), axis=1)
    turn_rad = TURN_RAD * 2 ** ((tolerance_db - TOLERANCE_DB) / DB_PER_OCTAVE)
    return max(for_delays, math.sqrt(np.mean(turned**2) / np.mean(edges**2)) / step / turn_rad)
