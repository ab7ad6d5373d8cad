"""Merged echoes against the direct sum of the same echoes: error and time, and what merging leaves at the surface rate."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal.windows import blackmanharris

import t2d_rt as t2d
from t2d_rt.body.materials import resolve_material
from t2d_rt.core.backend import select
from t2d_rt.radar.direct import direct_sum
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.scattering.rate import SurfaceRate
from t2d_rt.types import Echoes, MovingMesh, Radar
from validation.bodies import RUN, WALK, random_chirps, walking
from validation.methods.reference import nmse_db
from validation.report import Section, at_most, new_figure, save_chart

RECORDS = {"walk": (WALK, 1.0, 2.0), "run": (RUN, 0.2, 1.2), "jump": ("14_14_jumping_jacks.bvh", 1.0, 2.0)}
"""File, start and stop [s]."""
PRESETS = ("table2", "table2-uniform", "text2doppler-code")
TOLERANCES_DB = (-30.0, -40.0, -50.0)
UNMERGED_DB = -90.0
"""A tolerance at which `synthesize` sums echo by echo: merging cannot keep to less than -60 dB."""
CHIRPS = 12
GLIDE_MPS = 1.0
RATE_MULTIPLES = (1, 2, 4, 8)
LINE_HZ = 10.0
NOTHING_DB = -110.0
"""Where a body has less than this [dBc per bin] it has no Doppler of its own."""


def run() -> Section:
    rows = [row for record in RECORDS for preset in PRESETS for row in _against_direct(record, preset)]
    worst = {db: max(row["error dB"] for row in rows if row["tolerance dB"] == db) for db in TOLERANCES_DB}
    checks = [
        at_most(f"tolerance {db:g} dB, worst of {len(rows) // 4} cases", found, db, "dB") for db, found in worst.items()
    ]
    leaks = {"gliding body": _leak(_gliding()), "walking body": _leak(walking(*RECORDS["walk"][1:]))}
    checks += [
        at_most(f"{name}: lines at 1, 2, 4, 8 surface rates over what is beside", leak.over_db, 6, "dB")
        for name, leak in leaks.items()
    ]  # fmt: skip
    glide, walk = leaks.values()
    checks += [
        at_most("gliding body: those lines", glide.lines_db, -80, "dBc per bin"),
        at_most("walking body: beyond its own Doppler", walk.beyond_db, -65, "dBc per bin"),
    ]
    return Section(
        title="Merging level by level",
        checks=checks,
        note="Echoes of a skinned body (skin, default settings, no occlusion but of back faces) of a second of a walk (12_01), run "
        "(iClone 002_03) and jumping jacks (CMU 14_14) at the surface rate that each asks for, by `synthesize` against the direct "
        f"float64 sum, {CHIRPS} random chirps, 28 samples of each; seconds of the faster of two runs. Below, the Doppler spectrum "
        "(`table2`, five samples of the sweep, Blackman-Harris over the record) of what merging at default tolerance changes "
        f"against summing echo by echo: for one pose that glides at {GLIDE_MPS:g} m/s, and for the walk. Its level within "
        f"{LINE_HZ:g} Hz of the strongest line +-1, 2, 4, 8 surface rates is set against that half a surface rate to either "
        "side. Between levels factors are interpolated, which leaves images at the levels' rates, 4, 8, ... surface rates; the "
        "walk's smear masks them but for those beyond its own Doppler.",
        table=rows,
        charts=[_chart(rows), _leak_chart(leaks)],
    )  # fmt: skip


def body_echoes(surface: MovingMesh, radar: Radar) -> Echoes:
    """A body's echoes at the surface rate that its motion asks for; skin, default settings, no occlusion but of back faces."""
    rate = SurfaceRate(surface, radar, (float(surface.times_s[0]), float(surface.times_s[-1]))).needed_hz()
    times = np.linspace(surface.times_s[0], surface.times_s[-1], int(np.ceil(surface.duration_s * rate)) + 1)
    return mesh_echoes(
        surface, radar, times_s=times, material=resolve_material("skin", radar.mid_frequency_hz),
        detail=Detail(sagitta_rad=surface.sagitta_rad),
        seed=0, views=[PathVisibility()], backend=select("auto"),
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

    return [*(row(db, tolerance_db=db) for db in TOLERANCES_DB), row("echo by echo", tolerance_db=UNMERGED_DB)]


def _gliding() -> MovingMesh:
    """One pose of the walk that comes at `GLIDE_MPS`, from where the walk is."""
    moving = walking(*RECORDS["walk"][1:])
    times = np.array([0.0, 1.0])
    track = moving.at(times[:1])[0] - GLIDE_MPS * times[:, None, None] * [1.0, 0, 0]
    return MovingMesh(
        track, moving.faces, times, "skin", sagitta_rad=moving.sagitta_rad, curved=moving.curved, name="glider"
    )


@dataclass(frozen=True, slots=True)
class _Leak:
    offset_hz: np.ndarray
    """From the strongest line, ascending, (bin,)."""
    power_db: np.ndarray
    """Doppler spectrum echo by echo [dBc], (bin,)."""
    change_db: np.ndarray
    """Of what merging changes, likewise."""
    rate_hz: float
    """Surface rate."""

    def _mean_db(self, offset_hz: float) -> float:
        near = np.abs(self.offset_hz - offset_hz) <= LINE_HZ
        return float(10 * np.log10(np.mean(10 ** (self.change_db[near] / 10))))

    @property
    def _places_hz(self) -> list[float]:
        return [sign * k * self.rate_hz for k in RATE_MULTIPLES for sign in (-1, 1)]

    @property
    def lines_db(self) -> float:
        """Greatest bin of the lines."""
        return float(max(self.change_db[np.abs(self.offset_hz - place) <= LINE_HZ].max() for place in self._places_hz))

    @property
    def over_db(self) -> float:
        """Most that a line's mean level exceeds that half a surface rate to its left and right."""
        half = self.rate_hz / 2
        return max(
            self._mean_db(place) - (self._mean_db(place - half) + self._mean_db(place + half)) / 2
            for place in self._places_hz
        )

    @property
    def beyond_db(self) -> float:
        """Greatest change where the body itself has nothing."""
        return float(self.change_db[self.power_db < NOTHING_DB].max())


def _leak(surface: MovingMesh) -> _Leak:
    radar = Radar.preset("table2")
    echoes = body_echoes(surface, radar)
    merged = np.asarray(t2d.synthesize(echoes, radar))
    plain = np.asarray(t2d.synthesize(echoes, radar, tolerance_db=UNMERGED_DB))
    samples = np.linspace(0, radar.samples - 1, 5).astype(int)
    window = blackmanharris(len(plain))[:, None]
    power, change = (
        np.mean(np.abs(np.fft.fft(window * cube[:, 0, samples].astype(np.complex128), axis=0)) ** 2, axis=1)
        for cube in (plain, merged - plain)
    )
    power_db, change_db = (
        10 * np.log10(np.fft.fftshift(np.roll(level, -int(power.argmax()))) / power.max()) for level in (power, change)
    )
    offset_hz = np.fft.fftshift(np.fft.fftfreq(len(plain), radar.chirp_interval_s))
    return _Leak(offset_hz, power_db, change_db, echoes.rate_hz)


def _chart(rows: list[dict[str, Any]]) -> str:
    figure, axis = new_figure()
    for colour, record in enumerate(RECORDS):
        for marker, preset in zip("os^", PRESETS, strict=True):
            part = [row for row in rows if row["case"] == f"{record}, {preset}"]
            style = {"color": f"C{colour}", "marker": marker, "markersize": 5}
            place = [row["s"] for row in part], [row["error dB"] for row in part]
            axis.plot(place[0][:-1], place[1][:-1], label=f"{record}, {preset}", **style)
            axis.plot(place[0][-1:], place[1][-1:], markerfacecolor="none", **style)
    for db in TOLERANCES_DB:
        axis.axhline(db, color="C3", linestyle=":", linewidth=1)
    axis.set(xlabel="time for 1 s of record [s]", ylabel="field NMSE [dB]", xscale="log")
    axis.set_xticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
    axis.minorticks_off()
    axis.set_title("tolerances -30, -40, -50 dB (dotted); open: echo by echo")
    figure.legend(fontsize=7, ncols=3, loc="outside lower center")
    axis.grid(alpha=0.3, which="both")
    return save_chart(figure, "multilevel.png")


def _leak_chart(leaks: dict[str, _Leak]) -> str:
    figure, axes = new_figure(nrows=2, figsize=(6.5, 6))
    for axis, (name, leak) in zip(axes, leaks.items(), strict=True):
        axis.plot(leak.offset_hz, leak.power_db, linewidth=0.5, label="echo by echo")
        axis.plot(leak.offset_hz, leak.change_db, linewidth=0.5, label="what merging changes")
        axis.set(ylabel="[dBc per bin]", title=f"{name}, surface rate {leak.rate_hz:g} Hz", ylim=(-160, 3))
        axis.grid(alpha=0.3)
    axes[0].legend()
    axes[1].set_xlabel("Doppler frequency from the strongest line [Hz]")
    return save_chart(figure, "multilevel_lines.png")
