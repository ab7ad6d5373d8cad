"""Occlusion masks: how many windows, how long, where, and what fills them."""

from __future__ import annotations

import numpy as np
import pytest

from t2d_rt.core.errors import InputError
from t2d_rt.noise.masks import OcclusionMask, occlude

TIMES = 0.05 + 0.1 * np.arange(100)
POWER = np.full((4, 100), 3.0)


def test_windows_replace_columns_by_background_and_nothing_else() -> None:
    background = np.arange(400.0).reshape(4, 100)
    mask = OcclusionMask(windows=3, shortest_s=0.5, longest_s=2)
    found = occlude(POWER, TIMES, mask, seed=1, background_power=background)
    inside = np.zeros(100, bool)
    for start, stop in found.windows_s:
        inside |= (start <= TIMES) & (stop > TIMES)
    assert 0 < inside.sum() < 100
    np.testing.assert_array_equal(found.columns, inside)
    np.testing.assert_array_equal(found.power[:, inside], background[:, inside])
    np.testing.assert_array_equal(found.power[:, ~inside], POWER[:, ~inside])
    zeros = occlude(POWER, TIMES, mask, seed=1, fill="zeros")
    np.testing.assert_array_equal(zeros.windows_s, found.windows_s)
    assert not zeros.power[:, inside].any()


def test_number_and_length_follow_their_distributions() -> None:
    mask = OcclusionMask(windows=2.5, shortest_s=0.2, longest_s=0.6)
    drawn = [mask.draw(1000.0, seed=seed) for seed in range(400)]
    counts = np.array([len(each) for each in drawn])
    # A Poisson number has the variance of its mean; 400 of them: 3 standard errors.
    assert abs(counts.mean() - 2.5) < 3 * np.sqrt(2.5 / 400)
    assert abs(counts.var() - 2.5) < 3 * np.sqrt((2 * 2.5**2 + 2.5) / 400)
    lengths = np.concatenate([np.diff(each, axis=1) for each in drawn])
    assert np.quantile(lengths, 0.01) >= 0.2
    assert lengths.max() <= 0.6 + 1e-9
    assert abs(lengths.mean() - 0.4) < 3 * 0.4 / np.sqrt(12 * len(lengths))


def test_every_instant_is_as_likely_to_be_occluded() -> None:
    mask = OcclusionMask(windows=2, shortest_s=3, longest_s=3)
    often = np.mean([occlude(POWER, TIMES, mask, seed=seed, fill="zeros").columns for seed in range(1500)], axis=0)
    expected = 1 - np.exp(-2 * 3 / 13)  # windows begin within 13 s: Poisson with 6/13 over each instant
    assert np.abs(often - expected).max() < 4.5 * np.sqrt(expected * (1 - expected) / 1500)


def test_seeds_repeat_and_differ() -> None:
    mask = OcclusionMask(windows=5)
    np.testing.assert_array_equal(mask.draw(9.0, seed=4), mask.draw(9.0, seed=4))
    assert not np.array_equal(mask.draw(9.0, seed=4), mask.draw(9.0, seed=5))
    assert len(OcclusionMask(windows=0).draw(9.0, seed=0)) == 0


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: OcclusionMask(shortest_s=2.0), "longest_s must be shortest_s .2 s. or more, got 1"),
        (lambda: OcclusionMask(windows=-1), "occlusion mask key windows: got -1"),
        (lambda: OcclusionMask(number=1), "unknown occlusion mask key 'number'"),
        (lambda: OcclusionMask().draw(-1, seed=0), "duration_s must be positive"),
        (lambda: occlude(POWER, TIMES, OcclusionMask(), seed=0), "needs background_power"),
        (lambda: occlude(POWER, TIMES, OcclusionMask(), seed=0, fill="zeros", background_power=POWER), "takes none"),
        (lambda: occlude(POWER, TIMES[:9], OcclusionMask(), seed=0, fill="zeros"), "time_s must have shape .100,."),
        (
            lambda: occlude(POWER, TIMES, OcclusionMask(), seed=0, background_power=POWER[:2]),
            "background_power must have shape",
        ),
        (
            lambda: occlude(-POWER, TIMES, OcclusionMask(), seed=0, fill="zeros"),
            "spectrogram_power must be 0 W or more, got -3",
        ),
        (
            lambda: occlude(POWER, TIMES, OcclusionMask(), seed=0, background_power=-POWER),
            "background_power must be 0 W or more, got -3",
        ),
        (lambda: occlude(POWER, TIMES[::-1], OcclusionMask(), seed=0, fill="zeros"), "ascending"),
    ],
)
def test_what_cannot_be_used_is_refused(call, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        call()
