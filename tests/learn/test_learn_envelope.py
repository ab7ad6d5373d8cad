"""The perceptron on features, the cosine schedule, changes that come in turn, and networks that are averaged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from learn_maps import ridges
from t2d_rt.core.errors import InputError
from t2d_rt.learn import Augment, Ensemble, SavedModel, TrainOptions, load_model, scores_of, train_model
from t2d_rt.learn.augment import Augmenter
from t2d_rt.learn.models import build

torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")

SLIDING = Augment(follow=0.3, mirror=0.5, variants=2)
EPOCHS = 3
OPTIONS = TrainOptions(
    epochs=EPOCHS, batch=16, rate=3e-3, schedule="cosine", smoothing=0.1, decay=0.05, augment=SLIDING
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[SavedModel, Path]:
    folder = tmp_path_factory.mktemp("model") / "whole"
    return train_model("envelope", ridges(24), ridges(6, seed=1), OPTIONS, output=folder), folder


@pytest.mark.slow
def test_it_learns_and_its_axes_are_kept_with_the_weights(tmp_path: Path) -> None:
    folder = tmp_path / "longer"
    model = train_model(
        "envelope", ridges(60), ridges(12, seed=1), OPTIONS.model_copy(update={"epochs": 6}), output=folder
    )
    test = ridges(30, seed=2)
    found = model.probabilities(test.levels)
    assert scores_of(found, test.labels).accuracy > 0.85
    read = load_model(folder)
    np.testing.assert_array_equal(read.probabilities(test.levels), found)
    network = read.network
    np.testing.assert_array_equal(network.velocity_mps.numpy(), test.velocity_mps)
    assert float(network.duration_s) == test.duration_s
    network.set_axes(1.7 * test.velocity_mps, test.duration_s)  # the same maps of a faster radar
    assert np.abs(read.probabilities(test.levels) - found).max() > 0.1


def test_features_are_found_once_for_each_map() -> None:
    network = build("envelope", 3, (32, 32)).train()
    calls: list[int] = []
    whole = network._features
    network._features = lambda levels: calls.append(1) or whole(levels)
    maps = torch.rand(4, 1, 32, 32)
    for _ in range(3):
        network(maps)
    assert len(calls) == 4


def test_the_rate_rises_and_falls_to_nothing(trained: tuple[SavedModel, Path]) -> None:
    options = TrainOptions(rate=0.01, epochs=70, schedule="cosine")
    rates = np.array([options.rate_of(epoch) for epoch in range(70)])
    assert int(rates.argmax()) == 10
    assert rates[10] == pytest.approx(0.01)
    assert rates[40] == pytest.approx(0.005)  # half of the cosine
    assert rates[-1] < 1e-4
    assert rates[0] == pytest.approx(0.01 / 11)
    history = trained[0].card.about["history"]
    assert [each["rate"] for each in history] == pytest.approx([OPTIONS.rate_of(epoch) for epoch in range(EPOCHS)])


def test_changes_come_in_turn_with_the_sample_as_it_is() -> None:
    maps = ridges(6)
    augmenter = Augmenter(SLIDING, maps.size, maps.duration_s, -60.0, seed=0)

    def epoch(number: int) -> np.ndarray:
        return augmenter.of_epoch(number, maps.levels, np.arange(len(maps))[::2])

    np.testing.assert_array_equal(epoch(0), maps.levels[::2])
    np.testing.assert_array_equal(epoch(3), epoch(0))
    np.testing.assert_array_equal(epoch(1), epoch(4))
    assert not np.array_equal(epoch(1), epoch(2))
    assert not np.array_equal(epoch(1), epoch(0))


def test_a_mirrored_map_recedes_where_it_approached() -> None:
    levels = ridges(1).levels[0]
    always = Augmenter(Augment(mirror=1.0), levels.shape, 5.0, -60.0, seed=0)
    np.testing.assert_array_equal(always(levels, np.random.default_rng(0), levels[None]), levels[::-1])
    assert not Augment(variants=3).some


def test_an_ensemble_has_the_mean_of_the_probabilities(trained: tuple[SavedModel, Path]) -> None:
    model, test = trained[0], ridges(5, seed=3)

    class Even(SavedModel):
        def probabilities(self, levels: np.ndarray) -> np.ndarray:
            return np.full((len(levels), 3), 1 / 3)

    even = Even(model.card, model.network)
    found = Ensemble((model, even)).probabilities(test.levels)
    np.testing.assert_allclose(found, 0.5 * (model.probabilities(test.levels) + 1 / 3), atol=1e-6)
    with pytest.raises(InputError, match=r"must be trained on maps alike, got duration 5\.0 and 4\.0"):
        Ensemble((model, SavedModel(model.card.model_copy(update={"duration_s": 4.0}), model.network)))
    with pytest.raises(InputError, match="needs a trained network or more"):
        Ensemble(())


def test_loaded_weights_bring_axes_of_their_own(trained: tuple[SavedModel, Path]) -> None:
    test = ridges(6, seed=4)
    network = build("envelope", 3, test.size)
    network.set_axes(3.0 * test.velocity_mps, 2 * test.duration_s)
    network.train()(torch.from_numpy(1 + test.levels / 60)[:, None])  # keeps features of those axes
    network.load_state_dict(trained[0].network.state_dict())
    found = SavedModel(trained[0].card, network).probabilities(test.levels)
    np.testing.assert_array_equal(found, trained[0].probabilities(test.levels))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"duration_s": 0.8}, r"envelope networks take maps of 1\.2 s or more .* got 0\.8 s in cells of 0\.025 s"),
        ({"duration_s": 60.0}, r"in cells of 0\.7 s at most, .* got 60 s in cells of 1\.9 s"),
        ({"velocity_mps": np.linspace(-2, 8, 32)}, r"the same speeds approaching and receding, got -2 to 8 m/s"),
    ],
)
def test_maps_without_steps_or_of_one_side_are_refused(changes: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    one, other = (replace(ridges(12, seed=seed), **changes) for seed in (0, 1))
    with pytest.raises(InputError, match=sentence):
        train_model("envelope", one, other, TrainOptions(epochs=1, batch=4), output=tmp_path / "mine")
    assert not (tmp_path / "mine").exists()


def test_an_axis_of_fourier_bins_is_of_both_sides() -> None:
    """An even number of them has one more on one side."""
    build("envelope", 3, (32, 32)).set_axes(np.linspace(-4.0, 3.75, 32), 5.0)
