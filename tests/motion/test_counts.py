"""What a sentence says is in the motion, or said not to be: flights, sits and bends are counted, durations measured, words told."""

from __future__ import annotations

import numpy as np
import pytest

from builders import slow_after
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion.check import check_motion
from t2d_rt.motion.check.measures import flights_s, tracks
from t2d_rt.motion.descriptions import parse_description
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.types.motion import Motion


def dips(height_m: np.ndarray, low: float) -> int:
    """How often a height (T,) goes below `low` of its range from above."""
    below = height_m < height_m.min() + low * np.ptp(height_m)
    return int(np.count_nonzero(below[1:] & ~below[:-1]))


def hips(motion: Motion) -> np.ndarray:
    return motion.joints[:, motion.index("pelvis"), 2]


@pytest.mark.parametrize(
    ("sentence", "count"),
    slow_after(2, [
        ("a man jumps up once", 1),
        ("a man hops on one leg four times", 4),
        ("she takes three hops", 3),
        ("a girl jumps to the left twice", 2),
        ("a boy jumps forward a couple of times and stands still", 2),
        ("a man jumps, then two more times", 3),
    ]),
)  # fmt: skip
def test_jumps_are_as_many_as_the_sentence_says(sentence: str, count: int) -> None:
    for seed in (0, 1):
        assert len(flights_s(tracks(motion_from_text(sentence, seed=seed)))) == count


@pytest.mark.parametrize(
    ("words", "count", "seconds"), [("up five times for 8 seconds", 5, 8.0), ("forward twice for 4 seconds", 2, 4.0)]
)
def test_a_count_of_jumps_that_fits_into_a_duration_is_kept(words: str, count: int, seconds: float) -> None:
    for seed in (1, 3):
        motion = motion_from_text(f"a man jumps {words}", seed=seed)
        assert len(flights_s(tracks(motion))) == count
        assert motion.duration_s == pytest.approx(seconds, rel=0.1)


def test_who_hops_on_one_leg_lands_on_one() -> None:
    motion = motion_from_text("a woman hops on her left leg three times", seed=3)
    start, duration, _ = flights_s(tracks(motion))[1]
    landed = round((start + duration + 0.1) * motion.rate_hz)
    left, right = (motion.joints[landed, motion.index(f"{side}_ankle"), 2] for side in ("left", "right"))
    assert left < 0.12
    assert right > 0.2


@pytest.mark.parametrize(
    ("words", "angle_deg"), slow_after(2, [
        ("around to the right", -180.0), ("left by 180 degrees for 9 s", 180.0), ("180° clockwise", -180.0), ("to the left", 90.0),
        ("left by 270 degrees", 270.0), ("left by 720 degrees", 720.0),
    ]),
)  # fmt: skip
def test_who_turns_on_the_spot_turns_by_the_angle_that_is_said(words: str, angle_deg: float) -> None:
    motion = motion_from_text(f"a person turns {words}", seed=2)
    across = motion.joints[:, motion.index("left_hip")] - motion.joints[:, motion.index("right_hip")]
    heading_deg = np.degrees(np.unwrap(np.arctan2(across[:, 1], across[:, 0])))
    assert heading_deg[-20:].mean() - heading_deg[:20].mean() == pytest.approx(angle_deg, abs=15)
    assert np.ptp(motion.joints[:, motion.index("pelvis"), :2], axis=0).max() < 0.3


@pytest.mark.parametrize(
    ("sentence", "angle_deg", "count"),
    [
        ("a man spins", 360.0, None),
        ("a man spins around to the left", 360.0, None),
        ("a man whirls around twice", 360.0, 2),
        ("a man does a full turn", 360.0, None),
        ("a man spins around by 180 degrees", 180.0, None),
        ("a man makes a half turn to the left", 180.0, None),
        ("a man does a quarter turn to the left", None, None),
    ],
)
def test_who_spins_turns_a_whole_turn(sentence: str, angle_deg: float | None, count: int | None) -> None:
    parsed = parse_description(sentence)
    assert (parsed.description.action, str(parsed)) == ("turn", "")
    assert (parsed.description.angle_deg, parsed.description.count) == (angle_deg, count)


@pytest.mark.parametrize(("words", "reach_m"), [("walks", 0.35), ("runs", 0.65)])
def test_who_walks_or_runs_on_the_spot_gets_nowhere(words: str, reach_m: float) -> None:
    motion = motion_from_text(f"a person {words} on the spot for 6 s", seed=4)
    assert motion.duration_s == pytest.approx(6.0, abs=0.1)
    assert np.ptp(motion.joints[:, motion.index("pelvis"), :2], axis=0).max() < 0.12
    ankles = motion.joints[:, [motion.index("left_ankle"), motion.index("right_ankle")]]
    assert np.ptp(ankles[..., :2], axis=0).max() < reach_m
    assert all(dips(-ankles[:, side, 2], 0.5) >= 4 for side in (0, 1))
    assert check_motion(motion).passed


@pytest.mark.parametrize(
    ("sentence", "ignored"),
    [
        ("walks forward on the spot", ("on the spot",)),
        ("runs on the spot in circles", ("in circles",)),
        ("dances on the spot", ("on the spot",)),
        ("jumps forward on the spot", ("on the spot",)),
        ("jumps in place to the left", ("in place",)),
        ("jumps up on the spot", ()),
        ("jumps clockwise on the spot", ()),
    ],
)
def test_directions_on_the_spot_are_told(sentence: str, ignored: tuple[str, ...]) -> None:
    assert parse_description(sentence).ignored == ignored


def test_turns_without_a_side_are_all_to_the_same_one() -> None:
    for seed in (0, 1, 2):
        notes = [
            each for each in motion_from_text("a person turns 3 times", seed=seed).origin if each.startswith("turned ")
        ]
        assert (len(notes), len(set(notes))) == (3, 1)


