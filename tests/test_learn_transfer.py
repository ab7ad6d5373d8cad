"""Transfer: scores, folds, events, ways to tune, the study that goes on, the gap, and the twins' maps."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.learn import gap
from t2d_rt.learn.gap import domain_gap
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.transfer import Events, StudyOptions, methods, run_transfer
from t2d_rt.learn.transfer.cells import Cell, Study
from t2d_rt.learn.transfer.classical import bin_features, extra_trees
from t2d_rt.learn.transfer.network import EventNet, SkipTuned
from t2d_rt.learn.transfer.report import findings
from t2d_rt.learn.transfer.scores import at_most, gain, grouped_folds, macro_f1, with_interval
from t2d_rt.learn.twins import MERGED, SENTENCES, TwinRecipe, make_twins, range_mean_levels, read_twins
from t2d_rt.simulate import simulate
from t2d_rt.types import Ellipsoids, Radar

SPEEDS, TIMES = 64, 32


def maps(per_class: int = 6, *, seed: int = 0, gain_db: float = 15.0, extent: int = 0) -> LabelledMaps:
    """Events by two radars: class 0 lights slow bins, class 1 fast ones; the second radar sees the other sign."""
    rng = np.random.default_rng(seed)
    levels, labels, events = [], [], []
    for event in range(2 * per_class):
        label = event % 2
        for sign in (1, -1):
            found = rng.normal(0, 1, (SPEEDS, TIMES))
            first = 32 + sign * (6 + 8 * label + extent)
            found[min(first, 32) : max(first, 32), 8:24] += gain_db
            levels.append(found - found.max())
            labels.append(label)
            events.append(f"event {event}")
    return LabelledMaps(
        levels=np.array(levels), labels=np.array(labels), classes=("slow", "fast"),
        groups={"event": np.array(events), "radar": np.array(["a", "b"] * (2 * per_class))},
        velocity_mps=np.linspace(-3.1, 3.1, SPEEDS), duration_s=3.0, names=tuple(str(n) for n in range(len(levels))),
    )  # fmt: skip


def test_macro_f1_is_that_of_scikit_learn() -> None:
    from sklearn.metrics import f1_score

    assert np.array_equal(extra_trees(Events.of(maps(6)), Events.of(maps(3, seed=9)), 0), np.arange(6) % 2)
    rng = np.random.default_rng(1)
    truth, said = rng.integers(0, 4, 50), rng.integers(0, 4, (3, 50))
    expected = [f1_score(truth, each, average="macro") for each in said]
    assert np.allclose(macro_f1(truth, said, 4), expected)
    score, low, high = with_interval(truth, said, 4)
    assert score == pytest.approx(np.mean(expected))
    assert low < score < high
    assert with_interval(truth, truth[None], 4) == (1.0, 1.0, 1.0)


def test_folds_hold_whole_events_of_every_class_and_differ_by_seed() -> None:
    labels = np.repeat([0, 1, 2], [19, 7, 7])
    fold = grouped_folds(labels, 5, 0)
    for label in range(3):
        counts = np.bincount(fold[labels == label], minlength=5)
        assert counts.min() >= 1
        assert counts.max() - counts.min() <= 1
    assert np.any(fold != grouped_folds(labels, 5, 1))
    among = np.arange(3, 33)
    chosen = at_most(labels, among, 5, 0)
    assert np.bincount(labels[chosen]).tolist() == [5, 5, 5]
    assert chosen.min() >= 3
    assert at_most(labels, among, 10, 0).size == 10 + 7 + 7  # all there are of those that have fewer


def test_events_pair_the_maps_of_both_radars() -> None:
    found = Events.of(maps())
    assert found.levels.shape == (12, 2, SPEEDS, TIMES)
    assert found.radars == ("a", "b")
    assert found.inputs.shape == (12, 2, 64, TIMES)
    assert found.inputs.min() >= 0
    assert found.inputs.max() <= 4.0
    assert np.abs(np.median(found.above_median_db, axis=(2, 3))).max() < 1e-6
    alone = found.seen_by("b")
    assert np.array_equal(alone.levels[:, 0], found.levels[:, 1])
    assert bin_features(found).shape == (12, 2 * 2 * SPEEDS)
    with pytest.raises(InputError, match="one map by each of 2 radars, got 23"):
        Events.of(maps().take(np.arange(23)))
    with pytest.raises(InputError, match="need a group 'event'"):
        Events.of(LabelledMaps(**{**vars_of(maps()), "groups": {}}))
    with pytest.raises(InputError, match="no radar 'c'"):
        found.seen_by("c")


def vars_of(found: LabelledMaps) -> dict:
    return {name: getattr(found, name) for name in found.__slots__}


def test_a_skip_connection_begins_as_the_pretrained_network() -> None:
    torch.manual_seed(0)
    net = EventNet(3).eval()
    inputs = torch.rand(2, 2, 64, TIMES)
    with torch.no_grad():
        encoded = net.encoded(inputs)
        assert torch.equal(SkipTuned(net)(encoded), net(inputs))
    # The order of the radars does not matter: one encoder, features averaged.
    with torch.no_grad():
        assert torch.allclose(net(inputs.flip(1)), net(inputs), atol=1e-6)


def test_methods_tune_what_they_say_and_learn_an_easy_task(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = methods.Schedule(10, 5e-3)
    for name in ("PRETRAINING", "TUNING", "HEADS"):
        monkeypatch.setattr(methods, name, quick)
    train, test = Events.of(maps(6)), Events.of(maps(3, seed=9))
    known = methods.pretrained(train, 0)
    before = {name: each.clone() for name, each in known.state_dict().items()}
    scores = {}
    for name in methods.METHODS:
        said = methods.tuned_labels(name, known, train, test, 3)
        scores[name] = float(np.mean(said == test.labels))
    assert all(torch.equal(each, before[name]) for name, each in known.state_dict().items())  # it stays as it is
    assert min(scores[name] for name in ("linear probing", "last layer", "skip connection", "full fine-tuning")) == 1.0
    again = [methods.pretrained(train, 0).head.weight, known.head.weight]
    assert torch.equal(*again)  # bit for bit
    top = methods._Top(known, new_head=True, frozen=True)
    encoded, labels = known.encoded(torch.from_numpy(train.inputs)).detach(), torch.from_numpy(train.labels)
    methods.fitted(top, encoded, labels, quick, 0, augment=False)
    assert torch.equal(top.penultimate.weight, before["penultimate.weight"])


def test_augmentation_keeps_power_and_turns_signs_of_single_radars() -> None:
    inputs = torch.rand(64, 2, 64, TIMES)
    found = methods.augmented(inputs, torch.Generator().manual_seed(0))
    ratio = found.sum(dim=(1, 2, 3)) / inputs.sum(dim=(1, 2, 3))
    assert ratio.min() >= 1 - methods.GAIN - 1e-5
    assert ratio.max() <= 1 + methods.GAIN + 1e-5
    profile = found.sum(3) / ratio[:, None, None]
    same = torch.isclose(profile, inputs.sum(3), rtol=1e-3).all(dim=2)
    mirrored = torch.isclose(profile, inputs.sum(3).flip(2), rtol=1e-3).all(dim=2)
    assert bool((same ^ mirrored).all())
    assert 0.3 < float(same.float().mean()) < 0.7
    assert bool((same[:, 0] != same[:, 1]).any())


def test_a_study_writes_its_report_goes_on_and_refuses_other_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PRETRAINING", "TUNING", "HEADS"):
        monkeypatch.setattr(methods, name, methods.Schedule(1, 1e-3))
    monkeypatch.setattr("t2d_rt.learn.transfer.classical.TREES", 5)
    real, simulated = maps(4), maps(5, seed=4)
    options = StudyOptions(repeats=1, folds=2)
    monkeypatch.setattr("t2d_rt.learn.transfer.cells.EVENTS_PER_CLASS", (2, None))
    torch.use_deterministic_algorithms(False)
    text = run_transfer(real, simulated, tmp_path / "study", options=options, sources={"real": "made here"})
    assert not torch.are_deterministic_algorithms_enabled()  # as it was
    assert "| zero-shot (no real event) | both |" in text
    assert "made here" in text
    assert "full fine-tuning" in text
    assert (tmp_path / "study" / "curves.png").read_bytes()[:4] == b"\x89PNG"
    files = sorted((tmp_path / "study" / "cells").glob("*.json"))
    cell = json.loads(files[0].read_text())
    assert len(cell["predicted"]) == 8
    assert len(files) == 3 + 1 + 1 + 12
    lost = tmp_path / "study" / "cells" / "full-fine-tuning_both_2_0.json"
    kept, stamp = lost.read_bytes(), files[0].stat().st_mtime_ns
    lost.unlink()
    run_transfer(real, simulated, tmp_path / "study", options=options)
    assert lost.read_bytes() == kept
    assert files[0].stat().st_mtime_ns == stamp
    run_transfer(real, simulated, tmp_path / "study", options=StudyOptions(repeats=2, folds=2))  # more of the same
    assert len(list((tmp_path / "study" / "cells").glob("*.json"))) == 2 * len(files)
    assert files[0].stat().st_mtime_ns == stamp
    weights, stored = tmp_path / "study" / "pretrained_0.safetensors", lost.read_bytes()
    lost.write_bytes(stored[:30])
    with pytest.raises(InputError, match="is not what a study wrote there; remove it"):
        run_transfer(real, simulated, tmp_path / "study", options=options)
    lost.write_bytes(files[0].read_bytes())  # another cell's
    with pytest.raises(InputError, match="is not what a study wrote there; remove it"):
        run_transfer(real, simulated, tmp_path / "study", options=options)
    lost.unlink()
    weights.write_bytes(weights.read_bytes()[:500])
    with pytest.raises(InputError, match=r"holds no weights of this study .*; remove it"):
        run_transfer(real, simulated, tmp_path / "study", options=options)
    slower = replace(simulated, velocity_mps=0.5 * simulated.velocity_mps)
    for compare in (
        lambda: run_transfer(real, slower, tmp_path / "other", options=options),
        lambda: domain_gap(slower, real),
    ):
        with pytest.raises(InputError, match="must cover the same speeds and time"):
            compare()
    assert not (tmp_path / "other").exists()
    with pytest.raises(InputError, match="holds another study"):
        run_transfer(real, maps(5, seed=5), tmp_path / "study", options=options)
    with pytest.raises(InputError, match="5 folds need as many real events"):
        run_transfer(real, simulated, tmp_path / "other", options=StudyOptions(folds=5))


def test_no_event_is_tuned_on_and_tested(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[set[str], set[str]]] = []

    def spy(train: Events, test: Events, seed: int) -> np.ndarray:
        seen.append((set(train.names), set(test.names)))
        return test.labels

    monkeypatch.setattr("t2d_rt.learn.transfer.cells.extra_trees", spy)
    real = Events.of(maps(6))
    study = Study(real, Events.of(maps(6, seed=1)), tmp_path, StudyOptions(repeats=1, folds=3))
    study.labels(Cell(method="extra trees", per_class=2, radars="both", repeat=0))
    assert len(seen) == 3
    assert all(not train & test and len(train) == 4 for train, test in seen)
    assert set().union(*(test for _, test in seen)) == set(real.names)


def test_findings_claim_nothing_finer_than_eight_points_or_within_the_interval() -> None:
    truth = np.repeat([0, 1], 50)

    def said(wrong: int) -> np.ndarray:
        """Predictions of which so many in a hundred are wrong, half in each class."""
        found = truth.copy()
        found[: wrong // 2] = 1
        found[50 : 50 + (wrong + 1) // 2] = 0
        return np.stack([truth[None], found[None]])

    def told(first: str, wrong: int, second: str, others: int, count: int | None = 5) -> str:
        return findings({f"{first}, both, {count}": said(wrong), f"{second}, both, {count}": said(others)}, 2)[0]

    assert "+0.06 [+0.02, +0.11], undecided" in told("last layer", 20, "from scratch", 26)  # too fine
    assert "+0.20" in (far := told("last layer", 20, "from scratch", 40))
    assert far.endswith("better.")
    assert told("full fine-tuning", 40, "extra trees", 20, None).endswith("worse.")
    zero = findings({"zero-shot, both, 0": said(44)}, 2)
    assert "Zero-shot: 0.56" in zero[0]
    assert "not surely above chance (0.50)" in zero[0]
    assert "missed" in zero[0]
    score, low, high = gain(truth, said(20)[1], said(20)[1], 2)
    assert (score, low, high) == (0.0, 0.0, 0.0)


def test_gap_finds_what_differs_and_does_not_tell_equal_sets_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gap, "TREES", 30)
    real, alike, wider = maps(12), maps(12, seed=5), maps(12, seed=6, extent=8)
    none = domain_gap(alike, real).classes[0]
    assert none.told_apart[1] < 0.62
    assert "no measure" in none.lacking
    far = domain_gap(wider, real)
    assert far.classes[1].told_apart[1] > 0.9
    extent = far.classes[1].differences[0]
    assert extent.measure.startswith("extent")
    assert extent.distance > 0.9
    assert extent.simulated[1] > extent.real[1]
    assert "too much extent" in str(far)
    with pytest.raises(InputError, match="10 of each are needed"):
        domain_gap(maps(4), real)


def test_an_approaching_sphere_is_at_a_positive_bin_of_the_right_speed() -> None:
    radar = Radar(
        carrier_hz=77e9, slope_hz_per_s=31.25e12, sample_rate_hz=2e6, samples=64, prf_hz=6600.0, chirps_per_frame=128,
        frame_interval_s=0.09,
    )  # fmt: skip
    times = np.linspace(0, 0.3, 31)
    centres = np.stack([3.0 - 2.0 * times, np.zeros(31), np.ones(31)], axis=-1)[:, None]
    sphere = Ellipsoids(np.full((1, 3), 0.1), centres, times)
    recording = simulate(sphere, radar=radar, method="ellipsoid", progress=False)
    levels = range_mean_levels(np.asarray(recording.adc.values)[:, 0])
    bin_mps = 299_792_458.0 / 77.5e9 * 6600.0 / 2.0 / 128
    assert np.all(np.abs(np.argmax(levels, axis=1) - 64 - 2.0 / bin_mps) <= 1.0)


def test_twins_are_made_resumed_and_read(tmp_path: Path) -> None:
    recipe = TwinRecipe(per_class=1, classes=("sit down", "stand up"), scene="free_space")
    folder = make_twins(recipe, tmp_path / "twins")
    first = (folder / "00000.npz").read_bytes()
    (folder / "00001.npz").unlink()
    make_twins(recipe, folder)
    assert (folder / "00000.npz").read_bytes() == first
    assert (folder / "00001.npz").exists()
    found = read_twins(folder)
    assert found.classes == ("sit down", "stand up")
    assert found.levels.shape == (4, 128, 56)
    assert found.levels.max() == 0
    assert Events.of(found).radars == ("wr14", "wr68")
    assert read_twins(folder, MERGED).classes == ("sit or stand",)
    for stored in (
        {"levels": np.zeros((2, 9, 128)), "label": "fall"},
        {"levels": np.zeros((2, 56, 128)), "label": "hop"},
        {},
    ):
        np.savez(folder / "00001.npz", **stored)  # type: ignore[arg-type]
        with pytest.raises(InputError, match=r"00001\.npz is no twin .*; remove it and make it again"):
            read_twins(folder)
    (folder / "00001.npz").unlink()
    with pytest.warns(T2DWarning, match="holds 1 of 2 twins"):
        read_twins(folder)
    with pytest.raises(InputError, match="twins of another recipe"):
        make_twins(TwinRecipe(per_class=1, seed=1), folder)
    with pytest.raises(InputError, match="holds no twins"):
        read_twins(tmp_path)
    with pytest.raises(InputError, match="no class 'hop'"):
        TwinRecipe(classes=("hop",))
    (folder / "twins.json").write_text("{}")
    with pytest.raises(InputError, match="is no recipe of twins"):
        read_twins(folder)


def test_twins_that_could_not_be_made_do_not_take_the_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown scene 'nosuch'"):
        make_twins(TwinRecipe(per_class=1, classes=("sit down",), scene="nosuch"), tmp_path / "twins")
    make_twins(TwinRecipe(per_class=1, classes=("sit down",), scene="free_space"), tmp_path / "twins")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make the folder"):
        make_twins(TwinRecipe(per_class=1), tmp_path / "file")
    assert set(MERGED) == set(SENTENCES)
