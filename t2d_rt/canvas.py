"""What is common to pictures: figures that notebooks show, colours of levels, checked and thinned maps, drawable labels."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from t2d_rt.checks import array, instance, interval, numeric, positive, shown, text
from t2d_rt.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure

COLUMNS = 2000
"""More columns than any page shows; longer images are averaged (in power) down to it."""

MARGIN = 0.15
"""Of the occupied span of an axis, left free on both sides of it."""

LONGEST_TITLE = 300
"""Characters of a title that are drawn."""


class Colours(TypedDict, total=False):
    """Options of a `Scale`."""

    cmap: str
    dynamic_range_db: float
    limits_db: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Colours of the levels of a map."""

    cmap: str = "viridis"
    """A colour map of Matplotlib."""
    dynamic_range_db: float = 50.0
    """Below the peak."""
    limits_db: tuple[float, float] | None = None
    """Least and greatest level [dB re 1 W], for pictures that are to be compared; by default the peak and what lies below it within
    `dynamic_range_db`."""

    def __post_init__(self) -> None:
        check_colours(self.cmap)
        value = positive("dynamic_range_db", self.dynamic_range_db, 1000, unit="dB", hint="50 is usual")
        object.__setattr__(self, "dynamic_range_db", value)
        if self.limits_db is not None:
            low, high = interval("limits_db", self.limits_db, unit="dB re 1 W")
            if not -1e4 <= low < high <= 1e4:
                raise InputError(f"limits_db must be two levels, the lower one first, got {shown(self.limits_db)}")
            object.__setattr__(self, "limits_db", (low, high))

    def bounds_db(self, power_db: np.ndarray) -> tuple[float, float]:
        """Least and greatest level [dB] that colours tell apart in a map."""
        peak = peak_db(power_db)
        return self.limits_db or (peak - self.dynamic_range_db, peak)


def occupied(axis: np.ndarray, levels_db: np.ndarray, floor_db: float, *, zero: bool = True) -> tuple[float, float]:
    """Part of an axis that holds a level above the floor and, if asked for, zero, with a margin; all of it where nothing does."""
    held = axis[levels_db > floor_db]
    if not held.size:
        return float(axis[0]), float(axis[-1])
    least, greatest = float(held.min()), float(held.max())
    if zero:
        least, greatest = min(least, 0.0), max(greatest, 0.0)
    margin = max(MARGIN * (greatest - least), 10 * float(axis[1] - axis[0]))
    return max(least - margin, float(axis[0])), min(greatest + margin, float(axis[-1]))


