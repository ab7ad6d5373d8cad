"""From slow time to Doppler: STFT, spectrogram, range-Doppler map; and which samples of a chirp suffice for a sum of powers."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, choice, flag, integer, number, numeric, positive
from t2d_rt.core.cubes import DiskCube, GatedRows, column_sums
from t2d_rt.core.errors import InputError
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.signal.maps import RangeDoppler, Spectrogram
from t2d_rt.signal.mti import METHODS, PAPER_KERNEL
from t2d_rt.signal.mti import mti as mti_filter
from t2d_rt.signal.multiplex import separated
from t2d_rt.signal.range import LONGEST_WINDOW, check_finite, check_recording, check_size, gate, range_fft, taper
from t2d_rt.types.radar import Radar

THINNED, MOST_STEP = 1e-6, 16
"""Greatest |K_D - K| / K(0) of eq. 16a that is accepted, and the greatest step D between the samples that are used."""
ENDS = 1e-7
"""The same for samples that are left out at the ends of a window."""
FINER = 8
"""Number of beat frequencies per range bin at which K is compared."""


def sample_step(adc: Any, window: str, start: int, stop: int) -> int:
    """Greatest step between samples such that the sum of their powers, times the step, is that of all samples within `THINNED`, for
    the chirps start..stop.

    It depends on how far apart beat frequencies lie, which is known for cubes that store products.
    """
    spread = adc.spread(start, stop) if isinstance(adc, DiskCube) else math.inf
    return 1 if math.isinf(spread) else _step_of(window, adc.shape[-1], math.ceil(spread))


@lru_cache(maxsize=256)
def _step_of(window: str, samples: int, spread: int) -> int:
    """The greatest step for beat frequencies within a `spread` [rad from mid-sweep to its end], from K of eq. 16a, here as an FFT
    of the squared window."""
    from scipy import fft

    power, count = taper(window, samples) ** 2, FINER * samples
    apart = math.ceil(
        spread * count / (math.pi * (samples - 1))
    )  # phase that bin k adds over the sweep, from mid-sweep to its end: pi k (samples - 1) / count
    if 2 * apart >= count:
        return 1
    whole = fft.fft(power, count)[: apart + 1]
    for step in range(MOST_STEP, 1, -1):
        thinned = np.zeros(samples)
        thinned[::step] = step * power[::step]
        if np.abs(fft.fft(thinned, count)[: apart + 1] - whole).max() <= THINNED * power.sum():
            return step
    return 1


def weighed(window: np.ndarray) -> slice:
    """The samples of a chirp, without those at both ends whose squared weights add up to less than `ENDS` of all."""
    below = np.cumsum(window**2) < ENDS / 2 * np.sum(window**2)
    above = np.cumsum(window[::-1] ** 2) < ENDS / 2 * np.sum(window**2)
    return slice(int(below.sum()), len(window) - int(above.sum()))


PIECE = 8192
"""Chirps of a long record that are processed at once; fewer for several antennas."""
CELLS = 256
"""Range cells for which the STFT is computed at once."""


@dataclass(frozen=True, slots=True)
class Mti:
    """A filter that removes static echoes: its method and, if the method needs them, its cut-off speed and its kernel."""

    method: str
    cutoff_mps: float
    """Cut-off speed of "highpass" [m/s]; slower echoes are attenuated."""
    kernel: Sequence[float]
    """Weights of neighbouring chirps in "canceller"."""

    @classmethod
    def of(cls, method: str | None, cutoff_mps: float, kernel: Sequence[float]) -> Mti:
        """The filter for the options of a call; None is "none"."""
        return cls(choice("MTI method", "none" if method is None else method, METHODS), cutoff_mps, kernel)

    def filter(self, cells: np.ndarray, radar: Radar) -> np.ndarray:
        """Filters cells (chirp, ...) of a whole record. Bursts are filtered separately, but the mean is that of the record;
        "highpass" refuses a record of several bursts."""
        cutoff_mps = number("cutoff_mps", self.cutoff_mps, unit="m/s")
        if self.method == "highpass" and not 0 < cutoff_mps < radar.max_speed_mps:
            raise InputError(f"cutoff_mps must lie between 0 and {radar.max_speed_mps:.4g} m/s, got {cutoff_mps}")
        cutoff_hz = 2 * cutoff_mps / radar.wavelength_m
        burst = radar.loops_per_frame or len(cells)
        if self.method in ("none", "mean") or burst >= len(cells):
            prf_hz = 1 / radar.loop_interval_s
            return mti_filter(cells, self.method, prf_hz=prf_hz, cutoff_hz=cutoff_hz, kernel=self.kernel)
        if self.method == "highpass":
            raise InputError(
                f"mti='highpass' needs evenly spaced chirps, got bursts of {burst}; use mti='mean' or a radar with "
                "continuous chirps"
            )
        parts = (cells[start : start + burst] for start in range(0, len(cells), burst))
        return np.concatenate([mti_filter(part, self.method, kernel=self.kernel) for part in parts])


def stft(
    series: np.ndarray,
    prf_hz: float,
    *,
    window: str = "hann",
    n_window: int = 256,
    overlap: int = 200,
    n_fft: int | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Short-time spectra along slow time (axis 0) of `series` (chirp, ...).

    Returns spectra [sqrt(W)], complex (frequency, time, ...), the Doppler frequencies [Hz], ascending, and the centres
    of the windows [s] from the first chirp. An approaching target has a negative frequency. A tone of amplitude A reads
    A in its peak bin. `n_window` trades speed resolution lambda PRF/(2 n_window) against time resolution n_window/PRF.
    """
    from scipy import fft

    series = numeric("series", series)
    if series.ndim < 1 or 0 in series.shape:
        raise InputError(f"series must have shape (chirp, ...) with at least one chirp, got {series.shape}")
    if not np.issubdtype(series.dtype, np.inexact):
        series = series.astype(np.float64)
    check_finite(series)
    prf_hz = positive("prf_hz", prf_hz, 1e12, unit="Hz")
    n_window, overlap = integer("n_window", n_window), integer("overlap", overlap)
    n_fft = check_window(n_window, overlap, n_fft, len(series))
    columns = (len(series) - n_window) // (n_window - overlap) + 1
    size = 32 * columns * n_fft * math.prod(series.shape[1:])
    check_size(size, f"an STFT of {columns} windows of {n_fft} bins", "lower n_fft or overlap")
    starts = np.arange(0, len(series) - n_window + 1, n_window - overlap)
    frames = np.lib.stride_tricks.sliding_window_view(series, n_window, axis=0)[starts]  # (time, ..., n_window)
    weights = taper(window, n_window, periodic=True).astype(series.real.dtype)
    spectra = fft.fftshift(fft.fft(frames * weights, n_fft, axis=-1, workers=-1), axes=-1)
    frequency = fft.fftshift(fft.fftfreq(n_fft, 1 / prf_hz))
    return np.moveaxis(spectra, -1, 0), frequency, (starts + n_window / 2) / prf_hz


