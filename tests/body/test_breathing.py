"""People who breathe: what skin and ellipsoids do, what a radar sees of it, and what a recording tells."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import rest_pose, slow_after
from t2d_rt.body import segments, skin, template
from t2d_rt.body.chest import CARRIERS
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.motion.vary import hold
from t2d_rt.types import CANONICAL_JOINTS, Breathing

BREATHS = Breathing(rate_hz=0.25, depth_m=0.005, phase_rad=1.0)
SPAN_S = 8.0
RATE_HZ = 50.0
"""Of the chirps that a chest is seen by."""


def at_rest(posture: str, span_s: float = SPAN_S, breathing: Breathing | None = BREATHS) -> t2d.Motion:
    """Somebody who stands, lies on the back or lies on the front, with the chest over the origin, quite still."""
    stand = rest_pose()
    turn = {"stands": 0.0, "back": -90.0, "front": 90.0}[posture]
    turned = Rotation.from_euler("y", turn, degrees=True)
    joints = turned.apply(stand.joints[0])
    joints += [0.0, 0.0, 0.0 if turn == 0.0 else 0.12 - joints[0, 2]]
    joints -= joints[stand.index("spine2")] * [1, 1, 0]
    rotations = (turned * Rotation.from_quat(stand.rotations[0])).as_quat()
    frames = round(20 * span_s) + 1
    still = {"joints": np.repeat(joints[None], frames, 0), "rotations": np.repeat(rotations[None], frames, 0)}
    return replace(stand, **still, rate_hz=20.0, placed=True, breathing=breathing)


def seen(recording: t2d.Recording) -> np.ndarray:
    """Displacement towards the radar (T,) [m] by the phase of the range cell that varies most, its static part taken away."""
    profile = np.fft.fft(np.squeeze(recording.cube) * np.hanning(recording.radar.samples), axis=1)
    cell = profile[:, profile.var(axis=0).argmax()]
    around = np.column_stack([2 * cell.real, 2 * cell.imag, np.ones(len(cell))])
    x, y, _ = np.linalg.lstsq(around, np.abs(cell) ** 2, rcond=None)[0]
    phase = np.unwrap(np.angle(cell - (x + 1j * y)))
    return np.asarray(-phase * SPEED_OF_LIGHT / (4 * np.pi * recording.radar.mid_frequency_hz))


@pytest.mark.parametrize(
    ("posture", "method"),
    slow_after(2, [("back", "mesh"), ("stands", "ellipsoid"), ("back", "ellipsoid"), ("stands", "mesh")]),
)
def test_the_phase_of_a_person_at_rest_shows_rate_and_depth(posture: str, method: Any) -> None:
    place, look = {"stands": ((2.0, 0.0, 1.2), (-1.0, 0.0, 0.0)), "back": ((0.0, 0.01, 2.1), (0.0, 0.0, -1.0))}[posture]
    radar = t2d.Radar.preset("table2", prf_hz=RATE_HZ, position_m=place, boresight=look)
    found = t2d.simulate(
        at_rest(posture), radar=radar, method=method, seed=1, noise="receiver", accuracy={"occlusion": False}
    )
    path_m = seen(found)
    times_s = np.arange(len(path_m)) / RATE_HZ
    waves = np.abs(np.fft.rfft((path_m - path_m.mean()) * np.hanning(len(path_m)), 64 * len(path_m)))
    rate_hz = np.fft.rfftfreq(64 * len(path_m), 1 / RATE_HZ)[waves.argmax()]
    truth = found.truth_at(times_s[::12], visible=False).isel(person=0)
    assert rate_hz == pytest.approx(float(truth.breathing_hz), rel=0.02)
    assert np.ptp(path_m) == pytest.approx(np.ptp(truth.breathing_m.values), rel=0.05)
    assert np.corrcoef(path_m[::12], truth.breathing_m)[0, 1] > 0.999


@pytest.mark.parametrize(("posture", "moves"), [("stands", 0), ("back", 2), ("front", 2)])
def test_chest_and_abdomen_move_and_nothing_else(posture: str, moves: int) -> None:
    """Of who lies on the front the back rises, for the floor bears the chest."""
    motion = at_rest(posture, 4.0)
    times_s = np.linspace(0, 4, 41)
    vertices = skin(motion).at(times_s)
    by_m = np.ptp(vertices, axis=0)
    assert by_m[:, moves].max() == pytest.approx(0.005, rel=0.01)
    # Along the normal of the skin, wherever it looks, and nothing farther than the depth.
    still = skin(at_rest(posture, 1.0, breathing=None)).at(np.zeros(1))[0]
    mesh = trimesh.Trimesh(still, template().faces, process=False)
    out = vertices[BREATHS.displacement_m(times_s).argmax()] - still
    far_m = np.linalg.norm(out, axis=1)
    assert far_m.max() == pytest.approx(0.005, rel=0.01)
    normals = trimesh.geometry.mean_vertex_normals(len(still), mesh.faces, mesh.face_normals * mesh.area_faces[:, None])
    np.testing.assert_allclose(out, far_m[:, None] * normals, atol=1e-6)
    trunk = template().weights[:, [CANONICAL_JOINTS.index(name) for name in CARRIERS]].sum(axis=1)
    assert by_m[trunk == 0].max() < 1e-9
    assert 60 < np.count_nonzero(far_m > 0.0045) < 400
    out_m = BREATHS.displacement_m(times_s)
    highest = vertices[:, by_m[:, moves].argmax(), moves]
    assert np.corrcoef(highest, out_m)[0, 1] > 0.9999
    limbs = segments(motion).at(times_s)[0]
    chest = limbs[:, segments(motion).names.index("chest"), moves]
    np.testing.assert_allclose(chest - chest[0], out_m - out_m[0], atol=1e-4)
    assert (
        np.ptp(np.delete(limbs, [segments(motion).names.index(each) for each in ("chest", "abdomen")], 1), 0).max()
        < 1e-9
    )


def test_a_breath_has_its_depth_and_goes_out_longer_than_in() -> None:
    times_s = np.linspace(0, 4, 4001)
    out_m = Breathing(rate_hz=0.25, depth_m=0.008).displacement_m(times_s)
    assert out_m[[0, -1]] == pytest.approx([0, 0], abs=1e-12)
    assert out_m.max() == pytest.approx(0.008, rel=1e-6)
    assert times_s[out_m.argmax()] == pytest.approx(1.6, abs=0.05)
    assert Breathing(rate_hz=0.25, depth_m=0.008).from_time(1.3).displacement_m(times_s[:500]) == pytest.approx(
        Breathing(rate_hz=0.25, depth_m=0.008).displacement_m(1.3 + times_s[:500])
    )
    with pytest.raises(InputError, match="depth_m"):
        Breathing(rate_hz=0.25, depth_m=8.0)


def test_people_made_from_sentences_breathe_and_files_do_not() -> None:
    made = [t2d.motion_from_text("a person bends down", seed=seed).breathing for seed in (1, 2)]
    assert made[0] != made[1]
    for each in made:
        assert 0.2 <= each.rate_hz <= 0.35
        assert 0.004 <= each.depth_m <= 0.012
    assert t2d.example("walk").breathing is None


def test_pieces_go_on_breathing_and_experiments_store_it() -> None:
    motion = at_rest("stands", 4.0)
    piece = t2d.trim(motion, 1.5, 3.5)
    assert piece.breathing.displacement_m(np.array([0.5])) == pytest.approx(BREATHS.displacement_m(np.array([2.0])))
    radar = t2d.Radar.preset("table2", prf_hz=200.0)
    before = t2d.trim(replace(motion, joints=motion.joints + [2.0, 0.0, 0.0]), 0, 0.2)
    found = t2d.simulate(before, radar=radar, method="ellipsoid", measure_error=False)
    assert found.again().experiment is not None
    assert found.experiment.targets_from(found.inputs)[0].breathing == BREATHS  # type: ignore[union-attr]


def test_who_rests_sways_over_feet_that_stay() -> None:
    motion = at_rest("stands", 1.0)
    still, swaying = (hold(motion, 30.0, sway_seed=seed) for seed in (None, 3))
    by_m = swaying.joints - still.joints
    hips = by_m[60:, 0]
    assert 0.0025 < hips[:, 0].std() < 0.006
    assert 0.0015 < hips[:, 1].std() < 0.004
    assert np.abs(by_m[:, motion.index("left_foot")]).max() < 1e-3
    assert np.abs(by_m[:14]).max() == 0
    power = np.abs(np.fft.rfft(hips[:, 0] * np.hanning(len(hips)))) ** 2
    assert power[np.fft.rfftfreq(len(hips), 1 / motion.rate_hz) > 1.1].sum() < 0.01 * power.sum()
    lying = hold(at_rest("back", 1.0), 30.0, sway_seed=3).joints - hold(at_rest("back", 1.0), 30.0).joints
    assert np.abs(lying).max() < 0.004
    sits = motion_from_text("a person sits down on a chair", seed=0)
    still, swaying = (hold(sits, 30.0, sway_seed=seed) for seed in (None, 3))
    by_m = np.abs(swaying.joints - still.joints).max(axis=(0, 2))
    assert max(by_m[sits.index(name)] for name in ("pelvis", "left_knee", "right_foot")) == 0
    assert 0.002 < by_m[sits.index("head")] < 0.02
