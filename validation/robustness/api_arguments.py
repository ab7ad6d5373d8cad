"""Small, cheap arguments that the public functions take."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.types import Ellipsoids, MovingMesh, Radar
from t2d_rt.types.motion import CANONICAL_JOINTS

RADAR = Radar.preset("ci4r", prf_hz=2000, samples=16, sample_rate_hz=1e6)
TDM = RADAR.replace(
    multiplexing="tdm", tx_offsets_m=[[0, 0, 0], [0, 0.004, 0]], rx_offsets_m=[[0, 0, 0], [0, 0.002, 0]]
)
DDM = TDM.replace(multiplexing="ddm")
TIMES_S = np.array([0.0, 0.1, 0.2])
TETRAHEDRON = 0.2 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) + [3, 0, 1]
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
CHIRPS = 64


@cache
def walk() -> t2d.Motion:
    """A step of a person in 25 frames, made from nothing."""
    times = np.arange(25) / 50
    height = {
        "pelvis": 0.95, "spine1": 1.05, "spine2": 1.15, "spine3": 1.25, "neck": 1.5, "head": 1.6, "hip": 0.9, "knee": 0.5,
        "ankle": 0.1, "foot": 0.05, "collar": 1.45, "shoulder": 1.42, "elbow": 1.15, "wrist": 0.9,
    }  # fmt: skip
    aside = {
        "hip": 0.1,
        "knee": 0.1,
        "ankle": 0.1,
        "foot": 0.1,
        "collar": 0.06,
        "shoulder": 0.18,
        "elbow": 0.2,
        "wrist": 0.22,
    }
    joints = np.zeros((len(times), 22, 3))
    for number, name in enumerate(CANONICAL_JOINTS):
        side, _, part = name.rpartition("_")
        swing = 0.1 * np.sin(4 * times + (0 if side == "left" else np.pi)) if side else 0 * times
        ahead = 0.12 if part == "foot" else 0.0
        joints[:, number] = np.stack(
            [times + swing * (1.5 - height[part]) + ahead, 0 * times + {"left": 1, "right": -1, "": 0}[side] * aside.get(part, 0),
             0 * times + height[part]], axis=1,
        )  # fmt: skip
    return t2d.motion_from_joints(joints + [3, 0, 0], rate_hz=50.0, placed=True)


@cache
def cube(antennas: int = 1) -> np.ndarray:
    """An ADC cube of a mover in noise."""
    rng = np.random.default_rng(0)
    shape = CHIRPS, antennas, RADAR.samples
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def ball() -> MovingMesh:
    """A small body at rest."""
    return MovingMesh(np.repeat(TETRAHEDRON[None], 3, axis=0), FACES, TIMES_S, "pec")


def egg(**changes: Any) -> Ellipsoids:
    """An ellipsoid at rest."""
    given = {"semi_axes_m": [[0.1, 0.1, 0.2]], "centres": np.tile([3.0, 0, 1], (3, 1, 1)), "times_s": TIMES_S}
    return Ellipsoids(**{**given, **changes})


def result() -> t2d.Recording:
    """A recording."""
    return t2d.Recording(cube(), RADAR)


def echo_arrays() -> dict[str, Any]:
    return {
        "times_s": np.arange(5) / 100, "delay_s": np.full((5, 2), 2e-8), "amplitude": np.ones((5, 2)), "slope": np.zeros((5, 2)),
        "departure_m": np.ones((5, 2, 3)), "arrival_m": np.ones((5, 2, 3)),
    }  # fmt: skip