@dataclass(frozen=True, slots=True)
class FastTime:
    """The processing of the samples of a chirp in a spectrogram, before slow time."""

    window: str
    weights: np.ndarray
    """Weight of each sample, (sample,)."""
    bins: slice
    coherent: bool
    by_samples: bool
    """Whether the powers of all range bins are added; that equals the power of the weighted samples (Parseval), so the range FFT is
    omitted."""

    @classmethod
    def of(cls, radar: Radar, window: str, gate_m: tuple[float, float] | None, combine: str) -> FastTime:
        """The processing that the options of `spectrogram` ask for, checked."""
        bins, weights = gate(radar.range_axis_m(), gate_m), taper(window, radar.samples)
        all_bins = bins == slice(0, radar.samples)
        _check_combine(combine, all_bins, weights)
        return cls(window, weights, bins, combine == "coherent", all_bins and combine == "noncoherent")

    @property
    def bandwidth_bins(self) -> float:
        """Noise bandwidth of the range window [bins], by which a sum of powers is divided; 1 where bins are added before the
        STFT."""
        return 1.0 if self.coherent else len(self.weights) * float(self.weights @ self.weights)

    def cells(self, part: Any, step: int = 1) -> np.ndarray:
        """Range bins of chirps (chirp, ..., bin), or the weighted samples, which have the same total power; `step` says that only
        every `step`-th sample is given."""
        if not self.by_samples:
            return range_fft(part, window=self.window, bins=self.bins)
        # Parseval: the powers of all bins add up to those of the samples, and slow-time processing is the same for both.
        part = np.asarray(part)
        chosen = slice(None, None, step) if step > 1 else weighed(self.weights)
        part = part if step > 1 else part[..., chosen]
        return part * (self.weights[chosen] * np.sqrt(step * len(self.weights))).astype(part.real.dtype)


