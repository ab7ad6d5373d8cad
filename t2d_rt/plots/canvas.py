"""What is common to pictures: figures that notebooks show, colours of levels, checked and thinned maps, drawable labels."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from t2d_rt.core.calls import public
from t2d_rt.core.checks import array, flag, instance, interval, listed, number, numeric, positive, shown, text
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import Collection
    from matplotlib.figure import Figure

COLUMNS = 2000
"""More columns than any page shows; longer images are averaged (in power) down to it."""

MARGIN = 0.15
"""Fraction of the occupied span of an axis that stays free on both sides of it."""


class StyleOptions(TypedDict, total=False):
    """Fields of a `Style`, as keywords of plot functions."""

    cmap: str
    dynamic_range_db: float
    limits_db: tuple[float, float]
    bar: bool
    width_in: float


@public
@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """How a map is drawn: the colours of its levels, its colour bar, its width."""

    cmap: str = "viridis"
    """A colour map of Matplotlib."""
    dynamic_range_db: float = 50.0
    """Below the peak."""
    limits_db: tuple[float, float] | None = None
    """Least and greatest level [dB re 1 W], for pictures that are to be compared; by default the peak and what lies below it within
    `dynamic_range_db`."""
    bar: bool = True
    """Whether a colour bar stands beside the map; a grid of maps on one scale needs only one."""
    width_in: float | None = None
    """Width of the figure [inch], 3.5 for a column of a paper and 7 for its width; by default 7, and 5.4 of maps over range or
    angle. In axes of a figure of one's own it has no effect."""

    def __post_init__(self) -> None:
        check_colours(self.cmap)
        value = positive("dynamic_range_db", self.dynamic_range_db, 1000, unit="dB", hint="50 is usual")
        object.__setattr__(self, "dynamic_range_db", value)
        if self.limits_db is not None:
            low, high = interval("limits_db", self.limits_db, unit="dB re 1 W")
            if not -1e4 <= low < high <= 1e4:
                raise InputError(f"limits_db must be two levels, the lower one first, got {shown(self.limits_db)}")
            object.__setattr__(self, "limits_db", (low, high))
        flag("bar", self.bar)
        if self.width_in is not None:
            object.__setattr__(self, "width_in", checked_width(self.width_in))

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


def checked_width(width_in: Any) -> float:
    """A width that a page or a screen may have [inch]."""
    return number("width_in", width_in, 2, 40, unit="inch", hint="3.5 is a column of a paper, 7 its width")


def sized(width_in: float, height_in: float, wanted_in: float | None) -> tuple[float, float]:
    """Width and height of a figure of another width [inch]; its height changes less, as labels keep their size."""
    return (width_in, height_in) if wanted_in is None else (wanted_in, height_in * (wanted_in / width_in) ** 0.65)


def is_small(axes: Axes) -> bool:
    """Whether axes have less room than a figure across a page gives them, so that their texts must be smaller and shorter."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    width, height = figure.get_size_inches() * axes.get_position(original=True).size
    return bool(width < 3.2 or height < 1.8)


def blank_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure of that size [inch], which belongs to no window and which notebooks show."""
    with _usable():
        from t2d_rt.plots.new_figure import NotebookFigure

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
    flat_axes: Axes = instance("ax", axes, Axes, "axes of a figure of Matplotlib", hint=hint)
    if flat_axes.name == "3d":
        raise InputError("ax must be flat, got axes in three dimensions; make others")
    figure = flat_axes.get_figure(root=True)
    if figure is not None and figure.get_layout_engine() is None and len(figure.axes) > 1:
        # In a grid labels and colour bars would lie over one another; who has placed a colour bar has arranged the figure.
        with suppress(RuntimeError):
            figure.set_layout_engine("constrained")
    return flat_axes


def scaled_image(axes: Axes, x: np.ndarray, y: np.ndarray, power_db: np.ndarray, style: Style) -> tuple[float, float]:
    """Draws a map with its colour bar, relative to the peak or, where levels are given, as it is; the levels at both ends."""
    low, high = style.bounds_db(power_db)
    offset = high if style.limits_db is None else 0.0
    mesh = axes.pcolormesh(
        x,
        y,
        np.clip(power_db, low, None) - offset,
        cmap=style.cmap,
        vmin=low - offset,
        vmax=high - offset,
        shading="nearest",
        rasterized=True,
    )
    if style.bar and style.limits_db is None:
        draw_bar(axes, mesh, "Power rel. to peak [dB]")
    elif style.bar:
        draw_bar(axes, mesh, "Power [dB re 1 W]", extend="max" if peak_db(power_db) > high else "neither")
    return low, high


def draw_note(axes: Axes, note: str | None) -> None:
    """A small text in the lower left corner."""
    if note is not None:
        axes.text(
            0.01, 0.02, drawable("note", note), transform=axes.transAxes, color="white", fontsize=8, parse_math=False
        )


def draw_bar(axes: Axes, mesh: Collection, label: str, extend: str = "neither") -> None:
    """The colour bar of a map."""
    small = is_small(axes)
    bar = axes.figure.colorbar(mesh, ax=axes, pad=0.015, extend=extend)
    bar.set_label(label, fontsize=8 if small else 9)
    bar.ax.tick_params(labelsize=7 if small else 8)


def label_axes(axes: Axes, x: str, y: str, title: str | None) -> None:
    """Names of both axes, and a title."""
    small = is_small(axes)
    axes.set_xlabel(x, fontsize=8 if small else 9)
    axes.set_ylabel(y, fontsize=8 if small else 9)
    axes.tick_params(labelsize=7 if small else 8)
    if title is not None:
        axes.set_title(drawable("title", title), fontsize=8 if small else 10, parse_math=False)


def drawable(name: str, value: Any) -> str:
    """A text that can be drawn: a file's name may hold bytes that are no characters."""
    signs = text(name, value)[:300]
    return "".join(sign if sign.isprintable() or sign == "\n" else "\N{REPLACEMENT CHARACTER}" for sign in signs)


def checked_labels(labels: Any) -> tuple[str, str]:
    """Names of two things that are compared."""
    if len(texts := listed("labels", labels, str, "two texts")) != 2:
        raise InputError(f"labels must be two texts, got {shown(labels)}")
    return texts[0], texts[1]


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
