"""Abnormal gaits: each type shows its signs, by measures of the joints alone."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import slow_after
from t2d_rt.core.errors import InputError
from t2d_rt.motion.check.verdict import ONE_S_OWN, Evidence, gait_faults, shipped_limits
from t2d_rt.motion.contacts import contacts, runs, soles
from t2d_rt.motion.descriptions.slots import GAIT_TYPES, GaitType, Side
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.kinematics import INDEX, Poses, motion_of, poses_of
from t2d_rt.motion.vary import step_times_s
from t2d_rt.motion.vary.abnormal import GaitChange, abnormal_walk, along_x, changed_walk, gait_change
from validation.motions.gaits import GAITS, Normal, figures


@pytest.fixture(scope="module")
def walk() -> Poses:
    return along_x(poses_of(t2d.example("walk")))


@pytest.fixture(scope="module")
def gaits(walk: Poses) -> dict[GaitType, Poses]:
    return {each: abnormal_walk(walk, each, severity=0.8, rng=np.random.default_rng(5)) for each in GAIT_TYPES}


def changed(walk: Poses, **fields: object) -> Poses:
    return changed_walk(walk, GaitChange(**fields), np.random.default_rng(0))  # type: ignore[arg-type]


def cadence_hz(poses: Poses) -> float:
    times = step_times_s(motion_of(poses))
    return (len(times) - 1) / float(np.ptp(times))


def travelled_m(poses: Poses) -> float:
    return float(poses.root[-1, 0] - poses.root[0, 0])


def width_m(poses: Poses) -> float:
    """Mean distance of the standing feet across the path."""
    planted = contacts(poses).any(axis=2)
    left, right = (
        poses.joint(f"{side}_ankle")[on, 1].mean() for side, on in zip(("left", "right"), planted.T, strict=True)
    )
    return float(left - right)


def lean_rad(poses: Poses) -> float:
    """Mean forward lean of the line from pelvis to neck."""
    trunk = poses.joint("neck") - poses.joint("pelvis")
    return float(np.arctan2(trunk[:, 0], trunk[:, 2]).mean())


def swing_m(poses: Poses) -> float:
    """Range of the wrists along the path, as seen from the pelvis, mean of both."""
    return float(np.mean([np.ptp(poses.joint(f"{side}_wrist")[:, 0] - poses.root[:, 0]) for side in ("left", "right")]))


def test_nothing_asked_changes_nothing(walk: Poses) -> None:
    same = changed(walk)
    assert len(same) == pytest.approx(len(walk), abs=1)
    moved = np.linalg.norm(same.world()[0][:-1] - walk.world()[0][: len(same) - 1], axis=-1)
    assert np.median(moved) < 0.02  # its floor is where the toes are lowest


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.15])
def test_stride_shortens_the_path_and_not_the_rhythm(walk: Poses, factor: float) -> None:
    found = changed(walk, stride=factor)
    assert travelled_m(found) == pytest.approx(factor * travelled_m(walk), rel=0.02)
    assert cadence_hz(found) == pytest.approx(cadence_hz(walk), rel=0.03)


def test_cadence_changes_the_rhythm_and_not_the_path(walk: Poses) -> None:
    found = changed(walk, cadence=0.8)
    assert cadence_hz(found) == pytest.approx(0.8 * cadence_hz(walk), rel=0.03)
    assert travelled_m(found) == pytest.approx(travelled_m(walk), rel=0.01)


@pytest.mark.parametrize("wanted_m", [0.05, 0.2, 0.3])
def test_feet_stand_as_far_apart_as_asked(walk: Poses, wanted_m: float) -> None:
    assert width_m(changed(walk, step_width_m=wanted_m)) == pytest.approx(wanted_m, abs=0.025)


def test_the_trunk_leans_as_asked(walk: Poses) -> None:
    assert lean_rad(changed(walk, lean_rad=0.3)) - lean_rad(walk) == pytest.approx(0.2, abs=0.08)


def test_every_gait_keeps_its_feet_where_they_stand(gaits: dict[GaitType, Poses]) -> None:
    for name, poses in gaits.items():
        points, planted = soles(poses), contacts(poses)
        for side in range(2):
            for start, stop in runs(planted[:, side, 1]):
                stands = points[start:stop, side, 1, :2]
                assert np.linalg.norm(stands - stands.mean(0), axis=-1).max() < 0.03, name
        assert points[:, :, 1, 2].min() > -0.02, name


def test_no_gait_makes_a_joint_jump(gaits: dict[GaitType, Poses], walk: Poses) -> None:
    recorded = np.linalg.norm(np.diff(walk.world()[0], axis=0), axis=-1).max() * walk.rate_hz
    for name, poses in gaits.items():
        speed = np.linalg.norm(np.diff(poses.world()[0], axis=0), axis=-1).max() * poses.rate_hz
        assert speed < 1.3 * recorded, name


def test_parkinsons_steps_are_short_trunk_stoops_arms_hang(gaits: dict[GaitType, Poses], walk: Poses) -> None:
    found = gaits["parkinsonian"]
    assert travelled_m(found) < 0.7 * travelled_m(walk)
    assert lean_rad(found) - lean_rad(walk) > math.radians(6)
    assert swing_m(found) < 0.6 * swing_m(walk)


def test_festinating_steps_come_faster_and_shorter(gaits: dict[GaitType, Poses]) -> None:
    times = step_times_s(motion_of(gaits["festinating"]))
    assert times[-1] - times[-2] < 0.85 * (times[1] - times[0])


def test_a_freeze_halts_the_walk_for_a_second_and_more(gaits: dict[GaitType, Poses]) -> None:
    poses = gaits["freezing"]
    speed = low_pass(np.gradient(poses.root[:, :1], axis=0), 1.5, poses.rate_hz)[:, 0] * poses.rate_hz
    halted = [(stop - start) / poses.rate_hz for start, stop in runs(speed < 0.1)]
    assert max(halted) > 1.0
    start, stop = max(runs(speed < 0.1), key=lambda run: run[1] - run[0])
    assert np.std(poses.joint("left_knee")[start:stop], axis=0).max() > 0.001  # the knees tremble


def test_halts_grow_from_none_with_the_square_of_the_severity() -> None:
    def halted_s(severity: float) -> float:
        return float(
            np.mean(
                [sum(gait_change("freezing", severity, np.random.default_rng(seed)).freezes_s) for seed in range(20)]
            )
        )

    assert halted_s(0.0) == 0.0
    assert halted_s(1.0) == pytest.approx(5.0, rel=0.05)
    assert halted_s(0.5) == pytest.approx(halted_s(1.0) / 4)


def test_a_waddling_trunk_rolls_over_the_standing_foot(gaits: dict[GaitType, Poses], walk: Poses) -> None:
    def roll_rad(poses: Poses) -> float:
        trunk = poses.joint("neck") - poses.joint("spine1")
        return float(np.ptp(np.percentile(np.arctan2(trunk[:, 1], trunk[:, 2]), [5, 95])))

    assert roll_rad(gaits["waddling"]) > roll_rad(walk) + math.radians(10)
    assert width_m(gaits["waddling"]) > width_m(walk) + 0.05


def test_ataxic_steps_are_wide_and_uneven(walk: Poses) -> None:
    found = [abnormal_walk(walk, "ataxic", severity=0.8, rng=np.random.default_rng(seed)) for seed in range(4)]
    assert min(width_m(each) for each in found) > width_m(walk) + 0.06

    def unevenness(poses: Poses) -> float:
        steps = np.diff(step_times_s(motion_of(poses)))
        return float(np.std(steps) / np.mean(steps))

    assert np.mean([unevenness(each) for each in found]) > unevenness(walk) + 0.03


def test_scissoring_knees_come_together(gaits: dict[GaitType, Poses], walk: Poses) -> None:
    def gap_m(poses: Poses) -> float:
        return float(np.median(poses.joint("left_knee")[:, 1] - poses.joint("right_knee")[:, 1]))

    assert gap_m(gaits["scissor"]) < gap_m(walk) - 0.03


def test_a_dropped_foot_is_lifted_high(gaits: dict[GaitType, Poses], walk: Poses) -> None:
    def highest_m(poses: Poses) -> float:
        return max(float(poses.joint(f"{side}_knee")[:, 2].max()) for side in ("left", "right"))

    assert highest_m(gaits["steppage"]) > highest_m(walk) + 0.05


def test_a_limp_is_longer_on_one_leg(gaits: dict[GaitType, Poses]) -> None:
    planted = contacts(gaits["limping"]).any(axis=2)
    alone = [float((planted[:, side] & ~planted[:, 1 - side]).sum()) for side in range(2)]
    assert max(alone) > 1.12 * min(alone)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("side", ["left", "right"])
def test_the_side_asked_for_is_spared_and_drops_its_foot(walk: Poses, side: Side, seed: int) -> None:
    here = ("left", "right").index(side)
    limp = abnormal_walk(walk, "limping", severity=0.8, rng=np.random.default_rng(seed), side=side)
    planted = contacts(limp).any(axis=2)
    alone = [float((planted[:, each] & ~planted[:, 1 - each]).sum()) for each in range(2)]
    assert alone[here] < 0.9 * alone[1 - here]
    drop = gait_change("steppage", 0.8, np.random.default_rng(seed), side=side).foot_drop_rad
    assert drop[here] > 0.1
    assert drop[1 - here] == 0.0
    with pytest.raises(InputError, match="side must be 'left' or 'right', got 'both'"):
        gait_change("limping", 0.8, np.random.default_rng(seed), side="both")  # type: ignore[arg-type]


def test_severity_and_patients_differ_and_seeds_repeat(walk: Poses) -> None:
    def one(severity: float, seed: int) -> np.ndarray:
        return abnormal_walk(walk, "limping", severity=severity, rng=np.random.default_rng(seed)).root

    assert np.array_equal(one(0.5, 1), one(0.5, 1))
    assert one(0.5, 1).shape != one(0.5, 2).shape
    assert one(0.1, 1)[-1, 0] > one(0.9, 1)[-1, 0] + 0.2


def test_only_a_straight_walk_is_changed(walk: Poses) -> None:
    from dataclasses import replace

    standing = replace(walk, root=walk.root * [0.05, 1, 1])
    with pytest.raises(InputError, match="a straight walk of"):
        changed(standing)
    angle = np.linspace(0, 2.5, len(walk))
    circle = np.column_stack([2 * np.sin(angle), 2 - 2 * np.cos(angle), walk.root[:, 2]])
    with pytest.raises(InputError, match="bend of"):
        changed(replace(walk, root=circle))


def test_unknown_types_and_severities_are_refused(walk: Poses) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="got 'moonwalk'"):
        abnormal_walk(walk, "moonwalk", severity=0.5, rng=rng)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="severity"):
        abnormal_walk(walk, "ataxic", severity=1.5, rng=rng)


def test_the_feet_hang_in_swing_where_they_drop(walk: Poses) -> None:
    def pitch(poses: Poses) -> np.ndarray:
        foot = poses.joint("left_foot") - poses.joint("left_ankle")
        return np.arcsin(foot[:, 2] / np.linalg.norm(foot, axis=-1))

    swing = ~contacts(walk)[:, 0].any(axis=1)
    before, after = (
        pitch(walk)[swing],
        pitch(changed(walk, foot_drop_rad=(0.4, 0.0)))[: len(walk)][swing[: len(walk)][: len(walk)]],
    )
    assert np.median(after) < np.median(before) - 0.15
    assert INDEX["left_foot"]


@pytest.mark.parametrize("type", slow_after(2, GAIT_TYPES))
def test_no_abnormal_gait_passes_for_a_normal_walk(type: GaitType) -> None:
    for seed in (9, 10):
        made = t2d.motion_from_text(GAITS[type].sentence, seed=seed)
        severity = re.search(r"severity (\d\.\d\d)", " ".join(made.origin))
        assert 0.4 <= float(severity[1]) <= 1.0
        assert not t2d.check_motion(made, expected="walking").passed, seed


@pytest.fixture(scope="module")
def normal() -> Normal:
    made = [figures(t2d.motion_from_text("a person walks forward", seed=seed)) for seed in range(8)]
    return Normal([each for each in made if each is not None])


@pytest.mark.parametrize("type", slow_after(2, GAIT_TYPES))
def test_what_physicians_grade_grows_with_severity(type: GaitType, walk: Poses, normal: Normal) -> None:
    def graded(severity: float) -> float:
        made = [abnormal_walk(walk, type, severity=severity, rng=np.random.default_rng(seed)) for seed in range(3)]
        seen = [figures(motion_of(each)) for each in made]
        return float(np.mean([normal.severity(each, GAITS[type].signs) for each in seen if each is not None]))

    grades = [graded(severity) for severity in (0.1, 0.55, 1.0)]
    assert grades == sorted(grades)
    assert grades[2] > 1.25 * grades[0]


def test_one_figure_far_outside_makes_a_walk_abnormal_and_pace_or_carriage_do_not_alone() -> None:
    """Strollers have short steps, anyone may pause, and who stoops does so standing as well; two of them are a gait."""
    limits = shipped_limits()
    middle = {name: (low + high) / 2 for name, (low, high) in limits.gait.items()}
    far = {name: high + 1.5 * (high - low) + 0.2 * (high == low) for name, (low, high) in limits.gait.items()}

    def told(*names: str) -> bool:
        gait: Any = SimpleNamespace(**middle | {name: far[name] for name in names})
        return bool(gait_faults(Evidence(None, gait, limits)))  # type: ignore[arg-type]

    assert not told()
    for name in limits.gait:
        assert told(name) == (name not in ONE_S_OWN), name
    assert told("step_length", "trunk_lean_deg", "knee_lift_deg")
    # A slow pace is one figure, and nobody walks too evenly.
    even = {name: 0.0 for name in limits.gait if name.endswith(("asymmetry", "variation"))}
    gait: Any = SimpleNamespace(**middle | even | {"cadence_per_min": 55.0, "step_length": 0.2})
    assert not gait_faults(Evidence(None, gait, limits))  # type: ignore[arg-type]
