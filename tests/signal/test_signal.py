"""The signal chain on point targets computed in float64 from the IF formula, and on a recorded frame."""

from __future__ import annotations

import os

import numpy as np
import pytest
from scipy.signal import get_window

from builders import ROOT
from measures import check_picture
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.cubes import column_sums
from t2d_rt.core.errors import InputError
from t2d_rt.plots import plot_comparison, plot_range_doppler, plot_range_time, plot_spectrogram
from t2d_rt.signal import (
    doppler,
    gate,
    load_cube,
    mti,
    range_doppler,
    range_fft,
    range_profile,
    spectrogram,
    stft,
    taper,
)
from t2d_rt.types.radar import Radar

TABLE2 = Radar.preset("table2")
FRAME = ROOT / "tests" / "data" / "simple_frame_1.npy"


def point_target(
    radar: Radar, duration_s: float, range_m: float, speed_mps: float = 0.0, rcs_m2: float = 1.0
) -> np.ndarray:
    """ADC cube complex128 (chirp, 1, sample) of one point, moving during the chirps too; speed positive =
    approaching."""
    fast = radar.sample_times_s
    time = radar.chirp_times_s(duration_s)[:, None] + fast
    distance = range_m - speed_mps * time
    delay = 2 * distance / SPEED_OF_LIGHT
    cycles = radar.carrier_hz * delay + radar.slope_hz_per_s * (delay * fast - delay**2 / 2)
    return (radar.link_amplitude * np.sqrt(rcs_m2) / distance**2 * np.exp(2j * np.pi * cycles))[:, None]


def peak(power: np.ndarray) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(np.argmax(power), power.shape))


def fine_peak(axis: np.ndarray, power: np.ndarray) -> float:
    """Peak between bins, by a parabola through the dB values of three."""
    top = int(np.argmax(power))
    left, middle, right = np.log(power[top - 1 : top + 2])
    return float(axis[top] + (axis[1] - axis[0]) * 0.5 * (left - right) / (left - 2 * middle + right))


# --- range ---


@pytest.mark.parametrize("range_m", [1.0, 3.0, 5.432, 10.0, 20.0])
def test_range_of_a_static_target(range_m: float) -> None:
    cube = point_target(TABLE2, 0.001, range_m)
    profile = range_profile(cube, TABLE2, n_fft=2048)
    found = fine_peak(profile.range_m, np.abs(profile.profile[0, 0]) ** 2)
    assert abs(found - range_m) < 0.01 * TABLE2.range_resolution_m


@pytest.mark.parametrize("speed", [4.0, -4.0])
def test_moving_target_range_and_speed(speed: float) -> None:
    cube = point_target(TABLE2, 0.1, 5.0, speed)
    middle = 5.0 - speed * 0.05
    result = range_doppler(cube, TABLE2)
    row, column = peak(result.power)
    bin_mps = TABLE2.speed_resolution_mps(0.1)
    # Mid-sweep wavelength: 4 m/s, not the 4.044 of the wavelength at the first sample.
    assert abs(fine_peak(result.velocity_mps, result.power[:, column]) - speed) < 0.1 * bin_mps
    assert abs(result.velocity_mps[row] - speed) <= 0.5 * bin_mps
    coupling = TABLE2.mid_frequency_hz * speed / TABLE2.slope_hz_per_s
    assert abs(coupling) == pytest.approx(6.7e-3, abs=1e-4)
    found = fine_peak(result.range_m, result.power[row])
    # A parabola on Hann's main lobe errs by up to 2 % of a bin; the target crosses 4.6 bins during the record.
    assert abs(found + coupling - middle) < 0.1 * TABLE2.range_resolution_m


