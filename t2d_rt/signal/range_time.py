"""Power over range and time, and the chirps of single coherent intervals, both after MTI."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, integer, number
from t2d_rt.core.errors import InputError
from t2d_rt.signal.doppler import Mti, ascending, checked_windows, filtered, window_starts
from t2d_rt.signal.maps import RangeDoppler, RangeTime
from t2d_rt.signal.mti import PAPER_KERNEL
from t2d_rt.signal.multiplex import separated
from t2d_rt.signal.range import check_finite, check_recording, range_fft, taper
from t2d_rt.types.radar import Radar


def range_time(
    adc: Any,
    radar: Radar,
    *,
    range_window: str = "hann",
    mti: str | None = None,
    cutoff_mps: float = 0.1,
    kernel: Sequence[float] = PAPER_KERNEL,
    n_window: int | None = None,
    overlap: int | None = None,
) -> RangeTime:
    """Power over range and time of a cube (chirp, antenna, sample): |range FFT|^2 after MTI, averaged over the antennas and over
    the chirps of each column.

    Columns are those of `spectrogram` for the same `n_window` and `overlap`; so is MTI. A target of power P reads P in its peak
    bin.
    """
    check_recording(adc, radar)
    clutter_filter = Mti.of(mti, cutoff_mps, kernel)
    adc, radar = separated(adc, radar)
    n_window, overlap, _ = checked_windows(radar, adc.shape[0], n_window, overlap, None)
    starts = window_starts(adc.shape[0], radar.loops_per_frame or adc.shape[0], n_window, n_window - overlap)
    columns = []

    cells_of = partial(range_fft, window=range_window)
    for first, windows, cells in filtered(adc, radar, starts, n_window, cells_of, clutter_filter):
        power = cells.real**2 + cells.imag**2
        power = power if power.ndim == 2 else power.mean(axis=1)
        columns += [power[start : start + n_window].mean(axis=0) for start in windows - first]
    power = np.stack(columns, axis=1)
    check_finite(power)
    times_s = radar.chirp_starts_s(adc.shape[0])[starts] + n_window / 2 * radar.loop_interval_s
    return RangeTime(power=power, range_m=radar.range_axis_m(), time_s=times_s)


def coherent_interval(
    adc: Any,
    radar: Radar,
    *,
    time_s: float | None = None,
    chirps: int | None = None,
    mti: str | None = None,
    cutoff_mps: float = 0.1,
    kernel: Sequence[float] = PAPER_KERNEL,
) -> tuple[np.ndarray, Radar, float]:
    """A coherent interval of a cube for `range_doppler`: its samples after MTI over the record, its radar (with transmitters
    separated), and its middle [s].

    time_s: middle of the interval [s]; that of the record by default. Near the ends of the record, or of a burst, the interval is
        shifted inside.
    chirps: number of rows of the cube; by default that of a window of `spectrogram`.
    """
    check_recording(adc, radar)
    clutter_filter = Mti.of(mti, cutoff_mps, kernel)
    adc, radar = separated(adc, radar)
    rows = adc.shape[0]
    starts_s = radar.chirp_starts_s(rows)
    burst = min(radar.loops_per_frame or rows, rows)
    chirps = min(256, burst) if chirps is None else integer("chirps", chirps, 2)
    if chirps > burst:
        what = "the record" if radar.loops_per_frame is None else "a burst"
        raise InputError(f"an interval of {chirps} chirps does not fit into {what} of {burst}; take a shorter one")
    last_s = float(starts_s[-1])
    time_s = (
        last_s / 2
        if time_s is None
        else number("time_s", time_s, 0, last_s, unit="s", hint="it is the interval's middle")
    )
    nearest = int(np.abs(starts_s - time_s).argmin())
    low = nearest // burst * burst
    high = min(low + burst, rows) - chirps
    if high < low:  # an unfinished burst at the end
        low, high = low - burst, low - chirps
    start = int(np.clip(nearest - chirps // 2, low, high))
    window = np.array([start])
    # Copies, because MTI subtracts in place.
    _, _, part = next(filtered(adc, radar, window, chirps, np.array, clutter_filter))
    offset = start if len(part) == rows else 0
    middle_s = float(starts_s[start]) + chirps / 2 * radar.loop_interval_s
    return part[offset : offset + chirps], radar, middle_s


def range_doppler_over(
    adc: Any,
    radar: Radar,
    times_s: np.ndarray,
    *,
    range_window: str = "hann",
    mti: str | None = None,
    cutoff_mps: float = 0.1,
    kernel: Sequence[float] = PAPER_KERNEL,
    n_window: int | None = None,
) -> tuple[np.ndarray, RangeDoppler]:
    """Range-Doppler maps over time: the middles of their intervals [s] (K,), and their powers [W] (K, velocity, range).

    Each map is that of `range_doppler` for the `coherent_interval` of `n_window` chirps at one of `times_s`. Several times for
    which the interval is the same, at the ends of the record or of a burst, give one map. MTI is as in `spectrogram`.
    """
    from scipy import fft

    check_recording(adc, radar)
    times_s = array("times_s", times_s, ("time",))
    if not len(times_s):
        raise InputError("times_s must hold at least one time, got none")
    clutter_filter = Mti.of(mti, cutoff_mps, kernel)
    adc, radar = separated(adc, radar)
    n_window, _, _ = checked_windows(radar, adc.shape[0], n_window, None, None)
    possible = window_starts(adc.shape[0], radar.loops_per_frame or adc.shape[0], n_window, 1)
    middles_s = radar.chirp_starts_s(adc.shape[0])[possible] + n_window / 2 * radar.loop_interval_s
    after = np.searchsorted(middles_s, times_s).clip(1, max(1, len(middles_s) - 1))
    nearer = np.abs(middles_s[after - 1] - times_s) <= np.abs(
        middles_s[np.minimum(after, len(middles_s) - 1)] - times_s
    )
    nearest = np.unique(np.where(nearer, after - 1, after))
    slow = taper("hann", n_window, periodic=True)[:, None, None]
    maps = []

    cells_of = partial(range_fft, window=range_window)
    for first, windows, cells in filtered(adc, radar, possible[nearest], n_window, cells_of, clutter_filter):
        cells = cells.reshape(len(cells), -1, cells.shape[-1])
        for start in windows - first:
            spectra = fft.fft(cells[start : start + n_window] * slow.astype(cells.real.dtype), axis=0, workers=-1)
            maps.append(ascending((spectra.real**2 + spectra.imag**2).mean(axis=1)))
    power = np.stack(maps)
    check_finite(power)
    result = RangeDoppler(power=power, velocity_mps=radar.speed_axis_mps(n_window), range_m=radar.range_axis_m())
    return middles_s[nearest], result
