"""A walking dog or cat: a lateral-sequence walk on pantograph legs, with a skin of ellipsoids and tapered capsules."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from t2d_rt.core.constants import STANDARD_GRAVITY
from t2d_rt.core.errors import InputError
from t2d_rt.scene.movers.solids import (
    Angle,
    Substance,
    about_y,
    about_z,
    ball,
    ball_profile,
    moving,
    ring_of,
    skin_faces,
    together,
)
from t2d_rt.types import MovingMesh
from t2d_rt.types.fields import Fields, Number, Vector

DUTY_FACTOR = 0.65
"""Fraction of a stride during which a paw stands on the floor; for walks 0.5..0.75 (Hildebrand, Am. Zool. 20, 1980)."""
TOUCHDOWN = {"left hind": 0.0, "left fore": 0.25, "right hind": 0.5, "right fore": 0.75}
"""Fraction of the stride at which each paw touches down: the lateral sequence, evenly spaced (Hildebrand)."""
SAGITTA_RAD = 0.3
"""Phase sagitta of its facets [rad], rather large, for fur scatters most of the echo diffusely."""
RINGS, PER_RING = 9, 12
Part = tuple[np.ndarray, np.ndarray]
"""Vertices (K, V, 3) m and faces (F, 3)."""


@dataclass(frozen=True, slots=True)
class Build:
    """Proportions of an animal, in units of the hip's height unless said otherwise."""

    hip_m: float
    """Height of hips and shoulders at rest [m]."""
    trunk: float
    """Length from the hips to the shoulders."""
    chest: tuple[float, float, float]
    """Semi-axes of the trunk: lengthwise, sideways, upward."""
    stance: float
    """Distance from the middle plane to the hips and paws of one side."""
    limb: float
    """Radius of the upper leg; lower parts are thinner."""
    neck: float
    head: tuple[float, float, float]
    """Semi-axes of the head: lengthwise, sideways, upward."""
    tail: float


# Round figures for a retriever, 38 l, and a house cat, 4.5 l.
BUILDS = {
    "dog": Build(0.50, 1.05, (0.70, 0.22, 0.27), 0.16, 0.12, 0.42, (0.24, 0.13, 0.14), 0.60),
    "cat": Build(0.24, 1.15, (0.76, 0.23, 0.27), 0.15, 0.11, 0.32, (0.22, 0.18, 0.17), 1.00),
}
UPPER, MIDDLE, LOWER = 0.42, 0.50, 0.33
"""Lengths of the three parts of a leg in units of the hip's height. Upper and lower part stay parallel, as in a pantograph (Fischer
and Blickhan, J. Exp. Zool. 305A, 2006), so that the leg bends like two parts of lengths UPPER + LOWER and MIDDLE."""
PAW = (0.09, 0.055, 0.05)
"""Semi-axes of a paw, in units of the hip's height."""
LIFT, BOB = 0.12, 0.02
"""Height to which a swinging paw is lifted, and amplitude with which hips and shoulders rise over a standing leg, out of phase with
each other (Griffin, Main and Farley, J. Exp. Biol. 207, 2004); in units of the hip's height."""
NOD_DEG, WAG_DEG = 6.0, 15.0
"""Amplitudes of the swing of the neck, twice in a stride, and of the tail, once [deg]."""


