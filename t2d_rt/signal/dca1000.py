"""Raw captures of TI's DCA1000 board: 16-bit integers in the order in which the radar's LVDS lanes bring them.

Texas Instruments, Mmwave Radar Device ADC Raw Data Capture, application report SWRA581B (2018).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import choice, file_path, flag
from t2d_rt.core.cube_storage import FileRows
from t2d_rt.core.cubes import Cube
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import regular_file
from t2d_rt.signal.measured import (
    ORDERS,
    code_offset,
    cube_of,
    flatness_db,
    oriented,
    signed,
    spread_rows,
    warn_of_offset,
)
from t2d_rt.types import Radar

LANES = "2", "4"
WORD = np.dtype("<i2")
FEWEST_CHIRPS = 16
"""Whose spectra tell orders of samples apart."""
FLATTER_DB = 0.5
"""By how much the spectrum of samples in the order that is asked for may be flatter than in another."""


def load_dca1000(path: str | Path, radar: Radar, *, lanes: int, iq: str = "IQ", conjugate: bool = False) -> Cube:
    """ADC cube, complex64 (chirp, antenna, sample), from a .bin file of complex samples; a large one is read when it is used.

    lanes: 2 (xWR16xx, xWR18xx, xWR68xx) or 4 (xWR12xx, xWR14xx).
    iq: "QI" where Q stands before I (MSB_LSB_QI), "I" where samples are real: these follow one another, and their beats are taken
        to be positive, over half the range axis.
    conjugate: whether the IF is the conjugate of the one here, whose beats are positive.

    With 2 lanes a chirp brings one receiver after the other, each as I(0) I(1) Q(0) Q(1) I(2) I(3) Q(2) Q(3) ...
    With 4 lanes it brings one sample after the other, each as I of receivers 0 to 3 and then Q of receivers 0 to 3, zeros for
    receivers that are not used.
    With "tdm" every transmitter's chirp follows the one before it; a row of the cube holds those of one loop.
    Samples in another order, or real ones without iq="I", are refused: taken so, their spectrum is flatter than in their own order.
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
    if not size or size % (2 * row):
        real = ", or iq='I' where samples are real" if size and iq != "I" and size % row == 0 else ""
        raise InputError(
            f"{path} holds {size} bytes, and a loop of this radar ({senders} x {receivers} antennas, {radar.samples} samples) "
            f"has {2 * row}: give the radar that recorded it, or cut the file at the last whole loop{real}"
        )
    shape = size // (2 * row), senders * receivers, radar.samples
    raw = FileRows(source, shape, 0, WORD, row)
    seen = np.concatenate([raw.numbers(part.start, part.stop).ravel() for part in spread_rows(shape[0])])
    offset = code_offset(seen)
    given = f"{'real' if iq == 'I' else 'complex'} samples over {lanes} lanes"
    _check_order(signed(seen, offset, radar.samples), radar.samples, given, source)
    used: np.ndarray | None = None
    if str(lanes) == "4":
        used = np.asarray(seen.reshape(-1, 4).any(axis=0))
        if np.count_nonzero(used) != receivers:
            raise InputError(
                f"{path} holds {np.count_nonzero(used)} receivers, the radar has {receivers}; give the radar that recorded it"
            )
    warn_of_offset(source, offset)
    decode = partial(_decoded, order=given, samples=radar.samples, used=used, offset=offset, iq=iq, conjugate=conjugate)
    return cube_of(replace(raw, decode=decode))


def _complex(pairs: np.ndarray) -> np.ndarray:
    """I + jQ of an axis 1 of the two, one after the other."""
    return (pairs[:, 0] + np.complex64(1j) * pairs[:, 1]).ravel()


def _receivers(values: np.ndarray, samples: int) -> np.ndarray:
    """Chirps (chirp of a receiver, sample) of values of 4 receivers at one sample after the other."""
    return values.reshape(-1, samples, 4).swapaxes(1, 2).reshape(-1, samples)


LAYOUTS: dict[str, tuple[Callable[[np.ndarray, int], np.ndarray], str]] = {
    "complex samples over 2 lanes": (
        lambda codes, samples: _complex(codes.reshape(-1, 2, 2)).reshape(-1, samples), "give lanes=2 and iq='IQ' or 'QI'",
    ),
    "complex samples over 4 lanes": (
        lambda codes, samples: _receivers(_complex(codes.reshape(-1, 2, 4)), samples), "give lanes=4 and iq='IQ' or 'QI'",
    ),
    "real samples over 2 lanes": (lambda codes, samples: codes.reshape(-1, samples), "give lanes=2 and iq='I'"),
    "real samples over 4 lanes": (_receivers, "give lanes=4 and iq='I'"),
    "complex samples one by one, I Q I Q": (
        lambda codes, samples: _complex(codes.reshape(-1, 2)).reshape(-1, samples),
        "save numpy.fromfile(path, '<i2').reshape(chirps, antennas, samples, 2) as .npy",
    ),
}  # fmt: skip
"""From codes (word,) to samples (chirp of a receiver, sample), and what to do with a file in this order."""


def _decoded(
    words: np.ndarray, *, order: str, samples: int, used: np.ndarray | None, offset: int, iq: str, conjugate: bool
) -> np.ndarray:
    """Samples of rows of words (row, word), complex64 (chirp of a receiver, sample)."""
    found = LAYOUTS[order][0](signed(words, offset, samples).ravel(), samples)
    if used is not None:
        found = found.reshape(-1, 4, samples)[:, used].reshape(-1, samples)
    return oriented(found, iq, conjugate=conjugate)


def _check_order(codes: np.ndarray, samples: int, given: str, path: Path) -> None:
    """Refuses codes that have a flatter spectrum in the order that is given than in another."""
    found = {}
    for name, (ordered, _) in LAYOUTS.items():
        try:
            chirps = ordered(codes, samples)
        except ValueError:  # so many words are no whole chirps
            continue
        chirps = chirps[chirps.any(axis=1)]
        if len(chirps) >= FEWEST_CHIRPS:
            rounding = 1 / 6 if np.iscomplexobj(chirps) else 1 / 12
            found[name] = flatness_db(chirps, noise=rounding)
    best = min(found, key=lambda name: found[name], default=given)
    if given not in found or found[given] - found[best] < FLATTER_DB:
        return
    raise InputError(
        f"{path} does not hold {given}: taken as {best} its chirps have a spectrum that is less flat by "
        f"{found[given] - found[best]:.1f} dB; {LAYOUTS[best][1]}"
    )
