"""Sweeps: one experiment with some of its fields varied. Recordings are stored as they are made, then compared in a table and in
figures on one scale."""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.accuracy import Wanted
from t2d_rt.core.atomic_write import check_no_folder, check_place, replacing
from t2d_rt.core.backend import Device, one_blas_thread
from t2d_rt.core.checks import file_path, instance, shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import csv_text
from t2d_rt.core.plugins import versions
from t2d_rt.core.progress import ProgressBar, shown_progress
from t2d_rt.core.stored_arrays import Inputs, Store
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up_stored
from t2d_rt.pipeline.parts import Split, checked_split
from t2d_rt.pipeline.targets import placed
from t2d_rt.plots.canvas import Style, blank_figure, checked_width, drawable
from t2d_rt.plots.figures import panels
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.radar.synthesize import Progress
from t2d_rt.recording.compare import compare, field_difference_db, figures, same_axes
from t2d_rt.recording.recording import Recording
from t2d_rt.scene.movers import kind_names, mover
from t2d_rt.signal.doppler import check_names, check_processing
from t2d_rt.simulate import recorded
from t2d_rt.types import Accuracy, Motion

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_POINTS = 1000
"""Greatest number of recordings in one sweep."""
CHECKED_CHIRPS = 2**16
"""Number of chirps of an assumed record with which options of the spectrogram are checked before anything is simulated."""
TABLE = "table.csv"
PICTURES = "panels.png", "panels.pdf"
PARTS_TABLE, PARTS_PICTURES = "parts.csv", ("parts.png", "parts.pdf")
"""Files of a sweep's folder beside the recordings; the last ones are there where the recordings have parts."""
LEAST_LIMIT_DB = 3.0
"""Least limit of the colour scale of differences [dB]."""
MOST_WRITTEN = 8
"""Greatest number of columns of a figure for which numbers are written in its cells."""
MOST_PARTS = 20
"""Greatest number of parts that are printed and drawn: the strongest ones."""
BESIDE = "accuracy", "tolerance_db", "signal"
"""What may be varied beside the fields of the experiment."""
MEASURES = {
    "level_db": "level [dB re 1 W]", "peak_db": "peak [dB re 1 W]", "torso_speed_mps": "torso [m/s]",
    "limb_speed_mps": "limbs [m/s]", "level_difference_db": "level [dB]", "mean_difference_db": "cells [dB]",
    "field_difference_db": "field [dB]",
}  # fmt: skip
"""Measures of a recording and their headings in the table; the last three are differences from the first recording."""
DIFFERENCES = "level_difference_db", "mean_difference_db", "field_difference_db"


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One experiment of a sweep, with its accuracy and the options of its spectrogram."""

    fields: Mapping[str, str]
    """The value of each varied field as text, by the field's name."""
    experiment: Experiment
    accuracy: Mapping[str, Any]
    """The fields of `Accuracy` that are given."""
    tolerance_db: float | None
    """Greatest field error [dB]; None where the accuracy is used as it is given."""
    signal: Mapping[str, Any]
    """Options of the spectrogram."""
    file: str
    """File name of the recording in the sweep's folder."""

    @property
    def label(self) -> str:
        """A short text that distinguishes this experiment from the others of the sweep."""
        return ", ".join(self.fields.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """The recordings of a sweep. Printing it shows a table of their measures."""

    folder: Path
    points: tuple[Point, ...]
    measures: tuple[Mapping[str, float], ...]
    """Measures of each recording by the names in `MEASURES`; differences are NaN where the first recording has other axes. The
    level is the mean over the cells of the spectrogram. The difference of cells is the mean of its magnitude over the cells within
    40 dB of the peak. The difference of the field is the energy of the difference of the samples over that of the first recording's
    samples, both without static echoes."""
    spectrograms: tuple[xr.DataArray, ...]
    """Spectrograms (velocity_mps, time_s), dB re 1 W."""
    parts: xr.Dataset | None = None
    """Levels of the recordings' parts (recording, part), where they were simulated with `split`: `level_db` and
    `strongest_fraction` as in `Parts.levels`, and `level_difference_db` from the first recording [dB], NaN where one of the two has
    no such part. None without `split`."""

    def recording(self, number: int) -> Recording:
        """Reads one of the recordings from the folder."""
        return Recording.load(self.folder / self.points[number].file)

    def __str__(self) -> str:
        width = max(len(point.label) for point in self.points) + 2
        heads = list(MEASURES.values())
        sizes = [max(len(head) + 2, 10) for head in heads]
        lines = [" " * (width + sum(sizes[:4])) + "  differences from the first"]
        lines.append(" " * width + "".join(f"{head:>{size}}" for head, size in zip(heads, sizes, strict=True)))
        for point, values in zip(self.points, self.measures, strict=True):
            cells = (_cell(values[name]).rjust(size) for name, size in zip(MEASURES, sizes, strict=True))
            lines.append(f"{point.label:{width}}" + "".join(cells))
        return "\n".join(lines + ([] if self.parts is None else ["", *self._rows_of_parts(self.parts)]))

    def _rows_of_parts(self, parts: xr.Dataset) -> list[str]:
        """Rows of the printed table for the strongest parts, with a column for each recording."""
        strongest, labels = _strongest(parts), [point.label for point in self.points]
        rows = [["", *labels]]
        for name in strongest.part.values:
            cells = [strongest.isel(recording=number).sel(part=name) for number in range(len(labels))]
            rows.append([name, *(_part_cell(cell, with_fraction=True) for cell in cells)])
        widths = [max(len(row[k]) for row in rows) + 2 for k in range(len(rows[0]))]
        left_out = parts.sizes["part"] - strongest.sizes["part"]
        return [
            "level of each part [dB re 1 W] or its difference from the first [dB], the fraction where no part is stronger",
            *("".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows),
            *([f"and {left_out} more, weaker, in {PARTS_TABLE}"] if left_out else []),
        ]

    def table(self) -> str:
        """The measures as CSV text, with a row for each recording."""
        rows = [["recording", *self.points[0].fields, *MEASURES]]
        for point, values in zip(self.points, self.measures, strict=True):
            numbers = ("" if math.isnan(values[name]) else f"{values[name]:.6g}" for name in MEASURES)
            rows.append([point.file, *point.fields.values(), *numbers])
        return csv_text(rows)

    def parts_table(self) -> str:
        """The parts' levels as CSV text, with a row for each part of each recording."""
        parts = self._parts()
        names = list(map(str, parts.data_vars))
        rows = [["recording", *self.points[0].fields, "part", *names]]
        for number, point in enumerate(self.points):
            for row, part in enumerate(parts.part.values):
                values = [float(parts[name][number, row]) for name in names]
                if not math.isnan(values[0]):
                    numbers = ("" if math.isnan(value) else f"{value:.6g}" for value in values)
                    rows.append([point.file, *point.fields.values(), part, *numbers])
        return csv_text(rows)

    def _parts(self) -> xr.Dataset:
        if self.parts is None:
            raise InputError("the recordings have no parts; sweep with split='segment', 'path', 'target' or 'bounce'")
        return self.parts

    def plot(self, title: str | None = None, *, dynamic_range_db: float = 50.0, width_in: float = 7.0) -> Figure:
        """Draws the spectrograms side by side on one scale, whose top is the greatest level of all [dB re 1 W]."""
        images = [(image.velocity_mps.values, image.time_s.values, image.values) for image in self.spectrograms]
        counts = [len({point.fields[name] for point in self.points}) for name in self.points[0].fields]
        columns = counts[-1] if len(counts) == 2 and counts[-1] <= 5 else None
        style = Style(dynamic_range_db=dynamic_range_db, width_in=width_in)
        return panels(images, [point.label for point in self.points], style=style, columns=columns, title=title)

    def plot_parts(self, title: str | None = None, *, width_in: float = 7.0) -> Figure:
        """Draws the strongest parts of each recording: the difference of their levels from the first recording, whose own levels
        are written [dB], and the fraction of their power in cells where no other part is stronger."""
        strongest, labels = _strongest(self._parts()), [point.label for point in self.points]
        names = [drawable("names", str(value).replace("_", " ")) for value in strongest.part.values]
        figure = blank_figure(checked_width(width_in), 1.3 + 0.2 * len(names))
        left, right = figure.subplots(1, 2, sharey=True)
        change_db, fraction = strongest.level_difference_db.values.T.copy(), strongest.strongest_fraction.values.T
        change_db[:, 0] = np.nan  # the first recording shows its levels, as it has no difference from itself
        written = [
            [_part_cell(strongest.isel(part=row, recording=k)) for k in range(len(labels))] for row in range(len(names))
        ]
        limit_db = max(LEAST_LIMIT_DB, float(np.nanmax(np.abs(change_db), initial=0)))
        _draw_cells(
            left, change_db, written, labels, "RdBu_r", (-limit_db, limit_db), "Difference of level from the first [dB]"
        )
        written = [["" if np.isnan(cell) else f"{cell:.2f}" for cell in row] for row in fraction]
        _draw_cells(right, fraction, written, labels, "cividis", (0, 1), "Fraction of power where it is the strongest")
        left.set_yticks(range(len(names)), names, fontsize=7, parse_math=False)
        if title is not None:
            figure.suptitle(drawable("title", title), fontsize=10, parse_math=False)
        return figure


def sweep(
    experiment: Experiment | Recording | Mapping[str, Any],
    vary: Mapping[str, Sequence[Any]],
    folder: str | Path,
    *,
    accuracy: Accuracy | Mapping[str, Any] | None = None,
    tolerance_db: float | None = None,
    processing: Mapping[str, Any] | None = None,
    split: Split | None = None,
    device: Device = "auto",
    progress: Progress | bool | None = None,
) -> Sweep:
    """Simulates an experiment with every combination of the values of some fields, and compares the recordings with the first.

    experiment: an `Experiment`, a mapping of fields, or a recording, whose accuracy holds unless a tolerance is given or varied.
    vary: values by the names of fields, as in {"targets.1.rpm": [0, 300], "radar.prf_hz": [4000, 8000]}; the field that is named
        last changes fastest. A whole target may be varied, and is left out where its value is None. So may `tolerance_db`, fields
        of `accuracy`, and options of the spectrogram (`signal.n_window`); what differs only in the latter is simulated once.
    folder: where the recordings are stored as they are made, and the table (table.csv); created if it does not exist. A sweep that
        was stopped continues. A folder that holds anything else, or recordings of other experiments or versions, is refused.
    accuracy, tolerance_db, device: as in `simulate`.
    processing: options of the spectrograms, as in `Recording.processed`.
    split: as in `simulate`; the sweep then also shows how each part differs from that of the first recording (parts.csv).
    progress: True shows a bar for each recording; a function is called with the fraction done of all, 0..1.
    """
    if not isinstance(vary, Mapping) or not vary or not all(isinstance(name, str) for name in vary):
        raise InputError(f"vary must be values by the names of fields, as {{'seed': [0, 1]}}, got {shown(vary)}")
    inputs: Inputs = {}
    if isinstance(experiment, Recording):
        if experiment.experiment is None:
            raise InputError("the recording was measured and has no experiment; give an Experiment")
        # A tolerance chooses what is not given: the recorded accuracy would leave it nothing to choose.
        if experiment.accuracy is not None and tolerance_db is None and "tolerance_db" not in vary:
            accuracy = {**experiment.accuracy.model_dump(mode="json"), **_accuracy_fields(accuracy)}
        inputs, experiment = experiment.inputs, experiment.experiment
    if not isinstance(experiment, Experiment):
        instance("experiment", experiment, Mapping, "an Experiment, a Recording or a mapping of an experiment's fields")
        experiment = Experiment.model_validate(experiment)
    settings = {"accuracy": _accuracy_fields(accuracy), "tolerance_db": tolerance_db, "signal": dict(processing or {})}
    checked_split(split)
    points, place = _points(experiment, vary, settings), file_path("folder", folder)
    keys = [_key(point, inputs, split) for point in points]
    _check_folder(place, points, keys)
    place.mkdir(exist_ok=True)
    measures: list[dict[str, float]] = []
    images: list[xr.DataArray] = []
    levels: list[xr.Dataset] = []
    first: Recording | None = None
    for number, (point, key) in enumerate(zip(points, keys, strict=True)):
        target = place / point.file
        if not target.exists():
            report = _progress(progress, number, points)
            try:
                alike = next((earlier for earlier in points[:number] if _same_samples(earlier, point)), None)
                record = (
                    Recording.load(place / alike.file) if alike else _simulated(point, inputs, split, device, report)
                )
                record.processing.clear()
                record = record.processed(**point.signal)
                record.settings["sweep"] = key
                record.save(target)
            except KeyboardInterrupt as stopped:
                stopped.add_note(f"{place} holds {number} of {len(points)} recordings; the same command goes on")
                raise
        recording = Recording.load(target)
        measures.append(_measures(recording, first))
        first = recording if first is None else first
        images.append(recording.spectrogram)
        if split is not None:
            levels.append(recording.parts.levels())
    comparable = [not math.isnan(measure["level_difference_db"]) for measure in measures]
    result = Sweep(
        folder=place, points=tuple(points), measures=tuple(measures), spectrograms=tuple(images),
        parts=_compared(levels, comparable) if levels else None,
    )  # fmt: skip
    tables = {TABLE: result.table()} | ({PARTS_TABLE: result.parts_table()} if levels else {})
    for name, text in tables.items():
        with replacing(place / name, partial(check_no_folder, place / name)) as new:
            new.write_text(text, encoding="utf-8")
    return result


def _compared(levels: Sequence[xr.Dataset], comparable: Sequence[bool]) -> xr.Dataset:
    """Levels of the recordings' parts side by side, with differences from the first where the axes are the same."""
    import xarray as xr

    # One person's segments are named without the person; with several targets the name of the person stands before them.
    unprefixed = [
        level.assign_coords(part=[str(name).removeprefix("person: ") for name in level.part.values]) for level in levels
    ]
    names = dict.fromkeys(name for part_levels in unprefixed for name in part_levels.part.values)
    combined = xr.concat(
        [part_levels.reindex(part=list(names)) for part_levels in unprefixed], dim="recording", combine_attrs="override"
    )
    differences = (combined.level_db - combined.level_db[0]).where(xr.DataArray(list(comparable), dims="recording"))
    return combined.assign(level_difference_db=differences.assign_attrs(units="dB")).assign_coords(
        recording=range(len(levels))
    )


def _strongest(parts: xr.Dataset) -> xr.Dataset:
    """The parts that are strongest in any of the recordings, in the order in which they were given."""
    order = np.argsort(-parts.level_db.max("recording").values, kind="stable")
    return parts.isel(part=np.sort(order[:MOST_PARTS]))


def _part_cell(of: xr.Dataset, *, with_fraction: bool = False) -> str:
    """Text of the cell for a part of a recording: its level difference, or its level in the first recording or where there is no
    difference."""
    level_db, change_db = float(of.level_db), float(of.level_difference_db)
    if math.isnan(level_db):
        return ""
    text = f"{level_db:.1f}" if math.isnan(change_db) or not of.recording else f"{change_db:+.1f}"
    return f"{text} ({float(of.strongest_fraction):.2f})" if with_fraction else text


def _draw_cells(
    axes: Axes, values: np.ndarray, written: Sequence[Sequence[str]], labels: Sequence[str], cmap: str,
    limits: tuple[float, float], title: str,
) -> None:  # fmt: skip
    """Draws values (row, column) as coloured cells, and writes texts into them where there are few columns."""
    image = axes.imshow(values, aspect="auto", cmap=cmap, vmin=limits[0], vmax=limits[1])
    if len(labels) <= MOST_WRITTEN:
        for (row, column), colour in np.ndenumerate(image.norm(np.nan_to_num(values))):
            dark = colour < 0.5 if cmap == "cividis" else abs(colour - 0.5) > 0.35
            hue = "white" if dark and np.isfinite(values[row, column]) else "black"
            axes.text(column, row, written[row][column], ha="center", va="center", fontsize=6, color=hue)
    upright = len(labels) > MOST_WRITTEN
    tick_labels = [
        drawable("labels", label) if upright else textwrap.fill(drawable("labels", label), 50 // len(labels))
        for label in labels
    ]
    axes.set_xticks(range(len(labels)), tick_labels, fontsize=7, rotation=90 * upright, parse_math=False)
    axes.set_title(title, fontsize=8)


def _same_samples(one: Point, other: Point) -> bool:
    """Whether two experiments differ at most in the options of their spectrograms, so that one simulation serves both."""
    return (one.experiment, one.accuracy, one.tolerance_db) == (other.experiment, other.accuracy, other.tolerance_db)


def _simulated(point: Point, inputs: Inputs, split: Split | None, device: Device, progress: Any) -> Recording:
    """The recording of one experiment of the sweep, as `simulate` makes it."""
    wanted = Wanted.of(point.accuracy, point.tolerance_db)
    with one_blas_thread:
        setup = set_up_stored(point.experiment, inputs, device=device)
        return recorded(setup, wanted, device, shown_progress(progress, point.label), split)


def _points(experiment: Experiment, vary: Any, settings: Mapping[str, Any]) -> list[Point]:
    """All combinations of the varied values, the field named last changing fastest; `settings` are accuracy, tolerance and options
    of the spectrogram."""
    axes = []
    for name, values in vary.items():
        if isinstance(values, (str, Mapping)) or not isinstance(values, (Sequence, np.ndarray)) or not len(values):
            raise InputError(f"the values of {name} must be a list of at least one, got {shown(values)}")
        plain_values = [_as_in_yaml(name, value) for value in values]
        texts = _texts(name, plain_values)
        if any(one == two for one, two in itertools.combinations(plain_values, 2)):
            raise InputError(f"the values of {name} must differ, got {', '.join(texts)}; give each once")
        axes.append([(name, value, text) for value, text in zip(plain_values, texts, strict=True)])
    count = math.prod(map(len, axes))
    if count > MOST_POINTS:
        raise InputError(f"a sweep takes at most {MOST_POINTS} recordings, got {count}; give fewer values")
    points = []
    for number, chosen in enumerate(itertools.product(*axes)):
        values = {**experiment.model_dump(mode="json"), **copy.deepcopy(dict(settings))}
        for name, value, _ in chosen:
            _set(values, name, value)
        if isinstance(values["targets"], list):
            values["targets"] = [target for target in values["targets"] if target is not None]
        beside = {name: values.pop(name) for name in BESIDE}
        Accuracy.model_validate(beside["accuracy"])
        varied = Experiment.model_validate(values)
        check_names(beside["signal"])
        check_processing(varied.radar, CHECKED_CHIRPS, beside["signal"])
        texts = [text for *_, text in chosen]
        name = re.sub(r"[^A-Za-z0-9.+-]+", "_", "_".join(texts)).strip("_")[:80]
        points.append(
            Point(
                fields={name: text for name, _, text in chosen},
                experiment=varied,
                **beside,
                file=f"{number:03}_{name}.zarr",  # three digits whatever the count is, so that a sweep can grow
            )
        )
    return points


def _accuracy_fields(accuracy: Accuracy | Mapping[str, Any] | None) -> dict[str, Any]:
    """The fields that are set in an accuracy, by name."""
    return accuracy.model_dump(exclude_unset=True) if isinstance(accuracy, Accuracy) else dict(accuracy or {})


def _as_in_yaml(name: str, value: Any) -> Any:
    """A value as YAML would hold it; movers with all of their fields."""
    of_mover = isinstance(value, Mapping) and value.get("kind") in kind_names()
    if of_mover or (isinstance(value, str) and re.fullmatch(r"targets\.\d+", name)):
        value = mover(value)
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json")
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _texts(name: str, values: Sequence[Any]) -> list[str]:
    """A short text for each value of a field, by which the values can be told apart: for targets, their kinds and the fields in
    which they differ."""
    leaf = name.rpartition(".")[2]
    numbers = [number for number in values if isinstance(number, (int, float))]
    digits = next((n for n in range(6, 17) if len({f"{x:.{n}g}" for x in numbers}) == len(set(numbers))), 17)

    def text(value: Any) -> str:
        if value is None:
            return "without" if leaf.isdigit() else f"{leaf} none"
        if not isinstance(value, Mapping):
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            return f"{leaf} {value:.{digits}g}" if number else value if isinstance(value, str) else f"{leaf} {value}"
        alike = [other for other in values if isinstance(other, Mapping) and other.get("kind") == value.get("kind")]
        differs = [key for key in value if any(other.get(key) != value[key] for other in alike)]
        noun = str(value.get("animal") or value.get("kind") or leaf)
        details = [
            value[key] if isinstance(value[key], str) else f"{key} {value[key]}" for key in differs if key != "animal"
        ]
        return " ".join([noun, *map(str, details)]).replace(".0 ", " ").removesuffix(".0")

    return [text(value) for value in values]


def _set(values: dict[str, Any], name: str, value: Any) -> None:
    """Sets a field by its dotted name, in place. The last part of the name may be new: the experiment then refuses it by name."""
    *parts, leaf = name.split(".")
    place: Any = values
    for part in parts:
        inside = _inside(place, part)
        if isinstance(inside, str) or inside is None:
            raise InputError(
                f"there is no field {name} to vary, as {part} is {shown(inside)}; give an experiment that has one"
            )
        place = inside
    if isinstance(place, list):
        _inside(place, leaf)
        place[int(leaf)] = value
    elif not parts and leaf not in values:
        raise InputError(f"there is no field {leaf} to vary; choose from {', '.join(values)}")
    else:
        place[leaf] = value


def _inside(place: Any, part: str) -> Any:
    if isinstance(place, list):
        if not part.isdigit() or int(part) >= len(place):
            raise InputError(f"there is no number {part} to vary among {len(place)}; they are counted from 0")
        return place[int(part)]
    if part not in place:
        raise InputError(f"there is no field {part} to vary; choose from {', '.join(place)}")
    return place[part]


def _key(point: Point, inputs: Inputs, split: Split | None) -> str:
    """Hash of everything that a recording depends on, including the content of input files; a stored recording with the same hash
    is used again."""
    experiment, store = point.experiment, Store({})
    targets = [
        placed(target, experiment.radar) if isinstance(target, Motion) else target
        for target in experiment.targets_from(inputs)
    ]
    named = experiment.scene_from(inputs)
    if isinstance(named, str):
        scene = None if named == "free_space" else load_scene(named, frequency_hz=experiment.radar.mid_frequency_hz)
    else:
        scene = named
    hashed = [
        experiment.stored_with(targets, scene, store).hash,
        point.accuracy,
        point.tolerance_db,
        point.signal,
        versions(),
    ]
    hashed += [] if split is None else [split]
    return hashlib.sha256(json.dumps(hashed, sort_keys=True, default=str).encode()).hexdigest()[:32]


def _check_folder(folder: Path, points: Sequence[Point], keys: Sequence[str]) -> None:
    """Refuses a folder that holds anything but recordings of this sweep, before any work is done."""
    if not folder.exists():
        check_place(folder, overwrite=False)
        return
    if not folder.is_dir():
        raise InputError(f"{folder} is a file and a sweep is a folder; choose another name")
    key_by_file = {point.file: key for point, key in zip(points, keys, strict=True)}
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name in (TABLE, *PICTURES, PARTS_TABLE, *PARTS_PICTURES):
            continue
        if path.name not in key_by_file:
            raise InputError(f"{folder} holds {path.name}, which is not of this sweep; choose another folder")
        recording = Recording.load(path)
        if recording.settings.get("sweep") != key_by_file[path.name]:
            changed = [f"{name} {value}" for name, value in recording.versions.items() if versions().get(name) != value]
            why = f"by other versions ({', '.join(changed)})" if changed else "of another experiment, file or setting"
            raise InputError(f"{path} was made {why}; choose another folder, or delete it")
    for point in points:
        check_place(folder / point.file, overwrite=True)


def _progress(progress: Any, number: int, points: Sequence[Point]) -> Any:
    if not callable(progress):
        return ProgressBar(f"{number + 1} of {len(points)}, {points[number].label}") if progress else None
    return lambda fraction: progress((number + fraction) / len(points))


def _measures(recording: Recording, first: Recording | None) -> dict[str, float]:
    """Measures of a recording and its differences from the first recording (None for the first itself), by the names in
    `MEASURES`."""
    image = recording.spectrogram.values
    main_figures = figures(recording)
    measures = {
        "level_db": 10 * math.log10(np.mean(10 ** (image / 10))),
        "peak_db": float(image.max()),
        "torso_speed_mps": main_figures.torso_speed_mps,
        "limb_speed_mps": main_figures.limb_speed_mps,
    }
    if first is None:
        return measures | {"level_difference_db": 0.0, "mean_difference_db": 0.0, "field_difference_db": -math.inf}
    if not same_axes(first, recording):
        return measures | dict.fromkeys(DIFFERENCES, math.nan)
    comparison = compare(first, recording)
    return measures | {
        "level_difference_db": comparison.level_difference_db,
        "mean_difference_db": comparison.mean_difference_db,
        "field_difference_db": field_difference_db(first, recording),
    }


def _cell(value: float) -> str:
    return "" if math.isnan(value) else "-" if value == -math.inf else f"{value:.2f}"
