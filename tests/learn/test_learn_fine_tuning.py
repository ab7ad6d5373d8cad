"""Fine-tuning: events of several radars, what each strategy tunes, augmentation; macro-F1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from learn_maps import SPEEDS, TIMES, two_radars
from t2d_rt.core.errors import InputError
from t2d_rt.learn import fine_tuning
from t2d_rt.learn.fine_tuning import STRATEGIES, EventNet, Events, Top, fine_tune, labels_of, pretrain
from t2d_rt.learn.scores import macro_f1


def test_macro_f1_is_that_of_scikit_learn() -> None:
    from sklearn.metrics import f1_score

    rng = np.random.default_rng(1)
    truth, said = rng.integers(0, 4, 50), rng.integers(0, 4, (3, 50))
    expected = [f1_score(truth, each, average="macro") for each in said]
    assert np.allclose(macro_f1(truth, said, 4), expected)


def test_events_pair_the_maps_of_both_radars() -> None:
    found = Events.of(two_radars())
    assert found.levels.shape == (12, 2, SPEEDS, TIMES)
    assert found.radars == ("a", "b")
    assert found.inputs.shape == (12, 2, 64, TIMES)
    assert found.inputs.min() >= 0
    assert found.inputs.max() <= 4.0
    assert np.abs(np.median(found.above_median_db, axis=(2, 3))).max() < 1e-6
    alone = found.seen_by("b")
    assert np.array_equal(alone.levels[:, 0], found.levels[:, 1])
    with pytest.raises(InputError, match="one map by each of 2 radars, got 23"):
        Events.of(two_radars().take(np.arange(23)))
    with pytest.raises(InputError, match="need a group 'event'"):
        Events.of(replace(two_radars(), groups={}))
    with pytest.raises(InputError, match="no radar 'c'"):
        found.seen_by("c")
    with pytest.raises(InputError, match="must cover the same speeds and time"):
        found.same_axes(Events.of(replace(two_radars(), velocity_mps=0.5 * two_radars().velocity_mps)))


def test_a_skip_connection_begins_as_the_pretrained_network() -> None:
    torch.manual_seed(0)
    net = EventNet(3).eval()
    inputs = torch.rand(2, 2, 64, TIMES)
    with torch.no_grad():
        encoded = net.encoded(inputs)
        assert torch.equal(Top(net.penultimate, net.head, beside=True)(encoded), net(inputs))
    # The order of the radars does not matter: one encoder, features averaged.
    with torch.no_grad():
        assert torch.allclose(net(inputs.flip(1)), net(inputs), atol=1e-6)


@pytest.mark.slow
def test_strategies_tune_what_they_say_and_learn_an_easy_task(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = fine_tuning.Schedule(10, 5e-3)
    for name in ("PRETRAINING", "TUNING", "HEADS"):
        monkeypatch.setattr(fine_tuning, name, quick)
    train, test = Events.of(two_radars(6)), Events.of(two_radars(3, seed=9))
    threads = torch.get_num_threads()
    known = pretrain(train)
    before = {name: each.clone() for name, each in known.state_dict().items()}
    tuned = {name: fine_tune(name, known, train, seed=3) for name in STRATEGIES}
    assert all(torch.equal(each, before[name]) for name, each in known.state_dict().items())  # it stays as it is
    for net in tuned.values():
        np.testing.assert_array_equal(labels_of(net, test), test.labels)
    assert torch.equal(pretrain(train).head.weight, known.head.weight)  # bit for bit
    convolutions = [tuned[name].net.encoder[0].weight for name in ("linear probing", "last layer", "skip connection")]
    assert all(torch.equal(each, before["encoder.0.weight"]) for each in convolutions)
    assert not torch.equal(tuned["full fine-tuning"].encoder[0].weight, before["encoder.0.weight"])
    assert torch.equal(tuned["linear probing"].layers.penultimate.weight, before["penultimate.weight"])
    assert not torch.equal(tuned["last layer"].layers.penultimate.weight, before["penultimate.weight"])
    assert not torch.are_deterministic_algorithms_enabled()  # as it was
    assert torch.get_num_threads() == threads
    with pytest.raises(InputError, match="the network tells 3 classes apart, the events are of 2"):
        fine_tune("last layer", EventNet(3), train)
    with pytest.raises(InputError, match="strategy"):
        fine_tune("nosuch", known, train)


def test_augmentation_keeps_power_and_turns_signs_of_single_radars() -> None:
    inputs = torch.rand(64, 2, 64, TIMES)
    found = fine_tuning.augmented(inputs, torch.Generator().manual_seed(0))
    ratio = found.sum(dim=(1, 2, 3)) / inputs.sum(dim=(1, 2, 3))
    assert ratio.min() >= 1 - fine_tuning.GAIN - 1e-5
    assert ratio.max() <= 1 + fine_tuning.GAIN + 1e-5
    profile = found.sum(3) / ratio[:, None, None]
    same = torch.isclose(profile, inputs.sum(3), rtol=1e-3).all(dim=2)
    mirrored = torch.isclose(profile, inputs.sum(3).flip(2), rtol=1e-3).all(dim=2)
    assert bool((same ^ mirrored).all())
    assert 0.3 < float(same.float().mean()) < 0.7
    assert bool((same[:, 0] != same[:, 1]).any())
