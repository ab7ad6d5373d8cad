"""Data in one folder per class: spectrograms as pictures, whose colour or grey encodes the level; and point clouds as text."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.files import regular_file
from t2d_rt.learn.adapters.interface import MAX_BYTES, Adapter, AdapterOptions, Piece, class_of, files_below, maps_from
from t2d_rt.learn.maps import LabelledMaps

LUMA = np.array([0.299, 0.587, 0.114])
"""Weights of red, green and blue in the grey value (ITU-R BT.601)."""
ENDINGS = ".png", ".jpg", ".jpeg", ".bmp"
MAX_CELLS = 16_000_000
COLOUR_ERROR = 60.0
"""Greatest mean distance of a picture's colours from the colour map; black and white are 442 apart. JPEG pictures stay far
below."""
MOST_CHROMA = 16.0
"""Greatest mean difference between the channels of a grey picture, on a scale of 255; JPEG pictures stay below."""
COLOURED, MOST_COLOURED = 32.0, 1e-3
"""Difference between the channels from which a pixel counts as coloured, and greatest fraction of such pixels in a grey picture."""


def read_pictures(path: Path, options: AdapterOptions, *, colours: str) -> tuple[LabelledMaps, list[Path]]:
    """A map from every picture; rows are speeds from the greatest down, columns are times. The class is the name of the folder."""
    files = files_below(path, ENDINGS, "pictures")
    labels = [file.parent.name for file in files]
    pieces = (
        _picture(file, file.relative_to(path).as_posix(), options, colours)
        for file, label in zip(files, labels, strict=True)
        if class_of(label, options) is not None
    )
    return maps_from(pieces, options, path, labels), files


def _picture(path: Path, name: str, options: AdapterOptions, colours: str) -> Piece:
    power = 10.0 ** ((_fractions(path, colours)[::-1] - 1.0) * options.dynamic_range_db / 10.0)
    return Piece(power, path.parent.name, name, {"event": name})


def _pixels(path: Path) -> np.ndarray:
    """Red, green and blue of a picture, (row, column, 3), 0..255."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            if picture.width * picture.height > MAX_CELLS:
                raise InputError(f"{path} has {picture.width} x {picture.height} pixels; {MAX_CELLS} are read at most")
            if picture.mode.startswith("I"):  # 16 bits of grey
                return np.repeat(np.asarray(picture, np.float64)[..., None] / 257.0, 3, axis=2)
            return np.asarray(picture.convert("RGB"), dtype=np.float64)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"cannot read picture {path}: {error or type(error).__name__}; leave it out") from None


def is_coloured(pixels: np.ndarray) -> bool:
    """Whether a picture has colours: a tint all over, or a few coloured lines on black."""
    chroma = np.ptp(pixels, axis=2)
    return bool(chroma.mean() > MOST_CHROMA or (chroma > COLOURED).mean() > MOST_COLOURED)


def picture_adapter(folder: Path) -> str:
    """The adapter for a folder of pictures, judged by the first one: grey, or in the colour map jet."""
    return "ci4r" if is_coloured(_pixels(files_below(folder, ENDINGS, "pictures")[0])) else "png"


def _fractions(path: Path, colours: str) -> np.ndarray:
    """Position of each pixel's colour in the colour map, (row, column), 0..1."""
    pixels = _pixels(path)
    if colours == "grey":
        if is_coloured(pixels):
            raise InputError(
                f"{path} is in colours, whose grey does not tell the level; read pictures in the colour map jet with ci4r, and "
                "save others in grey"
            )
        return np.asarray(pixels @ LUMA, dtype=np.float64) / 255.0
    import matplotlib
    from scipy.spatial import KDTree

    table = matplotlib.colormaps[colours](np.linspace(0.0, 1.0, 256))[:, :3] * 255.0
    distance, index = KDTree(table).query(pixels)
    if float(distance.mean()) > COLOUR_ERROR:
        raise InputError(
            f"the colours of {path} are not those of the colour map {colours}; read grey pictures with png"
        )
    return np.asarray(index, dtype=np.float64) / 255.0


