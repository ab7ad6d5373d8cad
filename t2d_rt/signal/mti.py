"""Moving-target indication (MTI): filters along slow time that remove static echoes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from t2d_rt.core.checks import array, choice, integer, number, numeric, shown
from t2d_rt.core.errors import InputError

METHODS = ("none", "mean", "highpass", "canceller")
PAPER_KERNEL = (1.0, -2.0, 3.0, -2.0, 1.0)


def mti(
    profile: np.ndarray,
    method: str = "mean",
    *,
    prf_hz: float | None = None,
    cutoff_hz: float | None = None,
    order: int = 4,
    kernel: Sequence[float] = PAPER_KERNEL,
) -> np.ndarray:
    """Filter a range profile (chirp, ...) along slow time (axis 0); same shape and precision.

    - "none": as it is.
    - "mean": minus the mean over the record. A null of the width of one over the duration; movers lose nothing.
    - "highpass": Butterworth of `order` at `cutoff_hz`, run forwards and backwards (no delay; 6 dB down at the
      cut-off). The widest null. Text2Doppler's code runs order 4 at 0.00375 PRF, forwards only. Needs `prf_hz`.
    - "canceller": FIR `kernel`, centred, ends held. The default 1 -2 3 -2 1 is the paper's and does *not* cancel static
      echoes: its response is (1 - 2 cos w)^2, w = 2 pi f_D/PRF, that is 0 dB at zero Doppler, nulls at +-PRF/6, 19 dB
      (a factor of 9) at +-PRF/2. Kernels whose sum is zero cancel: (1, -2, 1) is the three-pulse canceller, (1, -4, 6,
      -4, 1) the five-pulse one.
    """
    profile = _checked_profile(profile)
    choice("MTI method", method, METHODS)
    if method == "none":
        return profile
    if method == "mean":
        # float64 sums: in single precision the mean of 1e5 chirps would leave a residual.
        return profile - profile.mean(axis=0, dtype=np.complex128).astype(profile.dtype)
    if method == "highpass":
        return _highpass(profile, prf_hz, cutoff_hz, order)
    return _convolve(profile, kernel)


def _checked_profile(profile: np.ndarray) -> np.ndarray:
    cells = numeric("profile", profile)
    if cells.ndim < 1 or 0 in cells.shape or not np.issubdtype(cells.dtype, np.complexfloating):
        raise InputError(f"profile must be complex, of shape (chirp, ...), got {cells.dtype} of shape {cells.shape}")
    return cells


def _highpass(profile: np.ndarray, prf_hz: float | None, cutoff_hz: float | None, order: int) -> np.ndarray:
    from scipy.signal import butter, sosfiltfilt

    prf_hz = None if prf_hz is None else number("prf_hz", prf_hz, unit="Hz")
    cutoff_hz = None if cutoff_hz is None else number("cutoff_hz", cutoff_hz, unit="Hz")
    order = integer("order of the high-pass", order, 1, 10)
    if prf_hz is None or cutoff_hz is None or not 0 < cutoff_hz < prf_hz / 2:
        raise InputError(
            f"highpass needs prf_hz and a cutoff_hz between 0 and prf_hz/2, got prf_hz {prf_hz} and cutoff_hz "
            f"{cutoff_hz}"
        )
    sos = butter(order, cutoff_hz, "highpass", fs=prf_hz, output="sos")
    # The record is reflected over one period of the cut-off at both ends, so that the filter has settled where it begins.
    padding = min(int(prf_hz / cutoff_hz) + 1, len(profile) - 1)
    columns = profile.reshape(len(profile), -1)
    filtered = np.empty_like(columns)
    for start in range(0, columns.shape[1], 16):  # a few bins at a time, because scipy filters in double precision
        part = np.ascontiguousarray(columns[:, start : start + 16].T)
        filtered[:, start : start + 16] = sosfiltfilt(sos, part, axis=-1, padlen=padding).T
    return filtered.reshape(profile.shape)


def _convolve(profile: np.ndarray, kernel: Sequence[float]) -> np.ndarray:
    taps = array("kernel", kernel, limit=1e12).astype(profile.real.dtype)
    if taps.ndim != 1 or not 1 <= len(taps) <= len(profile):
        raise InputError(f"kernel must be 1 to {len(profile)} finite numbers, got {shown(kernel)}")
    before = (len(taps) - 1) // 2
    # End values are repeated: with zeros beyond the ends, static echoes would cause transients there.
    ends = [(before, len(taps) - 1 - before)] + [(0, 0)] * (profile.ndim - 1)
    padded = np.pad(profile, ends, mode="edge")
    filtered = np.zeros_like(profile)
    for delay, tap in enumerate(taps[::-1]):
        filtered += tap * padded[delay : delay + len(profile)]
    return filtered
