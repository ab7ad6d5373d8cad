"""Falls by physics: the lead goes over into them without a jump, and they go as measured falls do."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

from builders import MOTIONS, slow_after
from t2d_rt.body import depth_m, skin
from t2d_rt.core.errors import InputError
from t2d_rt.motion import load_motion, place, resample, trim
from t2d_rt.motion.descriptions.slots import Description
from t2d_rt.motion.generate import motion_from_text, understood
from t2d_rt.motion.generate.falls import Fall, FallPlan, plan_of, simulate_fall
from t2d_rt.motion.generate.falls import make as making
from t2d_rt.motion.generate.falls.humanoid import RATE_HZ, anatomy, coordinates, euler, reached, skeleton
from t2d_rt.motion.generate.falls.joining import got_up, lowest_points
from t2d_rt.motion.generate.falls.make import instants
from t2d_rt.motion.generate.falls.measures import missing
from t2d_rt.motion.generate.falls.simulation import Run, simulate
from t2d_rt.motion.vary import mirror
from t2d_rt.types.motion import Breathing, Motion

TYPES = ("slip", "trip", "collapse")


@cache
def walk() -> Motion:
    # Frame 0 is a T-pose.
    walked = trim(load_motion(MOTIONS / "12_01_walk.bvh"), 0.5, 3.5)
    return dataclasses.replace(walked, breathing=Breathing(rate_hz=0.3, depth_m=0.006))


@cache
def fallen(kind: str) -> Fall:
    return simulate_fall(walk(), FallPlan(type=kind, seed=1, rest_s=1.0))


def speeds(motion: Motion) -> np.ndarray:
    return np.diff(motion.joints, axis=0) * motion.rate_hz


@pytest.mark.parametrize("kind", slow_after(1, TYPES))
def test_the_lead_stays_as_it_is_and_goes_over_without_a_jump(kind: str) -> None:
    made = fallen(kind)
    event = round(made.events.event_s * RATE_HZ)
    assert made.motion.rate_hz == 120
    np.testing.assert_array_equal(made.motion.joints[:event], walk().joints[:event])
    np.testing.assert_array_equal(made.motion.rotations[:event], walk().rotations[:event])
    steps = np.linalg.norm(np.diff(speeds(made.motion), axis=0), axis=-1)
    lead = np.linalg.norm(np.diff(speeds(walk()), axis=0), axis=-1).max()
    assert steps[event - 2 : event + 1].max() < lead


@pytest.mark.parametrize("kind", TYPES)
def test_falls_go_as_measured_falls_do(kind: str) -> None:
    made = fallen(kind)
    motion, events, found = made.motion, made.events, made.figures
    impact = round(events.impact_s * RATE_HZ)
    down = -np.gradient(motion.joints[..., 2], 1 / RATE_HZ, axis=0)
    assert 1.2 < down[impact - 12 : impact + 1, 0].max() < 3.0
    assert 1.5 < found.head_mps < 4.5
    assert 0.4 < events.impact_s - events.event_s < 2.5
    assert 0.3 < found.descent_s < 1.2
    assert np.linalg.norm((motion.joints[-1, 0] - motion.joints[impact, 0])[:2]) < 0.5
    assert motion.joints[-1, :, 2].max() < 0.6
    assert missing(found, FallPlan(type=kind)) == 0
    # 8 J are 1 % of the energy of a walking person; what is found beside the work of muscles is the integration's error.
    assert 0 <= found.gain_j < 8
    assert (made.heading == "forward") == (kind == "trip") or kind == "collapse"
    assert max(found.deepest_m) < 0.02


@pytest.mark.slow
def test_the_skin_lies_on_the_floor_and_so_do_pieces() -> None:
    """A foot was 11 cm deep while the person still walked: the lying feet had told what a level sole is."""
    description, left_out = understood("grandmother slips on the wet tiles and lands on her bottom")
    assert left_out == "not understood and left out: wet, tiles"
    motion = motion_from_text(description, seed=12)
    pieces = [motion, trim(motion, 0.5, 5.0), trim(motion, 2.0), resample(motion, 50.0), mirror(place(motion))]
    pieces.append(dataclasses.replace(motion, rate_hz=80.0))  # slowed down
    for piece in pieces:
        for body in ("adult", "old"):
            assert skin(piece, body).at(piece.times_s[::8])[..., 2].min() > -0.02, (piece, body)
    assert depth_m(motion, "old") < 0.05


@pytest.mark.slow
def test_soles_before_a_fall_are_on_the_floor_in_pieces_too() -> None:
    """Of the run before it alone, the right foot was 5.6 cm deep: nobody came down in that piece."""
    description, _ = understood("A young man ran forward, then tripped and tumbled onto the floor.")
    piece = trim(motion_from_text(description, seed=1260), 0.0, 2.0)
    assert depth_m(piece, "man") > 0.05
    assert skin(piece, "man").vertices[..., 2].min() >= -0.02


def test_a_foot_slips_and_a_foot_is_caught() -> None:
    for kind in ("slip", "trip"):
        made = fallen(kind)
        foot = making.prepared(walk(), FallPlan(type=kind, seed=1)).foot
        event = round(made.events.event_s * RATE_HZ)
        ankle = made.motion.joints[:, made.motion.index(f"{foot}_ankle"), :2]
        if kind == "slip":  # a foot that stands, as with a friction of 0.7, moves by 2 cm
            assert np.linalg.norm(ankle[event + 36] - ankle[event]) > 0.1
        else:
            speed = np.linalg.norm(np.diff(ankle, axis=0), axis=1) * RATE_HZ
            assert speed[event + 12 : event + 18].max() < 0.5 * speed[event - 1]


@pytest.mark.parametrize("kind", TYPES)
def test_the_body_comes_to_rest_and_goes_on_breathing_as_before(kind: str) -> None:
    made = fallen(kind)
    rest = round(made.events.rest_s * RATE_HZ)
    assert np.linalg.norm(speeds(made.motion), axis=-1)[rest:].max() < 0.05
    assert made.motion.breathing == walk().breathing is not None


@pytest.mark.parametrize("kind", TYPES)
def test_bones_keep_their_lengths_and_rotations_carry_them(kind: str) -> None:
    made = fallen(kind)
    motion, event = made.motion, round(made.events.event_s * RATE_HZ)
    for name, parent in (("left_knee", "left_hip"), ("right_wrist", "right_elbow"), ("left_ankle", "left_knee")):
        bone = motion.joints[event:, motion.index(name)] - motion.joints[event:, motion.index(parent)]
        length = np.linalg.norm(bone, axis=1)
        assert np.ptp(length) < 0.002
        lead = anatomy(walk()).segments(motion.rotations)[event:, motion.index(parent)]
        own = np.einsum("tji,tj->ti", lead, bone) / length[:, None]
        assert (own @ own[0]).min() > np.cos(np.radians(2))


def test_the_same_seed_gives_the_same_bits_and_another_one_another_fall() -> None:
    again = simulate_fall(walk(), FallPlan(type="trip", seed=1, rest_s=1.0))
    np.testing.assert_array_equal(again.motion.joints, fallen("trip").motion.joints)
    other = simulate_fall(walk(), FallPlan(type="trip", seed=2, rest_s=1.0))
    assert other.events != again.events


@pytest.mark.slow
def test_runs_that_are_given_up_would_not_have_been_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Falls of several attempts, by this and without giving any run up."""
    plans = [FallPlan(type="slip", seed=0), FallPlan(type="collapse", seed=1)]
    frames: dict[str, int] = dict.fromkeys(("shortened", "whole"), 0)

    def counted(name: str, **fixed: object) -> Callable[..., Run]:
        def run(*args: Any, **options: Any) -> Run:
            found = simulate(*args, **(options | fixed))
            frames[name] += len(found.qpos)
            return found

        return run

    monkeypatch.setattr(making, "simulate", counted("shortened"))
    shortened = [simulate_fall(walk(), plan) for plan in plans]
    monkeypatch.setattr(making, "simulate", counted("whole", hopeful=lambda run: True))
    whole = [simulate_fall(walk(), plan) for plan in plans]
    for one, two in zip(shortened, whole, strict=True):
        assert np.array_equal(one.motion.joints, two.motion.joints)
    assert frames["shortened"] < 0.95 * frames["whole"]


