"""Arrays by `simulate`: directions, time slots of the transmitters, patterns and polarisation, one cube however it is made."""

from __future__ import annotations

import math
import os
from functools import cache
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import icosphere, moving
from t2d_rt.core.backend import Backend
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.signal import point_cloud, unit_vectors
from t2d_rt.types import PEC, Ellipsoids, MovingMesh, Radar

TDM = Radar.preset("array-3x4")
LOOPS = 64
RADIUS_M = 0.05


def ball(
    radar: Radar, azimuth_deg: float, elevation_deg: float, *, speed_mps: float = 0.0, duration_s: float = 0.01
) -> MovingMesh:
    """A conducting sphere, its nearest point at 3 m."""
    ray = unit_vectors(math.radians(azimuth_deg), math.radians(elevation_deg)) @ radar.axes
    times = np.linspace(0, duration_s, 4)
    centre = radar.position_m + (3 + RADIUS_M - speed_mps * times)[:, None] * ray
    return moving(icosphere(3, RADIUS_M), centre, times)


@cache
def cube(speed_mps: float) -> np.ndarray:
    return t2d.simulate(ball(TDM, 30, 10, speed_mps=speed_mps), radar=TDM).cube[:LOOPS]


def direction_deg(samples: np.ndarray, **options: Any) -> np.ndarray:
    points = point_cloud(samples, TDM, frame_chirps=LOOPS, mti="none", **options)
    top = points.snr_db.argmax()
    return np.degrees([points.azimuth_rad[top], points.elevation_rad[top]])


def level_db(radar: Radar, **where: float) -> float:
    target = ball(radar, where.get("azimuth_deg", 0.0), where.get("elevation_deg", 0.0))
    return float(
        10 * np.log10(np.mean(np.abs(t2d.simulate(target, radar=radar, accuracy={"occlusion": False}).cube) ** 2))
    )


@pytest.mark.parametrize("speed_mps", [0.0, 1.5])
def test_direction_of_a_sphere(speed_mps: float) -> None:
    assert np.abs(direction_deg(cube(speed_mps)) - [30, 10]).max() < 0.5


def test_a_mover_rotates_between_transmitters() -> None:
    """2 v / lambda * 80 us = 0.062 cycles between transmitters 2 lambda apart: 2.05 degrees at 30, of which the receivers, which
    are right, leave 1.43."""
    error = direction_deg(cube(1.5), compensate_tdm=False) - direction_deg(cube(1.5))
    assert 1.2 < abs(error[0]) < 1.7
    assert np.abs(direction_deg(cube(0.0), compensate_tdm=False) - direction_deg(cube(0.0))).max() < 1e-6


def test_an_ellipsoid_is_seen_at_its_nearest_point() -> None:
    """Spheroid 8 x 22 cm at 3.2 m, long axis at 45 degrees to the sight: its nearest point lies 2.3 degrees beside its centre."""
    times = np.array([0.0, 0.01])
    slant = math.radians(45)
    axes = np.array([[0, 0, 1], [-math.sin(slant), -math.cos(slant), 0], [math.cos(slant), -math.sin(slant), 0]]).T
    axes = axes * [np.linalg.det(axes), 1, 1]
    sizes = np.array([[0.08, 0.08, 0.22]])
    centre = np.array(TDM.position_m) + [3.2, 0, 0]
    shape = Ellipsoids(sizes, np.tile(centre, (2, 1, 1)), times, axes[None], PEC)
    # The nearest of many points of the surface, in the plane of sight and axis.
    angle = np.linspace(0, 2 * np.pi, 200_001)
    surface = [3.2, 0] + 0.22 * np.cos(angle)[:, None] * axes[:2, 2] + 0.08 * np.sin(angle)[:, None] * axes[:2, 1]
    x, y = surface[np.hypot(*surface.T).argmin()]
    expected = math.degrees(math.atan2(y, x))
    assert abs(expected) > 2
    samples = t2d.simulate(shape, radar=TDM, method="ellipsoid").cube[:LOOPS]
    assert np.abs(direction_deg(samples) - [expected, 0]).max() < 0.1


@pytest.mark.slow
def test_patterns_reach_the_level() -> None:
    plain = Radar.preset("ci4r")
    cosine = plain.replace(tx_pattern={"kind": "cosine", "exponent": 2}, rx_pattern={"kind": "cosine", "exponent": 4})
    loss_db = level_db(cosine, azimuth_deg=40) - level_db(plain, azimuth_deg=40)
    assert loss_db == pytest.approx(60 * math.log10(math.cos(math.radians(40))), abs=0.05)
    assert level_db(cosine) == pytest.approx(level_db(plain), abs=0.05)


def test_crossed_polarisations_give_nothing() -> None:
    plain = Radar.preset("ci4r")
    assert level_db(plain.replace(rx_polarization_deg=90), azimuth_deg=30) < level_db(plain, azimuth_deg=30) - 50
    slanted = plain.replace(rx_polarization_deg=60)
    assert level_db(slanted) - level_db(plain) == pytest.approx(-6.02, abs=0.05)


def test_threads_and_reading_change_nothing(backend: Backend) -> None:
    import drjit as dr

    surface = ball(TDM, 20, -5, speed_mps=2.0, duration_s=0.12)
    times = np.linspace(0, 0.12, 70)
    echoes = mesh_echoes(
        surface, TDM, times_s=times, material=PEC, detail=Detail(sagitta_rad=0.07), seed=0, views=[PathVisibility()],
        backend=backend,
    )  # fmt: skip
    before = dr.thread_count()
    try:
        dr.set_thread_count(max(2, os.cpu_count() or 1))
        whole = t2d.synthesize(echoes, TDM)
        for read_frames in (1, 40):
            apart = t2d.synthesize(echoes, TDM, read_frames=read_frames)
            assert np.sum(np.abs(apart - whole) ** 2) < 1e-9 * np.sum(np.abs(whole) ** 2)
        dr.set_thread_count(1)
        np.testing.assert_array_equal(t2d.synthesize(echoes, TDM), whole)
    finally:
        dr.set_thread_count(before)
