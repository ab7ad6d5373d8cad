"""Movers: a fan's flash rate and tip speed read from its spectrograms, its field against finer frames, and a gallery."""

from __future__ import annotations

import numpy as np

import t2d_rt as t2d
from t2d_rt.scene import Mover
from t2d_rt.signal import spectrogram
from t2d_rt.types import Radar
from validation.report import Section, at_most, new_figure, save_chart

FANS = ((3, 600.0, 0.18), (2, 900.0, 0.15), (5, 600.0, 0.20), (4, 1200.0, 0.12), (3, 450.0, 0.25))
"""Blades, revolutions per minute, radius [m]."""
RADAR = Radar.preset("table2", samples=16, prf_hz=25_000.0)
RECORD_S, EDGE_DB = 0.3, -20.0
FLASH_CHIRPS = 64
GALLERY_S, DYNAMIC_RANGE_DB = 4.0, 55.0
GALLERY: dict[str, tuple[Mover, int]] = {
    "table fan, 400 rpm, swings": (
        t2d.TableFan(position_m=(2.5, 0.5, 1.1), heading_deg=150, rpm=400, swing_deg=80, swing_period_s=8), 128,
    ),
    "ceiling fan, 120 rpm": (t2d.CeilingFan(position_m=(2.5, 0, 2.3)), 128),
    "curtain": (t2d.Curtain(position_m=(3, 0, 2.2)), 2048),
    "dog on a circle": (t2d.Pet(position_m=(3.5, 0, 0)), 512),
    "door": (t2d.Door(position_m=(3, -0.4, 0), angle_deg=-80, period_s=4), 1024),
}  # fmt: skip
"""Each with the chirps of a column: slow ones need more."""


def run() -> Section:
    checks, rows = [], []
    for blades, rpm, radius_m in FANS:
        flash, tip = seen(blades, rpm, radius_m)
        rows.append({
            "blades": blades, "rpm": rpm, "radius [m]": radius_m, "flash rate [Hz]": flash, "expected [Hz]": blades * rpm / 60,
            "tip speed [m/s]": tip, "expected [m/s]": 2 * np.pi * rpm / 60 * radius_m,
        })  # fmt: skip
    for what, unit in (("flash rate", "Hz"), ("tip speed", "m/s")):
        errors = [abs(row[f"{what} [{unit}]"] / row[f"expected [{unit}]"] - 1) for row in rows]
        checks.append(at_most(f"fan: {what}, worst of {len(FANS)}", 100 * max(errors), 2, "%"))
    checks.append(at_most("fan: field beside that of 5 times the frames", frame_error_db(), -20, "dB"))
    return Section(
        title="Movers",
        checks=checks,
        note="Fans edge on: the radar in the plane of the blades. Flash rate: the strongest frequency in the course of the power "
        f"at more than 0.7 of the tip speed found, columns of {FLASH_CHIRPS} chirps. Tip speed: the highest speed at which the "
        f"Doppler spectrum of the whole record, averaged over 1 % of itself, stands within {-EDGE_DB:g} dB of its mean over the "
        "outer half of the speeds below; beyond the tip's it falls by as much within 2 %, since a turning point's harmonics "
        "J_n(2kr) do so beyond n = 2kr. The field is compared without its mean over the chirps, the hub's echo. Gallery: occlusion "
        "off.",
        table=rows,
        charts=[_gallery()],
    )  # fmt: skip


def seen(blades: int, rpm: float, radius_m: float) -> tuple[float, float]:
    """Flash rate [Hz] and tip speed [m/s] as the radar sees them."""
    fan = t2d.TableFan(position_m=(1.5, 0, 1), heading_deg=90, blades=blades, rpm=rpm, radius_m=radius_m)
    adc = t2d.simulate(fan.mesh(0, RECORD_S), radar=RADAR, accuracy={"occlusion": False}).adc.values
    tip_mps = tip_speed_mps(adc, RADAR)
    return flash_rate_hz(adc, RADAR, 0.7 * tip_mps), tip_mps


def tip_speed_mps(adc: np.ndarray, radar: Radar) -> float:
    """Where the record's Doppler spectrum ends, on its approaching side."""
    image = spectrogram(adc, radar, n_window=len(adc), overlap=0, n_fft=len(adc))
    moving = image.velocity_mps > 1
    speed, power = image.velocity_mps[moving], image.power[moving, 0]
    edge = float(speed[power > power.max() * 1e-4].max())
    width = max(1, int(0.01 * edge / (speed[1] - speed[0])))
    power = np.convolve(power, np.ones(width) / width, "same")
    for _ in range(10):
        level = power[(speed > edge / 2) & (speed < edge)].mean()
        edge = float(speed[power > level * 10 ** (EDGE_DB / 10)].max())
    return edge


def flash_rate_hz(adc: np.ndarray, radar: Radar, above_mps: float) -> float:
    """The strongest frequency in the course of the power at speeds above one."""
    image = spectrogram(adc, radar, n_window=FLASH_CHIRPS, overlap=3 * FLASH_CHIRPS // 4, n_fft=FLASH_CHIRPS)
    course = image.power[image.velocity_mps > above_mps].sum(axis=0)
    padded = 16 * len(course)
    spectrum = np.abs(np.fft.rfft((course - course.mean()) * np.hanning(len(course)), padded))
    return float(np.fft.rfftfreq(padded, image.time_s[1] - image.time_s[0])[spectrum.argmax()])


def frame_error_db() -> float:
    """NMSE of the moving part of a fan's field at its own surface rate, beside 5 times that."""
    fan = t2d.TableFan(position_m=(1.5, 0.5, 1), heading_deg=120).mesh(0, RECORD_S)
    usual = t2d.simulate(fan, radar=RADAR, accuracy={"occlusion": False})
    finer = t2d.simulate(
        fan, radar=RADAR, accuracy={"occlusion": False, "surface_rate_hz": 5 * usual.settings["surface_rates_hz"][0]}
    )
    field, truth = (each.adc.values - each.adc.values.mean(axis=0) for each in (usual, finer))
    return float(10 * np.log10(np.sum(np.abs(field - truth) ** 2) / np.sum(np.abs(truth) ** 2)))


def _gallery() -> str:
    figure, axes = new_figure(figsize=(13, 3.4), ncols=len(GALLERY))
    radar = Radar.preset("table2")
    for ax, (name, (each, chirps)) in zip(axes, GALLERY.items(), strict=True):
        result = t2d.simulate(each.mesh(0, GALLERY_S), radar=radar, accuracy={"occlusion": False})
        image = result.processed(n_window=chirps, overlap=7 * chirps // 8).spectrogram
        drawn = ax.pcolormesh(
            image.time_s, image.velocity_mps, image.values - float(image.values.max()), vmin=-DYNAMIC_RANGE_DB, vmax=0,
            rasterized=True, shading="nearest",
        )  # fmt: skip
        speeds = image.velocity_mps.values[(image.values > image.values.max() - DYNAMIC_RANGE_DB).any(axis=1)]
        reach = min(1.3 * float(np.abs(speeds).max()), radar.max_speed_mps)
        ax.set(xlabel="Time [s]", title=name, ylim=(-reach, reach))
    axes[0].set_ylabel("Radial velocity [m/s], approaching > 0")
    figure.colorbar(drawn, ax=axes, label="Power rel. to each one's peak [dB]")
    return save_chart(figure, "movers.png")
