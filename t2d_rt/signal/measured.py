"""Measured ADC samples: what a look at them tells of how they were written, and what is wrong with them."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np

from t2d_rt.core.cube_storage import FileRows
from t2d_rt.core.cubes import Cube, DiskCube, is_large, row_blocks
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.types import Radar

ORDERS = "IQ", "QI", "I"
"""Of the channels; "I" alone are real samples."""
INSPECTED_ROWS = 64
"""Rows that are looked at, spread over the file."""
AT_ONCE = 8
"""Of these, rows that follow one another."""
SIDE_BINS = 3
"""Range bins beside zero and beside half the sample rate that belong to neither half of the beat spectrum: a Hann window's lobe."""
MIRRORED = 2.0
"""Power above the noise floor in the upper half of the beat spectrum over that in the lower half, beyond which the user is told."""
LIKE, LESS_LIKE, LARGEST_LAG = 0.5, 0.8, 4
"""Coherence beyond which chirps some rows apart are alike, fraction of it below which neighbours are not, and most rows apart."""
CLIPPED, CLIPPED_LEAST = 1e-3, 10
"""Fraction and number of samples at the end of the converters' scale beyond which the user is told."""


def spread_rows(count: int) -> list[range]:
    """Pieces of `AT_ONCE` rows, spread over so many, `INSPECTED_ROWS` in all; or all rows where they are fewer."""
    if count <= INSPECTED_ROWS:
        return [range(count)]
    starts = np.linspace(0, count - AT_ONCE, INSPECTED_ROWS // AT_ONCE).astype(int) // AT_ONCE * AT_ONCE
    return [range(start, start + AT_ONCE) for start in np.unique(starts).tolist()]


def code_offset(words: np.ndarray) -> int:
    """What converters in offset binary add to their codes: 2^(b - 1) of words of b bits that scatter about it; else 0.

    words: int16; those of 16 bits of offset binary are read as unsigned ones.
    """
    codes = words.astype(np.int32)
    codes = codes[codes != 0]  # lost packets
    if not codes.size:
        return 0
    flipped = (words ^ np.int16(-(2**15))).astype(np.int32)
    far, ends = np.abs(codes) > 2**14, np.abs(codes) >= 2**15 - 1
    if far.mean() > 0.95 and ends.mean() < 0.1 and flipped.std() < codes.std() / 2:
        return 2**15
    middle = 2 ** round(math.log2(codes.mean())) if codes.mean() > 1 else 0
    fits = middle >= 2**9 and codes.min() >= 0 and codes.max() < 2 * middle
    return middle if fits and abs(codes.mean() / middle - 1) < 0.1 else 0


def signed(words: np.ndarray, offset: int, samples: int) -> np.ndarray:
    """Codes of int16 words as float32, less the offset but where as many words as a chirp has samples are zeros: lost packets."""
    if not offset:
        return words.astype(np.float32)
    codes = (words.view(np.uint16).astype(np.int32) - offset).astype(np.float32)
    codes.reshape(-1, samples)[~words.reshape(-1, samples).any(axis=1)] = 0
    return codes


def warn_of_offset(path: Path, offset: int) -> None:
    """Tells of codes in offset binary, which are read as such."""
    if offset:
        _warn(
            f"{path} holds codes in offset binary, about {offset} and none below 0 as unsigned words; {offset} is subtracted "
            "from each, and if they are signed after all, only their constant changes",
            stacklevel=5,
        )


def oriented(samples: np.ndarray, iq: str, *, conjugate: bool) -> np.ndarray:
    """Samples (chirp, sample) that were read as I + jQ, as they are, complex64: Q before I swapped, a conjugate IF conjugated.

    Real ones become analytic: what stands at negative beats is the image of what stands at positive ones.
    """
    if iq == "I":
        from scipy.signal import hilbert

        return np.asarray(hilbert(samples), np.complex64)
    if iq == "QI":
        samples = samples.imag + np.complex64(1j) * samples.real
    return samples.conj() if conjugate else samples


def cube_of(rows: FileRows) -> Cube:
    """The cube, its samples checked: in memory or, where it is large, read from its file when used."""
    on_disk = DiskCube(rows)
    cube: Cube = on_disk if is_large(rows.shape) else np.empty(rows.shape, np.complex64)
    if isinstance(cube, np.ndarray):
        for part, block in row_blocks(on_disk):  # decoding takes several times the memory of what it makes
            cube[part] = block
    _check_samples(cube, rows.path)
    return cube


def _check_samples(cube: Cube, path: Path) -> None:
    """Refuses samples that are not finite or all zero; tells of lost and clipped ones and of a channel that is missing."""
    silent = clipped = 0
    channels = np.zeros(2, bool)
    for _, block in row_blocks(cube):
        parts = np.ascontiguousarray(block).view(np.float32).reshape(-1, 2)
        if not np.isfinite(parts).all():
            raise InputError(f"{path} holds NaN or infinite samples; remove those chirps")
        channels |= parts.any(axis=0)
        silent += int(np.count_nonzero(~block.any(axis=2)))
        clipped += _at_ends(parts)
    chirps, size = cube.shape[0] * cube.shape[1], math.prod(cube.shape)
    if not channels.any():
        raise InputError(f"{path} holds nothing but zeros; check the capture")
    if not channels.all():
        name, alone = ("Q", "save its numbers alone and ") if channels[1] else ("I", "")
        _warn(
            f"{path} holds one channel, {name}, and zeros for the other, so that each echo stands at its range and mirrored, and "
            f"speeds have no sign; record both, or {alone}give iq='I', which takes beats for positive",
            stacklevel=6,
        )
    if silent:
        _warn(
            f"{path} holds zeros alone in {silent} of its {chirps} chirps of an antenna, as lost packets leave them; cut these "
            "out, or expect bands over all speeds",
            stacklevel=6,
        )
    if clipped > max(CLIPPED * size, CLIPPED_LEAST):
        _warn(
            f"{path} is saturated: {100 * clipped / size:.3g} % of its samples stand at the end of the converters' scale; record "
            "with less gain, or expect harmonics of the strongest echoes",
            stacklevel=6,
        )


def _at_ends(parts: np.ndarray) -> int:
    """How many samples (..., 2) have I or Q at an end of a converter's scale: the greatest is 2^n - 1, or the least -2^n."""
    found = np.zeros(parts.shape[:-1], bool)
    for end in (float(parts.max()), float(parts.min())):
        codes = end + 1 if end > 0 else -end
        if codes >= 2**7 and math.log2(codes).is_integer():
            found |= (parts == end).any(axis=-1)
    return int(np.count_nonzero(found))


def warn_of_mirror(cube: Cube, path: Path, iq: str) -> None:
    """Tells of beats that look negative: most echoes are near, so that the lower half of the beat spectrum has the most power."""
    samples = cube.shape[2]
    rows = np.concatenate([np.asarray(cube[part.start : part.stop]) for part in spread_rows(len(cube))])
    spectrum = np.fft.fft(rows * np.hanning(samples), axis=-1)
    power = np.mean(np.abs(spectrum) ** 2, axis=(0, 1))
    power = np.maximum(power - 2 * np.median(power), 0.0)
    half = samples // 2
    lower = power[SIDE_BINS : half - SIDE_BINS + 1].sum()
    upper = power[samples - half + SIDE_BINS : samples - SIDE_BINS + 1].sum()
    if upper > MIRRORED * lower:
        _warn(
            f"{path} has {100 * upper / (lower + upper):.0f} % of its echoes' power in the upper half of the beat spectrum, as "
            "samples with Q before I or of a conjugate IF have, whose ranges are mirrored and whose speeds have the other sign; "
            f"{'leave out' if iq == 'QI' else 'give'} iq='QI' or give conjugate=True, or False if echoes do come from so far"
        )


def warn_of_period(cube: Cube, radar: Radar, path: Path) -> None:
    """Tells of rows that are more like those some rows on than like the next ones: neighbours were not recorded alike."""
    if radar.multiplexing == "ddm" or (radar.loops_per_frame or AT_ONCE) < AT_ONCE or len(cube) < AT_ONCE:
        return
    found = np.zeros(LARGEST_LAG + 1)
    for part in spread_rows(len(cube)):
        rows = np.asarray(cube[part.start : part.stop])
        rows = rows - rows.mean(axis=2, keepdims=True)
        for lag in range(LARGEST_LAG + 1):
            one, two = rows[: len(rows) - LARGEST_LAG], rows[lag : len(rows) - LARGEST_LAG + lag]
            found[lag] += np.abs(np.sum(one.conj() * two, axis=(0, 2))).sum() / math.sqrt(_energy(one) * _energy(two))
    found /= found[0] or 1.0
    best = 1 + int(found[1:].argmax())
    if found[best] > LIKE and found[1] < LESS_LIKE * found[best]:
        _warn(
            f"{path} has chirps that are more like those {best} rows on than like the next ones, as {best} transmitters in turn "
            "leave them, or another number of samples or receivers than the radar's; give the radar that recorded it"
        )


def _energy(rows: np.ndarray) -> float:
    return float(np.sum(np.abs(rows) ** 2)) or 1.0


def flatness_db(chirps: np.ndarray, *, noise: float = 0.0) -> float:
    """Geometric over arithmetic mean of the mean power spectrum of chirps (chirp, sample) [dB].

    The lower, the better samples follow from those before them (Kolmogorov); samples in a wrong order are flatter than in the right
    one. noise: power of a sample's rounding.
    """
    window = np.hanning(chirps.shape[-1])
    power = np.mean(np.abs(np.fft.fft(chirps * window, axis=-1)) ** 2, axis=0) + noise * np.sum(window**2)
    return float(10 * (np.mean(np.log10(power)) - np.log10(power.mean())))


def _warn(message: str, *, stacklevel: int = 4) -> None:
    """By default from a function that `load_recording` calls; what readers call lies deeper."""
    warnings.warn(message, T2DWarning, stacklevel=stacklevel)