def test_the_humanoid_reaches_the_poses_of_the_lead() -> None:
    scenario = making.prepared(walk(), FallPlan(type="collapse", seed=0))
    qpos = coordinates(scenario.body, walk().joints[:, 0], scenario.segments)
    joints = skeleton(qpos[:, :3], reached(scenario.body, qpos), scenario.skeleton.offsets[:22])
    assert np.abs(joints[scenario.frame] - walk().joints[scenario.frame, :22]).max() < 0.01
    import mujoco

    data = mujoco.MjData(scenario.body.model)
    data.qpos[:] = qpos[scenario.frame]
    mujoco.mj_kinematics(scenario.body.model, data)
    np.testing.assert_allclose(data.xpos[scenario.body.bodies], joints[scenario.frame], atol=1e-9)
    data.qpos[:] = scenario.start[0]
    mujoco.mj_forward(scenario.body.model, data)
    assert data.contact.dist.min(initial=0.0) > -1e-6


@pytest.mark.parametrize("axes", ["XYZ", "ZYX", "YZX", "ZXY"])
def test_euler_angles_against_scipy(axes: str) -> None:
    from scipy.spatial.transform import Rotation

    rotations = Rotation.random(20, random_state=3)
    np.testing.assert_allclose(euler(rotations.as_matrix(), axes), rotations.as_euler(axes), atol=1e-9)


