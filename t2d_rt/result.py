"""`Recording`: a radar recording with labelled axes, its configuration, its spectrogram, and the way to disk and back."""

from __future__ import annotations

import hashlib
import inspect
import json
import math
import platform
import re
import warnings
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from t2d_rt.checks import call, file_path, flag, instance, numeric
from t2d_rt.cubes import Cube, DiskCube, is_large, row_blocks
from t2d_rt.errors import InputError, printable
from t2d_rt.experiment import Experiment, Inputs, packed, unpacked
from t2d_rt.export import check_export, write_export
from t2d_rt.rows import DIMENSIONS, NAME, SavedRows, new_array
from t2d_rt.signal import range_doppler, range_profile, spectrogram
from t2d_rt.signal.doppler import check_processing
from t2d_rt.store import check_place, check_taken, replacing, settle
from t2d_rt.tables import html_table, size
from t2d_rt.types import Accuracy, Radar

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from t2d_rt.maps import Maps

FORMAT = 4
"""Of the folders that `save` writes; `load` refuses others."""
MADE_BY = "t2d-rt"
"""The mark of a result; only what carries it is replaced."""
UNMARKED_FORMATS = ("1", "2")
"""Of results from before the mark, known by their attributes."""
ARRAYS = (NAME, "spectrogram", "chirp_time_s", "sample_time_s", "velocity_mps", "time_s")
INPUTS = "inputs"
"""Folder of the arrays that the experiment names."""
FILES = re.compile(rf"zarr\.json|{INPUTS}/[0-9a-f]{{32}}\.npz|({'|'.join(ARRAYS)})/(zarr\.json|c(/\d+)*)")
"""That a result's folder holds, by their paths within it."""
LARGEST_METADATA_BYTES = 64 * 2**20
"""Of a result's zarr.json, which holds its settings."""

AXIS_UNITS = {"m": "m", "s": "s", "mps": "m/s"}
"""Units of an axis by the end of its name."""