def test_coupling_correction() -> None:
    radar = TABLE2.replace(slope_hz_per_s=4.6397e12)  # ten times the coupling: 6.6 cm of 86.4 cm bins
    cube = point_target(radar, 0.02, 40.0, 4.0)
    plain, corrected = range_doppler(cube, radar), range_doppler(cube, radar, correct_coupling=True)
    row = peak(plain.power)[0]
    moved = fine_peak(corrected.range_m, corrected.power[row]) - fine_peak(plain.range_m, plain.power[row])
    assert moved == pytest.approx(radar.mid_frequency_hz * 4.0 / radar.slope_hz_per_s, rel=0.1)
    assert radar.range_axis_m(speed_mps=4.0)[0] == pytest.approx(moved, rel=0.1)
    static = point_target(radar, 0.02, 40.0)
    assert np.allclose(
        range_doppler(static, radar).power[256 // 2],
        range_doppler(static, radar, correct_coupling=True).power[256 // 2],
    )


@pytest.mark.parametrize("range_m", [1.0, 3.0, 10.0, 30.0])
@pytest.mark.parametrize("window", ["hann", "blackmanharris", "boxcar"])
def test_0_dbsm_reads_back_0_dbsm(range_m: float, window: str) -> None:
    radar = Radar.preset("table2-long")
    range_m = round(range_m / radar.range_resolution_m) * radar.range_resolution_m  # on a bin: no scalloping
    cube = point_target(radar, 0.005, range_m).astype(np.complex64)
    unit = radar.received_power_w(1.0, range_m)
    profile = range_profile(cube, radar, window=window)
    assert 10 * np.log10((np.abs(profile.profile) ** 2).max() / unit) == pytest.approx(0, abs=0.01)
    result = range_doppler(cube, radar, range_window=window)
    assert 10 * np.log10(result.power.max() / unit) == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("offset", [0.0, 0.25, 0.5])
def test_spectrogram_reads_the_power_wherever_the_target_stands(offset: float) -> None:
    range_m = (40 + offset) * TABLE2.range_resolution_m
    cube = point_target(TABLE2, 0.06, range_m).astype(np.complex64)
    result = spectrogram(np.repeat(cube, 3, axis=1), TABLE2)  # antennas are averaged
    assert 10 * np.log10(result.power.max() / TABLE2.received_power_w(1.0, range_m)) == pytest.approx(0, abs=0.01)


def test_parseval() -> None:
    rng = np.random.default_rng(1)
    cube = rng.standard_normal((300, 2, 256)) + 1j * rng.standard_normal((300, 2, 256))
    profile = range_fft(cube, window="boxcar", block=64)
    assert (np.abs(profile) ** 2).sum() * 256 == pytest.approx((np.abs(cube) ** 2).sum(), rel=1e-12)
    spectra, _, _ = stft(cube[:, 0, 0], 1000.0, window="boxcar", n_window=100, overlap=0)
    assert (np.abs(spectra) ** 2).sum() * 100 == pytest.approx((np.abs(cube[:, 0, 0]) ** 2).sum(), rel=1e-12)
    # Noise of power P reads P in the spectrogram times the noise bandwidth of the windows, 1/N each for boxcar.
    radar = TABLE2
    flat = spectrogram(cube, radar, range_window="boxcar", window="boxcar", n_window=100, overlap=0)
    assert flat.power.sum() * 100 / flat.power.shape[1] == pytest.approx(
        256 * (np.abs(profile) ** 2).mean() * 100, rel=1e-9
    )


def test_blocks_gates_and_precision() -> None:
    cube = point_target(TABLE2, 0.02, 7.0, 2.0).astype(np.complex64)
    whole = range_fft(cube)
    assert whole.dtype == np.complex64
    assert range_fft(cube.astype(np.complex128)).dtype == np.complex128
    assert np.array_equal(whole, range_fft(cube, block=7))
    bins = gate(TABLE2.range_axis_m(), (6.0, 8.0))
    assert np.array_equal(whole[..., bins], range_fft(cube, bins=bins))
    inside = TABLE2.range_axis_m()[bins]
    assert inside[0] >= 6.0 > inside[0] - TABLE2.range_resolution_m
    assert inside[-1] <= 8.0 < inside[-1] + TABLE2.range_resolution_m
    assert np.array_equal(whole[:, 0], range_fft(cube[:, 0]))


@pytest.mark.parametrize("method", ["none", "mean"])
@pytest.mark.parametrize("preset", ["table2", "table2-burst"])
def test_a_long_record_is_worked_on_in_pieces(preset: str, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    radar = Radar.preset(preset)
    cube = point_target(radar, 0.4, 7.0, 2.0) + 0.5 * point_target(radar, 0.4, 3.0, 0.0)
    whole = spectrogram(cube, radar, mti=method)
    monkeypatch.setattr(doppler, "PIECE", 100)
    pieces = spectrogram(cube, radar, mti=method)
    np.testing.assert_allclose(pieces.power, whole.power, rtol=1e-9, atol=1e-20 * whole.power.max())
    np.testing.assert_array_equal(pieces.time_s, whole.time_s)


# --- MTI ---


def tone(doppler: float, chirps: int = 4096) -> np.ndarray:
    """exp(j 2 pi doppler n), doppler as a fraction of the PRF, (chirp, 1)."""
    return np.exp(2j * np.pi * doppler * np.arange(chirps))[:, None]


def gain_db(doppler: float, **options: object) -> float:
    filtered = mti(tone(doppler), prf_hz=1.0, **options)[1000:-1000]
    return float(10 * np.log10((np.abs(filtered) ** 2).mean() + 1e-30))


def test_mti_nulls() -> None:
    assert np.array_equal(mti(tone(0.1), "none"), tone(0.1))
    assert gain_db(0.0, method="mean") < -200
    assert gain_db(0.25, method="mean") == pytest.approx(0, abs=0.01)
    assert gain_db(0.0, method="highpass", cutoff_hz=0.01) < -200
    assert gain_db(0.01, method="highpass", cutoff_hz=0.01) == pytest.approx(-6.02, abs=0.01)  # 3 dB each way
    assert gain_db(0.2, method="highpass", cutoff_hz=0.01) == pytest.approx(0, abs=0.01)
    assert gain_db(0.005, method="highpass", cutoff_hz=0.01, order=4) == pytest.approx(
        -2 * 10 * np.log10(1 + 2**8), abs=0.05
    )


def test_the_papers_kernel_does_not_cancel_static_echoes() -> None:
    assert gain_db(0.0, method="canceller") == pytest.approx(0, abs=1e-6)
    assert gain_db(1 / 6, method="canceller") < -200
    assert gain_db(-1 / 6, method="canceller") < -200
    assert gain_db(0.5, method="canceller") == pytest.approx(20 * np.log10(9), abs=1e-6)
    for fraction in (0.05, 0.2, 0.37):
        expected = 20 * np.log10((1 - 2 * np.cos(2 * np.pi * fraction)) ** 2)
        assert gain_db(fraction, method="canceller") == pytest.approx(expected, abs=1e-6)
    for kernel in ((1, -1), (1, -2, 1), (1, -4, 6, -4, 1)):
        # Also at the ends of the record: a static echo does not click there.
        assert np.abs(mti(tone(0.0), "canceller", kernel=kernel)).max() < 1e-12
        assert gain_db(0.5, method="canceller", kernel=kernel) == pytest.approx(20 * np.log10(np.abs(kernel).sum()))


@pytest.mark.parametrize("method", ["mean", "highpass"])
def test_mti_leaves_the_mover_and_removes_the_wall(method: str) -> None:
    wall = point_target(TABLE2, 0.2, 3.0, rcs_m2=100.0)
    mover = point_target(TABLE2, 0.2, 5.0, 2.0)
    both = spectrogram((wall + mover).astype(np.complex64), TABLE2, mti=method)
    alone = spectrogram(mover.astype(np.complex64), TABLE2)
    assert both.power.max() == pytest.approx(alone.power.max(), rel=0.01)
    static = spectrogram(wall.astype(np.complex64), TABLE2, mti=method)
    # Single precision: -120 dB of the wall.
    assert static.power.max() < 1e-12 * spectrogram(wall.astype(np.complex64), TABLE2).power.max()


def test_mti_keeps_the_input() -> None:
    cube = tone(0.1, 500).astype(np.complex64)
    before = cube.copy()
    for method in ("mean", "highpass", "canceller"):
        filtered = mti(cube, method, prf_hz=1.0, cutoff_hz=0.01)
        assert filtered.dtype == np.complex64
        assert filtered.shape == cube.shape
        assert np.array_equal(cube, before)


# --- STFT ---


def test_stft_axes_and_level() -> None:
    prf = 1000.0
    series = np.zeros(5000, complex)
    series[2000:] = 3 * np.exp(-2j * np.pi * 125 * np.arange(3000) / prf)
    spectra, frequency, time = stft(series, prf)
    assert spectra.shape == (256, (5000 - 256) // 56 + 1) == (len(frequency), len(time))
    assert time[0] == pytest.approx(128 / prf)
    assert np.allclose(np.diff(time), 56 / prf)
    assert frequency[np.abs(spectra[:, -1]).argmax()] == -125
    assert np.abs(spectra[:, -1]).max() == pytest.approx(3, rel=1e-9)
    # The tone starts at chirp 2000: half its amplitude in the window centred there.
    level = np.interp(2.0, time, np.abs(spectra[frequency == -125][0]))
    assert level == pytest.approx(1.5, rel=0.02)


def test_spectrogram_agrees_with_stft_of_each_bin() -> None:
    rng = np.random.default_rng(2)
    cube = rng.standard_normal((900, 2, 256)) + 1j * rng.standard_normal((900, 2, 256))
    result = spectrogram(cube, TABLE2, range_gate_m=(1, 4), n_fft=512)
    bins = gate(TABLE2.range_axis_m(), (1, 4))
    spectra, frequency, time = stft(range_fft(cube, bins=bins), TABLE2.prf_hz, n_fft=512)
    weights = taper("hann", 256)
    expected = (np.abs(spectra) ** 2).sum(axis=(-1, -2)) / 2 / (256 * (weights**2).sum())
    assert np.allclose(result.power, expected[::-1], rtol=1e-10)
    assert np.allclose(result.velocity_mps, -TABLE2.wavelength_m / 2 * frequency[::-1])
    assert np.allclose(result.time_s, time)


@pytest.mark.parametrize("length", [1, 3, 4, 255, 256])
@pytest.mark.parametrize("periodic", [False, True])
def test_the_default_window_is_that_of_scipy(length: int, periodic: bool) -> None:
    expected = get_window("hann", length, fftbins=periodic)
    np.testing.assert_allclose(taper("hann", length, periodic=periodic), expected / expected.sum(), rtol=0, atol=2e-16)


@pytest.mark.parametrize("name", ["table2", "table2-long", "text2doppler-code", "table2-burst"])
@pytest.mark.parametrize("speed", [4.0, -2.5])
def test_spectrogram_speed_is_positive_when_approaching(name: str, speed: float) -> None:
    radar = Radar.preset(name)
    cube = point_target(radar, 0.21, 5.0, speed).astype(np.complex64)
    result = spectrogram(cube, radar)
    ridge = result.velocity_mps[result.power.argmax(axis=0)]
    assert np.abs(ridge - speed).max() <= 0.5 * (result.velocity_mps[1] - result.velocity_mps[0])
    assert (np.diff(result.velocity_mps) > 0).all()
    assert (np.diff(result.time_s) > 0).all()


def test_odd_fft_length_keeps_the_sign() -> None:
    result = spectrogram(point_target(TABLE2, 0.06, 5.0, 3.0), TABLE2, n_window=255, overlap=0)
    assert result.velocity_mps[result.power[:, 0].argmax()] == pytest.approx(3.0, abs=0.04)


def test_uniform_aliases_and_ci4r_folds() -> None:
    radar = Radar.preset("table2-uniform")
    result = spectrogram(point_target(radar, 0.5, 5.0, 1.5), radar)
    folded = 1.5 - 2 * radar.max_speed_mps
    assert result.velocity_mps[result.power[:, 0].argmax()] == pytest.approx(folded, abs=0.01)


def test_bursts_give_one_column_each() -> None:
    radar = Radar.preset("table2-burst")
    cube = point_target(radar, 0.5, 5.0, 3.0)
    result = spectrogram(cube, radar)
    assert result.power.shape == (128, 5)
    assert np.allclose(result.time_s, 0.1 * np.arange(5) + 64 / radar.prf_hz)
    finer = spectrogram(cube, radar, n_window=64, overlap=32)
    assert finer.power.shape == (64, 15)
    assert np.abs(finer.velocity_mps[finer.power.argmax(axis=0)] - 3.0).max() < 0.4
    filtered = spectrogram(cube, radar, mti="canceller")
    assert filtered.power.shape == (128, 5)
    assert range_doppler(cube[:128], radar).power.shape == (128, 256)
    with pytest.raises(
        InputError, match=r"window of 256 chirps does not fit into a burst of 128.*set n_window to 128 or less"
    ):
        spectrogram(cube, radar, n_window=256)
    with pytest.raises(InputError, match="highpass' needs evenly spaced chirps, got bursts of 128"):
        spectrogram(cube, radar, mti="highpass")
    with pytest.raises(InputError, match="needs evenly spaced chirps, got 640 in bursts of 128"):
        range_doppler(cube, radar)


def test_static_target_has_no_energy_off_zero() -> None:
    result = spectrogram(point_target(TABLE2, 0.1, 5.0).astype(np.complex64), TABLE2)
    off = np.abs(result.velocity_mps) > 0.2
    # Single precision; a symmetric Hann window would leak -66 dB.
    assert 10 * np.log10(result.power[off].max() / result.power.max()) < -130


def test_coherent_sum_is_the_first_sample() -> None:
    cube = point_target(TABLE2, 0.06, 5.0, 3.0)
    result = spectrogram(cube, TABLE2, combine="coherent", range_window="boxcar")
    spectra, _, _ = stft(cube[:, 0, 0], TABLE2.prf_hz)
    assert np.allclose(result.power, np.abs(spectra[::-1]) ** 2, rtol=1e-9, atol=1e-9 * result.power.max())
    gated = spectrogram(cube, TABLE2, combine="coherent", range_gate_m=(4.5, 5.2))
    assert gated.velocity_mps[gated.power[:, 0].argmax()] == pytest.approx(3.0, abs=0.04)
    with pytest.raises(InputError, match="coherent sum over all range bins is the chirp's first sample"):
        spectrogram(cube, TABLE2, combine="coherent")


@pytest.mark.parametrize("gate_m", [None, (4.0, 6.0)])
def test_neither_layout_nor_what_is_next_in_memory_matters(gate_m: tuple[float, float] | None) -> None:
    cube = point_target(TABLE2, 0.1, 5.0, 3.0).astype(np.complex64)
    beside = np.full((2, *cube.shape[::-1]), np.nan, np.complex64)
    beside[1] = cube.T
    layouts = cube, np.asfortranarray(cube), beside[1].T
    for layout in layouts:
        layout.setflags(write=False)
    expected, *others = (spectrogram(each, TABLE2, range_gate_m=gate_m).power for each in layouts)
    assert all(np.array_equal(other, expected) for other in others)


# --- recorded frame ---


def test_recorded_frame() -> None:
    radar = Radar.preset("openradar")
    cube = load_cube(FRAME)
    assert cube.shape == (128, 1, 128)
    assert cube.dtype == np.complex64
    result = range_doppler(cube, radar)
    # Undo the calibration: known levels are those of a plain two-dimensional FFT with Hann windows (63.5 and 64 their
    # sums; symmetric windows on both axes, as numpy's, give 104.54 and 48.19).
    level_db = 10 * np.log10(result.power) + 20 * np.log10(63.5 * 64)
    assert level_db.max() == pytest.approx(104.5, abs=0.15)
    assert np.median(level_db) == pytest.approx(48.2, abs=0.15)
    moving = np.where(np.abs(result.velocity_mps)[:, None] > 0.2, result.power, 0)
    row, column = peak(moving)
    assert column == 41
    assert result.range_m[column] == pytest.approx(2.0, abs=0.01)
    assert result.velocity_mps[row] == pytest.approx(0.66, abs=0.02)  # approaching
    assert np.flatnonzero(np.isclose(result.velocity_mps, 8 * radar.speed_resolution_mps(128 / radar.prf_hz)))[0] == row
    short = spectrogram(cube, radar, mti="mean", n_window=64, overlap=48, range_gate_m=(1.5, 2.5))
    assert np.all(np.abs(short.velocity_mps[short.power.argmax(axis=0)] - 0.66) < 0.2)


def test_load_recording_shapes_and_words(tmp_path) -> None:
    path = tmp_path / "cube.npy"
    np.save(path, np.array([[[65535 + 1j, -5 + 32768j]]]))
    assert np.array_equal(load_cube(path), np.array([[[-1 + 1j, -5 - 32768j]]], np.complex64))
    simulated = (np.arange(8).reshape(2, 2, 2) + 0.5j) * 1e-6
    np.save(path, simulated)
    assert np.array_equal(load_cube(path), simulated.astype(np.complex64))
    np.save(path, np.asfortranarray(np.arange(6).reshape(2, 3) * (1 + 1j)))
    assert np.array_equal(load_cube(path)[:, 0], np.arange(6).reshape(2, 3) * (1 + 1j))


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((4, 4)), "must hold complex samples .* or pairs of I and Q along a last axis of 2, got float64"),
        (np.zeros(4, complex), "must have shape"),
        (np.zeros((0, 4), complex), "must have shape"),
        (np.full((2, 2), np.nan + 0j), "holds NaN or infinite"),
    ],
)
def test_bad_recordings(tmp_path, array: np.ndarray, message: str) -> None:
    path = tmp_path / "cube.npy"
    np.save(path, array)
    with pytest.raises(InputError, match=message):
        load_cube(path)


def test_broken_recordings(tmp_path) -> None:
    path = tmp_path / "cube.npy"
    with pytest.raises(InputError, match="cannot read recording"):
        load_cube(path)
    os.mkfifo(tmp_path / "pipe.npy")
    with pytest.raises(InputError, match="is a pipe; give the path of one recording"):
        load_cube(tmp_path / "pipe.npy")
    data = FRAME.read_bytes()
    for content in (b"", b"not numpy at all", data[:50], data[:5000]):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"not a whole .npy array"):
            load_cube(path)
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"not a whole .npy array"):
        load_cube(path)


