"""The chart itself: one panel for the README, and small ones for scenes and motions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from validation.methods.chart.front import Error, error_of, front, gap
from validation.methods.chart.measure import Point
from validation.methods.chart.methods import DEFAULT, SUMMED
from validation.report import new_figure, save_chart

IMAGES = Path(__file__).parents[3] / "docs" / "images"
STYLES = {
    "ellipsoids from the centre": ("C7", "v"),
    "ellipsoids from the specular point": ("C5", "^"),
    "Sionna RT's paths per pose": ("C8", "P"),
    "facets with one point each": ("C3", "s"),
    "facets in closed form": ("C0", "o"),
    "surface rate": ("C1", "D"),
    "visibility": ("C2", "X"),
    "wall order": ("C4", "p"),
    "by tolerance": ("C6", "h"),
    "float64 at every sample": ("k", "d"),
}
"""Colour and marker."""
FAR = 100.0
"""Points slower than that are named at the panel's right edge."""
ERROR_AXIS = "field error (NMSE) against the float64 reference [dB]"
ERROR_AXES: dict[Error, str] = {
    "nmse_db": ERROR_AXIS, "spectrogram_db": "RMS difference of spectrograms within 40 dB of the peak [dB]",
}  # fmt: skip
TIME_AXIS = "seconds of computing per second of radar data"


def default_of(points: Sequence[Point]) -> Point:
    """The default setting's point."""
    return next(p for p in points if (p.method, p.knob) == DEFAULT)


def speed_accuracy(points: Sequence[Point]) -> None:
    """The README's chart."""
    figure, axis = new_figure(figsize=(7.75, 6))
    _panel(axis, points)
    db, longer = gap(points, default_of(points))
    default, finest = default_of(points), _finest(points, "facets with one point each")
    for p, offset in ((default, (-24, -38)), (finest, (-14, -6)), (_finest(points, "facets in closed form"), (8, -10))):
        name = f"default, {db:.1f} dB and {100 * longer:.0f} %\noff the front: " if p is default else ""
        axis.annotate(
            f"{name}{round(int(p.facets), -3):,} facets".replace(",", " "), (p.seconds_per_second, p.nmse_db), xytext=offset,
            textcoords="offset points", ha="left" if offset[0] > 0 else "right", fontsize=8,
        )  # fmt: skip
    for p in points:
        if p.method == "visibility" and p.knob == "finest":
            where = p.seconds_per_second, p.nmse_db
            axis.annotate(
                "finest visibility", where, xytext=(0, 7), textcoords="offset points", ha="center", fontsize=8
            )
    in_float64 = min((p for p in points if p.method == "float64 at every sample"), key=lambda p: p.seconds_per_second)
    axis.annotate(
        f"float64, flat facets, every sample:\n{in_float64.seconds_per_second:,.0f} s, {in_float64.nmse_db:.0f} dB", (1, 0.62),
        xytext=(-14, 0), xycoords="axes fraction", textcoords="offset points", va="center", ha="right", fontsize=8,
        arrowprops={"arrowstyle": "->"},
    )  # fmt: skip
    summed = min((p for p in points if p.method == SUMMED), key=lambda p: abs(p.nmse_db - default.nmse_db))
    axis.annotate(
        f"one point each, summed\nchirp by chirp: {summed.seconds_per_second:,.0f} s, {summed.nmse_db:.0f} dB", (1, 0.42),
        xytext=(-14, 0), xycoords="axes fraction", textcoords="offset points", va="center", ha="right", fontsize=8,
        arrowprops={"arrowstyle": "->"},
    )  # fmt: skip
    axis.set(xlabel=TIME_AXIS, ylabel=ERROR_AXIS, title="A walk in free space: left is faster, down is more accurate")
    figure.legend(fontsize=8.5, loc="outside lower center", ncols=3)
    save_chart(figure, "speed_accuracy.png", IMAGES)


def _finest(points: Sequence[Point], method: str) -> Point:
    return max((p for p in points if p.method == method), key=lambda p: int(p.facets or 0))


def small_charts(cases: dict[tuple[str, str], list[Point]], error: Error) -> str:
    """Scenes in rows, motions in columns."""
    scenes, motions = (list(dict.fromkeys(names)) for names in zip(*cases, strict=True))
    figure, axes = new_figure(
        figsize=(4 * len(motions), 3.2 * len(scenes)), nrows=len(scenes), ncols=len(motions), squeeze=False, sharex=True,
        sharey=True,
    )  # fmt: skip
    for row, scene in zip(axes, scenes, strict=True):
        for axis, motion in zip(row, motions, strict=True):
            points = cases[scene, motion]
            _panel(axis, points, error)
            db, longer = gap(points, default_of(points), error)
            axis.set_title(f"{scene}, {motion}: default off the front {db:.1f} dB, {100 * longer:.0f} %", fontsize=9)
    handles: dict[str, Any] = {}
    for axis in axes.flat:
        handles |= dict(zip(*axis.get_legend_handles_labels()[::-1], strict=True))
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3, fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel(TIME_AXIS, fontsize=9)
    figure.supylabel(ERROR_AXES[error], fontsize=10)
    return save_chart(figure, "chart_scenes.png" if error == "nmse_db" else "chart_spectrograms.png")


def _panel(axis: Any, points: Sequence[Point], error: Error = "nmse_db") -> None:
    shown = [p for p in points if p.seconds_per_second <= FAR and math.isfinite(error_of(p, error))]
    best = front(shown, error)
    times, errors = [p.seconds_per_second for p in best], [error_of(p, error) for p in best]
    axis.step(
        [*times, max(p.seconds_per_second for p in shown)], [*errors, errors[-1]], where="post", color="0.75", linewidth=5,
        zorder=0, label="Pareto front",
    )  # fmt: skip
    for method, (colour, marker) in STYLES.items():
        line = sorted((p for p in shown if p.method == method), key=lambda p: _order(p.knob))
        if line:
            axis.plot(
                [p.seconds_per_second for p in line], [error_of(p, error) for p in line], "-",
                color=colour, marker=marker, markersize=5, linewidth=1.2, label=method,
            )  # fmt: skip
    default = default_of(points)
    axis.plot(
        default.seconds_per_second, error_of(default, error), "*", color="gold", markeredgecolor="k", markersize=15,
        linestyle="none", label="default", zorder=5,
    )  # fmt: skip
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.grid(alpha=0.3, which="both")


def _order(knob: str) -> float:
    """Along its line."""
    try:
        return float(knob.split()[0])
    except ValueError:
        return 0.0
