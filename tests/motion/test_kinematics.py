"""Skeletons in a common rest pose, inverse kinematics of limbs, contacts and planted feet, and the BVH writer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt.core.errors import InputError
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import FOLD, LIMBS, STRETCH, Limb, contacts, plant, reach, runs, soles
from t2d_rt.motion.generate.library.store import shipped
from t2d_rt.motion.kinematics import INDEX, NAMES, Poses, motion_of, poses_of, retargeted
from t2d_rt.motion.write import save_motion
from t2d_rt.types import Motion

WALKS = "walking_train_2", "walking_train_4", "walking_extra_train_19", "007_07", "12_01_walk"
"""Recorded walks, among them those whose knees once swung by 10 m/s when their feet were planted."""

X = np.array([1.0, 0.0, 0.0])


@cache
def walk(clip: str = "walking_train_2") -> Poses:
    store = shipped()
    return store.piece(next(each for each in store.segments if each.clip == clip and each.kind == "steady")).poses


@cache
def recorded() -> Motion:
    return t2d.example("12_01_walk")


def speeds(poses: Poses) -> np.ndarray:
    return np.linalg.norm(np.diff(poses.world()[0], axis=0), axis=-1) * poses.rate_hz


# --- Skeletons and poses ---


def test_poses_give_their_motion_back() -> None:
    again = poses_of(motion_of(walk()))
    np.testing.assert_allclose(again.world()[0], walk().world()[0], atol=1e-6)  # the store's offsets are float32
    assert again.skeleton.leg_m == pytest.approx(walk().skeleton.leg_m, rel=1e-6)


def test_a_recording_is_kept_but_for_the_changes_of_its_bones() -> None:
    motion = recorded()
    again = motion_of(poses_of(motion))
    common = [again.index(name) for name in motion.names]
    error = np.linalg.norm(again.joints[:, common] - motion.joints, axis=-1)
    assert error.max() < 5e-3  # the neck of this recording changes its length
    assert error.mean() < 5e-4


def test_the_rest_pose_stands_and_faces_x() -> None:
    skeleton = walk().skeleton
    rest = np.zeros((1, len(NAMES), 4))
    rest[..., 3] = 1.0
    poses = Poses(skeleton=skeleton, root=skeleton.offsets[:1], local=rest, rate_hz=60.0)
    joints = poses.world()[0][0]
    assert joints[INDEX["left_foot"], 2] == pytest.approx(0.0, abs=0.02)
    assert joints[INDEX["left_foot"], 0] > joints[INDEX["left_ankle"], 0]
    assert joints[INDEX["left_wrist"], 1] > joints[INDEX["left_shoulder"], 1] > 0 > joints[INDEX["right_shoulder"], 1]
    np.testing.assert_allclose(joints[INDEX["left_wrist"], [0, 2]], joints[INDEX["left_shoulder"], [0, 2]], atol=1e-12)


def test_knees_bend_about_their_own_y_axis() -> None:
    poses = walk()
    local = poses.local[:, INDEX["left_knee"]]
    about = np.abs(local[:, :3]).mean(axis=0)
    assert about[1] > 4 * max(about[0], about[2])


def test_a_taller_skeleton_walks_in_longer_steps() -> None:
    taller = retargeted(walk(), walk().skeleton.scaled(1.2))
    np.testing.assert_allclose(taller.world()[0], 1.2 * walk().world()[0], atol=1e-9)


# --- Inverse kinematics ---


@pytest.mark.parametrize("limb", ["left_leg", "right_leg", "left_arm", "right_arm"])
def test_a_limb_reaches_its_target_by_the_law_of_cosines(limb: Limb) -> None:
    poses = walk().part(0, 40)
    upper, middle, end = (INDEX[name] for name in LIMBS[limb])
    joints, rotations = poses.world()
    first, second = poses.skeleton.bone_m(NAMES[middle]), poses.skeleton.bone_m(NAMES[end])
    aim = quaternions.normalise(joints[:, end] - joints[:, upper])
    distance = np.linspace(0.6, 0.97, len(poses)) * (first + second)
    found, short = reach(poses, limb, joints[:, upper] + distance[:, None] * aim)
    points, turned = found.world()
    np.testing.assert_allclose(points[:, end], joints[:, upper] + distance[:, None] * aim, atol=1e-9)
    np.testing.assert_allclose(short, 0.0, atol=1e-12)
    cosine = (
        quaternions.normalise(points[:, upper] - points[:, middle])
        * quaternions.normalise(points[:, end] - points[:, middle])
    ).sum(-1)
    np.testing.assert_allclose(cosine, (first**2 + second**2 - distance**2) / (2 * first * second), atol=1e-9)
    np.testing.assert_allclose(np.abs((turned[:, end] * rotations[:, end]).sum(-1)), 1.0, atol=1e-9)


def test_a_target_out_of_reach_is_told() -> None:
    poses = walk().part(0, 5)
    joints, _ = poses.world()
    hip, length = joints[:, INDEX["left_hip"]], poses.skeleton.bone_m("left_knee") + poses.skeleton.bone_m("left_ankle")
    _, short = reach(poses, "left_leg", hip + [0.0, 0.0, -2.0 * length])
    np.testing.assert_allclose(short, (2.0 - STRETCH) * length, rtol=1e-9)
    _, short = reach(poses, "left_leg", hip - [0.0, 0.0, 0.1 * length])
    np.testing.assert_allclose(short, (FOLD - 0.1) * length, rtol=1e-9)


def test_a_knee_that_is_bent_the_wrong_way_does_not_stay_so() -> None:
    poses = walk().part(0, 3)
    local = poses.local.copy()
    local[:, INDEX["left_knee"]] = quaternions.about_axis(np.array([0.0, 1.0, 0.0]), np.array(-0.15))
    poses = replace(poses, local=local)
    joints, rotations = poses.world()
    hip, ankle = joints[:, INDEX["left_hip"]], joints[:, INDEX["left_ankle"]]
    found, _ = reach(poses, "left_leg", hip + 0.97 * (ankle - hip))
    ahead = quaternions.rotate(rotations[:, INDEX["left_hip"]], X)
    knee = found.joint("left_knee") - 0.5 * (hip + found.joint("left_ankle"))
    assert ((knee * ahead).sum(-1) > 0.05).all()


def test_a_pole_turns_the_knee() -> None:
    poses = walk().part(0, 3)
    joints, _ = poses.world()
    target = joints[:, INDEX["left_hip"]] - [0.0, 0.0, 0.7]
    found, _ = reach(poses, "left_leg", target, pole=np.array([0.0, 1.0, 0.0]))
    aside = found.joint("left_knee") - 0.5 * (joints[:, INDEX["left_hip"]] + target)
    assert (aside[:, 1] > 0.1).all()
    np.testing.assert_allclose(aside[:, 0], 0.0, atol=1e-9)


# --- Contacts ---


@pytest.mark.parametrize("clip", WALKS)
def test_planted_feet_stay_and_the_body_hardly_moves(clip: str) -> None:
    poses = walk(clip)
    planted = contacts(poses)
    found = plant(poses, planted)
    assert slides(found, planted) < 2e-3
    assert np.abs(found.root - poses.root).max() < 0.012
    assert (speeds(found) - speeds(poses)).max() < 0.8  # once 10 m/s at a knee


@pytest.mark.parametrize("factor", [0.75, 1.2])
def test_feet_are_planted_in_a_walk_of_other_strides(factor: float) -> None:
    poses = walk()
    planted = contacts(poses)
    changed = replace(poses, root=poses.root * [factor, factor, 1.0])
    assert slides(changed, planted) > 0.03
    found = plant(changed, planted, floor_m=0.02)
    assert slides(found, planted) < 2e-3
    assert soles(found)[..., 2].min() > 0.02 - 0.012
    assert speeds(found).max() < 1.15 * speeds(poses).max()


def slides(poses: Poses, planted: np.ndarray) -> float:
    """Greatest horizontal distance [m] of a ball from its mean while it alone, or with its heel, stands."""
    points = soles(poses)[..., :2]
    return max(
        float(np.linalg.norm(points[a:b, side, 1] - points[a:b, side, 1].mean(axis=0), axis=-1).max())
        for side in range(2)
        for a, b in runs(planted[:, side, 1])
        if b - a > 6
    )


def test_contacts_are_told_from_swings() -> None:
    planted = contacts(walk()).any(axis=2)
    # A foot stands for 60 % of a stride (Perry and Burnfield 2010), for the last sixth on its toes.
    assert 0.4 < planted.mean() < 0.65
    assert planted.any(axis=1).mean() > 0.8
    steps = [len(runs(planted[:, side])) for side in range(2)]
    assert min(steps) >= 3


def test_where_nothing_stands_nothing_is_planted() -> None:
    found = plant(walk(), np.zeros((len(walk()), 2, 2), dtype=bool), level=False)
    assert np.linalg.norm(found.world()[0] - walk().world()[0], axis=-1).max() < 0.05


# --- The writer ---


def test_a_written_motion_is_read_back(tmp_path: Path) -> None:
    motion = motion_of(walk())
    save_motion(motion, tmp_path / "walk.bvh")
    again = t2d.load_motion(tmp_path / "walk.bvh", smooth_hz=None)
    names = [name for name in again.names if name in motion.names]
    error = (
        again.joints[:, [again.index(each) for each in names]]
        - motion.joints[:, [motion.index(each) for each in names]]
    )
    error -= error[:1, :1]  # the floor is where the reader finds it
    assert np.linalg.norm(error, axis=-1).max() < 1e-4
    assert again.rate_hz == pytest.approx(60.0)
    assert len(again.names) == len(motion.names)


def test_a_file_is_replaced_only_when_asked(tmp_path: Path) -> None:
    motion = motion_of(walk().part(0, 10))
    target = tmp_path / "walk.bvh"
    save_motion(motion, target)
    first = target.read_bytes()
    with pytest.raises(InputError, match="exists already; choose another name"):
        save_motion(motion_of(walk().part(0, 20)), target)
    assert target.read_bytes() == first
    save_motion(motion_of(walk().part(0, 20)), target, overwrite=True)
    assert target.read_bytes() != first
    assert [path.name for path in tmp_path.iterdir()] == ["walk.bvh"]


@pytest.mark.parametrize(
    ("name", "match"), [("walk.txt", "is written as .bvh"), ("none/walk.bvh", "does not exist; create it first")]
)
def test_a_name_that_cannot_be_written_is_refused(tmp_path: Path, name: str, match: str) -> None:
    with pytest.raises(InputError, match=match):
        save_motion(motion_of(walk().part(0, 10)), tmp_path / name)
