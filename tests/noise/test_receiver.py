"""The receiver: each effect against its closed form, and what it must not change."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from measures import db
from t2d_rt.cli import main
from t2d_rt.core.constants import BOLTZMANN
from t2d_rt.core.cube_storage import ScratchRows
from t2d_rt.core.cubes import DiskCube
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.noise.receiver import chain, receive
from t2d_rt.noise.receiver.chain import RINGING, Interference, filtered_chirp
from t2d_rt.noise.receiver.draws import Draws
from t2d_rt.noise.receiver.flicker import filter_of
from t2d_rt.noise.receiver.phase_noise import (
    SMALL_RAD,
    Oscillator,
    _factors,
    bin_delays_s,
    bounding,
    lags,
    residual_rms_rad,
)  # fmt: skip

RADAR = t2d.Radar.preset("table2", samples=64)
FAN = t2d.TableFan(position_m=(3, -1, 1), rpm=120)


def silence(rows: int = 400, radar: t2d.Radar = RADAR) -> np.ndarray:
    return np.zeros((rows, radar.antennas, radar.samples), np.complex64)


def through(cube: np.ndarray, radar: t2d.Radar = RADAR, *, seed: int = 0, **fields: Any) -> np.ndarray:
    """A copy of the cube through a receiver that has these effects alone."""
    receiver = t2d.Receiver(**{"temperature_k": None, **fields})
    return np.asarray(receive(cube.copy(), radar, receiver, seed)[0])


def tone(number: float, rows: int, radar: t2d.Radar = RADAR, level: float = 1.0) -> np.ndarray:
    """A cube of a beat that lies in a range bin, alike in all rows and antennas."""
    beat = level * np.exp(2j * np.pi * number * np.arange(radar.samples) / radar.samples)
    return np.array(np.broadcast_to(beat, (rows, radar.antennas, radar.samples)), np.complex64)


def oscillator_of(**shape: Any) -> Oscillator:
    found = t2d.Receiver(phase_noise=shape).phase_noise
    assert found is not None
    return found


def power(samples: np.ndarray) -> float:
    return float(np.mean(np.abs(samples.astype(np.complex128)) ** 2))


@cache
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
    sine = level * full_scale * np.exp(2j * np.pi * 0.1234567 * np.arange(65536))
    cube = sine.reshape(-1, 1, RADAR.samples).astype(np.complex64)
    error = (through(cube, adc={"bits": bits, "full_scale_dbm": 3.0, "gain_db": 20.0}) - cube).ravel()
    for channel, wanted in ((error.real, sine.real), (error.imag, sine.imag)):
        assert abs(db(power(wanted) / power(channel) / level**2) - (6.02 * bits + 1.76)) < 0.2


def test_a_saturated_adc_is_told() -> None:
    adc = t2d.Receiver(temperature_k=None, adc={"bits": 8, "full_scale_dbm": 0.0})
    cube = np.full((10, 1, RADAR.samples), 0.01, np.complex64)
    cube[:5] *= 10  # full scale is sqrt(1 mW) = 0.0316
    with pytest.warns(T2DWarning, match=r"saturated: 50 % of the samples are clipped, the highest by 10\.0 dB"):
        found, settings = receive(cube, RADAR, adc, 0)
    assert settings["clipped"] == 0.5
    assert np.abs(np.asarray(found).real).max() == pytest.approx(math.sqrt(1e-3) * (1 - 2 / 2**8))


@pytest.mark.parametrize("offset_dbm", [None, -10.0])
def test_a_step_beyond_the_signal_is_told_with_the_gain_that_mends_it(offset_dbm: float | None) -> None:
    receiver = t2d.Receiver(
        temperature_k=None, dc_offset_dbm=offset_dbm, adc={"bits": 8, "full_scale_dbm": 0.0, "gain_db": 10.0}
    )
    beat = np.exp(2j * np.pi * 0.1234567 * np.arange(10 * RADAR.samples)).reshape(10, 1, RADAR.samples)
    small = (0.03 * receiver.adc.step * beat).astype(np.complex64)
    # The rms of I is 0.0212 steps: 33.5 dB to one.
    expected = (
        r"times the rms of what comes in, and 100 % of the samples .* raise adc.gain_db from 10 to 44, lower adc.full_scale_dbm by "
        r"34 dB, or give adc.bits 6 more"
    )
    with pytest.warns(T2DWarning, match=expected):
        found, _ = receive(small.copy(), RADAR, receiver, 0)
    assert np.unique(np.asarray(found)).size == 1
    for mended in ({"gain_db": 44.0}, {"full_scale_dbm": -34.0}, {"bits": 14}):
        adc = {**receiver.adc.model_dump(), **mended}
        found, _ = receive(small.copy(), RADAR, receiver.replace(adc=adc, dc_offset_dbm=None), 0)  # no warning
        assert db(power(np.asarray(found) - small) / power(small)) < -9  # step^2 / 12 of an rms of a step: -10.8 dB


def test_neither_silence_nor_noise_of_a_step_is_called_too_small() -> None:
    adc = {"bits": 12, "full_scale_dbm": 0.0}
    receive(np.zeros((4, 1, RADAR.samples), np.complex64), RADAR, t2d.Receiver(temperature_k=None, adc=adc), 0)
    for band in ("table2", "indoor-60", "ism-24"):
        radar = t2d.Radar.preset(band)
        receive(np.zeros((4, radar.antennas, radar.samples), np.complex64), radar, t2d.Receiver.preset(radar), 0)


def test_a_wall_close_by_is_told() -> None:
    """A large metal wall 1 m away is the mirror image of the radar, 2 m away: 30 dB of gain suit it, 60 dB do not."""
    radar = t2d.Radar.preset("table2")
    mirror_w = 10 ** ((12.0 + 9 + 9 - 30) / 10) * (radar.wavelength_m / (4 * np.pi * 2)) ** 2
    beat = np.exp(2j * np.pi * float(radar.beat_frequency_hz(1.0)) * radar.sample_times_s)
    cube = np.array(np.broadcast_to(math.sqrt(mirror_w) * beat, (8, 1, radar.samples)), np.complex64)
    receiver = t2d.Receiver.preset(radar)
    _, settings = receive(cube.copy(), radar, receiver, 0)
    assert settings["adc_peak_dbfs"] == pytest.approx(-25, abs=1)
    with pytest.warns(T2DWarning, match="the ADC is saturated: .* by 5.* dB; lower adc.gain_db"):
        _, settings = receive(cube, radar, receiver.replace(adc={**receiver.adc.model_dump(), "gain_db": 60}), 0)
    assert settings["clipped"] > 0.5


@pytest.mark.slow
def test_noise_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = str(tmp_path / "noisy.zarr")
    words = f"simulate walk --method ellipsoid --radar ci4r --stop-s 0.1 --distance-m 3 -o {where}".split()
    assert main([*words, "--noise", "{adc: {bits: 12, full_scale_dbm: 9, gain_db: 30}}"]) == 0
    assert "dB over all noise of the receiver, -8" in capsys.readouterr().out
    noisy = t2d.Recording.load(where)
    assert isinstance(noisy.experiment.noise, t2d.Receiver)
    assert noisy.settings["noise"] == "thermal noise, ADC"


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


# --- gain against range ---


def test_snr_falls_with_the_fourth_power_of_range() -> None:
    radar = t2d.Radar.preset("table2")
    near, far = 5 * radar.range_resolution_m * 4, 10 * radar.range_resolution_m * 4
    ratios = []
    for range_m in (near, far):
        amplitude = math.sqrt(radar.received_power_w(100.0, range_m))
        beat = np.exp(2j * np.pi * radar.beat_frequency_hz(range_m) * radar.sample_times_s)
        clean = np.broadcast_to((amplitude * beat).astype(np.complex64), (400, 1, radar.samples))
        noisy = through(np.array(clean), radar, temperature_k=290.0)
        spectrum = np.abs(np.fft.fft(noisy, axis=2) / radar.samples) ** 2
        peak = round(range_m / radar.range_resolution_m)
        noise = np.delete(spectrum.mean(axis=0)[0], peak).mean()
        ratios.append((spectrum[:, 0, peak].mean() - noise) / noise)
        assert abs(db(ratios[-1]) - db(amplitude**2 * radar.samples / radar.noise_power_w)) < 0.1
    assert abs(db(ratios[0] / ratios[1]) - 40 * math.log10(2)) < 0.1


# --- random numbers, sums over chirps ---


def test_numbers_of_samples_chirps_and_effects_are_independent_and_normal() -> None:
    radar = t2d.Radar.preset("table2")
    thermal = through(silence(2048, radar), radar, temperature_k=290.0)[:, 0] / math.sqrt(radar.noise_power_w)
    other = through(silence(2048, radar), radar, seed=1, temperature_k=290.0)[:, 0] / math.sqrt(radar.noise_power_w)
    parts = thermal.view(np.float32).astype(float) * math.sqrt(2)
    count = parts.size
    assert abs(parts.mean()) < 4 / math.sqrt(count)
    # Moments of a normal number and the spread of their estimates: Kendall and Stuart.
    for order, moment, spread in ((2, 1, 2), (3, 0, 15), (4, 3, 96), (6, 15, 10170)):
        assert abs((parts**order).mean() - moment) < 4 * math.sqrt(spread / count), order
    assert np.mean(np.abs(parts) > 4) == pytest.approx(6.334e-5, rel=0.35)  # 66 of them
    # White over chirps, over samples, and over both: every cell of the spectrum is that of a part alone.
    spectrum = np.abs(np.fft.fft2(thermal)) ** 2 / thermal.size
    assert spectrum.max() < math.log(thermal.size) + 7
    for axis in (0, 1):
        line = spectrum.mean(axis=axis)
        assert np.abs(line - 1).max() < 6 / math.sqrt(spectrum.shape[axis])
    cross = np.abs(np.fft.ifft2(np.fft.fft2(thermal) * np.conj(np.fft.fft2(other)))) / math.sqrt(thermal.size)
    assert (cross**2).max() < math.log(thermal.size) + 7
    assert abs((thermal**2).mean()) < 5 / math.sqrt(thermal.size)  # I and Q
    assert abs(np.mean(np.abs(thermal[:, 1:]) ** 2 * np.abs(thermal[:, :-1]) ** 2) - 1) < 0.02
    assert abs(np.mean(np.abs(thermal[1:]) ** 2 * np.abs(thermal[:-1]) ** 2) - 1) < 0.02


@pytest.mark.parametrize("samples", [16, 64, 65, 256, 1024])
def test_the_filter_of_flicker_noise_keeps_to_its_density(samples: int) -> None:
    found = filter_of(samples)
    frequency = np.geomspace(0.3 / samples, 0.5, 4000)
    assert np.abs(10 * np.log10(found.density(frequency) * frequency)).max() < 0.15
    # The first samples have the spectrum of the last: the state begins stationary.
    covariance = np.outer(found.gains, found.gains) / (1 - np.outer(found.poles, found.poles))
    np.testing.assert_allclose(found.begin @ found.begin.T, covariance, rtol=1e-9)
    lines = (np.arange(200_000) + 0.5) / 200_000 / 2
    assert covariance.sum() == pytest.approx(found.density(lines).mean(), rel=2e-3)


def test_flicker_noise_is_as_strong_at_a_chirps_begin_as_at_its_end() -> None:
    found = through(silence(20_000), flicker_corner_hz=1e5)[:, 0]
    of_samples = np.mean(np.abs(found) ** 2, axis=0)
    assert np.abs(10 * np.log10(of_samples / of_samples.mean())).max() < 0.3


@pytest.mark.parametrize("shape", [(9, 1, 64), (5, 3, 33)])
def test_lags_are_those_of_the_samples(shape: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(1)
    samples = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    found = lags(samples, 2)
    expected = [(np.roll(samples, -lag, axis=2) * samples.conj()).sum(axis=2) for lag in range(3)]
    parts = [expected[0].real, expected[1].real, expected[1].imag, expected[2].real, expected[2].imag]
    np.testing.assert_allclose(found, np.stack(parts, axis=2), atol=1e-4)


def test_the_bound_of_phase_noise_lies_above_it() -> None:
    rng = np.random.default_rng(2)
    values = np.concatenate([np.linspace(0, 1, 200) ** 2, np.linspace(1, 0, 56)])
    bound = bounding(values)
    samples = (rng.normal(size=(40, 1, 256)) + 1j * rng.normal(size=(40, 1, 256))).astype(np.complex64)
    samples[:20] *= np.exp(2j * np.pi * rng.integers(256, size=(20, 1, 1)) / 256 * np.arange(256))
    exact = (np.abs(np.fft.fft(samples, axis=2)) ** 2 * values).sum(axis=2) / 256
    bounded = lags(samples, 2) @ bound
    assert (bounded > 0.999 * exact).all()
    assert (bounded < 3 * exact).all()


def test_no_row_at_the_limit_is_missed_by_the_bound() -> None:
    """Also where what the sums of float32 are wrong by is more of the level than it is of the greatest one."""
    rng = np.random.default_rng(3)
    values = np.minimum(np.arange(64), np.arange(64)[::-1]) ** 2.0 / 32**2
    beats = rng.uniform(0, 3, (3000, 1, 1)) / 64 * np.arange(64)
    samples = (rng.uniform(0.5, 2, (3000, 1, 1)) * np.exp(2j * np.pi * beats)).astype(np.complex64)
    exact = (np.abs(np.fft.fft(samples.astype(complex), axis=2)) ** 2 * values).sum(axis=2) / 64
    assert (lags(samples, 2) @ bounding(values) >= exact).all()


def test_chirps_for_whose_flicker_noise_no_filter_is_fitted_are_refused() -> None:
    radar = RADAR.replace(samples=100_001, sample_rate_hz=2e9, prf_hz=1000.0, slope_hz_per_s=1e12)
    with pytest.raises(InputError, match="1/f noise is made for chirps of up to 100000 samples, got 100001"):
        chain.check_receiver(radar, t2d.Receiver(flicker_corner_hz=1e5))


# --- phase noise ---

MASK = {"kind": "mask", "points": [[1e5, -75.0], [1e6, -85.0], [1e7, -95.0]]}


def residual_phase(bin_number: float, rows: int, mask: Any, radar: t2d.Radar) -> np.ndarray:
    """Phase noise [rad] left on an echo in a range bin, (row, sample)."""
    cube = tone(bin_number, rows, radar)
    return np.angle(through(cube, radar, phase_noise=mask) * np.conj(cube))[:, 0]


def spectrum_of(phase: np.ndarray, rate_hz: float) -> np.ndarray:
    """Two-sided power density over the frequencies of the rows' FFT [1/Hz], through a Hann window, mean over rows."""
    window = np.hanning(phase.shape[1])
    return np.asarray(np.mean(np.abs(np.fft.fft(window * phase, axis=1)) ** 2, axis=0) / (window @ window) / rate_hz)


