"""Maps of a recording with the options of its spectrogram (MTI, windows, range gate), and the learned background in the
spectrogram."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.checks import integer, positive
from t2d_rt.core.constants import SPEED_OF_LIGHT, decibel, unit_of
from t2d_rt.core.cubes import Cube
from t2d_rt.core.errors import InputError, warn
from t2d_rt.noise.background import Background, Grid, add_background, load_background
from t2d_rt.noise.background.model import step_ratio
from t2d_rt.noise.background.records import checked_level
from t2d_rt.plots.canvas import Style, StyleOptions, drawable
from t2d_rt.plots.figures import plotted
from t2d_rt.signal import coherent_interval, range_angle, range_doppler, range_doppler_over, range_time
from t2d_rt.signal.doppler import checked_windows
from t2d_rt.signal.maps import RangeAngle, RangeDoppler, RangeTime, Spectrogram
from t2d_rt.types import Radar

GHOSTS = 15
"""Greatest number of paths that are marked on a map."""
APART_PT = 11.0
"""Least distance of the numbers beside marks [pt]; they are 7 pt high."""

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class Maps:
    """Maps of an ADC cube, made with the options of its spectrogram."""

    cube: Cube
    radar: Radar
    processing: Mapping[str, Any]
    """Options of `signal.spectrogram` that were given."""
    mti: str

    def range_time(self) -> RangeTime:
        """Power over range and time, in the columns of the spectrogram."""
        n_window, overlap = self._columns()
        return range_time(
            self.cube, self.radar, range_window=self._range_window(), n_window=n_window, overlap=overlap, **self._mti()
        )

    def range_doppler_at(self, time_s: float | None, interval_s: float | None) -> tuple[RangeDoppler, float, float]:
        """Range-Doppler map of one coherent interval; also the middle and the length of the interval [s]."""
        part, radar, middle_s, length_s = self._interval(time_s, interval_s)
        return range_doppler(part, radar, range_window=self._range_window()), middle_s, length_s

    def range_angle(
        self, time_s: float | None, interval_s: float | None, options: Mapping[str, Any]
    ) -> tuple[RangeAngle, float, float]:
        """Range-azimuth map of one coherent interval of an antenna array; also the middle and the length of the interval [s]."""
        if not np.ptp(self.radar.virtual_offsets_m[:, 1]) > 1e-3 * self.radar.wavelength_m:
            raise InputError(
                f"azimuths need antennas side by side, and this radar has {self.radar.antennas} above one another or alone; "
                "simulate with an array, as radar='array-3x4'"
            )
        part, radar, middle_s, length_s = self._interval(time_s, interval_s)
        options = {"range_window": self._range_window(), **options}
        return range_angle(part, radar, mti="none", **options), middle_s, length_s

    def _interval(self, time_s: float | None, interval_s: float | None) -> tuple[np.ndarray, Radar, float, float]:
        """Rows of the cube in one coherent interval after MTI, their radar, and the interval's middle and length [s]."""
        interval = self.radar.separated.loop_interval_s
        if interval_s is None:
            chirps, _ = self._columns()
        else:
            chirps = max(2, round(positive("interval_s", interval_s, 1e6, unit="s") / interval))
        part, radar, middle_s = coherent_interval(self.cube, self.radar, time_s=time_s, chirps=chirps, **self._mti())
        return part, radar, middle_s, chirps * interval

    def range_doppler_over(self, times_s: np.ndarray) -> tuple[np.ndarray, RangeDoppler]:
        """Range-Doppler maps at the given times, of intervals as long as the spectrogram's windows; also the middles of the
        intervals [s]."""
        n_window, _ = self._columns()
        return range_doppler_over(
            self.cube,
            self.radar,
            times_s,
            range_window=self._range_window(),
            n_window=n_window,
            **self._mti(),
        )

    def _range_window(self) -> str:
        return str(self.processing.get("range_window", "hann"))

    def _mti(self) -> dict[str, Any]:
        return {"mti": self.mti} | {
            name: self.processing[name] for name in ("cutoff_mps", "kernel") if name in self.processing
        }

    def _columns(self) -> tuple[int, int]:
        """Window and overlap of the spectrogram, in chirps."""
        radar, chirps = self.radar.separated, len(self.cube)
        rows = chirps // len(self.radar.tx_offsets_m) if self.radar.multiplexing == "ddm" else chirps
        n_window, overlap = (self.processing.get(name) for name in ("n_window", "overlap"))
        return checked_windows(radar, rows, n_window, overlap, None)[:2]