CI4R = Adapter(
    name="ci4r",
    about="Pictures of spectrograms in the colour map jet, a folder for each class, as those of CI4R.",
    licence="Terms of the data are those of whoever recorded it; CI4R asks for a citation.",
    read=partial(read_pictures, colours="jet"),
)
PNG = Adapter(
    name="png",
    about="Grey pictures of spectrograms, black the least level, a folder for each class.",
    licence="Terms of the data are those of whoever recorded it.",
    read=partial(read_pictures, colours="grey"),
)


POINT_FIELD = re.compile(r"^\s*(point_id|velocity|intensity|secs|nsecs):\s*(\S+)", re.MULTILINE)
MOST_OUTLIERS = 1e-3
"""Fraction of points beyond the axis that is tolerated, as every long recording has some wrong points; they are left out."""
MOST_OF_FILE = 0.1
"""Fraction of the points of a single file beyond the axis that is tolerated."""
FEWEST_SPEEDS = 8
"""Number of different speeds from which the spacing of a device's Doppler cells can be found."""
LONGEST_S = 86_400.0
"""Greatest time that the time stamps of a file may span [s]; a wrong stamp would make millions of empty windows."""
LINES_BYTES = 1 << 20
"""Number of bytes of a file of points that are read at once."""
EMPTY_CELL = 1e-6
"""Power of a cell without points, relative to a point of 0 dB, to avoid the logarithm of zero."""


def read_point_clouds(path: Path, options: AdapterOptions) -> tuple[LabelledMaps, list[Path]]:
    """A map for every `duration_s` of every file that has points: their power over speed and time. The class is the name of the
    folder.

    Speeds are taken as positive = receding unless the options say otherwise, because the devices of such files report the rate of
    change of range. A point stands for all speeds of its Doppler cell. Single points beyond `speed_mps` are counted and left out.
    """
    files = files_below(path, (".txt",), "point clouds")
    clouds = {file: _points(file) for file in files if class_of(file.parent.name, options) is not None}
    rows = _Rows.of([speed for _, speed, _ in clouds.values()], options, path)
    short = sum(time_s[-1] - time_s[0] < options.duration_s for time_s, *_ in clouds.values())
    if short:
        warn(
            f"{short} of {len(files)} files of {path} are shorter than a map of {options.duration_s:g} s and give none; "
            "lower duration_s"
        )
    options = replace(options, cell_mps=None, rate_hz=None)  # points have no other cells than those of the maps
    pieces = _windows(clouds, rows, options, path)
    return maps_from(pieces, options, path, [file.parent.name for file in files], receding=True), files


Cloud = tuple[np.ndarray, np.ndarray, np.ndarray]
"""For each point: time [s], ascending, float64; speed [m/s] as the device reports it, and power, both float32."""


def _windows(clouds: Mapping[Path, Cloud], rows: _Rows, options: AdapterOptions, path: Path) -> Iterator[Piece]:
    """A piece for every whole window of the files that have points."""
    for file, (time_s, speed, power) in clouds.items():
        event = file.relative_to(path).as_posix()
        windows = int((time_s[-1] - time_s[0]) / options.duration_s)
        begins_s = time_s[0] + options.duration_s * np.arange(windows + 1)
        borders = np.searchsorted(time_s, begins_s)
        for number in np.flatnonzero(np.diff(borders)):
            in_window = slice(borders[number], borders[number + 1])
            cells = rows.powers(speed[in_window], time_s[in_window] - begins_s[number], power[in_window], options)
            if cells.any():
                yield Piece(cells + EMPTY_CELL, file.parent.name, f"{event} {number}", {"event": event})