# --- guards ---


def test_guards() -> None:
    cube = np.ones((300, 1, 256), complex)
    with pytest.raises(InputError, match="unknown window 'hamn'"):
        range_fft(cube, window="hamn")
    with pytest.raises(InputError, match="unknown window"):
        taper("kaiser", 16)  # needs a parameter
    with pytest.raises(InputError, match="of 2 samples is zero"):
        taper("hann", 2)
    with pytest.raises(InputError, match="n_fft must be at least the 256 samples"):
        range_fft(cube, n_fft=128)
    with pytest.raises(InputError, match="adc must have shape"):
        range_fft(cube[0, 0])
    with pytest.raises(InputError, match="adc must be complex"):
        range_fft(cube.real)
    with pytest.raises(InputError, match="adc has 256 samples per chirp, the radar 512"):
        spectrogram(cube, Radar.preset("table2-long"))
    with pytest.raises(InputError, match=r"range gate 30..40 m holds no range bin"):
        spectrogram(cube, TABLE2, range_gate_m=(30, 40))
    with pytest.raises(InputError, match="combine must be"):
        spectrogram(cube, TABLE2, combine="sum")
    for cutoff in (0.0, -1.0, 20.0, np.nan):
        with pytest.raises(InputError, match=r"cutoff_mps must (lie between 0 and 9.857 m/s|be finite)"):
            spectrogram(cube, TABLE2, mti="highpass", cutoff_mps=cutoff)
    with pytest.raises(InputError, match="record of 100 chirps is shorter than the STFT window of 256"):
        spectrogram(cube[:100], TABLE2, n_window=256)
    with pytest.raises(InputError, match=r"overlap must lie in 0..255"):
        spectrogram(cube, TABLE2, n_window=256, overlap=256)
    with pytest.raises(InputError, match=r"n_window must lie in 2..300"):
        stft(cube[:, 0, 0], 1.0, n_window=1, overlap=0)
    with pytest.raises(InputError, match="n_fft must be at least n_window"):
        stft(cube[:, 0, 0], 1.0, n_fft=128)
    with pytest.raises(InputError, match=r"MTI method must be 'none', 'mean', .* got 'median'"):
        mti(cube, "median")
    for cutoff in (None, 0.0, 0.5, np.nan):
        with pytest.raises(InputError, match=r"highpass needs prf_hz and a cutoff_hz|cutoff_hz must be finite"):
            mti(cube, "highpass", prf_hz=1.0, cutoff_hz=cutoff)
    with pytest.raises(InputError, match=r"order of the high-pass must be an integer in 1..10"):
        mti(cube, "highpass", prf_hz=1.0, cutoff_hz=0.1, order=0)
    with pytest.raises(InputError, match="kernel must be 1 to 300 finite numbers"):
        mti(cube, "canceller", kernel=())


