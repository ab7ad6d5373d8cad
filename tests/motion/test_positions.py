"""Positions alone: rotations by swing and twist, joints that lack, noise of cameras."""

from __future__ import annotations

import re
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import MOTIONS, WALK, slow_after
from t2d_rt.body import template
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion, motion_from_joints
from t2d_rt.motion.interpolate import compose, decompose, low_pass
from t2d_rt.motion.quaternions import conjugate, multiply, rotate
from t2d_rt.motion.read.complete import add_level_feet, complete
from t2d_rt.motion.read.joint_sets import NEEDED
from t2d_rt.motion.read.noise import CUTOFFS_HZ, denoised, noise_power
from t2d_rt.motion.read.orientations import orientations_from_positions
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

CLIPS = {
    "walk": WALK,
    "stylised walk": MOTIONS / "131_01_walk_300frames.bvh",
    "jumping jacks": MOTIONS / "14_14_jumping_jacks.bvh",
    "jog": MOTIONS / "iclone_002_03_run_jog.bvh.gz",
    "MoMask": MOTIONS / "momask_22j_120frames.bvh",
}

BONES = {
    "spine1": ("spine2", "pelvis"), "spine2": ("spine3", "spine1"), "spine3": ("neck", "spine2"), "neck": ("head", "spine3"),
    **{
        f"{side}_{joint}": tuple(name if name in ("pelvis", "spine3") else f"{side}_{name}" for name in ends)
        for side in ("left", "right")
        for joint, ends in {
            "hip": ("knee", "pelvis"), "knee": ("ankle", "hip"), "ankle": ("foot", "knee"), "shoulder": ("elbow", "spine3"),
            "elbow": ("wrist", "shoulder"),
        }.items()
    },
}  # fmt: skip
"""Bones by the joint that carries them: the joint that they end at, and the joint against which their twist counts."""


@cache
def clip(name: str, rate_hz: float | None = None) -> Motion:
    motion = load_motion(CLIPS[name])
    return motion if rate_hz is None else t2d.resample(motion, rate_hz)


def of_positions(motion: Motion) -> Motion:
    return motion_from_joints(motion.joints[:, :22], rate_hz=motion.rate_hz)


def points_of(motion: Motion) -> dict[str, np.ndarray]:
    return {name: motion.joints[:, i] for i, name in enumerate(motion.names[:22])}


def reproduction_errors_m(motion: Motion) -> np.ndarray:
    """Distances (T, J) between joints and those of forward kinematics with constant (median) offsets."""
    offsets, local = decompose(motion.joints, motion.rotations, motion.parents)
    rigid = np.tile(np.median(offsets, axis=0), (len(offsets), 1, 1))
    rigid[:, 0] = offsets[:, 0]
    joints, _ = compose(rigid, local, motion.parents)
    return np.linalg.norm(joints - motion.joints, axis=-1)


def twist_steps_deg(motion: Motion) -> dict[str, np.ndarray]:
    """Angles (T - 1,) by which each bone turns about itself against its parent from frame to frame."""
    found = {}
    for name, (end, parent) in BONES.items():
        above = conjugate(motion.rotations[:, motion.index(parent)])
        along = rotate(above, motion.joints[:, motion.index(end)] - motion.joints[:, motion.index(name)])
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        turned = multiply(above, motion.rotations[:, motion.index(name)])
        step = multiply(turned[1:], conjugate(turned[:-1]))
        angle = 2 * np.arctan2((step[:, :3] * along[:-1]).sum(axis=-1), step[:, 3])
        found[name] = np.degrees(np.abs(np.angle(np.exp(1j * angle))))
    return found


# --- rotations ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [None, 30.0])
@pytest.mark.parametrize("name", slow_after(2, CLIPS))
def test_rotations_reproduce_positions_without_jumps_of_twist(name: str, rate_hz: float | None) -> None:
    found = of_positions(clip(name, rate_hz))
    errors = reproduction_errors_m(found)
    assert errors.mean() < 0.01
    assert errors.mean(axis=0).max() < 0.02
    assert max(steps.max() for steps in twist_steps_deg(found).values()) < 30