def blank_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure of that size [inch], which belongs to no window and which notebooks show."""
    with _usable():
        from t2d_rt.figures import NotebookFigure

    return NotebookFigure(figsize=(width_in, height_in), dpi=160, layout="constrained")


@contextmanager
def _usable() -> Iterator[None]:
    """Matplotlib refuses to load where its settings, such as MPLBACKEND, are wrong."""
    try:
        yield
    except ValueError as error:
        raise InputError(f"matplotlib cannot be used: {error}; correct its settings, or unset MPLBACKEND") from error


def checked_axes(axes: Any) -> Axes:
    """Axes of a figure of Matplotlib, flat ones."""
    with _usable():
        from matplotlib.axes import Axes

    hint = "matplotlib.pyplot.subplots() makes some"
    found: Axes = instance("ax", axes, Axes, "axes of a figure of Matplotlib", hint=hint)
    if found.name == "3d":
        raise InputError("ax must be flat, got axes in three dimensions; make others")
    return found


def scaled_image(
    axes: Axes, x: np.ndarray, y: np.ndarray, power_db: np.ndarray, scale: Scale | None
) -> tuple[float, float]:
    """Draws a map with its colour bar, relative to the peak or, where levels are given, as it is; the levels at both ends."""
    scale = scale or Scale()
    low, high = scale.bounds_db(power_db)
    if scale.limits_db is None:
        draw_image(axes, x, y, power_db, scale.dynamic_range_db, scale.cmap, peak=high)
    else:
        mesh = axes.pcolormesh(
            x, y, np.maximum(power_db, low), cmap=scale.cmap, vmin=low, vmax=high, shading="nearest", rasterized=True
        )
        draw_bar(axes, mesh, "Power (dB re 1 W)", extend="max" if peak_db(power_db) > high else "neither")
    return low, high


def draw_note(axes: Axes, note: str | None) -> None:
    """A small text in the lower left corner."""
    if note is not None:
        axes.text(
            0.01, 0.02, drawable("note", note), transform=axes.transAxes, color="white", fontsize=8, parse_math=False
        )


def draw_image(
    axes: Axes,
    x: np.ndarray,
    y: np.ndarray,
    power_db: np.ndarray,
    dynamic_range_db: float,
    cmap: str,
    *,
    peak: float | None = None,
) -> None:
    """A map relative to its peak, or to a `peak` common to several, with its colour bar; levels below the range are clipped."""
    dynamic_range_db = positive("dynamic_range_db", dynamic_range_db, 1000, unit="dB", hint="50 is usual")
    check_colours(cmap)
    relative = np.clip(power_db - (peak_db(power_db) if peak is None else peak), -dynamic_range_db, 0)
    mesh = axes.pcolormesh(
        x, y, relative, cmap=cmap, vmin=-dynamic_range_db, vmax=0, shading="nearest", rasterized=True
    )
    draw_bar(axes, mesh, "Power rel. to peak (dB)")


def draw_bar(axes: Axes, mesh: QuadMesh, label: str, extend: str = "neither") -> None:
    """The colour bar of a map."""
    bar = axes.figure.colorbar(mesh, ax=axes, pad=0.015, extend=extend)
    bar.set_label(label, fontsize=9)
    bar.ax.tick_params(labelsize=8)


def label_axes(axes: Axes, x: str, y: str, title: str | None) -> None:
    """Names of both axes, and a title."""
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    if title is not None:
        axes.set_title(drawable("title", title), fontsize=10, parse_math=False)


def drawable(name: str, value: Any) -> str:
    """A text that can be drawn: a file's name may hold bytes that are no characters."""
    words = text(name, value)[:LONGEST_TITLE]
    return "".join(each if each.isprintable() or each == "\n" else "\N{REPLACEMENT CHARACTER}" for each in words)


def check_colours(cmap: Any) -> None:
    """Refuses what is no colour map of Matplotlib."""
    with _usable():
        from matplotlib import colormaps
        from matplotlib.colors import Colormap

    if not isinstance(cmap, Colormap) and not (isinstance(cmap, str) and cmap in colormaps):
        raise InputError(f"cmap must be the name of a colour map of matplotlib such as viridis, got {shown(cmap)}")


def checked_map(y_name: str, y: np.ndarray, x_name: str, x: np.ndarray, power_db: np.ndarray) -> tuple[np.ndarray, ...]:
    """Axes and levels of a map; silence, -inf dB, is a level."""
    y, x = array(y_name, y, ("rows",)), array(x_name, x, ("columns",))
    if len(x) < 1 or len(y) < 2:
        raise InputError(f"a picture needs 2 values of {y_name} and 1 of {x_name} at least, got {len(y)} and {len(x)}")
    levels = numeric("power_db", power_db)
    if levels.shape != (len(y), len(x)):
        raise InputError(f"power_db must have shape ({len(y)}, {len(x)}), that of its axes, got {levels.shape}")
    array("power_db", np.where(np.isneginf(levels.real), 0, levels), limit=1e4, unit="dB")
    return y, x, np.asarray(levels, float)


def peak_db(power_db: np.ndarray) -> float:
    """Greatest level of a map [dB]; silence has none."""
    finite = power_db[np.isfinite(power_db)]
    if not finite.size:
        raise InputError("nothing to plot: no finite level in the map; the record is silent")
    return float(finite.max())


def thinned(time_s: np.ndarray, power_db: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most `COLUMNS` columns: powers averaged over equal groups of times."""
    step = -(-len(time_s) // COLUMNS)
    if step == 1 or power_db.shape[-1] != len(time_s):
        return time_s, power_db
    whole = len(time_s) // step * step
    power = (10 ** (power_db[:, :whole] / 10)).reshape(len(power_db), -1, step).mean(axis=-1)
    with np.errstate(divide="ignore"):  # silence is -inf dB and is drawn at the floor
        return time_s[:whole].reshape(-1, step).mean(axis=-1), 10 * np.log10(power)