class Pet(Fields):
    """A dog or a cat that walks on a circle to its left, or straight on.

    The length of a stride follows from the speed by Alexander's relation (docs/physics.md, eq. 25). Paws that bear weight
    rest on the floor.
    """

    noun: ClassVar[str] = "pet"

    kind: Literal["pet"] = "pet"
    animal: Literal["dog", "cat"] = "dog"
    position_m: Vector
    """First position of the pet [m]: on the floor, under the middle of its trunk."""
    heading_deg: Angle = 90.0
    """Direction in which it walks at first: 0 is +x, 90 is +y."""
    speed_mps: Annotated[Number, Field(ge=0.05, le=5)] = 0.7
    turn_radius_m: Annotated[Number, Field(gt=0, le=1000)] | None = 1.0
    """Radius of the circle on which it walks; None: it walks straight on for as long as the record lasts."""
    size: Annotated[Number, Field(ge=0.3, le=3)] = 1.0
    """Factor on its size: the hips of a dog are 0.5 m high, those of a cat 0.24 m."""
    material: Substance = "clothed"
    """Material of the surface: fur transmits the wave and makes the skin rough, as cloth does."""

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        # 0.5: Froude number at which animals change to a trot (Alexander and Jayes, J. Zool. 201, 1983).
        fastest = math.sqrt(0.5 * STANDARD_GRAVITY * self.hip_m)
        if self.speed_mps > fastest:
            raise InputError(
                f"a {self.animal} with hips {self.hip_m:.2g} m high trots at {self.speed_mps:g} m/s; give a walk's speed_mps, "
                f"up to {math.floor(100 * fastest) / 100:g}"
            )
        if self.turn_radius_m is not None and self.turn_radius_m < 2 * self.hip_m:
            raise InputError(
                f"turn_radius_m must be {2 * self.hip_m:.2g} or more for a {self.animal} of this size, got {self.turn_radius_m:g}"
            )
        return self

    @property
    def hip_m(self) -> float:
        """Height of the hips and shoulders [m]."""
        return BUILDS[self.animal].hip_m * self.size

    @property
    def stride_m(self) -> float:
        """Length of one stride [m]: 2.3 h (v^2 / (g h))^0.3 (physics.md, eq. 25)."""
        return 2.3 * self.hip_m * (self.speed_mps**2 / (STANDARD_GRAVITY * self.hip_m)) ** 0.3

    @property
    def stride_hz(self) -> float:
        """Stride frequency [Hz]: speed over stride length."""
        return self.speed_mps / self.stride_m

    def mesh(self, start_s: float, stop_s: float) -> MovingMesh:
        """The skin from `start_s` to `stop_s` [s]."""
        _, faces = self._skin(np.zeros(1))
        return moving(self, self._vertices, faces, (start_s, stop_s), sagitta_rad=SAGITTA_RAD, name=self.animal)

    def _vertices(self, times_s: np.ndarray) -> np.ndarray:
        return self._skin(times_s)[0]

    def _ground(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position on the floor under the middle of the trunk (K, 3) m, and heading [rad] (K,)."""
        travelled_m = self.speed_mps * times_s
        first = math.radians(self.heading_deg)
        if self.turn_radius_m is None:
            there = travelled_m[:, None] * np.array([math.cos(first), math.sin(first), 0])
            return there + self.position_m, np.full(len(travelled_m), first)
        angle = travelled_m / self.turn_radius_m
        there = self.turn_radius_m * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
        return there @ about_z(first).T + self.position_m, first + angle

    def _foothold(self, stride: np.ndarray, touchdown: float, hip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (K, 3) and heading (K,) of a paw on the floor in its n-th stride: below the hip at the middle of the stance."""
        # Leg and foothold are then at the same distance at touch-down and at lift-off.
        middle = (stride + touchdown + DUTY_FACTOR / 2) / self.stride_hz
        there, heading = self._ground(middle)
        return there + about_z(heading) @ hip, heading

    def _paw(self, times_s: np.ndarray, touchdown: float, hip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (K, 3) and heading (K,) of a paw, which stands where it touched down and then swings to its next foothold."""
        since = self.stride_hz * times_s - touchdown
        stride = np.floor(since)
        swing = np.clip((since - stride - DUTY_FACTOR) / (1 - DUTY_FACTOR), 0, 1)
        here, heading = self._foothold(stride, touchdown, hip)
        there, next_heading = self._foothold(stride + 1, touchdown, hip)
        gone = _swung(swing)
        place = here + gone[:, None] * (there - here)
        place[:, 2] += LIFT * self.hip_m * (4 * swing * (1 - swing)) ** 3
        return place, heading + gone * (next_heading - heading)

    def _skin(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (K, V, 3) m and faces (F, 3) at times (K,)."""
        # Trunk and head follow the track on the ground; legs connect the hips to paws that keep to their footholds, so that none
        # slides.
        build, h = BUILDS[self.animal], self.hip_m
        phase = 2 * math.pi * self.stride_hz * times_s
        ground, heading = self._ground(times_s)
        rotation = about_z(heading)
        # Hips are highest over a hind leg at the middle of its stance, shoulders a quarter of a stride later, when hips are lowest.
        rise = BOB * np.cos(2 * (phase - math.pi * DUTY_FACTOR))
        pitch = np.arctan(2 * rise / build.trunk)

        def world(local: np.ndarray) -> np.ndarray:
            """World coordinates of points (3,) or (K, 3) given in the trunk's own frame, in units of the hip's height."""
            place = np.array([0, 0, h]) + h * np.einsum(
                "kij,kj->ki", about_y(pitch), np.broadcast_to(local, ground.shape)
            )
            return ground + np.einsum("kij,kj->ki", rotation, place)

        left = rotation[:, :, 1]
        frame = rotation @ about_y(pitch)
        parts = [_ball(world(np.zeros(3)), frame, h * np.array(build.chest))]
        for name, touchdown in TOUCHDOWN.items():
            side, end = 1 if "left" in name else -1, 0.5 if "fore" in name else -0.5
            hip = np.array([end * build.trunk, side * build.stance, 0])
            paw, paw_heading = self._paw(times_s, touchdown, h * hip)
            parts.append(_ball(paw + [0, 0, PAW[2] * h], about_z(paw_heading), h * np.array(PAW)))
            ankle = paw + [0, 0, 1.5 * PAW[2] * h]
            parts += _leg(world(hip), ankle, left, h, h * build.limb)
        nod = math.radians(NOD_DEG) * np.cos(2 * phase)
        nape = np.array([build.trunk / 2, 0, 0.1])
        ahead = np.stack([np.cos(0.8 + nod), 0 * nod, np.sin(0.8 + nod)], axis=1)
        crown = nape + build.neck * ahead
        parts.append(_capsule(world(nape), world(crown), left, 0.13 * h, 0.09 * h))
        parts.append(_ball(world(crown + [0.6 * build.head[0], 0, 0]), frame, h * np.array(build.head)))
        wag = math.radians(WAG_DEG) * np.sin(phase)
        rump = np.array([-build.chest[0], 0, 0.08])
        behind = np.stack([-np.cos(wag) * math.cos(0.5), np.sin(wag), -np.cos(wag) * math.sin(0.5)], axis=1)
        parts.append(_capsule(world(rump), world(rump + build.tail * behind), left, 0.05 * h, 0.025 * h))
        return together(parts)


def _swung(fraction: np.ndarray) -> np.ndarray:
    """Fraction of its step that a swinging paw has covered: its speed is proportional to (1 - x^4)^2, x in -1..1.

    That is nearly constant, and smooth at both ends.
    """
    x = 2 * fraction - 1
    return 0.5 + (x - 2 * x**5 / 5 + x**9 / 9) / (2 * (1 - 2 / 5 + 1 / 9))


def _leg(hip: np.ndarray, ankle: np.ndarray, left: np.ndarray, h: float, radius: float) -> list[Part]:
    """Upper, middle and lower part of a leg between hip and ankle (K, 3): upper and lower point forward, the middle one back."""
    a, b = (UPPER + LOWER) * h, MIDDLE * h
    line = ankle - hip
    reach = np.linalg.norm(line, axis=1, keepdims=True)
    line /= reach
    # Law of cosines: the angle at the hip between the direction of the ankle and the two parallel parts.
    cosine = (reach**2 + a**2 - b**2) / (2 * reach * a)
    forward = np.cross(line, left)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    along = cosine * line + np.sqrt(1 - cosine**2) * forward
    knee = hip + UPPER * h * along
    hock = ankle - LOWER * h * along
    return [
        _capsule(hip, knee, left, radius, 0.6 * radius),
        _capsule(knee, hock, left, 0.6 * radius, 0.35 * radius),
        _capsule(hock, ankle, left, 0.35 * radius, 0.3 * radius),
    ]


def _ball(middle: np.ndarray, frame: np.ndarray, semi_axes_m: np.ndarray) -> Part:
    """An ellipsoid about points (K, 3), with its axes in the columns of frames (K, 3, 3)."""
    unit, faces = ball(RINGS, PER_RING)
    return middle[:, None] + np.einsum("kij,vj->kvi", frame, unit * semi_axes_m), faces


def _capsule(start: np.ndarray, stop: np.ndarray, left: np.ndarray, first_m: float, last_m: float) -> Part:
    """A tapered rod between points (K, 3) with hemispherical ends of the radii `first_m` and `last_m`."""
    # Rings of a sphere, the upper half of which is moved up by the length, while the radius changes from the first to the last.
    height, width = ball_profile(RINGS - 1)
    length = np.linalg.norm(stop - start, axis=1)
    axis = (stop - start) / length[:, None]
    up = np.cross(axis, left)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    frame = np.stack([axis, np.cross(up, axis), up], axis=2)
    half = len(height) // 2
    radius = np.repeat([first_m, last_m], half)
    x = (radius * height)[None] + np.where(np.arange(len(height)) < half, 0, length[:, None])
    local = np.repeat((radius * width)[None, :, None, None] * ring_of(PER_RING), len(x), axis=0)
    local[..., 0] = x[..., None]
    local = local.reshape(len(x), -1, 3)
    return start[:, None] + np.einsum("kij,kvj->kvi", frame, local), skin_faces(len(height), PER_RING)
