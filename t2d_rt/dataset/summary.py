"""Summary of a data set's folder, as figures and as pictures.

Balance of classes, lengths, SNR, Doppler extents, verdicts of the filter, remaining time of a run; a contact sheet class by class.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.checks import integer, positive
from t2d_rt.core.errors import InputError
from t2d_rt.dataset.dataset import Dataset
from t2d_rt.dataset.lock import in_use
from t2d_rt.dataset.products import axis
from t2d_rt.dataset.shards import SHARDS
from t2d_rt.dataset.splits import APART, grouped, source_clips
from t2d_rt.plots import VELOCITY_LABEL
from t2d_rt.plots.canvas import blank_figure, drawable
from t2d_rt.signal.envelope import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MEASURED = 64
"""Number of samples of a class whose Doppler extent is measured; the first ones represent all."""
SHARDS_TIMED = 6
"""Number of latest shards whose times give the speed of a run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassSummary:
    """Summary of one class; arrays have a value for each sample."""

    name: str
    samples: int
    descriptions: int
    passed: int
    """Number of motions that the filter accepts as ones of the class."""
    reason: str | None
    """Most frequent reason for which others do not pass; None where all pass."""
    made_s: np.ndarray
    """Durations of the motions before they were cut or held [s]."""
    snr_db: np.ndarray
    """Signal-to-noise ratios of the samples whose noise is known [dB]."""
    angle_deg: np.ndarray
    """Angles relative to the line to the radar [deg]."""
    range_m: np.ndarray
    """Mean ranges of the person [m]; empty for records of older versions, which also lack the next two."""
    approaching: np.ndarray
    """Of the time in which the person approaches or recedes, the fraction of approaching, for each sample."""
    moving: np.ndarray
    """Fractions of the record during which the person moves."""
    lower_mps: np.ndarray
    """Least speed in each of the first `MEASURED` spectrograms [m/s]; empty where there are none."""
    upper_mps: np.ndarray
    """Greatest speed in each of them [m/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Summary of a data set's folder."""

    name: str
    samples: int
    wanted: int
    """Number of samples in the whole recipe."""
    failures: tuple[str, ...]
    """Reasons for which samples failed."""
    classes: tuple[ClassSummary, ...]
    conditions: dict[str, int]
    parts: dict[str, float]
    """Fraction of the spectrograms' power that each part contributes, averaged over the first `MEASURED` samples."""
    errors_db: np.ndarray
    """Measured field errors [dB]."""
    clips: int
    """Number of source clips from which motions were made."""
    groups: tuple[int, ...]
    """Number of samples in each group that shares a description, clip or seed, the largest first."""
    seconds_left: float | None
    """Time until the run in this folder will have finished the recipe [s]; None where there is no run, or it has only begun."""

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.samples} of {self.wanted} samples, {len(self.failures)} failed"]
        lines += [f"  failed {count} times: {why}" for why, count in Counter(self.failures).most_common(3)]
        if self.seconds_left is not None:
            lines.append(f"a run goes on; at its rate the whole recipe is done in {_time(self.seconds_left)}")
        head = (
            "class", "samples", "descriptions", "pass", "made [s]", "SNR [dB]", "receding [m/s]", "approaching [m/s]",
        )  # fmt: skip
        lines += _table([head, *(_row(summary) for summary in self.classes)])
        balance = "class", "angle [deg]", "range [m]", "moving", "approaching"
        lines += _table([balance, *(_balance(summary) for summary in self.classes)])
        lines.append(
            "three figures: of 5 %, 50 % and 95 % of the samples; those of the second table should be alike in all classes"
        )
        lines += [
            f"{summary.name}: most that do not pass: {summary.reason}"
            for summary in self.classes
            if summary.reason is not None
        ]
        if len(self.conditions) > 1:
            lines.append("conditions: " + ", ".join(f"{name} {count}" for name, count in self.conditions.items()))
        if self.parts:
            lines.append("power by part: " + ", ".join(f"{name} {part:.1%}" for name, part in self.parts.items()))
        if len(self.errors_db):
            lines.append(f"field error of {len(self.errors_db)} samples: {_spread(self.errors_db)} dB")
        lines.append(
            f"{self.clips} source clips; by description, clip and seed the samples make {len(self.groups)} groups, the largest of "
            f"{self.groups[0]}"
        )
        return "\n".join(lines)


