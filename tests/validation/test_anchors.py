"""Does it look like a person? Levels and speeds that are known from measurements of people, for both models."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import walk
from t2d_rt.body.materials import resolve_material
from t2d_rt.core.backend import Backend
from t2d_rt.recording.compare import envelope, figures
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.types import MovingMesh, Radar

RADAR = Radar.preset("table2")
COARSE_RAD = 1.0
RANGE_M = 5.0


@pytest.mark.slow
def test_a_person_has_about_half_a_square_metre(backend: Backend) -> None:
    # People measure -10..0 dBsm in the mean over aspects at 77 GHz. The mean of 120 looks of speckle is known to
    # 10 log10(1 + 1/sqrt(120)) = 0.4 dB.
    aspects_s = np.arange(120) / 10
    rotations = Rotation.from_euler("z", (aspects_s * 30)[:, None], degrees=True).as_matrix()
    body = t2d.skin(t2d.trim(walk(), 2.0, 2.3))
    pose = body.at(np.array([0.1]))[0]
    pose = pose - pose.mean(axis=0)
    rotated = MovingMesh.from_track(
        lambda t: pose @ rotations[np.rint(t * 10).astype(int)].transpose(0, 2, 1) + [RANGE_M, 0, 1], body.faces,
        aspects_s, rest=body.rest, crease_deg=180.0,
    )  # fmt: skip
    echoes = mesh_echoes(
        rotated, RADAR, times_s=aspects_s, material=resolve_material("skin", RADAR.mid_frequency_hz),
        detail=Detail(sagitta_rad=COARSE_RAD), seed=0, views=[PathVisibility()], backend=backend,
    ).gather()  # fmt: skip
    cycles = RADAR.mid_frequency_hz * echoes.delay_s % 1
    field = np.sum(echoes.amplitude * np.exp(2j * np.pi * cycles), axis=1)
    rcs_m2 = np.abs(field) ** 2 / RADAR.received_power_w(1.0, RANGE_M)
    assert -10 < 10 * np.log10(rcs_m2.mean()) < 0
    # Speckle: decibels of an exponential variable scatter by 5.6 dB.
    assert 3.5 < (10 * np.log10(rcs_m2)).std() < 8


@pytest.mark.slow
@pytest.mark.parametrize("direction", [1, -1], ids=["towards", "away"])
@pytest.mark.parametrize("method", ["ellipsoid", "mesh"])
def test_a_walk_shows_torso_and_feet(method: Literal["ellipsoid", "mesh"], direction: int) -> None:
    # CMU 12_01 walks at 0.88 m/s. A foot that swings forward is three to four times as fast; one that stands, at rest.
    motion = t2d.place(walk(), distance_m=5.0 if direction > 0 else 2.0, angle_deg=0 if direction > 0 else 180)
    result = t2d.simulate(t2d.trim(motion, 2.3, 3.0), radar=RADAR, method=method, accuracy={"sagitta_rad": COARSE_RAD})
    found = figures(result)
    assert direction * found.torso_speed_mps == pytest.approx(0.88, abs=0.1)
    assert 3 < found.limb_speed_mps < 4
    image = result.spectrogram
    upper, lower = envelope(image.values, image.velocity_mps.values)
    forward, backward = (upper, lower) if direction > 0 else (-lower, -upper)
    assert 3 < forward.max() < 4.5
    assert forward.max() > 2 * abs(backward.min())
