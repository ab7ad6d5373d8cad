"""`t2d-rt train` and `evaluate` by their commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from command_line import Command
from dataset_folder import recipe, write_dataset
from t2d_rt.dataset import Dataset

pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")


def many(**changes: Any) -> Any:
    return recipe(
        descriptions_per_class=4, samples_per_description=2, products={"spectrogram": {"size": [24, 24]}}, **changes
    )


@pytest.mark.slow
def test_a_model_is_evaluated_on_the_speeds_that_it_was_trained_on(tmp_path: Path, run: Command) -> None:
    narrow, wide, wider = (write_dataset(tmp_path / f"{x}", many(), greatest_mps=x) for x in (4.0, 4.15, 8.0))
    model = str(tmp_path / "model")
    words = ("--model", "streaming", "-o", model, "--epochs", "1", "--batch", "4", "--size", "64")
    assert run("train", str(narrow), *words).code == 0
    assert run("evaluate", str(wide), "--model", model).code == 0
    assert "make it with the same speed_mps" in run("evaluate", str(wider), "--model", model).err


@pytest.mark.slow
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
    other = f"{model}-other"
    assert (
        run(
            "train", data, "--model", "streaming", "-o", other, "--epochs", "1", "--batch", "4", "--size", "16", "--seed",
            "5",
        ).code
        == 0
    )  # fmt: skip
    apart = [
        set(json.loads(Path(each, "card.json").read_text())["about"]["indices"]["test"]) for each in (model, other)
    ]
    both = run("evaluate", data, "--model", f"{model},{other}")
    shared = len(apart[0] & apart[1])
    assert f", {shared} samples" in both.out if shared else "no sample" in both.err, both
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
        (("train", str(tmp_path), "-o", "x"), "is no data set"),
    ):
        refused = run(*words)
        assert refused.code == 2, words
        assert sentence in refused.err