@pytest.mark.parametrize("bins", [(20.0, 60.0), (33.3, 140.5), (8.5, 200.5)])
def test_residual_phase_noise_is_range_correlated(bins: tuple[float, float]) -> None:
    radar = t2d.Radar.preset("table2")
    mask = oscillator_of(**MASK)
    frequency = np.fft.fftfreq(radar.samples, 1 / radar.sample_rate_hz)
    band = slice(6, radar.samples // 2 - 2)
    found, expected = [], []
    for number in bins:
        delay_s = number / radar.samples * radar.sample_rate_hz / radar.slope_hz_per_s
        spectrum = spectrum_of(residual_phase(number, 1500, MASK, radar), radar.sample_rate_hz)
        closed = 4 * np.sin(np.pi * frequency * delay_s) ** 2 * mask.density(frequency)
        found.append(spectrum[band].sum())
        expected.append(closed[band].sum())
        for part in np.array_split(np.arange(band.start, band.stop), 6):
            assert abs(db(spectrum[part].sum() / closed[part].sum())) < 0.2
    assert abs(db(found[0] / found[1] / (expected[0] / expected[1]))) < 0.2


@pytest.mark.parametrize(
    "oscillator",
    [
        {"kind": "leeson", "floor_dbc_hz": -120.0, "half_bandwidth_hz": 2e6, "flicker_hz": 1e5},
        {"kind": "mask", "points": [[1e5, -80.0], [1e6, -90.0]]},
    ],
)
def test_the_masks_integral_is_the_variance_of_the_phase(oscillator: dict[str, Any]) -> None:
    """At half a cycle of delay at the edge of the band, the residual's variance is the integral of 4 sin^2 L."""
    radar = t2d.Radar.preset("table2")
    number = 100.0
    delay_s = number / radar.samples * radar.sample_rate_hz / radar.slope_hz_per_s
    frequency = (np.arange(1_000_000) + 0.5) / 1_000_000 * radar.sample_rate_hz / 2
    integral = 2 * np.mean(
        4 * np.sin(np.pi * frequency * delay_s) ** 2 * oscillator_of(**oscillator).density(frequency)
    )
    integral *= frequency[-1]
    phase = residual_phase(number, 1500, oscillator, radar)
    assert abs(db(np.var(phase) / integral)) < 0.2


def test_leesons_model_and_masks_have_their_slopes() -> None:
    leeson = oscillator_of(kind="leeson", floor_dbc_hz=-150, half_bandwidth_hz=1e6, flicker_hz=1e4)
    level = 10 * np.log10(leeson.density(np.array([1e2, 1e3, 1e5, 2e5, 1e9, -1e9])))
    assert level[0] - level[1] == pytest.approx(30, abs=0.5)
    assert level[2] - level[3] == pytest.approx(20 * math.log10(2), abs=0.3)
    assert level[4:] == pytest.approx([-150, -150], abs=0.01)
    found = 10 * np.log10(oscillator_of(**MASK).density(np.array([1.0, 1e5, 10**5.5, -1e6, 1e9])))
    np.testing.assert_allclose(found, [-75, -75, -80, -85, -95], atol=1e-9)


def test_phase_noise_is_shared_by_antennas_and_slow_noise_by_chirps() -> None:
    radar = t2d.Radar.preset("table2", rx_offsets_m=[(0, 0, 0), (0, 0.002, 0)], samples=32)
    steep = {"kind": "mask", "points": [[10.0, 0.0], [1e5, -160.0]]}  # what folds at the PRF is weak
    cube = tone(10, 20_000, radar)
    phase = np.angle(through(cube, radar, phase_noise=steep) * np.conj(cube))
    np.testing.assert_allclose(phase[:, 0], phase[:, 1], atol=1e-6)
    of_chirps = phase[:, 0].mean(axis=1)
    spectrum = np.abs(np.fft.fft((of_chirps * np.hanning(20_000)).reshape(1, -1), axis=1)[0]) ** 2
    frequency = np.fft.fftfreq(20_000, 1 / radar.prf_hz)
    delay_s = 10 / 32 * radar.sample_rate_hz / radar.slope_hz_per_s
    window, shape = np.hanning(20_000), oscillator_of(**steep)
    for low, high in ((20.0, 100.0), (100.0, 300.0), (300.0, 1000.0)):
        within = (np.abs(frequency) > low) & (np.abs(frequency) < high)
        expected = (2 * np.pi * frequency[within] * delay_s) ** 2 * shape.density(frequency[within])
        found = spectrum[within] / (window @ window) / radar.prf_hz
        assert abs(db(found.sum() / expected.sum())) < 1.0  # a few hundred bins, not independent


def test_negligible_phase_noise_is_left_out_and_no_other() -> None:
    radar = t2d.Radar.preset("table2")
    for level, changes in ((1e-7, False), (1e-3, True)):
        cube = tone(100, 4, radar, level)
        thermal = through(cube, radar, temperature_k=290.0)
        both = through(cube, radar, temperature_k=290.0, phase_noise=MASK)
        assert (both != thermal).any() == changes


# --- I/Q imbalance, constant, 1/f noise ---


@pytest.mark.parametrize(("gain_db", "phase_deg"), [(0.5, 0.0), (0.0, 3.0), (-1.0, 5.0)])
def test_the_image_is_rejected_as_the_imbalance_says(gain_db: float, phase_deg: float) -> None:
    fields = {"gain_db": gain_db, "phase_deg": phase_deg}
    spectrum = np.abs(np.fft.fft(through(tone(10, 4), iq_imbalance=fields), axis=2)) ** 2
    g, p = 10 ** (gain_db / 20), math.radians(phase_deg)
    expected = (1 + 2 * g * math.cos(p) + g**2) / (1 - 2 * g * math.cos(p) + g**2)
    assert abs(db(spectrum[0, 0, 10] / spectrum[0, 0, 54]) - db(expected)) < 0.01
    imbalance = t2d.Receiver(iq_imbalance=fields).iq_imbalance
    assert imbalance.image_rejection_db == pytest.approx(db(expected))


def test_the_constant_has_its_power_and_a_phase_for_each_receiver() -> None:
    radar = t2d.Radar.preset("array-3x4")
    found = through(silence(3, radar), radar, dc_offset_dbm=-40.0)
    np.testing.assert_allclose(np.abs(found), math.sqrt(1e-7), rtol=1e-5)
    assert (found == found[:1, :, :1]).all()
    assert len(np.unique(found[0, :, 0])) == 4
    np.testing.assert_array_equal(found[:, :4], found[:, 4:8])  # the same receivers in the next time slot


def test_flicker_noise_falls_by_ten_decibels_per_decade_from_its_corner() -> None:
    radar = t2d.Radar.preset("table2")
    corner_hz = 100e3
    found = through(silence(4000, radar), radar, flicker_corner_hz=corner_hz)[:, 0]
    spectrum = spectrum_of(found, radar.sample_rate_hz) + spectrum_of(np.conj(found), radar.sample_rate_hz)
    frequency = np.fft.fftfreq(radar.samples, 1 / radar.sample_rate_hz)
    thermal = radar.noise_power_w / radar.sample_rate_hz
    for low, high in ((1e5, 3e5), (3e5, 1e6), (1e6, 3e6)):
        within = (frequency > low) & (frequency < high)
        expected = thermal * corner_hz / frequency[within]
        assert abs(db(spectrum[within].sum() / 2 / expected.sum())) < 0.2


def test_flicker_noise_of_chirps_goes_on_below_the_prf() -> None:
    radar = t2d.Radar.preset("table2", samples=32)
    found = through(silence(20_000, radar), radar, flicker_corner_hz=1e5)[:, 0].mean(axis=1)
    spectrum = np.abs(np.fft.fft(found * np.hanning(20_000))) ** 2 / np.sum(np.hanning(20_000) ** 2) / radar.prf_hz
    frequency = np.abs(np.fft.fftfreq(20_000, 1 / radar.prf_hz))
    low, high = ((frequency > lowest) & (frequency < 2 * lowest) for lowest in (10.0, 40.0))
    assert abs(db(spectrum[low].mean() / spectrum[high].mean()) - 6.02) < 1.5
    expected = radar.noise_power_w / radar.sample_rate_hz * 1e5 / frequency[high]
    assert abs(db(spectrum[high].sum() / expected.sum())) < 1.0


def test_phase_noise_beyond_small_angles_is_told() -> None:
    """White phase noise of density L up to half the sample rate leaves 2 L fs (1 - sinc(fs tau)) at a delay tau."""
    oscillator = oscillator_of(kind="mask", points=[[1e6, -70]])
    rate, delay_s = RADAR.sample_rate_hz, np.abs(bin_delays_s(RADAR)).max()
    expected = math.sqrt(2 * 1e-7 * rate * (1 - np.sinc(rate * delay_s)))
    assert residual_rms_rad(RADAR, oscillator) == pytest.approx(expected, rel=1e-2)
    with pytest.warns(T2DWarning, match=r"phase noise leaves up to .* rad rms within the range axis"):
        through(silence(4), phase_noise={"kind": "mask", "points": [[1e6, -55]]})


# --- interference ---

OTHER = {"position_m": (30.0, 0.0, 1.0), "carrier_hz": 77.0e9, "duration_s": 60e-6, "interval_s": 200e-6}


@pytest.mark.parametrize("difference", [5e11, -5e11])
def test_a_burst_has_the_length_of_bandwidth_over_slope_difference(difference: float) -> None:
    """Its energy is its power times that length, and its frequency changes by the difference of the slopes."""
    radar = t2d.Radar.preset("table2", samples=1024, prf_hz=5000)
    slope, begins_s = radar.slope_hz_per_s - difference, -0.2e-6
    # The beat enters the IF band at a third of the chirp.
    enters_hz = 0 if difference > 0 else radar.sample_rate_hz
    at_start_hz = enters_hz - difference * radar.sweep_time_s / 3
    carrier_hz = radar.carrier_hz - at_start_hz + slope * begins_s
    other = {**OTHER, "carrier_hz": carrier_hz, "slope_hz_per_s": slope, "duration_s": 150e-6}
    interferer = t2d.Receiver(interferers=[other]).interferers[0]
    place, found = Interference(radar, interferer, Draws(0), 0).burst(begins_s)
    length_s = radar.sample_rate_hz / abs(difference)
    assert abs(db(np.sum(np.abs(found) ** 2) / radar.sample_rate_hz / length_s)) < 0.2
    middle = found[RINGING + 3 : -RINGING - 3]
    steps = np.unwrap(np.angle(middle[1:] * np.conj(middle[:-1])))
    rate = steps * radar.sample_rate_hz / (2 * np.pi)
    assert np.polyfit(np.arange(len(rate)) / radar.sample_rate_hz, rate, 1)[0] == pytest.approx(difference, rel=0.02)
    first_s = (place.start + RINGING) / radar.sample_rate_hz
    assert first_s == pytest.approx(radar.sweep_time_s / 3, abs=2 / radar.sample_rate_hz)


@pytest.mark.parametrize("slope", [2e12, -3e13])
def test_the_if_filter_is_that_of_an_fft(slope: float) -> None:
    rate, count = 7e6, 4096
    fine = 64 * rate
    times = (np.arange(64 * count) - 32 * count) / fine
    chirp = np.exp(1j * np.pi * slope * times**2) * (np.abs(slope * times) < 16 * rate)
    spectrum, frequency = np.fft.fft(chirp), np.fft.fftfreq(len(times), 1 / fine)
    expected = np.fft.ifft(spectrum * ((frequency >= 0) & (frequency < rate)))
    near = np.abs(times) < 40 / rate
    found = filtered_chirp(times[near], slope, rate)
    assert power(found - expected[near]) < 3e-3 * power(expected[near])


def test_interference_has_the_power_of_friis_and_hits_as_often_as_chirps_cross() -> None:
    radar = t2d.Radar.preset("table2")
    slope = -radar.slope_hz_per_s / 2
    other = {**OTHER, "slope_hz_per_s": slope, "carrier_hz": 78.0e9, "eirp_dbm": 20.0}
    found = through(silence(4000, radar), radar, interferers=[other])[:, 0]
    difference = radar.slope_hz_per_s - slope
    wavelength = radar.wavelength_m
    power_w = 10 ** ((20.0 - 30 + radar.rx_gain_dbi) / 10) * (wavelength / (4 * np.pi * 30.0)) ** 2
    hit = (np.abs(found) ** 2).sum(axis=1) > 1e-3 * power_w
    # Both are anywhere: the crossing lies in the sweep for chirps that begin in a window of begin times, out of each interval.
    begins = np.arange(-60e-6, radar.sweep_time_s, 1e-8)
    meets = -(radar.carrier_hz - 78.0e9 + slope * begins) / difference
    crossing = (meets > 0) & (meets < radar.sweep_time_s) & (meets > begins) & (meets < begins + 60e-6)
    expected = crossing.mean() * (begins[-1] - begins[0]) / 200e-6
    assert hit.mean() == pytest.approx(expected, rel=0.1)
    energy = (np.abs(found[hit]) ** 2).sum(axis=1) / radar.sample_rate_hz
    assert abs(db(np.median(energy) / (power_w * radar.sample_rate_hz / difference))) < 0.2


def test_interference_from_the_side_has_the_phases_of_its_direction() -> None:
    radar = t2d.Radar.preset("array-3x4")
    there = {"position_m": (300.0, 300.0, 1.0), "carrier_hz": 77.5e9, "slope_hz_per_s": 30e12, "interval_s": 201e-6}
    other = OTHER | there
    found = through(silence(200, radar), radar, interferers=[other])
    slots = found.reshape(-1, 4, radar.samples)
    hit = slots[np.abs(slots).max(axis=(1, 2)).argmax()]
    step = np.angle(np.sum(hit[1:] * np.conj(hit[:-1])))
    pitch = np.diff(np.array(radar.rx_offsets_m)[:, 1])[0]
    # A receiver farther left, towards the interferer, hears it earlier; IF conjugates what is received.
    assert step == pytest.approx(-2 * np.pi * pitch * math.sin(math.pi / 4) / radar.wavelength_m, abs=0.05)


# --- effects by themselves ---

ALL = {
    "temperature_k": 290.0, "flicker_corner_hz": 1e5, "phase_noise": MASK, "dc_offset_dbm": -90.0,
    "interferers": [{**OTHER, "slope_hz_per_s": 30e12}], "iq_imbalance": {"gain_db": 0.5},
}  # fmt: skip


@pytest.mark.parametrize("left_out", [name for name in ALL if name != "iq_imbalance"])
def test_leaving_an_effect_out_does_not_change_the_draws_of_others(left_out: str) -> None:
    linear = {name: value for name, value in ALL.items() if name != "iq_imbalance"}
    rest = {name: value for name, value in linear.items() if name != left_out}
    cube = tone(30, 64, level=1e-3)
    alone = through(cube, **{left_out: ALL[left_out]}) - cube
    assert np.abs(alone).max() > 0
    both = through(cube, **linear) - through(cube, **rest)
    np.testing.assert_allclose(both, alone, atol=1e-3 * 3e-7 + 1e-9)


@pytest.mark.parametrize("name", ["table2", "array-3x4", "automotive-79", "table2-burst"])
def test_rows_of_all_effects_do_not_depend_on_blocks(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    radar = t2d.Radar.preset(name, samples=32)
    cube = np.full((150, radar.antennas, 32), 1e-3, np.complex64)
    monkeypatch.setattr("t2d_rt.noise.receiver.draws.GROUP_SAMPLES", 32 * radar.antennas * 16)
    whole = through(cube, radar, **ALL)
    np.testing.assert_array_equal(through(cube[:70], radar, **ALL), whole[:70])
    monkeypatch.setattr(chain, "block_rows", lambda shape: 1)
    np.testing.assert_array_equal(through(cube, radar, **ALL), whole)
    assert not np.array_equal(through(cube, radar, seed=1, **ALL), whole)


# --- recordings ---


def test_noise_free_samples_and_hashes_stay_as_they_were() -> None:
    clean = fan()
    assert clean.experiment.noise == "none"
    assert (clean.snr_db, clean.noise_floor_dbm) == (None, None)
    assert "noise" not in clean.settings
    silent = t2d.add_noise(clean, {"temperature_k": None})
    np.testing.assert_array_equal(silent.cube, clean.cube)
    values = clean.experiment.model_dump(mode="json")
    for later in ("noise", "only_paths", "without_paths"):  # as it was before there were any
        del values[later]
    assert t2d.Experiment.model_validate(values).hash == clean.experiment.hash
    assert hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:32] == clean.experiment.hash
    assert silent.experiment.hash != clean.experiment.hash


@pytest.mark.slow
def test_a_noisy_recording_is_made_again_from_its_folder(tmp_path: Path) -> None:
    noisy = fan(noise="receiver")
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
    clean, noisy = fan(), t2d.add_noise(fan(), {})
    added = np.asarray(noisy.cube) - np.asarray(clean.cube)
    assert noisy.noise_floor_dbm is not None
    assert noisy.snr_db is not None
    assert abs(db(power(added)) + 30 - noisy.noise_floor_dbm) < 0.1
    coarse = t2d.add_noise(clean, {"adc": {"bits": 5, "full_scale_dbm": -62}})
    assert coarse.noise_floor_dbm is not None
    assert coarse.noise_floor_dbm > noisy.noise_floor_dbm + 1
    assert abs(db(power(np.asarray(coarse.cube) - np.asarray(clean.cube))) + 30 - coarse.noise_floor_dbm) < 0.2
    moving = np.asarray(clean.cube) - np.asarray(clean.cube).mean(axis=0)
    assert noisy.snr_db == pytest.approx(db(power(moving)) + 30 - noisy.noise_floor_dbm, abs=0.1)
    assert "SNR" in repr(noisy)
    assert "thermal noise" in noisy._repr_html_()


EFFECTS = {
    "flicker_corner_hz": 1e6,
    "phase_noise": {"kind": "mask", "points": [[1e5, -90]]},
    "interferers": [{**OTHER, "slope_hz_per_s": 0.0, "carrier_hz": 77.18e9, "interval_s": 61e-6}],
    "iq_imbalance": {"gain_db": 3.0},
    "adc": {"bits": 3, "full_scale_dbm": -85.0},
}


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_snr_counts_every_effect_and_no_constant(effect: str) -> None:
    """One effect at a time, without the thermal noise that was once all that counted."""
    clean = fan()
    fields = {"temperature_k": None, effect: EFFECTS[effect]}
    found = t2d.add_noise(clean, fields)
    added = np.asarray(found.cube) - np.asarray(clean.cube)
    noise_w = power(added - added.mean(axis=0))
    moving_w = power(np.asarray(clean.cube) - np.asarray(clean.cube).mean(axis=0))
    assert found.noise_dbm == pytest.approx(db(noise_w) + 30, abs=1e-3)
    assert found.snr_db == pytest.approx(db(moving_w / noise_w), abs=1e-3)
    if effect != "adc":  # which rounds the constant too
        shifted = t2d.add_noise(clean, {**fields, "dc_offset_dbm": -60.0})
        assert shifted.snr_db == pytest.approx(found.snr_db, abs=1e-2)


def test_noise_can_be_added_later_and_once() -> None:
    clean, receiver = fan(), t2d.Receiver.preset(t2d.Radar.preset("ci4r"))
    before = np.array(clean.cube)
    later = t2d.add_noise(clean)
    direct = fan(noise="receiver")
    np.testing.assert_array_equal(later.cube, direct.cube)
    assert later.experiment == direct.experiment
    names = ("noise", "noise_dbm", "noise_floor_dbm", "snr_db", "adc_peak_dbfs", "clipped")
    assert [later.settings[name] for name in names] == [direct.settings[name] for name in names]
    np.testing.assert_array_equal(clean.cube, before)
    other = t2d.add_noise(clean, receiver, seed=2**80)
    assert not np.array_equal(other.cube, later.cube)
    np.testing.assert_array_equal(other.again().cube, other.cube)
    with pytest.raises(InputError, match="has the noise of a receiver already"):
        t2d.add_noise(later)
    with pytest.raises(InputError, match="the recording was measured, so its receiver's noise is in it"):
        t2d.add_noise(t2d.Recording(before, clean.radar))


def test_noise_of_cubes_on_disk_is_that_of_cubes_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.core.cubes.LARGE_BYTES", 1000)
    clean = fan.__wrapped__()
    assert isinstance(clean.cube, DiskCube)
    noisy = t2d.add_noise(clean)
    assert isinstance(noisy.cube, DiskCube)
    assert isinstance(noisy.experiment.noise, t2d.Receiver)
    expected, levels = receive(np.asarray(clean.cube), clean.radar, noisy.experiment.noise, 0)
    np.testing.assert_array_equal(np.asarray(noisy.cube), expected)
    assert levels["snr_db"] is not None
    assert {name: noisy.settings[name] for name in levels} == levels


def test_cubes_without_chirps_and_figures_below_zero() -> None:
    found, settings = receive(silence(0), RADAR, t2d.Receiver(**ALL), 0)
    assert found.shape == (0, 1, 64)
    assert "snr_db" not in settings
    with pytest.raises(InputError, match="noise_figure_db of a receiver with noise must be 0 or more, got -3"):
        receive(silence(1), RADAR.replace(noise_figure_db=-3), t2d.Receiver(), 0)
    with pytest.raises(InputError, match="longer than their interval"):
        t2d.Receiver(interferers=[{**OTHER, "slope_hz_per_s": 1e13, "interval_s": 50e-6}])
    for changes, told in (
        ({"samples": 8}, "need 16 samples or more, got 8"),
        ({"slope_hz_per_s": 1e9}, "up to .* us late"),
    ):
        with pytest.raises(InputError, match=told):
            receive(silence(0), RADAR.replace(**changes), t2d.Receiver(phase_noise=MASK), 0)
    here = {**OTHER, "slope_hz_per_s": 1e13, "position_m": RADAR.position_m}
    with pytest.raises(InputError, match="is at a receive antenna"):
        receive(silence(1), RADAR, t2d.Receiver(interferers=[here]), 0)


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
        ({"adc": {"bits": -8, "full_scale_dbm": 0}}, "receiver's ADC key bits: got -8, should be greater than or equal to 2"),
        ({"adc": {"bits": 12, "full_scale_dbm": -math.inf}},
         "receiver's ADC key full_scale_dbm: got -inf, should be a finite number"),
        ({"temperature_k": 0}, "receiver key temperature_k: got 0, should be greater than 0"),
        ({"temperature_k": math.nan}, "should be a finite number"),
        ({"seed": -1}, "receiver key seed: got -1"),
        ({"adcs": {}}, "unknown receiver key 'adcs'; did you mean adc?"),
        ({"adc": True}, "receiver key adc"),
        ({"phase_noise": {"kind": "mask", "points": [[1e6, -90], [1e5, -80]]}},
         "offsets of a phase-noise mask must rise, got 100000 Hz after 1e\\+06 Hz; sort its points"),
        ({"phase_noise": {"kind": "mask", "points": []}}, "phase-noise mask key points is empty"),
        ({"phase_noise": {"kind": "mush"}}, "receiver key phase_noise: unknown kind 'mush'"),
    ],
)  # fmt: skip
def test_what_no_receiver_can_have_is_refused(noise: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        t2d.Experiment(targets=[FAN], radar="table2", noise=noise)


def test_bands_without_a_receiver_are_refused() -> None:
    radar = t2d.Radar.preset("table2", carrier_hz=10e9, slope_hz_per_s=1e12)
    with pytest.raises(InputError, match=r"is shipped for 10\.02 GHz \(there are those for 22 to 29, 56 to 71"):
        t2d.Receiver.preset(radar)


def test_a_receiver_that_the_radar_cannot_have_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["t2d_rt.simulate"], "summed", lambda *_, **__: pytest.fail("it was simulated"))
    radar = t2d.Radar.preset("table2", samples=8)
    with pytest.raises(InputError, match="phase noise is sorted by range"):
        t2d.simulate(t2d.trim(t2d.example("walk"), 1, 1.1), radar=radar, method="ellipsoid", noise="receiver")