def summarise(dataset: Dataset | str | Path) -> Summary:
    """Summarises a data set, finished or not."""
    source = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
    records = source.records
    return Summary(
        name=source.recipe.name,
        samples=len(source),
        wanted=source.recipe.samples,
        failures=tuple(str(record["failure"]) for record in source.failed),
        classes=tuple(_class(source, number) for number in range(len(source.classes))),
        conditions=dict(Counter(str(record["condition"]) for record in records)),
        parts=_parts(source),
        errors_db=_values_of(records, "error_db"),
        clips=len(frozenset[str]().union(*(source_clips(record) for record in records))),
        groups=tuple(sorted(map(len, grouped(records, APART)), reverse=True)),
        seconds_left=_seconds_left(source),
    )


def _parts(dataset: Dataset) -> dict[str, float]:
    """Mean fraction of the power that each part contributes."""
    if not dataset.parts:
        return {}
    powers = [dataset.values(place, "parts").sum(axis=(1, 2)) for place in range(min(MEASURED, len(dataset)))]
    return dict(
        zip(dataset.parts, np.mean([power / max(power.sum(), 1e-30) for power in powers], axis=0).tolist(), strict=True)
    )


def _class(dataset: Dataset, number: int) -> ClassSummary:
    """Summary of the class of that index."""
    positions = np.flatnonzero(dataset.labels == number)
    records = [dataset.records[place] for place in positions]
    reasons = Counter(record["reasons"][0] for record in records if record["reasons"])
    extents = (
        np.array([extent(dataset, int(place)) for place in positions[:MEASURED]])
        if "spectrogram" in dataset.products
        else np.zeros((0, 2))
    ).reshape(-1, 2)
    return ClassSummary(
        name=dataset.classes[number],
        samples=len(records),
        descriptions=len({record["sentence"] for record in records}),
        passed=sum(bool(record["passed"]) for record in records),
        reason=reasons.most_common(1)[0][0] if reasons else None,
        made_s=_values_of(records, "made_s"),
        snr_db=_values_of(records, "snr_db"),
        angle_deg=_values_of(records, "angle_deg"),
        range_m=_values_of(records, "range_m"),
        approaching=_values_of(records, "approaching"),
        moving=_values_of(records, "moving"),
        lower_mps=extents[:, 0],
        upper_mps=extents[:, 1],
    )


def extent(dataset: Dataset, position: int) -> tuple[float, float]:
    """Least and greatest speed in a sample's spectrogram [m/s]."""
    levels = dataset.values(position, "spectrogram")
    edges = dataset.records[position]["products"]["spectrogram"]["velocity_mps"]
    return envelope(levels, axis(edges, len(levels))).extent_mps


def _values_of(records: Sequence[dict[str, Any]], name: str) -> np.ndarray:
    """The values of a field, from the records that have it."""
    return np.array([record[name] for record in records if record.get(name) is not None], dtype=np.float64)


def _seconds_left(dataset: Dataset) -> float | None:
    """Remaining time [s], from the times at which the latest shards were written; None without a run or two shards."""
    finished = sorted((path.stat().st_mtime, path) for path in (dataset.path / SHARDS).glob("*.jsonl"))[-SHARDS_TIMED:]
    if len(finished) < 2 or not in_use(dataset.path):
        return None
    # The time between two shards is that of the later one's samples; the median, because a run may have been interrupted.
    sample_s = [
        (last - first) / max(1, path.read_bytes().count(b"\n")) for (first, _), (last, path) in pairwise(finished)
    ]
    missing = dataset.recipe.samples - len(dataset) - len(dataset.failed)
    return float(np.median(sample_s)) * missing


def _row(summary: ClassSummary) -> tuple[str, ...]:
    """A row of the main table."""
    passed = f"{summary.passed / summary.samples:.0%}" if summary.samples else "-"
    figures = (_spread(values) for values in (summary.made_s, summary.snr_db, summary.lower_mps, summary.upper_mps))
    return summary.name, f"{summary.samples}", f"{summary.descriptions}", passed, *figures


