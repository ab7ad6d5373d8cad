"""Figures for a paper: axes with units, dB relative to the peak, a perceptual map, rasterised images, no global state.

Every function returns a `matplotlib.figure.Figure`, and `figure.savefig("walk.png")` or `.pdf` writes it; or draws into axes `ax`
of a figure of the user's and returns these. A type that hangs on `ax` would take two overloads of each signature: it is `Any`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, instance, numeric, positive, shown, text
from t2d_rt.core.errors import InputError, warn
from t2d_rt.geometry.vectors import edge_cross, unit
from t2d_rt.plots.canvas import (
    Style,
    StyleOptions,
    blank_figure,
    check_colours,
    checked_axes,
    checked_labels,
    checked_map,
    checked_width,
    draw_bar,
    draw_note,
    drawable,
    is_small,
    label_axes,
    occupied,
    peak_db,
    scaled_image,
    sized,
    thinned,
)
from t2d_rt.types import Scene, Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MapKind = Literal["spectrogram", "range_time", "range_doppler", "range_angle"]

MAPS: dict[MapKind, tuple[tuple[str, str], tuple[float, float]]] = {
    "spectrogram": (("velocity_mps", "time_s"), (7.0, 3.6)),
    "range_time": (("range_m", "time_s"), (7.0, 3.6)),
    "range_doppler": (("velocity_mps", "range_m"), (5.4, 4.2)),
    "range_angle": (("range_m", "azimuth_rad"), (5.4, 4.2)),
}
"""Names of a map's vertical and horizontal axis, and width and height of its figure [inch]."""

VELOCITY_LABEL = "Radial velocity [m/s], approaching > 0"

LABELS = {
    "velocity_mps": VELOCITY_LABEL,
    "range_m": "Range [m]",
    "time_s": "Time [s]",
    "azimuth_rad": "Azimuth [deg], left > 0",
}


def draw_map(
    axes: Axes,
    kind: MapKind,
    y: np.ndarray,
    x: np.ndarray,
    power_db: np.ndarray,
    *,
    style: Style,
    title: str | None = None,
    note: str | None = None,
) -> None:
    """Draws a map (y, x) into axes, cropped to the part that holds levels above the floor."""
    (y_name, x_name), _ = MAPS[kind]
    y, x, power_db = checked_map(y_name, y, x_name, x, power_db)
    if x_name == "time_s":
        x, power_db = _with_width(x, power_db) if len(x) == 1 else thinned(x, power_db)
    elif x_name == "azimuth_rad":
        x = np.degrees(x)
    low, _ = scaled_image(axes, x, y, power_db, style)
    axes.set_ylim(occupied(y, power_db.max(axis=1), low))
    if x_name == "azimuth_rad":  # positive angles, to the left, are drawn on the left
        axes.set_xlim(x[-1], x[0])
    elif x_name != "time_s":
        axes.set_xlim(occupied(x, power_db.max(axis=0), low, zero=False))
    up = LABELS[y_name].partition(",")[0] if is_small(axes) else LABELS[y_name]
    label_axes(axes, LABELS[x_name], up, title)
    draw_note(axes, note)


