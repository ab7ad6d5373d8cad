"""Interface of the adapters for real data: each returns labelled maps, with their source, licence and the hash of their files."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2d_rt.core.checks import choice, file_path, positive, shown, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml, regular_file
from t2d_rt.dataset.products import axis
from t2d_rt.learn.maps import DYNAMIC_RANGE_DB, SIZE, LabelledMaps, check_varied, checked_size, relative_levels

MAX_BYTES = 2_000_000_000
"""Greatest size of a file of real data that is read [bytes]."""
MAX_FILES = 100_000


CARD = "card.yaml"
"""Name of the card of a folder; for a file the file's name stands before it, as in maps.npz.card.yaml."""
ON_CARD = "adapter", "classes", "speed_mps", "cell_mps", "duration_s", "rate_hz", "positive", "carrier_hz", "mti"
"""Keys that a card may have."""


AXES = {"speeds": {"speed_mps", "cell_mps"}, "duration": {"duration_s", "rate_hz"}}
"""Options that specify each axis of the maps."""


def card_path(source: Path) -> Path:
    """Path of the card of a file or folder, if there is one."""
    return source / CARD if source.is_dir() else source.with_name(f"{source.name}.{CARD}")


@dataclass(frozen=True, slots=True, kw_only=True)
class AdapterOptions:
    """What the user knows about the data beyond the files. Adapters of one particular data set ignore what that set specifies
    itself."""

    adapter: str | None = None
    """Name of the adapter; by default the one for files of this kind."""
    classes: Mapping[str, str] | None = None
    """Class of each label that is used, in the order of the classes; by default each label is its own class."""
    size: tuple[int, int] = SIZE
    """Number of cells of speed and of time of the maps."""
    speed_mps: float = 6.4
    """Greatest speed of the axis [m/s], if the files do not specify it."""
    duration_s: float = 5.0
    """Duration of a map [s], if the files do not specify it."""
    cell_mps: float | None = None
    """Width of the files' cells of speed [m/s], in place of the greatest speed."""
    rate_hz: float | None = None
    """Columns per second in the files [Hz], in place of the duration."""
    positive: Literal["approaching", "receding"] | None = None
    """Direction of positive speeds in the files; by default receding in point clouds, else approaching."""
    carrier_hz: float | None = None
    mti: Literal["mean", "none"] | None = None
    """How static echoes were removed."""
    cut_mps: tuple[float, float] | None = None
    """Lowest and highest speed of the maps [m/s], if these are to show less than the files do."""
    dynamic_range_db: float = DYNAMIC_RANGE_DB
    told: frozenset[str] = frozenset()
    """Names of the options that the card specified."""

    def __post_init__(self) -> None:
        checked_size(self.size)
        positive("speed_mps", self.speed_mps, 1e4, unit="m/s")
        positive("duration_s", self.duration_s, 1e5, unit="s")
        positive("dynamic_range_db", self.dynamic_range_db, 200, unit="dB")
        for name, unit in (("cell_mps", "m/s"), ("rate_hz", "Hz"), ("carrier_hz", "Hz")):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), unit=unit)
        for name, choices in (("positive", ("approaching", "receding")), ("mti", ("mean", "none"))):
            if getattr(self, name) is not None:
                choice(name, getattr(self, name), choices)
        if self.classes is not None and not (
            isinstance(self.classes, Mapping)
            and all(isinstance(name, str) for pair in self.classes.items() for name in pair)
        ):
            raise InputError(f"classes must map labels to classes, as {{walk to bed: walk}}, got {shown(self.classes)}")

    def with_card(self, source: Path) -> AdapterOptions:
        """These options completed by the card beside a file or in a folder; classes and adapter that are given take precedence."""
        path = card_path(source)
        if not path.is_file():
            return self
        card: dict[str, Any] = read_yaml(
            path, noun="card of real data", example="names and values such as carrier_hz: 77.0e+9"
        )
        for name in card:
            if name not in ON_CARD:
                raise unknown_name(f"name in {path}", name, ON_CARD)
        given_before = [name for name in ("adapter", "classes") if getattr(self, name) is not None]
        try:
            values = {name: value for name, value in card.items() if name not in given_before}
            return replace(self, **values, told=frozenset(values))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def of_cells(self, speeds: int, times: int) -> AdapterOptions:
        """These options for files with so many cells: speeds and duration follow from the width of a cell and the columns per
        second, if given."""
        speed_mps = self.speed_mps if self.cell_mps is None else 0.5 * self.cell_mps * speeds
        duration_s = self.duration_s if self.rate_hz is None else times / self.rate_hz
        return replace(self, speed_mps=speed_mps, duration_s=duration_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Adapter:
    """A reader for one kind of real data."""

    name: str
    about: str
    licence: str
    """Terms of use of the data, as far as they are known, in a sentence."""
    read: Callable[[Path, AdapterOptions], tuple[LabelledMaps, list[Path]]]
    """Function that reads maps, and returns them with the files from which they were read."""
    axes: Callable[[Path], Collection[str]] = lambda path: ()
    """Function that says which of `AXES` the files themselves specify."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RealMaps:
    """Maps of real recordings, and their origin."""

    maps: LabelledMaps
    adapter: str
    licence: str
    sha256: str
    """Hash over names and contents of all files that were read, including the card."""
    files: int
    carrier_hz: float | None = None
    mti: str | None = None
    """How static echoes were removed, if it is known."""
    assumed: tuple[str, ...] = ()
    """Axes that neither the files nor the card specify ("speeds" or "duration"), for which the options' values were assumed."""

    def __str__(self) -> str:
        counts = ", ".join(f"{name} {count}" for name, count in zip(self.maps.classes, self.maps.counts, strict=True))
        return (
            f"{len(self.maps)} maps ({counts}) of {self.files} files by {self.adapter}, SHA-256 {self.sha256[:16]}. "
            f"{self.licence}"
        )


@dataclass(frozen=True, slots=True)
class Piece:
    """One map in the form in which an adapter reads it."""

    power: np.ndarray
    """Power (speed, time) in any unit, over ascending speeds, positive = approaching."""
    label: str
    name: str
    groups: Mapping[str, str]


def content_hash(root: Path, files: list[Path]) -> str:
    """SHA-256 over the names relative to `root` and the contents of files, in the order of their names."""
    digest = hashlib.sha256()
    for path in sorted(files):
        name = path.relative_to(root if root.is_dir() else root.parent).as_posix()
        digest.update(f"{name}\0{path.stat().st_size}\0".encode())
        with regular_file(path, noun="file of real data") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def class_of(label: str, options: AdapterOptions) -> str | None:
    """The class of a label; None for a label that the user leaves out."""
    return label if options.classes is None else options.classes.get(label)


def class_names(labels: list[str], options: AdapterOptions, path: Path) -> tuple[str, ...]:
    """Names of the classes in order. All labels of the mapping must occur, so that a misspelt one is not taken for an empty
    class."""
    if options.classes is None:
        return tuple(sorted(set(labels)))
    for label in options.classes:
        if label not in labels:
            raise InputError(f"{path} has no class '{label}'; it has {', '.join(sorted(set(labels)))}")
    return tuple(dict.fromkeys(options.classes.values()))


def maps_from(
    pieces: Iterable[Piece], options: AdapterOptions, path: Path, all_labels: list[str], *, receding: bool = False
) -> LabelledMaps:
    """Labelled maps from pieces, which are resampled to a common size; only one piece is in memory at a time.

    receding: direction of positive speeds in the pieces, if the options do not specify it.
    """
    classes = class_names(all_labels, options, path)
    mirrored = receding if options.positive is None else options.positive == "receding"
    numbers: list[int] = []
    names: list[str] = []
    groups: dict[str, list[str]] = {}
    axes: AdapterOptions | None = None
    # Maps of a day of point clouds take gigabytes: they go into a file without a name, which the system frees with them.
    with tempfile.TemporaryFile(prefix="t2d-rt-") as file:
        for piece in pieces:
            if piece.power.ndim != 2 or min(piece.power.shape) < 2:
                raise InputError(
                    f"{path}: map {piece.name} must be an array of speeds and times, got shape {piece.power.shape}"
                )
            if not np.isfinite(piece.power).all():
                raise InputError(f"{path}: map {piece.name} has NaN or infinite cells; leave it out or repair it")
            piece_options = options.of_cells(*piece.power.shape)
            axes = piece_options if axes is None else axes
            if piece_options != axes:
                raise InputError(
                    f"{path}: map {piece.name} has {piece.power.shape} cells and so other axes than those before it"
                )
            levels = relative_levels(
                piece.power[::-1] if mirrored else piece.power,
                piece_options.size,
                piece_options.dynamic_range_db,
                _rows(piece_options, path),
            )
            check_varied(levels, f"{path}: map {piece.name}")
            file.write(levels.tobytes())
            numbers.append(classes.index(str(class_of(piece.label, options))))
            names.append(piece.name)
            for kind, value in piece.groups.items():
                groups.setdefault(kind, []).append(value)
        if axes is None:
            raise InputError(f"{path} holds no map of the classes {', '.join(classes)}; check the path and the classes")
        file.flush()
        stored = np.memmap(file, np.float32, "r", shape=(len(numbers), *axes.size))
    return LabelledMaps(
        levels=stored,
        labels=np.array(numbers),
        classes=classes,
        groups={kind: np.array(values) for kind, values in groups.items()},
        velocity_mps=axis(axes.cut_mps or (-axes.speed_mps, axes.speed_mps), axes.size[0]),
        duration_s=axes.duration_s,
        names=tuple(names),
    )


def _rows(options: AdapterOptions, path: Path) -> tuple[float, float]:
    """Where the maps begin and end on the files' axis of speeds, as fractions 0..1 of it; refuses speeds beyond it."""
    if options.cut_mps is None:
        return 0.0, 1.0
    first, last = (0.5 + 0.5 * speed_mps / options.speed_mps for speed_mps in options.cut_mps)
    if first < -1e-6 or last > 1 + 1e-6:
        low, high = options.cut_mps
        raise InputError(
            f"{path} shows {-options.speed_mps:.3g} to {options.speed_mps:.3g} m/s, and {low:.3g} to {high:.3g} m/s are wanted; "
            "take a set that covers these speeds"
        )
    return max(first, 0.0), min(last, 1.0)


def files_below(path: Path, endings: tuple[str, ...], noun: str) -> list[Path]:
    """Files in a folder and its subfolders, in order, without hidden ones."""
    folder = file_path(f"the folder of {noun}", path)
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; give the folder that holds one folder for each class of {noun}")
    candidates = (file for file in sorted(folder.rglob("*")) if file.suffix.lower() in endings)
    files = [file for file in candidates if not file.name.startswith(".") and file.is_file()]
    if not files:
        raise InputError(f"{folder} holds no {' or '.join(endings)} files; give the folder of {noun}")
    if len(files) > MAX_FILES:
        raise InputError(f"{folder} holds {len(files)} files, {MAX_FILES} are read at most; give a part of it")
    return files
