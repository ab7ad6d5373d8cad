"""What every adapter of real data gives: labelled maps, where they come from, under which licence, and the hash of their files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import file_path, positive
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import regular_file
from t2d_rt.dataset.products import axis
from t2d_rt.learn.maps import DYNAMIC_RANGE_DB, SIZE, LabelledMaps, check_varied, checked_size, relative_levels

MAX_BYTES = 2_000_000_000
"""Largest file of real data that is read."""
MAX_FILES = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class AdapterOptions:
    """What the user knows of the data beside the files; adapters of one recorded set ignore what the set itself tells."""

    classes: Mapping[str, str] | None = None
    """Class of each label that is used, in the order of the classes; by default each label is a class of its own."""
    size: tuple[int, int] = SIZE
    """Cells of speed and of time of the maps."""
    speed_mps: float = 6.4
    """Greatest speed of the axis, where the files do not tell it [m/s]."""
    duration_s: float = 5.0
    """Time that a map covers, where the files do not tell it [s]."""
    dynamic_range_db: float = DYNAMIC_RANGE_DB

    def __post_init__(self) -> None:
        checked_size(self.size)
        positive("speed_mps", self.speed_mps, 1e4, unit="m/s")
        positive("duration_s", self.duration_s, 1e5, unit="s")
        positive("dynamic_range_db", self.dynamic_range_db, 200, unit="dB")


@dataclass(frozen=True, slots=True, kw_only=True)
class Adapter:
    """A way to read one kind of real data."""

    name: str
    about: str
    licence: str
    """Terms of the data as far as they are known, in a sentence."""
    read: Callable[[Path, AdapterOptions], tuple[LabelledMaps, list[Path]]]
    """Maps, and the files that they were read from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RealMaps:
    """Maps of real recordings."""

    maps: LabelledMaps
    adapter: str
    licence: str
    sha256: str
    """Hash of names and content of all files that were read."""
    files: int

    def __str__(self) -> str:
        counts = ", ".join(f"{name} {count}" for name, count in zip(self.maps.classes, self.maps.counts, strict=True))
        return (
            f"{len(self.maps)} maps ({counts}) of {self.files} files by {self.adapter}, SHA-256 {self.sha256[:16]}. "
            f"{self.licence}"
        )


@dataclass(frozen=True, slots=True)
class Piece:
    """One map as an adapter finds it."""

    power: np.ndarray
    """(speed, time), of any unit, over ascending speeds, positive = approaching."""
    label: str
    name: str
    groups: Mapping[str, str]


def content_hash(root: Path, files: list[Path]) -> str:
    """SHA-256 of the names below `root` and the content of files, in the order of their names."""
    found = hashlib.sha256()
    for path in sorted(files):
        name = path.name if path == root else path.relative_to(root).as_posix()
        found.update(f"{name}\0{path.stat().st_size}\0".encode())
        with regular_file(path, noun="file of real data") as file:
            while block := file.read(1 << 20):
                found.update(block)
    return found.hexdigest()


def class_of(label: str, options: AdapterOptions) -> str | None:
    """The class of a label; None where the user leaves it out."""
    return label if options.classes is None else options.classes.get(label)


def class_names(labels: list[str], options: AdapterOptions, path: Path) -> tuple[str, ...]:
    """Classes in order; all labels of the mapping must occur, so that a misspelt one does not pass for an empty class."""
    if options.classes is None:
        return tuple(sorted(set(labels)))
    for label in options.classes:
        if label not in labels:
            raise InputError(f"{path} has no class '{label}'; it has {', '.join(sorted(set(labels)))}")
    return tuple(dict.fromkeys(options.classes.values()))


def maps_from(pieces: list[Piece], options: AdapterOptions, path: Path, all_labels: list[str]) -> LabelledMaps:
    """Pieces of the user's axes, brought to one size, as labelled maps."""
    classes = class_names(all_labels, options, path)
    if not pieces:
        raise InputError(f"{path} holds no map of the classes {', '.join(classes)}; check the path and the classes")
    levels = []
    for each in pieces:
        if each.power.ndim != 2 or min(each.power.shape) < 2:
            raise InputError(
                f"{path}: map {each.name} must be an array of speeds and times, got shape {each.power.shape}"
            )
        if not np.isfinite(each.power).all():
            raise InputError(f"{path}: map {each.name} has NaN or infinite cells; leave it out or repair it")
        levels.append(relative_levels(each.power, options.size, options.dynamic_range_db))
        check_varied(levels[-1], f"{path}: map {each.name}")
    numbers = [classes.index(str(class_of(each.label, options))) for each in pieces]
    kinds = sorted({kind for each in pieces for kind in each.groups})
    return LabelledMaps(
        levels=np.stack(levels),
        labels=np.array(numbers),
        classes=classes,
        groups={kind: np.array([each.groups[kind] for each in pieces]) for kind in kinds},
        velocity_mps=axis((-options.speed_mps, options.speed_mps), options.size[0]),
        duration_s=options.duration_s,
        names=tuple(each.name for each in pieces),
    )


def files_below(path: Path, endings: tuple[str, ...], noun: str) -> list[Path]:
    """Files of a folder and its folders, in order; hidden ones are left out."""
    folder = file_path(f"the folder of {noun}", path)
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; give the folder that holds one folder for each class of {noun}")
    some = (each for each in sorted(folder.rglob("*")) if each.suffix.lower() in endings)
    found = [each for each in some if not each.name.startswith(".") and each.is_file()]
    if not found:
        raise InputError(f"{folder} holds no {' or '.join(endings)} files; give the folder of {noun}")
    if len(found) > MAX_FILES:
        raise InputError(f"{folder} holds {len(found)} files, {MAX_FILES} are read at most; give a part of it")
    return found
