"""`Simulation`: a radar recording with labelled axes, its configuration, its spectrogram, and the way to disk and back."""

from __future__ import annotations

import json
import platform
import shutil
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.signal import range_doppler, range_profile, spectrogram
from t2d_rt.types import Radar

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

FORMAT = 1


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

    `processing` holds options of `signal.spectrogram` (mti, range_gate_m, n_window, ...); `processed` changes them.
    """

    def __init__(
        self,
        cube: np.ndarray,
        radar: Radar,
        *,
        settings: Mapping[str, Any] | None = None,
        versions: Mapping[str, str] | None = None,
        processing: Mapping[str, Any] | None = None,
    ) -> None:
        if cube.ndim != 3 or cube.shape[2] != radar.samples:
            raise InputError(f"an ADC cube must have shape (chirp, antenna, {radar.samples}), got {cube.shape}")
        self.cube = cube
        """(chirp, antenna, sample) complex [sqrt(W)]."""
        self.radar = radar
        self.settings = dict(settings or {})
        self.versions = dict(versions or {})
        self.processing = dict(processing or {})
        self._spectrogram: xr.DataArray | None = None

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
        """ADC samples [sqrt(W)], complex64 (chirp, antenna, sample)."""
        import xarray as xr

        return xr.DataArray(
            self.cube,
            dims=("chirp", "antenna", "sample"),
            coords={
                "chirp_time_s": ("chirp", self.radar.chirp_starts_s(len(self.cube))),
                "sample_time_s": ("sample", self.radar.sample_times_s),
            },
            name="adc",
            attrs={**self.attributes, "units": "sqrt(W)"},
        )

    @property
    def range_profile(self) -> xr.DataArray:
        """Range FFT of every chirp [sqrt(W)], complex (chirp, antenna, range_m)."""
        import xarray as xr

        profile = range_profile(self.cube, self.radar, window=self.processing.get("range_window", "hann"))
        return xr.DataArray(
            profile.profile,
            dims=("chirp", "antenna", "range_m"),
            coords={"range_m": profile.range_m, "chirp_time_s": ("chirp", profile.time_s)},
            name="range_profile",
            attrs={**self.attributes, "units": "sqrt(W)"},
        )

    @property
    def spectrogram(self) -> xr.DataArray:
        """Micro-Doppler spectrogram, power [dB re 1 W] (velocity_mps, time_s), positive speed = approaching."""
        if self._spectrogram is None:
            import xarray as xr

            result = spectrogram(self.cube, self.radar, **self.processing)
            self._spectrogram = xr.DataArray(
                _decibel(result.power),
                dims=("velocity_mps", "time_s"),
                coords={"velocity_mps": result.velocity_mps, "time_s": result.time_s},
                name="spectrogram",
                attrs={**self.attributes, "units": "dB re 1 W"},
            )
        return self._spectrogram

    @property
    def range_doppler(self) -> xr.DataArray:
        """Range-Doppler map of the whole record, power [dB re 1 W] (velocity_mps, range_m)."""
        import xarray as xr

        result = range_doppler(self.cube, self.radar)
        return xr.DataArray(
            _decibel(result.power),
            dims=("velocity_mps", "range_m"),
            coords={"velocity_mps": result.velocity_mps, "range_m": result.range_m},
            name="range_doppler",
            attrs={**self.attributes, "units": "dB re 1 W"},
        )

    def processed(self, **changes: Any) -> Simulation:
        """The same recording with other options of `signal.spectrogram`."""
        return Simulation(
            self.cube,
            self.radar,
            settings=self.settings,
            versions=self.versions,
            processing={**self.processing, **changes},
        )

    def plot(self, title: str | None = None) -> Figure:
        """Spectrogram as a figure."""
        from t2d_rt.plots import plot_spectrogram

        image = self.spectrogram
        return plot_spectrogram(image.velocity_mps.values, image.time_s.values, image.values, title=title)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write adc and spectrogram with all attributes to a zarr folder; nothing is left behind when it fails."""
        import xarray as xr

        target = Path(path)
        check_free(target, overwrite=overwrite)
        partial = target.with_name(f".{target.name}.partial")
        data = xr.Dataset({"adc": self.adc, "spectrogram": self.spectrogram}, attrs=self.attributes)
        for variable in data.variables.values():
            if variable.attrs:
                variable.attrs = {"units": variable.attrs.get("units", "")}
        try:
            data.to_zarr(partial, mode="w", consolidated=False)
            if target.exists():
                shutil.rmtree(target)
            partial.rename(target)
        except OSError as error:
            raise InputError(f"cannot write {target}: {error.strerror or error}; free space or choose a writable place") from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    @classmethod
    def load(cls, path: str | Path) -> Simulation:
        """Read what `save` wrote."""
        import xarray as xr

        source = Path(path)
        if not source.is_dir():
            raise InputError(f"{source} is not a result folder; give a .zarr folder that `simulate` wrote")
        try:
            with xr.open_zarr(source, consolidated=False) as data:
                attributes = {name: json.loads(data.attrs[name]) for name in ("settings", "processing", "versions")}
                radar = Radar(**json.loads(data.attrs["radar"]))
                return cls(data["adc"].values, radar, **attributes)
        except InputError:
            raise
        except (KeyError, ValueError, OSError) as error:
            raise InputError(f"{source} does not hold a t2d-rt result ({error}); simulate it again") from error


def check_free(target: Path, *, overwrite: bool) -> None:
    """Refuses a place that is taken or cannot be written, before any work is done."""
    if target.exists() and not overwrite:
        raise InputError(f"{target} exists already; choose another name or pass --overwrite (overwrite=True)")
    if target.is_file():
        raise InputError(f"{target} is a file and a result is a folder; choose another name")
    parent = target.parent
    if not parent.is_dir():
        raise InputError(f"folder {parent} does not exist; create it first")
    probe = parent / f".{target.name}.probe"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"folder {parent} is not writable ({error.strerror}); choose another place") from error


def _decibel(power: np.ndarray) -> np.ndarray:
    # The floor keeps exact silence finite: far below thermal noise in any bin.
    return 10 * np.log10(np.maximum(power, 1e-30))
