"""Maps in a file of arrays: .npz, or HDF5 with the extra [hdf5].

`levels` (sample, speed, time) [dB] and `labels` (sample,) as texts; optionally `velocity_mps` (speed,), `duration_s` and groups
`group_NAME` (sample,) as texts.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, numeric
from t2d_rt.core.errors import InputError, install
from t2d_rt.learn.adapters.interface import AXES, Adapter, AdapterOptions, Piece, class_of, maps_from
from t2d_rt.learn.maps import LabelledMaps

GROUP = "group_"


def read_npz(path: Path, options: AdapterOptions) -> tuple[LabelledMaps, list[Path]]:
    """Maps from an .npz file."""
    return _maps(path, npz_arrays(path), options), [path]


def npz_arrays(path: Path, only: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """The arrays of an .npz file by name, all or only some; none is unpickled."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files if only is None or name in only}
    except Exception as error:  # NumPy and zipfile may raise anything for a damaged file
        raise InputError(f"cannot read {path}: {error or type(error).__name__}; give an .npz file of arrays") from None


def read_hdf5(path: Path, options: AdapterOptions) -> tuple[LabelledMaps, list[Path]]:
    """Maps from an HDF5 file."""
    try:
        import h5py
    except ImportError:
        raise InputError(f"HDF5 files need h5py: {install('hdf5')}, or give an .npz file") from None
    try:
        with h5py.File(path, "r") as file:
            arrays = {name: _array(file[name]) for name in file if isinstance(file[name], h5py.Dataset)}
    except Exception as error:  # h5py may raise anything for a damaged file
        raise InputError(f"cannot read {path}: {error or type(error).__name__}; give an HDF5 file of arrays") from None
    return _maps(path, arrays, options), [path]


def _array(stored: Any) -> np.ndarray:
    return np.asarray(stored.asstr()[()] if stored.dtype.kind == "O" else stored[()])


def _maps(path: Path, arrays: dict[str, np.ndarray], options: AdapterOptions) -> LabelledMaps:
    """Maps from arrays by name, which are checked first."""
    for name in ("levels", "labels"):
        if name not in arrays:
            raise InputError(
                f"{path} has no array '{name}'; it needs levels (sample, speed, time) and labels (sample,)"
            )
    levels = numeric(f"levels of {path}", arrays["levels"])
    labels = [label.decode() if isinstance(label, bytes) else str(label) for label in np.atleast_1d(arrays["labels"])]
    if levels.ndim != 3 or len(labels) != len(levels) or len(levels) == 0:
        raise InputError(
            f"{path}: levels must have shape (sample, speed, time) and labels one text for each, "
            f"got {levels.shape} and {len(labels)}"
        )
    levels = array(
        f"levels of {path}", levels, ("sample", "speed", "time"), limit=1e3, unit="dB", hint="leave damaged maps out"
    )
    card = options.of_cells(*levels.shape[1:])
    if "velocity_mps" in arrays:
        speed_mps = _greatest_speed(path, arrays["velocity_mps"], levels.shape[1])
        _agrees(path, "speeds", speed_mps, card.speed_mps, options, "m/s")
        options = replace(options, cell_mps=None, speed_mps=speed_mps)
    if "duration_s" in arrays:
        duration_s = float(array(f"duration_s of {path}", arrays["duration_s"], ()))
        _agrees(path, "duration", duration_s, card.duration_s, options, "s")
        options = replace(options, rate_hz=None, duration_s=duration_s)
    groups = {name[len(GROUP) :]: group for name, group in arrays.items() if name.startswith(GROUP)}
    for name, group in groups.items():
        if group.shape != (len(levels),):
            raise InputError(f"{path}: {GROUP}{name} must name each of {len(levels)} samples, got shape {group.shape}")
    return maps_from(_pieces(path, levels, labels, groups, options), options, path, labels)


OWN = {"velocity_mps": "speeds", "duration_s": "duration"}
"""Arrays that specify an axis."""
AWAY = 0.01
"""Relative tolerance between the axis on a card and that in the file, since rates are given with few figures."""


def _agrees(path: Path, axis: str, file_value: float, card_value: float, options: AdapterOptions, unit: str) -> None:
    """Refuses a card that contradicts the file beside it."""
    if AXES[axis] & options.told and abs(card_value - file_value) > AWAY * file_value:
        raise InputError(
            f"{path} itself tells {axis} of {file_value:g} {unit}, the card beside it {card_value:g} {unit}; correct one of them"
        )


def _axes_npz(path: Path) -> list[str]:
    with np.load(path, allow_pickle=False) as file:
        return [axis for name, axis in OWN.items() if name in file.files]


def _axes_hdf5(path: Path) -> list[str]:
    import h5py

    with h5py.File(path, "r") as file:
        return [axis for name, axis in OWN.items() if name in file]


def _pieces(
    path: Path, levels: np.ndarray, labels: list[str], groups: Mapping[str, np.ndarray], options: AdapterOptions
) -> Iterator[Piece]:
    for place, label in enumerate(labels):
        if class_of(label, options) is not None:
            name = f"{path.name} {place}"
            group_names = {kind: str(group[place]) for kind, group in groups.items()}
            yield Piece(10.0 ** (levels[place] / 10.0), label, name, {"event": name} | group_names)


def _greatest_speed(path: Path, value: np.ndarray, count: int) -> float:
    """Outer edge of an axis of equal cells about 0 [m/s], from the centres of the cells."""
    velocity = array(f"velocity_mps of {path}", value, (count,), unit="m/s")
    cells = np.diff(velocity)
    if count < 2 or cells.min() <= 0 or np.ptp(cells) > 0.01 * cells.mean():
        raise InputError(
            f"{path}: velocity_mps must ascend by equal steps over {count} speeds, got steps of "
            f"{cells.min():g}..{cells.max():g} m/s; resample the maps"
        )
    if abs(velocity[0] + velocity[-1]) > 1.005 * cells.mean():
        raise InputError(
            f"{path}: velocity_mps must reach as far below 0 as above, got {velocity[0]:g}..{velocity[-1]:g} m/s; cut the maps"
        )
    return float(0.5 * (velocity[-1] - velocity[0] + cells.mean()))


LICENCE = "Terms of the data are those of whoever recorded it."
NPZ = Adapter(name="npz", about="An .npz file of levels and labels.", licence=LICENCE, read=read_npz, axes=_axes_npz)
HDF5 = Adapter(
    name="hdf5", about="An HDF5 file of levels and labels.", licence=LICENCE, read=read_hdf5, axes=_axes_hdf5
)
