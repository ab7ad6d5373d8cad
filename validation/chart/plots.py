"""The chart itself: one panel for the README, and small ones for scenes and motions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from validation.chart.front import front, gap
from validation.chart.measure import Point
from validation.chart.methods import DEFAULT
from validation.report import new_figure, save_chart

IMAGES = Path(__file__).parents[2] / "docs" / "images"
STYLES = {
    "ellipsoids from the centre": ("C7", "v"),
    "ellipsoids from the specular point": ("C5", "^"),
    "Sionna RT's paths per pose": ("C8", "P"),
    "facets with one point each": ("C3", "s"),
    "facets in closed form": ("C0", "o"),
    "surface rate": ("C1", "D"),
    "visibility": ("C2", "X"),
    "wall order": ("C4", "p"),
    "float64 at every sample": ("k", "d"),
}
"""Colour and marker."""
FAR = 100.0
"""Points slower than that are named at the panel's right edge."""
ERROR_AXIS = "field error (NMSE) against the float64 reference [dB]"
TIME_AXIS = "seconds of computing per second of radar data"


def default_of(points: Sequence[Point]) -> Point:
    """The default setting's point."""
    return next(p for p in points if (p.method, p.knob) == DEFAULT)


def speed_accuracy(points: Sequence[Point]) -> None:
    """The README's chart."""
    figure, axis = new_figure(figsize=(7.75, 5))
    _panel(axis, points, labelled=True)
    default = default_of(points)
    axis.annotate(
        f"default: {default.seconds_per_second:.2g} s, {default.nmse_db:.0f} dB",
        (default.seconds_per_second, default.nmse_db), xytext=(-12, -26), textcoords="offset points", ha="right",
        arrowprops={"arrowstyle": "-", "color": "0.4"},
    )  # fmt: skip
    far = [p for p in points if p.seconds_per_second > FAR]
    if far:
        best = min(far, key=lambda p: p.nmse_db)
        high = axis.get_xlim()[1]
        axis.annotate(
            f"float64, every sample:\n{best.seconds_per_second:.0e} s, {best.nmse_db:.0f} dB", (high, best.nmse_db),
            xytext=(-130, 0), textcoords="offset points", va="center", fontsize=8, arrowprops={"arrowstyle": "->"},
        )  # fmt: skip
    axis.set(
        xlabel=TIME_AXIS + " (2 cores)",
        ylabel=ERROR_AXIS,
        title="a walk in free space, `table2`: faster is left, better is down",
    )
    axis.legend(fontsize=8, loc="lower left")
    save_chart(figure, "speed_accuracy.png", IMAGES)


def small_charts(cases: dict[tuple[str, str], list[Point]]) -> str:
    """Scenes in rows, motions in columns."""
    scenes, motions = (list(dict.fromkeys(names)) for names in zip(*cases, strict=True))
    figure, axes = new_figure(
        figsize=(4 * len(motions), 3.2 * len(scenes)), nrows=len(scenes), ncols=len(motions), squeeze=False, sharex=True,
        sharey=True,
    )  # fmt: skip
    for row, scene in zip(axes, scenes, strict=True):
        for axis, motion in zip(row, motions, strict=True):
            points = cases[scene, motion]
            _panel(axis, points, labelled=False)
            db, share = gap(points, default_of(points))
            axis.set_title(f"{scene}, {motion}: default off the front {db:.1f} dB, {100 * share:.0f} %", fontsize=9)
    handles: dict[str, Any] = {}
    for axis in axes.flat:
        handles |= dict(zip(*axis.get_legend_handles_labels()[::-1], strict=True))
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3, fontsize=9)
    figure.supxlabel(TIME_AXIS, fontsize=10)
    figure.supylabel(ERROR_AXIS, fontsize=10)
    return save_chart(figure, "chart_scenes.png")


def _panel(axis: Any, points: Sequence[Point], *, labelled: bool) -> None:
    shown = [p for p in points if p.seconds_per_second <= FAR]
    for method, (colour, marker) in STYLES.items():
        line = sorted((p for p in shown if p.method == method), key=lambda p: p.seconds_per_second)
        if line:
            joined = "" if method == "visibility" else "-"
            axis.plot(
                [p.seconds_per_second for p in line], [p.nmse_db for p in line], joined, color=colour, marker=marker,
                markersize=5, linewidth=1.2, label=method,
            )  # fmt: skip
            if labelled and method == "visibility":
                for p in line:
                    axis.annotate(
                        p.knob, (p.seconds_per_second, p.nmse_db), xytext=(6, 3), textcoords="offset points", fontsize=7
                    )
    best = front(shown)
    times, errors = [p.seconds_per_second for p in best], [p.nmse_db for p in best]
    axis.step([*times, max(p.seconds_per_second for p in shown)], [*errors, errors[-1]], where="post", color="0.6",
              linestyle=":", linewidth=2, zorder=0, label="Pareto front")  # fmt: skip
    default = default_of(points)
    axis.plot(default.seconds_per_second, default.nmse_db, "*", color="C0", markeredgecolor="k", markersize=15, label="default",
              linestyle="")  # fmt: skip
    axis.set_xscale("log")
    axis.grid(alpha=0.3, which="both")