def limb(bend_rad: np.ndarray, twist_rad: np.ndarray, kind: str) -> tuple[Motion, Rotation]:
    """A standing body whose left arm (hanging) or leg bends at its hinge, turned about its upper bone; and that turn."""
    motion = clip("walk")
    frame = motion.joints[200, :22] - motion.joints[200, 0]
    ahead = Rotation.from_euler("z", -np.arctan2(*(frame[1] - frame[2])[[0, 1]][::-1]) + np.pi / 2)
    joints = np.tile(ahead.apply(frame), (len(bend_rad), 1, 1))
    upper, middle, end = {"arm": (16, 18, 20), "leg": (1, 4, 7)}[kind]
    turn = Rotation.from_euler("z", twist_rad[:, None])
    joints[:, middle] = joints[:, upper] - [0, 0, 0.4]
    # An elbow brings the forearm forward, a knee the shank backward, both about the left of the body.
    bent = Rotation.from_euler("y", (-bend_rad if kind == "arm" else bend_rad)[:, None])
    joints[:, end] = joints[:, middle] + turn.apply(bent.apply(np.tile([0, 0, -0.3], (len(bend_rad), 1))))
    if kind == "leg":
        joints[:, 10] = joints[:, end] + turn.apply(bent.apply(np.tile([0.13, 0, -0.05], (len(bend_rad), 1))))
    return motion_from_joints(joints, rate_hz=60.0), turn


def twist_about_bone(motion: Motion, joint: str) -> np.ndarray:
    """Angle (T,) about z by which a hanging upper bone is turned since the first frame [rad]."""
    turned = motion.rotations[:, motion.index(joint)]
    step = multiply(turned, conjugate(turned[:1]))
    return np.angle(np.exp(2j * np.arctan2(step[:, 2], step[:, 3])))


@pytest.mark.parametrize(("kind", "joint"), [("arm", "left_shoulder"), ("leg", "left_hip")])
def test_a_bent_limb_tells_its_twist(kind: str, joint: str) -> None:
    twist = np.radians(30) * np.sin(2 * np.pi * 0.5 * np.arange(120) / 60)
    motion, _ = limb(np.full(120, np.radians(70)), twist, kind)
    np.testing.assert_allclose(twist_about_bone(motion, joint), twist - twist[0], atol=np.radians(5))


@pytest.mark.parametrize(("kind", "joint"), [("arm", "left_shoulder"), ("leg", "left_hip")])
def test_a_limb_that_straightens_keeps_its_twist(kind: str, joint: str) -> None:
    """At less than a degree of bend, millimetres of error turn the hinge anywhere."""
    bend = np.radians(30 + 30 * np.cos(2 * np.pi * np.arange(240) / 120))
    motion, _ = limb(bend, np.full(240, np.radians(25)), kind)
    joints = motion.joints + np.random.default_rng(0).normal(0, 1e-3, motion.joints.shape)
    noisy = motion_from_joints(joints, rate_hz=60.0)
    twist = np.degrees(twist_about_bone(noisy, joint))
    assert np.ptp(twist) < 25
    assert np.abs(np.diff(twist)).max() < 5


def test_a_hyperextended_elbow_does_not_flip() -> None:
    bend = np.radians(15 * np.cos(2 * np.pi * np.arange(240) / 120))  # from 15 degrees to -15
    motion, _ = limb(bend, np.zeros(240), "arm")
    assert np.ptp(np.degrees(twist_about_bone(motion, "left_shoulder"))) < 30


def test_a_straight_leg_follows_its_foot() -> None:
    twist = np.radians(30) * np.sin(2 * np.pi * 0.5 * np.arange(120) / 60)
    motion, _ = limb(np.full(120, np.radians(1)), twist, "leg")
    found = twist_about_bone(motion, "left_hip")
    slope = (found * twist).sum() / (twist**2).sum()
    assert 0.4 < slope < 1.1


def test_arms_overhead_and_behind_have_no_singular_swing() -> None:
    """An arm circles through hanging, ahead, overhead and back; the reference of its twist may not turn over."""
    angle = np.linspace(0, 2 * np.pi, 240)
    motion = clip("walk")
    joints = np.tile(motion.joints[200, :22], (240, 1, 1))
    across = joints[0, 16] - joints[0, 17]
    across /= np.linalg.norm(across)
    for step, length in ((18, 0.3), (20, 0.26)):
        circle = Rotation.from_rotvec(angle[:, None] * -across).apply([0, 0, -length])
        joints[:, step] = joints[:, {18: 16, 20: 18}[step]] + circle
    found = motion_from_joints(joints, rate_hz=60.0)
    assert twist_steps_deg(found)["left_shoulder"].max() < 10


