"""Training: the same bits for a seed and after a stop; files without pickles; augmentations; sides; windows of a recording."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dataset_folder import write_dataset
from learn_maps import CLASSES, ridges
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset
from t2d_rt.learn import Augment, SavedModel, TrainOptions, load_model, scores_of, sides_of, train_model
from t2d_rt.learn.augment import Augmenter
from t2d_rt.learn.figures import prediction_figure
from t2d_rt.learn.prediction import predict
from t2d_rt.learn.saved_models import CARD, STATE, WEIGHTS
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar

torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")

OPTIONS = TrainOptions(epochs=4, batch=8, augment=Augment(shift=0.1, gain_db=3.0))


class Killed(Exception):
    """In place of kill -9, once an epoch is kept."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[SavedModel, Path]:
    folder = tmp_path_factory.mktemp("model") / "whole"
    return train_model("streaming", ridges(48), ridges(12, seed=1), OPTIONS, output=folder), folder


def weights(model: SavedModel) -> np.ndarray:
    return np.concatenate([each.detach().numpy().ravel() for each in model.network.state_dict().values()])


def test_a_stopped_training_goes_on_to_the_same_bits(trained: tuple[SavedModel, Path], tmp_path: Path) -> None:
    def stopping(fraction: float) -> None:
        if fraction >= 0.5:
            raise Killed

    with pytest.raises(Killed):
        train_model("streaming", ridges(48), ridges(12, seed=1), OPTIONS, output=tmp_path / "part", progress=stopping)
    assert not (tmp_path / "part" / WEIGHTS).exists()
    went_on = train_model("streaming", ridges(48), ridges(12, seed=1), OPTIONS, output=tmp_path / "part")
    assert went_on.card.about["history"] == trained[0].card.about["history"]
    np.testing.assert_array_equal(weights(went_on), weights(trained[0]))
    assert (tmp_path / "part" / WEIGHTS).read_bytes() == (trained[1] / WEIGHTS).read_bytes()
    with pytest.raises(InputError, match="another model, data or options"):
        train_model(
            "streaming", ridges(48), ridges(12, seed=1), OPTIONS.model_copy(update={"seed": 1}), output=tmp_path / "part",
        )  # fmt: skip


def test_bfloat16_learns_as_float32_does(tmp_path: Path) -> None:
    """Steps in bfloat16, which has 8 bits: the first loss within 1 %; weights are float32, the same after a stop."""

    def stopping(fraction: float) -> None:
        raise Killed

    sides = ridges(24), ridges(12, seed=1)
    full = train_model("vgg-7", *sides, TrainOptions(epochs=2, batch=8))
    half = TrainOptions(epochs=2, batch=8, precision="bfloat16")
    whole = train_model("vgg-7", *sides, half, output=tmp_path / "whole")
    with pytest.raises(Killed):
        train_model("vgg-7", *sides, half, output=tmp_path / "part", progress=stopping)
    went_on = train_model("vgg-7", *sides, half, output=tmp_path / "part")
    first, other = (each.card.about["history"][0]["train_loss"] for each in (full, whole))
    assert first != other
    assert first == pytest.approx(other, rel=0.01)
    np.testing.assert_array_equal(weights(went_on), weights(whole))
    assert {each.dtype for each in whole.network.parameters()} == {torch.float32}
    levels = sides[1].levels
    np.testing.assert_array_equal(load_model(tmp_path / "whole").probabilities(levels), whole.probabilities(levels))


def test_a_finished_training_tells_no_time_not_taken(trained: tuple[SavedModel, Path], tmp_path: Path) -> None:
    shutil.copytree(trained[1], tmp_path / "copy")
    threads, drawn = torch.get_num_threads(), torch.random.get_rng_state()
    again = train_model("streaming", ridges(48), ridges(12, seed=1), OPTIONS, output=tmp_path / "copy")
    assert trained[0].card.about["seconds_per_epoch"] > 0
    assert again.card.about["seconds_per_epoch"] is None
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.random.get_rng_state(), drawn)


def test_it_learns_and_what_is_read_is_what_was_written(trained: tuple[SavedModel, Path]) -> None:
    model, folder = trained
    test = ridges(30, seed=2)
    found = model.probabilities(test.levels)
    assert scores_of(found, test.labels).accuracy > 0.6
    read = load_model(folder)
    np.testing.assert_array_equal(read.probabilities(test.levels), found)
    assert read.card.classes == CLASSES
    np.testing.assert_allclose(read.card.axis_mps, test.velocity_mps)
    told = json.loads((folder / CARD).read_text())
    assert (told["model"], told["classes"], told["seed"]) == ("streaming", list(CLASSES), 0)
    assert len(told["about"]["history"]) == told["about"]["epochs"] <= 4


