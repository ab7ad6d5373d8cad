"""Figures for a paper: axes with units, dB relative to the peak, a perceptual map, rasterised images, no global state.

Every function returns a `matplotlib.figure.Figure`; `figure.savefig("walk.png")` or `.pdf` writes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.checks import LARGEST_M, array, instance, interval, numeric, positive, shown, text
from t2d_rt.errors import InputError
from t2d_rt.types import Scene, Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure

COLUMNS = 2000
"""More columns than any page shows; longer images are averaged (in power) down to it."""

MARGIN = 0.15
"""Of the occupied span of speeds, left free above and below it."""

SIZES_IN = {"spectrogram": (7.0, 3.6), "range_time": (7.0, 3.6), "range_doppler": (5.4, 4.2)}
"""Width and height of the figures of maps."""

LONGEST_TITLE = 300
"""Characters of a title that are drawn."""

VELOCITY_LABEL = "Radial velocity (m/s), approaching > 0"


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
        _check_colours(self.cmap)
        value = positive("dynamic_range_db", self.dynamic_range_db, 1000, unit="dB", hint="50 is usual")
        object.__setattr__(self, "dynamic_range_db", value)
        if self.limits_db is not None:
            low, high = interval("limits_db", self.limits_db, unit="dB re 1 W")
            if not -1e4 <= low < high <= 1e4:
                raise InputError(f"limits_db must be two levels, the lower one first, got {shown(self.limits_db)}")
            object.__setattr__(self, "limits_db", (low, high))

    def bounds_db(self, power_db: np.ndarray) -> tuple[float, float]:
        """Least and greatest level [dB] that colours tell apart in a map."""
        peak = _peak(power_db)
        return self.limits_db or (peak - self.dynamic_range_db, peak)


def draw_spectrogram(
    axes: Axes,
    velocity_mps: np.ndarray,
    time_s: np.ndarray,
    power_db: np.ndarray,
    *,
    scale: Scale | None = None,
    title: str | None = None,
    note: str | None = None,
) -> None:
    """As `plot_spectrogram`, into axes of a figure of one's own."""
    velocity_mps, time_s, power_db = _checked_map("velocity_mps", velocity_mps, "time_s", time_s, power_db)
    time_s, power_db = _thin(time_s, power_db)
    low, _ = _scaled_image(axes, time_s, velocity_mps, power_db, scale)
    axes.set_ylim(_occupied(velocity_mps, power_db.max(axis=1), low))
    _label(axes, "Time (s)", VELOCITY_LABEL, title)
    _note(axes, note)


def plot_spectrogram(
    velocity_mps: np.ndarray,
    time_s: np.ndarray,
    power_db: np.ndarray,
    *,
    title: str | None = None,
    note: str | None = None,
    dynamic_range_db: float = 50.0,
    limits_db: tuple[float, float] | None = None,
    cmap: str = "viridis",
) -> Figure:
    """Micro-Doppler spectrogram; `power_db` (velocity, time). `note` stands in a corner of it."""
    scale = Scale(cmap=cmap, dynamic_range_db=dynamic_range_db, limits_db=limits_db)
    figure = new_figure("spectrogram")
    draw_spectrogram(figure.subplots(), velocity_mps, time_s, power_db, scale=scale, title=title, note=note)
    return figure


def draw_range_time(
    axes: Axes,
    range_m: np.ndarray,
    time_s: np.ndarray,
    power_db: np.ndarray,
    *,
    scale: Scale | None = None,
    title: str | None = None,
    note: str | None = None,
) -> None:
    """As `plot_range_time`, into axes of a figure of one's own, and only up to the farthest range that holds anything."""
    range_m, time_s, power_db = _checked_map("range_m", range_m, "time_s", time_s, power_db)
    time_s, power_db = _thin(time_s, power_db)
    low, _ = _scaled_image(axes, time_s, range_m, power_db, scale)
    axes.set_ylim(_occupied(range_m, power_db.max(axis=1), low))
    _label(axes, "Time (s)", "Range (m)", title)
    _note(axes, note)