def spectrogram(
    adc: Any,
    radar: Radar,
    *,
    range_window: str = "hann",
    range_gate_m: tuple[float, float] | None = None,
    mti: str | None = None,
    cutoff_mps: float = 0.1,
    kernel: Sequence[float] = PAPER_KERNEL,
    combine: str = "noncoherent",
    window: str = "hann",
    n_window: int | None = None,
    overlap: int | None = None,
    n_fft: int | None = None,
) -> Spectrogram:
    """Micro-Doppler spectrogram of a cube (chirp, antenna, sample).

    Range FFT, MTI, STFT per range bin, and the bins combined. With "tdm" and "ddm" chirps are loops of the transmitters, which are
    taken apart first. Windows stay inside a burst.

    range_window: window over the samples of a chirp.
    range_gate_m: nearest and farthest range that is used [m], such as [1, 5]; all ranges by default.
    mti: filter that removes static echoes: none, mean, highpass or canceller; by default none, with clutter mean.
    cutoff_mps: speed below which mti highpass filters [m/s].
    kernel: weights of the chirps that mti canceller adds up.
    combine: how range bins are combined. "noncoherent": powers are added and divided by the range window's noise bandwidth, so that
        a target of power P reads P in its peak cell wherever it lies between bins; antennas are averaged. "coherent": complex bins
        are added before the STFT, as Text2Doppler's code does (with range_window boxcar). Neighbouring bins alternate in sign, so
        the level is not calibrated; and the sum over all bins is the chirp's first sample, which a tapered window sets to zero, so
        a range gate is needed.
    window: window over the chirps of a column.
    n_window: number of chirps in a column; 256 by default, with bursts at most one burst.
    overlap: number of chirps that neighbouring columns have in common; 200 of 256 by default.
    n_fft: number of Doppler bins; n_window by default.
    """
    clutter_filter, windows = Mti.of(mti, cutoff_mps, kernel), (n_window, overlap, n_fft)
    options: dict[str, Any] = {
        "range_window": range_window,
        "range_gate_m": range_gate_m,
        "combine": combine,
        "window": window,
    }
    return _spectrograms([adc], radar, mti=clutter_filter, windows=windows, **options)[0]


def part_spectrograms(parts: Sequence[Any], radar: Radar, **options: Any) -> list[Spectrogram]:
    """Power that each of the cubes adds to the spectrogram of their sum [W]; options are those of `spectrogram`.

    With S_p the short-time spectrum of a part and S that of the sum, it is Re(S_p S*): of what two parts have in common by
    interference each has half. All of them add up to |S|^2, and that of a part which lowers the sum is negative.
    """
    settings = _defaults() | options
    settings["mti"] = Mti.of(settings["mti"], settings.pop("cutoff_mps"), settings.pop("kernel"))
    windows = settings.pop("n_window"), settings.pop("overlap"), settings.pop("n_fft")
    return _spectrograms(parts, radar, windows=windows, **settings)


def _defaults() -> dict[str, Any]:
    return {name: parameter.default for name, parameter in [*inspect.signature(spectrogram).parameters.items()][2:]}


