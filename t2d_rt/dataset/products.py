"""What of a recording is kept in a shard: spectrogram, power by limb, range-Doppler maps, point cloud, ADC samples, truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import (
    ConfigDict,
    Field,
    field_validator,
    model_validator,
)

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.pipeline.parts import STATIC, Split
from t2d_rt.recording.parts import GROUPS
from t2d_rt.recording.path_table import record_times
from t2d_rt.recording.recording import Recording
from t2d_rt.recording.truth import TRUTH_COLUMNS, person_rows
from t2d_rt.signal.points import point_cloud
from t2d_rt.types.fields import Count, Fields, Number, later

FLOOR_DB = -200.0
"""Least level that is written, relative to the greatest one: a noise-free recording has cells of any smallness."""

ROUNDING = 1e-6
"""How far the part of a map that another one covers may reach beyond 0..1: the edges of axes are rounded to 1e-9."""

Size = Annotated[Count, Field(ge=2, le=4096)]
RangeLimits = tuple[Number, Number]
MapDtype = Literal["float16", "uint8"]

POINT_COLUMNS = "time_s", "range_m", "azimuth_rad", "elevation_rad", "speed_mps", "snr_db"
"""Columns of a point cloud."""

PARTS: Mapping[Split, tuple[str, ...]] = {
    "segment": (*GROUPS, "beside", "other", "receiver", "background"),
    "path": ("direct", "reflected", "other", "receiver", "background"),
}
"""Parts by what they differ in: limbs of the labelled person, what moves beside, all other echoes, as those of the static scene,
what the receiver adds, and the learned background; or echoes on the direct path and on all others to the targets."""


@dataclass(frozen=True, slots=True)
class SpectrogramPower:
    """Powers of a spectrogram, and what was done to them."""

    power: np.ndarray
    """[W], float64 (speed, time)."""
    velocity_mps: np.ndarray
    time_s: np.ndarray
    parts: dict[str, np.ndarray] = field(default_factory=dict)
    """What parts add to the power, by their names; they add up to it."""
    details: dict[str, Any] = field(default_factory=dict)
    """What goes into the record."""


class _Product(Fields):
    model_config = ConfigDict(use_attribute_docstrings=True)
    noun: ClassVar[str] = "product"


class _Map(_Product):
    """Power of cells, in decibels below the greatest one."""

    dtype: MapDtype = "float16"
    """"float16" [dB, 0 at the greatest cell], or "uint8" as of a picture: 255 at the greatest cell, 0 at the end of the dynamic
    range and below."""
    dynamic_range_db: Annotated[Number, Field(gt=0, le=200)] = 60.0
    """Dynamic range of "uint8" [dB]."""
    speed_mps: Annotated[Number, Field(gt=0, le=1000)] | None = None
    """Greatest speed, towards the radar and away from it [m/s]; all that the radar measures by default."""
    mti: Literal["mean", "none"] = "mean"
    """"mean" takes away the mean over the record in every range cell: static echoes and the receiver's offset, which would be the
    greatest cell of most maps; "none" keeps them."""

    def encoded(self, power: np.ndarray) -> tuple[np.ndarray, float]:
        """Powers [W] as they are written, and the greatest one to 0.001 dB [dB re 1 W], which is lost in levels relative to it.

        1e-300 W and a relative 1e-300 keep the logarithm finite where a record holds nothing at all.
        """
        greatest = max(float(power.max()), 1e-300)
        peak_db = round(10.0 * math.log10(greatest), 3)
        level = np.maximum(10.0 * np.log10(np.maximum(power / greatest, 1e-300)), FLOOR_DB)
        if self.dtype == "float16":
            return level.astype(np.float16), peak_db
        grey = np.clip(1.0 + level / self.dynamic_range_db, 0.0, 1.0)
        return np.rint(255.0 * grey).astype(np.uint8), peak_db

    def levels(self, array: np.ndarray) -> np.ndarray:
        """Levels [dB] of what `encoded` wrote, float32; what lay below the dynamic range of "uint8" comes back at its end."""
        if self.dtype == "uint8":
            return np.asarray((array.astype(np.float32) / np.float32(255) - 1) * np.float32(self.dynamic_range_db))
        return array.astype(np.float32)

    @property
    def rounding(self) -> tuple[float, float]:
        """By how much a power may differ from what was written, relative to it and to the greatest one."""
        if self.dtype == "uint8":
            return 10.0 ** (self.dynamic_range_db / 510.0 / 10.0) - 1.0, 10.0 ** (-self.dynamic_range_db / 10.0)
        return 10.0 ** (0.0625 / 10.0) - 1.0, 1e-20  # half a step of float16 at -200 dB

    def rows(self, velocity_mps: np.ndarray) -> slice:
        """Rows of speeds within the greatest one whose opposite is on the axis, too; speeds ascend.

        The cell at minus half the repetition rate has no opposite. With it, the cells of a coarser map would not lie alike on both
        sides of zero, and what stands would show which way up a map is.

        Raises InputError if fewer than two rows are left, from which no axis follows.
        """
        speeds = np.abs(velocity_mps)
        greatest = min(speeds[0], speeds[-1], np.inf if self.speed_mps is None else self.speed_mps)
        kept = np.flatnonzero(speeds <= greatest * (1.0 + 1e-9))
        if len(speeds) < 3:
            raise InputError(
                f"a map shows the same speeds towards and away, and of {len(speeds)} cells of speed only zero has its opposite; "
                "give a radar with more chirps in a burst"
            )
        if len(kept) < 2:
            cell_mps = velocity_mps[1] - velocity_mps[0]
            raise InputError(
                f"speed_mps {greatest:g} leaves one cell of speed of {len(speeds)}, which lie every {cell_mps:.3g} m/s, and a "
                f"map needs two or more; raise speed_mps to {math.ceil(1e3 * cell_mps) / 1e3:g}"
            )
        return slice(int(kept[0]), int(kept[-1]) + 1)


class SpectrogramProduct(_Map):
    """Micro-Doppler spectrogram, power over speed and time."""

    size: tuple[Size, Size] = (128, 128)
    """Cells of speed and of time; powers are averaged over what a cell covers."""
    range_gate_m: RangeLimits | Literal["scene"] | None = later(None)
    """Nearest and farthest range whose cells are added up [m]; "scene" is the depth of the room, or in free space the ranges that
    persons of the recipe reach; all ranges by default."""

    @field_validator("range_gate_m", mode="before")
    @classmethod
    def _limits(cls, value: Any) -> Any:
        pair = (
            isinstance(value, (list, tuple))
            and len(value) == 2
            and all(isinstance(limit, (int, float)) for limit in value)
        )
        if value is None or value == "scene" or (pair and 0 <= value[0] < value[1]):
            return value
        raise InputError(
            f'range_gate_m must be nearest and farthest range [m], got {shown(value)}; give [0.5, 6] or "scene"'
        )

    def made(self, view: SpectrogramPower) -> tuple[np.ndarray, dict[str, Any]]:
        """The array (speed, time), and what goes into the record."""
        rows = self.rows(view.velocity_mps)
        array, peak_db = self.encoded(resized(view.power[rows], self.size))
        axes = {"velocity_mps": edges(view.velocity_mps[rows]), "time_s": edges(view.time_s)}
        return array, {"peak_db": peak_db, **axes, **view.details}


class PartsProduct(_Product):
    """What each limb, or each kind of path, adds to the power of the spectrogram, on a coarser grid over the same axes."""

    split: Literal["segment", "path"] = "segment"
    """Limbs, or direct and reflected paths."""
    size: tuple[Size, Size] = (32, 32)
    """Cells of speed and of time; each is the mean over a whole number of the spectrogram's cells."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts, in the order of the array."""
        return PARTS[self.split]

    def made(self, view: SpectrogramPower, rows: slice, told: Mapping[str, Any]) -> tuple[np.ndarray, dict[str, Any]]:
        """The array (part, speed, time), over the greatest cell of the spectrogram, and what goes into the record.

        rows: those of the view that the spectrogram has; told: the spectrogram's record.
        """
        empty = np.zeros_like(view.power)
        greatest = 10.0 ** (told["peak_db"] / 10.0)
        array = [resized(view.parts.get(name, empty)[rows], self.size) / greatest for name in self.names]
        axes = {name: told[name] for name in ("peak_db", "velocity_mps", "time_s")}
        return np.stack(array).astype(np.float32), {"names": [*self.names], **axes}