def plot_range_time(
    range_m: np.ndarray,
    time_s: np.ndarray,
    power_db: np.ndarray,
    *,
    title: str | None = None,
    note: str | None = None,
    dynamic_range_db: float = 50.0,
    limits_db: tuple[float, float] | None = None,
    cmap: str = "viridis",
) -> Figure:
    """Range over time; `power_db` (range, time). `note` stands in a corner of it."""
    scale = Scale(cmap=cmap, dynamic_range_db=dynamic_range_db, limits_db=limits_db)
    figure = new_figure("range_time")
    draw_range_time(figure.subplots(), range_m, time_s, power_db, scale=scale, title=title, note=note)
    return figure


def draw_range_doppler(
    axes: Axes,
    range_m: np.ndarray,
    velocity_mps: np.ndarray,
    power_db: np.ndarray,
    *,
    scale: Scale | None = None,
    title: str | None = None,
    note: str | None = None,
) -> None:
    """As `plot_range_doppler`, into axes of a figure of one's own, and only where there is anything."""
    velocity_mps, range_m, power_db = _checked_map("velocity_mps", velocity_mps, "range_m", range_m, power_db)
    low, _ = _scaled_image(axes, range_m, velocity_mps, power_db, scale)
    axes.set_ylim(_occupied(velocity_mps, power_db.max(axis=1), low))
    axes.set_xlim(_occupied(range_m, power_db.max(axis=0), low, zero=False))
    _label(axes, "Range (m)", VELOCITY_LABEL, title)
    _note(axes, note)


def plot_range_doppler(
    range_m: np.ndarray,
    velocity_mps: np.ndarray,
    power_db: np.ndarray,
    *,
    title: str | None = None,
    note: str | None = None,
    dynamic_range_db: float = 50.0,
    limits_db: tuple[float, float] | None = None,
    cmap: str = "viridis",
) -> Figure:
    """Range-Doppler map; `power_db` (velocity, range). `note` stands in a corner of it."""
    scale = Scale(cmap=cmap, dynamic_range_db=dynamic_range_db, limits_db=limits_db)
    figure = new_figure("range_doppler")
    draw_range_doppler(figure.subplots(), range_m, velocity_mps, power_db, scale=scale, title=title, note=note)
    return figure


def plot_range_angle(
    range_m: np.ndarray,
    azimuth_rad: np.ndarray,
    power_db: np.ndarray,
    *,
    title: str | None = None,
    dynamic_range_db: float = 40.0,
    cmap: str = "viridis",
) -> Figure:
    """Range-azimuth map with left on the left; `power_db` (range, azimuth)."""
    range_m, azimuth_rad, power_db = _checked_map("range_m", range_m, "azimuth_rad", azimuth_rad, power_db)
    figure = _figure(5.4, 4.2)
    axes = figure.subplots()
    _image(axes, np.degrees(azimuth_rad), range_m, power_db, dynamic_range_db, cmap)
    axes.invert_xaxis()
    _label(axes, "Azimuth (deg), left > 0", "Range (m)", title)
    return figure


def plot_point_cloud(
    xyz_m: np.ndarray, speed_mps: np.ndarray, *, title: str | None = None, cmap: str = "coolwarm"
) -> Figure:
    """Points in the radar's frame from above and from the side, coloured by speed; `xyz_m` (point, 3)."""
    speed_mps = array("speed_mps", speed_mps, ("point",), limit=1e9, unit="m/s")
    xyz_m = array("xyz_m", xyz_m, limit=LARGEST_M, unit="m")
    if xyz_m.shape != (len(speed_mps), 3):
        raise InputError(f"xyz_m must have shape ({len(speed_mps)}, 3), one row for each speed, got {xyz_m.shape}")
    if not len(xyz_m):
        raise InputError(
            "nothing to plot: the point cloud is empty; lower the threshold or look at the range-Doppler map"
        )
    figure = _figure(7.0, 3.6)
    _check_colours(cmap)
    above, side = figure.subplots(1, 2)
    limit = max(float(np.abs(speed_mps).max()), 1e-3)
    x, y, z = xyz_m.T
    for axes, across, up in ((above, y, x), (side, x, z)):
        drawn = axes.scatter(across, up, c=speed_mps, s=8, cmap=cmap, vmin=-limit, vmax=limit, rasterized=True)
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(alpha=0.3)
    above.invert_xaxis()
    _label(above, "Left (m)", "Forward (m)", "From above")
    _label(side, "Forward (m)", "Up (m)", "From the side")
    bar = figure.colorbar(drawn, ax=(above, side), pad=0.015)
    bar.set_label(VELOCITY_LABEL, fontsize=9)
    bar.ax.tick_params(labelsize=8)
    if title is not None:
        figure.suptitle(_literal("title", title), fontsize=11, parse_math=False)
    return figure


