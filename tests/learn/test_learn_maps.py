"""Labelled maps: levels below the greatest cell, of one size, and in one sentence why others are refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dataset_folder import write_dataset
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset
from t2d_rt.learn.maps import LabelledMaps, maps_of


def maps(count: int = 6, size: tuple[int, int] = (8, 12), **changes: Any) -> LabelledMaps:
    levels = np.random.default_rng(0).uniform(-60, -1, (count, *size))
    levels[:, 3, 4] = 0
    values: dict[str, Any] = {
        "levels": levels, "labels": np.arange(count) % 2, "classes": ("walk", "fall"),
        "groups": {"event": np.array([f"e{k // 2}" for k in range(count)])},
        "velocity_mps": np.linspace(-3.5, 3.5, size[0]), "duration_s": 5.0, "names": tuple(map(str, range(count))),
    }  # fmt: skip
    return LabelledMaps(**{**values, **changes})


def test_of_a_data_set(tmp_path: Path) -> None:
    dataset = Dataset(write_dataset(tmp_path / "tiny"))
    found = maps_of(dataset, size=(8, 8), dynamic_range_db=20)
    assert len(found) == len(dataset)
    assert found.size == (8, 8)
    assert found.levels.dtype == np.float32
    np.testing.assert_array_equal(found.levels.max(axis=(1, 2)), 0)
    assert found.levels.min() >= -20
    np.testing.assert_array_equal(found.labels, dataset.labels)
    assert set(found.groups) == {"description", "clip", "seed"}


def test_samples_of_different_durations_are_refused(tmp_path: Path) -> None:
    dataset = Dataset(write_dataset(tmp_path / "tiny"))
    dataset.records[3]["products"]["spectrogram"]["time_s"] = [0.0, 4.0]
    with pytest.raises(InputError, match="cover 4 to 5 s; give all samples one duration"):
        maps_of(dataset, size=(8, 8))


def test_maps_of_radars_whose_cells_end_at_other_speeds_share_an_axis(tmp_path: Path) -> None:
    dataset = Dataset(write_dataset(tmp_path / "tiny"))
    spans = {0: (-4.0, 4.0), 1: (-4.08, 4.12)}
    for place, record in enumerate(dataset.records):
        record["products"]["spectrogram"]["velocity_mps"] = list(spans[place % 2])
    found = maps_of(dataset, size=(800, 24))
    assert (found.velocity_mps[0], found.velocity_mps[-1]) == pytest.approx((-3.995, 3.995))
    for place, levels in enumerate(found.levels):  # the made-up samples have one cell of power
        first, last = spans[place % 2]
        row, cell = int(np.argmax(dataset.values(place, "spectrogram")[:, 0])), (last - first) / 16
        shown = found.velocity_mps[levels[:, 0] > -0.01]
        ends = np.clip([first + row * cell, first + (row + 1) * cell], -4.0, 4.0)
        np.testing.assert_allclose([shown.min() - 0.005, shown.max() + 0.005], ends, atol=0.011)
    dataset.records[3]["products"]["spectrogram"]["velocity_mps"] = [-4.0, 4.8]
    with pytest.raises(InputError, match="different axes of speed; give the recipe one speed_mps"):
        maps_of(dataset, size=(8, 8))


def test_taken_resized_joined() -> None:
    some = maps()
    part = some.take([4, 1])
    assert part.names == ("4", "1")
    np.testing.assert_array_equal(part.levels[0], some.levels[4])
    small = some.resized((8, 8))
    np.testing.assert_allclose(small.velocity_mps, some.velocity_mps)
    assert maps(size=(16, 12)).resized((8, 8)).velocity_mps[0] == pytest.approx(np.mean(np.linspace(-3.5, 3.5, 16)[:2]))
    both = some.joined(dataclasses.replace(part, groups={}))
    assert len(both) == 8
    assert len(set(both.groups["event"])) == 3 + 2


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"levels": np.full((6, 8, 12), np.nan)}, "levels must be finite"),
        ({"levels": np.ones((6, 8, 12))}, "below each map's greatest cell"),
        ({"levels": np.zeros((6, 8))}, "levels must have shape"),
        ({"labels": np.zeros(5, int)}, "labels must be 6 integers"),
        ({"labels": np.full(6, 2)}, "label 2 is of no class"),
        ({"velocity_mps": np.linspace(1, -1, 8)}, "must ascend"),
        ({"groups": {"event": np.array(["a"])}}, "group 'event' must name each of 6"),
        ({"classes": ("a", "a")}, "twice"),
    ],
)
def test_what_is_refused(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        maps(**changes)


def test_what_cannot_be_trained_on_or_joined() -> None:
    with pytest.raises(InputError, match="'fall' has no sample"):
        maps(labels=np.zeros(6, int)).checked_for_training()
    with pytest.raises(InputError, match="one class only"):
        maps(labels=np.zeros(6, int), classes=("walk",)).checked_for_training()
    with pytest.raises(InputError, match="resize one"):
        maps().joined(maps(size=(8, 8)))
    with pytest.raises(InputError, match="same speeds and time"):
        maps().joined(maps(duration_s=3.0))
    with pytest.raises(InputError, match=r"lie in 0\.\.5"):
        maps().take([6])
