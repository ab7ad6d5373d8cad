"""PARrad: two 77 GHz radars in one room that observe the same person walking, sitting down, standing up, falling and getting up.

The file holds for each radar a map of (row, Doppler bin), with a row every 0.09 s and zero speed at bin 64, and spoken commands by
row.

- Unit. A value is the sum of decibels over the 64 range cells of a range-Doppler map. This follows from the noise: divided by 64 it
  has a standard deviation of 1.08 dB and no skewness; that of simulated noise, with a Hann window and a mean of decibels over 64
  cells, is 0.96 dB, while single cells would have 5.57 dB and a skewness of -1.1 (logarithm of an exponential distribution).
- Doppler bin. It is not documented. The strongest moving cells of walks lie near bin 10 to 12 in both radars, and people walk 1.0
  to 1.2 m/s in rooms: 0.10 m/s a bin, +-6.4 m/s in all, with an uncertainty of 25 %.
- Sign. Which side approaches is not documented. Classifiers are trained on both.
- Alignment. A command is spoken 1 to 3 s before the motion: an event begins at the row of least moving power in that time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import array
from t2d_rt.core.errors import InputError
from t2d_rt.learn.adapters.arrays import npz_arrays
from t2d_rt.learn.adapters.interface import AXES, Adapter, AdapterOptions, class_names, class_of
from t2d_rt.learn.maps import LabelledMaps, check_varied

RADARS = "wr14", "wr68"
RANGE_CELLS = 64
"""Number of range cells over which the file sums decibels."""
ROW_S = 0.09
BINS, ZERO_BIN = 128, 64
BIN_MPS = 0.10
"""Estimated width of a Doppler bin [m/s], +-25 %; see the module's docstring."""
NOTCH_BINS = 3
"""Number of bins on both sides of zero that static echoes fill: the Hann window's main lobe and its skirts."""
EARLIEST_ROW, LATEST_ROW = 11, 34
"""Rows after a command between which its motion begins: 1 and 3 s."""
ROWS = 56
"""Rows of a map: 5.04 s."""
SMOOTHED_ROWS = 9
DETECTION_DB = 1.25
"""Level above the noise, averaged over range, from which a cell counts as moving power [dB]."""

FIVE = {
    "walk to bed": "walk",
    "walk to room": "walk",
    "walk to chair": "walk",
    "sit down on bed": "sit down",
    "sit down on chair": "sit down",
    "stand up from bed": "stand up",
    "stand up from chair": "stand up",
    "fall on floor of room": "fall",
    "stand up from floor of room": "get up",
}
"""Class of each command, for five classes."""
FOUR = {label: "sit or stand" if name in ("sit down", "stand up") else name for label, name in FIVE.items()}
"""Class of each command, for four classes: sitting down and standing up are one."""


def read_parrad(path: Path, options: AdapterOptions) -> tuple[LabelledMaps, list[Path]]:
    """Maps of both radars for every command that has a class; the two maps of an event are neighbours.

    Size, speeds and duration of the options are ignored: maps are (128, 56), with the radar's own bins and rows.
    """
    if options.classes is None:
        options = replace(options, classes=FIVE)
    recording = _loaded(path)
    labels = [str(label) for label in recording["labels"]]
    classes = class_names(labels, options, path)
    floors = {radar: _above_floor(recording[radar]) for radar in RADARS}
    begins = aligned(recording["starts"], recording["stops"], floors)
    labelled_events = [(event, label) for event, label in enumerate(labels) if class_of(label, options) is not None]
    labelled_maps = [(event, label, radar) for event, label in labelled_events for radar in RADARS]
    levels = []
    for event, _, radar in labelled_maps:
        piece = floors[radar][begins[event] : begins[event] + ROWS].T
        levels.append(np.maximum(piece - piece.max(), -options.dynamic_range_db))
        check_varied(levels[-1], f"{path}: {radar} in event {event}")
    maps = LabelledMaps(
        levels=np.stack(levels),
        labels=np.array([classes.index(str(class_of(label, options))) for _, label, _ in labelled_maps]),
        classes=classes,
        groups={
            "event": np.array([f"event {event}" for event, _, _ in labelled_maps]),
            "radar": np.array([radar for _, _, radar in labelled_maps]),
        },
        velocity_mps=(np.arange(BINS) - ZERO_BIN) * BIN_MPS,
        duration_s=ROWS * ROW_S,
        names=tuple(f"{event} {radar} {label}" for event, label, radar in labelled_maps),
    )
    return maps, [path]