@pytest.mark.parametrize(
    ("words", "angle_deg"),
    [
        ("around on the spot to the left by 270 degrees", 270.0),
        ("around to the left", 180.0),
        ("180° clockwise", 180.0),
        ("around by 90 ° to the right", 90.0),
        ("1.5 turns", 540.0),
        ("by one and a half turns to the left", 540.0),
        ("by half a turn", 180.0),
        ("by 1/4 turn", 90.0),
        ("three quarters of a turn", 270.0),
        ("a three-quarter turn", 270.0),
        ("by 1.5 revolutions", 540.0),
        ("by a right angle", 90.0),
        ("by pi/2", 90.0),
        ("by pi radians", 180.0),
        ("by two pi", 360.0),
        ("by 2π", 360.0),
        ("by 3 pi / 4", 135.0),
        ("by 3/4 pi", 135.0),
        ("by 3/2 pi", 270.0),
        ("by half of pi", 90.0),
        ("by pi over two to the left", 90.0),
        ("1,5 turns", 540.0),
        ("by 1,57 rad", np.degrees(1.57)),
        ("by 0,125 turns", 45.0),
        (".5 turns", 180.0),
        ("1½ turns", 540.0),
        ("1 1/2 turns", 540.0),
        ("by one and a quarter turns", 450.0),
        ("by half a radian", np.degrees(0.5)),
        ("by 1.57 rad", np.degrees(1.57)),
        ("by eighty degrees", 80.0),
        ("by two hundred and seventy degrees", 270.0),
        ("by one hundred eighty degrees", 180.0),
    ],
)
def test_angles_are_read_in_any_order(words: str, angle_deg: float) -> None:
    parsed = parse_description(f"a person turns {words}")
    (step,) = parsed.description.steps
    assert (step.angle_deg, step.count, parsed.ignored) == (pytest.approx(angle_deg), None, ())


@pytest.mark.parametrize(
    ("words", "seconds"),
    [
        ("3/4 second", 0.75),
        ("3/4 of a second", 0.75),
        ("1/4 s", 0.25),
        ("\u2154 minutes", 40.0),
        ("2 2/3 minutes", 160.0),
        ("five quarters of a second", 1.25),
        ("1 1/2 seconds", 1.5),
        ("one and a quarter seconds", 1.25),
        ("two and a half minutes", 150.0),
        ("three quarters of a minute", 45.0),
        ("a couple of seconds", 2.0),
    ],
)
def test_parts_of_seconds_are_read(words: str, seconds: float) -> None:
    parsed = parse_description(f"a person walks for {words}")
    assert (parsed.description.steps[0].duration_s, parsed.ignored) == (pytest.approx(seconds), ())


def test_a_comma_is_part_of_a_number() -> None:
    """A decimal comma, or that of thousands; lists of numbers and commas before a space have others."""
    (step,) = parse_description("a person walks for 2,5 seconds").description.steps
    assert step.duration_s == 2.5
    with pytest.raises(InputError, match="got 1000"):
        parse_description("a person jumps 1,000 times")
    for sentence in ("a person jumps 1, 5 times", "a person jumps 1,2,5 times"):
        parsed = parse_description(sentence)
        assert parsed.description.steps[0].count == 5
        assert "1" in parsed.ignored


def test_quarters_are_no_slip_and_powers_of_ten_are_numbers() -> None:
    assert parse_description("a person turns three quarters of a turn").read_as == ()
    assert parse_description("a person turns by 1e2 degrees").description.steps[0].angle_deg == 100
    with pytest.raises(InputError, match="got 1e9 degrees"):
        parse_description("a person turns by 1e9 degrees")


@pytest.mark.parametrize(
    ("words", "count", "angle_deg"),
    [
        ("turns 2 x 90 degrees", 2, 90.0),
        ("turns 90° × 2", 2, 90.0),
        ("does two 360 degree turns", 2, 360.0),
        ("jumps x3", 3, None),
        ("does 3 sets of 5 squats", 15, None),
        ("does two rounds of three squats", 6, None),
        ("does two times three squats", 6, None),
        ("does 3 sets of 10 reps of squats", 30, None),
        ("jumps 2 x 3 x 2 times", 12, None),
        ("does two sets of three 90 degree turns", 6, 90.0),
        ("does a dozen squats", 12, None),
        ("does thirty-five squats", 35, None),
        ("does three slow squats", 3, None),
        ("squats five more times", 5, None),
        ("does two more slow squats", 2, None),
        ("does a couple more squats", 2, None),
        ("does three more sets of 5 squats", 15, None),
        ("makes two more 90 degree turns", 2, 90.0),
        ("climbs 12 stairs", 12, None),
    ],
)
def test_factors_are_counts(words: str, count: int, angle_deg: float | None) -> None:
    parsed = parse_description(f"a person {words}")
    (step,) = parsed.description.steps
    assert (step.count, step.angle_deg, str(parsed)) == (count, angle_deg, "")


