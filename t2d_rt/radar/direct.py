"""The slow twin of `synthesize`: every echo at every ADC sample, in float64 (docs/physics.md, eq. 1)."""

from __future__ import annotations

import numpy as np

from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.radar.interpolants import central_slopes, hermite, spline_slopes
from t2d_rt.types import Echoes, Radar


def direct_sum(echoes: Echoes, radar: Radar, chirps: np.ndarray, *, every: int = 1, antenna: int = 0) -> np.ndarray:
    """ADC samples (len(chirps), sample) complex128 of one antenna of the cube's given rows; `every` n-th sample of each.

    s(t) = sum A(f) exp(j 2 pi (f_c tau + S tau t - S tau^2/2)), tau and A at the moment of each sample, f = f_c + S t.
    """
    starts = radar.chirp_times_s(float(echoes.times_s[-1] - echoes.times_s[0]))[chirps]
    receivers = len(radar.rx_offsets_m)
    if radar.multiplexing == "ddm":
        phases = radar.tx_phase(chirps)
        pairs = [_pair(echoes, radar, starts, tx, antenna, every) for tx in range(phases.shape[1])]
        return np.asarray(np.einsum("kct,ck->ct", np.stack(pairs), phases))
    return _pair(echoes, radar, starts + radar.antenna_delays_s[antenna], *divmod(antenna, receivers), every)


def _pair(echoes: Echoes, radar: Radar, starts: np.ndarray, tx: int, rx: int, every: int) -> np.ndarray:
    """The same of one transmitter and one receiver, for chirps that start at `starts` [s]."""
    frames = len(echoes.times_s)
    step = 1 / echoes.rate_hz
    fast_time = radar.sample_times_s[::every]
    delay_s = echoes.delay_s
    if echoes.departure_m is not None and echoes.arrival_m is not None:
        delay_s = (
            delay_s
            + (
                _extra_m(echoes.departure_m, radar.tx_position_m, radar.tx_positions_m[tx])
                + _extra_m(echoes.arrival_m, radar.rx_position_m, radar.rx_positions_m[rx])
            )
            / SPEED_OF_LIGHT
        )
    slopes = np.zeros_like(echoes.amplitude) if echoes.slope is None else echoes.slope
    tau_slopes = spline_slopes(frames) @ delay_s
    a_slopes = central_slopes(echoes.amplitude.astype(np.complex128))
    s_slopes = central_slopes(slopes.astype(np.complex128))
    cube = np.empty((len(starts), len(fast_time)), np.complex128)
    for row, start in enumerate(starts):
        for sample, t in enumerate(fast_time):
            position = (start + t) / step
            i = min(int(position), frames - 2)
            u = position - i

            def at(values: np.ndarray, derivative: np.ndarray, i: int = i, u: float = u) -> np.ndarray:
                c = hermite(values[i], values[i + 1], derivative[i], derivative[i + 1])
                return c[0] + u * (c[1] + u * (c[2] + u * c[3]))

            tau = at(delay_s, tau_slopes)
            frequency = radar.carrier_hz + radar.slope_hz_per_s * t
            amplitude = at(echoes.amplitude, a_slopes) + at(slopes, s_slopes) * (frequency - radar.mid_frequency_hz)
            turns = frequency * tau - 0.5 * radar.slope_hz_per_s * tau**2
            cube[row, sample] = np.sum(amplitude * np.exp(2j * np.pi * (turns % 1.0)))
    return cube


def _extra_m(points: np.ndarray, centre: np.ndarray, antenna: np.ndarray) -> np.ndarray:
    """How much farther points (T, N, 3) are from an antenna than from its array's centre [m]."""
    points = points.astype(np.float64)
    return np.asarray(np.linalg.norm(points - antenna, axis=-1) - np.linalg.norm(points - centre, axis=-1))
