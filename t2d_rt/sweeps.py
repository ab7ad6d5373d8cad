"""Sweeps: one experiment with some of its fields varied; recordings stored as they are made, measures, pictures on one scale."""

from __future__ import annotations

import copy
import csv
import hashlib
import io
import itertools
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.accuracy import Wanted
from t2d_rt.core.atomic_write import check_place, replacing
from t2d_rt.core.backend import Device, one_blas_thread
from t2d_rt.core.checks import file_path, instance, positive, shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.plugins import versions
from t2d_rt.core.progress import ProgressBar, shown_progress
from t2d_rt.core.stored_arrays import Inputs, Store
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up_stored
from t2d_rt.pipeline.targets import placed
from t2d_rt.plots.canvas import Style, blank_figure, checked_width, drawable, peak_db
from t2d_rt.plots.figures import VELOCITY_LABEL, draw_map
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
    from matplotlib.figure import Figure

MOST_POINTS = 1000
"""Recordings of one sweep."""
CHECKED_CHIRPS = 2**16
"""Length of the record for which options of the spectrogram are checked before there is one."""
TABLE = "table.csv"
PICTURES = "panels.png", "panels.pdf"
"""What may stand beside the recordings."""
BESIDE = "accuracy", "tolerance_db", "signal"
"""What may be varied beside fields of the experiment."""
MEASURES = {
    "level_db": "level [dB re 1 W]", "peak_db": "peak [dB re 1 W]", "torso_speed_mps": "torso [m/s]",
    "limb_speed_mps": "limbs [m/s]", "level_difference_db": "level [dB]", "mean_difference_db": "cells [dB]",
    "field_difference_db": "field [dB]",
}  # fmt: skip
"""Measures of a recording, and how they are headed; the last three are differences from the first recording."""
DIFFERENCES = "level_difference_db", "mean_difference_db", "field_difference_db"


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One experiment of a sweep."""

    fields: Mapping[str, str]
    """Text of each varied field's value, by the field's name."""
    experiment: Experiment
    accuracy: Mapping[str, Any]
    """Fields of `Accuracy` that are given."""
    tolerance_db: float | None
    signal: Mapping[str, Any]
    """Options of its spectrogram."""
    file: str
    """Name of its recording in the folder."""

    @property
    def label(self) -> str:
        """What tells it from the others."""
        return ", ".join(self.fields.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Recordings of a sweep: printing it shows the table of their measures."""

    folder: Path
    points: tuple[Point, ...]
    measures: tuple[Mapping[str, float], ...]
    """Of each recording, by the names in `MEASURES`; NaN where the first one has other axes. The level is the mean of the
    spectrogram's cells, the difference of cells is the mean of its magnitude over those within 40 dB of the peak, that of the
    field is the energy of the samples' difference over that of the first one's, both without what is static."""
    spectrograms: tuple[xr.DataArray, ...]
    """(velocity_mps, time_s), dB re 1 W."""

    def recording(self, number: int) -> Recording:
        """One of the recordings, read from the folder."""
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
        return "\n".join(lines)

    def table(self) -> str:
        """CSV text of fields and measures, a row for each recording."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["recording", *self.points[0].fields, *MEASURES])
        for point, values in zip(self.points, self.measures, strict=True):
            numbers = ("" if math.isnan(values[name]) else f"{values[name]:.6g}" for name in MEASURES)
            writer.writerow([point.file, *point.fields.values(), *numbers])
        return text.getvalue()

    def plot(self, title: str | None = None, *, dynamic_range_db: float = 50.0, width_in: float = 7.0) -> Figure:
        """Spectrograms side by side on one scale, whose top is the greatest level of all [dB re 1 W]."""
        positive("dynamic_range_db", dynamic_range_db, 1000, unit="dB", hint="50 is usual")
        images = [(each.velocity_mps.values, each.time_s.values, each.values) for each in self.spectrograms]
        counts = [len({point.fields[name] for point in self.points}) for name in self.points[0].fields]
        columns = counts[-1] if len(counts) == 2 and counts[-1] <= 5 else None
        figure = _panels(
            images, [point.label for point in self.points], columns, dynamic_range_db, checked_width(width_in)
        )
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
    device: Device = "auto",
    progress: Progress | bool | None = None,
) -> Sweep:
    """Simulates an experiment with every combination of the values of some fields, and compares the recordings with the first.

    experiment: an `Experiment`, a mapping of fields, or a recording, whose accuracy holds unless a tolerance is given or varied.
    vary: values by the names of fields, as {"targets.1.rpm": [0, 300], "radar.prf_hz": [4000, 8000]}; those of the field that is
        named first change last. A whole target may be varied, and is left out where its value is None. Beside the experiment's own
        there are `tolerance_db`, the fields of `accuracy`, and as `signal.n_window` and the like the options of the spectrogram:
        what differs in these alone is simulated once.
    folder: where recordings are stored as they are made, and the table (table.csv); created if it is not there. A sweep that was
        stopped goes on. A folder that holds anything else, or recordings of other experiments or versions, is refused.
    accuracy, tolerance_db, device: as of `simulate`.
    processing: options of the spectrograms, as of `Recording.processed`.
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
            accuracy = {**experiment.accuracy.model_dump(mode="json"), **_given(accuracy)}
        inputs, experiment = experiment.inputs, experiment.experiment
    if not isinstance(experiment, Experiment):
        instance("experiment", experiment, Mapping, "an Experiment, a Recording or a mapping of an experiment's fields")
        experiment = Experiment.model_validate(experiment)
    given = {"accuracy": _given(accuracy), "tolerance_db": tolerance_db, "signal": dict(processing or {})}
    points, place = _points(experiment, vary, given), file_path("folder", folder)
    keys = [_key(point, inputs) for point in points]
    _check_folder(place, points, keys)
    place.mkdir(exist_ok=True)
    measures: list[dict[str, float]] = []
    images: list[xr.DataArray] = []
    first: Recording | None = None
    for number, (point, key) in enumerate(zip(points, keys, strict=True)):
        target = place / point.file
        if not target.exists():
            told = _progress(progress, number, points)
            try:
                alike = next((each for each in points[:number] if _same_samples(each, point)), None)
                made = Recording.load(place / alike.file) if alike else _simulated(point, inputs, device, told)
                made.processing.clear()
                made = made.processed(**point.signal)
                made.settings["sweep"] = key
                made.save(target)
            except KeyboardInterrupt as stopped:
                stopped.add_note(f"{place} holds {number} of {len(points)} recordings; the same command goes on")
                raise
        recording = Recording.load(target)
        measures.append(_measures(recording, first))
        first = recording if first is None else first
        images.append(recording.spectrogram)
    found = Sweep(folder=place, points=tuple(points), measures=tuple(measures), spectrograms=tuple(images))
    with replacing(place / TABLE, lambda: None) as new:
        new.write_text(found.table(), encoding="utf-8")
    return found


