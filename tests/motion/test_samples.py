"""Samples that a file lacks, holds or repeats, and joints that jump: bridged and told, or told; sound motion stays as it is."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from builders import slow_after
from command_line import Command
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion
from t2d_rt.motion.check import check_motion
from t2d_rt.motion.jumps import JOINT_LIMIT, deviations, jumps
from t2d_rt.motion.read import samples
from t2d_rt.motion.read.samples import seen
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import Motion
from validation.robustness.corruptions import CORRUPTIONS, noisy, outcome
from validation.robustness.motion_tables import FORMS, clean

NAMES = ("left_hip", "right_hip", "left_shoulder", "right_shoulder", "left_wrist")


def body(frames: int = 60, rate_hz: float = 60.0, speed_mps: float = 1.2) -> np.ndarray:
    """Five joints (T, 5, 3) that go along x, the last one swinging by 0.2 m at 1 Hz."""
    times = np.arange(frames) / rate_hz
    rest = np.array([[0, 0.1, 0.9], [0, -0.1, 0.9], [0, 0.2, 1.4], [0, -0.2, 1.4], [0, 0.3, 0.8]])
    joints = rest + speed_mps * times[:, None, None] * np.array([1.0, 0.0, 0.0])
    joints[:, 4, 0] += 0.2 * np.sin(2 * np.pi * times)
    return joints


def points(joints: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(NAMES, np.moveaxis(joints, 1, 0), strict=True))


# --- jumps ---


def test_even_movement_and_sudden_stops_deviate_by_nothing() -> None:
    """Of the step of a joint that stops within a frame the segment between its neighbours holds all."""
    track = np.concatenate([np.arange(10.0), np.full(10, 9.0)])[:, None, None] * np.array([1.0, 2.0, 0.5])
    assert deviations(track).max() < 1e-12
    track[10:] += 3.0
    assert deviations(track)[8] == pytest.approx(np.linalg.norm([2.0, 1.0, 2.5]))  # less the step before


@pytest.mark.parametrize(
    ("rate_hz", "over"),
    [(10, 1), (20, 1), (30, 1), (60, 1), (120, 1), (20, 2), (60, 2), (30, 3), (60, 3), (120, 3), (60, 6), (120, 12)],
)
def test_a_jump_is_found_once_at_any_rate(rate_hz: float, over: int) -> None:
    joints = body(80, rate_hz)
    joints[40:] += [0.0, 1.5, 0.0]
    joints[40 : 40 + over - 1] -= [0.0, 1.5, 0.0] * (1 - np.arange(1, over)[:, None, None] / over)
    found = jumps(joints, NAMES, rate_hz)
    assert len(found) == 1
    assert found[0].what == "the whole body"
    assert abs(found[0].time_s * rate_hz - 40) <= max(3, over)
    assert found[0].by_m == pytest.approx(1.5, rel=0.25)
    assert not jumps(body(80, rate_hz), NAMES, rate_hz)


@pytest.mark.parametrize("rate_hz", [10, 30, 120])
def test_a_jump_of_one_joint_is_found_from_its_limit_on(rate_hz: float) -> None:
    limit_m = JOINT_LIMIT[0] + JOINT_LIMIT[1] / rate_hz**2
    for factor in (0.95, 1.05):
        joints = body(80, rate_hz)
        joints[:, 4] = joints[:, 3] - [0.0, 0.2, 0.0]
        joints[40:, 4, 1] += factor * limit_m
        assert [each.joints for each in jumps(joints, NAMES, rate_hz)] == [(NAMES[4],)] * (factor > 1)


def test_noise_is_no_jump() -> None:
    """3 cm in each coordinate, a depth camera's, at 30 Hz: single steps differ by 0.2 m from their neighbours."""
    noise = np.random.default_rng(0).normal(0, 0.03, (600, 5, 3))
    assert not jumps(body(600, 30.0) + noise, NAMES, 30.0)


