"""Interpolation, smoothing, placing and repeating."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.interpolate
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import builders
from builders import MOTIONS
from t2d_rt.core.errors import InputError
from t2d_rt.motion import (
    describe,
    load_motion,
    motion_from_joints,
    place,
    quaternions,
    repeat,
    resample,
    sample,
    smooth,
    track,
    trim,
)
from t2d_rt.motion.interpolate import compose, decompose, jitter_mps, low_pass
from t2d_rt.motion.kinematics import facing
from t2d_rt.types.motion import Motion


@pytest.fixture(scope="module")
def walk() -> Motion:
    return builders.walk()


@pytest.fixture(scope="module")
def run() -> Motion:
    return load_motion(MOTIONS / "iclone_002_03_run_jog.bvh.gz")


def velocity(motion: Motion) -> np.ndarray:
    return np.diff(motion.joints, axis=0) * motion.rate_hz


# --- quaternions ----------------------------------------------------------------------------------------------------

unit_quaternions = st.integers(0, 2**32 - 1).map(lambda seed: Rotation.random(random_state=seed).as_quat())


@settings(max_examples=50, deadline=None)
@given(a=unit_quaternions, b=unit_quaternions, seed=st.integers(0, 1000))
def test_quaternions_agree_with_scipy(a: np.ndarray, b: np.ndarray, seed: int) -> None:
    v, w = np.random.default_rng(seed).normal(size=(2, 3))
    np.testing.assert_allclose(quaternions.rotate(a, v), Rotation.from_quat(a).apply(v), atol=1e-12)
    both = quaternions.rotate(quaternions.multiply(a, b), v)
    np.testing.assert_allclose(both, quaternions.rotate(a, quaternions.rotate(b, v)), atol=1e-12)
    np.testing.assert_allclose(quaternions.rotate(quaternions.conjugate(a), quaternions.rotate(a, v)), v, atol=1e-12)
    rotated = quaternions.rotate(quaternions.between(v, w), v)
    np.testing.assert_allclose(rotated / np.linalg.norm(v), w / np.linalg.norm(w), atol=1e-9)
    again = quaternions.from_matrix(Rotation.from_quat(a).as_matrix())
    assert abs(again @ a) == pytest.approx(1.0, abs=1e-12)


def test_opposite_directions_are_180_degrees_apart() -> None:
    for v in np.eye(3):
        np.testing.assert_allclose(quaternions.rotate(quaternions.between(v, -v), v), -v, atol=1e-12)


# --- interpolation --------------------------------------------------------------------------------------------------


def test_frames_are_met_and_decompose_inverts(walk: Motion) -> None:
    joints, rotations = sample(walk, walk.times_s)
    np.testing.assert_allclose(joints, walk.joints, atol=1e-9)
    assert np.abs((rotations * walk.rotations).sum(axis=-1)).min() == pytest.approx(1.0, abs=1e-12)
    again, _ = compose(*decompose(walk.joints, walk.rotations, walk.parents), walk.parents)
    np.testing.assert_allclose(again, walk.joints, atol=1e-12)


def test_a_20_fps_copy_gives_the_speeds_of_the_120_fps_walk() -> None:
    original = load_motion(MOTIONS / "12_01_walk.bvh", smooth_hz=12.0)
    coarse = replace(original, joints=original.joints[::6], rotations=original.rotations[::6], rate_hz=20.0)
    times = original.times_s[original.times_s <= coarse.duration_s + 1e-9]
    joints, _ = sample(coarse, times)
    both = [np.diff(low_pass(j, 12.0, 120.0), axis=0) * 120.0 for j in (joints, original.joints[: len(times)])]
    error = np.sqrt(
        ((both[0] - both[1]) ** 2).sum(axis=-1).mean(axis=0)
    )  # vector error: the stricter reading of the limit
    assert error.mean() <= 0.03
    assert error.max() <= 0.12


def test_a_pendulum_between_its_frames(walk: Motion) -> None:
    """A body turning evenly at 2 rad/s about z, its pelvis falling with g: circle and parabola at any time."""
    times = np.arange(61) / 30.0
    spin = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), 2.0 * times)[:, None]
    drop = np.stack([0 * times, 0 * times, -4.905 * times**2], axis=-1)[:, None]
    body = walk.joints[:1] - walk.joints[:1, :1]
    turning = Motion(
        joints=quaternions.rotate(spin, body) + drop, rotations=quaternions.multiply(spin, walk.rotations[:1]),
        rate_hz=30.0, names=walk.names, parents=walk.parents,
    )  # fmt: skip
    at = np.linspace(0.0, 2.0, 777)
    spin = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), 2.0 * at)[:, None]
    truth = quaternions.rotate(spin, body) + np.stack([0 * at, 0 * at, -4.905 * at**2], axis=-1)[:, None]
    np.testing.assert_allclose(sample(turning, at)[0], truth, atol=3e-6)


def test_the_second_derivative_is_continuous(walk: Motion) -> None:
    """Across a frame neither velocity nor acceleration jumps."""
    smooth_curve = track(walk)
    step = 1e-4
    frames = walk.times_s[5:-5:7]

    def acceleration(times: np.ndarray) -> np.ndarray:
        p, q, r = (smooth_curve(times + shift)[0] for shift in (-step, 0.0, step))
        return (p - 2 * q + r) / step**2

    def speed(times: np.ndarray) -> np.ndarray:
        return (smooth_curve(times + step)[0] - smooth_curve(times)[0]) / step

    scale = np.abs(acceleration(frames + 0.004)).max()
    assert 10.0 < scale < 1000.0  # m/s^2; a polygon has none
    jump = np.abs(acceleration(frames + 1.5 * step) - acceleration(frames - 1.5 * step)).max()
    assert jump < 0.15 * scale  # third derivative times 3e-4 s; a C1 curve jumps by the scale itself
    assert np.abs(speed(frames) - speed(frames - step)).max() < 10.0 * step * scale  # a polygon: 1/120 s


def test_the_signs_of_quaternions_do_not_matter(walk: Motion) -> None:
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=walk.rotations.shape[:2])[..., None]
    times = np.linspace(0.0, 4.0, 333)
    flipped = sample(replace(walk, rotations=signs * walk.rotations), times)[0]
    np.testing.assert_allclose(flipped, sample(walk, times)[0], atol=1e-9)


def test_bones_keep_their_length_between_frames(walk: Motion) -> None:
    joints, _ = sample(resample(walk, 20.0), np.linspace(0.0, 4.3, 999))
    shin = np.linalg.norm(joints[:, walk.index("left_ankle")] - joints[:, walk.index("left_knee")], axis=-1)
    assert np.ptp(shin) < 1e-9


def test_a_track_is_one_spline_of_all_joints(walk: Motion, monkeypatch: pytest.MonkeyPatch) -> None:
    """One for each joint, or one evaluation for each time, would take many times as long."""
    made, asked = [], []

    def counted(*args: object, **options: object) -> Callable[[np.ndarray], np.ndarray]:
        made.append(spline(*args, **options))
        return lambda times: asked.append(len(times)) or made[-1](times)

    spline = scipy.interpolate.make_interp_spline
    monkeypatch.setattr(scipy.interpolate, "make_interp_spline", counted)
    joints, _ = track(walk)(np.linspace(0.0, 4.0, 1000))
    assert joints.shape == (1000, len(walk.names), 3)
    assert (len(made), asked) == (1, [1000])


def test_resample_and_trim(walk: Motion) -> None:
    faster = resample(walk, 300.0)
    assert faster.rate_hz == 300.0
    assert faster.duration_s == pytest.approx(walk.duration_s, abs=1 / 300)
    np.testing.assert_allclose(faster.joints[::5], walk.joints[::2], atol=1e-9)
    part = trim(walk, 1.0, 2.0)
    np.testing.assert_array_equal(part.joints, walk.joints[120:241])
    assert part.report == walk.report


@pytest.mark.parametrize("frames", [2, 3, 4])
def test_short_motions_can_be_sampled(walk: Motion, frames: int) -> None:
    short = replace(walk, joints=walk.joints[:frames], rotations=walk.rotations[:frames])
    np.testing.assert_allclose(sample(short, short.times_s)[0], short.joints, atol=1e-9)
    smooth(short, 12.0)


# --- smoothing ------------------------------------------------------------------------------------------------------


def test_low_pass_is_3_db_down_at_the_cutoff_and_shifts_nothing() -> None:
    times = np.arange(1200) / 120.0
    inner = slice(300, 900)
    for frequency, gain in ((1.0, 1.0), (12.0, 0.5**0.5), (36.0, 0.004)):
        wave = np.sin(2 * np.pi * frequency * times)
        out = low_pass(wave[:, None], 12.0, 120.0)[:, 0]
        np.testing.assert_allclose(out[inner], gain * wave[inner], atol=0.005)


def test_jitter_is_found_and_removed(walk: Motion) -> None:
    calm = smooth(walk, 12.0)
    noise = np.random.default_rng(0).normal(scale=1e-3, size=walk.joints.shape)
    noisy = replace(calm, joints=calm.joints + noise)
    assert jitter_mps(calm) < 0.05 < 0.1 < 0.2 < jitter_mps(noisy) < 0.5
    clean = smooth(noisy, 12.0)
    error = np.sqrt(((velocity(clean) - velocity(calm)) ** 2).sum(axis=-1).mean())
    assert error < 0.25 * np.sqrt(((velocity(noisy) - velocity(calm)) ** 2).sum(axis=-1).mean())


def test_a_noisy_file_is_smoothed_by_itself(tmp_path: Path) -> None:
    lines = (MOTIONS / "momask_22j_120frames.bvh").read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    noise = np.random.default_rng(0).normal(scale=1.5e-3, size=(120, 3))
    for row, shift in enumerate(noise):
        words = lines[start + row].split()
        lines[start + row] = " ".join(
            [f"{float(w) + s:.6f}" for w, s in zip(words[:3], shift, strict=True)] + words[3:]
        )
    (tmp_path / "noisy.bvh").write_text("\n".join(lines))
    noisy = load_motion(tmp_path / "noisy.bvh")
    assert "; smoothed at 12 Hz (jitter 0.2" in noisy.report
    assert jitter_mps(noisy) < 0.05


def test_foot_strikes_of_a_run_survive_and_ends_stay(run: Motion) -> None:
    raw = load_motion(MOTIONS / "iclone_002_03_run_jog.bvh.gz", smooth_hz=None)
    assert "; smoothed at 12 Hz (jitter 0.08" in run.report
    np.testing.assert_array_equal(run.joints, smooth(raw, 12.0).joints)
    speeds = [np.linalg.norm(velocity(m), axis=-1).max(axis=0) for m in (raw, run)]
    np.testing.assert_allclose(speeds[1], speeds[0], rtol=0.1)
    assert np.linalg.norm(run.joints[[0, -1]] - raw.joints[[0, -1]], axis=-1).max() < 0.02


def test_a_clean_file_is_left_as_it_is() -> None:
    name = "131_01_walk_300frames.bvh"
    clean, raw = load_motion(MOTIONS / name), load_motion(MOTIONS / name, smooth_hz=None)
    assert "not smoothed (jitter 0.00" in clean.report
    np.testing.assert_array_equal(clean.joints, raw.joints)


# --- place ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("boresight", [(1.0, 0.0, 0.0), (0.0, -2.0, 0.5)])
@pytest.mark.parametrize("angle", [0.0, 90.0, 180.0])
def test_place_sets_distance_and_heading(walk: Motion, angle: float, boresight: tuple[float, float, float]) -> None:
    radar = (0.3, -0.2, 1.0)
    placed = place(walk, distance_m=5.0, angle_deg=angle, radar_position_m=radar, boresight=boresight)
    aim = np.array(boresight[:2]) / np.linalg.norm(boresight[:2])
    np.testing.assert_allclose(placed.joints[0, 0, :2], np.array(radar[:2]) + 5.0 * aim, atol=1e-9)
    net = (placed.joints[-1, 0] - placed.joints[0, 0])[:2]
    # The principal axis of the track and its chord differ by 1.6 degrees.
    assert net @ -aim / np.linalg.norm(net) == pytest.approx(np.cos(np.radians(angle)), abs=0.03)
    np.testing.assert_allclose(placed.joints[..., 2], walk.joints[..., 2], atol=1e-12)
    # A rigid move: pose, orientations and speeds stay.
    for mine, theirs in zip(decompose(placed.joints, placed.rotations, placed.parents),
                            decompose(walk.joints, walk.rotations, walk.parents), strict=True):  # fmt: skip
        np.testing.assert_allclose(mine[:, 1:], theirs[:, 1:], atol=1e-9)


def test_place_rotates_counterclockwise_seen_from_above(walk: Motion) -> None:
    net = np.diff(place(walk, distance_m=5.0, angle_deg=90.0).joints[[0, -1], 0], axis=0)[0]
    assert net[1] < -3.0  # from -x, 90 degrees about z: -y


def test_place_keeps_the_closest_approach(walk: Motion) -> None:
    for angle in (0.0, 70.0, 180.0):
        placed = place(walk, angle_deg=angle)
        assert np.linalg.norm(placed.joints[..., :2], axis=-1).min() == pytest.approx(1.5, abs=1e-9)
    assert place(walk).joints[0, 0, 0] == pytest.approx(5.5, abs=0.4)  # 3.9 m of walking, arms ahead


def test_a_person_on_the_spot_faces_the_radar() -> None:
    jumping = place(load_motion(MOTIONS / "14_14_jumping_jacks.bvh"), distance_m=3.0)
    ahead = facing({name: jumping.joints[:, i] for i, name in enumerate(jumping.names)})
    assert ahead[:15].mean(axis=0)[0] < -0.98


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"distance_m": 0.0}, "distance_m must be positive"),
        ({"boresight": (0.0, 0.0, 1.0)}, "not vertical"),
        ({"angle_deg": float("nan")}, "angle_deg must lie in"),
    ],
)
def test_place_refuses(walk: Motion, options: dict, match: str) -> None:
    with pytest.raises(InputError, match=match):
        place(walk, **options)


# --- repeat ---------------------------------------------------------------------------------------------------------


def test_a_repeated_walk_goes_on_without_a_jump(walk: Motion) -> None:
    long = repeat(walk, 10.0)
    assert long.duration_s == pytest.approx(10.0)
    assert len(long.joints) == 1201
    np.testing.assert_allclose(long.joints[:200], walk.joints[:200], atol=1e-9)
    step = [np.linalg.norm(np.diff(velocity(m), axis=0), axis=-1).max(axis=0) for m in (walk, long)]
    assert (step[1] <= 1.02 * step[0]).all()  # no joint's speed jumps more than in the recording
    assert np.linalg.norm(velocity(long), axis=-1).max() <= 1.02 * np.linalg.norm(velocity(walk), axis=-1).max()
    net = [(m.joints[-1, 0] - m.joints[0, 0])[:2] for m in (walk, long)]
    assert np.linalg.norm(net[1]) / 10.0 == pytest.approx(np.linalg.norm(net[0]) / walk.duration_s, rel=0.05)
    assert net[0] @ net[1] / np.linalg.norm(net[0]) / np.linalg.norm(net[1]) > 0.99  # straight on
    assert np.ptp(long.joints[:, 0, 2]) < np.ptp(walk.joints[:, 0, 2]) + 0.02


def test_a_repeated_run_is_as_lively(run: Motion) -> None:
    long = repeat(run, 8.0)
    step = [np.linalg.norm(np.diff(velocity(m), axis=0), axis=-1).max() for m in (run, long)]
    assert step[1] <= 1.05 * step[0]
    assert describe(long).mean_speed_mps == pytest.approx(describe(run).mean_speed_mps, rel=0.05)


def test_a_stand_at_the_end_is_not_the_cycle(walk: Motion) -> None:
    held = [np.concatenate([track, np.repeat(track[-1:], 180, axis=0)]) for track in (walk.joints, walk.rotations)]
    long = repeat(replace(walk, joints=held[0], rotations=held[1]), 20.0)
    assert describe(long).travelled_m > 9.0


def test_walking_on_the_spot(walk: Motion) -> None:
    spot = repeat(walk, 10.0, travel=False)
    assert np.ptp(spot.joints[:, 0, :2], axis=0).max() < 0.3
    assert describe(repeat(walk, 2.0, travel=False)).mean_speed_mps < 0.3


def test_a_circle_is_repeated_as_a_circle(walk: Motion) -> None:
    """Steps of a body that turns 90 degrees per cycle go round: after four cycles it is back."""
    angle = np.arange(151) / 100.0 * np.pi / 2
    spin = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), angle)[:, None]
    body = walk.joints[:1] - walk.joints[:1, :1] * [1.0, 1.0, 0.0] + np.array([2.0, 0.0, 0.0])
    wheel = motion_from_joints(quaternions.rotate(spin, body), rate_hz=100.0, names=walk.names)
    long = repeat(wheel, 9.0)
    radius = np.linalg.norm(long.joints[:, 0, :2], axis=-1)
    np.testing.assert_allclose(radius, radius[0], atol=0.02)


def test_repeat_trims_and_refuses(walk: Motion) -> None:
    np.testing.assert_array_equal(repeat(walk, 2.0).joints, walk.joints[:241])
    with pytest.raises(
        InputError,
        match=r"no two instants of like pose .*\(it is too short for a cycle\); give a longer",
    ):
        repeat(trim(walk, 0.0, 0.5), 10.0)
    with pytest.raises(InputError, match="duration_s must be finite"):
        repeat(walk, 0.0)


def test_describe_the_walk(walk: Motion) -> None:
    info = describe(walk)
    assert info.duration_s == pytest.approx(4.35)
    assert info.frames == 523
    assert info.mean_speed_mps == pytest.approx(0.89, abs=0.03)
    assert info.travelled_m == pytest.approx(3.88, abs=0.05)
    assert info.top_speed_joint.endswith("_toe")
    assert 3.0 < info.top_speed_mps < 5.0
    assert 1.5 < info.stature_m < 1.7
    assert "top speed" in str(info)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda m: sample(m, np.array([-0.1])), "within 0"),
        (lambda m: sample(m, np.array([99.0])), "repeat\\(\\) the motion"),
        (lambda m: sample(m, np.array([np.nan])), "times must be finite"),
        (lambda m: resample(m, 0.0), "rate_hz must lie"),
        (lambda m: trim(m, 3.0, 2.0), "trim needs"),
        (lambda m: trim(m, 0.0, 99.0), "trim needs"),
        (lambda m: smooth(m, 60.0), "cut-off must lie between"),
    ],
)
def test_bad_arguments(walk: Motion, call, match: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=match):
        call(walk)


def test_importing_motion_loads_no_scipy() -> None:
    code = "import sys, t2d_rt.motion; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[1], check=False).returncode == 0