def test_heel_strikes_and_swings_alternate() -> None:
    strikes, swings = instants(walk(), "slip"), instants(walk(), "trip")
    assert 3 <= len(strikes) <= 8
    assert all(first[1] != second[1] for first, second in pairwise(strikes))
    assert all(any(side == foot and 0 < strike - swing < 60 for strike, foot in strikes) for swing, side in swings)


def test_getting_up_ends_as_the_recording_does() -> None:
    # The fall played backwards stands for a recorded getup of the same person.
    made = fallen("trip")
    down = trim(made.motion, made.events.event_s, made.events.rest_s)
    getup = dataclasses.replace(down, joints=down.joints[::-1].copy(), rotations=down.rotations[::-1].copy())
    scenario = making.prepared(walk(), FallPlan(type="trip", seed=1))
    lying = scenario.skeleton.anatomy.segments(made.motion.rotations[-1:])[0]
    root, segments = got_up(scenario.body, scenario.skeleton, made.motion.joints[-1, 0], lying, [getup])
    np.testing.assert_allclose(root[0], made.motion.joints[-1, 0], atol=1e-6)
    np.testing.assert_allclose(segments[0], lying, atol=1e-6)
    assert segments[-1, 0, 2, 1] > 0.9
    assert root[-1, 2] > 0.75
    lowest = lowest_points(scenario.body, coordinates(scenario.body, root, segments))
    assert np.ptp(lowest) < 0.04  # bodies bounce a few times a second, and the height is smooth


def test_a_description_becomes_a_plan() -> None:
    said = Description(**{
        "class": "falling", "action": "fall", "type": "slip", "direction": "back", "speed": "fast", "sentence": "a person slips",
        "after": [{"action": "stand_up"}],
    })  # fmt: skip
    plan = plan_of(said, seed=4)
    assert (plan.type, plan.direction, plan.get_up, plan.seed) == ("slip", "back", True, 4)
    assert plan.strength is not None
    assert plan.strength >= 0.65
    walked = Description(**{"class": "walking", "action": "walk", "sentence": "a person walks"})
    with pytest.raises(InputError, match="makes falls, got a description of walk"):
        plan_of(walked)


def test_what_cannot_be_done_is_said() -> None:
    standing = walk()
    still = dataclasses.replace(
        standing, joints=np.repeat(standing.joints[:1], 200, 0), rotations=np.repeat(standing.rotations[:1], 200, 0)
    )
    with pytest.raises(InputError, match="no step in which a foot could slip"):
        simulate_fall(still, FallPlan(type="slip"))
    with pytest.raises(InputError, match="no recorded getup"):
        simulate_fall(walk(), FallPlan(type="slip", get_up=True))
    with pytest.raises(InputError, match="lead of a fall must be longer"):
        simulate_fall(trim(walk(), 0, 0.2), FallPlan(type="collapse"))
    with pytest.raises(InputError, match="after the lead's end"):
        simulate_fall(walk(), FallPlan(type="collapse", time_s=99.0))
    with pytest.raises(InputError, match="type must be one of slip, trip, collapse"):
        FallPlan(type="jump")  # type: ignore[arg-type]


def test_a_fall_that_does_not_come_about_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "ATTEMPTS", 1)
    monkeypatch.setattr(making, "LONGEST_S", 0.2)
    with pytest.raises(InputError, match="did not fall by a slip as real falls go"):
        simulate_fall(walk(), FallPlan(type="slip", seed=1))


def test_without_mujoco_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"pip install -e '.\[falls\]'"):
        simulate_fall(walk(), FallPlan(type="slip"))


@pytest.mark.slow
def test_a_lead_of_a_low_rate_is_resampled() -> None:
    made = simulate_fall(resample(walk(), 30), FallPlan(type="collapse", seed=1, rest_s=0.3))
    assert made.motion.rate_hz == 120
    assert "fall by collapse" in made.motion.origin[-1]