def plot_scene(
    scene: Scene,
    radar_m: np.ndarray,
    *,
    paths_m: Sequence[tuple[str, np.ndarray]] = (),
    track_m: np.ndarray | None = None,
    title: str | None = None,
) -> Figure:
    """A room from above and in three dimensions: its surfaces without the ceiling, the radar, paths (name, points (P, 3)), and a
    target's track (K, 3)."""
    from matplotlib.collections import LineCollection
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]

    instance("scene", scene, Scene, "a Scene", hint="load_scene reads one")
    radar_m = array("radar_m", radar_m, (3,), limit=LARGEST_M, unit="m")
    if track_m is not None:
        track_m = array("track_m", track_m, ("time", 3), limit=LARGEST_M, unit="m")
    figure = _figure(11.0, 4.8)
    plan, view = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
    top = scene.bounds_m[1][2]
    for surface in scene.surfaces:
        outline = _outline(surface)
        if not len(outline) or (surface.vertices[:, 2] > top - 1e-3).all():
            continue
        hue = "black" if surface.name.startswith(("wall", "floor")) else "0.6"
        plan.add_collection(LineCollection(outline[:, :, :2].tolist(), colors=hue, linewidths=1.2))
        view.add_collection3d(Line3DCollection(outline.tolist(), colors=hue, linewidths=0.7))
    for number, (name, points) in enumerate(_checked_paths(paths_m)):
        colour = f"C{number % 10}"
        plan.plot(points[:, 0], points[:, 1], color=colour, linewidth=0.9, label=name)
        view.plot(*points.T, color=colour, linewidth=0.9)
    if track_m is not None:
        plan.plot(track_m[:, 0], track_m[:, 1], color="black", linewidth=2.5, label="track")
        view.plot(*track_m.T, color="black", linewidth=2.5)
    plan.plot(*radar_m[:2], marker="^", color="red", markersize=9, linestyle="none", label="radar")
    view.plot(*radar_m[:, None], marker="^", color="red", markersize=7, linestyle="none")
    plan.set_aspect("equal")
    plan.autoscale_view()
    extent = scene.bounds_m[1] - scene.bounds_m[0]
    view.set_box_aspect(np.maximum(extent, 0.01 * extent.max()))  # one wall alone has no depth
    view.set_zlabel("z (m)")
    for axes, head in ((plan, title), (view, None)):
        _label(axes, "x (m)", "y (m)", head)
    legend = plan.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=7, frameon=False)
    for each in legend.get_texts():
        each.set_parse_math(False)
    return figure


def _checked_paths(paths_m: Any) -> list[tuple[str, np.ndarray]]:
    if not isinstance(paths_m, (list, tuple)) or not all(
        isinstance(each, (list, tuple)) and len(each) == 2 for each in paths_m
    ):
        raise InputError(f"paths_m must be a list of names and points (P, 3), got {shown(paths_m)}")
    hint = "the points of a path"
    return [
        (text("paths_m", name), array("paths_m", points, ("point", 3), limit=LARGEST_M, hint=hint))
        for name, points in paths_m
    ]


def _outline(surface: Surface) -> np.ndarray:
    """Edges (E, 2, 3) where a surface ends or bends."""
    triangles = surface.vertices[surface.faces]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    found: dict[tuple[tuple[float, ...], ...], list[np.ndarray]] = {}
    for corners, across in zip(np.round(triangles, 6), normal, strict=True):
        for k in range(3):
            ends = tuple(sorted((tuple(corners[k].tolist()), tuple(corners[(k + 1) % 3].tolist()))))
            found.setdefault(ends, []).append(across)
    kept = [ends for ends, sides in found.items() if len(sides) == 1 or np.ptp(sides, axis=0).max() > 1e-3]
    return np.array(kept).reshape(-1, 2, 3)