@pytest.mark.parametrize(
    ("words", "slots"),
    [
        ("turns 270 degrees and 360 degrees", [{"angle_deg": 270}, {"angle_deg": 360}]),
        ("turns left twice and right once", [{"direction": "left", "count": 2}, {"direction": "right", "count": 1}]),
        ("stands on the left leg, then on the right leg", [{"side": "left"}, {"side": "right"}]),
        ("sits down, waits 3 seconds and stands up", [{"action": "sit", "duration_s": 6}, {"action": "stand_up"}]),
        ("sits down for 3 s and stays seated for 5 s", [{"action": "sit", "duration_s": 8}]),
        ("walks for a minute and ten seconds", [{"duration_s": 70}]),
        ("walks while turning", [{"direction": "counterclockwise"}]),
        ("climbs 12 steps", [{"action": "climb", "count": 12, "object": "stair"}]),
        ("walks two circles", [{"action": "walk", "count": 2, "direction": "counterclockwise"}]),
        ("sits for 2 x 5 s", [{"action": "sit", "count": 2, "duration_s": 10}]),
        ("sits 5 s x 2", [{"action": "sit", "count": 2, "duration_s": 10}]),
        ("sits for 5 s x 2", [{"action": "sit", "count": 2, "duration_s": 10}]),
        ("jump jump jump", [{"action": "jump"}] * 3),
        ("makes three half turns", [{"action": "turn", "count": 3, "angle_deg": 180}]),
        ("walks for a minute and a half", [{"duration_s": 90}]),
        ("walks for 1-1/2 minutes", [{"duration_s": 90}]),
        ("walks for 5 s, then for another 5 s", [{"duration_s": 5}, {"duration_s": 5}]),
        (
            "turns left by 90 degrees, then right by 45",
            [{"direction": "left", "angle_deg": 90}, {"direction": "right", "angle_deg": 45}],
        ),
        ("climbs up three stairs and down two", [{"direction": "up", "count": 3}, {"direction": "down", "count": 2}]),
        (
            "walks 4 s forward, 3 s backward",
            [{"direction": "forward", "duration_s": 4}, {"direction": "back", "duration_s": 3}],
        ),
        (
            "hops on the left foot three times and on the right twice",
            [{"side": "left", "count": 3, "direction": None}, {"side": "right", "count": 2, "direction": None}],
        ),
        (
            "stands on his left leg for 5 s and on his right leg for 10 s",
            [{"side": "left", "duration_s": 5}, {"side": "right", "duration_s": 10}],
        ),
        ("walks, favouring his right leg", [{"type": "limping", "side": "right", "direction": None}]),
        ("walks slowly, then quickly", [{"speed": "slow"}, {"speed": "fast"}]),
        ("leans left, right, then forward", [{"direction": "left"}, {"direction": "right"}, {"direction": "forward"}]),
        ("stretches her arms, then her legs", [{"body_part": "arm"}, {"body_part": "leg"}]),
        ("walks, turning left by 90 degrees", [{"action": "walk"}, {"action": "turn", "angle_deg": 90}]),
        ("dances, spinning clockwise", [{"action": "dance", "direction": "clockwise"}]),
        ("sits for 10 s and gets up", [{"action": "sit", "duration_s": 10}, {"action": "stand_up"}]),
        ("walks three clockwise circles", [{"action": "walk", "direction": "clockwise", "count": 3}]),
        (
            "runs for 10 s to the chair and back",
            [
                {"direction": None, "object": "chair", "duration_s": 10},
                {"direction": "back", "object": None, "duration_s": None},
            ],
        ),
        ("hops, hops", [{"action": "jump"}, {"action": "jump"}]),
        ("hops, then two more times", [{"count": 1}, {"count": 2}]),
        ("hops forward, twice more to the left", [{"direction": "forward"}, {"direction": "left", "count": 2}]),
        ("squats two or three times, then once more", [{"count": 2}, {"count": 1}]),
        ("bows twice, then twice more", [{"count": 2}, {"count": 2}]),
        ("hops and then another two times", [{"count": 1}, {"count": 2}]),
        ("squats three times, then two more", [{"count": 3}, {"count": 2}]),
        ("climbs 3 stairs and then 5 more", [{"count": 3}, {"count": 5}]),
        ("does five squats, another five squats", [{"count": 5}, {"count": 5}]),
        ("turns left by 90 degrees, then again", [{"direction": "left", "angle_deg": 90}] * 2),
        ("bows and bows again", [{"action": "bend"}] * 2),
        ("walks for 5 s, then for 5 more seconds", [{"duration_s": 5}, {"duration_s": 5}]),
        ("jumps for 5 s, then two more times", [{"count": None, "duration_s": 5}, {"count": 2, "duration_s": 10}]),
        ("jumps twice for 6 s, then once more", [{"count": 2, "duration_s": 6}, {"count": 1, "duration_s": 3}]),
        ("stands for 5 s twice and jumps", [{"count": 2, "duration_s": 10}, {"action": "jump"}]),
        ("sits for 5 s, three times, then jumps", [{"count": 3, "duration_s": 15}, {"action": "jump"}]),
        ("sits (for 5 s) twice and jumps", [{"count": 2, "duration_s": 10}, {"action": "jump"}]),
        ("dances for 5 s, two times slowly", [{"count": 2, "duration_s": 10, "speed": "slow"}]),
        ("squats for 60 s, 20 times in total", [{"count": 20, "duration_s": 60}]),
        ("walks for 10 s twice around the chair", [{"count": 2, "duration_s": 10}]),
        (
            "hops on the left leg for 5 s twice and on the right leg three times",
            [{"count": 2, "duration_s": 10}, {"count": 3, "duration_s": 15}],
        ),
        ("squats down and up again, twice", [{"action": "squat", "count": 2}]),
        ("climbs up the stairs and down again twice", [{"direction": "up"}, {"direction": "down", "count": None}]),
        ("stands for 5 s, then again for 5 s, then jumps", [{"action": "stand", "duration_s": 10}, {"action": "jump"}]),
        ("walks for 10 s to a second chair", [{"duration_s": 10, "object": "chair"}]),
        ("waits for 5 s, twice jumping", [{"count": None, "duration_s": 5}, {"action": "jump", "count": 2}]),
        ("sits for 5 s, two jumps", [{"count": None, "duration_s": 5}, {"action": "jump", "count": 2}]),
        ("dances for 3 sets of 10 s", [{"count": 3, "duration_s": 30}]),
        (
            "turns 45 degrees right then another 90 degrees",
            [{"direction": "right", "angle_deg": 45}, {"direction": "right", "angle_deg": 90}],
        ),
        (
            "leans left 3 times and right 2 times",
            [{"direction": "left", "count": 3}, {"direction": "right", "count": 2}],
        ),
        ("limps on the left leg and then the right leg", [{"side": "left"}, {"side": "right"}]),
        ("jumps, again", [{"action": "jump"}] * 2),
        ("jumps twice. Again.", [{"count": 2}] * 2),
        ("squats for 5 s, then three times", [{"count": None, "duration_s": 5}, {"count": 3, "duration_s": None}]),
        ("hops twice, then for 10 s", [{"count": 2, "duration_s": None}, {"count": None, "duration_s": 10}]),
        ("walks for 5 s, then quickly", [{"speed": "normal", "duration_s": 5}, {"speed": "fast"}]),
        ("turns left, then by 180 degrees", [{"angle_deg": None}, {"angle_deg": 180}]),
        ("turns 1/4 turn, 1/2 turn", [{"angle_deg": 90}, {"angle_deg": 180}]),
        ("turns 90 degrees, turning 90 degrees", [{"angle_deg": 90}] * 2),
        ("turns once around", [{"angle_deg": 360, "direction": None}]),
        ("sits down when he has walked", [{"action": "walk"}, {"action": "sit"}]),
        ("walks as soon as he has jumped", [{"action": "jump"}, {"action": "walk"}]),
        ("sits. Before that, he jumps", [{"action": "jump"}, {"action": "sit"}]),
        ("jumps three times with 2 s in between", [{"count": 3, "duration_s": None}]),
        ("jumps with a pause of 2 s", [{"action": "jump", "duration_s": None}]),
        ("jumps with a pause for 2 s", [{"action": "jump", "duration_s": None}]),
        ("jumps twice with a 2 s pause", [{"action": "jump", "duration_s": None}]),
        ("walks. After sitting, he jumps", [{"action": "walk"}, {"action": "sit"}, {"action": "jump"}]),
        ("runs. After running, he sits", [{"action": "run"}, {"action": "sit"}]),
        ("walks. Before sitting, he jumps", [{"action": "walk"}, {"action": "jump"}, {"action": "sit"}]),
        ("falls. Before falling, he walks", [{"action": "walk"}, {"action": "fall"}]),
        (
            "jumps. Before sitting, he turns, then stands up",
            [{"action": each} for each in ("jump", "turn", "sit", "stand_up")],
        ),
        ("walks for 5 s, then with a limp", [{"type": None, "duration_s": 5}, {"type": "limping", "duration_s": 5}]),
        ("bends left, right and forward", [{"direction": "left"}, {"direction": "right"}, {"direction": "forward"}]),
        ("does all squats for 5 s twice", [{"count": 2, "duration_s": 10}]),
        ("makes a total of ten jumps", [{"count": 10}]),
        ("does an extra 3 jumps", [{"count": 3}]),
        ("jumps for a total of 10 s twice", [{"count": 2, "duration_s": 10}]),
        ("jumps for altogether 10 s, twice", [{"count": 2, "duration_s": 10}]),
        (
            "spins 2 turns left and one right",
            [{"direction": "left", "count": 2, "angle_deg": 360}, {"direction": "right", "count": 1, "angle_deg": 360}],
        ),
    ],
)
def test_what_is_said_of_two_times_is_kept(words: str, slots: list[dict[str, object]]) -> None:
    steps = parse_description(f"a person {words}").description.steps
    assert [{name: getattr(step, name) for name in each} for step, each in zip(steps, slots, strict=True)] == slots


