"""Recordings that hardly fit: as long as a window, shorter than an activity, of another band than one of several networks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from learn_maps import CLASSES, ridges
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.learn import Ensemble, SavedModel
from t2d_rt.learn.figures import prediction_figure
from t2d_rt.learn.prediction import Prediction, predict
from t2d_rt.learn.saved_models import Card
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar

torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")

RADAR = Radar.preset("table2-uniform")


class Even(SavedModel):
    """A network that knows nothing."""

    def probabilities(self, levels: np.ndarray) -> np.ndarray:
        return np.full((len(levels), 3), 1 / 3)


@pytest.fixture(scope="module")
def recording() -> Recording:
    cube = np.random.default_rng(0).normal(size=(round(1.2 * RADAR.prf_hz), 1, RADAR.samples))
    return Recording(cube.astype(np.complex64), RADAR)


@pytest.fixture(scope="module")
def model(recording: Recording) -> SavedModel:
    """Its window is as long as the recording's spectrogram."""
    times = recording.processed().spectrogram.time_s.values
    card = Card(
        model="streaming", classes=CLASSES, size=(16, 16), velocity_mps=(-1.0, 1.0), dynamic_range_db=60.0, seed=0,
        duration_s=float(times[-1] - times[0] + times[1] - times[0]),
    )  # fmt: skip
    return Even(card, torch.nn.Identity())


@pytest.mark.parametrize("shorter", [0.0, 1e-15, 1e-12, 1e-7])
def test_a_recording_as_long_as_a_window_is_one_window(
    model: SavedModel, recording: Recording, shorter: float
) -> None:  # fmt: skip
    """But for rounding; two windows so close together were 1e15 instants, more than any memory holds."""
    card = model.card.model_copy(update={"duration_s": model.card.duration_s * (1 - shorter)})
    found = predict(Even(card, model.network), recording)
    assert found.starts_s.shape == (1,)
    assert len(found.course()[0]) == 1


def test_an_activity_that_lasts_longer_than_the_recording_is_refused(model: SavedModel, recording: Recording) -> None:
    with pytest.raises(
        InputError, match=r"least_s is 3 s, but the windows of the recording cover 1\.\d+ s; give a shorter"
    ):
        predict(model, recording, least_s=3.0)
    assert predict(model, recording, least_s=model.card.duration_s).least_s == model.card.duration_s


def test_each_network_tells_of_its_band(model: SavedModel, recording: Recording) -> None:
    here, there = (
        Even(model.card.model_copy(update={"about": {"carriers_hz": [carrier]}}), model.network)
        for carrier in (RADAR.carrier_hz, 24e9)
    )
    predict(Ensemble((here, here)), recording)
    with pytest.warns(T2DWarning, match=r"is of 77 GHz, the model was trained on 24 GHz"):
        predict(Ensemble((here, there)), recording)


def test_a_folder_with_a_comma_in_its_name_is_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "one,two").mkdir()
    (tmp_path / "one").mkdir()
    for given, named in (("one,two", "one,two"), ("one, three", "one")):
        assert main(["predict", "walk.zarr", "--model", str(tmp_path / given)]) == 2
        assert f"{tmp_path / named} holds no trained model" in " ".join(capsys.readouterr().err.split())


def test_names_in_the_picture_do_not_overlap(recording: Recording) -> None:
    """Eight activities of 0.03 s have no room for theirs; that of the ninth, which lasts, is there."""
    probabilities = np.eye(2)[[0, 1] * 4 + [0] * 24]
    found = Prediction(
        classes=("abnormal walking", "bending"), starts_s=0.1 + 0.03 * np.arange(32), duration_s=0.03,
        probabilities=probabilities,
    )  # fmt: skip
    assert len(found.pieces()) == 9
    figure = prediction_figure(recording, found, title="")
    assert [each.get_text() for each in figure.axes[1].texts] == ["abnormal walking"]


def test_of_no_map_there_is_no_probability(model: SavedModel) -> None:
    assert SavedModel(model.card, model.network).probabilities(np.zeros((0, 16, 16))).shape == (0, 3)


def test_a_model_tells_what_it_was_not_trained_for() -> None:
    """Carrier, Doppler cells and contrast beyond those of the training, each in a sentence; what is alike says nothing."""
    levels = ridges(12).levels
    about = {"carriers_hz": [77e9], "cells_mps": [0.075]}
    card = Card.of("streaming", ridges(12), 60.0, seed=0, about=about)
    assert card.unfamiliar("it", carrier_hz=76e9, cell_mps=0.09, levels=levels) == []
    (carrier,) = card.unfamiliar("it", carrier_hz=24e9)
    assert "it is of 24 GHz, the model was trained on 77 GHz" in carrier
    (cell,) = card.unfamiliar("it", cell_mps=0.2)
    assert "it has Doppler cells of 0.2 m/s, those of the training 0.075 to 0.075" in cell
    (noise,) = card.unfamiliar("it", levels=levels / 3)
    assert "of it are 10 dB above the median of all, in nine of ten maps of the training 3" in noise


def test_echoes_beyond_the_speeds_of_the_training_are_told(model: SavedModel) -> None:
    """A target at 1.1 m/s, of which a model of +-0.9 m/s sees nothing, with one at 0.5 m/s."""
    times = np.arange(round(1.2 * RADAR.prf_hz)) / RADAR.prf_hz
    echoes = sum(np.exp(-4j * np.pi / RADAR.wavelength_m * speed * times) for speed in (0.5, 1.1))
    cube = np.broadcast_to(echoes[:, None, None], (len(times), 1, RADAR.samples)) + 0.1 * np.random.default_rng(
        0
    ).normal(size=(len(times), 1, RADAR.samples))
    narrow = Even(model.card.model_copy(update={"velocity_mps": (-0.85, 0.85)}), model.network)
    with pytest.warns(T2DWarning, match=r"\d\d % of the recording's power is at speeds beyond -0\.907 to 0\.907 m/s"):
        predict(narrow, Recording(cube.astype(np.complex64), RADAR))