def test_orientations_carry_their_bones() -> None:
    motion = of_positions(clip("jumping jacks"))
    for name, end in (
        ("left_hip", "left_knee"),
        ("right_elbow", "right_wrist"),
        ("spine2", "spine3"),
        ("neck", "head"),
    ):
        bone = motion.joints[:, motion.index(end)] - motion.joints[:, motion.index(name)]
        own = rotate(
            conjugate(motion.rotations[:, motion.index(name)]), bone / np.linalg.norm(bone, axis=-1, keepdims=True)
        )
        np.testing.assert_allclose(own, own[:1].repeat(len(own), 0), atol=1e-9)


@pytest.mark.parametrize("name", ["walk", "jog"])
def test_skin_of_positions_is_like_that_of_rotations(name: str) -> None:
    """Vertices of the skin with found rotations against those with recorded ones; of hands positions alone say nothing."""
    recorded = t2d.trim(clip(name, 30.0), 0.0, 1.2)
    surfaces = [t2d.skin(each).at(recorded.times_s[::6]) for each in (recorded, of_positions(recorded))]
    gap = np.linalg.norm(surfaces[0] - surfaces[1], axis=-1)
    hands = (
        template("adult")
        .weights[:, [CANONICAL_JOINTS.index(f"{side}_wrist") for side in ("left", "right")]]
        .sum(axis=1)
    )
    assert np.median(gap) < 0.002
    assert np.percentile(gap[:, hands < 0.1], 99) < 0.03


def test_a_foot_that_a_recording_flips_does_not_spin() -> None:
    """Directions close to the opposite of the usual one, where the least swing turns over."""
    joints = clip("walk", 60.0).joints[:, :22].copy()
    ankle, foot = (CANONICAL_JOINTS.index(f"left_{joint}") for joint in ("ankle", "foot"))
    usual = joints[:, foot] - joints[:, ankle]
    shank = joints[:, ankle] - joints[:, CANONICAL_JOINTS.index("left_knee")]
    shank /= np.linalg.norm(shank, axis=-1, keepdims=True)
    angle = np.concatenate([np.zeros(60), np.linspace(0, np.pi, 20), np.linspace(-np.pi, 0, 20)])
    turn = np.zeros(len(joints))
    turn[: len(angle)] = np.where(np.abs(angle) > 3, 3 * np.sign(angle), angle)
    joints[:, foot] = joints[:, ankle] + Rotation.from_rotvec(turn[:, None] * shank).apply(usual)
    found = motion_from_joints(joints, rate_hz=60.0)
    assert twist_steps_deg(found)["left_ankle"].max() < 20


def test_bones_without_length_are_refused() -> None:
    points = points_of(clip("walk"))
    points["left_knee"] = points["left_hip"].copy()
    with pytest.raises(InputError, match="'left_hip' and 'left_knee' coincide"):
        orientations_from_positions(points, 120.0)


# --- joints that lack -----------------------------------------------------------------------------------------------


def test_filled_joints_move_with_the_body() -> None:
    motion = clip("walk", 30.0)
    at, told = complete({name: points_of(motion)[name] for name in NEEDED})
    assert told == ["filled pelvis, neck, head, spine1, spine2, spine3, left_collar, right_collar"]
    assert set(at) == {name for name in CANONICAL_JOINTS if "foot" not in name}
    for name, limit in (("neck", 0.06), ("head", 0.08), ("spine3", 0.06), ("left_collar", 0.08), ("spine2", 0.05)):
        gap = at[name] - points_of(motion)[name]
        assert np.linalg.norm(gap, axis=-1).mean() < limit, name
        assert np.linalg.norm(gap - gap.mean(axis=0), axis=-1).max() < 0.05, name


@pytest.mark.parametrize("height", [0.5, 1.0, 2.0])
def test_a_head_counts_by_its_direction(height: float) -> None:
    """Cameras mean the skull's base, its middle or its top."""
    points = points_of(clip("walk", 30.0))
    points["head"] = points["neck"] + height * (points["head"] - points["neck"])
    at, told = complete(points)
    assert "head at the base of the skull" in told
    length = np.linalg.norm(at["head"] - at["neck"], axis=-1)
    np.testing.assert_allclose(length, length[0], rtol=0.02)
    assert 0.08 < length[0] < 0.14


