"""The filter: falls told from what is none, what is broken told from what is sound, classes, the command."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import WALK, slow_after, walk
from command_line import Command
from t2d_rt.core.errors import InputError
from t2d_rt.motion import resample, trim
from t2d_rt.motion.check import check_motion, copies, detect_fall, measure, passes
from t2d_rt.motion.check.copies import ALIKE, apart
from t2d_rt.motion.check.measures import RANGES_DEG, spans
from t2d_rt.motion.check.verdict import GAIT_SIGNS, SENTENCES, shipped_limits
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity
from t2d_rt.types import Motion
from t2d_rt.types.motion import CANONICAL_JOINTS
from validation.motions.population import distance_m, diversity, spectrum_difference_db, speed_spectrum

GRAVITY_MPS2 = 9.81

# --- a figure whose shanks, thighs and trunk are inclined in one plane, both sides alike ---

SHANK, THIGH, FOOT_M, ANKLE_M = 0.246, 0.245, 0.13, 0.08
TRUNK = {"spine1": 0.06, "spine2": 0.13, "spine3": 0.19, "neck": 0.31, "head": 0.37}
"""Heights over stature above the hips."""
SIDEWARD = {
    "hip": 0.05, "knee": 0.05, "ankle": 0.05, "foot": 0.05, "collar": 0.03, "shoulder": 0.11, "elbow": 0.13,
    "wrist": 0.13,
}  # fmt: skip


def figure(
    shank: np.ndarray, thigh: np.ndarray, trunk: np.ndarray, *, arm: np.ndarray | float = 0.0, lift: np.ndarray | float = 0.0,
    stature: float = 1.7, rate: float = 60.0, foot: np.ndarray | float = 0.0,
) -> Motion:  # fmt: skip
    """Inclinations forward from the vertical [rad], (T,), of the bones upward from the ankles, which stand at x = 0."""

    def along(angle: np.ndarray | float, length: float) -> np.ndarray:
        full = np.broadcast_to(np.asarray(angle, float), shank.shape)
        return length * stature * np.stack([np.sin(full), 0 * full, np.cos(full)], axis=-1)

    ankle = np.stack([0 * shank, 0 * shank, ANKLE_M + lift + 0 * shank], axis=-1)
    foot_angle = foot + 0 * shank
    ball = ankle + FOOT_M * np.stack([np.cos(foot_angle), 0 * shank, np.sin(foot_angle)], axis=-1) - [0, 0, 0.06]
    knee = ankle + along(shank, SHANK)
    hips = knee + along(thigh, THIGH)
    places = {"ankle": ankle, "foot": ball, "knee": knee, "hip": hips, "pelvis": hips + along(trunk, 0.02)}
    places |= {name: hips + along(trunk, height) for name, height in TRUNK.items()}
    places |= {"collar": hips + along(trunk, 0.28), "shoulder": hips + along(trunk, 0.29)}
    places["elbow"] = places["shoulder"] + along(trunk + np.pi - arm, 0.17)
    places["wrist"] = places["elbow"] + along(trunk + np.pi - arm - 0.1, 0.15)
    joints = []
    for name in CANONICAL_JOINTS:
        side, _, part = name.rpartition("_")
        out = SIDEWARD.get(part, 0.0) * stature * {"left": 1, "right": -1, "": 0}[side]
        joints.append(places[part] + [0.0, out, 0.0])
    return t2d.motion_from_joints(np.stack(joints, axis=1), rate_hz=rate, placed=False)


def times(duration_s: float, rate: float = 60.0) -> np.ndarray:
    return np.arange(round(duration_s * rate) + 1) / rate


def ease(at: np.ndarray, start: float, stop: float) -> np.ndarray:
    """Minimum jerk from 0 to 1."""
    x = np.clip((at - start) / (stop - start), 0, 1)
    return x**3 * (10 - 15 * x + 6 * x * x)


def path(at: np.ndarray, *keys: tuple[float, float]) -> np.ndarray:
    """Degrees at instants, minimum jerk between them, in radians."""
    found = np.full(at.shape, keys[0][1], float)
    for (start, first), (stop, last) in pairwise(keys):
        found += (last - first) * ease(at, start, stop)
    return np.radians(found)


def pendulum(
    at: np.ndarray, start_s: float, *, gravity: float = 0.25, length: float = 1.7, first: float = 0.05
) -> np.ndarray:
    """Inclination [rad] of a rod that topples about its foot under part of gravity, until it lies: th'' = 3 g sin(th) / (2 L)."""
    step, angle, speed, found = 1e-3, first, 0.0, [0.0]
    for _ in np.arange(start_s, at[-1] + step, step):
        speed += step * 1.5 * gravity * GRAVITY_MPS2 * np.sin(angle) / length
        angle = min(angle + step * speed, np.radians(88))
        found.append(angle)
    fine = start_s + step * np.arange(len(found))
    lean = first * ease(at, start_s - 0.8, start_s)
    return np.where(at < start_s, lean, np.interp(at, fine, np.maximum(found, first)))


def topple(
    sign: float = 1.0, *, duration: float = 5.0, gravity: float = 0.25, rate: float = 60.0, stature: float = 1.7
) -> Motion:
    """A stiff body that falls forward (or backward) from standing and lies."""
    at = times(duration, rate)
    angle = sign * pendulum(at, 1.0, gravity=gravity, length=stature)
    return figure(angle, angle, angle, rate=rate, stature=stature, foot=-angle if sign < 0 else 0.0)


def collapse(drop_s: float = 0.7, *, rate: float = 60.0) -> Motion:
    """Knees and hips give, the seat comes down behind the feet, then the back."""
    at = times(4.0, rate)
    fall = np.clip((at - 1.0) / drop_s, 0, 1) ** 2  # of free fall, slower
    back = np.clip((at - 1.0 - 0.6 * drop_s) / (0.8 * drop_s), 0, 1) ** 2
    return figure(
        np.radians(50) * fall, np.radians(-118) * fall, np.radians(20) * fall - np.radians(108) * back, rate=rate
    )


def turned(motion: Motion, degrees: float, axis: int = 2) -> Motion:
    """Turned about an axis through the origin, by default the vertical."""
    turn = Rotation.from_rotvec(degrees * np.eye(3)[axis], degrees=True)
    return replace(motion, joints=turn.apply(motion.joints.reshape(-1, 3)).reshape(motion.joints.shape))


def sideways() -> Motion:
    """A stiff body that falls to its left, by another rotation in each frame."""
    at = times(5.0)
    standing = figure(0 * at, 0 * at, 0 * at)
    angle = pendulum(at, 1.0)
    turns = Rotation.from_euler("x", -angle[:, None]).as_matrix()
    joints = np.einsum("tij,tkj->tki", turns, standing.joints)
    joints[..., 2] += 0.1 * np.sin(angle)[:, None]
    return replace(standing, joints=joints)


def noisy(motion: Motion, sigma_m: float, seed: int = 0) -> Motion:
    noise = np.random.default_rng(seed).normal(0, sigma_m, motion.joints.shape)
    return replace(motion, joints=motion.joints + noise)


# --- falls ---


@pytest.mark.parametrize("rate", [10.0, 24.0, 60.0, 240.0])
@pytest.mark.parametrize("stature", slow_after(1, [1.0, 1.7, 2.0]))
@pytest.mark.parametrize(
    ("sign", "direction", "state"), [(1, "forward", "lying face down"), (-1, "backward", "lying on the back")]
)
def test_falls_at_any_rate_and_stature(rate: float, stature: float, sign: float, direction: str, state: str) -> None:
    found = detect_fall(turned(topple(sign, rate=rate, stature=stature), 77.0))
    assert found.happened, found.reason
    assert (found.direction, found.end_state, found.got_up_s) == (direction, state, None)
    # Energy of a rod of that length: the greatest downward speed of the head's joint is that at the end.
    spin = np.sqrt(3 * 0.25 * GRAVITY_MPS2 / stature * (np.cos(0.05) - np.cos(np.radians(88))))
    head = (SHANK + THIGH + TRUNK["head"]) * stature
    near = 0.2 if rate < 20 else 0.1  # at 10 Hz the stop lies between two frames
    assert found.head_impact_mps == pytest.approx(spin * head, rel=near)
    assert found.pelvis_impact_mps == pytest.approx(spin * (SHANK + THIGH) * stature, rel=near)
    angle = pendulum(times(5.0, 1000.0), 1.0, length=stature)
    assert found.impact_s == pytest.approx(np.argmax(angle >= angle.max()) / 1000, abs=0.05 + 1 / rate)
    assert found.loss_of_balance_s <= found.descent_s < found.impact_s  # type: ignore[operator]
    assert found.descent_time_s == pytest.approx(found.impact_s - found.descent_s)  # type: ignore[operator]


@pytest.mark.parametrize("seed", range(4))
def test_slight_noise_hides_no_fall_and_makes_none(seed: int) -> None:
    assert detect_fall(noisy(topple(), 0.01, seed)).happened
    assert not detect_fall(noisy(walk(), 0.01, seed)).happened


def test_collapses_and_falls_to_the_side_are_falls() -> None:
    found = detect_fall(collapse())
    assert found.happened, found.reason
    assert found.end_state == "lying on the back"
    side = detect_fall(turned(sideways(), -130.0))
    assert side.happened, side.reason
    assert (side.direction, side.end_state) == ("left", "lying on the side")


def test_a_fall_onto_the_knees_is_one_and_kneeling_down_is_none() -> None:
    at = times(4.0)
    fast, slow = (figure(*(path(at, (1.0, 0), (1.0 + long, angle)) for angle in (92, -4, 0))) for long in (0.5, 1.6))
    found = detect_fall(fast)
    assert found.happened, found.reason
    assert found.end_state == "kneeling"
    assert not detect_fall(slow).happened
    assert "controlled" in detect_fall(slow).reason


def test_a_fall_that_the_record_ends_in_is_one() -> None:
    motion = topple(-1.0, gravity=0.5)
    found = detect_fall(motion)
    just_down = detect_fall(trim(motion, 0, found.impact_s + 0.1))
    assert just_down.happened
    falling = detect_fall(trim(motion, 0, found.impact_s - 0.1))
    assert falling.happened, falling.reason
    assert falling.end_state == "falling"
    assert "record ends" in falling.reason
    assert not detect_fall(trim(motion, 0, found.descent_s + 0.15)).happened  # type: ignore[operator]


def test_getting_up_after_a_fall_does_not_undo_it() -> None:
    at = times(10.0)
    angle = np.where(at < 5.0, pendulum(at, 1.0), np.radians(88) * (1 - ease(at, 5.5, 8.5)))
    found = detect_fall(figure(angle, angle, angle))
    assert found.happened, found.reason
    assert 7.0 < found.got_up_s < 8.5
    getting_up = detect_fall(trim(figure(angle, angle, angle), 4.5, 10.0))
    assert not getting_up.happened


def lying_down(duration_s: float) -> Motion:
    at = times(duration_s + 2.5)
    half, end = 1 + 0.6 * duration_s, 1 + duration_s
    shank = path(at, (1.0, 0), (half, 15))
    thigh = path(at, (1.0, 0), (half, -100))
    return figure(shank, thigh, path(at, (1.0, 0), (half, 20), (end, -88)))


def sitting(seat_deg: float = -80.0) -> Motion:
    at = times(4.0)
    return figure(path(at, (1, 0), (2.2, 5)), path(at, (1, 0), (2.2, seat_deg)), path(at, (1, 0), (1.6, 35), (2.4, 5)))


def squat() -> Motion:
    at = times(4.0)
    keys = [(1.0, 0.0), (1.8, 1.0), (2.2, 1.0), (3.0, 0.0)]
    shank, thigh, trunk = (path(at, *((when, size * angle) for when, size in keys)) for angle in (35, -100, 45))
    return figure(shank, thigh, trunk)


def bend() -> Motion:
    at = times(4.0)
    thigh, trunk = (path(at, (1, 0), (1.7, angle), (2.5, angle), (3.2, 0)) for angle in (-15, 95))
    return figure(0 * at, thigh, trunk)


def jump() -> Motion:
    """Down, a flight of 0.5 s, a deep landing, up."""
    at = times(4.0)
    crouch = ease(at, 0.5, 1.0) - ease(at, 1.0, 1.25) + ease(at, 1.7, 1.95) - ease(at, 2.1, 2.8)
    flight = np.clip((at - 1.25) * (1.75 - at), 0, None) * GRAVITY_MPS2 / 2
    return figure(np.radians(40) * crouch, np.radians(-95) * crouch, np.radians(60) * crouch, lift=flight)


def roll() -> Motion:
    """From standing over the back and up again: the trunk goes once over."""
    at = times(5.0)
    low = ease(at, 1.0, 1.5) - ease(at, 2.4, 2.9)
    trunk = path(at, (1.0, 0), (1.5, 90), (2.4, 300), (2.9, 360))
    return figure(np.radians(45) * low, np.radians(-135) * low, trunk)


@pytest.mark.parametrize(
    "motion",
    [lying_down(2.0), lying_down(3.0), sitting(), squat(), bend(), jump(), roll(), figure(*[0 * times(2.0)] * 3), walk()],
    ids=["lie down in 2 s", "lie down in 3 s", "sit", "squat", "bend", "jump", "roll", "stand", "walk"],
)  # fmt: skip
def test_what_is_no_fall(motion: Motion) -> None:
    for seen in (motion, turned(motion, 140.0), noisy(resample(motion, 20.0), 0.004)):
        found = detect_fall(seen)
        assert not found.happened, found.reason
        assert (found.impact_s, found.direction, found.end_state, found.descent_time_s) == (None, None, None, None)


def test_a_roll_is_told_from_a_fall_by_the_trunk_that_goes_over() -> None:
    assert "a roll" in detect_fall(roll()).reason


# --- measures ---


def test_a_recorded_walk_is_sound() -> None:
    verdict = check_motion(walk(), expected="walking")
    assert verdict.passed, verdict.reasons
    assert str(verdict) == "passed"
    assert measure(walk()).foot_skate_m < 0.04


@pytest.mark.parametrize("rate", [20.0, 60.0, 240.0])
def test_figures_do_not_hang_on_the_frame_rate(rate: float) -> None:
    at_rate, own = measure(resample(walk(), rate)), measure(walk())
    assert at_rate.top_speed_mps == pytest.approx(own.top_speed_mps, rel=0.05)
    assert at_rate.jerk_mps3 == pytest.approx(own.jerk_mps3, rel=0.3)
    assert at_rate.foot_skate_m == pytest.approx(own.foot_skate_m, abs=0.015)
    assert check_motion(resample(walk(), rate)).passed


def shifted(motion: Motion, by: np.ndarray) -> Motion:
    return replace(motion, joints=motion.joints + by)


def reason(motion: Motion) -> str:
    return str(check_motion(motion))


def test_feet_that_slide_are_told_slow_and_fast() -> None:
    gone = walk().times_s[:, None, None]
    assert "slides by" in reason(shifted(walk(), 0.4 * gone * [0, 1, 0]))
    assert "feet slide" in reason(shifted(walk(), 2.0 * gone * [0, 1, 0]))


def test_floor_and_flight() -> None:
    assert "deep in the floor" in reason(shifted(walk(), np.array([0, 0, -0.08])))
    assert "above the floor" in reason(shifted(walk(), np.array([0, 0, 0.25])))
    at = times(4.0)
    crouch = ease(at, 0.5, 1.0) - ease(at, 1.0, 1.25)
    pose = np.radians(40) * crouch, np.radians(-95) * crouch, np.radians(60) * crouch
    hover = ease(at, 1.25, 1.5) - ease(at, 2.5, 2.75)
    sway = 0.15 * np.sin(8 * at)  # nothing stands still in the air
    floating = figure(*pose, lift=0.4 * hover)
    floating = shifted(floating, (sway * hover)[:, None, None] * np.array([1, 0, 0]))
    assert measure(floating).floating_s > 0.5
    assert measure(jump()).floating_s < 0.1
    assert "longer than it could fly" in reason(floating)


def test_frames_out_of_place_are_told_and_scale_with_the_rate() -> None:
    joints = walk().joints.copy()
    joints[200:] += [0.1, 0, 0]
    assert "jumps by" in reason(replace(walk(), joints=joints))
    limits = [shipped_limits().jump_m(rate) for rate in (10, 30, 60, 120, 240, 500)]
    assert (np.diff(limits[:-1]) < 0).all()
    assert limits[-2] == limits[-1]


def test_noise_is_jerk() -> None:
    assert "jerk" in reason(noisy(walk(), 0.02))


def test_bones_keep_their_length() -> None:
    joints = walk().joints.copy()
    wrist = walk().index("left_wrist")
    elbow = walk().index("left_elbow")
    stretch = 1 + 0.3 * ease(walk().times_s, 1.0, 2.0)[:, None]
    joints[:, wrist] = joints[:, elbow] + stretch * (joints[:, wrist] - joints[:, elbow])
    assert "bone's length" in reason(replace(walk(), joints=joints))


def test_swapped_sides_and_inverted_bodies_are_told() -> None:
    other = {name: name.replace("left", "x").replace("right", "left").replace("x", "right") for name in walk().names}
    swapped = [walk().index(other[name]) for name in walk().names]
    assert "swapped" in reason(replace(walk(), joints=walk().joints[:, swapped]))
    assert "swapped" in reason(replace(walk(), joints=walk().joints * [1, -1, 1]))
    assert "upside down" in reason(replace(walk(), joints=walk().joints * [1, -1, -1] + [0, 0, 1.8]))


def test_a_body_that_lies_with_its_feet_up_is_not_upside_down() -> None:
    at = times(3.0)
    lies = figure(path(at, (0, -70), (3, -75)), path(at, (0, -110), (3, -120)), path(at, (0, -91), (3, -93)))
    hips, head, ankles = (lies.joints[:, lies.index(name), 2] for name in ("left_hip", "head", "left_ankle"))
    raised = replace(lies, joints=lies.joints.copy())
    raised.joints[:, [lies.index(f"{side}_ankle") for side in ("left", "right")], 2] += (hips - ankles + 0.1)[:, None]
    assert (head < hips).all()
    assert measure(raised).upside_down_fraction == 0


def test_short_and_motionless_ones_are_told() -> None:
    assert "lasts 0.50 s" in reason(trim(walk(), 0, 0.5))
    assert "0.000 m/s, at least 0.02 m/s are needed" in reason(figure(*[0 * times(2.0)] * 3))


def test_joints_have_ranges() -> None:
    at = times(3.0)
    forward = figure(path(at, (0.5, 0), (1.5, -30)), path(at, (0.5, 0), (1.5, 10)), 0 * at)
    assert measure(forward).angles_deg["knee_hyperextension_deg"] == pytest.approx(40, abs=1)
    assert "knee hyperextension reaches 40 degrees" in reason(forward)
    assert measure(squat()).angles_deg["knee_hyperextension_deg"] < 0.1
    assert measure(squat()).angles_deg["knee_flexion_deg"] == pytest.approx(135, abs=1)
    assert measure(bend()).angles_deg["hip_flexion_deg"] == pytest.approx(110, abs=1)
    back = figure(0 * at, path(at, (0.5, 0), (1.5, 0)), path(at, (0.5, 0), (1.5, -40)))
    assert measure(back).angles_deg["hip_extension_deg"] == pytest.approx(40, abs=1)
    assert set(measure(back).angles_deg) == set(RANGES_DEG)


def test_limbs_that_go_through_the_body_are_told() -> None:
    at = times(2.0)
    motion = figure(0 * at, 0 * at, 0 * at)
    joints = motion.joints.copy()
    through = ease(at, 0.5, 1.0)[:, None]
    spine = joints[:, motion.index("spine2")]
    for name, height in (("right_elbow", 0.0), ("right_wrist", 0.02)):
        own = motion.index(name)
        joints[:, own] += through * (spine + [0, 0.1 if name == "right_wrist" else -0.15, height] - joints[:, own])
    assert measure(motion).self_penetration_m == 0
    assert measure(replace(motion, joints=joints)).self_penetration_m > 0.08
    assert "into one another" in reason(replace(motion, joints=joints))


def test_the_shipped_limits_come_from_recordings() -> None:
    table = shipped_limits()
    assert table.recordings > 80
    assert table.walks > 50
    assert set(table.at_most) == set(SENTENCES)
    assert set(table.gait) == set(GAIT_SIGNS)
    assert all(value > 0 for value in table.at_most.values())
    assert set(table.by_class) <= set(ACTIVITIES)


def test_spans_join_and_leave_out() -> None:
    active = np.array([1, 1, 0, 1, 0, 0, 0, 1], bool)
    assert spans(active) == [(0, 2), (3, 4), (7, 8)]
    assert spans(active, gap=2) == [(0, 4), (7, 8)]
    assert spans(active, gap=2, least=2) == [(0, 4)]
    assert spans(np.zeros(3, bool)) == []


# --- classes ---


def limping() -> Motion:
    """The walk with a trunk that sways by 15 degrees to either side once a second."""
    joints = walk().joints.copy()
    legs = ("hip", "knee", "ankle", "foot", "toe")
    above = [number for number, name in enumerate(walk().names) if not name.endswith(legs)]
    ahead = joints[-1, 0] - joints[0, 0]
    aside = np.array([-ahead[1], ahead[0], 0.0]) / np.linalg.norm(ahead)
    angle = np.radians(15) * np.sin(2 * np.pi * walk().times_s)
    height = joints[:, above, 2] - joints[:, :1, 2]
    joints[:, above] += (np.tan(angle)[:, None] * height)[..., None] * aside
    return replace(walk(), joints=joints)


CASES: list[tuple[Motion, Activity]] = [
    (walk(), "walking"), (limping(), "abnormal_walking"), (topple(), "falling"), (collapse(), "falling"), (sitting(), "sitting"),
    (lying_down(2.5), "sitting"), (bend(), "bending"), (squat(), "bending"), (jump(), "jumping"),
]  # fmt: skip


@pytest.mark.parametrize("case", slow_after(4, range(len(CASES))))
def test_motions_are_of_their_class_and_of_no_other_gait(case: int) -> None:
    motion, kind = CASES[case]

    def faults(expected: Activity) -> list[str]:
        plain = set(check_motion(motion).reasons)
        return [each for each in check_motion(motion, expected=expected).reasons if each not in plain]

    assert faults(kind) == []
    for other in ("walking", "running", "falling"):
        if other != kind and not (other == "walking" and kind == "abnormal_walking"):
            assert faults(other), other  # type: ignore[arg-type]


def test_a_walk_is_no_other_class() -> None:
    expected = {
        "abnormal_walking": "the gait is a normal one", "running": "steps a minute", "falling": "no fall", "sitting": "never rest",
        "bending": "the trunk bends by", "jumping": "no jump", "dancing": "hanging arms: a walk",
    }  # fmt: skip
    for kind, words in expected.items():
        assert words in str(check_motion(walk(), expected=kind)), kind  # type: ignore[arg-type]
    assert "it should hold no fall" in str(check_motion(topple(), expected="walking"))
    sunk = shifted(walk(), np.array([0.0, 0.0, -0.2]))
    assert [passes(motion, "walking") for motion in (walk(), topple(), sunk)] == [True, False, False]
    for motion in (walk(), topple()):
        assert passes(motion, "falling") == check_motion(motion, expected="falling").passed


def test_classes_have_names() -> None:
    with pytest.raises(InputError, match="expected must be 'walking'"):
        check_motion(walk(), expected="flying")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="motion must be a Motion"):
        check_motion("walk.bvh")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="motion must be a Motion"):
        detect_fall(None)  # type: ignore[arg-type]


# --- populations ---


def swinging(frequency_hz: float, amplitude_m: float, rate: float = 60.0) -> Motion:
    """Every joint moves along x as a sine."""
    at = times(8.0, rate)
    still = figure(0 * at, 0 * at, 0 * at, rate=rate)
    return shifted(still, (amplitude_m * np.sin(2 * np.pi * frequency_hz * at))[:, None, None] * np.array([1, 0, 0]))


@pytest.mark.parametrize(
    ("frequency", "band", "rate"), [(3.2, 3, 30.0), (3.2, 3, 120.0), (5.0, 4, 60.0), (10.5, 6, 60.0), (10.5, 6, 120.0)]
)
def test_a_sines_power_is_in_its_band(frequency: float, band: int, rate: float) -> None:
    power = speed_spectrum(swinging(frequency, 0.1, rate))
    assert power.sum() == pytest.approx((2 * np.pi * frequency * 0.1) ** 2 / 2, rel=0.12)
    assert power[band] > 0.9 * power.sum()
    twice = spectrum_difference_db([swinging(frequency, 0.2, rate)], [swinging(frequency, 0.1, rate)])
    assert twice[band] == pytest.approx(20 * np.log10(2), abs=0.01)


def test_distances_do_not_hang_on_place_heading_or_rate() -> None:
    other = shifted(turned(resample(walk(), 30.0), 60.0), np.array([3.0, -2.0, 0.0]))
    assert distance_m(walk(), other) < 0.02
    slow = figure(*[0 * times(2.0)] * 3)
    raised = figure(*[0 * times(2.0)] * 3, lift=0.3)
    assert distance_m(slow, raised) == pytest.approx(0.3)
    found = diversity([slow, raised, figure(*[0 * times(2.0)] * 3, lift=0.4)])
    assert (found.median_m, found.least_m) == (pytest.approx(0.3), pytest.approx(0.1))


# --- the command ---


def test_the_command_judges_files(run: Command, tmp_path: Path) -> None:
    done = run("check-motion", str(WALK))
    assert (done.code, done.out) == (0, f"{WALK}: passed\n")
    text = WALK.read_text()
    broken = tmp_path / "broken.bvh"
    head, _, frames = text.partition("Frame Time")
    rows = frames.splitlines()
    for row in range(200, len(rows)):  # a step of half a metre to the side
        first, _, rest = rows[row].partition(" ")
        rows[row] = f"{float(first) + 10} {rest}"
    broken.write_text(head + "Frame Time" + "\n".join(rows) + "\n")
    both = run("check-motion", str(WALK), str(broken), "--strict")
    assert both.code == 1
    assert f"{broken}: refused\n" in both.out
    assert "a joint accelerates by" in both.out
    assert both.out.endswith("1 of 2 pass\n")
    assert run("check-motion", str(broken)).code == 0
    asked = run("check-motion", str(WALK), "--class", "falling")
    assert (asked.code, "no fall is in it" in asked.out) == (0, True)


def test_the_command_tells_skin_below_the_floor(run: Command) -> None:
    """The joints of this run are on the floor, its soles are not: the file's lowest joint is a toe's middle."""
    done = run("check-motion", str(WALK.with_name("iclone_002_03_run_jog.bvh.gz")))
    assert re.search(r"  skin: body adult reaches [89]\.\d cm below the floor at z = 0\n", done.out)


def test_the_command_writes_a_sheet_or_nothing(run: Command, tmp_path: Path) -> None:
    sheet = tmp_path / "sheet.png"
    assert run("check-motion", str(WALK), "--sheet", str(sheet)).code == 0
    assert sheet.read_bytes()[:4] == b"\x89PNG"
    again = run("check-motion", str(WALK), "--sheet", str(sheet))
    assert (again.code, again.out) == (2, "")
    other = tmp_path / "other.png"
    bad = tmp_path / "bad.bvh"
    bad.write_text("HIERARCHY nonsense")
    for words in ([str(bad)], [str(WALK), "--body", "giant"], [str(tmp_path / "none.bvh")]):
        done = run("check-motion", *words, "--sheet", str(other))
        assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), words
    for words in ([], [str(WALK), "--class", "flying"], [str(WALK), "--sheet", "sheet.txt"]):
        assert run("check-motion", *words).code == 2, words
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bad.bvh", "sheet.png", "walk.bvh"]


def test_the_command_goes_on_after_a_file_that_it_cannot_read(run: Command, tmp_path: Path) -> None:
    bad = tmp_path / "bad.bvh"
    bad.write_text("HIERARCHY nonsense")
    sheet = tmp_path / "sheet.png"
    done = run("check-motion", str(tmp_path / "none.bvh"), str(WALK), str(bad), "--sheet", str(sheet), "--strict")
    assert (done.code, done.out) == (2, f"{WALK}: passed\nwrote {sheet}\n")
    assert ["none.bvh" in done.err.splitlines()[0], "bad.bvh" in done.err.splitlines()[1]] == [True, True]
    assert done.err.count("\n") == 2
    assert sheet.is_file()


@pytest.mark.slow
def test_a_fall_on_a_landing_is_found_and_a_climb_is_none() -> None:
    pytest.importorskip("mujoco")
    fallen = t2d.motion_from_text("a person walks up the stairs and falls forward", seed=2)
    assert fallen.joints[-1, :, 2].min() > 0.4
    assert detect_fall(fallen).happened
    assert not detect_fall(t2d.motion_from_text("a person walks up the stairs", seed=2)).happened


def test_the_command_tells_what_rate_was_assumed(run: Command, tmp_path: Path) -> None:
    motion = t2d.example("walk")
    np.savez(tmp_path / "a.npz", joints=motion.joints, names=np.array(motion.names))
    assert "  30 Hz assumed, the file does not say\n" in run("check-motion", str(tmp_path / "a.npz")).out
    assert "assumed" not in run("check-motion", str(WALK)).out


def test_raised_and_busy_arms_make_a_dance() -> None:
    """Not hanging ones that move, nor raised ones that are held, nor those of one who stands: a stretch."""

    def reasons(rise_m: float, turns_hz: float, expected: Activity, *, stands: bool = False) -> list[str]:
        found = walk()
        if stands:
            found = replace(found, joints=np.repeat(found.joints[:1], len(found.joints), axis=0))
        joints, angle = found.joints.copy(), 2 * np.pi * turns_hz * found.times_s
        for side in ("left", "right"):
            elbow = joints[:, found.index(f"{side}_shoulder")] + [0.05, 0.05, rise_m]
            joints[:, found.index(f"{side}_elbow")] = elbow
            round_it = 0.15 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
            joints[:, found.index(f"{side}_wrist")] = elbow + round_it
        told = check_motion(replace(found, joints=joints), expected=expected).reasons
        return [each for each in told if "elbows are raised" in each]

    assert len(reasons(0.0, 1.0, "walking")) == len(reasons(0.0, 1.0, "bending")) == 1
    assert not reasons(0.0, 1.0, "dancing") + reasons(0.0, 1.0, "sitting")
    assert not reasons(-0.28, 1.0, "walking") + reasons(0.0, 0.1, "walking")
    assert not reasons(0.0, 1.0, "bending", stands=True)


def test_another_class_is_told_by_what_carries_the_body() -> None:
    """A seat, a flight: bends passed as sitting where they are held low, sits and jumps as bending."""
    assert any("carries the body" in each for each in check_motion(sitting(), expected="bending").reasons)
    assert "it is a jump" in check_motion(jump(), expected="bending").reasons


def course(instants: np.ndarray, size: float) -> np.ndarray:
    """Postures (T, 22, 3) that go to and fro, each joint in its own way."""
    rng = np.random.default_rng(3)
    sizes, rates = size * rng.standard_normal((3, 22, 3)), rng.uniform(0.01, 0.06, 3)
    return (np.sin(2 * np.pi * instants[:, None] * rates) @ sizes.reshape(3, -1)).reshape(-1, 22, 3)


@pytest.mark.parametrize(("lag", "count"), [(10.0, 32), (15.0, 48), (18.0, 56)])
def test_copies_that_share_just_enough_are_compared_without_a_warning(lag: float, count: int) -> None:
    """A pace at which too little of them is shared was searched from."""
    first, second = course(np.arange(count), 0.08), course(lag + 1.03 * np.arange(count), 0.08)
    assert apart(first, second) < 0.5  # warnings are errors


def test_copies_are_found_between_compared_paces_and_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = course(np.arange(120), 0.08), course(12.5 + 1.015 * np.arange(100), 0.08)
    assert apart(first, second) < 0.1 * ALIKE
    monkeypatch.setitem(apart.__globals__, "NEAR", 0.0)  # without the finer search
    assert apart(first, second) > ALIKE


def test_what_repeats_another_motion_is_told(run: Command, tmp_path: Path) -> None:
    """In a mirror, begun later, a little faster, elsewhere and under noise of millimetres; two people who bend are two."""
    bend, other = (t2d.motion_from_text("a person bends down", seed=seed) for seed in (0, 1))
    again = t2d.trim(t2d.mirror(bend), 0.4, bend.duration_s)
    noise = 0.003 * np.random.default_rng(0).standard_normal(again.joints.shape)
    elsewhere = again.joints[..., [1, 0, 2]] * [-1, 1, 1] + noise + [2, 1, 0]
    again = replace(again, joints=elsewhere, rate_hz=1.02 * again.rate_hz)
    assert copies([bend, other, again]) == [(0, 2)]
    assert copies([other]) == []
    paths = [str(tmp_path / f"{name}.bvh") for name in ("first", "second")]
    for path in paths:
        t2d.save_motion(bend, path)
    done = run("check-motion", *paths, "--strict")
    assert "second.bvh: refused\n  it repeats" in done.out
    assert "second.bvh: passed" not in done.out
    assert "1 of 2 pass" in done.out
    assert done.code == 1
