"""Separates the transmitters of a cube, so that it holds one channel for each virtual antenna (docs/physics.md, eq. 18)."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.signal.range import check_recording
from t2d_rt.types.radar import Radar


def separate_ddm(adc: Any, radar: Radar) -> np.ndarray:
    """Virtual antennas of a "ddm" cube: (chirp, N, sample) to (chirp / M, M N, sample), the cube of `radar.separated`.

    Each transmitter's part of the Doppler spectrum is moved to zero, its band of PRF / M kept, and every M-th chirp
    of that returned: what an ideal radar with a PRF of PRF / M would have recorded. Echoes faster than
    `radar.max_speed_mps` fall into another transmitter's band; of slower ones, what a record's ends spread over the
    Doppler axis does too, at -40 dB and only at the edges of the bands once a window is applied. Bursts are separated one
    by one.
    """
    from scipy import fft

    check_antennas(adc, radar)
    transmitters = len(radar.tx_offsets_m)
    if radar.multiplexing != "ddm":
        raise InputError(f"only a cube with multiplexing='ddm' is separated, this radar's is '{radar.multiplexing}'")
    chirps = adc.shape[0]
    burst = chirps if radar.loops_per_frame is None else min(radar.loops_per_frame, chirps)
    if burst % transmitters or chirps % burst:
        whole = chirps // burst * burst if chirps % burst else chirps // transmitters * transmitters
        raise InputError(
            f"the Doppler bands of {transmitters} transmitters need whole loops of {transmitters} chirps and whole bursts, "
            f"got {chirps} chirps; give the first {whole}"
        )
    loops = burst // transmitters
    cube = np.asarray(adc).reshape(-1, burst, *adc.shape[1:])
    spectra = fft.fft(cube, axis=1, workers=-1) / transmitters
    band = np.rint(np.fft.fftfreq(loops, 1 / loops)).astype(int)
    parts = [
        fft.ifft(spectra[:, (band - transmitter * loops) % burst], axis=1, overwrite_x=True, workers=-1)
        for transmitter in range(transmitters)
    ]
    return np.concatenate(parts, axis=2).reshape(chirps // transmitters, -1, radar.samples)


def separated(adc: Any, radar: Radar) -> tuple[Any, Radar]:
    """The cube with its transmitters separated where that is needed ("ddm"), and its radar."""
    return (separate_ddm(adc, radar), radar.separated) if radar.multiplexing == "ddm" else (adc, radar)


def check_antennas(adc: Any, radar: Radar) -> None:
    """Refuses a cube that does not hold all antennas of the radar."""
    check_recording(adc, radar)
    check_axes(adc.shape, radar)


def check_axes(shape: tuple[int, ...], radar: Radar) -> None:
    """Refuses a cube whose axes are not the chirps, antennas and samples of that radar; the error names an order of axes that would
    fit, if there is one."""
    antennas, samples = radar.antennas, radar.samples
    orders = permutations(range(3)) if len(shape) == 3 else ()
    fitting = [order for order in orders if (shape[order[1]], shape[order[2]]) == (antennas, samples)]
    if (0, 1, 2) in fitting:
        return
    advice = ""
    if fitting:
        names = (("chirp", "antenna", "sample")[fitting[0].index(axis)] for axis in range(3))
        advice = f"; axes ({', '.join(names)})? give cube.transpose{fitting[0]}"
    elif len(shape) == 3 and (shape[1] * radar.loop_chirps, shape[2]) == (antennas, samples):
        advice = f"; chirps of {radar.loop_chirps} transmitters in turn? give cube.reshape(-1, {antennas}, {samples})"
    if len(shape) != 3 or shape[2] != samples:
        raise InputError(f"an ADC cube must have shape (chirp, antenna, {samples}), got {shape}{advice}")
    raise InputError(
        f"an ADC cube must have the antennas of its radar: the radar has {antennas} antennas, not {shape[1]}"
        f"{advice or '; give the radar that recorded it'}"
    )
