"""Gravity by planted feet and balance: what a tilted camera saw is turned level, floors that incline stay."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import MOTIONS, WALK
from t2d_rt.core.errors import T2DWarning
from t2d_rt.motion import load_motion
from t2d_rt.motion.read.ground import ground
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

UP = np.array([0.0, 0.0, 1.0])


@cache
def walk() -> Motion:
    return t2d.resample(load_motion(WALK), 30.0)


def points_of(motion: Motion, turn: Rotation | None = None) -> dict[str, np.ndarray]:
    joints = motion.joints if turn is None else turn.apply(motion.joints.reshape(-1, 3)).reshape(motion.joints.shape)
    return {name: joints[:, i] for i, name in enumerate(motion.names)}


def write(path: Path, motion: Motion, turn: Rotation) -> Path:
    """A file in that a camera tilted by `turn` saw the motion."""
    joints = turn.apply(motion.joints.reshape(-1, 3)).reshape(motion.joints.shape)
    if path.suffix == ".bvh":
        turned = (turn * Rotation.from_quat(motion.rotations.reshape(-1, 4))).as_quat().reshape(motion.rotations.shape)
        t2d.save_motion(
            Motion(
                joints=joints, rotations=turned, rate_hz=motion.rate_hz, names=motion.names, parents=motion.parents,
                placed=False,
            ),
            path,
        )  # fmt: skip
    elif path.suffix == ".npy":  # HumanML3D's order, y up
        np.save(path, joints[:, :22][..., [1, 2, 0]])
    else:
        np.savez(path, joints=joints[:, :22], names=np.array(CANONICAL_JOINTS), fps=motion.rate_hz)
    return path


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".bvh"])
@pytest.mark.parametrize("turn", [("x", 10), ("y", -3), ("y", 25), ("xy", (8, -14))])
def test_a_tilted_camera_is_levelled(tmp_path: Path, suffix: str, turn: tuple[str, object]) -> None:
    motion = walk()
    path = write(tmp_path / f"a{suffix}", motion, Rotation.from_euler(*turn, degrees=True))  # type: ignore[arg-type]
    found = load_motion(path, rate_hz=30.0, smooth_hz=None)
    assert "turned level by" in found.report
    pelvis = found.joints[:, found.index("pelvis"), 2]
    assert np.ptp(pelvis) < 0.08
    assert pelvis.mean() == pytest.approx(motion.joints[:, motion.index("pelvis"), 2].mean(), abs=0.05)
    body = found.joints[:, found.index("head")] - found.joints[:, found.index("pelvis")]
    expected = motion.joints[:, motion.index("head")] - motion.joints[:, motion.index("pelvis")]
    # Seen along its heading, which the tilt may turn, the body leans as it did.
    assert np.degrees(np.arctan2(np.hypot(*body[:, :2].T), body[:, 2])).mean() == pytest.approx(
        np.degrees(np.arctan2(np.hypot(*expected[:, :2].T), expected[:, 2])).mean(), abs=2.0
    )


@pytest.mark.parametrize("slope_deg", [-12.0, 8.0, 30.0])
def test_ramps_stay(tmp_path: Path, slope_deg: float) -> None:
    """On a ramp the feet's places incline and the body does not."""
    motion = walk()
    ahead = motion.joints[-1, 0] - motion.joints[0, 0]
    ahead /= np.linalg.norm(ahead)
    joints = motion.joints.copy()
    joints[..., 2] += np.tan(np.radians(slope_deg)) * (joints @ (ahead * [1, 1, 0]))
    path = tmp_path / "a.npz"
    np.savez(path, joints=joints[:, :22], names=np.array(CANONICAL_JOINTS), fps=30.0, up="z")
    found = load_motion(path, smooth_hz=None)
    assert "the floor inclines" in found.report
    shift = found.joints[0, 0] - joints[0, 0]
    np.testing.assert_allclose(found.joints[:, :22], joints[:, :22] + shift, atol=1e-9)


def test_stairs_stay() -> None:
    motion = walk()
    joints = motion.joints.copy()
    ahead = motion.joints[-1, 0] - motion.joints[0, 0]
    along = motion.joints[:, motion.index("pelvis")] @ (ahead / np.linalg.norm(ahead))
    joints[..., 2] += 0.17 * np.floor((along - along[0]) / 0.6)[:, None]
    found = ground({name: joints[:, i] for i, name in enumerate(motion.names)}, 30.0)
    assert found is None or not found.tilted


@pytest.mark.parametrize("path", sorted(MOTIONS.glob("*.bvh*")), ids=lambda path: path.name)
def test_recordings_are_level(path: Path) -> None:
    motion = load_motion(path)
    assert ground(points_of(motion), motion.rate_hz) is None
    assert "level" not in motion.report


@pytest.mark.parametrize(
    "sentence", ["someone sits down on a chair and stands up", "a woman bends and picks something up"]
)
def test_balance_levels_who_stays_at_one_place(sentence: str) -> None:
    """Whose trunk bends far, and whose weight a chair carries for a while."""
    motion = t2d.motion_from_text(sentence, seed=1)
    assert ground(points_of(motion), motion.rate_hz) is None
    turn = Rotation.from_euler("xy", (9, -8), degrees=True)
    found = ground(points_of(motion, turn), motion.rate_hz)
    assert found.tilted
    assert np.degrees(np.arccos(found.vertical @ turn.apply(UP))) < 2.0


def test_who_lies_is_not_raised() -> None:
    motion = t2d.motion_from_text("a person lies down on the floor", seed=1)
    assert ground(points_of(motion), motion.rate_hz) is None
    lying = t2d.trim(motion, motion.duration_s - 2.0, motion.duration_s)
    assert ground(points_of(lying), motion.rate_hz) is None


def test_the_upward_direction_is_the_user_s(tmp_path: Path) -> None:
    turn = Rotation.from_euler("y", 10, degrees=True)
    path = write(tmp_path / "a.npz", walk(), turn)
    kept = load_motion(path, up="file", smooth_hz=None)
    assert "tilted by 10" in kept.report or "tilted by 11" in kept.report
    with pytest.warns(T2DWarning, match=r"tilted together by 1[01].*leave up \(--motion.up\) out"):
        given = load_motion(path, up="z", smooth_hz=None)
    np.testing.assert_array_equal(given.joints, kept.joints)
    exact = load_motion(path, up=tuple(turn.apply(UP)), smooth_hz=None)
    assert "tilted" not in exact.report
    heights = walk().joints[:, :22, 2]
    np.testing.assert_allclose(exact.joints[:, :22, 2] - exact.joints[0, 0, 2], heights - heights[0, 0], atol=1e-9)
