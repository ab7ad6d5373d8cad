"""Antenna patterns and polarisation (docs/physics.md, eq. 17).

Directions are unit vectors (..., 3) in the radar's frame, from the antenna outward: x boresight, y left, z up. Azimuth
is positive to the left, elevation positive upwards.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from t2d_rt.core.errors import InputError
from t2d_rt.types.fields import Decibel, Fields, Number

ONE_VIEW_M = 0.01
"""Where transmitters and receivers are closer together than this [m], visibility is sampled from the midpoint between them. At 77
GHz this costs a phase error of 0.01 rad within a patch of 2 cm at 0.3 m, which falls with the square of the range; the vertices at
which visibility is sampled are farther apart than that."""


Azimuths = Annotated[tuple[Annotated[Number, Field(ge=-180, le=180)], ...], Field(min_length=2)]
"""Ascending azimuths, positive to the left [deg]."""
Elevations = Annotated[tuple[Annotated[Number, Field(ge=-90, le=90)], ...], Field(min_length=2)]
"""Ascending elevations, positive upwards [deg]."""


class Isotropic(Fields):
    """A pattern of the same gain in all directions, behind the antenna too."""

    noun: ClassVar[str] = "antenna pattern"

    kind: Literal["isotropic"] = "isotropic"

    def gain(self, directions: np.ndarray) -> np.ndarray:
        """Gain relative to its peak, a power ratio (...)."""
        return np.ones(directions.shape[:-1])


class CosinePower(Fields):
    """Power gain cos^n of the angle off boresight, 0 behind the antenna; either n or the beamwidth is given.

    >>> round(CosinePower(half_power_beamwidth_deg=90).power, 6)
    2.0
    """

    noun: ClassVar[str] = "antenna pattern"

    kind: Literal["cosine"] = "cosine"
    exponent: Annotated[Number, Field(ge=0, le=1e5)] | None = None
    """Exponent n of the power gain; 2 is a cosine of the field."""
    half_power_beamwidth_deg: Annotated[Number, Field(gt=0, lt=180)] | None = None
    """Full width between the directions of half the peak gain [deg]."""

    @model_validator(mode="after")
    def _check_one_given(self) -> Self:
        if (self.exponent is None) == (self.half_power_beamwidth_deg is None):
            raise InputError(
                f"a cosine pattern needs either exponent or half_power_beamwidth_deg, got {self.exponent} and "
                f"{self.half_power_beamwidth_deg}; give one of them"
            )
        return self

    @property
    def power(self) -> float:
        """Exponent n of the power gain, also where the beamwidth was given: cos^n(beamwidth / 2) = 1/2."""
        if self.half_power_beamwidth_deg is None:
            return float(self.exponent or 0.0)
        return math.log(0.5) / math.log(math.cos(math.radians(self.half_power_beamwidth_deg) / 2))

    def gain(self, directions: np.ndarray) -> np.ndarray:
        """Gain relative to its peak, a power ratio (...)."""
        cosine = directions[..., 0]
        return np.where(cosine > 0, np.clip(cosine, 0, 1) ** self.power, 0.0)


class Tabulated(Fields):
    """A measured or computed gain over azimuth and elevation, interpolated bilinearly in dB between its points."""

    noun: ClassVar[str] = "antenna pattern"

    kind: Literal["table"] = "table"
    azimuth_deg: Azimuths
    elevation_deg: Elevations
    gain_db: tuple[tuple[Decibel, ...], ...]
    """Gain relative to its peak, 0 or less [dB]: a row for each azimuth, a column for each elevation."""

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        for name, axis in (("azimuth_deg", self.azimuth_deg), ("elevation_deg", self.elevation_deg)):
            if not (np.diff(axis) > 0).all():
                raise InputError(f"{name} of a tabulated pattern must ascend, got {axis!s:.60}; sort table and axis")
        rows, columns = len(self.azimuth_deg), len(self.elevation_deg)
        if len(self.gain_db) != rows or any(len(row) != columns for row in self.gain_db):
            raise InputError(
                f"gain_db must have {rows} rows (azimuth) of {columns} numbers (elevation), got {len(self.gain_db)} rows "
                f"of {sorted({len(row) for row in self.gain_db})}; transpose it if its axes are swapped"
            )
        peak = max(max(row) for row in self.gain_db)
        if peak > 1e-9:
            raise InputError(
                f"gain_db is relative to the peak and so 0 or less, got {peak:.6g}; subtract the peak and give it as "
                "tx_gain_dbi or rx_gain_dbi"
            )
        return self

    def gain(self, directions: np.ndarray) -> np.ndarray:
        """Gain relative to its peak, a power ratio (...)."""
        azimuth, elevation = _angles_deg(directions)
        column, across = _cell("azimuth", azimuth, self.azimuth_deg)
        row, up = _cell("elevation", elevation, self.elevation_deg)
        table = np.asarray(self.gain_db)
        lower = (1 - up) * table[column, row] + up * table[column, row + 1]
        upper = (1 - up) * table[column + 1, row] + up * table[column + 1, row + 1]
        return np.asarray(10 ** (((1 - across) * lower + across * upper) / 10))


Levels = Annotated[tuple[Annotated[Decibel, Field(le=0)], ...], Field(min_length=2)]


class Cuts(Fields):
    """A gain as data sheets plot it, along azimuth and along elevation: the sum of both cuts in dB, interpolated linearly in dB.

    Beyond the ends of a cut its last value holds. For directions on neither cut the sum is an assumption.
    """

    noun: ClassVar[str] = "antenna pattern"

    kind: Literal["cuts"] = "cuts"
    azimuth_deg: Azimuths
    azimuth_db: Levels
    """Gain relative to its peak at each azimuth, elevation 0 [dB]."""
    elevation_deg: Elevations
    elevation_db: Levels
    """Gain relative to its peak at each elevation, azimuth 0 [dB]."""

    @model_validator(mode="after")
    def _check_cuts(self) -> Self:
        for name, axis, levels in (
            ("azimuth", self.azimuth_deg, self.azimuth_db), ("elevation", self.elevation_deg, self.elevation_db)
        ):  # fmt: skip
            if not (np.diff(axis) > 0).all() or len(axis) != len(levels):
                raise InputError(
                    f"{name}_deg of a pattern of cuts must ascend and have a level each, got {axis!s:.60} and {len(levels)} "
                    "levels; sort the cut"
                )
            if max(levels) < -1e-9:
                raise InputError(
                    f"{name}_db of a pattern of cuts is relative to its peak and so reaches 0, got {max(levels):.6g} at most; "
                    "subtract that and give the peak as tx_gain_dbi or rx_gain_dbi"
                )
        return self

    def gain(self, directions: np.ndarray) -> np.ndarray:
        """Gain relative to its peak, a power ratio (...)."""
        azimuth, elevation = _angles_deg(directions)
        level = np.interp(azimuth, self.azimuth_deg, self.azimuth_db) + np.interp(
            elevation, self.elevation_deg, self.elevation_db
        )
        return np.asarray(10 ** (level / 10))


Pattern = Annotated[Isotropic | CosinePower | Tabulated | Cuts, Field(discriminator="kind")]


def polarization_product(departure: np.ndarray, arrival: np.ndarray, tx_rad: float, rx_rad: float) -> np.ndarray:
    """Fraction of the field that a co-polar scatterer returns from one linear polarisation to the other, -1..1 (...).

    0 is vertical, pi/2 horizontal (to the left). Both unit vectors of polarisation are made transverse to the bisector of the two
    rays, which is the normal of a surface that reflects from one to the other.
    """
    shape = np.broadcast_shapes(departure.shape, arrival.shape)[:-1]
    if tx_rad == rx_rad:
        return np.ones(shape)
    ray = departure + arrival
    ray = ray / np.maximum(np.linalg.norm(ray, axis=-1, keepdims=True), 1e-12)
    transverse = []
    for angle in (tx_rad, rx_rad):
        vector = np.array((0.0, math.sin(angle), math.cos(angle)))
        vector = vector - (ray @ vector)[..., None] * ray
        transverse.append(vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-12))
    return np.sum(transverse[0] * transverse[1], axis=-1)


def _angles_deg(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation of unit vectors (..., 3) [deg]."""
    azimuth, elevation = (
        np.arctan2(directions[..., 1], directions[..., 0]),
        np.arcsin(np.clip(directions[..., 2], -1, 1)),
    )
    return np.degrees(azimuth), np.degrees(elevation)