def parts_of(recording: Recording, split: Split) -> dict[str, np.ndarray]:
    """What the parts of `PARTS` add to the power of a recording's spectrogram [W], float64 (speed, time); those that there are."""
    parts = recording.parts
    if split == "segment":
        parts = parts.grouped()
    elif other_paths := [name for name in parts if name not in ("direct", STATIC)]:
        parts = parts.grouped({"reflected": other_paths})
    powers: dict[str, np.ndarray] = {}
    for contribution in parts.contributions:
        name = str(contribution.part.values)
        owner, _, part_name = name.rpartition(": ")
        # Where something moves beside, the labelled person is the first target.
        if split == "segment" and owner not in ("", "person", "person 1"):
            part_name = "beside"
        part_name = part_name if part_name in PARTS[split] else "other"
        powers[part_name] = powers.get(part_name, 0.0) + contribution.values
    return powers


class RangeDopplerProduct(_Map):
    """Range-Doppler maps at equal intervals."""

    frames: Annotated[Count, Field(ge=1, le=1000)] = 8
    """Number of maps."""
    size: tuple[Size, Size] = (64, 64)
    """Cells of speed and of range."""
    farthest_m: Annotated[Number, Field(gt=0, le=1000)] = 8.0
    """Greatest range [m]."""

    def made(self, recording: Recording) -> tuple[np.ndarray, dict[str, Any]]:
        """The array (frame, speed, range), and what goes into the record."""
        length_s = record_length_s(recording)
        times_s = (np.arange(self.frames) + 0.5) * length_s / self.frames
        power, recording = [], recording.processed(mti=self.mti)
        for time_s in times_s:
            image = recording.range_doppler_at(float(time_s))
            near = image.range_m.values <= self.farthest_m
            if near.sum() < 2:
                raise InputError(
                    f"a map within {self.farthest_m:g} m has {near.sum()} cells of range; raise farthest_m, or take a finer radar"
                )
            rows = self.rows(image.velocity_mps.values)
            power.append(resized(10.0 ** (image.values[rows][:, near].astype(np.float64) / 10.0), self.size))
        array, peak_db = self.encoded(np.stack(power))
        axes = {"velocity_mps": edges(image.velocity_mps.values[rows]), "range_m": edges(image.range_m.values[near])}
        return array, {"peak_db": peak_db, "times_s": [round(float(time_s), 9) for time_s in times_s], **axes}


