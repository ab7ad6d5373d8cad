"""Charts of the benchmark: fractions of time by stage, and time over each swept variable."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from validation.bench.sections import Found, Sweep, power_law, seconds, synthesis_seconds
from validation.bench.stages import STAGES
from validation.report import new_figure, save_chart


def stage_chart(cases: Found, folder: Path) -> str:
    """A bar for each case, its stages side by side."""
    figure, axis = new_figure(figsize=(10, 1.8 + 0.34 * len(cases)))
    place = np.arange(len(cases))
    left = np.zeros(len(cases))
    totals = np.array([sum(each["stages"].values()) for each in cases])
    for number, stage in enumerate(STAGES):
        fraction = 100 * np.array([each["stages"][stage] for each in cases]) / totals
        axis.barh(place, fraction, left=left, color=f"C{number}", label=stage)
        left += fraction
    axis.set_yticks(place, [f"{each['name']} ({each['duration_s']:g} s)" for each in cases])
    for row, total in zip(place, totals, strict=True):
        axis.text(101, row, f"{total:.2g} s", va="center")
    axis.set(xlabel="fraction of the time, stages one after another [%]", xlim=(0, 108))
    axis.invert_yaxis()
    axis.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.4, 1.0), frameon=False)
    return save_chart(figure, "stages.png", folder)


def sweep_chart(sweeps: list[tuple[Sweep, Found]], folder: Path) -> str:
    """Seconds and those of synthesis over each variable, with the power laws fitted."""
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter, StrMethodFormatter

    figure, axes = new_figure(nrows=2, ncols=3, sharey=True, figsize=(12, 7))
    for axis, (sweep, found) in zip(axes.flat, sweeps, strict=False):
        x = sweep.values(found)
        _series(axis, x, seconds(found), "all", "C0")
        _series(axis, x, synthesis_seconds(found), "synthesis", "C4")
        axis.set(xscale="log", yscale="log", xlabel=sweep.axis, ylabel="time [s]")
        for scale, formatter in ((axis.xaxis, EngFormatter()), (axis.yaxis, StrMethodFormatter("{x:g}"))):
            scale.set_major_locator(LogLocator(subs=(1, 2, 5)))
            scale.set_major_formatter(formatter)
            scale.set_minor_formatter(NullFormatter())
        axis.tick_params(labelleft=True)
        axis.grid(alpha=0.3)
        axis.legend()
    for axis in axes.flat[len(sweeps) :]:
        axis.set_axis_off()
    return save_chart(figure, "sweeps.png", folder)


def _series(axis: Any, x: list[float], taken_s: list[float], name: str, colour: str) -> None:
    law = power_law(x, taken_s)
    axis.plot(x, taken_s, "o", color=colour, label=f"{name}, power {law.power:.2f}")
    fitted = np.array([law.start, max(x)])
    axis.plot(fitted, law.factor * fitted**law.power, "-", color=colour)
