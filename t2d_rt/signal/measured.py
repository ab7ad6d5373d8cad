"""Measured ADC samples: .npy cubes and raw captures of TI's DCA1000 board, and checks of the order and sign in which they were
written.

The board delivers 16-bit integers in the order of the radar's LVDS lanes (Texas Instruments, Mmwave Radar Device ADC Raw Data
Capture, application report SWRA581B, 2018).
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import choice, file_path, flag
from t2d_rt.core.cube_storage import LARGEST_CHUNK_BYTES, FileRows, block_rows
from t2d_rt.core.cubes import Cube, DiskCube, is_large, row_blocks
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.files import npy_header, regular_file
from t2d_rt.types import Radar

ORDERS = "IQ", "QI", "I"
"""Orders of I and Q in a file; with "I" alone the samples are real."""
INSPECTED_ROWS = 64
"""Number of rows that are inspected, spread over the file."""
AT_ONCE = 8
"""Number of neighbouring rows in each inspected piece."""
SIDE_BINS = 3
"""Range bins next to zero and next to half the sample rate that count for neither half of the beat spectrum: the main lobe of a
Hann window."""
MIRRORED = 2.0
"""Ratio of the power above the noise floor in the upper half of the beat spectrum to that in the lower half, from which a warning
is given."""
LIKE, LESS_LIKE, LARGEST_LAG = 0.5, 0.8, 4
"""Coherence from which chirps some rows apart count as alike; factor on it below which neighbouring rows count as not alike; and
greatest distance in rows that is tested."""
CLIPPED, CLIPPED_LEAST = 1e-3, 10
"""A warning is given where more samples than this fraction, and more than this number, are at the ends of the converters' scale."""


