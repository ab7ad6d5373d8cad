"""The receiver: each effect against its closed form, SNR against range, and what it does to range-Doppler maps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.constants import BOLTZMANN
from t2d_rt.noise.receiver import receive
from t2d_rt.noise.receiver.chain import Interference
from t2d_rt.noise.receiver.draws import Draws
from t2d_rt.types import PEC, Radar, Receiver
from validation.bodies import WALK, recorded
from validation.report import Check, Section, new_figure, save_chart

LIMIT_DB = 0.2
CHIRPS = 8192
RADIUS_M, NEAR_M, FAR_M, SPEED_MPS = 0.1, 2.0, 17.0, 5.0
"""A sphere that goes away from the radar."""
INTERVAL = 128
"""Chirps of a coherent interval of that flight."""
MASK = {"kind": "mask", "points": [[1e4, -70.0], [1e5, -80.0], [1e6, -93.0], [1e7, -113.0]]}
LEESON = {"kind": "leeson", "floor_dbc_hz": -120.0, "half_bandwidth_hz": 1e6, "flicker_hz": 2e5}
OTHER = {
    "position_m": (12.0, 3.0, 1.0), "carrier_hz": 77.2e9, "slope_hz_per_s": 30e12, "duration_s": 45e-6, "interval_s": 71e-6,
    "eirp_dbm": 21.0,
}  # fmt: skip
MAP_SPAN_DB, MAP_INTERVAL_S = 100.0, 0.03


def run() -> Section:
    radar = Radar.preset("table2")
    rows: list[dict[str, Any]] = []
    for effect in (_thermal, _quantisation, _phase_noise, _correlation, _front_end, _flicker, _burst):
        rows += effect(radar)
    flight = _Flight(radar)
    checks = [
        Check(what=f"{row['effect']}: {row['figure']}", measured=abs(row["difference [dB]"]), limit=LIMIT_DB, unit="dB")
        for row in rows
    ]
    error_db = flight.found_db - flight.expected_db
    slope = np.polyfit(np.log10(flight.range_m), error_db, 1)[0]
    checks += [
        Check(
            what="SNR of a sphere against (2) over (32), mean", measured=abs(error_db.mean()), limit=LIMIT_DB, unit="dB"
        ),
        Check(what="SNR over a decade of range, against the same", measured=abs(slope), limit=0.5, unit="dB"),
    ]
    return Section(
        title="Receiver",
        checks=checks,
        note=f"`table2`, {CHIRPS} chirps of silence or of a tone, each effect alone, through `t2d_rt.noise.receiver`. Phase "
        "noise: on echoes in and between range bins, spectra through a Hann window; Leeson's integral diverges slowly at 0 Hz, "
        f"where a record ends. SNR: a conducting sphere of radius {RADIUS_M:g} m that goes away at {SPEED_MPS:g} m/s, with "
        f"thermal noise by `simulate`, peaks of {INTERVAL} chirps at a time, Hann windows in range and Doppler, noise from the "
        "cells at other speeds; against (2), with R (R + a) for R^2 as of a sphere of radius a, over (32), times the gain of the "
        f"windows. The maps: the walk in the empty room by ellipsoids, {1e3 * MAP_INTERVAL_S:g} ms without MTI; echoes alone, "
        "with the shipped receiver (images of the near walls at 15 to 20 m), and with another FMCW radar 12 m away in addition, "
        "whose bursts lie at sample numbers that drift from chirp to chirp: noise with oblique streaks.",
        table=rows,
        charts=[flight.chart(), _maps(radar)],
    )


def _db(ratio: float) -> float:
    return 10 * math.log10(ratio)


def _row(effect: str, figure: str, measured_db: float, closed_db: float) -> dict[str, Any]:
    return {
        "effect": effect, "figure": figure, "measured [dB]": measured_db, "closed form [dB]": closed_db,
        "difference [dB]": measured_db - closed_db,
    }  # fmt: skip


def _through(radar: Radar, cube: np.ndarray | None = None, **fields: Any) -> np.ndarray:
    """Samples (chirp, sample) of the first antenna through a receiver of these effects alone."""
    if cube is None:
        cube = np.zeros((CHIRPS, radar.antennas, radar.samples), np.complex64)
    found, _ = receive(cube.copy(), radar, Receiver(**{"temperature_k": None, **fields}), 0)
    return np.asarray(found)[:, 0]


def _power(samples: np.ndarray) -> float:
    return float(np.mean(np.abs(samples.astype(np.complex128)) ** 2))


def _thermal(radar: Radar) -> list[dict[str, Any]]:
    found = []
    for temperature_k, figure_db in ((290.0, 15.0), (290.0, 3.0), (40.0, 1.0)):
        changed = radar.replace(noise_figure_db=figure_db)
        noise_k = temperature_k + (10 ** (figure_db / 10) - 1) * 290
        closed = _db(BOLTZMANN * noise_k * radar.sample_rate_hz) + 30
        measured = _db(_power(_through(changed, temperature_k=temperature_k))) + 30
        found.append(_row("thermal noise", f"{temperature_k:g} K, F {figure_db:g} dB [dBm]", measured, closed))
    return found


def _quantisation(radar: Radar) -> list[dict[str, Any]]:
    found = []
    for bits in (6, 8, 10, 12):
        level = 1 - 0.625 * 2.0 ** (1 - bits)  # where the noise of a sine is that of a random signal
        tone = level * math.sqrt(1e-3) * np.exp(2j * np.pi * 0.1234567 * np.arange(512 * radar.samples))
        cube = tone.reshape(-1, 1, radar.samples).astype(np.complex64)
        noise = _power((_through(radar, cube, adc={"bits": bits, "full_scale_dbm": 0.0}) - cube[:, 0]).real)
        found.append(_row("ADC", f"{bits} bits, SQNR", _db(1e-3 / 2 / noise), 6.02 * bits + 1.76))
    return found


def _residual(radar: Radar, number: float, oscillator: Mapping[str, Any], chirps: int = 2000) -> np.ndarray:
    """Phase noise [rad] left on an echo in a range bin, (chirp, sample)."""
    beat = np.exp(2j * np.pi * number * np.arange(radar.samples) / radar.samples).astype(np.complex64)
    cube = np.array(np.broadcast_to(beat, (chirps, 1, radar.samples)))
    return np.angle(_through(radar, cube, phase_noise=oscillator) * np.conj(beat))


def _delay_s(radar: Radar, number: float) -> float:
    return number / radar.samples * radar.sample_rate_hz / radar.slope_hz_per_s


def _spectrum(values: np.ndarray, radar: Radar) -> np.ndarray:
    """Two-sided density over the frequencies of a chirp's FFT, mean over chirps."""
    window = np.hanning(values.shape[1])
    energy = np.mean(np.abs(np.fft.fft(window * values, axis=1)) ** 2, axis=0)
    return np.asarray(energy / (window @ window) / radar.sample_rate_hz)


