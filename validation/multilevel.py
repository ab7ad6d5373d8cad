"""Merged echoes against the direct sum of the same echoes: error and time, and what merging leaves at the surface rate."""

from __future__ import annotations

import time
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal.windows import blackmanharris

import t2d_rt as t2d
from t2d_rt.backend import select
from t2d_rt.body.materials import resolve_material
from t2d_rt.echo.mesh import mesh_echoes
from t2d_rt.echo.rate import needed_rate_hz
from t2d_rt.radar.direct import direct_sum
from t2d_rt.types import Echoes, MovingMesh, Radar
from validation.bodies import RUN, WALK, random_chirps, walking
from validation.reference import nmse_db
from validation.report import Check, Section, new_figure, save_chart

RECORDS = {"walk": (WALK, 1.0, 2.0), "run": (RUN, 0.2, 1.2), "jump": ("14_14_jumping_jacks.bvh", 1.0, 2.0)}
"""File, start and stop [s]."""
PRESETS = ("table2", "table2-uniform", "text2doppler-code")
TOLERANCES_DB = (-30.0, -40.0, -50.0)
CHIRPS = 12
GLIDE_MPS = 1.0
RATE_MULTIPLES = (1, 2, 4, 8)
FLOOR_BINS = 31
"""Width of the median that gives the floor beside a line."""


def run() -> Section:
    rows = [row for record in RECORDS for preset in PRESETS for row in _against_direct(record, preset)]
    worst = {db: max(row["error dB"] for row in rows if row["tolerance dB"] == db) for db in TOLERANCES_DB}
    checks = [
        Check(what=f"tolerance {db:g} dB, worst of {len(rows) // 4} cases", measured=found, limit=db, unit="dB")
        for db, found in worst.items()
    ]
    leaks = {"gliding body": _leak(_gliding()), "walking body": _leak(walking(*RECORDS["walk"][1:]))}
    for name, leak in leaks.items():
        checks.append(
            Check(what=f"{name}: lines over the floor beside them", measured=leak["over"], limit=6, unit="dB")
        )
    checks.append(
        Check(what="gliding body: lines", measured=leaks["gliding body"]["lines"], limit=-80, unit="dBc per bin")
    )
    return Section(
        title="Merging level by level",
        checks=checks,
        note="",
        table=rows,
        charts=[_chart(rows), _leak_chart(leaks)],
    )


def body_echoes(surface: MovingMesh, radar: Radar) -> Echoes:
    """A body's echoes at the surface rate that its motion asks for; skin, default settings, nothing hidden but back faces."""
    rate = needed_rate_hz(surface, radar, float(surface.times_s[0]), float(surface.times_s[-1]))
    times = np.linspace(surface.times_s[0], surface.times_s[-1], int(np.ceil(surface.duration_s * rate)) + 1)
    return mesh_echoes(
        surface, radar, times_s=times, material=resolve_material("skin", radar.mid_frequency_hz), sagitta_rad=surface.sagitta_rad,
        seed=0, visibility=None, backend=select("auto"),
    ).gather()  # fmt: skip


def _against_direct(record: str, preset: str) -> list[dict[str, Any]]:
    """Rows of the table: all tolerances, and echo by echo."""
    name, start, stop = RECORDS[record]
    radar, surface = Radar.preset(preset), walking(start, stop, name)
    echoes = body_echoes(surface, radar)
    chirps, every = random_chirps(surface, radar, CHIRPS), radar.samples // 28
    expected = direct_sum(echoes, radar, chirps, every=every)

    def row(label: float | str, **options: float) -> dict[str, Any]:
        seconds = []
        for _ in range(2):  # once to compile
            begin = time.perf_counter()
            cube = t2d.synthesize(echoes, radar, **options)
            seconds.append(time.perf_counter() - begin)
        error = nmse_db(cube[chirps, 0, ::every], expected)
        return {
            "case": f"{record}, {preset}", "echoes": echoes.delay_s.shape[1], "surface rate Hz": round(echoes.rate_hz),
            "tolerance dB": label, "error dB": error, "s": min(seconds),
        }  # fmt: skip

    rows = [row(db, tolerance_db=db) for db in TOLERANCES_DB]
    with patch("t2d_rt.radar.synthesize.levels", lambda *_: []):
        return [*rows, row("echo by echo")]


def _gliding() -> MovingMesh:
    """One pose of the walk that comes at `GLIDE_MPS`, from where the walk is."""
    moving = walking(*RECORDS["walk"][1:])
    times = np.array([0.0, 1.0])
    track = moving.at(times[:1])[0] - GLIDE_MPS * times[:, None, None] * [1.0, 0, 0]
    return MovingMesh(
        track, moving.faces, times, "skin", crease_deg=moving.crease_deg, sagitta_rad=moving.sagitta_rad, name="glider"
    )


def _leak(surface: MovingMesh) -> dict[str, Any]:
    """Doppler spectrum [dBc] of what merging changes, five samples of the sweep; lines beside the strongest one at multiples
    of the surface rate, and how far they stand out."""
    radar = Radar.preset("table2")
    echoes = body_echoes(surface, radar)
    merged = t2d.synthesize(echoes, radar)
    with patch("t2d_rt.radar.synthesize.levels", lambda *_: []):
        plain = t2d.synthesize(echoes, radar)
    samples = np.linspace(0, radar.samples - 1, 5).astype(int)
    window = blackmanharris(len(plain))[:, None]
    power, change = (
        np.mean(np.abs(np.fft.fft(window * cube[:, 0, samples].astype(np.complex128), axis=0)) ** 2, axis=1)
        for cube in (plain, merged - plain)
    )
    peak = int(power.argmax())
    change_db = 10 * np.log10(np.roll(change, -peak) / power.max())
    bin_hz = 1 / (len(plain) * radar.chirp_interval_s)
    floor = median_filter(change_db, FLOOR_BINS, mode="wrap")
    steps = np.unique(np.outer(RATE_MULTIPLES, np.arange(1, 9)) * echoes.rate_hz)
    steps = steps[steps < radar.prf_hz / 2]
    places = np.round(np.concatenate([-steps, steps])[:, None] / bin_hz).astype(int) + np.arange(-1, 2)
    level = change_db[places]
    return {
        "offset_hz": np.fft.fftfreq(len(plain), radar.chirp_interval_s), "change_db": change_db, "power_db": 10 * np.log10(
            np.roll(power, -peak) / power.max()), "lines": float(level.max()), "over": float((level - floor[places]).max()),
        "rate_hz": echoes.rate_hz, "error": nmse_db(merged, plain),
    }  # fmt: skip


def _chart(rows: list[dict[str, Any]]) -> str:
    figure, axis = new_figure()
    return save_chart(figure, "multilevel.png")


def _leak_chart(leaks: dict[str, dict[str, Any]]) -> str:
    figure, axis = new_figure()
    return save_chart(figure, "multilevel_lines.png")
