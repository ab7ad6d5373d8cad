"""A line of the benchmark's table, and the intervals in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dataset_folder import recipe, record_of, write_dataset
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset
from t2d_rt.learn import benchmark
from t2d_rt.learn.scores import interval_of

SIDES = [
    {"name": name, "weight": 1, "conditions": ["ellipsoids"], "angles_deg": [[0, 90]]}
    for name in ("train", "val", "test")
]


def test_an_interval_over_single_samples_is_the_binomial_one_and_groups_widen_it() -> None:
    labels = np.zeros(400, dtype=int)
    told = (np.arange(400) % 4 == 0).astype(int)  # three of four are right
    alone, _ = interval_of(labels, told, 2, [[str(each) for each in range(400)]])
    sd = np.sqrt(0.75 * 0.25 / 400)
    assert alone.score == 0.75
    np.testing.assert_allclose([alone.low, alone.high], [0.75 - 1.96 * sd, 0.75 + 1.96 * sd], atol=0.006)
    order = np.argsort(told, kind="stable")  # groups of four that are right or wrong together count as one
    grouped = [str(each) for each in np.argsort(order) // 4]
    wide, f1 = interval_of(labels, told, 2, [grouped])
    np.testing.assert_allclose((wide.high - wide.low) / (alone.high - alone.low), 2.0, rtol=0.15)
    assert f1.score == pytest.approx((2 * 300 / 700 + 0.0) / 2)


class Reader:
    """A model that looks where the line of power lies, as `dataset_folder` makes it, and knows the order of the classes."""

    def fit(self, levels: np.ndarray, labels: np.ndarray) -> None:
        self.known = {int(row): int(label) for row, label in zip(self.rows(levels), labels, strict=True)}

    def rows(self, levels: np.ndarray) -> np.ndarray:
        return np.asarray(levels.reshape(-1, 16, 16).mean(axis=2).argmax(axis=1))

    def predict(self, levels: np.ndarray) -> np.ndarray:
        return np.array([self.known.get(int(row), 0) for row in self.rows(levels)])


def test_a_class_or_an_estimator_adds_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "dataset_folder.record_of", lambda found, index: record_of(found, index) | {"subject": index % 4}
    )
    values: dict[str, Any] = {"products": {"spectrogram": {"size": [16, 16]}}}
    folder = write_dataset(tmp_path / "set", recipe(**values, subjects=18, sides=SIDES))
    found = benchmark(folder, Reader(), size=16)
    assert found.samples == {"train": 4, "val": 4, "test": 4}
    assert (found.name, found.by_condition["ellipsoids"][1]) == ("Reader", 4)
    dataset = Dataset(folder)
    assert {dataset.records[place]["description"] for place in dataset.sides["test"]} == {2}
    assert 0.0 <= found.accuracy.low <= found.accuracy.score <= found.accuracy.high <= 1.0
    assert str(found).startswith("| Reader | 4 / 4 / 4 | ")
    neighbours = pytest.importorskip("sklearn.neighbors", reason="scikit-learn is not installed (extra [learn])")
    assert benchmark(folder, neighbours.KNeighborsClassifier(1), name="nearest", size=16).name == "nearest"
    bad = Reader()
    bad.predict = lambda levels: np.zeros((len(levels), 2))  # type: ignore[method-assign]
    with pytest.raises(InputError, match="must tell 4 numbers of classes, got float64 of shape"):
        benchmark(folder, bad, size=16)
    with pytest.raises(InputError, match="has no sides, so nothing says what is the test"):
        benchmark(write_dataset(tmp_path / "plain", recipe(**values)), Reader(), size=16)
