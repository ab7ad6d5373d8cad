"""C3D files of marker positions -> tracks, decoded by ezc3d (extra [c3d])."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.files import read_bytes
from t2d_rt.motion.read.bvh import MAX_FRAMES
from t2d_rt.motion.read.markers import joints_from
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import RATES_HZ

MAX_BYTES = 500_000_000
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}

C3D_MARK = 0x50
"""Second byte of every C3D file."""


def read_c3d(path: Path) -> Tracks:
    """Joints of the file's joint centres or markers."""
    data = read_bytes(path, limit=MAX_BYTES, noun="C3D file")
    if len(data) < 1024 or data[1] != C3D_MARK:
        raise InputError(f"{path} is not a C3D file, or cut short")
    markers, rate_hz, unit = _markers(path)
    points, told = joints_from(markers, rate_hz)
    return Tracks(
        form="C3D", points=points, rate_hz=rate_hz, told=told, unit_m=UNITS_M.get(unit), up="z", up_certain=False
    )


def _markers(path: Path) -> tuple[dict[str, np.ndarray], float, str]:
    """Positions (T, 3) by label, NaN where not seen, the frame rate and the name of the unit."""
    try:
        import ezc3d
    except ImportError:
        raise InputError(f"reading {path} needs the package ezc3d; install t2d-rt with the extra [c3d]") from None
    try:
        file: Any = ezc3d.c3d(str(path))
        parameters = file["parameters"]["POINT"]
        labels = [
            str(label).strip()
            for key in sorted(parameters)
            if key.startswith("LABELS")
            for label in parameters[key]["value"]
        ]
        rate_hz, unit = float(parameters["RATE"]["value"][0]), str((parameters["UNITS"]["value"] or [""])[0])
        table = np.asarray(file["data"]["points"], dtype=np.float64)
    except Exception as error:  # ezc3d raises whatever its C++ code does
        raise InputError(
            f"{path} cannot be read as C3D ({' '.join(str(error).split())[:100]}); it is damaged or unusual"
        ) from None
    frames = table.shape[2]
    if not 2 <= frames <= MAX_FRAMES or not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError(f"{path} holds {frames} frames at {rate_hz:g} Hz; expected 2 to {MAX_FRAMES} at a usual rate")
    positions = np.moveaxis(table[:3], 0, -1)  # (markers, frames, 3)
    # Markers not seen are NaN, or exactly at the origin in files of older programs.
    positions = np.where((positions == 0.0).all(axis=-1, keepdims=True), np.nan, positions)
    return {label: positions[place] for place, label in enumerate(labels[: len(positions)])}, rate_hz, unit.lower()