def _cell(name: str, values_deg: np.ndarray, axis_deg: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Index of the interval of the axis in which each value lies, and the relative position within it, 0..1."""
    least, greatest = float(values_deg.min(initial=np.inf)), float(values_deg.max(initial=-np.inf))
    if not (least >= axis_deg[0] - 1e-6 and greatest <= axis_deg[-1] + 1e-6):
        raise InputError(
            f"{name} of {least:.4g} to {greatest:.4g} degrees is asked of an antenna pattern tabulated from "
            f"{axis_deg[0]:.4g} to {axis_deg[-1]:.4g}; extend the table"
        )
    axis = np.asarray(axis_deg)
    index = np.clip(np.searchsorted(axis, values_deg, side="right") - 1, 0, len(axis) - 2)
    fraction = (values_deg - axis[index]) / (axis[index + 1] - axis[index])
    return index, np.clip(fraction, 0, 1)


def one_view(tx_m: np.ndarray, rx_m: np.ndarray) -> list[np.ndarray]:
    """The viewpoints from which visibility is sampled: both positions (..., 3), or the midpoint between them where they are always
    within `ONE_VIEW_M` of each other."""
    return [tx_m, rx_m] if np.linalg.norm(tx_m - rx_m, axis=-1).max() > ONE_VIEW_M else [(tx_m + rx_m) / 2]


@lru_cache(maxsize=64)
def axes_along(boresight: tuple[float, float, float]) -> np.ndarray:
    """Unit vectors boresight, left and up as rows of a read-only (3, 3)."""
    forward = np.array(boresight) / np.linalg.norm(boresight)
    left = np.cross((0.0, 0.0, 1.0), forward)
    if np.linalg.norm(left) < 1e-9:  # straight up or down: the world's y is taken as left
        left = np.array((0.0, 1.0, 0.0))
    left /= np.linalg.norm(left)
    return np.stack([forward, left, np.cross(forward, left)])
