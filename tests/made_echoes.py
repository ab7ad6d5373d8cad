"""Made-up echoes that move fast, change and go dark, to set sums against one another."""

from __future__ import annotations

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.types import Echoes, Radar


def random_echoes(
    radar: Radar, *, count: int = 60, frames: int = 40, sloped: bool = True, apparent: bool = False, seed: int = 0
) -> Echoes:
    """Echoes at 3..4 m, up to 5 m/s either way, swinging, some dark for a while.

    `sloped`: with a slope over the sweep; `apparent`: with apparent positions, a little apart for transmitters and receivers.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None] / 100
    range_m = (
        3 + rng.random(count) + rng.uniform(-5, 5, count) * t + 0.1 * np.sin(4 * np.pi * t + 6 * rng.random(count))
    )
    turning = np.cumsum(rng.normal(size=(frames, count)) * 0.3, axis=0)
    amplitude = (rng.normal(size=count) + 1j * rng.normal(size=count)) * np.exp(1j * turning)
    amplitude[10:20, ::3] = 0
    # A tenth of the amplitude at either end of the sweep: 2 cm facets at 4 GHz.
    slope = amplitude * (rng.normal(size=count) + 1j * rng.normal(size=count)) * 0.2 / radar.bandwidth_hz
    heading = rng.normal(size=(count, 3)) * (0, 0.3, 0.3) + (1, 0, 0)
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    places = [np.array(radar.position_m) + range_m[..., None] * heading + shift for shift in (0, (0, 0.1, 0))]
    return Echoes(
        times_s=t[:, 0], delay_s=2 * np.maximum(range_m, 0.3) / SPEED_OF_LIGHT, amplitude=amplitude.astype(np.complex64),
        slope=slope.astype(np.complex64) if sloped else None,
        departure_m=places[0] if apparent else None, arrival_m=places[1] if apparent else None,
    )  # fmt: skip
