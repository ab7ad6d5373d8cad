"""The parts of a recording as a page shows them: their levels in each cell, how they add up, and which part of the scene they
are."""

from __future__ import annotations

import inspect
import itertools
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.backend import one_blas_thread
from t2d_rt.core.constants import decibel
from t2d_rt.core.cubes import DiskCube, column_sums
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.pipeline import parts as labels
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.signal.doppler import (
    PIECE,
    FastTime,
    checked_windows,
    sample_step,
    spectrogram,
    window_starts,
)
from t2d_rt.signal.range import taper
from t2d_rt.types import Ellipsoids, Radar

if TYPE_CHECKING:
    from t2d_rt.recording.recording import Recording

MOST_PARTS = 22
"""Greatest number of parts on a page; if there are more, the strongest ones are shown and the rest of the recording as one part."""
COLUMNS_OF_PARTS = 2800
"""Greatest number of columns of all parts together; for long records this is less than the spectrogram has."""
LEVELS_DB = 80.0
"""Levels are stored down to this far below the strongest cell of all [dB]."""
SHOWN_DB, APART_DB = 80.0, 50.0
"""Products of two parts are stored where both are this close to the strongest cell, and this close to one another [dB]."""
SAMPLED, EVERY = 24, 16
"""The strongest parts are found at so many instants, from every n-th sample."""
NONE = 255
"""Index that stands for no part."""
COLOURS = (
    "#ff6b6b", "#4fc3f7", "#ffe119", "#3cb44b", "#f58231", "#b07cff", "#42d4b0", "#f032e6", "#bfef45", "#fabed4", "#7d9bff",
    "#d2a679", "#1fc7c7", "#ff8f80", "#a9a957", "#9fb6ff", "#ff5fb0", "#7fbf7f", "#ffd8b1", "#aaffc3", "#b79be0", "#e0c341",
)  # fmt: skip
"""Colours of the parts in order; neighbours are far apart."""
SEGMENT_COLOURS = {
    "head": "#f4f4f4", "neck": "#c9b8d6", "chest": "#9a8cff", "abdomen": "#6f79d8", "pelvis": "#c77dff",
    "left_upper_arm": "#d7ccb0", "left_forearm": "#c2a878", "left_hand": "#fff3b0",
    "right_upper_arm": "#a8d8d8", "right_forearm": "#5fb3b3", "right_hand": "#b8fff2",
    "left_thigh": "#ff9ec4", "left_shank": "#f0412e", "left_foot": "#ff8c42",
    "right_thigh": "#a6e88f", "right_shank": "#22c55e", "right_foot": "#56b4e9",
}  # fmt: skip
"""Colours of a body's segments: warm colours for the left leg, cold ones for the right."""
REST = "#8a8f98"
"""Colour of the rest, and of static things."""