# --- figures ---


@pytest.mark.slow
def test_figures(tmp_path) -> None:
    cube = point_target(TABLE2, 0.3, 5.0, 3.0).astype(np.complex64)
    cube = np.concatenate([cube, cube])
    maps = spectrogram(cube, TABLE2)
    with np.errstate(divide="ignore"):
        level = 10 * np.log10(np.where(maps.power < 1e-20, 0, maps.power))  # -inf where silent
    doppler = range_doppler(cube, TABLE2)
    profile = range_profile(cube, TABLE2)
    range_time = 20 * np.log10(np.abs(profile.profile[:, 0].T) + 1e-20)
    figures = {
        "spectrogram": plot_spectrogram(maps.velocity_mps, maps.time_s, level, title="Point at 3 m/s"),
        "range_time": plot_range_time(profile.range_m, profile.time_s, range_time, title="Range"),
        "range_doppler": plot_range_doppler(
            doppler.range_m, doppler.velocity_mps, 10 * np.log10(doppler.power + 1e-30)
        ),
        "comparison": plot_comparison(maps.velocity_mps, maps.time_s, level, level - 3, title="Two models"),
    }
    for name, figure in figures.items():
        figure.savefig(tmp_path / f"{name}.png")
        check_picture(tmp_path / f"{name}.png")
    axes, bar = figures["spectrogram"].axes
    assert "[m/s]" in axes.get_ylabel()
    assert axes.get_xlabel() == "Time [s]"
    assert "dB" in bar.get_ylabel()
    assert axes.collections[0].get_clim() == (-50, 0)
    # 6144 chirps come down to at most 2000 columns.
    assert figures["range_time"].axes[0].collections[0].get_array().shape[1] <= 2000
    difference = figures["comparison"].axes[2].collections[0].get_array()
    shown = np.ma.compressed(difference)
    # Where the weaker one is still drawn they differ by 3 dB, and by what is left of it at the foot of the scale.
    assert np.median(shown) == pytest.approx(-3)
    assert ((shown >= -3 - 1e-9) & (shown <= 0)).all()
    silent = level < level.max() - 60
    assert np.ma.getmaskarray(difference)[silent].all()


