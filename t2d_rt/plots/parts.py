"""A spectrogram coloured by what makes it: the hue of a cell is that of its strongest part, its lightness its level."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Unpack

import numpy as np

from t2d_rt.core.checks import numeric, shown
from t2d_rt.core.errors import InputError
from t2d_rt.plots.canvas import (
    Style,
    StyleOptions,
    blank_figure,
    checked_axes,
    checked_map,
    drawable,
    label_axes,
    occupied,
    sized,
    thinned,
)
from t2d_rt.plots.figures import LABELS, MAPS, MapKind

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HUES = ("#56b4e9", "#e69f00", "#009e73", "#f0e442", "#cc79a7", "#d55e00", "#0072b2")
"""Colours that people with any colour vision tell apart (Okabe and Ito, "Color Universal Design", 2008)."""
FLOOR = 0.3
"""Lightness at the lowest level drawn: in darker colours hues cannot be told apart."""
OTHERS = "#b0b0b0"
"""Of parts beyond these, the weakest ones, together."""


def plot_parts(
    velocity_mps: np.ndarray,
    time_s: np.ndarray,
    power_db: np.ndarray,
    *,
    parts_db: np.ndarray,
    names: Sequence[str],
    ax: Axes | None = None,
    title: str | None = None,
    **style: Unpack[StyleOptions],
) -> Figure | Axes:
    """A micro-Doppler spectrogram coloured by its parts, in a figure, or in axes `ax`, which are returned.

    power_db: levels of the whole (velocity, time) [dB re 1 W], which set the lightness.
    parts_db: levels of the parts (part, velocity, time) [dB re 1 W]; the strongest one sets the hue of a cell.
    names: those of the parts, for the legend. The strongest parts have colours of their own, the rest one together.
    style: fields of `Style`; there is no colour bar, and `cmap` has no effect.
    """
    kind: MapKind = "spectrogram"
    (y_name, x_name), size = MAPS[kind]
    y, x, whole = checked_map(y_name, velocity_mps, x_name, time_s, power_db)
    levels = numeric("parts_db", parts_db)
    if levels.shape != (len(names), *whole.shape) or not len(names):
        raise InputError(
            f"parts_db must have shape (part, {whole.shape[0]}, {whole.shape[1]}) for {len(names)} names, got {shown(levels.shape)}"
        )
    drawing = Style(**style)
    x, whole = thinned(x, whole)
    levels = np.stack([thinned(np.asarray(time_s), each)[1] for each in levels])
    order = np.argsort(-np.sum(10 ** (levels / 10), axis=(1, 2)), kind="stable")
    strongest = np.argsort(order)[levels.argmax(axis=0)]
    low, high = drawing.bounds_db(whole)
    above = np.clip((whole - low) / (high - low), 0, 1)
    light = np.where(above > 0, FLOOR + (1 - FLOOR) * above, 0)
    hues = [*HUES, OTHERS]
    colours = np.array([[int(each[k : k + 2], 16) / 255 for k in (1, 3, 5)] for each in hues])
    picture = colours[np.minimum(strongest, len(HUES))] * light[..., None]

    figure = None if ax is not None else blank_figure(*sized(*size, drawing.width_in))
    axes = checked_axes(ax) if figure is None else figure.subplots()
    half_y, half_x = (float(each[-1] - each[0]) / max(1, len(each) - 1) / 2 for each in (y, x))
    extent = (x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y)
    axes.imshow(picture, extent=extent, origin="lower", aspect="auto", interpolation="nearest")
    axes.set_ylim(occupied(y, whole.max(axis=1), low))
    label_axes(axes, LABELS[x_name], LABELS[y_name], title)
    _legend(axes, [names[each] for each in order], hues, f"brightness {high - low:.3g} dB")
    return axes if figure is None else figure


def _legend(axes: Axes, names: Sequence[str], hues: Sequence[str], told: str) -> None:
    from matplotlib.patches import Patch

    own = names if len(names) <= len(HUES) else [*names[: len(HUES)], f"{len(names) - len(HUES)} others"]
    patches = [
        Patch(color=hue, label=drawable("names", name.replace("_", " "))) for hue, name in zip(hues, own, strict=False)
    ]
    axes.legend(
        handles=patches, title=told, title_fontsize=7, fontsize=7, loc="center left", bbox_to_anchor=(1.01, 0.5),
        frameon=False, handlelength=1.0,
    )  # fmt: skip
