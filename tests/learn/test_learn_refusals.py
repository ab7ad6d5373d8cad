"""What a user may do wrong with trained models and the folders of trainings: a sentence, and nothing half written."""

from __future__ import annotations

import json
import re
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt.learn
from builders import slow_after
from dataset_folder import recipe, write_dataset
from learn_maps import ridges
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.dataset import Dataset
from t2d_rt.dataset.lock import locked
from t2d_rt.learn import Ensemble, SavedModel, TrainOptions, load_model, scores_of, train_model
from t2d_rt.learn.maps import maps_of
from t2d_rt.learn.models import build
from t2d_rt.learn.prediction import predict
from t2d_rt.learn.saved_models import CARD, STATE, WEIGHTS
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar

torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")

OPTIONS = TrainOptions(epochs=1, batch=8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("model") / "made"
    trained(made)
    return made


def trained(output: Path, progress: Any = None, **options: Any) -> SavedModel:
    chosen = OPTIONS.model_copy(update=options)
    return train_model("streaming", ridges(12), ridges(6, seed=1), chosen, output=output, progress=progress)


def changed(folder: Path, target: Path, **values: Any) -> Path:
    """A copy of a model whose card says other things."""
    shutil.copytree(folder, target)
    told = json.loads((target / CARD).read_text()) | values
    (target / CARD).write_text(json.dumps(told))
    return target


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"velocity_mps": [float("nan"), 1]}, "card key velocity_mps: got nan"),
        ({"duration_s": -1}, "card key duration_s: got -1"),
        ({"dynamic_range_db": 0}, "card key dynamic_range_db: got 0"),
        ({"classes": ["slow"] * 3}, "names one of them twice"),
        ({"velocity_mps": [1, 1]}, "velocity_mps must rise"),
        ({"about": {"carriers_hz": ["../x"]}}, "carriers_hz must be a number"),
        ({"about": {"contrast_db": [-float("inf"), 20]}}, "contrast_db must be finite"),
        ({"about": {"mti": "x"}}, "mti must be mean or none"),
        ({"about": {"descriptions": 3}}, "no card of a model"),
        ({"model": "crnn", "size": [64, 64]}, "does not hold the weights of crnn"),
    ],
)
def test_a_card_that_does_not_hold(folder: Path, tmp_path: Path, values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        load_model(changed(folder, tmp_path / "copy", **values))


def test_weights_of_another_training_are_refused(folder: Path, tmp_path: Path) -> None:
    target = changed(folder, tmp_path / "copy")
    trained(tmp_path / "other", seed=1)
    shutil.copy(tmp_path / "other" / WEIGHTS, target)
    with pytest.raises(InputError, match=r"is not the file that .* was written with"):
        load_model(target)


@pytest.mark.parametrize("cut", [0, 100, 5000, -50])
def test_a_state_that_was_cut_short_is_refused(folder: Path, tmp_path: Path, cut: int) -> None:
    target = changed(folder, tmp_path / "copy")
    (target / STATE).write_bytes((target / STATE).read_bytes()[:cut])
    with pytest.raises(InputError, match="is no state of a training that can be read safely"):
        trained(target)


def test_a_state_without_weights_is_refused(folder: Path, tmp_path: Path) -> None:
    target = changed(folder, tmp_path / "copy")
    torch.save({"t2d_rt": {"history": []}}, target / STATE)
    with pytest.raises(InputError, match="it lacks a part"):
        trained(target)


def test_a_folder_takes_one_training_at_a_time(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    with locked(tmp_path / "mine"), pytest.raises(InputError, match="is being written by process"):
        trained(tmp_path / "mine")
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="cannot make the folder"):
            trained(place)


def test_a_training_without_an_epoch_does_not_take_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    monkeypatch.setattr("torch.backends.mps.is_available", lambda: False)
    with pytest.raises(InputError, match="PyTorch finds none here; take device cpu"):
        trained(tmp_path / "gpu", device="gpu")
    assert not (tmp_path / "gpu").exists()
    with monkeypatch.context() as patch:
        patch.setattr("torch.nn.functional.cross_entropy", lambda scores, _, **__: scores.sum() * float("nan"))
        with pytest.raises(InputError, match=r"no longer finite in epoch 1, at a rate of 0\.001; lower"):
            trained(tmp_path / "mine")
    assert {each.name for each in (tmp_path / "mine").iterdir()} == {"training.txt"}
    trained(tmp_path / "mine", batch=6)
    assert (tmp_path / "mine" / WEIGHTS).exists()


def test_maps_of_one_level_and_wider_ranges_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = Dataset(write_dataset(tmp_path / "tiny"))
    monkeypatch.setattr(Dataset, "values", lambda *_: np.full((16, 16), -3.0, np.float32))
    with pytest.raises(InputError, match=r"sample 0 of .* has the same level in all cells"):
        maps_of(dataset, size=(8, 8))
    stored = recipe(products={"spectrogram": {"size": [16, 16], "dtype": "uint8", "dynamic_range_db": 40}})
    dataset = Dataset(write_dataset(tmp_path / "pictures", stored))
    with pytest.raises(InputError, match=r"keeps 40 dB .* got a dynamic range of 60 dB; take as much at most"):
        maps_of(dataset, size=(8, 8))


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    code = main([*words])
    return code, capsys.readouterr().err


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A data set, and a model that was trained on it."""
    place = tmp_path_factory.mktemp("tiny")
    data = write_dataset(place / "data")
    words = ("--model", "streaming", "--size", "16", "--by", "file", "--epochs", "1", "--batch", "4")
    assert main(["train", str(data), *words, "-o", str(place / "model")]) == 0
    return data, place / "model"


def about(**values: Any) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda told: {"about": told["about"] | values}


@pytest.mark.parametrize(
    ("change", "sentence"),
    slow_after(
        3,
        [
            (about(indices={}), "does not tell which samples"),
            (about(indices={"test": []}), "does not tell which samples"),
            (about(indices={"test": "x"}), "does not tell which samples"),
            (about(mti="none"), "was made with mti mean, the model was trained with none"),
            (lambda told: {"duration_s": 2 * told["duration_s"]}, "cover .* s, those of the training"),
            (lambda told: {"classes": [*told["classes"][:-1], "swimming"]}, "has the classes"),
        ],
    ),
)
def test_evaluation_of_what_does_not_fit(
    tiny: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    change: Callable[[dict[str, Any]], dict[str, Any]], sentence: str,
) -> None:  # fmt: skip
    told = json.loads((tiny[1] / CARD).read_text())
    model = changed(tiny[1], tmp_path / "copy", **change(told))
    code, err = run(capsys, "evaluate", str(tiny[0]), "--model", str(model), "-o", str(tmp_path / "out"))
    assert code == 2
    assert re.search(sentence, err), err
    assert not (tmp_path / "out").exists()


def test_evaluation_tells_of_descriptions_that_were_trained_on(
    tiny: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = changed(tiny[1], tmp_path / "copy", **about(recipe_hash="other")(json.loads((tiny[1] / CARD).read_text())))
    code, err = run(capsys, "evaluate", str(tiny[0]), "--model", str(model))
    assert code == 0
    assert "of descriptions that the model was trained on" in err


def test_pictures_that_are_there_are_found_before_the_work(
    tiny: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "reliability.png").write_text("mine")
    code, err = run(capsys, "evaluate", str(tiny[0]), "--model", str(tiny[1]), "-o", str(tmp_path))
    assert code == 2
    assert "exists already" in err
    assert "another process" not in err
    assert [each.name for each in tmp_path.iterdir()] == ["reliability.png"]


def recording(cube: np.ndarray, radar: Radar) -> Recording:
    return Recording(cube.astype(np.complex64), radar)


def test_recordings_of_another_band_and_of_nothing(folder: Path) -> None:
    radar = Radar.preset("table2-uniform")
    found = load_model(folder)
    chirps = int(1.2 * radar.prf_hz)
    noise = np.random.default_rng(0).normal(size=(chirps, 1, radar.samples))
    card = found.card.model_copy(update=dict(velocity_mps=(-1.0, 1.0), duration_s=1.0, about={"carriers_hz": [24e9]}))
    with pytest.warns(T2DWarning, match=r"is of 77 GHz, the model was trained on 24 GHz"):
        predict(SavedModel(card, found.network), recording(noise, radar))
    model = SavedModel(found.card.model_copy(update=dict(velocity_mps=(-1.0, 1.0), duration_s=1.0)), found.network)
    with pytest.raises(InputError, match="has the same level in all cells"):
        predict(model, recording(np.zeros_like(noise), radar))


def tone(radar: Radar, seconds: float) -> Recording:
    """A target that comes nearer at 0.5 m/s, in noise."""
    chirps = int(seconds * radar.prf_hz)
    phase = -4 * np.pi / radar.wavelength_m * 0.5 * np.arange(chirps) / radar.prf_hz
    rng = np.random.default_rng(0)
    cube = np.exp(1j * (phase[:, None] + 0.3 * np.arange(radar.samples)))[:, None]
    return recording(cube + 0.05 * rng.normal(size=(chirps, 1, radar.samples)), radar)


class Seen(SavedModel):
    """A model that keeps the maps that it is given."""

    def probabilities(self, levels: np.ndarray) -> np.ndarray:
        maps_seen.append(levels)
        return super().probabilities(levels)


maps_seen: list[np.ndarray] = []


@pytest.mark.filterwarnings("ignore:the greatest cells of the recording")  # a tone with less noise than the ridges
def test_a_recording_shorter_than_a_window_goes_on_at_its_floor(folder: Path) -> None:
    radar = Radar.preset("table2-uniform")
    found = load_model(folder)
    model = Seen(found.card.model_copy(update=dict(velocity_mps=(-1.0, 1.0), duration_s=1.0)), found.network)
    maps_seen.clear()
    with pytest.warns(
        T2DWarning, match=r"has 0\.\d+ s of spectrogram, a window of the model 1 s; .* at the recording's floor"
    ):
        told = predict(model, tone(radar, 0.9))
    assert told.starts_s.shape == (1,)
    (levels,) = maps_seen[0]
    row = np.abs(model.card.axis_mps - 0.5).argmin()
    assert levels[row, : levels.shape[1] // 2].max() > -1.0
    assert (levels[:, -2:] <= np.quantile(levels[:, :-4], 0.3, axis=1, keepdims=True) + 1.0).all()
    with pytest.raises(InputError, match=r"record longer, 0\.5 s or more"):
        predict(model, tone(radar, 0.3))
    with pytest.raises(InputError, match=r"step_s must lie in 0\.005"):
        predict(model, tone(radar, 1.2), step_s=1e-9)


@pytest.mark.filterwarnings("ignore:the greatest cells of the recording")  # a tone with less noise than the ridges
def test_networks_of_other_cells_are_averaged(folder: Path, tmp_path: Path) -> None:
    """Each sees the recording in its own cells."""
    radar, found = Radar.preset("table2-uniform"), load_model(folder)
    speeds, times = found.card.size
    fine = build("streaming", 3, (2 * speeds, 2 * times))
    edge = 1.0 + 1.0 / (speeds - 1)  # the outer edge of the coarse axis
    ends = (-edge + edge / (2 * speeds), edge - edge / (2 * speeds))
    cards = (
        found.card.model_copy(update=dict(velocity_mps=(-1.0, 1.0), duration_s=1.0)),
        found.card.model_copy(
            update=dict(velocity_mps=ends, duration_s=1.0, size=(2 * speeds, 2 * times), dynamic_range_db=50.0)
        ),
    )
    pair = SavedModel(cards[0], found.network), SavedModel(cards[1], fine.eval())
    both = predict(Ensemble(pair), tone(radar, 1.3))
    alone = [predict(each, tone(radar, 1.3)).probabilities for each in pair]
    np.testing.assert_allclose(both.probabilities, 0.5 * (alone[0] + alone[1]), atol=1e-6)


def test_broken_weights_are_not_scored(folder: Path) -> None:
    found = load_model(folder)
    with torch.no_grad():
        next(found.network.parameters()).fill_(float("nan"))
    with pytest.raises(InputError, match="probabilities that are NaN"):
        found.probabilities(ridges(4).levels)
    with pytest.raises(InputError, match="probabilities must be finite"):
        scores_of(np.full((2, 2), np.nan), np.array([0, 1]))


@pytest.mark.parametrize(
    "harm", ["another network", "no losses", "no optimizer", "null", "another optimizer", "no rate"]
)
def test_a_state_of_others_is_one_sentence(tmp_path: Path, harm: str) -> None:
    mine = tmp_path / "mine"
    trained(mine)
    state = torch.load(mine / STATE, weights_only=True)
    if harm == "another network":
        state["best"] = {"head.weight": torch.zeros(2)}
    elif harm == "no losses":
        state["history"] = [{"val_loss": float("nan"), "train_loss": 1.0}]
    elif harm == "no optimizer":
        del state["optimizer"]
    elif harm == "another optimizer":
        state["optimizer"]["param_groups"] = [{"lr": "x", "params": [0]}]
    elif harm == "no rate":
        state["optimizer"]["param_groups"][0]["lr"] = "x"
    other = tmp_path / "other"
    with pytest.raises(KeyboardInterrupt):  # the folder of a training that was stopped
        trained(other, progress=interrupt, epochs=2)
    torch.save(None if harm == "null" else state, other / STATE)
    with pytest.raises(InputError, match="is no state of a training"):
        trained(other, epochs=2)


def interrupt(_: float) -> None:
    raise KeyboardInterrupt


def test_learning_without_torch_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("t2d_rt.learn.pytorch.find_spec", lambda name: None if name == "torch" else name)
    monkeypatch.delitem(sys.modules, "t2d_rt.learn.fine_tuning", raising=False)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputError, match=r"fine-tuning needs PyTorch.* pip install -e '.\[learn\]'"):
        t2d_rt.learn.fine_tune  # noqa: B018
    for words in (("train", "data"), ("evaluate", "data", "--model", str(tmp_path))):
        (tmp_path / WEIGHTS).touch()
        (tmp_path / CARD).touch()
        code, err = run(capsys, *words, "-o", str(tmp_path / "out.md"))
        assert code == 2, words
        assert "pip install -e '.[learn]'" in err, words


def test_an_interrupt_in_training_stays_one(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "mine", progress=interrupt, epochs=2)
    assert signal.getsignal(signal.SIGINT) is before
    assert {each.name for each in (tmp_path / "mine").iterdir()} == {"training.txt", STATE}


def test_splits_that_are_not_there_or_leave_a_side_empty(
    tiny: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("train", str(tiny[0]), "--model", "streaming", "--size", "16", "-o", str(tmp_path / "out"))
    code, err = run(capsys, *words, "--split", str(tmp_path / "none.json"))
    assert code == 2
    assert "No such file" in err
    sides = {"train": [0, 1, 6, 7], "val": [], "test": [4]}
    (tmp_path / "split.json").write_text(
        json.dumps({"sides": sides, "apart": ["seed"], "left_out": [2, 3, 5, 8, 9, 10, 11], "shared": {}})
    )
    code, err = run(capsys, *words, "--split", str(tmp_path / "split.json"))
    assert code == 2
    assert "the split leaves val empty" in err
    assert not (tmp_path / "out").exists()