def test_figure_guards() -> None:
    with pytest.raises(InputError, match="nothing to plot"):
        plot_spectrogram(np.arange(3), np.arange(4), np.full((3, 4), -np.inf))
    with pytest.raises(InputError, match=r"power_db must have shape \(3, 4\)"):
        plot_spectrogram(np.arange(3), np.arange(4), np.zeros((4, 3)))
    with pytest.raises(InputError, match="must have one shape"):
        plot_comparison(np.arange(3), np.arange(4), np.zeros((3, 4)), np.zeros((3, 5)))
    with pytest.raises(InputError, match="dynamic_range_db must be positive"):
        plot_spectrogram(np.arange(3), np.arange(4), np.zeros((3, 4)), dynamic_range_db=0)


def test_the_spectrogram_of_all_bins_is_that_of_its_gates() -> None:
    # All bins go by Parseval past the range FFT, gates through it.
    rng = np.random.default_rng(5)
    shape = (700, 2, 256)
    adc = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)
    radar = Radar.preset("table2")
    edge = float(radar.range_axis_m()[100])
    near, far = ((0.0, edge), (edge + 1e-3, 1e3))
    for method in ("none", "mean"):
        whole = spectrogram(adc, radar, mti=method)
        parts = [spectrogram(adc, radar, mti=method, range_gate_m=gate) for gate in (near, far)]
        np.testing.assert_allclose(whole.power, parts[0].power + parts[1].power, rtol=1e-4)


@pytest.mark.parametrize("rows", [3, 16, 517])
def test_static_echoes_are_all_of_the_mean(rows):
    """No rounding of the sums stays behind: a chirp that is always the same is the mean, to the last bit."""
    chirp = np.random.default_rng(0).normal(size=(1, 2, 64)).astype(np.float32).view(np.complex64)
    mean = column_sums(np.repeat(chirp, rows, axis=0)) / rows
    np.testing.assert_array_equal(mean.astype(np.complex64), chirp[0])
