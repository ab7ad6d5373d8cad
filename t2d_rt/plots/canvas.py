"""What all figures have in common: figures that notebooks show, colours of levels, checks and thinning of maps, labels."""

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
"""Greatest number of columns that are drawn; longer images are averaged in power, as no page shows more."""

MARGIN = 0.15
"""Margin on both sides of the occupied part of an axis, as a fraction of it."""


class StyleOptions(TypedDict, total=False):
    """The fields of a `Style`, as keyword arguments of plot functions."""

    cmap: str
    dynamic_range_db: float
    limits_db: tuple[float, float]
    bar: bool
    width_in: float


@public
@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """How a map is drawn: colours of its levels, colour bar, width."""

    cmap: str = "viridis"
    """A colour map of Matplotlib."""
    dynamic_range_db: float = 50.0
    """Range of the colours below the peak [dB]."""
    limits_db: tuple[float, float] | None = None
    """Least and greatest level of the colours [dB re 1 W], for pictures that are to be compared; by default the peak, and
    `dynamic_range_db` below it."""
    bar: bool = True
    """Whether a colour bar is drawn beside the map; a grid of maps on one scale needs only one."""
    width_in: float | None = None
    """Width of the figure [inch]: 3.5 for a column of a paper, 7 for its width. By default 7, and 5.4 for maps over range or angle.
    It has no effect for axes in a figure of one's own."""

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
        """Least and greatest level [dB] of the colours for a map."""
        peak = peak_db(power_db)
        return self.limits_db or (peak - self.dynamic_range_db, peak)


def occupied(axis: np.ndarray, levels_db: np.ndarray, floor_db: float, *, zero: bool = True) -> tuple[float, float]:
    """The part of an axis that has levels above the floor (and zero if asked for), with a margin; the whole axis where there are
    none."""
    held = axis[levels_db > floor_db]
    if not held.size:
        return float(axis[0]), float(axis[-1])
    least, greatest = float(held.min()), float(held.max())
    if zero:
        least, greatest = min(least, 0.0), max(greatest, 0.0)
    margin = max(MARGIN * (greatest - least), 10 * float(axis[1] - axis[0]))
    return max(least - margin, float(axis[0])), min(greatest + margin, float(axis[-1]))


def checked_width(width_in: Any) -> float:
    """A checked width of a figure [inch]."""
    return number("width_in", width_in, 2, 40, unit="inch", hint="3.5 is a column of a paper, 7 its width")


def sized(width_in: float, height_in: float, wanted_in: float | None) -> tuple[float, float]:
    """Size of a figure [inch] for another width than its usual `width_in`; the height changes less than the width, as labels keep
    their size."""
    return (width_in, height_in) if wanted_in is None else (wanted_in, height_in * (wanted_in / width_in) ** 0.65)


def is_small(axes: Axes) -> bool:
    """Whether axes are so much smaller than a figure across a page that their texts must be smaller and shorter."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    width, height = figure.get_size_inches() * axes.get_position(original=True).size
    return bool(width < 3.2 or height < 1.8)


def blank_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure of that size [inch], which has no window and which notebooks show."""
    with _usable():
        from t2d_rt.plots.new_figure import NotebookFigure

    return NotebookFigure(figsize=(width_in, height_in), dpi=160, layout="constrained")


@contextmanager
def _usable() -> Iterator[None]:
    """Context that turns an error on loading Matplotlib, such as a wrong MPLBACKEND, into an `InputError`."""
    try:
        yield
    except ValueError as error:
        raise InputError(f"matplotlib cannot be used: {error}; correct its settings, or unset MPLBACKEND") from error


def checked_axes(axes: Any) -> Axes:
    """Checked two-dimensional axes of a Matplotlib figure."""
    with _usable():
        from matplotlib.axes import Axes

    hint = "matplotlib.pyplot.subplots() makes some"
    flat_axes: Axes = instance("ax", axes, Axes, "axes of a figure of Matplotlib", hint=hint)
    if flat_axes.name == "3d":
        raise InputError("ax must be flat, got axes in three dimensions; make others")
    figure = flat_axes.get_figure(root=True)
    if figure is not None and figure.get_layout_engine() is None and len(figure.axes) > 1:
        # A constrained layout keeps labels and colour bars of a grid apart; whoever has placed a colour bar arranges the figure
        # themselves.
        with suppress(RuntimeError):
            figure.set_layout_engine("constrained")
    return flat_axes


