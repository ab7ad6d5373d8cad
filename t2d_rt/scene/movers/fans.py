"""Table fan and ceiling fan: a hub and twisted blades."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from t2d_rt.core.errors import InputError
from t2d_rt.scene.movers.solids import (
    Angle,
    Length,
    Seconds,
    Substance,
    about_x,
    about_y,
    about_z,
    ball,
    check_size,
    check_speed,
    moving,
    skin_faces,
    together,
)
from t2d_rt.types import MovingMesh
from t2d_rt.types.fields import Count, Fields, Number, Vector

Rpm = Annotated[Number, Field(ge=-12_000, le=12_000)]
Blades = Annotated[Count, Field(ge=1, le=12)]
Pitch = Annotated[Number, Field(ge=0, le=80)]

FACET_M = 0.008
"""Approximate size of a blade's triangles [m]: within one, phases must not diverge much from one surface frame to the next."""
HUB, CHORD = 0.22, 0.55
"""Radius of the hub, and width of a table fan's blade, as fractions of the radius of the tips."""
PITCH_AT, TIP = 0.75, 0.94
"""Radius at which the pitch is given, as a fraction of the tips' radius; and how far, of -1..1, the blade follows its outline and
its section, which are pointed at -1 and 1."""


class TableFan(Fields):
    """A table or pedestal fan: hub and blades. Motor, stand and wire guard are static and are left out."""

    noun: ClassVar[str] = "fan"

    kind: Literal["fan"] = "fan"
    position_m: Vector
    """Position of the hub's centre, in the plane of the blades [m]."""
    heading_deg: Angle = 180.0
    """Direction in which it blows, in the middle of its swing: 0 is +x, 90 is +y."""
    elevation_deg: Annotated[Number, Field(ge=-90, le=90)] = 0.0
    """Elevation of the direction in which it blows."""
    blades: Blades = 3
    radius_m: Annotated[Number, Field(ge=0.01, le=1)] = 0.18
    """Radius of the blades' tips [m]."""
    pitch_deg: Pitch = 25.0
    """Angle of the blades to the plane of rotation at 3/4 of the radius [deg]; they are twisted like the helicoid of that pitch."""
    rpm: Rpm = 900.0
    """Revolutions per minute; negative runs backwards."""
    swing_deg: Annotated[Number, Field(ge=0, le=360)] = 0.0
    """Angle from one end of its swing to the other [deg]."""
    swing_period_s: Seconds = 12.0
    """Period of the swing, there and back [s]."""
    material: Substance = "plastic"

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        _check_rotor(self, CHORD * self.radius_m)
        return self

    @property
    def rotation_period_s(self) -> float | None:
        """Duration of a rotation [s]; None where the fan swings as well, or hardly moves."""
        return None if self.swing_deg else _period_s(self.rpm)

    def mesh(self, start_s: float, stop_s: float) -> MovingMesh:
        """The blades and the hub from `start_s` to `stop_s` [s]."""
        rotor, faces = _rotor(self.blades, self.radius_m, CHORD * self.radius_m, 0.003, self.pitch_deg)
        return moving(self, partial(self._rotated, rotor), faces, (start_s, stop_s), name=self.noun)

    def _rotated(self, rotor: np.ndarray, times_s: np.ndarray) -> np.ndarray:
        # From the rotor's own axis x: it rotates, is tilted up, and swings about the vertical.
        swing = self.swing_deg / 2 * np.sin(2 * math.pi * times_s / self.swing_period_s)
        head = about_z(np.radians(self.heading_deg + swing)) @ about_y(-math.radians(self.elevation_deg))
        return _spun(rotor, head, self.rpm, times_s) + self.position_m


