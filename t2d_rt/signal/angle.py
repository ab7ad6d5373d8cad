"""Angles from an antenna array: Doppler spectra of every virtual antenna, steering vectors, range-angle maps.

Directions are in the radar's frame: x boresight, y left, z up; azimuth is positive to the left, elevation upwards.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, choice, flag, instance, interval, number
from t2d_rt.core.errors import InputError
from t2d_rt.signal.doppler import ascending, check_one_burst
from t2d_rt.signal.maps import ArraySpectrum, RangeAngle
from t2d_rt.signal.mti import mti as mti_filter
from t2d_rt.signal.multiplex import check_antennas, separated
from t2d_rt.signal.range import gate, range_fft, taper
from t2d_rt.types.radar import Radar


def array_spectrum(
    adc: Any,
    radar: Radar,
    *,
    range_window: str = "hann",
    doppler_window: str = "hann",
    mti: str = "none",
    compensate_tdm: bool = True,
    n_fft: int | None = None,
) -> ArraySpectrum:
    """Range-Doppler spectrum of every virtual antenna; all chirps of the cube form one coherent interval.

    A target of constant power P and speed reads |X|^2 = P in its peak cell. `mti="mean"` removes static echoes.
    With TDM, transmitter m sends m / PRF after the first, and by then the phase of a moving target has advanced by
    2 pi f_D m / PRF; `compensate_tdm` subtracts this, f_D being the Doppler frequency of each row (physics.md, eq. 18).
    It is exact for speeds within `radar.max_speed_mps`. `n_fft` is the length of the range FFT, `radar.samples` by default.
    """
    from scipy import fft

    check_antennas(adc, radar)
    adc, radar = separated(adc, radar)
    chirps = adc.shape[0]
    check_one_burst(chirps, radar)
    check_static(mti)
    flag("compensate_tdm", compensate_tdm)
    cells = mti_filter(range_fft(adc, window=range_window, n_fft=n_fft), mti)
    cells *= taper(doppler_window, chirps, periodic=True).astype(cells.real.dtype)[:, None, None]
    spectra = fft.fft(cells, axis=0, overwrite_x=True, workers=-1)
    if compensate_tdm and radar.multiplexing == "tdm":
        doppler_hz = np.fft.fftfreq(chirps, radar.loop_interval_s)
        phasor = np.exp(-2j * np.pi * np.outer(doppler_hz, radar.antenna_delays_s))
        spectra *= phasor.astype(spectra.dtype)[:, :, None]
    return ArraySpectrum(
        spectrum=ascending(spectra), velocity_mps=radar.speed_axis_mps(chirps), range_m=radar.range_axis_m(n_fft)
    )


def unit_vectors(azimuth_rad: np.ndarray | float, elevation_rad: np.ndarray | float) -> np.ndarray:
    """Directions (..., 3) in the radar's frame of azimuths and elevations (...)."""
    azimuth, elevation = array("azimuth_rad", azimuth_rad), array("elevation_rad", elevation_rad)
    try:
        azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    except ValueError:
        raise InputError(
            f"azimuth_rad and elevation_rad must have shapes that fit together, got {azimuth.shape} and {elevation.shape}"
        ) from None
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def steering_vectors(radar: Radar, directions: np.ndarray, range_m: np.ndarray | float | None = None) -> np.ndarray:
    """IF phase factors of a point at every virtual antenna relative to the radar's position, complex (..., M N) (eq. 18).

    Exact for a point at `range_m` in each of `directions` (..., 3) in the radar's frame; without a range, for a point in
    the far field. A point of amplitude A is recorded as A times these factors.
    """
    instance("radar", radar, Radar, "a Radar", hint="Radar.preset('table2') makes one")
    directions = array("directions", directions, limit=2)
    if directions.ndim < 1 or directions.shape[-1] != 3:
        raise InputError(f"directions must be unit vectors of shape (..., 3), got {directions.shape}")
    if range_m is not None:
        range_m = array("range_m", range_m, limit=LARGEST_M, unit="m")
        if range_m.shape not in ((), directions.shape[:-1]):
            raise InputError(f"range_m must be one range or of shape {directions.shape[:-1]}, got {range_m.shape}")
    ends = []
    for offsets in (np.array(radar.tx_offsets_m), np.array(radar.rx_offsets_m)):
        if range_m is None:
            excess = -(directions @ offsets.T)
        else:
            distance = np.asarray(range_m, dtype=float)[..., None]
            excess = np.linalg.norm((distance * directions)[..., None, :] - offsets, axis=-1) - distance
        ends.append(np.exp(2j * np.pi / radar.wavelength_m * excess))
    return (ends[0][..., :, None] * ends[1][..., None, :]).reshape(
        *directions.shape[:-1], len(radar.tx_offsets_m) * len(radar.rx_offsets_m)
    )


