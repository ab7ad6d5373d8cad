"""A background model learned from recordings in which nobody moves: its file, and samples of any length."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2d_rt.core.backend import one_blas_thread
from t2d_rt.core.checks import array, choice, file_path, flag, integer, number, positive, shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.core.resources import resource
from t2d_rt.noise.background.network import HALO, Architecture, decoded, prior_codes, uniform_codes
from t2d_rt.noise.background.records import Grid, checked_level, checked_name
from t2d_rt.noise.background.speckle import BINS, LAGS, gaussian_field, speckle


@dataclass(frozen=True, slots=True, kw_only=True)
class Background:
    """A spectrogram of a scene in which nobody moves, relative to its noise floor, and the level of that noise floor."""

    power: np.ndarray
    """Power relative to the noise floor, float32 (velocity, time)."""
    grid: Grid
    level_db: float
    """Noise floor of one of the recordings that the model was trained on [dB re 1 W]."""
    calibrated: bool
    """Whether that level is calibrated, that is relative to 1 W at the ADC."""
    codes: np.ndarray
    """The codes from which it was decoded, (step, head)."""

    def power_w(self, level_db: float | None = None) -> np.ndarray:
        """Power [W], float32 (velocity, time), for a noise floor at that level [dB re 1 W], by default its own."""
        if level_db is None and not self.calibrated:
            raise InputError(
                "this background was learned from recordings whose samples are not in sqrt(W), so that its own level means "
                "nothing here; give level_db, the level of its noise floor [dB re 1 W]"
            )
        level = self.level_db if level_db is None else checked_level(level_db)
        return np.asarray(self.power * np.float32(10 ** (level / 10)))


def add_background(spectrogram_power: Any, background: Background, level_db: float | None = None) -> np.ndarray:
    """Power [W] (velocity, time) of a spectrogram with a background: the sum of the two powers.

    level_db: the level of the background's noise floor, its median cell [dB re 1 W]; by default that of one of the recordings that
        the background was learned from.

    Exact in the mean: echoes and background are independent and the background's phase is uniform, so that E|s + b|^2 = |s|^2 +
    E|b|^2. One realisation of a true sum has the cross term 2 Re(s b*) besides, which has the mean 0 and in a cell of M looks a
    standard deviation of sqrt(2 |s|^2 E|b|^2 / M): 2 dB where the background is 6 dB below the echo and M = 1, less where it is
    weaker. It is missing here. Nor does a person cast a shadow on the background. Receiver noise added to the ADC cube has both.
    """
    power = array("spectrogram_power", spectrogram_power, ("velocity", "time"), limit=1e60, unit="W")
    if power.min(initial=0) < 0:
        raise InputError("spectrogram_power must not be negative; give powers in W, no levels in dB")
    if power.shape != background.power.shape:
        raise InputError(
            f"spectrogram and background must have the same shape, got {power.shape} and {background.power.shape}; sample the "
            "background with the grid and the columns of the spectrogram"
        )
    return power + background.power_w(level_db)


WIDEST = 2.0
"""Greatest ratio of the widths of Doppler bins, and of columns, for which the model is interpolated: beyond it windows would blur
or split moving targets."""


def step_ratio(own: Grid, grid: Grid) -> float:
    """Number of the model's columns per column of the requested axes; raises InputError where these axes cannot be interpolated
    from the model's."""
    columns = grid.time_step_s / own.time_step_s
    bins = grid.bin_mps / own.bin_mps
    speeds, reach = grid.velocity_mps, own.velocity_mps
    inside = speeds[0] >= reach[0] - grid.bin_mps and speeds[-1] <= reach[-1] + grid.bin_mps
    if not (inside and 1 / WIDEST <= columns <= WIDEST and 1 / WIDEST <= bins <= WIDEST):
        raise InputError(
            f"the spectrogram has {grid}, the background model {own}; bins and columns may differ by a factor of {WIDEST:g} and "
            "speeds may not exceed the model's: choose n_window and overlap alike, or train a model for this radar"
        )
    return float(columns)