def _same_samples(one: Point, other: Point) -> bool:
    """Whether they differ in their spectrograms alone."""
    return (one.experiment, one.accuracy, one.tolerance_db) == (other.experiment, other.accuracy, other.tolerance_db)


def _simulated(point: Point, inputs: Inputs, device: Device, progress: Any) -> Recording:
    """The recording of one point, as `simulate` makes it."""
    wanted = Wanted.of(point.accuracy, point.tolerance_db)
    with one_blas_thread:
        setup = set_up_stored(point.experiment, inputs, device=device)
        return recorded(setup, wanted, device, shown_progress(progress, point.label))


def _points(experiment: Experiment, vary: Any, given: Mapping[str, Any]) -> list[Point]:
    """All combinations, the last field changing first; `given` are accuracy, tolerance and options of the spectrogram."""
    axes = []
    for name, values in vary.items():
        if isinstance(values, (str, Mapping)) or not isinstance(values, (Sequence, np.ndarray)) or not len(values):
            raise InputError(f"the values of {name} must be a list of at least one, got {shown(values)}")
        plain = [_plain(name, each) for each in values]
        texts = _texts(name, plain)
        if any(one == two for one, two in itertools.combinations(plain, 2)):
            raise InputError(f"the values of {name} must differ, got {', '.join(texts)}; give each once")
        axes.append([(name, value, text) for value, text in zip(plain, texts, strict=True)])
    count = math.prod(map(len, axes))
    if count > MOST_POINTS:
        raise InputError(f"a sweep takes at most {MOST_POINTS} recordings, got {count}; give fewer values")
    points = []
    for number, chosen in enumerate(itertools.product(*axes)):
        values = {**experiment.model_dump(mode="json"), **copy.deepcopy(dict(given))}
        for name, value, _ in chosen:
            _set(values, name, value)
        if isinstance(values["targets"], list):
            values["targets"] = [each for each in values["targets"] if each is not None]
        own = {name: values.pop(name) for name in BESIDE}
        Accuracy.model_validate(own["accuracy"])
        of = Experiment.model_validate(values)
        check_names(own["signal"])
        check_processing(of.radar, CHECKED_CHIRPS, own["signal"])
        texts = [text for *_, text in chosen]
        name = re.sub(r"[^A-Za-z0-9.+-]+", "_", "_".join(texts)).strip("_")[:80]
        points.append(
            Point(
                fields={name: text for name, _, text in chosen},
                experiment=of,
                **own,
                file=f"{number:03}_{name}.zarr",  # as many digits for any count, so that a sweep can grow
            )
        )
    return points


