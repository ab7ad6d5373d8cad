"""Measured ADC samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.files import regular_file


def load_cube(path: str | Path) -> np.ndarray:
    """ADC cube, complex64 (chirp, antenna, sample), from a .npy file of (chirp, sample) or (chirp, antenna, sample).

    Raw 16-bit words that were stored as unsigned numbers (0..65535, as OpenRadar does) are turned back into signed
    ones; anything that is not made of 16-bit integers stays as it is.
    """
    try:
        with regular_file(path, noun="recording") as file:
            cube = np.lib.format.read_array(file, allow_pickle=False)
    except InputError:
        raise
    except (ValueError, EOFError, SyntaxError, MemoryError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path} is not a whole .npy array of numbers ({reason}); save one with numpy.save") from None
    if not np.issubdtype(cube.dtype, np.complexfloating):
        raise InputError(f"{path} must hold complex samples (I + jQ), got {cube.dtype}")
    if cube.ndim not in (2, 3) or 0 in cube.shape:
        raise InputError(f"{path} must have shape (chirp, sample) or (chirp, antenna, sample), got {cube.shape}")
    if not np.isfinite(cube).all():
        raise InputError(f"{path} holds NaN or infinite samples; remove those chirps")
    cube = np.ascontiguousarray(cube.astype(np.complex128))
    words = cube.view(np.float64)
    if (words == np.rint(words)).all() and words.min() >= -(2**15) and words.max() < 2**16:
        cube = words.astype(np.int64).astype(np.int16).astype(np.float32).view(np.complex64)
    cube = cube.astype(np.complex64)
    return cube[:, None] if cube.ndim == 2 else cube
