"""The figures of `compare`: closed forms first, then a recorded walk."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import t2d_rt as t2d
from builders import icosphere, point_cube, walk
from command_line import Command
from t2d_rt.core.errors import InputError
from t2d_rt.plots.figures import occupied_speeds, plot_comparison
from t2d_rt.recording.compare import compare, envelope, figures, mean_rcs_m2, ridge
from t2d_rt.types import Radar

RADAR = Radar.preset("table2-uniform", prf_hz=10240)
RADAR_FILE = Path("radar.yaml")
CHIRPS = 4000


def point(speed_mps: np.ndarray | float, rcs_m2: float, range_m: float = 4.0, radar: Radar = RADAR) -> np.ndarray:
    """ADC cube of a point by the radar equation; `speed_mps` towards the radar, one for all chirps or one for each."""
    travelled_m = np.cumsum(np.broadcast_to(speed_mps, CHIRPS)) / radar.prf_hz
    return point_cube(radar, range_m - travelled_m, rcs_m2)


def recording(*cubes: np.ndarray, radar: Radar = RADAR) -> t2d.Recording:
    return t2d.Recording(np.sum(cubes, axis=0).astype(np.complex64), radar)


def swing(amplitude_mps: float) -> np.ndarray:
    return amplitude_mps * np.abs(np.sin(2 * np.pi * np.arange(CHIRPS) / CHIRPS))


@pytest.mark.parametrize("range_m", [1.5, 4.0, 15.0])
@pytest.mark.parametrize("rcs_dbsm", [-20.0, 0.0])
def test_rcs_of_a_point(rcs_dbsm: float, range_m: float) -> None:
    result = recording(point(0.5, 10 ** (rcs_dbsm / 10), range_m))
    # 0.1 dB: the mean of R^4 over the three bins of a Hann window's lobe at 1.5 m
    assert 10 * math.log10(mean_rcs_m2(result)) == pytest.approx(rcs_dbsm, abs=0.1)


def test_background_far_away_has_no_part_in_the_rcs() -> None:
    rng = np.random.default_rng(0)
    cube = point(0.5, 1.0, 2.0)
    noise = rng.normal(size=(2, *cube.shape)) * np.abs(cube).mean() * 10 ** (-30 / 20)  # -54 dB per range bin
    # R^4 would lift it to 10 dB above the target
    assert 10 * math.log10(mean_rcs_m2(recording(cube, noise[0] + 1j * noise[1]))) == pytest.approx(0, abs=0.3)


@pytest.mark.slow
def test_the_radar_cross_section_in_a_room_is_that_of_what_moves() -> None:
    rest, faces = icosphere(3, 0.1)
    times = np.linspace(0, 0.1, 9)
    ball = t2d.MovingMesh(rest + np.array([2.5, 0, 1]) + times[:, None, None] * [1.0, 0, 0], faces, times, "pec")
    quiet, cluttered = (
        t2d.simulate(ball, radar="table2", scene="empty_room", reflections=0, clutter=clutter)
        for clutter in ("none", "specular")
    )
    found = [10 * math.log10(mean_rcs_m2(each)) for each in (quiet, cluttered)]
    assert found[1] == pytest.approx(found[0], abs=0.5)


@pytest.mark.parametrize("direction", [1, -1])
def test_torso_and_limb_speed(direction: int) -> None:
    torso, limb = point(direction * 0.9, 0.1), point(direction * swing(3.5), 0.003)
    found = figures(recording(torso, limb))
    assert found.torso_speed_mps == pytest.approx(direction * 0.9, abs=0.02)
    # 0.15 m/s: half a Hann window's lobe, which the envelope includes
    assert found.limb_speed_mps == pytest.approx(3.5, abs=0.2)


def test_limb_speed_does_not_depend_on_the_sign_of_a_static_torso() -> None:
    speeds = [figures(recording(point(v, 0.1), point(swing(-2.0), 0.003))).limb_speed_mps for v in (-0.01, 0.01)]
    assert speeds == pytest.approx([2.0, 2.0], abs=0.2)


def test_ridge_follows_the_centre_of_power() -> None:
    speeds = np.arange(-4.0, 4.5, 0.5)
    power = np.full((17, 3), -60.0)
    power[9:11, 0] = 0  # 0.5 and 1 m/s
    power[9, 1], power[10, 1] = 0, -3.0103
    power[10, 2], power[16, 2] = 0, -12  # a limb below the level
    assert ridge(power, speeds) == pytest.approx([0.75, (0.5 + 0.5) / 1.5, 1.0], abs=1e-4)


def test_envelope_of_known_columns() -> None:
    speeds = np.arange(-4.0, 5.0)
    power = np.full((9, 4), -60.0)
    power[5] = 0.0
    power[[2, 7], 1] = -34.0
    power[[1, 8], 1] = -36.0  # below the level
    power[5, 3], power[6, 3] = -50, -40  # a lull
    upper, lower = envelope(power, speeds)
    assert upper.tolist() == [1, 3, 1, 2]
    assert lower.tolist() == [1, -2, 1, 2]


def test_a_recording_against_itself() -> None:
    result = recording(point(0.9, 0.1), point(swing(3.5), 0.003))
    found = compare(result, result)
    assert found.first == found.second
    assert found.envelope_correlation == pytest.approx(1.0)
    assert found.mean_difference_db == 0
    louder = compare(result, t2d.Recording(2 * result.cube, RADAR))
    assert louder.mean_difference_db == pytest.approx(6.02, abs=0.01)
    assert louder.second.mean_rcs_dbsm - louder.first.mean_rcs_dbsm == pytest.approx(6.02, abs=0.01)
    assert "torso speed [m/s]" in str(found)


def test_columns_say_what_they_are() -> None:
    measured = recording(point(0.9, 0.1))
    mesh = t2d.Recording(measured.cube, RADAR, settings={"method": "mesh"})
    assert str(compare(mesh, measured)).splitlines()[0].split() == ["mesh", "measured"]
    assert compare(measured, measured).labels == ("measured 1", "measured 2")


def test_names_are_what_tells_the_recordings_apart() -> None:
    cube = recording(point(0.9, 0.1)).cube
    rooms = [t2d.Recording(cube, RADAR, settings={"method": "mesh", "scene": scene}) for scene in ("street", "hall")]
    assert compare(*rooms).labels == ("street", "hall")
    found = compare(*rooms, labels=("without a fan at all", "with one"))
    heading, rcs, *_ = str(found).splitlines()
    assert heading.split() == ["without", "a", "fan", "at", "all", "with", "one"]
    assert len(heading) == len(rcs)
    assert found.plot().axes[2].get_title() == "with one minus without a fan at all"


def test_the_second_is_shifted_to_where_it_is_like_the_first() -> None:
    torso, limb = point(0.9, 0.1), point(swing(3.5), 0.003)
    whole = (torso + limb).astype(np.complex64)
    late = t2d.Recording(np.concatenate([whole[:1000] * 1e-3, whole])[:3600], RADAR)
    first = t2d.Recording(whole, RADAR)
    apart, together = compare(first, late), compare(first, late, align=True)
    step = float(np.diff(first.spectrogram.time_s)[0])
    assert together.shift_s == pytest.approx(1000 / RADAR.prf_hz, abs=step)
    assert compare(late, first, align=True).shift_s == pytest.approx(-together.shift_s, abs=step)
    assert together.mean_difference_db < 3 < apart.mean_difference_db
    assert together.time_s[-1] <= float(first.spectrogram.time_s[-1])
    assert f"second lags by {together.shift_s:.3f} s" in str(
        compare(first, late, align=True, labels=("first", "second"))
    )
    assert compare(first, first, align=True).shift_s == 0


def test_radars_with_other_axes_are_compared_over_what_both_have() -> None:
    slow = RADAR.replace(prf_hz=RADAR.prf_hz / 2)
    first, second = recording(point(0.9, 0.1)), t2d.Recording(point(0.9, 0.1)[::2].astype(np.complex64), slow)
    second = second.processed(n_window=128, overlap=100)  # as long as the others
    found = compare(first, second)
    assert np.abs(found.velocity_mps).max() <= slow.max_speed_mps
    assert found.level_difference_db == pytest.approx(0, abs=1.0)
    assert found.mean_difference_db < 6
    seen = found.velocity_mps[found.second_db.max(axis=1).argmax()]
    assert seen == pytest.approx(0.9, abs=0.1)
    short = compare(first, t2d.Recording(first.cube[:2000], RADAR))
    assert short.mean_difference_db < 1e-3
    assert short.time_s[-1] < 2000 / RADAR.prf_hz


def test_samples_that_are_not_calibrated_are_compared_by_their_pattern() -> None:
    simulated = recording(point(0.9, 0.1), point(swing(3.5), 0.003))
    measured = t2d.Recording(1e4 * simulated.cube, RADAR)
    assert compare(simulated, measured).mean_difference_db == pytest.approx(40.0, abs=10)  # silence, 60 dB below, stays
    found = compare(simulated, measured, relative=True)
    assert found.level_difference_db == pytest.approx(80.0, abs=0.01)
    assert found.mean_difference_db == pytest.approx(0, abs=0.01)


def test_two_speckle_patterns_differ_by_six_decibels() -> None:
    rng = np.random.default_rng(1)
    parts = rng.normal(size=(2, 2, 2000, 1, RADAR.samples))
    one, two = (recording(real + 1j * imaginary).processed(range_gate_m=(4.9, 5.0)) for real, imaginary in parts)
    # E|10 log10(x/y)| of two exponential variables is (10/ln 10) 2 ln 2
    assert compare(one, two).mean_difference_db == pytest.approx(20 * math.log10(2), abs=0.3)


def test_envelopes_must_move_together_to_correlate() -> None:
    torso = point(0.9, 0.1)
    early = np.where(np.arange(CHIRPS) < CHIRPS // 2, swing(3.5), 0)
    one, two = recording(torso, point(early, 0.003)), recording(torso, point(swing(3.5) - early, 0.003))
    assert compare(one, two).envelope_correlation < 0
    static = recording(point(0.0, 0.1))
    assert math.isnan(compare(static, static).envelope_correlation)


def test_refusals() -> None:
    result = recording(point(0.9, 0.1))
    bursts = RADAR.replace(chirps_per_frame=128, frame_interval_s=0.1)
    with pytest.raises(InputError, match="records of one column cannot be aligned"):
        compare(result, t2d.Recording(result.cube[:128], bursts), align=True)
    with pytest.raises(InputError, match="labels must be two texts"):
        compare(result, result, labels=("one",))
    with pytest.raises(InputError, match="align must be True or False"):
        compare(result, result, align="yes")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="the recording is silent"):
        figures(t2d.Recording(np.zeros_like(result.cube), RADAR))


def test_picture() -> None:
    one, two = recording(point(0.9, 0.1)).spectrogram, recording(point(0.9, 0.2)).spectrogram
    figure = plot_comparison(one.velocity_mps.values, one.time_s.values, one.values, two.values, title="a point")
    upper, middle, lower, *bars = figure.axes
    assert [axes.get_title() for axes in (upper, middle, lower)] == ["first", "second", "second minus first"]
    assert lower.get_xlabel() == "Time [s]"
    assert [bar.get_ylabel() for bar in bars] == ["Power [dB re 1 W]"] * 2 + ["Difference [dB]"]
    low, high = upper.get_ylim()
    assert (low, high) == middle.get_ylim() == lower.get_ylim()
    assert low < 0 < 0.9 < high < 3


def test_drawn_speeds_hold_all_that_is_seen() -> None:
    speeds = np.linspace(-10, 10, 201)
    power = np.full((201, 5), -80.0)
    power[[70, 110], 2] = 0, -49  # -3 and 1 m/s
    assert occupied_speeds(speeds, power, 50.0) == pytest.approx((-4.0, 2.0))
    power[0] = -10  # folded over: the whole axis on that side
    assert occupied_speeds(speeds, power, 50.0)[0] == -10


# --- the command ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_names_the_columns_by_the_files(run: Command) -> None:
    simulated = recording(point(0.9, 0.1), point(swing(3.5), 0.003))
    simulated.save("simulated.zarr")
    np.save("frames.npy", simulated.cube[500:])
    RADAR_FILE.write_text(yaml.safe_dump(RADAR.model_dump(mode="json")))
    code, out, err = run(
        "compare", "simulated.zarr", "frames.npy", "--radar", str(RADAR_FILE), "--align", "-o", "both.pdf"
    )
    assert code == 0, err
    assert out.splitlines()[0].split() == ["simulated", "frames"]
    assert f"frames leads by {500 / RADAR.prf_hz:.3f} s" in out
    assert Path("both.pdf").read_bytes().startswith(b"%PDF")


def test_refusals_of_the_command(run: Command, refused: Callable[..., str]) -> None:
    result = recording(point(0.9, 0.1))
    result.save("one.zarr")
    assert (
        "one motion file, or two recordings (.zarr, .npy, .bin), got one.zarr;" in refused("compare", "one.zarr") + ";"
    )
    assert "got walk.bvh, one.zarr" in refused("compare", "walk.bvh", "one.zarr")
    sentence = refused("compare", "one.zarr", "one.zarr", "--seed", "3")
    assert "option seed is of a simulation, and one.zarr and one.zarr are recordings; leave it out" in sentence
    np.save("frames.npy", result.cube)
    for options in ((), ("--radar.prf-hz", "3000")):
        sentence = refused("compare", "one.zarr", "frames.npy", *options)
        assert (
            "frames.npy holds samples only; give its radar, --radar with a preset's name, a .yaml or a .cfg file"
            in sentence
        )
    assert "option lanes is of measured samples, and one.zarr and one.zarr are results; leave it out" in refused(
        "compare", "one.zarr", "one.zarr", "--lanes", "2"
    )
    assert "option iq is of measured samples, and walk.bvh is a motion file; leave it out" in refused(
        "compare", "walk.bvh", "--iq", "QI"
    )
    assert "option radar is of a simulation" in refused("compare", "one.zarr", "one.zarr", "--radar", "ci4r")


@pytest.mark.slow
def test_recorded_walk() -> None:
    motion = t2d.trim(t2d.place(walk()), 2.2, 3.5)  # two steps
    ellipsoid, mesh = (
        t2d.simulate(motion, method=method, accuracy={"sagitta_rad": 1.0}) for method in ("ellipsoid", "mesh")
    )
    pelvis = np.linalg.norm(motion.joints[[0, -1], 0] - [0, 0, 1], axis=1)
    truth = (pelvis[0] - pelvis[1]) / motion.duration_s
    found = compare(ellipsoid, mesh)
    for seen in (found.first, found.second):
        assert seen.torso_speed_mps == pytest.approx(truth, abs=0.1)
        assert 3 < seen.limb_speed_mps < 4
        assert -12 < seen.mean_rcs_dbsm < 0  # skin
    assert found.envelope_correlation > 0.8
    assert found.mean_difference_db < 10