def test_filled_feet_stand_level_and_swing_with_the_shank() -> None:
    motion = clip("walk", 60.0)
    points = {name: track for name, track in points_of(motion).items() if "foot" not in name}
    assert add_level_feet(points, 1.6) == ["left_foot", "right_foot"]
    for side in ("left", "right"):
        foot, ankle = points[f"{side}_foot"], points[f"{side}_ankle"]
        true = motion.joints[:, motion.index(f"{side}_foot")]
        speed = np.linalg.norm(np.gradient(ankle, 1 / 60, axis=0), axis=-1)
        planted = (speed < 0.15) & (ankle[:, 2] < np.percentile(ankle[:, 2], 30))
        drop = (ankle - foot)[planted, 2]
        assert np.ptp(drop) < 0.02  # level
        assert foot[:, 2].min() > ankle[:, 2].min() - 0.08  # not through the floor
        assert np.linalg.norm(foot - true, axis=-1).mean() < 0.07


@pytest.mark.parametrize(("name", "limit_mps"), [("walk", 0.35), ("jog", 0.6)])
def test_filled_feet_move_as_true_ones(name: str, limit_mps: float) -> None:
    motion = clip(name, 60.0)
    points = {joint: track for joint, track in points_of(motion).items() if "foot" not in joint}
    add_level_feet(points, 1.7)
    for foot in ("left_foot", "right_foot"):
        error = np.diff(points[foot] - motion.joints[:, motion.index(foot)], axis=0) * 60
        assert np.sqrt((error**2).sum(axis=-1).mean()) < limit_mps


# --- noise ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 30.0])
@pytest.mark.parametrize("sigma_m", [0.002, 0.005])
def test_noise_is_measured_from_bone_lengths(rate_hz: float, sigma_m: float) -> None:
    points = points_of(clip("walk", rate_hz))
    rng = np.random.default_rng(1)
    noisy = {name: track + rng.normal(0, sigma_m, track.shape) for name, track in points.items()}
    assert np.sqrt(noise_power(noisy).mean()) == pytest.approx(sigma_m, rel=0.3)
    assert np.sqrt(noise_power(points).mean()) < 1e-5


def speeds(joints: np.ndarray, rate_hz: float, times_s: np.ndarray) -> np.ndarray:
    frames = np.arange(len(joints)) / rate_hz
    return (
        make_interp_spline(frames, joints.reshape(len(joints), -1), k=3)
        .derivative()(times_s)
        .reshape(len(times_s), -1, 3)
    )


@pytest.mark.parametrize(
    ("rate_hz", "sigma_m", "factor"), [(10.0, 0.005, 1.15), (20.0, 0.003, 1.7), (20.0, 0.005, 2.2), (30.0, 0.005, 3.5)]
)
def test_smoothing_lowers_the_error_of_speed_and_keeps_the_swing(rate_hz: float, sigma_m: float, factor: float) -> None:
    whole, motion = clip("walk"), clip("walk", rate_hz)
    clean = motion.joints[:, :22]
    noisy = clean + np.random.default_rng(2).normal(0, sigma_m, clean.shape)
    points = {name: noisy[:, i] for i, name in enumerate(CANONICAL_JOINTS)}
    found, _, error_mps = denoised(points, noise_power(points), rate_hz)
    smooth = np.stack(list(found.values()), axis=1)
    times = np.arange(0.0, motion.duration_s, 1 / 120)
    true = speeds(whole.joints[:, :22], whole.rate_hz, times)
    rough, after = (np.sqrt(((speeds(each, rate_hz, times) - true) ** 2).sum(-1).mean()) for each in (noisy, smooth))
    assert after < rough / factor
    # Frames themselves cost 0.08 m/s at 10 Hz, which the estimate does not hold.
    assert error_mps == pytest.approx(after, rel=0.4)
    for joint in ("left_wrist", "right_ankle"):
        column = CANONICAL_JOINTS.index(joint)
        swings = [np.std(each[:, column] - each[:, 0]) for each in (true, speeds(smooth, rate_hz, times))]
        assert swings[1] == pytest.approx(swings[0], rel=0.1)


