"""Hidden labels: the classifiers that look for them find one that is there, and none where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")
pytest.importorskip("sklearn", reason="scikit-learn is not installed (extra [learn])")

from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Recipe
from t2d_rt.dataset.sample import sample
from t2d_rt.learn.maps import LabelledMaps
from validation.datasets.hidden_labels import accuracy, directionless, interval, mirrored, turned


def test_a_figure_that_tells_the_class_is_found_and_noise_is_not() -> None:
    rng = np.random.default_rng(0)
    labels = np.tile(np.arange(8), 40)
    noise = rng.standard_normal((320, 1))
    assert accuracy(noise, labels) < 0.125 + 0.05
    assert accuracy(labels[:, None] + 0.1 * noise, labels) > 0.9


def test_mirrored_maps_have_the_same_speeds() -> None:
    levels = -np.arange(12, dtype=np.float32).reshape(1, 4, 3)
    speeds = np.array([-1.5, -0.5, 0.5, 1.5])
    maps = LabelledMaps(
        levels=levels, labels=np.zeros(1, int), classes=("walking", "running"), groups={}, velocity_mps=speeds, duration_s=1.0,
        names=("one",),
    )  # fmt: skip
    found = mirrored(maps)
    assert found.velocity_mps.tolist() == maps.velocity_mps.tolist()
    assert found.levels[0, :, 0].tolist() == [-9.0, -6.0, -3.0, 0.0]
    with pytest.raises(InputError, match="make the data set again"):
        mirrored(replace(maps, velocity_mps=speeds + 0.5))


def test_people_who_are_turned_round_do_the_same_the_other_way(tmp_path: Path) -> None:
    recipe = Recipe.read("small-hard").model_copy(update={"classes": ("walking",)})
    plain, (record,) = sample(recipe, 0), turned(recipe, 1, tmp_path).records
    assert record["seed"] == plain.cut.source.seed
    assert record["range_m"] == pytest.approx(plain.place.range_m, abs=0.005)
    assert record["angle_deg"] == pytest.approx(plain.place.angle_deg + 180)
    assert record["aside_m"] == pytest.approx(-plain.place.aside_m, abs=0.001)
    assert record["nearer_m"] * plain.place.nearer_m < 0


def test_what_direction_tells_is_gone_without_it_and_what_travel_tells_stays() -> None:
    labels = np.tile(np.arange(8), 40)
    far = labels[:, None] + 1.0
    assert directionless(far, 0.0, labels) > 0.7  # twelve leaves for sixteen values
    assert directionless(np.where(labels < 4, 1.0, -1.0)[:, None], 0.0, labels) < 0.125 + 0.05


def test_an_interval_is_of_groups() -> None:
    lost = np.repeat(np.random.default_rng(0).standard_normal(100), 4)
    low, high = interval(lost, np.repeat(np.arange(100), 4))
    assert high - low == pytest.approx(4 * 0.98 / np.sqrt(100), rel=0.2)  # of 100 groups, not of 400 samples
    assert low < lost.mean() < high