def test_a_count_of_several_actions_is_told() -> None:
    for sentence in ("he walks, turns and walks back, three times", "he walks there and back three times"):
        assert parse_description(sentence).partly == ("three times (made of the last action alone)",)


@pytest.mark.parametrize(
    "words",
    [
        *("jumps twice forward, then twice back", "falls to the left and then to the right", "falls over three times"),
        *("walks quickly, then slowly again", "spins twice, then again to the left"),
    ],
)
def test_nothing_is_told_where_all_is_made(words: str) -> None:
    assert not str(parse_description(f"he {words}"))


def test_what_is_done_at_once_is_told_where_it_is_made_in_turn() -> None:
    for sentence in ("he sits while jumping", "while jumping, he sits"):
        assert parse_description(sentence).partly == ("jumping (made in turn, not at the same time)",)
    for sentence in ("he slips while walking", "while walking, he slips and falls", "he is filmed while walking"):
        assert not parse_description(sentence).partly


@pytest.mark.parametrize("words", ["turns NaN degrees", "walks for inf seconds", "jumps nan times"])
def test_numbers_that_are_none_are_refused(words: str) -> None:
    with pytest.raises(InputError, match="numbers of a description are above 0"):
        parse_description(f"a person {words}")


def test_who_turns_for_a_time_turns_all_the_time() -> None:
    motion = motion_from_text("a person turns left for 12 s", seed=2)
    hips = motion.joints[:, motion.index("left_hip")] - motion.joints[:, motion.index("right_hip")]
    heading_rad = np.unwrap(np.arctan2(hips[:, 1], hips[:, 0]))
    assert motion.duration_s == pytest.approx(12, abs=0.2)
    assert heading_rad[-1] - heading_rad[0] > 4 * np.pi


def test_whole_turns_stay_counts() -> None:
    (step,) = parse_description("a person makes two turns").description.steps
    assert (step.count, step.angle_deg) == (2, None)


@pytest.mark.parametrize(
    "words",
    [
        "turns by minus 90 degrees",
        "turns by negative ninety degrees",
        "turns minus half a turn",
        "jumps minus two times",
    ],
)
def test_numbers_below_zero_in_words_are_refused(words: str) -> None:
    with pytest.raises(InputError, match=r"numbers of a description are above 0, got (minus|negative) "):
        parse_description(f"a person {words}")


@pytest.mark.parametrize("words", ["left by 0 degrees", "by 5 degrees", "around by 10000°", "by 2.5 turns"])
def test_angles_that_nobody_turns_by_are_refused(words: str) -> None:
    with pytest.raises(InputError, match="turns by 10 to 720 degrees, got "):
        parse_description(f"a person turns {words}")


def test_who_stands_on_one_leg_does_so_for_as_long_as_is_said() -> None:
    motion = motion_from_text("a person stands on her right leg for 6 s", seed=2)
    left, right = (motion.joints[:, motion.index(f"{side}_ankle"), 2] for side in ("left", "right"))
    held_s = np.count_nonzero(left > right + 0.08) / motion.rate_hz
    assert 4.0 < held_s < 6.0
    assert right.max() < 0.15
    assert check_motion(motion, expected="bending").passed
    assert not check_motion(motion, expected="walking").passed


