"""`LabelledMaps`: spectrograms of a common size with their labels, simulated or measured, on which classifiers are trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from t2d_rt.core.checks import array, instance, integer, positive, shown
from t2d_rt.core.constants import decibel
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset
from t2d_rt.dataset.products import axis, edges, resized
from t2d_rt.dataset.splits import grouped

SIZE = 64, 64
"""Default number of cells of speed and of time."""
DYNAMIC_RANGE_DB = 60.0
"""Dynamic range of the maps [dB], as the authors of Text2Doppler chose it."""
LEAST_SHARED = 0.95
"""Least part of the span from the lowest to the highest speed of any map that all maps of a data set must cover."""
LARGEST = 4096
AT_ONCE = 64
"""Number of maps that are checked at once."""
LEAST_SPAN_DB = 1e-3
"""Least difference between the levels of a map that is not empty [dB]; rounding alone causes less."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledMaps:
    """Spectrograms (N, speed, time) with common axes, each with its class."""

    levels: np.ndarray
    """Levels [dB below the greatest cell of each map], float32 (N, speed, time): finite, 0 at most, clipped at the dynamic
    range."""
    labels: np.ndarray
    """Indices of the classes, int64 (N,)."""
    classes: tuple[str, ...]
    groups: Mapping[str, np.ndarray]
    """By kind, such as "description", "clip" or "event", the group of each sample, str (N,): samples of a group must be on one side
    of a split."""
    velocity_mps: np.ndarray
    """Speeds [m/s], ascending, positive = approaching, (speed,)."""
    duration_s: float
    """Duration of a map [s]."""
    names: tuple[str, ...]
    """A name for each sample, by which its origin can be found."""

    def __post_init__(self) -> None:
        levels = checked_levels(self.levels)
        count, speeds, times = levels.shape
        if count == 0 or speeds < 2 or times < 2:
            raise InputError(f"levels must hold a sample and two cells or more along each axis, got {levels.shape}")
        if levels.max() > 1e-3:
            raise InputError(f"levels are in dB below each map's greatest cell, got {levels.max():.4g} dB; subtract it")
        checked_classes(self.classes)
        labels = np.asarray(self.labels)
        if labels.shape != (count,) or not np.issubdtype(labels.dtype, np.integer):
            raise InputError(f"labels must be {count} integers, got {shown(labels)}; give one for each map")
        if labels.min() < 0 or labels.max() >= len(self.classes):
            wrong = labels[(labels < 0) | (labels >= len(self.classes))][0]
            raise InputError(f"label {wrong} is of no class; the labels of {len(self.classes)} classes begin with 0")
        velocity = array("velocity_mps", self.velocity_mps, (speeds,), unit="m/s")
        if np.any(np.diff(velocity) <= 0):
            raise InputError("velocity_mps must ascend; reverse the axis and the maps")
        groups = {name: np.asarray(group).astype(str) for name, group in self.groups.items()}
        for name, group in groups.items():
            if group.shape != (count,):
                raise InputError(f"group {shown(name)} must name each of {count} samples, got {group.shape}")
        if len(self.names) != count:
            raise InputError(f"names must be {count}, one for each map, got {len(self.names)}")
        positive("duration_s", self.duration_s, unit="s")
        object.__setattr__(self, "levels", levels)
        object.__setattr__(self, "labels", labels.astype(np.int64))
        object.__setattr__(self, "velocity_mps", velocity)
        object.__setattr__(self, "groups", groups)

    def __len__(self) -> int:
        return len(self.labels)

    def __repr__(self) -> str:
        speeds, times = self.size
        return f"LabelledMaps({len(self)} maps of {speeds} x {times} cells, {len(self.classes)} classes)"

    @property
    def size(self) -> tuple[int, int]:
        """Number of cells of speed and of time."""
        return self.levels.shape[1], self.levels.shape[2]

    @property
    def counts(self) -> np.ndarray:
        """Number of samples of each class, (K,)."""
        return np.bincount(self.labels, minlength=len(self.classes))

    def checked_for_training(self) -> LabelledMaps:
        """These maps; refuses fewer than two classes, and a class without a sample."""
        if len(self.classes) < 2:
            raise InputError(
                f"there is one class only, {shown(self.classes[0])}; a classifier needs samples of two or more"
            )
        lacking = [name for name, count in zip(self.classes, self.counts, strict=True) if count == 0]
        if lacking:
            raise InputError(
                f"class {shown(lacking[0])} has no sample to train on; make samples of it, or take it out of the recipe"
            )
        return self

    def take(self, indices: Sequence[int] | np.ndarray) -> LabelledMaps:
        """The samples at these positions, in this order."""
        positions = np.asarray(indices)
        if positions.dtype == bool and positions.shape == (len(self),):
            positions = np.flatnonzero(positions)
        if positions.ndim != 1 or positions.size == 0 or not np.issubdtype(positions.dtype, np.integer):
            raise InputError(f"indices must be one or more positions of samples, got {shown(positions)}")
        if positions.min() < 0 or positions.max() >= len(self):
            raise InputError(f"indices must lie in 0..{len(self) - 1}, got {positions.min()}..{positions.max()}")
        return replace(
            self,
            levels=self.levels[positions],
            labels=self.labels[positions],
            groups={name: group[positions] for name, group in self.groups.items()},
            names=tuple(self.names[place] for place in positions),
        )

    def resized(self, size: tuple[int, int], speeds_mps: tuple[float, float] | None = None) -> LabelledMaps:
        """Maps of another size: powers are averaged over the cells, and 0 dB is the greatest cell of each new map.

        speeds_mps: outer edges of the lowest and the highest speed of the new maps; by default those of these maps.
        """
        new_size, (low, high) = checked_size(size), edges(self.velocity_mps)
        first, last = speeds_mps or (low, high)
        if new_size == self.size and max(abs(first - low), abs(last - high)) < 1e-3 * (high - low) / new_size[0]:
            return self
        floor_db = float(self.levels.min())
        rows = (first - low) / (high - low), (last - low) / (high - low)
        levels = np.stack([relative_levels(10.0 ** (level / 10.0), new_size, -floor_db, rows) for level in self.levels])
        return replace(self, levels=levels, velocity_mps=axis((first, last), new_size[0]))

    def relabelled(self, classes: Sequence[str], of: Mapping[str, str] | None = None) -> LabelledMaps:
        """The samples of these classes, in this order. `of`: the new class of each old class that is kept; by default the same."""
        of = {name: name for name in self.classes if name in classes} if of is None else of
        numbers = np.array([classes.index(of[name]) if name in of else -1 for name in self.classes])[self.labels]
        if not (numbers >= 0).any():
            raise InputError(f"there is no sample of {', '.join(classes)} among those of {', '.join(self.classes)}")
        selected = self.take(np.flatnonzero(numbers >= 0))
        return replace(selected, labels=numbers[numbers >= 0], classes=tuple(classes))

    def joined(self, *others: LabelledMaps) -> LabelledMaps:
        """These maps together with others of the same classes and axes. Where some lack a kind of group, each of their samples is a
        group by itself."""
        for other in others:
            instance("maps to join", other, LabelledMaps, "LabelledMaps")
            if other.classes != self.classes:
                raise InputError(
                    f"maps of classes {self.classes} and of {other.classes} cannot be joined; map one to the other"
                )
            if other.size != self.size:
                raise InputError(f"maps of {self.size} and of {other.size} cells cannot be joined; resize one of them")
            check_axes(self, other)
        all_maps = (self, *others)
        kinds = sorted(frozenset[str]().union(*(maps.groups for maps in all_maps)))
        return replace(
            self,
            levels=np.concatenate([maps.levels for maps in all_maps]),
            labels=np.concatenate([maps.labels for maps in all_maps]),
            groups={
                kind: np.concatenate([_group(maps, kind, part) for part, maps in enumerate(all_maps)]) for kind in kinds
            },
            names=tuple(name for maps in all_maps for name in maps.names),
        )


