"""Spectrograms by their parts: one coloured by the strongest part, with bodies above it in the same colours; or all side by
side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Unpack

import numpy as np

from t2d_rt.core.checks import numeric, shown
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import edge_cross, unit
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
from t2d_rt.plots.figures import LABELS, MAPS, MapKind, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LIMBS = {
    "head": "#f0e442", "trunk": "#56b4e9", "arms": "#e69f00", "thighs": "#009e73", "shanks": "#cc79a7", "feet": "#d55e00",
}  # fmt: skip
"""Colours of limbs, the same in all pictures, and distinguishable with any colour vision (Okabe and Ito, "Color Universal Design",
2008)."""
HUES = ("#56b4e9", "#e69f00", "#009e73", "#f0e442", "#cc79a7", "#d55e00", "#0072b2")
"""Colours of other parts, for the strongest first."""
OTHERS = "#b0b0b0"
"""Colour that all weaker parts share."""
GAMMA = 0.5
"""Exponent of lightness over the fraction of the dynamic range; below 1, because dark colours are hard to distinguish."""
STRIP_IN, TALL_IN, INCHES_PER_M = 1.2, 4.8, 0.62
"""Height of the strip of bodies above a spectrogram, height of the figure with both [inch], and greatest scale of the bodies."""
SHADE, LIGHT = 0.5, np.array([0.35, 0.80, 0.50])
"""Lightness of faces in the shade, and direction towards the light: right, towards the camera, up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Poses:
    """Surfaces at some instants, drawn above a spectrogram."""

    times_s: np.ndarray
    """Instants [s], (pose,)."""
    corners_m: np.ndarray
    """Corners of the faces [m] in the picture's frame (right, towards the camera, up), (pose, face, 3, 3)."""
    parts: Sequence[str]
    """Name of the part to which each face belongs, (face,)."""


def plot_parts(
    velocity_mps: np.ndarray,
    time_s: np.ndarray,
    power_db: np.ndarray,
    *,
    parts_db: np.ndarray,
    names: Sequence[str],
    ax: Axes | None = None,
    title: str | None = None,
    poses: Poses | None = None,
    **style: Unpack[StyleOptions],
) -> Figure | Axes:
    """A micro-Doppler spectrogram coloured by its parts, in a figure, or in axes `ax`, which are returned.

    power_db: levels of the whole (velocity, time) [dB re 1 W], which set the lightness.
    parts_db: levels of the parts (part, velocity, time) [dB re 1 W]; the strongest one sets the hue of a cell.
    names: those of the parts, for the legend. Limbs have colours of their own, of others the strongest do, the rest one together.
    poses: surfaces above the spectrogram of a figure, in the colours of their parts.
    style: fields of `Style`; there is no colour bar, and `cmap` has no effect.
    """
    kind: MapKind = "spectrogram"
    (y_name, x_name), (width_in, height_in) = MAPS[kind]
    y, x, whole = checked_map(y_name, velocity_mps, x_name, time_s, power_db)
    levels = checked_parts(parts_db, names, whole.shape)
    drawing = Style(**style)
    x, whole = thinned(x, whole)
    levels = np.stack([thinned(np.asarray(time_s), level)[1] for level in levels])
    hues = part_hues(names, levels)
    low, high = drawing.bounds_db(whole)
    light = np.clip((whole - low) / (high - low), 0, 1) ** GAMMA
    picture = np.array([rgb(hues[name]) for name in names])[levels.argmax(axis=0)] * light[..., None]

    tall = height_in + (0.0 if poses is None else STRIP_IN)
    figure = None if ax is not None else blank_figure(*sized(width_in, tall, drawing.width_in))
    if figure is None or poses is None:
        axes = checked_axes(ax) if figure is None else figure.subplots()
        label_axes(axes, LABELS[x_name], LABELS[y_name], title)
    else:
        strip, axes = figure.subplots(2, 1, sharex=True, height_ratios=(STRIP_IN, height_in))
        label_axes(axes, LABELS[x_name], LABELS[y_name], None)
        label_axes(strip, "", "", title)
        draw_poses(strip, poses, hues)
        for pose_s in poses.times_s:
            axes.axvline(pose_s, color="white", linewidth=0.5, linestyle=(0, (1, 3)), alpha=0.6)
    half_y, half_x = (float(axis[-1] - axis[0]) / max(1, len(axis) - 1) / 2 for axis in (y, x))
    extent = (x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y)
    axes.imshow(picture, extent=extent, origin="lower", aspect="auto", interpolation="nearest")
    axes.set_ylim(occupied(y, whole.max(axis=1), low))
    _legend(axes, hues, f"brightness {high - low:.3g} dB")
    return axes if figure is None else figure


