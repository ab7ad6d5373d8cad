"""Hips that never move are told, and planted feet give the body its way."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import MOTIONS, WALK, slow_after
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion
from t2d_rt.motion.read.ground import rooted
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion


@cache
def walk() -> Motion:
    return t2d.resample(load_motion(WALK), 30.0)


def points_of(motion: Motion) -> dict[str, np.ndarray]:
    return {name: motion.joints[:, i] for i, name in enumerate(motion.names)}


def without_root(motion: Motion, keep: str) -> Motion:
    """In place with its height, about the hips, or on a treadmill as fast as the person walks."""
    pelvis = motion.joints[:, motion.index("pelvis")]
    way = np.linspace(0, 1, len(pelvis))[:, None] * (pelvis[-1] - pelvis[0])
    moved = {"height": pelvis * [1, 1, 0], "nothing": pelvis, "sway": way * [1, 1, 0]}[keep]
    return replace(motion, joints=motion.joints - moved[:, None])


def tracks_of(points: dict[str, np.ndarray], rate_hz: float) -> Tracks:
    return Tracks(form="a", points=points, rate_hz=rate_hz)


@pytest.mark.parametrize("suffix", [".npz", ".bvh"])
@pytest.mark.parametrize("keep", ["height", "nothing", "sway"])
def test_a_walk_without_root_motion_is_told_and_regained(tmp_path: Path, keep: str, suffix: str) -> None:
    motion, path = without_root(walk(), keep), tmp_path / f"a{suffix}"
    if suffix == ".bvh":
        t2d.save_motion(motion, path)
    else:
        np.savez(path, joints=motion.joints[:, :22], names=np.array(CANONICAL_JOINTS), fps=30.0, up="z")
    with pytest.warns(T2DWarning, match=r"hips never move, and planted feet slide at 0\.[89] m/s .*--motion.root feet"):
        found = load_motion(path)
    assert "hips never move" in found.report
    regained = load_motion(path, root="feet", smooth_hz=None)
    true = walk().joints[:, 0]
    way, expected = (np.linalg.norm((each[-1] - each[0])[:2]) for each in (regained.joints[:, 0], true))
    assert way == pytest.approx(expected, rel=0.1)
    speed = np.linalg.norm(np.gradient(regained.joints[:, regained.index("left_foot")], 1 / 30, axis=0), axis=-1)
    assert np.percentile(speed, 30) < 0.25  # planted
    # The height comes back too where it is lost.
    assert np.std(regained.joints[:, 0, 2] - true[:, 2]) < 0.02
    assert "root motion from planted feet, 0." in regained.report
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kept = load_motion(path, root="file")
    assert np.linalg.norm((kept.joints[-1, 0] - kept.joints[0, 0])[:2]) < 0.3


@pytest.mark.parametrize("sentence", ["a person walks backward", "an old man limps", "a man squats twice"])
def test_other_ways_are_regained(sentence: str) -> None:
    points = points_of(t2d.motion_from_text(sentence, seed=1))
    rate_hz = 30.0
    placed = tracks_of({name: track - points["pelvis"] for name, track in points.items()}, rate_hz)
    with pytest.warns(T2DWarning, match="hips never move"):
        rooted(placed, None)
    found = rooted(placed, "feet").points
    error = (found["pelvis"] - found["pelvis"][0]) - (points["pelvis"] - points["pelvis"][0])
    assert np.abs(error[-1, :2]).max() < 0.1 + 0.1 * np.linalg.norm(points["pelvis"][-1] - points["pelvis"][0])
    assert np.ptp(error[:, 2]) < 0.05


@pytest.mark.parametrize("path", sorted(MOTIONS.glob("*.bvh*")), ids=lambda path: path.name)
def test_recordings_are_not_told(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "never move" not in load_motion(path).report


@pytest.mark.parametrize(
    "sentence",
    slow_after(1, ["someone sits down on a chair and stands up", "a woman squats twice", "a person stretches"]),
)
def test_who_stays_in_place_is_not_told(sentence: str) -> None:
    for seed in (1, 2):
        motion = t2d.motion_from_text(sentence, seed=seed)
        assert not rooted(tracks_of(points_of(motion), motion.rate_hz), None).clauses


def test_pieces_of_a_dance_are_not_told() -> None:
    """Who kicks leans over: the mean axis from feet to hips is no vertical, by which the swinging leg would stand."""
    dance = t2d.resample(t2d.motion_from_text("a person dances", seed=7), 30.0)
    for frames in (15, 30):
        for start in range(0, len(dance.joints) - frames, 4):
            piece = {name: track[start : start + frames] for name, track in points_of(dance).items()}
            assert not rooted(tracks_of(piece, dance.rate_hz), None).clauses, start


def test_a_root_is_the_file_s_or_the_feet_s() -> None:
    with pytest.raises(InputError, match="root must be 'file' or 'feet', got 'hips'"):
        load_motion(WALK, root="hips")  # type: ignore[arg-type]


def test_a_tilted_camera_hides_no_missing_root(tmp_path: Path) -> None:
    """Joints about the hips, as MediaPipe gives them, are often in the camera's axes; what is then planted levels them."""
    motion, path = without_root(walk(), "nothing"), tmp_path / "a.npz"
    turn = Rotation.from_euler("y", 15, degrees=True)
    joints = turn.apply(motion.joints[:, :22].reshape(-1, 3)).reshape(-1, 22, 3)
    np.savez(path, joints=joints, names=np.array(CANONICAL_JOINTS), fps=30.0)
    with pytest.warns(T2DWarning, match="hips never move, and planted feet slide"):
        load_motion(path)
    found = load_motion(path, root="feet", smooth_hz=None)
    assert "turned level" in found.report
    true = walk().joints[:, 0]
    way, expected = (np.linalg.norm((each[-1] - each[0])[:2]) for each in (found.joints[:, 0], true))
    assert way == pytest.approx(expected, rel=0.1)
    assert np.ptp(found.joints[:, 0, 2]) < 0.1