@pytest.mark.slow
def test_info_simulate_and_check_motion_tell_the_same_jump(tmp_path: Path, run: Command) -> None:
    table = clean("bvh")
    table = replace(table, values=table.values.copy())
    table.root[100:, 0] += 60.0
    path = table.write(tmp_path)
    clause = "the motion jumps: the whole body jumps by 0.60 m at 1.67 s"
    with pytest.warns(T2DWarning, match=clause):
        motion = load_motion(path)
    assert clause in motion.report
    assert clause in str(check_motion(motion))
    for command in (("info",), ("check-motion",), ("simulate", "--method=ellipsoid", "--radar=ci4r", "--stop-s=0.2")):
        ran = run(command[0], str(path), *command[1:])
        assert clause in ran.out + ran.err, command
    # The reader has told it; of arrays simulate tells it.
    told = replace(motion, report="", placed=True)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")  # it aliases, too
        t2d.simulate(t2d.trim(told, 1.5, 1.9), radar="ci4r", method="ellipsoid")
    assert any("the whole body jumps by 0.60 m at 0.17 s" in str(each.message) for each in caught)


# --- not seen ---


@pytest.mark.parametrize("value", [0.0, -1.0, -9999.0, 1e6, np.nan, np.inf])
def test_stand_ins_for_not_seen(value: float) -> None:
    joints = body()
    joints[10:13, 4] = value
    assert np.isnan(seen(joints)[:, :, 0]).nonzero()[0].tolist() == [10, 11, 12]
    joints[20] = value
    assert np.isnan(seen(joints)[20]).all()


def test_the_centre_of_a_body_is_seen() -> None:
    """Files centred on a joint have it at 0, 0, 0 throughout; a walk may begin there."""
    joints = body()
    centred = joints - joints[:, :1]
    np.testing.assert_array_equal(seen(centred), centred)
    centred[30:33] = 0.0
    assert np.isnan(seen(centred)[30:33]).all()
    begins = joints - joints[0, 4]
    np.testing.assert_array_equal(seen(begins), begins)
    root = begins[:, 4:]
    np.testing.assert_array_equal(seen(root), root)


@pytest.mark.parametrize("gap", [1, 5, 15])
def test_gaps_are_bridged_by_splines(gap: int) -> None:
    """A swing of 0.2 m at 1 Hz, over T: 0.2 (2 pi)^4 T^4 / 384 and what the spline's slopes add."""
    joints = body()
    lost = joints.copy()
    lost[30 : 30 + gap, 4] = np.nan
    found = samples.whole(Tracks(form="a", points=points(lost), rate_hz=60.0))
    error = np.linalg.norm(found.points["left_wrist"] - joints[:, 4], axis=-1).max()
    assert error < 2 * 0.2 * (2 * np.pi * (gap + 1) / 60) ** 4 / 384 + 1e-9
    assert f"{gap} missing joint position(s) bridged, up to {gap / 60:.2f} s (left_wrist)" in found.clauses


def test_bones_keep_their_lengths_over_lost_frames(tmp_path: Path) -> None:
    table = clean("bvh")
    lost = replace(table, values=table.values.copy())
    lost.values[60:72] = np.nan
    motion, truth = load_motion(lost.write(tmp_path)), load_motion(clean("bvh").write(tmp_path))
    assert "12 missing frame(s) bridged, up to 0.20 s" in motion.report
    bone = [np.linalg.norm(np.diff(each.joints[:, [4, 7]], axis=1), axis=-1) for each in (motion, truth)]
    np.testing.assert_allclose(*bone, atol=1e-9)
    assert (
        np.linalg.norm(motion.joints - truth.joints, axis=-1).max() < 0.08
    )  # a toe at 3 m/s, 0.6 m of its way bridged