def range_angle(
    adc: Any,
    radar: Radar,
    *,
    azimuth_rad: np.ndarray | None = None,
    elevation_rad: float = 0.0,
    range_gate_m: tuple[float, float] | None = None,
    speed_gate_mps: tuple[float, float] | None = None,
    range_window: str = "hann",
    doppler_window: str = "hann",
    mti: str = "none",
    compensate_tdm: bool = True,
    far_field: bool = False,
) -> RangeAngle:
    """Range-azimuth map of all chirps of a cube by Bartlett beamforming with exact steering vectors (eq. 19).

    Every Doppler row is steered, powers are added over the rows and divided by the window's noise bandwidth: a target
    of power P reads P at its peak (on a range bin; up to 1.4 dB less between two) whatever its speed.

    azimuth_rad: directions of the beams [rad], positive to the left; by default -pi/2..pi/2 with at least four in a beamwidth.
    elevation_rad: elevation of all beams [rad].
    range_gate_m: nearest and farthest range of the map [m].
    speed_gate_mps: least and greatest speed whose rows are added [m/s], positive = approaching; all by default.
    mti: "mean" removes static echoes.
    compensate_tdm: see `array_spectrum`.
    far_field: plane waves instead of beams focused at each bin's range.
    """
    if azimuth_rad is not None:
        azimuth_rad = array("azimuth_rad", azimuth_rad, ("azimuth",), limit=100, unit="rad")
    elevation_rad = number("elevation_rad", elevation_rad, -100, 100, unit="rad")
    flag("far_field", far_field)
    cells = array_spectrum(
        adc, radar, range_window=range_window, doppler_window=doppler_window, mti=mti, compensate_tdm=compensate_tdm
    )
    if azimuth_rad is None:
        steps = math.ceil(math.pi / beam_step(radar, 1, math.radians(1.0)) / 2)
        azimuth_rad = np.linspace(-math.pi / 2, math.pi / 2, 2 * steps + 1)
    rows = _speed_rows(cells.velocity_mps, speed_gate_mps)
    bins = gate(cells.range_m, range_gate_m)
    range_m = cells.range_m[bins]
    spectrum = np.moveaxis(cells.spectrum[rows, :, bins], -1, 0)  # (range, velocity, antenna)
    directions = unit_vectors(azimuth_rad, elevation_rad)
    weights = steering_vectors(radar, directions)
    power = np.empty((len(range_m), len(directions)))
    for index, (bin_spectrum, distance) in enumerate(zip(spectrum, range_m, strict=True)):
        if not far_field:
            weights = steering_vectors(radar, directions, np.full(len(directions), distance))
        beams = bin_spectrum @ (weights.conj().T / weights.shape[1]).astype(bin_spectrum.dtype)
        power[index] = np.sum(beams.real**2 + beams.imag**2, axis=0)
    slow = taper(doppler_window, len(cells.velocity_mps), periodic=True)
    return RangeAngle(power=power / (len(slow) * float(slow @ slow)), range_m=range_m, azimuth_rad=azimuth_rad)


def beam_step(radar: Radar, axis: int, most: float) -> float:
    """A quarter of the beam's half width lambda / (2 L) in direction cosine along y (1) or z (2), but at most `most`."""
    extent = float(np.ptp(radar.virtual_offsets_m[:, axis]))
    return min(most, radar.wavelength_m / (8 * extent)) if extent else most


def check_static(mti: str) -> None:
    """Refuses filters that change the level of moving targets or need a cut-off."""
    choice("mti of an array's spectrum", mti, ("none", "mean"))


def _speed_rows(velocity_mps: np.ndarray, limits_mps: tuple[float, float] | None) -> slice:
    if limits_mps is None:
        return slice(None)
    limits_mps = interval("speed_gate_mps", limits_mps, unit="m/s")
    inside = np.flatnonzero((velocity_mps >= limits_mps[0]) & (velocity_mps <= limits_mps[1]))
    if not len(inside):
        raise InputError(
            f"speed gate {limits_mps[0]:.6g}..{limits_mps[1]:.6g} m/s holds no Doppler bin; they lie every "
            f"{velocity_mps[1] - velocity_mps[0]:.3g} m/s from {velocity_mps[0]:.3g} to {velocity_mps[-1]:.3g} m/s"
        )
    return slice(int(inside[0]), int(inside[-1]) + 1)
