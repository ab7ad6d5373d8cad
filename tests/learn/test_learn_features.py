"""Features of the course of a movement: of lines that are known, whichever way they go and however strong they are."""

from __future__ import annotations

import numpy as np
import pytest

from t2d_rt.core.errors import InputError
from t2d_rt.learn.baselines import Centroids, baseline_probabilities
from t2d_rt.learn.features import EDGES_MPS, RATES_HZ, Lines, activity_features, band_features, features
from t2d_rt.learn.maps import LabelledMaps

SPEEDS_MPS = np.linspace(-9.66, 9.66, 97)
DURATION_S, COLUMNS = 5.0, 200
TIME_S = np.arange(COLUMNS) * DURATION_S / COLUMNS


def levels(speed_mps: np.ndarray, width_mps: float = 0.6, shown: np.ndarray | bool = True, seed: int = 0) -> np.ndarray:
    """A body of that speed over time, 30 dB above noise of one look, (speed, time) [dB], 0 at the greatest cell."""
    noise = np.random.default_rng(seed).exponential(1e-3, (len(SPEEDS_MPS), COLUMNS))
    body = np.exp(-(((SPEEDS_MPS[:, None] - speed_mps) / width_mps) ** 2)) * shown
    power = noise + body
    return 10 * np.log10(power / power.max())


def told(*arguments: object, **options: object) -> dict[str, float]:
    return activity_features(levels(*arguments, **options), SPEEDS_MPS, DURATION_S)  # type: ignore[arg-type]


def test_lines_are_those_of_the_body() -> None:
    speed = 2 + np.sin(TIME_S)
    found = Lines.of(levels(speed), SPEEDS_MPS)
    np.testing.assert_allclose(found.middle, speed, atol=0.25)  # cells of 0.2 m/s
    np.testing.assert_allclose(found.mean, speed, atol=0.1)
    assert np.all(found.lower < speed - 0.3)
    assert np.all(found.upper > speed + 0.3)


def test_steps_have_the_rate_that_they_have() -> None:
    found = told(1.5 + 0.8 * np.sin(2 * np.pi * 1.8 * TIME_S))
    assert np.exp(found["rate of the middle"]) == pytest.approx(1.8, rel=0.05)
    assert found["rhythm of the middle"] > told(np.full(COLUMNS, 1.5))["rhythm of the middle"] + 0.5


def test_rest_after_a_burst_is_no_rest_before_it() -> None:
    early, late = TIME_S < 1.2, TIME_S > 3.8
    first, last = (told(np.full(COLUMNS, 2.0), shown=shown) for shown in (early, late))
    assert first["centre of the power"] < 0.2 < 0.8 < last["centre of the power"]
    assert first["longest burst"] == pytest.approx(np.log(1.2 + 0.1), abs=0.15)
    assert first["after the fastest"] < first["before the fastest"]
    assert last["after the fastest"] > first["after the fastest"]
    both = told(np.full(COLUMNS, 2.0), shown=early | late)
    assert both["bursts"] == pytest.approx(np.log(2.1))


def test_turning_back_counts() -> None:
    assert told(2 * np.sign(np.sin(2 * np.pi * TIME_S / 2 + 0.5)))["turns"] == pytest.approx(np.log(6))
    assert told(np.full(COLUMNS, 2.0))["turns"] == pytest.approx(0)


def test_none_tells_approaching_from_receding() -> None:
    image = levels(1.5 + 1.2 * np.sin(2 * np.pi * TIME_S) * (TIME_S < 3), seed=3)
    for kind in (features, band_features):
        one, other = (kind(each, SPEEDS_MPS, DURATION_S) for each in (image, image[::-1]))
        assert len(one) > 100
        cell = 0.2
        for name, value in one.items():
            assert other[name] == pytest.approx(value, abs=1.5 * cell), name


def banded(speed_mps: np.ndarray, **options: object) -> dict[str, float]:
    return band_features(levels(speed_mps, **options), SPEEDS_MPS, DURATION_S)  # type: ignore[arg-type]


