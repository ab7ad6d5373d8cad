"""The envelope of a spectrogram, and what the summary and the contact sheet of a data set tell."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path

import numpy as np
import pytest

from dataset_folder import recipe, write_dataset
from t2d_rt.cli import main
from t2d_rt.dataset import Dataset, dataset_sheet, plot_summary, summarise
from t2d_rt.dataset.lock import LOCK
from t2d_rt.signal.envelope import envelope

VELOCITY = np.linspace(-5, 5, 101)


def noise(shape: tuple[int, int], level_db: float, seed: int = 0) -> np.ndarray:
    """Powers of white noise, averaged over a few cells as the maps of a data set are."""
    return 10 ** (level_db / 10) * np.random.default_rng(seed).gamma(4, 0.25, shape)


def decibels(power: np.ndarray) -> np.ndarray:
    return 10 * np.log10(power / power.max())


def test_the_envelope_follows_what_moves() -> None:
    power = noise((101, 60), -40)
    instants = np.arange(60)
    torso, limb = 1.0 + 0.0 * instants, 1.0 + 2.0 * np.sin(2 * np.pi * instants / 30)
    for speeds, level in ((torso, 1.0), (limb, 0.05)):
        for offset in (-1, 0, 1):
            power[np.rint((speeds + 5) * 10).astype(int) + offset, instants] += level
    found = envelope(decibels(power), VELOCITY)
    assert found.threshold_db == pytest.approx(-34.5, abs=1.5)  # 6 dB above the noise, which is 40 dB below the torso
    np.testing.assert_allclose(found.upper_mps, np.maximum(torso, limb) + 0.1, atol=0.06)
    np.testing.assert_allclose(found.lower_mps, np.minimum(limb - 0.1, 0), atol=0.2)  # cells about 0 are not looked at
    np.testing.assert_allclose(found.torso_mps, torso, atol=0.11)
    assert found.extent_mps == pytest.approx((-1.1, 3.1), abs=0.1)


def test_neither_noise_nor_an_offset_moves() -> None:
    power = noise((101, 400), -40)
    power[49:52] += 1.0
    found = envelope(decibels(power), VELOCITY)
    assert np.mean(found.upper_mps != 0) < 0.01
    assert np.mean(found.lower_mps != 0) < 0.01


def test_without_noise_the_envelope_ends_35_db_below_the_peak() -> None:
    levels = np.full((101, 20), -200.0)
    levels[70:73], levels[80:83], levels[90:93] = 0.0, -34.0, -36.0
    found = envelope(levels, VELOCITY)
    np.testing.assert_allclose(found.upper_mps, 3.2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("data") / "tiny", failed=(4,))


def test_the_summary_counts_what_there_is(folder: Path) -> None:
    found = summarise(folder)
    walking, bending = found.classes
    assert (found.samples, found.wanted, found.failures) == (11, 12, ("no room",))
    assert (walking.samples, walking.descriptions, walking.passed, walking.reason) == (5, 3, 5, None)
    assert (bending.samples, bending.passed, bending.reason) == (6, 3, "too fast")
    np.testing.assert_array_equal(walking.snr_db, [20, 22, 26, 28, 30])
    np.testing.assert_array_equal(bending.made_s, [5, 7, 9, 11, 13, 15])
    assert found.clips == 11
    assert found.groups == (2, 2, 2, 2, 2, 1)
    assert found.seconds_left is None
    text = str(found)
    assert "tiny: 11 of 12 samples, 1 failed" in text
    assert "bending: most that do not pass: too fast" in text
    assert "failed 1 times: no room" in text


def test_time_left_is_that_of_the_run_in_the_folder(folder: Path, tmp_path: Path) -> None:
    copy = write_dataset(tmp_path / "copy", recipe(samples_per_description=20))
    for number in range(4, 24):  # 20 of the 120 samples are there
        for kind in ("npz", "jsonl"):
            (copy / "shards" / f"{number:05d}.{kind}").unlink()
    for number in range(4):
        os.utime(copy / "shards" / f"{number:05d}.jsonl", (1000 + 10 * number,) * 2)
    assert summarise(copy).seconds_left is None
    lock = copy / LOCK
    lock.write_text(json.dumps({"pid": os.getpid(), "host": socket.gethostname()}))
    assert summarise(copy).seconds_left == pytest.approx(100 * 10 / 5)  # shards of five samples, 10 s apart
    assert "a run goes on; at its rate the whole recipe is done in 3 min" in str(summarise(copy))
    lock.write_text(json.dumps({"pid": 2**22 + 1, "host": socket.gethostname()}))  # no process has it
    assert summarise(copy).seconds_left is None


def test_the_sheet_has_a_row_for_each_class_and_axes_in_units(folder: Path) -> None:
    figure = dataset_sheet(Dataset(folder), columns=4, dynamic_range_db=30)
    *cells, bar = figure.axes
    assert len(cells) == 8
    images = [axes.images[0] for axes in cells if axes.images]
    assert len(images) == 8
    assert images[0].get_extent() == [0.0, 5.0, pytest.approx(-4.2667, abs=1e-3), pytest.approx(4.2667, abs=1e-3)]
    assert images[0].get_clim() == pytest.approx((-30, 0), abs=0.01)  # noise is at -40 dB and less
    assert bar.get_ylabel() == "Power [dB re 1 W]"
    texts = [each.get_text() for each in figure.texts]
    assert "Time [s]" in texts
    assert "Radial velocity [m/s], approaching > 0" in texts
    # Three descriptions first, then another sample of one of them.
    dataset = Dataset(folder)
    np.testing.assert_array_equal(images[4].get_array(), dataset.values(1, "spectrogram"))


def test_the_summary_is_drawn(folder: Path) -> None:
    balance, *_, extents = plot_summary(summarise(folder)).axes
    assert [each.get_text() for each in balance.get_yticklabels()] == ["walking", "bending"]
    assert [bar.get_width() for bar in balance.containers[1]] == [0, 3]
    assert extents.get_xlabel() == "Least and greatest speed [m/s], approaching > 0"


def test_the_command_prints_and_draws(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "small.png"
    assert main(["dataset", "summary", str(folder)]) == 0
    assert "tiny: 11 of 12 samples" in capsys.readouterr().out
    assert main(["dataset", "summary", str(folder), "-o", str(picture)]) == 0
    assert sorted(each.name for each in tmp_path.iterdir()) == ["small.png", "small_classes.png"]
    assert main(["dataset", "summary", str(folder), "-o", str(picture)]) == 2
    assert "small.png exists already" in capsys.readouterr().err