def _spectrograms(
    cubes: Sequence[Any], radar: Radar, *, range_window: str, range_gate_m: tuple[float, float] | None, mti: Mti, combine: str,
    window: str, windows: tuple[int | None, int | None, int | None],
) -> list[Spectrogram]:  # fmt: skip
    """Contribution of each of some cubes of the same shape to the spectrogram of their sum; `windows` are n_window, overlap and
    n_fft."""
    for cube in cubes:
        check_recording(cube, radar)
    pairs = [separated(cube, radar) for cube in cubes]
    cubes, radar = [cube for cube, _ in pairs], pairs[0][1]
    adc = cubes[0]
    fast = FastTime.of(radar, range_window, range_gate_m, combine)
    burst = radar.loops_per_frame or adc.shape[0]
    n_window, overlap, n_fft = checked_windows(radar, adc.shape[0], *windows)
    starts = window_starts(adc.shape[0], burst, n_window, n_window - overlap)

    antennas = 1 if adc.ndim == 2 else adc.shape[1]
    slow = taper(window, n_window, periodic=True)
    powers = []

    cells_of: Callable[[Any], np.ndarray] = fast.cells
    step_of = None
    if isinstance(adc, DiskCube) and isinstance(adc.rows, GatedRows):
        cubes, cells_of = [_gated_cells(adc.rows, fast)], np.array  # copies, because MTI subtracts in place
    elif fast.by_samples and len(cubes) == 1 and mti.method == "none":
        step_of = partial(sample_step, adc, range_window)
    elif fast.by_samples and len(cubes) > 1:  # one step for all cubes, because their beats interfere with one another
        step = _common_step(cubes, range_window)
        cubes = cubes if step == 1 else [_Thinned(cube, step) for cube in cubes]
        cells_of = partial(fast.cells, step=step)
    pieces = [filtered(cube, radar, starts, n_window, cells_of, mti, step_of) for cube in cubes]
    for together in zip(*pieces, strict=True):
        first, columns, _ = together[0]
        parts = [cells.sum(axis=-1, keepdims=True) if fast.coherent else cells for *_, cells in together]
        powers.append(_summed_powers([part.reshape(len(part), -1) for part in parts], columns - first, slow, n_fft))
    power = np.concatenate(powers, axis=2)
    check_finite(power)
    axes = {
        "velocity_mps": radar.speed_axis_mps(n_fft),
        "time_s": radar.chirp_starts_s(adc.shape[0])[starts] + n_window / 2 * radar.loop_interval_s,
    }
    return [Spectrogram(power=ascending(part_power / (fast.bandwidth_bins * antennas)), **axes) for part_power in power]


def _common_step(cubes: Sequence[Any], window: str) -> int:
    """Step between samples for the sum of some cubes over the whole record, from the greatest distance of any two beat
    frequencies."""
    if not all(isinstance(cube, DiskCube) and isinstance(cube.rows, ProductRows) for cube in cubes):
        return 1
    return sample_step(DiskCube(ProductRows.sum_of([cube.rows for cube in cubes])), window, 0, len(cubes[0]))


def _gated_cells(rows: GatedRows, fast: FastTime) -> np.ndarray:
    """The range cells that a recording kept, if they are those of the gate and window asked for; refuses others."""
    if (rows.bins, rows.window) != (fast.bins, fast.window):
        raise InputError(
            f"this recording keeps range cells {rows.bins.start}..{rows.bins.stop - 1} by window {rows.window!r} alone; "
            "simulate it without a range gate"
        )
    return rows.cells


class _Thinned:
    """Every `step`-th sample of the chirps of a cube on disk."""

    ndim = 3

    def __init__(self, cube: DiskCube, step: int) -> None:
        self._cube, self._step, self.dtype = cube, step, cube.dtype
        self.shape = (*cube.shape[:2], len(range(0, cube.shape[2], step)))

    def __getitem__(self, chirps: slice) -> np.ndarray:
        start, stop, _ = chirps.indices(self.shape[0])
        return self._cube.every(start, stop, self._step)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self[:], dtype)


def check_names(processing: Mapping[str, Any]) -> None:
    """Refuses names that are not options of `spectrogram`."""
    options = _defaults()
    unknown = [name for name in processing if name not in options]
    if unknown:
        raise InputError(f"unknown spectrogram option {unknown[0]!r}; choose from {', '.join(options)}")


def check_processing(radar: Radar, chirps: int, processing: Mapping[str, Any]) -> None:
    """Refuses options of `spectrogram` that cannot be used for a record of so many chirps, before there is one."""
    rows = chirps // len(radar.tx_offsets_m) if radar.multiplexing == "ddm" else chirps
    options = _defaults() | dict(processing)
    gate(radar.range_axis_m(), options["range_gate_m"])
    taper(options["range_window"], radar.samples)
    choice("MTI method", "none" if options["mti"] is None else options["mti"], METHODS)
    number("cutoff_mps", options["cutoff_mps"], unit="m/s")
    array("kernel", options["kernel"], ("tap",))
    choice("combine", options["combine"], ("noncoherent", "coherent"))
    n_window, *_ = checked_windows(radar.separated, rows, options["n_window"], options["overlap"], options["n_fft"])
    taper(options["window"], n_window, periodic=True)


