"""The product `parts` of a data set: powers by limb that add up to the spectrogram, stored, checked, exported and read back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import t2d_rt as t2d
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset, Recipe, check_dataset, export_dataset, make_dataset, sample, summarise
from t2d_rt.dataset.products import PARTS, Products, resized
from t2d_rt.dataset.shards import archive, read_record
from t2d_rt.signal.range import taper

RADAR = t2d.Radar.preset("table2", samples=64, prf_hz=6400)
SUM_DB = -60.0
"""The aim is -40 dB."""
ROOM: dict[str, Any] = {"name": "room", "method": "ellipsoid", "scene": "empty_room", "reflections": 1}


def tiny(method: str = "ellipsoid", parts: Any = None, **changes: Any) -> Recipe:
    values: dict[str, Any] = {
        "name": "tiny", "classes": ["bending", "walking"], "descriptions_per_class": 1, "samples_per_description": 1,
        "duration_s": 0.7, "radar": RADAR, "conditions": [{"name": method, "method": method}], "attempts": 1,
        "products": {"spectrogram": {"size": [32, 16]}, "parts": parts or {"size": [16, 8]}},
    }  # fmt: skip
    return Recipe(**values | changes)


def made(folder: Path, recipe: Recipe, **options: Any) -> Dataset:
    assert not make_dataset(recipe, folder, workers=1, **options).failures
    assert check_dataset(folder) == []
    return Dataset(folder)


def check_sum(data: Dataset, place: int) -> None:
    """The parts' sum against the map: energy of the difference, and each cell, which the map has in steps of 0.06 dB at most."""
    parts = data.values(place, "parts").astype(np.float64).sum(axis=0)
    power = resized(10.0 ** (data.values(place, "spectrogram").astype(np.float64) / 10.0), parts.shape)
    assert 10.0 * np.log10(np.sum((parts - power) ** 2) / np.sum(power**2)) < SUM_DB
    strong = power > 1e-4 * power.max()
    assert np.abs(10.0 * np.log10(parts[strong] / power[strong])).max() < 0.03


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return made(tmp_path_factory.mktemp("parts") / "tiny", tiny())


def test_parts_add_up_to_the_map(walk: Dataset) -> None:
    assert walk.parts == (
        "head", "trunk", "arms", "thighs", "shanks", "feet", "beside", "other", "receiver", "background",
    )  # fmt: skip
    for place in range(len(walk)):
        found = walk.values(place, "parts")
        assert found.shape == (10, 16, 8)
        assert found.dtype == np.float32
        check_sum(walk, place)
        told = walk.records[place]["products"]
        assert all(told["parts"][name] == told["spectrogram"][name] for name in ("velocity_mps", "time_s", "peak_db"))
        assert np.all(found[:5].sum(axis=(1, 2)) > 0)
        assert found[5].any()  # of feet that stand the sum may be negative
        assert not found[[6, 7, 9]].any()  # nothing beside, no scene, no background


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("mesh", {"method": "mesh", "classes": ["walking"]}),
        (
            "all", {
                "conditions": [ROOM | {"beside": "person"}], "classes": ["walking"],
                "masks": {"windows": 2, "shortest_s": 0.25, "longest_s": 0.4},
                "background": "default", "background_level_db": -125.0,
            },
        ),
        (
            "paths", {
                "conditions": [ROOM], "classes": ["walking"], "noise": "none", "parts": {"split": "path", "size": [32, 16]},
            },
        ),
    ],
)  # fmt: skip
def test_parts_of_every_kind_of_echo_add_up(tmp_path: Path, name: str, changes: dict[str, Any]) -> None:
    data = made(tmp_path / name, tiny(**changes))
    check_sum(data, 0)
    powers = dict(zip(data.parts, np.abs(data.values(0, "parts")).sum(axis=(1, 2)), strict=True))
    silent = {"mesh": {"beside", "other", "background"}, "all": set(), "paths": {"receiver", "background"}}[name]
    assert {each for each, power in powers.items() if not power} == silent
    if name == "all":
        told = data.records[0]["products"]["spectrogram"]
        occluded = np.array(told["masks_s"])
        edges = np.linspace(*told["time_s"], 9)
        begin, end = edges[:-1, None] + 0.03, edges[1:, None] - 0.03
        hidden = np.any((occluded[:, 0] < begin) & (occluded[:, 1] > end), axis=1)
        assert any(hidden)
        assert not data.values(0, "parts")[:9, :, hidden].any()


def test_contributions_are_those_of_definition() -> None:
    """Re(S_p S*) by its own short-time spectra, of parts that interfere; the receiver's is what is left."""
    recipe = tiny()
    experiment = sample(recipe, 1).experiment
    found = t2d.run(experiment, split="segment").processed(mti="mean")
    added = found.parts.grouped().contributions
    assert added.units == "W"
    assert set(added.part.values) == {*PARTS["segment"][:6], "receiver"}
    whole = 10.0 ** (found.spectrogram.values.astype(float) / 10.0)
    np.testing.assert_allclose(added.sum("part"), whole, rtol=1e-6)
    window = taper("hann", RADAR.samples)
    cubes = {name: np.asarray(each, complex) for name, each in found.parts.grouped().cubes.items()}
    cells = {name: (each - each.mean(axis=0)) * window for name, each in cubes.items()}
    column, slow = 20, taper("hann", 256, periodic=True)
    spectra = {
        name: np.fft.fft(each[column * 56 : column * 56 + 256, 0] * slow[:, None], axis=0)
        for name, each in cells.items()
    }
    total = np.sum([*spectra.values()], axis=0)
    expected = {name: np.sum((each * total.conj()).real, axis=1) for name, each in spectra.items()}
    expected = {name: np.fft.fftshift(each)[::-1] / np.sum(window**2) for name, each in expected.items()}
    for name, each in expected.items():
        got = added.sel(part=name).isel(time_s=column).values
        assert np.abs(got - each).max() < 2e-6 * whole[:, column].max()
    assert min(each.min() for each in expected.values()) < 0  # parts that cancel one another


