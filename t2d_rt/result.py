"""`Simulation`: a radar recording with labelled axes, its configuration, its spectrogram, and the way to disk and back."""

from __future__ import annotations

import inspect
import json
import platform
import shutil
import tempfile
import warnings
import zlib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.checks import file_path, flag, instance, numeric, text
from t2d_rt.cubes import DIMENSIONS, NAME, Cube, DiskCube, is_large, new_array, row_blocks
from t2d_rt.errors import InputError
from t2d_rt.signal import range_doppler, range_profile, spectrogram
from t2d_rt.signal.doppler import check_processing
from t2d_rt.types import Radar

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

FORMAT = 2
"""Of the folders that `save` writes; `load` refuses others."""

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


class Simulation:
    """ADC cube and what follows from it.

    `processing` holds options of `signal.spectrogram` (mti, range_gate_m, n_window, ...); `processed` changes them. With clutter
    mti is "mean" unless another one is asked for.
    """

    def __init__(
        self,
        cube: Cube,
        radar: Radar,
        *,
        settings: Mapping[str, Any] | None = None,
        versions: Mapping[str, str] | None = None,
        processing: Mapping[str, Any] | None = None,
    ) -> None:
        instance("radar", radar, Radar, "a Radar", hint="Radar.preset('table2') makes one")
        if not isinstance(cube, DiskCube):
            cube = numeric("an ADC cube", cube)
        if cube.ndim != 3 or cube.shape[2] != radar.samples:
            raise InputError(f"an ADC cube must have shape (chirp, antenna, {radar.samples}), got {cube.shape}")
        self.cube = cube
        """(chirp, antenna, sample) complex [sqrt(W)]."""
        self.radar = radar
        self.settings = dict(settings or {})
        self.versions = dict(versions or {})
        self.processing = dict(processing or {})
        options = [*inspect.signature(spectrogram).parameters][2:]
        unknown = [name for name in self.processing if name not in options]
        if unknown:
            raise InputError(f"unknown spectrogram option {unknown[0]!r}; choose from {', '.join(options)}")
        self._spectrogram: xr.DataArray | None = None

    @property
    def error_db(self) -> float | None:
        """Error of the targets' field, its energy over that of a converged model's [dB], where it was measured."""
        return self.settings.get("error_db")

    @property
    def attributes(self) -> dict[str, str]:
        """Everything needed to make the result again, as JSON texts."""
        return {
            "radar": self.radar.model_dump_json(),
            "settings": json.dumps(self.settings),
            "processing": json.dumps(self.processing),
            "versions": json.dumps(self.versions),
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
            import xarray as xr

            values = xr.open_zarr(self.cube.folder, consolidated=False)[NAME].variable
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

    def processed(self, **changes: Any) -> Simulation:
        """The same recording with other options of `signal.spectrogram`."""
        changed = Simulation(
            self.cube,
            self.radar,
            settings=self.settings,
            versions=self.versions,
            processing={**self.processing, **{name: _plain(value) for name, value in changes.items()}},
        )
        check_processing(self.radar, len(self.cube), changed.processing)
        return changed

    def plot(self, title: str | None = None) -> Figure:
        """Spectrogram as a figure."""
        from t2d_rt.plots import plot_spectrogram

        if title is not None:
            text("title", title)
        image = self.spectrogram
        note = None if self.error_db is None else f"measured error {self.error_db:.1f} dB"
        return plot_spectrogram(image.velocity_mps.values, image.time_s.values, image.values, title=title, note=note)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write adc and spectrogram with all attributes to a zarr folder; a failure leaves things as they were."""
        import xarray as xr

        target = file_path("path", path).resolve()
        flag("overwrite", overwrite)
        check_free(target, overwrite=overwrite)
        adc = self.adc
        data = xr.Dataset({"spectrogram": self.spectrogram}, coords=dict(adc.coords))
        data.spectrogram.attrs = {"units": self.spectrogram.attrs["units"]}  # the rest is the same for all
        data.attrs = {**self.attributes, "checksum": _checksum(self.cube)}
        # Written beside its place, so that moving it there is one step of the file system.
        beside = [target.with_name(f".{target.name}.{state}") for state in ("partial", "replaced")]
        partial, replaced = beside
        try:
            shutil.rmtree(partial, ignore_errors=True)
            samples = new_array(partial, self.cube.shape)
            samples.attrs.update({"units": adc.attrs["units"], "coordinates": " ".join(map(str, adc.coords))})
            for rows, block in row_blocks(self.cube):
                samples[rows] = block
            with warnings.catch_warnings():
                # Without consolidated metadata a plain xarray.open_zarr warns, with it the writer does; both can do either.
                warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
                data.to_zarr(partial, mode="a", consolidated=True)
            if target.exists():
                target.rename(replaced)
            partial.rename(target)
        except OSError as error:
            raise InputError(
                f"cannot write {target}: {error.strerror or error}; free space or choose a writable place"
            ) from error
        finally:
            if replaced.exists() and not target.exists():
                replaced.rename(target)
            for folder in beside:
                shutil.rmtree(folder, ignore_errors=True)

    @classmethod
    def load(cls, path: str | Path) -> Simulation:
        """Read what `save` wrote."""
        import xarray as xr

        source = file_path("path", path)
        if not source.is_dir():
            raise InputError(f"{source} is not a result folder; give a .zarr folder that `simulate` wrote")
        try:
            with xr.open_zarr(source) as data:
                if data.attrs["format"] != str(FORMAT):
                    raise InputError(
                        f"{source} has format {data.attrs['format']}, expected {FORMAT}; simulate it again"
                    )
                attributes = {name: json.loads(data.attrs[name]) for name in ("settings", "processing", "versions")}
                radar = Radar(**json.loads(data.attrs["radar"]))
                cube = DiskCube(source) if is_large(data[NAME].shape) else data[NAME].values
                result = cls(cube, radar, **attributes)
                # zarr reads a missing piece as zeros
                if data.attrs["checksum"] != _checksum(result.cube):
                    raise InputError(f"the ADC samples in {source} are damaged; simulate it again")
                return result
        except InputError:
            raise
        except Exception as error:  # xarray, zarr and its codecs raise what they like
            reason = f"no {error}" if isinstance(error, KeyError) else error
            raise InputError(f"{source} does not hold a t2d-rt result ({reason}); simulate it again") from error


def check_free(target: Path, *, overwrite: bool) -> None:
    """Refuses a place for a result that is taken or cannot be written, before any work is done."""
    if target.is_file():
        raise InputError(f"{target} is a file and a result is a folder; choose another name")
    check_place(target, overwrite=overwrite)
    if target.is_dir() and not (target / "zarr.json").is_file():
        raise InputError(f"{target} is a folder but not a result, so it is not replaced; choose another name")


def check_place(path: Path, *, overwrite: bool) -> None:
    """Refuses what exists, unless `overwrite`, and folders that are not there or cannot be written to."""
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists already; choose another name or pass --overwrite (overwrite=True)")
    folder = path.parent
    if not folder.is_dir():
        raise InputError(f"folder {folder} does not exist; create it first")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"folder {folder} is not writable ({error.strerror}); choose another place") from error


def _checksum(cube: Cube) -> str:
    sum_ = 0
    for _, block in row_blocks(cube):
        sum_ = zlib.crc32(np.ascontiguousarray(block).view(np.uint8).data, sum_)
    return f"{sum_:08x}"


def _plain(value: Any) -> Any:
    """Numbers and lists in place of NumPy's, which JSON does not take."""
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _decibel(power: np.ndarray) -> np.ndarray:
    # The floor keeps exact silence finite: far below thermal noise in any bin.
    return 10 * np.log10(np.maximum(power, 1e-30))
