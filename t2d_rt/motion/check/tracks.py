"""A motion as the checks see it: at one rate, in one band, with the body's own lengths to compare with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from t2d_rt.geometry.vectors import unit
from t2d_rt.motion import posture
from t2d_rt.motion.contacts import runs
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.types.motion import Motion

RATE_HZ = 60.0
"""Rate at which speeds and accelerations are taken, whatever the motion's own: figures of 10 and of 240 frames per second
compare."""

CUTOFF_HZ = 10.0
"""Human movement lies below it but for impacts (Winter, Biomechanics, 2.2); slight noise of the positions does not."""

HEAD_STANDING, HIPS_STANDING = 0.89, 0.52
"""Heights of the head's joint and of the middle of the hips of a person who stands, over stature: medians of 100 recorded
walks."""

GRAVITY_MPS2 = 9.81

SEGMENT_MASSES: tuple[tuple[str, str, float, float], ...] = (
    ("hips", "shoulders", 0.497, 0.50), ("neck", "head", 0.081, 1.00),
    *((f"{side}_{upper}", f"{side}_{lower}", mass, along) for side in ("left", "right") for upper, lower, mass, along in (
        ("shoulder", "elbow", 0.028, 0.436), ("elbow", "wrist", 0.022, 0.682), ("hip", "knee", 0.100, 0.433),
        ("knee", "ankle", 0.0465, 0.433), ("ankle", "foot", 0.0145, 0.50),
    )),
)  # fmt: skip
"""Segments, their fraction of the body's mass and where on them their centre lies (Winter, Biomechanics, table 4.1)."""


@dataclass(frozen=True)
class Tracks:
    """Joints of one motion at `RATE_HZ`, below `CUTOFF_HZ`."""

    names: tuple[str, ...]
    joints: np.ndarray
    """Positions [m], (T, J, 3)."""
    stature_m: float

    def __getitem__(self, name: str) -> np.ndarray:
        """Track (T, 3) [m] of a joint, or of the middle of a pair: hips, shoulders, knees, ankles, feet."""
        if name in self.names:
            return self.joints[:, self.names.index(name)]
        pair = {"hips": "hip", "shoulders": "shoulder", "knees": "knee", "ankles": "ankle", "feet": "foot"}[name]
        return 0.5 * (self[f"left_{pair}"] + self[f"right_{pair}"])

    @property
    def times_s(self) -> np.ndarray:
        """Instants [s], (T,)."""
        return np.arange(len(self.joints)) / RATE_HZ

    @cached_property
    def velocity(self) -> np.ndarray:
        """Of every joint [m/s], (T, J, 3)."""
        return rate_of(self.joints)

    @cached_property
    def centre_of_mass(self) -> np.ndarray:
        """Of the body [m], (T, 3)."""
        return sum(mass * ((1 - along) * self[a] + along * self[b]) for a, b, mass, along in SEGMENT_MASSES)  # type: ignore[return-value]

    @cached_property
    def facing(self) -> np.ndarray:
        """Horizontal unit vectors that hips and shoulders face, (T, 3)."""
        return posture.facing(
            {name: self[name] for name in ("left_hip", "right_hip", "left_shoulder", "right_shoulder")}
        )

    @cached_property
    def trunk(self) -> np.ndarray:
        """Unit vectors from the hips to the shoulders, (T, 3)."""
        return unit(self["shoulders"] - self["hips"])

    @cached_property
    def leg_m(self) -> float:
        """Length of thigh and shank [m]."""
        return posture.leg_m({name: self.joints[:, place] for place, name in enumerate(self.names)})


def tracks(motion: Motion) -> Tracks:
    """The motion's joints below `CUTOFF_HZ` at `RATE_HZ`: a cubic spline where its own rate is another."""
    joints = motion.joints
    if motion.rate_hz > 3 * CUTOFF_HZ and len(joints) > 3:
        joints = low_pass(joints, CUTOFF_HZ, motion.rate_hz)
    if motion.rate_hz != RATE_HZ:
        from scipy.interpolate import make_interp_spline

        count = max(2, int(motion.duration_s * RATE_HZ + 1e-9) + 1)
        instants = np.minimum(np.arange(count) / RATE_HZ, motion.duration_s)
        flat = joints.reshape(len(joints), -1)
        spline = make_interp_spline(motion.times_s, flat, k=min(3, len(flat) - 1))
        joints = spline(instants).reshape(count, *joints.shape[1:])
    points = {name: joints[:, index] for index, name in enumerate(motion.names)}
    return Tracks(names=motion.names, joints=joints, stature_m=max(posture.stature_m(points), 1e-3))


def rate_of(values: np.ndarray) -> np.ndarray:
    """Derivative in time along axis 0 of what is given at `RATE_HZ`, by central differences."""
    return np.gradient(values, 1 / RATE_HZ, axis=0)


def angle_deg(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angle between vectors (..., 3) [degrees]."""
    return np.degrees(np.arccos(np.clip(np.sum(unit(first) * unit(second), axis=-1), -1, 1)))


def spans(active: np.ndarray, *, gap: int = 0, least: int = 1) -> list[tuple[int, int]]:
    """Runs of True in (T,) as (start, stop), those closer than `gap` frames joined, then those shorter than `least` left out."""
    found: list[tuple[int, int]] = []
    for start, stop in runs(active):
        if found and start - found[-1][1] < gap:
            found[-1] = found[-1][0], stop
        else:
            found.append((start, stop))
    return [(start, stop) for start, stop in found if stop - start >= least]
