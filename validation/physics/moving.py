"""A sphere that comes at 4 m/s: range, speed and what leaks beside its Doppler line. And a body at rest."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal.windows import blackmanharris, chebwin

import t2d_rt as t2d
from t2d_rt.types import PEC, MovingMesh, Radar
from validation.bodies import walking
from validation.physics.rcs import sphere
from validation.report import Check, Section, new_figure, save_chart

RADIUS_M, START_M, SPEED_MPS, DURATION_S = 0.15, 7.0, 4.0, 1.0
"""Range of the specular point at the start; it ends 4 m nearer."""
SURFACE_RATE_HZ = 150.0
SIDELOBES_DB = 120.0
"""Of the Chebyshev window over slow time, in dB; its main lobe ends MAIN_LOBE_BINS from the peak."""
MAIN_LOBE_BINS = 8


def run() -> Section:
    radar = Radar.preset("table2")
    cube = _approaching(radar)
    spectrum, peak, bin_hz = _doppler(cube, radar)
    speed, speed_bin = _speed(cube, radar)
    away = np.abs(np.arange(len(spectrum)) - peak)
    beside = np.minimum(away, len(spectrum) - away) > MAIN_LOBE_BINS
    checks = [
        Check(what="range of the specular point, with coupling", measured=_range_error(cube, radar), limit=0.1, unit="bin"),
        Check(what="speed over the whole record", measured=abs(speed - SPEED_MPS) / speed_bin, limit=0.5, unit="bin"),
        Check(what="sign: speed read", measured=speed, limit=0, unit="m/s", at_least=True),
        Check(what="outside the window's main lobe, per bin", measured=spectrum[beside].max(), limit=-80, unit="dBc"),
        Check(what="lines at multiples of the surface rate", measured=_lines(spectrum, peak, bin_hz), limit=-80, unit="dBc"),
        Check(what="body at rest: energy outside zero Doppler", measured=_static_body(radar), limit=-80, unit="dBc"),
    ]  # fmt: skip
    return Section(
        title="Moving sphere, body at rest",
        checks=checks,
        note=f"Perfectly conducting sphere, radius {RADIUS_M} m, from {START_M:g} m at {SPEED_MPS:g} m/s for "
        f"{DURATION_S:g} s, `table2`, default settings (surface rate {SURFACE_RATE_HZ:g} Hz). Range: peak of the "
        "range profile of 21 chirps, worst. Speed: Doppler line of the samples at mid-sweep over the whole "
        f"record, bin {speed_bin * 1e3:.2g} mm/s. Leakage: Doppler spectra of five samples of the sweep, the "
        f"worst, window Chebyshev {SIDELOBES_DB:g} dB, +-{MAIN_LOBE_BINS} bins left out. Body: skin with diffuse "
        "points, one pose of the walk held for 0.2 s, energy after taking the mean over chirps.",
        charts=[_chart(spectrum, peak, bin_hz)],
    )  # fmt: skip


def _approaching(radar: Radar) -> np.ndarray:
    times = np.linspace(0, DURATION_S, 11)
    ball, faces = sphere(RADIUS_M, np.zeros(3), subdivisions=4)
    centres = radar.tx_position_m + np.outer(START_M + RADIUS_M - SPEED_MPS * times, [1.0, 0, 0])
    mesh = MovingMesh(ball + centres[:, None], faces, times, PEC)
    return (
        t2d.simulate(mesh, radar=radar, accuracy={"surface_rate_hz": SURFACE_RATE_HZ}).cube[:, 0].astype(np.complex128)
    )


def _range_error(cube: np.ndarray, radar: Radar) -> float:
    """Worst distance of the profile's peak from the specular point at mid-sweep, in bins."""
    size = 256 * radar.samples
    worst = 0.0
    for chirp in np.linspace(0, len(cube) - 1, 21).astype(int):
        profile = np.abs(np.fft.fft(cube[chirp] * blackmanharris(radar.samples), size))
        found = radar.range_axis_m(size, speed_mps=SPEED_MPS)[profile.argmax()]
        true = START_M - SPEED_MPS * (chirp * radar.chirp_interval_s + radar.mid_time_s)
        worst = max(worst, abs(found - true) / radar.range_resolution_m)
    return worst


def _speed(cube: np.ndarray, radar: Radar) -> tuple[float, float]:
    """Speed [m/s], positive approaching, from the line of the two middle samples, and the width of its bin."""
    size = 16 * len(cube)
    window = blackmanharris(len(cube))[:, None]
    middle = cube[:, radar.samples // 2 - 1 : radar.samples // 2 + 1]
    power = np.sum(np.abs(np.fft.fft(middle * window, size, axis=0)) ** 2, axis=1)
    doppler_hz = np.fft.fftfreq(size, radar.chirp_interval_s)[power.argmax()]
    return -radar.wavelength_m / 2 * doppler_hz, radar.speed_resolution_mps(len(cube) * radar.chirp_interval_s)


def _doppler(cube: np.ndarray, radar: Radar) -> tuple[np.ndarray, int, float]:
    """Doppler spectrum [dBc], the greatest of five samples of the sweep after their peaks are put in one place; peak, bin [Hz]."""
    window = chebwin(len(cube), SIDELOBES_DB)
    spectra = []
    for sample in np.linspace(0, radar.samples - 1, 5).astype(int):
        level = np.abs(np.fft.fft(cube[:, sample] * window)) ** 2
        spectra.append(np.roll(level / level.max(), len(cube) // 2 - int(level.argmax())))
    return 10 * np.log10(np.max(spectra, axis=0)), len(cube) // 2, 1 / (len(cube) * radar.chirp_interval_s)


def _lines(spectrum: np.ndarray, peak: int, bin_hz: float) -> float:
    """Greatest level within a bin of the carrier +- k times the surface rate."""
    spacing = SURFACE_RATE_HZ / bin_hz
    k = np.arange(1, int((len(spectrum) / 2 - 2) / spacing))
    places = peak + np.round(np.concatenate([-k, k])[:, None] * spacing).astype(int) + np.arange(-1, 2)
    return float(spectrum[places].max())


def _static_body(radar: Radar) -> float:
    moving = walking(1.0, 1.2)
    pose = moving.at(moving.times_s[:1] + 0.1)[0]
    static = MovingMesh(
        np.stack([pose, pose]),
        moving.faces,
        [0.0, 0.2],
        "skin",
        curved=moving.curved,
        sagitta_rad=moving.sagitta_rad,
    )
    cube = t2d.simulate(static, radar=radar).cube.astype(np.complex128)
    return 10 * math.log10(max(np.sum(np.abs(cube - cube.mean(axis=0)) ** 2) / np.sum(np.abs(cube) ** 2), 1e-30))


def _chart(spectrum: np.ndarray, peak: int, bin_hz: float) -> str:
    figure, axis = new_figure()
    offset = (np.arange(len(spectrum)) - peak) * bin_hz
    axis.plot(offset, spectrum, linewidth=0.6)
    axis.axhline(-80, color="C3", linestyle=":", label="limit")
    axis.set(xlabel="Doppler frequency from the line [Hz]", ylabel="[dBc per bin]", ylim=(-160, 3))
    axis.set_title(f"sphere at {SPEED_MPS:g} m/s, {DURATION_S:g} s, surface rate {SURFACE_RATE_HZ:g} Hz")
    axis.legend()
    return save_chart(figure, "moving_sphere.png")
