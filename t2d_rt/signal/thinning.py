"""Which samples of a chirp are enough for the sum of powers over all of them."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from t2d_rt.core.cubes import DiskCube
from t2d_rt.signal.range import taper

THINNED, MOST_STEP = 1e-6, 16
"""Greatest |K_D - K| / K(0) of eq. 16a, and the greatest step D."""
ENDS = 1e-7
"""The same by samples that are left out at the ends of a window."""
FINER = 8
"""Numbers of beats per range bin at which K is compared."""


def sample_step(adc: Any, window: str, start: int, stop: int) -> int:
    """Greatest step of samples whose powers, times the step, add up to those of all, within `THINNED`, at chirps start..stop.

    That depends on how far beats lie apart, which is known of cubes that hold products.
    """
    spread = adc.spread(start, stop) if isinstance(adc, DiskCube) else math.inf
    return 1 if math.isinf(spread) else _step_of(window, adc.shape[-1], math.ceil(spread))


@lru_cache(maxsize=256)
def _step_of(window: str, samples: int, spread: int) -> int:
    """The same for a spread [rad from mid-sweep to its end], by the K of eq. 16a, here an FFT of the squared window."""
    from scipy import fft

    power, count = taper(window, samples) ** 2, FINER * samples
    apart = math.ceil(
        spread * count / (math.pi * (samples - 1))
    )  # what bin k holds differs by pi k (samples - 1) / count
    if 2 * apart >= count:
        return 1
    whole = fft.fft(power, count)[: apart + 1]
    for step in range(MOST_STEP, 1, -1):
        some = np.zeros(samples)
        some[::step] = step * power[::step]
        if np.abs(fft.fft(some, count)[: apart + 1] - whole).max() <= THINNED * power.sum():
            return step
    return 1


def weighed(window: np.ndarray) -> slice:
    """Samples of a chirp without those at its ends whose squared weights add up to less than `ENDS` of all."""
    below = np.cumsum(window**2) < ENDS / 2 * np.sum(window**2)
    above = np.cumsum(window[::-1] ** 2) < ENDS / 2 * np.sum(window**2)
    return slice(int(below.sum()), len(window) - int(above.sum()))