def maps_of(
    dataset: Dataset,
    size: tuple[int, int] = SIZE,
    dynamic_range_db: float = DYNAMIC_RANGE_DB,
    speeds_mps: tuple[float, float] | None = None,
) -> LabelledMaps:
    """The spectrograms of a data set, in the order of its records.

    size: number of cells of speed and of time.
    dynamic_range_db: levels are clipped at this distance below each map's greatest cell [dB].
    speeds_mps: outer edges of the lowest and the highest cell [m/s], within `shared_speeds(dataset)`, which is the default.

    Raises InputError where samples cover different speeds or durations, where the data set keeps a smaller dynamic range, where a
    map has a single level, and where a class has no sample.
    """
    instance("dataset", dataset, Dataset, "a Dataset", hint="Dataset(folder) reads one")
    map_size, range_db = checked_size(size), positive("dynamic_range_db", dynamic_range_db, 200, unit="dB")
    kind = dataset.checked("spectrogram")
    stored = dataset.recipe.products.spectrogram
    if stored is not None and stored.dtype == "uint8" and range_db > stored.dynamic_range_db:
        raise InputError(
            f"{dataset.path} keeps {stored.dynamic_range_db:g} dB below the greatest cell (uint8), got a dynamic range of "
            f"{range_db:g} dB; take as much at most"
        )
    levels, (lowest, highest) = [], shared_speeds(dataset) if speeds_mps is None else speeds_mps
    for place, record in enumerate(dataset.records):
        values = dataset.values(place, kind)
        first, last = record["products"][kind]["velocity_mps"]
        rows = (lowest - first) / (last - first), (highest - first) / (last - first)
        levels.append(relative_levels(10.0 ** (values.astype(np.float64) / 10.0), map_size, range_db, rows))
        check_varied(levels[-1], f"sample {record['index']} of {dataset.path}")
    durations = np.ptp([record["products"][kind]["time_s"] for record in dataset.records], axis=1)
    if np.ptp(durations) > 0.05 * durations[0]:
        raise InputError(
            f"the maps of {dataset.path} cover {durations.min():.3g} to {durations.max():.3g} s; give all samples one duration"
        )
    return LabelledMaps(
        levels=np.stack(levels),
        labels=dataset.labels,
        classes=dataset.classes,
        groups=groups_of(dataset.records),
        velocity_mps=axis((lowest, highest), map_size[0]),
        duration_s=float(durations[0]),
        names=tuple(str(index) for index in dataset.indices),
    ).checked_for_training()


