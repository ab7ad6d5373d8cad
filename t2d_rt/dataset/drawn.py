"""Pictures of a data set: a contact sheet of spectrograms class by class, and the summary."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.checks import integer, positive
from t2d_rt.core.errors import InputError
from t2d_rt.dataset.stored import Dataset
from t2d_rt.dataset.summary import Summary
from t2d_rt.dataset.summary import extent as extent_of
from t2d_rt.plots import VELOCITY_LABEL
from t2d_rt.plots.canvas import blank_figure, drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CELL_IN = 1.45, 1.15
"""Width and height of one spectrogram [inch]."""
MARGINS_IN = 0.95, 1.0, 0.5, 0.1
"""Room at the left, at the right, below and above them [inch]."""
SHOWN = 98.0
"""Percentile of the samples' speeds that the axes show: one that is faster than all others does not flatten them."""
BRIGHT = 75.0
"""Percentile of the samples' greatest levels that the colours tell apart: the others are nearer, by the fourth power of range."""


def dataset_sheet(dataset: Dataset, *, columns: int = 8, dynamic_range_db: float = 50.0) -> Figure:
    """Spectrograms of the first samples of each class, a row for each class, of as many descriptions as there are.

    All have the same axes and colours: from the noise, the median of all cells, to the greatest one of three samples out of
    four, but no more than `dynamic_range_db` [dB].
    """
    integer("columns", columns, 1, 32)
    positive("dynamic_range_db", dynamic_range_db, 200, unit="dB")
    dataset.checked("spectrogram")
    chosen = [_chosen(dataset, number, columns) for number in range(len(dataset.classes))]
    extents = np.array([extent_of(dataset, place) for row in chosen for place in row])
    speeds = -_greatest(-extents[:, 0]), _greatest(extents[:, 1])
    levels = {place: _levels(dataset, place) for row in chosen for place in row}
    top_db = float(np.percentile([each.max() for each in levels.values()], BRIGHT))
    noise_db = float(np.median([np.median(each) for each in levels.values()]))
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
    """A figure with axes in rows and columns, and those of a colour bar; a layout engine takes a minute for as many."""
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
    """The first samples of a class, each of another description as far as there are others."""
    places = np.flatnonzero(dataset.labels == number).tolist()
    seen: dict[str, int] = {}
    for place in places:
        seen.setdefault(dataset.records[place]["sentence"], place)
    first = sorted(seen.values())
    return (first + [place for place in places if place not in set(first)])[:columns]


def _levels(dataset: Dataset, place: int) -> np.ndarray:
    """A spectrogram's levels [dB re 1 W]."""
    return dataset.values(place, "spectrogram") + dataset.records[place]["products"]["spectrogram"]["peak_db"]


def _draw(axes: Axes, dataset: Dataset, place: int, levels_db: np.ndarray, limits_db: tuple[float, float]) -> Any:
    told = dataset.records[place]["products"]["spectrogram"]
    extent = (*told["time_s"], *told["velocity_mps"])
    low, high = limits_db
    return axes.imshow(
        levels_db, origin="lower", aspect="auto", extent=extent, vmin=low, vmax=high, interpolation="none"
    )


def _greatest(speeds: np.ndarray) -> float:
    """A speed that nearly all samples keep to [m/s], in halves."""
    return max(0.5, math.ceil(2.0 * float(np.percentile(speeds, SHOWN)) + 0.5) / 2.0)


def plot_summary(summary: Summary) -> Figure:
    """Class balance and verdicts, lengths before cutting and holding, SNR, and Doppler extents, class by class."""
    if not summary.samples:
        raise InputError("there is no sample to draw; wait for the first shard")
    figure = blank_figure(9.0, 1.6 + 0.55 * len(summary.classes))
    balance, lengths, snr, extents = figure.subplots(2, 2, sharey=True).flat
    rows = np.arange(len(summary.classes))
    passed = np.array([each.passed for each in summary.classes])
    total = np.array([each.samples for each in summary.classes])
    balance.barh(rows, passed, color="tab:blue", label="pass the filter")
    balance.barh(rows, total - passed, left=passed, color="tab:orange", label="do not")
    balance.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    _boxes(lengths, [each.made_s for each in summary.classes], "tab:blue")
    _boxes(snr, [each.snr_db for each in summary.classes], "tab:blue")
    _boxes(extents, [each.lower_mps for each in summary.classes], "tab:red")
    _boxes(extents, [each.upper_mps for each in summary.classes], "tab:blue")
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
    balance.set_yticks(rows, [each.name.replace("_", " ") for each in summary.classes])
    balance.invert_yaxis()
    title = f"{summary.name}: {summary.samples} of {summary.wanted} samples, {len(summary.failures)} failed"
    figure.suptitle(drawable("title", title), fontsize=10)
    return figure


def _boxes(axes: Axes, values: list[np.ndarray], colour: str) -> None:
    """Quartiles as a box, 5 and 95 % as whiskers."""
    style = {"color": colour}
    axes.boxplot(
        values, positions=np.arange(len(values)), orientation="horizontal", whis=(5, 95), widths=0.55, showfliers=False,
        boxprops=style, whiskerprops=style, capprops=style, medianprops={"color": "black"}, manage_ticks=False,
    )  # fmt: skip