def labelled_map(name: str, result: Any, attributes: Mapping[str, str]) -> xr.DataArray:
    """A map as levels [dB re 1 W] with axes; the fields of `result` are the power and then the axes, in the order of its
    dimensions."""
    axes = {field.name: getattr(result, field.name) for field in fields(result) if field.name != "power"}
    return labelled(name, decibel(result.power), tuple(axes), axes, {**attributes, "units": "dB re 1 W"})


def labelled(
    name: str, values: Any, dims: tuple[str, ...], axes: Mapping[str, Any], attributes: Mapping[str, str]
) -> xr.DataArray:
    """An xarray.DataArray of values (dims) whose axes carry the units that their names end in."""
    import xarray as xr

    array = xr.DataArray(values, dims=dims, coords=axes, name=name, attrs=attributes)
    for axis in axes:
        array[axis].attrs["units"] = unit_of(axis)
    return array


def draw_map(
    image: xr.DataArray,
    ax: Any,
    title: str | None,
    note: str | None,
    style: StyleOptions,
    paths: xr.Dataset | None = None,
) -> Figure | Axes:
    """Draws a labelled map and returns its new figure, or the axes `ax` if they are given; the strongest of `paths` are marked."""
    kind: Any = image.name
    y, x = (image[axis].values for axis in image.dims)
    result = plotted(kind, y, x, image.values, ax, Style(**style), title, note)
    if paths is not None:
        drawn_on: Any = result.axes if ax is None else [ax]
        mark_ghosts(drawn_on[0], paths, float(y[-1] - y[0]) * len(y) / (len(y) - 1))
    return result


def interval_told(image: xr.DataArray) -> str:
    """Length and middle of the interval of a map, as words for a title."""
    return f"{1e3 * image.attrs['interval_s']:.3g} ms, its middle at {image.attrs['time_s']:.3f} s"


def mark_ghosts(axes: Axes, paths: xr.Dataset, speeds_mps: float) -> None:
    """Marks the strongest paths at one instant on a range-Doppler map with numbers, and lists their names below it. Speeds are
    aliased into the `speeds_mps` that the map spans; a note says which paths are not marked."""
    range_m, speed_mps = 0.5 * SPEED_OF_LIGHT * paths.delay_s.values[..., 0], paths.speed_mps.values[..., 0]
    folded_mps = (speed_mps + speeds_mps / 2) % speeds_mps - speeds_mps / 2
    (left, right), (low, high) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    shown = (range_m > left) & (range_m < right) & (folded_mps > low) & (folded_mps < high)
    level = paths.level_dbm.values[..., 0]
    arriving = [np.unravel_index(flat_index, level.shape) for flat_index in np.argsort(-level, axis=None)]
    arriving = [at for at in arriving if np.isfinite(level[at])]
    inside = [at for at in arriving if shown[at]]
    marked = inside[:GHOSTS]
    places = np.array([(range_m[at], folded_mps[at]) for at in marked]).reshape(-1, 2)
    names = []
    for number, at in enumerate(marked, start=1):
        whose = f"{paths.target.values[at[0]]}: " if paths.sizes["target"] > 1 else ""
        folded = f" ({speed_mps[at]:.1f} m/s, folded)" if abs(speed_mps[at]) > speeds_mps / 2 else ""
        names.append(f"{number}  {whose}{paths.pair.values[at[1]]}{folded}")
    weaker = f"{len(inside) - len(marked)} weaker" if len(inside) > len(marked) else ""
    beyond = f"{len(arriving) - len(inside)} beyond the axes" if len(arriving) > len(inside) else ""
    if weaker or beyond:
        names.append("not marked: " + ", ".join(filter(None, (weaker, beyond))))
    columns = ["\n".join(names[first::2]) for first in (0, 1)]
    for column, across in zip(columns, (0.0, 0.5), strict=True):
        axes.annotate(
            drawable("names of paths", column),
            (across, 0.0),
            xytext=(0, -36),
            xycoords="axes fraction",
            textcoords="offset points",
            va="top",
            fontsize=7,
            annotation_clip=False,
            parse_math=False,
        )
    for number, (place, offset) in enumerate(zip(places, _beside(axes, places), strict=True), start=1):
        axes.plot(*place, "o", markersize=9, markerfacecolor="none", markeredgecolor="white", markeredgewidth=0.8)
        line = {"arrowstyle": "-", "color": "white", "linewidth": 0.4, "shrinkA": 1, "shrinkB": 4.5}
        axes.annotate(
            str(number),
            tuple(place),
            xytext=tuple(offset),
            textcoords="offset points",
            color="white",
            fontsize=7,
            ha="center",
            va="center",
            arrowprops=line if np.hypot(*offset) > 1.5 * APART_PT else None,
        )


