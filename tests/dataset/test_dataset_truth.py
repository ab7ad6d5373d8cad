"""The product `truth` of a data set: made with the samples, stored, exported and read back."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import t2d_rt as t2d
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import TRUTH_COLUMNS, Dataset, Recipe, export_dataset, make_dataset, sample
from t2d_rt.dataset.products import Products
from t2d_rt.dataset.worker import make_sample

RATE_HZ = 20.0


def tiny(**products: Any) -> Recipe:
    return Recipe(
        name="tiny", classes=["bending", "walking"], descriptions_per_class=1, samples_per_description=1, duration_s=0.8,
        radar=t2d.Radar.preset("ci4r", samples=64, prf_hz=6400), conditions=[{"name": "ellipsoids", "method": "ellipsoid"}],
        attempts=1, products={"spectrogram": {"size": [8, 8]}, **products},
    )  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("truth") / "tiny"
    make_dataset(tiny(truth={"rate_hz": RATE_HZ}), folder, workers=1)
    return folder


def test_truth_of_a_sample_is_that_of_its_recording(made: Path) -> None:
    data = Dataset(made)
    rows = data.values(1, "truth")
    assert rows.shape == (16, len(TRUTH_COLUMNS)) == (16, 157)
    assert rows.dtype == np.float32
    column = {name: rows[:, number] for number, name in enumerate(TRUTH_COLUMNS)}
    np.testing.assert_allclose(column["time_s"], np.arange(16) / RATE_HZ, atol=1e-7)
    truth = t2d.run(sample(data.recipe, 1).experiment).truth_at(column["time_s"]).isel(person=0)
    for joint, axis in (("left_foot", "forward"), ("head", "up"), ("right_wrist", "left")):
        expected = truth.joints_m.sel(joint=joint, xyz=axis)
        np.testing.assert_allclose(column[f"{joint}_{axis}_m"], expected, atol=1e-5)
    np.testing.assert_allclose(
        column["left_foot_speed_mps"], truth.segment_speed_mps.sel(segment="left_foot"), atol=1e-3
    )
    np.testing.assert_allclose(column["chest_visible"], truth.segment_visible.sel(segment="chest"), atol=1e-5)
    assert np.array_equal(column["right_ball_stands"], truth.contact.sel(foot="right", part="ball"))
    assert truth.made_for.item() == data.records[1]["class"] == "walking"
    told = data.records[1]["products"]["truth"]
    does = truth.activity.values.tolist()
    assert [name for name, _ in told["activities"]] == list(dict.fromkeys(does))
    assert all(does[round(begin_s * RATE_HZ)] == name for name, begin_s in told["activities"])
    assert column["head_up_m"].mean() > column["pelvis_up_m"].mean() + 0.4


def test_every_record_tells_activities_and_breathing(made: Path) -> None:
    data = Dataset(made)
    for index, record in enumerate(data.records):
        motion = sample(data.recipe, index).cut.motion
        assert record["activities"] == [[name, pytest.approx(begin_s, abs=1e-6)] for name, begin_s in motion.activities]
        assert record["breathing"] == asdict(motion.breathing)
        rows = data.values(index, "truth")
        assert rows[:, -1] == pytest.approx(motion.breathing.displacement_m(rows[:, 0]), abs=1e-7)


def test_truth_without_visible_fractions_has_the_other_columns() -> None:
    recipe = tiny(truth={"rate_hz": RATE_HZ, "visible": False})
    found = make_sample(recipe, {}, 1)
    assert found.record["failure"] is None
    assert found.arrays["truth"].shape == (16, len(recipe.products.kept["truth"].columns)) == (16, 140)
    assert tiny(truth={}).hash == tiny(truth={"visible": True}).hash != tiny(truth={"visible": False}).hash


@pytest.mark.parametrize("to", ["npz", "parquet"])
def test_exports_hold_the_same_truth(made: Path, tmp_path: Path, to: Any) -> None:
    data = Dataset(made)
    export_dataset(data, tmp_path / to, to)
    if to == "npz":
        with np.load(tmp_path / to / "all.npz", allow_pickle=False) as file:
            assert file["truth_columns"].tolist() == list(TRUTH_COLUMNS)
            assert np.array_equal(file["truth_1"], data.array(1, "truth"))
        return
    again = Dataset(tmp_path / to)
    assert np.array_equal(again.array(1, "truth"), data.array(1, "truth"))
    (file,) = (tmp_path / to / "data").glob("*.parquet")
    assert np.array_equal(np.array(pq.read_table(file)["truth"][0].as_py(), np.float32), data.array(0, "truth"))
    card = (tmp_path / to / "README.md").read_text()
    assert "`truth`: float32, (time, 157) of the labelled person at 20 Hz" in card


def test_tensors_of_truth_have_one_length(made: Path) -> None:
    torch = pytest.importorskip("torch")
    from t2d_rt.dataset import TorchDataset

    tensor, label = TorchDataset(made, "truth", length=20)[0]
    assert tensor.shape == (20, 157)
    assert torch.equal(tensor[16:], torch.zeros(4, 157))
    assert label == 0


def test_recipes_without_truth_keep_their_hash() -> None:
    """Seeds follow from the hash: what is absent is not hashed."""
    assert tiny().hash == tiny(truth=None).hash != tiny(truth={}).hash
    before = Recipe.read("small-hard").model_copy(update={"products": Products(), "subjects": None})
    assert before.hash == "0faa56acad90d519f8140dd537407aac"


def test_rates_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="rate_hz"):
        tiny(truth={"rate_hz": 0})