def _with_width(time_s: np.ndarray, power_db: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A map of a single column stretched over the duration of its window, for a record of that length; warns about it."""
    warn(
        f"the record has room for one column, at {time_s[0]:.4g} s: the picture shows no change in time; take a longer record, or "
        "shorter windows (n_window)"
    )
    half = 0.5 * abs(time_s[0]) or 0.5
    return time_s[0] + half * np.array([-1.0, 1.0]), np.repeat(power_db, 2, axis=1)


def plotted(
    kind: MapKind, y: np.ndarray, x: np.ndarray, power_db: np.ndarray, ax: Any, style: Style, title: Any, note: Any
) -> Any:
    """Draws a map and returns its new figure, or the axes `ax` if they are given."""
    figure = None if ax is not None else blank_figure(*sized(*MAPS[kind][1], style.width_in))
    axes = checked_axes(ax) if figure is None else figure.subplots()
    draw_map(axes, kind, y, x, power_db, style=style, title=title, note=note)
    return axes if figure is None else figure


def plot_spectrogram(
    velocity_mps: np.ndarray,
    time_s: np.ndarray,
    power_db: np.ndarray,
    *,
    ax: Axes | None = None,
    title: str | None = None,
    note: str | None = None,
    **style: Unpack[StyleOptions],
) -> Any:
    """Micro-Doppler spectrogram; `power_db` (velocity, time). `note` is a small text in its corner; options as in
    `canvas.Style`."""
    return plotted("spectrogram", velocity_mps, time_s, power_db, ax, Style(**style), title, note)


def plot_range_time(
    range_m: np.ndarray,
    time_s: np.ndarray,
    power_db: np.ndarray,
    *,
    ax: Axes | None = None,
    title: str | None = None,
    note: str | None = None,
    **style: Unpack[StyleOptions],
) -> Any:
    """Power over range and time; `power_db` (range, time). `note` is a small text in its corner."""
    return plotted("range_time", range_m, time_s, power_db, ax, Style(**style), title, note)


def plot_displacement(time_s: np.ndarray, displacement_m: np.ndarray, title: str | None = None) -> Figure:
    """Displacement of a chest towards the radar, (T,) [m], over times (T,) [s]."""
    figure = blank_figure(*sized(7.0, 3.0, None))
    axes = figure.subplots()
    axes.plot(time_s, 1e3 * displacement_m, linewidth=1.0)
    axes.set_xlim(time_s[0], time_s[-1])
    label_axes(axes, "Time [s]", "Towards the radar [mm]", title)
    return figure


def plot_range_doppler(
    range_m: np.ndarray,
    velocity_mps: np.ndarray,
    power_db: np.ndarray,
    *,
    ax: Axes | None = None,
    title: str | None = None,
    note: str | None = None,
    **style: Unpack[StyleOptions],
) -> Any:
    """Range-Doppler map; `power_db` (velocity, range). `note` is a small text in its corner."""
    return plotted("range_doppler", velocity_mps, range_m, power_db, ax, Style(**style), title, note)


def plot_range_angle(
    range_m: np.ndarray,
    azimuth_rad: np.ndarray,
    power_db: np.ndarray,
    *,
    ax: Axes | None = None,
    title: str | None = None,
    note: str | None = None,
    **style: Unpack[StyleOptions],
) -> Any:
    """Range-azimuth map with left on the left; `power_db` (range, azimuth). `note` is a small text in its corner."""
    return plotted("range_angle", range_m, azimuth_rad, power_db, ax, Style(**style), title, note)


def panels(
    images: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    labels: Sequence[str],
    *,
    style: Style,
    columns: int | None = None,
    title: str | None = None,
) -> Figure:
    """A grid of spectrograms (speeds, times, levels) with common axes and a single colour bar [dB re 1 W]. The top of the scale is
    the greatest level of all, unless the style has limits."""
    across = columns or (len(images) if len(images) < 4 else 2 if len(images) == 4 else 3 if len(images) < 10 else 4)
    down = -(-len(images) // across)
    top_db = peak_db(np.array([power_db.max() for *_, power_db in images]))
    limits_db = style.limits_db or (top_db - style.dynamic_range_db, top_db)
    each_style, width_in = replace(style, limits_db=limits_db, bar=False), style.width_in or 7.0
    figure = blank_figure(width_in, 0.7 + (1.45 if across > 1 else 1.9) * down * (width_in / 7) ** 0.5)
    grid = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    speeds = []
    for axes, (velocity_mps, time_s, power_db), label in zip(grid.flat, images, labels, strict=False):
        draw_map(axes, "spectrogram", velocity_mps, time_s, power_db, style=each_style, title=label)
        if power_db.max() > limits_db[0]:  # crop to the speeds at which any image has a level above the floor
            speeds.append(axes.get_ylim())
        axes.set(xlabel="", ylabel="")
    if speeds:
        grid[0, 0].set_ylim(min(low for low, _ in speeds), max(high for _, high in speeds))  # the axes are shared
    for axes in grid.flat[len(images) :]:
        axes.set_axis_off()
    for number in range(max(0, len(images) - across), len(images)):  # the column below an empty place needs times, too
        grid.flat[number].tick_params(labelbottom=True)
    bar = figure.colorbar(grid[0, 0].collections[0], ax=grid, pad=0.015, aspect=30)
    bar.set_label("Power [dB re 1 W]", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    figure.supxlabel("Time [s]", fontsize=8)
    figure.supylabel(VELOCITY_LABEL if figure.get_size_inches()[1] > 2.8 else "Radial velocity [m/s]", fontsize=8)
    if title is not None:
        figure.suptitle(drawable("title", title), fontsize=10, parse_math=False)
    return figure


def plot_point_cloud(
    xyz_m: np.ndarray,
    speed_mps: np.ndarray,
    *,
    ax: Axes | None = None,
    title: str | None = None,
    cmap: str = "coolwarm",
    width_in: float = 7.0,
) -> Any:
    """Points in the radar's frame from above and from the side, coloured by speed, or into axes `ax` from above only; `xyz_m`
    (point, 3)."""
    speed_mps = array("speed_mps", speed_mps, ("point",), limit=1e9, unit="m/s")
    xyz_m = array("xyz_m", xyz_m, limit=LARGEST_M, unit="m")
    if xyz_m.shape != (len(speed_mps), 3):
        raise InputError(f"xyz_m must have shape ({len(speed_mps)}, 3), one row for each speed, got {xyz_m.shape}")
    if not len(xyz_m):
        raise InputError(
            "nothing to plot: the point cloud is empty; raise the false-alarm rate, or plot the range-Doppler map"
        )
    check_colours(cmap)
    figure = blank_figure(*sized(7.0, 3.6, checked_width(width_in))) if ax is None else None
    views = [checked_axes(ax)] if figure is None else [*figure.subplots(1, 2)]
    limit = max(float(np.abs(speed_mps).max()), 1e-3)
    x, y, z = xyz_m.T
    named = ((y, x, "Left [m]", "Forward [m]", "From above"), (x, z, "Forward [m]", "Up [m]", "From the side"))
    for axes, (across, up, right, upward, name) in zip(views, named, strict=False):
        drawn = axes.scatter(across, up, c=speed_mps, s=8, cmap=cmap, vmin=-limit, vmax=limit, rasterized=True)
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(alpha=0.3)
        label_axes(axes, right, upward, name if figure is not None else title)
    views[0].invert_xaxis()
    draw_bar(views[-1], drawn, VELOCITY_LABEL.partition(",")[0] if is_small(views[-1]) else VELOCITY_LABEL)
    if figure is None:
        return views[0]
    if title is not None:
        figure.suptitle(drawable("title", title), fontsize=11, parse_math=False)
    return figure


def plot_scene(
    scene: Scene,
    radar_m: np.ndarray,
    *,
    ax: Axes | None = None,
    paths_m: Sequence[tuple[str, np.ndarray]] = (),
    track_m: np.ndarray | None = None,
    title: str | None = None,
) -> Any:
    """A room from above and in three dimensions, or into axes `ax` from above only: its surfaces without the ceiling, the radar,
    paths (name, vertices (P, 3)), and the track of a target (K, 3)."""
    instance("scene", scene, Scene, "a Scene", hint="load_scene reads one")
    radar_m = array("radar_m", radar_m, (3,), limit=LARGEST_M, unit="m")
    if track_m is not None:
        track_m = array("track_m", track_m, ("time", 3), limit=LARGEST_M, unit="m")
    paths_m = _checked_paths(paths_m)
    figure = None if ax is not None else blank_figure(11.0, 4.8)
    plan: Any = checked_axes(ax) if figure is None else figure.add_subplot(1, 2, 1)
    _draw_scene(plan, 2, scene, radar_m, paths_m, track_m)
    plan.set_aspect("equal")
    plan.autoscale_view()
    label_axes(plan, "x [m]", "y [m]", title)
    legend = plan.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=7, frameon=False)
    for entry in legend.get_texts():
        entry.set_parse_math(False)
    if figure is None:
        return plan
    view: Any = figure.add_subplot(1, 2, 2, projection="3d")
    _draw_scene(view, 3, scene, radar_m, paths_m, track_m)
    extent = scene.bounds_m[1] - scene.bounds_m[0]
    view.set_box_aspect(np.maximum(extent, 0.01 * extent.max()))  # a single wall has no depth
    view.set_zlabel("z [m]")
    label_axes(view, "x [m]", "y [m]", None)
    return figure


def _draw_scene(
    axes: Any,
    dims: int,
    scene: Scene,
    radar_m: np.ndarray,
    paths_m: list[tuple[str, np.ndarray]],
    track_m: np.ndarray | None,
) -> None:
    """Draws the outlines of a scene, the radar, paths and track into axes of two or three dimensions."""
    from matplotlib.collections import LineCollection
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]

    lines, add, width = (
        (LineCollection, axes.add_collection, 1.2) if dims == 2 else (Line3DCollection, axes.add_collection3d, 0.7)
    )
    for surface in scene.surfaces:
        edges = outline(surface)
        if not len(edges) or (surface.vertices[:, 2] > scene.bounds_m[1][2] - 1e-3).all():
            continue
        hue = "black" if surface.name.startswith(("wall", "floor")) else "0.6"
        add(lines(edges[:, :, :dims].tolist(), colors=hue, linewidths=width))
    for number, (name, points) in enumerate(paths_m):
        axes.plot(*points.T[:dims], color=f"C{number % 10}", linewidth=0.9, label=name)
    if track_m is not None:
        axes.plot(*track_m.T[:dims], color="black", linewidth=2.5, label="track")
    axes.plot(*radar_m[:dims, None], marker="^", color="red", markersize=8, linestyle="none", label="radar")


def _checked_paths(paths_m: Any) -> list[tuple[str, np.ndarray]]:
    if not isinstance(paths_m, (list, tuple)) or not all(
        isinstance(path_m, (list, tuple)) and len(path_m) == 2 for path_m in paths_m
    ):
        raise InputError(f"paths_m must be a list of names and points (P, 3), got {shown(paths_m)}")
    hint = "the points of a path"
    return [
        (text("paths_m", name), array("paths_m", points, ("point", 3), limit=LARGEST_M, hint=hint))
        for name, points in paths_m
    ]


def outline(surface: Surface) -> np.ndarray:
    """Edges (E, 2, 3) at a surface's boundary and at its creases."""
    triangles = surface.vertices[surface.faces]
    sides_of_edges: dict[tuple[tuple[float, ...], ...], list[np.ndarray]] = {}
    for corners, across in zip(np.round(triangles, 6), unit(edge_cross(triangles)), strict=True):
        for k in range(3):
            ends = tuple(sorted((tuple(corners[k].tolist()), tuple(corners[(k + 1) % 3].tolist()))))
            sides_of_edges.setdefault(ends, []).append(across)
    edges = [ends for ends, sides in sides_of_edges.items() if len(sides) == 1 or np.ptp(sides, axis=0).max() > 1e-3]
    return np.array(edges).reshape(-1, 2, 3)


def plot_comparison(
    velocity_mps: np.ndarray,
    time_s: np.ndarray,
    first_db: np.ndarray,
    second_db: np.ndarray,
    *,
    labels: tuple[str, str] = ("first", "second"),
    title: str | None = None,
    dynamic_range_db: float = 50.0,
    difference_db: float = 20.0,
    cmap: str = "viridis",
    width_in: float = 7.0,
) -> Figure:
    """Two spectrograms (velocity, time) on one colour scale, and second minus first where either is above the floor."""
    first_db, second_db = numeric("first_db", first_db), numeric("second_db", second_db)
    if first_db.shape != second_db.shape:
        raise InputError(
            f"the spectrograms to compare must have one shape, got {first_db.shape} and {second_db.shape}; "
            "make them with the same radar and STFT settings"
        )
    velocity_mps, whole_s, first_db = checked_map("velocity_mps", velocity_mps, "time_s", time_s, first_db)
    velocity_mps, time_s, second_db = checked_map("velocity_mps", velocity_mps, "time_s", time_s, second_db)
    positive("difference_db", difference_db, 1000, unit="dB")
    labels = checked_labels(labels)
    figure = blank_figure(*sized(7.0, 8.0, checked_width(width_in)))
    upper, middle, lower = figure.subplots(3, 1, sharex=True, sharey=True)
    _, first_db = thinned(whole_s, first_db)
    time_s, second_db = thinned(time_s, second_db)
    peak = max(peak_db(first_db), peak_db(second_db))
    dynamic_range_db = positive("dynamic_range_db", dynamic_range_db, 1000, unit="dB", hint="50 is usual")
    style = Style(cmap=cmap, limits_db=(peak - dynamic_range_db, peak))
    for axes, power_db, label in ((upper, first_db, labels[0]), (middle, second_db, labels[1])):
        scaled_image(axes, time_s, velocity_mps, power_db, style)
        label_axes(axes, "", "", label)
    # Differences below the floor of the pictures mean nothing: both are clipped to it, and cells with both below are left out.
    floor = peak - dynamic_range_db
    difference = np.maximum(second_db, floor) - np.maximum(first_db, floor)
    difference = np.ma.masked_where((first_db < floor) & (second_db < floor), difference)
    mesh = lower.pcolormesh(
        time_s,
        velocity_mps,
        difference,
        cmap="RdBu_r",
        vmin=-difference_db,
        vmax=difference_db,
        shading="nearest",
        rasterized=True,
    )
    lower.set_facecolor("0.92")
    both = np.maximum(first_db, second_db)
    lower.set_ylim(occupied_speeds(velocity_mps, both, dynamic_range_db))
    draw_bar(lower, mesh, "Difference [dB]", extend="both")
    label_axes(lower, "Time [s]", "", f"{labels[1]} minus {labels[0]}")
    figure.supylabel(VELOCITY_LABEL, fontsize=9)
    if title is not None:
        figure.suptitle(drawable("title", title), fontsize=11, parse_math=False)
    return figure


def occupied_speeds(velocity_mps: np.ndarray, power_db: np.ndarray, dynamic_range_db: float) -> tuple[float, float]:
    """Least and greatest speed to draw: where any level is above the floor, and zero, with a margin.

    The speed axis of a radar may reach three times as far as a person's speeds; the empty part is left out.
    """
    return occupied(velocity_mps, power_db.max(axis=1), peak_db(power_db) - dynamic_range_db)