def _balance(summary: ClassSummary) -> tuple[str, ...]:
    """A row of the table of figures that should not reveal the class."""
    figures = (
        _spread(summary.angle_deg, 0),
        _spread(summary.range_m),
        _spread(summary.moving, 2),
        _spread(summary.approaching, 2),
    )
    return summary.name, *figures


def _spread(values: np.ndarray, digits: int = 1) -> str:
    """The percentiles 5, 50 and 95, as text."""
    if not len(values):
        return "-"
    return " ".join(f"{percentile:.{digits}f}" for percentile in np.percentile(values, (5, 50, 95)))


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines of a table, with the first column aligned left and the others right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        )
        for row in rows
    ]


def _time(seconds: float) -> str:
    """A duration in seconds, minutes or hours, as text."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


CELL_IN = 1.45, 1.15
"""Width and height of a spectrogram [inch]."""
MARGINS_IN = 0.95, 1.0, 0.5, 0.1
"""Margins at the left, at the right, below and above [inch]."""
SHOWN = 98.0
"""Percentile of the samples' speeds that the axes include, so that a single fast sample does not compress the others."""
BRIGHT = 75.0
"""Percentile of the samples' peak levels at which the colours end; stronger samples are nearer, as power falls with the fourth
power of range."""


def dataset_sheet(dataset: Dataset, *, columns: int = 8, dynamic_range_db: float = 50.0) -> Figure:
    """Spectrograms of the first samples of each class, a row for each class, of as many descriptions as there are.

    All have the same axes and colours: from the noise, the median of all cells, to the greatest one of three samples out of
    four, but no more than `dynamic_range_db` [dB].
    """
    integer("columns", columns, 1, 32)
    positive("dynamic_range_db", dynamic_range_db, 200, unit="dB")
    dataset.checked("spectrogram")
    chosen = [_chosen(dataset, number, columns) for number in range(len(dataset.classes))]
    extents = np.array([extent(dataset, place) for row in chosen for place in row])
    speeds = -_greatest(-extents[:, 0]), _greatest(extents[:, 1])
    levels = {place: _levels(dataset, place) for row in chosen for place in row}
    top_db = float(np.percentile([level.max() for level in levels.values()], BRIGHT))
    noise_db = float(np.median([np.median(level) for level in levels.values()]))
    limits = max(noise_db, top_db - dynamic_range_db), top_db
    columns = min(columns, max(map(len, chosen)))
    figure, grid, scale_axes = _sheet(len(chosen), columns)
    image: Any = None
    for axes_row, places, name in zip(grid, chosen, dataset.classes, strict=True):
        for axes, place in zip(axes_row, places, strict=False):
            image = _draw(axes, dataset, place, levels[place], limits)
        for axes in axes_row[len(places) :]:
            axes.set_axis_off()
        axes_row[0].set_ylabel(name.replace("_", "\n"), fontsize=9)
    grid[0, 0].set_ylim(*speeds)  # the axes are shared
    bar = figure.colorbar(image, cax=scale_axes, extend="both")
    bar.set_label("Power [dB re 1 W]", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return figure


def _sheet(rows: int, columns: int) -> tuple[Figure, Any, Axes]:
    """A figure with axes in rows and columns, and axes for a colour bar; placed by hand, as a layout engine takes a minute for so
    many."""
    wide, tall = MARGINS_IN[0] + CELL_IN[0] * columns + MARGINS_IN[1], CELL_IN[1] * rows + MARGINS_IN[2] + MARGINS_IN[3]
    figure = blank_figure(wide, tall)
    figure.set_layout_engine("none")
    left, right = MARGINS_IN[0] / wide, 1 - MARGINS_IN[1] / wide
    bottom, top = MARGINS_IN[2] / tall, 1 - MARGINS_IN[3] / tall
    room = {"left": left, "right": right, "bottom": bottom, "top": top, "wspace": 0.05, "hspace": 0.08}
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False, gridspec_kw=room)
    for axes in grid.flat:
        axes.tick_params(labelsize=7, length=2)
    figure.text(0.5 * (left + right), 0.08 / tall, "Time [s]", fontsize=9, ha="center")
    figure.text(0.08 / wide, 0.5, VELOCITY_LABEL, fontsize=9, va="center", rotation="vertical")
    return figure, grid, figure.add_axes((right + 0.15 / wide, bottom, 0.14 / wide, top - bottom))


