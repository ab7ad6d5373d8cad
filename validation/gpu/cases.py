"""The kinds of simulation that are compared, and the chirps that are kept of each."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.backend import Device

REFERENCE = Path(__file__).with_name("reference.npz")
"""Some chirps of each case as a CPU computes them."""
KEPT_CHIRPS, KEPT_SAMPLES = 24, 64
ERROR_LIMIT_DB = -80.0
FAN = "fan:3,-1,1,rpm=300"
TDM = {"prf_hz": 20000.0, "tx_offsets_m": ((0, 0, 0), (0, 0.0078, 0)), "multiplexing": "tdm"}


@cache
def _walk() -> t2d.Motion:
    return t2d.example("walk")


def _short() -> t2d.Motion:
    return t2d.trim(_walk(), 1.0, 2.0)


def _long() -> t2d.Motion:
    return t2d.place(t2d.repeat(_walk(), 10.0), distance_m=10)


def _second() -> t2d.Motion:
    return t2d.place(t2d.trim(_walk(), 2.0, 3.0), distance_m=3.0, angle_deg=20)


def _simulated(targets: Any, radar: Any = "table2", **options: Any) -> Callable[[Device], t2d.Recording]:
    return lambda device: t2d.simulate(targets(), radar=radar, device=device, **options)


CASES: dict[str, Callable[[Device], t2d.Recording]] = {
    "ellipsoids, 10 s": _simulated(_long, method="ellipsoid"),
    "mesh without occlusion, 1 s": _simulated(_short, accuracy={"occlusion": False}),
    "mesh, 1 s": _simulated(_short),
    "mesh, 10 s": _simulated(_long),
    "array, 1 s": _simulated(_short, "array-3x4"),
    "tdm, 1 s": _simulated(_short, t2d.Radar.preset("table2", **TDM)),
    "rotor, 1 s": _simulated(lambda: t2d.mover(FAN).mesh(0, 1.0)),
    "movers, 1 s": _simulated(lambda: [_second(), t2d.mover(FAN), t2d.Pet(animal="dog", position_m=(3, 1, 0))]),
    "bounces, 0.3 s": _simulated(lambda: t2d.trim(_walk(), 1.0, 1.3), bounces=2),
    "empty_room, 1 s": _simulated(_short, "table2-uniform", scene="empty_room", collisions="ignore"),
    "living_room, 4.3 s": _simulated(_walk, "table2-uniform", scene="living_room", collisions="ignore"),
}


def kept(recording: t2d.Recording) -> np.ndarray:
    """Some samples of chirps spread over the cube, complex64 (chirp, antenna, sample)."""
    cube = recording.adc
    rows = np.linspace(0, cube.shape[0] - 1, KEPT_CHIRPS).astype(int)
    chirps = np.stack([np.asarray(cube[int(row)]) for row in rows]).astype(np.complex64)
    return chirps[..., :: max(1, chirps.shape[-1] // KEPT_SAMPLES)]


def error_db(recording: t2d.Recording, name: str) -> float:
    """Power of the difference from the reference over its own [dB]."""
    reference = np.load(REFERENCE)[name]
    difference = np.sum(np.abs(kept(recording) - reference) ** 2) / np.sum(np.abs(reference) ** 2)
    return 10 * math.log10(float(difference) + 1e-30)