def resampled(
    mean: np.ndarray, looks: np.ndarray, time: np.ndarray, doppler: np.ndarray, own: Grid, grid: Grid, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean [nat] and looks on the requested axes, and the correlations of the speckle at their steps, all interpolated linearly.

    The number of looks of windows of another length is not accounted for.
    """
    at = np.arange(columns) * grid.time_step_s / own.time_step_s
    speeds = np.clip((grid.velocity_mps - own.velocity_mps[0]) / own.bin_mps, 0, len(mean) - 1)
    both = np.stack([between(between(values, at, 1), speeds, 0) for values in (mean, looks)])
    steps = np.arange(time.shape[1]) * grid.time_step_s / own.time_step_s
    ending = np.pad(time, ((0, 0), (0, 1)))  # beyond the lags that are stored the correlation is zero
    lags = between(between(ending, np.minimum(steps, time.shape[1]), 1), speeds, 0)
    bins = np.interp(np.arange(len(doppler)) * grid.bin_mps / own.bin_mps, np.arange(len(doppler)), doppler, right=0.0)
    return both[0], both[1], lags, bins


def between(values: np.ndarray, at: np.ndarray, axis: int) -> np.ndarray:
    """Linear interpolation of values along an axis, at fractional indices."""
    low = np.clip(np.floor(at).astype(int), 0, values.shape[axis] - 2)
    weight = (at - low).astype(np.float32)
    weight = weight[:, None] if axis == 0 else weight
    return np.take(values, low, axis) * (1 - weight) + np.take(values, low + 1, axis) * weight


FORMAT, VERSION = "t2d-rt background", 1
DEFAULT = "default"
"""Name of the model that is shipped."""
SUFFIX = ".safetensors"
LARGEST_BYTES = 64_000_000
LONGEST_S = 86_400.0
Codes = Literal["prior", "uniform"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BackgroundModel:
    """A learned background: code books, decoder, prior over the codes, and the axes of its spectrograms."""

    architecture: Architecture
    arrays: Mapping[str, np.ndarray]
    """Weights by name, float32."""
    grid: Grid
    """Axes of the spectrograms that it was trained on."""
    levels_db: tuple[float, ...]
    """Noise floors of the recordings that it was trained on [dB re 1 W; for uncalibrated ones dB re 1 of their unit]."""
    carrier_hz: float
    calibrated: bool
    """Whether these levels are relative to 1 W at the ADC."""
    about: Mapping[str, Any]
    """How it was trained, for people."""

    @classmethod
    def of(
        cls,
        architecture: Architecture,
        arrays: Mapping[str, np.ndarray],
        grid: Grid,
        *,
        levels_db: Any,
        carrier_hz: Any,
        calibrated: Any,
        about: Mapping[str, Any],
    ) -> BackgroundModel:
        """A checked model; raises InputError where arrays are missing, not finite or of another shape, or do not fit the axes."""
        for name, size in _sizes(architecture).items():
            if name not in arrays or arrays[name].shape != size:
                shape = arrays[name].shape if name in arrays else "nothing"
                raise InputError(f"array {name} of a background model must have shape {size}, got {shape}")
        if not all(np.isfinite(values).all() for values in arrays.values()):
            raise InputError("arrays of a background model must be finite; train it again")
        levels = tuple(checked_level(level_db) for level_db in levels_db)
        if not levels or len(grid.velocity_mps) != architecture.bins:
            raise InputError("a background model must have the levels of its records and a speed for each Doppler bin")
        return cls(
            architecture=architecture,
            arrays=arrays,
            grid=grid,
            levels_db=levels,
            carrier_hz=positive("carrier_hz", carrier_hz, 1e15, unit="Hz"),
            calibrated=flag("calibrated", calibrated),
            about=dict(about),
        )

    def __repr__(self) -> str:
        size = self.architecture
        return f"BackgroundModel({size.heads} code books of {size.codes}, {self.grid})"

    @property
    def digest(self) -> str:
        """A text that is equal for models with equal arrays and axes."""
        digest = hashlib.sha256(f"{self.architecture!r} {self.grid} {self.levels_db} {self.calibrated}".encode())
        for name in sorted(self.arrays):
            digest.update(np.ascontiguousarray(self.arrays[name]).tobytes())
        return digest.hexdigest()[:32]

    def sample(
        self, duration_s: float, *, seed: int = 0, grid: Grid | None = None, codes: Codes = "prior"
    ) -> Background:
        """A background of any length; a longer one with the same seed begins with the same columns, bit for bit.

        grid: the requested axes; those of the training by default. For others mean and looks are interpolated; an InputError is
            raised where bins or columns differ by more than a factor of `WIDEST`, or speeds exceed the training's.

        codes: drawn from the learned "prior", or all equally likely ("uniform"), as in Text2Doppler.
        """
        grid = self.grid if grid is None else grid
        duration_s = positive("duration_s", duration_s, LONGEST_S, unit="s")
        return self.columns(max(1, round(duration_s / grid.time_step_s)), seed=seed, grid=grid, codes=codes)

    def columns(self, count: int, *, seed: int = 0, grid: Grid | None = None, codes: Codes = "prior") -> Background:
        """A background with a given number of columns; options as in `sample`."""
        grid = self.grid if grid is None else grid
        number("seconds of background", integer("columns of background", count, 1) * grid.time_step_s, 0, LONGEST_S)
        choice("codes", codes, ("prior", "uniform"))
        ratio = step_ratio(self.grid, grid)
        of_codes, of_speckle, of_level = (
            np.random.default_rng(seed_sequence)
            for seed_sequence in np.random.SeedSequence(integer("seed", seed)).spawn(3)
        )
        model_columns = int(np.ceil((count - 1) * ratio)) + 2 if not self.grid.same_as(grid) else count
        steps = -(-model_columns // self.architecture.columns) + 2 * HALO
        with one_blas_thread:
            if codes == "prior":
                drawn = prior_codes(self.architecture, self.arrays, steps, of_codes)
            else:
                drawn = uniform_codes(self.architecture, steps, of_codes)
            mean, looks = decoded(self.architecture, self.arrays, drawn)
            time, doppler = self.arrays["speckle.time"], self.arrays["speckle.doppler"]
            if not self.grid.same_as(grid):
                mean, looks, time, doppler = resampled(mean, looks, time, doppler, self.grid, grid, count)
            mean, looks = mean[:, :count], looks[:, :count]
            normal = gaussian_field(len(mean), count, time, doppler, of_speckle)
        power = np.exp(mean) * speckle(normal, looks)
        level_db = float(self.levels_db[int(of_level.integers(len(self.levels_db)))])
        return Background(
            power=power.astype(np.float32),
            grid=grid,
            level_db=level_db,
            calibrated=self.calibrated,
            codes=drawn[HALO:-HALO],
        )

    def save(self, path: Path) -> None:
        """Writes the model as a safetensors file."""
        from safetensors.numpy import save

        metadata = {
            "version": VERSION,
            "architecture": self.architecture.model_dump(),
            "first_velocity_mps": float(self.grid.velocity_mps[0]),
            "bin_mps": self.grid.bin_mps,
            "time_step_s": self.grid.time_step_s,
            "levels_db": self.levels_db,
            "carrier_hz": self.carrier_hz,
            "calibrated": self.calibrated,
            "about": dict(self.about),
        }
        arrays = {name: np.ascontiguousarray(self.arrays[name]) for name in sorted(self.arrays)}
        # Stored as a single text: the library writes several in any order, but equal models shall have equal bytes.
        data = save(arrays, {FORMAT: json.dumps(metadata, sort_keys=True)})
        path.write_bytes(data)


def load_background(source: str | Path = DEFAULT) -> BackgroundModel:
    """Reads a background model from its file (.safetensors); "default" is the one that is shipped.

    Raises InputError where the file is no such model, is damaged, or is a pickle, which is never read.
    """
    name = checked_name(source)
    if name == DEFAULT:
        return _shipped()
    path = file_path("background", source)
    if path.suffix != SUFFIX:
        raise InputError(
            f'a background model is "{DEFAULT}" or a {SUFFIX} file, got {name!r}; t2d-rt background train writes one'
        )
    return _read(path)


@cache
def _shipped() -> BackgroundModel:
    return _read(resource("backgrounds", f"{DEFAULT}{SUFFIX}"))


def _read(path: Path) -> BackgroundModel:
    """Reads a model from its file; the header is checked first, so that the error for another kind of file can name it."""
    data = read_bytes(path, limit=LARGEST_BYTES, noun="background model")
    try:
        metadata = _metadata(data)
    except Exception:  # bytes of any kind
        kind = (
            "a pickle, which could run anything" if data[:2] in (b"PK", b"\x80\x02", b"\x80\x04") else "something else"
        )
        raise InputError(
            f"{path} is not a safetensors file but {kind}, or it is cut short; t2d-rt background train writes a model"
        ) from None
    if FORMAT not in metadata:
        raise InputError(f"{path} holds no background model; t2d-rt background train writes one")
    try:
        from safetensors.numpy import load

        about_model, arrays = json.loads(metadata[FORMAT]), load(data)
        if about_model["version"] != VERSION:
            raise InputError(f"it is of version {shown(about_model['version'])}, this program reads version {VERSION}")
        architecture = Architecture.model_validate(about_model["architecture"])
        speeds = about_model["first_velocity_mps"] + about_model["bin_mps"] * np.arange(architecture.bins)
        return BackgroundModel.of(
            architecture,
            {name: array(name, values).astype(np.float32) for name, values in arrays.items()},
            Grid.of(speeds, about_model["time_step_s"]),
            levels_db=about_model["levels_db"],
            carrier_hz=about_model["carrier_hz"],
            calibrated=about_model["calibrated"],
            about=about_model["about"],
        )
    except Exception as error:  # a damaged file may hold anything
        raise InputError(
            f"{path} is a background model that cannot be read ({error}); fetch it again, or train it again"
        ) from None


def _metadata(data: bytes) -> dict[str, str]:
    """The texts in the header of a safetensors file, which is 8 bytes of length, little-endian, and JSON."""
    length = int.from_bytes(data[:8], "little")
    if not 0 < length <= len(data) - 8:
        raise ValueError("no header")
    return dict(json.loads(data[8 : 8 + length]).get("__metadata__", {}))


def _sizes(architecture: Architecture) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays that sampling needs, by name."""
    size = architecture
    embedded = 12 * size.heads
    shapes: dict[str, tuple[int, ...]] = {
        "codebook": (size.heads, size.codes, size.code_size),
        "decoder.spread.weight": (size.channels * size.rows, size.latent),
        "decoder.spread.bias": (size.channels * size.rows,),
        "decoder.profile": (2, size.padded_bins),
        "prior.embedding": (size.heads, size.codes, embedded),
        "prior.start": (embedded,),
        "prior.gru.weight_ih_l0": (3 * size.hidden, embedded),
        "prior.gru.weight_hh_l0": (3 * size.hidden, size.hidden),
        "prior.gru.bias_ih_l0": (3 * size.hidden,),
        "prior.gru.bias_hh_l0": (3 * size.hidden,),
        "prior.mixing": (size.heads * size.mixed, size.hidden),
        "prior.mixing_bias": (size.heads, size.mixed),
        "prior.among": (size.heads, size.codes, size.heads, size.mixed),
        "prior.readout": (size.heads, size.codes, size.mixed),
        "prior.readout_bias": (size.heads, size.codes),
        "speckle.time": (size.bins, LAGS),
        "speckle.doppler": (BINS,),
    }
    for block in range(size.blocks):
        shapes[f"decoder.blocks.{block}.inner.weight"] = (size.residual, size.channels, 3, 3)
        shapes[f"decoder.blocks.{block}.inner.bias"] = (size.residual,)
        shapes[f"decoder.blocks.{block}.outer.weight"] = (size.channels, size.residual, 1, 1)
        shapes[f"decoder.blocks.{block}.outer.bias"] = (size.channels,)
    for stage, (channels, out, times) in enumerate(size.stages):
        shapes[f"decoder.stages.{stage}.weight"] = (out, channels, 3, 3 if times == 2 else 1)
        shapes[f"decoder.stages.{stage}.bias"] = (out,)
    return shapes
