"""Dances of all dancers, and what keeps their phrases sound where they join."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np
import pytest

from t2d_rt.motion import quaternions
from t2d_rt.motion.check.gait import gait_of
from t2d_rt.motion.check.measures import flights_s, tracks
from t2d_rt.motion.contacts import runs, steadying
from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.motion.generate.chain import Piece, from_rotation_vector
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.dances import chances, circling, goes_on_standing, roughness
from t2d_rt.motion.generate.library.individual import MOST_INWARD_RAD, Maker, individual
from t2d_rt.motion.generate.library.moves import jump
from t2d_rt.motion.generate.library.store import RATE_HZ, Segment, shipped
from t2d_rt.motion.generate.made.hands import Anatomy
from t2d_rt.motion.interpolate import minimum_jerk
from t2d_rt.motion.kinematics import INDEX, motion_of
from validation.motions.limits import true_size
from validation.motions.population import spectrum_difference_db

DANCES = [each for each in shipped().segments if each.action == "dance"]


def recording(segment: Segment) -> str:
    return shipped().sources[segment.clip].file


def clip(name: str) -> Piece:
    return edits.aligned(shipped().piece(next(each for each in shipped().segments if each.name == name)))


def test_every_recorded_dance_has_the_same_share() -> None:
    rng = np.random.default_rng(0)
    maker = Maker(shipped(), individual("man", rng), rng)
    of: dict[str, float] = defaultdict(float)
    for segment, share in zip(DANCES, chances(maker, DANCES), strict=True):
        of[recording(segment)] += share
    assert len(of) >= 9
    assert list(of.values()) == pytest.approx([1.0] * len(of))


def test_every_recorded_jump_has_the_same_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a sentence says neither which way nor how fast."""

    class Drawn(Exception):
        """Ends a jump when its first recording is drawn."""

    def drawn(_: Maker, segment: Segment, **__: object) -> Piece:
        raise Drawn(recording(segment))

    monkeypatch.setattr(Maker, "piece", drawn)
    rng = np.random.default_rng(0)
    maker = Maker(shipped(), individual("man", rng), rng)
    found: Counter[str] = Counter()
    for _ in range(700):
        with pytest.raises(Drawn) as name:
            jump(maker, Step(action="jump"), 3.0)
        found[str(name.value)] += 1
    wanted = {
        recording(each) for each in shipped().segments if each.action == "jump" and each.kind in ("forward", "up")
    }
    assert found.keys() == wanted
    even = 700 / len(wanted)
    assert (
        sum((each - even) ** 2 / even for each in found.values()) < 18.5
    )  # chi-squared of 6 degrees of freedom, 0.5 %


def test_recorded_jumps_fall_freely() -> None:
    """Their centre of mass, as far as the floor is 0.4 s away; a figure too large for who was recorded falls with 11.2 m/s^2."""
    flights = {}
    for each in shipped().segments:
        if each.action == "jump":
            piece = shipped().piece(each)
            weights = Anatomy(piece.poses.skeleton).mass_weights
            height = np.einsum("tjk,j->tk", piece.poses.world()[0], weights)[:, 2]
            for start, stop in runs(~piece.planted.any(axis=(1, 2))):
                if stop - start > 0.4 * RATE_HZ:
                    times = np.arange(start + 2, stop - 2) / RATE_HZ
                    flights[each.name, start] = -2 * np.polyfit(times, height[start + 2 : stop - 2], 2)[0]
    assert {name for name, _ in flights} >= {"iclone_002_04_jump_balance.0", "jumping_train_1.0", "jump.0"}
    assert list(flights.values()) == pytest.approx([9.81] * len(flights), rel=0.04)


def test_recordings_of_one_performer_are_brought_to_true_size() -> None:
    motion = motion_of(clip("walking_extra_train_18.1").poses)
    smaller = true_size(motion, "iclone_002_01_walk.bvh")
    np.testing.assert_allclose(smaller.joints, 0.86 * motion.joints)
    assert "0.86 of its size" in smaller.origin[-1]
    assert true_size(motion, "iclone_005_03_modern_dance.bvh") is motion


def test_lively_dances_ship() -> None:
    """Their recordings are short, or not sound as a whole."""
    names = {recording(each) for each in DANCES}
    assert names >= {f"humanoid3d_{name}.txt" for name in ("dance_a", "dance_spin", "spin")}
    assert names >= {f"005_{name}.bvh.gz" for name in ("10", "11", "15", "16")}


@pytest.mark.slow
def test_dances_are_as_lively_as_the_recordings() -> None:
    made = [motion_from_text("a person dances for 5 seconds", seed=seed) for seed in range(6)]
    longest = {recording(each): each for each in sorted(DANCES, key=lambda each: each.duration_s)}
    recorded = [motion_of(shipped().piece(each).poses) for each in longest.values()]
    assert (spectrum_difference_db(made, recorded) > -3).all()  # chosen by duration: 4 to 6 dB below