def plot_stacked_parts(
    velocity_mps: np.ndarray,
    time_s: np.ndarray,
    *,
    parts_db: np.ndarray,
    names: Sequence[str],
    title: str | None = None,
    **style: Unpack[StyleOptions],
) -> Figure:
    """Spectrograms of the parts (part, velocity, time) [dB re 1 W] side by side, with common axes, on one scale, whose top is the
    strongest part's peak; options as of `plot_parts`."""
    speeds, times = np.asarray(velocity_mps), np.asarray(time_s)
    levels = checked_parts(parts_db, names, (len(speeds), len(times)))
    images = [(speeds, times, level) for level in levels]
    return panels(images, [name.replace("_", " ") for name in names], style=Style(**style), title=title)


def checked_parts(parts_db: np.ndarray, names: Sequence[str], shape: tuple[int, ...]) -> np.ndarray:
    """Checked levels of parts (part, velocity, time), one for each name."""
    levels = numeric("parts_db", parts_db)
    if levels.shape != (len(names), *shape) or not len(names):
        raise InputError(
            f"parts_db must have shape (part, {shape[0]}, {shape[1]}) for {len(names)} names, got {shown(levels.shape)}"
        )
    return levels


def part_hues(names: Sequence[str], levels_db: np.ndarray) -> dict[str, str]:
    """Colour of each part by name, in the order of the legend: limbs from head to feet, then other parts, strongest first."""
    order = np.argsort(-np.sum(10 ** (levels_db / 10), axis=(1, 2)), kind="stable")
    words = [name.rpartition(": ")[2] for name in names]  # names of one person's limbs without those of other targets
    limbs = {
        name: LIMBS[word] for name, word in zip(names, words, strict=True) if word in LIMBS and words.count(word) == 1
    }
    rest = [names[place] for place in order if names[place] not in limbs]
    free = [hue for hue in HUES if hue not in limbs.values()]
    hues = free + [OTHERS] * (len(rest) - len(free))
    from_head = sorted(limbs, key=lambda name: list(LIMBS).index(name.rpartition(": ")[2]))
    return {name: limbs[name] for name in from_head} | dict(zip(rest, hues, strict=False))


def draw_poses(axes: Axes, poses: Poses, hues: Mapping[str, str]) -> None:
    """Draws surfaces at their times, all on the same scale, into axes of time; far faces first, so that near ones cover them."""
    from matplotlib.collections import PolyCollection
    from matplotlib.transforms import Affine2D

    figure = axes.get_figure(root=True)
    assert figure is not None
    (width_in, height_in), places_m = figure.get_size_inches(), poses.corners_m[..., 0]
    widest_m = float((places_m.max(axis=(1, 2)) - places_m.min(axis=(1, 2))).max())
    room_in = 0.76 * width_in / len(poses.times_s)  # labels and the legend need the rest
    scale = Affine2D().scale(min(INCHES_PER_M * height_in / TALL_IN, room_in / max(widest_m, 1e-6)))
    colours = np.array([rgb(hues.get(name, OTHERS)) for name in poses.parts])
    for time_s, corners in zip(poses.times_s, poses.corners_m, strict=True):
        normal = unit(edge_cross(corners))
        in_view = np.flatnonzero(normal[:, 1] > 0)
        in_view = in_view[np.argsort(corners[in_view, :, 1].mean(axis=1), kind="stable")]
        lit = np.clip(normal[in_view] @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)
        shade = colours[in_view] * (SHADE + (1 - SHADE) * lit[:, None])
        body = PolyCollection(
            corners[in_view][..., [0, 2]].tolist(), facecolors=shade, edgecolors=shade, linewidths=0.2, rasterized=True,
            clip_on=False, offsets=[(time_s, 0.0)], offset_transform=axes.transData,
        )  # fmt: skip
        body.set_transform(scale + figure.dpi_scale_trans)
        axes.add_collection(body, autolim=False)
    axes.set_ylim(0, 1)
    axes.set_axis_off()
    axes.text(1.01, 0.45, "to the radar \N{RIGHTWARDS ARROW}", transform=axes.transAxes, fontsize=7)


def rgb(hue: str) -> list[float]:
    """Red, green and blue, 0..1 each, of a colour #rrggbb."""
    return [int(hue[k : k + 2], 16) / 255 for k in (1, 3, 5)]


def _legend(axes: Axes, hues: Mapping[str, str], heading: str) -> None:
    from matplotlib.patches import Patch

    others = [name for name, hue in hues.items() if hue == OTHERS]
    shown = {name: hue for name, hue in hues.items() if hue != OTHERS or len(others) == 1}
    labels = {drawable("names", name.replace("_", " ")): hue for name, hue in shown.items()}
    labels |= {f"{len(others)} others": OTHERS} if len(others) > 1 else {}
    axes.legend(
        handles=[Patch(color=hue, label=name) for name, hue in labels.items()], title=heading, title_fontsize=7, fontsize=7,
        loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, handlelength=1.0,
    )  # fmt: skip