@pytest.mark.parametrize("words", ["lowers himself to the floor", "lies down on the floor carefully"])
def test_who_lets_himself_down_to_the_floor_does_not_fall(words: str) -> None:
    """The hips take seconds and stay below the slowest of measured falls, 2.14 - 2 x 0.63 m/s (Choi et al. 2015)."""
    motion = motion_from_text(f"a person {words}", seed=1)
    height_m = hips(motion)
    down = (height_m < 0.95 * height_m.max()) & (height_m > 1.2 * height_m.min())
    assert 1.5 < np.count_nonzero(down) / motion.rate_hz < 6.0
    assert -np.diff(height_m).min() * motion.rate_hz < 0.85
    verdict = check_motion(motion, expected="sitting")
    assert verdict.passed
    assert not verdict.fall.happened
    assert not check_motion(motion, expected="falling").passed


@pytest.mark.parametrize(
    ("sentence", "count"),
    slow_after(
        1,
        [
            ("a man squats three times", 3),
            ("a woman sits down twice", 2),
            ("an old man sits down and stands up three times", 3),
        ],
    ),
)
def test_hips_go_down_as_often_as_the_sentence_says(sentence: str, count: int) -> None:
    assert dips(hips(motion_from_text(sentence, seed=2)), 0.6) == count


def test_the_head_goes_down_as_often_as_the_person_bends() -> None:
    motion = motion_from_text("a person bends down four times", seed=1)
    assert dips(motion.joints[:, motion.index("head"), 2], 0.5) == 4


@pytest.mark.parametrize(
    ("sentence", "seconds"),
    slow_after(3, [
        ("a man walks for eight seconds", 8),
        ("a man limps for seven seconds", 7),
        ("a man jumps for ten seconds", 10),
        ("a woman squats for five seconds", 5),
        ("a woman turns to the left for three seconds", 3),
        ("a man dances for half a minute", 30),
    ]),
)  # fmt: skip
def test_what_lasts_lasts(sentence: str, seconds: float) -> None:
    assert motion_from_text(sentence, seed=1).duration_s == pytest.approx(seconds, rel=0.1)


@pytest.mark.slow
def test_a_walk_before_something_else_lasts_too() -> None:
    for seed in (0, 1, 2):
        motion = motion_from_text("a person walks for six seconds, then sits down", seed=seed)
        assert motion.activities[0] == ("walk", 0.0)
        begin_s = motion.activities[1][1]
        assert 5.4 < begin_s < 6.9
        low = hips(motion) < np.median(hips(motion)[:120]) - 0.15
        assert 0 < np.flatnonzero(low)[0] / motion.rate_hz - begin_s < 4.5  # as long as recorded people take


@pytest.mark.slow
def test_a_fall_begins_when_the_walk_has_lasted() -> None:
    pytest.importorskip("mujoco")
    for sentence, seconds in (
        ("walks for six seconds, then trips", 6.0),
        ("stands for three seconds and collapses", 3.0),
    ):
        motion = motion_from_text(f"a person {sentence}", seed=1)
        (event,) = [each for each in motion.origin if each.startswith("fall by")]
        assert float(event.split("event ")[1].split(" s")[0]) == pytest.approx(seconds, rel=0.1)


@pytest.mark.parametrize(
    ("words", "slot", "value"),
    [
        ("once", "count", 1), ("one time", "count", 1), ("a few times", "count", 3), ("several times", "count", 4),
        ("for half a minute", "duration_s", 30.0),
        ("for about twenty five seconds", "duration_s", 25.0),
        ("for a few seconds", "duration_s", 3.0),
        ("for a minute", "duration_s", 60.0),
    ],
)  # fmt: skip
def test_numbers_in_words(words: str, slot: str, value: float) -> None:
    parsed = parse_description(f"a man squats {words}")
    assert getattr(parsed.description, slot) == value
    assert (parsed.read_as != ()) == ("few" in words or "several" in words)
    assert parsed.ignored == ()