def plot_comparison(
    velocity_mps: np.ndarray,
    time_s: np.ndarray,
    first_db: np.ndarray,
    second_db: np.ndarray,
    *,
    labels: tuple[str, str] = ("ellipsoid", "mesh"),
    title: str | None = None,
    dynamic_range_db: float = 50.0,
    difference_db: float = 20.0,
    cmap: str = "viridis",
) -> Figure:
    """Two spectrograms (velocity, time) of one motion on one colour scale, and second minus first where either is in
    range."""
    first_db, second_db = numeric("first_db", first_db), numeric("second_db", second_db)
    if first_db.shape != second_db.shape:
        raise InputError(
            f"the spectrograms to compare must have one shape, got {first_db.shape} and {second_db.shape}; "
            "make them with the same radar and STFT settings"
        )
    velocity_mps, whole_s, first_db = _checked_map("velocity_mps", velocity_mps, "time_s", time_s, first_db)
    velocity_mps, time_s, second_db = _checked_map("velocity_mps", velocity_mps, "time_s", time_s, second_db)
    positive("difference_db", difference_db, 1000, unit="dB")
    labels = _checked_labels(labels)
    figure = _figure(7.0, 8.0)
    upper, middle, lower = figure.subplots(3, 1, sharex=True, sharey=True)
    _, first_db = _thin(whole_s, first_db)
    time_s, second_db = _thin(time_s, second_db)
    peak = max(_peak(first_db), _peak(second_db))
    for axes, power_db, label in ((upper, first_db, labels[0]), (middle, second_db, labels[1])):
        _image(axes, time_s, velocity_mps, power_db, dynamic_range_db, cmap, peak=peak)
        _label(axes, "", "", label)
    # Below the floor of the pictures a difference says nothing: clip both to it, leave out where both are below.
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
    _bar(lower, mesh, "Difference (dB)", extend="both")
    _label(lower, "Time (s)", "", f"{labels[1]} minus {labels[0]}")
    figure.supylabel(VELOCITY_LABEL, fontsize=9)
    if title is not None:
        figure.suptitle(_literal("title", title), fontsize=11, parse_math=False)
    return figure


def _checked_labels(labels: Any) -> tuple[str, str]:
    if not isinstance(labels, (list, tuple)) or len(labels) != 2 or not all(isinstance(each, str) for each in labels):
        raise InputError(f"labels must be two texts, got {shown(labels)}")
    return labels[0], labels[1]


def occupied_speeds(velocity_mps: np.ndarray, power_db: np.ndarray, dynamic_range_db: float) -> tuple[float, float]:
    """Least and greatest speed to draw: where anything rises above the floor, and zero, with a margin, within the axis.

    A radar may see three times the speed that a person has; what is left out is empty.
    """
    return _occupied(velocity_mps, power_db.max(axis=1), _peak(power_db) - dynamic_range_db)


def _occupied(axis: np.ndarray, levels_db: np.ndarray, floor_db: float, *, zero: bool = True) -> tuple[float, float]:
    """Part of an axis that holds a level above the floor and, if asked for, zero, with a margin; all of it where nothing does."""
    held = axis[levels_db > floor_db]
    if not held.size:
        return float(axis[0]), float(axis[-1])
    least, greatest = float(held.min()), float(held.max())
    if zero:
        least, greatest = min(least, 0.0), max(greatest, 0.0)
    margin = max(MARGIN * (greatest - least), 10 * float(axis[1] - axis[0]))
    return max(least - margin, float(axis[0])), min(greatest + margin, float(axis[-1]))


def new_figure(kind: str) -> Figure:
    """An empty figure of the size of a "spectrogram", a "range_time" or a "range_doppler" map."""
    return _figure(*SIZES_IN[kind])


def _figure(width_in: float, height_in: float) -> Figure:
    try:
        from t2d_rt.figures import NotebookFigure
    except ValueError as error:  # it refuses to load where its settings, such as MPLBACKEND, are wrong
        raise InputError(f"matplotlib cannot be used: {error}; correct its settings, or unset MPLBACKEND") from error

    return NotebookFigure(figsize=(width_in, height_in), dpi=160, layout="constrained")


def checked_axes(axes: Any) -> Axes:
    """Axes of a figure of Matplotlib, flat ones."""
    from matplotlib.axes import Axes

    hint = "matplotlib.pyplot.subplots() makes some"
    found: Axes = instance("ax", axes, Axes, "axes of a figure of Matplotlib", hint=hint)
    if found.name == "3d":
        raise InputError("ax must be flat, got axes in three dimensions; make others")
    return found


