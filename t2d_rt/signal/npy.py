"""Cubes from .npy files."""

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
from t2d_rt.core.cubes import Cube
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import npy_header, regular_file
from t2d_rt.signal.measured import (
    ORDERS,
    code_offset,
    cube_of,
    oriented,
    signed,
    spread_rows,
    warn_of_offset,
)


def load_cube(path: str | Path, *, iq: str = "IQ", conjugate: bool = False) -> Cube:
    """ADC cube, complex64 (chirp, antenna, sample), from a .npy file of (chirp, sample) or (chirp, antenna, sample).

    Samples are complex, or real with I and Q along a last axis of 2. A large file is read when the cube is used, piece by piece.
    Raw 16-bit words that were stored as unsigned numbers (0..65535, as OpenRadar does) are turned back into signed ones, those in
    offset binary with a warning; anything that is not made of 16-bit integers stays as it is.

    iq: "QI" where Q stands before I, "I" where samples are real; their beats are taken to be positive, over half the range axis.
    conjugate: whether the IF is the conjugate of the one here, whose beats are positive.
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
        seen = [_words(rows.numbers(part.start, part.stop)) for part in spread_rows(rows.shape[0])]
        offset = code_offset(np.concatenate([each.ravel() for each in seen]))
        warn_of_offset(rows.path, offset)
    decode = partial(_decoded, samples=rows.shape[2], words=words, offset=offset, iq=iq, conjugate=conjugate)
    return cube_of(replace(rows, decode=decode))


def _rows(path: Path, *, real: bool) -> FileRows:
    """Where the rows of a .npy file stand, of what shape they are."""
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
    """(chirp, antenna, sample) of an array's shape."""
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
    """Parts that are 16-bit integers, signed or unsigned, as int16."""
    return _parts(numbers).astype(np.int64).astype(np.int16)


def _are_words(rows: FileRows) -> bool:
    """Whether all samples are 16-bit integers."""
    step = block_rows(rows.shape)
    for start in range(0, rows.shape[0], step):
        parts = _parts(rows.numbers(start, min(start + step, rows.shape[0])))
        # NaN is equal to nothing.
        if not ((parts == np.rint(parts)).all() and parts.min() >= -(2**15) and parts.max() < 2**16):
            return False
    return True


def _decoded(numbers: np.ndarray, *, samples: int, words: bool, offset: int, iq: str, conjugate: bool) -> np.ndarray:
    """Samples of rows (row, number), complex64, as many as there are."""
    with np.errstate(over="ignore"):
        parts = signed(_words(numbers), offset, samples) if words else _parts(numbers).astype(np.float32)
    if iq == "I":
        parts = parts[:, ::2] if numbers.dtype.kind == "c" else parts
        return oriented(parts.reshape(-1, samples), iq, conjugate=conjugate)
    return oriented(np.ascontiguousarray(parts).view(np.complex64), iq, conjugate=conjugate)