def test_pickles_and_damaged_files_are_refused(trained: tuple[SavedModel, Path], tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    folder.mkdir()
    for name in (WEIGHTS, CARD):
        (folder / name).write_bytes((trained[1] / name).read_bytes())
    torch.save({"a": torch.zeros(2)}, tmp_path / "model.pt")
    with pytest.raises(InputError, match="is a pickle, which could run anything"):
        load_model(tmp_path / "model.pt")
    (folder / WEIGHTS).write_bytes((tmp_path / "model.pt").read_bytes())
    with pytest.raises(InputError, match=r"safetensors is a pickle"):
        load_model(folder)
    (folder / WEIGHTS).write_bytes((trained[1] / WEIGHTS).read_bytes()[:2000])
    with pytest.raises(InputError, match="does not hold the weights"):
        load_model(folder)
    (folder / CARD).write_text("{}")
    with pytest.raises(InputError, match="no card of a model"):
        load_model(folder)
    with pytest.raises(InputError, match="holds no trained model"):
        load_model(tmp_path)
    (trained[1] / STATE).replace(tmp_path / "kept")
    torch.save({"t2d_rt": {"history": [Path]}}, trained[1] / STATE)  # a class, which weights_only does not make
    try:
        with pytest.raises(InputError, match="no state of a training that can be read safely"):
            train_model("streaming", ridges(48), ridges(12, seed=1), OPTIONS, output=trained[1])
    finally:
        (tmp_path / "kept").replace(trained[1] / STATE)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"train": ridges(12).take([0, 3])}, "class 'middle' has no sample to train on"),
        ({"val": ridges(12, size=(32, 24))}, "must be like those of the training"),
        ({"val": replace(ridges(12), duration_s=3.0)}, "must cover the same speeds and time"),
    ],
)
def test_what_cannot_be_trained_on(change: dict[str, Any], sentence: str) -> None:
    maps = {"train": ridges(12), "val": ridges(6), **change}
    with pytest.raises(InputError, match=sentence):
        train_model("streaming", maps["train"], maps["val"], OPTIONS)


def test_foreign_maps_are_refused(trained: tuple[SavedModel, Path]) -> None:
    with pytest.raises(InputError, match="32 x 32 cells"):
        trained[0].probabilities(np.zeros((2, 16, 16), np.float32))
    with pytest.raises(InputError, match="must be finite"):
        trained[0].probabilities(np.full((1, 32, 32), np.nan, np.float32))


def test_augmentations_keep_what_they_should() -> None:
    levels = ridges(1).levels[0]
    other = np.full_like(levels, -20.0)
    other[0] = np.linspace(-40.0, -35.0, 32)

    def made(seed: int = 0, **options: Any) -> np.ndarray:
        return Augmenter(Augment(**options), (32, 32), 5.0, -60.0, seed=0)(
            levels, np.random.default_rng(seed), other[None]
        )

    np.testing.assert_array_equal(made(), levels)
    np.testing.assert_array_equal(made(3, shift=0.3, doppler=0.2), made(3, shift=0.3, doppler=0.2))
    assert not np.array_equal(made(3, shift=0.3), made(4, shift=0.3))
    shifted = made(2, shift=0.3)
    by = next(k for k in range(-10, 11) if np.array_equal(np.roll(levels, k, axis=1)[:, 10:22], shifted[:, 10:22]))
    assert by != 0
    assert made(2, gain_db=10).max() < 0
    for seed in (0, 2, 3):
        joined = made(seed, follow=0.4)
        by = int(np.sum(np.ptp(joined[1:], axis=0) == 0))  # columns of the other, in which all rows but one are alike
        assert 0 < by <= 13
        before = np.ptp(joined[1:, 0]) == 0  # the window is early, or late
        parts = (slice(by, None), slice(None, -by)) if before else (slice(None, -by), slice(by, None))
        moved = (joined[:, parts[0]] - levels[:, parts[1]])[levels[:, parts[1]] > -50]
        assert np.ptp(moved) < 1e-3
        its = joined[:, :by] if before else joined[:, -by:]
        expected = other[0, -by:] if before else other[0, :by]  # its end comes before, its beginning after
        np.testing.assert_allclose(its[0] - its[1], expected + 20.0, atol=1e-3)
    faster = made(5, doppler=0.3)
    rows = [np.mean(each.argmax(axis=0)) - 15.5 for each in (levels, faster)]
    assert 0.65 < rows[1] / rows[0] < 1.35
    assert rows[1] != pytest.approx(rows[0], abs=0.1)
    louder = made(6, background_db=-5.0)
    assert np.median(louder) > np.median(levels) + 3
    assert louder.max() <= 0
    masked = made(7, masks={"windows": 5.0, "shortest_s": 1.0, "longest_s": 2.0})
    assert np.any(np.all(masked == -60, axis=0))


