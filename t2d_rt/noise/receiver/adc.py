"""Quantisation and saturation of I and Q."""

from __future__ import annotations

import numpy as np

from t2d_rt.types.receiver import Adc


def quantised(samples: np.ndarray, adc: Adc) -> tuple[np.ndarray, int]:
    """Samples rounded to two's complement, complex64, and how many of them were clipped in I or Q.

    A full-scale tone keeps 6.02 bits + 1.76 dB over the quantisation noise of each channel (eq. 38).
    """
    words = np.ascontiguousarray(samples, np.complex64).view(np.float32) / np.float32(adc.step)
    codes = np.rint(words)
    lowest, highest = np.float32(-(2 ** (adc.bits - 1))), np.float32(2 ** (adc.bits - 1) - 1)
    clipped = ((codes < lowest) | (codes > highest)).reshape(-1, 2).any(axis=1)
    codes = np.clip(codes, lowest, highest) * np.float32(adc.step) + np.float32(0)  # no -0
    return codes.view(np.complex64).reshape(samples.shape), int(np.count_nonzero(clipped))
