"""Hidden labels: the classifiers that look for them find one that is there, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")
pytest.importorskip("sklearn", reason="scikit-learn is not installed (extra [learn])")

from t2d_rt.learn.maps import LabelledMaps
from validation.datasets.hidden_labels import accuracy, mirrored


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
