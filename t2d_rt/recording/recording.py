"""`Recording`: a radar recording, simulated or measured, with labelled axes, its settings, its spectrogram and other maps."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.calls import public
from t2d_rt.core.checks import call, file_path, flag, instance, integer, numeric
from t2d_rt.core.cube_storage import DIMENSIONS, NAME
from t2d_rt.core.cubes import Cube, DiskCube, check_complex64
from t2d_rt.core.errors import InputError, html_table, printable, size
from t2d_rt.core.stored_arrays import Inputs
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up_again
from t2d_rt.recording.files import (
    FORMAT,
    MADE_BY,
    check_export,
    check_free,
    check_replaceable,
    json_text,
    not_a_result,
    plain,
    read_folder,
    write_export,
    write_folder,
)
from t2d_rt.recording.maps import (
    Maps,
    background_power,
    background_settings,
    draw_map,
    interval_told,
    labelled,
    labelled_map,
)
from t2d_rt.recording.parts import GROUPS, MOST_POSES, Parts, poses_of
from t2d_rt.recording.path_table import checked_times, path_table
from t2d_rt.recording.truth import Doing, doings, truth_table
from t2d_rt.signal import point_cloud, range_doppler, range_profile, spectrogram
from t2d_rt.signal.doppler import check_names, check_processing
from t2d_rt.signal.multiplex import check_axes
from t2d_rt.types import Accuracy, Radar

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from t2d_rt.pipeline.echo_model import Model
    from t2d_rt.plots.canvas import StyleOptions
    from t2d_rt.signal.maps import PointCloud
    from t2d_rt.view import Viewer


def cube_size(shape: tuple[int, ...], radar: Radar) -> str:
    """Shape and duration of a cube (chirp, antenna, sample), as text."""
    chirps, antennas, samples = shape
    last_s = float(radar.chirp_starts_s(chirps)[-1]) if chirps else 0.0
    plural = "" if antennas == 1 else "s"
    return f"{size(chirps)} chirps x {antennas} antenna{plural} x {samples} samples, {last_s:.2f} s"


def made_with(settings: Mapping[str, Any], *, measured: bool) -> str:
    """A short text on how a recording was made: method, scene, error and SNR as far as the settings have them, or that it was
    measured."""
    parts = [str(settings[name]) for name in ("method", "scene") if name in settings]
    if settings.get("error_db") is not None:
        parts.append(f"measured error {settings['error_db']:.1f} dB")
    if (
        settings.get("snr_db") is not None and settings.get("noise_dbm") is not None
    ):  # recordings of earlier versions have an SNR relative to white noise alone
        parts.append(f"SNR {settings['snr_db']:.1f} dB")
    return printable(", ".join(parts)) or ("measured" if measured else "simulated")


def at_a_glance(
    shape: tuple[int, ...], radar: Radar, settings: Mapping[str, Any], processing: Mapping[str, Any], *, measured: bool
) -> str:
    """The HTML table by which a notebook shows a recording with a cube of that shape (chirp, antenna, sample)."""
    error = "not measured" if settings.get("error_db") is None else f"{settings['error_db']:.1f} dB"
    pictures = "plot(), plot_range_time(), plot_range_doppler(), view()"
    rows = [
        ("ADC cube", f"{cube_size(shape, radar)}, {8 * math.prod(shape) / 1e6:.4g} MB"),
        ("made with", made_with(settings, measured=measured)),
        ("error of the field", error),
        ("noise", noise_of(settings, measured=measured)),
        ("radar", repr(radar)),
        ("spectrogram", ", ".join(f"{name} {value}" for name, value in processing.items()) or "by default"),
        ("pictures", pictures),
    ]
    return html_table("Recording", rows)


def whole(settings: Mapping[str, Any]) -> None:
    """Refuses a part of a recording where only a whole recording will do."""
    if "part" in settings:
        raise InputError(f"this is the part {settings['part']} of a recording; take the whole recording")


def noise_of(settings: Mapping[str, Any], *, measured: bool) -> str:
    """A short text on the receiver: its effects and the level of its noise."""
    if "part" in settings:
        return "none: a part of a recording"
    if "noise" not in settings:
        return "as it was measured" if measured else "none"
    noise_dbm = settings.get("noise_dbm")
    return ", ".join([str(settings["noise"]), *([] if noise_dbm is None else [f"together {noise_dbm:.1f} dBm"])])


@public
class Recording:
    """A radar recording, simulated or measured: ADC cube, radar, and what follows from them.

    A simulated recording holds its `experiment` and `accuracy`, and the arrays that the experiment names (`inputs`), so that it can
    be simulated `again`. `processing` holds options of `signal.spectrogram` (mti, range_gate_m, n_window, ...), which `processed`
    changes. If the scene has clutter, mti is "mean" by default.
    """

    def __init__(
        self,
        cube: Cube,
        radar: Radar,
        *,
        experiment: Experiment | None = None,
        accuracy: Accuracy | None = None,
        inputs: Inputs | None = None,
        settings: Mapping[str, Any] | None = None,
        versions: Mapping[str, str] | None = None,
        processing: Mapping[str, Any] | None = None,
        parts: Mapping[str, DiskCube] | None = None,
    ) -> None:
        instance("radar", radar, Radar, "a Radar", hint="Radar.preset('table2') makes one")
        if not isinstance(cube, DiskCube):
            cube = numeric("an ADC cube", cube)
            check_complex64(cube)
        check_axes(cube.shape, radar)
        self.cube = cube
        """ADC samples (chirp, antenna, sample), complex [sqrt(W)]."""
        self.radar = radar
        if experiment is not None:
            instance("experiment", experiment, Experiment, "an Experiment")
        if accuracy is not None:
            instance("accuracy", accuracy, Accuracy, "an Accuracy")
        self.experiment = experiment
        """The experiment that was simulated; None for a measured recording."""
        self.accuracy = accuracy
        """The accuracy with which it was modelled; None for a measured recording."""
        self.inputs = dict(inputs or {})
        """Arrays to which the experiment refers, by their hash."""
        for name, mapping in (("settings", settings), ("versions", versions), ("processing", processing)):
            if mapping is not None:
                instance(name, mapping, Mapping, "a mapping of names to values")
        self.settings = dict(settings or {})
        self.versions = dict(versions or {})
        self.processing = dict(processing or {})
        check_names(self.processing)
        self.parts = Parts(self, parts or {})
        """The parts of the recording (by segment, path pair, target or number of bounces), if it was simulated with `split`."""
        self._spectrogram: xr.DataArray | None = None

    def __repr__(self) -> str:
        how = made_with(self.settings, measured=self.experiment is None)
        return f"Recording({how}, {self.radar.carrier_hz / 1e9:.4g} GHz, {cube_size(self.cube.shape, self.radar)})"

    def _repr_html_(self) -> str:
        measured = self.experiment is None
        return at_a_glance(self.cube.shape, self.radar, self.settings, self.processing, measured=measured)

    @property
    def error_db(self) -> float | None:
        """Field error of the targets' echoes [dB]: energy of the difference from a converged model over the energy of the field;
        None where it was not measured."""
        return self.settings.get("error_db")

    @property
    def snr_db(self) -> float | None:
        """Signal-to-noise ratio [dB] averaged over all samples: power of the echoes that change from chirp to chirp over that of
        what the receiver added (`noise_dbm`); None without noise. Coherent processing raises it by the number of samples that are
        added."""
        # Recordings of earlier versions have an SNR relative to white noise alone, and no noise_dbm.
        return None if self.noise_dbm is None else self.settings.get("snr_db")

    @property
    def noise_dbm(self) -> float | None:
        """Power of everything that the receiver added to a complex ADC sample and that changes from chirp to chirp [dBm]; None
        without noise."""
        return self.settings.get("noise_dbm")

    @property
    def noise_floor_dbm(self) -> float | None:
        """Power of white noise (thermal and quantisation) in a complex ADC sample, in closed form [dBm]; None where there is
        none."""
        return self.settings.get("noise_floor_dbm")

    @property
    def attributes(self) -> dict[str, str]:
        """How the recording was made, as JSON texts; with `inputs` this is everything that is needed to make it again."""
        return {
            "radar": self.radar.model_dump_json(),
            "experiment": json.dumps(None if self.experiment is None else self.experiment.model_dump(mode="json")),
            "accuracy": json.dumps(None if self.accuracy is None else self.accuracy.model_dump(mode="json")),
            "settings": json_text("settings", self.settings),
            "processing": json_text("processing", self.processing),
            "versions": json_text("versions", self.versions),
            "made_by": MADE_BY,
            "format": str(FORMAT),
        }

    @property
    def adc(self) -> xr.DataArray:
        """ADC samples [sqrt(W)], complex64 (chirp, antenna, sample); those of a large cube are computed or read only when they are
        used."""
        times = {
            "chirp_time_s": ("chirp", self.radar.chirp_starts_s(len(self.cube))),
            "sample_time_s": ("sample", self.radar.sample_times_s),
        }
        values: Any = self.cube
        if isinstance(self.cube, DiskCube):
            from t2d_rt.core.lazy_array import lazy_variable

            values = lazy_variable(self.cube)
        return labelled(NAME, values, DIMENSIONS, times, {**self.attributes, "units": "sqrt(W)"})

    @property
    def range_profile(self) -> xr.DataArray:
        """Range FFT of every chirp [sqrt(W)], complex (chirp, antenna, range_m), in memory."""
        profile = range_profile(self.cube, self.radar, window=self.processing.get("range_window", "hann"))
        axes = {"range_m": profile.range_m, "chirp_time_s": ("chirp", profile.time_s)}
        dims, attributes = ("chirp", "antenna", "range_m"), {**self.attributes, "units": "sqrt(W)"}
        return labelled("range_profile", profile.profile, dims, axes, attributes)

    @property
    def spectrogram(self) -> xr.DataArray:
        """Micro-Doppler spectrogram, power [dB re 1 W] (velocity_mps, time_s), positive speed = approaching."""
        if self._spectrogram is None:
            result = spectrogram(self.cube, self.radar, **{**self.processing, "mti": self._mti})
            added = self.settings.get("background")
            result = result if added is None else replace(result, power=background_power(result, added))
            self._spectrogram = labelled_map("spectrogram", result, self.attributes)
        return self._spectrogram

    @property
    def _mti(self) -> str:
        """The MTI filter that was asked for; by default "mean" where the scene has clutter, which the filter removes."""
        return self.processing.get("mti") or ("mean" if self.settings.get("clutter", "none") != "none" else "none")

    @property
    def range_doppler(self) -> xr.DataArray:
        """Range-Doppler map of the whole record, power [dB re 1 W] (velocity_mps, range_m)."""
        return labelled_map("range_doppler", range_doppler(self.cube, self.radar), self.attributes)

    @property
    def paths(self) -> xr.Dataset:
        """The paths to the targets every 40 ms: delay, speed, level, directions and surfaces; computed anew on each access."""
        return self.paths_at()

    def paths_at(self, times_s: Any = None) -> xr.Dataset:
        """The same as `paths`, at instants of the record (K,) [s]; docs/rooms.md explains the variables."""
        return path_table(*self._set_up(times_s))

    @property
    def truth(self) -> xr.Dataset:
        """Ground truth every 20 ms: joints, segments and contacts of persons, range and speed of all targets; computed anew on each
        access."""
        return self.truth_at()

    def truth_at(self, times_s: Any = None, *, visible: bool = True) -> xr.Dataset:
        """The same as `truth`, at instants of the record (K,) [s]; docs/results-and-files.md explains the variables. With `visible`
        False the visible fractions, which take most of the time, are left out."""
        return truth_table(*self._set_up(times_s), visible=flag("visible", visible))

    @property
    def activities(self) -> list[Doing]:
        """What each person does in which interval of the record [s], as far as the motions say."""
        return doings(self._set_up(None)[0])

    def _set_up(self, times_s: Any) -> tuple[Model, Accuracy, np.ndarray | None]:
        whole(self.settings)
        model = set_up_again(self.experiment, self.inputs).model
        return model, self.accuracy or Accuracy(), checked_times(model, times_s)

    def view(self, *others: Recording) -> Viewer:
        """An interactive page with body, room, paths and maps on one timeline, to show in a notebook or to `save`; with another
        recording, both side by side."""
        import t2d_rt

        return t2d_rt.Viewer([self, *others])

    def again(self, **options: Any) -> Recording:
        """Simulates the same samples again, bit for bit on the same machine; options are `device`, `memory_gb` and `progress` of
        `simulate`."""
        import t2d_rt

        return t2d_rt.run(self, **options)

    def _with(self, **changes: Any) -> Recording:
        """A copy made with other constructor arguments."""
        names = ("cube", "radar", "experiment", "accuracy", "inputs", "settings", "versions", "processing")
        return Recording(**{name: getattr(self, name) for name in names} | {"parts": self.parts.cubes} | changes)

    def processed(self, **changes: Any) -> Recording:
        """A copy of the recording with other options of `signal.spectrogram`."""
        processing = {**self.processing, **{name: plain(value) for name, value in changes.items()}}
        changed = self._with(processing=processing)
        check_processing(self.radar, len(self.cube), changed.processing)
        return changed

    def _of_part(self, name: str, cube: DiskCube) -> Recording:
        """A part of this recording as a recording, with the same processing. It has no experiment, since that describes the
        whole."""
        settings: dict[str, Any] = {key: self.settings[key] for key in ("method", "scene") if key in self.settings}
        processing = {**self.processing, "mti": self._mti}
        return Recording(cube, self.radar, settings={**settings, "part": name}, processing=processing)

    def strongest(self, velocity_mps: float, time_s: float) -> xr.Dataset:
        """The parts in a cell of the spectrogram, strongest first, and their levels: see `Parts.strongest`."""
        return self.parts.strongest(velocity_mps, time_s)

    def with_background(
        self, model: str | Path = "default", *, seed: int = 0, level_db: float | None = None
    ) -> Recording:
        """The same recording with a learned background in its spectrogram; its samples and other maps stay as they are.

        model: "default", or a .safetensors file that t2d-rt background train wrote.
        level_db: level of the background's noise floor, its median cell [dB re 1 W]; by default that of one of the recordings that
            it was learned from.
        """
        changed = self.processed()
        changed.settings["background"] = background_settings(
            model, seed=seed, level_db=level_db, noisy=self.noise_dbm is not None, carrier_hz=self.radar.carrier_hz
        )
        return changed

    @property
    def range_time(self) -> xr.DataArray:
        """Power over range and time after MTI [dB re 1 W], (range_m, time_s); its columns are those of the spectrogram."""
        return labelled_map("range_time", self._maps.range_time(), self.attributes)

    def range_doppler_at(self, time_s: float | None = None, *, interval_s: float | None = None) -> xr.DataArray:
        """Range-Doppler map of one coherent interval, power [dB re 1 W] (velocity_mps, range_m), after MTI as `processed` sets it.

        By default there is MTI where a simulated scene has clutter; `processed(mti="mean")` removes static echoes from measured
        samples, too.

        time_s: middle of the interval; that of the record by default.
        interval_s: length of the interval; that of the spectrogram's windows by default.
        """
        result, middle_s, length_s = self._maps.range_doppler_at(time_s, interval_s)
        return labelled_map("range_doppler", result, self.attributes).assign_attrs(time_s=middle_s, interval_s=length_s)

    def range_angle(
        self, time_s: float | None = None, *, interval_s: float | None = None, **options: Any
    ) -> xr.DataArray:
        """Range-azimuth map (left > 0) of one coherent interval of an antenna array after MTI, power [dB re 1 W] (range_m,
        azimuth_rad); time and interval as in `range_doppler_at`, options as in `signal.range_angle`."""
        result, middle_s, length_s = self._maps.range_angle(time_s, interval_s, options)
        return labelled_map("range_angle", result, self.attributes).assign_attrs(time_s=middle_s, interval_s=length_s)

    def point_cloud(self, **options: Any) -> PointCloud:
        """Detections frame by frame: range, direction, speed, SNR; options as in `signal.point_cloud`."""
        return point_cloud(self.cube, self.radar, **options)

    @property
    def _maps(self) -> Maps:
        return Maps(cube=self.cube, radar=self.radar, processing=self.processing, mti=self._mti)

    def plot(self, title: str | None = None, *, ax: Axes | None = None, **style: Unpack[StyleOptions]) -> Any:
        """Spectrogram as a figure; or in the axes `ax`, which are returned: a figure of several gets a constrained layout by it.

        cmap: a colour map of Matplotlib.
        dynamic_range_db: of the colours, below the peak; 50 by default.
        limits_db: least and greatest level of the colours [dB re 1 W] instead, for pictures that are to be compared.
        bar: whether a colour bar is drawn; a grid of pictures on one scale needs only one.
        width_in: width of the figure [inch]: 3.5 for a column of a paper, 7 for its width.
        """
        note = None if self.error_db is None else f"measured error {self.error_db:.1f} dB"
        return draw_map(self.spectrogram, ax, title, note, style)

    def plot_range_time(
        self, title: str | None = None, *, ax: Axes | None = None, **style: Unpack[StyleOptions]
    ) -> Any:
        """`range_time` as a figure; options as in `plot`."""
        return draw_map(self.range_time, ax, title, None, style)

    def plot_range_doppler(
        self,
        title: str | None = None,
        *,
        time_s: float | None = None,
        interval_s: float | None = None,
        ghosts: bool = False,
        ax: Axes | None = None,
        **style: Unpack[StyleOptions],
    ) -> Any:
        """`range_doppler_at` as a figure; options as of `plot`, and time and length of the interval [s].

        ghosts: whether the strongest paths are marked at their ranges and speeds, and their names listed.
        """
        image = self.range_doppler_at(time_s, interval_s=interval_s)
        paths = self.paths_at(image.attrs["time_s"]) if flag("ghosts", ghosts) else None
        return draw_map(image, ax, title, interval_told(image), style, paths)

    def plot_range_angle(
        self,
        title: str | None = None,
        *,
        time_s: float | None = None,
        interval_s: float | None = None,
        ax: Axes | None = None,
        **style: Unpack[StyleOptions],
    ) -> Any:
        """`range_angle` as a figure; options as of `plot`, and time and length of the interval [s]."""
        image = self.range_angle(time_s, interval_s=interval_s)
        return draw_map(image, ax, title, interval_told(image), style)

    def plot_point_cloud(self, title: str | None = None, *, ax: Axes | None = None, **style: Any) -> Any:
        """`point_cloud` from above and from the side; into axes `ax` from above only. `cmap` and `width_in` as in `plot`."""
        from t2d_rt.plots import plot_point_cloud

        cloud = self.point_cloud()
        return plot_point_cloud(cloud.xyz_m, cloud.speed_mps, ax=ax, title=title, **style)

    def plot_parts(
        self, title: str | None = None, *, groups: Mapping[str, Sequence[str]] | None = None, stacked: bool = False,
        poses: int = 0, ax: Axes | None = None, **style: Unpack[StyleOptions],
    ) -> Figure | Axes:  # fmt: skip
        """The spectrogram coloured by its `parts`: hue by the strongest in a cell, lightness by the level; options as of `plot`.

        groups: parts to be combined, by the name of the group; by default the segments of a body are combined to limbs.
        stacked: whether the spectrograms of the parts are drawn separately instead, all on one scale.
        poses: number of instants at which the targets are drawn above the spectrogram in the same colours, with the radar on their
            right.
        """
        from t2d_rt.plots import plot_parts, plot_stacked_parts

        groups = GROUPS if groups is None else groups
        if ax is not None and (flag("stacked", stacked) or poses):
            raise InputError("ax holds the coloured spectrogram alone; leave it out, or stacked and poses")
        parts, whole = self.parts.grouped(groups), self.spectrogram
        speeds, times = whole.velocity_mps.values, whole.time_s.values
        options: dict[str, Any] = {"parts_db": parts.spectrogram.values, "names": list(parts), "title": title, **style}
        if stacked:
            if poses:
                raise InputError("a stacked picture has no bodies; leave out stacked, or poses")
            return plot_stacked_parts(speeds, times, **options)
        if integer("poses", poses, 0, MOST_POSES):
            model, *_ = self._set_up(None)
            options["poses"] = poses_of(model, self.settings.get("split"), self.parts.members(groups), poses)
        return plot_parts(speeds, times, whole.values, ax=ax, **options)

    def save(self, path: str | Path, *, overwrite: bool = False, figure: Figure | None = None) -> None:
        """Write adc and spectrogram with all attributes to a zarr folder; a failure leaves things as they were.

        With a `figure`, <name>.png beside it, both or neither.
        """
        target = file_path("path", path).resolve()
        flag("overwrite", overwrite)
        if figure is not None:
            call("figure.savefig", getattr(figure, "savefig", None), "a method of a figure of Matplotlib")
        picture = None if figure is None else target.with_suffix(".png")
        check_free(target, overwrite=overwrite)
        with replacing(target, partial(check_replaceable, target, picture, overwrite=overwrite)) as new:
            self._write(new)
            if figure is not None and picture is not None:
                figure.savefig(new.with_name(picture.name))

    def export(self, path: str | Path, *, truth: bool = False, overwrite: bool = False) -> None:
        """Write ADC cube, spectrogram, axes and attributes as one file for other programs; a failure changes nothing.

        .mat for MATLAB takes cubes up to 2 GiB, .nc (NetCDF) up to 8 GiB, .h5 (HDF5, needs h5py) and .npz (NumPy) any.
        truth: whether `truth` is written too, each of its arrays and axes with `truth_` before its name.
        """
        target = check_export(path, self.cube, overwrite=overwrite)
        labelled = self._labelled_spectrogram()
        if flag("truth", truth):
            data = self.truth
            labelled = labelled.merge(data.rename({name: f"truth_{name}" for name in (*data.variables, *data.sizes)}))
        write_export(target, self.cube, labelled, self.attributes, overwrite=overwrite)

    def _write(self, folder: Path) -> None:
        labelled, adc = self._labelled_spectrogram(), self.adc
        labelled.attrs = self.attributes
        adc_attributes = {"units": adc.attrs["units"], "coordinates": " ".join(map(str, adc.coords))}
        write_folder(folder, self.cube, labelled, adc_attributes, self.inputs, self.parts.cubes)

    def _labelled_spectrogram(self) -> xr.Dataset:
        """The spectrogram with its units as only attributes, together with the axes of the samples."""
        import xarray as xr

        axes = {name: axis.variable for name, axis in self.adc.coords.items()}
        data = xr.Dataset({"spectrogram": self.spectrogram}, coords=axes)
        data.spectrogram.attrs = {"units": self.spectrogram.attrs["units"]}
        return data

    @classmethod
    def load(cls, path: str | Path) -> Recording:
        """Reads a recording that `save` wrote."""
        source = file_path("path", path).resolve()
        contents = read_folder(source)
        try:
            return cls(**contents)
        except InputError:
            raise
        except Exception as error:  # the attributes may hold anything
            raise not_a_result(source, error) from error