def test_levels_of_bands_are_those_of_the_body() -> None:
    found = banded(np.full(COLUMNS, 2.4), width_mps=0.15)
    count = len(EDGES_MPS) - 1
    middle = [found[f"levels of both sides {2 * count + band}"] for band in range(count)]
    assert int(np.argmax(middle)) == EDGES_MPS.index(2.2)
    assert middle[0] < 4 < 20 < max(middle)  # two sides without anything are 3 dB


def test_the_track_is_that_of_the_body() -> None:
    steady = banded(np.full(COLUMNS, 1.5))
    assert steady["track"] == pytest.approx(7.5, rel=0.05)
    assert steady["length of the track"] == pytest.approx(7.5, rel=0.05)
    assert steady["behind the start"] == pytest.approx(0, abs=0.1)
    back = banded(1.5 * np.sign(2.0 - TIME_S))  # 3 m ahead, then 4.5 m back
    assert back["track"] == pytest.approx(1.5, abs=0.2)
    assert back["length of the track"] == pytest.approx(7.5, rel=0.05)
    assert back["span of the track"] == pytest.approx(4.5, rel=0.05)
    assert back["behind the start"] == pytest.approx(3.0, rel=0.1)


def test_modulation_has_the_rate_that_it_has() -> None:
    rate_hz = 1.8
    found = banded(2.6 + 0.8 * np.sin(2 * np.pi * rate_hz * TIME_S))
    for name, first in (("modulation", 5 * (len(RATES_HZ) - 1)), ("modulation of the mean speed", 0)):
        lines = [found[f"{name} {first + number}"] for number in range(len(RATES_HZ) - 1)]
        assert RATES_HZ[int(np.argmax(lines))] == 1.6


def test_a_shift_in_time_changes_bands_little() -> None:
    speed = 1.0 + 0.8 * np.sin(2 * np.pi * 1.6 * TIME_S)
    one, other = (levels(np.roll(speed, by), shown=np.roll(TIME_S < 2.5, by), seed=5) for by in (0, 60))
    told_one, told_other = (band_features(each, SPEEDS_MPS, DURATION_S) for each in (one, other))
    for name, value in told_one.items():
        if name.startswith(("levels", "one-sided", "difference", "track")):
            assert told_other[name] == pytest.approx(value, abs=1.6), name


@pytest.mark.parametrize(("columns", "duration_s"), [(16, 1.0), (64, 60.0)])
def test_maps_too_short_or_too_coarse_for_steps_are_refused(columns: int, duration_s: float) -> None:
    noise = np.random.default_rng(0).uniform(-40, 0, (4, 16, columns)).astype(np.float32)
    maps = LabelledMaps(
        levels=noise - noise.max(axis=(1, 2), keepdims=True), labels=np.array([0, 0, 1, 1]), classes=("walk", "fall"),
        groups={}, velocity_mps=np.linspace(-5, 5, 16), duration_s=duration_s, names=tuple("abcd"),
    )  # fmt: skip
    with pytest.raises(InputError, match=r"baselines take maps of 1\.2 s or more in cells of 0\.7 s at most"):
        baseline_probabilities("nearest-centroid", maps, maps)


def test_noise_alone_has_finite_features_at_any_size() -> None:
    for size in ((97, 200), (16, 24), (8, 8)):
        noise = 10 * np.log10(np.random.default_rng(0).exponential(size=size))
        for kind in (features, band_features):
            found = kind(noise - noise.max(), np.linspace(-5, 5, size[0]), 2.0)
            assert np.isfinite([*found.values()]).all()
    silent = np.full((16, 24), -60.0)
    silent[8, 0] = 0
    for kind in (features, band_features):
        assert np.isfinite([*kind(silent, np.linspace(-5, 5, 16), 2.0).values()]).all()


def test_a_centroid_of_one_sample_per_class_is_still_one() -> None:
    found = Centroids.of(np.array([[0.0, 1.0], [1.0, 1.0]]), np.array([0, 1]))
    np.testing.assert_array_equal(found.labels(np.array([[0.1, 1.0], [0.9, 1.0]])), [0, 1])