def test_sides_by_file_leak_and_by_description_do_not(tmp_path: Path) -> None:
    records = Dataset(write_dataset(tmp_path / "tiny")).records
    sentences = [each["sentence"] for each in records]

    def shared(by: str) -> int:
        sides = sides_of(records, by, fractions=(0.5, 0.5) if by != "file" else (0.5, 0.25, 0.25))
        names = [{sentences[k] for k in places} for places in sides.values()]
        return len(names[0] & set().union(*names[1:]))

    assert shared("file") > 0
    assert shared("description") == 0
    sides = sides_of(records, "file")
    assert sorted(np.concatenate([*sides.values()])) == list(range(len(records)))


def test_scores_in_closed_form() -> None:
    found = scores_of(np.array([[0.9, 0.1], [0.6, 0.4], [0.2, 0.8], [0.3, 0.7]]), np.array([0, 1, 1, 1]))
    np.testing.assert_array_equal(found.confusion, [[1, 0], [1, 2]])
    assert found.accuracy == 0.75
    assert found.macro_f1 == pytest.approx((2 / 3 + 4 / 5) / 2)
    assert found.calibration_error == pytest.approx((0.1 + 0.6 + 0.2 + 0.3) / 4)


@pytest.mark.filterwarnings("ignore:the greatest cells of the recording")  # a tone with less noise than the ridges
def test_a_recording_is_brought_to_the_axes_of_the_training(
    trained: tuple[SavedModel, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    radar = Radar.preset("table2-uniform")
    model = SavedModel(
        trained[0].card.model_copy(update={"velocity_mps": (-1.0, 1.0), "duration_s": 1.0}), trained[0].network
    )
    chirps = int(2.2 * radar.prf_hz)
    times = np.arange(chirps) / radar.prf_hz
    speed = np.where(times < 1.1, 0.3, 0.8)
    phase = -4 * np.pi / radar.wavelength_m * np.cumsum(speed) / radar.prf_hz
    rng = np.random.default_rng(0)
    cube = np.exp(1j * (phase[:, None] + 0.3 * np.arange(radar.samples)))[:, None] + 0.05 * rng.normal(
        size=(chirps, 1, radar.samples)
    )
    recording = Recording(cube.astype(np.complex64), radar)
    seen: list[np.ndarray] = []

    class Spy(SavedModel):
        def probabilities(self, levels: np.ndarray) -> np.ndarray:
            seen.append(levels)
            return np.ones((len(levels), 3)) / 3

    found = predict(Spy(model.card, model.network), recording, step_s=0.25)
    assert found.starts_s[-1] + found.duration_s == pytest.approx(2.2, abs=0.2)
    axis = model.card.axis_mps
    assert axis[seen[0][0].mean(axis=1).argmax()] == pytest.approx(0.3, abs=0.07)
    assert axis[seen[0][-1].mean(axis=1).argmax()] == pytest.approx(0.8, abs=0.07)
    assert found.mti == "mean"
    later, part = recording.cube[:].copy(), 3 * chirps // 4
    later[part:] += np.complex64(30)  # a static echo that comes later changes no window before it
    for each in (Recording(later, radar), Recording(recording.cube[:part], radar)):
        predict(Spy(model.card, model.network), each, step_s=0.25)
        np.testing.assert_allclose(seen[-1][0], seen[0][0], atol=0.2)  # pieces may differ by less than a hop
    kept = SavedModel(model.card.model_copy(update={"about": {"mti": "none"}}), model.network)
    still = Recording(recording.cube[:] + np.complex64(30), radar)  # a strong static echo
    shown: list[Any] = []
    monkeypatch.setattr(Recording, "plot", lambda self, *_, **__: shown.append(self.processing["mti"]))
    for each, level in ((model, False), (kept, True)):
        found = predict(Spy(each.card, each.network), still)
        rest = np.abs(axis).argmin()
        assert (abs(int(seen[-1][0].mean(axis=1).argmax()) - rest) <= 1) == level
        prediction_figure(still, found, title="")
    assert shown == ["mean", "none"]
    with pytest.raises(InputError, match="record longer"):
        predict(model, Recording(cube[: chirps // 4].astype(np.complex64), radar))
    with pytest.raises(InputError, match="higher chirp rate"):
        predict(trained[0], recording)