def parts_shown(recording: Recording, spectrogram: dict[str, Any]) -> dict[str, Any] | None:
    """Levels and products of a recording's parts in the rows of a page's `spectrogram`, at some of its columns; None without parts.

    A sum of parts has the power sum_p P_p + 2 sum_p<q r_pq sqrt(P_p P_q), where r_pq is the correlation of two parts.
    """
    cubes = recording.parts.cubes
    if not cubes:
        return None
    processing, radar = {**recording.processing, "mti": recording._mti}, recording.radar
    if processing["mti"] not in ("none", "mean") or radar.multiplexing == "ddm":
        kind = "separated Doppler bands" if radar.multiplexing == "ddm" else f"mti={processing['mti']}"
        return {"why": f"Its parts are not shown, as those of a recording with {kind}; simulate or process it without."}
    with one_blas_thread:
        names, shown_cubes = _strongest(cubes, fixed=processing["mti"] == "mean")
        left_out = len(cubes) - len(names)
        whole = [recording.cube] if left_out else []
        image = recording.spectrogram
        rows = _rows(image.velocity_mps.values, spectrogram["y"])
        most = max(1, COLUMNS_OF_PARTS // (len(shown_cubes) + len(whole)))
        spectra = SpectraOfParts.of([*shown_cubes, *whole], radar, rows, most, processing)
        work = partial(_column, spectra, whole=bool(whole))
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            columns = list(pool.map(work, range(len(spectra.starts))))
    if left_out:
        noise = " and the receiver's noise" if recording.settings.get("noise") else ""
        names = [*names, f"{left_out} others{noise}"]
    times_s = spectra.time_s
    image_db = image.values[rows][:, np.searchsorted(image.time_s.values, times_s - 1e-9)]
    products = np.stack([column_products for column_products, _ in columns], axis=-1)  # (part, part, row, column)
    parts = {
        "names": names,
        "others": left_out,
        "x": {"of": "time", "first": float(times_s[0]), "last": float(times_s[-1]), "count": len(times_s)},
        "y": spectrogram["y"],
        **_levels(products, image_db),
    }
    ranges, speeds, powers = np.stack([column_peaks for _, column_peaks in columns], axis=-1)  # each (part, column)
    return parts | {"ranges": ranges, "speeds": speeds, "peaks_db": decibel(powers).astype(np.float32)}


def _strongest(cubes: dict[str, DiskCube], *, fixed: bool) -> tuple[list[str], list[DiskCube]]:
    """At most `MOST_PARTS` parts, in their order: those with the greatest energy, from which the mean chirp is removed if
    `fixed`."""
    if len(cubes) <= MOST_PARTS + 1:
        return list(cubes), list(cubes.values())
    count = len(next(iter(cubes.values())))
    energy = {}
    for name, cube in cubes.items():
        starts = np.linspace(0, max(0, count - 8), SAMPLED).astype(int).tolist()
        samples = np.concatenate([cube.every(first, first + 8, EVERY) for first in starts])
        energy[name] = float(np.square(np.abs(samples - samples.mean(axis=0) * fixed)).sum())
    best = set(sorted(energy, key=lambda name: -energy[name])[:MOST_PARTS])
    return [name for name in cubes if name in best], [cube for name, cube in cubes.items() if name in best]


def _rows(velocity_mps: np.ndarray, axis: dict[str, Any]) -> slice:
    first = int(np.abs(velocity_mps - axis["first"]).argmin())
    return slice(first, first + int(axis["count"]))


def _column(spectra: SpectraOfParts, column: int, *, whole: bool) -> tuple[np.ndarray, np.ndarray]:
    """Powers of the parts and products of each pair of them [W], float32 (part, part, row), and their peaks (3, part)."""
    cells = spectra.at(column)
    if whole:  # the last cube is the whole, which is replaced by the rest
        cells[-1] -= cells[:-1].sum(axis=0)
    flat = np.ascontiguousarray(cells.reshape(*cells.shape[:2], -1).swapaxes(0, 1)).view(np.float32)
    peaks = spectra.peaks(column, cells) if spectra.fast.by_samples else np.full((3, len(cells)), np.nan, np.float32)
    return np.moveaxis(flat @ flat.swapaxes(1, 2), 0, -1), peaks


def _levels(products: np.ndarray, whole_db: np.ndarray) -> dict[str, Any]:
    """Levels in 16 bits, and products of pairs of parts where they matter, cell by cell, as numbers from 1 to 65535 for -1..1."""
    powers = np.einsum("iijk->ijk", products)
    levels_db, amplitudes = decibel(powers), np.sqrt(powers, dtype=float)
    peak = max(float(levels_db.max()), float(whole_db.max()))
    counts = np.zeros(whole_db.shape, np.uint32)
    cells, pairs = [np.zeros(0, int)], [np.zeros((3, 0))]
    for first, second in itertools.combinations(range(len(products)), 2):
        low, high = np.minimum(levels_db[first], levels_db[second]), np.maximum(levels_db[first], levels_db[second])
        matters = (low > peak - SHOWN_DB) & (high - low < APART_DB)
        place = np.flatnonzero(matters)
        common = products[first, second].ravel()[place] / (amplitudes[first] * amplitudes[second]).ravel()[place]
        counts += matters
        cells.append(place)
        pairs.append(np.stack([np.full(len(place), first), np.full(len(place), second), 32767 * common + 32768]))
    one, other, common = np.concatenate(pairs, axis=1)[:, np.argsort(np.concatenate(cells), kind="stable")]
    return {
        "low_db": peak - LEVELS_DB,
        "high_db": peak,
        "levels": _in_16_bits(levels_db, peak),
        "whole": _in_16_bits(whole_db, peak),
        "counts": counts,
        "one": one.astype(np.uint8),
        "other": other.astype(np.uint8),
        "common": np.round(common.clip(1, 65535)).astype(np.uint16),
    }


def _in_16_bits(levels_db: np.ndarray, peak_db: float) -> np.ndarray:
    """Levels as 16-bit numbers: 0 at `LEVELS_DB` below the peak or less, 65535 at the peak."""
    return np.round(np.clip(levels_db - peak_db + LEVELS_DB, 0, LEVELS_DB) * (65535 / LEVELS_DB)).astype(np.uint16)


def coloured(splits: Sequence[dict[str, Any]]) -> None:
    """Assigns colours (part, 3) to the parts of a page's recordings: fixed ones to a body's segments, others in turn."""
    names = list(dict.fromkeys(name for split in splits for name in split["names"]))
    segments = [name.rpartition(": ")[2] for name in names]
    colours = dict.fromkeys((labels.STATIC, labels.BETWEEN, labels.UNLABELLED), REST)
    colours |= {split["names"][-1]: REST for split in splits if split["others"]}
    if len(set(segments)) == len(names):
        named_segments = zip(names, segments, strict=True)
        colours |= {name: SEGMENT_COLOURS[segment] for name, segment in named_segments if segment in SEGMENT_COLOURS}
    free = itertools.cycle(COLOURS)
    colours |= {name: next(free) for name in names if name not in colours}
    for split in splits:
        codes = [colours[name] for name in split["names"]]
        split["colours"] = np.array([[int(code[k : k + 2], 16) for k in (1, 3, 5)] for code in codes], np.uint8)


def tints(model: Model, number: int, names: Sequence[str]) -> np.ndarray:
    """Index of the part of each vertex of a target, by its segment, its piece or the whole target; `NONE` where it has none."""
    geometry = model.geometries[number]
    solid, place = geometry.solid(), {name: k for k, name in enumerate(names)}
    by_ellipsoid = isinstance(geometry, Ellipsoids)
    target, parts = labels.PartNames("segment", model).of_target(number, ellipsoids=by_ellipsoid)
    owner_of_vertex = np.full(solid.vertices, place.get(target, NONE), np.uint8)
    owners = np.array([place.get(name, owner_of_vertex[0]) for name in parts], np.uint8)
    if by_ellipsoid:
        return np.repeat(owners, solid.vertices // len(owners)) if len(owners) else owner_of_vertex
    if len(owners) == len(solid.faces):
        owner_of_vertex[solid.faces] = owners[:, None]
    return owner_of_vertex


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectraOfParts:
    """Short-time spectra of cubes that add up to a whole, at some columns of the spectrogram; complex, so that they can be
    added."""

    cubes: Sequence[Any]
    radar: Radar
    fast: FastTime
    starts: np.ndarray
    """First chirps of the columns' windows, (column,)."""
    transform: np.ndarray
    """Window and Fourier transform to the speeds that are shown, complex64 (velocity, chirp)."""
    step: int
    """Only every `step`-th sample is read. Powers of single cubes are exact with it, products of two nearly so."""
    means: np.ndarray | None
    """Mean chirps, (cube, antenna, sample), where MTI removes them; else None."""
    velocity_mps: np.ndarray
    """Speeds of the rows [m/s], (velocity,)."""

    @classmethod
    def of(
        cls, cubes: Sequence[Any], radar: Radar, rows: slice, most: int, processing: Mapping[str, Any]
    ) -> SpectraOfParts:
        """Spectra at `most` columns and some rows of the spectrogram with options `processing`; mti must be none or mean, and the
        radar not use "ddm"."""
        chosen = {name: parameter.default for name, parameter in inspect.signature(spectrogram).parameters.items()}
        chosen |= dict(processing)
        radar, chirps = radar.separated, len(cubes[0])
        fast = FastTime.of(radar, chosen["range_window"], chosen["range_gate_m"], chosen["combine"])
        n_window, overlap, n_fft = checked_windows(
            radar, chirps, chosen["n_window"], chosen["overlap"], chosen["n_fft"]
        )
        starts = window_starts(chirps, radar.loops_per_frame or chirps, n_window, n_window - overlap)
        most_step = (
            min(sample_step(cube, chosen["range_window"], 0, chirps) for cube in cubes) if fast.by_samples else 1
        )
        step = max(divisor for divisor in range(1, most_step + 1) if radar.samples % divisor == 0)
        cycles = np.outer(np.fft.fftshift(np.fft.fftfreq(n_fft))[::-1][rows], np.arange(n_window))  # ascending speed
        weights = taper(chosen["window"], n_window, periodic=True) / math.sqrt(fast.bandwidth_bins * cubes[0].shape[1])
        return cls(
            cubes=cubes,
            radar=radar,
            fast=fast,
            starts=starts[:: math.ceil(len(starts) / most)],
            transform=(weights * np.exp(-2j * np.pi * cycles)).astype(np.complex64),
            step=step,
            means=np.stack([mean_chirp(cube) for cube in cubes]) if chosen["mti"] == "mean" else None,
            velocity_mps=radar.speed_axis_mps(n_fft)[rows],
        )

    @property
    def time_s(self) -> np.ndarray:
        """Times of the columns [s], (column,)."""
        half_s = self.transform.shape[1] / 2 * self.radar.loop_interval_s
        return self.radar.chirp_starts_s(len(self.cubes[0]))[self.starts] + half_s

    def at(self, column: int) -> np.ndarray:
        """Spectra [sqrt(W)] (cube, velocity, antenna, cell) of one column; the powers of all cells add up to that of the
        spectrogram."""
        start, count, spectra_of_cubes = int(self.starts[column]), self.transform.shape[1], []
        steady = self.transform.sum(axis=1)[:, None, None]
        for place, cube in enumerate(self.cubes):
            if isinstance(cube, DiskCube):
                mixed = cube.mixed(self.transform, start, self.step)
            else:
                mixed = np.tensordot(self.transform, cube[start : start + count, :, :: self.step], 1)
            if self.means is not None:
                mixed -= steady * self.means[place, :, :: self.step]
            cells = self.fast.cells(mixed, self.step)
            spectra_of_cubes.append(cells.sum(axis=-1, keepdims=True) if self.fast.coherent else cells)
        return np.stack(spectra_of_cubes)

    def peaks(self, column: int, spectra: np.ndarray) -> np.ndarray:
        """Range [m], speed [m/s] and power [W] of the strongest cell of each cube in the range-Doppler map at a column, (3, cube);
        NaN for cubes that are stored as samples. All bins must be used (`fast.by_samples`)."""
        from scipy import fft

        start, count = int(self.starts[column]), self.radar.samples // self.step
        maps = fft.fft(spectra, count, axis=-1)
        powers = (maps.real**2 + maps.imag**2).sum(axis=2) * (self.step * self.fast.bandwidth_bins / self.radar.samples)
        strongest = np.full((3, len(self.cubes)), np.nan, np.float32)
        for number, (cube, power) in enumerate(zip(self.cubes, powers, strict=True)):
            if isinstance(cube, DiskCube) and isinstance(cube.rows, ProductRows):
                row, place = np.unravel_index(power.argmax(), power.shape)
                if self.step > 1:  # bins are periodic: the first one from the least beat frequency on is meant
                    low, _ = cube.rows.phases(start, start + self.transform.shape[1])
                    first = low / np.pi * self.radar.samples / (self.radar.samples - 1) - 1
                    place += math.ceil((first - place) / count) * count
                range_m = self.radar.range_axis_m()
                strongest[:, number] = range_m[place % len(range_m)], self.velocity_mps[row], power.max()
        return strongest


def mean_chirp(adc: Any) -> np.ndarray:
    """Mean of a cube (chirp, antenna, sample) over its chirps, complex64; computed from the products where the cube stores
    these."""
    if isinstance(adc, DiskCube) and isinstance(adc.rows, ProductRows):
        return (adc.rows.column_sums() / len(adc)).astype(np.complex64)
    blocks = (np.asarray(adc[start : start + PIECE]) for start in range(0, len(adc), PIECE))
    return np.asarray(sum(column_sums(block) for block in blocks) / len(adc)).astype(np.complex64)
