"""Processing along fast time: range FFT and range gates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, flag, instance, integer, interval, shown
from t2d_rt.core.errors import InputError
from t2d_rt.signal.maps import RangeProfile
from t2d_rt.types.radar import Radar

BLOCK = 4096
"""Number of chirps that are processed at once: this limits memory, and lets lazy (zarr) cubes be streamed."""
LONGEST_WINDOW = 10_000_000
MOST_BYTES = 4 * 2**30
"""Greatest memory that one step of the signal processing may need [bytes]."""


def taper(name: str | tuple[str, float], length: int, *, periodic: bool = False) -> np.ndarray:
    """Window divided by its sum, so that a tone of amplitude A reads A in its peak bin, float64 (length,).

    `name` is scipy's ("hann", "boxcar", ("kaiser", 2.5), ...). Symmetric for fast time: its centre, the phase centre
    of the range bins, is exactly mid-sweep. Periodic for slow time: static echoes, on a bin there, leak into no Doppler
    bin beyond the main lobe (a symmetric Hann window of 256 leaks -66 dB). Its centre is sample length/2.
    """
    length, periodic = integer("length of a window", length, 1, LONGEST_WINDOW), flag("periodic", periodic)
    if (
        isinstance(name, str) and name == "hann"
    ):  # importing scipy.signal would take longer than the spectrogram of a short record
        window = np.hanning(length + (periodic and length > 1))[:length]
    else:
        window = _of_scipy(name, length, periodic=periodic)
    if not window.sum() > 0:
        raise InputError(f"window {shown(name)} of {length} samples is zero; take a longer one")
    return window / window.sum()


def _of_scipy(name: str | tuple[str, float], length: int, *, periodic: bool) -> np.ndarray:
    from scipy.signal import get_window

    try:
        if not isinstance(name, (str, tuple)):  # scipy takes a bare number as the beta of a Kaiser window
            raise ValueError
        return np.asarray(get_window(name, length, fftbins=periodic))
    except (ValueError, TypeError, OverflowError, IndexError):
        raise InputError(
            f"unknown window {shown(name)}; choose one of scipy.signal's by name: hann, hamming, blackmanharris, boxcar"
        ) from None


def range_fft(
    adc: Any,
    *,
    window: str | tuple[str, float] = "hann",
    n_fft: int | None = None,
    bins: slice = slice(None),
    block: int = BLOCK,
) -> np.ndarray:
    """Complex range profile [sqrt(W)], (chirp, ..., bin), of ADC samples (chirp, ..., sample).

    A target of power P reads |X|^2 = P in its peak bin when it stands on a bin, down to 1.4 dB less (Hann) between two;
    `n_fft` above the number of samples interpolates. Beats are positive, so all bins are ranges. `bins` keeps a part.
    `adc` is read block by block and may be lazy.
    """
    from scipy import fft

    samples = check_cube(adc)
    if n_fft is not None and integer("n_fft", n_fft, 0, LONGEST_WINDOW) < samples:
        raise InputError(
            f"n_fft must be at least the {samples} samples of a chirp, got {n_fft}; gate the range instead"
        )
    n_fft = samples if n_fft is None else int(n_fft)
    instance("bins", bins, slice, "a slice of the range bins, as `gate` gives")
    block = integer("block", block, 1, LONGEST_WINDOW)
    if n_fft > samples:
        profile_bytes = 8 * math.prod(adc.shape[:-1]) * len(range(*bins.indices(n_fft)))
        at_once = 16 * min(block, adc.shape[0]) * math.prod(adc.shape[1:-1]) * n_fft
        check_size(profile_bytes + at_once, f"a range profile by FFTs of {n_fft} bins", "lower n_fft")
    weights = taper(window, samples)
    blocks = []
    for start in range(0, adc.shape[0], block):
        part = np.asarray(adc[start : start + block])
        part = part * weights.astype(part.real.dtype)
        check_finite(part)
        # A copy, since a view would keep the whole block for a narrow gate.
        blocks.append(fft.fft(part, n_fft, axis=-1, overwrite_x=True, workers=-1)[..., bins].copy())
    return np.concatenate(blocks)


def range_profile(adc: Any, radar: Radar, *, window: str = "hann", n_fft: int | None = None) -> RangeProfile:
    """Range profiles of all chirps, with their axis."""
    check_recording(adc, radar)
    profile = range_fft(adc, window=window, n_fft=n_fft)
    return RangeProfile(
        profile=profile, range_m=radar.range_axis_m(profile.shape[-1]), time_s=radar.chirp_starts_s(len(profile))
    )


def gate(range_m: np.ndarray, limits_m: tuple[float, float] | None) -> slice:
    """Slice of the range bins within `limits_m` (nearest, farthest), for the last axis; all bins for None."""
    range_m = array("range_m", range_m, ("bin",))
    if len(range_m) < 2:
        raise InputError(f"range_m must hold at least 2 range bins, got {len(range_m)}")
    if limits_m is None:
        return slice(0, len(range_m))
    nearest, farthest = interval("range_gate_m", limits_m, unit="m")
    inside = np.flatnonzero((range_m >= nearest) & (range_m <= farthest))
    if not len(inside):
        raise InputError(
            f"range gate {nearest:.6g}..{farthest:.6g} m holds no range bin; bins lie every "
            f"{range_m[1] - range_m[0]:.3g} m from {range_m[0]:.3g} to {range_m[-1]:.3g} m"
        )
    return slice(int(inside[0]), int(inside[-1]) + 1)


@dataclass(frozen=True, slots=True, eq=False)
class RangeGate:
    """The range cells of a radar that are kept, and the window and matrix that compute them."""

    limits_m: tuple[float, float]
    """Nearest and farthest range [m]."""
    bins: slice
    """Indices of the range bins."""
    window: str
    """Name of the range FFT's window."""
    matrix: np.ndarray
    """Weight of each sample in each range cell, complex64 (sample, cell)."""

    @classmethod
    def of(cls, radar: Radar, limits_m: tuple[float, float], window: str = "hann") -> RangeGate:
        """The range cells of a radar within limits, as `range_fft` computes them; raises an InputError where there are none."""
        bins = gate(radar.range_axis_m(), limits_m)
        cycles = np.outer(np.arange(radar.samples), np.arange(bins.start, bins.stop)) % radar.samples / radar.samples
        matrix = taper(window, radar.samples)[:, None] * np.exp(-2j * np.pi * cycles)
        return cls(limits_m, bins, window, matrix.astype(np.complex64))

    @property
    def processing(self) -> dict[str, Any]:
        """Options of `spectrogram` for these range cells."""
        return {"range_gate_m": list(self.limits_m), "range_window": self.window}