def test_recipes_without_parts_keep_their_text_and_hash() -> None:
    plain = tiny(products={"spectrogram": {"size": [32, 16]}})
    assert "parts" not in plain.to_yaml()
    assert plain.hash != tiny().hash
    assert Recipe.model_validate(json.loads(tiny().model_dump_json())) == tiny()
    before = Recipe.read("small-hard").model_copy(
        update={"products": Products(), "subjects": None}
    )  # without a range gate, too
    assert before.hash == "0faa56acad90d519f8140dd537407aac"


@pytest.mark.parametrize(
    ("products", "told"),
    [
        ({"spectrogram": None, "adc": {}, "parts": {}}, "give spectrogram, too"),
        ({"spectrogram": {"size": [64, 64]}, "parts": {"size": [48, 32]}}, r"must divide that of the spectrogram, \[64, 64\]"),
        ({"parts": {"split": "target"}}, "split"),
    ],
)  # fmt: skip
def test_parts_that_cannot_be_are_refused(products: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        tiny(products=products)


@pytest.mark.slow  # processes
def test_workers_and_stopped_runs_give_the_same_bits(tmp_path: Path, walk: Dataset) -> None:
    make_dataset(tiny(), tmp_path / "again", workers=1, limit=1)
    make_dataset(tiny(), tmp_path / "again", workers=2)
    for name in ("00000.npz", "00000.jsonl"):
        assert (tmp_path / "again" / "shards" / name).read_bytes() == (walk.path / "shards" / name).read_bytes()


def test_shards_of_others_are_checked(tmp_path: Path, walk: Dataset) -> None:
    line = dict(walk.records[0])
    for key, value in (("peak_db", 0.0), ("time_s", [0.0, 9.0]), ("names", ["head"])):
        told = {**line, "products": {**line["products"], "parts": {**line["products"]["parts"], key: value}}}
        with pytest.raises(InputError, match=f"{key} of parts must be"):
            read_record(walk.recipe, json.dumps(told))
    folder = tmp_path / "other"
    data = made(folder, tiny())
    path = folder / "shards" / "00000.npz"
    with np.load(path) as file:
        arrays = dict(file)
    (folder / "manifest.json").unlink()
    arrays["parts"] = arrays["parts"] * 0.9
    path.write_bytes(archive(arrays))
    assert any("do not add up to its spectrogram" in each for each in check_dataset(folder))
    arrays["parts"] = arrays["parts"] * 30.0
    path.write_bytes(archive(arrays))
    with pytest.raises(InputError, match=r"do not add up to 0\.\.1"):
        Dataset(folder).values(0, "parts")
    arrays["parts"] = arrays["parts"][:, :3]
    path.write_bytes(archive(arrays))
    with pytest.raises(InputError, match=r"parts must be float32 of shape \(2, 10, 16, 8\)"):
        Dataset(folder).values(0, "parts")
    assert data.parts


@pytest.mark.parametrize("to", ["npz", "parquet"])
def test_exports_hold_the_same_parts(walk: Dataset, tmp_path: Path, to: Any) -> None:
    export_dataset(walk, tmp_path / to, to)
    if to == "npz":
        with np.load(tmp_path / to / "all.npz", allow_pickle=False) as file:
            assert file["part_names"].tolist() == [*walk.parts]
            assert np.array_equal(file["parts"][1], walk.array(1, "parts"))
            assert np.array_equal(file["parts_time_s"], file["spectrogram_time_s"])
        return
    again = Dataset(tmp_path / to)
    assert np.array_equal(again.array(1, "parts"), walk.array(1, "parts"))
    (file,) = (tmp_path / to / "data").glob("*.parquet")
    assert np.array_equal(np.array(pq.read_table(file)["parts"][0].as_py(), np.float32), walk.array(0, "parts"))
    card = (tmp_path / to / "README.md").read_text()
    assert "`parts`: float32, (part, speed, time), what head, trunk, arms" in card


def test_parts_as_targets_of_tensors_and_in_views(walk: Dataset) -> None:
    torch = pytest.importorskip("torch")
    from t2d_rt.dataset import TorchDataset

    image, target = TorchDataset(walk, "spectrogram", dynamic_range_db=40, target="parts")[1]
    assert image.shape == (32, 16)
    assert torch.equal(target, torch.from_numpy(walk.values(1, "parts")))
    assert TorchDataset(walk, "parts")[1][0].shape == (10, 16, 8)
    with pytest.raises(InputError, match="length would cut the map"):
        TorchDataset(walk, "spectrogram", target="parts", length=8)
    view = walk.to_xarray("parts")
    assert view.parts.dims == ("sample", "part", "velocity_mps", "time_s")
    assert view.parts.sel(part="feet").shape == (2, 16, 8)
    assert view.parts.units == "1"
    assert np.array_equal(view.parts.values[1], walk.values(1, "parts"))
    assert "power by part: head" in str(summarise(walk))