def range_doppler(
    adc: Any, radar: Radar, *, range_window: str = "hann", doppler_window: str = "hann", correct_coupling: bool = False
) -> RangeDoppler:
    """Range-Doppler map of all chirps of a cube as one coherent interval; a target of power P reads P in its peak cell.

    Powers of the antennas are averaged. `correct_coupling` moves every speed's row by f v / S, so that movers stand at
    their true range at mid-sweep (without, one approaching at v stands f v / S short). The record must be continuous.
    """
    from scipy import fft

    check_recording(adc, radar)
    flag("correct_coupling", correct_coupling)
    adc, radar = separated(adc, radar)
    chirps = adc.shape[0]
    check_one_burst(chirps, radar)
    cube = np.asarray(adc)
    real = cube.real.dtype
    slow = taper(doppler_window, chirps, periodic=True).astype(real).reshape(-1, *[1] * (cube.ndim - 1))
    spectra = fft.fft(cube * slow, axis=0, overwrite_x=True, workers=-1)
    if correct_coupling:
        # The Doppler shift of the beat frequency is removed from the samples of each row, so that nothing is interpolated.
        doppler_hz = fft.fftfreq(chirps, radar.loop_interval_s)
        phasor = np.exp(-2j * np.pi * np.outer(doppler_hz, radar.sample_times_s)).astype(cube.dtype)
        spectra *= phasor.reshape(chirps, *[1] * (cube.ndim - 2), -1)
    spectra = fft.fft(spectra * taper(range_window, radar.samples).astype(real), axis=-1, overwrite_x=True, workers=-1)
    with np.errstate(over="ignore"):
        power = spectra.real**2 + spectra.imag**2
    check_finite(power)
    if power.ndim == 3:
        power = power.mean(axis=1)
    return RangeDoppler(power=ascending(power), velocity_mps=radar.speed_axis_mps(chirps), range_m=radar.range_axis_m())


def check_one_burst(chirps: int, radar: Radar) -> None:
    """Refuses chirps that are not of a single burst, as dead time lies between bursts."""
    if radar.loops_per_frame is not None and chirps > radar.loops_per_frame:
        raise InputError(
            f"a range-Doppler map needs evenly spaced chirps, got {chirps} in bursts of {radar.loops_per_frame}; "
            "give the chirps of one burst"
        )


def ascending(power: np.ndarray) -> np.ndarray:
    """Axis 0 from FFT order to ascending speed; it is flipped, for speed has the opposite sign of the Doppler frequency."""
    return np.ascontiguousarray(np.fft.fftshift(power, axes=0)[::-1])


def _summed_powers(parts: Sequence[np.ndarray], starts: np.ndarray, weights: np.ndarray, n_fft: int) -> np.ndarray:
    """Sums over range cells of Re(S_p S*), (part, n_fft, time) in FFT order: S_p is the short-time spectrum of a part (chirp,
    cell), S that of the sum of all parts. For a single part this is its power.

    Some cells are processed at a time, window after window: overlapping windows stay in cache, and the FFT along axis 0 handles
    many cells at once.
    """
    from scipy import fft

    dtype, real = parts[0].dtype, parts[0].real.dtype
    columns = np.ascontiguousarray(weights.astype(real)[:, None])
    power = np.zeros((len(parts), len(starts), n_fft), dtype=real)
    # Real and imaginary parts alternate, as the weights are real.
    real_parts = [np.ascontiguousarray(part).view(real) for part in parts]

    def run(chunk: np.ndarray) -> None:
        for first in range(0, real_parts[0].shape[1], 2 * CELLS):
            cells = [part[:, first : first + 2 * CELLS] for part in real_parts]
            for index in chunk:
                cut = slice(starts[index], starts[index] + len(weights))
                weighted = [(part[cut] * columns).view(dtype) for part in cells]
                spectra = [fft.fft(part, n_fft, axis=0, overwrite_x=True).view(real) for part in weighted]
                whole = spectra[0] if len(spectra) == 1 else np.sum(spectra, axis=0)
                for into, spectrum in zip(power, spectra, strict=True):
                    into[index] += np.vecdot(spectrum, whole)

    threads = min(os.cpu_count() or 1, len(starts))
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, np.array_split(np.arange(len(starts)), threads)))
    return power.swapaxes(1, 2)


def _check_combine(combine: str, all_bins: bool, fast: np.ndarray) -> None:
    """Refuses an unknown way to combine range bins, and a coherent sum that the window sets to zero."""
    choice("combine", combine, ("noncoherent", "coherent"))
    if combine == "coherent" and all_bins and fast[0] < 1e-3 * fast.mean():
        raise InputError(
            "the coherent sum over all range bins is the chirp's first sample, which this range window sets to zero; "
            "give range_gate_m, or range_window='boxcar'"
        )