@pytest.mark.parametrize(
    ("words", "slot", "value", "read_as"),
    [
        ("two or three times", "count", 2, ("two or three times", "2 times")),
        ("2-3 times", "count", 2, ("2 to 3 times", "2 times")),
        ("2\u20133 times", "count", 2, ("2 to 3 times", "2 times")),
        ("5 or 10 times", "count", 5, ("5 or 10 times", "5 times")),
        ("5 to 10 times", "count", 7, ("5 to 10 times", "7 times")),
        ("between two and four times", "count", 3, ("between two and four times", "3 times")),
        ("from 20 to twenty four times", "count", 22, ("from 20 to twenty four times", "22 times")),
        ("once or twice", "count", 1, ("once or twice", "1 times")),
        ("twice or maybe three times", "count", 2, ("twice or maybe three times", "2 times")),
        ("three or more times", "count", 3, ("three or more times", "3 times")),
        ("up to three times", "count", 3, ("up to three times", "3 times")),
        ("2/3 times", "count", 2, ("2 / 3 times", "2 times")),
        ("two-three times", "count", 2, ("two to three times", "2 times")),
        ("between 2 times and 4 times", "count", 3, ("between 2 times and 4 times", "3 times")),
        ("between two reps and five times", "count", 3, ("between two reps and five times", "3 times")),
        ("2 times to 4 times", "count", 3, ("2 times to 4 times", "3 times")),
        ("between 5 seconds and 1 minute", "duration_s", 32.5, ("between 5 seconds and 1 minute", "32.5 seconds")),
        ("for 1 minute to 90 seconds", "duration_s", 75.0, ("for 1 minute to 90 seconds", "75 seconds")),
        ("for half a minute to a minute", "duration_s", 45.0, ("for half a minute to a minute", "45 seconds")),
        ("for half a second to a second", "duration_s", 0.75, ("for half a second to a second", "0.75 seconds")),
        ("for 1 min and 5 to 10 s", "duration_s", 67.5, ("for 1 min and 5 to 10 s", "67.5 seconds")),
        ("from 5 s to 1 min", "duration_s", 55.0, ("from 5 s to 1 min", "55 seconds")),
        ("between about 5 s and about 10 sec", "duration_s", 7.5, ("between about 5 s and about 10 sec", "7.5 sec")),
        ("one, two or three times", "count", 1, ("one , two or three times", "1 times")),
        ("10 or 5 times", "count", 5, ("10 or 5 times", "5 times")),
        ("from 5 to 10 s", "duration_s", 5.0, ("from 5 to 10 s", "5 s")),
        ("for a few minutes", "duration_s", 180.0, ("for a few minutes", "3 minutes")),
        ("for 1.5 to 2 s", "duration_s", 1.75, ("for 1.5 to 2 s", "1.75 s")),
        ("for one and a half to 2 s", "duration_s", 1.75, ("for one and a half to 2 s", "1.75 s")),
        ("for 1 1/2 to 4 minutes", "duration_s", 165.0, ("for 1 1 / 2 to 4 minutes", "2.75 minutes")),
        ("for 1 to 1 1/2 s", "duration_s", 1.25, ("for 1 to 1 1 / 2 s", "1.25 s")),
        ("half a minute to two minutes", "duration_s", 75.0, ("half a minute to two minutes", "1.25 minutes")),
        ("for 1 to 2 s", "duration_s", 1.5, ("for 1 to 2 s", "1.5 s")),
        ("from 0 to 10 seconds", "duration_s", 10.0, ("from 0 to 10 seconds", "10 seconds")),
        ("0 to 3 times", "count", 3, ("0 to 3 times", "3 times")),
        ("3 to 3 times", "count", 3, ("3 to 3 times", "3 times")),
        ("2 or 3 tmies", "count", 2, ("2 or 3 tmies", "2 times")),
        ("for one or two minutes", "duration_s", 60.0, ("for one or two minutes", "1 minutes")),
    ],
)
def test_of_a_range_one_number_is_read_and_told(words: str, slot: str, value: float, read_as: tuple[str, str]) -> None:
    parsed = parse_description(f"a man squats {words} and then sits down")
    first, second = parsed.description.before + parsed.description.after, parsed.description
    assert {first[0].action: getattr(first[0], slot), second.action: getattr(second, slot)} == {
        "squat": value,
        "sit": None,
    }
    assert (parsed.read_as, parsed.ignored) == ((read_as,), ())


@pytest.mark.parametrize(
    ("sentence", "slot", "value", "read_as"),
    [
        ("a man does two or three squats", "count", 2, (("two or three", "2"),)),
        ("a man does a few squats", "count", 3, (("a few", "3"),)),
        ("several hops of a girl", "count", 4, (("several", "4"),)),
        ("a man does between 2 jumps and 4 jumps", "count", 3, (("between 2 jumps and 4", "3"),)),
        (
            "a man turns between 45 degrees and half a turn",
            "angle_deg",
            112.5,
            (("between 45 degrees and half a turn", "112.5 degrees"),),
        ),
        (
            "a man turns between half a turn and a full turn",
            "angle_deg",
            270.0,
            (("between half a turn and a full turn", "270 degrees"),),
        ),
        (
            "a man turns from 90 degrees to half a turn",
            "angle_deg",
            90.0,
            (("from 90 degrees to half a turn", "90 degrees"),),
        ),
        ("a man turns by 90-180 degrees", "angle_deg", 135.0, (("90 to 180 degrees", "135 degrees"),)),
        ("a man climbs 10 to 12 stairs", "count", 11, (("10 to 12 stairs", "11 stairs"),)),
        ("a man does one or two turns", "count", 1, (("one or two", "1"),)),
        ("a man makes 1 to 2 turns", "count", 1, (("1 to 2", "1"),)),
        ("a man turns 45-90 degrees", "angle_deg", 67.5, (("45 to 90 degrees", "67.5 degrees"),)),
        ("a man turns from 0 to 90 degrees", "angle_deg", 90.0, (("from 0 to 90 degrees", "90 degrees"),)),
        ("a man turns from 0 to 360 degrees", "angle_deg", 360.0, (("from 0 to 360 degrees", "360 degrees"),)),
        ("a man turns 0° to 90°", "angle_deg", 90.0, (("0 degrees to 90 degrees", "90 degrees"),)),
        ("a man turns from 0° to 90°", "angle_deg", 90.0, (("from 0 degrees to 90 degrees", "90 degrees"),)),
        ("a man turns from 90 to 180 degrees", "angle_deg", 90.0, (("from 90 to 180 degrees", "90 degrees"),)),
        ("a man turns from 180 to 45 degrees", "angle_deg", 135.0, (("from 180 to 45 degrees", "135 degrees"),)),
        ("a man turns between 0 and 90 degrees", "angle_deg", 90.0, (("between 0 and 90 degrees", "90 degrees"),)),
        (
            "a man turns between half a turn and one turn",
            "angle_deg",
            270.0,
            (("between half a turn and one turn", "270 degrees"),),
        ),
        ("a man turns up to 90 degrees", "angle_deg", 90.0, (("up to 90 degrees", "90 degrees"),)),
    ],
)
def test_ranges_of_what_is_done(sentence: str, slot: str, value: float, read_as: tuple[tuple[str, str], ...]) -> None:
    parsed = parse_description(sentence)
    assert (getattr(parsed.description, slot), parsed.read_as, parsed.ignored) == (value, read_as, ())


@pytest.mark.parametrize(
    ("words", "ignored", "count"),
    [
        ("walks two or three steps", ("two or three steps",), None),
        ("walks 2 or 3 metres", ("2 or 3", "metres"), None),
        ("jumps 2-3 times faster", ("2 to 3 times",), None),
        ("jumps twice or 10 seconds", ("or", "10 seconds"), 2),
        ("walks up to two chairs", ("two", "up"), None),
        ("jumps again and again", ("again and again",), None),
        ("jumps some times", ("some times",), None),
        ("takes a few steps", ("a few steps",), None),
        ("bends from 0 to 90 degrees", ("from 0 to 90 degrees",), None),
        ("squats 3 times, 4 or 5 times", ("4 or 5 times",), 3),
        ("climbs two or three times", ("two or three times",), None),
        ("walks without jumpping", ("without", "jumpping"), None),
    ],
)
def test_ranges_that_count_nothing_are_told(words: str, ignored: tuple[str, ...], count: int | None) -> None:
    parsed = parse_description(f"a man {words}")
    assert (parsed.ignored, parsed.description.count, parsed.read_as) == (ignored, count, ())


