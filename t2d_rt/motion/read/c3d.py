"""C3D files of marker positions -> tracks, decoded by ezc3d (extra [c3d])."""

from __future__ import annotations

import importlib.util
import os
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError, install
from t2d_rt.core.files import read_bytes
from t2d_rt.core.processes import run_guarded
from t2d_rt.motion.read.bvh import LARGEST_NUMBER, MAX_FRAMES
from t2d_rt.motion.read.clock import same_rate, warn_of_contradiction
from t2d_rt.motion.read.markers import joints_from
from t2d_rt.motion.read.subjects import numbered
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import RATES_HZ

MAX_BYTES = 250_000_000
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}

C3D_MARK = 0x50
"""Second byte of every C3D file."""

LONGEST_S = 120

DECODE = """
import sys
import ezc3d
import numpy as np
file = ezc3d.c3d(sys.argv[1])
point = file["parameters"]["POINT"]
keys = sorted((key for key in point if key.startswith("LABELS")), key=lambda key: int(key[6:] or 1))
labels = [str(label).strip() for key in keys for label in point[key]["value"]]
unit = "".join(point["UNITS"]["value"][:1]) if "UNITS" in point else ""
np.savez(sys.argv[2], labels=np.array(labels, dtype=str), rate=point["RATE"]["value"][0], unit=unit, points=file["data"]["points"])
"""
"""Program of the process that decodes a file, given as its first argument, into the .npz file that is its second."""


def read_c3d(path: Path, subject: str | None = None) -> Tracks:
    """Joints of the file's joint centres or markers."""
    data = read_bytes(path, limit=MAX_BYTES, noun="C3D file")
    if len(data) < 1024 or data[1] != C3D_MARK:
        raise InputError(f"{path} is not a C3D file, or cut short")
    markers, rate_hz, unit = _markers(path)
    header_hz = _header_rate(data)
    if RATES_HZ[0] <= header_hz <= RATES_HZ[1] and not same_rate(header_hz, rate_hz):
        warn_of_contradiction(
            f"the header's {header_hz:g} Hz contradict POINT:RATE of {rate_hz:g} Hz, which is taken", header_hz
        )
    points, told = joints_from(markers, subject)
    return Tracks(
        form="C3D", points=points, rate_hz=rate_hz, told=told, unit_m=UNITS_M.get(unit), up="z", up_certain=False
    )


def _header_rate(data: bytes) -> float:
    """Frame rate [Hz] of the first block, 0 where it is written by other processors than today's."""
    processor = data[512 * max(data[0] - 1, 0) :][3:4]
    order = {b"T": "<f", b"V": ">f"}.get(processor)  # 84 Intel, 86 MIPS
    return float(struct.unpack(order, data[20:24])[0]) if order else 0.0


def _markers(path: Path) -> tuple[dict[str, np.ndarray], float, str]:
    """Positions (T, 3) by label, NaN where not seen, the frame rate and the name of the unit."""
    if importlib.util.find_spec("ezc3d") is None:
        raise InputError(f"reading {path} needs the package ezc3d; {install('c3d')}")
    labels, rate_hz, unit, table = _decoded(path)
    if table.ndim != 3 or not 2 <= table.shape[2] <= MAX_FRAMES or not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError(
            f"{path} holds points of shape {table.shape} at {rate_hz:g} Hz; expected 2 to {MAX_FRAMES} frames"
        )
    positions = np.moveaxis(table[:3], 0, -1)  # (markers, frames, 3)
    positions = np.where(np.abs(positions) < LARGEST_NUMBER, positions, np.nan)
    return (
        {label: positions[place] for place, label in enumerate(numbered(labels[: len(positions)]))},
        rate_hz,
        unit.lower(),
    )


def _decoded(path: Path) -> tuple[list[str], float, str, np.ndarray]:
    """Labels, rate, unit and points (4, markers, frames), decoded in a process of its own: damaged files crash ezc3d."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "points.npz"
        try:
            done = run_guarded(
                [sys.executable, "-c", DECODE, str(path.resolve()), str(out)], folder=Path(folder), env=os.environ,
                limit_s=LONGEST_S, temporary=[Path(folder)],
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise InputError(f"{path} was not decoded within {LONGEST_S} s; it is damaged or too large") from None
        if done.returncode or not out.is_file():
            last = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
            raise InputError(
                f"{path} cannot be read as C3D ({shown(''.join(last) or 'its decoder crashed')}); it is damaged or unusual"
            )
        with np.load(out, allow_pickle=False) as found:
            return (
                [str(each) for each in found["labels"]],
                float(found["rate"]),
                str(found["unit"]),
                found["points"].astype(np.float64),
            )