class PointsProduct(_Product):
    """Point cloud, as `signal.points.point_cloud` finds it."""

    frame_chirps: Annotated[Count, Field(ge=8, le=100_000)] | None = None
    """Chirps of a coherent interval; by default a burst, or 128."""
    false_alarm_rate: Annotated[Number, Field(gt=0, lt=1)] = 1e-4
    """Per cell of the range-Doppler map."""

    def made(self, recording: Recording) -> tuple[np.ndarray, dict[str, Any]]:
        """The array (point, 6), its columns those of `POINT_COLUMNS`, float32, and what goes into the record."""
        points = point_cloud(
            recording.cube, recording.radar, frame_chirps=self.frame_chirps, false_alarm_rate=self.false_alarm_rate
        )
        array = np.stack([getattr(points, name) for name in POINT_COLUMNS], axis=1).astype(np.float32)
        return array, {"count": len(array)}


class AdcProduct(_Product):
    """ADC samples of all chirps and antennas."""

    dtype: Literal["complex64", "float16"] = "complex64"
    """"complex64" [sqrt(W)], or "float16": real and imaginary parts (chirp, antenna, sample, 2) over the greatest of them, which is
    in the record."""

    def made(self, recording: Recording) -> tuple[np.ndarray, dict[str, Any]]:
        """The array (chirp, antenna, sample), and what goes into the record."""
        cube = np.asarray(recording.cube[:])
        if self.dtype == "complex64":
            return cube, {}
        parts = cube.view(np.float32).reshape(*cube.shape, 2)
        greatest = max(float(np.abs(parts).max()), 1e-30)
        return (parts / np.float32(greatest)).astype(np.float16), {"greatest": greatest}