def test_a_dance_that_ends_early_tells_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.motion.generate.library.dances._continued", lambda whole, _: (whole, np.inf))
    made = motion_from_text("a person dances for 12 seconds", seed=0)
    assert made.duration_s < 11
    assert any("the dance ends early" in each for each in made.origin)


def test_a_foot_goes_on_standing() -> None:
    jump = clip("jumping_train_5.0")
    last = int(np.flatnonzero(~jump.planted.any(axis=(1, 2)))[0]) - 1
    found = goes_on_standing(jump)
    assert (found[last - 20], found[last], found[last - 10]) == (True, False, False)


def test_a_seam_is_rough_where_limbs_meet_or_the_body_hovers() -> None:
    still = clip("walking_extra_train_18.1")
    still = replace(still, planted=np.ones_like(still.planted))
    assert roughness(still) < 1
    local = still.poses.local.copy()
    inward = from_rotation_vector(np.array([-0.5, 0.0, 0.0]))  # the left leg through the right one
    local[:, INDEX["left_hip"]] = quaternions.multiply(inward, local[:, INDEX["left_hip"]])
    crossed = replace(still, poses=replace(still.poses, local=local), planted=np.zeros_like(still.planted))
    assert roughness(crossed) > 1
    long = edits.retimed(still, np.linspace(0, len(still) - 1, 120))
    at = np.arange(120)
    up = 0.12 * minimum_jerk((at - 20) / 20) * minimum_jerk((100 - at) / 20)
    hovering = edits.shifted(long, np.stack([0.7 * at / RATE_HZ, np.zeros(120), up], axis=1))
    assert roughness(replace(hovering, planted=np.zeros_like(long.planted))) > 1
    torn = still.poses.root.copy()
    torn[len(torn) // 2 :, 0] += 0.1
    assert roughness(replace(still, poses=replace(still.poses, root=torn))) > 1


def test_a_dance_goes_round_in_its_steps() -> None:
    piece = clip("walking_extra_train_18.1")
    piece = edits.retimed(piece, np.linspace(0, len(piece) - 1, 240))
    planted = np.ones_like(piece.planted)
    planted[60:120, 0] = planted[120:180, 1] = False
    gone = circling(replace(piece, planted=planted))
    assert gone[0] == 0.0
    assert gone[-1] == 1.0
    assert (np.diff(gone) >= 0).all()
    # Of the smooth turn 79 % lie in the steps; of this one more.
    assert gone[179] - gone[60] > 0.93


def test_a_foot_that_is_off_for_a_moment_does_not_whirl() -> None:
    angle = np.linspace(0, 2, 121)[:, None]
    stands = np.ones(121, dtype=bool)
    stands[60:62] = False
    back = steadying(angle, stands, RATE_HZ)[:, 0]
    assert np.abs(np.diff(back)).max() < 0.03  # between two contacts it would be 0.3 a frame


def test_who_slows_down_from_a_run_to_a_walk_does_not_sink() -> None:
    """A foot that stood in the walk, and that the run carries on, held the body back: the pelvis sank to 0.33 m."""
    for seed in (1, 2):
        hips_m = motion_from_text("a person jogs for 5 seconds and then walks for 4 seconds", seed=seed).joints[:, 0, 2]
        assert hips_m.min() > 0.85 * np.median(hips_m)


def test_runners_swing_their_arms_as_recorded_ones_do() -> None:
    """Recorded persons by 0.09 to 0.19 of the stature, those of most clips by 0.09; a walker's arms took half of it away."""
    swings = [gait_of(tracks(motion_from_text("a person jogs", seed=seed))).arm_swing for seed in range(40, 46)]
    assert 0.11 < np.median(swings) < 0.2
    assert min(swings) > 0.04


def test_walkers_swing_their_arms_in_proportion_to_their_speed() -> None:
    """Seven recorded ones by 0.10 to 0.27 s/m times it."""
    swings = {}
    for speed in ("slowly", "fast"):
        gaits = [gait_of(tracks(motion_from_text(f"a person walks {speed}", seed=seed))) for seed in range(3)]
        assert all(0.07 < each.arm_swing / each.speed_mps < 0.28 for each in gaits)
        swings[speed] = float(np.mean([each.arm_swing for each in gaits]))
    assert swings["fast"] > 1.5 * swings["slowly"]


def test_people_jump_as_often_as_they_like_where_nothing_is_said() -> None:
    counts = [len(flights_s(tracks(motion_from_text("a person jumps", seed=seed)))) for seed in range(12)]
    assert len(set(counts)) >= 3, counts


def test_no_habit_brings_an_arm_into_the_body() -> None:
    habits = [individual("person", np.random.default_rng(seed)).habit for seed in range(60)]
    inward = [
        -sign * each[INDEX[f"{side}_shoulder"], 0] for each in habits for side, sign in (("left", 1), ("right", -1))
    ]
    assert max(inward) == MOST_INWARD_RAD
    assert min(inward) < -2 * MOST_INWARD_RAD