def _phase_noise(radar: Radar) -> list[dict[str, Any]]:
    found = []
    frequency = (np.arange(2_000_000) + 0.5) / 2_000_000 * radar.sample_rate_hz / 2
    for name, oscillator in (("mask", MASK), ("Leeson's model", LEESON)):
        density = _density(oscillator)
        for number in (30.0, 120.0):
            closed = 4 * np.sin(np.pi * frequency * _delay_s(radar, number)) ** 2 * density(frequency)
            variance = float(np.mean(closed)) * radar.sample_rate_hz
            what = f"{name}, integrated, {number * radar.range_resolution_m:.1f} m [dB rad^2]"
            found.append(_row("phase noise", what, _db(np.var(_residual(radar, number, oscillator))), _db(variance)))
    return found


def _correlation(radar: Radar) -> list[dict[str, Any]]:
    frequency = np.fft.fftfreq(radar.samples, 1 / radar.sample_rate_hz)
    bands = {"0.3 to 1 MHz": (3e5, 1e6), "1 to 3 MHz": (1e6, 3e6)}
    near, far = 20.5, 160.5
    spectra = {number: _spectrum(_residual(radar, number, MASK), radar) for number in (near, far)}
    found = []
    for name, (low, high) in bands.items():
        within = (frequency > low) & (frequency < high)
        ratios = []
        for number, spectrum in spectra.items():
            factor = 4 * np.sin(np.pi * frequency[within] * _delay_s(radar, number)) ** 2
            closed = factor * _density(MASK)(frequency[within])
            ratios.append((spectrum[within].sum(), closed.sum()))
        measured, expected = (_db(one / other) for other, one in zip(*ratios, strict=True))
        found.append(_row("phase noise", f"ratio at two delays, {name}", measured, expected))
    return found


