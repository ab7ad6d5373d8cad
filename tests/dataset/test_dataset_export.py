"""Reading a data set as a value, as xarray and as tensors; exports to parquet, PNG and npz give the same numbers back."""

from __future__ import annotations

import csv
import json
import pickle
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dataset_folder import recipe, write_dataset
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset, export_dataset, read_shards, split
from t2d_rt.dataset.splits import Split

FAILED = 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 samples of two classes in three shards, of which one failed."""
    return write_dataset(tmp_path_factory.mktemp("data") / "tiny", failed=(FAILED,))


@pytest.fixture
def dataset(folder: Path) -> Dataset:
    return Dataset(folder)


@pytest.fixture(scope="module")
def parquet(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra [export])")
    source = Dataset(folder)
    return export_dataset(
        source, tmp_path_factory.mktemp("out") / "parquet", "parquet", split=split(source.records, (0.5, 0.5))
    )


def same(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


# --- The data set as a value ---


def test_arrays_are_those_of_the_shards(dataset: Dataset) -> None:
    stored = [pair for shard in read_shards(dataset.path) for pair in shard.samples()]
    assert len(dataset) == len(stored) == 11
    assert [each["index"] for each in dataset.failed] == [FAILED]
    for place, (record, arrays) in enumerate(stored):
        assert dataset.records[place] == record
        assert all(same(dataset.array(place, name), array) for name, array in arrays.items())


def test_values_have_units(dataset: Dataset) -> None:
    levels = dataset.values(3, "range_doppler")
    assert levels.dtype == np.float32
    assert levels.max() == 0
    np.testing.assert_allclose(levels, dataset.array(3, "range_doppler") * (40 / 255) - 40, atol=1e-5)
    parts = dataset.array(3, "adc")
    np.testing.assert_array_equal(dataset.values(3, "adc"), (parts[..., 0] + 1j * parts[..., 1].astype(np.float32)) * 8)


def test_labels_and_places(dataset: Dataset) -> None:
    assert dataset.classes == ("walking", "bending")
    assert [dataset.classes[label] for label in dataset.labels] == [each["class"] for each in dataset.records]
    np.testing.assert_array_equal(dataset.positions([0, 5, 11]), [0, 4, 10])
    with pytest.raises(InputError, match=r"holds no sample 4 \(1 such indices\)"):
        dataset.positions([0, FAILED])
    with pytest.raises(InputError, match="unknown product 'spectrum'"):
        dataset.array(0, "spectrum")  # type: ignore[arg-type]


def test_few_shards_are_kept_and_none_is_copied(folder: Path) -> None:
    few = Dataset(folder, cached_mb=1e-6)
    copied = pickle.dumps(few)
    first = few.array(0, "spectrogram")
    few.array(10, "spectrogram")
    first[:] = 7  # one's own copy
    assert same(few.array(0, "spectrogram"), Dataset(folder).array(0, "spectrogram"))
    assert len(pickle.dumps(few)) < len(copied) + 1000  # no array with it
    assert len(few._reader._kept._values) == 1  # type: ignore[attr-defined]
    assert same(pickle.loads(copied).array(5, "adc"), few.array(5, "adc"))


def test_no_data_set_and_an_empty_one_are_refused(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(InputError, match="is no data set"):
        Dataset(tmp_path)
    (tmp_path / "recipe.yaml").write_bytes((folder / "recipe.yaml").read_bytes())
    (tmp_path / "shards").mkdir()
    with pytest.raises(InputError, match="holds no finished sample yet"):
        Dataset(tmp_path)


def test_a_view_as_xarray_reads_what_is_asked_for(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    view = dataset.to_xarray("spectrogram")
    read: list[int] = []
    values = dataset.values
    monkeypatch.setattr(dataset, "values", lambda place, product: read.append(place) or values(place, product))
    assert view.spectrogram.dims == ("sample", "velocity_mps", "time_s")
    assert same(view.spectrogram[3].values, values(3, "spectrogram"))
    assert read == [3]
    chosen = view.isel(sample=view.label.values == 1).sel(velocity_mps=slice(0, None)).spectrogram.values
    assert same(chosen[2], values(4, "spectrogram")[8:])
    np.testing.assert_allclose(np.diff(view.time_s), 5 / 24)
    assert view.snr_db.values.tolist() == [each["snr_db"] for each in dataset.records]
    assert dataset.to_xarray("range_doppler").range_doppler.dims == ("sample", "frame", "velocity_mps", "range_m")
    with pytest.raises(InputError, match="points differ in size from sample to sample"):
        dataset.to_xarray("points")


# --- Exports ---


def test_parquet_holds_the_same_numbers(dataset: Dataset, parquet: Path) -> None:
    back = Dataset(parquet)
    assert back.records == dataset.records
    assert back.classes == dataset.classes
    for place in range(len(dataset)):
        for name in dataset.products:
            assert same(back.array(place, name), dataset.array(place, name)), name
    card = (parquet / "README.md").read_text()
    assert "path: data/train-*.parquet" in card
    assert "No description, clip or seed is on two sides." in card
    assert "velocity -4.267 to 4.267 m/s" in card


def test_the_card_tells_of_mixed_kernels(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra [export])")
    mixed = shutil.copytree(folder, tmp_path / "mixed")
    manifest = json.loads((mixed / "manifest.json").read_text())
    kinds = ["abacus, OpenBLAS Haswell, NumPy AVX2", "abacus, OpenBLAS SkylakeX, NumPy AVX512_SPR"]
    (mixed / "manifest.json").write_text(json.dumps(manifest | {"made_on": kinds}))
    card = (export_dataset(Dataset(mixed), tmp_path / "out", "parquet") / "README.md").read_text()
    assert "- samples were made with 2 kinds of kernels" in card


def test_columns_of_parquet_are_plain(dataset: Dataset, parquet: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra [export])")
    table = pq.read_table(parquet / "data" / "train-00000-of-00001.parquet")
    place = int(dataset.positions([table["index"][0].as_py()])[0])
    assert table["sentence"][0].as_py() == dataset.records[place]["sentence"]
    assert table["label"][0].as_py() == dataset.labels[place]
    told = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
    assert told["spectrogram"] == {"shape": [16, 24], "dtype": "float16", "_type": "Array2D"}
    assert told["label"]["names"] == ["walking", "bending"]
    assert told["points"]["shape"] == [None, 6]


def test_datasets_reads_it(dataset: Dataset, parquet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "home"))
    datasets = pytest.importorskip("datasets", reason="Hugging Face datasets is not installed")
    datasets.disable_progress_bars()
    found = datasets.load_dataset(str(parquet), cache_dir=str(tmp_path / "cache"))
    assert [*found] == ["train", "test"]
    assert sorted(found["train"]["index"][:] + found["test"]["index"][:]) == dataset.indices.tolist()
    assert found["train"].features["label"].names == ["walking", "bending"]
    assert str(found["train"].features["spectrogram"]) == "Array2D(shape=(16, 24), dtype='float16')"
    row = found["test"].with_format("numpy")[1]
    place = int(dataset.positions([int(row["index"])])[0])
    for name in dataset.products:
        np.testing.assert_array_equal(row[name], dataset.array(place, name))


def test_pictures_show_the_levels(dataset: Dataset, tmp_path: Path) -> None:
    from PIL import Image

    made = export_dataset(dataset, tmp_path / "png", "png", dynamic_range_db=30)
    with (made / "labels.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["index"]) for row in rows] == dataset.indices.tolist()
    assert len(list(made.rglob("*.png"))) == 11
    row = rows[5]
    grey = np.asarray(Image.open(made / row["file"]))
    assert row["file"] == f"{dataset.records[5]['class']}/{int(row['index']):06d}.png"
    assert grey.shape == (16, 24)
    levels = dataset.values(5, "spectrogram")[::-1]  # approaching on top
    shown = float(row["black_db"]) + grey * (float(row["white_db"]) - float(row["black_db"])) / 255
    np.testing.assert_allclose(shown, np.clip(levels, -30, 0), atol=30 / 255)
    assert (float(row["least_mps"]), float(row["greatest_mps"])) == tuple(
        dataset.records[5]["products"]["spectrogram"]["velocity_mps"]
    )


def test_npz_holds_the_same_numbers(dataset: Dataset, tmp_path: Path) -> None:
    found = split(dataset.records, (0.5, 0.5))
    made = export_dataset(dataset, tmp_path / "npz", "npz", split=found)
    for name, indices in found.sides.items():
        places = dataset.positions(indices)
        records = [json.loads(line) for line in (made / f"{name}.jsonl").read_text().splitlines()]
        assert records == [dataset.records[place] for place in places]
        with np.load(made / f"{name}.npz", allow_pickle=False) as file:
            np.testing.assert_array_equal(file["label"], dataset.labels[places])
            for row, place in enumerate(places):
                assert same(file["spectrogram"][row], dataset.array(place, "spectrogram"))
                assert same(file[f"points_{indices[row]}"], dataset.array(place, "points"))


def test_wrong_exports_are_refused_and_write_nothing(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    with pytest.raises(InputError, match="taken exists already; choose another name"):
        export_dataset(dataset, tmp_path / "taken", "npz")
    with pytest.raises(InputError, match="to must be 'parquet', 'png' or 'npz', got 'csv'"):
        export_dataset(dataset, tmp_path / "a", "csv")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="pictures are made of spectrograms, got products points"):
        export_dataset(dataset, tmp_path / "a", "png", products=["points"])
    leaking = {"train": [0], "test": [0]}
    with pytest.raises(InputError, match="sample 0 is in train and in test"):
        export_dataset(
            dataset, tmp_path / "a", "npz", split=split(dataset.records, (0.5, 0.5)).__class__(leaking, ("seed",))
        )
    assert [each.name for each in tmp_path.iterdir()] == ["taken"]


def test_a_range_that_a_picture_of_bytes_does_not_hold_is_refused(tmp_path: Path) -> None:
    bytes_only = recipe(products={"spectrogram": {"size": [8, 8], "dtype": "uint8", "dynamic_range_db": 40}})
    folder = write_dataset(tmp_path / "data", bytes_only)
    with pytest.raises(InputError, match="hold 40 dB and dynamic_range_db asks for 60 dB; ask for less"):
        export_dataset(folder, tmp_path / "png", "png")
    assert not (tmp_path / "png").exists()


def test_a_damaged_file_is_named(parquet: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(parquet, copy)
    path = copy / "data" / "test-00000-of-00001.parquet"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(
        InputError, match=r"test-00000-of-00001.parquet cannot be read \(.*\); export the data set again"
    ):
        Dataset(copy)


def test_a_missing_package_is_named(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(
        InputError, match=r"need the package pyarrow, which is not installed; run pip install -e '.\[export\]'"
    ):
        export_dataset(folder, tmp_path / "parquet", "parquet")
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "t2d_rt.dataset.torch_data", raising=False)
    with pytest.raises(InputError, match=r"TorchDataset needs PyTorch, which is not installed"):
        from t2d_rt.dataset import TorchDataset  # noqa: F401


def test_the_commands_split_and_export(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = str(tmp_path / "split.json"), str(tmp_path / "out")
    assert main(["dataset", "split", str(folder), "-o", file, "--fractions", "0.5,0.5", "--seed", "1"]) == 0
    assert (
        main(["dataset", "export", str(folder), "--to", "npz", "--split", file, "-o", out, "--products", "spectrogram"])
        == 0
    )
    assert "wrote 11 samples" in capsys.readouterr().out
    with np.load(tmp_path / "out" / "test.npz") as found:
        assert "adc_0" not in found.files
    assert main(["dataset", "split", str(folder), "-o", str(tmp_path / "f.json"), "--folds", "3", "--leave-out"]) == 0
    assert sorted(each.name for each in tmp_path.glob("f_*")) == ["f_1.json", "f_2.json", "f_3.json"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["export", "--to", "npz"], "dataset export needs --to parquet, png or npz and -o"),
        (["export", "--to", "csv", "-o", "out"], "--to must be 'parquet', 'png' or 'npz', got 'csv'"),
        (["export", "--to", "npz", "-o", "out", "--dynamic-range-db", "30"], "--dynamic-range-db is of pictures"),
        (["summary", "--to", "npz"], "dataset summary takes no --to; leave it out"),
        (["split", "--folds", "3", "--fractions", "0.5,0.5"], "takes --folds or --fractions"),
        (["split", "--fractions", "half"], "--fractions are two or three numbers"),
        (["split", "another"], "dataset split takes the folder of a data set"),
    ],
)
def test_wrong_words_are_one_sentence(
    words: list[str], sentence: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["dataset", words[0], str(folder), *words[1:]]) == 2
    told = capsys.readouterr().err
    assert sentence in told
    assert len(told.strip().splitlines()) == 1


def test_a_side_without_samples_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    empty = Split({"train": tuple(dataset.indices.tolist()), "test": ()}, ("seed",))
    for to in ("npz", "parquet", "png"):
        with pytest.raises(InputError, match="side test of the split has no samples"):
            export_dataset(dataset, tmp_path / "out", to, products=["spectrogram"], split=empty)
    assert not (tmp_path / "out").exists()


def test_row_groups_of_parquet_are_as_small_as_their_samples_are_large(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyarrow.parquet as pq

    sample = dataset.array(0, "adc").nbytes
    monkeypatch.setattr("t2d_rt.dataset.parquet.GROUP_BYTES", 2 * sample)
    export_dataset(dataset, tmp_path / "out", "parquet", products=["adc"])
    file = pq.ParquetFile(next((tmp_path / "out/data").glob("*.parquet")))
    assert file.num_row_groups == -(-len(dataset) // 2)
    again = Dataset(tmp_path / "out")
    np.testing.assert_array_equal(again.array(5, "adc"), dataset.array(5, "adc"))
