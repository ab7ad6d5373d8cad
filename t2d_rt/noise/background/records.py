"""Spectrograms of recordings in which nobody moves, and the axes that they share."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import array, flag, number, positive, text
from t2d_rt.core.constants import decibel
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes

LARGEST_BYTES = 2 * 2**30
"""Greatest size of a record's file [bytes]."""
SAME = 1e-3
"""Tolerance for equal axes: relative difference of steps, and difference of speeds in units of a bin."""
NEEDED = "velocity_mps, time_step_s, carrier_hz, calibrated and power_w"


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Axes of a spectrogram: its Doppler bins, and the time from one column to the next."""

    velocity_mps: np.ndarray
    """Speeds [m/s], ascending and evenly spaced, positive = approaching, (velocity,)."""
    time_step_s: float
    """Time from one column to the next [s]."""

    @classmethod
    def of(cls, velocity_mps: Any, time_step_s: Any) -> Grid:
        """Axes with speeds (velocity,) [m/s] and a time step [s]; raises InputError where speeds do not ascend in equal steps."""
        speeds = array("velocity_mps", velocity_mps, ("velocity",), unit="m/s")
        steps = np.diff(speeds)
        if len(speeds) < 2 or steps.min() <= 0 or np.ptp(steps) > SAME * steps.mean():
            raise InputError("velocity_mps must be at least two speeds, ascending and evenly spaced")
        return cls(velocity_mps=speeds, time_step_s=positive("time_step_s", time_step_s, 1e6, unit="s"))

    @classmethod
    def of_columns(cls, velocity_mps: Any, time_s: Any) -> Grid:
        """Axes of a spectrogram whose columns are at these times; refuses bursts that are not evenly spaced."""
        times = array("time_s", time_s, ("time",), unit="s")
        if len(times) < 2:
            raise InputError(f"a spectrogram must have two columns or more, got {len(times)}; give a longer recording")
        steps = np.diff(times)
        if steps.min() <= 0 or np.ptp(steps) > SAME * steps.mean():
            raise InputError(
                "columns of the spectrogram must be evenly spaced in time; of a radar with bursts take one column for each "
                "burst (n_window and overlap)"
            )
        return cls.of(velocity_mps, steps.mean())

    @property
    def bin_mps(self) -> float:
        """Width of a Doppler bin [m/s]."""
        return float(self.velocity_mps[-1] - self.velocity_mps[0]) / (len(self.velocity_mps) - 1)

    def same_as(self, other: Grid) -> bool:
        """Whether bins and columns are equal, except for rounding."""
        return (
            len(self.velocity_mps) == len(other.velocity_mps)
            and bool(np.abs(self.velocity_mps - other.velocity_mps).max() <= SAME * self.bin_mps)
            and abs(self.time_step_s / other.time_step_s - 1) <= SAME
        )

    def __str__(self) -> str:
        speeds = self.velocity_mps
        return (
            f"{len(speeds)} bins of {self.bin_mps:.4g} m/s from {speeds[0]:.4g} to {speeds[-1]:.4g} m/s, a column every "
            f"{1e3 * self.time_step_s:.4g} ms"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BackgroundRecord:
    """The spectrogram of one recording in which nobody moves."""

    name: str
    power: np.ndarray
    """Power [W], or in the recording's own unit if it is not calibrated, (velocity, time)."""
    grid: Grid
    carrier_hz: float
    calibrated: bool
    """Whether powers are in W at the ADC."""

    @classmethod
    def of(cls, name: str, power: Any, grid: Grid, *, carrier_hz: Any, calibrated: Any) -> BackgroundRecord:
        """A checked record of powers (velocity, time); raises InputError for negative powers, for silence, and where axes and
        powers do not fit."""
        power = array("power of a background", power, (len(grid.velocity_mps), "time"), limit=1e60)
        if power.shape[1] < 2 or power.min() < 0 or not power.any():
            raise InputError(
                f"the spectrogram of {name} must hold two columns or more of powers, none of them negative"
            )
        return cls(
            name=name,
            power=power.astype(np.float32),
            grid=grid,
            carrier_hz=positive("carrier_hz", carrier_hz, 1e15, unit="Hz"),
            calibrated=flag("calibrated", calibrated),
        )

    @property
    def duration_s(self) -> float:
        """Duration of all columns [s]."""
        return self.power.shape[1] * self.grid.time_step_s

    @property
    def level_db(self) -> float:
        """Level of the noise floor [dB re 1 W]: the median over all cells, which fans and pets hardly change."""
        return float(np.median(decibel(self.power.astype(np.float64))))

    @property
    def relative_db(self) -> np.ndarray:
        """Power relative to the noise floor [dB], float32 (velocity, time)."""
        return (decibel(self.power.astype(np.float64)) - self.level_db).astype(np.float32)

    def save(self, path: Path) -> None:
        """Writes the record as an .npz file."""
        about = {"time_step_s": self.grid.time_step_s, "carrier_hz": self.carrier_hz, "calibrated": self.calibrated}
        np.savez_compressed(
            path, power_w=self.power, velocity_mps=self.grid.velocity_mps, about=np.array(json.dumps(about))
        )

    @classmethod
    def load(cls, path: Path) -> BackgroundRecord:
        """Reads a file that `save` wrote."""
        data = read_bytes(path, limit=LARGEST_BYTES, noun="background record")
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as members:
                if sum(member.file_size for member in members.infolist()) > LARGEST_BYTES:
                    raise ValueError("it unpacks to more than 2 GiB")
            with np.load(io.BytesIO(data), allow_pickle=False) as file:
                power, speeds, about = file["power_w"], file["velocity_mps"], json.loads(str(file["about"]))
            grid = Grid.of(speeds, about["time_step_s"])
            return cls.of(path.stem, power, grid, carrier_hz=about["carrier_hz"], calibrated=about["calibrated"])
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except Exception as error:  # a damaged file may hold anything
            raise InputError(
                f"{path} is not a background record ({type(error).__name__}: {error}); it must hold {NEEDED}, as "
                "t2d-rt background simulate writes it"
            ) from None


def common_grid(records: list[BackgroundRecord]) -> Grid:
    """The axes of the records, which must all have the same."""
    first = records[0]
    for record in records[1:]:
        if not record.grid.same_as(first.grid):
            raise InputError(
                f"all recordings of a background must have the same axes: {first.name} has {first.grid}, {record.name} has "
                f"{record.grid}; process them alike, or train a model for each radar"
            )
    return first.grid


def checked_level(level_db: Any) -> float:
    """A checked level of a noise floor [dB re 1 W]."""
    return number("level_db", level_db, -400, 400, unit="dB")


def checked_name(name: Any) -> str:
    """A checked name or path of a model, as text."""
    return text("background", str(name) if isinstance(name, Path) else name, hint='"default", or a .safetensors file')
