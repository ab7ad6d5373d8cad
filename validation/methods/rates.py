"""How the error falls with the rates at which shape and occlusion are sampled."""

from __future__ import annotations

import numpy as np

import t2d_rt as t2d
from t2d_rt.body.materials import resolve_material
from t2d_rt.scattering.rate import needed_rate_hz
from t2d_rt.types import MovingMesh, Radar
from validation.bodies import random_chirps, walking
from validation.methods.reference import Converged, nmse_db, reference_samples
from validation.report import Check, Section, new_figure, save_chart

SURFACE_RATES_HZ, FINE_HZ = (30.0, 40.0, 60.0, 80.0, 120.0), 300.0
OCCLUSION_RATES_HZ, DEFAULT_OCCLUSION_HZ = (12.5, 25.0, 50.0), 25.0
ACROSS_DEG = 75.0
"""Walking past: arms and legs occlude the trunk and one another."""
FINE_SCALE = 0.3
"""Scale of the facets' sagitta at which they err less than time does."""
CHIRPS, SAMPLES = 16, (20, 128, 236)


def run() -> Section:
    radar = Radar.preset("table2")
    (surface_rates, default_hz), (occlusion_rates, unhidden) = _surface_rates(radar), _occlusion_rates(radar)
    checks = [
        Check(
            what=f"surface rate by default, here {default_hz:.0f} Hz",
            measured=surface_rates[default_hz],
            limit=-25,
            unit="dB",
        ),
        Check(
            what="occlusion rate at its default, 25 Hz",
            measured=occlusion_rates[DEFAULT_OCCLUSION_HZ],
            limit=-20,
            unit="dB",
        ),
    ]
    rows = [
        {"what": "surface rate, without occlusion", "rate Hz": rate, "field NMSE dB": e}
        for rate, e in surface_rates.items()
    ]
    rows += [
        {"what": f"occlusion rate, walking at {ACROSS_DEG:g} deg", "rate Hz": rate, "field NMSE dB": e}
        for rate, e in occlusion_rates.items()
    ]
    rows.append({"what": "the same without occlusion", "rate Hz": "", "field NMSE dB": unhidden})
    return Section(
        title="Surface rate and occlusion rate",
        checks=checks,
        note=f"Against the converged reference. Surface rate: walk, facets of {FINE_SCALE:g} times the default sagitta, so that "
        f"time alone errs. Occlusion: default facets, walking at {ACROSS_DEG:g} deg to the line of sight, surface rate "
        f"{FINE_HZ:g} Hz; the reference traces through the fine mesh at each chirp, `simulate` through the control cage at "
        "its keys.",
        table=rows,
        charts=[_chart(surface_rates, occlusion_rates)],
    )


def _errors(surface: MovingMesh, radar: Radar, settings: list[dict], occlusion: bool) -> list[float]:
    """NMSE [dB] of `simulate` with each of the settings."""
    chirps = random_chirps(surface, radar, CHIRPS)
    material = resolve_material("skin", radar.mid_frequency_hz)
    reference = reference_samples(
        surface,
        radar,
        chirps,
        np.array(SAMPLES),
        Converged(material=material, occlusion=occlusion),
    )
    cubes = (t2d.simulate(surface, radar=radar, accuracy=setting).cube[:, 0] for setting in settings)
    return [nmse_db(cube[np.ix_(chirps, SAMPLES)], reference) for cube in cubes]


def _surface_rates(radar: Radar) -> tuple[dict[float, float], float]:
    """Errors by rate, and the rate that the motion asks for."""
    surface = walking(1.9, 2.4)
    default_hz = needed_rate_hz(surface, radar, (surface.times_s[0], surface.times_s[-1]))
    rates = sorted({*SURFACE_RATES_HZ, default_hz})
    settings = [{"surface_rate_hz": rate, "occlusion": False, "sagitta_scale": FINE_SCALE} for rate in rates]
    return dict(zip(rates, _errors(surface, radar, settings, False), strict=True)), default_hz


def _occlusion_rates(radar: Radar) -> tuple[dict[float, float], float]:
    surface = walking(1.9, 2.4, angle_deg=ACROSS_DEG)
    fixed = {"surface_rate_hz": FINE_HZ}
    settings = [{"visibility_rate_hz": rate, **fixed} for rate in OCCLUSION_RATES_HZ]
    *errors, unhidden = _errors(surface, radar, [*settings, {"occlusion": False, **fixed}], True)
    return dict(zip(OCCLUSION_RATES_HZ, errors, strict=True)), unhidden


def _chart(surface_rates: dict[float, float], occlusion_rates: dict[float, float]) -> str:
    figure, axis = new_figure()
    axis.semilogx(surface_rates.keys(), surface_rates.values(), "o-", label="surface rate")
    axis.semilogx(occlusion_rates.keys(), occlusion_rates.values(), "s-", label=f"occlusion rate, {ACROSS_DEG:g} deg")
    axis.axhline(-20, color="C3", linestyle=":", label="limit of the whole")
    rates = sorted({*surface_rates, *occlusion_rates})
    axis.set_xticks(rates, [f"{rate:g}" for rate in rates])
    axis.minorticks_off()
    axis.set(xlabel="rate [Hz]", ylabel="field NMSE [dB]", title="walking body against the reference")
    axis.legend()
    axis.grid(alpha=0.3)
    return save_chart(figure, "rates.png")