def spread_rows(count: int) -> list[range]:
    """Pieces of `AT_ONCE` rows, spread over `count` rows, with `INSPECTED_ROWS` in all; or all rows where there are fewer."""
    if count <= INSPECTED_ROWS:
        return [range(count)]
    starts = np.linspace(0, count - AT_ONCE, INSPECTED_ROWS // AT_ONCE).astype(int) // AT_ONCE * AT_ONCE
    return [range(start, start + AT_ONCE) for start in np.unique(starts).tolist()]


def code_offset(words: np.ndarray) -> int:
    """Offset of the codes of converters with offset binary: 2^(b - 1) for b-bit words that scatter about it; else 0.

    words: int16; 16-bit words of offset binary are interpreted as unsigned.
    """
    codes = words.astype(np.int32)
    codes = codes[codes != 0]  # zeros are lost packets
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
    """Codes of int16 words as float32 without the offset; runs of zeros as long as a chirp are lost packets and stay zero."""
    if not offset:
        return words.astype(np.float32)
    codes = (words.view(np.uint16).astype(np.int32) - offset).astype(np.float32)
    codes.reshape(-1, samples)[~words.reshape(-1, samples).any(axis=1)] = 0
    return codes


def warn_of_offset(path: Path, offset: int) -> None:
    """Warns that codes are in offset binary and are read as such."""
    if offset:
        warn(
            f"{path} holds codes in offset binary, about {offset} and none below 0 as unsigned words; {offset} is subtracted "
            "from each, and if they are signed after all, only their constant changes"
        )


def oriented(samples: np.ndarray, iq: str, *, conjugate: bool) -> np.ndarray:
    """Samples (chirp, sample), read as I + jQ, with the right order and sign, complex64: for "QI" I and Q are swapped, a conjugate
    IF is conjugated.

    Real samples become analytic: their negative beat frequencies only mirror the positive ones.
    """
    if iq == "I":
        from scipy.signal import hilbert

        return np.asarray(hilbert(samples), np.complex64)
    if iq == "QI":
        samples = samples.imag + np.complex64(1j) * samples.real
    return samples.conj() if conjugate else samples


def cube_of(rows: FileRows) -> Cube:
    """The cube of a file with its samples checked; in memory or, if it is large, read from the file when it is used."""
    on_disk = DiskCube(rows)
    cube: Cube = on_disk if is_large(rows.shape) else np.empty(rows.shape, np.complex64)
    if isinstance(cube, np.ndarray):
        for part, block in row_blocks(on_disk):  # decoding takes several times the memory of its result
            cube[part] = block
    _check_samples(cube, rows.path)
    return cube


def _check_samples(cube: Cube, path: Path) -> None:
    """Refuses samples that are not finite or all zero; warns of lost and clipped samples and of a missing channel."""
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
        warn(
            f"{path} holds one channel, {name}, and zeros for the other, so that each echo stands at its range and mirrored, and "
            f"speeds have no sign; record both, or {alone}give iq='I', which takes beats for positive"
        )
    if silent:
        warn(
            f"{path} holds zeros alone in {silent} of its {chirps} chirps of an antenna, as lost packets leave them; cut these "
            "out, or expect bands over all speeds"
        )
    if clipped > max(CLIPPED * size, CLIPPED_LEAST):
        warn(
            f"{path} is saturated: {100 * clipped / size:.3g} % of its samples stand at the end of the converters' scale; record "
            "with less gain, or expect harmonics of the strongest echoes"
        )


def _at_ends(parts: np.ndarray) -> int:
    """Number of samples (..., 2) with I or Q at an end of a converter's scale, where the greatest value is 2^n - 1 or the least
    -2^n."""
    at_end = np.zeros(parts.shape[:-1], bool)
    for end in (float(parts.max()), float(parts.min())):
        codes = end + 1 if end > 0 else -end
        if codes >= 2**7 and math.log2(codes).is_integer():
            at_end |= (parts == end).any(axis=-1)
    return int(np.count_nonzero(at_end))


def warn_of_mirror(cube: Cube, path: Path, iq: str) -> None:
    """Warns of beat frequencies that seem to be negative: most echoes are near, so the lower half of the beat spectrum should have
    the most power."""
    samples = cube.shape[2]
    rows = np.concatenate([np.asarray(cube[part.start : part.stop]) for part in spread_rows(len(cube))])
    spectrum = np.fft.fft(rows * np.hanning(samples), axis=-1)
    power = np.mean(np.abs(spectrum) ** 2, axis=(0, 1))
    power = np.maximum(power - 2 * np.median(power), 0.0)
    half = samples // 2
    lower = power[SIDE_BINS : half - SIDE_BINS + 1].sum()
    upper = power[samples - half + SIDE_BINS : samples - SIDE_BINS + 1].sum()
    if upper > MIRRORED * lower:
        warn(
            f"{path} has {100 * upper / (lower + upper):.0f} % of its echoes' power in the upper half of the beat spectrum, as "
            "samples with Q before I or of a conjugate IF have, whose ranges are mirrored and whose speeds have the other sign; "
            f"{'leave out' if iq == 'QI' else 'give'} iq='QI' or give conjugate=True, or False if echoes do come from so far"
        )


def warn_of_period(cube: Cube, radar: Radar, path: Path) -> None:
    """Warns where rows resemble rows some distance away more than their neighbours, so that neighbours were recorded with different
    settings."""
    if radar.multiplexing == "ddm" or (radar.loops_per_frame or AT_ONCE) < AT_ONCE or len(cube) < AT_ONCE:
        return
    alike = np.zeros(LARGEST_LAG + 1)
    for part in spread_rows(len(cube)):
        rows = np.asarray(cube[part.start : part.stop])
        rows = rows - rows.mean(axis=2, keepdims=True)
        for lag in range(LARGEST_LAG + 1):
            one, two = rows[: len(rows) - LARGEST_LAG], rows[lag : len(rows) - LARGEST_LAG + lag]
            alike[lag] += np.abs(np.sum(one.conj() * two, axis=(0, 2))).sum() / math.sqrt(_energy(one) * _energy(two))
    alike /= alike[0] or 1.0
    best = 1 + int(alike[1:].argmax())
    if alike[best] > LIKE and alike[1] < LESS_LIKE * alike[best]:
        warn(
            f"{path} has chirps that are more like those {best} rows on than like the next ones, as {best} transmitters in turn "
            "leave them, or another number of samples or receivers than the radar's; give the radar that recorded it"
        )


def _energy(rows: np.ndarray) -> float:
    return float(np.sum(np.abs(rows) ** 2)) or 1.0


def flatness_db(chirps: np.ndarray, *, noise: float = 0.0) -> float:
    """Spectral flatness [dB] of chirps (chirp, sample): geometric over arithmetic mean of their mean power spectrum.

    The lower it is, the better samples can be predicted from those before (Kolmogorov); samples in a wrong order have a flatter
    spectrum than in the right one. noise: power of the rounding of a sample.
    """
    window = np.hanning(chirps.shape[-1])
    power = np.mean(np.abs(np.fft.fft(chirps * window, axis=-1)) ** 2, axis=0) + noise * np.sum(window**2)
    return float(10 * (np.mean(np.log10(power)) - np.log10(power.mean())))


def load_cube(path: str | Path, *, iq: str = "IQ", conjugate: bool = False) -> Cube:
    """ADC cube, complex64 (chirp, antenna, sample), from a .npy file of (chirp, sample) or (chirp, antenna, sample).

    Samples are complex, or real with I and Q along a last axis of 2. A large file is read when the cube is used, piece by piece.
    Raw 16-bit words that were stored as unsigned numbers (0..65535, as OpenRadar does) are turned back into signed ones, those in
    offset binary with a warning; anything that is not made of 16-bit integers stays as it is.

    iq: "QI" if Q comes before I, "I" if samples are real; their beat frequencies are then taken as positive, over half the range
        axis.
    conjugate: whether the IF is the conjugate of the one here, which has positive beat frequencies.
    """
    choice("iq", iq, ORDERS)
    flag("conjugate", conjugate)
    try:
        rows = _rows(file_path("path", path).absolute(), real=iq == "I")
    except InputError:
        raise
    except (ValueError, EOFError, SyntaxError, MemoryError, OverflowError, TypeError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path} is not a whole .npy array of numbers ({reason}); save one with numpy.save") from None
    words = _are_words(rows)
    offset = 0
    if words:
        word_blocks = [_words(rows.numbers(part.start, part.stop)) for part in spread_rows(rows.shape[0])]
        offset = code_offset(np.concatenate([block.ravel() for block in word_blocks]))
        warn_of_offset(rows.path, offset)
    decode = partial(_decoded, samples=rows.shape[2], words=words, offset=offset, iq=iq, conjugate=conjugate)
    return cube_of(replace(rows, decode=decode))


def _rows(path: Path, *, real: bool) -> FileRows:
    """Position and shape of the rows of a .npy file."""
    with regular_file(path, noun="recording") as file:
        shape, by_columns, dtype = npy_header(file)
        begin, size = file.tell(), os.fstat(file.fileno()).st_size
        if dtype.hasobject or dtype.kind not in "fiuc":
            raise ValueError(f"it holds {dtype}")
        needed = math.prod(shape) * dtype.itemsize
        if needed > size - begin:
            raise ValueError(f"it is cut short: {size - begin} of {needed} bytes")
        samples = _axes(path, shape, dtype, real=real)
        held = None
        if by_columns:
            if needed > LARGEST_CHUNK_BYTES:
                raise InputError(
                    f"{path} holds samples in Fortran's order, which are not read by pieces; save numpy.ascontiguousarray of them"
                )
            file.seek(0)
            held = np.lib.format.read_array(file, allow_pickle=False).reshape(shape[0], -1)
    return FileRows(path, samples, begin, dtype, row_numbers=math.prod(shape[1:]), held=held)


def _axes(path: Path, shape: tuple[int, ...], dtype: np.dtype[Any], *, real: bool) -> tuple[int, int, int]:
    """Numbers of chirps, antennas and samples for an array of that shape."""
    pairs = dtype.kind != "c" and not real
    if pairs and (len(shape) not in (3, 4) or shape[-1] != 2):
        raise InputError(
            f"{path} must hold complex samples (I + jQ) or pairs of I and Q along a last axis of 2, got {dtype} of shape {shape}; "
            "give iq='I' where they are real"
        )
    axes = shape[:-1] if pairs else shape
    if len(axes) not in (2, 3) or any(length < 1 for length in axes):
        advice = "; frames of chirps? reshape them to chirps" if len(axes) == 4 else ""
        raise InputError(f"{path} must have shape (chirp, sample) or (chirp, antenna, sample), got {shape}{advice}")
    return (axes[0], 1, axes[1]) if len(axes) == 2 else (axes[0], axes[1], axes[2])


def _parts(numbers: np.ndarray) -> np.ndarray:
    """Real and imaginary parts (row, number), float64."""
    if numbers.dtype.kind != "c":
        return numbers.astype(np.float64)
    return np.ascontiguousarray(numbers.astype(np.complex128)).view(np.float64)


def _words(numbers: np.ndarray) -> np.ndarray:
    """Real and imaginary parts that are 16-bit integers, signed or unsigned, as int16."""
    return _parts(numbers).astype(np.int64).astype(np.int16)


def _are_words(rows: FileRows) -> bool:
    """Whether all samples of a file are 16-bit integers."""
    step = block_rows(rows.shape)
    for start in range(0, rows.shape[0], step):
        parts = _parts(rows.numbers(start, min(start + step, rows.shape[0])))
        # NaN is unequal to itself
        if not ((parts == np.rint(parts)).all() and parts.min() >= -(2**15) and parts.max() < 2**16):
            return False
    return True


def _decoded(numbers: np.ndarray, *, samples: int, words: bool, offset: int, iq: str, conjugate: bool) -> np.ndarray:
    """Complex64 samples of some rows (row, number), with `samples` in a chirp."""
    with np.errstate(over="ignore"):
        parts = signed(_words(numbers), offset, samples) if words else _parts(numbers).astype(np.float32)
    if iq == "I":
        parts = parts[:, ::2] if numbers.dtype.kind == "c" else parts
        return oriented(parts.reshape(-1, samples), iq, conjugate=conjugate)
    return oriented(np.ascontiguousarray(parts).view(np.complex64), iq, conjugate=conjugate)


LANES = "2", "4"
WORD = np.dtype("<i2")
FEWEST_CHIRPS = 16
"""Least number of chirps whose spectra can tell in which order samples are."""
FLATTER_DB = 0.5
"""How much flatter the spectrum in the given order may be than in another one [dB]."""


def load_dca1000(path: str | Path, radar: Radar, *, lanes: int, iq: str = "IQ", conjugate: bool = False) -> Cube:
    """ADC cube, complex64 (chirp, antenna, sample), from a .bin file of complex samples; a large one is read when it is used.

    lanes: 2 (xWR16xx, xWR18xx, xWR68xx) or 4 (xWR12xx, xWR14xx).
    iq: "QI" if Q comes before I (MSB_LSB_QI), "I" if samples are real: these are stored one after the other, and their beat
        frequencies are taken as positive, over half the range axis.
    conjugate: whether the IF is the conjugate of the one here, which has positive beat frequencies.

    With 2 lanes the file has one receiver after the other for each chirp, as I(0) I(1) Q(0) Q(1) I(2) I(3) Q(2) Q(3) ...
    With 4 lanes it has one sample after the other, each as I of receivers 0 to 3 and then Q of receivers 0 to 3, with zeros for
    receivers that are not used.
    With "tdm" the chirps of the transmitters follow one another; a row of the cube holds those of one loop.
    Samples in another order, or real ones without iq="I", are refused; they are recognised by their flatter spectrum.
    """
    choice("iq", iq, ORDERS)
    flag("conjugate", conjugate)
    choice("lanes", str(lanes), LANES, hint="the LVDS lanes of the radar's chip")
    receivers, senders = len(radar.rx_offsets_m), radar.loop_chirps
    if str(lanes) == "4" and receivers > 4:
        raise InputError(f"a capture over 4 lanes holds 4 receivers at most, the radar has {receivers}; use lanes=2")
    if str(lanes) == "2" and iq != "I" and radar.samples % 2:
        raise InputError(f"a capture over 2 lanes holds samples by twos, the radar has {radar.samples}; give its radar")
    source = file_path("path", path).absolute()
    with regular_file(source, noun="recording") as file:
        size = os.fstat(file.fileno()).st_size
    row = (1 if iq == "I" else 2) * senders * radar.samples * (4 if str(lanes) == "4" else receivers)
    if not size:
        raise InputError(f"{path} is empty; record the capture anew")
    if size % (2 * row):
        real = ", or iq='I' where samples are real" if iq != "I" and size % row == 0 else ""
        raise InputError(
            f"{path} holds {size} bytes, and a loop of this radar ({senders} x {receivers} antennas, {radar.samples} samples) "
            f"has {2 * row}: give the radar that recorded it, or cut the file at the last whole loop{real}"
        )
    shape = size // (2 * row), senders * receivers, radar.samples
    raw = FileRows(source, shape, 0, WORD, row)
    words = np.concatenate([raw.numbers(part.start, part.stop).ravel() for part in spread_rows(shape[0])])
    offset = code_offset(words)
    order = f"{'real' if iq == 'I' else 'complex'} samples over {lanes} lanes"
    _check_order(signed(words, offset, radar.samples), radar.samples, order, source)
    used: np.ndarray | None = None
    if str(lanes) == "4":
        used = np.asarray(words.reshape(-1, 4).any(axis=0))
        if np.count_nonzero(used) != receivers:
            raise InputError(
                f"{path} holds {np.count_nonzero(used)} receivers, the radar has {receivers}; give the radar that recorded it"
            )
    first_words = raw.numbers(0, min(ROWS_OF_PERIOD, shape[0])).ravel()
    _check_period(signed(first_words, offset, radar.samples), LAYOUTS[order][0]["together"], row, senders, source)
    if radar.loops_per_frame and shape[0] % radar.loops_per_frame:
        raise InputError(
            f"{path} holds {shape[0]} loops of chirps, and a burst of this radar has {radar.loops_per_frame}, so that it ends "
            "within one; give the radar that recorded it, or cut the file at the last whole burst"
        )
    warn_of_offset(source, offset)
    decode = partial(
        _decoded_capture, order=order, samples=radar.samples, used=used, offset=offset, iq=iq, conjugate=conjugate
    )
    return cube_of(replace(raw, decode=decode))


def _values(codes: np.ndarray, together: int) -> np.ndarray:
    """I + jQ of codes (word,), of which `together` values of I are followed by as many of Q; real samples where `together` is 0."""
    if not together:
        return codes
    pairs = codes.reshape(-1, 2, together)
    return (pairs[:, 0] + np.complex64(1j) * pairs[:, 1]).ravel()


def _ordered(codes: np.ndarray, samples: int, *, together: int, by_sample: bool = False) -> np.ndarray:
    """Chirps (chirp of a receiver, sample) from codes as in `_values`. With `by_sample` each sample has the words of 4 receivers;
    otherwise the chirps of the receivers follow one another."""
    values = _values(codes, together)
    return (values.reshape(-1, samples, 4).swapaxes(1, 2) if by_sample else values).reshape(-1, samples)


LAYOUTS: dict[str, tuple[dict[str, Any], str]] = {
    "complex samples over 2 lanes": ({"together": 2}, "give lanes=2 and iq='IQ' or 'QI'"),
    "complex samples over 4 lanes": ({"together": 4, "by_sample": True}, "give lanes=4 and iq='IQ' or 'QI'"),
    "real samples over 2 lanes": ({"together": 0}, "give lanes=2 and iq='I'"),
    "real samples over 4 lanes": ({"together": 0, "by_sample": True}, "give lanes=4 and iq='I'"),
    "complex samples one by one, I Q I Q": (
        {"together": 1},
        "save numpy.fromfile(path, '<i2').reshape(chirps, antennas, samples, 2) as .npy",
    ),
}
"""Options of `_ordered` for each order of words, and the advice for a file in this order."""


def _decoded_capture(
    words: np.ndarray, *, order: str, samples: int, used: np.ndarray | None, offset: int, iq: str, conjugate: bool
) -> np.ndarray:
    """Complex64 samples of rows of words (row, word), as (chirp of a receiver, sample)."""
    chirps = _ordered(signed(words, offset, samples).ravel(), samples, **LAYOUTS[order][0])
    if used is not None:
        chirps = chirps.reshape(-1, 4, samples)[:, used].reshape(-1, samples)
    return oriented(chirps, iq, conjugate=conjugate)


ALIKE, LESS_THAN_ROW, REPEATED = 0.9, 0.8, 0.7
"""Coherence of the words at a lag from which a capture counts as repeating; factor on it below which it does not repeat at the
radar's rows; and, where a row seems to hold several chirps of one transmitter, how much closer to 1 the coherence must be than at
the lag of a row."""
ROWS_OF_PERIOD = 64
"""Number of rows in which the period of a capture is searched."""


def _check_period(codes: np.ndarray, together: int, row: int, senders: int, path: Path) -> None:
    """Refuses codes (word,) that repeat after another number of words than `row`, the length of the radar's rows; I and Q come in
    groups of `together`.

    Near echoes and leakage make each chirp resemble the one before. Where noise or movement dominates, no period is found and
    nothing is refused.
    """
    from scipy import fft

    values = _values(codes, together)
    row = row // 2 if together else row
    size = fft.next_fast_len(2 * len(values))
    power = np.abs(fft.fft(values - values.mean(), size)) ** 2
    if not together:
        power[size // 2 :] = 0  # real samples: use their analytic signal
    lags = np.arange(min(len(values) // 2, LARGEST_LAG * row) + 1)
    if len(lags) <= row:
        return
    # Absolute values, because movement changes the phase from chirp to chirp.
    coherence = np.abs(fft.ifft(power)[: len(lags)]) / (len(values) - lags)
    coherence /= coherence[0] or 1.0
    sought = lags >= row // 8
    best = int(lags[sought][coherence[sought].argmax()])
    elsewhere = coherence[row] < LESS_THAN_ROW * coherence[best]
    several = senders == 1 and row % best == 0 and best < row and 1 - coherence[best] < REPEATED * (1 - coherence[row])
    if coherence[best] > ALIKE and (elsewhere or several):
        raise InputError(
            f"{path} repeats itself every {best} samples of all receivers, {coherence[best]:.3f} alike, and a row of this radar "
            f"has {row}, {coherence[row]:.3f} alike: samples, receivers or transmitters are others; give the radar that recorded it"
        )


def _check_order(codes: np.ndarray, samples: int, order: str, path: Path) -> None:
    """Refuses codes whose spectrum is flatter in the given order than in another."""
    flatnesses_db = {}
    for name, (layout, _) in LAYOUTS.items():
        try:
            chirps = _ordered(codes, samples, **layout)
        except ValueError:  # not a whole number of chirps in that order
            continue
        chirps = chirps[chirps.any(axis=1)]
        if len(chirps) >= FEWEST_CHIRPS:
            rounding = 1 / 6 if np.iscomplexobj(chirps) else 1 / 12
            flatnesses_db[name] = flatness_db(chirps, noise=rounding)
    best = min(flatnesses_db, key=flatnesses_db.__getitem__, default=order)
    if order not in flatnesses_db or flatnesses_db[order] - flatnesses_db[best] < FLATTER_DB:
        return
    raise InputError(
        f"{path} does not hold {order}: taken as {best} its chirps have a spectrum that is less flat by "
        f"{flatnesses_db[order] - flatnesses_db[best]:.1f} dB; {LAYOUTS[best][1]}"
    )