def test_longer_gaps_leave_the_longest_piece(tmp_path: Path) -> None:
    table = clean("npz")
    table = replace(table, values=table.values.copy())
    table.point("left_knee")[60:90] = 0.0
    with pytest.warns(
        T2DWarning, match=r"left_knee is missing for 0.50 s from 1.00 s on.* kept, from 1.50 to 2.83 s"
    ) as told:
        motion = load_motion(table.write(tmp_path))
    assert {each.filename for each in told} == {__file__}  # the user's line
    assert len(motion.joints) == 81
    table.point("left_knee")[:] = 0.0
    with pytest.raises(InputError, match="left_knee is not seen in 171 of 171 frames"):
        load_motion(table.write(tmp_path))


def test_frames_lost_at_the_start_take_no_joint_away(tmp_path: Path) -> None:
    """More than a tenth of them: joints that others stand in for were filled for the whole rest."""
    table = clean("npz")
    whole = load_motion(table.write(tmp_path))
    table = replace(table, values=table.values.copy())
    table.values[:20] = np.nan
    motion = load_motion(table.write(tmp_path))
    assert "first 20 and last 0 frame(s) without all joints cut" in motion.report
    assert "seen too seldom" not in motion.report
    np.testing.assert_allclose(np.diff(motion.joints, axis=0), np.diff(whole.joints[20:], axis=0), atol=1e-4)


# --- held ---


@pytest.mark.parametrize(("held", "lost"), [(1, True), (6, True), (15, True), (16, False)])
def test_held_samples_are_missing(held: int, lost: bool) -> None:
    joints = body(90)
    joints[30 : 31 + held] = joints[30]
    found = samples.whole(Tracks(form="a", points=points(joints), rate_hz=60.0))
    assert any("bridged" in each for each in found.clauses) == lost
    if lost:
        np.testing.assert_allclose(found.points["left_hip"], body(90)[:, 0], atol=1e-9)


def test_longer_holds_of_a_joint_are_told() -> None:
    joints = body(90)
    joints[30:54, 4] = joints[30, 4]
    with pytest.warns(
        T2DWarning, match=r"left_wrist stands still to the last digit for 0\.38 s from 0\.52 s on and then leaps"
    ):
        samples.whole(Tracks(form="a", points=points(joints), rate_hz=60.0))


def test_who_stands_still_is_not_held() -> None:
    """To the last digit, then off with 3 m/s^2, also where only a foot rests."""
    times = np.maximum(0.0, np.arange(90) / 60.0 - 0.5)
    joints = body(90, speed_mps=0.0)
    joints[:, 4] = joints[0, 4]
    joints[..., 0] += 1.5 * times[:, None] ** 2
    joints[70:] = joints[70]
    found = samples.whole(Tracks(form="a", points=points(joints), rate_hz=60.0))
    assert not found.clauses
    np.testing.assert_array_equal(found.points["left_wrist"], joints[:, 4])


@pytest.mark.parametrize(
    ("source_hz", "file_hz"), [(20, 60), (30, 60), (20, 30), (25, 60), (24, 30), (50, 60), (10, 60)]
)
@pytest.mark.parametrize("still", [False, True])
def test_repeated_frames_are_dropped(source_hz: float, file_hz: float, still: bool) -> None:
    source = body(int(4 * source_hz), source_hz)
    if still:
        source[int(2 * source_hz) : int(3 * source_hz)] = source[int(2 * source_hz)]
        source[int(3 * source_hz) :] += source[int(2 * source_hz)] - source[int(3 * source_hz)]
    shown = np.floor(np.arange(int(4 * file_hz)) * source_hz / file_hz + 1e-9).astype(int)
    found = samples.whole(Tracks(form="a", points=points(source[shown]), rate_hz=file_hz))
    assert found.rate_hz == source_hz
    assert abs(len(found.points["left_hip"]) - len(source)) <= (1 if still else 0)
    if not still:
        np.testing.assert_array_equal(found.points["left_hip"], source[:, 0])
    assert "each frame stood" in found.clauses[0]


# --- noise of rotations ---


