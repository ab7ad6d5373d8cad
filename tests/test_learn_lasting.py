"""The likeliest course of classes over time, against all courses there are; what a prediction tells of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby, product

import numpy as np
import pytest

from t2d_rt.learn.lasting import LEAST_PROBABILITY, likeliest_course
from t2d_rt.learn.windows import Prediction


@pytest.mark.parametrize(("count", "classes", "least"), [(7, 3, 2), (8, 2, 3), (6, 3, 1), (9, 2, 4), (3, 2, 5)])
def test_no_course_is_likelier(count: int, classes: int, least: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(10):
        probabilities = rng.dirichlet(np.ones(classes), count)
        scores = np.log(np.maximum(probabilities, LEAST_PROBABILITY))
        every = [
            course
            for course in product(range(classes), repeat=count)
            if min(len(list(run)) for _, run in groupby(course)) >= min(least, count)
        ]
        best = max(every, key=lambda course: scores[np.arange(count), course].sum())
        np.testing.assert_array_equal(likeliest_course(probabilities, least), best)


def prediction(least_s: float) -> Prediction:
    """Windows of 4 s each second, of 12 s: the first class, then the second but for one window in which the third is likelier."""
    probabilities = np.array([[0.8, 0.1, 0.1]] * 4 + [[0.1, 0.8, 0.1]] * 5)
    probabilities[6] = 0.1, 0.4, 0.5
    return Prediction(
        classes=("walk", "sit", "fall"), starts_s=np.arange(9.0), duration_s=4.0, probabilities=probabilities,
        least_s=least_s,
    )  # fmt: skip


def test_what_is_shorter_than_the_least_is_no_activity() -> None:
    assert [each[2] for each in prediction(0.0).pieces()] == [0, 1, 2, 1]
    found = prediction(3.0).pieces()
    assert [each[2] for each in found] == [0, 1]
    assert (found[0][0], found[-1][1]) == (0.0, 12.0)
    assert found[0][1] == found[1][0] == pytest.approx(5.5, abs=0.51)
    np.testing.assert_array_equal(prediction(3.0).at(np.array([0.1, 4.5, 8.5, 11.9])), [0, 0, 1, 1])
    np.testing.assert_array_equal(prediction(0.0).at(np.array([0.1, 4.5, 8.5, 11.9])), [0, 0, 2, 1])


def test_one_window_is_one_activity() -> None:
    found = Prediction(
        classes=("walk", "sit"), starts_s=np.array([0.5]), duration_s=4.0, probabilities=np.array([[0.3, 0.7]]), least_s=3.0
    )  # fmt: skip
    assert found.pieces() == [(0.5, 4.5, 1)]


def test_an_activity_lasts_for_the_least_or_more_where_steps_are_wide() -> None:
    """Steps of 3 s and a least duration of 4 s: two instants, not the nearest number of them, which is one."""
    probabilities = np.array([[0.9, 0.1], [0.9, 0.1], [0.2, 0.8], [0.9, 0.1], [0.9, 0.1]])
    found = Prediction(
        classes=("walk", "fall"), starts_s=3.0 * np.arange(5), duration_s=3.0, probabilities=probabilities, least_s=4.0
    )  # fmt: skip
    assert found.pieces() == [(0.0, 15.0, 0)]
    assert len(replace(found, least_s=3.0).pieces()) == 3


def test_each_window_has_its_likeliest_class_of_however_many() -> None:
    probabilities = np.full((3, 150), 1 / 150)
    probabilities[[0, 1, 2], [7, 3, 7]] *= 1.1
    np.testing.assert_array_equal(likeliest_course(probabilities, 1), [7, 3, 7])
