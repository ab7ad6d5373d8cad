"""The likeliest course of classes over time, against all courses there are; what a prediction tells of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from t2d_rt.core.errors import InputError
from t2d_rt.learn.prediction import LEAST_PROBABILITY, SHARPNESS, Prediction, likeliest_course, nearest


def divisions(count: int, least: int) -> Iterator[list[tuple[int, int]]]:
    """All ways to divide so many instants into activities of the least number or more."""
    if count == 0:
        yield []
    for length in range(least, count + 1):
        for before in divisions(count - length, least):
            yield [*before, (count - length, count)]


def scores_of(
    begin: int, end: int, scores: np.ndarray, middles_s: np.ndarray, duration_s: float, edges_s: np.ndarray
) -> np.ndarray:
    """Of each class over an activity, (K,), window by window, as the rule says it."""
    start_s, end_s = edges_s[begin], edges_s[end]
    total, weights = np.zeros(scores.shape[1]), 0.0
    for middle_s, score in zip(middles_s, scores, strict=True):
        early_s, late_s = middle_s - 0.5 * duration_s - start_s, end_s - middle_s - 0.5 * duration_s
        about_s = abs(middle_s - 0.5 * (start_s + end_s))
        moved_s = about_s if end_s - start_s < duration_s else max(0.0, -early_s, -late_s)
        weight = max(0.0, 1 - moved_s / duration_s) ** SHARPNESS
        total, weights = total + weight * score, weights + weight
    return (end - begin) * total / weights


@pytest.mark.parametrize(
    ("windows", "per_window", "classes", "least"),
    [(5, 4, 3, 3), (5, 4, 3, 4), (4, 5, 2, 2), (6, 5, 3, 1), (9, 2, 4, 3), (3, 3, 2, 9), (1, 3, 3, 2), (9, 1, 2, 2)],
)
def test_no_course_is_likelier(windows: int, per_window: int, classes: int, least: int) -> None:
    """Every division of the instants is tried, each activity with its best class; windows of so many instants begin at each."""
    rng = np.random.default_rng(windows)
    duration_s, count = 0.5 * per_window, windows + per_window - 1
    middles_s, edges_s = 0.5 * np.arange(windows) + 0.5 * duration_s, 0.5 * np.arange(count + 1)
    for _ in range(20):
        probabilities = rng.dirichlet(np.ones(classes), windows)
        scores = np.log(np.maximum(probabilities, LEAST_PROBABILITY))
        best, course = -np.inf, np.zeros(count, dtype=int)
        for division in divisions(count, min(least, count)):
            pieces = [scores_of(*piece, scores, middles_s, duration_s, edges_s) for piece in division]
            if (value := sum(each.max() for each in pieces)) > best + 1e-9:
                best = value
                course = np.repeat([each.argmax() for each in pieces], [end - begin for begin, end in division])
        found = likeliest_course(probabilities, middles_s, duration_s, edges_s, least)
        np.testing.assert_array_equal(found, course)


def told(probabilities: np.ndarray, starts_s: np.ndarray, duration_s: float, least_s: float) -> Prediction:
    classes = tuple(map(str, range(probabilities.shape[1])))
    return Prediction(
        classes=classes, starts_s=starts_s, duration_s=duration_s, probabilities=probabilities, least_s=least_s
    )


def prediction(least_s: float) -> Prediction:
    """Windows of 4 s each second, of 12 s: the first class, then the second but for one window in which the third is likelier."""
    probabilities = np.array([[0.8, 0.1, 0.1]] * 4 + [[0.1, 0.8, 0.1]] * 5)
    probabilities[6] = 0.1, 0.4, 0.5
    return told(probabilities, np.arange(9.0), 4.0, least_s)


def test_what_is_shorter_than_the_least_is_no_activity() -> None:
    assert [each[2] for each in prediction(0.0).pieces()] == [0, 1, 2, 1]
    found = prediction(3.0).pieces()
    assert [each[2] for each in found] == [0, 1]
    assert (found[0][0], found[-1][1]) == (0.0, 12.0)
    assert found[0][1] == found[1][0] == pytest.approx(5.5, abs=1.51)
    np.testing.assert_array_equal(prediction(3.0).at(np.array([0.1, 3.5, 8.5, 11.9])), [0, 0, 1, 1])
    np.testing.assert_array_equal(prediction(0.0).at(np.array([0.1, 4.5, 8.5, 11.9])), [0, 0, 2, 1])


def test_windows_over_changes_do_not_outvote_the_one_that_sees_an_activity_alone() -> None:
    """Three activities of 5 s: eight of ten windows over each change tell a fourth, those that see 90 % of an activity
    cannot tell it from that, and one for each tells it."""
    probabilities = np.tile([0.1, 0.1, 0.1, 0.7], (21, 1))
    for number, window in enumerate((0, 10, 20)):
        for beside in {max(window - 1, 0), min(window + 1, 20)}:
            probabilities[beside] = 0.1
            probabilities[beside, [number, 3]] = 0.4
        probabilities[window] = 0.1
        probabilities[window, number] = 0.7
    found = told(probabilities, 0.5 * np.arange(21), 5.0, 5.0)
    assert found.pieces() == [(0.0, 5.0, 0), (5.0, 10.0, 1), (10.0, 15.0, 2)]
    assert {each[2] for each in replace(found, least_s=0.0).pieces()} == {0, 1, 2, 3}


@pytest.mark.parametrize(("rest", "stray"), [(0.9, 0.91), (0.9, 0.95), (0.9, 0.99), (0.7, 0.95)])
def test_one_stray_window_makes_no_activity(rest: float, stray: float) -> None:
    probabilities = np.tile([rest, 1 - rest], (41, 1))
    probabilities[20] = 1 - stray, stray
    found = told(probabilities, 0.4 * np.arange(41), 4.0, 3.2)
    assert found.pieces() == [(0.0, 20.0, 0)]
    assert len(replace(found, least_s=0.0).pieces()) == 3


def test_stray_windows_are_fewer_in_the_course_than_by_themselves() -> None:
    """Of 40 recordings of one activity, a twentieth of whose windows is certain of another."""
    rng = np.random.default_rng(0)
    course, alone = [], []
    for _ in range(40):
        probabilities = np.where(rng.random(200)[:, None] < 0.05, [0.1, 0.9], [0.9, 0.1])
        found = told(probabilities, 0.4 * np.arange(200), 4.0, 3.2)
        course.append(found.course()[1].mean())
        alone.append(replace(found, least_s=0.0).course()[1].mean())
    assert np.mean(course) < 0.2 * np.mean(alone)


@pytest.mark.parametrize("least_s", [0.0, 2.0])
def test_windows_far_apart_are_all_told(least_s: float) -> None:
    """Windows of 2 s every 5 s, one of which tells a fall."""
    probabilities = np.tile([0.9, 0.1], (9, 1))
    probabilities[4] = 0.05, 0.95
    found = told(probabilities, 5.0 * np.arange(9), 2.0, least_s)
    np.testing.assert_array_equal(found.at(found.middles_s), [0, 0, 0, 0, 1, 0, 0, 0, 0])


def test_probabilities_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match=r"probabilities must be finite, got \[nan, 0.5\] in window 1"):
        told(np.array([[0.5, 0.5], [np.nan, 0.5], [0.5, 0.5]]), np.arange(3.0), 2.0, 0.0).course()


def test_long_activities_are_put_together() -> None:
    """Each longer than what the search looks for at once; in between one that is as short as may be."""
    probabilities = np.tile([0.8, 0.2], (200, 1))
    probabilities[96:105] = 0.1, 0.9
    found = told(probabilities, 0.5 * np.arange(200), 5.0, 4.0)
    (_, first_s, walk), (_, second_s, fall), (_, last_s, again) = found.pieces()
    assert (walk, fall, again, last_s) == (0, 1, 0, 104.5)
    assert (first_s, second_s) == pytest.approx((48.0, 57.0), abs=2.5)


def test_two_windows_half_a_second_apart_have_instants_as_far_apart() -> None:
    found = told(np.full((2, 2), 0.5), np.array([0.0, 0.5]), 5.0, 4.0)
    np.testing.assert_allclose(found.course()[0], 0.25 + 0.5 * np.arange(11))


def test_one_window_is_one_activity() -> None:
    found = told(np.array([[0.3, 0.7]]), np.array([0.5]), 4.0, 3.0)
    assert found.pieces() == [(0.5, 4.5, 1)]


def test_an_activity_lasts_for_the_least_or_more_where_steps_are_wide() -> None:
    """Steps of 3 s and a least duration of 4 s: two instants, not the nearest number of them, which is one."""
    probabilities = np.array([[0.9, 0.1], [0.9, 0.1], [0.2, 0.8], [0.9, 0.1], [0.9, 0.1]])
    found = told(probabilities, 3.0 * np.arange(5), 3.0, 4.0)
    assert found.pieces() == [(0.0, 15.0, 0)]
    assert len(replace(found, least_s=3.0).pieces()) == 3


@pytest.mark.parametrize("least_s", [0.0, 0.1, 0.8, 2.5])
def test_what_tells_nothing_is_one_activity(least_s: float) -> None:
    """Even probabilities, as of a network that knows nothing: a tie of all courses; steps that the recording is no multiple of."""
    found = told(np.full((5, 2), 0.5), np.array([0.0, 0.3, 0.6, 0.9, 1.13]), 1.37, least_s)
    assert found.pieces() == [(0.0, 2.5, 0)]


def test_each_activity_has_its_likeliest_class_of_however_many() -> None:
    probabilities = np.full((3, 150), 1 / 150)
    probabilities[[0, 1, 2], [7, 3, 7]] *= 1.1
    found = told(probabilities, np.arange(3.0), 1.0, 0.0)
    np.testing.assert_array_equal(found.course()[1], [7, 3, 7])
    np.testing.assert_array_equal(replace(found, least_s=1.0).course()[1], [7, 3, 7])
    np.testing.assert_array_equal(replace(found, least_s=2.0).course()[1], [7, 7, 7])


def test_the_nearest_place_is_the_earlier_of_two() -> None:
    places = np.array([0.0, 1.0, 3.0])
    np.testing.assert_array_equal(nearest(places, np.array([-2.0, 0.5, 0.6, 2.0, 2.1, 9.0])), [0, 0, 1, 1, 2, 2])
    np.testing.assert_array_equal(nearest(places[:1], np.array([-2.0, 7.0])), [0, 0])