@pytest.mark.parametrize(
    "sentence",
    [
        "before sitting, a man jumps, then two more times",
        "after jumping, then twice more, he sits",
        "having jumped and then twice more, he sits",
    ],
)
def test_what_is_done_again_comes_before_what_follows(sentence: str) -> None:
    steps = parse_description(sentence).description.steps
    assert [(step.action, step.count) for step in steps] == [("jump", 1), ("jump", 2), ("sit", None)]


def test_a_range_of_what_is_done_twice_is_told() -> None:
    parsed = parse_description("a man squats for 5 to 10 s twice")
    assert (parsed.description.count, parsed.description.duration_s) == (2, 15)
    assert parsed.read_as == (("for 5 to 10 s twice", "2 x 7.5 s"),)


def test_both_ranges_of_a_product_are_told() -> None:
    parsed = parse_description("a man does two to three sets of 3 to 4 squats")
    assert (parsed.description.count, parsed.read_as) == (6, (("two to three sets of 3 to 4", "6"),))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("walks for 5/10 seconds", "5 / 10 seconds"),
        ("walks from 10 to 5 s", "from 10 to 5 s"),
        ("jumps 1 to 2 to 3 times", "1 to 2 to 3 times"),
        ("walks for 5 +/- 1 s", "5 + / - 1 s"),
        ("jumps at 5 s", "at 5 s"),
        ("walks until 10 s", "until 10 s"),
        ("jumps at t = 5 s", "t, = 5 s"),
        ("falls 5 seconds later", "5 seconds later"),
        ("jumps between 2 times and 4", "between 2 times and 4"),
        ("jumps between 2 times and 5 seconds", "between 2 times and 5 seconds"),
        ("walks between 1 minute and 5 seconds", "between 1 minute and 5 seconds"),
        ("walks between 1 minute 30 seconds and 2 minutes", "between 1 minute 30 seconds and 2 minutes"),
        ("squats at least 2 times and at most 4 times", "least, most, 4 times"),
        ("falls, then once more", "once"),
        ("sits down and again", "again"),
        ("sits down, again", "again"),
        ("turns left and left again", "again"),
        ("takes turns jumping and squatting", "takes turns"),
        ("walks, again forward", "again"),
        ("turns 1/4 turn + 1/2 turn", "1 / 2 turn"),
        ("falls and falls again", "falls"),
        ("sits, sits", "sits"),
        ("falls and sits on a chair", "sits"),
        ("jumps over three times", "over"),
        ("walks for over 20 s, then sits", "over"),
        ("jumps another time", "another"),
        ("jumps, a second time", "second"),
        ("jumps some more", "some more"),
        ("jumps more", "more"),
        ("jumps forward and the same to the left", "same"),
        ("walks the other way", "other"),
        ("walks and runs in turn", "in turn"),
        ("walks as though falling", "as though falling"),
        ("climbs two steps at a time", "at a time"),
        ("jumps before and after sitting", "before"),
        ("bends his back", "his back"),
        (
            "jumps while walking, then twice more",
            "twice; not made as said: walking (made in turn, not at the same time)",
        ),
        ("walks forward and back, then once more", "once"),
        ("walks for 45 s to 1 min 30 s", "45 s to 1 min 30 s"),
        ("walks for 1 min 30 s to 2 min", "1 min 30 s to 2 min"),
        ("walks to one chair and then to another", "another"),
        ("jumps, then a second time", "second"),
        ("jumps time and time again", "time and time again"),
        ("falls 2 s after slipping", "2 s"),
        ("squats with 5 s between", "5 s between"),
        ("jumps 3 times per minute", "3 times per minute"),
        ("jumps 3 times a second", "3 times a second"),
        ("jumps twice a day", "twice a day"),
        ("jumps once a day", "once a day"),
        ("jumps two times per day", "two times per day"),
        ("jumps 3 times a week", "3 times a week"),
        ("jumps twice daily", "twice daily"),
        ("walks for 5 minutes every morning", "for 5 minutes every morning"),
        ("walks for 2/3 seconds", "2 / 3 seconds"),
        ("walks for 1/2 seconds", "1 / 2 seconds"),
        ("walks for 2/3 s", "2 / 3 s"),
        ("walks for 10/4 s", "10 / 4 s"),
        ("walks for 4/8 s", "4 / 8 s"),
        ("walks for 5/2 minutes", "5 / 2 minutes"),
        ("walks for 1/2/3 s", "1 / 2 / 3 s"),
        ("turns by 45/90 degrees", "45 / 90 degrees"),
        ("does 2 sets of 3/4 turns", "3 / 4"),
        ("jumps 2\u00bd times", "2 1 \u2044 2 times"),
        ("spins one and a half times", "one and a half times"),
        ("walks behind him", "behind him"),
        ("sits on the chair, then the floor", "sits, floor"),
        ("is a man aged 70 who falls", "aged, 70"),
        ("falls, a man aged about seventy", "aged, seventy"),
        ("jumps >3", ">, 3"),
        ("takes two small jumps of 2 m", "small, 2, m"),
        ("patient 2 walks", "2"),
        ("makes 20 steps", "20 steps"),
        ("climbs up and down the stairs", "down"),
        ("balances on one leg for 20 s and then on the other", "other"),
        ("falls forward and lies on his back", "lies, on his back"),
        ("slips twice and falls once", "once"),
        ("sits down if he falls", "if"),
        ("jumps and claps his hands three times", "three times"),
        ("turns 90 degrees, 90 degrees", "90 degrees"),
    ],
)
def test_numbers_that_are_not_read_are_told_in_the_words_of_the_sentence(words: str, told: str) -> None:
    parsed = parse_description(f"he {words}")
    assert str(parsed) == f"not understood and left out: {told}"
    assert all(step.duration_s in (None, 20) for step in parsed.description.steps)


