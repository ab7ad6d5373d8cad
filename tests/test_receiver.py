"""The receiver: each effect against its closed form, and what it must not change."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt.constants import BOLTZMANN
from t2d_rt.cubes import DiskCube
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.noise.receiver import chain, receive
from t2d_rt.rows import ScratchRows

RADAR = t2d.Radar.preset("table2", samples=64)
FAN = t2d.TableFan(position_m=(3, -1, 1), rpm=120)


def silence(rows: int = 400, radar: t2d.Radar = RADAR) -> np.ndarray:
    return np.zeros((rows, radar.antennas, radar.samples), np.complex64)


def through(cube: np.ndarray, radar: t2d.Radar = RADAR, *, seed: int = 0, **fields: Any) -> np.ndarray:
    """A copy of the cube through a receiver that has these effects alone."""
    receiver = t2d.Receiver(**{"temperature_k": None, **fields})
    return np.asarray(receive(cube.copy(), radar, receiver, seed)[0])


def power(samples: np.ndarray) -> float:
    return float(np.mean(np.abs(samples.astype(np.complex128)) ** 2))


def db(ratio: float) -> float:
    return 10 * math.log10(ratio)


def fan(**options: Any) -> t2d.Recording:
    radar = t2d.Radar.preset("ci4r", prf_hz=2000, samples=32)
    return t2d.simulate(FAN.mesh(0, 0.3), radar=radar, accuracy={"sagitta_rad": 1.5}, **options)


# --- thermal noise ---


@pytest.mark.parametrize(("temperature_k", "figure_db"), [(290.0, 15.0), (290.0, 0.0), (77.0, 3.0), (3000.0, 1.0)])
def test_thermal_noise_is_ktbf(temperature_k: float, figure_db: float) -> None:
    radar = RADAR.replace(noise_figure_db=figure_db, if_gain_db=6.0)
    found = through(silence(radar=radar), radar, temperature_k=temperature_k)
    noise_k = temperature_k + (10 ** (figure_db / 10) - 1) * 290.0
    expected = BOLTZMANN * noise_k * radar.sample_rate_hz * 10**0.6
    assert abs(db(power(found) / expected)) < 0.1  # 25 600 samples: 0.03 dB
    assert abs(db(power(found.real) / power(found.imag))) < 0.2
    if temperature_k == 290.0:
        assert expected == pytest.approx(radar.noise_power_w, rel=1e-12)


# --- ADC ---


@pytest.mark.parametrize("bits", [4, 8, 12])
def test_a_full_scale_tone_keeps_six_decibels_for_each_bit(bits: int) -> None:
    full_scale = math.sqrt(10 ** ((3.0 - 20.0 - 30) / 10))
    # Just below the highest code, where the noise of a sine is that of a random signal (the J0 terms of its exact power vanish).
    level = 1 - 0.625 * 2.0 ** (1 - bits)
    tone = level * full_scale * np.exp(2j * np.pi * 0.1234567 * np.arange(65536))
    cube = tone.reshape(-1, 1, RADAR.samples).astype(np.complex64)
    error = (through(cube, adc={"bits": bits, "full_scale_dbm": 3.0, "gain_db": 20.0}) - cube).ravel()
    for channel, wanted in ((error.real, tone.real), (error.imag, tone.imag)):
        assert abs(db(power(wanted) / power(channel) / level**2) - (6.02 * bits + 1.76)) < 0.2


def test_a_saturated_adc_is_told() -> None:
    adc = t2d.Receiver(temperature_k=None, adc={"bits": 8, "full_scale_dbm": 0.0})
    cube = np.full((10, 1, RADAR.samples), 0.01, np.complex64)
    cube[:5] *= 10  # full scale is sqrt(1 mW) = 0.0316
    with pytest.warns(
        T2DWarning, match=r"the ADC is saturated: 50 % of the samples are clipped, the highest by 10\.0 dB"
    ):
        found, settings = receive(cube, RADAR, adc, 0)
    assert settings["clipped"] == 0.5
    assert np.abs(np.asarray(found).real).max() == pytest.approx(math.sqrt(1e-3) * (1 - 2 / 2**8))


# --- draws, blocks, seeds ---


def test_rows_do_not_depend_on_blocks_or_on_how_many_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    fields: dict[str, Any] = {"temperature_k": 290.0}
    whole = through(silence(300), **fields)
    np.testing.assert_array_equal(through(silence(100), **fields), whole[:100])
    monkeypatch.setattr(chain, "block_rows", lambda shape: 5)
    np.testing.assert_array_equal(through(silence(300), **fields), whole)
    disk = DiskCube(ScratchRows((300, 1, RADAR.samples)))
    disk[0:300] = silence(300)
    found, _ = receive(disk, RADAR, t2d.Receiver(**fields), 0)
    assert isinstance(found, DiskCube)
    np.testing.assert_array_equal(np.asarray(found), whole)
    assert not np.asarray(disk).any()


def test_seeds_of_any_size_tell_apart() -> None:
    seeds = (0, 1, 2**64, 2**64 + 1, 10**300)
    found = [through(silence(16), seed=seed, temperature_k=290.0) for seed in seeds]
    assert len({each.tobytes() for each in found}) == len(seeds)
    again, _ = receive(silence(16), RADAR, t2d.Receiver(seed=1), 7)
    np.testing.assert_array_equal(np.asarray(again), found[1])


# --- recordings ---


def test_noise_free_samples_and_hashes_stay_as_they_were() -> None:
    clean = fan()
    assert clean.experiment is not None
    assert clean.experiment.noise == "none"
    assert (clean.snr_db, clean.noise_floor_dbm) == (None, None)
    assert "noise" not in clean.settings
    silent = fan(noise={"temperature_k": None})
    np.testing.assert_array_equal(silent.cube, clean.cube)
    values = clean.experiment.model_dump(mode="json")
    del values["noise"]  # as it was before there was any
    assert t2d.Experiment.model_validate(values).hash == clean.experiment.hash
    assert hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:32] == clean.experiment.hash
    assert silent.experiment is not None
    assert silent.experiment.hash != clean.experiment.hash


def test_a_noisy_recording_is_made_again_from_its_folder(tmp_path: Path) -> None:
    noisy = fan(noise="receiver", seed=5)
    assert noisy.experiment is not None
    assert noisy.experiment.noise == t2d.Receiver.preset(noisy.radar)
    noisy.save(tmp_path / "noisy.zarr")
    again = t2d.Recording.load(tmp_path / "noisy.zarr").again()
    np.testing.assert_array_equal(again.cube, noisy.cube)
    assert again.snr_db == noisy.snr_db
    experiment = t2d.Experiment.model_validate_json(noisy.experiment.model_dump_json())
    assert experiment == noisy.experiment
    (tmp_path / "experiment.yaml").write_text(noisy.experiment.to_yaml())
    experiment = t2d.Experiment.from_yaml(tmp_path / "experiment.yaml")
    np.testing.assert_array_equal(t2d.run(experiment, noisy.accuracy).cube, noisy.cube)


def test_levels_are_those_of_the_samples() -> None:
    clean, noisy = fan(), fan(noise={})
    added = np.asarray(noisy.cube) - np.asarray(clean.cube)
    assert noisy.noise_floor_dbm is not None
    assert noisy.snr_db is not None
    assert abs(db(power(added)) + 30 - noisy.noise_floor_dbm) < 0.1
    moving = np.asarray(clean.cube) - np.asarray(clean.cube).mean(axis=0)
    assert noisy.snr_db == pytest.approx(db(power(moving)) + 30 - noisy.noise_floor_dbm, abs=0.01)
    assert "SNR" in repr(noisy)
    assert "thermal noise" in noisy._repr_html_()


def test_noise_by_name_file_mapping_and_value(tmp_path: Path) -> None:
    receiver = t2d.Receiver(adc={"bits": 10, "full_scale_dbm": 0}, seed=3)
    (tmp_path / "mine.yaml").write_text(receiver.to_yaml())
    text = "targets: [{kind: fan, position_m: [3, 0, 1]}]\nradar: table2\n"
    for noise in (str(tmp_path / "mine.yaml"), receiver.model_dump(), receiver):
        assert t2d.Experiment(targets=[FAN], radar="table2", noise=noise).noise == receiver
    (tmp_path / "experiment.yaml").write_text(f"{text}noise: mine.yaml\n")
    assert t2d.Experiment.from_yaml(tmp_path / "experiment.yaml").noise == receiver
    (tmp_path / "experiment.yaml").write_text(f"{text}noise: receiver\n")
    assert t2d.Experiment.from_yaml(tmp_path / "experiment.yaml").noise == t2d.Receiver.preset(
        t2d.Radar.preset("table2")
    )


@pytest.mark.parametrize("name", t2d.presets())
def test_every_preset_has_a_receiver(name: str) -> None:
    assert t2d.Receiver.preset(t2d.Radar.preset(name)).adc is not None


@pytest.mark.parametrize(
    ("noise", "told"),
    [
        ("loud", "noise must be 'none', 'receiver', a YAML file, a mapping or a Receiver, got 'loud'"),
        (3, "noise must be 'none', 'receiver'"),
        (
            {"adc": {"bits": -8, "full_scale_dbm": 0}},
            "receiver's ADC key bits: got -8, should be greater than or equal to 2",
        ),
        (
            {"adc": {"bits": 12, "full_scale_dbm": -math.inf}},
            "receiver's ADC key full_scale_dbm: got -inf, should be a finite number",
        ),
        ({"temperature_k": 0}, "receiver key temperature_k: got 0, should be greater than 0"),
        ({"temperature_k": math.nan}, "should be a finite number"),
        ({"seed": -1}, "receiver key seed: got -1"),
        ({"adcs": {}}, "unknown receiver key 'adcs'; did you mean adc?"),
        ({"adc": True}, "receiver key adc"),
        (
            {"phase_noise": {"kind": "mask", "points": [[1e6, -90], [1e5, -80]]}},
            "offsets of a phase-noise mask must rise, got 100000 Hz after 1e\\+06 Hz; sort its points",
        ),
        ({"phase_noise": {"kind": "mask", "points": []}}, "phase-noise mask key points is empty"),
        ({"phase_noise": {"kind": "mush"}}, "receiver key phase_noise: unknown kind 'mush'"),
    ],
)
def test_what_no_receiver_can_have_is_refused(noise: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        t2d.Experiment(targets=[FAN], radar="table2", noise=noise)


def test_bands_without_a_receiver_are_refused() -> None:
    radar = t2d.Radar.preset("table2", carrier_hz=10e9, slope_hz_per_s=1e12)
    with pytest.raises(
        InputError, match=r"no receiver is shipped for 10\.02 GHz \(there are those for 22 to 29, 56 to 71"
    ):
        t2d.Receiver.preset(radar)
