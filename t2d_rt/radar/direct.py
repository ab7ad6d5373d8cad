"""Direct sum of echoes: every echo at every ADC sample, in float64 (docs/physics.md, eq. 1); slow, the reference for
`synthesize`."""

from __future__ import annotations

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.radar.interpolants import central_slopes, hermite, spline_slopes
from t2d_rt.radar.sweep import cubic_at
from t2d_rt.radar.windows import filtered
from t2d_rt.types import EchoArrays, Echoes, Radar, stream
from t2d_rt.types.scatterer import Scatterer

FRAMES_NEARBY = 12
"""Number of frames, half of them on either side of a chirp, from which its spline is computed; the influence of farther ones falls
by 0.268 per frame, to 4e-4 after six."""


def direct_sum(echoes: Echoes, radar: Radar, chirps: np.ndarray, *, every: int = 1, antenna: int = 0) -> np.ndarray:
    """ADC samples (len(chirps), sample) complex128 of one antenna, at some rows of the cube; every `every`-th sample of each.

    s(t) = sum A(f) exp(j 2 pi (f_c tau + S tau t - S tau^2/2)), tau and A at the instant of each sample, f = f_c + S t.
    """
    echoes = _filtered(echoes.times_s, stream(echoes).frames(0, len(echoes.times_s)), radar)
    starts = radar.chirp_times_s(float(echoes.times_s[-1] - echoes.times_s[0]))[chirps]
    receivers, samples = len(radar.rx_offsets_m), np.arange(0, radar.samples, every)
    if radar.multiplexing == "ddm":
        phases = radar.tx_phase(chirps)
        pairs = [_pair(echoes, radar, starts, tx, antenna, samples) for tx in range(phases.shape[1])]
        return np.asarray(np.einsum("kct,ck->ct", np.stack(pairs), phases))
    return _pair(echoes, radar, starts + radar.antenna_delays_s[antenna], *divmod(antenna, receivers), samples)


def chirp_samples(
    ends: EchoArrays, radar: Radar, rows: np.ndarray, antennas: np.ndarray, samples: np.ndarray
) -> np.ndarray:
    """Samples (K, S) complex128 at the cube's `rows` and `antennas` (K,), from echoes (2 K, N) given at the first and the last
    instant of each chirp.

    Delays are straight lines between these instants, exact to 1 nm over 40 us; amplitudes are the means of both.
    """
    out, ends = np.zeros((len(rows), len(samples)), np.complex128), filtered(ends, radar)
    for k, (row, antenna) in enumerate(zip(rows, antennas, strict=True)):
        two_frames = slice(2 * k, 2 * k + 2)
        lit = np.flatnonzero(ends.amplitude[two_frames].any(axis=0))
        chirp_ends = EchoArrays(*(None if values is None else values[two_frames, lit] for values in ends))  # type: ignore[arg-type]
        value = chirp_ends.amplitude.mean(axis=0).astype(np.complex128)
        per_hz = 0.0 if chirp_ends.slope is None else chirp_ends.slope.mean(axis=0)
        for tx, rx, factor in _heard(radar, row, antenna):
            start, end = chirp_ends.delay_s + _seen_from(chirp_ends, radar, tx, rx)
            for number, sample in enumerate(samples):
                t = sample / radar.sample_rate_hz
                frequency = radar.carrier_hz + radar.slope_hz_per_s * t
                tau = start + (end - start) * (t / radar.sample_times_s[-1])
                cycles = frequency * tau - 0.5 * radar.slope_hz_per_s * tau**2
                whole = value + per_hz * (frequency - radar.mid_frequency_hz)
                out[k, number] += factor * np.sum(whole * np.exp(2j * np.pi * (cycles % 1.0)))
    return out


