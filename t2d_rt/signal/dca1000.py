"""Raw captures of TI's DCA1000 board: 16-bit integers in the order in which the radar's LVDS lanes bring them.

Texas Instruments, Mmwave Radar Device ADC Raw Data Capture, application report SWRA581B (2018).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from t2d_rt.checks import choice
from t2d_rt.errors import InputError
from t2d_rt.files import regular_file
from t2d_rt.types import Radar

LANES = "2", "4"


def load_dca1000(path: str | Path, radar: Radar, *, lanes: int) -> np.ndarray:
    """ADC cube, complex64 (chirp, antenna, sample), from a .bin file of complex samples, I before Q.

    lanes: 2 (xWR16xx, xWR18xx, xWR68xx) or 4 (xWR12xx, xWR14xx).

    With 2 lanes a chirp brings one receiver after the other, each as I(0) I(1) Q(0) Q(1) I(2) I(3) Q(2) Q(3) ...
    With 4 lanes it brings one sample after the other, each as I of receivers 0 to 3 and then Q of receivers 0 to 3, zeros for
    receivers that are not used.
    With "tdm" every transmitter's chirp follows the one before it; a row of the cube holds those of one loop.
    """
    choice("lanes", str(lanes), LANES, hint="the LVDS lanes of the radar's chip")
    receivers, senders = len(radar.rx_offsets_m), radar.loop_chirps
    if str(lanes) == "4" and receivers > 4:
        raise InputError(f"a capture over 4 lanes holds 4 receivers at most, the radar has {receivers}; use lanes=2")
    if str(lanes) == "2" and radar.samples % 2:
        raise InputError(f"a capture over 2 lanes holds samples by twos, the radar has {radar.samples}; give its radar")
    with regular_file(path, noun="recording") as file:
        data = file.read()
    row = 4 * senders * radar.samples * (4 if str(lanes) == "4" else receivers)
    if not data or len(data) % row:
        raise InputError(
            f"{path} holds {len(data)} bytes, and a loop of this radar ({senders} x {receivers} antennas, {radar.samples} samples) "
            f"has {row}: give the radar that recorded it, or cut the file at the last whole loop"
        )
    words = np.frombuffer(data, "<i2").astype(np.float32)
    if str(lanes) == "2":
        pairs = words.reshape(-1, 2, 2)  # (pair of samples, I or Q, sample)
        samples = (pairs[:, 0] + 1j * pairs[:, 1]).reshape(-1, senders, receivers, radar.samples)
    else:
        both = words.reshape(-1, senders, radar.samples, 2, 4)
        used = both.any(axis=(0, 1, 2, 3))
        if np.count_nonzero(used) != receivers:
            raise InputError(
                f"{path} holds {np.count_nonzero(used)} receivers, the radar has {receivers}; give the radar that recorded it"
            )
        both = both[..., used]
        samples = (both[..., 0, :] + 1j * both[..., 1, :]).swapaxes(2, 3)
    return np.ascontiguousarray(samples.reshape(len(samples), senders * receivers, radar.samples).astype(np.complex64))