def notched(levels_db: np.ndarray) -> np.ndarray:
    """Maps (..., row, bin) whose bins near zero are set to the median of all others, so that static echoes are not the greatest
    cell."""
    levels = np.array(levels_db, dtype=np.float64)
    near_zero = np.abs(np.arange(levels.shape[-1]) - ZERO_BIN) <= NOTCH_BINS
    levels[..., near_zero] = np.median(levels[..., ~near_zero], axis=(-2, -1))[..., None, None]
    return levels


def aligned(starts: np.ndarray, stops: np.ndarray, above_db: Mapping[str, np.ndarray]) -> np.ndarray:
    """First row of each event's map, (E,).

    Between two events it is the row where the moving power of both radars together is least, 1 to 3 s after the command. For an
    event that is longer than a map, the most powerful `ROWS` rows are used.
    """
    power = sum(np.maximum(radar_db - DETECTION_DB, 0.0).sum(axis=1) for radar_db in above_db.values())
    smooth = np.convolve(power, np.ones(SMOOTHED_ROWS) / SMOOTHED_ROWS, mode="same")
    rows = len(smooth)
    borders = []
    for start in [*starts, stops[-1]]:
        first = min(start + EARLIEST_ROW, rows - 1)
        borders.append(first + int(np.argmin(smooth[first : min(start + LATEST_ROW, rows)])))
    totals = np.concatenate([[0.0], np.cumsum(power)])
    begins = []
    for first, last in pairwise(borders):
        places = np.arange(first, max(last - ROWS, first) + 1)
        places = np.minimum(places, rows - ROWS)
        begins.append(int(places[np.argmax(totals[places + ROWS] - totals[places])]))
    return np.array(begins)


def _above_floor(values: np.ndarray) -> np.ndarray:
    """Level averaged over range, relative to the noise [dB], (row, bin), without the bins of static echoes."""
    levels = notched(values / RANGE_CELLS)
    return levels - np.median(levels)


def _loaded(path: Path) -> dict[str, np.ndarray]:
    """Maps of both radars (row, bin), and the commands, all checked."""
    needed = (*RADARS, "starts", "stops", "labels")
    recording = npz_arrays(path, needed)
    for name in needed:
        if name not in recording:
            raise InputError(f"{path} is no PARrad file: it lacks {name}; it needs {', '.join(needed)}")
    for radar in RADARS:
        recording[radar] = array(
            f"{radar} of {path}",
            recording[radar],
            ("row", BINS),
            limit=1e6,
            hint="give the recording as it was published",
        )
    rows = len(recording[RADARS[0]])
    if rows < ROWS + LATEST_ROW or len(recording[RADARS[1]]) != rows:
        raise InputError(
            f"{path} has {rows} and {len(recording[RADARS[1]])} rows of its radars; both must have as many, "
            f"{ROWS + LATEST_ROW} or more"
        )
    _check_commands(path, recording, rows)
    return recording


def _check_commands(path: Path, recording: dict[str, np.ndarray], rows: int) -> None:
    """Checks that commands are texts with a first and a last row each, in ascending order."""
    labels = recording["labels"]
    if labels.ndim != 1 or len(labels) == 0 or labels.dtype.kind not in "US":
        raise InputError(
            f"{path}: labels must be texts, one for each command, got {labels.dtype} of shape {labels.shape}"
        )
    if labels.dtype.kind == "S":
        recording["labels"] = np.char.decode(labels, "utf-8", "replace")
    for name in ("starts", "stops"):
        rowed = array(f"{name} of {path}", recording[name], (len(labels),), hint="give one row for each label")
        if np.any(rowed != np.rint(rowed)):
            raise InputError(f"{path}: {name} must be numbers of rows, got fractions; round them")
        recording[name] = rowed.astype(np.int64)
    starts, stops = recording["starts"], recording["stops"]
    if np.any(np.diff(starts) <= 0) or np.any(stops <= starts) or starts[0] < 0 or stops.max() > rows:
        raise InputError(
            f"{path}: starts must ascend within its {rows} rows, each before its stop; give commands in order"
        )


PARRAD = Adapter(
    name="parrad",
    about="Two 77 GHz radars in one room; spoken commands (.npz of wr14, wr68, starts, stops, labels).",
    licence="PARrad set 1 of imec, terms of the source unchecked: for studies, not to be passed on.",
    read=read_parrad,
    axes=lambda path: AXES,
)