class TruthProduct(_Product):
    """What the labelled person does: joints, segments, contacts of the feet."""

    rate_hz: Annotated[Number, Field(gt=0, le=1000)] = 25.0
    """Instants a second, from 0 on [Hz]."""
    visible: bool = later(True)
    """Whether visible fractions are among it, which take most of the time."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return TRUTH_COLUMNS if self.visible else tuple(name for name in TRUTH_COLUMNS if not name.endswith("_visible"))

    def made(self, recording: Recording) -> tuple[np.ndarray, dict[str, Any]]:
        """The array (time, column), its columns those of `columns`, float32, and what goes into the record."""
        times_s = record_times((0.0, record_length_s(recording) - recording.radar.loop_interval_s), self.rate_hz)
        truth = recording.truth_at(times_s, visible=self.visible)
        activity = truth.activity.values[0]
        begins = np.flatnonzero(np.append(True, activity[1:] != activity[:-1]))
        activities = [[str(activity[begin]), round(float(times_s[begin]), 9)] for begin in begins]
        return person_rows(truth), {"rate_hz": self.rate_hz, "activities": activities}


class Products(_Product):
    """What of each recording is kept; a product that is not given is left out."""

    spectrogram: SpectrogramProduct | None = SpectrogramProduct()
    """Micro-Doppler spectrogram."""
    parts: PartsProduct | None = later(None)
    """Power by limb, or by direct and reflected paths."""
    range_doppler: RangeDopplerProduct | None = None
    """Range-Doppler maps."""
    points: PointsProduct | None = None
    """Point cloud."""
    adc: AdcProduct | None = None
    """ADC samples."""
    truth: TruthProduct | None = None
    """Joints, segments and contacts of the labelled person over time."""

    @model_validator(mode="after")
    def _some(self) -> Self:
        if not self.kept:
            raise InputError(
                "recipe key products keeps nothing; give one of spectrogram, range_doppler, points, adc, truth"
            )
        if self.parts is not None:
            if self.spectrogram is None:
                raise InputError(
                    "recipe key products has parts, which are those of a spectrogram; give spectrogram, too"
                )
            if any(fine % coarse for fine, coarse in zip(self.spectrogram.size, self.parts.size, strict=True)):
                raise InputError(
                    f"the size of parts must divide that of the spectrogram, {list(self.spectrogram.size)}, got "
                    f"{list(self.parts.size)}; give its half or a quarter"
                )
        return self

    @property
    def needs_samples(self) -> bool:
        """Whether anything but the spectrogram and truth is made, for which the cells of a range gate do not do."""
        return bool(set(self.kept) - {"spectrogram", "truth"})

    @property
    def kept(self) -> dict[str, Any]:
        """The products that are kept, by name."""
        return {name: value for name, value in self if value is not None}

    def made(self, recording: Recording, view: SpectrogramPower | None) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays by name, and what goes into the record of each, of a recording and of its spectrogram as it is kept."""
        entries: dict[str, tuple[np.ndarray, dict[str, Any]]] = {}
        for name, product in self.kept.items():
            if isinstance(product, PartsProduct):  # after the spectrogram
                assert view is not None, "a recipe with parts has a spectrogram"
                entries[name] = product.made(
                    view, self.kept["spectrogram"].rows(view.velocity_mps), entries["spectrogram"][1]
                )
            else:
                entries[name] = product.made(view if name == "spectrogram" else recording)
        return {name: array for name, (array, _) in entries.items()}, {
            name: entry for name, (_, entry) in entries.items()
        }


def record_length_s(recording: Recording) -> float:
    """From the first chirp to the end of the last [s], the pauses between bursts with it."""
    radar = recording.radar
    return float(radar.chirp_starts_s(len(recording.cube))[-1]) + radar.loop_interval_s


def resized(power: np.ndarray, size: tuple[int, int], rows: tuple[float, float] = (0.0, 1.0)) -> np.ndarray:
    """A map (A, B) as one of another size: each new cell is the mean over the area that it covers.

    The mean of powers is what a radar of coarser cells would show; levels in dB must be turned into powers before.

    rows: where the new map begins and ends, in parts of the old one's first axis.
    """
    if not -ROUNDING < rows[0] < rows[1] < 1.0 + ROUNDING:
        raise InputError(f"rows must rise within 0..1, got {rows}; cut to speeds that the map covers")
    first, last = rows
    before = averaging(_parts(power.shape[0]), first + (last - first) * _parts(size[0]))
    after = averaging(_parts(power.shape[1]), _parts(size[1]))
    return np.asarray(before @ power @ after.T)


def _parts(count: int) -> np.ndarray:
    """Edges of so many equal cells of 0..1."""
    return np.arange(count + 1) / count


def averaging(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Weights (new, old) of old cells in each new one, by the edges of both: how much of the new cell each covers, 1 in all.

    A new cell beyond the ends of the old axis has the weight of the nearest old one.
    """
    overlap = np.minimum(new[1:, None], old[None, 1:]) - np.maximum(new[:-1, None], old[None, :-1])
    weights = np.maximum(overlap, 0.0)
    total = weights.sum(axis=1, keepdims=True)
    away = 0.5 * (old[1:] + old[:-1]) - 0.5 * (new[1:] + new[:-1])[:, None]
    nearest = np.eye(len(old) - 1)[np.abs(away).argmin(axis=1)]
    return np.where(total > 0, weights / np.maximum(total, 1e-300), nearest)


def edges(centres: np.ndarray) -> list[float]:
    """First and last edge of an axis of equal cells."""
    half = 0.5 * float(centres[-1] - centres[0]) / max(len(centres) - 1, 1)
    return [round(float(centres[0]) - half, 9), round(float(centres[-1]) + half, 9)]


def axis(edges: Sequence[float], count: int) -> np.ndarray:
    """Middles of `count` equal cells between the edges of an axis."""
    first, last = edges
    return np.asarray(first + (np.arange(count) + 0.5) * (last - first) / count)