def check_recording(adc: Any, radar: Any) -> None:
    """Refuses anything that is no cube, or that this radar cannot have recorded."""
    instance("radar", radar, Radar, "a Radar", hint="Radar.preset('table2') makes one")
    check_cube(adc, radar)


def check_finite(values: np.ndarray) -> None:
    """Refuses samples, or values computed from them, that are NaN or infinite."""
    # The sum is finite only where all values are, and needs no array of its own.
    with np.errstate(all="ignore"):
        total = values.sum()
    if not np.isfinite(total):
        raise InputError("adc must be finite, got NaN, infinite or far too large samples; remove those chirps")


def check_size(size_bytes: int, what: str, remedy: str) -> None:
    """Refuses a step that would need too much memory, before it is tried; `remedy` is the advice in the error."""
    if size_bytes > MOST_BYTES:
        raise InputError(
            f"{what} would take {size_bytes / 1e9:.3g} GB of memory, at most {MOST_BYTES / 1e9:.3g} GB; {remedy}"
        )


def check_cube(adc: Any, radar: Radar | None = None) -> int:
    """Number of samples per chirp of a cube, after checking its shape."""
    if not all(hasattr(adc, name) for name in ("ndim", "shape", "dtype")):
        raise InputError(f"adc must be an array (chirp, antenna, sample), got {shown(adc)}")
    if isinstance(adc, np.ma.MaskedArray):
        raise InputError("adc must not be a masked array: fill or cut what is masked first")
    if adc.ndim not in (2, 3) or 0 in adc.shape:
        raise InputError(f"adc must have shape (chirp, antenna, sample) or (chirp, sample), got {adc.shape}")
    if not np.issubdtype(adc.dtype, np.complexfloating):
        raise InputError(f"adc must be complex (I + jQ), got {adc.dtype}; combine the I and Q channels first")
    if adc.shape[-1] < 2:
        raise InputError(f"adc must have at least 2 samples per chirp, got {adc.shape[-1]}")
    if radar is not None and adc.shape[-1] != radar.samples:
        raise InputError(
            f"adc has {adc.shape[-1]} samples per chirp, the radar {radar.samples}; use the radar that recorded it"
        )
    return int(adc.shape[-1])