def _chosen(dataset: Dataset, number: int, columns: int) -> list[int]:
    """The first samples of a class, with different descriptions as far as possible."""
    places = np.flatnonzero(dataset.labels == number).tolist()
    place_by_sentence: dict[str, int] = {}
    for place in places:
        place_by_sentence.setdefault(dataset.records[place]["sentence"], place)
    first = sorted(place_by_sentence.values())
    return (first + [place for place in places if place not in set(first)])[:columns]


def _levels(dataset: Dataset, place: int) -> np.ndarray:
    """Levels of a spectrogram [dB re 1 W]."""
    return dataset.values(place, "spectrogram") + dataset.records[place]["products"]["spectrogram"]["peak_db"]


def _draw(axes: Axes, dataset: Dataset, place: int, levels_db: np.ndarray, limits_db: tuple[float, float]) -> Any:
    """Draws a sample into its axes; returns what `imshow` drew."""
    entry = dataset.records[place]["products"]["spectrogram"]
    extent = (*entry["time_s"], *entry["velocity_mps"])
    low, high = limits_db
    return axes.imshow(
        levels_db, origin="lower", aspect="auto", extent=extent, vmin=low, vmax=high, interpolation="none"
    )


def _greatest(speeds: np.ndarray) -> float:
    """A speed that nearly all samples stay below [m/s], in steps of one half."""
    return max(0.5, math.ceil(2.0 * float(np.percentile(speeds, SHOWN)) + 0.5) / 2.0)


def plot_summary(summary: Summary) -> Figure:
    """Draws, class by class: balance and verdicts, durations before cutting and holding, SNR, and Doppler extents."""
    if not summary.samples:
        raise InputError("there is no sample to draw; wait for the first shard")
    figure = blank_figure(9.0, 1.6 + 0.55 * len(summary.classes))
    balance, lengths, snr, extents = figure.subplots(2, 2, sharey=True).flat
    rows = np.arange(len(summary.classes))
    passed = np.array([class_summary.passed for class_summary in summary.classes])
    total = np.array([class_summary.samples for class_summary in summary.classes])
    balance.barh(rows, passed, color="tab:blue", label="pass the filter")
    balance.barh(rows, total - passed, left=passed, color="tab:orange", label="do not")
    balance.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    _boxes(lengths, [class_summary.made_s for class_summary in summary.classes], "tab:blue")
    _boxes(snr, [class_summary.snr_db for class_summary in summary.classes], "tab:blue")
    _boxes(extents, [class_summary.lower_mps for class_summary in summary.classes], "tab:red")
    _boxes(extents, [class_summary.upper_mps for class_summary in summary.classes], "tab:blue")
    extents.axvline(0, color="0.6", linewidth=0.8)
    labels = (
        "Samples",
        "Length of the motion as made [s]",
        "SNR [dB]",
        "Least and greatest speed [m/s], approaching > 0",
    )
    for axes, label in zip((balance, lengths, snr, extents), labels, strict=True):
        axes.set_xlabel(label, fontsize=9)
        axes.tick_params(labelsize=8)
        axes.grid(axis="x", color="0.9")
        axes.set_axisbelow(True)
    balance.set_yticks(rows, [class_summary.name.replace("_", " ") for class_summary in summary.classes])
    balance.invert_yaxis()
    title = f"{summary.name}: {summary.samples} of {summary.wanted} samples, {len(summary.failures)} failed"
    figure.suptitle(drawable("title", title), fontsize=10)
    return figure


def _boxes(axes: Axes, values: list[np.ndarray], colour: str) -> None:
    """Draws quartiles as boxes, and percentiles 5 and 95 as whiskers."""
    style = {"color": colour}
    axes.boxplot(
        values,
        positions=np.arange(len(values)),
        orientation="horizontal",
        whis=(5, 95),
        widths=0.55,
        showfliers=False,
        boxprops=style,
        whiskerprops=style,
        capprops=style,
        medianprops={"color": "black"},
        manage_ticks=False,
    )