def test_a_range_that_is_read_once_and_left_out_once_is_told_as_both() -> None:
    parsed = parse_description("a man jumps 2 or 3 times, then climbs 2 or 3 times")
    assert (parsed.read_as, parsed.ignored) == ((("2 or 3 times", "2 times"),), ("2 or 3 times",))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("jumps 150 to 250 times", r"got 150 to 250 times \(read as 200 times\); write"),
        ("turns from 85 to 90 degrees", r"got from 85 to 90 degrees \(read as 5 degrees\); write"),
        ("walks for 20 to 30 minutes", r"got for 20 to 30 minutes \(read as 25 minutes\); write"),
        ("kicks 2 or 3 times", r"\(not understood: kicks, 2 or 3 times\)"),
        ("squats 1e999 times", "got 1e999 times; write"),
        ("squats 2 to 1e999 times", "got 1e999 times; write"),
        ("makes 1e999 turns", "got 1e999 turns; write"),
        ("turns 1e999/1e999 turns", "got 1e999 turns; write"),
        ("walks for 1e999 s", "got 1e999 s; write"),
    ],
)
def test_errors_quote_the_words_of_the_sentence(words: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_description(f"a man {words}")


def test_a_once_that_is_a_conjunction_is_no_count() -> None:
    assert all(step.count is None for step in parse_description("once he has sat down he stands up").description.steps)


# --- words that change nothing ---


@pytest.mark.parametrize(
    ("sentence", "told"),
    [
        ("a man picks up a box and carries it away", ("box", "carries", "away")),
        ("a woman tiptoes across the room", ("tiptoes", "room")),
        ("he gets out of bed", ("bed",)),
        ("she climbs a ladder", ("ladder",)),
        ("a boy climbs the stairs on the spot", ("on the spot",)),
        ("a couple dances", ("couple",)),
        ("a man squats on one leg", ("on one leg",)),
        ("a tired man walks with heavy steps", ("tired", "heavy")),
        ("a girl waltzes", ("waltzes",)),
        ("a man walks three metres", ("three", "metres")),
        ("he lands softly after a jump", ("softly",)),
        ("she suddenly swings the bag and runs", ("suddenly", "swings", "bag")),
    ],
)  # fmt: skip
def test_words_that_change_nothing_are_told(sentence: str, told: tuple[str, ...]) -> None:
    said = str(parse_description(sentence))
    assert all(word in said for word in told), said


@pytest.mark.parametrize(
    ("sentence", "told"),
    [
        ("a man walks towards a ball", "not made: ball of walk"),
        ("a man runs with clenched fists and stops", "not made: hand of run"),
        ("a man tiptoes forward", "not made as said: tiptoes"),
        ("a man dances twice in the kitchen", "kitchen; not made: count 2 of dance"),
        ("a man jumps five times for 3 seconds", r"not made: count 5 of jump \([1-4] within 3 s\)"),
        ("a man squats 5 times for 5 seconds", "not made: duration 5 s of squat"),
        ("a man turns 3 times for 3 seconds", "not made: duration 1 s of turn, which takes longer$"),
        ("a man limps on the spot", "not made: staying on the spot of walk"),
        ("a man squats for 8 s with his waist bent", "not made: waist of squat"),
        ("a man walks up the stairs twice", "not understood and left out: twice"),
    ],
)
def test_a_motion_of_a_sentence_warns_of_what_it_lacks(sentence: str, told: str) -> None:
    with pytest.warns(T2DWarning, match=told):
        motion_from_text(sentence)


@pytest.mark.parametrize(
    "sentence",
    slow_after(4, [
        "a man walks slowly to a chair and sits down", "a man walks to the stairs and climbs up", "a woman lies down on a bed",
        "a man jumps in place twice with both feet", "she jumps three times on her left foot", "an old man sits down on the floor",
        "a man bends to pick up a ball", "a child runs in a counterclockwise circle", "the person turns around on the spot",
        "a man with a limp walks forward, sparing his left leg", "he squats, holding the handrail", "a man walks upstairs",
    ]),
)  # fmt: skip
def test_what_is_made_is_not_warned_of(sentence: str) -> None:
    motion_from_text(sentence)  # warnings are errors


@pytest.mark.parametrize("range_", ["1/2 to 4 minutes", "1 to 3/2 minutes"])
def test_ranges_that_end_in_fractions_are_told_as_left_out(range_: str) -> None:
    parsed = parse_description(f"a man walks for {range_}")
    assert parsed.ignored
    assert not parsed.read_as


def test_who_walks_upstairs_rises() -> None:
    motion = motion_from_text("a man walks upstairs", seed=1)
    assert hips(motion)[-1] - hips(motion)[0] > 0.5


def test_who_turns_on_the_spot_stays_there() -> None:
    motion = motion_from_text("a woman turns around on the spot", seed=1)
    assert np.ptp(motion.joints[:, 0, :2], axis=0).max() < 0.4


def test_jumping_jacks_open_arms_and_legs() -> None:
    parsed = parse_description("a man does five jumping jacks")
    assert (parsed.description.count, parsed.read_as) == (10, (("5 jumping jacks", "10 jumps out and in"),))
    motion = motion_from_text(parsed.description, seed=1)
    feet = motion.joints[:, motion.index("left_ankle")] - motion.joints[:, motion.index("right_ankle")]
    assert dips(-np.linalg.norm(feet, axis=1), 0.5) == 5


@pytest.mark.parametrize(
    "words", ["0 times for 6 s, then once more", "2.5 times for 6 s, then once more", "for 5 s, then 1.5 times more"]
)
def test_no_whole_number_of_times_is_refused_before_what_is_done_again(words: str) -> None:
    with pytest.raises(
        InputError, match=r"an action is done 1 to 100 times, got .* times; write a whole number of times"
    ):
        parse_description(f"a man squats {words}")