def _density(oscillator: Mapping[str, Any]) -> Callable[[np.ndarray], np.ndarray]:
    found = Receiver(phase_noise=oscillator).phase_noise
    assert found is not None
    return found.density


def _front_end(radar: Radar) -> list[dict[str, Any]]:
    tone = np.exp(2j * np.pi * 40 * np.arange(radar.samples) / radar.samples)
    cube = np.array(np.broadcast_to(tone, (4, 1, radar.samples)), np.complex64)
    found = []
    for gain_db, phase_deg in ((0.4, 2.0), (0.7, 5.0)):
        imbalance = {"gain_db": gain_db, "phase_deg": phase_deg}
        spectrum = np.abs(np.fft.fft(_through(radar, cube, iq_imbalance=imbalance)[0])) ** 2
        g, p = 10 ** (gain_db / 20), math.radians(phase_deg)
        closed = _db((1 + 2 * g * math.cos(p) + g**2) / (1 - 2 * g * math.cos(p) + g**2))
        what = f"image rejection, {gain_db:g} dB and {phase_deg:g} deg"
        found.append(_row("I/Q imbalance", what, _db(spectrum[40] / spectrum[-40]), closed))
    level = _db(_power(_through(radar, dc_offset_dbm=-60.0)[:8])) + 30
    return [*found, _row("DC offset", "power [dBm]", level, -60.0)]


def _flicker(radar: Radar) -> list[dict[str, Any]]:
    spectrum = _spectrum(_through(radar, flicker_corner_hz=4e5), radar)
    frequency = np.abs(np.fft.fftfreq(radar.samples, 1 / radar.sample_rate_hz))
    thermal = radar.noise_power_w / radar.sample_rate_hz
    corner = (frequency > 3e5) & (frequency < 5e5)
    low, high = ((frequency > lowest) & (frequency < 2 * lowest) for lowest in (1.6e5, 1.6e6))
    at_corner = np.mean(spectrum[corner] * frequency[corner]) / 4e5
    slope = _db(np.mean(spectrum[high] * frequency[high]) / np.mean(spectrum[low] * frequency[low]))
    return [
        _row("1/f noise", "density at the corner over thermal noise", _db(at_corner / thermal), 0.0),
        _row("1/f noise", "over a decade", slope - 10, -10.0),
    ]


def _burst(radar: Radar) -> list[dict[str, Any]]:
    found = []
    for difference in (5e11, -2e12):
        slope = radar.slope_hz_per_s - difference
        at_start_hz = (0 if difference > 0 else radar.sample_rate_hz) - difference * radar.sweep_time_s / 5
        other = OTHER | {"carrier_hz": radar.carrier_hz - at_start_hz, "slope_hz_per_s": slope}
        interferer = Receiver(interferers=[other]).interferers[0]
        _, burst = Interference(radar, interferer, Draws(0), 0).burst(0.0)
        length_s = float(np.sum(np.abs(burst) ** 2)) / radar.sample_rate_hz
        expected = radar.sample_rate_hz / abs(difference)
        steps = np.unwrap(np.angle(burst[1:] * np.conj(burst[:-1])))[20:-20]
        fitted = np.polyfit(np.arange(len(steps)) / radar.sample_rate_hz, steps * radar.sample_rate_hz / (2 * np.pi), 1)
        name = f"slopes {difference / 1e12:g} MHz/us apart"
        found.append(_row("interference", f"length, {name} [dB us]", _db(1e6 * length_s), _db(1e6 * expected)))
        if len(steps) > 20:
            slopes = (_db(abs(each) / 1e12) for each in (float(fitted[0]), difference))
            found.append(_row("interference", f"slope, {name} [dB MHz/us]", *slopes))
    power = Interference(radar, Receiver(interferers=[OTHER]).interferers[0], Draws(0), 0).power_w
    range_m = math.dist(OTHER["position_m"], radar.position_m)  # type: ignore[arg-type]
    friis_db = 21.0 + radar.rx_gain_dbi + 20 * math.log10(radar.wavelength_m / (4 * math.pi * range_m))
    return [*found, _row("interference", "power by Friis [dBm]", _db(power) + 30, friis_db)]