@pytest.mark.parametrize("form", ["bvh", "amass"])
@pytest.mark.parametrize(
    ("rate_hz", "root_m", "degrees"), [(20, 0.01, 2), (30, 0.003, 1), (60, 0.003, 1), (60, 0.001, 0.3)]
)
def test_noise_of_rotations_is_measured_smoothed_and_told(
    form: str, rate_hz: int, root_m: float, degrees: float, tmp_path: Path
) -> None:
    table = clean(form)
    table = replace(table, values=table.values[:: round(60 / rate_hz)], rate_hz=float(rate_hz))
    truth = load_motion(table.write(tmp_path), smooth_hz=None)
    rough, raw = load_noisy(noisy(root_m, degrees)(table).write(tmp_path))
    found = re.search(r"noise of (\S+) degrees and (\S+) mm .* err by about (\S+) m/s", rough.report)
    assert found
    assert float(found[1]) == pytest.approx(degrees, rel=0.2)
    assert float(found[2]) == pytest.approx(1e3 * root_m, rel=0.25)
    before, after = (
        float(np.sqrt(((np.diff(each.joints - truth.joints, axis=0) * rate_hz) ** 2).sum(axis=-1).mean()))
        for each in (raw, rough)
    )
    assert after < before / 3.5
    assert float(found[3]) == pytest.approx(
        after, rel=0.45
    )  # the truth has noise of its own, and its impacts go with the noise


def load_noisy(path: Path) -> tuple[Motion, Motion]:
    """As it is read, with the warning of what remains, and as it stands."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)
        return load_motion(path), load_motion(path, smooth_hz=None)


def test_who_stands_and_waves_has_still_feet(tmp_path: Path) -> None:
    """SMPL at 30 Hz with 1 degree and 3 mm: feet moved at 0.7 m/s and more, without a word."""
    times = np.arange(120) / 30.0
    table = replace(clean("amass"), values=np.zeros((120, 69)), rate_hz=30.0)
    table.root[:, 2], table.turns[:, 0] = 0.95, np.pi / 2
    table.turns[:, 3 * 16 + 2] = -0.8 + 0.5 * np.sin(2 * np.pi * times)
    motion, raw = load_noisy(noisy(0.003, 1.0)(table).write(tmp_path))
    feet = [np.linalg.norm(np.diff(each.joints[:, [10, 11]], axis=0), axis=-1) * 30.0 for each in (motion, raw)]
    assert feet[0].mean() < 0.1 < 1.0 < feet[1].mean()
    wrist = np.ptp(motion.joints[:, motion.index("left_wrist"), 2])
    assert wrist == pytest.approx(0.341, abs=0.02)  # it goes on waving


def test_flips_of_rotations_are_told_in_all_formats(tmp_path: Path) -> None:
    table = replace(clean("amass"), values=clean("amass").values.copy())
    table.turns[60, 3 * 15 : 3 * 16] += [0.0, np.pi, 0.0]  # the head's
    with pytest.warns(T2DWarning, match="single-frame flips: head turns by 180 degrees for one frame at 1.000 s"):
        assert "single-frame flips: head" in load_motion(table.write(tmp_path)).report


# --- all together ---


@pytest.mark.parametrize("place", slow_after(15, range(len(CORRUPTIONS))), ids=list(CORRUPTIONS))
def test_no_corruption_passes_as_another_motion_without_a_word(place: int) -> None:
    name = list(CORRUPTIONS)[place]
    forms = CORRUPTIONS[name][2]
    found = outcome(forms[place % len(forms)], name)
    assert not found.silent, f"{found.error_mps:.2f} m/s off, said: {found.said}"


@pytest.mark.parametrize("form", FORMS)
def test_clean_files_are_not_told_of(form: str, tmp_path: Path) -> None:
    motion = load_motion(clean(form).write(tmp_path), rate_hz=clean(form).rate_hz)  # warnings are errors
    assert not any(word in motion.report for word in ("bridged", "jumps", "stood", "cut", "seen"))
