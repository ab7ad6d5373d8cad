"""The ADC cube against slow sums: of the same echoes, and of the same facets at each sample's own frequency."""

from __future__ import annotations

import numpy as np

import t2d_rt as t2d
from t2d_rt.body.materials import resolve_material
from t2d_rt.core.backend import select
from t2d_rt.radar.direct import direct_sum
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import View
from t2d_rt.types import Echoes, MovingMesh, Radar
from t2d_rt.types.radar import preset_names
from validation.bodies import walking
from validation.echoes import random_echoes
from validation.methods.reference import Converged, nmse_db, reference_samples
from validation.report import Check, Section, new_figure, save_chart

SURFACE_RATE_HZ = 150.0
WIDEBAND_PRESETS = ("table2", "text2doppler-code")
WIDEBAND_SAGITTA_RAD = 0.1
CHIRPS = 10


def run() -> Section:
    checks = [_random_check(preset) for preset in preset_names()]
    checks += [_body_check(preset) for preset in WIDEBAND_PRESETS]
    wide = {preset: _wideband(preset) for preset in WIDEBAND_PRESETS}
    checks += [
        Check(
            what=f"{preset}: walking body against a sum at each sample's own frequency",
            measured=nmse_db(*pair),
            limit=-35,
            unit="dB",
        )
        for preset, pair in wide.items()
    ]
    return Section(
        title="ADC cube against direct float64 sums",
        checks=checks,
        note="First the echoes of one model summed twice, by `synthesize` and echo by echo at every sample's own "
        "time: 60 random echoes at up to 5 m/s that swing, change and go dark, and a walking body's own echoes "
        f"(skin, default settings). Then the walking body (skin, facets of {WIDEBAND_SAGITTA_RAD} rad, no "
        f"occlusion but of back faces) by `simulate` at a surface rate of {SURFACE_RATE_HZ:g} Hz against the "
        f"sum of the same facets and "
        "points, each integral anew at each sample's frequency and time: what patches, slopes and "
        "interpolation in time cost.",
        charts=[_chart(wide)],
    )


def _against_direct(echoes: Echoes, radar: Radar, every: int) -> float:
    cube = t2d.synthesize(echoes, radar)
    chirps = np.linspace(0, len(cube) - 1, CHIRPS).astype(int)
    return nmse_db(cube[chirps, 0, ::every], direct_sum(echoes, radar, chirps, every=every))


def _random_check(preset: str) -> Check:
    radar = Radar.preset(preset)
    found = _against_direct(random_echoes(radar), radar, every=1)
    return Check(
        what=f"{preset}: random fast echoes, same echoes summed directly", measured=found, limit=-50, unit="dB"
    )


def _body_check(preset: str) -> Check:
    radar = Radar.preset(preset)
    surface = walking(1.0, 1.3)
    echoes = _body_echoes(surface, radar)
    found = _against_direct(echoes, radar, every=9)
    return Check(what=f"{preset}: a walking body's own echoes, summed directly", measured=found, limit=-50, unit="dB")


def _body_echoes(surface: MovingMesh, radar: Radar) -> Echoes:
    frames = int(surface.duration_s * SURFACE_RATE_HZ) + 1
    times = np.linspace(surface.times_s[0], surface.times_s[-1], frames)
    material = resolve_material("skin", radar.mid_frequency_hz)
    return mesh_echoes(
        surface, radar, times_s=times, material=material, detail=Detail(sagitta_rad=surface.sagitta_rad), seed=0, views=[View()],
        backend=select("auto"),
    ).gather()  # fmt: skip


def _wideband(preset: str) -> tuple[np.ndarray, np.ndarray]:
    """Samples of `simulate` and of the reference, (chirps, samples)."""
    radar = Radar.preset(preset)
    surface = walking(1.0, 1.5)
    cube = t2d.simulate(
        surface,
        radar=radar,
        accuracy={"sagitta_rad": WIDEBAND_SAGITTA_RAD, "surface_rate_hz": SURFACE_RATE_HZ, "occlusion": False},
    ).cube[:, 0]
    chirps = np.sort(np.random.default_rng(0).choice(len(cube), CHIRPS, replace=False))
    samples = np.linspace(0, radar.samples - 1, 9).astype(int)
    reference = reference_samples(
        surface, radar, chirps, samples,
        Converged(
            material=resolve_material("skin", radar.mid_frequency_hz), sagitta_rad=WIDEBAND_SAGITTA_RAD, occlusion=False
        ),
    )  # fmt: skip
    return cube[np.ix_(chirps, samples)], reference


def _chart(wide: dict[str, tuple[np.ndarray, np.ndarray]]) -> str:
    figure, axis = new_figure()
    for preset, (cube, reference) in wide.items():
        place = np.linspace(-1, 1, cube.shape[1])
        axis.plot(place, [nmse_db(cube[:, i], reference[:, i]) for i in range(len(place))], "o-", label=preset)
    axis.axhline(-35, color="C3", linestyle=":", label="limit")
    axis.set(xlabel="place in the sweep, from start (-1) to end (1)", ylabel="field NMSE [dB]")
    axis.set_title("walking body, same facets, each sample's own frequency")
    axis.legend()
    axis.grid(alpha=0.3)
    return save_chart(figure, "wideband.png")
