"""OpenSim's .trc, a table of labelled points, tab between columns -> tracks. Pose estimators write their joints in it too."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.motion.read.bvh import LARGEST_NUMBER, MAX_FRAMES
from t2d_rt.motion.read.markers import joints_from
from t2d_rt.motion.read.subjects import numbered
from t2d_rt.motion.read.tracks import Times, Tracks
from t2d_rt.types.motion import RATES_HZ

MAX_BYTES = 150_000_000
MAX_MARKERS = 1000

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def read_trc(path: Path, subject: str | None = None) -> Tracks:
    """Joints of the file's joint centres or markers."""
    data = read_bytes(path, limit=MAX_BYTES, noun="TRC file")
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        lines = data.decode("latin-1").splitlines()
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{path} is not a TRC file: it must be a table that starts with PathFileType")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    try:
        rate_hz, unit_m = float(header["DataRate"]), UNITS_M.get(header["Units"].lower())
    except (KeyError, ValueError):
        raise InputError(
            f"{path}: its second and third lines must give DataRate and Units; the file is damaged"
        ) from None
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError(f"{path}: DataRate must be frames per second, got {shown(header['DataRate'])}")
    labels = [label.strip() for label in lines[3].split("\t")[2:]]
    places = [place for place, label in enumerate(labels) if label]
    columns = dict(zip(numbered(labels[place] for place in places), places, strict=True))
    if not columns or len(columns) > MAX_MARKERS:
        raise InputError(f"{path}: its fourth line must name 1 to {MAX_MARKERS} markers, got {len(columns)}")
    times_s, table = _table(lines[5:], len(labels), path)
    markers = {label: table[:, place : place + 3] for label, place in columns.items() if place + 3 <= table.shape[1]}
    points, told = joints_from(markers, subject)
    times = Times(values=times_s, name="Time column", unit_s=1.0, rate_name="DataRate")
    return Tracks(
        form="TRC", points=points, rate_hz=rate_hz, times=times, told=told, unit_m=unit_m, up="y", up_certain=False
    )


def _table(lines: list[str], width: int, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times [s], (T,) or fewer, and coordinates (T, columns), NaN where a cell is empty."""
    rows: list[list[float]] = []
    times: list[float] = []
    for line in lines:
        if not line.strip():
            continue
        if len(rows) == MAX_FRAMES:
            raise InputError(f"{path} has more than {MAX_FRAMES} frames; cut the motion into shorter files")
        clock, *cells = line.rstrip("\r\n").split("\t")[1:] or [""]
        with suppress(ValueError):  # times in hours and minutes, or none
            times.append(float(clock))
        cells = (cells + [""] * (width + 2))[: width + 2]
        try:
            rows.append([float(cell) if cell.strip() else np.nan for cell in cells])
        except ValueError:
            raise InputError(f"{path}: row {len(rows) + 1} must hold numbers only; the file is damaged") from None
    if len(rows) < 2:
        raise InputError(f"{path}: a motion needs at least 2 frames, got {len(rows)}")
    table = np.array(rows)
    if np.abs(np.nan_to_num(table)).max() >= LARGEST_NUMBER:
        raise InputError(f"{path} holds infinite or absurd values; repair or re-export the file")
    return np.array(times), table