def _beside(axes: Axes, places: np.ndarray) -> list[np.ndarray]:
    """Offset (2,) [points] of the number beside each mark (mark, 2): the nearest position without another mark, another number or
    the edge of the axes."""
    figure: Any = axes.figure.canvas.figure
    figure.draw_without_rendering()  # the layout determines the size of the axes
    to_points = 72 / figure.dpi
    marks, box = axes.transData.transform(places) * to_points, axes.get_window_extent().get_points() * to_points
    occupied, offsets = list(marks), []
    angles = 2 * np.pi * (np.arange(16) + 1.5) / 16
    spots = [far * np.array([np.cos(angle), np.sin(angle)]) for far in APART_PT * np.arange(1, 9) for angle in angles]
    for mark in marks:
        free = [
            spot
            for spot in spots
            if np.all(np.abs(mark + spot - box.mean(axis=0)) < np.ptp(box, axis=0) / 2 - APART_PT / 2)
            and min(np.linalg.norm(mark + spot - other) for other in occupied) > APART_PT - 1e-6
        ]
        offsets.append(free[0] if free else spots[0])
        occupied.append(mark + offsets[-1])
    return offsets


BAND = 0.05
"""Greatest relative difference between the carrier of a recording and that of the recordings from which a background was
learned."""


def background_settings(
    model: str | Path,
    *,
    seed: int = 0,
    level_db: float | None = None,
    noisy: bool = False,
    carrier_hz: float | None = None,
) -> dict[str, Any]:
    """Settings by which a recording stores its background: the model and its digest, seed and level.

    noisy: whether the recording has receiver noise; then there is a warning unless the level is given.
    carrier_hz: carrier of the recording, if known; there is a warning if the model is of another band.
    """
    if noisy and level_db is None:
        warn(
            "the recording has the receiver's noise, and the background has a noise floor of its own; simulate with "
            "noise='none', or give background_level_db"
        )
    learned = load_background(model)
    if level_db is None and not learned.calibrated:
        raise InputError(
            f"{model} was learned from recordings whose samples are not in sqrt(W); give background_level_db, the level of its "
            "noise floor [dB re 1 W]"
        )
    if carrier_hz is not None and abs(carrier_hz / learned.carrier_hz - 1) > BAND:
        what = "level and clutter" if level_db is None else "clutter"
        warn(
            f"{model} was learned at {learned.carrier_hz / 1e9:.4g} GHz and the recording is of {carrier_hz / 1e9:.4g} GHz: "
            f"{what} of the background are those of the other band; take a model that was learned from such a radar"
        )
    level = None if level_db is None else checked_level(level_db)
    return {"model": str(model), "digest": learned.digest, "seed": integer("seed", seed), "level_db": level}


def background_power(image: Spectrogram, settings: Mapping[str, Any]) -> np.ndarray:
    """Power [W] of a spectrogram plus the background that a recording's settings describe."""
    return add_background(image.power, background(image.velocity_mps, image.time_s, settings), settings["level_db"])


def background(velocity_mps: np.ndarray, time_s: np.ndarray, settings: Mapping[str, Any]) -> Background:
    """The background that a recording's settings describe, alone, on the axes of a spectrogram."""
    learned = load_background(settings["model"])
    if learned.digest != settings["digest"]:
        raise InputError(
            f"{settings['model']} is no longer the background model that the recording was made with; put that back, or give the "
            "recording a background anew"
        )
    grid = Grid.of_columns(velocity_mps, time_s)
    return learned.columns(len(time_s), seed=settings["seed"], grid=grid)


def check_axes(model: str | Path, radar: Radar, processing: Mapping[str, Any]) -> None:
    """Refuses a radar and spectrogram options whose axes the background model does not support, before anything is simulated."""
    radar = radar.separated
    plenty = radar.loops_per_frame or 1 << 20
    options = [processing.get(name) for name in ("n_window", "overlap", "n_fft")]
    n_window, overlap, n_fft = checked_windows(radar, plenty, *options)
    step = n_window - overlap
    bursts = radar.loops_per_frame is not None
    if bursts and n_window + step <= plenty:
        raise InputError(
            "columns of bursts are not evenly spaced in time: set n_window to the whole burst for a background"
        )
    step_s = radar.frame_interval_s if bursts and radar.frame_interval_s is not None else step * radar.loop_interval_s
    step_ratio(load_background(model).grid, Grid.of(radar.speed_axis_mps(n_fft), step_s))