def between(
    source: Scatterer,
    radar: Radar,
    starts_s: np.ndarray,
    rows: np.ndarray,
    antennas: np.ndarray,
    samples: np.ndarray,
) -> np.ndarray:
    """The `direct_sum` of a scatterer's echoes at surface frames, for chirps that start at `starts_s` [s] after its first frame."""
    out = np.zeros((len(rows), len(samples)), np.complex128)
    step = float(source.times_s[1] - source.times_s[0])
    for k, (start, row, antenna) in enumerate(zip(starts_s, rows, antennas, strict=True)):
        first = int(np.clip(start / step - FRAMES_NEARBY // 2, 0, max(0, len(source.times_s) - FRAMES_NEARBY)))
        part = source.times_s[first : first + FRAMES_NEARBY]
        echoes = _filtered(part, source.frames(first, first + len(part)), radar)
        pick = np.array([start - (part[0] - source.times_s[0])])
        for tx, rx, factor in _heard(radar, row, antenna):
            out[k] += factor * _pair(echoes, radar, pick, tx, rx, samples)[0]
    return out


def _filtered(times_s: np.ndarray, echoes: EchoArrays, radar: Radar) -> Echoes:
    return Echoes(times_s=times_s, **filtered(echoes, radar)._asdict())


def _heard(radar: Radar, row: int, antenna: int) -> list[tuple[int, int, complex]]:
    """The pairs of transmitter and receiver that an antenna of the cube records in a row, each with its phase factor."""
    if radar.multiplexing == "ddm":
        return [(tx, int(antenna), factor) for tx, factor in enumerate(radar.tx_phase(np.array([row]))[0])]
    return [(*divmod(int(antenna), len(radar.rx_offsets_m)), 1.0)]


def _seen_from(echoes: Echoes | EchoArrays, radar: Radar, tx: int, rx: int) -> np.ndarray:
    """Delays of the echoes for one transmitter and one receiver relative to those of the arrays' centres [s], (T, N)."""
    if echoes.departure_m is None:
        return np.zeros(echoes.delay_s.shape)
    arrival_m = echoes.departure_m if echoes.arrival_m is None else echoes.arrival_m
    return (
        _extra_m(echoes.departure_m, radar.tx_position_m, radar.tx_positions_m[tx])
        + _extra_m(arrival_m, radar.rx_position_m, radar.rx_positions_m[rx])
    ) / SPEED_OF_LIGHT


def _pair(echoes: Echoes, radar: Radar, starts: np.ndarray, tx: int, rx: int, samples: np.ndarray) -> np.ndarray:
    """`direct_sum` of one transmitter and one receiver, for chirps that start at `starts` [s]."""
    frames = len(echoes.times_s)
    step = 1 / echoes.rate_hz
    fast_time = radar.sample_times_s[samples]
    delay_s = echoes.delay_s + _seen_from(echoes, radar, tx, rx)
    slopes = np.zeros_like(echoes.amplitude) if echoes.slope is None else echoes.slope
    interpolated = (
        (delay_s, spline_slopes(frames) @ delay_s),
        (echoes.amplitude, central_slopes(echoes.amplitude.astype(np.complex128))),
        (slopes, central_slopes(slopes.astype(np.complex128))),
    )
    cube = np.empty((len(starts), len(fast_time)), np.complex128)
    for row, start in enumerate(starts):
        for sample, t in enumerate(fast_time):
            position = (start + t) / step
            i = min(int(position), frames - 2)
            tau, amplitude, slope = (
                cubic_at(hermite(values[i], values[i + 1], derivative[i], derivative[i + 1]), position - i)
                for values, derivative in interpolated
            )
            frequency = radar.carrier_hz + radar.slope_hz_per_s * t
            amplitude = amplitude + slope * (frequency - radar.mid_frequency_hz)
            cycles = frequency * tau - 0.5 * radar.slope_hz_per_s * tau**2
            cube[row, sample] = np.sum(amplitude * np.exp(2j * np.pi * (cycles % 1.0)))
    return cube


def _extra_m(points: np.ndarray, centre: np.ndarray, antenna: np.ndarray) -> np.ndarray:
    """Distance of points (T, N, 3) from an antenna minus that from the array's centre [m], (T, N)."""
    points = points.astype(np.float64)
    return np.asarray(np.linalg.norm(points - antenna, axis=-1) - np.linalg.norm(points - centre, axis=-1))