def _given(accuracy: Accuracy | Mapping[str, Any] | None) -> dict[str, Any]:
    """Fields of an accuracy that are given."""
    return accuracy.model_dump(exclude_unset=True) if isinstance(accuracy, Accuracy) else dict(accuracy or {})


def _plain(name: str, value: Any) -> Any:
    """A value as it stands in YAML; movers with all of their fields."""
    of_mover = isinstance(value, Mapping) and value.get("kind") in kind_names()
    if of_mover or (isinstance(value, str) and re.fullmatch(r"targets\.\d+", name)):
        value = mover(value)
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json")
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _texts(name: str, values: Sequence[Any]) -> list[str]:
    """What tells the values of a field apart: of targets their kinds and the fields that differ."""
    leaf = name.rpartition(".")[2]
    numbers = [each for each in values if isinstance(each, (int, float))]
    digits = next((each for each in range(6, 17) if len({f"{x:.{each}g}" for x in numbers}) == len(set(numbers))), 17)

    def text(value: Any) -> str:
        if value is None:
            return "without" if leaf.isdigit() else f"{leaf} none"
        if not isinstance(value, Mapping):
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            return f"{leaf} {value:.{digits}g}" if number else value if isinstance(value, str) else f"{leaf} {value}"
        alike = [each for each in values if isinstance(each, Mapping) and each.get("kind") == value.get("kind")]
        differs = [key for key in value if any(each.get(key) != value[key] for each in alike)]
        noun = str(value.get("animal") or value.get("kind") or leaf)
        told = [
            value[key] if isinstance(value[key], str) else f"{key} {value[key]}" for key in differs if key != "animal"
        ]
        return " ".join([noun, *map(str, told)]).replace(".0 ", " ").removesuffix(".0")

    return [text(value) for value in values]


def _set(values: dict[str, Any], name: str, value: Any) -> None:
    """Sets a field by its dotted name; the last part may be new, which the experiment then refuses by its name."""
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


def _key(point: Point, inputs: Inputs) -> str:
    """Hash of all that a recording depends on, the content of files included."""
    of, store = point.experiment, Store({})
    targets = [placed(each, of.radar) if isinstance(each, Motion) else each for each in of.targets_from(inputs)]
    named = of.scene_from(inputs)
    if isinstance(named, str):
        scene = None if named == "free_space" else load_scene(named, frequency_hz=of.radar.mid_frequency_hz)
    else:
        scene = named
    told = [of.stored_with(targets, scene, store).hash, point.accuracy, point.tolerance_db, point.signal, versions()]
    return hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()[:32]


