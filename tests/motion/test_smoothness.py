"""What keeps made motions as smooth as recorded ones, and their feet where they stand: one test for each cause of jerk or skate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from t2d_rt.motion import quaternions
from t2d_rt.motion.check.measures import measure, rate_of, tracks
from t2d_rt.motion.contacts import grown, plant, runs, soles
from t2d_rt.motion.descriptions.grammar import grammar_descriptions
from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.motion.generate.chain import Piece, from_rotation_vector, rotation_vector, swung
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.edits import best_crossing, halted
from t2d_rt.motion.generate.library.moves import quickened, with_manner
from t2d_rt.motion.generate.library.store import RATE_HZ, shipped
from t2d_rt.motion.kinematics import INDEX, Poses, motion_of
from t2d_rt.types import Motion


def clip(name: str) -> Piece:
    return edits.aligned(shipped().piece(next(each for each in shipped().segments if each.name == name)))


def jerk_mps3(poses: Poses, *names: str) -> np.ndarray:
    """Of some joints of both sides (T, J), without the ends."""
    body = tracks(motion_of(poses))
    kept = [body.names.index(f"{side}_{name}") for name in names for side in ("left", "right")]
    return np.linalg.norm(rate_of(rate_of(body.velocity[:, kept])), axis=-1)[3:-3]


def skate_m(poses: Poses) -> float:
    return skate_m_of(motion_of(poses))


def skate_m_of(motion: Motion) -> float:
    return measure(motion).foot_skate_m


@pytest.mark.parametrize("second", ["running_train_1.0", "running_train_3.0", "running_train_5.0"])
def test_a_run_goes_on_in_another_clip_as_smoothly_as_the_clips(second: str) -> None:
    first, after = clip("running_train_5.0"), clip(second)
    seam = best_crossing(first, replace(after, poses=replace(after.poses, skeleton=first.poses.skeleton)))
    assert seam.crosses
    whole, legs = seam.joined(), ("knee", "ankle", "foot", "toe")
    own = max(jerk_mps3(each.poses, *legs).max() for each in (first, after))
    assert jerk_mps3(whole.poses, *legs).max() < 1.05 * own
    assert len(whole.planted) == len(whole)


def test_a_clip_that_hardly_holds_a_stride_goes_on_at_its_ends() -> None:
    slow = clip("walking_extra_train_24.0")
    seam = best_crossing(slow, slow)
    assert not seam.crosses
    assert len(seam.joined()) > len(slow) + 0.5 * RATE_HZ


def test_a_wider_swing_has_no_more_noise() -> None:
    walk = clip("walking_extra_test_6.0").poses
    local = walk.local.copy()
    for name in ("left_shoulder", "right_shoulder", "left_elbow", "right_elbow"):
        local[:, INDEX[name]] = swung(local[:, INDEX[name]], 1.35, RATE_HZ)
    wide = replace(walk, local=local)
    reach = [np.ptp((each.joint("left_wrist") - each.root)[:, 0]) for each in (walk, wide)]
    assert reach[1] > 1.2 * reach[0]
    jerk = [np.sqrt((jerk_mps3(each, "wrist", "hand") ** 2).mean()) for each in (walk, wide)]
    assert jerk[1] < 1.12 * jerk[0]


def test_a_wide_swing_keeps_its_shape() -> None:
    swing = 1.1 * np.sin(2 * np.pi * np.arange(240) / RATE_HZ)
    rotation = from_rotation_vector(swing[:, None] * [0.0, 1.0, 0.0])
    angle = rotation_vector(swung(rotation, 1.3, RATE_HZ))[60:180, 1]
    # What is added is a part of the swing, without harmonics.
    part = angle @ swing[60:180] / (swing[60:180] @ swing[60:180])
    assert 1.03 < part < 1.2
    np.testing.assert_allclose(angle, part * swing[60:180], atol=0.01)


def test_a_jump_at_another_pace_flies_as_long() -> None:
    jump = clip("jumping_train_5.0")
    quick = edits.paced(jump, 1.4)
    flights = [
        [stop - start for start, stop in runs(~each.planted.any(axis=(1, 2))) if stop - start > 6]
        for each in (jump, quick)
    ]
    assert len(quick) < 0.9 * len(jump)
    np.testing.assert_allclose(*flights, atol=2)


@pytest.mark.parametrize("manner", ["angry", "happy", "sad"])
def test_a_manner_changes_the_pace_that_is_not_said(manner: str) -> None:
    walk, rng = clip("walking_extra_train_13.0"), np.random.default_rng(0)
    said = with_manner(walk, Step(action="walk", speed="fast", manner=manner), rng)  # type: ignore[arg-type]
    unsaid = with_manner(walk, Step(action="walk", manner=manner), rng)  # type: ignore[arg-type]
    assert edits.rate_of(said.poses) == pytest.approx(edits.rate_of(walk.poses), rel=0.01)
    assert edits.rate_of(unsaid.poses) != pytest.approx(edits.rate_of(walk.poses), rel=0.05)


def test_what_is_played_faster_has_no_more_noise() -> None:
    walk = clip("walking_extra_train_13.0")
    elbow, times = INDEX["left_elbow"], np.arange(len(walk)) / RATE_HZ
    shaken = walk.poses.local.copy()
    noise = from_rotation_vector(0.02 * np.sin(2 * np.pi * 11.0 * times)[:, None] * [0.0, 1.0, 0.0])
    shaken[:, elbow] = quaternions.multiply(shaken[:, elbow], noise)
    pieces = [
        edits.tempo(replace(walk, poses=replace(walk.poses, local=each)), 1.3) for each in (walk.poses.local, shaken)
    ]
    left = rotation_vector(quaternions.multiply(quaternions.conjugate(pieces[0].poses.local), pieces[1].poses.local))
    assert np.abs(left[10:-10, elbow, 1]).max() < 0.012
    # What moves below 4 Hz stays.
    slow = edits.retimed(walk, np.linspace(0, len(walk) - 1, len(pieces[0])))
    apart = np.linalg.norm(slow.poses.world()[0] - pieces[0].poses.world()[0], axis=-1)
    assert apart[10:-10].mean() < 0.003


def test_a_walk_slows_down_before_it_halts() -> None:
    walk, quiet = clip("walking_extra_train_13.0"), clip("walking_extra_train_18.1")
    stopped = halted(walk, quiet)
    assert len(stopped) > len(walk) + 10
    jerk = [np.sqrt((jerk_mps3(each.poses, "wrist", "ankle", "toe")[-30:] ** 2).mean()) for each in (walk, stopped)]
    assert jerk[1] < 0.5 * jerk[0]


def test_a_standing_foot_gives_way_softly_in_a_turn() -> None:
    walk = clip("walking_extra_train_21.0")
    turned = edits.bent(walk, 0.035 * np.arange(len(walk)))
    for side in ("left", "right"):
        ankle = [each.poses.world()[1][:, INDEX[f"{side}_ankle"]] for each in (walk, turned)]
        twist = rotation_vector(quaternions.multiply(ankle[1], quaternions.conjugate(ankle[0])))[:, 2]
        bend = np.abs(np.diff(np.unwrap(twist), n=2)) * RATE_HZ**2
        for start, stop in runs(walk.planted[:, ("left", "right").index(side)].any(axis=1)):
            assert bend[start + 1 : stop - 3].max(initial=0.0) < 45.0


def test_steps_of_a_turn_are_as_quick_as_it_needs() -> None:
    walk = clip("walking_extra_train_21.0")
    slow, quick = quickened(walk, 0.3, 2.0), quickened(walk, np.pi, 2.5)
    assert len(slow) == len(walk.part(0, round(2.0 * RATE_HZ) + 1))
    assert len(quick) == len(walk.part(0, round(2.5 * RATE_HZ) + 1))
    # In the 2.5 s of half a turn it gets as far as the walk in 4 s.
    np.testing.assert_allclose(quick.poses.root[-1], walk.poses.root[round(4.0 * RATE_HZ)], atol=0.01)


@pytest.mark.parametrize("name", ["walking_extra_train_39.0", "walking_extra_train_44.0"])
def test_a_foot_that_drifts_while_it_stands_is_planted(name: str) -> None:
    walk = clip(name)
    longer = edits.strided(walk, 1.15)
    assert skate_m(longer.poses) > 0.03
    assert skate_m(plant(longer.poses, longer.planted, floor_m=0.0)) < 0.02


def test_a_foot_that_leaves_for_a_jump_is_not_planted() -> None:
    """Feet that leave the floor straight up move over it slowly."""
    rest = clip("walking_extra_train_18.1").poses.part(0, 1)
    times = np.arange(60) / RATE_HZ
    rise = np.maximum(2.0 * (times - 0.5) - 0.5 * 9.81 * (times - 0.5) ** 2, 0.0) * (times > 0.5)
    jump = Poses(
        skeleton=rest.skeleton, root=rest.root + rise[:, None] * [0.0, 0.0, 1.0],
        local=np.repeat(rest.local, 60, axis=0), rate_hz=RATE_HZ,
    )  # fmt: skip
    planted = np.zeros((60, 2, 2), dtype=bool)
    planted[:25] = True
    found = grown(jump, planted)
    height = soles(jump)[..., 2] - soles(jump)[0, ..., 2]
    assert found[:29].all()
    assert not found[height > 0.01].any()


@pytest.mark.parametrize("seed", [0, 27])
def test_a_foot_that_twists_in_pushing_off_is_planted(seed: int) -> None:
    """It is faster than a standing one for a moment, and then rests on its toe."""
    assert skate_m_of(motion_from_text("A person walks for four seconds.", seed=seed)) < 0.02


def test_a_foot_that_swivels_to_another_place_is_not_planted_between() -> None:
    rest = clip("walking_extra_train_18.1").poses.part(0, 1)
    places = {speed: np.clip(np.arange(60) - 28, 0, 4) / RATE_HZ * speed for speed in (0.6, 2.0)}
    planted = np.ones((60, 2, 2), dtype=bool)
    planted[27:34] = False
    for speed, place in places.items():
        moved = Poses(
            skeleton=rest.skeleton, root=rest.root + place[:, None] * [1.0, 0.0, 0.0],
            local=np.repeat(rest.local, 60, axis=0), rate_hz=RATE_HZ,
        )  # fmt: skip
        assert grown(moved, planted).all() == (speed < 1.0)


def test_legs_pass_each_other_in_a_turn_on_the_spot() -> None:
    sentence = "An adult strolls, then jogs clockwise and finally turns around."
    (turned,) = [each for each in grammar_descriptions("running", 50, seed=0) if each.sentence == sentence]
    assert measure(motion_from_text(turned, seed=46)).self_penetration_m < 0.09