def scaled_image(axes: Axes, x: np.ndarray, y: np.ndarray, power_db: np.ndarray, style: Style) -> tuple[float, float]:
    """Draws a map with its colour bar, relative to the peak or, if limits are given, in absolute levels; returns the levels at both
    ends."""
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
    """Draws a small text in the lower left corner."""
    if note is not None:
        axes.text(
            0.01, 0.02, drawable("note", note), transform=axes.transAxes, color="white", fontsize=8, parse_math=False
        )


def draw_bar(axes: Axes, mesh: Collection, label: str, extend: str = "neither") -> None:
    """Draws the colour bar of a map."""
    small = is_small(axes)
    bar = axes.figure.colorbar(mesh, ax=axes, pad=0.015, extend=extend)
    bar.set_label(label, fontsize=8 if small else 9)
    bar.ax.tick_params(labelsize=7 if small else 8)


def label_axes(axes: Axes, x: str, y: str, title: str | None) -> None:
    """Labels both axes and sets a title."""
    small = is_small(axes)
    axes.set_xlabel(x, fontsize=8 if small else 9)
    axes.set_ylabel(y, fontsize=8 if small else 9)
    axes.tick_params(labelsize=7 if small else 8)
    if title is not None:
        axes.set_title(drawable("title", title), fontsize=8 if small else 10, parse_math=False)


def drawable(name: str, value: Any) -> str:
    """A text that can be drawn: bytes of a file name that are not characters are replaced."""
    signs = text(name, value)[:300]
    return "".join(sign if sign.isprintable() or sign == "\n" else "\N{REPLACEMENT CHARACTER}" for sign in signs)


def checked_labels(labels: Any) -> tuple[str, str]:
    """Checked names of two things that are compared."""
    if len(texts := listed("labels", labels, str, "two texts")) != 2:
        raise InputError(f"labels must be two texts, got {shown(labels)}")
    return texts[0], texts[1]


def check_colours(cmap: Any) -> None:
    """Refuses a name that is no colour map of Matplotlib."""
    with _usable():
        from matplotlib import colormaps
        from matplotlib.colors import Colormap

    if not isinstance(cmap, Colormap) and not (isinstance(cmap, str) and cmap in colormaps):
        raise InputError(f"cmap must be the name of a colour map of matplotlib such as viridis, got {shown(cmap)}")


def checked_map(y_name: str, y: np.ndarray, x_name: str, x: np.ndarray, power_db: np.ndarray) -> tuple[np.ndarray, ...]:
    """Checked axes and levels of a map; -inf dB (silence) is a valid level."""
    y, x = array(y_name, y, ("rows",)), array(x_name, x, ("columns",))
    if len(x) < 1 or len(y) < 2:
        raise InputError(f"a picture needs 2 values of {y_name} and 1 of {x_name} at least, got {len(y)} and {len(x)}")
    levels = numeric("power_db", power_db)
    if levels.shape != (len(y), len(x)):
        raise InputError(f"power_db must have shape ({len(y)}, {len(x)}), that of its axes, got {levels.shape}")
    array("power_db", np.where(np.isneginf(levels.real), 0, levels), limit=1e4, unit="dB")
    return y, x, np.asarray(levels, float)


def peak_db(power_db: np.ndarray) -> float:
    """Greatest level of a map [dB]; refuses a map of silence."""
    finite = power_db[np.isfinite(power_db)]
    if not finite.size:
        raise InputError("nothing to plot: no finite level in the map; the record is silent")
    return float(finite.max())


def thinned(time_s: np.ndarray, power_db: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and levels averaged in power over equal groups of columns, so that there are at most `COLUMNS`."""
    step = -(-len(time_s) // COLUMNS)
    if step == 1 or power_db.shape[-1] != len(time_s):
        return time_s, power_db
    whole = len(time_s) // step * step
    power = (10 ** (power_db[:, :whole] / 10)).reshape(len(power_db), -1, step).mean(axis=-1)
    with np.errstate(divide="ignore"):  # silence is -inf dB and appears at the floor
        return time_s[:whole].reshape(-1, step).mean(axis=-1), 10 * np.log10(power)
