"""Quantisation and saturation of I and Q."""

from __future__ import annotations

import numpy as np

from t2d_rt.types.receiver import Adc


def quantised(samples: np.ndarray, adc: Adc) -> tuple[np.ndarray, int]:
    """Samples rounded to two's complement, complex64, and how many of them were clipped in I or Q.

    A full-scale tone keeps 6.02 bits + 1.76 dB over the quantisation noise of each channel (eq. 38).
    """
    codes = np.array(samples, np.complex64, order="C").view(np.float32)  # worked on in place: it is copied once
    codes /= np.float32(adc.step)
    np.rint(codes, out=codes)
    lowest, highest, clipped = np.float32(-(2 ** (adc.bits - 1))), np.float32(2 ** (adc.bits - 1) - 1), 0
    if codes.size and (codes.min() < lowest or codes.max() > highest):
        clipped = int(np.count_nonzero(((codes < lowest) | (codes > highest)).reshape(-1, 2).any(axis=1)))
        np.clip(codes, lowest, highest, out=codes)
    codes *= np.float32(adc.step)
    codes += np.float32(0)  # no -0
    return codes.view(np.complex64).reshape(samples.shape), clipped