def shared_speeds(*datasets: Dataset) -> tuple[float, float]:
    """Lowest and highest speed [m/s] that all spectrograms of data sets cover: each is cut to whole Doppler cells of its own radar.

    Raises InputError where they share less than 95 % of the span from the lowest to the highest speed that any of them shows.
    """
    spans = [
        record["products"][dataset.checked("spectrogram")]["velocity_mps"]
        for dataset in datasets
        for record in dataset.records
    ]
    first, last = np.array(spans).T
    if last.min() - first.max() < LEAST_SHARED * (last.max() - first.min()):
        names = ", ".join(str(dataset.path) for dataset in datasets)
        raise InputError(f"the samples of {names} have different axes of speed; give the recipe one speed_mps")
    return float(first.max()), float(last.min())


def groups_of(records: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Groups of samples that share a sentence, a motion seed, a subject (if all have one), or recordings from which they were made;
    recordings that occur in one sample count as one."""
    have_subjects = all(record.get("subject") is not None for record in records)
    clips = np.empty(len(records), dtype="U24")
    for number, members in enumerate(grouped(records, ["clip"])):
        clips[members] = f"clips {number}"
    return {
        "description": np.array([str(record["sentence"]) for record in records]),
        "seed": np.array([str(record["seed"]) for record in records]),
        "clip": clips,
        **({"subject": np.array([str(record["subject"]) for record in records])} if have_subjects else {}),
    }


def checked_levels(given: Any) -> np.ndarray:
    """Checked levels (sample, speed, time), float32. An array that is float32 already, such as a file of many gigabytes, is not
    copied."""
    hint = "remove damaged samples first"
    shape = "sample", "speed", "time"
    if not (isinstance(given, np.ndarray) and given.dtype == np.float32 and given.ndim == len(shape)):
        return np.ascontiguousarray(array("levels", given, shape, hint=hint), dtype=np.float32)
    for start in range(0, len(given), AT_ONCE):
        array("levels", given[start : start + AT_ONCE], shape, hint=hint)
    return np.ascontiguousarray(given)


def relative_levels(
    power: np.ndarray, size: tuple[int, int], dynamic_range_db: float, rows: tuple[float, float] = (0.0, 1.0)
) -> np.ndarray:
    """Powers (speed, time) in any unit as levels of a map of a given size [dB below its greatest cell], float32.

    rows: where the map begins and ends on the axis of speeds, as fractions 0..1 of it.
    """
    cells = resized(power, size, rows)
    greatest = max(float(cells.max()), 1e-300)
    return np.asarray(np.maximum(decibel(cells / greatest), -dynamic_range_db), dtype=np.float32)


class _Axes(Protocol):
    @property
    def velocity_mps(self) -> np.ndarray: ...
    @property
    def duration_s(self) -> float: ...


def check_axes(first: _Axes, second: _Axes) -> None:
    """Refuses maps of as many cells whose speeds differ by more than half a cell, or durations by more than 5 %."""
    cell = float(first.velocity_mps[1] - first.velocity_mps[0])
    away = float(np.abs(second.velocity_mps - first.velocity_mps).max())
    if away > 0.5 * cell + 1e-9 or abs(second.duration_s - first.duration_s) > 0.05 * first.duration_s:
        raise InputError(
            f"maps must cover the same speeds and time: speeds differ by {away:.3g} m/s, durations are "
            f"{first.duration_s:g} and {second.duration_s:g} s; cut them to the same axes"
        )


def check_varied(levels: np.ndarray, name: str) -> None:
    """Refuses a map with a single level, as from a recording without a signal: relative to its greatest cell it would be all
    echo."""
    if np.ptp(levels) < LEAST_SPAN_DB:
        raise InputError(f"{name} has the same level in all cells, which shows nothing; leave it out or make it anew")


def checked_size(size: Any) -> tuple[int, int]:
    """Checked numbers of cells of speed and of time; a single number stands for both."""
    pair = (size, size) if isinstance(size, (int, np.integer)) else size
    if not isinstance(pair, (tuple, list)) or len(pair) != 2:
        raise InputError(f"size must be two numbers of cells, of speed and of time, got {shown(size)}")
    speed, time = (integer("size", cells, 8, LARGEST) for cells in pair)
    return speed, time


def checked_classes(classes: Any) -> tuple[str, ...]:
    """Checked names of classes, all different."""
    if not isinstance(classes, tuple) or not classes or not all(isinstance(name, str) and name for name in classes):
        raise InputError(f"classes must be a tuple of names, got {shown(classes)}")
    if len(set(classes)) < len(classes):
        raise InputError(f"classes names one of them twice, got {shown(classes)}; give each once")
    return classes


def _group(maps: LabelledMaps, kind: str, part: int) -> np.ndarray:
    """The groups of one kind; if there are none, each sample is a group by itself."""
    if kind in maps.groups:
        return maps.groups[kind]
    return np.array([f"{name} of part {part}" for name in maps.names])