def _check_folder(folder: Path, points: Sequence[Point], keys: Sequence[str]) -> None:
    """Refuses a folder that holds anything but recordings of this sweep, before any work is done."""
    if not folder.exists():
        check_place(folder, overwrite=False)
        return
    if not folder.is_dir():
        raise InputError(f"{folder} is a file and a sweep is a folder; choose another name")
    known = {point.file: key for point, key in zip(points, keys, strict=True)}
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name in (TABLE, *PICTURES):
            continue
        if path.name not in known:
            raise InputError(f"{folder} holds {path.name}, which is not of this sweep; choose another folder")
        made = Recording.load(path)
        if made.settings.get("sweep") != known[path.name]:
            other = [f"{name} {value}" for name, value in made.versions.items() if versions().get(name) != value]
            why = f"by other versions ({', '.join(other)})" if other else "of another experiment, file or setting"
            raise InputError(f"{path} was made {why}; choose another folder, or delete it")
    for point in points:
        check_place(folder / point.file, overwrite=True)


def _progress(progress: Any, number: int, points: Sequence[Point]) -> Any:
    if not callable(progress):
        return ProgressBar(f"{number + 1} of {len(points)}, {points[number].label}") if progress else None
    return lambda fraction: progress((number + fraction) / len(points))


def _measures(recording: Recording, first: Recording | None) -> dict[str, float]:
    """Measures of a recording and differences from the first, None for the first itself, by the names in `MEASURES`."""
    image = recording.spectrogram.values
    own = figures(recording)
    found = {
        "level_db": 10 * math.log10(np.mean(10 ** (image / 10))),
        "peak_db": float(image.max()),
        "torso_speed_mps": own.torso_speed_mps,
        "limb_speed_mps": own.limb_speed_mps,
    }
    if first is None:
        return found | {"level_difference_db": 0.0, "mean_difference_db": 0.0, "field_difference_db": -math.inf}
    if not same_axes(first, recording):
        return found | dict.fromkeys(DIFFERENCES, math.nan)
    seen = compare(first, recording)
    return found | {
        "level_difference_db": seen.level_difference_db,
        "mean_difference_db": seen.mean_difference_db,
        "field_difference_db": field_difference_db(first, recording),
    }


def _panels(
    images: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    labels: Sequence[str],
    columns: int | None,
    dynamic_range_db: float,
    width_in: float,
) -> Figure:
    """Spectrograms (speeds, times, levels) in a grid with common axes, one scale and one colour bar."""
    across = columns or (len(images) if len(images) < 4 else 2 if len(images) == 4 else 3 if len(images) < 10 else 4)
    down = -(-len(images) // across)
    top_db = max(peak_db(power_db) for *_, power_db in images)
    style = Style(limits_db=(top_db - dynamic_range_db, top_db), bar=False)
    figure = blank_figure(width_in, 0.7 + (1.45 if across > 1 else 1.9) * down * (width_in / 7) ** 0.5)
    grid = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    speeds = []
    for axes, (velocity_mps, time_s, power_db), label in zip(grid.flat, images, labels, strict=False):
        draw_map(axes, "spectrogram", velocity_mps, time_s, power_db, style=style, title=label)
        speeds.append(axes.get_ylim())
        axes.set(xlabel="", ylabel="")
    grid[0, 0].set_ylim(min(low for low, _ in speeds), max(high for _, high in speeds))  # the axes are shared
    for axes in grid.flat[len(images) :]:
        axes.set_axis_off()
    for number in range(max(0, len(images) - across), len(images)):  # above an empty place there are times, too
        grid.flat[number].tick_params(labelbottom=True)
    bar = figure.colorbar(grid[0, 0].collections[0], ax=grid, pad=0.015, aspect=30)
    bar.set_label("Power [dB re 1 W]", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    figure.supxlabel("Time [s]", fontsize=8)
    figure.supylabel(VELOCITY_LABEL if figure.get_size_inches()[1] > 2.8 else "Radial velocity [m/s]", fontsize=8)
    return figure


def _cell(value: float) -> str:
    return "" if math.isnan(value) else "-" if value == -math.inf else f"{value:.2f}"