def test_phases_become_factors_without_the_loss_of_digits() -> None:
    rows = np.array(
        [[1e-6, -3e-4], [0.9 * SMALL_RAD, -0.9 * SMALL_RAD], [1.1 * SMALL_RAD, 1e-5], [2.0, -1.0]], np.float32
    )
    exact = np.expm1(1j * rows.astype(np.complex128))
    assert np.abs(_factors(rows) / exact - 1).max() < 3e-6


def test_an_snr_over_white_noise_alone_is_not_told() -> None:
    """Earlier versions saved one, without the power of all noise."""
    recording = t2d.Recording(np.ones((8, 1, 64), np.complex64), t2d.Radar.preset("table2", samples=64))
    recording.settings["snr_db"] = 30.0
    assert recording.snr_db is None
    assert "SNR" not in str(recording)
    recording.settings["noise_dbm"] = -90.0
    assert recording.snr_db == 30.0
    assert "SNR 30.0 dB" in str(recording)


def test_a_background_beside_any_noise_of_a_receiver_is_told() -> None:
    recording = t2d.Recording(np.ones((600, 1, 256), np.complex64), t2d.Radar.preset("table2"))
    recording.settings["noise_dbm"] = -90.0  # of 1/f noise alone there is no white floor
    with pytest.warns(t2d.T2DWarning, match="noise"):
        recording.with_background("default")