def filtered(
    adc: Any,
    radar: Radar,
    starts: np.ndarray,
    n_window: int,
    cells_of: Callable[..., np.ndarray],
    mti: Mti,
    step_of: Callable[[int, int], int] | None = None,
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Cells after MTI, piece by piece: the first chirp of each piece, the starts of the windows in it, and the cells.

    Only "highpass" and "canceller" hold the whole record in memory. `step_of` chooses the step between samples for some chirps,
    which is passed on to `cells_of`.
    """
    piece = max(PIECE // (1 if adc.ndim == 2 else adc.shape[1]), 8 * n_window)
    if adc.shape[0] <= piece or mti.method not in ("none", "mean"):
        yield 0, starts, mti.filter(cells_of(adc), radar)
        return
    # Range processing is linear, so the mean of the cells is that of the mean chirp.
    steady = None
    if mti.method == "mean":
        chirp = np.zeros((1, *adc.shape[1:]), np.complex128)
        for start in range(0, adc.shape[0], piece):
            chirp += column_sums(np.asarray(adc[start : start + piece])) / adc.shape[0]
        steady = cells_of(chirp).astype(adc.dtype)
    pieces = np.split(starts, np.flatnonzero(np.diff(starts // piece)) + 1)

    def moving(windows: np.ndarray) -> np.ndarray:
        first, last = int(windows[0]), int(windows[-1]) + n_window
        step = 1 if step_of is None else step_of(first, last)
        cells = cells_of(adc[first:last]) if step == 1 else cells_of(adc.every(first, last, step), step)
        if steady is not None:
            cells -= steady
        return cells

    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(moving, pieces[0])
        for windows, following in zip(pieces, [*pieces[1:], None], strict=True):
            cells = coming.result()
            if following is not None:
                coming = pool.submit(moving, following)
            yield int(windows[0]), windows, cells


def checked_windows(
    radar: Radar, chirps: int, n_window: int | None, overlap: int | None, n_fft: int | None
) -> tuple[int, int, int]:
    """Checked window, overlap and FFT length of a spectrogram of so many chirps; refuses those that do not fit a burst, the record
    or memory."""
    burst = radar.loops_per_frame or chirps
    n_window = min(256, burst) if n_window is None else integer("n_window", n_window, 2)
    if radar.loops_per_frame is not None and n_window > burst:
        raise InputError(
            f"an STFT window of {n_window} chirps does not fit into a burst of {burst}, and windows do not reach from burst to "
            f"burst; set n_window to {burst} or less, or use a radar with continuous chirps such as table2"
        )
    if n_window > chirps:
        raise InputError(
            f"record of {chirps} chirps is shorter than the STFT window of {n_window}; record longer or set n_window "
            "lower"
        )
    overlap = n_window * 200 // 256 if overlap is None else integer("overlap", overlap)
    n_fft = check_window(n_window, overlap, n_fft, burst)
    columns = len(window_starts(chirps, burst, n_window, n_window - overlap))
    # Powers, twice while they are reordered, and the spectra of each thread.
    size = 16 * columns * n_fft + 24 * min(os.cpu_count() or 1, columns) * CELLS * n_fft
    check_size(size, f"a spectrogram of {columns} columns of {n_fft} bins", "lower n_fft or overlap")
    return n_window, overlap, n_fft


def window_starts(chirps: int, burst: int, n_window: int, hop: int) -> np.ndarray:
    """First chirps of all windows that lie within one burst and within the record."""
    within = np.arange(0, burst - n_window + 1, hop)
    starts = (np.arange(0, chirps, burst)[:, None] + within).ravel()
    return starts[starts + n_window <= chirps]


def check_window(n_window: int, overlap: int, n_fft: int | None, chirps: int) -> int:
    """The FFT length, after checking window and overlap."""
    if not 2 <= n_window <= chirps:
        raise InputError(f"n_window must lie in 2..{chirps} (the chirps there are), got {n_window}")
    if not 0 <= overlap < n_window:
        raise InputError(f"overlap must lie in 0..{n_window - 1} (below n_window), got {overlap}")
    n_fft = n_window if n_fft is None else integer("n_fft", n_fft, 0, LONGEST_WINDOW)
    if n_fft < n_window:
        raise InputError(f"n_fft must be at least n_window ({n_window}), got {n_fft}")
    return n_fft