def coloured(shape: tuple[int, ...], memory: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of variance 1 in which each frame keeps that share of the last one's, AR(1)."""
    warm = 100
    white = rng.normal(0, np.sqrt(1 - memory**2), (shape[0] + warm, *shape[1:]))
    return np.asarray(lfilter([1], [1, -memory], white, axis=0)[warm:])


def test_the_spectrum_of_coloured_noise_is_measured() -> None:
    points = {name: np.concatenate([track, track[::-1]] * 3) for name, track in points_of(clip("walk", 20.0)).items()}
    rng = np.random.default_rng(4)
    noisy = {name: track + 0.01 * coloured(track.shape, 0.8, rng) for name, track in points.items()}
    power = noise_power(noisy)
    assert np.sqrt(power.mean()) == pytest.approx(0.01, rel=0.2)
    turn = np.pi * np.linspace(0, 1, len(power))
    expected = 1e-4 * (1 - 0.8**2) / np.abs(1 - 0.8 * np.exp(-1j * turn)) ** 2
    for low, high in ((0.02, 0.1), (0.1, 0.3), (0.3, 0.6), (0.6, 1.0)):
        band = slice(int(low * len(power)), int(high * len(power)))
        assert power[band].mean() == pytest.approx(expected[band].mean(), rel=0.2)


@pytest.mark.parametrize("rate_hz", [10.0, 30.0])
@pytest.mark.parametrize("kind", ["white", "coloured", "bursts", "uneven"])
def test_smoothing_is_as_good_as_the_best_plain_low_pass(kind: str, rate_hz: float) -> None:
    """Whose cut-off nobody knows; depth cameras follow their last frames, and err in bursts when limbs hide one another."""
    motion = clip("walk", rate_hz)
    clean, rng = motion.joints[:, :22], np.random.default_rng(5)
    noise = 0.015 * coloured(clean.shape, 0.8 if kind == "coloured" else 0.0, rng)
    if kind == "bursts":
        noise *= np.repeat(rng.random(len(clean) // 5 + 1) < 0.3, 5)[: len(clean), None, None] * 1.8
    if kind == "uneven":  # as of joints that no limb's length tells of
        noise[:, [CANONICAL_JOINTS.index(name) for name in ("head", "left_foot", "right_foot")]] *= 3.0
    noisy = clean + noise

    def error_mps(joints: np.ndarray) -> float:
        return float(np.sqrt((np.gradient(joints - clean, 1 / rate_hz, axis=0) ** 2).sum(-1).mean()))

    points = {name: noisy[:, i] for i, name in enumerate(CANONICAL_JOINTS)}
    found, _, _ = denoised(points, noise_power(points), rate_hz)
    plain = [
        error_mps(np.stack([low_pass(track, cutoff, rate_hz) for track in noisy.swapaxes(0, 1)], axis=1))
        for cutoff in CUTOFFS_HZ
        if cutoff < 0.45 * rate_hz
    ]
    after = error_mps(np.stack(list(found.values()), axis=1))
    assert after < (1.06 if kind == "uneven" else 1.02) * min(plain)  # noise of single joints is measured by few frames
    assert after < 0.97 * error_mps(noisy)


def test_a_noisy_file_is_smoothed_and_told(tmp_path: Path) -> None:
    motion = clip("walk", 20.0)
    noisy = motion.joints[:, :22] + np.random.default_rng(3).normal(0, 0.012, (len(motion.joints), 22, 3))
    np.savez(tmp_path / "a.npz", joints=noisy, names=np.array(CANONICAL_JOINTS), fps=20, up="z")
    with pytest.warns(
        T2DWarning, match=r"noise of \d+\.\d mm at 20 Hz leaves too much after smoothing: joint speeds err by about"
    ):
        found = load_motion(tmp_path / "a.npz")
    assert re.search(r"\(from bone lengths\) smoothed at (1|1\.4|2) to", found.report)
    errors = [np.linalg.norm(each - motion.joints[:, :22], axis=-1) for each in (noisy, found.joints)]
    shift = np.median(found.joints - motion.joints[:, :22], axis=(0, 1))
    errors[1] = np.linalg.norm(found.joints - shift - motion.joints[:, :22], axis=-1)
    assert errors[1].mean() < 0.75 * errors[0].mean()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        raw = load_motion(tmp_path / "a.npz", smooth_hz=None)
    assert "not smoothed" in raw.report


def test_clean_positions_stay_as_they_are(tmp_path: Path) -> None:
    motion = clip("jog", 30.0)
    np.savez(tmp_path / "a.npz", joints=motion.joints[:, :22], names=np.array(CANONICAL_JOINTS), fps=30, up="z")
    found = load_motion(tmp_path / "a.npz", smooth_hz=None)
    shift = np.array([0, 0, 1]) * (found.joints - motion.joints[:, :22])[0, 0]
    np.testing.assert_allclose(found.joints - shift, motion.joints[:, :22], atol=1e-9)