@dataclass(frozen=True, slots=True)
class _Rows:
    """Rows of a map over speed, which are filled by points from a device whose Doppler cells may be wider."""

    step_mps: float
    """Spacing of the speeds that the device reports [m/s]; 0 if they are continuous."""
    edges_mps: np.ndarray
    """Edges of the rows [m/s], (row + 1,)."""

    @classmethod
    def of(cls, speeds: Sequence[np.ndarray], options: AdapterOptions, path: Path) -> _Rows:
        """Rows for points with these speeds [m/s]; refuses points too many of which lie beyond the axis."""
        all_speeds = np.concatenate([*speeds, [0.0]])
        beyond = np.abs(all_speeds) > options.speed_mps
        worst = max((float((np.abs(speed) > options.speed_mps).mean()) for speed in speeds), default=0.0)
        if beyond.mean() > MOST_OUTLIERS or worst > MOST_OF_FILE:
            raise InputError(
                f"{path} has points of up to {np.abs(all_speeds).max():.3g} m/s, {100 * beyond.mean():.2g} % of them beyond "
                f"the axis of {options.speed_mps:g} m/s; raise speed_mps"
            )
        if beyond.any():
            warn(
                f"{int(beyond.sum())} of {len(all_speeds) - 1} points of {path} are faster than {options.speed_mps:g} m/s and were "
                "left out; raise speed_mps if they are no errors"
            )
        distinct = np.unique(np.round(all_speeds[~beyond], 6))
        step = float(np.diff(distinct).min()) if len(distinct) >= FEWEST_SPEEDS else 0.0
        regular = np.abs(distinct / step - np.round(distinct / step)).max() < 0.1 if step > 0 else False
        return cls(step if regular else 0.0, np.linspace(-options.speed_mps, options.speed_mps, options.size[0] + 1))

    def powers(self, speed: np.ndarray, time_s: np.ndarray, power: np.ndarray, options: AdapterOptions) -> np.ndarray:
        """Power of the points in each cell of a map (speed, time); the power of a point is spread over its Doppler cell."""
        columns = np.minimum((time_s * options.size[1] / options.duration_s).astype(int), options.size[1] - 1)
        half = max(self.step_mps, 1e-9) / 2
        below = np.clip((self.edges_mps[:, None] - speed + half) / (2 * half), 0, 1)
        cells = np.zeros((options.size[1], options.size[0]))
        np.add.at(cells, columns, (np.diff(below, axis=0) * power).T)
        return cells.T


def _points(path: Path) -> Cloud:
    """Reads the points of a file line by line."""
    columns: dict[str, array] = {name: array("d") for name in ("point_id", "velocity", "intensity", "secs", "nsecs")}
    try:
        with regular_file(path, noun="point cloud") as file:
            if path.stat().st_size > MAX_BYTES:
                raise InputError(f"{path} has more than {MAX_BYTES / 1e9:g} GB; split it")
            while lines := file.readlines(LINES_BYTES):
                for name, value in POINT_FIELD.findall(b"".join(lines).decode("utf-8", errors="replace")):
                    columns[name].append(float(value))
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} holds a field that is no number ({error}); repair the file") from None
    count = len(columns["point_id"])
    if count < 2 or any(len(column) != count for column in columns.values()):
        raise InputError(
            f"{path} must hold records of stamp (secs, nsecs), point_id, velocity and intensity, "
            f"got {count} points and {len(columns['velocity'])} velocities"
        )
    values = {name: np.frombuffer(column) for name, column in columns.items()}
    if not all(np.isfinite(column).all() for column in values.values()):
        raise InputError(f"{path} has NaN or infinite fields; repair the file")
    time_s = values["secs"] + 1e-9 * values["nsecs"]
    if np.ptp(time_s) > LONGEST_S:
        raise InputError(
            f"{path} spans {np.ptp(time_s):.3g} s by its stamps, {LONGEST_S:g} s are read at most; repair the stamps"
        )
    order = np.argsort(time_s, kind="stable")
    power = 10.0 ** (values["intensity"][order] / 10.0)
    return time_s[order], values["velocity"][order].astype(np.float32), power.astype(np.float32)


RADHAR = Adapter(
    name="radhar",
    about="Point clouds as text, a folder for each class, as those of RadHAR.",
    licence="Terms of the data are those of whoever recorded it; RadHAR's repository states its own.",
    read=read_point_clouds,
)
