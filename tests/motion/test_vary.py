"""Changes of view and gait, and mirroring."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt.core.errors import InputError
from t2d_rt.motion.check import check_motion
from t2d_rt.motion.contacts import contacts, runs, soles
from t2d_rt.motion.kinematics import poses_of
from t2d_rt.motion.vary import arc, mirror, step_times_s, variations, vary_gait, vary_view


@pytest.fixture(scope="module")
def walk() -> t2d.Motion:
    return t2d.place(t2d.example("walk"), distance_m=6.0)


def rigid_walk(speed_mps: float = 1.2) -> t2d.Motion:
    """A body that moves straight ahead at one speed and turns no joint, placed 6 m before the radar."""
    walk = t2d.example("walk")
    track = np.arange(241)[:, None, None] / walk.rate_hz * speed_mps * np.array([1.0, 0.0, 0.0])
    pose, turned = (np.repeat(each[:1], 241, axis=0) for each in (walk.joints, walk.rotations))
    return t2d.place(replace(walk, joints=pose + track, rotations=turned), distance_m=6.0)


@pytest.mark.parametrize("angle_deg", [-120.0, -60.0, 0.0, 30.0, 75.0, 180.0, 400.0])
def test_radial_speed_follows_the_cosine(angle_deg: float) -> None:
    motion, radar = rigid_walk(), t2d.Radar.preset("table2")
    pelvis_m = float(motion.joints[0, 0, 2])
    moved = vary_view(motion, radar, angle_deg=angle_deg, height_m=pelvis_m)
    distance = np.linalg.norm(motion.joints[:3, 0] - np.array(moved.position_m), axis=-1)
    closing = -float(np.gradient(distance, 1 / motion.rate_hz)[0])
    assert closing == pytest.approx(1.2 * math.cos(math.radians(angle_deg)), abs=0.02 * 1.2)


@pytest.mark.parametrize("height_m", [None, 0.2, 2.5])
def test_the_start_stays_as_far_and_ahead(walk: t2d.Motion, height_m: float | None) -> None:
    radar = t2d.Radar.preset("table2")
    moved = vary_view(walk, radar, angle_deg=77.0, height_m=height_m)
    before, after = (walk.joints[0, 0] - np.array(each.position_m) for each in (radar, moved))
    assert np.linalg.norm(after) == pytest.approx(np.linalg.norm(before), abs=1e-6)
    assert moved.position_m[2] == (radar.position_m[2] if height_m is None else height_m)
    assert np.cross(after, np.array(moved.boresight)) == pytest.approx(np.zeros(3), abs=1e-9)
    assert after @ np.array(moved.boresight) > 0
    assert moved.carrier_hz == radar.carrier_hz


def test_a_motion_in_its_own_coordinates_has_no_view() -> None:
    with pytest.raises(InputError, match="lies in its own coordinates; put it there with place"):
        vary_view(t2d.example("walk"), t2d.Radar.preset("table2"), angle_deg=30.0)


def test_a_view_from_higher_than_the_distance_is_refused(walk: t2d.Motion) -> None:
    with pytest.raises(InputError, match="give a height between"):
        vary_view(walk, t2d.Radar.preset("table2"), angle_deg=0.0, height_m=20.0)


@pytest.mark.parametrize("factor", [0.7, 1.3])
@pytest.mark.parametrize("name", ["walk", "short_walk", "run"])
def test_cadence_and_speed_change_by_the_factor(name: str, factor: float) -> None:
    motion = t2d.example(name)
    varied = vary_gait(motion, factor)
    before, after = step_times_s(motion), step_times_s(varied)
    assert len(before) == len(after) >= 4
    # Peaks are found to a frame.
    assert np.ptp(before) / np.ptp(after) == pytest.approx(factor, rel=0.01 + 1.0 / motion.rate_hz / np.ptp(after))
    assert t2d.describe(varied).mean_speed_mps / t2d.describe(motion).mean_speed_mps == pytest.approx(factor, rel=0.01)
    assert varied.duration_s * factor == pytest.approx(motion.duration_s, abs=1.5 / motion.rate_hz * max(factor, 1))


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_planted_feet_stay_planted(walk: t2d.Motion, factor: float) -> None:
    """The ball of a foot stays as near to its mean place while it stands as it does in the recording (2.1 cm at most there)."""
    before, after = (soles(poses_of(each))[:, :, 1, :2] for each in (walk, vary_gait(walk, factor)))
    planted = contacts(poses_of(walk))[:, :, 1]
    steps = [(side, *run) for side in range(2) for run in runs(planted[:, side])]
    assert len(steps) >= 5
    for side, start, stop in steps:
        mean = before[start:stop, side].mean(0)
        stands = after[round(start / factor) : round((stop - 1) / factor) + 1, side]
        recorded, varied = (np.linalg.norm(each - mean, axis=-1).max() for each in (before[start:stop, side], stands))
        assert recorded < 0.022
        assert varied < recorded + 0.002


def test_the_path_stays_where_it_is(walk: t2d.Motion) -> None:
    varied = vary_gait(walk, 1.2, spread=0.1, seed=1)
    nearest = np.linalg.norm(varied.joints[:, :1] - walk.joints[None, :, 0], axis=-1).min(axis=1)
    assert nearest.max() < 0.01
    assert varied.joints[[0, -1], 0] == pytest.approx(walk.joints[[0, -1], 0], abs=0.02)


def test_steps_vary_by_the_spread_and_seed(walk: t2d.Motion) -> None:
    one, same, other = (vary_gait(walk, spread=0.2, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.joints, same.joints)
    assert one.joints.shape != other.joints.shape or not np.allclose(one.joints, other.joints, atol=0.01)
    rhythm = np.diff(step_times_s(one)) / np.diff(step_times_s(walk))
    assert np.std(rhythm) > 0.03


def test_the_tempo_changes_smoothly_at_foot_peaks() -> None:
    times_s = variations._warped(np.array([0.0, 0.5, 1.0, 1.5]), np.array([0.8, 1.25, 0.9]), 100.0)
    tempo = np.diff(times_s) * 100.0
    assert tempo.min() == pytest.approx(0.8, abs=0.01)
    assert tempo.max() == pytest.approx(1.25, abs=0.03)
    assert np.abs(np.diff(tempo)).max() < 0.04  # a step would be 0.45
    assert times_s[-1] == pytest.approx(1.5, abs=0.02)


def test_a_motion_without_steps_changes_as_a_whole() -> None:
    motion = rigid_walk()
    assert len(step_times_s(motion)) == 0
    assert vary_gait(motion, 2.0).duration_s == pytest.approx(motion.duration_s / 2)


@pytest.mark.parametrize("wrong", [{"factor": 0.0}, {"factor": float("nan")}, {"spread": -1.0}, {"seed": 1.5}])
def test_absurd_gaits_are_refused(walk: t2d.Motion, wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        vary_gait(walk, **wrong)


def test_a_mirrored_motion_exchanges_sides(walk: t2d.Motion) -> None:
    flipped = mirror(walk)
    left, right = walk.index("left_wrist"), walk.index("right_wrist")
    assert flipped.joints[:, left] == pytest.approx(walk.joints[:, right] * [1, -1, 1])
    assert np.array_equal(mirror(flipped).joints, walk.joints)
    assert np.allclose(np.abs((mirror(flipped).rotations * walk.rotations).sum(-1)), 1.0)


def test_mirrored_orientations_carry_their_bones(walk: t2d.Motion) -> None:
    from t2d_rt.motion.interpolate import decompose

    flipped = mirror(walk)
    before, after = (decompose(each.joints, each.rotations, each.parents)[0] for each in (walk, flipped))
    knees = walk.index("left_knee"), walk.index("right_knee")
    assert after[:, knees[0]] == pytest.approx(before[:, knees[1]] * [1, -1, 1], abs=1e-9)


def spectral_cadence_hz(motion: t2d.Motion) -> float:
    """Steps per second by the autocorrelation of the power of what moves faster than the trunk."""
    image = t2d.simulate(t2d.place(motion, distance_m=8.0), radar="table2", method="ellipsoid").spectrogram
    times = image.time_s.values
    level = 10 * np.log10((10 ** (image.values[image.velocity_mps.values > 1.9] / 10)).sum(axis=0))
    level = level - np.polyval(np.polyfit(times, level, 2), times)
    likeness = np.correlate(level, level, "full")[len(level) - 1 :]
    lags = np.arange(len(level)) * (times[1] - times[0])
    steps = (lags > 0.25) & (lags < 1.3)
    return float(1 / lags[steps][np.argmax(likeness[steps])])


@pytest.mark.slow
def test_the_spectrograms_cadence_follows(walk: t2d.Motion) -> None:
    before = spectral_cadence_hz(walk)
    times = step_times_s(walk)
    assert before == pytest.approx((len(times) - 1) / np.ptp(times), rel=0.03)
    for factor in (0.7, 1.3):
        assert spectral_cadence_hz(vary_gait(walk, factor)) / before == pytest.approx(factor, rel=0.03)


def test_a_path_bent_to_an_arc_turns_by_its_length_over_the_radius_and_feet_stay() -> None:
    walk = t2d.repeat(t2d.example("walk"), 6.0)
    way = np.linalg.norm(walk.joints[-1, 0, :2] - walk.joints[0, 0, :2])
    for radius_m in (3.0, -2.0):
        found = arc(walk, radius_m)
        ahead = np.diff(found.joints[:, 0, :2], axis=0) @ [1.0, 1.0j]
        stride = round(walk.rate_hz)
        turned = np.unwrap(
            np.angle([ahead[:stride].sum(), *[ahead[k : k + stride].sum() for k in range(0, len(ahead) - stride, 30)]])
        )
        assert turned[-1] - turned[0] == pytest.approx(way * (1 - 1 / 6) / radius_m, rel=0.12)
        assert check_motion(found, expected="walking").passed
        lean = found.joints[:, found.index("head")] - found.joints[:, 0]
        left = np.stack([-ahead.imag, ahead.real], axis=1) / np.abs(ahead)[:, None]
        assert np.sign((lean[1:, :2] * left).sum(axis=1).mean()) == np.sign(radius_m)
    with pytest.raises(InputError, match="tighter than a person turns"):
        arc(walk, 0.1)
