"""The benchmark goes on where it stopped; its verdicts follow from intervals; train, evaluate and predict by their commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import Command
from dataset_folder import recipe, write_dataset
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset
from t2d_rt.dataset.products import edges
from t2d_rt.learn.baselines import Centroids
from t2d_rt.learn.benchmark import SCALES, Scale, cells, cells_of, claims, conditions, run_cells, write_report
from t2d_rt.learn.benchmark.claims import confused_pairs, interval, verdict
from t2d_rt.learn.benchmark.scales import JUDGED
from t2d_rt.learn.train import TrainOptions, train_model

pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")

SMALL = Scale(
    name="tiny", recipes={}, size=16, epochs=1, batch=4, seeds=(0, 1), models=("streaming", "nearest-centroid")
)


def many(**changes: Any) -> Any:
    return recipe(
        descriptions_per_class=4, samples_per_description=2, products={"spectrogram": {"size": [24, 24]}}, **changes
    )


def test_a_stopped_benchmark_goes_on(tmp_path: Path) -> None:
    datasets = {
        "simple": Dataset(write_dataset(tmp_path / "simple", many())),
        "hard": Dataset(write_dataset(tmp_path / "hard", many(seed=1))),
    }
    some = run_cells(SMALL, datasets, tmp_path / "cells", minutes=1e-4)
    assert len(some) < len(cells_of(SMALL)) == 24
    results = run_cells(SMALL, datasets, tmp_path / "cells")
    assert len(results) == 24
    assert results[: len(some)] == some
    alone = run_cells(SMALL, {"hard": datasets["hard"]}, tmp_path / "cells")
    assert alone == [each for each in results if each["set"] == "hard"]
    networks = [each for each in results if each["model"] == "streaming" and "accuracy" in each]
    assert all(each["maps_per_s"] > 0 and np.sum(each["confusion"]) == each["samples"]["test"] for each in networks)
    text = write_report(SMALL, results, 24, tmp_path).read_text()
    assert "| streaming | 0.081 |" in text
    assert (tmp_path / "accuracy.png").stat().st_size > 10_000
    path = tmp_path / "cells" / "simple_file_streaming_0.json"
    stored = path.read_text()
    for damaged in (stored[:50], "[]", json.dumps({"stamp": results[0]["stamp"]}), stored.replace("streaming", "crnn")):
        path.write_text(damaged)
        with pytest.raises(InputError, match="is not what a benchmark wrote there; remove it"):
            run_cells(SMALL, datasets, tmp_path / "cells")
    path.write_text(stored)
    other = Scale(name="tiny", recipes={}, size=16, epochs=2, batch=4, seeds=(0,), models=("streaming",))
    with pytest.raises(InputError, match="of other data or of another scale"):
        run_cells(other, datasets, tmp_path / "cells")
    moved = Dataset(tmp_path / "simple")
    moved.records[0]["sentence"] = moved.records[-1]["sentence"]  # the same maps, of which a split takes others
    with pytest.raises(InputError, match="of other data or of another scale"):
        run_cells(SMALL, datasets | {"simple": moved}, tmp_path / "cells")


def test_a_split_that_leaves_a_side_empty_is_refused_and_the_others_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = cells.sides_of
    monkeypatch.setattr(
        cells, "sides_of", lambda *given, **seed: whole(*given, **seed) | ({"val": []} if given[1] == "file" else {})
    )
    dataset = Dataset(write_dataset(tmp_path / "data", many()))
    quick = Scale(name="tiny", recipes={}, size=16, epochs=1, batch=4, seeds=(0,), models=("nearest-centroid",))
    found = run_cells(quick, {"simple": dataset, "hard": dataset}, tmp_path / "cells")
    refused = {each["by"]: each["refused"] for each in found if "refused" in each}
    assert "the split leaves val empty" in refused["file"]
    assert "accuracy" in next(each for each in found if each["by"] == "description")


def result(set_: str, by: str, model: str, seed: int, accuracy: float) -> dict[str, Any]:
    confusion = [[8, 2, 0, 0], [3, 7, 0, 0], [0, 0, 9, 1], [0, 1, 0, 9]]
    names = ["walking", "abnormal_walking", "falling", "dancing"]
    return {
        "set": set_, "by": by, "model": model, "seed": seed, "accuracy": accuracy, "confusion": confusion, "classes": names,
    }  # fmt: skip


def test_verdicts_follow_from_intervals() -> None:
    rows = []
    for seed, shift in enumerate((0.0, 0.01, -0.01)):
        for number, model in enumerate(("vgg-7", "resnet18", "crnn", "vit-tiny")):
            rows.append(result("simple", "file", model, seed, 0.98 + 0.001 * number))
            rows.append(result("simple", "description", model, seed, 0.97 + shift))
            rows.append(result("hard", "file", model, seed, 0.92 - 0.02 * number + shift))
            rows.append(result("hard", "description", model, seed, 0.60 - 0.05 * number + shift))
    verdicts = [each.verdict for each in claims(rows)]
    assert {each.verdict for each in claims([row for row in rows if row["seed"] < 2])} == {"undecided"}
    # alike; the mean of VGG-7 and ResNet-18 leads by 7.5 points; VGG-7 loses 6 +- 2.5 points; 38 +- 2.5; by file 1.15 +- 2.5 points
    # better on Simple, 39.5 on Hard; pairs 1 and 3
    assert verdicts == ["held", "held", "undecided", "held", "undecided", "held", "held"]
    level = [
        result(name, by, "nearest-centroid", seed, 0.7)
        for seed in range(3)
        for name, by in (("simple", "file"), ("hard", "file"), ("hard", "description"))
    ]
    assert claims(rows + level) == claims(rows)  # the paper claims nothing of our baselines
    two = [row for row in rows if row["model"] in ("vgg-7", "resnet18")]
    assert claims(two)[1].figures.endswith("not run")


def test_intervals_and_pairs_in_closed_form() -> None:
    assert interval([1.0, 2.0, 3.0]) == pytest.approx((2.0, 4.302653 / 3**0.5), rel=1e-5)
    assert interval([1.0, 1.0])[1] == float("inf")
    assert [verdict(*each, 0.0) for each in ((1, 2), (-2, -1), (-1, 1))] == ["held", "refuted", "undecided"]
    (first, part), *_ = confused_pairs(np.array([[8, 2, 0], [4, 6, 0], [0, 0, 10]]), "abc")
    assert (set(first), part) == ({"a", "b"}, 0.3)


def test_scales_name_recipes_that_are_there() -> None:
    for scale in SCALES.values():
        assert scale.recipe("simple").classes == scale.recipe("hard").classes
    cells = cells_of(SCALES["laptop"])
    # nine models by three seeds in three columns that claims are judged by; in the other three the slow four have one seed or none
    assert len(set(cells)) == len(cells) == 9 * 3 * 3 + 3 * 5 * 3 + 4
    assert {(each.set, each.by) for each in cells[: 9 * 3 * 3]} == {*JUDGED}


def test_conditions_are_trained_and_tested_one_by_one(
    tmp_path: Path, run: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conditions, "OPTIONS", TrainOptions(epochs=1, batch=8))
    monkeypatch.setattr(conditions, "SEEDS", (0, 1, 2))
    assert conditions.trainings(("a", "b")) == {"a": ("a",), "b": ("b",), "all": ("a", "b")}
    assert conditions.trainings(("a", "b", "c"))["all but b"] == ("a", "c")
    two = [{"name": "ellipsoids", "method": "ellipsoid"}, {"name": "mesh", "method": "mesh"}]
    data = write_dataset(tmp_path / "data", many(conditions=two, each_condition=True, classes=["walking", "falling"]))
    done = run("benchmark", "conditions", str(data), "-o", str(tmp_path / "found"))
    assert done.code == 0, done.err
    text = (tmp_path / "found" / "conditions.md").read_text()
    assert "| trained on | tested on ellipsoids | tested on mesh |" in text
    assert text.count("| all | ") == 3  # accuracy, false alarms, missed falls
    cells = sorted((tmp_path / "found" / "cells").iterdir())
    assert len(cells) == 9
    told = json.loads(cells[0].read_text())["confusion"]
    assert {name: np.sum(each) for name, each in told.items()} == {"ellipsoids": 4, "mesh": 4}
    before = cells[0].stat().st_mtime_ns
    cells[1].unlink()
    assert run("benchmark", "conditions", str(data), "-o", str(tmp_path / "found")).code == 0
    assert cells[0].stat().st_mtime_ns == before
    cells[1].write_text("{}")
    assert (
        "is not what a benchmark wrote there"
        in run("benchmark", "conditions", str(data), "-o", str(tmp_path / "found")).err
    )
    one = write_dataset(tmp_path / "one", many())
    assert (
        "has one condition only, ellipsoids" in run("benchmark", "conditions", str(one), "-o", str(tmp_path / "x")).err
    )
    assert "takes the folder of a data set, or several" in run("benchmark", "conditions", "-o", str(tmp_path / "x")).err


def test_data_sets_are_conditions_too(tmp_path: Path, run: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conditions, "OPTIONS", TrainOptions(epochs=1, batch=8))
    monkeypatch.setattr(conditions, "SEEDS", (0,))
    seen = []
    monkeypatch.setattr(
        conditions,
        "train_model",
        lambda name, train, val, options: seen.append((train, val)) or train_model(name, train, val, options),
    )
    clean, noisy = (
        str(write_dataset(tmp_path / name, many(classes=["walking", "falling"], noise=noise)))
        for name, noise in (("clean", "none"), ("noisy", "receiver"))
    )
    done = run("benchmark", "conditions", clean, noisy, "-o", str(tmp_path / "found"))
    assert done.code == 0, done.err
    text = (tmp_path / "found" / "conditions.md").read_text()
    assert "# Conditions of clean, noisy" in text
    assert "| trained on | tested on clean | tested on noisy |" in text
    for train, val in seen:  # a sentence of both sets stands on one side
        assert not set(train.groups["description"]) & set(val.groups["description"])
    assert len(seen[2][0]) == len(seen[0][0]) + len(seen[1][0])
    twice = run("benchmark", "conditions", clean, clean, "-o", str(tmp_path / "x"))
    assert "two data sets are in folders that are called clean" in twice.err
    other = str(write_dataset(tmp_path / "other", many(classes=["walking", "sitting"])))
    assert "cannot be joined" in run("benchmark", "conditions", clean, other, "-o", str(tmp_path / "x")).err
    for name in ("all", "all but clean"):
        taken = str(write_dataset(tmp_path / name, many(classes=["walking", "falling"])))
        assert (
            f"a condition is called {name},"
            in run("benchmark", "conditions", clean, taken, "-o", str(tmp_path / "x")).err
        )
    assert not (tmp_path / "x").exists()


def test_folders_alike_but_for_a_space_and_radars_of_other_cells(
    tmp_path: Path, run: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conditions, "OPTIONS", TrainOptions(epochs=1, batch=8))
    monkeypatch.setattr(conditions, "SEEDS", (0,))
    trained = []
    monkeypatch.setattr(
        conditions, "train_model", lambda *given: trained.append(given[1]) or train_model(*given)
    )  # fmt: skip
    spaced, dashed = (
        write_dataset(tmp_path / name, many(classes=["walking", "falling"]), greatest_mps=greatest_mps)
        for name, greatest_mps in (("a b", 4.0), ("a-b", 4.1))
    )
    done = run("benchmark", "conditions", str(spaced), str(dashed), "-o", str(tmp_path / "found"))
    assert done.code == 0, done.err
    assert len(trained) == 3  # each, and both together
    assert edges(trained[0].velocity_mps) == pytest.approx(edges(np.linspace(-4, 4, 24)))  # what both cover


def test_a_model_is_evaluated_on_the_speeds_that_it_was_trained_on(tmp_path: Path, run: Command) -> None:
    narrow, wide, wider = (write_dataset(tmp_path / f"{x}", many(), greatest_mps=x) for x in (4.0, 4.15, 8.0))
    model = str(tmp_path / "model")
    words = ("--model", "streaming", "-o", model, "--epochs", "1", "--batch", "4", "--size", "64")
    assert run("train", str(narrow), *words).code == 0
    assert run("evaluate", str(wide), "--model", model).code == 0
    assert "make it with the same speed_mps" in run("evaluate", str(wider), "--model", model).err


def test_train_evaluate_and_refusals(tmp_path: Path, run: Command) -> None:
    data, model = str(write_dataset(tmp_path / "data", many())), str(tmp_path / "m")
    done = run("train", data, "--model", "streaming", "-o", model, "--epochs", "2", "--batch", "4", "--size", "16")
    assert "split by description, 2 epochs: test accuracy" in done.out
    names = {each.name for each in Path(model).iterdir()}
    assert names >= {"curves.png", "confusion.png", "reliability.png", "card.json", "weights.safetensors"}
    about = json.loads((tmp_path / "m" / "card.json").read_text())["about"]
    assert about["recipe_hash"] == Dataset(data).recipe.hash
    again = run("evaluate", data, "--model", model)
    assert done.out.split("test accuracy")[1].split(",")[0] == again.out.split("accuracy")[1].split(",")[0]
    usual = ("train", data, "--model", "envelope", "-o", f"{model}-usual", "--epochs", "1", "--batch", "4")
    assert run(*usual).code == 0
    assert json.loads(Path(f"{model}-usual", "card.json").read_text())["size"] == [128, 128]  # not the 64 of the others
    for words, sentence in (
        (("train", data), "train needs -o"),
        (
            ("train", data, "--augment", "--sliding", "-o", "x"),
            "--augment and --sliding are two ways to change samples",
        ),
        (("evaluate", data), "evaluate needs --model"),
        (("predict", "walk.zarr", "--model", data), "holds no trained model"),
        (("benchmark", "cells", "-o", "x"), "benchmark compares models"),
        (("train", str(tmp_path), "-o", "x"), "is no data set"),
    ):
        refused = run(*words)
        assert refused.code == 2, words
        assert sentence in refused.err


def test_a_centroid_of_one_sample_per_class_is_still_one() -> None:
    found = Centroids.of(np.array([[0.0, 1.0], [1.0, 1.0]]), np.array([0, 1]))
    np.testing.assert_array_equal(found.labels(np.array([[0.1, 1.0], [0.9, 1.0]])), [0, 1])
