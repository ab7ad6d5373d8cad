"""Range cells of a gate against those of the samples: echoes to float error, noise by its covariance, strong echoes bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import ks_2samp

from measures import nmse_db
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.cubes import DiskCube, GatedRows
from t2d_rt.core.errors import InputError
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.noise.receiver import receive
from t2d_rt.noise.receiver.gated import BLOCK_ROWS, receive_gated
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.signal import range_fft, spectrogram
from t2d_rt.signal.range import RangeGate
from t2d_rt.types import Echoes, Radar, Receiver

RADAR = Radar.preset("table2", prf_hz=4000)
GATE = RangeGate.of(RADAR, (0.5, 3.0))
QUIET = Receiver.preset(RADAR).replace(phase_noise=None)


def near(amplitude: float, radar: Radar = RADAR, *, stop_s: float = 0.6, until_s: float = 1.0) -> ProductRows:
    """A cube that keeps products: three echoes within the gate, of which one moves, up to `stop_s`; they end at `until_s`. Of 0.6 s
    the receiver works on two blocks of chirps."""
    times_s = np.arange(round(100 * stop_s) + 1) / 100
    range_m = np.array([1.0, 1.5, 2.2]) + np.outer(times_s, [0.0, 0.0, -0.8])
    shown = np.broadcast_to((times_s < until_s)[:, None], range_m.shape)
    echoes = Echoes(times_s=times_s, delay_s=2 * range_m / SPEED_OF_LIGHT, amplitude=shown * amplitude)
    rows = ProductRows((len(radar.chirp_times_s(stop_s)), radar.antennas, radar.samples))
    synthesize(echoes, radar, onto=DiskCube(rows), device="cpu")
    return rows


def by_cells(rows: ProductRows, receiver: Receiver | None, seed: int = 0) -> tuple[np.ndarray, dict[str, Any]]:
    return receive_gated(rows, RADAR, receiver, seed, GATE.matrix, GATE.bins)


def by_samples(rows: ProductRows, receiver: Receiver | None, seed: int = 0) -> tuple[np.ndarray, dict[str, Any]]:
    cube, levels = rows.read(0, rows.shape[0]), {}
    if receiver is not None:
        cube, levels = receive(cube, RADAR, receiver, seed)
    return range_fft(cube, bins=GATE.bins), levels


def test_cells_without_noise_are_those_of_the_samples() -> None:
    rows = near(1e-5)
    found, levels = by_cells(rows, None)
    assert nmse_db(found, by_samples(rows, None)[0]) < -120
    assert levels == {}


def test_their_spectrogram_is_that_of_the_samples() -> None:
    rows = near(1e-5)
    kept = DiskCube(GatedRows(by_cells(rows, None)[0], GATE.bins, GATE.window, RADAR.samples))
    for mti in ("mean", "highpass", "none"):
        options: dict[str, Any] = {"mti": mti, "n_window": 128, **GATE.processing}
        found, wanted = (spectrogram(each, RADAR, **options).power for each in (kept, rows.read(0, rows.shape[0])))
        assert nmse_db(found, wanted) < -100, mti
    with pytest.raises(InputError, match="range cells 6"):
        spectrogram(kept, RADAR, range_gate_m=(1.0, 2.0))
    with pytest.raises(InputError, match="no ADC samples"):
        kept[:4]


@pytest.mark.parametrize(
    "receiver",
    [Receiver(), QUIET, QUIET.replace(iq_imbalance={"gain_db": 3.0, "phase_deg": 20.0}, adc=None)],
    ids=["thermal", "all but phase noise", "imbalance"],
)
def test_noise_of_cells_is_distributed_as_that_of_the_samples(receiver: Receiver) -> None:
    rows = near(1e-9)
    found, levels = by_cells(rows, receiver)  # the slow part of 1/f noise is the same, all else another draw
    wanted, told = by_samples(rows, receiver)
    assert levels["noise_dbm"] == pytest.approx(told["noise_dbm"], abs=0.1)
    found, wanted = (each[:, 0] - each[:, 0].mean(axis=0) for each in (found, wanted))
    scale = np.sqrt(np.mean(np.abs(wanted) ** 2, axis=0))
    covariances = [(each / scale).T @ (each / scale).conj() / len(each) for each in (found, wanted)]
    # Of 2400 chirps a covariance is known to 1/sqrt(2400) = 0.020.
    assert np.abs(covariances[0] - covariances[1]).max() < 6 * 0.020 * np.sqrt(2)
    assert abs(covariances[0][10, 11] + 2 / 3) < 0.1  # neighbours of a Hann window
    assert abs(covariances[0][10, 12] - 1 / 6) < 0.1
    assert min(ks_2samp(abs(found[:, k]), abs(wanted[:, k])).pvalue for k in range(found.shape[1])) > 1e-4


def test_snr_is_that_of_the_samples() -> None:
    rows = near(3e-6)
    (_, levels), (_, told) = by_cells(rows, QUIET), by_samples(rows, QUIET)
    for name in ("snr_db", "clutter_to_noise_db", "noise_floor_dbm"):
        assert levels[name] == pytest.approx(told[name], abs=0.15), name
    assert "adc_peak_dbfs" not in levels


def test_bursts_between_the_samples_that_levels_are_told_by_are_counted() -> None:
    radar = Radar.preset("table2")
    burst = {
        "carrier_hz": 77e9, "slope_hz_per_s": 2e13, "duration_s": 9e-5, "interval_s": 1 / radar.prf_hz, "position_m": [5, 1, 1],
    }  # fmt: skip
    receiver = Receiver(interferers=[burst])
    rows, gate = near(3e-6, radar, stop_s=0.1), RangeGate.of(radar, (0.5, 3.0))
    for seed in range(4):  # draws when its chirps begin
        _, levels = receive_gated(rows, radar, receiver, seed, gate.matrix, gate.bins)
        _, told = receive(rows.read(0, rows.shape[0]), radar, receiver, seed)
        assert levels["noise_dbm"] == pytest.approx(told["noise_dbm"], abs=0.05)


def test_of_a_wide_gate_all_is_received_by_samples() -> None:
    radar = Radar.preset("table2", prf_hz=4000, samples=1024)
    rows, receiver = near(1e-9, radar), Receiver.preset(radar)
    gate = RangeGate.of(radar, (0.0, 1e6))
    found, _ = receive_gated(rows, radar, receiver, 0, gate.matrix, gate.bins)
    cube, _ = receive(rows.read(0, rows.shape[0]), radar, receiver, 0)
    assert nmse_db(found, range_fft(cube, bins=gate.bins)) < -100


def test_images_within_the_gate_come_from_samples() -> None:
    rows, receiver = near(1e-4), QUIET.replace(adc=None)
    gate = RangeGate.of(RADAR, (0.5, 22.0))
    found, _ = receive_gated(rows, RADAR, receiver, 0, gate.matrix, gate.bins)
    cube, _ = receive(rows.read(0, rows.shape[0]), RADAR, receiver, 0)
    assert nmse_db(found, range_fft(cube, bins=gate.bins)) < -100


@pytest.mark.parametrize(
    ("amplitude", "receiver"),
    [
        (1e-4, Receiver.preset(RADAR)),  # phase noise counts
        (4e-4, QUIET),  # the converters may saturate
        (1e-9, QUIET.replace(adc={"bits": 12, "full_scale_dbm": 9.1, "gain_db": 26.0})),  # they are coarse
    ],
)
def test_what_is_not_linear_acts_on_samples(amplitude: float, receiver: Receiver) -> None:
    rows = near(amplitude)
    found, wanted = by_cells(rows, receiver)[0], by_samples(rows, receiver)[0]
    assert nmse_db(found, wanted) < -100


def test_blocks_by_samples_and_by_cells_follow_one_another() -> None:
    rows, receiver = near(1e-4, until_s=0.48), Receiver.preset(RADAR)
    found, wanted = by_cells(rows, receiver)[0], by_samples(rows, receiver)[0]
    assert len(found) > BLOCK_ROWS
    assert nmse_db(found[:BLOCK_ROWS], wanted[:BLOCK_ROWS]) < -100
    powers = [np.mean(np.abs(each[BLOCK_ROWS:]) ** 2) for each in (found, wanted)]
    assert nmse_db(found[BLOCK_ROWS:], wanted[BLOCK_ROWS:]) > 0  # another draw
    assert powers[0] == pytest.approx(powers[1], rel=0.1)


def test_echoes_have_the_gain_of_imbalance() -> None:
    receiver = QUIET.replace(adc=None, iq_imbalance={"gain_db": 3.0, "phase_deg": 20.0})
    rows = near(1e-6)
    clean = by_samples(rows, None)[0]
    found, wanted = (np.vdot(clean, way(rows, receiver)[0]) / np.vdot(clean, clean) for way in (by_cells, by_samples))
    assert abs(found - wanted) < 0.01
    assert abs(wanted - 1) > 0.1