# --- SNR against range ---


class _Flight:
    """SNR of a sphere that goes away, over its range."""

    def __init__(self, radar: Radar) -> None:
        times = np.linspace(0, (FAR_M - NEAR_M) / SPEED_MPS, 40)
        centres = np.array(radar.position_m) + np.outer(NEAR_M + RADIUS_M + SPEED_MPS * times, [1.0, 0, 0])
        ball = t2d.Ellipsoids(np.full((1, 3), RADIUS_M), centres[:, None], times, material=PEC)
        recording = t2d.simulate(ball, radar=radar, method="ellipsoid", noise={})
        count = len(recording.cube) // INTERVAL
        fast, slow = np.hanning(radar.samples), np.hanning(INTERVAL)
        starts = radar.chirp_starts_s(count * INTERVAL).reshape(count, INTERVAL)
        self.range_m = NEAR_M + SPEED_MPS * (starts.mean(axis=1) + radar.mid_time_s)
        self.found_db, self.expected_db = np.empty(count), np.empty(count)
        gain = fast.sum() ** 2 / (fast @ fast) * slow.sum() ** 2 / (slow @ slow)
        for number in range(count):
            block = np.asarray(recording.cube[number * INTERVAL : (number + 1) * INTERVAL, 0])
            windowed = block * slow[:, None] * fast
            spectrum = np.abs(np.fft.fft2(windowed, (8 * INTERVAL, 8 * radar.samples))) ** 2  # fine: no straddling
            doppler = int(np.argmax(spectrum.max(axis=1)))
            apart = np.abs(
                (np.arange(len(spectrum)) - doppler + len(spectrum) // 2) % len(spectrum) - len(spectrum) // 2
            )
            noise = spectrum[apart > 8 * 16].mean()
            self.found_db[number] = _db(max(spectrum.max() / noise - 1, 1e-6))
            range_m = float(self.range_m[number])
            # A sphere spreads what it reflects as if from its focus: R (R + a) for R^2.
            echo = float(radar.received_power_w(math.pi * RADIUS_M**2, range_m, range_m + RADIUS_M))
            self.expected_db[number] = _db(echo * gain / radar.noise_power_w)

    def chart(self) -> str:
        """SNR and its R^-4 line."""
        figure, ax = new_figure()
        ax.semilogx(self.range_m, self.found_db, ".", ms=3, label=f"measured, {INTERVAL} chirps at a time")
        ax.semilogx(self.range_m, self.expected_db, "k-", lw=1, label=r"radar equation over $kT_0BF$: $R^{-4}$")
        ax.set(xlabel="range [m]", ylabel="SNR after range and Doppler FFT [dB]")
        ticks = [2, 3, 4, 6, 8, 10, 12, 16]
        ax.set_xticks(ticks, [str(each) for each in ticks])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
        ax.legend()
        return save_chart(figure, "receiver_snr.png")


# --- maps ---


def _maps(radar: Radar) -> str:
    """Range-Doppler maps of a walk in a room: clean, through the receiver, and beside another radar."""
    walk = t2d.trim(recorded(WALK), 1.5, 2.0)
    clean = t2d.simulate(walk, radar=radar, method="ellipsoid", scene="empty_room", accuracy={"occlusion": False})
    shipped = Receiver.preset(radar)
    recordings = {
        "echoes alone": clean,
        "with the shipped receiver": t2d.add_noise(clean, shipped),
        "and another FMCW radar 12 m away": t2d.add_noise(clean, shipped.replace(interferers=[OTHER])),
    }
    figure, axes = new_figure(ncols=3, figsize=(13, 4.2), sharey=True)
    peak = float(clean.processed(mti="none").range_doppler_at(interval_s=MAP_INTERVAL_S).max())
    for ax, (title, recording) in zip(axes, recordings.items(), strict=True):
        ax = recording.processed(mti="none").plot_range_doppler(
            title, interval_s=MAP_INTERVAL_S, ax=ax, limits_db=(peak - MAP_SPAN_DB, peak)
        )
    return save_chart(figure, "receiver_maps.png")