def _scaled_image(
    axes: Axes, x: np.ndarray, y: np.ndarray, power_db: np.ndarray, scale: Scale | None
) -> tuple[float, float]:
    """Draws a map with its colour bar, relative to the peak or, where levels are given, as it is; the levels at both ends."""
    scale = scale or Scale()
    low, high = scale.bounds_db(power_db)
    if scale.limits_db is None:
        _image(axes, x, y, power_db, scale.dynamic_range_db, scale.cmap, peak=high)
    else:
        mesh = axes.pcolormesh(
            x, y, np.maximum(power_db, low), cmap=scale.cmap, vmin=low, vmax=high, shading="nearest", rasterized=True
        )
        _bar(axes, mesh, "Power (dB re 1 W)", extend="max" if _peak(power_db) > high else "neither")
    return low, high


def _note(axes: Axes, note: str | None) -> None:
    if note is not None:
        axes.text(
            0.01, 0.02, _literal("note", note), transform=axes.transAxes, color="white", fontsize=8, parse_math=False
        )


def _image(
    axes: Axes,
    x: np.ndarray,
    y: np.ndarray,
    power_db: np.ndarray,
    dynamic_range_db: float,
    cmap: str,
    *,
    peak: float | None = None,
) -> None:
    dynamic_range_db = positive("dynamic_range_db", dynamic_range_db, 1000, unit="dB", hint="50 is usual")
    _check_colours(cmap)
    relative = np.clip(power_db - (_peak(power_db) if peak is None else peak), -dynamic_range_db, 0)
    mesh = axes.pcolormesh(
        x, y, relative, cmap=cmap, vmin=-dynamic_range_db, vmax=0, shading="nearest", rasterized=True
    )
    _bar(axes, mesh, "Power rel. to peak (dB)")


def _bar(axes: Axes, mesh: QuadMesh, label: str, extend: str = "neither") -> None:
    bar = axes.figure.colorbar(mesh, ax=axes, pad=0.015, extend=extend)
    bar.set_label(label, fontsize=9)
    bar.ax.tick_params(labelsize=8)


def _label(axes: Axes, x: str, y: str, title: str | None) -> None:
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    if title is not None:
        axes.set_title(_literal("title", title), fontsize=10, parse_math=False)


def _literal(name: str, value: Any) -> str:
    """A text that can be drawn: a file's name may hold bytes that are no characters."""
    words = text(name, value)[:LONGEST_TITLE]
    return "".join(each if each.isprintable() or each == "\n" else "\N{REPLACEMENT CHARACTER}" for each in words)


def _check_colours(cmap: Any) -> None:
    from matplotlib import colormaps
    from matplotlib.colors import Colormap

    if not isinstance(cmap, Colormap) and not (isinstance(cmap, str) and cmap in colormaps):
        raise InputError(f"cmap must be the name of a colour map of matplotlib such as viridis, got {shown(cmap)}")


def _checked_map(
    y_name: str, y: np.ndarray, x_name: str, x: np.ndarray, power_db: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Axes and levels of a map; silence, -inf dB, is a level."""
    y, x = array(y_name, y, ("rows",)), array(x_name, x, ("columns",))
    if len(x) < 1 or len(y) < 2:
        raise InputError(f"a picture needs 2 values of {y_name} and 1 of {x_name} at least, got {len(y)} and {len(x)}")
    levels = numeric("power_db", power_db)
    if levels.shape != (len(y), len(x)):
        raise InputError(f"power_db must have shape ({len(y)}, {len(x)}), that of its axes, got {levels.shape}")
    array("power_db", np.where(np.isneginf(levels.real), 0, levels), limit=1e4, unit="dB")
    return y, x, np.asarray(levels, float)


def _peak(power_db: np.ndarray) -> float:
    finite = power_db[np.isfinite(power_db)]
    if not finite.size:
        raise InputError("nothing to plot: no finite level in the map; the record is silent")
    return float(finite.max())


def _thin(time_s: np.ndarray, power_db: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most `COLUMNS` columns: powers averaged over equal groups of times."""
    step = -(-len(time_s) // COLUMNS)
    if step == 1 or power_db.shape[-1] != len(time_s):
        return time_s, power_db
    whole = len(time_s) // step * step
    power = (10 ** (power_db[:, :whole] / 10)).reshape(len(power_db), -1, step).mean(axis=-1)
    with np.errstate(divide="ignore"):  # silence is -inf dB and is drawn at the floor
        return time_s[:whole].reshape(-1, step).mean(axis=-1), 10 * np.log10(power)
