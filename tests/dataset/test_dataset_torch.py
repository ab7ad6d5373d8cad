"""The data set for PyTorch gives the numbers of the shards, through workers and through parquet alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dataset_folder import recipe, write_dataset
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset, export_dataset, split

torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")
from t2d_rt.dataset import TorchDataset  # noqa: E402 - loads PyTorch


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("data") / "tiny", failed=(4,))


def test_tensors_are_the_values_and_labels(folder: Path) -> None:
    dataset = Dataset(folder)
    found = TorchDataset(folder, indices=[11, 0, 5])
    assert len(found) == 3
    assert isinstance(found, torch.utils.data.Dataset)
    for number, place in enumerate(dataset.positions([11, 0, 5])):
        tensor, label = found[number]
        assert tensor.dtype == torch.float32
        np.testing.assert_array_equal(tensor.numpy(), dataset.values(place, "spectrogram"))
        assert label == dataset.labels[place] == found.labels[number]
        assert found.record(number) == dataset.records[place]
    assert TorchDataset(folder, "adc")[0][0].dtype == torch.complex64


def test_from_recipe_over_shards_and_parquet_to_tensors(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra [export])")
    sides = split(Dataset(folder).records, (0.5, 0.5))
    exported = export_dataset(folder, tmp_path / "parquet", "parquet", split=sides)
    for product in Dataset(folder).products:
        first = TorchDataset(folder, product, indices=sides.sides["test"])
        second = TorchDataset(exported, product, indices=sides.sides["test"])
        assert len(first) == len(second) > 3
        for (a, la), (b, lb) in zip(first, second, strict=True):
            assert torch.equal(a, b)
            assert la == lb


@pytest.mark.slow
def test_workers_read_for_themselves(folder: Path) -> None:
    found = TorchDataset(folder, dynamic_range_db=40)
    found[0]  # what is kept here goes to no worker
    loader = torch.utils.data.DataLoader(found, batch_size=4, num_workers=1, multiprocessing_context="spawn")
    values, labels = zip(*loader, strict=True)
    assert torch.equal(torch.cat(values), torch.stack([each for each, _ in found]))
    assert torch.equal(torch.cat(labels), found.labels)


def test_levels_are_scaled(folder: Path) -> None:
    levels, scaled = TorchDataset(folder)[2][0], TorchDataset(folder, dynamic_range_db=40)[2][0]
    torch.testing.assert_close(scaled, (1 + levels / 40).clamp(0, 1))
    assert scaled.max() == 1
    assert scaled.min() == 0


@pytest.mark.parametrize(
    ("product", "length", "expected"),
    [
        ("spectrogram", 30, (16, 30)), ("spectrogram", 10, (16, 10)), ("range_doppler", 6, (6, 8, 6)), ("adc", 4, (4, 1, 256)),
        ("points", 9, (9, 6)), ("points", 2, (2, 6)),
    ],
)  # fmt: skip
def test_samples_are_cut_and_padded(folder: Path, product: str, length: int, expected: tuple[int, ...]) -> None:
    whole, fitted = TorchDataset(folder, product)[3][0], TorchDataset(folder, product, length=length)[3][0]
    assert tuple(fitted.shape) == expected
    if product == "points" and length == 2:
        best = whole[whole[:, 5].argsort(descending=True)[:2]]
        assert {tuple(row) for row in fitted.tolist()} == {tuple(row) for row in best.tolist()}
        return
    axis = 1 if product == "spectrogram" else 0
    kept = min(length, whole.shape[axis])
    assert torch.equal(fitted.narrow(axis, 0, kept), whole.narrow(axis, 0, kept))
    rest = fitted.narrow(axis, kept, length - kept)
    assert torch.all(rest == (whole.min() if product in ("spectrogram", "range_doppler") else 0))


def test_wrong_options_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="dynamic_range_db is of spectrogram and range_doppler, got product 'adc'"):
        TorchDataset(folder, "adc", dynamic_range_db=40)
    with pytest.raises(InputError, match="the data set holds 40 dB and dynamic_range_db asks for 60 dB"):
        TorchDataset(folder, "range_doppler", dynamic_range_db=60)
    with pytest.raises(InputError, match="holds no sample 4"):
        TorchDataset(folder, indices=[4])
    few = write_dataset(tmp_path / "few", recipe(products={"points": {}, "spectrogram": None}))
    with pytest.raises(InputError, match="unknown product 'spectrogram'"):
        TorchDataset(few)


def test_transforms_are_applied(folder: Path) -> None:
    assert TorchDataset(folder, transform=lambda tensor: tensor[None] * 2)[0][0].shape == (1, 16, 24)
