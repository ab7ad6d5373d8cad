"""The mesh at default settings against the converged float64 reference."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import t2d_rt as t2d
from t2d_rt.body.materials import resolve_material
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.types import PEC, MovingMesh, Radar
from validation.bodies import RUN, WALK, random_chirps, walking
from validation.methods.reference import Converged, nmse_db, reference_samples
from validation.physics.rcs import sphere
from validation.report import Section, at_most, new_figure, save_chart

STRETCHES = (("walk", WALK, 0.4), ("walk", WALK, 1.9), ("walk", WALK, 3.4), ("run", RUN, 0.4))
"""Name, recording, start [s]."""
LIMITS_DB = {"walk": -20.0, "run": -18.0}
"""The walk's is what default settings promise; a run swings arms across the body, and shadows limit it."""
STRETCH_S = 0.5
CHIRPS, SAMPLES = 20, (20, 128, 236)
SAGITTA_RAD, FINER_SAGITTA_RAD, FINER_CHIRPS = 0.08, 0.05, 4


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples (chirps, samples) of a piece of a recording, simulated and by the reference, and the reference's convergence."""

    name: str
    start_s: float
    times_s: np.ndarray
    simulated: np.ndarray
    reference: np.ndarray


def run() -> Section:
    radar = Radar.preset("table2")
    stretches = [_stretch(radar, *stretch) for stretch in STRETCHES]
    checks = [
        at_most(
            f"{s.name}, {s.start_s:g} to {s.start_s + STRETCH_S:g} s",
            nmse_db(s.simulated, s.reference),
            LIMITS_DB[s.name],
            "dB",
        )
        for s in stretches
    ]
    walk = [s for s in stretches if s.name == "walk"]
    pooled = nmse_db(np.concatenate([s.simulated for s in walk]), np.concatenate([s.reference for s in walk]))
    checks.append(at_most("walk, all stretches", pooled, -20, "dB"))
    checks.append(at_most("the reference itself, against a finer one", _convergence(radar), -30, "dB"))
    checks.append(at_most("the reference's sphere, against its closed form", _sphere(radar), -30, "dB"))
    return Section(
        title="Mesh at default settings against the converged reference",
        checks=checks,
        note=f"Field NMSE of ADC samples, `table2`, free space, skin with its diffuse part, self-occlusion: {CHIRPS} "
        f"random chirps of each stretch at {len(SAMPLES)} places of the sweep. The reference "
        f"(validation/methods/reference.py) sums facets of {SAGITTA_RAD} rad at each sample's own time and frequency, "
        "in float64, and traces occlusion through the fine mesh at each chirp; the finer one has "
        f"{FINER_SAGITTA_RAD} rad ({FINER_CHIRPS} chirps). "
        "What limits the run is occlusion. `simulate` traces at the "
        "vertices of its control cage, 25 mm apart, and fades between them and between its samples at 25 Hz.",
        table=[_row(s) for s in stretches],
        charts=[_chart(stretches)],
    )


def _stretch(radar: Radar, name: str, recording: str, start_s: float) -> Stretch:
    surface = walking(start_s, start_s + STRETCH_S, recording)
    cube = t2d.simulate(surface, radar=radar).cube[:, 0]
    chirps = random_chirps(surface, radar, CHIRPS)
    material = resolve_material("skin", radar.mid_frequency_hz)
    reference = reference_samples(
        surface, radar, chirps, np.array(SAMPLES), Converged(material=material, sagitta_rad=SAGITTA_RAD)
    )
    times = start_s + radar.chirp_starts_s(len(cube))[chirps]
    return Stretch(name, start_s, times, cube[np.ix_(chirps, SAMPLES)], reference)


def _convergence(radar: Radar) -> float:
    _, recording, start_s = STRETCHES[1]
    surface = walking(start_s, start_s + STRETCH_S, recording)
    chirps = random_chirps(surface, radar, FINER_CHIRPS, seed=1)
    material = resolve_material("skin", radar.mid_frequency_hz)
    coarse, fine = (
        reference_samples(surface, radar, chirps, np.array(SAMPLES), Converged(material=material, sagitta_rad=sagitta))
        for sagitta in (SAGITTA_RAD, FINER_SAGITTA_RAD)
    )
    return nmse_db(coarse, fine)


def _sphere(radar: Radar, radius_m: float = 0.15, range_m: float = 3.0) -> float:
    """Field NMSE [dB] of the reference for a conducting sphere against -sqrt(P) exp(j phase) of its specular point."""
    vertices, faces = sphere(radius_m, radar.tx_position_m + [range_m + radius_m, 0, 0], subdivisions=4)
    static = MovingMesh(np.stack([vertices, vertices]), faces, [0.0, 0.01], PEC)
    found = reference_samples(
        static, radar, np.array([3]), np.array(SAMPLES), Converged(material=PEC, sagitta_rad=SAGITTA_RAD)
    )[0]
    power = radar.received_power_w(math.pi * radius_m**2 * (range_m / (range_m + radius_m)) ** 2, range_m)
    delay = 2 * range_m / SPEED_OF_LIGHT
    frequency = radar.carrier_hz + radar.slope_hz_per_s * radar.sample_times_s[list(SAMPLES)]
    cycles = frequency * delay - radar.slope_hz_per_s * delay**2 / 2
    return nmse_db(found, -math.sqrt(power) * np.exp(2j * math.pi * cycles))


def _row(stretch: Stretch) -> dict[str, object]:
    places = {
        f"sample {sample}, dB": nmse_db(stretch.simulated[:, i], stretch.reference[:, i])
        for i, sample in enumerate(SAMPLES)
    }
    each = [nmse_db(a, b) for a, b in zip(stretch.simulated, stretch.reference, strict=True)]
    return {
        "stretch": f"{stretch.name} {stretch.start_s:g} s",
        **places,
        "median chirp, dB": np.median(each),
        "worst chirp, dB": max(each),
    }


def _chart(stretches: list[Stretch]) -> str:
    figure, axis = new_figure()
    mean = {
        s.name: np.mean([np.mean(np.abs(t.reference) ** 2) for t in stretches if t.name == s.name]) for s in stretches
    }
    for s in stretches:
        error = 10 * np.log10(np.mean(np.abs(s.simulated - s.reference) ** 2, axis=1) / mean[s.name])
        axis.plot(s.times_s, error, "o" if s.name == "walk" else "x", label=f"{s.name} {s.start_s:g} s")
    axis.axhline(-20, color="C3", linestyle=":", label="limit")
    axis.set(xlabel="time in the recording [s]", ylabel="error of a chirp, re mean power [dB]")
    axis.set_title("mesh at default settings against the reference")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    return save_chart(figure, "accuracy.png")
