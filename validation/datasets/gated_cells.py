"""Range cells of a gate, made without ADC samples, beside those of the samples: echoes, and noise over 200 samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import ks_2samp

import t2d_rt as t2d
from t2d_rt.core.cubes import DiskCube, GatedRows
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.noise.receiver import receive
from t2d_rt.noise.receiver.gated import receive_gated
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.signal import range_fft, spectrogram
from t2d_rt.signal.range import RangeGate
from t2d_rt.types import Echoes, Radar, Receiver
from validation.report import Check, Section

SEEDS = 200
SECONDS = 0.15
LEAST_P = 1e-3
"""Of a Kolmogorov-Smirnov test: one that is less likely by chance fails."""


def walker(radar: Radar) -> ProductRows:
    """Forty echoes about 3 m that swing as limbs do, at an SNR of some 5 dB before processing."""
    rng = np.random.default_rng(0)
    times_s = np.arange(round(SECONDS * 200) + 1) / 200
    phase, size = rng.uniform(0, 2 * np.pi, 40), rng.uniform(0, 0.15, 40)
    range_m = 3.0 + rng.uniform(-0.3, 0.3, 40) - 1.2 * times_s[:, None] + size * np.sin(12 * times_s[:, None] + phase)
    amplitude = 5e-7 * np.exp(1j * phase) * np.ones_like(range_m)
    rows = ProductRows((len(radar.chirp_times_s(SECONDS)), radar.antennas, radar.samples))
    echoes = Echoes(times_s=times_s, delay_s=2 * range_m / 299_792_458.0, amplitude=amplitude)
    synthesize(echoes, radar, onto=DiskCube(rows), device="cpu")
    return rows


def run() -> Section:
    """Cells and spectrograms of one set of echoes with the shipped receiver, by cells and by samples, of other seeds."""
    radar = t2d.Radar.preset("table2")
    gate, rows = RangeGate.of(radar, (1.5, 4.5)), walker(radar)
    clean = rows.read(0, rows.shape[0])
    options: dict[str, Any] = {"mti": "mean", **gate.processing}

    def shown(cells: np.ndarray) -> np.ndarray:
        return spectrogram(DiskCube(GatedRows(cells, gate.bins, gate.window, radar.samples)), radar, **options).power

    bare, _ = receive_gated(rows, radar, None, 0, gate.matrix, gate.bins)
    wanted = spectrogram(clean, radar, **options).power
    echoes_db = 10 * np.log10(np.sum((shown(bare) - wanted) ** 2) / np.sum(wanted**2))
    receiver = Receiver.preset(radar)
    told: tuple[list[Any], list[Any]] = ([], [])
    covariance, mean = np.zeros((2, bare.shape[2], bare.shape[2]), complex), np.zeros((2, bare.shape[2]), complex)
    for seed in range(SEEDS):
        found = receive_gated(rows, radar, receiver, seed, gate.matrix, gate.bins)
        cube, levels = receive(clean.copy(), radar, receiver, SEEDS + seed)
        for way, (cells, its) in enumerate((found, (range_fft(cube, bins=gate.bins), levels))):
            power = shown(cells)
            told[way].append(
                [
                    its["noise_dbm"],
                    its["snr_db"],
                    *10 * np.log10([power.mean(), np.median(power), power.max(), power[40, 5]]),
                ]
            )
            noise = (cells - bare)[:, 0]
            mean[way] += noise.mean(axis=0) / SEEDS
            covariance[way] += noise.T @ noise.conj() / (len(noise) * SEEDS)
    names = "noise_dbm", "snr_db", "mean level", "median level", "peak level", "one cell"
    p_values = {
        name: float(ks_2samp(*values).pvalue)
        for name, values in zip(names, np.moveaxis(np.array(told), 2, 0), strict=True)
    }
    scale = np.sqrt(np.diag(covariance[1]).real)
    apart = np.abs(covariance[0] - covariance[1]) / np.outer(scale, scale)
    means = np.abs(mean[0] - mean[1]) / scale
    checks = [
        Check(what="spectrogram without noise", measured=float(echoes_db), limit=-100.0, unit="dB"),
        *(
            Check(what=f"Kolmogorov-Smirnov, {name}: p", measured=p, limit=LEAST_P, unit="", at_least=True)
            for name, p in p_values.items()
        ),
        Check(what="covariance of cells, greatest difference", measured=float(apart.max()), limit=0.03, unit=""),
        Check(
            what="mean of cells, greatest difference over their deviation",
            measured=float(means.max()),
            limit=0.02,
            unit="",
        ),
    ]
    note = (
        f"Echoes of {SECONDS:g} s with the receiver of 77 GHz, {SEEDS} times by range cells and {SEEDS} times by ADC samples and "
        "range FFT, each time with another seed."
    )
    values = np.array(told).mean(axis=1)
    table = [
        {"": way, **{name: f"{value:.2f}" for name, value in zip(names, row, strict=True)}}
        for way, row in zip(("cells", "samples"), values, strict=True)
    ]
    return Section(title="Gated range cells", note=note, checks=checks, table=table, charts=[])