def versions() -> dict[str, str]:
    """Versions of what a result depends on."""
    found = {"python": platform.python_version()}
    for name in ("t2d-rt", "numpy", "scipy", "drjit", "mitsuba", "sionna-rt"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # a checkout that is not installed
            found[name] = "unknown"
    return found


class Recording:
    """A radar recording, simulated or measured: ADC cube, radar, and what follows from them.

    A simulated one holds its `experiment` and `accuracy`, and the arrays that the experiment names (`inputs`), so that it can be
    made `again`. `processing` holds options of `signal.spectrogram` (mti, range_gate_m, n_window, ...); `processed` changes them.
    With clutter mti is "mean" unless another one is asked for.
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
    ) -> None:
        instance("radar", radar, Radar, "a Radar", hint="Radar.preset('table2') makes one")
        if not isinstance(cube, DiskCube):
            cube = numeric("an ADC cube", cube)
            _check_complex64(cube)
        if cube.ndim != 3 or cube.shape[2] != radar.samples:
            raise InputError(f"an ADC cube must have shape (chirp, antenna, {radar.samples}), got {cube.shape}")
        self.cube = cube
        """(chirp, antenna, sample) complex [sqrt(W)]."""
        self.radar = radar
        if experiment is not None:
            instance("experiment", experiment, Experiment, "an Experiment")
        if accuracy is not None:
            instance("accuracy", accuracy, Accuracy, "an Accuracy")
        self.experiment = experiment
        """What was simulated; None for a measured recording."""
        self.accuracy = accuracy
        """How finely it was modelled."""
        self.inputs = dict(inputs or {})
        """Arrays that the experiment names, by their hash."""
        for name, given in (("settings", settings), ("versions", versions), ("processing", processing)):
            if given is not None:
                instance(name, given, Mapping, "a mapping of names to values")
        self.settings = dict(settings or {})
        self.versions = dict(versions or {})
        self.processing = dict(processing or {})
        options = [*inspect.signature(spectrogram).parameters][2:]
        unknown = [name for name in self.processing if name not in options]
        if unknown:
            raise InputError(f"unknown spectrogram option {unknown[0]!r}; choose from {', '.join(options)}")
        self._spectrogram: xr.DataArray | None = None

    def __repr__(self) -> str:
        return f"Recording({self._cube_size}, {self._made_with})\n  of {self.radar!r}"

    def _repr_html_(self) -> str:
        error = "not measured" if self.error_db is None else f"{self.error_db:.1f} dB"
        rows = [
            ("ADC cube", f"{self._cube_size}, {8 * math.prod(self.cube.shape) / 1e6:.4g} MB"),
            ("made with", self._made_with),
            ("error of the field", error),
            ("radar", repr(self.radar)),
            ("spectrogram", ", ".join(f"{name} {value}" for name, value in self.processing.items()) or "by default"),
            ("pictures", "plot(), plot_range_time(), plot_range_doppler()"),
        ]
        return html_table("Recording", rows)

    @property
    def _cube_size(self) -> str:
        chirps, antennas, samples = self.cube.shape
        last_s = float(self.radar.chirp_starts_s(chirps)[-1]) if chirps else 0.0
        plural = "" if antennas == 1 else "s"
        return f"{size(chirps)} chirps x {antennas} antenna{plural} x {samples} samples, {last_s:.2f} s"

    @property
    def _made_with(self) -> str:
        """Method, scene and error, as far as the settings know them."""
        known = [str(self.settings[name]) for name in ("method", "scene") if name in self.settings]
        measured = [] if self.error_db is None else [f"measured error {self.error_db:.1f} dB"]
        return printable(", ".join([*known, *measured])) or "unknown settings"

    @property
    def error_db(self) -> float | None:
        """Error of the targets' field, its energy over that of a converged model's [dB], where it was measured."""
        return self.settings.get("error_db")

    @property
    def attributes(self) -> dict[str, str]:
        """What the recording was made from, as JSON texts; with `inputs` it is everything needed to make it again."""
        return {
            "radar": self.radar.model_dump_json(),
            "experiment": json.dumps(None if self.experiment is None else self.experiment.model_dump(mode="json")),
            "accuracy": json.dumps(None if self.accuracy is None else self.accuracy.model_dump(mode="json")),
            "settings": _json("settings", self.settings),
            "processing": _json("processing", self.processing),
            "versions": _json("versions", self.versions),
            "made_by": MADE_BY,
            "format": str(FORMAT),
        }

    @property
    def adc(self) -> xr.DataArray:
        """ADC samples [sqrt(W)], complex64 (chirp, antenna, sample); those of a large cube are read from disk when used."""
        times = {
            "chirp_time_s": ("chirp", self.radar.chirp_starts_s(len(self.cube))),
            "sample_time_s": ("sample", self.radar.sample_times_s),
        }
        values: Any = self.cube
        if isinstance(self.cube, DiskCube):
            from t2d_rt.lazy_array import lazy_variable

            values = lazy_variable(self.cube)
        return self._labelled(NAME, values, DIMENSIONS, times, "sqrt(W)")

    @property
    def range_profile(self) -> xr.DataArray:
        """Range FFT of every chirp [sqrt(W)], complex (chirp, antenna, range_m), in memory."""
        profile = range_profile(self.cube, self.radar, window=self.processing.get("range_window", "hann"))
        axes = {"range_m": profile.range_m, "chirp_time_s": ("chirp", profile.time_s)}
        return self._labelled("range_profile", profile.profile, ("chirp", "antenna", "range_m"), axes, "sqrt(W)")

    @property
    def spectrogram(self) -> xr.DataArray:
        """Micro-Doppler spectrogram, power [dB re 1 W] (velocity_mps, time_s), positive speed = approaching."""
        if self._spectrogram is None:
            result = spectrogram(self.cube, self.radar, **{**self.processing, "mti": self._mti})
            axes = {"velocity_mps": result.velocity_mps, "time_s": result.time_s}
            self._spectrogram = self._labelled("spectrogram", _decibel(result.power), tuple(axes), axes, "dB re 1 W")
        return self._spectrogram

    @property
    def _mti(self) -> str:
        """That asked for; by default what still surfaces return is taken away where there are any."""
        return self.processing.get("mti") or ("mean" if self.settings.get("clutter", "none") != "none" else "none")

    @property
    def range_doppler(self) -> xr.DataArray:
        """Range-Doppler map of the whole record, power [dB re 1 W] (velocity_mps, range_m)."""
        result = range_doppler(self.cube, self.radar)
        axes = {"velocity_mps": result.velocity_mps, "range_m": result.range_m}
        return self._labelled("range_doppler", _decibel(result.power), tuple(axes), axes, "dB re 1 W")

    def _labelled(
        self, name: str, values: Any, dims: tuple[str, ...], axes: Mapping[str, Any], units: str
    ) -> xr.DataArray:
        import xarray as xr

        array = xr.DataArray(values, dims=dims, coords=axes, name=name, attrs={**self.attributes, "units": units})
        for axis in axes:
            array[axis].attrs["units"] = AXIS_UNITS[axis.rpartition("_")[2]]
        return array

    def again(self, **options: Any) -> Recording:
        """The same recording simulated anew from its experiment, accuracy and inputs: the same samples, bit for bit, on the same
        machine; `options` are `device`, `memory_gb` and `progress` of `simulate`."""
        import t2d_rt

        return t2d_rt.run(self, **options)

    def processed(self, **changes: Any) -> Recording:
        """The same recording with other options of `signal.spectrogram`."""
        changed = Recording(
            self.cube,
            self.radar,
            experiment=self.experiment,
            accuracy=self.accuracy,
            inputs=self.inputs,
            settings=self.settings,
            versions=self.versions,
            processing={**self.processing, **{name: _plain(value) for name, value in changes.items()}},
        )
        check_processing(self.radar, len(self.cube), changed.processing)
        return changed

    @property
    def range_time(self) -> xr.DataArray:
        """Range over time after MTI, power [dB re 1 W] (range_m, time_s); its columns are those of the spectrogram."""
        result = self._maps.range_time()
        axes = {"range_m": result.range_m, "time_s": result.time_s}
        return self._labelled("range_time", _decibel(result.power), tuple(axes), axes, "dB re 1 W")

    def range_doppler_at(self, time_s: float | None = None, *, interval_s: float | None = None) -> xr.DataArray:
        """Range-Doppler map of one coherent interval after MTI, power [dB re 1 W] (velocity_mps, range_m).

        time_s: its middle; that of the record by default.
        interval_s: its length; that of the spectrogram's windows by default.
        """
        result, middle_s, length_s = self._maps.range_doppler_at(time_s, interval_s)
        axes = {"velocity_mps": result.velocity_mps, "range_m": result.range_m}
        array = self._labelled("range_doppler", _decibel(result.power), tuple(axes), axes, "dB re 1 W")
        array.attrs |= {"time_s": middle_s, "interval_s": length_s}
        return array

    @property
    def _maps(self) -> Maps:
        from t2d_rt.maps import Maps

        return Maps(cube=self.cube, radar=self.radar, processing=self.processing, mti=self._mti)

    @overload
    def plot(
        self, title: str | None = None, *, ax: None = None, cmap: str = "viridis", dynamic_range_db: float = 50.0,
        limits_db: tuple[float, float] | None = None,
    ) -> Figure: ...  # fmt: skip
    @overload
    def plot(
        self, title: str | None = None, *, ax: Axes, cmap: str = "viridis", dynamic_range_db: float = 50.0,
        limits_db: tuple[float, float] | None = None,
    ) -> Axes: ...  # fmt: skip
    def plot(
        self, title: str | None = None, *, ax: Axes | None = None, cmap: str = "viridis", dynamic_range_db: float = 50.0,
        limits_db: tuple[float, float] | None = None,
    ) -> Figure | Axes:  # fmt: skip
        """Spectrogram as a figure, which a notebook shows; or in the axes `ax`, which are returned.

        cmap: a colour map of Matplotlib.
        dynamic_range_db: of the colours, below the peak.
        limits_db: least and greatest level of the colours [dB re 1 W] instead, for pictures that are to be compared.
        """
        from t2d_rt.canvas import Scale
        from t2d_rt.maps import drawn
        from t2d_rt.plots import draw_spectrogram

        image = self.spectrogram
        note = None if self.error_db is None else f"measured error {self.error_db:.1f} dB"
        scale = Scale(cmap=cmap, dynamic_range_db=dynamic_range_db, limits_db=limits_db)
        maps = image.velocity_mps.values, image.time_s.values, image.values
        return drawn("spectrogram", ax, draw_spectrogram, *maps, scale=scale, title=title, note=note)

    @overload
    def plot_range_time(
        self, title: str | None = None, *, ax: None = None, cmap: str = "viridis", dynamic_range_db: float = 50.0,
        limits_db: tuple[float, float] | None = None,
    ) -> Figure: ...  # fmt: skip
    @overload
    def plot_range_time(
        self, title: str | None = None, *, ax: Axes, cmap: str = "viridis", dynamic_range_db: float = 50.0,
        limits_db: tuple[float, float] | None = None,
    ) -> Axes: ...  # fmt: skip
    def plot_range_time(
        self, title: str | None = None, *, ax: Axes | None = None, cmap: str = "viridis", dynamic_range_db: float = 50.0,
        limits_db: tuple[float, float] | None = None,
    ) -> Figure | Axes:  # fmt: skip
        """`range_time` as a figure; options as of `plot`."""
        from t2d_rt.canvas import Scale
        from t2d_rt.maps import drawn
        from t2d_rt.plots import draw_range_time

        image = self.range_time
        scale = Scale(cmap=cmap, dynamic_range_db=dynamic_range_db, limits_db=limits_db)
        maps = image.range_m.values, image.time_s.values, image.values
        return drawn("range_time", ax, draw_range_time, *maps, scale=scale, title=title)

    @overload
    def plot_range_doppler(
        self, title: str | None = None, *, time_s: float | None = None, interval_s: float | None = None, ax: None = None,
        cmap: str = "viridis", dynamic_range_db: float = 50.0, limits_db: tuple[float, float] | None = None,
    ) -> Figure: ...  # fmt: skip
    @overload
    def plot_range_doppler(
        self, title: str | None = None, *, time_s: float | None = None, interval_s: float | None = None, ax: Axes,
        cmap: str = "viridis", dynamic_range_db: float = 50.0, limits_db: tuple[float, float] | None = None,
    ) -> Axes: ...  # fmt: skip
    def plot_range_doppler(
        self, title: str | None = None, *, time_s: float | None = None, interval_s: float | None = None,
        ax: Axes | None = None, cmap: str = "viridis", dynamic_range_db: float = 50.0,
        limits_db: tuple[float, float] | None = None,
    ) -> Figure | Axes:  # fmt: skip
        """`range_doppler_at` as a figure; options as of `plot`, and time and length of the interval [s]."""
        from t2d_rt.canvas import Scale
        from t2d_rt.maps import drawn
        from t2d_rt.plots import draw_range_doppler

        image = self.range_doppler_at(time_s, interval_s=interval_s)
        scale = Scale(cmap=cmap, dynamic_range_db=dynamic_range_db, limits_db=limits_db)
        maps = image.range_m.values, image.velocity_mps.values, image.values
        note = f"{1e3 * image.attrs['interval_s']:.3g} ms around {image.attrs['time_s']:.3f} s"
        return drawn("range_doppler", ax, draw_range_doppler, *maps, scale=scale, title=title, note=note)

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

        def check() -> None:
            _check_replaceable(target, overwrite=overwrite)
            if picture is not None:
                check_taken(picture, overwrite=overwrite)

        with replacing(target, check) as new:
            self._write(new)
            if figure is not None and picture is not None:
                figure.savefig(new.with_name(picture.name))

    def export(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write ADC cube, spectrogram, axes and attributes as one file for other programs; a failure changes nothing.

        .mat for MATLAB takes cubes up to 2 GiB, .nc (NetCDF) up to 8 GiB, .h5 (HDF5, needs h5py) and .npz (NumPy) any.
        """
        import xarray as xr

        target = check_export(path, self.cube, overwrite=overwrite)
        axes = {name: axis.variable for name, axis in self.adc.coords.items()}
        labelled = xr.Dataset({"spectrogram": self.spectrogram}, coords=axes)
        labelled.spectrogram.attrs = {"units": self.spectrogram.attrs["units"]}
        write_export(target, self.cube, labelled, self.attributes, overwrite=overwrite)

    def _write(self, folder: Path) -> None:
        """The zarr group of arrays and attributes, which seal one another: see `_checksum`."""
        import xarray as xr

        adc = self.adc
        data = xr.Dataset({"spectrogram": self.spectrogram}, coords=dict(adc.coords))
        data.spectrogram.attrs = {"units": self.spectrogram.attrs["units"]}  # the rest is the same for all
        data.attrs = self.attributes
        samples, digest = new_array(folder, self.cube.shape), hashlib.sha256()
        for rows, block in row_blocks(self.cube):
            samples[rows] = block
            digest.update(np.ascontiguousarray(block, np.complex64).view(np.uint8).data)
        units, axes = adc.attrs["units"], " ".join(map(str, adc.coords))
        samples.attrs.update({"units": units, "coordinates": axes, "sha256": digest.hexdigest()})
        with warnings.catch_warnings():
            # Without consolidated metadata a plain xarray.open_zarr warns, with it the writer does; both can do either.
            warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
            data.to_zarr(folder, mode="a", consolidated=True, write_empty_chunks=True)
        if self.inputs:
            (folder / INPUTS).mkdir()
        for name, arrays in self.inputs.items():
            (folder / INPUTS / f"{name}.npz").write_bytes(packed(arrays))
        metadata = _metadata(folder)
        metadata["attributes"]["checksum"] = _checksum(folder, metadata)
        (folder / "zarr.json").write_text(json.dumps(metadata, indent=2), encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> Recording:
        """Read what `save` wrote."""
        source = file_path("path", path).resolve()
        while True:
            before = _state(source)
            try:
                return cls._read(source)
            except InputError:
                if _state(source) == before:  # else it was replaced while it was read
                    raise

    @classmethod
    def _read(cls, source: Path) -> Recording:
        if not source.is_dir():
            with suppress(OSError):  # a folder that is not there, or may only be read
                settle(source)
        if not source.is_dir():
            raise InputError(f"{source} is not a result folder; give a .zarr folder that `simulate` wrote")
        try:
            metadata = _metadata(source)
            found = metadata["attributes"]
            if found["format"] != str(FORMAT):
                raise InputError(f"{source} has format {found['format']}, expected {FORMAT}; simulate it again")
            if found["checksum"] != _checksum(source, metadata):
                raise InputError(f"{source} is damaged: it is not as it was written; simulate it again")
            attributes = {name: json.loads(found[name]) for name in ("settings", "processing", "versions")}
            radar = Radar(**json.loads(found["radar"]))
            experiment, accuracy = (json.loads(found[name]) for name in ("experiment", "accuracy"))
            inputs = {file.stem: unpacked(file) for file in sorted((source / INPUTS).glob("*.npz"))}
            rows = SavedRows.of(source)
            saved = DiskCube(rows)
            result = cls(
                saved if is_large(rows.shape) else np.asarray(saved), radar, **attributes, inputs=inputs,
                experiment=None if experiment is None else Experiment.model_validate(experiment),
                accuracy=None if accuracy is None else Accuracy.model_validate(accuracy),
            )  # fmt: skip
            if rows.sha256 != _sha256(result.cube):
                raise InputError(f"the ADC samples in {source} are damaged; simulate it again")
            return result
        except InputError:
            raise
        except Exception as error:  # files of any content
            reason = f"no {error}" if isinstance(error, KeyError) else error
            raise InputError(f"{source} does not hold a t2d-rt result ({reason}); simulate it again") from error


Simulation = Recording
"""The former name."""


def again(
    experiment: Experiment | Recording, accuracy: Accuracy | Mapping[str, Any] | None, tolerance_db: float | None
) -> tuple[Experiment, Inputs, Accuracy | Mapping[str, Any] | None, dict[str, Any]]:
    """What is to be run: the experiment, its arrays, its accuracy, and what is known of the recording beforehand."""
    instance("experiment", experiment, (Experiment, Recording), "an Experiment or a Recording")
    if isinstance(experiment, Experiment):
        return experiment, {}, accuracy, {}
    recording, made = experiment, experiment.experiment
    if made is None:
        raise InputError("a measured recording cannot be simulated again; give an Experiment or a simulated recording")
    if made.lost is not None:
        raise InputError(
            f"the recording cannot be made again: {made.lost} was computed by a function, which is not stored"
        )
    if accuracy is not None or tolerance_db is not None:
        return made, recording.inputs, accuracy, {}
    known: dict[str, Any] = {
        name: recording.settings[name] for name in ("error_db", "tolerance_db") if name in recording.settings
    }
    return made, recording.inputs, recording.accuracy, known


def _json(name: str, values: Mapping[str, Any]) -> str:
    """As text that is stored with a result."""
    try:
        return json.dumps(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} of a result must be plain numbers, texts and lists of them: {error}") from None


def _check_complex64(cube: np.ndarray) -> None:
    """Refuses samples that complex64, in which results are kept, would turn to infinity or to zero."""
    greatest = float(np.abs(cube).max(initial=0.0)) if cube.dtype.itemsize > DiskCube.dtype.itemsize else 0.0
    if greatest and not 1e-30 < greatest < 1e30:
        raise InputError(
            f"ADC samples are kept as complex64 and must lie within 1e-30..1e30 sqrt(W), got up to {greatest:.3g}; scale them"
        )


def check_free(target: Path, *, overwrite: bool) -> None:
    """Refuses a place for a result that is taken or cannot be written, before any work is done."""
    if target.is_file():
        raise InputError(f"{target} is a file and a result is a folder; choose another name")
    check_place(target, overwrite=overwrite)
    _check_replaceable(target, overwrite=overwrite)


def _check_replaceable(target: Path, *, overwrite: bool) -> None:
    """Refuses what exists, unless `overwrite` and it is a result and holds nothing else."""
    check_taken(target, overwrite=overwrite)
    if not target.exists():
        return
    try:
        attributes = _metadata(target)["attributes"]
        marked = attributes.get("made_by") == MADE_BY
        known = (
            attributes.get("format") in UNMARKED_FORMATS and {"radar", "settings", "processing"} <= attributes.keys()
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        marked = known = False
    if not (marked or known):
        raise InputError(f"{target} is a folder but not a result, so it is not replaced; choose another name")
    for path in target.rglob("*"):
        if not path.is_dir() and not FILES.fullmatch(path.relative_to(target).as_posix()):
            raise InputError(
                f"{target} is not replaced, for it holds {path.name} besides a result; move that elsewhere"
            )


def _state(folder: Path) -> tuple[int, ...] | None:
    """Changes with the folder that stands there."""
    try:
        found = folder.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_mtime_ns


def _metadata(folder: Path) -> dict[str, Any]:
    """The group's zarr.json, which holds the arrays' too."""
    path = folder / "zarr.json"
    if not path.is_file() or path.stat().st_size > LARGEST_METADATA_BYTES:
        raise ValueError("its zarr.json is missing or too large")
    found = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(found, dict):
        raise ValueError("its zarr.json is no JSON object")
    return found


def _checksum(folder: Path, metadata: Mapping[str, Any]) -> str:
    """Of the metadata but the checksum itself, and of every other file but the samples, whose own checksum is among them."""
    attributes = {name: value for name, value in metadata["attributes"].items() if name != "checksum"}
    digest = hashlib.sha256(json.dumps({**metadata, "attributes": attributes}, sort_keys=True).encode())
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if not path.is_dir()}
    for name in sorted(files):
        hidden = name.rpartition("/")[2].startswith(".")  # file systems and desktops leave such
        if name == "zarr.json" or name.startswith(f"{NAME}/c/") or hidden:
            continue
        if not files[name].is_file():
            raise InputError(f"{folder} holds {name}, which is no plain file; simulate it again")
        with files[name].open("rb") as file:
            digest.update(f"\n{name} {hashlib.file_digest(file, 'sha256').hexdigest()}".encode())
    return digest.hexdigest()


def _sha256(cube: Cube) -> str:
    digest = hashlib.sha256()
    for _, block in row_blocks(cube):
        digest.update(np.ascontiguousarray(block).view(np.uint8).data)
    return digest.hexdigest()


def _plain(value: Any) -> Any:
    """Numbers and lists in place of NumPy's, which JSON does not take."""
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _decibel(power: np.ndarray) -> np.ndarray:
    # The floor keeps exact silence finite: far below thermal noise in any bin.
    return 10 * np.log10(np.maximum(power, 1e-30))