class CeilingFan(Fields):
    """A ceiling fan that blows down: hub and blades. Its rod is static and is left out."""

    noun: ClassVar[str] = "ceiling fan"

    kind: Literal["ceiling_fan"] = "ceiling_fan"
    position_m: Vector
    """Position of the hub's centre, in the plane of the blades [m]."""
    blades: Blades = 4
    radius_m: Annotated[Number, Field(ge=0.01, le=4)] = 0.6
    """Radius of the blades' tips [m]."""
    chord_m: Length = 0.12
    """Greatest width of a blade [m]."""
    pitch_deg: Pitch = 12.0
    """As in `TableFan`."""
    rpm: Rpm = 120.0
    """Revolutions per minute; negative runs backwards and blows upwards."""
    material: Substance = "wood"

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        if self.chord_m > self.radius_m:
            raise InputError(f"chord_m must be at most radius_m, {self.radius_m:g} m, got {self.chord_m:g}")
        _check_rotor(self, self.chord_m)
        return self

    @property
    def rotation_period_s(self) -> float | None:
        """Duration of a rotation [s]; None where it hardly moves."""
        return _period_s(self.rpm)

    def mesh(self, start_s: float, stop_s: float) -> MovingMesh:
        """The blades and the hub from `start_s` to `stop_s` [s]."""
        rotor, faces = _rotor(self.blades, self.radius_m, self.chord_m, 0.006, self.pitch_deg)
        return moving(self, partial(self._rotated, rotor), faces, (start_s, stop_s), name=self.noun)

    def _rotated(self, rotor: np.ndarray, times_s: np.ndarray) -> np.ndarray:
        return _spun(rotor, about_y(math.pi / 2), self.rpm, times_s) + self.position_m


def _period_s(rpm: float) -> float | None:
    # Not divided by the number of blades: their surfaces are alike, but not their diffuse points.
    return 60 / abs(rpm) if abs(rpm) >= 1 else None


def _check_rotor(fan: TableFan | CeilingFan, chord_m: float) -> None:
    """Refuses a fan with too many vertices, or with tips that move faster than sound."""
    rows, columns = _grid(0.8 * HUB * fan.radius_m, fan.radius_m, chord_m)
    check_size(2 * fan.blades * rows * columns, fan.noun, "lower radius_m or give fewer blades")
    speed_mps = 2 * math.pi * fan.radius_m * abs(fan.rpm) / 60
    check_speed(speed_mps, f"{fan.noun}'s tips", "lower rpm or radius_m")


def _spun(rotor: np.ndarray, head: np.ndarray, rpm: float, times_s: np.ndarray) -> np.ndarray:
    return np.einsum("kij,vj->kvi", head @ about_x(2 * math.pi * rpm / 60 * times_s), rotor)


def _rotor(
    blades: int, radius_m: float, chord_m: float, thickness_m: float, pitch_deg: float
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) m and faces (F, 3) of hub and blades, which rotate about +x, the direction in which they blow."""
    hub_m, (hub, hub_faces) = HUB * radius_m, ball(7, 24)
    parts = [(hub_m * (hub * [0.6, 1.0, 1.0]), hub_faces)]
    blade, faces = _blade(0.8 * hub_m, radius_m, chord_m, thickness_m, pitch_deg)
    parts += [(blade @ about_x(2 * math.pi * k / blades).T, faces) for k in range(blades)]
    return together(parts)


def _grid(root_m: float, tip_m: float, chord_m: float) -> tuple[int, int]:
    """Number of sections of a blade, and of points on each side of a section."""
    return max(8, math.ceil((tip_m - root_m) / FACET_M)), max(4, math.ceil(chord_m / FACET_M))


def _blade(
    root_m: float, tip_m: float, chord_m: float, thickness_m: float, pitch_deg: float
) -> tuple[np.ndarray, np.ndarray]:
    """One blade along y: lens-shaped sections on cylinders about x, pitched as the helicoid r tan(pitch) = constant.

    All points of a section are thus at the same distance from the axis, and none is beyond the tip.
    """
    rows, half = _grid(root_m, tip_m, chord_m)
    along = np.linspace(-TIP, TIP, rows)
    radius = root_m + (tip_m - root_m) * (along + TIP) / (2 * TIP)
    pitch = np.arctan(PITCH_AT * tip_m * math.tan(math.radians(pitch_deg)) / radius)[:, None]
    lens = np.linspace(TIP, -TIP, half)
    lens, bulge = np.concatenate([lens, lens[::-1]]), np.concatenate([1 - lens**2, lens**2 - 1])
    planform = np.sqrt(1 - along**4)[:, None]
    chordwise, across = chord_m / 2 * planform * lens / TIP, thickness_m / 2 * planform * bulge
    # The leading edge lies behind in x, so that the moving blade pushes the air to +x.
    forward = chordwise * np.cos(pitch) + across * np.sin(pitch)
    axial = across * np.cos(pitch) - chordwise * np.sin(pitch)
    azimuth = forward / radius[:, None]
    points = [axial, radius[:, None] * np.cos(azimuth), radius[:, None] * np.sin(azimuth)]
    return np.stack(points, axis=-1).reshape(-1, 3), skin_faces(len(along), 2 * half)
