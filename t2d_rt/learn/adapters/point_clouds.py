"""Point clouds as text, as those of RadHAR: records of "key: value" lines, a new frame where point_id is 0."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.core.files import read_bytes
from t2d_rt.learn.adapters.interface import MAX_BYTES, Adapter, AdapterOptions, Piece, class_of, files_below, maps_from
from t2d_rt.learn.maps import LabelledMaps

FIELD = re.compile(r"^\s*(point_id|velocity|intensity|secs|nsecs):\s*(\S+)", re.MULTILINE)
LONGEST_S = 86_400.0
"""That the stamps of one file may span; a wrong one would make millions of empty windows."""
FLOOR = 1e-6
"""Power of a cell without points, relative to a point of 0 dB: no logarithm of zero."""


def read_point_clouds(path: Path, options: AdapterOptions) -> tuple[LabelledMaps, list[Path]]:
    """A map for every `duration_s` of every file that has points: their power over speed and time. The class is the file's folder.

    Speed is taken as positive = receding, as the devices of these files tell the rate of range, and turned round.
    """
    files = files_below(path, (".txt",), "point clouds")
    pieces: list[Piece] = []
    short = 0
    for each in files:
        label = each.parent.name
        if class_of(label, options) is None:
            continue
        time_s, speed, power = _points(each)
        beyond = float(np.abs(speed).max())
        if beyond > options.speed_mps:
            raise InputError(
                f"{each} has points of up to {beyond:.3g} m/s, the axis ends at {options.speed_mps:g} m/s; raise speed_mps"
            )
        short += int(time_s[-1] - time_s[0] < options.duration_s)
        for number in range(int((time_s[-1] - time_s[0]) / options.duration_s)):
            first = time_s[0] + number * options.duration_s
            inside = (time_s >= first) & (time_s < first + options.duration_s)
            cells, _, _ = np.histogram2d(
                speed[inside], time_s[inside] - first, bins=options.size, weights=power[inside],
                range=((-options.speed_mps, options.speed_mps), (0.0, options.duration_s)),
            )  # fmt: skip
            if not cells.any():
                continue
            name = f"{each.relative_to(path).as_posix()} {number}"
            pieces.append(Piece(cells + FLOOR, label, name, {"event": each.relative_to(path).as_posix()}))
    if short:
        warnings.warn(
            f"{short} of {len(files)} files of {path} are shorter than a map of {options.duration_s:g} s and give none; "
            "lower duration_s",
            T2DWarning,
            stacklevel=3,
        )
    return maps_from(pieces, options, path, [each.parent.name for each in files]), files


def _points(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], speed, positive = approaching [m/s], and power of each point of a file."""
    text = read_bytes(path, limit=MAX_BYTES, noun="point cloud").decode("utf-8", errors="replace")
    columns: dict[str, list[str]] = {name: [] for name in ("point_id", "velocity", "intensity", "secs", "nsecs")}
    for name, value in FIELD.findall(text):
        columns[name].append(value)
    count = len(columns["point_id"])
    if count < 2 or any(len(each) != count for each in columns.values()):
        raise InputError(
            f"{path} must hold records of stamp (secs, nsecs), point_id, velocity and intensity, "
            f"got {count} points and {len(columns['velocity'])} velocities"
        )
    try:
        values = {name: np.array(each, dtype=np.float64) for name, each in columns.items()}
    except ValueError as error:
        raise InputError(f"{path} holds a field that is no number ({error}); repair the file") from None
    if not all(np.isfinite(each).all() for each in values.values()):
        raise InputError(f"{path} has NaN or infinite fields; repair the file")
    time_s = values["secs"] + 1e-9 * values["nsecs"]
    if np.ptp(time_s) > LONGEST_S:
        raise InputError(
            f"{path} spans {np.ptp(time_s):.3g} s by its stamps, {LONGEST_S:g} s are read at most; repair the stamps"
        )
    order = np.argsort(time_s, kind="stable")
    return time_s[order], -values["velocity"][order], 10.0 ** (values["intensity"][order] / 10.0)


RADHAR = Adapter(
    name="radhar",
    about="Point clouds as text, a folder for each class, as those of RadHAR.",
    licence="Terms of the data are those of whoever recorded it; RadHAR's repository states its own.",
    read=read_point_clouds,
)
